"""Recorded trajectory of a run, and its state between events and changes of the integrated states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.equations.buffered import Buffered
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly, Integrand
from heavebond.numerics.dynamic_state_selection import StateChoice
from heavebond.numerics.fixed_step import Steps
from heavebond.numerics.jumps import EventEquations, PointSensitivity
from heavebond.numerics.solvers import Integrator
from heavebond.numerics.start_equations import Point


@dataclass(frozen=True)
class Instant:
    """Simultaneous events by name, with the point before and after their assignments (in the states of `assembly`), and
    the sensitivities of their time along the directions of the run, `delays` (n_events, m)."""

    time: float
    names: tuple[str, ...]
    before: Point
    after: Point
    assembly: Assembly
    delays: Array


@dataclass(frozen=True)
class StateChange:
    """A change of the integrated states: the time, their names before and after, and the reason."""

    time: float
    before: tuple[str, ...]
    after: tuple[str, ...]
    why: str


@dataclass(frozen=True)
class SolverChange:
    """A change of solver after a failure, at the last accepted point, with the reason of the failure."""

    time: float
    before: str
    after: str
    why: str


@dataclass(frozen=True)
class AlternativeStates:
    """The stops of a run at which other states are integrated than the states of the diagram. `at` (N,) marks these stops; x
    and z are their values as in `Trace`."""

    assembly: Assembly
    at: NDArray[np.bool_]
    x: Array
    z: Array


@dataclass(frozen=True)
class Driven:
    """The inputs u (n_u, N) at the stops of a run with delayed variables, and their sensitivities (m, n_u, N)."""

    u: Array
    along: Array


@dataclass(frozen=True)
class Trace:
    """A run at its stops: x, z, integrals with all blocks of sensitivities, the held variables (n_h, N) and their
    sensitivities (m, n_h, N), the events, and the stops at which other states were integrated. `between` gives times, the
    run at these (at the stops, at points between them, and on both sides of events), and a function for the algebraic
    unknowns at points by their numbers, if they must still be solved for. `driven` are the inputs, if they are known only
    after the run."""

    x: Array
    z: Array
    quadratures: Array
    held: Array
    held_along: Array
    instants: tuple[Instant, ...]
    statistics: dict[str, object]
    stays: tuple[AlternativeStates, ...] = ()
    driven: Driven | None = None
    ended: Array | None = None  # the stops of a run that a condition ended, that instant the last
    between: Callable[[], Points] | None = None


Points = tuple[Array, Trace, Callable[[NDArray[np.intp]], Array] | None]


@dataclass(frozen=True)
class Frame:
    """The equations for one choice of states: the integrand in a scaled time s, t = a + d s after the begin of the run with
    a and d the last two inputs, so that one integrator serves all intervals with the same number of points; the events;
    Newton's method for the algebraic loops."""

    chart: StateChoice
    equations: EventEquations
    made: Integrand
    loops: ca.Function | None
    integrators: dict[tuple[str, int, bool, float], Integrator] = field(default_factory=dict)
    steps: list[Steps] = field(default_factory=list)

    @cached_property
    def hoist(self) -> Buffered:
        """The integrand's parameters of (p, directions)."""
        return Buffered(self.made.hoist)

    @property
    def assembly(self) -> Assembly:
        """The assembly of this choice of states."""
        return self.chart.assembly

    def steps_by(self, solver: str) -> Steps:
        """Single steps of a solver with a fixed step, in the time after the begin of the run."""
        if not self.steps or self.steps[0].solver != solver:
            self.steps[:] = [Steps(solver, self.made)]
        return self.steps[0]

    def longest_in(self, n: int, interval: float) -> float:
        """The longest step in scaled time over n intervals (s) of a stretch; 0 for no limit. A power of two, so that
        stretches of many lengths share few integrators."""
        limit = self.made.longest / interval if interval > 0 else 0.0
        return 2.0 ** np.floor(np.log2(limit)) if 0 < limit < n else 0.0

    def own_time(self, longest: float) -> Integrand:
        """The integrand in the scaled time s, with the longest step in it."""
        dae = dict(self.made.dae)
        s, a, d = (ca.SX.sym(name) for name in "sad")
        dae["ode"], dae["alg"] = ca.substitute([d * dae["ode"], dae["alg"]], [dae["t"]], [a + d * s])
        dae["t"], dae["u"] = s, stack([dae["u"], a, d])
        return replace(self.made, dae=dae, longest=longest)


