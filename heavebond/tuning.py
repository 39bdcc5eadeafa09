"""Gains that make a cost small, by exact gradients: bounds, limits, several cases, several starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from heavebond.adjoint import Adjoint
from heavebond.costs import Evaluator, Functional, read_cost, read_limit
from heavebond.dae import Array, Assembly, assemble
from heavebond.errors import Problem, SimulationError, StartError, UsageError, suggest
from heavebond.model import Model
from heavebond.result import Result, columns
from heavebond.simulation import Simulator, Tolerances, grid
from heavebond.symbols import stack
from heavebond.units import Range, UnitProblem, parse_range

Progress = Callable[[str], None]
# The quality index of the reference runs is seen to about 1e-6 at these; tighter only costs time.
TOLERANCES = Tolerances(1e-6, 1e-8)
POINTS_FOR_SIZES = 400
# A run that cannot be finished costs this many times the cost of the diagram's own values.
BROKEN = 1e3
# The search ends where a step gains less than this share of the cost: runs at the tolerances above are no smoother.
SETTLED = 1e-4
# A limit counts as kept where it is exceeded by less than this, in the unit of its right side.
KEPT = 1e-4


@dataclass(frozen=True)
class Case:
    """One condition of operation: values set beside the free ones (a sea state, a load), and its weight."""

    name: str
    settings: Mapping[str, float | str]
    weight: float = 1.0


@dataclass(frozen=True)
class Task:
    """What to tune: free parameters with ranges, a cost, limits (`peak(extension) < 3 m`), the time that is evaluated,
    the values that make the reference run, and the cases over which the cost is averaged."""

    free: Mapping[str, Range]
    cost: str
    limits: tuple[str, ...] = ()
    begin: float = 0.0
    end: float | None = None
    reference: Mapping[str, float | str] | None = None
    cases: tuple[Case, ...] = (Case("diagram", {}),)


@dataclass(frozen=True)
class Step:
    """One evaluation on the way: the values in SI and the cost."""

    values: dict[str, float]
    cost: float


@dataclass(frozen=True)
class Tuned:
    """The best values in SI, their cost, the cost per case, the limits (below zero where kept, relative), the path of
    every start, and how much was computed: `simulations` counts a run with k sensitivities as 1 + k plain runs, and the
    gradients of k costs by a run backwards as 2 + k/2."""

    task: Task
    values: dict[str, float]
    cost: float
    before: float
    cost_of_cases: dict[str, float]
    limits: dict[str, float]
    paths: tuple[tuple[Step, ...], ...]
    runs: int
    simulations: float
    message: str


def ranges(texts: Mapping[str, str]) -> dict[str, Range]:
    """`{"controller.K_p": "0 .. 10 1/m"}` as ranges; UsageError for a text that is none."""
    found = {}
    for name, text in texts.items():
        try:
            found[name] = parse_range(text)
        except UnitProblem as problem:
            raise UsageError([Problem(problem.code, f"{name}: {problem.message}", None, problem.hint)]) from None
    return found


def tune(model: Model | Assembly, task: Task, *, explore: int = 10, starts: int = 1, seed: int = 0,
         most_steps: int = 30, progress: Progress | None = None) -> Tuned:
    """Minimise the cost over the free parameters within their ranges and limits.

    First the diagram's own values and `explore` points of a Latin hypercube are run without gradients: a gain beyond the
    limit of stability has a cost whose slope leads nowhere. From the best `starts` of these, sequential least squares
    programming (Kraft 1988, as in SciPy) goes on with gradients from forward sensitivities, or from runs backwards where
    much is free. UsageError for what is wrong in the task.
    """
    problem = Objective(model if isinstance(model, Assembly) else assemble(model), task)
    say = progress or (lambda text: None)
    paths, ends = [], []
    for number, first in enumerate(problem.starting_points(explore, starts, seed, say), 1):
        found, path = _minimise(problem, first, most_steps, _numbered(say, number, starts))
        paths.append(tuple(path))
        ends.append(found)
    kept = [e for e in ends if all(v <= KEPT for v in e.limits.values())] or ends
    best = min(kept, key=lambda e: e.cost)
    before = problem.evaluate(problem.start)
    return Tuned(task, problem.values(best.at), best.cost, before.cost, best.cases, best.limits, tuple(paths),
                 problem.runs, problem.simulations, best.message)


def _numbered(say: Progress, number: int, starts: int) -> Progress:
    return lambda text: say(f"start {number} of {starts}: {text}" if starts > 1 else text)


@dataclass(frozen=True)
class Evaluation:
    """The cost and the limits at one point, with gradients in the unknowns of the search (shares of the ranges)."""

    at: Array
    cost: float
    gradient: Array
    limits: dict[str, float]
    limit_gradients: Array
    cases: dict[str, float]
    message: str = ""


class Objective:
    """The cost of a task as a function of y in [0, 1]^m, the free parameters as shares of their ranges."""

    def __init__(self, assembly: Assembly, task: Task):
        self.assembly, self.task = assembly, task
        self.names = list(task.free)
        self._check_free()
        self.low = np.array([task.free[n].low for n in self.names])
        self.span = np.array([task.free[n].high - task.free[n].low for n in self.names])
        end = task.end if task.end is not None else float(grid(assembly.model, None, None)[-1])
        if not 0 <= task.begin < end:
            raise UsageError([Problem("evaluate-empty", f"nothing lies between {task.begin:g} s and {end:g} s", None,
                                      "Evaluate from an earlier time, or simulate longer.")])
        self.times = np.unique([0.0, task.begin, end])
        self.costs = [read_cost(assembly, task.cost), *(read_limit(assembly, t) for t in task.limits)]
        # Measured on the compensator, the gradients of k costs by a run backwards take as long as 2 + k/2 plain runs, a run
        # with m sensitivities as long as 1.3 + 0.5 m. The way back begins anew at every break of a measured input, which
        # costs more than it saves.
        self.backwards = len(self.names) > len(self.costs) + 2 and not assembly.flat.inputs
        self.runs, self.simulations = 0, 0.0
        self.cases = [self._case(case, end) for case in task.cases]
        self._seen: dict[bytes, Evaluation] = {}
        self._plain: dict[bytes, list[float]] = {}

    def _check_free(self) -> None:
        if not self.names:
            raise UsageError([Problem("free-empty", "nothing is free to be tuned", None,
                                      "Name parameters and ranges: --free controller.K_p='0 .. 10 1/m'.")])
        units = {q.name: q.unit for q in self.assembly.flat.parameters}
        for name, wanted in self.task.free.items():
            if name not in units:
                raise UsageError([Problem("free-unknown", f"'{name}' is no parameter that may be free", None,
                                          suggest(name, units))])
            if units[name].dimension != wanted.unit.dimension:
                raise UsageError([Problem("unit-wrong", f"the range of {name} is in {wanted.unit.text}; "
                                          f"{units[name].text} is needed")])
            value = self.assembly.parameter_values[name]
            if not wanted.low <= value <= wanted.high:
                raise UsageError([Problem("free-start-outside", f"{name} is {value:g} {units[name].text} in the diagram, "
                                          "outside its range", None, "Widen the range, or --set another value.")])

    def _case(self, case: Case, end: float) -> _Case:
        assembly = self.assembly.with_parameters(dict(case.settings))
        reference = assembly.with_parameters(dict(self.task.reference or {}))
        functionals = [f for cost in self.costs for f in cost.functionals]
        sizes = np.zeros(len(functionals))
        if any(f.kind == "peak" for f in functionals):
            times = np.linspace(0, end, POINTS_FOR_SIZES)
            run = Simulator(assembly, times=times, tolerances=TOLERANCES).run()
            self._count(1)
            sizes = _largest(functionals, run, self.task.begin)
        evaluator = Evaluator(assembly, self.costs, sizes, end - self.task.begin)
        references = np.zeros(len(functionals))
        if any(any(cost.references) for cost in self.costs):
            run = Simulator(reference, times=self.times, tolerances=TOLERANCES, quadratures=evaluator.quadratures).run()
            self._count(1)
            references = evaluator.functional_values(run)[0]
        return _Case(case, assembly, self.times, evaluator, references, self.names, self.backwards)

    def _count(self, simulations: float) -> None:
        self.runs += 1
        self.simulations += simulations

    @property
    def start(self) -> Array:
        """The diagram's own values."""
        values = self.assembly.parameter_values
        return np.asarray((np.array([values[n] for n in self.names]) - self.low) / self.span)

    def values(self, y: Array) -> dict[str, float]:
        """The parameters in SI."""
        return dict(zip(self.names, (self.low + np.clip(y, 0, 1) * self.span).tolist(), strict=True))

    def starting_points(self, explore: int, starts: int, seed: int, say: Progress) -> list[Array]:
        """The best `starts` of the diagram's values and `explore` points of a Latin hypercube."""
        from scipy.stats import qmc

        points = [self.start]
        if explore:
            points += list(qmc.LatinHypercube(len(self.names), seed=seed).random(explore))
        costs = []
        for number, point in enumerate(points, 1):
            say(f"exploring {number} of {len(points)}")
            costs.append(self.cost(point))
        order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))
        return [points[k] for k in order[: max(1, starts)]]

    def cost(self, y: Array) -> float:
        """The cost alone, from plain runs; NaN where one breaks down."""
        return self.plain(y)[0]

    def plain(self, y: Array) -> list[float]:
        """The cost and the limits without gradients, from plain runs; NaN where one breaks down."""
        key = _key(y)
        if key in self._seen:
            return [self._seen[key].cost, *self._seen[key].limits.values()]
        if key not in self._plain:
            self._plain[key] = self._plain_costs(y)
        return self._plain[key]

    def _plain_costs(self, y: Array) -> list[float]:
        found = []
        for case in self.cases:
            self._count(1)
            try:
                run = case.run(self.values(y))
            except (SimulationError, StartError):
                return [float("nan")] * len(self.costs)
            values, slopes = case.evaluator.functional_values(run)
            costs = case.evaluator.cost_values(values, slopes, case.references, run.p, np.zeros((0, len(run.p))))
            found.append([value for value, _ in costs])
        weights = np.array([c.case.weight for c in self.cases])
        return [float(weights @ [f[0] for f in found] / weights.sum()),
                *(max(f[k] for f in found) for k in range(1, len(self.costs)))]

    def evaluate(self, y: Array) -> Evaluation:
        """Cost, limits and gradients at y; the mean over the cases, the worst case for limits. A run that breaks down
        has a large cost and no slope."""
        key = _key(y)
        if key not in self._seen:
            self._seen[key] = self._evaluate(y)
        return self._seen[key]

    def _evaluate(self, y: Array) -> Evaluation:
        weights = np.array([c.case.weight for c in self.cases])
        weights = weights / weights.sum()
        found = []
        for case in self.cases:
            self._count(2 + len(self.costs) / 2 if self.backwards else 1 + len(self.names))
            try:
                found.append([(value, gradient * self.span) for value, gradient in case.costs(self.values(y))])
            except (SimulationError, StartError) as error:
                return Evaluation(y, self.broken(), np.zeros(len(y)), dict.fromkeys(self.task.limits, 1.0),
                                  np.zeros((len(self.task.limits), len(y))), {case.case.name: np.inf}, str(error))
        cost = sum(w * f[0][0] for w, f in zip(weights, found, strict=True))
        gradient = sum((w * f[0][1] for w, f in zip(weights, found, strict=True)), np.zeros(len(y)))
        limits, slopes = {}, []
        for k, text in enumerate(self.task.limits, 1):
            worst = max(found, key=lambda f: f[k][0])
            limits[text] = worst[k][0]
            slopes.append(worst[k][1])
        return Evaluation(y, float(cost), gradient, limits, np.array(slopes).reshape(len(limits), len(y)),
                          {c.case.name: f[0][0] for c, f in zip(self.cases, found, strict=True)})

    def broken(self) -> float:
        """The cost of a run that breaks down: far above any that ends."""
        finite = [abs(e.cost) for e in self._seen.values() if np.isfinite(e.cost)]
        return BROKEN * max([1.0, *finite[:1]])


