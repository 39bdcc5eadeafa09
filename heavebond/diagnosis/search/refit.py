"""Refit of one candidate: its numbers and all free parameters, fitted in the diagram that contains it.

A score (see `diagnosis.search.scoring`) is local; the refit decides. It begins at the points of `refit_starts`.

A number of the candidate may end at an end of its search range. An end is either a limit of the parameter itself (friction
is not below 0), where a minimum is as good as any other, or an end of the search only. For the latter, the score test of
the bound shows whether the search stopped short: with r (n,) the residuals and priors, and s_o (n,) the outward derivative
that the unknowns inside their ranges cannot absorb, the sum of squares falls beyond the end by (s_o'r)**2 / |s_o|**2 to
first order (the Lagrange multiplier of the bound; S. D. Silvey, 1959, doi:10.1214/aoms/1177706259).

An amplitude is not shown by the records if it lies so near to its neutral value that the sum of squares rises by a
negligible amount there: with d the distance to neutral, by d**2 |s_o|**2 + 2 d s_o'r to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import process_time
from typing import Literal

import numpy as np

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

# The fall beyond an end, or the rise towards it, from which on it counts, in units of what is left: as `stage.EARNED`.
MISSED = 12.0


def passed_ends(problem: Residuals, numbers: Sequence[EffectNumber], inner: Array, r: Array) -> tuple[str, ...]:
    """The names of those `numbers` that stand at an end of the search, beyond which the sum of squares would fall by more
    than chance, at the optimum `inner` (m,) of a least squares problem with residuals `r` (n,) of the data there."""
    own, ended = {n.name: n for n in numbers}, problem.at_end(inner)
    stopped = [int(k) for k in np.flatnonzero(ended) if problem.columns[k].free.name in own]
    found = []
    for k in stopped:
        high = bool(inner[k] > (problem.low[k] + problem.high[k]) / 2)
        name, span = problem.columns[k].free.name, problem.columns[k].free.range
        limit, end = own[name].limits[high], span.high if high else span.low
        if limit is not None and abs(end - limit) <= AT_END * (span.high - span.low):
            continue
        slope, size = _alone(problem, k, inner, r)
        slope *= 1.0 if high else -1.0
        if slope < 0 < size and slope**2 / size > MISSED * _unit(r):
            found.append(name)
    return tuple(found)


def unshown_amplitudes(problem: Residuals, numbers: Sequence[EffectNumber], inner: Array, r: Array) -> tuple[str, ...]:
    """The names of those amplitudes that the records do not tell from the value at which they make no effect: the neutral
    one, or an end of the range of one that has no neutral value (the smallest gap of a play); `inner` (m,) and `r` (n,) as
    for `passed_ends`."""
    amplitudes = {n.name: n for n in numbers if n.amplitude}
    found = []
    for k, column in enumerate(problem.columns):
        number, span = amplitudes.get(column.free.name), column.free.range
        if number is None:
            continue
        if number.sought is not None:
            ends = [float(problem.low[k]), float(problem.high[k])]
        else:
            ends = [column.inner(number.neutral)] if span.low <= number.neutral <= span.high else []
        slope, size = _alone(problem, k, inner, r)
        ways = [end - float(inner[k]) for end in ends]
        if any(d**2 * size + 2 * d * slope < MISSED * _unit(r) for d in ways):
            found.append(number.name)
    return tuple(dict.fromkeys(found))


def _alone(problem: Residuals, k: int, inner: Array, r: Array) -> tuple[float, float]:
    """(s_o'r, |s_o|**2) of the k-th unknown, s_o (n,) the derivative that the unknowns inside their ranges do not take."""
    J, (prior, priors) = problem.evaluate(inner)[1], problem.priors(inner)
    whole, slopes = np.concatenate([r, prior]), np.vstack([J, priors])
    inside = ~problem.at_end(inner)
    inside[k] = False
    left = slopes[:, k] - slopes[:, inside] @ np.linalg.lstsq(slopes[:, inside], slopes[:, k], rcond=1e-9)[0]
    return float(left @ whole), float(left @ left)


def _unit(r: Array) -> float:
    """What is left per sample, at least the noise."""
    return max(1.0, float(r @ r) / len(r))


FIRST, LAST = 8, 40  # runs of a descent: to compare starts, and to end
# A refit is not followed to its end where its first steps leave all but this share of a chi-square per sample above LARGE.
NOTHING, LARGE = 0.02, 10.0
SECONDS = 60.0  # of this process, after which a refit that has not come far is not followed further
WIDENED = 2  # times that the range of an amplitude is made wider where it ends at its end (see `refit_starts.WIDE`)
ASIDE = 0.02  # share of its range from an end at which a limit stands that is not felt: chi-square rises
UNFELT = 4.0  # by no more than this, two standard deviations, in units of what is left
CLOSE = 1e-8  # changes of the sum of squares at which a refit that is compared closely ends
# Another start than the best is followed to its end where its sum of squares is so many times that of the best by then: from
# a point that is not the same, and from one that may still win.
ANOTHER = (1.001, 3.0)


@dataclass(frozen=True)
class Refit:
    """A candidate after its refit: the values of all that was free (SI), the sum of squares with priors `cost`, chi-square
    per sample on the fitted and the held-out records, the number of unknowns, which of the free parameters ended at an end
    of their range, and the experiment with the candidate in it. `score` is the gain that its score had promised. By `slack`
    the sum of squares on what was held out would fall, more than that of the fit would rise, if all numbers moved as the fit
    lets them (of the trials that are compared closely; see `_Refit.slack`). `begun` are the first steps, from several
    starts, of a refit that may be followed further, the best first; it `falls` where one of them still fell steeply, or
    the best of them stands at an end of an amplitude's range that no declared bound is. `errors` are its predictive
    errors. `beyond` are numbers of the candidate at an end of the range in which they were sought, beyond which the sum of
    squares would fall: it is not the minimum (see `range_ends`), and `unshown` its amplitudes that the records do not tell
    from none. `inner` are the values as unknowns of its least squares
    problem; its runs erred by less than those of the base model by the power `finer` of FINER. It `acts` at some time in the
    fitted records (see `Candidate.acts`). `own` are the values that each record has of its own (SI), by its name. `lent` is
    the label of a further effect that the diagram has beside those of its step."""

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
        """Whether the records tell none of its amplitudes from the value at which it makes no effect: the diagram without it
        would do as well with these values."""
        own = self.candidate.vanishing
        return len(own) > 0 and {n.name for n in own} == {n.name for n in self.candidate.numbers if n.amplitude} \
            and {n.name for n in own} <= set(self.unshown)

    @property
    def bic(self) -> float:
        """n ln(cost/n) + k ln n (G. Schwarz, 1978, doi:10.1214/aos/1176344136), with an unknown scale of the noise."""
        return bic(self.cost, self.samples, self.unknowns)


def bic(cost: float, samples: int, unknowns: int) -> float:
    """The Bayesian information criterion of a fit with Gaussian residuals of unknown size."""
    return float(samples * np.log(max(cost, 1e-300) / samples) + unknowns * np.log(samples))


def begun(base: Base, candidate: Candidate, guesses: Sequence[Score] = (), least: float = 0.0,
          progress: Progress | None = None) -> Refit | None:
    """The first steps of a refit, from the best of several starts; None where the diagram with it cannot be simulated.
    `least` is what the best of other candidates leaves, where that is known."""
    try:
        refit = _RefitProblem(base, candidate, guesses)
        found = refit.begin(least or np.inf, progress or (lambda text: None))
        if not found:
            return None
        trial = refit.judged(found[0].x)
        while trial.cost <= HOPE * (least or np.inf) and refit.rough(trial) and refit.finer < TIMES:
            refit.make_finer()
            found = sorted([refit.descend(found[0].x, progress or (lambda text: None), FIRST, 1e-4), *found[1:]],
                           key=lambda e: e.cost)
            trial = refit.judged(found[0].x)
        falls = any(d.unfinished and made_progress(d.history) for d in found) or bool(refit.wider(found[0].x))
        return replace(trial, begun=tuple(found) if refit.hopeful(found[0]) else (), falls=falls)
    except HeavebondError:
        return None


def followed(base: Base, trial: Refit, guesses: Sequence[Score] = (), progress: Progress | None = None) -> Refit:
    """A refit that was begun, followed until it hardly falls any more."""
    if not trial.begun:
        return trial
    try:
        refit, say = _RefitProblem(base, trial.candidate, guesses, trial.finer), progress or (lambda text: None)
        found = refit.judged(refit.follow(trial.begun, say))
        while refit.rough(found) and refit.finer < TIMES:  # far above the noise, what its runs err by was small
            refit.make_finer()
            found = refit.judged(refit.descend(found.inner, say, LAST, 1e-5, "dogbox").x)
        return found
    except HeavebondError:
        return replace(trial, begun=())


def polished(base: Base, trial: Refit, guesses: Sequence[Score] = (), lender: Refit | None = None,
             progress: Progress | None = None) -> Refit:
    """A refit followed to the end of its valley: what is compared closely must have arrived. A `lender` is another law's
    refit at the same place that fits better; from its values, as far as the two have the same, another valley is sought."""
    refit = _RefitProblem(base, trial.candidate, guesses, trial.finer)
    refit.sought({n.name: trial.experiment.free[n.name].range for n in trial.candidate.numbers if n.name in refit.ranges})
    values = {**trial.values, **_lent(lender, trial.candidate)} if lender is not None else trial.values
    there = [c.inner(trial.own.get(c.record, {}).get(c.free.name, values[c.free.name])) for c in refit.problem.columns]
    start = refit.problem.allowed(np.clip(there, refit.problem.low, refit.problem.high))
    try:
        end = refit.arrive(start, progress or (lambda text: None))
        better = refit.judged(end)
        if lender is not None and better.cost >= trial.cost:
            return trial
        end, better = (end, better) if better.cost < trial.cost else (start, trial)
        return replace(better, slack=refit.slack(end, better.own))
    except HeavebondError:
        return trial


def refitted_from(base: Base, candidate: Candidate, lender: Refit, progress: Progress | None = None) -> Refit | None:
    """A candidate refitted from what a refit of the same law found in another diagram, in the same ranges; None where the
    diagram with it cannot be simulated there."""
    spans = {n.name.rpartition(".")[2]: lender.experiment.free[n.name].range for n in lender.candidate.numbers
             if n.name in lender.experiment.free}
    ranges = {n.name: spans[key] for n in candidate.numbers if (key := n.name.rpartition(".")[2]) in spans}
    return refitted_at(base, candidate, _lent(lender, candidate), ranges, lender.own, progress)


def refitted_at(base: Base, candidate: Candidate, values: Mapping[str, float], ranges: Mapping[str, Range],
                own: Mapping[str, Mapping[str, float]] | None = None, progress: Progress | None = None) -> Refit | None:
    """A candidate refitted from values (SI) of its numbers and of free parameters, of which records may have their `own`;
    its numbers are sought in `ranges`. None where the diagram with it cannot be simulated there."""
    try:
        refit = _RefitProblem(base, candidate, ())
        refit.sought({name: span for name, span in ranges.items() if name in refit.ranges})
        first = base.problem.runs[0].record.name
        start = {name: {**base.problem.values_of(base.inner, name or first), **values, **(own or {}).get(name, {})}
                 for name in {c.record for c in refit.problem.columns}}
        there = [c.inner(start[c.record].get(c.free.name, c.before)) for c in refit.problem.columns]
        end = refit.arrive(refit.problem.allowed(np.clip(there, refit.problem.low, refit.problem.high)),
                           progress or (lambda text: None))
        return refit.judged(end)
    except HeavebondError:
        return None


def at_end_of(base: Base, candidate: Candidate, guesses: Sequence[Score], ranges: Mapping[str, tuple[float, float]],
              inner: Array, finer: int = 0) -> Refit:
    """The figures of a refit that sought the candidate's numbers in these `ranges` and ended at `inner`."""
    refit = _RefitProblem(base, candidate, guesses, finer)
    free = refit.problem.experiment.free
    refit.sought({name: replace(free[name].range, low=low, high=high) for name, (low, high) in ranges.items()})
    return refit.judged(inner)


def _lent(lender: Refit, candidate: Candidate) -> dict[str, float]:
    """The values of a refit for another law: what both diagrams have, and numbers of the laws that have the same name."""
    own = {n.name.rpartition(".")[2]: n.name for n in candidate.numbers}
    numbers = {n.name: n.name.rpartition(".")[2] for n in lender.candidate.numbers}
    found = {name: value for name, value in lender.values.items() if name not in numbers}
    return {**found, **{own[key]: lender.values[name] for name, key in numbers.items()
                        if key in own and name in lender.values}}


class _RefitProblem:
    """The least squares problem of the diagram with the candidate in it."""

    def __init__(self, base: Base, candidate: Candidate, guesses: Sequence[Score], finer: int = 0):
        self.base, self.candidate, self.guesses, self.began = base, candidate, guesses, process_time()
        self.finer, self.errs = 0, 0.0  # how often runs were made finer; the length of what they did to residuals by errors
        changed = base.diagram(candidate.change).experiment
        self.runs = base.runs(candidate.change, [])
        self.starts = RefitStarts(base, candidate, guesses, self.runs)
        self.ranges = dict(self.starts.ranges)
        freed = self._freed(changed, set(self.runs[0].assembly.parameter_values))
        values = self._first_values()
        self.problem = Residuals(freed, runs=[run.again(list(freed.free), values, QuickSimulator) for run in self.runs])
        for _ in range(finer):
            self.make_finer()

    def make_finer(self) -> None:
        """Let all further runs err by less."""
        self.problem, self.finer = finer(self.problem), self.finer + 1
        self.runs = [run.again([], {}, QuickSimulator, of.simulator.tolerances)
                     for run, of in zip(self.runs, self.problem.runs, strict=True)]

    def rough(self, trial: Refit) -> bool:
        """Whether the runs of the search err by more at the end of a trial than is small beside what it leaves, as they may
        where its law changes within milliseconds: descents end in the roughness of the sum of squares then."""
        return self.errs > ERRS * float(np.sqrt(trial.cost))

    def _freed(self, changed: Experiment, known: set[str]) -> Experiment:
        """The experiment with the candidate's numbers free as well, and inside their ranges."""
        place = next(iter(changed.records.values())).place
        numbers, leaves = {n.name: n for n in self.candidate.numbers}, self.runs[0].assembly.flat.expanded.leaves
        free = {name: Free(name, Range(low, high, numbers[name].unit), place, typical=numbers[name].prior(leaves))
                for name, (low, high) in self.ranges.items()}
        kept = {name: f for name, f in changed.free.items() if name in known}
        return replace(changed, model=changed.model.with_parameters(self._first_values()), free={**kept, **free})

    def _first_values(self) -> dict[str, float]:
        """The first guess of the candidate's numbers, inside their ranges and in the order that their law requires."""
        values = {name: float(np.clip(self.starts.plans[0].numbers[name], *self.ranges[name])) for name in self.ranges}
        for leaf in self.runs[0].assembly.flat.expanded.leaves.values():
            for ends in leaf.component.orders:
                high, low = (f"{leaf.path}.{end}" for end in ends)
                if high in values and low in values and values[high] <= values[low]:
                    values[high], values[low] = self.ranges[high][1], self.ranges[low][0]
        return values

    def _start(self, plan: Plan) -> Array:
        """A plan as a point of the problem."""
        there = {(c.free.name, c.record): v for c, v in zip(self.base.problem.columns, plan.base, strict=True)}
        # what has a value of its own for each record now begins at the common one
        there |= {(c.free.name, c.record): there.get((c.free.name, ""), c.inner(c.before)) for c in self.problem.columns
                  if c.free.name in self.candidate.change.each}
        start: Array = np.array([there[c.free.name, c.record] if (c.free.name, c.record) in there else
                          c.inner(float(np.clip(plan.numbers[c.free.name], *self.ranges[c.free.name])))
                          for c in self.problem.columns])
        span = self.problem.high - self.problem.low
        return np.asarray(np.clip(start, self.problem.low + 1e-6 * span, self.problem.high - 1e-6 * span))

    def _residuals(self, inner: Array, runs: Sequence[Run]) -> Array:
        """Of the data (n,) in runs without sensitivities."""
        problem, inner = self.problem, self.problem.allowed(inner)
        return np.concatenate([run.residuals(problem.values_of(inner, run.record.name))[0] for run in runs])

    def _cost(self, inner: Array, most: float = np.inf) -> float:
        """The sum of squares with the priors, by runs without sensitivities; infinite where it is above `most`."""
        problem, prior = self.problem, self.problem.priors(inner)[0]
        cost, inner = float(prior @ prior), problem.allowed(inner)
        try:
            for run in self.runs:
                r = run.residuals(problem.values_of(inner, run.record.name), most - cost)[0]
                cost += float(r @ r)
        except (ModelError, SimulationError, StartError, Exceeded):
            return np.inf
        return cost if cost <= most else np.inf  # (not where it is no number)

    def arrive(self, start: Array, progress: Progress) -> Array:
        """From near an optimum to it."""
        def arrived(start: Array) -> Array:
            return self.problem.minimise(start, False, progress, most=LAST, tolerance=CLOSE, settle=True).x

        return self._further_out(arrived(start), arrived)

    def _further_out(self, inner: Array, descended: Callable[[Array], Array]) -> Array:
        """Further out where an amplitude ends at an end of its range that no declared bound is."""
        for _ in range(WIDENED):
            wider = self.wider(inner)
            if not wider or process_time() - self.began > SECONDS:
                break
            values = [c.outer(v) for c, v in zip(self.problem.columns, inner, strict=True)]
            self.sought(wider)
            inner = descended(np.array([c.inner(v) for c, v in zip(self.problem.columns, values, strict=True)]))
        return inner

    def wider(self, inner: Array) -> dict[str, Range]:
        """Wider ranges for amplitudes that ended at an end of theirs."""
        found = {}
        numbers = {n.name: n for n in self.candidate.vanishing}
        for column, value, low, high in zip(self.problem.columns, inner, self.problem.low, self.problem.high, strict=True):
            number, span = numbers.get(column.free.name), column.free.range
            if number is None or min(value - low, high - value) >= AT_END * (high - low):
                continue
            ends = [number.neutral + WIDE * (end - number.neutral) for end in (span.low, span.high)]
            wider = replace(span, low=ends[0] if number.low is None else max(number.low, ends[0]),
                            high=ends[1] if number.high is None else min(number.high, ends[1]))
            if (value > (low + high) / 2 and wider.high > span.high) or (value < (low + high) / 2 and wider.low < span.low):
                found[number.name] = wider
        return found

    def sought(self, ranges: Mapping[str, Range]) -> None:
        """Seek some numbers in other ranges from now on."""
        experiment = self.problem.experiment
        free = {name: replace(f, range=ranges[name]) if name in ranges else f for name, f in experiment.free.items()}
        self.ranges |= {name: (span.low, span.high) for name, span in ranges.items()}
        now, runs = self.problem.runs[0].assembly.parameter_values, self.problem.runs
        moved = {name: float(np.clip(now[name], span.low, span.high)) for name, span in ranges.items()
                 if not span.low <= now[name] <= span.high}
        if moved:  # a first guess outside of the ranges
            runs = [run.again(run.names, moved, QuickSimulator) for run in runs]
        self.problem = Residuals(replace(experiment, free=free), runs=runs)

    def _out_of_the_way(self, inner: Array) -> Array:
        """With limits that the fitted samples hardly feel (a stop that is not reached, or by one sample) at that end
        of their range, or near it, where they are not felt either: other records go further. A time at which something
        begins goes to an end where that makes no difference: it acts in the whole record, or not at all."""
        cost = self._cost(inner)
        # residuals are in units of the noise: a fit far below it (a record without noise) feels nothing but rounding
        felt = UNFELT * max(cost / self.base.r.size, 1.0)
        limits = {n.name for n in self.candidate.numbers if not n.amplitude and n.sought is not None and n.sought.seen}
        for k, column in enumerate(self.problem.columns):
            shares = (1 - ASIDE, ASIDE) if column.free.name in limits else \
                (1.0, 0.0) if column.record and is_instant(self.problem.experiment.model, column.free.name) else ()
            for share in shares:
                there = inner.copy()
                there[k] = self.problem.low[k] + share * (self.problem.high[k] - self.problem.low[k])
                if self._cost(there, cost + felt) <= cost + felt:
                    inner = there
                    break
        return inner

    def begin(self, least: float, progress: Progress) -> list[Descent]:
        """The first steps from the best starts, that which leaves least first; none where no start can be simulated."""
        starts = list({start.tobytes(): start for start in map(self._start, self.starts.plans)}.values())
        number = 3 if len(starts) > FURTHER else 2
        costs: list[float] = []
        for start in starts:  # a run is ended where it can no longer be among the best
            costs.append(self._cost(start, sorted(costs)[number - 1] if len(costs) >= number else np.inf))
        chosen = [starts[k] for k in np.argsort(costs, kind="stable") if np.isfinite(costs[k])][:number]
        if not chosen or process_time() - self.began > SECONDS:
            return []
        # beside a candidate that takes most of the misfit, one that takes nothing in its first steps is no rival
        nothing = self._nothing if least < DECISION.mainly * self.base.cost else np.inf
        enough = stop_inferior_starts(self.problem.high - self.problem.low, least, nothing)
        found = [self.descend(start, progress, FIRST, 1e-4, enough=enough) for start in chosen]
        if all(2 * e.cost > self.base.cost for e in found) and (beside := self.starts.beside) is not None:
            found.append(self.descend(self._start(beside), progress, FIRST, 1e-4, enough=enough))
        return sorted(found, key=lambda e: e.cost)

    def follow(self, begun: Sequence[Descent], progress: Progress) -> Array:
        """The best of what was begun, and another that is near it, to the end."""
        first, *others = begun
        ends = [first, *(e for e in others if ANOTHER[0] < e.cost / first.cost < ANOTHER[1])][:2]
        ends = [self.descend(e.x, progress, LAST, 1e-5) if e.unfinished else e for e in ends]
        best = min(ends, key=lambda e: e.cost)
        if self.problem.at_end(best.x).any():  # the reflective method may stop there though other unknowns could move on
            best = min(best, self.descend(best.x, progress, LAST, 1e-5, "dogbox"), key=lambda e: e.cost)
        return self._out_of_the_way(self._further_out(best.x, lambda start: self.descend(start, progress, LAST, 1e-5).x))

    def hopeful(self, first: Descent) -> bool:
        """Whether its first steps have taken anything of a large misfit away, and did not take too long."""
        return process_time() - self.began <= SECONDS and 2 * first.cost <= self._nothing

    @property
    def _nothing(self) -> float:
        """The sum of squares above which a refit takes nothing of a large misfit away; infinite beside a small one."""
        r = self.base.r
        whole = float(r @ r)
        return (1 - NOTHING) * whole if whole > LARGE * len(r) else np.inf

    def descend(self, start: Array, progress: Progress, most: int, tolerance: float,
                method: Literal["trf", "dogbox"] = "trf", enough: Enough = stop_stalled) -> Descent:
        """Steps that find their way from afar, until they hardly bring anything more."""
        return self.problem.descend(start, False, progress, most=most, tolerance=tolerance, method=method,
                                    enough=enough, promise=LITTLE)

    def judged(self, inner: Array) -> Refit:
        """The figures at the end, from runs of IDAS."""
        problem, inner = self.problem, self.problem.allowed(inner)
        exact = exact_runs(problem.experiment, self.runs, self.base.exact)
        r, prior = self._residuals(inner, [exact[run.record.name] for run in self.runs]), problem.priors(inner)[0]
        self.errs = float(np.linalg.norm(r - problem.evaluate(inner)[0]))
        values = [problem.values_of(inner, run.record.name) for run in problem.runs]
        held_out = own_starts_of(problem, inner, exact)
        errors = predictive_errors(problem, inner, exact, r, held_out)
        each = {name for name, f in problem.experiment.free.items() if f.each}
        own = {run.record.name: {name: there[name] for name in each}
               for run, there in zip(problem.runs, values, strict=True)}
        sought = sum(is_instant(problem.experiment.model, name) for there in held_out.values() for name in there)
        at_end = tuple(c.free.name for c, end in zip(problem.columns, problem.at_end(inner), strict=True)
                       if end and c.free.name not in {*self.ranges, *self.candidate.change.each})
        return Refit(self.candidate, problem.experiment, values[0], float(r @ r + prior @ prior), float(r @ r) / len(r),
                     errors.mean(SELECTION, TEST), len(r), errors.samples(SELECTION, TEST), len(inner) + sought, at_end,
                     max((g.gain for g in self.guesses), default=float("nan")),
                     problem.evaluations, errors=errors, beyond=passed_ends(problem, self.candidate.numbers, inner, r),
                     unshown=unshown_amplitudes(problem, self.candidate.numbers, inner, r), inner=inner,
                     finer=self.finer, acts=self._acts(inner, exact), own={**own, **held_out} if each else {})

    def _acts(self, inner: Array, exact: Mapping[str, Run]) -> bool:
        """Whether the effect acts in a fitted record; one that says nothing of this always does."""
        for run in (exact[run.record.name] for run in self.runs) if self.candidate.acts else ():
            result = run.simulator.run(self.problem.values_of(inner, run.record.name))
            if np.any(Probe(run.assembly, [self.candidate.acts], si=True).values(result) > 0):
                return True
        return not self.candidate.acts

    def slack(self, inner: Array, own: Mapping[str, Mapping[str, float]]) -> float:
        """What the numbers' own uncertainty does to the figure on what was held out. With r (n,) and J (n, m) the residuals
        there and their derivatives, F the information of the fit with its priors, and steps d of what is not at an end of
        its range,

            |r|**2 - min over d of |r + J d|**2 + d'F d  =  (J'r)' (J'J + F)**-1 J'r,

        so that |r|**2 less this is what a fit to all samples at once would add, as far as the tangent holds."""
        problem = self.problem
        moving = np.flatnonzero(~problem.at_end(inner))
        fitted = np.vstack([problem.evaluate(inner)[1], problem.priors(inner)[1]])[:, moving]
        r, J = self._checked(inner, own)
        J = J[:, moving]
        normal, slope = fitted.T @ fitted + J.T @ J, J.T @ r
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        return float(slope / scale @ np.linalg.lstsq(normal / scale[:, None] / scale, slope / scale, rcond=1e-12)[0])

    def _checked(self, inner: Array, own: Mapping[str, Mapping[str, float]]) -> tuple[Array, Array]:
        """Residuals (n,) of all samples that are held out, and their derivatives (n, m) to the inner unknowns; `own` are the
        values that records have of their own."""
        problem, names = self.problem, list(self.problem.experiment.free)
        exact = exact_runs(problem.experiment, self.runs, self.base.exact)
        parts, blocks = [np.zeros(0)], [np.zeros((0, len(inner)))]
        for record in problem.experiment.records.values():
            values = problem.values_of(inner, record.name)
            if record.use != "fit":
                values.update(own.get(record.name, {}))
            wrong, moved = exact[record.name].again(names, values, QuickSimulator).held_out(values)
            block = np.zeros((len(wrong), len(inner)))
            for k, column in enumerate(problem.columns):
                if column.record in ("", record.name):
                    block[:, k] = moved[names.index(column.free.name)] * column.slope(inner[k])
            parts.append(wrong)
            blocks.append(block)
        return np.concatenate(parts), np.vstack(blocks)
