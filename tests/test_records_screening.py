"""What is noticed about a channel: outliers and nothing that only looks like one, steps of a sensor, delays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from heavebond.estimation.records import merged
from heavebond.records.noise import estimate_noise as estimated
from heavebond.records.outliers import outliers, step_of
from heavebond.records.time_delay import lateness

T = np.arange(0, 60, 0.01)
RANDOM = np.random.default_rng(3)
NOISE = RANDOM.standard_normal(len(T))
SOUND = {
    "noise": NOISE,
    "heavy tails": RANDOM.laplace(size=len(T)),
    "square wave": np.sign(np.sin(3 * T)),
    "noisy square wave": np.sign(np.sin(3 * T)) + 0.01 * NOISE,
    "triangle": np.abs(T % 2 - 1),
    "noisy triangle": np.abs(T % 2 - 1) + 1e-4 * NOISE,
    "fast sine": np.sin(200 * T),
    "clipped sine": np.clip(2 * np.sin(20 * T), -1, 1),
    "stick-slip": np.cumsum(np.maximum(0, np.sin(5 * T) - 0.5)),
    "rectified sine": np.abs(np.sin(6 * T)),
    "ringing after knocks": np.exp(-5 * (T % 5)) * np.sin(100 * (T % 5)) + 1e-3 * NOISE,
    "staircase": np.repeat(RANDOM.standard_normal(60), 100),
    "counted": np.round(20 * np.sin(T)) / 20,
}


@pytest.mark.parametrize("name", SOUND)
def test_bends_edges_and_noise_are_no_outliers(name: str) -> None:
    y = SOUND[name]
    assert not outliers(T, y, estimated([(y, T)]).deviation).any()


@pytest.mark.parametrize("name", ["noise", "noisy square wave", "noisy triangle", "clipped sine", "ringing after knocks"])
def test_knocks_are_found_in_each_of_them(name: str) -> None:
    """30 times the noise, and beyond what the channel does between samples; one, two and four in a row."""
    y, spots = SOUND[name].copy(), [130, 2251, 2252, 4120, 4121, 4122, 4123]
    y[spots] += 30 * estimated([(y, T)]).deviation + 4 * np.abs(np.diff(y[2100:2190])).max()
    assert np.flatnonzero(outliers(T, y, estimated([(y, T)]).deviation)).tolist() == spots


def test_too_short_to_tell() -> None:
    y = np.zeros(20)
    y[7] = 9
    assert outliers(np.arange(20.0), y, 0.1).sum() == 1
    assert not outliers(np.arange(19.0), y[:19], 0.1).any()


def test_steps() -> None:
    y = np.sin(T)
    assert step_of(np.round(y / 0.05) * 0.05) == pytest.approx(0.05)
    assert step_of(np.round(y / 0.05) * 0.05 + 7) == pytest.approx(0.05)
    assert step_of(y) == 0 and step_of(np.zeros(100)) == 0 and step_of(np.sign(y)) == pytest.approx(0, abs=2)


@pytest.mark.parametrize(("gain", "offset"), [(1.0, 0.0), (1.2, 5.0)])
def test_delay_beside_gain_and_offset(gain: float, offset: float) -> None:
    def motion(t: np.ndarray) -> np.ndarray:
        return np.sin(2 * t) + 0.5 * np.sin(5.3 * t)

    y = offset + gain * motion(T - 0.037) + 0.05 * NOISE
    found = lateness(T, y, T, motion(T))
    assert found is not None and found.noticeable
    assert found.explains(0.05) is (offset == 0)  # beside an offset of 5 the delay is not all that is wrong
    assert found.seconds == pytest.approx(0.037, abs=4 * found.deviation)
    # the least that any unbiased estimate can have: noise / (rms of the slope sqrt(n))
    slope = gain * np.sqrt(np.mean(np.gradient(motion(T), T) ** 2))
    assert found.share == pytest.approx(1 / (1 + (0.05 / (0.037 * slope)) ** 2), abs=0.05)  # of what gain and offset leave
    assert found.deviation == pytest.approx(0.05 / slope / np.sqrt(len(T)), rel=0.6)  # 16 blocks: 18 % by chance, 3 sigma


@pytest.mark.parametrize("model", [
    lambda t: np.zeros_like(t), lambda t: np.sin(40 * t), lambda t: np.random.default_rng(9).standard_normal(len(t))])
def test_no_delay_from_a_model_that_is_nothing_like_the_channel(model: Callable[[np.ndarray], np.ndarray]) -> None:
    found = lateness(T, np.sin(2 * T) + 0.05 * NOISE, T, model(T))
    assert found is None or not found.explains(0.05)


def test_a_missing_damper_is_told_as_nearer_not_as_late() -> None:
    """Two frequencies, of which damping delays one more than the other: no single delay explains both."""
    y = np.sin(2 * T - 0.3) + 0.5 * np.sin(5.3 * T - 0.1) + 0.02 * NOISE
    found = lateness(T, y, T, np.sin(2 * T) + 0.5 * np.sin(5.3 * T))
    assert found is not None and not found.explains(0.02)


def test_times_of_a_record_and_of_its_inputs_are_one() -> None:
    inputs, rows = np.array([0.0, 0.1, 0.3]), np.array([0.0, 0.1 + 1e-13, 0.2])
    grid, (index,) = merged([rows], [inputs, rows])
    assert grid[1] == 0.1 and index.tolist() == [0, 1, 2]
