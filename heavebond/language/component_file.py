"""Reading of component files."""

from __future__ import annotations

import re
from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, field, replace
from typing import TypeVar

from heavebond.core.errors import ModelError, Place, Problems, listing, suggest
from heavebond.core.units import DIMENSIONLESS, ONE, Unit, UnitProblem, check_unit, is_generic
from heavebond.language import reading
from heavebond.language.definition import (
    Approximation,
    Body,
    CircuitRule,
    Component,
    Delayed,
    Domain,
    EquationLine,
    Formula,
    FrameRelation,
    Layout,
    Parameter,
    Port,
    SignalPort,
    Value,
    Variable,
    ViewShape,
)
from heavebond.language.effects import EffectReader, read_meaning, read_search_range, read_typical
from heavebond.language.layout import read_layout
from heavebond.language.state_chart import read_states, written_out
from heavebond.language.values import add_formula_problem, check_bounds, check_dimension
from heavebond.language.view import read_view
from heavebond.language.when import resets, when_entries
from heavebond.text.dimensions import number_dimension
from heavebond.text.expression import (
    Elements,
    Equation,
    Expr,
    ExpressionProblem,
    Name,
    Number,
    constant,
    names,
    parse_equation,
    parse_formula,
    put_in,
)
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence, Source

T = TypeVar("T")
COMPONENT_KEYS = (
    "component", "summary", "restrictions", "source", "ports", "parameters", "variables", "equations", "initial", "when",
    "travel_time", "opens", "components", "nodes", "layout", "stores", "dissipates", "unbalanced", "power", "requires",
    "effect", "domain", "symbol", "sliding", "units", "placeholder", "extends", "set", "approximation", "states", "frames",
    "circuit", "view")
EXTENDING_KEYS = ("component", "extends", "summary", "restrictions", "source", "symbol", "set")
_FRAMES = "Write `frames: {a to b: {turn: \"turn(n, phi)\", shift: \"[l, 0, 0]\"}}`, or `{a: ...}` in the fixed frame."
_EACH = re.compile(r"each\s+([A-Za-z_]\w*)\s+in\s+(.+?)\.\.(.+?):\s*")


def parse_component(source: Source, domains: Dictionary[str, Domain], base: Component | None = None) -> Component:
    """Convert a component file to a value, where `base` is the component that it extends; ModelError with all problems of
    form (the three laws are checked separately)."""
    problems = Problems()
    component = _Parser(source, domains, problems).component() if base is None else extension(source, base, problems)
    problems.raise_as(ModelError)
    return component


