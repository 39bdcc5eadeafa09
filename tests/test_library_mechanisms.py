"""Bodies, sources, sensors and mechanisms beside the formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from library_check import CHECKED, agree, checks, cubic_spline, part, run
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.linear.linearisation import ModesAtStart

X = np.array([-0.4, 0.0, 0.1, 0.7])
F = np.array([-300.0, 0.0, 20.0, 500.0])

# component, parameters, what is given, what follows
SINGLE: list[tuple[str, dict[str, object], dict[str, object], dict[str, object]]] = [
    ("Mass", {"m": 4.0}, {"a.f": F}, {"der(a.v)": F/4}),
    ("Inertia", {"J": 4.0}, {"a.tau": F}, {"der(a.w)": F/4}),
    ("Weight", {"m": 4.0}, {"a.v": X}, {"a.f": 4*9.81}),
    ("ConstantForce", {"F": 12.0}, {"a.v": X}, {"a.f": -12.0}),
    ("ConstantTorque", {"tau": 12.0}, {"a.w": X}, {"a.tau": -12.0}),
    ("ForceSource", {}, {"u": F}, {"a.f": -F}),
    ("TorqueSource", {}, {"u": F}, {"a.tau": -F}),
    ("ForceBetween", {}, {"u": F}, {"a.f": F, "b.f": -F}),
    ("TorqueBetween", {}, {"u": F}, {"a.tau": F, "b.tau": -F}),
    ("PositionSource", {}, {"u": X, "a.f": 3.0}, {"a.x": X}),
    ("AngleSource", {}, {"u": X, "a.tau": 3.0}, {"a.phi": X}),
    ("VelocitySource", {}, {"u": X, "a.f": 3.0}, {"a.v": X}),
    ("SpeedSource", {}, {"u": X, "a.tau": 3.0}, {"a.w": X}),
    ("AccelerationSource", {}, {"u": X, "a.f": 3.0}, {"der(a.v)": X}),
    ("AngularAccelerationSource", {}, {"u": X, "a.tau": 3.0}, {"der(a.w)": X}),
    ("Fixed", {"x0": 0.3}, {"a.f": F}, {"a.x": 0.3}),
    ("FixedShaft", {"phi0": 0.3}, {"a.tau": F}, {"a.phi": 0.3}),
    ("Free", {}, {"a.v": X}, {"a.f": 0.0}),
    ("FreeShaft", {}, {"a.w": X}, {"a.tau": 0.0}),
    ("PositionSensor", {}, {"a.x": X}, {"y": X, "a.f": 0.0}),
    ("AngleSensor", {}, {"a.phi": X}, {"y": X, "a.tau": 0.0}),
    ("VelocitySensor", {}, {"a.v": X}, {"y": X, "a.f": 0.0}),
    ("ShaftSpeedSensor", {}, {"a.w": X}, {"y": X, "a.tau": 0.0}),
    ("AccelerationSensor", {}, {"der(a.v)": X}, {"y": X, "a.f": 0.0}),
    ("AngularAccelerationSensor", {}, {"der(a.w)": X}, {"y": X, "a.tau": 0.0}),
    ("RelativePositionSensor", {}, {"a.x": X, "b.x": X[::-1]}, {"y": X[::-1] - X, "a.f": 0.0, "b.f": 0.0}),
    ("RelativeAngleSensor", {}, {"a.phi": X, "b.phi": X[::-1]}, {"y": X[::-1] - X, "a.tau": 0.0, "b.tau": 0.0}),
    ("RelativeVelocitySensor", {}, {"a.v": X, "b.v": X[::-1]}, {"y": X[::-1] - X, "a.f": 0.0, "b.f": 0.0}),
    ("RelativeShaftSpeedSensor", {}, {"a.w": X, "b.w": X[::-1]}, {"y": X[::-1] - X, "a.tau": 0.0, "b.tau": 0.0}),
    # a load cell reads tension: what is hung on b, with b.f = F the force of the cell on b turned round
    ("ForceSensor", {}, {"a.x": X, "b.f": F}, {"b.x": X, "y": F, "a.f": -F}),
    ("TorqueSensor", {}, {"a.phi": X, "b.tau": F}, {"b.phi": X, "y": -F, "a.tau": -F}),
    ("PowerSensor", {}, {"a.x": 0.0, "a.v": X, "a.f": F}, {"b.f": -F, "y": F*X}),
    ("ShaftPowerSensor", {}, {"a.phi": 0.0, "a.w": X, "a.tau": F}, {"b.tau": -F, "y": F*X}),
    ("ArmWeight", {"m": 4.0, "l": 0.5}, {"a.phi": X}, {"a.tau": 4*9.81*0.5*np.sin(X)}),
    ("Unbalance", {"M": 12.0, "phi_0": 0.2}, {"a.phi": X}, {"a.tau": 12*np.sin(X + 0.2)}),
    ("HydrostaticSpring", {"A_w": 30.0, "rho": 1000.0, "x0": 0.1}, {"a.x": X, "z": 0.25},
     {"a.f": 1000*9.81*30*(X - 0.1 - 0.25)}),
    ("Radiation", {"m_a": 50.0, "d_r": 7.0}, {"a.f": F, "a.v": 0.6}, {"der(a.v)": (F - 7*0.6)/50}),
]
for _name, *_ in SINGLE:
    CHECKED.setdefault(_name, []).append(f"{__name__}.test_body_source_or_sensor")


@pytest.mark.parametrize(("component", "parameters", "given", "expected"), SINGLE, ids=[row[0] for row in SINGLE])
def test_body_source_or_sensor(component: str, parameters: dict[str, object], given: dict[str, float],
                               expected: dict[str, float]) -> None:
    found = part(component, **parameters)(given)
    for name, value in expected.items():
        agree(found[name], value, size=float(np.abs(value).max()) or 1.0)


# -- mechanisms: kinematics from geometry, forces by virtual work -------------------------------------------------------
@checks("Lever")
def test_lever() -> None:
    """A rigid bar on a pivot that may move: v_p + w l_a at a, v_p - w l_b at b; moments and forces in balance."""
    v_p, w = np.array([0.3, 0.0, -0.2]), np.array([0.5, -1.0, 0.7])
    found = part("Lever", l_a=2.0, l_b=0.5)({"p.v": v_p, "a.v": v_p + 2*w, "b.f": [10.0, -4.0, 1.0]})
    agree(found["b.v"], v_p - 0.5*w)
    agree(found["a.f"], [2.5, -1.0, 0.25])
    agree(found["a.f"] + found["b.f"] + found["p.f"], 0.0, size=10)


@checks("Pulley")
def test_pulley() -> None:
    found = part("Pulley")({"a.v": X, "b.v": 2*X[::-1], "b.f": F})
    agree(found["c.v"], (X + 2*X[::-1])/2)
    agree(found["a.f"], F)
    agree(found["a.f"]*X + F*2*X[::-1] + found["c.f"]*found["c.v"], 0.0, size=500)  # no power is lost


@checks("Tackle")
def test_tackle_by_the_efficiency_of_its_sheaves() -> None:
    """n falls: the winch hauls n times the way of the block; hoisting and lowering lose the same share of n T."""
    law = part("Tackle", n=6, loss=0.15, v_t=1e-9)
    for v, share in ((0.4, 1 - 0.15), (-0.4, 1 + 0.15), (0.0, 1.0)):
        found = law({"a.v": 0.1, "b.v": 0.1 + v, "r.f": [0.0, 5e3]})
        agree(found["r.v"], 6*v, size=1.0)
        agree(found["b.f"], [0.0, -6*5e3*share])
        agree(found["a.f"], [0.0, 6*5e3*share])


@checks("RockerArm")
@pytest.mark.parametrize("k", [1.0, 0.4])
def test_rocker_arm_by_the_length_of_its_wire(k: float) -> None:
    """Two lines of length b - a and n falls of length b - c keep the wire's length but for what the arms take up."""
    law = part("RockerArm", n=8, k=k, l0=2.0)
    a, b = np.array([0.0, 0.5, -0.3]), np.array([2.0, 4.0, 1.0])
    place = law({"a.x": a, "b.x": b, "c.f": 900.0})
    # wire: n (b - c) + 2 (1 - k)(b - a - l0) = const, zero in mid position
    agree(8*(b - place["c.x"]) + 2*(1 - k)*(b - a - 2.0), 0.0, size=10)
    h = 1e-3
    for port, moved in (("a", {"a.x": a + h, "b.x": b}), ("b", {"a.x": a, "b.x": b + h})):
        lever = (law({**moved, "c.f": 900.0})["c.x"] - place["c.x"])/h
        agree(place[f"{port}.f"], -900*lever, rtol=1e-9, size=900)


