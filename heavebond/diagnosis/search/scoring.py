"""Score of each candidate: how much of the misfit it could explain, from the exact sensitivity to its amplitude at zero.

With r (n,) the residuals of the data over their noise at the base model's optimum, J (n, m) their derivatives to the free
parameters and s (n,) those to the amplitude a of a candidate that is in the diagram at a = 0,

    s_o = s - J (J'J + P)^-1 J's,     z = -s_o'r / |s_o|,     gain = z**2 (0 if the sign is not allowed),

is the score (Lagrange multiplier) test: P holds the priors of the free parameters. If nothing is missing, z is normal with
variance 1; with an amplitude a its mean is a |s_o| (the noncentrality), which says how large an effect must be to be seen.
C. R. Rao (1948), doi:10.1017/S0305004100023987.

A score is local: after a strong misfit it orders the work and names the family rather than the law. An amplitude that is
too small to be seen may already change how the machine moves (a leakage that is the only way out of a chamber). If the
tangent turns before the effect can be seen, the tangent at a visible amplitude is a second score. There every tangent is
compared with the secant, and the secant replaces a tangent that promised more.

Some candidates make the diagram singular at zero: at R = 0 a pressure loss R between two volumes makes their pressures
equal, and no equation gives the flow between them. Such amplitudes are tried over decades around the natural size of their
place. With X the span of the across variable of the node there and Y the largest through variable of the port in the base
model, the dimension of the amplitude gives the powers in X**a * Y**b: X/Y for R, X/Y**2 for a turbulent loss.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.units import Dimension, Range, times
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber, quantity
from heavebond.diagnosis.search.base_model import Base, SharedDiagram, plain_residuals, responses, sensitivities, values_at
from heavebond.equations.places import nodes_of
from heavebond.estimation.residuals import Run
from heavebond.language.definition import SearchRange
from heavebond.language.edits import Change
from heavebond.language.symbols import kinked
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe

# Of the natural size: below the first the two ends are one for all that is measured, above the last next to nothing passes.
LOWEST, HIGHEST = 1e-5, 10.0
POWERS = ((1, -1), (-1, 1), (1, -2))  # of X and Y: a resistance, a conductance, a resistance to the square


def from_finite_amplitudes(base: Base, candidate: Candidate) -> Candidate | None:
    """The candidate with all its amplitudes sought around the natural size of its place; None where it does not stand in
    series with a port, nothing moves there, or an amplitude is of another kind."""
    if candidate.attaches != "in series":
        return None
    sizes = _sizes(base, candidate)
    ranges = {n.name: (LOWEST * size, HIGHEST * size) for n in candidate.vanishing
              if (size := sizes.get(n.unit.dimension)) is not None}
    return ranged(candidate, ranges) if len(ranges) == len(candidate.vanishing) else None


def ranged(candidate: Candidate, ranges: Mapping[str, tuple[float, float]]) -> Candidate:
    """The candidate with amplitudes that are sought in these ranges (SI) instead of from zero on."""
    return replace(candidate, numbers=tuple(
        replace(n, sought=SearchRange(Range(*ranges[n.name], n.unit), "")) if n.name in ranges else n
        for n in candidate.numbers))


def _sizes(base: Base, candidate: Candidate) -> dict[Dimension, float]:
    """The natural sizes at the place of a candidate by their dimensions; none where nothing moves."""
    run = base.problem.runs[0]
    node = nodes_of(run.assembly.flat).get(candidate.where[0])
    port = next((end.lstrip("-") for ends in candidate.change.nodes.values() for end in ends if end.startswith("-")), "")
    if node is None or port not in node.ports:
        return {}
    names = [f"{node.name}.{node.across}", f"{port}.{node.through}"]
    members = node.domain.members[node.across].unit.dimension, node.domain.members[node.through].unit.dimension
    courses = [Probe(r.assembly, names, si=True).values(r.simulator.run(values_at(base, r, {}))) for r in base.problem.runs]
    across, through = np.hstack(courses)
    x, y = float(np.ptp(across)), float(np.abs(through).max())
    if not (x > 0 and y > 0):
        return {}
    return {times(times((), members[0], a), members[1], b): x**a * y**b for a, b in POWERS}


# Of a direction less than this share is left when what is free has taken its part: the candidate acts as the free
# parameters do, and no record can tell them apart.
SAME = 1e-3
# Share of the amplitude that would move the channels by the whole misfit, at which the tangent beside a kink is taken.
BESIDE = 1e-3
# z from which one effect is seen, at whose amplitude a second tangent is taken; and the cosine of the two (what free
# parameters take left out) above which they are one: the second would tell 1 % more of the misfit.
SEEN, TURNED = 5.0, 0.995
# The secant at that amplitude checks both tangents: they are wrong where it brings less than either by more than this share,
# as the derivative of a weak effect of a stiff machine may be numerical noise. Then the secant at a larger amplitude takes
# their place, so many decades larger at most, until the effect is seen.
AGREES, DECADES = 0.2, 15
# What is sought where the motion of the base model goes is sought this share of its span beyond: the machine and other
# records move further, and a limit that is not reached must not stand where they do.
BEYOND = 0.5
# A motion is taken to begin at zero where its smallest value is less than this share of the largest: of a magnitude that
# passes zero the smallest sample tells how near to zero one came to lie, and points between the two would all be small.
PASSES = 1e-3
# The size of an amplitude for error control: it moves the channels by so many times the misfit. With 10 the tangents of a
# stiff rig err by 1 % in runs of a third more evaluations, with 1 by 5 %, with 0.01 by as much as they are. It is sought in
# so many runs at most, until one changes it by less than a factor.
SIZED, RUNS, STAYS = 10.0, 6, 3.0
# A difference of two runs of the search is nothing where it is below so many times the error of one: the two err alike or
# apart, up to twice as much.
ROUGH = 2.0


# Shares of the duration at which the step of a parameter in time is scored: the tangent of a step tells where it must move
# only as far as its width.
INSTANTS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True)
class Score:
    """One candidate at one choice of its shapes: z (see the module), the amplitude that the score asks for, `step` of the
    free parameters with it (in inner unknowns), the size |s| of its direction and the share of it that the free parameters
    do not take; `direction` (n,) is s_o / |s_o|, and s / |s| where the free parameters take it all. An unseen one moves no
    channel beyond a thousandth of the noise. Of several amplitudes those `along` are moved, which have one unit (a stiffness
    and a damping have no common size). A law with a kink at amplitude zero, or whose tangent turns near it, has another
    tangent on either `side` (1, -1; 0: at zero), each with its own score."""

    candidate: Candidate
    shapes: Mapping[str, float]
    z: float
    amplitude: float
    step: Array
    size: float
    share: float
    direction: Array
    along: tuple[str, ...] = ()
    side: int = 0

    @property
    def gain(self) -> float:
        """How much chi-square it would take away, as far as the tangent holds."""
        return self.z**2 if self.z > 0 or self.signed else 0.0

    @property
    def signed(self) -> bool:
        """Whether the amplitude may have either sign."""
        return self.side == 0 and any(may_be_below_neutral(n) for n in _amplitudes_of(self))

    @property
    def told_apart(self) -> bool:
        """Whether the records see it as anything but the free parameters."""
        return self.size > 0 and self.share > SAME


def scored(base: Base, candidate: Candidate, shared: SharedDiagram | None = None) -> list[Score]:
    """The scores of one candidate at a few choices of its shapes; none where the diagram with it cannot be simulated. Where
    it is one of several in a `shared` diagram, its runs are made with that, the others asleep; where it cannot be simulated
    at amplitude zero, from finite amplitudes on."""
    if candidate.differs:
        return _of_records(base, candidate)
    found = _scored_from_zero(base, candidate, shared)
    if found or not candidate.vanishes or (finite := from_finite_amplitudes(base, candidate)) is None:
        return found
    return _all_scores(base, finite, lambda one, names: base.runs(one.change, names))


def _of_records(base: Base, candidate: Candidate) -> list[Score]:
    """The score of a parameter with a value of its own for each record. Its directions are the derivatives to the
    parameter on one record each; together they take away the projection of the residual on what the free parameters leave
    of them."""
    (name, _), = candidate.change.each.items()
    columns = [k for k, column in enumerate(base.problem.columns) if column.free.name == name]
    try:
        whole = base.J[:, columns[0]] if columns else sensitivities(base, base.runs(Change(), [name]), {})[name]
    except HeavebondError:
        return []
    ends = np.cumsum([0, *(int(run.counts.sum()) for run in base.problem.runs)])
    own = np.zeros((len(whole), len(ends) - 1))
    for k in range(own.shape[1]):
        own[ends[k]:ends[k + 1], k] = whole[ends[k]:ends[k + 1]]
    left = np.column_stack([base.split(column)[0] for column in own.T])
    common, least = left.sum(axis=1), SAME * float(np.linalg.norm(whole))
    if float(np.linalg.norm(common)) > least:  # another value on all records alike is no difference between them
        left = left - np.outer(common, common @ left / (common @ common))
    basis, sizes, _ = np.linalg.svd(left, full_matrices=False)
    basis = basis[:, sizes > max(least, 1e-300)]
    taken = basis @ (basis.T @ base.r)
    z = float(np.linalg.norm(taken))
    if z == 0:
        return []
    return [Score(candidate, {}, z, z / float(sizes[0]), np.zeros(len(base.inner)), float(np.linalg.norm(whole)),
                  float(sizes[0]) / float(np.linalg.norm(whole)), -taken / z)]


def _scored_from_zero(base: Base, candidate: Candidate, shared: SharedDiagram | None) -> list[Score]:
    """The scores where zero is a value like others."""
    sleeping = base.sleeping(shared, candidate.label)
    if shared is None or sleeping is None:
        return _all_scores(base, candidate, lambda one, names: base.runs(one.change, names))
    own = shared.member(candidate.label)
    found = _all_scores(base, own, lambda _, names: [run.again(names, {}, QuickSimulator) for run in sleeping])
    name = {there.name: here.name for there, here in zip(own.numbers, candidate.numbers, strict=True)}
    return [replace(s, candidate=candidate, shapes={name[n]: value for n, value in s.shapes.items()},
                    along=tuple(name[n] for n in s.along)) for s in found]


def _all_scores(base: Base, candidate: Candidate, prepared: Callable[[Candidate, list[str]], list[Run]]) -> list[Score]:
    """The scores by the `prepared` runs of a candidate with sensitivities to some of its numbers."""
    try:
        moving = [n.name for n in candidate.vanishing]
        runs = prepared(candidate, moving)
        settled = _settled(candidate, runs, base)
        if settled is not candidate:
            candidate = settled
            runs = prepared(candidate, moving)
        points = shape_points(candidate, runs, base)
    except HeavebondError:
        return []
    found = []
    kink, sizes = _kinked(base, candidate), dict[str, float]()
    for shapes in points:
        try:
            if candidate.vanishes:
                runs, moved, sizes = _tangents(base, candidate, runs, shapes, kink, sizes)
                found += [score for first in _at_zero(base, candidate, moved, shapes)
                          for score in _on_sides(base, first, runs, kink)]
            else:
                found.append(_scored(base, candidate, shapes, _difference(base, runs, shapes), ROUGH * base.error))
        except HeavebondError:  # this choice of the shapes cannot be simulated
            continue
    return found


def _neutral(candidate: Candidate) -> dict[str, float]:
    """The amplitudes where the effect is absent."""
    return {n.name: n.neutral for n in candidate.vanishing}


def _tangents(base: Base, candidate: Candidate, runs: list[Run], shapes: Mapping[str, float], kink: bool,
              sizes: Mapping[str, float]) -> tuple[list[Run], dict[str, Array], dict[str, float]]:
    """d r / d a (n,) for each amplitude at zero, runs whose error control knows how large amplitudes are, and these sizes;
    `sizes` are those that the error control of the given runs knows, from another choice of the shapes. It takes one
    that is zero for one unit; what 1 N of friction does to a machine of 100 t is less than the integrator errs by, and the
    tangent would be that; what 1 m3/(s Pa) of a leakage does is so much that the runs would be finer than they need be."""
    there = {**_neutral(candidate), **shapes}
    moved = sensitivities(base, runs, there)
    zero = {n.name: n for n in candidate.vanishing if n.neutral == 0}
    sizes = {**dict.fromkeys(zero, 1.0), **sizes}
    for _ in range(RUNS):
        lengths = {name: float(np.linalg.norm(moved[name])) for name in zero}
        steps = {name: SIZED * float(np.linalg.norm(base.r)) / length for name, length in lengths.items() if length > 0}
        steps = {name: min(step, zero[name].high or np.inf) for name, step in steps.items()}
        settled = all(step < STAYS * sizes[name] for name, step in steps.items())
        fine = settled and all(step * STAYS > sizes[name] for name, step in steps.items())
        if fine or (settled and kink):  # runs beside a kink must not step over where the law changes
            break
        sizes |= steps
        runs = [run.again(run.names, sizes, QuickSimulator) for run in runs]
        if settled:  # the tangent is finer than it need be, and so would the runs beside it be
            break
        moved = sensitivities(base, runs, there)
    return runs, moved, sizes


def _at_zero(base: Base, candidate: Candidate, moved: Mapping[str, Array], shapes: Mapping[str, float]) -> list[Score]:
    """The scores at amplitude zero, where d r / d a is `moved`: amplitudes of one unit move together. Those that have the
    value of an old parameter instead of zero move alone: together they are another value of that parameter."""
    together: dict[tuple[Dimension, str], list[str]] = {}
    for number in candidate.vanishing:
        together.setdefault((number.unit.dimension, number.name if number.neutral_of else ""), []).append(number.name)
    return [replace(_scored(base, candidate, shapes, np.sum([moved[name] for name in names], axis=0)), along=tuple(names))
            for names in together.values()]


def may_be_below_neutral(number: EffectNumber) -> bool:
    """Whether it is an amplitude that may be less than neutral."""
    return number.amplitude and (number.low is None or number.low < number.neutral)


def admissible_sides(amplitudes: Sequence[EffectNumber]) -> tuple[int, ...]:
    """The sides of neutral (1, -1) on which they may be, together."""
    return (1, -1) if any(map(may_be_below_neutral, amplitudes)) else (1,)


def _kinked(base: Base, candidate: Candidate) -> bool:
    """Whether its law has a kink at amplitude zero."""
    amplitudes = {n.name.rpartition(".")[2]: n for n in candidate.vanishing}
    component = base.problem.experiment.model.library.component(candidate.component)
    return any(kinked(side, amplitudes) for line in component.equations for side in (line.tree.left, line.tree.right))


def _on_sides(base: Base, at_zero: Score, runs: Sequence[Run], kink: bool) -> list[Score]:
    """The score at amplitude zero and those beside it that say something else. At a kink these stand alone: they are taken
    at so small an amplitude that it does next to nothing, since the derivative at the kink itself is of neither side (of a
    valve whose edges shut at the same point, a thousand times that of either)."""
    amplitudes = _amplitudes_of(at_zero)
    if at_zero.size == 0 or not amplitudes or not (kink or at_zero.told_apart):
        return [at_zero]
    step = BESIDE * float(np.linalg.norm(base.r)) / at_zero.size if kink else SEEN / (at_zero.size * at_zero.share)
    beside, seen, wrong = [], [], 0
    for side in admissible_sides(amplitudes):
        with suppress(HeavebondError):  # so much cannot be simulated, or is more than there may be
            found, effect = _beside(base, at_zero, runs, side * step)
            if not kink and _promised_more(base, step * min(at_zero.size, found.size), effect) \
                    and (secant := _secant(base, at_zero, runs, side * step)) is not None:
                wrong += 1
                seen.append(secant)
            else:
                beside.append(found)
    if kink:
        return beside
    tangent = [] if wrong == len(admissible_sides(amplitudes)) else [at_zero]
    return [*tangent, *(s for s in beside if _turned(s, at_zero)), *seen]


def _promised_more(base: Base, promised: float, effect: Array) -> bool:
    """Whether an effect (n,) is less than promised by either of the tangents at its ends, which no smooth law is."""
    return float(np.linalg.norm(effect)) < promised - max(AGREES * promised, ROUGH * base.error)


def _secant(base: Base, at_zero: Score, runs: Sequence[Run], step: float) -> Score | None:
    """The score from the secant at an amplitude, decades beyond `step` beside neutral, where the effect can be seen; None
    where none can be simulated."""
    side = 1 if step > 0 else -1
    ends = [(n.high if side > 0 else n.low, n.neutral) for n in _amplitudes_of(at_zero)]
    most = min((abs(end - neutral) for end, neutral in ends if end is not None), default=np.inf)
    if most <= abs(step):
        return None
    plain = [run.again([], {}, QuickSimulator) for run in runs]
    found, size = None, abs(step)
    for _ in range(DECADES):
        size = min(10 * size, most)
        try:
            effect = plain_residuals(base, plain, _at(at_zero, side * size)) - base.quick
        except HeavebondError:
            break
        found = _scored(base, at_zero.candidate, at_zero.shapes, effect / size, ROUGH * base.error / size)
        if size * found.size >= SEEN or size >= most:
            break
    return None if found is None else replace(found, amplitude=side * found.amplitude, along=at_zero.along, side=side)


def _at(score: Score, step: float) -> dict[str, float]:
    """The values of a score's candidate with its amplitudes `step` beside neutral."""
    return {**_neutral(score.candidate), **score.shapes, **{n.name: n.neutral + step for n in _amplitudes_of(score)}}


