"""Linearisation about a state, and modes with exact derivatives of their eigenvalues.

With x' = f(x, z, p, w), 0 = g(x, z, p, w) and outputs y = h(x, z, p, w), the algebraic unknowns are eliminated:

    A = f_x - f_z g_z^-1 g_x,   B = f_w - f_z g_z^-1 g_w,   C = h_x - h_z g_z^-1 g_x,   D = h_w - h_z g_z^-1 g_w.

A mode is an eigenvalue s of A with right and left vectors, A v = s v and l^H A = s l^H. While the machine changes,
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
from heavebond.linear.stability import Stability, real_within_rounding, stability, with_zeros
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.initialise import Start, start, tangent
from heavebond.numerics.inputs import pieced
from heavebond.numerics.output_times import grid
from heavebond.numerics.result import signal_expression
from heavebond.numerics.sparse_jacobian import jacobian
from heavebond.numerics.start_equations import Point, StartEquations

# Vectors l, v of unit length with a smaller product belong to a multiple eigenvalue, which has no derivative.
DEFECTIVE = 1e-12


@dataclass(frozen=True)
class Mode:
    """An eigenvalue (1/s), of a pair the one with an imaginary part >= 0, and the vectors of the scaled states (n_x,),
    with l^H v = 1 where that can be."""

    value: complex
    right: NDArray[np.complex128]
    left: NDArray[np.complex128]
    states: tuple[str, ...]

    @property
    def frequency(self) -> float:
        """|s| / 2 pi in Hz, the frequency without damping."""
        return float(abs(self.value) / (2 * np.pi))

    @property
    def damping(self) -> float:
        """-Re(s) / |s|: 0 at the stability boundary, 1 where nothing swings, below 0 where the mode grows, not a number for
        a free mode."""
        return float(-self.value.real / abs(self.value)) if self.value else float("nan")

    @property
    def swings(self) -> bool:
        """Whether it belongs to a pair."""
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
    tells which of them are positions and speeds of bodies, `held` are the variables that are constant in it."""

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

    def stability(self) -> Stability:
        """The eigenvalues, judged: stable, marginally stable (with the free modes by name) or unstable; not decided with
        samples in a loop."""
        return replace(stability(self.a, self.sizes, self.states, self.rigid), undecided=undecided_reasons(self.held))

    def modes(self) -> list[Mode]:
        """The modes, the slowest first; eigenvalues that are zero but for rounding are 0."""
        if not self.states:
            return []
        scaled = self.a * self.sizes / self.sizes[:, None]
        values, right = np.linalg.eig(scaled)
        try:
            left = np.linalg.inv(right).conj().T
        except np.linalg.LinAlgError:  # a multiple eigenvalue without as many vectors
            left = np.linalg.pinv(right).conj().T
        values = with_zeros(real_within_rounding(values, right, left, scaled), scaled)
        found = [Mode(complex(values[k]), right[:, k], left[:, k], self.states)
                 for k in range(len(values)) if values[k].imag >= 0]
        return sorted(found, key=lambda mode: (abs(mode.value), mode.value.real))