@checks("Gear")
def test_gear() -> None:
    """w_a = i w_b; a loss by load: eta driven from a, 1/(2 - eta) driven from b (stated)."""
    law = part("Gear", i=5.0, eta=0.9, w_t=1e-9)
    w, torque = np.array([3.0, -3.0, 3.0, -3.0, 0.0]), np.array([20.0, -20.0, -20.0, 20.0, 20.0])
    found = law({"a.w": 5*w, "a.tau": torque})
    agree(found["b.w"], w, size=3.0)
    power_in, power_out = torque*5*w, -found["b.tau"]*w
    agree(power_out[:2], 0.9*power_in[:2])                  # from a to b
    agree(power_in[2:4], power_out[2:4]/(2 - 0.9))          # from b to a
    agree(found["b.tau"][4], -100.0)
    agree(part("Gear", i=-5.0, eta=1.0)({"b.w": w, "a.tau": torque})["b.tau"], 5*torque)


@checks("LeadScrew")
def test_lead_screw() -> None:
    law = part("LeadScrew", h=0.01, eta=0.4, w_t=1e-9)
    w, torque = np.array([30.0, -30.0, 30.0, 0.0]), np.array([2.0, -2.0, -2.0, 2.0])
    found = law({"a.w": w, "a.tau": torque})
    agree(found["b.v"], 0.01*w/(2*np.pi), size=0.01)
    power_in, power_out = torque*w, -found["b.f"]*found["b.v"]
    agree(power_out[:2], 0.4*power_in[:2])
    agree(power_in[2], power_out[2]/(2 - 0.4))
    agree(found["b.f"][3], -2*2*np.pi/0.01)


