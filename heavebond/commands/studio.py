"""`heavebond studio`: diagrams in the browser."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import Whole, json_option, native_option
from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import write_text

if TYPE_CHECKING:
    from heavebond.studio.folder import Folder

NEEDED = ("starlette", "uvicorn", "websockets")


@click.command(short_help="See, change and run diagrams in the browser.")
@click.argument("target", metavar="[FOLDER | MODEL]", default=".")
@click.option("--port", metavar="NUMBER", type=Whole(1024, 65535), help="Port of the page; by default the first free one "
              "from 8437 on.")
@click.option("--no-browser", is_flag=True, help="Print the address of the page, and do not open a browser.")
@click.option("--allow-fmu", is_flag=True,
              help="Run the programs in the FMUs of the diagrams. Do so only with FMUs you trust.")
@native_option
@json_option
def studio(target: str, port: int | None, no_browser: bool, allow_fmu: bool) -> dict[str, object]:
    """Open a page on which the diagrams of FOLDER (by default the current folder) are drawn, changed and run.

    MODEL is a YAML file or the name of a bundled diagram (cmc_ahc, cmc_ahc/passive). The page is served to this computer
    only, at an address that contains a secret token, until Ctrl-C. If the browser opens no page or an empty one (some do
    not read temporary files), open the printed address in it.
    """
    absent = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if absent:
        raise UsageError([Problem("studio-missing", f"the studio needs packages that are not installed: {', '.join(absent)}",
                                  None, "pip install 'heavebond[studio]'")])
    from heavebond.core.native_permission import fmu_code
    from heavebond.studio.server import Studio, bind, serve

    folder, first = _opened(target)
    listener = bind(port)
    opened = Studio(folder, first, listener.getsockname()[1], command_line="heavebond.cli:main")

    def ready() -> None:
        click.echo(f"{folder.root}: {opened.address}\nCtrl-C ends the studio.")
        if not no_browser:
            import webbrowser

            page = Path(private) / "open.html"
            write_text(page, f'<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">'
                       f'<meta http-equiv="refresh" content="0; url={opened.address}"><title>heavebond</title>'
                       f'<a href="{opened.address}">Open the studio</a>\n')
            webbrowser.open(page.as_uri())

    try:
        # readable by this user only
        with tempfile.TemporaryDirectory(prefix="heavebond-", ignore_cleanup_errors=True) as private, fmu_code(allow_fmu):
            serve(opened, listener, ready)
    except KeyboardInterrupt:  # Ctrl-C is the normal end
        from heavebond.core.cancellation import clear_signal

        clear_signal()
    return {"folder": str(folder.root), "port": opened.port}


def _opened(target: str) -> tuple[Folder, str]:
    """The folder to open, and the diagram to show first."""
    from heavebond.language.library import bundled
    from heavebond.language.model import find
    from heavebond.studio.folder import Folder, bundled_machines

    path = Path(target)
    if path.is_dir():
        return Folder(path.resolve()), ""
    file = find(target).resolve()
    if file.is_relative_to(bundled("models").resolve()):
        names = {str(Path(entry["path"]).resolve()): entry["name"] for entry in bundled_machines()}
        if str(file) in names:
            return Folder(Path.cwd()), names[str(file)]
    return Folder(file.parent), file.name
