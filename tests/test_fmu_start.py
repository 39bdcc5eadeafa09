"""The start of an FMU after a parameter or an input was set before the initialisation: that of a run with this value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from collected import partly
from fmpy.validation import validate_fmu
from test_export import compiled

import heavebond as hb
from heavebond.exchange.fmu_export import export_fmu
from heavebond.language.model import loads

pytestmark = compiled

HANGING = """
model: hanging
components:
  w: {is: Fixed}
  s: {is: SpringDamper, c: 1 kN/m, d: 5 N*s/m}
  m: {is: Mass, m: 10 kg}
  g: {is: Weight, m: =m.m, g: 9.81 m/s**2}
nodes: {w: [w.a, s.a], m: [s.b, m.a, g.a]}
initial: {start: steady}
show: {x: {is: m.x, unit: mm}, rate: {is: m.v, unit: m/s}}
simulate: {until: 2 s, every: 10 ms}
"""
# turbulent orifices, dp = dp_r (q/q_r)**2 each; their common pressure is an algebraic unknown
ORIFICES = """
model: orifices
components:
  pump:   {is: FlowSource, u: 12 L/min}
  oil:    {is: Volume, V: 2 L, beta: 1.5 GPa}
  first:  {is: Orifice, q_r: 20 L/min, dp_r: 10 bar}
  second: {is: Orifice, q_r: 10 L/min, dp_r: 10 bar}
  tank:   {is: Tank}
nodes:
  inlet:  [pump.a, oil.a, first.a]
  middle: [first.b, second.a]
  back:   [second.b, tank.a]
initial: {start: steady}
show: {inlet: {is: inlet.p, unit: bar}, middle: {is: middle.p, unit: bar}}
simulate: {until: 50 ms, every: 1 ms}
"""
# a pendulum that a torque holds at phi: m g l sin(phi) = M
HELD_UP = """
model: held_up
components:
  wall: {is: FixedShaft}
  arm:  {is: ArmWeight, m: 1 kg, l: 0.5 m, g: 9.81 m/s**2}
  rot:  {is: Inertia, J: 0.3 kg*m**2}
  damp: {is: RotationalDamper, d: 0.5 N*m*s/rad}
  push: {is: TorqueSource, u: 1 N*m}
nodes:
  wall:  [wall.a, damp.a]
  shaft: [damp.b, arm.a, rot.a, push.a]
initial: {start: steady}
show: {phi: {is: shaft.phi, unit: rad}}
simulate: {until: 1 s, every: 10 ms}
"""


def simulated(folder: Path, diagram: str, values: dict[str, float], stop: float, kind: str = "CoSimulation",
              version: int = 3, inputs: tuple[str, ...] = ()) -> Any:
    export_fmu(loads(diagram), folder / "m.fmu", inputs, version)
    assert validate_fmu(str(folder / "m.fmu")) == []
    return fmpy.simulate_fmu(str(folder / "m.fmu"), fmi_type=kind, stop_time=stop, output_interval=stop / 50,
                              start_values=values)


@pytest.mark.parametrize("version", partly([2, 3], 2))
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_steady_start_of_an_fmu_follows_a_parameter_that_was_set_before(kind: str, version: int, tmp_path: Path) -> None:
    found = simulated(tmp_path, HANGING, {"m.m": 20.0}, 2.0, kind, version)
    # m g / c = 20 * 9.81 / 1000; the run rests within the tolerance of the solver
    assert found["x"] == pytest.approx(-196.2, rel=1e-7)


def test_a_steady_start_of_an_fmu_solves_its_algebraic_loops_anew(tmp_path: Path) -> None:
    found = simulated(tmp_path, ORIFICES, {"second.q_r": 20e-3 / 60}, 0.05)
    # 12 L/min through two equal orifices of 20 L/min at 10 bar: 3.6 bar each; laminar flow near 0 is rounded by 1e-3
    expected = hb.simulate(loads(ORIFICES), parameters={"second.q_r": 20e-3 / 60})
    assert found["middle"] == pytest.approx(3.6, rel=2e-3)
    assert found["inlet"] == pytest.approx(expected.display["inlet"][0], rel=1e-7)
    assert found["middle"] == pytest.approx(expected.display["middle"][0], rel=1e-7)


def test_a_steady_start_of_an_fmu_stays_on_its_branch_of_several(tmp_path: Path) -> None:
    """From 12 deg to 78 deg of a pendulum that rests at phi and at pi - phi: a full step of Newton's method goes beyond."""
    found = simulated(tmp_path, HELD_UP, {"arm.m": 1 / (0.98 * 9.81 * 0.5)}, 1.0)
    assert found["phi"] == pytest.approx(np.arcsin(0.98), rel=1e-6)


