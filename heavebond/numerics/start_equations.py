"""The equations of the start, compiled once for all runs of an assembly."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Place
from heavebond.equations.block_solver import Pivot
from heavebond.equations.buffered import Buffered
from heavebond.equations.flatten import EquationRole, FlatEquation
from heavebond.equations.state_selection import InitialGuess
from heavebond.language.definition import rate_of
from heavebond.language.sections import Condition
from heavebond.language.smoothing import SmoothedColumn, rounded
from heavebond.language.symbols import CORNERS, split, stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.matrices import MATRICES, Matrix
from heavebond.numerics.sizes import SIZES
from heavebond.numerics.sparse_jacobian import jacobian


@dataclass(frozen=True)
class InitialisationConstants:
    """The constants of the search for consistent initial values.

    max_nesting: conditional expressions nested in each other through which slopes of their conditions are followed. Origin:
        a bound. Doubled: nothing but for deeper expressions.
    sharp: width of a smoothed step that counts as sharp, in the unit of its argument. Origin: below any value. Doubled:
        nothing.
    singular: singular value, over the largest, of a system that is singular at the solution. Origin: rounding of a few
        hundred terms. Doubled: nothing but for values within rounding of it.
    max_shifts: shifted guesses from which a start is tried, after six plain attempts. Origin: a bound on the time of an
        impossible start. Doubled: an impossible start is refused later.
    dependent: share up to which gradients of two conditions depend on each other. Origin: square root of rounding. Doubled:
        nothing.
    disagree: residual from which such conditions contradict each other. Origin: `acceptable` of the nonlinear solver.
        Doubled: smaller contradictions are reported as too many conditions.
    undetermined: singular value, over the largest, below which a direction of a start is named as undetermined. Origin: ten
        times `rank`. Doubled: only values within rounding of it are affected.
    just_after: time in s after the start at which values are evaluated again if they are not finite at the start. Origin:
        short against motions of machines. Doubled: nothing.
    share: share of an unknown in an undetermined direction from which on it is named. Origin: rounding is far below.
        Doubled: nothing.
    fixed: factor of the size of an unknown that the initial values of components do not move. Origin: the square root of
        rounding, as it enters squared. Doubled: nothing.
    follows: factor of the size of the value of a delayed variable before the start, which follows its source: states that no
        condition determines stay where they are. Origin: they move by its inverse squared. Doubled: nothing.
    """

    max_nesting: int = 6
    sharp: float = 1e-30
    singular: float = 1e-13
    max_shifts: int = 16
    dependent: float = 1e-8
    disagree: float = 1e-6
    undetermined: float = 1e-10
    just_after: float = 1e-3
    share: float = 1e-3
    fixed: float = 1e-8
    follows: float = 1e6


INITIALISATION = InitialisationConstants()


@dataclass(frozen=True)
class StartRow:
    """One equation of the start: its residual in the arguments of the assembly, its text in messages, its location; `name`
    is the variable of a condition."""

    residual: ca.SX
    label: str
    place: Place | None
    steady: bool = False
    name: str = ""


def _words(equation: FlatEquation) -> str:
    """An equation in messages; the laws of a component with its name, as several have the same ones."""
    text = equation.label or equation.text
    return f"{equation.owner}: {text}" if equation.role is EquationRole.LAW and equation.owner else text


@dataclass(frozen=True)
class Point:
    """The point at which the equations are evaluated: time, x, z, all parameters, the pieces of the inputs, the time
    rate."""

    t: float
    x: Array
    z: Array
    p: Array
    u: Array
    rate: float

    def values(self) -> tuple[float, Array, Array, Array, Array, float]:
        """In the order of the assembly's arguments."""
        return self.t, self.x, self.z, self.p, self.u, self.rate

    def columns(self, times: int = 1) -> list[Array]:
        """The values as arguments of functions at several points, so many times side by side."""
        return [np.tile(np.reshape(a, (-1, 1)), (1, times)) for a in self.values()]


