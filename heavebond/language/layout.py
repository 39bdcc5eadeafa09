"""The section `layout:` of a diagram or block: exact places of its parts, pieces of wires that are fixed, and notes."""

from __future__ import annotations

from collections.abc import Collection

from heavebond.core.errors import Problems, listing, suggest
from heavebond.core.numerals import whole
from heavebond.language import reading
from heavebond.language.definition import Layout, Note, PartPlace
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence

FARTHEST = 5000  # limit of a place, in steps of the grid
MIRRORED = "mirrored"
LAYOUT_KEYS = ("parts", "wires", "notes")
LONGEST_NOTE = 2000  # characters


def read_layout(node: Node | None, base: Layout, problems: Problems, *, parts: Collection[str], wires: Collection[str]
                ) -> Layout:
    """Read `layout:` and add problems for mistakes.

    * node: the section; None if the file has none.
    * base: layout of the diagram that is extended. Its entries of parts that the file removes are kept; the drawing ignores
      them.
    * parts, wires: names of the parts and nodes that entries of this section may have.
    """
    entries = reading.mapping(node, "layout", problems, "Write `layout: {parts: {spring: [12, 4]}}`.")
    if entries is None:
        return base
    reading.known_keys(entries, LAYOUT_KEYS, "`layout:`", problems)
    part_places, pieces_of_wires, notes = dict(base.parts), dict(base.wires), dict(base.notes)
    for name, item in _items(entries, "parts", problems, parts, "component"):
        place = _part(name, item, problems)
        if place is not None:
            part_places[name] = place
    for name, item in _items(entries, "wires", problems, wires, "node"):
        pieces = [_piece(name, piece, problems) for piece in item.items] if isinstance(item, Sequence) else [None]
        if not isinstance(item, Sequence):
            problems.add("layout-bad", f"the wire '{name}' in `layout:` is a list of pieces", item.place,
                         hint=f"Write for example `{name}: [[12, 4, 20, 4]]`.")
        pieces_of_wires[name] = tuple(piece for piece in pieces if piece is not None)
    for name, item in _items(entries, "notes", problems):
        note = _note(name, item, problems)
        if note is not None:
            notes[name] = note
    return Layout(part_places, pieces_of_wires, notes)


def _items(entries: Mapping, key: str, problems: Problems, known: Collection[str] = (), noun: str = ""
           ) -> list[tuple[str, Node]]:
    """The entries of a section of `layout:`. If they have a `noun`, add a problem for each name that is not `known`."""
    section = reading.mapping(entries.items.get(key), f"layout.{key}", problems)
    if section is None:
        return []
    for name in section.items if noun else ():
        if name.partition("[")[0] not in known:  # an element of an array, `spring[2]`, may have a place
            problems.add("layout-unknown", f"`layout:` has an entry for the {noun} '{name}', which does not exist",
                         section.keys[name].place, hint=suggest(name, known) or "Delete this entry, or write the name of a "
                         f"{noun}: {listing(known)}.")
    return list(section.items.items())


def _numbers(node: Node, count: int) -> list[int] | None:
    """Whole numbers of a list within the sheet; None if one is something else."""
    texts = [item.text for item in node.items if isinstance(item, Scalar)] if isinstance(node, Sequence) else []
    sizes = [whole(text.removeprefix("-")) for text in texts[:count]]
    numbers = [-size if text.startswith("-") else size for text, size in zip(texts, sizes, strict=False) if size is not None]
    return numbers if len(numbers) == count and all(abs(n) <= FARTHEST for n in numbers) else None


def _part(name: str, node: Node, problems: Problems) -> PartPlace | None:
    numbers = _numbers(node, 2)
    further = [item.text for item in node.items[2:] if isinstance(item, Scalar)] if isinstance(node, Sequence) else []
    if numbers is None or len(further) > 2 or (further and further[0] not in map(str, reading.TURNS)) \
            or further[1:] not in ([], [MIRRORED]):
        problems.add("layout-bad", f"the place of '{name}' in `layout:` cannot be read", node.place,
                     hint=f"Write two whole numbers from -{FARTHEST} to {FARTHEST}, steps of the grid to the right and "
                     f"down, and if needed the rotation ({', '.join(map(str, reading.TURNS))}) and `{MIRRORED}`: "
                     f"`{name}: [12, 4]`, `{name}: [12, 4, 90]`, `{name}: [12, 4, 0, {MIRRORED}]`.")
        return None
    return PartPlace(numbers[0], numbers[1], int(further[0]) if further else None, further[1:] == [MIRRORED])


def _piece(name: str, node: Node, problems: Problems) -> tuple[int, int, int, int] | None:
    numbers = _numbers(node, 4)
    straight = numbers is not None and (numbers[0] == numbers[2]) != (numbers[1] == numbers[3])
    if numbers is None or not straight or not isinstance(node, Sequence) or len(node.items) != 4:
        problems.add("layout-bad", f"a piece of the wire '{name}' in `layout:` cannot be read", node.place,
                     hint="A piece is a horizontal or vertical line, from its first to its last point on the grid: "
                     f"`{name}: [[12, 4, 20, 4]]`.")
        return None
    return numbers[0], numbers[1], numbers[2], numbers[3]


def _note(name: str, node: Node, problems: Problems) -> Note | None:
    if not isinstance(node, Mapping):
        problems.add("layout-bad", f"the note '{name}' needs a text and a place", node.place,
                     hint=f'Write `{name}: {{text: "measured in spring", at: [12, 4]}}`.')
        return None
    reading.known_keys(node, ("text", "at"), f"the note '{name}'", problems, required=("text", "at"))
    if "text" not in node.items or "at" not in node.items:
        return None
    text = node.items["text"].text if isinstance(node.items["text"], Scalar) else ""
    numbers = _numbers(node.items["at"], 2)
    if numbers is None or len(text) > LONGEST_NOTE:
        problems.add("layout-bad", f"the note '{name}' is too long" if numbers else f"the place of the note '{name}' cannot "
                     "be read", node.place, hint=f"A note has up to {LONGEST_NOTE} characters." if numbers else
                     "Write two whole numbers, steps of the grid to the right and down: `at: [12, 4]`.")
        return None
    return Note(text, numbers[0], numbers[1])
