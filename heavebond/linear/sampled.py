"""Sampled systems: exact discretisation between samples, linearised updates, several rates over their common period.

Between samples the variables h that samples set are constant. With the states x and the inputs w, z = (x, h),

    x' = A x + B h + E w,    h' = 0:    z(t + dt) = z + phi(G dt) dt (G z + F w),    phi(M) = M^-1 (exp(M) - 1).

At an instant the blocks of the coincident clocks set h_i (or a state) to R_i z + N_i z_new + S_i w: along the data flow a
block reads the new values of other blocks (N); it reads states and its own variables as before the instant (R; see
`numerics.update_order`). The product of all these maps over the hyperperiod T, the least common multiple of the periods, is
the monodromy matrix Phi; its eigenvalues z = exp(s T) decide on the stability. Inputs are constant over the hyperperiod.

The matrices are kept less the identity, Delta = (Phi - 1)/T, as slow modes would be lost in the rounding of Phi.

K. J. Astrom, B. Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, chapter 2; R. H. Middleton, G. C. Goodwin, Digital
Control and Estimation, Prentice Hall 1990; D. G. Meyer, C. S. Burrus, IEEE Trans. Circuits Syst. 22 (1975) 162-168,
doi:10.1109/TCS.1975.1084020.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import gcd, lcm

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.core.presentation import readable
from heavebond.equations.events import FlatEvent
from heavebond.language.smoothing import without_rounding
from heavebond.language.symbols import split, stack
from heavebond.linear.held_variables import HeldStructure, HeldVariable
from heavebond.numerics.dae import Array
from heavebond.numerics.newton import Scaling, newton
from heavebond.numerics.start_equations import Point


@dataclass(frozen=True)
class SamplingConstants:
    """The constants of the analysis of sampled systems.

    ratio: share by which a ratio of two periods may differ from one of whole numbers. Origin: periods with nine digits.
        Doubled: nothing.
    max_ratio: largest of these whole numbers. Origin: periods with four digits. Doubled: longer hyperperiods.
    max_instants: instants in a hyperperiod. Origin: some seconds for a machine of fifty states. Doubled: time.
    same: share of the shortest period within which two instants are one. Origin: rounding of times. Doubled: nothing.
    """

    ratio: float = 1e-9
    max_ratio: int = 10_000
    max_instants: int = 5_000
    same: float = 1e-7


SAMPLING = SamplingConstants()


@dataclass(frozen=True)
class Schedule:
    """The instants of a hyperperiod: times in [0, period) in s, rising, each with the numbers of its events."""

    period: float
    instants: tuple[tuple[float, tuple[int, ...]], ...]

    @property
    def same(self) -> float:
        """The time difference in s below which two instants are identical."""
        return SAMPLING.same * self.period / max(len(self.instants), 1)


def schedule(events: Sequence[FlatEvent], first: Sequence[float], periods: Sequence[float]) -> Schedule:
    """The schedule of events with their first instants and periods in s; UsageError for periods without a common multiple
    that is short enough."""
    shortest = min(periods)
    shares = [Fraction(p / shortest).limit_denominator(SAMPLING.max_ratio) for p in periods]
    exact = [abs(float(f) * shortest - p) <= SAMPLING.ratio * p for f, p in zip(shares, periods, strict=True)]
    whole = Fraction(lcm(*(f.numerator for f in shares)), gcd(*(f.denominator for f in shares)))
    number = sum(int(whole / f) for f in shares)
    if not all(exact) or number > SAMPLING.max_instants:
        rates = dict(zip(periods, events, strict=True))
        listed = [f"'{event.name}' every {readable(p, 's')}" for p, event in rates.items()]
        common = f"only after {readable(float(whole) * shortest, 's')}, with {number} instants" if all(exact) else "never"
        raise UsageError([Problem(
            "hyperperiod", f"the sampled blocks in the loops have periods that meet {common}: {listing(listed, 6)}",
            next(iter(rates.values())).place,
            "Give them periods with a short common multiple, such as 1 ms, 2 ms and 10 ms. "
            "To judge the loop of the fastest blocks alone, give the slower ones a constant input.")])
    period = float(whole) * shortest
    same = SAMPLING.same * shortest
    times: list[tuple[float, int]] = []
    for i, (f, p) in enumerate(zip(shares, periods, strict=True)):
        begin = first[i] % p
        begin = 0.0 if p - begin <= same else begin
        times += [(begin + k * p, i) for k in range(int(whole / f))]
    instants: list[tuple[float, tuple[int, ...]]] = []
    for time, i in sorted(times):
        if instants and time - instants[-1][0] <= same:
            instants[-1] = (instants[-1][0], tuple(sorted((*instants[-1][1], i))))
        else:
            instants.append((time, (i,)))
    return Schedule(period, tuple(instants))


@dataclass(frozen=True)
class Hybrid:
    """A linear system with samples: z = (x, h) of n variables with `names` and `sizes`, z' = g z + f w between instants,
    outputs y = c z + d w (k). At the instants of the event `event[i]` of the part `part[i]` the variable `target[i]` is set
    to r[i] z + after[i] z + s[i] w, with the values of z before and after the instant."""

    names: tuple[str, ...]
    sizes: Array
    rigid: tuple[bool, ...]
    g: Array
    f: Array
    c: Array
    d: Array
    r: Array
    s: Array
    target: tuple[int, ...]
    event: tuple[int, ...]
    part: tuple[str, ...]
    after: Array
    schedule: Schedule

    @property
    def constant(self) -> NDArray[np.bool_]:
        """Which variables do not change between instants."""
        return np.asarray(~(self.g.any(axis=1) | self.f.any(axis=1)))

    def updates(self, events: Sequence[int]) -> tuple[list[int], Array, Array]:
        """The variables that events of one instant set, and their new values as rows over z and w before it; UsageError for
        updates that read each other's new values."""
        rows = [i for i, event in enumerate(self.event) if event in events]
        targets = [self.target[i] for i in rows]
        fresh, before = self.after[np.ix_(rows, targets)], self.r[rows] + self.after[rows]
        before[:, targets] = self.r[np.ix_(rows, targets)]
        if np.linalg.matrix_power((fresh != 0).astype(float), len(rows)).any():
            parts = listing(list(dict.fromkeys(self.part[i] for i in rows)), 6)
            raise UsageError([Problem("sampled-loop", f"among the sampled parts {parts} are some of which each reads, "
                                      "at one instant, the value that another assigns", None,
                                      "Let one of them sample later by its `t_0`.")])
        # in the order of the data flow this is a lower triangular system
        solved = np.asarray(np.linalg.solve(np.eye(len(rows)) - fresh, np.hstack([before, self.s[rows]])), dtype=float)
        return targets, solved[:, :len(self.names)], solved[:, len(self.names):]

    def instants_from(self, begin: float) -> list[tuple[float, tuple[int, ...]]]:
        """The instants of a hyperperiod that begins at a time, with times since then."""
        period, same = self.schedule.period, self.schedule.same
        shifted = [((time - begin) % period, events) for time, events in self.schedule.instants]
        return sorted((0.0 if period - time <= same else time, events) for time, events in shifted)


