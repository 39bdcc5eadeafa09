"""Matching of equations and unknowns, Dulmage-Mendelsohn and block triangular form: graph algorithms on integers.

Equations are rows 0..m-1, unknowns are columns 0..n-1, and `rows[i]` lists the columns that occur in row i,
in the order of declaration. Nothing here knows names, values or units. Every function is pure, iterative and
deterministic: the order of rows and columns decides every tie.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

# Values beside row and column numbers in a matching.
FREE = -1
# A column that is not there for matching: `augment` neither assigns it nor walks through it.
HIDDEN = -2
# Each unmatched row has a core of its own; a block of thousands is not searched for the very smallest.
CORES_TRIED = 16


def maximum_matching(rows: Sequence[Sequence[int]], n_columns: int,
                     start: Sequence[int] | None = None) -> list[int]:
    """Assign a separate column to as many rows as possible.

    A matching is a set of entries (row, column) with no row and no column in common; a square system is structurally
    nonsingular if one covers all rows. Short rows choose first, as they have the least choice; then disjoint augmenting
    paths are added in phases, each linear in the entries, after Hopcroft and Karp. The equations of a machine need a few
    phases, unstructured random ones some tens.

    `start` (length m, column or -1) is a matching to extend: its rows and columns stay matched, but the
    pairs may change. Returns the column of each row or -1, length m. Raises ValueError if `start` is not a matching
    of `rows`.

    J. E. Hopcroft, R. M. Karp: An n^(5/2) algorithm for maximum matchings in bipartite graphs. SIAM J.
    Comput. 2 (1973) 225-231, doi:10.1137/0202019.
    """
    column_of = [FREE] * len(rows) if start is None else list(start)
    if len(column_of) != len(rows):
        raise ValueError(f"start has {len(column_of)} entries for {len(rows)} rows")
    for row, column in enumerate(column_of):
        if column != FREE and column not in rows[row]:
            raise ValueError(f"start assigns column {column} to row {row}, where it does not occur")
    row_of = inverse(column_of, n_columns)
    for row in sorted(range(len(rows)), key=lambda row: len(rows[row])):
        if column_of[row] == FREE:
            for column in rows[row]:
                if row_of[column] == FREE:
                    column_of[row], row_of[column] = column, row
                    break
    augment(rows, column_of, row_of, [row for row, column in enumerate(column_of) if column == FREE])
    return column_of


def inverse(column_of: Sequence[int], n_columns: int) -> list[int]:
    """The row of each column or -1, length n, from the column of each row.

    Raises ValueError if two rows share a column.
    """
    row_of = [FREE] * n_columns
    for row, column in enumerate(column_of):
        if column != FREE:
            if row_of[column] != FREE:
                raise ValueError(f"rows {row_of[column]} and {row} are both matched to column {column}")
            row_of[column] = row
    return row_of


def augment(rows: Sequence[Sequence[int]], column_of: list[int], row_of: list[int],
            free: list[int]) -> list[int]:
    """Match as many rows of `free` as possible; `column_of` and `row_of` are changed in place.

    The cost is proportional to the part that can be reached from `free`, not to the size of the graph. Returns the rows
    reached from the unmatched rows, including these; it is empty if all are matched. By Hall's theorem each of its rows
    belongs to a minimal set of k rows with k - 1 columns (without HIDDEN ones), and no other row does.
    """
    while free:
        level, free_column = _layers(rows, row_of, free)
        if not free_column:
            return list(level)
        cursors: dict[int, Iterator[int]] = {}
        free = [row for row in free if not _flip_path(row, rows, column_of, row_of, level, cursors)]
    return []


def _layers(rows: Sequence[Sequence[int]], row_of: Sequence[int], roots: Sequence[int],
            most: int | None = None) -> tuple[dict[int, int], bool]:
    """Distance of the rows reached by alternating paths from `roots`, and whether a free column was met.

    A path steps from a row to one of its columns and on to that column's row. The search ends when the number of rows
    reaches `most`, or at twice the distance of the nearest free column.
    """
    level = dict.fromkeys(roots, 0)
    front, depth, free_column = list(roots), 0, False
    # The shortest paths alone, as in Hopcroft and Karp, take twice the searches; all paths are not local.
    deepest = len(rows)
    while front and depth < deepest and (most is None or len(level) < most):
        depth += 1
        reached = []
        for row in front:
            for column in rows[row]:
                owner = row_of[column]
                if owner == FREE:
                    free_column = True
                elif owner != HIDDEN and owner not in level:
                    level[owner] = depth
                    reached.append(owner)
        front = reached
        if free_column:
            deepest = min(deepest, 2 * depth)
    return level, free_column


def _flip_path(root: int, rows: Sequence[Sequence[int]], column_of: list[int], row_of: list[int],
               level: Mapping[int, int], cursors: dict[int, Iterator[int]]) -> bool:
    """Walk down the layers from an unmatched row to a free column and exchange the matching along the way.

    `cursors` are shared by all walks of a phase, so that each entry is looked at once.
    """
    path = [root]
    path_columns: list[int] = []
    while path:
        row = path[-1]
        for column in cursors.setdefault(row, iter(rows[row])):
            owner = row_of[column]
            if owner == FREE:
                for stop, exchanged in zip(path, [*path_columns, column], strict=True):
                    column_of[stop], row_of[exchanged] = exchanged, stop
                return True
            if owner != HIDDEN and level.get(owner) == level[row] + 1:
                path.append(owner)
                path_columns.append(column)
                break
        else:
            path.pop()
            if path_columns:
                path_columns.pop()
    return False


@dataclass(frozen=True)
class Block:
    """A part with more rows than columns, or with more columns than rows; all tuples are sorted.

    The core is irreducible. Overdetermined: the k `core_rows` contain the k - 1 `core_columns`, and without any one of the
    rows the others can be matched. Underdetermined: the k `core_columns` occur in the k - 1 `core_rows`, and if any one of
    the columns were known the others could be matched.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    core_rows: tuple[int, ...]
    core_columns: tuple[int, ...]


