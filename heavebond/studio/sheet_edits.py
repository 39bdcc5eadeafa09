"""Edits of the section `layout:`: places of parts, fixed pieces of wires, notes; and the clipboard of a diagram."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.language.layout import FARTHEST, LONGEST_NOTE, MIRRORED
from heavebond.pictures.layout import FACING, Drawn, turns_of
from heavebond.pictures.pictograms import GRID, Matrix
from heavebond.pictures.sheets import sheet
from heavebond.studio.diagram_edits import (
    Diagram,
    Entry,
    free_name,
    place_part,
    read_diagram,
    section_before,
    without_layout,
)
from heavebond.studio.job import Job
from heavebond.text.yaml_edits import Key, Tree, flow, replace_scalars, set_entry, tree
from heavebond.text.yaml_source import parse

STEP = 6  # steps of the grid by which a copy lies to the right of and below its original
LARGEST = 200_000  # characters of a clipboard
Place = list[str]  # the texts of a place in `layout.parts`


def places_of(drawn: Drawn) -> dict[str, list[Any]]:
    """The places of the parts of a drawing, in the form of `layout.parts`; with the rotation if the picture has several."""
    places: dict[str, list[Any]] = {}
    for item in drawn.items:
        turns = turns_of(item.part)
        words = _words(item.turn) if len(turns) > 1 else []
        places[item.part.name] = [item.x // GRID, item.y // GRID, *words]
    return places


def sheet_entry(drawn: Drawn | None) -> Entry:
    """The places of the parts of a drawing, its notes, and the nodes of whose wires pieces are fixed."""
    if drawn is None:
        return {"places": None, "notes": {}, "routed": []}
    notes = {name: {"text": entry.text, "at": [entry.x, entry.y]} for name, entry in drawn.sheet.notes.items()}
    return {"places": places_of(drawn), "notes": notes, "routed": [net.path for net in drawn.sheet.nets if net.pieces]}


def _words(turn: Matrix) -> list[str]:
    """The rotation and reflection of a matrix as texts."""
    degrees = next(degrees for degrees, out in FACING.items() if out == turn[:2])
    return [str(degrees), *([MIRRORED] if turn[0] * turn[3] < turn[1] * turn[2] else [])]


def read_places(action: Entry) -> dict[str, Place]:
    """The places that the page sends; ValueError if they are malformed."""
    places = {}
    for name, place in (action.get("places") or {}).items():
        x, y, *words = place
        if abs(int(x)) > FARTHEST or abs(int(y)) > FARTHEST or len(words) > 2:
            raise ValueError(place)
        places[str(name)] = [str(int(x)), str(int(y)), *map(str, words)]
    return places


def with_places(diagram: Diagram, text: str, places: Mapping[str, Place], drawn: Mapping[str, Place] | None = None) -> str:
    """Write places of parts. `drawn` are the present places of all parts: parts without an exact place keep theirs."""
    section = diagram.section("layout").get("parts")
    known = section if isinstance(section, dict) else {}
    fresh = {name: place for name, place in (drawn or {}).items() if name in diagram.model.body.instances
             and name not in diagram.model.body.layout.parts} | {name: place for name, place in places.items()
                                                                 if name not in known}

    def change(path: tuple[Key, ...], raw: str) -> str:
        if path[:2] == ("layout", "parts") and len(path) == 4 and isinstance(path[3], int) and path[2] in places:
            return places[str(path[2])][path[3]]
        return raw

    same = {name for name, place in places.items() if isinstance(old := known.get(name), list) and len(old) == len(place)}
    for name in places.keys() & known.keys() - same:
        text = set_entry(text, ("layout", "parts", name), [*places[name]])
    text = replace_scalars(text, change) if same else text
    if known:
        for name, place in fresh.items():
            text = set_entry(text, ("layout", "parts", name), [*place])
    elif fresh:
        entries: Tree = {name: [*place] for name, place in fresh.items()}
        text = set_entry(text, ("layout", "parts"), entries, after=section_before(text, "layout"))
        line = re.search(r"^( *)parts: " + re.escape(flow(entries)) + "$", text, re.MULTILINE)
        if line is not None:  # one part a line
            rows = "".join(f"\n{line.group(1)}  {flow(name)}: {flow([*place])}" for name, place in fresh.items())
            text = f"{text[:line.start()]}{line.group(1)}parts:{rows}{text[line.end():]}"
    return text


def place(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Add a part of a kind at a place."""
    placed = place_part(diagram, job, action)
    at = [str(int(action["x"])), str(int(action["y"]))]
    return {**placed, "text": with_places(diagram, placed["text"], {placed["part"]: at}, read_places(action))}


