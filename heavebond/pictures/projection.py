"""Perspective pictures of machines in space: the solids as flat polygons, sorted from the farthest to the nearest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from matplotlib.colors import to_rgb

from heavebond.numerics.dae import Array
from heavebond.pictures.space import AREAS, SOLIDS, Solid, rotated, to_axis

ROUND, BALL, TURNS, STEPS = 20, 14, 8, 12  # corners of a circle and of a ball, coils of a spring, corners of a coil
DISTANCE = 3.2  # distance of the camera from the middle, relative to the radius of the scene
LIGHT = np.array([0.35, -0.55, 0.76])  # direction to the lamp
PARTS = 5  # largest number of parts of an edge of a box
CELLS = 10  # largest number of squares along an edge of the ground
NEARER = 0.012  # reduction of the depth of lines, relative to the radius of the scene: they cover faces of equal depth
BORDER = 0.8  # width in points of the edges of a box
SEAM = 0.3  # width in points of the edge of a face in the colour of the face; it covers the gap to the next face


class Piece(NamedTuple):
    """A face or a line of a solid: its corners (m, 3) in m, its `look`, and the width of its edge in points (0: no edge).

    `inside` is a point of the convex body of the face; it determines the outer side of the face, and faces whose outer side
    is not visible are hidden. `borders` are the first corners of the edges that are drawn separately.
    """

    corners: Array
    look: str
    width: float = 0.0
    inside: Array | None = None
    borders: tuple[int, ...] = ()


Colour = tuple[float, ...]


@dataclass(frozen=True)
class Polygon:
    """A polygon (m, 2) in the picture, or a line if `face` is None, with its colours and the width of its edge in points."""

    corners: Array
    face: Colour | None
    edge: Colour | None
    width: float


class _Paint(NamedTuple):
    """A polygon (m, 3) in m with its depth, its colours and the width of its edge in the picture."""

    corners: Array
    depth: float
    face: Colour | None
    edge: Colour | None
    width: float


@dataclass(frozen=True)
class Camera:
    """A camera that looks at `middle` (3,) from the direction `back` (3,); a sphere of `radius` fills its picture."""

    middle: Array
    radius: float
    azimuth: float
    elevation: float

    @property
    def axes(self) -> Array:
        """The unit vectors to the right, upwards and towards the camera, (3, 3)."""
        a, e = self.azimuth, self.elevation
        back = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return np.array([right, np.cross(back, right), back])

    def seen(self, points: Array) -> Array:
        """Points (m, 3) in the picture: x and y in radii of the scene, and the depth."""
        local = (points - self.middle) @ self.axes.T / self.radius
        depth = np.maximum(DISTANCE - local[:, 2], 1e-3)
        return np.column_stack([local[:, :2] * (DISTANCE / depth)[:, None], depth])


def polygons(solids: tuple[Solid, ...], k: int, times: Array, camera: Camera,
             colours: dict[str, tuple[str, str, str]]) -> list[Polygon]:
    """The polygons of all solids at frame k in drawing order: the polygons behind a level, the level, the polygons in front
    of it. Both groups are sorted from the farthest to the nearest."""
    eye = camera.middle + DISTANCE * camera.radius * camera.axes[2]
    water = next((float(solid.courses["at"][2, k]) for solid in solids if solid.kind == "level"), None)
    owned = [(piece, solid.colour) for solid in solids for piece in _pieces(solid, k, times)]
    if not owned:
        return []
    # the faces whose outer side is visible, and their brightness
    flat = np.array([piece.look in ("full", "soft", "dark") for piece, _ in owned])
    first = np.array([piece.corners[:3] if i else np.zeros((3, 3)) for (piece, _), i in zip(owned, flat, strict=True)])
    normal, towards = np.cross(first[:, 1] - first[:, 0], first[:, 2] - first[:, 0]), eye - first[:, 0]
    away = np.array([towards[i] if piece.inside is None else first[i].mean(axis=0) - piece.inside
                     for i, (piece, _) in enumerate(owned)])
    outward = normal * np.where(np.einsum("ij,ij->i", normal, away) < 0, -1.0, 1.0)[:, None]
    size = np.linalg.norm(normal, axis=1)
    shown = ~flat | ((size > 0) & (np.einsum("ij,ij->i", outward, towards) > 0))
    bright = 0.72 + 0.28 * np.maximum(0.0, outward @ LIGHT / np.where(size > 0, size, 1.0))
    corners_of = np.cumsum([0, *(len(piece.corners) for piece, _ in owned)])
    all_depths = camera.seen(np.concatenate([piece.corners for piece, _ in owned]))[:, 2]
    depths = np.add.reduceat(all_depths, corners_of[:-1]) / np.diff(corners_of)
    paints: list[_Paint] = []
    levels: list[Polygon] = []
    for i, (piece, colour) in enumerate(owned):
        edge, face, pale = (to_rgb(c) for c in colours[colour])
        if piece.look == "line":
            paints.append(_Paint(piece.corners, depths[i] - NEARER, None, edge, piece.width))
        elif piece.look == "floor":
            paints.append(_Paint(piece.corners, 1e3, None, (*(0.5 + 0.5 * c for c in edge), 0.6), piece.width))
        elif piece.look == "water":
            levels.append(Polygon(camera.seen(piece.corners)[:, :2], (*face, 0.4), None, 0.0))
        elif shown[i]:
            base = {"full": face, "soft": pale, "dark": edge}[piece.look]
            lit = tuple(min(1.0, c * float(bright[i])) for c in base)
            paints.append(_Paint(piece.corners, depths[i], lit, edge if piece.width else lit, piece.width or SEAM))
            paints += [_Paint(piece.corners[[j, (j + 1) % len(piece.corners)]], depths[i] - 1e-6, None, edge, BORDER)
                       for j in piece.borders]
    # divided by the level, from the farthest to the nearest
    parts = paints if water is None else [paint._replace(corners=part) for paint in paints for side in (-1.0, 1.0)
                                          if len(part := _cut(paint.corners, water, side)) > 1]
    if not parts:
        return levels
    counts = np.array([len(part.corners) for part in parts])
    seen = camera.seen(np.concatenate([part.corners for part in parts]))
    begin = np.cumsum(counts) - counts
    depth = np.array([part.depth for part in parts])
    before = np.zeros(len(parts), bool) if water is None else \
        np.array([(float(part.corners[:, 2].mean()) > water) == (eye[2] > water) for part in parts])
    order = np.lexsort((-depth, before))
    ordered = [Polygon(seen[begin[i]:begin[i] + counts[i], :2], parts[i].face, parts[i].edge, parts[i].width) for i in order]
    behind = int(np.count_nonzero(~before))
    return [*ordered[:behind], *levels, *ordered[behind:]]


def _cut(corners: Array, height: float, side: float) -> Array:
    """The part of a convex polygon or of a line that is above a height (`side` 1) or below it (-1)."""
    above = side * (corners[:, 2] - height)
    if (above >= 0).all():
        return corners
    remaining: list[Array] = []
    for j in range(len(corners) if (above > 0).any() else 0):
        i = j - 1
        if (above[i] > 0) != (above[j] > 0) and (len(corners) > 2 or j > 0):
            remaining.append(corners[i] + above[i] / (above[i] - above[j]) * (corners[j] - corners[i]))
        if above[j] > 0:
            remaining.append(corners[j])
    return np.array(remaining).reshape(-1, 3)


def middle(solid: Solid, k: int) -> Array:
    """The point (3,) of a solid at frame k at which its label is written."""
    c = solid.courses
    return np.asarray((c["from"][:, k] + c["to"][:, k]) / 2 if "from" in c else c["at"][:, k])


def _pieces(solid: Solid, k: int, times: Array) -> list[Piece]:
    """Polygons and lines of a solid in m."""
    c = {key: course[:, k] for key, course in solid.courses.items()}
    if solid.kind in SOLIDS:
        def placed(points: Array) -> Array:
            return np.asarray(rotated(c["turn"][:, None], (points * c["size"]).T).T + c["at"])

        if solid.kind == "mesh" and solid.faces is not None:
            vertices = placed(solid.faces[0])
            return [Piece(vertices[triangle], "full", 0.0) for triangle in solid.faces[1]]
        unit = _box(c["size"]) if solid.kind == "box" else {"sphere": _sphere, "disc": _disc}[solid.kind]()
        ends = np.cumsum([len(piece.corners) for piece in unit])
        corners = np.split(placed(np.concatenate([piece.corners for piece in unit])), ends[:-1])
        return [piece._replace(corners=own, inside=c["at"]) for piece, own in zip(unit, corners, strict=True)]
    if solid.kind == "trace":
        begin = times[k] - c["duration"][0] if c["duration"][0] > 0 else times[0]
        path = solid.courses["at"].T[(times >= begin) & (np.arange(len(times)) <= k)][::max(1, k // 400)]
        path = np.vstack([path, c["at"]])
        return [Piece(path[j:j + 2], "line", 1.2) for j in range(len(path) - 1)]
    if solid.kind in AREAS:
        half = c["size"][:2] / 2
        corners = c["at"] + np.array([(x * half[0], y * half[1], 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
        if solid.kind == "ground":
            return _grid(c["at"], float(c["size"][0]))
        return [Piece(corners, "water")]
    return _bar(solid.kind, c)


def _bar(kind: str, c: dict[str, Array]) -> list[Piece]:
    a, b = c["from"], c["to"]
    length = float(np.linalg.norm(b - a))
    if length == 0.0 or not np.isfinite(length):
        return []
    along, width = (b - a) / length, float(c["width"][0])
    turn = to_axis(along[:, None])

    def tube(begin: float, end: float, one: float, other: float | None = None, look: str = "full") -> list[Piece]:
        """A round bar between two distances from a, with the diameters at its ends."""
        corners = []
        for at, across in ((begin, one), (end, one if other is None else other)):
            angle = 2 * np.pi * np.arange(ROUND // 2) / (ROUND // 2)
            ring = np.array([across / 2 * np.cos(angle), across / 2 * np.sin(angle), np.full(len(angle), at)])
            corners.append(rotated(turn, ring).T + a)
        low, high = corners
        inside = (low.mean(axis=0) + high.mean(axis=0)) / 2
        sides = [Piece(np.array([low[j - 1], low[j], high[j], high[j - 1]]), look, 0.0, inside)
                              for j in range(len(low))]
        return [*sides, Piece(low, look, 0.6, inside), Piece(high, look, 0.6, inside)]

    if kind == "line":
        parts = np.linspace(0.0, 1.0, 9)[:, None]
        path = a + parts * (b - a)
        return [Piece(path[j:j + 2], "line", 1.4) for j in range(8)]
    if kind == "beam":
        pieces = max(1, min(8, int(length / (3 * width)))) if width > 0 else 1
        ends = np.linspace(0.0, length, pieces + 1)
        return [piece for j in range(pieces) for piece in tube(ends[j], ends[j + 1], width)
                if piece[2] == 0.0 or j in (0, pieces - 1)]
    if kind == "arrow":
        head = min(3.5 * width, length)
        return [*tube(0.0, length - head, 0.6 * width, look="dark"), *tube(length - head, length, 2.0 * width, 0.0, "dark")]
    if kind == "spring":
        turns = np.linspace(0.0, 1.0, TURNS * STEPS + 1)
        angle = 2 * np.pi * TURNS * turns
        ring = width / 2 * np.array([np.cos(angle), np.sin(angle)])
        coil = np.vstack([ring, length * (0.1 + 0.8 * turns)])
        ends = np.array([[0, 0, 0], [0, 0, 0.1 * length], [0, 0, 0.9 * length], [0, 0, length]]).T
        path = rotated(turn, np.column_stack([ends[:, :2], coil, ends[:, 2:]])).T + a
        return [Piece(path[j:j + 2], "line", 1.4) for j in range(len(path) - 1)]
    barrel = float(min(c["length"][0], length))
    rod = 0.45 * width if kind == "cylinder" else 0.25 * width
    return [*tube(0.0, barrel, width, look="full"), *tube(barrel, length, rod, look="soft")]


def _grid(at: Array, width: float) -> list[Piece]:
    cell = cell_size(width)
    most = int(width / 2 / cell * (1 + 1e-9))  # 0.6/0.2 is below 3 by rounding
    half = most * cell
    lines = []
    for k in range(-most, most + 1):
        for axis in (0, 1):
            ends = np.repeat([at], 2, axis=0)
            ends[:, axis] += k * cell
            ends[:, 1 - axis] += np.array([-half, half])
            lines.append(Piece(ends, "floor", 0.6))
    return lines


def cell_size(width: float) -> float:
    """The edge of the squares of the ground: 1, 2 or 5 times a power of ten."""
    ten = 10.0 ** np.floor(np.log10(width / CELLS))
    return float(next((f * ten for f in (1, 2, 5) if width / (f * ten) <= CELLS), 10 * ten))


def _box(size: Array) -> list[Piece]:
    """The faces of a box, divided into parts of similar length, so that their depths sort correctly among other solids."""
    faces: list[Piece] = []
    parts = np.clip(np.round(size / max(float(np.median(size)), 0.2 * float(size.max()))), 1, PARTS).astype(int)
    steps = [np.linspace(-0.5, 0.5, n + 1) for n in parts]
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        for side in (-0.5, 0.5):
            for i, (a, b) in enumerate(pairwise(steps[one])):
                for j, (c, d) in enumerate(pairwise(steps[other])):
                    corners = np.full((4, 3), side)
                    corners[:, [one, other]] = [(a, c), (b, c), (b, d), (a, d)]
                    outer = (j == 0, i == parts[one] - 1, j == parts[other] - 1, i == 0)
                    faces.append(Piece(corners, "full", 0.0, np.zeros(3), tuple(k for k in range(4) if outer[k])))
    return faces


@cache
def _disc() -> list[Piece]:
    angle, inside = 2 * np.pi * np.arange(ROUND) / ROUND, np.zeros(3)
    ring = 0.5 * np.array([np.cos(angle), np.sin(angle)]).T
    low, high = (np.column_stack([ring, np.full(ROUND, z)]) for z in (-0.5, 0.5))
    sides = [Piece(np.array([low[j - 1], low[j], high[j], high[j - 1]]), "full", 0.0, inside) for j in range(ROUND)]
    # each cap begins in the middle, along a spoke that shows the rotation of the disc, and continues around
    caps = [np.vstack([[0.0, 0.0, z], ring, ring[:1]]) for z, ring in ((-0.5, low), (0.5, high))]
    return [*sides, *(Piece(cap, "full", 0.7, inside) for cap in caps)]


@cache
def _sphere() -> list[Piece]:
    angle, height = 2 * np.pi * np.arange(BALL) / BALL, np.pi * np.arange(BALL // 2 + 1) / (BALL // 2)
    points = 0.5 * np.array([[(np.sin(h) * np.cos(t), np.sin(h) * np.sin(t), np.cos(h)) for t in angle] for h in height])
    last = BALL // 2 - 1
    # triangles at the poles
    rows = [([1, 1, 0], [-1, 0, 0]) if i == 0 else ([i, i, last + 1], [-1, 0, 0]) if i == last else
            ([i, i, i + 1, i + 1], [-1, 0, 0, -1]) for i in range(last + 1)]
    return [Piece(points[row, [j + k for k in columns]], "full", 0.0, np.zeros(3))
            for row, columns in rows for j in range(BALL)]
