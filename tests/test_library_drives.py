"""Solenoid, switch and diode, air motor and muscle, filters and switchable controllers beside formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from examples import Array, Case, check
from library_check import agree, checks, part, run
from scipy.optimize import brentq

PI = np.pi
RUN = "closed form; 1e-6 for the integration"
LAW = "algebraic"


def rectified(t: Array) -> Array:
    """Current of the diode with its load, each point by itself."""
    def through(v: float) -> float:
        return float(0.03/0.1*(np.logaddexp(0, (v - 0.7)/0.03) - np.logaddexp(0, -0.7/0.03)))

    return np.array([through(brentq(lambda v, u=u: through(v) - (u - v)/9.9, -11, 11, xtol=1e-14))
                     for u in 10*np.sin(2*PI*t)])


def suppressed(t: Array) -> Array:
    """At its notch the filter leaves (s**2 + w**2)/(s**2 + w*s + w**2)*w/(s**2 + w**2): a decaying swing only."""
    w = 2*PI*5
    own = w*np.sqrt(0.75)
    return np.asarray(w/own*np.exp(-w*t/2)*np.sin(own*t))


def coil(t: Array) -> Array:
    return np.asarray(2*(1 - np.exp(-t*6/0.03)))   # 10 mH and a third of 60 mH


def linear_motor(t: Array) -> Array:
    """Current and speed of L*di/dt = u - R*i - k*v, m*dv/dt = k*i - d*v from rest, by eigenvalues."""
    R, L, k, m, d = 2.0, 1e-3, 15.0, 0.5, 20.0
    system = np.array([[-R/L, -k/L], [k/m, -d/m]])
    final = np.linalg.solve(system, [-12/L, 0])
    values, vectors = np.linalg.eig(system)
    share = np.linalg.solve(vectors, -final)
    return np.asarray((final[:, None] + vectors @ (share[:, None]*np.exp(np.outer(values, t)))).real)


def muscle(t: Array) -> Array:
    """Chou and Hannaford: p pi D_0**2/4 (3 cos(theta)**2 - 1)/sin(alpha)**2 with the angle of the thread at this length."""
    theta = np.arccos(np.cos(np.radians(25))*(0.3 - 0.1*t)/0.3)
    return np.asarray(5e5*PI*0.02**2/4*(3*np.cos(theta)**2 - 1)/np.sin(np.radians(25))**2)


SIGNALS = [
    Case("lead_lag", "part.y", lambda t: 2*(1 + (0.3/0.1 - 1)*np.exp(-t/0.1)), RUN),
    Case("notch_filter", "part.y", suppressed, RUN, 1e-5),
    Case("switchable_pid", "part.y", lambda t: 3 + 0.5*np.maximum(t - 1, 0), RUN),
    # stationary gains sqrt(2)*w and w**2 with w**4 = S_a/S_u: poles at w/sqrt(2)*(-1 +- j)
    Case("kalman_filter", "part.P_x", lambda t: np.sqrt(2)*100**0.25*1e-4 + 0*t, RUN, 1e-6, begin=9),
    Case("kalman_filter", "part.v", lambda t: 1 + 0*t, RUN, 1e-6, begin=9),
]
ELECTRICAL = [
    Case("diode", "part.i", rectified, "root of the two laws", 1e-6),
    Case("electrical_switch", "coil.i", lambda t: 3*(1 - np.exp(-np.maximum(t - 0.1, 0)*20)), RUN, 1e-5),
    Case("solenoid", "part.i", coil, RUN, 1e-5),
    Case("solenoid", "part.F", lambda t: coil(t)**2/2*60/9, RUN, 1e-5),
    Case("voice_coil", "part.i", lambda t: linear_motor(t)[0], RUN),
    Case("voice_coil", "coil.v", lambda t: linear_motor(t)[1], RUN),
]
PNEUMATIC = [
    Case("controlled_pneumatic_source", "supply.p", lambda t: 3e5 + 1e5*t, LAW),
    Case("controlled_pneumatic_source", "orifice.m", lambda t: 1e-8*1.185*(3e5 + 1e5*t), LAW, 1e-4),   # transition dp_t
    Case("pneumatic_muscle", "part.F", muscle, LAW),
    Case("air_motor", "part.m", lambda t: 50e-6*25*6e5/(287.05*293.15) + 0*t, LAW),
    Case("air_motor", "part.s.tau", lambda t: -50e-6/(2*PI)*5e5 + 0*t, LAW),
]


@pytest.mark.parametrize("case", [*SIGNALS, *ELECTRICAL, *PNEUMATIC], ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_shows_the_law(case: Case) -> None:
    check(case)


@checks("LeadLag", "NotchFilter")
def test_filters() -> None:
    found = part("LeadLag", k=3, T_1="0.2 s", T_2="0.5 s", u=2)({"x": 0.5})
    agree(found["der(x)"], 3)
    agree(found["y"], 3*(0.5 + 0.4*1.5))
    law = part("NotchFilter", f_n="3 Hz", zeta_p=0.7, zeta_z=0.1, u=2)
    found = law({"x": 0.5, "v": 4})
    w = 6*PI
    agree(found["der(v)"], w**2*1.5 - 1.4*w*4)
    agree(found["y"], found["der(v)"]/w**2 + 0.2*4/w + 0.5)      # numerator of the transfer function


@checks("SwitchablePID")
def test_a_controller_takes_over_without_a_bump_and_hands_back() -> None:
    """The command is continuous at the change to automatic; by hand it is the manual command."""
    found = run("""
