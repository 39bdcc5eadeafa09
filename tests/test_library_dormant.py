"""Effects that sleep in components, awake beside formulas of their own: what each adds to the law without it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from library_check import Found, agree, checks, part, run
from numpy.typing import ArrayLike

BAR, LPM, PI = 1e5, 1e-3/60, np.pi
C = 1e-12                       # m**3/(s*Pa)
LEAKAGE = {"leakage": "1e-12 m**3/(s*Pa)"}
RATED = {"q_r": "40 L/min", "dp_r": "5 bar"}


def added(name: str, effect: Mapping[str, object], given: Mapping[str, ArrayLike], **data: object) -> Found:
    """What an effect adds to each number of a component."""
    with_it, without = (part(name, **data, **awake)(given) for awake in (effect, {}))
    found = Found()
    found.update({key: with_it[key] - without[key] for key in with_it})
    return found


LEAKS: list[tuple[str, str, str, dict[str, Any], dict[str, ArrayLike]]] = [
    # component, a port with one edge and that to which it leaks, data, what is given besides the pressures
    ("PriorityValve", "C", "P", RATED, {"y": 0.4, "E.p": 40*BAR, "X.p": 0}),
    ("PriorityValve", "E", "P", RATED, {"y": 0.4, "C.p": 40*BAR, "X.p": 0}),
    ("UnloadingValve", "P", "T", {**RATED, "p_0": "100 bar"}, {"y": 0, "X.p": 0}),
    ("PilotReliefValve", "P", "T", {**RATED, "p_0": "200 bar", "beta": "1.4 GPa"}, {"y": 0, "X.p": 0, "X.q": 0}),
    ("PressureCompensator", "P", "A", {**RATED, "p_0": "10 bar"}, {"y": 0, "X.p": 0}),
    ("LogicValve", "A", "B", RATED, {"y": 0, "X.p": 0}),
    ("ProportionalReliefValve", "a", "b", {**RATED, "p_n": "200 bar"}, {"y": 0, "p_u": 0, "u": 0}),
    ("ProportionalReducingValve", "P", "A", {**RATED, "p_n": "20 bar"}, {"y": 0, "p_u": 0, "u": 0, "T.p": 12*BAR}),
    ("ProportionalReducingValve", "T", "A", {**RATED, "p_n": "20 bar"}, {"y": 0, "p_u": 0, "u": 0, "P.p": 50*BAR}),
    ("PressureReducingValve", "P", "A", {**RATED, "p_0": "20 bar"}, {"y": 0, "T.p": 12*BAR}),
    ("FlowControlValve", "a", "b", {"q_r": "40 L/min"}, {"u": 0}),
    ("FlowDivider", "A", "B", {"q_r": "40 L/min"}, {"P.p": 60*BAR, "y": 0}),
]


@checks(*{name for name, *_ in LEAKS})
def test_leakage_flows_from_port_to_port() -> None:
    """C times the drop, both ways, and what enters at one port leaves at another."""
    p = np.array([150, 10, 50])*BAR
    for name, moved, other, data, given in LEAKS:
        found = added(name, LEAKAGE, {**given, f"{moved}.p": p, f"{other}.p": 50*BAR}, **data)
        agree(found[f"{moved}.q"], C*(p - 50*BAR), rtol=1e-8)
        ports = [f"{port}.q" for port in "PABCETXab" if f"{port}.q" in found]
        agree(sum(found[q] for q in ports), 0, rtol=1e-8, size=C*100*BAR)


@checks("TelescopicCylinder", "PressureIntensifier", "Poppet", "OilReliefValve", "OilValve")
def test_leakage_out_of_chambers_and_past_seats() -> None:
    cylinder = {"n": 2, "A_s": "[80 cm**2, 50 cm**2]", "x": "[0.5 m, 1.2 m]", "V_0": "1 L", "beta": "1.4 GPa"}
    found = added("TelescopicCylinder", LEAKAGE, {"a.x": 0, "b.x": 0.2, "a.v": 0, "b.v": 0, "A.p": 60*BAR, "A.q": 0},
                  **cylinder)
    agree(found["der(A.p)"], -1.4e9/(1e-3 + 80e-4*0.2)*C*60*BAR)
    given = {"A.p": 50*BAR, "B.p": 300*BAR, "x": 0.1, "v": np.array([0.3, 0.5e-3, -0.3])}
    found = added("PressureIntensifier", {**LEAKAGE, "F_c": "500 N"}, given, A_A="80 cm**2", A_B="10 cm**2", s_m="0.2 m")
    agree(found["B.q"], C*300*BAR)
    agree(found["der(v)"], -500/5*np.tanh(np.array([300, 0.5, -300])))
    agree(found["A.q"], 0, size=1)
    shut = {"a.p": 60*BAR, "b.p": np.array([10, 90])*BAR, "s.x": 0, "h.x": 0, "s.v": 0, "h.v": 0}
    found = added("Poppet", LEAKAGE, shut, d="8 mm", rho="850 kg/m**3")
    agree(found["a.q"], C*np.array([50, -30])*BAR, rtol=1e-6)
    agree(found["s.f"], 0, size=1)
    oil = {"rho": "860 kg/m**3", "alpha": "7e-4 1/K", "beta": "1.4 GPa", "k_T": "6e-3 1/K", "c_p": "1950 J/(kg*K)",
           "T_0": "313.15 K"}
    for name, own, more in (("OilReliefValve", {"C": "1e-9 m**3/(s*Pa)", "dp_0": "200 bar"}, {}),
                            ("OilValve", {"q_r": "40 L/min", "dp_r": "5 bar"}, {"u": 0})):
        found = added(name, LEAKAGE, {"a.p": 60*BAR, "b.p": 10*BAR, "a.T": 313.15, "b.T": 313.15, **more}, **own, **oil)
        # at the density at 35 bar, d rho/rho = dp/beta
        agree(found["a.m"], C*50*BAR*860*np.exp(35*BAR/1.4e9), rtol=1e-4)
        agree(found["a.H"] + found["b.H"], 0, size=1)


@checks("PressureCompensator", "LogicValve")
def test_flow_forces_close_a_spool_and_a_poppet() -> None:
    """The jet through an edge of the area y*A pushes with rho q v cos(theta) on a spool of the area A_s."""
    k_f = 2*0.61*20e-6*np.cos(np.radians(69))/78.5e-6      # of a spool of 10 mm
    y, drop = 0.5, 90*BAR
    force = 870*(0.61*y*20e-6*np.sqrt(2/870*drop))*np.sqrt(2/870*drop)*np.cos(np.radians(69))
    given = {"P.p": 151.5*BAR, "A.p": 61.5*BAR, "X.p": 52*BAR, "y": y}
    data = {**RATED, "p_0": "10 bar", "p_b": "9 bar", "T_v": "5 ms"}
    found = part("PressureCompensator", **data, k_f=k_f)(given)
    agree(found["der(y)"], (max((10*BAR - force/78.5e-6 - 9.5*BAR)/(9*BAR), 0) - y)/5e-3)
    wide = part("PressureCompensator", **{**data, "p_0": "30 bar", "p_b": "20 bar"}, k_f=k_f)(given)
    agree(wide["der(y)"], ((30*BAR - force/78.5e-6 - 9.5*BAR)/(20*BAR) - y)/5e-3, rtol=1e-6)
    found = part("LogicValve", **RATED, p_0="2 bar", p_b="30 bar", T_v="10 ms", k_f=0.1)(
        {"A.p": 20*BAR, "B.p": 10*BAR, "X.p": 0, "y": 0.5})
    agree(found["der(y)"], ((20 + 0.07*10 - 2 - 0.1*0.5*10)/30 - 0.5)/10e-3, rtol=1e-6)


@checks("SpoolEdge")
@pytest.mark.parametrize("side", [1, -1])
def test_the_oil_that_a_spool_accelerates_damps_it(side: int) -> None:
    """Merritt, section 5.6: the momentum rho L q of the oil from the inlet to the edge changes as the edge opens."""
    data = {"d": "12 mm", "side": side, "c_r": "1e-9 m", "rho": "850 kg/m**3"}
    given = {"a.p": 80*BAR, "b.p": 10*BAR, "s.x": side*0.2e-3, "h.x": 0, "s.v": side*0.5, "h.v": 0}
    found = added("SpoolEdge", {"L_d": "30 mm"}, given, **data)
    rate = 0.61*PI*0.012*0.5*np.sqrt(2/850*70*BAR)         # dq/dt at 0.5 m/s
    agree(found["s.f"], side*850*0.03*rate, rtol=1e-4)
    agree(found["s.f"] + found["h.f"], 0, size=1)
    agree(found["a.q"], 0, size=1)


@checks("ProportionalReliefValve", "ProportionalReducingValve")
def test_hysteresis_of_proportional_pressure_valves_is_its_width() -> None:
    for name, set_to in (("ProportionalReliefValve", 6*BAR + 194*BAR*0.5), ("ProportionalReducingValve", 100*BAR)):
        width = 0.04*200*BAR
        below, above = set_to - np.array([15, 4, 3])*BAR, set_to + np.array([15, 4, 3])*BAR
        law = part(name, **RATED, p_n="200 bar", hysteresis=0.04, T_u="50 ms")
        still = {"y": 0, **({"a.p": 0, "b.p": 0} if "Relief" in name else {"P.p": 0, "A.p": 0, "T.p": 0})}
        for p_u, way in ((below, 1), (above, -1)):
            agree(law({**still, "u": 0.5, "p_u": p_u})["der(p_u)"],
                  way*np.maximum(np.array([15, 4, 3])*BAR - width/2, 0)/0.05, size=1e7)
    # a slow triangle of the signal from 0.2 to 0.8 and back: the settings at one signal are apart by the width
    found = run("""
