"""The catalogue of candidates: every effect of the library at every place of a diagram that it fits.

There are three kinds of entries (see `language.definition.Effect`): a component that is attached, a component that replaces
another one, and a dormant parameter that is activated. No component is referred to by name here: a user-defined component
with an `effect:` is treated like the bundled ones.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, count
from math import isfinite, log, sqrt

import casadi as ca

from heavebond.core.errors import listing
from heavebond.core.units import Dimension, Unit, dimension_text, is_generic, read_unit, solved
from heavebond.equations.connect import Group, Network, connect
from heavebond.equations.expanded import Expanded, Leaf
from heavebond.equations.parameters import formula_order
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment, Prior
from heavebond.language.definition import (
    EXCLUDES,
    FACTOR,
    REVERSES,
    Component,
    Effect,
    FileInput,
    Formula,
    Parameter,
    SearchRange,
    Value,
    rate_of,
)
from heavebond.language.edits import Change, Part
from heavebond.language.effects import check_replacing, check_required
from heavebond.language.library import is_bundled
from heavebond.language.lists import written_out
from heavebond.numerics.dae import Assembly
from heavebond.text.expression import Binary, Expr, Name, Negative, Number, children, names, parse_formula
from heavebond.text.shapes import whole_number

ALL_PAIRS = 40  # largest number of nodes of a domain for which all pairs are places of effects
# Order of the approximation of effects with delayed variables; the default of PadeDelay.
EFFECT_ORDER = "3"


UNKNOWN = "unknown law"  # class of identified curves: a shape without a name


@dataclass(frozen=True)
class EffectNumber:
    """A parameter of an effect.

    * name: full name.
    * unit: base unit.
    * low, high: bounds of the value.
    * sought: search range; None if the search begins at `neutral` without a fixed range.
    * amplitude: True for an amplitude, False for a shape.
    * neutral: value without the effect.
    * limits: physical bounds of the parameter (its `min` and `max`); other bounds only limit the search.
    * parts: further parts that have the same parameter (one law at several places).
    * neutral_of: for a replacing law, the formula of the diagram's parameters for the neutral value.
    """

    name: str
    unit: Unit
    low: float | None
    high: float | None
    sought: SearchRange | None
    amplitude: bool
    neutral: float = 0.0
    limits: tuple[float | None, float | None] = (None, None)
    parts: tuple[str, ...] = ()
    neutral_of: str = ""

    @property
    def follows(self) -> str:
        """Full name of the variable whose motion sets the search range or the value; empty if a range is given."""
        if self.sought is None or self.sought.range is not None:
            return ""
        return f"{self.name.rpartition('.')[0]}.{self.sought.seen}"

    def prior(self, leaves: Mapping[str, Leaf]) -> Prior | None:
        """Weak normal prior from the typical values of the component; None if it has no typical range.

        The ends of the range are one standard deviation from its middle, on a logarithmic scale if the range is positive.
        The prior of an amplitude has its mean at the neutral value, and the farther end of the range is one standard
        deviation away: a small effect is not unusual.
        """
        path, _, key = self.name.rpartition(".")
        parameter = leaves[path].component.parameters.get(key) if path in leaves else None
        if parameter is None or parameter.typical is None or parameter.typical.range is None:
            return None
        low, high = parameter.typical.range.low, parameter.typical.range.high
        if self.amplitude and self.sought is None:
            return Prior(self.neutral, max(abs(low - self.neutral), abs(high - self.neutral)))
        if low > 0:
            return Prior(log(low * high) / 2, log(high / low) / 2, True)
        return Prior((low + high) / 2, (high - low) / 2)

    @property
    def motions(self) -> tuple[str, ...]:
        """Variables that set the search range, in all parts that have this parameter."""
        return (self.follows, *(f"{part}.{self.follows.rpartition('.')[2]}" for part in self.parts)) if self.follows else ()


@dataclass(frozen=True)
class Candidate:
    """One effect at one place.

    * name, component: name of the new part (or of the parameter), and its component.
    * kind: class of the effect.
    * place, where: the place in words, and as names of nodes, ports or outputs.
    * change: change to the diagram that inserts the effect at its neutral values.
    * numbers: parameters of the effect.
    * orders: pairs of parameters of which the first must exceed the second.
    * signal: signal input that the effect precedes.
    * members: if the law acts at several places at once, labels of the candidates at the single places.
    * old: component of the replaced part.
    * acts: quantity of the diagram that is positive while the effect acts.
    * partly: True if it must also be idle for a part of the records.
    * reverses: variable of the new part whose motion the effect ends, so that it must reverse; empty for other effects.
    * begins: parameters of the state at the start, with a value for each record.
    """

    name: str
    component: str
    kind: str
    description: str
    place: str
    where: tuple[str, ...]
    change: Change
    numbers: tuple[EffectNumber, ...]
    attaches: str
    orders: tuple[tuple[str, str], ...] = ()
    signal: str = ""
    members: tuple[str, ...] = ()
    old: str = ""
    acts: str = ""
    partly: bool = False
    reverses: str = ""
    begins: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Component and place, for example `CoulombFriction between platform and crown`."""
        return f"{self.component} {self.place}"

    def as_dict(self) -> dict[str, object]:
        """Return the candidate and its place for JSON."""
        return {"candidate": self.label, "component": self.component, "class": self.kind, "place": self.place,
                "where": list(self.where)}

    @property
    def curve_of_displacement(self) -> bool:
        """True for an identified curve over a displacement, according to the unit of the limits of its variable."""
        return self.kind == UNKNOWN and any(n.follows and n.unit.text in ("m", "rad") for n in self.numbers)

    @property
    def curve_of_channel(self) -> bool:
        """True for an identified curve over the value of a measured channel."""
        return self.kind == UNKNOWN and self.attaches == "channel"

    @property
    def varies(self) -> bool:
        """True if the candidate varies a parameter of the diagram with a variable, with time or between records."""
        return self.attaches == "parameter" or not self.change.each.keys() <= {*self.begins}

    @property
    def differs(self) -> bool:
        """True if the candidate gives a parameter of the diagram a separate value in each record."""
        return bool(self.change.each) and not self.numbers

    def acts_on(self, effects: Sequence[Candidate]) -> bool:
        """True if the candidate changes one of these effects instead of the machine.

        Such a candidate replaces a part of an effect, is in series with it, or activates or varies one of its parameters.
        Two further cases are equivalent to other candidates: a second factor of one parameter with the same variable, and an
        effect before the input of an effect in a channel.
        """
        parts = {name for effect in effects if effect.attaches != "replaces" for name in effect.change.components}
        behind = {name for effect in effects if effect.attaches == "channel" for name in effect.change.components}
        if self.attaches == "input" and self.where[0] in behind:
            return True
        part = {"in series": self.where[-1], "in": self.where[0], "replaces": self.where[0], "parameter": self.where[0]}
        return part.get(self.attaches) in parts or (self.varies and self.place in {e.place for e in effects})

    @property
    def vanishing(self) -> tuple[EffectNumber, ...]:
        """Amplitudes at whose neutral values the effect vanishes."""
        return tuple(n for n in self.numbers if n.amplitude and n.sought is None)

    @property
    def vanishes(self) -> bool:
        """True if the effect can be part of the diagram with amplitude zero."""
        return bool(self.vanishing)


