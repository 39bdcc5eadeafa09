"""Ten machines with two or three hidden effects. See `benchmarks.diagnosis.beds`.

The first effect of each machine is dominant. `axis`, `oven`, `feed_line` and `buoy` lack the declared effects only. The
others have clutter as well: minor effects outside the catalogue, fixed values that differ from the data sheet, drift, delay
and quantisation.
"""

from __future__ import annotations

from benchmarks.diagnosis.beds import Bed, Channel, Effect, Input, main, stairs, waves
from benchmarks.diagnosis.rigs import MODELS

AXIS = Bed(
    "axis", "A proportional valve moves the slide of a machine tool against a balancing spring.", """
components:
  pump:     {is: PressureSource, p_0: 120 bar}
  tank:     {is: Tank}
  valve:    {is: ProportionalValve43, u: 0, q_r: 24 L/min, dp_r: 35 bar, f_n: 30 Hz, zeta: 0.8}
  cylinder: {is: Cylinder, A_A: 19.6 cm**2, A_B: 11.6 cm**2, V_A0: 0.5 L, V_B0: 0.4 L, beta: 1.2 GPa}
  slide:    {is: Mass, m: 450 kg}
  spring:   {is: Spring, c: 40 kN/m}
  damper:   {is: Damper, d: 3 kN*s/m}
  bed:      {is: Fixed}
nodes:
  supply: [pump.a, valve.P]
  return: [valve.T, tank.a]
  cap:    [valve.A, cylinder.A]
  rod:    [valve.B, cylinder.B]
  bed:    [cylinder.a, bed.a, spring.a, damper.a]
  slide:  [cylinder.b, slide.a, spring.b, damper.b]
initial: {slide.x: 0 m, slide.v: 0 m/s, cap.p: 40 bar, rod.p: 67.6 bar, valve.x: 0, valve.w: 0 1/s}
""",
    {"valve.u": Input("1", waves(-0.5, 0.5, 0.5, 5.0, 0.0))},
    {"slide.x": Channel("slide.x", "m", 2e-4), "cap.p": Channel("cap.p", "bar", 0.4), "rod.p": Channel("rod.p", "bar", 0.4)},
    """
spring.c: 40 kN/m +- 10 %
damper.d: 3 kN*s/m +- 20 %
cylinder.beta: 1.2 GPa +- 25 %
valve.q_r: 24 L/min +- 5 %
""", (
        Effect("Leakage past the piston, 1.5 L/min at 50 bar.", "internal leakage: cylinder | leakage: cap rod",
               "set: {cylinder.leakage: 5e-12 m**3/(s*Pa)}"),
        Effect("Dry friction of 1.5 kN with stiction of 2 kN between bed and slide.", "dry friction: bed slide", """
components: {guide: {is: StribeckFriction, F_c: 1.5 kN, F_s: 2 kN, v_s: 20 mm/s}}
nodes: {bed: [+guide.a], slide: [+guide.b]}
""")), 12.0, 50.0, 1530.0, (0.95, 0.073))