@checks("PlanetaryGear")
def test_planetary_gear_by_willis() -> None:
    """(w_s - w_c)/(w_r - w_c) = -z with z the teeth of the ring over those of the sun; torques 1 : z : -(1 + z)."""
    s, c = np.array([100.0, 50.0, -20.0]), np.array([0.0, 30.0, 10.0])
    found = part("PlanetaryGear", z=3.0)({"s.w": s, "c.w": c, "s.tau": [5.0, -2.0, 1.0]})
    agree((s - c)/(found["r.w"] - c), -3.0)
    agree(s*[5.0, -2.0, 1.0] + found["r.w"]*found["r.tau"] + c*found["c.tau"], 0.0, size=500)
    agree(found["r.tau"], [15.0, -6.0, 3.0])


@checks("Rack")
def test_rack() -> None:
    found = part("Rack", r=0.05)({"a.w": X, "b.f": F})
    agree(found["b.v"], 0.05*X)
    agree(found["a.tau"], -0.05*F)


@checks("Belt")
def test_belt() -> None:
    """Elongation r_a phi_a - r_b phi_b; pulleys turn the same way; without elongation w_b = w_a r_a/r_b."""
    found = part("Belt", r_a=0.1, r_b=0.3, c=5e4, T_d=2e-3)({"a.phi": 2.0, "b.phi": 0.6, "a.w": 9.0, "b.w": 2.5})
    pull = 5e4*(0.1*2.0 - 0.3*0.6 + 2e-3*(0.1*9.0 - 0.3*2.5))
    agree(found["a.tau"], 0.1*pull)
    agree(found["b.tau"], -0.3*pull)


@checks("SliderCrank")
def test_slider_crank_by_the_law_of_cosines() -> None:
    law = part("SliderCrank", r=0.1, l=0.25)
    phi = np.linspace(-3.5, 3.5, 29)
    found = law({"a.phi": phi, "b.f": 800.0})
    x = found["b.x"]
    agree(x**2 + 0.1**2 - 2*0.1*x*np.cos(phi), 0.25**2)  # triangle of shaft, crank pin and slider
    assert (x > 0).all()
    h = 1e-5
    slope = (law({"a.phi": phi + h, "b.f": 0.0})["b.x"] - law({"a.phi": phi - h, "b.f": 0.0})["b.x"])/(2*h)
    agree(found["a.tau"], -800*slope, rtol=1e-7, size=80)  # central difference: h**2 r


@checks("Clutch")
def test_clutch() -> None:
    law = part("Clutch", M_max=40.0, w_t=0.01)
    slip = np.array([-3.0, -0.01, 0.0, 0.01, 5.0])
    for u, pressed in ((-0.5, 0.0), (0.0, 0.0), (0.3, 0.3), (1.0, 1.0), (2.0, 1.0)):
        found = law({"a.w": 7.0, "b.w": 7.0 + slip, "u": u})
        agree(found["b.tau"], 40*pressed*np.tanh(slip/0.01), size=40)
        agree(found["a.tau"], -found["b.tau"], size=40)


# -- with oil -----------------------------------------------------------------------------------------------------------
P = np.array([-1e5, 0.0, 5e6, 2e7])


