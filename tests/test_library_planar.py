"""Mechanics in the plane: every component beside the formulas of its source, and its example beside a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from examples import LAW, RUN, SWING, Array, Case, by_cosines, check, swing, without_example
from library_check import agree, checks, part, run
from scipy.optimize import brentq

G = 9.81
PHI = np.array([0.3, -1.2, 2.5])


def pitch(theta: Array) -> tuple[Array, Array, Array]:
    """Radius of the example's pitch curve and its first two derivatives."""
    cos, sin, cos_2, sin_2 = np.cos(theta), np.sin(theta), np.cos(2*theta), np.sin(2*theta)
    return (0.05 + 0.01*cos + 0.002*cos_2 + 0.003*sin_2, -0.01*sin - 0.004*sin_2 + 0.006*cos_2,
            -0.01*cos - 0.008*cos_2 - 0.012*sin_2)


def cam_torque(t: Array) -> Array:
    """The torque of a motor that turns the cam at 10 rad/s: the force on the roller times its travel per angle."""
    radius, slope, curvature = pitch(np.pi/2 - 10*t)
    force = 0.5*(G + curvature*10**2) + 3000*radius  # weight, inertia, and the spring, which is unloaded at 0
    return force*slope


CASES = [
    Case("planar_fixed", "beam.a.M", lambda t: 40*G*1.5 + 0*t, LAW),
    Case("planar_body", "height", lambda t: 4*t - G/2*t**2, RUN),
    Case("rigid_link", "top.phi", lambda t: swing(t, np.pi/2, np.sqrt(G/0.8)) - np.pi/2, SWING, 2e-5),
    Case("revolute_joint", "pin.phi", lambda t: swing(t, np.pi*2/3, np.sqrt(12*G/(4 + 12))) - np.pi/2, SWING, 2e-5),
    Case("planar_shaft", "plate.phi", lambda t: np.radians(40)*np.cos(np.sqrt(20/0.2)*t), SWING, 2e-5),
    Case("planar_strut", "boom.phi", by_cosines, LAW),
    Case("prismatic_joint", "guide.s", lambda t: G*0.5*t**2/2, RUN),
    Case("planar_spring", "weight.y", lambda t: 1.5 - 4*G/900*(1 - np.cos(np.sqrt(900/4)*t)), SWING, 2e-5),
    Case("planar_force", "plate.x", lambda t: 6/3*t**2/2, RUN),
    Case("planar_sensor", "gauge.y", lambda t: 0.3*np.sin(2*t), RUN),
    # (m_1 - m_2) g/(m_1 + m_2 + J/r**2)
    Case("rope_strand", "heavy.y", lambda t: -3 - 20*G/110*t**2/2, "Atwood's machine; 1e-6 for the integration"),
    Case("rope_strand", "right.F", lambda t: 40*(G + 20*G/110) + 0*t, RUN),
    Case("rolling_wheel", "wheel.s", lambda t: G*np.sin(np.radians(20))/(1 + 1/2)*t**2/2, RUN),
    Case("rolling_wheel", "wheel.N", lambda t: 8*G*np.cos(np.radians(20)) + 0*t, LAW),
    Case("planar_contact", "body.v_x", lambda t: np.maximum(7 - 0.15*G*t, 5),
         "slides until 2 v/(7 mu g), then rolls at 5/7 v; 3e-4 for the transition speed of the friction", 3e-4),
    Case("planar_cam", "roller.y", lambda t: pitch(np.pi/2 - 10*t)[0], "the curve; 1e-4 for the indentation", 1e-4),
    Case("planar_cam", "motor.a.tau", cam_torque, "virtual work; 1e-3 for the indentation and its vibration", 1e-3),
    Case("planar_gear", "planet.phi", lambda t: (1 + 0.1/0.06)*t**2, LAW),
    Case("planar_gear", "mesh.F", lambda t: -0.01*(1 + 0.1/0.06)*2/0.06 + 0*t, LAW),
    Case("pin_friction", "table.w", lambda t: np.maximum(5 - 2/1.6*t, 0),
         "closed form; 1e-4 for the transition at rest", 1e-4),
    Case("revolute_joint_with_play", "body.y", lambda t: -1e-3 - 50*G/2e6 + 0*t,
         "at rest on the bottom of the bore", 1e-6, 0.9),
    Case("planar_force_sensor", "cell.M", lambda t: 40*G*1.5 + 0*t, LAW),
    Case("planar_force_sensor", "cell.F_y", lambda t: 40*G + 0*t, LAW),
    Case("planar_velocity_sensor", "gauge.v_x", lambda t: -0.6*np.sin(2*t), RUN),
    Case("planar_velocity_sensor", "gauge.v_y", lambda t: 0.6*np.cos(2*t), RUN),
    Case("planar_position_source", "load.a.F_y", lambda t: 2000*(G - 1.5*(np.pi/4)**2*np.sin(np.pi/4*t)), LAW),
    Case("planar_slider", "body.x", lambda t: 0.15*np.cos(5*t) + 0.05, RUN),
    Case("distance_sensor", "gauge.y", lambda t: np.hypot(0.7 - 0.3*np.cos(2*t), 0.3*np.sin(2*t)), RUN),
]


