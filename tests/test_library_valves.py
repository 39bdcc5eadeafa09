"""Controlled and mapped pumps, pressure valves, dividers and building blocks of valves beside formulas of their sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from library_check import agree, checks, part, run
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

import heavebond as hb

Array = NDArray[np.float64]
BAR, LPM, PI = 1e5, 1e-3/60, np.pi
RPM = 2*PI/60
DISPLACEMENT = 45e-6/(2*PI)
DROPS = np.array([-200, -3, 0, 0.02, 4, 150])*BAR


def root(q_r: float, dp_r: float, dp: float) -> float:
    return float(np.sign(dp)*q_r*np.sqrt(abs(dp)/dp_r))


def rooted(q_r: float, dp_r: float, dp: ArrayLike) -> Array:
    """Orifice with the transition of 0.1 bar."""
    drop = np.asarray(dp, float)
    return np.asarray(q_r/np.sqrt(dp_r)*drop/(drop**2 + (0.1*BAR)**2)**0.25)


@dataclass(frozen=True)
class Case:
    """A signal of an example at its end, in SI, with its relative tolerance."""

    example: str
    signal: str
    expected: float
    tolerance: float = 1e-5   # of the transition at 0.1 bar, and what is left of the settling


def between(low: float, high: float, balance: Callable[[float], float]) -> float:
    return float(brentq(balance, low*BAR, high*BAR, xtol=1e-3))


LS = between(80, 100, lambda p: DISPLACEMENT*1500*RPM*min((100*BAR - p)/(5*BAR), 1) - root(30*LPM, 20*BAR, p - 80*BAR))
COMPENSATED = between(60, 70, lambda p: min((70*BAR - p)/(2*BAR), 1)*root(40*LPM, 5*BAR, 210*BAR - p)
                      - root(20*LPM, 9*BAR, p - 60*BAR))
SEQUENCE = between(100, 110, lambda p: (p - 100*BAR)/(10*BAR)*root(40*LPM, 5*BAR, p - 40*BAR) - 10*LPM)


def piloted() -> tuple[float, float]:
    """Pressure and opening of the pilot-operated valve that passes 60 L/min: its chamber from the balance of the pilot."""
    def pilot(p: float) -> float:
        return float(brentq(lambda x: root(1*LPM, 4*BAR, p - x)
                            - root(2*LPM, 200*BAR, x)*np.clip((x - 200*BAR)/(5*BAR), 0, 1), 150*BAR, p))

    def opening(p: float) -> float:
        return float(np.clip((p - pilot(p) - 4*BAR)/(4*BAR), 0, 1))

    p = between(200, 230, lambda p: opening(p)*root(200*LPM, 200*BAR, p) + root(1*LPM, 4*BAR, p - pilot(p)) - 60*LPM)
    return p, opening(p)


def shared() -> float:
    """Flow to the priority port: the spool stands where 30 L/min are divided."""
    def rest(y: float) -> tuple[float, float]:
        p_C = 50*BAR + 5*BAR + 2*BAR*y       # margin 7 bar less the band
        return p_C, root(8*LPM, 6*BAR, p_C - 50*BAR)

    def balance(y: float) -> float:
        p_C, q_C = rest(y)
        p = p_C + (q_C/((1 - y)*60*LPM))**2*5*BAR
        return y*root(60*LPM, 5*BAR, p) + q_C - 30*LPM

    return rest(brentq(balance, 1e-3, 0.9))[1]


def held_spool() -> float:
    """Opening at which the spring carries the flow force 2 C_d pi d x cos(69 deg) dp, the clearance of 5 um included."""
    k = 2*0.61*PI*0.01*np.cos(np.radians(69))*100*BAR
    return float(brentq(lambda x: 300e3*(0.5e-3 - x) - k*(x + np.hypot(x, 5e-6))/2, 0, 0.5e-3))


def lifted() -> float:
    """Pressure under the poppet: spring, seat and jet in balance at 20 L/min."""
    def area(x: float) -> float:
        s = np.sin(np.radians(45))
        return float(PI*x*s*(8e-3 - x*s*s))

    def pressure(x: float) -> float:
        return float((20*LPM/(0.77*area(x)))**2*870/2)

    def balance(x: float) -> float:
        p = pressure(x)
        return PI/4*8e-3**2*p - 2*0.77*area(x)*np.cos(np.radians(45))*p - 200 - 40e3*x

    return pressure(float(brentq(balance, 0.05e-3, 1e-3)))


CASES = [
    Case("load_sensing_pump", "line.p", LS),
    Case("power_controlled_pump", "pump.s.tau", 15e3/(1500*RPM)),
    # losses half way between those at the four points of the map
    Case("mapped_pump", "part.q", DISPLACEMENT*(1500*RPM - RPM*np.mean([40, 100, 60, 120]))),
    Case("mapped_pump", "part.s.tau", DISPLACEMENT*BAR*(200 + np.mean(
        [100*(1/0.93 - 1), 100*(1/0.92 - 1), 300*(1/0.95 - 1), 300*(1/0.94 - 1)]))),
    Case("piston_pump", "part.q", 45e-6*1*PI/7*sum(max(np.sin(2*PI*k/7), 0) for k in range(7))),
    Case("pressure_compensator", "middle.p", COMPENSATED),
    Case("priority_valve", "meter.q", shared(), 1e-4),
    Case("sequence_valve", "line.p", SEQUENCE),
    Case("pilot_relief_valve", "line.p", piloted()[0]),
    Case("pilot_relief_valve", "part.y", piloted()[1], 1e-4),
    Case("proportional_relief_valve", "line.p", between(
        125, 150, lambda p: (p - 125*BAR)/(25*BAR)*root(60*LPM, 100*BAR, p) - 30*LPM)),
    Case("proportional_reducing_valve", "clutch.p", between(
        11, 12, lambda p: (12*BAR - p)/(2*BAR)*root(10*LPM, 10*BAR, 40*BAR - p) - 1e-11*p)),
    Case("logic_valve", "line.p", between(2, 5, lambda p: (p - 2*BAR)/(3*BAR)*root(200*LPM, 5*BAR, p) - 100*LPM), 1e-3),
    Case("rotary_flow_divider", "supply.p", 60*BAR),
    Case("spool_edge", "part.x", held_spool()),
    Case("poppet", "line.p", lifted(), 1e-4),
    Case("two_stage_servo_valve43", "part.q_PA", 0.5*root(40*LPM, 35*BAR, 105*BAR)),
    # a sixth of the way from 0.4 to 1; linear in the root of the drop
    Case("tabulated_valve", "part.q", LPM*(lambda f: (5*5/6 + 20/6)*(1 - f) + (14*5/6 + 50/6)*f)(
        (np.sqrt(20) - np.sqrt(5))/(np.sqrt(35) - np.sqrt(5)))),
    Case("flow_divider", "part.q_A", 20.1737*LPM, 1e-3),   # the balance is checked below
    Case("unloading_valve", "part.on", 1.0),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_settles_at_its_balance(case: Case) -> None:
    found = hb.simulate(hb.load(f"examples/{case.example}"))
    assert float(found[f"1*{case.signal}"][-1]) == pytest.approx(case.expected, rel=case.tolerance)


# -- pumps -------------------------------------------------------------------------------------------------------------
@checks("LoadSensingPump", "PowerControlledPump", "PistonPump")
def test_pumps_have_losses_and_control_as_their_pages_tell() -> None:
    given = {"D": "45 cm**3/rev", "eta_v": 0.95, "eta_hm": 0.92}
    w, rise = 1500*RPM, 200*BAR
    lost = DISPLACEMENT*rise*(1/0.92 - 1)
    flow = {"LoadSensingPump": 0.6, "PowerControlledPump": 0.6}
    settings = {"LoadSensingPump": {"p_0": "250 bar"}, "PowerControlledPump": {"p_0": "250 bar", "M_0": "80 N*m"}}
    for name, x in flow.items():
        found = part(name, **given, **settings[name])({"a.p": 0, "b.p": rise, "s.w": w, "x": x, **(
            {"X.p": 0} if name == "LoadSensingPump" else {})})
        agree(found["b.q"], -DISPLACEMENT*w*(x - 0.05))
        agree(found["s.tau"], DISPLACEMENT*x*rise + lost, rtol=1e-8)
    law = part("LoadSensingPump", D="45 cm**3/rev", p_m="20 bar", p_b="5 bar", p_0="250 bar", T_x="40 ms")
    found = law({"a.p": 0, "X.p": np.array([100, 100, 100, 100, 240])*BAR,
                 "b.p": np.array([114, 117.5, 120, 130, 249])*BAR, "s.w": w, "x": 0.3})
    agree(found["der(x)"], (np.array([1, 0.5, 0, 0, 0.2]) - 0.3)/0.04)
    agree(found["X.q"], 0, size=1)
    law = part("PowerControlledPump", D="45 cm**3/rev", M_0="50 N*m", p_0="300 bar", p_b="10 bar", T_x="40 ms")
    rises = np.array([20, 100, 250, 297.5])*BAR
    power = np.minimum(50/(DISPLACEMENT*rises), 1)
    agree(law({"a.p": 0, "b.p": rises, "s.w": w, "x": 0.3})["der(x)"],
          (np.minimum(power, [1, 1, 1, 0.25]) - 0.3)/0.04)
    # a turn of the ripple delivers the displacement, with 2 z pulses for an odd number of pistons
    law = part("PistonPump", **given, z=9)
    angle = np.linspace(0, 2*PI, 3601)[:-1]
    found = law({"a.p": 0, "b.p": rise, "s.w": w, "s.phi": angle})
    agree(found["b.q"].mean(), -DISPLACEMENT*w*0.95, rtol=1e-6)
    spectrum = np.abs(np.fft.rfft(found["b.q"]))
    assert int(np.argmax(spectrum[1:])) + 1 == 18
    # the non-uniformity of textbooks, pi/(2 z) tan(pi/(4 z))
    agree(np.ptp(found["b.q"])/(DISPLACEMENT*w), PI/18*np.tan(PI/36), rtol=1e-3)
    agree(found["s.tau"] - lost, found["G"]*rise, rtol=1e-8)


@checks("MappedPump")
def test_a_mapped_pump_has_its_efficiencies_at_the_points_and_losses_around() -> None:
    p, speeds = np.array([50, 150, 300])*BAR, np.array([500, 1500])*RPM
    eta_v = np.array([[0.95, 0.98], [0.9, 0.95], [0.8, 0.9]])
    eta_hm = np.array([[0.85, 0.8], [0.9, 0.88], [0.93, 0.92]])
    law = part("MappedPump", D="45 cm**3/rev", p="[50 bar, 150 bar, 300 bar]", w="[500 rpm, 1500 rpm]", n=3, m=2,
               eta_v=f"{[float(v) for v in eta_v.ravel()]}", eta_hm=f"{[float(v) for v in eta_hm.ravel()]}",
               w_t="1e-3 rad/s")
    rise, w = (k.ravel() for k in np.meshgrid(p, speeds, indexing="ij"))
    found = law({"a.p": 3*BAR, "b.p": 3*BAR + rise, "s.w": w})
    agree(found["a.q"]/(DISPLACEMENT*w), eta_v.ravel())
    agree(DISPLACEMENT*rise/found["s.tau"], eta_hm.ravel())
    still = law({"a.p": 0, "b.p": np.array([25, 150, -150])*BAR, "s.w": 0})
    agree(still["a.q"], -DISPLACEMENT*speeds[0]*np.array([0.5*0.05, 0.1, -0.1]))
    far = law({"a.p": 0, "b.p": 400*BAR, "s.w": -3000*RPM})
    agree(far["a.q"], -DISPLACEMENT*(3000*RPM + 0.1*speeds[1]))
    agree(far["s.tau"], DISPLACEMENT*(400*BAR - p[2]*(1/0.92 - 1)))


# -- pressure valves ---------------------------------------------------------------------------------------------------
@checks("PressureCompensator", "PriorityValve", "SequenceValve", "LogicValve", "ProportionalReliefValve",
        "ProportionalReducingValve")
def test_pressure_valves_open_by_their_balances() -> None:
    rated = {"q_r": "40 L/min", "dp_r": "5 bar"}
    for name, ports, y in (("PressureCompensator", "PA", 0.3), ("LogicValve", "AB", 0.3), ("SequenceValve", "ab", 0.3)):
        own = {"SequenceValve": {"p_0": "100 bar"}, "PressureCompensator": {"p_0": "10 bar"}}.get(name, {})
        third = {"SequenceValve": "d", "PressureCompensator": "X", "LogicValve": "X"}[name]
        found = part(name, **rated, **own)({f"{ports[0]}.p": 50*BAR + DROPS, f"{ports[1]}.p": 50*BAR, f"{third}.p": 7*BAR,
                                            "y": y})
        agree(found[f"{ports[0]}.q"], y*rooted(40*LPM, 5*BAR, DROPS))
        agree(found[f"{third}.q"], 0, size=1)
    hydrostat = part("PressureCompensator", **rated, p_0="10 bar", p_b="2 bar", T_v="5 ms")
    agree(hydrostat({"P.p": 0, "X.p": 60*BAR, "A.p": np.array([60, 68, 69, 70, 90])*BAR, "y": 0})["der(y)"],
          np.array([1, 1, 0.5, 0, 0])/5e-3, size=200)
    sequence = part("SequenceValve", **rated, p_0="100 bar", p_f="120 bar", T_v="10 ms")
    agree(sequence({"a.p": np.array([90, 105, 115, 200])*BAR, "b.p": 0, "d.p": 5*BAR, "y": 0})["der(y)"],
          np.array([0, 0, 0.5, 1])/10e-3, size=100)
    # seat area 1, control area 1.6: A opens with 1, B with 0.6, X closes with 1.6
    logic = part("LogicValve", **rated, phi=1.6, p_0="2 bar", p_b="4 bar", T_v="10 ms")
    agree(logic({"A.p": 20*BAR, "B.p": 10*BAR, "X.p": np.array([10, 13.75, 15, 20])*BAR, "y": 0})["der(y)"],
          np.array([1, 0.5, 0, 0])/10e-3, size=100)
    priority = part("PriorityValve", **rated, p_0="7 bar", p_b="2 bar", T_v="5 ms")
    found = priority({"P.p": 80*BAR, "C.p": np.array([52, 56, 57, 60])*BAR, "E.p": 20*BAR, "X.p": 50*BAR, "y": 0.25})
    agree(found["der(y)"], (np.array([0, 0.5, 1, 1]) - 0.25)/5e-3)
    agree(found["E.q"], -0.25*rooted(40*LPM, 5*BAR, 60*BAR))
    agree(found["C.q"], -0.75*rooted(40*LPM, 5*BAR, 80*BAR - np.array([52, 56, 57, 60])*BAR))
    relief = part("ProportionalReliefValve", p_n="250 bar", p_min="10 bar", **rated, T_u="50 ms", T_v="5 ms", p_b="20 bar")
    found = relief({"a.p": 140*BAR, "b.p": 0, "u": np.array([-1, 0.5, 2]), "p_u": 130*BAR, "y": 0.1})
    agree(found["der(p_u)"], (np.array([10, 130, 250]) - 130)*BAR/0.05, size=1e9)
    agree(found["der(y)"], (0.5 - 0.1)/5e-3)
    reducing = part("ProportionalReducingValve", p_n="20 bar", p_b="2 bar", **rated, T_u="30 ms", T_v="5 ms")
    for y in (0.4, -0.4):
        found = reducing({"P.p": 40*BAR, "A.p": 11*BAR, "T.p": 1*BAR, "u": 0.6, "p_u": 11*BAR, "y": y})
        agree(found["der(y)"], (0.5 - y)/5e-3)
        agree(found["A.q"], -0.4*rooted(40*LPM, 5*BAR, 29*BAR) if y > 0
              else 0.4*rooted(40*LPM, 5*BAR, 10*BAR))


@checks("UnloadingValve", "PilotReliefValve")
def test_an_unloading_valve_switches_and_a_vented_relief_valve_unloads() -> None:
    charged = hb.simulate(hb.load("examples/unloading_valve"))
    kinds = [name for _, name in charged.events if name != "part.begin"]
    assert kinds[:4] == ["part.unload", "part.load", "part.unload", "part.load"]
    times = [t for t, name in charged.events if name != "part.begin"]
    # the consumer takes 20 bar out of the store with 4 L/min
    agree(times[1] - times[0], 20*BAR*1e-11/(4*LPM), rtol=2e-2)   # the check valve closes while the spool opens
    found = part("UnloadingValve", p_0="100 bar", q_r="40 L/min", dp_r="5 bar", T_v="10 ms")(
        {"P.p": 50*BAR, "T.p": 0, "X.p": 9*BAR, "y": 0.25, "on": 1})
    agree(found["P.q"], 0.25*rooted(40*LPM, 5*BAR, 50*BAR))
    agree(found["der(y)"], 75)
    law = part("PilotReliefValve", p_0="200 bar", p_b="5 bar", q_r="200 L/min", dp_r="200 bar",
               beta="1.4 GPa", V_x="10 cm**3")
    found = law({"P.p": 206*BAR, "T.p": 0, "X.p": 202*BAR, "X.q": 0, "y": 0.2})
    pilot = 0.4*rooted(2*LPM, 200*BAR, 202*BAR)
    through = rooted(1*LPM, 4*BAR, 4*BAR)
    agree(found["der(X.p)"], 1.4e9/10e-6*(through - pilot), rtol=1e-8)
    agree(found["P.q"], 0.2*rooted(200*LPM, 200*BAR, 206*BAR) + through)
    # vented, the main stage opens against its spring alone
    vented = law({"P.p": 6*BAR, "T.p": 0, "X.p": 0, "y": 0})
    agree(vented["der(y)"], 0.5/5e-3)


# -- dividers ----------------------------------------------------------------------------------------------------------
@checks("FlowDivider", "RotaryFlowDivider")
def test_dividers_divide_and_combine() -> None:
    for flow, share in ((40, 0.5), (-40, 0.5), (40, 0.3)):
        found = run(f"""