def _turned(one: Score, other: Score) -> bool:
    """Whether two scores of a candidate are about different directions."""
    return one.size > 0 and float(one.side * one.direction @ other.direction) < TURNED


def _beside(base: Base, at_zero: Score, runs: Sequence[Run], step: float) -> tuple[Score, Array]:
    """The score from the tangent at an amplitude, and the effect (n,) of that on the residuals."""
    side = 1 if step > 0 else -1
    r, moved = responses(base, runs, _at(at_zero, step))
    s = side * np.sum([moved[name] for name in at_zero.along], axis=0)
    found = _scored(base, at_zero.candidate, at_zero.shapes, s)
    return replace(found, amplitude=side * found.amplitude, along=at_zero.along, side=side), r - base.quick


def _amplitudes_of(score: Score) -> list[EffectNumber]:
    """The amplitudes that a score moves."""
    return [n for n in score.candidate.numbers if n.name in score.along]


def _settled(candidate: Candidate, runs: Sequence[Run], base: Base) -> Candidate:
    """The candidate with the numbers that are held at what the motion says (`middle s`) set to it, and no longer sought."""
    held = {n.name: n for n in candidate.numbers if n.sought is not None and n.sought.held}
    values = {}
    seen = motion_ranges(list(held.values()), runs, base)
    for name, number in held.items():
        assert number.sought is not None
        low, high = seen[name]
        said = {"middle": (low + high) / 2, "half": (high - low) / 2, "peak": max(abs(low), abs(high))}
        values[name] = quantity(said[number.sought.held], number.unit)
    return holding(candidate, values)


