"""The parameters of an expanded diagram: numerical values that may be changed, and formulas of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from itertools import chain
from math import inf, isfinite, isinf

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import NAMES_LISTED, ModelError, Place, Problem, Problems, UsageError, listing, suggest
from heavebond.core.units import ONE, Dimension, Range, Unit, dimension_text, is_generic, solved
from heavebond.equations.buffered import Buffered
from heavebond.equations.connect import Network
from heavebond.equations.expanded import Bound, Expanded, Leaf
from heavebond.language.definition import Domain, Parameter, Value
from heavebond.language.incidence import Interval
from heavebond.language.symbols import Context, evaluate, places, stack
from heavebond.language.template import Template
from heavebond.language.values import NOT_FINITE, add_formula_problem, check_bounds, check_dimension
from heavebond.text.dimensions import number_dimension
from heavebond.text.expression import Binary, Call, Expr, ExpressionProblem, Name, Number, children, names
from heavebond.text.shapes import Lengths, gives_lists

Array = NDArray[np.float64]
Origin = Callable[[str], float | None]  # see `TemperatureOrigins.of_name`
MOST_ELEMENTS = 8  # of a list in a message
ROUNDED = 1e-12  # of a value or of its bound: a few rounding errors
MODULATED = "A store whose constant changes takes or gives power: take one with a port for that power, such as an\n" \
    "MCField or an MIField, or write a component with its own `stores:`."


@dataclass(frozen=True)
class FlatParameter:
    """An independent parameter: a number that may be changed without assembling the equations again."""

    name: str
    value: float
    unit: Unit
    place: Place


@dataclass(frozen=True)
class Parameters:
    """Independent parameters with their symbols `p`, and every parameter as an expression in these."""

    independent: tuple[FlatParameter, ...]
    p: ca.SX
    expressions: dict[str, ca.SX]
    units: dict[str, Unit]

    @cached_property
    def places(self) -> dict[int, int]:
        """The index of the symbol of each independent parameter, by its hash."""
        return places(self.p)

    @property
    def numbers(self) -> Array:
        """The values of `p` in SI."""
        return np.array([q.value for q in self.independent])

    def joined(self, more: Iterable[FlatParameter]) -> Parameters:
        """These and further independent parameters."""
        more = list(more)
        symbols = {q.name: ca.SX.sym(q.name) for q in more}
        return Parameters((*self.independent, *more), stack([self.p, *symbols.values()]),
                          {**self.expressions, **symbols},
                          {**self.units, **{q.name: q.unit for q in more}})

    def values(self, wanted: list[str]) -> Array:
        """The numbers of parameters by name."""
        expressions = [self.expressions[name] for name in wanted]
        # most are independent, or mean one that is: the same object
        known = {id(self.expressions[q.name]): q.value for q in self.independent}
        formulas = [e for e in expressions if id(e) not in known]
        numbers = iter(np.array(ca.Function("v", [self.p], [stack(formulas)])(self.numbers)).ravel().tolist())
        return np.array([known[id(e)] if id(e) in known else next(numbers) for e in expressions])


def declared(expanded: Expanded) -> Iterator[tuple[str, Bound, Leaf | None]]:
    """Every parameter by its full path, in the order of the file (whole numbers, which shape a model, left out)."""
    for name, bound in expanded.parameters.items():
        yield name, bound, None
    for path, leaf in expanded.leaves.items():
        for name, bound in leaf.parameters.items():
            if not leaf.component.parameters[name].integer:
                yield f"{path}.{name}", bound, leaf


def narrowed(expanded: Expanded, factor: float) -> Expanded:
    """The opened diagram with every width of a transition (`width` in its component) times a factor."""
    def times(value: Value) -> Value:
        expr = Binary("*", value.expr, Number(factor, None, 0), 0)
        return replace(value, expr=expr, text=f"({value.text}) * {factor:g}")

    leaves = {}
    for path, leaf in expanded.leaves.items():
        scaled = {name: replace(bound, value=times(bound.value)) for name, bound in leaf.parameters.items()
                   if leaf.component.parameters[name].width and isinstance(bound.value, Value)}
        leaves[path] = replace(leaf, parameters={**leaf.parameters, **scaled}) if scaled else leaf
    return replace(expanded, leaves=leaves)


# -- names -----------------------------------------------------------------------------------------------------------
def formula_order(expanded: Expanded) -> list[str]:
    """The parameters given by formulas, each after those that it needs.

    Raises ModelError for names that are not parameters and for circular dependencies of parameters.
    """
    problems = Problems()
    known = {name: bound for name, bound, _ in declared(expanded)}
    needs: dict[str, list[str]] = {}
    named: dict[int, list[Name]] = {}  # the names in a value, by its identity: parts that are alike share theirs
    for name, bound in known.items():
        if isinstance(bound.value, Value) and isinstance(bound.value.expr, Number):
            continue
        try:
            if (value_names := named.get(id(bound.value))) is None:
                assert isinstance(bound.value, Value)
                _refuse_rates(bound.value.expr)
                value_names = named[id(bound.value)] = list(names(bound.value.expr))
            needed = [path for n in value_names if (path := _path(expanded, known, bound, n)) is not None]
        except ExpressionProblem as problem:
            assert isinstance(bound.value, Value)
            leaf = expanded.leaves.get(name.rpartition(".")[0])
            if problem.code == "parameter-varies" and leaf is not None and leaf.component.stores is not None:
                problem.hint = MODULATED
            add_formula_problem(problem, bound.value, problems)
            continue
        if needed:
            needs[name] = needed
    order = _sorted(needs, known, problems)
    problems.raise_as(ModelError)
    return [name for name in order if name in needs]


def _refuse_rates(expr: Expr) -> None:
    if isinstance(expr, Call) and expr.function == "der":
        raise ExpressionProblem("parameter-varies", "a parameter is constant; der() has no meaning in it",
                                expr.column, 3)
    for child in children(expr):
        _refuse_rates(child)


def _path(expanded: Expanded, known: Mapping[str, Bound], bound: Bound, name: Name) -> str | None:
    """The full path of the parameter that `name` means in the formula of `bound`; None for a known constant."""
    if name.text == "pi" or name.text in _integers(expanded, bound.scope):
        return None
    path = bound.scope + name.text
    if path in known:
        return path
    raise _no_parameter(expanded, known, bound.scope, path, name)


def _no_parameter(expanded: Expanded, known: Mapping[str, Bound], scope: str, path: str, name: Name
                  ) -> ExpressionProblem:
    if name.text == "time":
        return ExpressionProblem("parameter-varies", "a parameter is constant; it cannot depend on time", name.column,
                                name.length, "An input of a component may depend on time.")
    owner, _, last = path.rpartition(".")
    leaf = expanded.leaves.get(owner)
    if owner in expanded.junctions or (leaf and last in {**leaf.component.variables, **leaf.component.signals}):
        return ExpressionProblem("parameter-varies", f"'{name.text}' changes during a run; a parameter is constant",
                                name.column, name.length, "Use parameters only.")
    near = [k.removeprefix(scope) for k in known if k.startswith(scope)]
    if not near:
        return ExpressionProblem("name-unknown", f"there is no parameter '{name.text}'", name.column, name.length,
                                f"Declare it: `parameters: {{{name.text}: ...}}`.")
    return ExpressionProblem("name-unknown", f"there is no parameter '{name.text}'", name.column, name.length,
                            suggest(name.text, near) or f"Parameters here: {listing(near)}.")


def _integers(expanded: Expanded, scope: str) -> dict[str, int]:
    leaf = expanded.leaves.get(scope[:-1])
    return leaf.integers if leaf else {}


def _sorted(needs: dict[str, list[str]], known: Mapping[str, Bound], problems: Problems) -> list[str]:
    """Topological order; each circle is reported once and then cut."""
    open_needs = dict(needs)
    while True:
        try:
            return list(TopologicalSorter(open_needs).static_order())
        except CycleError as error:
            circle: list[str] = error.args[1][::-1]  # graphlib lists each before what needs it
            first = min(circle, key=list(known).index)
            at = circle.index(first)
            circle = [*circle[at:-1], *circle[:at + 1]]
            message = "these parameters depend on each other in a circle: " + " needs ".join(circle) \
                if len(circle) > 2 else f"parameter '{first}' depends on itself"
            problems.add("parameter-circle", message, known[first].value.place,
                         hint=f"Give one of them a number, for example `{first.rpartition('.')[2]}: 1 ...`.")
            del open_needs[first]


# -- values ----------------------------------------------------------------------------------------------------------
@dataclass
class _Maker:
    expanded: Expanded
    network: Network
    problems: Problems
    independent: list[FlatParameter] = field(default_factory=list)
    symbols: list[ca.SX] = field(default_factory=list)
    expressions: dict[str, ca.SX] = field(default_factory=dict)
    units: dict[str, Unit] = field(default_factory=dict)
    bad: set[str] = field(default_factory=set)
    # found right before, by what it follows from (`_alike`): units, and values that name no parameter
    checked: dict[Hashable, Unit] = field(default_factory=dict)
    numbers: dict[Hashable, float] = field(default_factory=dict)
    named: dict[int, tuple[str, ...]] = field(default_factory=dict)  # the names in a value, by its identity

    def make(self, name: str, bound: Bound, leaf: Leaf | None) -> None:
        """A symbol if the value is a number, an expression if it is a formula in other parameters."""
        assert isinstance(bound.value, Value)
        needed = self.named.get(id(bound.value))
        if needed is None:
            needed = self.named[id(bound.value)] = tuple(n.text for n in names(bound.value.expr))
        if self.bad and any(bound.scope + text in self.bad for text in needed):
            self.bad.add(name)  # what is wrong is said where it is
            return
        integers = _integers(self.expanded, bound.scope)
        alike = self._alike(name, bound, leaf, needed, integers)
        try:
            unit = self.checked.get(alike) or self._checked(name, bound, leaf, alike)
            number = expr.value if isinstance(expr := bound.value.expr, Number) else self.numbers.get(alike)
            expression = self._value(bound, integers) if number is None else None
        except ExpressionProblem as problem:
            add_formula_problem(problem, bound.value, self.problems)
            self.bad.add(name)
            return
        if expression is not None and expression.is_constant():
            number = float(expression)
            if alike in self.checked and all(text == "pi" or text in integers for text in needed):
                self.numbers[alike] = number
        if number is not None:
            if not isfinite(number):
                self.problems.add("value-not-finite", f"{name} = {bound.value.text.lstrip('= ')} has no finite value",
                                  bound.value.place, hint=NOT_FINITE)
                self.bad.add(name)
                return
            expression = ca.SX.sym(name)
            self.independent.append(FlatParameter(name, number, unit, bound.place))
            self.symbols.append(expression)
        assert expression is not None
        self.expressions[name], self.units[name] = expression, unit

    def _alike(self, name: str, bound: Bound, leaf: Leaf | None, needed: Sequence[str], integers: Mapping[str, int]
               ) -> Hashable:
        """A key of the dependencies of a value's unit, equal for equal parts; None if unknown."""
        if leaf is None or is_generic((unit := leaf.component.parameters[name.rpartition(".")[2]].unit).dimension):
            return None
        key: list[Hashable] = [id(bound.value), id(unit)]
        for text in needed:
            if text == "pi" or text in integers:
                key.append(integers.get(text))
            elif (unit_of_name := self.units.get(bound.scope + text)) is not None:
                key.append((id(unit_of_name),))
            else:
                return None  # a list
        return tuple(key)

    def _checked(self, name: str, bound: Bound, leaf: Leaf | None, alike: Hashable) -> Unit:
        """The unit of a value; a problem, or an ExpressionProblem, if it is another unit or the value is not a number."""
        assert isinstance(bound.value, Value)
        before = len(self.problems.found)
        value = bound.value
        dimension = number_dimension(value.expr, lambda n: self._dimension(bound.scope, n))
        if leaf is None:
            number = dimension or ONE
            counts = value.expr.unit.counts if isinstance(value.expr, Number) and value.expr.unit else ""
            unit = Unit(dimension_text(number), 1.0, 0.0, number, counts)
        else:
            unit = solved_unit(leaf.component.parameters[name.rpartition(".")[2]].unit, leaf, self.expanded, self.network)
            check_dimension(name, value, dimension, unit, self.problems)
        if gives_lists(bound.value.expr):
            Lengths(lambda _: None, exact=True).number(bound.value.expr, "what a formula gives")
        if alike is not None and len(self.problems.found) == before:
            self.checked[alike] = unit
        return unit

    def _value(self, bound: Bound, integers: Mapping[str, int]) -> ca.SX:
        assert isinstance(bound.value, Value)
        expr = bound.value.expr
        if isinstance(expr, Name) and expr.text not in integers and \
                (expression := self.expressions.get(bound.scope + expr.text)) is not None:
            return expression
        return evaluate(expr, Context(lambda text, name: self.expressions[bound.scope + text], _no_rate, integers))

    def _dimension(self, scope: str, name: Name) -> Dimension:
        if name.text == "pi" or name.text in _integers(self.expanded, scope):
            return ONE
        return self.units[scope + name.text].dimension


