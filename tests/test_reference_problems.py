"""Problems with a known answer, each with its energy: what the assembler and the integrator together must get right.

The integrator keeps the error of a step to rtol = 1e-8 of each state and to 1e-10 of its usual size; over the some
thousand steps of these runs that adds up to 1e-7 of an amplitude. Any tolerance but SMALL has its reason beside it.
"""

from __future__ import annotations

import random
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ellipk

import heavebond as hb
from heavebond.energy_audit.audit import EnergyAudit
from heavebond.energy_audit.audit import energy as audit
from heavebond.language.definition import Body

SMALL = 1e-6
G = 9.81
Array = NDArray[np.float64]


def closed(model: hb.Model | hb.Assembly, until: float | None = None, every: float | None = None,
           tolerance: float = SMALL) -> EnergyAudit:
    """The audit of a run, which must close to the tolerance times the largest energy."""
    return audit(model, until, every=every).raise_if_open(tolerance)


def assert_near(found: Array, wanted: Array | float, tolerance: float = SMALL) -> None:
    """Agree to `tolerance` of the largest value wanted."""
    np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * float(np.abs(wanted).max()))


OSCILLATOR = """
model: oscillator
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 50 N/m}
  damper: {is: Damper, d: 1.2 N*s/m}
  mass:   {is: Mass, m: 2 kg}
nodes:
  wall: [wall.a, spring.a, damper.a]
  load: [spring.b, damper.b, mass.a]
initial: {load.x: 100 mm, load.v: 0 m/s}
simulate: {until: 20 s, every: 10 ms}
"""


def oscillation(t: Array) -> Array:
    """x(t) of the oscillator: undamped 5 rad/s, damping ratio d/(2 m w) = 0.06."""
    decay, w = 0.3, np.sqrt(25 - 0.3**2)
    return np.asarray(0.1 * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t)))


def test_damped_oscillator() -> None:
    model = hb.loads(OSCILLATOR)
    result = hb.simulate(model)
    assert_near(result["load.x"], oscillation(result.time))
    energy = closed(model)
    assert energy.dissipated + energy.stored == pytest.approx(0, abs=SMALL * energy.largest)
    damper = next(line for line in energy.lines if line.component == "damper")
    left = 0.5 * 50 * result["load.x"][-1] ** 2 + 0.5 * 2 * result["load.v"][-1] ** 2
    assert damper.dissipated == pytest.approx(0.5 * 50 * 0.1**2 - left, rel=1e-5)


def test_the_error_falls_with_the_tolerance() -> None:
    assembly = hb.assemble(hb.loads(OSCILLATOR))
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        result = hb.simulate(assembly, rtol=rtol, atol=rtol / 100)
        errors.append(float(np.abs(result["load.x"] - oscillation(result.time)).max()) / 0.1)
    assert all(fine < coarse / 5 for coarse, fine in pairwise(errors)), errors
    # a method of variable order keeps the global error within some thousand times the tolerance
    assert all(error < 1e4 * rtol for error, rtol in zip(errors, (1e-4, 1e-6, 1e-8, 1e-10), strict=True)), errors


PENDULUM = """\
component: Pendulum
summary: A point mass on a massless rod, in Cartesian coordinates.
parameters:
  m: {unit: kg, min: 0, doc: mass}
  L: {unit: m, min: 0, doc: length}
  g: {unit: m/s**2, default: 9.81 m/s**2, doc: acceleration of gravity}
variables:
  x:   {unit: m, doc: place sideways}
  y:   {unit: m, doc: place upwards}
  v_x: {unit: m/s, doc: velocity sideways}
  v_y: {unit: m/s, doc: velocity upwards}
  k:   {unit: N/m, doc: tension over length}
equations: |
  v_x = der(x)                    # velocity sideways
  v_y = der(y)                    # velocity upwards
  m * der(v_x) = -k * x           # momentum sideways
  m * der(v_y) = -k * y - m * g   # momentum upwards
  x**2 + y**2 = L**2              # the rod keeps its length
stores: 1/2 * m * (v_x**2 + v_y**2) + m * g * y
"""


