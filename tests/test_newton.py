"""Nonlinear equations from far guesses: where Newton's method alone fails, and what its helpers are for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csc_array, diags_array

import heavebond as hb
from heavebond.numerics.initialise import start
from heavebond.numerics.matrices import MATRICES, factors, least_change, null_space
from heavebond.numerics.newton import Scaling, continued, newton, settled
from heavebond.numerics.start_equations import StartEquations

FREE = Scaling(np.ones(1), np.full(1, -np.inf), np.full(1, np.inf))


def scalar(f, slope):
    """A system of one equation in one unknown."""
    return lambda y: (np.array([f(y[0])]), np.array([[slope(y[0])]]))


def test_newton_finds_a_root_and_counts_its_steps() -> None:
    found = newton(scalar(lambda x: x**3 - 8, lambda x: 3 * x**2), np.array([5.0]), FREE)
    assert found.good
    assert found.y[0] == pytest.approx(2.0, rel=1e-9)
    assert 3 <= found.steps <= 10


def test_steps_stay_within_the_bounds() -> None:
    roots = scalar(lambda x: x**2 - 4, lambda x: 2 * x)
    inside = Scaling(np.ones(1), np.zeros(1), np.full(1, np.inf))
    assert newton(roots, np.array([0.01]), inside).y[0] == pytest.approx(2.0)
    assert newton(roots, np.array([-0.01]), FREE).y[0] == pytest.approx(-2.0)
    beyond = newton(roots, np.array([0.5]), Scaling(np.ones(1), np.zeros(1), np.ones(1)))
    assert not beyond.good and beyond.y[0] == 1.0


def test_a_step_of_least_norm_leaves_what_nothing_decides() -> None:
    # x + y = 2: the nearest point to the guess
    found = newton(lambda y: (np.array([y[0] + y[1] - 2]), np.array([[1.0, 1.0]])), np.array([3.0, 1.0]),
                   Scaling(np.ones(2), np.full(2, -np.inf), np.full(2, np.inf)))
    assert found.y == pytest.approx([2.0, 0.0])


def test_what_is_no_number_is_not_good() -> None:
    with np.errstate(invalid="ignore"):
        found = newton(lambda y: (np.log(y - 2), np.array([[1.0]])), np.array([1.0]), FREE)
    assert not found.good
    assert found.size == np.inf


def test_continuation_follows_a_path_on_which_newton_stalls() -> None:
    # a minimum of |f| beside the way: f falls from the guess on to a place that is no root, where its slope is zero
    def f(x: float) -> float:
        return (x - 4) * ((x + 1) ** 2 + 0.1)

    def slope(x: float) -> float:
        return (x + 1) ** 2 + 0.1 + 2 * (x - 4) * (x + 1)

    system = scalar(f, slope)
    assert not newton(system, np.array([-2.0]), FREE).good
    # the homotopy must turn round there too; from the other side it goes through
    found = continued(lambda done: scalar(lambda x: np.arctan(50 * (x - 3)), lambda x: 50 / (1 + 2500 * (x - 3) ** 2)),
                      np.array([0.0]), FREE)
    assert found.good
    assert found.y[0] == pytest.approx(3.0, abs=1e-6)


def test_a_machine_settles_where_its_law_has_no_gradient_at_the_guess() -> None:
    # a tank that fills until it overflows at 5
    def rate(x: float) -> float:
        return 1 - 10 * max(x - 5, 0.0)

    def slope(x: float) -> float:
        return -10.0 if x > 5 else 0.0

    system = scalar(rate, slope)

    def slowed(before, step):
        return scalar(lambda x: rate(x) - (x - before[0]) / step, lambda x: slope(x) - 1 / step)

    assert not newton(system, np.zeros(1), FREE).good
    assert not continued(lambda done: system, np.zeros(1), FREE).good
    found = settled(system, slowed, np.zeros(1), FREE)
    assert found.good
    assert found.y[0] == pytest.approx(5.1)


def test_what_never_settles_is_given_up() -> None:
    def slowed(before, step):
        return scalar(lambda x: 1 - (x - before[0]) / step, lambda x: -1 / step)

    assert not settled(scalar(lambda x: 1.0, lambda x: 0.0), slowed, np.zeros(1), FREE).good


@pytest.fixture
def chain() -> np.ndarray:
    """Second differences of 300 points, the first held: well posed, and ill conditioned by 1e5."""
    n = 300
    return np.diag(np.full(n, 2.0)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1)


def test_large_regular_systems_are_eliminated_to_the_same_solution(chain: np.ndarray) -> None:
    right = np.random.default_rng(1).normal(size=(300, 2))
    assert factors(chain) is not None
    assert least_change(chain, right) == pytest.approx(np.linalg.lstsq(chain, right, rcond=None)[0], rel=1e-8)


def test_what_nothing_decides_is_left_by_the_least_change_in_large_systems_too(chain: np.ndarray) -> None:
    # held nowhere: only differences matter
    chain[0, 0] = chain[-1, -1] = 1.0
    assert factors(chain) is None
    right = np.random.default_rng(2).normal(size=300)
    right -= right.mean()
    found = least_change(chain, right)
    assert found.mean() == pytest.approx(0.0, abs=1e-9 * np.abs(found).max())
    assert chain @ found == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("small", [1e-12, 0.0])
def test_a_rank_in_doubt_is_not_eliminated(chain: np.ndarray, small: float) -> None:
    chain[:, 5] *= small
    assert factors(chain) is None


def sparse_chain(n: int, held: float) -> csc_array:
    """Second differences of n points, the first held by a spring of this stiffness, the last free."""
    diagonal = np.full(n, 2.0)
    diagonal[0], diagonal[-1] = 1.0 + held, 1.0
    return csc_array(diags_array([-np.ones(n - 1), diagonal, -np.ones(n - 1)], offsets=[-1, 0, 1]))


@pytest.mark.parametrize("n", [300, 2 * MATRICES.max_dense])
def test_a_sparse_chain_hangs_as_its_closed_form_says(n: int) -> None:
    # each of n weights of 1 on springs of 1: the k-th extension carries the n - k below it
    found = least_change(sparse_chain(n, 1.0), np.ones(n))
    # conditioned by 4 n**2, 2e7: eight digits are left of sixteen
    assert found == pytest.approx(np.cumsum(n - np.arange(n)), rel=1e-8)


def test_a_free_chain_larger_than_is_decomposed_moves_as_little_as_it_can() -> None:
    n = 2 * MATRICES.max_dense
    free = sparse_chain(n, 0.0)
    assert factors(free) is None
    assert abs(null_space(free, 1e-10)) == pytest.approx(np.full((n, 1), n ** -0.5), rel=1e-6)
    right = np.zeros(n)
    right[[0, -1]] = -1.0, 1.0  # pulled at both ends: every link is stretched by 1
    found = least_change(free, right)
    # the damping of 1e-8 stands beside a smallest singular value of 6e-7: a few parts in 1e4 a time, repeated
    assert found == pytest.approx(np.arange(n) - (n - 1) / 2, rel=1e-5, abs=1e-5 * n)


def test_what_few_equations_ask_of_many_unknowns_is_shared_out() -> None:
    n = 3 * MATRICES.max_dense
    pairs = csc_array((np.ones(n), (np.arange(n) // 2, np.arange(n))), shape=(n // 2, n))  # x_2k + x_2k+1 = 4
    assert least_change(pairs, np.full(n // 2, 4.0)) == pytest.approx(np.full(n, 2.0), rel=1e-8)


def string(folder: Path, pieces: int, top: str) -> hb.Assembly:
    """Weights of 10 N, each on a spring of 1 kN/m below the one before."""
    (folder / "components").mkdir(exist_ok=True)
    (folder / "components" / "piece.yaml").write_text("""
