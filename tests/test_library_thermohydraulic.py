"""Thermohydraulic components and functions beside formulas of their sources; the oil is that of `oil_reference`."""

from __future__ import annotations

import numpy as np
from library_check import agree, checks, part, run
from oil_reference import OIL, rated
from scipy.optimize import fsolve

# forwards and backwards, warm and cold
P_A, T_A = np.array([200e5, 50e5, 1e5, 10e5]), np.array([313.15, 283.15, 353.15, 300.0])
P_B, T_B = 60e5, 330.0
MEAN = np.array([OIL.v((p + P_B)/2, (T + T_B)/2) for p, T in zip(P_A, T_A, strict=True)])


def carries(name: str, mass: np.ndarray, also: dict[str, np.ndarray] | None = None, **given: object) -> None:
    """A part between two states carries a mass flow with the enthalpy of the side that it comes from, and keeps nothing."""
    law = part(name, m_t="1e-9 kg/s", G="1e-9 W/K", **given)
    found = law({"a.p": P_A, "a.T": T_A, "b.p": P_B, "b.T": T_B} | (also or {}))
    up = np.array([OIL.h(p, T) if m > 0 else OIL.h(P_B, T_B) for m, p, T in zip(mass, P_A, T_A, strict=True)])
    agree(found["a.m"], mass, 1e-9, size=float(np.abs(mass).max())*1e-3)
    carried = mass*up + 1950*1e-18/(4*np.hypot(mass, 1e-9))*(T_A - T_B)  # and what conducts where nothing flows
    agree(found["a.H"], carried, 1e-9, size=float(np.abs(mass*up).max()))
    agree(found["b.m"], -found["a.m"])
    agree(found["b.H"], -found["a.H"])


@checks("OilOrifice", "OilValve", "OilReliefValve", "OilLeakage")
def test_restrictions() -> None:
    flow = np.array([rated(5e-4, 100e5, dp) for dp in P_A - P_B])*np.sqrt(860/MEAN)
    carries("OilOrifice", flow, q_r="5e-4 m**3/s", dp_r="100 bar")
    carries("OilValve", 0.3*flow, q_r="5e-4 m**3/s", dp_r="100 bar", u=0.3)
    carries("OilReliefValve", 1e-11*np.maximum(P_A - P_B - 100e5, 0)/MEAN, C="1e-11 m**3/(s*Pa)", dp_0="100 bar")
    nu = np.array([OIL.nu((T + T_B)/2) for T in T_A])
    carries("OilLeakage", 1e-12*32e-6/nu*(P_A - P_B)/MEAN, C="1e-12 m**3/(s*Pa)", nu_r="32 mm**2/s")


def test_heat_is_conducted_where_nothing_flows() -> None:
    """By G and c_p*m_t/4 of the transition; in a pump through what it sweeps and through its leakage."""
    here = {"a.p": 30e5, "a.T": 340.0, "b.p": 30e5, "b.T": 310.0}
    found = part("OilOrifice", q_r="1e-4 m**3/s", dp_r="10 bar")(here)
    agree([found["a.m"], found["a.H"]], [0, (1e-3 + 1950*1e-4/4)*30], size=2.0)
    found = part("OilPump", D="5e-6 m**3/rad", eta_v=0.9, dp_r="200 bar", w_r="150 rad/s", nu_r="32 mm**2/s")(
        {**here, "s.w": 0})
    agree([found["a.m"], found["a.H"]], [0, (1e-3 + 1950*1e-4/2)*30], size=3.0)