model: loop
components:
  pump: {is: PressureSource, p_0: 0 bar}
  tank: {is: Tank}
  part: {is: ProportionalReliefValve, p_n: 200 bar, q_r: 40 L/min, hysteresis: 0.04, T_u: 5 ms,
         u: "=0.5 + 0.3*sin(2*pi*time/20 s)"}
nodes: {line: [pump.a, part.a], back: [part.b, tank.a]}
initial: {part.p_u: 103 bar, part.y: 0}
simulate: {until: 30 s, every: 10 ms}
""")
    up, down = (np.interp(t, found.time, found.si["part.p_u"]) for t in (20, 30))
    lag = 194*BAR*0.3*2*PI/20*5e-3
    agree(down - up, 0.04*200*BAR + 2*lag, rtol=1e-4)


@checks("TwoStageServoValve43")
def test_overlap_of_a_servo_valve() -> None:
    data = {"q_r": "40 L/min", "f_n": "500 Hz", "K_v": "500 1/s", "t_s": "5 ms", "dp_t": "1e-3 Pa"}
    given = {"P.p": 200*BAR, "T.p": 0, "A.p": 60*BAR, "B.p": 30*BAR, "u": 0, "x_f": 0, "w_f": 0}
    for overlap in (0.1, -0.1):
        x = np.array([-1, -0.3, -0.05, 0, 0.05, 0.3, 1])
        found = part("TwoStageServoValve43", **data, overlap=overlap)({**given, "x": x})
        opened, back = (np.maximum(way*x - overlap, 0)/(1 - overlap) for way in (1, -1))
        agree(found["A.q"], 40*LPM*(back*np.sqrt(60/35) - opened*np.sqrt(140/35)), rtol=1e-6, size=1e-4)
        agree(found["B.q"], 40*LPM*(opened*np.sqrt(30/35) - back*np.sqrt(170/35)), rtol=1e-6, size=1e-4)


@checks("CentrifugalPump")
def test_a_worn_pump_has_less_head_by_what_flows_back() -> None:
    law = part("CentrifugalPump", H_0="40 m", H_r="30 m", q_r="5 L/s", w_r="2900 rpm", eta=0.7, rho="1000 kg/m**3",
               dp_t="1e-2 Pa", leakage="2e-9 m**3/(s*Pa)")
    rise = 9810*np.array([30, 37.5])
    found = law({"a.p": 0, "b.p": rise, "s.w": 2900*2*PI/60})
    through = 5e-3*np.array([1, 0.5])
    agree(found["a.q"], through - 2e-9*rise, rtol=1e-6)
    agree(found["s.tau"], 9810*30*5e-3/(0.7*2900*2*PI/60)*(0.5 + 0.5*through/5e-3), rtol=1e-6)   # of the impeller


@checks("AirMotor", "PneumaticValve53")
def test_air_leaks_through_motors_and_valves() -> None:
    """ISO 6358: choked below the critical ratio, m = C rho_0 p_1 sqrt(T_0/T_1)."""
    sonic = 1e-9*1.185*6e5*np.sqrt(293.15/300)
    given = {"a.p": 6e5, "b.p": 1e5, "a.T": 300, "b.T": 280, "s.w": 0}
    law = part("AirMotor", D="60 cm**3/rev", leakage="1e-9 m**3/(s*Pa)", G="1e-9 W/K")
    found = law(given)
    agree([found["a.m"], found["b.m"]], [sonic, -sonic], rtol=1e-5)
    agree([found["a.H"], found["b.H"]], [1005*sonic*300, -1005*sonic*300], rtol=1e-5)   # throttled, no work
    turning = {**given, "s.w": 100.0}
    more = added("AirMotor", {"leakage": "1e-9 m**3/(s*Pa)"}, turning, D="60 cm**3/rev")
    agree([more["a.m"], more["s.tau"]], [sonic, 0], rtol=1e-5, size=1)
    data = {"C": "2e-8 m**3/(s*Pa)", "b_cr": 0.3, "t_s": "20 ms"}
    ports = {f"{port}.{what}": value for port, p in (("P", 6e5), ("A", 1.2e5), ("B", 1.5e5), ("R", 1e5), ("S", 1e5))
             for what, value in (("p", p), ("T", 300))}
    more = added("PneumaticValve53", {"leakage": "1e-9 m**3/(s*Pa)"}, {**ports, "u": 0, "x": 0}, **data)
    agree(more["P.m"], 2*sonic, rtol=1e-4)                  # to A and to B, both choked


@checks("PowerScrew", "OneWayClutch", "LockingClutch", "WinchDrum", "RotaryFlowDivider")
def test_drag_and_friction_of_the_drive_train() -> None:
    screw = {"h": "5 mm", "d_2": "20 mm", "mu": 0.1, "c": "1e8 N/m", "d": 0}
    for w in (10.0, -10.0):
        given, guess = {"b.f": -300, "a.w": w, "b.v": w*5e-3/(2*PI)}, {"S": 300.0, "e": 3e-6}
        plain, awake = (part("PowerScrew", **screw, **own)(given, guess) for own in ({}, {"r_c": "1.5 mm"}))
        agree(awake["a.tau"] - plain["a.tau"], np.sign(w)*1.5e-3*300)       # the collar carries the axial force
    speeds = np.array([-20, -0.05, 0, 3])
    more = added("OneWayClutch", {"M_d": "2 N*m"}, {"a.w": 5 + speeds, "b.w": 5, "theta": 0, "on": 0}, c="100 N*m/rad")
    agree(more["b.tau"], 2*np.array([1, np.tanh(0.5), 0, 0]), size=1)       # b overruns and is braked, a is driven
    agree(more["a.tau"] + more["b.tau"], 0, size=1)
    found = run("""
