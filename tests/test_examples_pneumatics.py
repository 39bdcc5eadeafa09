"""The example of every pneumatic component, beside closed forms and SciPy.

The references know nothing of heavebond: flow by ISO 6358 with the plain power law, gas by its mass and its internal
energy, integrated by SciPy at 1e-10.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import test_library_drives as drives
import test_library_motors as motors
from examples import FOLDER, Array, Case, check, without_example
from pneumatics_reference import C_P, C_V, KAPPA, P_0, RHO_0, RT, T_0, R, integrated, iso
from scipy.optimize import brentq

import heavebond as hb

TIGHT = 1e-5  # the integration's 1e-6 of each state, times what a valve's opening depends on it
STRAIGHT = 2e-4  # the straight part of the flow law, below drops of 1 kPa


# -- vessels and lines -------------------------------------------------------------------------------------------------
def cooling(t: Array) -> Array:
    """A closed vessel gives its heat to the walls: T' = -G (T - T_0)/(m c_v)."""
    m = 5e5*0.01/(R*380)
    return T_0 + (380 - T_0)*np.exp(-0.5/(m*C_V)*t)


def leaking(t: Array) -> Array:
    """p' = -k (p**2 - p_0**2)/(2 p_0), so that (p - p_0)/(p + p_0) decays with k."""
    share = (8e5 - P_0)/(8e5 + P_0)*np.exp(-5e-9*RT/2e-3*t)
    return P_0*(1 + share)/(1 - share)


def shared(t: Array) -> Array:
    """Gas and wall in line by 5 W/K: their difference decays, the sum stays."""
    gas, wall = 6e5*0.01/(R*400)*C_V, 0.2*900
    mean = (gas*400 + wall*T_0)/(gas + wall)
    return mean + (400 - mean)*np.exp(-5*(1/gas + 1/wall)*t)


def emptied(t: Array) -> Array:
    """An insulated vessel through a restriction: mass and internal energy."""
    def rate(_: float, y: Array) -> list[float]:
        mass, energy = y
        temperature = energy/(mass*C_V)
        flow = iso(1.2e-8, 0.35, mass*R*temperature/0.02, P_0, T_1=temperature)
        return [-flow, -flow*KAPPA*C_V*temperature]

    mass = 11e5*0.02/(R*T_0)
    return integrated(rate, [mass, mass*C_V*T_0], t)[1]*(KAPPA - 1)/0.02


def other_gas(r: float, kappa: float) -> Callable[[Array], Array]:
    """A vessel of another gas with walls at 20 degC; a conductance measured with air passes sqrt(R_air/R) of its mass."""
    c_v = r/(kappa - 1)

    def rate(_: float, y: Array) -> list[float]:
        mass, energy = y
        temperature = energy/(mass*c_v)
        flow = np.sqrt(R/r)*iso(0.5e-8, 0.3, mass*r*temperature/5e-3, P_0, T_1=temperature)
        return [-flow, 2*(T_0 - temperature) - flow*kappa*c_v*temperature]

    mass = 7e5*5e-3/(r*T_0)
    return lambda t: integrated(rate, [mass, mass*c_v*T_0], t)[1]*(kappa - 1)/5e-3


def pipe(m: Array) -> Array:
    """Inlet pressure of 10 m of smooth tube, 6 mm, for a mass flow to the air: Hagen-Poiseuille below Re = 1190, Blasius."""
    reynolds = 4*m/(np.pi*0.006*18.2e-6)
    friction = np.maximum(64/reynolds, 0.3164/reynolds**0.25)
    return np.sqrt(P_0**2 + friction*10/0.006*(m/(np.pi/4*0.006**2))**2*RT)


