"""Twelve machines whose hidden effect lies beyond a component at a place in all records. See `benchmarks.diagnosis.beds`.

Two effects act between nodes that no component joins, two inside blocks. Two are parameters that vary with a variable, two
parameters that differ between records, two begin at a time. In two machines the model differentiates a measured input with
noise and quantisation. Answers that the catalogue does not have yet are declared with the class `varying parameter` (the
place is the part), `record-dependent parameter` (likewise), or the class of the effect that begins, with the time in `law`.
"""

from __future__ import annotations

from benchmarks.diagnosis.beds import Bed, Channel, Effect, Input, main, stairs, waves

# -- pairs of nodes that no component joins --------------------------------------------------------------------------------
BOARD = Bed(
    "board", "Two heaters on a board, each with its own heat sink.", """
components:
  heater_1: {is: HeatSource, u: 0 W}
  heater_2: {is: HeatSource, u: 0 W}
  block_1:  {is: HeatCapacity, m: 60 g, c: 900 J/(kg*K)}
  block_2:  {is: HeatCapacity, m: 45 g, c: 900 J/(kg*K)}
  sink_1:   {is: ThermalResistance, R: 7 K/W}
  sink_2:   {is: ThermalResistance, R: 9 K/W}
  room:     {is: Ambient, T_0: 296 K}
nodes:
  block_1: [heater_1.a, block_1.a, sink_1.a]
  block_2: [heater_2.a, block_2.a, sink_2.a]
  room:    [sink_1.b, sink_2.b, room.a]
initial: {block_1.T: 296 K, block_2.T: 296 K}
""",
    {"heater_1.u": Input("W", stairs(0.0, 9.0, (60.0, 300.0), 6.0, 0.0)),
     "heater_2.u": Input("W", stairs(0.0, 7.0, (60.0, 300.0), 6.0, 0.0))},
    {"block_1.T": Channel("block_1.T", "K", 0.1), "block_2.T": Channel("block_2.T", "K", 0.1)},
    """
sink_1.R: 7 K/W +- 15 %
sink_2.R: 9 K/W +- 15 %
block_1.m: 60 g +- 10 %
block_2.m: 45 g +- 10 %
""", (
        Effect("Heat flows between the blocks through the board with 30 mW/K.",
               "heat loss: block_1 block_2 | thermal resistance: block_1 block_2 | heat conduction: block_1 block_2", """
components: {board: {is: ThermalResistance, R: 33 K/W}}
nodes: {block_1: [+board.a], block_2: [+board.b]}
"""),), 1800.0, 0.25, 218.0, (1.0,))

CARRIAGES = Bed(
    "carriages", "Two carriages on one rail, each with its own actuator and its own spring to the frame.", """
components:
  push_1:     {is: ForceSource, u: 0 N}
  push_2:     {is: ForceSource, u: 0 N}
  carriage_1: {is: Mass, m: 12 kg}
  carriage_2: {is: Mass, m: 9 kg}
  spring_1:   {is: SpringDamper, c: 900 N/m, d: 25 N*s/m}
  spring_2:   {is: SpringDamper, c: 700 N/m, d: 20 N*s/m}
  frame:      {is: Fixed}
nodes:
  carriage_1: [push_1.a, carriage_1.a, spring_1.b]
  carriage_2: [push_2.a, carriage_2.a, spring_2.b]
  frame:      [frame.a, spring_1.a, spring_2.a]
initial: {carriage_1.x: 0 m, carriage_1.v: 0 m/s, carriage_2.x: 0 m, carriage_2.v: 0 m/s}
""",
    {"push_1.u": Input("N", waves(-60.0, 60.0, 0.5, 4.0, 0.0)), "push_2.u": Input("N", waves(-50.0, 50.0, 0.5, 4.0, 0.0))},
    {"carriage_1.x": Channel("carriage_1.x", "m", 3e-4), "carriage_2.x": Channel("carriage_2.x", "m", 3e-4)},
    """
spring_1.c: 900 N/m +- 10 %
spring_2.c: 700 N/m +- 10 %
spring_1.d: 25 N*s/m +- 30 %
spring_2.d: 20 N*s/m +- 30 %
""", (
        Effect("Dry friction of 4 N of the cable chain between the carriages.", "dry friction: carriage_1 carriage_2", """
components: {chain: {is: CoulombFriction, F_c: 4 N, v_t: 2 mm/s}}
nodes: {carriage_1: [+chain.a], carriage_2: [+chain.b]}
"""),), 20.0, 40.0, 679.0, (1.0,))

