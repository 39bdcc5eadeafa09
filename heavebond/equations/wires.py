"""Wires of a diagram while its blocks are opened: the ports and signals of each node; an array has one node for each
element."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from heavebond.core.errors import Place, Problems, listing, nearest, suggest
from heavebond.core.units import is_generic
from heavebond.equations.arrays import array_text, part_of
from heavebond.equations.expanded import Junction, Leaf, PortEnd
from heavebond.language.definition import Body, Component, End, Port, SignalPort, Value
from heavebond.language.sections import Setting
from heavebond.text.shapes import whole_number


class Wires:
    """The nodes of all levels by full path, and what every port carries; `leaves` are the components that are open so far,
    `unused` the settings that no component has taken yet."""

    def __init__(self, leaves: Mapping[str, Leaf], unused: Mapping[str, Setting], problems: Problems):
        self.leaves, self.unused, self.problems = leaves, unused, problems
        self.junctions: dict[str, Junction] = {}
        self.ports: dict[str, Port] = {}
        self.signals: dict[str, SignalPort] = {}
        self.extra: dict[str, list[PortEnd]] = {}
        self.extra_places: dict[str, Place] = {}
        # ports that a misspelt end most likely meant, and parts with such an end: not reported as unconnected as well
        self.meant: set[str] = set()
        # ports of parts inside blocks that a node outside them joins, and ends taken off nodes inside blocks, by node
        self.outside: dict[str, Place] = {}
        self.removed: dict[str, dict[str, Place]] = {}
        self.by_default: dict[str, Value] = {}  # inputs that are on no node and have a default

    def inside_blocks(self) -> None:
        """Check that all wires to nodes and ports inside blocks are used."""
        for name, place in self.outside.items():
            leaf = self.leaves.get(name.rpartition(".")[0])
            if leaf is None or name.rpartition(".")[2] not in (*leaf.component.ports, *leaf.component.signals):
                choices = [f"{path}.{p}" for path, one in self.leaves.items() if "." in path
                           for p in (*one.component.ports, *one.component.signals)]
                self.problems.add("end-unknown", f"there is no port '{name}' inside a block", place,
                                  hint=suggest(name, choices) or f"Ports: {listing(choices)}.")
        for node, ends in self.removed.items():
            for name, place in ends.items():
                self.problems.add("node-end-unknown", f"'{name}' is not on node '{node}'", place,
                                  hint=suggest(node, self.junctions) or f"Nodes: {listing(self.junctions)}.")
        for path in self.extra:
            self.problems.add("node-unknown", f"there is no node '{path}' inside a block", self.extra_places[path],
                              hint=suggest(path, self.junctions) or f"Nodes: {listing(self.junctions)}.")

    def join(self, body: Body, prefix: str, owner: Component | None, known: dict[str, Component]) -> None:
        """Connect the nodes of one level, and note ports that are on no node."""
        on: dict[str, tuple[str, Place]] = {}
        for wire in body.wires.values():
            ends = []
            if not wire.ends:
                self.problems.add("node-empty", f"node '{wire.name}' joins nothing", wire.place,
                                  hint=f"Write its ports, `{wire.name}: [spring.a, wall.a]`, or remove the line.")
            removed = self.removed.get(prefix + wire.name, {})
            for end in wire.ends:
                if end.path.startswith("-"):  # taken off a node inside a block
                    self.removed.setdefault(prefix + wire.name, {})[prefix + end.path[1:]] = end.place
                    continue
                joined = self._end(end, prefix, owner, known, body)
                if joined is None or ("." not in wire.name and removed.pop(joined.name, None) is not None):
                    continue
                if joined.name in self.outside and joined.leaf in {prefix + name for name in known}:
                    outer = self.outside[joined.name]
                    self.problems.add("port-on-two-nodes", f"'{joined.name}' is on node '{prefix}{wire.name}' of its block",
                                      outer, hint=f"Take it off: `{prefix}{wire.name}: [-{joined.name}]`.")
                if joined.name in on:
                    node, first = on[joined.name]
                    twice = node == wire.name
                    self.problems.add("port-on-two-nodes", f"'{end.path}' is listed twice on node '{node}'" if twice else
                                      f"'{end.path}' is on two nodes, '{node}' (line {first.line}) and '{wire.name}'",
                                      end.place, hint="Remove one of the two." if twice else "A port is on one node; "
                                      "join the two nodes into one, or remove the port from one of them.")
                    continue
                on[joined.name] = (wire.name, end.place)
                ends.append(joined)
            if "." in wire.name:
                self.extra.setdefault(prefix + wire.name, []).extend(ends)
                self.extra_places[prefix + wire.name] = wire.place
            else:
                path = prefix + wire.name
                self.junctions[path] = Junction(path, (*ends, *self.extra.pop(path, [])), wire.place)
        joined_ports = {*on, *self.meant, *self.outside}
        for name, component in known.items():
            instance, path = body.instances[name], prefix + name
            for port in component.ports.values():
                self.ports[f"{path}.{port.name}"] = port
                if port.count is None and f"{path}.{port.name}" not in joined_ports:
                    self.problems.add("port-unconnected", f"port '{name}.{port.name}' is on no node", instance.place,
                                      hint=f"Add `{name}.{port.name}` to a node; a free end is a separate node: "
                                      f"`{name}_{port.name}: [{name}.{port.name}]`.")
            for signal_name, signal in component.signals.items():
                if signal.count is None:  # the elements of a vector are known later
                    full = f"{path}.{signal_name}"
                    self.signals[full] = signal
                    has_value = signal_name in instance.settings or full in self.unused
                    if signal.default is not None and not has_value and full not in joined_ports:
                        self.by_default[full] = signal.default
                        continue
                    self._input(name, signal, instance.place, has_value or full in joined_ports)

    def _end(self, end: End, prefix: str, owner: Component | None, known: dict[str, Component],
             body: Body) -> PortEnd | None:
        head, _, port = end.path.partition(".")
        if "[" in head:  # an element or a part of an array of the block's own
            head, port = end.path, ""
        if not port and owner is not None and head.partition("[")[0] in (*owner.ports, *owner.signal_names):
            return PortEnd(prefix[:-1], head, -1, end.place)
        if head in body.instances and head not in known:
            return None  # its kind is unknown, which is said already
        component = known.get(head)
        if component is None or not port:
            part = end.path.partition(".")[0]
            if part in known:
                ports = [*known[part].ports, *known[part].signals]
                self.meant |= {f"{prefix}{part}.{p}" for p in ports}
                self.problems.add("port-missing", f"'{part}' is a component; a node joins its ports", end.place,
                                  hint="Write " + " or ".join(f"`{part}.{p}`" for p in ports[:4]) + ".")
                return None
            names = [*owner.ports, *owner.signals] if owner else []
            ends = [f"{n}.{p}" for n, c in known.items() for p in (*c.ports, *c.signals)] + names
            near = nearest(end.path, ends)
            if near:
                self.meant.add(prefix + near)
            problem = f"there is no component '{part}'" if "." in end.path or not owner else \
                f"this block has neither a component nor a port '{part}'"
            self.problems.add("end-unknown", problem, end.place,
                              hint=suggest(end.path, ends) or suggest(part, known) or f"Components: {listing(known)}.")
            return None
        if component.composite and "." in port:  # a part inside the block
            leaf, _, port = f"{prefix}{end.path}".rpartition(".")
            self.outside[f"{leaf}.{port}"] = end.place
            return PortEnd(leaf, port, 1, end.place)
        base = port.partition("[")[0]
        if base not in component.ports and base not in component.signals:
            choices = [*component.ports, *component.signals]
            self.meant |= {f"{prefix}{head}.{p}" for p in choices}
            apart = f"{head}.{port}".split()  # ends without a comma between them
            commas = f"Write a comma between two ends: {', '.join(apart)}." if len(apart) > 1 else ""
            self.problems.add("port-unknown", f"'{head}' ({component.name}) has no port '{port}'", end.place,
                              hint=commas or suggest(port, choices) or f"Its ports: {listing(choices)}.")
            return None
        return PortEnd(prefix + head, port, 1, end.place)

    def _input(self, part: str, signal: SignalPort, place: Place, driven: bool, length: int = 0) -> None:
        """Check that an input, or an element of one with `length` elements, has a value or is on a node."""
        if signal.direction == "in" and not driven:
            unit = "" if signal.unit.text == "1" or is_generic(signal.unit.dimension) else f" {signal.unit.text}"
            name, value = signal.name.partition("[")[0], f"[{', '.join([f'0{unit}'] * length)}]" if length else f"0{unit}"
            self.problems.add("input-unconnected", f"input '{part}.{signal.name}' has no value", place,
                              hint=f"Join it to an output on a node, or give it in place: `{name}: {value}`.")

    def arrays(self) -> None:
        """Check that every element of an array of ports is on a node, and no other. A node of whole arrays is one node for
        each element."""
        self.junctions = {one.path: one for junction in self.junctions.values() for one in self._elements(junction)}
        joined = {end.name: end for junction in self.junctions.values() for end in junction.ends if end.sign > 0}
        # each element of a vector of signals is on a node or has a value, and no other element is named
        for path, leaf in self.leaves.items():
            vectors = {name: signal for name, signal in leaf.component.signals.items() if "[" in name}
            if not vectors:
                continue
            self.signals.update({f"{path}.{name}": signal for name, signal in vectors.items()})
            whole = {name.partition("[")[0] for name in vectors}
            for base in dict.fromkeys(name.partition("[")[0] for name in vectors):
                elements = [name for name in vectors if name.partition("[")[0] == base]
                open_elements = [name for name in elements if name not in leaf.inputs and f"{path}.{name}" not in joined]
                if f"{path}.{base}" in self.meant:
                    continue
                if len(open_elements) == len(elements):  # one message for the whole list
                    self._input(path, replace(vectors[elements[0]], name=base), leaf.place, False, len(elements))
                    continue
                for name in open_elements:
                    self._input(path, vectors[name], leaf.place, False, len(elements))
            for end in joined.values():
                if end.leaf == path and end.port.partition("[")[0] in whole and end.port not in vectors:
                    self.problems.add("port-index", f"'{path}' has the signals {listing(vectors)}; '{end.port}' is none of "
                                      "these", end.place, hint="An index counts from 1.")
        for path, leaf in self.leaves.items():
            for port in leaf.component.ports.values():
                count = None if port.count is None else whole_number(port.count, leaf.integers)
                if count is None or f"{path}.{port.name}" in self.meant:
                    continue
                wanted = [f"{path}.{port.name}[{k}]" for k in range(1, count + 1)]
                for name, end in joined.items():
                    if name.partition("[")[0] == f"{path}.{port.name}" and name not in wanted:
                        self.problems.add("port-index", f"'{path}' has the ports {port.name}[1] to {port.name}[{count}]; "
                                          f"'{end.port}' is none of these", end.place,
                                          hint=f"Write `{path}.{port.name}[1]`, in quotes inside a list.")
                missing = [name for name in wanted if name not in joined]
                if missing:
                    self.problems.add("port-unconnected", f"{listing([repr(m) for m in missing], 4)} "
                                      f"{'is' if len(missing) == 1 else 'are'} on no node", leaf.place,
                                      hint="Join each to a node (in quotes inside a list), or lower the number of ports.")

    def _elements(self, junction: Junction) -> list[Junction]:
        """The junctions `path[1]`, `path[2]` of a node of whole arrays of ports, of vectors of signals or of parts of them;
        any other node unchanged."""
        arrays = {end.name: indices for end in junction.ends if (indices := self._array(end)) is not None}
        if not arrays:
            return [junction]
        shapes = {name: array_text(indices) for name, indices in arrays.items()}
        single = next((end for end in junction.ends if end.name not in arrays), None)
        if single is not None or len(set(shapes.values())) > 1:
            name, shape = next(iter(shapes.items()))
            if single is not None:
                leaf = self.leaves.get(single.leaf)
                is_signal = leaf is not None and leaf.component.signal(single.port) is not None
                clash = f"'{single.name}' is one {'signal' if is_signal else 'port'}"
            else:
                clash = next(f"'{n}' is {s}" for n, s in shapes.items() if s != shape)
            self.meant |= {name.partition("[")[0] for name in arrays}
            self.problems.add("array-length", f"node '{junction.path}' joins whole arrays: '{name}' is {shape}, {clash}",
                              junction.place, hint="Join arrays of one length, or single elements or parts, such as "
                              f'`"{name.partition("[")[0]}[1]"` and `"{name.partition("[")[0]}[1..2]"`, in quotes.')
            return []
        bases = {end.name: end.port.partition("[")[0] for end in junction.ends}
        return [Junction(f"{junction.path}{index}", tuple(replace(end, port=bases[end.name] + arrays[end.name][index])
                                                          for end in junction.ends), junction.place)
                for index in next(iter(arrays.values()))]

    def _array(self, end: PortEnd) -> dict[str, str] | None:
        """The indices of the elements that an end means, from 1, and those in the array of which it is the whole or a part;
        None for one port or signal."""
        leaf = self.leaves.get(end.leaf)
        if leaf is None:
            return None
        base, bracket, inside = end.port.partition("[")
        port = leaf.component.ports.get(base)
        if port is not None:
            size = None if port.count is None else whole_number(port.count, leaf.integers)
            suffixes = [] if size is None else [f"[{k}]" for k in range(1, size + 1)]
        else:
            suffixes = [name.removeprefix(base) for name in leaf.component.signals if name.startswith(f"{base}[")]
        if not suffixes or (bracket and ".." not in inside):
            return None
        return {index: index for index in suffixes} if not bracket else part_of(suffixes, inside[:-1], leaf.integers)
