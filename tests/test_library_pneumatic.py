"""Pneumatic components beside formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from library_check import Law, agree, checks, part, run
from numpy.typing import NDArray
from scipy.integrate import quad

Array = NDArray[np.float64]
bar, R, KAPPA, C_P, P_A, T_0 = 1e5, 287.05, 1.4, 1005.0, 101325.0, 293.15
LITRE = 1e-3/bar  # dm**3/(s*bar)
# pressures on both sides: choked and not, both ways, the same, one of them vacuum; and temperatures on either side
UP = np.array([7, 7, 7, 1, 3, 1, 5])*bar
DOWN = np.array([1, 6, 6.9, 7, 4, 0.01, 5])*bar
WARM, COLD = 330.0, 290.0


def iso(C: Array | float, b: float, p_a: Array, p_b: Array, T_a: float = WARM, T_b: float = COLD, m: float = 0.5,
        crack: float = 0.0) -> Array:
    """ISO 6358-1:2013, (1) to (4): q_m = C rho_0 p_1 sqrt(T_0/T_1) [1 - ((p_2/p_1 - b)/(1 - crack/p_1 - b))**2]**m."""
    up, down = np.maximum(p_a, p_b), np.minimum(p_a, p_b)
    ratio = np.clip((down/up - b)/(1 - crack/up - b), 0, 1)
    flow = C*1.185*up*np.sqrt(293.15/np.where(p_a >= p_b, T_a, T_b))*(1 - ratio**2)**m
    return np.where(p_a >= p_b, flow, -flow)


def carries(law: Law, expected: Array, known: dict[str, object], rtol: float, a: str = "a", b: str = "b") -> None:
    """A way from a to b passes a mass flow, and the enthalpy of the gas upstream; the small conduction aside."""
    found = law({f"{a}.p": UP, f"{b}.p": DOWN, f"{a}.T": WARM, f"{b}.T": COLD, **known})
    size = max(float(np.abs(expected).max()), 1e-6)
    agree(found[f"{a}.m"], expected, rtol, size=size)
    agree(found[f"{b}.m"], -found[f"{a}.m"])
    agree(found[f"{a}.H"], C_P*np.where(found[f"{a}.m"] > 0, WARM, COLD)*found[f"{a}.m"], 1e-6, size=0.1)
    agree(found[f"{b}.H"], -found[f"{a}.H"])


NARROW = {"dp_t": "1e-3 Pa", "G": 1e-9}  # 40 nW at the difference of the temperatures above


@checks("IsoOrifice")
@pytest.mark.parametrize(("b", "m", "crack"), [(0.3, 0.5, 0.0), (0.5, 0.48, 0.0), (0.2, 0.6, 0.3)])
def test_iso_orifice(b: float, m: float, crack: float) -> None:
    law = part("IsoOrifice", C=2*LITRE, b_cr=b, m_sub=m, dp_c=crack*bar, **NARROW)
    carries(law, iso(2*LITRE, b, UP, DOWN, m=m, crack=crack*bar), {}, 1e-6)
    # with the transition as it stands: straight around no drop, and down the pressure
    known = {"a.p": 5*bar + np.array([-10.0, 0, 10]), "b.p": 5*bar, "a.T": 293.15, "b.T": 293.15}
    found = part("IsoOrifice", C=2*LITRE, b_cr=b, m_sub=m)(known)["a.m"]
    agree(found[0], -found[2], 1e-4)
    agree(found[1], 0, size=1e-20)


@checks("IsoValve")
def test_iso_valve() -> None:
    law = part("IsoValve", C=2*LITRE, b_cr=0.3, **NARROW)
    for u in (-0.5, 0.0, 0.4, 1.0):
        carries(law, max(u, 0)*iso(2*LITRE, 0.3, UP, DOWN), {"u": u}, 1e-6)


def elliptic(C: float, b: float) -> Array:
    """The law of ISO 6358 at a constant temperature; with b = 0 that of St. Venant's square, C sqrt(p_1**2 - p_2**2)."""
    up, down = np.maximum(UP, DOWN), np.minimum(UP, DOWN)
    return np.sign(UP - DOWN)*C*up*np.sqrt(1 - np.clip((down/up - b)/(1 - b), 0, 1)**2)