@dataclass(frozen=True)
class DulmageMendelsohn:
    """The over- and underdetermined blocks by their first row and first column; the rest is square."""

    overdetermined: tuple[Block, ...]
    underdetermined: tuple[Block, ...]


def dulmage_mendelsohn(rows: Sequence[Sequence[int]], n_columns: int,
                       matching: Sequence[int]) -> DulmageMendelsohn:
    """Find where a system has too many and where too few equations.

    The overdetermined part is reached by alternating paths from the unmatched rows, the underdetermined part by those from
    the unmatched columns; neither depends on the matching. Each consists of disjoint blocks.

    The rows and columns reached from one unmatched row are a core: k rows with k - 1 columns, all matched. It is
    irreducible, since exchanging along the path to any of its rows leaves that one unmatched instead. (In the transversal
    matroid of the rows this is the fundamental circuit of the unmatched row.)

    `matching` (column of each row or -1, length m) must be maximum, else ValueError. Near-linear in the
    entries.

    A. L. Dulmage, N. S. Mendelsohn: Coverings of bipartite graphs. Canad. J. Math. 10 (1958) 517-534,
    doi:10.4153/CJM-1958-052-0. A. Pothen, C.-J. Fan: Computing the block triangular form of a sparse matrix.
    ACM Trans. Math. Software 16 (1990) 303-324, doi:10.1145/98267.98287.
    """
    over = _excess_blocks(rows, inverse(matching, n_columns))
    rows_of: list[list[int]] = [[] for _ in range(n_columns)]
    for row, columns in enumerate(rows):
        for column in columns:
            rows_of[column].append(row)
    under = _excess_blocks(rows_of, matching)
    turned = (Block(b.columns, b.rows, b.core_columns, b.core_rows) for b in under)
    return DulmageMendelsohn(over, tuple(turned))


def _excess_blocks(rows: Sequence[Sequence[int]], row_of: Sequence[int]) -> tuple[Block, ...]:
    """The overdetermined blocks; with rows and columns exchanged, the underdetermined ones turned round."""
    matched = set(row_of)
    unmatched = [row for row in range(len(rows)) if row not in matched]
    level, free_column = _layers(rows, row_of, unmatched)
    if free_column:
        raise ValueError("the matching is not maximum: an alternating path joins an unmatched row and column")
    reached = sorted(level)
    blocks = []
    for part, columns in components_of([rows[row] for row in reached], len(row_of)) if reached else ():
        if part:
            block = [reached[k] for k in part]
            # the fewest rows that one unmatched row reaches
            shortest = sorted((row for row in block if row not in matched), key=lambda row: len(rows[row]))[:CORES_TRIED]
            core, _ = _layers(rows, row_of, shortest[:1])
            for row in shortest[1:]:
                # A search that comes to as many rows as are known to suffice is broken off.
                smaller, _ = _layers(rows, row_of, [row], most=len(core))
                if len(smaller) < len(core):
                    core = smaller
            core_columns = sorted({column for row in core for column in rows[row]})
            blocks.append(Block(tuple(block), columns, tuple(sorted(core)), tuple(core_columns)))
    return tuple(blocks)


