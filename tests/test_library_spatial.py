"""Mechanics in space: the example of every component beside a closed form."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from examples import LAW, RUN, SWING, Array, Case, by_cosines, check, swing, without_example
from library_check import Found, agree, checks, part, run
from scipy.spatial.transform import Rotation

import heavebond as hb
from heavebond.cli import main

G = 9.81


def cone(t: Array) -> Array:
    """The centre of a rod on a ball joint that goes round with its angular velocity vertical: the moment of its weight is
    the rate of its angular momentum, (J_t - J_a) w**2 cos(theta) = m g l."""
    theta, m, transverse, axial = 0.5, 2, 0.5 + 2*1**2, 0.1
    w = np.sqrt(m*G*1/((transverse - axial)*np.cos(theta)))
    return -np.sin(theta)*np.cos(w*t)


def paid_out(t: Array) -> Array:
    """The tension of a rope that is paid out with 2 m/s2 from equilibrium: m (g - a) and an oscillation of m a."""
    return 200*(G - 2) + 200*2*np.cos(np.sqrt(50e3/200)*t)


# a disc in steady motion with the angular velocity -3 rad/s about the vertical, inclined by 0.4 rad: its rate about its axis
SPIN = (9*np.cos(0.4)*1.25e-3 - 0.5*0.1*G)*np.tan(0.4)/(-3*(2.5e-3 + 0.5*0.1**2))
GATE = np.sqrt(12*G/(4 + 12))
CASES = [
    Case("spatial_fixed", "wall.a.M_y", lambda t: 40*G*1.5 + 0*t, LAW),
    Case("spatial_body", "height", lambda t: 4*t - G/2*t**2, RUN),
    # of a symmetric top: Euler's equations turn the transverse part with (J_z - J_x)/J_x w_z
    Case("spatial_body", "rate", lambda t: np.cos(0.5*8*t), RUN),
    Case("spatial_point_mass", "height", lambda t: 4*t - G/2*t**2, RUN),
    Case("spatial_link", "pin.phi", lambda t: swing(t, np.pi/2, np.sqrt(G/0.8)) - np.pi/2, SWING, 2e-5),
    Case("spatial_revolute_joint", "pin.phi", lambda t: swing(t, np.pi*2/3, GATE) - np.pi/2, SWING, 2e-5),
    Case("spatial_prismatic_joint", "guide.s", lambda t: G*0.5*t**2/2, RUN),
    Case("cylindrical_joint", "rod.phi", lambda t: 0.6/0.2*t**2/2, RUN),
    Case("cylindrical_joint", "rod.s", lambda t: -G*t**2/2, RUN),
    Case("screw_joint", "nut.z", lambda t: -5*G/(5 + 0.03*(2*np.pi/0.5)**2)*t**2/2, RUN),
    Case("universal_joint", "cross.phi", lambda t: swing(t, np.pi*2/3, GATE) - np.pi/2, SWING, 2e-5),
    Case("spherical_joint", "way", cone, RUN),
    # J dw/dt = -M_c - d w against the angular velocity, whose direction remains; w_t**2/(2 w**2) is below 2e-7
    Case("ball_friction", "rolls", lambda t: 0.6*(25*np.exp(-0.2*t) - 15), SWING, 2e-6),
    Case("ball_friction", "spins", lambda t: 0.8*(25*np.exp(-0.2*t) - 15), SWING, 2e-6),
    # a wheel that turns about its axis, which tumbles: the moment is the rate of its angular momentum
    Case("orientation_source", "wheel.w_y", lambda t: 2 + 0*t, LAW),
    Case("orientation_source", "moment", lambda t: -0.02*3*2*np.sin(2*t), LAW),
    Case("ball_drive", "pushed", lambda t: 2*t, RUN),
    Case("ball_drive", "braked", lambda t: -4*np.exp(-0.5*t), RUN),
    Case("ball_drive", "torque", lambda t: -0.15*t, RUN),
    Case("plane_joint", "plane.s", lambda t: G*np.sin(np.radians(20))*t**2/2, RUN),
    Case("plane_joint", "plane.phi", lambda t: 3*t, RUN),
    Case("cardan_joint", "place.z", lambda t: np.sin(0.5*t) + 5*np.sin(0.2*np.sin(0.8*t)), LAW),
    Case("spatial_spring", "weight.z", lambda t: 1.5 - 4*G/900*(1 - np.cos(np.sqrt(900/4)*t)), SWING, 2e-5),
    Case("spatial_rope", "rope.F", paid_out, SWING, 2e-5),
    Case("spatial_strut", "pin.phi", by_cosines, LAW),
    # (6 kg * 0.5 m + 3 kg * 1.6 m + 5 kg * 2 m) g, and 6*0.5**2 + 3*1.6**2 + 5*2**2 + 0.6 kg*m**2 about the ceiling
    Case("spatial_strut_mass", "angle", lambda t: swing(t, np.pi/3, np.sqrt(17.8*G/29.78)), SWING, 2e-5),
    Case("spatial_force", "way", lambda t: 6/3*t**2/2, RUN),
    Case("spatial_force", "turn", lambda t: 0.3/0.2*t, RUN),
    Case("spatial_position_source", "side", lambda t: 0.3*np.sin(2*t), LAW),
    Case("spatial_position_source", "force", lambda t: -2*0.3*2**2*np.cos(2*t), LAW),
    Case("spatial_sensor", "gauge.roll", lambda t: 0.3*np.sin(t), LAW),
    Case("spatial_sensor", "gauge.pitch", lambda t: 0.2*t, LAW),
    Case("spatial_sensor", "gauge.yaw", lambda t: 0.5*t, LAW),
    Case("spatial_motion_sensor", "inwards", lambda t: -0.5*(3*t)**2, LAW),
    Case("spatial_motion_sensor", "forward", lambda t: 0.5*3 + 0*t, LAW),
    Case("spatial_motion_sensor", "upwards", lambda t: G + 0*t, LAW),
    Case("spatial_relative_sensor", "forward", lambda t: 2*np.cos(0.5*t), LAW),
    Case("spatial_relative_sensor", "side", lambda t: -np.cos(0.5*t), LAW),
    Case("spatial_relative_sensor", "yaw", lambda t: -0.5*t, LAW),
    Case("spatial_distance_sensor", "gauge.y", lambda t: np.hypot(0.1 + 3*t, 4*t - G/2*t**2), RUN),
    Case("spatial_force_sensor", "force", lambda t: 40*G + 0*t, LAW),
    Case("spatial_force_sensor", "moment", lambda t: -40*G*1.5 + 0*t, LAW),
    Case("spatial_free", "axis", np.sin, RUN),
    Case("spatial_minimal", "axis", lambda t: np.sin(0.1*t), RUN),
    Case("spatial_idle", "height", lambda t: 4*t - G/2*t**2, RUN),
    # the angular momentum about a point of the lane is conserved: 5/7 of the speed remain
    Case("sphere_plane_contact", "body.v_x", lambda t: 5 + 0*t, RUN, begin=1.8),
    Case("sphere_contact", "second", lambda t: 2 + 0*t, RUN, begin=0.03),
    Case("rolling_sphere", "x", lambda t: 0.2*np.cos(t), SWING, 2e-5),
    Case("rolling_sphere", "y", lambda t: 0.2*np.sin(t), SWING, 2e-5),
    Case("rolling_disc", "x", lambda t: -SPIN*0.1/3*np.sin(-3*t), SWING, 2e-5),
    Case("rolling_disc", "coin.i[3]", lambda t: np.sin(0.4) + 0*t, SWING, 2e-5),
    Case("floating_hull", "heave", lambda t: 0.1*np.cos(np.sqrt(1025*G*160/328e3)*t), SWING, 2e-5),
    # the metacentric height is I_x/V + z_B, as the centre of mass is at port a
    Case("floating_hull", "angle.roll", lambda t: 1e-3*np.cos(np.sqrt(1025*G*(853.3333 - 320)/2.5e6)*t), SWING, 2e-5),
    Case("added_mass", "heave", lambda t: 0.2*np.cos(np.sqrt(1025*G*3/(2050 + 1500))*t), SWING, 2e-5),
    Case("hull_damping", "speed", lambda t: 1.5*(1 - np.exp(-t/2)), RUN),
    # J dw/dt = -d w - k w**2
    Case("hull_damping", "turn", lambda t: 2*np.exp(-2*t)/(1 + 2*2/10*(1 - np.exp(-2*t))), RUN, 2e-6),
    Case("spatial_bushing", "engine.z", lambda t: 2e-3*np.cos(np.sqrt(500e3/150)*t), SWING, 2e-5),
    Case("spatial_bushing", "angle.yaw", lambda t: 2e-3*np.cos(np.sqrt(2e3/8)*t), SWING, 2e-5),
    Case("spatial_rod", "x", lambda t: 0.6*np.cos(np.sqrt(G/0.8)*t), SWING, 2e-5),
    Case("spatial_rod", "tension", lambda t: 2*G/0.8 + 0*t, RUN),
    # m g L**3/(8 E I) + M g L**3/(3 E I), and F L**3/(3 E I)
    Case("elastic_beam", "tip.z", lambda t: -(300/8 + 100/3)*G*216/4e6 + 0*t, LAW),
    Case("elastic_beam", "tip.y", lambda t: 500/3*216/2e6 + 0*t, LAW),
    # a pendulum of 4 kg with a moment of inertia of 0.1 + 4 kg*m**2
    Case("plane_in_space", "z", lambda t: -np.cos(swing(t, np.pi/3, np.sqrt(4*G/4.1))), SWING, 2e-5),
    # Coriolis force and rate of the angular momentum of a mass at 0.2 m + 0.8 m cos(3 rad/s t) on a turntable of 0.5 rad/s
    Case("plane_on_body", "across", lambda t: 2*4*0.5*0.8*3*np.sin(3*t), LAW),
    Case("plane_on_body", "moment", lambda t: -2*4*0.5*(0.2 + 0.8*np.cos(3*t))*0.8*3*np.sin(3*t), LAW),
    Case("plane_in_space", "y", lambda t: 2 + np.sin(swing(t, np.pi/3, np.sqrt(4*G/4.1)))/2, SWING, 2e-5),
]


@pytest.mark.parametrize("case", partly(CASES, 3), ids=lambda case: f"{case.example}-{case.signal}")
def test_the_example_shows_the_law(case: Case) -> None:
    check(case)


def test_every_component_has_an_example() -> None:
    assert without_example(["spatial"], CASES) == []


# -- the laws at points ------------------------------------------------------------------------------------------------
N = 5
_random = np.random.default_rng(7)
TURN = Rotation.random(N, random_state=3)
UP = np.array([0.0, 0, G])
r_A, v_A, w_A, F_B, M_B, ALPHA, ACCEL = (_random.normal(size=(N, 3)) for _ in range(7))


def members(port: str, word: str, values: Array) -> dict[str, Array]:
    """The members of a vector (N, 3) of a port: F_x, F_y, F_z, or x, y, z."""
    return {f"{port}.{f'{word}_' if word else ''}{axis}": values[:, k] for k, axis in enumerate("xyz")}


def elements(name: str, values: Array) -> dict[str, Array]:
    return {f"{name}[{k + 1}]": values[:, k] for k in range(values.shape[1])}


def vector(found: Found, port: str, word: str) -> Array:
    return np.stack([found[name] for name in members(port, word, np.zeros((1, 3)))], axis=-1)


def quaternion(found: Found, port: str) -> Rotation:
    x, y, z, w = (found[f"{port}.q_{k}"] for k in (1, 2, 3, 0))
    return Rotation.from_quat(np.stack([x, y, z, w], axis=-1))


def frame_a() -> dict[str, Array]:
    """The frame of port a: its orientation, angular velocity, position and velocity."""
    x, y, z, w = TURN.as_quat().T
    return {"a_rotation.s_0": w, "a_rotation.s_1": x, "a_rotation.s_2": y, "a_rotation.s_3": z,
            **elements("a_rotation.w", w_A), **members("a", "", r_A), **members("a", "v", v_A)}


def seen_a() -> dict[str, Array]:
    """The same for a sensor, which alone does not make the orientation of its node a state."""
    x, y, z, w = TURN.as_quat().T
    return {"a.q_0": w, "a.q_1": x, "a.q_2": y, "a.q_3": z, **members("a", "w", w_A), **members("a", "", r_A),
            **members("a", "v", v_A)}


def relates(found: Found, turn: Rotation, spin: Array, shift: Array, speed: Array) -> None:
    """The frame of b from that of a by a rotation, an angular velocity, a vector and its rate in the axes of a."""
    agree((quaternion(found, "b")*(TURN*turn).inv()).magnitude(), 0*r_A[:, 0], 1e-7, 1)
    agree(vector(found, "b", "w"), w_A + TURN.apply(spin), 1e-9, 1)
    agree(vector(found, "b", ""), r_A + TURN.apply(shift), 1e-9, 1)
    agree(vector(found, "b", "v"), v_A + np.cross(w_A, TURN.apply(shift)) + TURN.apply(speed), 1e-9, 1)


def balances(found: Found) -> None:
    """Newton's third law, and the balance of moments about a."""
    arm = vector(found, "b", "") - vector(found, "a", "")
    agree(vector(found, "a", "F"), -vector(found, "b", "F"))
    agree(vector(found, "a", "M"), -vector(found, "b", "M") - np.cross(arm, vector(found, "b", "F")), 1e-9, 1)


