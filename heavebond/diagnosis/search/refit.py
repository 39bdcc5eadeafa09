"""Refit of one candidate: its numbers and all free parameters are fitted in the diagram that contains the candidate.

A score (see `diagnosis.search.scoring`) is local; the refit decides. It starts from the points of `refit_starts`.

A number of the candidate may end at an end of its search range. There are two kinds of ends. An optimum at a limit of the
parameter itself (friction is not below 0) is acceptable. At an end of the search range only, the score test of the bound
shows whether the search stopped too early. Let r (n,) be the residuals and priors, and s_o (n,) the derivative in the
outward direction that the unknowns inside their ranges cannot absorb. Beyond the end, the sum of squares then falls by
(s_o'r)**2 / |s_o|**2 to first order (the Lagrange multiplier of the bound; S. D. Silvey, 1959,
doi:10.1214/aoms/1177706259).

An amplitude is not supported by the records if moving it to its neutral value raises the sum of squares by a negligible
amount only. With d the distance to the neutral value, the rise is d**2 |s_o|**2 + 2 d s_o'r to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import process_time
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import HeavebondError, ModelError, SimulationError, StartError
from heavebond.core.progress import Progress
from heavebond.core.units import Range
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.prediction import SELECTION, TEST, PredictiveErrors, own_starts_of, predictive_errors
from heavebond.diagnosis.search.base_model import ERRS, TIMES, Base, exact_runs, finer
from heavebond.diagnosis.search.refit_starts import (
    FURTHER,
    HOPE,
    LITTLE,
    WIDE,
    Enough,
    Plan,
    RefitStarts,
    made_progress,
    stop_inferior_starts,
    stop_stalled,
)
from heavebond.diagnosis.search.scoring import Score
from heavebond.estimation.experiment import Experiment, Free
from heavebond.estimation.fitting import is_instant
from heavebond.estimation.residuals import AT_END, Descent, Exceeded, Residuals, Run
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe

# Change of the sum of squares that counts as significant, in units of the residual chi-square per sample (see
# `step.EARNED`).
MISSED = 12.0


def passed_ends(problem: Residuals, numbers: Sequence[EffectNumber], inner: Array, r: Array) -> tuple[str, ...]:
    """The names of those `numbers` that ended at an end of the search range although the sum of squares would fall beyond
    it by more than chance. `inner` (m,) is the optimum of the least squares problem, `r` (n,) are the residuals of the
    data there."""
    numbers_by_name, ended = {n.name: n for n in numbers}, problem.at_end(inner)
    stopped = [int(k) for k in np.flatnonzero(ended) if problem.columns[k].free.name in numbers_by_name]
    names = []
    for k in stopped:
        high = bool(inner[k] > (problem.low[k] + problem.high[k]) / 2)
        name, span = problem.columns[k].free.name, problem.columns[k].free.range
        limit, end = numbers_by_name[name].limits[high], span.high if high else span.low
        if limit is not None and abs(end - limit) <= AT_END * (span.high - span.low):
            continue
        slope, size = _alone(problem, k, inner, r)
        slope *= 1.0 if high else -1.0
        if slope < 0 < size and slope**2 / size > MISSED * _unit(r):
            names.append(name)
    return tuple(names)


def unshown_amplitudes(problem: Residuals, numbers: Sequence[EffectNumber], inner: Array, r: Array) -> tuple[str, ...]:
    """The names of the amplitudes that the records do not distinguish from the value without an effect. This is the
    neutral value, or an end of the range for amplitudes without a neutral value (the smallest gap of a play). `inner`
    (m,) and `r` (n,): see `passed_ends`."""
    amplitudes = {n.name: n for n in numbers if n.amplitude}
    names = []
    for k, column in enumerate(problem.columns):
        number, span = amplitudes.get(column.free.name), column.free.range
        if number is None:
            continue
        if number.sought is not None:
            ends = [float(problem.low[k]), float(problem.high[k])]
        else:
            ends = [column.inner(number.neutral)] if span.low <= number.neutral <= span.high else []
        slope, size = _alone(problem, k, inner, r)
        distances = [end - float(inner[k]) for end in ends]
        if any(d**2 * size + 2 * d * slope < MISSED * _unit(r) for d in distances):
            names.append(number.name)
    return tuple(dict.fromkeys(names))


def _alone(problem: Residuals, k: int, inner: Array, r: Array) -> tuple[float, float]:
    """Compute (s_o'r, |s_o|**2) of the k-th unknown. s_o (n,) is its derivative without the part that the unknowns inside
    their ranges can absorb."""
    J, (prior, priors) = problem.evaluate(inner)[1], problem.priors(inner)
    whole, slopes = np.concatenate([r, prior]), np.vstack([J, priors])
    inside = ~problem.at_end(inner)
    inside[k] = False
    projected = slopes[:, k] - slopes[:, inside] @ np.linalg.lstsq(slopes[:, inside], slopes[:, k], rcond=1e-9)[0]
    return float(projected @ whole), float(projected @ projected)


def _unit(r: Array) -> float:
    """The residual chi-square per sample, at least 1 (the noise)."""
    return max(1.0, float(r @ r) / len(r))


FIRST, LAST = 8, 40  # maximum number of runs of a descent: to compare starts, and to converge
# A refit is not continued if chi-square per sample exceeds LARGE and its first steps reduce it by less than the share
# NOTHING.
NOTHING, LARGE = 0.02, 10.0
SECONDS = 60.0  # processor time after which a refit is not continued
WIDENED = 2  # maximum number of times that the range of an amplitude is widened (see `refit_starts.WIDE`)
ASIDE = 0.02  # a limit without influence is moved to this share of its range from the end,
UNFELT = 4.0  # if chi-square rises by at most this (two standard deviations), in units of the residual per sample
IDLE = 0.05  # share of the time: fewer samples show hardly that a law has a limit
CLOSE = 1e-8  # relative change of the sum of squares at which a refit for a close comparison ends
# Amplitudes of a scan, in units of a first value, and the factors by which the best of them is then changed.
SCAN = tuple(2.0 ** k for k in range(-8, 9))
CLOSER = (2.0**0.5, 2.0**0.25, 2.0**0.125)
SHAPES = 2  # number of shape choices of the scores in a scan
# Another start than the best one is continued if the ratio of their sums of squares is in this interval: it is not the same
# point, and may still become the best one.
ANOTHER = (1.001, 3.0)


@dataclass(frozen=True)
class Refit:
    """A candidate after its refit.

    `experiment` contains the candidate. `values` are the values of all free parameters (SI), and `inner` the same values as
    unknowns of the optimiser. `own` are the values that differ between records (SI), by record name. `cost` is the sum of
    squares of residuals and priors. `chi2_fit` and `chi2_held_out` are chi-square per sample on the fitted and the held-out
    records, `errors` the predictive errors. `unknowns` is the number of unknowns, `score` the gain that the score predicted,
    and `lent` the label of a second effect that was added to the diagram for a comparison in pairs.

    `slack` estimates the error on held-out data that is due to the uncertainty of the fitted numbers, for candidates that
    are compared closely (see `_RefitProblem.slack`). `begun` are the first steps from several starts of a refit that may be
    continued, the best first. `falls` is true if one of these starts still fell steeply, or if the best one is at an end of
    an amplitude's range that is not a declared bound.

    `at_end` are the free parameters at an end of their range. `beyond` are the numbers of the candidate at an end of their
    search range beyond which the sum of squares would fall; the refit is then not a minimum (see `passed_ends`). `unshown`
    are the amplitudes that the records do not distinguish from the value without an effect. `acts` is true if the effect
    acts at some time in the fitted records, and a stop ends a motion there (see `_RefitProblem._acts`). `finer` is the
    number of times that the tolerances of its runs were multiplied by `FINER`, relative to the base model.
    """

    candidate: Candidate
    experiment: Experiment
    values: Mapping[str, float]
    cost: float
    chi2_fit: float
    chi2_held_out: float
    samples: int
    samples_held_out: int
    unknowns: int
    at_end: tuple[str, ...]
    score: float
    evaluations: int
    slack: float = 0.0
    begun: tuple[Descent, ...] = field(default=(), repr=False, compare=False)
    falls: bool = False
    errors: PredictiveErrors | None = field(default=None, repr=False, compare=False)
    beyond: tuple[str, ...] = ()
    unshown: tuple[str, ...] = ()
    inner: Array = field(default_factory=lambda: np.zeros(0), repr=False, compare=False)
    finer: int = 0
    acts: bool = True
    own: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    lent: str = ""

    @property
    def absent(self) -> bool:
        """True if the records do not distinguish any of its amplitudes from the value without an effect. The diagram
        without the effect then fits as well with these values."""
        vanishing = {n.name for n in self.candidate.vanishing}
        return bool(vanishing) and vanishing == {n.name for n in self.candidate.numbers if n.amplitude} \
            and vanishing <= set(self.unshown)

    @property
    def bic(self) -> float:
        """Bayesian information criterion n ln(cost/n) + k ln n for noise of unknown scale (G. Schwarz, 1978,
        doi:10.1214/aos/1176344136)."""
        return bic(self.cost, self.samples, self.unknowns)


def bic(cost: float, samples: int, unknowns: int) -> float:
    """Bayesian information criterion of a fit with Gaussian residuals of unknown size."""
    return float(samples * np.log(max(cost, 1e-300) / samples) + unknowns * np.log(samples))


def begun(base: Base, candidate: Candidate, guesses: Sequence[Score] = (), least: float = 0.0, most: float = np.inf,
          progress: Progress | None = None) -> Refit | None:
    """Make the first steps of a refit, from the best of several starts. `least` is the smallest sum of squares of other
    candidates, 0 if unknown. A start is given up after a few steps if its sum of squares is above `most`. None if the
    diagram with the candidate cannot be simulated."""
    try:
        refit = _RefitProblem(base, candidate, guesses)
        descents = refit.begin(least or np.inf, most, progress or (lambda text: None))
        if not descents:
            return None
        trial = refit.judged(descents[0].x)
        while trial.cost <= HOPE * (least or np.inf) and refit.rough(trial) and refit.finer < TIMES:
            refit.make_finer()
            descents = sorted([refit.descend(descents[0].x, progress or (lambda text: None), FIRST, 1e-4), *descents[1:]],
                              key=lambda e: e.cost)
            trial = refit.judged(descents[0].x)
        falls = any(d.unfinished and made_progress(d.history) for d in descents) or bool(refit.wider(descents[0].x))
        # the first steps reduced a large misfit noticeably, or the misfit is small, and they did not take too long
        hopeful = process_time() - refit.began <= SECONDS and 2 * descents[0].cost <= refit.nothing
        return replace(trial, begun=tuple(descents) if hopeful else (), falls=falls)
    except HeavebondError:
        return None


def followed(base: Base, trial: Refit, guesses: Sequence[Score] = (), progress: Progress | None = None) -> Refit:
    """Continue a refit after its first steps until its sum of squares has almost stopped falling."""
    if not trial.begun:
        return trial
    try:
        refit, say = _RefitProblem(base, trial.candidate, guesses, trial.finer), progress or (lambda text: None)
        result = refit.judged(refit.follow(trial.begun, say))
        while refit.rough(result) and refit.finer < TIMES:  # the errors were small only relative to the first misfit
            refit.make_finer()
            result = refit.judged(refit.descend(result.inner, say, LAST, 1e-5, "dogbox").x)
        return result
    except HeavebondError:
        return replace(trial, begun=())


def polished(base: Base, trial: Refit, guesses: Sequence[Score] = (), lender: Refit | None = None,
             progress: Progress | None = None) -> Refit:
    """Continue a refit to full convergence for a close comparison. `lender` is a refit of another law at the same place
    with a smaller sum of squares. If given, the refit starts from the values of the parameters that both have in common,
    to find a better local minimum."""
    refit = _RefitProblem(base, trial.candidate, guesses, trial.finer)
    refit.sought({n.name: trial.experiment.free[n.name].range for n in trial.candidate.numbers if n.name in refit.ranges})
    values = {**trial.values, **_lent(lender, trial.candidate)} if lender is not None else trial.values
    point = [c.inner(trial.own.get(c.record, {}).get(c.free.name, values[c.free.name])) for c in refit.problem.columns]
    start = refit.problem.allowed(np.clip(point, refit.problem.low, refit.problem.high))
    try:
        end = refit.arrive(start, progress or (lambda text: None))
        better = refit.judged(end)
        if lender is not None and better.cost >= trial.cost:
            return trial
        end, better = (end, better) if better.cost < trial.cost else (start, trial)
        return replace(better, slack=refit.slack(end, better.own))
    except HeavebondError:
        return trial


def borrowed(base: Base, trial: Refit, guesses: Sequence[Score], lender: Refit, progress: Progress | None = None) -> Refit:
    """Refit a candidate from the free parameters of a better law at the same place. Its amplitude there is found by a scan.

    Far from the optimum the sum of squares of an oscillating machine has a local minimum for each cycle by which the model
    is out of phase, and a refit from the base model may end in one of them. With the free parameters of a law that leaves
    far less, the model is in phase. The result is `trial` if the refit does not end with a smaller sum of squares.
    """
    try:
        refit, say = _RefitProblem(base, trial.candidate, guesses, trial.finer), progress or (lambda text: None)
        refit.sought({name: trial.experiment.free[name].range for name in refit.ranges})
        start = refit.scanned(_lent(lender, trial.candidate), lender.own, trial)
        if start is None:
            return trial
        better = refit.judged(refit.follow([refit.descend(start, say, FIRST, 1e-4)], say))
        return better if better.cost < trial.cost else trial
    except HeavebondError:
        return trial


def refitted_from(base: Base, candidate: Candidate, lender: Refit, progress: Progress | None = None) -> Refit | None:
    """Refit a candidate from the values, and in the search ranges, of a refit of the same law in another diagram. None if
    the diagram cannot be simulated there."""
    spans = {n.name.rpartition(".")[2]: lender.experiment.free[n.name].range for n in lender.candidate.numbers
             if n.name in lender.experiment.free}
    ranges = {n.name: spans[key] for n in candidate.numbers if (key := n.name.rpartition(".")[2]) in spans}
    return refitted_at(base, candidate, _lent(lender, candidate), ranges, lender.own, progress)


def refitted_at(base: Base, candidate: Candidate, values: Mapping[str, float], ranges: Mapping[str, Range],
                record_values: Mapping[str, Mapping[str, float]] | None = None, progress: Progress | None = None
                ) -> Refit | None:
    """Refit a candidate from given values (SI) of its numbers and of free parameters. `record_values` are values that
    differ between records, by record name. `ranges` are the search ranges of the candidate's numbers. None if the diagram
    cannot be simulated there."""
    try:
        refit = _RefitProblem(base, candidate, ())
        refit.sought({name: span for name, span in ranges.items() if name in refit.ranges})
        first = base.problem.runs[0].record.name
        start = {name: {**base.problem.values_of(base.inner, name or first), **values, **(record_values or {}).get(name, {})}
                 for name in {c.record for c in refit.problem.columns}}
        point = [c.inner(start[c.record].get(c.free.name, c.before)) for c in refit.problem.columns]
        end = refit.arrive(refit.problem.allowed(np.clip(point, refit.problem.low, refit.problem.high)),
                           progress or (lambda text: None))
        return refit.judged(end)
    except HeavebondError:
        return None


def at_end_of(base: Base, candidate: Candidate, guesses: Sequence[Score], ranges: Mapping[str, tuple[float, float]],
              inner: Array, finer: int = 0) -> Refit:
    """Compute the figures of a refit that ended at `inner`, with these search `ranges` (SI) of the candidate's numbers."""
    refit = _RefitProblem(base, candidate, guesses, finer)
    free = refit.problem.experiment.free
    refit.sought({name: replace(free[name].range, low=low, high=high) for name, (low, high) in ranges.items()})
    return refit.judged(inner)


def _lent(lender: Refit, candidate: Candidate) -> dict[str, float]:
    """The values of a refit that apply to another law: the parameters that both diagrams have, and the numbers with the
    same name in both laws."""
    names_by_key = {n.name.rpartition(".")[2]: n.name for n in candidate.numbers}
    numbers = {n.name: n.name.rpartition(".")[2] for n in lender.candidate.numbers}
    common = {name: value for name, value in lender.values.items() if name not in numbers}
    return {**common, **{names_by_key[key]: lender.values[name] for name, key in numbers.items()
                         if key in names_by_key and name in lender.values}}


class _RefitProblem:
    """The least squares problem of the diagram that contains the candidate."""

    def __init__(self, base: Base, candidate: Candidate, guesses: Sequence[Score], finer: int = 0):
        self.base, self.candidate, self.guesses, self.began = base, candidate, guesses, process_time()
        self.finer, self.errs = 0, 0.0  # number of tolerance reductions; norm of the residual errors
        diagram = base.diagram(candidate.change)
        changed, self.held_out = diagram.experiment, diagram.held_out
        self.runs = base.runs(candidate.change, [])
        self.starts = RefitStarts(base, candidate, guesses, self.runs)
        self.ranges = dict(self.starts.ranges)
        numbers, assembly = {n.name: n for n in candidate.numbers}, self.runs[0].assembly
        # first values of the candidate's numbers, inside their ranges and in the order that the law requires
        values = {name: float(np.clip(self.starts.plans[0].numbers[name], *self.ranges[name])) for name in self.ranges}
        for leaf in assembly.flat.expanded.leaves.values():
            for ends in leaf.component.orders:
                high, low = (f"{leaf.path}.{end}" for end in ends)
                if high in values and low in values and values[high] <= values[low]:
                    values[high], values[low] = self.ranges[high][1], self.ranges[low][0]
        # these numbers are free as well
        place = next(iter(changed.records.values())).place
        free = {name: f for name, f in changed.free.items() if name in assembly.parameter_values}
        free |= {name: Free(name, Range(low, high, numbers[name].unit), place,
                            typical=numbers[name].prior(assembly.flat.expanded.leaves))
                 for name, (low, high) in self.ranges.items()}
        freed = replace(changed, model=changed.model.with_parameters(values), free=free)
        self.problem = Residuals(freed, runs=[run.again(list(freed.free), values, QuickSimulator) for run in self.runs])
        for _ in range(finer):
            self.make_finer()

    def make_finer(self) -> None:
        """Reduce the tolerances of all further runs."""
        self.problem, self.finer = finer(self.problem), self.finer + 1
        self.runs = [run.again([], {}, QuickSimulator, of.simulator.tolerances)
                     for run, of in zip(self.runs, self.problem.runs, strict=True)]

    def rough(self, trial: Refit) -> bool:
        """True if the errors of the search runs at the end of a refit are not small compared with its residual. This may
        occur if a law changes within milliseconds. The descent then ends in the roughness of the sum of squares."""
        return self.errs > ERRS * float(np.sqrt(trial.cost))

    def _start(self, plan: Plan) -> Array:
        """Convert a starting point into unknowns of this problem."""
        point = {(c.free.name, c.record): v for c, v in zip(self.base.problem.columns, plan.base, strict=True)}
        # a parameter with a separate value for each record starts at the common value
        point |= {(c.free.name, c.record): point.get((c.free.name, ""), c.inner(c.before)) for c in self.problem.columns
                  if c.free.name in self.candidate.change.each}
        start: Array = np.array([point[c.free.name, c.record] if (c.free.name, c.record) in point else
                          c.inner(float(np.clip(plan.numbers[c.free.name], *self.ranges[c.free.name])))
                          for c in self.problem.columns])
        span = self.problem.high - self.problem.low
        return np.asarray(np.clip(start, self.problem.low + 1e-6 * span, self.problem.high - 1e-6 * span))

    def _cost(self, inner: Array, most: float = np.inf) -> float:
        """Sum of squares of residuals and priors from runs without sensitivities; infinite if it exceeds `most` or a run
        fails."""
        problem, prior = self.problem, self.problem.priors(inner)[0]
        cost, inner = float(prior @ prior), problem.allowed(inner)
        try:
            for run in self.runs:
                r = run.residuals(problem.values_of(inner, run.record.name), most - cost)[0]
                cost += float(r @ r)
        except (ModelError, SimulationError, StartError, Exceeded):
            return np.inf
        return cost if cost <= most else np.inf  # also infinite for NaN

    def scanned(self, values: Mapping[str, float], record_values: Mapping[str, Mapping[str, float]], trial: Refit
                ) -> Array | None:
        """The best start with these free parameters (SI): the amplitudes are varied together over `SCAN`, for the shapes of
        `trial` and for those of its scores. `record_values` are values that differ between records. None if no start can
        be simulated."""
        neutral = {n.name: n.neutral for n in self.candidate.vanishing if n.name in self.ranges}
        choices = [{name: trial.values[name] for name in self.ranges if name in trial.values},
                   *(dict(plan.numbers) for plan in self.starts.plans[:2 * SHAPES:2])]
        parameters = {**self.problem.values_of(self.problem.start, self.runs[0].record.name), **values}

        def point(numbers: Mapping[str, float], factor: float) -> Array:
            scaled = {name: value if name not in neutral else neutral[name] + factor * (value - neutral[name])
                      for name, value in numbers.items() if name in self.ranges}
            clipped = {name: float(np.clip(value, *self.ranges[name])) for name, value in scaled.items()}
            start = [c.inner({**parameters, **record_values.get(c.record, {}), **clipped}[c.free.name])
                     for c in self.problem.columns]
            span = self.problem.high - self.problem.low
            return np.asarray(np.clip(start, self.problem.low + 1e-6 * span, self.problem.high - 1e-6 * span))

        best: Array | None = None
        least = np.inf
        for numbers in choices:
            factor = 0.0  # that of the best start, if it has these numbers
            for another in SCAN if neutral else (1.0,):
                start = point(numbers, another)
                if (cost := self._cost(start, least)) < least:  # a run ends if its sum of squares exceeds the best
                    best, least, factor = start, cost, another
            for closer in CLOSER if factor and neutral else ():
                for another in (factor * closer, factor / closer):
                    start = point(numbers, another)
                    if (cost := self._cost(start, least)) < least:
                        best, least, factor = start, cost, another
        return best

    def arrive(self, start: Array, progress: Progress) -> Array:
        """Converge to the optimum from a point near it."""
        def arrived(start: Array) -> Array:
            return self.problem.minimise(start, False, progress, most=LAST, tolerance=CLOSE, settle=True, rough=True).x

        return self._further_out(arrived(start), arrived)

    def _further_out(self, inner: Array, descended: Callable[[Array], Array]) -> Array:
        """Widen the range of amplitudes that end at an end of their range, unless it is a declared bound, and continue
        the descent."""
        for _ in range(WIDENED):
            wider = self.wider(inner)
            if not wider or process_time() - self.began > SECONDS:
                break
            values = [c.outer(v) for c, v in zip(self.problem.columns, inner, strict=True)]
            self.sought(wider)
            inner = descended(np.array([c.inner(v) for c, v in zip(self.problem.columns, values, strict=True)]))
        return inner

    def wider(self, inner: Array) -> dict[str, Range]:
        """Wider search ranges for the amplitudes that ended at an end of their range. Declared bounds are kept."""
        widened = {}
        numbers = {n.name: n for n in self.candidate.vanishing}
        for column, value, low, high in zip(self.problem.columns, inner, self.problem.low, self.problem.high, strict=True):
            number, span = numbers.get(column.free.name), column.free.range
            if number is None or min(value - low, high - value) >= AT_END * (high - low):
                continue
            ends = [number.neutral + WIDE * (end - number.neutral) for end in (span.low, span.high)]
            wider = replace(span, low=ends[0] if number.low is None else max(number.low, ends[0]),
                            high=ends[1] if number.high is None else min(number.high, ends[1]))
            if (value > (low + high) / 2 and wider.high > span.high) or (value < (low + high) / 2 and wider.low < span.low):
                widened[number.name] = wider
        return widened

    def sought(self, ranges: Mapping[str, Range]) -> None:
        """Change the search ranges of these numbers from now on."""
        experiment = self.problem.experiment
        free = {name: replace(f, range=ranges[name]) if name in ranges else f for name, f in experiment.free.items()}
        self.ranges |= {name: (span.low, span.high) for name, span in ranges.items()}
        present_values, runs = self.problem.runs[0].assembly.parameter_values, self.problem.runs
        clipped = {name: float(np.clip(present_values[name], span.low, span.high)) for name, span in ranges.items()
                   if not span.low <= present_values[name] <= span.high}
        if clipped:  # first values outside of the new ranges
            runs = [run.again(run.names, clipped, QuickSimulator) for run in runs]
        self.problem = Residuals(replace(experiment, free=free), runs=runs)

    def _out_of_the_way(self, inner: Array) -> Array:
        """Move limits without influence on the fitted samples to the outer end of their range.

        A limit that is not reached, or reached by one sample only (an end stop), is moved to this end or near it, provided
        that chi-square rises by no more than `UNFELT`. Other records may move further than the fitted ones. An onset time
        without influence is moved to an end in the same way: the effect then acts in the whole record, or not at all.
        """
        cost = self._cost(inner)
        # at least one unit of noise: in a record without noise the residual is rounding errors only
        felt = UNFELT * max(cost / self.base.r.size, 1.0)
        limits = {n.name for n in self.candidate.numbers if not n.amplitude and n.sought is not None and n.sought.seen}
        for k, column in enumerate(self.problem.columns):
            shares = (1 - ASIDE, ASIDE) if column.free.name in limits else \
                (1.0, 0.0) if column.record and is_instant(self.problem.experiment.model, column.free.name) else ()
            for share in shares:
                moved_point = inner.copy()
                moved_point[k] = self.problem.low[k] + share * (self.problem.high[k] - self.problem.low[k])
                if self._cost(moved_point, cost + felt) <= cost + felt:
                    inner = moved_point
                    break
        return inner

    def begin(self, least: float, most: float, progress: Progress) -> list[Descent]:
        """Make the first steps from the best starts; the descents are sorted by their sum of squares. The list is empty
        if no start can be simulated."""
        starts = list({start.tobytes(): start for start in map(self._start, self.starts.plans)}.values())
        number = 3 if len(starts) > FURTHER else 2
        costs: list[float] = []
        for start in starts:  # a run ends when it can no longer be among the best
            costs.append(self._cost(start, sorted(costs)[number - 1] if len(costs) >= number else np.inf))
        chosen = [starts[k] for k in np.argsort(costs, kind="stable") if np.isfinite(costs[k])][:number]
        if not chosen or process_time() - self.began > SECONDS:
            return []
        # if another candidate explains most of the misfit, one whose first steps explain nothing is given up
        nothing = self.nothing if least < DECISION.mainly * self.base.cost else np.inf
        enough = stop_inferior_starts(self.problem.high - self.problem.low, least, min(nothing, most))
        descents = [self.descend(start, progress, FIRST, 1e-4, enough=enough) for start in chosen]
        if all(2 * e.cost > self.base.cost for e in descents) and (beside := self.starts.beside) is not None:
            descents.append(self.descend(self._start(beside), progress, FIRST, 1e-4, enough=enough))
        return sorted(descents, key=lambda e: e.cost)

    def follow(self, begun: Sequence[Descent], progress: Progress) -> Array:
        """Run the best start, and a second one if its cost is close, to convergence."""
        first, *other_starts = begun
        ends = [first, *(e for e in other_starts if ANOTHER[0] < e.cost / first.cost < ANOTHER[1])][:2]
        ends = [self.descend(e.x, progress, LAST, 1e-5) if e.unfinished else e for e in ends]
        best = min(ends, key=lambda e: e.cost)
        if self.problem.at_end(best.x).any():  # the reflective method may stop here although other unknowns can move
            best = min(best, self.descend(best.x, progress, LAST, 1e-5, "dogbox"), key=lambda e: e.cost)
        return self._out_of_the_way(self._further_out(best.x, lambda start: self.descend(start, progress, LAST, 1e-5).x))

    @property
    def nothing(self) -> float:
        """The sum of squares above which a refit does not reduce a large misfit noticeably; infinite if the misfit is
        small."""
        r = self.base.r
        whole = float(r @ r)
        return (1 - NOTHING) * whole if whole > LARGE * len(r) else np.inf

    def descend(self, start: Array, progress: Progress, most: int, tolerance: float,
                method: Literal["trf", "dogbox"] = "trf", enough: Enough = stop_stalled) -> Descent:
        """Descend from a distant start until the sum of squares has almost stopped falling."""
        return self.problem.descend(start, False, progress, most=most, tolerance=tolerance, method=method,
                                    enough=enough, promise=LITTLE)

    def judged(self, inner: Array) -> Refit:
        """Compute the figures of the refit at `inner`, from runs by IDAS."""
        problem, inner = self.problem, self.problem.allowed(inner)
        exact = exact_runs(problem.experiment, self.runs, self.base.exact, self.held_out)
        r = np.concatenate([exact[name].residuals(problem.values_of(inner, name))[0]
                            for name in (run.record.name for run in self.runs)])
        prior = problem.priors(inner)[0]
        self.errs = float(np.linalg.norm(r - problem.evaluate(inner)[0]))
        values = [problem.values_of(inner, run.record.name) for run in problem.runs]
        held_out = own_starts_of(problem, inner, exact)
        errors = predictive_errors(problem, inner, exact, r, held_out)
        each = {name for name, f in problem.experiment.free.items() if f.each}
        record_values = {run.record.name: {name: separate_values[name] for name in each}
                         for run, separate_values in zip(problem.runs, values, strict=True)}
        instants = sum(is_instant(problem.experiment.model, name)
                       for separate_values in held_out.values() for name in separate_values)
        acts = not self.candidate.acts or self._acts([exact[run.record.name] for run in self.runs], inner)
        at_end = tuple(c.free.name for c, end in zip(problem.columns, problem.at_end(inner), strict=True)
                       if end and c.free.name not in {*self.ranges, *self.candidate.change.each})
        return Refit(self.candidate, problem.experiment, values[0], float(r @ r + prior @ prior), float(r @ r) / len(r),
                     errors.mean(SELECTION, TEST), len(r), errors.samples(SELECTION, TEST), len(inner) + instants, at_end,
                     max((g.gain for g in self.guesses), default=float("nan")),
                     problem.evaluations, errors=errors, beyond=passed_ends(problem, self.candidate.numbers, inner, r),
                     unshown=unshown_amplitudes(problem, self.candidate.numbers, inner, r), inner=inner,
                     finer=self.finer, acts=acts, own={**record_values, **held_out} if each else {})

    def _acts(self, runs: Sequence[Run], inner: Array) -> bool:
        """True if the effect acts at some time in the fitted records.

        A law with a limit (`Candidate.partly`) must also be idle for the share `IDLE` of the time: a saturation that always
        acts is another input. A stop must end the motion: in one record it is reached from the free motion, and it yields
        less than this motion is wide. Otherwise it is a spring."""
        candidate, reached, yields, free = self.candidate, False, 0.0, 0.0
        active: list[NDArray[np.bool_]] = []
        for run in runs:
            result = run.simulator.run(self.problem.values_of(inner, run.record.name))
            wanted = [candidate.acts, *([candidate.reverses] if candidate.reverses else [])]
            acting, *position = Probe(run.assembly, wanted, si=True).values(result)
            active.append(acting > 0)
            if not position:
                continue
            reached = reached or bool(np.any((acting[1:] > 0) & (acting[:-1] <= 0)))
            yields = max(yields, float(acting.max()))
            free = max(free, float(np.ptp(position[0][acting <= 0])) if np.any(acting <= 0) else 0.0)
        if candidate.reverses:
            return reached and yields < free
        share = float(np.mean(np.concatenate(active)))
        return 0 < share <= (1 - IDLE if candidate.partly else 1)

    def slack(self, inner: Array, record_values: Mapping[str, Mapping[str, float]]) -> float:
        """The part of chi-square on held-out data that is due to the uncertainty of the fitted numbers.

        Let r (n,) be the residuals of the held-out samples, J (n, m) their derivatives, F the information of the fit with
        its priors, and d steps of the unknowns that are not at an end of their range. The result is

            |r|**2 - min over d of |r + J d|**2 + d'F d  =  (J'r)' (J'J + F)**-1 J'r.

        If all samples were fitted together, the sum of squares would increase by |r|**2 minus this result, as long as the
        tangent is accurate.
        """
        problem = self.problem
        moving = np.flatnonzero(~problem.at_end(inner))
        fitted = np.vstack([problem.evaluate(inner)[1], problem.priors(inner)[1]])[:, moving]
        names = list(problem.experiment.free)
        exact = exact_runs(problem.experiment, self.runs, self.base.exact, self.held_out)
        residuals, blocks = [np.zeros(0)], [np.zeros((0, len(inner)))]
        for record in problem.experiment.records.values():
            values = problem.values_of(inner, record.name)
            if record.use != "fit":
                values.update(record_values.get(record.name, {}))
            wrong, slopes = exact[record.name].again(names, values, QuickSimulator).held_out(values)
            block = np.zeros((len(wrong), len(inner)))
            for k, column in enumerate(problem.columns):
                if column.record in ("", record.name):
                    block[:, k] = slopes[names.index(column.free.name)] * column.slope(inner[k])
            residuals.append(wrong)
            blocks.append(block)
        r, J = np.concatenate(residuals), np.vstack(blocks)[:, moving]
        normal, slope = fitted.T @ fitted + J.T @ J, J.T @ r
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        return float(slope / scale @ np.linalg.lstsq(normal / scale[:, None] / scale, slope / scale, rcond=1e-12)[0])
