"""Random trees of bodies in space: their diagram, and the same tree for Pinocchio and MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
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
        self.joints, self.place = joints, [self.model.idx_vs[joint] for joint in joints]
        self.q = np.zeros(self.model.nq)
        self.q[self.place] = [b.q for b in bodies]

    def accelerations(self, q: Array, v: Array) -> Array:
        """In the order of the bodies, at coordinates and speeds in this order."""
        position, speed = np.zeros((2, self.model.nv))
        position[self.place], speed[self.place] = q, v
        return np.asarray(self.pin.aba(self.model, self.data, position, speed, np.zeros(self.model.nv))[self.place])


    def point(self, body: int, place: Array) -> Array:
        """The point of the fixed frame at a place in a body (-1: the fixed frame) at the coordinates of the bodies."""
        self.pin.forwardKinematics(self.model, self.data, self.q)
        return np.asarray(place if body < 0 else self.data.oMi[self.joints[body]].act(place))

    def place_in(self, body: int, point: Array) -> Array:
        """The place in a body of a point of the fixed frame."""
        self.pin.forwardKinematics(self.model, self.data, self.q)
        return np.asarray(point if body < 0 else self.data.oMi[self.joints[body]].actInv(point))

    def _constraints(self, closures: list[Closure]) -> Any:
        """The closures as Pinocchio's constraints of points, without stabilisation."""
        pin, constraints = self.pin, self.pin.StdVec_RigidConstraintModel()
        for closure in closures:
            sides = [(0 if k < 0 else self.joints[k], pin.SE3(np.eye(3), place))
                     for k, place in zip((closure.first, closure.second), closure.places, strict=True)]
            constraints.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *sides[0], *sides[1],
                                                        pin.ReferenceFrame.LOCAL))
        return constraints

    def dependent(self, closures: list[Closure]) -> set[int]:
        """The bodies whose joints follow best from those of the others: the pivots of the Jacobian of the closures."""
        rows = []
        for closure in closures:
            by_body = []
            for k, place in zip((closure.first, closure.second), closure.places, strict=True):
                columns = []
                for step in (1e-6, -1e-6):
                    moved = []
                    for joint in self.place:
                        q = self.q.copy()
                        q[joint] += step
                        self.pin.forwardKinematics(self.model, self.data, q)
                        moved.append(place if k < 0 else self.data.oMi[self.joints[k]].act(place))
                    columns.append(np.array(moved).T)
                by_body.append((columns[0] - columns[1])/2e-6)
            rows.append(by_body[0] - by_body[1])
        jacobian = np.vstack(rows)
        return set(scipy.linalg.qr(jacobian, pivoting=True)[2][:len(jacobian)].tolist())

    def closed_accelerations(self, closures: list[Closure], q: Array, v: Array) -> Array:
        """As `accelerations`, with the closures."""
        position, speed = np.zeros((2, self.model.nv))
        position[self.place], speed[self.place] = q, v
        pin, constraints = self.pin, self._constraints(closures)
        data = pin.StdVec_RigidConstraintData()
        for constraint in constraints:
            data.append(constraint.createData())
        begin = (self.model, self.data, constraints, data)  # version 3 takes no data of the constraints
        pin.initConstraintDynamics(*begin[:3 if pin.__version__ < "4" else 4])
        found = pin.constraintDynamics(self.model, self.data, position, speed, np.zeros(self.model.nv), constraints, data,
                                       pin.ProximalSettings(1e-14, 1e-14, 100))
        return np.asarray(found[self.place])


def mujoco_accelerations(bodies: list[TreeBody], closures: Sequence[Closure] = (), q: Array | None = None,
                         v: Array | None = None) -> Array:
    """The accelerations in MuJoCo, in the order of the bodies, at the start or at coordinates and speeds in this order. The
    closures are constraints of stiffness, with the hardest setting that MuJoCo accepts."""
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
    for closure in closures:
        bodies_joined = [spec.worldbody if k < 0 else made[k] for k in (closure.first, closure.second)]
        sites = [body.add_site(name=f"{body.name}_{len(body.sites)}", pos=place)
                 for body, place in zip(bodies_joined, closure.places, strict=True)]
        connect = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=sites[0].name,
                                    name2=sites[1].name)
        connect.solimp = [0.9999, 0.9999, 0.001, 0.5, 2]
    model = spec.compile()
    data = mujoco.MjData(model)
    joints = [model.joint(f"joint_{k}") for k in range(len(bodies))]
    for k, (joint, b) in enumerate(zip(joints, bodies, strict=True)):
        data.qpos[joint.qposadr[0]] = b.q if q is None else q[k]
        data.qvel[joint.dofadr[0]] = b.v if v is None else v[k]
    mujoco.mj_forward(model, data)
    return np.array([data.qacc[joint.dofadr[0]] for joint in joints])