@checks("SealFriction")
def test_seal_friction() -> None:
    law = part("SealFriction", k_p=2e-5, v_t=1e-3)
    for v in (-0.2, -1e-3, 0.0, 1e-3, 0.5):
        found = law({"a.v": 0.1, "b.v": 0.1 + v, "p.p": P})
        agree(found["b.f"], 2e-5*np.maximum(P, 0)*np.tanh(v/1e-3), size=400)
        agree(found["p.q"], 0.0, size=1.0)


@checks("Friction")
def test_seal_friction_of_the_published_cylinder() -> None:
    """(F_c + (F_s - F_c) exp(-(v/v_s)**2) + k_p p) tanh(v/v_t) + sigma_2 v."""
    law = part("Friction", F_c=900.0, F_s=1500.0, v_s=0.05, sigma_2=300.0, k_p=2e-5, v_t=1e-3)
    for v in (-0.4, -1e-3, 0.0, 2e-3, 0.06):
        found = law({"a.v": 0.0, "b.v": v, "p.p": P})
        expected = (900 + 600*np.exp(-(v/0.05)**2) + 2e-5*np.maximum(P, 0))*np.tanh(v/1e-3) + 300*v
        agree(found["b.f"], expected, size=1e3)
        agree(found["a.f"], -expected, size=1e3)
        agree(found["p.q"], 0.0, size=1.0)


@checks("ForceCurveOfPressure")
def test_force_curve_of_pressure() -> None:
    heights = [5.0, -2.0, 3.0, 0.5, 0.0, -1.0, 4.0, 2.0, -6.0]
    p = np.linspace(-2e6, 3e7, 25)
    law = part("ForceCurveOfPressure", p_0=1e7, p_r=1e7, **{f"F_{k + 1}": h for k, h in enumerate(heights)})
    found = law({"p.p": p, "a.x": 0.0, "b.x": 0.0})
    agree(found["b.f"], cubic_spline(4*(p - 1e7)/1e7, heights))
    agree(found["p.q"], 0.0, size=1.0)


@checks("ForceEqualiser")
def test_force_equaliser_by_the_length_of_its_struts() -> None:
    """Two struts of length L = sqrt(s**2 + h**2) and area A: force on the stroke 2 p A dL/ds, flow 2 A dL/dt."""
    s, v = np.array([-1.5, -0.2, 0.0, 0.2, 1.5]), np.array([0.5, -0.5, 1.0, 0.0, 0.3])
    found = part("ForceEqualiser", A=0.01, h=1.2, l0=0.1)({"a.x": 0.2, "b.x": 0.3 + s, "a.v": 0.0, "b.v": v, "p.p": 5e6})
    length, e = (lambda at: np.sqrt(at**2 + 1.2**2)), 1e-5
    slope = (length(s + e) - length(s - e))/(2*e)
    agree(found["b.f"], -2*5e6*0.01*slope, rtol=1e-8, size=1e5)
    agree(found["p.q"], 2*0.01*slope*v, rtol=1e-8, size=0.02)
    agree(found["a.f"], -found["b.f"], size=1e5)


@checks("GasSpring", "PolytropicGasSpring")
def test_gas_spring_by_the_polytropic_law_and_its_tangent() -> None:
    """p V**n constant behind a plunger of area A, V_0 = n F_0 A/c; the linear one is its tangent at s = 0."""
    F_0, c, d, A, n = 2e5, 4e4, 900.0, 0.05, 1.3
    s, v = np.array([-2.0, -0.5, 0.0, 1.0, 3.0]), np.array([0.5, -0.5, 1.0, 0.0, -2.0])
    given = {"a.x": 0.1, "b.x": 0.1 + s, "a.v": 0.0, "b.v": v}
    V_0 = n*F_0*A/c
    gas = F_0/A*(V_0/(V_0 + A*s))**n*A
    for component, more, thrust in (("GasSpring", {}, F_0 - c*s), ("PolytropicGasSpring", {"n": n}, gas),
                                    ("PolytropicGasSpring", {"n": n, "mix": 0.0}, F_0 - c*s)):
        found = part(component, F_0=F_0, c=c, d=d, A=A, **more)(given)
        agree(found["b.f"], -(thrust - d*v))
        agree(found["a.f"], thrust - d*v)
        agree(found["p.p"], (thrust - d*v)/A)
    # the stated limit: a twentieth of the gas column
    law = part("PolytropicGasSpring", F_0=F_0, c=c, d=0.0, A=A, n=n)
    agree(law({"a.x": 0.1, "b.x": 0.1 - V_0/A*np.array([0.95, 0.99, 2.0]), "a.v": 0.0, "b.v": 0.0})["b.f"], -F_0*20**n)