def _no_rate(expression: ca.SX) -> ca.SX:
    raise AssertionError("rates are refused before a parameter is evaluated")


def make_parameters(expanded: Expanded, network: Network, order: list[str]) -> Parameters:
    """Every parameter as a symbol or an expression; ModelError if units disagree. `order`: see `formula_order`."""
    maker = _Maker(expanded, network, Problems())
    known = {name: (bound, leaf) for name, bound, leaf in declared(expanded)}
    formulas = set(order)
    for name in [*(n for n in known if n not in formulas), *order]:
        maker.make(name, *known[name])
    maker.problems.raise_as(ModelError)
    return Parameters(tuple(maker.independent), stack(maker.symbols), maker.expressions, maker.units)


def solved_unit(unit: Unit, leaf: Leaf, expanded: Expanded, network: Network) -> Unit:
    """The unit of a parameter or variable of a leaf, with `$U` and `$D.effort` put in."""
    if not is_generic(unit.dimension):
        return unit
    values = dict(network.units.get(leaf.path, {}))
    for port, domain_name in network.domains.get(leaf.path, {}).items():
        kind = leaf.component.ports[port].domain
        if kind.startswith("$"):
            domain: Domain = expanded.model.library.domains[domain_name]
            for role, member in (("effort", domain.effort), ("flow", domain.flow)):
                if member:
                    values[f"{kind}.{role}"] = domain.members[member].unit.dimension
    dimension = solved(unit.dimension, values)
    return unit if dimension == unit.dimension else Unit(dimension_text(dimension), 1.0, 0.0, dimension)


