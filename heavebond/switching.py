"""Runs that are cut at events: the next instant is found, the integrator stops there, the event acts, and it begins anew.

Time events are known beforehand and met exactly. For the others the indicators of all conditions are looked at in every
point of a stretch; where one passes zero, the crossing is found by integrating again from the point before. The
integrator runs in a time of its own, t = a + d s with a and d among its inputs, so that one serves all stretches of so
many points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.crossings import crossing, suspects
from heavebond.dae import Array, Integrand
from heavebond.errors import Problem, SimulationError
from heavebond.initialise import Start, Tangent
from heavebond.jumps import EventEquations, Moved
from heavebond.start_equations import Point
from heavebond.symbols import stack
from heavebond.timetable import same_instant, timetable

FIRST, MOST = 8, 1024  # points of the first stretch after an event; each further one has twice as many
LOOKS = 1000  # the conditions are looked at in so many points of a run at least, and at every output
# Where the integrator cannot pass a point, it is followed up to so many times this share.
NEAR = 10
PRECISION = 1e-2  # of the distance at which two instants are one: to what a crossing is found
# So many events of conditions within this share of the run are chattering.
CHATTER, WITHIN = 30, 1e-8
# What IDAS says where the user interrupts, and where a run leads nowhere: no event comes before that.
HOPELESS = ("IDA_RES_FAIL", "IDA_TOO_MUCH_WORK")
MOST_CASCADES = 100  # events that set off each other at one instant

Build = Callable[[Integrand, Array], ca.Function]
Settle = Callable[[Array, Array, ca.DM, Array], Array]


@dataclass(frozen=True)
class Instant:
    """An event or several at one time, by name, with the point before and after all that they set."""

    time: float
    names: tuple[str, ...]
    before: Point
    after: Point


@dataclass(frozen=True)
class Trace:
    """A run at its stops: x, z, integrals with all blocks of sensitivities, the held variables (n_h, N) and their
    sensitivities (m, n_h, N), and what happened."""

    x: Array
    z: Array
    quadratures: Array
    held: Array
    held_along: Array
    instants: tuple[Instant, ...]
    statistics: dict[str, object]


@dataclass(frozen=True)
class _Now:
    """Where a run stands: scaled states with their sensitivities and integrals y, algebraic unknowns z, parameters with
    held variables p (n_p,), their directions (n_p, m) and what the integrator makes of both, which conditions are true."""

    t: float
    y: Array
    z: Array
    p: Array
    dp: Array
    given: ca.DM
    true: NDArray[np.bool_]


@dataclass
class _Record:
    """What is written down during a run; `passed` are the times of the last events of conditions."""

    y: Array
    z: Array
    p: Array
    dp: Array
    instants: list[Instant] = field(default_factory=list)
    passed: list[float] = field(default_factory=list)
    steps: int = 0


@dataclass(frozen=True)
class Stretch:
    """The last call of the integrator: where it began, and the length of a unit of its own time."""

    begin: _Now
    step: float

    def time(self, s: float) -> float:
        """The time of the integrator's own time."""
        return self.begin.t + self.step * s


