"""Where effects stand, so that what is one place of the machine counts as one.

A law in place of a part and in parallel with it stands between the nodes of this part; a dormant parameter between those
whose ports stand in the equations with it, of a block in those of its parts (the leakage of a piston between the chambers,
and not at its rod); one in series
with a part is at one place on either side of it; a node and the same node with the surroundings are one place; nodes that
move as one in the model are one node. What a sensor or an input does is at a place of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from heavebond.diagnosis.catalogue import Candidate, Site, site_of
from heavebond.equations.expanded import Leaf
from heavebond.estimation.experiment import Experiment
from heavebond.language.definition import Component, Value
from heavebond.text.expression import names

Place = tuple[str, frozenset[str], frozenset[str]]


@dataclass(frozen=True)
class Places:
    """The nodes of each part of a diagram by its ports, the nodes that stand for the surroundings, nodes that move as one,
    each with the first of them, and the parts."""

    parts: Mapping[str, Mapping[str, str]]
    grounds: frozenset[str]
    as_one: Mapping[str, str] = field(default_factory=dict)
    leaves: Mapping[str, Leaf] = field(default_factory=dict)

    @classmethod
    def of(cls, experiment: Experiment, as_one: Mapping[str, str] | None = None) -> Places:
        """The places of the diagram of an experiment."""
        site = site_of(experiment)
        leaves = site.expanded.leaves.values()
        found = {leaf.path: {port.name: site.group(f"{leaf.path}.{port.name}").name for port in leaf.component.ports.values()
                             if port.count is None} for leaf in leaves}
        return cls(found, frozenset(name for domain in site.nodes for name in _grounds(site, domain)), as_one or {},
                   site.expanded.leaves)

    def place(self, candidate: Candidate) -> Place:
        """Where a candidate stands: the same for two of them at one place."""
        if candidate.attaches in ("input", "channel"):
            return candidate.attaches, frozenset([candidate.signal or candidate.where[0]]), frozenset()
        series = candidate.attaches == "in series"
        if series and candidate.members:
            return "in series", frozenset(candidate.where), frozenset()
        # a node may have the name of a part
        parts = candidate.where[1:] if series else candidate.where if candidate.attaches in ("in", "replaces") else ()
        nodes = set(candidate.where[:len(candidate.where) - len(parts)])
        nodes = nodes.union(*(self._nodes(candidate, part) for part in parts))
        moving = {self.as_one.get(name, name) for name in nodes - self.grounds}
        return "", frozenset(moving or nodes), frozenset(parts if series else ())

    def _nodes(self, candidate: Candidate, part: str) -> set[str]:
        """The nodes of a part between which a candidate stands that is in it, in its place or in series with it."""
        amplitudes = {n.name.rpartition(".")[2] for n in candidate.numbers if n.amplitude}
        return (self._acting(part, amplitudes) if candidate.attaches == "in" else set()) or set(self.parts[part].values())

    def _acting(self, part: str, parameters: set[str]) -> set[str]:
        """The nodes on which a part acts by the equations in which these parameters of it stand; a block also by those of
        its parts that are given their values."""
        ports, paths = self.parts[part], {f"{part}.{name}" for name in parameters}
        found = {ports[name] for name in _ports_beside(self.leaves[part].component, parameters) & ports.keys()}
        for path, leaf in self.leaves.items() if self.leaves[part].component.composite else ():
            given = {name for name, bound in leaf.parameters.items() if path.startswith(f"{part}.") and isinstance(
                bound.value, Value) and any(bound.scope + n.text in paths for n in names(bound.value.expr))}
            found |= self._acting(path, given) if given else set()
        return found


def _ports_beside(component: Component, parameters: set[str]) -> set[str]:
    """The ports of a component whose variables stand in one equation with one of these parameters."""
    found = set()
    for line in component.equations:
        named = {name.text for side in (line.tree.left, line.tree.right) for name in names(side)}
        if named & parameters:
            found |= {text.partition(".")[0] for text in named if "." in text}
    return found


def _grounds(site: Site, domain: str) -> list[str]:
    return [group.name for group in site.grounds(domain).values()]
