"""Short motions of prescribed functions of time: no solver passes over what the output points show."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import heavebond as hb
from heavebond.numerics.forcing import FORCING, Forcing, _longest
from heavebond.numerics.machine_code import compiler
from heavebond.numerics.quick_simulation import FitSimulator, QuickSimulator
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.time_search import constant_rows

# a wheel at rest meets a bump of 30 mm after 40 s; the car has passed it in 0.3 s
LATE = """
model: late_bump
parameters: {speed: 5 m/s, length: 0.4 m}
components:
  wheel: {is: Mass, m: 40 kg}
  tyre:  {is: SpringDamper, c: 190 kN/m, d: 1.5 kN*s/m}
  road:  {is: PositionSource, u: "=30 mm*exp(-((speed*(time - 40 s))/length)**2)"}
nodes: {wheel: [wheel.a, tyre.b], road: [tyre.a, road.a]}
show: {place: {is: wheel.x, unit: mm}}
simulate: {until: 50 s, every: 10 ms}
"""


@pytest.fixture(scope="module")
def late() -> hb.Assembly:
    return hb.assemble(hb.loads(LATE))


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "quick", "fit"])
def test_a_bump_after_a_long_rest_is_not_passed_over(late: hb.Assembly, solver: str) -> None:
    if solver == "rosenbrock" and compiler() is None:
        pytest.skip("no C compiler")
    kinds = {"quick": QuickSimulator, "fit": FitSimulator}
    simulator = kinds[solver](late) if solver in kinds else Simulator(late, solver=solver)
    reference = Simulator(late, times=np.linspace(39.0, 42.0, 301)).run().si["place"]  # begins just before it
    found = simulator.run().si["place"][3900:4201]
    assert np.abs(reference).max() > 0.02
    assert found == pytest.approx(reference, abs=1e-5)  # the tolerance of the solvers times the steps over the bump


@pytest.mark.parametrize("sampled", ["45 s", "7 s"])
def test_a_bump_between_events_is_not_passed_over(late: hb.Assembly, sampled: str) -> None:
    """A run with events is integrated in stretches, each in a time of its own."""
    text = LATE.replace("nodes:", f"  late: {{is: SampleHold, T_s: {sampled}, u: =wheel.x/1 m}}\nnodes:")
    found, reference = hb.simulate(hb.loads(text)).si["place"], Simulator(late).run().si["place"]
    assert np.abs(reference).max() > 0.02
    assert found == pytest.approx(reference, abs=1e-5)


def test_a_shorter_bump_of_other_parameters_is_seen_by_the_same_simulator(late: hb.Assembly) -> None:
    simulator = Simulator(late)
    before = simulator.longest
    fast = simulator.run({"speed": "20 m/s"})
    assert 0 < simulator.longest < before
    assert fast.si["place"].max() > 0.02


def test_a_wave_limits_no_step_that_a_solver_would_take(late: hb.Assembly) -> None:
    """An excursion of 5 % of a sine's range is reached in a seventh of its period; with windows in powers of two, at worst
    half of that."""
    time = np.linspace(0.0, 100.0, 2001)
    wave = np.sin(2 * np.pi * time / 10)[None, :]
    assert 10 / 14 <= _longest(wave, 0.05) * 1.001 <= 10 / 7 + 0.1
    steps = np.vstack([np.tanh(time - 50), time, np.ones_like(time)])  # what stays changed is always noticed
    assert _longest(steps, 0.05) == 0.0
    assert FORCING.share == 0.05


def test_a_function_that_is_constant_except_for_rounding_limits_no_step() -> None:
    """The turn of a hinge at constant speed gives such functions, as sums of products of half angles and their quotients. A
    peak and a small motion next to a large one are not constant."""
    t, p = ca.SX.sym("t"), ca.SX.sym("p")
    c, s = ca.cos(p * t), ca.sin(p * t)
    one = 3 + ca.sin(2 * p * t) - 2 * c * s
    rows = [one, 20 / one, c / one * one - c, c, one + 1e-9 * s, 1 + ca.exp(-((t - 5) / 1e-6)**2), 1 / one + ca.tanh(t - 5)]
    assert constant_rows(ca.Function("f", [t, p], [ca.vertcat(*rows)]), np.array([0.8]), 0.0, 1e4).tolist() == \
        [True, True, True, False, False, False, False]
    pushed = hb.assemble(hb.loads("""
model: pushed
parameters: {w: 1.7 rad/s}
components: {push: {is: ForceSource, u: "=5 N/(3 + sin(2*w*time) - 2*sin(w*time)*cos(w*time))"}, load: {is: Mass, m: 1 kg}}
nodes: {load: [push.a, load.a]}
simulate: {until: 50 s}
"""))
    stops = Forcing(pushed).stops(np.linspace(0, 50, 5001), pushed.p)
    assert stops.longest == 0 and not len(stops.times) and not stops.unknown


def test_what_is_at_rest_or_driven_by_states_has_no_limit() -> None:
    free = hb.assemble(hb.loads("""
