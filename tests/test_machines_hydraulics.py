"""The bundled hydraulic machines, a hydrostatic drive and an excavator boom, beside steady states worked out by hand."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq

import heavebond as hb
from heavebond.energy_audit.audit import energy as audit

BAR, LPM, RPM = 1e5, 1e-3/60, 2*np.pi/60


@cache
def machine(name: str) -> hb.Result:
    return hb.simulate(hb.load(name))


def at(name: str, signal: str, time: float) -> float:
    run = machine(name)
    return float(np.interp(time, run.time, run.display[signal]))


def cruising_speed() -> float:
    """The speed at which the flow that the motor takes under the load is what the pump delivers against it."""
    D_p, D_m, dp_r = 75e-6/(2*np.pi), 100e-6/(2*np.pi), 200*BAR
    w_p, w_r, arm = 2000*RPM, 1500*RPM, 0.5/25

    def balance(v: float) -> float:
        w = v/arm
        force = 1.6e3*np.tanh(v/0.02) + 4*v**2
        friction = D_m*dp_r*(1 - 0.92)          # half grows with speed, half with pressure
        drop = (force*arm + friction*0.5*w/w_r)/(D_m - friction*0.5/dp_r)
        q = D_m*w + D_m*w_r/dp_r*(1/0.95 - 1)*drop
        area, d = np.pi/4*0.022**2, 0.022
        Re = q*d/(area*40e-6)
        y = np.clip((Re - 2300)/1700, 0, 1)
        f = (1 - y**2*(3 - 2*y))*64/Re + y**2*(3 - 2*y)*(1.8*np.log10(6.9/max(Re, 2300)))**-2
        line = f*3/d*870/2*(q/area)**2
        drain = 2e-12*(24*BAR + drop)           # from the line under pressure to the case
        return float(D_p*w_p*(1 - 0.05*(drop + 2*line)/dp_r) - drain - q)

    return float(brentq(balance, 1, 4))


def test_the_drive_cruises_at_the_speed_of_its_steady_state() -> None:
    # the charge pressure at which the drain leaves is known to 1 bar, which is 1e-6 of the flow
    assert at("hydrostatic_drive", "road.v", 9.9) == pytest.approx(cruising_speed(), rel=2e-4)
    assert at("hydrostatic_drive", "road.v", 9.9) == pytest.approx(3.07849, rel=1e-5)


def test_the_drive_brakes_into_its_engine_and_stands() -> None:
    power = machine("hydrostatic_drive")["pump.s.tau"]*machine("hydrostatic_drive")["pump.s.w"]
    assert power.min() == pytest.approx(-12.5e3, rel=0.01)
    assert abs(at("hydrostatic_drive", "road.v", 16)) < 1e-4
    assert machine("hydrostatic_drive")["motor_B.p"].max() < 350*BAR


def test_the_boom_is_held_at_the_pressure_that_its_weight_asks_for() -> None:
    phi, angle = at("excavator_boom", "boom.phi", 5.9), np.deg2rad(72)
    length = np.sqrt(0.9**2 + 2.3**2 - 2*0.9*2.3*np.cos(phi + angle))
    thrust = 4500*9.81*3.2*np.cos(phi)*length/(0.9*2.3*np.sin(phi + angle))
    A_A, A_B = np.pi/4*0.17**2, np.pi/4*(0.17**2 - 0.12**2)
    pressure = (thrust + A_B*at("excavator_boom", "cylinder.chamber_B.p", 5.9))/A_A
    # the friction of the seals, up to 4 kN, holds too
    assert at("excavator_boom", "cylinder.chamber_A.p", 5.9) == pytest.approx(pressure, abs=4e3/A_A)
    assert np.rad2deg(phi) == pytest.approx(19.7, abs=0.1)


def test_the_boom_of_planar_parts_obeys_the_law_of_cosines_and_newtons_law_about_its_pin() -> None:
    """J w' = F a b sin(phi + gamma)/s - m g l_g cos(phi), with s between the eyes of the cylinder."""
    found, a, b = machine("excavator_boom"), 0.9, 2.3
    turned = found["boom.phi"] + np.deg2rad(72)
    length = np.sqrt(a**2 + b**2 - 2*a*b*np.cos(turned))
    assert found["eyes.s"] == pytest.approx(length, abs=1e-10)
    moment = found["eyes.r.f"]*a*b*np.sin(turned)/length
    assert np.ptp(found["boom.phi"]) > 0.5
    assert 60e3*found["der(boom.w)"] == pytest.approx(moment - 4500*9.81*3.2*np.cos(found["boom.phi"]), abs=1.0)


