"""Direct collocation of the assembled equations: the input of least cost as a nonlinear programme.

In each interval [t_k, t_k + h] the states are polynomials of degree 3 that satisfy x' = f(t, x, z, w), 0 = g(t, x, z, w) at
the three points of Radau, of which the last is the end of the interval (Radau IIA: order 5, stiffly accurate). States are
continuous; inputs w are straight lines between the breaks, or constant. All states, algebraic unknowns and inputs at all
points are unknowns of one sparse programme, which IPOPT solves with exact first and second derivatives. A maximum over time
is one more unknown with an inequality at each point.

L. T. Biegler, Nonlinear Programming, SIAM, 2010, chapters 8 to 10. A. Waechter, L. T. Biegler, Mathematical Programming 106
(2006) 25-57 (IPOPT).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.core.cancellation import check
from heavebond.core.progress import Progress
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.inputs import Pieced
from heavebond.optimise.costs import Cost

INTEGRALS = {"integral": 1, "mean": 1, "rms": 2}  # and the power of the signal
EXTREMES = ("peak", "largest", "highest", "lowest")
SUPPORTED = (*INTEGRALS, *EXTREMES, "deviation", "final")
DEGREE = 3


@dataclass(frozen=True)
class CollocationConstants:
    """The constants of the transcription and of its solution.

    smoothing: cost, over that of the first guess, of an input that crosses its range once in a twentieth of the horizon.
        Origin: selects the smoothest of inputs with equal cost, below the printed digits. Doubled: nothing.
    fine: error of an interval, over the size of a state, above which it is halved. Origin: the run differs by less than a
        thousandth then. Doubled: fewer intervals.
    rounds: rounds of halving, at most. Origin: three halvings resolve a front of an eighth of an interval. Doubled: time.
    most: intervals, as a multiple of the first number, at most. Origin: time and memory. Doubled: both.
    small: share of its nominal size below which the motion of a state in the guess does not scale it. Origin: states at rest
        in the guess may move in the result. Doubled: nothing.
    iterations: of IPOPT for one grid, at most. Origin: usual programmes need 10 to 100, the valve command of the compensator
        265. Doubled: time until it gives up.
    tolerance: of the optimality conditions of the scaled programme. Origin: the cost has six digits. Doubled: nothing.
    """

    smoothing: float = 1e-6
    fine: float = 1e-3
    rounds: int = 3
    most: int = 4
    small: float = 1e-3
    iterations: int = 500
    tolerance: float = 1e-7


COLLOCATION = CollocationConstants()


@dataclass(frozen=True)
class Trajectory:
    """A solution: `breaks` (N+1,) in s; states x (n, 1 + 3 N) and algebraic unknowns z (n_z, 1 + 3 N) in SI at the `times`
    of the breaks and collocation points, inputs w (m, N+1) at the breaks. `errors` (N,) are those of the intervals."""

    breaks: Array
    times: Array
    x: Array
    z: Array
    w: Array
    values: tuple[Array, ...]
    errors: Array
    iterations: int
    status: str


@dataclass(frozen=True)
class Programme:
    """An optimal control problem before its discretisation.

    The last m inputs of the assembly are free, within bounds (m,) in SI, and constant between breaks if `held`. `costs` are
    the cost and then the limits, which must not exceed zero; `references` are their functionals in the reference run.
    `at_end` prescribes values of signals at the end. `periodic` lists the states of a periodic motion, None otherwise. The
    duration has a range, or None."""

    assembly: Assembly
    costs: Sequence[Cost]
    references: Sequence[Array]
    low: Array
    high: Array
    held: bool
    at_end: Sequence[tuple[ca.SX, float, float]]
    periodic: Sequence[int] | None
    duration: tuple[float, float] | None
    records: Pieced


def radau() -> tuple[Array, Array, Array]:
    """The points of Radau (3,) in [0, 1], the derivatives (4, 3) there of the polynomials of Lagrange through 0 and the
    points, and the weights (3,) of the quadrature."""
    points = ca.collocation_points(DEGREE, "radau")
    derivatives, _, weights = ca.collocation_coeff(points)
    return np.array(points), np.array(derivatives), np.array(weights).ravel()


def times_of(breaks: Array) -> Array:
    """The times (1 + 3 N,) of the first break and of all collocation points; the last of an interval is its end exactly."""
    inner = breaks[:-1, None] + np.diff(breaks)[:, None] * radau()[0]
    inner[:, -1] = breaks[1:]
    return np.concatenate([breaks[:1], inner.ravel()])


def _records_about(programme: Programme, times: Array) -> Array:
    """The polynomials (4 n, K) of the records, moved to given times."""
    if not programme.records.columns.size:
        return np.zeros((0, len(times)))
    columns = programme.records.at(times)
    s, (c0, c1, c2, c3) = times - columns[0], np.moveaxis(columns[1:].reshape(-1, 4, len(times)), 1, 0)
    shifted = [c0 + s * (c1 + s * (c2 + s * c3)), c1 + s * (2 * c2 + 3 * s * c3), c2 + 3 * s * c3, c3]
    return np.stack(shifted, axis=1).reshape(-1, len(times))


def pieces_of(programme: Programme, breaks: Array, w: Array) -> Pieced:
    """The inputs of a run: the records, and the free inputs by their values at the breaks (m, N+1)."""
    records = programme.records
    inner = records.inner_breaks(breaks[0], breaks[-1]) if records.columns.size else np.zeros(0)
    every = np.union1d(breaks, inner)
    first = every[:-1]
    place = np.searchsorted(breaks, first, side="right") - 1
    slope = np.zeros((len(w), len(breaks) - 1)) if programme.held else np.diff(w, axis=1) / np.diff(breaks)
    free = np.zeros((len(w), 4, len(first)))
    free[:, 0] = w[:, place] + slope[:, place] * (first - breaks[place])
    free[:, 1] = slope[:, place]
    return Pieced(every, np.vstack([first, _records_about(programme, first), free.reshape(4 * len(w), -1)]))


class Transcription:
    """The nonlinear programme of a `Programme` on a grid.

    Unknowns are, scaled: the states at the first break `x0` (n,), states `x` (n, K) and algebraic unknowns `z` (n_z, K) at
    the K = 3 N points, inputs `w` (m, N+1) at the breaks as shares of their ranges, the duration in s, and the integrals and
    extremes.
    """

    def __init__(self, programme: Programme, breaks: Array, guess: tuple[Array, Array, Array]):
        """`guess` are x (n, 1 + K) and z (n_z, 1 + K) at `times_of(breaks)` in SI, and w (m, N+1)."""
        self.programme, self.breaks, self.guess = programme, breaks, guess
        assembly = programme.assembly
        self.n, self.n_z, self.m = (len(rows) for rows in guess)
        self.intervals, self.points = len(breaks) - 1, DEGREE * (len(breaks) - 1)
        self.begin, self.length = float(breaks[0]), float(breaks[-1] - breaks[0])
        self.steps = np.diff(breaks) / self.length  # as shares of the horizon
        self.shares = (times_of(breaks)[1:] - self.begin) / self.length
        self.x_size, self.z_size = (np.maximum(np.abs(rows).max(axis=1, initial=0.0), COLLOCATION.small * nominal)
                                    if len(rows) else nominal for rows, nominal in zip(
            guess[:2], (assembly.x_nominal, assembly.z_nominal), strict=True))
        self.w_size = programme.high - programme.low
        self.functionals = [f for cost in programme.costs for f in cost.functionals]
        t, x, z, p, u, rate = assembly.arguments
        known, values = ca.vertcat(p, rate), ca.vertcat(ca.DM(assembly.p), 1)
        signals = ca.vertcat(ca.SX(0, 1), *(f.signal for f in self.functionals))
        ends = ca.vertcat(ca.SX(0, 1), *(signal for signal, _, _ in programme.at_end))
        self.laws = ca.Function("laws", [t, x, z, u], ca.cse([
            ca.densify(e) for e in ca.substitute([assembly.ode, assembly.alg, signals, ends], [known], [ca.SX(values)])]))
        by_z = ca.Function("by_z", [t, x, z, u], ca.substitute([ca.jacobian(assembly.alg, z)], [known], [ca.SX(values)]))
        first = pieces_of(programme, breaks, guess[2]).at(breaks[:1])
        slopes = np.abs(np.array(by_z(self.begin, guess[0][:, 0], guess[1][:, 0], first))) * self.z_size
        largest = slopes.max(axis=1, initial=0.0) if self.n_z else np.zeros(0)
        self.alg_weight = np.where(np.isfinite(largest) & (largest > 0), 1 / np.maximum(largest, 1e-300), 1.0)
        times = self.begin + self.length * self.shares
        self.guessed = np.array(self.laws.map(self.points)(
            times[None, :], guess[0][:, 1:], guess[1][:, 1:], pieces_of(self.programme, self.breaks, guess[2]).at(times))[2])
        self.x0, self.x, self.z = ca.MX.sym("x0", self.n), ca.MX.sym("x", self.n, self.points), \
            ca.MX.sym("z", self.n_z, self.points)
        self.w, self.duration = ca.MX.sym("w", self.m, self.intervals + 1), ca.MX.sym("T")
        self.numbers: list[tuple[ca.MX, float, float]] = []
        self.constraints: list[tuple[ca.MX, float, float]] = []
        self._transcribe()
        self.unknowns = ca.vertcat(self.x0, ca.vec(self.x), ca.vec(self.z), ca.vec(self.w), self.duration,
                                   *(symbol for symbol, *_ in self.numbers))

    def _constrain(self, expression: ca.MX, low: float, high: float) -> None:
        self.constraints.append((ca.vec(expression), low, high))

    def _inputs(self) -> ca.MX:
        """The input columns at the points, each piece about its point: records, then value and slope of free inputs."""
        programme, column, N = self.programme, np.arange(self.points), self.intervals
        weights, slopes = np.zeros((N + 1, self.points)), np.zeros((N + 1, self.points))
        share = np.zeros(self.points) if programme.held else np.tile(radau()[0], N)
        interval = column // DEGREE
        weights[interval, column], weights[interval + 1, column] = 1 - share, share
        if not programme.held:
            slopes[interval, column], slopes[interval + 1, column] = -1 / self.steps[interval], 1 / self.steps[interval]
        span = ca.repmat(ca.DM(self.w_size), 1, self.points)
        value = ca.repmat(ca.DM(programme.low), 1, self.points) + span * (self.w @ ca.sparsify(ca.DM(weights)))
        slope = span * (self.w @ ca.sparsify(ca.DM(slopes))) / self.duration
        nothing = ca.MX.zeros(2, self.points)
        free = [row for k in range(self.m) for row in (value[k, :], slope[k, :], nothing)]
        records = _records_about(programme, self.begin + self.length * self.shares)
        return ca.vertcat(self._times(), *([ca.MX(ca.DM(records))] if len(records) else []), *free)

    def _times(self) -> ca.MX:
        return self.begin + self.duration * ca.DM(self.shares).T

    def _transcribe(self) -> None:
        """Add the equations, the values at the ends and the limits, and set the `objective`."""
        programme, K, N, n = self.programme, self.points, self.intervals, self.n
        _, derivatives, weights = radau()
        x_si, z_si = (rows * ca.repmat(ca.DM(size), 1, K) for rows, size in ((self.x, self.x_size), (self.z, self.z_size)))
        ode, alg, signals, end = self.laws.map(K)(self._times(), x_si, z_si, self._inputs())
        # the polynomials satisfy the differential equations at the points
        begins = ca.horzcat(self.x0, self.x[:, DEGREE - 1:K - 1:DEGREE]) if N > 1 else self.x0
        nodes = ca.vertcat(begins, *(self.x[:, k::DEGREE] for k in range(DEGREE)))
        slopes = ca.kron(ca.sparsify(ca.DM(derivatives.T)), ca.DM.eye(n)) @ nodes
        lengths = np.repeat(self.steps[None, :], DEGREE * n, axis=0) / np.tile(self.x_size, DEGREE)[:, None]
        self._constrain(slopes - ca.reshape(ode, DEGREE * n, N) * ca.DM(lengths) * self.duration, 0, 0)
        if self.n_z:
            self._constrain(alg * ca.repmat(ca.DM(self.alg_weight), 1, K), 0, 0)
        if programme.periodic:
            self._constrain((self.x[:, -1] - self.x0)[list(programme.periodic)], 0, 0)
        for k, (_, value, size) in enumerate(programme.at_end):
            self._constrain((end[k, -1] - value) / size, 0, 0)
        quadrature = self.duration * ca.DM(np.outer(self.steps, weights).ravel())
        self.values = ca.vertcat(ca.MX(0, 1), *(self._functional(k, signals[k, :], quadrature)
                                                for k in range(len(self.functionals))))
        first, p = 0, ca.DM(programme.assembly.p)
        costs = []
        for cost, reference in zip(programme.costs, programme.references, strict=True):
            inner = [ca.MX(float(reference[k])) if is_reference else self.values[first + k]
                     for k, is_reference in enumerate(cost.references)]
            first += len(inner)
            costs.append(cost.value(ca.vertcat(ca.MX(0, 1), *inner), p))
        self.cost = costs[0]
        for limit in costs[1:]:
            self._constrain(limit, -np.inf, 0)
        changes = self.w[:, 1:] - self.w[:, :-1]
        self.roughness = ca.sumsqr(changes * ca.repmat(ca.DM(1 / np.sqrt(self.steps)).T, self.m, 1)) / 400

    def _number(self, value: float, low: float = -np.inf) -> ca.MX:
        """A further unknown, about 1, with its first value and its lower bound."""
        symbol = ca.MX.sym("s")
        self.numbers.append((symbol, value, low))
        return symbol

    def _functional(self, k: int, signal: ca.MX, quadrature: ca.MX) -> ca.MX:
        """A functional of a signal (1, K). Integrals and extremes are further unknowns: a nonlinear function of an
        integral, such as its root, would otherwise couple all points with each other in the second derivatives."""
        kind, guess = self.functionals[k].kind, self.guessed[k]
        size = float(np.abs(guess).max()) or 1.0
        if kind in EXTREMES:
            first = {"highest": np.max, "lowest": np.min}.get(kind, lambda v: np.abs(v).max())(guess)
            extreme = self._number(float(first) / size)
            bound = ca.repmat(extreme, 1, self.points)
            self._constrain(signal / size - bound if kind == "lowest" else bound - signal / size, 0, np.inf)
            if kind in ("largest", "peak"):
                self._constrain(bound + signal / size, 0, np.inf)
            return extreme * size
        if kind == "final":
            return signal[-1]
        weights = quadrature / self.duration
        if kind == "deviation":
            shares = np.repeat(self.steps, DEGREE) * np.tile(radau()[2], self.intervals)
            mean = self._number(float(guess @ shares) / size)
            self._constrain(signal @ weights / size - mean, 0, 0)
            signal, guess = signal - mean * size, guess - guess @ shares
            size = float(np.abs(guess).max()) or size
        power = INTEGRALS.get(kind, 2)
        average = self._number(float(np.mean((guess / size) ** power)), 0.0 if power == 2 else -np.inf)
        self._constrain((signal / size) ** power @ weights - average, 0, 0)
        if power == 2:
            return size * ca.sqrt(average)
        return size * average * self.duration if kind == "integral" else size * average

    def _start(self) -> tuple[Array, Array, Array]:
        """The first guess of the unknowns, and their bounds."""
        x, z, w = self.guess
        parts = [x[:, 0] / self.x_size, (x[:, 1:] / self.x_size[:, None]).T.ravel(),
                 (z[:, 1:] / self.z_size[:, None]).T.ravel(),
                 ((w - self.programme.low[:, None]) / self.w_size[:, None]).T.ravel(),
                 np.array([self.length, *(value for _, value, _ in self.numbers)])]
        start = np.concatenate(parts)
        low, high = np.full(len(start), -np.inf), np.full(len(start), np.inf)
        # the inputs are within their ranges; the states begin as in the guess unless the motion is periodic
        at = self.n + self.points * (self.n + self.n_z)
        low[at:at + w.size], high[at:at + w.size] = 0.0, 1.0
        fixed = np.ones(self.n, bool)
        fixed[list(self.programme.periodic or ())] = False
        low[:self.n][fixed] = high[:self.n][fixed] = start[:self.n][fixed]
        at += w.size
        low[at], high[at] = self.programme.duration or (self.length, self.length)
        low[at + 1:] = [least for *_, least in self.numbers]
        return start, low, high

    def solve(self, size: float, progress: Progress) -> Trajectory:
        """The solution by IPOPT; `size` is the size of the cost."""
        start, low, high = self._start()
        progress(f"{self.intervals} intervals, {len(start)} unknowns")
        objective = self.cost / size + COLLOCATION.smoothing * self.roughness
        solver = ca.nlpsol("optimal", "ipopt", {
            "x": self.unknowns, "f": objective, "g": ca.vertcat(*(g for g, _, _ in self.constraints))}, {
            "print_time": False, "show_eval_warnings": False, "ipopt": {
                "print_level": 0, "sb": "yes", "max_iter": COLLOCATION.iterations, "tol": COLLOCATION.tolerance,
                "acceptable_tol": 100 * COLLOCATION.tolerance, "mu_strategy": "monotone"}})
        bounds = (np.concatenate([np.full(g.numel(), side[k]) for g, *side in self.constraints]) for k in (0, 1))
        check()
        solution = solver(x0=start, lbx=low, ubx=high, **dict(zip(("lbg", "ubg"), bounds, strict=True)))
        check()
        return self._trajectory(np.array(solution["x"]).ravel(), solver.stats())

    def _trajectory(self, solution: Array, stats: Mapping[str, object]) -> Trajectory:
        n, n_z, m, K, N = self.n, self.n_z, self.m, self.points, self.intervals
        x0, x, z, w, last = np.split(solution, np.cumsum([n, K * n, K * n_z, m * (N + 1)]))
        length = float(last[0])
        breaks = self.begin + length * np.concatenate([[0.0], np.cumsum(self.steps)])
        breaks[-1] = self.begin + length
        states = np.vstack([x0, x.reshape(K, n)]).T * self.x_size[:, None]
        z_points = z.reshape(K, n_z).T * self.z_size[:, None]
        inputs = self.programme.low[:, None] + w.reshape(N + 1, m).T * self.w_size[:, None]
        if self.programme.held:
            inputs[:, -1] = inputs[:, -2]
        numbers = np.array(ca.Function("values", [self.unknowns], [self.values])(solution)).ravel()
        cuts = np.cumsum([len(cost.functionals) for cost in self.programme.costs])[:-1]
        return Trajectory(breaks, times_of(breaks), states, np.hstack([z_points[:, :1], z_points]), inputs,
                          tuple(np.split(numbers, cuts)), self._errors(breaks, states, z_points, inputs),
                          int(str(stats.get("iter_count", 0))), str(stats.get("return_status", "stopped")))

    def _errors(self, breaks: Array, x: Array, z: Array, w: Array) -> Array:
        """The residual x' - f of the polynomials between the collocation points, times the length of the interval, over the
        sizes of the states: the largest (N,) of all states."""
        points, N = radau()[0], self.intervals
        nodes = np.concatenate([[0.0], points])
        between = (nodes[:-1] + nodes[1:]) / 2
        to_nodes = np.linalg.inv(np.vander(nodes))  # values at the nodes to coefficients, highest power first
        powers = np.vander(between, DEGREE + 1)
        slopes = np.hstack([powers[:, 1:] * np.arange(DEGREE, 0, -1), np.zeros((DEGREE, 1))])
        stacked = np.stack([x[:, :-1:DEGREE], *(x[:, 1 + k::DEGREE] for k in range(DEGREE))])  # (4, n, N)
        values, rates = (np.einsum("cj,jnN->nNc", by @ to_nodes, stacked).reshape(self.n, -1) for by in (powers, slopes))
        z_values = np.einsum("cj,njN->nNc", np.vander(between, DEGREE) @ np.linalg.inv(np.vander(points, DEGREE)),
                             z.reshape(self.n_z, N, DEGREE).swapaxes(1, 2)).reshape(self.n_z, self.points)
        steps = np.repeat(np.diff(breaks), DEGREE)
        times = np.repeat(breaks[:-1], DEGREE) + steps * np.tile(between, N)
        ode = np.array(self.laws.map(len(times))(times[None, :], values, z_values,
                                                 pieces_of(self.programme, breaks, w).at(times))[0])
        residual = np.abs(rates - ode * steps) / self.x_size[:, None]
        return np.asarray(residual.reshape(self.n, N, DEGREE).max(axis=(0, 2), initial=0.0))


def refined(breaks: Array, errors: Array, most: int) -> Array:
    """The grid with the intervals of large error halved, the worst first, up to so many intervals."""
    order = [k for k in np.argsort(-errors).tolist() if errors[k] > COLLOCATION.fine]
    halved = np.array(order[:max(0, most - len(errors))], int)
    return np.union1d(breaks, (breaks[halved] + breaks[halved + 1]) / 2)
