"""Checks of a component file independent of any diagram: units agree, and equations and unknowns balance.

The third law, power, is a numerical one (see `heavebond.language.power_law`).
"""

from __future__ import annotations

from collections.abc import Mapping

from heavebond.core.errors import ModelError, Problems, listing, suggest
from heavebond.core.units import ONE, Dimension, declared_unit, dimension_text
from heavebond.language import reading
from heavebond.language.definition import (
    Component,
    Delayed,
    Domain,
    EquationLine,
    Formula,
    Instance,
    Parameter,
    Port,
    SignalPort,
    Variable,
)
from heavebond.language.event_laws import check_events, check_initial
from heavebond.language.lists import indices
from heavebond.text.dimensions import ANY, SECOND, TRUTH, Lookup, check_equation, dimension
from heavebond.text.expression import Binary, Expr, ExpressionProblem, Name, Slice, constant, names
from heavebond.text.shapes import Lengths, Shape, elements, indexed

Domains = Mapping[str, Domain]
MOST = 10_000  # more ports or equations of a kind than this are a mistake
CONSTANTS = {"pi": ONE, "time": SECOND}


class Scope:
    """Dimensions of the names in a component's equations."""

    def __init__(self, component: Component, domains: Domains):
        self.component, self.domains = component, domains
        self.plain: dict[str, Dimension] = dict(CONSTANTS)
        for group in (component.parameters, component.variables, component.signals):
            self.plain.update({name: item.unit.dimension for name, item in group.items()})

    def __call__(self, name: Name) -> Dimension | None:
        """The dimension of a name; None (any) in a component without checks of units."""
        dimension_found = self._dimension(name)
        return dimension_found if self.component.units_checked else ANY

    def _dimension(self, name: Name) -> Dimension:
        words = [part for part in name.parts if isinstance(part, str)]
        if len(words) == 1 and words[0] in self.plain:
            # only lists have indices
            word, = words
            item = self._item(word)
            if (item is None or item.count is None) and len(name.parts) > 1:
                raise ExpressionProblem("list-index", f"'{word}' is not a list; it has no index", name.column, name.length,
                                        f"Write `{word}`, or declare it with `count: n`.")
            return self.plain[word]
        if len(words) == 2 and words[0] in self.component.ports:
            port, member = words
            domain = self.component.ports[port].domain
            if domain.startswith("$"):
                if member in ("effort", "flow"):
                    return ((f"{domain}.{member}", _ONE_POWER),)
            elif self.domains[domain].role(member) in self.domains[domain].members:
                return self.domains[domain].members[self.domains[domain].role(member)].unit.dimension
            members = self._members(port)
            hint = suggest(member, members) or f"A {domain} port has {', '.join(members)}."
            raise ExpressionProblem("member-unknown", f"port '{port}' has no '{member}'", name.column, name.length, hint)
        if "." in name.text and words[0] in self.component.body.instances:
            raise ExpressionProblem("name-inside", f"'{name.text}' lies inside a part of this block", name.column,
                                    name.length, "A block's equations may use its ports and variables only.")
        members = [f"{p}.{m}" for p in self.component.ports for m in self._members(p)]
        known = [*(n for n in self.plain if n not in CONSTANTS), *members, *CONSTANTS]
        hint = suggest(name.text, known) or f"Known here: {listing(known)}."
        raise ExpressionProblem("name-unknown", f"'{name.text}' is not declared in {self.component.name}",
                                name.column, name.length, hint)

    def _item(self, word: str) -> Parameter | Variable | SignalPort | None:
        groups: tuple[Mapping[str, Parameter | Variable | SignalPort], ...] = (
            self.component.parameters, self.component.variables, self.component.signals)
        return next((group[word] for group in groups if word in group), None)

    def length(self, name: Name) -> Shape:
        """The shape of a name's value, computed with every integer parameter at 3; None for a number."""
        word = name.parts[0]
        item = (self.component.ports.get(word) or self._item(word)) if isinstance(word, str) else None
        if item is None or item.count is None:
            return None
        columns = None if isinstance(item, Port) else item.columns
        rows = _integer(item.count, self.component)
        return indexed(rows if columns is None else (rows, _integer(columns, self.component)), name, self._size)

    def _size(self, part: Slice) -> int:
        low, high = (_integer(bound, self.component) for bound in (part.low, part.high))
        return max(1, high - low + 1)

    def _members(self, port: str) -> list[str]:
        domain = self.component.ports[port].domain
        if domain.startswith("$"):
            return ["effort", "flow"]
        return list(self.domains[domain].members)


