"""Grounding: the component that relates each connected part of a machine to a reference of its domain, such as a tank.

Most laws depend on differences only: if all pressures of a circuit rise by the same amount, the flow through an orifice is
unchanged. A circuit in which all components are of this kind has no reference level.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from heavebond.equations.flatten import Flat
from heavebond.equations.matching import components_of
from heavebond.equations.structural_messages import bookkeeping
from heavebond.language.definition import Domain
from heavebond.language.external_functions import derivative_along
from heavebond.language.symbols import split, stack


@dataclass(frozen=True)
class Circuit:
    """Nodes of one domain that parts join. `held`: parts whose equations depend on the level (a tank, a fixed point, a
    spring to another circuit), `carried`: parts whose equations depend on its rate (a volume, a mass). Without both no
    equation determines the level; with `carried` alone it follows from the start."""

    domain: str
    nodes: tuple[str, ...]
    held: tuple[str, ...]
    carried: tuple[str, ...]


def circuits(flat: Flat) -> tuple[Circuit, ...]:
    """The circuits of a diagram, domain by domain, in the order in which their nodes are declared."""
    finder = _Finder(flat)
    return tuple(circuit for domain in flat.expanded.model.library.domains.values() for circuit in finder.of(domain))


class _Finder:
    """A diagram with its equations by component and its ports by component, looked up once."""

    def __init__(self, flat: Flat):
        self.flat = flat
        self.equations: dict[str, list[int]] = {}
        for i, e in enumerate(flat.equations):
            if not bookkeeping(e):  # a node may have the name of a component
                self.equations.setdefault(e.owner, []).append(i)
        self.ports: dict[str, list[str]] = {}
        arrays: dict[str, dict[str, None]] = {}
        for name in flat.names:
            if "[" in name:
                arrays.setdefault(name.rpartition("[")[0], {})[name.rpartition(".")[0]] = None
        for path, port in flat.expanded.ports.items():
            leaf = path.rpartition(".")[0]
            if not flat.expanded.leaves[leaf].component.composite:
                self.ports.setdefault(leaf, []).extend([path] if port.count is None else arrays.get(path, {}))

    def of(self, domain: Domain) -> list[Circuit]:
        """The circuits of one domain."""
        nodes: dict[int, str] = {}
        for path in self.flat.expanded.junctions:
            if (j := self._across(domain, path)) is not None:
                nodes.setdefault(j, path)
        number = {j: k for k, j in enumerate(nodes)}
        ends = {leaf: [number[j] for path in paths if (j := self._across(domain, path)) in number and j is not None]
                for leaf, paths in self.ports.items()}
        ends = {leaf: unknowns for leaf, unknowns in ends.items() if unknowns}
        leaves, members, circuits = list(ends), list(nodes), []
        for parts, columns in components_of(list(ends.values()), len(number)):
            if parts:
                inside, near = [members[k] for k in columns], [leaves[k] for k in parts]
                carried = self._feeling(domain, [self.flat.levels[1][j] for j in inside], near)
                names = self.flat.names  # of the positions of the nodes
                first = domain.positions[0] if domain.positions else ""
                positions = (f"{self.flat.unknowns[j].name.rpartition('.')[0]}.{first}" for j in inside)
                levels = [self.flat.levels[0][j] for j in (*inside, *(names[p] for p in positions if p in names))]
                held = self._feeling(domain, levels, [leaf for leaf in near if leaf not in carried])
                circuits.append(Circuit(domain.name, tuple(nodes[j] for j in inside), held, carried))
        return circuits

    def _across(self, domain: Domain, path: str) -> int | None:
        """The unknown that is the (first) across variable of a node or port; None if it is of another domain."""
        return self.flat.names[f"{path}.{domain.across[0]}"] if self.flat.domains.get(path) is domain else None

    def _feeling(self, domain: Domain, symbols: list[ca.SX], leaves: list[str]) -> tuple[str, ...]:
        """The parts with an equation, relevant to the circuit, that changes if all of these symbols change by the same
        amount."""
        rows = [i for leaf in leaves for i in self.equations.get(leaf, [])]
        if not rows:
            return ()
        residuals = self.flat.residual_column[rows]
        changes = split(derivative_along(residuals, stack(symbols), ca.SX.ones(len(symbols))))
        felt = [i for i, change in zip(rows, changes, strict=True) if not change.is_zero()]
        return tuple(dict.fromkeys(self.flat.equations[i].owner for i in felt if self._bears(domain, i)))

    def _bears(self, domain: Domain, row: int) -> bool:
        """True if an equation of a part acts on the through variables of its ports in a domain, directly or by variables of
        the part. The equation of a sensor does not, nor that of a friction that depends on a pressure."""
        flat, leaf, n = self.flat, self.flat.equations[row].owner, len(self.flat.unknowns)
        members = {i: {c % n for c, _ in flat.entries[i]} for i in self.equations[leaf]}
        signals = flat.expanded.leaves[leaf].component.signals.values()
        if members[row] & {flat.names[f"{leaf}.{s.name}"] for s in signals if s.direction == "out"}:
            return False
        carried = {flat.names[f"{path}.{m}"] for path in self.ports[leaf] if self._across(domain, path) is not None
                       for m in domain.through}
        if not carried & set().union(*members.values()):
            return True  # it says nothing of its flow, so that it gives the level
        reached, rows = set(members[row]), {row}
        while True:
            inner = {j for j in reached if flat.unknowns[j].role == "own"}
            more = {i for i in members if i not in rows and members[i] & inner}
            if not more:
                return bool(carried & reached)
            rows |= more
            reached |= set().union(*(members[i] for i in more))