AXIS = np.array([1.0, 2.0, -2.0])/3
n = "[1, 2, -2]"
LOAD = {**members("b", "F", F_B), **members("b", "M", M_B)}
PHI, RATE = _random.normal(size=(2, N))


@checks("SpatialFixed")
def test_a_fixed_frame() -> None:
    found = part("SpatialFixed", x_0="1 m", y_0="2 m", z_0="3 m", roll="0.1 rad", pitch="0.2 rad", yaw="0.3 rad")({})
    agree([found[f"a.{axis}"] for axis in "xyz"], [1, 2, 3])
    turn = Rotation.from_quat([float(found[f"a.q_{k}"]) for k in (1, 2, 3, 0)])
    agree(turn.as_matrix(), Rotation.from_euler("ZYX", [0.3, 0.2, 0.1]).as_matrix(), 1e-9, 1)
    agree([found[f"a.{name}_{axis}"] for name in "vw" for axis in "xyz"], np.zeros(6), 1e-9, 1)


@checks("SpatialBody")
def test_newton_and_euler_for_a_body() -> None:
    J = np.array([[2, 0.1, -0.2], [0.1, 3, 0.3], [-0.2, 0.3, 4]])
    law = part("SpatialBody", m="5 kg", J_x="2 kg*m**2", J_y="3 kg*m**2", J_z="4 kg*m**2", J_xy="0.1 kg*m**2",
               J_xz="-0.2 kg*m**2", J_yz="0.3 kg*m**2", l_x="0.3 m", l_y="-0.2 m", l_z="0.1 m")
    rates = {f"der({name})": value for name, value in {**members("a", "v", ACCEL), **members("a", "w", ALPHA)}.items()}
    found = law({**frame_a(), **rates})
    arm = TURN.apply([0.3, -0.2, 0.1])
    force = 5*(ACCEL + np.cross(ALPHA, arm) + np.cross(w_A, np.cross(w_A, arm)) + UP)
    world = np.array([R @ J @ R.T for R in TURN.as_matrix()])
    momentum = np.einsum("nij,nj->ni", world, w_A)
    moment = np.einsum("nij,nj->ni", world, ALPHA) + np.cross(w_A, momentum) + np.cross(arm, force)
    agree(vector(found, "a", "F"), force)
    agree(vector(found, "a", "M"), moment, 1e-9, 1)


