# The compiled Kalman filter and smoother give what NumPy gives, and NumPy serves where there is no compiler.
"""The recursions of the filter and smoother in C, against those in NumPy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from heavebond.localise import compiled_kalman
from heavebond.localise.kalman_smoother import Unknown

COUNT, N, M, K, NODES = 40, 4, 3, 2, 2


def unknown(states: int = N) -> tuple[Unknown, np.ndarray]:
    """Three places in a stable system with random matrices, one of them without an input."""
    random = np.random.default_rng(5)
    phi = random.standard_normal((COUNT - 1, states, states + K)) * 0.4 / np.sqrt(states)
    system: Any = SimpleNamespace(
        phi=phi, gamma=random.standard_normal((COUNT - 1, states, NODES)), c=random.standard_normal((COUNT, M, states + K)),
        d=random.standard_normal((COUNT, M, NODES)), driven=random.standard_normal((COUNT, NODES)),
        error=3 * random.standard_normal((COUNT, M)), centre=np.zeros(K), start=random.standard_normal((states, K)),
        start_deviation=np.abs(random.standard_normal(states)), time=np.cumsum(random.uniform(0.1, 0.2, COUNT)))
    system.c[3, 1] = 0.0  # not sampled
    places: Any = [SimpleNamespace(weights={"a": 1.0}), SimpleNamespace(weights={"a": 1.0, "b": -1.0}),
                   SimpleNamespace(weights={"b": 1.0})]
    return Unknown(system, ["a", "b"], places, np.array([1.0, 2.0, 0.5])), np.array([1e-2, 1e4, 0.0])


@pytest.mark.skipif(compiled_kalman.program() is None, reason="no C compiler")
@pytest.mark.parametrize("states", [1, N])
def test_the_compiled_filter_and_smoother_are_those_of_numpy(monkeypatch: pytest.MonkeyPatch, states: int) -> None:
    made, intensity = unknown(states)
    filtered, smoothed = made.filtered(intensity), made.smoothed(intensity)
    monkeypatch.setattr(compiled_kalman, "program", lambda: None)
    for one, other in ((filtered, made.filtered(intensity)), (smoothed, made.smoothed(intensity))):
        for name, values in vars(other).items():
            assert np.abs(values).max() > 0
            assert vars(one)[name] == pytest.approx(values, rel=1e-9, abs=1e-9 * np.abs(values).max()), name


@pytest.mark.skipif(compiled_kalman.program() is None, reason="no C compiler")
def test_an_input_without_a_covariance_explains_nothing() -> None:
    """Where a state runs away the variance is no number, and the likelihood none that could be the best."""
    made, intensity = unknown()
    made.system.phi[:] *= 1e90
    with np.errstate(all="ignore"):
        assert not np.any(made.filtered(intensity).constant < 1e6)


def test_arrays_of_another_shape_are_not_given_to_c() -> None:
    with pytest.raises(AssertionError):
        compiled_kalman.run("filter", gamma=np.zeros((4, 1, 2)), error=np.zeros((5, 1, 1)), phi=np.zeros((4, 2, 3)))
