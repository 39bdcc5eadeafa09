"""Linear against nonlinear: step responses, DC gains and slowest modes against simulations of small amplitude."""

from __future__ import annotations

import numpy as np
import pytest
from collected import partly

import heavebond as hb

STEP = "if_else(time < 1 ms, 0, 1)"
TANK = """
components:
  pump: {is: FlowSource, u: "=2e-4 m**3/s + 2e-8 m**3/s*STEP"}
  tank: {is: OpenTank, A: 0.01 m**2}
  hole: {is: Orifice, q_r: 3e-4 m**3/s, dp_r: 0.1 bar, dp_t: 1 mbar}
  sump: {is: Tank}
  water: {is: Fluid, rho: 1000 kg/m**3}
nodes: {top: [pump.a, tank.a], out: [tank.b, hole.a, water.a], back: [hole.b, sump.a]}
initial: {start: steady, tank.h: ~ 0.4 m}
simulate: {until: 400 s, every: 2 s}
"""
LEVEL = """
components:
  pump: {is: FlowSource}
  tank: {is: OpenTank, A: 0.01 m**2}
  hole: {is: Orifice, q_r: 3e-4 m**3/s, dp_r: 0.1 bar, dp_t: 1 mbar}
  sump: {is: Tank}
  water: {is: Fluid, rho: 1000 kg/m**3}
  wanted: {is: Sum, k_1: 1, k_2: 1, u_1: 0.4 m, u_2: "=1e-5 m*STEP"}
  control: {is: PID, K_p: 1e-3 m**2/s, K_i: 1e-5 m**2/s**2, y_min: -1 m**3/s, y_max: 1 m**3/s, r: =wanted.y, u: =tank.h}
nodes: {top: [pump.a, tank.a], out: [tank.b, hole.a, water.a], back: [hole.b, sump.a], command: [control.y, pump.u]}
initial: {start: steady, tank.h: ~ 0.4 m}
simulate: {until: 900 s, every: 5 s}
"""
ACCUMULATOR = """
components:
  pump: {is: FlowSource, u: "=5 l/min + 5e-4 l/min*STEP"}
  gas: {is: GasAccumulator, V_0: 1 l, p_0: 50 bar}
  hole: {is: Orifice, q_r: 10 l/min, dp_r: 400 bar}
  sump: {is: Tank}
  oil: {is: Fluid}
nodes: {p: [pump.a, gas.a, hole.a, oil.a], back: [hole.b, sump.a]}
initial: {start: steady, p.p: ~ 100 bar}
simulate: {until: 60 s, every: 0.3 s}
"""
MOTOR = """
components:
  supply: {is: VoltageSource, u: "=24 V + 2 mV*STEP"}
  ground: {is: ElectricalGround}
  motor: {is: DCMotor, R: 0.6 ohm, L: 0.3 mH, k: 46 mN*m/A, J: 140 g*cm**2}
  fan: {is: TorqueSource, u: "=-1e-6 N*m*s**2*shaft.w*abs(shaft.w)"}
nodes: {plus: [supply.a, motor.a], zero: [supply.b, motor.b, ground.a], shaft: [motor.s, fan.a]}
initial: {start: steady, shaft.w: ~ 400 rad/s}
simulate: {until: 60 ms, every: 0.3 ms}
"""
HARDENING = """
components:
  frame: {is: Fixed}
  spring: {is: ForceSource, u: "=-1 kN/m*load.x - 50 kN/m**3*load.x**3"}
  damper: {is: Damper, d: 12 N*s/m}
  load: {is: Mass, m: 2 kg}
  push: {is: ForceSource, u: "=120 N + 10 mN*STEP"}
nodes: {frame: [frame.a, damper.a], load: [damper.b, load.a, spring.a, push.a]}
initial: {start: steady, load.x: ~ 0.1 m}
simulate: {until: 2 s, every: 10 ms}
"""
PENDULUM = """
components:
  wall: {is: FixedShaft}
  bearing: {is: RotationalDamper, d: 0.6 N*m*s/rad}
  bob: {is: Inertia, J: 0.5 kg*m**2}
  weight: {is: TorqueSource, u: "=-9.81 N*m*sin(arm.phi)"}
  hand: {is: TorqueSource, u: "=4 N*m + 1 mN*m*STEP"}
nodes: {wall: [wall.a, bearing.a], arm: [bearing.b, bob.a, weight.a, hand.a]}
initial: {start: steady, arm.phi: ~ 0.4 rad}
simulate: {until: 10 s, every: 50 ms}
"""
RELAY = """
components:
  frame: {is: Fixed}
  spring: {is: SpringDamper, c: 200 N/m, d: 40 N*s/m}
  load: {is: Mass, m: 2 kg}
  relay: {is: Relay, u_on: 20 mm, u_off: -20 mm, y_on: -3 N, y_off: 3 N, u: "=load.x"}
  drive: {is: ForceSource}
  push: {is: ForceSource, u: "=2 N + 1 mN*STEP"}
nodes: {frame: [frame.a, spring.a], load: [spring.b, load.a, drive.a, push.a], r: [relay.y, drive.u]}
initial: {load.x: 25 mm, load.v: 0 m/s}
simulate: {until: 5 s, every: 25 ms}
"""
STUCK = """
components:
  frame: {is: Fixed}
  grip: {is: DryFriction, F_c: 30 N, F_s: 40 N}
  base: {is: Mass, m: 3 kg}
  spring: {is: SpringDamper, c: 200 N/m, d: 4 N*s/m}
  load: {is: Mass, m: 2 kg}
  push: {is: ForceSource, u: "=0.1 N*STEP"}
nodes: {frame: [frame.a, grip.a], base: [grip.b, base.a, spring.a], load: [spring.b, load.a, push.a]}
initial: {base.x: 0 m, base.v: 0 m/s, load.x: 0 m, load.v: 0 m/s}
simulate: {until: 5 s, every: 25 ms}
"""
SWITCHED = """
components:
  plant: {is: TransferFunction, b: [0, 0, 1], a: [1, 0.4, 1]}
  loop: {is: Switch, level: 0, u: 1, u_1: "=-3*plant.y", u_2: "=5*plant.y"}
  sum: {is: Sum, k_1: 1, k_2: 1, u_2: "=1e-3*STEP"}
nodes: {loop: [loop.y, sum.u_1], s: [sum.y, plant.u]}
simulate: {until: 12 s, every: 60 ms}
"""
FREE = """
components:
  frame: {is: Fixed}
  drag: {is: Damper, d: 4 N*s/m}
  load: {is: Mass, m: 2 kg}
  push: {is: ForceSource, u: "=1 N*STEP"}
nodes: {frame: [frame.a, drag.a], load: [drag.b, load.a, push.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 8 s, every: 40 ms}
"""
# diagram, input, size of its step in SI, output, operating point
MACHINES = {
    "tank": (TANK, "pump.u", 2e-8, "tank.h", "steady"),
    "level control": (LEVEL, "wanted.u_2", 1e-5, "tank.h", "steady"),
    "accumulator": (ACCUMULATOR, "pump.u", 5e-4 / 6e4, "p.p", "steady"),
    "motor": (MOTOR, "supply.u", 2e-3, "shaft.w", "steady"),
    "hardening spring": (HARDENING, "push.u", 1e-2, "load.x", "steady"),
    "pendulum": (PENDULUM, "hand.u", 1e-3, "arm.phi", "steady"),
    "relay that stays on": (RELAY, "push.u", 1e-3, "load.x", None),
    "friction that sticks": (STUCK, "push.u", 0.1, "load.x", None),
    "switch that acts at the start": (SWITCHED, "sum.u_2", 1e-3, "plant.y", None),
    "free body": (FREE, "push.u", 1.0, "load.x", None),
}


