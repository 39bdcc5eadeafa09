"""Linearisation about a state, and modes with exact derivatives of their eigenvalues.

With x' = f(x, z, p, w), 0 = g(x, z, p, w) and outputs y = h(x, z, p, w), the algebraic unknowns are eliminated:

    A = f_x - f_z g_z^-1 g_x,   B = f_w - f_z g_z^-1 g_w,   C = h_x - h_z g_z^-1 g_x,   D = h_w - h_z g_z^-1 g_w.

A mode is an eigenvalue s of A with right and left vectors, A v = s v and l^H A = s l^H. For a change dA of the machine,
ds = l^H dA v / l^H v. The participation of the state k in it is |l_k v_k| / sum |l_i v_i|, which does not depend on units.
G. C. Verghese, I. J. Perez-Arriaga, F. C. Schweppe, Selective modal analysis, 1982, doi:10.1109/TPAS.1982.317524.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, UsageError
from heavebond.equations.buffered import Buffered
from heavebond.language.symbols import stack
from heavebond.linear.held_variables import HeldStructure, HeldVariable, StartEvents, undecided_reasons
from heavebond.linear.sampled import Discrete, SampledUpdates, discretised, equivalent
from heavebond.linear.stability import Stability, eigenvalues, real_within_rounding, stability, with_zeros
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.initialise import Start, start, tangent
from heavebond.numerics.inputs import pieced
from heavebond.numerics.output_times import grid
from heavebond.numerics.result import signal_expression
from heavebond.numerics.sparse_jacobian import jacobian
from heavebond.numerics.start_equations import Point, StartEquations

# Vectors l, v of unit length with a smaller product belong to a multiple eigenvalue, which has no derivative.
DEFECTIVE = 1e-12
# Share of a parameter by which it is moved for the difference of an eigenvalue: the cube root of rounding.
DIFFERENCE = 1e-5


@dataclass(frozen=True)
class Mode:
    """An eigenvalue (1/s), of a pair the one with an imaginary part >= 0, and the vectors of the scaled states (n_x,),
    with l^H v = 1 where that can be. In a sampled system `z` is the eigenvalue of its monodromy matrix, and the value
    log(z)/T."""

    value: complex
    right: NDArray[np.complex128]
    left: NDArray[np.complex128]
    states: tuple[str, ...]
    z: complex | None = None

    @property
    def frequency(self) -> float:
        """|s| / 2 pi in Hz, the frequency without damping."""
        return float(abs(self.value) / (2 * np.pi))

    @property
    def damping(self) -> float:
        """-Re(s) / |s|: 0 at the stability boundary, 1 for a mode that does not oscillate, below 0 for a growing mode, NaN
        for a free mode."""
        return float(-self.value.real / abs(self.value)) if self.value else float("nan")

    @property
    def swings(self) -> bool:
        """True for a mode of a complex pair."""
        return bool(self.value.imag > 0)

    @property
    def participation(self) -> dict[str, float]:
        """The share of each state, the largest first."""
        shares = np.abs(self.left * self.right)
        shares = shares / max(float(shares.sum()), 1e-300)
        return {self.states[k]: float(shares[k]) for k in np.argsort(-shares, kind="stable")}


@dataclass(frozen=True)
class Linear:
    """a (n_x, n_x), b (n_x, m), c (k, n_x), d (k, m) in SI; `sizes` (n_x,) are the nominal values of the states, `rigid`
    marks states that are positions and speeds of bodies, `held` are the variables that are constant in it. With a `period`
    in s it is x[k+1] = a x[k] + b w[k], with delta = (a - 1)/period; `sampled` are the variables that samples set."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    a: Array
    b: Array
    c: Array
    d: Array
    sizes: Array
    rigid: tuple[bool, ...] = ()
    held: tuple[HeldVariable, ...] = ()
    period: float | None = None
    delta: Array | None = None
    sampled: tuple[HeldVariable, ...] = ()

    def discrete(self, system: Discrete, inputs: Sequence[str], outputs: Sequence[str]) -> Linear:
        """The same, discretised."""
        return replace(self, states=system.names, inputs=tuple(inputs), outputs=tuple(outputs), a=system.a, b=system.b,
                       c=system.c, d=system.d, sizes=system.sizes, rigid=system.rigid, period=system.period,
                       delta=system.delta)

    @property
    def generator(self) -> Array:
        """The matrix (n_x, n_x) in 1/s that is zero on free modes: a, or delta of a sampled system."""
        return self.a if self.delta is None else self.delta

    def poles(self) -> NDArray[np.complex128]:
        """The eigenvalues (n_x,) in 1/s, zeros exact; of a sampled system log(z)/T."""
        poles = eigenvalues(self.generator * self.sizes / self.sizes[:, None])
        return poles if self.period is None else equivalent(1 + self.period * poles, self.period)

    def stability(self) -> Stability:
        """The eigenvalues, judged: stable, marginally stable (with the free modes by name) or unstable; not decided with
        sampled relays, or samples at irregular times, in a loop."""
        return replace(stability(self.generator, self.sizes, self.states, self.rigid, self.period),
                       undecided=undecided_reasons(self.held))

    def modes(self) -> list[Mode]:
        """The modes, the slowest first; eigenvalues that are zero but for rounding are 0."""
        if not self.states:
            return []
        scaled = self.generator * self.sizes / self.sizes[:, None]
        values, right = np.linalg.eig(scaled)
        try:
            left = np.linalg.inv(right).conj().T
        except np.linalg.LinAlgError:  # a multiple eigenvalue without as many vectors
            left = np.linalg.pinv(right).conj().T
        values = with_zeros(real_within_rounding(values, right, left, scaled), scaled)
        poles = None if self.period is None else 1 + self.period * values
        rates = values if self.period is None else equivalent(1 + self.period * values, self.period)
        modes = [Mode(complex(rates[k]), right[:, k], left[:, k], self.states, None if poles is None else complex(poles[k]))
                 for k in range(len(values)) if values[k].imag >= 0]
        return sorted(modes, key=lambda mode: (abs(mode.value), mode.value.real))