@checks("SpatialPointMass")
def test_newton_for_a_point_mass() -> None:
    found = part("SpatialPointMass", m="5 kg")({f"der({name})": value for name, value in members("a", "v", ACCEL).items()})
    agree(vector(found, "a", "F"), 5*(ACCEL + UP))
    agree(vector(found, "a", "M"), 0*ACCEL)


@checks("SpatialLink")
def test_a_link() -> None:
    found = part("SpatialLink", l_x="0.3 m", l_y="-0.2 m", l_z="0.1 m", roll="0.1 rad", pitch="0.2 rad", yaw="0.3 rad")(
        {**frame_a(), **LOAD})
    zero = 0*r_A
    relates(found, Rotation.from_euler("ZYX", [0.3, 0.2, 0.1]), zero, zero + np.array([0.3, -0.2, 0.1]), zero)
    balances(found)


@checks("SpatialRevoluteJoint")
def test_a_hinge() -> None:
    found = part("SpatialRevoluteJoint", n=n)({**frame_a(), **LOAD, "d.phi": PHI, "d.w": RATE})
    relates(found, Rotation.from_rotvec(np.outer(PHI, AXIS)), np.outer(RATE, AXIS), 0*r_A, 0*r_A)
    balances(found)
    agree(found["d.tau"], -np.sum(TURN.apply(AXIS)*M_B, axis=1))


@checks("SpatialPrismaticJoint")
def test_a_guide() -> None:
    found = part("SpatialPrismaticJoint", n=n)({**frame_a(), **LOAD, "d.x": PHI, "d.v": RATE})
    relates(found, Rotation.identity(N), 0*r_A, np.outer(PHI, AXIS), np.outer(RATE, AXIS))
    balances(found)
    agree(found["d.f"], -np.sum(TURN.apply(AXIS)*F_B, axis=1))


@checks("CylindricalJoint")
def test_a_sleeve() -> None:
    s, v = _random.normal(size=(2, N))
    found = part("CylindricalJoint", n=n)({**frame_a(), **LOAD, "d.phi": PHI, "d.w": RATE, "e.x": s, "e.v": v})
    relates(found, Rotation.from_rotvec(np.outer(PHI, AXIS)), np.outer(RATE, AXIS), np.outer(s, AXIS), np.outer(v, AXIS))
    balances(found)
    agree(found["d.tau"], -np.sum(TURN.apply(AXIS)*M_B, axis=1))
    agree(found["e.f"], -np.sum(TURN.apply(AXIS)*F_B, axis=1))


@checks("ScrewJoint")
def test_a_screw() -> None:
    found = part("ScrewJoint", n=n, h="0.2 m")({**frame_a(), **LOAD, "d.phi": PHI, "d.w": RATE})
    per = 0.2/(2*np.pi)
    relates(found, Rotation.from_rotvec(np.outer(PHI, AXIS)), np.outer(RATE, AXIS), np.outer(per*PHI, AXIS),
            np.outer(per*RATE, AXIS))
    balances(found)
    agree(found["d.tau"], -np.sum(TURN.apply(AXIS)*(M_B + per*F_B), axis=1))


@checks("UniversalJoint")
def test_a_cardan_joint() -> None:
    psi, o = _random.normal(size=(2, N))
    found = part("UniversalJoint", n_a=n, n_b="[0, 1, 0]")(
        {**frame_a(), **LOAD, "d.phi": PHI, "d.w": RATE, "e.phi": psi, "e.w": o})
    first, y = Rotation.from_rotvec(np.outer(PHI, AXIS)), np.array([0.0, 1, 0])
    relates(found, first*Rotation.from_rotvec(np.outer(psi, y)), np.outer(RATE, AXIS) + o[:, None]*first.apply(y),
            0*r_A, 0*r_A)
    balances(found)
    agree(found["d.tau"], -np.sum(TURN.apply(AXIS)*M_B, axis=1))
    agree(found["e.tau"], -np.sum((TURN*first).apply(y)*M_B, axis=1))


@checks("SphericalJoint")
def test_a_ball_joint() -> None:
    found = part("SphericalJoint")({**members("a", "", r_A), **members("a", "v", v_A), **members("b", "F", F_B)})
    agree(vector(found, "b", ""), r_A)
    agree(vector(found, "a", "F"), -F_B)
    agree(vector(found, "a", "M"), 0*F_B)
    agree(vector(found, "b", "M"), 0*F_B)


