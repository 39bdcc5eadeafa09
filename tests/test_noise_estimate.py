"""The estimated noise of a channel: right for slow and fast signals, over all records together, with its own standard error,
and told where noise and signal cannot be separated."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import ArrayLike

import heavebond as hb
from heavebond.cli import main
from heavebond.records.measurements import column, read_table
from heavebond.records.noise import NoiseEstimate, estimate_noise

HIDDEN = Path(__file__).resolve().parents[2] / "shared" / "data" / "hidden"
KNOWN_NOISE = {
    "open_passive_friction": {"extension_m": 1e-3, "string_force_N": 250.0, "crown_m": 1e-3},
    "open_passive_nothing": {"extension_m": 1e-3, "string_force_N": 250.0, "crown_m": 1e-3},
    "open_cylinder_leakage": {"position_m": 0.3e-3, "pA_Pa": 0.6e5, "pB_Pa": 0.6e5},
    "open_receiver_choked": {"pressure_Pa": 800.0},
}


def estimate(y: ArrayLike, t: ArrayLike) -> float:
    return estimate_noise([(y, t)]).deviation


@pytest.mark.parametrize("rig", KNOWN_NOISE)
def test_noise_of_known_records(rig: str) -> None:
    """Two records of 601 to 3001 samples; three standard errors are at most 6 %."""
    if not HIDDEN.is_dir():
        pytest.skip("the records of known noise (../shared/data/hidden) are not here")
    tables = [read_table(HIDDEN / rig / f"{record}.csv") for record in ("train", "validate")]
    for name, noise in KNOWN_NOISE[rig].items():
        found = estimate_noise([(column(table, name), column(table, "time_s")) for table in tables])
        assert found.deviation == pytest.approx(noise, rel=0.06), name
        assert found.separable and abs(found.deviation / noise - 1) < 3.5 * found.error, name


def noisy(seed: int, samples_per_period: float, noise: float, n: int = 3000) -> NoiseEstimate:
    random = np.random.default_rng(seed)
    t = np.arange(n) / samples_per_period
    return estimate_noise([(np.sin(2 * np.pi * t) + noise * random.normal(size=n), t)])


@pytest.mark.parametrize("samples_per_period", [2.5, 4, 6, 10, 30, 300])
@pytest.mark.parametrize("noise", [1e-3, 1e-1, 10.0])
def test_noise_is_free_of_the_signal(samples_per_period: float, noise: float) -> None:
    """Also of a signal of a few samples a period, of which differences leave up to all."""
    found = [noisy(seed, samples_per_period, noise) for seed in range(5)]
    assert np.mean([f.deviation for f in found]) == pytest.approx(noise, rel=0.05)
    assert all(f.separable for f in found)


@pytest.mark.parametrize("samples_per_period", [5, 30])
def test_the_standard_error_is_that_of_many_records(samples_per_period: float) -> None:
    """From band passes, and from differences; a deviation of 200 draws errs by 5 %, so 15 % is three of them. The median and
    the clipping cost up to a tenth."""
    found = [noisy(seed, samples_per_period, 0.01, 600) for seed in range(200)]
    claimed = np.mean([f.error for f in found])
    assert np.std([f.deviation / 0.01 for f in found]) == pytest.approx(1.05 * claimed, rel=0.2)


def test_a_signal_at_all_frequencies_cannot_be_separated() -> None:
    """The response of a resonance at an eighth of the sampling frequency to white noise, with a hundred times less noise;
    and the same where the excitation ends at 0.15 of it, which leaves more than half of the frequencies free."""
    from scipy.signal import butter, lfilter, sosfiltfilt

    random, t = np.random.default_rng(2), np.arange(8000) * 0.001
    force = random.normal(size=8000)
    resonance = [1.0], [1.0, -2 * 0.97 * math.cos(math.pi / 4), 0.97**2]
    white = 0.02 * random.normal(size=8000)
    everywhere = estimate_noise([(lfilter(*resonance, force) + white, t)])
    assert everywhere.deviation > 5 * 0.02 and not everywhere.separable
    free = estimate_noise([(lfilter(*resonance, sosfiltfilt(butter(16, 0.3, output="sos"), force)) + white, t)])
    assert free.deviation == pytest.approx(0.02, rel=0.06) and free.separable


def test_a_record_at_rest_tells_the_noise_of_the_others() -> None:
    """Nothing but a broad-band motion that no filter stops in one record, and nothing but noise in two others as long."""
    random, t = np.random.default_rng(1), np.arange(2000) * 0.01
    moving = (random.normal(size=2000), t)
    still = [(0.01 * random.normal(size=2000), t) for _ in range(4)]
    assert estimate_noise([moving]).deviation == pytest.approx(1, rel=0.1)
    assert estimate_noise([moving, *still]).deviation == pytest.approx(0.01, rel=0.03)     # three standard errors


def test_noise_scales_and_ignores_the_clock() -> None:
    random = np.random.default_rng(4)
    t = np.sort(random.uniform(0, 100, 2000)) + 1e-3 * np.arange(2000)
    y = 5 * np.sin(t) + 0.2 * random.normal(size=2000)
    found = estimate_noise([(y, t)])
    assert found.deviation == pytest.approx(0.2, rel=0.07)
    assert math.isnan(found.flat) and found.separable  # no spectrum of samples at uneven times
    assert estimate(1e5 + 1e3 * y, 60 * t - 7) == pytest.approx(1e3 * found.deviation, rel=1e-6)


def test_noise_is_exact_where_there_is_none() -> None:
    t = np.linspace(0, 1, 50)
    assert estimate(3 + t, t) < 1e-12
    fast = np.linspace(0, 100, 5001)
    found = estimate_noise([(np.sin(fast), fast)])
    assert found.deviation < 1e-9 and not found.separable


def test_what_is_undefined_is_nan() -> None:
    assert math.isnan(estimate(np.full(20, 3.0), np.arange(20.0)))
    assert math.isnan(estimate(np.sin(np.arange(9.0)), np.arange(9.0)))


def test_knocks_and_clipping_do_not_count() -> None:
    random = np.random.default_rng(5)
    t = np.arange(3000) * 0.01
    y = np.sin(t) + 0.01 * random.normal(size=3000)
    knocked = y.copy()
    knocked[::150] += 5.0
    # 20 knocks spoil 3 to 9 differences each, about a tenth of the record
    assert estimate(knocked, t) == pytest.approx(0.01, rel=0.12)
    assert estimate(np.minimum(y, 0.0), t) == pytest.approx(0.01, rel=0.12)
    stepped = y + np.sign(np.sin(2 * t))
    assert estimate(stepped, t) == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("speed", [1, 3, 10])
def test_quantised_record(speed: float, noise: float) -> None:
    step, t = 1e-4, np.arange(5000) * 0.001
    y = np.sin(speed * t) + noise * step * np.random.default_rng(6).normal(size=5000)
    found = estimate(np.round(y / step) * step, t)
    # an even error of one step has the standard deviation step / sqrt(12); a smooth signal spreads it unevenly over the
    # frequencies, which costs up to a tenth
    assert found == pytest.approx(step * math.hypot(noise, 1 / math.sqrt(12)), rel=0.1 if noise == 0 else 0.05)


RIG = """
model: rig
components:
  push:   {is: ForceSource, u: 0 N}
  cart:   {is: Mass, m: 2 kg}
  spring: {is: Spring, c: 50 N/m}
  damper: {is: Damper, d: 3 N*s/m}
  rail:   {is: Fixed}
