"""Where the numbers of a candidate are sought, and where its refit begins.

At the base model's optimum with the step that the scores ask for, and at the data sheet; with amplitudes that do as much as
the whole misfit, and several times that; and, for a law of several shapes, with more choices of them spread over their
ranges.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.diagnosis.base_model import Base
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.scoring import BEYOND, Score, admissible_sides, may_be_below_neutral, point_of_range, shape_ranges
from heavebond.estimation.residuals import Run
from heavebond.numerics.dae import Array

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
            if not scales and self.guesses:
                continue
            widest = WIDE * max(scales, default=1.0)
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
        little = {name: neutral[name] + (g.side or 1) * SMALL * self._scale(g) for g in self.guesses for name in g.along}
        plans = []
        for guess in sorted(self.guesses, key=lambda g: -g.gain)[:MOST_SHAPES]:
            right = bool(vanishing) and (guess.signed or guess.z > 0)
            size = guess.amplitude if right else (guess.side or 1) * 0.1 * self._scale(guess)
            point = np.clip(inside + guess.step, problem.low, problem.high) if right else inside
            numbers = {**little, **{name: neutral[name] + size for name in guess.along}, **guess.shapes}
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
