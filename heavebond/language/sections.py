"""Sections of diagrams and records: parameter values, initial conditions, outputs, settings of the run."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from math import inf

from heavebond.core.errors import Place, Problems, listing, suggest
from heavebond.core.presentation import number, readable
from heavebond.core.units import DIMENSIONLESS, declared_unit
from heavebond.language import reading
from heavebond.language.definition import FileInput, Formula, Value
from heavebond.language.state_chart import STATE
from heavebond.language.symbols import uniform
from heavebond.language.values import add_formula_problem, check_dimension, no_name
from heavebond.text.dimensions import dimension
from heavebond.text.expression import Expr, ExpressionProblem, constant, parse_formula
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence, Source

SECOND = declared_unit("s")
STARTS = ("steady", "rest")
FIXED_STEP = ("euler", "rk4", "backward-euler")  # solvers with a fixed step
SOLVERS = ("idas", "cvodes", "rosenbrock", *FIXED_STEP, "auto")


@dataclass(frozen=True)
class Condition:
    """A required value at the start; a guess may change."""

    name: str
    value: Value
    guess: bool
    place: Place


@dataclass(frozen=True)
class Initial:
    """Conditions on the start: a mode (steady, rest or none), conditions and guesses, parameters to solve for."""

    mode: str | None = None
    conditions: dict[str, Condition] = field(default_factory=dict)
    solve: dict[str, Place] = field(default_factory=dict)


@dataclass(frozen=True)
class Clock:
    """The clock of sampled parts with a jitter in s, the length of the interval in which each instant comes late, and the
    probability that a sample is lost; both are pseudorandom, by a seed."""

    name: str
    parts: tuple[tuple[str, Place], ...]
    jitter: float
    lost: float
    seed: int
    place: Place

    def late(self, k: int) -> float:
        """How late the k-th instant comes, in s."""
        return self.jitter * uniform(self.seed, 2 * k + 1)

    def loses(self, k: int) -> bool:
        """Whether the k-th sample is lost."""
        return uniform(self.seed, 2 * k) < self.lost

    @property
    def text(self) -> str:
        """`clock control (a, b): jitter 20 us, 1 % of the samples lost, seed 1`."""
        words = [f"jitter {readable(self.jitter, 's')}"] if self.jitter else []
        words += [f"{number(100 * self.lost)} % of the samples lost"] if self.lost else []
        return f"clock {self.name} ({listing((path for path, _ in self.parts), 6)}): {', '.join(words)}, seed {self.seed}"


@dataclass(frozen=True)
class NamedOutput:
    """A named output: a formula of the diagram's variables and the unit in which it is shown."""

    name: str
    expr: Expr
    text: str
    unit: str
    place: Place


@dataclass(frozen=True)
class Setting:
    """A value set on a dotted path (`cmc.gas.p_0`)."""

    path: str
    value: Value | FileInput
    place: Place


def read_settings(node: Node | None, source: Source, problems: Problems) -> dict[str, Setting]:
    """`set:` of a diagram or a record."""
    entries = reading.mapping(node, "set", problems)
    settings = {}
    for key, item in (entries.items if entries else {}).items():
        assert entries is not None
        path, place = reading.element_path(key), entries.keys[key].place
        if isinstance(item, Mapping) and "values" in item.items:
            settings.update({k: Setting(k, v, place)
                             for k, v in reading.column_values(item, path, source, problems).items()})
        elif isinstance(item, Mapping):
            if (record := reading.file_input(item, source, problems, path)) is not None:
                settings[path] = Setting(path, record, place)
        elif isinstance(item, Sequence):
            settings.update({k: Setting(k, v, place) for k, v in reading.elements(item, path, path, problems).items()})
        elif (value := reading.value(item, path, problems)) is not None:
            settings[path] = Setting(path, value, place)
    return settings


def read_initial(node: Node | None, base: Initial, problems: Problems) -> Initial:
    mode_text = node.text if isinstance(node, Scalar) else ""
    entries = reading.mapping(node, "initial", problems, f"Write `initial: {{start: {mode_text}}}`." if mode_text in STARTS
                              else "")
    if entries is None:
        return base
    mode, conditions, solve = base.mode, dict(base.conditions), dict(base.solve)
    for name, item in entries.items.items():
        key = entries.keys[name]
        if name == "start":
            mode = reading.text(item, "start", problems)
            if mode not in STARTS:
                problems.add("start-unknown", f"'{mode}' is not a mode of `initial:`", item.place,
                             hint=suggest(mode, STARTS) or "Write `start: steady` or `start: rest`.")
        elif name == "solve":
            solve = {word.text: word.place for word in reading.words(item, "solve", problems)}
        elif (condition := _condition(name, item, key, problems)) is not None:
            conditions[condition.name] = condition
    return Initial(mode, conditions, solve)


def read_conditions(node: Node | None, problems: Problems) -> dict[str, Condition]:
    """`initial:` of a record: conditions and guesses only."""
    entries = reading.mapping(node, "initial", problems)
    conditions = {}
    for name, item in (entries.items if entries else {}).items():
        condition = _condition(name, item, entries.keys[name], problems) if entries else None
        if condition is not None:
            conditions[condition.name] = condition
    return conditions