@checks("OilPipe", "OilLine")
def test_pipes() -> None:
    """Laminar by Hagen and Poiseuille; a line has two halves of the resistance, its oil and its wall between."""
    nu = np.array([OIL.nu((T + T_B)/2) for T in T_A])
    flow = np.pi*0.004**4*(P_A - P_B)/(128*nu/MEAN*100)
    carries("OilPipe", flow/MEAN, {"q": flow}, length="100 m", d="4 mm")
    drop = run("""
model: one
components:
  supply: {is: OilReservoir, p_0: 10 bar, T_s: 300 K}
  pipe:   {is: OilPipe, length: 20 m, d: 10 mm}
  tank:   {is: OilReservoir, T_s: 340 K}
nodes: {inlet: [supply.a, pipe.a], outlet: [pipe.b, tank.a]}
simulate: {until: 1 s}
""").si["pipe.q"][-1]
    agree(drop, np.pi*0.01**4*10e5/(128*OIL.nu(320)/OIL.v(5e5, 320)*20))
    line = run("""
model: line
components:
  supply: {is: OilReservoir, p_0: 1 bar, T_s: 340 K}
  pipe:   {is: OilLine, length: 20 m, d: 10 mm, U: 100 W/(m**2*K)}
  tank:   {is: OilReservoir, T_s: 340 K}
  room:   {is: Ambient, T_0: 290 K}
nodes: {inlet: [supply.a, pipe.a], outlet: [pipe.b, tank.a], room: [pipe.h, room.a]}
initial: {start: steady, pipe.middle.p: ~ 0.5 bar, pipe.middle.T: ~ 330 K}
simulate: {until: 1 s}
""").si

    def half(p_1: float, T_1: float, p_2: float, T_2: float) -> float:
        v = OIL.v((p_1 + p_2)/2, (T_1 + T_2)/2)
        return float(np.pi*0.01**4*(p_1 - p_2)/(128*OIL.nu((T_1 + T_2)/2)/v*10)/v)

    def wrong(y: np.ndarray) -> list[float]:
        first, second = half(1e5, 340, y[0]*1e5, y[1]), half(y[0]*1e5, y[1], 0, 340)
        return [first - second, (first*(OIL.h(1e5, 340) - OIL.h(y[0]*1e5, y[1])) - 100*np.pi*0.01*20*(y[1] - 290))/1e3]
    p, T = fsolve(wrong, [0.5, 330.0], xtol=1e-12)
    # the oil that leaves cools the tank's side by the conductance G: 1e-3 W/K of 300 W/K; the transition is (1e-4/0.1)**2/2
    agree([line["pipe.middle.T"][-1] - 290, line["pipe.middle.p"][-1]], [T - 290, p*1e5], 2e-5)
    agree(line["pipe.a.m"][-1], half(1e5, 340, p*1e5, T), 2e-5)


@checks("OilVolume", "OilChamber", "OilTank", "OilWall", "Oil")
def test_balances_of_stored_oil() -> None:
    """Mass and internal energy by central differences along the found rates: dM = m, d(M u) = H + Q - p dV."""
    m, H, p, T, e = 0.2, 3e3, 80e5, 325.0, 1e-3
    oil = part("Oil")({"a.p": p, "a.T": T})
    agree([oil["a.m"], oil["a.H"]], 0, size=1e-12)
    found = part("OilVolume", V="2 L")({"a.p": p, "a.T": T, "a.m": m, "a.H": H})
    ends = [(p + s*e*float(found["der(a.p)"]), T + s*e*float(found["der(a.T)"])) for s in (1, -1)]
    agree(sum(s*2e-3/OIL.v(*x) for s, x in zip((1, -1), ends, strict=True))/(2*e), m, 1e-5)
    agree(sum(s*2e-3/OIL.v(*x)*OIL.u(*x) for s, x in zip((1, -1), ends, strict=True))/(2*e), H, 1e-5)
    law = part("OilChamber", A="20 cm**2", V_0="1 L", l0="0.5 m")
    found = law({"a.x": 0.0, "b.x": 0.75, "a.v": 0.0, "b.v": 0.1, "g.p": p, "g.T": T, "g.m": m, "g.H": H})
    ends = [(p + s*e*float(found["der(g.p)"]), T + s*e*float(found["der(g.T)"])) for s in (1, -1)]
    sizes = [1e-3 + 20e-4*(0.25 + s*e*0.1) for s in (1, -1)]
    masses = [V/OIL.v(*x) for V, x in zip(sizes, ends, strict=True)]
    agree((masses[0] - masses[1])/(2*e), m, 1e-5)
    agree((masses[0]*OIL.u(*ends[0]) - masses[1]*OIL.u(*ends[1]))/(2*e), H - p*20e-4*0.1, 1e-5)
    agree([found["b.f"], found["a.f"]], [-p*20e-4, p*20e-4])
    found = part("OilTank", V="50 L")({"m_s": 2.0, "a.T": T, "a.m": m, "a.H": H, "h.Q": -500.0})
    agree(found["M"], 0.05*860 + 2)
    agree(found["M"]*1950*found["der(a.T)"] + OIL.h(0, T)*m, H - 500)
    agree([found["a.p"], found["der(m_s)"], found["h.T"]], [0, m, T], size=1e-9)
    found = part("OilWall")({"a.T": T, "h.Q": 300.0})
    agree([found["h.T"], found["a.H"], found["a.m"]], [T, -300, 0], size=1e-9)


