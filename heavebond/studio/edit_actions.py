"""Edits of outputs and of the settings of a run, and the table of all edits by the names that the page sends."""

from __future__ import annotations

import re
from collections.abc import Callable

from heavebond.core.errors import ModelError, Problem, UsageError
from heavebond.core.presentation import readable_unit
from heavebond.studio import diagram_edits as one
from heavebond.studio import sheet_edits as sheet
from heavebond.studio import wire_edits as wire
from heavebond.studio.blocks import unrunnable
from heavebond.studio.diagram_edits import (
    Diagram,
    Entry,
    Written,
    free_name,
    read_diagram,
    read_text_only,
    section_before,
)
from heavebond.studio.job import Job
from heavebond.text.yaml_edits import Key, Tree, delete_entry, set_entry

STARTS = ("steady", "rest")


# -- outputs, begin and end of a run -----------------------------------------------------------------------------------
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


# -- all edits ---------------------------------------------------------------------------------------------------------
ACTIONS: dict[str, Callable[[Diagram, Job, Entry], Entry]] = {
    "place": sheet.place, "move": sheet.move, "turn": sheet.turn, "rename": one.rename_part, "rename_node": one.rename_node,
    "copy": sheet.copy, "fragment": sheet.fragment, "paste": sheet.paste, "route": sheet.route, "note": sheet.note,
    "delete": one.delete, "join": wire.join_ports, "leave": wire.leave_node, "show": show_signal}
# edits that need no valid diagram, and so also work if one of its values cannot be read
VALUES: dict[str, Callable[[Written, Job, Entry], Entry]] = {
    "set": one.set_value, "initial": initial_value, "setting": run_setting}
RUNS = ("show", "initial", "setting")  # edits of diagrams that are simulated


def edited(job: Job, action: Entry) -> Entry:
    """The text after an action, and the new selection. UsageError with the reason if it is not possible, if it would add an
    unreadable value to a readable diagram, or if the value has a wrong unit or is not allowed."""
    name = str(action["act"])
    written = read_text_only(job.text, job)
    if name in RUNS and "component" in written.root:
        raise UsageError([unrunnable(str(written.root["component"]))])
    if name not in VALUES:
        return ACTIONS[name](read_diagram(job.text, job), job, action)
    answer = VALUES[name](written, job, action)
    try:
        diagram = read_diagram(str(answer["text"]), job)
    except ModelError as error:
        if _readable(job):
            raise UsageError(list(error.problems)) from None
        return answer
    if name == "set" and str(action["value"]).strip():
        path = str(action["path"])  # a value of another unit or out of range stays in its field as well
        if problems := [p for p in diagram.problems if p.message.startswith((f"{path}:", f"{path} = "))]:
            raise UsageError(problems)
    return answer


def _readable(job: Job) -> bool:
    """True if the text can be read as a diagram."""
    try:
        read_diagram(job.text, job)
    except ModelError:
        return False
    return True
