"""Circuits: one component sets the properties of the fluid, all components of its circuit use them, and some components
exclude others from their circuit.

A domain names the component that sets its medium (`medium: Fluid`), a parameter the property that it represents (`medium:
rho`). A circuit consists of nodes connected by parts with several ports of the domain. A parameter without a value becomes
the formula `=oil.rho`, so that it follows the fluid in runs, sensitivities and fits. Without a fluid it has its own default,
else the default of another part of the circuit, else the default of the medium's component. Defaults of different media in
one circuit are refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca

from heavebond.core.errors import ModelError, Place, Problems, either
from heavebond.equations.connect import Terminal
from heavebond.equations.expand import default
from heavebond.equations.expanded import Bound, Expanded, Leaf, Medium
from heavebond.language.definition import CircuitRule, Component, Domain, Parameter, Value
from heavebond.language.library import Library
from heavebond.language.symbols import Context, evaluate
from heavebond.text.expression import Name, Number, names

SAME_MEDIUM = 1e-3  # relative; c_p of air is given as 1005 J/(kg*K), kappa/(kappa - 1)*R is 1004.7 J/(kg*K)
LISTED = 8          # values in a message


def with_media(expanded: Expanded) -> Expanded:
    """Assign a value to every parameter that is open after `expand`; ModelError for a circuit with two media, and for a
    property that the medium does not have."""
    for domain in expanded.model.library.domains.values():
        if domain.medium:
            expanded = _with_medium(expanded, domain, domain.medium)
    return expanded


def _with_medium(expanded: Expanded, domain: Domain, medium: str) -> Expanded:
    """The parameters of parts in circuits of one domain, with their values."""
    library = expanded.model.library
    open_in = {path: wanted for path, leaf in expanded.leaves.items()
               if (wanted := [p for p in leaf.component.parameters.values() if p.medium and p.name not in leaf.parameters])
               and _domain_of_medium(leaf.component, library.domains) is domain}
    if not open_in and not any(leaf.component.is_a(medium) for leaf in expanded.leaves.values()):
        return expanded
    problems = Problems()
    circuits = _circuits(expanded, domain)
    sources: dict[int, str] = {}  # the part that sets the medium of each circuit
    for path, leaf in expanded.leaves.items():
        if leaf.component.is_a(medium):
            circuit = circuits.get(Terminal("port", f"{path}.{next(iter(leaf.component.ports))}"), -1)
            earlier = sources.setdefault(circuit, path)
            if earlier != path:
                problems.add("media-mixed", f"{either([earlier, path])} fill the same circuit; parts and wires join it all",
                             leaf.place, hint=f"Remove one {medium}: it counts for all that is joined, through valves and "
                             "past pistons too. A single part may have separate values.")
    problems.raise_as(ModelError)
    if not open_in:
        return expanded
    kind, leaves, takers = library.component(medium), dict(expanded.leaves), dict[int, list[str]]()
    defaults: dict[int, list[_Default]] = {}
    for path, parameters in open_in.items():
        leaf = leaves[path]
        circuit = next((circuits[port] for ports in _passages(path, leaf.component, domain) for port in ports
                        if port in circuits), -1)
        bounds = {p.name: _bound(p, leaf, sources.get(circuit, ""), kind, problems) for p in parameters}
        leaves[path] = replace(leaf, parameters={name: bounds[name] if name in bounds else leaf.parameters[name]
                                                 for name in leaf.component.parameters})
        without_value = [p.name for p in parameters if circuit in sources or default(p, path) is None]
        if without_value:
            takers.setdefault(circuit, []).extend(f"{path}.{name}" for name in without_value)
        if circuit not in sources and circuit >= 0:
            defaults.setdefault(circuit, []).extend(_defaults(path, parameters, kind, leaves[path].place))
    for circuit, values in defaults.items():
        nodes = [n for n in expanded.junctions if circuits.get(Terminal("node", n)) == circuit]
        followed = _one_medium(values)
        if followed is None:
            _mixed(values, library, kind, nodes, problems)
        for taker, leader in (followed or {}).items():
            leaf = leaves[taker.path]
            leaves[taker.path] = replace(leaf, parameters={
                **leaf.parameters, taker.parameter.name: leaves[leader.path].parameters[leader.parameter.name]})
    problems.raise_as(ModelError)
    media = tuple(Medium(sources.get(circuit, ""), kind.name,
                         tuple(n for n in expanded.junctions if circuits.get(Terminal("node", n)) == circuit), tuple(names))
                  for circuit, names in takers.items())
    return replace(expanded, leaves=leaves, media=(*expanded.media, *media))


def check_circuits(expanded: Expanded) -> None:
    """ModelError for parts in a circuit from which another part excludes them (`circuit:` of its component), and for parts
    of one circuit whose common port is on different nodes."""
    problems, domains = Problems(), expanded.model.library.domains
    for domain in {leaf.component.ports[rule.port].domain: None for leaf in expanded.leaves.values()
                   if (rule := leaf.component.circuit) is not None}:
        circuits, nodes = _circuits(expanded, domains[domain]), _circuits(expanded, None)
        first: dict[tuple[int, CircuitRule], str] = {}  # a part of each circuit with the rule
        for path, leaf in expanded.leaves.items():
            if (rule := leaf.component.circuit) is None or leaf.component.ports[rule.port].domain != domain:
                continue
            earlier = first.setdefault((circuits.get(Terminal("port", f"{path}.{rule.port}"), -1), rule), path)
            one, other = (nodes.get(Terminal("port", f"{part}.{rule.shares}")) for part in (earlier, path))
            if earlier != path and one != other:
                problems.add("circuit-shared", f"'{earlier}' and '{path}' are in one {domain} circuit, but their ports "
                             f"{rule.shares} are on different nodes", leaf.place,
                             hint=f"Connect '{path}.{rule.shares}' to the node of '{earlier}.{rule.shares}'.")
        for path, leaf in expanded.leaves.items():
            for passage in _passages(path, leaf.component, domains[domain]):
                for (circuit, rule), part in first.items():
                    kinds = [kind for kind in rule.excludes if leaf.component.is_a(kind)]
                    if kinds and circuit in {circuits.get(port) for port in passage}:
                        problems.add("circuit-excluded", f"'{path}' ({leaf.component.name}) cannot be in the {domain} "
                                     f"circuit of '{part}' ({expanded.leaves[part].component.name})", leaf.place,
                                     hint=rule.advice)
    problems.raise_as(ModelError)


def medium_of(component: Component, domains: Mapping[str, Domain]) -> str:
    """The component that sets the medium from which parameters of a component are taken."""
    domain = _domain_of_medium(component, domains)
    return (domain.medium if domain is not None else None) or ""


def _domain_of_medium(component: Component, domains: Mapping[str, Domain]) -> Domain | None:
    """The domain of the medium from which the parameters of a component are taken: the domain of its first port that has a
    medium; for a component without such a port the first of all."""
    medium_domains = [domains[port.domain] for port in component.ports.values() if port.domain in domains]
    return next((d for d in (*medium_domains, *domains.values()) if d.medium), None)


def _passages(path: str, component: Component, domain: Domain) -> list[list[Terminal]]:
    """The ports of a part between which the medium flows; ports of an open domain may carry any medium."""
    passages: dict[str, list[Terminal]] = {}
    for port in component.ports.values():
        if port.domain == domain.name or port.domain.startswith("$"):
            passages.setdefault(port.domain, []).append(Terminal("port", f"{path}.{port.name}"))
    return list(passages.values())


def _circuits(expanded: Expanded, domain: Domain | None) -> dict[Terminal, int]:
    """The number of the circuit of each port and of each node; without a domain, of the nodes that wires alone connect."""
    links = [[Terminal("node", junction.path), *(Terminal("port", end.name.partition("[")[0]) for end in junction.ends)]
             for junction in expanded.junctions.values()]
    # the ports of a block are joined, or not, by what is inside
    links += [link for path, leaf in expanded.leaves.items() if domain is not None and not leaf.component.composite
              for link in _passages(path, leaf.component, domain)]
    # items that share a link, directly or over others, have the same number
    number: dict[Terminal, int] = {}
    members: list[list[Terminal]] = []
    for link in links:
        groups = list(dict.fromkeys(number[item] for item in link if item in number))
        # the largest group keeps its number: an item changes its own a few times at most, however long the circuit
        largest = max(groups, key=lambda k: len(members[k]), default=len(members))
        if largest == len(members):
            members.append([])
        joined = [item for item in link if item not in number]
        for old in groups:
            if old != largest:
                joined += members[old]
                members[old] = []
        members[largest] += joined
        number.update(dict.fromkeys(joined, largest))
    return number


@dataclass(frozen=True, eq=False)
class _Default:
    """The default of a property of the medium in one part, in SI: `specified` there, else the medium's."""

    path: str
    parameter: Parameter
    specified: bool
    value: float
    usual: float
    place: Place

    @property
    def deviates(self) -> bool:
        """True if the default of the part belongs to another medium."""
        return not _alike(self.value, self.usual)


