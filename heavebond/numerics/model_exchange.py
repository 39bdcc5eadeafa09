"""An FMU with events between two communication points: its integration, its event iteration and the ticks of its clocks.

The FMU computes x' = f(t, x) and event indicators z(t, x) for its present inputs and discrete states. LSODA integrates x
with error control (A. C. Hindmarsh, ODEPACK, 1983; L. Petzold, doi:10.1137/0904010). It changes between Adams methods and,
for stiff equations, BDF. After a restart it may not recognise stiff equations. If it takes very many steps, another BDF
method continues (L. F. Shampine, M. W. Reichelt, doi:10.1137/S1064827594276424).

An event occurs if the sign of an indicator (z > 0) changes within a step, at an instant that the FMU has announced, or if
the FMU requests it at the end of a step. A sign change is located by bisection of the interpolated step. At an event the FMU
updates its discrete states until it needs no further update; it may also set x and the nominal sizes of x. Modelica
Association, Functional Mock-up Interface Specification 2.0.4, 3.2, and 3.0.1, 3.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heavebond.language.definition import ForeignClock

Array = NDArray[np.float64]
RTOL = 1e-9  # relative, and absolute in nominal sizes of the states
SAME = 1e-12  # difference of equal instants, relative to the time
MOST_UPDATES = 1000  # largest number of updates of the discrete states at one instant
MOST_STEPS = 5000  # largest number of steps of LSODA between two events; BDF makes all further steps
MOST_EVENTS = 10_000  # largest number of events between two communication points
SHORTER, MOST_REFUSED = 10.0, 8  # if the FMU has no derivatives in a step, it is repeated with shorter steps
CHANGED, SHORTEST = 2, 1e-6  # fmi3IntervalChanged, and the shortest interval of a clock in s
DISCARD = 2  # the status of a call that the FMU refuses at this point


class _Refused(Exception):
    """The FMU has no derivatives at a trial point of the integrator."""


class Clocks:
    """The clocks of an instance of an FMU: input clocks that tick at known instants or at instants that the FMU computes,
    input clocks that are triggered, and output clocks, which the FMU activates in events. `read` is called with the
    references of the clocks that tick, before the FMU updates its discrete states: only then are their outputs valid."""

    def __init__(self, instance: Any, clocks: Sequence[ForeignClock], outputs: Sequence[int],
                 read: Callable[[Sequence[int]], None]):
        self._instance, self._clocks, self._outputs, self._read = instance, clocks, outputs, read
        self._calculated = [k for k, clock in enumerate(clocks) if clock.calculated]
        self._triggered: list[int] = []

    def begin(self, time: float) -> None:
        """Set the first instants of the clocks of a run, in event mode."""
        self._begin, self._ticks = time, [0] * len(self._clocks)
        self._instants = [np.inf if clock.countdown else time + clock.shift for clock in self._clocks]
        self._intervals = [clock.interval for clock in self._clocks]
        self._ask(time, ())

    @property
    def next(self) -> float:
        """The next instant of a clock."""
        return min(self._instants, default=np.inf)

    def trigger(self, references: Sequence[int]) -> None:
        """Let triggered input clocks tick at the next event."""
        self._triggered += references

    def tick(self, time: float) -> None:
        """Activate the clocks whose instant is reached, and the triggered ones, in event mode."""
        reached = time + SAME * max(abs(time), time - self._begin)
        due = [k for k, instant in enumerate(self._instants) if instant <= reached]
        references = [*(self._clocks[k].reference for k in due), *self._triggered]
        self._triggered = []
        if references:
            self._instance.setClock(references, [True] * len(references))
        self.read(references)
        for k in due:
            clock = self._clocks[k]
            self._ticks[k] += 1
            self._instants[k] = np.inf if clock.calculated else self._begin + clock.shift + self._ticks[k] * clock.interval
        self._due = [k for k in due if self._clocks[k].calculated and not self._clocks[k].countdown]

    def read(self, ticking: Sequence[int] = ()) -> None:
        """Read the outputs of these clocks and of the active output clocks."""
        active = self._instance.getClock(self._outputs) if self._outputs else []
        if ticking := [*ticking, *(reference for reference, on in zip(self._outputs, active, strict=True) if on)]:
            self._read(ticking)

    def renew(self, time: float) -> None:
        """Ask for the next instants of calculated clocks, at the end of an event."""
        self._ask(time, self._due)

    def _ask(self, time: float, ticked: Sequence[int]) -> None:
        count = len(self._calculated)
        if not count:
            return
        references = (ctypes.c_uint32 * count)(*(self._clocks[k].reference for k in self._calculated))
        intervals, qualifiers = (ctypes.c_double * count)(), (ctypes.c_int * count)()
        self._instance.getIntervalDecimal(references, intervals, qualifiers)
        for k, interval, qualifier in zip(self._calculated, intervals, qualifiers, strict=True):
            clock = self._clocks[k]
            if qualifier == CHANGED:
                if not (np.isfinite(interval) and interval >= (0 if clock.countdown else SHORTEST)):
                    raise RuntimeError(f"the interval of its clock {clock.own} is {interval:g} s at t = {time:.9g} s")
                self._intervals[k] = interval
                if clock.countdown:
                    self._instants[k] = time + interval
            if k in ticked:
                if not self._intervals[k] >= SHORTEST:
                    raise RuntimeError(f"the next interval of its clock {clock.own} is not known at t = {time:.9g} s")
                self._instants[k] = time + self._intervals[k]


class EventSteps:
    """An initialised instance of an FMU for co-simulation (FMI 3.0) in event mode; RuntimeError or the exception of FMPy if
    it fails. It takes the steps between events, and its events happen at the end of a step."""

    def __init__(self, instance: Any, clocks: Clocks, update: str = "updateDiscreteStates"):
        self.instance, self.clocks = instance, clocks
        self.events = 0  # number of events after the initialisation
        self.ended = False  # the FMU requests the end of the run
        self._update = getattr(instance, update)

    def begin(self, time: float) -> None:
        """Leave the event mode for the first time, after the initialisation."""
        self.time, self._next = time, np.inf
        self.clocks.begin(time)
        self._update_discrete_states(first=True)

    def change_inputs(self, set_inputs: Callable[[], None]) -> None:
        """Change the inputs by an event."""
        if not self.ended:
            self.instance.enterEventMode()
            set_inputs()
            self._update_discrete_states()

    def advance(self, end: float) -> None:
        """Advance to a communication point; stop earlier if the FMU requests the end of the run."""
        events = 0
        while not self.ended:
            same = SAME * max(abs(end), end - self.time)
            stop = self._next if self._next <= end + same else end
            happened = self._integrate(stop) if stop > self.time else False
            if self.ended:
                return
            if happened or (self.time >= stop and stop == self._next):
                self.instance.enterEventMode()
                self._update_discrete_states()
                events, self.events = events + 1, self.events + 1
                if events > MOST_EVENTS:
                    raise RuntimeError(f"it has more than {MOST_EVENTS} events before t = {self.time:.9g} s: they may "
                                       "follow each other at ever shorter intervals")
            elif self.time >= stop:
                return

    def _update_discrete_states(self, first: bool = False) -> None:
        """Event iteration at the present instant, in event mode; then return to steps."""
        self.clocks.tick(self.time)
        changed_states, changed_nominals = first, first
        for round_ in range(MOST_UPDATES):
            if round_:
                self.clocks.read()
            again, ends, nominals, values, defined, time = self._update()
            changed_states, changed_nominals = changed_states or values, changed_nominals or nominals
            if ends:
                self.ended = True
                return
            if not again:
                break
        else:
            raise RuntimeError(f"its event iteration does not end at t = {self.time:.9g} s")
        self.clocks.renew(self.time)
        self._next = min(time if defined else np.inf, self.clocks.next)
        self._leave_events(changed_states, changed_nominals)

    def _leave_events(self, changed_states: bool, changed_nominals: bool) -> None:
        """Return to steps after an event."""
        self.instance.enterStepMode()

    def _integrate(self, stop: float) -> bool:
        """Integrate to `stop`, to the first event before it or to the end of the run; True for an event."""
        happened, self.ended, early, reached = self.instance.doStep(self.time, stop - self.time)
        self.time = reached if early else stop
        return bool(happened)


class ModelExchange(EventSteps):
    """An initialised instance of an FMU for model exchange (FMI 2.0 and 3.0) with its states. `states` and `indicators` are
    the numbers of states and event indicators in FMI 2.0."""

    def __init__(self, instance: Any, clocks: Clocks, version: str, states: int, indicators: int):
        self._three = version.startswith("3")
        super().__init__(instance, clocks, "updateDiscreteStates" if self._three else "newDiscreteStates")
        self._n, self._stiff = (states, indicators), False

    def begin(self, time: float) -> None:
        """Enter continuous-time mode for the first time, after the initialisation."""
        if self._three:  # the numbers may depend on parameters
            self._n = self.instance.getNumberOfContinuousStates(), self.instance.getNumberOfEventIndicators()
        n, m = self._n
        self._x, self._dx = (ctypes.c_double * n)(), (ctypes.c_double * n)()
        self._nominal, self._z = (ctypes.c_double * n)(), (ctypes.c_double * m)()
        self._derivatives = self.instance.getContinuousStateDerivatives if self._three else self.instance.getDerivatives
        self._state, self._scale = np.zeros(n), np.ones(n)
        super().begin(time)

    def _leave_events(self, changed_states: bool, changed_nominals: bool) -> None:
        self.instance.enterContinuousTimeMode()
        n = len(self._x)
        if n and changed_states:
            self.instance.getContinuousStates(self._x, n)
            self._state = np.array(self._x)
        if n and changed_nominals:
            self.instance.getNominalsOfContinuousStates(self._nominal, n)
            sizes = np.abs(np.array(self._nominal))
            self._scale = np.where((sizes > 0) & np.isfinite(sizes), sizes, 1.0)
        self._signs = self._indicators() > 0

    def _place(self, time: float, x: Array) -> None:
        self.instance.setTime(time)
        if len(x):
            self._x[:] = x.tolist()
            self.instance.setContinuousStates(self._x, len(x))

    def _rates(self, time: float, x: Array) -> Array:
        from fmpy.fmi1 import FMICallException

        try:
            self._place(time, x)
            self._derivatives(self._dx, len(x))
        except FMICallException as error:
            if error.status != DISCARD:
                raise
            raise _Refused(str(error)) from error
        rates = np.array(self._dx)
        if not np.isfinite(rates).all():
            number = int(np.flatnonzero(~np.isfinite(rates))[0]) + 1
            raise _Refused(f"the derivative of its state {number} of {len(x)} is not a number at t = {time:.9g} s")
        return rates

    def _indicators(self) -> Array:
        if len(self._z):
            self.instance.getEventIndicators(self._z, len(self._z))
        return np.array(self._z)

    def _integrate(self, stop: float) -> bool:
        longest, refused = np.inf, 0
        while True:
            try:
                return self._integrated(stop, longest)
            except _Refused as error:
                refused += 1
                if refused > MOST_REFUSED:
                    raise RuntimeError(str(error)) from error
                longest = min(longest, stop - self.time) / SHORTER

    def _integrated(self, stop: float, longest: float) -> bool:
        from scipy.integrate import BDF, LSODA

        if not len(self._state) or stop - self.time <= SAME * abs(stop):
            return self._accepted(stop, self._state, lambda: lambda _: self._state)
        solver, steps = None, 0
        while self.time < stop and not self.ended:
            if steps == MOST_STEPS and not self._stiff:
                self._stiff, solver = True, None
            if solver is None:
                solver = (BDF if self._stiff else LSODA)(self._rates, self.time, self._state, stop, rtol=RTOL,
                                                         atol=RTOL * self._scale, max_step=longest)
            message, steps = solver.step(), steps + 1
            if solver.status == "failed":
                raise RuntimeError(f"the integrator failed at t = {self.time:.9g} s ({message})")
            if self._accepted(float(solver.t), np.array(solver.y), solver.dense_output):
                return True
        return False

    def _accepted(self, end: float, state: Array, interpolated: Callable[[], Callable[[float], Array]]) -> bool:
        """Advance to the end of a step, or to the first change of sign within it; True for an event."""
        begin = self.time
        self._place(end, state)
        happened = self._changed()
        if happened:
            motion, low, high = interpolated(), begin, end
            while high - low > SAME * max(abs(high), end - begin) and low < (middle := (low + high) / 2) < high:
                self._place(middle, motion(middle))
                low, high = (low, middle) if self._changed() else (middle, high)
            if high < end:
                end, state = high, motion(high)
            self._place(end, state)
        self.time, self._state = end, state
        requested, self.ended = self.instance.completedIntegratorStep()
        return happened or bool(requested)

    def _changed(self) -> bool:
        """True if the sign of an indicator differs from its sign after the last event."""
        return bool(np.any((self._indicators() > 0) != self._signs))
