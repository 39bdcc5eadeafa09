"""The answer as a tree with the levels measuring chain or machine, place, kind, class and law, with a probability at each
level.

The probabilities are computed in `evidence.probability` and summed over the branches. The probabilities of the children add
up to the probability of their parent; "another" is the part that belongs to none of the listed children. The probability of
a law outside the catalogue is distributed over places and kinds. If the localisation finds an unknown input, the weights are
the likelihoods of its places, and the kind follows from the variable on which the input depends. Otherwise the distribution
is proportional to the effects of the catalogue. The answer states the deepest level with a probability of at least `STATED`.

Each of several effects has a separate tree. It is computed from the step that added the effect, or from the step in which it
was compared again in the diagram with all other effects. The share of an effect is the part of the misfit (chi-square above
the noise) that it removes. A search that was ended early has a tree with the same levels. The share of the candidates that
were not reached is then moved from the effects to "another", and the answer begins with "so far".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from heavebond.core.errors import listing
from heavebond.core.presentation import readable
from heavebond.diagnosis.answer.physics import physics
from heavebond.diagnosis.answer.variations import onset_words, variation_words
from heavebond.diagnosis.answer.verdict import held_out_or_fitted, misfit_reduction, without_effects
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.evidence.probability import (
    CALIBRATION,
    NOTHING,
    OTHER,
    OUTSIDE,
    PARAMETERS,
    Calibration,
    Event,
    Evidence,
    compared_step,
    evidence,
    law_weights,
    percent,
    probabilities,
)
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.schedule import family
from heavebond.diagnosis.search.step import Stage, is_noticeable
from heavebond.diagnosis.state import AddedEffect, LadderEntry
from heavebond.language.definition import Domain
from heavebond.language.library import Library, effect_kind
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.misfit import Localization, PlaceEstimate

LEVELS = ("answer", "system", "place", "kind", "class", "law")
STATED = 0.5  # smallest probability of a stated level: no other branch is then as probable
LISTED = 0.01  # smallest probability of a listed branch
SHOWN = 0.05  # smallest probability of a branch in tables
DIGITS = 9  # digits of probabilities in files; further digits depend on the order of summation
LAWS = 3  # largest number of laws that are named together
COMPARABLE = 0.5  # laws with at least this share of the probability of the best law are also named
ONE_CLASS = 0.9  # an unknown law gets the class of at least this share of the effects of its kind and place
MEASURING, MACHINE, ANOTHER = "measuring chain", "machine", "another"
NO_LAW = "a law outside the catalogue"
# Kind of a law from the type of variable on which the estimated input depends (see `localise.regressors`).
FOLLOWED = {"across": "rate", "pressure": "rate", "position": "displacement"}


@dataclass(frozen=True)
class Node:
    """A branch of the answer.

    * level: one of LEVELS.
    * name: text.
    * probability: sum over the branches below.
    * children: branches of the next level, most probable first.
    * key: distinguishes the branch from others of its level.
    * labels: candidates in the branch.
    """

    level: str
    name: str
    probability: float
    children: tuple[Node, ...] = ()
    key: object = None
    labels: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return the branch and all branches below it for JSON."""
        return {"level": self.level, "branch": self.name, "probability": round(self.probability, DIGITS),
                "branches": [child.as_dict() for child in self.children]}


@dataclass(frozen=True)
class EffectTree:
    """The tree of one effect.

    * root: the tree.
    * path: stated branches from the top down.
    * statement: sentence on the path.
    * meaning: sentence on the physics of the best law (empty without one).
    * name: short name.
    * share: share of the misfit (NaN if no effect was added).
    """

    root: Node
    path: tuple[Node, ...]
    statement: str
    meaning: str
    name: str
    share: float

    def as_dict(self) -> dict[str, object]:
        """Return the statement, the path and the whole tree for JSON."""
        return {"statement": self.statement, "meaning": self.meaning,
                "share": None if math.isnan(self.share) else self.share,
                "stated": [{"level": n.level, "branch": n.name, "probability": round(n.probability, DIGITS)}
                           for n in self.path],
                "branches": [child.as_dict() for child in self.root.children]}


@dataclass(frozen=True)
class Further:
    """A further effect that is part of the model but not certain: short name, share of the misfit, and sentence on its
    physics."""

    name: str
    share: float
    meaning: str

    def as_dict(self) -> dict[str, object]:
        """Return the share and the sentence for JSON."""
        return {"branch": self.name, "share": self.share, "meaning": self.meaning}