@checks("PneumaticOrifice", "PneumaticValve")
@pytest.mark.parametrize("b", [0.0, 0.4])
def test_orifices_of_an_isothermal_machine(b: float) -> None:
    carries(part("PneumaticOrifice", C=2e-9, b_cr=b, **NARROW), elliptic(2e-9, b), {}, 1e-6)
    law = part("PneumaticValve", C=2e-9, b_cr=b, **NARROW)
    for u in (-0.5, 0.0, 0.4, 1.0):
        carries(law, max(u, 0)*elliptic(2e-9, b), {"u": u}, 1e-6)
    if not b:
        agree(elliptic(2e-9, 0.0), 2e-9*np.sign(UP - DOWN)*np.sqrt(np.abs(UP**2 - DOWN**2)))


@checks("PneumaticLine")
def test_laminar_line() -> None:
    carries(part("PneumaticLine", R="1e8 Pa*s/kg", G=1e-9), (UP - DOWN)/1e8, {}, 1e-8)


@checks("LaminarPneumaticLeakage")
def test_laminar_leakage_follows_the_plane_gap() -> None:
    """Width b, height h and length L: m = b h**3 (p_1**2 - p_2**2)/(24 mu L R T)."""
    b, h, L, mu = 0.1, 20e-6, 0.02, 18.2e-6
    conductance = b*h**3*P_A/(12*mu*L*R*T_0)
    carries(part("LaminarPneumaticLeakage", C_l=conductance, G=1e-9), b*h**3*(UP**2 - DOWN**2)/(24*mu*L*R*T_0), {}, 1e-6)


@checks("SmoothPneumaticLine")
def test_smooth_line_follows_isothermal_pipe_flow() -> None:
    length, bore, mu = 8.0, 6e-3, 18.2e-6
    law = part("SmoothPneumaticLine", length="8 m", d="6 mm")
    for Re, f in ((500.0, 64/500), (1000, 64/1000), (5e3, 0.3164*5e3**-0.25), (6e4, 0.3164*6e4**-0.25)):
        m = Re*np.pi/4*bore*mu
        # White (9.73) without its logarithm: p_1**2 - p_2**2 = (m/A)**2 R T f L/D
        square = (m/(np.pi/4*bore**2))**2*R*T_0*f*length/bore
        for a, b, sign in ((np.sqrt(bar**2 + square), bar, 1), (bar, np.sqrt(bar**2 + square), -1)):
            found = law({"a.p": a, "b.p": b, "a.T": WARM, "b.T": COLD})
            agree(found["a.m"], sign*m, 1e-6)
            agree(found["b.m"], -found["a.m"])
            agree(found["a.H"], C_P*sign*m*(WARM if sign > 0 else COLD), 1e-3)
    agree(law({"a.p": bar, "b.p": bar, "a.T": WARM, "b.T": WARM})["a.m"], 0, size=1e-20)


@checks("PneumaticTube")
def test_tube_is_two_halves_of_a_line_and_its_gas() -> None:
    law, half = part("PneumaticTube", length="4 m", d="6 mm"), part("SmoothPneumaticLine", length="2 m", d="6 mm")
    found = law({"a.p": 3*bar, "b.p": 2*bar, "a.T": WARM, "b.T": COLD, "middle.p": 2.6*bar, "middle.T": 300})
    first = half({"a.p": 3*bar, "b.p": 2.6*bar, "a.T": WARM, "b.T": 300})
    second = half({"a.p": 2.6*bar, "b.p": 2*bar, "a.T": 300, "b.T": COLD})
    agree(found["a.m"], first["a.m"])
    agree(found["b.m"], second["b.m"])
    V, G = np.pi/4*6e-3**2*4, 50*np.pi*6e-3*4
    m, H = first["a.m"] - second["a.m"], first["a.H"] - second["a.H"] - G*(300 - T_0)
    agree(found["der(middle.p)"], H*(KAPPA - 1)/V, 1e-8)
    agree(found["der(middle.T)"], (H - R/(KAPPA - 1)*300*m)*(KAPPA - 1)*300/(2.6*bar*V), 1e-7)


# -- valves made of these ----------------------------------------------------------------------------------------------
def ways(law: Law, point: dict[str, object], expected: dict[str, Array | float], rtol: float = 2e-3) -> None:
    """Mass flows into the ports of a valve whose ways have the transition of the library, 1 kPa."""
    found = law(point)
    for port, flow in expected.items():
        agree(found[f"{port}.m"], flow, rtol, size=1e-4)
    agree(sum(found[f"{port}.m"] for port in expected), 0, size=1e-6)
    agree(sum(found[f"{port}.H"] for port in expected), 0, size=1e-3)