def parameter_bounds(expanded: Expanded, parameters: Parameters) -> dict[int, Interval]:
    """The permitted interval of each independent parameter, by the hash of its symbol. If several parameters of components
    have the same independent parameter as their value, it is the intersection of their intervals."""
    bounds: dict[int, Interval] = {}
    for name, parameter, _ in with_declaration(expanded):
        if parameter.low is None and parameter.high is None:
            continue
        symbol = parameters.expressions[name]
        if symbol.is_symbolic():
            low, high = bounds.get(key := symbol.element_hash(), (-inf, inf))
            bounds[key] = (max(low, -inf if parameter.low is None else parameter.low),
                           min(high, inf if parameter.high is None else parameter.high))
    return bounds


def with_declaration(expanded: Expanded) -> Iterator[tuple[str, Parameter, Bound]]:
    """Every parameter of a component by its full path, as it is declared and as it is given."""
    for name, bound, leaf in declared(expanded):
        if leaf is not None:
            yield name, leaf.component.parameters[name.rpartition(".")[2]], bound


def check_values(expanded: Expanded, parameters: Parameters, templates: Mapping[str, Template],
                 changed: Mapping[str, Value] | None = None) -> None:
    """Check bounds and requirements of every parameter at the values given, some of them `changed` from those of the
    diagram; raises ModelError."""
    problems, new = Problems(), changed or {}
    checks = list(with_declaration(expanded))
    for (name, parameter, bound), number in zip(checks, parameters.values([c[0] for c in checks]), strict=True):
        value = new.get(name, bound.value)
        assert isinstance(value, Value)
        check_bounds(name, parameter, float(number), value, problems)
    problems.raise_as(ModelError)
    restricted = [(path, template) for path, template in templates.items() if expanded.leaves[path].component.requires]
    # which requirements of each part are met: one call for all parts of a template, a column for each
    users: dict[Template, list[str]] = {}
    for path, template in restricted:
        users.setdefault(template, []).append(path)
    numbers = parameters.values([f"{path}.{name}" for template, paths in users.items() for path in paths
                                 for name in template.parameters])
    truths_of_part: dict[str, Array] = {}
    for template, paths in users.items():
        part_numbers, numbers = np.split(numbers, [len(paths) * len(template.parameters)])
        truths = np.array(template.requirements(part_numbers.reshape(len(paths), len(template.parameters)).T))
        truths_of_part.update(zip(paths, np.broadcast_to(truths, (len(truths), len(paths))).T, strict=True))
    for path, template in restricted:
        leaf = expanded.leaves[path]
        for formula, truth in zip(leaf.component.requires, truths_of_part[path], strict=True):
            if truth:
                continue
            used = list(dict.fromkeys(n.text for n in names(formula.tree) if n.text in template.parameters))
            lists: dict[str, list[str]] = {}
            for name in leaf.component.parameters:
                if "[" in name and re.search(rf"\b{(base := name.partition('[')[0])}\b", formula.text):
                    lists.setdefault(base, []).append(name)
            texts = {}
            for name, number in zip(every := [*used, *chain(*lists.values())],
                                    parameters.values([f"{path}.{n}" for n in every]), strict=True):
                setting = new.get(f"{path}.{name}", leaf.parameters[name].value)
                texts[name] = setting.text.lstrip("= ") if isinstance(setting, Value) else ""
                if not (isinstance(setting, Value) and isinstance(setting.expr, Number) and not setting.si):
                    texts[name] = f"{number:g} {parameters.units[f'{path}.{name}'].text}"
            values = {n: (texts[n], leaf.component.parameters[n].doc) for n in used}
            for base, elements in lists.items():
                shown = ", ".join([texts[n] for n in elements[:MOST_ELEMENTS]] + ["..."] * (len(elements) > MOST_ELEMENTS))
                values[base] = f"[{shown}]", leaf.component.parameters[elements[0]].doc
            notes = [f"{n} = {text}" + (f"   ({doc})" if doc else "") for n, (text, doc) in values.items()
                     if n.partition("[")[0] not in lists or n in lists]
            problems.add("requirement", f"'{path}' ({leaf.component.name}) requires {formula.text}", leaf.place,
                         notes=notes, hint="Change one of these values.")
    problems.raise_as(ModelError)