class Linearisation:
    """The Jacobians of an assembly, differentiated once: inputs are names of parameters, outputs are signals in SI.

    `driven` are names of measured inputs: each gives four columns after those of the parameters, for the input and its first
    three derivatives; they are right at points whose pieces begin at their time (see `operating_point`). UsageError for
    a name that is not there.
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
        found, = Buffered(function, sparse=True)(*point.values()).values()
        return csc_array(found)

    @cached_property
    def _held(self) -> HeldStructure | None:
        if not (self.assembly.flat.held or self.assembly.flat.events):
            return None
        return HeldStructure(self.assembly, self._given, self._driven, self.outputs, self._sides[2])

    def held(self, point: Point) -> tuple[HeldVariable, ...]:
        """The held variables near a point, those that take the verdict on stability first."""
        return self._held.at(point) if self._held is not None else ()

    def at(self, point: Point) -> Linear:
        """The linear system near a point; UsageError where an algebraic loop is singular there."""
        f_x, f_z, f_w, g_x, g_z, g_w, h_x, h_z, h_w = (np.array(j.full()) for j in self._jacobians(*point.values()))
        f_w, g_w, h_w = (j * self._per for j in (f_w, g_w, h_w))
        if len(point.z):
            by_x, by_w = _solved(g_z, g_x), _solved(g_z, g_w)
            f_x, f_w, h_x, h_w = f_x - f_z @ by_x, f_w - f_z @ by_w, h_x - h_z @ by_x, h_w - h_z @ by_w
        assembly = self.assembly
        return Linear(tuple(assembly.state_names), self.inputs, self.outputs, f_x, f_w, h_x, h_w, assembly.x_nominal,
                      rigid_states(assembly), self.held(point))


def _in_si(assembly: Assembly, name: str) -> ca.SX:
    """A signal in SI: the formula of an output of the diagram, whatever its unit there, or any other."""
    shown = assembly.model.show.get(name)
    return signal_expression(assembly, name) if shown is None else assembly.expression(shown.expr)


def rigid_states(assembly: Assembly) -> tuple[bool, ...]:
    """Which states are positions and speeds of bodies."""
    unknowns = (assembly.flat.unknowns[j] for j, _ in assembly.reduced.states)
    return tuple(u.role == "position" or u.motion for u in unknowns)


def _solved(g_z: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(g_z, right), dtype=float)
    except np.linalg.LinAlgError:
        raise UsageError([Problem("loop-singular", "an algebraic loop is singular here, so that nothing follows from it",
                                  None, "Linearise at another state.")]) from None


def _first_inputs(assembly: Assembly) -> Array:
    """The pieces of the measured inputs at the start."""
    if not assembly.flat.inputs:
        return np.zeros(0)
    times = grid(assembly.model, None, None)
    return pieced(assembly.flat, float(times[0]), float(times[-1])).at(times[:1])[:, 0]


def without_history(assembly: Assembly) -> Assembly:
    """The diagram with approximations in the places of its delayed variables, and the parameters of the assembly."""
    if not assembly.flat.delays:
        return assembly
    made = assemble(replace(assembly.model, approximate=True))
    known = set(made.parameter_names)
    return made.with_parameters({name: value for name, value in assembly.parameter_values.items() if name in known})


def start_point(first: Start, u: Array) -> Point:
    """The point at which a run begins."""
    return Point(first.t, first.x, first.z, first.p, u, 1.0)


class ModesAtStart:
    """The modes of an assembly at its start, and how their eigenvalues move with parameters."""

    def __init__(self, assembly: Assembly):
        self.assembly = assembly = without_history(assembly)
        self.u = _first_inputs(assembly)
        self.linearisation = Linearisation(assembly)
        self.equations = StartEquations(assembly)
        self._events = StartEvents(assembly)

    def at(self, settings: Mapping[str, float | str]) -> tuple[Start, list[Mode]]:
        """The start and the modes with these parameters set; StartError where there is no start."""
        first = self.start(settings)
        return first, self.linearisation.at(self.point(first)).modes()

    def point(self, first: Start) -> Point:
        """The point after the events at the instant of a start, which is linearised."""
        return self._events.after(start_point(first, self.u))

    def start(self, settings: Mapping[str, float | str]) -> Start:
        """The start with these parameters set; StartError where there is none."""
        return start(self.assembly.with_parameters(settings) if settings else self.assembly, None, self.u, self.equations)

    def slope(self, first: Start, mode: Mode, names: Sequence[str], at: Point | None = None) -> NDArray[np.complex128]:
        """d s / d p (m,) for named parameters, the start moving along; zero for a multiple eigenvalue. `at` is the point
        that was linearised, where parameters are others there than at the start."""
        assembly, n_x = self.assembly, len(first.x)
        at = at or self.point(first)
        product = np.vdot(mode.left, mode.right)
        if abs(product) < DEFECTIVE or not names:
            return np.zeros(len(names), dtype=complex)
        directions = np.zeros((len(first.p), len(names)))
        for column, name in enumerate(names):
            directions[assembly.parameter_names.index(name), column] = 1.0
        moved = tangent(self.equations, first, self.u, directions)
        v, left = mode.right * assembly.x_nominal, (mode.left / np.conj(product)) / assembly.x_nominal
        if len(first.z):  # the vectors of the whole system: f and g by x and z
            f_z, g_x, g_z = (np.array(j.full()) for j in self._loops(*at.values()))
            v, left = np.append(v, -np.linalg.solve(g_z, g_x @ v)), np.append(left, -np.linalg.solve(g_z.T, f_z.T @ left))
        slopes = [np.array(s.full()) for s in self._slopes(*at.values(), v.real, v.imag, left.real, left.imag)]
        by = np.vstack([moved.x, moved.z, moved.p])
        assert by.shape[0] == slopes[0].size and n_x <= slopes[0].size
        return np.asarray((slopes[0] @ by + 1j * (slopes[1] @ by)).ravel())

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