def tube(t: Array) -> Array:
    """Two halves of 5 m of tube, the gas between them and the vessel behind, all at one temperature."""
    def flow(p_1: float, p_2: float) -> float:
        n = (p_1**2 - p_2**2)*0.006**3/(2.5*RT*18.2e-6**2)
        return float(np.sign(n)*min(abs(n)/64, (abs(n)/0.3164)**(4/7))*np.pi/4*0.006*18.2e-6)

    def rate(_: float, p: Array) -> list[float]:
        first, second = flow(7e5, p[0]), flow(p[0], p[1])
        return [RT/(np.pi/4*0.006**2*5)*(first - second), RT/5e-4*second]

    return integrated(rate, [1e5, 1e5], t)[1]


# -- valves ------------------------------------------------------------------------------------------------------------
def rectified(t: Array) -> Array:
    def rate(time: float, p: Array) -> list[float]:
        opening = min(max((p[0] - p[1] - 5e3)/1e4, 0), 1)
        flow = opening*iso(5e-8, 0.3, p[0], p[1])
        return [RT/2e-3*(5e-3*np.sin(2*np.pi*time) - flow), RT/4e-3*flow]

    return integrated(rate, [2e5, 2e5], t)[1]


def relieved(t: Array) -> Array:
    def rate(_: float, p: Array) -> list[float]:
        return [RT/5e-3*(3e-3 - min(max((p[0] - P_0 - 6e5)/0.6e5, 0), 1)*iso(1e-8, 0.3, p[0], P_0))]

    return integrated(rate, [5e5], t)[0]


def regulated(t: Array) -> Array:
    def rate(_: float, p: Array) -> list[float]:
        feed = min(max((4e5 - (p[0] - P_0))/5e4, 0), 1)*iso(3e-8, 0.3, 9e5, p[0])
        return [RT/1e-3*(feed - 2e-3)]

    return integrated(rate, [1e5], t)[0]


def spool(time: float, t_s: float, after: float) -> float:
    """A spool of a 3/2 valve that is energised at 0 (or was) and let go at `after`."""
    lag = t_s/np.log(10)
    return float(1 - np.exp(-time/lag)) if time < after else float((1 - np.exp(-after/lag))*np.exp(-(time - after)/lag))


def switched(t: Array) -> Array:
    def rate(time: float, p: Array) -> list[float]:
        x = spool(time, 0.02, 1.0)
        return [RT/1e-3*(x*iso(2e-8, 0.3, 7e5, p[0]) - (1 - x)*iso(2e-8, 0.3, p[0], P_0))]

    return integrated(rate, [1e5], t, [1.0])[0]


def throttled(t: Array) -> Array:
    """Filled through the check valve, emptied through the needle, by a 3/2 valve and a short tube."""
    def rate(time: float, p: Array) -> list[float]:
        x = 1.0 if time < 1 else float(np.exp(-(time - 1)*np.log(10)/0.01))
        valve = x*iso(5e-8, 0.3, 7e5, p[0]) - (1 - x)*iso(5e-8, 0.3, p[0], P_0)
        opening = min(max((p[0] - p[1] - 5e3)/1e4, 0), 1)
        control = opening*iso(4e-8, 0.3, p[0], p[1]) - iso(0.2e-8, 0.3, p[1], p[0])
        return [RT/2e-5*(valve - control), RT/5e-4*control]

    return integrated(rate, [1e5, 1e5], t, [1.0])[1]


def vented(t: Array) -> Array:
    """A vessel behind a quick exhaust valve, whose short line is filled and vented by a 3/2 valve."""
    def rate(time: float, p: Array) -> list[float]:
        x = spool(time, 0.01, 4.0)
        valve = x*iso(1e-8, 0.3, 7e5, p[0]) - (1 - x)*iso(1e-8, 0.3, p[0], P_0)
        feed = min(max((p[0] - p[1])/5e3, 0), 1)*iso(2e-8, 0.3, p[0], p[1])
        vent = min(max((p[1] - p[0] - 5e3)/5e3, 0), 1)*iso(8e-8, 0.3, p[1], P_0)
        return [RT/5e-5*(valve - feed), RT/2e-3*(feed - vent)]

    return integrated(rate, [P_0, P_0], t, [4.0])[1]


