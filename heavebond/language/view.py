"""The section `view:` of a diagram: shapes of an animation, at positions that are formulas of its variables.

A view is in a plane, with positions `[x, y]`, or in space. A point in space is a frame (`boom`, a node or a port of a domain
with an orientation), a point in the axes of a frame (`[boom, 0, 0, 0.5 m]`), or a point in the fixed frame (`[1 m, 0, 0.5
m]`). Component files have the same section, with ports as frames. It contains the shapes of their parts in a diagram without
a view.
"""

from __future__ import annotations

import re
from pathlib import Path

from heavebond.core.errors import Problems
from heavebond.language import reading
from heavebond.language.definition import Formula, Point, ViewShape
from heavebond.text.expression import parse_formula
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence

COLOURS = ("grey", "dark", "blue", "sea", "gas", "oil", "rock", "red", "green", "orange")
# required and optional entries of each kind of shape, and its colour
ENDS, MIDDLE = ("from", "to"), ("at", "size")
Kinds = dict[str, tuple[tuple[str, ...], tuple[str, ...], str]]
KINDS: Kinds = {
    "box": (MIDDLE, (), "grey"), "circle": (("at", "diameter"), ("turned",), "grey"), "line": (ENDS, (), "dark"),
    "beam": ((*ENDS, "width"), (), "grey"), "spring": (ENDS, ("width",), "dark"),
    "damper": (ENDS, ("width", "length"), "dark"), "cylinder": (ENDS, ("width", "length"), "oil"),
    "ground": (("at", "width"), (), "rock"), "level": (("at",), (), "sea"), "mark": (("at",), (), "red")}
SPATIAL_KINDS: Kinds = {
    "box": (MIDDLE, ("turned",), "grey"), "sphere": (("at",), ("diameter",), "grey"),
    "disc": (("at",), ("axis", "diameter", "width"), "grey"), "beam": (ENDS, ("width",), "grey"),
    "line": (ENDS, (), "dark"), "spring": (ENDS, ("width",), "dark"), "damper": (ENDS, ("width", "length"), "dark"),
    "cylinder": (ENDS, ("width", "length"), "oil"), "mesh": (("at", "file"), ("unit", "turned"), "grey"),
    "arrow": (("at", "vector"), ("scale",), "red"), "trace": (("at",), ("duration",), "blue"),
    "ground": (("at",), ("width",), "rock"), "level": (("at",), (), "sea"),
    "camera": ((), ("azimuth", "elevation"), "grey")}
ALL_KINDS = tuple(dict.fromkeys((*KINDS, *SPATIAL_KINDS)))
INSTEAD = {"circle": "`disc` or `sphere`", "mark": "`level`"}  # shapes in space in place of shapes in a plane
PAIRS = ("at", "size", "from", "to")
POINTS = ("at", "from", "to")
TRIPLES = ("size", "turned", "axis", "vector")  # in space
EXAMPLES = {"size": "[0.2 m, 0.2 m, 0.6 m]", "turned": "[0, 90 deg, 0]", "axis": "[0, 1, 0]",
            "vector": "[0, 0, -9.81 m/s**2*load.m]", "azimuth": "-60 deg", "elevation": "25 deg", "duration": "2 s",
            "scale": "10 kN/m", "unit": "1 mm"}
WIDE = ("level", "mark")  # these extend across the whole picture, so one height places them
COMMON = ("is", "colour", "label")
MESHES = (".stl", ".obj", ".glb", ".gltf")
UNIT = re.compile(r"[a-z]+")  # unit of a mesh, without a number
FRAME = re.compile(r"[A-Za-z_]\w*(\[[0-9]+\])?(\.[A-Za-z_]\w*(\[[0-9]+\])?)*")


def read_view(node: Node | None, problems: Problems, folder: Path | None = None) -> dict[str, ViewShape]:
    """The shapes in drawing order, background first; `folder` is the folder of the file."""
    entries = reading.mapping(node, "view", problems)
    shapes = {}
    for name, item in (entries.items if entries else {}).items():
        if entries and reading.identifier(entries.keys[name], "a shape", problems):
            shape = _shape(name, item, folder or Path(), problems)
            if shape is not None:
                shapes[name] = shape
    return shapes


