"""Tuning of parameters by minimisation of a cost with exact gradients: bounds, limits, several cases, several starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from heavebond.core import facade
from heavebond.core.cancellation import ENDED_EARLY, finishing
from heavebond.core.errors import HeavebondError, Problem, UsageError, suggest
from heavebond.core.presentation import brief
from heavebond.core.progress import Progress, numbered
from heavebond.core.reporting import reporting
from heavebond.language.edits import block, extended_from, quoted
from heavebond.language.model import Model, ModelOrFile
from heavebond.linear.floquet import FLOQUET, largest_multiplier
from heavebond.linear.held_variables import held_lines
from heavebond.linear.rest_stability import Stability, crossing, describe
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.optimise.objective import OBJECTIVE, Evaluation, Objective, TuningProblem
from heavebond.optimise.search import METHODS, SEARCH, SearchResult, search

# Number of points drawn from the hypercube for each that is run: points beyond the stability boundary of the linearised
# machine are skipped.
DRAWN = 4
# Largest excess cost, relative to the best, of a point at the stability boundary from which another search is started.
PROMISING = 0.15
# Distance of such a point from the boundary, and distance from a bound within which a value is at it, as shares of a range.
INSIDE, AT_END = 0.005, 1e-3


@dataclass(frozen=True)
class TuningEvaluation:
    """One evaluation of the search: the values in SI and the cost."""

    values: dict[str, float]
    cost: float


@dataclass(frozen=True)
class Tuned(facade.Displayed):
    """The result of a tuning: the best `values` in SI, their `cost` and the cost `before`, without unit.

    `limits` are negative if satisfied (relative); `paths` are the evaluations of every start. `simulations` counts a run
    with k sensitivities as 1 + k plain runs, and the gradients of k costs by an adjoint run as 2 + k/2. `stability`
    contains the margins of the best values; `at_end` the parameters at the lower or the upper end of their range, `notes`
    the jumps of laws in the best runs, which gradients lack, and the limits that their largest values exceed.
    """

    task: TuningProblem
    values: dict[str, float]
    cost: float
    before: float
    cost_of_cases: dict[str, float]
    limits: dict[str, float]
    paths: tuple[tuple[TuningEvaluation, ...], ...]
    runs: int
    simulations: float
    message: str
    stability: Stability
    at_end: dict[str, str]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return brief(self, f"cost {self.cost:.5g}", f"before {self.before:.5g}; {self.message}",
                     ", ".join(f"{name} = {value:.5g}" for name, value in self.values.items()))


@reporting
def tune(model: ModelOrFile | Assembly | Objective, task: TuningProblem, *, explore: int = 5, starts: int = 1, seed: int = 0,
         method: str = "trust", most_steps: int = 30, progress: Progress | None = None,
         partial: bool = False) -> Tuned:
    """Minimise the cost of a tuning problem over its free parameters, within their ranges and limits.

    `model` is a diagram, an Assembly or an existing Objective; `task` comes from `tuning_task` or a study. The diagram's
    values and `explore` points of a Latin hypercube (drawn with `seed`) are simulated without gradients, because the
    gradient of the cost beyond the stability boundary is useless. A search with exact gradients continues from the best
    `starts` of them for at most `most_steps` steps; `method` is trust or ipopt (see `heavebond.optimise.search`). Values
    of the result are in SI. `progress` is called with a text at each step. With `partial` Ctrl-C returns the best result
    so far (`message` is "interrupted"), after the first run. Raises UsageError for mistakes in the task.
    """
    if method not in METHODS:
        raise UsageError([Problem("method-unknown", f"'{method}' is not a tuning method", None,
                                  suggest(method, METHODS) or f"Methods: {', '.join(METHODS)}.")])
    problem = model if isinstance(model, Objective) else \
        Objective(assemble(model), task)
    say = progress or (lambda text: None)
    results: list[SearchResult] = []
    for k, first in enumerate(starting_points(problem, explore, starts, seed, say), 1):
        results.append(search(problem, first, method, most_steps, numbered(say, "start", k, starts), results,
                              partial))
        if results[-1].message == ENDED_EARLY:
            return _tuned(problem, task, results, min(results, key=_rank), ENDED_EARLY, say)
    # points at the stability boundary along each free parameter whose cost is little above the result
    result = min(results, key=_rank)
    points = []
    for k, name in enumerate(problem.names):
        for end in (0.0, 1.0):
            at = limit_of_stability(problem, result.best.at, k, end)
            if at is None or abs(at - result.best.at[k]) < SEARCH.same_optimum:
                continue
            point = result.best.at.copy()
            point[k] = at - INSIDE * np.sign(at - point[k]) if problem.stable else at
            say(f"looking at the stability boundary of {name}")
            if problem.plain(point).feasible and problem.cost(point) < result.best.cost + PROMISING * abs(result.best.cost):
                points.append(point)
    for first in points:
        results.append(search(problem, first, method, most_steps, say, results, partial))
    best = min(results, key=_rank)
    if problem.stable:
        problem.follow(problem.values(best.best.at))  # stability over the motion with the best gains
        if problem.instability(best.best.at) > OBJECTIVE.limit_tolerance:
            results.append(best := search(problem, best.best.at, method, most_steps, say, partial=partial))
    early = any(f.message == ENDED_EARLY for f in results)
    return _tuned(problem, task, results, best, ENDED_EARLY if early else best.message, say)


def _tuned(problem: Objective, task: TuningProblem, results: Sequence[SearchResult], best: SearchResult, message: str,
           say: Progress) -> Tuned:
    """The result of the best of all searches, with its stability margins."""
    limits = dict(zip(problem.limits, best.best.limits.tolist(), strict=True))
    values = problem.values(best.best.at)
    notes = dict.fromkeys([*(note for case in problem.cases for note in case.jump_notes(values)),
                           *problem.peak_notes(values)]) if best.best.feasible else ()
    say("margins of stability")
    with finishing(say):
        return Tuned(task, values, best.best.cost, _before(problem), dict(best.best.cases),
                     limits, tuple(tuple(TuningEvaluation(problem.values(e.at), e.cost) for e in f.path) for f in results),
                     problem.runs, problem.simulations, message,
                     stability_of(problem, values), ends(problem, values, {}), tuple(notes))


def stability_of(problem: Objective, values: Mapping[str, float]) -> Stability:
    """The margins of stability at values of the free parameters (SI): of the equilibrium, else of the periodic run."""
    held = tuple(held_lines(problem.held))
    if problem.undecided:
        return Stability("", None, undecided=problem.undecided, held=held)
    try:
        problem.follow(values)
        worst = problem.at_rest(values)
    except HeavebondError:
        return Stability("", None, held=held)
    if worst is None:
        # stability by the largest Floquet multiplier of the runs of all cases; undecided if a run is not periodic
        multipliers = {case.case.name: largest_multiplier(case.plain.assembly.with_parameters(dict(values)),
                                                          float(problem.times[-1]))
                       for case in problem.cases}
        known = {name: size for name, size in multipliers.items() if size is not None}
        if len(known) < len(multipliers):
            return Stability("", None, held=held)
        largest = max(known, key=lambda name: known[name])
        stable = None if abs(known[largest] - 1) <= FLOQUET.decided else known[largest] < 1
        return Stability("periodic run", stable, case=largest, multiplier=known[largest], held=held)
    case, machine, rest_point = worst

    def score(name: str, factor: float) -> float:
        try:
            at_factor = problem.at_rest({**values, name: factor * values[name]})
        except HeavebondError:
            return np.nan
        return at_factor[2].worst if at_factor is not None else np.nan

    boundary = {name: (crossing(partial(score, name), False), crossing(partial(score, name), True))
                for name in values if values[name]}
    return replace(describe(machine, rest_point, case.name, list(values), values, boundary), held=held)


def ends(problem: Objective, values: Mapping[str, float], swept: Mapping[str, Sequence[float]]) -> dict[str, str]:
    """The parameters that are at the lower or the upper bound of their range or of the values of a sweep."""
    bounds_reached = {}
    for name, low, span in zip(problem.names, problem.low, problem.span, strict=True):
        numbers = swept.get(name, ())
        least, most = (max(low, min(numbers)), min(low + span, max(numbers))) if numbers else (low, low + span)
        if values[name] <= least + AT_END * span:
            bounds_reached[name] = "lower"
        elif values[name] >= most - AT_END * span:
            bounds_reached[name] = "upper"
    return bounds_reached


def sweep_in_turn(problem: Objective, begin: Mapping[str, float | str], sweeps: Sequence[tuple[str, Sequence[float]]], *,
                  progress: Progress | None = None) -> Tuned:
    """Coordinate search: sweep one parameter after the other over values (SI), with the former ones at their best. The
    other free parameters are at `begin`, else at the diagram's values. A failed run has infinite cost.
    """
    values = {name: problem.assembly.with_parameters(begin).parameter_values[name] for name in problem.names}
    steps: list[tuple[TuningEvaluation, Evaluation]] = []
    for name, numbers in sweeps:
        for k, number in enumerate(numbers, 1):
            if progress:
                progress(f"{name}, {k} of {len(numbers)}")
            best_evaluation = problem.at({**values, name: number})
            steps.append((TuningEvaluation({**values, name: float(number)}, best_evaluation.cost), best_evaluation))
        values = min(steps[-len(numbers):], key=lambda pair: (not pair[1].feasible, pair[1].cost))[0].values
    best, best_evaluation = min(steps, key=lambda pair: (not pair[1].feasible, pair[1].cost))
    runs, simulations = problem.runs, problem.simulations
    limits = dict(zip(problem.limits, best_evaluation.limits.tolist(), strict=True))
    return Tuned(problem.task, best.values, best.cost, _before(problem), dict(best_evaluation.cases), limits,
                 (tuple(step for step, _ in steps),), runs, simulations, "swept", stability_of(problem, best.values),
                 ends(problem, best.values, dict(sweeps)),
                 tuple(problem.peak_notes(best.values)) if best_evaluation.feasible else ())


def _rank(result: SearchResult) -> tuple[bool, float]:
    return not result.best.feasible, result.best.cost


def limit_of_stability(problem: Objective, y: Array, k: int, end: float) -> float | None:
    """The share of the k-th unknown, between its value and `end`, at which the linearised machine becomes unstable (or
    stable), with the others fixed; None if there is no change. If stability is a limit of the task, its measure is
    used."""
    from scipy.optimize import brentq

    def growth(share: float) -> float:
        point = y.copy()
        point[k] = share
        return problem.instability(point) if problem.stable else problem.growth(point)

    first, last = growth(float(y[k])), growth(end)
    if not (np.isfinite(first) and np.isfinite(last)) or (first < 0) == (last < 0):
        return None
    return float(brentq(growth, float(y[k]), end, xtol=2e-3))


def _before(problem: Objective) -> float:
    """The cost of the diagram's values, infinite beyond the stability boundary (where runs are long)."""
    return problem.cost(problem.start) if problem.calm(problem.start) else np.inf