LIFT = Bed(
    "lift", "A servo pump raises and lowers a load with a cylinder whose rod side is open to the tank.", """
components:
  pump:     {is: FlowSource, u: 0 L/min}
  line:     {is: Volume, V: 1 L, beta: 1.3 GPa}
  cylinder: {is: Cylinder, A_A: 28 cm**2, A_B: 18 cm**2, V_A0: 1.2 L, V_B0: 1.2 L, beta: 1.3 GPa}
  tank:     {is: Tank}
  load:     {is: Mass, m: 1.5 t}
  weight:   {is: Weight, m: =load.m}
  guide:    {is: Damper, d: 4 kN*s/m}
  frame:    {is: Fixed}
nodes:
  line:  [pump.a, line.a, cylinder.A]
  rod:   [cylinder.B, tank.a]
  frame: [cylinder.a, frame.a, guide.a]
  load:  [cylinder.b, load.a, weight.a, guide.b]
initial: {load.x: 0 m, load.v: 0 m/s, line.p: 52.55 bar}
""",
    {"pump.u": Input("L/min", stairs(-9.0, 9.0, (0.5, 1.5), 0.1, 0.0))},
    {"load.x": Channel("load.x", "m", 5e-4, step=1e-3), "line.p": Channel("line.p", "bar", 0.2)},
    """
guide.d: 4 kN*s/m +- 20 %
cylinder.beta: 1.3 GPa +- 20 %
""", (
        Effect("Dry friction of 1.6 kN between frame and load.",
               "dry friction: frame load | pressure-dependent friction: frame load", """
components: {seal: {is: CoulombFriction, F_c: 1.6 kN}}
nodes: {frame: [+seal.a], load: [+seal.b]}
"""),
        Effect("The pressure gauge reads 2 bar too much.", "sensor offset: line.p", read={"line.p": "{} + 2 bar"})),
    20.0, 40.0, 600.0, (0.82, 0.083, 0.2),
    clutter=(Effect("The load is 2 % heavier, and the line is 0.3 L larger.", "", "set: {load.m: 1.53 t, line.V: 1.3 L}"),
             Effect("The pump loses up to 1 % of its stroke as it warms up.", "", """
components: {warm: {is: FlowSource, u: "=-pump.u*0.01*(1 - exp(-time/10 s))"}}
nodes: {line: [+warm.a]}
""")))

OVEN = Bed(
    "oven", "A heating element warms the chamber of a laboratory oven.", """
components:
  heater:  {is: HeatSource, u: 0 W}
  element: {is: HeatCapacity, m: 1.5 kg, c: 460 J/(kg*K)}
  contact: {is: ThermalResistance, R: 0.08 K/W}
  chamber: {is: HeatCapacity, m: 8 kg, c: 460 J/(kg*K)}
  lining:  {is: ThermalResistance, R: 0.35 K/W}
  room:    {is: Ambient}
nodes:
  element: [heater.a, element.a, contact.a]
  chamber: [contact.b, chamber.a, lining.a]
  room:    [lining.b, room.a]
initial: {element.T: 293.15 K, chamber.T: 293.15 K}
""",
    {"heater.u": Input("W", stairs(0.0, 800.0, (500.0, 1500.0), 80.0, 0.0))},
    {"element.T": Channel("element.T", "K", 0.15), "chamber.T": Channel("chamber.T", "K", 0.15)},
    """
contact.R: 0.08 K/W +- 15 %
lining.R: 0.35 K/W +- 15 %
element.m: 1.5 kg +- 10 %
chamber.m: 8 kg +- 10 %
""", (
        Effect("Heat flows from the element past the chamber to the room with 0.6 W/K.",
               "heat loss: element room | natural convection: element room | heat radiation: element room", """
components: {loss: {is: Convection, h: 0.6 W/(m**2*K)}}
nodes: {element: [+loss.a], room: [+loss.b]}
"""),
        Effect("The thermometer of the chamber lags by 20 s.", "lag: chamber.T | delay: chamber.T",
               "components: {thermometer: {is: FirstOrderLag, T_1: 20 s, u: =chamber.T}}",
               read={"chamber.T": "thermometer.y"})),
    9000.0, 0.1, 41.7, (0.41, 0.25))

