"""Extremes, mean squares and the verdict do not depend on the output points."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import quad

import heavebond as hb
from heavebond.cli import main
from heavebond.numerics.dae import assemble
from heavebond.numerics.extremes import signal_figures
from heavebond.numerics.machine_code import compiler
from heavebond.studies.run_case import measured
from heavebond.studies.study import load_study

PULSE = """
model: pulse
components:
  w: {is: Fixed}
  s: {is: SpringDamper, c: 10 kN/m, d: 2 kN*s/m}
  m: {is: Mass, m: 100 kg}
  t: {is: Pulse, t_s: 1800 s, width: 1 s, height: 1 kN}
  f: {is: ForceSource}
nodes: {u: [t.y, f.u], w: [w.a, s.a], m: [s.b, m.a, f.a]}
initial: {m.x: 0 m, m.v: 0 m/s}
show: {x: {is: m.x, unit: mm}}
simulate: {until: 3600 s}
"""
# x = A cos(omega t), omega = 10 rad/s, over 3 periods: 1001, 31, 7001 or 2 output points
OSCILLATOR = """
model: oscillator
parameters: {A: 20 mm}
components:
  w: {is: Fixed}
  s: {is: Spring, c: 1 kN/m}
  m: {is: Mass, m: 10 kg}
nodes: {w: [w.a, s.a], m: [s.b, m.a]}
initial: {m.x: =A, m.v: 0 m/s}
show: {x: {is: m.x, unit: mm}, v: {is: m.v, unit: m/s}, force: {is: 1000 N/m * m.x, unit: N}}
simulate: {until: 1.95 s}
"""
# a ball falls from 1 m and leaves the floor with half of its speed
BALL = """
model: ball
components:
  floor: {is: Fixed}
  ball:  {is: Mass, m: 1 kg}
  down:  {is: Weight, m: 1 kg, g: 10 m/s**2}
  stop:  {is: RigidStop, e: 0.5}
nodes: {floor: [floor.a, stop.a], ball: [ball.a, down.a, stop.b]}
initial: {ball.x: 1 m, ball.v: 0 m/s}
show: {v: {is: ball.v, unit: m/s}}
simulate: {until: 0.8 s}
"""
# 1 L of oil of 1.5 GPa: 10 mL/s for 1 s out and in again takes 150 bar, from 100 bar
DRAWN = """
model: drawn
components:
  out:  {is: Pulse, t_s: 50.2 s, width: 0.1 s, height: -6 L/min}
  back: {is: Pulse, t_s: 50.4 s, width: 0.1 s, height: 6 L/min}
  sum:  {is: Sum}
  pump: {is: FlowSource}
  oil:  {is: Volume, V: 1 L, beta: 1.5 GPa}
