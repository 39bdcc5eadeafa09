"""Mechanics in the plane: every component beside the formulas of its source, and its example beside a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from examples import Array, Case, check, without_example
from library_check import agree, checks, part
from scipy.special import ellipj, ellipk

G = 9.81
PHI = np.array([0.3, -1.2, 2.5])
LAW = "the law at a prescribed motion; nothing is integrated"
RUN = "closed form; 1e-6 for the integration"
SWING = "closed form; 2e-5 for the integration, which adds up over the swings"


def swing(t: Array, start: float, rate: float) -> Array:
    """The angle of a pendulum let go at `start` from hanging, sin(theta/2) = k sn(K - rate t, k) with k = sin(start/2)."""
    k = np.sin(start/2)
    return 2*np.arcsin(k*ellipj(ellipk(k**2) - rate*t, k**2)[0])


def by_cosines(t: Array) -> Array:
    """The angle between two sides of 1 m and 0.6 m, opposite to which a strut changes its length."""
    s = 1 + 0.4*np.sin(np.pi/2*t)
    return np.arccos((1 + 0.6**2 - s**2)/(2*0.6))


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
        {"a.x": 1.0, "a.y": 2.0, "a.phi": PHI, "s": s, "N": 3.0, "r.f": 11.0, "b.M": 2.0, "h.x": 0.5})
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
