"""Writing of slider values into the text of a diagram, without changes of other lines."""

from __future__ import annotations

import re
from collections.abc import Mapping as Dictionary
from collections.abc import Sequence
from pathlib import PurePosixPath

from heavebond.text.yaml_edits import set_entry
from heavebond.text.yaml_source import Mapping, parse


def with_values(text: str, values: Dictionary[str, str]) -> str:
    """Set values of parameters by their paths; see `set_entry`."""
    for path, value in values.items():
        text = set_entry(text, place_of(parse(text).root, path), value)
    return text


def with_records(text: str, files: Sequence[str]) -> tuple[str, list[str]]:
    """Add records to the text of an experiment; returns it and their names. Existing records are skipped."""
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
    """The keys under which a parameter is set: in `set:` if it is there already, else at the diagram's parameter (for a
    component: its default) or at the part, else under `set:`, which also overrides a diagram that is extended."""
    settings = root.items.get("set")
    if isinstance(settings, Mapping) and path in settings.items:
        return "set", path
    owner, _, name = path.rpartition(".")
    if not owner:
        return ("parameters", name, "default") if "component" in root.items else ("parameters", name)
    parts = root.items.get("components")
    if "extends" not in root.items and isinstance(parts, Mapping) and isinstance(parts.items.get(owner), Mapping):
        return "components", owner, name
    return "set", path
