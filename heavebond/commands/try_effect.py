"""`heavebond try`: one effect put into the diagram by hand and fitted."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import json_option


@click.command("try", short_help="Try one missing effect by hand.")
@click.argument("experiment")
@click.argument("component")
@click.option("--between", nargs=2, metavar="NODE NODE", help="The two nodes between which it stands.")
@click.option("--at", "at", metavar="NAME", multiple=True, help="The node, part or output at which it stands.")
@click.option("--write", "folder", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Write the diagram with the effect, and the experiment on it, into FOLDER (made if needed).")
@json_option
def try_effect(experiment: str, component: str, between: tuple[str, str] | None, at: tuple[str, ...], folder: Path | None
               ) -> dict[str, object]:
    """Add COMPONENT to the diagram of EXPERIMENT, estimate all free parameters with it, and show the errors.

    COMPONENT has an `effect:` entry (`heavebond candidates EXPERIMENT` lists those that fit), or is a dormant parameter
    such as cylinder.leakage, or a number that the diagram holds fixed such as crown.m.
    """
    from heavebond.commands import terminal
    from heavebond.commands.diagnose import parameters
    from heavebond.commands.errors import table
    from heavebond.core.presentation import number
    from heavebond.diagnosis.diagnosis import attempt
    from heavebond.diagnosis.diagnosis_files import Targets, write_findings
    from heavebond.estimation.experiment import load_experiment

    given = load_experiment(experiment)
    targets = Targets.beside(given, folder) if folder is not None else None
    with terminal.working("trying") as progress:
        found = attempt(given, component, [*(between or ()), *at], progress=progress)
    console = terminal.output()
    console.print(table(found.ladder, "model"))
    console.print(parameters(found.finding))
    console.print(f"BIC changes by {number(found.bic_difference, 4)} (below -10 is strong evidence for the effect); on "
                  + ("held-out data the error falls by more than chance." if found.earned else
                     "held-out data the effect does not lower the error by more than chance."), soft_wrap=True)
    files = [] if targets is None else write_findings(given, [found.finding], targets)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    if files:
        console.print(f"go on: heavebond compare {files[-1]}; heavebond diagnose {files[-1]}", soft_wrap=True)
    return {"experiment": given.name, **found.as_dict(), "files": list(map(str, files))}
