"""Starting points and stopping rules for the refits of candidates.

A refit starts from several points. The first is the optimum of the base model plus the step that the scores suggest. Others
use the initial values of the free parameters, amplitudes whose effect is as large as the whole misfit, and several times
these amplitudes. For a law with several shape parameters, further choices are spread over their ranges.

A stopping rule is a function of the sums of squares of all runs so far and of the best unknowns (see `Residuals.descend`).
It ends a descent that has converged, that repeats another descent, or that cannot reach the best candidate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.scoring import (
    BEYOND,
    Score,
    admissible_sides,
    may_be_below_neutral,
    motion_ranges,
    point_of_range,
    ranges_within,
)
from heavebond.estimation.residuals import ARRIVED, GIVEN_UP, Run
from heavebond.numerics.dae import Array

# A descent has converged if IDLE runs in a row lowered the sum of squares by less than the share LITTLE: it is at the
# minimum within the errors of the runs, or it creeps. Candidates near the best one are later followed to full convergence.
IDLE, LITTLE = 4, 1e-3
# After MIDWAY runs a descent is ended if it repeats another one: its unknowns and its sum of squares at this run agree with
# the other descent within the share MEETS of each range and of the sum of squares.
MIDWAY, MEETS = 4, 0.03
# It is also given up if its sum of squares is then more than HOPE times the smallest one of other candidates, or if it has
# not reduced a misfit that another candidate mostly explains. Exception: its last two steps halved it (STEEP).
HOPE, STEEP = 10.0, 0.5

Enough = Callable[[Sequence[float], Array], str]


def stop_stalled(costs: Sequence[float], best: Array) -> str:
    """Stopping rule: end a descent whose sum of squares has almost stopped falling."""
    return ARRIVED if len(costs) > IDLE and min(costs[:-IDLE]) - min(costs) < LITTLE * min(costs) else ""


def made_progress(costs: Sequence[float]) -> bool:
    """True if the last two steps of a descent reduced the sum of squares to less than the share `STEEP`. `costs` holds the
    smallest sum after each step."""
    return len(costs) > 2 and costs[-1] < STEEP * costs[-3]


def stop_inferior_starts(spans: Array, least: float, nothing: float = np.inf) -> Enough:
    """Stopping rule for the first steps from several starts of one candidate, used for one start after the other.

    `spans` (m,) are the ranges of the unknowns. `least` is the sum of squares of the best other candidate. A descent that is
    at `nothing` or above after `MIDWAY` runs is also given up.
    """
    midway: list[tuple[float, Array]] = []  # sum of squares and unknowns of each descent after MIDWAY runs

    def enough(costs: Sequence[float], best: Array) -> str:
        history = list(accumulate(costs, min))
        if len(costs) >= MIDWAY and history[-1] > min(HOPE * least, nothing) and not made_progress(history):
            return GIVEN_UP
        if len(costs) == MIDWAY:
            if any(abs(history[-1] - cost) < MEETS * cost and float(np.max(np.abs(best - point) / spans)) < MEETS
                   for cost, point in midway):
                return ARRIVED
            midway.append((history[-1], best))
        return stop_stalled(costs, best)

    return enough


# Search range of an amplitude, as a multiple of the amplitude whose effect (by the tangent at zero) is as large as the whole
# misfit. If the amplitude ends at an end of this range, the range is widened by the same factor.
WIDE = 30.0
STARTS = (0.15, 0.5, 0.85)  # shares of the ranges of shapes
APART = 1.5  # start of an amplitude that must be above another one, as a multiple of the other one
SMALL = 0.02  # share of the amplitude suggested by a score, for an additional start
INSIDE = 0.4  # share of a bounded range of an amplitude, for an additional start
MOST_SHAPES = 3  # number of shape choices from which a refit starts
FURTHER = 16  # number of additional choices for laws of several shapes; the best are used
LARGER = (0.7, 3.0, 12.0)  # additional amplitudes, in units of the one whose effect is as large as the misfit


@dataclass(frozen=True)
class Plan:
    """Starting point of a refit: values of the candidate's numbers (SI), and unknowns (m,) of the base model's optimiser."""

    numbers: Mapping[str, float]
    base: Array


class RefitStarts:
    """Search ranges and starting points of a refit: `ranges` maps the candidate's numbers to their ranges, `plans` lists
    the starting points."""

    def __init__(self, base: Base, candidate: Candidate, guesses: Sequence[Score], runs: Sequence[Run]):
        self.base, self.candidate, self.guesses = base, candidate, guesses
        motions = motion_ranges(candidate.numbers, runs, base)
        self.ranges = ranges_within(candidate, motions, BEYOND)
        # An amplitude without influence on the records (for example the turbulent part of a line in which the oil hardly
        # moves) has no range and remains neutral.
        for number in candidate.vanishing:
            scales = [self._scale(g) for g in guesses if number.name in g.along]
            if not scales and guesses and not number.neutral_of:
                continue
            widest = WIDE * max(scales, default=abs(number.neutral) or 1.0)
            low = number.neutral - widest if number.low is None else max(number.low, number.neutral - widest)
            high = number.neutral + widest
            self.ranges[number.name] = (low, high if number.high is None else min(high, number.high))
        self.plans = self._plans()

    @property
    def beside(self) -> Plan | None:
        """A start near the base model, from which a refit cannot end with a larger sum of squares. None if the effect has
        no neutral value."""
        if not self._neutral or not self.guesses:
            return None
        first = self.plans[0].numbers
        small = {name: neutral + SMALL * (first[name] - neutral) for name, neutral in self._neutral.items()}
        return Plan({**first, **small}, np.clip(self.base.inner, self.base.problem.low, self.base.problem.high))

    def _scale(self, guess: Score) -> float:
        """The amplitude whose effect is as large as the whole misfit, by the tangent."""
        return float(np.linalg.norm(self.base.r)) / guess.size if guess.size > 0 else 1.0

    @property
    def _neutral(self) -> dict[str, float]:
        """The neutral values of the amplitudes that are estimated."""
        return {n.name: n.neutral for n in self.candidate.vanishing if n.name in self.ranges}

    def _plans(self) -> list[Plan]:
        problem = self.base.problem
        inside = np.clip(self.base.inner, problem.low, problem.high)
        initial = np.clip(problem.given, problem.low, problem.high)
        neutral = self._neutral
        vanishing = list(neutral)
        # amplitudes that a score does not move start with a small value: a descent cannot leave an end of a range
        carried = {n.name: n.neutral for n in self.candidate.vanishing if n.neutral_of}
        little = {name: neutral[name] + (g.side or 1) * SMALL * self._scale(g) for g in self.guesses for name in g.along}
        plans = []
        best = sorted(self.guesses, key=lambda g: -g.gain)
        for guess in best[:MOST_SHAPES]:
            right = bool(vanishing) and (guess.signed or guess.z > 0)
            size = guess.amplitude if right else (guess.side or 1) * 0.1 * self._scale(guess)
            point = np.clip(inside + guess.step, problem.low, problem.high) if right else inside
            numbers = {**carried, **little, **{name: neutral[name] + size for name in guess.along}, **guess.shapes}
            # an amplitude that must be above another one starts there: at equal values its shapes have no effect
            numbers.update({high: APART * numbers[low] for high, low in self.candidate.orders
                            if high in vanishing and low in vanishing})
            plans += [Plan(numbers, point), Plan(numbers, initial)]
        ended = {n.name: n.neutral + INSIDE * (n.high - n.neutral) for n in self.candidate.numbers
                 if n.name in vanishing and n.high is not None}
        if plans and ended:  # the derivative of a law may vanish at the end of a range
            plans.append(Plan({**plans[0].numbers, **ended}, inside))
        if not plans:
            for share in STARTS:
                numbers = {name: point_of_range(low, high, share) for name, (low, high) in self.ranges.items()}
                plans += [Plan(numbers, inside)]
        first = plans[0]
        # Amplitudes whose effect, by the tangent, is as large as the whole misfit or several times larger, with either sign
        # if both are allowed. Far from the optimum the tangent shows neither the size nor the sign: if the model oscillates
        # many cycles out of phase with the record, more detuning does not increase the error.
        scales = {n: max((self._scale(g) for g in best if n.name in g.along), default=0.0)
                  for n in self.candidate.vanishing}
        shapes = list({tuple(g.shapes.values()): g.shapes for g in best}.values())[:MOST_SHAPES] if scales else []
        for at in shapes:
            for side in admissible_sides(self.candidate.vanishing):
                plans += [Plan({**at, **{n.name: n.neutral + (side if may_be_below_neutral(n) else 1) * size * scale
                                         for n, scale in scales.items()}}, inside) for size in LARGER]
        return [*plans, *self._further(first, vanishing)]

    def _further(self, first: Plan, vanishing: Sequence[str]) -> list[Plan]:
        """Further starts for a law of several shape parameters: choices of its shapes and of its size, spread over their
        ranges. The list is empty for laws with fewer than two shapes."""
        shapes = [name for name in self.ranges if name not in vanishing]
        if len(shapes) < 2:
            return []
        plans = []
        for size, *shares in _halton(1 + len(shapes), FURTHER):
            factor = 4 ** (size - 0.5)
            numbers = {name: value * factor if name in vanishing else value for name, value in first.numbers.items()}
            numbers.update({name: point_of_range(*self.ranges[name], share) for name,
                            share in zip(shapes, shares, strict=True)})
            for high, low in self.candidate.orders:
                if {high, low} <= set(shapes) and numbers[high] < numbers[low]:
                    numbers[high], numbers[low] = numbers[low], numbers[high]
            plans.append(Plan(numbers, first.base))
        return plans


def _halton(dimensions: int, number: int) -> Array:
    """The first points (number, dimensions) of the Halton sequence in the unit cube, without the origin: the digits of k
    in a prime base, reversed behind the radix point (J. H. Halton, 1960, doi:10.1007/BF01386213)."""
    primes = [p for p in range(2, 60) if all(p % q for q in range(2, p))][:dimensions]
    points = np.zeros((number, len(primes)))
    for column, base in enumerate(primes):
        digits, share = np.arange(1, number + 1), 1.0 / base
        while digits.any():
            points[:, column] += digits % base * share
            digits, share = digits // base, share / base
    return points
