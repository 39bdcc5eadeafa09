"""A diagram as sheets to be drawn: on each the parts of one level, and the nodes between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.presentation import readable, unit_label
from heavebond.equations.connect import Network
from heavebond.equations.expanded import Expanded, Leaf
from heavebond.language.definition import Component, FileInput, Note, PartPlace, Value
from heavebond.pictures.text_metrics import shortened
from heavebond.text.expression import Number, names
from heavebond.text.shapes import whole_number

NODE = "node "  # prefix of the path of a node, to distinguish it from components and ports
LONGEST_VALUE = 30  # characters
Ends = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Net:
    """A node: its path, its displayed name (empty if it is displayed elsewhere), its domain, and its ends (part, port); a
    part without name is the edge of the sheet. `in_place`: a formula that feeds an input instead of a node. `size` is its
    number of elements; `chosen` gives the elements for ends that are some elements of an array: `y[1..2]`; `pieces` are
    the lines (x1, y1, x2, y2) that its wire contains, in steps of the grid."""

    path: str
    name: str
    domain: str
    ends: Ends
    in_place: bool = False
    size: int = 1
    chosen: Mapping[tuple[str, str], str] = field(default_factory=dict)
    pieces: tuple[tuple[int, int, int, int], ...] = ()


@dataclass(frozen=True)
class Part:
    """A component on a sheet: its ports with their domains, its place (column, row) and its rotation (degrees clockwise)
    if given, its exact place if `layout:` has it, its settings, and its contents if it is drawn open."""

    path: str
    name: str
    component: Component
    ports: dict[str, str]
    inputs: tuple[str, ...]
    at: tuple[float, float] | None
    values: tuple[str, ...]
    inside: Sheet | None = None
    turn: int | None = None
    exact: PartPlace | None = None


@dataclass(frozen=True)
class Sheet:
    """One level of a diagram; `ports` are the ports of the block itself, with their domains, `kind` its component;
    `notes` are texts on it, by their names."""

    path: str
    parts: dict[str, Part]
    nets: tuple[Net, ...]
    ports: dict[str, str] = field(default_factory=dict)
    kind: str = ""
    notes: Mapping[str, Note] = field(default_factory=dict)


def sheet(expanded: Expanded, network: Network, opened: frozenset[str]) -> Sheet:
    """The outermost sheet, with the sheets of the `opened` blocks inside it."""
    return _Reader(expanded, network, opened).sheet("")


def opened_blocks(expanded: Expanded, wanted: Iterable[str], every: bool, marked: Iterable[str]) -> frozenset[str]:
    """The blocks to draw open: named ones, all of them, or those around marked places."""
    blocks = expanded.blocks
    open_blocks = set(blocks) if every else set()
    for name in wanted:
        if name not in blocks:
            leaf = expanded.leaves.get(name)
            message = f"there is no block '{name}' to open" if leaf is None else \
                f"'{name}' ({leaf.component.name}) is not made of other components; there is nothing to open"
            hint = suggest(name, blocks) if leaf is None else ""
            raise UsageError([Problem("open-unknown", message, None, hint or (
                f"Blocks: {listing(blocks)}." if blocks else "This diagram has no blocks."))])
        open_blocks |= {name, *_around(name)}
    for name in marked:
        open_blocks |= {path for path in _around(name.removeprefix(NODE)) if path in blocks}
    return frozenset(open_blocks)


def marked_places(expanded: Expanded, names: Mapping[str, str]) -> dict[str, str]:
    """Labels by place: a component or port by its path, a node as `node PATH`, which also distinguishes a node from a
    component of the same name. UsageError with similar names for unknown ones."""
    return {_marked_place(expanded, name): label for name, label in names.items()}


def _marked_place(expanded: Expanded, name: str) -> str:
    node = name.removeprefix(NODE)
    if _is_further(node):
        owner, dot, last = node.rpartition(".")
        base, _, indices = last.partition("[")
        node = owner + dot + base + "[1]" * (1 + indices.count("["))
    if node in expanded.junctions and (node != name or node not in expanded.leaves):
        return NODE + node
    ports = [*expanded.ports, *expanded.signals]
    indexed = [end.name for junction in expanded.junctions.values() for end in junction.ends]
    if name not in (known := dict.fromkeys([*expanded.leaves, *ports, *indexed])):
        raise UsageError([Problem("highlight-unknown", f"there is no component, node or port '{name}' to mark", None,
                                  suggest(name, [*known, *expanded.junctions]) or
                                  f"Components: {listing(expanded.leaves)}. Nodes: {listing(expanded.junctions)}.")])
    return name


def _around(path: str) -> list[str]:
    """`a.b.c`: `a`, `a.b`."""
    words = path.split(".")
    return [".".join(words[:k]) for k in range(1, len(words))]


def _is_further(node: str) -> bool:
    """True for the node of the second or a later element of whole arrays: `bonds[2]`."""
    _, _, indices = node.rpartition(".")[2].partition("[")
    return bool(indices) and set(indices[:-1].split("][")) != {"1"}


def _base(path: str) -> str:
    """A node without the index of its element: `cmc.bonds` of `cmc.bonds[2]`."""
    owner, dot, last = path.rpartition(".")
    return owner + dot + last.partition("[")[0]


def _owner(path: str) -> str:
    return path.rpartition(".")[0]


class _Reader:
    def __init__(self, expanded: Expanded, network: Network, opened: frozenset[str]):
        self.expanded = expanded
        self.network = network
        self.opened = opened
        self.extra: dict[str, dict[str, str]] = {}  # ports that blocks get from nodes which extend out of them
        self.nets: dict[str, list[Net]] = {}
        # a node of whole arrays is one wire, the wire of its first elements
        self.drawn = {path: junction for path, junction in expanded.junctions.items() if not _is_further(path)}
        self.elements: dict[str, list[str]] = {}  # the nodes of one wire
        for path in expanded.junctions:
            self.elements.setdefault(_base(path), []).append(path)
        for path in self.drawn:
            # sort the ends of a node: on its sheet, further out (`block.node: [+leak.a]`), and inside a block (`node:
            # [block.part.a]`)
            junction, scope = self.expanded.junctions[path], _owner(path)
            index = self.network.group_of_node.get(path)
            domain = "signal" if index is None else self.network.groups[index].domain
            own_ends: list[tuple[str, str]] = []
            outside: dict[str, list[tuple[str, str]]] = {}
            for end in junction.ends:
                home = _owner(end.leaf) if end.sign > 0 else end.leaf
                ends = own_ends if home == scope else outside.setdefault(home, [])
                ends.append((end.leaf.rpartition(".")[2], end.port) if end.sign > 0 else ("", end.port))
            name = _base(path).rpartition(".")[2]
            for home in [home for home in outside if home.startswith(f"{scope}." if scope else "") and home]:
                own_ends.append(self._inwards(path, name, domain, home, outside.pop(home)))
            # add the node to the enclosing sheets, up to the outermost on which a port joins it
            outer, _, node = path.rpartition(".")
            block, remaining = outer, dict(outside)
            while remaining and block:
                level = _owner(block)
                self.extra.setdefault(block, {})[f":{node}"] = domain
                joined_ends = [(block.rpartition(".")[2], f":{node}"), *remaining.pop(level, [])]
                joined_ends += [("", f":{node}")] if remaining else []
                label = "" if outer in self.opened else node
                self.nets.setdefault(level, []).append(Net(path, label, domain, tuple(joined_ends)))
                block = level
            if outside:
                own_ends.append(("", f":{name}"))
            self.nets.setdefault(scope, []).append(Net(path, name, domain, tuple(own_ends),
                                                       size=len(self.elements[_base(path)]), chosen=self._chosen(path)))

    def _chosen(self, path: str) -> dict[tuple[str, str], str]:
        """The ends of a wire that are parts of a vector, in the notation of diagrams; ends of a matrix are omitted."""
        texts_by_end = {}
        joined = [self.expanded.junctions[each].ends for each in self.elements[_base(path)]]
        for ends in zip(*joined, strict=True) if len({len(ends) for ends in joined}) == 1 else ():
            port, _, index_text = ends[0].port.partition("[")
            leaf = self.expanded.leaves[ends[0].leaf]
            if ends[0].sign < 0 or index_text.count("]") != 1:
                continue
            array = leaf.component.ports.get(port)
            count = whole_number(array.count, leaf.integers) if array is not None and array.count is not None else sum(
                name.partition("[")[0] == port for name in leaf.component.signals)
            first, last = (int(end.port.partition("[")[2][:-1]) for end in (ends[0], ends[-1]))
            if len(ends) != count:
                index_range = f"{first}" if first == last else f"{first}..{last}"
                texts_by_end[ends[0].leaf.rpartition(".")[2], ends[0].port] = f"{port}[{index_range}]"
        return texts_by_end

    def _inwards(self, path: str, name: str, domain: str, home: str, ends: list[tuple[str, str]]) -> tuple[str, str]:
        """Add the node to the sheets from its `ends` up to its level; returns the block and port that join it there."""
        scope, port, first = _owner(path), f":{name}", True
        while home != scope:
            self.extra.setdefault(home, {})[port] = domain
            inner = Net(path, name if first else "", domain, (*ends, ("", port)))
            self.nets.setdefault(home, []).append(inner)
            ends, home, first = [(home.rpartition(".")[2], port)], _owner(home), False
        return ends[0]

    def sheet(self, scope: str) -> Sheet:
        body = self.expanded.leaves[scope].component.body if scope else self.expanded.model.body
        layout = body.layout
        parts = {}
        for path, leaf in self.expanded.leaves.items():
            if path and _owner(path) == scope:  # a block by itself has an empty path
                name = path.rpartition(".")[2]
                instance = body.instances.get(name)
                at = instance.at if instance is not None else None
                bindings = {**leaf.parameters, **leaf.inputs}
                settings_written = instance.settings if instance is not None else {}
                values = tuple(f"{key} = {_value_text(bound.value, _unit(leaf.component, key))}"
                               for key, bound in bindings.items() if key in settings_written
                               or f"{path}.{key}" in self.expanded.model.settings)
                inside = self.sheet(path) if path in self.opened else None
                inputs = tuple(k for k, s in leaf.component.signals.items() if s.direction == "in")
                parts[name] = Part(path, name, leaf.component, self._ports(path, leaf), inputs, (at[0], at[1]) if at
                                   else None, values, inside, int(at[2]) if at and len(at) > 2 else None,
                                   layout.parts.get(name))
        owner = self.expanded.leaves.get(scope)
        ports = self._ports(scope, owner) if owner else {}
        formulas = [net for part in parts.values() for net in self._formulas(part)]
        nets = [replace(net, pieces=layout.wires.get(net.path.rpartition(".")[2], ())) if _owner(net.path) == scope else net
                for net in self.nets.get(scope, ())]
        return Sheet(scope, parts, (*nets, *formulas), ports, owner.component.name if owner else "", layout.notes)

    def _formulas(self, part: Part) -> Iterator[Net]:
        """Inputs that read variables of other components: a connection without a wire."""
        for name, bound in self.expanded.leaves[part.path].inputs.items():
            if isinstance(bound.value, Value) and any("." in read.text for read in names(bound.value.expr)):
                text = shortened(bound.value.text.lstrip("= "), LONGEST_VALUE)
                yield Net(f"{part.path}.{name}", text, "signal", ((part.name, name),), in_place=True)

    def _ports(self, path: str, leaf: Leaf) -> dict[str, str]:
        """Every port with its domain, the elements of arrays one by one."""
        domains_by_port = {}
        domains = self.network.domains.get(path, {})
        for port in leaf.component.ports.values():
            elements = [port.name] if port.count is None else [
                end.port for junction in self.drawn.values() for end in junction.ends
                if end.leaf == path and end.sign > 0 and end.port.partition("[")[0] == port.name]
            if port.count is not None and (count := whole_number(port.count, leaf.integers)) is not None:
                elements += [f"{port.name}[{k}]" for k in range(1, count + 1)]  # unconnected ports
            domains_by_port.update({name: domains.get(port.name, port.domain) for name in elements})
        domains_by_port.update(dict.fromkeys(leaf.component.signals, "signal"))
        return {**domains_by_port, **self.extra.get(path, {})}


def _unit(component: Component, name: str) -> str:
    parameter = component.parameters.get(name)
    return parameter.unit.text if parameter is not None else component.signals[name].unit.text


def _value_text(value: Value | FileInput, unit: str) -> str:
    """A value as written in the diagram, its unit in printed form; a plain Python number with the declared unit."""
    if isinstance(value, FileInput):
        return shortened(value.file.name, LONGEST_VALUE)
    if value.si and isinstance(value.expr, Number):
        return readable(value.expr.value, unit)
    number, blank, written = value.text.partition(" ")
    plain = isinstance(value.expr, Number) and blank and " " not in written
    return f"{number} {unit_label(written)}" if plain else shortened(value.text.lstrip("=").strip(), LONGEST_VALUE)


def marks_on(path: str, marks: Mapping[str, str], ports: Iterable[str]) -> dict[str, str]:
    """The marks on a part and on its ports: label by '' or by port."""
    marks_by_port = {"": marks[path]} if path in marks else {}
    return {**marks_by_port, **{port: marks[f"{path}.{port}"] for port in ports if f"{path}.{port}" in marks}}
