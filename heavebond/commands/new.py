"""`heavebond new`: create a folder with a first diagram."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import json_option


@click.command(short_help="Create a project folder with a diagram, an experiment and records.")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--from", "origin", metavar="MACHINE", help="Copy a bundled machine, e.g. --from passive_rig.")
@json_option
def new(folder: Path, origin: str | None) -> dict[str, object]:
    """Create FOLDER with a diagram, an experiment, records and a README with the commands to type.

    Without --from it is a load on a spring, with records that contain one effect which the diagram lacks.
    """
    from heavebond.commands import terminal
    from heavebond.estimation.starter_folder import start_folder

    with terminal.working("writing"):
        made = start_folder(folder, origin)
    console = terminal.output()
    for path in made.files:
        console.print(f"wrote {path}", soft_wrap=True)
    console.print(f"next: cd {folder}; heavebond run {made.diagrams[0].name}; then as {folder / 'README.md'} says",
                  soft_wrap=True)
    return {"folder": str(folder), "files": [str(path) for path in made.files]}