def _condition(name: str, item: Node, key: Scalar, problems: Problems) -> Condition | None:
    name = reading.element_path(name)
    if isinstance(item, Scalar) and item.text.lstrip().startswith("~"):
        content = item.text.strip().removeprefix("~").lstrip()
        skipped = len(item.text) - len(content)
        inner = replace(item, text=content, place=item.place.moved(skipped, len(content)))
        value = reading.value(inner, name, problems)
        return Condition(name, value, True, key.place) if value else None
    if name.endswith(f".{STATE}") and isinstance(item, Scalar) and re.fullmatch(r"[A-Za-z_]\w*", item.text.strip()):
        expr = reading.parsed(parse_formula, item.text.strip(), item.place, problems)  # the name of a state
        return Condition(name, Value(expr, item.text.strip(), item.place), False, key.place) if expr is not None else None
    value = reading.value(item, name, problems)
    return Condition(name, value, False, key.place) if value else None


def read_nominal(node: Node | None, problems: Problems) -> dict[str, Setting]:
    """Read `nominal:` of a diagram: the usual size of variables, a plain quantity above 0 each."""
    nominal_sizes: dict[str, Setting] = {}
    entries = reading.mapping(node, "nominal", problems, "Write `nominal: {coil.i: 1 nA}`.")
    for key, item in (entries.items if entries else {}).items():
        assert entries is not None
        path, place = reading.element_path(key), entries.keys[key].place
        value = reading.value(item, path, problems)
        number = constant(value.expr) if value is not None else None
        if value is None:
            continue
        if value.formula or number is None:
            problems.add("not-a-quantity", f"nominal {path}: '{value.text}' is not a plain quantity", value.place,
                         hint="Write for example `1 nA`; a nominal size is known before any parameter.")
        elif not 0 < number < inf:
            problems.add("nominal-not-positive", f"nominal {path}: '{value.text}' is not above 0, as a size must be",
                         value.place, hint="Write the usual size of the variable, for example `1 nA`.")
        else:
            nominal_sizes[path] = Setting(path, value, place)
    return nominal_sizes


def read_vary(node: Node | None, problems: Problems) -> dict[str, Setting]:
    """Read `vary:` of a diagram: factors, formulas of variables and the time, by which parameters of parts vary."""
    factors: dict[str, Setting] = {}
    entries = reading.mapping(node, "vary", problems, "Write `vary: {spring.c: =1 + 0.2*spring.s/(1 m)}`.")
    for key, item in (entries.items if entries else {}).items():
        assert entries is not None
        path = reading.element_path(key)
        if (value := reading.value(item, path, problems)) is not None:
            factors[path] = Setting(path, value, entries.keys[key].place)
    return factors


def read_show(node: Node | None, problems: Problems) -> dict[str, NamedOutput]:
    listed = [s.text for s in node.items if isinstance(s, Scalar)] if isinstance(node, Sequence) else []
    lines = listing((f"`{re.sub(r'[^0-9A-Za-z_]+', '_', text)}: {{is: {text}, unit: ...}}`" for text in listed), 3)
    entries = reading.mapping(node, "show", problems, f"Write one output a line: {lines}." if listed else "")
    outputs = {}
    for name, item in (entries.items if entries else {}).items():
        key = entries.keys[name] if entries else None
        output_read = shown_as(name, item, key, problems) if key else None
        if output_read is not None:
            outputs[name] = output_read
    return outputs


def shown_as(name: str, item: Node, key: Scalar, problems: Problems, extra: tuple[str, ...] = ()) -> NamedOutput | None:
    """`pull: {is: spring.F, unit: kN}`; without `is` the key itself is the formula."""
    formula_text = item.text if isinstance(item, Scalar) else "spring.F"
    entry = reading.mapping(item, f"'{name}'", problems, f"Write the formula and the unit in which it is shown: "
                            f"`{name}: {{is: {formula_text}, unit: ...}}`.")
    if entry is None:
        return None
    reading.known_keys(entry, ("is", "unit", *extra), f"'{name}'", problems, required=("unit",))
    unit = entry.items.get("unit")
    if isinstance(unit, Scalar):
        reading.unit_text(unit, problems)
    formula = entry.items.get("is")
    written = formula if isinstance(formula, Scalar) else key
    content, place = written.text, written.place.moved(1 if written.quoted else 0, len(written.text))
    content, place = (content[1:], place.moved(1, len(content) - 1)) if content.startswith("=") else (content, place)
    tree = reading.parsed(parse_formula, content, place, problems)
    if tree is None:
        return None
    return NamedOutput(name, tree, content, reading.text(unit, "unit", problems, "1"), place)


@dataclass(frozen=True)
class Plan:
    """The settings of `simulate:`; with `ends`, a condition, `until` is the latest end of a run."""

    begin: Value | None = None
    until: Value | None = None
    every: Value | None = None
    solver: Scalar | None = None
    ends: Formula | None = None
    largest_step: Value | None = None
    step: Value | None = None