def crossed(row: int) -> Callable[[Array], Array]:
    """One vessel is filled and one vented through a 5/3 valve that opens at 0 and shuts at 0.3 s."""
    def rate(time: float, p: Array) -> list[float]:
        x = spool(time, 0.02, 0.3)
        return [RT/2e-3*x*iso(2e-8, 0.3, 7e5, p[0]), -RT/2e-3*x*iso(2e-8, 0.3, p[1], P_0)]

    return lambda t: integrated(rate, [1e5, 7e5], t, [0.3])[row]


# -- cylinders ---------------------------------------------------------------------------------------------------------
def bounced(t: Array) -> Array:
    """A mass on two closed chambers, p V**kappa constant in each; the rest of the forces is constant."""
    a_a, a_b = np.pi/4*0.05**2, np.pi/4*(0.05**2 - 0.02**2)

    def force(x: float) -> float:
        p_a = 5e5*((2e-5 + a_a*0.101)/(2e-5 + a_a*x))**KAPPA
        p_b = 5e5*((2e-5 + a_b*0.099)/(2e-5 + a_b*(0.2 - x)))**KAPPA
        return float(a_a*p_a - a_b*p_b)

    return integrated(lambda _, y: [y[1], (force(y[0]) - force(0.101))/30], [0.101, 0.2], t)[0]


def clamped(t: Array) -> Array:
    """Mass and energy of the gas, mass on spring and damper."""
    area = np.pi/4*0.032**2

    def rate(_: float, y: Array) -> list[float]:
        x, v, _, energy = y
        volume = 1e-5 + area*x
        pressure = energy*(KAPPA - 1)/volume
        flow = iso(2e-10, 0.3, 4e5, pressure)
        force = area*(pressure - P_0) - 60 - 1500*x - 2000*v
        return [v, force, flow, flow*C_P*T_0 - pressure*area*v]

    mass = 1.7592e5*1e-5/RT
    return integrated(rate, [0, 0, mass, mass*C_V*T_0], t)[0]


