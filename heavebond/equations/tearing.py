"""Tearing of a block of equations: few unknowns that are iterated, the others explicit.

Rows and columns are numbers, as in `matching`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush


@dataclass(frozen=True)
class Tearing:
    """How to solve a block: guess `torn`, evaluate `sequence` (row, column it gives), until `residual` are 0.

    There are as many torn columns as residual rows. A row in the sequence contains, in addition to its own column, only torn
    columns, columns of rows before it, and columns outside the block.
    """

    sequence: tuple[tuple[int, int], ...]
    torn: tuple[int, ...]
    residual: tuple[int, ...]


def tear(rows: Mapping[int, Sequence[int]], columns: Sequence[int], cost: Mapping[tuple[int, int], int], *,
         prefer_torn: Mapping[int, int] | None = None) -> Tearing:
    """Reduce the simultaneous unknowns of a block to few by solving as many rows as possible explicitly.

    `rows[row]` lists the columns in a row; those not in `columns` count as known. `cost[row, column]` is the cost of solving
    the row explicitly for the column (any small integers); without an entry this is impossible. The orders of declaration
    are the orders of `rows` and `columns`.

    The smallest number of torn columns is NP-hard to find; this is a greedy heuristic in near-linear time:
    1. columns for which no row can be solved are torn;
    2. then a row with one unknown column left, solvable for it, is taken: the cheapest, the first declared;
    3. if there is none, a column is torn: of the highest `prefer_torn` (else 0), one that makes most rows solvable for their
       last column, one in most rows, the first declared; and on with 2.

    Raises ValueError if there are not as many rows as columns.

    H. Elmqvist, M. Otter: Methods for tearing systems of equations in object-oriented modeling. Proc.
    European Simulation Multiconference (ESM'94), Barcelona 1994.
    """
    if len(rows) != len(columns):
        raise ValueError(f"a block of {len(rows)} rows and {len(columns)} columns cannot be torn")
    loop = _Loop(rows, columns, cost, prefer_torn or {})
    sequence: list[tuple[int, int]] = []
    torn = [column for column in columns if not any((row, column) in cost for row in loop.rows_of[column])]
    for column in torn:
        loop.learn(column)
    while (step := loop.next_step()) is not None:
        row, column = step
        if row is None:
            torn.append(column)
        else:
            sequence.append((row, column))
        loop.learn(column)
    used = {row for row, _ in sequence}
    return Tearing(tuple(sequence), tuple(torn), tuple(row for row in rows if row not in used))


class _Loop:
    """The state of tearing a block: the known columns, the solvable rows, and the gain of tearing each column."""

    def __init__(self, rows: Mapping[int, Sequence[int]], columns: Sequence[int],
                 cost: Mapping[tuple[int, int], int], prefer_torn: Mapping[int, int]):
        self.cost = cost
        self.rows_of: dict[int, list[int]] = {column: [] for column in columns}
        self.columns_of = {row: [c for c in dict.fromkeys(rows[row]) if c in self.rows_of] for row in rows}
        for row, members in self.columns_of.items():
            for column in members:
                self.rows_of[column].append(row)
        self.known: set[int] = set()
        self.unknowns = {row: len(members) for row, members in self.columns_of.items()}
        # (cost, place of the row, row, column) of the rows with one unknown column
        self.ready: list[tuple[int, int, int, int]] = []
        self.number = {row: k for k, row in enumerate(rows)}
        # how many rows have two unknown columns, this one and another that they can be solved for
        self.gain = dict.fromkeys(columns, 0)
        # what comes before the gain, and what after it
        self.preference = {column: -prefer_torn.get(column, 0) for column in columns}
        self.rank = {column: (-len(self.rows_of[column]), k) for k, column in enumerate(columns)}
        # (preference, -gain, rank, column): entered anew whenever the gain changes, which voids older entries
        self.candidates: list[tuple[int, int, tuple[int, int], int]] = []
        for column in columns:
            self._rate(column, 0)
        for row in rows:
            self._look_at(row)

    def next_step(self) -> tuple[int | None, int] | None:
        """The next (row, column) to solve, (None, column) to tear, or None when every column is known."""
        while self.ready:
            _, _, row, column = heappop(self.ready)
            if column not in self.known:
                return row, column
        while self.candidates:
            _, loss, _, column = heappop(self.candidates)
            if column not in self.known and -loss == self.gain[column]:
                return None, column
        return None

    def learn(self, column: int) -> None:
        """Count a column as known."""
        self.known.add(column)
        for row in self.rows_of[column]:
            self.unknowns[row] -= 1
            if self.unknowns[row] == 1 and (row, column) in self.cost:
                self._rate(next(c for c in self.columns_of[row] if c not in self.known), -1)
            self._look_at(row)

    def _look_at(self, row: int) -> None:
        """Register a row with one or two remaining unknown columns."""
        if self.unknowns[row] > 2:
            return
        unknown = [column for column in self.columns_of[row] if column not in self.known]
        if len(unknown) == 1 and (row, unknown[0]) in self.cost:
            heappush(self.ready, (self.cost[row, unknown[0]], self.number[row], row, unknown[0]))
        elif len(unknown) == 2:
            for column, partner in (unknown, unknown[::-1]):
                if (row, partner) in self.cost:
                    self._rate(column, 1)

    def _rate(self, column: int, change: int) -> None:
        self.gain[column] += change
        heappush(self.candidates, (self.preference[column], -self.gain[column], self.rank[column], column))
