"""Six machines that integrate their input and are recorded without a controller. See `benchmarks.diagnosis.beds`.

A small constant force that the diagram lacks adds up over such a record, and the simulated position leaves the measured one.
The declared effect of each machine shows over short times; the clutter (a slope, an offset of a supply, the cables of a
motor) contributes to the drift, and dominates it in some. It is a constant force or flow: an answer that names it as well is
not wrong, although `judged` counts it as an extra name. An effect with a restoring force would reduce the drift, and is
not there.
"""

from __future__ import annotations

from benchmarks.diagnosis.beds import Bed, Channel, Effect, Input, main, stairs

CART = Bed(
    "cart", "A motor drives a cart on a long rail, by a relay with three levels of force.", """
components:
  motor: {is: ForceSource, u: 0 N}
  cart:  {is: Mass, m: 2 kg}
  belt:  {is: Damper, d: 5 N*s/m}
  rail:  {is: Fixed}
nodes:
  cart: [motor.a, cart.a, belt.b]
  rail: [rail.a, belt.a]
initial: {cart.x: 0 m, cart.v: 0 m/s}
""",
    {"motor.u": Input("N", stairs(-9.0, 9.0, (0.4, 1.4), 0.02, 0.0), interpolation="hold")},
    {"cart.x": Channel("cart.x", "m", 5e-4, step=1e-3)},
    """
cart.m: 2 kg +- 10 %
belt.d: 5 N*s/m +- 40 %
""", (
        Effect("Dry friction of 2 N between rail and cart.", "dry friction: rail cart", """
components: {wheels: {is: CoulombFriction, F_c: 2 N}}
nodes: {rail: [+wheels.a], cart: [+wheels.b]}
"""),), 20.0, 50.0, 270000.0, (1.48, 0.84),
    clutter=(Effect("The rail falls by 2 cm in a metre.", "", """
components: {slope: {is: ForceSource, u: 0.4 N}}
nodes: {cart: [+slope.a]}
"""),
             Effect("The amplifier gives 0.15 N too much.", "", """
components: {bias: {is: ForceSource, u: 0.15 N}}
nodes: {cart: [+bias.a]}
""")))

SERVO = Bed(
    "servo", "A servo motor turns a table through a gear and a shaft; both angles are measured.", """
components:
  motor: {is: TorqueSource, u: 0 N*m}
  rotor: {is: Inertia, J: 0.002 kg*m**2}
  gear:  {is: Gear, i: 4}
  shaft: {is: TorsionSpringDamper, c: 600 N*m/rad, d: 2 N*m*s/rad}
  table: {is: Inertia, J: 0.2 kg*m**2}
  oil:   {is: RotationalDamper, d: 0.8 N*m*s/rad}
  frame: {is: FixedShaft}
nodes:
  rotor:  [motor.a, rotor.a, gear.a]
  output: [gear.b, shaft.a]
  table:  [shaft.b, table.a, oil.b]
  frame:  [frame.a, oil.a]
initial: {table.phi: 0 rad, table.w: 0 rad/s, rotor.phi: 0 rad, rotor.w: 0 rad/s}
""",
    {"motor.u": Input("N*m", stairs(-2.0, 2.0, (0.2, 0.8), 0.05, 0.0))},
    {"rotor.phi": Channel("rotor.phi", "rad", 1e-3, step=2e-3), "table.phi": Channel("table.phi", "rad", 5e-4, step=1e-3)},
    """
shaft.c: 600 N*m/rad +- 15 %
oil.d: 0.8 N*m*s/rad +- 30 %
table.J: 0.2 kg*m**2 +- 10 %
""", (
        Effect("Backlash of 15 mrad on each side between gear and shaft.",
               "backlash: gear output | backlash: shaft | backlash: shaft table | backlash: shaft output "
               "| backlash: gear rotor",
               """
components: {play: {is: GearBacklash, gap: 15 mrad, c: 1e4 N*m/rad, d: 2 N*m*s/rad}}
nodes: {output: [-shaft.a, +play.a], coupling: [shaft.a, play.b]}
initial: {coupling.phi: ~ 0 rad}
"""),), 8.0, 125.0, 4.5e6, (8.7e-5, 1.0),
    clutter=(Effect("The cables of the table pull by 0.12 N*m.", "", """
components: {cables: {is: TorqueSource, u: 0.12 N*m}}
nodes: {table: [+cables.a]}
"""),
             Effect("The amplifier gives 0.03 N*m too much.", "", """
components: {bias: {is: TorqueSource, u: 0.03 N*m}}
nodes: {rotor: [+bias.a]}
""")))