@pytest.mark.parametrize("case", CASES, ids=[case.example for case in CASES])
def test_example(case: Case) -> None:
    check(case)


def test_every_component_has_an_example_with_a_number() -> None:
    assert without_example(["planar"], CASES) == []


def turned(along: float, h: float, phi: Array) -> tuple[Array, Array]:
    return along*np.cos(phi) - h*np.sin(phi), along*np.sin(phi) + h*np.cos(phi)


@checks("PlanarFixed")
def test_fixed() -> None:
    found = part("PlanarFixed", x_0=1.0, y_0=2.0, phi_0=0.5)({"a.F_x": PHI, "a.F_y": 0.0, "a.M": 0.0})
    agree(found["a.x"], 1.0)
    agree(found["a.y"], 2.0)
    agree(found["a.phi"], 0.5)


@checks("PlanarBody")
def test_body_by_the_acceleration_of_its_centre() -> None:
    """Newton's law for the centre of mass, whose velocity is that of a rigid body; moments about port a."""
    m, inertia, along, h, w, e = 3.0, 0.7, 0.4, -0.2, 2.0, 5.0
    found = part("PlanarBody", m=m, J=inertia, l_g=along, h_g=h)(
        {"a.phi": PHI, "a.w": w, "a.v_x": 0.3, "a.v_y": -0.4, "der(u_x)": 1.5, "der(u_y)": -2.5, "der(a.w)": e})
    r_x, r_y = turned(along, h, PHI)
    agree(found["u_x"], 0.3 - w*r_y)
    agree(found["u_y"], -0.4 + w*r_x)
    force_x, force_y = m*1.5, m*(-2.5 + G)
    agree(found["a.F_x"], force_x)
    agree(found["a.F_y"], force_y)
    agree(found["a.M"], inertia*e + r_x*force_y - r_y*force_x)


@checks("RigidLink")
def test_link() -> None:
    found = part("RigidLink", l=0.8, h=0.3)({"a.x": 1.0, "a.y": 2.0, "a.phi": PHI, "b.F_x": 5.0, "b.F_y": -7.0, "b.M": 2.0})
    r_x, r_y = turned(0.8, 0.3, PHI)
    agree(found["b.x"], 1 + r_x)
    agree(found["b.y"], 2 + r_y)
    agree(found["b.phi"], PHI)
    agree(found["a.F_x"], -5.0)
    agree(found["a.M"], -2.0 - (r_x*-7.0 - r_y*5.0))


@checks("RevoluteJoint")
def test_revolute_joint() -> None:
    found = part("RevoluteJoint")({"a.x": 1.0, "a.y": 2.0, "a.phi": 0.2, "b.phi": PHI, "a.w": 1.0, "b.w": 4.0,
                                   "a.F_x": 5.0, "a.F_y": 6.0})
    agree(found["b.x"], 1.0)
    agree(found["b.y"], 2.0)
    agree(found["phi"], PHI - 0.2)
    agree(found["w"], 3.0)
    agree(found["b.F_y"], -6.0)
    agree(found["a.M"] + found["b.M"], 0.0, size=1)


@checks("PrismaticJoint")
def test_prismatic_joint() -> None:
    s, alpha = 0.7, 0.4
    found = part("PrismaticJoint", alpha=alpha)(
        {"a.x": 1.0, "a.y": 2.0, "a.phi": PHI, "s": s, "N": 3.0, "r.f": 11.0, "b.M": 2.0, "h.x": 0.5, "r.v": 0.3, "h.v": 0})
    c, n = np.cos(PHI + alpha), np.sin(PHI + alpha)
    agree(found["b.x"], 1 + s*c)
    agree(found["b.y"], 2 + s*n)
    agree(found["r.x"], 0.5 + s)
    agree(found["h.f"], -11.0)
    agree(found["b.F_x"]*c + found["b.F_y"]*n, -11.0)  # along the guide
    agree(found["b.F_x"]*n - found["b.F_y"]*c, 3.0)    # across it
    agree(found["a.M"] + 2.0 + s*(c*found["b.F_y"] - n*found["b.F_x"]), 0.0, size=10)