def read_clocks(node: Node | None, problems: Problems) -> dict[str, Clock]:
    """`clocks:` of a diagram: jitter and lost samples of the clocks of sampled parts."""
    form, clocks = "`clocks: {control: {parts: [pid], jitter: 20 us, lost: 1 %, seed: 1}}`", dict[str, Clock]()
    entries = reading.mapping(node, "clocks", problems, f"Write {form}.")
    for name, item in (entries.items if entries else {}).items():
        assert entries is not None
        key, entry = entries.keys[name], reading.mapping(item, f"clock '{name}'", problems, f"Write {form}.")
        if entry is None or not reading.identifier(key, "a clock", problems):
            continue
        reading.known_keys(entry, ("parts", "jitter", "lost", "seed"), f"clock '{name}'", problems, ("parts",))
        numbers = {"jitter": 0.0, "lost": 0.0, "seed": 1.0}
        for word in (word for word in numbers if word in entry.items):
            value = reading.value(entry.items[word], word, problems)
            number = constant(value.expr) if value is not None and not value.formula else None
            if value is not None and number is None:
                problems.add("not-a-quantity", f"{word}: '{value.text}' is not a plain quantity", value.place,
                             hint=f"Write for example {form}.")
            elif value is not None and number is not None:
                unit = SECOND if word == "jitter" else DIMENSIONLESS
                check_dimension(word, value, dimension(value.expr, no_name), unit, problems)
                high = {"jitter": inf, "lost": 1.0, "seed": 2.0**31}[word]
                if not 0 <= number < high or (word == "seed" and number % 1):
                    problems.add("clock-number", f"{word}: '{value.text}' is not allowed", value.place, hint={
                        "jitter": "Write a time, for example `20 us`.", "lost": "Write a probability below 1, for example "
                        "`1 %`.", "seed": "Write a whole number that is not negative."}[word])
                numbers[word] = number
        if not {"jitter", "lost"} & entry.items.keys():
            problems.add("clock-regular", f"clock '{name}' has neither jitter nor lost samples", key.place,
                         hint=f"Write for example {form}, or leave the clock out: without an entry a clock is regular.")
        parts = tuple((word.text, word.place) for word in reading.words(entry.items.get("parts"), "parts", problems))
        clocks[name] = Clock(name, parts, numbers["jitter"], numbers["lost"], int(numbers["seed"]), key.place)
    return clocks


def read_plan(node: Node | None, problems: Problems) -> Plan:
    entries = reading.mapping(node, "simulate", problems)
    if entries is None:
        return Plan()
    reading.known_keys(entries, ("from", "until", "every", "solver", "largest_step", "step"), "simulate", problems)
    items, ends = dict(entries.items), None
    if isinstance(until := items.get("until"), Mapping):
        reading.known_keys(until, ("when", "at_most"), "until", problems, ("when", "at_most"))
        ends = _ending(until.items.get("when"), problems)
        del items["until"]
        if (longest := until.items.get("at_most")) is not None:
            items["until"] = longest
    times = {name: reading.value(item, name, problems) for name, item in items.items()
             if name in ("from", "until", "every", "largest_step", "step")}
    for name, value in times.items():
        if value is not None:
            # the times of a run are needed before any parameter is known: plain times, all above 0 except `from`, and
            # `until` with `from`
            number = constant(value.expr)
            if value.formula or number is None:
                problems.add("not-a-quantity", f"{name}: '{value.text}' is not a plain time", value.place,
                             hint="Write for example `60 s` or `8 * 12 s`.")
                continue
            before = len(problems.found)
            try:
                check_dimension(name, value, dimension(value.expr, no_name), SECOND, problems)
            except ExpressionProblem as problem:
                add_formula_problem(problem, value, problems)
            any_sign = name == "from" or (name == "until" and "from" in times)
            if number <= 0 and not any_sign and len(problems.found) == before:
                problems.add("time-not-positive", f"{name}: '{value.text}' is not above 0", value.place,
                             hint="Write for example `60 s`.")
    solver = entries.items.get("solver")
    name = reading.text(solver, "solver", problems)
    if solver is not None and name and name not in SOLVERS:
        problems.add("solver-unknown", f"'{name}' is not a solver", solver.place,
                     hint=suggest(name, SOLVERS) or f"There are {listing(SOLVERS)}.")
    return Plan(times.get("from"), times.get("until"), times.get("every"), solver if isinstance(solver, Scalar) else None,
                ends, times.get("largest_step"), times.get("step"))


def _ending(node: Node | None, problems: Problems) -> Formula | None:
    """The condition at which a run ends, a comparison of signals of the diagram."""
    if node is None:
        return None
    if not isinstance(node, Scalar):
        problems.add("not-text", f"when is {node.kind}; a condition is expected", node.place,
                     hint="Write `until: {when: load.x > 0.5 m, at_most: 10 s}`.")
        return None
    place = node.place.moved(1 if node.quoted else 0, len(node.text))
    tree = reading.parsed(parse_formula, node.text, place, problems)
    return None if tree is None else Formula(tree, node.text, place)


