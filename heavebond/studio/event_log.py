"""The events of a run for the page: the instant, the part, the condition, and the values that changed."""

from __future__ import annotations

from collections import Counter
from operator import itemgetter

from heavebond.numerics.result import Result
from heavebond.studio.contents import Entry

MOST = 5000  # events that the page receives


def event_log(result: Result, name: str = "") -> Entry:
    """The events of a run in order, or those with a `name`; at most MOST of `of`. `counts` are the numbers of events by
    name. Changes of the integrated states and of the solver are listed as well.

    Each event has its time (s), its part and name, its condition or instants as text, and `changes`, the assigned variables
    with other values after it, in SI: name, value before, value after, unit."""
    flat = result.assembly.flat
    declared = {event.name: event for event in flat.events}
    held = {h.index: h for h in flat.held}
    counts = Counter(event for _, event in result.events)
    entries: list[Entry] = []
    for instant in result.instants:
        states = {state: k for k, state in enumerate(instant.assembly.state_names)}
        for event in instant.names:
            if len(entries) >= MOST or (name and event != name):
                continue
            changes = []
            for reset in declared[event].resets:
                if reset.held is not None:
                    label, unit = held[reset.held].name, held[reset.held].unit.text
                    before, after = float(instant.before.p[reset.held]), float(instant.after.p[reset.held])
                elif reset.unknown is not None and (unknown := flat.unknowns[reset.unknown]).name in states:
                    label, unit, k = unknown.name, unknown.unit.text, states[unknown.name]
                    before, after = float(instant.before.x[k]), float(instant.after.x[k])
                else:
                    continue
                if before != after:
                    changes.append([label, before, after, unit])
            part, _, short = event.rpartition(".")
            entries.append({"time": instant.time, "part": part, "event": short, "name": event,
                            "text": declared[event].text.removeprefix("condition: "), "changes": changes})
    for key, what in (("state_changes", "states"), ("solver_changes", "solver")):
        changed = result.statistics.get(key, [])
        assert isinstance(changed, list)
        for change in changed if not name else []:
            sides = [", ".join([v] if isinstance(v := change[side], str) else v) for side in ("before", "after")]
            entries.append({"time": change["time"], "part": "", "event": f"change of {what}", "name": "",
                            "text": " -> ".join(sides) + (f": {change['why']}" if change.get("why") else ""), "changes": []})
    entries.sort(key=itemgetter("time"))
    return {"events": entries, "counts": dict(counts), "of": counts[name] if name else counts.total()}
