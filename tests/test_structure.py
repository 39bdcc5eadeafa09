"""Structural algorithms against textbook systems, brute force, scipy, numpy and Pryce's offsets."""

import random
import time

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

import heavebond as hb
from heavebond.equations.index_reduction import collapse, pantelides
from heavebond.equations.lost_rank import losses
from heavebond.equations.matching import (
    Block,
    block_lower_triangular,
    components_of,
    dulmage_mendelsohn,
    maximum_matching,
)
from heavebond.equations.tearing import Tearing, tear


@st.composite
def systems(draw, largest=9):
    """(rows, number of columns) of any shape, empty rows and columns that occur nowhere included."""
    n_columns = draw(st.integers(1, largest))
    row = st.lists(st.integers(0, n_columns - 1), max_size=4, unique=True)
    return draw(st.lists(row, max_size=largest)), n_columns


@st.composite
def square_systems(draw, largest=9):
    """(rows, a perfect matching)"""
    n = draw(st.integers(1, largest))
    matching = draw(st.permutations(range(n)))
    more = st.lists(st.integers(0, n - 1), max_size=3)
    return [draw(st.permutations(sorted({column, *draw(more)}))) for column in matching], list(matching)


def rank(rows, n_columns):
    """Structural rank by scipy."""
    if not any(rows):
        return 0
    rows = list(rows)
    pointers = np.cumsum([0] + [len(row) for row in rows])
    columns = np.concatenate([np.array(row, dtype=int) for row in rows])
    graph = csr_array((np.ones(len(columns)), columns, pointers), shape=(len(rows), n_columns))
    return int((maximum_bipartite_matching(graph, perm_type="column") >= 0).sum())


def assert_matching(rows, matching):
    assigned = [column for column in matching if column >= 0]
    assert len(matching) == len(rows)
    assert len(set(assigned)) == len(assigned)
    assert all(column in row for row, column in zip(rows, matching, strict=True) if column >= 0)