def test_the_counterbalance_valve_holds_and_meters() -> None:
    held = [at("excavator_boom", "boom.phi", t) for t in (5.2, 5.9)]
    assert abs(held[1] - held[0]) < 2e-4                     # creeps below the transition speed of the friction only
    assert at("excavator_boom", "holder.y", 5.5) == pytest.approx(0, abs=1e-9)
    # as it lets the boom down, the opening is that of the balance of its poppet
    load, back, pilot = (at("excavator_boom", f"{node}.p", 8.5) for node in ("load_A", "holder_b", "load_B"))
    assert at("excavator_boom", "holder.y", 8.5) == pytest.approx(
        (load - back + 3*(pilot - back) - 160*BAR)/(60*BAR), abs=5e-3)
    assert at("excavator_boom", "boom.w", 8.5) == pytest.approx(-0.22, abs=0.02)


@pytest.mark.parametrize("name", ["hydrostatic_drive", "excavator_boom"])
def test_the_machines_lose_no_energy_unaccounted(name: str) -> None:
    found = audit(hb.load(name), "4 s")
    assert found.closes(), f"{found.imbalance:.3g}"


PRESS = """
model: press
components:
  oil:    {is: Fluid}
  tank:   {is: Tank}
  pump:   {is: FlowSource, u: 40 L/min}
  relief: {is: RatedReliefValve, p_0: 200 bar, q_r: 60 L/min, p_r: 220 bar}
  line:   {is: Volume, V: 1 L}
  valve:  {is: ProportionalValve43, q_r: 60 L/min, dp_r: 35 bar, f_n: 30 Hz, zeta: 0.8, u: U, leakage: 1e-13 m**3/(s*Pa)}
  cyl:    {is: Cylinder, A_A: 100 cm**2, A_B: 60 cm**2, V_A0: 1 L, V_B0: 3 L}
  frame:  {is: Fixed}
  ram:    {is: Mass, m: 800 kg}
  weight: {is: Weight, m: 800 kg}
  work:   {is: EndStop, x_min: -0.05 m, x_max: 0.3 m, c: 100 MN/m, d: 100 kN*s/m}
nodes:
  supply: [pump.a, relief.a, line.a, valve.P, oil.a]
  return: [tank.a, relief.b, valve.T]
  A: [valve.A, cyl.A]
  B: [valve.B, cyl.B]
  frame: [frame.a, cyl.a, work.a]
  ram: [ram.a, weight.a, cyl.b, work.b]
initial: {start: steady, GUESS}
simulate: {until: 1 ms}
"""


@pytest.mark.long
@pytest.mark.parametrize("u", [-1, -0.05, 0, 0.3, 1])
def test_a_press_starts_steadily_from_any_guess(u: float) -> None:
    """At its lower stop, or on the workpiece: the relief valve takes the pump's flow less what leaks through the valve."""
    random = np.random.default_rng(5)
    for _ in range(6):
        x, p, p_A, p_B = random.uniform([-0.3, -1, -1, -1], [0.6, 400, 600, 600])
        guess = f"ram.x: ~ {x:.3g} m, supply.p: ~ {p:.3g} bar, A.p: ~ {p_A:.3g} bar, B.p: ~ {p_B:.3g} bar"
        found = hb.simulate(hb.loads(PRESS.replace("u: U", f"u: {u}").replace("GUESS", guess)))
        force = 100e-4*found["A.p"][0] - 60e-4*found["B.p"][0] - 800*9.81
        end = 0.3 + force/100e6 if u >= 0 else -0.05 + force/100e6
        assert (force > 0) == (u >= 0)
        assert found["ram.x"][0] == pytest.approx(end, abs=1e-9)
        through = 1e-3/60*60*np.sqrt(found["supply.p"][0]/220e5)*np.clip((found["supply.p"][0] - 200e5)/20e5, 0, 1)
        flows = found["valve.q_PA"][0] + found["valve.q_PB"][0]
        assert through + flows == pytest.approx(40e-3/60, rel=1e-4)   # of the transition of the relief valve
        if u == 0:
            assert flows == pytest.approx(1e-13*(2*found["supply.p"][0] - found["A.p"][0] - found["B.p"][0]), rel=1e-6)
