"""Every component of translational and rotational mechanics in a small example, beside its closed form."""

from __future__ import annotations

import numpy as np
import pytest
import test_library_drivetrain as drivetrain
from examples import Array, Case, check, without_example
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.linear.linearisation import Linearisation, start_point
from heavebond.numerics.initialise import start

PI = np.pi
LAW = "the law at a prescribed motion; nothing is integrated"
RUN = "closed form; 1e-6 for the integration"


def x(t: Array) -> Array:
    """The motion of the hand in most examples, m."""
    return 0.02*np.sin(2*PI*t)


def v(t: Array) -> Array:
    return 0.04*PI*np.cos(2*PI*t)


def slow(t: Array) -> Array:
    return 0.02*np.sin(PI/2*t)


def phi(t: Array) -> Array:
    """The same for a shaft, rad."""
    return 0.2*np.sin(2*PI*t)


def w(t: Array) -> Array:
    return 0.4*PI*np.cos(2*PI*t)


def outside(s: Array, gap: float) -> Array:
    return s - np.clip(s, -gap, gap)


def bump(s: Array) -> Array:
    """Excess over -15 mm .. 10 mm."""
    return s - np.clip(s, -0.015, 0.01)


def swing(t: Array) -> Array:
    """1 kg on 100 N/m and 2 N*s/m from 10 mm: natural frequency 10 rad/s, damping ratio 0.1."""
    own = 10*np.sqrt(1 - 0.1**2)
    return 0.01*np.exp(-t)*(np.cos(own*t) + np.sin(own*t)/own)


def bounced(t: Array) -> Array:
    """From 0.8 m under 10 m/s2: down after 0.4 s with 4 m/s, up with 2 m/s for 0.4 s, with 1 m/s for 0.2 s."""
    first, second = t - 0.4, t - 0.8
    return np.select([t < 0.4, t < 0.8], [0.8 - 5*t**2, 2*first - 5*first**2], second - 5*second**2)


def crank(t: Array) -> Array:
    return 0.05*np.cos(10*t) + np.sqrt(0.15**2 - (0.05*np.sin(10*t))**2)


# displacement x = v*t of a contact of 20 presliding distances and more: Stribeck curve at that speed
STEADY_SLIDE = 300*(1 + 0.8*np.exp(-(0.01/0.02)**2)) + 50*0.01
STEADY_TURN = 30*(1 + 0.8*np.exp(-(0.1/0.2)**2)) + 5*0.1

def bouncing(t: np.ndarray, inertia: float, c: float, d: float, x_0: float, low: float, high: float, push: float = 0.0
             ) -> np.ndarray:
    """A body from rest at x_0 between elastic stops, whose damping force is at most the elastic force, by SciPy."""
    def rates(_: float, y: np.ndarray) -> list[float]:
        s, closing = (low - y[0], -y[1]) if y[0] < low else (max(y[0] - high, 0.0), y[1])
        force = c*s + float(np.clip(d*closing, -c*s, c*s))
        return [y[1], (push + (force if y[0] < low else -force))/inertia]
    return np.asarray(solve_ivp(rates, (0, t[-1]), [x_0, 0], t_eval=t, rtol=1e-10, atol=1e-12, max_step=1e-4).y[0])