TANK_CHAIN = Bed(
    "tank_chain", "A pump fills the first of two tanks in a row, and another pump empties the second.", """
components:
  feed:   {is: FlowSource, u: 0 L/min}
  first:  {is: OpenTank, A: 400 cm**2}
  pipe:   {is: LaminarLeakage, C: 3e-8 m**3/(s*Pa)}
  second: {is: OpenTank, A: 500 cm**2}
  drain:  {is: FlowSource, u: 0 L/min}
  pit:    {is: Tank}
nodes:
  inflow: [feed.a, first.a]
  bottom: [first.b, pipe.a]
  outlet: [pipe.b, second.b, drain.a]
  top:    [second.a]
  pit:    [pit.a]
initial: {first.h: 0.6 m, second.h: 0.5 m}
""",
    {"feed.u": Input("L/min", stairs(0.0, 9.0, (20.0, 60.0), 2.0, 4.0)),
     "drain.u": Input("L/min", stairs(-7.0, 0.0, (20.0, 60.0), 2.0, -3.2))},
    {"first.h": Channel("first.h", "mm", 0.5, step=1.0), "second.h": Channel("second.h", "mm", 0.5, step=1.0)},
    """
pipe.C: 3e-8 m**3/(s*Pa) +- 20 %
""", (
        Effect("The bottom of the first tank leaks, 0.6 L/min at 0.5 m.", "leakage: bottom pit", """
components: {crack: {is: LaminarLeakage, C: 2e-9 m**3/(s*Pa)}}
nodes: {bottom: [+crack.a], pit: [+crack.b]}
"""),), 600.0, 1.0, 7150.0, (0.92, 0.002),
    clutter=(Effect("The feed pump gives 2 % more, the drain takes 0.1 L/min more.", "", """
components:
  more: {is: FlowSource, u: =0.02*feed.u}
  late: {is: FlowSource, u: -0.1 L/min}
nodes: {inflow: [+more.a], outlet: [+late.a]}
"""),))

TURNING_PENDULUM = Bed(
    "turning_pendulum", "A propeller turns a pendulum, which goes over the top at times.", """
components:
  thrust: {is: TorqueSource, u: 0 N*m}
  arm:    {is: Inertia, J: 0.05 kg*m**2}
  weight: {is: ArmWeight, m: 0.5 kg, l: 0.3 m}
  joint:  {is: RotationalDamper, d: 0.01 N*m*s/rad}
  frame:  {is: FixedShaft}
nodes:
  arm:   [thrust.a, arm.a, weight.a, joint.b]
  frame: [frame.a, joint.a]
initial: {arm.phi: 0 rad, arm.w: 0 rad/s}
""",
    {"thrust.u": Input("N*m", stairs(-1.4, 1.4, (0.4, 1.6), 0.1, 0.0))},
    {"arm.phi": Channel("arm.phi", "rad", 2e-3, step=2 * 3.141592653589793 / 2000)},
    """
arm.J: 0.05 kg*m**2 +- 10 %
joint.d: 0.01 N*m*s/rad +- 50 %
""", (
        Effect("Dry friction of 0.12 N*m in the joint.", "dry friction: frame arm", """
components: {bearing: {is: RotationalCoulombFriction, M_c: 0.12 N*m}}
nodes: {frame: [+bearing.a], arm: [+bearing.b]}
"""),), 15.0, 60.0, 4.71e8, (1.05, 0.1),
    clutter=(Effect("The cable of the propeller pulls by 0.02 N*m, and the thrust is 1 % larger.", "", """
components: {cable: {is: TorqueSource, u: "=0.02 N*m + 0.01*thrust.u"}}
nodes: {arm: [+cable.a]}
"""),))