@dataclass(frozen=True)
class Limits:
    """The admissible values of the parameters of a diagram. `numbers` maps p (n_p,) in SI to the values that have bounds
    `low` and `high` (n,), and to the truth of each requirement."""

    expanded: Expanded
    parameters: Parameters
    templates: Mapping[str, Template]
    numbers: Buffered
    low: Array
    high: Array

    @classmethod
    def of(cls, expanded: Expanded, parameters: Parameters, templates: Mapping[str, Template]) -> Limits:
        """The limits of a diagram that `check_values` accepts."""
        bounded = [(name, q) for name, q, _ in with_declaration(expanded) if q.low is not None or q.high is not None]
        values = stack(parameters.expressions[name] for name, _ in bounded)
        truths = stack(template.requirements(stack(parameters.expressions[f"{path}.{name}"] for name in template.parameters))
                       for path, template in templates.items() if expanded.leaves[path].component.requires)
        numbers = Buffered(ca.Function("limits", [parameters.p], [ca.densify(values), ca.densify(truths)],
                                       ["p"], ["values", "truths"]))
        # a search may step beyond the end of its range by a rounding error
        rounding = ROUNDED * np.abs(numbers(parameters.numbers)["values"].ravel())
        low = np.array([-inf if q.low is None else q.low for _, q in bounded])
        high = np.array([inf if q.high is None else q.high for _, q in bounded])
        low -= rounding + ROUNDED * np.abs(np.where(np.isinf(low), 0, low))
        high += rounding + ROUNDED * np.abs(np.where(np.isinf(high), 0, high))
        return cls(expanded, parameters, templates, numbers, low, high)

    def bounds(self, name: str) -> Interval:
        """The admissible interval of an independent parameter: the strictest bounds of all parameters with its value."""
        intervals = parameter_bounds(self.expanded, self.parameters)
        return intervals.get(self.parameters.expressions[name].element_hash(), (-inf, inf))

    def check(self, p: Array, changed: Iterable[str]) -> None:
        """ModelError if the values `p`, of which some are `changed` from those of the diagram, are not allowed."""
        values_and_truths = self.numbers(p)
        values, truths = values_and_truths["values"].ravel(), values_and_truths["truths"]
        if ((values >= self.low) & (values <= self.high)).all() and truths.all():
            return
        pairs = zip(self.parameters.independent, p.tolist(), strict=True)
        independent = tuple(replace(q, value=number) for q, number in pairs)
        new, names = {}, set(changed)
        for q in independent:
            if q.name in names:
                text = f"{q.value:.6g} {q.unit.text}".removesuffix(" 1")
                place = Place(f"value of {q.name}", 1, 1, text)
                new[q.name] = Value(Number(q.value, q.unit, 0), text, place)
        check_values(self.expanded, replace(self.parameters, independent=independent), self.templates, new)


