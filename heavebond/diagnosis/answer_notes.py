"""Notes that an answer ends with: what is left after the findings, what the search is without, starts that are wrong, inputs
that follow from outputs, and what of the records or of the catalogue the search left out."""

from __future__ import annotations

from collections.abc import Sequence

from heavebond.core.errors import listing
from heavebond.diagnosis.remainder import OTHER_CAUSES, Remainder
from heavebond.diagnosis.stage import Stage
from heavebond.estimation.comparison import Comparison


def residual_notes(said: str, rest: Remainder | None, steps: Sequence[Stage]) -> list[str]:
    """What is left after what was found, where that is not all."""
    if said not in ("mainly", "shape", "undetermined") or not steps[0].left.significant:
        return []
    if rest is None:
        return [OTHER_CAUSES] if said == "undetermined" and not steps[-1].partial else []
    return [rest.words, *([OTHER_CAUSES] if rest.place is None or (said == "undetermined" and not rest.decided) else [])]


def lost_candidates(steps: Sequence[Stage]) -> list[str]:
    """What the search is without, as the system ended a process."""
    lost = list(dict.fromkeys(label for step in steps for label in step.lost))
    return [f"Not tried to the end: {listing(lost, 4)}. The processes that worked on this died, also when it was tried "
            "again alone (killed, or out of memory). Fewer `--processes`, or `--samples`, need less memory."] if lost else []


def broken_candidates(said: str, steps: Sequence[Stage]) -> list[str]:
    """What was not tried beside an answer that leaves something open."""
    broken = steps[0].broken if said in ("mainly", "shape", "undetermined") and steps[0].left.significant else ()
    return [f"Not tried, as the diagram with it cannot be simulated: {listing(broken, 4)}. To see why, add one to the "
            "diagram and run it."] if broken else []


def wrong_starts(said: str, last: Comparison) -> list[str]:
    """Channels that begin elsewhere than the model with all effects, and what that means where no name was found."""
    found = [f"{name}: {start}." for name, record in last.records.items() for start in record.starts]
    if found and said == "undetermined":
        found.append("A wrong start leaves a transient that no effect explains, and may hide the one that is missing: set "
                     "the start right, then diagnose again.")
    return found


def wrong_channels(last: Comparison) -> list[str]:
    """Channels whose unit, sign or zero seems to be another one than the experiment says, with the model of the answer."""
    told: dict[str, list[str]] = {}
    for name, record in last.records.items():
        for slip in record.slips:
            told.setdefault(slip, []).append(name)
    found = [f"{listing(records)}: {slip}." for slip, records in told.items()]
    return [*found, "If so, set it right and diagnose again: what is named was found with it as it is."] if found else []


def closed_loops(first: Comparison) -> list[str]:
    """That inputs follow from outputs, once for each input, and what that means for the answer."""
    told = dict.fromkeys(note for record in first.records.values() for note in record.feedback)
    return [f"The answer may be biased: {next(iter(told))}."] if told else []


def search_limits(classes: Sequence[str], looked: str, shorter: bool) -> list[str]:
    """What was left out of the search."""
    only = f"Tried were only effects of {'this class' if len(classes) == 1 else 'these classes'}: {listing(classes)}."
    fitted = "the time did not suffice to fit what it found to all of them. Every figure is that of these beginnings" \
        if shorter else "what it found was fitted to all of them"
    part = f"The records are long: the search looked at their beginning ({looked}), and {fitted}. `--samples` sets how " \
        "much, `from:` and `to:` at a record which part."
    return [*([only] if classes else []), *([part] if looked else [])]