model: open
components:
  first:  {is: Inertia, J: 2 kg*m**2}
  part:   {is: LockingClutch, M_max: 12 N*m, u: 0, d: 0.5 N*m*s/rad}
  second: {is: Inertia, J: 3 kg*m**2}
nodes: {first: [first.a, part.a], second: [part.b, second.a]}
initial: {first.w: 10 rad/s, second.w: 0 rad/s}
simulate: {until: 4 s, every: 10 ms}
""")
    agree(found["part.w"], -10*np.exp(-0.5*(1/2 + 1/3)*found.time), rtol=1e-5)   # an open wet clutch takes the other along
    agree(2*found["first.w"] + 3*found["second.w"], 20, rtol=1e-7)
    drum = {"n": 1, "D": "300 mm", "d": "16 mm", "z": 40}
    for w, share in ((3.0, 1.1), (-3.0, 0.9)):
        found = part("WinchDrum", **drum, loss=0.1)({"a.phi": 0, "a.w": w, "b.f": -1e3})
        agree(found["a.tau"], share*0.158*1e3)
    more = added("RotaryFlowDivider", {"d_w": "0.1 N*m*s/rad"}, {"P.p": 0, "A.p": 0, "B.p": 0, "w": 100},
                 D_A="10 cm**3/rev", D_B="30 cm**3/rev")
    agree(more["der(w)"], -0.1*100/1e-3)


@checks("Solenoid", "InductionMotor", "StepperMotor")
def test_losses_of_electrical_machines() -> None:
    # R, and L beside 1/G_e: closed forms of the circuit, with the plunger held
    R, L, G = 5.0, 0.01 + 0.08/4, 0.05
    found = run("""