@dataclass
class _Parser:
    source: Source
    domains: Dictionary[str, Domain]
    problems: Problems
    ports: Dictionary[str, Port] = field(default_factory=dict)

    def component(self) -> Component:
        root, problems = self.source.root, self.problems
        subject = f"component '{reading.text(root.items.get('component'), 'component', problems)}'"
        reading.known_keys(root, COMPONENT_KEYS, subject, problems, required=("component", "summary"))
        for key in ("extends", "set"):
            if key in root.items:
                problems.add("extends-missing", "`extends:` is not the name of a component" if key == "extends" else
                             "`set:` gives values to a component that this one extends; `extends:` is missing",
                             root.keys[key].place, hint="Write `extends: Fluid`, or give each parameter its `default:`.")
        name = root.items.get("component")
        place = name.place if isinstance(name, Scalar) else root.place
        if isinstance(name, Scalar):
            reading.identifier(name, "a component", problems)
        ports, signals = self._ports(root.items.get("ports"))
        self.ports = ports
        unbalanced, why = self._unbalanced(root.items.get("unbalanced"))
        variables = reading.declarations(root.items.get("variables"), "variables", self._variable, problems)
        parameters = reading.declarations(root.items.get("parameters"), "parameters",
                                          lambda key, entry: self._parameter(key, entry, variables), problems)
        equations = tuple(equation for line in reading.equation_lines(root.items.get("equations"), problems)
                          if (equation := self._equation(*line)) is not None)
        events = when_entries(root.items.get("when"), problems)
        states = read_states(root.items.get("states"), problems)
        if states:
            chart = written_out(states, signals, parameters, {**ports, **variables}, problems)
            variables = {**variables, **{n: v for n, v in chart.variables.items() if n not in variables}}
            equations, events = (*equations, *chart.equations), (*events, *chart.events)
        effects = EffectReader(ports, signals, parameters, variables, problems)
        effects.dormant()
        return Component(
            name=reading.text(name, "component", problems),
            summary=reading.text(root.items.get("summary"), "summary", problems),
            place=place, path=self.source.path, ports=ports, signals=signals,
            parameters=parameters, variables=variables,
            equations=equations, frames=self._frames(root.items.get("frames")),
            initial=resets("initial", root.items.get("initial"), "Write `initial: {z: u}`.", problems),
            when=events,
            body=self._body(root) if "components" in root.items else Body(),
            travel_time=self._formula(root, "travel_time"), opens=self._formula(root, "opens"),
            stores=self._formula(root, "stores"), dissipates=self._formula(root, "dissipates"),
            unbalanced=unbalanced, unbalanced_why=why,
            power=self._power(root.items.get("power")),
            requires=self._requires(root.items.get("requires")),
            restrictions=reading.text(root.items.get("restrictions"), "restrictions", problems),
            source=reading.text(root.items.get("source"), "source", problems),
            symbol=reading.text(root.items.get("symbol"), "symbol", problems),
            effects=effects.effects(root.items.get("effect")),
            sliding=self._sliding(root.items.get("sliding"), parameters, variables),
            placeholder=reading.text(root.items.get("placeholder"), "placeholder", problems),
            units_checked=self._units_checked(root.items.get("units")),
            approximation=self._approximation(root.items.get("approximation"), parameters),
            circuit=self._circuit(root.items.get("circuit"), ports),
            states=states, view=self._view(root.items.get("view")),
        )

    def _view(self, node: Node | None) -> dict[str, ViewShape]:
        """The shapes of a part in an animation without `view:`; their frames are ports."""
        shapes = read_view(node, self.problems, self.source.path.parent)
        frames = [name for name, port in self.ports.items() if port.domain in self.domains
                  and self.domains[port.domain].orientation]
        for shape in shapes.values():
            for point in shape.points.values():
                if point.frame and point.frame not in frames:
                    self.problems.add("view-frame", f"'{point.frame}' is not a port of the domain spatial", point.place,
                                      hint=suggest(point.frame, frames) or f"Ports: {listing(frames) or 'none'}.")
            if shape.spatial is False:
                self.problems.add("view-plane", f"'{shape.name}' is a shape in a plane; a component has shapes in space",
                                  shape.place, hint="Write a port as its place, for example `at: a`.")
        return shapes

    def _approximation(self, node: Node | None, parameters: Dictionary[str, Parameter]) -> Approximation | None:
        entry = reading.mapping(node, "approximation", self.problems, "Write `approximation: {is: PadeDelay, order: m}`.")
        if entry is None:
            return None
        reading.known_keys(entry, ("is", "order"), "approximation", self.problems, ("is", "order"))
        kind, order = (reading.text(entry.items.get(key), key, self.problems) for key in ("is", "order"))
        if order and not (order in parameters and parameters[order].integer):
            self.problems.add("approximation-order", f"`order: {order}` is not a whole number of this component",
                              entry.items["order"].place, hint="Declare it: `m: {integer, min: 0, default: 0}`.")
        return Approximation(kind, order, entry.place)

    def _circuit(self, node: Node | None, ports: Dictionary[str, Port]) -> CircuitRule | None:
        form = "Write `circuit: {port: a, shares: base, excludes: [PlanarBody], advice: Use a SpatialBody.}`."
        entry = reading.mapping(node, "circuit", self.problems, form)
        if entry is None:
            return None
        keys = ("port", "shares", "excludes", "advice")
        reading.known_keys(entry, keys, "circuit", self.problems, keys)
        port, shares, advice = (reading.text(entry.items.get(key), key, self.problems)
                                for key in ("port", "shares", "advice"))
        for key, name in (("port", port), ("shares", shares)):
            if name and name not in ports:
                self.problems.add("circuit-port", f"`{key}: {name}` is not a port of this component", entry.items[key].place,
                                  hint=f"Ports: {', '.join(ports)}.")
        kinds = tuple(word.text for word in reading.words(entry.items.get("excludes"), "excludes", self.problems))
        return CircuitRule(port, shares, kinds, advice)

    def _delayed(self, node: Mapping, key: Scalar) -> Delayed | None:
        """`delayed: {of: u, by: T}`; whether these names have a meaning is checked with the laws of the component."""
        entry = reading.mapping(node.items.get("delayed"), "delayed", self.problems, "Write `delayed: {of: u, by: T}`.")
        if entry is None:
            return None
        reading.known_keys(entry, ("of", "by"), f"delay of '{key.text}'", self.problems, ("of", "by"))
        for other_key in ("held", "start", "physical", "count"):
            if other_key in node.items:
                self.problems.add("delayed-twice", f"'{key.text}' has `delayed:` and `{other_key}:`",
                                  node.keys[other_key].place,
                                  hint="A delayed variable is one number that its source determines; remove the other key.")
        of, by = reading.text(entry.items.get("of"), "of", self.problems), self._formula(entry, "by")
        return None if by is None else Delayed(of, by, entry.place)

    def _units_checked(self, node: Node | None) -> bool:
        word = reading.text(node, "units", self.problems)
        if node is not None and word != "unchecked":
            self.problems.add("units-unknown", f"`units: {word}` has no meaning", node.place,
                              hint="Write `units: unchecked`, or leave the key out: units are checked then.")
        return node is None

    def _sliding(self, node: Node | None, parameters: Dictionary[str, Parameter], variables: Dictionary[str, Variable]
                 ) -> dict[str, float]:
        """Values that are set when the dry friction of a component is linearised in sliding, in SI."""
        entries = reading.mapping(node, "sliding", self.problems, "Write `sliding: {F_c: 0 N}`.")
        values: dict[str, float] = {}
        held = {name: variable for name, variable in variables.items() if variable.held is not None}
        declared: dict[str, Parameter | Variable] = {**parameters, **held}
        for name, item in (entries.items if entries else {}).items():
            if name not in declared:
                self.problems.add("sliding-unknown", f"`sliding`: '{name}' is neither a parameter nor a held variable of "
                                                     "this component", item.place, hint=suggest(name, declared))
                continue
            assert entries is not None
            number = self._bound(entries, name, declared[name].unit, entries.keys[name])
            if number is not None:
                values[name] = number
        return values

    def _power(self, node: Node | None) -> str:
        word = reading.text(node, "power", self.problems)
        if node is not None and word != "source" and not re.match(r"controlled, \w", word):
            self.problems.add("power-unknown", f"`power: {word}` has no meaning", node.place,
                              hint="Write `power: source`, or `power: controlled,` and the reason; remove it if power is "
                                   "balanced.")
        return word

    def _ports(self, node: Node | None) -> tuple[dict[str, Port], dict[str, SignalPort]]:
        ports: dict[str, Port] = {}
        signals: dict[str, SignalPort] = {}
        entries = reading.mapping(node, "ports", self.problems)
        for name, item in (entries.items if entries else {}).items():
            key = entries.keys[name] if entries else None
            if key is None or not reading.identifier(key, "a port", self.problems):
                continue
            if isinstance(item, Scalar):
                self._port(ports, key, item.text, item.place, None)
            elif isinstance(item, Mapping) and "signal" in item.items:
                reading.known_keys(item, ("signal", "unit", "doc", "count", "default"), f"signal '{name}'", self.problems,
                                   ("unit",))
                direction = reading.text(item.items.get("signal"), "signal", self.problems)
                if direction not in ("in", "out"):
                    self.problems.add("signal-direction", f"'{direction}' is not a direction of a signal",
                                      item.items["signal"].place, hint="Write `signal: in` or `signal: out`.")
                unit = reading.unit(item.items.get("unit"), self.problems) or DIMENSIONLESS
                default = item.items.get("default")
                if default is not None and (direction != "in" or "count" in item.items):
                    self.problems.add("signal-default", f"'{name}' cannot have a default", default.place,
                                      hint="A default is the value of a scalar input that is on no node.")
                value = reading.value(default, f"default of {name}", self.problems) if default is not None else None
                if value is not None and not is_generic(unit.dimension):
                    self._bound(item, "default", unit, key)
                signals[name] = SignalPort(key.text, direction, unit, key.place,
                                           reading.text(item.items.get("doc"), "doc", self.problems), *self._shape(item),
                                           default=value)
            elif isinstance(item, Mapping):
                known = ("domain", "doc", "count")
                reading.known_keys(item, known, f"port '{name}'", self.problems, ("domain",))
                domain = item.items.get("domain")
                if domain is not None:
                    self._port(ports, key, reading.text(domain, "domain", self.problems), domain.place, item)
            else:
                self.problems.add("port-bad", f"port '{name}' is {item.kind}", item.place,
                                  hint=f"Write `{name}: translational` or `{name}: {{signal: in, unit: V}}`.")
        return ports, signals

    def _port(self, ports: dict[str, Port], key: Scalar, domain: str, place: Place, entry: Mapping | None) -> None:
        if domain not in self.domains and not domain.startswith("$"):
            self.problems.add("domain-unknown", f"there is no domain '{domain}'", place,
                              hint=suggest(domain, self.domains) or f"Known: {', '.join(self.domains)}.")
            return
        count: Expr | None = None
        doc = ""
        if entry is not None:
            doc = reading.text(entry.items.get("doc"), "doc", self.problems)
            count, columns = self._shape(entry)
            if columns is not None:
                self.problems.add("count-bad", f"port '{key.text}' has one number, its number of ports",
                                  entry.items["count"].place,
                                  hint="Write `count: n`; a matrix is a parameter, a variable or a signal.")
        ports[key.text] = Port(key.text, domain, key.place, doc, count)

    def _shape(self, node: Mapping) -> tuple[Expr | None, Expr | None]:
        """Length of a list, or rows and columns of a matrix, as expressions of whole numbers."""
        count, columns = (*reading.sizes(node, self.problems), None, None)[:2]
        return count, columns

    def _parameter(self, key: Scalar, node: Mapping, variables: Dictionary[str, Variable]) -> Parameter:
        keys = ("unit", "doc", "min", "max", "default", "neutral", "integer", "class", "search_range", "wakes_with", "count",
                "medium", "width", "meaning", "typical", "instant", "interval")
        integer = "integer" in node.items
        reading.known_keys(node, keys, f"parameter '{key.text}'", self.problems, () if integer else ("unit",))
        unit = DIMENSIONLESS if integer else reading.unit(node.items.get("unit"), self.problems)
        default_node = node.items.get("default")
        default: Value | None = None
        if default_node is not None:
            default = reading.value(default_node, f"default of {key.text}", self.problems)
            if default is not None and not default.formula and not (unit and is_generic(unit.dimension)):
                self._bound(node, "default", unit, key)
        bounds = {name: self._bound(node, name, unit, key) for name in ("min", "max", "neutral")}
        count, columns = self._shape(node)
        return Parameter(key.text, unit or DIMENSIONLESS, key.place,
                         reading.text(node.items.get("doc"), "doc", self.problems), bounds["min"], bounds["max"],
                         default, bounds["neutral"], integer, reading.text(node.items.get("class"), "class", self.problems),
                         read_search_range(node.items.get("search_range"), unit or DIMENSIONLESS, variables, key.text,
                                           self.problems),
                         tuple(w.text for w in reading.words(node.items.get("wakes_with"), "wakes_with", self.problems)),
                         count, reading.text(node.items.get("medium"), "medium", self.problems), "width" in node.items,
                         columns, read_meaning(node.items.get("meaning"), self.problems),
                         read_typical(node.items.get("typical"), unit or DIMENSIONLESS, key.text, self.problems),
                         "instant" in node.items, "interval" in node.items)

    def _variable(self, key: Scalar, node: Mapping) -> Variable:
        reading.known_keys(node, ("unit", "doc", "min", "max", "start", "held", "count", "nominal", "physical", "beyond",
                                  "delayed"), f"variable '{key.text}'", self.problems, ("unit",))
        unit = reading.unit(node.items.get("unit"), self.problems)
        bounds = {name: self._bound(node, name, unit, key)
                  for name in ("min", "max", "start", "held", "nominal", "physical")}
        beyond = reading.text(node.items.get("beyond"), "beyond", self.problems)
        if bounds["physical"] is not None and not beyond:
            self.problems.add("beyond-missing", f"'{key.text}' has a physical limit, but no text for a run that passes it",
                              node.keys["physical"].place,
                              hint="Add `beyond:` with a description of that state and the component that models it.")
        if "physical" in node.items and "held" in node.items:
            self.problems.add("held-physical", f"'{key.text}' has `physical:` and `held:`", node.keys["physical"].place,
                              hint="Only variables that equations determine have a physical limit.")
        if bounds["nominal"] is not None and not bounds["nominal"] > 0:
            self.problems.add("nominal-not-positive", f"'nominal' of '{key.text}' is not above 0, as a size must be",
                              node.items["nominal"].place, hint="Write the usual size of the variable.")
        if "start" in node.items and "held" in node.items:
            self.problems.add("held-start", f"'{key.text}' has `start:` and `held:`", node.keys["start"].place,
                              hint="`held:` is its initial value; remove `start:`.")
        count, columns = self._shape(node)
        return Variable(key.text, unit or DIMENSIONLESS, key.place,
                        reading.text(node.items.get("doc"), "doc", self.problems), bounds["min"], bounds["max"],
                        bounds["start"], bounds["held"], count, bounds["nominal"], columns, bounds["physical"], beyond,
                        self._delayed(node, key))

    def _bound(self, node: Mapping, name: str, unit: Unit | None, key: Scalar) -> float | None:
        """A bound or default in SI; the unit may be omitted if the declared one is dimensionless or the value is 0.

        `unit` is None if the declared unit could not be read, which is reported already.
        """
        item = node.items.get(name)
        quantity = reading.value(item, f"{name} of {key.text}", self.problems) if item is not None else None
        if quantity is None:
            return None
        number = constant(quantity.expr)
        if number is None:
            self.problems.add("not-a-quantity", f"{name} of {key.text} must be a plain quantity", quantity.place,
                              hint="Write a number with its unit.")
            return None
        unit_given = quantity.expr.unit if isinstance(quantity.expr, Number) else None
        if unit is None or (is_generic(unit.dimension) and unit_given is None):
            return number
        try:
            if unit.dimension != ONE or unit_given is not None:
                check_unit(unit_given, unit, number, quantity.text)
        except UnitProblem as problem:
            self.problems.add(problem.code, f"{name} of {key.text}: {problem.message}", quantity.place, hint=problem.hint)
        return number

    def _equation(self, content: str, label: str, place: Place) -> EquationLine | None:
        each = None
        head = _EACH.match(content)
        begin = place
        if head:
            low, high = (reading.parsed(lambda t: parse_formula(t, units=False), head.group(k),
                                        place.moved(head.start(k)), self.problems) for k in (2, 3))
            if low is None or high is None:
                return None
            each = (head.group(1), low, high)
            content, begin = content[head.end():], place.moved(head.end())
        tree = reading.parsed(parse_equation, content, begin, self.problems)
        if tree is None:
            return None
        tree = Equation(self._by_members(tree.left), self._by_members(tree.right))
        # columns of the tree count from this place; it covers the whole equation
        return EquationLine(tree, content, label, begin.moved(0, len(content)), each)

    def _body(self, root: Mapping) -> Body:
        """The components and nodes of a block, with their places in its drawing."""
        body = reading.body(root, self.source, self.problems)
        layout = read_layout(root.items.get("layout"), Layout(), self.problems, parts=body.instances, wires=body.wires)
        return replace(body, layout=layout)

    def _formula(self, root: Mapping, key: str) -> Formula | None:
        node = root.items.get(key)
        formula = reading.formula_of(node, key, self.problems) if node is not None else None
        return None if formula is None else replace(formula, tree=self._by_members(formula.tree))

    def _by_members(self, tree: Expr) -> Expr:
        """An expression with the vectors of ports written as lists of their members: `a.F` is [a.F_x, a.F_y, a.F_z]."""
        values: dict[str, Expr] = {}
        for name in names(tree):
            port, _, vector = name.text.rpartition(".")
            domain = self.domains.get(self.ports[port].domain) if port in self.ports else None
            if domain is not None and vector in domain.vectors:
                values[name.text] = Elements(tuple(Name((port, member), name.column, name.length)
                                                   for member in domain.vectors[vector]), name.column)
        return put_in(tree, values) if values else tree

    def _frames(self, node: Node | None) -> tuple[FrameRelation, ...]:
        """`frames: {a to b: {turn: ..., spin: ..., shift: ..., speed: ...}}`, or `{a: ...}`."""
        relations: list[FrameRelation] = []
        entries = reading.mapping(node, "frames", self.problems, _FRAMES)
        for key, item in (entries.items if entries else {}).items():
            assert entries is not None
            words, place = key.split(" to "), entries.keys[key].place
            for word in words:
                domain = self.domains.get(self.ports[word].domain) if word in self.ports else None
                if domain is None or not domain.orientation:
                    self.problems.add("frames-port", f"`frames`: '{word}' is not a port with an orientation", place,
                                      hint=suggest(word, self.ports) or _FRAMES)
            if len(words) > 2:
                self.problems.add("frames-port", f"`frames`: '{key}' names more than two ports", place, hint=_FRAMES)
            entry = reading.mapping(item, f"'{key}'", self.problems, _FRAMES)
            if entry is None:
                continue
            reading.known_keys(entry, ("turn", "spin", "shift", "speed"), f"'{key}'", self.problems)
            for rate, vector in (("spin", "turn"), ("speed", "shift")):
                if rate in entry.items and vector not in entry.items:
                    self.problems.add("frames-alone", f"'{key}' has `{rate}:`, the rate of `{vector}:`, which is missing",
                                      entry.keys[rate].place, hint=_FRAMES)
            turn, spin, shift, speed = (self._formula(entry, word) for word in ("turn", "spin", "shift", "speed"))
            relations.append(FrameRelation(words[0] if len(words) > 1 else "", words[-1], turn, spin, shift, speed, place))
        return tuple(relations)

    def _unbalanced(self, node: Node | None) -> tuple[Formula | None, str]:
        if node is None:
            return None, ""
        entry = reading.mapping(node, "unbalanced", self.problems)
        if entry is None:
            return None, ""
        reading.known_keys(entry, ("power", "why"), "unbalanced", self.problems, ("power", "why"))
        return self._formula(entry, "power"), reading.text(entry.items.get("why"), "why", self.problems)

    def _requires(self, node: Node | None) -> tuple[Formula, ...]:
        """Comparisons; `x[i] < x[i + 1] for i in 1..n - 1` is true if no i violates it."""
        requirements = []
        for word in reading.words(node, "requires", self.problems):
            body, loop, ranges = word.text.partition(" for ")
            counted = f"sum(if_else({body}, 0, 1) for {ranges}) == 0"
            read = reading.formula_of(replace(word, text=counted) if loop else word, "requires", self.problems)
            if read is not None:
                requirements.append(replace(read, text=word.text))
        return tuple(requirements)