class Linearisation:
    """The Jacobians of an assembly, differentiated once: inputs are names of parameters, outputs are signals in SI.

    `driven` are names of measured inputs: each gives four columns after the columns of the parameters, for the input and its
    first three derivatives; they are valid at points whose pieces begin at their time (see `operating_point`). UsageError
    for an unknown name.
    """

    def __init__(self, assembly: Assembly, inputs: Sequence[str] = (), outputs: Sequence[str] = (),
                 driven: Sequence[str] = ()):
        assembly.parameter_indices(inputs)  # UsageError for a name that cannot be set
        _, x, z, p, u, _ = assembly.arguments
        known = [k.name for k in assembly.flat.inputs]
        self.assembly, self.outputs = assembly, tuple(outputs)
        self.inputs = (*inputs, *(f"der{k}({name})" for name in driven for k in range(4)))
        w = stack([*(p[assembly.parameter_names.index(name)] for name in inputs),
                   *(u[1 + 4 * known.index(name) + k] for name in driven for k in range(4))])
        # a piece is c0 + c1 s + c2 s**2 + c3 s**3: its k-th derivative at s = 0 is k! c_k
        self._per = np.array([*(1.0 for _ in inputs), *([1.0, 1.0, 0.5, 1 / 6] * len(driven))])
        self._sides = (assembly.ode, assembly.alg, stack([_in_si(assembly, name) for name in outputs]))
        self._inner, self._outer = (x, z), w
        self._by_name: dict[tuple[str | bool, ...], SampledUpdates] = {}
        self._sampled: dict[SampledUpdates, ca.Function] = {}
        self._given = {name: assembly.parameter_names.index(name) for name in inputs}
        self._driven = {name: [1 + 4 * known.index(name) + k for k in range(4)] for name in driven}

    @cached_property
    def _jacobians(self) -> ca.Function:
        return ca.Function("jacobians", list(self.assembly.arguments), [
            ca.jacobian(side, by) for side in self._sides for by in (*self._inner, self._outer)])

    def sparse(self, point: Point) -> Any:
        """[[f_x, f_z], [g_x, g_z]] near a point, in SI, a `scipy.sparse.csc_array`."""
        from scipy.sparse import csc_array

        f, g, _ = self._sides
        function = ca.Function("jacobian", list(self.assembly.arguments), [jacobian(stack([f, g]), stack([*self._inner]))])
        values, = Buffered(function, sparse=True)(*point.values()).values()
        return csc_array(values)

    @cached_property
    def _held(self) -> HeldStructure | None:
        if not (self.assembly.flat.held or self.assembly.flat.events):
            return None
        return HeldStructure(self.assembly, self._given, self._driven, self.outputs, self._sides[2])

    def held(self, point: Point) -> tuple[HeldVariable, ...]:
        """The held variables near a point, those that make the stability undecided first, with those that samples set in the
        linear system (`exact`)."""
        return self._held.at(point) if self._held is not None else ()

    def at(self, point: Point) -> Linear:
        """The linear system near a point, discretised if it has samples in a loop or between inputs and outputs; UsageError
        where an algebraic loop is singular there."""
        linear, updates = self.continuous(point)
        if updates is None:
            return linear
        system = updates.hybrid(point, linear.states, linear.sizes, linear.rigid, linear.a, linear.b, linear.c, linear.d)
        return linear.discrete(discretised(system), self.inputs, self.outputs)

    def continuous(self, point: Point) -> tuple[Linear, SampledUpdates | None]:
        """The linear system between events near a point. With samples, the variables that samples set, before and after an
        instant, are additional inputs, and their new values additional outputs."""
        held = self.held(point)
        updates = self._updates(tuple(h for h in held if h.exact), point.p)
        jacobians, per = self._jacobians, self._per
        if updates is not None:
            jacobians, per = self._sampled[updates], np.append(per, np.ones(2 * updates.number))
        after = () if updates is None else (point.p[updates.indices],)
        f_x, f_z, f_w, g_x, g_z, g_w, h_x, h_z, h_w = (np.array(j.full()) for j in jacobians(*point.values(), *after))
        f_w, g_w, h_w = (j * per for j in (f_w, g_w, h_w))
        if len(point.z):
            by_x, by_w = _solved(g_z, g_x), _solved(g_z, g_w)
            f_x, f_w, h_x, h_w = f_x - f_z @ by_x, f_w - f_z @ by_w, h_x - h_z @ by_x, h_w - h_z @ by_w
        assembly = self.assembly
        unknowns = (assembly.flat.unknowns[j] for j, _ in assembly.reduced.states)
        return Linear(tuple(assembly.state_names), self.inputs, self.outputs, f_x, f_w, h_x, h_w, assembly.x_nominal,
                      tuple(u.role == "position" or u.motion for u in unknowns), tuple(h for h in held if not h.exact),
                      sampled=() if updates is None else updates.sampled(point)), updates

    def updates(self, point: Point) -> SampledUpdates | None:
        """The samples that the linear system near a point contains; None without any."""
        return self._updates(tuple(h for h in self.held(point) if h.exact), point.p)

    def _updates(self, exact: tuple[HeldVariable, ...], p: Array) -> SampledUpdates | None:
        if not exact or self._held is None:
            return None
        key = (*(h.name for h in exact), *(p[self.assembly.update_order.zeros] == 0).tolist())
        if key not in self._by_name:
            updates = SampledUpdates(self._held, exact, p)
            sides = (*self._sides[:2], stack([self._sides[2], updates.values]))
            outer = stack([self._outer, updates.symbols, updates.after])
            self._by_name[key] = updates
            self._sampled[updates] = ca.Function("jacobians", [*self.assembly.arguments, updates.after], [
                ca.jacobian(side, by) for side in sides for by in (*self._inner, outer)])
        return self._by_name[key]