FEED_LINE = Bed(
    "feed_line", "A pump feeds a tool through a filter; the tool is an orifice to the tank.", """
components:
  pump:   {is: FlowSource, u: 10 L/min}
  near:   {is: Volume, V: 3 L, beta: 1.4 GPa}
  filter: {is: Orifice, q_r: 30 L/min, dp_r: 8 bar}
  far:    {is: Volume, V: 15 L, beta: 1.4 GPa}
  tool:   {is: Orifice, q_r: 30 L/min, dp_r: 90 bar}
  tank:   {is: Tank}
nodes:
  near: [pump.a, near.a, filter.a]
  far:  [filter.b, far.a, tool.a]
  tank: [tool.b, tank.a]
initial: {near.p: 10.9 bar, far.p: 10 bar}
""",
    {"pump.u": Input("L/min", stairs(6.0, 30.0, (0.8, 2.5), 0.15, 10.0))},
    {"near.p": Channel("near.p", "bar", 0.15), "far.p": Channel("far.p", "bar", 0.15)},
    """
filter.q_r: 30 L/min +- 10 %
tool.q_r: 30 L/min +- 10 %
near.beta: 1.4 GPa +- 20 %
""", (
        Effect("The line between filter and tool has a laminar resistance of 3.7 bar at 10 L/min.",
               "line resistance: far filter | line resistance: near filter", """
components: {line: {is: LineResistance, R: 2.2e9 Pa*s/m**3}}
nodes: {far: [-filter.b, +line.b], joint: [filter.b, line.a]}
"""),
        Effect("Leakage of the pump to the tank, 1.2 L/min at 50 bar.", "leakage: near tank", """
components: {worn: {is: LaminarLeakage, C: 4e-12 m**3/(s*Pa)}}
nodes: {near: [+worn.a], tank: [+worn.b]}
""")), 30.0, 20.0, 116.0, (0.44, 0.18))

TURNTABLE = Bed(
    "turntable", "A servo motor drives a turntable through a gear and a shaft.", """
components:
  motor: {is: TorqueSource, u: 0 N*m}
  rotor: {is: Inertia, J: 0.004 kg*m**2}
  gear:  {is: Gear, i: 5}
  shaft: {is: TorsionSpringDamper, c: 900 N*m/rad, d: 3 N*m*s/rad}
  table: {is: Inertia, J: 0.35 kg*m**2}
  oil:   {is: RotationalDamper, d: 1.2 N*m*s/rad}
  frame: {is: FixedShaft}
nodes:
  rotor:  [motor.a, rotor.a, gear.a]
  output: [gear.b, shaft.a]
  table:  [shaft.b, table.a, oil.b]
  frame:  [frame.a, oil.a]
initial: {table.phi: 0 rad, table.w: 0 rad/s, rotor.phi: 0 rad, rotor.w: 0 rad/s}
""",
    {"motor.u": Input("N*m", waves(-2.5, 2.5, 0.15, 1.5, 0.0))},
    {"rotor.w": Channel("rotor.w", "rad/s", 0.1), "table.phi": Channel("table.phi", "rad", 5e-4, step=1e-3, late=0.004)},
    """
shaft.c: 900 N*m/rad +- 15 %
oil.d: 1.2 N*m*s/rad +- 20 %
table.J: 0.35 kg*m**2 +- 10 %
""", (
        Effect("Dry friction of 0.9 N*m in the bearing of the table.", "dry friction: frame table", """
components: {bearing: {is: RotationalCoulombFriction, M_c: 0.9 N*m}}
nodes: {frame: [+bearing.a], table: [+bearing.b]}
"""),
        Effect("Backlash of 8 mrad on each side between gear and shaft.",
               "backlash: gear output | backlash: shaft | backlash: shaft table | backlash: gear rotor", """
components: {play: {is: GearBacklash, gap: 8 mrad, c: 2e4 N*m/rad, d: 2 N*m*s/rad}}
nodes: {output: [-shaft.a, +play.a], coupling: [shaft.a, play.b]}
initial: {coupling.phi: ~ 0 rad}
""")), 6.0, 150.0, 27200.0, (1.1, 0.015, 0.0044),
    clutter=(Effect("The rotor has 2 % more inertia.", "", "set: {rotor.J: 0.00408 kg*m**2}"),
             Effect("The teeth of the gear ripple by 0.03 N*m.", "", """
components: {teeth: {is: TorqueSource, u: "=0.03 N*m*sin(24*rotor.phi)"}}
nodes: {rotor: [+teeth.a]}
""")))

