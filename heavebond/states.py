"""Which unknowns become states: the method of dummy derivatives with numerical pivoting."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.flatten import Flat
from heavebond.resolver import Resolver
from heavebond.structure import components_of
from heavebond.symbols import split, stack, uniform

Column = tuple[int, int]  # (unknown, order of its derivative)
# How much less a column is wanted as a dummy derivative, as a factor on its pivot: a state that the user gave an
# initial value for is kept unless another choice is a thousand times better conditioned.
PREFERENCE = {"position": 1e-2, "across": 1e-2, "signal": 1e-1, "own": 1e-1, "through": 1.0}
ASKED = 1e-1
# From so many rows on LAPACK is faster; for fewer, loading SciPy would take longer than all of a usual model.
LARGE = 100


def select_states(flat: Flat, order: Sequence[int], highest: Sequence[int], p: NDArray[np.float64]) -> list[Column]:
    """The states (unknown, derivative order), given how often each equation is differentiated.

    At each level, the differentiated equations H z = ... get as many of the highest derivatives z as they are, chosen
    by QR with column pivoting on the numerical Jacobian at the initial guess; these become algebraic.

    S. E. Mattsson, G. Soderlind: Index reduction in differential-algebraic equations using dummy derivatives.
    SIAM J. Sci. Comput. 14 (1993) 677-692, doi:10.1137/0914043.
    """
    dummies: set[Column] = set()
    rows = [i for i, k in enumerate(order) if k >= 1]
    if rows:
        jacobian = _Jacobian(flat, order, highest, p, rows)
        columns = [j for j, k in enumerate(highest) if k >= 1]
        depth = 0
        while rows:
            chosen = jacobian.pivots(rows, columns, [highest[j] - depth for j in columns])
            dummies |= {(j, highest[j] - depth) for j in chosen}
            depth += 1
            rows = [i for i in rows if order[i] - depth >= 1]
            columns = [j for j in chosen if highest[j] - depth >= 1]
    return [(j, k) for j, top in enumerate(highest) for k in range(top) if (j, k + 1) not in dummies]


class Guess:
    """First values of all unknowns: what the diagram asks for or guesses, else the declared start, else 0."""

    def __init__(self, flat: Flat):
        self._declared = np.array([0.0 if u.start is None else u.start for u in flat.unknowns])
        resolver = Resolver(flat.names, flat.constants, flat.units, flat.unknowns, flat.levels, flat.time, flat.rate)
        known = {s.element_hash() for s in [*split(flat.p), flat.time]}
        self._asked: list[int] = []
        values = []
        for name, condition in flat.expanded.model.initial.conditions.items():
            if name in flat.names:
                given = flat.constants.get(f"initial.{name}")
                value = resolver.evaluate(condition.value.expr) if given is None else given
                # a condition that depends on variables is dealt with when the start is solved
                if {s.element_hash() for s in ca.symvar(value)} <= known:
                    self._asked.append(flat.names[name])
                    values.append(value)
        self._values = ca.Function("guess", [flat.p, flat.time], [stack(values), ca.jacobian(stack(values), flat.p)])

    def __call__(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """The values (n,) at the parameters p."""
        values = self._declared.copy()
        values[self._asked] = np.array(self._values(p, 0.0)[0]).ravel()
        return values

    def slopes(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """How they move with the parameters, (n, n_p)."""
        slopes = np.zeros((len(self._declared), len(p)))
        slopes[self._asked] = np.array(self._values(p, 0.0)[1].full())
        return slopes


class _Jacobian:
    """d(row)/d(highest derivatives) of the differentiated equations, at the initial guess."""

    def __init__(self, flat: Flat, order: Sequence[int], highest: Sequence[int], p: NDArray[np.float64],
                 rows: list[int]):
        self.flat = flat
        conditions = flat.expanded.model.initial.conditions
        self.asked = {flat.names[n] for n, c in conditions.items() if n in flat.names and not c.guess}
        self.asked |= {reset.unknown for event in flat.events for reset in event.resets if reset.unknown is not None}
        n = len(flat.unknowns)
        # d(r^(k))/d(v^(l+k)) = dr/d(v^(l)): the derivative's Jacobian is read off the equation itself
        self.entries: dict[int, list[tuple[int, float]]] = {}
        symbols = [s for level in flat.levels for s in level]
        stacked = stack([flat.residuals[i] for i in rows])
        jacobian = ca.jacobian(stacked, stack(symbols))
        known = stack([k.symbols for k in flat.inputs])
        at = ca.Function("J", [stack(symbols), flat.p, flat.time, flat.rate, known], [jacobian])
        values = at(self._point(p, len(symbols)), p, 0.0, 1.0, np.ones(known.numel()))
        row_of, column_of = jacobian.sparsity().get_triplet()
        found = np.array(values.nonzeros())
        for row, column, value in zip(row_of, column_of, found, strict=True):
            i, level, j = rows[row], column // n, column % n
            if level == highest[j] - order[i]:
                self.entries.setdefault(i, []).append((j, float(value) if np.isfinite(value) else 1.0))

    def _point(self, p: NDArray[np.float64], size: int) -> NDArray[np.float64]:
        """The guess, moved a little off places where a coefficient vanishes by accident (a crank at dead centre)."""
        values = Guess(self.flat)(p)
        nominal = np.array([u.nominal for u in self.flat.unknowns])
        shift = np.array([uniform(1, j) - 0.5 for j in range(len(values))])
        point = np.zeros(size)
        point[: len(values)] = values + 1e-4 * nominal * shift
        return point

    def pivots(self, rows: list[int], columns: list[int], orders: list[int]) -> list[int]:
        """As many of `columns` as there are `rows`, so that the square Jacobian is well conditioned; `orders` tells
        which derivative of its unknown each column is."""
        place = {j: k for k, j in enumerate(columns)}
        pattern = [[place[j] for j, _ in self.entries.get(i, []) if j in place] for i in rows]
        chosen: list[int] = []
        for part_rows, part_columns in components_of(pattern, len(columns)):
            if part_rows:
                chosen += self._part([rows[r] for r in part_rows], [columns[c] for c in part_columns],
                                     [orders[c] for c in part_columns])
        return sorted(chosen)

    def _part(self, rows: list[int], columns: list[int], orders: list[int]) -> list[int]:
        place = {j: k for k, j in enumerate(columns)}
        matrix = np.zeros((len(rows), len(columns)))
        for r, i in enumerate(rows):
            for j, value in self.entries.get(i, []):
                if j in place:
                    matrix[r, place[j]] = value * self.flat.unknowns[j].nominal
            matrix[r] /= max(float(np.abs(matrix[r]).max(initial=0.0)), 1e-300)
        matrix *= np.array([self._weight(j, k) for j, k in zip(columns, orders, strict=True)])
        # fewer columns than rows: equations that say the same, which is told when they are solved
        return [columns[k] for k in pivot_columns(matrix)]

    def _weight(self, j: int, order: int) -> float:
        if self.flat.unknowns[j].role == "position" and order > 1:
            return 1.0  # the node's velocity is the state that people know, not der(position)
        return PREFERENCE[self.flat.unknowns[j].role] * (ASKED if j in self.asked else 1.0)


def pivot_columns(matrix: NDArray[np.float64]) -> list[int]:
    """The first min(m, n) columns that QR with column pivoting takes of a matrix (m, n): each time the longest of what is
    left when the directions of those taken are removed from all (modified Gram-Schmidt).

    G. H. Golub, C. F. Van Loan: Matrix Computations, 4th ed., Johns Hopkins 2013, sections 5.2.8 and 5.4.2.
    """
    if len(matrix) > LARGE:
        import scipy.linalg

        return list(scipy.linalg.qr(matrix, mode="r", pivoting=True)[1][: min(matrix.shape)])
    rest, taken = matrix.copy(), list[int]()
    for _ in range(min(matrix.shape)):
        squares = np.einsum("ij,ij->j", rest, rest)
        squares[taken] = -1
        taken.append(int(np.argmax(squares)))
        if squares[taken[-1]] > 0:
            direction = rest[:, taken[-1]] / np.sqrt(squares[taken[-1]])
            rest -= np.outer(direction, direction @ rest)
    return taken