def gas(**pressures: float) -> dict[str, object]:
    return {f"{port}.p": p*bar for port, p in pressures.items()} | {f"{port}.T": T_0 for port in pressures}


def flow(C: float, b: float, p_1: float, p_2: float) -> float:
    """The law of ISO 6358 at the temperature of its reference condition, in L/(s*bar) and bar."""
    return float(iso(C*LITRE, b, np.array(p_1*bar), np.array(p_2*bar), 293.15, 293.15))


@checks("PneumaticCheckValve", "PneumaticReliefValve", "OneWayFlowControl")
def test_valves_that_open_by_a_drop() -> None:
    law = part("PneumaticCheckValve", C=2*LITRE, b_cr=0.3, dp_c="0.2 bar", dp_o="0.5 bar")
    for p, y in ((7.0, 1.0), (1.5, 1.0), (1.35, 0.5), (1.2, 0), (1.0, 0), (0.2, 0)):
        q = y*flow(2, 0.3, p, 1.0)
        ways(law, gas(a=p, b=1.0), {"a": q, "b": -q})
    law = part("PneumaticReliefValve", C=2*LITRE, p_set="6 bar", p_over="0.6 bar")
    for p, y in ((6.5, 0.0), (7, 0), (7.3, 0.5), (8, 1), (0.5, 0)):
        q = y*flow(2, 0.3, p, 1.0)
        ways(law, gas(a=p, b=1.0), {"a": q, "b": -q})
    law = part("OneWayFlowControl", C=0.5*LITRE, b_cr=0.2, C_free=3*LITRE, b_free=0.4, dp_c="0.05 bar")
    q = flow(0.5, 0.2, 6, 2)  # throttled
    ways(law, gas(a=6, b=2), {"a": q, "b": -q})
    q = -flow(0.5, 0.2, 6, 2) - flow(3, 0.4, 6, 2)  # free: past the check valve as well
    ways(law, gas(a=2, b=6), {"a": q, "b": -q})


@checks("PneumaticValve32", "PneumaticValve53")
def test_directional_valves() -> None:
    law = part("PneumaticValve32", C=2*LITRE, b_cr=0.3, C_R=3*LITRE, b_R=0.4, t_s="20 ms")
    for x in (0.0, 0.3, 1.0):
        into, out = x*flow(2, 0.3, 7, 4), (1 - x)*flow(3, 0.4, 4, 1)
        ways(law, {**gas(P=7, A=4, R=1), "x": x, "u": 1}, {"P": into, "A": out - into, "R": -out})
        for u in (-1.0, 0.5, 2.0):
            rate = law({**gas(P=7, A=4, R=1), "x": x, "u": u})["der(x)"]
            agree(rate, (np.clip(u, 0, 1) - x)*np.log(10)/20e-3, size=1.0)  # nine tenths after t_s
    for overlap in (0.0, 0.1, -0.05):
        law = part("PneumaticValve53", C=2*LITRE, b_cr=0.3, C_R=3*LITRE, b_R=0.4, t_s="20 ms", overlap=overlap)
        for x in (-1.0, 0.0, 0.4):
            ahead, back = max(x - overlap, 0), max(-x - overlap, 0)
            PA, BS, PB, AR = (ahead*flow(2, 0.3, 7, 4), ahead*flow(3, 0.4, 3, 1), back*flow(2, 0.3, 7, 3),
                              back*flow(3, 0.4, 4, 1))
            ways(law, {**gas(P=7, A=4, B=3, R=1, S=1), "x": x, "u": 0},
                 {"P": PA + PB, "A": AR - PA, "B": BS - PB, "R": -AR, "S": -BS})
            agree(law({**gas(P=7, A=4, B=3, R=1, S=1), "x": x, "u": -3})["der(x)"], (-1 - x)*np.log(10)/20e-3, size=1.0)


@checks("PneumaticRegulator")
def test_regulator() -> None:
    law = part("PneumaticRegulator", p_set="4 bar", C=2*LITRE, dp_d="0.5 bar", dp_r="0.2 bar", C_R=0.2*LITRE)
    for above, fed, vented in ((3.0, 1.0, 0.0), (3.75, 0.5, 0), (4.0, 0, 0), (4.1, 0, 0), (4.45, 0, 0.5), (6, 0, 1)):
        into, out = fed*flow(2, 0.3, 8, 1 + above), vented*flow(0.2, 0.3, 1 + above, 1)
        ways(law, gas(P=8, A=1 + above, R=1), {"P": into, "A": out - into, "R": -out})