def holding(candidate: Candidate, values: Mapping[str, str]) -> Candidate:
    """The candidate with numbers set to values, as they are written, and no longer sought."""
    if not values:
        return candidate
    return replace(candidate, change=candidate.change.with_values(values),
                   numbers=tuple(n for n in candidate.numbers if n.name not in values))


def _difference(base: Base, runs: Sequence[Run], shapes: Mapping[str, float]) -> Array:
    """What an effect that has no zero does to the residuals (n,) from a finite value on: the secant in place of the
    tangent, so that an amplitude of 1 is that value."""
    return plain_residuals(base, runs, shapes) - base.quick


def _scored(base: Base, candidate: Candidate, shapes: Mapping[str, float], s: Array, least: float = 0.0) -> Score:
    """The score along s (n,); one no larger than `least` is taken for the errors of the integrator. (Of a tangent there is
    none: what an amplitude does not move has the derivative 0, and how small another one is depends on its unit alone.)"""
    with np.errstate(over="ignore"):  # a run that went astray
        size = float(np.linalg.norm(s))
    if not np.isfinite(size) or size <= least:
        return Score(candidate, shapes, 0.0, 0.0, np.zeros(len(base.inner)), 0.0, 0.0, np.zeros(0))
    left, step = base.split(s)
    length = float(np.linalg.norm(left))
    z = float(-left @ base.r / length) if length > SAME * size else 0.0
    amplitude = z / length if length > 0 else 0.0
    direction = left / length if length > SAME * size else s / size
    return Score(candidate, shapes, z, amplitude, step * amplitude, size, length / size, direction)