_ONE_POWER = declared_unit("m").dimension[0][1]


def check(component: Component, domains: Domains) -> None:
    """Check laws 1 and 2 of one component; ModelError with all mistakes."""
    problems = Problems()
    declared_as: dict[str, str] = {"time": "the time", "pi": "a number"}
    groups: tuple[tuple[str, Mapping[str, Port | SignalPort | Parameter | Variable | Instance]], ...] = (
        ("port", component.ports), ("signal", component.signals), ("parameter", component.parameters),
        ("variable", component.variables), ("part", component.body.instances))
    for kind, group in groups:
        for name, item in group.items():
            if name in declared_as:
                problems.add("name-twice", f"'{name}' is both {declared_as[name]} and a {kind}", item.place,
                             hint="Give one of them another name.")
            else:
                declared_as[name] = f"a {kind}"
    _units(component, domains, problems)
    problems.raise_as(ModelError)
    _balance(component, domains, problems)
    problems.raise_as(ModelError)


def _units(component: Component, domains: Domains, problems: Problems) -> None:
    scope = Scope(component, domains)
    by_state = {reset.target.text for state in component.states for reset in state.entry}  # checked with its values
    for line in component.equations:
        lookup = _with_index(scope, line)
        if isinstance(line.tree.left, Name) and line.tree.left.text in by_state:
            continue
        try:
            check_equation(line.tree, lookup)
            Lengths(scope.length, exact=False).equation(line.tree)
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, line.place, problems)
    watt, joule = declared_unit("W").dimension, declared_unit("J").dimension
    energies = ((component.stores, joule, "stores", "an energy in J"),
                (component.dissipates, watt, "dissipates", "a power in W"),
                (component.unbalanced, watt, "unbalanced", "a power in W"),
                (component.travel_time, declared_unit("s").dimension, "travel_time", "a time in s"),
                (component.opens, declared_unit("Pa").dimension, "opens", "a pressure in Pa"))
    for formula, wanted, key, wanted_text in energies:
        if formula is not None:
            _formula(formula, wanted, key, wanted_text, scope, problems)
    for requirement in component.requires:
        _formula(requirement, TRUTH, "requires", "a comparison, as in `x_max > x_min`", scope, problems)
    for name, delayed in component.delayed.items():
        _delayed(component, name, delayed, scope, problems)
    for relation in component.frames:
        # units and lengths of the vectors that relate two frames
        units = {"turn": "1", "spin": "rad/s", "shift": "m", "speed": "m/s"}
        for key, formula, length in relation.formulas:
            wanted = declared_unit(units[key]).dimension
            try:
                vector_dimension, shape = dimension(formula.tree, scope), Lengths(scope.length, exact=False).of(formula.tree)
            except ExpressionProblem as problem:
                reading.add_expression_problem(problem, formula.place, problems)
                continue
            if vector_dimension not in (wanted, None) or shape != length:
                problems.add("frames-vector", f"`{key}:` of '{relation.b}' must be a list of {length} numbers in "
                             f"{units[key]}", formula.place,
                             hint="Write for example `turn: \"turn(n, phi)\"`, a rotation by phi about the axis n."
                             if key == "turn" else f"Write for example `{key}: \"[l, 0, 0]\"`.")
    check_events(component, scope, Lengths(scope.length, exact=False), problems)
    check_initial(component, scope, problems)


def _with_index(scope: Scope, line: EquationLine) -> Lookup:
    if line.each is None:
        return scope
    index = line.each[0]
    return lambda name: ONE if name.text == index else scope(name)


def _formula(formula: Formula, wanted: Dimension, subject: str, wanted_text: str, scope: Scope,
             problems: Problems) -> None:
    try:
        dimension_found = dimension(formula.tree, scope)
        Lengths(scope.length, exact=False).number(formula.tree, f"`{subject}:`")
    except ExpressionProblem as problem:
        reading.add_expression_problem(problem, formula.place, problems)
        return
    generic = dimension_found is not None and any("$" in base for base, _ in dimension_found)
    if dimension_found is not None and dimension_found != wanted and not generic:
        actual = "a comparison" if dimension_found == TRUTH else f"in {dimension_text(dimension_found)}"
        problems.add("units-differ", f"`{subject}:` must be {wanted_text}; this is {actual}", formula.place,
                     hint="Check the factors of the formula." if wanted != TRUTH else "Write a relation of parameters.")


