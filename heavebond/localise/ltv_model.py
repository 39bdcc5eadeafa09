"""Linear time-varying model of small deviations from a run of a record.

Along a simulated run, with dx the deviation of the states, q of the free parameters (in standard deviations of their
priors) and w_n the input at node n (see `places`),

    dx' = A(t) dx + A_q(t) q + sum_n B_n(t) dw_n,     dy = C(t) dx + C_q(t) q + sum_n D_n(t) dw_n,

A = f_x - f_z g_z^-1 g_x and so on, since algebraic unknowns follow without delay. From one sample to the next, over h, with
the matrices of its middle, the solution is exact: dx(t + h) = exp(A h) dx(t) + G (A_q q + B dw), G = int_0^h exp(A s) ds.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

from heavebond.core.quoting import file_stem
from heavebond.core.units import Unit, read_unit
from heavebond.equations.buffered import Buffered
from heavebond.equations.flatten import Flat, flatten
from heavebond.equations.places import Node, input_nodes, jumps_at, places_of, with_virtual_jumps, with_virtual_sources
from heavebond.equations.reduce import reduce_flattened
from heavebond.estimation.comparison import simulate_over
from heavebond.estimation.experiment import Experiment, Free, Record
from heavebond.estimation.records import Mask, measure
from heavebond.language.symbols import stack
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.whitening import Whitening
from heavebond.numerics.dae import Array, Assembly, build
from heavebond.numerics.initialise import tangent
from heavebond.numerics.result import Result, columns
from heavebond.numerics.start_equations import StartEquations
from heavebond.text.expression import names as names_in

JUMP_ORDERS = 3  # a jump, its rate and its acceleration act on the machine
AT_ONCE = 128  # points at which one call evaluates a function: what maps it takes as long to build as they are many


@dataclass(frozen=True)
class Known:
    """The prior of a free parameter: value = centre + deviation * q, or centre * exp(deviation * q) if `logarithmic`, with q
    normal."""

    name: str
    centre: float
    deviation: float
    low: float
    high: float
    logarithmic: bool
    each: bool

    def place_of(self, value: float) -> float:
        """The q of a value."""
        deviation = np.log(value / self.centre) if self.logarithmic else value - self.centre
        return float(deviation / self.deviation)

    def value_of(self, q: float) -> float:
        """The value of a q, within the range."""
        value = self.centre * np.exp(self.deviation * q) if self.logarithmic else self.centre + self.deviation * q
        return float(np.clip(value, self.low, self.high))

    def slope(self, value: float) -> float:
        """d value / d q."""
        return self.deviation * (value if self.logarithmic else 1.0)


def known_of(free: Free, value: float) -> Known:
    """A free parameter's prior: its tolerance is two standard deviations; of a plain range its quarter, about the value
    that it has."""
    r = free.range
    if r.nominal is not None:
        return Known(free.name, r.nominal, (r.high - r.nominal) / 2, r.low, r.high, False, free.each)
    logarithmic = r.low > 0
    width = np.log(r.high / r.low) if logarithmic else r.high - r.low
    return Known(free.name, value, float(INPUT_ESTIMATION.range_deviation * width), r.low, r.high, logarithmic, free.each)


@dataclass(frozen=True)
class LocalSignal:
    """A signal of the diagram at which laws may look: its name, unit and role (across, position, signal, through)."""

    name: str
    unit: Unit
    role: str


@dataclass(frozen=True)
class LtvModel:
    """A record with its run, and the linear system about the run. Shapes: N samples, n states (each by its nominal size), k
    free parameters, m channels (each by its noise), M nodes, L local signals; all else in SI.

    `phi` (N-1, n, n+k) and `gamma` (N-1, n, M) step (dx, q) and dw; `error` (N, m) is measured - run; `c` (N, m, n+k) and
    `d` (N, m, M) give dy; `used` (N, m) are the samples that there are (the others are zero in all three); `local` (N, L),
    `local_c` and `local_d` the signals; `driven` (N, M) is the w with which the run was made; `start` (n, k) is
    d dx(0) / d q and `start_deviation` (n,) what dx(0) may have besides; `centre` (k,) is the q of the run.
    """

    record: str
    time: Array
    phi: Array
    gamma: Array
    error: Array
    c: Array
    d: Array
    used: Mask
    local: Array
    local_c: Array
    local_d: Array
    driven: Array
    start: Array
    start_deviation: Array
    centre: Array
    result: Result

    @cached_property
    def whitening(self) -> Whitening:
        """Its Kalman filter without an unknown input."""
        n = self.phi.shape[1]
        return Whitening.of(self.phi[:, :, :n], self.c[:, :, :n], self.start_deviation)


class SourcedRecord:
    """One record and its machine with a virtual source on every node (see `input_nodes`; or with all `sources` of its flat
    model), to be linearised about several runs. The deviations q are those of the free parameters and of `parameters`.

    `jumping` are signal inputs and ports with jumps (see `jumps_at`), which are zero in every run. Behind the columns of the
    nodes, the matrices of the inputs have those of `jumped` (signal input or port, order of the derivative of its jump)."""

    def __init__(self, experiment: Experiment, record: Record, folder: Path,
                 sources: Callable[[Flat], dict[str, Node]] = input_nodes, parameters: Sequence[str] = (),
                 jumping: Sequence[str] = ()):
        self.experiment, self.record = experiment, record
        measured = measure(experiment, record)
        self.time = measured.grid
        outputs = list(experiment.outputs.values())
        units = [read_unit(o.shown.unit) for o in outputs]
        values, counts, checking = measured.on_grid()
        self.used = (counts | checking).T
        self.measured = np.where(self.used, values.T, 0.0)
        self.noise = np.array([c.noise * u.scale for u, c in zip(units, measured.channels.values(), strict=True)])
        self.learn = _learnt(np.any(counts, axis=0, keepdims=True)[0], np.any(checking, axis=0, keepdims=True)[0], record)
        wanted = {n.text for o in outputs for n in names_in(o.shown.expr)}
        wanted |= {name.removeprefix("initial.") for name in experiment.free if name.startswith("initial.")}
        model = experiment.model_for(record)
        flat = flatten(model, wanted)
        self.nodes = sources(flat)
        self.places = places_of(flat, self.nodes)
        self.jumps = jumps_at(flat, jumping)
        self.file = folder / f"{file_stem(record.name)}.csv"
        self._write(np.zeros((len(self.time), len(self.nodes))))
        self.assembly = build(reduce_flattened(lambda corners: with_virtual_jumps(with_virtual_sources(
            flatten(model, wanted, corners=corners), self.nodes, self.file), self.jumps, self.file)))
        flat = self.assembly.flat
        self.locals = [LocalSignal(u.name, u.unit, u.role) for u in flat.unknowns
                       if u.role in ("across", "position", "signal")]
        self._jacobians = Jacobians(self.assembly, [self.assembly.expression(o.shown.expr) for o in outputs], self.locals,
                                     len(experiment.free) + len(parameters), len(self.nodes), len(self.jumps))
        self.jumped = [(path, order) for path in self.jumps for order in range(JUMP_ORDERS)]

    def _write(self, driven: Array) -> None:
        with self.file.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["time", *self.nodes, *self.jumps])
            writer.writerows(np.column_stack([self.time, driven, np.zeros((len(driven), len(self.jumps)))]).tolist())

    def about(self, values: Mapping[str, float], known: Sequence[Known], driven: Array | None = None) -> LtvModel:
        """The linear system about the run with these parameters and with `driven` (N, M) entering the nodes."""
        driven = np.zeros((len(self.time), len(self.nodes))) if driven is None else driven
        self._write(driven)
        assembly = self.assembly.with_parameters(values)
        middles = (self.time[:-1] + self.time[1:]) / 2
        fine = np.empty(2 * len(self.time) - 1)
        fine[::2], fine[1::2] = self.time, middles
        result = simulate_over(assembly, fine)
        p = assembly.parameter_values
        slopes = np.array([k.slope(p[k.name]) for k in known])
        index = [assembly.parameter_names.index(k.name) for k in known]
        directions = np.zeros((len(assembly.p), len(known)))
        directions[index, range(len(known))] = slopes
        start_tangent = tangent(assembly.once("start", lambda: StartEquations(assembly)), result.start, result.u[:, 0],
                                directions)
        whole = columns(result)
        a, b, *_ = self._jacobians.at([part[:, 1::2] for part in whole], start_tangent.p)
        _, _, y, c, d, local, local_c, local_d = self._jacobians.at([part[:, ::2] for part in whole], start_tangent.p)
        phi, gamma = stepped(a, b, np.diff(self.time))
        x = result.x / assembly.x_nominal[:, None]
        # what was not sampled tells nothing
        weight = self.used / self.noise
        return LtvModel(
            self.record.name, self.time, phi, gamma, (self.measured - y) * weight, c * weight[:, :, None],
            d * weight[:, :, None], self.used, local, local_c, local_d, driven, start_tangent.x / assembly.x_nominal[:,
                                                                                                                     None],
            INPUT_ESTIMATION.start_deviation * np.ptp(x, axis=1) + 1e-9,
            np.array([k.place_of(p[k.name]) for k in known]), result)


def _learnt(counts: Mask, checking: Mask, record: Record) -> Mask:
    """True for times (N,) of samples to be fitted: not for held-out stretches and validation records."""
    if record.use != "fit" or not checking.any():
        return np.full(len(counts), record.use == "fit")
    known = np.flatnonzero(counts | checking)
    nearest = known[np.clip(np.searchsorted(known, np.arange(len(counts))), 0, len(known) - 1)]
    return np.asarray(~checking[nearest])


class Jacobians:
    """The matrices of `LtvModel` at many moments, in nominal states; parameters along given directions."""

    def __init__(self, assembly: Assembly, outputs: Sequence[ca.SX], local: Sequence[LocalSignal], parameters: int,
                 m: int, jumps: int = 0):
        t, x, z, p, u, rate = assembly.arguments
        self.n, self.z, self.k, self.m = x.numel(), z.numel(), parameters, m
        self.outputs, self.local = len(outputs), len(local)
        self.nominal = assembly.x_nominal
        names = assembly.flat.names
        signals = stack([assembly.express(assembly.flat.levels[0][names[s.name]]) for s in local])
        # the value of each virtual source at a break is the first coefficient of its piece
        count = len(assembly.flat.inputs)
        virtual = [1 + 4 * k for k in range(count - m - jumps, count - jumps)]
        along = ca.SX.sym("along", p.numel(), self.k)
        rows = stack([assembly.ode, assembly.alg, stack(outputs), signals])
        by_u = ca.jacobian(rows, u)
        parts = [ca.jacobian(rows, x), ca.jacobian(rows, z), ca.jtimes(rows, p, along) if self.k else ca.SX(rows.numel(), 0),
                 by_u[:, virtual],
                 *(column for k in range(count - jumps, count)
                   for column in _by_rates(by_u[:, 1 + 4 * k:5 + 4 * k], t - u[0]))]
        self.rows = rows.numel()
        both = ca.Function("values", [t, x, z, p, u, rate], [ca.densify(rows)]), \
            ca.Function("along", [t, x, z, p, u, rate, along], [ca.densify(ca.horzcat(*parts))])
        self._values, self._along = (Buffered(function.map(AT_ONCE)) for function in both)

    def at(self, points: Sequence[Array], along: Array) -> tuple[Array, ...]:
        """A with A_q, B, y, C with C_q, D, the local signals and theirs, at points of a run, given as columns of the
        arguments of the assembly."""
        arguments = [np.ascontiguousarray(part) for part in points]
        rows = mapped(self._values, arguments)[:, 0].T
        whole = self._without_algebraic(np.ascontiguousarray(mapped(self._along, arguments, along).transpose(2, 0, 1)))
        n, outputs = self.n, self.n + self.z + self.outputs
        scale = np.concatenate([self.nominal, np.ones(self.k)])
        inner = whole[:, :, :n + self.k] * scale
        input_columns = whole[:, :, n + self.k:]
        first = slice(n + self.z, outputs)
        return (inner[:, :n] / self.nominal[:, None], input_columns[:, :n] / self.nominal[:, None], rows[:, first], inner[:,
                                                                                                                          first],
                input_columns[:, first], rows[:, outputs:], inner[:, outputs:], input_columns[:, outputs:])

    def _without_algebraic(self, whole: Array) -> Array:
        n, z = self.n, self.z
        if not z:
            return whole
        remaining = np.delete(whole, np.s_[n:n + z], axis=2)
        follows = np.linalg.solve(whole[:, n:n + z, n:n + z], remaining[:, n:n + z])
        return np.asarray(remaining - whole[:, :, n:n + z] @ follows)


def _by_rates(by_piece: ca.SX, s: ca.SX) -> list[ca.SX]:
    """The derivatives with respect to a jump w and its first derivatives, from those with respect to the coefficients of its
    polynomial piece, w = c0 + c1 s + c2 s**2."""
    by_c0, by_c1, by_c2 = (by_piece[:, k] for k in range(JUMP_ORDERS))
    by_rate = by_c1 - s * by_c0
    return [by_c0, by_rate, (by_c2 - s**2 * by_c0 - 2 * s * by_rate) / 2]


def mapped(function: Buffered, arguments: Sequence[Array], *same: Array) -> Array:
    """The values (rows, columns, N) of a function of `AT_ONCE` points at N points, whose first inputs are `arguments`
    (n, N), and whose other inputs are the `same` everywhere."""
    count, outputs, repeated = arguments[0].shape[1], [], [np.tile(part, (1, AT_ONCE)) for part in same]
    for begin in range(0, count, AT_ONCE):
        points = np.minimum(np.arange(begin, begin + AT_ONCE), count - 1)
        values, = function(*(part[:, points] for part in arguments), *repeated).values()
        outputs.append(values.reshape(len(values), -1, AT_ONCE, order="F"))
    return np.concatenate(outputs, axis=2)[:, :, :count]


def stepped(a: Array, b: Array, h: Array) -> tuple[Array, Array]:
    """exp(A h) with G A_q, (N, n, n+k), and G B (N, n, M), for `a` (N, n, n+k) holding A and A_q, `b` (N, n, M), `h` (N,).

    Taylor series over h / 2^s, then doubled s times: exp(2Ah) = exp(Ah)^2, G(2h) = G(h) + exp(Ah) G(h).
    """
    n = a.shape[1]
    size = float(np.max(np.abs(a[:, :, :n]).sum(axis=2).max(axis=1, initial=0.0) * h, initial=1e-9))
    doublings = max(0, int(np.ceil(np.log2(size / 0.5))))
    short = (h / 2**doublings)[:, None, None]
    ah = a[:, :, :n] * short
    eye = np.broadcast_to(np.eye(n), ah.shape)
    phi, integral, term = eye.copy(), eye.copy(), eye
    for order in range(1, 11):
        term = ah @ term / order
        phi = phi + term
        integral = integral + term / (order + 1)
    driven = (integral * short) @ np.concatenate([a[:, :, n:], b], axis=2)
    for _ in range(doublings):
        driven = driven + phi @ driven
        phi = phi @ phi
    k = a.shape[2] - n
    return np.concatenate([phi, driven[:, :, :k]], axis=2), driven[:, :, k:]


def with_values(known: Sequence[Known], q: Array) -> dict[str, float]:
    """Parameters by name from their q."""
    return {k.name: k.value_of(float(v)) for k, v in zip(known, q, strict=True)}
