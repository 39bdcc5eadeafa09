"""From the flat model to an index-1 model with few unknowns: index reduction, state selection, triangular form, tearing.

1. structural check and Pantelides' method determine the number of differentiations of each equation;
2. of each differentiated constraint, as many derivatives become algebraic (dummy derivatives) as it has equations;
   the others are the states;
3. the remaining equations are permuted to block lower triangular form; a block of one is solved for its unknown, a loop is
   torn;
4. explicit solutions are substituted: x' = f(t, x, z, p), 0 = g(t, x, z, p) with few or no z.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError
from heavebond.equations import structural_messages
from heavebond.equations.block_solver import BlockSolver, Loop, Pivot, column_name
from heavebond.equations.flatten import Flat, FlatEquation
from heavebond.equations.index_reduction import Pantelides, collapse, pantelides
from heavebond.equations.lost_rank import Row, Simultaneous, losses
from heavebond.equations.matching import block_lower_triangular, maximum_matching
from heavebond.equations.redundant_loops import without_redundancies
from heavebond.equations.state_selection import Column, Constraints, InitialGuess, constraints, select_states
from heavebond.language.external_functions import derivative_along, jacobian, substituted_in_turn
from heavebond.language.incidence import INDEFINITE, classify
from heavebond.language.symbols import places, split, stack, uniform


@dataclass(frozen=True)
class Reduced:
    """x' = ode(t, x, z, p), 0 = alg(t, x, z, p); every other unknown is an expression in these.

    `symbols` and `expressions` map each raw symbol of the flat model (unknowns and their derivatives, `defined`) to SX in
    (x, z, p, time, rate, measured inputs); `system` is the system before its solution. `definitions` are the same
    expressions, each in raw symbols of those before it, and `sources` the rows of `system` in the block that determines
    each.
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
    defined: tuple[Column, ...]
    pivots: tuple[Pivot, ...]
    index: int
    differentiated: tuple[tuple[int, int], ...]
    loops: tuple[Loop, ...]
    system: Simultaneous
    choices: System
    definitions: ca.SX
    sources: tuple[tuple[int, ...], ...]

    def name(self, column: Column) -> str:
        """The name of a state: `crown.x`, or `der(crown.x)` for a derivative."""
        return column_name(self.flat, column)

    def unknowns(self) -> ca.SX:
        """All unknowns (n,) of the flat model in terms of (t, x, z, p)."""
        place = {column: k for k, column in enumerate((*self.states, *self.algebraic, *self.defined))}
        return ca.vertcat(self.x, self.z, self.expressions)[[place[(j, 0)] for j in range(len(self.flat.unknowns))]]

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
        """The index of each symbol, by its hash."""
        return places(self.symbols)


def reduce(flat: Flat) -> Reduced:
    """The index-1 model; ModelError with the smallest contradictory part where the structure is singular."""
    flat = without_redundancies(_with_identities(flat))
    # columns for unknowns and for the derivatives that occur (with the ones between), and the rows in them
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
    result, derived = _check_and_differentiate(flat, rows, derivative)
    all_columns: list[Column | None] = [*columns, *[None] * (result.n_columns - len(columns))]
    for k, successor in enumerate(result.derivative):
        if successor >= 0:
            j, order = all_columns[k] or (0, 0)
            all_columns[successor] = (j, order + 1)
    known_columns = [c for c in all_columns if c is not None]
    highest = [0] * (1 + max((j for j, _ in known_columns), default=0))
    for j, order in known_columns:
        highest[j] = max(highest[j], order)
    chain = Chain(known_columns, highest)
    # the equations with the derivatives of those that need it, all of one order in one sweep
    levels = [*flat.columns, *(ca.SX.sym("d" * k + "v", n) for k in range(len(flat.columns), max(highest) + 2))]
    low, high = ca.vertcat(*levels[:-1]), ca.vertcat(*levels[1:])
    for known in flat.driving:
        low, high = stack([low, known.symbols[:-1]]), stack([high, known.symbols[1:]])
    numbers = list(range(len(flat.equations)))
    every: list[Row] = [(i, 0) for i in numbers]
    residuals, last = [flat.residual_column], flat.residual_column
    k = 1
    while wanted := [place for place, i in enumerate(numbers) if result.order[i] >= k]:
        stacked, numbers = last[wanted], [numbers[place] for place in wanted]
        last = derivative_along(stacked, low, high) + derivative_along(stacked, flat.time, flat.rate)
        residuals.append(last)
        every += [(i, k) for i in numbers]
        k += 1
    system = System(flat, chain, result.order, levels, tuple(every), ca.vertcat(*residuals),
                    constraints(flat, result.order, highest), derived)
    return system.solve(select_states(system.constraints, system.p_values))


