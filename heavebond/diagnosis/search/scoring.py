"""Score of each candidate: how much of the misfit it could explain, from the exact sensitivity to its amplitude at zero.

Let r (n,) be the residuals of the data over their noise at the base model's optimum, J (n, m) their derivatives with respect
to the free parameters, and s (n,) their derivative with respect to the amplitude a of a candidate that is in the diagram at
a = 0. P holds the priors of the free parameters. The score (Lagrange multiplier) test is

    s_o = s - J (J'J + P)^-1 J's,     z = -s_o'r / |s_o|,     gain = z**2 (0 if the sign is not allowed).

If no effect is missing, z is normal with variance 1. With an amplitude a, its mean is a |s_o| (the noncentrality). This
gives the size that an effect must have to be detected. C. R. Rao (1948), doi:10.1017/S0305004100023987.

A score is local. After a strong misfit it determines the order of the refits, and identifies the family rather than the law.
An amplitude that is too small to be detected may already change the motion of the machine (a leakage that is the only path
out of a chamber). If the tangent turns before the effect can be detected, the tangent at a detectable amplitude gives a
second score. There each tangent is compared with the secant, and the secant replaces a tangent that predicted more.

Some candidates make the diagram singular at zero. A pressure loss R = 0 between two volumes makes their pressures equal, and
no equation gives the flow between them. Such amplitudes are tried over decades around the natural size of their place.
The natural size is X**a * Y**b. X is the span of the across variable of the node, and Y the largest through variable of the
port in the base model. The dimension of the amplitude determines the exponents: X/Y for R, X/Y**2 for a turbulent loss.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.units import Dimension, Range, times
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber, quantity
from heavebond.diagnosis.search.base_model import (
    ROUGH,
    Base,
    SharedDiagram,
    plain_residuals,
    responses,
    sensitivities,
    values_at,
)
from heavebond.equations.places import nodes_of
from heavebond.estimation.residuals import Run
from heavebond.language.definition import SearchRange
from heavebond.language.edits import Change
from heavebond.language.symbols import kinked
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.result import Probe

# Multiples of the natural size: below LOWEST both sides are equal in all measurements, above HIGHEST the flow is negligible.
LOWEST, HIGHEST = 1e-5, 10.0
POWERS = ((1, -1), (-1, 1), (1, -2))  # exponents of X and Y: a resistance, a conductance, a quadratic resistance


def from_finite_amplitudes(base: Base, candidate: Candidate) -> Candidate | None:
    """The candidate with finite search ranges of all amplitudes, around the natural size of its place. None if it is not
    in series with a port, if the variables there do not change, or if an amplitude has another dimension than those in
    `POWERS`."""
    if candidate.attaches != "in series":
        return None
    run = base.problem.runs[0]
    node = nodes_of(run.assembly.flat).get(candidate.where[0])
    port = next((end.lstrip("-") for ends in candidate.change.nodes.values() for end in ends if end.startswith("-")), "")
    sizes: dict[Dimension, float] = {}  # natural sizes of amplitudes by their dimension
    if node is not None and port in node.ports:
        names = [f"{node.name}.{node.across}", f"{port}.{node.through}"]
        members = node.domain.members[node.across].unit.dimension, node.domain.members[node.through].unit.dimension
        across, through = np.hstack([Probe(r.assembly, names, si=True).values(r.simulator.run(values_at(base, r, {})))
                                     for r in base.problem.runs])
        x, y = float(np.ptp(across)), float(np.abs(through).max())
        if x > 0 and y > 0:
            sizes = {times(times((), members[0], a), members[1], b): x**a * y**b for a, b in POWERS}
    ranges = {n.name: (LOWEST * size, HIGHEST * size) for n in candidate.vanishing
              if (size := sizes.get(n.unit.dimension)) is not None}
    return ranged(candidate, ranges) if len(ranges) == len(candidate.vanishing) else None


def ranged(candidate: Candidate, ranges: Mapping[str, tuple[float, float]]) -> Candidate:
    """The candidate with these search ranges (SI) of its amplitudes, in place of ranges that begin at zero."""
    return replace(candidate, numbers=tuple(
        replace(n, sought=SearchRange(Range(*ranges[n.name], n.unit), "")) if n.name in ranges else n
        for n in candidate.numbers))


# Smallest share of a direction that the free parameters cannot explain. Below it, the candidate has the same influence as
# the free parameters, and the records cannot distinguish them.
SAME = 1e-3
# Amplitude at which the tangent next to a kink is computed, as a share of the amplitude whose effect is as large as the
# misfit.
BESIDE = 1e-3
# A second tangent is computed at the amplitude with z = SEEN, at which the effect is clearly detected. It is dropped if its
# cosine with the first tangent (both without the part that the free parameters explain) exceeds TURNED, because it would
# then explain at most 1 % more of the misfit.
SEEN, TURNED = 5.0, 0.995
# The secant at that amplitude checks both tangents. They are wrong if both exceed the secant by more than the share AGREES;
# for example, the derivative of a weak effect in a stiff machine may be numerical noise. A secant at a larger amplitude then
# replaces them. The amplitude is increased until the effect is detected, by at most DECADES decades.
AGREES, DECADES = 0.2, 15
# The range of a number that is searched within the motion of the base model is extended by this share of its span: the
# machine and other records may move further, and a limit that is not reached must lie outside their motion.
BEYOND = 0.5
# Distance of the points at which an effect without amplitude zero is scored, in decades of its widest range.
DECADES_APART = 3.0
# The lower end of a range of motion is set to zero if it is less than this share of the upper end. The smallest sample of a
# magnitude that passes through zero is arbitrary, and a logarithmic scale from there would yield small values only.
PASSES = 1e-3
# The size of an amplitude for error control is SIZED times the amplitude whose effect is as large as the misfit. The error
# of the tangents of a stiff rig is 1 % with 10 (and a third more evaluations), 5 % with 1, and 100 % with 0.01. The size is
# iterated in at most RUNS runs, until it changes by less than the factor STAYS.
SIZED, RUNS, STAYS = 10.0, 6, 3.0


# Shares of the duration at which the step of a parameter in time is scored. The tangent with respect to the time of a step
# is valid only within the width of the step.
INSTANTS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True)
class Score:
    """Score of one candidate at one choice of its shapes.

    z: see the module. `amplitude` is the amplitude that the score suggests, `step` (m,) the change of the free parameters
    with it (in unknowns of the optimiser). `size` is |s|. `share` is |s_o| / |s|, the share of the direction that the free
    parameters cannot explain. `direction` (n,) is s_o / |s_o|, or s / |s| if the free parameters explain all of it. `along`
    are the amplitudes that are moved together; they have the same unit, as a stiffness and a damping have no common size.
    `side` is 0 for the tangent at zero. A law with a kink at amplitude zero, or whose tangent turns near zero, has separate
    tangents and scores on the sides 1 and -1.
    """

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
        """The reduction of chi-square to first order."""
        return self.z**2 if self.z > 0 or self.signed else 0.0

    @property
    def signed(self) -> bool:
        """True if the amplitude may have either sign."""
        return self.side == 0 and any(may_be_below_neutral(n) for n in _amplitudes_of(self))

    @property
    def told_apart(self) -> bool:
        """True if the records distinguish the effect from changes of the free parameters."""
        return self.size > 0 and self.share > SAME


def scored(base: Base, candidate: Candidate, shared: SharedDiagram | None = None) -> list[Score]:
    """Compute the scores of one candidate at a few choices of its shapes.

    If the candidate is in a `shared` diagram, this diagram is simulated with the other candidates inactive. If the diagram
    cannot be simulated at amplitude zero, finite amplitudes are used. The list is empty if no simulation succeeds.
    """
    if candidate.differs:
        return _of_records(base, candidate)
    sleeping = base.sleeping(shared, candidate.label)
    if shared is None or sleeping is None:
        scores = _all_scores(base, candidate, lambda one, names: base.runs(one.change, names))
    else:
        member = shared.member(candidate.label)
        of_member = _all_scores(base, member, lambda _, names: [run.again(names, {}, QuickSimulator) for run in sleeping])
        name = {of_part.name: number.name for of_part, number in zip(member.numbers, candidate.numbers, strict=True)}
        scores = [replace(s, candidate=candidate, shapes={name[n]: value for n, value in s.shapes.items()},
                          along=tuple(name[n] for n in s.along)) for s in of_member]
    if scores or not candidate.vanishes or (finite := from_finite_amplitudes(base, candidate)) is None:
        return scores
    return _all_scores(base, finite, lambda one, names: base.runs(one.change, names))


def _of_records(base: Base, candidate: Candidate) -> list[Score]:
    """The score of a parameter that has a separate value in each record. Each direction is the derivative with respect to
    the parameter in one record, without the part that the free parameters explain. The gain is the squared length of the
    projection of the residual on all directions."""
    (name, _), = candidate.change.each.items()
    columns = [k for k, column in enumerate(base.problem.columns) if column.free.name == name]
    try:
        whole = base.J[:, columns[0]] if columns else sensitivities(base, base.runs(Change(), [name]), {})[name]
    except HeavebondError:
        return []
    ends = np.cumsum([0, *(int(run.counts.sum()) for run in base.problem.runs)])
    per_record = np.zeros((len(whole), len(ends) - 1))
    for k in range(per_record.shape[1]):
        per_record[ends[k]:ends[k + 1], k] = whole[ends[k]:ends[k + 1]]
    projected = np.column_stack([base.split(column)[0] for column in per_record.T])
    common, least = projected.sum(axis=1), SAME * float(np.linalg.norm(whole))
    if float(np.linalg.norm(common)) > least:  # a common change in all records is not a difference between them
        projected = projected - np.outer(common, common @ projected / (common @ common))
    basis, sizes, _ = np.linalg.svd(projected, full_matrices=False)
    basis = basis[:, sizes > max(least, 1e-300)]
    explained = basis @ (basis.T @ base.r)
    z = float(np.linalg.norm(explained))
    if z == 0:
        return []
    return [Score(candidate, {}, z, z / float(sizes[0]), np.zeros(len(base.inner)), float(np.linalg.norm(whole)),
                  float(sizes[0]) / float(np.linalg.norm(whole)), -explained / z)]


def _all_scores(base: Base, candidate: Candidate, prepared: Callable[[Candidate, list[str]], list[Run]]) -> list[Score]:
    """The scores of a candidate at all choices of its shapes. `prepared` returns runs with sensitivities to the numbers
    of the candidate that it receives."""
    try:
        moving = [n.name for n in candidate.vanishing]
        runs = prepared(candidate, moving)
        settled = _settled(candidate, runs, base)
        if settled is not candidate:
            candidate = settled
            runs = prepared(candidate, moving)
        points = points_within(candidate, motion_ranges(candidate.numbers, runs, base))
    except HeavebondError:
        return []
    scores = []
    # the law of the candidate may have a kink at amplitude zero
    amplitudes = {n.name.rpartition(".")[2]: n for n in candidate.vanishing}
    component = base.problem.experiment.model.library.component(candidate.component)
    kink = any(kinked(side, amplitudes) for line in component.equations for side in (line.tree.left, line.tree.right))
    # Amplitudes of one unit are moved together. Amplitudes whose neutral value is the value of a replaced parameter are
    # moved one at a time, because moving them together is the same as changing that parameter.
    together: dict[tuple[Dimension, str], list[str]] = {}
    for number in candidate.vanishing:
        together.setdefault((number.unit.dimension, number.name if number.neutral_of else ""), []).append(number.name)
    sizes: dict[str, float] = {}
    for shapes in points:
        try:
            if candidate.vanishes:
                runs, slopes, sizes = _tangents(base, candidate, runs, shapes, kink, sizes)
                for names in together.values():
                    at_zero = _scored(base, candidate, shapes, np.sum([slopes[name] for name in names], axis=0))
                    scores += _on_sides(base, replace(at_zero, along=tuple(names)), runs, kink)
            else:
                # no tangent: an amplitude of 1 is the effect at a finite value of its numbers
                change = plain_residuals(base, runs, shapes) - base.quick
                scores.append(_scored(base, candidate, shapes, change, ROUGH * base.error))
        except HeavebondError:  # the diagram cannot be simulated at this choice of the shapes
            continue
    return scores


def _tangents(base: Base, candidate: Candidate, runs: list[Run], shapes: Mapping[str, float], kink: bool,
              sizes: Mapping[str, float]) -> tuple[list[Run], dict[str, Array], dict[str, float]]:
    """Compute the derivatives dr/da (n,) at zero for each amplitude, with error control that is scaled to the amplitudes.

    The results are the runs, the derivatives, and the amplitude sizes used in the error control. `sizes` are the sizes from
    another choice of the shapes. Without sizes, the error control would use 1 unit for an amplitude that is zero. The effect
    of 1 N of friction on a machine of 100 t is below the integration error, so that the tangent would be numerical noise.
    The effect of 1 m3/(s Pa) of leakage is so large that the runs would be unnecessarily accurate.
    """
    point = {**{n.name: n.neutral for n in candidate.vanishing}, **shapes}
    slopes = sensitivities(base, runs, point)
    zero = {n.name: n for n in candidate.vanishing if n.neutral == 0}
    sizes = {**dict.fromkeys(zero, 1.0), **sizes}
    for _ in range(RUNS):
        lengths = {name: float(np.linalg.norm(slopes[name])) for name in zero}
        steps = {name: SIZED * float(np.linalg.norm(base.r)) / length for name, length in lengths.items() if length > 0}
        steps = {name: min(step, zero[name].high or np.inf) for name, step in steps.items()}
        settled = all(step < STAYS * sizes[name] for name, step in steps.items())
        fine = settled and all(step * STAYS > sizes[name] for name, step in steps.items())
        if fine or (settled and kink):  # runs next to a kink need steps that resolve the change of the law
            break
        sizes |= steps
        runs = [run.again(run.names, sizes, QuickSimulator) for run in runs]
        if settled:  # the tangent is more accurate than necessary; later runs use the new sizes
            break
        slopes = sensitivities(base, runs, point)
    return runs, slopes, sizes


def may_be_below_neutral(number: EffectNumber) -> bool:
    """True if the number is an amplitude that may be below its neutral value."""
    return number.amplitude and (number.low is None or number.low < number.neutral)


def admissible_sides(amplitudes: Sequence[EffectNumber]) -> tuple[int, ...]:
    """The sides of the neutral value (1: above, -1: below) that the bounds of these amplitudes allow."""
    return (1, -1) if any(map(may_be_below_neutral, amplitudes)) else (1,)


def _on_sides(base: Base, at_zero: Score, runs: Sequence[Run], kink: bool) -> list[Score]:
    """The score at amplitude zero, and the scores from both sides of zero if they differ from it.

    For a law with a kink, only the scores from the sides are returned. They are taken at an amplitude that is so small that
    its effect is negligible. The derivative at the kink itself belongs to neither side. For example, for a valve whose edges
    close at the same point, it is a thousand times the derivative on either side.
    """
    amplitudes = _amplitudes_of(at_zero)
    if at_zero.size == 0 or not amplitudes or not (kink or at_zero.told_apart):
        return [at_zero]
    step = BESIDE * float(np.linalg.norm(base.r)) / at_zero.size if kink else SEEN / (at_zero.size * at_zero.share)
    beside, secants, wrong = [], [], 0
    for side in admissible_sides(amplitudes):
        with suppress(HeavebondError):  # the amplitude cannot be simulated or exceeds its bound
            side_score, effect = _beside(base, at_zero, runs, side * step)
            # a smooth law cannot give less than the tangents at zero and at this amplitude promise
            promised = step * min(at_zero.size, side_score.size)
            if not kink and float(np.linalg.norm(effect)) < promised - max(AGREES * promised, ROUGH * base.error) \
                    and (secant := _secant(base, at_zero, runs, side * step)) is not None:
                wrong += 1
                secants.append(secant)
            else:
                beside.append(side_score)
    if kink:
        return beside
    tangent = [] if wrong == len(admissible_sides(amplitudes)) else [at_zero]
    turned = [s for s in beside if s.size > 0 and float(s.side * s.direction @ at_zero.direction) < TURNED]
    return [*tangent, *turned, *secants]


def _secant(base: Base, at_zero: Score, runs: Sequence[Run], step: float) -> Score | None:
    """The score from the secant at an amplitude that is large enough for the effect to be detected, up to `DECADES`
    decades above `step`. None if no amplitude can be simulated."""
    side = 1 if step > 0 else -1
    ends = [(n.high if side > 0 else n.low, n.neutral) for n in _amplitudes_of(at_zero)]
    most = min((abs(end - neutral) for end, neutral in ends if end is not None), default=np.inf)
    if most <= abs(step):
        return None
    plain = [run.again([], {}, QuickSimulator) for run in runs]
    score, size = None, abs(step)
    for _ in range(DECADES):
        size = min(10 * size, most)
        try:
            effect = plain_residuals(base, plain, _at(at_zero, side * size)) - base.quick
        except HeavebondError:
            break
        score = _scored(base, at_zero.candidate, at_zero.shapes, effect / size, ROUGH * base.error / size)
        if size * score.size >= SEEN or size >= most:
            break
    return None if score is None else replace(score, amplitude=side * score.amplitude, along=at_zero.along, side=side)


def _at(score: Score, step: float) -> dict[str, float]:
    """The values of the candidate's numbers with the amplitudes at their neutral values plus `step`."""
    neutral = {n.name: n.neutral for n in score.candidate.vanishing}
    return {**neutral, **score.shapes, **{n.name: n.neutral + step for n in _amplitudes_of(score)}}


