"""Objective of a tuning: cost and limits as functions of the free parameters, with gradients."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from heavebond.core.errors import HeavebondError, ModelError, Problem, SimulationError, StartError, UsageError
from heavebond.core.quantities import ranges
from heavebond.core.units import Range
from heavebond.equations.parameters import check_ranges
from heavebond.linear.describing_function import slopes_over
from heavebond.linear.held_variables import HeldVariable, check_decided, undecided_reasons
from heavebond.linear.linearisation import ModesAtStart
from heavebond.linear.rest_stability import STABLE, OperatingPointStability, RestStability
from heavebond.numerics.dae import Array, Assembly, at_zero
from heavebond.numerics.forcing import Forcing
from heavebond.numerics.kinks import jump_notes
from heavebond.numerics.output_times import Time, grid, seconds
from heavebond.numerics.result import Result
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.optimise.adjoint import CHARTS, Adjoint
from heavebond.optimise.cost_evaluation import Evaluator
from heavebond.optimise.costs import Cost, read_cost, read_limit
from heavebond.optimise.sampled_values import SAMPLED

# The quality index of the reference runs is accurate to about 1e-6 at these; tighter ones only cost time.
TOLERANCES = Tolerances(1e-6, 1e-8)


@dataclass(frozen=True)
class ObjectiveConstants:
    """The constants of the objective of a tuning: sizes, gradients, the guard of stability.

    forward_up_to: parameters up to which forward sensitivities cost less than an adjoint run. Origin: measured, k costs
    backwards take 2 + k/2 plain runs, m sensitivities 1.3 + 0.25 m. Doubled: tunings of 6 to 10 parameters take longer, with
    the same result.
    size_points: points of a run from which the sizes of signals are taken. Origin: a period has some twenty. Doubled:
    nothing measurable.
    curvature_points: points for the estimate of the curvature. Origin: as above. Doubled: a better first step, some time.
    slope_points: points at which signals of gradients are stored. Origin: as above. Doubled: memory.
    stable_draws: points drawn in search of a stable one if the diagram's is unstable. Origin: finds a stable tenth of the
    ranges with a chance of 88 %. Doubled: seconds more before the refusal.
    resize: factor of growth or decay at which a signal gets a new size. Origin: a high power of a signal overflows or
    vanishes beyond. Doubled: a less exact peak.
    max_growth: exponent of growth of a mode in a run that decides its cost, exp(3) = 20. Origin: slower modes may be stopped
    by friction. Doubled: unstable points are evaluated.
    limit_tolerance: share of its right side by which a limit may be exceeded. Origin: errors of runs. Doubled: larger
    excesses.
    peak_tolerance: share of its right side by which the largest value may exceed a limit that `peak` keeps. Origin: both
    differ by as much for a periodic motion. Doubled: larger excesses are silent.
    at_boundary: damping ratio from the stability boundary within which it restricts a search. Origin: 2.5 times the
    damping ratio that a search keeps. Doubled: reported more often.
    """

    forward_up_to: int = 5
    size_points: int = 400
    curvature_points: int = 200
    slope_points: int = 2000
    stable_draws: int = 20
    resize: float = 3.0
    max_growth: float = 3.0
    limit_tolerance: float = 1e-4
    peak_tolerance: float = 0.01
    at_boundary: float = 5e-4


OBJECTIVE = ObjectiveConstants()


@dataclass(frozen=True)
class Case:
    """One condition of operation: values set in addition to the free ones (a sea state, a load), and its weight."""

    name: str
    settings: Mapping[str, float | str]
    weight: float = 1.0


@dataclass(frozen=True)
class TuningProblem:
    """A tuning problem: free parameters with their ranges in SI, a cost, and limits (`peak(extension) < 3 m`).

    `begin` and `end` are the time interval of the evaluation in s, `reference` the values of the reference run, `cases`
    the conditions over which the cost is averaged, `modes` the values for the computation of modes, `uncertain` the
    tolerances of other parameters; `stable` requires a stable equilibrium, None if that can be decided. `tuning_task`
    makes one from text.
    """

    free: Mapping[str, Range]
    cost: str
    limits: tuple[str, ...] = ()
    begin: float | None = None
    end: float | None = None
    reference: Mapping[str, float | str] | None = None
    cases: tuple[Case, ...] = (Case("diagram", {}),)
    modes: Mapping[str, float | str] = field(default_factory=dict)
    uncertain: Mapping[str, str] = field(default_factory=dict)
    stable: bool | None = None


def tuning_task(free: Mapping[str, Range | str], cost: str, *, limits: Sequence[str] = (), begin: Time | None = None,
                end: Time | None = None, reference: Mapping[str, float | str] | None = None,
                cases: Mapping[str, Mapping[str, float | str]] | None = None, stable: bool | None = None) -> TuningProblem:
    """A tuning problem for `tune`: minimise `cost` over the ranges of `free`, such that `limits` hold.

    `tuning_task({"controller.K_p": "0 .. 10 1/m"}, "rms(WOB)/1 kN", limits=["peak(extension) < 3 m"], begin="48 s")`.

    The cost is evaluated from `begin` to `end` (s, or text with a unit; by default from the start to the end of the run)
    and averaged over `cases`, parameter values by name of the case. `reference` are the parameter values of the run for
    `ref(...)` in the cost. `stable` requires a stable equilibrium: True in any case, None if that can be decided (not
    with samples in a loop). Raises UsageError for a range or a time that cannot be read; `tune` raises it for unknown
    names and wrong units, and if `stable` is True and cannot be decided.
    """
    case_list = (Case("diagram", {}),) if cases is None else tuple(Case(name, dict(values))
                                                                   for name, values in cases.items())
    return TuningProblem(ranges(free), cost, tuple(limits), None if begin is None else seconds(begin, "begin"),
                         None if end is None else seconds(end, "end"), reference, case_list, stable=stable)


@dataclass(frozen=True)
class Evaluation:
    """The cost, the limits (satisfied if not above zero) and the cost of each case at one point; with gradients in the
    unknowns of the search (shares of the ranges) if requested, and with sensitivities the Gauss-Newton curvature of
    the cost. A failed run has an infinite cost."""

    at: Array
    cost: float
    limits: Array
    cases: Mapping[str, float]
    gradient: Array | None = None
    limit_gradients: Array | None = None
    curvature: Array | None = None

    @property
    def feasible(self) -> bool:
        """True if the run ends and satisfies the limits."""
        return bool(np.isfinite(self.cost) and (self.limits <= OBJECTIVE.limit_tolerance).all())


class Objective:
    """The cost of a task as a function of y in [0, 1]^m, the free parameters as shares of their ranges."""

    def __init__(self, assembly: Assembly, task: TuningProblem):
        varied = [task.free, task.reference or {}, task.modes, task.uncertain, *(case.settings for case in task.cases)]
        self.assembly, self.task = (assembly := at_zero(assembly, [name for names in varied for name in names])), task
        self.begin = assembly.begin if task.begin is None else task.begin  # time interval of the evaluation
        self.names = list(task.free)
        check_free(assembly, task)
        self.low = np.array([task.free[n].low for n in self.names])
        self.span = np.array([task.free[n].high - task.free[n].low for n in self.names])
        end = task.end if task.end is not None else float(grid(assembly.model, None, None)[-1])
        first, begin = assembly.begin, self.begin
        if not first <= begin < end:
            raise UsageError([Problem("evaluate-empty", f"nothing lies between {begin:g} s and {end:g} s", None,
                                      "Evaluate from an earlier time, or simulate longer.")])
        self.times = np.unique([first, begin, end])
        self.costs = [read_cost(assembly, task.cost), *(read_limit(assembly, t) for t in task.limits)]
        for cost in self.costs:
            check_smooth(cost)
        # The backward run restarts at every break of a measured input, which costs more than it saves, and does not pass
        # events or kinks of functions of time.
        forcing: Forcing = assembly.once("forcing", lambda: Forcing(assembly))
        self.backwards = len(self.names) >= 2 * len(self.costs) + OBJECTIVE.forward_up_to \
            and not (assembly.flat.inputs or assembly.flat.events or assembly.flat.delays
                     or forcing.follows_states or len(forcing.stops(self.times, assembly.p).times))
        self.runs, self.simulations = 0, 0.0
        self._growth: dict[bytes, float] = {}
        weights = np.array([case.weight for case in task.cases])
        self.weights = weights / weights.sum()
        self._assemblies = [assembly.with_parameters(dict(case.settings)) for case in task.cases]
        self.held = self._held()
        if task.stable:
            check_decided(self.held, "the limit `stable`", "Write `stable: off`, or give --no-stable, and judge the sampled "
                          "loop by its runs.")
        self.undecided = undecided_reasons(self.held)
        self.stable = task.stable is not False and not self.undecided
        self.quiet = next((y for y in self.spread(OBJECTIVE.stable_draws, 0) if self.calm(y)), self.start)
        self.limits = (*task.limits, STABLE) if self.stable else task.limits
        self.cases = [self._case(*pair) for pair in zip(task.cases, self._assemblies, strict=True)]
        self._seen: dict[bytes, Evaluation] = {}

    def _case(self, case: Case, assembly: Assembly) -> RunCase:
        reference = assembly.with_parameters(dict(self.task.reference or {}))
        evaluator = Evaluator(assembly, self.costs, self.begin, float(self.times[-1]), named=tuple(self.names),
                              modes=self.task.modes)
        if evaluator.integrated:
            self._count(1)
            with suppress(ModelError, SimulationError, StartError):  # the integrals begin unscaled then
                times = np.linspace(0, self.times[-1], OBJECTIVE.size_points)
                run = Simulator(assembly, times=times, tolerances=TOLERANCES).run(self.values(self.quiet))
                evaluator.resized(evaluator.largest(run))
        run_case = RunCase(case, assembly, self.times, evaluator, self.names, self.backwards)
        if any(any(cost.references) for cost in self.costs):
            self._count(1)
            run_case.references = evaluator.functional_values(run_case.plain.run(reference.parameter_values))[0]
        return run_case

    def _held(self) -> tuple[HeldVariable, ...]:
        """The held variables at the start of the first case that has one."""
        for modes in self._modes:
            with suppress(HeavebondError):  # no start: the runs report it
                return modes.constant(modes.start({}))
        return ()

    def _count(self, simulations: float) -> None:
        self.runs += 1
        self.simulations += simulations

    @property
    def start(self) -> Array:
        """The diagram's values."""
        values = self.assembly.parameter_values
        return self.shares([values[n] for n in self.names])

    def spread(self, number: int, seed: int) -> Iterator[Array]:
        """The diagram's values, then so many points of a Latin hypercube."""
        from scipy.stats import qmc

        yield self.start
        yield from qmc.LatinHypercube(len(self.names), seed=seed).random(number)

    def shares(self, values: Array | list[float]) -> Array:
        """Values in SI as shares of the ranges."""
        return np.asarray((np.asarray(values) - self.low) / self.span)

    def values(self, y: Array) -> dict[str, float]:
        """The parameters in SI."""
        return dict(zip(self.names, (self.low + y * self.span).tolist(), strict=True))

    def cost(self, y: Array) -> float:
        """The cost alone, from plain runs; infinite if one fails."""
        return self.plain(y).cost

    def plain(self, y: Array) -> Evaluation:
        """Cost and limits without gradients, from plain runs."""
        key = _key(y)
        if key not in self._seen:
            self._seen[key] = self.at(self.values(y))
        return self._seen[key]

    def at(self, values: Mapping[str, float]) -> Evaluation:
        """Cost and limits without gradients at parameters in SI, the others as in the diagram."""
        return self._together(self.shares([values[n] for n in self.names]), [self._values(c, values) for c in self.cases],
                              self._stable(values, ()))

    def _values(self, case: RunCase, values: Mapping[str, float]) -> list[tuple[float, Array]] | None:
        self._count(1)
        try:
            return case.values(dict(values))
        except (ModelError, SimulationError, StartError):
            return None

    def evaluate(self, y: Array) -> Evaluation:
        """Cost, limits and gradients at y; the mean over the cases, the worst case for limits."""
        key = _key(y)
        if key not in self._seen or (self._seen[key].gradient is None and np.isfinite(self._seen[key].cost)):
            stable = self._stable(self.values(y), self.names)
            evaluation = self._together(y, [self._slopes(case, y) for case in self.cases], stable)
            known = [case.curvature for case in self.cases if case.curvature is not None]
            if evaluation.gradient is not None and len(known) == len(self.cases):
                whole = sum((w * c for w, c in zip(self.weights, known, strict=True)), np.zeros((len(y), len(y))))
                evaluation = replace(evaluation, curvature=whole * np.outer(self.span, self.span))
            self._seen[key] = evaluation
        return self._seen[key]

    def _slopes(self, case: RunCase, y: Array) -> list[tuple[float, Array]] | None:
        self._count(2 + len(self.costs) / 2 if self.backwards else 1 + len(self.names))
        try:
            return case.costs(self.values(y))
        except (ModelError, SimulationError, StartError):
            return None

    def _stable(self, values: Mapping[str, float], named: Sequence[str]) -> list[tuple[float, Array]]:
        """The stability boundary with its slope by the named parameters, the worst of the cases; empty if it is off."""
        if not self.stable:
            return []
        try:
            return [max((machine.limit(values, named) for machine in self.machines), key=lambda pair: pair[0])]
        except HeavebondError:  # no start: the runs report it
            return [(np.inf, np.zeros(len(named)))]

    def _together(self, y: Array, case_costs: list[list[tuple[float, Array]] | None], stable: list[tuple[float, Array]]
                  ) -> Evaluation:
        runs = [f for f in case_costs if f is not None]
        cases = {c.case.name: np.inf if f is None else f[0][0] for c, f in zip(self.cases, case_costs, strict=True)}
        if len(runs) < len(case_costs) or not np.isfinite([f[0][0] for f in runs]).all():
            return Evaluation(y, np.inf, np.full(len(self.limits), np.inf), cases)
        cost = float(sum(w * f[0][0] for w, f in zip(self.weights, runs, strict=True)))
        worst = [*(max((f[k] for f in runs), key=lambda pair: pair[0]) for k in range(1, len(self.costs))), *stable]
        limits = np.array([value for value, _ in worst])
        if not runs[0][0][1].size:
            return Evaluation(y, cost, limits, cases)
        gradient = sum((w * f[0][1] for w, f in zip(self.weights, runs, strict=True)), np.zeros(len(y)))
        slopes = np.array([slope for _, slope in worst]).reshape(len(limits), len(y))
        return Evaluation(y, cost, limits, cases, gradient * self.span, slopes * self.span)

    def gradient_anew(self, values: Mapping[str, float]) -> Array:
        """The gradient (m,) of the cost in SI at parameters in SI, with the reference run at them too. SimulationError or
        StartError if a run fails.
        """
        gradient = np.zeros(len(self.names))
        for case, weight in zip(self.cases, self.weights, strict=True):
            self._count(2 + len(self.names))
            gradient += weight * case.gradient_anew(dict(values), self.task.reference or {})
        return gradient

    def resize(self, at: Evaluation) -> None:
        """New sizes for signals that have become much larger or smaller at a point than in the diagram."""
        for case in self.cases:
            case.resize(self.values(at.at))

    # -- stability -------------------------------------------------------------------------------------------------
    def calm(self, y: Array) -> bool:
        """True if the machine has a start from which no mode grows so much in a run that it would decide the cost."""
        return self.growth(y) < OBJECTIVE.max_growth

    def instability(self, y: Array) -> float:
        """The stability boundary, above zero if it is violated; -1 if it is off."""
        return max((value for value, _ in self._stable(self.values(y), ())), default=-1.0)

    def boundary(self, named: Sequence[str], values: Mapping[str, float]) -> Array | None:
        """The slope of the stability boundary by named parameters (m,), None if values (SI) are not at that limit."""
        boundaries = self._stable(values, named)
        return boundaries[0][1] if boundaries and boundaries[0][0] > -OBJECTIVE.at_boundary else None

    def growth(self, y: Array) -> float:
        """Exponent of the growth of the least stable mode in a run, the worst of the cases; infinite without a start, and
        0 if stability is not decided."""
        if self.undecided:
            return 0.0
        key = _key(y)
        if key not in self._growth:
            try:
                self._growth[key] = max(max((m.value.real for m in modes.at(self.values(y))[1] if m.value), default=-1.0)
                                        for modes in self._modes) * float(self.times[-1])
            except HeavebondError:
                self._growth[key] = np.inf
        return self._growth[key]

    def growth_slope(self, y: Array) -> Array:
        """The slope (m,) of the largest Re(s) at the start, in the unknowns of the search, if there is a start."""
        modes = self._modes[0]
        first, modes_at_start = modes.at(self.values(y))
        return np.asarray(modes.slope(first, max(modes_at_start, key=lambda m: m.value.real), self.names).real * self.span)

    def peak_notes(self, values: Mapping[str, float]) -> list[str]:
        """Sentences on limits that hold by `peak`, a smooth maximum, and that the largest values of the run at values of the
        free parameters (SI) exceed: the mean in `peak` counts a short transient too low."""
        limits = [replace(cost, functionals=tuple(replace(f, kind="largest") if f.kind == "peak" else f
                                                  for f in cost.functionals))
                  for cost in self.costs[1:] if any(f.kind == "peak" for f in cost.functionals) and not any(cost.references)]
        exceeded = dict[str, float]()
        for case in self.cases if limits else ():
            assembly = case.plain.assembly
            evaluator = Evaluator(assembly, limits, self.begin, float(self.times[-1]), named=tuple(self.names),
                                  modes=self.task.modes)
            times = np.union1d(self.times, np.linspace(self.begin, self.times[-1], OBJECTIVE.size_points))
            run = Simulator(assembly, times=times, tolerances=TOLERANCES, quadratures=evaluator.quadratures,
                            factors=evaluator.factors, dense=True).run(dict(values))
            numbers, slopes = evaluator.functional_values(run)
            excesses = evaluator.cost_values(numbers, slopes, np.zeros(len(numbers)), run.p, np.zeros((0, len(run.p))))
            for limit, (excess, _) in zip(limits, excesses, strict=True):
                exceeded[limit.text] = max(exceeded.get(limit.text, 0.0), excess)
        return [f"limit {text}: the largest value of the run exceeds it by {100 * excess:.3g} %. `peak` is a smooth "
                "maximum, which is below the largest value of a short transient: set the limit lower by as much, or "
                "evaluate a shorter time (`evaluate: {from: ..., to: ...}`)" for text, excess in exceeded.items()
                if excess > OBJECTIVE.peak_tolerance]

    def at_rest(self, values: Mapping[str, float]) -> tuple[Case, RestStability, OperatingPointStability] | None:
        """The least stable case at its operating point with parameters in SI; None if a case has no equilibrium.
        StartError if one has no start."""
        stabilities = [(case, machine, machine.at(values))
                       for case, machine in zip(self.task.cases, self.machines, strict=True)]
        stabilities_at_rest = [(case, machine, rest_point) for case, machine, rest_point in stabilities
                               if rest_point is not None]
        return max(stabilities_at_rest, key=lambda f: f[2].worst) if len(stabilities_at_rest) == len(stabilities) else None

    @cached_property
    def machines(self) -> list[RestStability]:
        """The cases as machines at rest, without the settings for the computation of modes."""
        machines = [RestStability(assembly, float(self.times[-1])) for assembly in self._assemblies]
        self._follow(machines, self.values(self.quiet))
        return machines

    def follow(self, values: Mapping[str, float]) -> None:
        """Linearise dry friction about the motion at other values; former knowledge of limits is discarded."""
        self._follow(self.machines, values)
        self._seen = {}

    def _follow(self, machines: Sequence[RestStability], values: Mapping[str, float]) -> None:
        for machine in machines:
            with suppress(SimulationError, StartError, UsageError):  # use the slopes at rest and while sliding then
                rest_point = machine.at(values)
                if rest_point is not None and len(rest_point.variants) > 1:
                    times = np.union1d(np.linspace(self.begin, self.times[-1], OBJECTIVE.slope_points), self.times[:1])
                    run = Simulator(machine.assembly, times=times, tolerances=TOLERANCES).run(dict(values))
                    self._count(1)
                    machine.shares = slopes_over(machine.assembly, machine.frictions, run)

    @cached_property
    def _modes(self) -> list[ModesAtStart]:
        return [ModesAtStart(assembly.with_parameters(self.task.modes)) for assembly in self._assemblies]