@checks("OrientationSource")
def test_a_driven_ball_joint() -> None:
    """The quaternion may have any length; its sign has no effect. The positions are free. With a constant signal, b turns
    with the angular velocity of a."""
    turn = Rotation.random(N, random_state=5)
    x, y, z, w = (-3*turn.as_quat()).T
    found = part("OrientationSource")({
        **seen_a(), **elements("q", np.stack([w, x, y, z], 1)), **members("b", "", F_B), **members("b", "v", ALPHA),
        **members("b", "M", M_B), **{f"der(q[{k}])": 0*PHI for k in (1, 2, 3, 4)}})
    agree((quaternion(found, "b")*(TURN*turn).inv()).magnitude(), 0*PHI, 1e-7, 1)
    agree(vector(found, "b", "w"), w_A, 1e-9, 1)
    agree(vector(found, "a", "M"), -M_B)
    for port in "ab":
        agree(vector(found, port, "F"), 0*F_B)


@checks("BallDrive")
def test_drives_of_a_ball_joint() -> None:
    spin, torques = TURN.inv().apply(ALPHA - w_A), np.random.default_rng(9).normal(size=(N, 3))
    found = part("BallDrive")({**frame_a(), **members("b", "w", ALPHA), **members("b", "", r_A), **members("b", "v", v_A),
                               **{f"{axis}.tau": torques[:, k] for k, axis in enumerate("xyz")}})
    agree(np.stack([found[f"{axis}.w"] for axis in "xyz"], -1), spin, 1e-9, 1)
    agree(vector(found, "b", "M"), -TURN.apply(torques), 1e-9, 1)
    agree(vector(found, "a", "M"), TURN.apply(torques), 1e-9, 1)


@checks("PlaneJoint")
def test_a_plane() -> None:
    s, t, u, v = _random.normal(size=(4, N))
    zero = 0*s
    found = part("PlaneJoint")({**frame_a(), **LOAD, "d.phi": PHI, "d.w": RATE, "e.x": s, "e.v": u, "f.x": t, "f.v": v})
    relates(found, Rotation.from_rotvec(np.outer(PHI, [0, 0, 1])), np.stack([zero, zero, RATE], 1),
            np.stack([s, t, zero], 1), np.stack([u, v, zero], 1))
    balances(found)
    x, y, z = (TURN.apply(axis) for axis in np.eye(3))
    agree(found["d.tau"], -np.sum(z*M_B, axis=1))
    agree(found["e.f"], -np.sum(x*F_B, axis=1))
    agree(found["f.f"], -np.sum(y*F_B, axis=1))


@checks("CardanJoint")
def test_six_motions() -> None:
    s, u, angles, rates = _random.normal(size=(4, N, 3))
    given = {f"{name}.{member}": values[:, k] for names, members_, groups in (
        (("surge", "sway", "heave"), "xv", (s, u)), (("roll", "pitch", "yaw"), ("phi", "w"), (angles, rates)))
        for k, name in enumerate(names) for member, values in zip(members_, groups, strict=True)}
    found = part("CardanJoint")({**frame_a(), **LOAD, **given})
    turn = Rotation.from_euler("ZYX", angles[:, ::-1])
    # the angular velocity by a difference of rotations over 2e-6 s, which is exact to 1e-9
    later, before = (Rotation.from_euler("ZYX", (angles + h*rates)[:, ::-1]) for h in (1e-6, -1e-6))
    spin = (later*before.inv()).as_rotvec()/2e-6
    agree((quaternion(found, "b")*(TURN*turn).inv()).magnitude(), 0*r_A[:, 0], 1e-7, 1)
    agree(vector(found, "b", "w"), w_A + TURN.apply(spin), 1e-8, 1)
    agree(vector(found, "b", ""), r_A + TURN.apply(s))
    agree(vector(found, "b", "v"), v_A + np.cross(w_A, TURN.apply(s)) + TURN.apply(u))
    balances(found)
    # virtual work of each motion
    axes = np.zeros((3, N, 3))
    for k in range(3):
        step = np.zeros((N, 3))
        step[:, k] = 1e-6
        ahead, behind = (Rotation.from_euler("ZYX", (angles + sign*step)[:, ::-1]) for sign in (1, -1))
        axes[k] = TURN.apply((ahead*behind.inv()).as_rotvec()/2e-6)
    for name, axis in zip(("roll", "pitch", "yaw"), axes, strict=True):
        agree(found[f"{name}.tau"], -np.sum(axis*M_B, axis=1), 1e-7, 1)
    for name, axis in zip(("surge", "sway", "heave"), np.eye(3), strict=True):
        agree(found[f"{name}.f"], -np.sum(TURN.apply(axis)*F_B, axis=1))


r_B, v_B = r_A + _random.normal(size=(N, 3)), _random.normal(size=(N, 3))
POINTS = {**members("a", "", r_A), **members("a", "v", v_A), **members("b", "", r_B), **members("b", "v", v_B)}
LENGTH = np.linalg.norm(r_B - r_A, axis=1)
LINE = (r_B - r_A)/LENGTH[:, None]
STRETCH = np.sum((v_B - v_A)*LINE, axis=1)


def along(found: Found, tension: Array) -> None:
    agree(vector(found, "b", "F"), tension[:, None]*LINE)
    agree(vector(found, "a", "F"), -tension[:, None]*LINE)
    for port in "ab":
        agree(vector(found, port, "M"), 0*LINE)


@checks("SpatialSpring")
def test_a_spring() -> None:
    along(part("SpatialSpring", c="900 N/m", d="30 N*s/m", l0="1.2 m")(POINTS), 900*(LENGTH - 1.2) + 30*STRETCH)


@checks("SpatialRope")
def test_a_rope() -> None:
    found = part("SpatialRope", c="900 N/m", d="30 N*s/m", l0="1.2 m", e_t="1 cm")({**POINTS, "w.x": 0.1, "w.v": 0.2})
    e = np.maximum(LENGTH - 1.3, 0)
    assert np.any(e > 0)
    tension = np.maximum(900*e + 30*(STRETCH - 0.2)*np.minimum(e/0.01, 1), 0)
    along(found, tension)
    agree(found["w.f"], -tension)


@checks("SpatialRod")
def test_a_rod() -> None:
    """The x coordinate of b follows from the length."""
    line = np.abs(LINE)
    end = r_A + 4*line
    found = part("SpatialRod", l="4 m")({**members("a", "", r_A), "b.y": end[:, 1], "b.z": end[:, 2], "F": PHI},
                                        {"b.x": 20.0})
    agree(found["b.x"], end[:, 0])
    agree(vector(found, "b", "F"), PHI[:, None]*line)
    agree(vector(found, "a", "F"), -PHI[:, None]*line)
    for port in "ab":
        agree(vector(found, port, "M"), 0*line)