model: coil
components:
  battery: {is: VoltageSource, u: 24 V}
  ground:  {is: ElectricalGround}
  frame:   {is: Fixed}
  plunger: {is: Fixed, x0: 2.5 mm}
  part:    {is: Solenoid, R: 5 ohm, L_0: 10 mH, L_1: 80 mH, g_0: 0.5 mm, l0: 1 mm, G_e: 0.05 A/V}
nodes:
  plus:    [battery.a, part.a]
  minus:   [battery.b, part.b, ground.a]
  frame:   [frame.a, part.h]
  plunger: [plunger.a, part.s]
initial: {part.i: 0 A}
simulate: {until: 20 ms, every: 1 ms}
""")
    tau = L*(1 + R*G)/R
    agree(found["part.i"], 24/R*(1 - np.exp(-found.time/tau)), rtol=1e-6, size=1)
    agree(found["part.a.i"][0], 24/(R + 1/G), rtol=1e-6)                   # at first through the iron alone
    motor = {"R_s": "1 ohm", "R_r": "1 ohm", "L_s": "5 mH", "L_r": "5 mH", "L_m": "100 mH", "z_p": 2, "J": "0.01 kg*m**2"}
    given = {"a.v": 0, "b.v": 0, "n.v": 0, "i_a": 1, "i_b": 2, "j_a": 3, "j_b": 4, "s.tau": 0,
             "s.w": np.array([50, 0.05, -50])}
    more = added("InductionMotor", {"d_v": "0.02 N*m*s/rad", "M_c": "0.3 N*m"}, given, **motor)
    agree(more["der(s.w)"], -(0.02*given["s.w"] + 0.3*np.tanh(given["s.w"]/0.1))/0.01)
    stepper = {"R": "2 ohm", "L": "4 mH", "M_h": "1 N*m", "I_r": "2 A", "n": 200, "J": "1e-5 kg*m**2"}
    angle = np.linspace(0, 0.1, 9)
    more = added("StepperMotor", {"M_d": "0.03 N*m"}, {"a.v": 0, "b.v": 0, "c.v": 0, "d.v": 0, "i_1": 1, "i_2": 0,
                                                       "s.tau": 0, "s.w": 0, "s.phi": angle}, **stepper)
    agree(more["der(s.w)"], -0.03*np.sin(200*angle)/1e-5)


@checks("VoiceCoil")
def test_losses_of_a_voice_coil() -> None:
    # held: R, and L beside 1/G_e, a closed form of the circuit; the force is that of the current of the winding
    found = run("""