def _key(y: Array) -> bytes:
    return np.round(y, 12).tobytes()


class _Case:
    """A case ready to run; keeps its last run, whose gradient is mostly what is wanted next."""

    def __init__(self, case: Case, assembly: Assembly, times: Array, evaluator: Evaluator, references: Array,
                 names: list[str], backwards: bool):
        self.case, self.evaluator, self.references, self.names = case, evaluator, references, names
        self.plain = Simulator(assembly, times=times, tolerances=TOLERANCES, quadratures=evaluator.quadratures)
        self.adjoint = Adjoint(self.plain, evaluator, names) if backwards else None
        self._last: tuple[dict[str, float], Result] | None = None

    @cached_property
    def forward(self) -> Simulator:
        """With the sensitivities to all free parameters."""
        plain = self.plain
        return Simulator(plain.assembly, times=plain.time, tolerances=TOLERANCES, quadratures=self.evaluator.quadratures,
                         sensitivities=self.names)

    def run(self, values: dict[str, float]) -> Result:
        """The plain run."""
        if self._last is None or self._last[0] != values:
            self._last = values, self.plain.run(values)
        return self._last[1]

    def costs(self, values: dict[str, float]) -> list[tuple[float, Array]]:
        """Cost and limits with their gradients; forward where the run backwards breaks down."""
        if self.adjoint is not None:
            run = self.run(values)
            with suppress(SimulationError):
                return self.adjoint.costs(run, self.references)
        result = self.forward.run(values)
        assert result.along is not None
        numbers, slopes = self.evaluator.functional_values(result)
        return self.evaluator.cost_values(numbers, slopes, self.references, result.p, result.along.p)