def _delayed(component: Component, name: str, delayed: Delayed, scope: Scope, problems: Problems) -> None:
    """Check that a delayed variable has the unit of its source, a signal or variable, and that the delay is a time that
    depends on parameters only.
    """
    sources: dict[str, SignalPort | Variable] = {**component.signals, **component.unknowns}
    source = sources.get(delayed.of)
    if source is None or source.count is not None or delayed.of == name:
        problems.add("delayed-unknown", f"'{name}' is delayed from '{delayed.of}', which is not another signal or variable "
                     "of this component", delayed.place,
                     hint=suggest(delayed.of, sources) or f"There are {listing(sources)}.")
    elif source.unit.dimension != component.variables[name].unit.dimension:
        problems.add("unit-wrong", f"'{name}' is in {component.variables[name].unit.text}, '{delayed.of}' in "
                     f"{source.unit.text}", delayed.place, hint="Give both the same unit.")
    _formula(delayed.by, SECOND, "by", "a time in s", scope, problems)
    moving = [n for n in names(delayed.by.tree) if n.text not in component.parameters and n.text != "pi"]
    if moving:
        problems.add("delay-varies", f"the delay of '{name}' contains '{moving[0].text}', which is not a parameter",
                     delayed.by.place, hint="A delay is constant during a run: write it as a formula of parameters.")


def _balance(component: Component, domains: Domains, problems: Problems) -> None:
    """Law 2: as many equations as unknowns of the component."""
    inner = {end.path for wire in component.body.wires.values() for end in wire.ends}
    unknowns = []
    for port in component.ports.values():
        if port.name in inner:
            continue
        # an array counts with the smallest number that its file permits
        copies = [""] if port.count is None else [f"[{k + 1}]" for k in range(_integer(port.count, component))]
        through = ("flow",) if port.domain.startswith("$") else domains[port.domain].through
        unknowns += [f"{port.name}{index}.{member}" for index in copies for member in through]
    items: list[SignalPort | Variable] = [
        *(s for s in component.signals.values() if s.direction == "out" and s.name not in inner),
        *(v for v in component.unknowns.values() if v.delayed is None)]
    for item in items:
        unknowns += [item.name] if item.count is None else [
            item.name + index for index in indices(item.count, item.columns, lambda expr: _integer(expr, component))]
    lengths = Lengths(Scope(component, domains).length, exact=False)
    equations = sum(relation.rank for relation in component.frames)
    for line in component.equations:
        repetitions = 1
        if line.each is not None:
            _, low, high = line.each
            repetitions = max(0, _integer(high, component) - _integer(low, component) + 1)
        equations += repetitions * elements(lengths.equation(line.tree))
    if equations == len(unknowns):
        return
    used = {n.text for line in component.equations for side in (line.tree.left, line.tree.right) for n in names(side)}
    unused = [u for u in unknowns if u not in used]
    more = "few" if equations < len(unknowns) else "many"
    notes = [f"unknowns: {listing(unknowns, 30)}"]
    if unused and more == "few":
        notes.append(f"in no equation: {listing(unused, 30)}")
    missing = abs(len(unknowns) - equations)
    missing_text = f"{missing} equation{'s' * (missing > 1)}"
    advice = f"Add {missing_text}" + (f", for example for {unused[0]}" if unused
                                      else "") if more == "few" else f"Remove {missing_text}"
    if component.composite and unused:
        advice = f"Join '{unused[0].partition('.')[0]}' to a node of the block, or write an equation for {unused[0]}"
    problems.add(f"balance-too-{more}", f"{component.name} has {equations} equation{'s' * (equations != 1)} for "
                 f"{len(unknowns)} unknown{'s' * (len(unknowns) != 1)}", component.place, notes=notes,
                 hint=f"{advice}.\nA component has one equation for each through variable of its ports (a force, a flow), "
                 "for each\nsignal output and for each inner variable.")


def _integer(expr: Expr, component: Component) -> int:
    """An array size with every integer parameter at 3, which distinguishes `each i in 2..n` from `1..n`."""
    number = constant(expr)
    if number is not None:
        return int(max(-MOST, min(MOST, number)))
    if isinstance(expr, Binary):
        a, b = _integer(expr.left, component), _integer(expr.right, component)
        return {"+": a + b, "-": a - b, "*": a * b}.get(expr.op, 3)
    return 3