class StartSystem:
    """Residuals (m,) of some rows and their Jacobian with respect to the unknowns (x, z, solved parameters), or z."""

    def __init__(self, assembly: Assembly, rows: list[StartRow], unknowns: ca.SX, slopes: ca.SX | None = None):
        """`slopes` are the Jacobian if it is known."""
        self.rows = rows
        self._arguments = list(assembly.arguments)
        self.residuals, self._unknowns = stack([r.residual for r in rows]), unknowns
        self.slopes = jacobian(self.residuals, unknowns) if slopes is None else slopes
        self._function = ca.Function("start", self._arguments, [self.residuals, self.slopes])
        self._large = unknowns.numel() >= MATRICES.sparse_from
        self._buffered = Buffered(self._function, sparse=self._large)

    def at(self, point: Point) -> tuple[Array, Matrix]:
        """Residuals and Jacobian, both in SI."""
        residual, jacobian = self._buffered(*point.values()).values()
        return residual.ravel(), jacobian

    def standing(self, row: int) -> list[int]:
        """The unknowns that occur in a row, also with a zero derivative at the point."""
        rows, columns = self._function.sparsity_out(1).get_triplet()
        return [column for at, column in zip(rows, columns, strict=True) if at == row]

    @cached_property
    def affine(self) -> bool:
        """True if the residuals are affine in the unknowns: one step of Newton's method solves them."""
        corners = {self._function.instruction_id(k) for k in range(self._function.n_instructions())} & CORNERS
        return not corners and not any(ca.which_depends(self.residuals, self._unknowns, 2, True))

    @cached_property
    def _rounded(self) -> tuple[SmoothedColumn, ca.Function, ca.Function]:
        """The residuals with rounded corners: their values and Jacobian, and the Jacobian of the arguments that are zero at
        the corners."""
        smoothed = rounded(self.residuals, self._arguments)
        arguments = [*self._arguments, smoothed.widths]
        return (smoothed, ca.Function("rounded", arguments, [smoothed.column, ca.jacobian(smoothed.column, self._unknowns)]),
                ca.Function("corners", arguments, [ca.jacobian(smoothed.at, self._unknowns)]))

    def corner_widths(self, point: Point, sizes: Array) -> Array:
        """The change of each corner argument (n,) while every unknown changes by its size. Corners inside an inactive branch
        count as if that branch were rounded, too."""
        values, _, slopes = self._rounded
        widths = np.full(values.widths.numel(), INITIALISATION.sharp)
        for _ in range(INITIALISATION.max_nesting if len(widths) else 0):
            widths = np.maximum(abs(self._matrix(slopes(*point.values(), widths))) @ sizes, INITIALISATION.sharp)
        return np.asarray(widths)

    def rounded_at(self, point: Point, widths: Array) -> tuple[Array, Matrix]:
        """Residuals and Jacobian with corners of these widths (n,)."""
        residual, jacobian = self._rounded[1](*point.values(), widths)
        return np.array(residual.full()).ravel(), self._matrix(jacobian)

    def _matrix(self, values: ca.DM) -> Matrix:
        """A matrix of CasADi, sparse for a large machine."""
        return values.sparse() if self._large else np.array(values.full())

    @cached_property
    def _slopes(self) -> ca.Function:
        _, x, _, p, _, _ = self._arguments
        return ca.Function("slopes", self._arguments,
                           [ca.jacobian(self.residuals, p), ca.jacobian(self.residuals, x)])

    def moved(self, point: Point, dp: Array, dx: Array | None = None) -> Array:
        """The derivatives of the residuals (m, k) along dp (n_p, k) and dx (n_x, k)."""
        by_p, by_x = (self._matrix(s) for s in self._slopes(*point.values()))
        return np.asarray(by_p @ dp if dx is None else by_p @ dp + by_x @ dx)


