"""Conversion of YAML trees with places to values: the checks that all kinds of files share."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeAlias, TypeVar

from heavebond.core.errors import HeavebondError, Place, Problems, listing, nearest, suggest
from heavebond.core.units import (
    AS_QUANTITY,
    Unit,
    UnitProblem,
    check_unit,
    generic_unit,
    is_generic,
    parse_quantity,
    parse_range,
    read_unit,
    without_inner_bracket,
)
from heavebond.language.definition import (
    Body,
    Component,
    End,
    FileInput,
    Formula,
    Instance,
    Parameter,
    SignalPort,
    Value,
    Wire,
)
from heavebond.records.time_axis import TimeAxis
from heavebond.text.expression import KEYWORDS, Equation, Expr, ExpressionProblem, Number, constant, names, parse_formula
from heavebond.text.yaml_source import Mapping, Node, Scalar, Sequence, Source

T = TypeVar("T", Expr, Equation)
D = TypeVar("D")
Declared: TypeAlias = "Callable[[], Parameter | SignalPort | None]"
Kinds: TypeAlias = "Callable[[str], Component | None]"
IDENTIFIER = re.compile(r"[A-Za-z_]\w*")
CAMEL_CASE = re.compile(r"[A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*")
_EQUALS = re.compile(r"(?<![<>=!])=(?!=)")  # not a comparison
_COMMA_IN_INDEX = re.compile(r"\s*,\s*(?=[^\[\]]*\])")
RESERVED = {*KEYWORDS, "time", "pi"}
SWITCHES = {"on": 1, "yes": 1, "true": 1, "off": 0, "no": 0, "false": 0}
FARTHEST = 100  # limit of a place in a drawing, which is laid out on a grid
TURNS = (0, 90, 180, 270)  # degrees
INTERPOLATIONS = ("spline", "linear", "hold")


# possible values of a missing entry, if its name does not suffice
EXAMPLES = {"interpolation": "`interpolation: spline` (for smooth signals), `linear`, or `hold` (for switched signals)",
            "use": "`use: fit`, `use: validate` or `use: test`", "file": "`file: name.csv`",
            "unit": "`unit: ...` with its unit (mm, kN, bar; 1 for a plain number)",
            "column": "`column: name_in_the_file`"}
TIME_EXAMPLE = "`time: {column: time_s, unit: s}`, or `time: {every: 10 ms}` if the rows have a fixed rate and no times"


def known_keys(node: Mapping, allowed: Iterable[str], subject: str, problems: Problems,
               required: Iterable[str] = ()) -> None:
    """Check that every key is known to `subject`, and that no required key is missing."""
    allowed = list(allowed)
    missing_colon = set()
    for name, key in node.keys.items():
        if name not in allowed:
            missing_colon.add(nearest(name, allowed))
            head, bracket, _ = name.partition(" {")
            problems.add("key-unknown", f"{subject} has no entry '{name}'", key.place,
                         hint=(f"A colon is missing: write `{head}: {{...}}`." if bracket and head in allowed else "")
                         or suggest(name, allowed) or f"Known: {', '.join(allowed)}.")
    for name in required:
        if name not in node.items and name not in missing_colon:
            problems.add("key-missing", f"{subject} needs the entry '{name}'", node.place,
                         hint=f"Add {EXAMPLES.get(name, f'`{name}: ...`')}.")


def mapping(node: Node | None, subject: str, problems: Problems, hint: str = "") -> Mapping | None:
    """The node as a mapping; a problem and None if it has another form."""
    if node is None or isinstance(node, Mapping):
        return node
    problems.add("not-a-mapping", f"{subject} is {node.kind}; `key: value` entries are expected", node.place,
                 hint=hint or "Write `{key: value, ...}`, or one `key: value` a line, indented.")
    return None


def declarations(node: Node | None, subject: str, build: Callable[[Scalar, Mapping], D], problems: Problems) -> dict[str, D]:
    """Apply `build` to each declaration `name: {unit: ..., doc: ...}`, by name; malformed declarations are omitted with a
    problem."""
    entries = mapping(node, subject, problems)
    built: dict[str, D] = {}
    for name, item in (entries.items if entries else {}).items():
        key = entries.keys[name] if entries else None
        if key is None or not identifier(key, f"one of the {subject}", problems):
            continue
        entry = mapping(item, f"'{name}'", problems, f"Write `{name}: {{unit: ..., doc: ...}}`.")
        if entry is not None:
            built[name] = build(key, entry)
    return built


def text(node: Node | None, subject: str, problems: Problems, default: str = "") -> str:
    """The node as plain text."""
    if node is None:
        return default
    if isinstance(node, Scalar):
        return " ".join(node.text.split())
    problems.add("not-text", f"{subject} is {node.kind}; text is expected", node.place, hint="Write a plain text.")
    return default


def choice(node: Node | None, subject: str, allowed: tuple[str, ...], problems: Problems) -> str:
    """The node as one of the words allowed; empty if it is absent or, with a problem, another word."""
    word_read = text(node, subject, problems)
    if node is None or not word_read or word_read in allowed:
        return word_read
    problems.add(f"{subject}-unknown", f"`{subject}: {word_read}` is not known", node.place,
                 hint=suggest(word_read, allowed) or "Write " + " or ".join(f"`{subject}: {word}`" for word in allowed)
                 + ".")
    return ""


def words(node: Node | None, subject: str, problems: Problems) -> list[Scalar]:
    """The node as a list of texts; a single text counts as a list."""
    if node is None:
        return []
    items = node.items if isinstance(node, Sequence) else (node,)
    scalars = []
    for item in items:
        if isinstance(item, Scalar):
            scalars.append(item)
        else:
            problems.add("not-text", f"{subject} holds {item.kind}; text is expected", item.place,
                         hint="Write a list of words: `[one, two]`.")
    return scalars


def identifier(key: Scalar, subject: str, problems: Problems) -> bool:
    """True if the key is a name: letters, digits and underscores, and not a keyword of formulas."""
    if not IDENTIFIER.fullmatch(key.text):
        plain = re.sub(r"\W+", "_", key.text).strip("_")
        hint = f" Write for example `{plain}`." if IDENTIFIER.fullmatch(plain) else ""
        problems.add("name-bad", f"'{key.text}' cannot name {subject}", key.place,
                     hint=f"A name has letters, digits and `_`, and begins with a letter.{hint}")
        return False
    if key.text in RESERVED:
        problems.add("name-bad", f"'{key.text}' cannot name {subject}; it has a meaning in formulas", key.place,
                     hint="Take another name.")
        return False
    return True


def parsed(parser: Callable[[str], T], content: str, place: Place, problems: Problems) -> T | None:
    """Run a parser of expressions; its error becomes a problem with the caret at the position."""
    try:
        return parser(content)
    except ExpressionProblem as problem:
        add_expression_problem(problem, place, problems)
    except HeavebondError as error:  # the file of a function that it calls
        problems.extend(error)
    return None


def add_expression_problem(problem: ExpressionProblem, place: Place, problems: Problems) -> None:
    """Report the error of an expression that begins at `place`."""
    problems.add(problem.code, problem.message, place.moved(problem.column, problem.length), hint=problem.hint)


def value(node: Node, subject: str, problems: Problems, declared: Declared | None = None) -> Value | None:
    """Read a quantity (`42 kN/m`), arithmetic of quantities (`2 * 460 L/min`), or a formula (`=m_cart`). `declared` gives
    the declaration of the parameter, if there is one, for a message."""
    if not isinstance(node, Scalar):
        problems.add("not-a-value", f"{subject} is {node.kind}; a quantity is expected", node.place,
                     hint="Write for example `42 kN/m`, or a formula that begins with `=`.")
        return None
    content = node.text.strip()
    start = node.place.moved(1 if node.quoted else 0, len(content))
    if content.startswith("="):
        skipped = len(content) - len(content[1:].lstrip())
        expr = parsed(parse_formula, content[skipped:], start.moved(skipped), problems)
        return Value(expr, content, start, formula=True) if expr is not None else None
    try:
        number, unit = parse_quantity(content)
        return Value(Number(number, unit, 0), content, start)
    except UnitProblem as problem:
        return _arithmetic(content, start, subject, problem, problems, declared)


def seconds(node: Node | None, subject: str, problems: Problems) -> float | None:
    """A time (`72 s`, `2 min`) in s; None if it is absent."""
    read = value(node, subject, problems) if node is not None else None
    number = constant(read.expr) if read is not None else None
    if read is None or number is None:
        return None
    try:
        check_unit(getattr(read.expr, "unit", None), read_unit("s"), number, read.text)
    except UnitProblem as problem:
        problems.add(problem.code, f"{subject}: {problem.message}", read.place, hint=problem.hint)
    return number


def _arithmetic(content: str, place: Place, subject: str, problem: UnitProblem, problems: Problems,
                declared: Declared | None) -> Value | None:
    """Read arithmetic of quantities; if that fails as well, report the problem of the quantity."""
    if (several := _range_of(content)) is not None:
        problems.add("not-a-quantity", f"{subject}: '{content}' is a {several}; one value is expected", place,
                     hint=f"Write one value. A {several} belongs under `free:` of an experiment.")
        return None
    code, message, hint = problem.code, f"{subject}: {problem.message}", problem.hint
    try:
        expr = parse_formula(content)
        used = [n.text for n in names(expr) if n.text != "pi"]
        if problem.code == "not-a-quantity" and not used:
            return Value(expr, content, place)
        if problem.code == "not-a-quantity":
            code, message, hint = _unmarked(content, subject, declared() if declared is not None else None)
    except ExpressionProblem as other:
        if problem.code == "not-a-quantity" and any(sign in content for sign in "+*/()"):
            add_expression_problem(other, place, problems)
            return None
    if hint == AS_QUANTITY:
        hint = f"{_example(subject, declared() if declared is not None else None)}, or a formula that begins with `=`."
    problems.add(code, message, place, hint=hint)
    return None


def _unmarked(content: str, subject: str, parameter: Parameter | SignalPort | None) -> tuple[str, str, str]:
    """Problem for a text of names instead of a quantity: a formula without its `=`, or an unknown word."""
    example = _example(subject, parameter)
    if content.lower() in SWITCHES:
        switch = parameter is None or parameter.unit.text == "1"
        return "not-a-quantity", f"{subject}: '{content}' is a word, not a number", \
            f"Write {SWITCHES[content.lower()]}." if switch else f"{example}."
    if re.fullmatch(r"\w+", content):
        return "formula-unmarked", f"{subject}: '{content}' is not a number with a unit", \
            f"{example}; if '{content}' is a parameter, write `={content}`."
    if (flat := without_inner_bracket(content)) is not None:
        return "unit-unknown", f"{subject}: the bracket in the unit of '{content}' is not at its end", f"Write '{flat}'."
    return "formula-unmarked", f"{subject}: '{content}' is neither a quantity nor a formula", \
        f"A formula begins with `=`: `={content}`."


def _example(subject: str, parameter: Parameter | SignalPort | None) -> str:
    """`Write for example `m: 1 kg` (mass)`, from the declaration of a parameter."""
    if parameter is None or is_generic(parameter.unit.dimension):
        return "Write for example `42 kN/m`"
    unit = "" if parameter.unit.text == "1" else f" {parameter.unit.text}"
    length = None if parameter.count is None or parameter.columns is not None else constant(parameter.count)
    value = f"1{unit}" if length is None else f"[{', '.join([f'1{unit}', *[f'0{unit}']*(int(length) - 1)])}]"
    return f"Write for example `{subject.rpartition('.')[2]}: {value}`" + (f" ({parameter.doc})" if parameter.doc else "")


def _range_of(content: str) -> str | None:
    """`range` or `tolerance` for a text with several values, as in an experiment; else None."""
    try:
        return "range" if parse_range(content).nominal is None else "tolerance"
    except UnitProblem:
        return None


def file_input(node: Mapping, source: Source, problems: Problems, subject: str, *, file: bool = True) -> FileInput | None:
    """Read `{file: heave.csv, column: z, unit: m, interpolation: spline}`; the file name is relative to the folder of the
    source. Without `file`, in an experiment, it may have `noise`, which the caller reads."""
    keys = ["file", "column", "unit", "interpolation", "time", "gaps", "factor", "smooth", *([] if file else ["noise"])]
    if node.items and not any(nearest(name, keys) for name in node.items):
        keyed = f"`{{{listing(node.items)}}}`"
        problems.add("not-a-quantity", f"{subject}: {keyed} is neither a quantity nor an input from a record", node.place,
                     hint="Write a quantity, `42 kN/m`, or a record, `{file: name.csv, column: name, unit: mm, "
                     "interpolation: spline}`. Initial values belong to a separate section of the diagram: "
                     "`initial: {NODE.x: 0 mm}`.")
        return None
    known_keys(node, keys, "an input from a record", problems,
               required=[*(["file"] if file else []), "column", "unit", "interpolation"])
    between = node.items.get("interpolation")
    if isinstance(between, Scalar) and between.text not in INTERPOLATIONS:
        problems.add("between-unknown", f"there is no interpolation '{between.text}'", between.place,
                     hint=suggest(between.text, INTERPOLATIONS) or "Write spline, linear or hold.")
        return None
    unit = node.items.get("unit")
    if isinstance(unit, Scalar):
        unit_text(unit, problems)
    if any(name not in node.items for name in ("column", "unit", "interpolation")):
        return None
    entry = {name: text(item, name, problems) for name, item in node.items.items()
             if name not in ("time", "noise", "smooth", "factor")}
    time_node = node.items.get("time")
    return FileInput(source.path.parent / entry["file"] if "file" in entry else Path(), entry["column"], entry["unit"],
                     entry["interpolation"], node.place,
                     time_axis(time_node, problems) if time_node is not None else None,
                     choice(node.items.get("gaps"), "gaps", ("bridge",), problems) == "bridge",
                     factor=_factor(node.items.get("factor"), problems),
                     smooth=_bandwidth(node.items.get("smooth"), entry["interpolation"], problems))


def _factor(node: Node | None, problems: Problems) -> float:
    """The `factor:` of an input: a number other than 0."""
    read = value(node, "factor", problems) if node is not None else None
    if read is None:
        return 1.0
    number = constant(read.expr)
    if number is None or getattr(read.expr, "unit", None) is not None or not 0 < abs(number) < float("inf"):
        problems.add("factor-not-a-number", f"factor: '{read.text}' is not a number other than 0", read.place,
                     hint="Write for example `factor: -1`; a calibration with a unit is a Gain in the diagram.")
        return 1.0
    return number


def _bandwidth(node: Node | None, interpolation: str, problems: Problems) -> float | None:
    """The `smooth:` of an input in Hz."""
    read = value(node, "smooth", problems) if node is not None else None
    if read is None or node is None:
        return None
    number = constant(read.expr)
    try:
        check_unit(getattr(read.expr, "unit", None), read_unit("Hz"), number or 0.0, read.text)
    except UnitProblem as problem:
        problems.add(problem.code, f"smooth: {problem.message}", read.place, hint="Write for example `smooth: 5 Hz`.")
        return None
    if number is None or not 0 < number < float("inf"):
        problems.add("smooth-not-positive", f"smooth: '{read.text}' is not a frequency above 0", read.place,
                     hint="Write for example `smooth: 5 Hz`.")
        return None
    if interpolation == "hold":
        problems.add("smooth-hold", "an input that is held from sample to sample (`interpolation: hold`) is not smoothed",
                     node.place, hint="Remove `smooth:`, or write `interpolation: spline`.")
        return None
    return number


def time_axis(node: Node, problems: Problems) -> TimeAxis | None:
    """`{column: time_s, unit: s}`, or `{every: 10 ms}` (also `from: 2 s`, the time of the first row) for equal steps."""
    entry = mapping(node, "time", problems, f"Write {TIME_EXAMPLE}.")
    if entry is None:
        return None
    if "every" in entry.items:
        known_keys(entry, ["every", "from"], "a time of equal steps", problems)
        every, start = (seconds(entry.items.get(key), key, problems) for key in ("every", "from"))
        if every is not None and not 0 < every < float("inf"):
            problems.add("step-not-positive", f"every: a step of {every:g} s is not above 0", entry.items["every"].place,
                         hint="Write for example `every: 10 ms`.")
        return TimeAxis(every=every or 1.0, start=start or 0.0)
    if "column" not in entry.items:
        problems.add("key-missing", "time has neither 'column' nor 'every'", entry.place, hint=f"Write {TIME_EXAMPLE}.")
        return None
    known_keys(entry, ["column", "unit"], "time", problems, required=["unit"])
    unit = entry.items.get("unit")
    if isinstance(unit, Scalar):
        unit_text(unit, problems)
    column_name = text(entry.items.get("column"), "column", problems)
    return TimeAxis(column_name, text(unit, "unit", problems, "s")) if column_name else None


def unit_text(node: Scalar, problems: Problems) -> str | None:
    """A unit of input or output (any scale); None and a problem if it is unknown."""
    try:
        read_unit(node.text)
    except UnitProblem as problem:
        problems.add(problem.code, problem.message, node.place, hint=problem.hint)
        return None
    return node.text


def unit(node: Node | None, problems: Problems) -> Unit | None:
    """A declared unit; None, and a problem, if it cannot be read."""
    if not isinstance(node, Scalar):
        return None
    try:
        return generic_unit(node.text)
    except UnitProblem as problem:
        problems.add(problem.code, problem.message, node.place, hint=problem.hint)
        return None


def formula_of(node: Node, subject: str, problems: Problems) -> Formula | None:
    """An expression of a component (names and plain numbers, no units)."""
    if not isinstance(node, Scalar):
        problems.add("not-text", f"{subject} is {node.kind}; a formula is expected", node.place,
                     hint="Write a formula such as `1/2 * c * s**2`.")
        return None
    place = node.place.moved(1 if node.quoted else 0, len(node.text))
    tree = parsed(lambda t: parse_formula(t, units=False), node.text, place, problems)
    return Formula(tree, node.text, place) if tree is not None else None


def sizes(node: Mapping, problems: Problems) -> tuple[Expr | None, ...]:
    """The entries under `count:`, the length of a list or rows and columns of a matrix; empty without an entry."""
    counted = node.items.get("count")
    if counted is None:
        return ()
    entries = counted.items if isinstance(counted, Sequence) else [counted]
    if len(entries) > 2 or not entries or not all(isinstance(size, Scalar) for size in entries):
        problems.add("count-bad", "`count:` is the length of a list, or rows and columns of a matrix", counted.place,
                     hint="Write `count: n` or `count: [n, m]`.")
        return ()
    return tuple(parsed(lambda t: parse_formula(t, units=False), size.text, size.place, problems)
                 for size in entries if isinstance(size, Scalar))


def body(node: Mapping, source: Source, problems: Problems, kinds: Kinds | None = None) -> Body:
    """Read `components:` and `nodes:` of a diagram or a block; `kinds` gives a component by its name, for messages."""
    instances: dict[str, Instance] = {}
    inside: dict[str, Instance] = {}
    parts = mapping(node.items.get("components"), "components", problems,
                    "Write one part a line: `spring: {is: Spring, c: 1 kN/m}`.")
    for name, entry in (parts.items if parts else {}).items():
        key = parts.keys[name] if parts else None
        if key is not None and all(identifier(replace(key, text=part), "a component", problems)
                                   for part in name.split(".")):
            instance_read = instance(key, entry, source, problems, kinds)
            if instance_read:
                (inside if "." in name else instances)[name] = instance_read
    wires: dict[str, Wire] = {}
    nodes = mapping(node.items.get("nodes"), "nodes", problems, "Write one node a line: `ground: [wall.a, spring.a]`.")
    for name, entry in (nodes.items if nodes else {}).items():
        key = nodes.keys[name] if nodes else None
        ends = tuple(End(s.text, s.place) for s in _ports(name, entry, problems))
        if key is not None and all(identifier(replace(key, text=part), "a node", problems) for part in name.split(".")):
            wires[name] = Wire(name, ends, key.place)
    return Body(instances, wires, inside)


def _ports(name: str, node: Node, problems: Problems) -> list[Scalar]:
    """The ports of a node; also those of a text without brackets, with a problem."""
    port_words = words(node, f"node '{name}'", problems)
    if not isinstance(node, Scalar) or len(ports := re.split(r"[\s,;&]+(?:-[\s,;&]+)*", node.text.strip())) < 2:
        return port_words
    problems.add("node-not-a-list", f"node '{name}' is a text; a list of ports is expected", node.place,
                 hint=f"Write `{name}: [{', '.join(ports)}]`.")
    return [Scalar(port, node.place) for port in ports]


def _declared(kinds: Kinds | None, kind: str, name: str) -> Parameter | SignalPort | None:
    """The declaration of a parameter or an input of a component; None if it has none, or cannot be read."""
    try:
        component = kinds(kind) if kinds is not None else None
    except HeavebondError:
        return None
    return None if component is None else component.parameters.get(name) or component.signals.get(name)


def instance(key: Scalar, node: Node, source: Source, problems: Problems, kinds: Kinds | None = None) -> Instance | None:
    """`spring: {is: Spring, c: 1.2 kN/m}`."""
    example = node.text if isinstance(node, Scalar) and IDENTIFIER.fullmatch(node.text) else "Spring"
    entry = mapping(node, f"'{key.text}'", problems, f"Write `{key.text}: {{is: {example}, ...}}`.")
    if entry is None:
        return None
    kind = entry.items.get("is")
    if not isinstance(kind, Scalar):
        kind_words = [s.text for n, s in entry.items.items() if isinstance(s, Scalar)
                      and (n in ("type", "kind", "Is", "IS") or CAMEL_CASE.fullmatch(s.text))]
        guess = kind_words[0] if kind_words else "Spring"
        problems.add("kind-missing", f"'{key.text}' has no `is:`", key.place,
                     hint=f"Write `{key.text}: {{is: {guess}, ...}}`.")
        return None
    settings: dict[str, Value | FileInput] = {}
    at: tuple[float, ...] | None = None
    repeat = None
    data: tuple[tuple[str, Place], ...] = ()
    for name, item in ((element_path(key), entry_value) for key, entry_value in entry.items.items()):
        if name == "is":
            continue
        if name == "at":
            at = _position(item, problems)
        elif name == "repeat":
            repeat = value(item, "repeat", problems)
        elif name == "data":
            data = tuple((word.text, word.place) for word in words(item, "data", problems))
        elif isinstance(item, Mapping) and "values" in item.items:
            settings.update(column_values(item, name, source, problems))
        elif isinstance(item, Mapping) and {*item.items} == {"value", "unit"}:
            size, unit = (text(item.items[word], word, problems) for word in ("value", "unit"))
            problems.add("not-a-quantity", f"{key.text}.{name} is a mapping; write a value and its unit as one "
                         "text", item.place,
                         hint=f"Write `{name}: {size} {unit}`.")
        elif isinstance(item, Mapping):
            read = file_input(item, source, problems, f"{key.text}.{name}")
            if read:
                settings[name] = read
        elif isinstance(item, Sequence):
            settings.update(elements(item, name, f"{key.text}.{name}", problems))
        elif (number := value(item, f"{key.text}.{name}", problems, partial(_declared, kinds, kind.text, name))):
            settings[name] = number
    return Instance(key.text, kind.text, key.place, kind.place, settings, at, repeat, data)


def elements(node: Sequence, name: str, subject: str, problems: Problems) -> dict[str, Value]:
    """Name the values of a list by its elements: `x: [0 mm, 2 mm]` gives x[1] and x[2], and a matrix, a list of rows, `K:
    [[1, 2], [3, 4]]` gives K[1][1] to K[2][2]."""
    values_by_element: dict[str, Value] = {}
    rows = [len(item.items) if isinstance(item, Sequence) else 0 for item in node.items]
    if len(set(rows)) > 1:
        problems.add("matrix-rows", f"the rows of {subject} differ in length" if all(rows) else
                     f"{subject} is a list of values and of lists", node.place,
                     hint="A matrix is a list of its rows, `[[1, 2], [3, 4]]`, all of one length.")
        return values_by_element
    for k, item in enumerate(node.items, 1):
        if isinstance(item, Sequence) and "[" not in name:
            values_by_element.update(elements(item, f"{name}[{k}]", f"{subject}[{k}]", problems))
        elif (number := value(item, f"{subject}[{k}]", problems)) is not None:
            values_by_element[f"{name}[{k}]"] = number
    return values_by_element


def element_path(path: str) -> str:
    """A path with the indices of a matrix in the internal form: `a.K[1, 2]` becomes `a.K[1][2]`."""
    return _COMMA_IN_INDEX.sub("][", path)


def column_values(node: Mapping, name: str, source: Source, problems: Problems) -> dict[str, Value]:
    """Read `{file: curve.csv, values: dp, unit: bar}`: a list from a column of a file; empty cells at its end are
    dropped."""
    from heavebond.records.measurements import column, read_table  # import NumPy only if a file is read

    known_keys(node, ["file", "values", "unit"], "a list from a file", problems, required=["file", "values", "unit"])
    unit, wanted = node.items.get("unit"), node.items["values"]
    if not isinstance(unit, Scalar) or not isinstance(wanted, Scalar) or "file" not in node.items \
            or unit_text(unit, problems) is None:
        return {}
    try:
        file = source.path.parent / text(node.items["file"], "file", problems)
        numbers = column(read_table(file, place=node.items["file"].place), wanted.text, wanted.place)
    except HeavebondError as error:
        problems.extend(error)
        return {}
    scale = read_unit(unit.text)
    return {f"{name}[{k}]": Value(Number(scale.to_si(float(number)), scale, 0), f"{number:g} {unit.text}", wanted.place,
                                  file=file)
            for k, number in enumerate(numbers, 1) if number == number}


def _position(node: Node, problems: Problems) -> tuple[float, ...] | None:
    numbers = [s.text for s in words(node, "at", problems)]
    try:
        place = tuple(float(n) for n in numbers)
    except ValueError:
        place = ()
    if len(place) not in (2, 3):
        problems.add("at-bad", "`at:` holds two numbers, the place in the drawing", node.place,
                     hint="Write for example `at: [3, 1]`.")
        return None
    if len(place) == 3 and place[2] not in TURNS:
        problems.add("at-bad", f"a part cannot be rotated by {numbers[2]} degrees", node.place,
                     hint="The third number of `at:` is 0, 90, 180 or 270, clockwise.")
        return None
    if not all(abs(n) <= FARTHEST for n in place[:2]):  # true for NaN as well
        problems.add("at-bad", f"`at: [{', '.join(numbers)}]` is outside the sheet", node.place,
                     hint=f"Places in a drawing range from -{FARTHEST} to {FARTHEST}; the usual distance of parts is 2.")
        return None
    return place


def equation_lines(node: Node | None, problems: Problems) -> Iterator[tuple[str, str, Place]]:
    """(text, label behind `#`, place) of every equation under `equations:` of a component or a function. An equation
    continues while a bracket is open."""
    if node is None:
        return
    if not isinstance(node, Scalar):
        problems.add("not-text", f"`equations:` holds {node.kind}; text is expected", node.place,
                     hint="Write `equations: |` and one equation a line below it.")
        return
    if node.place.continued and not node.block:
        problems.add("equations-joined", "without `|` YAML makes one line of all equations", node.place,
                     hint="Write `equations: |` and one equation a line below it.")
        return
    for line in _joined_lines(node.lines()):
        content, _, label = line.text.partition("#")
        if content.strip():
            yield content.rstrip(), label.strip(), line.place


def _joined_lines(lines: list[Scalar]) -> list[Scalar]:
    """Join a line with an open parenthesis or bracket to the next one, unless that is a separate equation."""
    joined: list[Scalar] = []
    for line in lines:
        previous = joined[-1] if joined else None
        head, _, comment = previous.text.partition("#") if previous is not None else ("", "", "")
        is_open = head.count("(") > head.count(")") or head.count("[") > head.count("]")
        if previous is not None and is_open and not _EQUALS.search(line.text.partition("#")[0]):
            tail, _, more = line.text.partition("#")
            content = head.rstrip() + " "
            label = comment.strip() or more.strip()
            place = replace(previous.place, continued=(*previous.place.continued, (len(content), line.place)))
            joined[-1] = Scalar(content + tail.strip() + (f"  # {label}" if label else ""), place)
        else:
            joined.append(line)
    return joined
