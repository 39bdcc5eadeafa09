"""`heavebond new`: create a folder with a first diagram, or an experiment for a diagram and its records."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from heavebond.commands.arguments import check_new, json_option
from heavebond.core.errors import Problem, UsageError

HEAD = ("column", "is", "of", "unit")


@click.command(short_help="Create a folder to begin with, or an experiment from records.")
@click.argument("target", metavar="FOLDER | EXPERIMENT", type=click.Path(path_type=Path))
@click.argument("records", nargs=-1, type=click.Path(path_type=Path))
@click.option("--from", "origin", metavar="MACHINE | DIAGRAM", help="Copy a bundled machine, e.g. --from passive_rig; with "
              "records, the diagram of the machine that was measured.")
@click.option("--every", metavar="TIME", help="With records that have a fixed rate and no times: the time between two rows, "
              "e.g. --every '10 ms'.")
@json_option
def new(target: Path, records: tuple[Path, ...], origin: str | None, every: str | None) -> dict[str, object]:
    """Create FOLDER with a diagram, an experiment, records and a README with the commands to type.

    Without --from it is a load on a spring, with records that contain one effect which the diagram lacks.

    With RECORDS write an EXPERIMENT that compares a diagram with them:

    heavebond new measured.yaml --from lift.yaml monday.csv tuesday.csv

    Columns are recognised by their names and units. The first record is fitted, the others validate.
    """
    from heavebond.commands import terminal
    from heavebond.estimation.starter_folder import new as start_folder

    if records or target.suffix in (".yaml", ".yml"):
        return _experiment(target, origin, records, every or "")
    with terminal.working("writing"):
        starter = start_folder(target, origin)
    console = terminal.output()
    for path in starter.files:
        console.print(f"wrote {path}", soft_wrap=True)
    console.print(f"next: cd {target}; heavebond run {starter.diagrams[0].name}; then as {target / 'README.md'} describes",
                  soft_wrap=True)
    return {"folder": str(target), "files": [str(path) for path in starter.files]}


def _experiment(path: Path, origin: str | None, records: tuple[Path, ...], every: str) -> dict[str, object]:
    from heavebond.commands import terminal
    from heavebond.core.writable import write_text
    from heavebond.estimation.proposed_experiment import proposed_text
    from heavebond.language.model import load

    if origin is None or not records:
        problem_text = "the diagram is missing" if origin is None else "there are no records"
        raise UsageError([Problem("usage", problem_text, None, f"Write for example `heavebond new {path} --from "
                                  f"{origin or 'machine.yaml'} {' '.join(map(str, records)) or 'record.csv'}`.")])
    check_new(path, (".yaml", ".yml"))
    with terminal.working("reading the records"):
        text, proposal = proposed_text(path, load(origin), records, every)
    console = terminal.output()
    rows = [(c.name, c.role or "not used", c.target,
             c.unit if c.unit_known else f"{c.unit} (assumed: the file gives no known unit)") for c in proposal.columns]
    console.print(terminal.table("", HEAD, rows, text=4))
    for remark in proposal.remarks:
        console.print(remark, soft_wrap=True)
    write_text(path, text)
    console.print(f"wrote {path}", soft_wrap=True)
    console.print(f"next: look through {path}, then heavebond compare {path}", soft_wrap=True)
    return {"experiment": str(path), "files": [str(path)], "columns": [asdict(c) for c in proposal.columns],
            "remarks": list(proposal.remarks)}