CASES = [
    Case("atmosphere", "1*vessel.p", lambda t: 1e5 + 2e4*np.exp(-t*RT/(5e7*1e-3)), "laminar discharge, exponential", TIGHT),
    Case("pneumatic_line", "1*vessel.p", lambda t: 3e5 - 2e5*np.exp(-t*RT/(2e8*2e-3)),
         "laminar filling, exponential", TIGHT),
    Case("laminar_pneumatic_leakage", "1*vessel.p", leaking, "the difference of squares, separated", TIGHT),
    Case("receiver", "1*vessel.p", lambda t: 1e5 + 2e-3*RT/0.01*t, "isothermal filling", TIGHT),
    Case("receiver_with_heat", "1*vessel.T", cooling, "first-order decay", TIGHT),
    Case("receiver_with_heat", "1*vessel.p", lambda t: 5e5*cooling(t)/380, "gas law at constant volume", TIGHT),
    Case("gas", "1*vessel.p", other_gas(188.9, 1.29), "mass and energy of carbon dioxide, SciPy", TIGHT),
    Case("nitrogen", "1*vessel.p", other_gas(8.314462618/28.0134e-3, 1.4), "mass and energy; R from the molar mass", 5e-5),
    Case("receiver_with_heat_port", "1*vessel.T", shared, "two bodies", TIGHT),
    Case("pneumatic_source", "1*outlet.m", lambda t: np.full_like(t, 5e-9*7e5), "choked: C*p", TIGHT),
    Case("pneumatic_valve", "1*valve.m", lambda t: np.minimum(t, 1)*5e-9*7e5, "choked: u*C*p", TIGHT),
    Case("pneumatic_orifice", "1*vessel.p", lambda t: integrated(
        lambda _, p: [-RT/0.01*iso(5e-9/RHO_0, 0.3, p[0], P_0)], [8e5], t)[0], "isothermal discharge, SciPy", STRAIGHT),
    Case("iso_orifice", "1*vessel.p", emptied, "adiabatic discharge by mass and energy, SciPy; c_p differs by 3e-4", 5e-4),
    Case("iso_valve", "1*valve.m", lambda t: iso(2e-8, 0.3, 7e5, 5e5, 0.55)*(1 - 0.5*np.clip(t - 1, 0, 1)),
         "subsonic, with its own index", TIGHT),
    Case("mass_flow_sensor", "1*meter.y", lambda t: np.full_like(t, 1e-8*RHO_0*7e5), "choked: C*rho_0*p", TIGHT),
    Case("silencer", "1*vessel.p", lambda t: integrated(lambda _, p: [-RT/2e-3*iso(2e-8, 0.3, p[0], 1e5)], [6e5], t)[0],
         "isothermal discharge, SciPy", STRAIGHT),
    Case("pneumatic_check_valve", "1*vessel.p", rectified, "SciPy", TIGHT),
    Case("pneumatic_relief_valve", "1*vessel.p", relieved, "SciPy", TIGHT),
    Case("pneumatic_shuttle_valve", "1*vessel.p", lambda t: 1e5 + RT/5e-3*iso(1e-8, 0.3, 6e5, 1e5)*t,
         "choked filling", TIGHT),
    Case("quick_exhaust_valve", "1*vessel.p", vented, "SciPy", STRAIGHT),
    Case("pneumatic_regulator", "1*vessel.p", regulated, "SciPy", TIGHT),
    Case("pneumatic_valve32", "1*vessel.p", switched, "SciPy", STRAIGHT),
    Case("one_way_flow_control", "1*vessel.p", throttled, "SciPy", STRAIGHT),
    Case("pneumatic_valve53", "1*left.p", crossed(0), "SciPy", STRAIGHT),
    Case("pneumatic_valve53", "1*right.p", crossed(1), "SciPy", STRAIGHT),
    Case("smooth_pneumatic_line", "1*inlet.p", lambda t: pipe(2e-5 + 2e-4*t), "Hagen-Poiseuille and Blasius", TIGHT),
    Case("pneumatic_tube", "1*vessel.p", tube, "SciPy, isothermal; the walls leave 1e-4 of T_0", 5e-4),
    Case("pneumatic_flow_source", "1*vessel.p", lambda t: 1e5 + (KAPPA - 1)*C_P*350*1e-3*t/0.01,
         "energy of an insulated vessel", TIGHT),
    Case("pneumatic_pressure_sensor", "1*gauge.y", lambda t: 2e-3*RT/0.01*t, "isothermal filling", TIGHT),
    Case("pneumatic_chamber", "1*gas.p", lambda t: 2e5*(1 - 0.6*np.sin(2*np.pi*t))**-KAPPA, "p*V**kappa stays", TIGHT),
    Case("pneumatic_chamber", "1*gas.T", lambda t: T_0*(1 - 0.6*np.sin(2*np.pi*t))**(1 - KAPPA),
         "T*V**(kappa-1) stays", TIGHT),
    Case("pneumatic_cylinder", "1*load.x", bounced, "SciPy with p*V**kappa", TIGHT),
    Case("pneumatic_cylinder_single", "1*jaw.x", clamped, "SciPy by mass and energy; c_p differs by 3e-4", 4e-4),
]


@pytest.mark.parametrize("case", CASES, ids=[f"{c.example}-{c.signal}" for c in CASES])
def test_examples(case: Case) -> None:
    check(case)


def test_every_component_has_one() -> None:
    shown = [*CASES, Case("gas_temperature_sensor", "thermometer.y", np.zeros_like, "see below")]
    assert not without_example(["pneumatic"], [*shown, *drives.PNEUMATIC, *motors.PNEUMATIC])


