"""Lines with unsteady friction, cavities, heights, bends, centrifugal pumps and further actuators beside formulas of their
sources."""

from __future__ import annotations

import numpy as np
import pytest
from library_check import agree, checks, part, run
from scipy.integrate import solve_ivp
from scipy.special import jn_zeros, jv
from test_library_valves import Case

import heavebond as hb
from heavebond.language.library import bundled

BAR, LPM, PI = 1e5, 1e-3/60, np.pi
RPM = 2*PI/60
WEISBACH = 0.131 + 1.847*(20/60)**3.5

CASES = [
    Case("height_difference", "orifice.q", 20*LPM*np.sqrt(3 - 870*9.81*10/BAR), 1e-3),   # transition at 0.1 bar
    # both ways lose the same: 0.1 of the run against 1.2 of the branch
    Case("tee", "two.a.q", 60*LPM/(1 + np.sqrt(12)), 1e-4),
    Case("bend", "part.q", PI/4*0.02**2*np.sqrt(2*0.2*BAR/(WEISBACH*870)), 1e-3),   # the laminar transition at Re_t
    # affinity laws: half the speed, half the flow, a quarter of the torque
    Case("centrifugal_pump", "part.q", 150*LPM),
    Case("centrifugal_pump", "part.s.tau", 1000*9.81*32*300*LPM/(0.65*2900*RPM)/4),
    Case("rotary_actuator", "A.p", (500 + 20*0.5)/200e-6),
    Case("rotary_actuator", "shaft.phi", 6*LPM/200e-6*2, 1e-3),   # 1 bar of the start compresses the oil
    Case("pressure_intensifier", "high.p", 400*BAR),
    Case("pressure_intensifier", "part.x", 3*LPM/10e-4*2),
    Case("telescopic_cylinder", "oil.p", (20e3 + 20e3*200e-6/40e-4)/40e-4),
    # 50 mm with 0.2 L/s on 80 cm**2 in 2 s, then on 40 cm**2, less the compressed oil of 1 L by 27.5 bar
    Case("telescopic_cylinder", "load.x", 0.05 + 0.2e-3*2/40e-4, 5e-3),
    # a cavity of what was drawn, less the expansion of the oil by 1 bar and the first gas
    Case("cavitating_volume", "part.V_g", 0.6*LPM*2 - 1e-3*(101325 - 50)/1.4e9 + 1e-8, 1e-4),
    Case("cavitating_volume", "oil.p", 50 - 101325 + 1e-5*1e-3*101325/(0.6*LPM*2), 1e-4),
]

COURSES = [Case("dynamic_line_segment", "part.q", 27.0071*LPM, 2e-3), Case("dynamic_line", "shut.p", 8.9724*BAR, 1e-3),
           Case("gas_accumulator_with_heat", "oil.p", 168.94*BAR, 1e-4)]   # their courses are compared below