CASES = [
    Case("elastic_gap", "ball.x", lambda t: bouncing(t, 1, 1e4, 1e3, 0.05, 0.0, np.inf, -9.81), "SciPy", 1e-5),
    Case("elastic_backlash", "wheel.phi", lambda t: bouncing(t, 5, 2e4, 50, np.pi/2, -np.pi/8, np.pi/8), "SciPy", 1e-5),
    Case("backlash", "part.F", lambda t: 1e4*outside(x(t), 5e-3) + 20*v(t), LAW),
    Case("bilinear_spring", "part.F", lambda t: 1e4*(x(t) + 0.5*np.minimum(x(t) - 3e-3, 0)), LAW),
    Case("constant_force", "load.v", lambda t: 1.5*t, RUN),
    Case("contact", "body.x", lambda t: -981/1e5 + 0*t, "weight over stiffness"),
    Case("contact", "floor.N", lambda t: 981 + 0*t, "the weight"),
    Case("coulomb_friction", "sledge.v", lambda t: 1 - 2*t, RUN),
    Case("cubic_spring", "part.F", lambda t: 1e6*x(t)**3, LAW),
    Case("dahl_friction", "part.F", lambda t: 300*(1 - np.exp(-slow(t)/1e-3)), "first loading", 1e-5),
    Case("damper", "sledge.v", lambda t: np.exp(-2*t), RUN),
    Case("directional_friction", "part.F", lambda t: np.where(v(t) > 0, 300, 200)*np.tanh(v(t)/1e-3), LAW
         + "; at the turns of the motion the speed is within the transition", 1e-3),
    Case("drag", "sledge.v", lambda t: 1/(1 + 0.5*t), RUN),
    # it stops after 0.5 s
    Case("dry_friction", "sledge.v", lambda t: np.maximum(1 - 2*t, 0), RUN),
    Case("dry_friction", "part.F", lambda t: np.select([t < 0.5 - 1e-9, t < 0.7 - 1e-9], [20.0, 0.0], 25.0), RUN),
    Case("end_stop", "part.F", lambda t: 1e5*bump(x(t)), LAW),
    Case("fixed", "load.x", lambda t: 0.1 + 0.01*np.cos(10*t), RUN),
    Case("force_curve_of_pressure", "part.F", lambda t: 10.0 + 0*t, "splines reproduce the line 10 N per knot"),
    Case("force_curve_of_speed", "part.F", lambda t: 40*v(t)/0.25, "cubic splines reproduce the straight line"),
    Case("force_curve_of_stroke", "part.F", lambda t: 40*x(t)/0.04, "cubic splines reproduce the straight line"),
    Case("force_equaliser", "part.F", lambda t: 2*20e-4*1e6*x(t)/np.sqrt(x(t)**2 + 0.05**2), LAW),
    Case("force_source", "load.v", lambda t: 1.5*(1 - np.cos(2*t)), RUN),
    Case("free", "end.v", v, "no force, so no difference of speed"),
    Case("friction", "part.F", lambda t: (300 + 200*np.exp(-(v(t)/0.05)**2) + 100)*np.tanh(v(t)/1e-3) + 100*v(t), LAW),
    Case("gas_spring", "part.F", lambda t: 1e5 - 7e4*x(t) - 2e3*v(t), LAW),
    Case("hysteresis", "part.F", lambda t: 300*(1 - np.exp(-slow(t)/5e-3)), "first loading", 1e-5),
    Case("hardening_hysteresis", "part.F", lambda t: 1e4*10e-3/0.4*(np.exp(0.4*slow(t)/10e-3) - 1), "first loading", 1e-5),
    Case("lugre_friction", "part.F", lambda t: STEADY_SLIDE + 0*t, "Stribeck curve", 1e-6, 0.8),
    Case("mass", "body.v", lambda t: 2*t, RUN),
    # V_0 = n*F_0*A/c and p*V**n constant
    Case("polytropic_gas_spring", "part.F", lambda t: 1e5*(1 + 7e4*x(t)/(1.4*1e5))**-1.4 - 2e3*v(t), LAW),
    # a gas column of 0.1 m behind a piston in equilibrium: p_0*A = c*L/n
    Case("polytropic_spring", "part.F", lambda t: 1e4*0.1/1.4*(1 - (0.1/(0.1 + x(t)))**1.4), LAW),
    Case("position_source", "load.a.f", lambda t: -5*(2*PI)**2*x(t), "mass times acceleration"),
    Case("preload", "load.v", lambda t: -2*t, RUN),
    Case("seal_friction", "part.F", lambda t: 300*np.tanh(v(t)/1e-3), LAW),
    Case("series_compliance", "part.F", lambda t: 1e4*(x(t) + 0.02*v(t)), LAW),
    Case("slack_wire", "part.F", lambda t: 1e4*np.maximum(x(t), -5e-3), LAW),
    Case("spring", "load.x", lambda t: 0.01*np.cos(10*t), RUN),
    Case("spring_damper", "load.x", swing, RUN),
    Case("spring_damper_with_play", "part.F", lambda t: 1e4*outside(x(t), 5e-3) + 20*v(t), LAW),
    Case("spring_with_play", "part.F", lambda t: 1e4*outside(x(t), 5e-3), LAW),
    Case("stribeck_friction", "part.F", lambda t: (300 + 200*np.exp(-(v(t)/0.05)**2))*np.tanh(v(t)/1e-3) + 100*v(t), LAW),
    Case("velocity_source", "damper.F", lambda t: 200 + 0*t, LAW),
    Case("velocity_source", "hand.x", lambda t: 0.1*t, RUN),
    Case("weight", "load.v", lambda t: -9.81*t, RUN),
    Case("hardening_spring", "part.F", lambda t: 1e4*x(t)*(1 + 0.1*(x(t)/0.02)**2), LAW),
    Case("shock_absorber", "part.F", lambda t: np.where(v(t) > 0, 3e3, 1e3)*v(t), LAW),
    Case("nonlinear_damper", "part.F",
         lambda t: 3e3*np.where(v(t) > 0, 1, 0.4)*v(t)/np.sqrt(1 + (v(t)/0.05)**2), LAW),
    Case("rotational_nonlinear_damper", "part.M",
         lambda t: 20*np.where(w(t) > 0, 1, 0.4)*w(t)*np.sqrt(1 + (w(t)/0.5)**2), LAW),
    Case("body_drag", "part.F", lambda t: 0.5*1025*1.2*0.5*v(t)*np.abs(v(t)), LAW),
    Case("radiation", "buoy.v", lambda t: np.exp(-t/4), RUN),
    Case("hydrostatic_spring", "body.x", lambda t: 0.1*np.cos(np.sqrt(1025*9.81/500)*t), RUN),
    Case("wire_rope", "part.F", lambda t: 100e9*1e-4/10*np.maximum(x(t), 0), LAW + "; 1e-5 for the rounding of 10 m", 1e-5),
    # 10 N on an arm of 2 m are 20 N on one of 1 m, the other way
    Case("rocker_arm", "falls.x", lambda t: (1 + 2/8) * 0.4*np.sin(2*np.pi*t/8), LAW),  # two lines shared by eight falls
    Case("lever", "load.v", lambda t: -5*t, RUN),
    Case("pulley", "load.v", lambda t: (2*30/4 - 9.81)*t, RUN),
    Case("tackle", "load.v", lambda t: 0.1 + (4*100*0.9/20 - 9.81)*t, RUN),
    Case("drill_string_piece", "bottom.x", lambda t: -100 - 1500*9.81/1e7 + 0*t, "half the weight over stiffness", 1e-8),
    Case("distributed_drill_string", "bottom.x", lambda t: -3000 - 7850*9.81*3000**2/(2*206e9) + 0*t, "a hanging rod", 1e-8),
    Case("acceleration_source", "load.x", lambda t: t**2, RUN),
    Case("acceleration_source", "load.a.f", lambda t: 10 + 0*t, "mass times acceleration"),
    Case("force_between", "first.v", lambda t: -6*t, RUN),
    Case("force_between", "second.v", lambda t: 3*t, RUN),
    # the body is pushed forwards: compression, a negative tension
    Case("force_sensor", "cell.y", lambda t: 5*(2*PI)**2*x(t), "minus mass times acceleration"),
    Case("position_sensor", "sensor.y", x, LAW),
    Case("velocity_sensor", "sensor.y", v, LAW),
    Case("acceleration_sensor", "sensor.y", lambda t: -(2*PI)**2*x(t), LAW),
    Case("relative_position_sensor", "sensor.y", lambda t: x(t) - 0.05*t, LAW),
    Case("relative_velocity_sensor", "sensor.y", lambda t: v(t) - 0.05, LAW),
    Case("power_sensor", "sensor.y", lambda t: 20*t, RUN),
    Case("gear_backlash", "part.M", lambda t: 1e4*outside(phi(t), 0.05) + 20*w(t), LAW),
    Case("rotational_damper", "part.M", lambda t: 20*w(t), LAW),
    Case("rigid_stop", "ball.x", bounced, RUN),
    Case("rotational_coulomb_friction", "part.M", lambda t: 30*np.tanh(w(t)/0.01), LAW),
    Case("rotational_stribeck_friction", "part.M",
         lambda t: (30 + 20*np.exp(-(w(t)/0.5)**2))*np.tanh(w(t)/0.01) + 10*w(t), LAW),
    Case("shaft_compliance", "part.M", lambda t: 1e4*(phi(t) + 0.02*w(t)), LAW),
    Case("shaft_slip", "part.M", lambda t: 50*w(t), LAW),
    Case("torsion_spring", "part.M", lambda t: 100*(phi(t) - 0.1), LAW),
    Case("torsion_spring_damper", "part.M", lambda t: 100*phi(t) + 5*w(t), LAW),
    Case("hardening_torsion_spring", "part.M", lambda t: 100*phi(t)*(1 + 0.5*(phi(t)/0.2)**2), LAW),
    Case("cubic_torsion_spring", "part.M", lambda t: 2e3*phi(t)**3, LAW),
    Case("bilinear_torsion_spring", "part.M", lambda t: 100*(phi(t) + 0.5*np.minimum(phi(t) - 0.03, 0)), LAW),
    Case("torsion_spring_with_play", "part.M", lambda t: 100*outside(phi(t), 0.05), LAW),
    Case("torsion_spring_damper_with_play", "part.M", lambda t: 100*outside(phi(t), 0.05) + 2*w(t), LAW),
    Case("torque_curve_of_speed", "part.M", lambda t: 40*w(t)/2.5, "cubic splines reproduce the straight line"),
    Case("torque_curve_of_angle", "part.M", lambda t: 40*phi(t)/0.4, "cubic splines reproduce the straight line"),
    Case("rotational_drag", "part.M", lambda t: 3*w(t)*np.abs(w(t)), LAW),
    Case("rotational_directional_friction", "part.M", lambda t: np.where(w(t) > 0, 30, 20)*np.tanh(w(t)/0.01), LAW
         + "; at the turns of the motion the speed is within the transition", 1e-3),
    Case("rotational_dahl_friction", "part.M", lambda t: 30*(1 - np.exp(-10*slow(t)/0.01)), "first loading", 1e-5),
    Case("rotational_hysteresis", "part.M", lambda t: 30*(1 - np.exp(-10*slow(t)/0.05)), "first loading", 1e-5),
    Case("rotational_lugre_friction", "part.M", lambda t: STEADY_TURN + 0*t, "Stribeck curve", 1e-6, 0.8),
    Case("rotational_dry_friction", "wheel.w", lambda t: np.maximum(1 - 2*t, 0), RUN),
    Case("rotational_dry_friction", "part.M", lambda t: np.select([t < 0.5 - 1e-9, t < 0.7 - 1e-9], [4.0, 0.0], 5.0), RUN),
    Case("rotational_rigid_stop", "flap.phi", bounced, RUN),
    Case("rotational_end_stop", "part.M", lambda t: 1e4*(phi(t) - np.clip(phi(t), -0.15, 0.1)), LAW),
    Case("constant_torque", "shaft.w", lambda t: 1.5*t, RUN),
    Case("torque_source", "shaft.w", lambda t: 1.5*(1 - np.cos(2*t)), RUN),
    Case("angle_source", "wheel.a.tau", lambda t: -2*(2*PI)**2*phi(t), "inertia times acceleration"),
    Case("speed_source", "shaft.phi", lambda t: 3*t, RUN),
    Case("angular_acceleration_source", "wheel.a.tau", lambda t: 6 + 0*t, "inertia times acceleration"),
    Case("inertia", "wheel.phi", lambda t: 0.1*np.cos(10*t), "angles are kept to 1e-8 rad a step", 1e-5),
    Case("fixed_shaft", "wheel.phi", lambda t: 0.5 + 0.1*np.cos(10*t), RUN),
    Case("free_shaft", "end.w", w, "no torque, so no difference of speed"),
    # 20 N*m on 0.5 kg*m**2 + 50 kg*(0.1 m)**2
    Case("rack", "load.v", lambda t: 0.1*20/1.0*t, RUN),
    Case("gear", "slow.w", lambda t: 1 + 5*10*0.9/10*t, RUN),
    # the sun turns 1 + z times as fast as the carrier, and takes as much less torque
    Case("planetary_gear", "carrier.w", lambda t: 10 + 0*t, LAW),
    Case("planetary_gear", "set.s.tau", lambda t: 2*10/4 + 0*t, LAW),
    Case("belt", "drive.phi", lambda t: 10/(0.1**2*1e5) + 0*t, "torque over stiffness"),
    Case("belt", "brake.a.tau", lambda t: 10*0.05/0.1 + 0*t, "ratio of the pulleys"),
    Case("lead_screw", "slide.v", lambda t: 0.01 + 0.9*2*PI/5e-3/1e3*t, RUN),
    Case("slider_crank", "piston.x", crank, RUN),
    Case("slider_crank", "piston.v", lambda t: -10*0.05*np.sin(10*t)*(1 + 0.05*np.cos(10*t)
         / np.sqrt(0.15**2 - (0.05*np.sin(10*t))**2)), RUN),
    Case("arm_weight", "arm.a.tau", lambda t: 10*9.81*0.5*np.sin(t), LAW),
    Case("unbalance", "part.a.tau", lambda t: 3*np.sin(t + 0.5), LAW),
    Case("clutch", "wheel.w", lambda t: 2*t, RUN),
    Case("torque_between", "housing.w", lambda t: -2*t, RUN),
    Case("torque_between", "rotor.w", lambda t: 3*t, RUN),
    Case("angle_sensor", "sensor.y", phi, LAW),
    Case("encoder", "sensor.y", lambda t: 2*PI/1000*np.floor(1000/(2*PI)*phi(0.01*np.floor(t/0.01 + 1e-9))), LAW),
    Case("shaft_speed_sensor", "sensor.y", w, LAW),
    Case("angular_acceleration_sensor", "sensor.y", lambda t: -(2*PI)**2*phi(t), LAW),
    Case("relative_angle_sensor", "sensor.y", lambda t: phi(t) - 0.5*t, LAW),
    Case("relative_shaft_speed_sensor", "sensor.y", lambda t: w(t) - 0.5, LAW),
    # a drives b: with the wheel behind it the meter shows inertia times acceleration
    Case("torque_sensor", "meter.y", lambda t: -2*(2*PI)**2*phi(t), "inertia times acceleration"),
    Case("shaft_power_sensor", "meter.y", lambda t: 20*t, RUN),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_shows_the_law(case: Case) -> None:
    check(case)


def test_every_component_has_an_example() -> None:
    assert without_example(["translational", "rotational"], [*CASES, *drivetrain.CASES]) == []


@pytest.mark.parametrize("n", [5, 20])
def test_the_pieces_of_a_drill_string_swing_as_a_rod(n: int) -> None:
    """A chain of n springs and n masses, the last one half, held above: sin(pi/(4*n))*4*n/pi times the first frequency of
    a rod, sqrt(E/rho)/(4*L)."""
    model = hb.loads(f"""model: rod
components:
  hook: {{is: Fixed}}
  string: {{is: DistributedDrillString, n: {n}, L: 3000 m, D_o: 127 mm, D_i: 108.6 mm, T_d: 0 s, g: 0 m/s**2}}
  end: {{is: Free}}
nodes: {{hook: [hook.a, string.a], bottom: [string.b, end.a]}}
initial: {{start: steady}}
simulate: {{until: 1 s}}
""")
    assembly = hb.assemble(model)
    modes = Linearisation(assembly).at(start_point(start(assembly), np.zeros(0))).modes()
    rod = np.sqrt(206e9/7850)/(4*3000)
    # eigenvalues of matrices whose entries are rounded
    assert modes[0].frequency == pytest.approx(rod*np.sin(PI/(4*n))*4*n/PI, rel=1e-9)
    assert modes[0].frequency == pytest.approx(rod*(1 - 0.1/n**2), rel=0.01/n**2)
