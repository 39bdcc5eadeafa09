"""From the flat model to an index-1 model with few unknowns: index reduction, state selection, BLT, tearing.

    1. structural check and Pantelides' method say how often each equation is differentiated;
    2. of each differentiated constraint, as many derivatives become algebraic (dummy derivatives) as it has equations;
       what remains are the states;
    3. the rest is put in block lower triangular form; a block of one is solved for its unknown, a loop is torn;
    4. what can be solved explicitly is substituted: x' = f(t, x, z, p), 0 = g(t, x, z, p) with few or no z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError
from heavebond.equations import structural_messages
from heavebond.equations.flatten import Flat, FlatEquation
from heavebond.equations.index_reduction import Pantelides, collapse, pantelides
from heavebond.equations.lost_rank import Row, Simultaneous, losses
from heavebond.equations.matching import block_lower_triangular, maximum_matching
from heavebond.equations.state_selection import Column, Constraints, InitialGuess, constraints, select_states
from heavebond.equations.tearing import tear
from heavebond.language.incidence import DEFINITE, NONLINEAR, PARAMETER, UNIT, classify
from heavebond.language.symbols import split, stack, uniform

# a coefficient in a loop that is not divided by, as a share of the largest of its equation among unknowns of its unit
WEAK = 1e-7


@dataclass(frozen=True)
class Loop:
    """A block of simultaneous equations: its size, what was torn, and how many of these the integrator iterates."""

    equations: tuple[str, ...]
    torn: tuple[str, ...]
    left: int


@dataclass(frozen=True)
class Pivot:
    """A coefficient that an equation was divided by; the model is singular where it is zero."""

    coefficient: ca.SX
    unknown: str
    equation: FlatEquation


@dataclass(frozen=True)
class Reduced:
    """x' = ode(t, x, z, p), 0 = alg(t, x, z, p); every other unknown is an expression in these.

    `symbols` and `expressions` map each raw symbol of the flat model (unknowns and their derivatives) to SX in
    (x, z, p, time, rate, measured inputs); `system` is what was solved, as it stood before.
    """

    flat: Flat
    states: tuple[Column, ...]
    algebraic: tuple[Column, ...]
    x: ca.SX
    z: ca.SX
    ode: ca.SX
    alg: ca.SX
    alg_equations: tuple[FlatEquation, ...]
    symbols: ca.SX
    expressions: ca.SX
    pivots: tuple[Pivot, ...]
    index: int
    differentiated: tuple[tuple[int, int], ...]
    loops: tuple[Loop, ...]
    system: Simultaneous
    choices: System

    def name(self, column: Column) -> str:
        """`crown.x`, or `der(crown.x)` for a derivative."""
        return column_name(self.flat, column)

    def express(self, expression: ca.SX) -> ca.SX:
        """An expression in raw symbols, in terms of (t, x, z, p)."""
        used = [self._place[h] for s in ca.symvar(expression) if (h := s.element_hash()) in self._place]
        if not used:
            return expression
        if 2 * len(used) > len(self._place):
            return ca.substitute(expression, self.symbols, self.expressions)
        # what is not there need not be looked at: the formula of a signal has two or three of a thousand symbols
        return ca.substitute(expression, self.symbols[used], self.expressions[used])

    @cached_property
    def _place(self) -> dict[int, int]:
        """Where each of the symbols stands, by its hash."""
        return {s.element_hash(): k for k, s in enumerate(split(self.symbols))}


def column_name(flat: Flat, column: Column) -> str:
    """The name of an unknown or of its derivative."""
    name, order = flat.unknowns[column[0]].name, column[1]
    return name if order == 0 else f"der({name})" if order == 1 else f"der{order}({name})"


def reduce(flat: Flat) -> Reduced:
    """The index-1 model; ModelError with the smallest contradictory part where the structure is singular."""
    columns, rows, derivative = _columns(flat)
    result = _check_and_differentiate(flat, rows, derivative)
    chain = _chains(columns, result)
    system = _system(flat, chain, result)
    return system.solve(select_states(system.constraints, system.p_values))


@dataclass(frozen=True)
class Chain:
    """Every column as (unknown, order), and the highest order of each unknown."""

    column: list[Column]
    highest: list[int]


def _columns(flat: Flat) -> tuple[list[Column], list[list[int]], list[int]]:
    """Columns for unknowns and for the derivatives that occur (with the ones between), and the rows in them."""
    n = len(flat.unknowns)
    columns: list[Column] = [(j, 0) for j in range(n)]
    number = {column: k for k, column in enumerate(columns)}
    derivative = [-1] * n
    rows = []
    for entries in flat.entries:
        row = []
        for packed, _ in entries:
            order, j = divmod(packed, n)
            for k in range(1, order + 1):
                if (j, k) not in number:
                    number[(j, k)] = len(columns)
                    derivative[number[(j, k - 1)]] = len(columns)
                    columns.append((j, k))
                    derivative.append(-1)
            row.append(number[(j, order)])
        rows.append(row)
    return columns, rows, derivative


def _check_and_differentiate(flat: Flat, rows: list[list[int]], derivative: list[int]) -> Pantelides:
    collapsed = collapse(rows, derivative)
    matching = maximum_matching(collapsed, len(flat.unknowns))
    if -1 in matching or len(rows) != len(flat.unknowns):
        raise structural_messages.singular(flat, collapsed, matching)
    result = pantelides(rows, len(derivative), derivative)
    kinked = [i for i, order in enumerate(result.order) if order and flat.equations[i].kink]
    if kinked:
        raise structural_messages.kinked(flat, kinked)
    return result


def _chains(columns: list[Column], result: Pantelides) -> Chain:
    all_columns: list[Column | None] = [*columns, *[None] * (result.n_columns - len(columns))]
    for k, successor in enumerate(result.derivative):
        if successor >= 0:
            j, order = all_columns[k] or (0, 0)
            all_columns[successor] = (j, order + 1)
    done = [c for c in all_columns if c is not None]
    highest = [0] * (1 + max((j for j, _ in done), default=0))
    for j, order in done:
        highest[j] = max(highest[j], order)
    return Chain(done, highest)


@dataclass(frozen=True)
class System:
    """All equations with their derivatives, in symbols for all unknowns with their derivatives; `constraints` are those
    that were differentiated. It can be solved for several choices of states, in the same symbols."""

    flat: Flat
    chain: Chain
    order: tuple[int, ...]
    levels: list[list[ca.SX]]
    residual: dict[Row, ca.SX]
    constraints: Constraints

    @cached_property
    def constants(self) -> set[int]:
        """The hashes of the symbols that never change during a run."""
        return self.flat.constant_hashes

    @cached_property
    def p_values(self) -> NDArray[np.float64]:
        """The values of the parameters."""
        return np.array([q.value for q in self.flat.parameters])

    @cached_property
    def _value_of(self) -> dict[int, float]:
        """The values of the parameters by the hashes of their symbols."""
        return {s.element_hash(): float(v) for s, v in zip(split(self.flat.p), self.p_values, strict=True)}

    def numbers(self, expressions: ca.SX) -> NDArray[np.float64]:
        """The values (n,) of expressions in parameters alone. Given are the few parameters that occur: a function of all
        parameters for each loop would make the work grow with the square of the number of loops."""
        symbols = ca.symvar(expressions)
        given = [self._value_of[s.element_hash()] for s in symbols]
        return np.asarray(ca.Function("numbers", [stack(symbols)], [expressions])(given)).ravel()

    def symbol(self, column: Column) -> ca.SX:
        return self.levels[column[1]][column[0]]

    def solve(self, states: list[Column]) -> Reduced:
        """x' = f(t, x, z, p), 0 = g(t, x, z, p) for these states (their number is given by the constraints)."""
        known = set(states)
        unknown = [c for c in sorted(self.chain.column) if c not in known]
        rows = list(self.residual)
        entries = self._entries(rows, unknown)
        matching = maximum_matching([[c for c, _ in row] for row in entries], len(unknown))
        system = Simultaneous(self.flat, tuple(rows), tuple(unknown), stack([self.residual[row] for row in rows]),
                              stack([self.symbol(c) for c in unknown]))
        if -1 in matching or len(rows) != len(unknown):
            raise self._lost(system)
        solver = _Solver(self, rows, unknown, entries)
        blocks = block_lower_triangular([[c for c, _ in row] for row in entries], matching)
        solver.solve_alone([(block[0], matching[block[0]]) for block in blocks if len(block) == 1])
        for block in blocks:
            solver.block(block, [matching[r] for r in block])
        reduced = solver.reduced(states, system)
        if ca.sprank(ca.sparsify(ca.jacobian(reduced.alg, reduced.z))) < reduced.z.numel():
            raise self._lost(system)  # terms that cancel whatever the numbers: a circuit of differences without reference
        return reduced

    def _lost(self, system: Simultaneous) -> ModelError:
        """The error for equations that depend on each other at the first guess already."""
        guess = InitialGuess(self.flat)(self.p_values)
        point = dict(self._value_of)
        for j, (symbol, unknown) in enumerate(zip(self.flat.levels[0], self.flat.unknowns, strict=True)):
            point[symbol.element_hash()] = float(guess[j]) or 0.1 * unknown.nominal * (0.5 + uniform(3, j))
        point |= self._plain_numbers()
        problems = structural_messages.lost(self.flat, losses(system, point))
        return ModelError(problems) if problems else \
            structural_messages.singular(self.flat, collapse_rows(self.flat), [-1] * len(self.flat.equations))

    def _plain_numbers(self) -> dict[int, float]:
        """What an equation alone says, `u = 0` of a valve that the diagram shuts for good, by the hash of its symbol."""
        known = {s.element_hash() for s in self.flat.levels[0]}
        # two equations may speak of the same unknown, as those of a source with both ends on one node do: the first counts
        alone = {inside[0].element_hash(): (r, inside[0]) for r in reversed(self.flat.residuals)
                 if len(inside := ca.symvar(r)) == 1 and inside[0].element_hash() in known}
        if not alone:
            return {}
        residuals, symbols = (stack(list(column)) for column in zip(*alone.values(), strict=True))
        both = ca.Function("alone", [symbols], [residuals, ca.sum2(ca.jacobian(residuals, symbols))])
        values, slopes = (np.array(v).ravel() for v in both(0))
        return {s: -float(value / slope) for s, value, slope in zip(alone, values, slopes, strict=True)
                if slope and np.isfinite(value)}

    def _entries(self, rows: list[Row], unknown: list[Column]) -> list[list[tuple[int, int]]]:
        """(position in `unknown`, kind) of each row; those of the given equations are known from the templates."""
        n = len(self.flat.unknowns)
        position = {column: k for k, column in enumerate(unknown)}
        entries: list[list[tuple[int, int]]] = []
        for i, k in rows:
            found = self.flat.entries[i] if k == 0 else []
            entries.append([(position[(c % n, c // n)], kind) for c, kind in found if (c % n, c // n) in position])
        derived = [r for r, (_, k) in enumerate(rows) if k > 0]
        if derived:
            stacked = stack([self.residual[rows[r]] for r in derived])
            symbols = stack([self.symbol(c) for c in unknown])
            for r, row in zip(derived, classify(stacked, symbols, self.constants, self.flat.bounds), strict=True):
                entries[r] = [(e.column, e.kind) for e in row]
        return entries


def _system(flat: Flat, chain: Chain, result: Pantelides) -> System:
    """The equations with the derivatives of those that need it, all of one order in one sweep."""
    top = max(chain.highest, default=0)
    levels = [list(level) for level in flat.levels]
    while len(levels) <= top + 1:
        levels.append([ca.SX.sym("d" * len(levels) + u.name) for u in flat.unknowns])
    residual: dict[Row, ca.SX] = {(i, 0): r for i, r in enumerate(flat.residuals)}
    k = 1
    while rows := [i for i, order in enumerate(result.order) if order >= k]:
        stacked = stack([residual[(i, k - 1)] for i in rows])
        low, high = (stack([s for level in part for s in level]) for part in (levels[:-1], levels[1:]))
        for known in flat.inputs:
            low, high = stack([low, known.symbols[:-1]]), stack([high, known.symbols[1:]])
        rates = ca.jtimes(stacked, low, high) + ca.jtimes(stacked, flat.time, flat.rate)
        for i, rate in zip(rows, split(rates), strict=True):
            residual[(i, k)] = rate
        k += 1
    return System(flat, chain, result.order, levels, residual, constraints(flat, result.order, chain.highest))


def collapse_rows(flat: Flat) -> list[list[int]]:
    """The unknowns of each equation whatever their derivatives."""
    n = len(flat.unknowns)
    return [list(dict.fromkeys(c % n for c, _ in row)) for row in flat.entries]


@dataclass(frozen=True)
class _Solved:
    """An equation (row) that is linear in an unknown (column), a*v + b = 0: a and v = -b/a; `dead` where a is 0."""

    row: int
    column: int
    coefficient: ca.SX
    value: ca.SX
    dead: bool


class _Solver:
    """Solves block after block; collects definitions in the order in which they can be evaluated."""

    def __init__(self, system: System, rows: list[Row], unknown: list[Column],
                 entries: list[list[tuple[int, int]]]):
        self.system, self.rows, self.unknown, self.entries = system, rows, unknown, entries
        self.alone: dict[tuple[int, int], _Solved] = {}
        self.defined: list[ca.SX] = []
        self.definitions: list[ca.SX] = []
        self.pivots: list[Pivot] = []
        self.torn: list[int] = []
        self.remaining: list[tuple[ca.SX, Row]] = []
        self.loops: list[Loop] = []

    def solve_alone(self, pairs: list[tuple[int, int]]) -> None:
        """Solve the (row, column) that are a block by themselves, where they can be, all of them together."""
        explicit = [(r, c) for r, c in pairs if self._kinds(r).get(c, NONLINEAR) <= DEFINITE]
        self.alone = dict(zip(explicit, self._solve(explicit), strict=True))

    def block(self, rows: list[int], columns: list[int]) -> None:
        if len(rows) == 1 and (found := self.alone.get((rows[0], columns[0]))) and not found.dead:
            self._define([found])
            return
        cost = {(r, c): kind for r in rows for c, kind in self.entries[r] if kind <= DEFINITE}
        inside = set(columns)
        for weak in self._weak(rows, inside):
            del cost[weak]
        while True:
            torn = tear({r: [c for c, _ in self.entries[r] if c in inside] for r in rows}, columns, cost)
            solved = self._solve(torn.sequence)
            dead = [s for s in solved if s.dead]
            if not dead:
                break
            for pair in dead:
                del cost[(pair.row, pair.column)]
        left = self._eliminate(solved, list(torn.torn), list(torn.residual)) if torn.torn else []
        self._define(solved)
        names = tuple(column_name(self.system.flat, self.unknown[c]) for c in torn.torn)
        owners = tuple(dict.fromkeys(self.system.flat.equations[self.rows[r][0]].owner for r in rows))
        self.loops.append(Loop(owners, names, len(left)))

    def _weak(self, rows: Sequence[int], inside: set[int]) -> list[tuple[int, int]]:
        """The entries (row, column) of a loop that are not divided by: what follows would be a billion times as large as
        what it follows from, and its rounding all that is left where it cancels. Compared are unknowns of one unit in an
        equation (the arms of a lever), and an unknown in equations for others of one unit (the masses on a node)."""
        entries = [(r, c, kind) for r in rows for c, kind in self.entries[r] if kind <= PARAMETER and c in inside]
        units = [(self.unknown[c][1], self.system.flat.unknowns[self.unknown[c][0]].unit.dimension) for _, c, _ in entries]
        alone: dict[int, set[tuple[object, ...]]] = {}
        for (r, _, kind), unit in zip(entries, units, strict=True):
            if kind == UNIT:
                alone.setdefault(r, set()).add(unit)
        groups: dict[tuple[object, ...], list[int]] = {}
        for k, ((r, c, kind), unit) in enumerate(zip(entries, units, strict=True)):
            groups.setdefault((r, *unit), []).append(k)
            for other in alone.get(r, ()) if kind != UNIT else ():
                groups.setdefault((c, "beside", *other), []).append(k)
        several = [group for group in groups.values() if len(group) > 1 and any(entries[k][2] != UNIT for k in group)]
        if not several:
            return []
        slopes = stack([ca.jacobian(self.system.residual[self.rows[r]], self._symbol(c)) for r, c, _ in entries])
        sizes = np.abs(self.system.numbers(slopes))
        weak = {k for group in several for k in group if sizes[k] < WEAK * sizes[group].max()}
        return [entries[k][:2] for k in sorted(weak)]

    def _symbol(self, c: int) -> ca.SX:
        return self.system.symbol(self.unknown[c])

    def _kinds(self, r: int) -> dict[int, int]:
        return dict(self.entries[r])

    def _solve(self, pairs: Sequence[tuple[int, int]]) -> list[_Solved]:
        """Each row solved for its column. A call of CasADi takes longer than its work on one equation, so rows are
        solved together that contain none of each other's columns."""
        solved: dict[int, _Solved] = {}
        for together in self._apart(pairs):
            coefficients, values = explicit(stack([self.system.residual[self.rows[r]] for r, _ in together]),
                                            stack([self._symbol(c) for _, c in together]))
            dead = self._zeros(coefficients, [self._kinds(r)[c] for r, c in together])
            for (r, c), a, v, zero in zip(together, split(coefficients), split(values), dead, strict=True):
                solved[r] = _Solved(r, c, a, v, zero)
        return [solved[r] for r, _ in pairs]

    def _apart(self, pairs: Sequence[tuple[int, int]]) -> list[list[tuple[int, int]]]:
        """The pairs in groups in which no row contains the column of another; first fit, in order."""
        # the pairs, the columns solved for, all columns in the rows
        groups: list[tuple[list[tuple[int, int]], set[int], set[int]]] = []
        for r, c in pairs:
            inside = {column for column, _ in self.entries[r]}
            fitting = (g for g in groups if c not in g[2] and g[1].isdisjoint(inside))
            if (found := next(fitting, None)) is None:
                groups.append(found := ([], set(), set()))
            group, solved, contained = found
            group.append((r, c))
            solved.add(c)
            contained |= inside
        return [group for group, _, _ in groups]

    def _zeros(self, coefficients: ca.SX, kinds: Sequence[int]) -> list[bool]:
        """Which coefficients of parameters alone are zero at their values; the other kinds cannot be."""
        which = [k for k, kind in enumerate(kinds) if kind == PARAMETER]
        zero = [False] * len(kinds)
        if which:
            for k, value in zip(which, self.system.numbers(coefficients[which]), strict=True):
                zero[k] = value == 0
        return zero

    def _define(self, solved: Sequence[_Solved]) -> None:
        for found in solved:
            self.defined.append(self._symbol(found.column))
            self.definitions.append(found.value)
            if not found.coefficient.is_constant():
                name = column_name(self.system.flat, self.unknown[found.column])
                self.pivots.append(Pivot(found.coefficient, name, self.system.flat.equations[self.rows[found.row][0]]))

    def _eliminate(self, solved: Sequence[_Solved], torn: list[int], residual: list[int]) -> list[int]:
        """Solve the residuals of a torn block for torn unknowns that are linear in them, where that is safe.

        Their definitions come before the block's sequence; what is left stays an algebraic unknown.
        """
        remaining = [self.system.residual[self.rows[r]] for r in residual]
        if solved:
            symbols = [self._symbol(s.column) for s in solved]
            remaining = ca.substitute_inplace(symbols, [s.value for s in solved], remaining, False)[1]
        found: list[_Solved] = []
        while torn:
            rows = classify(stack(remaining), stack([self._symbol(c) for c in torn]),
                            self.system.constants, self.system.flat.bounds)
            entries = [(i, len(row), e) for i, row in enumerate(rows) for e in row if e.kind <= DEFINITE]
            dead = self._zeros(stack([e.coefficient for _, _, e in entries]), [e.kind for _, _, e in entries])
            choices = sorted((e.kind, length, i, e.column) for (i, length, e), zero in zip(entries, dead, strict=True)
                             if not zero)
            if not choices:
                break
            _, _, i, k = choices[0]
            symbol = self._symbol(torn[k])
            coefficient, value = explicit(remaining[i], symbol)
            found.append(_Solved(residual[i], torn[k], coefficient, value, dead=False))
            del remaining[i], residual[i], torn[k]
            remaining = [ca.substitute(r, symbol, value) for r in remaining]
        self._define(found[::-1])
        self.torn += torn
        self.remaining += [(r, self.rows[i]) for r, i in zip(remaining, residual, strict=True)]
        return torn

    def reduced(self, states: list[Column], system: Simultaneous) -> Reduced:
        flat, symbol = self.system.flat, self.system.symbol
        x = stack([symbol(s) for s in states])
        z = stack([self._symbol(c) for c in self.torn])
        rates = [symbol((j, k + 1)) for j, k in states]
        piggyback = [stack(rates), stack([r for r, _ in self.remaining]),
                     stack([p.coefficient for p in self.pivots])]
        if self.defined:
            expressions, others = ca.substitute_inplace(self.defined, self.definitions, piggyback, False)
        else:
            expressions, others = [], piggyback
        pivots = tuple(Pivot(c, p.unknown, p.equation)
                       for c, p in zip(split(others[2]), self.pivots, strict=True))
        order = self.system.order
        algebraic = [j for j, top in enumerate(self.system.chain.highest) if top == 0]
        return Reduced(
            flat, tuple(states), tuple(self.unknown[c] for c in self.torn), x, z, others[0], others[1],
            tuple(flat.equations[row[0]] for _, row in self.remaining), stack(self.defined),
            stack(expressions), pivots, max(order, default=0) + (1 if algebraic else 0),
            tuple((i, k) for i, k in enumerate(order) if k), tuple(self.loops), system,
            self.system)


def explicit(residuals: ca.SX, symbols: ca.SX) -> tuple[ca.SX, ca.SX]:
    """a and -b/a of residuals a*v + b (m,), each linear in its own symbol v (m,) and free of the others'."""
    coefficients = ca.jtimes(residuals, symbols, ca.SX.ones(symbols.numel()))
    rest = ca.substitute(residuals, symbols, ca.SX.zeros(symbols.numel()))
    return coefficients, -rest / coefficients
