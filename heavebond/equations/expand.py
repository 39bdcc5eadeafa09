"""Expansion of a diagram: every component with equations and every node inside its blocks, by full path."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from heavebond.core.errors import HeavebondError, ModelError, Place, Problems, listing, nearest, suggest
from heavebond.core.limits import OF_A_KIND
from heavebond.core.units import is_generic
from heavebond.equations.arrays import array_text, by_elements, part_of, shared, vector_outputs
from heavebond.equations.data_sheets import DataSheet, data_sheets, taken, whole
from heavebond.equations.repetition import repeated
from heavebond.language.definition import Body, Component, End, FileInput, Instance, Parameter, Port, SignalPort, Value
from heavebond.language.lists import lengths, short, written_out
from heavebond.language.model import Model
from heavebond.language.sections import Setting
from heavebond.language.values import bounds_text, check_bounds, check_dimension
from heavebond.text.expression import Number, names
from heavebond.text.shapes import whole_number

DEEPEST_BLOCK = 20


@dataclass(frozen=True)
class Bound:
    """A value given to a parameter or an input, and the scope (path prefix) in which its names are looked up."""

    value: Value | FileInput
    scope: str
    place: Place

    @property
    def varies(self) -> bool:
        """Whether a measured file or a formula in time gives the value."""
        return isinstance(self.value, FileInput) or any(n.text == "time" for n in names(self.value.expr))


@dataclass(frozen=True)
class Leaf:
    """A component in the opened diagram. A block is a leaf too: it may have equations beside its parts."""

    path: str
    component: Component
    place: Place
    parameters: dict[str, Bound]
    inputs: dict[str, Bound]
    integers: dict[str, int]

    @property
    def scope(self) -> str:
        """The prefix of the names inside."""
        return self.path + "."


@dataclass(frozen=True)
class PortEnd:
    """A port on a node; the sign is -1 for a block's own port seen from its inside."""

    leaf: str
    port: str
    sign: int
    place: Place

    @property
    def name(self) -> str:
        """Its full path."""
        return f"{self.leaf}.{self.port}" if self.leaf else self.port


@dataclass(frozen=True)
class Junction:
    """A node: its full path and the ends that it joins."""

    path: str
    ends: tuple[PortEnd, ...]
    place: Place


@dataclass(frozen=True)
class Medium:
    """What fills a circuit: the part `source` of this `kind` that sets it (empty: nothing does, and its usual values stand
    in), the nodes of the circuit, and the parameters `takers` that take their values from it."""

    source: str
    kind: str
    nodes: tuple[str, ...]
    takers: tuple[str, ...]


@dataclass(frozen=True)
class Expanded:
    """The opened diagram. `ports` and `signals` tell what each port end carries, by full port path; `media` what fills
    the circuits that have parts which ask for it, `sheets` which parameters follow those of a part that is their data sheet.
    """

    model: Model
    leaves: dict[str, Leaf]
    junctions: dict[str, Junction]
    parameters: dict[str, Bound] = field(default_factory=dict)
    ports: dict[str, Port] = field(default_factory=dict)
    signals: dict[str, SignalPort] = field(default_factory=dict)
    media: tuple[Medium, ...] = ()
    sheets: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def blocks(self) -> list[str]:
        """The components that are made of others."""
        return [path for path, leaf in self.leaves.items() if leaf.component.composite]


def expand(model: Model) -> Expanded:
    """Open every block of the diagram; ModelError with all that is wrong with names, ports and wires.

    Parameters that are taken from the medium of a circuit are still open (see `medium`).
    """
    found, problems = expand_as_far(model)
    problems.raise_as(ModelError)
    return found


def expand_as_far(model: Model) -> tuple[Expanded, Problems]:
    """An unfinished diagram, opened as far as it goes, and all that is wrong with it: parts of unknown kinds, ends of wires
    that mean nothing and values that are missing are left out."""
    opener = _Opener(model)
    opener.top()
    opener.arrays()
    show = vector_outputs(model.show, opener.component, lambda: {
        *opener.junctions, *(end.name for junction in opener.junctions.values() for end in junction.ends)})
    if len(show) != len(model.show):
        model = replace(model, show=show)
    found = Expanded(model, opener.leaves, opener.junctions, opener.parameters, opener.ports, opener.signals,
                     sheets={path: tuple(takers) for path, takers in opener.sheets.items()})
    return found, opener.problems


