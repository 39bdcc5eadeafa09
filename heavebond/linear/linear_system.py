"""Linear systems between chosen inputs and outputs: matrices, frequency response, poles and zeros, step responses.

An input w may enter with its derivatives (a position source passes its speed on):

    x' = A x + B_0 w + B_1 w' + B_2 w'',   y = C x + D_0 w + D_1 w' + D_2 w''.

With x = x~ + B_k w^(k-1), from the highest k down, x~' = A x~ + (B_(k-1) + A B_k) w^(k-1) + ..., y = C x~ + ... +
(D_(k-1) + C B_k) w^(k-1), so that only w itself is left in x~'. If D_1 or D_2 remain, the transfer function grows without
bound with the frequency; it has a frequency response, but no proper state space.

With samples in a loop, or between inputs and outputs, the system is discretised exactly (see `sampled`): x[k+1] = A x[k]
+ B w[k], y[k] = C x[k] + D w[k], with inputs that are constant over the period T. All its properties follow from gamma = (z
- 1)/T, G = C (gamma - Delta)^-1 B/T + D with Delta = (A - 1)/T; for small T, gamma approaches s.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heavebond.core import facade
from heavebond.core.errors import Problem, UsageError, listing
from heavebond.core.presentation import brief, count
from heavebond.core.units import dimension_text, read_unit
from heavebond.equations.flatten import flatten
from heavebond.language.model import ModelOrFile, loaded
from heavebond.linear.disturbance import inner_name
from heavebond.linear.held_variables import HeldVariable, undecided_reasons
from heavebond.linear.linearisation import Linearisation
from heavebond.linear.operating_point import OperatingPoints
from heavebond.linear.sampled import Hybrid, SampledLoop, discretised, equivalent
from heavebond.linear.stability import Stability, eigenvalues, stability, with_zeros
from heavebond.linear.zero_frequency import Leading, leading, with_zeros_at_zero
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import unknown_signal
from heavebond.numerics.start_equations import Point
from heavebond.text.expression import ExpressionProblem, names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class LinearSystemConstants:
    """The constants of poles, zeros and responses of a linear system.

    rounding: share of their sizes that terms leave as rounding where they cancel. Origin: systems of a hundred states.
        Doubled: nothing.
    infinite: multiple of the fastest pole beyond which a zero is at infinity. Origin: errors of the QZ algorithm. Doubled:
        nothing.
    visible: share of the strongest mode below which one is not looked for in plots of a channel. Origin: width of a line.
        Doubled: shorter plots.
    free: magnitude of a pole, over the fastest, below which it is at zero. Origin: errors of eigenvalues. Doubled: nothing.
    undamped: share of its magnitude that the half-width of an undamped resonance is given in a plot. Origin: a peak that no
        damping of a machine reaches. Doubled: nothing.
    points: points of a plot. Origin: pixels. Doubled: time.
    near: points about a resonance, together with its two flanks. Origin: pixels. Doubled: time.
    most_near: points about all resonances together. Origin: time of systems of hundreds of states. Doubled: time.
    sparse: number of states from which a frequency response may be solved by sparse factors. Origin: below, the dense
        solution is faster. Doubled: time.
    dense: share of nonzeros up to which it is. Origin: above, factors fill up. Doubled: time.
    block: numbers of a block of dense matrices that are solved at a time. Origin: 64 MB. Doubled: memory.
    zeros: number of states up to which a table of channels contains the zeros. Origin: the QZ algorithm takes some seconds
        there, and eight times as long for twice as many. Doubled: time.
    """

    rounding: float = 1e-11
    infinite: float = 1e6
    visible: float = 1e-2
    free: float = 1e-9
    undamped: float = 1e-6
    points: int = 600
    near: int = 65
    most_near: int = 6000
    sparse: int = 100
    dense: float = 0.1
    block: int = 4_000_000
    zeros: int = 400


LINEAR_SYSTEM = LinearSystemConstants()
AT_A_POLE = complex(np.inf, np.nan)  # the size is infinite, the angle has no value


@dataclass(frozen=True)
class DelayedSystem:
    """A linear system with delays: `open` has as its last inputs the delayed variables and as its last outputs their
    sources, v = exp(-s T) z with the `delays` T (n,) in s."""

    open: StateSpace
    delays: Array

    def response(self, points: Complex) -> Complex:
        """The transfer functions (N, k, m) at complex frequencies (N,) with the delays: with [y; z] = [[A, B], [C, D]]
        [w; v] and E = exp(-s T), y = (A + B E (1 - D E)^-1 C) w."""
        n = len(self.delays)
        whole = self.open.response(points)
        direct, back, forth, loop = whole[:, :-n, :-n], whole[:, :-n, -n:], whole[:, -n:, :-n], whole[:, -n:, -n:]
        factor = np.exp(-points[:, None, None] * self.delays)
        return np.asarray(direct + (back * factor) @ np.linalg.solve(np.eye(n) - loop * factor, forth))


@dataclass(frozen=True)
class StateSpace:
    """A linear system x' = A x + B w, y = C x + D w: a (n, n), b (n, m), c (k, n), d (k, m) in SI.

    `higher` (2, k, m) are the factors of w' and w'' in y, `sizes` (n,) the nominal values of the states, `units` the units
    of states, inputs and outputs in turn. `shown` are the units in which the outputs are printed and drawn (`displayed`),
    `rigid` marks states that are positions and speeds of bodies, `held` are the variables that are constant in the linear
    system. The states are the states of the machine, less the terms of derivatives of the inputs (see the module). Delayed
    variables have approximations without history in the matrices; with `exact` the responses have their factors exp(-s T).

    With a `period` T in s it is a sampled system, x[k+1] = A x[k] + B w[k], with `delta` = (A - 1)/T: x is taken just before
    the samples, y just after them; `sampled` are the variables that samples set, some of them states. An open loop that is
    cut at a signal (`cut`) of several instants in a period has a column and a row for each of them. Delays of a sampled
    system have approximations without history.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]
    a: Array
    b: Array
    c: Array
    d: Array
    higher: Array
    sizes: Array
    point: Point
    shown: tuple[str, ...] = ()
    rigid: tuple[bool, ...] = ()
    held: tuple[HeldVariable, ...] = ()
    exact: DelayedSystem | None = None
    period: float | None = None
    delta: Array | None = None
    sampled: tuple[HeldVariable, ...] = ()
    cut: SampledLoop | None = field(default=None, repr=False, compare=False)
    hybrid: Hybrid | None = field(default=None, repr=False, compare=False)

    def plot(self, picture: str = "bode") -> Figure:
        """A matplotlib figure of all channels: bode, nyquist or poles; UsageError for another picture."""
        figure: Figure = facade.call("StateSpace.plot", self, picture)
        return figure

    def __repr__(self) -> str:
        return brief(self, f"{listing(list(self.inputs), 4)} to {listing(list(self.outputs), 4)}",
                     f"{count(len(self.states), 'state')}: {listing(list(self.states), 8)}")

    @property
    def proper(self) -> bool:
        """Whether no derivative of an input reaches an output directly."""
        return not self.higher.any()

    @cached_property
    def poles(self) -> Complex:
        """The eigenvalues of a in 1/s, zeros exact; of a sampled system z, without unit."""
        return self._mapped(eigenvalues(self._scaled()[0]))

    @property
    def rates(self) -> Complex:
        """The poles in 1/s; of a sampled system log(z)/T."""
        return self.poles if self.period is None else equivalent(self.poles, self.period)

    @property
    def highest(self) -> float:
        """The highest frequency in Hz of the response: the Nyquist frequency of a sampled system, else infinite."""
        return np.inf if self.period is None else (len(self.cut.times) if self.cut else 1) / (2 * self.period)

    def _mapped(self, gamma: Complex) -> Complex:
        """z of a sampled system for gamma in 1/s."""
        return gamma if self.period is None else np.asarray(1 + self.period * gamma)

    @property
    def stable(self) -> bool:
        """Whether every pole decays; free modes do not."""
        return self.stability().stable

    def stability(self) -> Stability:
        """The poles, judged: stable, marginally stable (with the free modes by name) or unstable; not decided with
        sampled relays, or samples at irregular times, in a loop."""
        return replace(stability(self.a if self.delta is None else self.delta, self.sizes, self.states, self.rigid,
                                 self.period), undecided=undecided_reasons(self.held))

    def displayed(self) -> StateSpace:
        """The same system with its outputs in display units, for tables and plots."""
        return self._displayed

    @cached_property
    def _displayed(self) -> StateSpace:
        if not self.shown or self.shown == self.units[2]:
            return self
        scale = np.array([read_unit(unit).scale for unit in self.shown])[:, None]
        exact = None
        if self.exact is not None:
            open_system = self.exact.open
            more = np.vstack([scale, np.ones((len(self.exact.delays), 1))])
            exact = replace(self.exact, open=replace(open_system, c=open_system.c / more, d=open_system.d / more,
                                                     higher=open_system.higher / more))
        return replace(self, c=self.c / scale, d=self.d / scale, higher=self.higher / scale, exact=exact,
                       units=(self.units[0], self.units[1], self.shown))

    def channel(self, output: str, input: str) -> StateSpace:
        """One output from one input."""
        i, j = self.outputs.index(output), self.inputs.index(input)
        rows, columns = slice(i, i + 1), slice(j, j + 1)
        added = inner_name(input)  # the name of an added input in the structure of held variables
        is_added = any(added in h.inputs for h in self.held)
        exact = None
        if self.exact is not None:
            open_system, n = self.exact.open, len(self.exact.delays)
            to, by = ([first, *range(len(names), len(names) + n)] for first, names in ((i, self.outputs), (j, self.inputs)))
            exact = replace(self.exact, open=replace(
                open_system, inputs=tuple(open_system.inputs[k] for k in by),
                outputs=tuple(open_system.outputs[k] for k in to), b=open_system.b[:, by], c=open_system.c[to],
                d=open_system.d[np.ix_(to, by)], higher=open_system.higher[np.ix_([0, 1], to, by)]))
        return replace(self, exact=exact, inputs=(input,), outputs=(output,), b=self.b[:, columns], c=self.c[rows],
                       d=self.d[rows, columns], higher=self.higher[:, rows, columns], shown=self.shown[i:i + 1],
                       units=(self.units[0], (self.units[1][j],), (self.units[2][i],)),
                       hybrid=None if self.hybrid is None else replace(
                           self.hybrid, f=self.hybrid.f[:, columns], s=self.hybrid.s[:, columns], c=self.hybrid.c[rows],
                           d=self.hybrid.d[rows, columns]),
                       held=tuple(replace(h, inputs=tuple(n for n in h.inputs if n == (added if is_added else input)),
                                          outputs=tuple(n for n in h.outputs if n == output)) for h in self.held))

    def response(self, s: ArrayLike) -> Complex:
        """The transfer functions (N, k, m) at complex frequencies s (N,) in 1/s: s = 2j*pi*f; at a pole their size is
        infinite and their angle not a number. A sampled system has them at z = exp(s T); a loop that is cut at several
        instants has the characteristic locus that is nearest to the signal itself."""
        points = np.atleast_1d(np.asarray(s, dtype=complex))
        if self.exact is not None:
            return self.exact.response(points)
        if self.cut is not None and len(self.cut.times) > 1:
            # the eigenvalue of the lifted loop whose vector is nearest to exp(s t) at the instants t: the response itself if
            # the loop is the same at all instants
            values, vectors = np.linalg.eig(self.lifted(points))
            signal = np.exp(points[:, None] * np.array(self.cut.times))
            near = np.argmax(np.abs(np.einsum("Ni,Nij->Nj", signal.conj(), vectors)), axis=1)
            return np.asarray(values[np.arange(len(points)), near][:, None, None])
        if self.period is not None:
            points = np.expm1(points * self.period) / self.period
        a, b, c = self._scaled()
        through = np.zeros((len(points), len(self.outputs), len(self.inputs)), complex)
        if len(a) >= LINEAR_SYSTEM.sparse and np.count_nonzero(a) <= LINEAR_SYSTEM.dense * a.size:
            through = _sparse_response(a, b, c, points)
        elif self.states:
            number = max(1, LINEAR_SYSTEM.block // a.size)
            for k in range(0, len(points), number):
                through[k:k + number] = dense_response(a, b, c, points[k:k + number])
        points = points[:, None, None]
        return np.asarray(through + self.d + points * self.higher[0] + points**2 * self.higher[1])

    def lifted(self, s: Complex) -> Complex:
        """The transfer functions (N, n, n) of a loop that is cut at n instants, between them all, at s (N,) in 1/s."""
        a, b, c = self._scaled()
        period = self.period or 1.0
        return dense_response(a, b, c, np.asarray(np.expm1(s * period) / period, dtype=complex)) + self.d

    def dc_gain(self) -> Array:
        """The gains (k, m) at zero frequency in SI, infinite if poles at 0 remain, by the poles and zeros at s = 0 (see
        `zero_frequency`)."""
        return np.array([[self._leading(i, j).gain for j in range(len(self.inputs))] for i in range(len(self.outputs))]
                        ).reshape(len(self.outputs), len(self.inputs))

    def poles_at_zero(self) -> int:
        """The largest number of integrators in series of a channel, without those that zeros cancel."""
        return max((self._leading(i, j).integrators for i in range(len(self.outputs)) for j in range(len(self.inputs))),
                   default=0)

    def _leading(self, i: int, j: int, highest: int = 0) -> Leading:
        """The first term at s = 0 of the output i from the input j."""
        a, b, c = self._scaled()
        return leading(a, b[:, j], c[i], np.array([self.d[i, j], *self.higher[:, i, j]]), highest)

    def zeros(self) -> Complex:
        """The transmission zeros of one channel: where det [[a - s, b], [c, d + s higher]] is 0, or that with z.

        UsageError for several channels, or where the second derivative of the input reaches the output.
        """
        return self._zeros

    @cached_property
    def _zeros(self) -> Complex:
        from scipy.linalg import eigvals

        if len(self.outputs) != 1 or len(self.inputs) != 1 or self.higher[1].any():
            raise UsageError([Problem("zeros-of-one", "zeros are found for one input and one output, which the input's "
                                      "acceleration does not reach directly")])
        a, b, c = self._scaled()
        poles = eigenvalues(a)
        largest = max(float(np.abs(poles).max(initial=0.0)), 1.0)
        # the borders of the pencil in s / largest with sizes near one; its finite eigenvalues stay
        input_size = float(np.abs(b).max(initial=0.0)) / largest or 1.0
        output_size = float(np.abs(c).max(initial=0.0)) or 1.0
        b, c, border = b / largest / input_size, c / output_size, input_size * output_size
        d, higher = self.d / border, self.higher[0] * largest / border
        pencil = np.block([[a / largest, b], [c, d]])
        mass = np.block([[np.eye(len(a)), np.zeros_like(b)], [np.zeros_like(c), -higher]])
        top, bottom = eigvals(pencil, mass, homogeneous_eigvals=True)
        finite = np.abs(top) < LINEAR_SYSTEM.infinite * np.abs(bottom)
        zeros = np.asarray(largest * top[finite] / bottom[finite], dtype=complex)
        power = self._leading(0, 0, len(self.states) + 1).power
        return self._mapped(zeros if power is None else with_zeros_at_zero(zeros, power + int(np.count_nonzero(poles == 0))))

    def step(self, time: Array) -> Array:
        """The outputs (N, k, m) after a unit step of an input, at equally spaced times (N,) from 0 on, without an impulse at
        0 from derivatives of the step. A sampled system has the values of its last instant. A sampled system has the values
        of its last instant."""
        from scipy.linalg import expm

        if self.period is not None:
            last = np.floor(np.asarray(time) / self.period + 1e-9).astype(int)
            states, values = np.zeros(self.b.shape), list[Array]()
            for _ in range(int(last.max(initial=0)) + 1):
                values.append(self.c @ states + self.d)
                states = self.a @ states + self.b
            return np.asarray(np.array(values)[last], dtype=float)
        a, b, c = self._scaled()
        n, m = b.shape
        whole = expm(np.block([[a, b], [np.zeros((m, n + m))]]) * (time[1] - time[0]))
        state, response = np.vstack([np.zeros((n, m)), np.eye(m)]), np.zeros((len(time), len(self.outputs), m))
        for k in range(len(time)):
            response[k] = c @ state[:n] + self.d
            state = whole @ state
        return response

    def visible(self) -> Complex:
        """The poles that the first input moves and the first output shows, by more than `LINEAR_SYSTEM.visible` of the
        strongest."""
        a, b, c = self._scaled()
        values, right = np.linalg.eig(a)
        residues = np.abs((c[0] @ right) * np.linalg.lstsq(right, b[:, 0].astype(complex), rcond=None)[0])
        values = with_zeros(values.astype(complex), a)
        moving = values != 0  # integrators have no frequency of their own
        values = values if self.period is None else equivalent(self._mapped(values), self.period)
        values, residues = values[moving], residues[moving]
        weights = residues / np.maximum(np.abs(values.real), 1e-2 * np.abs(values))
        return np.asarray(values[weights >= LINEAR_SYSTEM.visible * weights.max(initial=0.0)], dtype=complex)

    def unbounded(self) -> Array:
        """The frequencies in Hz (N,), rising, of the undamped modes that the first input moves and the first output
        shows: the response is infinite there."""
        strengths = np.abs(self.visible())
        sizes = np.array([abs(e.value) for e in self.stability().undamped if e.value.imag > 0])
        return np.array(sorted(size for size in sizes if np.any(np.abs(strengths - size) <= LINEAR_SYSTEM.undamped * size))
                        ) / (2 * np.pi)

    def frequencies(self) -> Array:
        """Frequencies in Hz (N,) from a decade below the slowest visible pole to a decade above the fastest, denser where
        poles are near the axis; of a sampled system up to its Nyquist frequency."""
        frequencies = spread(self.visible(), self.rates)
        if self.period is None:
            return frequencies
        low = min(float(frequencies[0]), self.highest / 100)
        every = np.concatenate([np.geomspace(low, self.highest, LINEAR_SYSTEM.points), frequencies])
        return np.unique(every[every <= self.highest])

    def to_control(self) -> Any:
        """The same as a `control.StateSpace`, of a sampled system with its `dt`, dots in names as underscores
        (python-control allows none), with an attribute `held` that names the variables that are constant in it; UsageError
        if python-control is not installed or the system is not proper."""
        self._check_proper()
        try:
            import control
        except ImportError:
            raise UsageError("this needs python-control", hint="pip install control") from None
        sampled = {} if self.period is None else {"dt": self.period}
        system = control.ss(self.a, self.b, self.c, self.d, **sampled, **{
            kind: [name.replace(".", "_") for name in labels]
            for kind, labels in (("states", self.states), ("inputs", self.inputs), ("outputs", self.outputs))})
        system.held = tuple(h.text for h in self.held)
        return system

    def to_scipy(self) -> Any:
        """The same as a `scipy.signal.StateSpace`, of a sampled system with its `dt`; UsageError if the system is not
        proper."""
        from scipy.signal import StateSpace as Scipy

        self._check_proper()
        return Scipy(self.a, self.b, self.c, self.d, **({} if self.period is None else {"dt": self.period}))

    def as_dict(self) -> dict[str, object]:
        """Matrices with names and units, for machines."""
        states, inputs, outputs = self.units
        return {"states": [{"name": n, "unit": u} for n, u in zip(self.states, states, strict=True)],
                "inputs": [{"name": n, "unit": u} for n, u in zip(self.inputs, inputs, strict=True)],
                "outputs": [{"name": n, "unit": u} for n, u in zip(self.outputs, outputs, strict=True)],
                "held": [h.as_dict() for h in self.held], "T": self.period,
                "sampled": [h.as_dict() for h in self.sampled],
                "A": self.a.tolist(), "B": self.b.tolist(), "C": self.c.tolist(), "D": self.d.tolist(),
                "D1": self.higher[0].tolist(), "D2": self.higher[1].tolist()}

    def _check_proper(self) -> None:
        if not self.proper:
            i, j = np.argwhere(self.higher.any(axis=0))[0]
            raise UsageError([Problem("not-proper", f"'{self.outputs[i]}' follows the derivative of '{self.inputs[j]}': its "
                                      "transfer function has no state space", None,
                                      "Take another output, or put a FirstOrderLag before the input.")])

    def _scaled(self) -> tuple[Array, Array, Array]:
        """a, b, c for states counted in their usual sizes; of a sampled system delta, b/T and c."""
        sizes = self.sizes
        if self.delta is not None and self.period is not None:
            return self.delta * sizes / sizes[:, None], self.b / sizes[:, None] / self.period, self.c * sizes
        return self.a * sizes / sizes[:, None], self.b / sizes[:, None], self.c * sizes


def state_space(model: ModelOrFile, inputs: Sequence[str], outputs: Sequence[str], *, at: Time | None = None,
                parameters: Mapping[str, float | str] | None = None) -> StateSpace:
    """A diagram linearised between inputs and outputs: x' = A x + B w, y = C x + D w.

    Derivatives are exact, with index reduction and algebraic loops. A (n, n), B (n, m), C (k, n) and D (k, m) are in SI for
    m `inputs` and k `outputs`. An input is a signal, the through variable of a node (`crown.f`: an external force) or a
    parameter; an output is a variable, an output of the diagram or a formula of these. `at` is the operating point of
    `model`: None for the start, `"steady"`, or a time (s, or text with a unit) to which the diagram is simulated;
    `parameters` overrides values by name. Raises UsageError for unknown names, StartError and SimulationError if there is no
    operating point.

    With samples at regular times in a loop, or between `inputs` and `outputs`, the machine is discretised exactly, with
    inputs that are constant over the period T (`period`, in s): x[k+1] = A x[k] + B w[k], y[k] = C x[k] + D w[k].
    """
    return StateSpaces(model, inputs, outputs, at).at(parameters)


class StateSpaces:
    """A diagram between inputs and outputs, compiled once, linearised for any parameters."""

    def __init__(self, model: ModelOrFile, inputs: Sequence[str], outputs: Sequence[str], at: Time | None = None, *,
                 approximate: bool = True):
        """Without `approximate` delayed variables are constant, as parameters `history.NAME`."""
        self.inputs, self.outputs = tuple(dict.fromkeys(inputs)), tuple(dict.fromkeys(outputs))
        model = loaded(model)
        # the names in formulas; formulas with syntax errors are reported later
        also = set[str]()
        for text in self.outputs:
            try:
                also |= {name.text for name in names(model.library.formula(text))}
            except ExpressionProblem:
                continue
        plain = OperatingPoints(model, at, also=also, approximate=approximate)
        self.approximated = plain.assembly.flat.expanded.approximated
        self._exact: StateSpaces | None = None
        if self.approximated:
            # the same system with the delayed variables among its inputs and their sources among its outputs
            flat = flatten(replace(model, ends=None))
            sources = []
            for d in flat.delays:
                path, _, name = d.name.rpartition(".")
                sources.append(f"({path}.{flat.expanded.leaves[path].component.delayed[name].of})")
            self._exact = StateSpaces(model, [*self.inputs, *(f"history.{d.name}" for d in flat.delays)],
                                      [*self.outputs, *sources], at, approximate=False)
        known = plain.assembly.parameter_names
        self._added = [name for name in self.inputs if name not in known]
        self._given = [name for name in self.inputs if name in known]
        self.points, self.filled = plain, plain.filled
        if self._added:
            self.points = OperatingPoints(plain.assembly.model, at, disturbances=self._added, also=also,
                                          approximate=approximate)
        self._linearisation = Linearisation(self.points.assembly, self._given, self.outputs,
                                            [inner_name(name) for name in self._added])
        self._units = _units(self.points.assembly, self.inputs, self.outputs)
        show = model.show
        self._shown = tuple(show[name].unit if name in show else unit
                            for name, unit in zip(self.outputs, self._units[2], strict=True))

    def at(self, parameters: Mapping[str, float | str] | None = None, point: Point | None = None) -> StateSpace:
        """The linear system with these parameters set, at the operating point of the diagram with them or at the states of
        another `point`."""
        fixed = point is not None
        point = self.points.at(parameters) if point is None else self.points.changed(point, parameters or {})
        linear, updates = self._linearisation.continuous(point)
        sampled = 2 * updates.number if updates is not None else 0
        n, k, delayed = len(linear.states), len(linear.c), len(self._given)
        m = len(self.inputs)
        b, d = np.zeros((4, n, m + sampled)), np.zeros((4, k, m + sampled))
        if sampled:
            b[0, :, m:], d[0, :, m:] = linear.b[:, -sampled:], linear.d[:, -sampled:]
        for j, name in enumerate(self.inputs):
            if name in self._given:
                column = self._given.index(name)
                b[0, :, j], d[0, :, j] = linear.b[:, column], linear.d[:, column]
            else:
                first = delayed + 4 * self._added.index(name)
                b[:, :, j], d[:, :, j] = linear.b[:, first:first + 4].T, linear.d[:, first:first + 4].T
        through = np.asarray(b[1:].any(axis=0))
        # b (n, m) and d (4, k, m) after the derivatives of the inputs have been absorbed by the states
        size_b, size_d = np.abs(b), np.abs(d)
        for k in (3, 2, 1):
            b[k - 1] += linear.a @ b[k]
            d[k - 1] += linear.c @ b[k]
            size_b[k - 1] += np.abs(linear.a) @ size_b[k]
            size_d[k - 1] += np.abs(linear.c) @ size_b[k]
        b_0 = np.where(np.abs(b[0]) > LINEAR_SYSTEM.rounding * size_b[0], b[0], 0.0)
        d_all = np.where(np.abs(d) > LINEAR_SYSTEM.rounding * size_d, d, 0.0)
        if updates is None:
            exact = None
            if self._exact is not None:
                around = self._exact.at(parameters, self._exact.points.at() if fixed else None)
                flat = self._exact.points.assembly.flat
                exact = DelayedSystem(around, np.array(flat.delay_lengths(around.point.p)).ravel()[:len(flat.delays)])
            return StateSpace(linear.states, self.inputs, self.outputs, self._units, linear.a, b_0, linear.c, d_all[0],
                              d_all[1:3], linear.sizes, point, self._shown, linear.rigid, linear.held, exact)
        improper = np.flatnonzero(d_all[1:].any(axis=(0, 1)) | through[[t for t in updates.target if t < n]].any(axis=0))
        if len(improper):
            name = self.inputs[int(improper[0])]
            raise UsageError([Problem("sampled-derivative", f"the input '{name}' is constant between samples, and its "
                                      "derivative, an impulse at each sample, reaches an output or a sampled block", None,
                                      "Take another input or output, or put a FirstOrderLag before the input.")])
        system = updates.hybrid(point, linear.states, linear.sizes, linear.rigid, linear.a, b_0, linear.c, d_all[0])
        discrete = discretised(system)
        units = dict(zip(linear.states, self._units[0], strict=True)) | {h.name: h.unit for h in updates.held}
        return StateSpace(discrete.names, self.inputs, self.outputs,
                          (tuple(units[name] for name in discrete.names), *self._units[1:]), discrete.a, discrete.b,
                          discrete.c, discrete.d,
                          np.zeros((2, *discrete.d.shape)), discrete.sizes, point, self._shown, discrete.rigid, linear.held,
                          period=discrete.period, delta=discrete.delta, sampled=linear.sampled, hybrid=system)


def dense_response(a: Array, b: Array, c: Array, points: Complex) -> Complex:
    """c (s - a)^-1 b (N, k, m) at points s (N,); `AT_A_POLE` at a pole."""
    try:
        return np.asarray(c @ np.linalg.solve(points[:, None, None] * np.eye(len(a)) - a,
                                              np.broadcast_to(b, (len(points), *b.shape))))
    except np.linalg.LinAlgError:
        if len(points) == 1:
            return np.full((1, len(c), b.shape[1]), AT_A_POLE)
        return np.concatenate([dense_response(a, b, c, points[k:k + 1]) for k in range(len(points))])


def _sparse_response(a: Array, b: Array, c: Array, points: Complex) -> Complex:
    """c (s - a)^-1 b (N, k, m) at points s (N,), by sparse factors."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    diagonal = a.diagonal()
    rows, columns = np.nonzero((a != 0) | np.eye(len(a), dtype=bool))
    off = np.where(rows == columns, 0.0, -a[rows, columns])
    order = np.lexsort((rows, columns))  # that of the columns
    rows, columns, off = rows[order], columns[order], off[order]
    on = np.flatnonzero(rows == columns)
    ends = np.searchsorted(columns, np.arange(len(a) + 1))
    response = np.empty((len(points), len(c), b.shape[1]), complex)
    values, sides = off.astype(complex), b.astype(complex)
    for k, s in enumerate(points):
        values[on] = s - diagonal
        try:
            response[k] = c @ splu(csc_array((values, rows, ends), a.shape)).solve(sides)
        except RuntimeError:
            response[k] = AT_A_POLE
    return response


def spread(poles: Complex, all_poles: Complex) -> Array:
    """Frequencies in Hz (N,) around the poles (1/s) of a channel, with points close to every resonance."""
    sizes = np.abs(poles)
    sizes = sizes[sizes > LINEAR_SYSTEM.free * sizes.max(initial=0.0)] if sizes.any() else np.array([2 * np.pi])
    low, high = 0.1 * float(sizes.min()), 10 * float(sizes.max())
    plain = np.geomspace(low, high, LINEAR_SYSTEM.points)
    resonances = [pole for pole in all_poles if pole.imag > 0 and abs(pole.real) < 0.3 * abs(pole)]
    number = min(LINEAR_SYSTEM.near, max(5, LINEAR_SYSTEM.most_near // max(len(resonances), 1))) | 1
    near = []
    for pole in resonances:
        width = max(-pole.real, LINEAR_SYSTEM.undamped * abs(pole))
        # an even number of points has none on the pole itself, where the response of an undamped one is infinite
        near.append(pole.imag + width * np.linspace(-8, 8, number + (width > -pole.real)))
    points = np.concatenate([plain, *near])
    return np.asarray(np.unique(points[(points >= low) & (points <= high)]) / (2 * np.pi))


def _units(assembly: Assembly, inputs: Sequence[str], outputs: Sequence[str]
           ) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    flat = assembly.flat
    states = tuple(flat.unknowns[j].unit.text + "/s" * order for j, order in assembly.reduced.states)
    units = {q.name: q.unit.text for q in flat.parameters} | {k.name: k.unit.text for k in flat.inputs}
    return (states, tuple(units.get(inner_name(name), units.get(name, "")) for name in inputs),
            tuple(_unit(assembly, name) for name in outputs))


def _unit(assembly: Assembly, name: str) -> str:
    output = assembly.model.show.get(name)
    try:
        formula = assembly.model.library.formula(name) if output is None else output.expr
        return dimension_text(assembly.resolver().dimension(formula) or ())
    except ExpressionProblem as problem:
        raise unknown_signal(assembly, name, problem) from None