# -- drill strings ------------------------------------------------------------------------------------------------------
@checks("DrillStringPiece")
def test_piece_of_a_drill_string() -> None:
    """Half of the mass at each end, a Kelvin-Voigt pipe of length l that hangs between them, a viscous hole."""
    law = part("DrillStringPiece", c=3e6, d=5e3, l=9.0, m=300.0, g=9.0, d_w=40.0)
    found = law({"a.x": 0.1, "b.x": -8.88, "a.v": 0.2, "b.v": -0.3, "der(a.v)": 1.5, "der(b.v)": -0.5,
                 "mud.a.v": 0.0})
    pull = 3e6*(0.1 + 8.88 - 9.0) + 5e3*(0.2 + 0.3)
    agree(found["a.f"], pull + 150*(1.5 + 9.0))
    agree(found["b.f"], -pull + 150*(-0.5 + 9.0) - 40*0.3)


STRING = """\
model: string
components:
  hook:   {is: Fixed}
  string: {is: DistributedDrillString, n: 20, L: 3000 m, D_o: 0.127 m, D_i: 0.1086 m, rho_m: 1200 kg/m**3, T_d: 0 s}
  end:    {is: Free}
nodes: {hook: [hook.a, string.a], bottom: [string.b, end.a]}
initial: {start: steady}
simulate: {until: 0.1 s, every: 50 ms}
"""


@checks("DistributedDrillString")
def test_drill_string_hangs_and_swings_as_an_elastic_rod() -> None:
    """Elongation g (rho - rho_m) L**2/(2 E) by its buoyant weight; first frequency sqrt(E/rho)/(4 L)."""
    E, rho, L, n = 206e9, 7850.0, 3000.0, 20
    result = run(STRING)
    # n lumps with half a mass at the end have the sum 1..n of parts, n**2/2 exactly with the halves
    agree(result["bottom.x"][0] + L, -9.81*(rho - 1200)*L**2/(2*E), rtol=1e-6)
    agree(result["hook.a.f"][0], -9.81*(rho - 1200)*np.pi/4*(0.127**2 - 0.1086**2)*L, rtol=1e-6)
    _, found = ModesAtStart(hb.assemble(hb.loads(STRING))).at({})
    slow = min(m.frequency for m in found if m.frequency > 0)
    assert slow == pytest.approx(np.sqrt(E/rho)/(4*L)*(1 - 0.1/n**2), rel=1e-4)


# -- measuring ----------------------------------------------------------------------------------------------------------
@checks("MotionReferenceUnit")
def test_motion_reference_unit() -> None:
    """T_1 z' + z = x + e; v = z'; e has the standard deviation sigma and lies between f_1 and f_2."""
    found = part("MotionReferenceUnit", T_1=0.2)({"a.x": X, "z": 0.1})
    agree(found["v"], (X - 0.1)/0.2)
    agree(found["a.f"], 0.0, size=1.0)
    time = np.arange(0, 400, 0.01)
    e = part("MotionReferenceUnit", T_1=0.2, sigma=0.03, n=50, f_1=2.0, f_2=5.0, seed=3)({"time": time})["e"]
    assert np.sqrt(np.mean(e**2)) == pytest.approx(0.03, rel=0.02)  # of 50 sines over 800 periods and more
    power, frequency = np.abs(np.fft.rfft(e))**2, np.fft.rfftfreq(len(e), 0.01)
    assert power[(frequency > 1.95) & (frequency < 5.05)].sum() > 0.999*power.sum()


def test_solvers_agree_on_a_pendulum() -> None:
    """ArmWeight and Inertia as a pendulum of large swing, beside another integrator."""
    result = run("""\
model: pendulum
components: {arm: {is: ArmWeight, m: 2 kg, l: 0.8 m}, body: {is: Inertia, J: 1.28 kg*m**2}}
nodes: {pin: [arm.a, body.a]}
initial: {pin.phi: 2.5 rad, pin.w: 0 rad/s}
simulate: {until: 5 s, every: 50 ms}
""", rtol=1e-9)
    def rates(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -2*9.81*0.8/1.28*np.sin(y[0])]
    other = solve_ivp(rates, (0, 5), [2.5, 0], t_eval=result.time, rtol=1e-10, atol=1e-12).y[0]
    np.testing.assert_allclose(result["pin.phi"], other, atol=1e-5)
