"""Import of a robot described in URDF: links, joints and inertias as a diagram of mechanics in space.

The frame of a link is a node. Its `inertial` is a SpatialBody with the inertia tensor R J R^T, where R is the rotation of
the inertial frame by roll, pitch and yaw about fixed axes. The `origin` of a joint is a SpatialLink, the joint itself a
joint of the library with the same coordinate. If a joint mimics another one, q = k q' + c, the offset c is part of the
origin, and a gear, a lever or a rack between the drives of both joints transmits the motion and its reaction.

The file is read by expat without document types, entities and network, and nothing in it is executed.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML).
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, Place, Problem, Problems, listing
from heavebond.core.numerals import number
from heavebond.core.presentation import count
from heavebond.core.quoting import file_stem
from heavebond.import_20sim.emx_file import UTF_16
from heavebond.import_20sim.importer import Imported, Untranslated
from heavebond.import_20sim.names import identifier
from heavebond.import_20sim.write import mapping, quantity, remark, scalar
from heavebond.language.view import MESHES

Array = NDArray[np.float64]

MOST_BYTES = 50_000_000
DEEPEST = 100
MOST_ELEMENTS = 1_000_000
ROUNDING = 1e-14  # relative size below which an element of a rotated tensor is 0
PHYSICAL = 1e-9  # relative tolerance of the triangle inequality of moments of inertia, for rounded values of a file
AXES = ("x", "y", "z")
ANGLES = ("roll", "pitch", "yaw")
KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
TURNING = ("revolute", "continuous")
DRIVEN = (*TURNING, "prismatic")
OTHER_FORMATS = {"sdf": "SDF", "mujoco": "MJCF of MuJoCo", "MuJoCo": "MJCF of MuJoCo", "COLLADA": "COLLADA"}
MASS_LINE = ('Add `<inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
             "</inertial>` with its values to the link")


@dataclass
class Element:
    """An element of an XML file with its line."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> list[Element]:
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> Element | None:
        return next(iter(self.all(tag)), None)


@dataclass(frozen=True)
class Shape:
    """A box (three edges), cylinder (radius, length), sphere (radius) or mesh (scale, `file`) of a link, its middle or its
    origin, and the angles of its axes."""

    kind: str
    size: tuple[float, ...]
    shift: Array
    angles: Array
    file: Path | None = None


@dataclass(frozen=True)
class Link:
    """A link: its line, mass, centre of mass and inertia tensor about it, both in the axes of the link, and its shapes."""

    name: str
    line: int
    m: float
    centre: Array
    J: Array
    shapes: tuple[Shape, ...]


