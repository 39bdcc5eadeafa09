"""How much of a misfit each candidate could explain, from its amplitude's exact sensitivity at zero.

With r (n,) the residuals of the data over their noise at the base model's optimum, J (n, m) their derivatives with respect
to what is free already and s (n,) those to the amplitude a of a candidate that stands in the diagram at a = 0,

    s_o = s - J (J'J + P)^-1 J's,     z = -s_o'r / |s_o|,     gain = z**2 (0 where the sign is not allowed),

is the score (Lagrange multiplier) test: P holds the priors of the free parameters. Where nothing is missing z is normal
with variance 1; with an amplitude a its mean is a |s_o| (the noncentrality), which says how large an effect must be to be
seen. C. R. Rao (1948), doi:10.1017/S0305004100023987. A score is local: after a strong misfit it orders the work and
names the family rather than the law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from heavebond.catalogue import Candidate, Sized, quantity
from heavebond.dae import Array
from heavebond.errors import HeavebondError
from heavebond.experiment import Experiment
from heavebond.quick import QuickSimulator
from heavebond.residuals import Residuals, Run
from heavebond.simulation import Simulator, Tolerances
from heavebond.symbols import kinked

# A search needs no more: at these the run errs by less than a tenth of the noise, which every refit would absorb.
SEARCH = Tolerances(1e-5, 1e-7)
# Of a direction less than this share is left when what is free has taken its part: the candidate acts as the free
# parameters do, and no record can tell them apart.
SAME = 1e-3
# Share of the amplitude that would move the channels by the whole misfit, at which the tangent beside a kink is taken.
BESIDE = 1e-3
# A direction smaller than this share of the channels themselves is the rounding of the integrator.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Score:
    """One candidate at one choice of its shapes: z (see the module), the amplitude that the score asks for, `step` of the
    free parameters with it (in inner unknowns), the size |s| of its direction and the share of it that the free parameters
    do not take; `direction` (n,) is s_o / |s_o|. An unseen one moves no channel beyond a thousandth of the noise. A law
    with a kink at amplitude zero has another tangent on either `side` (1, -1; 0: one for both), each with its own score."""

    candidate: Candidate
    shapes: Mapping[str, float]
    z: float
    amplitude: float
    step: Array
    size: float
    share: float
    direction: Array
    side: int = 0

    @property
    def gain(self) -> float:
        """How much chi-square it would take away, as far as the tangent holds."""
        return self.z**2 if self.z > 0 or self.signed else 0.0

    @property
    def signed(self) -> bool:
        """Whether the amplitude may have either sign."""
        return self.side == 0 and self.candidate.vanishes and any(_below(n) for n in self.candidate.numbers)

    @property
    def told_apart(self) -> bool:
        """Whether the records see it as anything but the free parameters."""
        return self.size > 0 and self.share > SAME


def searched(experiment: Experiment) -> Residuals:
    """The least squares problem of an experiment with runs for a search."""
    fitted = [r for r in experiment.records.values() if r.use == "fit"]
    return Residuals(experiment, runs=[Run(experiment, record, list(experiment.free), SEARCH, kind=QuickSimulator)
                                       for record in fitted])


def exact_runs(experiment: Experiment, fitted: Sequence[Run], like: Mapping[str, Run] | None = None) -> dict[str, Run]:
    """Runs of all records by IDAS; those fitted as given, of the others those of another diagram (`like`) may be there."""
    own = {run.record.name: run.again([], {}, Simulator) for run in fitted}
    like = like or {}
    return {name: own.get(name) or Run(experiment, record, [], SEARCH, like=like.get(name))
            for name, record in experiment.records.items()}


@dataclass(frozen=True)
class Base:
    """The base model at its optimum: residuals r (n,) by IDAS and `quick` by the integrator of the search, Jacobian J
    (n, m), the derivatives of the priors (priors, m), the inner unknowns (m,), the size of all channels over their noise,
    and runs of all records by IDAS."""

    problem: Residuals
    inner: Array
    r: Array
    quick: Array
    J: Array
    priors: Array
    signals: float
    exact: Mapping[str, Run]

    @classmethod
    def at(cls, problem: Residuals, inner: Array) -> Base:
        """The base at a point of its least squares problem."""
        J = problem.evaluate(inner)[1]
        exact = exact_runs(problem.experiment, problem.runs)
        r = np.concatenate([exact[run.record.name].residuals(problem.values_of(inner, run.record.name))[0]
                            for run in problem.runs])
        quick = np.concatenate([run.again([], {}, QuickSimulator).residuals(problem.values_of(inner, run.record.name))[0]
                                for run in problem.runs])
        y = np.concatenate([(run.measured / run.noise[:, None])[run.counts] for run in problem.runs])
        return cls(problem, inner, r, quick, J, problem.priors(inner)[1], float(np.linalg.norm(r + y)), exact)

    def runs(self, changed: Experiment, names: Sequence[str]) -> list[Run]:
        """The fitted records with another diagram, whose parameters `names` are to be moved."""
        return [Run(changed, run.record, list(names), SEARCH, kind=QuickSimulator, like=run) for run in self.problem.runs]

    @cached_property
    def cost(self) -> float:
        """The sum of squares of data and priors."""
        prior = self.problem.priors(self.inner)[0]
        return float(self.r @ self.r + prior @ prior)

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """The free parameters (indices) that are not held by an end of their range: one that is can take nothing more."""
        return np.flatnonzero(~self.problem.at_end(self.inner))

    def split(self, s: Array) -> tuple[Array, Array]:
        """s without what the free parameters take of it, and the step of theirs that takes it: (n,), (m,)."""
        J, priors = self.J[:, self.moving], self.priors[:, self.moving]
        normal = J.T @ J + priors.T @ priors
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        step = np.zeros(len(self.inner))
        step[self.moving] = np.linalg.lstsq(normal / scale[:, None] / scale, J.T @ s / scale, rcond=1e-12)[0] / scale
        return s - self.J @ step, -step


def scored(base: Base, candidate: Candidate) -> list[Score]:
    """The scores of one candidate at a few choices of its shapes; none where the diagram with it cannot be simulated."""
    try:
        changed = candidate.change.on_experiment(base.problem.experiment)
        moving = [n.name for n in candidate.vanishing]
        runs = base.runs(changed, moving)
        settled = _settled(candidate, runs, base)
        if settled is not candidate:
            candidate = settled
            runs = base.runs(candidate.change.on_experiment(base.problem.experiment), moving)
        points = shape_points(candidate, runs, base)
    except HeavebondError:
        return []
    found = []
    sides = _sides(base, candidate)
    for shapes in points:
        try:
            s = _direction(base, runs, shapes) if candidate.vanishes else _difference(base, runs, shapes)
            first = _scored(base, candidate, shapes, s)
            found += [_beside(base, first, runs, side) for side in sides] if first.size > 0 and sides else [first]
        except HeavebondError:  # this choice of the shapes cannot be simulated
            continue
    return found


def _below(number: Sized) -> bool:
    """Whether it is an amplitude that may be less than neutral."""
    return number.amplitude and (number.low is None or number.low < number.neutral)


def _sides(base: Base, candidate: Candidate) -> tuple[int, ...]:
    """On which sides of amplitude zero tangents are to be taken; none where its law has no kink there."""
    amplitudes = {n.name.rpartition(".")[2]: n for n in candidate.vanishing}
    component = base.problem.experiment.model.library.component(candidate.component)
    if not any(kinked(side, amplitudes) for line in component.equations for side in (line.tree.left, line.tree.right)):
        return ()
    return (1, -1) if any(_below(n) for n in amplitudes.values()) else (1,)


def _beside(base: Base, at_zero: Score, runs: Sequence[Run], side: int) -> Score:
    """The score from a tangent at so small an amplitude that it does next to nothing: at a kink itself the derivative is
    of neither side (of a valve whose edges shut at the same point, a thousand times that of either)."""
    candidate = at_zero.candidate
    step = side * BESIDE * float(np.linalg.norm(base.r)) / at_zero.size
    moved = {n.name: n.neutral + step for n in candidate.vanishing}
    found = _scored(base, candidate, at_zero.shapes, side * _direction(base, runs, {**at_zero.shapes, **moved}))
    return replace(found, amplitude=side * found.amplitude, side=side)


def _settled(candidate: Candidate, runs: Sequence[Run], base: Base) -> Candidate:
    """The candidate with the numbers that are held at what the motion says (`middle s`) set to it, and no longer sought."""
    held = {n.name: n for n in candidate.numbers if n.sought is not None and n.sought.held}
    values = {}
    for name, number in held.items():
        assert number.sought is not None
        low, high = _seen(name, number.sought.seen, runs, base)
        said = {"middle": (low + high) / 2, "half": (high - low) / 2, "peak": max(abs(low), abs(high))}
        values[name] = quantity(said[number.sought.held], number.unit)
    if not held:
        return candidate
    return replace(candidate, change=candidate.change.with_values(values),
                   numbers=tuple(n for n in candidate.numbers if n.name not in held))


def _difference(base: Base, runs: Sequence[Run], shapes: Mapping[str, float]) -> Array:
    """What an effect that has no zero does to the residuals (n,) from a finite value on: the secant in place of the
    tangent, so that an amplitude of 1 is that value."""
    return np.concatenate([run.residuals(_values(base, run, shapes))[0] for run in runs]) - base.quick


def _values(base: Base, run: Run, more: Mapping[str, float]) -> dict[str, float]:
    """The base's values that the changed diagram has, and `more`."""
    known = run.assembly.parameter_values
    values = base.problem.values_of(base.inner, run.record.name)
    return {**{name: value for name, value in values.items() if name in known}, **more}