# -- effects inside blocks -------------------------------------------------------------------------------------------------
ACTUATOR = """
component: {kind}
summary: Valve and cylinder of an actuator in one housing{what}.
ports: {{a: translational, b: translational, P: hydraulic, T: hydraulic, u: {{signal: in, unit: 1, doc: command}}}}
parameters:
  q_r:  {{unit: m**3/s, min: 0, doc: rated flow of a metering edge}}
  beta: {{unit: Pa, min: 0, doc: bulk modulus}}
components:
  valve:    {{is: ProportionalValve43, u: =u, q_r: =q_r, dp_r: 35 bar, f_n: 25 Hz, zeta: 0.8}}
  cylinder: {{is: Cylinder, A_A: 10 cm**2, A_B: 10 cm**2, V_A0: 0.3 L, V_B0: 0.3 L, beta: =beta}}
{parts}
nodes:
  supply: [P, valve.P]
  return: [T, valve.T]
{cap}
  rod:    [valve.B, cylinder.B]
  back:   [a, cylinder.a]
  front:  [b, cylinder.b]
"""
RUDDER = Bed(
    "rudder", "An actuator, one block with valve and cylinder inside, moves a rudder.", """
components:
  pump:     {is: PressureSource, p_0: 140 bar}
  tank:     {is: Tank}
  actuator: {is: Actuator, u: 0, q_r: 10 L/min, beta: 1.2 GPa}
  rudder:   {is: Mass, m: 900 kg}
  water:    {is: SpringDamper, c: 60 kN/m, d: 6 kN*s/m}
  hull:     {is: Fixed}
nodes:
  supply: [pump.a, actuator.P]
  return: [actuator.T, tank.a]
  hull:   [hull.a, actuator.a, water.a]
  rudder: [actuator.b, rudder.a, water.b]
initial:
  rudder.x: 0 m
  rudder.v: 0 m/s
  actuator.cap.p: 70 bar
  actuator.rod.p: 70 bar
  actuator.valve.x: 0
  actuator.valve.w: 0 1/s
""",
    {"actuator.u": Input("1", waves(-0.6, 0.6, 0.5, 4.0, 0.0))},
    {"rudder.x": Channel("rudder.x", "m", 2e-4), "p_A": Channel("actuator.valve.A.p", "bar", 0.4),
     "p_B": Channel("actuator.valve.B.p", "bar", 0.4)},
    """
actuator.q_r: 10 L/min +- 10 %
water.c: 60 kN/m +- 15 %
water.d: 6 kN*s/m +- 30 %
actuator.beta: 1.2 GPa +- 20 %
""", (
        Effect("The bore between valve and cap side inside the actuator has a resistance of 12 bar at 5 L/min.",
               "line resistance: actuator.cap actuator.cylinder | line resistance: actuator.cap actuator.valve", """
components: {actuator: {is: ActuatorWithLoss, u: 0, q_r: 10 L/min, beta: 1.2 GPa}}
"""),), 15.0, 40.0, 27.2, (1.0,),
    parts=(ACTUATOR.format(kind="Actuator", what="", parts="", cap="  cap:    [valve.A, cylinder.A]"),
           ACTUATOR.format(kind="ActuatorWithLoss", what=", with a narrow bore",
                           parts="  bore:     {is: LineResistance, R: 0, K: 1.7e14 Pa*s**2/m**6}",
                           cap="  mouth:  [valve.A, bore.a]\n  cap:    [bore.b, cylinder.A]")))

