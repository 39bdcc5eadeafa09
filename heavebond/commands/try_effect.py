"""`heavebond try`: add one effect to the diagram and fit it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import json_option, native_option

if TYPE_CHECKING:
    from heavebond.diagnosis.answer.files import Targets
    from heavebond.estimation.experiment import Experiment


@click.command("try", short_help="Try one missing effect by hand.")
@click.argument("experiment")
@click.argument("component")
@click.option("--between", nargs=2, metavar="NODE NODE", help="The two nodes between which the effect is placed.")
@click.option("--at", "at", metavar="NAME", multiple=True,
              help="The node, part or output of the effect; for a factor the parameter and the variable.")
@click.option("--write", "written", metavar="FOLDER|FILE", type=click.Path(path_type=Path),
              help="Write the diagram with the effect, and the experiment on it, into FOLDER (created if needed), or the "
              "experiment as FILE.yaml. If the names exist, the next free number is used.")
@native_option
@json_option
def try_effect(experiment: str, component: str, between: tuple[str, str] | None, at: tuple[str, ...], written: Path | None
               ) -> dict[str, object]:
    """Add COMPONENT to the diagram of EXPERIMENT, estimate all free parameters with it, and show the errors.

    COMPONENT has an `effect:` entry (`heavebond candidates EXPERIMENT` lists those that fit), or is an inactive parameter
    such as cylinder.leakage, or a number that the diagram holds fixed such as crown.m. For a parameter that varies, add
    LinearVariation, PiecewiseVariation or another factor, with the parameter and the variable as places: --at spring.c
    --at spring.s.
    """
    from heavebond.commands import terminal
    from heavebond.diagnosis.answer.files import write_findings
    from heavebond.diagnosis.attempt import attempt
    from heavebond.estimation.experiment import load_experiment
    from heavebond.reports.result_tables import attempt_items

    loaded = load_experiment(experiment)
    targets = _targets(loaded, written)
    with terminal.working("trying") as progress:
        result = attempt(loaded, component, [*(between or ()), *at], progress=progress)
    console = terminal.output()
    terminal.show(attempt_items(result))
    targets = _targets(loaded, written)  # another command may have written to this folder meanwhile
    files = [] if targets is None else write_findings(loaded, [result.finding], targets)
    if targets is not None and targets.passed:
        console.print(f"{targets.passed} exists and is kept: the new files have the next free number", soft_wrap=True)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    if files:
        further = f"; heavebond diagnose {files[-1]}" if result.earned else ""
        console.print(f"next: heavebond compare {files[-1]}{further}", soft_wrap=True)
    return {"experiment": loaded.name, **result.as_dict(), "files": list(map(str, files))}


def _targets(experiment: Experiment, written: Path | None) -> Targets | None:
    """Files that --write names: a file if it ends in .yaml, else a folder; None without it."""
    from heavebond.diagnosis.answer.files import Targets

    if written is None:
        return None
    return Targets.named(experiment, written) if written.suffix in (".yaml", ".yml") else Targets.beside(experiment, written)