@pytest.mark.parametrize("case", [*CASES, *COURSES], ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_settles_at_its_balance(case: Case) -> None:
    found = hb.simulate(hb.load(f"examples/{case.example}"))
    assert float(found[f"1*{case.signal}"][-1]) == pytest.approx(case.expected, rel=case.tolerance)


@checks("HeightDifference", "Bend", "CentrifugalPump")
def test_heights_bends_and_centrifugal_pumps() -> None:
    found = part("HeightDifference", h="-3 m", rho="900 kg/m**3")({"b.p": 2*BAR, "a.q": 1e-3})
    agree(found["a.p"], 2*BAR - 900*9.81*3)
    agree(found["b.q"], -1e-3)
    law = part("Bend", d="25 mm", R="50 mm", angle="45 deg", rho="870 kg/m**3", nu="30 mm**2/s", Re_t=400)
    q = np.array([-2e-3, -1e-4, -1e-7, 1e-7, 1e-4, 2e-3])
    zeta = (0.131 + 1.847*(25/100)**3.5)/2
    area = PI/4*0.025**2
    q_t = 400*30e-6*area/0.025
    drop = zeta*870/2*q*np.sqrt(q**2 + q_t**2)/area**2
    agree(law({"a.p": drop, "b.p": 0})["a.q"], q, rtol=1e-8)
    pump = part("CentrifugalPump", H_0="40 m", H_r="30 m", q_r="5 L/s", w_r="2900 rpm", eta=0.7, m_0=0.4, rho="1000 kg/m**3",
                dp_t="1e-2 Pa")
    share = np.array([0.1, 0.5, 1, 1.2])
    for n in (1.0, 0.7):
        head = (40 - 10*share**2)*n**2
        found = pump({"a.p": 0.3*BAR, "b.p": 0.3*BAR + 9810*head, "s.w": n*2900*RPM})
        agree(found["a.q"], n*share*5e-3, rtol=1e-6)
        agree(found["s.tau"], 9810*30*5e-3/(0.7*2900*RPM)*n**2*(0.4 + 0.6*share), rtol=1e-6)


@checks("RotaryActuator", "PressureIntensifier", "TelescopicCylinder")
def test_actuators() -> None:
    law = part("RotaryActuator", D="200 cm**3/rad", phi_m="4 rad", V_d="0.3 L", beta="1.4 GPa", leakage="1e-12 m**3/(s*Pa)",
               phi_0="0.5 rad")
    found = law({"a.phi": 0, "b.phi": 1.5, "a.w": 0.2, "b.w": 1.2, "A.p": 80*BAR, "B.p": 10*BAR, "A.q": 3e-4, "B.q": -1e-4})
    agree(found["b.tau"], -200e-6*70*BAR)
    agree(found["der(A.p)"], 1.4e9*(3e-4 - 70e-7 - 2e-4)/(0.3e-3 + 2e-4))
    agree(found["der(B.p)"], 1.4e9*(-1e-4 + 70e-7 + 2e-4)/(0.3e-3 + 6e-4))
    law = part("PressureIntensifier", A_A="80 cm**2", A_B="10 cm**2", s_m="0.2 m", m="4 kg", d="1 kN*s/m", c="1e8 N/m")
    found = law({"A.p": 50*BAR, "B.p": 300*BAR, "x": np.array([-1e-4, 0.1, 0.2002]), "v": 0.3})
    agree(found["der(v)"], (40e3 - 30e3 - 300 + np.array([1e4, 0, -2e4]))/4)
    agree([found["A.q"], found["B.q"]], [[80e-4*0.3]*3, [-10e-4*0.3]*3])
    law = part("TelescopicCylinder", n=3, A_s="[80 cm**2, 50 cm**2, 20 cm**2]", x="[0.5 m, 1.2 m, 2 m]", V_0="1 L",
               beta="1.4 GPa", l0="0.1 m")
    stroke, area = np.array([0.2, 0.5, 0.9, 1.9]), np.array([80, 65, 50, 20])*1e-4
    found = law({"a.x": 0, "b.x": 0.1 + stroke, "a.v": 0, "b.v": 0.1, "A.p": 60*BAR, "A.q": 1e-3})
    agree(found["b.f"], -60*BAR*area)
    volume = 1e-3 + np.array([80*0.2, 80*0.5, 80*0.5 + 50*0.4, 80*0.5 + 50*0.7 + 20*0.7])*1e-4
    # at the end of a stage the smoothing holds (A_1 - A_2) x_t log(2)/2 less
    volume[1] -= 30e-4*2e-3*np.log(2)/2
    agree(found["der(A.p)"], 1.4e9*(1e-3 - 0.1*area)/volume)


# -- unsteady friction -------------------------------------------------------------------------------------------------
@checks("DynamicLineSegment")
def test_a_laminar_flow_starts_as_szymanski_found() -> None:
    """Mean velocity after a step of the pressure: 1 - 32 sum(exp(-l**2 nu t/R**2)/l**4), l the zeros of J0."""
    found = hb.simulate(hb.load("examples/dynamic_line_segment"))
    t, q = found.time, found["part.q"]
    zeros = jn_zeros(0, 200)
    final = BAR*PI*0.01**4/(8*870*100e-6*10)
    exact = final*(1 - 32*(np.exp(-np.outer(t, zeros**2)*100e-6/0.01**2)/zeros**4).sum(axis=1))
    # the first six terms of Kagawa's weighting function, the others as inertia
    assert q == pytest.approx(exact, abs=3e-3*final)
    # steady friction alone would be off by a tenth
    lumped = final*(1 - np.exp(-8*100e-6/0.01**2*t))
    assert np.abs(lumped - exact).max() > 0.03*final
    law = part("DynamicLineSegment", length="3 m", d="10 mm", zeta=2, rho="870 kg/m**3", nu="20 mm**2/s", beta="1.4 GPa")
    steady = {f"z_{k}": -m*1e-4 for k, m in enumerate((1.0, 1.16725, 2.20064, 3.92861, 6.78788, 11.6761), 1)}
    found_ = law({"a.p": 10*BAR, "b.p": 2*BAR, "q": 1e-4, "der(a.p)": 1e7, "der(b.p)": 2e7, **steady})
    area = PI/4*0.01**2
    loss = 128*870*20e-6*3*1e-4/(PI*0.01**4) + 2*870/2*(1e-4/area)**2     # Hagen and Poiseuille
    agree(found_["der(q)"], area/(870*3)*(8*BAR - loss)/1.01389)
    agree(found_["dp_u"], 0, size=1e-3*loss)
    agree(found_["a.q"], 1e-4 + area*3/(2*1.4e9)*1e7)
    agree(found_["b.q"], area*3/(2*1.4e9)*2e7 - 1e-4)


@checks("DynamicLine")
def test_a_line_resonates_as_the_exact_line_with_friction() -> None:
    """Input impedance Z_c tanh(Gamma L) of a line with open end; series impedance of laminar flow by Bessel functions."""
    found = run((bundled("models")/"examples"/"dynamic_line.yaml").read_text("utf-8"))
    t = found.time
    late = t >= 0.5                   # the start has decayed to exp(-14)
    base = np.column_stack([np.sin(2*PI*16*t), np.cos(2*PI*16*t), np.ones_like(t)])[late]
    real, imaginary, _ = np.linalg.lstsq(base, found["shut.p"][late], rcond=None)[0]
    s, R, nu = 2j*PI*16, 5e-3, 100e-6
    z = 1j*R*np.sqrt(s/nu)
    series = 870*s/(PI*R**2)/(1 - 2*jv(1, z)/(z*jv(0, z)))
    shunt = s*PI*R**2/1.4e9
    exact = np.sqrt(series/shunt)*np.tanh(20*np.sqrt(series*shunt))*0.2*LPM
    agree(np.hypot(real, imaginary), abs(exact), rtol=0.01)               # 20 segments
    agree(np.arctan2(imaginary, real), np.angle(exact), rtol=0.02)
    # with steady friction the peak is a third higher
    steady = 870*s/(PI*R**2) + 8*870*nu/(PI*R**4)
    assert abs(np.sqrt(steady/shunt)*np.tanh(20*np.sqrt(steady*shunt))*0.2*LPM) > 1.3*abs(exact)


@checks("TransmissionLine")
def test_water_hammer_reaches_joukowsky_without_ripples() -> None:
    """The valve closes in 1 ms: the pressure rises by rho a v until the wave returns after 2 L/a, and stays level."""
    found = run("""\
model: hammer
components:
  s: {is: PressureSource, p_0: 30 bar}
  w: {is: Water}
  l: {is: TransmissionLine, length: 100 m, d: 50 mm}
  v: {is: BypassValve, q_r: 120 L/min, dp_r: 30 bar, u: "=1 - min(max((time - 0.1 s)/1 ms, 0), 1)"}
  t: {is: Tank}
nodes: {s: [s.a, w.a, l.a], e: [l.b, v.a], t: [v.b, t.a]}
initial: {start: steady}
simulate: {until: 0.25 s, every: 1 ms}
""")
    speed = np.sqrt(2.18e9/998.2)
    rise = 998.2*speed*found["v.q"][0]/(PI/4*0.05**2)
    closed = (found.time > 0.1015) & (found.time < 0.1 + 2*100/speed - 1e-3)
    agree(found["e.p"][closed], found["e.p"][0] + rise, rtol=0.01)      # half of the friction, 0.1 bar, is at each end
    agree(found["e.p"][closed], found["e.p"][closed][0], rtol=1e-4)     # no ripples
    back = (found.time > 0.1015 + 2*100/speed) & (found.time < 0.24)
    # reflected with the opposite sign at the source; the friction of what flows back there is twice 0.1 bar, 1.4 %
    agree(found["e.p"][back], 2*30.1*BAR - found["e.p"][closed][0], rtol=0.002)


# -- gas ---------------------------------------------------------------------------------------------------------------
@checks("CavitatingVolume")
def test_gas_is_released_below_saturation_and_a_cavity_collapses() -> None:
    law = part("CavitatingVolume", V="1 L", beta="1.4 GPa", p_v="2340 Pa", gas=0.1, tau_r="0.2 s", tau_d="10 s")
    p_g = np.array([0.3, 0.5, 3])*BAR
    found = law({"s": np.log(p_g/101325), "x": 0.02, "a.q": 1e-5})
    agree(found["a.p"], p_g + 2340 - 101325)
    target = 1e-5 + 0.1*np.maximum(1 - (p_g + 2340)/101325, 0)
    rate = (target - 0.02)/np.where(target > 0.02, 0.2, 10)
    agree(found["der(x)"], rate)
    # continuity: the flow compresses oil and gas, and gas is released at the gas pressure
    dp = found["der(s)"]*p_g
    agree(1e-3/1.4e9*dp + 0.02e-3*101325/p_g**2*dp - 1e-3*101325/p_g*rate, 1e-5, rtol=1e-8)
    # what was drawn comes back: the cavity closes when it has been refilled
    run_ = run("""
model: separated
components:
  pump: {is: FlowSource, u: "=if_else(time < 1 s, -0.6 L/min, 0.6 L/min)"}
  part: {is: CavitatingVolume, V: 1 L, beta: 1.4 GPa, gas: 0}
nodes: {oil: [pump.a, part.a]}
initial: {part.s: 0, part.x: 1e-5}
simulate: {until: 2.1 s, every: 1 ms}
""")
    p = np.interp([1.9, 1.99, 2.1], run_.time, run_["oil.p"])
    agree(p[0], 50 - 101325 + 1e-8*101325/(0.1*0.6*LPM), rtol=2e-3)   # a cavity of 1 cm**3, less 0.07 of the expansion
    agree(p[2], 0.1*0.6*LPM*1.4e9/1e-3, rtol=0.02)    # the gas gives way by 10 mm**3 of 1000


@checks("GasAccumulatorWithHeat")
def test_a_charged_accumulator_cools_down() -> None:
    """Energy balance of the gas, integrated by SciPy: T' = -p V'/C - (T - T_0)/tau."""
    found = hb.simulate(hb.load("examples/gas_accumulator_with_heat"))
    K = (100*BAR + 101325)*0.01/293.15
    start = K*293.15/(110*BAR + 101325)

    def rate(t: float, y: list[float]) -> list[float]:
        V, T = y
        flow = -180*LPM if t < 1 else 0.0
        return [flow, -0.4*T/V*flow - (T - 293.15)/5]

    first = solve_ivp(rate, (0, 1), [start, 293.15], rtol=1e-10, atol=1e-12)
    then = solve_ivp(lambda t, y: rate(2, y), (1, 10), first.y[:, -1], rtol=1e-10, atol=1e-12)
    for time, (V, T) in ((1, first.y[:, -1]), (10, then.y[:, -1])):
        # the oil in the port, 10 cm**3, takes 0.05 cm**3 of 3 L
        assert np.interp(time, found.time, found["oil.p"]) == pytest.approx(K*T/V - 101325, rel=1e-4)
        assert np.interp(time, found.time, found["part.T"]) == pytest.approx(T, rel=1e-4)
    law = part("GasAccumulatorWithHeat", V_0="10 L", p_0="100 bar", tau="5 s", beta="1.4 GPa")
    full = law({"a.p": 200*BAR, "T": 293.15})
    agree(full["V_g"], 0.01*(100*BAR + 101325)/(200*BAR + 101325), rtol=1e-5)    # Boyle
    empty = law({"a.p": 20*BAR, "T": 293.15})
    agree(empty["V_g"], 0.01, rtol=1e-4)


@checks("Tee")
def test_a_tee_by_its_loss_coefficients() -> None:
    """Bernoulli with losses along each way: half of the run and the branch, dividing and combining."""
    area, branch = PI/4*0.016**2, PI/4*0.010**2

    def head(q: float, size: float) -> float:
        return 870/2*(q/size)**2
    law = part("Tee", d="16 mm", d_c="10 mm", zeta_r=0.3, zeta_o=1.2, zeta_i=0.8, dp_t="1e-3 Pa", rho="870 kg/m**3")
    for straight, into in ((5e-4, 2e-4), (5e-4, -2e-4)):      # from a to b, and what leaves (enters) by the branch
        middle = 20*BAR
        p_a, p_b = middle + 0.15*head(straight, area), middle - 0.15*head(straight - into, area)
        p_c = middle - np.sign(into)*((1.2 if into > 0 else 0.8) - 0.15)*head(into, branch)
        found = law({"a.p": p_a, "b.p": p_b, "c.p": p_c, "p": middle})
        agree(found["a.q"], straight, rtol=1e-7)
        agree(found["b.q"], into - straight, rtol=1e-7)
        agree(found["c.q"], -into, rtol=1e-7)