def scattered(n, seed, reach=20):
    """A square system of n rows with about three columns each, its numbering shuffled."""
    rng = random.Random(seed)
    name = list(range(n))
    rng.shuffle(name)
    rows = []
    for i in range(n):
        near = [i] + [min(n - 1, max(0, i + rng.randint(-reach, reach // 4))) for _ in range(2)]
        rng.shuffle(near)
        rows.append(list(dict.fromkeys(name[j] for j in near)))
    rng.shuffle(rows)
    return rows


# Matching

@given(systems(largest=14))
def test_matching_is_as_large_as_that_of_scipy(system):
    rows, n_columns = system
    matching = maximum_matching(rows, n_columns)
    assert_matching(rows, matching)
    assert sum(column >= 0 for column in matching) == rank(rows, n_columns)


@pytest.mark.parametrize("n_columns", [1500, 2000, 2600])
def test_matching_of_a_large_random_system_is_as_large_as_that_of_scipy(n_columns):
    rng = random.Random(n_columns)
    rows = [rng.sample(range(n_columns), rng.randint(1, 3)) for _ in range(2000)]
    matching = maximum_matching(rows, n_columns)
    assert_matching(rows, matching)
    assert sum(column >= 0 for column in matching) == rank(rows, n_columns) < 2000


@given(systems(), st.data())
def test_matching_extends_a_start_and_keeps_what_it_matched(system, data):
    rows, n_columns = system
    full = maximum_matching(rows, n_columns)
    start = [column if data.draw(st.booleans()) else -1 for column in full]
    before = list(start)
    extended = maximum_matching(rows, n_columns, start)
    assert start == before
    assert_matching(rows, extended)
    assert sum(column >= 0 for column in extended) == rank(rows, n_columns)
    assert all(now >= 0 for was, now in zip(start, extended, strict=True) if was >= 0)
    assert {column for column in start if column >= 0} <= set(extended)


def test_a_bad_start_is_exchanged_along_an_augmenting_path():
    assert maximum_matching([[0, 1], [0]], 2, [0, -1]) == [1, 0]


def test_a_start_that_is_complete_is_returned_as_it_is():
    assert maximum_matching([[0, 1], [0, 1]], 2, [1, 0]) == [1, 0]


@pytest.mark.parametrize(("start", "says"), [
    ([0], "1 entries for 2 rows"), ([1, -1], "does not occur"), ([0, 0], "both matched to column 0")])
def test_a_start_that_is_no_matching_is_refused(start, says):
    with pytest.raises(ValueError, match=says):
        maximum_matching([[0], [0, 1]], 2, start)


# Over- and underdetermined parts

def test_two_sources_that_fix_one_unknown_and_leave_the_sharing_of_the_force_open():
    # 0: x = x0, 1: x = x1, 2: f0 + f1 = 0 in the columns x, f0, f1; 3: y = 1 in column 3 is sound
    rows = [[0], [0], [1, 2], [3]]
    parts = dulmage_mendelsohn(rows, 4, maximum_matching(rows, 4))
    assert parts.overdetermined == (Block((0, 1), (0,), (0, 1), (0,)),)
    assert parts.underdetermined == (Block((2,), (1, 2), (2,), (1, 2)),)


def test_the_core_leaves_out_what_is_only_wedged_between_two_conflicts():
    # 0, 1 and 2 all fix a; 3, 4, 5 relate a, b and c once more than needed; 6 needs them and is sound.
    rows = [[0], [0], [0], [0, 1, 2], [1, 2], [0, 1, 2], [2, 3]]
    parts = dulmage_mendelsohn(rows, 4, maximum_matching(rows, 4))
    assert parts.underdetermined == ()
    [block] = parts.overdetermined
    assert (block.rows, block.columns) == ((0, 1, 2, 3, 4, 5), (0, 1, 2))
    assert len(block.core_rows) == 2
    assert set(block.core_rows) <= {0, 1, 2}
    assert block.core_columns == (0,)


def test_conflicts_that_share_nothing_are_separate_blocks():
    rows = [[2], [0, 1], [2], [0, 1], [1, 0], [3, 0]]
    parts = dulmage_mendelsohn(rows, 4, maximum_matching(rows, 4))
    assert parts.overdetermined == (Block((0, 2), (2,), (0, 2), (2,)),
                                    Block((1, 3, 4), (0, 1), (1, 3, 4), (0, 1)))
    assert parts.underdetermined == ()


def test_an_equation_without_unknowns_and_an_unknown_without_equation():
    parts = dulmage_mendelsohn([[], [1]], 3, [-1, 1])
    assert parts.overdetermined == (Block((0,), (), (0,), ()),)
    assert parts.underdetermined == (Block((), (0,), (), (0,)), Block((), (2,), (), (2,)))


def test_the_core_of_missing_equations_is_the_smallest_of_its_block():
    # Columns 0..3 hang on one row; column 4 and 5 on it and on another.
    rows = [[0, 1, 2, 3, 4], [4, 5]]
    [block] = dulmage_mendelsohn(rows, 6, maximum_matching(rows, 6)).underdetermined
    assert (block.rows, block.columns) == ((0, 1), (0, 1, 2, 3, 4, 5))
    assert len(block.core_columns) == 2
    assert set(block.core_columns) <= {0, 1, 2, 3}
    assert block.core_rows == (0,)


def test_a_matching_that_is_not_maximum_is_refused():
    with pytest.raises(ValueError, match="not maximum"):
        dulmage_mendelsohn([[0, 1], [0]], 2, [0, -1])


@given(systems())
def test_overdetermined_rows_are_those_without_which_nothing_is_lost(system):
    rows, n_columns = system
    parts = dulmage_mendelsohn(rows, n_columns, maximum_matching(rows, n_columns))
    whole = rank(rows, n_columns)
    spare = {row for row in range(len(rows)) if rank(rows[:row] + rows[row + 1:], n_columns) == whole}
    assert [row for block in parts.overdetermined for row in block.rows] == sorted(spare, key=lambda row: (
        next(k for k, block in enumerate(parts.overdetermined) if row in block.rows), row))


@given(systems())
def test_underdetermined_columns_are_those_without_which_nothing_is_lost(system):
    rows, n_columns = system
    parts = dulmage_mendelsohn(rows, n_columns, maximum_matching(rows, n_columns))
    whole = rank(rows, n_columns)
    spare = {column for column in range(n_columns)
             if rank([[c for c in row if c != column] for row in rows], n_columns) == whole}
    found = [column for block in parts.underdetermined for column in block.columns]
    assert len(found) == len(set(found))
    assert set(found) == spare


@given(systems())
def test_cores_are_irreducible_and_blocks_share_nothing(system):
    rows, n_columns = system
    parts = dulmage_mendelsohn(rows, n_columns, maximum_matching(rows, n_columns))
    for block in parts.overdetermined:
        core = [rows[row] for row in block.core_rows]
        assert set(block.core_rows) <= set(block.rows)
        assert set(block.core_columns) == {column for row in core for column in row}
        assert len(block.core_columns) == len(core) - 1
        assert all(rank(core[:k] + core[k + 1:], n_columns) == len(core) - 1 for k in range(len(core)))
    for block in parts.underdetermined:
        core = set(block.core_columns)
        assert core <= set(block.columns)
        assert set(block.core_rows) == {k for k, row in enumerate(rows) if core & set(row)}
        assert len(block.core_rows) == len(core) - 1
        assert all(rank([[c for c in row if c in core - {known}] for row in rows], n_columns) == len(core) - 1
                   for known in core)
    for blocks in (parts.overdetermined, parts.underdetermined):
        for kind in ("rows", "columns"):
            members = [member for block in blocks for member in getattr(block, kind)]
            assert len(members) == len(set(members))
            assert all(list(getattr(block, kind)) == sorted(getattr(block, kind)) for block in blocks)


def test_components_follow_their_first_row_and_unused_columns_come_last():
    rows = [[5, 4], [1], [4, 0], [], [1, 2]]
    assert components_of(rows, 7) == [((0, 2), (0, 4, 5)), ((1, 4), (1, 2)), ((3,), ()),
                                      ((), (3,)), ((), (6,))]


@given(systems())
def test_components_are_those_of_networkx(system):
    rows, n_columns = system
    graph = nx.Graph()
    graph.add_nodes_from(("row", row) for row in range(len(rows)))
    graph.add_nodes_from(("column", column) for column in range(n_columns))
    graph.add_edges_from((("row", row), ("column", c)) for row, columns in enumerate(rows) for c in columns)
    found = [{("row", row) for row in part} | {("column", column) for column in columns}
             for part, columns in components_of(rows, n_columns)]
    assert sorted(map(sorted, found)) == sorted(map(sorted, nx.connected_components(graph)))


# Index reduction

def test_pendulum_in_cartesian_coordinates_has_index_three():
    # x y vx vy lambda x' y' vx' vy'
    x, y, vx, vy, tension, dx, dy, dvx, dvy = range(9)
    derivative = [dx, dy, dvx, dvy, -1, -1, -1, -1, -1]
    rows = [[dx, vx], [dy, vy], [dvx, tension, x], [dvy, tension, y], [x, y]]
    result = pantelides(rows, 9, derivative)
    assert result.order == (1, 1, 0, 0, 2)
    ddx, ddy = 9, 10
    assert result.n_columns == 11
    assert result.derivative == (dx, dy, dvx, dvy, -1, ddx, ddy, -1, -1, -1, -1)
    # the constraint differentiated, then x' = vx, y' = vy and the constraint once more
    assert result.row_derivative == (6, 7, -1, -1, 5, 8, -1, -1, -1)
    assert result.rows[:5] == tuple(map(tuple, rows))
    assert set(result.rows[5]) == {x, y, dx, dy}
    assert set(result.rows[6]) == {dx, vx, ddx, dvx}
    assert set(result.rows[7]) == {dy, vy, ddy, dvy}
    assert set(result.rows[8]) == {x, y, dx, dy, ddx, ddy}
    assert [row for row, column in enumerate(result.matching) if column >= 0] == [2, 3, 6, 7, 8]
    assert set(result.matching) == {-1, tension, dvx, dvy, ddx, ddy}


def test_pendulum_with_second_derivatives_as_given():
    x, y, tension, dx, dy, ddx, ddy = range(7)
    result = pantelides([[ddx, tension, x], [ddy, tension, y], [x, y]], 7, [dx, dy, -1, ddx, ddy, -1, -1])
    assert result.order == (0, 0, 2)
    assert result.n_columns == 7


def test_two_masses_joined_by_position():
    # x1 x2 v1 v2 F x1' x2' v1' v2'; 0, 1: x' = v; 2, 3: Newton; 4: x1 = x2
    rows = [[5, 2], [6, 3], [7, 4], [8, 4], [0, 1]]
    result = pantelides(rows, 9, [5, 6, 7, 8, -1, -1, -1, -1, -1])
    assert result.order == (1, 1, 0, 0, 2)


def test_two_masses_joined_by_velocity():
    # v1 v2 F v1' v2'; 0, 1: Newton; 2: v1 = v2
    assert pantelides([[3, 2], [4, 2], [0, 1]], 5, [3, 4, -1, -1, -1]).order == (0, 0, 1)


def test_an_ordinary_differential_equation_and_an_index_one_system_are_left_alone():
    # x z x': x' = z, z = f(x)
    result = pantelides([[2, 1], [1, 0]], 3, [2, -1, -1])
    assert (result.order, result.n_columns, result.matching) == ((0, 0), 3, (2, 1))
    assert result.rows == ((2, 1), (1, 0))


def test_a_prescribed_state_at_the_end_of_a_chain_is_differentiated_once_for_each_link():
    # x_k' = x_(k+1), x_4' = u, x_1 given: columns x1..x4 u x1'..x4'
    rows = [[5, 1], [6, 2], [7, 3], [8, 4], [0]]
    result = pantelides(rows, 9, [5, 6, 7, 8, -1, -1, -1, -1, -1])
    assert result.order == (3, 2, 1, 0, 4)


def test_collapse_names_each_unknown_once():
    # 0 -> 2 -> 3 is a chain of derivatives, 1 stands alone
    assert collapse([[3, 1, 0], [2], []], [2, -1, 3, -1]) == [[0, 1], [0], []]


@pytest.mark.parametrize("derivative", [[1, 0], [0, -1]])
def test_a_column_that_is_its_own_derivative_is_refused(derivative):
    with pytest.raises(ValueError, match="own derivative"):
        collapse([[0, 1]], derivative)


def test_a_column_that_is_the_derivative_of_two_is_refused():
    with pytest.raises(ValueError, match="both"):
        collapse([[0, 1]], [2, 2, -1])


def test_a_system_whose_differentiation_would_not_end_is_refused():
    # x x': x = 0 and x' = 1; z in a row that does not help
    with pytest.raises(ValueError, match="would not end: 1 rows"):
        pantelides([[0], [1], [0, 2]], 4, [1, -1, -1, -1])


def test_derivatives_must_be_given_for_all_columns():
    with pytest.raises(ValueError, match="2 entries for 3 columns"):
        pantelides([[0]], 3, [1, -1])


def offsets(sigma):
    """The smallest c >= 0, with d, such that d_j - c_i >= sigma_ij, equal on a transversal (Pryce 2001)."""
    row, column = linear_sum_assignment(np.where(sigma < 0, -1000, sigma), maximize=True)
    c = np.zeros(len(sigma), dtype=int)
    while True:
        d = np.where(sigma < 0, -1, sigma + c[:, None]).max(axis=0)
        new = d[column] - sigma[row, column]
        if (new == c).all():
            return c, d
        c = new


@st.composite
def differential_systems(draw):
    """(sigma, rows, derivative): square, sigma_ij the highest derivative of unknown j in row i or -1."""
    n = draw(st.integers(1, 6))
    sigma = np.full((n, n), -1)
    for i, j in enumerate(draw(st.permutations(range(n)))):
        sigma[i, j] = draw(st.integers(0, 2))
        for k in draw(st.lists(st.integers(0, n - 1), max_size=2)):
            sigma[i, k] = max(sigma[i, k], draw(st.integers(0, 2)))
    column, derivative = {}, []
    for j in range(n):
        for k in range(sigma[:, j].max() + 1):
            column[j, k] = len(derivative)
            derivative.append(len(derivative) + 1 if k < sigma[:, j].max() else -1)
    rows = [[column[j, k] for j in range(n) for k in range(sigma[i, j] + 1)
             if k == sigma[i, j] or draw(st.booleans())] for i in range(n)]
    return sigma, rows, derivative


@settings(max_examples=300)
@given(differential_systems())
def test_orders_are_the_canonical_offsets_of_pryce(case):
    sigma, rows, derivative = case
    c, d = offsets(sigma)
    result = pantelides(rows, len(derivative), derivative)
    assert result.order == tuple(c)
    # each unknown has one column for each of its derivatives 0..d_j
    assert result.n_columns == sum(d) + len(d)


@given(differential_systems())
def test_the_extended_system_is_consistent(case):
    _, rows, derivative = case
    result = pantelides(rows, len(derivative), derivative)
    assert result.rows[:len(rows)] == tuple(map(tuple, rows))
    assert len(result.rows) == len(rows) + sum(result.order)
    assert_matching(result.rows, result.matching)
    for row, (after, column) in enumerate(zip(result.row_derivative, result.matching, strict=True)):
        if after < 0:
            assert column >= 0
            assert result.derivative[column] < 0
        else:
            assert column < 0
            own = result.rows[row]
            assert set(result.rows[after]) == {*own, *(result.derivative[j] for j in own)}


# Order of solution

def test_blocks_keep_the_order_of_declaration_where_they_can():
    # 0 and 3 form a loop in columns 0, 3; 1 needs 2; 4 needs nothing
    rows = [[0, 3], [1, 2], [2], [3, 0], [4]]
    assert block_lower_triangular(rows, [0, 1, 2, 3, 4]) == [[0, 3], [2], [1], [4]]


def test_columns_matched_to_no_row_are_known():
    assert block_lower_triangular([[7, 1, 0], [2, 9, 1]], [1, 2]) == [[0], [1]]


def test_an_empty_system_has_no_blocks():
    assert block_lower_triangular([], []) == []


def test_an_unmatched_row_has_no_place_in_the_order():
    with pytest.raises(ValueError, match="row 1 is not matched"):
        block_lower_triangular([[0], [0]], [0, -1])


@given(square_systems())
def test_each_block_needs_only_what_is_solved_before_and_comes_as_early_as_declared(system):
    rows, matching = system
    blocks = block_lower_triangular(rows, matching)
    n = len(rows)
    reach = np.eye(n, dtype=int)
    needs = np.array([[int(matching[b] in rows[a]) for b in range(n)] for a in range(n)])
    for _ in range(n):
        reach = ((reach @ needs + reach) > 0).astype(int)
    together = {tuple(b for b in range(n) if reach[a, b] and reach[b, a]) for a in range(n)}
    assert sorted(map(tuple, blocks)) == sorted(together)
    solved = set()
    waiting = sorted(together)
    for block in blocks:
        ready = [w for w in waiting if all(set(np.flatnonzero(needs[a])) <= solved | set(w) for a in w)]
        assert tuple(block) == ready[0]
        solved |= set(block)
        waiting.remove(tuple(block))


@given(square_systems())
def test_blocks_do_not_depend_on_the_matching(system):
    rows, matching = system
    other = maximum_matching([row[::-1] for row in rows], len(rows))
    assert block_lower_triangular(rows, matching) == block_lower_triangular(rows, other)


# Tearing

def test_a_loop_of_three_is_torn_once():
    # a = f(c), b = f(a), c = f(b), each solvable for its left side only; a is torn and 0 closes the loop
    rows = {10: [0, 2], 11: [1, 0], 12: [2, 1]}
    cost = {(10, 0): 0, (11, 1): 0, (12, 2): 0}
    assert tear(rows, [0, 1, 2], cost) == Tearing(((11, 1), (12, 2)), (0,), (10,))


def test_the_column_in_most_rows_is_torn_first():
    rows = {0: [0, 3], 1: [1, 3], 2: [2, 3], 3: [0, 1, 2, 3]}
    cost = {(row, column): 0 for row, columns in rows.items() for column in columns}
    assert tear(rows, [0, 1, 2, 3], cost) == Tearing(((0, 0), (1, 1), (2, 2)), (3,), (3,))


def test_an_unknown_that_nothing_can_be_solved_for_is_torn_first():
    rows = {0: [0, 1], 1: [0, 1, 2], 2: [1, 2, 0]}
    cost = {(0, 1): 0, (1, 2): 0, (2, 2): 0}
    # column 1 is in three rows and declared before 0, but only 0 must be torn
    assert tear(rows, [1, 0, 2], cost) == Tearing(((0, 1), (1, 2)), (0,), (2,))


def test_the_cheapest_row_is_taken_and_the_first_declared_of_equals():
    columns = [0, 7]
    assert tear({0: [0], 1: [0]}, columns, {(0, 0): 2, (1, 0): 1}) == Tearing(((1, 0),), (7,), (0,))
    assert tear({1: [0], 0: [0]}, columns, {(0, 0): 1, (1, 0): 1}) == Tearing(((1, 0),), (7,), (0,))
    # 0 costs less, but cannot be solved before 1
    assert tear({0: [0, 7], 1: [0]}, columns, {(0, 7): 0, (1, 0): 3}).sequence == ((1, 0), (0, 7))


def test_a_preference_decides_what_is_torn():
    rows = {0: [0, 1], 1: [0, 1]}
    cost = dict.fromkeys([(0, 0), (0, 1), (1, 0), (1, 1)], 0)
    assert tear(rows, [0, 1], cost).torn == (0,)
    assert tear(rows, [0, 1], cost, prefer_torn={1: 1}).torn == (1,)


def test_columns_outside_the_block_are_known():
    assert tear({4: [9, 3, 8]}, [3], {(4, 3): 1}) == Tearing(((4, 3),), (), ())


def test_a_column_named_twice_in_a_row_counts_once():
    assert tear({4: [3, 3]}, [3], {(4, 3): 1}) == Tearing(((4, 3),), (), ())


def test_a_single_row_that_cannot_be_solved_is_iterated():
    assert tear({4: [3]}, [3], {}) == Tearing((), (3,), (4,))


def test_a_block_that_is_not_square_is_refused():
    with pytest.raises(ValueError, match="2 rows and 1 columns"):
        tear({0: [0], 1: [0]}, [0], {})


@st.composite
def loops(draw):
    """(rows, columns, cost, prefer_torn) of a square block with numbers that do not start at 0."""
    incidence, _ = draw(square_systems())
    rows = {row + 20: columns for row, columns in enumerate(incidence)}
    entries = [(row, column) for row, columns in rows.items() for column in columns]
    cost = {entry: draw(st.integers(0, 3)) for entry in entries if draw(st.booleans())}
    columns = draw(st.permutations(range(len(rows))))
    prefer_torn = {column: draw(st.integers(-1, 1)) for column in columns if draw(st.booleans())}
    return rows, columns, cost, prefer_torn


@pytest.mark.long
@settings(max_examples=300)
@given(loops())
def test_a_torn_block_can_be_evaluated_in_its_sequence(loop):
    rows, columns, cost, prefer_torn = loop
    tearing = tear(rows, columns, cost, prefer_torn=prefer_torn)
    known = set(tearing.torn)
    for row, column in tearing.sequence:
        assert (row, column) in cost
        assert set(rows[row]) - known == {column}
        known.add(column)
    assert known == set(columns)
    assert len(tearing.torn) + len(tearing.sequence) == len(columns)
    assert sorted([*tearing.residual, *(row for row, _ in tearing.sequence)]) == sorted(rows)
    assert len(tearing.torn) == len(tearing.residual)
    assert {column for column in columns if not any((row, column) in cost for row in rows)} <= known


def tear_slowly(rows, columns, cost, prefer_torn):
    """The same heuristic, everything looked up afresh at each step."""
    sequence, torn = [], [c for c in columns if not any((row, c) in cost for row in rows)]
    while left := [c for c in columns if c not in torn and c not in dict(map(reversed, sequence))]:
        unknown = {row: [c for c in left if c in rows[row]] for row in rows}
        ready = [(cost[row, some[0]], k, (row, some[0])) for k, (row, some) in enumerate(unknown.items())
                 if len(some) == 1 and (row, some[0]) in cost]
        gain = {c: sum(len(some) == 2 and c in some and (row, sum(some) - c) in cost
                       for row, some in unknown.items()) for c in left}
        if ready:
            sequence.append(min(ready)[2])
        else:
            torn.append(max(left, key=lambda c, gain=gain: (
                prefer_torn.get(c, 0), gain[c], sum(c in rows[row] for row in rows))))
    return Tearing(tuple(sequence), tuple(torn), tuple(row for row in rows if row not in dict(sequence)))


@pytest.mark.long
@settings(max_examples=500)
@given(loops())
def test_tearing_takes_the_steps_it_says_it_takes(loop):
    rows, columns, cost, prefer_torn = loop
    assert tear(rows, columns, cost, prefer_torn=prefer_torn) == tear_slowly(rows, columns, cost, prefer_torn)


def test_tearing_of_a_large_loop_takes_the_steps_it_says_it_takes():
    rows = dict(enumerate(scattered(150, seed=7)))
    cost = {(row, column): (row + column) % 4 for row in rows for column in rows[row] if (row * column) % 5}
    assert tear(rows, range(150), cost) == tear_slowly(rows, range(150), cost, {})


@pytest.mark.parametrize("seed", range(5))
def test_tearing_solves_a_linear_system(seed):
    rng = np.random.default_rng(seed)
    n = 30
    incidence = scattered(n, seed)
    matrix = np.zeros((n, n))
    for row, columns in enumerate(incidence):
        matrix[row, columns] = rng.uniform(1, 2, len(columns))
    right = rng.uniform(-1, 1, n)
    cost = {(row, column): 0 for row, columns in enumerate(incidence) for column in columns}
    tearing = tear(dict(enumerate(incidence)), range(n), cost)
    assert 0 < len(tearing.torn) < n / 2

    def evaluate(guess):
        z = np.zeros(n)
        z[list(tearing.torn)] = guess
        for row, column in tearing.sequence:
            z[column] = (right[row] - matrix[row] @ z) / matrix[row, column]
        return z, (matrix @ z - right)[list(tearing.residual)]

    k = len(tearing.torn)
    offset = evaluate(np.zeros(k))[1]
    jacobian = np.column_stack([evaluate(unit)[1] - offset for unit in np.eye(k)])
    z, _ = evaluate(np.linalg.solve(jacobian, -offset))
    assert z == pytest.approx(np.linalg.solve(matrix, right), rel=1e-6, abs=1e-6)


# All of it

def all_of_one_system(rows, n):
    """The results of all functions but `pantelides` on a square system."""
    matching = maximum_matching(rows, n)
    costs = {(row, column): (row + column) % 4 for row, columns in enumerate(rows) for column in columns[:2]}
    return (matching, dulmage_mendelsohn(rows, n, matching), components_of(rows, n),
            block_lower_triangular(rows, matching), tear(dict(enumerate(rows)), range(n), costs))


def test_results_are_the_same_each_time_and_leave_the_input_alone():
    rows = scattered(400, seed=3)
    copy = tuple(map(tuple, rows))
    first = all_of_one_system(rows, 400)
    assert tuple(map(tuple, rows)) == copy
    assert first == all_of_one_system(copy, 400)


def test_index_reduction_is_the_same_each_time_and_leaves_the_input_alone():
    # the derivative of column j < 10 is column 40 + j and stands in every second row
    derivative = [40 + j if j < 10 else -1 for j in range(50)]
    rows = [[column + 40 if column < 10 and row % 2 else column for column in columns]
            for row, columns in enumerate(scattered(40, seed=5))]
    copies = tuple(map(tuple, rows)), tuple(derivative)
    first = pantelides(rows, 50, derivative)
    assert sum(first.order) > 0
    assert (tuple(map(tuple, rows)), tuple(derivative)) == copies
    assert first == pantelides(copies[0], 50, copies[1])


def chain(n):
    """Row i in columns i and i + 1, the last in the first column only: one path through the whole system."""
    return [[i, i + 1] for i in range(n - 1)] + [[0, n - 1]]


@pytest.mark.long
@pytest.mark.parametrize("shape", ["scattered", "chain", "overdetermined", "constrained", "augmented"])
def test_fifty_thousand_rows_take_seconds(shape):
    # Quadratic work would take hours of processor time, recursion overflow; the bound leaves room for a slow machine.
    n = 50_000
    begin = time.process_time()
    if shape in ("scattered", "chain"):
        rows = scattered(n, 1) if shape == "scattered" else chain(n)
        all_of_one_system(rows, n)
    elif shape == "overdetermined":
        rows = [[i, i + 1] for i in range(n // 2)] + [[i + 1, i] for i in range(n // 2)]
        [block] = dulmage_mendelsohn(rows, n, maximum_matching(rows, n)).overdetermined
        assert len(block.rows) == n
        assert len(block.columns) == n // 2 + 1
    elif shape == "constrained":
        # n / 5 pairs of masses joined by position
        pairs = range(0, 9 * (n // 5), 9)
        rows = [[k + j for j in row] for k in pairs for row in ([5, 2], [6, 3], [7, 4], [8, 4], [0, 1])]
        derivative = [k + j if j else -1 for k in pairs for j in (5, 6, 7, 8, 0, 0, 0, 0, 0)]
        assert pantelides(rows, len(derivative), derivative).order == (1, 1, 0, 0, 2) * (n // 5)
    else:
        # One augmenting path of n rows is left by the start.
        rows = [[i, i + 1] for i in range(n - 1)] + [[0]]
        assert maximum_matching(rows, n, [*range(n - 1), -1]) == [*range(1, n), 0]
    assert time.process_time() - begin < 20


def test_a_rate_that_is_zero_up_to_rounding_does_not_lose_its_equation() -> None:
    """The usual size of a rate of pressure is declared by no domain and follows from its value. A value of 1.5e-9 Pa/s
    beside terms of 1e7 Pa is rounding; with it as the size, the rate had vanished from its own equation."""
    assembly = hb.assemble(hb.loads("""model: rate
components:
  line:  {is: PressureSource, p_0: 170 bar}
  tank:  {is: Tank}
  gauge: {is: PressureDropSensor}
  rate:  {is: FilteredDerivative, T_f: 0.5 s, u: =gauge.y}
  loss:  {is: Gain, k: 1, u: =rate.y*abs(rate.y)*1e-10 s**2/Pa**2}
nodes:
  line: [line.a, gauge.a]
  tank: [tank.a, gauge.b]
simulate: {until: 1 s, every: 10 ms}
"""))
    flat = assembly.flat
    rate = next(symbol for symbol, unknown in zip(flat.levels[0], flat.unknowns, strict=True) if unknown.name == "rate.y")
    for value in (0.0, 1.5e-9, 1e6):
        point = assembly.point(0.0, np.array([170e5 - 0.5*value]), np.zeros(0), assembly.p, np.zeros(0))
        assert losses(assembly.reduced.system, {**point, rate.element_hash(): value}) == []


def test_the_free_end_of_a_rope_in_space_is_named_with_what_to_add() -> None:
    with pytest.raises(hb.ModelError) as caught:
        hb.simulate(hb.loads("""
model: rope
components: {f: {is: SpatialFixed}, w: {is: Fixed}, r: {is: SpatialRope, c: 1 kN/m, l0: 2 m}}
nodes: {a: [f.a, r.a], e: [r.b], w: [r.w, w.a]}
simulate: {until: 1 s}
"""))
    assert "No part gives node 'e' a mass, or holds it: add a SpatialFixed or a SpatialBody" in caught.value.problems[0].hint