class Switching:
    """The runs of a simulator whose diagram has events.

    `made` is its integrand with `integrals` (integrals and their sensitivities) after the other states, `inputs` gives
    at times the integrator's inputs, the first `n_u` of them those of the assembly, the others factors of the integrals.
    `settle` solves the algebraic unknowns anew.
    """

    def __init__(self, equations: EventEquations, made: Integrand, integrals: int, directions: int, stops: Array,
                 inputs: Callable[[Array], Array], build: Build, settle: Settle):
        self.equations, self.made, self.integrals, self.m, self.stops = equations, made, integrals, directions, stops
        self.assembly, self.inputs, self.settle = equations.assembly, inputs, settle
        self.n_u = self.assembly.arguments[4].numel()
        self.span, self.same = float(stops[-1] - stops[0]) or 1.0, same_instant(float(stops[0]), float(stops[-1]))
        self.looks = self._looks()
        self._build, self._own = build, _own_time(made)
        self._integrators: dict[int, ca.Function] = {}
        self.last: Stretch | None = None

    def _looks(self) -> Array:
        """The stops, and between them as many further points as looking for conditions needs."""
        if not self.equations.conditions:
            return self.stops
        found = [self.stops[:1]]
        for begin, end in zip(self.stops[:-1], self.stops[1:], strict=True):
            parts = int(np.ceil((end - begin) / self.span * LOOKS * (1 - 1e-9)))
            found.append(np.append(begin + (end - begin) / max(parts, 1) * np.arange(1, max(parts, 1)), end))
        return np.concatenate(found)

    # -- the run ---------------------------------------------------------------------------------------------------
    def run(self, first: Start, moved: Tangent | None) -> Trace:
        """One run; RuntimeError where the integrator fails (see `last`), SimulationError where events do."""
        with self.equations.partners.running():
            return self._run(first, moved)

    def _run(self, first: Start, moved: Tangent | None) -> Trace:
        now, n = self._begin(first, moved), len(self.stops)
        record = _Record(np.zeros((len(now.y), n)), np.zeros((len(now.z), n)), np.zeros((len(now.p), n)),
                         np.zeros((*now.dp.shape, n)))
        self._write(now, record)
        instants = self.equations.instants(now.p, now.dp)
        for time, events, delays in timetable(self.equations.events, instants, now.t, float(self.stops[-1])):
            now = self._happen(self._until(now, self._stop(time), record), events, delays, record)
        self._until(now, float(self.stops[-1]), record)
        return self._trace(record)

    def _begin(self, first: Start, moved: Tangent | None) -> _Now:
        assembly = self.assembly
        x, z = first.x / assembly.x_nominal, first.z / assembly.z_nominal
        dp = np.zeros((len(first.p), 0))
        if moved is not None:
            x = np.concatenate([x, (moved.x / assembly.x_nominal[:, None]).T.ravel()])
            z = np.concatenate([z, (moved.z / assembly.z_nominal[:, None]).T.ravel()])
            dp = moved.p
        y = np.append(x, np.zeros(self.made.dae["x"].numel() - len(x)))
        now = _Now(first.t, y, z, first.p, dp, self.made.hoist(first.p, dp), np.zeros(0, bool))
        return replace(now, true=self._indicators(now)[0] > 0)

    def _stop(self, time: float) -> float:
        """The stop that is meant by a time, or the time itself."""
        near = float(self.stops[np.abs(self.stops - time).argmin()])
        return near if abs(near - time) <= self.same else time

    def _until(self, now: _Now, limit: float, record: _Record) -> _Now:
        """Go on to a time, through the events of conditions on the way; what is passed is written down."""
        points = FIRST if self.equations.conditions else MOST
        halvings = 0
        while now.t < limit - self.same:
            times = self._coming(now, limit, points, halvings)
            try:
                y, z = self._advance(now, times, record)
            except RuntimeError as error:
                # what comes after an event that is not known yet may be out of its equations' reach
                if not self.equations.conditions or any(word in str(error) for word in HOPELESS):
                    raise
                points, halvings = 1, halvings + (points == 1)
                if times[0] - now.t <= NEAR * self.same:
                    now, points, halvings = self._forced(now, record), FIRST, 0
                continue
            found = self._first_event(now, times, y, z, record)
            reached = len(times) if found is None else found[0]
            self._write_all(now, times[:reached], y, z, record)
            if found is not None:
                now, points, halvings = self._happen(found[1], found[2], found[3], record, condition=True), FIRST, 0
            else:
                now = replace(now, t=float(times[-1]), y=y[:, -1], z=z[:, -1])
                now = replace(now, true=self._indicators(now)[0] > 0)
                points = min(2 * points, MOST) if not halvings else 1
        return now

    def _coming(self, now: _Now, limit: float, points: int, halvings: int) -> Array:
        """The next points to go to: so many looks, as far as they are evenly spaced, up to a limit."""
        begin = int(np.searchsorted(self.looks, now.t + self.same, side="right"))
        times = self.looks[begin:begin + points]
        if len(times) < points or times[-1] >= limit - self.same:
            times = np.append(times[times < limit - self.same], limit)
        return _even(now.t, times, self.same) if not halvings else now.t + (times[:1] - now.t) / 2**halvings

    def _forced(self, now: _Now, record: _Record) -> _Now:
        """The event right before which the integrator fails; its RuntimeError where none is near."""
        values, rates = self._indicators(now)
        near = (values + rates * NEAR**2 * self.same > 0) & ~now.true
        if not near.any():
            raise RuntimeError("the equations have no solution behind this point")
        condition = int(np.flatnonzero(near)[0])
        return self._happen(now, *self._met(now, condition), record, condition=True)

    # -- the integrator --------------------------------------------------------------------------------------------
    def _advance(self, now: _Now, times: Array, record: _Record) -> tuple[Array, Array]:
        """y and z at times (n,), equally far apart."""
        n = len(times)
        if n not in self._integrators:
            self._integrators[n] = self._build(self._own, np.arange(n + 1.0))
        integrator = self._integrators[n]
        middle = (np.append(now.t, times[:-1]) + times) / 2
        self.last = Stretch(now, float(times[-1] - now.t) / n)
        a, d = np.full(n, now.t), np.full(n, self.last.step)
        found = integrator(x0=now.y, z0=now.z, p=now.given, u=np.vstack([self.inputs(middle), a, d]))
        y, z = np.array(found["xf"]).reshape(len(now.y), n), np.array(found["zf"]).reshape(len(now.z), n)
        if not np.all(np.isfinite(y)):
            raise RuntimeError("a value became infinite or not a number")
        z = self.settle(y, z, now.given, times)
        record.steps += int(integrator.stats().get("nsteps", 0))
        return y, z

    def before(self, stretch: Stretch, stopped: float) -> Point:
        """A point of a stretch in which the integrator failed, shortly before it did if that can be reached."""
        begin = stretch.begin
        for share in (1 - 1e-6, 1 - 1e-3, 0.9):
            time = begin.t + (stopped - begin.t) * share
            try:
                y, z = self._advance(begin, np.array([time]), _Record(*np.zeros((4, 0))))
            except RuntimeError:
                continue
            return self._point(replace(begin, t=time, y=y[:, 0], z=z[:, 0]))
        return self._point(begin)

    # -- looking for events ----------------------------------------------------------------------------------------
    def _columns(self, t: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """States and algebraic unknowns in SI and the inputs at times."""
        x_size, z_size = self.assembly.x_nominal, self.assembly.z_nominal
        return y[: len(x_size)] * x_size[:, None], z[: len(z_size)] * z_size[:, None], \
            self.inputs(t)[: self.n_u]

    def _indicators(self, now: _Now) -> tuple[Array, Array]:
        """Indicators and rates (n_c,) at one point."""
        if not self.equations.conditions:
            return np.zeros(0), np.zeros(0)
        t = np.array([now.t])
        x, z, u = self._columns(t, now.y[:, None], now.z[:, None])
        values, rates = self.equations.indicators(t, x, z, now.p, u)
        return values[:, 0], rates[:, 0]

    def _first_event(self, now: _Now, times: Array, y: Array, z: Array, record: _Record
                     ) -> tuple[int, _Now, list[int], list[Array]] | None:
        """How many points lie before the first event, the point where it happens, the events there and their delays."""
        if not self.equations.conditions:
            return None
        t = np.append(now.t, times)
        y, z = np.column_stack([now.y, y]), np.column_stack([now.z, z])
        x, inner, u = self._columns(t, y, z)
        values, rates = self.equations.indicators(t, x, inner, now.p, u)
        found = suspects(t, values, rates, now.true)
        for k in found.intervals:
            true = now.true if k == 0 else values[:, k] > 0
            begin = replace(now, t=float(t[k]), y=y[:, k], z=z[:, k], true=true)
            crossed = [self._crossing(begin, c, float(t[k + 1]), values[c, k], found.inside[c, k], certain, record)
                       for c in range(len(values)) if (certain := bool(found.certain[c, k])) or found.possible[c, k]]
            known = [c for c in crossed if c is not None]
            if known:
                at, condition = min(known, key=lambda c: c[0].t)
                return k, at, *self._met(at, condition)
        return None

    def _crossing(self, begin: _Now, condition: int, end: float, first: float, inside: Array, certain: bool,
                  record: _Record) -> tuple[_Now, int] | None:
        """Where a condition becomes true after a point, and the condition; None where it does not."""
        reached = begin

        def indicator(time: float) -> tuple[float, float]:
            nonlocal reached
            y, z = self._advance(begin, np.array([time]), record)
            reached = replace(begin, t=time, y=y[:, 0], z=z[:, 0])
            values, rates = self._indicators(reached)
            return float(values[condition]), float(rates[condition])

        # one that is true already has to become false first
        first = max(first, 0.0) if begin.true[condition] else first
        time = crossing(indicator, begin.t, end, first, inside, certain, PRECISION * self.same)
        if time is None:
            return None
        if time == begin.t:
            return begin, condition
        if time != reached.t:
            indicator(time)
        return reached, condition

    def _met(self, at: _Now, condition: int) -> tuple[list[int], list[Array]]:
        """The events at a crossing, those included that are met at the same instant, and their delays."""
        values, rates = self._indicators(at)
        soon = values + rates * self.same > 0
        met = [c for c in range(len(values)) if c == condition or (soon[c] and rates[c] > 0 and not at.true[c])]
        point, moved = self._point(at), self._moved(at)
        return ([self.equations.conditions[c] for c in met],
                [self.equations.delays(point, moved, c, float(rates[c])) for c in met])

    # -- what happens ----------------------------------------------------------------------------------------------
    def _point(self, now: _Now) -> Point:
        t = np.array([now.t])
        x, z, u = self._columns(t, now.y[:, None], now.z[:, None])
        return Point(now.t, x[:, 0], z[:, 0], now.p, u[:, 0], 1.0)

    def _moved(self, now: _Now) -> Moved:
        n_x, m = len(self.assembly.x_nominal), self.m
        x = now.y[n_x: n_x * (1 + m)].reshape(m, n_x).T * self.assembly.x_nominal[:, None]
        n_q = self.integrals // (1 + m)
        q = now.y[len(now.y) - self.integrals + n_q:].reshape(m, n_q).T if n_q else np.zeros((0, m))
        return Moved(x, q, now.dp)

    def _happen(self, now: _Now, events: list[int], delays: list[Array], record: _Record, condition: bool = False) -> _Now:
        """The events act, then those whose conditions become true by it; what stands there after all is written down."""
        equations, begun = self.equations, now
        before = point = self._point(now)
        moved, names = self._moved(now), []
        factors = self.inputs(np.array([now.t]))[self.n_u:, 0]
        if condition:
            self._check_chatter(now.t, events, record)
        for _ in range(MOST_CASCADES):
            point, moved = equations.fire(point, moved, events, delays, factors)
            names += [equations.events[i].name for i in events]
            now = self._standing(begun, point, moved)
            values, rates = self._indicators(now)
            # what happened just now is true unless it is left at once; what else is true now became so by the reset
            fired = np.array([i in events for i in equations.conditions], dtype=bool)
            true = (values + rates * self.same > 0) & (fired | (values > 0))
            set_off = true & ~begun.true & ~fired
            begun = replace(now, true=true)
            if not set_off.any():
                break
            events = [equations.conditions[c] for c in np.flatnonzero(set_off)]
            delays = [delays[0]] * len(events)
        else:
            raise self._chattering(now.t, events, "set off each other without end")
        record.instants.append(Instant(now.t, tuple(names), before, point))
        self._write(begun, record)
        return begun

    def _standing(self, now: _Now, point: Point, moved: Moved) -> _Now:
        """The scaled unknowns of a point, the integrals as they were."""
        n_x, y = len(point.x), now.y.copy()
        x_size, z_size = self.assembly.x_nominal, self.assembly.z_nominal
        y[:n_x] = point.x / x_size
        z = point.z / z_size
        if self.m:
            y[n_x:n_x * (1 + self.m)] = (moved.x / x_size[:, None]).T.ravel()
            if moved.q.size:
                y[len(y) - moved.q.size:] = moved.q.T.ravel()
            z = np.append(z, (self.equations.along_z(point, moved) / z_size[:, None]).T.ravel())
        return replace(now, y=y, z=z, p=point.p, dp=moved.p, given=self.made.hoist(point.p, moved.p))

    def _check_chatter(self, time: float, events: list[int], record: _Record) -> None:
        record.passed = [*record.passed[1 - CHATTER:], time]
        if len(record.passed) == CHATTER and time - record.passed[0] < WITHIN * self.span:
            raise self._chattering(time, events, f"happens {CHATTER} times within {time - record.passed[0]:.2g} s")

    def _chattering(self, time: float, events: Sequence[int], what: str) -> SimulationError:
        found = [self.equations.events[i] for i in events]
        names = " and ".join(f"'{event.name}'" for event in found)
        return SimulationError([Problem(
            "event-chatter", f"{names} {what}, at t = {time:.6g} s", found[0].place,
            "Let what it sets lead away from its condition for a while: a band between switching on and off, or a speed "
            "below which a body rests.", tuple(event.text for event in found))])

    # -- writing down ----------------------------------------------------------------------------------------------
    def _write(self, now: _Now, record: _Record) -> None:
        """The point where it is a stop."""
        at = min(int(np.searchsorted(self.stops, now.t - self.same)), len(self.stops) - 1)
        if abs(self.stops[at] - now.t) <= self.same:
            record.y[:, at], record.z[:, at], record.p[:, at], record.dp[:, :, at] = now.y, now.z, now.p, now.dp

    def _write_all(self, now: _Now, times: Array, y: Array, z: Array, record: _Record) -> None:
        """Those of the points that are stops."""
        if not len(times):
            return
        stop = np.searchsorted(self.stops, times - self.same)
        which = np.flatnonzero(np.abs(self.stops.take(stop, mode="clip") - times) <= self.same)
        at = stop[which]
        record.y[:, at], record.z[:, at] = y[:, which], z[:, which]
        record.p[:, at], record.dp[:, :, at] = now.p[:, None], now.dp[:, :, None]

    def _trace(self, record: _Record) -> Trace:
        assembly, blocks = self.assembly, 1 + self.m
        n_x = len(assembly.x_nominal) * blocks
        x = record.y[:n_x] * np.tile(assembly.x_nominal, blocks)[:, None]
        z = record.z * np.tile(assembly.z_nominal, blocks)[:, None]
        held = [h.index for h in assembly.flat.held]
        return Trace(x, z, record.y[len(record.y) - self.integrals:], record.p[held],
                     record.dp[held].transpose(1, 0, 2), tuple(record.instants), {"nsteps": record.steps})


def _own_time(made: Integrand) -> Integrand:
    """The integrand in a time s of its own, t = a + d s; a and d are the last two inputs."""
    dae = dict(made.dae)
    s, a, d = (ca.SX.sym(name) for name in "sad")
    dae["ode"], dae["alg"] = ca.substitute([d * dae["ode"], dae["alg"]], [dae["t"]], [a + d * s])
    dae["t"], dae["u"] = s, stack([dae["u"], a, d])
    return Integrand(dae, made.hoist)


def _even(begin: float, times: Array, same: float) -> Array:
    """The first of the times, as many as are equally far apart: the integrator takes no steps of other lengths in one call
    (where its inputs jump it stumbles at tight tolerances)."""
    t = np.append(begin, times)
    odd = np.flatnonzero(np.abs(t - (t[0] + (t[1] - t[0]) * np.arange(len(t)))) > same)
    return times[: odd[0] - 1] if len(odd) else times