def _defaults(path: str, parameters: Iterable[Parameter], kind: Component, place: Place) -> Iterator[_Default]:
    """The defaults that the open parameters of a part take where nothing sets the medium; those that are formulas are left
    out, except in the medium itself."""
    for parameter in parameters:
        usual = kind.parameters.get(parameter.medium)
        value = _number(parameter, {}) if parameter.default is not None or parameter.neutral is not None else None
        standard = _number(usual, kind.parameters) if usual is not None else None
        if standard is not None and (value is not None or default(parameter, path) is None):
            yield _Default(path, parameter, value is not None, standard if value is None else value, standard, place)


def _number(parameter: Parameter, declared: Mapping[str, Parameter]) -> float | None:
    """The default of a parameter, which may be a formula of the defaults of `declared`; None if it is not a number."""
    if parameter.default is None:
        return parameter.neutral
    expr = parameter.default.expr
    if isinstance(expr, Number):
        return expr.value
    known: dict[str, float] = {}
    for name in names(expr):
        value = _number(declared[name.text], declared) if name.text in declared else None
        if value is None:
            return None
        known[name.text] = value
    return float(evaluate(expr, Context(lambda text, _: ca.SX(known[text]), lambda _: ca.SX(0))))


def _one_medium(defaults: Sequence[_Default]) -> dict[_Default, _Default] | None:
    """The parts that take a default from another part because they have none, such as the density of a tank of water. None
    if the defaults of a circuit belong to different media."""
    leaders: dict[str, _Default] = {}
    for d in defaults:
        if d.deviates and not _alike(d.value, leaders.setdefault(d.parameter.medium, d).value):
            return None
    followers = [d for d in defaults if leaders and not d.deviates and d.usual]
    if any(d.specified or d.parameter.medium not in leaders for d in followers):
        return None
    return {d: leaders[d.parameter.medium] for d in followers}