# -- files that extend another component --------------------------------------------------------------------------------
def extension(source: Source, base: Component, problems: Problems) -> Component:
    """Read a component file that extends `base`: the same laws with other values, for example from a data sheet. Mistakes
    are added to the problems.

        component: Nitrogen
        extends: Gas
        summary: Nitrogen.
        set: {R: 296.8 J/(kg*K), kappa: 1.4}
    """
    root = source.root
    head = root.items["component"]
    name, place = reading.text(head, "component", problems), head.place
    if isinstance(head, Scalar):
        reading.identifier(head, "a component", problems)
    reading.known_keys(root, EXTENDING_KEYS, f"'{name}', which extends {base.name},", problems, ("component", "summary"))
    # the values under `set:` for parameters, with elements of lists by their names
    entries = reading.mapping(root.items.get("set"), "set", problems, "Write `set: {R: 296.8 J/(kg*K)}`.")
    values: dict[str, Value] = {}
    for key, item in (entries.items if entries else {}).items():
        parameter = base.parameters.get(key)
        if parameter is None:
            assert entries is not None
            problems.add("parameter-unknown", f"{base.name} has no parameter '{key}'", entries.keys[key].place,
                         hint=suggest(key, base.parameters) or f"It has: {listing(base.parameters)}.")
        elif parameter.count is None:
            if (value := reading.value(item, key, problems)) is not None:
                values[key] = value
                # unit and bounds of a value; in a formula also the names, which must be parameters of the component
                if parameter.integer or is_generic(parameter.unit.dimension):
                    continue
                before = len(problems.found)
                try:
                    dimension = None if isinstance(value.expr, Number) else number_dimension(
                        value.expr, lambda n: ONE if n.text == "pi" else _named_parameter(n, base.parameters).unit.dimension)
                except ExpressionProblem as problem:
                    add_formula_problem(problem, value, problems)
                    continue
                check_dimension(key, value, dimension, parameter.unit, problems)
                if len(problems.found) == before and isinstance(value.expr, Number):
                    check_bounds(key, parameter, value.expr.value, value, problems)
        elif isinstance(item, Sequence):
            values.update(reading.elements(item, key, key, problems))
        elif isinstance(item, Mapping):
            values.update(reading.column_values(item, key, source, problems))
        else:
            problems.add("list-number", f"'{key}' of {base.name} is a list", item.place,
                         hint=f"Write `{key}: [..., ...]`, each value with its unit.")
    texts = {key: reading.text(root.items.get(key), key, problems) for key in EXTENDING_KEYS if key != "set"}
    parameters = {key: replace(p, default=values.get(key, p.default)) for key, p in base.parameters.items()}
    # a variation is not a separate law: a diagnosis tries the extended component
    return replace(base, name=name, place=place, path=source.path, parameters=parameters, effects=(),
                   extends=(base.name, *base.extends),
                   values={**base.values, **{key: value for key, value in values.items() if "[" in key}},
                   summary=texts["summary"], restrictions=texts["restrictions"] or base.restrictions,
                   source=texts["source"] or base.source, symbol=texts["symbol"] or base.symbol)


def _named_parameter(name: Name, known: Dictionary[str, Parameter]) -> Parameter:
    word = name.text.partition("[")[0]
    if word not in known:
        raise ExpressionProblem("name-unknown", f"there is no parameter '{name.text}'", name.column, name.length,
                                suggest(name.text, known) or f"Parameters here: {listing(known)}.")
    return known[word]
