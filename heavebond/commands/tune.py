"""`heavebond tune`: gains that make a cost small."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    blamed_on_settings,
    check_picture,
    check_writable,
    json_option,
    picture_option,
    set_option,
    with_settings,
)
from heavebond.errors import UsageError

if TYPE_CHECKING:
    from heavebond.dae import Array, Assembly
    from heavebond.tuning import Objective, Progress, Task, Tuned


@click.command(short_help="Tune parameters of a diagram by exact gradients.")
@click.argument("study")
@set_option
@click.option("--explore", type=click.IntRange(0), default=10, show_default=True,
              help="Plain runs at points spread over the ranges before the search.")
@click.option("--starts", type=click.IntRange(1), default=1, show_default=True,
              help="Search from so many of the best of these.")
@click.option("--sweep", "grid", metavar="N", type=click.IntRange(2), help="Compare with a sweep of N x N points.")
@click.option("--write", "written", metavar="DIAGRAM", type=click.Path(path_type=Path),
              help="Write a diagram that extends the model with the tuned values (.yaml, must be new).")
@picture_option("Draw the cost surface and the way of the search (two free parameters, with --sweep)")
@json_option
def tune(study: str, settings: tuple[str, ...], explore: int, starts: int, grid: int | None, written: Path | None,
         output: Path | None) -> dict[str, object]:
    """Minimise the cost of STUDY, a YAML file or a bundled one (cmc_ahc/quality_index)."""
    from heavebond import terminal
    from heavebond.dae import assemble
    from heavebond.study import load_study
    from heavebond.tuning import Objective
    from heavebond.tuning import tune as tuned
    from heavebond.writing import tuned_diagram, write

    check_picture(output)
    if written is not None:
        check_writable(written, (".yaml",))
    found_study = load_study(study)
    task = found_study.task
    if output is not None and (grid is None or len(task.free) != 2):
        raise UsageError("a cost surface needs two free parameters and --sweep", hint="Add --sweep 12.")
    with blamed_on_settings(settings), terminal.working("tuning") as progress:
        assembly = assemble(with_settings(found_study.model, settings))
        result = tuned(assembly, task, explore=explore, starts=starts, progress=progress)
        robust = _robustness(assembly, task, result)
        swept = _swept(Objective(assembly, task), grid, progress) if grid else None
    console = terminal.output()
    console.print(_table(found_study.name, assembly, task, result))
    console.print(f"cost {result.cost:.5g} (before {result.before:.5g}), {result.runs} runs that cost "
                  f"{result.simulations:.0f} simulations: {result.message}", soft_wrap=True)
    for text, cost in robust.items():
        console.print(f"{text}: cost {cost:.5g}", soft_wrap=True)
    files = []
    if swept is not None:
        best = min(cost for cost in swept[1].ravel().tolist() if math.isfinite(cost))
        console.print(f"best of the sweep of {swept[1].size} runs: {best:.5g}", soft_wrap=True)
    if output is not None and swept is not None:
        from heavebond.plot import plot_surface, save

        files.append(save(plot_surface(task, result, *swept), output))
    if written is not None:
        write(written, tuned_diagram(found_study.model, task, result, written))
        files.append(written)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    return {"study": found_study.name, "values": result.values, "cost": result.cost, "before": result.before,
            "cases": result.cost_of_cases, "limits": result.limits, "runs": result.runs,
            "simulations": result.simulations, "robustness": robust, "message": result.message,
            "paths": [[{"values": s.values, "cost": s.cost} for s in path] for path in result.paths],
            "files": list(map(str, files))}


def _robustness(assembly: Assembly, task: Task, result: Tuned) -> dict[str, float]:
    """The cost where each value is 10 % lower or higher than the best: how sharp the optimum is."""
    from heavebond.tuning import Objective

    objective = Objective(assembly, task)
    best = (_array(result, objective) - objective.low) / objective.span
    found = {}
    for k, name in enumerate(objective.names):
        for word, share in (("lower", 0.9), ("higher", 1.1)):
            at = best.copy()
            at[k] = (share * result.values[name] - objective.low[k]) / objective.span[k]
            found[f"{name} 10 % {word}"] = objective.cost(at)
    return found


def _array(result: Tuned, objective: Objective) -> Array:
    import numpy as np

    return np.array([result.values[name] for name in objective.names])


def _swept(objective: Objective, grid: int, progress: Progress) -> tuple[list[Array], Array]:
    from heavebond.tuning import sweep

    return sweep(objective, [grid] * len(objective.names), progress=progress)


def _table(name: str, assembly: Assembly, task: Task, result: Tuned) -> object:
    from heavebond import terminal
    from heavebond.writing import quantity

    rows = [(parameter, quantity(assembly.parameter_values[parameter], wanted.unit),
             quantity(result.values[parameter], wanted.unit),
             f"{quantity(wanted.low, wanted.unit)} .. {quantity(wanted.high, wanted.unit)}")
            for parameter, wanted in task.free.items()]
    return terminal.table(name, ("parameter", "before", "tuned", "range"), rows)
