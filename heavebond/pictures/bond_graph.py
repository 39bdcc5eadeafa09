"""A diagram as a bond graph: junctions from its nodes, elements from its components, causal strokes by SCAP.

A node whose ports share a flow (a velocity) is a 1-junction, one whose ports share an effort (a pressure, a voltage) a
0-junction. A component with two ports and a common effort or flow (`b.f = F`, `a.f = -F`) is placed on a junction of the
other kind between its nodes. Its letter follows from its stored and dissipated energy: C, I, R, combinations side by side,
Se and Sf for components that impose an effort or a flow, TF and GY for two ports whose equations relate like to like, or
effort to flow. Other components are words with their bonds.

Causality is assigned in sequence: sources, then stores by preference in integral form, then the remaining elements, each
followed by all implied strokes. D. C. Karnopp, D. L. Margolis, R. C. Rosenberg, System Dynamics, 5th ed., Wiley 2012,
chapter 5, doi 10.1002/9781118152812.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from heavebond.core.presentation import count
from heavebond.equations.connect import Network, connect
from heavebond.equations.expand import expand
from heavebond.equations.expanded import Expanded, Leaf
from heavebond.language.definition import Component, Domain
from heavebond.language.model import Model
from heavebond.text.expression import names

ZERO, ONE_JUNCTION, WORD = "0", "1", "word"
SOURCES, STORES = ("Se", "Sf"), ("I", "C")
TWO_PORTS = ("TF", "GY")


@dataclass(frozen=True)
class Vertex:
    """A junction (`0`, `1`), an element by its letter, or a word; `label` is the node or component, `derivative` is True
    for a store in derivative causality, `broken` if its constraint cannot hold with the strokes around it."""

    key: str
    letter: str
    label: str
    domain: str
    derivative: bool = False
    broken: bool = False


@dataclass(frozen=True)
class Bond:
    """A bond between two vertices, its half arrow at `head`; `stroke` is the end on which the effort is imposed (the key
    of tail or head, empty if no equation determines it). `modulated`: a port without power."""

    tail: str
    head: str
    domain: str
    stroke: str = ""
    modulated: bool = False


@dataclass(frozen=True)
class BondGraph:
    """Vertices by key and bonds; `choices` counts arbitrary strokes (each an algebraic loop), `words` are the components
    drawn as words, `beside` those whose store and loss are drawn side by side as an approximation."""

    vertices: dict[str, Vertex]
    bonds: tuple[Bond, ...]
    choices: int = 0
    words: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()

    @property
    def derivative(self) -> list[str]:
        """The components with a store in derivative causality."""
        return [v.label for v in self.vertices.values() if v.derivative]


def bond_graph(model: Model) -> BondGraph:
    """The bond graph of a diagram with all blocks opened; ModelError for a diagram that cannot be read."""
    expanded = expand(model)
    builder = _Builder(expanded, connect(expanded))
    builder.build()
    graph = _collapsed(BondGraph(builder.vertices, tuple(builder.bonds), 0, tuple(builder.words), tuple(builder.beside)))
    return causal(graph)


# -- structure ---------------------------------------------------------------------------------------------------------
@dataclass
class _Builder:
    expanded: Expanded
    network: Network
    vertices: dict[str, Vertex] = field(default_factory=dict)
    bonds: list[Bond] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    beside: list[str] = field(default_factory=list)

    def build(self) -> None:
        # no power enters at nodes of the ground or a tank, so they and their bonds are omitted
        references = {domain.reference for domain in self._domains().values()}
        grounded = {self.network.group_of_port[f"{path}.{port}"] for path, leaf in self.expanded.leaves.items()
                    if references & {leaf.component.name, *leaf.component.extends} for port in leaf.component.ports}
        for k, group in enumerate(self.network.groups):
            domain = self._domains().get(group.domain)
            if domain is not None and k not in grounded:
                letter = ONE_JUNCTION if _shares_flow(domain) else ZERO
                self.vertices[f"node {k}"] = Vertex(f"node {k}", letter, group.name, group.domain)
        for path, leaf in self.expanded.leaves.items():
            if leaf.component.ports and not leaf.component.composite:
                self._element(path, leaf)

    def _domains(self) -> dict[str, Domain]:
        return self.expanded.model.library.domains

    def _element(self, path: str, leaf: Leaf) -> None:
        component = leaf.component
        ports = {end: self.network.group_of_port[end] for end in self._ends(path, component)}
        # ports that take no power: their through variables are set to 0
        silent = [p for p in ports if (domain := self._domain(path, p)) is not None and all(
            _right_side(component, p.removeprefix(path + "."), member) == "0" for member in domain.through)]
        power = [p for p in ports if p not in silent]
        if not power:  # a sensor: it takes no power
            domain = self._domain(path, next(iter(ports)))
            letter = WORD if len(ports) > 1 else "Df" if domain is not None and _shares_flow(domain) else "De"
            self._joined(Vertex(path, letter, path, ""), dict.fromkeys(ports, 1), ports, True)
            return
        kinds = {self.network.domains[path].get(_array(p, path), "") for p in power}
        several = any(domain is not None and len(domain.efforts) > 1 for domain in (self._domain(path, p) for p in power))
        if len(power) == 1 and not several:
            port = power[0]
            letters = self._letters(path, component, [port])
            domain_name = self.network.domains[path].get(_array(port, path), "")
            sign = -1 if letters[0] in SOURCES else 1
            if len(letters) == 1:
                self._joined(Vertex(path, letters[0], path, domain_name), {port: sign}, ports)
            else:
                self._side_by_side(path, letters, domain_name, {port: 1}, ports)
        elif len(power) == 2 and len(kinds) == 1 and not several and (signs := self._signs(path, component, power)):
            # one junction between two nodes, and on it the element
            letters = self._letters(path, component, power)
            domain = self._domain(path, power[0])
            assert domain is not None
            if len(letters) == 1:
                middle = f"{path} on"
                self._joined(Vertex(middle, ZERO if _shares_flow(domain) else ONE_JUNCTION, "", domain.name), signs, ports)
                self.vertices[path] = Vertex(path, letters[0], path, domain.name)
                ends = (path, middle) if letters[0] in SOURCES else (middle, path)
                self.bonds.append(Bond(*ends, domain.name))
            else:
                self._side_by_side(path, letters, domain.name, signs, ports)
        elif len(power) == 2 and not several and (letter := self._two_port(path, component, power)):
            self._joined(Vertex(path, letter, path, ""), {power[0]: 1, power[1]: -1}, ports)
        else:
            self.words.append(path)
            self._joined(Vertex(path, WORD, path, ""), dict.fromkeys(power, 1), ports)
        for port in silent:
            self._bond(path if path in self.vertices else f"{path} on", port, ports[port], 1, True)

    def _ends(self, path: str, component: Component) -> list[str]:
        ends_found = []
        for port in component.ports.values():
            if port.count is None:
                ends_found.append(f"{path}.{port.name}")
            else:
                ends_found += [e.name for j in self.expanded.junctions.values() for e in j.ends
                               if e.leaf == path and e.sign > 0 and e.port.partition("[")[0] == port.name]
        return ends_found

    def _domain(self, path: str, port: str) -> Domain | None:
        return self._domains().get(self.network.domains[path].get(_array(port, path), ""))

    def _through(self, path: str, port: str) -> str:
        domain = self._domain(path, port)
        return domain.through[0] if domain is not None and domain.through else ""

    def _joined(self, vertex: Vertex, signs: dict[str, int], ports: dict[str, int], modulated: bool = False) -> None:
        self.vertices[vertex.key] = vertex
        for port, sign in signs.items():
            self._bond(vertex.key, port, ports[port], sign, modulated)

    def _bond(self, key: str, port: str, group: int, sign: int, modulated: bool = False) -> None:
        node = f"node {group}"
        if node in self.vertices and key in self.vertices:
            ends = (node, key) if sign > 0 else (key, node)
            self.bonds.append(Bond(*ends, self.network.groups[group].domain, "", modulated))

    def _side_by_side(self, path: str, letters: tuple[str, ...], domain: str, signs: dict[str, int],
                      ports: dict[str, int]) -> None:
        """Add the store and the loss of a component as two elements with the same across variable: the difference between
        its two ports, or the value at its port."""
        self.beside.append(path)
        domain_found = self._domains()[domain]
        middle, kinds = f"{path} on", (ZERO, ONE_JUNCTION) if _shares_flow(domain_found) else (ONE_JUNCTION, ZERO)
        self._joined(Vertex(middle, kinds[0] if len(signs) > 1 else kinds[1], "", domain), signs, ports)
        hub = middle
        if len(signs) > 1:
            hub = f"{path} share"
            self.vertices[hub] = Vertex(hub, kinds[1], "", domain)
            self.bonds.append(Bond(middle, hub, domain))
        for letter in letters:
            key = f"{path} {letter}"
            self.vertices[key] = Vertex(key, letter, path, domain)
            self.bonds.append(Bond(hub, key, domain))

    def _signs(self, path: str, component: Component, power: list[str]) -> dict[str, int]:
        """Signs of two ports, inwards (1) and outwards (-1), if both have the same effort or flow; else empty."""
        sides = [_right_side(component, p.removeprefix(path + "."), self._through(path, p)) for p in power]
        for k in range(2):
            through_name = f"{power[k].removeprefix(path + '.')}.{self._through(path, power[k])}"
            if sides[1 - k] and sides[1 - k] in (f"-{sides[k]}", f"-({sides[k]})", f"-{through_name}"):
                return {power[k]: 1, power[1 - k]: -1}
        return {}

    def _letters(self, path: str, component: Component, power: list[str]) -> tuple[str, ...]:
        """Letters of an element on one junction."""
        if component.power == "source":
            return (self._imposed(path, component, power),)
        letters = tuple(dict.fromkeys([*([self._store(path, component, power)] if component.stores else []),
                                       *(["R"] if component.dissipates else [])]))
        return letters or (self._imposed(path, component, power),)

    def _store(self, path: str, component: Component, power: list[str]) -> str:
        """I if the energy is a function of a flow, C if it is a function of an effort or a displacement."""
        domain = self._domain(path, power[0])
        assert component.stores is not None and domain is not None
        flow = domain.members[domain.flow].unit.dimension if domain.flow else ()
        for name in names(component.stores.tree):
            last = name.text.rpartition(".")[2]
            if "." in name.text and last == domain.flow:
                return "I"
            variable = component.variables.get(name.text)
            if variable is not None and variable.unit.dimension == flow:
                return "I"
        return "C"

    def _imposed(self, path: str, component: Component, power: list[str]) -> str:
        """Se or Sf by the members of the ports in the equations; R if both kinds occur; a source that names the across
        variable of its nodes imposes it."""
        domain = self._domain(path, power[0])
        assert domain is not None
        named = {n.text.rpartition(".")[2] for line in component.equations for side in (line.tree.left, line.tree.right)
                 for n in names(side) if "." in n.text}
        effort, flow = domain.effort in named, bool({domain.flow, domain.position} & named)
        if component.power == "source" and effort and flow:
            return "Sf" if _shares_flow(domain) else "Se"
        return "R" if effort and flow else "Se" if effort else "Sf"

    def _two_port(self, path: str, component: Component, power: list[str]) -> str:
        """TF if effort is related to effort and flow to flow, GY if each is related to the other."""
        if component.stores or component.dissipates or component.power:
            return ""
        kinds = set()
        for line in component.equations:
            relations = set()
            for name in (n for side in (line.tree.left, line.tree.right) for n in names(side)):
                for port in power:
                    domain = self._domain(path, port)
                    if domain and name.text.startswith(port.removeprefix(path + ".") + "."):
                        relations.add((port, name.text.rpartition(".")[2] == domain.effort))
            if len({port for port, _ in relations}) == 2 and len(relations) == 2:
                kinds.add(len({effort for _, effort in relations}) == 1)
        return {frozenset([True]): "TF", frozenset([False]): "GY"}.get(frozenset(kinds), "")


def _array(port: str, path: str) -> str:
    return port.removeprefix(path + ".").partition("[")[0]


def _shares_flow(domain: Domain) -> bool:
    return domain.flow is not None and domain.flow in domain.across


def _right_side(component: Component, port: str, through: str) -> str:
    """The expression to which a port's through variable is set, without blanks; empty if no equation does so directly."""
    for line in component.equations:
        left, sign, right = line.text.partition("=")
        if sign and left.strip() == f"{port}.{through}":
            return "".join(right.split("#")[0].split())
    return ""


