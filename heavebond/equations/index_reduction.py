"""Pantelides' algorithm: the number of differentiations of each equation that makes the highest derivatives solvable.

Columns represent unknowns and their derivatives alike; `derivative[j]` is the column of d/dt of column j, or -1 if there
is none. Equations are rows as in `matching`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from heavebond.equations.matching import FREE, HIDDEN, augment, inverse, maximum_matching


@dataclass(frozen=True)
class Pantelides:
    """A system with the derivatives of its rows appended, whose highest derivatives can be matched.

    order:          how often each row given is differentiated, length m
    rows:           columns of the m rows given, then of their derivatives in the order these were found
    derivative:     column of d/dt of each column or -1; columns beyond those given are derivatives that arose
    row_derivative: row that is d/dt of each row or -1
    matching:       column of each row without derivative, itself without derivative; -1 for the other rows
    """

    order: tuple[int, ...]
    rows: tuple[tuple[int, ...], ...]
    derivative: tuple[int, ...]
    row_derivative: tuple[int, ...]
    matching: tuple[int, ...]

    @property
    def n_columns(self) -> int:
        """Number of columns, those that arose included."""
        return len(self.derivative)


def collapse(rows: Sequence[Sequence[int]], derivative: Sequence[int]) -> list[list[int]]:
    """The rows with each column replaced by the unknown that it is a derivative of, each named once.

    Differentiation can go on without end only if a set of rows contains fewer unknowns than rows, whatever their
    derivatives: `pantelides` terminates if and only if all of these rows can be matched. If not, their Dulmage-Mendelsohn
    blocks show the fault. The numbering of columns is unchanged, so a derivative occurs in no row and appears as an
    underdetermined block without rows, which is not a fault.

    Raises ValueError if a column is the derivative of two columns, or of itself by a circle.
    """
    origin = list(range(len(derivative)))
    integral = inverse(derivative, len(derivative))
    first = [column for column in origin if integral[column] == FREE]
    placed = 0
    for unknown in first:
        column = unknown
        while column != FREE:
            origin[column] = unknown
            placed += 1
            column = derivative[column]
    if placed < len(derivative):
        raise ValueError("a column is its own derivative")
    return [list(dict.fromkeys(origin[column] for column in columns)) for columns in rows]


def pantelides(rows: Sequence[Sequence[int]], n_columns: int, derivative: Sequence[int]) -> Pantelides:
    """Differentiate each row as seldom as possible such that all highest derivatives can be matched.

    A row f(x, x') = 0 may be matched to a column only if the column has no derivative. Sets of k rows with fewer than k such
    columns constrain their unknowns: they are differentiated, each column gets a derivative, and the search continues. All
    minimal sets present are differentiated at once, which changes neither the result nor the order: each row in one has to
    be. Since d/dt f = f_x x' + f_x' x'' generally still contains x, the new row contains the columns of the old one and
    their derivatives. The structural index is max(order), plus 1 if an unknown is left without any derivative.

    `n_columns` counts derivatives too and is the length of `derivative`. Raises ValueError if the process
    would not end (see `collapse`). Costs about the entries of the result, plus one matching.

    C. C. Pantelides: The consistent initialization of differential-algebraic systems. SIAM J. Sci. Stat.
    Comput. 9 (1988) 213-231, doi:10.1137/0909014. That the order is unique: J. D. Pryce: A simple structural
    analysis method for DAEs. BIT Numer. Math. 41 (2001) 364-394, doi:10.1023/A:1021998624799.
    """
    if len(derivative) != n_columns:
        raise ValueError(f"derivative has {len(derivative)} entries for {n_columns} columns")
    unmatched = maximum_matching(collapse(rows, derivative), n_columns).count(FREE)
    if unmatched:
        raise ValueError(f"differentiation would not end: {unmatched} rows too many for their unknowns")
    work = _Differentiation(rows, derivative)
    while constrained := augment(work.rows, work.column_of, work.row_of, work.unmatched):
        work.differentiate(sorted(constrained))
    return Pantelides(work.order(len(rows)), tuple(map(tuple, work.rows)), tuple(work.derivative),
                      tuple(work.row_derivative), tuple(work.column_of))


class _Differentiation:
    """The growing system: rows, columns and their derivatives, and the matching of those that have none."""

    def __init__(self, rows: Sequence[Sequence[int]], derivative: Sequence[int]):
        self.rows = [list(columns) for columns in rows]
        self.derivative = list(derivative)
        self.row_derivative = [FREE] * len(rows)
        highest = [[column for column in columns if derivative[column] == FREE] for columns in rows]
        self.column_of = maximum_matching(highest, len(derivative))
        self.row_of = [row if derivative[column] == FREE else HIDDEN
                       for column, row in enumerate(inverse(self.column_of, len(derivative)))]
        self.unmatched = [row for row, column in enumerate(self.column_of) if column == FREE]

    def differentiate(self, constrained: Sequence[int]) -> None:
        """Append the derivatives of these rows; each takes over its row's match, one derivative higher."""
        self.unmatched = []
        for row in constrained:
            for column in self.rows[row]:
                if self.derivative[column] == FREE:
                    self.derivative[column] = len(self.derivative)
                    self.derivative.append(FREE)
                    self.row_of.append(FREE)
            new = self.row_derivative[row] = len(self.rows)
            columns = self.rows[row]
            derivatives = (self.derivative[column] for column in columns)
            self.rows.append(list(dict.fromkeys([*columns, *derivatives])))
            self.row_derivative.append(FREE)
            column, self.column_of[row] = self.column_of[row], FREE
            if column == FREE:
                self.column_of.append(FREE)
                self.unmatched.append(new)
            else:
                self.column_of.append(self.derivative[column])
                self.row_of[self.derivative[column]], self.row_of[column] = new, HIDDEN

    def order(self, n_rows: int) -> tuple[int, ...]:
        """How often each of the first `n_rows` rows is differentiated."""
        counts = [0] * len(self.rows)
        # A derivative stands behind its row, so it has been counted when the row's turn comes.
        for row in reversed(range(len(self.rows))):
            if self.row_derivative[row] != FREE:
                counts[row] = counts[self.row_derivative[row]] + 1
        return tuple(counts[:n_rows])
