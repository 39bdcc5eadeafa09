"""The example of every thermohydraulic component, beside a closed form or an independent computation."""

from __future__ import annotations

import numpy as np
import pytest
from examples import Array, Case, check, without_example
from oil_reference import OIL, OilData, rated
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

ZERO = 273.15  # K, 0 degC
TIGHT = 2e-6   # integration is accurate to 1e-8 of each state, times the number of time constants that are seen
LITRES = 1/6e4  # L/min in m**3/s


def heated(t: Array) -> tuple[Array, Array]:
    """Pressure and temperature of 2 L of oil that are locked in and heated by 200 W: v stays, u rises."""
    v, u = OIL.v(0, 293.15), OIL.u(0, 293.15)

    def pressure(T: float) -> float:
        return float(brentq(lambda p: OIL.v(p, T) - v, -1e6, 1e8, xtol=1e-6))

    def temperature(time: float) -> float:
        return float(brentq(lambda T: OIL.u(pressure(T), T) - u - 200*time*v/2e-3, 293, 320, xtol=1e-10))

    T = np.array([temperature(time) for time in t])
    return np.array([pressure(x) for x in T]), T


def compressed(t: Array) -> tuple[Array, Array]:
    """1 L at 20 degC compressed by 1 cm**3/s: dv = v_p dp + v_T dT with c_p dT = T v_T dp, the isentrope."""
    v_0 = OIL.v(0, 293.15)

    def rates(time: float, y: Array) -> Array:
        p, T = y
        slope = T*OIL.v_T(p, T)/OIL.c_p
        dp = -1e-3*v_0/(OIL.v_p(p, T) + OIL.v_T(p, T)*slope)
        return np.array([dp, slope*dp])
    found = solve_ivp(rates, (0, t[-1]), [0.0, 293.15], t_eval=t, rtol=1e-10, atol=[1e-3, 1e-10], method="DOP853").y
    return found[0], found[1]


def throttled() -> float:
    """Temperature behind an orifice from 200 bar and 40 degC at the same enthalpy, at the drop of the outlet."""
    def wrong(y: Array) -> list[float]:
        p, T = y[0]*1e5, y[1]
        first = rated(10*LITRES, 200e5, 200e5 - p)*np.sqrt(860/OIL.v((200e5 + p)/2, (313.15 + T)/2))
        second = rated(100*LITRES, 1e5, p)*np.sqrt(860/OIL.v(p/2, (T + 313.15)/2))
        return [first - second, (OIL.h(p, T) - OIL.h(200e5, 313.15))/1e3]
    return float(fsolve(wrong, [0.01, 320.0], xtol=1e-12)[1])


def relieved() -> float:
    """Pressure of a relief valve that passes 20 L/min of oil at 40 degC."""
    return float(brentq(lambda p: 20*LITRES/OIL.v(p, 313.15) - 1e-10*(p - 100e5)/OIL.v(p/2, 313.15), 101e5, 200e5,
                        xtol=1e-3))


def pumped() -> tuple[float, float, float]:
    """Pressure, temperature and shaft power: a pump with losses, an orifice, the first law."""
    D, w = 28e-6/(2*np.pi), 157.07963267948966
    friction = D*200e5*(1/0.92 - 1)

    def point(p: float) -> tuple[float, float, float]:
        swept, leak = D*w/OIL.v(0, 313.15), D*w/200e5*0.06*p/OIL.v(0, 313.15)
        return swept, swept - leak, w*(D*p + friction*(0.5 + 0.5*p/200e5))

    def wrong(y: Array) -> list[float]:
        p, T = y[0]*1e5, y[1]
        swept, flow, power = point(p)
        out = rated(40*LITRES, 200e5, p)*np.sqrt(860/OIL.v(p/2, (T + 313.15)/2))
        return [flow - out, (swept*(OIL.h(p, T) - OIL.h(0, 313.15)) - power)/1e4]
    p, T = fsolve(wrong, [190.0, 317.0], xtol=1e-13)
    return float(p*1e5), float(T), point(float(p*1e5))[2]


def adapted() -> float:
    """Mass flow of 12 L/min at 50 degC and the pressure that the orifice needs for it."""
    p = brentq(lambda p: 12*LITRES/OIL.v(p, 323.15) - rated(12*LITRES, 50e5, p)*np.sqrt(860/OIL.v(p/2, (323.15 + 293.15)/2)),
               1e5, 90e5, xtol=1e-3)
    return float(12*LITRES/OIL.v(p, 323.15))


def lined() -> float:
    """Steady temperature: what 3 L/min of oil at 60 degC lose is what goes through 40 W/(m**2*K)*pi*30 mm*5 m to 20 degC."""
    flow, area = 3*LITRES/OIL.v(0, 333.15), 40*np.pi*0.03*5
    return (flow*1950*333.15 + area*293.15)/(flow*1950 + area)


def laminar(dp: float, length: float, d: float, T: float, oil: OilData = OIL) -> float:
    """Hagen-Poiseuille's volume flow at one temperature."""
    return float(np.pi*d**4*dp/(128*oil.nu(T)/oil.v(dp/2, T)*length))