GEARBOX = """
component: {kind}
summary: Two gear stages with an elastic intermediate shaft{what}.
ports: {{a: rotational, b: rotational, housing: rotational}}
parameters:
  c: {{unit: N*m/rad, min: 0, doc: stiffness of the intermediate shaft}}
components:
  first:  {{is: Gear, i: 3}}
  wheel:  {{is: Inertia, J: 0.02 kg*m**2}}
  shaft:  {{is: TorsionSpringDamper, c: =c, d: 0.4 N*m*s/rad}}
  pinion: {{is: Inertia, J: 0.01 kg*m**2}}
  second: {{is: Gear, i: 2}}
  seal:   {{is: RotationalDamper, d: 0.02 N*m*s/rad}}
{parts}
nodes:
  input:   [a, first.a, seal.b]
  wheel:   [first.b, wheel.a, shaft.a]
  pinion:  [shaft.b, pinion.a, second.a{pinion}]
  output:  [b, second.b]
  housing: [housing, seal.a{housing}]
"""
MIXER = Bed(
    "mixer", "A motor drives a mixer through a gearbox, one block with an elastic shaft inside.", """
components:
  motor:   {is: TorqueSource, u: 0 N*m}
  rotor:   {is: Inertia, J: 0.004 kg*m**2}
  gearbox: {is: Gearbox, c: 300 N*m/rad}
  mixer:   {is: Inertia, J: 0.5 kg*m**2}
  dough:   {is: RotationalDamper, d: 3 N*m*s/rad}
  frame:   {is: FixedShaft}
nodes:
  rotor: [motor.a, rotor.a, gearbox.a]
  mixer: [gearbox.b, mixer.a, dough.b]
  frame: [frame.a, gearbox.housing, dough.a]
initial: {rotor.phi: 0 rad, rotor.w: 0 rad/s, mixer.phi: 0 rad, mixer.w: 0 rad/s}
""",
    {"motor.u": Input("N*m", waves(-4.0, 4.0, 0.15, 1.5, 0.0))},
    {"rotor.w": Channel("rotor.w", "rad/s", 0.05), "mixer.w": Channel("mixer.w", "rad/s", 0.01)},
    """
gearbox.c: 300 N*m/rad +- 20 %
dough.d: 3 N*m*s/rad +- 20 %
mixer.J: 0.5 kg*m**2 +- 10 %
""", (
        Effect("Dry friction of 1.5 N*m between pinion and housing inside the gearbox.",
               "dry friction: frame gearbox.pinion | dry friction: gearbox.pinion gearbox.housing",
               "components: {gearbox: {is: GearboxWithFriction, c: 300 N*m/rad}}"),), 6.0, 150.0, 240.0, (1.0,),
    parts=(GEARBOX.format(kind="Gearbox", what="", parts="", pinion="", housing=""),
           GEARBOX.format(kind="GearboxWithFriction", what=", with friction of the pinion",
                          parts="  bearing: {is: RotationalCoulombFriction, M_c: 1.5 N*m, w_t: 0.05 rad/s}",
                          pinion=", bearing.b", housing=", bearing.a")))

# -- parameters that vary with a variable ----------------------------------------------------------------------------------
HOPPER = Bed(
    "hopper", "A pump fills a tank, which empties through a pipe.", """
components:
  pump:   {is: FlowSource, u: 0 L/min}
  tank:   {is: OpenTank, A: 0.08 m**2}
  outlet: {is: Orifice, q_r: 6 L/min, dp_r: 40 mbar, dp_t: 1 mbar}
  basin:  {is: Tank}
nodes:
  inflow: [pump.a, tank.a]
  bottom: [tank.b, outlet.a]
  basin:  [outlet.b, basin.a]
initial: {tank.h: 0.3 m}
""",
    {"pump.u": Input("L/min", stairs(2.0, 7.5, (60.0, 300.0), 6.0, 5.0))},
    {"tank.h": Channel("tank.h", "m", 1e-3)},
    """
tank.A: 0.08 m**2 +- 15 %
outlet.q_r: 6 L/min +- 15 %
""", (
        Effect("The tank widens upwards: its area is 0.035 m**2 at the bottom and grows by 0.15 m**2 in 1 m.",
               "varying parameter: tank", "components: {tank: {is: WideningTank, A: 0.035 m**2, k: 0.15 m}}"),),
    2400.0, 0.2, 7.39, (1.0,),
    parts=("""
component: WideningTank
summary: Open tank whose surface area grows with the level.
ports: {a: hydraulic, b: hydraulic}
parameters:
  A: {unit: m**2, min: 0, doc: area at the bottom}
  k: {unit: m, doc: growth of the area with the level}
  rho: {unit: kg/m**3, min: 0, default: 1000 kg/m**3, doc: density}
variables:
  h: {unit: m, min: 0, start: 0.1 m, doc: liquid level}
equations: |
  (A + k*h) * der(h) = a.q + b.q
  a.p = 0
  b.p = rho * 9.81 * h
units: unchecked
power: source
""",))