@dataclass(frozen=True)
class Closure:
    """A ball joint that closes a loop: two bodies (-1: the fixed frame) and the place of its centre in each of them."""

    first: int
    second: int
    places: tuple[Array, Array]


def closed_mechanism(number: int) -> tuple[list[TreeBody], list[Closure], list[int]]:
    """The mechanisms 0 to 5: a random tree with loops that are closed by ball joints, the closures, and the bodies whose
    joints are independent. All joints have their values `q` in the closed position.

    0, 1 and 2 are chains of 5, 6 and 7 bodies whose last body is joined to the fixed frame. In 3 the last two bodies of a
    tree are joined, in 4 two pairs of a larger tree. 5 is a platform on three legs of two hinges and a guide, of which two
    close loops.
    """
    tree = random_tree((5, 6, 7, 6, 10, 0)[number], 40 + number)
    random = np.random.default_rng(number)
    if number < 3:
        bodies = [replace(b, parent=k - 1) for k, b in enumerate(tree)]
        pairs = [(len(bodies) - 1, -1)]
    elif number < 5:
        half = len(tree)//2
        bodies = [replace(b, parent=k - 1 if k % half else -1) for k, b in enumerate(tree)]
        pairs = [(len(tree) - 1, half - 1)] if number == 3 else [(len(tree) - 1, half - 1), (len(tree) - 2, half - 2)]
    else:
        bodies = []
        for side in range(3):
            direction = np.array([np.cos(2.1*side), np.sin(2.1*side), 0])
            for k, b in enumerate(random_tree(3, 45)):
                bodies.append(replace(b, parent=3*side + k - 1 if k else -1, turns=k < 2)
                              if k else replace(b, parent=-1, turns=True, shift=b.shift + 2*direction,
                                                angles=b.angles + np.array([0, 0, 2.1*side])))
        pairs = [(5, 2), (8, 2)]
    pinocchio = Pinocchio(bodies)
    closures = []
    for first, second in pairs:
        centre = pinocchio.point(first, random.uniform(-0.5, 0.5, 3))
        closures.append(Closure(first, second, (pinocchio.place_in(first, centre), pinocchio.place_in(second, centre))))
    dependent = pinocchio.dependent(closures)
    return bodies, closures, [k for k in range(len(bodies)) if k not in dependent]


def closed_diagram(bodies: list[TreeBody], closures: list[Closure], independent: list[int]) -> str:
    """The diagram of a closed mechanism, with initial values for the independent joints and guesses for the others; its
    outputs are q_k, v_k and a_k of joint k."""
    lines = diagram(bodies).splitlines()
    parts, initial, show = [], [], []
    nodes = {k: lines.index(next(line for line in lines if line.startswith(f"  {name}: ["))) for k, name in (
        (-1, "world"), *((k, f"frame_{k}") for k in range(len(bodies))))}
    more = []
    for c, closure in enumerate(closures):
        for side, (k, place) in enumerate(zip((closure.first, closure.second), closure.places, strict=True)):
            x, y, z = (repr(float(value)) for value in place)
            parts.append(f"  to_{c}_{side}: {{is: SpatialLink, l_x: {x} m, l_y: {y} m, l_z: {z} m}}")
            lines[nodes[k]] = lines[nodes[k]].replace("]", f", to_{c}_{side}.a]")
            more.append(f"  eye_{c}_{side}: [to_{c}_{side}.b, ball_{c}.{'ab'[side]}]")
        parts.append(f"  ball_{c}: {{is: SphericalJoint}}")
    for k, b in enumerate(bodies):
        position, speed, unit = ("phi", "w", "rad") if b.turns else ("s", "v", "m")
        initial += [f"joint_{k}.{position}: {b.q!r} {unit}", f"joint_{k}.{speed}: {b.v!r} {unit}/s"] if k in independent \
            else [f"joint_{k}.{position}: ~ {b.q + 0.02!r} {unit}"]
        show.append(f"  v_{k}: {{is: joint_{k}.{speed}, unit: {unit}/s}}")
    at = lines.index("nodes:")
    return "\n".join([*lines[:at], *parts, *(
        f"initial: {{{', '.join(initial)}}}" if line.startswith("initial:") else line for line in lines[at:-1]), *show,
        lines[-1]]).replace("\ninitial:", "\n" + "\n".join(more) + "\ninitial:") + "\n"