@dataclass(frozen=True)
class EventState:
    """State of a run at time t: scaled states with their sensitivities and integrals y, algebraic unknowns z, parameters
    with held variables p (n_p,), their directions dp (n_p, m), the integrator's parameters `given` computed from both, and
    the truth values of the conditions."""

    frame: Frame
    t: float
    y: Array
    z: Array
    p: Array
    dp: Array
    given: Array
    true: NDArray[np.bool_]

    @property
    def blocks(self) -> int:
        """1 plus the number of sensitivities."""
        return 1 + int(self.dp.shape[1])

    def unscaled(self) -> tuple[Array, Array]:
        """x (n_x, 1 + m) and z (n_z, 1 + m) in SI with their sensitivities."""
        assembly = self.frame.assembly
        n_x, n_z = len(assembly.x_nominal), len(assembly.z_nominal)
        x = assembly.unscaled_x(self.y[:n_x * self.blocks], self.blocks).reshape(self.blocks, n_x).T
        return x, self.z[:n_z * self.blocks].reshape(self.blocks, n_z).T * assembly.z_nominal[:, None]

    def standing(self, point: Point, sensitivity: PointSensitivity) -> EventState:
        """This state at another point of the same time; the integrals are unchanged, except for their sensitivities in
        `sensitivity`."""
        assembly, y = self.frame.assembly, self.y.copy()
        x_size, z_size, n_x = assembly.x_nominal, assembly.z_nominal, len(point.x)
        y[:n_x] = assembly.scaled_x(point.x)
        z = point.z / z_size
        if self.blocks > 1:
            y[n_x:n_x * self.blocks] = (sensitivity.x / x_size[:, None]).T.ravel()
            if sensitivity.q.size:
                y[len(y) - sensitivity.q.size:] = sensitivity.q.T.ravel()
            z = np.append(z, (self.frame.equations.along_z(point, sensitivity) / z_size[:, None]).T.ravel())
        return replace(self, y=y, z=z, p=point.p, dp=sensitivity.p, given=self.frame.hoist(point.p, sensitivity.p)["o0"])