@checks("PneumaticShuttleValve", "QuickExhaustValve")
def test_valves_that_choose() -> None:
    law = part("PneumaticShuttleValve", C=2*LITRE, p_t="0.05 bar")
    for A, B, y in ((6, 2, 1.0), (2, 6, 0.0), (4, 4, 0.5), (4.025, 4, 0.84375)):
        q_A, q_B = y*flow(2, 0.3, A, 3), (1 - y)*flow(2, 0.3, B, 3)
        ways(law, gas(A=A, B=B, X=3), {"A": q_A, "B": q_B, "X": -q_A - q_B})
    law = part("QuickExhaustValve", C=1*LITRE, C_R=4*LITRE, b_R=0.4)
    for P, A, y_P, y_R in ((6, 2, 1, 0), (4.025, 4, 0.5, 0), (4, 4, 0, 0), (4, 4.04, 0, 0), (4, 4.075, 0, 0.5),
                           (1, 5, 0, 1)):
        into, out = y_P*flow(1, 0.3, P, A), y_R*flow(4, 0.4, A, 1)
        # 2.5 kPa of drop are near the transition at 1 kPa
        ways(law, gas(P=P, A=A, R=1), {"P": into, "A": out - into, "R": -out}, 6e-3)


@checks("Silencer")
def test_silencer() -> None:
    law = part("Silencer", C=3*LITRE, p_0="1 bar")
    for p in (6.0, 1.2, 1.0, 0.5):
        agree(law({**gas(a=p)})["a.m"], flow(3, 0.3, p, 1.0), 2e-3, size=1e-5)


# -- volumes -----------------------------------------------------------------------------------------------------------
@checks("Receiver")
@pytest.mark.parametrize("n", [1.0, 1.2, 1.4])
def test_a_receiver_warms_by_its_polytropic_exponent(n: float) -> None:
    law = part("Receiver", V="20 L", T_0="300 K", p_0="2 bar", n=n)
    p, m = np.array([0.5, 2, 5, 10])*bar, np.array([1e-3, -1e-3, 2e-3, 0])
    found = law({"a.p": p, "a.m": m})
    T = 300*(p/(2*bar))**((n - 1)/n)
    agree(found["a.T"], T, 1e-7)
    # the mass p V/(R T) must change by what flows in: by differences
    h = 1.0
    mass = [x*20e-3/(R*300*(x/(2*bar))**((n - 1)/n)) for x in (p - h, p + h)]
    agree(found["der(a.p)"], m*2*h/(mass[1] - mass[0]), 1e-6)


@checks("Receiver")
def test_the_exponent_of_a_receiver_is_no_mere_volume() -> None:
    """Filled adiabatically by gas of the same state from 2 to 8 bar it holds the mass of the exact law, (p/p_0)**(1/n)."""
    filled = run("""model: filled
components: {pump: {is: PneumaticFlowSource, u: 5 g/s}, vessel: {is: Receiver, V: 20 L, T_0: 300 K, p_0: 2 bar, n: 1.4}}
nodes: {n: [pump.a, vessel.a]}
initial: {n.p: 2 bar}
simulate: {until: 10 s}
""")
    mass = 2e5*20e-3/(R*300)
    agree(filled["n.p"], 2e5*(1 + 5e-3*filled.time/mass)**1.4, 1e-5)
    agree(filled["n.T"], 300*(1 + 5e-3*filled.time/mass)**0.4, 1e-5)


def state(law: Law, V: Array | float, given: dict[str, object], heat: Array | float, w: Array | float = 0.0,
          port: str = "a") -> None:
    """Rates of p and T from d(p V/(R T)) = m and d(p V/(kappa - 1)) = H + Q - p dV."""
    found = law(given)
    own = "T" if "T" in given else f"{port}.T"  # well mixed: that of the port, or of the chamber
    p, T, m, H = (np.asarray(given[k], float) for k in (f"{port}.p", own, f"{port}.m", f"{port}.H"))
    energy = H + heat - p*w
    rate_p = (energy*(KAPPA - 1) - p*w)/V
    agree(found[f"der({port}.p)"], rate_p, 1e-9)
    # d ln T = d ln p + d ln V - d ln M
    agree(found[f"der({own})"], T*(rate_p/p + w/V - m*R*T/(p*V)), 1e-8, size=1.0)