def _shape(name: str, item: Node, folder: Path, problems: Problems) -> ViewShape | None:
    entry = reading.mapping(item, f"'{name}'", problems, "Write `{is: box, at: [0, crown.x], size: [4 m, 1 m]}`.")
    if entry is None:
        return None
    before = len(problems.found)
    kind = reading.choice(entry.items.get("is"), "is", ALL_KINDS, problems)
    if not kind:
        if "is" not in entry.items:
            problems.add("key-missing", f"'{name}' needs the entry 'is'", entry.place,
                         hint=f"Write `is:` and one of {', '.join(ALL_KINDS)}.")
        return None
    pointed = any(_is_spatial(entry.items.get(key)) for key in POINTS)
    if pointed and kind in INSTEAD and kind not in WIDE:
        problems.add("view-kind", f"'{name}': a {kind} is a shape in a plane, at `[x, y]`", entry.place,
                     hint=f"In space write {INSTEAD[kind]}.")
        return None
    spatial = kind not in KINDS or (pointed and kind not in WIDE)
    needed, more, usual = (SPATIAL_KINDS if spatial else KINDS)[kind]
    reading.known_keys(entry, (*COMMON, *needed, *more), f"'{name}' ({kind})", problems, needed)
    keys = [key for key in (*needed, *more) if key in entry.items]
    points: dict[str, Point] = {}
    file: Path | None = None
    if spatial:
        points = {key: point for key in keys if key in POINTS
                  and (point := _point(entry, key, kind, problems)) is not None}
        if "file" in keys:
            file = folder / reading.text(entry.items["file"], "file", problems)
    formulas = {key: _formulas(entry, key, kind, spatial, problems) for key in keys
                if key != "file" and not (spatial and key in POINTS)}
    colour = reading.choice(entry.items.get("colour"), "colour", COLOURS, problems) or usual
    label = reading.text(entry.items.get("label"), "label", problems)
    if len(problems.found) > before:
        return None
    return ViewShape(name, kind, formulas, colour, label, entry.place, None if kind == "level" else spatial, points, file)


def article(kind: str) -> str:
    """A kind of shape with its article."""
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def _is_spatial(node: Node | None) -> bool:
    """True for a node that is a frame or has more than two coordinates."""
    return (isinstance(node, Scalar) and FRAME.fullmatch(node.text) is not None) or \
        (isinstance(node, Sequence) and len(node.items) > 2)


def _point(entry: Mapping, key: str, kind: str, problems: Problems) -> Point | None:
    node = entry.items[key]
    if isinstance(node, Scalar) and FRAME.fullmatch(node.text):
        return Point(node.text, (), node.place)
    if isinstance(node, Sequence):
        first = node.items[0] if node.items else None
        frame = first.text if isinstance(first, Scalar) and FRAME.fullmatch(first.text) and len(node.items) == 4 else ""
        items = node.items[1:] if frame else node.items
        if len(items) == 3:
            return Point(frame, tuple(f for f in (_formula(item, key, problems) for item in items) if f is not None),
                         first.place if first is not None and frame else node.place)
    problems.add("view-point", f"`{key}` of {article(kind)} needs a point in space", node.place,
                 hint=f"Write a node, `{key}: boom`, a point in its axes, `{key}: [boom, 0, 0, 0.5 m]`, or a fixed point, "
                      f"`{key}: [1 m, 0, 0.5 m]`.")
    return None


def _formulas(entry: Mapping, key: str, kind: str, spatial: bool, problems: Problems) -> tuple[Formula, ...]:
    node = entry.items[key]
    items = node.items if isinstance(node, Sequence) else (node,)
    if spatial:
        triple = key in TRIPLES
        if len(items) != 1 and len(items) != (3 if triple else 1):
            problems.add("view-triple" if triple else "view-one",
                         f"`{key}` of {article(kind)} in space needs {'three values' if triple else 'one value'}",
                         node.place,

                         hint=f"Write for example `{key}: {EXAMPLES.get(key, '0.1 m')}`."
                              + (" In a plane, places are `[x, y]`." if len(items) == 2 and kind in KINDS else ""))
            return ()
    else:
        pair = key in PAIRS and kind not in WIDE
        if len(items) != (2 if pair else 1):
            problems.add("view-pair" if pair else "view-one",
                         f"`{key}` of a {kind} needs {'two lengths' if pair else 'one value'}",
                         node.place, hint=f"Write for example `{key}: {'[0, crown.x]' if pair else '2 m'}`.")
            return ()
    return tuple(f for f in (_formula(item, key, problems) for item in items) if f is not None)


def _formula(item: Node, key: str, problems: Problems) -> Formula | None:
    if not isinstance(item, Scalar):
        problems.add("not-a-value", f"`{key}` holds {item.kind}; a length is expected", item.place,
                     hint="Write for example `2 m` or `crown.x + 12 m`.")
        return None
    place = item.place.moved(1 if item.quoted else 0, len(item.text))
    content, place = (item.text[1:], place.moved(1)) if item.text.startswith("=") else (item.text, place)
    if key == "unit" and UNIT.fullmatch(content):
        content = f"1 {content}"
    tree = reading.parsed(parse_formula, content, place, problems)
    return None if tree is None else Formula(tree, content, place)