@dataclass(frozen=True)
class Tree:
    """The hierarchical answer.

    effects: a tree for each effect. so_far: True if the search was ended early. further: effects that are not certain.
    fitted: False if no candidate was fitted, so that the probabilities follow from scores.
    """

    effects: tuple[EffectTree, ...]
    so_far: bool
    further: tuple[Further, ...] = ()
    fitted: bool = True

    @property
    def words(self) -> tuple[str, ...]:
        """The answer in sentences. If there are several effects, a summary is first."""
        if not self.effects:
            return ("So far no level of the answer is known: no candidate was scored.",)
        lines = []
        if len(self.effects) > 1 or self.further:
            parts = [f"{e.name} ({percent(e.share)} of the {'remaining ' if k else ''}misfit)"
                     for k, e in enumerate(self.effects)]
            unsure = [f"{e.name} ({percent(e.share)} of the remaining misfit)" for e in self.further]
            lines.append(f"Missing: {listing(parts, len(parts))}" + (
                f"; not certain: {listing(unsure, len(unsure))}." if unsure else "."))
        lines += [line for e in self.effects for line in (e.statement, e.meaning) if line]
        lines += [f"Not certain: {e.meaning}" for e in self.further]
        begin = "So far" if self.fitted else "No conclusion yet; by the scores so far, before any candidate was fitted"
        return (f"{begin}: {lines[0]}", *lines[1:]) if self.so_far else tuple(lines)

    def states(self, candidate: Candidate) -> bool:
        """False if the path of the first effect leads to another place or class than that of a candidate."""
        path = self.effects[0].path if self.effects else ()
        return all(candidate.label in node.labels for node in path
                   if node.level == "place" or (node.level == "class" and node.key != OUTSIDE))

    def as_dict(self) -> dict[str, object]:
        """Return the answer for JSON."""
        return {"words": list(self.words), "so_far": self.so_far, "effects": [e.as_dict() for e in self.effects],
                "further": [e.as_dict() for e in self.further]}


@dataclass(frozen=True)
class Leaf:
    """A law with its probability. `keys` and `names` contain one element for each level below the answer, from the top
    down."""

    keys: tuple[object, ...]
    names: tuple[str, ...]
    probability: float
    labels: tuple[str, ...] = ()


def answer_tree(steps: Sequence[Stage], known: Evidence | None, findings: Sequence[AddedEffect],
                ladder: Sequence[LadderEntry], localization: Localization | None, partial: bool,
                doubtful: Sequence[AddedEffect] = (), reviews: Sequence[Stage | None] = ()) -> Tree:
    """Create the hierarchical answer of a diagnosis.

    `known` is the evidence of the first step with the other values of fixed parameters. `localization` belongs to the first
    diagram. `doubtful` are further effects that are not certain. `reviews` contains the steps in which effects were compared
    again in the diagram with all others; then the tree of the effect uses the refits of `compared_step`.
    """
    if not steps or known is None:
        return Tree((), True)
    first = held_out_or_fitted(without_effects(ladder, findings)) if ladder else math.nan
    levels = [first, *(held_out_or_fitted(f.rung) for f in (*findings, *doubtful))]
    shares = [misfit_reduction(before, after) for before, after in pairwise(levels)]
    trees = []
    for k, step in enumerate(steps[:max(1, len(findings))]):
        finding = findings[k] if k < len(findings) else None
        share = shares[k] if finding is not None else math.nan
        review = reviews[k] if k < len(reviews) else None
        step_evidence = known if k == 0 else evidence(steps[k:], review=review)
        trees.append(_effect_tree(compared_step(step, review), step_evidence, finding,
                                  localization if k == 0 else None, share))
    library = steps[0].experiment.model.library
    further = [Further(f"{f.candidate.kind} {f.candidate.place}", share, _meaning(f, library))
               for f, share in zip(doubtful, shares[len(findings):], strict=True)]
    return Tree(tuple(trees), partial, tuple(further), any(step.trials for step in steps))