def _key(y: Array) -> bytes:
    return np.round(y, 12).tobytes()


def check_smooth(cost: Cost) -> None:
    """Raise UsageError if a cost or limit uses functionals of samples."""
    kinds = [f.kind for f in cost.functionals if f.kind in SAMPLED]
    if kinds:
        raise UsageError([Problem("cost-sampled", f"{kinds[0]}(...) has kinks, and nothing is tuned by it", None,
                                  "Tune by peak(...), rms(...) or the like, and measure this one.")])


def check_free(assembly: Assembly, task: TuningProblem) -> None:
    """Raise UsageError for free parameters that are impossible: an unknown name, a range in another unit, a value outside
    its range.
    """
    if not task.free:
        raise UsageError([Problem("free-empty", "nothing is free to be tuned", None,
                                  "Name parameters and ranges: --free controller.K_p='0 .. 10 1/m'.")])
    flat = assembly.flat
    check_ranges({q.name: q.unit for q in flat.parameters}, task.free, flat.limits, flat.origins.of_name)
    units = {q.name: q.unit.text for q in assembly.flat.parameters}
    for name, wanted in task.free.items():
        value = assembly.parameter_values[name]
        if not wanted.low <= value <= wanted.high:
            raise UsageError([Problem("free-start-outside", f"{name} is {value:g} {units[name]} in the diagram, "
                                      "outside its range", None, "Widen the range, or --set another value.")])
    for name in task.modes:
        if name in task.free:
            raise UsageError([Problem("modes-free", f"{name} is free and cannot be set under `modes:` as well", None,
                                      "Remove it from one of the two.")])


