"""The section `view:` of a diagram: shapes of an animation, at positions that are formulas of its variables."""

from __future__ import annotations

from dataclasses import dataclass

from heavebond.core.errors import Place, Problems
from heavebond.language import reading
from heavebond.language.definition import Formula
from heavebond.text.expression import parse_formula
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence

COLOURS = ("grey", "dark", "blue", "sea", "gas", "oil", "rock", "red", "green", "orange")
# required and optional entries of each kind of shape, and its colour
ENDS, MIDDLE = ("from", "to"), ("at", "size")
KINDS: dict[str, tuple[tuple[str, ...], tuple[str, ...], str]] = {
    "box": (MIDDLE, (), "grey"), "circle": (("at", "diameter"), ("turned",), "grey"), "line": (ENDS, (), "dark"),
    "beam": ((*ENDS, "width"), (), "grey"), "spring": (ENDS, ("width",), "dark"),
    "damper": (ENDS, ("width", "length"), "dark"), "cylinder": (ENDS, ("width", "length"), "oil"),
    "ground": (("at", "width"), (), "rock"), "level": (("at",), (), "sea"), "mark": (("at",), (), "red")}
PAIRS = ("at", "size", "from", "to")
WIDE = ("level", "mark")  # these extend across the whole picture, so one height places them
COMMON = ("is", "colour", "label")


@dataclass(frozen=True)
class ViewShape:
    """A shape: its kind, its places and sizes as formulas (pairs are x to the right and y upwards, in m; `turned` is an
    angle), its colour and its text."""

    name: str
    kind: str
    formulas: dict[str, tuple[Formula, ...]]
    colour: str
    label: str
    place: Place


def read_view(node: Node | None, problems: Problems) -> dict[str, ViewShape]:
    """The shapes in drawing order, background first."""
    entries = reading.mapping(node, "view", problems)
    shapes = {}
    for name, item in (entries.items if entries else {}).items():
        if entries and reading.identifier(entries.keys[name], "a shape", problems):
            shape = _shape(name, item, problems)
            if shape is not None:
                shapes[name] = shape
    return shapes


def _shape(name: str, item: Node, problems: Problems) -> ViewShape | None:
    entry = reading.mapping(item, f"'{name}'", problems, "Write `{is: box, at: [0, crown.x], size: [4 m, 1 m]}`.")
    if entry is None:
        return None
    before = len(problems.found)
    kind = reading.choice(entry.items.get("is"), "is", tuple(KINDS), problems)
    if not kind:
        if "is" not in entry.items:
            problems.add("key-missing", f"'{name}' needs the entry 'is'", entry.place,
                         hint=f"Write `is:` and one of {', '.join(KINDS)}.")
        return None
    needed, more, usual = KINDS[kind]
    reading.known_keys(entry, (*COMMON, *needed, *more), f"'{name}' ({kind})", problems, needed)
    formulas = {key: _formulas(entry, key, kind, problems) for key in (*needed, *more) if key in entry.items}
    colour = reading.choice(entry.items.get("colour"), "colour", COLOURS, problems) or usual
    label = reading.text(entry.items.get("label"), "label", problems)
    return ViewShape(name, kind, formulas, colour, label, entry.place) if len(problems.found) == before else None


def _formulas(entry: Mapping, key: str, kind: str, problems: Problems) -> tuple[Formula, ...]:
    node = entry.items[key]
    pair = key in PAIRS and kind not in WIDE
    items = node.items if isinstance(node, Sequence) else (node,)
    if len(items) != (2 if pair else 1):
        problems.add("view-pair" if pair else "view-one", f"`{key}` of a {kind} is {'two lengths' if pair else 'one value'}",
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
    tree = reading.parsed(parse_formula, content, place, problems)
    return None if tree is None else Formula(tree, content, place)