BUOY = Bed(
    "buoy", "Waves push a moored buoy.", """
components:
  sea:     {is: ForceSource, u: 0 N}
  buoy:    {is: Mass, m: 800 kg}
  mooring: {is: Spring, c: 3 kN/m}
  water:   {is: Damper, d: 500 N*s/m}
  anchor:  {is: Fixed}
nodes:
  buoy:   [sea.a, buoy.a, mooring.b, water.b]
  anchor: [anchor.a, mooring.a, water.a]
initial: {buoy.x: 0 m, buoy.v: 0 m/s}
""",
    {"sea.u": Input("N", waves(-2000.0, 2000.0, 2.2, 9.0, 0.0))},
    {"buoy.x": Channel("buoy.x", "m", 5e-3), "acceleration": Channel("der(buoy.v)", "m/s**2", 0.02)},
    """
buoy.m: 800 kg +- 10 %
mooring.c: 3 kN/m +- 10 %
water.d: 500 N*s/m +- 30 %
""", (
        Effect("Drag of 350 N at 1 m/s.", "quadratic damping: anchor buoy", """
components: {drag: {is: Drag, d_2: 350 N*s**2/m**2}}
nodes: {anchor: [+drag.a], buoy: [+drag.b]}
"""),
        Effect("The mooring hardens by 500 N/m**3.", "nonlinear stiffness: anchor buoy | nonlinear stiffness: mooring", """
components: {chain: {is: CubicSpring, c_3: 500 N/m**3}}
nodes: {anchor: [+chain.a], buoy: [+chain.b]}
"""),
        Effect("Dry friction of 80 N at the fairlead.", "dry friction: anchor buoy", """
components: {fairlead: {is: CoulombFriction, F_c: 80 N, v_t: 5 mm/s}}
nodes: {anchor: [+fairlead.a], buoy: [+fairlead.b]}
""")), 80.0, 8.0, 145.0, (3.1, 0.42, 0.094))

VESSELS = Bed(
    "vessels", "Compressed air fills two vessels in a row, from which it is drawn.", """
components:
  supply: {is: PneumaticSource, p_0: 8 bar}
  inlet:  {is: PneumaticValve, C: 6e-9 kg/(s*Pa), b_cr: 0.3, u: 0.5}
  first:  {is: Receiver, V: 40 L}
  pipe:   {is: PneumaticOrifice, C: 5e-9 kg/(s*Pa), b_cr: 0.4}
  second: {is: Receiver, V: 25 L}
  tool:   {is: PneumaticOrifice, C: 2.5e-9 kg/(s*Pa), b_cr: 0.3}
  air:    {is: Atmosphere}
nodes:
  supply: [supply.a, inlet.a]
  first:  [inlet.b, first.a, pipe.a]
  second: [pipe.b, second.a, tool.a]
  air:    [tool.b, air.a]
initial: {first.p: 4 bar, second.p: 3.6 bar}
""",
    {"inlet.u": Input("1", stairs(0.05, 1.0, (4.0, 14.0), 0.6, 0.5))},
    {"first.p": Channel("first.p", "bar", 0.005, step=0.01), "second.p": Channel("second.p", "bar", 0.005, step=0.01)},
    """
inlet.C: 6e-9 kg/(s*Pa) +- 10 %
pipe.C: 5e-9 kg/(s*Pa) +- 10 %
tool.C: 2.5e-9 kg/(s*Pa) +- 10 %
""", (
        Effect("The gas in the first vessel exchanges heat with the wall, 8 W/K.",
               "heat exchange: first | polytropic exponent: first", """
components: {first: {is: ReceiverWithHeat, V: 40 L, G: 8 W/K}}
initial: {first.T: 293.15 K}
"""),
        Effect("The first vessel leaks to the atmosphere, 0.5 g/s at 4 bar.", "leakage: air first", """
components: {crack: {is: PneumaticOrifice, C: 1.25e-9 kg/(s*Pa), b_cr: 0.2}}
nodes: {first: [+crack.a], air: [+crack.b]}
""")), 100.0, 5.0, 23.4, (0.61, 0.35, 0.023),
    clutter=(Effect("The vessels are 2 % smaller and 2 % larger.", "", "set: {first.V: 39.2 L, second.V: 25.5 L}"),
             Effect("The supply falls by 1 % as the compressor rests.", "", """
components: {lag: {is: PneumaticFlowSource, u: "=-0.01*inlet.m*time/100 s"}}
nodes: {first: [+lag.a]}
"""),
             Effect("The gauge of the second vessel reads 0.3 % too much.", "", read={"second.p": "1.003*({})"})))

