"""Solution of a block lower triangular system: explicit equations, and loops that are torn.

A block of one equation that is linear in its unknown is solved for this unknown. In a larger block, as few
unknowns as possible are guessed, so that the others follow explicitly (tearing). Guessed unknowns are eliminated if an
equation is linear in them; the others remain for the integrator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.equations.flatten import Flat, FlatEquation
from heavebond.equations.lost_rank import Row
from heavebond.equations.sparse_elimination import SAMPLES, Coefficient, eliminate, random_states
from heavebond.equations.state_selection import Column, InitialGuess
from heavebond.equations.tearing import tear
from heavebond.language.external_functions import derivative_along, jacobian, substituted_in_turn
from heavebond.language.incidence import DEFINITE, INDEFINITE, NONLINEAR, NUMBER, PARAMETER, UNIT, classify
from heavebond.language.symbols import split, stack

Array = NDArray[np.float64]
# a coefficient in a loop that is not divided by, as a share of the largest of its equation among unknowns of its unit
WEAK = 1e-7
MODES = 100  # whole numbers of a held variable that are tried at random states, such as stuck or slipping


@dataclass(frozen=True)
class Loop:
    """A block of simultaneous equations: its size, its torn unknowns, and the number of these that the integrator
    iterates."""

    equations: tuple[str, ...]
    torn: tuple[str, ...]
    left: int


@dataclass(frozen=True)
class Pivot:
    """A divisor of an equation; the model is singular if it is zero. If no motion depends on the unknown (`derived`), only
    this unknown is undetermined."""

    coefficient: ca.SX
    unknown: str
    equation: FlatEquation
    derived: bool = False


def column_name(flat: Flat, column: Column) -> str:
    """The name of an unknown or of its derivative."""
    name, order = flat.unknowns[column[0]].name, column[1]
    return name if order == 0 else f"der({name})" if order == 1 else f"der{order}({name})"


class _Solved(NamedTuple):
    """An equation (row) that is linear in an unknown (column), a*v + b = 0: a (None if it is a constant), and the index of v
    = -b/a among the solutions; `dead` if a is 0. A `derived` unknown has no value if a and b are 0."""

    row: int
    column: int
    coefficient: ca.SX | None
    value: int
    dead: bool
    derived: bool = False


@dataclass(eq=False)
class _Block:
    """A loop of equations (rows) for as many unknowns (columns): the pairs (row, column) solved in this order once the
    `guessed` unknowns are known. Of the guessed ones, `eliminated` are solved for as well; for those that are `torn` as many
    equations `residual` remain, with these expressions."""

    rows: list[int]
    columns: list[int]
    sequence: tuple[tuple[int, int], ...] = ()
    guessed: tuple[int, ...] = ()
    torn: list[int] = field(default_factory=list)
    residual: list[int] = field(default_factory=list)
    remaining: list[ca.SX] = field(default_factory=list)
    solved: list[_Solved] = field(default_factory=list)
    eliminated: list[_Solved] = field(default_factory=list)
    linear: list[_Solved] = field(default_factory=list)  # all of it, if it was solved by sparse elimination


def _share_out(residuals: Sequence[ca.SX], blocks: Sequence[_Block]) -> None:
    """Assign to each block as many expressions as it has remaining equations."""
    expressions = iter(residuals)
    for block in blocks:
        block.remaining = [next(expressions) for _ in block.residual]


class BlockSolver:
    """Solves block after block; collects definitions in the order in which they can be evaluated."""

    def __init__(self, flat: Flat, rows: Sequence[Row], unknown: Sequence[Column], residuals: ca.SX,
                 symbols: ca.SX, entries: Sequence[Sequence[tuple[int, int]]], constants: set[int],
                 numbers: Callable[[ca.SX], Array], derived: set[int]):
        """`residuals` are the residuals of the rows, `symbols` the symbols of the unknowns; `entries` gives the unknowns in
        each row and the kinds of their coefficients, `constants` the hashes of symbols, `numbers` values of expressions in
        parameters, `derived` the unknowns (columns) on which no motion depends."""
        self.flat, self.rows, self.unknown, self.entries = flat, rows, unknown, entries
        self.residuals, self.symbols, self.constants, self.numbers = residuals, symbols, constants, numbers
        self.derived = derived
        self.defined: list[int] = []  # columns
        self.sources: list[tuple[int, ...]] = []  # the rows of the block in which each of these is solved for
        self._definitions: list[int] = []  # among the solutions
        self._solutions: list[ca.SX] = []  # columns, which are stacked far faster than their elements
        self._number = 0  # of all in these
        self.pivots: list[Pivot] = []
        self.torn: list[int] = []
        self.remaining: list[tuple[ca.SX, Row]] = []
        self.loops: list[Loop] = []

    @property
    def definitions(self) -> ca.SX:
        """The definitions of the solved unknowns, each in terms of those before it."""
        return self._chosen(self._definitions)

    def _chosen(self, numbers: Sequence[int]) -> ca.SX:
        return ca.densify(ca.vertcat(*self._solutions)[numbers]) if numbers else ca.SX(0, 1)

    def _kept(self, values: ca.SX) -> range:
        """The numbers of these solutions."""
        self._solutions.append(values)
        begin, self._number = self._number, self._number + values.numel()
        return range(begin, self._number)

    def solve(self, blocks: Sequence[tuple[list[int], list[int]]]) -> None:
        """Solve the blocks in the order in which they can be evaluated; each block is given by its rows and its columns.

        A call of CasADi takes longer than its work on one equation. Independent blocks are therefore solved in the same
        calls: blocks of one explicit equation all together, loops stage by stage."""
        pairs = [(rows[0], columns[0]) for rows, columns in blocks if len(rows) == 1]
        explicit = [(r, c) for r, c in pairs
                    if dict(self.entries[r]).get(c, NONLINEAR) <= (INDEFINITE if c in self.derived else DEFINITE)]
        derived = {(r, c) for r, c in explicit if c in self.derived and dict(self.entries[r])[c] > NUMBER}
        alone = {r: solution for (r, _), solution in zip(explicit, self._solve(explicit, derived), strict=True)
                 if solution.derived or not solution.dead}
        loops = {rows[0]: _Block(rows, columns) for rows, columns in blocks if len(rows) > 1 or rows[0] not in alone}
        self._tear(list(loops.values()))
        # groups of loops in which none contains a column of another
        torn_loops = [block for block in loops.values() if block.torn]
        for numbers in self._disjoint([(block.rows, block.columns) for block in torn_loops]):
            self._eliminate([torn_loops[k] for k in numbers])
        self._solve_linear_loops([alone.get(rows[0]) or loops[rows[0]] for rows, _ in blocks])
        for rows, _ in blocks:
            if rows[0] not in loops:
                self._define([alone[rows[0]]], rows)
                continue
            block = loops[rows[0]]
            self._define(block.linear, rows)
            self._define(block.eliminated[::-1], rows)
            self._define(block.solved, rows)
            self.torn += block.torn
            self.remaining += [(r, self.rows[i]) for r, i in zip(block.remaining, block.residual, strict=True)]
            owners = tuple(dict.fromkeys(self.flat.equations[self.rows[r][0]].owner for r in rows))
            self.loops.append(Loop(owners, tuple(column_name(self.flat, self.unknown[c]) for c in block.guessed),
                                   len(block.torn)))

    def _tear(self, blocks: Sequence[_Block]) -> None:
        """Tear the blocks and solve their explicit rows; a coefficient that turns out to be zero is not divided by."""
        weak = self._weak(blocks)
        cost = [{(r, c): kind for r in block.rows for c, kind in self.entries[r] if kind <= DEFINITE and (r, c) not in weak}
                for block in blocks]
        waiting = list(zip(blocks, cost, strict=True))
        while waiting:
            for block, of in waiting:
                inside = set(block.columns)
                torn = tear({r: [c for c, _ in self.entries[r] if c in inside] for r in block.rows}, block.columns, of)
                block.sequence, block.guessed = torn.sequence, torn.torn
                block.torn, block.residual = list(torn.torn), list(torn.residual)
            solved = iter(self._solve([pair for block, _ in waiting for pair in block.sequence]))
            again = []
            for block, of in waiting:
                block.solved = [next(solved) for _ in block.sequence]
                if dead := [(s.row, s.column) for s in block.solved if s.dead]:
                    for pair in dead:
                        del of[pair]
                    again.append((block, of))
            waiting = again

    def _weak(self, blocks: Sequence[_Block]) -> set[tuple[int, int]]:
        """The entries (row, column) of loops that are too small as divisors: the result would be a billion times as large as
        its terms, so that only their rounding remains after a cancellation. The comparison is between unknowns of one unit
        in an equation (the arms of a lever), and between equations for one unit that contain an unknown (the masses on a
        node)."""
        compared = [group for block in blocks for group in self._comparable(block)]
        pairs = list(dict.fromkeys(pair for group in compared for pair in group))
        if not pairs:
            return set()
        slopes: dict[tuple[int, int], ca.SX] = {}
        for together in self._apart(pairs):
            residuals, symbols = self.residuals[[r for r, _ in together]], self.symbols[[c for _, c in together]]
            coefficients = split(derivative_along(residuals, symbols, ca.SX.ones(symbols.numel())))
            slopes.update(zip(together, coefficients, strict=True))
        numbers = np.abs(self.numbers(stack([slopes[pair] for pair in pairs])))
        sizes = dict(zip(pairs, numbers.tolist(), strict=True))
        return {pair for group in compared for pair in group if sizes[pair] < WEAK * max(sizes[entry] for entry in group)}

    def _comparable(self, block: _Block) -> list[list[tuple[int, int]]]:
        """The groups of entries of a loop whose coefficients are compared."""
        inside = set(block.columns)
        entries = [(r, c, kind) for r in block.rows for c, kind in self.entries[r] if kind <= PARAMETER and c in inside]
        units = [(self.unknown[c][1], self.flat.unknowns[self.unknown[c][0]].unit.dimension) for _, c, _ in entries]
        alone: dict[int, set[tuple[object, ...]]] = {}
        for (r, _, kind), unit in zip(entries, units, strict=True):
            if kind == UNIT:
                alone.setdefault(r, set()).add(unit)
        groups: dict[tuple[object, ...], list[int]] = {}
        for k, ((r, c, kind), unit) in enumerate(zip(entries, units, strict=True)):
            groups.setdefault((r, *unit), []).append(k)
            for unit_of_other_term in alone.get(r, ()) if kind != UNIT else ():
                groups.setdefault((c, "beside", *unit_of_other_term), []).append(k)
        return [[entries[k][:2] for k in group] for group in groups.values()
                if len(group) > 1 and any(entries[k][2] != UNIT for k in group)]

    def _solve(self, pairs: Sequence[tuple[int, int]], derived: Set[tuple[int, int]] = frozenset()) -> list[_Solved]:
        """Solve each row for its column, in one call all rows that do not contain the columns of the others. The
        coefficients of `derived` pairs may be zero."""
        solved: dict[int, _Solved] = {}
        for together in self._apart(pairs):
            coefficients, values = explicit(self.residuals[[r for r, _ in together]], self.symbols[[c for _, c in together]],
                                            [k for k, pair in enumerate(together) if pair in derived])
            kinds = [dict(self.entries[r])[c] for r, c in together]
            dead = self._zeros(coefficients, kinds)
            varying = iter(split(coefficients[[k for k, kind in enumerate(kinds) if kind > NUMBER]]))
            for (r, c), kind, v, zero in zip(together, kinds, self._kept(values), dead, strict=True):
                solved[r] = _Solved(r, c, next(varying) if kind > NUMBER else None, v, zero, (r, c) in derived)
        return [solved[r] for r, _ in pairs]

    def _apart(self, pairs: Sequence[tuple[int, int]]) -> list[list[tuple[int, int]]]:
        """The pairs in groups in which no row contains the column of another."""
        return [[pairs[k] for k in group] for group in self._disjoint([((r,), (c,)) for r, c in pairs])]

    def _disjoint(self, parts: Sequence[tuple[Sequence[int], Sequence[int]]]) -> list[list[int]]:
        """The parts (rows, columns), by their numbers, in groups in which the rows of none contain the columns of another;
        first fit, in order."""
        # the parts, their own columns, all columns in their rows
        groups: list[tuple[list[int], set[int], set[int]]] = []
        for k, (rows, columns) in enumerate(parts):
            inside = {column for r in rows for column, _ in self.entries[r]}
            fitting = (g for g in groups if g[2].isdisjoint(columns) and g[1].isdisjoint(inside))
            if (fitting_group := next(fitting, None)) is None:
                groups.append(fitting_group := ([], set(), set()))
            group, rows_of_group, contained = fitting_group
            group.append(k)
            rows_of_group.update(columns)
            contained |= inside
        return [group for group, _, _ in groups]

    def _zeros(self, coefficients: ca.SX, kinds: Sequence[int]) -> list[bool]:
        """True for coefficients of parameters alone that are zero at their values; other kinds are never zero."""
        indices = [k for k, kind in enumerate(kinds) if kind == PARAMETER]
        zero = [False] * len(kinds)
        if indices:
            for k, value in zip(indices, self.numbers(coefficients[indices]), strict=True):
                zero[k] = value == 0
        return zero

    def _define(self, solved: Sequence[_Solved], rows: Sequence[int]) -> None:
        for solution in solved:
            self.defined.append(solution.column)
            self.sources.append(tuple(rows))
            self._definitions.append(solution.value)
            if solution.coefficient is not None and not solution.coefficient.is_constant():
                name = column_name(self.flat, self.unknown[solution.column])
                self.pivots.append(Pivot(solution.coefficient, name, self.flat.equations[self.rows[solution.row][0]],
                                         solution.derived))

    def _eliminate(self, blocks: Sequence[_Block]) -> None:
        """Solve residuals of torn blocks for torn unknowns that occur linearly, if the divisor is safe. One unknown of each
        block is solved for at a time; no block contains columns of another.

        Their definitions precede the sequence of the block; the remaining torn unknowns are algebraic unknowns.
        """
        solved = [s for block in blocks for s in block.solved]
        raw = self.residuals[[r for block in blocks for r in block.residual]]
        if solved:
            values = self._chosen([s.value for s in solved])
            raw, = substituted_in_turn(self.symbols[[s.column for s in solved]], values, [raw])[1]
        _share_out(split(raw), blocks)
        waiting = list(blocks)
        while chosen := self._choices(waiting):
            symbols = self.symbols[[block.torn[k] for block, _, k in chosen]]
            last = [n for n, (block, *_) in enumerate(chosen) if self._is_last(block)]
            coefficients, values = explicit(stack([block.remaining[i] for block, i, _ in chosen]), symbols, last)
            for n, ((block, i, k), a, value) in enumerate(zip(chosen, split(coefficients), self._kept(values), strict=True)):
                block.eliminated.append(_Solved(block.residual[i], block.torn[k], a, value, dead=False, derived=n in last))
                del block.remaining[i], block.residual[i], block.torn[k]
            waiting = [block for block, _, _ in chosen if block.torn]
            _share_out(ca.substitute([r for block in waiting for r in block.remaining], [symbols], [values]), waiting)

    def _solve_linear_loops(self, ordered: Sequence[_Solved | _Block]) -> None:
        """Solve torn loops with frames that are linear in their unknowns by sparse elimination if no divisor vanishes in one
        of many random states. `ordered` are the solutions and loops in the order in which they can be evaluated."""
        loops = [block for block in ordered if isinstance(block, _Block) and block.torn
                 and any(self.flat.unknowns[self.unknown[c][0]].pose for c in block.columns)]
        if not loops:
            return
        waiting = {c for block in loops for c in block.columns}
        before = [s for item in ordered for s in ((item,) if isinstance(item, _Solved) else
                                                  (*item.eliminated[::-1], *item.solved)) if s.column not in waiting]
        known = self.symbols[[s.column for s in before]], self._chosen([s.value for s in before])
        matrices = [jacobian(self.residuals[block.rows], self.symbols[block.columns]) for block in loops]
        coefficients = ca.vertcat(*(ca.densify(matrix.nz[:]) for matrix in matrices))
        (expressed,) = substituted_in_turn(known[0], known[1], [coefficients])[1] if before else (coefficients,)
        # a coefficient that depends on an unknown of a loop cannot be tried at random states
        unsolved = stack([self.symbols[c] for c in sorted({*waiting, *(
            c for item in ordered if isinstance(item, _Block) for c in item.torn)})])
        open_entries = ca.which_depends(expressed, unsolved, 1, True)
        values = self._at_random_states(expressed)
        values = values[:, np.isfinite(values).all(axis=0)]  # a quaternion of zeros, or coinciding points, are no states
        if values.shape[1] < SAMPLES/2:
            return
        first = 0
        for block, matrix in zip(loops, matrices, strict=True):
            entries = range(first, first + matrix.nnz())
            first += matrix.nnz()
            if any(open_entries[k] for k in entries):
                continue
            places = zip(*matrix.sparsity().get_triplet(), strict=True)
            loop_coefficients = {(block.rows[r], block.columns[c]): Coefficient(coefficients[k], values[k])
                                 for (r, c), k in zip(places, entries, strict=True)}
            unknowns = self.symbols[block.columns]
            constants = split(ca.substitute(self.residuals[block.rows], unknowns, ca.SX.zeros(unknowns.numel())))
            sizes = {c: self.flat.unknowns[self.unknown[c][0]].nominal for c in block.columns}
            solutions = eliminate(loop_coefficients, dict(zip(block.rows, constants, strict=True)),
                                  dict(zip(block.columns, split(unknowns), strict=True)), sizes)
            if solutions is None:
                continue
            numbers = self._kept(stack([s.value for s in reversed(solutions)]))
            block.linear = [_Solved(s.row, s.column, s.divisor, number, dead=False)
                            for s, number in zip(reversed(solutions), numbers, strict=True)]
            block.solved, block.eliminated, block.torn, block.residual, block.remaining = [], [], [], [], []

    def _at_random_states(self, expressions: ca.SX) -> Array:
        """The values (n, SAMPLES) of expressions in states, parameters, modes of laws and known functions of time; the first
        state is the initial guess of the diagram."""
        symbols = ca.symvar(expressions)
        if not symbols:
            return np.repeat(np.array(ca.DM(expressions)).reshape(-1, 1), SAMPLES, axis=1)
        unknown_of = {s.element_hash(): u for level in self.flat.levels
                      for s, u in zip(level, self.flat.unknowns, strict=True)}
        parameters = {s.element_hash(): q.value for s, q in zip(split(self.flat.p), self.flat.parameters, strict=True)}
        unknowns = [unknown_of.get(s.element_hash()) for s in symbols]
        values = random_states([-np.inf if u is None else u.low for u in unknowns],
                               [np.inf if u is None else u.high for u in unknowns],
                               [1.0 if u is None else u.nominal for u in unknowns],
                               [u is not None and u.unit.text == "rad" for u in unknowns])
        guess = InitialGuess(self.flat)(np.array([q.value for q in self.flat.parameters]))
        guess_of = {s.element_hash(): value for s, value in zip(self.flat.levels[0], guess.tolist(), strict=True)}
        constants, random = self.flat.constant_hashes, np.random.default_rng(2)
        for k, symbol in enumerate(symbols):
            values[k, 0] = guess_of.get(symbol.element_hash(), 0.0)
            if symbol.element_hash() in parameters:
                values[k] = parameters[symbol.element_hash()]
                low, high = self.flat.bounds.get(symbol.element_hash(), (-np.inf, np.inf))
                if symbol.element_hash() not in constants and high - low < MODES:  # a held variable, a mode of a law
                    values[k, 1:] = random.integers(np.ceil(low), np.floor(high), SAMPLES - 1, endpoint=True)
            elif symbol.element_hash() == self.flat.rate.element_hash():
                values[k] = 1.0
        return np.asarray(ca.Function("samples", [stack(symbols)], [expressions])(values)).reshape(-1, SAMPLES)

    def _is_last(self, block: _Block) -> bool:
        """True if one derived unknown of a block remains, so that the block is singular if its coefficient is zero."""
        return len(block.torn) == 1 and block.torn[0] in self.derived

    def _choices(self, blocks: Sequence[_Block]) -> list[tuple[_Block, int, int]]:
        """The blocks in which a residual can be solved for a torn unknown, with the indices of both; the pair with the
        simplest coefficient."""
        rows = iter(classify(stack([r for block in blocks for r in block.remaining]),
                             self.symbols[[c for block in blocks for c in block.torn]],
                             self.constants, self.flat.bounds))
        entries: list[tuple[_Block, tuple[int, int, int, int], ca.SX]] = []
        first = 0
        for block in blocks:
            row_numbers = [next(rows) for _ in block.remaining]
            entries += [(block, (e.kind, len(row), i, e.column - first), e.coefficient)
                        for i, row in enumerate(row_numbers) for e in row
                        if e.kind <= (INDEFINITE if self._is_last(block) else DEFINITE)]
            first += len(block.torn)
        dead = self._zeros(stack([a for *_, a in entries]), [choice[0] for _, choice, _ in entries])
        best: dict[int, tuple[int, int, int, int]] = {}
        for (block, choice, _), zero in zip(entries, dead, strict=True):
            if not zero or self._is_last(block):
                best[block.rows[0]] = min(choice, best.get(block.rows[0], choice))
        return [(block, *best[block.rows[0]][2:]) for block in blocks if block.rows[0] in best]


def explicit(residuals: ca.SX, symbols: ca.SX, derived: Sequence[int] = ()) -> tuple[ca.SX, ca.SX]:
    """a and -b/a of residuals a*v + b (m,), each linear in its own symbol v (m,) and free of the symbols of the others.
    Those of `derived` unknowns (by number) are not a number where a = b = 0, also if a factor of both cancels in b/a."""
    coefficients = derivative_along(residuals, symbols, ca.SX.ones(symbols.numel()))
    constant = ca.substitute(residuals, symbols, ca.SX.zeros(symbols.numel()))
    values = -constant / coefficients
    for k in derived:
        nothing = np.nan if constant[k].is_zero() else -constant[k] * ca.inf
        values[k] = ca.if_else(coefficients[k] == 0, nothing, values[k])
    return coefficients, values
