"""The edits of a drawing by their names, as the page asks for them."""

from __future__ import annotations

from collections.abc import Callable

from heavebond.core.errors import UsageError
from heavebond.studio import diagram_edits as one
from heavebond.studio import group_edits as group
from heavebond.studio import run_edits as run
from heavebond.studio import wire_edits as wire
from heavebond.studio.blocks import unrunnable
from heavebond.studio.diagram_edits import Diagram, Entry, read_diagram
from heavebond.studio.job import Job

ACTIONS: dict[str, Callable[[Diagram, Job, Entry], Entry]] = {
    "place": one.place_part, "move": one.move_part, "turn": one.turn_part, "rename": one.rename_part,
    "rename_node": one.rename_node, "copy": one.copy_part, "delete": one.delete, "join": wire.join_ports,
    "leave": wire.leave_node, "set": one.set_value, "move_parts": group.move_parts, "copy_parts": group.copy_parts,
    "show": run.show_signal, "initial": run.initial_value, "setting": run.run_setting}
RUNS = ("show", "initial", "setting")  # what only a diagram has that is simulated


def edited(job: Job, action: Entry) -> Entry:
    """The text after an action, and what is selected then. UsageError with the reason where it cannot be done."""
    name = str(action["act"])
    diagram = read_diagram(job.text, job)
    if name in RUNS and "component" in diagram.said:
        raise UsageError([unrunnable(diagram.model.name)])
    return ACTIONS[name](diagram, job, action)