COMPENSATOR = Bed(
    "compensator", "An active heave compensator holds the bit on the formation in an irregular sea.",
    f"extends: {(MODELS / 'cmc_ahc' / 'designed.yaml').resolve()}",
    {"vessel.u": Input("m", waves(-0.9, 0.9, 6.0, 16.0, 0.0))},
    {"WOB": Channel("drilling.formation.N", "kN", 0.5), "extension": Channel("crown.x - platform.x", "m", 1e-3, step=2e-3),
     "p_main": Channel("cmc.main_cylinder.p", "bar", 0.5), "p_A": Channel("ahc.chamber_a.p", "bar", 0.5, step=0.5),
     "p_B": Channel("ahc.chamber_b.p", "bar", 0.5, step=0.5), "spool": Channel("ahc.valve.x", "1", 5e-3)},
    """
cmc.gas.c: 42 kN/m +- 10 %
cmc.gas.d: 52 kN*s/m +- 20 %
drilling.string.c: 298 kN/m +- 5 %
drilling.formation.c: 1000 kN/m +- 20 %
ahc.valve.q_r: 920 L/min +- 10 %
ahc.cylinder.beta: 1.75e9 Pa +- 20 %
""", (
        Effect("Leakage past the active piston, 90 L/min at 100 bar.",
               "internal leakage: ahc.cylinder | leakage: ahc.chamber_a ahc.chamber_b",
               "set: {ahc.cylinder.leakage: 1.5e-10 m**3/(s*Pa)}"),
        Effect("Dry friction of 8 kN with stiction of 12 kN in the main cylinder.",
               "dry friction: cmc.friction | dry friction: crown platform | pressure-dependent friction: crown platform",
               "set: {cmc.friction.F_c: 8 kN, cmc.friction.F_s: 12 kN}"),
        Effect("The spool sensor reads 0.03 too much.", "sensor offset: spool", read={"spool": "{} + 0.03"})),
    60.0, 10.0, 637.0, (0.98, 0.086, 0.0094, 0.01),
    clutter=(Effect("The load cell drifts by 4 kN.", "", read={"WOB": "{} + 4 kN*time/60 s"}),
             Effect("The crown block is 2 % heavier.", "", "set: {crown.m: 30.6 t}")))

FAN = Bed(
    "fan", "A DC motor drives a fan.", """
components:
  supply: {is: VoltageSource, u: 0 V}
  ground: {is: ElectricalGround}
  motor:  {is: DCMotor, R: 0.6 ohm, L: 0.3 mH, k: 46 mN*m/A, J: 140 g*cm**2}
  shaft:  {is: TorsionSpringDamper, c: 12 N*m/rad, d: 2 mN*m*s/rad}
  wheel:  {is: Inertia, J: 1500 g*cm**2}
  air:    {is: RotationalDamper, d: 0.2 mN*m*s/rad}
  frame:  {is: FixedShaft}
nodes:
  plus:  [supply.a, motor.a]
  zero:  [supply.b, motor.b, ground.a]
  rotor: [motor.s, shaft.a]
  wheel: [shaft.b, wheel.a, air.b]
  frame: [frame.a, air.a]
initial: {motor.i: 0 A, rotor.w: 0 rad/s, rotor.phi: 0 rad, wheel.w: 0 rad/s, wheel.phi: 0 rad}
""",
    {"supply.u": Input("V", waves(-16.0, 22.0, 0.25, 3.0, 0.0))},
    {"rotor.w": Channel("rotor.w", "rad/s", 1.0), "motor.i": Channel("motor.i", "A", 0.02)},
    """
motor.R: 0.6 ohm +- 10 %
wheel.J: 1500 g*cm**2 +- 10 %
air.d: 0.2 mN*m*s/rad +- 30 %
""", (
        Effect("Drag of the wheel, 0.24 N*m at 400 rad/s.", "quadratic damping: frame wheel", """
components: {drag: {is: RotationalDrag, k_2: 1.5e-6 N*m*s**2/rad**2}}
nodes: {frame: [+drag.a], wheel: [+drag.b]}
"""),
        Effect("Dry friction of 8 mN*m in the bearings.",
               "dry friction: motor | dry friction: frame rotor | dry friction: frame wheel", "set: {motor.M_c: 8 mN*m}"),
        Effect("The current sensor reads 6 % too much.", "sensor gain: motor.i", read={"motor.i": "1.06*({})"})),
    8.0, 100.0, 126.0, (1.3, 0.056, 0.0094, 0.011),
    clutter=(Effect("The winding warms up, by 3 % of its resistance.", "", """
components: {warm: {is: VoltageSource, u: "=0.03*motor.R*motor.i*(1 - exp(-time/4 s))"}}
nodes: {plus: [-motor.a, +warm.a], winding: [warm.b, motor.a]}
"""),
             Effect("The wheel is out of balance by 4 mN*m in its weight.", "", """
components: {heavy: {is: TorqueSource, u: "=-4 mN*m*sin(wheel.phi)"}}
nodes: {wheel: [+heavy.a]}
""")))

