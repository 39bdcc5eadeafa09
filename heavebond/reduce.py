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

import casadi as ca
import numpy as np

from heavebond import explain
from heavebond.flatten import Flat, FlatEquation
from heavebond.incidence import DEFINITE, PARAMETER, classify
from heavebond.index_reduction import Pantelides, collapse, pantelides
from heavebond.states import Column, select_states
from heavebond.structure import block_lower_triangular, maximum_matching, tear
from heavebond.symbols import split, stack


@dataclass(frozen=True)
class Loop:
    """A block of simultaneous equations: its size, what was torn, and how many unknowns were left to the solver."""

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
    (x, z, p, time, rate, measured inputs).
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
    n_equations: int

    def name(self, column: Column) -> str:
        """`crown.x`, or `der(crown.x)` for a derivative."""
        return column_name(self.flat, column)

    def express(self, expression: ca.SX) -> ca.SX:
        """An expression in raw symbols, in terms of (t, x, z, p)."""
        return ca.substitute(expression, self.symbols, self.expressions) if self.symbols.numel() else expression


def column_name(flat: Flat, column: Column) -> str:
    """The name of an unknown or of its derivative."""
    name, order = flat.unknowns[column[0]].name, column[1]
    return name if order == 0 else f"der({name})" if order == 1 else f"der{order}({name})"


def reduce(flat: Flat) -> Reduced:
    """The index-1 model; ModelError with the smallest contradictory part where the structure is singular."""
    columns, rows, derivative = _columns(flat)
    result = _check_and_differentiate(flat, rows, derivative)
    chain = _chains(columns, result)
    system = _System(flat, chain, result)
    states = select_states(flat, result.order, chain.highest, system.p_values)
    return system.solve(states)


Row = tuple[int, int]  # (equation, how often differentiated)


@dataclass(frozen=True)
class _Chain:
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
        raise explain.singular(flat, collapsed, matching)
    result = pantelides(rows, len(derivative), derivative)
    kinked = [i for i, order in enumerate(result.order) if order and flat.equations[i].kink]
    if kinked:
        raise explain.kinked(flat, kinked)
    return result


def _chains(columns: list[Column], result: Pantelides) -> _Chain:
    all_columns: list[Column | None] = [*columns, *[None] * (result.n_columns - len(columns))]
    for k, successor in enumerate(result.derivative):
        if successor >= 0:
            j, order = all_columns[k] or (0, 0)
            all_columns[successor] = (j, order + 1)
    done = [c for c in all_columns if c is not None]
    highest = [0] * (1 + max((j for j, _ in done), default=0))
    for j, order in done:
        highest[j] = max(highest[j], order)
    return _Chain(done, highest)


class _System:
    """All equations with their derivatives, in symbols for all unknowns with their derivatives."""

    def __init__(self, flat: Flat, chain: _Chain, result: Pantelides):
        self.flat, self.chain, self.order = flat, chain, result.order
        top = max(chain.highest, default=0)
        self.levels = [list(level) for level in flat.levels]
        while len(self.levels) <= top + 1:
            k = len(self.levels)
            self.levels.append([ca.SX.sym("d" * k + u.name) for u in flat.unknowns])
        self.constants = {s.element_hash() for s in split(flat.p)}
        self.p_values = np.array([q.value for q in flat.parameters])
        self.residual: dict[Row, ca.SX] = {(i, 0): r for i, r in enumerate(flat.residuals)}
        self._differentiate()

    def symbol(self, column: Column) -> ca.SX:
        return self.levels[column[1]][column[0]]

    def _differentiate(self) -> None:
        """d/dt of the rows that need it, all of one order in one sweep."""
        k = 1
        while rows := [i for i, order in enumerate(self.order) if order >= k]:
            stacked = stack([self.residual[(i, k - 1)] for i in rows])
            low = stack([s for level in self.levels[:-1] for s in level])
            high = stack([s for level in self.levels[1:] for s in level])
            for known in self.flat.inputs:
                low, high = stack([low, known.symbols[:-1]]), stack([high, known.symbols[1:]])
            rates = ca.jtimes(stacked, low, high) + ca.jtimes(stacked, self.flat.time, self.flat.rate)
            for i, rate in zip(rows, split(rates), strict=True):
                self.residual[(i, k)] = rate
            k += 1

    def solve(self, states: list[Column]) -> Reduced:
        known = set(states)
        unknown = [c for c in sorted(self.chain.column) if c not in known]
        rows = list(self.residual)
        entries = self._entries(rows, unknown)
        matching = maximum_matching([[c for c, _ in row] for row in entries], len(unknown))
        if -1 in matching or len(rows) != len(unknown):
            raise explain.singular(self.flat, collapse_rows(self.flat), [-1] * len(self.flat.equations))
        solver = _Solver(self, rows, unknown, entries)
        for block in block_lower_triangular([[c for c, _ in row] for row in entries], matching):
            solver.block(block, [matching[r] for r in block])
        return solver.reduced(states)

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


