"""The unknowns of a flat model: across and through variables, positions, signals and the own variables of components."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import inf

from heavebond.core.units import Dimension, Unit
from heavebond.equations.connect import Network, signal_unit
from heavebond.equations.expanded import Expanded
from heavebond.equations.ownership import Names
from heavebond.equations.parameters import solved_unit
from heavebond.equations.resolver import NOTHING_KNOWN, Bond, PlausibleRange, Unknown, plausible
from heavebond.language.definition import Member, Value
from heavebond.language.template import Template
from heavebond.text.expression import Expr, names
from heavebond.text.shapes import whole_number


class Unknowns:
    """The unknowns in the order of the diagram, with their names and aliases: `listed`, `names` (name to index), and the
    ports as `bonds` of components and `block_bonds` of blocks. `also` names positions that a caller wants, `roots` are the
    groups whose positions follow from their velocities."""

    def __init__(self, expanded: Expanded, network: Network, templates: Mapping[str, Template], claimed: Names,
                 also: tuple[str, ...], roots: frozenset[int] = frozenset()):
        self.roots = roots
        self.expanded, self.network, self.templates, self.claimed = expanded, network, templates, claimed
        self.domains = expanded.model.library.domains
        self.listed: list[Unknown] = []
        self.names: dict[str, int] = {}
        self.bonds: dict[str, Bond] = {}
        self.block_bonds: dict[str, Bond] = {}
        self.nominal_of: dict[Dimension, float] = {}
        self.plausible_of: dict[str, PlausibleRange] = {}  # by unit: a torque and an energy differ in no dimension
        self.plausible: dict[str, dict[str, PlausibleRange]] = {}  # of the members of each domain
        for key, domain in self.domains.items():
            self.plausible[key] = {name: plausible(domain, name) for name in domain.members}
            for name, member in domain.members.items():
                self.nominal_of.setdefault(member.unit.dimension, member.nominal)
                if member.sized:
                    usual = PlausibleRange(member.nominal, self.plausible[key][name].per_second)
                    self.plausible_of.setdefault(member.unit.text, usual)
        self._make(also)

    def _make(self, also: tuple[str, ...]) -> None:
        positions = self._positions(also)
        for k, group in enumerate(self.network.groups):
            if group.domain == "signal":
                unit = signal_unit(self.expanded, group.ports[0], self.network.units)
                owner, _, signal = group.ports[0].rpartition(".")
                doc = self.expanded.leaves[owner].component.signals[signal].doc
                self._unknown(Unknown(group.name, unit, self._nominal(unit, None), "signal", group.place, doc,
                                      plausible=self.plausible_of.get(unit.text, NOTHING_KNOWN)), group.aliases)
            elif group.ports:
                root, domain = k in self.roots, self.domains[group.domain]
                members = [*((m, "across") for m in domain.across),
                           *((m, "position") for m in (*positions.get(k, ()), *domain.orientation))]
                for name, role in members:
                    member: Member = domain.members[name]
                    free = root and (name in domain.positions or name in map(domain.rate, domain.positions))
                    low, high = (-inf, inf) if member.low is None else (member.low, member.largest or inf)
                    self._unknown(Unknown(f"{group.name}.{name}", member.unit, member.nominal, role, group.place, member.doc,
                                          low, high, start=member.start,
                                          motion=bool(domain.positions) and role == "across",
                                          pose=bool(domain.orientation) and not free, root=free,
                                          plausible=self.plausible[group.domain][name]),
                                  [f"{alias}.{name}" for alias in group.aliases])
        turning = {name for domain in self.domains.values() for name in (domain.free, domain.minimal)}
        for path, leaf in self.expanded.leaves.items():
            for port, domain_name in self.network.domains[path].items():
                domain, plausible_flows = self.domains[domain_name], self.plausible[domain_name]
                count = leaf.component.ports[port].count
                copies = [port] if count is None else [
                    f"{port}[{k + 1}]" for k in range(whole_number(count, leaf.integers) or 0)]
                for copy in copies:
                    for member_name in domain.through:
                        member = domain.members[member_name]
                        self._unknown(Unknown(f"{path}.{copy}.{member_name}", member.unit, member.nominal, "through",
                                              leaf.place, member.doc, plausible=plausible_flows[member_name]), ())
                    efforts, flows = (domain.efforts, domain.flows) if not domain.power else ((), (domain.power,))
                    bonds = self.block_bonds if leaf.component.composite else self.bonds
                    bonds[f"{path}.{copy}"] = Bond(path, tuple(self.names[f"{path}.{copy}.{effort}"] for effort in efforts),
                                                   tuple(self.names[f"{path}.{copy}.{flow}"] for flow in flows))
            for name, variable in leaf.component.unknowns.items():
                unit = solved_unit(variable.unit, leaf, self.expanded, self.network)
                usual = self.plausible_of.get(unit.text, NOTHING_KNOWN) if variable.nominal is None else \
                    PlausibleRange(variable.nominal)
                least = usual.least if variable.physical is None else variable.physical
                usual = replace(usual, least=least, beyond=variable.beyond)
                self._unknown(Unknown(
                    f"{path}.{name}", unit, variable.nominal or self._nominal(unit, variable.start), "own", variable.place,
                    variable.doc, -inf if variable.low is None else variable.low,
                    inf if variable.high is None else variable.high, variable.start,
                    plausible=usual, root=leaf.component.name in turning), ())

    def _nominal(self, unit: Unit, start: float | None) -> float:
        usual = self.nominal_of.get(unit.dimension, 1.0)
        return max(usual, abs(start)) if start else usual

    def _unknown(self, unknown: Unknown, aliases: Iterable[str]) -> None:
        index = len(self.listed)
        self.listed.append(unknown)
        for name in (unknown.name, *aliases):
            known = self.listed[self.names.setdefault(name, index)]
            assert known is unknown, f"'{name}' is the name of two unknowns: {known.place} and {unknown.place}"
            assert name in self.claimed.owners, f"nothing was told of '{name}' ({unknown.place})"

    def _positions(self, also: tuple[str, ...]) -> dict[int, list[str]]:
        """The positions of each group that an equation, an input, an initial value, an output or a caller names."""
        wanted = {f"{path}.{slot}" for path, template in self.templates.items() for slot in template.slots}
        model = self.expanded.model
        formulas: list[tuple[str, Expr]] = [("", output.expr) for output in model.show.values()]
        formulas += [("", factor.value.expr) for factor in model.vary.values() if isinstance(factor.value, Value)]
        for leaf in self.expanded.leaves.values():
            formulas += [(b.scope, b.value.expr) for b in leaf.inputs.values() if isinstance(b.value, Value)]
        wanted |= {scope + n.text for scope, expr in formulas for n in names(expr)}
        wanted |= {*model.initial.conditions, *also}
        named_positions: dict[int, list[str]] = {}
        for k, group in enumerate(self.network.groups):
            positions = self.domains[group.domain].positions if group.domain in self.domains else ()
            named = [position for position in positions if any(f"{alias}.{position}" in wanted for alias in group.aliases)]
            if named:
                named_positions[k] = named
        return named_positions