@checks("SpatialStrut")
def test_a_strut() -> None:
    found = part("SpatialStrut")({**POINTS, "h.x": 0.3, "h.v": 0.1, "r.f": PHI})
    along(found, -PHI)
    agree(found["r.x"], 0.3 + LENGTH)
    agree(found["h.f"], -PHI)


@checks("SpatialStrutMass")
def test_masses_on_a_line() -> None:
    """Newton's and Euler's laws of both bodies, with the second rate of the direction by a difference of second order."""
    accel = {"a": ACCEL, "b": ALPHA}
    rates = {name: value for port in "ab" for name, value in members(f"der({port}", "v", accel[port]).items()}
    found = part("SpatialStrutMass", m_a="6 kg", m_b="3 kg", l_a="0.5 m", l_b="0.4 m", J_a="0.4 kg*m**2", J_b="0.2 kg*m**2")(
        {**POINTS, **{f"{name})": value for name, value in rates.items()}})
    h = 1e-4
    early, late = (line/np.linalg.norm(line, axis=1)[:, None] for line in (
        r_B - r_A + t*(v_B - v_A) + t**2/2*(ALPHA - ACCEL) for t in (-h, h)))
    turns = (early - 2*LINE + late)/h**2
    barrel, rod = 6*(ACCEL + 0.5*turns + UP), 3*(ALPHA - 0.4*turns + UP)
    F_a, F_b = (vector(found, port, "F") for port in "ab")
    agree(F_a + F_b, barrel + rod, 1e-6, 100)
    agree(np.sum(F_a*LINE, axis=1), np.sum(barrel*LINE, axis=1), 1e-6, 100)
    about_a = np.cross(0.5*LINE, barrel) + np.cross(r_B - r_A - 0.4*LINE, rod) + np.cross(LINE, 0.6*turns)
    agree(np.cross(r_B - r_A, F_b), about_a, 1e-6, 100)
    for port in "ab":
        agree(vector(found, port, "M"), 0*LINE)


@pytest.mark.parametrize("body", [0, 1])
def test_a_force(body: int) -> None:
    _force(body)


@checks("SpatialForce")
def _force(body: int) -> None:
    # along the axes of the fixed frame, no law depends on the orientation
    frame = {name: values for name, values in frame_a().items() if body or not name.startswith("a_rotation.")}
    found = part("SpatialForce", body=body)({**frame, **elements("F", F_B), **elements("M", M_B)})
    turn = TURN if body else Rotation.identity(N)
    agree(vector(found, "a", "F"), -turn.apply(F_B))
    agree(vector(found, "a", "M"), -turn.apply(M_B))


@checks("SpatialPositionSource")
def test_a_prescribed_frame() -> None:
    place, angles = _random.normal(size=(2, N, 3))
    found = part("SpatialPositionSource")({**elements("x", place), **elements("phi", angles)})
    agree(vector(found, "a", ""), place)
    agree((quaternion(found, "a")*Rotation.from_euler("ZYX", angles[:, ::-1]).inv()).magnitude(), 0*PHI, 1e-7, 1)


@checks("SpatialSensor")
def test_position_and_angles() -> None:
    found = part("SpatialSensor")(seen_a())
    yaw, pitch, roll = TURN.as_euler("ZYX").T
    for name, expected in {"x": r_A[:, 0], "y": r_A[:, 1], "z": r_A[:, 2], "roll": roll, "pitch": pitch, "yaw": yaw}.items():
        agree(found[name], expected)
    agree(vector(found, "a", "F"), 0*r_A)
    agree(vector(found, "a", "M"), 0*r_A)


@checks("SpatialMotionSensor")
def test_an_inertial_measurement_unit() -> None:
    rates = {f"der({name})": value for name, value in members("a", "v", ACCEL).items()}
    found = part("SpatialMotionSensor")({**seen_a(), **rates})
    for name, expected in {"v": v_A, "w": w_A, "b": ACCEL + UP}.items():
        agree(np.stack([found[f"{name}[{k}]"] for k in (1, 2, 3)], -1), TURN.inv().apply(expected))


@checks("SpatialRelativeSensor")
def test_a_frame_seen_from_another() -> None:
    other = Rotation.random(N, random_state=4)
    x, y, z, w = other.as_quat().T
    w_B = ALPHA
    seen_b = {"b.q_0": w, "b.q_1": x, "b.q_2": y, "b.q_3": z, **members("b", "w", w_B), **members("b", "", r_B),
              **members("b", "v", v_B)}
    found = part("SpatialRelativeSensor")({**seen_a(), **seen_b})
    yaw, pitch, roll = (TURN.inv()*other).as_euler("ZYX").T
    agree(np.stack([found["roll"], found["pitch"], found["yaw"]], -1), np.stack([roll, pitch, yaw], -1))
    h = 1e-6  # the rates by central differences, which are exact to 1e-9
    later, before = ((Rotation.from_rotvec(t*w_A)*TURN).inv().apply(r_B + t*v_B - r_A - t*v_A) for t in (h, -h))
    for name, expected, small in (("r", TURN.inv().apply(r_B - r_A), 1e-9), ("v", (later - before)/(2*h), 1e-7),
                                  ("w", TURN.inv().apply(w_B - w_A), 1e-9)):
        agree(np.stack([found[f"{name}[{k}]"] for k in (1, 2, 3)], -1), expected, small, 1)
    for port in "ab":
        agree(vector(found, port, "F"), 0*r_A)
        agree(vector(found, port, "M"), 0*r_A)


@checks("SpatialDistanceSensor")
def test_a_distance() -> None:
    agree(part("SpatialDistanceSensor")(POINTS)["y"], LENGTH)


@checks("SpatialForceSensor")
def test_a_load_cell() -> None:
    found = part("SpatialForceSensor")({**frame_a(), **LOAD})
    relates(found, Rotation.identity(N), 0*r_A, 0*r_A, 0*r_A)
    balances(found)
    for name, expected in {"F": F_B, "M": M_B}.items():
        agree(np.stack([found[f"{name}[{k}]"] for k in (1, 2, 3)], -1), -TURN.inv().apply(expected))


