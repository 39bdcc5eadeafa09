"""Runs through many samples by the compiled program: from one instant to the next without a way back to Python.

A sampled controller cuts a run into thousands of stretches. In Python each of them costs as much as hundreds of
evaluations of a small machine. Here a program in C (`heavebond/c/sampled.c`) integrates from instant to instant, evaluates
the updates of all blocks that are sampled there, and moves their sensitivities, X after = X before and H after = r_x X + r_z
Z + r_p + r_h H (see `jumps`; the instants do not move). It looks at the conditions of other events after each step. An
interval in which a condition may become true, or in which the program fails, is integrated by `EventIntegration`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.language.symbols import split, stack
from heavebond.numerics import compiled_cvodes
from heavebond.numerics.compiled_cvodes import CompiledCvodes, Equations, scaled_equations
from heavebond.numerics.dae import Array, Assembly, Factors
from heavebond.numerics.idas import Tolerances
from heavebond.numerics.time_events import Timetable
from heavebond.numerics.trace import EventState


@dataclass(frozen=True)
class SampledRunConstants:
    """The constants of runs through samples by the compiled program.

    least: instants of a run from which on the program is used. Origin: compiling it takes as long as 1500 instants in
        Python. Doubled: runs of 2000 to 4000 samples take up to four times as long.
    targets: instants and output times in one call of the program. Origin: a tenth of a second. Doubled: Ctrl-C is seen
        later, twice the memory.
    points: points between the targets in one call of the program, over `targets`. Origin: the program adds up to three for
        each step. Doubled: twice the memory.
    loops: algebraic unknowns with which conditions are looked at, at most. Origin: their rates are written out. Doubled: a
        long list of operations.
    most_misses: intervals integrated in Python before the program is tried again, at most, after it failed in one. Origin: a
        call costs a tenth of an interval. Doubled: nothing measurable.
    """

    least: int = 2000
    targets: int = 512
    points: int = 32
    loops: int = 4
    most_misses: int = 64


SAMPLED_RUNS = SampledRunConstants()
_Pointer = ctypes.c_void_p
ALL_DONE, BUFFER_FULL = 0, 2  # answers of the program


class _Sampled(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_long) for name in ("n_resets", "n_held", "n_conditions", "first_flag", "capacity")),
                *((name, _Pointer) for name in (
                    "reset_event", "reset_state", "reset_held", "held", "held_row", "true_now", "values", "before", "kept_x",
                    "kept_held", "new_values", "moved", "point_t", "point_x", "point_z", "point_target")),
                ("points", ctypes.c_long), *((name, ctypes.c_double) for name in ("same", "begin", "end", "last_point")),
                *((name, ctypes.c_long) for name in ("taken", "trial", "strikes", "counted", "intervals"))]


@dataclass(frozen=True)
class Targets:
    """The stops of a call of the program: times (N,), whether the integrator restarts, the events at each (their ends (N,)
    in one list), and the inputs (n_u, N) before and at each."""

    times: Array
    anew: NDArray[np.bool_]
    ends: NDArray[np.int64]
    events: NDArray[np.int32]
    inputs: Array
    at: Array


@dataclass(frozen=True)
class Passed:
    """The first N targets, by rows: y and z before and after their events, p and dp after them, and points between: their
    times, y and z, and the numbers of the targets that they lie before. `true` are the conditions at the last target."""

    y_before: Array
    z_before: Array
    y: Array
    z: Array
    p: Array
    dp: Array
    times: Array
    point_y: Array
    point_z: Array
    target: NDArray[np.int64]
    true: NDArray[np.bool_]
    steps: int
    complete: bool  # the program may go on from there


class SampledIntegration(CompiledCvodes):
    """The compiled program for the runs of one assembly with m sensitivities."""

    def __init__(self, equations: Equations, assembly: Assembly, m: int, n_q: int, begin: float, tolerances: Tolerances,
                 most_steps: int, longest: float, factors: Array, dense: bool, same: float):
        super().__init__(equations, m, np.zeros(1), tolerances, most_steps, longest=longest)
        flat, self.begin_time, self.assembly, self.factors = assembly.flat, begin, assembly, factors
        resets = [(e, reset) for e, event in enumerate(flat.events) for reset in event.resets]
        states = {column: k for k, column in enumerate(assembly.reduced.states)}
        places = {h.index: k for k, h in enumerate(flat.held)}
        rows = {index: k for k, index in enumerate(equations.moving)}
        self.held, self.n_events = np.array([h.index for h in flat.held], np.int32), len(flat.events)
        self.n_z = equations.n_z * (1 + m)
        n_x, n_c = equations.n - n_q, sum(event.indicator is not None for event in flat.events)
        # the program has states and integrals in one block, `EventState` has all states before the integrals
        block = np.arange(1 + m)[:, None]
        self._order = np.concatenate([(block * equations.n + np.arange(n_x)).ravel(),
                                      (block * equations.n + n_x + np.arange(n_q)).ravel()])
        capacity = SAMPLED_RUNS.points * SAMPLED_RUNS.targets if dense else 0
        whole = [np.array(k, np.int32) for k in (
            [e for e, _ in resets], [-1 if r.unknown is None else states[(r.unknown, 0)] for _, r in resets],
            [-1 if r.held is None else places[r.held] for _, r in resets], self.held,
            [rows.get(index, -1) for index in self.held.tolist()])]
        self._true = np.zeros(max(n_c, 1))
        self._points = np.zeros(capacity), np.zeros((capacity, self._total)), np.zeros((capacity, self.n_z)), \
            np.zeros(capacity, np.int64)
        work = [np.zeros(max(size, 1)) for size in (2 * n_c, 2 * n_c, 2 * self._total, len(self.held) * (1 + m), len(resets),
                                                    len(resets) * m)]
        self._sampled = _Sampled(len(resets), len(self.held), n_c, len(assembly.p) + len(factors), capacity,
                                 *map(_address, [*whole, self._true, *work, *self._points]), 0, same, 0.0, 0.0, 0.0)
        self._kept += [*whole, *work, self._true, *self._points, self._sampled]
        self._problem.sampled = ctypes.cast(ctypes.pointer(self._sampled), _Pointer)
        self._problem.restart = 1
        self._problem.n_u = assembly.arguments[4].numel()

    def begin_run(self) -> None:
        """Reset the counters of earlier runs."""
        self._sampled.trial, self._sampled.strikes, self._sampled.counted, self._sampled.intervals = 8, 0, 0, 0
        self._problem.step = 0.0

    def go_on(self, state: EventState, targets: Targets) -> Passed:
        """Integrate from a state over the targets, up to the first one that the program cannot pass."""
        equations, problem, m, n = self.equations, self._problem, self.m, len(targets.times)
        self._renew()
        hoisted = np.ascontiguousarray(equations.hoist(np.concatenate([state.p, self.factors, np.zeros(self.n_events)]))[
            "o0"].ravel())
        self._directions[:m] = state.dp[equations.moving].T
        self._true[:len(state.true)] = state.true
        start = np.empty(self._total)
        start[self._order] = state.y[:self._total]
        before = np.ascontiguousarray(np.column_stack([state.p[self.held], state.dp[self.held]]))
        library, at = self._program.library, ctypes.byref(problem)
        z0 = np.ascontiguousarray(state.z[:equations.n_z])
        library.place(at, _address(start), _address(z0), _address(hoisted), _address(before))
        y_before, y = np.empty((n, self._total)), np.empty((n, self._total))
        z_before, z = np.empty((n, self.n_z)), np.empty((n, self.n_z))
        held = np.empty((n, len(self.held), 1 + m))
        passed_targets, self._counts[:] = np.zeros(1, np.int64), 0
        times, anew = np.ascontiguousarray(targets.times - self.begin_time), targets.anew.astype(np.uint8)
        columns = [np.ascontiguousarray(u.T) for u in (targets.inputs, targets.at)]
        ends, events = np.ascontiguousarray(targets.ends, np.int64), np.ascontiguousarray(targets.events, np.int32)
        arguments = times, anew, ends, events, *columns, y_before, z_before, y, z, held, self._counts, passed_targets
        answer = library.sample(at, state.t - self.begin_time, n, *map(_address, arguments))
        equations.spent(int(self._counts[1]), bool(m or equations.n_z))
        reached, points = int(passed_targets[0]), self._sampled.points
        number = int(np.searchsorted(self._points[3][:points], reached))
        p, dp = np.tile(state.p, (reached, 1)), np.tile(state.dp, (reached, 1, 1))
        p[:, self.held], dp[:, self.held] = held[:reached, :, 0], held[:reached, :, 1:]
        return Passed(y_before[:reached, self._order], z_before[:reached], y[:reached, self._order], z[:reached], p, dp,
                      self._points[0][:number] + self.begin_time, self._points[1][:number][:, self._order],
                      self._points[2][:number].copy(), self._points[3][:number].copy(),
                      self._true[:len(state.true)] > 0, int(self._counts[0]), answer in (ALL_DONE, BUFFER_FULL))


def _address(values: Any) -> int | None:
    return int(values.ctypes.data) if values.size else None


def sampled_integration(assembly: Assembly, m: int, moving: Sequence[int], quadratures: ca.SX | None,
                        factors: Factors | None, begin: float, tolerances: Tolerances, most_steps: int, longest: float,
                        dense: bool, same: float) -> SampledIntegration | None:
    """The compiled program for an assembly; None if it cannot integrate this assembly, or would not save time."""
    flat, order = assembly.flat, assembly.update_order
    timed = [event for event in flat.events if event.indicator is None]
    if flat.delays or any(event.impulse is not None or event.ends for event in timed) \
            or (assembly.algebraic_names and len(timed) < len(flat.events) and
                len(assembly.algebraic_names) > SAMPLED_RUNS.loops) or compiled_cvodes.program() is None:
        return None
    updates = order.at(assembly.p)
    if updates.apart:
        return None

    def equations_of_samples() -> Equations | None:
        states = {column: k for k, column in enumerate(assembly.reduced.states)}
        origins, sizes = assembly.x_origin, assembly.x_nominal
        rows = [value if reset.unknown is None else (value - origins[k := states[(reset.unknown, 0)]]) / sizes[k]
                for value, reset in zip(split(updates.values), (r for e in flat.events for r in e.resets), strict=True)]
        return scaled_equations(assembly, stack(rows), moving if m else (), begin, quadratures,
                                None if factors is None else factors.symbols, _looked(assembly), updates.fired)

    zeros = (assembly.p[order.zeros] == 0).tobytes()
    equations: Equations | None = equations_of_samples() if quadratures is not None else assembly.once(
        ("sampled", tuple(moving) if m else (), begin, zeros), equations_of_samples)
    if equations is None:
        return None
    values = np.zeros(0) if factors is None else factors.values
    return SampledIntegration(equations, assembly, m, 0 if quadratures is None else quadratures.numel(), begin, tolerances,
                              most_steps, longest, values, dense, same)


def _looked(assembly: Assembly) -> ca.SX:
    """The indicators of all conditions, then their rates along the motion."""
    t, x, z, _, _, _ = assembly.arguments
    indicators = assembly.express(stack(e.indicator for e in assembly.flat.events if e.indicator is not None))
    n = indicators.numel()
    if not n:
        return ca.SX(0, 1)
    along = ca.jtimes(stack([indicators, assembly.alg]), stack([t, x]), stack([ca.SX(1), assembly.ode]))
    rates = along[:n]
    if z.numel():
        by_z = ca.solve(ca.densify(ca.jacobian(assembly.alg, z)), ca.densify(along[n:]))
        rates = rates - ca.mtimes(ca.jacobian(indicators, z), by_z)
    return ca.densify(stack([indicators, rates]))


Make = Callable[[], SampledIntegration | None]


class Schedule:
    """The targets of a run: its stops, and its instants, which are stops if they are close to one."""

    def __init__(self, timetable: Timetable, stops: Array, kinks: Array, same: float):
        self.timetable, self.same = timetable, same
        instants = timetable.times
        place = np.clip(np.searchsorted(stops, instants), 1, len(stops) - 1)
        near = np.where(instants - stops[place - 1] < stops[place] - instants, stops[place - 1], stops[place])
        self.instants = np.where(np.abs(near - instants) <= same, near, instants)
        self.times = np.union1d(stops, self.instants)
        self.kink = np.isin(self.times, kinks)
        self.first = np.searchsorted(self.instants, self.times)  # of the instants from each target on
        self.last = np.searchsorted(self.instants, self.times, side="right")

    def targets(self, t: float, instant: int, inputs: Callable[[Array], Array]) -> Targets:
        """The targets after a time, of which the first instant is this."""
        begin = int(np.searchsorted(self.times, t + self.same, side="right"))
        chosen = slice(begin, begin + SAMPLED_RUNS.targets)
        times, first, last = self.times[chosen], np.maximum(self.first[chosen], instant), self.last[chosen]
        owners, ends = self.timetable.owners, self.timetable.ends
        last = np.maximum(last, first)
        counts = np.where(last > first, ends[last] - ends[first], 0)
        from_event = int(ends[first[0]]) if len(times) else 0
        u = inputs((np.append(t, times[:-1]) + times) / 2)
        return Targets(times, self.kink[chosen] | np.append((u[:, 1:] != u[:, :-1]).any(axis=0), True),
                       np.cumsum(counts), owners[from_event:from_event + int(counts.sum())], u, inputs(times))
