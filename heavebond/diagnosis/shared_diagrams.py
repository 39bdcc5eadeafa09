"""One diagram for many candidates that sleep in it.

To put a candidate into the diagram and assemble it takes longer than the runs of its score. A law without states of its own
leaves the machine as it is while its amplitude is neutral, whatever other laws sleep beside it. So candidates that do not
get in each other's way are put into one diagram: it is assembled once, and the equations with the derivatives by all
amplitudes are listed once. Each candidate has runs of its own in it, in which all others sleep. (A refit, which moves
everything that is free, has a diagram of its own.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

from heavebond.diagnosis.catalogue import Candidate
from heavebond.language.definition import Component
from heavebond.language.edits import Change
from heavebond.language.library import Library
from heavebond.text.expression import Call, Expr, children

ADDING = ("across", "at", "in", "input", "channel")  # ways to attach that leave what is there as it is
MOST = 12  # candidates in one diagram: what sleeps is evaluated in every run


@dataclass(frozen=True)
class SharedDiagram:
    """Candidates that are put into a diagram together, the parts of each under names of their own."""

    members: tuple[Candidate, ...]

    @property
    def change(self) -> Change:
        """The change that puts all of them there."""
        return reduce(Change.joined, (c.change for c in self.members))

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Those of all of them."""
        return tuple(n.name for c in self.members for n in c.vanishing)

    def member(self, label: str) -> Candidate:
        """A candidate as it stands there."""
        return next(c for c in self.members if c.label == label)

    def half(self, label: str) -> SharedDiagram | None:
        """The half of them to which a candidate belongs; None where that is the candidate alone."""
        middle = len(self.members) // 2
        found = next(part for part in (self.members[:middle], self.members[middle:]) if label in (c.label for c in part))
        return SharedDiagram(found) if len(found) > 1 else None


def shared_diagrams(library: Library, candidates: Sequence[Candidate]) -> dict[str, SharedDiagram]:
    """The diagram that a candidate shares with others, by its label, for those that share one. In one diagram are those that
    name nothing that another one names: many where the parts of each have names of their own."""
    groups: list[tuple[set[str], list[Candidate]]] = []
    for candidate in candidates:
        if not _may_sleep_beside_others(library, candidate):
            continue
        own = _taken(candidate.change)
        for taken, group in groups:
            if len(group) < MOST and not own & taken and (group[0].attaches == "input") is (candidate.attaches == "input"):
                taken.update(own)
                group.append(candidate)
                break
        else:
            groups.append((own, [candidate]))
    return {candidate.label: shared for _, group in groups if len(group) > 1
            for shared in [SharedDiagram(tuple(group))] for candidate in group}


def _taken(change: Change) -> set[str]:
    """What no two changes of one diagram may both name: parts, nodes that are new, ports that are taken off a node, values,
    initial values, channels and inputs."""
    ends = [(node, end) for node, joined in change.nodes.items() for end in joined]
    new = {node for node, end in ends if end[0] not in "+-"}
    return {*change.components, *new, *(end for _, end in ends if end[0] == "-"), *change.settings, *change.initial,
            *(f"channel {name}" for name in change.channels), *(f"input {name}" for name in change.moved)}


def _may_sleep_beside_others(library: Library, candidate: Candidate) -> bool:
    """Whether it can stand in the diagram at amplitude zero, with no number that is set before its runs, and its parts have
    neither states nor events."""
    return candidate.vanishes and candidate.attaches in ADDING and \
        not any(n.sought is not None and n.sought.held for n in candidate.numbers) and \
        all(_is_static(library.component(part.kind)) for part in candidate.change.components.values())


def _is_static(component: Component) -> bool:
    return not (component.composite or component.when) and not any(
        _differentiates(side) for line in component.equations for side in (line.tree.left, line.tree.right))


def _differentiates(expr: Expr) -> bool:
    return (isinstance(expr, Call) and expr.function == "der") or any(map(_differentiates, children(expr)))