@checks("SpatialFree")
def test_the_rate_of_a_quaternion() -> None:
    """ds/dt = w s/2 in the fixed frame, and the decay of an error of the norm."""
    x, y, z, w = TURN.as_quat().T*1.1
    found = part("SpatialFree", k="2 1/s")({"s_0": w, "s_1": x, "s_2": y, "s_3": z, **elements("w", w_A)})
    real = -np.sum(w_A*np.stack([x, y, z], 1), axis=1)/2
    imaginary = (w[:, None]*w_A + np.cross(w_A, np.stack([x, y, z], 1)))/2
    decay = 2/2*(1 - 1.1**2)
    agree(found["der(s_0)"], real + decay*w, 1e-9, 1)
    agree(np.stack([found[f"der(s_{k})"] for k in (1, 2, 3)], -1), imaginary + decay*np.stack([x, y, z], 1), 1e-9, 1)
    agree((quaternion(found, "a")*TURN.inv()).magnitude(), 0*PHI, 1e-7, 1)
    agree(vector(found, "a", "w"), w_A)


@checks("SpatialMinimal")
def test_the_rate_of_rodrigues_parameters() -> None:
    """By a difference of rotations over 2e-6 s, which is exact to 1e-9."""
    c = np.tan(TURN.magnitude()/4)[:, None]*TURN.as_rotvec()/TURN.magnitude()[:, None]
    found = part("SpatialMinimal")({**elements("c", c), **elements("w", w_A)})

    def parameters(time: float) -> Array:
        turned = Rotation.from_rotvec(time*w_A)*TURN
        angle = turned.magnitude()[:, None]
        return np.tan(angle/4)*turned.as_rotvec()/angle

    rates = np.stack([found[f"der(c[{k}])"] for k in (1, 2, 3)], -1)
    agree(rates, (parameters(1e-6) - parameters(-1e-6))/2e-6, 1e-7, 1)
    agree((quaternion(found, "a")*TURN.inv()).magnitude(), 0*PHI, 1e-7, 1)


def test_a_dumbbell_turns_about_its_centre() -> None:
    """Two point masses on a link without mass have an orientation, though no law of a part contains it."""
    found = run("""model: dumbbell
components:
  left:  {is: SpatialPointMass, m: 1 kg, g: 0 m/s**2}
  link:  {is: SpatialLink, l_x: 2 m}
  tip:   {is: SpatialBody, m: 1 kg, J_x: 1e-3 kg*m**2, J_y: 1e-3 kg*m**2, J_z: 1e-3 kg*m**2, g: 0 m/s**2}
nodes: {left: [left.a, link.a], right: [link.b, tip.a]}
initial: {left.v_y: -1 m/s, left.w_z: 1 rad/s}
show: {x: {is: right.x - left.x, unit: m}}
simulate: {until: 3 s}
""")
    assert found["x"] == pytest.approx(2*np.cos(found.time), abs=1e-5)


@checks("SpatialIdle")
def test_a_held_orientation() -> None:
    found = part("SpatialIdle")({})
    agree([found[f"a.q_{k}"] for k in range(4)], [1, 0, 0, 0])
    agree([found[f"a.F_{axis}"] for axis in "xyz"], [0, 0, 0])


# -- contact and rolling -----------------------------------------------------------------------------------------------
w_B = _random.normal(size=(N, 3))
NORMAL = TURN.apply([0, 0, 1])
TURN_B = Rotation.random(N, random_state=8)


def free(port: str, turn: Rotation, spin: Array) -> dict[str, Array]:
    """Orientation and angular velocity of a port whose node turns freely."""
    x, y, z, w = turn.as_quat().T
    return {f"{port}_rotation.s_0": w, f"{port}_rotation.s_1": x, f"{port}_rotation.s_2": y, f"{port}_rotation.s_3": z,
            **elements(f"{port}_rotation.w", spin)}


TOUCHING = {**frame_a(), **members("b", "v", v_B), **free("b", TURN_B, w_B)}


def touches(found: Found, normal: Array, arm_b: Array, place: Array, spring: Array, mu: float) -> None:
    """Normal force and friction of a contact: `arm_b` from the centre of b to the point of contact, `place` its position."""
    slip = v_B + np.cross(w_B, arm_b) - v_A - np.cross(w_A, place - r_A)
    inwards = -np.sum(slip*normal, axis=1)
    slip = slip + inwards[:, None]*normal
    press = np.maximum(spring*(1 + 0.05*inwards), 0)
    assert np.any(press > 0)
    force = press[:, None]*(normal - mu*slip/np.sqrt(np.sum(slip**2, axis=1) + 0.02**2)[:, None])  # on b
    agree(vector(found, "b", "F"), -force, 1e-9, 1)
    agree(vector(found, "b", "M"), -np.cross(arm_b, force), 1e-9, 1)
    agree(vector(found, "a", "F"), force, 1e-9, 1)
    agree(vector(found, "a", "M"), np.cross(place - r_A, force), 1e-9, 1)


@checks("SpherePlaneContact")
def test_a_sphere_on_a_plane() -> None:
    place = r_A + TURN.apply(np.stack([PHI, RATE, 0.2 + 0.01*np.arange(N)], 1))
    law = part("SpherePlaneContact", r="0.23 m", c="9 kN/m", p="1.5", e_0="5 mm", chi="0.05 s/m", mu="0.3", v_t="0.02 m/s")
    found = law({**TOUCHING, **members("b", "", place)})
    depth = np.maximum(0.03 - 0.01*np.arange(N), 0)
    touches(found, NORMAL, -0.23*NORMAL, place - 0.23*NORMAL, 9e3*5e-3*(depth/5e-3)**1.5, 0.3)


@checks("SphereContact")
def test_two_spheres() -> None:
    found = part("SphereContact", r_a="0.5 m", r_b="3 m", c="9 kN/m", p="1.5", e_0="5 mm", chi="0.05 s/m", mu="0.3",
                 v_t="0.02 m/s")({**TOUCHING, **members("b", "", r_B)})
    depth = np.maximum(3.5 - LENGTH, 0)
    touches(found, LINE, -(LENGTH - 0.5)[:, None]*LINE, r_A + 0.5*LINE, 9e3*5e-3*(depth/5e-3)**1.5, 0.3)


@checks("RollingSphere")
def test_the_forces_of_a_rolling_sphere() -> None:
    """The reaction acts at the point of contact; that it does not slip is shown by the examples."""
    place = r_A + TURN.apply(np.stack([PHI, RATE, 0.3 + 0*PHI], 1))
    found = part("RollingSphere", r="0.3 m")({**TOUCHING, **members("b", "", place), "N": PHI, **elements("T", F_B[:, :2])})
    _reacts(found, -0.3*NORMAL, place)


@checks("RollingDisc")
def test_the_forces_of_a_rolling_disc() -> None:
    axle = TURN_B.apply(AXIS)
    cosine = np.sqrt(1 - np.sum(axle*NORMAL, axis=1)**2)
    arm = -0.3/cosine[:, None]*(NORMAL - np.sum(axle*NORMAL, axis=1)[:, None]*axle)
    place = r_A + TURN.apply(np.stack([PHI, RATE, 0.3*cosine], 1))
    found = part("RollingDisc", r="0.3 m", n=n)({**TOUCHING, **members("b", "", place), "N": PHI,
                                                 **elements("T", F_B[:, :2])})
    _reacts(found, arm, place)