def _beside(base: Base, at_zero: Score, runs: Sequence[Run], step: float) -> tuple[Score, Array]:
    """The score from the tangent at an amplitude `step` from the neutral value, and the effect (n,) of this amplitude on
    the residuals."""
    side = 1 if step > 0 else -1
    r, slopes = responses(base, runs, _at(at_zero, step))
    s = side * np.sum([slopes[name] for name in at_zero.along], axis=0)
    score = _scored(base, at_zero.candidate, at_zero.shapes, s)
    return replace(score, amplitude=side * score.amplitude, along=at_zero.along, side=side), r - base.quick


def _amplitudes_of(score: Score) -> list[EffectNumber]:
    """The amplitudes that a score moves."""
    return [n for n in score.candidate.numbers if n.name in score.along]


def _settled(candidate: Candidate, runs: Sequence[Run], base: Base) -> Candidate:
    """The candidate with its held numbers fixed at the value that the motion of the base model gives (`middle s`,
    `half s` or `peak s`)."""
    held = {n.name: n for n in candidate.numbers if n.sought is not None and n.sought.held}
    values = {}
    motions = motion_ranges(list(held.values()), runs, base)
    for name, number in held.items():
        values[name] = quantity(value_held(number, motions[name]), number.unit)
    return holding(candidate, values)


