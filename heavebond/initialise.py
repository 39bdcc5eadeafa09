"""Consistent initial values: a scaled, damped Newton method of our own, which says what was asked and what was used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from heavebond.dae import Array, Assembly
from heavebond.errors import Problem, Problems, StartError, listing
from heavebond.reduce import Pivot
from heavebond.start_equations import Point, StartEquations, StartSystem
from heavebond.symbols import split, stack, uniform

# residuals and Jacobian of scaled unknowns
System = Callable[[Array], tuple[Array, Array]]
MOST_STEPS = 100
# residuals are scaled so that a change of every unknown by its usual size changes each by about one
CONVERGED = 1e-9
# singular values below this share of the largest are directions that nothing decides; nominal values may be off by
# some powers of ten without making a decided direction look like one of these
RANK = 1e-11
ATTEMPTS = 17  # the guess itself, then four shifts each of 0.001, 0.01, 0.1 and 1 nominal size


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


def start(assembly: Assembly, t: float = 0.0, u: Array | None = None, equations: StartEquations | None = None) -> Start:
    """Solve for x, z and the parameters under `solve:`; StartError with the reason where that cannot be.

    Unknowns that no condition decides keep their guess (smallest change in scaled variables); after `start: steady`
    a direction that nothing decides is an error. `equations` are those of the assembly where they are compiled already.
    """
    u = np.zeros(assembly.arguments[4].numel()) if u is None else u
    problem = _Search(equations or StartEquations(assembly), assembly, t, u)
    return problem.finished(problem.solve())


@dataclass(frozen=True)
class Tangent:
    """How the start moves with parameters: dx (n_x, m), dz (n_z, m), dp (n_p, m) along m directions."""

    x: Array
    z: Array
    p: Array


def tangent(equations: StartEquations, first: Start, u: Array, directions: Array) -> Tangent:
    """The derivative of the start along `directions` (n_p, m), by the implicit function theorem.

    With F(y, p) = 0 the equations of the start, dy = -F_y^+ F_p dp (the least change in scaled unknowns, as `start`
    takes it: what nothing decides stays). Parameters under `solve:` follow the others.
    """
    n_x, n_z = len(first.x), len(first.z)
    sizes = equations.sizes(first.p)
    point = Point(first.t, first.x, first.z, first.p, u, 0.0 if equations.steady else 1.0)
    dp = directions.copy()
    dp[equations.solved_for] = 0.0
    dy = _least_change(equations.all.at(point), equations.all.moved(point, dp), sizes)
    dp[equations.solved_for] = dy[n_x + n_z:]
    dx, dz = dy[:n_x], dy[n_x:n_x + n_z]
    if n_z:
        point = replace(point, rate=1.0)
        dz = _least_change(equations.algebraic.at(point), equations.algebraic.moved(point, dp, dx), sizes[n_x:n_x + n_z])
    return Tangent(dx, dz, dp)


def _least_change(at: tuple[Array, Array], moved: Array, sizes: Array) -> Array:
    """The change of the unknowns (n, m) that keeps the residuals while they are moved by (rows, m)."""
    residual, jacobian = at[0], at[1] * sizes
    if not jacobian.size:
        return np.zeros((len(sizes), moved.shape[1]))
    weights = _weights(residual, jacobian)[:, None]
    return np.asarray(np.linalg.lstsq(jacobian * weights, -moved * weights, rcond=RANK)[0] * sizes[:, None])


class _Search:
    """The search for one start: the equations of the assembly at given parameters, time and inputs."""

    def __init__(self, equations: StartEquations, assembly: Assembly, t: float, u: Array):
        self.equations, self.assembly, self.t, self.u = equations, assembly, t, u
        self.n_x, self.n_z = len(assembly.x_nominal), len(assembly.z_nominal)
        self.nominal = equations.sizes(assembly.p)
        self.y0 = self._guess()
        self.steps = 0

    def _guess(self) -> Array:
        values = self.equations.guess(self.assembly.p)
        columns = (*self.assembly.reduced.states, *self.assembly.reduced.algebraic)
        return np.array([*(values[j] if order == 0 else 0.0 for j, order in columns),
                         *self.assembly.p[self.equations.solved_for]])

    def _point(self, y: Array, rate: float | None = None) -> Point:
        p = self.assembly.p.copy()
        p[self.equations.solved_for] = y[self.n_x + self.n_z:]
        still = 0.0 if self.equations.steady else 1.0  # a steady start holds the inputs still
        return Point(self.t, y[: self.n_x], y[self.n_x:self.n_x + self.n_z], p, self.u, still if rate is None else rate)

    def _scaled(self, system: StartSystem) -> System:
        """Residuals and Jacobian in unknowns counted in their usual sizes."""
        def at(y: Array) -> tuple[Array, Array]:
            residual, jacobian = system.at(self._point(y))
            return residual, jacobian * self.nominal
        return at

    # -- solving ---------------------------------------------------------------------------------------------------
    def solve(self) -> Array:
        """(x, z, solved parameters) of a consistent start."""
        y, equations = self.y0, self.equations
        self._check_constants()
        if equations.guesses:
            y = self._newton(self._scaled(equations.approach), y, self.nominal)[0]
        y = self._search(y)
        if equations.steady:
            self._undetermined(y)
        return self._settle(y)

    def _search(self, first: Array) -> Array:
        """Newton from the guess, then from points around it: where a contact is open or a valve shut at the guess, its
        force has no gradient there and Newton's method learns nothing. The first point that leads to a solution wins."""
        system = self._scaled(self.equations.all)
        best: tuple[float, Array, Array] | None = None
        for attempt in range(ATTEMPTS):
            y, residual = self._newton(system, first + self.nominal * self._shift(attempt), self.nominal)
            if self._good(residual):
                return y
            size = float(np.abs(residual).max()) if np.all(np.isfinite(residual)) else np.inf
            if best is None or size < best[0]:
                best = (size, y, residual)
        assert best is not None
        raise self._failure(best[1], best[2], self.equations.all)

    def _shift(self, attempt: int) -> Array:
        """0 first, then deterministic shifts of growing size; only unknowns that were not asked for move."""
        if attempt == 0:
            return np.zeros(len(self.nominal))
        size = 10.0 ** (-3 + (attempt - 1) // 4)
        return size * np.array([2 * uniform(attempt, k) - 1 for k in range(len(self.nominal))])

    def _good(self, residual: Array) -> bool:
        return bool(np.all(np.isfinite(residual)) and (not residual.size or np.abs(residual).max() < 1e-6))

    def _newton(self, system: System, y: Array, sizes: Array) -> tuple[Array, Array]:
        """Gauss-Newton with steps of least norm in scaled unknowns, halved until the residual falls."""
        residual, jacobian = system(y)
        for _ in range(MOST_STEPS):
            if not residual.size or not np.all(np.isfinite(residual)):
                break
            weights = _weights(residual, jacobian)
            scaled, size = residual * weights, float(np.linalg.norm(residual * weights))
            if np.abs(scaled).max() < CONVERGED:
                break
            step = np.linalg.lstsq(jacobian * weights[:, None], -scaled, rcond=RANK)[0]
            length = 1.0
            while length > 1e-10:
                trial = y + length * step * sizes
                new, new_jacobian = system(trial)
                if np.all(np.isfinite(new)) and float(np.linalg.norm(new * weights)) < (1 - 1e-4 * length) * size:
                    break
                length /= 2
            else:
                break
            y, residual, jacobian = trial, new, new_jacobian
            self.steps += 1
        return y, residual * _weights(residual, jacobian) if residual.size else residual

    def _settle(self, y: Array) -> Array:
        """The algebraic unknowns again with the inputs moving (a steady start holds them still), x fixed."""
        if not self.n_z:
            return y
        whole, inner = y.copy(), slice(self.n_x, self.n_x + self.n_z)

        def at(z: Array) -> tuple[Array, Array]:
            whole[inner] = z
            residual, jacobian = self.equations.algebraic.at(self._point(whole, 1.0))
            return residual, jacobian * self.assembly.z_nominal

        z, residual = self._newton(at, y[inner], self.assembly.z_nominal)
        raw, jacobian = at(z)
        if not self._good(residual):
            raise self._failure(whole, residual, self.equations.algebraic)
        self._singular_loop(jacobian, _weights(raw, jacobian))
        return whole

    # -- when it cannot be done ------------------------------------------------------------------------------------
    def _failure(self, y: Array, residual: Array, system: StartSystem) -> StartError:
        rows = system.rows
        order = np.argsort(-np.where(np.isfinite(residual), np.abs(residual), np.inf))[:5]
        raw = system.at(self._point(y))[0]
        bad = [k for k in order if not np.isfinite(residual[k])] or \
            [k for k in order if abs(residual[k]) > 1e-3 * abs(residual[order[0]])]
        notes = [f"{rows[k].label}   off by {raw[k]:.3g} (SI)" for k in bad]
        conflict = self._conflict(y, system)
        if not np.all(np.isfinite(residual)):
            message, hint = "the start cannot be computed: an equation has no finite value at the first guess", \
                "Give guesses, for example `initial: {name: ~ 1 m}`, away from where it has none."
        elif conflict and (zero := self._zero_parameters(conflict, system)):
            notes = conflict
            message, hint = "these equations have no solution at the start", f"{listing(zero)} is 0; give it a value."
        elif conflict:
            notes = conflict
            message, hint = "the initial values contradict each other", "Remove one of them, or make it a guess (`~`)."
        else:
            message = "no consistent initial values were found"
            hint = "Give guesses for the variables in these equations, for example `initial: {name: ~ 1 m}`."
        place = rows[int(bad[0])].place if len(bad) else None
        return StartError([Problem("start-failed" if not conflict else "start-contradiction", message, place, hint,
                                   tuple(notes))])

    def _zero_parameters(self, conflict: list[str], system: StartSystem) -> list[str]:
        """Parameters that are zero in the components whose own equations take part in the conflict."""
        loops = {row.label: e.owner for row, e in zip(
            self.equations.loops, self.assembly.reduced.alg_equations, strict=True)}
        owners = {loops[label] for label in conflict if label in loops}
        return [n for n, v in self.assembly.parameter_values.items() if v == 0 and n.rpartition(".")[0] in owners]

    def _conflict(self, y: Array, system: StartSystem) -> list[str]:
        """The equations whose gradients depend on each other while their residuals do not agree."""
        residual, jacobian = system.at(self._point(y))
        if not np.all(np.isfinite(jacobian)) or not residual.size:
            return []
        jacobian = jacobian * (self.nominal if jacobian.shape[1] == len(self.nominal) else self.assembly.z_nominal)
        weights = _weights(residual, jacobian)
        left, values, _ = np.linalg.svd(jacobian * weights[:, None])
        rank = int((values > 1e-8 * max(values.max(initial=0.0), 1e-300)).sum())
        null = left[:, rank:]
        share = np.abs(null @ (null.T @ (residual * weights)))
        if not null.size or share.max() < 1e-6:
            return []
        return [system.rows[k].label for k in np.argsort(-share) if share[k] > 0.1 * share.max()][:8]

    def _undetermined(self, y: Array) -> None:
        residual, jacobian = self._scaled(self.equations.with_guesses)(y)
        weights = _weights(residual, jacobian)
        _, values, right = np.linalg.svd(jacobian * weights[:, None], full_matrices=True)
        rank = int((values > 1e-10 * max(values.max(initial=0.0), 1e-300)).sum())
        null = right[rank:]
        if not len(null):
            return
        names = [*self.assembly.state_names, *self.assembly.algebraic_names,
                 *(self.assembly.parameter_names[k] for k in self.equations.solved_for)]
        notes, suggestions = [], []
        for direction in null:
            share = np.abs(direction)
            involved = [names[k] for k in np.argsort(-share) if share[k] > 0.1 * share.max()]
            notes.append(f"one of: {listing(involved, 6)}")
            suggestions.append(next((i for i in involved if i not in suggestions), involved[0]))
        unit = {u.name: u.unit.text for u in self.assembly.flat.unknowns}
        hint = "Decide " + ("it" if len(null) == 1 else "them") + ", for example `initial: {" + ", ".join(
            f"{s}: 0 {unit.get(s, '')}".rstrip() for s in suggestions) + "}`, or give guesses (`~ 0 m`)."
        raise StartError([Problem(
            "start-undetermined", f"the steady state is not unique: {len(null)} direction"
            f"{'s' if len(null) > 1 else ''} stay{'s' if len(null) == 1 else ''} undetermined", None, hint,
            tuple(notes))])

    def _singular_loop(self, jacobian: Array, weights: Array) -> None:
        _, values, right = np.linalg.svd(jacobian * weights[:, None])
        if values.min() > 1e-13 * values.max():
            return
        share = np.abs(right[-1])
        names = [self.assembly.algebraic_names[k] for k in np.argsort(-share) if share[k] > 0.1 * share.max()]
        equations = [f"{e.owner}: {e.text}" for e in self.assembly.reduced.alg_equations][:6]
        raise StartError([Problem(
            "loop-singular", f"nothing decides {listing(names, 6)} at the start", None,
            "A closed valve, a resistance of zero or a circuit without reference does this. Add what decides it: a "
            "Tank, a Volume, a small leakage, a Fixed.", tuple(equations))])

    # -- the answer ------------------------------------------------------------------------------------------------
    def finished(self, y: Array) -> Start:
        """The start with its table asked / used / why; StartError where a coefficient is zero there."""
        assembly = self.assembly
        x, z = y[: self.n_x], y[self.n_x:self.n_x + self.n_z]
        p = assembly.p.copy()
        p[self.equations.solved_for] = y[self.n_x + self.n_z:]
        self._check_pivots(x, z, p)
        table = []
        conditions = {assembly.flat.names.get(c.name, -1): c for c in self.equations.initial.conditions.values()}
        for k, (j, order) in enumerate(assembly.reduced.states):
            asked = conditions.get(j) if order == 0 else None
            moved = abs(y[k] - self.y0[k]) > 1e-9 * self.nominal[k]
            why = "asked for" if asked and not asked.guess else "solved from a guess" if asked else \
                f"solved ({self.equations.initial.mode or 'conditions'})" if moved or self.equations.steady else \
                "declared start" if assembly.flat.unknowns[j].start else "default"
            table.append(StartLine(assembly.state_names[k], asked.value.text if asked else "", float(x[k]),
                                   assembly.flat.unknowns[j].unit.text + ("/s" * order), why))
        for k in self.equations.solved_for:
            parameter = assembly.flat.parameters[k]
            table.append(StartLine(parameter.name, "solve", float(p[k]), parameter.unit.text, "solved for"))
        free = tuple(line.name for line in table if line.why == "default")
        return Start(self.t, x, z, p, tuple(table), free, self.steps)

    def _check_constants(self) -> None:
        """Coefficients of parameters alone that are zero: a mass or stiffness of 0 is told before anything is solved."""
        known = {s.element_hash() for s in split(self.assembly.flat.p)}
        constant = [q for q in self.assembly.reduced.pivots if {s.element_hash() for s in ca.symvar(q.coefficient)} <= known]
        values = ca.Function("c", [self.assembly.flat.p], [stack([q.coefficient for q in constant])])(self.assembly.p)
        problems = Problems()
        for pivot, value in zip(constant, np.array(values).ravel(), strict=True):
            if value == 0 or not np.isfinite(value):
                self._zero(pivot, float(value), problems)
        problems.raise_as(StartError)

    def _zero(self, pivot: Pivot, value: float, problems: Problems) -> None:
        equation = pivot.equation
        symbols = [s.name() for s in ca.symvar(pivot.coefficient)]
        at_zero = [n for n in symbols if n in self.assembly.parameter_names and self.assembly.parameter_values[n] == 0]
        cause = f"{listing(at_zero)} is 0" if at_zero else "a mass, volume, area or resistance is zero there"
        problems.add("coefficient-zero", f"'{equation.owner}': the coefficient of {pivot.unknown} is {value:g} at the start",
                     equation.place, notes=[equation.text], hint=f"{cause[:1].upper()}{cause[1:]}; give it a value.")

    def _check_pivots(self, x: Array, z: Array, p: Array) -> None:
        pivots = np.array(self.assembly.pivots(self.t, x, z, p, self.u, 1.0)).ravel()
        rates = np.array(self.assembly.rates(self.t, x, z, p, self.u, 1.0)[0]).ravel()
        problems = Problems()
        for value, pivot in zip(pivots, self.assembly.reduced.pivots, strict=True):
            if value == 0 or not np.isfinite(value):
                self._zero(pivot, float(value), problems)
        if not problems.found:
            for name, value in zip(self.assembly.state_names, rates, strict=True):
                if not np.isfinite(value):
                    problems.add("rate-not-finite", f"der({name}) has no finite value at the start")
        problems.raise_as(StartError)


def _weights(residual: Array, jacobian: Array) -> Array:
    """1 / largest scaled gradient of each row; a row without gradient counts by its own size."""
    gradient = np.abs(jacobian).max(axis=1, initial=0.0)
    return np.asarray(1 / np.where(gradient > 0, gradient, np.maximum(np.abs(residual), 1e-300)))