@dataclass(frozen=True)
class Discrete:
    """z[k+1] = a z[k] + b w[k], y[k] = c z[k] + d w[k] in the remaining states, with delta = (a - 1)/period; z is taken
    right before the instants k, y right after them."""

    period: float
    names: tuple[str, ...]
    sizes: Array
    rigid: tuple[bool, ...]
    delta: Array
    b: Array
    c: Array
    d: Array

    @property
    def a(self) -> Array:
        """The monodromy matrix."""
        return np.eye(len(self.delta)) + self.period * self.delta

    def closed(self, factor: complex) -> NDArray[np.complex128]:
        """The monodromy matrix, of scaled variables, of an open loop that is closed with a factor in it."""
        back = np.linalg.solve(np.eye(len(self.d)) + factor * self.d, factor * self.c)
        return np.asarray((self.a - self.b @ back) * self.sizes / self.sizes[:, None], dtype=complex)

    def closed_delta(self) -> Array:
        """Delta of the closed loop."""
        return np.asarray(self.delta - self.b @ np.linalg.solve(np.eye(len(self.d)) + self.d, self.c) / self.period)


@dataclass(frozen=True)
class Input:
    """An input that is set at times since the begin of the hyperperiod: to the value that is given `delay` before."""

    times: tuple[float, ...] = (0.0,)
    delay: float = 0.0


