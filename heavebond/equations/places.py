"""Places of a diagram at which an element may be missing, and virtual sources of through variables at these places.

A place is a node (an element between it and the environment) or a pair of nodes on which a component has ports (an
element in parallel with that component). The missing element takes up the through variable w. For a pair, mechanical ports
a, b have -w, w like a spring (w is its tension), hydraulic and pneumatic ones w, -w like an orifice (w flows from a to b);
at a node, w enters the element. Thus w rises with the across variable if power is dissipated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import casadi as ca

from heavebond.core.units import Unit
from heavebond.equations.flatten import EquationRole, Flat, KnownInput
from heavebond.language.definition import Domain, FileInput
from heavebond.language.symbols import stack
from heavebond.records.time_axis import TimeAxis


@dataclass(frozen=True)
class Node:
    """A node of a power domain: its name, the ports (full paths) on it, and the through variable that a virtual source sets,
    if there are several."""

    name: str
    domain: Domain
    ports: tuple[str, ...]
    member: int = 0

    @property
    def through(self) -> str:
        """The through variable that a virtual source sets: force, torque, volume flow, mass flow."""
        return self.domain.through[self.member]

    @property
    def key(self) -> str:
        """The name of the node, or `arm.F_x` if its domain has several efforts."""
        return f"{self.name}.{self.through}" if len(self.domain.efforts) > 1 else self.name

    @property
    def across(self) -> str:
        """The across variable that it acts with: velocity, angular velocity, pressure."""
        return dict(self.domain.pairs).get(self.through, self.domain.across[0]) if len(self.domain.efforts) > 1 \
            else self.domain.across[0]

    @property
    def unit(self) -> Unit:
        """The unit of the through variable."""
        return self.domain.members[self.through].unit

    @property
    def mechanical(self) -> bool:
        """Whether a port's effort is what flows through it."""
        return bool(self.domain.positions)


@dataclass(frozen=True)
class Place:
    """One node, or two nodes with the components in parallel with which an element may be missing.

    `weights` gives for each node the through variable that enters it for a w of 1.
    """

    nodes: tuple[Node, ...]
    components: tuple[str, ...]

    @property
    def name(self) -> str:
        """`crown`, or `platform-crown`."""
        return "-".join(n.key for n in self.nodes)

    @property
    def words(self) -> str:
        """`at crown`, or `between platform and crown`."""
        return ("between " if len(self.nodes) == 2 else "at ") + " and ".join(n.name for n in self.nodes)

    @property
    def unit(self) -> Unit:
        """The unit of w."""
        return self.nodes[0].unit

    @property
    def weights(self) -> dict[str, float]:
        """The through variable that enters each node for w = 1."""
        if len(self.nodes) == 1:
            return {self.nodes[0].key: -1.0}
        first = 1.0 if self.nodes[0].mechanical else -1.0
        return {self.nodes[0].key: first, self.nodes[1].key: -first}


def sources_of(flat: Flat) -> dict[str, Node]:
    """The places of virtual sources at nodes, by the name of the through variable (`crown.f`) that the source adds to the
    balance of the node."""
    balances = {e.subject for e in flat.equations if e.role is EquationRole.BALANCE}
    return {name: replace(node, member=k) for node in nodes_of(flat, several_efforts=True).values()
            for k, through in enumerate(node.domain.through) for name in [f"{node.name}.{through}"] if name in balances}


def input_nodes(flat: Flat) -> dict[str, Node]:
    """The nodes at which an unknown input may act: nodes with one effort by name, nodes in space by each force and moment,
    `NODE.F_x`. They are in the order of the diagram."""
    single, in_space = nodes_of(flat), {name: node for name, node in sources_of(flat).items() if node.domain.orientation}
    return {**single, **in_space}


def nodes_of(flat: Flat, several_efforts: bool = False) -> dict[str, Node]:
    """The nodes of a flat model by name, in the order of the diagram; signals are omitted. Nodes with several
    efforts are included with `several_efforts` only, because a virtual source sets one effort."""
    domains = sorted(flat.expanded.model.library.domains.values(), key=lambda d: -len(d.across))
    balances = {e.subject for e in flat.equations if e.role is EquationRole.BALANCE}
    aliases: dict[int, list[str]] = {}
    for name, index in flat.names.items():
        aliases.setdefault(index, []).append(name.rpartition(".")[0])
    nodes = {}
    for path in flat.expanded.junctions:
        # the domains of the ports on the node that are declared; gas and oil with temperature have the same variables
        declared = set()
        for end in flat.expanded.junctions[path].ends:
            leaf = flat.expanded.leaves.get(end.leaf)
            port = leaf.component.ports.get(end.port.partition("[")[0]) if leaf is not None else None
            declared |= {port.domain} if port is not None else set()
        of_ports = declared & {*flat.expanded.model.library.domains}
        domain = next((d for d in domains if (not of_ports or d.name in of_ports) and f"{path}.{d.through[0]}" in balances
                       and all(f"{path}.{m}" in flat.names for m in d.across)), None)
        if domain is None or (len(domain.efforts) > 1 and not several_efforts):
            continue
        index = flat.names[f"{path}.{domain.across[0]}"]
        # inner nodes of a block that are joined to an outer one are that one
        if flat.unknowns[index].name == f"{path}.{domain.across[0]}":
            ports = []  # inside of a block a node is called as a port, such as `cmc.platform`, but is none
            for alias in aliases[index]:
                owner, _, name = alias.rpartition(".")
                leaf = flat.expanded.leaves.get(owner)
                if leaf is not None and name.partition("[")[0] in leaf.component.ports:
                    ports.append(alias)
            nodes[path] = Node(path, domain, tuple(ports))
    return nodes


