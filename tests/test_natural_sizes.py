"""Search ranges that follow the size of the machine: effects of small and slow machines are found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.units import unit
from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.search.natural_sizes import Sizes, natural_range, with_natural_ranges
from heavebond.diagnosis.search.scoring import points_within
from heavebond.diagnosis.search.step import fitted_base, make_stage
from heavebond.estimation.experiment import load_experiment

ROBOT = """model: robot
components:
  motor: {is: TorqueSource, u: 0 N*m}
  rotor: {is: Inertia, J: 4e-4 kg*m**2}
  arm:   {is: Inertia, J: 6e-4 kg*m**2}
  oil:   {is: RotationalDamper, d: 2e-3 N*m*s/rad}
  frame: {is: FixedShaft}
nodes:
  shaft:  [motor.a, rotor.a, oil.b, arm.a]
  ground: [frame.a, oil.a]
initial: {shaft.w: 0 rad/s}
"""
ELASTIC = ROBOT.replace("  frame:", "  ruler: {is: TorsionSpring, c: 0.5 N*m/rad}\n  frame:").replace(
    "oil.b, arm.a]", "oil.b, ruler.a]\n  tip: [arm.a, ruler.b]").replace("initial: {", "initial: {tip.w: 0 rad/s, ")
EXPERIMENT = """experiment: robot
model: robot.yaml
records:
  a: {file: a.csv, use: fit}
  b: {file: b.csv, use: validate}
time: {column: t, unit: s}
inputs:
  motor.u: {column: u, unit: N*m, interpolation: linear}
outputs:
  w: {is: shaft.w, column: w, unit: rad/s, noise: 0.02 rad/s}
free:
  oil.d: 2e-3 N*m*s/rad +- 30 %
"""


def recorded(folder: Path) -> Path:
    """Records of a robot whose arm is a ruler, and its diagram with a rigid arm."""
    time = np.arange(0, 4, 0.004)
    for name, seed in (("a", 1), ("b", 2)):
        draw = np.random.default_rng(seed)
        phases = 2 * np.pi * np.multiply.outer(time, draw.uniform(0.3, 8, 8)) + draw.uniform(0, 6, 8)
        torque = 0.02 * np.sin(phases).sum(axis=1)
        np.savetxt(folder / "u.csv", np.column_stack([time, torque]), "%.12g", ",", header="time,u", comments="")
        driven = "set: {motor.u: {file: u.csv, column: u, unit: N*m, interpolation: linear}}\n"
        (folder / "elastic.yaml").write_text(ELASTIC + driven)
        run = hb.simulate(folder / "elastic.yaml", until=time[-1], every=0.004)
        speed = np.asarray(run["shaft.w"]) + 0.02 * draw.standard_normal(len(run.time))
        np.savetxt(folder / f"{name}.csv", np.column_stack([time, torque, speed]), "%.12g", ",", header="t,u,w", comments="")
    (folder / "robot.yaml").write_text(ROBOT)
    (folder / "robot_records.yaml").write_text(EXPERIMENT)
    return folder / "robot_records.yaml"


@pytest.mark.long
def test_the_compliance_of_a_small_robot_is_found(tmp_path: Path) -> None:
    """Its stiffness of 0.5 N*m/rad is far below the range of the component file, which is made for drive shafts."""
    stage = make_stage(load_experiment(recorded(tmp_path)), number=1, classes=("series compliance", "dry friction", "lag"))
    assert stage.chosen is not None and stage.chosen.candidate.kind == "series compliance"
    (stiffness,) = [value for name, value in stage.chosen.values.items() if name.endswith(".c")]
    assert stiffness == pytest.approx(0.5, rel=0.02)  # the noise determines it to 0.5 %


def test_the_ranges_follow_the_machine_and_keep_those_of_the_component(tmp_path: Path) -> None:
    experiment = load_experiment(recorded(tmp_path))
    base = fitted_base(experiment)
    ranges = {(c.component, n.name.rpartition(".")[2]): n.sought.range
              for c in with_natural_ranges(base, candidates(experiment))
              for n in c.numbers if n.sought is not None and n.sought.range is not None}
    assert ranges["ShaftCompliance", "c"].low < 0.1 and ranges["ShaftCompliance", "c"].high == 1e8
    shaft = next(c for c in with_natural_ranges(base, candidates(experiment)) if c.component == "ShaftCompliance")
    number = next(n for n in shaft.numbers if n.name.endswith("T_d"))
    # the damping time of a shaft, from half of the sample interval to the end of the range; refits keep the whole range
    assert number.sought is not None and number.sought.scored is not None and number.sought.range is not None
    assert (number.sought.scored.low, number.sought.scored.high) == pytest.approx((0.002, 0.03))
    assert all(0.002 < point[number.name] < 0.03 for point in points_within(shaft, {}))
    # one whose whole range is below the sample interval is extended first: scored at times that the records distinguish
    small = replace(number.sought.range, low=1e-5, high=1e-4)
    faster = replace(number, sought=replace(number.sought, range=small, scored=None))
    (extended,) = with_natural_ranges(base, [replace(shaft, numbers=(faster,))])[0].numbers
    assert extended.sought is not None and extended.sought.range is not None and extended.sought.scored is not None
    assert (extended.sought.range.low, extended.sought.range.high) == pytest.approx((1e-5, 0.3996))
    assert (extended.sought.scored.low, extended.sought.scored.high) == pytest.approx((0.002, 0.3996))
    assert ranges["ShaftCompliance", "T_d"].low == pytest.approx(0.0003)
    assert ranges["Delay", "T"].low == pytest.approx(0.002) and ranges["Delay", "T"].high == 20
    assert ranges["RotationalLuGreFriction", "r"] == next(
        n.sought.range for c in candidates(experiment) for n in c.numbers
        if n.name == "rotational_lu_gre_friction.r" and n.sought is not None)


@pytest.mark.parametrize(("text", "expected"), [
    ("N/m", (0.01 * 30 / 0.2, 100 * 30 / 0.2)), ("m/N", (0.01 * 0.2 / 30, 100 * 0.2 / 30)),
    ("N*s/m", (0.01 * 30 / 5, 100 * 30 / 5)), ("kg", (0.02 * 30 / 5, 40 * 30 / 5)), ("m", (0.002, 0.002)), ("s", (0.01, 4)),
    ("1", None), ("Pa", None)])
def test_the_natural_range_has_the_dimension_of_the_number(text: str, expected: tuple[float, float] | None) -> None:
    """A force of 30 N, a speed of 5 m/s and a displacement of 0.2 m, in a record of 40 s at 50 Hz."""
    at_place = Sizes(5, 0.2, 30, *(unit(t).dimension for t in ("m/s", "m", "N")))
    found = natural_range(unit(text).dimension, [at_place], 0.02, 40)
    assert found == (None if expected is None else pytest.approx(expected))