@dataclass(frozen=True)
class SampledLoop:
    """A loop that is cut at a signal: the hybrid system from r to -s, the `times` in s at which the signal is taken in a
    hyperperiod, and whether it is `read` at instants alone (else it is held between these times)."""

    system: Hybrid
    times: tuple[float, ...]
    read: bool

    def open(self, delay: float = 0.0) -> Discrete:
        """L over a hyperperiod, with a further delay in s."""
        begin = self.times[0]
        return discretised(self.system, begin - delay * self.read, Input(tuple(t - begin for t in self.times), delay))


def discretised(system: Hybrid, begin: float | None = None, inputs: Input = Input()) -> Discrete:
    """A hybrid system from instant to instant of its hyperperiod, which begins at a time (None: the first instant).

    The inputs are given at the times of `inputs`: for n of these, b has n times as many columns, and c and d the rows of the
    outputs right after each of them. With a delay, a value acts that long after its time.
    """
    begin = system.schedule.instants[0][0] if begin is None else begin
    period, same = system.schedule.period, system.schedule.same
    n, m, k, number = len(system.names), system.f.shape[1], len(system.c), len(inputs.times)
    # what is given and does not act yet at the begin of a hyperperiod, in the order in which it will
    begun = [time + inputs.delay - turn * period for time in inputs.times
             for turn in range(1, int((inputs.delay + max(inputs.times)) / period) + 2)]
    pending = sorted(time for time in begun if time > -same)
    stored = m * (1 + len(pending)) if inputs.delay or number > 1 or inputs.times != (0.0,) else 0
    width = n + stored + number * m
    start = np.eye(n + stored, width)
    change = np.zeros((n, width))  # of z since the begin
    current = start[n:n + m] if stored else np.zeros((m, width))
    queue = [(time, start[n + m * (j + 1):n + m * (j + 2)]) for j, time in enumerate(pending)]
    values = [np.eye(m, width, n + stored + j * m) for j in range(number)]
    out = np.zeros((number * k, width))
    instants = system.instants_from(begin)
    steps: list[tuple[float, int, int]] = [(time, 1, i) for i, (time, _) in enumerate(instants)]
    steps += [(time, 2, j) for j, time in enumerate(inputs.times)]
    steps += [(time, 0, j) for j, (time, _) in enumerate(queue) if time < period - same]
    new = [((time + inputs.delay), j) for j, time in enumerate(inputs.times)]
    queue += [(time, values[j]) for time, j in new]
    steps += [(time, 0, len(pending) + i) for i, (time, _) in enumerate(new) if time < period - same]
    flows, time = dict[float, tuple[Array, Array]](), 0.0
    # steps in the order of their times; those of one instant in the order of their kinds
    merged: list[tuple[float, int, int]] = []
    for step_time, kind, number in sorted(steps):
        at_last = bool(merged) and step_time - merged[-1][0] <= same
        merged.append((merged[-1][0] if at_last else max(step_time, 0.0), kind, number))
    merged.sort()
    for at, kind, number_of in merged:
        change, time = _flown(system, flows, change, start[:n], current, at - time), at
        whole = start[:n] + change
        if kind == 0:
            current = queue[number_of][1]
        elif kind == 1:
            targets, r, s = system.updates(instants[number_of][1])
            change[targets] = r @ whole + s @ current - start[targets]
        else:
            out[number_of * k:(number_of + 1) * k] = system.c @ whole + system.d @ current
    change = _flown(system, flows, change, start[:n], current, period - time)
    remaining = sorted(((when, row) for when, row in queue if when >= period - same), key=lambda item: item[0])
    rows = np.vstack([current, *(row for _, row in remaining)]) if stored else np.zeros((0, width))
    less = np.vstack([change, rows - start[n:]])
    names = (*system.names, *(f"input[{j}]" for j in range(stored)))
    sizes, rigid = np.concatenate([system.sizes, np.ones(stored)]), (*system.rigid, *([False] * stored))
    # variables whose value before a hyperperiod nothing reads, those of a hold that is set at its begin, are left out
    state_rows, states = np.arange(n + stored), n + stored
    while unread := [k for k in state_rows.tolist() if less[k, k] == -1 and np.count_nonzero(less[state_rows, k]) == 1
                     and not out[:, k].any()]:
        state_rows = np.setdiff1d(state_rows, unread)
    return Discrete(period, tuple(names[k] for k in state_rows), sizes[state_rows], tuple(rigid[k] for k in state_rows),
                    less[np.ix_(state_rows, state_rows)] / period, less[state_rows, states:], out[:, state_rows],
                    out[:, states:])