model: free
components: {wall: {is: Fixed}, spring: {is: Spring, c: 1 kN/m}, load: {is: Mass, m: 1 kg}}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 1 mm}
simulate: {until: 1 s}
"""))
    assert Forcing(free).longest_step(np.linspace(0, 1, 101), free.p) == 0.0


# a car at constant speed meets a bump of 50 mm and 0.4 m after 30 km; the same profile as a function of its position
ROAD = """
model: road
parameters: {{speed: 20 m/s, place: 30 km}}
components:
  pull:  {{is: {source}}}
  road:  {{is: ForceSource, u: "{force}"}}
  tyre:  {{is: SpringDamper, c: 10 kN/m, d: 2 kN*s/m}}
  wheel: {{is: Mass, m: 100 kg}}
  ground: {{is: Fixed}}
nodes: {{car: [pull.a], ground: [ground.a, tyre.a], wheel: [tyre.b, wheel.a, road.a]}}
initial: {{wheel.x: 0 m, wheel.v: 0 m/s, car.x: {begin}}}
show: {{lift: {{is: wheel.x, unit: mm}}}}
simulate: {{until: 3600 s, every: 3.6 s}}
"""
POSITION = "10 kN*exp(-((({position}) - place)/(0.4 m))**2)"
CORNERS = "max(0 N, 10 kN*(1 - abs(({position}) - place)/(0.4 m)))"


@pytest.mark.parametrize("formula", [POSITION, CORNERS])
@pytest.mark.parametrize(("source", "begin", "course"), [
    ("VelocitySource, u: =speed", "0 m", "speed*time"),
    ("VelocitySource, u: =speed", "-2 km", "speed*time - 2 km"),
    ("AccelerationSource, u: 0.03 m/s**2", "1 km", "1 km + 0.015 m/s**2*time**2")])
def test_a_bump_at_a_place_is_met_at_constant_speed_and_acceleration(formula: str, source: str, begin: str, course: str
                                                                      ) -> None:
    def largest(position: str) -> float:
        text = ROAD.format(source=source, begin=begin, force="=" + formula.format(position=position))
        if source.startswith("Acc"):
            text = text.replace("wheel.v: 0 m/s, ", "wheel.v: 0 m/s, car.v: 0 m/s, ")
        found = hb.simulate(hb.loads(text), rtol=1e-9)
        assert found.verdict.status == "clean", found.verdict.text
        return float(found.dense["wheel.x"].max())

    by_time = largest(course)
    assert by_time > 1e-3
    assert largest("car.x") == pytest.approx(by_time, rel=1e-3)  # the extremes are those of steps


@pytest.mark.long
def test_a_fit_follows_a_pulse_whose_time_is_free(tmp_path: Path) -> None:
    """A pulse of 1 s in an hour, recorded every 20 s: its time differs from that of the diagram by 67 s."""
    for formula in ("1 kN*exp(-((time - t_0)/(0.3 s))**2)", "max(0 N, 1 kN*(1 - abs(time - t_0)/(0.5 s)))"):
        text = """
model: pulse
parameters: {{t_0: {t_0} s}}
components:
  push:   {{is: ForceSource, u: "={formula}"}}
  spring: {{is: SpringDamper, c: 10 N/m, d: 2 N*s/m}}
  load:   {{is: Mass, m: 100 kg}}
  ground: {{is: Fixed}}
nodes: {{ground: [ground.a, spring.a], load: [spring.b, load.a, push.a]}}
initial: {{load.x: 0 m, load.v: 0 m/s}}
simulate: {{until: 3600 s, every: 20 s}}
"""
        measured = hb.simulate(hb.loads(text.format(t_0=1733.3, formula=formula)))
        (tmp_path / "m.yaml").write_text(text.format(t_0=1800, formula=formula))
        rows = "\n".join(f"{t!r},{x!r}" for t, x in zip(measured.time.tolist(), measured["load.x"].tolist(), strict=True))
        (tmp_path / "r.csv").write_text("t,x\n" + rows)
        (tmp_path / "e.yaml").write_text("""
experiment: pulse
model: m.yaml
records: {a: {file: r.csv, use: fit}}
time: {column: t, unit: s}
outputs: {load.x: {column: x, unit: m, noise: 0.1 mm}}
free: {t_0: 1690 .. 1850 s}
""")
        found = hb.fit(tmp_path / "e.yaml")
        assert found.values["t_0"] == pytest.approx(1733.3, abs=0.01)
        assert found.chi2 < 1e-2