model: coil
components:
  battery: {is: VoltageSource, u: 24 V}
  ground:  {is: ElectricalGround}
  frame:   {is: Fixed}
  slide:   {is: Fixed, x0: 12 mm}
  part:    {is: VoiceCoil, R: 5 ohm, L: 30 mH, k: 20 N/A, l0: 2 mm, G_e: 0.05 A/V, c_k: 5000 1/m**2}
nodes:
  plus:  [battery.a, part.a]
  minus: [battery.b, part.b, ground.a]
  frame: [frame.a, part.h]
  slide: [slide.a, part.s]
initial: {part.i: 0 A}
simulate: {until: 20 ms, every: 1 ms}
""")
    R, L, G = 5.0, 0.03, 0.05
    decay = np.exp(-found.time*R/(L*(1 + R*G)))
    agree(found["part.i"], 24/R*(1 - decay), rtol=1e-6, size=1)
    winding = 24/R*(1 - decay) + G*24*decay/(1 + R*G)
    agree(found["part.a.i"], winding, rtol=1e-6)
    agree(found["part.F"], 20/(1 + 5000*0.01**2)*winding, rtol=1e-6)       # 10 mm from the middle: 2/3 of k
    data, speed = {"R": "5 ohm", "L": "30 mH", "k": "20 N/A"}, np.array([0.5, 1e-3, -0.2])
    given: dict[str, ArrayLike] = {"a.v": 24, "b.v": 0, "i": 1, "s.x": 0, "h.x": 0, "s.v": speed + 0.1, "h.v": 0.1}
    more = added("VoiceCoil", {"d": "8 N*s/m", "F_c": "3 N"}, given, **data)
    agree(more["s.f"], 8*speed + 3*np.tanh(speed/1e-3))
    agree(more["h.f"], -more["s.f"])


@checks("PrismaticJoint", "RollingWheel")
def test_friction_of_guides_and_wheels() -> None:
    """A slide on a slope slips down with g (sin - mu cos); a wheel on the level slows down by c_r g/(1 + J/(m r**2))."""
    found = run("""