class _Opener:
    def __init__(self, model: Model):
        self.model = model
        self.problems = Problems()
        self.leaves: dict[str, Leaf] = {}
        self.junctions: dict[str, Junction] = {}
        self.ports: dict[str, Port] = {}
        self.signals: dict[str, SignalPort] = {}
        self.parameters: dict[str, Bound] = {}
        self.extra: dict[str, list[PortEnd]] = {}
        self.extra_places: dict[str, Place] = {}
        self.unused = dict(model.settings)
        self.settable: list[str] = []
        self.found: dict[str, Component] = {}
        self.sheets: dict[str, list[str]] = {}
        # ports that a misspelt end most likely meant, and parts with such an end: not reported as unconnected as well
        self.meant: set[str] = set()

    def top(self) -> None:
        model = self.model
        for name, value in model.parameters.items():
            setting = self._setting(name)
            bound = Bound(value, "", value.place) if setting is None else Bound(setting.value, "", setting.place)
            self.parameters[name] = bound
        if not model.body.instances:
            self.problems.add("diagram-empty", "this diagram has no components", Place(model.path.name, 1),
                              hint="Add `components:` and `nodes:`.")
        self._body(model.body, "", None, {}, ())
        self._unused_settings()
        for path in self.extra:
            self.problems.add("node-unknown", f"there is no node '{path}' inside a block", self.extra_places[path],
                              hint=suggest(path, self.junctions) or f"Nodes: {listing(self.junctions)}.")

    def _setting(self, path: str) -> Setting | None:
        self.settable.append(path)
        return self.unused.pop(path, None)

    def _unused_settings(self) -> None:
        for path, setting in self.unused.items():
            owner, _, name = path.rpartition(".")
            own = [s for s in self.settable if s.rpartition(".")[0] == owner]
            message, choices = f"nothing here is called '{path}', so it cannot be set", self.settable
            if owner in self.leaves:
                component = self.leaves[owner].component
                message, choices = f"'{owner}' ({component.name}) has no parameter '{name}'", own
            elif owner in self.junctions:
                message, choices = f"'{path}' changes during a run; only parameters and inputs are set", []
            hint = suggest(path, choices) or (f"What can be set: {listing(choices, 20)}." if choices else
                                              "Its value at the start stands under `initial:`.")
            self.problems.add("setting-unknown", message, setting.place, hint=hint)

    def component(self, path: str) -> Component | None:
        """The component at a path."""
        leaf = self.leaves.get(path)
        return None if leaf is None else leaf.component

    # -- one level -------------------------------------------------------------------------------------------------
    def _body(self, body: Body, prefix: str, owner: Component | None, integers: dict[str, int],
              kinds: tuple[str, ...]) -> None:
        numbers = integers if prefix else {**self._top_integers(), **integers}
        body = repeated(body, numbers, lambda instance: self._component(instance, kinds), self.problems)
        self._name_clashes(body, owner)
        known: dict[str, Component] = {}
        for instance in body.instances.values():
            component = self._component(instance, kinds)
            if component is not None:
                known[instance.name] = component
        self._nodes(body, prefix, owner, known)
        for name, component in known.items():
            sheets = data_sheets(body.instances[name], body, known, prefix, self.model, self.problems) \
                if body.instances[name].data else ()
            self._instance(body.instances[name], component, prefix, integers, kinds, sheets)
            for sheet in sheets:
                self.sheets.setdefault(sheet.path, []).extend(sheet.takers)

    def _component(self, instance: Instance, kinds: tuple[str, ...]) -> Component | None:
        try:
            component = self.found.get(instance.kind) or self._checked(instance)
        except HeavebondError as error:
            self.problems.extend(error)
            return None
        if component.name in kinds or len(kinds) > DEEPEST_BLOCK:
            circle = [*kinds[kinds.index(component.name):], component.name] if component.name in kinds else [*kinds]
            self.problems.add("block-contains-itself", f"'{circle[0]}' contains itself: {' > '.join(circle)}"
                              if component.name in kinds else f"blocks stand in each other more than "
                              f"{DEEPEST_BLOCK} deep", instance.place,
                              hint="A block is made of other components; leave one of these parts out.")
            return None
        return component

    def _checked(self, instance: Instance) -> Component:
        """A component met for the first time; its file is read and its laws are checked once, not for every instance."""
        library = self.model.library
        component = self.found[instance.kind] = library.component(instance.kind, instance.kind_place)
        library.checked(instance.kind, instance.kind_place)
        return component

    def _name_clashes(self, body: Body, owner: Component | None) -> None:
        for wire in body.wires.values():
            instance = body.instances.get(wire.name)
            if instance is not None and not any(e.path.split(".")[0] == wire.name for e in wire.ends):
                self.problems.add("name-twice", f"node '{wire.name}' has the name of a component that is not on it",
                                  wire.place, hint="Give the node another name.")
        if owner is None:
            for name, value in self.model.parameters.items():
                if name in body.instances or name in body.wires:
                    self.problems.add("name-twice", f"'{name}' is a parameter and a component or node", value.place,
                                      hint="Give one of them another name.")

    def _instance(self, instance: Instance, component: Component, prefix: str, outer: dict[str, int],
                  kinds: tuple[str, ...], sheets: tuple[DataSheet, ...]) -> None:
        path = prefix + instance.name
        if any(p.columns is not None for p in component.parameters.values()):
            instance = replace(instance, settings=by_elements(instance.settings, component))
        parameters: dict[str, Bound] = {}
        missing: list[str] = []
        told = lengths(component, lambda name: name in instance.settings or f"{path}.{name}" in self.unused
                       or name in component.values or any(sheet.has(name) for sheet in sheets))
        for name in (n for n, p in component.parameters.items() if p.integer):
            bound = self._given(instance, name, prefix, path)
            if bound is None and (value := whole(sheets, name, f"{path}.{name}")) is not None:
                bound = Bound(value, "", value.place)
            bound = bound or self._told(told, name, instance) or default(component.parameters[name], path)
            if bound is not None:
                parameters[name] = bound
        integers = self._integers(component, parameters, outer)
        component = written_out(component, integers)
        for name, parameter in component.parameters.items():
            bound = parameters.get(name) or self._given(instance, name, prefix, path)
            if bound is None and (value := taken(sheets, name, f"{path}.{name}", instance.place)) is not None:
                bound = Bound(value, "", instance.place)
            if bound is None and parameter.medium:
                continue  # its circuit decides
            bound = bound or self._own(component, name, path) or default(parameter, path)
            if bound is None:
                missing.append(name)
            elif isinstance(bound.value, FileInput):
                self.problems.add("parameter-file", f"{path}.{name} is a constant; a record cannot set it",
                                  bound.place, hint="Give it a quantity; records are for inputs.")
            else:
                parameters[name] = bound
                self._check_literal(f"{path}.{name}", parameter, bound.value)
        if not self._unknown_settings(instance, component, missing):
            self._missing(instance.place, path, component, missing)
        inputs = {name: bound for name, port in component.signals.items() if port.direction == "in"
                  and (bound := self._given(instance, name, prefix, path)
                       or self._given_whole(instance, name, prefix, path)) is not None}
        self.leaves[path] = Leaf(path, component, instance.place, parameters, inputs, integers)
        if component.composite:
            self._body(component.body, path + ".", component, integers, (*kinds, component.name))

    @staticmethod
    def _own(component: Component, name: str, path: str) -> Bound | None:
        """What a component that extends another one gives to an element of a list."""
        value = component.values.get(name)
        return None if value is None else Bound(value, path + ".", value.place)

    def _given(self, instance: Instance, name: str, prefix: str, path: str) -> Bound | None:
        setting = self._setting(f"{path}.{name}")
        if setting is not None:
            return Bound(setting.value, "", setting.place)
        given = instance.settings.get(name)
        return None if given is None else Bound(given, prefix, given.place)

    def _given_whole(self, instance: Instance, name: str, prefix: str, path: str) -> Bound | None:
        """What is given to an element of a vector of inputs by the name of the whole: `u: =filter.y`, or one number."""
        base, bracket, _ = name.partition("[")
        setting = self.model.settings.get(f"{path}.{base}") if bracket else None
        given = setting.value if setting is not None else instance.settings.get(base) if bracket else None
        if not isinstance(given, Value):
            return None
        self.unused.pop(f"{path}.{base}", None)
        return Bound(shared(given, base, name), "" if setting is not None else prefix, given.place)

    @staticmethod
    def _told(told: dict[str, int], name: str, instance: Instance) -> Bound | None:
        """A whole number that the length of a list tells."""
        if name not in told:
            return None
        value = Value(Number(told[name], None, 0), f"{told[name]} values", instance.place, si=True)
        return Bound(value, "", instance.place)

    def _check_literal(self, name: str, parameter: Parameter, value: Value) -> None:
        """A plain quantity has the right unit and lies within its bounds; formulas are checked when all are known."""
        if isinstance(value.expr, Number) and not value.si and not parameter.integer \
                and not is_generic(parameter.unit.dimension):
            before = len(self.problems.found)
            check_dimension(name, value, None, parameter.unit, self.problems)
            if len(self.problems.found) == before:
                check_bounds(name, parameter, value.expr.value, value, self.problems)

    def _missing(self, place: Place, path: str, component: Component, names: list[str]) -> None:
        for name in names:
            parameter = component.parameters[name]
            if "[" in name:
                count = sum(other.partition("[")[0] == name.partition("[")[0] for other in component.parameters)
                self.problems.add("parameter-missing", f"'{path}' ({component.name}) needs a list of {count} values for "
                                  f"{name.partition('[')[0]} ({parameter.doc}); {name} is not given", place,
                                  hint=f"Write `{name.partition('[')[0]}: [..., ...]`, each value with its unit.")
                return
            unit = "" if parameter.integer or parameter.unit.text == "1" else f" {parameter.unit.text}"
            self.problems.add("parameter-missing", f"'{path}' ({component.name}) needs a value for {name}"
                              + (f" ({parameter.doc})" if parameter.doc else ""), place,
                              hint=f"Add `{name}: ...{unit}`.")

    def _unknown_settings(self, instance: Instance, component: Component, missing: list[str]) -> bool:
        """Whether settings that the component does not have were found; these then say what it lacks."""
        inputs = [n for n, s in component.signals.items() if s.direction == "in"]
        settable = short([*component.parameters, *inputs])
        whole = {name.partition("[")[0] for name in inputs}
        unknown = [name for name in instance.settings if name not in component.parameters and name not in (*inputs, *whole)]
        groups = (("port", component.ports), ("signal", component.signals), ("variable", component.variables))
        needs = listing(f"{n.removesuffix('[1]')} ({'a list, ' * ('[' in n)}{p.doc}, {p.unit.text})" for n in missing
                        if (p := component.parameters[n]) and ("[" not in n or n.endswith("[1]")))
        others = [n for n in settable if n not in missing]
        has = (f"It needs {needs}." + f" It may have: {listing(others)}." * bool(others)) if missing else \
            f"It has: {listing(settable)}." if settable else f"{component.name} has no parameters."
        for name in unknown:
            what = next((k for k, group in groups if name in group), "")
            self.problems.add("parameter-unknown", f"{component.name} has no parameter '{name}'"
                              + (f"; that is a {what} of it" if what else ""), instance.settings[name].place,
                              hint=suggest(name, missing or settable) or has)
        return bool(unknown)

    def _integers(self, component: Component, parameters: dict[str, Bound], outer: dict[str, int]) -> dict[str, int]:
        found: dict[str, int] = {}
        for name, parameter in component.parameters.items():
            bound = parameters.get(name)
            if not parameter.integer or bound is None or isinstance(bound.value, FileInput):
                continue
            plain = not (isinstance(bound.value.expr, Number) and bound.value.expr.unit is not None)
            number = whole_number(bound.value.expr, {**outer, **found}) if plain else None
            if number is None:
                self.problems.add("not-an-integer", f"{name} must be a whole number, '{bound.value.text}' is none",
                                  bound.place, hint=f"Write for example `{name}: 3`.")
            elif abs(number) > OF_A_KIND:
                self.problems.add("not-an-integer", f"{name} = {number} is too many", bound.place,
                                  hint=f"The most is {OF_A_KIND}.")
            elif (parameter.low is not None and number < parameter.low) or \
                    (parameter.high is not None and number > parameter.high):
                self.problems.add("parameter-bound", f"{name} = {number} is not allowed; it must be "
                                  f"{bounds_text(parameter)}", bound.place, hint=parameter.doc)
            else:
                found[name] = number
        return found

    # -- wires -----------------------------------------------------------------------------------------------------
    def _nodes(self, body: Body, prefix: str, owner: Component | None, known: dict[str, Component]) -> None:
        on: dict[str, tuple[str, Place]] = {}
        for wire in body.wires.values():
            ends = []
            if not wire.ends:
                self.problems.add("node-empty", f"node '{wire.name}' joins nothing", wire.place,
                                  hint=f"Write its ports, `{wire.name}: [spring.a, wall.a]`, or remove the line.")
            for end in wire.ends:
                found = self._end(end, prefix, owner, known, body)
                if found is None:
                    continue
                if found.name in on:
                    node, first = on[found.name]
                    twice = node == wire.name
                    self.problems.add("port-on-two-nodes", f"'{end.path}' stands twice on node '{node}'" if twice else
                                      f"'{end.path}' is on two nodes, '{node}' (line {first.line}) and '{wire.name}'",
                                      end.place, hint="Remove one of the two." if twice else "A port is on one node; "
                                      "join the two nodes into one, or remove the port from one of them.")
                    continue
                on[found.name] = (wire.name, end.place)
                ends.append(found)
            if "." in wire.name:
                self.extra.setdefault(prefix + wire.name, []).extend(ends)
                self.extra_places[prefix + wire.name] = wire.place
            else:
                path = prefix + wire.name
                self.junctions[path] = Junction(path, (*ends, *self.extra.pop(path, [])), wire.place)
        for name, component in known.items():
            self._unconnected(prefix, body.instances[name], component, on)

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
            self._bad_end(end, prefix, known, owner)
            return None
        base = port.partition("[")[0]
        if base not in component.ports and base not in component.signals:
            choices = [*component.ports, *component.signals]
            self.meant |= {f"{prefix}{head}.{p}" for p in choices}
            self.problems.add("port-unknown", f"'{head}' ({component.name}) has no port '{port}'", end.place,
                              hint=suggest(port, choices) or f"Its ports: {listing(choices)}.")
            return None
        return PortEnd(prefix + head, port, 1, end.place)

    def _bad_end(self, end: End, prefix: str, known: dict[str, Component], owner: Component | None) -> None:
        head = end.path.partition(".")[0]
        if head in known:
            ports = [*known[head].ports, *known[head].signals]
            self.meant |= {f"{prefix}{head}.{p}" for p in ports}
            self.problems.add("port-missing", f"'{head}' is a component; a node joins its ports", end.place,
                              hint="Write " + " or ".join(f"`{head}.{p}`" for p in ports[:4]) + ".")
            return
        own = [*owner.ports, *owner.signals] if owner else []
        ends = [f"{n}.{p}" for n, c in known.items() for p in (*c.ports, *c.signals)] + own
        near = nearest(end.path, ends)
        if near:
            self.meant.add(prefix + near)
        what = f"there is no component '{head}'" if "." in end.path or not owner else \
            f"this block has neither a component nor a port '{head}'"
        self.problems.add("end-unknown", what, end.place,
                          hint=suggest(end.path, ends) or suggest(head, known) or f"Components: {listing(known)}.")

    def _unconnected(self, prefix: str, instance: Instance, component: Component,
                     on: dict[str, tuple[str, Place]]) -> None:
        path = prefix + instance.name
        for port in component.ports.values():
            self.ports[f"{path}.{port.name}"] = port
            joined = f"{path}.{port.name}" in on or f"{path}.{port.name}" in self.meant
            if port.count is None and not joined:
                self.problems.add("port-unconnected", f"port '{instance.name}.{port.name}' is on no node",
                                  instance.place, hint=f"Add `{instance.name}.{port.name}` to a node; a free end is "
                                  f"a node of its own: `{instance.name}_{port.name}: [{instance.name}.{port.name}]`.")
        for name, signal in component.signals.items():
            if signal.count is None:  # the elements of a vector are known later
                self.signals[f"{path}.{name}"] = signal
                given = name in instance.settings or f"{path}.{name}" in self.unused
                self._input(instance.name, signal, instance.place, given or f"{path}.{name}" in on
                            or f"{path}.{name}" in self.meant)

    def _input(self, part: str, signal: SignalPort, place: Place, driven: bool) -> None:
        """An input has a value, or is on a node."""
        if signal.direction == "in" and not driven:
            unit = "" if signal.unit.text == "1" or is_generic(signal.unit.dimension) else f" {signal.unit.text}"
            self.problems.add("input-unconnected", f"input '{part}.{signal.name}' has no value", place,
                              hint="Join it to an output on a node, or give it in place: "
                              f"`{signal.name}: 0{unit}`.")

    def arrays(self) -> None:
        """Every element of an array of ports is on a node, and no other. A node of whole arrays is one for each element."""
        self.junctions = {one.path: one for junction in self.junctions.values() for one in self._elements(junction)}
        joined = {end.name: end for junction in self.junctions.values() for end in junction.ends if end.sign > 0}
        self._vectors(joined)
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

    def _vectors(self, joined: dict[str, PortEnd]) -> None:
        """The elements of vectors of signals: each is on a node or given, and no other is named."""
        for path, leaf in self.leaves.items():
            vectors = {name: signal for name, signal in leaf.component.signals.items() if "[" in name}
            if not vectors:
                continue
            self.signals.update({f"{path}.{name}": signal for name, signal in vectors.items()})
            whole = {name.partition("[")[0] for name in vectors}
            for name, signal in vectors.items():
                meant = f"{path}.{name.partition('[')[0]}" in self.meant
                self._input(path, signal, leaf.place, meant or name in leaf.inputs or f"{path}.{name}" in joined)
            for end in joined.values():
                if end.leaf == path and end.port.partition("[")[0] in whole and end.port not in vectors:
                    self.problems.add("port-index", f"'{path}' has the signals {listing(vectors)}; '{end.port}' is none of "
                                      "these", end.place, hint="An index counts from 1.")

    def _elements(self, junction: Junction) -> list[Junction]:
        """The junctions `path[1]`, `path[2]` that a node of whole arrays of ports, of vectors of signals or of parts of them
        is; any other as it is."""
        arrays = {end.name: found for end in junction.ends if (found := self._array(end)) is not None}
        if not arrays:
            return [junction]
        shapes = {name: array_text(found) for name, found in arrays.items()}
        single = next((end for end in junction.ends if end.name not in arrays), None)
        if single is not None or len(set(shapes.values())) > 1:
            name, shape = next(iter(shapes.items()))
            other = f"'{single.name}' is one {'signal' if self._is_signal(single) else 'port'}" if single is not None else \
                next(f"'{n}' is {s}" for n, s in shapes.items() if s != shape)
            self.meant |= {name.partition("[")[0] for name in arrays}
            self.problems.add("array-length", f"node '{junction.path}' joins whole arrays: '{name}' is {shape}, {other}",
                              junction.place, hint="Join arrays of one length, or single elements or parts, such as "
                              f'`"{name.partition("[")[0]}[1]"` and `"{name.partition("[")[0]}[1..2]"`, in quotes.')
            return []
        bases = {end.name: end.port.partition("[")[0] for end in junction.ends}
        return [Junction(f"{junction.path}{index}", tuple(replace(end, port=bases[end.name] + arrays[end.name][index])
                                                          for end in junction.ends), junction.place)
                for index in next(iter(arrays.values()))]

    def _is_signal(self, end: PortEnd) -> bool:
        leaf = self.leaves.get(end.leaf)
        return leaf is not None and leaf.component.signal(end.port) is not None

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
            own = [] if size is None else [f"[{k}]" for k in range(1, size + 1)]
        else:
            own = [name.removeprefix(base) for name in leaf.component.signals if name.startswith(f"{base}[")]
        if not own or (bracket and ".." not in inside):
            return None
        return {index: index for index in own} if not bracket else part_of(own, inside[:-1], leaf.integers)

    def _top_integers(self) -> dict[str, int]:
        found: dict[str, int] = {}
        for name, bound in self.parameters.items():
            if isinstance(bound.value, Value) and (n := whole_number(bound.value.expr, found)) is not None:
                found[name] = n
        return found


def default(parameter: Parameter, path: str) -> Bound | None:
    """What a parameter of the component at `path` is where nothing is given: its default or its neutral value."""
    if parameter.default is not None:
        return Bound(parameter.default, path + ".", parameter.default.place)
    if parameter.neutral is not None:
        neutral = Value(Number(parameter.neutral, None, 0), "neutral", parameter.place, si=True)
        return Bound(neutral, "", parameter.place)
    return None