WINCH = Bed(
    "winch", "A pump drives the hydraulic motor of a winch that hauls a load.", """
components:
  pump:  {is: FlowSource, u: 0 L/min}
  hose:  {is: Volume, V: 1 L, beta: 1.2 GPa}
  motor: {is: HydraulicMotor, D: 50 cm**3/rev, nu: 46 mm**2/s}
  tank:  {is: Tank}
  drum:  {is: Inertia, J: 0.3 kg*m**2}
  drag:  {is: RotationalDamper, d: 0.6 N*m*s/rad}
  load:  {is: ConstantTorque, tau: -40 N*m}
  frame: {is: FixedShaft}
nodes:
  hose:  [pump.a, hose.a, motor.a]
  tank:  [motor.b, tank.a]
  drum:  [motor.s, drum.a, drag.b, load.a]
  frame: [frame.a, drag.a]
initial: {hose.p: 50.3 bar, drum.w: 0 rad/s}
""",
    {"pump.u": Input("L/min", stairs(8.0, 30.0, (1.5, 3.5), 0.8, 0.0))},
    {"hose.p": Channel("hose.p", "bar", 0.3, step=0.5), "drum.w": Channel("drum.w", "rad/s", 0.3)},
    """
drag.d: 0.6 N*m*s/rad +- 20 %
hose.beta: 1.2 GPa +- 20 %
""", (
        Effect("Leakage of the motor, 1.5 L/min at 50 bar.", "internal leakage: motor | leakage: hose tank",
               "set: {motor.eta_v: 0.92}"),
        Effect("The hose gives way, 0.15 cm**3/bar.", "hose compliance: hose",
               """
components: {wall: {is: Hose, C: 1.5e-12 m**3/Pa}}
nodes: {hose: [+wall.a]}
""")), 20.0, 40.0, 222.0, (0.82, 0.12, 0.017),
    clutter=(Effect("The load is 2 % heavier, and the drum 3 %.", "", "set: {load.tau: -40.8 N*m, drum.J: 0.309 kg*m**2}"),
             Effect("The bearings lose drag as they warm up.", "", """
components: {warm: {is: TorqueSource, u: "=0.06 N*m*s/rad*drum.w*time/20 s"}}
nodes: {drum: [+warm.a]}
"""),
             Effect("The speed signal lags by 8 ms.", "", "components: {tacho: {is: FirstOrderLag, T_1: 8 ms, u: =drum.w}}",
                    read={"drum.w": "tacho.y"})))

BEDS = {bed.name: bed for bed in (AXIS, LIFT, OVEN, FEED_LINE, TURNTABLE, BUOY, VESSELS, COMPENSATOR, FAN, WINCH)}

if __name__ == "__main__":
    main(BEDS, "several", __doc__)