def _alike(one: float, another: float) -> bool:
    return abs(one - another) <= SAME_MEDIUM * max(abs(one), abs(another))


def _mixed(defaults: Sequence[_Default], library: Library, kind: Component, nodes: Sequence[str],
           problems: Problems) -> None:
    """Note a problem for a circuit whose parts take defaults of different media, such as a tank of water and an orifice of
    mineral oil."""
    deviating = [d for d in defaults if d.deviates]
    alike = [d for d in defaults if not d.deviates and d.usual]
    listed = [f"{d.path}.{d.parameter.name} = {d.value:g} {d.parameter.unit.text}" for d in (*deviating, *alike)]
    node = next((n for n in nodes if "." not in n), nodes[0] if nodes else "NODE")
    media = " or ".join(f"`medium: {{is: {n}}}`" for n in library.names() if library.component(n).is_a(kind.name))
    problems.add("media-defaults", f"nothing sets the medium of the circuit of node '{node}', and its parts have defaults "
                 "of different media", deviating[0].place, notes=[*listed[:LISTED], *(
                     [f"and {len(listed) - LISTED} more"] if len(listed) > LISTED else [])],
                 hint=f"Add {media} to the components and `medium.a` to node '{node}', or give the parts their own values.")


def _bound(parameter: Parameter, leaf: Leaf, source: str, kind: Component, problems: Problems) -> Bound:
    """The value of an open parameter: the medium's, else the default of the part, else the default of the medium's
    component."""
    usual = kind.parameters.get(parameter.medium)
    if source and usual is not None:
        name = f"{source}.{parameter.medium}"
        formula = Value(Name(tuple(name.split(".")), 0, len(name)), f"= {name}", leaf.place, formula=True)
        return Bound(formula, "", leaf.place)
    value = default(parameter, leaf.path) or (default(usual, leaf.path) if usual is not None else None)
    if value is None:
        problems.add("medium-property", f"{leaf.component.name} takes {parameter.name} from the '{parameter.medium}' of a "
                     f"{kind.name}, which has none", parameter.place,
                     hint=f"{kind.name} has {', '.join(kind.parameters)}.")
        return Bound(Value(Name(("pi",), 0, 0), "", leaf.place), "", leaf.place)
    return value
