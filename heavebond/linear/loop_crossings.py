"""Frequencies at which a transfer function has a given magnitude or a real value, over the whole imaginary axis.

For L(s) = C (s - A)^-1 B + D with real matrices the conjugate on the imaginary axis is L(-s) = D + B^T (-s - A^T)^-1 C^T. So

    |L(j w)| = g   where  L(s) L(-s) = g^2:  s [x, l] = [A x + B u, -A^T l - C^T y],  y = C x + D u,  g^2 u = B^T l + D y,
    Im L(j w) = 0  where  L(s) - L(-s) = 0:  s [x, l] = [A x + B u, -A^T l - C^T u],  0 = C x - B^T l,

are eigenvalue problems of pencils, and every crossing is among their eigenvalues, however far from the poles it lies. These
only place the brackets: between two neighbouring ones the sign of the function cannot change, and each change is refined
on the transfer function itself. The least |1 + L| is found in the same way: a minimum is the least of all where no frequency
has a smaller value (N. A. Bruinsma, M. Steinbuch, Systems & Control Letters 14 (1990) 287-293,
doi:10.1016/0167-6911(90)90049-Z).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, UsageError
from heavebond.linear.linear_system import dense_response
from heavebond.linear.stability import eigenvalues
from heavebond.linear.zero_frequency import leading, states_between, with_zeros_at_zero
from heavebond.numerics.dae import Array

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class CrossingConstants:
    """The constants of the search for crossings of a loop's frequency response.

    resolved: imaginary part, over the value, below which it is rounding and has no sign. Origin: evaluations of large
        systems. Doubled: nothing.
    infinite: multiple of the largest pole beyond which a zero of a pencil is at infinity. Origin: errors of the QZ
        algorithm. Doubled: nothing.
    zero: share of the largest pole below which a zero of a pencil is at 0. Origin: as above. Doubled: nothing.
    on_axis: damping ratio below which a pole is passed on both sides. Origin: rounding of eigenvalues. Doubled: nothing.
    beside: distance at which such a pole is passed, relative to its frequency. Origin: rounding. Doubled: nothing.
    points_per_decade: points for each decade in addition to the points from the pencils. Origin: dead times are not in the
        pencils. Doubled: time.
    closer: share by which a lower |1 + L| would be looked for. Origin: digits shown. Doubled: nothing.
    max_rounds: rounds of halving. Origin: rounding. Doubled: nothing.
    close_enough: share of the least |1 + L| by which intervals must be able to come nearer to be halved. Origin: digits
        shown. Doubled: a thousandth of the modulus margin.
    points_per_turn: points for each turn of a dead time's phase. Origin: far closer than half a turn. Doubled: time.
    max_points: points of all. Origin: memory. Doubled: longer dead times.
    """

    resolved: float = 1e-10
    infinite: float = 1e9
    zero: float = 1e-13
    on_axis: float = 1e-7
    beside: float = 1e-12
    points_per_decade: int = 24
    closer: float = 1e-6
    max_rounds: int = 30
    close_enough: float = 1e-3
    points_per_turn: int = 16
    max_points: int = 200_000


CROSSINGS = CrossingConstants()


@dataclass(frozen=True)
class Transfer:
    """L(s) = C (s - A)^-1 B + D with rates counted in `rate` (1/s): a (n, n), b (n,), c (n,) balanced; e^(-s dead_time) L
    is the loop with a dead time in s. With `exact`, a function of omega (N,) in rad/s, the matrices are an approximation of
    a loop with delayed variables, whose delays together are `lag` (s), and place the brackets only."""

    a: Array
    b: Array
    c: Array
    d: float
    rate: float
    dead_time: float = 0.0
    exact: Callable[[Array], Complex] | None = None
    lag: float = 0.0

    @property
    def turning(self) -> float:
        """The time (s) of all delays, with which the phase turns without end."""
        return self.dead_time + self.lag

    def rational(self, omega: Array) -> Complex:
        """L (N,) at omega (N,) in rad/s, without the dead time."""
        if self.exact is not None:
            return self.exact(np.atleast_1d(np.asarray(omega, dtype=float)))
        s = 1j * np.atleast_1d(np.asarray(omega, dtype=float)) / self.rate
        if not len(self.a):
            return np.full(len(s), self.d, complex)
        values = self._strictly_proper(s)
        beside = CROSSINGS.beside
        while (poles := np.isinf(np.abs(values))).any() and beside < CROSSINGS.on_axis:  # undamped ones: just beside them
            values[poles] = self._strictly_proper(s[poles] * (1 + beside))
            beside *= 10
        return np.asarray(values + self.d, dtype=complex)

    def _strictly_proper(self, s: Complex) -> Complex:
        """C (s - A)^-1 B (N,), infinite at a pole."""
        return dense_response(self.a, self.b[:, None], self.c[None, :], s)[:, 0, 0]

    def significant(self, omega: Array) -> NDArray[np.bool_]:
        """Whether C (s - A)^-1 B at omega (N,) in rad/s exceeds the rounding errors of its terms, the largest of which is
        |C| |B|/|s| far above all rates; they are n times the precision. Otherwise its phase is a rounding error."""
        if self.exact is not None or not len(self.a):
            return np.ones(len(omega), dtype=bool)
        s = np.asarray(1j * omega / self.rate, dtype=complex)
        terms = float(np.linalg.norm(self.b) * np.linalg.norm(self.c)) / np.maximum(np.abs(s), 1.0)
        return np.asarray(np.abs(self._strictly_proper(s)) > len(self.a) * np.finfo(float).eps * terms)

    def at(self, omega: Array) -> Complex:
        """L (N,) with its dead time at omega (N,) in rad/s."""
        return np.asarray(self.rational(omega) * np.exp(-1j * np.atleast_1d(omega) * self.dead_time))

    def one(self, omega: float) -> complex:
        """L at one frequency in rad/s."""
        return complex(self.at(np.array([omega]))[0])

    @property
    def poles(self) -> Complex:
        """The eigenvalues of A in 1/s, zeros exact."""
        return eigenvalues(self.a) * self.rate

    @cached_property
    def static(self) -> float:
        """L(0), infinite with an integrator that no zero cancels."""
        return leading(self.a, self.b, self.c, np.array([self.d])).gain


def transfer(a: Array, b: Array, c: Array, d: float, dead_time: float = 0.0) -> Transfer:
    """A transfer function from a (n, n), b (n,), c (n,), d: uncontrollable and unobservable states are left out by
    structure, the others balanced, and time is scaled by the fastest rate."""
    from scipy.linalg import matrix_balance

    selected = states_between(a, b, c)
    a, b, c = a[np.ix_(selected, selected)], b[selected], c[selected]
    if not len(a):
        return Transfer(a, b, c, d, 1.0, dead_time)
    balanced, (scale, _) = matrix_balance(a, permute=False, separate=True)
    a, b, c = np.asarray(balanced, dtype=float), b / scale, c * scale
    rate = float(np.abs(a).max()) or 1.0
    size = np.sqrt(np.linalg.norm(b / rate) / np.linalg.norm(c))
    return Transfer(a / rate, b / rate / size, c * size, d, rate, dead_time)


def zeros(of: Transfer) -> Complex:
    """The zeros in 1/s."""
    n = len(of.a)
    zeros = _finite(np.block([[of.a, of.b[:, None]], [of.c[None, :], np.array([[of.d]])]]), n) * of.rate
    power = leading(of.a, of.b, of.c, np.array([of.d]), n).power
    return zeros if power is None else with_zeros_at_zero(zeros, power + int(np.count_nonzero(of.poles == 0)))


def magnitude_crossings(of: Transfer, level: float = 1.0, shift: float = 0.0) -> list[float]:
    """Every omega > 0 in rad/s at which |shift + L| without its dead time passes through a level."""
    marks = np.abs(_magnitude_marks(of, level, shift).imag)
    more = _steps(of, float(marks.max(initial=0.0)), CROSSINGS.points_per_turn) if of.lag else np.zeros(1)
    return _refined(of, marks, lambda omega: np.log(np.abs(shift + of.rational(omega)) / level), more)


def _magnitude_marks(of: Transfer, level: float, shift: float) -> Complex:
    """The eigenvalues in 1/s of L(s) L(-s) = level^2 with shift + L in place of L."""
    n, d = len(of.a), (of.d + shift) / level
    b, c = of.b[:, None], of.c[None, :] / level
    o, column = np.zeros((n, n)), np.zeros((n, 1))
    pencil = np.block([[of.a, o, b, column], [o, -of.a.T, column, -c.T],
                       [c, column.T, np.array([[d, -1.0]])], [column.T, b.T, np.array([[-1.0, d]])]])
    return _finite(pencil, 2 * n) * of.rate


def real_crossings(of: Transfer) -> list[float]:
    """Every omega > 0 in rad/s at which L is real. With a dead time there are infinitely many: all below the last frequency
    at which |L| exceeds the largest value below 1 at a crossing."""
    marks = np.abs(_real_marks(of).imag)
    if not of.turning:
        return _refined(of, marks, lambda omega: _sine(of.at(omega)), np.zeros(0))
    turn = 2 * np.pi / of.turning
    span = max(magnitude_crossings(of), default=0.0) + 2 * turn
    while True:
        crossings = _refined(of, marks, lambda omega: _sine(of.at(omega)), _steps(of, span, CROSSINGS.points_per_turn))
        values = of.at(np.array(crossings))
        sizes = np.abs(values[(values.real < 0) & (np.abs(values) < 1)])
        last = max(magnitude_crossings(of, float(sizes.max())), default=0.0) if len(sizes) else 0.0
        if last <= span:
            return crossings if not of.lag else [omega for omega in crossings if omega <= span]
        span = last + turn


def _steps(of: Transfer, span: float, turn: int) -> Array:
    """Frequencies in rad/s up to a span, so many for each turn of the dead time's phase; UsageError for too many."""
    number = int(np.ceil(span * of.turning / (2 * np.pi) * turn))
    if number > CROSSINGS.max_points:
        raise UsageError([Problem("dead-time-long", f"the phase of a dead time of {of.turning:g} s turns {number // turn} "
                                  "times where the loop still has gain", None, "Take a shorter one.")])
    return np.asarray(np.arange(1, number + 1) * (2 * np.pi / turn / of.turning), dtype=float)