def _reacts(found: Found, arm: Array, place: Array) -> None:
    force = PHI[:, None]*NORMAL + TURN.apply(np.stack([F_B[:, 0], F_B[:, 1], 0*PHI], 1))  # on b
    agree(vector(found, "b", "F"), -force, 1e-9, 1)
    agree(vector(found, "b", "M"), -np.cross(arm, force), 1e-9, 1)
    agree(vector(found, "a", "F"), force, 1e-9, 1)
    agree(vector(found, "a", "M"), np.cross(place + arm - r_A, force), 1e-9, 1)
    slip = v_B + np.cross(w_B, arm) - v_A - np.cross(w_A, place + arm - r_A)
    agree(np.stack([found[f"u[{k}]"] for k in (1, 2, 3)], -1), slip, 1e-9, 1)


# -- water, elastic bearings, planes -----------------------------------------------------------------------------------
@checks("FloatingHull")
def test_buoyancy_and_stiffness_of_a_hull() -> None:
    """The moment is the negative gradient of the energy, by a difference of rotations about the fixed axes."""
    found = part("FloatingHull", V="3 m**3", A_w="2 m**2", I_x="0.7 m**4", I_y="2.5 m**4", z_B="-0.4 m", z_w="0.3 m")(
        frame_a())
    weight = 1025*G
    agree(vector(found, "a", "F")[:, 2], -weight*(3 - 2*(r_A[:, 2] - 0.3)))

    def energy(turn: Rotation) -> Array:
        up = turn.inv().apply([0, 0, 1])
        return weight*((0.7 - 1.2)*up[:, 1]**2 + (2.5 - 1.2)*up[:, 0]**2)/2

    slope = np.stack([(energy(Rotation.from_rotvec(h)*TURN) - energy(Rotation.from_rotvec(-h)*TURN))/2e-6
                      for h in 1e-6*np.eye(3)], 1)
    agree(vector(found, "a", "M"), slope, 1e-4, 1)


@checks("AddedMass")
def test_kirchhoffs_equations() -> None:
    M = np.array([[5, 1, 0], [1, 6, 2], [0, 2, 7]])
    J = np.array([[3, 0.5, 0], [0.5, 4, 0.2], [0, 0.2, 5]])
    C = np.array([[0.1, 0.2, 0.3], [-0.4, 0.5, 0], [0.6, 0, -0.7]])
    written = {name: "[" + ", ".join("[" + ", ".join(f"{float(x)!r} {unit}" for x in row) + "]" for row in matrix) + "]"
               for name, matrix, unit in (("A", M, "kg"), ("A_r", J, "kg*m**2"), ("A_c", C, "kg*m"))}
    rates = {f"der({name})": value for name, value in {**members("a", "v", ACCEL), **members("a", "w", ALPHA)}.items()}
    found = part("AddedMass", **written)({**frame_a(), **rates})
    back = TURN.inv()
    v, w, c = back.apply(v_A), back.apply(w_A), back.apply(ALPHA)
    b = back.apply(ACCEL) - np.cross(w, v)
    p, L = v @ M.T + w @ C.T, v @ C + w @ J.T
    agree(vector(found, "a", "F"), TURN.apply(b @ M.T + c @ C.T + np.cross(w, p)), 1e-9, 1)
    agree(vector(found, "a", "M"), TURN.apply(b @ C + c @ J.T + np.cross(w, L) + np.cross(v, p)), 1e-9, 1)


@checks("HullDamping")
def test_resistance_of_water() -> None:
    units = {"d": "N*s/m", "d_r": "N*m*s/rad", "k": "N*s**2/m**2", "k_r": "N*m*s**2/rad**2"}
    found = part("HullDamping", **{name: f"[2 {unit}, 3 {unit}, 4 {unit}]" for name, unit in units.items()})(
        {**frame_a(), **elements("u", F_B)})
    d, v, w = np.array([2.0, 3, 4]), TURN.inv().apply(v_A - F_B), TURN.inv().apply(w_A)
    agree(vector(found, "a", "F"), TURN.apply(d*(v + np.abs(v)*v)), 1e-9, 1)
    agree(vector(found, "a", "M"), TURN.apply(d*(w + np.abs(w)*w)), 1e-9, 1)


@checks("SpatialBushing")
def test_an_elastic_bearing() -> None:
    lists = {"c": ("N/m", 100), "c_r": ("N*m/rad", 10), "d": ("N*s/m", 5), "d_r": ("N*m*s/rad", 1)}
    given = {name: f"[{size} {unit}, {2*size} {unit}, {3*size} {unit}]" for name, (unit, size) in lists.items()}
    found = part("SpatialBushing", **given)({**TOUCHING, **members("b", "", r_B)})
    back, ratio = TURN.inv(), np.array([1.0, 2, 3])
    s = back.apply(r_B - r_A)
    u = back.apply(v_B - v_A - np.cross(w_A, r_B - r_A))
    quaternion_ = (back*TURN_B).as_quat()
    half, vector_part = quaternion_[:, 3:], quaternion_[:, :3]
    moment = 2*(half*10*ratio*vector_part + np.cross(vector_part, 10*ratio*vector_part)) + ratio*back.apply(w_B - w_A)
    agree(vector(found, "b", "F"), TURN.apply(ratio*(100*s + 5*u)), 1e-9, 1)
    agree(vector(found, "b", "M"), TURN.apply(moment), 1e-9, 1)
    balances(found)


@checks("PlaneInSpace")
def test_a_plane_in_space() -> None:
    found = part("PlaneInSpace", x_0="1 m", y_0="2 m", z_0="3 m", yaw="0.4 rad")(
        {"a.x": PHI, "a.y": RATE, "a.phi": 2*PHI, "a.v_x": RATE, "a.v_y": PHI, "a.w": RATE, **LOAD})
    along_, across = np.array([np.cos(0.4), np.sin(0.4), 0]), np.array([-np.sin(0.4), np.cos(0.4), 0])
    agree(vector(found, "b", ""), np.array([1, 2, 3]) + np.outer(PHI, along_) + np.outer(RATE, [0, 0, 1]))
    agree(vector(found, "b", "v"), np.outer(RATE, along_) + np.outer(PHI, [0, 0, 1]), 1e-9, 1)
    agree(vector(found, "b", "w"), np.outer(-RATE, across), 1e-9, 1)
    turn = Rotation.from_rotvec(np.outer(2*PHI, -across))*Rotation.from_euler("Z", 0.4)
    agree((quaternion(found, "b")*turn.inv()).magnitude(), 0*PHI, 1e-7, 1)
    agree(found["a.F_x"], -F_B @ along_)
    agree(found["a.F_y"], -F_B[:, 2])
    agree(found["a.M"], M_B @ across)
    agree(found["Q"], F_B @ across)