@checks("OilPump")
def test_pump_heats_by_its_losses() -> None:
    law = part("OilPump", D="5e-6 m**3/rad", eta_v=0.9, eta_hm=0.85, dp_r="200 bar", w_r="150 rad/s", k_v=0.4,
               m_t="1e-9 kg/s", G="1e-9 W/K")
    w = np.array([150.0, 60.0, -100.0])
    dp, T = 100e5, 333.15
    found = law({"s.w": w, "a.p": 2e5, "a.T": T, "b.p": 2e5 + dp, "b.T": 340.0})
    nu = OIL.nu(T)
    swept, leak = 5e-6*w/OIL.v(2e5, T), 5e-6*150/200e5*0.1*46e-6/nu*dp/OIL.v(2e5, T)
    torque = 5e-6*dp + 5e-6*200e5*(1/0.85 - 1)*(0.4*nu/46e-6*w/150 + 0.6*dp/200e5*np.tanh(w))
    agree(found["a.m"], swept - leak)
    agree(found["s.tau"], torque)
    agree(found["a.H"] + found["b.H"] + torque*w, 0, size=1e3)  # the first law
    low, high = OIL.h(2e5, T), OIL.h(2e5 + dp, 340)
    # swept oil enters with its own enthalpy and leaves with the shaft power; the leakage leaves b with the enthalpy there
    agree(found["a.H"], np.where(swept > 0, swept*low, swept*high - torque*w) - leak*high, 1e-6)


@checks("OilCooler")
def test_cooler_by_its_effectiveness() -> None:
    law = part("OilCooler", P_r="12 kW", dT_r="40 K", q_r="60 L/min", dp_r="1 bar", m_t="1e-9 kg/s", G="1e-9 W/K")
    dp = np.array([1e5, 0.2e5, -0.5e5])
    found = law({"a.p": 3e5, "a.T": 335.0, "b.p": 3e5 - dp, "b.T": 310.0, "h.T": 295.0})
    v = np.array([OIL.v(3e5 - x/2, 322.5) for x in dp])
    mass = np.array([rated(1e-3, 1e5, x, 0.02e5) for x in dp])/v
    full = 1950*860*1e-3
    conductance = -full*np.log(1 - 12e3/(40*full))
    heat = np.abs(mass)*1950*(1 - np.exp(-conductance/(np.abs(mass)*1950)))*(np.where(mass > 0, 335, 310) - 295)
    agree(found["a.m"], mass)
    agree(found["h.Q"], -heat, 1e-7)
    agree(found["a.H"] + found["b.H"], heat, 1e-7)
    enters = np.where(mass > 0, mass*OIL.h(3e5, 335), 0)
    agree(found["a.H"][:2], enters[:2], 1e-7)