@dataclass(frozen=True)
class Site:
    """A diagram in which effects are placed.

    * taken: names that must not be used, in addition to the names of the diagram.
    * apart: if True, each name that is assigned is added to `taken`.
    * excluded: reason for each effect that is not a candidate, by label.
    """

    experiment: Experiment
    assembly: Assembly
    expanded: Expanded
    network: Network
    taken: set[str] = field(default_factory=set)
    apart: bool = False
    excluded: dict[str, str] = field(default_factory=dict)

    @cached_property
    def names(self) -> frozenset[str]:
        """Names that the diagram uses."""
        body = self.experiment.model.body
        return frozenset((*body.instances, *body.wires, *self.experiment.model.parameters, *self.expanded.leaves,
                          *self.expanded.junctions))

    @property
    def nodes(self) -> dict[str, list[Group]]:
        """Nodes of each power domain."""
        groups: dict[str, list[Group]] = {}
        for group in self.network.groups:
            if group.domain != "signal":
                groups.setdefault(group.domain, []).append(group)
        return groups

    def group(self, port: str) -> Group:
        """Node to which a port is connected."""
        return self.network.groups[self.network.group_of_port[port]]

    def grounds(self, domain: str) -> dict[str, Group]:
        """Nodes of a domain that are connected to its reference component (`reference:`), which represents the surroundings.
        All these nodes are equivalent."""
        reference = self.experiment.model.library.domains[domain].reference
        ground_nodes = (self.group(f"{leaf.path}.{p}") for leaf in self.expanded.leaves.values()
                        if reference and leaf.component.is_a(reference) for p in leaf.component.ports)
        return {group.name: group for group in ground_nodes}

    def moving(self, domain: str) -> list[Group]:
        """Nodes of a domain without the grounds."""
        grounds = self.grounds(domain)
        return [group for group in self.nodes.get(domain, []) if group.name not in grounds]