def shape_points(candidate: Candidate, runs: Sequence[Run], base: Base) -> list[dict[str, float]]:
    """Choices of the shape parameters (see `points_within`) by the motion in these runs."""
    return points_within(candidate, motion_ranges(candidate.numbers, runs, base))


def points_within(candidate: Candidate, motions: Mapping[str, tuple[float, float]]) -> list[dict[str, float]]:
    """Choices of the shape parameters: points along the diagonal of their ranges, in logarithms above zero. Where the motion
    alone leaves no range (a limit above zero of what moves below zero only), that of a refit. `motions` as from
    `motion_ranges`."""
    ranges = _ranges_within(candidate, motions, 0.0)
    if any(n.sought is not None and n.name not in ranges for n in candidate.numbers):
        ranges = {**_ranges_within(candidate, motions, BEYOND), **ranges}
    if not ranges:
        return [{}]
    found = []
    signed = any(low < 0 < high for low, high in ranges.values())
    for share in INSTANTS if candidate.attaches == "parameter" else \
            (0.1, 0.5, 0.9) if not candidate.vanishes else (0.25, 0.5, 0.75) if signed else (0.25, 0.75):
        point = {name: point_of_range(low, high, share) for name, (low, high) in ranges.items()}
        for high_one, low_one in candidate.orders:  # a pair of limits is drawn together from outside
            for name, part in ((high_one, 1 - share / 2), (low_one, share / 2)):
                if name in ranges:
                    point[name] = point_of_range(*ranges[name], part)
        found.append(point)
    return found