RAIL = Bed(
    "rail", "A linear motor moves a slide on a rail against two springs.", """
components:
  motor:    {is: ForceSource, u: 0 N}
  slide:    {is: Mass, m: 20 kg}
  springs:  {is: Spring, c: 1.2 kN/m}
  friction: {is: CoulombFriction, F_c: 40 N, v_t: 2 mm/s}
  grease:   {is: Damper, d: 60 N*s/m}
  rail:     {is: Fixed}
nodes:
  slide: [motor.a, slide.a, springs.b, friction.b, grease.b]
  rail:  [rail.a, springs.a, friction.a, grease.a]
initial: {slide.x: 0 m, slide.v: 0 m/s}
""",
    {"motor.u": Input("N", waves(-260.0, 260.0, 0.6, 5.0, 0.0))},
    {"slide.x": Channel("slide.x", "m", 3e-4)},
    """
springs.c: 1.2 kN/m +- 10 %
grease.d: 60 N*s/m +- 30 %
friction.F_c: 40 N +- 50 %
""", (
        Effect("The friction grows along the rail, by 12 N in 0.1 m from 40 N at the middle.",
               "varying parameter: friction | varying parameter: rail slide", """
components: {along: {is: ForceBetween, u: "=-max(120 N/m*slide.x, -40 N)*smooth_sign(slide.v, 2 mm/s)"}}
nodes: {rail: [+along.a], slide: [+along.b]}
"""),), 20.0, 40.0, 2760.0, (1.0,))

# -- parameters that differ between records --------------------------------------------------------------------------------
DRAIN = Bed(
    "drain", "A pump delivers through a throttle valve that is set by hand before each record.", """
components:
  pump:     {is: FlowSource, u: 10 L/min}
  line:     {is: Volume, V: 4 L, beta: 1.3 GPa}
  throttle: {is: Orifice, q_r: 20 L/min, dp_r: 60 bar}
  cooler:   {is: LineResistance, R: 0.3e9 Pa*s/m**3}
  tank:     {is: Tank}
nodes:
  line:   [pump.a, line.a, throttle.a]
  middle: [throttle.b, cooler.a]
  tank:   [cooler.b, tank.a]
initial: {line.p: 16 bar}
""",
    {"pump.u": Input("L/min", stairs(4.0, 22.0, (0.8, 2.5), 0.15, 10.0))},
    {"line.p": Channel("line.p", "bar", 0.3)},
    """
throttle.q_r: 20 L/min +- 10 %
line.beta: 1.3 GPa +- 20 %
""", (
        Effect("The throttle is 15 % wider in the second and the third record.", "record-dependent parameter: throttle",
               dict.fromkeys(("second", "third"), "set: {throttle.q_r: 23 L/min}")),), 20.0, 20.0, 127.0, (1.0,),
    records={"first": "fit", "second": "fit", "third": "validate", "fourth": "test"})

WHEEL = Bed(
    "wheel", "A wheel of a car on a shaker; the last record was taken with cold oil in the damper.", """
components:
  body:    {is: Mass, m: 320 kg}
  spring:  {is: Spring, c: 22 kN/m}
  damper:  {is: Damper, d: 1.5 kN*s/m}
  wheel:   {is: Mass, m: 40 kg}
  tyre:    {is: SpringDamper, c: 190 kN/m, d: 150 N*s/m}
  shaker:  {is: PositionSource, u: 0 m}
nodes:
  body:   [body.a, spring.b, damper.b]
  wheel:  [spring.a, damper.a, wheel.a, tyre.b]
  shaker: [tyre.a, shaker.a]
initial: {body.x: 0 m, body.v: 0 m/s, wheel.x: 0 m, wheel.v: 0 m/s}
""",
    {"shaker.u": Input("m", waves(-0.02, 0.02, 0.15, 2.0, 0.0))},
    {"body.x": Channel("body.x", "m", 3e-4), "deflection": Channel("body.x - wheel.x", "m", 3e-4)},
    """
spring.c: 22 kN/m +- 10 %
damper.d: 1.5 kN*s/m +- 15 %
tyre.c: 190 kN/m +- 10 %
""", (
        Effect("The damper is 40 % stronger in the validation record.", "record-dependent parameter: damper",
               {"validate": "set: {damper.d: 2.1 kN*s/m}"}),), 8.0, 100.0, 12.0, (1.0,),
    records={"train": "fit", "again": "fit", "validate": "validate"})