def test_pendulum_of_index_3_for_a_hundred_swings(tmp_path: Path) -> None:
    (tmp_path / "pendulum.yaml").write_text(PENDULUM)
    length, amplitude = 1.3, 0.5
    x, y = length * np.sin(amplitude), -length * np.cos(amplitude)
    model = hb.loads(f"""
model: pendulum
components:
  bob: {{is: Pendulum, m: 0.7 kg, L: {length} m}}
initial: {{bob.x: {x:.17g} m, bob.y: ~ {y:.17g} m, bob.v_x: 0 m/s}}
""", tmp_path)
    assembly = hb.assemble(model)
    assert assembly.reduced.index == 3
    period = 4 * np.sqrt(length / G) * ellipk(np.sin(amplitude / 2) ** 2)
    result = hb.simulate(assembly, 100.25 * period, every=period / 4)
    assert np.abs(np.hypot(result["bob.x"], result["bob.y"]) - length).max() < 1e-6 * length
    # a quarter period after the hundredth swing the bob passes the lowest point; late by x/v of the run
    assert abs(result["bob.x"][-1] / result["bob.v_x"][-1]) < 1e-6 * 100 * period
    closed(assembly, 100 * period, period / 4)


# -- rigid joints ------------------------------------------------------------------------------------------------------
JOINED = """
model: joined
components:
  push: {{is: ConstantForce, F: 6 N}}
  m_1:  {{is: Mass, m: 1 kg}}
  m_2:  {{is: Mass, m: 2 kg}}
  {part}
nodes:
  {nodes}
initial: {{one.x: 0 m, one.v: 0 m/s}}
simulate: {{until: 2 s, every: 10 ms}}
"""
LEVER = """\
component: StiffLever
summary: A rigid lever whose arm b moves k times as far as its arm a.
ports: {a: translational, b: translational}
parameters:
  k: {unit: 1, doc: ratio of the arms}
variables:
  F: {unit: N, doc: force on b}
equations: |
  b.x = k * a.x   # ratio of the arms
  b.f = F         # force on b
  a.f = -k * F    # the moments balance
"""


@pytest.mark.parametrize(("part", "nodes", "ratio"), [
    ("", "one: [push.a, m_1.a, m_2.a]", 1),
    ("cell: {is: ForceSensor}", "{one: [push.a, m_1.a, cell.a], two: [cell.b, m_2.a], reading: [cell.y]}", 1),
    ("lever: {is: StiffLever, k: 3}", "{one: [push.a, m_1.a, lever.a], two: [lever.b, m_2.a]}", 3),
], ids=["on one node", "through a load cell", "through a lever"])
def test_two_masses_joined_rigidly(tmp_path: Path, part: str, nodes: str, ratio: int) -> None:
    (tmp_path / "lever.yaml").write_text(LEVER)
    text = JOINED.format(part=part, nodes=nodes).replace("nodes:\n  {", "nodes: {")
    model = hb.loads(text, tmp_path)
    result = hb.simulate(model)
    acceleration = 6 / (1 + 2 * ratio**2)
    assert_near(result["one.v"], acceleration * result.time)
    assert_near(result["one.x"], acceleration * result.time**2 / 2)
    assert_near(result["m_2.a.f"], np.full(len(result.time), 2 * ratio * acceleration))
    if "cell" in part:
        assert_near(result["cell.y"], np.full(len(result.time), -2 * acceleration))  # it is pushed
    energy = closed(model)
    assert energy.supplied == pytest.approx(6 * acceleration * 2**2 / 2)