P, T, M = np.array([1.0, 3, 8])*bar, np.array([250.0, 300, 400]), np.array([2e-3, 0, -3e-3])


@checks("ReceiverWithHeat", "ReceiverWithHeatPort")
def test_receivers_with_heat() -> None:
    given, Q = {"a.p": P, "a.T": T, "a.m": M, "a.H": M*C_P*np.array([300.0, 300, 400])}, np.array([0.0, 50, -20])
    for G in (0.0, 12.0):
        state(part("ReceiverWithHeat", V="20 L", T_0="295 K", G=G), 20e-3, given, -G*(T - 295))
    state(part("ReceiverWithHeatPort", V="20 L"), 20e-3, {**given, "h.Q": Q}, Q)


@checks("PneumaticChamber")
def test_chamber() -> None:
    law, v = part("PneumaticChamber", A="20 cm**2", V_0="0.1 L", l0="0.5 m"), np.array([0.3, -0.2, 0])
    given = {"g.p": P, "T": T, "g.m": M, "g.H": M*C_P*300, "h.Q": 30, "a.x": 0.1, "b.x": 0.7, "a.v": 0.1, "b.v": 0.1 + v}
    state(law, 0.1e-3 + 20e-4*0.1, given, 30.0, 20e-4*v, "g")
    found = law(given)
    agree(found["b.f"], -20e-4*(P - P_A))
    agree(found["a.f"], -found["b.f"])
    agree(found["h.T"], T)
    agree(found["g.T"], T)


@checks("PneumaticCylinder")
def test_cylinder() -> None:
    law = part("PneumaticCylinder", D="50 mm", d="20 mm", stroke="0.2 m", V_d="20 mL", l0="0.4 m", G=3.0, leakage=0.01*LITRE,
               F_c="40 N", sigma_2="100 N*s/m")
    A, B, s, v = np.pi/4*0.05**2, np.pi/4*(0.05**2 - 0.02**2), 0.05, np.array([0.3, -0.3])
    p_A, p_B, T_A, T_B = 6*bar, 2*bar, 310.0, 290.0
    found = law({"a.x": 0.1, "b.x": 0.5 + s, "a.v": 0, "b.v": v, "A.p": p_A, "B.p": p_B, "chamber_a.T": T_A,
                 "chamber_b.T": T_B, "A.m": 1e-3, "A.H": 1e-3*C_P*300, "B.m": -5e-4, "B.H": -5e-4*C_P*T_B})
    agree(found["b.f"], -(A*(p_A - P_A) - B*(p_B - P_A)) + 40*np.sign(v) + 100*v, 1e-6)
    agree(found["a.f"], -found["b.f"])
    leak = iso(0.01*LITRE, 0.2, np.array(p_A), np.array(p_B), T_A, T_B)
    for side, V, area, p, own, m, H, sign in (("A", 20e-6 + A*s, A, p_A, T_A, 1e-3, 1e-3*C_P*300, 1.0),
                                              ("B", 20e-6 + B*0.15, B, p_B, T_B, -5e-4, -5e-4*C_P*T_B, -1.0)):
        m, H = m - sign*leak, H - sign*leak*C_P*T_A
        energy = H - 3.0*(own - T_0) - sign*p*area*v
        rate = ((KAPPA - 1)*energy - sign*p*area*v)/V
        agree(found[f"der({side}.p)"], rate, 1e-5)
        agree(found[f"der(chamber_{side.lower()}.T)"], own*(rate/p + sign*area*v/V - m*R*own/(p*V)), 1e-4, size=10.0)


@checks("PneumaticCylinderSingle")
def test_single_acting_cylinder() -> None:
    law = part("PneumaticCylinderSingle", D="32 mm", V_d="20 mL", c="500 N/m", F_0="60 N", l0="0.4 m", G=3.0,
               leakage=0.01*LITRE, F_c="10 N")
    A, s, v = np.pi/4*0.032**2, 0.05, np.array([0.3, -0.3])
    found = law({"a.x": 0.1, "b.x": 0.5 + s, "a.v": 0, "b.v": v, "A.p": 5*bar, "chamber.T": 310.0, "A.m": 1e-3,
                 "A.H": 1e-3*C_P*300})
    agree(found["b.f"], -A*(5*bar - P_A) + 60 + 500*s + 10*np.sign(v), 1e-6)  # the spring and the friction hold it back
    agree(found["a.f"], -found["b.f"])
    leak, V = iso(0.01*LITRE, 0.2, np.array(5*bar), np.array(P_A), 310.0, T_0), 20e-6 + A*s
    energy = 1e-3*C_P*300 - leak*C_P*310 - 3.0*(310 - T_0) - 5*bar*A*v
    agree(found["der(A.p)"], ((KAPPA - 1)*energy - 5*bar*A*v)/V, 1e-5)


