"""Edits of several parts at once: move them together, copy them with the wires between them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.studio.diagram_edits import Diagram, Entry, free_name, others_stay, position
from heavebond.studio.grid import Grid
from heavebond.studio.job import Job
from heavebond.text.yaml_edits import Tree, set_entry


def move_parts(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Move parts together so that `part`, one of them, reaches a place; their distances do not change."""
    grid, names = Grid.read(action), [diagram.own(str(name)) for name in action["parts"]]
    places, lead = _places(grid, names), str(action["part"])
    to = grid.place(float(action["column"]), float(action["row"]))
    if not to:
        raise UsageError([Problem("edit-refused", "there is no room between these columns or rows", None,
                                  "Move the parts beyond them, or one by one.")])
    dx, dy = float(to[0]) - places[lead][0], float(to[1]) - places[lead][1]
    occupied = {place: name for name, place in _places(grid, [n for n in grid.cells if n not in names]).items()}
    text = diagram.text
    for name, (x, y) in places.items():
        if (occupant := occupied.get((x + dx, y + dy))) is not None:
            raise UsageError([Problem("place-taken", f"'{name}' would cover '{occupant}'")])
        text = set_entry(text, ("components", name, "at"), [f"{x + dx:g}", f"{y + dy:g}", *position(diagram, name)[2:]])
    return {"text": others_stay(text, diagram, job, grid, set(names)), "part": lead, "parts": names}


def _places(grid: Grid, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """The numbers of column and row of parts."""
    return {name: (grid.columns[int(grid.cells[name][0])], grid.rows[int(grid.cells[name][1])]) for name in names}


def copy_parts(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Copy parts below all others, with the wires between them; formulas in a copy refer to the copies."""
    grid, names = Grid.read(action), [diagram.own(str(name)) for name in action["parts"]]
    parts, places, taken_names = diagram.section("components"), _places(grid, names), set(diagram.taken)
    if plain := [name for name in names if not isinstance(parts[name], dict)]:
        raise UsageError([Problem("edit-refused", f"{listing(plain)} cannot be copied")])
    fresh: dict[str, str] = {}
    for name in names:
        fresh[name] = free_name(re.sub(r"[0-9]+$", "", name) or name, taken_names)
        taken_names.add(fresh[name])
    below = max(grid.rows) + 1 - min(y for _, y in places.values())
    text, last = diagram.text, names[-1]
    for name, (x, y) in places.items():
        at: list[Tree] = [f"{x:g}", f"{y + below:g}", *position(diagram, name)[2:]]
        entry = {**_renamed(parts[name], fresh), "at": at}
        text = set_entry(text, ("components", fresh[name]), entry, after=last)
        last = fresh[name]
    for node, ends in diagram.section("nodes").items():
        joined = [str(end) for end in ends if str(end).partition(".")[0] in fresh] if isinstance(ends, list) else []
        if len(joined) > 1:
            new = fresh.get(node) or free_name(re.sub(r"[0-9]+$", "", node) or node, taken_names)
            taken_names.add(new)
            copied: list[Tree] = [f"{fresh[end.partition('.')[0]]}.{end.partition('.')[2]}" for end in joined]
            text = set_entry(text, ("nodes", new), copied)
    return {"text": text, "part": fresh[str(action["part"])], "parts": list(fresh.values())}


def _renamed(part: Tree, fresh: Mapping[str, str]) -> dict[str, Tree]:
    """The entries of a part; formulas that name one of the copied parts name its copy."""
    assert isinstance(part, dict)
    known = re.compile(r"(?<![\w.])(" + "|".join(map(re.escape, sorted(fresh, key=len, reverse=True))) + r")(?=\.)")

    def written(value: Tree) -> Tree:
        return known.sub(lambda m: fresh[m.group()], value) if isinstance(value, str) and "=" in value else value

    return {key: written(value) for key, value in part.items()}
