"""Figures of merit against hand calculation, and the noise estimate against records of known noise."""

import math
from pathlib import Path

import numpy as np
import pytest

from heavebond.records import metrics
from heavebond.records.measurements import column, read_table

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


def test_perfect_and_mean_models() -> None:
    assert metrics.fit_percent(Y, Y) == 100.0
    assert metrics.fit_percent(Y, np.full(4, Y.mean())) == pytest.approx(0.0, abs=1e-12)


def test_what_is_undefined_is_nan() -> None:
    constant = np.full(20, 3.0)
    assert math.isnan(metrics.normalised_rms(constant, constant + 1))
    assert math.isnan(metrics.relative_rms(0 * constant, constant))
    assert math.isnan(metrics.whiteness(constant))
    assert math.isnan(metrics.whiteness(Y, lags=4))
    assert math.isnan(metrics.estimate_noise(constant, np.arange(20.0)))
    assert math.isnan(metrics.estimate_noise(np.sin(np.arange(9.0)), np.arange(9.0)))
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
    found = metrics.whiteness(np.array([1.0, -1.0, 1.0, -1.0]), lags=1)
    assert found == pytest.approx(math.erfc(math.sqrt(2.25)))


@pytest.mark.parametrize("rig", KNOWN_NOISE)
@pytest.mark.parametrize("record", ["train", "validate"])
def test_noise_of_known_records(rig: str, record: str) -> None:
    if not HIDDEN.is_dir():
        pytest.skip("the records of known noise (../shared/data/hidden) are not here")
    table = read_table(HIDDEN / rig / f"{record}.csv")
    for name, noise in KNOWN_NOISE[rig].items():
        found = metrics.estimate_noise(column(table, name), column(table, "time_s"))
        assert found == pytest.approx(noise, rel=0.07), name


def noisy(seed: int, samples_per_period: float, noise: float, n: int = 3000) -> float:
    random = np.random.default_rng(seed)
    t = np.arange(n) / samples_per_period
    return metrics.estimate_noise(np.sin(2 * np.pi * t) + noise * random.normal(size=n), t)


@pytest.mark.parametrize("samples_per_period", [10, 30, 300])
@pytest.mark.parametrize("noise", [1e-3, 1e-1, 10.0])
def test_noise_estimate_is_free_of_the_signal(samples_per_period: float, noise: float) -> None:
    found = [noisy(seed, samples_per_period, noise) for seed in range(5)]
    assert np.mean(found) == pytest.approx(noise, rel=0.05)


@pytest.mark.parametrize("samples_per_period", [4, 5, 6, 7])
def test_noise_estimate_of_a_fast_signal_is_too_high_as_stated(samples_per_period: float) -> None:
    left = 1.6 * math.sin(math.pi / samples_per_period) ** 8
    assert noisy(0, samples_per_period, 1e-3) == pytest.approx(math.hypot(1e-3, left), rel=0.4)


def test_noise_estimate_scales_and_ignores_the_clock() -> None:
    random = np.random.default_rng(4)
    t = np.sort(random.uniform(0, 100, 2000)) + 1e-3 * np.arange(2000)
    y = 5 * np.sin(t) + 0.2 * random.normal(size=2000)
    found = metrics.estimate_noise(y, t)
    assert found == pytest.approx(0.2, rel=0.07)
    assert metrics.estimate_noise(1e5 + 1e3 * y, 60 * t - 7) == pytest.approx(1e3 * found, rel=1e-6)


def test_noise_estimate_is_exact_where_there_is_none() -> None:
    t = np.linspace(0, 1, 50)
    assert metrics.estimate_noise(3 + t, t) < 1e-12
    fast = np.linspace(0, 100, 5001)
    assert metrics.estimate_noise(np.sin(fast), fast) < 1e-9


def test_knocks_and_clipping_do_not_count() -> None:
    random = np.random.default_rng(5)
    t = np.arange(3000) * 0.01
    y = np.sin(t) + 0.01 * random.normal(size=3000)
    knocked = y.copy()
    knocked[::150] += 5.0
    # 20 knocks spoil 3 to 9 differences each, about a tenth of the record
    assert metrics.estimate_noise(knocked, t) == pytest.approx(0.01, rel=0.12)
    assert metrics.estimate_noise(np.minimum(y, 0.0), t) == pytest.approx(0.01, rel=0.12)
    stepped = y + np.sign(np.sin(2 * t))
    assert metrics.estimate_noise(stepped, t) == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("speed", [1, 3, 10])
def test_quantised_record(speed: float, noise: float) -> None:
    step, t = 1e-4, np.arange(5000) * 0.001
    y = np.sin(speed * t) + noise * step * np.random.default_rng(6).normal(size=5000)
    found = metrics.estimate_noise(np.round(y / step) * step, t)
    # an even error of one step has the standard deviation step / sqrt(12)
    assert found == pytest.approx(step * math.hypot(noise, 1 / math.sqrt(12)), rel=0.2)