model: divided
components:
  pump: {{is: FlowSource, u: {flow} L/min}}
  oil:  {{is: Volume, V: 0.5 L, beta: 1.4 GPa}}
  part: {{is: FlowDivider, q_r: 40 L/min, r: {share}}}
  light: {{is: PressureSource, p_0: 90 bar}}
  heavy: {{is: PressureSource, p_0: 130 bar}}
nodes: {{supply: [pump.a, oil.a, part.P], A: [part.A, light.a], B: [part.B, heavy.a]}}
initial: {{supply.p: 100 bar, part.y: 0}}
simulate: {{until: 1 s}}
""")
        q_A, q_B = (found[f"part.q_{port}"][-1] for port in "AB")
        agree(q_A + q_B, flow*LPM, rtol=1e-5)
        # the spool needs a difference of the squared relative flows of e_b at most, 5 %
        agree(q_A/(q_A + q_B), share, rtol=0.0125)
        p, y = found["supply.p"][-1], found["part.y"][-1]
        edge = 1 - max(y, 0)
        agree(q_A, share*root(40*LPM, 10*BAR, p - 90*BAR)*np.sqrt(2)*edge/np.sqrt(1 + edge**2), rtol=1e-4)
    law = part("RotaryFlowDivider", D_A="10 cm**3/rev", D_B="30 cm**3/rev", J="1e-3 kg*m**2", d_w="0.1 N*m*s/rad",
               leakage="1e-12 m**3/(s*Pa)")
    found = law({"P.p": 80*BAR, "A.p": 20*BAR, "B.p": 110*BAR, "w": 100})
    agree(found["A.q"], -(10e-6/(2*PI)*100 + 60e-7))
    agree(found["B.q"], -(30e-6/(2*PI)*100 - 30e-7))
    agree(found["der(w)"], ((10e-6*60 - 30e-6*30)*BAR/(2*PI) - 10)/1e-3)


# -- building blocks and servo valves ----------------------------------------------------------------------------------
@checks("SpoolEdge", "Poppet")
@pytest.mark.parametrize("side", [1, -1])
def test_flow_and_flow_forces_of_edges(side: int) -> None:
    travel = np.array([-0.2e-3, 0.1e-3, 0.4e-3])
    law = part("SpoolEdge", d="12 mm", x_0="0.1 mm", side=side, c_r="1e-9 m", rho="850 kg/m**3")
    for dp in (70*BAR, -70*BAR):
        found = law({"a.p": 80*BAR + dp, "b.p": 80*BAR, "s.x": side*travel, "h.x": 0, "s.v": 0, "h.v": 0})
        opening = np.maximum(travel - 0.1e-3, 0)
        q = 0.61*PI*0.012*opening*np.sqrt(2/850*70*BAR)
        agree(found["a.q"], np.sign(dp)*q, rtol=1e-5, size=1e-3)
        # momentum: rho q v cos(theta) with the jet of v = sqrt(2 dp/rho); it closes, whatever the direction of flow
        force = 850*q*np.sqrt(2/850*70*BAR)*np.cos(np.radians(69))
        agree(found["s.f"], side*force, rtol=1e-5, size=100)
        agree(found["h.f"], -side*force, rtol=1e-5, size=100)
    cone = part("Poppet", d="8 mm", alpha="30 deg", rho="850 kg/m**3", x_t="1e-9 m")
    lift = np.array([-0.1e-3, 0.2e-3, 1e-3])
    found = cone({"a.p": 60*BAR, "b.p": 10*BAR, "s.x": lift, "h.x": 0, "s.v": 0.5, "h.v": 0})
    x = np.maximum(lift, 0)
    area = PI*x*0.5*(8e-3 - x*0.5*np.cos(np.radians(30)))   # frustum of slant height x sin(30 deg)
    q = 0.77*area*np.sqrt(2/850*50*BAR)
    seat = PI/4*8e-3**2
    agree(found["a.q"], q + seat*0.5, rtol=1e-5)
    jet = 850*q*np.sqrt(2/850*50*BAR)*np.cos(np.radians(30))
    agree(-found["s.f"], seat*50*BAR - jet, rtol=1e-5)


@checks("TwoStageServoValve43")
def test_a_two_stage_valve_slows_down_with_its_supply() -> None:
    law = part("TwoStageServoValve43", q_r="40 L/min", f_n="500 Hz", zeta=0.4, K_v="500 1/s", t_s="5 ms",
               C_0="1e-13 m**3/(s*Pa)")
    supply = np.array([210, 52.5, 0])*BAR
    found = law({"P.p": supply + 1e5, "T.p": 1e5, "A.p": 50*BAR, "B.p": 30*BAR, "u": 0.7, "x": 0.2, "x_f": 0.3, "w_f": 0})
    agree(found["der(x)"], 150*np.array([1, 0.5, 0]), rtol=1e-5, size=100)
    agree(found["der(w_f)"], (2*PI*500)**2*(0.7 - 0.2 - 0.3))
    fast = law({"P.p": 210*BAR, "T.p": 0, "A.p": 50*BAR, "B.p": 30*BAR, "u": -1, "x": 0.2, "x_f": -1.2, "w_f": 0})
    agree(fast["der(x)"], -200, rtol=1e-5)
    agree(fast["A.q"], -(0.2*rooted(40*LPM, 35*BAR, 160*BAR) + 1e-13*(160 - 50)*BAR))
    agree(fast["B.q"], 0.2*rooted(40*LPM, 35*BAR, 30*BAR) + 1e-13*(30 - 180)*BAR)
    agree(fast["P.q"] + fast["A.q"] + fast["B.q"] + fast["T.q"], 0, size=1e-3)


@checks("TabulatedValve")
def test_a_tabulated_valve_repeats_its_table_and_an_ideal_orifice_exactly() -> None:
    table = [[0, 0], [8, 20], [22, 50]]
    law = part("TabulatedValve", n=3, m=2, x="[0, 0.5, 1]", p="[4 bar, 36 bar]", dp_t="1e-3 Pa",
               q_v="[" + ", ".join(f"{q} L/min" for row in table for q in row) + "]")
    for k, y in enumerate((0, 0.5, 1)):
        for j, dp in enumerate((4*BAR, 36*BAR)):
            agree(law({"a.p": dp, "b.p": 0, "y": y})["a.q"], table[k][j]*LPM, size=1e-3)
            agree(law({"a.p": 0, "b.p": dp, "y": y})["a.q"], -table[k][j]*LPM, size=1e-3)
    agree(law({"a.p": 1*BAR, "b.p": 0, "y": 1})["a.q"], 11*LPM)            # below: half at a quarter of the drop
    agree(law({"a.p": 144*BAR, "b.p": 0, "y": 2})["a.q"], 100*LPM)         # above: twice at four times the drop
    ideal = part("TabulatedValve", n=2, m=2, x="[0, 1]", p="[4 bar, 36 bar]", dp_t="1e-3 Pa",
                 q_v="[0 L/min, 0 L/min, 20 L/min, 60 L/min]")
    drops = np.array([0.5, 4, 10, 25, 36, 90])*BAR
    agree(ideal({"a.p": drops, "b.p": 0, "y": 0.5})["a.q"], 10*LPM*np.sqrt(drops/(4*BAR)))