def check_range(name: str, wanted: Range, limits: Limits, origin: Origin, place: Place | None = None) -> None:
    """UsageError if a range of the parameter `name` reaches beyond the values that its components allow, or is in a unit
    with an origin although the parameter is a difference of temperatures (`origin` 0)."""
    if wanted.unit.offset and origin(name) == 0:
        ends = " .. ".join(f"{wanted.unit.from_si(end) * wanted.unit.scale:.6g}" for end in (wanted.low, wanted.high))
        raise UsageError([Problem("unit-offset", f"{name} is a difference of temperatures, and its range in "
                                  f"{wanted.unit.text} one of temperatures", place, f"Write '{ends} K'.")])
    low, high = limits.bounds(name)
    rounding = 1e-9 * (wanted.high - wanted.low)  # an end may have been rounded in another unit
    if wanted.low < low - rounding or wanted.high > high + rounding:
        unit = limits.parameters.units[name]
        allowed = f"at least {unit.written(low)}" if isinf(high) else f"at most {unit.written(high)}" if isinf(low) else \
            f"between {unit.written(low)} and {unit.written(high)}"
        raise UsageError([Problem("range-beyond", f"the range of {name}, {wanted.low:g} .. {unit.written(wanted.high)}, "
                                  f"exceeds the allowed range; it must be {allowed}", place, "Give a range inside.")])


def check_ranges(units: Mapping[str, Unit], ranges: Mapping[str, Range], limits: Limits, origin: Origin) -> None:
    """Raise UsageError if a name is not among `units`, or if its range is in another unit or reaches
    beyond the values that are allowed."""
    for name, wanted in ranges.items():
        if name not in units:
            raise UsageError([Problem("free-unknown", f"'{name}' cannot be estimated: it is not a numeric parameter", None,
                                      suggest(name, units) or NAMES_LISTED)])
        if units[name].dimension != wanted.unit.dimension:
            plain = wanted.unit.text == "1"
            unit_phrase = "has no unit" if plain else f"is in {wanted.unit.text}"
            raise UsageError([Problem("unit-missing" if plain else "unit-wrong", f"the range of {name} {unit_phrase}; "
                                      f"{units[name].text} is needed", None,
                                      f"Write '{wanted.low:g} .. {wanted.high:g} {units[name].text}', if that is meant."
                                      if plain else f"Write it in {units[name].text} or in a multiple of it.")])
        check_range(name, wanted, limits, origin)