def test_gas_let_into_a_vacuum_becomes_kappa_times_as_hot() -> None:
    run = hb.simulate(hb.load(FOLDER / "gas_temperature_sensor.yaml"))
    # energy: (p - p_i) V/(kappa - 1) = c_p T_s m_in; the little gas that was there shares it
    p = run["1*vessel.p"]
    expected = p/(1e3/T_0 + (p - 1e3)*R/((KAPPA - 1)*C_P*T_0))
    assert run["thermometer.y"] == pytest.approx(expected, rel=TIGHT)
    assert run["thermometer.y"][-1] == pytest.approx(KAPPA*T_0, rel=2e-3)  # 0.2 % of the gas was there before


@pytest.mark.parametrize("until", [4e5, 3e5])
def test_the_choked_vessel_empties_in_the_time_of_the_closed_form(until: float) -> None:
    """Isothermal, p' = -p/tau. Insulated, T follows p**((kappa - 1)/kappa), so that p' = -a p**((3 kappa - 1)/(2 kappa))."""
    run = hb.simulate(hb.load(FOLDER / "iso_orifice.yaml"), every="1 ms")
    p = run["1*vessel.p"]
    found = np.interp(-until, -p, run.time)
    rate = KAPPA*R*T_0*1.2e-8*RHO_0/0.02
    power = (KAPPA - 1)/(2*KAPPA)
    assert found == pytest.approx(((11e5/until)**power - 1)/(rate*power), rel=5e-4)  # c_p differs by 3e-4
    isothermal = hb.simulate(hb.load(FOLDER / "pneumatic_orifice.yaml"), every="10 ms")
    p = isothermal["1*vessel.p"]
    found = np.interp(-until, -p, isothermal.time)
    if until > P_0/0.3:  # choked so far
        assert found == pytest.approx(0.01/(RT*5e-9)*np.log(8e5/until), rel=2e-5)


def test_relief_valve_and_regulator_settle_where_what_comes_leaves() -> None:
    relief = hb.simulate(hb.load(FOLDER / "pneumatic_relief_valve.yaml"))["1*vessel.p"][-1]
    assert relief == pytest.approx(brentq(lambda p: (p - P_0 - 6e5)/0.6e5*1e-8*RHO_0*p - 3e-3, 7e5, 8e5), rel=1e-5)
    held = hb.simulate(hb.load(FOLDER / "pneumatic_regulator.yaml"))["1*vessel.p"][-1]
    assert held == pytest.approx(brentq(lambda p: (4e5 - p + P_0)/5e4*iso(3e-8, 0.3, 9e5, p) - 2e-3, 4.6e5, 5e5), rel=1e-5)


def test_friction_over_speed_is_the_stribeck_curve() -> None:
    """F_c + (F_s - F_c) exp(-(v/v_s)**2), with the sign of the speed, and viscous friction."""
    run = hb.simulate(hb.loads("""
model: stribeck
components:
  wall: {is: Fixed}
  hand: {is: VelocitySource, u: "=-0.5 m/s + 1 m/s*time/10 s"}
  seal: {is: StribeckFriction, F_c: 60 N, F_s: 100 N, v_s: 50 mm/s, sigma_2: 80 N*s/m, v_t: 0.1 mm/s}
nodes: {wall: [wall.a, seal.a], hand: [hand.a, seal.b]}
initial: {hand.x: 0 m}
show: {seal.F: {unit: N}}
simulate: {until: 10 s, every: 10 ms}
"""))
    v = run["hand.v"]
    curve = (60 + 40*np.exp(-(v/0.05)**2))*np.sign(v) + 80*v
    moving = np.abs(v) > 1e-3  # ten times the speed of transition, where tanh is 1 to 4e-9
    assert run["seal.F"][moving] == pytest.approx(curve[moving], rel=1e-8)
    assert run["seal.F"].max() == pytest.approx(curve.max(), rel=1e-2)


def test_a_shuttle_valve_shuts_the_lower_supply_off() -> None:
    run = hb.simulate(hb.load("examples/pneumatic_shuttle_valve"))
    assert np.abs(run["1*valve.second.m"]).max() < 1e-9 * run["1*valve.first.m"].max()