def _effect_tree(step: Stage, known: Evidence, finding: AddedEffect | None, localization: Localization | None, share: float
                 ) -> EffectTree:
    library = step.experiment.model.library
    effects, outside, masses = answer_leaves(step, known, localization)
    models = [Node("system", name, masses[name], key=name) for name in (NOTHING, PARAMETERS) if masses.get(name, 0.0) > 0]

    def grown(leaves: Sequence[Leaf]) -> tuple[Node, tuple[Node, ...]]:
        root = _with_rest(Node("answer", "the records", 1.0, tuple(sorted(
            [*_grown(leaves, 0), *models], key=lambda node: -node.probability))))
        return root, _path(root)

    root, path = grown([*effects, *outside])
    if all(node.level == "system" for node in path):  # no single place is stated; several that are alike may be
        root, path = grown(_with_equivalent_places([*effects, *outside], step.twins))
    best = _best(step, finding, path, root)
    meaning = _meaning(best, library) if best is not None else ""
    return EffectTree(root, path, _statement(root, path, best), _introduced(meaning, path, best, root),
                      _short(path, best), share)


def answer_leaves(step: Stage, known: Evidence, localization: Localization | None, constants: Calibration = CALIBRATION
                  ) -> tuple[list[Leaf], list[Leaf], dict[str, float]]:
    """Laws of the catalogue, laws outside it, and the probabilities of the other events by their kinds."""
    library = step.experiment.model.library
    events = probabilities(known, constants)
    masses = {e.kind: e.probability for e in events if not e.labels}
    named = [e for e in events if e.labels]
    if named:
        effects = _laws(step, named, library, constants.temperature)
    else:
        # Before the first refit the probabilities are proportional to the scores, the chi-square that the effects could
        # remove. Candidates without a score keep their share.
        mass = max(0.0, masses.get(OTHER, 0.0) - constants.lapse)
        gains = {s.candidate.label: max(s.gain, 0.0) for s in step.scores}
        total = sum(gains.values()) * max(1.0, step.planned / max(1, len(gains)))
        scored = [s.candidate for s in step.scores] if total > 0 else []
        effects = [Leaf(*levels(step, c, c.kind, library), mass * gains[c.label] / total, (c.label,)) for c in scored]
    outside = _outside(step, known, effects, localization, masses.get(OUTSIDE, 0.0), constants.temperature)
    return effects, outside, masses


def _laws(step: Stage, events: Sequence[Event], library: Library, temperature: float) -> list[Leaf]:
    """Effects of the catalogue with their probabilities. The probability of a class at a place is divided among its laws."""
    known = [*(s.candidate for s in step.scores), *(t.candidate for t in step.trials)]
    candidates = {c.label: c for c in known}
    scored = len({s.candidate.label for s in step.scores})
    reached = scored / max(step.planned - len(step.broken), scored, 1) if step.partial else 1.0  # share of the candidates
    trials = {t.candidate.label: t for t in step.trials if t.errors is not None}
    leaves = []
    for event in events:
        if event.kind == VALUE:
            continue
        laws = [candidates[label] for label in event.labels if label in candidates]
        fitted = [trials[c.label] for c in laws if c.label in trials]
        shares = dict(zip((t.candidate.label for t in fitted), law_weights(fitted)[temperature], strict=True)) \
            if fitted else {laws[0].label: 1.0}
        # after an early end, laws of the class there without a refit have the share of their scores, the law being unknown
        gains = {s.candidate.label: max(s.gain, 0.0) for s in step.scores if step.partial and fitted
                 and family(s.candidate) in {family(law) for law in laws}}
        open_ = sum(gain for label, gain in gains.items() if label not in event.labels and label not in step.excluded) \
            / max(sum(gains.values()), 1e-300)
        open_ = 1 - (1 - open_) * reached if fitted else 0.0
        for law in laws:
            if shares.get(law.label, 0.0) > 0:
                keys, names = levels(step, law, event.kind, library)
                probability = event.probability * float(shares[law.label])
                leaves.append(Leaf(keys, names, probability * (1 - open_), (law.label,)))
                leaves += [Leaf(keys[:4], names[:4], probability * open_)] if open_ else []
    return leaves


