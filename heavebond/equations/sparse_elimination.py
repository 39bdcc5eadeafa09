"""Elimination of a linear loop: explicit solutions of sparse linear equations with expressions as coefficients.

The accelerations and forces of a tree of bodies are one loop, linear in all of them. Eliminated from the tips to the root it
costs as much as the tree has bodies, because the bodies are coupled by joints only; a dense solution would cost the cube of
their number. The order is chosen here for any sparse loop: the row with the fewest unknowns first, and in it the unknown
that occurs in the fewest rows (Markowitz). For a tree of bodies this is the articulated-body algorithm.

A divisor must differ from zero in every state of the machine. This is checked at random states, and at states in which
coordinates are zero and angles multiples of 90 degrees, where axes of a machine are parallel or perpendicular: in all of
them it must have the same sign, and at least the share `LEAST` of its row. The inertia of a body on a joint passes; the
cosine of an angle, or the square of its sine, does not.

H. M. Markowitz: The elimination form of the inverse and its application to linear programming. Management Science 3 (1957)
255-269, doi:10.1287/mnsc.3.3.255. R. Featherstone: Rigid Body Dynamics Algorithms. Springer 2008,
doi:10.1007/978-1-4899-7560-7, chapter 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# random states; a coefficient that vanishes for 2 % of them escapes once in 57 loops
RANDOM = 200
# random states of aligned axes; a coefficient that vanishes where two coordinates are zero escapes once in 10**33 loops
ALIGNED = 300
SAMPLES = RANDOM + ALIGNED
# share of the largest entry of its row, in nominal sizes of the unknowns, below which an entry is not divided by; a larger
# share rejects bodies with thin inertia, a smaller one lets a coefficient pass that is nearly zero in some states
LEAST = 1e-6
CANCELLED = 1e-12  # share of its terms below which a sum is zero but for rounding, in all samples


class Coefficient(NamedTuple):
    """A coefficient of the equations as an expression, and its values (SAMPLES,) at random states."""

    expression: ca.SX
    values: Array


class Solution(NamedTuple):
    """An equation (row) solved for an unknown (column) with a divisor, in terms of unknowns that are solved after it."""

    row: int
    column: int
    divisor: ca.SX
    value: ca.SX


def eliminate(coefficients: Mapping[tuple[int, int], Coefficient], constants: Mapping[int, ca.SX],
              symbols: Mapping[int, ca.SX], sizes: Mapping[int, float]) -> list[Solution] | None:
    """Solve sum over the columns of a[row, column]*v[column] + b[row] = 0, as many rows as columns.

    `coefficients` are a by (row, column), `constants` b by row, `symbols` v and `sizes` their nominal sizes by column. The
    result is in the order of elimination, of which the reverse is the order of evaluation. None if there is no divisor that
    differs from zero in all samples.
    """
    system = _System(coefficients, constants, symbols, sizes)
    waiting = [(len(entries), row) for row, entries in system.rows.items()]
    heapify(waiting)
    solutions: list[Solution] = []
    while waiting or (waiting := [(len(system.rows[row]), row) for row in system.combine()]):
        number, row = heappop(waiting)
        if row not in system.rows or len(system.rows[row]) != number:
            continue  # an older entry
        column = system.pivot(row)
        if column is None:
            continue  # until another elimination changes the row
        solution, changed = system.solve(row, column)
        solutions.append(solution)
        for changed_row in changed:
            heappush(waiting, (len(system.rows[changed_row]), changed_row))
    return None if system.rows else solutions


class _System:
    """The equations that are not solved yet."""

    def __init__(self, coefficients: Mapping[tuple[int, int], Coefficient], constants: Mapping[int, ca.SX],
                 symbols: Mapping[int, ca.SX], sizes: Mapping[int, float]):
        self.rows: dict[int, dict[int, Coefficient]] = {row: {} for row in constants}
        self.rows_of: dict[int, dict[int, None]] = {column: {} for column in symbols}
        for (row, column), coefficient in coefficients.items():
            self.rows[row][column] = coefficient
            self.rows_of[column][row] = None
        self.constants, self.symbols, self.sizes = dict(constants), symbols, sizes
        self.combined: set[tuple[int, int]] = set()

    def pivot(self, row: int) -> int | None:
        """The unknown in the fewest rows whose coefficient may be divided by; numbers before expressions."""
        entries = self.rows[row]
        if not entries:
            return None
        scaled = {column: np.abs(entry.values)*self.sizes[column] for column, entry in entries.items()}
        largest = np.maximum.reduce(list(scaled.values()))
        usable = [column for column, entry in entries.items() if bool(np.all(scaled[column] > LEAST*largest))
                  and bool(np.all(entry.values > 0) or np.all(entry.values < 0))]
        return min(usable, key=lambda c: (len(self.rows_of[c]), not entries[c].expression.is_constant(), c), default=None)

    def solve(self, row: int, column: int) -> tuple[Solution, list[int]]:
        """Solve a row for a column and insert the solution into all other rows; returns the solution and the rows that
        changed."""
        entries, constant = self.rows.pop(row), self.constants[row]
        divisor = entries.pop(column)
        total = constant
        for k, entry in entries.items():
            total = total + entry.expression*self.symbols[k]
            del self.rows_of[k][row]
        changed = [k for k in self.rows_of.pop(column) if k != row]
        for target in changed:
            factor = self.rows[target].pop(column)
            share = factor.expression/divisor.expression
            values = factor.values/divisor.values
            for k, entry in entries.items():
                old = self.rows[target].get(k)
                if old is None:
                    self.rows[target][k] = Coefficient(-(share*entry.expression), -(values*entry.values))
                    self.rows_of[k][target] = None
                    continue
                subtracted = values*entry.values
                new = old.values - subtracted
                if np.all(np.abs(new) <= CANCELLED*(np.abs(old.values) + np.abs(subtracted))):
                    del self.rows[target][k]
                    del self.rows_of[k][target]
                else:
                    self.rows[target][k] = Coefficient(old.expression - share*entry.expression, new)
            self.constants[target] = self.constants[target] - share*constant
        return Solution(row, column, divisor.expression, -total/divisor.expression), changed

    def combine(self) -> tuple[int, ...]:
        """Two of the rows without a divisor, combined so that the determinant of two unknowns in them is the coefficient of
        each (Cramer's rule), if it may be divided by; empty if there are none. J. R. Bunch, L. Kaufman, Mathematics of
        Computation 31 (1977) 163-179, doi:10.2307/2005787: pivots of order two."""
        for first, entries in self.rows.items():
            for c in entries:
                for second in self.rows_of[c]:
                    for d in entries:
                        if second <= first or d == c or d not in self.rows[second] or (first, second) in self.combined:
                            continue
                        a, b = entries[c], entries[d]
                        e, f = self.rows[second][c], self.rows[second][d]
                        values = a.values*f.values - b.values*e.values
                        size = np.abs(a.values*f.values) + np.abs(b.values*e.values)
                        if np.all(np.abs(values) > LEAST*size) and (np.all(values > 0) or np.all(values < 0)):
                            self.combined.add((first, second))
                            self._cramer(first, second, c, d, Coefficient(
                                a.expression*f.expression - b.expression*e.expression, values))
                            return first, second
        return ()

    def _cramer(self, first: int, second: int, c: int, d: int, determinant: Coefficient) -> None:
        one, two = self.rows[first], self.rows[second]
        weights = {first: (two[d], one[d], c), second: (one[c], two[c], d)}
        constants = {first: self.constants[first], second: self.constants[second]}
        for row, (own_factor, partner_factor, solved_column) in weights.items():
            own_entries, partner_entries = (one, two) if row == first else (two, one)
            combined: dict[int, Coefficient] = {solved_column: determinant}
            for column in dict.fromkeys((*own_entries, *partner_entries)):
                if column in (c, d):
                    continue
                terms = [(factor, entries[column], sign) for factor, entries, sign in (
                    (own_factor, own_entries, 1), (partner_factor, partner_entries, -1)) if column in entries]
                values = sum((sign*factor.values*entry.values for factor, entry, sign in terms),
                             np.zeros_like(determinant.values))
                size = sum((np.abs(factor.values*entry.values) for factor, entry, _ in terms), np.zeros_like(values))
                if np.all(np.abs(values) <= CANCELLED*size):
                    continue
                expression = sum((sign*factor.expression*entry.expression for factor, entry, sign in terms), ca.SX(0))
                combined[column] = Coefficient(expression, values)
            partner = second if row == first else first
            self.constants[row] = own_factor.expression*constants[row] - partner_factor.expression*constants[partner]
            self.rows[row] = combined
        for row in (first, second):
            for column in {*one, *two}:
                self.rows_of[column].pop(row, None)
            for column in self.rows[row]:
                self.rows_of[column][row] = None

def random_states(low: Sequence[float], high: Sequence[float], nominal: Sequence[float], angles: Sequence[bool]) -> Array:
    """Random values (n, SAMPLES) of unknowns within their bounds: angles over a turn and others of their nominal sizes, then
    angles that are multiples of 90 degrees, half of them zero, and others that are zero or of their nominal size."""
    random = np.random.default_rng(1)
    values = np.empty((len(nominal), SAMPLES))
    for k, (least, most, size, angle) in enumerate(zip(low, high, nominal, angles, strict=True)):
        aligned = random.choice([0, 0, 0, 1, -1, 2], ALIGNED)*(np.pi/2 if angle else size)
        if np.isfinite(least) and np.isfinite(most):
            values[k] = random.uniform(least, most, SAMPLES)
        elif np.isfinite(least) or np.isfinite(most):
            away = size*10**random.uniform(-1, 1, SAMPLES)
            values[k] = least + away if np.isfinite(least) else most - away
        else:
            values[k, :RANDOM] = random.uniform(-np.pi, np.pi, RANDOM) if angle else size*random.normal(size=RANDOM)
            values[k, RANDOM:] = aligned
    return values
