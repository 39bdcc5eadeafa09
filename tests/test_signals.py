"""Measured inputs between their samples, and several of them on one set of breaks."""

import numpy as np
import pytest
from numpy.typing import NDArray

from heavebond.core.errors import DataError, UsageError
from heavebond.records.piecewise import Pieces, align, evaluate, pieces

KINDS = ("spline", "linear", "hold")


def samples(seed: int, n: int = 40) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    random = np.random.default_rng(seed)
    return np.cumsum(random.uniform(0.05, 0.2, n)), random.normal(size=n)


def evaluate_aligned(breaks: NDArray[np.float64], coefficients: NDArray[np.float64], signal: int,
                     t: NDArray[np.float64]) -> NDArray[np.float64]:
    piece = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, len(coefficients) - 1)
    powers = (t - breaks[piece])[:, None] ** np.arange(4)
    return np.asarray(np.sum(coefficients[piece, signal] * powers, axis=1))


@pytest.mark.parametrize("between", KINDS)
def test_goes_through_the_samples(between: str) -> None:
    time, values = samples(1)
    signal = pieces(time, values, between)
    np.testing.assert_allclose(evaluate(signal, time), values, atol=1e-12)
    assert signal.coefficients.shape == (len(signal.breaks) - 1, 4)


def test_spline_is_exact_for_a_cubic_with_its_derivatives() -> None:
    time, _ = samples(2)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3])
    signal = pieces(time, cubic(time), "spline")
    t = np.linspace(time[0], time[-1], 333)
    for order in range(4):
        np.testing.assert_allclose(evaluate(signal, t, order), cubic.deriv(order)(t) if order else cubic(t),
                                   rtol=1e-7, atol=1e-7)
    assert np.all(evaluate(signal, t, 4) == 0)
    assert signal.smoothness == 2


def test_spline_converges_with_the_fourth_power_of_the_step() -> None:
    def error(n: int) -> float:
        time = np.linspace(0, 12, n)
        t = np.linspace(0, 12, 5001)
        return float(np.max(np.abs(evaluate(pieces(time, np.sin(time)), t) - np.sin(t))))

    assert 12 < error(61) / error(121) < 20


@pytest.mark.parametrize("between", KINDS)
def test_smoothness_is_what_it_says(between: str) -> None:
    time, values = samples(3)
    signal = pieces(time, values, between)
    inner = signal.breaks[1:-1]
    for order in range(signal.smoothness + 2):
        jump = np.max(np.abs(evaluate(signal, inner, order) - evaluate(signal, inner - 1e-9, order)))
        assert (jump < 1e-4) == (order <= signal.smoothness)


def test_hold_keeps_each_sample_and_the_last_for_a_median_step() -> None:
    signal = pieces(np.array([0.0, 1.0, 2.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0]), "hold")
    assert signal.breaks.tolist() == [0.0, 1.0, 2.0, 4.0, 5.0]
    assert evaluate(signal, [0.0, 0.999, 1.0, 3.9, 4.0, 5.0]).tolist() == [5.0, 5.0, 6.0, 7.0, 8.0, 8.0]
    assert evaluate(signal, 2.5, 1) == 0


def test_two_and_three_samples() -> None:
    line = pieces(np.array([0.0, 2.0]), np.array([1.0, 5.0]))
    np.testing.assert_allclose(evaluate(line, [0.5, 1.0]), [2.0, 3.0])
    parabola = pieces(np.array([0.0, 1.0, 3.0]), np.array([0.0, 1.0, 9.0]))
    np.testing.assert_allclose(evaluate(parabola, [0.5, 2.0]), [0.25, 4.0])


