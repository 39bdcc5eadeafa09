"""Results of a tuning as tables and lines, for the terminal and the studio."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict

from heavebond.linear.rest_stability import STABLE
from heavebond.linear.rest_stability import stability_sentences as stability_words
from heavebond.numerics.dae import Array, Assembly
from heavebond.optimise.objective import TuningProblem
from heavebond.optimise.robustness import Robustness
from heavebond.optimise.tuning import Tuned
from heavebond.reports.result_tables import Item, Line, ResultTable


def tuning_items(name: str, assembly: Assembly, result: Tuned, robust: Robustness | None,
                 swept: tuple[list[Array], Array] | None = None) -> list[Item]:
    """The tuned values, their cost, the limits, the stability, the robustness, and the best cost of a sweep."""
    before = f"before {result.before:.5g}" if math.isfinite(result.before) else "before: beyond the stability boundary"
    items: list[Item] = [
        _table(name, assembly, result.task, result),
        Line(f"cost {result.cost:.5g} ({before}), {result.runs} runs that cost {result.simulations:.0f} simulations: "
             f"{result.message}")]
    items += [Line(f"limit {text}: " + (f"exceeded by {100 * value:.3g} %" if value > 1e-4 else
                                        f"kept, {100 * -value:.3g} % to spare" if value < -1e-3 else "just kept"))
              for text, value in result.limits.items() if text != STABLE]
    if len(result.cost_of_cases) > 1:
        items.append(ResultTable("", ("case", "cost"), [(c, f"{cost:.5g}") for c, cost in result.cost_of_cases.items()]))
    stability = stability_words(result.stability, asked=result.task.stable is not False)
    items += [Line(line, "NOT STABLE" in line) for line in (*_end_words(result), *stability, *_boundary_words(result))]
    if robust is not None:
        items += [Line(""), _changes(assembly, result, robust), *map(Line, _words(result, robust))]
    if swept is not None:
        best = min(cost for cost in swept[1].ravel().tolist() if math.isfinite(cost))
        items.append(Line(f"best of the sweep of {swept[1].size} runs: {best:.5g}"))
    return items


def tuning_figures(name: str, result: Tuned, robust: Robustness | None) -> dict[str, object]:
    """The results as a dictionary for JSON."""
    return {**_figures(name, result), "robustness": _robust_figures(robust)}


def _table(name: str, assembly: Assembly, task: TuningProblem, result: Tuned) -> ResultTable:
    rows = [(parameter, wanted.unit.written(assembly.parameter_values[parameter]),
             wanted.unit.written(result.values[parameter]),
             f"{wanted.unit.written(wanted.low)} .. {wanted.unit.written(wanted.high)}")
            for parameter, wanted in task.free.items()]
    return ResultTable(name, ("parameter", "before", "tuned", "range"), rows)


def _changes(assembly: Assembly, result: Tuned, robust: Robustness) -> ResultTable:
    units = {q.name: q.unit for q in assembly.flat.parameters}
    rows = []
    for change in robust.changes:
        unit = result.task.free[change.name].unit if change.name in result.task.free else units[change.name]
        share = f" ({100 * change.share:+.0f} %)" if math.isfinite(change.share) else ""
        risen = f"{change.cost:.5g}" if math.isfinite(change.cost) else "breaks down"
        times = f"{100 * (change.cost / result.cost - 1):+.3g} %" if math.isfinite(change.cost) and result.cost else ""
        limits = ", ".join(f"{text} exceeded" for text in change.exceeded) or ("kept" if change.limits else "")
        rows.append((f"{change.name} = {unit.written(change.value)}{share}", risen, times, limits))
    return ResultTable("around the best", ("one at a time", "cost", "change", "limits"), rows)


def _words(result: Tuned, robust: Robustness) -> Iterator[str]:
    if len(result.cost_of_cases) > 1:
        yield f"the worst case is {robust.worst[0]}, cost {robust.worst[1]:.5g}"
    if robust.ellipse is not None:
        widths = ", ".join(f"{name} +-{result.task.free[name].unit.written(width)}"
                           for name, width in robust.ellipse.widths.items())
        yield f"the cost rises by less than 1 % within {widths}"


def _end_words(result: Tuned) -> Iterator[str]:
    for name, end in result.at_end.items():
        wanted = result.task.free[name]
        yield f"{name} ended at the {end} end of its range, {wanted.unit.written(result.values[name])}: what is beyond " \
            "was not looked at"


def _boundary_words(result: Tuned) -> Iterator[str]:
    """Sentences on the distance to the stability boundary along each free parameter."""
    turns = "unstable" if result.stability.stable else "stable"
    for name, pair in (result.stability.boundary or {}).items():
        factors = " and ".join(f"at {factor:.3g}" for factor in pair if factor is not None)
        yield f"{name}: " + (f"{factors} of its value the machine turns {turns}" if factors else
                             "no boundary of stability within a factor of 100")


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
