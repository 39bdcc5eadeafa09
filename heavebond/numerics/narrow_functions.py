"""Narrow functions of states: forces and flows that act within a part of a step only, and that a run has stepped over.

A solver evaluates the equations at the ends of its steps. A force that acts over 1 mm of a path of 1 km, or a gain that is
high within a millivolt, lies between two such points. The position of a narrow function follows from the expressions in it:
an argument of `abs`, `min`, `max`, `sign`, `tanh`, `exp`, a square or a comparison is zero there. Where such an argument
changes its sign between two points of a run, the states in between are interpolated, and the rates of the states there are
compared with the rates of the interpolation. If they differ, the interval is integrated again with a stop at that instant.
If its end differs as well, the run has missed the function and is repeated with stops at all these instants.

The interpolation is the cubic polynomial with the values and rates at both points (C. de Boor, A Practical Guide to Splines,
Springer, 2001, chapter IV).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.pointwise import evaluated

DIFFERENCES = {ca.OP_FMAX, ca.OP_FMIN, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
ARGUMENTS = {ca.OP_FABS, ca.OP_SIGN, ca.OP_SQ, ca.OP_CONSTPOW, ca.OP_POW, ca.OP_TANH, ca.OP_ATAN, ca.OP_ERF, ca.OP_COSH,
             ca.OP_EXP}


@dataclass(frozen=True)
class NarrowConstants:
    """The constants of the search.

    share: difference of a rate from the interpolation, over its range along the run, from which on an interval is looked at.
        Origin: the share of the other searches of short motions (`time_search.TIME_SEARCH`). Doubled: smaller motions are
        passed over.
    differs: change of a state at the end of an interval, over its range, that shows a missed function. Origin: a hundred
        times the error of a run at the default tolerances. Doubled: nothing measurable.
    least: size of a state, over its largest value and over its nominal size, that counts as its range if it is constant.
        Origin: the value of `sizes.SIZES.motion`. Doubled: smaller changes of a constant state are passed over.
    beside: distance from a point of the run, in its interval, below which a function lies at the point. Origin: an interval
        of that length cannot be divided. Doubled: nothing measurable.
    most: instants at which an interval is integrated again, those with the largest differences first. Origin: a tenth of a
        second of processor time. Doubled: twice that in a run with many narrow motions that it resolves.
    passes: repetitions of a run. Origin: each gives at least the instant of the next function. Doubled: runs past more
        functions in a row are completed.
    nodes: operations in the equations above which they are not searched. Origin: a tenth of a second. Doubled: twice that.
    points: points of a run below which it is not searched. Origin: `sizes.SIZES.least_stops`. Doubled: fewer short runs are
        searched.
    values: arguments times intervals that are evaluated, the longest intervals first. Origin: a tenth of a second; close
        points follow the steps of the integrator, which are fine there. Doubled: twice the time in runs with many events.
    crossings: positions that are located. Origin: a few hundredths of a second. Doubled: twice that.
    iterations: of the search for a position. Origin: the rounding of an argument that is nearly a straight line. Doubled:
        nothing measurable.
    """

    share: float = 0.05
    differs: float = 1e-4
    least: float = 1e-3
    beside: float = 1e-6
    most: int = 10
    passes: int = 10
    nodes: int = 20_000
    points: int = 100
    values: int = 500_000
    crossings: int = 1000
    iterations: int = 8


NARROW = NarrowConstants()


@dataclass(frozen=True)
class Passages:
    """Instants (n,) within a run at which rates differ from the interpolation of the states, with the number of the point
    before each, the states and unknowns there (., n), and the difference over the range of the rates."""

    times: Array
    after: NDArray[np.intp]
    x: Array
    z: Array
    excess: Array


class NarrowFunctions:
    """The positions of narrow functions of states in the equations of an assembly."""

    def __init__(self, assembly: Assembly):
        self.assembly = assembly
        rows = _arguments(assembly)
        self.number = len(rows)
        self._arguments, self._rates = (ca.Function(name, list(assembly.arguments), [ca.densify(ca.cse(value))])
                                        for name, value in (("arguments", stack(rows)), ("rates", assembly.ode)))

    def passed(self, times: Array, x: Array, z: Array, p: Array, inputs: Callable[[Array], Array]) -> Passages:
        """The instants at which a run, known at points (N,) with parameters (n_p, N), may have stepped over a function."""
        spans = np.diff(times)
        longest = np.argsort(-spans, kind="stable")[:NARROW.values // self.number]
        longest = longest[spans[longest] > 0]
        u = inputs((times[longest] + times[longest + 1]) / 2)
        if u.size or self.assembly.flat.held:  # which jump at points
            ends = [self._values(self._arguments, times[at], x[:, at], z[:, at], p[:, longest], u)
                    for at in (longest, longest + 1)]
        else:
            points, place = np.unique(np.append(longest, longest + 1), return_inverse=True)
            values = self._values(self._arguments, times[points], x[:, points], z[:, points], p[:, points], u[:, :1].repeat(
                len(points), axis=1))
            ends = [values[:, place[:len(longest)]], values[:, place[len(longest):]]]
        finite = np.isfinite(ends[0]) & np.isfinite(ends[1])
        row, column = np.nonzero(finite & ((ends[0] >= 0) != (ends[1] >= 0)))  # a zero at a point counts once
        order = np.argsort(column, kind="stable")[:NARROW.crossings]
        row, column = row[order], column[order]
        if not len(row):
            return Passages(np.zeros(0), row, x[:, :0], z[:, :0], np.zeros(0))
        inner, number = np.unique(column, return_inverse=True)
        k, u = longest[inner], u[:, inner]
        rates = [self._values(self._rates, times[at], x[:, at], z[:, at], p[:, k], u) for at in (k, k + 1)]
        piece = _Cubic(times[k], spans[k], (x[:, k], x[:, k + 1]), (rates[0], rates[1]), (z[:, k], z[:, k + 1]))
        shares = self._crossings(row, number, piece, p[:, k], u, ends[0][row, column], ends[1][row, column])
        order = np.lexsort((shares, number))
        number, shares = number[order], shares[order]
        # a function between two positions, such as the edges of a window, shows in their middle
        both = np.flatnonzero(number[1:] == number[:-1])
        number, shares = np.append(number, number[both]), np.append(shares, (shares[both] + shares[both + 1]) / 2)
        t, x_at, z_at, slope = piece.at(number, shares)
        rates_there = self._values(self._rates, t, x_at, z_at, p[:, k[number]], u[:, number])
        known = np.column_stack(rates)
        known = np.where(np.isfinite(known), known, 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            ranges = np.maximum(known.max(axis=1, keepdims=True), rates_there) - np.minimum(
                known.min(axis=1, keepdims=True), rates_there)
            excess = np.where(ranges > 0, np.abs(rates_there - slope) / ranges, 0.0)
        excess = np.nan_to_num(excess, nan=0.0, posinf=0.0).max(axis=0, initial=0.0)
        chosen = np.flatnonzero(excess > NARROW.share)
        chosen = chosen[np.argsort(t[chosen], kind="stable")]
        return Passages(t[chosen], k[number[chosen]], x_at[:, chosen], z_at[:, chosen], excess[chosen])

    def _crossings(self, row: NDArray[np.intp], number: NDArray[np.intp], piece: _Cubic, p: Array, u: Array, first: Array,
                   last: Array) -> Array:
        """The shares of the intervals `number` at which the arguments `row` change their signs on the interpolation, from
        their values at both ends: by the Illinois method."""
        low, high, below, above = np.zeros(len(row)), np.ones(len(row)), first, last
        nearest, smallest = np.where(np.abs(first) < np.abs(last), low, high), np.minimum(np.abs(first), np.abs(last))
        every = np.arange(len(row))
        for _ in range(NARROW.iterations):
            with np.errstate(invalid="ignore", divide="ignore"):
                share = (low * above - high * below) / (above - below)
            share = np.where((share > low) & (share < high), share, (low + high) / 2)
            t, x, z, _ = piece.at(number, share)
            value = self._values(self._arguments, t, x, z, p[:, number], u[:, number])[row, every]
            nearest = np.where(np.abs(value) < smallest, share, nearest)
            smallest = np.fmin(smallest, np.abs(value))
            same = (value >= 0) == (first >= 0)
            below, above = np.where(same, value, below / 2), np.where(same, above / 2, value)
            low, high = np.where(same, share, low), np.where(same, high, share)
        return np.asarray(nearest)

    def _values(self, function: ca.Function, t: Array, x: Array, z: Array, p: Array, u: Array) -> Array:
        values, = evaluated(self.assembly, function, (t[None, :], x, z, p, u, np.ones((1, len(t)))))
        return values


@dataclass(frozen=True)
class _Cubic:
    """Intervals (n,) of a run, in which the states (., n) are cubic polynomials from their values and rates at both ends,
    and algebraic unknowns are linear."""

    begin: Array
    spans: Array
    x: tuple[Array, Array]
    rates: tuple[Array, Array]
    z: tuple[Array, Array]

    def at(self, number: NDArray[np.intp], s: Array) -> tuple[Array, Array, Array, Array]:
        """Times, states, algebraic unknowns and rates of the states at shares of the intervals `number`."""
        h = self.spans[number]
        first, last, begin, end = (part[:, number] for part in (*self.x, *self.rates))
        begin, end = begin * h, end * h
        x = (2 * (first - last) + begin + end) * s**3 + (3 * (last - first) - 2 * begin - end) * s**2 + begin * s + first
        slope = (6 * (first - last) + 3 * (begin + end)) * s**2 + (6 * (last - first) - 4 * begin - 2 * end) * s + begin
        z = self.z[0][:, number] * (1 - s) + self.z[1][:, number] * s
        # the rate at a point of the run is that of the function itself: the parabola from the other point has none of it
        chord = 2 * (last - first)
        slope = np.where(s < NARROW.beside, chord - end, np.where(s > 1 - NARROW.beside, chord - begin, slope))
        return self.begin[number] + s * h, x, z, slope / h


def _arguments(assembly: Assembly) -> list[ca.SX]:
    """The expressions of the states that are zero at the position of a narrow function in the equations."""
    _, x, z, _, u, _ = assembly.arguments
    if not x.numel() or assembly.rates.n_nodes() > NARROW.nodes:
        return []
    waiting, visited, rows = [*split(assembly.ode), *split(assembly.alg)], set[int](), dict[int, ca.SX]()
    while waiting:
        node = waiting.pop()
        if node.is_constant() or node.is_symbolic() or node.element_hash() in visited:
            continue
        visited.add(node.element_hash())
        operation, parts = node.op(), [node.dep(k) for k in range(node.n_dep())]
        row = parts[0] - parts[1] if operation in DIFFERENCES else parts[0] if operation in ARGUMENTS else None
        if row is not None and not row.is_constant():
            rows.setdefault(row.element_hash(), row)
        waiting += parts
    found = list(rows.values())
    if not found:
        return []
    moving = np.array(ca.which_depends(stack(found), stack([x, z, u]), 1, True))
    return [row for row, one in zip(found, moving, strict=True) if one]


def missed(one: Array, other: Array, x: Array, nominal: Array) -> bool:
    """True if the states (n,) at the end of an interval differ for a run with the states x (n, N)."""
    sizes = np.maximum(np.ptp(x, axis=1), NARROW.least * np.maximum(np.abs(x).max(axis=1), nominal))
    return bool(np.any(np.abs(one - other) > NARROW.differs * sizes))
