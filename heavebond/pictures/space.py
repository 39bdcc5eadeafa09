"""Shapes of a `view:` in space: their positions, orientations and sizes over a run, and the default view of a diagram.

A solid (box, sphere, disc, mesh) is a body of unit size that is scaled by its `size`, turned by the unit quaternion `turn`
and moved to `at`. A bar (beam, line, spring, damper, cylinder, arrow) lies on the line between its points `from` and `to`.
Default lengths are relative to the extent of the machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial, reduce
from pathlib import Path

import numpy as np

from heavebond.core.errors import ModelError, Place, Problem, Problems, UsageError, listing, suggest
from heavebond.imports.mesh import read_mesh
from heavebond.language.definition import Formula, Point, ViewShape, renamed
from heavebond.language.view import EXAMPLES, INSTEAD, POINTS, TRIPLES, article
from heavebond.numerics.dae import Array, Assembly
from heavebond.text.expression import ExpressionProblem, names, parse_formula

MOST_TRIANGLES = 50_000  # of a mesh
SOLIDS, AREAS = ("box", "sphere", "disc", "mesh"), ("ground", "level")
BARS = ("beam", "line", "spring", "damper", "cylinder", "arrow")
THICK = 0.022  # default width of a bar relative to the extent of the machine
LONGEST = 0.25  # default length of the longest arrow of a shape, relative to the extent
BEYOND, SEA = 1.3, 2.5  # widths of the default ground and of a level relative to the extent
CAMERA = (np.radians(-55.0), np.radians(22.0))  # default azimuth and elevation of the camera in rad


@dataclass(frozen=True)
class Solid:
    """A shape in space over time. `courses` contains time series (k, n), in m and s, of `at`, `from` and `to` (points of the
    fixed frame), `turn` (a unit quaternion), `size`, `width`, `length` and `duration`. `faces` are the corners (m, 3) and
    the triangles (f, 3) of a mesh."""

    name: str
    kind: str
    colour: str
    label: str
    courses: dict[str, Array]
    faces: tuple[Array, Array] | None = None


@dataclass(frozen=True)
class Scene:
    """Solids in drawing order, the smallest and the largest x, y and z of all solids in m, and the azimuth and the elevation
    of the camera in rad."""

    solids: tuple[Solid, ...]
    edges: tuple[float, ...]
    camera: tuple[float, float]


def default_view(assembly: Assembly) -> dict[str, ViewShape]:
    """The default shapes that the components of a diagram declare; empty if no component has shapes."""
    shapes = [shape.placed(path, leaf.component) for path, leaf in assembly.flat.expanded.leaves.items()
              for shape in leaf.component.view.values()]
    return {shape.name: shape for shape in shapes}


def is_in_space(view: Mapping[str, ViewShape], assembly: Assembly) -> bool:
    """True if the shapes of a view are in space; ModelError if some are in a plane, or the diagram has no frames."""
    spatial = [shape for shape in view.values() if shape.spatial]
    if not spatial:
        return False
    if not _frames(assembly):
        problems = [_in_the_plane(shape) for shape in spatial]
        raise ModelError(problems)
    plane = [shape for shape in view.values() if shape.spatial is False]
    if plane:
        raise ModelError([Problem(
            "view-mixed", f"'{shape.name}' is in a plane, '{spatial[0].name}' in space", shape.place,
            f"Write {INSTEAD[shape.kind]} in place of `{shape.kind}`." if shape.kind in INSTEAD else
            "A point in space is a node, `boom`, a point in its axes, `[boom, 0, 0, 0.5 m]`, or `[1 m, 0, 0.5 m]`.")
            for shape in plane])
    return True


def _in_the_plane(shape: ViewShape) -> Problem:
    """The problem of a shape in space in a diagram without frames."""
    key, point = next(iter(shape.points.items()), ("", None))
    if point is None or shape.kind not in ("box", "beam", "line", "spring", "damper", "cylinder", "ground"):
        return Problem("view-space", f"'{shape.name}': {article(shape.kind)} is a shape in space, and this diagram has no "
                       "frames of the domain spatial", shape.place, "Machines in space have bodies of the library "
                       "`spatial`; see `heavebond library spatial`.")
    return Problem("view-pair", f"`{key}` of a {shape.kind} needs two lengths", point.place,
                   f"Write for example `{key}: [0, crown.x]`.")


def _frames(assembly: Assembly) -> list[str]:
    """Nodes and ports with an orientation."""
    first = {domain.orientation[0] for domain in assembly.model.library.domains.values() if domain.orientation}
    return [owner for owner, _, member in (name.rpartition(".") for name in assembly.flat.names) if member in first]


def resolved(view: Mapping[str, ViewShape], assembly: Assembly) -> dict[str, ViewShape]:
    """A view in space with three formulas for each vector; ModelError for frames that the diagram does not have."""
    problems, frames = Problems(), _frames(assembly)
    resolved_shapes: dict[str, ViewShape] = {}
    for name, shape in view.items():
        for point in shape.points.values():
            if point.frame and point.frame not in frames:
                _add_frame_problem(point, frames, assembly, problems)
            first = point.coordinates[0].text if point.coordinates and not point.frame else ""
            if first in frames:
                coordinates = ", ".join(formula.text for formula in point.coordinates)
                problems.add("view-point", f"'{first}' is a frame, and three coordinates along its axes follow it",
                             point.place, hint=f"Write for example `[{coordinates}, 0]`.")
        formulas = {key: _elements(shape, key, part, assembly, problems) if key in TRIPLES and len(part) == 1 else part
                    for key, part in shape.formulas.items()}
        resolved_shapes[name] = replace(shape, formulas=formulas)
    problems.raise_as(ModelError)
    return resolved_shapes


def _add_frame_problem(point: Point, frames: list[str], assembly: Assembly, problems: Problems) -> None:
    flat, name = assembly.flat, point.frame
    nodes, owner = [frame for frame in frames if frame in flat.expanded.junctions], name.rpartition(".")[0]
    ports = [frame for frame in frames if frame.rpartition(".")[0] == name]
    domain = flat.domains.get(name) if name in flat.expanded.junctions else None
    if domain is not None:
        message, hint = f"'{name}' is a node of the domain {domain.name}; a point in space needs a node of the " \
            "domain spatial", f"Nodes: {listing(nodes)}."
    elif ports:
        message, hint = f"'{name}' is a part; a point in space needs a node or a port", f"Write {listing(ports, 4)}."
    else:
        message, hint = f"no node or port of the domain spatial is called '{name}'", \
            (f"Write `{owner}`." if owner in frames else
             suggest(name, nodes) or suggest(name, frames) or f"Nodes: {listing(nodes)}.")
    problems.add("view-frame", message, point.place, hint=hint)


def _elements(shape: ViewShape, key: str, part: tuple[Formula, ...], assembly: Assembly,
              problems: Problems) -> tuple[Formula, ...]:
    """The three components of a formula of vectors: lists of a part (`body.L`) and vectors of a port (`rope.b.F`)."""
    formula, resolver = part[0], assembly.resolver()

    def is_known(name: str) -> bool:
        try:
            resolver.evaluate(parse_formula(name))
        except ExpressionProblem:
            return False
        return True

    vectors = {v: members for domain in assembly.model.library.domains.values() for v, members in domain.vectors.items()}

    def element(k: int, name: str) -> str:
        owner, _, vector = name.rpartition(".")
        member = f"{owner}.{vectors[vector][k]}" if vector in vectors else name
        return name if is_known(name) else next(filter(is_known, (member, f"{name}[{k + 1}]")), name)

    elements = tuple(renamed(formula, partial(element, k)) for k in range(3))
    if len({e.text for e in elements}) == 1 and all(is_known(name.text) for name in names(formula.tree)):
        problems.add("view-triple", f"`{key}` of '{shape.name}' needs three values", formula.place,
                     hint=f"Write for example `{key}: {EXAMPLES[key]}`"
                          f"{', or the vector of a port, `-rope.b.F`' if key == 'vector' else ''}.")
    return elements


def frame_names(view: Mapping[str, ViewShape], assembly: Assembly) -> list[str]:
    """The variables of all frames of a view."""
    domain = next(d for d in assembly.model.library.domains.values() if d.orientation)
    frames = dict.fromkeys(point.frame for shape in view.values() for point in shape.points.values() if point.frame)
    return [f"{frame}.{member}" for frame in frames for member in (*domain.positions, *domain.orientation)]


def scene(view: Mapping[str, ViewShape], courses: Mapping[str, Array], n: int, assembly: Assembly, *,
          ground: bool) -> Scene:
    """The solids of a resolved view, from the time series (n,) of its formulas and of `frame_names`; `ground` adds a
    ground."""
    domain = next(d for d in assembly.model.library.domains.values() if d.orientation)
    placed: dict[str, dict[str, Array]] = {}
    for name, shape in view.items():
        values = {key: np.nan_to_num(np.array([courses[f.text] for f in part]), posinf=0.0, neginf=0.0)
                  for key, part in shape.formulas.items()}
        turn = np.repeat([[1.0], [0.0], [0.0], [0.0]], n, axis=1)
        for key, point in shape.points.items():
            local = np.array([courses[f.text] for f in point.coordinates] or np.zeros((3, n)))
            if point.frame:
                turn = np.array([courses[f"{point.frame}.{member}"] for member in domain.orientation])
                turn = turn / np.linalg.norm(turn, axis=0)
                local = rotated(turn, local) + [courses[f"{point.frame}.{member}"] for member in domain.positions]
            values[key] = np.nan_to_num(local)
        placed[name] = {**values, "turn": turn}
    if not any(key in c and len(c[key]) == 3 for c in placed.values() for key in POINTS):
        raise UsageError([Problem("view-empty", "a view of levels and a camera alone has no width", None, "Add a box.")])
    points = np.concatenate([c[key] for c in placed.values() for key in POINTS if key in c and len(c[key]) == 3], axis=1)
    low, high = points.min(axis=1), points.max(axis=1)
    extent = float(np.max(high - low)) or max((float(c["size"].max()) for c in placed.values() if "size" in c), default=1.0)
    solids = []
    for name, shape in view.items():
        if shape.kind != "camera":
            course = _completed(shape.kind, placed[name], extent, n)
            faces = None if shape.file is None else _mesh(shape.file, shape.place)
            solids.append(Solid(name, shape.kind, shape.colour, shape.label, course, faces))
    low, high = _bounds(solids)
    middle, reach = (low + high) / 2, float(np.max((high - low)[:2], initial=0.5 * float(np.max(high - low))))
    for solid in solids:
        if solid.kind == "level":
            height = solid.courses["at"][0]
            solid.courses.update(at=np.array([np.full(n, middle[0]), np.full(n, middle[1]), height]),
                                 size=np.array([np.full(n, SEA * reach), np.full(n, SEA * reach), np.zeros(n)]))
        if solid.kind == "ground" and "width" not in placed[solid.name]:
            at = solid.courses["at"].mean(axis=1)
            width = BEYOND * 2 * float(np.max(np.abs([low - at, high - at])[:, :2]))
            solid.courses["size"] = np.repeat([[width], [width], [0.0]], n, axis=1)
    if ground:
        at = np.repeat([[middle[0]], [middle[1]], [low[2]]], n, axis=1)
        size = np.repeat([[BEYOND * reach], [BEYOND * reach], [0.0]], n, axis=1)
        solids.insert(0, Solid("ground", "ground", "rock", "", {"at": at, "size": size}))
    low, high = _bounds([solid for solid in solids if solid.kind != "level"] or solids)
    if float(np.max(high - low)) < 1e-9:  # a single point
        low, high = low - 0.5, high + 0.5
    camera = next((c for name, c in placed.items() if view[name].kind == "camera"), {})
    angles = tuple(float(camera[key][0, 0]) if key in camera else usual
                   for key, usual in zip(("azimuth", "elevation"), CAMERA, strict=True))
    return Scene(tuple(solids), (*low.tolist(), *high.tolist()), (angles[0], angles[1]))


def _completed(kind: str, course: dict[str, Array], extent: float, n: int) -> dict[str, Array]:
    """The time series of a shape, completed by default lengths."""
    thick = np.full((1, n), THICK * extent)
    if kind in BARS and kind != "arrow":
        length = np.linalg.norm(course["to"] - course["from"], axis=0)
        # by default the mean position of the piston is the middle of its barrel
        barrel = course.get("length", np.full((1, n), 2 / 3 * float(np.mean(length))))
        usual = {"spring": 3.0, "cylinder": 2.0, "damper": 2.0}.get(kind, 1.0)
        return {"from": course["from"], "to": course["to"], "width": course.get("width", usual * thick), "length": barrel}
    if kind == "arrow":
        largest = float(np.max(np.linalg.norm(course["vector"], axis=0)))
        scale = course.get("scale", np.full((1, n), largest / (LONGEST * extent)))
        scale = np.where(scale == 0.0, np.inf, scale)
        return {"from": course["at"], "to": course["at"] + course["vector"] / scale, "width": 0.6 * thick}
    if kind == "trace":
        return {"at": course["at"], "duration": course.get("duration", np.full((1, n), 0.0))}
    if kind == "ground":
        width = course["width"][0] if "width" in course else np.zeros(n)  # without a width that of the machine, see `scene`
        return {"at": course["at"], "size": np.array([width, width, np.zeros(n)])}
    if kind == "level":
        return {"at": course["at"]}
    turn = course["turn"]
    if "turned" in course:
        turn = product(turn, cardan(*course["turned"]))
    if "axis" in course:
        turn = product(turn, to_axis(course["axis"]))
    if kind == "box":
        size = course["size"]
    elif kind == "mesh":
        size = np.repeat(course.get("unit", np.ones((1, n))), 3, axis=0)
    elif kind == "sphere":
        size = np.repeat(course.get("diameter", 1.6 * thick), 3, axis=0)
    else:
        across = course.get("diameter", 2.2 * thick)
        size = np.concatenate([across, across, course.get("width", 0.4 * across if "diameter" in course else 1.6 * thick)])
    return {"at": course["at"], "turn": turn, "size": np.maximum(size, 1e-6 * extent)}


def _mesh(file: Path, place: Place) -> tuple[Array, Array]:
    """The corners and the triangles of a file."""
    mesh = read_mesh(file, place)
    triangles = np.asarray(mesh.faces, int)
    if len(triangles) > MOST_TRIANGLES:
        raise UsageError([Problem("mesh-large", f"'{file.name}' has {len(triangles)} triangles; the most is "
                                  f"{MOST_TRIANGLES}", place, "Simplify the mesh in the program that wrote it.")])
    return np.asarray(mesh.vertices, float), triangles


def _bounds(solids: list[Solid]) -> tuple[Array, Array]:
    """The lowest and the highest x, y and z (3,) of all solids over the run."""
    lows, highs = list[Array](), list[Array]()
    for solid in solids:
        c = solid.courses
        if solid.faces is not None:
            half = float(np.max(np.linalg.norm(solid.faces[0], axis=1))) * c["size"]
            lows, highs = [*lows, (c["at"] - half).min(axis=1)], [*highs, (c["at"] + half).max(axis=1)]
            continue
        if solid.kind in SOLIDS:
            axes = [np.abs(rotated(c["turn"], np.repeat(np.eye(3)[:, [k]], c["at"].shape[1], axis=1))) for k in range(3)]
            half = sum((axis * size for axis, size in zip(axes, c["size"], strict=True)), np.zeros((3, 1))) / 2
            lows, highs = [*lows, (c["at"] - half).min(axis=1)], [*highs, (c["at"] + half).max(axis=1)]
            continue
        for key in ("from", "to", "at"):
            if key in c and len(c[key]) == 3:
                half = c["size"] / 2 if "size" in c else c["width"] / 2 if solid.kind == "beam" else np.zeros((3, 1))
                lows, highs = [*lows, (c[key] - half).min(axis=1)], [*highs, (c[key] + half).max(axis=1)]
    return np.min(lows, axis=0), np.max(highs, axis=0)


# -- rotations: unit quaternions (4, n), vectors (3, n) --------------------------------------------------------------------
def product(p: Array, q: Array) -> Array:
    """The quaternion product: the rotation q, followed by p."""
    a, b, c, d = p
    e, f, g, h = q
    return np.array([a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g, a * g - b * h + c * e + d * f,
                     a * h + b * g - c * f + d * e])


def rotated(q: Array, v: Array) -> Array:
    """A vector rotated by q."""
    across = 2.0 * np.cross(q[1:], v, axis=0)
    return np.asarray(v + q[0] * across + np.cross(q[1:], across, axis=0))


def cardan(roll: Array, pitch: Array, yaw: Array) -> Array:
    """The rotation by Cardan angles: about x, after pitch and yaw."""
    turns = []
    for axis, angle in ((3, yaw), (2, pitch), (1, roll)):
        turn = np.zeros((4, len(angle)))
        turn[0], turn[axis] = np.cos(angle / 2), np.sin(angle / 2)
        turns.append(turn)
    return reduce(product, turns)


def to_axis(axis: Array) -> Array:
    """The smallest rotation of z to an axis (3, n)."""
    length = np.linalg.norm(axis, axis=0)
    x, y, z = axis / np.where(length > 0, length, 1.0)
    turn = np.array([1.0 + z, -y, x, 0.0 * z])
    turn[:, np.linalg.norm(turn, axis=0) < 1e-9] = [[0.0], [1.0], [0.0], [0.0]]
    return np.asarray(turn / np.linalg.norm(turn, axis=0))