component: Piece
summary: A mass on a spring, with its weight.
ports: {a: translational, b: translational}
components: {spring: {is: Spring, c: 1 kN/m}, mass: {is: Mass, m: 1 kg}, weight: {is: ForceSource, u: 10 N}}
nodes: {a: [a, spring.a], b: [b, spring.b, mass.a, weight.a]}
""", encoding="utf-8")
    (folder / "string.yaml").write_text(f"""
model: string
components: {{top: {top}, piece: {{is: Piece, repeat: {pieces}}}, end: {{is: Mass, m: 1 kg}}}}
nodes: {{top: [top.a, piece.a], end: [piece.b, end.a]}}
initial: {{start: steady}}
""", encoding="utf-8")
    return hb.assemble(hb.load(folder / "string.yaml"))


@pytest.mark.long
def test_a_long_string_starts_hanging_at_rest_and_refuses_where_nothing_holds_it(tmp_path: Path) -> None:
    pieces = MATRICES.max_dense // 2 + 50  # more unknowns than are ever decomposed
    first = start(string(tmp_path, pieces, "{is: Fixed}"))
    lowest = max(abs(line.used) for line in first.table if line.unit == "m")
    assert lowest == pytest.approx(0.01 * pieces * (pieces + 1) / 2, rel=1e-6)
    with pytest.raises(hb.StartError) as refused:
        start(string(tmp_path, pieces, "{is: Mass, m: 1 kg}"))
    assert refused.value.problems[0].code == "start-unsteady"


@pytest.mark.parametrize(("force", "straight"), [
    ("=-3 N*s/m * load.v + 2 N*sin(time/(1 s))", True), ("=-3 N*s**2/m**2 * load.v**2", False),
    ("=-3 N*sign(load.v)", False), ("=if_else(load.v > 0 m/s, 1 N, 2 N)", False),
    ("=min(load.v*1 N*s/m, 1 N)", False)])
def test_straight_lines_are_told_from_others(force: str, straight: bool) -> None:
    """Where nothing but straight lines is asked, one step tells all; what jumps is none, though its slope is constant."""
    assembly = hb.assemble(hb.loads(f"""
model: cart
components:
  wall:   {{is: Fixed}}
  spring: {{is: Spring, c: 1 kN/m}}
  cart:   {{is: Mass, m: 2 kg}}
  push:   {{is: ForceSource, u: "{force}"}}
nodes: {{wall: [wall.a, spring.a], load: [spring.b, cart.a, push.a]}}
initial: {{start: steady, load.x: 1 m}}
"""))
    assert StartEquations(assembly).all.affine is straight
    with pytest.raises(hb.StartError, match="the initial values contradict each other"):
        start(assembly)


def test_inside_means_held_by_no_bound() -> None:
    frame = Scaling(np.ones(2), np.zeros(2), np.full(2, np.inf))
    assert frame.inside(np.array([1.0, 2.0]))
    assert not frame.inside(np.array([0.0, 2.0]))
