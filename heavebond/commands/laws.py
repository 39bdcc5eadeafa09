"""`heavebond laws`: a formula for the law that a model lacks."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import check_picture, check_writable, json_option, native_option, picture_option


@click.command(short_help="Find a formula for the law that a model lacks.")
@click.argument("experiment")
@click.option("--at", "at", metavar="NODE", multiple=True,
              help="The node at which the law acts; twice for a law between two nodes. Without it the likeliest places.")
@click.option("--write", "written", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Write the formula as a component, the diagram with it, and the experiment on it, into FOLDER (made if "
              "needed). Names of earlier results are counted up.")
@click.option("--decide", metavar="FILE", type=click.Path(path_type=Path, dir_okay=False),
              help="Design the input that distinguishes formulas which the records cannot, and write it as a CSV file to "
              "drive the machine with.")
@picture_option("Draw the formula over its variable with the input that the records ask for")
@native_option
@json_option
def laws(experiment: str, at: tuple[str, ...], written: Path | None, decide: Path | None, output: Path | None
         ) -> dict[str, object]:
    """Find a formula, with units, for the law that the model of EXPERIMENT lacks at a place of its diagram.

    Closed forms of the variables at the place (relative position, speed, pressure, signals) are composed to formulas and
    refitted in simulation beside laws of the catalogue. The answer is the simplest formula that the records cannot
    distinguish from the best one. It is meant for laws outside the catalogue: `heavebond diagnose` comes first.
    """
    from heavebond.commands import terminal
    from heavebond.core.errors import UsageError
    from heavebond.diagnosis.answer.files import Targets, write_proposal
    from heavebond.estimation.experiment import load_experiment
    from heavebond.laws.find import find_laws, write_law
    from heavebond.pictures.plot import save
    from heavebond.pictures.plot_where import plot_law
    from heavebond.reports.result_tables import laws_items

    check_picture(output)
    if decide is not None:
        check_writable(decide, (".csv",))
        if decide.exists():
            raise UsageError(f"{decide} exists already", hint="Give another name, or remove it first.")
    loaded = load_experiment(experiment)
    targets = Targets.beside(loaded, written) if written is not None else None
    with terminal.working("searching formulas") as progress:
        answer = find_laws(loaded, at=at, separation=decide is not None, progress=progress)
    console = terminal.output()
    terminal.show(laws_items(answer))
    files = write_law(answer, targets) if targets is not None else []
    if decide is not None and answer.separation is not None:
        files += write_proposal(answer.separation, decide)
    if output is not None and answer.simplest is not None:
        files.append(save(plot_law(answer), output))
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    if targets is not None and files:
        console.print(f"next: heavebond compare {next(p for p in reversed(files) if p.suffix == '.yaml')}", soft_wrap=True)
    return {"experiment": loaded.name, **answer.as_dict(), "files": list(map(str, files))}