nodes: {load: [push.a, cart.a, spring.b, damper.b], rail: [rail.a, spring.a, damper.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
"""


def test_all_records_of_an_experiment_share_one_estimate(tmp_path: Path) -> None:
    """The noise of a channel is that of its sensor: one figure, in a record without motion as in the others. White readings
    of the force alone cannot be separated from a signal, those of a smooth motion can."""
    (tmp_path / "rig.yaml").write_text(RIG)
    random, t = np.random.default_rng(3), np.arange(800) * 0.01
    for name, size in (("one", 1.0), ("two", 0.0)):
        push = size * np.sin(3 * t)
        x = 0.02 * np.sin(3 * t - 0.2) * size + 1e-4 * random.normal(size=800)
        rows = "".join(f"{a:.2f},{u:.6f},{b:.7f}\n" for a, u, b in zip(t, push, x, strict=True))
        (tmp_path / f"{name}.csv").write_text("t,push,x\n" + rows)
    (tmp_path / "measured.yaml").write_text("""
experiment: measured
model: rig.yaml
records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: t, unit: s}
inputs: {push.u: {column: push, unit: N, interpolation: linear}}
outputs: {load.x: {column: x, unit: m}}
free: {spring.c: 10 .. 200 N/m}
""")
    found = hb.compare(tmp_path / "measured.yaml")
    one, two = (found.records[name].channels["load.x"].noise for name in ("one", "two"))
    assert one == two == pytest.approx(1e-4, rel=0.08)
    fitted = hb.fit(tmp_path / "measured.yaml", starts=1).after
    assert fitted.records["one"].channels["load.x"].noise == one
    result = CliRunner().invoke(main, ["check", str(tmp_path / "measured.yaml")])
    assert result.exit_code == 0 and "estimated, +- 2" in result.output.replace("\n", " "), result.output