def _in_si(assembly: Assembly, name: str) -> ca.SX:
    """A signal in SI: the formula of an output of the diagram, whatever its unit there, or any other."""
    output = assembly.model.show.get(name)
    return signal_expression(assembly, name) if output is None else assembly.expression(output.expr)


def _solved(g_z: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(g_z, right), dtype=float)
    except np.linalg.LinAlgError:
        raise UsageError([Problem("loop-singular", "an algebraic loop is singular here, so that its unknowns are "
                                  "undetermined",
                                  None, "Linearise at another state.")]) from None


def without_history(assembly: Assembly) -> Assembly:
    """The diagram with approximations in place of its delayed variables, and the parameters of the assembly."""
    if not assembly.flat.delays:
        return assembly
    approximated = assemble(replace(assembly.model, approximate=True))
    known = set(approximated.parameter_names)
    return approximated.with_parameters({name: value for name, value in assembly.parameter_values.items() if name in known})


def start_point(first: Start, u: Array) -> Point:
    """The point at which a run begins."""
    return Point(first.t, first.x, first.z, first.p, u, 1.0)


class ModesAtStart:
    """The modes of an assembly at its start, and the derivatives of their eigenvalues by parameters."""

    def __init__(self, assembly: Assembly):
        self.assembly = assembly = without_history(assembly)
        # the pieces of the measured inputs at the start
        if not assembly.flat.inputs:
            self.u = np.zeros(0)
        else:
            times = grid(assembly.model, None, None)
            self.u = pieced(assembly.flat, float(times[0]), float(times[-1])).at(times[:1])[:, 0]
        self.linearisation = Linearisation(assembly)
        self.equations = StartEquations(assembly)
        self._events = StartEvents(assembly)

    def at(self, settings: Mapping[str, float | str]) -> tuple[Start, list[Mode]]:
        """The start and the modes with these parameters set; StartError if there is no start."""
        first = self.start(settings)
        return first, self.linearisation.at(self.point(first)).modes()

    def point(self, first: Start) -> Point:
        """The point after the events at the instant of a start, which is linearised."""
        return self._events.after(start_point(first, self.u))

    def constant(self, first: Start) -> tuple[HeldVariable, ...]:
        """The variables that are constant in the linear system at a start."""
        return tuple(h for h in self.linearisation.held(self.point(first)) if not h.exact)

    def start(self, settings: Mapping[str, float | str]) -> Start:
        """The start with these parameters set; StartError if there is none."""
        return start(self.assembly.with_parameters(settings) if settings else self.assembly, None, self.u, self.equations)

    def slope(self, first: Start, mode: Mode, names: Sequence[str], at: Point | None = None) -> NDArray[np.complex128]:
        """d s / d p (m,) for named parameters, including the change of the start; zero for a multiple eigenvalue. `at` is
        the linearised point, if its parameters differ from the parameters of the start. A sampled system has central
        differences."""
        if mode.z is not None:
            return self._differences(first, mode, names, at or self.point(first))
        assembly, n_x = self.assembly, len(first.x)
        at = at or self.point(first)
        product = np.vdot(mode.left, mode.right)
        if abs(product) < DEFECTIVE or not names:
            return np.zeros(len(names), dtype=complex)
        directions = np.zeros((len(first.p), len(names)))
        for column, name in enumerate(names):
            directions[assembly.parameter_names.index(name), column] = 1.0
        start_tangent = tangent(self.equations, first, self.u, directions)
        v, left = mode.right * assembly.x_nominal, (mode.left / np.conj(product)) / assembly.x_nominal
        if len(first.z):  # the vectors of the whole system: f and g by x and z
            f_z, g_x, g_z = (np.array(j.full()) for j in self._loops(*at.values()))
            v, left = np.append(v, -np.linalg.solve(g_z, g_x @ v)), np.append(left, -np.linalg.solve(g_z.T, f_z.T @ left))
        slopes = [np.array(s.full()) for s in self._slopes(*at.values(), v.real, v.imag, left.real, left.imag)]
        by = np.vstack([start_tangent.x, start_tangent.z, start_tangent.p])
        assert by.shape[0] == slopes[0].size and n_x <= slopes[0].size
        return np.asarray((slopes[0] @ by + 1j * (slopes[1] @ by)).ravel())

    def _differences(self, first: Start, mode: Mode, names: Sequence[str], at: Point) -> NDArray[np.complex128]:
        """d s / d p (m,) of a sampled system by differences of the eigenvalue nearest in z."""
        assembly, slopes = self.assembly, np.zeros(len(names), dtype=complex)
        begin = self.point(first).p  # what differs from it at the point differs at the points beside it
        for k, name in enumerate(names):
            index = assembly.parameter_names.index(name)
            step = DIFFERENCE * (abs(first.p[index]) or 1.0)
            sides = []
            for value in (first.p[index] - step, first.p[index] + step):
                p = first.p.copy()
                p[index] = value
                point = self.point(start(replace(assembly, p=p), None, self.u, self.equations))
                changed = (at.p != begin) & (np.arange(len(p)) != index)
                point = replace(point, p=np.where(changed, at.p, point.p))
                near = min(self.linearisation.at(point).modes(), key=lambda m: abs((m.z or 0) - (mode.z or 0)))
                sides.append(near.value)
            slopes[k] = (sides[1] - sides[0]) / (2 * step)
        return slopes

    @cached_property
    def _loops(self) -> ca.Function:
        assembly = self.assembly
        _, x, z, _, _, _ = assembly.arguments
        return ca.Function("loops", list(assembly.arguments), [
            ca.jacobian(assembly.ode, z), ca.jacobian(assembly.alg, x), ca.jacobian(assembly.alg, z)])

    @cached_property
    def _slopes(self) -> ca.Function:
        """Real and imaginary part of l^H J v, by (x, z, p), where J holds the derivatives of f and g by x and z."""
        assembly = self.assembly
        t, x, z, p, u, rate = assembly.arguments
        inner, sides = stack([x, z]), stack([assembly.ode, assembly.alg])
        v, w, a, b = (ca.SX.sym("v", inner.numel()) for _ in range(4))
        j_v, j_w = ca.jtimes(sides, inner, v), ca.jtimes(sides, inner, w)
        real, imaginary = ca.dot(a, j_v) + ca.dot(b, j_w), ca.dot(a, j_w) - ca.dot(b, j_v)
        by = stack([x, z, p])
        return ca.Function("slopes", [t, x, z, p, u, rate, v, w, a, b],
                           [ca.densify(ca.gradient(part, by)).T for part in (real, imaginary)])