@checks("PlanarShaft")
def test_shaft() -> None:
    found = part("PlanarShaft")({"a.phi": PHI, "s.tau": 4.0})
    agree(found["s.phi"], PHI)
    agree(found["a.M"], -4.0)


@checks("PlanarStrut")
def test_strut() -> None:
    found = part("PlanarStrut")({"a.x": 1.0, "a.y": 2.0, "b.x": 4.0, "b.y": [6.0, -2.0, 2.0], "h.x": 0.5, "r.f": 10.0})
    s = np.array([5.0, 5.0, 3.0])
    agree(found["r.x"], 0.5 + s)
    agree(found["b.F_x"], -10*3/s)  # the component takes what the rod gives, and gives it to b
    agree(found["b.F_y"], -10*np.array([4.0, -4.0, 0.0])/s)
    agree(found["a.F_x"], 10*3/s)


@checks("PlanarSpring")
def test_spring() -> None:
    found = part("PlanarSpring", c=100.0, d=7.0, l0=2.0)(
        {"a.x": 1.0, "a.y": 2.0, "b.x": 4.0, "b.y": 6.0, "a.v_x": 0.0, "a.v_y": 0.0, "b.v_x": 0.5,
         "b.v_y": [1.0, 0.0, -1.0]})
    force = 100*(5 - 2) + 7*(0.6*0.5 + 0.8*np.array([1.0, 0.0, -1.0]))
    agree(found["F"], force)
    agree(found["b.F_x"], force*0.6)
    agree(found["a.F_y"], -force*0.8)


@checks("PlanarForce")
def test_force() -> None:
    found = part("PlanarForce")({"F_x": PHI, "F_y": 2.0})
    agree(found["a.F_x"], -PHI)
    agree(found["a.F_y"], -2.0)
    agree(found["a.M"], 0.0, size=1)


@checks("PlanarSensor", "DistanceSensor")
def test_sensors() -> None:
    found = part("PlanarSensor")({"a.x": 1.0, "a.y": 2.0, "a.phi": PHI})
    agree(found["x"], 1.0)
    agree(found["y"], 2.0)
    agree(found["phi"], PHI)
    agree(part("DistanceSensor")({"a.x": 1.0, "a.y": 2.0, "b.x": 4.0, "b.y": 6.0})["y"], 5.0)


@checks("RopeStrand")
def test_rope_strand_on_two_wheels_by_triangles() -> None:
    """Open and crossed strands: the tangent is a side of the triangle of the distance and the difference of the radii."""
    r_a, at = 0.3, {"a.x": 0.0, "a.y": 0.0, "b.x": 1.0, "b.y": 0.0, "a.phi": 0.2, "b.phi": -0.1, "a.w": 0.0, "b.w": 0.0,
                    "a.v_x": 0.0, "a.v_y": 0.0, "b.v_x": 0.0, "b.v_y": 0.0}
    for r_b in (0.1, -0.1):
        found = part("RopeStrand", r_a=r_a, r_b=r_b, l0=0.9, c=1e5)(at)
        gap = r_a - r_b
        length, turn = np.sqrt(1 - gap**2), -np.arcsin(gap)
        agree(found["l"], length)
        agree(found["beta"], turn)
        wound = length + r_a*(0.2 - turn) - r_b*(-0.1 - turn)
        agree(found["s"], wound)
        tension = 1e5*(wound - 0.9)
        agree(found["F"], tension)
        agree(found["b.F_x"], tension*np.cos(turn))
        agree(found["a.F_y"], -tension*np.sin(turn))
        agree(found["a.M"], r_a*tension)
        agree(found["b.M"], -r_b*tension)
    slack = part("RopeStrand", r_a=r_a, l0=2.0, c=1e5)(at)
    agree(slack["F"], 0.0, size=1)
    # an eye that turns about the origin: the direction is counted from theta_0
    eye = part("RopeStrand", theta_0=2.0, l0=0.5, c=1e5)({**at, "b.x": np.cos(PHI), "b.y": np.sin(PHI)})
    agree(eye["beta"], (PHI - 2 + np.pi) % (2*np.pi) - np.pi)