def components_of(rows: Sequence[Sequence[int]],
                  n_columns: int) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Split a system into the parts that share neither rows nor columns, as (rows, columns), each sorted.

    The parts follow their first row; columns that occur nowhere come last, each as a part without rows.
    """
    parent = list(range(n_columns))

    def root(column: int) -> int:
        while parent[column] != column:
            parent[column] = parent[parent[column]]
            column = parent[column]
        return column

    for columns in rows:
        for neighbour in columns[1:]:
            parent[root(neighbour)] = root(columns[0])
    parts: dict[int, tuple[list[int], list[int]]] = {}
    for row, columns in enumerate(rows):
        key = root(columns[0]) if columns else -1 - row
        parts.setdefault(key, ([], []))[0].append(row)
    for column in range(n_columns):
        parts.setdefault(root(column), ([], []))[1].append(column)
    return [(tuple(part), tuple(columns)) for part, columns in parts.values()]


def block_lower_triangular(rows: Sequence[Sequence[int]], matching: Sequence[int]) -> list[list[int]]:
    """The smallest blocks of rows that must be solved together, in an order in which they can be solved.

    A row needs the rows that its other columns are matched to. Blocks are the strongly connected components of that digraph
    (they do not depend on the matching); each lists its rows in ascending order. Of the blocks that can be solved next the
    one with the smallest row is taken, so the order of declaration is kept if possible.

    Columns matched to no row are taken as known. Raises ValueError if a row is unmatched.

    R. Tarjan: Depth-first search and linear graph algorithms. SIAM J. Comput. 1 (1972) 146-160,
    doi:10.1137/0201010.
    """
    if FREE in matching:
        raise ValueError(f"row {list(matching).index(FREE)} is not matched to a column")
    row_of = inverse(matching, 1 + max(matching, default=-1))
    known = len(row_of)
    needs = [[row_of[column] for column in columns
              if column < known and row_of[column] != FREE and row_of[column] != row] for row, columns in enumerate(rows)]
    blocks = sorted(map(sorted, _strongly_connected(needs)))
    block_of = [0] * len(rows)
    for k, block in enumerate(blocks):
        for row in block:
            block_of[row] = k
    return [blocks[k] for k in _first_possible([{block_of[need] for row in block for need in needs[row]} - {k}
                                                for k, block in enumerate(blocks)])]


def _strongly_connected(successors: Sequence[Sequence[int]]) -> list[list[int]]:
    """The largest sets of vertices that can all be reached from each other, where `successors[v]` are the ends of the
    edges from v.

    Flat lists: a networkx graph of the same takes five times as long, and a tenth of a second to import.
    """
    index, low = [FREE] * len(successors), [0] * len(successors)
    components: list[list[int]] = []
    stack: list[int] = []
    placed, count = [False] * len(successors), 0
    for root in range(len(successors)):
        path = [root] if index[root] == FREE else []
        cursors = [iter(successors[root])]
        while path:
            vertex = path[-1]
            if index[vertex] == FREE:
                index[vertex] = low[vertex] = count
                count += 1
                stack.append(vertex)
            for successor in cursors[-1]:
                if index[successor] == FREE:
                    path.append(successor)
                    cursors.append(iter(successors[successor]))
                    break
                if not placed[successor]:
                    low[vertex] = min(low[vertex], low[successor])
            else:
                path.pop()
                cursors.pop()
                if path:
                    low[path[-1]] = min(low[path[-1]], low[vertex])
                if low[vertex] == index[vertex]:
                    component = [stack.pop()]
                    while component[-1] != vertex:
                        component.append(stack.pop())
                    for member in component:
                        placed[member] = True
                    components.append(component)
    return components


def _first_possible(needs: Sequence[Collection[int]]) -> Iterator[int]:
    """The numbers 0.. so that each comes after all that it needs, always the smallest that can come."""
    waiting = [len(predecessors) for predecessors in needs]
    needed_by: list[list[int]] = [[] for _ in needs]
    for k, predecessors in enumerate(needs):
        for need in predecessors:
            needed_by[need].append(k)
    ready = [k for k, number in enumerate(waiting) if not number]  # ascending, so a heap
    while ready:
        k = heappop(ready)
        yield k
        for successor in needed_by[k]:
            waiting[successor] -= 1
            if not waiting[successor]:
                heappush(ready, successor)
