"""The opened diagram as one flat set of unknowns, parameters and equations, each with its provenance."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import inf

import casadi as ca
import numpy as np

from heavebond import reading
from heavebond.connect import Group, Network, connect, drivers, parameter_dimension, signal_unit
from heavebond.definition import Domain, FileInput, Member, Parameter, Value
from heavebond.dimensions import dimension
from heavebond.errors import ModelError, Place, Problems, listing, suggest
from heavebond.expand import Bound, Expanded, Leaf, expand
from heavebond.expression import Expr, ExpressionProblem, Name, Number, names
from heavebond.incidence import Interval, classify
from heavebond.model import Model
from heavebond.symbols import Context, evaluate, nonsmooth, split, stack
from heavebond.template import LEVELS, Template, template
from heavebond.units import ONE, Dimension, Unit, UnitProblem, check_unit, dimension_text, solved

Entries = list[tuple[int, int]]  # (column, kind); column = level * len(unknowns) + unknown


@dataclass(frozen=True)
class Unknown:
    """One scalar unknown: unit, usual size, bounds and first guess in SI; `role` tells across, position, through,
    own or signal."""

    name: str
    unit: Unit
    nominal: float
    role: str
    place: Place
    doc: str = ""
    low: float = -inf
    high: float = inf
    start: float | None = None
    # a velocity (a mechanical across variable): what `start: rest` sets to zero
    motion: bool = False


@dataclass(frozen=True)
class FlatEquation:
    """Where an equation comes from: the component or node it belongs to, its name, its text, the kink in it."""

    owner: str
    label: str
    text: str
    place: Place
    kink: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class FlatParameter:
    """An independent parameter: a number that may be changed without building anything anew."""

    name: str
    value: float
    unit: Unit
    place: Place


@dataclass(frozen=True)
class KnownInput:
    """A measured signal: symbols for its value and its first three derivatives."""

    name: str
    source: FileInput
    unit: Unit
    symbols: ca.SX


@dataclass(frozen=True)
class Energetics:
    """Power into the ports, rate of the stored energy, dissipation and unbalanced power of one component."""

    owner: str
    power: ca.SX
    stored: ca.SX
    dissipated: ca.SX
    unbalanced: ca.SX
    kind: str
    why: str


@dataclass(frozen=True)
class Flat:
    """Unknowns v_j with derivative symbols `levels[k][j]` = d^k v_j / dt^k, and residuals r_i = 0 in SI."""

    expanded: Expanded
    unknowns: tuple[Unknown, ...]
    levels: tuple[tuple[ca.SX, ...], ...]
    parameters: tuple[FlatParameter, ...]
    p: ca.SX
    time: ca.SX
    rate: ca.SX
    inputs: tuple[KnownInput, ...]
    equations: tuple[FlatEquation, ...]
    residuals: tuple[ca.SX, ...]
    entries: tuple[Entries, ...]
    names: dict[str, int]
    constants: dict[str, ca.SX]
    units: dict[str, Unit] = field(default_factory=dict)
    energetics: tuple[Energetics, ...] = ()
    bounds: dict[int, Interval] = field(default_factory=dict)


def flatten(model: Model, also: Iterable[str] = ()) -> Flat:
    """The flat model; `also` names signals that a caller wants beside those that the diagram names itself."""
    expanded = expand(model)
    builder = _Builder(expanded, connect(expanded))
    return builder.build(tuple(also))


class _Builder:
    def __init__(self, expanded: Expanded, network: Network):
        self.expanded, self.network = expanded, network
        self.domains = expanded.model.library.domains
        self.problems = Problems()
        self.unknowns: list[Unknown] = []
        self.names: dict[str, int] = {}
        self.time, self.rate = ca.SX.sym("time"), ca.SX.sym("time_rate")
        self.parameters: list[FlatParameter] = []
        self.p: list[ca.SX] = []
        self.constants: dict[str, ca.SX] = {}
        self.units: dict[str, Unit] = {}
        self.making: list[str] = []
        self.inputs: list[KnownInput] = []
        self.equations: list[FlatEquation] = []
        self.residuals: list[ca.SX] = []
        self.entries: list[Entries] = []
        self.energetics: list[Energetics] = []
        self.templates: dict[str, Template] = {}
        self.nominal_of: dict[Dimension, float] = {}
        for domain in self.domains.values():
            for member in domain.members.values():
                self.nominal_of.setdefault(member.unit.dimension, member.nominal)

    def build(self, also: tuple[str, ...]) -> Flat:
        self._parameters()
        self.problems.raise_as(ModelError)
        self._make_templates()
        self._make_unknowns(also)
        self.n = len(self.unknowns)
        self.levels = [[ca.SX.sym("d" * k + u.name) for u in self.unknowns] for k in range(LEVELS)]
        self._node_equations()
        for leaf in self.expanded.leaves.values():
            self._leaf_equations(leaf)
        self._given_inputs()
        self.problems.raise_as(ModelError)
        self._check_values()
        self.problems.raise_as(ModelError)
        bounds = {s.element_hash(): (u.low, u.high) for s, u in zip(self.levels[0], self.unknowns, strict=True)}
        bounds.update(self._parameter_bounds())
        return Flat(self.expanded, tuple(self.unknowns), tuple(tuple(level) for level in self.levels),
                    tuple(self.parameters), stack(self.p), self.time, self.rate, tuple(self.inputs),
                    tuple(self.equations), tuple(self.residuals), tuple(self.entries), self.names, self.constants,
                    self.units, tuple(self.energetics), bounds)

    # -- parameters ------------------------------------------------------------------------------------------------
    def _parameters(self) -> None:
        for name, bound in self.expanded.parameters.items():
            self._constant(name, bound, None)
        for path, leaf in self.expanded.leaves.items():
            for name, bound in leaf.parameters.items():
                if not leaf.component.parameters[name].integer:
                    self._constant(f"{path}.{name}", bound, leaf)

    def _constant(self, name: str, bound: Bound, leaf: Leaf | None) -> ca.SX:
        """The SX of a parameter: a symbol where its value is a number, an expression where it is a formula."""
        if name in self.constants:
            return self.constants[name]
        assert isinstance(bound.value, Value)
        if name in self.making:
            self.problems.add("parameter-circle", "these parameters depend on each other: "
                              + " > ".join([*self.making[self.making.index(name):], name]), bound.place)
            return ca.SX(1)
        self.making.append(name)
        unit = self._parameter_unit(name, bound, leaf)
        try:
            found = evaluate(bound.value.expr, Context(self._lookup_constant(bound.scope), lambda e: ca.SX(0),
                                                       self._integers(bound.scope)))
        except ExpressionProblem as problem:
            self._expression_problem(problem, bound.value)
            found = ca.SX(1)
        self.making.pop()
        if found.is_constant():
            symbol = ca.SX.sym(name)
            self.parameters.append(FlatParameter(name, float(found), unit, bound.place))
            self.p.append(symbol)
            found = symbol
        self.constants[name], self.units[name] = found, unit
        return found

    def _integers(self, scope: str) -> dict[str, int]:
        leaf = self.expanded.leaves.get(scope[:-1])
        return leaf.integers if leaf else {}

    def _lookup_constant(self, scope: str) -> Callable[[str, Name], ca.SX]:
        def lookup(text: str, name: Name) -> ca.SX:
            path = scope + text
            if path in self.constants:
                return self.constants[path]
            leaf_path, _, parameter = path.rpartition(".")
            leaf = self.expanded.leaves.get(leaf_path)
            if leaf is not None and parameter in leaf.parameters:
                return self._constant(path, leaf.parameters[parameter], leaf)
            if not leaf_path and parameter in self.expanded.parameters:
                return self._constant(path, self.expanded.parameters[parameter], None)
            known = [*(self.expanded.parameters if not scope else ()),
                     *(self.expanded.leaves[scope[:-1]].parameters if scope[:-1] in self.expanded.leaves else ())]
            raise ExpressionProblem("name-unknown", f"there is no parameter '{text}' here", name.column, name.length,
                                    suggest(text, known) or (f"Known here: {listing(known)}." if known else
                                                             "Declare it under `parameters:`."))
        return lookup

    def _parameter_unit(self, name: str, bound: Bound, leaf: Leaf | None) -> Unit:
        assert isinstance(bound.value, Value)
        value = bound.value
        try:
            found = dimension(value.expr, lambda n: self._dimension_here(bound.scope, n))
        except ExpressionProblem as problem:
            self._expression_problem(problem, value)
            return Unit("1", 1.0, 0.0, ONE)
        if leaf is None:
            own = found or ONE
            if isinstance(value.expr, Number) and value.expr.unit is not None:
                return Unit(dimension_text(own), 1.0, 0.0, own, value.expr.unit.counts)
            return Unit(dimension_text(own), 1.0, 0.0, own)
        parameter = leaf.component.parameters[name.rpartition(".")[2]]
        declared = self._solved_unit(parameter.unit, leaf)
        if not value.si and found != declared.dimension:
            self._unit_mismatch(name, value, found, declared)
        elif isinstance(value.expr, Number) and not value.si:
            self._unit_mismatch(name, value, found, declared)
        return declared

    def _dimension_here(self, scope: str, name: Name) -> Dimension:
        """A generic unit (`$U`) of the parameter's own component is solved before it is compared."""
        found = parameter_dimension(self.expanded, scope + name.text if name.text != "pi" else "pi", name)
        leaf = (scope + name.text).rpartition(".")[0]
        return solved(found, self.network.units.get(leaf, {}))

    def _unit_mismatch(self, name: str, value: Value, found: Dimension | None, declared: Unit) -> None:
        place = value.place
        if isinstance(value.expr, Number):
            try:
                check_unit(value.expr.unit, declared, value.expr.value, value.text)
            except UnitProblem as problem:
                self.problems.add(problem.code, f"{name}: {problem.message}", place, hint=problem.hint)
            return
        if found is not None:
            self.problems.add("unit-wrong", f"{name} is in {declared.text}; '{value.text}' is in "
                              f"{dimension_text(found)}", place)

    def _solved_unit(self, unit: Unit, leaf: Leaf) -> Unit:
        values = dict(self.network.units.get(leaf.path, {}))
        for port, domain_name in self.network.domains.get(leaf.path, {}).items():
            declared = leaf.component.ports[port].domain
            if declared.startswith("$"):
                domain = self.domains[domain_name]
                for role, member in (("effort", domain.effort), ("flow", domain.flow)):
                    if member:
                        values[f"{declared}.{role}"] = domain.members[member].unit.dimension
        found = solved(unit.dimension, values)
        return unit if found == unit.dimension else Unit(dimension_text(found), 1.0, 0.0, found)

    def _expression_problem(self, problem: ExpressionProblem, value: Value) -> None:
        skipped = len(value.text) - len(value.text.lstrip("= ")) if value.formula else 0
        quoted = 1 if value.place.text[value.place.column - 1:value.place.column] in "'\"" else 0
        reading.add_expression_problem(problem, value.place.moved(skipped + quoted), self.problems)

    def _parameter_bounds(self) -> dict[int, Interval]:
        bounds: dict[int, Interval] = {}
        for path, leaf in self.expanded.leaves.items():
            for name, parameter in leaf.component.parameters.items():
                symbol = self.constants.get(f"{path}.{name}")
                if symbol is not None and symbol.is_symbolic():
                    low, high = bounds.get(symbol.element_hash(), (-inf, inf))
                    bounds[symbol.element_hash()] = (max(low, -inf if parameter.low is None else parameter.low),
                                                     min(high, inf if parameter.high is None else parameter.high))
        return bounds

    def _check_values(self) -> None:
        """Bounds and requirements of every parameter at the values given."""
        checks: list[tuple[str, Parameter, Bound]] = [
            (f"{path}.{name}", leaf.component.parameters[name], bound) for path, leaf in self.expanded.leaves.items()
            for name, bound in leaf.parameters.items() if not leaf.component.parameters[name].integer]
        p = stack(self.p)
        numbers = np.array([q.value for q in self.parameters])
        values = ca.Function("v", [p], [stack([self.constants[name] for name, _, _ in checks])])(numbers)
        for (name, parameter, bound), number in zip(checks, np.array(values).ravel(), strict=True):
            if (parameter.low is not None and number < parameter.low) or \
                    (parameter.high is not None and number > parameter.high) or not np.isfinite(number):
                low, high = parameter.low, parameter.high
                allowed = f"at least {low:g}" if high is None else f"at most {high:g}" if low is None \
                    else f"between {low:g} and {high:g}"
                self.problems.add("parameter-bound", f"{name} = {number:g} {parameter.unit.text} must be {allowed}",
                                  bound.place)
        for path, leaf in self.expanded.leaves.items():
            self._check_requirements(path, leaf, p, numbers)

    def _check_requirements(self, path: str, leaf: Leaf, p: ca.SX, numbers: np.ndarray) -> None:
        made = self.templates.get(path)
        if made is None or not leaf.component.requires:
            return
        own = stack([self.constants[f"{path}.{name}"] for name in made.parameters])
        truths = np.array(ca.Function("r", [p], [made.requirements(own)])(numbers)).ravel()
        for formula, truth in zip(leaf.component.requires, truths, strict=True):
            if not truth:
                used = sorted({n.text for n in names(formula.tree)} & set(made.parameters))
                given = ca.Function("g", [p], [stack([self.constants[f"{path}.{n}"] for n in used])])(numbers)
                said = ", ".join(f"{n} = {v:g}" for n, v in zip(used, np.array(given).ravel(), strict=True))
                self.problems.add("requirement", f"'{path}' ({leaf.component.name}) requires {formula.text}; here "
                                  f"{said} (SI)", leaf.place)

    # -- unknowns --------------------------------------------------------------------------------------------------
    def _make_templates(self) -> None:
        for path, leaf in self.expanded.leaves.items():
            inner = {e.path for w in leaf.component.body.wires.values() for e in w.ends}
            if leaf.component.composite and not leaf.component.equations and not leaf.component.variables \
                    and set(leaf.component.ports) | set(leaf.component.signals) <= inner:
                continue
            self.templates[path] = template(leaf.component, self.domains, self.network.domains[path], leaf.integers)

    def _make_unknowns(self, also: tuple[str, ...]) -> None:
        positions = self._positions(also)
        for k, group in enumerate(self.network.groups):
            if group.domain == "signal":
                self._signal_unknown(group)
            elif group.ports:
                self._across_unknowns(group, k in positions)
        for path, leaf in self.expanded.leaves.items():
            for port, domain_name in self.network.domains[path].items():
                self._through_unknowns(path, port, self.domains[domain_name], leaf)
            for name, variable in leaf.component.variables.items():
                unit = self._solved_unit(variable.unit, leaf)
                self._unknown(Unknown(
                    f"{path}.{name}", unit, self._nominal(unit, variable.start), "own", variable.place, variable.doc,
                    -inf if variable.low is None else variable.low, inf if variable.high is None else variable.high,
                    variable.start), ())

    def _nominal(self, unit: Unit, start: float | None) -> float:
        usual = self.nominal_of.get(unit.dimension, 1.0)
        return max(usual, abs(start)) if start else usual

    def _unknown(self, unknown: Unknown, aliases: Iterable[str]) -> None:
        index = len(self.unknowns)
        self.unknowns.append(unknown)
        self.names[unknown.name] = index
        for alias in aliases:
            self.names.setdefault(alias, index)

    def _signal_unknown(self, group: Group) -> None:
        unit = signal_unit(self.expanded, group.ports[0], self.network.units)
        leaf, _, name = group.ports[0].rpartition(".")
        doc = self.expanded.leaves[leaf].component.signals[name].doc
        self._unknown(Unknown(group.name, unit, self._nominal(unit, None), "signal", group.place, doc), group.aliases)

    def _across_unknowns(self, group: Group, position: bool) -> None:
        domain = self.domains[group.domain]
        members = [(m, "across") for m in domain.across]
        if position and domain.position:
            members.append((domain.position, "position"))
        for name, role in members:
            member: Member = domain.members[name]
            low = 0.0 if member.unit.dimension == (("K", 1),) else -inf
            self._unknown(Unknown(f"{group.name}.{name}", member.unit, member.nominal, role, group.place,
                                  member.doc, low, motion=bool(domain.position) and role == "across"),
                          [f"{alias}.{name}" for alias in group.aliases])

    def _through_unknowns(self, path: str, port: str, domain: Domain, leaf: Leaf) -> None:
        made = self.templates.get(path)
        array = leaf.component.ports[port].count is not None and made is not None
        copies = sorted({s.rpartition(".")[0] for s in made.slots if s.startswith(f"{port}[")},
                        key=lambda s: int(s[len(port) + 1:-1])) if array and made else [port]
        for copy in copies:
            for name in domain.through:
                member = domain.members[name]
                self._unknown(Unknown(f"{path}.{copy}.{name}", member.unit, member.nominal, "through", leaf.place,
                                      member.doc), ())

    def _positions(self, also: tuple[str, ...]) -> set[int]:
        """The groups whose position is named by an equation, an input, an initial value, an output or a caller."""
        wanted = {f"{path}.{slot}" for path, made in self.templates.items() for slot in made.slots}
        model = self.expanded.model
        formulas: list[tuple[str, Expr]] = [("", shown.expr) for shown in model.show.values()]
        for leaf in self.expanded.leaves.values():
            formulas += [(b.scope, b.value.expr) for b in leaf.inputs.values() if isinstance(b.value, Value)]
        wanted |= {scope + n.text for scope, expr in formulas for n in names(expr)}
        wanted |= {*model.initial.conditions, *also}
        positions = set()
        for k, group in enumerate(self.network.groups):
            position = self.domains[group.domain].position if group.domain in self.domains else None
            if position and any(f"{alias}.{position}" in wanted for alias in group.aliases):
                positions.add(k)
        return positions

    # -- equations -------------------------------------------------------------------------------------------------
    def _add(self, equation: FlatEquation, residual: ca.SX, entries: Entries) -> None:
        self.equations.append(equation)
        self.residuals.append(residual)
        self.entries.append(entries)

    def _node_equations(self) -> None:
        for junction in self.expanded.junctions.values():
            group = self.network.groups[self.network.group_of["node " + junction.path]]
            if group.domain == "signal" or not junction.ends:
                continue
            domain = self.domains[group.domain]
            for member in domain.through:
                ends = [(e.sign, self.names[f"{e.name}.{member}"]) for e in junction.ends]
                total = sum((sign * self.levels[0][j] for sign, j in ends), ca.SX(0))
                self._add(FlatEquation(junction.path, f"sum of {member} at node '{junction.path}'",
                                       " + ".join(f"{e.name}.{member}" for e in junction.ends) + " = 0",
                                       junction.place), total, [(j, 0) for _, j in ends])
        for group in self.network.groups:
            position = self.domains[group.domain].position if group.domain in self.domains else None
            if position and f"{group.name}.{position}" in self.names:
                x, v = self.names[f"{group.name}.{position}"], self.names[f"{group.name}.{self.domains[group.domain].flow}"]
                flow = self.domains[group.domain].flow
                self._add(FlatEquation(group.name, f"{flow} is the rate of {position} at node '{group.name}'",
                                       f"{group.name}.{flow} = der({group.name}.{position})", group.place),
                          self.levels[0][v] - self.levels[1][x], [(v, 0), (len(self.unknowns) + x, 0)])

    def _leaf_equations(self, leaf: Leaf) -> None:
        made = self.templates.get(leaf.path)
        if made is None:
            return
        columns = [self.names[f"{leaf.path}.{slot}"] for slot in made.slots]
        arguments = [stack([level[j] for j in columns]) for level in self.levels]
        parameters = stack([self.constants[f"{leaf.path}.{name}"] for name in made.parameters])
        inputs = [*arguments, parameters, self.time, self.rate]
        residuals = split(made.residuals(*inputs)) if made.lines else []
        size = len(columns)
        for line, residual, row in zip(made.lines, residuals, made.entries, strict=True):
            entries = [((e.column // size) * self.n + columns[e.column % size], e.kind) for e in row]
            self._add(FlatEquation(leaf.path, line.label, line.text, line.place, line.kink), residual, _merged(entries))
        if not leaf.component.composite:
            energy = ca.vertsplit(made.energy(*inputs))
            self.energetics.append(Energetics(leaf.path, *energy, leaf.component.power,
                                              leaf.component.unbalanced_why))

    def _given_inputs(self) -> None:
        for group in self.network.groups:
            if group.domain != "signal":
                continue
            for path, bound in drivers(self.expanded, group)[1]:
                column = self.names[path]
                if isinstance(bound.value, FileInput):
                    known = self._known_input(group.name, path, bound.value)
                    self._add(FlatEquation(path.rpartition(".")[0], f"{path} as measured",
                                           f"{path} = {bound.value.column}", bound.place),
                              self.levels[0][column] - known.symbols[0], [(column, 0)])
                else:
                    self._formula_input(path, column, bound)

    def _known_input(self, name: str, path: str, given: FileInput) -> KnownInput:
        unit = self.unknowns[self.names[path]].unit
        symbols = stack([ca.SX.sym("d" * k + "measured " + name) for k in range(4)])
        known = KnownInput(path, given, unit, symbols)
        self.inputs.append(known)
        return known

    def _formula_input(self, path: str, column: int, bound: Bound) -> None:
        assert isinstance(bound.value, Value)
        value, unit = bound.value, self.unknowns[column].unit
        resolver = Resolver(self.names, self.constants, self.units, tuple(self.unknowns),
                            tuple(tuple(level) for level in self.levels), self.time, self.rate)
        try:
            found = resolver.dimension(value.expr, bound.scope)
            expression = resolver.evaluate(value.expr, bound.scope)
        except ExpressionProblem as problem:
            self._expression_problem(problem, value)
            return
        if not value.si and (isinstance(value.expr, Number) or found not in (None, unit.dimension)):
            self._unit_mismatch(path, value, found, unit)
        residual = self.levels[0][column] - expression
        everything = stack([s for level in self.levels for s in level])
        row = classify(residual, everything, {s.element_hash() for s in self.p}, {})[0]
        kink = nonsmooth(value.expr, lambda text: text == "pi" or bound.scope + text in self.constants)
        self._add(FlatEquation(path.rpartition(".")[0], f"{path} as given", f"{path} = {value.text.lstrip('= ')}",
                               value.place, kink), residual, [(e.column, e.kind) for e in row])


def _merged(entries: Entries) -> Entries:
    """One entry per column (two ports of a component may be on one node), the harder kind kept."""
    kinds: dict[int, int] = {}
    for column, kind in entries:
        # two unit coefficients may cancel or add up; what they give is found when the equation is solved
        kinds[column] = kind if column not in kinds else max(kinds[column], kind, 4)
    return list(kinds.items())


@dataclass(frozen=True)
class Resolver:
    """Names of a diagram to SX and units: for formulas in place, outputs, conditions and costs."""

    names: dict[str, int]
    constants: dict[str, ca.SX]
    units: dict[str, Unit]
    unknowns: tuple[Unknown, ...]
    levels: tuple[tuple[ca.SX, ...], ...]
    time: ca.SX
    rate: ca.SX

    def evaluate(self, expr: Expr, scope: str = "") -> ca.SX:
        """The SX of a formula; ExpressionProblem for an unknown name."""
        return evaluate(expr, Context(lambda text, name: self._value(scope, text, name), self._der))

    def dimension(self, expr: Expr, scope: str = "") -> Dimension | None:
        """The dimension of a formula; ExpressionProblem where its units disagree."""
        return dimension(expr, lambda name: self._dimension(scope, name))

    def _value(self, scope: str, text: str, name: Name) -> ca.SX:
        if text == "time":
            return self.time
        path = scope + text
        if path in self.names:
            return self.levels[0][self.names[path]]
        if path in self.constants:
            return self.constants[path]
        raise self._unknown(path, name)

    def _dimension(self, scope: str, name: Name) -> Dimension:
        path = scope + name.text
        if name.text in ("time", "pi"):
            return (("s", 1),) if name.text == "time" else ONE  # type: ignore[return-value]
        if path in self.names:
            return self.unknowns[self.names[path]].unit.dimension
        if path in self.units:
            return self.units[path].dimension
        raise self._unknown(path, name)

    def _unknown(self, path: str, name: Name) -> ExpressionProblem:
        hint = suggest(path, [*self.names, *self.constants]) or "`heavebond check` lists the names of a diagram."
        return ExpressionProblem("name-unknown", f"nothing here is called '{name.text}'", name.column, name.length,
                                 hint)

    def _der(self, expression: ca.SX) -> ca.SX:
        low = stack([s for level in self.levels[:-1] for s in level])
        high = stack([s for level in self.levels[1:] for s in level])
        return ca.jtimes(expression, low, high) + ca.jtimes(expression, self.time, self.rate)