def starting_points(problem: Objective, explore: int, starts: int, seed: int, say: Progress) -> list[Array]:
    """The best `starts` of the diagram's values and `explore` points of a Latin hypercube, best first.

    If the linearised machine is stable at some points only, only these are run.
    """
    drawn = problem.spread(DRAWN * explore, seed)
    points = list(islice((y for y in drawn if problem.calm(y) and problem.instability(y) <= 0), 1 + explore)
                  ) if explore else []
    evaluations: list[Evaluation] = []
    for k, point in enumerate(points or islice(problem.spread(explore, seed), 1 + explore), 1):
        say(f"exploring {k} of {1 + explore}")
        evaluations.append(problem.plain(point))
    order = sorted(evaluations, key=lambda e: (not np.isfinite(e.cost), not e.feasible, e.cost))
    return [e.at for e in order[:max(1, starts)]]


def sweep(problem: Objective, numbers: Sequence[int], *, progress: Progress | None = None) -> tuple[list[Array], Array]:
    """The cost on a grid over the ranges, without gradients: axes in SI and costs (numbers[0], numbers[1], ...), infinite
    for a failed run."""
    axes = [np.linspace(0, 1, n) for n in numbers]
    costs = np.empty([len(a) for a in axes])
    for k, index in enumerate(np.ndindex(*costs.shape), 1):
        if progress:
            progress(f"{k} of {costs.size}")
        costs[index] = problem.cost(np.array([axis[i] for axis, i in zip(axes, index, strict=True)]))
    return [problem.low[k] + axis * problem.span[k] for k, axis in enumerate(axes)], costs


def tuned_diagram(model: Model, task: TuningProblem, result: Tuned, path: Path, settings: Mapping[str, str]) -> str:
    """The text of a diagram at `path` that extends the tuned one and sets the best values, after those in `settings`."""
    tuned = {name: task.free[name].unit.written(value) for name, value in result.values.items()}
    values = {**{name: quoted(text) for name, text in settings.items()}, **tuned}
    head = [f"model: {path.stem}",
            f"summary: {model.name}, tuned to a cost of {result.cost:.5g}.",
            f"extends: {extended_from(path, model.path)}"]
    return "\n".join([*head, *block("set", values)]) + "\n"