def levels(step: Stage, candidate: Candidate, kind: str, library: Library) -> tuple[tuple[object, ...], tuple[str, ...]]:
    """Keys and names of a candidate on all levels below the answer."""
    nature = effect_kind(kind)
    measured = candidate.attaches == "channel" or bool(candidate.change.moved)  # a channel, or an input that records drive
    system = MEASURING if measured and (nature == "measurement" or candidate.attaches == "channel") else MACHINE
    place = step.places.place(candidate)
    law = candidate.name if candidate.attaches == "in" else candidate.component
    inside = candidate.attaches in ("in", "replaces", "parameter") and not candidate.members
    words = f"in {candidate.where[0]}" if inside else candidate.place
    # the domain of the ports of the law, if they have one in common
    component = library.component(candidate.component)
    effect = component.effect_of(candidate.attaches, candidate.old)
    also = effect.also if effect is not None else {}
    domains = {p.domain for p in component.ports.values() if p.name not in also}
    domain = library.domains.get(next(iter(domains))) if len(domains) == 1 else None
    return (system, place, nature, kind, law), (system, words, kind_words(nature, domain, len(place[1]) > 1), kind, law)


def kind_words(kind: str, domain: Domain | None, pair: bool) -> str:
    """Predicate for a kind of law in a domain: `dissipates energy, with a force that depends on the speed`."""
    if domain is not None and domain.positions and len(domain.through) > 1:
        domain = None  # a body with several forces and speeds: none of them is that of the law
    acts = domain.members[domain.through[0]].noun if domain is not None else ""
    across = domain.members[domain.across[0]].noun if domain is not None else ""
    if domain is not None and not domain.position and pair:
        across = f"{across} difference"
    fluid = domain is not None and domain.fills is not None
    heat = domain is not None and domain.power is not None and not fluid
    if kind == "rate":
        does = "conducts heat" if heat else "dissipates energy"
        return does + (f", with a {acts} that depends on the {across}" if domain is not None else "")
    if kind == "displacement":
        return f"exerts a {acts} that depends on the displacement" if domain is not None and domain.position else \
            "depends on the displacement"
    return {"acceleration": "adds inertia", "storage": "stores " + ("heat" if heat else "fluid" if fluid else "energy"),
            "source": f"exerts a constant {acts or 'action'}", "transport": "delays or distorts a signal",
            "variation": "has a parameter that varies", "measurement": "shifts or scales a signal"}.get(kind, "acts")


# -- a law outside the catalogue -------------------------------------------------------------------------------------------
def _outside(step: Stage, known: Evidence, effects: Sequence[Leaf], localization: Localization | None, mass: float,
             temperature: float) -> list[Leaf]:
    """Distribute the probability of a law outside the catalogue over places and kinds.

    The weights are taken from the identified curves; without curves, from the localisation; otherwise from the effects of
    the catalogue. A law is assigned to a class if nearly all effects of its kind at its place are of this class. Example: a
    flow between two nodes that depends on their pressure difference is leakage, regardless of its law.
    """
    leaves: list[Leaf] = []
    if known.curves:
        weights = known.flexible[temperature]
        words = {leaf.keys[1:3]: leaf.names for leaf in effects}
        for curve, weight in zip(known.curves, weights / max(float(weights.sum()), 1e-300), strict=True):
            names = frozenset(step.places.as_one.get(name, name) for name in curve.where)
            place = ("", names - step.places.grounds or names, frozenset[str]())
            system = MEASURING if curve.kind == "measurement" else MACHINE
            level_names = words.get((place, curve.kind), (system, curve.place, kind_words(curve.kind, None, False)))
            leaves.append(Leaf((system, place, curve.kind, OUTSIDE), (*level_names[:3], NO_LAW), mass * float(weight)))
    elif localization is not None and localization.missing and localization.suspects:
        leaves = _localized(step, localization, mass, temperature)
    else:
        among = sum(leaf.probability for leaf in effects) or 1.0
        mass *= 1 - known.unexplained(temperature)  # laws that explain nothing do not show a place
        sums: dict[tuple[object, ...], Leaf] = {}
        for leaf in effects:
            keys = (*leaf.keys[:3], OUTSIDE)
            before = sums.get(keys, Leaf(keys, (*leaf.names[:3], NO_LAW), 0.0))
            sums[keys] = replace(before, probability=before.probability + mass * leaf.probability / among)
        leaves = list(sums.values())
    classified = []
    for leaf in leaves:
        alike = [effect for effect in effects if effect.keys[:3] == leaf.keys[:3]]
        classes = {effect.keys[3]: effect.names[3] for effect in alike}
        shares = {key: sum(e.probability for e in alike if e.keys[3] == key) for key in classes}
        first = max(shares, key=shares.__getitem__, default=None)
        if first is not None and shares[first] >= ONE_CLASS * sum(shares.values()):
            leaf = replace(leaf, keys=(*leaf.keys[:3], first, OUTSIDE), names=(*leaf.names[:3], classes[first], NO_LAW))
        classified.append(leaf)
    return classified