@pytest.mark.parametrize(("part", "nodes"), [
    ("", "{one: [pump.a, v_1.a, v_2.a]}"),
    ("meter: {is: FlowSensor}", "{one: [pump.a, v_1.a, meter.a], two: [meter.b, v_2.a], reading: [meter.y]}"),
], ids=["on one node", "through a flow sensor"])
def test_two_volumes_joined_without_resistance(part: str, nodes: str) -> None:
    model = hb.loads(f"""
model: volumes
components:
  pump: {{is: FlowSource, u: 0.6 L/min}}
  v_1:  {{is: Volume, V: 1 L, beta: 1e9 Pa}}
  v_2:  {{is: Volume, V: 3 L, beta: 1e9 Pa}}
  {part}
nodes: {nodes}
initial: {{one.p: 10 bar}}
simulate: {{until: 2 s, every: 10 ms}}
""")
    result = hb.simulate(model)
    assert_near(result["one.p"], 10e5 + 1e-5 * 1e9 / 4e-3 * result.time)
    if part:
        assert_near(result["meter.y"], np.full(len(result.time), 0.75e-5))  # three quarters go on
    closed(model)


def test_prescribed_position_drives_a_mass() -> None:
    model = hb.loads("""
model: shaker
components:
  shaker: {is: PositionSource, u: "=20 mm*sin(2*pi*time/0.5 s)"}
  table:  {is: Mass, m: 3 kg}
nodes: {table: [shaker.a, table.a]}
simulate: {until: 2 s, every: 1 ms}
""")
    assembly = hb.assemble(model)
    assert assembly.reduced.index == 3
    assert assembly.state_names == []
    result = hb.simulate(assembly)
    w = 4 * np.pi
    assert_near(result["shaker.a.f"], 3 * 0.02 * w**2 * np.sin(w * result.time))
    assert_near(result["table.v"], 0.02 * w * np.cos(w * result.time))
    closed(assembly)


# -- hydraulics --------------------------------------------------------------------------------------------------------
def test_orifices_in_series_without_a_volume_between() -> None:
    # dp_t = 1 Pa: the laminar part changes the square-root law by (dp_t/dp)**2 / 4, far below SMALL
    model = hb.loads("""
model: orifices
components:
  pump:   {is: PressureSource, p_0: 100 bar}
  first:  {is: Orifice, q_r: 10 L/min, dp_r: 10 bar, dp_t: 1 Pa}
  second: {is: Orifice, q_r: 20 L/min, dp_r: 10 bar, dp_t: 1 Pa}
  tank:   {is: Tank}
nodes:
  supply:  [pump.a, first.a]
  between: [first.b, second.a]
  return:  [second.b, tank.a]
simulate: {until: 1 s, every: 10 ms}
""")
    result = hb.simulate(model)
    # q = K_1 sqrt(p_0 - p) = K_2 sqrt(p)
    between = 100e5 * 10**2 / (10**2 + 20**2)
    assert_near(result["between.p"], np.full(len(result.time), between))
    assert_near(result["second.q"], np.full(len(result.time), 20e-3 / 60 * np.sqrt(between / 10e5)))
    closed(model)


def test_algebraic_unknowns_are_exact_at_every_output_point() -> None:
    """Where the states hardly change the integrator takes long steps; what it does not integrate must not suffer."""
    model = hb.loads("""
model: divided flow
components:
  pump:   {is: FlowSource, u: "=10 L/min*(1.5 + sin(2*pi*time/0.3 s))"}
  aside:  {is: Orifice, q_r: 10 L/min, dp_r: 10 bar, dp_t: 1 Pa}
  first:  {is: Orifice, q_r: 10 L/min, dp_r: 10 bar, dp_t: 1 Pa}
  second: {is: Orifice, q_r: 20 L/min, dp_r: 10 bar, dp_t: 1 Pa}
  tank:   {is: Tank}
  mass:   {is: Mass, m: 1 kg}
nodes:
  supply:  [pump.a, aside.a, first.a]
  between: [first.b, second.a]
  return:  [aside.b, second.b, tank.a]
  load:    [mass.a]
initial: {load.v: 1 m/s}
simulate: {until: 1 s, every: 10 ms}
""")
    result = hb.simulate(model)
    inflow = 10e-3 / 60 * (1.5 + np.sin(2 * np.pi * result.time / 0.3))
    # the two in series pass 1/sqrt(1/10**2 + 1/20**2) times what 1 L/min at 10 bar would
    aside, series = 10.0, 1 / np.sqrt(1 / 10**2 + 1 / 20**2)
    assert_near(result["aside.q"], inflow * aside / (aside + series))
    closed(model)