def value_held(number: EffectNumber, motion: tuple[float, float]) -> float:
    """The value of a held number for a motion from the smallest to the largest value."""
    assert number.sought is not None
    low, high = motion
    return {"middle": (low + high) / 2, "half": (high - low) / 2, "peak": max(abs(low), abs(high))}[number.sought.held]


def holding(candidate: Candidate, values: Mapping[str, str]) -> Candidate:
    """The candidate with these numbers fixed at `values` (with units, as text) and excluded from the search."""
    if not values:
        return candidate
    return replace(candidate, change=candidate.change.with_values(values),
                   numbers=tuple(n for n in candidate.numbers if n.name not in values))


def _scored(base: Base, candidate: Candidate, shapes: Mapping[str, float], s: Array, least: float = 0.0) -> Score:
    """The score along s (n,). If |s| is at most `least`, s is treated as the error of the integrator and the score is
    zero. Tangents need no such limit: the derivative with respect to an amplitude without effect is exactly 0, and the
    size of other derivatives depends on the unit of the amplitude."""
    with np.errstate(over="ignore"):  # a run that diverged
        size = float(np.linalg.norm(s))
    if not np.isfinite(size) or size <= least:
        return Score(candidate, shapes, 0.0, 0.0, np.zeros(len(base.inner)), 0.0, 0.0, np.zeros(0))
    projected, step = base.split(s)
    length = float(np.linalg.norm(projected))
    z = float(-projected @ base.r / length) if length > SAME * size else 0.0
    amplitude = z / length if length > 0 else 0.0
    direction = projected / length if length > SAME * size else s / size
    return Score(candidate, shapes, z, amplitude, step * amplitude, size, length / size, direction)


