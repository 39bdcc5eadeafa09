"""Values of sliders written into the text of a diagram, on the lines where they belong and no others."""

from __future__ import annotations

import re
from collections.abc import Mapping as Dictionary
from collections.abc import Sequence
from pathlib import PurePosixPath

from heavebond.text.yaml_edits import set_entry
from heavebond.text.yaml_source import Mapping, parse


def with_values(text: str, values: Dictionary[str, str]) -> str:
    """The text with values of parameters by their paths; see `set_entry`."""
    for path, value in values.items():
        text = set_entry(text, place_of(parse(text).root, path), value)
    return text


def with_records(text: str, files: Sequence[str]) -> tuple[str, list[str]]:
    """The text of an experiment with further records, and their names; one that it has already is passed over."""
    names = []
    for file in files:
        entries = parse(text).root.items.get("records")
        known = entries.items if isinstance(entries, Mapping) else {}
        if any(isinstance(r, Mapping) and getattr(r.items.get("file"), "text", "") == file for r in known.values()):
            continue
        stem = re.sub(r"\W+", "_", PurePosixPath(file).stem).strip("_") or "record"
        name = next(n for k in range(1, 10_000) if (n := stem if k == 1 else f"{stem}_{k}") not in known)
        text = set_entry(text, ("records", name), {"file": file, "use": "validate"})
        names.append(name)
    return text, names


def place_of(root: Mapping, path: str) -> tuple[str, ...]:
    """The keys under which a parameter is set: where `set:` has it already, else at the diagram's own parameter (a
    component's: its default) or at the part, else under `set:`, which also decides over a diagram that is extended."""
    given = root.items.get("set")
    if isinstance(given, Mapping) and path in given.items:
        return "set", path
    owner, _, name = path.rpartition(".")
    if not owner:
        return ("parameters", name, "default") if "component" in root.items else ("parameters", name)
    parts = root.items.get("components")
    if "extends" not in root.items and isinstance(parts, Mapping) and isinstance(parts.items.get(owner), Mapping):
        return "components", owner, name
    return "set", path