nodes: {one: [out.y, sum.u_1], two: [back.y, sum.u_2], u: [sum.y, pump.u], oil: [pump.a, oil.a]}
initial: {oil.p: 10 bar}
show: {p: {is: oil.p, unit: bar}}
simulate: {until: 100 s, every: 1 s}
"""


def table(text: str, tmp_path: Path, *arguments: str) -> dict[str, dict[str, float]]:
    """The figures of `heavebond run`."""
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    told = tmp_path / "told.json"
    answer = CliRunner().invoke(main, ["run", str(tmp_path / "m.yaml"), "--json", str(told), *arguments])
    assert answer.exit_code == 0, answer.output
    outputs: dict[str, dict[str, float]] = json.loads(told.read_text(encoding="utf-8"))["outputs"]
    return outputs


def response(t: float) -> float:
    """x in mm, t after the pulse began: critically damped, omega = 10 rad/s, static 100 mm."""
    def step(s: float) -> float:
        return 100*(1 - (1 + 10*s)*np.exp(-10*s)) if s > 0 else 0.0
    return float(step(t) - step(t - 1))


def test_a_drawn_curve_shows_the_extreme_of_the_table() -> None:
    found = hb.simulate(hb.loads(PULSE))
    line, = found.plot("x").axes[0].lines
    assert float(np.max(line.get_ydata())) == pytest.approx(found.figures(["x"])["x"].most, rel=1e-3)


def test_a_pulse_between_two_output_points_is_in_the_table(tmp_path: Path) -> None:
    """The extreme is read from a cubic between points about a step apart: 1e-4 of it; the mean square is an integral of
    the same cubics."""
    x = table(PULSE, tmp_path)["x"]
    assert x["max"] == pytest.approx(max(response(t) for t in np.linspace(0.99, 1.01, 2001)), rel=1e-4)
    square = quad(lambda t: response(t)**2, 0, 5, points=[1.0], limit=200)[0]
    assert x["rms"] == pytest.approx((square/3600)**0.5, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(("solver", "every"), [
    *(("auto", every) for every in ("1.95 ms", "65 ms", "0.27 ms", "1.95 s")), ("idas", "65 ms"), ("idas", "1.95 s"),
    pytest.param("rosenbrock", "65 ms", marks=pytest.mark.skipif(compiler() is None, reason="needs a C compiler"))])
def test_figures_of_an_oscillator_do_not_depend_on_its_output_points(tmp_path: Path, every: str, solver: str) -> None:
    """Closed forms to 1e-6: errors of the runs are some 1e-7, those of the cubics 1e-8."""
    figures = table(OSCILLATOR, tmp_path, "--every", every, "--solver", solver)
    assert figures["x"]["max"] == pytest.approx(20, rel=1e-6)
    assert figures["x"]["min"] == pytest.approx(-20, rel=1e-6)
    assert figures["v"]["max"] == pytest.approx(0.2, rel=1e-6)
    mean = 200*(1 + np.sin(2*10*1.95)/(2*10*1.95))
    assert figures["x"]["rms"] == pytest.approx(mean**0.5, rel=1e-6)
    assert figures["force"]["rms"] == pytest.approx(mean**0.5, rel=1e-6)


@pytest.mark.parametrize("every", ["0.8 s", "0.2 s", "0.7 ms"])
def test_a_velocity_has_its_extreme_on_the_side_of_an_impact_before_it(tmp_path: Path, every: str) -> None:
    """sqrt(2 g h) = 4.472 m/s downwards just before the impact at 0.447 s, half of it upwards just after."""
    v = table(BALL, tmp_path, "--every", every)["v"]
    t = 20**0.5/10
    assert v["min"] == pytest.approx(-20**0.5, rel=1e-7)
    assert v["max"] == pytest.approx(20**0.5/2, rel=1e-7)
    after = quad(lambda s: (20**0.5/2 - 10*s)**2, 0, 0.8 - t)[0]
    assert v["rms"] == pytest.approx(((100*t**3/3 + after)/0.8)**0.5, rel=1e-6)


@pytest.mark.parametrize("every", ["1 s", "100 s", "10 ms"])
def test_the_verdict_sees_a_pressure_below_zero_between_two_output_points(every: str) -> None:
    """10 mL out of 1 L of oil at 10 bar: -140 bar for 0.1 s; no liquid takes more than -1 bar."""
    with pytest.warns(hb.RunWarning, match=r"oil\.p falls below"):
        found = hb.simulate(hb.loads(DRAWN), every=every)
    (finding, ) = [f for f in found.verdict.findings if f.name == "oil.p"]
    # a run that sees the violation at an output point ends there; else the verdict has the least pressure between two points
    assert 1e6 - 1.5e9*0.01 - 1 <= finding.value < -101325 == finding.limit
    assert finding.time == pytest.approx(50.2, abs=0.1)


@pytest.mark.parametrize("every", ["1.95 ms", "130 ms"])
def test_a_measured_extreme_and_its_slope_do_not_depend_on_the_output_points(tmp_path: Path, every: str) -> None:
    """highest(x) = A, largest(m.v) = A omega; their slopes by A are 1 and omega = 10/s, to the accuracy of sensitivities."""
    (tmp_path / "m.yaml").write_text(OSCILLATOR.replace("until: 1.95 s", f"until: 1.95 s, every: {every}"), encoding="utf-8")
    (tmp_path / "s.yaml").write_text("study: s\nmodel: m.yaml\nmeasure: {top: highest(m.x), fast: largest(m.v), "
                                     "swing: deviation(m.x)}\n", encoding="utf-8")
    study = load_study(tmp_path / "s.yaml")
    values, _, slopes = measured(study, assemble(study.model), ["A"])
    assert values["top"] == pytest.approx(0.02, rel=1e-6)
    assert values["fast"] == pytest.approx(0.2, rel=1e-6)
    assert slopes["top"]["A"] == pytest.approx(1, rel=1e-5)
    assert slopes["fast"]["A"] == pytest.approx(10, rel=1e-5)
    end = 10*1.95
    mean = np.sin(end)/end
    assert values["swing"] == pytest.approx(0.02*(0.5 + np.sin(2*end)/(4*end) - mean**2)**0.5, rel=1e-5)


# a mass of 1 kg at 1 m/s meets a wall at 500.3 m, F = c d**2, for 3 ms: its energy is c d**3/3 at the largest depth
IMPACT = """
model: impact
components:
  load: {{is: Mass, m: 1 kg}}
  wall: {{is: ForceSource, u: "=-1e9 N/m**2*max(load.x - 500.3 m, 0 m)**2"}}
  {more}
