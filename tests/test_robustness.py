"""What is said of the surroundings of a tuned point, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import heavebond as hb
from heavebond.optimise.objective import Case, Objective, TuningProblem, ranges
from heavebond.optimise.robustness import Robustness, robustness, uncertainties
from heavebond.optimise.tuning import Tuned, tune

# m x'' + d x' + k y = F(t), T y' = x - y: unstable from k = d (1/T + d/m) on (Hurwitz).
SERVO = """
model: servo
parameters: {gain: -2 kN/m}
components:
  wall:   {is: Fixed}
  damper: {is: Damper, d: 100 N*s/m}
  cart:   {is: Mass, m: 10 kg}
  encoder: {is: PositionSensor}
  lag:    {is: FirstOrderLag, T_1: 20 ms}
  feedback: {is: Gain, k: =gain}
  motor:  {is: ForceSource}
  shaker: {is: ForceSource, u: "=20 N*sin(6 rad/s * time)"}
nodes:
  ground: [wall.a, damper.a]
  load:   [damper.b, cart.a, motor.a, shaker.a, encoder.a]
  place:  [encoder.y, lag.u]
  late:   [lag.y, feedback.u]
  wish:   [feedback.y, motor.u]
initial: {load.x: 0 m, load.v: 0 m/s, lag.y: 0 m}
simulate: {until: 20 s, every: 0.1 s}
"""
VALLEY = """
model: valley
components:
  wall:   {is: Fixed}
  damper: {is: Damper, d: 40 N*s/m}
  spring: {is: Spring, c: 1 kN/m}
  cart:   {is: Mass, m: 10 kg}
  shaker: {is: ForceSource, u: "=20 N*sin(10 rad/s * time)"}
nodes:
  ground: [wall.a, damper.a, spring.a]
  load:   [damper.b, cart.a, shaker.a, spring.b]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 20 s, every: 0.1 s}
"""


@pytest.fixture(scope="module")
def valley() -> tuple[Objective, Tuned, Robustness]:
    """Two numbers of the machine alone have their least cost at d = 60 N s/m and c = 1.5 kN/m: 2 there."""
    task = TuningProblem(ranges({"damper.d": "10 .. 200 N*s/m", "spring.c": "0.5 .. 3 kN/m"}),
                         "2 + (damper.d/60 N*1 m/1 s - 1)**2 + 4*(spring.c/1.5 kN*1 m - 1)**2 + 0*rms(load.x)/1 m",
                         ("rms(load.x) < 1 m",), 10.0, 20.0, cases=(Case("calm", {}), Case("rough", {"cart.m": "12 kg"})),
                         uncertain={"cart.m": "20 %", "damper.d": "6 N*s/m"})
    objective = Objective(hb.assemble(hb.loads(VALLEY)), task)
    result = tune(objective, task)
    return objective, result, robustness(objective, result)


def test_the_ellipse_has_its_closed_form(valley: tuple[Objective, Tuned, Robustness]) -> None:
    """1 % of 2: (d/60 - 1)**2 = 0.02, 4 (c/1500 - 1)**2 = 0.02."""
    _, result, found = valley
    assert result.cost == pytest.approx(2, rel=1e-6)
    assert found.ellipse is not None
    assert found.ellipse.widths["damper.d"] == pytest.approx(60 * np.sqrt(0.02), rel=1e-2)
    assert found.ellipse.widths["spring.c"] == pytest.approx(1500 * np.sqrt(0.02 / 4), rel=1e-2)


def test_changes_are_runs_at_other_values(valley: tuple[Objective, Tuned, Robustness]) -> None:
    """A tenth of what is free, unless it is said how uncertain it is; 20 % of the mass, which the cost does not know."""
    _, result, found = valley
    changes = {(c.name, round(c.share, 3)): c for c in found.changes}
    assert len(changes) == 6
    assert changes["spring.c", 0.1].cost == pytest.approx(2.04, rel=1e-3)
    stiffer = [c for c in found.changes if c.name == "damper.d"]
    assert [round(abs(c.value - result.values["damper.d"]), 6) for c in stiffer] == [6, 6]
    assert changes["cart.m", 0.2].cost == pytest.approx(2, rel=1e-6)
    assert changes["cart.m", 0.2].value == pytest.approx(12)
    assert not changes["cart.m", 0.2].exceeded


def test_the_worst_case_is_named(valley: tuple[Objective, Tuned, Robustness]) -> None:
    assert valley[2].worst[0] in ("calm", "rough")
    assert valley[2].worst[1] == pytest.approx(2, rel=1e-6)


def test_margins_are_those_of_hurwitz() -> None:
    """The gain from which on the lag makes the loop unstable, as a factor on the tuned one; the mass is divided."""
    assembly = hb.assemble(hb.loads(SERVO))
    task = TuningProblem(ranges({"gain": "-4 .. -1 kN/m"}), "rms(load.x)/1 mm - gain/1 kN*1 m", (), 10.0, 20.0)
    objective = Objective(assembly, task)
    result = tune(objective, task)
    found = robustness(objective, result)
    margin, = found.margins
    limit = 100 * (1 / 0.02 + 100 / 10)
    assert margin.up == pytest.approx(-limit / result.values["gain"], rel=1e-3)
    assert margin.down is None
    assert found.damping > 0


def test_wrong_uncertainties_are_refused(valley: tuple[Objective, Tuned, Robustness]) -> None:
    objective = valley[0]
    for uncertain, words in (({"cart.mass": "20 %"}, "Did you mean 'cart.m'"), ({"cart.m": "2 N"}, "uncertainty of cart.m")):
        task = TuningProblem(objective.task.free, objective.task.cost, uncertain=uncertain)
        with pytest.raises(hb.UsageError, match=words):
            uncertainties(Objective(objective.assembly, task))