def _largest(functionals: Sequence[Functional], run: Result, begin: float) -> Array:
    """The largest |signal| of each functional in a run after `begin`."""
    signals = stack([f.signal for f in functionals])
    values = np.array(ca.Function("sizes", list(run.assembly.arguments), [signals])(*columns(run)))
    return np.asarray(np.abs(values.reshape(len(functionals), -1)[:, run.time >= begin]).max(axis=1))


@dataclass(frozen=True)
class _End:
    at: Array
    cost: float
    cases: dict[str, float]
    limits: dict[str, float]
    message: str


def _minimise(problem: Objective, first: Array, most_steps: int, say: Progress) -> tuple[_End, list[Step]]:
    from scipy.optimize import minimize

    path: list[Step] = []
    points: list[Array] = []

    def cost(y: Array) -> float:
        # a trial of the line search is a plain run; only the points that are kept get a gradient
        value = problem.plain(np.clip(y, 0, 1))[0]
        points.append(np.clip(y, 0, 1))
        path.append(Step(problem.values(y), value))
        say(f"cost {np.nanmin([s.cost for s in path]):.5g} after {len(path)} evaluations")
        return value if np.isfinite(value) else problem.broken()

    def gradient(y: Array) -> Array:
        return problem.evaluate(np.clip(y, 0, 1)).gradient

    constraints: Any = [_constraint(problem, k) for k in range(len(problem.task.limits))]
    found = minimize(cost, first, jac=gradient, method="SLSQP", bounds=[(0.0, 1.0)] * len(first),
                     constraints=constraints,
                     options={"maxiter": most_steps, "ftol": SETTLED * abs(problem.plain(first)[0])})

    def rank(y: Array) -> tuple[bool, float]:
        values = problem.plain(y)
        return (not all(v <= KEPT for v in values[1:]), values[0] if np.isfinite(values[0]) else np.inf)

    best = problem.evaluate(min(points, key=rank))
    return _End(best.at, best.cost, best.cases, best.limits, str(found.message)), path


def _constraint(problem: Objective, k: int) -> dict[str, Any]:
    return {"type": "ineq", "fun": lambda y: -problem.plain(np.clip(y, 0, 1))[1 + k],
            "jac": lambda y: -problem.evaluate(np.clip(y, 0, 1)).limit_gradients[k]}


def sweep(problem: Objective, numbers: Sequence[int], *, progress: Progress | None = None) -> tuple[list[Array], Array]:
    """The cost on a grid over the ranges, without gradients: axes in SI and costs (numbers[0], numbers[1], ...), NaN
    where a run broke down."""
    axes = [np.linspace(0, 1, n) for n in numbers]
    costs = np.empty([len(a) for a in axes])
    for k, index in enumerate(np.ndindex(*costs.shape), 1):
        if progress:
            progress(f"{k} of {costs.size}")
        costs[index] = problem.cost(np.array([axis[i] for axis, i in zip(axes, index, strict=True)]))
    return [problem.low[k] + axis * problem.span[k] for k, axis in enumerate(axes)], costs