def move(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Move parts to the places under `to`; all others keep theirs."""
    drawn, names = read_places(action), [str(name) for name in action["to"]]
    places = {}
    for name in names:
        if name not in diagram.model.body.instances:
            raise UsageError([Problem("part-unknown", f"there is no part '{name}'")])
        x, y = (int(v) for v in action["to"][name])
        if max(abs(x), abs(y)) > FARTHEST:
            raise UsageError([Problem("edit-refused", "the place is beyond the end of the sheet")])
        places[name] = [str(x), str(y), *drawn.get(name, [])[2:]]
    text = with_places(diagram, diagram.text, places, drawn)
    return {"text": text, "part": str(action.get("part") or names[-1]), "parts": names}


def turn(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Turn a part clockwise to the next rotation that its symbol permits, or mirror it (`mirror`)."""
    name, drawn = str(action["part"]), read_places(action)
    allowed = turns_of(sheet(diagram.expanded, diagram.network, frozenset()).parts[name])
    if len(allowed) < 2:
        raise UsageError([Problem("part-upright", f"the symbol of '{name}' is never turned")])
    place = drawn[name]
    degrees, mirrored = int(place[2]) if len(place) > 2 else 0, len(place) > 3
    current = next((m for m in allowed if _words(m) == [str(degrees), *([MIRRORED] if mirrored else [])]), allowed[0])
    if action.get("mirror"):
        options: list[Matrix] = [(-current[0], current[1], -current[2], current[3]),
                                 (current[0], -current[1], current[2], -current[3])]
        chosen = next((m for m in options if m in allowed), None)
        if chosen is None:
            raise UsageError([Problem("part-upright", f"the symbol of '{name}' cannot be mirrored")])
    else:
        def order(matrix: Matrix) -> tuple[int, bool]:
            turn, *mirror = _words(matrix)
            return (int(turn) - degrees) % 360 or 360, bool(mirror) != mirrored
        chosen = min(allowed, key=order)
    return {"text": with_places(diagram, diagram.text, {name: [*place[:2], *_words(chosen)]}, drawn), "part": name}


# -- wires and notes ---------------------------------------------------------------------------------------------------
def route(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Fix a piece of the wire of a node, in place of the piece `old` if that is fixed; without a piece, free the wire."""
    node, drawn = str(action["node"]), read_places(action)
    if node not in diagram.model.body.wires:
        raise UsageError([Problem("node-unknown", f"there is no node '{node}'")])
    pieces = [[str(v) for v in piece] for piece in diagram.model.body.layout.wires.get(node, ())]
    fixed = diagram.section("layout").get("wires")
    if action.get("piece") is None:
        if not isinstance(fixed, dict) or node not in fixed:
            raise UsageError([Problem("edit-refused", f"no piece of the wire '{node}' is fixed in this file")])
        return {"text": without_layout(diagram.text, "wires", node), "node": node}
    piece = [int(v) for v in action["piece"]]
    if len(piece) != 4 or (piece[0] == piece[2]) == (piece[1] == piece[3]) or max(map(abs, piece)) > FARTHEST:
        raise ValueError(piece)
    old = [str(int(v)) for v in action.get("old") or ()]
    pieces = [p for p in pieces if not old or p not in (old, [*old[2:], *old[:2]])]
    entry: list[Tree] = [[*p] for p in [*pieces, [str(v) for v in piece]]]
    # the wire keeps its way only if the parts keep their places
    text = with_places(diagram, diagram.text, {}, drawn)
    return {"text": set_entry(text, ("layout", "wires", node), entry, after=section_before(text, "layout")), "node": node}


def note(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Add, change or move a note; an empty text deletes it."""
    notes = diagram.section("layout").get("notes")
    known = notes if isinstance(notes, dict) else {}
    name, text = str(action.get("name") or ""), str(action["text"]).rstrip()
    if not text:
        if name not in known:
            raise UsageError([Problem("edit-refused", f"the note '{name}' is not in this file")])
        return {"text": without_layout(diagram.text, "notes", name)}
    if len(text) > LONGEST_NOTE:
        raise UsageError([Problem("edit-refused", f"a note has up to {LONGEST_NOTE} characters")])
    name = name or free_name("note", diagram.model.body.layout.notes)
    x, y = int(action["x"]), int(action["y"])
    if max(abs(x), abs(y)) > FARTHEST:
        raise UsageError([Problem("edit-refused", "the place is beyond the end of the sheet")])
    entry: Tree = {"text": text, "at": [str(x), str(y)]}
    before = with_places(diagram, diagram.text, {}, read_places(action))
    written = set_entry(before, ("layout", "notes", name), entry, after=section_before(before, "layout"))
    return {"text": written, "note": name}


# -- clipboard -----------------------------------------------------------------------------------------------------------
def fragment(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Parts with the wires between them, as the YAML text of a clipboard."""
    names, drawn = [diagram.declared_part(str(name)) for name in action["parts"]], read_places(action)
    parts = diagram.section("components")
    if plain := [name for name in names if not isinstance(parts[name], dict)]:
        raise UsageError([Problem("edit-refused", f"{listing(plain)} cannot be copied")])
    nodes: dict[str, Tree] = {}
    for node, ends in diagram.section("nodes").items():
        joined: list[Tree] = [str(end) for end in (ends if isinstance(ends, list) else ())
                              if str(end).partition(".")[0] in names]
        if len(joined) > 1:
            nodes[node] = joined
    places: dict[str, Tree] = {name: [*drawn[name]] for name in names if name in drawn}
    rows = []
    for name in names:
        part = parts[name]
        assert isinstance(part, dict)
        rows.append(f"  {flow(name)}: {flow({k: v for k, v in part.items() if k != 'at' or name not in places})}")
    lines = ["components:", *rows, *(["nodes:", *(f"  {flow(k)}: {flow(v)}" for k, v in nodes.items())] if nodes else []),
             *([f"layout: {{parts: {flow(places)}}}"] if places else [])]
    return {"text": diagram.text, "clipboard": "\n".join(lines) + "\n"}


def paste(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Add the parts of a clipboard with new names; formulas that name one of them name its copy. They lie around (x, y), or
    next to the originals."""
    clipboard = str(action["clipboard"])
    if len(clipboard) > LARGEST:
        raise UsageError([Problem("edit-refused", "the clipboard is too large for a diagram")])
    content = tree(parse(clipboard).root) if re.match(r"\s*components:", clipboard) else None
    parts = content.get("components") if isinstance(content, dict) else None
    if not isinstance(content, dict) or not isinstance(parts, dict) or not all(
            isinstance(part, dict) and isinstance(part.get("is"), str) for part in parts.values()):
        raise UsageError([Problem("edit-refused", "the clipboard has no parts of a diagram", None,
                                  "Copy parts in a drawing, or text that begins with `components:`.")])
    drawn, used = read_places(action), set(diagram.used_names)
    fresh: dict[str, str] = {}
    for name in parts:
        fresh[name] = free_name(re.sub(r"[0-9]+$", "", name) or name if name in used else name, used)
        used.add(fresh[name])
    layout = content.get("layout")
    copied = layout.get("parts") if isinstance(layout, dict) else None
    at = read_places({"places": {k: v for k, v in copied.items() if k in parts}} if isinstance(copied, dict) else {})
    left = min((int(p[0]) for p in at.values()), default=0)
    top = min((int(p[1]) for p in at.values()), default=0)
    dx, dy = (int(action["x"]) - left, int(action["y"]) - top) if action.get("x") is not None else (STEP, STEP)
    for k, name in enumerate(parts):
        at.setdefault(name, [str(left + 12 * k), str(top)])
    places = {fresh[name]: [str(int(p[0]) + dx), str(int(p[1]) + dy), *p[2:]] for name, p in at.items()}
    text, last = diagram.text, str(action.get("after") or "")
    for name, part in parts.items():
        entry = {k: v for k, v in _renamed(part, fresh).items() if k != "at"}
        after = last if last in diagram.section("components") or last in fresh.values() else ""
        text = set_entry(text, ("components", fresh[name]), entry, after=after or section_before(text, "components"))
        last = fresh[name]
    nodes = content.get("nodes")
    for node, ends in nodes.items() if isinstance(nodes, dict) else ():
        joined: list[Tree] = [f"{fresh[head]}.{port}" for end in (ends if isinstance(ends, list) else ())
                              for head, _, port in [str(end).lstrip("+").partition(".")] if head in fresh]
        if len(joined) > 1:
            new = fresh.get(node) or free_name(re.sub(r"[0-9]+$", "", node) or node if node in used else node, used)
            used.add(new)
            text = set_entry(text, ("nodes", new), joined, after=section_before(text, "nodes"))
    changed = read_diagram(text, job)
    return {"text": with_places(changed, text, places, drawn), "part": fresh[next(reversed(parts))],
            "parts": list(fresh.values())}


def _renamed(part: Tree, fresh: Mapping[str, str]) -> dict[str, Tree]:
    """The entries of a part; formulas that name one of the copied parts name its copy."""
    assert isinstance(part, dict)
    known = re.compile(r"(?<![\w.])(" + "|".join(map(re.escape, sorted(fresh, key=len, reverse=True))) + r")(?=\.)")

    def written(value: Tree) -> Tree:
        return known.sub(lambda m: fresh[m.group()], value) if isinstance(value, str) and "=" in value else value

    return {key: written(value) for key, value in part.items()}


def copy(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Copy parts with the wires between them to a place next to them."""
    copied = fragment(diagram, job, action)["clipboard"]
    return paste(diagram, job, {"places": action.get("places"), "clipboard": copied, "after": str(action["parts"][-1])})
