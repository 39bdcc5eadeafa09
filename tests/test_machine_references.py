"""Bundled machines beside the same machines written by hand and integrated by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from pneumatics_reference import C_P, C_V, KAPPA, P_0, RT, T_0, Array, integrated, iso
from scipy.optimize import brentq

import heavebond as hb

G = 9.81  # what a Weight has unless told otherwise


def test_quarter_car_over_a_bump() -> None:
    run = hb.simulate(hb.load("quarter_car"))
    m_s, m_u, k, c, k_t, c_t = 320.0, 40.0, 22e3, 1.5e3, 190e3, 150.0

    def rate(time: float, y: Array) -> list[float]:
        body, wheel, v_body, v_wheel = y
        bump = 0.03*np.exp(-((5*time - 5)/0.4)**2)
        slope = -bump*2*(5*time - 5)/0.4**2*5
        strut = k*(body - wheel) + c*(v_body - v_wheel)
        return [v_body, v_wheel, -strut/m_s, (strut - k_t*(wheel - bump) - c_t*(v_wheel - slope))/m_u]

    body, wheel, v_body, v_wheel = integrated(rate, [0, 0, 0, 0], run.time)
    # the integration keeps 1e-6 of positions of 0.6 m; the bump is 1e-69 m at the start
    assert run["1*body.x"] - run["1*body.x"][0] == pytest.approx(body, abs=1e-6*0.6)
    assert run["1*wheel.x"] - run["1*wheel.x"][0] == pytest.approx(wheel, abs=1e-6*0.6)
    assert run["1*body.x"][0] == pytest.approx(0.8 - m_s*G/k - (m_s + m_u)*G/k_t, rel=1e-9)
    assert run["comfort"] == pytest.approx((-k*(body - wheel) - c*(v_body - v_wheel))/m_s, abs=1e-4)
    assert run["comfort"].max() == pytest.approx(2.1048, abs=2e-4)


def valve_to_air(opening: float, line: float) -> float:
    """Mass flow from a line through an edge of the valve and a silencer behind it; the node between has no volume."""
    if opening <= 0 or line <= P_0:
        return 0.0
    between = brentq(lambda p: opening*iso(3e-8, 0.3, line, p) - iso(6e-8, 0.3, p, P_0), P_0, line, xtol=1e-6)
    return iso(6e-8, 0.3, between, P_0)


def cylinder_rates(time: float, y: Array) -> list[float]:
    """x, v, then mass (g) and energy (kJ) of the gas in each chamber, pressures of both lines (bar), spool."""
    x, v, m_a, u_a, m_b, u_b, line_a, line_b, spool = y
    a_a, a_b = np.pi/4*0.04**2, np.pi/4*(0.04**2 - 0.016**2)
    volumes = (12e-6 + a_a*x, 12e-6 + a_b*(0.25 - x))
    rates, pressures, intakes = [], [], []
    for mass, energy, volume, area, line in ((m_a, u_a, volumes[0], a_a*v, line_a*1e5), (m_b, u_b, volumes[1], -a_b*v,
                                                                                        line_b*1e5)):
        gas, p = energy*1e3/(mass*1e-3*C_V), energy*1e3*(KAPPA - 1)/volume
        lifted = min(max((line - p - 5e3)/1e4, 0.0), 1.0)
        upstream = T_0 if line > p else gas
        flow = lifted*iso(3e-8, 0.3, line, p) + iso(0.5e-8, 0.3, line, p, T_1=upstream)
        rates += [flow*1e3, (flow*C_P*upstream + 0.3*(T_0 - gas) - p*area)*1e-3]
        pressures.append(p)
        intakes.append(flow)
    y_p, y_n = max(spool, 0.0), max(-spool, 0.0)
    from_valve = (y_p*iso(3e-8, 0.3, 7e5, line_a*1e5) - valve_to_air(y_n, line_a*1e5),
                  y_n*iso(3e-8, 0.3, 7e5, line_b*1e5) - valve_to_air(y_p, line_b*1e5))
    lines = [RT/15e-6*(from_valve[k] - intakes[k])*1e-5 for k in (0, 1)]
    friction = (25 + 15*np.exp(-(v/0.03)**2))*np.tanh(v/1e-3) + 60*v
    far, near = max(x - 0.25, 0.0), max(-x, 0.0)
    stop = max(4e5*far + 3e3*v*min(far/1e-3, 1), 0) - max(4e5*near - 3e3*v*min(near/1e-3, 1), 0)
    thrust = a_a*(pressures[0] - P_0) - a_b*(pressures[1] - P_0)
    command = 1.0 if 0.2 <= time < 1.4 else -1.0
    return [v, (thrust - friction - stop)/12, *rates, *lines, np.log(10)/0.025*(command - spool)]


def test_pneumatic_cylinder_out_and_back() -> None:
    run = hb.simulate(hb.load("pneumatic_cylinder"))
    x = -1.58e-3
    v_a, v_b = 12e-6 + np.pi/4*0.04**2*x, 12e-6 + np.pi/4*(0.04**2 - 0.016**2)*(0.25 - x)
    gas = [f for p, volume in ((P_0, v_a), (7e5, v_b)) for f in (p*volume/RT*1e3, p*volume/(KAPPA - 1)*1e-3)]
    found = integrated(cylinder_rates, [x, 0, *gas, P_0*1e-5, 7, -1], run.time, [0.2, 1.4], rtol=1e-8)
    # c_p of the components is 3e-4 above kappa*R/(kappa - 1), and the flow law is straight below 1 kPa
    assert run["1*load.x"] == pytest.approx(found[0], abs=1e-3*0.25)
    assert run["1*chamber_a.p"] == pytest.approx(found[3]*1e3*(KAPPA - 1)/(12e-6 + np.pi/4*0.04**2*found[0]), abs=5e-3*7e5)
    out = np.interp(0.24, run["1*load.x"][run.time < 1.4], run.time[run.time < 1.4]) - 0.2
    assert out == pytest.approx(np.interp(0.24, found[0][run.time < 1.4], run.time[run.time < 1.4]) - 0.2, rel=1e-3)


def stage_rates(time: float, y: Array) -> list[float]:
    """Current, place and speed of the carriage, filtered error (mm), integral part of the controller."""
    i, x, v, z, q = y
    way = 4*(min(max(time - 0.1, 0), 0.05)**2/2 + 0.05*max(time - 0.15, 0) - min(max(time - 0.4, 0), 0.05)**2/2
             - 0.05*max(time - 0.45, 0))
    error = way - x
    free = 4000*error + q + 12*(error - z*1e-3)/2e-3
    u = min(max(free, -24), 24)
    turns = 2*np.pi/5e-3
    torque = 0.05*i - 6e-3*np.tanh(turns*v/0.1)
    return [(u - 1.2*i - 0.05*turns*v)/0.8e-3, v, (turns*torque - 8*np.tanh(v/1e-3))/(4 + 12e-6*turns**2),
            (error*1e3 - z)/2e-3, 20000*error + (u - free)/0.1]


def test_positioning_stage_on_a_trapezoidal_motion() -> None:
    run = hb.simulate(hb.load("dc_stage"))
    i, x, *_ = integrated(stage_rates, [0, 0, 0, 0, 0], run.time, [0.1, 0.15, 0.4, 0.45])
    # the integration keeps 1e-6 of a position of 1 m over some ten reversals of the friction
    assert run["1*carriage.x"] == pytest.approx(x, abs=5e-6)
    assert run["current"] == pytest.approx(i, abs=1e-2*np.abs(i).max())
    assert run.display["lag"].max() == pytest.approx(2827, rel=1e-3)