def reduce_flattened(flattened: Callable[[Mapping[int, int]], Flat]) -> Reduced:
    """The index-1 model of a diagram, which is `flattened` again if equations with corners in time must be
    differentiated: these corners become events."""
    try:
        return reduce(flattened({}))
    except structural_messages.KinkError as error:
        return reduce(flattened(error.orders))


@dataclass(frozen=True)
class Chain:
    """Every column as (unknown, order), and the highest order of each unknown."""

    column: list[Column]
    highest: list[int]


def _with_identities(flat: Flat) -> Flat:
    """The flat model with equations such as `0*y = 0`, which hold for any y, as equations for that variable of the same
    component; its coefficient is 0."""
    empty = [i for i, entries in enumerate(flat.entries) if not entries and flat.residual_column[i].is_zero()]
    if not empty:
        return flat
    rows = collapse_rows(flat)
    determined, entries, residuals = {*maximum_matching(rows, len(flat.unknowns))}, list(flat.entries), flat.residual_column
    for i in empty:
        e = flat.equations[i]
        inside = {f"{e.owner}.{name}" for name in re.findall(r"[A-Za-z_]\w*", e.text)}
        j = next((j for j, u in enumerate(flat.unknowns)
                  if j not in determined and u.role == "own" and u.name in inside), None)
        if j is not None:
            determined.add(j)
            entries[i] = [(j, INDEFINITE)]
            residuals[i] = ca.if_else(flat.rate > 1, 1, 0) * flat.levels[0][j]  # the rate of time is 0 or 1
    return replace(flat, residual_column=residuals, entries=tuple(entries))


def _check_and_differentiate(flat: Flat, rows: list[list[int]], derivative: list[int]
                             ) -> tuple[Pantelides, frozenset[int]]:
    """How often each equation is differentiated, and the derived unknowns (see `_derived`)."""
    collapsed = collapse(rows, derivative)
    matching = maximum_matching(collapsed, len(flat.unknowns))
    if -1 in matching or len(rows) != len(flat.unknowns):
        raise structural_messages.singular(flat, collapsed, matching)
    result = pantelides(rows, len(derivative), derivative)
    kinked = {i: order for i, order in enumerate(result.order) if order and flat.equations[i].kink}
    if kinked:
        raise structural_messages.kinked(flat, kinked)
    moving = [j for j in range(len(flat.unknowns)) if derivative[j] >= 0]
    moving += [j for i, order in enumerate(result.order) if order for j in collapsed[i]]
    # the signals and variables of components on which no motion depends, such as an efficiency. Motion depends on the
    # unknowns that are differentiated (`moving`), on those of nodes, events and foreign components, and on all unknowns in
    # their equations; `matching` assigns an unknown to each equation (row)
    row_of = {j: i for i, j in enumerate(matching)}
    number = {s.element_hash(): j for level in flat.levels for j, s in enumerate(level)}
    waiting = {*moving, *(j for j, u in enumerate(flat.unknowns) if u.role not in ("own", "signal"))}
    for event in flat.events:
        values = [e for e in (event.indicator, event.first, event.period, *(r.value for r in event.resets)) if e is not None]
        values += [] if event.impulse is None else [event.impulse.value]
        waiting |= {number[h] for s in ca.symvar(stack(values)) if (h := s.element_hash()) in number}
        waiting |= {r.unknown for r in event.resets if r.unknown is not None}
        waiting |= {event.impulse.unknown} if event.impulse is not None else set()
        waiting |= {event.breakaway.speed} if event.breakaway is not None else set()
    foreign = [path for path, leaf in flat.expanded.leaves.items() if leaf.component.foreign]
    waiting |= {j for j, u in enumerate(flat.unknowns) if u.name.rpartition(".")[0] in foreign}
    needed: set[int] = set()
    while waiting:
        needed |= waiting
        waiting = {k for j in waiting for k in collapsed[row_of[j]]} - needed
    return result, (frozenset(range(len(flat.unknowns))) - needed)