# -- effects that begin at a time ------------------------------------------------------------------------------------------
CLAMP = Bed(
    "clamp", "A pump charges the accumulator of a clamping device; a seal fails.", """
components:
  pump:        {is: FlowSource, u: 0 L/min}
  accumulator: {is: GasAccumulator, V_0: 4 L, p_0: 60 bar, n: 1.2, beta: 1.4 GPa}
  throttle:    {is: Orifice, q_r: 8 L/min, dp_r: 20 bar}
  clamp:       {is: Volume, V: 1 L, beta: 1.4 GPa}
  valve:       {is: Orifice, q_r: 4 L/min, dp_r: 100 bar}
  tank:        {is: Tank}
nodes:
  line:  [pump.a, accumulator.a, throttle.a]
  clamp: [throttle.b, clamp.a, valve.a]
  tank:  [valve.b, tank.a]
initial: {line.p: 90 bar, clamp.p: 75 bar}
""",
    {"pump.u": Input("L/min", stairs(1.5, 6.0, (2.0, 8.0), 0.4, 4.0))},
    {"line.p": Channel("line.p", "bar", 0.25), "clamp.p": Channel("clamp.p", "bar", 0.25)},
    """
throttle.q_r: 8 L/min +- 10 %
valve.q_r: 4 L/min +- 10 %
accumulator.V_0: 4 L +- 10 %
""", (
        Effect("The clamp leaks 0.5 L/min at 90 bar to the tank, from 34 s on in the second record, and in the whole third.",
               "leakage: clamp tank", {
                   "second": """
components: {seal: {is: FlowSource, u: "=-if_else(time > 34 s, 9e-13 m**3/(s*Pa), 0 m**3/(s*Pa))*clamp.p"}}
nodes: {clamp: [+seal.a]}
""", "third": """
components: {seal: {is: LaminarLeakage, C: 9e-13 m**3/(s*Pa)}}
nodes: {clamp: [+seal.a], tank: [+seal.b]}
"""}),), 60.0, 10.0, 136.0, (1.0,), records={"first": "fit", "second": "fit", "third": "validate"})

SPINDLE = Bed(
    "spindle", "A motor drives a spindle through a belt; a bearing begins to seize.", """
components:
  motor:   {is: TorqueSource, u: 0 N*m}
  rotor:   {is: Inertia, J: 0.01 kg*m**2}
  belt:    {is: TorsionSpringDamper, c: 40 N*m/rad, d: 0.15 N*m*s/rad}
  spindle: {is: Inertia, J: 0.03 kg*m**2}
  grease:  {is: RotationalDamper, d: 0.05 N*m*s/rad}
  frame:   {is: FixedShaft}
nodes:
  rotor:   [motor.a, rotor.a, belt.a]
  spindle: [belt.b, spindle.a, grease.b]
  frame:   [frame.a, grease.a]
initial: {rotor.phi: 0 rad, rotor.w: 0 rad/s, spindle.phi: 0 rad, spindle.w: 0 rad/s}
""",
    {"motor.u": Input("N*m", waves(-2.5, 3.5, 0.4, 4.0, 0.0))},
    {"rotor.w": Channel("rotor.w", "rad/s", 0.15), "spindle.w": Channel("spindle.w", "rad/s", 0.15)},
    """
belt.c: 40 N*m/rad +- 20 %
grease.d: 0.05 N*m*s/rad +- 20 %
spindle.J: 0.03 kg*m**2 +- 10 %
""", (
        Effect("From 11 s on in the first record, and from 6 s on in the second, dry friction of 0.4 N*m of the spindle.",
               "dry friction: frame spindle", {name: f"""
parameters: {{onset: {onset} s, M_c: 0.4 N*m}}
components: {{bearing: {{is: TorqueSource, u: "=-if_else(time > onset, M_c, 0 N*m)*smooth_sign(spindle.w, 0.1 rad/s)"}}}}
nodes: {{spindle: [+bearing.a]}}
""" for name, onset in (("train", 11), ("validate", 6))}),), 20.0, 50.0, 147.0, (1.0,))

