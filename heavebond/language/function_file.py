"""Reading of function files: a law that several components share and call by its name in their equations.

    function: oil_with_air
    inputs:    {p: {unit: Pa, doc: ...}, ...}
    constants: {w: {unit: Pa, value: 10 kPa, doc: ...}}
    outputs:   {k: {unit: 1/Pa, doc: ...}}
    equations: |
      r = ...      # a local name for later lines
      k = ...      # an output

An external function has a program in place of `equations`:

    function: pump_map
    is: external
    file: pump.c           # .c, a shared library, or .py
    call: flow             # the function in the file, by default the name of the function
    signature: values      # or 20-sim
    derivatives: slopes    # a function of the same file; without it differences, with `nominal` of each input

Every line defines one name, from inputs, constants and the names of the lines above it. Units are checked as in a
component. An input or output with `count: n` is a list, with `count: [n, m]` a matrix; the lengths are the lengths of a
call's arguments.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from heavebond.core.errors import ModelError, Place, Problems, listing, suggest
from heavebond.core.units import DIMENSIONLESS, ONE, Dimension, UnitProblem, check_unit, dimension_text
from heavebond.language import reading
from heavebond.language.external_functions import FORMS, SIGNATURES
from heavebond.text.dimensions import ANY, number_dimension
from heavebond.text.expression import (
    FUNCTIONS,
    Call,
    Expr,
    ExpressionProblem,
    External,
    Function,
    Name,
    Number,
    Quantity,
    Step,
    children,
    constant,
    names,
    parse_equation,
)
from heavebond.text.shapes import check_steps, whole_number
from heavebond.text.yaml_source import Mapping, Node, Scalar, Source

FUNCTION_KEYS = ("function", "summary", "restrictions", "source", "inputs", "outputs", "constants", "equations")
EXTERNAL_KEYS = ("function", "is", "summary", "restrictions", "source", "file", "call", "signature", "derivatives", "inputs",
                 "outputs")
# a function is a relation between numbers: it has no derivative, no time and no jump that would need an event
REFUSED = {"der": "a function relates values at one instant", "floor": "it jumps without an event that stops the integrator"}
ELEMENTS = ("Write a formula of whole lists (`y = x[2..n] - x[1..n - 1]`) or the elements in brackets (`y = [a, b]`,\n"
            "`K = [[a, b], [c, d]]`), or let the function give one element by its indices, and write\n"
            "`each i in 1..n: y[i] = f(i, ...)` in the component, where `y` has `count: n`.")
SNAKE_CASE = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


def parse_function(source: Source, allow_native: bool = False) -> Function:
    """Convert a function file to a value; the program of an external function may be executed with `allow_native` only.
    ModelError with all mistakes in its form, names and units."""
    return _Parser(source, allowed=allow_native).function()


@dataclass
class _Parser:
    source: Source
    problems: Problems = field(default_factory=Problems)
    allowed: bool = False

    def function(self) -> Function:
        root, problems = self.source.root, self.problems
        head = root.items.get("function")
        name = reading.text(head, "function", problems)
        external = "is" in root.items
        reading.known_keys(root, EXTERNAL_KEYS if external else FUNCTION_KEYS, f"function '{name}'", problems,
                           required=("function", "summary", "inputs", "outputs", "file" if external else "equations"))
        if isinstance(head, Scalar):
            if head.text in FUNCTIONS:
                self.problems.add("name-bad", f"'{head.text}' cannot name a function; the language has one of that name",
                                  head.place, hint="Take another name.")
            elif reading.identifier(head, "a function", self.problems) and not SNAKE_CASE.fullmatch(head.text):
                self.problems.add("name-bad", f"'{head.text}' cannot name a function", head.place,
                                  hint="The name of a function has small letters, digits and `_`, as in `oil_with_air`.")
        inputs, outputs, constants = (
            reading.declarations(root.items.get(key), key, partial(
                self._quantity, valued=key == "constants", argument=external and key == "inputs",
                sized=external and key == "inputs" and "derivatives" not in root.items), problems)
            for key in ("inputs", "outputs", "constants"))
        place = head.place if isinstance(head, Scalar) else root.place
        function_read = Function(name, reading.text(root.items.get("summary"), "summary", problems), place, self.source.path,
                                 inputs, outputs, constants,
                                () if external else self._steps(root.items.get("equations")),
                                 reading.text(root.items.get("restrictions"), "restrictions", problems),
                                 reading.text(root.items.get("source"), "source", problems),
                                self._external(root, name) if external else None)
        for key, group in (("inputs", inputs), ("outputs", outputs)):
            if key in root.items and not group:
                problems.add("function-empty", f"function '{name}' has no {key}", root.items[key].place,
                             hint=f"Write `{key}: {{x: {{unit: ..., doc: ...}}}}`.")
        problems.raise_as(ModelError)
        _Checker(function_read, problems).check()
        problems.raise_as(ModelError)
        return function_read

    def _external(self, root: Mapping, name: str) -> External | None:
        """The program of an external function; problems are collected."""
        problems, items = self.problems, root.items
        reading.choice(items.get("is"), "is", ("external",), problems)
        file = reading.text(items.get("file"), "file", problems)
        place = items["file"].place if "file" in items else root.place
        suffix = Path(file).suffix.lower()
        if suffix == ".fmu":
            problems.add("external-fmu", f"'{file}' is an FMU, which has states and is not a function", place,
                         hint=f"Use it as a part of the diagram: `is: {file}`.")
        elif file and suffix not in FORMS:
            problems.add("external-file", f"'{file}' is neither C, a shared library nor Python", place,
                         hint=f"A file of an external function ends in {', '.join(FORMS)}.")
        call = reading.text(items.get("call"), "call", problems) or name
        slopes = reading.text(items.get("derivatives"), "derivatives", problems)
        for key, text in (("call", call), ("derivatives", slopes)):
            if text and not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", text):
                problems.add("name-bad", f"'{text}' cannot be the name of a function in a program",
                             (items.get(key) or root).place, hint="Write letters, digits and `_`.")
        signature = reading.choice(items.get("signature"), "signature", SIGNATURES, problems) or SIGNATURES[0]
        if suffix == ".py" and signature != SIGNATURES[0]:
            problems.add("external-signature", "a Python function takes its arguments one by one", items["signature"].place,
                         hint="Remove `signature:`.")
        return External((self.source.path.parent / file).absolute(), call, signature, slopes, self.allowed)

    def _quantity(self, key: Scalar, entry: Mapping, valued: bool, argument: bool, sized: bool) -> Quantity:
        """A constant (`valued`), or an input or output; an `argument` of a program may have a nominal size, or needs it
        (`sized`)."""
        number_key = "value" if valued else "nominal"
        needed = ("unit", number_key) if valued or sized else ("unit",)
        optional = ("doc",) if valued else ("doc", "count", *(("nominal",) if argument and not sized else ()))
        reading.known_keys(entry, (*needed, *optional), f"'{key.text}'", self.problems, needed)
        unit = reading.unit(entry.items.get("unit"), self.problems) or DIMENSIONLESS
        number_read = None
        if number_key in entry.items and (valued or argument):
            value = reading.value(entry.items[number_key], f"{number_key} of {key.text}", self.problems)
            number_read = constant(value.expr) if value is not None else None
            if value is not None and number_read is None:
                self.problems.add("not-a-quantity", f"{number_key} of {key.text} must be a plain quantity", value.place,
                                  hint="Write a number with its unit.")
            if value is not None and number_read is not None:
                try:
                    check_unit(value.expr.unit if isinstance(value.expr, Number) else None, unit, number_read, value.text)
                except UnitProblem as problem:
                    self.problems.add(problem.code, f"{number_key} of {key.text}: {problem.message}", value.place,
                                      hint=problem.hint)
            if argument and number_read is not None and not number_read > 0:
                self.problems.add("value-out-of-range", f"the nominal size of {key.text} must be above zero",
                                  entry.items[number_key].place, hint="Write a usual size of it, as in `nominal: 100 bar`.")
        return Quantity(key.text, unit, key.place, reading.text(entry.items.get("doc"), "doc", self.problems), number_read,
                        tuple(e for e in reading.sizes(entry, self.problems) if e is not None))

    def _steps(self, node: Node | None) -> tuple[Step, ...]:
        steps = []
        for content, label, place in reading.equation_lines(node, self.problems):
            if re.match(r"each\s", content) or re.match(r"\w+\s*\[[^=]*=(?!=)", content):
                self.problems.add("function-left", "a line of a function gives a whole list or matrix, not its elements",
                                  place, hint=ELEMENTS)
                continue
            tree = reading.parsed(parse_equation, content, place, self.problems)
            if tree is None:
                continue
            if not isinstance(tree.left, Name) or len(tree.left.parts) > 1:
                self.problems.add("function-left", "the left side of a line of a function is one name", place,
                                  hint="Write `name = formula`: a function is evaluated line by line.")
                continue
            steps.append(Step(tree.left.text, tree.right, content, label, place))
        return tuple(steps)


@dataclass
class _Checker:
    """Names and units of a function, line by line."""

    function: Function
    problems: Problems
    units: dict[str, Dimension | None] = field(default_factory=dict)

    def check(self) -> None:
        function = self.function
        declared_in: dict[str, str] = {}
        for section, group in (("inputs", self.function.inputs), ("constants", self.function.constants),
                               ("outputs", self.function.outputs)):
            for name, quantity in group.items():
                if name in declared_in:
                    self._add("name-twice", f"'{name}' is declared under {declared_in[name]} and under {section}",
                              quantity.place,
                              "Give one of them another name.")
                declared_in[name] = section
        self._check_lengths()
        self.units = {"pi": ONE, **dict.fromkeys(function.lengths, ONE)}
        self.units |= {q.name: q.unit.dimension for group in (function.inputs, function.constants)
                       for q in group.values()}
        for step in function.steps:
            if step.name in self.units:
                declared_as = "an input" if step.name in self.function.inputs else \
                    "a constant" if step.name in self.function.constants else "given by a line above"
                self._add("function-given-twice", f"'{step.name}' is {declared_as} already", step.place,
                          "Take another name.")
                continue
            dimension_found: Dimension | None = ANY
            try:
                _refuse(step.expr)
                dimension_found = number_dimension(step.expr, self._dimension)
            except ExpressionProblem as problem:
                reading.add_expression_problem(problem, step.place, self.problems)
            declared = self.function.outputs.get(step.name)
            if declared is not None and dimension_found is not ANY and dimension_found != declared.unit.dimension:
                self._add("units-differ", f"output {step.name} must be in {dimension_text(declared.unit.dimension)}; this "
                          f"is in {dimension_text(dimension_found)}", step.place,
                          "Both sides of an equation have the same unit.")
            self.units[step.name] = declared.unit.dimension if declared is not None else dimension_found
        if not self.problems.found:
            self._check_shapes()
        if function.external is not None:
            return
        step_names = {step.name for step in function.steps}
        for output in function.outputs.values():
            if output.name not in step_names:
                self._add("function-output", f"no line gives the output '{output.name}'", output.place,
                          f"Add `{output.name} = ...` under `equations:`.")
        used = {name.base for step in function.steps for name in names(step.expr)}
        for step in function.steps:
            if step.name not in used and step.name not in function.outputs:
                self._add("function-unused", f"'{step.name}' is not used and is not an output", step.place,
                          "Remove the line, or declare the name under `outputs:`.")

    def _check_lengths(self) -> None:
        """Check that the length of an input is a new name or a whole number, and that the length of an output follows
        from these.
        """
        function, known = self.function, set(self.function.lengths)
        for quantity in (*function.inputs.values(), *function.outputs.values()):
            entry = quantity.name in function.inputs
            for size in quantity.sizes:
                inside = {name.text for name in names(size)}
                if (entry and not isinstance(size, (Name, Number))) or whole_number(size, dict.fromkeys(known, 2)) is None:
                    unknown = "" if entry else listing(sorted(inside - known))
                    cause = f"depends on {unknown}, which no input determines" if unknown else "is a name or a whole number"
                    self._add("count-bad", f"the length of '{quantity.name}' {cause}", quantity.place,
                              f"Known: {listing(sorted(known))}." if unknown and known else "Write `count: n` or "
                              "`count: 3`.")
        for name in known & {*function.inputs, *function.outputs, *function.constants}:
            self._add("name-twice", f"'{name}' is a length and an input, output or constant", function.place,
                      "Give one of them another name.")

    def _check_shapes(self) -> None:
        """Determine which names are numbers, lists and matrices; whole numbers may differ in each call."""
        for step in self.function.steps:
            for name in names(step.expr):
                place = step.place.moved(name.column, name.length)
                if name.base != name.text and not self._listed(name.base):
                    self._add("list-index", f"'{name.base}' is a number, it has no elements", place,
                              f"Declare it with `count: n`: `{name.base}: {{unit: ..., count: n, doc: ...}}`.")
        if not self.problems.found:
            try:
                check_steps(self.function, {}, 0, exact=False)
            except ExpressionProblem as problem:
                self._add(problem.code, problem.message, self.function.place, problem.hint)

    def _listed(self, name: str) -> bool:
        quantity = self.function.inputs.get(name)
        return bool(quantity.sizes) if quantity is not None else name not in self.function.constants

    def _dimension(self, name: Name) -> Dimension | None:
        """The dimension of a name in a line, which must be given above the line."""
        if name.base in self.units:
            return self.units[name.base]
        later = any(line.name == name.text for line in self.function.steps)
        hint = f"Move the line of '{name.text}' above this one." if later else \
            suggest(name.text, self.units) or f"Known here: {listing(self.units)}."
        raise ExpressionProblem("name-unknown", f"'{name.text}' is not given in {self.function.name}"
                                + (" before it is used" if later else ""), name.column, name.length, hint)

    def _add(self, code: str, message: str, place: Place, hint: str) -> None:
        self.problems.add(code, message, place, hint=hint)


def _refuse(expr: Expr) -> None:
    """Refuse derivatives and jumps inside a function."""
    if isinstance(expr, Call) and expr.function in REFUSED:
        raise ExpressionProblem("function-refused", f"{expr.function}() is not permitted in a function: "
                                f"{REFUSED[expr.function]}", expr.column, len(expr.function),
                                "Write it in the component, and pass its value.")
    for child in children(expr):
        _refuse(child)
