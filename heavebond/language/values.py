"""Checks of given values against their declaration: unit, bounds, and the place of an error in a formula."""

from __future__ import annotations

from math import isfinite

from heavebond.core.errors import Problems
from heavebond.core.units import Dimension, Unit, UnitProblem, check_unit, dimension_text
from heavebond.language import reading
from heavebond.language.definition import Parameter, Value
from heavebond.text.expression import ExpressionProblem, Name, Number

NOT_FINITE = "It is too large, divides by 0, or takes a root or logarithm of a negative number."


def check_dimension(name: str, value: Value, actual: Dimension | None, declared: Unit, problems: Problems) -> None:
    """Check that a quantity or formula of dimension `actual` fits the unit `declared` (or is a plain Python number)."""
    if value.si:
        return
    if isinstance(value.expr, Number):
        try:
            check_unit(value.expr.unit, declared, value.expr.value, value.text)
        except UnitProblem as problem:
            problems.add(problem.code, f"{name}: {problem.message}", value.place, hint=problem.hint)
    elif actual is not None and actual != declared.dimension:
        problems.add("unit-wrong", f"{name} must be {_in_unit(declared.text)}; '{value.text.lstrip('= ')}' is "
                     f"{_in_unit(dimension_text(actual))}", value.place,
                     hint="Check the units in the formula; write quantities with their units, as in `2 * 460 L/min`.")


def check_bounds(name: str, parameter: Parameter, number: float, value: Value, problems: Problems) -> None:
    """Check that `number`, in SI, lies within the parameter's `min` and `max`."""
    if isfinite(number) and (parameter.low is None or number >= parameter.low) and \
            (parameter.high is None or number <= parameter.high):
        return
    value_text = value.text.lstrip("= ")
    if not isinstance(value.expr, Number) or value.si:
        value_text = f"{value_text}, that is {number:g} {parameter.unit.text}".removesuffix(" 1") + ","
    if not isfinite(number):
        problems.add("value-not-finite", f"{name} = {value.text.lstrip('= ')} has no finite value", value.place,
                     hint=NOT_FINITE)
    else:
        share = parameter.unit.text == "1" and parameter.high == 1 and not parameter.integer and \
            (parameter.low or 0) <= number / 100 <= 1
        problems.add("parameter-bound", f"{name} = {value_text} is not allowed; it must be {bounds_text(parameter)}",
                     value.place, notes=[f"{parameter.name}: {parameter.doc}"] if parameter.doc else [],
                     hint=f"Write `{number:g} %` for a share." if share else "Give a value in that range.")


def bounds_text(parameter: Parameter) -> str:
    """`at least 0 kg`, `between 0 and 1`."""
    unit = "" if parameter.unit.text == "1" or parameter.integer else f" {parameter.unit.text}"
    if parameter.high is None:
        return f"at least {parameter.low:g}{unit}"
    if parameter.low is None:
        return f"at most {parameter.high:g}{unit}"
    return f"between {parameter.low:g} and {parameter.high:g}{unit}"


def _in_unit(unit: str) -> str:
    return "a number without unit" if unit == "1" else f"in {unit}"


def add_formula_problem(problem: ExpressionProblem, value: Value, problems: Problems) -> None:
    """Report an error in the formula of a value, with the caret at its position."""
    # origin of the columns of the expression: after the `=` of `=a + b`
    skipped = len(value.text) - len(value.text.lstrip("= ")) if value.formula else 0
    reading.add_expression_problem(problem, value.place.moved(skipped, value.place.length - skipped), problems)


def no_name(name: Name) -> Dimension:
    """The dimension of a name in a value that may contain numbers only: ExpressionProblem."""
    raise ExpressionProblem("not-a-quantity", f"'{name.text}' is not a number", name.column, name.length)