def points_within(candidate: Candidate, motions: Mapping[str, tuple[float, float]]) -> list[dict[str, float]]:
    """Choices of the shape parameters: points along the diagonal of their ranges, in logarithms if a range is above zero.
    In place of a part, shapes of either sign are also taken with the opposite one.

    `motions` are ranges of motion as from `motion_ranges`. If the motion alone gives an empty range (a limit that must be
    positive for a variable that is always negative), the extended range of a refit is used.
    """
    ranges = ranges_within(candidate, motions, 0.0)
    if any(n.sought is not None and n.name not in ranges for n in candidate.numbers):
        ranges = {**ranges_within(candidate, motions, BEYOND), **ranges}
    if not ranges:
        return [{}]
    points = []
    both_signs = {name for name, (low, high) in ranges.items() if low < 0 < high}
    signed = bool(both_signs)
    for share in INSTANTS if candidate.attaches == "parameter" else np.linspace(0.1, 0.9, _points(ranges)) \
            if not candidate.vanishes else (0.25, 0.5, 0.75) if signed else (0.25, 0.75):
        point = {name: point_of_range(low, high, share) for name, (low, high) in ranges.items()}
        for high_one, low_one in candidate.orders:  # a pair of limits is moved from the ends of the range inwards
            for name, part in ((high_one, 1 - share / 2), (low_one, share / 2)):
                if name in ranges:
                    point[name] = point_of_range(*ranges[name], part)
        points.append(point)
        # a depth or a position in a part may be on either side, whatever the size of the other shapes is
        if candidate.attaches == "replaces" and candidate.vanishing and 0 < len(both_signs) < len(ranges) and share != 0.5:
            points.append(point | {name: point_of_range(*ranges[name], 1 - share) for name in both_signs})
    return points