def _localized(step: Stage, localization: Localization, mass: float, temperature: float) -> list[Leaf]:
    """Distribute the probability of a law outside the catalogue by the localisation.

    The weights are the tempered likelihoods of the groups of places that the records cannot distinguish. An unknown input
    at a node may act through a source on it: the inputs before this source share the probability of the node. An input that
    follows no variable of the machine on held-out data is no law at its place. So each place keeps the share of the misfit
    that it explains, times the share of its input that its best variable predicts on held-out data. The rest remains for
    "another".
    """
    likelihood = {s.place.name: math.exp(-s.behind / temperature) for s in localization.suspects}
    groups = {frozenset((s.place.name, *s.alike)): likelihood[s.place.name] for s in localization.suspects}
    explained = min(1.0, max(0.0, max(s.explained for s in localization.suspects)))
    leaves = []
    for s in localization.suspects:
        group = next(g for g in groups if s.place.name in g)
        share = groups[group] / sum(groups.values()) / sum(o.place.name in group for o in localization.suspects)
        predicted = min(1.0, max(0.0, s.curve.r2)) if s.curve is not None else 0.0
        inputs = _input_levels(step, s)
        leaves += [Leaf(keys, names, mass * explained * predicted * share / len(inputs)) for keys, names in inputs]
    return leaves


def _input_levels(step: Stage, suspect: PlaceEstimate) -> list[tuple[tuple[object, ...], tuple[str, ...]]]:
    """Keys and names, on the levels system, place, kind and class, of an unknown input at a node, and of the signal inputs
    through which it may act: those of the sources on its nodes, and others with the same influence on the records (before a
    gain, for example)."""
    node, curve = suspect.place.nodes[0], suspect.curve
    names = frozenset(step.places.as_one.get(n.name, n.name) for n in suspect.place.nodes)
    moving = names - step.places.grounds
    kind = ""
    if curve is not None and curve.r2 >= INPUT_ESTIMATION.explains:
        kind = FOLLOWED.get(curve.variable.kind, "")
        if curve.variable.kind == "rate":
            kind = "acceleration" if node.mechanical else "storage"
    words = kind_words(kind, node.domain, len(moving) > 1) if kind else \
        f"exerts a {node.domain.members[node.through].noun} of unknown origin"
    at_node = (MACHINE, ("", moving or names, frozenset[str]()), kind, OUTSIDE), \
        (MACHINE, suspect.place.words, words, NO_LAW)
    nodes = {node.name for node in suspect.place.nodes}
    known = {score.candidate.label: score.candidate for score in step.scores}
    on_nodes = {label: c for label, c in known.items() if c.attaches == "input"
                and nodes & {*step.places.parts.get(c.where[0], {}).values()}}
    alike = {equivalent: known[equivalent] for label in on_nodes for equivalent in step.twins.get(label, ())
             if equivalent in known and known[equivalent].attaches == "input"}
    words = kind_words("transport", None, False)
    upstream = {(place := step.places.place(c)): ((MACHINE, place, "transport", OUTSIDE), (MACHINE, c.place, words, NO_LAW))
                for c in {**on_nodes, **alike}.values()}
    return [at_node, *upstream.values()]


# -- the tree -----------------------------------------------------------------------------------------------------------
def _grown(leaves: Sequence[Leaf], depth: int) -> tuple[Node, ...]:
    """Branches of the level below `depth` levels; each has the name of its most probable leaf."""
    groups: dict[object, list[Leaf]] = {}
    for leaf in leaves:
        if len(leaf.keys) > depth:
            groups.setdefault(leaf.keys[depth], []).append(leaf)
    nodes = []
    for key, group in groups.items():
        first = max(group, key=lambda leaf: leaf.probability)
        node = Node(LEVELS[depth + 1], first.names[depth], sum(leaf.probability for leaf in group), _grown(group, depth + 1),
                    key, tuple(label for leaf in group for label in leaf.labels))
        nodes.append(_with_rest(node))
    return tuple(sorted(nodes, key=lambda node: -node.probability))


