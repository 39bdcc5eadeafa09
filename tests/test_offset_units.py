"""A difference, deviation, tolerance or noise in degC or degF is an interval; a sum of two temperatures is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.quantities import ranges

PLATE = """model: plate
components:
  a: {is: HeatCapacity, m: 1 kg, c: 460 J/(kg*K)}
  r: {is: ThermalResistance, R: 0.1 K/W}
  b: {is: Ambient, T_0: 20 degC}
nodes: {a: [a.a, r.a], b: [r.b, b.a]}
initial: {a.T: 80 degC}
simulate: {until: 46 s, every: 1 s}
show: {T: {is: a.T, unit: degC}}
"""  # time constant 46 s: a.T - b.T falls from 60 K to 60/e K
SHOWN = "show: {T: {is: a.T, unit: degC}}"
SIGNALS = PLATE.replace("nodes: {", """  s: {is: TemperatureSensor}
  q: {is: TemperatureSensor}
  d: {is: Sum, k_2: -1}
nodes: {""").replace(
    "a: [a.a, r.a], b: [r.b, b.a]", "a: [a.a, r.a, s.a], b: [r.b, b.a, q.a], s: [s.y, d.u_1], q: [q.y, d.u_2]")
BEHIND = SIGNALS.replace("d: {is: Sum, k_2: -1}",
                         "d: {is: Sum, k_2: -1}\n  x: {is: Saturation, u_min: -1 K, u_max: 90 K}").replace(
    "q: [q.y, d.u_2]", "q: [q.y, d.u_2], d: [d.y, x.u]")
SAMPLED = BEHIND.replace("is: Saturation, u_min: -1 K, u_max: 90 K", "is: SampleHold, T_s: 1 s")
EXPERIMENT = """experiment: plate cooling
model: plate.yaml
records: {{train: {{file: rec.csv, use: fit}}}}
time: {{column: t, unit: s}}
outputs: {{{formula}: {{column: y, unit: {unit}, noise: {noise}}}}}
free: {{r.R: 0.01 .. 1 K/W}}
"""


def shown(formula: str, unit: str, text: str = PLATE) -> hb.Result:
    return hb.simulate(hb.loads(text.replace(SHOWN, f'show: {{y: {{is: "{formula}", unit: {unit}}}}}')))


def problem_of(text: str, code: str = "unit-offset") -> str:
    with pytest.raises(hb.HeavebondError) as error:
        hb.assemble(hb.loads(text))
    assert error.value.problems[0].code == code
    return str(error.value)


@pytest.mark.parametrize(("formula", "unit", "first", "text"), [
    ("a.T - b.T", "degC", 60.0, PLATE),
    ("a.T - b.T", "degF", 108.0, PLATE),
    ("2*(b.T - a.T)", "degC", -120.0, PLATE),
    ("a.T - 20 degC", "degC", 60.0, PLATE),
    ("a.T - b.T_0", "degC", 60.0, PLATE),
    ("abs(a.T - b.T)/2", "degC", 30.0, PLATE),
    ("max(a.T, b.T) - min(a.T, b.T)", "degC", 60.0, PLATE),
    ("r.Q*r.R", "degC", 60.0, PLATE),
    ("d.y", "degC", 60.0, SIGNALS),
    ("x.y", "degC", 60.0, BEHIND),
    ("x.y - 0 K", "degF", 108.0, BEHIND),
    ("x.y", "degC", 60.0, SAMPLED),
    ("max(a.T - b.T, 0 K)", "degC", 60.0, PLATE),
    ("if_else(a.T > 300 K, a.T - b.T, -1 K)", "degF", 108.0, PLATE.replace("until: 46 s", "until: 20 s")),
])
def test_a_shown_difference_of_temperatures_is_an_interval(formula: str, unit: str, first: float, text: str) -> None:
    run = shown(formula, unit, text)
    shown_unit = run.unit("y")
    assert "delta" in shown_unit or shown_unit == "K"
    assert run.display["y"][0] == pytest.approx(first, rel=1e-12)
    # the error of a run is about its rtol, 1e-8 of 300 K
    late = 1.0 if text == SAMPLED else 0.0  # the last sample is 1 s old, or of the last instant
    assert run.display["y"][-1] == pytest.approx(first*np.exp(-run.time[-1]/46), abs=1e-4 + late)


@pytest.mark.parametrize(("formula", "unit", "first"), [
    ("a.T", "degC", 80.0), ("a.T", "degF", 176.0), ("(a.T + b.T)/2", "degC", 50.0), ("b.T + 0.25*(a.T - b.T)", "degC", 35.0),
    ("a.T - 5 K", "degC", 75.0), ("max(a.T, b.T)", "degF", 176.0), ("a.T - b.T", "K", 60.0),
    ("20 degC + (a.T - b.T)", "degC", 80.0),
])
def test_a_shown_temperature_counts_from_the_zero_of_its_scale(formula: str, unit: str, first: float) -> None:
    run = shown(formula, unit)
    assert run.unit("y") == unit
    assert run.display["y"][0] == pytest.approx(first, rel=1e-12)


@pytest.mark.parametrize("text", [
    PLATE.replace("is: a.T,", "is: a.T + b.T,"),
    PLATE.replace("is: a.T,", "is: a.T + 5 degC,"),
    PLATE.replace("T_0: 20 degC", "T_0: 20 degC + 5 degC"),
    PLATE.replace("T_0: 20 degC", "T_0: =T_r + 5 degC").replace("components:", "parameters: {T_r: 20 degC}\ncomponents:"),
    PLATE.replace("b: {is: Ambient, T_0: 20 degC}", "b: {is: TemperatureSource, u: =T_r + 5 degC*sin(time/1 s)}").replace(
        "components:", "parameters: {T_r: 20 degC}\ncomponents:"),
    PLATE.replace("initial: {a.T: 80 degC}", "initial: {a.T: =b.T_0 + 60 degC}"),
    PLATE.replace("initial: {a.T: 80 degC}", 'initial: {"a.T + b.T": 100 degC}'),
    PLATE.replace("is: a.T,", "is: a.T - 293.15 K,"),
])
def test_a_sum_of_two_temperatures_is_refused(text: str) -> None:
    assert "write" in problem_of(text).lower()


@pytest.mark.parametrize(("text", "instead"), [
    (SIGNALS.replace("d: {is: Sum, k_2: -1}", "d: {is: SensorOffset, offset: 0.3 degC}").replace(
        ", s: [s.y, d.u_1], q: [q.y, d.u_2]", ", s: [s.y, d.u]").replace("  q: {is: TemperatureSensor}\n", "").replace(
        ", q.a]", "]"), "0.3 K"),
    (SIGNALS.replace("d: {is: Sum, k_2: -1}",
                     "d: {is: Sum, k_2: -1}\n  w: {is: Relay, u_on: 5 degC, u_off: 2 K, y_on: 1}").replace(
        "q: [q.y, d.u_2]", "q: [q.y, d.u_2], d: [d.y, w.u]"), "5 K"),
    (PLATE.replace("initial: {a.T: 80 degC}", "initial: {a.T - b.T: 60 degC}"), "60 K"),
    (PLATE.replace("initial: {a.T: 80 degC}", "initial: {a.T - b.T: ~ 9 degF}"), "5 K"),
    (PLATE + 'vary: {r.R: "=1 + (a.T - b.T)/(10 degC)"}\n', "10 K"),
    (PLATE.replace("until: 46 s", 'until: {when: "a.T - b.T < 30 degC", at_most: 1 h}'), "30 K"),
])
def test_a_difference_given_as_a_temperature_is_refused_with_the_interval(text: str, instead: str) -> None:
    assert instead in problem_of(text)


def record(folder: Path, unit: str) -> None:
    """The plate with R = 0.12 K/W, whose temperature above the ambient falls with exp(-t/55.2 s), and noise of 0.3 K."""
    (folder / "plate.yaml").write_text(PLATE)
    t = np.arange(0.0, 101.0)
    y = 60*np.exp(-t/55.2) + np.random.default_rng(1).normal(0, 0.3, len(t))
    values = {"degC": 20 + y, "degF": 68 + 1.8*y, "difference": y}[unit]
    np.savetxt(folder / "rec.csv", np.column_stack([t, values]), "%.6f", ",", header="t,y", comments="")


@pytest.mark.parametrize(("unit", "noise", "formula", "kind"), [
    ("degC", "0.3 degC", "a.T", "degC"), ("degF", "0.54 degF", "a.T", "degF"), ("degF", "0.3 degC", "a.T", "degF"),
    ("K", "0.3 degC", "a.T - b.T", "difference"), ("degC", "0.3 K", "a.T - b.T", "difference"),
])
def test_noise_in_degC_is_an_interval(tmp_path: Path, unit: str, noise: str, formula: str, kind: str) -> None:
    record(tmp_path, kind)
    path = tmp_path / "e.yaml"
    path.write_text(EXPERIMENT.format(formula=formula, unit=unit, noise=noise))
    found = hb.fit(path)
    parameter = found.parameters[0]
    # the deviation of R is about 1 % of it with 67 samples of 0.3 K; four of them
    assert parameter.value == pytest.approx(0.12, rel=0.02)
    # chi-square of 66 degrees of freedom: 1 +- 4*sqrt(2/66)
    assert found.chi2 == pytest.approx(1.0, abs=0.7)


def test_an_entry_of_show_with_the_name_of_its_variable_has_its_origin(tmp_path: Path) -> None:
    record(tmp_path, "degC")
    (tmp_path / "plate.yaml").write_text(PLATE.replace(SHOWN, "show: {a.T: {unit: degC}}"))
    path = tmp_path / "e.yaml"
    path.write_text(EXPERIMENT.format(formula="a.T", unit="degC", noise="0.3 degC"))
    # the same limits as in the test before
    assert hb.fit(path).parameters[0].value == pytest.approx(0.12, rel=0.02)


@pytest.mark.parametrize(("limit", "code"), [("peak(a.T - b.T) < 60 degC", "unit-offset"),
                                             ("final(a.T) - final(b.T) < 50 degF", "unit-offset")])
def test_a_limit_on_a_difference_in_degC_is_refused(limit: str, code: str) -> None:
    task = hb.TuningProblem(ranges({"r.R": "0.05 .. 0.2 K/W"}), "final(a.T)", limits=(limit,))
    with pytest.raises(hb.HeavebondError, match="Write") as error:
        hb.tune(hb.loads(PLATE), task, explore=0)
    assert error.value.problems[0].code == code


STUDY = """study: plate
model: plate.yaml
cases: {r.R: {from: 0.1 K/W, to: 0.2 K/W, number: 2}}
measure:
  swing: {is: highest(a.T) - lowest(a.T), unit: degC}
  end: {is: final(a.T), unit: degC}
  spread: {is: deviation(a.T), unit: degF}
"""


def test_a_measure_of_a_difference_is_an_interval(tmp_path: Path) -> None:
    (tmp_path / "plate.yaml").write_text(PLATE)
    (tmp_path / "s.yaml").write_text(STUDY)
    found = hb.study(hb.load_study(tmp_path / "s.yaml"))
    outcome = found.outcomes[0]
    # highest and lowest are at the ends, within the error of the run
    assert found.value(outcome, "swing") == pytest.approx(60*(1 - 1/np.e), abs=1e-3)
    assert found.value(outcome, "end") == pytest.approx(20 + 60/np.e, abs=1e-3)
    # the standard deviation of 60 exp(-t) over 0 to 1
    spread = 60*np.sqrt((1 - np.exp(-2))/2 - (1 - np.exp(-1))**2)
    # the same samples, within the error of the run
    assert found.value(outcome, "spread") == pytest.approx(1.8*spread, rel=1e-4)
    assert found.units["swing"].offset == found.units["spread"].offset == 0


def test_an_uncertainty_in_degC_is_an_interval() -> None:
    from heavebond.optimise.robustness import _width

    assembly = hb.assemble(hb.loads(PLATE))
    assert _width(assembly, "b.T_0", "3 degC") == pytest.approx(3.0, rel=1e-12)
    assert _width(assembly, "b.T_0", "9 degF") == pytest.approx(5.0, rel=1e-12)
    with pytest.raises(hb.UsageError, match=r"8\.79 K"):
        _width(assembly, "b.T_0", "3 %")


def test_gauge_pressures_are_refused_with_the_unit_to_write() -> None:
    text = "model: m\ncomponents:\n  p: {is: PressureSource, p_0: 3 barg}\n  c: {is: Cap}\nnodes: {a: [p.a, c.a]}\n"
    with pytest.raises(hb.ModelError, match="Write 'bar'"):
        hb.loads(text)


def test_the_command_line_shows_an_interval_in_kelvin(tmp_path: Path) -> None:
    path = tmp_path / "plate.yaml"
    path.write_text(PLATE.replace(SHOWN, "show: {dT: {is: a.T - b.T, unit: degC}}"))
    text = CliRunner().invoke(main, ["run", str(path)]).output
    row = next(line.split() for line in text.splitlines() if line.startswith("dT"))
    assert row[1] == "K" and float(row[3]) == 60.0


PLATES = """
model: plates
components:
  a: {is: HeatCapacity, m: 1 kg, c: 460 J/(kg*K)}
  b: {is: HeatCapacity, m: 1 kg, c: 460 J/(kg*K)}
  r: {is: ThermalResistance, R: 0.2 K/W}
  s: {is: TemperatureSensor}
  q: BLOCK
nodes: {s: [s.y, q.IN], a: [a.a, r.a, s.a], b: [b.a, r.b]}
initial: {a.T: 80 degC, b.T: 20 degC}
show: {y: {is: q.y, unit: degC}, d: {is: a.T - b.T, unit: degF}}
simulate: {until: 46 s}
"""
GAIN = PLATES.replace("BLOCK", "{is: Gain, k: 1}").replace("IN", "u")


@pytest.mark.parametrize(("cost", "instead"), [
    ("((final(a.T - b.T) - 30 degC)/(1 degC))**2", "30 K"),
    ("((final(a.T) - 60 degC)/(0.5 degC))**2", "`0.5 K`"),
    ("abs(final(d) - 54 degF)/(1 degF)", "30 K"),
])
def test_a_cost_with_an_interval_given_as_a_temperature_is_refused(cost: str, instead: str) -> None:
    with pytest.raises(hb.UsageError) as caught:
        hb.tune(hb.loads(GAIN), hb.tuning_task({"r.R": "0.05 .. 2 K/W"}, cost))
    assert caught.value.problems[0].code == "unit-offset"
    assert instead in caught.value.problems[0].hint


def test_a_multiple_of_a_temperature_is_not_shown_in_degC_and_a_difference_of_two_costs_is_an_interval() -> None:
    for measure in ("2*final(a.T) in degC", "final(a.T)/2 in degC"):
        with pytest.raises(hb.HeavebondError, match="each with a separate origin"):
            hb.sweep(hb.loads(GAIN), {"r.R": "0.2 K/W"}, [measure])
    found = hb.sweep(hb.loads(GAIN), {"r.R": "0.2 K/W"}, ["final(a.T) - final(b.T) in degC"]).to_pandas()
    assert found.columns[1].endswith("[K]")
    assert found.iloc[0, 1] == pytest.approx(60 / np.e, rel=1e-5)


@pytest.mark.parametrize(("block", "given"), [
    ("{is: Quantiser, step: 0.5 degC, T_s: 1 s}", "0.5"), ("{is: DeadBand, g: 2 degC}", "2"),
    ("{is: SensorOffset, offset: 2 degC}", "2"), ("{is: Sum, u_2: =noise.y}", "0.3"),
])
def test_a_step_a_band_and_an_amplitude_of_a_signal_are_intervals(block: str, given: str) -> None:
    text = PLATES.replace("IN", "u_1" if "Sum" in block else "u").replace("BLOCK", block)
    if "Sum" in block:
        text = text.replace("nodes:", "  noise: {is: WhiteNoise, sigma: 0.3 degC, T_s: 1 s}\nnodes:")
    with pytest.raises(hb.ModelError, match="is a difference of temperatures") as caught:
        hb.simulate(hb.loads(text))
    assert caught.value.problems[0].hint == f"Write '{given} K'."


def test_the_difference_of_a_sensor_and_a_setpoint_is_an_interval() -> None:
    text = PLATES.replace("IN", "u_1").replace("BLOCK", "{is: Sum, k_1: 1, k_2: -1, u_2: 20 degC}")
    run = hb.simulate(hb.loads(text))
    assert run["y"].unit == "K"
    assert run["y"].magnitude[[0, -1]] == pytest.approx([60, 30 + 30 / np.e], rel=1e-5)