def test_blocked_cylinder_is_a_spring_of_oil() -> None:
    """Stiffness 2 beta A**2 / V with both ports plugged. The stroke of 0.4 mm changes V by 8e-4, the frequency by the
    square of that."""
    model = hb.loads("""
model: blocked
components:
  frame:    {is: Fixed}
  cylinder: {is: Cylinder, A_A: 80 cm**2, A_B: 80 cm**2, V_A0: 4 L, V_B0: 4 L, beta: 1e9 Pa}
  plug_A:   {is: Cap}
  plug_B:   {is: Cap}
  load:     {is: Mass, m: 500 kg}
nodes:
  frame: [frame.a, cylinder.a]
  load:  [cylinder.b, load.a]
  A:     [cylinder.A, plug_A.a]
  B:     [cylinder.B, plug_B.a]
initial: {load.x: 0 m, load.v: 0.1 m/s, A.p: 100 bar, B.p: 100 bar}
simulate: {until: 0.5 s, every: 1 ms}
""")
    result = hb.simulate(model)
    w = np.sqrt(2 * 1e9 * (80e-4) ** 2 / 4e-3 / 500)
    # 20 periods: a frequency off by (8e-4)**2 shows as a phase of 1e-4 at the end
    assert_near(result["load.x"], 0.1 / w * np.sin(w * result.time), 2e-4)
    energy = closed(model)
    cylinder = next(line for line in energy.lines if line.component == "cylinder")
    assert "storage function" in cylinder.why


# -- gas ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("b_cr", [0.0, 0.5], ids=["never choked", "choked"])
def test_receiver_filling(b_cr: float) -> None:
    """V/(R T) dp/dt = C sqrt(p_s**2 - p**2), an arc of a sine; choked, = C p_s, a straight line up to b_cr p_s."""
    model = hb.loads(f"""
model: filling
components:
  supply:   {{is: PneumaticSource, p_0: 8 bar}}
  inlet:    {{is: PneumaticOrifice, C: 4e-9 kg/(s*Pa), b_cr: {b_cr}, dp_t: 1e-3 Pa}}
  receiver: {{is: Receiver, V: 10 L, T_0: 293.15 K, R: 287.05 J/(kg*K)}}
nodes:
  supply:   [supply.a, inlet.a]
  receiver: [inlet.b, receiver.a]
initial: {{receiver.p: 1 bar}}
simulate: {{until: 10 s, every: 10 ms}}
""")
    result = hb.simulate(model)
    rate = 287.05 * 293.15 / 10e-3 * 4e-9
    wanted = 8e5 * np.sin(rate * result.time + np.arcsin(1 / 8)) if b_cr == 0 else 1e5 + rate * 8e5 * result.time
    assert wanted.max() < (0.5 if b_cr else 0.9) * 8e5
    assert_near(result["receiver.p"], wanted)
    closed(model)


# -- starts ------------------------------------------------------------------------------------------------------------
HANGING = """
model: hanging
components:
  roof:   {{is: Fixed}}
  spring: {{is: Spring, c: 2 kN/m}}
  damper: {{is: Damper, d: 10 N*s/m}}
  mass:   {{is: Mass, m: 50 kg}}
  weight: {{is: Weight, m: 50 kg}}
nodes:
  roof: [roof.a, spring.a, damper.a]
  load: [spring.b, damper.b, mass.a, weight.a]
initial: {{{initial}}}
simulate: {{until: 1 s, every: 10 ms}}
"""