model: changed
components:
  part: {is: SwitchablePID, K_p: 3, K_i: 2 1/s, K_d: 0.2 s, T_f: 50 ms, y_min: -4 V, y_max: 4 V, T_t: 0.3 s,
         r: 1 V, u: "=0.5 V*sin(3*time/1 s)", m: "=1.5 V + 0.2 V*time/1 s", a: "=if_else(time > 1 s and time < 2 s, 1, 0)"}
initial: {part.z: 0.7 V, part.q: 3 V}
simulate: {until: 3 s, every: 1 ms}
""")
    t, y = found.time, found["part.y"]
    hand = 1.5 + 0.2*t
    agree(y[(t < 0.999) | (t > 2.001)], hand[(t < 0.999) | (t > 2.001)], rtol=1e-9)
    assert np.abs(np.diff(y))[(t[1:] > 0.99) & (t[1:] < 1.02)].max() < 0.02    # 1 ms of the largest rate
    assert y.max() <= 4
    assert np.ptp(y[(t > 1) & (t < 2)]) > 0.5


@checks("KalmanFilter")
def test_a_kalman_filter_solves_the_riccati_equation() -> None:
    P = np.array([[3e-4, 2e-4], [2e-4, 9e-4]])
    A, C = np.array([[0, 1], [0, 0]]), np.array([[1, 0]])
    law = part("KalmanFilter", S_u="1e-4 m**2*s", S_a="2e-3 m**2/s**3", u=0.7, a=0.3)
    found = law({"x_e": 0.2, "v_e": 0.5, "P_x": P[0, 0], "P_c": P[0, 1], "P_v": P[1, 1]})
    rate = A @ P + P @ A.T + np.diag([0, 2e-3]) - P @ C.T @ C @ P/1e-4
    agree([found["der(P_x)"], found["der(P_c)"], found["der(P_v)"]], [rate[0, 0], rate[0, 1], rate[1, 1]])
    agree([found["der(x_e)"], found["der(v_e)"]], [0.5 + 3*0.5, 0.3 + 2*0.5])


@checks("Diode", "ElectricalSwitch", "Solenoid")
def test_diode_switch_and_solenoid() -> None:
    law = part("Diode", V_f="0.8 V", R_on="0.05 ohm", G_off="1e-4 A/V", V_t="20 mV")
    agree(law({"a.v": 0, "b.v": 0})["a.i"], 0, size=1)
    agree(law({"a.v": 1.8, "b.v": 0})["a.i"], 1/0.05 + 1.8e-4)
    agree(law({"a.v": -50, "b.v": 0})["a.i"], -50e-4, rtol=1e-8)
    assert np.all(np.diff(law({"a.v": np.linspace(-1, 2, 301), "b.v": 0})["a.i"]) > 0)
    switch = part("ElectricalSwitch", R_on="20 mohm", G_off="1e-5 A/V")
    agree(switch({"a.v": 3, "b.v": 1, "u": np.array([-1, 0, 1, 2])})["a.i"], [2e-5, 2e-5, 100, 100])
    coil = part("Solenoid", R="5 ohm", L_0="10 mH", L_1="80 mH", g_0="0.5 mm", l0="1 mm")
    found = coil({"a.v": 24, "b.v": 0, "s.x": 2.5e-3, "h.x": 0, "s.v": -0.2, "h.v": 0, "i": 3})
    L = 0.01 + 0.08/4
    slope = -0.08/0.5e-3/16
    agree(found["der(i)"], (24 - 15 - slope*(-0.2)*3)/L)
    agree(found["s.f"], -slope*9/2)             # the plunger is pulled down, the component up
    agree(found["h.f"], slope*9/2)


@checks("ControlledPneumaticSource", "PneumaticMuscle", "AirMotor")
def test_pneumatic_parts() -> None:
    source = part("ControlledPneumaticSource", T_0="300 K")({"u": 4e5, "a.m": -0.01, "a.H": -3e3})
    agree([source["a.p"], source["a.T"]], [4e5, 300])
    motor = part("AirMotor", D="60 cm**3/rev", M_c="0.4 N*m", d="0.002 N*m*s/rad", G="1e-9 W/K")
    D = 60e-6/(2*PI)
    for w in (150.0, -150.0):
        found = motor({"a.p": 6e5, "b.p": 1e5, "a.T": 300, "b.T": 280, "s.w": w})
        torque = D*5e5 - 0.002*w - 0.4*np.tanh(w)
        agree(found["s.tau"], -torque)
        m = D*w*(6e5/300 if w > 0 else 1e5/280)/287.05
        agree([found["a.m"], found["b.m"]], [m, -m])
        # the gas that leaves has given away the work
        left, given = (found["b.H"], -m*1005*300) if w > 0 else (found["a.H"], m*1005*280)
        agree(left, given + torque*w, rtol=1e-8)
        agree(found["a.H"] + found["b.H"], torque*w, rtol=1e-8)
    law = part("PneumaticMuscle", L_0="200 mm", D_0="10 mm", alpha="30 deg", V_d="2 cm**3", G="0.5 W/K")
    found = law({"a.x": 0, "b.x": 0.18, "a.v": 0, "b.v": 0.1, "g.p": 4e5, "T": 310, "g.m": 1e-4, "g.H": 40.0})
    thread, turns = 0.2/np.cos(np.radians(30)), 0.2*np.tan(np.radians(30))/(PI*0.01)

    def volume(L: float) -> float:
        return float(L*(thread**2 - L**2)/(4*PI*turns**2))     # diameter by the length of the thread and its turns

    slope = (thread**2 - 3*0.18**2)/(4*PI*turns**2)
    agree(found["V"], 2e-6 + volume(0.18))
    agree(found["b.f"], -(4e5 - 101325)*slope)
    V, heat = 2e-6 + volume(0.18), 0.5*(293.15 - 310)
    agree(found["der(g.p)"], (0.4*(40 + heat) - 1.4*4e5*slope*0.1)/V)
    # mass: d(p V/(R T))/dt
    agree((found["der(g.p)"]*V + 4e5*slope*0.1 - 4e5*V/310*found["der(T)"])/(287.05*310), 1e-4, rtol=1e-8)