class RunCase:
    """A case ready to run; stores its last run, whose gradient is usually needed next."""

    def __init__(self, case: Case, assembly: Assembly, times: Array, evaluator: Evaluator, names: list[str],
                 backwards: bool):
        self.case, self.evaluator, self.names = case, evaluator, names
        self.references = np.zeros(len(evaluator.functionals))
        self.plain = Simulator(assembly, times=times, tolerances=TOLERANCES, quadratures=evaluator.quadratures,
                               factors=evaluator.factors)
        self.adjoint = Adjoint(self.plain, evaluator, names) if backwards else None
        self._last: tuple[dict[str, float], Result] | None = None
        self._numbers: tuple[dict[str, float], Array] | None = None
        self.curvature: Array | None = None

    @cached_property
    def forward(self) -> Simulator:
        """The simulator with sensitivities to all free parameters."""
        plain, begin = self.plain, self.evaluator.begin
        times = np.union1d(plain.time, np.linspace(begin, plain.time[-1], OBJECTIVE.curvature_points))
        return Simulator(plain.assembly, times=times, tolerances=TOLERANCES, quadratures=self.evaluator.quadratures,
                         factors=self.evaluator.factors, sensitivities=self.names, like=plain)

    def _run(self, values: dict[str, float]) -> Result:
        if self._last is None or self._last[0] != values:
            self._last = values, self.plain.run(values)
        return self._last[1]

    def values(self, values: dict[str, float]) -> list[tuple[float, Array]]:
        """Cost and limits without gradients."""
        run = self._run(values)
        numbers, slopes = self.evaluator.functional_values(run)
        self._numbers = values, numbers
        return self.evaluator.cost_values(numbers, slopes, self.references, run.p, np.zeros((0, len(run.p))))

    def costs(self, values: dict[str, float]) -> list[tuple[float, Array]]:
        """Cost and limits with their gradients; forward if the backward run fails."""
        if self.adjoint is not None:
            self.curvature = None
            known = self._last is not None and self._last[0] == values
            try:
                return self.adjoint.costs(self._run(values), self.references) if known else \
                    self.adjoint.at(values, self.references)
            except SimulationError as error:
                if any(problem.code == CHARTS for problem in error.problems):
                    self.adjoint = None  # other runs of this case would fail too
        result = self.forward.run(values)
        assert result.along is not None
        numbers, slopes = self.evaluator.functional_values(result)
        self._numbers = values, numbers
        self.curvature = self.evaluator.curvature(result, self.references)
        return self.evaluator.cost_values(numbers, slopes, self.references, result.p, result.along.p)

    def jump_notes(self, values: dict[str, float]) -> list[str]:
        """Sentences on jumps of laws in the run with these values."""
        return jump_notes(self._run(values), "cost")

    def gradient_anew(self, values: dict[str, float], reference: Mapping[str, float | str]) -> Array:
        """The gradient (m,) of the cost, with the reference run at these values too."""
        passive = self.plain.assembly.with_parameters({**values, **reference})
        references = self.evaluator.functional_values(self.plain.run(passive.parameter_values))[0]
        run = self.forward.run(values)
        assert run.along is not None
        numbers, slopes = self.evaluator.functional_values(run)
        return self.evaluator.cost_values(numbers, slopes, references, run.p, run.along.p)[0][1]

    def resize(self, values: dict[str, float]) -> None:
        """New sizes from the last run, if they differ much."""
        if self._numbers is None or self._numbers[0] != values:
            return
        sizes = self.evaluator.found_sizes(self._numbers[1])
        off = sizes / self.evaluator.sizes
        if ((off > OBJECTIVE.resize) | ((off > 0) & (off < 1 / OBJECTIVE.resize))).any():
            self.plain.factors = self.evaluator.resized(sizes)
            self.__dict__.get("forward", self.plain).factors = self.plain.factors
            self._last = None
