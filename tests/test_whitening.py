"""Kalman filters as linear maps, rates of signals, and filters that share one transform, against direct formulas."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import savgol_filter
from scipy.signal.windows import dpss

from heavebond.localise.regressors import _rate_of_cubics
from heavebond.localise.whitening import Whitening
from heavebond.records.noise import PER_BAND, PRODUCT, _Filtered, _prolate


def test_innovations_are_the_errors_over_the_root_of_their_covariance() -> None:
    """Sample by sample and channel by channel, L^-1 e with L L' = O P O' + I the covariance of all errors, and O what a
    state at the start does to them; an input does -C x - d w to the errors. To rounding."""
    random = np.random.default_rng(3)
    count, n, m, width = 12, 3, 2, 4
    phi, c = 0.5 * random.standard_normal((count - 1, n, n)), random.standard_normal((count, m, n))
    gamma, d = random.standard_normal((count - 1, n)), random.standard_normal((count, m))
    deviation = np.array([2.0, 0.0, 1.0])
    error, inputs, first = map(random.standard_normal, ((count, m, width), (count, width), (n, width)))

    def outputs(x: np.ndarray, w: np.ndarray) -> np.ndarray:
        found = [c[0] @ x + d[0][:, None] * w[0]]
        for i in range(count - 1):
            x = phi[i] @ x + gamma[i][:, None] * (w[i] + w[i + 1]) / 2
            found.append(c[i + 1] @ x + d[i + 1][:, None] * w[i + 1])
        return np.concatenate(found)

    start = outputs(np.eye(n), np.zeros((count, n)))
    root = np.linalg.cholesky(start @ np.diag(deviation**2) @ start.T + np.eye(count * m))
    filtering = Whitening.of(phi, c, deviation)
    expected = np.linalg.solve(root, error.reshape(-1, width) - outputs(first, np.zeros((count, width))))
    found = filtering.innovations(error, first, np.zeros((count - 1, n, width)))
    assert found.reshape(-1, width) == pytest.approx(expected, abs=1e-12)
    expected = np.linalg.solve(root, -outputs(np.zeros((n, width)), inputs))
    assert filtering.responses(inputs, gamma, d).reshape(-1, width) == pytest.approx(expected, abs=1e-12)


def test_the_rate_of_a_cubic_is_exact_up_to_the_ends() -> None:
    t = np.arange(40.0)
    assert _rate_of_cubics(0.01 * t**3 - t**2 + 3, 9) == pytest.approx(0.03 * t**2 - 2 * t, abs=1e-9)
    noisy = np.random.default_rng(1).standard_normal(40)
    assert _rate_of_cubics(noisy, 9) == pytest.approx(savgol_filter(noisy, 9, 3, deriv=1), abs=1e-12)
    alternating = _rate_of_cubics((-1.0) ** t, 9)
    assert np.abs(alternating[4:-4]).max() < 0.2  # differences of neighbours would give 2


def test_one_transform_serves_all_filters() -> None:
    random = np.random.default_rng(0)
    for length in (64, 100, 129):  # up to a power of two, where nothing is added
        y, h = random.standard_normal(length), random.standard_normal(17)
        assert _Filtered(y).by(h) == pytest.approx(np.convolve(y, h, "valid"), abs=1e-12)


def test_the_prolate_window_keeps_to_its_band() -> None:
    """Less than 1e-9 of its energy is above PRODUCT / length (D. Slepian, 1978)."""
    window = _prolate(8 * PER_BAND)
    assert abs(window @ dpss(len(window), PRODUCT, norm=2)) == pytest.approx(1, abs=1e-12)
    spectrum = np.abs(np.fft.rfft(window, 1 << 16))**2
    outside = np.fft.rfftfreq(1 << 16) > PRODUCT / len(window)
    assert spectrum[outside].sum() < 1e-9 * spectrum.sum()