def places_of(flat: Flat, nodes: Mapping[str, Node]) -> list[Place]:
    """Every pair of nodes with one effort that a component connects by ports of one domain, in the order of the ports, then
    every node."""
    leaves = flat.expanded.leaves
    on = {port: node for key, node in nodes.items() if key == node.name for port in node.ports}
    owners: dict[str, list[str]] = {}
    for port in on:
        owners.setdefault(port.rpartition(".")[0], []).append(port)
    pairs: dict[frozenset[str], Place] = {}
    for owner, ports in owners.items():
        declared = list(leaves[owner].component.ports)
        in_order = sorted(ports, key=lambda path: declared.index(path.rpartition(".")[2].partition("[")[0]))
        for a, b in combinations(in_order, 2):
            first, second = on[a], on[b]
            if first.name == second.name or first.domain.name != second.domain.name:
                continue
            key = frozenset((first.name, second.name))
            old = pairs.get(key, Place((first, second), ()))
            pairs[key] = replace(old, components=tuple(dict.fromkeys((*old.components, owner))))
    singles = [Place((node,), tuple(dict.fromkeys(p.rpartition(".")[0] for p in node.ports))) for node in nodes.values()]
    return [*pairs.values(), *singles]


@dataclass(frozen=True)
class Jump:
    """A difference w between what a signal or a node has and what a component reads of it: the equations of `owner` (a part,
    or a block with all its parts) have the signal plus w, or the position and the across variable of the node plus w and its
    rate. `shifted` are the indices of these unknowns, each with the order of the derivative of w."""

    owner: str
    unit: Unit
    shifted: tuple[tuple[int, int], ...]


def jumps_at(flat: Flat, inputs: Iterable[str]) -> dict[str, Jump]:
    """The jumps at signal inputs (`controller.v`) and ports (`gas.a`) of a flat model, by their names. One is left out if
    another signal or port of its part is the same one, as its equations do not show which of them is meant, and if a port
    has several across variables."""
    jumps = {}
    for path in inputs:
        owner, _, name = path.rpartition(".")
        leaf = flat.expanded.leaves.get(owner)
        if leaf is None:
            continue
        if name in leaf.component.signals:
            others, orders = [*leaf.component.signals], {path: 0}
            unit = flat.unknowns[flat.names[path]].unit if path in flat.names else None
        else:
            domain, others = flat.domains.get(path), [*leaf.component.ports]
            if domain is None or len(domain.across) > 1:
                continue
            orders = {f"{path}.{domain.across[0]}": len(domain.positions)}
            orders |= {f"{path}.{position}": 0 for position in domain.positions}
            unit = domain.members[(*domain.positions, *domain.across)[0]].unit
        shifted = tuple((flat.names[variable], order) for variable, order in orders.items() if variable in flat.names)
        same = {flat.names.get(f"{owner}.{other}{variable.removeprefix(path)}") for other in others if other != name
                for variable in orders}
        if shifted and unit is not None and same.isdisjoint(index for index, _ in shifted):
            jumps[path] = Jump(owner, unit, shifted)
    return jumps


def with_virtual_jumps(flat: Flat, jumps: Mapping[str, Jump], file: Path) -> Flat:
    """The flat model with a measured input `virtual.PATH` for each jump, as in `with_virtual_sources`, but joined by a
    spline, as equations may differentiate it."""
    residuals, inputs = list(flat.residuals), list(flat.inputs)
    place = flat.equations[0].place
    for path, jump in jumps.items():
        symbols = ca.vertcat(*(ca.SX.sym("d" * k + f"virtual.{path}") for k in range(4)))
        source = FileInput(file, path, jump.unit.text, "spline", place, TimeAxis("time"), bridge=True)
        inputs.append(KnownInput(f"virtual.{path}", source, jump.unit, symbols))
        # an equation that is written has no higher derivatives
        old, new = zip(*((level[index], level[index] + symbols[order + k]) for index, order in jump.shifted
                         for k, level in enumerate(flat.levels[:4 - order])), strict=True)
        for row, equation in enumerate(flat.equations):
            if equation.role is EquationRole.LAW and f"{equation.owner}.".startswith(f"{jump.owner}."):
                residuals[row] = ca.substitute(residuals[row], stack(old), stack(new))
    return replace(flat, residual_column=stack(residuals), inputs=tuple(inputs), options=None)


def with_virtual_sources(flat: Flat, nodes: Mapping[str, Node], file: Path) -> Flat:
    """The flat model with a measured input `virtual.NODE` that enters each node, joined by lines between the rows of
    `file` (columns `time` in s, then one per node by its key in `nodes`, in SI)."""
    row_of = {e.subject: k for k, e in enumerate(flat.equations) if e.role is EquationRole.BALANCE}
    residuals, inputs = list(flat.residuals), list(flat.inputs)
    for key, node in nodes.items():
        row = row_of[f"{node.name}.{node.through}"]
        place = flat.equations[row].place
        name = f"virtual.{key}"
        symbols = ca.vertcat(*(ca.SX.sym("d" * k + name) for k in range(4)))
        # its file has the times of the samples: where these have a gap, the estimate is joined across it
        source = FileInput(file, key, node.unit.text, "linear", place, TimeAxis("time"), bridge=True)
        inputs.append(KnownInput(name, source, node.unit, symbols))
        # what flows into the components sums to what the source delivers
        residuals[row] = residuals[row] - symbols[0]
    return replace(flat, residual_column=stack(residuals), inputs=tuple(inputs), options=None)
