"""State selection by the method of dummy derivatives with numerical pivoting."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.equations.buffered import Buffered
from heavebond.equations.constraint_projection import constraint_equations
from heavebond.equations.flatten import Flat
from heavebond.equations.matching import block_lower_triangular, components_of, maximum_matching
from heavebond.equations.resolver import Resolver
from heavebond.language.symbols import split, stack, uniform

Array = NDArray[np.float64]
Column = tuple[int, int]  # (unknown, order of its derivative)
# How much less a column is wanted as a dummy derivative, as a factor on its pivot: a state that the user gave an
# initial value for is kept unless another choice is a thousand times better conditioned.
PREFERENCE = {"position": 1e-2, "across": 1e-2, "signal": 1e-1, "own": 1e-1, "through": 1.0}
ASKED = 1e-1
ROOT = 1e-3  # of the position, orientation and velocities of a free body
# strain of a choice above which it does not serve; preferences alone come to 1/(1e-2 * 1e-1)
UNSUITABLE = 1e3
# From so many rows on LAPACK is faster; for fewer, loading SciPy would take longer than all of a usual model.
LARGE = 100


@dataclass(frozen=True)
class Constraints:
    """The differentiated equations H z = ...: the derivatives of H with respect to the highest derivatives z.

    order:   how often each equation is differentiated; highest: the highest derivative of each unknown
    entries: (equation, unknown) of each value; d(r^(k))/d(v^(l+k)) = dr/d(v^(l)), so each is read off the equation itself
    values:  as many expressions in raw symbols
    """

    flat: Flat
    order: tuple[int, ...]
    highest: tuple[int, ...]
    entries: tuple[Column, ...]
    values: ca.SX

    @cached_property
    def place(self) -> dict[Column, int]:
        """The index of the value of an equation and an unknown."""
        return {entry: k for k, entry in enumerate(self.entries)}

    @cached_property
    def rows(self) -> dict[int, list[int]]:
        """The unknowns of each equation."""
        rows: dict[int, list[int]] = {}
        for i, j in self.entries:
            rows.setdefault(i, []).append(j)
        return rows

    @cached_property
    def constant(self) -> frozenset[Column]:
        """The entries (equation, unknown) with a number other than 0 as their coefficient."""
        return frozenset(entry for entry, value in zip(self.entries, split(self.values), strict=True)
                         if value.is_constant() and float(value) != 0)

    @cached_property
    def settable(self) -> frozenset[int]:
        """The unknowns that events set: they must be states."""
        return frozenset(r.unknown for event in self.flat.events for r in event.resets if r.unknown is not None)

    @cached_property
    def preferred(self) -> frozenset[int]:
        """The unknowns that events set, and those with an initial value."""
        conditions, names = self.flat.expanded.model.initial.conditions, self.flat.names
        return self.settable | {names[n] for n, c in conditions.items() if n in names and not c.guess}


def constraints(flat: Flat, order: Sequence[int], highest: Sequence[int]) -> Constraints:
    """The constraints, given how often each equation is differentiated."""
    n, rows = len(flat.unknowns), [i for i, k in enumerate(order) if k >= 1]
    occurring = sorted({column for i in rows for column, _ in flat.entries[i]})
    jacobian = ca.jacobian(flat.residual_column[rows], ca.vertcat(*flat.columns)[occurring])
    places = zip(*jacobian.sparsity().get_triplet(), strict=True)
    entries = [(rows[row], column % n, k) for k, (row, at) in enumerate(places)
               if (column := occurring[at]) // n == highest[column % n] - order[rows[row]]]
    values = jacobian.nz[[k for *_, k in entries]] if entries else ca.SX(0, 1)
    return Constraints(flat, tuple(order), tuple(highest), tuple((i, j) for i, j, _ in entries), values)


def select_states(constraints: Constraints, p: Array) -> list[Column]:
    """The states (unknown, derivative order) at the initial guess, with preference for unknowns with an initial value.

    A guess of a mechanism may be far from any configuration in which it can be assembled. If the states that the guess
    suggests are unsuitable (`UNSUITABLE`) after the guess is projected on the constraints, they are selected at the
    projected guess."""
    if not constraints.entries:
        return chosen_states(constraints, np.zeros(0))
    flat, guess = constraints.flat, InitialGuess(constraints.flat)(p)
    symbols, known = ca.vertcat(*flat.columns), stack(k.symbols for k in flat.driving)
    at = ca.Function("H", [symbols, flat.p, flat.time, flat.rate, known], [constraints.values])

    def numbers(values: Array) -> Array:
        # moved a little off places where a coefficient vanishes by accident (a crank at dead centre)
        nominal = np.array([u.nominal for u in flat.unknowns])
        shift = np.array([uniform(1, j) - 0.5 for j in range(len(values))])
        point = np.zeros(symbols.numel())
        point[: len(values)] = values + 1e-4 * nominal * shift
        entries = np.array(at(point, p, 0.0, 1.0, np.ones(known.numel()))).ravel()
        return np.where(np.isfinite(entries), entries, 1.0)

    states = chosen_states(constraints, numbers(guess), constraints.preferred)
    if ca.depends_on(constraints.values, symbols):
        equations = constraint_equations(flat, constraints.order)
        projected = equations.projected(guess, p) if equations else None
        if projected is not None:
            entries = numbers(projected)
            dependent = [part for part in parts_of(constraints, states) if len(part.columns) > len(part.rows)]
            if any(strain(part, entries[:, None])[0][0] > UNSUITABLE for part in dependent):
                return chosen_states(constraints, entries, constraints.preferred)
    return states


def chosen_states(constraints: Constraints, numbers: Array, preferred: frozenset[int] = frozenset()) -> list[Column]:
    """The states at these values (n,) of the constraints; `preferred` unknowns have ten times the preference.

    At each level, as many of the highest derivatives z as there are differentiated equations H z = ... become algebraic,
    chosen by QR with column pivoting.

    S. E. Mattsson, G. Soderlind: Index reduction in differential-algebraic equations using dummy derivatives.
    SIAM J. Sci. Comput. 14 (1993) 677-692, doi:10.1137/0914043.
    """
    weight = partial(preference, constraints.flat, preferred=preferred)

    def pick(part: Part) -> list[int]:
        weights = [weight(column) for column in part.columns]
        return [part.columns[k][0] for k in pivot_columns(part.matrices(numbers[:, None], part.columns)[0] * weights)]

    dummies = {column for level in _levels(constraints, pick, weight) for column in level.dummies}
    return [(j, k) for j, top in enumerate(constraints.highest) for k in range(top) if (j, k + 1) not in dummies]


@dataclass(frozen=True)
class Block:
    """Dummies that the equations of a part determine together: their columns, and for each equation its entries in these
    columns and in those that are known before."""

    columns: list[int]
    inside: list[NDArray[np.int64]]
    known: list[NDArray[np.int64]]


@dataclass(frozen=True)
class Part:
    """Equations of one level that share no unknown with the others of it, and all the derivatives in them."""

    constraints: Constraints
    rows: tuple[int, ...]
    columns: tuple[Column, ...]
    dummies: tuple[Column, ...] = ()

    def matrices(self, numbers: Array, columns: Sequence[Column]) -> Array:
        """The Jacobians (N, m, len(columns)) with unknowns in their nominal sizes and rows scaled, from values (n, N)."""
        rows, at, values, sizes = self.pattern
        matrix = np.zeros((numbers.shape[1], len(self.rows), len(self.columns)))
        matrix[:, rows, at] = numbers[values].T * sizes
        matrix /= np.maximum(np.abs(matrix).max(axis=2, keepdims=True, initial=0.0), 1e-300)
        position = {column: k for k, column in enumerate(self.columns)}
        return np.asarray(matrix[:, :, [position[column] for column in columns]])

    @cached_property
    def pattern(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Array]:
        """The row, the column and the index of the value of each entry, and the nominal size of its unknown."""
        position = {j: c for c, (j, _) in enumerate(self.columns)}
        entries = [(r, position[j], self.constraints.place[(i, j)], self.constraints.flat.unknowns[j].nominal)
                   for r, i in enumerate(self.rows) for j in self.constraints.rows.get(i, ()) if j in position]
        rows, at, values = (np.array([entry[k] for entry in entries], dtype=np.int64) for k in range(3))
        return rows, at, values, np.array([entry[3] for entry in entries], dtype=float)

    @cached_property
    def blocks(self) -> list[Block] | None:
        """The blocks by which the dummies follow from the states, in their order; None if they do not for any values."""
        rows, at, _, _ = self.pattern
        dummies = set(self.dummies)
        place = {c: k for k, c in enumerate(c for c, column in enumerate(self.columns) if column in dummies)}
        pattern: list[list[int]] = [[] for _ in self.rows]
        for r, c in zip(rows.tolist(), at.tolist(), strict=True):
            pattern[r] += [place[c]] if c in place else []
        matching = maximum_matching(pattern, len(place))
        if -1 in matching:
            return None
        columns, blocks = list(place), list[Block]()
        for block in block_lower_triangular(pattern, matching):
            inside = [columns[matching[r]] for r in block]
            entries = [np.flatnonzero(rows == r) for r in block]
            within = [np.isin(at[k], inside) for k in entries]
            blocks.append(Block(inside, [k[own] for k, own in zip(entries, within, strict=True)],
                                [k[~own] for k, own in zip(entries, within, strict=True)]))
        return blocks


def _levels(constraints: Constraints, pick: Callable[[Part], list[int]], weight: Callable[[Column], float]) -> list[Part]:
    """All parts of all levels; `pick` names the unknowns whose derivatives become algebraic, one for each row of a part that
    remains after equations with a constant coefficient are removed (`_peeled`)."""
    rows = [i for i, k in enumerate(constraints.order) if k >= 1]
    columns = [j for j, k in enumerate(constraints.highest) if k >= 1]
    depth, parts = 0, list[Part]()
    while rows:
        orders = {j: constraints.highest[j] - depth for j in columns}
        dummies, remaining = _peeled(constraints, rows, orders, weight)
        chosen = [j for j, _ in dummies]
        parts.append(Part(constraints, (), (), tuple(dummies)))
        inside = sorted({j for i in remaining for j in constraints.rows.get(i, ()) if j in orders} - set(chosen))
        place = {j: k for k, j in enumerate(inside)}
        pattern = [[place[j] for j in constraints.rows.get(i, []) if j in place] for i in remaining]
        for part_rows, part_columns in components_of(pattern, len(inside)):
            if part_rows:
                part = Part(constraints, tuple(remaining[r] for r in part_rows),
                            tuple((inside[c], orders[inside[c]]) for c in part_columns))
                picked = pick(part)
                parts.append(Part(constraints, part.rows, part.columns, tuple((j, orders[j]) for j in picked)))
                chosen += picked
        depth += 1
        rows = [i for i in rows if constraints.order[i] - depth >= 1]
        columns = [j for j in sorted(chosen) if constraints.highest[j] - depth >= 1]
    return parts


def _peeled(constraints: Constraints, rows: Sequence[int], orders: Mapping[int, int], weight: Callable[[Column], float]
            ) -> tuple[list[Column], list[int]]:
    """The dummy derivatives that equations with constant coefficients give at every point, and the remaining equations.

    Unknowns are in one set if an equation with two constant coefficients relates them. If a set occurs in one equation only,
    with a constant coefficient, and another set of this equation is at least as suitable as a state, the equation determines
    it at every point. Thus the positions along a tree of bodies follow from the coordinates of its joints."""
    set_of = {j: j for j in orders}

    def root(j: int) -> int:
        while set_of[j] != j:
            set_of[j] = set_of[set_of[j]]
            j = set_of[j]
        return j

    inside = {i: [j for j in constraints.rows.get(i, ()) if j in orders] for i in rows}
    pairs: dict[int, list[int]] = {}
    for i, members in inside.items():
        if len(members) == 2 and all((i, j) in constraints.constant for j in members):
            a, b = (root(j) for j in members)
            if a != b:
                set_of[b] = a
                pairs[i] = members
    sets: dict[int, list[int]] = {}
    for j in orders:
        sets.setdefault(root(j), []).append(j)
    wanted = {s: min(weight((j, orders[j])) for j in members) for s, members in sets.items()}
    sets_of = {i: {root(j) for j in members} for i, members in inside.items() if i not in pairs}
    rows_of: dict[int, set[int]] = {s: set() for s in sets}
    for i, members_of in sets_of.items():
        for s in members_of:
            rows_of[s].add(i)
    waiting, followed = [s for s in sets if len(rows_of[s]) == 1], set[int]()
    while waiting:
        s = waiting.pop()
        if s in followed or len(rows_of[s]) != 1:
            continue
        i, = rows_of[s]
        members_in_row = [j for j in inside[i] if root(j) == s]
        if len(members_in_row) > 1 or (i, members_in_row[0]) not in constraints.constant \
                or any(wanted[t] > wanted[s] for t in sets_of[i]):
            continue
        followed.add(s)
        for affected in sets_of.pop(i):
            rows_of[affected].discard(i)
            if len(rows_of[affected]) == 1:
                waiting.append(affected)
    alone = [s for s in sets if not rows_of[s] and s not in followed]
    dummies = [(j, orders[j]) for s in sets if s in followed for j in sets[s]]
    for s in alone:
        state = min(sets[s], key=lambda j: (weight((j, orders[j])), orders[j]))
        dummies += [(j, orders[j]) for j in sets[s] if j != state]
    settled = followed | set(alone)
    remaining = [i for i in rows if i in sets_of or (i in pairs and root(pairs[i][0]) not in settled)]
    return dummies, remaining


def parts_of(constraints: Constraints, states: Sequence[Column]) -> list[Part]:
    """The parts of all levels for a choice of states."""
    state_set = set(states)
    levels = _levels(constraints, lambda part: [j for j, k in part.columns if (j, k - 1) not in state_set],
                     lambda column: 0.0 if (column[0], column[1] - 1) in state_set else 1.0)
    return [part for part in levels if part.rows]


def strain(part: Part, numbers: Array) -> tuple[Array, Array]:
    """The strain of a part at N points, and the side of its singularity: how strongly the dummies depend on the states.

    With H_d, H_s the columns of dummies and states in their preference, max |H_d^-1 H_s| (N,) is the largest factor by
    which an exchange of two of them would improve the choice; it is about 1 where the choice was made and has no bound where
    the chart ends. There the sign of det H_d (N,) changes. `numbers` (n, N) are the values of the constraints.
    """
    n, blocks = numbers.shape[1], part.blocks
    worst, sign = np.full(n, np.inf), np.zeros(n)
    if blocks is None:
        return worst, sign
    rows, at, values, sizes = part.pattern
    entries = numbers[values] * sizes[:, None]
    largest = np.maximum.reduceat(np.abs(entries), np.searchsorted(rows, np.arange(len(part.rows))))  # of each row
    entries /= np.maximum(largest, 1e-300)[rows]
    good = np.isfinite(entries).all(axis=0)
    entries = entries[:, good]
    weights = np.array([preference(part.constraints.flat, column, frozenset()) for column in part.columns])
    dummies = set(part.dummies)
    states = [c for c, column in enumerate(part.columns) if column not in dummies]
    # H_d X = H_s block by block: the rows of X are those of all columns, and -1 for the states
    found, signs = np.zeros((len(part.columns), len(states), entries.shape[1])), np.ones(entries.shape[1])
    found[states, range(len(states))] = -1
    with np.errstate(all="ignore"):  # singular points are left out
        for block in blocks:
            right = -np.array([np.einsum("en,esn->sn", entries[known], found[at[known]]) for known in block.known])
            if len(block.columns) == 1:
                pivot = entries[block.inside[0]][0]
                signs *= np.sign(pivot)
                found[block.columns] = right / pivot
            else:
                matrix = np.zeros((entries.shape[1], len(block.columns), len(block.columns)))
                for r, inside in enumerate(block.inside):
                    matrix[:, r, [block.columns.index(c) for c in at[inside]]] = entries[inside].T
                signs *= np.linalg.slogdet(matrix)[0]
                matrix[signs == 0] = np.eye(len(block.columns))
                found[block.columns] = np.linalg.solve(matrix, right.transpose(2, 0, 1)).transpose(1, 2, 0)
        ratios = np.abs(found * weights[states][:, None] / weights[:, None, None])
    ratios[states] = 0
    sign[good] = signs
    worst[good] = np.where(signs != 0, ratios.max(axis=(0, 1), initial=0.0), np.inf)
    return worst, sign


def preference(flat: Flat, column: Column, preferred: frozenset[int]) -> float:
    """The factor on the pivot of a column; the smaller, the sooner it is a state. `preferred` unknowns have an initial
    value."""
    j, order = column
    if flat.unknowns[j].root and order <= 1:
        return ROOT * (ASKED if j in preferred else 1.0)
    if flat.unknowns[j].pose or (flat.unknowns[j].role in ("position", "own") and order > 1):
        return 1.0  # the node's velocity is the state that people know, not der(position)
    return PREFERENCE[flat.unknowns[j].role] * (ASKED if j in preferred else 1.0)


class InitialGuess:
    """Initial guess of all unknowns: the condition or guess of the diagram, else the declared start, else 0. A closed
    position of a loop with redundant constraints replaces its guesses."""

    def __init__(self, flat: Flat):
        self._declared = np.array([0.0 if u.start is None else u.start for u in flat.unknowns])
        closed = {j: value for loop in flat.redundancies for j, value in loop.configuration.items()}
        self._declared[list(closed)] = list(closed.values())
        resolver = Resolver(flat.names, flat.constants, flat.units, flat.unknowns, flat.columns, flat.time, flat.rate)
        known = {*flat.places, flat.time.element_hash()}
        self._asked: list[int] = []
        values = []
        for name, condition in flat.expanded.model.initial.conditions.items():
            if name in flat.names and not (condition.guess and flat.names[name] in closed):
                constant = flat.constants.get(f"initial.{name}")
                value = resolver.evaluate(condition.value.expr) if constant is None else constant
                # a condition that depends on variables is dealt with when the start is solved
                if {s.element_hash() for s in ca.symvar(value)} <= known:
                    self._asked.append(flat.names[name])
                    values.append(value)
        self.expressions, self._arguments = stack(values), [flat.p, flat.time]
        self._values = Buffered(ca.Function("guess", self._arguments, [self.expressions]))

    def __call__(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (n,) at the parameters p."""
        values = self._declared.copy()
        values[self._asked] = self._values(p)["o0"].ravel()
        return values

    def columns(self, columns: Sequence[tuple[int, int]]) -> ca.SX:
        """The values of unknowns by number and order of derivative, as expressions of the parameters; a rate is 0."""
        requested = dict(zip(self._asked, split(self.expressions), strict=True))
        return stack([requested.get(j, ca.SX(self._declared[j])) if order == 0 else ca.SX(0) for j, order in columns])

    def slopes(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """The derivatives of the values by the parameters, (n, n_p)."""
        slopes = np.zeros((len(self._declared), len(p)))
        slopes[self._asked] = self._slopes(p)["o0"]
        return slopes

    @cached_property
    def _slopes(self) -> Buffered:
        return Buffered(ca.Function("slopes", self._arguments, [ca.jacobian(self.expressions, self._arguments[0])]))


def pivot_columns(matrix: NDArray[np.float64]) -> list[int]:
    """The first min(m, n) columns that QR with column pivoting takes of a matrix (m, n): each time the longest after the
    directions of the taken columns are removed from all (modified Gram-Schmidt).

    G. H. Golub, C. F. Van Loan: Matrix Computations, 4th ed., Johns Hopkins 2013, sections 5.2.8 and 5.4.2.
    """
    if len(matrix) > LARGE:
        import scipy.linalg

        return list(scipy.linalg.qr(matrix, mode="r", pivoting=True)[1][: min(matrix.shape)])
    remaining, columns = matrix.copy(), list[int]()
    for _ in range(min(matrix.shape)):
        squares = np.einsum("ij,ij->j", remaining, remaining)
        squares[columns] = -1
        columns.append(int(np.argmax(squares)))
        if squares[columns[-1]] > 0:
            direction = remaining[:, columns[-1]] / np.sqrt(squares[columns[-1]])
            remaining -= np.outer(direction, direction @ remaining)
    return columns