@checks("RollingWheel")
def test_rolling_wheel_on_a_slope() -> None:
    found = part("RollingWheel", r=0.25, alpha=0.1, s_0=0.5)(
        {"a.x": 1.0, "a.y": 2.0, "a.phi": 0.3, "b.phi": PHI, "T": 4.0, "N": 10.0, "a.w": 0, "b.w": 1})
    way = 0.5 - 0.25*(PHI - 0.4)
    agree(found["s"], way)
    agree(found["b.x"], 1 + way*np.cos(0.4) - 0.25*np.sin(0.4))
    agree(found["b.y"], 2 + way*np.sin(0.4) + 0.25*np.cos(0.4))
    agree(found["b.F_x"], -(4*np.cos(0.4) - 10*np.sin(0.4)))  # the wheel takes 4 N along the line and 10 N across it
    agree(found["b.F_y"], -(4*np.sin(0.4) + 10*np.cos(0.4)))
    agree(found["b.M"], -0.25*4)
    agree(found["a.M"], 10*way)                               # lever of the normal force about the foot of the line


@checks("PlanarContact")
def test_contact_of_a_disc_by_its_rim() -> None:
    given = {"a.x": 0.0, "a.y": 0.0, "a.phi": 0.0, "a.v_x": 0.0, "a.v_y": 0.0, "a.w": 0.0, "b.x": 2.0, "b.y": [0.19, 0.21],
             "b.v_x": 3.0, "b.v_y": -0.4, "b.w": [5.0, -20.0], "b.phi": 0.0}
    found = part("PlanarContact", r=0.2, c=1e6, chi=0.5, mu=0.3, v_t=0.01)(given)
    normal = np.array([1e6*0.01*(1 + 0.5*0.4), 0.0])
    agree(found["u"], [3 + 0.2*5, 3 - 0.2*20])
    agree(found["b.F_y"], -normal)
    agree(found["b.F_x"], 0.3*normal, size=1e4)
    agree(found["b.M"], 0.2*0.3*normal, size=1e3)
    turned = part("PlanarContact", r=0.2, alpha=-0.2, c=1e6)({**given, "a.phi": 0.2, "a.w": 1.5})
    agree(turned["v"], 0.4 + 1.5*2.0)                         # the line comes up at 3 m/s below the disc


def test_a_bounce_by_the_law_of_hunt_and_crossley() -> None:
    """m v dv/(1 + chi v) = -c e de on the way in and out: both integrals over v are the same, whatever m and c."""
    fall, chi = 1.4, 0.3
    found = run(f"""
model: bounce
components:
  ground: {{is: PlanarFixed}}
  ball:   {{is: PlanarContact, r: 0.1 m, c: 5 MN/m, chi: {chi} s/m}}
  body:   {{is: PlanarBody, m: 2 kg, J: 1 kg*m**2, g: 0}}
nodes: {{ground: [ground.a, ball.a], body: [ball.b, body.a]}}
initial: {{body.x: 0 m, body.y: 0.11 m, body.phi: 0 rad, body.v_x: 0 m/s, body.v_y: -{fall} m/s, body.w: 0 rad/s}}
simulate: {{until: 50 ms, every: 1 ms}}
""")

    def way(v: float) -> float:
        return float(v - np.log1p(chi*v)/chi)

    rebound = brentq(lambda v: way(-v) - way(fall), 0.1, fall)
    assert found["body.v_y"][-1] == pytest.approx(rebound, rel=1e-5)


@checks("PlanarCam")
def test_cam_by_its_pitch_curve() -> None:
    """The roller inside the curve by 1 um; the force stands across the curve."""
    radius, slope, _ = pitch(PHI)
    turn, inside = 0.7, radius - 1e-6
    x, y = inside*np.cos(PHI + turn), inside*np.sin(PHI + turn)
    found = part("PlanarCam", n=2, r_0=0.05, c="[10 mm, 2 mm]", s="[0 mm, 3 mm]", k=1e8)(
        {"a.x": 0.0, "a.y": 0.0, "a.phi": turn, "b.x": x, "b.y": y, "a.w": 0.0, "a.v_x": 0.0, "a.v_y": 0.0, "b.v_x": 0.0,
         "b.v_y": 0.0})
    agree(found["r"], radius)
    agree(found["G"], slope, size=0.01)
    along = np.array([np.cos(PHI + turn)*slope - y/inside*radius, np.sin(PHI + turn)*slope + x/inside*radius])
    # 100 N times 10 mm of slope, but for 1 um of indentation in 50 mm
    agree(found["b.F_x"]*along[0] + found["b.F_y"]*along[1], 0.0, rtol=2e-5, size=1)
    agree(-(found["b.F_x"]*x + found["b.F_y"]*y)/inside, 100.0, rtol=1e-7)
    agree(found["a.M"], -(x*found["b.F_y"] - y*found["b.F_x"]), rtol=1e-8, size=1)