def _with_rest(node: Node) -> Node:
    """Replace improbable children of a branch by "another", such that the probabilities of the children add up to the
    probability of the branch."""
    if not node.children:
        return node
    listed = [child for child in node.children if child.probability >= LISTED and child.name != ANOTHER]
    unlisted = node.probability - sum(child.probability for child in listed)
    another = Node(listed[0].level if listed else node.children[0].level, ANOTHER, max(0.0, unlisted), key=ANOTHER)
    return replace(node, children=(*listed, another))


def _path(root: Node) -> tuple[Node, ...]:
    """Stated branches from the top down: the most probable child of each, down to the last one with a probability of at
    least STATED."""
    path: list[Node] = []
    node = root
    while node.children:
        node = max(node.children, key=lambda child: child.probability)
        if node.probability < STATED or node.name == ANOTHER:
            break
        path.append(node)
    return tuple(path)


def _best(step: Stage, finding: AddedEffect | None, path: Sequence[Node], root: Node) -> Refit | AddedEffect | None:
    """Select the law to describe: the added effect if it belongs to the deepest stated branch, otherwise the most probable
    refitted law of this branch. If the branch has no law of the catalogue, a law elsewhere must explain a noticeable part of
    the misfit."""
    if path and path[-1].name in (NOTHING, PARAMETERS):
        return finding if finding is not None and finding.candidate.kind == VALUE else None
    inside = next((node.labels for node in reversed(path) if node.labels), None)
    if finding is not None and (inside is None or finding.candidate.label in inside):
        return finding
    trials = {t.candidate.label: t for t in step.trials}
    within = bool(path) and bool(path[-1].labels)
    laws = sorted(_leaves_of(path[-1] if within else root), key=lambda node: -node.probability)
    labels = [label for node in laws for label in node.labels if label in trials
              and (within or is_noticeable(step, trials[label]))]
    return trials[labels[0]] if labels else None


def _leaves_of(node: Node) -> list[Node]:
    return [leaf for child in node.children for leaf in _leaves_of(child)] if node.children else [node]


def branches(root: Node) -> list[tuple[int, Node]]:
    """Branches with their depth for tables: all with a probability of at least `SHOWN`."""
    rows: list[tuple[int, Node]] = []
    for child in root.children:
        if child.probability >= SHOWN:
            rows += [(0, child), *((depth + 1, node) for depth, node in branches(child))]
    return rows


def _with_equivalent_places(leaves: Sequence[Leaf], twins: Mapping[str, Sequence[str]]) -> list[Leaf]:
    """Give the laws of one class that the records cannot distinguish (`twins`: labels of candidates with equal influence),
    and the laws outside the catalogue of their kind there, one place: `before drive.u or before pump.u` in place of two with
    half of the probability each."""
    places: dict[tuple[object, ...], tuple[object, str]] = {}  # the common place of system, place, kind (and class)
    for group in ({label, *equivalents} for label, equivalents in twins.items()):
        alike: dict[object, list[Leaf]] = {}
        for leaf in leaves:
            if group & set(leaf.labels):
                alike.setdefault((leaf.keys[0], *leaf.keys[2:4]), []).append(leaf)
        for members in alike.values():
            names = list(dict.fromkeys(leaf.names[1] for leaf in sorted(members, key=lambda leaf: -leaf.probability)))
            common = frozenset(leaf.keys[1] for leaf in members), " or ".join(names[:LAWS])
            for leaf in members if len(names) > 1 else ():
                for key in (leaf.keys[:4], (*leaf.keys[:3], OUTSIDE)):
                    places.setdefault(key, common)
    merged = []
    for leaf in leaves:
        place, name = places.get(leaf.keys[:4], (leaf.keys[1], leaf.names[1]))
        merged.append(replace(leaf, keys=(leaf.keys[0], place, *leaf.keys[2:]),
                              names=(leaf.names[0], name, *leaf.names[2:])))
    return merged


# -- words --------------------------------------------------------------------------------------------------------------
def _meaning(best: Refit | AddedEffect, library: Library) -> str:
    """Sentence on the physics of the best law. For a parameter that the diagram holds fixed, its fitted value and its value
    in the diagram."""
    if not isinstance(best, AddedEffect):
        return physics(best.candidate, library, best.values)
    if best.candidate.kind == VALUE:
        (number,) = best.candidate.numbers
        value = best.parameters[0].value if best.parameters else number.neutral
        fitted, written = (readable(v, number.unit.text, 4) for v in (value, number.neutral))
        return f"{number.name} is {fitted}; the diagram has {written}."
    sentences, onset = variation_words([best]), onset_words(best)
    if sentences in ([], [onset]):  # a law, possibly with an onset
        values = {**best.fit.values, **{p.name: p.value for p in best.parameters}}
        sentences = [physics(best.candidate, library, values, best.parameters), *sentences]
    return " ".join(sentences)