def _points(ranges: Mapping[str, tuple[float, float]]) -> int:
    """The number of points along the diagonal of the ranges: at least 3, and one in `DECADES_APART` decades."""
    decades = max((np.log10(high / low) for low, high in ranges.values() if low > 0), default=0.0)
    return max(3, int(np.ceil(decades / DECADES_APART)))


def point_of_range(low: float, high: float, share: float) -> float:
    """The point at `share` of a range, on a logarithmic scale if the range is above zero."""
    return float(low * (high / low) ** share) if low > 0 else float(low + (high - low) * share)


def ranges_within(candidate: Candidate, motions: Mapping[str, tuple[float, float]], beyond: float
                  ) -> dict[str, tuple[float, float]]:
    """Search range of each shape. For a shape with `seen s`, the range is the motion of s (`motions`, as from
    `motion_ranges`), extended at both ends by the share `beyond` of its span. With `beyond` 0 it is the range of scores."""
    ranges = {}
    for number in candidate.numbers:
        if number.sought is None:
            continue
        if number.sought.range is not None:
            given = number.sought.range if beyond or number.sought.scored is None else number.sought.scored
            low, high = given.low, given.high
        else:
            low, high = motions[number.name]
            low = 0.0 if 0 < low < PASSES * high else low
            low, high = low - beyond * (high - low), high + beyond * (high - low)
        low = max(low, number.low) if number.low is not None else low
        high = min(high, number.high) if number.high is not None else high
        if high > low:
            ranges[number.name] = (low, high)
    return ranges


def motion_ranges(numbers: Sequence[EffectNumber], runs: Sequence[Run], base: Base) -> dict[str, tuple[float, float]]:
    """The smallest and largest value, in the base model, of the variables whose motion gives the search range or the
    fixed value of a number. The result has one entry for each such number."""
    variables = {n.name: n.motions for n in numbers if n.follows}
    if not variables:
        return {}
    names = list(dict.fromkeys(name for motions in variables.values() for name in motions))
    courses = np.hstack([Probe(run.assembly, names, si=True).values(run.simulator.run(values_at(base, run, {})))
                         for run in runs])
    ends = {name: (float(course.min()), float(course.max())) for name, course in zip(names, courses, strict=True)}
    return {name: (min(ends[m][0] for m in motions), max(ends[m][1] for m in motions))
            for name, motions in variables.items()}
