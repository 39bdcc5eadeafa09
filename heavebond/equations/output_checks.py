"""Checks of outputs and initial values of a diagram: every name exists, and every unit fits."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace

from heavebond.core.errors import Problems, listing, suggest
from heavebond.core.units import ONE, Unit, check_turns, dimension_text, read_unit
from heavebond.equations.resolver import Resolver, Unknown
from heavebond.language import reading
from heavebond.language.definition import Value
from heavebond.language.model import Model
from heavebond.language.values import add_formula_problem, check_dimension, no_name
from heavebond.text.dimensions import TRUTH, dimension
from heavebond.text.expression import ExpressionProblem, constant, names, parse_formula


def check_asked(model: Model, resolver: Resolver, parameters: Iterable[str], held: Container[str], problems: Problems
                ) -> None:
    """Note problems in `show:` and `initial:`; `parameters` are those that may be solved for, `held` the variables that only
    events change."""
    for output in model.show.values():
        try:
            output_dimension = resolver.dimension(output.expr)
        except ExpressionProblem as problem:
            if problem.code == "name-unknown" and output.text == output.name and "." not in output.name:
                example = f"`{output.name}: {{is: spring.F, unit: {output.unit}}}`"
                problem.hint = f"Specify the shown quantity: {example}; {problem.hint}"
            reading.add_expression_problem(problem, output.place, problems)
            continue
        output_dimension = ONE if output_dimension == TRUTH else output_dimension  # a condition is shown as 0 and 1
        if output_dimension is not None and output_dimension != read_unit(output.unit).dimension:
            unit = dimension_text(output_dimension)
            problems.add("unit-wrong", f"output '{output.name}' is in {unit}; it cannot be shown in {output.unit}",
                         output.place, hint=f"Write `unit: {unit}`, or a multiple of it.")
            continue
        if output_dimension is not None and (unit_of_output := resolver.unit(output.expr)) is not None:
            check_turns(output.unit, unit_of_output, f"output '{output.name}'", output.place, problems)
    for condition in model.initial.conditions.values():
        tree = reading.parsed(parse_formula, condition.name, condition.place, problems)
        if tree is None:
            continue
        try:
            wanted = resolver.dimension(tree) or ONE
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, condition.place, problems)
            continue
        if condition.name not in held and not any(name.text in resolver.names for name in names(tree)):
            problems.add("initial-constant", f"'{condition.name}' is constant; an initial value belongs to a variable",
                         condition.place, hint="Set a parameter at its component, or under `set:`.")
            continue
        if condition.name in held and constant(condition.value.expr) is None:
            continue  # the name of a state, or an error of the held variable
        try:
            dimension = resolver.dimension(condition.value.expr)
        except ExpressionProblem as problem:
            add_formula_problem(problem, condition.value, problems)
            continue
        check_dimension(f"initial {condition.name}", condition.value, dimension,
                        Unit(dimension_text(wanted), 1.0, 0.0, wanted), problems)
    known = [p for p in parameters if not p.startswith(("initial.", "scale.", "history."))]
    for name, place in model.initial.solve.items():
        if name not in known:
            message = f"'{name}' is a variable; only a parameter can be solved for" if name in resolver.names else \
                f"there is no parameter '{name}' to solve for"
            problems.add("solve-unknown", message, place, hint=suggest(name, known) or f"Parameters: {listing(known)}.")


def with_nominal_sizes(model: Model, unknowns: Sequence[Unknown], names: Mapping[str, int], problems: Problems
                       ) -> list[Unknown]:
    """The unknowns with the sizes that the diagram states under `nominal:`; unknown names and wrong units are noted as
    problems."""
    sized = list(unknowns)
    for path, setting in model.nominal.items():
        assert isinstance(setting.value, Value)
        if path not in names:
            problems.add("name-unknown", f"nominal: there is no variable '{path}'", setting.place, hint=suggest(path, names)
                         or f"A size belongs to a variable of a part or a node; there are {listing(list(names), 6)}.")
            continue
        unknown, number = sized[names[path]], constant(setting.value.expr)
        assert number is not None
        before = len(problems.found)
        try:
            given_dimension = dimension(setting.value.expr, no_name)
            check_dimension(f"nominal {path}", setting.value, given_dimension, unknown.unit, problems)
        except ExpressionProblem as problem:
            add_formula_problem(problem, setting.value, problems)
        if len(problems.found) == before:
            sized[names[path]] = replace(unknown, nominal=number, usual=unknown.nominal, plausible=replace(
                unknown.plausible, typical=max(unknown.plausible.typical, number)))
    return sized
