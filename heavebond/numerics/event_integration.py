"""Integration in stretches: through events, delays and changes of the integrated states.

The integrator stops at the next event, the event sets its values, and the integrator restarts. The instants of time
events are known in advance and met exactly. For other events the indicators of all conditions are evaluated at every point
of a stretch; if one passes zero, the crossing is located by integrating again from the point before. The points follow the
steps of the integrator (`looks`). At the same points the strain of the states is evaluated (`dynamic_state_selection`);
before they become singular, the run continues in other states.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check
from heavebond.core.errors import Problem, SimulationError, either
from heavebond.numerics.dae import DELAY_ROWS, Array, Integrand
from heavebond.numerics.delays import DELAYS, Delays, Stretch
from heavebond.numerics.dynamic_state_selection import STATE_SELECTION, StateChoice, StateChoices
from heavebond.numerics.event_constants import EVENTS
from heavebond.numerics.fixed_step import STEP_CASCADES, WINDOW
from heavebond.numerics.initialise import Start, Tangent
from heavebond.numerics.jumps import PointSensitivity
from heavebond.numerics.looks import LookAhead, Looks
from heavebond.numerics.sampled_integration import SAMPLED_RUNS, Make, Passed, SampledIntegration, Schedule, Targets
from heavebond.numerics.solvers import Integrator, other
from heavebond.numerics.start_equations import Point
from heavebond.numerics.time_events import Timetable, same_instant, timetable
from heavebond.numerics.trace import Driven, EventState, Frame, Instant, Record, SolverChange, StateChange, Trace
from heavebond.numerics.zero_crossings import crossing, suspects

# What IDAS and CVODES say where the user interrupts, and where a run leads nowhere or crawls behind an event that is not
# known yet (a piston that has passed its stop empties its chamber): stretches are halved so often without an event between,
# then it is given up. At the end of a chart they may crawl; there they get so many steps between two points only.
INTERRUPTED, CRAWLS = ("IDA_RES_FAIL", "CV_RHSFUNC_FAIL"), ("IDA_TOO_MUCH_WORK", "CV_TOO_MUCH_WORK")

Build = Callable[[str, Integrand, Looks], Integrator]


class RunEnded(Exception):
    """A run ends at a state, as its condition is met."""

    def __init__(self, state: EventState):
        super().__init__()
        self.now = state


@dataclass(frozen=True)
class Failures:
    """Numbers of failures and of halved stretches since the last change of a run."""

    changes: int
    number: int = 0
    crawls: int = 0


@dataclass(frozen=True)
class IntegratorCall:
    """The last call of the integrator: its begin, and the unit of its scaled time."""

    begin: EventState
    step: float

    def time(self, s: float) -> float:
        """The time (s) at a value of the scaled time."""
        return self.begin.t + self.step * s


class EventIntegration:
    """The runs of a simulator whose diagram has events, delays, or constraints for which one choice of states may not
    suffice.

    `framed` gives the equations in a chart, with `integrals` (integrals and their sensitivities) after the other states.
    `inputs` gives the integrator's inputs at times: the first `n_u` are inputs of the assembly, the others factors of the
    integrals. `build` makes a named integrator with stops; `solver` is the name of the first. With `changes` the alternative
    solver continues if one fails (see `other`). With `dense` points between the stops are kept. At the `kinks` of functions
    of time, which are among the stops, the integrator begins anew. `sampled` makes the compiled program for runs of many
    samples. `step` is the length of the steps of solvers without error control, else 0.
    """

    def __init__(self, charts: StateChoices, framed: Callable[[StateChoice], Frame], integrals: int, stops: Array,
                 inputs: Callable[[Array], Array], build: Build, solver: str, changes: bool = False, dense: bool = False,
                 kinks: Array | None = None, delays: Delays | None = None, sampled: Make | None = None, step: float = 0.0):
        self.delays, self._make_sampled = delays, sampled
        self.first_solver, self.solver, self.changes = solver, solver, changes
        self.failed_at = self.crawled_at = -np.inf
        self.dense, self.step, self.window = dense, step, 1
        self.failures = Failures(0)
        self.charts, self.integrals, self.stops, self.inputs, self._build = charts, integrals, stops, inputs, build
        self._framed, self._frames = framed, {id(charts.home): framed(charts.home)}
        self.home = self._frames[id(charts.home)]
        self.conditions = self.home.equations.conditions
        breaking = {i for i, _ in self.home.equations.breakaways}
        self.breakaways = np.array([i in breaking for i in self.conditions], dtype=bool)
        self.n_u = charts.home.assembly.arguments[4].numel()
        self.n_along = 0 if delays is None else delays.m * len(delays.coefficients)  # rows after these: sensitivities
        self.span, self.same = float(stops[-1] - stops[0]) or 1.0, same_instant(float(stops[0]), float(stops[-1]))
        looked_at = bool(self.conditions or delays)
        self.ahead = LookAhead(stops, self.same, looked_at or charts.needed, looked_at,
                               EVENTS.mean_steps if delays is None else DELAYS.mean_steps)
        self.kinks: Array = np.zeros(0) if kinks is None else kinks
        self.last: IntegratorCall | None = None
        self.sampled: SampledIntegration | None = None
        self.reached = 0.0  # by the integrator in its own time where it failed

    # -- the run ---------------------------------------------------------------------------------------------------
    def run(self, first: Start, start_tangent: Tangent | None) -> Trace:
        """One run; RuntimeError if the integrator fails (see `last`), SimulationError if events do."""
        with self.home.equations.partners.running():
            if self.delays is not None:
                dp = np.zeros((len(first.p), 0)) if start_tangent is None else start_tangent.p
                self.delays.begin_run(first.t, float(self.stops[-1]), first.p, dp)
            frame, assembly = self.home, self.home.assembly
            x, z = assembly.scaled_x(first.x), first.z / assembly.z_nominal
            dp = np.zeros((len(first.p), 0))
            if start_tangent is not None:
                x = np.concatenate([x, (start_tangent.x / assembly.x_nominal[:, None]).T.ravel()])
                z = np.concatenate([z, (start_tangent.z / assembly.z_nominal[:, None]).T.ravel()])
                dp = start_tangent.p
            y = np.append(x, np.zeros(frame.made.dae["x"].numel() - len(x)))
            state = EventState(frame, first.t, y, z, first.p, dp, frame.hoist(first.p, dp)["o0"], np.zeros(0, bool))
            state = replace(state, true=self._true(state))
            self.solver, self.failures = self.first_solver, Failures(0)
            self.failed_at = self.crawled_at = -np.inf
            record = Record(state, self.stops, self.same, self.dense)
            self._write(state, record)
            if self.delays is not None:
                state = self._cut(state, np.zeros(state.blocks - 1))
            try:
                equations, begin, end = self.home.equations, state.t, float(self.stops[-1])
                coming = timetable(equations.events, equations.instants(state.p, state.dp), state.t, end)
                through = self._through_samples(coming)
                k, n = 0, len(coming.times)
                while True:
                    # the first event may change which conditions are true at the start
                    if record.true_at_start is None and (k == n or coming.times[k] > begin + self.same):
                        record.true_at_start = self._true_at_start(state, record)
                    if through is not None and record.true_at_start is not None:
                        state, k = through(state, k, record)
                    if k == n:
                        break
                    time, events, delays = coming.at(k)
                    # the stop that equals the time up to rounding
                    near = float(self.stops[np.abs(self.stops - time).argmin()])
                    state = self._over_kinks(state, near if abs(near - time) <= self.same else time, record)
                    state = self._happen(state, events, delays, record)
                    k += 1
                self._over_kinks(state, end, record)
            except RunEnded as ended:
                record.end(ended.now)
            trace = record.trace(self.integrals, self.driven(record.stops))
            return replace(trace, between=partial(record.between, self.integrals, self.driven)) if self.dense else trace

    def _through_samples(self, coming: Timetable) -> Callable[[EventState, int, Record], tuple[EventState, int]] | None:
        """Continue with the compiled program from a state before an instant (index) as far as possible; the state reached,
        and the next instant. None for a run of few instants, and if the program is not applicable."""
        if len(coming.times) < SAMPLED_RUNS.least or self._make_sampled is None or self.charts.needed \
                or self.delays is not None or self.home.equations.partners.parts or coming.moved.any():
            return None
        if self.sampled is None and (sampled := self._make_sampled()) is not None:
            self.sampled = sampled
        if (program := self.sampled) is None:
            return None
        program.begin_run()
        schedule = Schedule(coming, self.stops, self.kinks, self.same)
        misses = waiting = 0

        def through(state: EventState, k: int, record: Record) -> tuple[EventState, int]:
            nonlocal misses, waiting
            waiting -= 1
            while waiting <= 0 and state.frame is self.home and state.t < self.stops[-1] - self.same \
                    and (k == len(coming.times) or schedule.instants[k] > state.t + self.same):
                targets = schedule.targets(state.t, k, lambda times: self.inputs(times)[:self.n_u])
                passed = program.go_on(state, targets)
                if len(passed.y):
                    state = self._passed_samples(state, targets, passed, coming, record)
                    k = int(np.searchsorted(schedule.instants, state.t + self.same, side="right"))
                misses = 0 if len(passed.y) > 1 or passed.complete else min(max(2 * misses, 1), SAMPLED_RUNS.most_misses)
                waiting = misses
                if not passed.complete:
                    break
            return state, k

        return through

    def _passed_samples(self, state: EventState, targets: Targets, passed: Passed, coming: Timetable, record: Record
                        ) -> EventState:
        """Record the points that the compiled program passed; the state at its last target."""
        n, assembly, equations = len(passed.y), state.frame.assembly, state.frame.equations
        times, m = targets.times[:n], state.blocks - 1
        counts = np.diff(targets.ends[:n], prepend=0)
        at = np.flatnonzero(counts)
        # in the order of time: the points before each target, what is there before its events, and after them
        p_before = np.concatenate([state.p[None], passed.p[:-1]])
        dp_before = np.concatenate([state.dp[None], passed.dp[:-1]])
        between = passed.target
        parts = [(passed.times, passed.point_y, passed.point_z, p_before[between], dp_before[between], between, 0),
                 (times[at], passed.y_before[at], passed.z_before[at], p_before[at], dp_before[at], at, 1),
                 (times, passed.y, passed.z, passed.p, passed.dp, np.arange(n), 2)]
        order = np.lexsort((np.concatenate([np.arange(len(part[0])) for part in parts]),
                            np.repeat([part[-1] for part in parts], [len(part[0]) for part in parts]),
                            np.concatenate([part[5] for part in parts])))
        t, y, z, p, dp = (np.concatenate([part[k] for part in parts])[order] for k in range(5))
        record.keep_many(state.frame, t, y.T, z.T, p.T, np.moveaxis(dp, 0, -1))
        record.steps, record.compiled = record.steps + passed.steps, record.compiled + n
        n_x, n_z = len(assembly.x_nominal), len(assembly.z_nominal)
        z_sizes = assembly.z_nominal
        u = np.ascontiguousarray(targets.at[:, :n].T)
        x_first, x_then = (assembly.unscaled_x(values[:, :n_x].T).T for values in (passed.y_before, passed.y))
        z_first, z_then = (values[:, :n_z] * z_sizes for values in (passed.z_before, passed.z))
        names: dict[tuple[int, ...], tuple[str, ...]] = {}
        for k in at.tolist():
            end = int(targets.ends[k])
            events = tuple(targets.events[end - int(counts[k]):end].tolist())
            if events not in names:
                names[events] = tuple(equations.events[i].name for i in events)
            time = float(times[k])
            before = Point(time, x_first[k], z_first[k], p_before[k], u[k], 1.0)
            after = Point(time, x_then[k], z_then[k], passed.p[k], u[k], 1.0)
            equations.check_continuous(before, after, events)
            record.instants.append(Instant(time, names[events], before, after, assembly, np.zeros((len(events), m))))
        check()
        return replace(state, t=float(times[-1]), y=passed.y[-1], z=passed.z[-1], p=passed.p[-1], dp=passed.dp[-1],
                       given=state.frame.hoist(passed.p[-1], passed.dp[-1])["o0"], true=passed.true)

    def driven(self, times: Array) -> Driven:
        """The inputs at times, and their sensitivities."""
        inputs = self._inputs(times)
        if self.delays is None:
            return Driven(inputs[:self.n_u], np.zeros((0, 0, 0)))
        along = self.delays.along(inputs[self.n_u:self.n_u + self.n_along], self.n_u)
        return Driven(inputs[:self.n_u], along.transpose(1, 0, 2))

    def _inputs(self, times: Array) -> Array:
        """The integrator's inputs at times, with the pieces of delayed variables."""
        inputs = self.inputs(times)
        if self.delays is None:
            return inputs
        return np.vstack([inputs[:self.delays.offset], *self.delays.inputs(times), inputs[self.n_u:]])

    def _true(self, state: EventState) -> NDArray[np.bool_]:
        """The conditions that are true at a point. The condition of a breakaway counts as false: the event happens whenever
        it is met."""
        return np.asarray((self._indicators(state)[0] > 0) & ~self.breakaways)

    def _true_at_start(self, state: EventState, record: Record) -> list[str]:
        """The events whose condition is true at the start, and which would set a variable to another value. They do not
        happen, as the condition does not become true; an event that has happened at the start is not among them.
        SimulationError if such an event ends the run."""
        if not state.true.any():
            return []
        events, point = [self.conditions[c] for c in np.flatnonzero(state.true)], self._point(state)
        for event in (state.frame.equations.events[i] for i in events):
            if event.ends:
                raise SimulationError([Problem(
                    "event-until", f"the run would end as it begins: {event.text} is true at the start", event.place,
                    "A run ends when its condition becomes true: write one that is false at the start.")])
        happened = {name for instant in record.instants for name in instant.names}
        return [name for i in events if (name := state.frame.equations.events[i].name) not in happened
                and state.frame.equations.would_change(point, i)]

    def _over_kinks(self, state: EventState, limit: float, record: Record) -> EventState:
        """Integrate to a time, with a restart at each kink."""
        for kink in self.kinks[(self.kinks > state.t + self.same) & (self.kinks < limit - self.same)].tolist():
            state = self._through(state, kink, record)
            if self.delays is not None:
                self._sample(state, np.array([state.t]), state.y[:, None], state.z[:, None], -DELAYS.beside * self.same)
                state = self._cut(state, np.zeros(state.blocks - 1))
        return self._through(state, limit, record)

    # -- delays ----------------------------------------------------------------------------------------------------
    def _through(self, state: EventState, limit: float, record: Record) -> EventState:
        """Integrate to a time, in windows if there are delays."""
        if self.delays is None:
            return self._until(state, limit, record)
        while state.t < limit - self.same:
            end, shortest = self.delays.open(state.t, limit)
            self.ahead.longest = min(shortest, (end - state.t) / DELAYS.samples)
            state = self._until(state, end, record)
            if returned := self.delays.returned(state.t):
                # discontinuities of delayed variables: the states are continuous, the algebraic unknowns are solved again,
                # and conditions may become true
                assert self.delays is not None
                delays, equations = self.delays, state.frame.equations
                sensitivity, point = self._sensitivity(state), self._point(state)
                delays.open(state.t, np.inf)
                after, factors = self.driven(np.array([state.t])), self.inputs(np.array([state.t]))[self.n_u:, 0]
                x, q = sensitivity.x.copy(), sensitivity.q.copy()
                rates = equations.rates(point, factors) if state.blocks > 1 else None
                for at in returned:
                    u, first = point.u.copy(), delays.offset + DELAY_ROWS * at.delay
                    u[first:first + DELAY_ROWS] = at.column
                    delays.check_jump(at.delay, state.t, point.u[first:first + DELAY_ROWS], at.column)
                    point = equations.settled(replace(point, u=u), [])
                    if rates is not None:
                        then = equations.rates(point, factors)
                        x, q = x + np.outer(rates[0] - then[0], at.late), q + np.outer(rates[1] - then[1], at.late)
                        rates = then
                point = equations.settled(replace(point, u=after.u[:, 0]), [])
                sensitivity = PointSensitivity(x, q, sensitivity.p, after.along[:, :, 0].T)
                state = self._happen(state.standing(point, sensitivity), [], [at.late for at in returned], record)
        return state

    def _cut(self, state: EventState, late: Array) -> EventState:
        """A discontinuity at a point, with its sensitivity: the history of the delays begins a new stretch."""
        assert self.delays is not None
        self.delays.cut(state.t, late)
        self._sample(state, np.array([state.t]), state.y[:, None], state.z[:, None], DELAYS.beside * self.same)
        return state

    def _sample(self, state: EventState, times: Array, y: Array, z: Array, beside: float = 0.0) -> None:
        """Add points (n,) to the history of the delays; functions of time are taken so much later."""
        if self.delays is not None and len(times):
            self.delays.sample(times, self._sources(state, times, y, z, beside), beside)

    def _sample_call(self, state: EventState, times: Array, y: Array, z: Array) -> None:
        """Add the points (n,) of a call of the integrator to the history of the delays. If a source changes more between two
        points than the history shows (a short function of time that no state follows), samples between them are added,
        with interpolated states."""
        delays, n = self.delays, len(times)
        if delays is None or not n:
            return
        self._sample(state, times, y, z)
        course = Stretch()
        first, then = np.concatenate([state.y, state.z]), np.vstack([y, z])[:, :n]
        course.add(np.append(state.t, times), np.column_stack([first, then]))
        begins, ends, rows = course.times[:-1], course.times[1:], np.arange(len(state.y) + len(state.z))
        for _ in range(DELAYS.refinements):
            wide = ends - begins > DELAYS.shortest * self.same
            begins, ends = begins[wide], ends[wide]
            middle = (begins + ends) / 2
            if not len(middle):
                return
            states = course.at(middle, rows)
            values = self._sources(state, middle, states[:len(state.y)], states[len(state.y):])
            coarse = delays.coarse(middle, values)
            if not coarse.any():
                return
            delays.insert(middle[coarse], values[:, coarse])
            begins, ends = (np.concatenate([first[coarse], then[coarse]])
                            for first, then in ((begins, middle), (middle, ends)))

    def _sources(self, state: EventState, times: Array, y: Array, z: Array, beside: float = 0.0) -> Array:
        """The sources of the delays and their sensitivities (rows, n) at points."""
        assert self.delays is not None
        assembly, n, driven = state.frame.assembly, len(times), self.driven(times)
        n_x, n_z = len(assembly.x_nominal), len(assembly.z_nominal)
        x = assembly.unscaled_x(y[:n_x * state.blocks, :n], state.blocks).reshape(state.blocks, n_x, n).swapaxes(0, 1)
        z = np.einsum("bin,i->ibn", z[:n_z * state.blocks, :n].reshape(state.blocks, n_z, n), assembly.z_nominal)
        return self.delays.values(assembly, times + beside, x, z, state.p, state.dp, driven.u,
                                  driven.along.transpose(1, 0, 2))

    def _until(self, state: EventState, limit: float, record: Record) -> EventState:
        """Integrate to a time through the events of conditions on the way, and record the points."""
        if self.step:
            return self._until_by_steps(state, limit, record)
        ahead, halvings = self.ahead, 0
        ahead.restart(self.changes)
        while state.t < limit - self.same:
            looks = ahead.coming(state.t, limit, halvings)
            times, steps = looks.times, record.steps
            try:
                if ahead.crawling:
                    word = CRAWLS[self.solver == "cvodes"]
                    raise RuntimeError(f"{word}: so many steps that it would not come to an end")
                y, z = self._advance(state, looks, record)
            except RuntimeError as error:
                state, halvings = self._mended(state, looks, halvings, error, record)
                continue
            reached = self._in_chart(state, times, y, z)
            if not reached and (turned := self._turned(state, halvings, record)) is not None:
                state, halvings = turned
                continue
            reached = reached or len(times)  # no other states are better: on with these
            event = self._first_event(state, times[:reached], y[:, :reached], z[:, :reached], record)
            if event is not None:
                record.write(state, times[:event[0]], y, z)
                self._sample_call(state, times[:event[0]], y, z)
                state, halvings = self._happen(event[1], event[2], event[3], record, condition=True), 0
                ahead.restart(self.changes)
                continue
            self._passed(state, looks, reached, y, z, record, record.steps - steps)
            self._sample_call(state, times[:reached], y, z)
            if not halvings and reached == len(times):
                ahead.accept(state.t, looks, record.steps - steps)
            else:
                ahead.points = 1
            state = replace(state, t=float(times[reached - 1]), y=y[:, reached - 1], z=z[:, reached - 1])
            state = replace(state, true=self._true(state))
            halvings = max(halvings - 1, 0)
        return state

    def _until_by_steps(self, state: EventState, limit: float, record: Record) -> EventState:
        """Integrate to a time by steps that end at multiples of their length, and at that time. A condition that becomes
        true in a step triggers its event at the end of the step."""
        begin, window = float(self.stops[0]), self.window
        while state.t < limit - self.same:
            check()
            k = int(np.floor((state.t - begin + self.same) / self.step))
            times = begin + self.step * np.arange(k + 1.0, k + 1 + window)
            times = np.append(times[times < limit - self.same], limit) if times[-1] >= limit - self.same else times
            steps = state.frame.steps_by(self.solver)
            at = np.append(state.t, times)
            inputs = self._inputs(at[1:] - self.same if self.solver == "backward-euler" else at[:-1] + self.same)
            y, z = np.empty((len(state.y), len(at))), np.empty((len(state.z), len(at)))
            y[:, 0], z[:, 0] = state.y, state.z
            for n, (t, h) in enumerate(zip((at[:-1] - begin).tolist(), np.diff(at).tolist(), strict=True)):
                y[:, n + 1], z[:, n + 1] = steps.step(t, y[:, n], z[:, n], state.given, inputs[:, n], h)
            reached, met = len(times), np.zeros(0, int)
            if self.conditions:
                x, inner, u = self._columns(state.frame, at, y, z)
                values = state.frame.equations.indicators(at, x, inner, state.p, u)[0]
                was = np.column_stack([state.true, (values[:, 1:-1] > 0) & ~self.breakaways[:, None]])
                becomes_true = (values[:, 1:] > 0) & ~was
                if becomes_true.any():
                    reached = int(np.argmax(becomes_true.any(axis=0))) + 1
                    met = np.flatnonzero(becomes_true[:, reached - 1])
            record.steps += reached
            # values that are computed beyond an event are discarded
            self.window = window = min(2 * window, WINDOW) if reached == len(times) else max(reached, 1)
            for n in range(reached):
                inside = self.stops[(self.stops > at[n] + self.same) & (self.stops < at[n + 1] - self.same)]
                if len(inside):
                    shares = (inside - at[n]) / (at[n + 1] - at[n])
                    inner_y = steps.between(at[n] - begin, (y[:, n], y[:, n + 1]), z[:, n], state.given, inputs[:, n],
                                            float(at[n + 1] - at[n]), shares)
                    inner_z = z[:, n, None] + shares * (z[:, n + 1] - z[:, n])[:, None]
                    record.write(state, inside, inner_y, inner_z)
            record.write(state, times[:reached], y[:, 1:], z[:, 1:])
            state = replace(state, t=float(times[reached - 1]), y=y[:, reached], z=z[:, reached])
            if len(met):
                late, before = np.zeros(state.blocks - 1), values[:, reached]
                for _ in range(STEP_CASCADES):
                    state = self._happen(state, [self.conditions[c] for c in met], [late for _ in met], record)
                    # a count that advances by several in the step: the event reduces its indicator
                    after = self._indicators(state)[0]
                    met = np.array([c for c in met if 0 < after[c] < before[c]], int)
                    if not len(met):
                        break
                    before = after
                else:
                    names = either(self.home.equations.events[self.conditions[c]].name for c in met)
                    raise SimulationError([Problem(
                        "event-steps", f"{names} happens more than {STEP_CASCADES} times in the step of {self.step:g} s to "
                        f"t = {state.t:.6g} s", None, "Make the step shorter.")])
            else:
                state = replace(state, true=self._true(state))
        return state

    def _passed(self, state: EventState, looks: Looks, reached: int, y: Array, z: Array, record: Record, steps: int) -> None:
        """Record the points of a call with its number of steps. If points between the stops are kept and these points are
        far apart, the call is repeated with points between."""
        times, whole = looks.times[:reached], reached == len(looks.times)
        parts = 1  # of each interval of the call, a power of two
        if self.dense and whole and not self.ahead.dense:  # else its points follow the steps
            by_steps = (steps - EVENTS.steps_at_begin) / looks.even / EVENTS.steps_between_points
            length = float(looks.times[-1] - state.t)
            by_span = length / looks.even / self.span * EVENTS.min_checks * (1 - 1e-9)
            wanted = min(max(by_steps, by_span), EVENTS.max_points / looks.even)
            parts = 2 ** int(np.ceil(np.log2(wanted))) if wanted > 1 else 1
        if parts == 1:
            record.write(state, times, y, z)
            return
        record.write_stops(state, times, y, z)
        even = np.linspace(state.t, float(times[-1]), looks.even * parts + 1)[1:]
        even[parts - 1::parts] = times[len(times) - looks.even:]
        with suppress(RuntimeError):
            counted = record.steps
            inner, unknowns = self._advance(state, Looks.at(even), record)
            record.steps = counted
            record.keep(state, even, inner, unknowns)
            return
        check()
        record.keep(state, times, y[:, :reached], z[:, :reached])

    def _mended(self, state: EventState, looks: Looks, halvings: int, error: RuntimeError, record: Record
                ) -> tuple[EventState, int]:
        """As `_failed`; if that finds neither an event nor another chart, the alternative solver continues from this point,
        once."""
        try:
            # the state and the number of halvings with which to continue after a failure of the integrator: an unknown event
            # or the end of a chart may lie within the stretch, and the equations may have no solution beyond it
            ahead, one = self.ahead, self.ahead.points == 1
            interrupted, crawls = _says(error, INTERRUPTED), _says(error, CRAWLS)
            if crawls and looks.limited and not ahead.crawling:
                ahead.refine(state.t, looks, self.reached)
                return state, halvings
            if interrupted or not (self.charts.needed or self.conditions) or ahead.crawling \
                    or self._hopeless(crawls and one, record):
                raise error
            if self.charts.needed and self._strain(state) >= STATE_SELECTION.enough_strain and \
                    (changed := self._changed(state, record)) is not None:
                ahead.restart(True)
                return changed, 0
            if looks.times[0] - state.t <= EVENTS.approach * self.same:
                ahead.restart(True)
                # the event just before which the integrator fails; the RuntimeError of the integrator if none is near
                values, rates = self._indicators(state)
                near = (values + rates * EVENTS.approach**2 * self.same > 0) & ~state.true
                if not near.any():
                    raise RuntimeError("the equations have no solution behind this point")
                condition = int(np.flatnonzero(near)[0])
                return self._happen(state, *self._met(state, condition), record, condition=True), 0
            ahead.points = 1
            return state, halvings + one
        except RuntimeError as final:
            message = str(final)
            if not self.changes or _says(final, INTERRUPTED) or state.t <= self.failed_at \
                    or len(record.solver_changes) >= (1 if self.ahead.crawling else EVENTS.max_solver_changes):
                if crawls and not (self.charts.needed or self.conditions or ahead.crawling) \
                        and looks.times[0] - state.t > EVENTS.approach * self.same and state.t > self.crawled_at:
                    # perhaps a long way without an output point: once a nearer point, with as many steps in all as in
                    # other runs
                    ahead.points, ahead.spent, self.crawled_at = 1, ahead.spent + EVENTS.steps_between, state.t
                    return state, halvings + EVENTS.nearer
                raise
        before, self.failed_at = self.solver, state.t
        self.solver = other(before, bool(len(state.z)))
        record.solver_changes.append(SolverChange(state.t, before, self.solver, reason(message)))
        self.ahead.points, self.ahead.spent = 1, 0
        return state, 0

    def _hopeless(self, crawled: bool, record: Record) -> bool:
        """True if the integrator has failed or halved its stretch too often since the last change."""
        changes = len(record.instants) + len(record.changes) + len(record.solver_changes)
        if changes != self.failures.changes:
            self.failures = Failures(changes)
        self.failures = replace(self.failures, number=self.failures.number + 1, crawls=self.failures.crawls + crawled)
        return self.failures.number > EVENTS.max_failures or \
            (self.failures.crawls > EVENTS.max_crawls and not self.charts.needed)

    # -- charts ----------------------------------------------------------------------------------------------------
    def _strain(self, state: EventState) -> float:
        return float(state.frame.chart.strain(self._point(state).columns()).worst[0])

    def _in_chart(self, state: EventState, times: Array, y: Array, z: Array) -> int:
        """The number of points before the end of the chart."""
        if not self.charts.needed:
            return len(times)
        t = np.append(state.t, times)
        x, inner, u = self._columns(state.frame, t, np.column_stack([state.y, y]), np.column_stack([state.z, z]))
        p = np.tile(state.p[:, None], (1, len(t)))
        strain = state.frame.chart.strain((t[None, :], x, inner, p, u, np.ones((1, len(t)))))
        out = (strain.worst > STATE_SELECTION.max_strain) | (strain.signs != strain.signs[:, :1]).any(axis=0)
        return 0 if out[0] else int(np.argmax(out)) - 1 if out.any() else len(times)

    def _turned(self, state: EventState, halvings: int, record: Record) -> tuple[EventState, int] | None:
        """The state with which to continue at a point after which its chart ends: in another chart, or nearer to the end.
        None if no other chart is better, as at a dead centre of a mechanism."""
        if self._strain(state) >= STATE_SELECTION.enough_strain:
            changed = self._changed(state, record)
            if changed is None:
                return None
            self.ahead.restart(True)
            return changed, 0
        if halvings >= EVENTS.max_halvings:
            return None
        self.ahead.points = 1
        return state, halvings + 1

    def _changed(self, state: EventState, record: Record) -> EventState | None:
        """The same point in states with less strain; None if there are none."""
        point, old = self._point(state), state.frame.chart
        states = old.better(point)
        if states is None:
            return None
        chart = self.charts.with_states(states)
        if id(chart) not in self._frames:
            self._frames[id(chart)] = self._framed(chart)
        values = old.values_in(chart, point.columns())[:, 0]
        n_x, sensitivity = len(point.x), self._sensitivity(state)
        if m := state.blocks - 1:
            if self.delays is not None:
                raise SimulationError([Problem(
                    "delay-states-change", f"at t = {state.t:.6g} s the run continues in other states, and it has "
                    "sensitivities and delayed variables", self.delays.delays[0].place,
                    "Approximate the delays without history (for a "
                    "Delay `m: 3`), or run without sensitivities.")])
            along = old.along_in(chart, point.columns(m), sensitivity.x, state.unscaled()[1][:, 1:], state.dp)
            sensitivity = replace(sensitivity, x=along[:n_x])
        changed = replace(state, frame=self._frames[id(chart)]).standing(replace(point, x=values[:n_x], z=values[n_x:]),
                                                                         sensitivity)
        settled = self._settled(changed, changed.y[:, None], changed.z[:, None], np.array([state.t]))[:, 0]
        changed = replace(changed, z=settled)
        before, after = (tuple(c.assembly.state_names) for c in (old, chart))
        record.changes.append(StateChange(state.t, before, after, old.why(chart, point)))
        self._write(changed, record)
        return changed

    # -- the integrator --------------------------------------------------------------------------------------------
    def _advance(self, state: EventState, looks: Looks, record: Record) -> tuple[Array, Array]:
        """y and z at the points (n,) of a call of the integrator."""
        times, n, integrators = looks.times, len(looks.times), state.frame.integrators
        self.last = IntegratorCall(state, float(times[-1] - state.t) / looks.even)
        longest = state.frame.longest_in(looks.even, self.last.step)
        key = (self.solver, n, looks.limited, longest)
        if key not in integrators:
            integrators[key] = self._build(self.solver, state.frame.own_time(longest), looks)
        a, d = np.full(n, state.t - self.stops[0]), np.full(n, self.last.step)
        try:
            inputs = self.inputs((np.append(state.t, times[:-1]) + times) / 2)  # of the intervals of the call
            if self.delays is not None:
                inputs = np.vstack([inputs[:self.delays.offset], self.delays.call_inputs(state.t, times),
                                    inputs[self.n_u:]])
            results = integrators[key](x0=state.y, z0=state.z, p=state.given, u=np.vstack([inputs, a, d]))
        except RuntimeError as error:
            if looks.limited and _says(error, CRAWLS):
                self.reached = float(integrators[key].stats()["tcur"])
            raise
        y, z = np.array(results["xf"]).reshape(len(state.y), n), np.array(results["zf"]).reshape(len(state.z), n)
        if not np.all(np.isfinite(y)):
            raise RuntimeError("a value became infinite or not a number")
        record.steps += int(integrators[key].stats().get("nsteps", 0))
        return y, self._settled(state, y, z, times)

    def _settled(self, state: EventState, y: Array, z: Array, times: Array) -> Array:
        return settled(state.frame.loops, y, z, state.given, times - self.stops[0], self._inputs(times))

    def before(self, stretch: IntegratorCall, stopped: float) -> Point:
        """A point of a stretch in which the integrator failed, shortly before it did if that can be reached."""
        begin = stretch.begin
        for share in (1 - 1e-6, 1 - 1e-3, 0.9):
            time = begin.t + (stopped - begin.t) * share
            try:
                y, z = self._advance(begin, Looks.at(np.array([time])), Record(begin, self.stops, self.same))
            except RuntimeError:
                continue
            return self._point(replace(begin, t=time, y=y[:, 0], z=z[:, 0]))
        return self._point(begin)

    # -- looking for events ----------------------------------------------------------------------------------------
    def _columns(self, frame: Frame, t: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """States and algebraic unknowns in SI and the inputs at times."""
        n_x, z_size = len(frame.assembly.x_nominal), frame.assembly.z_nominal
        return frame.assembly.unscaled_x(y[:n_x]), z[: len(z_size)] * z_size[:, None], self._inputs(t)[: self.n_u]

    def _indicators(self, state: EventState) -> tuple[Array, Array]:
        """Indicators and rates (n_c,) at one point."""
        if not self.conditions:
            return np.zeros(0), np.zeros(0)
        t = np.array([state.t])
        x, z, u = self._columns(state.frame, t, state.y[:, None], state.z[:, None])
        values, rates = state.frame.equations.indicators(t, x, z, state.p, u)
        return values[:, 0], rates[:, 0]

    def _first_event(self, state: EventState, times: Array, y: Array, z: Array, record: Record
                     ) -> tuple[int, EventState, list[int], list[Array]] | None:
        """How many points lie before the first event, the point where it happens, the events there and their delays."""
        if not self.conditions:
            return None
        t = np.append(state.t, times)
        y, z = np.column_stack([state.y, y]), np.column_stack([state.z, z])
        x, inner, u = self._columns(state.frame, t, y, z)
        values, rates = state.frame.equations.indicators(t, x, inner, state.p, u)
        intervals = suspects(t, values, rates, state.true)
        for k in intervals.intervals:
            true = state.true if k == 0 else (values[:, k] > 0) & ~self.breakaways
            begin = replace(state, t=float(t[k]), y=y[:, k], z=z[:, k], true=true)
            crossed = [self._crossing(begin, c, float(t[k + 1]), values[c, k],
                                      (float(intervals.highest[c, k]), float(intervals.lowest[c, k])), certain, record)
                       for c in range(len(values)) if (certain := bool(intervals.certain[c, k])) or intervals.possible[c, k]]
            known = [c for c in crossed if c is not None]
            if known:
                at, condition = min(known, key=lambda c: c[0].t)
                return k, at, *self._met(at, condition)
        return None

    def _crossing(self, begin: EventState, condition: int, end: float, first: float, extremes: tuple[float, float],
                  certain: bool, record: Record) -> tuple[EventState, int] | None:
        """The time at which a condition first becomes true after a point, and the condition; None if none does."""
        reached = begin

        def indicator(time: float) -> tuple[float, float]:
            nonlocal reached
            y, z = self._advance(begin, Looks.at(np.array([time])), record)
            reached = replace(begin, t=time, y=y[:, 0], z=z[:, 0])
            values, rates = self._indicators(reached)
            return float(values[condition]), float(rates[condition])

        event = self.home.equations.events[self.conditions[condition]]
        if event.by_clock and np.abs(self.kinks - end).min(initial=np.inf) <= self.same:
            if not certain:
                return None
            indicator(end)  # conditions of the time change at kinks only
            return reached, condition
        # one that is true already has to become false first
        first = max(first, 0.0) if begin.true[condition] else first
        time = crossing(indicator, begin.t, end, first, extremes, certain, EVENTS.crossing_precision * self.same)
        if time is None:
            return None
        if time == begin.t:
            return begin, condition
        if time != reached.t:
            indicator(time)
        return reached, condition

    def _met(self, at: EventState, condition: int) -> tuple[list[int], list[Array]]:
        """The events at a crossing, with those whose conditions become true at the same instant, and the sensitivities of
        their times."""
        values, rates = self._indicators(at)
        soon = values + rates * self.same > 0
        met = [c for c in range(len(values)) if c == condition or (soon[c] and rates[c] > 0 and not at.true[c])]
        point, sensitivity = self._point(at), self._sensitivity(at)
        return ([self.conditions[c] for c in met],
                [at.frame.equations.delays(point, sensitivity, c, float(rates[c])) for c in met])

    # -- what happens ----------------------------------------------------------------------------------------------
    def _point(self, state: EventState) -> Point:
        t = np.array([state.t])
        x, z, u = self._columns(state.frame, t, state.y[:, None], state.z[:, None])
        return Point(state.t, x[:, 0], z[:, 0], state.p, u[:, 0], 1.0)

    def _sensitivity(self, state: EventState) -> PointSensitivity:
        m, n_q = state.blocks - 1, self.integrals // state.blocks
        q = state.y[len(state.y) - self.integrals + n_q:].reshape(m, n_q).T if n_q else np.zeros((0, m))
        u = self.driven(np.array([state.t])).along[:, :, 0].T if self.delays is not None else np.zeros((self.n_u, m))
        return PointSensitivity(state.unscaled()[0][:, 1:], q, state.dp, u)

    def _happen(self, state: EventState, events: list[int], delays: list[Array], record: Record,
                condition: bool = False) -> EventState:
        """Apply the events, then those whose conditions become true by them, and record the point after all of them. Without
        events a delayed variable has jumped, with its sensitivities in `delays`."""
        equations, begun = state.frame.equations, state
        if events:
            record.keep(state, np.array([state.t]), state.y[:, None], state.z[:, None])
            self._sample(state, np.array([state.t]), state.y[:, None], state.z[:, None], -DELAYS.beside * self.same)
        before = point = self._point(state)
        sensitivity, happened, late, first = self._sensitivity(state), list[int](), list[Array](), delays[0]
        factors = self.inputs(np.array([state.t]))[self.n_u:, 0]
        if condition:
            self._check_chatter(state.t, events, record)
            # what ends at the same instant, to rounding, has ended: the event may make it true again
            values, rates = self._indicators(state)
            begun = replace(state, true=state.true & (values + rates * self.same > 0))
        for _ in range(EVENTS.max_cascades):
            point, broken = equations.breaking(point, events)
            known = dict(zip(events, delays, strict=False))
            events, delays = broken, [known.get(i, first) for i in broken]
            point, sensitivity, yielded = equations.fire(point, sensitivity, events, delays, factors,
                                                         EVENTS.impact_time * min(self.span, 1.0))
            happened, late = happened + yielded + events, late + [first] * len(yielded) + delays
            state = begun.standing(point, sensitivity)
            values, rates = self._indicators(state)
            # what happened just now is true unless it is left at once; what else is true now became so by the reset
            fired = np.array([i in (*events, *yielded) for i in self.conditions], dtype=bool)
            true = (values + rates * self.same > 0) & (fired | (values > 0))
            set_off = (true & ~begun.true & ~fired) | (self.breakaways & (values > 0))
            begun = replace(state, true=true & ~self.breakaways)
            events = [self.conditions[c] for c in np.flatnonzero(set_off)]
            loosened, broken = equations.breaking(point, events)
            if not events and not broken and np.array_equal(loosened.p, point.p):
                break
            point, events = (loosened, broken) if not events else (point, events)
            delays = [first] * len(events)
        else:
            again = [i for i in dict.fromkeys(happened) if happened.count(i) > 1]
            raise self._chattering(state.t, again or events, "set off each other without end")
        if not happened:  # contacts at their limits only: no speed and no force jumps
            self._write(begun, record)
            return begun if self.delays is None else self._cut(begun, first)
        equations.check_continuous(before, point, happened)
        names = tuple(equations.events[i].name for i in happened)
        record.instants.append(Instant(state.t, names, before, point, state.frame.assembly, np.array(late)))
        self._write(begun, record)
        if any(equations.events[i].ends for i in happened) or equations.partners.ended:
            raise RunEnded(begun)
        return begun if self.delays is None else self._cut(begun, first)

    def _check_chatter(self, time: float, events: list[int], record: Record) -> None:
        record.passed = [*record.passed[1 - EVENTS.sliding_events:], (time, tuple(events))]
        if len(record.passed) == EVENTS.sliding_events and time - record.passed[0][0] < EVENTS.sliding_within * self.span:
            # the conditions of a part alternate so fast that the run would not end
            named_events = [self.home.equations.events[i] for i in dict.fromkeys(i for _, events in record.passed
                                                                                 for i in events)]
            took = time - record.passed[0][0]
            whole = self.span / took * EVENTS.sliding_events
            raise SimulationError([Problem(
                "event-sliding", f"{either(event.name for event in named_events)} switched {EVENTS.sliding_events} times "
                f"within {took:.2g} s, at t = {time:.6g} s: at this rate the run would take {whole:.1g} of them",
                named_events[0].place,
                "The part that it switches reverses it at once. Make its band (of a Relay, `u_on` and `u_off`) as wide as "
                "in the real part, give the driven part an inertia or a lag, or replace it by a Saturation with a steep "
                "Gain.",
                tuple(event.text for event in named_events))])
        last = record.passed[-EVENTS.chattering_events:]
        for passed, most in ((last, EVENTS.chattering_events),
                             ([p for p in last if p[1] == tuple(events)], EVENTS.repeated_events)):
            if len(passed) >= most and time - passed[-most][0] < EVENTS.chattering_within * self.span:
                raise self._chattering(time, events, f"happens {most} times within {time - passed[-most][0]:.2g} s")

    def _chattering(self, time: float, events: Sequence[int], phrase: str) -> SimulationError:
        events_of = [self.home.equations.events[i] for i in events]
        names = " and ".join(f"'{event.name}'" for event in events_of)
        leaves = self.home.assembly.flat.expanded.leaves
        chart = any((leaf := leaves.get(e.name.rpartition(".")[0])) and leaf.component.states for e in events_of)
        return SimulationError([Problem(
            "event-chatter", f"{names} {phrase}, at t = {time:.6g} s", events_of[0].place,
            "Give one of these transitions the time that its state lasts, `{when: ..., after: T}`, or let their conditions "
            "exclude each other." if chart else
            "Choose values that make its condition false for a while: a band between switching on and off, or a speed "
            "below which a body rests.", tuple(event.text for event in events_of))])

    def _write(self, state: EventState, record: Record) -> None:
        """Record the point if it is a stop."""
        record.write(state, np.array([state.t]), state.y[:, None], state.z[:, None])


def _says(error: RuntimeError, words: Sequence[str]) -> bool:
    return any(word in str(error) for word in words)


def reason(message: str) -> str:
    """The reason of the failure in the words of the solver."""
    return next(iter(re.findall(r"(?:IDA|CV)_[A-Z_]+", message)), message.strip().splitlines()[-1][:160]
                if message.strip() else "")


def settled(loops: ca.Function | None, x: Array, z: Array, p: ca.DM | Array, times: Array, inputs: Array) -> Array:
    """Algebraic unknowns solved anew at every point, with times counted as in the equations: between its steps IDAS only
    interpolates them, and if the states hardly change its steps are long (and at a jump of an input the interpolated values
    belong to the time before it)."""
    if loops is None:
        return z
    solved = np.array(loops(z, np.vstack([times[None, :], x, np.tile(np.array(p), (1, len(times))), inputs])))
    return np.where(np.isfinite(solved).all(axis=0), solved, z)