class Record:
    """The values recorded at the stops (N,) of a run; `passed` are the last events of conditions with their times."""

    def __init__(self, first: EventState, stops: Array, same: float, dense: bool = False):
        """With `dense` the points between the stops and before events are kept as well."""
        n = len(stops)
        # frame, times, y and z, then p and dp of the first point and those of the held variables at all of them
        self.points: list[tuple[Frame, Array, Array, Array, Array, Array, Array, Array]] | None = [] if dense else None
        self.first, self.held = first, [h.index for h in first.frame.assembly.flat.held]
        self.stops, self.same, self.home = stops, same, first.frame
        self.y, self.p, self.dp = np.zeros((len(first.y), n)), np.zeros((len(first.p), n)), np.zeros((*first.dp.shape, n))
        self.frames: list[Frame] = [first.frame]
        self.frame = np.zeros(n, int)
        self.z = [np.zeros((len(first.z), n))]
        self.instants: list[Instant] = []
        self.changes: list[StateChange] = []
        self.solver_changes: list[SolverChange] = []
        self.passed: list[tuple[float, tuple[int, ...]]] = []
        self.true_at_start: list[str] | None = None  # conditions that trigger no event there; None before they are known
        self.steps = 0
        self.ended = False  # by a condition
        self.compiled = 0  # intervals that the compiled program passed

    def write(self, state: EventState, times: Array, y: Array, z: Array) -> None:
        """Record the points at times (n,), with y and z (., n), that are stops."""
        if not len(times):
            return
        self.keep(state, times, y[:, :len(times)], z[:, :len(times)])
        self.write_stops(state, times, y, z)

    def end(self, state: EventState) -> None:
        """End the run at a point, which becomes its last stop."""
        n = int(np.searchsorted(self.stops, state.t - self.same))
        self.stops, self.ended = np.append(self.stops[:n], state.t), True
        self.frame = np.append(self.frame[:n], self._number(state.frame))
        self.y, self.p = np.column_stack([self.y[:, :n], state.y]), np.column_stack([self.p[:, :n], state.p])
        self.dp = np.concatenate([self.dp[:, :, :n], state.dp[:, :, None]], axis=2)
        self.z = [np.column_stack([z[:, :n], state.z if k == self.frame[-1] else np.zeros(len(z))])
                  for k, z in enumerate(self.z)]

    def keep(self, state: EventState, times: Array, y: Array, z: Array) -> None:
        """Keep points between the stops, where these are asked for."""
        if self.points is not None:
            self.points.append((state.frame, times, y, z, state.p, state.dp, state.p[self.held, None], state.dp[self.held,
                                                                                                                :, None]))

    def keep_many(self, frame: Frame, times: Array, y: Array, z: Array, p: Array, dp: Array) -> None:
        """Record points at times (n,), those among them that are stops and, where these are asked for, those between; y, z,
        p and dp (., n) at each."""
        if self.points is not None:
            self.points.append((frame, times, y, z, p[:, 0].copy(), dp[:, :, 0].copy(), p[self.held], dp[self.held]))
        stop = np.searchsorted(self.stops, times - self.same)
        indices = np.flatnonzero(np.abs(self.stops.take(stop, mode="clip") - times) <= self.same)
        # of several at one time the last is that after its events
        indices = indices[np.append(np.diff(stop[indices]) > 0, True)] if len(indices) else indices
        at, number = stop[indices], self._number(frame)
        self.frame[at] = number
        self.y[:, at], self.z[number][:, at] = y[:, indices], z[:, indices]
        self.p[:, at], self.dp[:, :, at] = p[:, indices], dp[:, :, indices]

    def write_stops(self, state: EventState, times: Array, y: Array, z: Array) -> None:
        """Record the points at times (n,), with y and z (., n), that are stops; none of them is kept as a point between."""
        stop = np.searchsorted(self.stops, times - self.same)
        if len(times) == 1 and not abs(self.stops[min(stop[0], len(self.stops) - 1)] - times[0]) <= self.same:
            return
        indices = np.flatnonzero(np.abs(self.stops.take(stop, mode="clip") - times) <= self.same)
        at = stop[indices]
        number = self._number(state.frame)
        self.frame[at] = number
        self.y[:, at], self.z[number][:, at] = y[:, indices], z[:, indices]
        self.p[:, at], self.dp[:, :, at] = state.p[:, None], state.dp[:, :, None]

    def _number(self, frame: Frame) -> int:
        numbers = [k for k, known in enumerate(self.frames) if known is frame]
        if numbers:
            return numbers[0]
        self.frames.append(frame)
        blocks = 1 + self.dp.shape[1]
        self.z.append(np.zeros((len(frame.assembly.z_nominal) * blocks, len(self.stops))))
        return len(self.frames) - 1

    def between(self, integrals: int, inputs: Callable[[Array], Driven]) -> Points:
        """The times of all points that were kept, and the run at these."""
        assert self.points is not None
        times = np.concatenate([at for _, at, *_ in self.points])
        whole, begin = Record(self.first, times, self.same), 0
        for frame, at, y, z, p, dp, held, held_along in self.points:
            chosen, begin = slice(begin, begin + len(at)), begin + len(at)
            number = whole._number(frame)
            whole.frame[chosen], whole.y[:, chosen], whole.z[number][:, chosen] = number, y, z
            whole.p[:, chosen], whole.dp[:, :, chosen] = p[:, None], dp[:, :, None]
            whole.p[self.held, chosen], whole.dp[self.held, :, chosen] = held, held_along
        whole.instants, whole.steps = self.instants, self.steps
        return times, whole.trace(integrals, inputs(times)), None

    def trace(self, integrals: int, driven: Driven) -> Trace:
        """The run as recorded; the last `integrals` rows of y are integrals. For every other choice of states the unknowns
        of the first choice are evaluated as expressions."""
        n_y, u = len(self.y), driven.u
        stays = [self._stay(k) for k in range(len(self.frames))]
        x, z = stays[0].x, stays[0].z
        for number, stay in enumerate(stays[1:], 1):
            if not stay.at.any():  # entered and left between two stops
                continue
            # x and z of the first choice of states, with their sensitivities, at the stops of another choice
            n, m = int(stay.at.sum()), self.dp.shape[1]
            (n_x, n_z), home = (len(stay.assembly.x_nominal), len(stay.assembly.z_nominal)), self.home.chart
            x_stay, z_stay, p = stay.x[:, stay.at], stay.z[:, stay.at], self.p[:, stay.at]
            arguments = (self.stops[None, stay.at], x_stay[:n_x], z_stay[:n_z], p, u[:, stay.at], np.ones((1, n)))
            chart = self.frames[number].chart
            transformed = [chart.values_in(home, arguments)]
            for k in range(1, 1 + m):
                transformed.append(chart.along_in(home, arguments, x_stay[n_x * k:n_x * (k + 1)],
                                                  z_stay[n_z * k:n_z * (k + 1)], self.dp[:, k - 1, stay.at]))
            x[:, stay.at] = np.vstack([f[:n_x] for f in transformed])
            z[:, stay.at] = np.vstack([f[n_x:] for f in transformed])
        held = self.held
        statistics: dict[str, object] = {"nsteps": self.steps}
        if self.changes:
            statistics["state_changes"] = [vars(change) for change in self.changes]
        if self.compiled:
            statistics["compiled_intervals"] = self.compiled
        if self.solver_changes:
            statistics["solver_changes"] = [vars(change) for change in self.solver_changes]
        if self.true_at_start:
            statistics["true_at_start"] = self.true_at_start
        return Trace(x, z, self.y[n_y - integrals:], self.p[held], self.dp[held].transpose(1, 0, 2), tuple(self.instants),
                     statistics, tuple(stays[1:]), driven if self.home.assembly.flat.delays else None,
                     self.stops if self.ended else None)

    def _stay(self, number: int) -> AlternativeStates:
        assembly, blocks = self.frames[number].assembly, 1 + self.dp.shape[1]
        n_x = len(assembly.x_nominal) * blocks
        return AlternativeStates(assembly, self.frame == number, assembly.unscaled_x(self.y[:n_x], blocks),
                                 self.z[number] * np.tile(assembly.z_nominal, blocks)[:, None])
