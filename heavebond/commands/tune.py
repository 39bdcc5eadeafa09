"""`heavebond tune`: tune parameters by minimisation of a cost."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Whole,
    blamed_on_settings,
    check_new,
    check_picture,
    json_option,
    picture_option,
    set_option,
    settings_of,
    with_settings,
)
from heavebond.core.cancellation import ENDED_EARLY, Interrupted, last_heard
from heavebond.core.errors import ModelError, Problem, UsageError

if TYPE_CHECKING:
    from heavebond.core.units import Range
    from heavebond.language.model import Model
    from heavebond.numerics.dae import Array, Assembly
    from heavebond.optimise.objective import TuningProblem
    from heavebond.optimise.robustness import Robustness
    from heavebond.optimise.tuning import Tuned

TIMES = 3  # a free parameter without a range may grow to so many times its value


@click.command(short_help="Tune parameters of a diagram by exact gradients.")
@click.argument("study", metavar="STUDY|DIAGRAM")
@click.option("--free", metavar="PARAMETER[=RANGE][,...]", multiple=True,
              help="What may move: controller.K_p='0 .. 8 1/m'. Without a range 0 to three times its value. May repeat.")
@click.option("--cost", metavar="FORMULA", help="What is to be small, e.g. 'rms(crown.x)/ref(rms(crown.x))'.")
@click.option("--limit", "limits", metavar="FORMULA", multiple=True,
              help="What must be kept, e.g. 'peak(extension) < 3.8 m' or 'damping(least) > 0.1'. May be repeated.")
@click.option("--stable/--no-stable", default=None,
              help="Whether the tuned machine must be stable at rest [default: as the study says, else it must].")
@click.option("--evaluate", metavar="'FROM .. TO'", help="The time that counts, e.g. '72 .. 96 s'; else the whole run.")
@click.option("--reference", metavar="PATH=VALUE", multiple=True,
              help="A value of the run that ref(...) is taken from. May be repeated.")
@set_option
@click.option("--method", default="trust", show_default=True, help="trust, slsqp or ipopt.")
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

    check_picture(output)
    if written is not None:
        check_new(written, (".yaml",))
    asked = _asked(study, cost, limits, evaluate, reference)
    if stable is not None:
        asked = replace(asked, task=replace(asked.task, stable=stable))
    with blamed_on_settings(settings), terminal.working("tuning") as progress:
        assembly = assemble(with_settings(asked.model, settings))
        task = replace(asked.task, free={**asked.task.free, **_free(assembly, free)}) if free else asked.task
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
    _tell(asked.name, assembly, result, robust, swept)
    files = _files(asked, result, robust, swept, output, written, settings_of("--set", settings))
    figures = {**_figures(asked.name, result), "robustness": _robust_figures(robust), "files": list(map(str, files))}
    if early:
        raise Interrupted(last_heard(), figures)
    return figures


# -- what is asked -----------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class TuningRequest:
    """What is to be tuned in which diagram, and how that is called."""

    name: str
    model: Model
    task: TuningProblem


def _asked(name: str, cost: str | None, limits: tuple[str, ...], evaluate: str | None,
           reference: tuple[str, ...]) -> TuningRequest:
    """The study, with what the options say instead; for a diagram the options alone."""
    from heavebond.language.model import load
    from heavebond.linear.rest_stability import STABLE
    from heavebond.optimise.objective import TuningProblem
    from heavebond.studies.study import load_study

    try:
        study = load_study(name)
        model, task, name = study.model, study.tuning, study.name
    except ModelError as error:
        if cost is None or error.problems[0].code != "not-a-study":
            raise
        model = load(name)
        task, name = TuningProblem({}, cost), model.name
    task = replace(task, cost=cost or task.cost, limits=(*task.limits, *(text for text in limits if text != STABLE)),
                   stable=task.stable or STABLE in limits)
    if reference:
        task = replace(task, reference=settings_of("--reference", reference))
    if evaluate is not None:
        begin, end = _seconds(evaluate)
        task = replace(task, begin=begin, end=end)
    return TuningRequest(name, model, task)


def _seconds(text: str) -> tuple[float, float]:
    from heavebond.core.units import UnitProblem, parse_range, unit

    try:
        found = parse_range(text)
        if found.unit.dimension != unit("s").dimension:
            raise UnitProblem("unit-wrong", f"'{text}' is no time", "Write for example --evaluate '72 .. 96 s'.")
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"--evaluate: {problem.message}", None, problem.hint)]) from None
    return found.low, found.high


def _free(assembly: Assembly, texts: tuple[str, ...]) -> dict[str, Range]:
    """Ranges by name; a parameter without one may go from 0 to three times its value."""
    from heavebond.core.quantities import ranges
    from heavebond.core.units import Range

    found: dict[str, Range] = {}
    units = {q.name: q.unit for q in assembly.flat.parameters}
    for part in (part.strip() for text in texts for part in text.split(",") if part.strip()):
        name, sign, text = (piece.strip() for piece in part.partition("="))
        if sign:
            found |= ranges({name: text})
            continue
        assembly.with_parameters({name: 0.0})  # says what is wrong with a name that cannot be set
        value = assembly.parameter_values[name]
        if not value:
            raise UsageError([Problem("range-missing", f"{name} is 0, which says nothing about its range", None,
                                      f"Write for example --free {name}='0 .. 10 {units[name].text}'.")])
        found[name] = Range(min(0.0, TIMES * value), max(0.0, TIMES * value), units[name])
    return found


# -- what is told ------------------------------------------------------------------------------------------------------
def _tell(name: str, assembly: Assembly, result: Tuned, robust: Robustness | None, swept: tuple[list[Array], Array] | None
          ) -> None:
    from heavebond.commands import terminal
    from heavebond.linear.rest_stability import STABLE
    from heavebond.linear.rest_stability import stability_sentences as stability_words

    console = terminal.output()
    console.print(_table(name, assembly, result.task, result))
    before = f"before {result.before:.5g}" if math.isfinite(result.before) else "before: beyond the stability boundary"
    console.print(f"cost {result.cost:.5g} ({before}), {result.runs} runs that cost {result.simulations:.0f} simulations: "
                  f"{result.message}", soft_wrap=True)
    for text, value in ((t, v) for t, v in result.limits.items() if t != STABLE):
        console.print(f"limit {text}: " + (f"exceeded by {100 * value:.3g} %" if value > 1e-4 else
                                           f"kept, {100 * -value:.3g} % to spare" if value < -1e-3 else "just kept"),
                      soft_wrap=True)
    if len(result.cost_of_cases) > 1:
        rows = [(case, f"{cost:.5g}") for case, cost in result.cost_of_cases.items()]
        console.print(terminal.table("", ("case", "cost"), rows))
    stability = stability_words(result.stability, asked=result.task.stable)
    for line in (*_end_words(result), *stability, *_boundary_words(result)):
        console.print(line, style="yellow" if "NOT STABLE" in line else None, soft_wrap=True)
    if robust is not None:
        console.print()
        console.print(_changes(assembly, result, robust))
        for line in _words(result, robust):
            console.print(line, soft_wrap=True)
    if swept is not None:
        best = min(cost for cost in swept[1].ravel().tolist() if math.isfinite(cost))
        console.print(f"best of the sweep of {swept[1].size} runs: {best:.5g}", soft_wrap=True)


def _table(name: str, assembly: Assembly, task: TuningProblem, result: Tuned) -> object:
    from heavebond.commands import terminal
    from heavebond.estimation.diagram_files import quantity

    rows = [(parameter, quantity(assembly.parameter_values[parameter], wanted.unit),
             quantity(result.values[parameter], wanted.unit),
             f"{quantity(wanted.low, wanted.unit)} .. {quantity(wanted.high, wanted.unit)}")
            for parameter, wanted in task.free.items()]
    return terminal.table(name, ("parameter", "before", "tuned", "range"), rows)


def _changes(assembly: Assembly, result: Tuned, robust: Robustness) -> object:
    from heavebond.commands import terminal
    from heavebond.estimation.diagram_files import quantity

    units = {q.name: q.unit for q in assembly.flat.parameters}
    rows = []
    for change in robust.changes:
        unit = result.task.free[change.name].unit if change.name in result.task.free else units[change.name]
        share = f" ({100 * change.share:+.0f} %)" if math.isfinite(change.share) else ""
        risen = f"{change.cost:.5g}" if math.isfinite(change.cost) else "breaks down"
        times = f"{100 * (change.cost / result.cost - 1):+.3g} %" if math.isfinite(change.cost) and result.cost else ""
        limits = ", ".join(f"{text} exceeded" for text in change.exceeded) or ("kept" if change.limits else "")
        rows.append((f"{change.name} = {quantity(change.value, unit)}{share}", risen, times, limits))
    return terminal.table("around the best", ("one at a time", "cost", "change", "limits"), rows)


def _words(result: Tuned, robust: Robustness) -> Iterator[str]:
    from heavebond.estimation.diagram_files import quantity

    if len(result.cost_of_cases) > 1:
        yield f"the worst case is {robust.worst[0]}, cost {robust.worst[1]:.5g}"
    if robust.ellipse is not None:
        widths = ", ".join(f"{name} +-{quantity(width, result.task.free[name].unit)}"
                           for name, width in robust.ellipse.widths.items())
        yield f"the cost rises by less than 1 % within {widths}"


def _end_words(result: Tuned) -> Iterator[str]:
    from heavebond.estimation.diagram_files import quantity

    for name, end in result.at_end.items():
        wanted = result.task.free[name]
        yield f"{name} ended at the {end} end of its range, {quantity(result.values[name], wanted.unit)}: what is beyond " \
            "was not looked at"


def _boundary_words(result: Tuned) -> Iterator[str]:
    """How far the boundary of stability is along each free parameter."""
    turns = "unstable" if result.stability.stable else "stable"
    for name, pair in (result.stability.boundary or {}).items():
        factors = " and ".join(f"at {factor:.3g}" for factor in pair if factor is not None)
        yield f"{name}: " + (f"{factors} of its value the machine turns {turns}" if factors else
                             "no boundary of stability within a factor of 100")


def _files(asked: TuningRequest, result: Tuned, robust: Robustness | None, swept: tuple[list[Array], Array] | None,
           output: Path | None, written: Path | None, settings: Mapping[str, str]) -> list[Path]:
    from heavebond.commands import terminal

    files = []
    if output is not None and swept is not None:
        from heavebond.pictures.plot import plot_surface, save

        files.append(save(plot_surface(result.task, result, *swept, robust.ellipse if robust else None), output))
    if written is not None:
        from heavebond.estimation.diagram_files import write
        from heavebond.optimise.tuning import tuned_diagram

        write(written, tuned_diagram(asked.model, result.task, result, written, settings))
        files.append(written)
    for path in files:
        terminal.output().print(f"wrote {path}", soft_wrap=True)
    return files


def _figures(name: str, result: Tuned) -> dict[str, object]:
    return {"study": name, "values": result.values, "cost": result.cost, "before": result.before,
            "stability": asdict(result.stability), "at_end": result.at_end,
            "cases": result.cost_of_cases, "limits": result.limits, "runs": result.runs,
            "simulations": result.simulations, "message": result.message,
            "paths": [[{"values": s.values, "cost": s.cost} for s in path] for path in result.paths]}


def _robust_figures(robust: Robustness | None) -> Mapping[str, object] | None:
    if robust is None:
        return None
    return {"changes": [{"parameter": c.name, "value": c.value, "share": c.share, "cost": c.cost, "limits": dict(c.limits)}
                        for c in robust.changes],
            "damping": robust.damping, "margins": {m.name: {"down": m.down, "up": m.up} for m in robust.margins},
            "worst": {"case": robust.worst[0], "cost": robust.worst[1]},
            "ellipse": robust.ellipse.widths if robust.ellipse else None}