def _real_marks(of: Transfer) -> Complex:
    n, o = len(of.a), np.zeros((len(of.a), len(of.a)))
    b, c = of.b[:, None], of.c[None, :]
    pencil = np.block([[of.a, o, b], [o, -of.a.T, -c.T], [c, -b.T, np.zeros((1, 1))]])
    return _finite(pencil, 2 * n) * of.rate


def _sine(values: Complex) -> Array:
    """Im L / |L|, and zero if that is rounding."""
    share = values.imag / np.maximum(np.abs(values), 1e-300)
    return np.where(np.abs(share) > CROSSINGS.resolved, share, np.nan)


def least_distance(of: Transfer) -> tuple[float, float]:
    """The least |1 + L| over all frequencies, and its omega in rad/s (0 and inf count)."""
    marks = np.abs(np.concatenate([_magnitude_marks(of, 1.0, 1.0), _real_marks(of)]).imag)
    best = (abs(1 + of.d), np.inf)
    if np.isfinite(of.static):
        best = min(best, (abs(1 + of.static), 0.0))
    best = min(best, _nearest(of, _nodes(of, marks, np.zeros(0))))
    if of.turning:  # where |L| is below 1 - d, -1 is farther away than d
        span = max(magnitude_crossings(of, max(1 - best[0], 1e-3)), default=0.0) + 2 * np.pi / of.turning
        return min(best, _nearest(of, _nodes(of, marks, _steps(of, span, 2 * CROSSINGS.points_per_turn))))
    for _ in range(CROSSINGS.max_rounds):
        lower = magnitude_crossings(of, (1 - CROSSINGS.closer) * best[0], 1.0) if best[0] > 0 else []
        if len(lower) < 2:
            break
        best = min(best, _nearest(of, np.unique([*lower, *np.sqrt(np.array(lower[:-1]) * np.array(lower[1:]))])))
    return best


