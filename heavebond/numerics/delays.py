"""Delayed variables in a run: the stored history of their sources, and its polynomial pieces as inputs of the equations.

A run with delays T_k is integrated by the method of steps: in windows of at most the shortest delay, in which all delayed
variables are known functions of time. The sources are sampled at the points of the integrator (see `looks`, about one in a
step) and interpolated between these by polynomials of degree 5, with their sensitivities. A discontinuity of a source or of
one of its derivatives at b (the start, an event, a kink) returns at b + T_k: the window ends there, the integrator begins
anew, and a source that follows it has a discontinuity there in turn. Before the start a source has its value at the start.

With d(t) = w(t - T), the sensitivity along a direction is dd = dw(t - T) - w'(t - T) dT; of a discontinuity that returns
at b + T it is db + dT. A. Bellen, M. Zennaro, Numerical Methods for Delay Differential Equations, Oxford 2003, chap. 3, 4;
C. T. H. Baker, C. A. H. Paul, Pitfalls in parameter estimation for delay differential equations, SIAM J. Sci. Comput.
18 (1997) 305-314.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, SimulationError
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import DELAY_ROWS, DELAY_TERMS, Array, Assembly, delay_coefficients, measured_rows
from heavebond.numerics.event_constants import EVENTS


@dataclass(frozen=True)
class DelayConstants:
    """The constants of delayed variables in runs.

    samples: intervals of a window in which sources are sampled, at least. Origin: a window of one polynomial piece has
        several stencils. Doubled: short delays cost twice as many points, with smaller errors.
    mean_steps: steps of the integrator between two samples, on the average, at most. Origin: a step at rtol 1e-8 is 0.06 rad
        of an oscillation, in which the interpolation errs by 1e-10. Doubled: by 1e-8, half of the evaluations.
    stencil: samples of an interpolating polynomial. Origin: an order above the order of the integrator. Doubled: it
        oscillates where the samples are rounded.
    apart: distance of two samples of a stencil, at least, over that of the two around a time. Origin: rounding is magnified
        by some hundred at most. Doubled: fewer of close samples, with errors of a wider stencil.
    tolerance: error of the polynomial pieces in the equations, over the tolerance of the integrator. Origin: well below the
        error of the integrator. Doubled: slightly longer pieces.
    parts: samples and pieces of one window, at most: a shorter window resolves a short transient in the history. Origin:
        memory of a call. Doubled: fewer windows.
    scatter: difference of a sample from a smooth curve, over the error of a piece. Origin: samples have the error of the
        integrator, and what a stencil makes of it. Doubled: pieces follow short motions with twice the error.
    piece_samples: samples of the history at which a piece is compared with it, at most. Origin: a piece of six coefficients
        follows a few samples of a motion, and short motions have most of the samples. Doubled: twice the time.
    refinements: halvings of an interval between two points of the integrator, in which a source changes more than its
        samples show. Origin: an interval contains at most one motion of a function of time. Doubled: rounding of time.
    halvings: halvings of a piece, at most. Origin: rounding of time. Doubled: nothing.
    shortest: length of a piece, or of an interval between two samples, at least, in units of `same_instant`. Origin:
        rounding of time. Doubled: nothing.
    max_windows: windows of a run, at most. Origin: some minutes. Doubled: shorter delays are possible.
    beside: distance from a discontinuity at which sources are evaluated on both sides, in units of `same_instant`. Origin: a
        function of time has its value on the other side at the instant itself. Doubled: nothing.
    """

    samples: int = 32
    mean_steps: float = 1.0
    stencil: int = 6
    apart: float = 0.25
    tolerance: float = 0.1
    parts: int = 1024
    scatter: float = 50.0
    piece_samples: int = 64
    refinements: int = 12
    halvings: int = 30
    shortest: float = 8.0
    max_windows: int = 1_000_000
    beside: float = 4.0


DELAYS = DelayConstants()

# Chebyshev points in (-1, 1) at which a piece takes its values, the matrix from these to its coefficients, and the points in
# between, at which its error is measured
_NODES = np.cos(np.pi * (np.arange(DELAY_TERMS) + 0.5) / DELAY_TERMS)
_TO_TERMS = np.linalg.inv(np.vander(_NODES, increasing=True))
_BETWEEN = np.cos(np.pi * np.arange(DELAY_TERMS + 1) / DELAY_TERMS) * (1 - 1e-9)
_CHECKED = np.vander(_BETWEEN, DELAY_TERMS, increasing=True)


@dataclass
class Stretch:
    """A part of the history without discontinuities: times (n,), from the begin of the run, and values (n, rows) of the
    sources and, in further rows, their sensitivities. Both grow in place."""

    number: int = 0
    _times: Array = field(default_factory=lambda: np.zeros(64))
    _values: Array = field(default_factory=lambda: np.zeros((64, 0)))

    @property
    def times(self) -> Array:
        """The times of the samples."""
        return self._times[:self.number]

    @property
    def values(self) -> Array:
        """The samples, one row each."""
        return self._values[:self.number]

    def add(self, times: Array, values: Array) -> None:
        """Append samples (n,) and (rows, n). Far from 0, short steps of the integrator may end at one rounded time: the
        first sample counts."""
        rises = np.diff(times, prepend=self.times[-1] if self.number else -np.inf) > 0
        if not rises.all():
            times, values = times[rises], values[:, rises]
        end = self.number + len(times)
        if not self._values.shape[1]:
            self._values = np.zeros((len(self._times), len(values)))
        while end > len(self._times):
            self._times = np.concatenate([self._times, np.zeros_like(self._times)])
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        self._times[self.number:end], self._values[self.number:end] = times, values.T
        self.number = end

    def insert(self, times: Array, values: Array) -> None:
        """Add samples (n,) and (rows, n) between those that are there."""
        order = np.argsort(np.concatenate([self.times, times]), kind="stable")
        all_times, all_values = np.concatenate([self.times, times])[order], np.vstack([self.values, values.T])[order]
        self.number = 0
        self.add(all_times, all_values.T)

    def at(self, times: Array, rows: NDArray[np.intp]) -> Array:
        """Some rows at times (n,), interpolated: (rows, n). The integrator begins each call with short steps: the stencil
        leaves out samples that are much closer together than the two around a time, whose rounding it would magnify."""
        known, number = self.times, self.number
        if number == 1:
            return np.tile(self.values[0, rows][:, None], (1, len(times)))
        low = np.clip(np.searchsorted(known, times, side="right") - 1, 0, number - 2)
        high = low + 1
        apart, middle = DELAYS.apart * (known[high] - known[low]), (known[high] + known[low]) / 2
        stencil, valid = [low, high], [np.ones(len(times), bool)] * 2
        for _ in range(DELAYS.stencil - 2):
            lower = np.minimum(np.searchsorted(known, known[low] - apart, side="right"), low) - 1
            upper = np.maximum(np.searchsorted(known, known[high] + apart, side="left"), high + 1)
            nearer = middle - known[lower] <= known[np.clip(upper, 0, number - 1)] - middle
            shift_left = (lower >= 0) & ((upper >= number) | nearer)
            shift_right = ~shift_left & (upper < number)
            low, high = np.where(shift_left, lower, low), np.where(shift_right, upper, high)
            stencil.append(np.where(shift_left, lower, high))
            valid.append(shift_left | shift_right)
        chosen, used = np.column_stack(stencil), np.column_stack(valid)
        nodes = known[chosen]
        scale = (known[high] - known[low])[:, None]
        away, between = (times[:, None] - nodes) / scale, (nodes[:, :, None] - nodes[:, None, :]) / scale[:, :, None]
        weights = np.where(used, 1.0, 0.0)
        for j in range(DELAYS.stencil):
            partners = used[:, j:j + 1] & (np.arange(DELAYS.stencil) != j) & used
            weights = np.where(partners, weights * away[:, j:j + 1] / np.where(partners, between[:, :, j], 1.0), weights)
        return np.asarray(np.einsum("nk,nkr->rn", weights, self.values[chosen][:, :, rows]))


def absolute_sizes(assembly: Assembly) -> Array:
    """The sizes (n,) of the delayed variables whose share `atol` is an admissible error: changes of their sources with the
    nominal sizes of the unknowns, with the unknowns at zero and at their sizes. A source without unknowns, such as a sampled
    function of time, has no error of the integrator, and every jump of it counts."""
    delays, (x, z), u = assembly.flat.delays, assembly.arguments[1:3], assembly.arguments[4]
    slopes = ca.Function("slopes", list(assembly.arguments), [ca.jacobian(
        assembly.express(stack(d.source for d in delays)), stack([x, z]))])
    sizes = np.concatenate([assembly.x_nominal, assembly.z_nominal])
    changes = [np.abs(slopes(assembly.begin, share * assembly.x_nominal, share * assembly.z_nominal, assembly.p,
                             np.zeros(u.shape), 1.0).full()) @ sizes for share in (0.0, 1.0)]
    largest, nominal = np.max(changes, axis=0), np.array([d.nominal for d in delays])
    return np.where(np.isfinite(largest), np.minimum(largest, nominal), nominal)


@dataclass(frozen=True)
class Return:
    """A discontinuity that returns in a delayed variable (index): its sensitivity (m,), and the column of u just after
    it."""

    delay: int
    late: Array
    column: Array


class Delays:
    """The delayed variables of one run: `begin_run`, then `open` a window, integrate in it with `inputs`, and `sample` the
    points that were reached."""

    def __init__(self, assembly: Assembly, directions: int, same: float, rtol: float, atol: float):
        self.flat, self.m, self.same, self.rtol = assembly.flat, directions, same, rtol
        self.delays = self.flat.delays
        self.n, self.offset = len(self.delays), measured_rows(self.flat)
        self.coefficients = delay_coefficients(self.flat)
        self.atol = atol * absolute_sizes(assembly)
        p, dp = self.flat.p, ca.SX.sym("dp", self.flat.p.numel())
        lengths = stack(d.delay for d in self.delays)
        self._lengths = ca.Function("delays", [p, dp], [lengths, ca.jtimes(lengths, p, dp)])
        self._rows = [np.arange(k, self.n * (1 + self.m), self.n) for k in range(self.n)]
        self._sources: dict[int, tuple[ca.Function, ca.Function]] = {}
        reduced = assembly.reduced
        used = {s.element_hash() for s in ca.symvar(stack([reduced.ode, reduced.alg, reduced.unknowns()]))}
        self.rated = [any(s.element_hash() in used for s in split(d.symbols)[1:]) for d in self.delays]

    def begin_run(self, t: float, end: float, p: Array, dp: Array) -> None:
        """Begin at a time with parameters (n_p,) and their directions (n_p, m); SimulationError for a delay that is too
        short to be integrated."""
        self.begin, columns = t, np.column_stack([np.zeros(len(p)), dp])
        lengths = [np.array(v) for v in self._lengths(np.tile(p[:, None], (1, 1 + self.m)), columns)]
        self.lengths: Array = lengths[0][:, 0]
        self.moved: Array = lengths[1][:, 1:]  # dT (n, m)
        for delay, length in zip(self.delays, self.lengths.tolist(), strict=True):
            if not length >= max(2 * self.same, (end - t) / DELAYS.max_windows):
                raise SimulationError([Problem(
                    "delay-too-short", f"{delay.name} is delayed by {length:g} s, which would divide the run of "
                    f"{end - t:g} s into {(end - t) / length if length > 0 else float('inf'):.2g} windows", delay.place,
                    "Give a delay of 0 s, which passes the signal through, an approximation without history (for a Delay "
                    "`m: 3`), or run for a shorter time.")])
        # far from 0: of an instant, with which functions of time are rounded, and of the times beside a discontinuity
        self.instant = 2 * float(np.spacing(max(abs(t), abs(end))))
        self.rounding = DELAYS.beside / 2 * EVENTS.same_roundings * self.instant
        index = [d.index for d in self.delays]
        self.before: Array = np.concatenate([p[index], dp[index].T.ravel()])
        self.stretches: list[Stretch] = []
        self.starts: list[float] = []  # of the stretches, from the begin of the run
        self.breaks: list[tuple[float, Array]] = []  # discontinuities and their sensitivities (m,)
        self._next = [0] * self.n  # the first discontinuity of each delay that has not returned yet
        self.windows = 0
        self.starts_of_pieces = [[t] for _ in self.delays]
        self.pieces = [[np.zeros(DELAY_ROWS + DELAY_TERMS * self.m)] for _ in self.delays]
        self.largest: Array = np.zeros(self.n * (1 + self.m))

    # -- history ---------------------------------------------------------------------------------------------------
    def sources(self, assembly: Assembly) -> tuple[ca.Function, ca.Function]:
        """The sources (n,), and their change along directions of (x, z, p, u), in the arguments of an assembly."""
        if id(assembly) not in self._sources:
            values = assembly.express(stack(d.source for d in self.delays))
            _, x, z, p, u, _ = arguments = list(assembly.arguments)
            directions = [ca.SX.sym("d", a.numel()) for a in (x, z, p, u)]
            changes = ca.jtimes(values, stack([x, z, p, u]), stack(directions))
            self._sources[id(assembly)] = (ca.Function("sources", arguments, [values]),
                                           ca.Function("along", [*arguments, *directions], [changes]))
        return self._sources[id(assembly)]

    def values(self, assembly: Assembly, t: Array, x: Array, z: Array, p: Array, dp: Array, u: Array, along: Array) -> Array:
        """Sources and their sensitivities (n (1 + m), N) at points; x and z are (., 1 + m, N), `along` the sensitivities
        (n_u, m, N) of u."""
        n = len(t)
        function, along_function = self.sources(assembly)
        columns = (t[None, :], x[:, 0], z[:, 0], np.tile(p[:, None], (1, n)), u, np.ones((1, n)))
        samples = [np.array(function(*columns)).reshape(self.n, n)]
        for k in range(self.m):
            samples.append(np.array(along_function(*columns, x[:, 1 + k], z[:, 1 + k], np.tile(dp[:, k:k + 1], (1, n)),
                                                   along[:, k])
                                    ).reshape(self.n, n))
        return np.vstack(samples)

    def sample(self, times: Array, values: Array, beside: float = 0.0) -> None:
        """Add samples (n (1 + m), N) to the present stretch; one at its last time takes the place of the last. The values
        are those at times so much later, `beside`: just before or after a discontinuity."""
        stretch, times = self.stretches[-1], times - self.begin
        if beside < 0 and stretch.number > 1 and stretch.times[-2] < times[0] + beside - self.same:
            stretch.number -= int(stretch.times[-1] >= times[0] - self.same)
        times = times + beside
        last = stretch.times[-1] if stretch.number else -np.inf
        new = times > last + self.same
        for k in np.flatnonzero(np.abs(times - last) <= self.same).tolist():
            stretch.values[-1] = values[:, k]
        if new.any():
            stretch.add(times[new], values[:, new])
            self.largest = np.maximum(self.largest, np.abs(values[:, new]).max(axis=1))

    def coarse(self, times: Array, values: Array) -> NDArray[np.bool_]:
        """At which of the times (n,) the history, interpolated between its samples, differs from these values of the sources
        and their sensitivities (n (1 + m), n)."""
        stretch, differs = self.stretches[-1], np.zeros(len(times), bool)
        for k, rows in enumerate(self._rows):
            error = np.abs(stretch.at(times - self.begin, rows) - values[rows])
            differs |= (error > DELAYS.scatter * self._allowed(k)[:, None]).any(axis=0)
        return differs

    def insert(self, times: Array, values: Array) -> None:
        """Add samples (n (1 + m), N) between those of the present stretch."""
        self.stretches[-1].insert(times - self.begin, values)
        self.largest = np.maximum(self.largest, np.abs(values).max(axis=1))

    def cut(self, t: float, sensitivity: Array) -> None:
        """A discontinuity at a time, whose sensitivity is `sensitivity` (m,): a new stretch begins."""
        if self.stretches and not self.stretches[-1].number:
            return
        self.stretches.append(Stretch())
        self.starts.append(t - self.begin)
        self.breaks.append((t, sensitivity))

    def _history(self, k: int, times: Array) -> Array:
        """The source of a delay, with sensitivities, at times of its history, from the begin of the run (1 + m, N)."""
        rows = self._rows[k]
        history = np.tile(self.before[rows][:, None], (1, len(times)))
        first, last = (bisect_right(self.starts, float(at)) - 1 for at in (times.min(), times.max()))
        number = np.full(len(times), first)
        if first != last:
            number = first + np.searchsorted(self.starts[first + 1:last + 1], times, side="right")
        for stretch in np.unique(number[number >= 0]):
            at = number == stretch
            history[:, at] = self.stretches[stretch].at(times[at], rows)
        return history

    def _felt(self, k: int, number: int) -> bool:
        """True if the source of a delay, or a relevant derivative of it, is discontinuous at the begin of a stretch: the
        polynomial before it does not continue the values after it."""
        rows, begin = self._rows[k], self.starts[number]
        after = self.stretches[number]
        before = self.stretches[number - 1] if number else None
        if after.number < DELAYS.stencil:
            return True
        ahead = after.times[-1] - begin
        if before is not None and before.number > 1:
            wanted = 0.5 * (before.times[-1] - before.times[max(before.number - 3, 0)])
            if ahead < wanted and after is self.stretches[-1]:
                return True
            ahead = min(ahead, wanted)
        at = begin + ahead * np.array([1e-3, 0.5, 1.0])
        first = np.tile(self.before[rows][:, None], (1, 3)) if before is None else before.at(at, rows)
        differ = np.abs(after.at(at, rows) - first).max(axis=1)
        return bool(np.any(differ > self._allowed(k)))

    def _allowed(self, k: int) -> Array:
        """The admissible errors (1 + m,) of a delayed variable and its sensitivities."""
        scale = self.largest[self._rows[k]]
        relative, absolute = max(self.rtol, self.instant / self.lengths[k]), np.where(np.arange(1 + self.m), 0.0, 1.0)
        return np.asarray(DELAYS.tolerance * (relative * scale + self.atol[k] * absolute) + 1e-13 * scale + 1e-300)

    # -- windows ---------------------------------------------------------------------------------------------------
    def open(self, t: float, limit: float) -> tuple[float, float]:
        """Open a window at a time: its end, and the longest interval in it that one polynomial follows. `inputs` then gives
        the pieces in this window."""
        end = min(limit, t + float(self.lengths.min()))
        for k, length in enumerate(self.lengths.tolist()):
            while self._next[k] < len(self.breaks):
                back = self.breaks[self._next[k]][0] + length
                if back > t + self.same and (back > end or self._felt(k, self._next[k])):
                    end = min(end, back)
                    break
                self._next[k] += 1
        if limit - end <= self.same:
            end = limit
        self.windows += 1
        pieces = [self._fitted(k, t, end) for k in range(self.n)]
        shortest = min(b - a for fitted in pieces for a, b, _ in fitted)
        while shortest * DELAYS.parts < end - t:  # up to where a short transient in the history begins, or through it
            half = (t + end) / 2
            end = max(half, t + 2 * shortest)
            # the pieces of the first half of a window that was divided are those of that half
            pieces = [[piece for piece in fitted if piece[1] <= half] if end == half and len(fitted) > 1 else
                      self._fitted(k, t, end) for k, fitted in enumerate(pieces)]
            shortest = min(b - a for fitted in pieces for a, b, _ in fitted)
        for k, fitted in enumerate(pieces):
            starts, columns = self.starts_of_pieces[k], self.pieces[k]
            while starts and starts[-1] >= t - self.same:
                starts.pop()
                columns.pop()
            starts += [a for a, _, _ in fitted]
            columns += [column for _, _, column in fitted]
        return end, shortest

    def returned(self, t: float) -> list[Return]:
        """The discontinuities that return at a time, in the order in which they happened."""
        returns = []
        for k, length in enumerate(self.lengths.tolist()):
            at = self._next[k]
            while at < len(self.breaks) and self.breaks[at][0] + length <= t + self.same:
                if self.breaks[at][0] + length >= t - self.same:
                    column = np.zeros(DELAY_ROWS)
                    column[:4] = 1.0, t, 0.0, self.stretches[at].values[0, k]
                    returns.append(Return(k, self.breaks[at][1] + self.moved[k], column))
                at += 1
        return returns

    def check_jump(self, k: int, t: float, before: Array, after: Array) -> None:
        """Raise SimulationError if a delayed variable jumps from one column of u to another and the equations need its rate:
        the impulse would be ignored without a warning."""
        first, then = (float((1 - u[0]) * self.before[k] + np.polyval(u[:2:-1], u[2] * (t - u[1]))) for u in (before, after))
        delay = self.delays[k]
        if self.rated[k] and abs(then - first) > EVENTS.continuous * delay.nominal:
            raise SimulationError([Problem(
                "delay-impulse", f"at t = {t:.6g} s {delay.name} jumps from {first:.6g} to {then:.6g} in SI, and other "
                "equations need its rate", delay.place, "That takes an infinite force, flow, voltage or current. Let its "
                "source change in a finite time: a Ramp, a PolynomialMotion, or a SecondOrderLag behind what jumps.")])

    def _fitted(self, k: int, begin: float, end: float) -> list[tuple[float, float, Array]]:
        """Polynomial pieces (begin, end, column) of a delayed variable over a window."""
        length = float(self.lengths[k])
        if end - length <= self.begin + self.same:
            return [(begin, end, np.zeros(DELAY_ROWS + DELAY_TERMS * self.m))]
        fitted, allowed = list[tuple[float, float, Array]](), self._allowed(k)
        a, b = np.array([begin]), np.array([end])
        for depth in range(DELAYS.halvings + 1):  # all intervals of one length in one call
            columns, errors = self._pieces(k, a, b)
            split = np.any(errors > allowed, axis=1) & (b - a > DELAYS.shortest * self.same) & (depth < DELAYS.halvings)
            fitted += [(float(a[n]), float(b[n]), columns[n]) for n in np.flatnonzero(~split)]
            if not split.any():
                break
            a, b = a[split], b[split]
            middle = (a + b) / 2
            a, b = np.column_stack([a, middle]).ravel(), np.column_stack([middle, b]).ravel()
        return sorted(fitted, key=lambda piece: piece[0])

    def _pieces(self, k: int, a: Array, b: Array) -> tuple[Array, Array]:
        """The columns (N, .) of pieces from a to b (N,): v, t_0, r, then the coefficients of the variable and of its
        sensitivities; and the errors (N, 1 + m) of the interpolation, also at the samples of the history, between which a
        short motion may lie."""
        middle, half, length = (a + b) / 2, (b - a) / 2, float(self.lengths[k])
        back = middle - self.begin - length  # the middle in the history, from the begin of the run: not rounded far from 0
        at = back[:, None] + half[:, None] * np.concatenate([_NODES, _BETWEEN])
        values = self._history(k, at.ravel()).reshape(1 + self.m, *at.shape).swapaxes(0, 1)
        terms = values[:, :, :DELAY_TERMS] @ _TO_TERMS.T
        errors = np.abs(terms @ _CHECKED.T - values[:, :, DELAY_TERMS:]).max(axis=2)
        allowed = self._allowed(k)
        for n in np.flatnonzero(np.all(errors <= allowed, axis=1)):
            first_at, last_at = a[n] - self.begin - length, b[n] - self.begin - length
            stretches = slice(max(bisect_right(self.starts, first_at) - 1, 0), bisect_left(self.starts, last_at))
            for stretch in self.stretches[stretches]:
                first, last = np.searchsorted(stretch.times, (first_at, last_at))
                if last > first:
                    chosen = np.linspace(first, last - 1, min(last - first, DELAYS.piece_samples)).astype(int)
                    away = stretch.times[chosen] - (middle[n] - self.begin) + length
                    powers = np.vander(away / half[n], DELAY_TERMS, increasing=True)
                    samples = stretch.values[np.ix_(chosen, self._rows[k])].T
                    errors[n] = np.maximum(errors[n], np.abs(terms[n] @ powers.T - samples).max(axis=1) / DELAYS.scatter)
        slopes = np.pad(terms[:, 0, 1:] * np.arange(1, DELAY_TERMS), ((0, 0), (0, 1))) / half[:, None]
        terms[:, 1:] -= self.moved[k][:, None] * slopes[:, None, :]
        return np.column_stack([np.ones(len(a)), middle, 1 / half, terms.reshape(len(a), -1)]), errors

    # -- inputs ----------------------------------------------------------------------------------------------------
    def inputs(self, times: Array) -> tuple[Array, Array]:
        """The rows of u (n DELAY_ROWS, N) of the delayed variables, and the coefficients (m n DELAY_TERMS, N) of their
        sensitivities, at times; of an instant that occurs twice in turn the first is before a discontinuity."""
        if not len(times):
            return self._stacked([np.zeros((DELAY_ROWS + DELAY_TERMS * self.m, 0))] * self.n)
        first, columns = np.append(times[:-1] == times[1:], False).tolist(), []
        for starts, pieces in zip(self.starts_of_pieces, self.pieces, strict=True):
            # few of many: a search in the whole list for each is shorter than an array of it
            at = ((bisect_left if before else bisect_right)(starts, t) - 1 for before, t in zip(first, times.tolist(),
                                                                                               strict=True))
            columns.append(np.column_stack([pieces[max(k, 0)] for k in at]))
        return self._stacked(columns)

    def _stacked(self, columns: list[Array]) -> tuple[Array, Array]:
        along = [c[DELAY_ROWS + DELAY_TERMS * i:DELAY_ROWS + DELAY_TERMS * (i + 1)] for i in range(self.m) for c in columns]
        n = columns[0].shape[1]
        return np.vstack([c[:DELAY_ROWS] for c in columns]), np.vstack(along) if along else np.zeros((0, n))

    def call_inputs(self, begin: float, times: Array) -> Array:
        """As `inputs`, one below the other, for the intervals between points (n,) of one call of the integrator: as few
        pieces as follow the history, each over whole intervals."""
        edges, columns = np.append(begin, times), []
        for k in range(self.n):
            whole, waiting = np.zeros((DELAY_ROWS + DELAY_TERMS * self.m, len(times))), [(0, len(times))]
            allowed = self._allowed(k)
            if edges[-1] - self.lengths[k] > self.begin + self.same:
                while waiting:
                    found, errors = self._pieces(k, edges[[a for a, _ in waiting]], edges[[b for _, b in waiting]])
                    tried, waiting = waiting, []
                    for (a, b), column, error in zip(tried, found, errors, strict=True):
                        if b - a > 1 and np.any(error > allowed):
                            waiting += [(a, (a + b) // 2), ((a + b) // 2, b)]
                        else:
                            whole[:, a:b] = column[:, None]
            columns.append(whole)
        return np.vstack(self._stacked(columns))

    def along(self, coefficients: Array, n_u: int) -> Array:
        """The sensitivities (n_u, m, N) of u by the coefficients (m n DELAY_TERMS, N)."""
        sensitivities = np.zeros((n_u, self.m, coefficients.shape[1]))
        each = coefficients.reshape(self.m, len(self.coefficients), coefficients.shape[1])
        sensitivities[self.coefficients] = each.transpose(1, 0, 2)
        return sensitivities