@checks("BallFriction")
def test_friction_of_a_ball() -> None:
    found = part("BallFriction", M_c="0.3 N*m", d="0.1 N*m*s/rad", w_t="0.2 rad/s")({
        **members("a", "w", w_A), **members("b", "w", ALPHA)})
    w = ALPHA - w_A
    moment = w*(0.3/np.sqrt(np.sum(w**2, axis=1) + 0.04) + 0.1)[:, None]
    agree(vector(found, "b", "M"), moment)
    agree(vector(found, "a", "M"), -moment)


@checks("PlaneOnBody")
def test_a_plane_on_a_body() -> None:
    base = {re.sub("^a(?=[._])", "base", name): value for name, value in frame_a().items()}
    found = part("PlaneOnBody")({**base, "a.x": PHI, "a.y": RATE, "a.phi": 2*PHI, "a.v_x": RATE, "a.v_y": PHI, "a.w": RATE,
                                 **LOAD})
    zero = 0*PHI
    relates(found, Rotation.from_rotvec(np.outer(2*PHI, [0, -1, 0])), np.outer(RATE, [0, -1, 0]),
            np.stack([PHI, zero, RATE], 1), np.stack([RATE, zero, PHI], 1))
    balances({**found, **{name.replace("base.", "a."): value for name, value in found.items() if name.startswith("base.")}})
    x, y, z = (TURN.apply(axis) for axis in np.eye(3))
    agree(found["a.F_x"], -np.sum(x*F_B, axis=1))
    agree(found["a.F_y"], -np.sum(z*F_B, axis=1))
    agree(found["a.M"], np.sum(y*M_B, axis=1))
    agree(found["Q"], np.sum(y*F_B, axis=1))


@checks("ElasticBeam")
def test_a_beam_by_integration_over_its_length() -> None:
    """The acceleration of each point by the kinematics of a moving frame; forces, moments and the equations of the modes by
    Gauss-Legendre quadrature, which is exact for the polynomials."""
    L, m, EI, t_d = 2.0, 5.0, np.array([30.0, 40.0]), 0.01  # EI for deflections along y and z
    state = {name: 0.1*_random.normal(size=(N, 2)) for name in "yzuo"}
    rates = {f"der({name})": value for name, value in {**members("a", "v", ACCEL), **members("a", "w", ALPHA)}.items()}
    given = {f"{name}[{k + 1}]": state[name][:, k] for name in "yzuo" for k in range(2)}
    found = part("ElasticBeam", n="2", L="2 m", m="5 kg", EI_y="40 N*m**2", EI_z="30 N*m**2", t_d="10 ms")(
        {**frame_a(), **rates, **given, **LOAD})
    second = [np.stack([found[f"der({name}[{k}])"] for k in (1, 2)], 1) for name in "uo"]
    back = TURN.inv()
    A, B, W, f, t = (back.apply(value) for value in (ACCEL + UP, ALPHA, w_A, F_B, M_B))
    x, weight = np.polynomial.legendre.leggauss(8)
    x, weight = (x + 1)/2, weight/2*m
    modes, powers = np.stack([x**2, x**3]), np.array([2.0, 3.0])

    def bent(first: Array, other: Array, along_x: Array | float = 0.0) -> Array:
        return np.stack([np.broadcast_to(along_x, (N, 8)), first @ modes, other @ modes], -1)

    r, v, a = bent(state["y"], state["z"], L*x), bent(state["u"], state["o"]), bent(*second)
    spin = W[:, None, :]
    acceleration = (A[:, None, :] + np.cross(B[:, None, :], r) + np.cross(spin, np.cross(spin, r)) + 2*np.cross(spin, v) + a)
    tip = np.stack([np.full(N, L), state["y"].sum(1), state["z"].sum(1)], 1)
    force = np.einsum("k,nkc->nc", weight, acceleration)
    moment = np.einsum("k,nkc->nc", weight, np.cross(r, acceleration))
    agree(vector(found, "a", "F"), TURN.apply(force - f), 1e-9, 1)
    agree(vector(found, "a", "M"), TURN.apply(moment - t - np.cross(tip, f)), 1e-9, 1)
    bending = np.array([[4.0, 6], [6, 12]])/L**3  # integrals of the products of the curvatures
    slope = state["y"] @ powers/L
    about = (t[:, 2], -(t[:, 1]*np.cos(slope) - t[:, 0]*np.sin(slope)))
    for axis, (deflection, rate) in enumerate((("y", "u"), ("z", "o"))):
        inertia = np.einsum("k,nk,ik->ni", weight, acceleration[:, :, axis + 1], modes)
        elastic = EI[axis]*(state[deflection] + t_d*state[rate]) @ bending
        agree(inertia + elastic, f[:, axis + 1, None] + about[axis][:, None]*powers/L, 1e-9, 1)
    shift = np.stack([np.full(N, L), state["y"].sum(1), state["z"].sum(1)], 1)
    agree(vector(found, "b", ""), r_A + TURN.apply(shift), 1e-9, 1)


def test_frequencies_of_a_cantilever() -> None:
    """cos(b) cosh(b) = -1: 3.516 and 22.03 times sqrt(E I/(m L**3))."""
    modes = hb.modes(hb.loads("""model: cantilever
components:
  wall: {is: SpatialFixed}
  beam: {is: ElasticBeam, L: 6 m, m: 300 kg, EI_y: 4 MN*m**2, EI_z: 2 MN*m**2, g: 0 m/s**2}
nodes: {wall: [wall.a, beam.a], tip: [beam.b]}
initial: {start: steady}
"""))
    roots = np.array([1.8751040687, 4.6940911330])**2/(2*np.pi)
    found = np.sort(modes.frequencies)[:4].reshape(2, 2).T
    expected = np.outer(np.sqrt(np.array([2e6, 4e6])/(300*6**3)), roots)
    assert found == pytest.approx(expected, rel=1e-2)
    assert found[:, 0] == pytest.approx(expected[:, 0], rel=4e-4)


def test_a_disc_that_lies_flat_at_the_start_is_reported(tmp_path: Path) -> None:
    text = (Path(hb.__file__).parents[1] / "models/examples/rolling_disc.yaml").read_text(encoding="utf-8")
    (tmp_path / "flat.yaml").write_text(text.replace("0.4 rad", "90 deg"), encoding="utf-8")
    answer = CliRunner().invoke(main, ["check", str(tmp_path / "flat.yaml")])
    assert answer.exit_code == 1 and "the disc lies flat on the plane" in answer.stderr