def _nearest(of: Transfer, nodes: Array) -> tuple[float, float]:
    """The least |1 + L| and its omega: intervals are halved if the arc between two nodes, estimated from its chord, could
    approach -1 more closely than any node; the nearest is refined."""
    from scipy.optimize import minimize_scalar

    points = 1 + of.at(nodes)
    for _ in range(CROSSINGS.max_rounds):
        sizes = np.abs(points)
        below = np.minimum(sizes[:-1], sizes[1:]) - np.abs(np.diff(points)) < (1 - CROSSINGS.close_enough) * sizes.min()
        halved = np.flatnonzero(below & (np.diff(nodes) > CROSSINGS.close_enough**3 * nodes[1:]))
        if not len(halved):
            break
        more = (nodes[halved] + nodes[halved + 1]) / 2
        nodes, points = np.insert(nodes, halved + 1, more), np.insert(points, halved + 1, 1 + of.at(more))
    k = int(np.argmin(np.abs(points)))
    nearest = (float(abs(points[k])), float(nodes[k]))
    low, high = float(nodes[max(k - 1, 0)]), float(nodes[min(k + 1, len(nodes) - 1)])
    near = minimize_scalar(lambda log: abs(1 + of.one(float(np.exp(log)))), bounds=(np.log(low), np.log(high)),
                           method="bounded", options={"xatol": 1e-12})
    return min(nearest, (float(near.fun), float(np.exp(near.x))))