@checks("Gas", "Nitrogen")
def test_a_gas_has_the_heat_capacities_of_its_law() -> None:
    for name, given, r, kappa in (("Gas", "", R, KAPPA), ("Gas", ", R: 188.9 J/(kg*K), kappa: 1.29", 188.9, 1.29),
                                  ("Nitrogen", "", 8.314462618/28.0134e-3, 1.4)):
        agree([part(name)({"a.p": 3*bar, "a.T": 280})[through] for through in ("a.m", "a.H")], 0, size=1e-30)
        found = run(f"""model: filled
components: {{gas: {{is: {name}{given}}}, feed: {{is: PneumaticFlowSource, T_0: 310 K, u: 1 g/s}},
             v: {{is: ReceiverWithHeat, V: 5 L, G: 0}}}}
nodes: {{n: [gas.a, feed.a, v.a]}}
initial: {{n.p: 2 bar, n.T: 293.15 K}}
show: {{n.p: {{unit: Pa}}, n.T: {{unit: K}}}}
simulate: {{until: 1 s}}
""")
        # enthalpy of the feed becomes internal energy: V dp/dt = kappa R T_0 m
        agree(found["n.p"], 2*bar + kappa*r*310*1e-3/5e-3*found.time, 3e-4)
        agree(found["n.T"], found["n.p"]*5e-3/(r*(2*bar*5e-3/(r*293.15) + 1e-3*found.time)), 3e-4)


# -- sources and sensors -----------------------------------------------------------------------------------------------
@checks("Atmosphere", "PneumaticSource", "PneumaticFlowSource", "MassFlowSensor", "GasTemperatureSensor",
        "PneumaticPressureSensor")
def test_sources_and_sensors_are_what_they_define() -> None:
    found = part("Atmosphere")({"a.m": M, "a.H": 300*M})
    agree([found["a.p"], found["a.T"]], [[P_A]*3, [T_0]*3])
    found = part("PneumaticSource", p_0="7 bar", T_0="310 K")({"a.m": M, "a.H": 300*M})
    agree([found["a.p"], found["a.T"]], [[7*bar]*3, [310]*3])
    found = part("PneumaticFlowSource", T_0="310 K", G=1e-9)({"a.p": 3*bar, "a.T": 280, "u": M})
    agree(found["a.m"], -M)
    agree(found["a.H"], -C_P*M*np.where(M > 0, 310, 280), 1e-6, size=0.1)
    found = part("MassFlowSensor")({"a.m": M, "a.H": 300*M, "a.p": 3*bar, "a.T": 280})
    agree(found["y"], M)
    agree([found["b.m"], found["b.H"]], [-M, -300*M])
    agree([found["b.p"], found["b.T"]], [[3*bar]*3, [280]*3])
    found = part("GasTemperatureSensor")({"a.T": T, "a.p": bar})
    agree(found["y"], T)
    agree([found["a.m"], found["a.H"]], 0, size=1e-30)
    found = part("PneumaticPressureSensor", p_0=P_A)({"a.T": 300, "a.p": P})
    agree(found["y"], P - P_A)
    agree([found["a.m"], found["a.H"]], 0, size=1e-30)


def test_the_reference_laws_hold_where_they_are_known() -> None:
    """An ideal gas of kappa 1.4 through a nozzle (St. Venant and Wantzel) is the ellipse of a critical ratio of 0.528."""
    def nozzle(ratio: float) -> float:
        r = max(ratio, 0.528282)
        return float(np.sqrt(2/(R*T_0)*KAPPA/(KAPPA - 1)*(r**(2/KAPPA) - r**((KAPPA + 1)/KAPPA))))

    C = nozzle(0.1)/1.185
    for ratio in (0.2, 0.6, 0.8, 0.95):
        found = float(iso(C, 0.528, np.array(bar), np.array(ratio*bar), 293.15, 293.15))/bar
        assert found == pytest.approx(nozzle(ratio), rel=0.02)
    assert quad(lambda V: bar*(1e-3/V)**KAPPA, 1e-3, 2e-3)[0] == pytest.approx(bar*1e-3/(KAPPA - 1)*(1 - 2**(1 - KAPPA)))