@pytest.mark.parametrize("name", partly(MACHINES, 3))
def test_a_small_step_moves_a_machine_as_its_linear_system_says(name: str):
    """y(t) after a small step over the step response of the linear system, DC gain and slowest mode."""
    text, given, size, asked, at = MACHINES[name]
    model = hb.loads(f"model: machine{text.replace('STEP', STEP)}")
    system = hb.state_space(model, [given], [asked], at=at)
    quiet = hb.loads(f"model: machine{text.replace('STEP', '0')}")
    time = np.asarray(hb.simulate(quiet).time)
    # a machine that does not begin at rest is compared with itself without the step
    moved = hb.simulate(model)[asked] - hb.simulate(quiet)[asked]
    linear = size * system.step(np.linspace(0, time[-1], len(time)))[:, 0, 0]
    # the step comes 1 ms after the start; the second order of the laws is 1e-4 of the first, a run is known to 1e-8 of a
    # level that is 1e4 times the step
    late = np.interp(time - 1e-3, time, linear)
    assert np.abs(moved - late).max() <= 5e-3 * np.abs(linear).max()
    if name == "friction that sticks":
        return  # the law of sticking lets its bodies creep, by 1e-12 of the force: the DC gain is that of years
    gain, slowest = system.dc_gain()[0, 0], min(abs(pole.real) for pole in system.poles if pole != 0)
    rest = np.exp(-slowest * time[-1])
    if np.isfinite(gain):
        assert moved[-1] / size == pytest.approx(gain, rel=5e-3 + 2 * rest)
    else:
        assert system.poles_at_zero() == 1 and moved[-1] > 1.9 * moved[len(moved) // 2]


@pytest.mark.parametrize(("parameter", "output"), [
    ("body.m", "body.x"), ("tyre.c", "wheel.x"), ("spring.c", "body.x - wheel.x")])
def test_the_dc_gain_by_a_parameter_is_the_change_of_the_steady_start(parameter: str, output: str):
    """The bundled quarter car: central differences of 1e-4, whose error is 1e-8 of second derivatives."""
    model = hb.load("quarter_car")
    gain = hb.state_space(model, [parameter], [f"({output})"], at="steady").dc_gain()[0, 0]
    value = hb.simulate(model, 0.01).assembly.parameter_values[parameter]
    ends = [hb.simulate(model, 0.01, parameters={parameter: value * (1 + sign * 1e-4)})[output][0] for sign in (-1, 1)]
    assert gain == pytest.approx((ends[1] - ends[0]) / (2e-4 * value), rel=1e-4)