ROPE_DRUM = Bed(
    "rope_drum", "A motor with a drum lifts and lowers a load on a rope.", """
components:
  motor:  {is: TorqueSource, u: 0 N*m}
  drum:   {is: Inertia, J: 0.4 kg*m**2}
  rope:   {is: Rack, r: 0.1 m}
  load:   {is: Mass, m: 50 kg}
  weight: {is: ConstantForce, F: -490.5 N}
  oil:    {is: RotationalDamper, d: 2 N*m*s/rad}
  frame:  {is: FixedShaft}
nodes:
  drum:  [motor.a, drum.a, rope.a, oil.b]
  load:  [rope.b, load.a, weight.a]
  frame: [frame.a, oil.a]
initial: {drum.phi: 0 rad, drum.w: 0 rad/s, load.x: 0 m}
""",
    {"motor.u": Input("N*m", stairs(36.0, 62.0, (0.5, 1.5), 0.1, 49.05))},
    {"drum.phi": Channel("drum.phi", "rad", 2e-3, step=4e-3), "load.x": Channel("load.x", "mm", 0.5, step=0.5)},
    """
drum.J: 0.4 kg*m**2 +- 15 %
oil.d: 2 N*m*s/rad +- 40 %
""", (
        Effect("Drag of the brake fan of the drum, 6 N*m at 2 rad/s.", "quadratic damping: frame drum", """
components: {fan: {is: RotationalDrag, k_2: 1.5 N*m*s**2/rad**2}}
nodes: {frame: [+fan.a], drum: [+fan.b]}
"""),), 20.0, 40.0, 69400.0, (3.45, 1.4),
    clutter=(Effect("The load is 0.6 % heavier, and the motor gives 0.2 N*m less.", "", """
components:
  more: {is: ConstantForce, F: -3 N}
  less: {is: TorqueSource, u: -0.2 N*m}
nodes: {load: [+more.a], drum: [+less.a]}
"""),))

FLEXIBLE_LINK = Bed(
    "flexible_link", "A motor turns a hub with a flexible link; both angles are measured.", """
components:
  motor: {is: TorqueSource, u: 0 N*m}
  hub:   {is: Inertia, J: 0.01 kg*m**2}
  link:  {is: TorsionSpringDamper, c: 12 N*m/rad, d: 0.01 N*m*s/rad}
  tip:   {is: Inertia, J: 0.03 kg*m**2}
  oil:   {is: RotationalDamper, d: 0.06 N*m*s/rad}
  frame: {is: FixedShaft}
nodes:
  hub:   [motor.a, hub.a, link.a, oil.b]
  tip:   [link.b, tip.a]
  frame: [frame.a, oil.a]
initial: {hub.phi: 0 rad, hub.w: 0 rad/s, tip.phi: 0 rad, tip.w: 0 rad/s}
""",
    {"motor.u": Input("N*m", stairs(-0.4, 0.4, (0.3, 1.0), 0.02, 0.0), interpolation="hold")},
    {"hub.phi": Channel("hub.phi", "rad", 1e-3, step=2e-3),
     "bend": Channel("tip.phi - hub.phi", "rad", 1e-3, step=1e-3)},
    """
link.c: 12 N*m/rad +- 15 %
oil.d: 0.06 N*m*s/rad +- 30 %
tip.J: 0.03 kg*m**2 +- 10 %
""", (
        Effect("Dry friction of 0.08 N*m in the bearing of the hub.", "dry friction: frame hub", """
components: {bearing: {is: RotationalCoulombFriction, M_c: 0.08 N*m}}
nodes: {frame: [+bearing.a], hub: [+bearing.b]}
"""),), 10.0, 80.0, 93600.0, (5.9, 1.85),
    clutter=(Effect("The cables of the hub pull by 0.015 N*m.", "", """
components: {cables: {is: TorqueSource, u: 0.015 N*m}}
nodes: {hub: [+cables.a]}
"""),))

BEDS = {bed.name: bed for bed in (CART, SERVO, TANK_CHAIN, TURNING_PENDULUM, ROPE_DRUM, FLEXIBLE_LINK)}

if __name__ == "__main__":
    main(BEDS, "integrating", __doc__)