@checks("PlanarGear")
def test_gears_by_their_pitch_circles() -> None:
    """Outer and inner teeth: arcs rolled off are equal; the wheels' force acts at the pitch point."""
    for r_b in (0.06, -0.25):
        found = part("PlanarGear", r_a=0.1, r_b=r_b, psi_0=0.3)(
            {"a.x": 1.0, "a.y": 2.0, "b.x": 1 + (0.1 + r_b)*np.cos(0.8), "b.y": 2 + (0.1 + r_b)*np.sin(0.8), "a.phi": PHI,
             "F": 50.0}, {"k": 1.0, "beta": 0.4})
        agree(found["beta"], 0.5)
        agree(r_b*(found["b.phi"] - 0.5), -0.1*(PHI - 0.5))
        agree(found["a.M"], 0.1*50)
        agree(found["b.F_x"], 50*np.sin(0.8))
        lever = found["a.M"] + found["b.M"] + (0.1 + r_b)*(np.cos(0.8)*found["b.F_y"] - np.sin(0.8)*found["b.F_x"])
        agree(lever, 0.0, size=10)


@checks("PinFriction")
def test_pin_friction() -> None:
    found = part("PinFriction", M_c=5.0, d=2.0, w_t=0.1)({"a.w": 1.0, "b.w": [4.0, 1.0, 0.9]})
    agree(found["b.M"], 5*np.tanh([30.0, 0.0, -1.0]) + 2*np.array([3.0, 0.0, -0.1]))
    agree(found["a.M"], -found["b.M"])


@checks("RevoluteJointWithPlay")
def test_play_of_a_pin() -> None:
    law = part("RevoluteJointWithPlay", gap=0.001, c=1e7, chi=0.5, r=0.02, mu=0.2, v_t=1e-4)
    found = law({"a.x": 0.0, "a.y": 0.0, "a.phi": 0.1, "b.phi": 0.4, "b.x": [0.0, 0.0009], "b.y": [-0.0015, 0.0],
                 "a.v_x": 0.0, "a.v_y": 0.0, "a.w": 0.0, "b.v_x": 0.0, "b.v_y": -0.2, "b.w": 3.0})
    force = np.array([1e7*0.0005*(1 + 0.5*0.2), 0.0])
    agree(found["b.F_y"], -force, rtol=1e-4, size=force[0])   # 1e-8 m of the eccentricity's width
    agree(found["b.F_x"], 0.2*force, rtol=1e-4, size=force[0])  # the rim below slips to the right
    agree(found["b.M"], 0.02*0.2*force, rtol=1e-4, size=force[0])
    agree(found["phi"], 0.3)


@checks("PlanarForceSensor", "PlanarVelocitySensor", "PlanarPositionSource", "PlanarSlider")
def test_further_sensors_and_sources() -> None:
    cell = part("PlanarForceSensor")({"a.x": 1.0, "a.y": 2.0, "a.phi": PHI, "b.F_x": 3.0, "b.F_y": -4.0, "b.M": 5.0})
    agree(cell["b.phi"], PHI)
    agree(cell["F_x"], -3.0)
    agree(cell["F_y"], 4.0)
    agree(cell["M"], -5.0)
    agree(part("PlanarVelocitySensor")({"a.v_x": 1.0, "a.v_y": 2.0, "a.w": PHI})["w"], PHI)
    agree(part("PlanarPositionSource")({"x": 1.0, "y": PHI, "phi": 0.2})["a.y"], PHI)
    slide = part("PlanarSlider", alpha=0.3)({"a.x": 1.0, "a.y": PHI, "s.f": 7.0})
    agree(slide["s.x"], np.cos(0.3) + PHI*np.sin(0.3))
    agree(slide["a.F_x"], -7*np.cos(0.3))
    agree(slide["a.F_y"], -7*np.sin(0.3))