def _collapsed(graph: BondGraph) -> BondGraph:
    """Remove junctions that only pass a bond on. If both bonds of such a junction end at the same other junction, it stays
    (both ports of a component may be on one node), because a bond needs two different vertices."""
    vertices, bonds = dict(graph.vertices), list(graph.bonds)
    for key in [k for k, v in graph.vertices.items() if v.letter in (ZERO, ONE_JUNCTION)]:
        ends = [b for b in bonds if key in (b.tail, b.head)]
        inwards, outwards = [b for b in ends if b.head == key], [b for b in ends if b.tail == key]
        if not ends:
            del vertices[key]
        elif len(inwards) == len(outwards) == 1 and inwards[0].tail != outwards[0].head \
                and not any(b.modulated for b in ends):
            del vertices[key]
            bonds = [b for b in bonds if b not in ends]
            bonds.append(replace(inwards[0], head=outwards[0].head))
    bound = {key for b in bonds for key in (b.tail, b.head)}
    return replace(graph, vertices={k: v for k, v in vertices.items() if k in bound}, bonds=tuple(bonds))


# -- causality ---------------------------------------------------------------------------------------------------------
def causal(graph: BondGraph) -> BondGraph:
    """The graph with causal strokes by the sequential causality assignment procedure."""
    strokes = _Strokes(graph)
    kinds = graph.vertices
    for wanted in (SOURCES, STORES):
        for key, vertex in kinds.items():
            if vertex.letter in wanted:
                for k in strokes.around.get(key, ()):
                    strokes.assign(k, _preferred(graph.bonds[k], key, vertex.letter))
    choices = 0
    for k, bond in enumerate(graph.bonds):
        if k not in strokes.assigned and not bond.modulated and WORD not in (kinds[bond.tail].letter,
                                                                             kinds[bond.head].letter):
            choices += 1
            strokes.assign(k, bond.head)
    for k, bond in enumerate(graph.bonds):  # a word takes the remaining causality
        if k not in strokes.assigned and not bond.modulated:
            strokes.assign(k, bond.head)
    assigned = strokes.assigned
    vertices = {}
    for key, vertex in kinds.items():
        bonds_at_key = strokes.around.get(key, ())
        late = vertex.letter in STORES and any(assigned[k] != _preferred(graph.bonds[k], key, vertex.letter)
                                               for k in bonds_at_key)
        forced = vertex.letter in SOURCES and any(assigned[k] != _preferred(graph.bonds[k], key, vertex.letter)
                                                  for k in bonds_at_key)
        vertices[key] = replace(vertex, derivative=late, broken=forced or not strokes.holds(key))
    bonds = tuple(replace(b, stroke=assigned.get(k, "")) for k, b in enumerate(graph.bonds))
    return replace(graph, vertices=vertices, bonds=bonds, choices=choices)