def _statement(root: Node, path: Sequence[Node], best: Refit | AddedEffect | None) -> str:
    """Sentence on the stated levels, each with its probability."""
    by = {node.level: node for node in path}
    if not path:
        likely = [f"{node.name} ({percent(node.probability)})" for node in root.children[:LAWS] if node.name != ANOTHER]
        if not likely and best is None:
            return "No effect of the catalogue that was tried explains a noticeable part of the misfit."
        return f"The records do not decide what is missing: {listing(likely, LAWS)}." if likely else \
            "No level of the answer is probable."
    system = by["system"]
    if system.name == NOTHING:
        return f"No effect is missing ({percent(system.probability)})."
    if system.name == PARAMETERS:
        return f"Values of parameters differ from the diagram; no effect is missing ({percent(system.probability)})."
    if "place" not in by:
        places = [f"{node.name} ({percent(node.probability)})" for node in system.children[:LAWS] if node.name != ANOTHER]
        where = f"; the place is not decided: {listing(places, LAWS)}" if places else "; the place is not decided"
        return f"Something is missing in the {system.name} ({percent(system.probability)}){where}."
    place, kind = by["place"], by.get("kind")
    if kind is None:
        kinds = [f"something that {node.name} ({percent(node.probability)})" for node in place.children[:2]
                 if node.name != ANOTHER]
        possible_kinds = f": {' or '.join(kinds)}" if kinds else ""
        return f"Something is missing {place.name} ({percent(place.probability)}){possible_kinds}."
    predicate, _, variable = kind.name.partition(",")
    first = f"Something {predicate} {place.name}{',' + variable if variable else ''} ({percent(kind.probability)})"
    if "class" not in by:
        return f"{first}."
    named = by["class"]
    words = [first, f"{named.name} ({percent(named.probability)})"]
    laws = [node for node in named.children if node.name != ANOTHER]
    if laws and laws[0].key == OUTSIDE:
        words[-1] += f", probably with {laws[0].name} ({percent(laws[0].probability)})"
    elif laws and named.key != OUTSIDE:
        close = [n.name for n in laws[:LAWS] if n.probability >= COMPARABLE * laws[0].probability and n.key != OUTSIDE]
        words.append(f"law {' or '.join(close)}")
    return "; ".join(words) + "."


def _introduced(meaning: str, path: Sequence[Node], best: Refit | AddedEffect | None, root: Node) -> str:
    """Sentence on the physics. If the class is not stated, the sentence begins with the nearest class or law of the
    catalogue, or with the class that predicts best if another one is more probable: the files contain that one."""
    if not meaning or best is None:
        return ""
    last = path[-1] if path else None
    stated = last is not None and (last.level in ("class", "law") or last.name == PARAMETERS) and last.key != OUTSIDE
    if stated:
        return meaning
    if last is not None and last.level == "law":  # a known class, but not a law of the catalogue
        return f"Nearest law of the catalogue: {meaning}"
    classes = [node for _, node in branches(root) if node.level == "class" and node.labels]
    if classes and best.candidate.label not in max(classes, key=lambda node: node.probability).labels:
        kind = best.candidate.kind
        return f"{kind[:1].upper()}{kind[1:]} predicts best, but another class is more probable. {meaning}"
    return f"Nearest in the catalogue: {best.candidate.kind}. {meaning}"


def _short(path: Sequence[Node], best: Refit | AddedEffect | None) -> str:
    """Short name of an effect for a list: its class or kind, and its place."""
    by = {node.level: node for node in path}
    if "class" in by and by["class"].key != OUTSIDE:
        return f"{by['class'].name} {by['place'].name}"
    if best is None:
        return "an unknown effect"
    if not path:
        return f"an effect that the records do not decide, nearest {best.candidate.kind} {best.candidate.place}"
    return f"{best.candidate.kind} or the like {by['place'].name if 'place' in by else best.candidate.place}"