# -- measured inputs that the model differentiates -------------------------------------------------------------------------
HEAVE = Bed(
    "heave", "A crown block on a string, hung from a heaving platform; the heave is measured with noise.", """
components:
  vessel: {is: PositionSource, u: 0 m}
  gas:    {is: Spring, c: 42 kN/m}
  damper: {is: Damper, d: 52 kN*s/m}
  crown:  {is: Mass, m: 120 t}
  string: {is: SpringDamper, c: 217 kN/m, d: 8 kN*s/m}
  seabed: {is: Fixed}
nodes:
  platform: [vessel.a, gas.a, damper.a]
  crown:    [gas.b, damper.b, crown.a, string.b]
  seabed:   [string.a, seabed.a]
initial: {crown.x: 0 m, crown.v: 0 m/s}
""",
    {"vessel.u": Input("m", waves(-0.8, 0.8, 6.0, 16.0, 0.0), noise=3e-3, step=5e-3)},
    {"crown.x": Channel("crown.x", "m", 1e-3), "string.F": Channel("string.F", "N", 250.0)},
    """
gas.c: 42 kN/m +- 20 %
damper.d: 52 kN*s/m +- 20 %
string.c: 217 kN/m +- 5 %
""", (
        Effect("Dry friction of 9 kN between platform and crown block.", "dry friction: crown platform", """
components: {seal: {is: CoulombFriction, F_c: 9 kN, v_t: 5 mm/s}}
nodes: {platform: [+seal.a], crown: [+seal.b]}
"""),), 120.0, 10.0, 464.0, (1.0,))

ENCODER = Bed(
    "encoder", "A crank with a coarse encoder turns a flywheel through a torsion bar.", """
components:
  crank:    {is: AngleSource, u: 0 rad}
  bar:      {is: TorsionSpringDamper, c: 60 N*m/rad, d: 1.2 N*m*s/rad}
  flywheel: {is: Inertia, J: 0.15 kg*m**2}
  spring:   {is: TorsionSpring, c: 45 N*m/rad}
  oil:      {is: RotationalDamper, d: 0.5 N*m*s/rad}
  frame:    {is: FixedShaft}
nodes:
  crank:    [crank.a, bar.a]
  flywheel: [bar.b, flywheel.a, spring.b, oil.b]
  frame:    [frame.a, spring.a, oil.a]
initial: {flywheel.phi: 0 rad, flywheel.w: 0 rad/s}
""",
    {"crank.u": Input("rad", waves(-0.6, 0.6, 0.6, 4.0, 0.0), noise=1e-3, step=6.136e-3, stated=True)},
    {"flywheel.phi": Channel("flywheel.phi", "rad", 1e-3), "torque": Channel("bar.M", "N*m", 0.3)},
    """
bar.c: 60 N*m/rad +- 15 %
bar.d: 1.2 N*m*s/rad +- 30 %
spring.c: 45 N*m/rad +- 10 %
""", (
        Effect("The return spring hardens by 120 N*m/rad**3.",
               "nonlinear stiffness: flywheel frame | nonlinear stiffness: spring", """
components: {coil: {is: CubicTorsionSpring, c_3: 120 N*m/rad**3}}
nodes: {frame: [+coil.a], flywheel: [+coil.b]}
"""),), 20.0, 50.0, 37.9, (1.0,))

BEDS = {bed.name: bed for bed in (
    BOARD, CARRIAGES, RUDDER, MIXER, HOPPER, RAIL, DRAIN, WHEEL, CLAMP, SPINDLE, HEAVE, ENCODER)}

if __name__ == "__main__":
    main(BEDS, "beyond", __doc__)