THIN = OilData(rho=840, nu_40=22e-6, nu_100=4.3e-6)
STIFF = OilData(alpha=0, k_T=0)
DRAWN = 12*LITRES/OIL.v(0, 333.15)  # kg/s, of the source that turns round
CASES = [
    Case("oil", "1*pipe.q", lambda t: laminar(0.3e5, 4, 8e-3, 343.15, THIN),
         "Hagen-Poiseuille; the Reynolds number is 1700", 1e-9),
    Case("oil_pipe", "1*pipe.q", lambda t: laminar(2e5, 3, 12e-3, 273.15), "Hagen-Poiseuille", 1e-9),
    Case("oil_volume", "block.T - 293.15 K", lambda t: 60*np.exp(-6*LITRES*t/0.01),
         "perfect mixing without expansion; the enthalpy of 1 bar and the transition of the outlet are 1e-5 of it", 5e-4),
    Case("oil_chamber", "1*oil.p", lambda t: compressed(t)[0], "isentropic compression, integrated by DOP853", TIGHT),
    Case("oil_chamber", "oil.T - 293.15 K", lambda t: compressed(t)[1] - 293.15, "as the pressure", 1e-5),
    Case("oil_wall", "1*oil.p", lambda t: heated(t)[0], "first law at constant volume", TIGHT),
    Case("oil_pressure_sensor", "1*gauge.y", lambda t: heated(t)[0], "first law at constant volume", TIGHT),
    Case("oil_temperature_sensor", "gauge.y - 293.15 K", lambda t: heated(t)[1] - 293.15,
         "first law at constant volume", 1e-5),
    Case("oil_tank", "tank.T - 293.15 K",
         lambda t: 40/(1 + 860*0.02*OIL.v(0, 333.15)/(12*LITRES)/np.maximum(t, 1e-9)),
         "heat of two amounts of oil; the conductance at zero flow of the source carries 0.04 of 6600 W", 1e-5),
    Case("oil_reservoir", "1*orifice.H",
         lambda t: rated(30*LITRES, 100e5, 50e5)*np.sqrt(860/OIL.v(25e5, 313.15))*OIL.h(50e5, 333.15),
         "enthalpy from upstream; the conductance at zero flow carries 0.04 W, the transition is (1e-4/0.3)**2/2", 1e-5),
    Case("oil_flow_source", "1*pump.m", lambda t: DRAWN*np.cos(2*np.pi*t/10), "density at 60 degC", 1e-9),
    Case("oil_flow_source", "-pump.a.H", lambda t: DRAWN*1950*20*np.abs(np.cos(2*np.pi*t/10)),
         "oil goes out at 60 degC and comes in at 20; within 1e-4 kg/s both mix", 5e-4),
    Case("oil_orifice", "block.T - 313.15 K", lambda t: throttled() - 313.15,
         "throttling at constant enthalpy; the conductance at zero flow draws 3e-6 of the heat", 1e-5, begin=25.0),
    Case("oil_valve", "1*valve.m",
         lambda t: t*rated(30*LITRES, 100e5, 100e5)*np.sqrt(860/OIL.v(50e5, 313.15)), "opening", 1e-9),
    Case("oil_relief_valve", "1*line.p", lambda t: relieved(),
         "what comes goes; the node warms by 2e-6 K over the conductance at zero flow", 1e-6),
    Case("oil_leakage", "1*gap.m", lambda t: 1e-12*46e-6/OIL.nu(333.15)*100e5/OIL.v(50e5, 333.15), "laminar gap", 1e-9),
    Case("oil_line", "line.middle.T - 293.15 K", lambda t: lined() - 293.15,
         "balance of heat; the pressure drops by 100 Pa", 1e-4, begin=3000.0),
    Case("oil_pump", "1*delivery.p", lambda t: pumped()[0], "flow through pump and orifice", 1e-6, begin=15.0),
    Case("oil_pump", "delivery.T - 313.15 K", lambda t: pumped()[1] - 313.15, "first law", 1e-5, begin=15.0),
    Case("oil_pump", "pump.s.tau*shaft.w", lambda t: pumped()[2],
         "torque of the machine with its friction", 1e-6, begin=15.0),
    Case("oil_cooler", "1*cooler.Q", lambda t: 12e3,
         "the point of the data sheet; compression and the transition at 0.02 bar change the flow by 1e-4", 2e-4),
    Case("oil_cylinder", "1*load.v", lambda t: 10*LITRES/20e-4, "flow over area; the oil is stiff and its state settles",
         1e-4, begin=3.0),
    Case("hydraulic_adapter", "1*orifice.m", lambda t: adapted(), "volume flow at 50 degC", 1e-6),
    Case("oil_flow_sensor", "1*meter.y", lambda t: 12*LITRES, "the same oil in the same state", 1e-6),
]


@pytest.mark.parametrize("case", CASES, ids=[f"{c.example}-{c.signal}" for c in CASES])
def test_examples(case: Case) -> None:
    check(case)


def test_every_component_has_one() -> None:
    assert not without_example(["thermohydraulic"], CASES)
