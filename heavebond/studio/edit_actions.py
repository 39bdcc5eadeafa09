"""The edits of a drawing by their names, as the page asks for them."""

from __future__ import annotations

from collections.abc import Callable

from heavebond.core.errors import ModelError, Problem, UsageError
from heavebond.studio import diagram_edits as one
from heavebond.studio import group_edits as group
from heavebond.studio import run_edits as run
from heavebond.studio import wire_edits as wire
from heavebond.studio.blocks import unrunnable
from heavebond.studio.diagram_edits import Diagram, Entry, Written, read_diagram, read_text_only
from heavebond.studio.job import Job

ACTIONS: dict[str, Callable[[Diagram, Job, Entry], Entry]] = {
    "place": one.place_part, "move": one.move_part, "turn": one.turn_part, "rename": one.rename_part,
    "rename_node": one.rename_node, "copy": one.copy_part, "delete": one.delete, "join": wire.join_ports,
    "leave": wire.leave_node, "move_parts": group.move_parts, "copy_parts": group.copy_parts, "show": run.show_signal}
# what is written without knowing the diagram, and so where one of its values cannot be read, too
VALUES: dict[str, Callable[[Written, Job, Entry], Entry]] = {
    "set": one.set_value, "initial": run.initial_value, "setting": run.run_setting}
RUNS = ("show", "initial", "setting")  # what only a diagram has that is simulated


def edited(job: Job, action: Entry) -> Entry:
    """The text after an action, and what is selected then. UsageError with the reason where it cannot be done, or where it
    would write a value that cannot be read into a diagram that can."""
    name = str(action["act"])
    written = read_text_only(job.text, job)
    if name in RUNS and "component" in written.said:
        raise UsageError([unrunnable(str(written.said["component"]))])
    if name not in VALUES:
        return ACTIONS[name](read_diagram(job.text, job), job, action)
    found = VALUES[name](written, job, action)
    if (problems := _unread(str(found["text"]), job)) and not _unread(job.text, job):
        raise UsageError(problems)
    return found


def _unread(text: str, job: Job) -> list[Problem]:
    """Why a text cannot be read as a diagram; nothing where it can."""
    try:
        read_diagram(text, job)
    except ModelError as error:
        return list(error.problems)
    return []
