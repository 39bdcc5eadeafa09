"""Consistent initial values by a globalised Newton method; the result lists the requested and the used values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.cancellation import check
from heavebond.core.errors import StartError
from heavebond.language.external_functions import naming_results
from heavebond.language.symbols import uniform
from heavebond.numerics import mechanism_messages, start_messages
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.idas import at_rest
from heavebond.numerics.matrices import Matrix, added, finite, least_change, null_space, scaled
from heavebond.numerics.newton import NEWTON, NewtonResult, Scaling, System, continued, newton, settled, sharpened, weights
from heavebond.numerics.start_equations import INITIALISATION, Point, StartEquations, StartSystem
from heavebond.numerics.time_events import clocks_at

# widths of regularised laws are narrowed from this many times their size
WIDENINGS = (1e4, 1e3, 100.0, 10.0, 3.0, 1.0)
SETTLED = 1e4  # s; steps in pseudo-time after which a machine has come to rest
SAME_EQUILIBRIUM = 1e-6  # usual sizes within which two solutions are one; both are solved to 1e-9
FOLLOWED = 0.1  # usual sizes by which a start may differ from the one that it follows; parameters of a search move by less


@dataclass(frozen=True)
class StartLine:
    """One line of the table asked / used / why."""

    name: str
    asked: str
    used: float
    unit: str
    why: str


@dataclass(frozen=True)
class Start:
    """Consistent values at t: x (n_x,), z (n_z,), and the parameters with those that were solved for."""

    t: float
    x: Array
    z: Array
    p: Array
    table: tuple[StartLine, ...]
    free: tuple[str, ...]
    steps: int
    in_turn: bool = False  # whether the states were known before the loops were solved
    of_components: bool = False  # whether there are initial values of components, and they are met


def start(assembly: Assembly, t: float | None = None, u: Array | None = None, equations: StartEquations | None = None,
          near: Start | None = None) -> Start:
    """Solve for x, z and the parameters under `solve:`; StartError with the reason if no solution is found.

    Unknowns that no condition determines keep their guess: states keep it exactly if the loops can be solved for the
    algebraic unknowns alone; otherwise all unknowns change by the least norm in scaled variables. After `start: steady` a
    direction that no equation determines is an error. The time defaults to the begin of the runs; `equations` are the
    compiled equations of the start, if they exist. `near` is a start with other parameters, or of another diagram (see
    `renamed_start`): the search follows it if the equations determine all unknowns and the new start is close to it."""
    t = assembly.begin if t is None else t
    if (p := clocks_at(assembly, t, assembly.p)) is not assembly.p:
        assembly = replace(assembly, p=p)
    u = np.zeros(assembly.arguments[4].numel()) if u is None else u
    problem = StartSearch(equations or StartEquations(assembly), assembly, t, u)
    try:
        followed = problem.following(near) if near is not None else None
        with naming_results():
            return problem.finished(problem.solve() if followed is None else followed)
    except StartError as error:
        if wrong := mechanism_messages.unassembled(assembly):
            raise StartError([wrong]) from error
        raise


def renamed_start(known: Start, of: Assembly, target: Assembly) -> Start:
    """The values of a start of the assembly `of` at the same names of the assembly `target`, and nan at names that `of` does
    not have."""
    def values(names: Sequence[str], known_names: Sequence[str], known_values: Array) -> Array:
        by_name = dict(zip(known_names, known_values, strict=True))
        return np.array([by_name.get(name, np.nan) for name in names])

    if of.state_names == target.state_names and of.algebraic_names == target.algebraic_names \
            and of.parameter_names == target.parameter_names:
        return known
    return replace(known, x=values(target.state_names, of.state_names, known.x),
                   z=values(target.algebraic_names, of.algebraic_names, known.z),
                   p=values(target.parameter_names, of.parameter_names, known.p))


def held_still(u: Array, t: float) -> Array:
    """The pieces of the measured inputs (see `dae.substitute_inputs`) with their values at t, and no derivatives: a spline
    through samples has a slope at its end even if the machine was at rest, and a small slope fills or empties a chamber with
    little leakage."""
    pieces = u.copy()
    for k in range(1, len(u) - 3, 4):
        pieces[k:k + 4] = np.polyval(u[k:k + 4][::-1], t - u[0]), 0.0, 0.0, 0.0
    return pieces


@dataclass(frozen=True)
class Tangent:
    """How the start moves with parameters: dx (n_x, m), dz (n_z, m), dp (n_p, m) along m directions."""

    x: Array
    z: Array
    p: Array


def tangent(equations: StartEquations, first: Start, u: Array, directions: Array) -> Tangent:
    """The derivative of the start along `directions` (n_p, m), by the implicit function theorem.

    With F(y, p) = 0 the equations of the start and dy_0 the change of the guess, dy = dy_0 - F_y^+ (F_p dp + F_y dy_0): the
    least change in scaled unknowns, as in `start`, so that undetermined unknowns follow their guess. Parameters under
    `solve:` follow the others.
    """
    n_x, n_z = len(first.x), len(first.z)
    sizes = equations.sizes(first.p)
    moving = Point(first.t, first.x, first.z, first.p, u, 1.0)
    point = replace(moving, u=held_still(u, first.t), rate=0.0) if equations.steady else moving
    dp = directions.copy()
    dp[equations.solved_for] = 0.0
    dy = np.zeros((len(sizes), dp.shape[1]))
    columns = (*equations.assembly.reduced.states, *equations.assembly.reduced.algebraic)
    slopes = equations.guess.slopes(first.p) @ dp
    for k, (j, order) in enumerate(columns):
        dy[k] = slopes[j] if order == 0 else 0.0
    aims, whole = (equations.aims, equations.conditions) if first.in_turn else (equations.approach, equations.all)
    for system in ([aims] if equations.guesses else []) + [whole]:
        at = system.at(point)
        dy = dy + _least_change(at, system.moved(point, dp) + at[1] @ dy, sizes)
    if first.of_components:
        system = equations.with_components
        at = system.at(point)
        dy = dy + _least_change(at, system.moved(point, dp) + at[1] @ dy, equations.following(sizes))
    dp[equations.solved_for] = dy[n_x + n_z:]
    dx, dz = dy[:n_x], dy[n_x:n_x + n_z]
    if n_z:
        dz = _least_change(equations.algebraic.at(moving), equations.algebraic.moved(moving, dp, dx), sizes[n_x:n_x + n_z])
    return Tangent(dx, dz, dp)


def _least_change(at: tuple[Array, Matrix], changes: Array, sizes: Array) -> Array:
    """The change of the unknowns (n, m) that keeps the residuals while they are moved by (rows, m)."""
    residual, jacobian = at[0], scaled(at[1], None, sizes)
    if not jacobian.size:
        return np.zeros((len(sizes), changes.shape[1]))
    row = weights(residual, jacobian)
    return least_change(scaled(jacobian, row), -changes * row[:, None]) * sizes[:, None]


class StartSearch:
    """The search for one start: the equations of the assembly at given parameters, time and inputs."""

    def __init__(self, equations: StartEquations, assembly: Assembly, t: float, u: Array):
        self.equations, self.assembly, self.t, self.u = equations, assembly, t, u
        self.still = held_still(u, t)
        self.n_x, self.n_z = len(assembly.x_nominal), len(assembly.z_nominal)
        self.nominal = equations.sizes(assembly.p)
        self.frame = Scaling(self.nominal, *equations.bounds)
        values = self.equations.guess(self.assembly.p)
        columns = (*self.assembly.reduced.states, *self.assembly.reduced.algebraic)
        self.y0 = np.array([*(values[j] if order == 0 else 0.0 for j, order in columns),
                            *self.assembly.p[self.equations.solved_for]])
        self.widening = 1.0
        self.shut_in: tuple[str, ...] = ()
        self.steps = 0
        self.in_turn = False
        # the residual of a condition such as x = 1 nm is below that of a solution at x = 0
        self.fine = bool(assembly.sizes) or equations.asks_tiny_values(assembly.p)
        self.of_components = False

    def _point(self, y: Array, rate: float | None = None) -> Point:
        p = self.assembly.p.copy()
        p[self.equations.solved_for] = y[self.n_x + self.n_z:]
        p[self.equations.widths] *= self.widening
        rate = rate if rate is not None else 0.0 if self.equations.steady else 1.0  # a steady start holds the inputs still
        u = self.u if rate else self.still
        return Point(self.t, y[: self.n_x], y[self.n_x:self.n_x + self.n_z], p, u, rate)

    def _scaled(self, system: StartSystem) -> System:
        """Residuals and Jacobian in unknowns counted in their usual sizes."""
        def at(y: Array) -> tuple[Array, Matrix]:
            residual, jacobian = system.at(self._point(y))
            return residual, scaled(jacobian, None, self.nominal)
        return at

    # -- solving ---------------------------------------------------------------------------------------------------
    def solve(self) -> Array:
        """(x, z, solved parameters) of a consistent start."""
        y, equations = self.y0, self.equations
        self._check_constants()
        if equations.separate and (result := self._in_turn()) is not None:
            self.in_turn, y = True, result
        else:
            if equations.guesses:
                y = newton(self._scaled(equations.approach), y, self.frame).y
            y = self._search(y)
            if equations.steady or equations.initial.solve:
                self.shut_in = start_messages.undetermined(equations, self._point(y), self.nominal)
            y = self._settle(y)
        return self._with_components(y) if equations.component_rows else y

    def following(self, near: Start) -> Array | None:
        """The equilibrium on the branch of `near`, by Newton's method from there; None if the start is searched in another
        way, if it is not within FOLLOWED of `near`, or if the equations leave a direction open, in which it would depend on
        `near`."""
        equations = self.equations
        if equations.separate or equations.component_rows or not (equations.steady or equations.initial.solve):
            return None
        before = np.concatenate([near.x, near.z, near.p[equations.solved_for]])
        unknown = np.isnan(before)
        system = self._scaled(equations.all)
        equilibrium = newton(system, np.where(unknown, self.y0, before), self.frame, NEWTON.path_iterations)
        if not equilibrium.good or self._apart(equilibrium.y, np.where(unknown, equilibrium.y, before)) > FOLLOWED:
            return None
        residual, jacobian = system(equilibrium.y)
        weighted = scaled(jacobian, weights(residual, jacobian))
        if not finite(weighted) or null_space(weighted, INITIALISATION.undetermined).size:
            return None
        self._check_constants()
        self.steps = equilibrium.steps
        try:
            return self._settle(sharpened(system, equilibrium, self.frame).y)
        except StartError:
            return None

    def _with_components(self, y: Array) -> Array:
        """The start with the states that the initial values of the components determine; `y` itself if these have no
        solution, such as a lag in a loop with gain 1."""
        sizes, system = self.equations.following(self.nominal), self.equations.with_components

        def at(y: Array) -> tuple[Array, Matrix]:
            residual, jacobian = system.at(self._point(y))
            return residual, scaled(jacobian, None, sizes)

        result = newton(at, y, Scaling(sizes, *self.equations.bounds))
        if not result.good:
            return y
        try:
            whole = self._settle(result.y)
        except StartError:
            check()
            return y
        self.of_components, self.steps = True, self.steps + result.steps
        return whole

    def _check_constants(self) -> None:
        """Raise an error for coefficients of parameters alone that are zero: a mass or stiffness of 0 is reported before the
        equations are solved."""
        constant, function = self.equations.constants
        values = function(self.assembly.p)["o0"].ravel()
        start_messages.check_pivots(self.assembly, list(zip(constant, values, strict=True)), self._point(self.y0, 1.0))

    def _in_turn(self) -> Array | None:
        """The states by the conditions about them, then the algebraic unknowns by the loops; nothing where that fails, as in
        a mechanism whose links do not meet at the guess."""
        y = self.y0
        for system in (self.equations.aims, self.equations.conditions):
            result = newton(self._scaled(system), y, self.frame)
            if self.fine and result.good:
                result = sharpened(self._scaled(system), result, self.frame)
            y = result.y
            self.steps += result.steps
        try:
            return self._settle(y) if result.good else None
        except StartError:
            return None

    def _search(self, first: Array) -> Array:
        """The first of these methods that converges: Newton's method from the guess; continuation in the widths of
        regularised laws; continuation in the residuals at the guess; for a steady start, pseudo-transient continuation;
        continuation with rounded corners, since an open contact or a shut valve has no gradient at the guess; integration
        until the machine is at rest; Newton's method from points around the guess."""
        system = self._scaled(self.equations.all)
        best: NewtonResult | None = None
        for attempt in range(6 + INITIALISATION.max_shifts):
            result = self._attempt(system, first, attempt)
            if self.fine and result.good:
                result = sharpened(system, result, self.frame)
            self.steps += result.steps
            if result.good:
                return self._nearest(system, first, result.y) if self.equations.steady else result.y
            best = result if best is None or result.missed < best.missed else best
            if self.equations.all.affine and self.frame.inside(result.y):
                break  # straight lines that meet nowhere
        assert best is not None
        raise start_messages.failure(self.equations, self._point(best.y), best.residual, self.equations.all, self.nominal)

    def _nearest(self, system: System, first: Array, y: Array) -> Array:
        """The equilibrium nearest to the guess, in usual sizes of the states, if there are several: Newton's method may step
        over it. The path along which the residuals at the guess vanish leads to a near equilibrium. It replaces y if it
        differs from y and the motion of the machine leads to it too. A start with undetermined pressures of shut volumes is
        not changed."""
        if self.equations.all.affine:
            return y
        result = continued(lambda share: system, first, self.frame)
        if not result.good or self._apart(result.y, y) < SAME_EQUILIBRIUM:
            return y
        residual, jacobian = system(y)
        if null_space(scaled(jacobian, weights(residual, jacobian)), INITIALISATION.undetermined).size:
            return y
        candidates = [result, settled(system, self._slowed, first, self.frame, SETTLED)]
        return min((y, *(c.y for c in candidates if c.good)), key=lambda end: round(self._apart(end, first), 6))

    def _apart(self, y: Array, point: Array) -> float:
        """The distance of two points in usual sizes of the states."""
        return float(np.linalg.norm(((y - point) / self.nominal)[: self.n_x]))

    def at_rest_from(self, y: Array) -> Array | None:
        """The equilibrium to which the machine settles from y (x, z and solved parameters), if it does."""
        result = settled(self._scaled(self.equations.all), self._slowed, y, self.frame, SETTLED)
        return result.y if result.good else None

    def _attempt(self, system: System, first: Array, attempt: int) -> NewtonResult:
        if attempt == 1:
            # Newton's method with widened transitions, which are narrowed step by step to their width
            result = NewtonResult(first, np.full(1, np.inf), 0)
            if not self.equations.widths:
                return result
            for self.widening in WIDENINGS:
                result = newton(system, result.y, self.frame)
            self.widening = 1.0
            return result
        if attempt == 2:
            return continued(lambda share: system, first, self.frame)
        if attempt == 3 and self.equations.steady:
            return settled(system, self._slowed, first, self.frame)
        if attempt == 4:
            # Newton's method with rounded corners, which become sharp step by step
            whole = self.equations.all
            widths = whole.corner_widths(self._point(first), self.nominal)
            if not len(widths) or not np.all(np.isfinite(widths)):
                return NewtonResult(first, np.full(1, np.inf), 0)

            def family(share: float) -> System:
                def at(y: Array) -> tuple[Array, Matrix]:
                    residual, jacobian = whole.rounded_at(self._point(y), (1 - share) * widths)
                    return residual, scaled(jacobian, None, self.nominal)
                return at if share < 1 else system

            return continued(family, first, self.frame)
        if attempt == 5 and self.equations.steady:
            # the state of rest to which the machine settles by integration from a consistent point at the guess: valves that
            # are shut at the guess open when pressures rise, even if they have no gradient there. Newton's method is tried
            # from later points
            y, result = first.copy(), NewtonResult(first, np.full(1, np.inf), 0)
            inner = slice(self.n_x, self.n_x + self.n_z)
            try:
                y = self._settle(y)
            except StartError:
                return result
            point = self._point(y)
            for x, z in at_rest(self.assembly, self.t, y[: self.n_x], y[inner], point.p, point.u):
                y[: self.n_x], y[inner] = x, z
                result = newton(system, y, self.frame)
                if result.good:
                    break
            return result
        # Newton's method from a deterministic shift of the guess, which grows with the number of the attempt
        number, shift = attempt - 5, np.zeros(len(self.nominal))
        if number > 0:
            size = 10.0 ** (-3 + (number - 1) // 4)
            shift = size * np.array([2 * uniform(number, k) - 1 for k in range(len(self.nominal))])
        return newton(system, first + self.nominal * shift, self.frame)

    def _slowed(self, before: Array, step: float) -> System:
        """The equations of a steady start with (x - before)/step for each rate that is to vanish."""
        steady = [k for k, row in enumerate(self.equations.rows) if row.steady]
        states = np.arange(self.n_x)

        def at(y: Array) -> tuple[Array, Matrix]:
            residual, jacobian = self._scaled(self.equations.all)(y)
            residual[steady] -= (y[: self.n_x] - before[: self.n_x]) / step
            return residual, added(jacobian, steady, states, -self.nominal[: self.n_x] / step)
        return at

    def _settle(self, y: Array) -> Array:
        """The algebraic unknowns again with the inputs moving (a steady start holds them still), x fixed."""
        if not self.n_z:
            return y
        whole, inner = y.copy(), slice(self.n_x, self.n_x + self.n_z)

        def at(z: Array) -> tuple[Array, Matrix]:
            whole[inner] = z
            residual, jacobian = self.equations.algebraic.at(self._point(whole, 1.0))
            return residual, scaled(jacobian, None, self.assembly.z_nominal)

        frame = Scaling(self.assembly.z_nominal, self.frame.low[inner], self.frame.high[inner])
        result = newton(at, y[inner], frame)
        if result.good and (result.steps or self.fine):
            result = sharpened(at, result, frame)
        raw, jacobian = at(result.y)
        if not result.good:
            raise start_messages.failure(self.equations, self._point(whole, 1.0), result.residual, self.equations.algebraic,
                                        self.assembly.z_nominal)
        if finite(jacobian):
            usual = scaled(jacobian, None, self.assembly.z_usual / self.assembly.z_nominal)
            undecided = null_space(scaled(usual, weights(raw, usual)), INITIALISATION.singular)
            if undecided.size:
                raise start_messages.singular_loop(self.assembly, self._point(whole, 1.0), undecided[:, -1])
        return whole

    # -- the answer ------------------------------------------------------------------------------------------------
    def finished(self, y: Array) -> Start:
        """The start with its table asked / used / why; StartError if a coefficient is zero there."""
        assembly = self.assembly
        point = self._point(y, 1.0)
        if not self.equations.sound(point):
            values = point.values()
            pivots = np.array(assembly.pivots(*values)).ravel()
            start_messages.check_pivots(assembly, list(zip(assembly.reduced.pivots, pivots, strict=True)), point)
            start_messages.check_values(assembly, point)
        table = []
        conditions = {assembly.flat.names.get(c.name, -1): c for c in self.equations.initial.conditions.values()}
        component_unknowns = {assembly.flat.names[row.name] for row in self.equations.component_rows if self.of_components}
        for k, (j, order) in enumerate(assembly.reduced.states):
            condition = conditions.get(j) if order == 0 else None
            changed = abs(y[k] - self.y0[k]) > 1e-9 * self.nominal[k]
            why = "asked for" if condition and not condition.guess else "solved from a guess" if condition else \
                "initial value of the component" if j in component_unknowns and order == 0 else \
                "shut in: kept" if assembly.state_names[k] in self.shut_in else \
                f"solved ({self.equations.initial.mode or 'conditions'})" if changed or self.equations.steady else \
                "declared start" if assembly.flat.unknowns[j].start else "default"
            table.append(StartLine(assembly.state_names[k], condition.value.text if condition else "", float(point.x[k]),
                                   assembly.flat.unknowns[j].unit.text + ("/s" * order), why))
        table += self._lines_of_other_variables(point, {line.name for line in table})
        for k in self.equations.solved_for:
            parameter = assembly.flat.parameters[k]
            table.append(StartLine(parameter.name, "solve", float(point.p[k]), parameter.unit.text, "solved for"))
        free = tuple(line.name for line in table if line.why == "default")
        return Start(self.t, point.x, point.z, point.p, tuple(table), free, self.steps, self.in_turn, self.of_components)

    def _lines_of_other_variables(self, point: Point, listed: set[str]) -> list[StartLine]:
        """The lines of the table on conditions for variables that are not states."""
        flat = self.assembly.flat
        remaining = [(j, c) for name, c in self.equations.initial.conditions.items()
                     if (j := flat.names.get(name)) is not None and flat.unknowns[j].name not in listed
                     and name not in listed]
        if not remaining:
            return []
        values = self.assembly.values(*point.values()).full().ravel()
        return [StartLine(c.name, c.value.text, float(values[j]), flat.unknowns[j].unit.text,
                          "solved from a guess" if c.guess else "asked for") for j, c in remaining]