def _direction(base: Base, runs: Sequence[Run], shapes: Mapping[str, float]) -> Array:
    """d r / d a (n,) along all amplitudes together."""
    return np.concatenate([run.residuals(_values(base, run, shapes))[1].sum(axis=0) for run in runs])


def _scored(base: Base, candidate: Candidate, shapes: Mapping[str, float], s: Array) -> Score:
    with np.errstate(over="ignore"):  # a run that went astray
        size = float(np.linalg.norm(s))
    if not np.isfinite(size) or size <= ROUNDING * base.signals:
        return Score(candidate, shapes, 0.0, 0.0, np.zeros(len(base.inner)), 0.0, 0.0, np.zeros(0))
    left, step = base.split(s)
    length = float(np.linalg.norm(left))
    z = float(-left @ base.r / length) if length > SAME * size else 0.0
    amplitude = z / length if length > 0 else 0.0
    return Score(candidate, shapes, z, amplitude, step * amplitude, size, length / size, left / max(length, 1e-300))


def shape_points(candidate: Candidate, runs: Sequence[Run], base: Base) -> list[dict[str, float]]:
    """Choices of the shape parameters: points along the diagonal of their ranges, in logarithms above zero."""
    ranges = shape_ranges(candidate, runs, base)
    if not ranges:
        return [{}]
    found = []
    signed = any(low < 0 < high for low, high in ranges.values())
    for share in (0.1, 0.5, 0.9) if not candidate.vanishes else (0.25, 0.5, 0.75) if signed else (0.25, 0.75):
        point = {name: between(low, high, share) for name, (low, high) in ranges.items()}
        for high_one, low_one in candidate.orders:  # a pair of limits is drawn together from outside
            for name, part in ((high_one, 1 - share / 2), (low_one, share / 2)):
                if name in ranges:
                    point[name] = between(*ranges[name], part)
        found.append(point)
    return found


def between(low: float, high: float, share: float) -> float:
    """A point of a range: geometric above zero."""
    return float(low * (high / low) ** share) if low > 0 else float(low + (high - low) * share)


def shape_ranges(candidate: Candidate, runs: Sequence[Run], base: Base) -> dict[str, tuple[float, float]]:
    """Where each shape is sought; `seen s` by the motion of s in the base model."""
    found = {}
    for number in candidate.numbers:
        if number.sought is None:
            continue
        if number.sought.range is not None:
            low, high = number.sought.range.low, number.sought.range.high
        else:
            low, high = _seen(number.name, number.sought.seen, runs, base)
        low = max(low, number.low) if number.low is not None else low
        high = min(high, number.high) if number.high is not None else high
        if high > low:
            found[number.name] = (low, high)
    return found


def _seen(name: str, variable: str, runs: Sequence[Run], base: Base) -> tuple[float, float]:
    ends = []
    for run in runs:
        course = run.simulator.run(_values(base, run, {}))[f"{name.rpartition('.')[0]}.{variable}"]
        ends += [float(course.min()), float(course.max())]
    return min(ends), max(ends)