@checks("OilReservoir", "OilFlowSource", "HydraulicAdapter")
def test_sources_and_the_adapter() -> None:
    found = part("OilReservoir", p_0="3 bar", T_s="300 K")({})
    agree([found["a.p"], found["a.T"]], [3e5, 300])
    u = np.array([2e-4, -2e-4])
    found = part("OilFlowSource", T_s="340 K", m_t="1e-9 kg/s", G="1e-9 W/K")({"u": u, "a.p": 50e5, "a.T": 300.0})
    mass = u/OIL.v(50e5, 340)
    agree(found["a.m"], -mass)
    agree(found["a.H"], -mass*np.array([OIL.h(50e5, 340), OIL.h(50e5, 300)]), 1e-8)
    found = part("HydraulicAdapter", T_s="320 K", m_t="1e-9 kg/s", G="1e-9 W/K")({"b.q": u, "a.p": 50e5, "a.T": 340.0})
    mass = u/OIL.v(50e5, 320)
    agree(found["a.m"], -mass)
    agree(found["b.p"], 50e5)
    agree(found["a.H"], -mass*np.array([OIL.h(50e5, 320), OIL.h(50e5, 340)]), 1e-8)


@checks("OilPressureSensor", "OilTemperatureSensor", "OilFlowSensor")
def test_sensors() -> None:
    state = {"a.p": P_A, "a.T": T_A}
    found = part("OilPressureSensor")(state)
    agree(found["y"], P_A)
    agree([found["a.m"], found["a.H"]], 0, size=1e-12)
    found = part("OilTemperatureSensor")(state)
    agree(found["y"], T_A)
    agree([found["a.m"], found["a.H"]], 0, size=1e-12)
    m = np.array([0.3, -0.2])
    found = part("OilFlowSensor", m_t="1e-9 kg/s", G="1e-9 W/K")({"a.m": m, "a.p": 60e5, "a.T": 320.0, "b.T": 340.0})
    agree(found["y"], m*np.array([OIL.v(60e5, 320), OIL.v(60e5, 340)]), 1e-8)
    agree(found["a.H"], m*np.array([OIL.h(60e5, 320), OIL.h(60e5, 340)]), 1e-7)
    agree([found["b.p"], found["b.m"]], [[60e5, 60e5], -m], size=1e-3)


@checks("OilCylinder")
def test_cylinder_is_two_chambers_with_a_gap_and_walls() -> None:
    """Held in place and closed: leakage levels the pressures, and the walls take the heat."""
    found = run("""
model: held
components:
  part: {is: OilCylinder, A_A: 20 cm**2, A_B: 12 cm**2, V_A0: 0.2 L, V_B0: 0.3 L, leakage: 1e-11 m**3/(s*Pa), G: 20 W/K}
  wall: {is: Fixed}
  rod:  {is: Fixed, x0: 50 mm}
  room: {is: Ambient, T_0: 30 degC}
nodes: {wall: [wall.a, part.a], rod: [rod.a, part.b], A: [part.A], B: [part.B], room: [part.h, room.a]}
initial: {A.p: 100 bar, B.p: 0 bar, A.T: 40 degC, B.T: 20 degC}
simulate: {until: 400 s}
""").si
    V = 0.2e-3 + 20e-4*0.05, 0.3e-3 - 12e-4*0.05
    mass = V[0]/OIL.v(100e5, 313.15) + V[1]/OIL.v(0, 293.15)
    agree([found["A.T"][-1], found["B.T"][-1]], 303.15, 1e-6)
    agree(found["A.p"][-1], found["B.p"][-1], 1e-6)
    agree(sum(V)/OIL.v(float(found["A.p"][-1]), float(found["A.T"][-1])), mass, 1e-7)
    agree(found["part.b.f"][-1], -(20 - 12)*1e-4*found["A.p"][-1], 1e-6)
    # what has flowed through the gap in the first instants: laminar, by the viscosity at the mean temperature
    agree(found["part.gap.m"][0], 1e-11*46e-6/OIL.nu(303.15)*100e5/OIL.v(50e5, 303.15), 1e-6)


def test_the_oil_of_a_pump_that_reverses_is_smooth() -> None:
    """No jump and no kink of the enthalpy flow through zero: its second difference falls with the square of the step."""
    law = part("OilFlowSource", T_s="340 K")

    def worst(n: int) -> float:
        u = np.linspace(-1e-6, 1e-6, n)
        return float(np.abs(np.diff(law({"u": u, "a.p": 1e5, "a.T": 300.0})["a.H"], 2)).max())
    assert worst(4001)/worst(2001) < 0.26
