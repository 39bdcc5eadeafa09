"""Starting points and stopping rules of the refits of candidates.

A refit begins at the optimum of the base model with the step that the scores suggest, and at the values of the data sheet;
with amplitudes that act as strongly as the whole misfit, and several times as strongly; and, for a law of several shape
parameters, with more choices of these spread over their ranges.

A stopping rule is a function of the sums of squares of the runs so far and of the best unknowns (see `Residuals.descend`).
It ends a descent that has converged, that repeats another descent, or that has no prospect of reaching the best candidate.
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
    point_of_range,
    shape_ranges,
)
from heavebond.estimation.residuals import ARRIVED, GIVEN_UP, Run
from heavebond.numerics.dae import Array

# It has arrived where so many runs in a row have not lowered the sum of squares by this share, as far as the errors of its
# runs let it see, or creeps. What comes near the best is followed to the very end later.
IDLE, LITTLE = 4, 1e-3
# After so many runs it is given up where it stands where another one stood by then: within this share of each range, and of
# the sum of squares.
MIDWAY, MEETS = 4, 0.03
# And where it then leaves more than so many times what the best of other candidates leaves, or as good as all of the misfit
# of which another one takes most, unless its last two steps have brought it to this share.
HOPE, STEEP = 10.0, 0.5

Enough = Callable[[Sequence[float], Array], str]


def stop_stalled(costs: Sequence[float], best: Array) -> str:
    """Ends a descent that hardly falls any more."""
    return ARRIVED if len(costs) > IDLE and min(costs[:-IDLE]) - min(costs) < LITTLE * min(costs) else ""


def made_progress(costs: Sequence[float]) -> bool:
    """Whether the last two steps of a descent have brought it far, given the smallest sum after each."""
    return len(costs) > 2 and costs[-1] < STEEP * costs[-3]


def stop_inferior_starts(spans: Array, least: float, nothing: float = np.inf) -> Enough:
    """Ends the first steps from several starts of one candidate, one start after the other. `spans` (m,) are the ranges of
    the unknowns, `least` is what the best of other candidates leaves; a descent that leaves `nothing` or more by then is
    hopeless, too."""
    midway: list[tuple[float, Array]] = []  # where each stood after a few

    def met(cost: float, inner: Array) -> bool:
        return any(abs(cost - other) < MEETS * other and float(np.max(np.abs(inner - there) / spans)) < MEETS
                   for other, there in midway)

    def enough(costs: Sequence[float], best: Array) -> str:
        history = list(accumulate(costs, min))
        if len(costs) >= MIDWAY and history[-1] > min(HOPE * least, nothing) and not made_progress(history):
            return GIVEN_UP
        if len(costs) == MIDWAY:
            if met(history[-1], best):
                return ARRIVED
            midway.append((history[-1], best))
        return stop_stalled(costs, best)

    return enough


# An amplitude is sought up to this many times what would move the channels by their whole misfit, as far as the tangent at
# zero tells, and up to as many times that where it ends there.
WIDE = 30.0
STARTS = (0.15, 0.5, 0.85)  # shares of the ranges of shapes
APART = 1.5  # where an amplitude begins that must be above another one
SMALL = 0.02  # share of the amplitude that a score asks for with which a refit begins besides
INSIDE = 0.4  # share of its range at which an amplitude begins besides, where the range has an end
MOST_SHAPES = 3  # choices of the shapes from which a refit begins
FURTHER = 16  # more of them for laws of several shapes, of which the best are taken
LARGER = (0.7, 3.0, 12.0)  # amplitudes to be looked at besides, in units of what would move the channels by their misfit


@dataclass(frozen=True)
class Plan:
    """Where a refit begins: values of the candidate's numbers, and of the base's free parameters (inner)."""

    numbers: Mapping[str, float]
    base: Array


class RefitStarts:
    """The ranges of the numbers of a candidate by their names, and the starts of its refit: `ranges`, `plans`."""

    def __init__(self, base: Base, candidate: Candidate, guesses: Sequence[Score], runs: Sequence[Run]):
        self.base, self.candidate, self.guesses = base, candidate, guesses
        self.ranges = {**shape_ranges(candidate, runs, base, BEYOND), **self._amplitudes()}
        self.plans = self._plans()

    @property
    def beside(self) -> Plan | None:
        """A start next to the base model, from where a refit cannot end above it; None where the effect has no zero."""
        if not self._neutral or not self.guesses:
            return None
        first = self.plans[0].numbers
        small = {name: neutral + SMALL * (first[name] - neutral) for name, neutral in self._neutral.items()}
        return Plan({**first, **small}, np.clip(self.base.inner, self.base.problem.low, self.base.problem.high))

    def _scale(self, guess: Score) -> float:
        """The amplitude whose own effect is as large as the whole misfit."""
        return float(np.linalg.norm(self.base.r)) / guess.size if guess.size > 0 else 1.0

    def _amplitudes(self) -> dict[str, tuple[float, float]]:
        """Where each amplitude is sought; one that the records do not see (the turbulent part of a line in which the oil
        hardly moves) stays neutral."""
        found = {}
        for number in self.candidate.vanishing:
            scales = [self._scale(g) for g in self.guesses if number.name in g.along]
            if not scales and self.guesses and not number.neutral_of:
                continue
            widest = WIDE * max(scales, default=abs(number.neutral) or 1.0)
            low = number.neutral - widest if number.low is None else max(number.low, number.neutral - widest)
            high = number.neutral + widest
            found[number.name] = (low, high if number.high is None else min(high, number.high))
        return found

    @property
    def _neutral(self) -> dict[str, float]:
        """The amplitudes that are sought, each with the value at which the effect is absent."""
        return {n.name: n.neutral for n in self.candidate.vanishing if n.name in self.ranges}

    def _plans(self) -> list[Plan]:
        problem = self.base.problem
        inside = np.clip(self.base.inner, problem.low, problem.high)
        given = np.clip(problem.given, problem.low, problem.high)
        neutral = self._neutral
        vanishing = list(neutral)
        # amplitudes that a guess does not move begin small: from an end of its range one finds no way
        carried = {n.name: n.neutral for n in self.candidate.vanishing if n.neutral_of}
        little = {name: neutral[name] + (g.side or 1) * SMALL * self._scale(g) for g in self.guesses for name in g.along}
        plans = []
        for guess in sorted(self.guesses, key=lambda g: -g.gain)[:MOST_SHAPES]:
            right = bool(vanishing) and (guess.signed or guess.z > 0)
            size = guess.amplitude if right else (guess.side or 1) * 0.1 * self._scale(guess)
            point = np.clip(inside + guess.step, problem.low, problem.high) if right else inside
            numbers = {**carried, **little, **{name: neutral[name] + size for name in guess.along}, **guess.shapes}
            # what must be above another amplitude begins there: at the same value its shapes would have no effect yet
            numbers.update({high: APART * numbers[low] for high, low in self.candidate.orders
                            if high in vanishing and low in vanishing})
            plans += [Plan(numbers, point), Plan(numbers, given)]
        ended = {n.name: n.neutral + INSIDE * (n.high - n.neutral) for n in self.candidate.numbers
                 if n.name in vanishing and n.high is not None}
        if plans and ended:  # at the end of a range a law may have no slope any more
            plans.append(Plan({**plans[0].numbers, **ended}, inside))
        if not plans:
            for share in STARTS:
                numbers = {name: point_of_range(low, high, share) for name, (low, high) in self.ranges.items()}
                plans += [Plan(numbers, inside)]
        return [*plans, *self._larger(), *self._further(plans[0], vanishing)]

    def _further(self, first: Plan, vanishing: Sequence[str]) -> list[Plan]:
        """For a law of several shapes more choices of them, spread over their ranges, and of its size, to be looked at."""
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

    def _larger(self) -> list[Plan]:
        """Amplitudes that do as much as the whole misfit, as far as the tangent tells, and several times that, either way
        round where both are allowed. Far from the optimum it tells neither size nor sign: a machine that has swung many
        times out of step with the record swings no further out of it."""
        best = sorted(self.guesses, key=lambda g: -g.gain)
        shapes = list({tuple(g.shapes.values()): g.shapes for g in best}.values())[:MOST_SHAPES]
        scales = {n: max((self._scale(g) for g in best if n.name in g.along), default=0.0)
                  for n in self.candidate.vanishing}
        inside = np.clip(self.base.inner, self.base.problem.low, self.base.problem.high)
        return [Plan({**at, **{n.name: n.neutral + (side if may_be_below_neutral(n) else 1) * size * scale
                                for n, scale in scales.items()}}, inside)
                for at in shapes for side in admissible_sides(self.candidate.vanishing) for size in LARGER] if scales else []


def _halton(dimensions: int, number: int) -> Array:
    """The first points (number, dimensions) of the sequence of J. H. Halton (1960, doi:10.1007/BF01386213) in the unit cube
    but its origin: the digits of k in a prime base, mirrored at the point."""
    primes = [p for p in range(2, 60) if all(p % q for q in range(2, p))][:dimensions]
    points = np.zeros((number, len(primes)))
    for column, base in enumerate(primes):
        left, share = np.arange(1, number + 1), 1.0 / base
        while left.any():
            points[:, column] += left % base * share
            left, share = left // base, share / base
    return points
