"""Verification of sensitivities by finite differences of runs, with the reason of a disagreement.

Finite differences are independent of the derivatives and reveal errors in them, but are inaccurate if the integration errors
are too large for the step, or if a law has a kink between the runs. With y the quantity, h the step and runs at tight
tolerances, the central difference of fourth order and the two one-sided ones of second order are

    (8 (y(h) - y(-h)) - (y(2h) - y(-2h))) / 12 h,   +-(4 (y(+-h) - y(0)) - (y(+-2h) - y(0))) / 2 h.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.progress import Progress
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.kinks import KinkCrossing, Kinks
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.optimise.adjoint import Adjoint
from heavebond.optimise.influence import in_chunks
from heavebond.optimise.objective import TOLERANCES, Objective, TuningProblem

STEPS = (1e-2, 1e-3, 1e-4, 1e-5)  # relative to the parameter, or to 1 in its base unit if it is zero
TIGHT = Tolerances(1e-11, 1e-13, along=1.0)
# The slope of adjoint states jumps at a kink of a law, which no step passes at TIGHT.
TIGHT_BACKWARDS = Tolerances(1e-9, 1e-11)


@dataclass(frozen=True)
class GradientCheckConstants:
    """The constants of the comparison of gradients with differences of runs.

    agree: relative difference at the tight tolerances. Origin: differences are right to about 1e-6 there. Doubled: smaller
    faults pass.
    agree_default: relative difference at the default tolerances. Origin: above the errors of forward sensitivities, some
    1e-4. Doubled: smaller faults pass.
    no_effect: relative change of a quantity below which a parameter has no effect on it. Origin: tolerances. Doubled:
    nothing.
    torn: relative difference of one-sided differences without a common limit. Origin: a kink. Doubled: fewer kinks are
    named.
    traced_points: points at which two runs are compared for being on one side of a kink. Origin: the default output has a
    thousand. Doubled: time.
    """

    agree: float = 1e-4
    agree_default: float = 2e-3
    no_effect: float = 1e-9
    torn: float = 0.1
    traced_points: int = 2000


GRADIENT_CHECK = GradientCheckConstants()


@dataclass(frozen=True)
class SampledRun:
    """Values (n, N) of a run at times (N,), empty for costs, and the times of its events."""

    values: Array
    times: Array
    events: tuple[float, ...] = ()


Runs = Callable[[Mapping[str, float]], SampledRun]


@dataclass(frozen=True)
class Subject:
    """The differentiated quantities: n of a diagram at N times.

    `runs(tolerances)` gives a function from settings to a run; `exact(tolerances, names)` the derivatives (m, n, N), at
    the given or `tight` tolerances; `trace(settings)` a run to search for kinks.
    """

    assembly: Assembly
    names: tuple[str, ...]
    units: tuple[str, ...]
    tolerances: Tolerances
    tight: Tolerances
    kinks: Kinks
    runs: Callable[[Tolerances], Runs]
    exact: Callable[[Tolerances, Sequence[str]], Array]
    trace: Callable[[Mapping[str, float]], Result]


@dataclass(frozen=True)
class Verdict:
    """`agrees`, `tolerance`, `kink`, `disagrees` or `unsettled`, with the evidence.

    Errors are shares of the largest derivative: `given` of the derivatives at the given tolerances, `steps` of the
    differences at each step, both against the derivatives at tight tolerances; `apart` between the one-sided differences.
    """

    quantity: str
    parameter: str
    word: str
    why: str
    given: float
    steps: dict[float, float]
    apart: float
    largest: float

    @property
    def best(self) -> float:
        """The least error of a difference, NaN if no run was possible."""
        known = [e for e in self.steps.values() if np.isfinite(e)]
        return min(known, default=float("nan"))


# -- subjects --------------------------------------------------------------------------------------------------------
def signals_of(assembly: Assembly, signals: Iterable[str], until: Time | None = None, *,
               tolerances: Tolerances | None = None) -> Subject:
    """Signals over time. UsageError for an unknown name."""
    names = tuple(signals)
    probe = Probe(assembly, names)

    def runs(tolerances: Tolerances) -> Runs:
        simulator = Simulator(assembly, until, tolerances=tolerances)

        def ran(settings: Mapping[str, float]) -> SampledRun:
            run = simulator.run(settings)
            return SampledRun(probe.values(run), run.time, tuple(time for time, _ in run.events))

        return ran

    def exact(run_tolerances: Tolerances, parameters: Sequence[str]) -> Array:
        return np.concatenate([probe.sensitivities(Simulator(assembly, until, tolerances=run_tolerances,
                                                             sensitivities=chunk).run())
                               for chunk in in_chunks(parameters)])

    trace = _traced(assembly, until)
    unit = trace({}).unit
    return Subject(assembly, names, tuple(unit(n) for n in names), tolerances or Tolerances(), TIGHT,
                   Kinks(assembly, names), runs, exact, trace)


def costs_of(assembly: Assembly, task: TuningProblem, *, tolerances: Tolerances | None = None,
             backwards: bool = False) -> Subject:
    """The cost and the limits of a task in its first case; by backward instead of forward runs if requested."""
    case = Objective(assembly, task).cases[0]
    assembly, time = case.plain.assembly, case.plain.time
    evaluator, references = case.evaluator, case.references

    def simulator(tolerances: Tolerances, names: Sequence[str] = ()) -> Simulator:
        return Simulator(assembly, times=time, tolerances=tolerances, quadratures=evaluator.quadratures,
                         factors=evaluator.factors, sensitivities=names)

    def runs(tolerances: Tolerances) -> Runs:
        plain = simulator(tolerances)
        return lambda settings: SampledRun(np.array(
            [[slope.value] for slope in evaluator.cost_slopes(plain.run(settings), references)]), np.zeros(0))

    def exact(tolerances: Tolerances, names: Sequence[str]) -> Array:
        if backwards:
            plain = simulator(tolerances)
            costs_with_gradients = Adjoint(plain, evaluator, names).costs(plain.run(), references)
            return np.array([gradient for _, gradient in costs_with_gradients]).T[:, :, None]
        return np.concatenate([forward(tolerances, chunk) for chunk in in_chunks(names)])

    def forward(tolerances: Tolerances, names: Sequence[str]) -> Array:
        run = simulator(tolerances, names).run()
        assert run.along is not None
        costs_with_gradients = evaluator.cost_values(*evaluator.functional_values(run), references, run.p, run.along.p)
        return np.array([gradient for _, gradient in costs_with_gradients]).T[:, :, None]

    names = ("cost", *task.limits)
    return Subject(assembly, names, tuple(c.unit for c in evaluator.costs), tolerances or TOLERANCES,
                   TIGHT_BACKWARDS if backwards else TIGHT, Kinks(assembly), runs, exact, _traced(assembly, float(time[-1])))


def _traced(assembly: Assembly, until: Time | None) -> Callable[[Mapping[str, float]], Result]:
    end = float(Simulator(assembly, until).time[-1])
    simulator = Simulator(assembly, times=np.linspace(0, end, GRADIENT_CHECK.traced_points))
    return simulator.run


# -- the check -------------------------------------------------------------------------------------------------------
def check_gradients(subject: Subject, parameters: Sequence[str], *, progress: Progress | None = None) -> list[Verdict]:
    """One verdict per quantity and parameter. UsageError for an unknown parameter or without any."""
    if not parameters:
        raise UsageError([Problem("nothing-to-check", "no parameter is named", None, "Name one with --to.")])
    say = progress or (lambda text: None)
    subject.assembly.parameter_indices(parameters)  # UsageError for a name that cannot be set
    values = subject.assembly.parameter_values
    sizes = np.array([abs(values[name]) or 1.0 for name in parameters])
    say("sensitivities")
    at_given, tight = (subject.exact(tolerances, parameters) * sizes[:, None, None]
                       for tolerances in (subject.tolerances, subject.tight))
    runs = subject.runs(TIGHT)
    middle = runs({})
    verdicts = []
    for k, name in enumerate(parameters):
        say(f"differences to {name}, {k + 1} of {len(parameters)}")
        near = {h: _around(runs, name, values[name], h * sizes[k]) for h in STEPS}
        passings = _passings(subject, name, values[name], STEPS[0] * sizes[k])
        for j, quantity in enumerate(subject.names):
            differences = {h: None if y is None else _differences(middle, y, j, h, tight[k, j]) for h, y in near.items()}
            verdicts.append(judge(quantity, name, middle.values[j], at_given[k, j], tight[k, j], differences,
                                  [p for p in passings if p.kink.signal in ("", quantity)],
                                  (subject.tolerances.rtol, subject.tight.rtol)))
    return verdicts


def _differences(middle: SampledRun, around: Sequence[SampledRun], j: int, h: float, exact: Array) -> _Differences | None:
    """The differences of the j-th quantity at a step h, with the `exact` derivative (N,) at times without a valid
    difference; None if most times have none."""
    differences = _Differences.of(middle.values[j], [run.values[j] for run in around], h)
    # the times (N,) that lie before an event in some of the runs and after it in others: a difference over a jump is not a
    # derivative
    runs = [middle, *around]
    out = np.zeros(len(middle.times), dtype=bool)
    for k in range(max(len(run.events) for run in runs)):
        times = [run.events[k] if k < len(run.events) else np.inf for run in runs]
        out |= (middle.times >= min(times)) & (middle.times <= max(times)) & (min(times) < max(times))
    if 2 * np.count_nonzero(out) > len(exact):
        return None
    return differences if not out.any() else _Differences(
        *(np.where(out, exact, side) for side in (differences.central, differences.up, differences.down)))


def _around(runs: Runs, name: str, value: float, step: float) -> list[SampledRun] | None:
    """Runs at -2, -1, 1, 2 steps; None if a run is impossible (a mass below zero)."""
    try:
        return [runs({name: value + n * step}) for n in (-2, -1, 1, 2)]
    except HeavebondError:
        return None


def _passings(subject: Subject, name: str, value: float, step: float) -> list[KinkCrossing]:
    try:
        return subject.kinks.apart(*(subject.trace({name: value + n * step}) for n in (-1, 1)))
    except HeavebondError:
        return []


@dataclass(frozen=True)
class _Differences:
    """Central and one-sided differences (N,) per relative change."""

    central: Array
    up: Array
    down: Array

    @staticmethod
    def of(middle: Array, around: Sequence[Array], h: float) -> _Differences:
        down_2, down, up, up_2 = around
        return _Differences((8 * (up - down) - (up_2 - down_2)) / (12 * h),
                            (4 * (up - middle) - (up_2 - middle)) / (2 * h),
                            -(4 * (down - middle) - (down_2 - middle)) / (2 * h))


def judge(quantity: str, parameter: str, values: Array, computed: Array, tight: Array,
          differences: Mapping[float, _Differences | None], passings: Sequence[KinkCrossing], rtol: tuple[float, float]
          ) -> Verdict:
    """The verdict on one derivative (N,), all per relative change of the parameter; `rtol` given and tight.

    If the differences converge to another value than the derivative without a kink between the runs, or with a kink of
    the slope only, the derivative is wrong.
    """
    known = {h: d for h, d in differences.items() if d is not None}
    largest = max([_most(tight), *(_most(d.central) for d in known.values())])
    still = GRADIENT_CHECK.no_effect * max(_most(values), 1e-300)
    scale = max(largest, still)
    steps = {h: _most(tight - d.central) / scale for h, d in known.items()}
    error = _most(computed - tight) / scale
    apart = min((_most(d.up - d.down) / scale for d in known.values()), default=float("nan"))
    best = min(steps.values(), default=float("nan"))

    def verdict(word: str, why: str) -> Verdict:
        return Verdict(quantity, parameter, word, why, error, steps, apart, largest)

    if not known:
        return verdict("unsettled", "no run near the value of the parameter could be made")
    if largest <= still:
        return verdict("agrees", "the parameter has no influence")
    if apart > GRADIENT_CHECK.torn:
        # the central difference is the mean of two slopes, like CasADi's derivative there
        return verdict("kink", _with(passings, f"the slopes from above and below are {100 * apart:.2g} % apart, so that "
                                     "none is the derivative: at the value of the parameter itself "))
    if best <= GRADIENT_CHECK.agree:
        if error <= GRADIENT_CHECK.agree_default:
            return verdict("agrees", _with(passings, "the differences at long steps do not: between the runs ")
                           if max(steps.values()) > 0.1 and passings else "")
        return verdict("tolerance", f"at rtol {rtol[0]:g} it is off by {100 * error:.2g} %, at {rtol[1]:g} it agrees with "
                       "the differences: tighten the tolerances")
    centrals = [d.central for d in known.values()]
    settled = min((_most(a - b) / scale for a, b in pairwise(centrals)), default=np.inf)
    between = f"the differences change with the step (off by {100 * min(steps.values()):.2g} .. " \
        f"{100 * max(steps.values()):.2g} %)" if settled > 0.3 * best else \
        f"the differences from above and from below are {100 * apart:.2g} % apart"
    if any(p.kink.jumps for p in passings):
        return verdict("kink", _with([p for p in passings if p.kink.jumps], "a law jumps, which no sensitivity "
                                       "follows: "))
    if passings and (settled > 0.3 * best or apart > 0.3 * best):
        return verdict("kink", _with(passings, f"{between}: between the runs "))
    if settled > 0.3 * best:
        return verdict("unsettled", f"{between}: the motion is chaotic, or a law is too steep for them")
    return verdict("disagrees", f"the differences settle on another value, {100 * best:.2g} % away, and no kink explains "
                   "it: this is a mistake in heavebond")


def _most(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _with(passings: Sequence[KinkCrossing], words: str) -> str:
    """The kinks in the order of time, each owner once."""
    named: dict[tuple[str, str], float] = {}
    for p in passings:
        named.setdefault((p.kink.owner, p.kink.function), p.time)
    switchings = [f"{owner} ({function}) switches at {time:.4g} s" for (owner, function), time in list(named.items())[:3]]
    return words + ", ".join(switchings) + (f" and {len(named) - 3} more" if len(named) > 3 else "")