def _finite(pencil: Array, n: int) -> Complex:
    """The finite eigenvalues of a pencil whose first n rows are differential."""
    from scipy.linalg import eigvals

    if not n:
        return np.zeros(0, complex)
    mass = np.zeros_like(pencil)
    mass[:n, :n] = np.eye(n)
    top, bottom = eigvals(pencil, mass, homogeneous_eigvals=True)
    is_finite = np.abs(top) < CROSSINGS.infinite * np.abs(bottom)
    return np.asarray(top[is_finite] / bottom[is_finite], dtype=complex)


def critical_frequencies(of: Transfer) -> Array:
    """|s| in rad/s of the poles, the zeros and the marks of gain 1 that are not zero; without any, the rate of A."""
    sizes = np.abs(np.concatenate([of.poles, zeros(of)]))
    marks = np.abs(_magnitude_marks(of, 1.0, 0.0))
    every = np.concatenate([sizes, marks])
    rates = every[(every > CROSSINGS.zero * of.rate) & np.isfinite(every)]
    return np.unique(rates) if len(rates) else np.array([of.rate])


def _nodes(of: Transfer, marks: Array, more: Array) -> Array:
    """Frequencies in rad/s between which a function of L changes its sign once at most."""
    critical = critical_frequencies(of)
    marks = marks[(marks > CROSSINGS.zero * of.rate) & np.isfinite(marks)]
    ends = np.unique(np.concatenate([critical, marks]))
    low, high = float(ends[0]) / 30, float(ends[-1]) * 30
    between = np.sqrt(ends[:-1] * ends[1:])
    grid = np.geomspace(low, high, int(CROSSINGS.points_per_decade * np.log10(high / low)) + 2)
    sides = [ends * (1 + sign * step) for step in (1e-2, 1e-4, 1e-6) for sign in (-1, 1)]
    resonant = [p.imag + max(abs(p.real), 1e-6 * abs(p)) * np.linspace(-6, 6, 49)
                for p in of.poles if 0 < abs(p.real) < 0.1 * p.imag]
    every = np.concatenate([between, grid, *sides, *resonant, more])
    every = np.unique(every[every > 0])
    # a pole comes here as several methods find it: a node beside it by rounding could stand on the wrong side
    near = np.abs(every[:, None] - _on_axis(of)) <= CROSSINGS.on_axis * every[:, None]
    return np.asarray(every[~near.any(axis=1)])


def _on_axis(of: Transfer) -> Array:
    """Frequencies of poles on the imaginary axis, in rad/s."""
    return np.unique([p.imag for p in of.poles if p.imag > 0 and abs(p.real) <= CROSSINGS.on_axis * abs(p)])


def _refined(of: Transfer, marks: Array, function: Callable[[Array], Array], more: Array) -> list[float]:
    """The sign changes of a function of omega, without poles on the axis."""
    from scipy.optimize import brentq

    nodes = _nodes(of, marks, more[more > 0])
    nodes = nodes[of.significant(nodes)]
    values = function(nodes)
    known = np.isfinite(values) & (values != 0)  # a node that is a crossing itself lies between two others
    nodes, values = nodes[known], values[known]
    walls, roots = _on_axis(of), []
    for k in np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0).tolist():
        low, high = float(nodes[k]), float(nodes[k + 1])
        if np.any((walls > low) & (walls < high)):
            continue
        roots.append(float(brentq(lambda w: float(np.nan_to_num(function(np.array([w]))[0])), low, high,
                                  xtol=1e-15 * low, rtol=1e-14)))
    return roots