def _flown(system: Hybrid, flows: dict[float, tuple[Array, Array]], change: Array, start: Array, current: Array,
           length: float) -> Array:
    """The change of z over a time in s."""
    from scipy.linalg import expm

    if length <= 0.0:
        return change
    key = float(f"{length:.12g}")
    if key not in flows:
        n, sizes = len(system.g), system.sizes
        g, f = system.g * sizes / sizes[:, None] * length, system.f / sizes[:, None] * length
        phi = expm(np.block([[g, np.eye(n)], [np.zeros((n, 2 * n))]]))[:n, n:]
        flows[key] = (phi @ g) * sizes[:, None] / sizes, (phi @ f) * sizes[:, None]
    along, forced = flows[key]
    return np.asarray(change + along @ (start + change) + forced @ current)


def equivalent(z: NDArray[np.complex128] | complex, period: float) -> NDArray[np.complex128]:
    """s = log(z)/T in 1/s; a pole at 0, which decays within a period, counts as one of the size of rounding."""
    values = np.asarray(z, dtype=complex)
    values = np.where(np.abs(values) < np.finfo(float).eps, np.finfo(float).eps, values)
    return np.asarray(np.log(values) / period)


class SampledUpdates:
    """The samples that a linear system contains: their variables, new values and instants.

    `held` are the exact ones of the held variables of an assembly (see `held_variables`). `symbols` are their symbols,
    without states, and `after` their symbols after an instant, as further inputs of the continuous system; `values` are the
    new values, as further outputs of it, in the order of the run at the parameters p (see `numerics.update_order`).
    """

    def __init__(self, structure: HeldStructure, held: Sequence[HeldVariable], p: Array):
        assembly = structure.assembly
        names = {h.name for h in held}
        rows = [k for k, (_, reset) in enumerate(structure.updates) if reset.name in names
                and structure.events[structure.updates[k][0]].period is not None]
        updates = [structure.updates[k] for k in rows]
        self.held, self._all = tuple(h for h in held if not h.state), tuple(held)
        self._of_variable = [[event for event, reset in updates if reset.name == h.name] for h in held]
        columns = [reset.held for h in self.held for _, reset in updates if reset.name == h.name and reset.held is not None]
        self.indices = list(dict.fromkeys(columns))
        states = {column: k for k, column in enumerate(assembly.reduced.states)}
        n_x = len(assembly.x_nominal)
        self.target = tuple(states[(reset.unknown, 0)] if reset.unknown is not None else
                            n_x + self.indices.index(reset.held or 0) for _, reset in updates)
        self._events = list(dict.fromkeys(i for i, _ in updates))
        self.event = tuple(self._events.index(i) for i, _ in updates)
        self.events = [structure.events[i] for i in self._events]
        self.part = tuple(self.events[i].name.rpartition(".")[0] for i in self.event)
        self.symbols = stack([assembly.arguments[3][index] for index in self.indices])
        self.after = ca.SX.sym("after", self.number)
        order = assembly.update_order.at(p)
        later = split(assembly.arguments[3])
        for index, symbol in zip(self.indices, split(self.after), strict=True):
            later[index] = symbol
        direct = [without_rounding(order.direct[row])[0] if row in structure.means else order.direct[row] for row in rows]
        self.values = ca.substitute(stack(direct), order.after, stack(later))
        times = [event.first for event in self.events]
        times += [event.period for event in self.events if event.period is not None]
        self._times = ca.Function("times", [assembly.arguments[3]], [assembly.express(stack(times))])
        self._assembly = assembly

    @cached_property
    def rest(self) -> ca.Function:
        """The sides that are 0 at rest and their Jacobian, by states, algebraic unknowns and these variables: the rates (of
        a state that samples set its change), the algebraic equations, and the changes of these variables; behind them the
        changes of all updates."""
        t, x, z, p, u, rate = self._assembly.arguments
        inner, n_x = stack([x, z, self.symbols]), x.numel()
        variables = stack([x, self.symbols])
        changes = ca.substitute(self.values, self.after, self.symbols) - stack([variables[k] for k in self.target])
        rates, last = split(self._assembly.ode), split(changes)
        held = [last[self.target.index(n_x + k)] for k in range(self.number)]
        for row, k in enumerate(self.target):
            if k < n_x:
                rates[k] = last[row]
        sides = stack([*rates, self._assembly.alg, *held, changes])
        return ca.Function("rest", [t, x, z, p, u, rate], [ca.densify(sides), ca.densify(ca.jacobian(sides, inner))])

    def at_rest(self, point: Point, bounds: tuple[Array, Array]) -> Point | None:
        """The equilibrium, including the samples, by Newton's method from a point with the inputs held constant; `bounds`
        are the bounds of states and algebraic unknowns."""
        assembly, n_x, n = self._assembly, len(point.x), len(point.x) + len(point.z)
        slopes = np.abs(np.array(self.rest(*point.values())[1]))[-len(self.target):, :n_x] @ assembly.x_nominal
        held = [max((slopes[i] for i, t in enumerate(self.target) if t == n_x + k), default=0.0) or 1.0
                for k in range(self.number)]
        sizes = np.concatenate([assembly.x_nominal, assembly.z_nominal, held])

        def at(y: Array) -> Point:
            p = point.p.copy()
            p[self.indices] = y[n:]
            return replace(point, x=y[:n_x], z=y[n_x:n], p=p, rate=0.0)

        def system(y: Array) -> tuple[Array, Array]:
            sides, jacobian = (np.array(values) for values in self.rest(*at(y).values()))
            return sides.ravel()[:len(y)], jacobian[:len(y)] * sizes

        low, high = (np.append(end[:n], np.full(len(sizes) - n, free))
                     for end, free in zip(bounds, (-np.inf, np.inf), strict=True))
        result = newton(system, np.concatenate([point.x, point.z, point.p[self.indices]]), Scaling(sizes, low, high))
        return at(result.y) if result.good else None

    def sampled(self, point: Point) -> tuple[HeldVariable, ...]:
        """All variables that samples set, with their shortest periods."""
        periods = np.array(self._times(point.p)).ravel()[len(self.events):]
        values = dict(zip((h.name for h in self.held), point.p[self.indices].tolist(), strict=True))
        shortest = [float(min(periods[self._events.index(e)] for e in events)) for events in self._of_variable]
        return tuple(replace(h, value=values.get(h.name, h.value), period=period)
                     for h, period in zip(self._all, shortest, strict=True))

    @property
    def number(self) -> int:
        """The number of variables that are not states."""
        return len(self.held)

    def hybrid(self, point: Point, names: Sequence[str], sizes: Array, rigid: Sequence[bool], a: Array, b: Array, c: Array,
               d: Array) -> Hybrid:
        """The hybrid system from the continuous one, whose last inputs are the variables before and after an instant and
        whose last outputs are the new values."""
        n, h, k = len(a), self.number, len(self.target)
        m, outputs = b.shape[1] - 2 * h, len(c) - k
        times = np.array(self._times(point.p)).ravel()
        g, f = np.zeros((n + h, n + h)), np.zeros((n + h, m))
        g[:n, :n], g[:n, n:], f[:n] = a, b[:, m:m + h], b[:, :m]
        after = np.hstack([np.zeros((k, n)), d[outputs:, m + h:]])
        # a variable is as large as the states make it
        reach = np.abs(c[outputs:]) @ sizes
        held_sizes = np.array([max((reach[i] for i, t in enumerate(self.target) if t == n + j), default=0.0) or 1.0
                               for j in range(h)])
        return Hybrid((*names, *(v.name for v in self.held)), np.concatenate([sizes, held_sizes]),
                      (*(rigid or [False] * n), *([False] * h)), g, f,
                      np.hstack([c[:outputs], d[:outputs, m:m + h]]), d[:outputs, :m],
                      np.hstack([c[outputs:], d[outputs:, m:m + h]]), d[outputs:, :m], self.target, self.event, self.part,
                      after, schedule(self.events, times[:len(self.events)].tolist(), times[len(self.events):].tolist()))


def sampled_words(period: float) -> str:
    """`sampled every 50 ms`."""
    return f"sampled every {readable(period, 's', 6)}"
