"""The noise of a motion reference unit is what its parameters say: size, band, shape, and another for each seed."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from collected import partly
from scipy.signal import periodogram
from scipy.stats import kurtosis, norm

import heavebond as hb
from heavebond.numerics.result import Result

SIGMA, LOW, HIGH, SINES, T_1, STEP = 0.02, 1.0, 5.0, 100, 0.1, 0.02
# a sine lies anywhere in its hundredth of the band, and 200 s hold 800 periods of a beat over the whole band: what is
# averaged over them is right to 1/sqrt(800)
ROUGH = 0.035


@cache
def _run(seed: int) -> Result:
    """A unit on a vessel that lies still."""
    return hb.simulate(hb.loads(f"""
model: noise
components:
  vessel: {{is: PositionSource, u: 0 m}}
  unit:
    {{is: MotionReferenceUnit, T_1: {T_1} s, sigma: {SIGMA} m, f_1: {LOW} Hz, f_2: {HIGH} Hz, n: {SINES}, seed: {seed}}}
nodes: {{vessel: [vessel.a, unit.a], z: [unit.z], v: [unit.v]}}
"""), "200 s", every="20 ms", rtol=1e-5)


@pytest.mark.parametrize("seed", partly([1, 2, 17], 3))
def test_noise_has_its_rms_and_the_shape_of_a_bell(seed: int) -> None:
    e = _run(seed)["unit.e"] / SIGMA
    assert e.mean() == pytest.approx(0, abs=ROUGH)
    assert e.std() == pytest.approx(1, rel=ROUGH)
    # a sum of n sines of random phase has a kurtosis of 3 - 1.5/n
    assert kurtosis(e, fisher=False) == pytest.approx(3 - 1.5 / SINES, abs=0.2)
    for bound in (1, 2):
        assert np.mean(np.abs(e) > bound) == pytest.approx(2 * norm.sf(bound), abs=ROUGH)


def test_noise_fills_its_band_evenly_and_nothing_else() -> None:
    frequency, density = periodogram(_run(1)["unit.e"], 1 / STEP, window="hann")
    power = density / density.sum()
    edges = np.linspace(LOW, HIGH, 5)
    shares = [power[(frequency >= low) & (frequency < high)].sum() for low, high in pairwise(edges)]
    assert sum(shares) == pytest.approx(1, abs=5e-3)  # the window spreads the last sine beyond the edge
    assert shares == pytest.approx([0.25] * 4, abs=0.01)


def test_a_seed_gives_its_own_noise_and_always_the_same() -> None:
    first, other = _run(1)["unit.e"], _run(2)["unit.e"]
    assert np.abs(np.corrcoef(first, other)[0, 1]) < 2 * ROUGH
    assert np.array_equal(first, _run.__wrapped__(1)["unit.e"])


def test_the_filter_makes_of_it_what_a_controller_sees() -> None:
    """Rate of heave: each sine of rms sigma/sqrt(n) passes 2 pi f/sqrt(1 + (2 pi f T_1)**2)."""
    run, w = _run(1), 2 * np.pi * np.linspace(LOW, HIGH, 2001)
    late = run.time > 10 * T_1
    wanted = SIGMA * np.sqrt(np.mean(w**2 / (1 + (w * T_1) ** 2)))
    assert run["unit.v"][late].std() == pytest.approx(wanted, rel=ROUGH)
    assert run["unit.z"][late].std() == pytest.approx(SIGMA * np.sqrt(np.mean(1 / (1 + (w * T_1) ** 2))), rel=ROUGH)
