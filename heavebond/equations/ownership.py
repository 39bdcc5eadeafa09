"""Unique names in the flat model: an error with both lines where two declarations have the same full name."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from heavebond.core.errors import Place, Problems
from heavebond.equations.connect import Group, Network
from heavebond.equations.events import Held
from heavebond.equations.expanded import Expanded, Leaf
from heavebond.equations.resolver import POWER
from heavebond.language.definition import Domain
from heavebond.language.sections import NamedOutput
from heavebond.text.expression import ExpressionProblem, Name, parse_formula
from heavebond.text.expression import names as names_in

KNOWN = ("time", "pi")
# prefixes of parameters that a run has and the machine has not: initial values, factors on measured inputs, values of
# delayed variables before the start
OF_A_RUN = ("initial", "scale", "history")


@dataclass(frozen=True)
class Owner:
    """The object that a name refers to: equal keys are the same object. `description` is in words; `kind` is node,
    component, ..."""

    key: Hashable
    description: str
    place: Place
    kind: str
    path: str  # of the node or component whose name makes the name


Owned = Iterable[tuple[str, Owner]]


@dataclass
class Names:
    """The owner of each name, or a function that determines it; a second owner is a problem."""

    problems: Problems
    owners: dict[str, Owner | Callable[[], Owned]] = field(default_factory=dict)

    def owner(self, name: str) -> Owner | None:
        """The owner of a name."""
        owner = self.owners.get(name)
        if callable(owner):
            owner = self.owners[name] = dict(owner())[name]
        return owner

    def claim_all(self, names: Sequence[str], owners_of: Callable[[], Owned]) -> None:
        """Claim names for the owners that `owners_of` returns. It is called only if a name is already taken, as a large
        diagram has many names."""
        owners = dict.fromkeys(names, owners_of)
        if len(owners) == len(names) and self.owners.keys().isdisjoint(owners):
            self.owners.update(owners)
            return
        for name, owner in owners_of():
            self.claim(name, owner)

    def claim(self, name: str, owner: Owner) -> None:
        """Give a name to an owner; a problem where another one has it."""
        first = self.owner(name)
        if first is None:
            self.owners[name] = owner
        elif first.key != owner.key:
            # a node is renamed rather than a component, a component rather than a port, whose name belongs to the
            # component's file
            order = ("node", "component", "parameter", "port", "clock")
            renamed = min((first, owner), key=lambda candidate: order.index(candidate.kind))
            part = renamed.path.rpartition(".")[2]
            hint = f"Give the node another name, for example `{part}_node: [...]`." if renamed.kind == "node" else \
                f"Give one of them another name, for example `{part}_2`."
            self.problems.add("name-twice", f"'{name}' would mean two things: {first.description} ({_line(first)}) "
                              f"and {owner.description} ({_line(owner)})", renamed.place, hint=hint)


def claim_names(expanded: Expanded, network: Network, problems: Problems) -> Names:
    """The owners of all names that a diagram gives to variables and parameters.

    The position of a mechanical node counts although it becomes an unknown only where something names it, so that naming it
    changes no meaning.
    """
    claimed = Names(problems)
    for name, bound in expanded.parameters.items():
        claimed.claim(name, Owner(("parameter", name), f"the parameter {name}", bound.place, "parameter", name))
    for number, group in enumerate(network.groups):
        domain = expanded.model.library.domains.get(group.domain)
        names_of_group = group.aliases if domain is None else [f"{path}.{m}" for path in group.aliases
                                                               for m in domain.shared]
        claimed.claim_all(names_of_group, partial(_of_group, expanded, group, number))
    alike: dict[tuple[Hashable, ...], list[str]] = {}
    for path, leaf in expanded.leaves.items():
        first = path.partition(".")[0]
        if first in OF_A_RUN and leaf.component.parameters:
            problems.add("name-bad", f"'{path}' cannot name a component with parameters; '{first}.' begins the "
                         "names of parameters of a run (`initial.x`, `scale.u`)", leaf.place,
                         hint="Take another name.")
        owners_of_leaf = partial(_of_leaf, expanded, network, path, leaf)
        has_arrays = any(port.count is not None for port in leaf.component.ports.values())
        kind = (id(leaf.component), *network.domains[path].items(), path if has_arrays else "")
        if (inside := alike.get(kind)) is None:
            inside = alike[kind] = [name.removeprefix(path) for name, _ in owners_of_leaf()]
        claimed.claim_all([path + name for name in inside], owners_of_leaf)
    return claimed


def check_outputs(names: Names, show: Mapping[str, NamedOutput], index_of: Mapping[str, int]) -> None:
    """Check that an output under `show:` with the name of a variable or parameter is that variable, possibly in another
    unit, so that `result[name]` and formulas refer to the same quantity."""
    for output in show.values():
        try:
            used = [name.text for name in names_in(parse_formula(output.name))]
        except ExpressionProblem:
            continue  # a title, which no formula can name
        if output.text.strip() == output.name or not all(n in names.owners or n in KNOWN for n in used):
            continue
        shown_name = output.expr.text if isinstance(output.expr, Name) else ""
        if shown_name in index_of and index_of[shown_name] == index_of.get(output.name):
            continue
        owner = names.owner(output.name)
        description = f"{owner.description} ({_line(owner)})" if owner else "a formula, or the time"
        plain_name = re.sub(r"\W+", "_", output.name).strip("_")
        names.problems.add("name-twice", f"the output '{output.name}' is `{output.text}`, but '{output.name}' is also "
                           f"{description}", output.place,
                           hint=f"Give the output another name, for example `{plain_name}_shown`.")


def claim_clocks(names: Names, held: Iterable[Held]) -> None:
    """Claim the names of the held variables that comparisons of the time become."""
    for clock in held:
        names.claim(clock.name, Owner(("clock", clock.name), "a switch at an instant, made from a comparison of the time",
                                      clock.place, "clock", clock.name))


def _line(owner: Owner) -> str:
    return f"line {owner.place.line} of {owner.place.file}"


def _of_group(expanded: Expanded, group: Group, number: int) -> Iterator[tuple[str, Owner]]:
    domain = expanded.model.library.domains.get(group.domain)
    for path in group.aliases:
        junction = expanded.junctions.get(path)
        node = junction is not None and path not in group.ports
        place = junction.place if junction is not None and node else expanded.leaves[path.rpartition(".")[0]].place
        kind, description = ("node", f"node '{path}'") if node else ("port", f"port '{path}'")
        if domain is None:
            yield path, Owner(("signal", number), f"the signal of {description}", place, kind, path)
            continue
        for member in domain.shared:
            yield f"{path}.{member}", Owner(("across", number, member), f"{_word(domain, member)} of {description}", place,
                                            kind,
                                            path)


def _word(domain: Domain, member: str) -> str:
    doc = domain.members[member].doc
    return f"{member} ({doc})" if doc else member


def _of_leaf(expanded: Expanded, network: Network, path: str, leaf: Leaf) -> Iterator[tuple[str, Owner]]:
    component = leaf.component
    of = f"of component '{path}' ({component.name})"
    for kind, entries in (("parameter", component.parameters), ("variable", component.variables)):
        for name in entries:
            full = f"{path}.{name}"
            yield full, Owner((kind, full), f"the {kind} {name} {of}", leaf.place, "component", path)
    for port, domain_name in network.domains[path].items():
        domain = expanded.model.library.domains[domain_name]
        # a port, or the elements of an array of ports, if they are on nodes
        begin = f"{path}.{port}["
        copies = [port] if expanded.leaves[path].component.ports[port].count is None else [
            end.port for junction in expanded.junctions.values() for end in junction.ends if end.name.startswith(begin)]
        for copy in copies:
            for member in domain.through:
                full = f"{path}.{copy}.{member}"
                yield full, Owner(("through", full), f"{_word(domain, member)} of port '{path}.{copy}'", leaf.place, "port",
                                  f"{path}.{copy}")
            full = f"{path}.{copy}.{POWER}"
            yield full, Owner(("power", full), f"the power over port '{path}.{copy}'", leaf.place, "port", f"{path}.{copy}")