Pairs = Callable[[Site, str], Iterator[tuple[Group, Group | None, str]]]  # generator of pairs of nodes of a domain


def site_of(experiment: Experiment) -> Site:
    """Create the site of the diagram of an experiment."""
    assembly = assemble_for(experiment, next(iter(experiment.records.values())))
    expanded = assembly.flat.expanded
    return Site(experiment, assembly, expanded, connect(expanded, formula_order(expanded)))


def single_candidates(experiment: Experiment, site: Site | None = None) -> list[Candidate]:
    """All effects of the catalogue at all single places of the diagram of an experiment: dormant parameters of its parts,
    then the effects in the order of the library.

    `site` is the diagram if it was created before. Raises ModelError for an invalid diagram or component.
    """
    site = site or site_of(experiment)
    all_candidates, values = list[Candidate](), site.assembly.parameter_values
    for leaf in site.expanded.leaves.values():
        for parameter in leaf.component.parameters.values():
            full = f"{leaf.path}.{parameter.name}"
            # a parameter is dormant at its neutral value; one that is set by a formula or to another value is active
            if parameter.neutral is None or values.get(full) != parameter.neutral:
                continue
            low, high = parameter.low, parameter.high
            if parameter.sought is not None and parameter.sought.range is not None:
                low, high = parameter.sought.range.low, parameter.sought.range.high
            woken = [p for p in leaf.component.parameters.values() if p.name in parameter.wakes_with]
            numbers = [EffectNumber(full, parameter.unit, low, high, None, True, parameter.neutral,
                                    (parameter.low, parameter.high)),
                       *(EffectNumber(f"{leaf.path}.{p.name}", p.unit, p.low, p.high, p.sought, False,
                                      limits=(p.low, p.high)) for p in woken)]
            kind = parameter.kind or parameter.doc or parameter.name
            all_candidates.append(within(leaf, parameter, kind, numbers))
    for component in experiment.model.library.effects():
        for effect in component.effects:
            check_required(component, effect, experiment.model.library.files)
            placed = [c for attachment in effect.attaches if attachment in _PLACING
                      for c in _PLACING[attachment](site, component, effect)]
            placed += [c for kind in effect.replaces for c in _replacing(site, component, effect, kind)]
            all_candidates += _where_meaningful(site, component, effect, placed)
    return all_candidates


def _where_meaningful(site: Site, component: Component, effect: Effect, placed: Sequence[Candidate]) -> list[Candidate]:
    """Select the candidates at places that satisfy the requirements of the effect, and add the conditions under which it
    acts."""
    acts = effect.acts
    if acts is not None:
        placed = [replace(c, acts=component.in_diagram(acts, c.name), partly=effect.partly) for c in placed]
    for variable in (key for key, required in effect.requires.items() if REVERSES in required):
        placed = [replace(c, reverses=f"{c.name}.{variable}") for c in placed]
    for key, sought in effect.begins.items():
        placed = [replace(c, begins=(*c.begins, f"{c.name}.{key}"), change=replace(
            c.change, each={**c.change.each, f"{c.name}.{key}": sought.range})) for c in placed if sought.range is not None]
    reasons = {c.label: _lacking(site, component, effect, c) for c in placed} if effect.requires else {}
    site.excluded.update({label: reason for label, reason in reasons.items() if reason})
    return [c for c in placed if not reasons.get(c.label)]


def _lacking(site: Site, component: Component, effect: Effect, candidate: Candidate) -> str:
    """Reason why the place of a candidate does not satisfy the requirements of its effect; empty if it does.

    The place must have the required components and must not have the excluded ones. A user-defined component that stores
    energy or fluid counts as any required component.
    """
    for port, kinds in effect.requires.items():
        node = next((node for node, ends in candidate.change.nodes.items() if f"+{candidate.name}.{port}" in ends), "")
        parts = [leaf.component for leaf in site.expanded.leaves.values() for p in leaf.component.ports.values()
                 if p.count is None and site.group(f"{leaf.path}.{p.name}").name == node]
        excluded = [kind.removeprefix(EXCLUDES) for kind in kinds if kind.startswith(EXCLUDES)]
        wanted = [kind for kind in kinds if not kind.startswith(EXCLUDES)]
        if port not in component.ports:
            continue
        if wanted and not any(part.is_a(kind) for part in parts for kind in wanted) and \
                not any(part.stores is not None and not is_bundled(part.path) for part in parts):
            return f"no {listing(wanted)} is connected there"
        if present := [kind for kind in excluded if any(part.is_a(kind) for part in parts)]:
            return f"{listing(present)} is connected there"
    return ""