def test_steady_start_of_a_hanging_mass() -> None:
    model = hb.loads(HANGING.format(initial="start: steady"))
    result = hb.simulate(model)
    assert_near(result["load.x"], np.full(len(result.time), -50 * G / 2e3), 1e-9)
    # b hangs below a, so that the spring is in compression by its own sign: F = c (b.x - a.x) holds b up
    assert_near(result["spring.F"], np.full(len(result.time), -50 * G), 1e-9)
    closed(model)


def test_steady_start_solves_for_the_free_length() -> None:
    model = hb.loads(HANGING.format(initial="start: steady, load.x: -1 m, solve: [spring.l0]"))
    result = hb.simulate(model)
    assert_near(result["load.x"], np.full(len(result.time), -1.0), 1e-9)
    line = next(line for line in result.start.table if line.name == "spring.l0")
    # c (b.x - a.x - l0) = -m g
    assert line.used == pytest.approx(-1 + 50 * G / 2e3, rel=1e-9)


def test_start_at_rest_sets_velocities_only() -> None:
    result = hb.simulate(hb.loads(HANGING.format(initial="start: rest, load.x: -1 m")))
    assert result["load.v"][0] == 0
    assert result["load.x"][0] == pytest.approx(-1, rel=1e-12)
    assert result["der(load.v)"][0] == pytest.approx((2e3 * 1 - 50 * G) / 50, rel=1e-9)


# -- unilateral contact ------------------------------------------------------------------------------------------------
# The error control sees less of a step across the kink of a contact; each landing and lift-off costs some 1e-7.
KINK = 1e-5
BALL = """
model: ball
components:
  ground:  {{is: Fixed}}
  contact: {{is: Contact, c: 100 kN/m, d: {damping} N*s/m}}
  ball:    {{is: Mass, m: 1 kg}}
  weight:  {{is: Weight, m: 1 kg}}
nodes:
  ground: [ground.a, contact.a]
  ball:   [contact.b, ball.a, weight.a]
initial: {{ball.x: 0.5 m, ball.v: 0 m/s}}
simulate: {{until: 4 s, every: 1 ms}}
"""


def test_contact_lost_and_regained() -> None:
    """Free flight under g, then half a swing on the spring: from tan(w t/2) = -v w/g."""
    assembly = hb.assemble(hb.loads(BALL.format(damping=0)))
    w, fall = np.sqrt(1e5), np.sqrt(2 * 0.5 / G)
    bounce = 2 * fall + 2 / w * (np.pi - np.arctan(G * fall * w / G))
    result = hb.simulate(assembly, 8 * bounce, every=bounce)
    assert_near(result["ball.x"], np.full(9, 0.5), KINK)
    fine = hb.simulate(assembly, 4 * bounce, every=bounce / 1000)
    assert fine["contact.N"].min() == 0
    assert np.diff((fine["contact.N"] > 0).astype(int)).clip(0).sum() == 4
    flying = fine["contact.N"] == 0
    assert_near(fine["der(ball.v)"][flying], np.full(flying.sum(), -G))
    closed(assembly, tolerance=KINK)


def test_damped_contact_never_pulls_and_comes_to_rest() -> None:
    model = hb.loads(BALL.format(damping=200))
    result = hb.simulate(model)
    assert result["contact.N"].min() >= 0
    assert result["contact.N"][-1] == pytest.approx(G, rel=1e-4)
    closed(model, tolerance=KINK)


# -- measured inputs ---------------------------------------------------------------------------------------------------
STEP = 0.01


def heave(t: Array) -> Array:
    return np.asarray(0.2 * np.sin(np.pi * t))


@pytest.fixture
def records(tmp_path: Path) -> Path:
    time = np.arange(0, 4 + STEP / 2, STEP)
    rows = [f"{t:.2f},{1e3 * z:.15g}" for t, z in zip(time, heave(time), strict=True)]
    (tmp_path / "heave.csv").write_text("\n".join(["time_s,heave_mm", *rows]) + "\n")
    return tmp_path


