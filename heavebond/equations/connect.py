"""Connections: groups of ports that share one across variable or one signal, with their domains and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from heavebond.core.errors import ModelError, Place, Problems, either
from heavebond.core.units import (
    ONE,
    Dimension,
    Unit,
    UnitProblem,
    declared_unit,
    dimension_text,
    is_generic,
    read_unit,
    solved,
    times,
)
from heavebond.equations.expanded import Bound, Expanded
from heavebond.language.definition import FileInput, Value
from heavebond.text.dimensions import dimension
from heavebond.text.expression import ExpressionProblem, Name, Number

SECOND = declared_unit("s").dimension


class Terminal(NamedTuple):
    """A node or a port of the diagram: a path may be both."""

    kind: Literal["node", "port"]
    path: str


@dataclass(frozen=True)
class Members:
    """The paths of the nodes and ports of one group, each in the order of their declaration."""

    nodes: tuple[str, ...]
    ports: tuple[str, ...]


@dataclass(frozen=True)
class Group:
    """Ports and nodes that are one: `name` is the outermost node's (or the only port's), `aliases` all of them."""

    name: str
    domain: str  # "signal" for signals
    aliases: tuple[str, ...]
    ports: tuple[str, ...]
    place: Place


@dataclass(frozen=True)
class Network:
    """The groups, the index of the group of each port path and each node path, the domain of each port, the solved units
    of each leaf."""

    groups: tuple[Group, ...]
    group_of_port: dict[str, int]
    group_of_node: dict[str, int]
    domains: dict[str, dict[str, str]]
    units: dict[str, dict[str, Dimension]]


def connect(expanded: Expanded, order: Sequence[str] = ()) -> Network:
    """Connect ports by wires; ModelError for mixed domains, undetermined units, and signals with two sources.

    `order` names the parameters given by formulas, each after those that it uses.
    """
    network, problems = connect_as_far(expanded)
    problems.raise_as(ModelError)
    for group in network.groups:
        if group.domain != "signal":
            continue
        outputs, inputs = drivers(expanded, group)
        if len(outputs) > 1:
            problems.add("signal-driven-twice", f"signal '{group.name}' has {len(outputs)} outputs, {either(outputs)}",
                         group.place, hint="A signal has exactly one; add them with a Sum.")
        for path, bound in inputs if outputs else inputs[1:]:
            leaf, _, name = path.rpartition(".")
            second = outputs[0] if outputs else inputs[0][0]
            problems.add("input-twice", f"'{path}' has a value in place, and '{second}' sets it too (node "
                         f"'{group.name}')", bound.place,
                         hint=f"Remove `{name}:` from '{leaf}', or take '{path}' off the node.")
        if not outputs and not inputs:
            problems.add("signal-undriven", f"nothing sets the signal '{group.name}'", group.place,
                         hint="Join it to an output, or give the input a value in place.")
    problems.raise_as(ModelError)
    units = _units(expanded, network, _Dimensions(expanded, order), problems)
    problems.raise_as(ModelError)
    return replace(network, units=units)


def connect_as_far(expanded: Expanded) -> tuple[Network, Problems]:
    """The groups of an incomplete diagram with their domains, and the problems of these. An undetermined domain is empty,
    and units are not solved."""
    problems = Problems()
    # union-find over ports and nodes; groups in the order in which their first member is declared
    parent: dict[Terminal, Terminal] = {}

    def root(item: Terminal) -> Terminal:
        parent.setdefault(item, item)
        while parent[item] != item:
            parent[item] = parent[parent[item]]
            item = parent[item]
        return item

    for junction in expanded.junctions.values():
        node = root(Terminal("node", junction.path))
        for end in junction.ends:
            # an input set to a record from outside (an experiment) leaves the node that drives it in the diagram
            bound = expanded.leaves[end.leaf].inputs.get(end.port) if end.leaf in expanded.leaves else None
            if not (bound is not None and isinstance(bound.value, FileInput)):
                parent[root(Terminal("port", end.name))] = node
    for path in (*expanded.ports, *expanded.signals):
        if expanded.ports.get(path) is None or expanded.ports[path].count is None:
            root(Terminal("port", path))
    members: dict[Terminal, list[Terminal]] = {}
    for item in parent:
        members.setdefault(root(item), []).append(item)
    groups = [Members(tuple(m.path for m in group if m.kind == "node"), tuple(m.path for m in group if m.kind == "port"))
              for group in members.values()]
    domains = _domains(expanded, groups, problems)
    named = [_named(expanded, members, domain) for members, domain in zip(groups, domains, strict=True)]
    of_port = {port: k for k, members in enumerate(groups) for port in members.ports}
    of_node = {node: k for k, members in enumerate(groups) for node in members.nodes}
    domain_of_port: dict[str, dict[str, str]] = {}
    for path, leaf in expanded.leaves.items():
        domain_of_port[path] = {}
        for port in leaf.component.ports.values():
            port_path = f"{path}.{port.name}" + ("[1]" if port.count is not None else "")
            if port_path in of_port:
                domain_of_port[path][port.name] = named[of_port[port_path]].domain
    return Network(tuple(named), of_port, of_node, domain_of_port, {}), problems


def port_definition(expanded: Expanded, path: str) -> str:
    """The declared domain of a port path (`x.p[2]` is declared as `x.p`), or `signal`."""
    base = path.partition("[")[0]
    return expanded.ports[base].domain if base in expanded.ports else "signal"


def _domains(expanded: Expanded, groups: list[Members], problems: Problems) -> list[str]:
    """The domain of each group; `$D` of a leaf is taken from whatever its ports are wired to."""
    domains = [""] * len(groups)
    bound: dict[tuple[str, str], str] = {}
    changed = True
    while changed:
        changed = False
        for k, members in enumerate(groups):
            for path in members.ports:
                declared = port_definition(expanded, path)
                key = (path.rpartition(".")[0], declared)
                domain = bound.get(key, "") if declared.startswith("$") else declared
                if domain and not domains[k]:
                    domains[k], changed = domain, True
                # no port of power is ever a signal, which the check of mixed domains reports
                elif declared.startswith("$") and domains[k] not in ("", "signal") and not domain:
                    bound[key], changed = domains[k], True
    for junction in expanded.junctions.values():
        kinds: dict[str, str] = {}
        for end in junction.ends:
            declared = port_definition(expanded, end.name)
            kind = bound.get((end.leaf, declared), "") if declared.startswith("$") else declared
            kinds.setdefault(kind, end.name)
        if "signal" not in kinds:
            kinds.pop("", "")  # a port of any domain
        if len(kinds) > 1:
            odd = list(kinds.values())[-1]
            place = next(end.place for end in junction.ends if end.name == odd)
            problems.add("domains-mixed", f"node '{junction.path}' joins " + " and ".join(
                f"a {kind or 'power'} port ('{port}')" if kind != "signal" else f"a signal ('{port}')"
                for kind, port in kinds.items()), place,
                hint="A signal acts through a source (ForceSource, FlowSource, ...) and comes from a sensor."
                if "signal" in kinds else
                "A machine in space has parts of the library `spatial`, such as SpatialBody and SpatialRevoluteJoint; a "
                "PlaneInSpace joins a machine in a fixed plane to it, a PlaneOnBody one in the plane of a body."
                if {"planar", "spatial"} <= set(kinds) else
                "A node joins ports of one domain; a component such as a Cylinder goes from one to another.")
    # a port of any domain has one effort and one flow
    for (path, _), name in bound.items():
        definition = expanded.model.library.domains.get(name)
        if definition is not None and (definition.effort is None or definition.flow is None):
            leaf = expanded.leaves[path]
            several = len(definition.efforts) > 1
            problems.add("domain-pair", f"'{path}' ({leaf.component.name}) has one effort and one flow at its ports; a "
                         f"{name} node has {'several of each' if several else 'none'}", leaf.place,
                         hint=f"Take a component whose port is {name}, or one that leads from there to another domain"
                         + (", such as a PlanarShaft." if name == "planar" else "."))
    for k, members in enumerate(groups):
        if not domains[k] and members.ports:
            path = members.ports[0]
            leaf = expanded.leaves[path.rpartition(".")[0]]
            problems.add("domain-open", f"nothing determines the domain of '{path}'",
                         leaf.place, hint="Join it to a port of a component that has a domain.")
    return domains


def _named(expanded: Expanded, members: Members, domain: str) -> Group:
    nodes, ports = members.nodes, members.ports
    outermost = min(nodes or ports, key=lambda path: path.count("."))
    place = expanded.junctions[outermost].place if nodes else \
        expanded.leaves[outermost.rpartition(".")[0]].place
    return Group(outermost, domain, (*nodes, *ports), ports, place)


# -- signals ---------------------------------------------------------------------------------------------------------
def drivers(expanded: Expanded, group: Group) -> tuple[list[str], list[tuple[str, Bound]]]:
    """The sources of a signal group: outputs of components, and values given in place at inputs."""
    outputs, inputs = [], []
    for path in group.ports:
        leaf, _, port = path.rpartition(".")
        component = expanded.leaves[leaf].component
        direction = component.signals[port].direction
        inner = {e.path for w in component.body.wires.values() for e in w.ends}
        if direction == "out" and port.partition("[")[0] not in inner:
            outputs.append(path)
        if port in expanded.leaves[leaf].inputs:
            inputs.append((path, expanded.leaves[leaf].inputs[port]))
    return outputs, inputs


def _units(expanded: Expanded, network: Network, dimensions: _Dimensions, problems: Problems
           ) -> dict[str, dict[str, Dimension]]:
    """Solve `$U` of each leaf from parameters with units, the signals it is joined to and formulas at its inputs. Signals
    without any relation to a unit (a loop of gains and memories) are plain numbers."""
    solution: dict[str, dict[str, Dimension]] = {path: {} for path in expanded.leaves}
    constraints: list[tuple[str, Dimension, Dimension]] = []
    for path, leaf in expanded.leaves.items():
        for name, bound in leaf.parameters.items():
            parameter = leaf.component.parameters[name]
            if is_generic(parameter.unit.dimension) and isinstance(bound.value, Value) \
                    and (value_dimension := dimensions.of(bound)) is not None:
                constraints.append((path, parameter.unit.dimension, value_dimension))
    signals = [g for g in network.groups if g.domain == "signal"]
    formulas = _Formulas(expanded, network, dimensions, solution)
    changed = True
    while changed:
        changed = False
        for path, declared, value_dimension in constraints:
            changed |= _solve(declared, value_dimension, solution[path])
        for group in signals:
            known = formulas.signal(group)
            if known is None:
                input_dimensions = (formulas.of(bound) for _, bound in drivers(expanded, group)[1])
                known = next((g for g in input_dimensions if g is not None), None)
            if known is None:
                continue
            for port in (*group.ports, *formulas.equal(group)):
                owner, _, name = port.rpartition(".")
                changed |= _solve(expanded.leaves[owner].component.signals[name].unit.dimension, known, solution[owner])
        if not changed:  # one signal with an undetermined unit is a plain number
            ports = [port.rpartition(".") for group in signals for port in group.ports]
            changed = any(_solve(expanded.leaves[owner].component.signals[name].unit.dimension, ONE, solution[owner])
                          for owner, _, name in ports)
    for group in signals:
        units = {port: signal_unit(expanded, port, solution) for port in group.ports}
        first = next(iter(units))
        for port, unit in units.items():
            if unit.dimension != units[first].dimension or {unit.counts, units[first].counts} == {"cycles", "angle"}:
                factor = dimension_text(times(unit.dimension, units[first].dimension, -1))
                problems.add("units-differ", f"signal '{group.name}' joins {units[first].text} ('{first}') and "
                             f"{unit.text} ('{port}')", group.place, hint="Check the wire. To convert, give the input "
                             f"a formula in place: `{port.rpartition('.')[2]}: \"=k*{first}\"` with k in {factor}.")
    return solution


class _Dimensions:
    """The dimensions of values in the diagram; those of its parameters are computed once."""

    def __init__(self, expanded: Expanded, order: Sequence[str]):
        self.expanded = expanded
        self.known: dict[str, Dimension | None] = {}
        formulas = set(order)
        for name in [*(n for n in expanded.parameters if n not in formulas), *order]:
            if name in expanded.parameters:
                self.known[name] = self.of(expanded.parameters[name])

    def of(self, bound: Bound) -> Dimension | None:
        """The dimension of a value that consists of quantities and parameters with known units; None if it is
        undetermined."""
        assert isinstance(bound.value, Value)
        if bound.value.si:
            number = bound.value.expr
            return number.unit.dimension if isinstance(number, Number) and number.unit is not None else None
        try:
            return dimension(bound.value.expr, lambda name: self._parameter(bound.scope + name.text, name))
        except ExpressionProblem:
            return None  # not known yet, or the complaint comes with the check of the parameter itself

    def _parameter(self, path: str, name: Name) -> Dimension:
        owner, _, parameter = path.rpartition(".")
        declared = self.expanded.leaves[owner].component.parameters.get(parameter) if owner in self.expanded.leaves else None
        dimension = ONE if name.text == "pi" else self.known.get(path, None if declared is None else declared.unit.dimension)
        if dimension is None or is_generic(dimension):
            raise ExpressionProblem("unit-open", f"the unit of '{name.text}' is not known", name.column, name.length)
        return dimension


def _solve(declared: Dimension, dimension: Dimension, known: dict[str, Dimension]) -> bool:
    """Solve declared = dimension for one unknown unit in `declared`; True if a unit was determined."""
    unsolved = solved(declared, known)
    unknown = [(base, power) for base, power in unsolved if base.startswith("$")]
    if len(unknown) != 1:
        return False
    (base, power), = unknown
    known_powers = tuple((b, p) for b, p in unsolved if b != base)
    known[base] = times(ONE, times(dimension, known_powers, -1), 1 / power)
    return True


class _Formulas:
    """The dimensions of formulas and records at inputs, with the units of signals that are already solved."""

    def __init__(self, expanded: Expanded, network: Network, dimensions: _Dimensions,
                 solution: dict[str, dict[str, Dimension]]):
        self.expanded, self.network, self.dimensions, self.solution = expanded, network, dimensions, solution
        self.group_of = {alias: group for group in network.groups for alias in group.aliases}

    def equal(self, group: Group) -> list[str]:
        """Signals elsewhere that an input of the group is set to by their bare name (`u: =lag.y`)."""
        ports = []
        for _, bound in drivers(self.expanded, group)[1]:
            name = bound.value.expr if isinstance(bound.value, Value) else None
            if isinstance(name, Name) and (source := self.group_of.get(bound.scope + name.text)) is not None:
                ports += [port for port in source.ports if source.domain == "signal"]
        return ports

    def of(self, bound: Bound) -> Dimension | None:
        """The dimension of the value given to an input; None if it is undetermined (a plain 0, a name without a known
        unit)."""
        if isinstance(bound.value, FileInput):
            return read_unit(bound.value.unit).dimension
        if isinstance(bound.value.expr, Number) and bound.value.expr.unit is None and bound.value.expr.value == 0:
            return None
        try:
            return dimension(bound.value.expr, lambda name: self._named(bound.scope + name.text, name))
        except (ExpressionProblem, UnitProblem):
            return None  # the complaint comes with the check of the formula itself

    def _named(self, path: str, name: Name) -> Dimension:
        dimension = SECOND if name.text == "time" else ONE if name.text == "pi" else self._member(path)
        if dimension is None or is_generic(dimension):
            raise ExpressionProblem("unit-open", f"the unit of '{name.text}' is not known", name.column, name.length)
        return dimension

    def _member(self, path: str) -> Dimension | None:
        """The dimension of a parameter, a variable, a signal, or a member of a node or port."""
        owner, _, name = path.rpartition(".")
        leaf, group = self.expanded.leaves.get(owner), self.group_of.get(owner)
        if path in self.dimensions.known:
            return self.dimensions.known[path]
        signal = self.group_of.get(path)
        if signal is not None and signal.domain == "signal":
            return self.signal(signal)
        if group is not None and group.domain != "signal":
            domain = self.expanded.model.library.domains[group.domain]
            member = domain.members.get(domain.role(name))
            if member is not None:
                return member.unit.dimension
        if leaf is None:
            return None
        item = next((declaration for group in (leaf.component.variables, leaf.component.parameters)
                     for key in (name, f"{name}[1]") if (declaration := group.get(key)) is not None), None)
        return None if item is None else solved(item.unit.dimension, self.solution[owner])

    def signal(self, group: Group) -> Dimension | None:
        """The dimension of a signal, from any of its ports."""
        for port in group.ports:
            leaf, _, name = port.rpartition(".")
            dimension = solved(self.expanded.leaves[leaf].component.signals[name].unit.dimension, self.solution[leaf])
            if not is_generic(dimension):
                return dimension
        return None


def signal_unit(expanded: Expanded, port: str, solution: dict[str, dict[str, Dimension]]) -> Unit:
    """The unit of a signal port with `$U` put in."""
    leaf, _, name = port.rpartition(".")
    declared = expanded.leaves[leaf].component.signals[name].unit
    if not is_generic(declared.dimension):
        return declared
    dimension = solved(declared.dimension, solution[leaf])
    return Unit(dimension_text(dimension), 1.0, 0.0, dimension)