def within(leaf: Leaf, parameter: Parameter, kind: str, numbers: Sequence[EffectNumber]) -> Candidate:
    """Create the candidate that changes parameters of a part."""
    settings = {n.name: quantity(n.neutral if n.amplitude else _middle(n.sought), n.unit) for n in numbers}
    return Candidate(f"{leaf.path}.{parameter.name}", leaf.component.name, kind, parameter.doc,
                     f"in {leaf.path} ({parameter.name})", (leaf.path,), Change(settings=settings), tuple(numbers), "in")


def _middle(sought: SearchRange | None) -> float:
    """Value of a shape parameter before the search. If the motion determines the value, it is set to 1, so that a law can
    divide by it."""
    if sought is None:
        return 0.0
    if sought.range is None:
        return 1.0
    low, high = sought.range.low, sought.range.high
    return sqrt(low * high) if low > 0 else (low + high) / 2


def quantity(value: float, unit: Unit) -> str:
    """Format an SI value with its base unit for a diagram."""
    return f"{value:.9g}" if unit.text in ("1", "") else f"{value:.9g} {unit.text}"


def _numbers(component: Component, effect: Effect, name: str, signal: Dimension = ()) -> tuple[EffectNumber, ...]:
    """Parameters of an effect with the full names of an instance. Generic units (`$U`) are resolved with the unit of the
    signal."""
    numbers = []
    for key, sought in [*effect.amplitude.items(), *effect.shapes.items()]:
        parameter = component.parameters[key]
        unit = parameter.unit
        if is_generic(unit.dimension):
            unit = read_unit(dimension_text(solved(unit.dimension, {base: signal for base, _ in unit.dimension
                                                                    if base.startswith("$")})))
        numbers.append(EffectNumber(f"{name}.{key}", unit, parameter.low, parameter.high, sought, key in effect.amplitude,
                                    limits=(parameter.low, parameter.high)))
    return tuple(numbers)


def _part(component: Component, numbers: tuple[EffectNumber, ...], more: dict[str, str] | None = None) -> Part:
    lower = {low for _, low in component.orders}
    values = {}
    for n in numbers:
        key = n.name.rpartition(".")[2]
        middle = _middle(n.sought)
        values[key] = quantity(-middle if key in lower and n.sought is not None and n.sought.seen else middle, n.unit)
    approximation = component.approximation  # many runs of a search are made without a history of delayed variables
    order = {} if approximation is None else {approximation.order: EFFECT_ORDER}
    return Part(component.name, {**(more or {}), **order, **values})


def _full(component: Component, name: str) -> tuple[tuple[str, str], ...]:
    return tuple((f"{name}.{high}", f"{name}.{low}") for high, low in component.orders)


def fresh(site: Site, base: str) -> str:
    """Unused instance name whose node names are also unused: `coulomb_friction`, `coulomb_friction_2`, ..."""
    names = (base if k == 1 else f"{base}_{k}" for k in count(1))
    name = next(n for n in names for new in [{n, f"{n}_end", f"{n}_in", f"{n}_out"}]
                if new.isdisjoint(site.names) and new.isdisjoint(site.taken))
    if site.apart:
        site.taken.update((name, f"{name}_end", f"{name}_in", f"{name}_out"))
    return name


