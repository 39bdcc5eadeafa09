"""Places of effects, and candidates with one law at all similar places of a diagram.

The place of an effect is the set of nodes between which it acts. A law that replaces a part or is parallel to it acts
between the nodes of this part. A dormant parameter acts between the nodes of the ports in its equations; for a block, in the
equations of its parts. So the leakage of a piston acts between the chambers, and not at the rod. A law in series with a part
has the same place on either side of it. A node, and the same node with the surroundings, are one place. Nodes that move
together in the model are one node. An effect of a sensor or of an input has a separate place.

A single place does not explain the records if both chambers of a cylinder leak, or both guides of a beam have friction. Two
places are similar if the same components are connected there:

* for a node, the components of all parts on it;
* for a pair of nodes, the components on both nodes and the components that connect them;
* for a place in series, also the component and port of its part;
* for a dormant parameter, the component.

The parameters at the further places are formulas of those at the first, so the number of fitted parameters is the same as at
one place.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace

from heavebond.diagnosis.candidates.catalogue import (
    Candidate,
    EffectNumber,
    Site,
    distant_candidates,
    fresh,
    single_candidates,
    site_of,
    snake,
)
from heavebond.equations.expanded import Leaf
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, load_experiment
from heavebond.language.definition import Value
from heavebond.language.edits import Change, Part
from heavebond.text.expression import names

Place = tuple[str, frozenset[str], frozenset[str]]


@dataclass(frozen=True)
class Places:
    """Nodes and parts of a diagram, by which the places of candidates are compared.

    * parts: node of each port of each part.
    * grounds: nodes that represent the surroundings.
    * as_one: for each node that moves together with others, the first of them.
    * leaves: the parts.
    """

    parts: Mapping[str, Mapping[str, str]]
    grounds: frozenset[str]
    as_one: Mapping[str, str] = field(default_factory=dict)
    leaves: Mapping[str, Leaf] = field(default_factory=dict)

    @classmethod
    def of(cls, experiment: Experiment, as_one: Mapping[str, str] | None = None) -> Places:
        """Create the places of the diagram of an experiment."""
        site = site_of(experiment)
        leaves = site.expanded.leaves.values()
        node_of_port = {leaf.path: {port.name: site.group(f"{leaf.path}.{port.name}").name
                                    for port in leaf.component.ports.values() if port.count is None} for leaf in leaves}
        grounds = frozenset(group.name for domain in site.nodes for group in site.grounds(domain).values())
        return cls(node_of_port, grounds, as_one or {}, site.expanded.leaves)

    def place(self, candidate: Candidate) -> Place:
        """Key of the place of a candidate, which is equal for two candidates at one place."""
        if candidate.attaches in ("input", "channel"):
            return candidate.attaches, frozenset([candidate.signal or candidate.where[0]]), frozenset()
        series = candidate.attaches == "in series"
        if series and candidate.members:
            return "in series", frozenset(candidate.where), frozenset()
        # a node and a part may have the same name
        of_parts = candidate.attaches in ("in", "replaces", "parameter")
        parts = candidate.where[1:] if series else candidate.where if of_parts else ()
        nodes = set(candidate.where[:len(candidate.where) - len(parts)])
        amplitudes = {n.name.rpartition(".")[2] for n in candidate.numbers if n.amplitude}
        for part in parts:  # a dormant parameter acts between the nodes of the equations that contain it
            acting = self._acting(part, amplitudes) if candidate.attaches == "in" else set()
            nodes |= acting or set(self.parts[part].values())
        moving = {self.as_one.get(name, name) for name in nodes - self.grounds}
        return "", frozenset(moving or nodes), frozenset(parts if series else ())

    def _acting(self, part: str, parameters: set[str]) -> set[str]:
        """Nodes of the ports in the equations of a part that contain these parameters. For a block, these are the equations
        of its parts that take values from the parameters."""
        ports, paths, nodes = self.parts[part], {f"{part}.{name}" for name in parameters}, set[str]()
        for line in self.leaves[part].component.equations:
            named = {name.text for side in (line.tree.left, line.tree.right) for name in names(side)}
            if named & parameters:
                nodes |= {ports[port] for text in named if (port := text.partition(".")[0]) in ports and "." in text}
        for path, leaf in self.leaves.items() if self.leaves[part].component.composite else ():
            dependent = {name for name, bound in leaf.parameters.items() if path.startswith(f"{part}.") and isinstance(
                bound.value, Value) and any(bound.scope + n.text in paths for n in names(bound.value.expr))}
            nodes |= self._acting(path, dependent) if dependent else set()
        return nodes


Signature = tuple[object, ...]
LAWS = ("across", "at", "in series", "in", "replaces")  # kinds of attachment with similar places: no sensors


def candidates(experiment: ExperimentOrFile, excluded: dict[str, str] | None = None, site: Site | None = None
               ) -> list[Candidate]:
    """All effects of the catalogue at all places of the diagram of an experiment.

    The order is the order of the library, followed by the candidates with one law at all similar places (`members` are the
    labels of the single candidates). `experiment` is an experiment, a file or a name. `excluded` collects the reasons for
    effects that are not candidates, by label. `site` is the diagram if it was created before. Raises ModelError for an
    invalid diagram or component, DataError for an experiment that cannot be read.
    """
    site = site or site_of(load_experiment(experiment))
    return _at_all_places(replace(site, excluded=excluded) if excluded is not None else site)


def between_all_nodes(experiment: ExperimentOrFile, site: Site | None = None) -> list[Candidate]:
    """All effects across two nodes of one domain that no component connects; `site` is the diagram if it was created
    before."""
    return distant_candidates(site or site_of(load_experiment(experiment)))


def named_apart(experiment: Experiment, labels: Container[str] = frozenset()) -> list[Candidate]:
    """Candidates with unique names of their parts, so that several can be inserted into the diagram together.

    The result contains all of `candidates`, and the candidates of `between_all_nodes` with these `labels`.
    """
    site = replace(site_of(experiment), apart=True)
    return [*_at_all_places(site), *distant_candidates(site, labels)]


def _at_all_places(site: Site) -> list[Candidate]:
    """The candidates at single places, and for each group of at least two that have one law at similar places, one
    candidate with the law at all of them."""
    single = single_candidates(site.experiment, site)
    connected: dict[str, set[str]] = {}  # components that are connected to each node
    for leaf in site.expanded.leaves.values():
        for port in leaf.component.ports.values():
            if port.count is None:
                connected.setdefault(site.group(f"{leaf.path}.{port.name}").name, set()).add(leaf.component.name)
    kinds = {name: frozenset(components) for name, components in connected.items()}
    groups: dict[Signature, list[Candidate]] = {}
    for candidate in single:
        signature = _signature(site, candidate, kinds)
        if signature:
            groups.setdefault(signature, []).append(candidate)
    return [*single, *(_joined(site, group) for group in groups.values() if len(group) > 1)]
def _signature(site: Site, candidate: Candidate, kinds: Mapping[str, frozenset[str]]) -> Signature:
    """Key that is equal at similar places; empty for a candidate that cannot be combined, for example because it depends on
    a further node."""
    effect = site.experiment.model.library.component(candidate.component).effect
    law = (candidate.component, candidate.kind, candidate.attaches)
    if candidate.attaches == "in":
        return (*law, candidate.name.rpartition(".")[2])
    if candidate.attaches == "replaces":
        shared = len(_taken_over(site, candidate)) < len(candidate.numbers)
        return (*law, site.expanded.leaves[candidate.where[0]].component.name) if shared else ()
    if candidate.attaches not in LAWS or effect is None or effect.also:
        return ()
    if candidate.attaches == "in series":
        node, path = candidate.where
        port = candidate.place.rpartition(".")[2]
        return (*law, kinds.get(node, frozenset()), site.expanded.leaves[path].component.name, port)
    ends = tuple(sorted(tuple(sorted(kinds.get(node, frozenset()))) for node in candidate.where))
    joining = frozenset(leaf.component.name for leaf in site.expanded.leaves.values() if set(candidate.where) <= {
        site.group(f"{leaf.path}.{p.name}").name for p in leaf.component.ports.values() if p.count is None})
    return (*law, ends, joining)


def _joined(site: Site, group: Sequence[Candidate]) -> Candidate:
    """Combine the candidates of a group into one candidate: the same law at all places, with the parameters of the first
    place."""
    first, *repeats = group
    naming_site = site if site.apart else replace(site, taken={*site.taken, *first.change.components})
    change = first.change
    parts: list[str] = []
    numbers = {n.name.rpartition(".")[2]: n for n in first.numbers}
    apart = _taken_over(site, first)
    further: list[EffectNumber] = []
    for repeat in repeats:
        if first.attaches == "in":  # the dormant parameters of the other part follow those of the first part
            owner, another = (c.name.rpartition(".")[0] for c in (first, repeat))
            more, part = Change(settings={f"{another}.{key}": f"={owner}.{key}" for key in numbers}), repeat.where[0]
        elif first.attaches == "replaces":
            new = repeat.change.components[repeat.name]
            values = {key: f"={first.name}.{key}" if key in numbers.keys() - apart else text
                      for key, text in new.values.items()}
            more, part = Change({repeat.name: Part(new.kind, values)}), repeat.name
        else:
            more, part = _following(naming_site, first, repeat)
        change, parts = change.joined(more), [*parts, part]
        further += [n for n in repeat.numbers if n.name.rpartition(".")[2] in apart]
    where = tuple(dict.fromkeys(name for candidate in group for name in candidate.where))
    place = " and ".join(c.place for c in group)
    return replace(first, place=place, where=where, change=change, acts="",
                   members=tuple(c.label for c in group), begins=tuple(n for c in group for n in c.begins),
                   numbers=(*(n if key in apart else replace(n, parts=tuple(parts)) for key, n in numbers.items()),
                            *further))


def _taken_over(site: Site, candidate: Candidate) -> set[str]:
    """Parameters of a replacing law whose initial values are taken from the replaced part. They remain separate for each
    part."""
    effect = site.experiment.model.library.component(candidate.component).effect_of(candidate.attaches, candidate.old)
    start = effect.start if effect is not None and candidate.attaches == "replaces" else {}
    return {key for n in candidate.numbers if (key := n.name.rpartition(".")[2]) in start and "old." in start[key].text}


def _following(site: Site, first: Candidate, repeat: Candidate) -> tuple[Change, str]:
    """Change that inserts the law at another place under unused names, with the parameters of the first; and the name of the
    part there."""
    names, change = {}, repeat.change
    for part in change.components:
        names[part] = fresh(site, part if part != repeat.name else snake(repeat.component))
        site.taken.add(names[part])
    shared = {n.name.rpartition(".")[2] for n in first.numbers}
    parts = {names[old]: Part(part.kind, {key: f"={first.name}.{key}" if old == repeat.name and key in shared else text
                                          for key, text in part.values.items()})
             for old, part in change.components.items()}

    def end(text: str) -> str:
        sign, owner, path = re.fullmatch(r"([+-]?)([^.]*)(.*)", text).groups()  # type: ignore[union-attr]
        return f"{sign}{names.get(owner, owner)}{path}"

    nodes = {names.get(node.removesuffix("_end"), node.removesuffix("_end")) + "_end" if node.endswith("_end")
             and node.removesuffix("_end") in names else node: tuple(map(end, ends)) for node, ends in change.nodes.items()}
    return Change(parts, nodes, initial={end(name): text for name, text in change.initial.items()}), names[repeat.name]
