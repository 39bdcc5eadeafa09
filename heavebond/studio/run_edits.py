"""Edits of the outputs, begin and end of a run: `show:`, initial conditions, duration and output interval."""

from __future__ import annotations

import re

from heavebond.core.errors import Problem, UsageError
from heavebond.core.presentation import readable_unit
from heavebond.studio.diagram_edits import Diagram, Entry, Written, free_name, section_before
from heavebond.studio.job import Job
from heavebond.text.yaml_edits import Key, Tree, delete_entry, set_entry

STARTS = ("steady", "rest")


def show_signal(diagram: Diagram, job: Job, action: Entry) -> Entry:
    """Add a signal with its unit to `show:`, or remove it; UsageError for an output of the diagram that is extended."""
    signal, unit, back = str(action["signal"]), str(action.get("unit", "")), _selected(action)
    if action["on"]:
        name = free_name(re.sub(r"\W+", "_", signal).strip("_"), diagram.model.show)
        output: dict[str, Tree] = {"is": signal, **({"unit": readable_unit(unit, 1.0)} if unit not in ("", "1") else {})}
        return {"text": _set(diagram.text, ("show", name), output), **back}
    name = next((n for n, output in diagram.model.show.items() if output.text == signal), "")
    if name not in diagram.section("show"):
        raise UsageError([Problem("output-inherited", f"'{signal}' is not an output of this file", None,
                                  "Remove it in the diagram that this one extends." if name else "")])
    return {"text": _without(diagram, "show", name), **back}


def initial_value(diagram: Written, job: Job, action: Entry) -> Entry:
    """Set the value of a variable at the start; an empty value removes it."""
    signal, value = str(action["signal"]), str(action["value"]).strip()
    if value:
        return {"text": _set(diagram.text, ("initial", signal), value), **_selected(action)}
    return {"text": _without(diagram, "initial", signal), **_selected(action)}


def run_setting(diagram: Written, job: Job, action: Entry) -> Entry:
    """Set `until` and `every` under `simulate:`, or the kind of start under `initial:`; an empty value removes the entry."""
    key, value = str(action["key"]), str(action["value"]).strip()
    if key == "start":
        if value and value not in STARTS:
            raise UsageError([Problem("edit-refused", f"a run starts steady or at rest, not '{value}'")])
        section = "initial"
    elif key in ("until", "every"):
        section = "simulate"
    else:
        raise UsageError([Problem("usage", "the page asked for something unknown")])
    return {"text": _set(diagram.text, (section, key), value) if value else _without(diagram, section, key)}


def _selected(action: Entry) -> Entry:
    """Keep the selection."""
    return {key: str(action[key]) for key in ("part", "node") if action.get(key)}


def _set(text: str, keys: tuple[Key, ...], value: Tree) -> str:
    return set_entry(text, keys, value, after=section_before(text, str(keys[0])))


def _without(diagram: Written, section: str, key: str) -> str:
    """Remove an entry, and its section if it is empty then."""
    entries = diagram.section(section)
    if key not in entries:
        return diagram.text
    return delete_entry(diagram.text, (section, key) if len(entries) > 1 else (section,))
