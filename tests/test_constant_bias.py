"""A bias that is equal on all records: an offset of a sensor or of an input."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.units import read_unit
from heavebond.diagnosis.answer.sentences import _revalued, _share, wrong_channels, wrong_starts
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.state import AddedEffect
from heavebond.estimation.constant_bias import Bias, common_bias, mean_residual

MODEL = """
model: rig
components:
  foot:   {is: PositionSource, u: 0 m}
  spring: {is: SpringDamper, c: 1 kN/m, d: 40 N*s/m}
  cart:   {is: Mass, m: 5 kg}
nodes: {base: [foot.a, spring.a], load: [spring.b, cart.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
"""
EXPERIMENT = """
experiment: rig
model: rig.yaml
records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: t, unit: s}
inputs: {foot.u: {column: u, unit: mm, interpolation: spline}}
outputs: {load.x: {column: x, unit: mm, noise: 0.5 mm}}
"""


def coloured(random: np.random.Generator, n: int, memory: float) -> np.ndarray:
    """First-order autoregressive noise of standard deviation 1."""
    found = random.standard_normal(n)
    for k in range(1, n):
        found[k] = memory * found[k - 1] + np.sqrt(1 - memory**2) * found[k]
    return found


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.97])
def test_the_standard_error_allows_for_correlation(memory: float) -> None:
    """A mean of zero counts as significant in about 1 % of draws, where that of independent samples would in half."""
    random = np.random.default_rng(3)
    found = [mean_residual(coloured(random, 1500, memory)) for _ in range(200)]
    assert sum(bias is not None and bias.significant for bias in found) <= 10
    shifted = [mean_residual(2 + coloured(random, 1500, memory)) for _ in range(20)]
    assert all(bias is not None and bias.significant for bias in shifted)
    assert mean_residual(np.ones(49)) is None


def test_only_what_all_records_share_counts() -> None:
    assert common_bias([Bias(2.0, 0.1), Bias(2.2, 0.1)], 0.5) is not None
    assert common_bias([Bias(2.0, 0.1)], 0.5) is None  # one record
    assert common_bias([Bias(2.0, 0.1), Bias(-2.0, 0.1)], 0.5) is None  # signs
    assert common_bias([Bias(2.0, 0.1), Bias(5.0, 0.1)], 0.5) is None  # sizes
    assert common_bias([Bias(2.0, 0.1), Bias(2.0, 1.0)], 0.5) is None  # not significant in one of them
    assert common_bias([Bias(2.0, 0.1), Bias(2.0, 0.1)], 10.0) is None  # far below the noise
    assert common_bias([Bias(2.0, 0.1), None], 0.5) is None


def write(folder: Path, offsets: tuple[float, float], unit: str = "mm") -> None:
    (folder / "rig.yaml").write_text(MODEL)
    (folder / "beside.yaml").write_text(EXPERIMENT.replace("noise: 0.5 mm", f"noise: 0.5 {unit}").replace(
        "column: x, unit: mm", f"column: x, unit: {unit}"))
    random = np.random.default_rng(1)
    for name, offset, period in zip(("one", "two"), offsets, (1.7, 1.1), strict=True):
        time = np.arange(0, 20, 0.02)
        u = 20 * np.sin(2 * np.pi * time / period) * (1 - np.exp(-time))
        (folder / "u.csv").write_text("t,u\n" + "".join(f"{t:.2f},{v:.6f}\n" for t, v in zip(time, u, strict=True)))
        run = hb.simulate(hb.loads(MODEL.replace("u: 0 m", "u: {file: u.csv, column: u, unit: mm, interpolation: spline, "
                                                 "time: {column: t, unit: s}}")), until=19.98, every=0.02)
        x = 1e3 * run["load.x"] + offset + 0.5 * coloured(random, len(time), 0.8)
        rows = zip(time, u, x, strict=True)
        (folder / f"{name}.csv").write_text("t,u,x\n" + "".join(f"{t:.2f},{a:.6f},{b:.5f}\n" for t, a, b in rows))


def test_compare_suggests_an_offset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, (2.0, 2.0))
    said = CliRunner().invoke(main, ["compare", "beside.yaml"]).stdout.splitlines()
    lines = [line for line in said if "bias equal on all records" in line]
    assert len(lines) == 1
    found = re.match(r"load.x: bias equal on all records, (\S+) \+- (\S+) mm \(95 %\)", lines[0])
    assert found and abs(float(found[1]) - 2) < 2 * float(found[2]) < 0.4
    assert "which suggests an offset of the sensor or of an input" in lines[0]
    assert "`heavebond try beside.yaml SensorOffset --at load.x`" in lines[0] and "(--at foot.u)" in lines[0]
    # what is advised can be typed
    formula = re.search(r"`(is: load.x \+ \S+ mm)`", lines[0])
    assert formula
    text = (tmp_path / "beside.yaml").read_text()
    (tmp_path / "beside.yaml").write_text(text.replace("load.x: {column", f"load.x: {{{formula[1]}, column"))
    corrected = hb.compare("beside.yaml")
    assert corrected.advice == () and all(abs(r.channels["load.x"].bias) < 0.2 for r in corrected.records.values())


def test_a_bias_among_larger_errors_may_have_another_cause() -> None:
    """The choked valve of the receiver: its pressure is too high on all records, but not by a constant."""
    line, = hb.compare("receiver_rig/choked").advice
    assert "or from a missing effect, as without it chi-square is still" in line


@pytest.mark.parametrize("offsets", [(0.0, 0.0), (2.0, -2.0), (2.0, 0.0), (1.0, 4.0)])
def test_nothing_is_advised_where_the_records_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                     offsets: tuple[float, float]) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, offsets)
    assert hb.compare("beside.yaml").advice == ()


LOADED = """
model: rig
components:
  ceiling: {is: Fixed}
  spring:  {is: SpringDamper, c: 1 kN/m, d: 40 N*s/m}
  cart:    {is: Mass, m: 5 kg}
  balance: {is: Preload, F: 30 N}
  push:    {is: ForceSource, u: 0 N}
nodes: {top: [ceiling.a, spring.a, balance.a], load: [spring.b, cart.a, balance.b, push.a]}
initial: {start: steady}
"""
PUSHED = """
experiment: rig
model: rig.yaml
records: {one: {file: one.csv, use: fit}, two: {file: two.csv, use: validate}}
time: {column: t, unit: s}
inputs: {push.u: {column: u, unit: N, interpolation: linear}}
outputs:
  load.x:   {column: x, unit: mm, noise: 0.5 mm}
  spring.F: {column: f, unit: N, noise: 0.5 N}
"""


def test_a_wrong_load_in_a_steady_start_is_told_as_one_and_not_as_another_state(tmp_path: Path) -> None:
    """A preload of the other sign biases position and force at once, from the first sample on."""
    (tmp_path / "rig.yaml").write_text(LOADED.replace("F: 30 N", "F: -30 N"))
    truth = hb.load(tmp_path / "rig.yaml")
    random = np.random.default_rng(7)
    for name, period in (("one", 2.1), ("two", 1.3)):
        diagram = truth.with_parameters({"push.u": f"=20 N*sin(2*pi*time/({period} s))"})
        run = hb.simulate(diagram, 10, every=0.02)
        u = 20 * np.sin(2 * np.pi * run.time / period)
        noise = 0.5 * random.standard_normal((2, len(u)))
        columns = np.column_stack([run.time, u, 1e3 * run["load.x"] + noise[0], run["spring.F"] + noise[1]])
        np.savetxt(tmp_path / f"{name}.csv", columns, delimiter=",", header="t,u,x,f", comments="")
    (tmp_path / "rig.yaml").write_text(LOADED)
    (tmp_path / "rig_record.yaml").write_text(PUSHED)
    said = CliRunner().invoke(main, ["compare", str(tmp_path / "rig_record.yaml")]).output
    words = re.sub(r"\s+", " ", said)
    assert "which starts in equilibrium: if the machine was at rest then too, a value of the diagram" in words
    assert "write `initial:" not in words
    assert "2 channels are biased at once: one wrong value of the diagram" in words


def test_a_diagnosis_without_a_name_leads_to_the_start_that_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(MODEL)
    (tmp_path / "rig_record.yaml").write_text(EXPERIMENT)
    random = np.random.default_rng(2)
    for name, period in (("one", 1.9), ("two", 1.4)):
        moving = hb.load(tmp_path / "rig.yaml").with_parameters({"foot.u": f"=30 mm*sin(2*pi*time/({period} s))"})
        run = hb.simulate(moving, 10, every=0.02)
        t, x = run.time[20:], 1e3 * run["load.x"][20:] + 0.5 * random.standard_normal(481)  # cut off while it moves
        columns = np.column_stack([t, 30 * np.sin(2 * np.pi * t / period), x])
        np.savetxt(tmp_path / f"{name}.csv", columns, delimiter=",", header="t,u,x", comments="")
    compared = hb.compare(tmp_path / "rig_record.yaml")
    *starts, advice = wrong_starts("undetermined", compared)
    assert starts and all("begins at" in line for line in starts)
    assert "set the start right, then diagnose again" in advice
    assert wrong_starts("effect", compared) == starts


def test_a_diagnosis_leads_with_a_channel_of_another_sign(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(MODEL)
    (tmp_path / "rig_record.yaml").write_text(EXPERIMENT)
    for name, period in (("one", 1.9), ("two", 1.4)):
        moving = hb.load(tmp_path / "rig.yaml").with_parameters({"foot.u": f"=30 mm*sin(2*pi*time/({period} s))"})
        run = hb.simulate(moving, 10, every=0.02)
        columns = np.column_stack([run.time, 30 * np.sin(2 * np.pi * run.time / period), -1e3 * run["load.x"]])
        np.savetxt(tmp_path / f"{name}.csv", columns, delimiter=",", header="t,u,x", comments="")
    first, of_input, then = wrong_channels(hb.compare(tmp_path / "rig_record.yaml"))
    assert first.startswith("one, two: load.x moves against the model") and "write `is: -(load.x)`" in first
    assert "factor: -1" in of_input and then.startswith("If so, correct it")


def test_a_gain_below_zero_is_reported_as_a_wrong_sign(tmp_path: Path) -> None:
    """A sensor gain absorbs the wrong sign of an input, so that no channel moves against the final model."""
    (tmp_path / "rig.yaml").write_text(MODEL)
    (tmp_path / "rig_record.yaml").write_text(EXPERIMENT)
    for name, period in (("one", 1.9), ("two", 1.4)):
        moving = hb.load(tmp_path / "rig.yaml").with_parameters({"foot.u": f"=30 mm*sin(2*pi*time/({period} s))"})
        run = hb.simulate(moving, 10, every=0.02)
        columns = np.column_stack([run.time, 30 * np.sin(2 * np.pi * run.time / period), 1e3 * run["load.x"]])
        np.savetxt(tmp_path / f"{name}.csv", columns, delimiter=",", header="t,u,x", comments="")
    compared = hb.compare(tmp_path / "rig_record.yaml")

    def words(where: str, signal: str, error: float) -> list[str]:
        candidate = SimpleNamespace(kind="sensor gain", where=(where,), signal=signal, place=f"before {signal or where}")
        effect = SimpleNamespace(candidate=candidate, parameters=[SimpleNamespace(value=error)])
        return wrong_channels(compared, [cast(AddedEffect, effect)])

    first, then = words("foot", "foot.u", -1.98)
    assert first == ("The fitted gain before foot.u is -0.98: the signal seems to have the opposite sign. To turn it, "
                     "write `factor: -1` at foot.u.")
    assert then.startswith("If so, correct it")
    assert "write `is: -(load.x)` at load.x" in words("load.x", "", -2.1)[0]
    assert words("foot", "foot.u", -0.9) == []


def test_a_value_that_acts_as_another_and_was_not_fitted_is_told_without_a_number() -> None:
    mass = SimpleNamespace(name="cabin.m", unit=read_unit("kg"), neutral=900.0)
    fitted, alike = (cast(Refit, SimpleNamespace(candidate=SimpleNamespace(numbers=(mass,)), values=values))
                     for values in ({"cabin.m": 1010.0}, {}))
    assert _revalued(fitted) == "cabin.m at 1.01 t (in the diagram 900 kg)"
    assert _revalued(alike) == "another value of cabin.m (in the diagram 900 kg)"


@pytest.mark.parametrize(("explained", "words"), [(0.9997, "more than 99"), (0.994, "99"), (0.66, "66"), (0.0123, "1.2")])
def test_a_share_beside_which_more_is_missing_is_never_all(explained: float, words: str) -> None:
    assert _share(explained) == words