@dataclass(frozen=True)
class Joint:
    """A joint: its line, kind, links, origin (vector, and roll, pitch, yaw), unit vector of the axis, values of `limit` and
    `dynamics`, and the leader, factor and offset of `mimic`."""

    name: str
    line: int
    kind: str
    parent: str
    child: str
    shift: Array
    angles: Array
    axis: Array
    limit: dict[str, float]
    damping: float
    friction: float
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True)
class Robot:
    """The links and joints of a file in its order, the root link, and the elements without a translation."""

    name: str
    links: dict[str, Link]
    joints: dict[str, Joint]
    root: str
    untranslated: tuple[Untranslated, ...]

    def below(self, link: str) -> list[Joint]:
        """The joints whose parent is a link."""
        return [joint for joint in self.joints.values() if joint.parent == link]

    def in_order(self) -> list[Joint]:
        """The joints in depth-first order from the root."""
        ordered, waiting = list[Joint](), self.below(self.root)[::-1]
        while waiting:
            joint = waiting.pop()
            ordered.append(joint)
            waiting += self.below(joint.child)[::-1]
        return ordered


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """The rotation matrix of roll, pitch and yaw about the fixed axes x, y and z, in this order."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array([[cy*cp, cy*sp*sr - sy*cr, cy*sp*cr + sy*sr], [sy*cp, sy*sp*sr + cy*cr, sy*sp*cr - cy*sr],
                     [-sp, cp*sr, cp*cr]])


def turned(axis: Array, angle: float) -> Array:
    """The rotation matrix about a unit vector (Rodrigues)."""
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + np.sin(angle)*K + (1 - np.cos(angle))*(K @ K))


def cardan_angles(R: Array) -> Array:
    """Roll, pitch and yaw of a rotation matrix; at a pitch of 90 degrees the roll is 0."""
    horizontal = np.hypot(R[0, 0], R[1, 0])
    if horizontal < 1e-12:
        return np.array([0.0, np.arctan2(-R[2, 0], horizontal), np.arctan2(-R[0, 1], R[1, 1])])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), np.arctan2(-R[2, 0], horizontal), np.arctan2(R[1, 0], R[0, 0])])


# -- the file ----------------------------------------------------------------------------------------------------------
def read_xml(path: Path) -> Element:
    """The root element of a file; raises ModelError for wrong XML, document types, entities, and files above the limits."""
    if path.stat().st_size > MOST_BYTES:
        raise _wrong(path, 1, "urdf-size", f"'{path.name}' has more than {MOST_BYTES // 1_000_000} MB")
    parser, stack, roots = expat.ParserCreate(), list[Element](), list[Element]()
    elements = 0

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal elements
        elements += 1
        element = Element(tag, attributes, parser.CurrentLineNumber)
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)
        if len(stack) > DEEPEST or elements > MOST_ELEMENTS:
            raise _wrong(path, element.line, "urdf-nesting", "the XML is nested too deeply or has too many elements")

    def refuse(*_: object) -> None:
        raise _wrong(path, parser.CurrentLineNumber, "urdf-doctype", "the file declares a document type or entities, "
                     "which a URDF file does not need", "Remove the lines `<!DOCTYPE ...>` and `<!ENTITY ...>`.")

    parser.StartElementHandler, parser.EndElementHandler = begin, lambda _: stack.pop()
    parser.StartDoctypeDeclHandler, parser.EntityDeclHandler = refuse, refuse
    content = path.read_bytes()
    if not content.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") and content[:2] not in UTF_16:
        why = "does not begin as XML" if content.strip() else "is empty"
        raise _wrong(path, 1, "urdf-xml", f"'{path.name}' {why}", "A robot in URDF begins with `<robot name=\"arm\">`.")
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: an unknown encoding
        raise _wrong(path, getattr(error, "lineno", 1), "urdf-xml", f"the XML is wrong: {error}",
                     "Close each element: `<link name=\"arm\">` ... `</link>`, or `<link name=\"arm\"/>`.") from None
    return roots[0]


def _wrong(path: Path, line: int, code: str, message: str, hint: str = "") -> ModelError:
    return ModelError([Problem(code, message, Place(path.name, max(1, line)), hint)])


class _Reader:
    """The links and joints of the elements of one file; collects all problems."""

    def __init__(self, path: Path):
        self.path = path
        self.problems = Problems()
        self.notes: list[Untranslated] = []

    def problem(self, code: str, message: str, line: int, hint: str = "") -> None:
        self.problems.add(code, message, Place(self.path.name, line), hint=hint)

    def values(self, element: Element | None, attribute: str, default: tuple[float, ...]) -> Array:
        """The finite numbers of an attribute, as many as `default` has."""
        text = None if element is None else element.attributes.get(attribute)
        if element is None or text is None:
            return np.array(default)
        try:
            numbers = [number(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != len(default) or not np.all(np.isfinite(numbers)):
            example = " ".join(f"{value:g}" for value in default)
            if len(default) == 1 and text.count(",") == 1:  # a decimal comma
                example = text.strip().replace(",", ".")
            self.problem("urdf-number", f"<{element.tag}>: '{attribute}' is \"{text}\", expected "
                         f"{count(len(default), 'number')}", element.line, f"Write for example {attribute}=\"{example}\".")
            return np.array(default)
        return np.array(numbers)

    def value(self, element: Element | None, attribute: str, default: float = 0.0) -> float:
        return float(self.values(element, attribute, (default,))[0])

    def link(self, element: Element, name: str) -> Link:
        inertial = element.first("inertial")
        line = element.line if inertial is None else inertial.line
        origin, tensor = (None, None) if inertial is None else (inertial.first("origin"), inertial.first("inertia"))
        m = 0.0 if inertial is None else self.value(inertial.first("mass"), "value")
        centre = self.values(origin, "xyz", (0.0, 0.0, 0.0))
        R = rotation(*self.values(origin, "rpy", (0.0, 0.0, 0.0)))
        xx, xy, xz, yy, yz, zz = (self.value(tensor, f"i{pair}") for pair in ("xx", "xy", "xz", "yy", "yz", "zz"))
        J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        principal = np.linalg.eigvalsh(J)
        if any(problem.code == "urdf-number" for problem in self.problems.found):
            pass  # the values are not known
        elif m < 0 or (m == 0 and J.any()):
            self.problem("urdf-mass", f"the link '{name}' has a mass of {m:g} kg" + (" and an inertia" if m == 0 else ""),
                         line, 'Write its mass in kg, `<mass value="2.5"/>`.')
        elif J.any() and principal[0] <= 0:
            self.problem("urdf-inertia", f"the inertia tensor of the link '{name}' is not positive definite; its principal "
                         f"moments are {', '.join(f'{value:.4g}' for value in principal)} kg*m**2", line,
                         "Correct ixx, iyy, izz and the products ixy, ixz, iyz. For a mass without extension, remove "
                         "`<inertia>`.")
        elif J.any() and principal[0] + principal[1] < principal[2]*(1 - PHYSICAL):
            self.notes.append(Untranslated(name, line, "the largest principal moment of the inertia tensor exceeds the sum "
                                           "of the others, which no rigid body has. The tensor is used as given"))
        J = R @ J @ R.T
        J[np.abs(J) < ROUNDING*np.abs(J).max(initial=0)] = 0
        return Link(name, element.line, max(m, 0.0), centre, J, tuple(self.shapes(element)))

    def shapes(self, link: Element) -> Iterator[Shape]:
        """The visible boxes, cylinders, spheres and meshes of a link."""
        for visual in link.all("visual"):
            geometry, origin = visual.first("geometry"), visual.first("origin")
            shift, angles = self.values(origin, "xyz", (0.0, 0.0, 0.0)), self.values(origin, "rpy", (0.0, 0.0, 0.0))
            for solid in () if geometry is None else geometry.children:
                if solid.tag == "box":
                    yield Shape("box", tuple(self.values(solid, "size", (0.1, 0.1, 0.1)).tolist()), shift, angles)
                elif solid.tag == "cylinder":
                    size = self.value(solid, "radius", 0.1), self.value(solid, "length", 0.1)
                    yield Shape("cylinder", size, shift, angles)
                elif solid.tag == "sphere":
                    yield Shape("sphere", (self.value(solid, "radius", 0.1),), shift, angles)
                elif solid.tag == "mesh":
                    scale = self.values(solid, "scale", (1.0, 1.0, 1.0))
                    name = solid.attributes.get("filename", "")
                    file = self.mesh(name)
                    if file is None or np.ptp(scale):
                        reason = f"cannot find the mesh '{name}' near {self.path.name}" if file is None else \
                            f"the mesh '{name}' has different scales along its axes"
                        self.notes.append(Untranslated(link.attributes.get("name", ""), solid.line, f"{reason}; it is for "
                                                       "pictures only, see the shape `mesh` of `view:`"))
                    else:
                        yield Shape("mesh", (float(scale[0]),), shift, angles, file)

    def mesh(self, name: str) -> Path | None:
        """The file of a mesh, or None if there is none that a picture can show. A file of a ROS package,
        `package://arm/meshes/a.stl`, is searched for in the folders above the file of the robot."""
        path = PurePosixPath(name.partition("://")[2] or name)
        if path.suffix.lower() not in MESHES or ".." in path.parts:
            return None
        inside = path.relative_to(path.parts[0]) if "://" in name and len(path.parts) > 1 else path  # without the package
        folders = self.path.absolute().parents[:4]
        return next((folder / part for folder in folders for part in (inside, path) if (folder / part).is_file()), None)

    def joint(self, element: Element, name: str) -> Joint | None:
        kind = element.attributes.get("type", "")
        parent, child = (None if (end := element.first(tag)) is None else end.attributes.get("link")
                         for tag in ("parent", "child"))
        if kind not in KINDS:
            self.problem("urdf-joint", f"the joint '{name}' has the unknown type '{kind}'" if kind else
                         f"the joint '{name}' has no type", element.line, f"Write type=\"{KINDS[0]}\", or one of "
                         f"{listing(KINDS[1:])}. For a ball joint, write three revolute joints through one point.")
        if parent is None or child is None:
            missing = "parent" if parent is None else "child"
            self.problem("urdf-joint", f"the joint '{name}' has no <{missing}>", element.line,
                         f'Add `<{missing} link="NAME"/>` to the joint.')
        if kind not in KINDS or parent is None or child is None:
            return None
        origin, dynamics, limit, mimic = (element.first(tag) for tag in ("origin", "dynamics", "limit", "mimic"))
        axis = self.values(element.first("axis"), "xyz", (1.0, 0.0, 0.0))
        if kind not in ("fixed", "floating") and not axis.any():
            self.problem("urdf-number", f"the axis of the joint '{name}' is the zero vector", element.line,
                         'Write for example `<axis xyz="0 0 1"/>`.')
            axis = np.array([1.0, 0, 0])
        limits: dict[str, float] = {} if limit is None else {
            key: self.value(limit, key) for key in ("lower", "upper", "effort", "velocity") if key in limit.attributes}
        if kind == "continuous":
            limits = {key: value for key, value in limits.items() if key not in ("lower", "upper")}
        elif "lower" in limits and "upper" in limits and limits["lower"] > limits["upper"]:
            assert limit is not None
            self.problem("urdf-limit", f"the lower limit {limits['lower']:g} of the joint '{name}' exceeds the upper limit "
                         f"{limits['upper']:g}", limit.line, "Exchange `lower` and `upper`.")
        damping, friction = (self.value(dynamics, key) for key in ("damping", "friction"))
        for key, value in (("damping", damping), ("friction", friction)):
            if value < 0:
                self.problem("urdf-number", f"the {key} of the joint '{name}' is negative: {value:g}", element.line,
                             f"Write a {key} of 0 or more.")
        follows = None
        if mimic is not None:
            follows = (mimic.attributes.get("joint", ""), self.value(mimic, "multiplier", 1.0), self.value(mimic, "offset"))
        length = np.linalg.norm(axis)
        return Joint(name, element.line, kind, parent, child, self.values(origin, "xyz", (0.0, 0.0, 0.0)),
                     self.values(origin, "rpy", (0.0, 0.0, 0.0)), axis/length if length else axis, limits, damping, friction,
                     follows)


def read_urdf(path: Path) -> Robot:
    """Read a robot; raises ModelError with all mistakes of the file."""
    top = read_xml(path)
    tag = top.tag.rpartition(":")[2]
    if tag != "robot":
        kind = f": a file in {OTHER_FORMATS[tag]}" if tag in OTHER_FORMATS else ""
        raise _wrong(path, top.line, "urdf-root", f"the root element is <{tag}>, not <robot>{kind}",
                     "Export the robot as URDF, `<robot name=\"arm\">` ... `</robot>`.")
    macro = next((child for child in _inside(top) if child.tag.startswith("xacro:")), None)
    if macro is not None:
        raise _wrong(path, macro.line, "urdf-xacro", f"the file is a xacro template: it has <{macro.tag}>",
                     f"Expand it: xacro {path.name} -o {path.stem.removesuffix('.urdf')}.urdf")
    reader = _Reader(path)
    links, joints = dict[str, Link](), dict[str, Joint]()
    for element in top.children:
        if element.tag not in ("link", "joint"):
            continue
        name, known = element.attributes.get("name", ""), links if element.tag == "link" else joints
        if not name or name in known:
            reader.problem("urdf-name", f"a {element.tag} has no name" if not name else
                           f"two {element.tag}s have the name '{name}'", element.line,
                           f'Give each {element.tag} a different name, `<{element.tag} name="{name or "arm"}_2" ...>`.')
        elif element.tag == "link":
            links[name] = reader.link(element, name)
        elif (joint := reader.joint(element, name)) is not None:
            joints[name] = joint
    if not links:
        reader.problem("urdf-link", "the robot has no links", top.line, 'Add `<link name="base"/>`.')
    if not reader.problems:
        _check_tree(reader, links, joints)
    reader.problems.raise_as()
    root = next(name for name in links if all(joint.child != name for joint in joints.values()))
    robot = Robot(top.attributes.get("name", "") or path.stem, links, joints, root, ())
    _check_inertia(reader, robot)
    reader.problems.raise_as()
    further_tags = Counter(child.tag for child in top.children if child.tag not in ("link", "joint", "material"))
    for tag, n in further_tags.items():
        line = next(child.line for child in top.children if child.tag == tag)
        reader.notes.append(Untranslated("robot", line, f"{count(n, f'<{tag}> element')}, not part of the mechanics"))
    return Robot(robot.name, links, joints, root, tuple(reader.notes))


def _inside(element: Element) -> list[Element]:
    """All elements below an element, in the order of the file."""
    elements, waiting = list[Element](), element.children[::-1]
    while waiting:
        child = waiting.pop()
        elements.append(child)
        waiting += child.children[::-1]
    return elements


def _check_tree(reader: _Reader, links: dict[str, Link], joints: dict[str, Joint]) -> None:
    """Check that links and leaders exist, that each link but one has exactly one parent, and that the joints form a tree."""
    parents: dict[str, Joint] = {}
    for joint in joints.values():
        for end in (joint.parent, joint.child):
            if end not in links:
                reader.problem("urdf-link", f"the joint '{joint.name}' connects a link '{end}' that does not exist",
                               joint.line, f'Add `<link name="{end}"/>`, or name one of {listing(links, 8)}.')
        if joint.child in parents:
            first = parents[joint.child]
            reader.problem("urdf-loop", f"the link '{joint.child}' is the child of two joints, '{first.name}' (line "
                           f"{first.line}) and '{joint.name}': the links form a loop", joint.line,
                           f"URDF describes trees. Remove the joint '{joint.name}', import the file, and close the loop in "
                           "the diagram with a SphericalJoint or another joint between both nodes.")
        parents.setdefault(joint.child, joint)
        if joint.mimic is not None:
            leader = joints.get(joint.mimic[0])
            if leader is None or leader.kind not in DRIVEN or joint.kind not in DRIVEN or leader is joint:
                why = "is not a revolute, continuous or prismatic joint" if joint.kind not in DRIVEN else \
                    f"mimics '{joint.mimic[0]}', which is not another revolute, continuous or prismatic joint"
                movable = [other.name for other in joints.values() if other.kind in DRIVEN and other is not joint]
                reader.problem("urdf-mimic", f"the joint '{joint.name}' has <mimic>, but {why}", joint.line,
                               f"Name one of {listing(movable, 8)}." if movable else "Remove `<mimic>`.")
    if reader.problems:
        return
    for joint in joints.values():  # leaders that mimic each other
        chain, mimic = [joint.name], joint.mimic
        while mimic is not None and mimic[0] not in chain:
            chain.append(mimic[0])
            mimic = joints[mimic[0]].mimic
        if mimic is not None:
            reader.problem("urdf-mimic", f"the joints {listing(chain)} mimic each other", joint.line,
                           "Remove one `<mimic>`.")
            return
    roots = [link for link in links.values() if link.name not in parents]
    if len(roots) > 1:
        others = roots[1:]
        reader.problem("urdf-roots", f"the robot has {len(roots)} links without a parent: "
                       f"{listing([link.name for link in roots], 8)}", others[0].line,
                       f'Connect them, for example `<joint name="fixed_{others[0].name}" type="fixed"><parent '
                       f'link="{roots[0].name}"/><child link="{others[0].name}"/></joint>`.')
    reached, waiting = set[str](), [link.name for link in roots]
    while waiting:
        name = waiting.pop()
        reached.add(name)
        waiting += [joint.child for joint in joints.values() if joint.parent == name]
    cyclic = [joint for joint in joints.values() if joint.child not in reached]
    if cyclic:
        reader.problem("urdf-loop", f"the joints {listing([joint.name for joint in cyclic], 8)} form a loop without a root "
                       "link", cyclic[0].line,
                       "URDF describes trees. Remove one of these joints, import the file, and close the loop in the "
                       "diagram.")


def _check_inertia(reader: _Reader, robot: Robot) -> None:
    """Check that each joint moves a mass, and each turning joint a moment of inertia about its axes. A joint with `mimic` is
    not checked, because the transmission couples it to the inertia of its leader."""
    poses = start_poses(robot)
    for joint in robot.joints.values():
        if joint.kind == "fixed" or joint.mimic is not None:
            continue
        carried, waiting = list[str](), [joint.child]
        while waiting:
            name = waiting.pop()
            carried.append(name)
            waiting += [other.child for other in robot.below(name) if other.kind != "floating"]
        R, r = poses[joint.child]
        m, total = 0.0, np.zeros((3, 3))  # mass, and tensor about the joint
        for name in carried:
            link, (turn, place) = robot.links[name], poses[name]
            arm = place + turn @ link.centre - r
            J = turn @ link.J @ turn.T + link.m*(arm @ arm*np.eye(3) - np.outer(arm, arm))
            m, total = m + link.m, total + J
        axis = R @ joint.axis
        turns = joint.kind in (*TURNING, "planar", "floating")
        moment = np.linalg.eigvalsh(total)[0] if joint.kind == "floating" else axis @ total @ axis
        what = f"the link '{joint.child}'" + (" and the links beyond it have" if len(carried) > 1 else " has")
        if not m:
            reader.problem("urdf-mass", f"{what} no mass: the joint '{joint.name}' "
                           f"(line {joint.line}) moves nothing", robot.links[joint.child].line,
                           f"{MASS_LINE} '{carried[-1]}', or make the joint fixed, type=\"fixed\".")
        elif turns and moment <= 1e-12*np.trace(total):
            about = "an axis" if joint.kind == "floating" else "the axis"
            reader.problem("urdf-inertia", f"{what} no moment of inertia about {about} of the joint '{joint.name}' "
                           f"(line {joint.line})", robot.links[joint.child].line, f"{MASS_LINE} '{joint.child}'.")


def coordinate(robot: Robot, joint: Joint) -> tuple[float, float]:
    """The coordinate of a joint in the diagram at the start, and the difference to the coordinate in URDF.

    A joint starts at 0, or at the limit nearest to 0. If it mimics a leader, q = k (q' + c') + c, where q' is the coordinate
    of the leader in the diagram and c' its offset. The coordinate in the diagram is then k q', and the offset k c' + c."""
    if joint.mimic is None:
        return float(min(max(0.0, joint.limit.get("lower", -np.inf)), joint.limit.get("upper", np.inf))), 0.0
    leader, factor, offset = joint.mimic
    start, shift = coordinate(robot, robot.joints[leader])
    return factor*start, factor*shift + offset