def test_a_start_that_is_a_formula_of_a_parameter_follows_it(tmp_path: Path) -> None:
    diagram = HANGING.replace("{start: steady}", '{m.x: "=-2*m.m*1 m/1000 kg", m.v: 0 m/s}')
    found = simulated(tmp_path, diagram, {"m.m": 30.0}, 0.1)
    assert found["x"][0] == pytest.approx(-60.0, rel=1e-12)


def test_a_parameter_under_solve_follows_in_an_fmu(tmp_path: Path) -> None:
    """The free length that holds the mass at 0: l0 = m g / c = 294.3 mm upwards."""
    diagram = HANGING.replace("{start: steady}", "{start: steady, m.x: 0 mm, solve: [s.l0]}")
    found = simulated(tmp_path, diagram, {"m.m": 30.0}, 2.0)
    assert found["x"] == pytest.approx(0.0, abs=1e-6)  # mm


def test_a_steady_start_of_an_fmu_follows_an_input(tmp_path: Path) -> None:
    diagram = HANGING.replace("  g: {", "  push: {is: ForceSource, u: 0 N}\n  g: {").replace("g.a]", "g.a, push.a]")
    found = simulated(tmp_path, diagram, {"push.u": 49.05, "m.m": 20.0}, 2.0, inputs=("push.u",))
    assert found["x"] == pytest.approx(-147.15, rel=1e-7)  # (49.05 - 196.2) N / (1 kN/m)


def test_a_steady_start_that_does_not_exist_is_an_error_of_the_initialisation(tmp_path: Path) -> None:
    with pytest.raises(Exception, match=r"(?i)initiali[sz]ation"):
        simulated(tmp_path, HELD_UP, {"arm.m": 1 / (1.02 * 9.81 * 0.5)}, 1.0)


def test_a_state_that_is_set_before_the_initialisation_is_kept(tmp_path: Path) -> None:
    found = simulated(tmp_path, HANGING, {"m.m": 20.0, "m.x": -0.1}, 0.1)
    assert found["x"][0] == -100.0


@pytest.mark.parametrize("version", [2, 3])
def test_filters_start_at_a_state_that_is_set_before_the_initialisation(version: int, tmp_path: Path) -> None:
    """A body between 310 K, in place of 300 K, and 350 K: a filtered derivative of its temperature starts at 0, not at
    10 K/s, and a lag at 310 K."""
    export_fmu(loads("""
model: sensors
components:
  a: {is: Ambient, T_0: 350 K}
  r: {is: ThermalResistance, R: 1 K/W}
  h: {is: HeatCapacity, m: 1 kg, c: 100 J/(kg*K)}
  s: {is: TemperatureSensor}
  d: {is: FilteredDerivative, T_f: 1 s}
  l: {is: FirstOrderLag, T_1: 10 s}
nodes: {a: [a.a, r.a], h: [r.b, h.a, s.a], y: [s.y, d.u, l.u]}
initial: {h.T: 300 K}
show: {d: {is: d.y, unit: K/s}, l: {is: l.y, unit: K}, T: {is: h.T, unit: K}}
simulate: {until: 10 s, every: 1 s}
"""), tmp_path / "m.fmu", version=version)
    found = fmpy.simulate_fmu(str(tmp_path / "m.fmu"), fmi_type="CoSimulation", stop_time=10.0, output_interval=1.0,
                              start_values={"h.T": 310.0}, output=["d", "l", "T"])
    t = found["time"]
    assert (found["T"][0], found["l"][0]) == pytest.approx((310, 310), rel=1e-12)
    assert found["d"] == pytest.approx(40 * (np.exp(-t / 100) - np.exp(-t)) / 99, abs=1e-6)