model: slope
components:
  base:  {is: PlanarFixed}
  part:  {is: PrismaticJoint, alpha: 30 deg, mu: 0.2}
  guide: {is: Fixed}
  body:  {is: PlanarBody, m: 3 kg, J: 0.1 kg*m**2}
  end:   {is: Free}
nodes: {base: [base.a, part.a], slide: [part.b, body.a], guide: [guide.a, part.h], end: [part.r, end.a]}
initial: {part.s: 0 m, end.v: -0.1 m/s}
simulate: {until: 0.5 s, every: 10 ms}
""")
    fall = 9.81*(np.sin(PI/6) - 0.2*np.cos(PI/6))
    agree(found.si["part.s"], -0.1*found.time - fall*found.time**2/2, rtol=1e-5)
    found = run("""
model: rolling
components:
  road: {is: PlanarFixed}
  part: {is: RollingWheel, r: 0.3 m, c_r: 0.02}
  body: {is: PlanarBody, m: 10 kg, J: 0.45 kg*m**2}
nodes: {road: [road.a, part.a], centre: [part.b, body.a]}
initial: {part.s: 0 m, centre.w: -10 rad/s}
simulate: {until: 2 s, every: 10 ms}
""")
    braking = 0.02*9.81/(1 + 0.45/(10*0.3**2))
    agree(found.si["part.s"], 3*found.time - braking*found.time**2/2, rtol=1e-5, size=1)


@checks("OilLine")
def test_a_line_cools_and_throttles() -> None:
    """Oil at rest in a warm pipe cools as M c dT/dt = U A (T_0 - T)."""
    found = run("""
model: cooling
components:
  oil:  {is: Oil, alpha: 0}
  part: {is: OilLine, length: 2 m, d: 20 mm, U: 400 W/(m**2*K)}
  a:    {is: OilFlowSource, u: 0 L/min}
  b:    {is: OilFlowSource, u: 0 L/min}
  room: {is: TemperatureSource, u: 293.15 K}
nodes: {left: [oil.a, a.a, part.a], right: [part.b, b.a], room: [part.h, room.a]}
initial: {part.oil.a.T: 333.15 K, part.oil.a.p: 0 bar}
simulate: {until: 60 s, every: 1 s}
""")
    rate = 400*PI*0.02*2/(860*PI/4*0.02**2*2*1950)
    # the oil that mixes over m_t at both ends conducts 0.1 W/K besides 50
    agree(found.si["part.oil.a.T"] - 293.15, 40*np.exp(-rate*found.time), rtol=4e-3)