def start_poses(robot: Robot) -> dict[str, tuple[Array, Array]]:
    """Orientation (rotation matrix) and position of each link at the start, in the frame of the root link."""
    poses = {robot.root: (np.eye(3), np.zeros(3))}
    for joint in robot.in_order():
        R, r = poses[joint.parent]
        R, r = R @ rotation(*joint.angles), r + R @ joint.shift
        if joint.kind in TURNING:
            R = R @ turned(joint.axis, sum(coordinate(robot, joint)))
        elif joint.kind == "prismatic":
            r = r + R @ joint.axis*sum(coordinate(robot, joint))
        poses[joint.child] = R, r
    return poses


# -- the diagram -------------------------------------------------------------------------------------------------------
class _Writer:
    """Parts, nodes, initial conditions and outputs of the diagram of a robot."""

    def __init__(self, robot: Robot, path: Path, folder: Path):
        self.robot, self.path, self.folder = robot, path, folder
        self.parts: list[tuple[str, str, str]] = []  # name, mapping, comment
        self.nodes: dict[str, list[str]] = {}
        self.initial: list[str] = []
        self.show: list[tuple[str, str]] = []
        self.taken: set[str] = set()
        self.poses = start_poses(robot)
        self.node_of = {name: self.name(name) for name in robot.links}
        self.part_of = {name: self.name(name, "joint") for name in robot.joints}
        self.drives: dict[str, str] = {}  # the nodes of the ports d
        self.held: dict[str, list[str]] = {"FixedShaft": [], "Fixed": []}

    def name(self, wanted: str, suffix: str = "") -> str:
        """An unused identifier; `suffix` is appended if the wanted identifier is taken."""
        plain = identifier(wanted)
        tries = [plain, *([f"{plain}_{suffix}"] if suffix else [])]
        k = 2
        while tries[0] in self.taken:
            tries = [*tries[1:]] or [f"{plain}_{k}"]
            k += 1
        self.taken.add(tries[0])
        return tries[0]

    def part(self, name: str, kind: str, values: dict[str, str], comment: str = "") -> None:
        self.parts.append((name, mapping([("is", kind), *values.items()]), comment))

    def diagram(self, name: str) -> str:
        robot = self.robot
        root = self.node_of[robot.root]
        world = "world" if identifier(robot.root) == "world" and not robot.links[robot.root].m else self.name("world")
        self.part(world, "SpatialFixed", {})
        self.nodes[root] = [f"{world}.a"]
        self.body(robot.links[robot.root])
        for joint in robot.in_order():
            self.joint(joint)
        for joint in robot.joints.values():
            if joint.mimic is not None:
                self.couple(joint)
        for link in robot.links.values():  # points without inertia at the end of a branch, such as the tip of a tool
            if not link.m and link.name != robot.root and not robot.below(link.name):
                self.show += [(f"{self.node_of[link.name]}.{axis}", "m") for axis in AXES]
        self.holders()
        width = max(len(part) for part, *_ in self.parts) + 1
        summary = scalar(f"Robot {robot.name}, imported from {self.path.name}.")
        lines = [f"model: {name}", f"summary: {summary}", "components:"]
        lines += [f"  {part + ':':<{width}} {values}" + (f"  # {remark(comment)}" if comment else "")
                  for part, values, comment in self.parts]
        lines += ["nodes:", *(f"  {node}: [{', '.join(ends)}]" for node, ends in self.nodes.items())]
        if self.initial:
            lines += ["initial:", *(f"  {line}" for line in self.initial)]
        if self.show:
            lines += ["show:", *(f"  {output}: {{unit: {unit}}}" for output, unit in self.show)]
        if view := list(self.view()):
            lines += ["view:", *(f"  {shape}: {values}" for shape, values in view)]
        return "\n".join([*lines, "simulate: {until: 1 s, every: 5 ms}"]) + "\n"

    def view(self) -> Iterator[tuple[str, str]]:
        """The ground at the root link and the shapes of all links, by their names."""
        if any(link.shapes for link in self.robot.links.values()):
            yield self.name("ground"), mapping([("is", "ground"), ("at", self.node_of[self.robot.root])])
        for link in self.robot.links.values():
            node = self.node_of[link.name]
            for k, shape in enumerate(link.shapes, 1):
                place = ", ".join([node, *(quantity(float(value), "m") for value in shape.shift)])
                turned = "[" + ", ".join(quantity(float(value), "rad") for value in shape.angles) + "]"
                sizes = [quantity(size, "m") for size in shape.size]
                entries = [("is", {"cylinder": "disc"}.get(shape.kind, shape.kind)),
                           ("at", f"[{place}]" if shape.shift.any() else node)]
                if shape.file is not None:
                    entries += [("file", scalar(os.path.relpath(shape.file, self.folder).replace(os.sep, "/"))),
                                ("unit", sizes[0]), *([("turned", turned)] if shape.angles.any() else [])]
                elif shape.kind == "box":
                    entries += [("size", f"[{', '.join(sizes)}]"), *([("turned", turned)] if shape.angles.any() else [])]
                else:
                    entries.append(("diameter", quantity(2*shape.size[0], "m")))
                if shape.kind == "cylinder":
                    axis = rotation(*shape.angles)[:, 2]
                    axis[np.abs(axis) < ROUNDING] = 0
                    direction = ", ".join(quantity(float(value), "") for value in axis)
                    entries += [("width", sizes[1]), ("axis", f"[{direction}]")]
                yield f"{node}_{k}" if len(link.shapes) > 1 else node, mapping(entries)

    def body(self, link: Link) -> None:
        """The inertia of a link on its node."""
        node = self.node_of[link.name]
        if not link.m:
            return
        centre = {f"l_{axis}": quantity(float(value), "m") for axis, value in zip(AXES, link.centre, strict=True) if value}
        if not link.J.any():
            if centre:
                arm, place = self.name(f"{node}_arm"), self.name(f"{node}_centre")
                self.part(arm, "SpatialLink", centre)
                self.nodes[node].append(f"{arm}.a")
                self.nodes[place] = [f"{arm}.b"]
                node = place
            part = self.name(f"{self.node_of[link.name]}_mass")
            self.part(part, "SpatialPointMass", {"m": quantity(link.m, "kg")})
        else:
            part = node  # the node has the name of its body
            moments = {f"J_{AXES[i]}" + (AXES[j] if i != j else ""): quantity(float(link.J[i, j]), "kg*m**2")
                       for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)) if i == j or link.J[i, j]}
            self.part(part, "SpatialBody", {"m": quantity(link.m, "kg"), **moments, **centre})
        self.nodes[node].append(f"{part}.a")

    def link(self, name: str, shift: Array, angles: Array, a: str, b: str) -> None:
        """A SpatialLink between two nodes."""
        values = {f"l_{axis}": quantity(float(value), "m") for axis, value in zip(AXES, shift, strict=True) if value}
        values.update({angle: quantity(float(value), "rad") for angle, value in zip(ANGLES, angles, strict=True) if value})
        self.part(name, "SpatialLink", values)
        self.nodes[a].append(f"{name}.a")
        self.nodes.setdefault(b, []).append(f"{name}.b")

    def joint(self, joint: Joint) -> None:
        """The origin of a joint, the joint, its drive, friction and damping, and the body of its child."""
        parent, child, part = self.node_of[joint.parent], self.node_of[joint.child], self.part_of[joint.name]
        shift, angles = joint.shift, joint.angles
        if joint.kind == "fixed":
            self.link(part, shift, angles, parent, child)
        elif joint.kind == "floating":
            self.floating(joint, child)
        else:
            R = rotation(*angles)
            if (offset := coordinate(self.robot, joint)[1]):
                if joint.kind == "prismatic":
                    shift = shift + R @ joint.axis*offset
                else:
                    angles = cardan_angles(R @ turned(joint.axis, offset))
            base = parent
            if shift.any() or angles.any():
                base = self.name(f"{part}_base")
                self.link(self.name(f"{part}_origin"), shift, angles, parent, base)
            if joint.kind == "planar":
                self.planar(joint, base, child)
            else:
                self.drive(joint, base, child)
        self.body(self.robot.links[joint.child])

    def floating(self, joint: Joint, child: str) -> None:
        """A free body, which starts at the origin of the joint at rest."""
        pose = self.name(f"{self.part_of[joint.name]}_pose")
        self.part(pose, "SpatialSensor", {}, f"free: joint {joint.name}")
        self.nodes[child] = [f"{pose}.a"]
        R, r = self.poses[joint.child]
        self.initial += [f"{child}.{axis}: {quantity(float(value), 'm')}" for axis, value in zip(AXES, r, strict=True)]
        self.initial += [f"{pose}.{angle}: {quantity(float(value), 'rad')}"
                         for angle, value in zip(ANGLES, cardan_angles(R), strict=True)]
        self.initial += [f"{child}.{rate}_{axis}: 0 {unit}" for rate, unit in (("v", "m/s"), ("w", "rad/s"))
                         for axis in AXES]
        self.show += [(f"{child}.{axis}", "m") for axis in AXES]

    def planar(self, joint: Joint, base: str, child: str) -> None:
        """A PlaneJoint between two SpatialLinks: the first turns the z axis to the axis of the joint, the second turns
        back."""
        part, n = self.part_of[joint.name], joint.axis
        lower, upper = base, child
        angles = np.array([0.0, np.arctan2(np.hypot(n[0], n[1]), n[2]), np.arctan2(n[1], n[0])])
        if np.hypot(n[0], n[1]) or n[2] < 0:
            lower, upper = self.name(f"{part}_lower"), self.name(f"{part}_upper")
            self.link(self.name(f"{part}_to_plane"), np.zeros(3), angles, base, lower)
            self.nodes[upper] = []
            self.link(self.name(f"{part}_from_plane"), np.zeros(3), cardan_angles(rotation(*angles).T), upper, child)
        self.part(part, "PlaneJoint", {})
        self.nodes[lower].append(f"{part}.a")
        self.nodes.setdefault(upper, []).append(f"{part}.b")
        for port, kind, values in (("d", "TorqueSource", "0 N*m"), ("e", "ForceSource", "0 N"), ("f", "ForceSource", "0 N")):
            motor = self.name(f"{part}_motor_{port}")
            self.part(motor, kind, {"u": values})
            self.nodes[self.name(f"{part}_{port}")] = [f"{part}.{port}", f"{motor}.a"]
        states = (("phi", "rad"), ("s", "m"), ("t", "m"), ("w", "rad/s"), ("u", "m/s"), ("v", "m/s"))
        self.initial += [f"{part}.{state}: 0 {unit}" for state, unit in states]
        self.show += [(f"{part}.{state}", unit) for state, unit in states[:3]]

    def drive(self, joint: Joint, base: str, child: str) -> None:
        """A revolute, continuous or prismatic joint with its motor, damper and friction at port d."""
        part, turning = self.part_of[joint.name], joint.kind in TURNING
        unit, force = ("rad", "N*m") if turning else ("m", "N")
        damping_unit = "N*m*s/rad" if turning else "N*s/m"
        limit = joint.limit
        stated = [f"{quantity(limit['lower'], unit)} .. {quantity(limit['upper'], unit)}"] if (
            {"lower", "upper"} <= set(limit)) else []
        stated += [quantity(limit[key], u) for key, u in (("effort", force), ("velocity", f"{unit}/s")) if limit.get(key)]
        comment = [joint.kind] if joint.kind == "continuous" else []
        comment += [f"limits {', '.join(stated)}"] if stated else []
        axis = ", ".join(quantity(float(value), "") for value in joint.axis)
        kind = "SpatialRevoluteJoint" if turning else "SpatialPrismaticJoint"
        self.part(part, kind, {"n": f"[{axis}]"}, "; ".join(comment))
        self.nodes[base].append(f"{part}.a")
        self.nodes.setdefault(child, []).append(f"{part}.b")
        drive = self.drives[joint.name] = self.name(f"{part}_drive")
        self.nodes[drive] = [f"{part}.d"]
        holder = "FixedShaft" if turning else "Fixed"
        if joint.damping:
            damper = self.name(f"{part}_damper")
            self.part(damper, "RotationalDamper" if turning else "Damper", {"d": quantity(joint.damping, damping_unit)})
            self.nodes[drive].append(f"{damper}.b")
            self.held[holder].append(f"{damper}.a")
        if joint.friction:
            friction, symbol = self.name(f"{part}_friction"), "M" if turning else "F"
            value = quantity(joint.friction, force)
            self.part(friction, "RotationalCoulombFriction" if turning else "CoulombFriction", {f"{symbol}_c": value})
            self.nodes[drive].append(f"{friction}.b")
            self.held[holder].append(f"{friction}.a")
        position, speed = ("phi", "w") if turning else ("s", "v")
        if joint.mimic is None:
            motor = self.name(f"{part}_motor")
            self.part(motor, "TorqueSource" if turning else "ForceSource", {"u": f"0 {force}"})
            self.nodes[drive].append(f"{motor}.a")
        self.initial.append(f"{part}.{position}: {quantity(coordinate(self.robot, joint)[0], unit)}")
        if joint.mimic is None:
            self.initial.append(f"{part}.{speed}: 0 {unit}/s")
        self.show.append((f"{part}.{position}", "deg" if turning else "m"))

    def couple(self, joint: Joint) -> None:
        """The transmission between the drive of a joint with `mimic` and the drive of its leader."""
        assert joint.mimic is not None
        leader, k, _ = joint.mimic
        other, part = self.robot.joints[leader], self.part_of[joint.name]
        leads, drive = self.drives[leader], self.drives[joint.name]
        coupling = self.name(f"{part}_coupling")
        turning, turned_by = joint.kind in TURNING, other.kind in TURNING
        what = f"mimics {self.part_of[leader]}"
        if not k:
            self.part(coupling, "FixedShaft" if turning else "Fixed", {}, what)
            self.nodes[drive].append(f"{coupling}.a")
        elif turning and turned_by:
            self.part(coupling, "Gear", {"i": quantity(k, "")}, what)
            self.nodes[drive].append(f"{coupling}.a")
            self.nodes[leads].append(f"{coupling}.b")
        elif not turning and not turned_by:
            self.part(coupling, "Lever", {"l_a": "1 m", "l_b": quantity(-k, "m")}, what)
            self.nodes[leads].append(f"{coupling}.a")
            self.nodes[drive].append(f"{coupling}.b")
            self.held["Fixed"].append(f"{coupling}.p")
        else:
            self.part(coupling, "Rack", {"r": quantity(abs(k) if turned_by else 1/abs(k), "m")}, what)
            shaft, rod = (leads, drive) if turned_by else (drive, leads)
            if k < 0:
                turn, between = self.name(f"{part}_reversal"), self.name(f"{part}_shaft")
                self.part(turn, "Gear", {"i": "-1"})
                self.nodes[shaft].append(f"{turn}.a")
                self.nodes[between] = [f"{turn}.b"]
                shaft = between
            self.nodes[shaft].append(f"{coupling}.a")
            self.nodes[rod].append(f"{coupling}.b")

    def holders(self) -> None:
        """The fixed ends of dampers, friction and levers: the first body of each joint."""
        for kind, ends in self.held.items():
            if ends:
                part = self.name("housing" if kind == "FixedShaft" else "guide")
                self.part(part, kind, {})
                self.nodes[self.name(f"{part}_end")] = [f"{part}.a", *ends]


def import_urdf(path: Path, folder: Path | None = None) -> Imported:
    """Translate a file into one diagram of library components, to be written into a folder, by default one that is named
    after the robot. Raises ModelError."""
    robot = read_urdf(path)
    imported = Imported(identifier(file_stem(path.stem)), path.stem)
    imported.files[f"{imported.name}.yaml"] = _Writer(robot, path, folder or Path(imported.name)).diagram(imported.name)
    imported.untranslated += robot.untranslated
    return imported