def shaken(records: Path, source: str, between: str, mass: bool = True) -> hb.Model:
    """A table on a damper, moved or pushed as recorded (heave in mm, or as many N)."""
    unit = "N" if source == "ForceSource" else "mm"
    return hb.loads(f"""
model: shaken
components:
  shaker: {{is: {source}, u: {{file: heave.csv, column: heave_mm, unit: {unit}, interpolation: {between}}}}}
  {"mass: {is: Mass, m: 5 kg}" if mass else ""}
  wall:   {{is: Fixed}}
  damper: {{is: Damper, d: 10 N*s/m}}
nodes:
  table: [{"mass.a, " if mass else ""}shaker.a, damper.b]
  wall:  [wall.a, damper.a]
{"initial: {table.v: 0 m/s}" if source == "ForceSource" else ""}
simulate: {{until: 4 s, every: 1 ms}}
""", records)


def test_spline_through_a_record_drives_a_mass(records: Path) -> None:
    model = shaken(records, "PositionSource", "spline")
    result = hb.simulate(model)
    t, w = result.time, np.pi
    inside = (t > 0.1) & (t < 3.9)
    wanted = 5 * w**2 * heave(t) - 10 * 0.2 * w * np.cos(w * t)  # what acts on the shaker
    # the second derivative of a cubic spline is a chain of straight lines: off by h**2/8 of the fourth derivative,
    # which is w**2 h**2/8 = 1.2e-4 of it; at the ends (not a knot) more
    assert_near(result["shaker.a.f"][inside], wanted[inside], 2e-4)
    closed(model)


def test_a_record_that_must_be_differentiated_twice_is_a_spline(records: Path) -> None:
    for between in ("linear", "hold"):
        with pytest.raises(hb.ModelError, match="differentiated twice") as error:
            hb.assemble(shaken(records, "PositionSource", between))
        assert error.value.problems[0].code == "input-not-smooth"


def test_a_record_that_must_be_differentiated_once_is_not_held(records: Path) -> None:
    with pytest.raises(hb.ModelError, match="differentiated once"):
        hb.assemble(shaken(records, "PositionSource", "hold", mass=False))
    result = hb.simulate(shaken(records, "PositionSource", "linear", mass=False))
    # between two samples the speed is their difference over the step; the output point at the first has that too
    k = np.floor(result.time[:-1] / STEP + 1e-9)
    wanted = (heave((k + 1) * STEP) - heave(k * STEP)) / STEP
    assert_near(result["shaker.a.f"][:-1], -10 * wanted, 1e-9)


@pytest.mark.parametrize("between", ["hold", "linear", "spline"])
def test_forces_from_a_record(records: Path, between: str) -> None:
    """The damped table at the last sample, by the exact response to each kind of piece (force in N as in mm)."""
    model = shaken(records, "ForceSource", between)
    result = hb.simulate(model)
    samples = 1e3 * heave(np.arange(0, 4 + STEP / 2, STEP))
    v, (m, d) = 0.0, (5.0, 10.0)
    decay = np.exp(-d / m * STEP)
    for k in range(len(samples) - 1):
        slope = 0.0 if between == "hold" else (samples[k + 1] - samples[k]) / STEP
        # m v' + d v = F + slope t has the particular solution (F - slope m/d + slope t)/d
        start = (samples[k] - slope * m / d) / d
        v = (v - start) * decay + start + slope * STEP / d
    # the spline is nearer to the sine than its chords: w**2 h**2 / 12 of the force
    assert result["table.v"][-1] == pytest.approx(v, abs=(1e-3 if between == "spline" else 1e-6) * 20)
    closed(model)


