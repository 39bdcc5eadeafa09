"""`heavebond schema`: JSON Schema files for completion and checks in an editor."""

from __future__ import annotations

import json
from pathlib import Path

import click

from heavebond.commands.arguments import check_writable, json_option
from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import write_text

NAME = "heavebond.schema.json"


@click.command(short_help="Write a JSON schema for completion and checks in an editor.")
@click.option("--for", "folder", metavar="FOLDER", type=click.Path(path_type=Path), default=Path(),
              help="Folder of your diagrams; its components are included.  [default: the current folder]")
@click.option("-o", "--output", metavar="FILE", type=click.Path(path_type=Path),
              help=f"File of the schema (.json).  [default: FOLDER/.vscode/{NAME}]")
@json_option
def schema(folder: Path, output: Path | None) -> dict[str, object]:
    """Write a JSON Schema of the files of the language, and the settings for Visual Studio Code.

    Its extension YAML (redhat.vscode-yaml) then completes while you type and underlines mistakes. Run this command again
    after you have added a component.
    """
    from heavebond.commands.terminal import output as console
    from heavebond.exchange.json_schema import schema as make
    from heavebond.language.library import library

    if not folder.is_dir():
        raise UsageError([Problem("folder-missing", f"cannot find the folder '{folder}'", None,
                                  "Give an existing folder to --for.")])
    path, files = output or folder / ".vscode" / NAME, []
    if output is None:
        path.parent.mkdir(exist_ok=True)
    check_writable(path, (".json",))
    write_text(path, json.dumps(make(library([folder])), ensure_ascii=False, separators=(",", ":")) + "\n")
    files.append(path)
    settings = folder / ".vscode" / "settings.json"
    snippet = {"yaml.schemas": {_from(folder, path): "*.yaml"}}
    if path.parent == settings.parent and not settings.exists():
        write_text(settings, json.dumps(snippet, indent=2) + "\n")
        files.append(settings)
    else:
        console().print("Put this into the settings of your editor (.vscode/settings.json):", soft_wrap=True)
        console().print(json.dumps(snippet, indent=2), soft_wrap=True, highlight=False, markup=False)
    for written in files:
        console().print(f"wrote {written}", soft_wrap=True)
    console().print("Or begin a single file with the line", soft_wrap=True)
    console().print(f"# yaml-language-server: $schema={_from(folder, path)}", soft_wrap=True, highlight=False, markup=False)
    return {"files": [str(written) for written in files], "settings": snippet}


def _from(folder: Path, path: Path) -> str:
    """Path of the file from the folder that is open in the editor."""
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return path.resolve().as_posix()
