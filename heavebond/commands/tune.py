"""`heavebond tune`: tune parameters by minimisation of a cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Whole,
    blamed_on_settings,
    check_new,
    check_picture,
    json_option,
    native_option,
    picture_option,
    set_option,
    settings_of,
    with_settings,
)
from heavebond.core.cancellation import ENDED_EARLY, Interrupted, last_heard
from heavebond.core.errors import UsageError

if TYPE_CHECKING:
    from heavebond.numerics.dae import Array
    from heavebond.optimise.robustness import Robustness
    from heavebond.optimise.tuning import Tuned
    from heavebond.studies.tuning_request import TuningRequest


@click.command(short_help="Tune parameters of a diagram by exact gradients.")
@click.argument("study", metavar="STUDY|DIAGRAM")
@click.option("--free", metavar="PARAMETER[=RANGE][,...]", multiple=True,
              help="A free parameter and its range: controller.K_p='0 .. 8 1/m'. Without a range 0 to three times its "
                   "value. May be repeated.")
@click.option("--cost", metavar="FORMULA", help="The cost to minimise, e.g. 'rms(crown.x)/ref(rms(crown.x))'.")
@click.option("--limit", "limits", metavar="FORMULA", multiple=True,
              help="A limit, e.g. 'peak(extension) < 3.8 m' or 'damping(least) > 0.1'. May be repeated.")
@click.option("--stable/--no-stable", default=None,
              help="Whether the tuned machine must be stable at rest [default: as in the study; else yes if stability can "
                   "be decided].")
@click.option("--evaluate", metavar="'FROM .. TO'", help="The evaluated time, e.g. '72 .. 96 s' [default: the whole run].")
@click.option("--reference", metavar="PATH=VALUE", multiple=True,
              help="A value of the run from which ref(...) is computed. May be repeated.")
@set_option
@click.option("--method", default="trust", show_default=True, help="trust or ipopt.")
@click.option("--explore", type=Whole(0), default=5, show_default=True,
              help="Plain runs at points spread over the ranges before the search.")
@click.option("--starts", type=Whole(1), default=1, show_default=True,
              help="Search from so many of the best of these.")
@click.option("--robustness/--no-robustness", default=True, show_default=True,
              help="Show the sensitivities of the cost at the optimum and the distance to the stability boundary.")
@click.option("--sweep", "grid", metavar="N", type=Whole(2), help="Compare with a sweep of N x N points.")
@click.option("--write", "written", metavar="DIAGRAM", type=click.Path(path_type=Path),
              help="Write a diagram that extends the model with the tuned values (.yaml, must be new).")
@picture_option("Draw the cost surface and the optimisation path (two free parameters, with --sweep)")
@native_option
@json_option
def tune(study: str, free: tuple[str, ...], cost: str | None, limits: tuple[str, ...], evaluate: str | None,
         reference: tuple[str, ...], settings: tuple[str, ...], method: str, explore: int, starts: int, robustness: bool,
         stable: bool | None, grid: int | None, written: Path | None, output: Path | None) -> dict[str, object]:
    """Minimise the cost of STUDY, a YAML file or a bundled one (cmc_ahc/quality_index), or of a DIAGRAM by --free and
    --cost."""
    from heavebond.commands import terminal
    from heavebond.numerics.dae import assemble
    from heavebond.numerics.simulation import simulate
    from heavebond.optimise.objective import Objective
    from heavebond.optimise.robustness import robustness as around
    from heavebond.optimise.tuning import sweep
    from heavebond.optimise.tuning import tune as tuned
    from heavebond.reports.study_tables import tuning_figures, tuning_items
    from heavebond.studies.tuning_request import tuning_request, with_free

    check_picture(output)
    if written is not None:
        check_new(written, (".yaml",))
    request = tuning_request(study, cost, limits, evaluate, settings_of("--reference", reference))
    if stable is not None:
        request = replace(request, task=replace(request.task, stable=stable))
    with blamed_on_settings(settings), terminal.working("tuning") as progress:
        assembly = assemble(with_settings(request.model, settings))
        task = with_free(assembly, request.task, free)
        if output is not None and (grid is None or len(task.free) != 2):
            raise UsageError("a cost surface needs two free parameters and --sweep", hint="Add --sweep 12.")
        objective = Objective(assembly, task)
        result = tuned(objective, task, explore=explore, starts=starts, method=method, progress=progress,
                       partial=True)
        early = result.message == ENDED_EARLY
        swept = sweep(objective, [grid] * len(task.free), progress=progress) if grid and not early else None
        robust = around(objective, result, progress=progress) if robustness and not early else None
        if task.end is not None or assembly.model.until is not None:
            simulate(assembly.with_parameters(result.values), task.end)  # for its verdict
    terminal.show(tuning_items(request.name, assembly, result, robust, swept))
    files = _files(request, result, robust, swept, output, written, settings_of("--set", settings))
    figures = {**tuning_figures(request.name, result, robust), "files": list(map(str, files))}
    if early:
        raise Interrupted(last_heard(), figures)
    return figures


def _files(request: TuningRequest, result: Tuned, robust: Robustness | None, swept: tuple[list[Array], Array] | None,
           output: Path | None, written: Path | None, settings: Mapping[str, str]) -> list[Path]:
    from heavebond.commands import terminal

    files = []
    if output is not None and swept is not None:
        from heavebond.pictures.plot import plot_surface, save

        files.append(save(plot_surface(result.task, result, *swept, robust.ellipse if robust else None), output))
    if written is not None:
        from heavebond.language.edits import write
        from heavebond.optimise.tuning import tuned_diagram

        write(written, tuned_diagram(request.model, result.task, result, written, settings))
        files.append(written)
    for path in files:
        terminal.output().print(f"wrote {path}", soft_wrap=True)
    return files
