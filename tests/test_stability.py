"""Eigenvalues judged stable, free, undamped or growing, against matrices whose eigenvalues are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from test_linearisation import FREE, OSCILLATOR

import heavebond as hb
from heavebond.linear.linearisation import Linear, Linearisation
from heavebond.linear.operating_point import OperatingPoints
from heavebond.linear.stability import Stability, eigenvalues, stability, strong_blocks
from heavebond.numerics.dae import Array

FREE_WITH_VALVE = FREE.replace("spring: {is: Spring, c: 300 N/m}", "spring: {is: SpringDamper, c: 300 N/m, d: 40 kN*s/m}")


def _judged(text: str) -> Stability:
    points = OperatingPoints(hb.loads(text))
    return Linearisation(points.assembly).at(points.at()).stability()


def _plain(a: Array) -> Stability:
    return stability(a, np.ones(len(a)), [f"part{k}.x" for k in range(len(a))])


def test_a_free_body_is_marginally_stable_and_named() -> None:
    found = _judged(FREE)
    assert found.verdict == "marginally stable"
    free, = found.free
    assert free.value == 0
    assert free.multiplicity == 2
    assert set(free.states) == {"left.x", "right.x"}
    assert free.text.startswith("rigid-body mode of")
    assert [abs(e.value.imag) for e in found.undamped] == pytest.approx([20])


def test_a_stiff_damper_beside_does_not_blur_the_free_mode() -> None:
    """The damper's rate is 5e4 1/s, the spring's 7.5e-3 1/s: seven decades between, and a double zero beside them."""
    found = _judged(FREE_WITH_VALVE)
    assert found.verdict == "marginally stable"
    assert [e.multiplicity for e in found.free] == [2]
    rates = sorted(-e.value.real for e in found.eigenvalues if not e.free)
    assert rates == pytest.approx(-np.sort(np.roots([1, 40e3 * 4 / 3, 300 * 4 / 3]))[::-1], rel=1e-7)


def test_a_damped_oscillator_is_stable_and_an_undamped_one_marginally() -> None:
    assert _judged(OSCILLATOR).verdict == "stable"
    found = _judged(OSCILLATOR.replace("d: 40 N*s/m", "d: 0 N*s/m"))
    assert found.verdict == "marginally stable"
    assert found.reasons == ("undamped mode at 3.183 Hz of load.v, load.x",) or \
        found.reasons == ("undamped mode at 3.183 Hz of load.x, load.v",)
    assert found.abscissa == 0


def test_a_controller_without_integral_gain_is_an_integrator_by_name() -> None:
    """Its integral part q obeys q' = K_i e = 0."""
    text = OSCILLATOR.replace("u: =force}", "u: =control.y}\n  control: {is: PID, r: 0 m, u: =load.x, K_p: 1 N/m, "
                              "y_min: -1 kN, y_max: 1 kN}")
    found = _judged(text)
    assert found.verdict == "marginally stable"
    assert found.reasons == ("integrator of control.q",)


@pytest.mark.parametrize("chain", [1, 2, 3, 4])
def test_zeros_of_any_chain_are_exact_after_any_change_of_coordinates(chain: int) -> None:
    """A nilpotent block beside a stable one, seen in random coordinates: LAPACK's zeros wobble by eps**(1/chain)."""
    random = np.random.default_rng(chain)
    known = np.zeros((chain + 3, chain + 3))
    known[:chain, :chain] = np.eye(chain, k=1)
    known[chain:, chain:] = np.diag([-1.0, -7.0, -90.0])
    for _ in range(20):
        basis = random.normal(size=known.shape) + 2 * np.eye(len(known))
        if np.linalg.cond(basis) > 30:
            continue
        a = basis @ known @ np.linalg.inv(basis)
        values = np.sort_complex(eigenvalues(a))
        assert np.count_nonzero(values == 0) == chain
        assert values[:3] == pytest.approx([-90, -7, -1], rel=1e-6)
        assert _plain(a).verdict == "marginally stable"
        assert sum(e.multiplicity for e in _plain(a).free) == chain


def test_a_slow_state_beside_a_fast_one_is_not_taken_for_free() -> None:
    """A tank that empties in a day behind a valve of 1e7 1/s, the one driving the other."""
    a = np.array([[-1e7, 0.0], [3.0, -1e-5]])
    assert _plain(a).verdict == "stable"
    assert _plain(np.array([[-1e5, 1.0], [3.0, 0.0]])).verdict == "unstable"
    assert _plain(np.array([[-1e5, 1.0], [-3.0, 0.0]])).verdict == "stable"


@pytest.mark.parametrize("growth", [1e-6, 1e-3, 1.0])
def test_growth_is_told_from_rounding(growth: float) -> None:
    for sign, verdict in ((1, "unstable"), (-1, "stable")):
        found = _plain(np.array([[sign * growth, 10.0], [-10.0, sign * growth]]))
        assert found.verdict == verdict
        assert found.abscissa == pytest.approx(sign * growth, rel=1e-6)


def test_what_is_too_slow_for_the_machine_is_told_with_a_share() -> None:
    found = _plain(np.diag([-1e6, -0.5, 0.0]))
    assert [e.value.real for e in found.beyond(1e-6)] == [-0.5]
    assert found.beyond(1e-7) == ()


@pytest.mark.parametrize("multiplicity", [2, 3, 4])
def test_a_multiple_real_eigenvalue_is_no_pair(multiplicity: int) -> None:
    """A Jordan block of -2 in other coordinates: rounding makes pairs of it."""
    block, pairs = -2 * np.eye(multiplicity) + np.diag(np.ones(multiplicity - 1), 1), 0
    for seed in range(20):
        turned, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(multiplicity, multiplicity)))
        matrix = turned @ block @ turned.T
        pairs += bool(np.linalg.eigvals(matrix).imag.any())
        found = eigenvalues(matrix)
        assert not found.imag.any()
        assert found.real == pytest.approx(-2, abs=1e-3)
    assert pairs
    modes = Linear(tuple("abcd")[:multiplicity], (), (), matrix, np.zeros((multiplicity, 0)), np.zeros((0, multiplicity)),
                   np.zeros((0, 0)), np.ones(multiplicity)).modes()
    assert [mode.swings for mode in modes] == [False] * multiplicity


def test_a_pair_with_strong_damping_stays_a_pair() -> None:
    found = eigenvalues(np.array([[-1.0, 0.005], [-0.005, -1.0]]))
    assert sorted(found.imag) == pytest.approx([-0.005, 0.005])


@pytest.mark.parametrize("share", [0.0, 0.01, 0.05, 0.3, 1.0])
def test_blocks_are_the_strongly_connected_groups(share: float) -> None:
    """Beside SciPy's search through the graph; a chain has a block for each state, a circle one for all."""
    random = np.random.default_rng(0)
    for n in (1, 2, 5, 64, 65):
        a = (random.random((n, n)) < share).astype(float)
        _, label = connected_components(csr_matrix(a), connection="strong")
        firsts = [list(label).index(group) for group in dict.fromkeys(label.tolist())]
        assert strong_blocks(a) == [np.flatnonzero(label == label[k]).tolist() for k in firsts]
        assert len(strong_blocks(np.eye(n, k=1))) == n
        assert len(strong_blocks(np.roll(np.eye(n), 1, axis=0))) == 1