def collapse_rows(flat: Flat) -> list[list[int]]:
    """The unknowns of each equation whatever their derivatives."""
    n = len(flat.unknowns)
    return [list(dict.fromkeys(c % n for c, _ in row)) for row in flat.entries]


class _Solver:
    """Solves block after block; collects definitions in the order in which they can be evaluated."""

    def __init__(self, system: _System, rows: list[Row], unknown: list[Column],
                 entries: list[list[tuple[int, int]]]):
        self.system, self.rows, self.unknown, self.entries = system, rows, unknown, entries
        self.defined: list[ca.SX] = []
        self.definitions: list[ca.SX] = []
        self.pivots: list[Pivot] = []
        self.torn: list[int] = []
        self.remaining: list[tuple[ca.SX, Row]] = []
        self.loops: list[Loop] = []

    def block(self, rows: list[int], columns: list[int]) -> None:
        cost = {(r, c): kind for r in rows for c, kind in self.entries[r] if kind <= DEFINITE}
        inside = set(columns)
        while True:
            torn = tear({r: [c for c, _ in self.entries[r] if c in inside] for r in rows}, columns, cost)
            solved = [(r, c, *self._explicit(self.system.residual[self.rows[r]], self._symbol(c)))
                      for r, c in torn.sequence]
            bad = [(r, c) for r, c, a, _ in solved if cost[(r, c)] >= PARAMETER and self._zero(a)]
            if not bad:
                break
            for pair in bad:
                del cost[pair]
        left = self._eliminate(solved, list(torn.torn), list(torn.residual)) if torn.torn else []
        self._define(solved)
        if len(rows) > 1 or torn.torn:
            names = tuple(column_name(self.system.flat, self.unknown[c]) for c in torn.torn)
            owners = tuple(dict.fromkeys(self.system.flat.equations[self.rows[r][0]].owner for r in rows))
            self.loops.append(Loop(owners, names, len(left)))

    def _symbol(self, c: int) -> ca.SX:
        return self.system.symbol(self.unknown[c])

    def _explicit(self, residual: ca.SX, symbol: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(a, -b/a) of a residual a*v + b that is linear in v."""
        coefficient = ca.jacobian(residual, symbol)
        rest = ca.substitute(residual, symbol, ca.SX(0))
        return coefficient, -rest / coefficient

    def _zero(self, coefficient: ca.SX) -> bool:
        """Whether a coefficient of parameters alone is zero at their values."""
        symbols = ca.symvar(coefficient)
        if not {s.element_hash() for s in symbols} <= self.system.constants:
            return False
        return float(ca.Function("c", [self.system.flat.p], [coefficient])(self.system.p_values)) == 0

    def _define(self, solved: Sequence[tuple[int, int, ca.SX, ca.SX]]) -> None:
        for r, c, coefficient, value in solved:
            self.defined.append(self._symbol(c))
            self.definitions.append(value)
            if not coefficient.is_constant():
                name = column_name(self.system.flat, self.unknown[c])
                self.pivots.append(Pivot(coefficient, name, self.system.flat.equations[self.rows[r][0]]))

    def _eliminate(self, solved: Sequence[tuple[int, int, ca.SX, ca.SX]], torn: list[int], residual: list[int]
                   ) -> list[int]:
        """Solve the residuals of a torn block for torn unknowns that are linear in them, where that is safe.

        Their definitions come before the block's sequence; what is left stays an algebraic unknown.
        """
        remaining = [self.system.residual[self.rows[r]] for r in residual]
        if solved:
            symbols = [self._symbol(c) for _, c, _, _ in solved]
            remaining = ca.substitute_inplace(symbols, [v for _, _, _, v in solved], remaining, False)[1]
        found: list[tuple[int, int, ca.SX, ca.SX]] = []
        while torn:
            rows = classify(stack(remaining), stack([self._symbol(c) for c in torn]),
                            self.system.constants, self.system.flat.bounds)
            choices = sorted((e.kind, len(row), i, e.column) for i, row in enumerate(rows) for e in row
                             if e.kind <= DEFINITE and not self._zero(e.coefficient))
            if not choices:
                break
            _, _, i, k = choices[0]
            coefficient, value = self._explicit(remaining[i], self._symbol(torn[k]))
            found.append((residual[i], torn[k], coefficient, value))
            symbol = self._symbol(torn[k])
            del remaining[i], residual[i], torn[k]
            remaining = [ca.substitute(r, symbol, value) for r in remaining]
        self._define(found[::-1])
        self.torn += torn
        self.remaining += [(r, self.rows[i]) for r, i in zip(remaining, residual, strict=True)]
        return torn

    def reduced(self, states: list[Column]) -> Reduced:
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
            tuple((i, k) for i, k in enumerate(order) if k), tuple(self.loops), len(self.rows))