class StartEquations:
    """The requirements on the start of a diagram as equations: conditions, guesses, rest or steady state, and the loops."""

    def __init__(self, assembly: Assembly):
        self.assembly = assembly
        self.initial = assembly.model.initial
        names = assembly.parameter_names
        delays = assembly.flat.delays
        self.solved_for = [*(names.index(name) for name in self.initial.solve), *(d.index for d in delays)]
        self.steady = self.initial.mode == "steady"
        self.loops = [StartRow(g, _words(e), e.place) for g, e in zip(
            split(assembly.alg), assembly.reduced.alg_equations, strict=True)]
        held = {h.name for h in assembly.flat.held}  # what these start at stands among the parameters
        conditions = [c for c in self.initial.conditions.values() if c.name not in held]
        self.component_rows = [] if self.steady else self._of_components(conditions)
        p = assembly.arguments[3]
        before = [StartRow(p[d.index] - assembly.express(d.source), f"{d.name} before the start", d.place) for d in delays]
        self.rows = [*self.loops, *(self._condition(c) for c in conditions if not c.guess), *before, *self._mode()]
        self.guesses = [self._condition(c) for c in conditions if c.guess and self._decides(c)]
        self.guess = InitialGuess(assembly.flat)

    @cached_property
    def with_components(self) -> StartSystem:
        """All equations of the start, and the initial values of the components."""
        return self._system([*self.rows, *self.component_rows])

    def following(self, sizes: Array) -> Array:
        """The scales of the unknowns for the initial values of the components: these change the states of their component
        and the algebraic unknowns only."""
        component_unknowns = {self.assembly.flat.names[row.name] for row in self.component_rows}
        scales = sizes.copy()
        for k, (j, order) in enumerate(self.assembly.reduced.states):
            if j not in component_unknowns or order:
                scales[k] *= INITIALISATION.fixed
        begin = len(self.assembly.x_nominal) + len(self.assembly.z_nominal)
        scales[begin:begin + len(self.initial.solve)] *= INITIALISATION.fixed  # values before the start follow
        return scales

    def _of_components(self, conditions: list[Condition]) -> list[StartRow]:
        """The initial values of the components (`initial:` in their files) of states that the conditions of the diagram
        leave open. A condition on another variable of the component, such as the output of a filter, takes the place of one
        of them if it depends on no other state of the component. States that are `steady` have the derivative 0, if the
        diagram decides none of them, and if such values exist whatever the input."""
        assembly, rows = self.assembly, list[StartRow]()
        names, formula = assembly.flat.names, assembly.model.library.formula
        symbols = {j: s.element_hash() for s, (j, order) in zip(split(assembly.arguments[1]), assembly.reduced.states,
                                                                strict=True) if order == 0}
        places_of = {symbol: k for k, symbol in enumerate(s.element_hash() for s in split(assembly.arguments[1]))}
        decided = {names.get(c.name, -1) for c in conditions}
        for path, leaf in assembly.flat.expanded.leaves.items():
            if not leaf.component.initial:
                continue
            component, component_unknowns = leaf.component, {j for name, j in names.items()
                                                             if name.rpartition(".")[0] == path}
            open_states = {names[name]: (name, reset) for reset in component.initial for name in names
                           if f"{path}.{reset.target.text}" in (name, name.partition("[")[0]) and names[name] in symbols}
            determined = {symbols[j] for j in component_unknowns & symbols.keys() - open_states.keys() - decided}
            replaced = set[int]()
            for c in conditions:
                if c.name.rpartition(".")[0] == path and names.get(c.name) not in symbols and not c.guess:
                    inside = {s.element_hash() for s in ca.symvar(self._condition(c).residual)}
                    replaced |= set() if inside & determined else inside
            steady = dict[int, StartRow]()
            for j, (name, reset) in open_states.items():
                if j not in decided and symbols[j] not in replaced:
                    if reset.steady:
                        row = places_of[symbols[j]]
                        steady[row] = StartRow(assembly.ode[row], f"{path}: der({name.rpartition('.')[2]}) = 0 at the start",
                                               reset.value.place, name=name)
                        continue
                    text = component.in_diagram(reset.value, path)
                    for integer, number in leaf.integers.items():
                        text = re.sub(rf"{re.escape(f'{path}.{integer}')}\b", str(number), text)
                    value = assembly.expression(formula(text))
                    residual = assembly.expression(formula(name)) - value
                    rows.append(StartRow(residual, f"{path}: {name.rpartition('.')[2]} = {reset.value.text} at the start",
                                         reset.value.place, name=name))
            if len(steady) == sum(reset.steady for _, reset in open_states.values()) and self._regular(list(steady)):
                rows += steady.values()
        return rows

    def _regular(self, rows: Sequence[int]) -> bool:
        """Whether the derivatives of some linear states determine these states: False for an integrator among them."""
        assembly = self.assembly
        if not rows:
            return False
        rates, states = (stack([of[k] for k in rows]) for of in (assembly.ode, assembly.arguments[1]))
        slopes = ca.Function("slopes", list(assembly.arguments), [ca.densify(ca.jacobian(rates, states))])
        at = (assembly.begin, *(np.zeros(a.numel()) for a in assembly.arguments[1:3]), assembly.p,
              np.zeros(assembly.arguments[4].numel()), 1.0)
        matrix = np.array(slopes(*at))
        return bool(np.isfinite(matrix).all()) and np.linalg.matrix_rank(matrix) == len(rows)

    def _decides(self, guess: Condition) -> bool:
        """True if a guess is used: a guess of a rate, `der(joint.v): ~ 0`, is used only if the variable consists of speeds
        alone. The positions that they leave open then follow from it (the elongation of a spring between two masses, from
        the load that it carries). Otherwise the guess of the variable determines the positions, such as the guess of a joint
        without mass."""
        inner = rate_of(guess.name)
        if inner is None:
            return True
        assembly, states = self.assembly, self.assembly.reduced.states
        speeds = {s.element_hash() for s, (j, order) in zip(split(assembly.arguments[1]), states, strict=True)
                  if assembly.flat.unknowns[j].motion or order > 0}
        value = assembly.expression(assembly.model.library.formula(inner))
        within = {s.element_hash() for s in ca.symvar(value)} & {s.element_hash() for a in assembly.arguments[1:3]
                                                                for s in split(a)}
        return bool(within) and within <= speeds

    def _mode(self) -> list[StartRow]:
        assembly, rows = self.assembly, []
        rates = split(assembly.ode)
        for k, (j, order) in enumerate(assembly.reduced.states):
            name, unknown = assembly.state_names[k], assembly.flat.unknowns[j]
            if self.steady:
                rows.append(StartRow(rates[k], f"steady: der({name}) = 0", unknown.place, steady=True))
            elif self.initial.mode == "rest" and (unknown.motion or order > 0):
                rows.append(StartRow(assembly.arguments[1][k], f"at rest: {name} = 0", unknown.place))
        return rows

    def _condition(self, condition: Condition) -> StartRow:
        """`crown.x = 20 mm`; a plain number is the parameter `initial.crown.x`. Names and units were checked before."""
        assembly = self.assembly
        number = assembly.flat.constants.get(f"initial.{condition.name}")
        value = assembly.expression(condition.value.expr) if number is None or condition.guess else number
        return StartRow(assembly.expression(assembly.model.library.formula(condition.name)) - value,
                        f"{condition.name} = {condition.value.text.lstrip('= ')}", condition.place, name=condition.name)

    def _system(self, rows: list[StartRow], slopes: ca.SX | None = None) -> StartSystem:
        _, x, z, p, _, _ = self.assembly.arguments
        return StartSystem(self.assembly, rows, stack([x, z, *[p[k] for k in self.solved_for]]), slopes)

    @cached_property
    def all(self) -> StartSystem:
        """All equations of the start."""
        return self._system(self.rows, self.with_guesses.slopes[:len(self.rows), :]) if self.guesses else self.with_guesses

    @cached_property
    def with_guesses(self) -> StartSystem:
        """All equations of the start and the guesses; the remaining directions are undetermined."""
        return self._system([*self.rows, *self.guesses])

    @cached_property
    def approach(self) -> StartSystem:
        """The guesses and conditions without the steady state, with which the search begins."""
        return self._system([r for r in self.rows if not r.steady] + self.guesses)

    @cached_property
    def conditions(self) -> StartSystem:
        """The conditions of the start alone, without the algebraic loops."""
        return self._system(self.rows[len(self.loops):])

    @cached_property
    def aims(self) -> StartSystem:
        """The conditions and the guesses, without the loops."""
        return self._system([*self.rows[len(self.loops):], *self.guesses])

    @cached_property
    def separate(self) -> bool:
        """Whether the conditions, if any, are about states alone, so that these are known before the loops are solved."""
        inner = {s.element_hash() for s in split(self.assembly.arguments[2])}
        conditions = self.rows[len(self.loops):]
        return not self.steady and not self.solved_for and not any(
            s.element_hash() in inner for row in conditions for s in ca.symvar(row.residual))

    @cached_property
    def algebraic(self) -> StartSystem:
        """The loops alone, for z."""
        return StartSystem(self.assembly, self.loops, self.assembly.arguments[2])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """The declared bounds of (x, z, solved parameters)."""
        assembly, everything = self.assembly, (-np.inf, np.inf)
        symbols = [*split(assembly.reduced.x), *split(assembly.reduced.z), *(assembly.flat.p[k] for k in self.solved_for)]
        intervals = np.array([assembly.flat.bounds.get(s.element_hash(), everything)
                              for s in symbols]).reshape(len(symbols), 2)
        return intervals[:, 0], intervals[:, 1]

    @cached_property
    def felt(self) -> NDArray[np.int64]:
        """The parameters (indices) on which the start depends; others may change without another solution."""
        stand = stack([*(row.residual for row in (*self.rows, *self.guesses, *self.component_rows)), self.guess.expressions])
        present = {s.element_hash() for s in ca.symvar(stand)}
        return np.array([k for s, k in self.assembly.flat.places.items() if s in present], np.int64)

    @cached_property
    def widths(self) -> list[int]:
        """The parameters that are widths of regularised laws, the second arguments of `smooth_sign` and `signed_sqrt`."""
        names = {name: k for k, name in enumerate(self.assembly.parameter_names)}
        leaves = self.assembly.flat.expanded.leaves
        names_of_widths = (names.get(f"{path}.{width}") for path, leaf in leaves.items() for width in leaf.component.widths)
        return sorted({k for k in names_of_widths if k is not None})

    @cached_property
    def _divisors_and_rates(self) -> Buffered:
        """The divisors, the rates and all variables at a point."""
        assembly = self.assembly
        arguments = list(assembly.arguments)
        return Buffered(ca.Function("told", arguments, [
            stack([f(*arguments)]) for f in (assembly.pivots, assembly.values)] + [assembly.ode]))

    def sound(self, point: Point) -> bool:
        """True if every variable and rate is finite at a point, and no divisor is zero."""
        numbers = list(self._divisors_and_rates(*point.values()).values())
        return all(np.isfinite(values).all() for values in numbers) and bool(np.all(numbers[0] != 0))

    def asks_tiny_values(self, p: Array) -> bool:
        """True if a condition asks for a value other than 0 that is far below the nominal size of its variable."""
        flat = self.assembly.flat
        places = {name: k for k, name in enumerate(self.assembly.parameter_names)}
        return any(0 < abs(p[places[f"initial.{name}"]]) < SIZES.small * flat.unknowns[flat.names[name]].nominal
                   for name in self.initial.conditions if name in flat.names and f"initial.{name}" in places)

    @cached_property
    def constants(self) -> tuple[list[Pivot], Buffered]:
        """The divisors that depend on parameters alone, and their values."""
        flat, pivots = self.assembly.flat, self.assembly.reduced.pivots
        coefficients = stack([q.coefficient for q in pivots])
        variables = [s for s in ca.symvar(coefficients) if s.element_hash() not in flat.places]
        varying = ca.which_depends(coefficients, stack(variables), 1, True) if variables else [False] * len(pivots)
        constant = [q for q, varies in zip(pivots, varying, strict=True) if not varies]
        return constant, Buffered(ca.Function("constants", [flat.p], [stack([q.coefficient for q in constant])]))

    @cached_property
    def _usual(self) -> list[float]:
        """The usual sizes of quantities with the dimensions of the solved parameters."""
        flat = self.assembly.flat
        # a dimension is slow to hash, and most unknowns share one of a few
        each = {id(u.unit.dimension): (u.unit.dimension, u.nominal) for u in flat.unknowns}
        usual = dict(each.values())
        return [usual.get(flat.parameters[k].unit.dimension, 1.0) for k in self.solved_for]

    def sizes(self, p: Array) -> Array:
        """The usual sizes of (x, z, solved parameters)."""
        assembly = self.assembly
        solved_sizes = [max(abs(p[k]), usual) for k, usual in zip(self.solved_for, self._usual, strict=True)]
        n = len(self.initial.solve)
        solved_sizes[n:] = [INITIALISATION.follows * size for size in solved_sizes[n:]]
        x_sizes = assembly.x_nominal.copy()  # a state that moves little about an origin is as large as usual
        for k, ((j, _), name) in enumerate(zip(assembly.reduced.states, assembly.state_names, strict=True)):
            if (size := assembly.sizes.get(name)) and size.origin:
                x_sizes[k] = assembly.flat.unknowns[j].nominal
        return np.concatenate([x_sizes, assembly.z_nominal, np.array(solved_sizes)])
