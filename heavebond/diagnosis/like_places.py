"""One law at all like places of a diagram, with one set of numbers: a candidate of its own.

Both chambers of a cylinder leak, and both guides of a beam have friction. Where an effect stands at several places at once,
no single place explains the records, and a second one is added to what the first did wrong. Two places are alike where the
same kinds of components meet there: nodes by the kinds of all parts on them, pairs of nodes by the kinds on both and the
kinds that join them, a place in series by its part and port besides, a dormant parameter by its component. The numbers at
the further places are formulas of those at the first, so that as many numbers are fitted as at one place.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from heavebond.diagnosis.catalogue import Candidate, Site, fresh, single_candidates, site_of, snake
from heavebond.diagnosis.scoring import Score
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, load_experiment
from heavebond.language.edits import Change, Part

Signature = tuple[object, ...]
LAWS = ("across", "at", "in series", "in")  # ways to attach that are considered: not sensors, nor replacements


def candidates(experiment: ExperimentOrFile) -> list[Candidate]:
    """All effects of the catalogue at all places of the diagram of an experiment.

    They stand in the order of the library, and after them each law at all like places together (`members` are the labels of
    its single candidates). `experiment` is one that was loaded, or its file or name. Raises ModelError for an invalid
    diagram or component, DataError for an experiment that cannot be read.
    """
    return _at_all_places(site_of(load_experiment(experiment)))


def named_apart(experiment: Experiment) -> list[Candidate]:
    """The same, each candidate at a single place with names for its parts that no other one has, so that several can be put
    into the diagram together."""
    return _at_all_places(replace(site_of(experiment), apart=True))


def _at_all_places(site: Site) -> list[Candidate]:
    found = single_candidates(site.experiment, site)
    return [*found, *at_like_places(site, found)]


def at_like_places(site: Site, found: Sequence[Candidate]) -> list[Candidate]:
    """One candidate for each law and each group of at least two like places among those `found`."""
    kinds = _kinds(site)
    groups: dict[Signature, list[Candidate]] = {}
    for candidate in found:
        signature = _signature(site, candidate, kinds)
        if signature:
            groups.setdefault(signature, []).append(candidate)
    return [_joined(site, group) for group in groups.values() if len(group) > 1]


def beyond_their_members(scores: Sequence[Score]) -> list[Score]:
    """The scores without those of laws at several places that promise less than the law does at one of these on average.

    With the effect at all of them the residual is along the sum of the members' directions, whose score is then the largest
    of all as far as the tangent holds; with the effect at one of two unlike directions it is the average.
    """
    best: dict[str, float] = {}
    for score in scores:
        best[score.candidate.label] = max(score.gain, best.get(score.candidate.label, 0.0))
    return [s for s in scores if not s.candidate.members or best[s.candidate.label] >=
            sum(best.get(member, 0.0) for member in s.candidate.members) / len(s.candidate.members)]


def _kinds(site: Site) -> dict[str, frozenset[str]]:
    """The kinds of the components on each node."""
    found: dict[str, set[str]] = {}
    for leaf in site.expanded.leaves.values():
        for port in leaf.component.ports.values():
            if port.count is None:
                found.setdefault(site.group(f"{leaf.path}.{port.name}").name, set()).add(leaf.component.name)
    return {name: frozenset(kinds) for name, kinds in found.items()}


def _signature(site: Site, candidate: Candidate, kinds: Mapping[str, frozenset[str]]) -> Signature:
    """What like places have in common; empty for a candidate that is left out: one that depends on a further node."""
    effect = site.experiment.model.library.component(candidate.component).effect
    law = (candidate.component, candidate.kind, candidate.attaches)
    if candidate.attaches == "in":
        return (*law, candidate.name.rpartition(".")[2])
    if candidate.attaches not in LAWS or effect is None or effect.also:
        return ()
    if candidate.attaches == "in series":
        node, path = candidate.where
        port = candidate.place.rpartition(".")[2]
        return (*law, kinds.get(node, frozenset()), site.expanded.leaves[path].component.name, port)
    ends = tuple(sorted(tuple(sorted(kinds.get(node, frozenset()))) for node in candidate.where))
    return (*law, ends, _joining(site, candidate.where))


def _joining(site: Site, nodes: Sequence[str]) -> frozenset[str]:
    """The kinds of the components that stand on all of these nodes."""
    return frozenset(leaf.component.name for leaf in site.expanded.leaves.values() if set(nodes) <= {
        site.group(f"{leaf.path}.{p.name}").name for p in leaf.component.ports.values() if p.count is None})


def _joined(site: Site, group: Sequence[Candidate]) -> Candidate:
    """The same law at all places of a group, with the numbers of the first."""
    first, *others = group
    own = site if site.apart else replace(site, taken={*site.taken, *first.change.components})
    change = first.change
    parts: list[str] = []
    for other in others:
        more, part = (_with_numbers_of(first, other), other.where[0]) if first.attaches == "in" else \
            _following(own, first, other)
        change, parts = change.joined(more), [*parts, part]
    where = tuple(dict.fromkeys(name for candidate in group for name in candidate.where))
    place = " and ".join(c.place for c in group)
    return replace(first, place=place, where=where, change=change, members=tuple(c.label for c in group),
                   numbers=tuple(replace(n, parts=tuple(parts)) for n in first.numbers))


def _with_numbers_of(first: Candidate, other: Candidate) -> Change:
    """Another part's dormant numbers as those of the first part."""
    owner, another = (c.name.rpartition(".")[0] for c in (first, other))
    return Change(settings={f"{another}.{key}": f"={owner}.{key}"
                            for key in (n.name.rpartition(".")[2] for n in first.numbers)})


def _following(site: Site, first: Candidate, other: Candidate) -> tuple[Change, str]:
    """The change that puts the law at another place, under names of its own and with the numbers of the first; and the name
    of the part there."""
    names, change = {}, other.change
    for part in change.components:
        names[part] = fresh(site, part if part != other.name else snake(other.component))
        site.taken.add(names[part])
    shared = {n.name.rpartition(".")[2] for n in first.numbers}
    parts = {names[old]: Part(part.kind, {key: f"={first.name}.{key}" if old == other.name and key in shared else text
                                          for key, text in part.values.items()})
             for old, part in change.components.items()}

    def end(text: str) -> str:
        sign, owner, rest = re.fullmatch(r"([+-]?)([^.]*)(.*)", text).groups()  # type: ignore[union-attr]
        return f"{sign}{names.get(owner, owner)}{rest}"

    nodes = {names.get(node.removesuffix("_end"), node.removesuffix("_end")) + "_end" if node.endswith("_end")
             and node.removesuffix("_end") in names else node: tuple(map(end, ends)) for node, ends in change.nodes.items()}
    return Change(parts, nodes, initial={end(name): text for name, text in change.initial.items()}), names[other.name]
