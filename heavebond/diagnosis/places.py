"""Where effects stand, so that what is one place of the machine counts as one.

A law in place of a part, in a part, and in parallel with it stands between the nodes of this part; one in series with a part
is at one place on either side of it; a node and the same node with the surroundings are one place; nodes that move as one
in the model are one node. What a sensor or an input does is at a place of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from heavebond.diagnosis.catalogue import Candidate, Site, site_of
from heavebond.estimation.experiment import Experiment

Place = tuple[str, frozenset[str], frozenset[str]]


@dataclass(frozen=True)
class Places:
    """The nodes of each part of a diagram, the nodes that stand for the surroundings, and nodes that move as one, each with
    the first of them."""

    parts: Mapping[str, frozenset[str]]
    grounds: frozenset[str]
    as_one: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, experiment: Experiment, as_one: Mapping[str, str] | None = None) -> Places:
        """The places of the diagram of an experiment."""
        site = site_of(experiment)
        found = {leaf.path: frozenset(site.group(f"{leaf.path}.{port.name}").name for port in leaf.component.ports.values()
                                      if port.count is None) for leaf in site.expanded.leaves.values()}
        return cls(found, frozenset(name for domain in site.nodes for name in _grounds(site, domain)), as_one or {})

    def place(self, candidate: Candidate) -> Place:
        """Where a candidate stands: the same for two of them at one place."""
        if candidate.attaches in ("input", "channel"):
            return candidate.attaches, frozenset([candidate.signal or candidate.where[0]]), frozenset()
        series = candidate.attaches == "in series"
        if series and candidate.members:
            return "in series", frozenset(candidate.where), frozenset()
        # a node may have the name of a part
        parts = candidate.where[1:] if series else candidate.where if candidate.attaches in ("in", "replaces") else ()
        nodes = set(candidate.where[:len(candidate.where) - len(parts)]).union(*(self.parts[name] for name in parts))
        moving = {self.as_one.get(name, name) for name in nodes - self.grounds}
        return "", frozenset(moving or nodes), frozenset(parts if series else ())


def _grounds(site: Site, domain: str) -> list[str]:
    return [group.name for group in site.grounds(domain).values()]
