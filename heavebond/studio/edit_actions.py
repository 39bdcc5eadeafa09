"""The edits of a drawing by the names that the page sends."""

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
# edits that need no valid diagram, and so also work if one of its values cannot be read
VALUES: dict[str, Callable[[Written, Job, Entry], Entry]] = {
    "set": one.set_value, "initial": run.initial_value, "setting": run.run_setting}
RUNS = ("show", "initial", "setting")  # edits of diagrams that are simulated


def edited(job: Job, action: Entry) -> Entry:
    """The text after an action, and the new selection. UsageError with the reason if it is not possible, or if it would
    add an unreadable value to a readable diagram."""
    name = str(action["act"])
    written = read_text_only(job.text, job)
    if name in RUNS and "component" in written.said:
        raise UsageError([unrunnable(str(written.said["component"]))])
    if name not in VALUES:
        return ACTIONS[name](read_diagram(job.text, job), job, action)
    answer = VALUES[name](written, job, action)
    if (problems := _unread(str(answer["text"]), job)) and not _unread(job.text, job):
        raise UsageError(problems)
    return answer


def _unread(text: str, job: Job) -> list[Problem]:
    """Problems that prevent a text from being read as a diagram; empty if there are none."""
    try:
        read_diagram(text, job)
    except ModelError as error:
        return list(error.problems)
    return []