nodes: {{load: [load.a, wall.a]}}
initial: {{load.x: 0 m, load.v: 1 m/s}}
show: {{force: {{is: wall.u, unit: N}}}}
simulate: {{until: {until}, every: {every}}}
"""
LARGEST_FORCE = 1e9 * (1.5 / 1e9)**(2 / 3)


@pytest.mark.parametrize(("until", "every"), [("1000 s", "1 s"), ("1000 s", "1000 s"), ("1e6 s", "1000 s")])
@pytest.mark.parametrize("more", [
    "", "clock: {is: SquareWave, low: 0, high: 1, T: 400 s}", "hold: {is: SampleHold, T_s: 300 s, u: =load.x}",
    "drop: {is: SharpEdgedOrifice, d: 1 mm}\n  pump: {is: FlowSource, u: 1 L/min}\n  tank: {is: Tank}"])
def test_an_impact_of_milliseconds_in_a_long_run_has_its_force(until: str, every: str, more: str) -> None:
    text = IMPACT.format(until=until, every=every, more=more)
    if "tank" in more:  # with an algebraic unknown
        text = text.replace("nodes: {", "nodes: {oil: [pump.a, drop.a], sink: [drop.b, tank.a], ")
    found = hb.simulate(hb.loads(text))
    figures = found.figures(["force"])["force"]
    assert figures.least == pytest.approx(-LARGEST_FORCE, rel=2e-3)  # of the polynomial through five points
    assert found.dense["load.v"][-1] == pytest.approx(-1, abs=1e-6)
    assert np.all(np.diff(found.dense.time) >= 0)


def test_an_oscillation_with_few_points_a_period_is_no_hidden_motion() -> None:
    """Nothing is integrated again where the rates explain what the states do, with 10 and 4 points a period."""
    for c in ("4 kN/m", "25 kN/m"):
        found = hb.simulate(hb.loads(f"""
model: oscillation
components: {{wall: {{is: Fixed}}, spring: {{is: Spring, c: {c}}}, load: {{is: Mass, m: 1 kg}}}}
nodes: {{wall: [wall.a, spring.a], load: [spring.b, load.a]}}
initial: {{load.x: 1 mm, load.v: 0 m/s}}
simulate: {{until: 90 s, every: 10 ms}}
"""))
        time = found.dense.time
        assert np.diff(time[time > 0.1]).min() > 9e-3  # after the begin, a thousandth of the run
        assert found.figures(["load.x"])["load.x"].most == pytest.approx(1e-3, rel=2e-2)


# a transient of 1 ms at the begin of 2 s; y reaches 1 + exp(-pi zeta/sqrt(1 - zeta**2))
RINGING = """
model: ringing
components:
  lag: {is: SecondOrderLag, f_n: 1 kHz, zeta: 0.3, u: 1}
initial: {lag.y: 0, lag.z: 0}
show: {y: {is: lag.y, unit: "1"}}
simulate: {until: 2 s}
"""


@pytest.mark.parametrize("every", ["2 ms", "0.7 ms", "0.31 ms", "0.2 ms", "20 us"])
def test_the_peak_of_a_transient_at_the_begin_does_not_depend_on_the_output_interval(every):
    run = hb.simulate(hb.loads(RINGING), every=every).dense
    peak = 1 + np.exp(-np.pi * 0.3 / np.sqrt(1 - 0.3**2))
    assert signal_figures(run.time, run["lag.y"]).most == pytest.approx(peak, rel=1e-4)


@pytest.mark.parametrize("measure", ["highest(x)", "rms(power)", "mean(abs(power))"])
def test_measures_of_a_sweep_do_not_depend_on_the_output_points(measure: str) -> None:
    text = """
model: swing
components:
  m: {is: Mass, m: 1 kg}
  s: {is: SpringDamper, c: 39.4784176 N/m, d: 0.05 N*s/m}
  w: {is: Fixed}
nodes: {x: [m.a, s.a], w: [w.a, s.b]}
initial: {x.x: 0 m, x.v: 1 m/s}
show: {x: {is: x.x, unit: mm}, power: {is: "s.F*x.v", unit: W}}
simulate: {until: 10 s, every: EVERY}
"""
    coarse, fine = (hb.sweep(hb.loads(text.replace("EVERY", every)), {"m.m": "1 kg"}, [measure]).to_pandas()
                    for every in ("1 s", "1 ms"))
    # the integral of a kinked signal between the steps of an integrator errs by some 1e-6
    assert coarse.iloc[0, 1] == pytest.approx(fine.iloc[0, 1], rel=3e-6)


def test_measures_of_a_ball_that_bounces_between_output_points() -> None:
    """From 5 m with 10 m/s**2: 100 J at the impact after 1 s; the integral of x**2 is that of parabolas."""
    found = hb.sweep(hb.loads("""
model: ball
components:
  m: {is: Mass, m: 2 kg}
  g: {is: Weight, m: 2 kg, g: 10 m/s**2}
  f: {is: Fixed}
  s: {is: RigidStop, e: 0.5}
nodes: {x: [m.a, g.a, s.b], f: [f.a, s.a]}
initial: {x.x: 5 m, x.v: 0 m/s}
show: {x: {is: x.x, unit: m}, e: {is: "1/2*m.m*x.v**2", unit: J}}
simulate: {until: 2 s, every: 0.7 s}
"""), {"g.g": "10 m/s**2"}, ["highest(e)", "rms(x)"]).to_pandas()
    fall, flight = 25 * (1 - 2 / 3 + 1 / 5), 25 * (1 / 3 - 2 / 4 + 1 / 5)  # x = 5 (1 - t**2) and 5 (t - t**2)
    assert found.iloc[0, 1] == pytest.approx(100, rel=1e-6)
    assert found.iloc[0, 2] == pytest.approx(np.sqrt((fall + flight) / 2), rel=1e-6)
