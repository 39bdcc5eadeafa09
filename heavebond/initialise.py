"""Consistent initial values: a scaled, damped Newton method of our own, which says what was asked and what was used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from heavebond import reading
from heavebond.dae import Array, Assembly
from heavebond.errors import Place, Problem, Problems, StartError, listing, suggest
from heavebond.expression import ExpressionProblem, parse_formula
from heavebond.model import Condition
from heavebond.states import guess
from heavebond.symbols import split, stack, uniform

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


@dataclass(frozen=True)
class _Row:
    """One equation of the start: its residual, its name for messages, its place."""

    residual: ca.SX
    label: str
    place: Place | None


def start(assembly: Assembly, t: float = 0.0, u: Array | None = None) -> Start:
    """Solve for x, z and the parameters under `solve:`; StartError with the reason where that cannot be.

    Unknowns that no condition decides keep their guess (smallest change in scaled variables); after `start: steady`
    a direction that nothing decides is an error.
    """
    u = np.zeros(assembly.arguments[4].numel()) if u is None else u
    problem = _Initial(assembly, t, u)
    y = problem.solve()
    return problem.finished(y)


@dataclass(frozen=True)
class Tangent:
    """How the start moves with parameters: dx (n_x, m), dz (n_z, m), dp (n_p, m) along m directions."""

    x: Array
    z: Array
    p: Array


def tangent(assembly: Assembly, first: Start, u: Array, directions: Array) -> Tangent:
    """The derivative of the start along `directions` (n_p, m), by the implicit function theorem.

    With F(y, p) = 0 the equations of the start, dy = -F_y^+ F_p dp (the least change in scaled unknowns, as `start`
    takes it: what nothing decides stays). Parameters under `solve:` follow the others.
    """
    problem = _Initial(replace(assembly, p=first.p), first.t, u)
    return problem.tangent(first, directions)


class _Initial:
    def __init__(self, assembly: Assembly, t: float, u: Array):
        self.assembly, self.t, self.u = assembly, t, u
        self.initial = assembly.model.initial
        self.problems = Problems()
        self.n_x, self.n_z = len(assembly.x_nominal), len(assembly.z_nominal)
        self.solved_for = self._solve_indices()
        self.steady = self.initial.mode == "steady"
        self.rows = self._rows()
        self.guesses = [row for c in self.initial.conditions.values() if c.guess
                        and (row := self._condition(c)) is not None]
        self.problems.raise_as(StartError)
        self.nominal = np.concatenate([assembly.x_nominal, assembly.z_nominal, self._parameter_sizes()])
        self.y0 = self._guess()
        self.steps = 0

    # -- what is asked ---------------------------------------------------------------------------------------------
    def _solve_indices(self) -> list[int]:
        names = {name: k for k, name in enumerate(self.assembly.parameter_names)}
        found = []
        for name, place in self.initial.solve.items():
            if name not in names:
                self.problems.add("solve-unknown", f"there is no parameter '{name}' to solve for", place,
                                  hint=suggest(name, names))
            else:
                found.append(names[name])
        return found

    def _parameter_sizes(self) -> Array:
        values = self.assembly.p[self.solved_for]
        usual = {u.unit.dimension: u.nominal for u in self.assembly.flat.unknowns}
        sizes = [usual.get(self.assembly.flat.parameters[k].unit.dimension, 1.0) for k in self.solved_for]
        return np.maximum(np.abs(values), np.array(sizes)) if self.solved_for else np.zeros(0)

    def _rows(self) -> list[_Row]:
        assembly = self.assembly
        rows = [_Row(g, e.label or e.text, e.place) for g, e in zip(
            split(assembly.alg), assembly.reduced.alg_equations, strict=True)]
        for condition in self.initial.conditions.values():
            if not condition.guess and (row := self._condition(condition)) is not None:
                rows.append(row)
        rates = split(assembly.ode)
        for k, (j, order) in enumerate(assembly.reduced.states):
            name = assembly.state_names[k]
            unknown = assembly.flat.unknowns[j]
            if self.steady:
                rows.append(_Row(rates[k], f"steady: der({name}) = 0", unknown.place))
            elif self.initial.mode == "rest" and (unknown.motion or order > 0):
                rows.append(_Row(assembly.arguments[1][k], f"at rest: {name} = 0", unknown.place))
        return rows

    def _condition(self, condition: Condition) -> _Row | None:
        problems = self.problems
        place = condition.place
        tree = reading.parsed(parse_formula, condition.name, place, problems)
        if tree is None:
            return None
        resolver = self.assembly.resolver()
        try:
            wanted = resolver.dimension(tree)
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, place, problems)
            return None
        try:
            given = resolver.dimension(condition.value.expr)
            bare = condition.value.si or given is None
            if not bare and given != wanted:
                raise ExpressionProblem("unit-wrong", f"the initial value of {condition.name} must be in another unit "
                                        f"than '{condition.value.text}'", 0)
            number = self.assembly.flat.constants.get(f"initial.{condition.name}")
            value = self.assembly.expression(condition.value.expr) if number is None or condition.guess else number
            left = self.assembly.expression(tree)
        except ExpressionProblem as problem:
            problems.add(problem.code, problem.message, condition.value.place, hint=problem.hint)
            return None
        return _Row(left - value, f"{condition.name} = {condition.value.text.lstrip('= ')}", place)

    def _guess(self) -> Array:
        flat = self.assembly.flat
        values = guess(flat, self.assembly.p)
        x = [values[j] if order == 0 else 0.0 for j, order in self.assembly.reduced.states]
        z = [values[j] if order == 0 else 0.0 for j, order in self.assembly.reduced.algebraic]
        return np.array([*x, *z, *self.assembly.p[self.solved_for]])

    # -- solving ---------------------------------------------------------------------------------------------------
    def solve(self) -> Array:
        y = self.y0
        if self.guesses:
            soft = [r for r in self.rows if not r.label.startswith("steady")] + self.guesses
            y = self._newton(_System(self, soft), y)[0]
        y = self._search(_System(self, self.rows), y)
        if self.steady:
            self._undetermined(y)
        return self._settle(y)

    def _search(self, system: _System, first: Array) -> Array:
        """Newton from the guess, then from points around it: where a contact is open or a valve shut at the guess, its
        force has no gradient there and Newton's method learns nothing. The first point that leads to a solution wins."""
        best: tuple[float, Array, Array] | None = None
        for attempt in range(ATTEMPTS):
            y = first + self.nominal * self._shift(attempt)
            y, residual = self._newton(system, y)
            if self._good(residual):
                return y
            size = float(np.abs(residual).max()) if np.all(np.isfinite(residual)) else np.inf
            if best is None or size < best[0]:
                best = (size, y, residual)
        assert best is not None
        raise self._failure(best[1], best[2])

    def _shift(self, attempt: int) -> Array:
        """0 first, then deterministic shifts of growing size; only unknowns that were not asked for move."""
        if attempt == 0:
            return np.zeros(len(self.nominal))
        size = 10.0 ** (-3 + (attempt - 1) // 4)
        return size * np.array([2 * uniform(attempt, k) - 1 for k in range(len(self.nominal))])

    def _good(self, residual: Array) -> bool:
        return bool(np.all(np.isfinite(residual)) and (not residual.size or np.abs(residual).max() < 1e-6))

    def _newton(self, system: Callable[[Array], tuple[Array, Array]], y: Array) -> tuple[Array, Array]:
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
                trial = y + length * step * self.nominal
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
        rows = self.rows[: self.n_z]
        system = _System(self, rows, only_z=True)
        z, residual = y[self.n_x:self.n_x + self.n_z], np.zeros(0)
        whole = y.copy()

        def at(values: Array) -> tuple[Array, Array]:
            whole[self.n_x:self.n_x + self.n_z] = values
            return system(whole)

        nominal, self.nominal = self.nominal, self.assembly.z_nominal
        z, residual = self._newton(at, z)
        raw, jacobian = at(z)
        self.nominal = nominal
        whole[self.n_x:self.n_x + self.n_z] = z
        if not self._good(residual):
            raise self._failure(whole, residual, rows)
        self._singular_loop(jacobian, _weights(raw, jacobian))
        return whole

    def tangent(self, first: Start, directions: Array) -> Tangent:
        dp = directions.copy()
        dp[self.solved_for] = 0.0
        y = np.concatenate([first.x, first.z, first.p[self.solved_for]])
        dy = _System(self, self.rows).along(y, dp)
        dp[self.solved_for] = dy[self.n_x + self.n_z:]
        dx, dz = dy[: self.n_x], dy[self.n_x:self.n_x + self.n_z]
        if self.n_z:
            settled = _System(self, self.rows[: self.n_z], only_z=True)
            dz = settled.along(y, dp, dx)
        return Tangent(dx, dz, dp)

    # -- when it cannot be done ------------------------------------------------------------------------------------
    def _failure(self, y: Array, residual: Array, rows: list[_Row] | None = None) -> StartError:
        rows = rows or self.rows
        order = np.argsort(-np.where(np.isfinite(residual), np.abs(residual), np.inf))[:5]
        raw = _System(self, rows)(y)[0]
        bad = [k for k in order if not np.isfinite(residual[k])] or \
            [k for k in order if abs(residual[k]) > 1e-3 * abs(residual[order[0]])]
        notes = [f"{rows[k].label}   off by {raw[k]:.3g} (SI)" for k in bad]
        conflict = self._conflict(y, rows)
        if not np.all(np.isfinite(residual)):
            message, hint = "the start cannot be computed: an equation has no finite value at the first guess", \
                "Give guesses, for example `initial: {name: ~ 1 m}`, away from where it has none."
        elif conflict:
            notes = conflict
            message, hint = "the initial values contradict each other", "Remove one of them, or make it a guess (`~`)."
        else:
            message = "no consistent initial values were found"
            hint = "Give guesses for the variables in these equations, for example `initial: {name: ~ 1 m}`."
        place = rows[int(bad[0])].place if len(bad) else None
        return StartError([Problem("start-failed" if not conflict else "start-contradiction", message, place, hint,
                                   tuple(notes))])

    def _conflict(self, y: Array, rows: list[_Row]) -> list[str]:
        """The equations whose gradients depend on each other while their residuals do not agree."""
        residual, jacobian = _System(self, rows)(y)
        if not np.all(np.isfinite(jacobian)) or not residual.size:
            return []
        weights = _weights(residual, jacobian)
        left, values, _ = np.linalg.svd(jacobian * weights[:, None])
        rank = int((values > 1e-8 * max(values.max(initial=0.0), 1e-300)).sum())
        null = left[:, rank:]
        share = np.abs(null @ (null.T @ (residual * weights)))
        if not null.size or share.max() < 1e-6:
            return []
        return [rows[k].label for k in np.argsort(-share) if share[k] > 0.1 * share.max()][:8]

    def _undetermined(self, y: Array) -> None:
        residual, jacobian = _System(self, [*self.rows, *self.guesses])(y)
        weights = _weights(residual, jacobian)
        _, values, right = np.linalg.svd(jacobian * weights[:, None], full_matrices=True)
        rank = int((values > 1e-10 * max(values.max(initial=0.0), 1e-300)).sum())
        null = right[rank:]
        if not len(null):
            return
        names = [*self.assembly.state_names, *self.assembly.algebraic_names,
                 *(self.assembly.parameter_names[k] for k in self.solved_for)]
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
        assembly = self.assembly
        x, z = y[: self.n_x], y[self.n_x:self.n_x + self.n_z]
        p = assembly.p.copy()
        p[self.solved_for] = y[self.n_x + self.n_z:]
        self._check_pivots(x, z, p)
        table = []
        conditions = {assembly.flat.names.get(c.name, -1): c for c in self.initial.conditions.values()}
        for k, (j, order) in enumerate(assembly.reduced.states):
            asked = conditions.get(j) if order == 0 else None
            moved = abs(y[k] - self.y0[k]) > 1e-9 * self.nominal[k]
            why = "asked for" if asked and not asked.guess else "solved from a guess" if asked else \
                f"solved ({self.initial.mode or 'conditions'})" if moved or self.steady else \
                "declared start" if assembly.flat.unknowns[j].start else "default"
            table.append(StartLine(assembly.state_names[k], asked.value.text if asked else "", float(x[k]),
                                   assembly.flat.unknowns[j].unit.text + ("/s" * order), why))
        for k in self.solved_for:
            parameter = assembly.flat.parameters[k]
            table.append(StartLine(parameter.name, "solve", float(p[k]), parameter.unit.text, "solved for"))
        free = tuple(line.name for line in table if line.why == "default")
        return Start(self.t, x, z, p, tuple(table), free, self.steps)

    def _check_pivots(self, x: Array, z: Array, p: Array) -> None:
        pivots = np.array(self.assembly.pivots(self.t, x, z, p, self.u, 1.0)).ravel()
        rates = np.array(self.assembly.rates(self.t, x, z, p, self.u, 1.0)[0]).ravel()
        problems = Problems()
        for value, pivot in zip(pivots, self.assembly.reduced.pivots, strict=True):
            if value == 0 or not np.isfinite(value):
                equation = pivot.equation
                problems.add("coefficient-zero", f"'{equation.owner}': the coefficient of {pivot.unknown} is "
                             f"{value:g} at the start", equation.place, notes=[equation.text],
                             hint="A mass, volume, area or resistance is zero there; give it a value.")
        if not problems.found:
            for name, value in zip(self.assembly.state_names, rates, strict=True):
                if not np.isfinite(value):
                    problems.add("rate-not-finite", f"der({name}) has no finite value at the start")
        problems.raise_as(StartError)


def _weights(residual: Array, jacobian: Array) -> Array:
    """1 / largest scaled gradient of each row; a row without gradient counts by its own size."""
    gradient = np.abs(jacobian).max(axis=1, initial=0.0)
    return np.asarray(1 / np.where(gradient > 0, gradient, np.maximum(np.abs(residual), 1e-300)))


class _System:
    """Residuals and their Jacobian with respect to the scaled unknowns y = (x, z, solved parameters)."""

    def __init__(self, owner: _Initial, rows: list[_Row], only_z: bool = False):
        assembly = owner.assembly
        t, x, z, p, u, rate = assembly.arguments
        self.owner = owner
        chosen = stack([p[k] for k in owner.solved_for])
        stacked = stack([r.residual for r in rows])
        unknowns = z if only_z else stack([x, z, chosen])
        nominal = assembly.z_nominal if only_z else owner.nominal
        jacobian = ca.jacobian(stacked, unknowns)
        self.rate = 1.0 if only_z or not owner.steady else 0.0
        self.nominal = nominal
        self.function = ca.Function("start", [t, x, z, p, u, rate], [stacked, jacobian])
        self.arguments, self.stacked = (t, x, z, p, u, rate), stacked

    def __call__(self, y: Array) -> tuple[Array, Array]:
        owner = self.owner
        p = owner.assembly.p.copy()
        p[owner.solved_for] = y[owner.n_x + owner.n_z:]
        residual, jacobian = self.function(*self._at(y, p))
        return np.array(residual).ravel(), np.array(jacobian.full()) * self.nominal

    def _at(self, y: Array, p: Array) -> tuple[float, Array, Array, Array, Array, float]:
        owner = self.owner
        return owner.t, y[: owner.n_x], y[owner.n_x:owner.n_x + owner.n_z], p, owner.u, self.rate

    def along(self, y: Array, dp: Array, dx: Array | None = None) -> Array:
        """Change of the unknowns (unscaled) that keeps the residuals at zero while p moves along dp and x along dx."""
        _, x, _, p, _, _ = self.arguments
        moved = ca.jtimes(self.stacked, p, ca.SX(ca.DM(dp)))
        if dx is not None:
            moved += ca.jtimes(self.stacked, x, ca.SX(ca.DM(dx)))
        values = np.array(self.owner.assembly.p)
        values[self.owner.solved_for] = y[self.owner.n_x + self.owner.n_z:]
        right = ca.Function("along", list(self.arguments), [moved])(*self._at(y, values)).full()
        residual, jacobian = self(y)
        if not jacobian.size:
            return np.zeros((jacobian.shape[1], dp.shape[1]))
        weights = _weights(residual, jacobian)[:, None]
        step = np.linalg.lstsq(jacobian * weights, -right * weights, rcond=RANK)[0]
        return np.asarray(step * self.nominal[:, None])
