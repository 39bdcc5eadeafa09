"""Random trees of bodies in space: their diagram, and the same tree for Pinocchio and MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TreeBody:
    """A body on a joint: number of its parent (-1: the fixed frame), kind and axis of the joint, place and Cardan angles of
    the joint in the parent, mass, centre and inertia tensor, and the initial coordinate and speed."""

    parent: int
    turns: bool
    axis: Array
    shift: Array
    angles: Array
    m: float
    centre: Array
    J: Array
    q: float
    v: float


def aligned_tree(n: int, seed: int) -> list[TreeBody]:
    """A chain of n bodies on hinges at rest, with axes and links along coordinate axes and angles of 0, as robots have."""
    random = np.random.default_rng(seed)
    axes = np.eye(3)
    return [TreeBody(k - 1, True, axes[random.integers(3)], axes[random.integers(3)]*random.uniform(0.1, 1), np.zeros(3),
                     random.uniform(1, 5), axes[random.integers(3)]*random.uniform(0, 0.5),
                     np.diag(random.uniform(0.1, 0.18, 3)), 0.0, 0.0) for k in range(n)]


def random_tree(n: int, seed: int) -> list[TreeBody]:
    """n bodies, three of four on hinges and the others on guides, each on a body before it."""
    random = np.random.default_rng(seed)
    bodies = []
    for k in range(n):
        axis, points = random.normal(size=3), random.normal(size=(6, 3))
        J = sum(point @ point * np.eye(3) - np.outer(point, point) for point in points)/6  # of six masses: it is physical
        bodies.append(TreeBody(int(random.integers(-1, k)) if k else -1, bool(random.random() < 0.75),
                               axis/np.linalg.norm(axis), random.uniform(-1, 1, 3), random.uniform(-1, 1, 3),
                               random.uniform(1, 5), random.uniform(-0.5, 0.5, 3), J, random.uniform(-1, 1),
                               random.uniform(-1, 1)))
    return bodies


def diagram(bodies: list[TreeBody], until: float = 1.0) -> str:
    """The diagram, whose outputs are q_k and a_k, coordinate and acceleration of joint k."""
    parts, initial, show = ["  world: {is: SpatialFixed}"], [], []
    nodes: dict[str, list[str]] = {"world": ["world.a"]}
    for k, b in enumerate(bodies):
        x, y, z = (repr(float(value)) for value in b.shift)
        roll, pitch, yaw = (repr(float(value)) for value in b.angles)
        parts.append(f"  link_{k}: {{is: SpatialLink, l_x: {x} m, l_y: {y} m, l_z: {z} m, roll: {roll} rad, "
                     f"pitch: {pitch} rad, yaw: {yaw} rad}}")
        parts.append(f"  joint_{k}: {{is: {'SpatialRevoluteJoint' if b.turns else 'SpatialPrismaticJoint'}, "
                     f"n: [{', '.join(repr(float(value)) for value in b.axis)}]}}")
        J = {name: repr(float(b.J[i])) for name, i in (("J_x", (0, 0)), ("J_y", (1, 1)), ("J_z", (2, 2)), ("J_xy", (0, 1)),
                                                       ("J_xz", (0, 2)), ("J_yz", (1, 2)))}
        parts.append(f"  body_{k}: {{is: SpatialBody, m: {b.m!r} kg, " + ", ".join(
            f"{name}: {value} kg*m**2" for name, value in J.items()) + "".join(
            f", l_{axis}: {float(value)!r} m" for axis, value in zip("xyz", b.centre, strict=True)) + "}")
        nodes["world" if b.parent < 0 else f"frame_{b.parent}"].append(f"link_{k}.a")
        nodes[f"base_{k}"], nodes[f"frame_{k}"] = [f"link_{k}.b", f"joint_{k}.a"], [f"joint_{k}.b", f"body_{k}.a"]
        nodes[f"drive_{k}"] = [f"joint_{k}.d"]
        position, speed, unit = ("phi", "w", "rad") if b.turns else ("s", "v", "m")
        initial += [f"joint_{k}.{position}: {b.q!r} {unit}", f"joint_{k}.{speed}: {b.v!r} {unit}/s"]
        show += [f"  q_{k}: {{is: joint_{k}.{position}, unit: {unit}}}",
                 f"  a_{k}: {{is: der(joint_{k}.{speed}), unit: {unit}/s**2}}"]
    joined = [f"  {name}: [{', '.join(ports)}]" for name, ports in nodes.items()]
    return "\n".join(["model: tree", "components:", *parts, "nodes:", *joined, f"initial: {{{', '.join(initial)}}}", "show:",
                      *show, f"simulate: {{until: {until} s, every: {until/100} s}}"]) + "\n"


class Pinocchio:
    """The tree in Pinocchio: accelerations by the articulated-body algorithm."""

    def __init__(self, bodies: list[TreeBody]):
        import pinocchio as pin

        self.pin, self.model = pin, pin.Model()
        self.model.gravity.linear = np.array([0, 0, -9.81])
        joints: list[int] = []
        for k, b in enumerate(bodies):
            joint = (pin.JointModelRevoluteUnaligned if b.turns else pin.JointModelPrismaticUnaligned)(b.axis)
            joints.append(self.model.addJoint(0 if b.parent < 0 else joints[b.parent], joint,
                                              pin.SE3(pin.rpy.rpyToMatrix(*b.angles), b.shift), f"joint_{k}"))
            self.model.appendBodyToJoint(joints[-1], pin.Inertia(b.m, b.centre, b.J), pin.SE3.Identity())
        self.data = self.model.createData()
        self.place = [self.model.idx_vs[joint] for joint in joints]

    def accelerations(self, q: Array, v: Array) -> Array:
        """In the order of the bodies, at coordinates and speeds in this order."""
        position, speed = np.zeros((2, self.model.nv))
        position[self.place], speed[self.place] = q, v
        return np.asarray(self.pin.aba(self.model, self.data, position, speed, np.zeros(self.model.nv))[self.place])


def mujoco_accelerations(bodies: list[TreeBody]) -> Array:
    """The accelerations at the start in MuJoCo, in the order of the bodies."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, -9.81]
    spec.compiler.autolimits, spec.compiler.degree = False, False
    made: list[Any] = []
    for k, b in enumerate(bodies):
        parent = spec.worldbody if b.parent < 0 else made[b.parent]
        half = b.angles/2
        (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
        turn = [cr*cp*cy + sr*sp*sy, sr*cp*cy - cr*sp*sy, cr*sp*cy + sr*cp*sy, cr*cp*sy - sr*sp*cy]
        body = parent.add_body(name=f"body_{k}", pos=b.shift, quat=turn)
        body.explicitinertial, body.mass, body.ipos = True, b.m, b.centre
        body.fullinertia = [b.J[0, 0], b.J[1, 1], b.J[2, 2], b.J[0, 1], b.J[0, 2], b.J[1, 2]]
        kind = mujoco.mjtJoint.mjJNT_HINGE if b.turns else mujoco.mjtJoint.mjJNT_SLIDE
        body.add_joint(name=f"joint_{k}", type=kind, axis=b.axis)
        made.append(body)
    model = spec.compile()
    data = mujoco.MjData(model)
    joints = [model.joint(f"joint_{k}") for k in range(len(bodies))]
    for joint, b in zip(joints, bodies, strict=True):
        data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = b.q, b.v
    mujoco.mj_forward(model, data)
    return np.array([data.qacc[joint.dofadr[0]] for joint in joints])