@pytest.mark.parametrize("seed", range(5))
def test_align_changes_no_value(seed: int) -> None:
    kinds = [KINDS[(seed + k) % 3] for k in range(3)]
    signals = [pieces(*samples(10 * seed + k, 30 + 7 * k), kind) for k, kind in enumerate(kinds)]
    start = max(s.breaks[0] for s in signals) + 0.01
    end = min(s.breaks[-1] for s in signals) - 0.01
    breaks, coefficients = align(signals, start, end)
    assert breaks[0] == start and breaks[-1] == end and np.all(np.diff(breaks) > 0)
    assert coefficients.shape == (len(breaks) - 1, 3, 4)
    t = np.random.default_rng(seed).uniform(start, end, 500)
    for k, signal in enumerate(signals):
        aligned = evaluate_aligned(breaks, coefficients, k, t)
        np.testing.assert_allclose(aligned, evaluate(signal, t), atol=1e-11)
        assert np.isin(signal.breaks[(signal.breaks > start) & (signal.breaks < end)], breaks).all()


def test_align_joins_breaks_that_differ_by_rounding() -> None:
    grid = np.arange(301) * 0.1
    rounded = np.round(np.linspace(0, 30, 301), 7)
    assert np.any(grid != rounded)
    signals = [pieces(grid, np.sin(grid)), pieces(rounded, np.cos(rounded), "hold")]
    breaks, coefficients = align(signals, 0.0, 30.0)
    assert len(breaks) == 301 and np.diff(breaks).min() > 0.0999
    np.testing.assert_allclose(coefficients[:, 1, 0], np.cos(rounded[:-1]))


def test_align_of_a_part() -> None:
    signal = pieces(np.arange(11.0), np.arange(11.0) ** 2)
    breaks, coefficients = align([signal], 2.5, 4.5)
    assert breaks.tolist() == [2.5, 3.0, 4.0, 4.5]
    wanted = [[6.25, 5.0, 1.0], [9.0, 6.0, 1.0], [16.0, 8.0, 1.0]]
    np.testing.assert_allclose(coefficients[:, 0, :3], wanted, atol=1e-12)
    no_breaks, no_coefficients = align([], 0.0, 3.0)
    assert no_breaks.tolist() == [0.0, 3.0] and no_coefficients.shape == (1, 0, 4)


def test_outside_the_record() -> None:
    time = np.linspace(0, 120, 3001)
    heave = pieces(time, np.sin(time))
    with pytest.raises(DataError, match="needs heave from"):  # the held command reaches one step further
        align([pieces(time, time, "hold"), heave], 0.0, 120.04, names=["command", "heave"])
    with pytest.raises(DataError) as caught:
        align([heave], 0.0, 130.0, names=["heave"])
    text = str(caught.value)
    assert "the simulation needs heave from 0 s to 130 s, the record ends at 120 s" in text
    assert "Write `until: 120 s`." in text
    begin = r"the record begins at 0 s(.|\n)*Begin at 0 s \(`simulate: {from: 0 s, until: 11 s}`\)"
    with pytest.raises(DataError, match=begin):
        align([heave], -1.0, 10.0)
    with pytest.raises(DataError, match="the record ends at 120 s"):
        evaluate(heave, 120.1)
    breaks, _ = align([heave], -1e-12, 120.0 + 1e-9)  # rounding is no reason to stop
    assert len(breaks) == 3001


def test_what_is_no_record() -> None:
    with pytest.raises(DataError, match="has 1 sample, it needs at least 2"):
        pieces(np.array([0.0]), np.array([1.0]), "hold")
    for time, values in (([0, 1, 1], [1, 2, 3]), ([0, 1, np.nan], [1, 2, 3]), ([0, 1, 2], [1, np.inf, 3])):
        with pytest.raises(DataError, match="increasing times and a number in every row"):
            pieces(np.array(time, dtype=float), np.array(values, dtype=float))
    with pytest.raises(UsageError, match="Did you mean 'spline'"):
        pieces(np.arange(3.0), np.arange(3.0), "splines")


def test_pieces_are_values() -> None:
    with pytest.raises(AttributeError):
        Pieces(np.arange(2.0), np.zeros((1, 4)), 0).smoothness = 1
