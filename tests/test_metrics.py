"""Figures of merit against hand calculation, and the noise estimate against records of known noise."""

import math
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.records import metrics
from heavebond.reports.result_tables import ResultTable, comparison_items

HIDDEN = Path(__file__).resolve().parents[2] / "shared" / "data" / "hidden"
KNOWN_NOISE = {
    "open_passive_friction": {"extension_m": 1e-3, "string_force_N": 250.0, "crown_m": 1e-3},
    "open_passive_nothing": {"extension_m": 1e-3, "string_force_N": 250.0, "crown_m": 1e-3},
    "open_cylinder_leakage": {"position_m": 0.3e-3, "pA_Pa": 0.6e5, "pB_Pa": 0.6e5},
    "open_receiver_choked": {"pressure_Pa": 800.0},
}
Y = np.array([1.0, 2.0, 3.0, 4.0])
MODEL = np.array([1.0, 2.0, 3.0, 2.0])


def test_figures_by_hand() -> None:
    assert metrics.rms_error(Y, MODEL) == 1.0
    assert metrics.normalised_rms(Y, MODEL) == pytest.approx(1 / math.sqrt(1.25))
    assert metrics.fit_percent(Y, MODEL) == pytest.approx(100 * (1 - 1 / math.sqrt(1.25)))
    assert metrics.relative_rms(Y, MODEL) == pytest.approx(1 / math.sqrt(7.5))
    assert metrics.bias(Y, MODEL) == 0.5
    assert metrics.chi2_per_sample(Y, MODEL, 0.5) == 4.0


def test_a_further_statistic_needs_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    def value(y: metrics.Array, ym: metrics.Array, weight: metrics.Array, noise: float) -> float:
        return float(np.max(np.abs(y - ym)))

    largest = metrics.Statistic("largest", value, "largest error", "unit")
    monkeypatch.setattr(metrics, "STATISTICS", (*metrics.STATISTICS, largest))
    comparison = hb.compare("passive_rig/nothing")
    channel = next(iter(next(iter(comparison.records.values())).channels.values()))
    expected = float(np.max(np.abs(channel.measured - channel.model)[channel.counts]))
    assert channel.figures()["largest"] == expected > 0
    table = comparison_items(comparison)[0]
    assert isinstance(table, ResultTable)
    assert table.head[2:6] == ("rms error", "fit", "bias", "largest error")
    assert all(len(row) == len(table.head) for row in table.rows)


def test_perfect_and_mean_models() -> None:
    assert metrics.fit_percent(Y, Y) == 100.0
    assert metrics.fit_percent(Y, np.full(4, Y.mean())) == pytest.approx(0.0, abs=1e-12)


def test_what_is_undefined_is_nan() -> None:
    constant = np.full(20, 3.0)
    assert math.isnan(metrics.normalised_rms(constant, constant + 1))
    assert math.isnan(metrics.relative_rms(0 * constant, constant))
    assert math.isnan(metrics.whiteness(constant))
    assert math.isnan(metrics.whiteness(Y, lags=4))
    assert metrics.chi2_per_sample(Y, MODEL, 0.0) == math.inf and metrics.chi2_per_sample(Y, Y, 0.0) == 0.0


def test_autocorrelation() -> None:
    np.testing.assert_allclose(metrics.autocorrelation(np.array([1.0, -1.0, 1.0, -1.0]) + 7, 3),
                               [1, -0.75, 0.5, -0.25])
    e = np.random.default_rng(0).normal(size=20_000)
    coloured = np.convolve(e, [1.0, 0.5])
    np.testing.assert_allclose(metrics.autocorrelation(coloured, 3), [1, 0.5 / 1.25, 0, 0], atol=0.03)


def test_whiteness_is_a_p_value() -> None:
    random = np.random.default_rng(1)
    p = np.array([metrics.whiteness(random.normal(size=400)) for _ in range(400)])
    # 400 draws: the standard deviations of these shares are 1.1 % and 2.5 %
    assert abs(np.mean(p < 0.05) - 0.05) < 0.04 and abs(np.mean(p < 0.5) - 0.5) < 0.09
    assert metrics.whiteness(np.convolve(random.normal(size=400), [1.0, 0.5])) < 1e-4


def test_whiteness_by_hand() -> None:
    # r_1 = -0.75, n = 4: Q = 4 * 6 * 0.5625 / 3 = 4.5; chi-square of 1 degree of freedom: erfc(sqrt(Q/2))
    e = np.array([1.0, -1.0, 1.0, -1.0])
    assert metrics.portmanteau(metrics.autocorrelation(e, 1)[1:], 4) == pytest.approx(4.5)
    long = np.tile(e, 250) + np.random.default_rng(2).normal(scale=30.0, size=1000)
    q = float(metrics.portmanteau(metrics.autocorrelation(long, 1)[1:], 1000))
    assert metrics.whiteness(long, lags=1) == pytest.approx(math.erfc(math.sqrt(q / 2)))


def test_whiteness_of_short_records_is_right_in_its_tail() -> None:
    """By chi-square alone 1 % of white noise of 240 samples has a p value below 0.5 %, and 1.3 % of 150 samples. Of 6000
    draws the standard deviation of that share is 0.09 %, and that of the tail that was drawn once 0.05 %."""
    random = np.random.default_rng(3)
    for n in (150, 240):
        p = np.array([metrics.whiteness(random.normal(size=n), 20) for _ in range(6000)])
        assert abs(np.mean(p < 0.005) - 0.005) < 0.003