@dataclass(frozen=True)
class System:
    """All equations with their derivatives, in symbols for all unknowns with their derivatives; `constraints` are those that
    were differentiated. No motion depends on the `derived` unknowns. It can be solved for several choices of states, in the
    same symbols. `residuals` are the residuals of the `rows`, `columns[k]` (n,) the symbols of the k-th derivatives."""

    flat: Flat
    chain: Chain
    order: tuple[int, ...]
    columns: list[ca.SX]
    rows: tuple[Row, ...]
    residuals: ca.SX
    constraints: Constraints
    derived: frozenset[int]

    @cached_property
    def symbols(self) -> ca.SX:
        """The symbols of all unknowns, then of their derivatives."""
        return ca.vertcat(*self.columns)

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
        values = self.p_values.tolist()
        return {s: values[k] for s, k in self.flat.places.items()}

    def numbers(self, expressions: ca.SX) -> NDArray[np.float64]:
        """The values (n,) of expressions in parameters alone. The function has only the parameters that occur as arguments:
        with all parameters the work would grow with the square of the number of loops."""
        symbols = ca.symvar(expressions)
        values = [self._value_of[s.element_hash()] for s in symbols]
        return np.asarray(ca.Function("numbers", [stack(symbols)], [expressions])(values)).ravel()

    def symbols_of(self, columns: Sequence[Column]) -> ca.SX:
        """The symbols (m,) of these columns."""
        n = len(self.flat.unknowns)
        return self.symbols[[k * n + j for j, k in columns]]

    def solve(self, states: list[Column]) -> Reduced:
        """x' = f(t, x, z, p), 0 = g(t, x, z, p) for these states (their number is given by the constraints)."""
        known = set(states)
        unknown = [c for c in sorted(self.chain.column) if c not in known]
        rows, symbols = self.rows, self.symbols_of(unknown)
        entries = self._entries(rows, unknown)
        matching = maximum_matching([[c for c, _ in row] for row in entries], len(unknown))
        system = Simultaneous(self.flat, rows, tuple(unknown), self.residuals, symbols)
        if -1 in matching or len(rows) != len(unknown):
            raise self._lost(system, [i for (i, _), column in zip(rows, matching, strict=True) if column < 0])
        solver = BlockSolver(self.flat, rows, unknown, self.residuals, symbols, entries, self.constants, self.numbers,
                             {c for c, (j, _) in enumerate(unknown) if j in self.derived})
        blocks = block_lower_triangular([[c for c, _ in row] for row in entries], matching)
        solver.solve([(block, [matching[r] for r in block]) for block in blocks])
        flat = self.flat
        torn = [system.columns[c] for c in solver.torn]
        x, z = self.symbols_of(states), self.symbols_of(torn)
        rates = self.symbols_of([(j, k + 1) for j, k in states])
        piggyback = [rates, stack([r for r, _ in solver.remaining]),
                     stack([p.coefficient for p in solver.pivots])]
        defined, expressions, substituted = system.unknowns[solver.defined], ca.SX(0, 1), piggyback
        definitions = solver.definitions
        if solver.defined:
            expressions, substituted = substituted_in_turn(defined, definitions, piggyback)
        pivots = tuple(replace(p, coefficient=c)
                       for c, p in zip(split(substituted[2]), solver.pivots, strict=True))
        order = self.order
        algebraic = [j for j, top in enumerate(self.chain.highest) if top == 0]
        reduced = Reduced(
            flat, tuple(states), tuple(torn), x, z, substituted[0], substituted[1],
            tuple(flat.equations[row[0]] for _, row in solver.remaining), defined, expressions,
            tuple(system.columns[c] for c in solver.defined), pivots, max(order, default=0) + (1 if algebraic else 0),
            tuple((i, k) for i, k in enumerate(order) if k), tuple(solver.loops), system, self, definitions,
            tuple(solver.sources))
        if ca.sprank(ca.sparsify(jacobian(reduced.alg, reduced.z))) < reduced.z.numel():
            # terms that cancel whatever the numbers: a circuit of differences without reference
            raise self._lost(system, [row[0] for _, row in solver.remaining])
        return reduced

    def _lost(self, system: Simultaneous, dependent: list[int]) -> ModelError:
        """The error for equations that are dependent at the initial guess; `dependent` are some of them."""
        guess = InitialGuess(self.flat)(self.p_values)
        point = dict(self._value_of)
        for j, (symbol, unknown) in enumerate(zip(self.flat.levels[0], self.flat.unknowns, strict=True)):
            point[symbol.element_hash()] = float(guess[j]) or 0.1 * unknown.nominal * (0.5 + uniform(3, j))
        point |= self._plain_numbers()
        problems = structural_messages.lost(self.flat, losses(system, point))
        return ModelError(problems) if problems else \
            structural_messages.singular(self.flat, collapse_rows(self.flat), [-1] * len(self.flat.equations),
                                         dependent)

    def _plain_numbers(self) -> dict[int, float]:
        """The values that single equations determine, such as `u = 0` of a valve that the diagram shuts permanently, by the
        hash of the symbol."""
        known = {s.element_hash() for s in self.flat.levels[0]}
        # two equations may speak of the same unknown, as those of a source with both ends on one node do: the first counts
        alone = {inside[0].element_hash(): (r, inside[0]) for r in reversed(self.flat.residuals)
                 if len(inside := ca.symvar(r)) == 1 and inside[0].element_hash() in known}
        if not alone:
            return {}
        residuals, symbols = (stack(list(column)) for column in zip(*alone.values(), strict=True))
        both = ca.Function("alone", [symbols], [residuals, ca.sum2(jacobian(residuals, symbols))])
        values, slopes = (np.array(v).ravel() for v in both(0))
        return {s: -float(value / slope) for s, value, slope in zip(alone, values, slopes, strict=True)
                if slope and np.isfinite(value)}

    def _entries(self, rows: Sequence[Row], unknown: list[Column]) -> list[list[tuple[int, int]]]:
        """(position in `unknown`, kind) of each row; entries of undifferentiated equations are known from the templates."""
        n = len(self.flat.unknowns)
        position = {column: k for k, column in enumerate(unknown)}
        entries: list[list[tuple[int, int]]] = []
        for i, k in rows:
            known = self.flat.entries[i] if k == 0 else []
            entries.append([(position[(c % n, c // n)], kind) for c, kind in known if (c % n, c // n) in position])
        derived = [r for r, (_, k) in enumerate(rows) if k > 0]
        if derived:
            classified = classify(self.residuals[derived], self.symbols_of(unknown), self.constants, self.flat.bounds)
            for r, row in zip(derived, classified, strict=True):
                entries[r] = [(e.column, e.kind) for e in row]
        return entries


def collapse_rows(flat: Flat) -> list[list[int]]:
    """The unknowns of each equation whatever their derivatives."""
    n = len(flat.unknowns)
    return [list(dict.fromkeys(c % n for c, _ in row)) for row in flat.entries]