def snake(name: str) -> str:
    """Convert `CoulombFriction` to `coulomb_friction`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def distant_candidates(site: Site, labels: Container[str] | None = None) -> list[Candidate]:
    """All effects across two nodes that no component connects (see `_distant_pairs`); if `labels` are given, only candidates
    with these labels."""
    return [candidate for component in site.experiment.model.library.effects() for effect in component.effects
            if "across" in effect.attaches
            for candidate in _where_meaningful(site, component, effect,
                                               [*_across(site, component, effect, _distant_pairs, labels)])]


def _across(site: Site, component: Component, effect: Effect, pairs: Pairs | None = None,
            labels: Container[str] | None = None) -> Iterator[Candidate]:
    """Candidates of an effect between `pairs` of nodes (default: nodes that a component connects); if `labels` are given,
    only these."""
    ports = [p for p in component.ports.values() if p.name not in effect.also]
    domains = [ports[0].domain] if not ports[0].domain.startswith("$") else list(site.nodes)
    for domain in domains:
        for first, second, ground in (pairs or _pairs)(site, domain):
            far = second.name if second is not None else "the surroundings"
            for also in _further(site, effect):
                place = f"between {first.name} and {far}" + "".join(f", pressed by {node}" for node in also.values())
                if labels is not None and f"{component.name} {place}" not in labels:
                    continue
                name = fresh(site, snake(component.name))
                numbers = _numbers(component, effect, name)
                ends: dict[str, tuple[str, ...]] = {first.name: (f"+{name}.{ports[0].name}",)}
                parts = {name: _part(component, numbers)}
                if second is None:
                    fixed = fresh(site, f"{name}_{snake(ground)}")
                    parts[fixed] = Part(ground)
                    ends[f"{name}_end"] = (f"{name}.{ports[1].name}", f"{fixed}.a")
                else:
                    ends[second.name] = (*ends.get(second.name, ()), f"+{name}.{ports[1].name}")
                for port, node in also.items():
                    ends[node] = (*ends.get(node, ()), f"+{name}.{port}")
                yield Candidate(name, component.name, effect.kind, effect.description, place,
                                (first.name, *([second.name] if second is not None else [])),
                                Change(parts, ends, initial=_settled(component, effect, name)), numbers, "across",
                                _full(component, name))


def _pairs(site: Site, domain: str) -> Iterator[tuple[Group, Group | None, str]]:
    """Pairs of nodes that a component connects, and pairs of each node with the surroundings.

    The surroundings are the node of the reference component of the domain (`reference:`). If the diagram has no reference
    component, the second node is None and the third element is the component to be added.
    """
    grounds = site.grounds(domain)
    listed: set[frozenset[str]] = set()
    for first, second in _joined_pairs(site, domain):
        key = frozenset("" if g.name in grounds else g.name for g in (first, second))
        if key not in listed and len(key) == 2:
            listed.add(key)
            yield first, second, ""
    reference = site.experiment.model.library.domains[domain].reference
    for node in site.moving(domain) if reference else []:
        if frozenset((node.name, "")) not in listed:
            yield node, next(iter(grounds.values()), None), reference or ""


def _joined_pairs(site: Site, domain: str) -> Iterator[tuple[Group, Group]]:
    """Pairs of nodes to which one component is connected."""
    for leaf in site.expanded.leaves.values():
        groups = {g.name: g for g in (site.group(f"{leaf.path}.{p}") for p in leaf.component.ports
                                      if leaf.component.ports[p].count is None) if g.domain == domain}
        yield from combinations(groups.values(), 2)


def _distant_pairs(site: Site, domain: str) -> Iterator[tuple[Group, Group, str]]:
    """Pairs of nodes that no component connects, ordered by their distance.

    The distance is the number of components between the nodes in the graph of the domain. Unconnected nodes are last, in the
    order of the diagram. If a domain has more than `ALL_PAIRS` nodes, the number of pairs is limited to the number for
    `ALL_PAIRS` nodes. Pairs with the surroundings are included in `_pairs` instead.
    """
    nodes = {group.name: group for group in site.moving(domain)}
    neighbours: dict[str, list[str]] = {name: [] for name in nodes}
    for first, second in _joined_pairs(site, domain):
        if first.name in nodes and second.name in nodes:
            neighbours[first.name].append(second.name)
            neighbours[second.name].append(first.name)
    pairs = []
    for k, start in enumerate(nodes):
        distance, reached = {start: 0}, deque([start])
        while reached:
            name = reached.popleft()
            for end in neighbours[name]:
                if end not in distance:
                    distance[end] = distance[name] + 1
                    reached.append(end)
        pairs += [(distance.get(end, len(nodes)), start, end) for end in list(nodes)[k + 1:]]
    apart = sorted((pair for pair in pairs if pair[0] > 1), key=lambda pair: pair[0])
    most = ALL_PAIRS * (ALL_PAIRS - 1) // 2
    yield from ((nodes[first], nodes[second], "") for _, first, second in apart[:most])


def _further(site: Site, effect: Effect) -> Iterator[dict[str, str]]:
    """Connections of the further ports of an effect: each node of their domain in turn."""
    if not effect.also:
        yield {}
        return
    (port, domain), *_ = effect.also.items()
    for node in site.moving(domain):
        yield {port: node.name}


def _at(site: Site, component: Component, effect: Effect) -> Iterator[Candidate]:
    port = next(p for p in component.ports.values() if p.name not in effect.also)
    for node in site.moving(port.domain):
        for also in _further(site, effect):
            name = fresh(site, snake(component.name))
            numbers = _numbers(component, effect, name)
            ends: dict[str, tuple[str, ...]] = {node.name: (f"+{name}.{port.name}",)}
            for further, further_node in also.items():
                ends[further_node] = (*ends.get(further_node, ()), f"+{name}.{further}")
            yield Candidate(name, component.name, effect.kind, effect.description, f"on {node.name}", (node.name,),
                            Change({name: _part(component, numbers)}, ends, initial=_settled(component, effect, name)),
                            numbers, "at", _full(component, name))


def _own_wire(site: Site, port: str) -> str | None:
    """Name of the node to which a port is connected, as written in the diagram or in the file of the surrounding block; None
    if there is none."""
    for wire in site.experiment.model.body.wires.values():
        if any(end.path == port for end in wire.ends):
            return wire.name
    part, _, name = port.rpartition(".")
    block, _, inner = part.rpartition(".")
    around = site.expanded.leaves.get(block) if block else None
    for wire in around.component.body.wires.values() if around is not None else ():
        if any(end.path == f"{inner}.{name}" for end in wire.ends):
            return f"{block}.{wire.name}"
    return None


def _is_written(site: Site, path: str) -> bool:
    """True if the diagram, or the file of the surrounding block, declares the part."""
    block, _, name = path.rpartition(".")
    body = site.expanded.leaves[block].component.body if block else site.experiment.model.body
    return name in body.instances


def _in_series(site: Site, component: Component, effect: Effect) -> Iterator[Candidate]:
    first, second = [p for p in component.ports.values() if p.name not in effect.also]
    divided: set[str] = set()
    for leaf in site.expanded.leaves.values():
        for port in leaf.component.ports.values():
            path = f"{leaf.path}.{port.name}"
            wire = _own_wire(site, path)
            # an end with the name of the node cannot be disconnected from it
            if wire is None or port.count is not None or wire == leaf.path:
                continue
            # an equation sets the force on the port or the flow through it to zero
            if any(isinstance(line.tree.left, Name) and line.tree.left.text.rpartition(".")[0] == port.name
                   and isinstance(line.tree.right, Number) and line.tree.right.value == 0
                   for line in leaf.component.equations):
                if port.domain == first.domain:
                    site.excluded[f"{component.name} before {path}"] = "nothing flows through that port"
                continue
            group = site.group(path)
            # if a node has two ports, the effect is the same behind either port
            if group.domain != first.domain or len(group.ports) < 2 or (len(group.ports) == 2 and group.name in divided):
                continue
            divided.add(group.name)
            name = fresh(site, snake(component.name))
            numbers = _numbers(component, effect, name)
            between = fresh(site, f"{leaf.path}_{port.name}".replace(".", "_"))
            ends = {wire: (f"-{path}", f"+{name}.{first.name}"), between: (path, f"{name}.{second.name}")}
            place = f"between {group.name} and {path}"
            yield Candidate(name, component.name, effect.kind, effect.description, place, (group.name, leaf.path),
                            Change({name: _part(component, numbers)}, ends, initial=_settled(component, effect, name)),
                            numbers, "in series", _full(component, name))


def _settled(component: Component, effect: Effect, name: str) -> dict[str, str]:
    """Initial conditions for an effect at rest: the rates and values in `settled:` are zero.

    A machine that already runs at the beginning of a record is close to this state. The conditions are guesses (`~`), which
    the conditions of the diagram override.
    """
    conditions = {}
    for variable in effect.settled:
        if (differentiated := rate_of(variable)) is not None:
            conditions[f"der({name}.{differentiated})"] = f"~ 0 {component.variables[differentiated].unit.text}/s"
        else:
            conditions[f"{name}.{variable}"] = f"~ {quantity(0.0, component.variables[variable].unit)}"
    return conditions


def _signal_ports(component: Component) -> tuple[str, str]:
    into = next(s.name for s in component.signals.values() if s.direction == "in")
    return into, next(s.name for s in component.signals.values() if s.direction == "out")


def _before_input(site: Site, component: Component, effect: Effect) -> Iterator[Candidate]:
    into, out = _signal_ports(component)
    for leaf in site.expanded.leaves.values():
        if not _is_written(site, leaf.path) or FACTOR in leaf.component.variables:
            continue  # the input of a factor is a variable of the machine
        for signal in leaf.component.signals.values():
            path = f"{leaf.path}.{signal.name}"
            wire = _own_wire(site, path)
            bound = leaf.inputs.get(signal.name)
            if signal.direction != "in" or (wire is None and bound is None):
                continue
            constant = bound is not None and isinstance(bound.value, Value) and not any(names(bound.value.expr))
            if wire is None and constant and not is_offset_or_gain(component):
                site.excluded[f"{component.name} before {path}"] = "this input is constant"
                continue
            block = leaf.path.rpartition(".")[0]
            if block and wire is None:  # a formula in the file of the block
                site.excluded[f"{component.name} before {path}"] = "a formula inside the block gives this input"
                continue
            if block:  # at a node that only connects an input of the block, the effect before this input is the same
                around = site.expanded.leaves[block].component
                inner_wire = next((w for w in around.body.wires.values() if f"{block}.{w.name}" == wire), None)
                ends = [end.path for end in inner_wire.ends] if inner_wire is not None else []
                if len(ends) == 2 and any(around.signals[end].direction == "in" for end in ends if end in around.signals):
                    continue
            name = fresh(site, f"{snake(component.name)}_{leaf.path}".replace(".", "_"))
            unit = site.network.units.get(leaf.path, {})
            numbers = _numbers(component, effect, name, solved(signal.unit.dimension, unit))
            change = _series_signal(name, _part(component, numbers), into, out, path, wire, leaf)
            change = replace(change, initial=_at_rest(site, component, name))
            yield Candidate(name, component.name, effect.kind, effect.description, f"before {path}", (leaf.path,), change,
                            numbers, "input", _full(component, name), path)


def is_offset_or_gain(component: Component) -> bool:
    """True for a law that only shifts or scales a signal: polynomial in the signal and the parameters, without states and
    without time."""
    known = {*component.signals, *component.parameters}

    def polynomial(expr: Expr) -> bool:
        if isinstance(expr, Name):
            return expr.text in known
        return isinstance(expr, (Number, Binary, Negative)) and all(map(polynomial, children(expr)))

    return not component.variables and all(polynomial(side) for line in component.equations
                                           for side in (line.tree.left, line.tree.right))


def _at_rest(site: Site, component: Component, name: str) -> dict[str, str]:
    """Initial conditions of a signal component for an input that was constant before the start.

    Each state with the unit of the input is equal to the input. The conditions are guesses (`~`), because variables that are
    not states follow from the equations.
    """
    if component.approximation is not None:
        component = site.experiment.model.library.component(component.approximation.kind)
    into, out = _signal_ports(component)
    unit = component.signals[into].unit.dimension
    whole = {p.name: number for p in component.parameters.values() if p.integer and p.default is not None
             for number in [whole_number(p.default.expr, {})] if number is not None}
    states = [out, *(v.name for v in written_out(component, whole).variables.values() if v.unit.dimension == unit)]
    return {f"{name}.{state}": f"~ ={name}.{into}" for state in states}


def _series_signal(name: str, part: Part, into: str, out: str, path: str, wire: str | None, leaf: Leaf) -> Change:
    """Insert a signal component before an input, which may be a column of a record, a formula or a node."""
    bound = leaf.inputs.get(path.rpartition(".")[2])
    if bound is not None and isinstance(bound.value, FileInput):
        placed = Part(part.kind, {into: "0", **part.values})
        off = {wire: (f"-{path}",)} if wire is not None else {}  # disconnects the source that the record replaces
        return Change({name: placed}, off, settings={path: f"={name}.{out}"}, moved={path: f"{name}.{into}"})
    if bound is not None and not isinstance(bound.value, FileInput):
        placed = Part(part.kind, {into: bound.value.text, **part.values})
        return Change({name: placed}, settings={path: f"={name}.{out}"})
    assert wire is not None
    return Change({name: part}, {wire: (f"-{path}", f"+{name}.{into}"), f"{name}_out": (f"{name}.{out}", path)})


def _behind_channel(site: Site, component: Component, effect: Effect) -> Iterator[Candidate]:
    into, out = _signal_ports(component)
    for channel, output in site.experiment.outputs.items():
        name = fresh(site, f"{snake(component.name)}_{re.sub('[^a-z0-9]+', '_', channel.lower())}")
        numbers = _numbers(component, effect, name, read_unit(output.shown.unit).dimension)
        formula = f"={output.shown.text}"
        part = _part(component, numbers, {into: formula})
        yield Candidate(name, component.name, effect.kind, effect.description, f"in the channel {channel}", (channel,),
                        Change({name: part}, initial=_at_rest(site, component, name), channels={channel: f"{name}.{out}"}),
                        numbers, "channel", _full(component, name))


def _replacing(site: Site, component: Component, effect: Effect, kind: str) -> Iterator[Candidate]:
    """Candidates that replace a simpler law by a more general one, at the parameter values at which both are equal."""
    check_replacing(component, effect, site.experiment.model.library.component(kind, effect.place))
    for leaf in site.expanded.leaves.values():
        if not leaf.component.is_a(kind) or not _is_written(site, leaf.path):
            continue
        formulas = {key: re.sub(r"\bold\.", f"{leaf.path}.", formula.text) for key, formula in effect.start.items()}
        values = {key: _evaluated(site.assembly, formula) for key, formula in formulas.items()}
        wrong = []
        for key, value in values.items():
            low, high = component.parameters[key].low, component.parameters[key].high
            if not isfinite(value) or (low is not None and value < low) or (high is not None and value > high):
                wrong.append(key)
        if wrong:
            site.excluded[f"{component.name} in place of {leaf.path}"] = \
                f"{leaf.path} has no equal values of {listing(wrong)}"
            continue
        numbers = {n.name.rpartition(".")[2]: n for n in _numbers(component, effect, leaf.path)}
        for key, formula in formulas.items():
            new = component.parameters[key]
            if key in numbers:
                numbers[key] = replace(numbers[key], neutral=values[key], neutral_of=formula)
            elif formula != f"{leaf.path}.{key}" and site.experiment.free.keys() & {
                    name.text for name in names(parse_formula(formula, units=False))}:
                # a free parameter remains free under its new name
                numbers[key] = EffectNumber(f"{leaf.path}.{key}", new.unit, new.low, new.high, None, True, values[key],
                                            (new.low, new.high), neutral_of=formula)
        part = _part(component, tuple(numbers.values()))
        written = {key: ("" if key in numbers else _written(leaf, effect.start[key]))
                   or quantity(value, component.parameters[key].unit) for key, value in values.items()}
        yield Candidate(leaf.path, component.name, effect.kind, effect.description, f"in place of {leaf.path}", (leaf.path,),
                        Change({leaf.path: Part(part.kind, {**part.values, **written})}), tuple(numbers.values()),
                        "replaces", _full(component, leaf.path), old=kind)


def _written(leaf: Leaf, formula: Formula) -> str:
    """Formula of the diagram for a parameter that the new part takes unchanged from the old one; empty otherwise."""
    bound = leaf.parameters.get(formula.text.strip().removeprefix("old."))
    if bound is None or not formula.text.strip().startswith("old.") or not isinstance(bound.value, Value) \
            or not bound.value.formula or bound.scope.startswith(leaf.scope):
        return ""
    text = bound.value.text.removeprefix("=")
    for name in sorted({n.text for n in names(bound.value.expr)} - {"time", "pi"}, key=len, reverse=True):
        text = re.sub(rf"(?<![\w.]){re.escape(name)}(?![\w.])", f"{bound.scope}{name}", text)
    return f"={text}"


def _evaluated(assembly: Assembly, formula: str) -> float:
    """Evaluate a formula of the diagram's parameters at their present values."""
    expression = assembly.expression(parse_formula(formula, units=False))
    function = ca.Function("start", list(assembly.arguments), [expression])
    zeros = [ca.DM.zeros(a.shape) for a in assembly.arguments]
    zeros[3] = ca.DM(assembly.p)
    return float(function(*zeros))


def at_values(candidate: Candidate, assembly: Assembly, values: Mapping[str, float]) -> Candidate:
    """Candidate with the neutral values that follow from the given values of the diagram's parameters (SI)."""
    numbers = [n for n in candidate.numbers if n.neutral_of]
    if not numbers:
        return candidate
    known = assembly.parameter_values
    fitted = assembly.with_parameters({name: value for name, value in values.items() if name in known})
    neutral = {n.name: _evaluated(fitted, n.neutral_of) for n in numbers}
    return replace(candidate, change=candidate.change.with_values(
        {n.name: quantity(neutral[n.name], n.unit) for n in numbers if n.sought is None}),
        numbers=tuple(replace(n, neutral=neutral.get(n.name, n.neutral)) for n in candidate.numbers))


_PLACING = {"across": _across, "at": _at, "in series": _in_series, "input": _before_input, "channel": _behind_channel}


def called(candidate: Candidate) -> str:
    """Class and place of an effect, with its name for `heavebond try`."""
    if candidate.attaches == "in":
        return f"{candidate.kind} in {candidate.where[0]} ({candidate.name})"
    return f"{candidate.kind} {candidate.place} ({candidate.component})"