def point_of_range(low: float, high: float, share: float) -> float:
    """A point of a range: geometric above zero."""
    return float(low * (high / low) ** share) if low > 0 else float(low + (high - low) * share)


def shape_ranges(candidate: Candidate, runs: Sequence[Run], base: Base, beyond: float = 0.0
                 ) -> dict[str, tuple[float, float]]:
    """Where each shape is sought; `seen s` by the motion of s in the base model, and a share `beyond` of its span
    further."""
    return _ranges_within(candidate, motion_ranges(candidate.numbers, runs, base), beyond)


def _ranges_within(candidate: Candidate, seen: Mapping[str, tuple[float, float]], beyond: float
                   ) -> dict[str, tuple[float, float]]:
    found = {}
    for number in candidate.numbers:
        if number.sought is None:
            continue
        if number.sought.range is not None:
            low, high = number.sought.range.low, number.sought.range.high
        else:
            low, high = seen[number.name]
            low = 0.0 if 0 < low < PASSES * high else low
            low, high = low - beyond * (high - low), high + beyond * (high - low)
        low = max(low, number.low) if number.low is not None else low
        high = min(high, number.high) if number.high is not None else high
        if high > low:
            found[number.name] = (low, high)
    return found


def motion_ranges(numbers: Sequence[EffectNumber], runs: Sequence[Run], base: Base) -> dict[str, tuple[float, float]]:
    """For each number that is sought or held by the motion of a variable, between what values that moves in the base
    model."""
    variables = {n.name: n.motions for n in numbers if n.follows}
    if not variables:
        return {}
    names = list(dict.fromkeys(name for motions in variables.values() for name in motions))
    courses = np.hstack([Probe(run.assembly, names, si=True).values(run.simulator.run(values_at(base, run, {})))
                         for run in runs])
    ends = {name: (float(course.min()), float(course.max())) for name, course in zip(names, courses, strict=True)}
    return {name: (min(ends[m][0] for m in motions), max(ends[m][1] for m in motions))
            for name, motions in variables.items()}