# -- the same machine in other words -----------------------------------------------------------------------------------
CHAIN = """
model: chain
components:
  shaker: {is: PositionSource, u: "=100 mm*sin(2*pi*time/2 s)"}
  wire_1: {is: SpringDamper, c: 1 kN/m, d: 20 N*s/m}
  mass_1: {is: Mass, m: 1 kg}
  cell_1: {is: ForceSensor}
  mass_2: {is: Mass, m: 2 kg}
  lever:  {is: StiffLever, k: 2}
  mass_3: {is: Mass, m: 3 kg}
  weight: {is: Weight, m: 3 kg}
  cell_2: {is: ForceSensor}
  wire_2: {is: SpringDamper, c: 2 kN/m, d: 20 N*s/m}
  wall:   {is: Fixed}
nodes:
  base:      [shaker.a, wire_1.a]
  one:       [wire_1.b, mass_1.a, cell_1.a]
  two:       [cell_1.b, mass_2.a, lever.a]
  three:     [lever.b, mass_3.a, cell_2.a, weight.a]
  four:      [cell_2.b, wire_2.b]
  ground:    [wire_2.a, wall.a]
  reading_1: [cell_1.y]
  reading_2: [cell_2.y]
initial: {start: steady}
simulate: {until: 5 s, every: 10 ms}
"""


def shuffled(model: hb.Model, seed: int) -> hb.Model:
    order = random.Random(seed)
    instances, wires = list(model.body.instances.items()), list(model.body.wires.items())
    order.shuffle(instances)
    order.shuffle(wires)
    mixed = {name: replace(wire, ends=tuple(order.sample(wire.ends, len(wire.ends)))) for name, wire in wires}
    return replace(model, body=Body(dict(instances), mixed))


@pytest.mark.parametrize("seed", range(4))
def test_shuffled_declarations_give_the_same_results(tmp_path: Path, seed: int) -> None:
    (tmp_path / "lever.yaml").write_text(LEVER)
    for model, names in ((hb.load("cylinder_rig"), ("load.x", "chamber_a.p", "valve.x")),
                         (hb.loads(CHAIN, tmp_path), ("one.x", "three.v", "cell_1.y", "cell_2.y", "mass_2.a.f"))):
        before, after = (hb.simulate(one, 5, every=0.05) for one in (model, shuffled(model, seed)))
        for name in names:
            assert_near(after[name], before[name])


def test_a_chain_of_rigid_joints_keeps_its_energy(tmp_path: Path) -> None:
    (tmp_path / "lever.yaml").write_text(LEVER)
    assembly = hb.assemble(hb.loads(CHAIN, tmp_path))
    assert len(assembly.state_names) == 2
    closed(assembly)


def test_one_file_gives_the_same_equations_in_every_process() -> None:
    code = ("import heavebond as hb; a = hb.assemble(hb.load('cmc_ahc')); "
            "print(a.state_names, a.algebraic_names, a.ode, a.alg)")
    said = [subprocess.run([sys.executable, "-c", code], env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
                           capture_output=True, text=True, check=True).stdout for seed in ("1", "2")]
    assert said[0] == said[1]
    assert "crown" in said[0]


def test_a_variant_by_file_and_by_python_is_the_same(tmp_path: Path) -> None:
    (tmp_path / "slider.yaml").write_text(OSCILLATOR)
    (tmp_path / "variant.yaml").write_text("""
model: variant
extends: slider.yaml
components:
  rail: {is: CoulombFriction, F_c: 0.3 N, v_t: 10 mm/s}
nodes:
  wall: [+rail.a]
  load: [+rail.b]
set: {spring.c: 60 N/m}
""")
    by_file = hb.simulate(hb.load(tmp_path / "variant.yaml"))
    base = hb.load(tmp_path / "slider.yaml")
    rail = {"F_c": "0.3 N", "v_t": 0.01}
    by_python = base.with_component("rail", "CoulombFriction", {"a": "wall", "b": "load"}, rail)
    for found in (hb.simulate(by_python.with_parameters({"spring.c": "60 N/m"})),
                  hb.simulate(hb.assemble(by_python).with_parameters({"spring.c": 60.0})),
                  hb.simulate(by_python, parameters={"spring.c": 60.0})):
        np.testing.assert_array_equal(found["load.x"], by_file["load.x"])
    assert np.abs(by_file["load.x"] - hb.simulate(base)["load.x"]).max() > 1e-3
    closed(by_python)