def _preferred(bond: Bond, key: str, letter: str) -> str:
    """End of the stroke for a source, or a store in integral form: Se and C impose effort on the other end, Sf and I
    receive it."""
    opposite = bond.head if bond.tail == key else bond.tail
    return opposite if letter in ("Se", "C") else key


class _Strokes:
    """Strokes assigned so far (bond: the key of its end), and their consequences at junctions, transformers and gyrators."""

    def __init__(self, graph: BondGraph):
        self.graph = graph
        self.assigned: dict[int, str] = {}
        self.around: dict[str, list[int]] = {}
        for k, bond in enumerate(graph.bonds):
            if not bond.modulated:
                self.around.setdefault(bond.tail, []).append(k)
                self.around.setdefault(bond.head, []).append(k)

    def assign(self, bond: int, end: str) -> None:
        """Set the causal stroke of a bond if it has none, and then all strokes that follow from it."""
        waiting = [(bond, end)]
        while waiting:
            k, stroke = waiting.pop()
            if k not in self.assigned:
                self.assigned[k] = stroke
                for key in (self.graph.bonds[k].tail, self.graph.bonds[k].head):
                    waiting += self._compelled(key)

    def _compelled(self, key: str) -> list[tuple[int, str]]:
        letter, bonds_at_key = self.graph.vertices[key].letter, self.around[key]
        strokes_here = [k for k in bonds_at_key if self.assigned.get(k) == key]
        away = [k for k in bonds_at_key if k in self.assigned and self.assigned[k] != key]
        open_ones = [k for k in bonds_at_key if k not in self.assigned]
        if not open_ones:
            return []
        if letter in (ZERO, ONE_JUNCTION):  # one bond of the special kind, the others alike
            special, usual = (strokes_here, away) if letter == ZERO else (away, strokes_here)
            at_special, at_usual = (self._at, self._from) if letter == ZERO else (self._from, self._at)
            if special:
                return [at_usual(k, key) for k in open_ones]
            return [at_special(k, key) for k in open_ones] if len(usual) == len(bonds_at_key) - 1 else []
        if letter == "TF" and len(bonds_at_key) == 2:
            return [self._from(k, key) if strokes_here else self._at(k, key) for k in open_ones]
        if letter == "GY" and len(bonds_at_key) == 2:
            return [self._at(k, key) if strokes_here else self._from(k, key) for k in open_ones]
        return []

    def _at(self, k: int, key: str) -> tuple[int, str]:
        return k, key

    def _from(self, k: int, key: str) -> tuple[int, str]:
        bond = self.graph.bonds[k]
        return k, bond.head if bond.tail == key else bond.tail

    def holds(self, key: str) -> bool:
        """True if the constraint of a junction, transformer or gyrator is satisfied."""
        letter, bonds_at_key = self.graph.vertices[key].letter, self.around.get(key, [])
        strokes_at_key = sum(self.assigned.get(k) == key for k in bonds_at_key)
        if letter == ZERO and bonds_at_key:
            return strokes_at_key == 1
        if letter == ONE_JUNCTION and bonds_at_key:
            return strokes_at_key == len(bonds_at_key) - 1
        if len(bonds_at_key) == 2 and letter in TWO_PORTS:
            return strokes_at_key == 1 if letter == "TF" else strokes_at_key != 1
        return True


def notes_of(graph: BondGraph) -> list[str]:
    """Notes for the picture: derivative causality, loops, words, approximations."""
    def listed(paths: Iterable[str]) -> str:
        return ", ".join(paths)

    notes = []
    if graph.derivative:
        notes.append(f"derivative causality: {listed(graph.derivative)} (a state less for each)")
    if graph.choices:
        notes.append(f"{count(graph.choices, 'causal stroke')} chosen freely: an algebraic loop, or a word that decides it "
                     "inside")
    if broken := [v.label or v.key for v in graph.vertices.values() if v.broken]:
        notes.append(f"no causality satisfies: {listed(broken)}")
    if graph.beside:
        notes.append(f"store and loss drawn side by side: {listed(graph.beside)}")
    if graph.words:
        notes.append(f"of several equations, drawn as words: {listed(graph.words)}")
    return notes
