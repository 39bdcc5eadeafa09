"""Search in functions of time alone: for sign changes, and for motions that are too short for the output points.

Both searches divide intervals of time until interval bounds decide. An interval in which no zero can lie, or in which a
function differs by less than a tolerance from a constant (by its range) or from a straight line (by its second derivative),
is not divided further. R. E. Moore, R. B. Kearfott, M. J. Cloud, Introduction to Interval Analysis, SIAM, 2009, chapter 8.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import listing
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array
from heavebond.numerics.interval_functions import bounds_function, operation

ENTIRE = {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_NEG, ca.OP_TWICE, ca.OP_SQ, ca.OP_SIN, ca.OP_COS, ca.OP_ASSIGN, ca.OP_DIV}
LONGEST_TEXT = 80  # of a function of time in a message, in characters


@dataclass(frozen=True)
class TimeSearchConstants:
    """The constants of the searches.

    share: excursion of a function from the straight line between two output points, over its range, from which on it is
        searched for. Origin: the share of the limit of the steps (`forcing.FORCING`). Doubled: smaller short motions are
        passed over.
    narrow: share of an output interval below which the motion is too short for the output points. Origin: an interval of a
        twentieth of the width of a bell holds its excursion. Doubled: sines with few output points a period are cut, too.
    most_intervals: intervals that are looked at in one search. Origin: a tenth of a second. Doubled: the search of a
    function whose bounds are wide takes twice as long.
    roundings: distance in units of rounding within which two times are one. Origin: the rounding of an instant that is
        computed from parameters in two or three operations. Doubled: no change to be seen.
    best_first: number of intervals from which on the widest ranges are divided first. Origin: the range of a function
        becomes known early, and with it the tolerance. Doubled: more intervals before the range is known.
    most_stops: points of short motions above which the steps are limited in their place. Origin: at each point an integrator
        begins anew, which takes some ten steps. Doubled: a fast sine with few output points takes up to twice as long.
    most_steps: steps that a limit may ask for in a run. Origin: a minute of processor time. Doubled: twice that.
    samples: times at which a sum of sines and powers is compared with a constant. Origin: many more than such a sum may have
        zeros by chance. Doubled: nothing measurable.
    rounded: range of such a sum, over the size of its terms, below which it is constant. Origin: the rounding of some
        thousand operations. Doubled: nothing measurable.
    """

    share: float = 0.05
    narrow: float = 0.125
    most_intervals: int = 50_000
    roundings: int = 8
    best_first: int = 64
    most_stops: int = 1000
    most_steps: int = 5_000_000
    samples: int = 101
    rounded: float = 1e-12


TIME_SEARCH = TimeSearchConstants()


@dataclass(frozen=True)
class Instants:
    """Times (n,) that a search gave, and the rows for which it was not complete."""

    times: Array
    unknown: NDArray[np.intp]


NOTHING = Instants(np.zeros(0), np.zeros(0, dtype=np.intp))


class Course:
    """A function of time f(t, p) of m rows, with interval bounds of its values and derivatives."""

    def __init__(self, time: ca.SX, p: ca.SX, rows: list[ca.SX]):
        self.m, self._rows, self._given = len(rows), rows, [time, p]
        self.value = ca.Function("value", self._given, [stack(rows)])
        self._bounds: dict[int, ca.Function] = {}  # of the derivatives by their order, as far as they were asked for

    def texts(self, rows: NDArray[np.intp]) -> list[str]:
        """Rows as they are written, with the names of their parameters; the parameters alone of a long one."""
        return [text if len(text := str(self._rows[k])) <= LONGEST_TEXT else
                f"f({listing(dict.fromkeys(['time', *(s.name().partition('[')[0] for s in ca.symvar(self._rows[k]))]), 4)})"
                for k in rows]

    def at(self, times: Array, p: Array) -> Array:
        """The values (m, N) at times (N,)."""
        return np.array(self.value(times[None, :], p)).reshape(self.m, len(times))

    def bounds(self, order: int, begin: Array, end: Array, p: Array) -> tuple[Array, Array]:
        """The bounds (m, N) of the derivatives of an order inside of intervals (N,)."""
        if order not in self._bounds:
            derivative = stack(self._rows)
            for _ in range(order):
                derivative = ca.jtimes(derivative, self._given[0], ca.SX(1))
            self._bounds[order] = bounds_function(ca.Function("f", self._given, [ca.cse(ca.densify(derivative))]))
        inset = np.minimum(rounding(end), (end - begin) / 4)
        low, high = (np.array(b).reshape(self.m, len(begin)) for b in
                     self._bounds[order]((begin + inset)[None, :], (end - inset)[None, :], p))
        return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)


def constant_rows(function: ca.Function, p: Array, begin: float, end: float) -> NDArray[np.bool_]:
    """True for each row (m,) of a function f(t, p) that is constant between two times except for rounding, as the square of
    the norm of a quaternion that turns at constant speed. Interval bounds cannot show this: they take both terms of a
    difference as independent.

    An entire function, a sum of products of sines and powers, is constant if its values at many times agree. Quotients count
    if their divisor is constant. Other functions may have narrow peaks between the times and do not count."""
    times = begin + (end - begin) * np.mod(0.5 + 0.6180339887498949 * np.arange(TIME_SEARCH.samples), 1)
    result = np.zeros(function.size1_out(0), dtype=bool)
    # the value of each intermediate result, or its values at the times, and the size of its terms; nothing if not entire
    work: dict[int, tuple[Array, float]] = {}
    for k in range(function.n_instructions()):
        op, inputs, outputs = (function.instruction_id(k), function.instruction_input(k), function.instruction_output(k))
        if op == ca.OP_OUTPUT:
            result[outputs[1]] = inputs[0] in work and work[inputs[0]][0].ndim == 0
            continue
        if op in (ca.OP_INPUT, ca.OP_CONST):
            value = np.asarray(function.instruction_constant(k) if op == ca.OP_CONST else
                               times if inputs[0] == 0 else p[inputs[1]], dtype=float)
            work[outputs[0]] = value, float(np.abs(value).max())
            continue
        args = [work[i] for i in inputs if i in work]
        for place in outputs:
            work.pop(place, None)
        if op == ca.OP_CALL or len(args) < len(inputs):
            continue
        values, sizes = zip(*args, strict=True)
        if all(v.ndim == 0 for v in values):
            value = np.asarray(float(operation(op, [ca.SX(float(v)) for v in values])))
            work[outputs[0]] = value, abs(float(value))
        elif op in ENTIRE and not (op == ca.OP_DIV and values[1].ndim):
            value, size = _entire(op, values, sizes)
            constant = bool(np.ptp(value) <= TIME_SEARCH.rounded * size)
            work[outputs[0]] = (np.asarray(value.mean()) if constant else value), size
    return result


def _entire(op: int, values: tuple[Array, ...], sizes: tuple[float, ...]) -> tuple[Array, float]:
    """The values and the size of the terms of one operation of `ENTIRE`."""
    (a, b), (s, r) = (values[0], values[-1]), (sizes[0], sizes[-1])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        match op:
            case ca.OP_ADD:
                return a + b, max(s, r)
            case ca.OP_SUB:
                return a - b, max(s, r)
            case ca.OP_MUL:
                return a * b, s * r
            case ca.OP_DIV:
                return a / b, s / abs(float(b)) if float(b) else np.inf
            case ca.OP_SQ:
                return a * a, s * s
            case ca.OP_SIN:
                return np.sin(a), 1.0
            case ca.OP_COS:
                return np.cos(a), 1.0
            case ca.OP_NEG:
                return -a, s
            case ca.OP_TWICE:
                return 2 * a, 2 * s
            case _:
                return a, s


def rounding(times: Array) -> Array:
    """The distance within which two times are one."""
    return np.asarray(TIME_SEARCH.roundings * np.spacing(np.abs(times)))


def sign_changes(course: Course, p: Array, edges: Array) -> Instants:
    """The times at which one of the functions changes its sign between the first and the last of the edges (n,), to
    rounding.
    Kinks that are known are given as edges."""
    moving = np.flatnonzero(~constant_rows(course.value, p, edges[0], edges[-1]))
    zeros = list[Array]()
    begin, end = (np.tile(e, len(moving)) for e in (edges[:-1], edges[1:]))
    row = np.repeat(moving, len(edges) - 1)
    unknown, spent = np.zeros(0, dtype=np.intp), 0
    while len(row):
        spent += len(row)
        if spent > TIME_SEARCH.most_intervals:
            unknown = np.unique(row)
        (low, high), (falls, rises) = course.bounds(0, begin, end, p), course.bounds(1, begin, end, p)
        k = np.arange(len(row))
        low, high, falls, rises = low[row, k], high[row, k], falls[row, k], rises[row, k]
        first, last = course.at(begin, p)[row, k], course.at(end, p)[row, k]
        zero = (low <= 0) & (high >= 0) & ((low < 0) | (high > 0))
        changes = np.sign(first) != np.sign(last)
        small = end - begin <= 2 * rounding(end)
        single = (falls > 0) | (rises < 0) | small | bool(len(unknown))
        zeros.append(_bisected(course, p, row[zero & single & changes], begin[zero & single & changes],
                               end[zero & single & changes]))
        remaining = zero & ~single
        middle = (begin[remaining] + end[remaining]) / 2
        begin, end = np.append(begin[remaining], middle), np.append(middle, end[remaining])
        row = np.append(row[remaining], row[remaining])
    return Instants(np.concatenate(zeros), unknown)


def straight_sign_changes(course: Course, p: Array, edges: Array) -> Array:
    """The edges (n,) and the times between them at which one of the functions changes its sign, where these are straight
    lines between all of them, with jumps at some: those found may be kinks of others."""
    while True:
        inset = np.minimum(rounding(edges[1:]), np.diff(edges) / 4)
        begin, end = edges[:-1] + inset, edges[1:] - inset
        row, k = np.nonzero(np.sign(course.at(begin, p)) != np.sign(course.at(end, p)))
        zeros = _bisected(course, p, row, begin[k], end[k])
        joined = np.union1d(edges, zeros)
        joined = joined[np.diff(joined, prepend=-np.inf) > rounding(joined)]
        if len(joined) == len(edges):
            return edges
        edges = joined


def _bisected(course: Course, p: Array, row: NDArray[np.intp], begin: Array, end: Array) -> Array:
    """Where each function `row` changes its sign between begin and end: the first time at which it has done so."""
    if not len(row):
        return np.zeros(0)
    k, sign = np.arange(len(row)), np.sign(course.at(begin, p)[row, np.arange(len(row))])
    while True:
        middle = begin + (end - begin) / 2
        if np.all((middle <= begin) | (middle >= end)):
            return end
        before = np.sign(course.at(middle, p)[row, k]) == sign
        begin, end = np.where(before, middle, begin), np.where(before, end, middle)


@dataclass(frozen=True)
class Narrow:
    """The times (n,) of stops within short motions, the longest step (s; 0: no limit) for motions that were not located, and
    the rows for which there is neither."""

    times: Array
    longest: float
    unknown: NDArray[np.intp]


def short_motions(course: Course, p: Array, times: Array, edges: Array) -> Narrow:
    """The motions of functions that are shorter than the intervals between the output times (N,); the functions are smooth
    between the edges (n,)."""
    interval = float(np.median(np.diff(times)))
    samples = course.at(times, p)
    least, most = samples.min(axis=1, initial=np.inf, where=np.isfinite(samples)), samples.max(
        axis=1, initial=-np.inf, where=np.isfinite(samples))
    begin, end = edges[:-1], edges[1:]
    low, high = course.bounds(2, begin, end, p)
    bend = np.maximum(-low, high).max(axis=1)
    rows = np.flatnonzero(~(bend * interval**2 / 8 <= TIME_SEARCH.share * (most - least)))
    if len(rows):
        rows = rows[~constant_rows(course.value, p, edges[0], edges[-1])[rows]]
    if not len(rows):
        return Narrow(np.zeros(0), 0.0, rows)
    mesh, spent, longest, unknown = [edges], 0, np.inf, np.zeros(0, dtype=np.intp)
    while len(begin):
        spent += len(begin)
        (low, high), (down, up) = course.bounds(0, begin, end, p), course.bounds(2, begin, end, p)
        middle = begin + (end - begin) / 2
        values = course.at(middle, p)
        values = np.where(np.isfinite(values), values, (least + most)[:, None] / 2)
        least, most = np.minimum(least, values.min(axis=1)), np.maximum(most, values.max(axis=1))
        allowed = TIME_SEARCH.share * (most - least)[:, None]
        width, bend = (high - low)[rows], np.maximum(-down, up)[rows]
        flat = np.isfinite(width) & (width <= np.maximum(allowed[rows], 1e-12 * np.maximum(np.abs(low), np.abs(high))[rows]))
        resolved = (flat | (bend * (end - begin)**2 / 8 <= allowed[rows])).all(axis=0) | (end - begin <= 4 * rounding(end))
        remaining = np.flatnonzero(~resolved)
        if spent > TIME_SEARCH.most_intervals and len(remaining):
            worst = bend[:, remaining].max(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                limits = np.sqrt(8 * allowed[rows, 0] / worst)
            bounded = np.isfinite(worst) & (limits * TIME_SEARCH.most_steps > times[-1] - times[0])
            open_rows = ~flat[:, remaining].all(axis=1)
            longest, unknown = float(limits[bounded & open_rows].min(initial=np.inf)), rows[~bounded & open_rows]
            break
        if len(remaining) > TIME_SEARCH.best_first:
            widest = np.where(np.isfinite(width[:, remaining]), width[:, remaining], np.inf).max(axis=0)
            divided = widest >= 0.5 * widest.max() if np.isfinite(widest.max()) else ~np.isfinite(widest)
        else:
            divided = np.ones(len(remaining), dtype=bool)
        split, wait = remaining[divided], remaining[~divided]
        mesh.append(middle[split])
        begin, end = (np.concatenate(parts) for parts in ((begin[wait], begin[split], middle[split]),
                                                          (end[wait], middle[split], end[split])))
    stops = _hidden(course, p, times, np.unique(np.concatenate(mesh)), rows, most - least)
    finest = float(np.diff(stops).min(initial=np.inf))
    if len(stops) > TIME_SEARCH.most_stops and finest * TIME_SEARCH.most_steps > times[-1] - times[0]:
        stops, longest = stops[:0], min(longest, finest)
    return Narrow(stops, longest if np.isfinite(longest) else 0.0, unknown)


def _hidden(course: Course, p: Array, times: Array, mesh: Array, rows: NDArray[np.intp], ranges: Array) -> Array:
    """The points of a mesh in certain output intervals: a function deviates there from the straight line between both ends,
    and the mesh is much finer than the output times."""
    inner = mesh[(mesh > times[0]) & (mesh < times[-1])]
    if not len(inner):
        return np.zeros(0)
    place = np.clip(np.searchsorted(times, inner, side="right") - 1, 0, len(times) - 2)
    values, ends = course.at(inner, p)[rows], course.at(times, p)[rows]
    share = (inner - times[place]) / (times[place + 1] - times[place])
    chord = ends[:, place] * (1 - share) + ends[:, place + 1] * share
    away = (np.abs(values - chord) > TIME_SEARCH.share * ranges[rows, None]).any(axis=0)
    gaps = np.diff(inner, prepend=-np.inf, append=np.inf)
    fine = np.minimum(gaps[:-1], gaps[1:]) <= TIME_SEARCH.narrow * (times[place + 1] - times[place])
    met = np.zeros(len(times), dtype=np.int8)
    met[place[away]] |= 1
    met[place[fine]] |= 2
    return np.asarray(inner[met[place] == 3])
