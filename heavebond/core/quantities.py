"""Quantities as arguments of Python functions: a number in SI, or text with a unit (`"300 kg"`, `"30 .. 70 kN/m"`)."""

from __future__ import annotations

from collections.abc import Mapping

from heavebond.core.errors import Problem, UsageError
from heavebond.core.units import AS_QUANTITY, Range, UnitProblem, check_unit, parse_quantity, parse_range, read_unit


def si_value(value: float | str, unit: str, subject: str) -> float:
    """A quantity in SI; the text must have the dimension of `unit`.

    Raises UsageError that begins with `subject` for a text without its unit, with a unit of another dimension, or that is
    not a quantity, and for a value of another type.
    """
    value = number_or_text(value, unit, subject)
    if not isinstance(value, str):
        return value
    try:
        number, read = parse_quantity(value)
        check_unit(read, read_unit(unit), number, value)
    except UnitProblem as problem:
        example = "Write a number, for example `0.5`." if unit == "1" else f"Write for example `1 {unit}`."
        hint = example if problem.hint == AS_QUANTITY else problem.hint
        raise UsageError([Problem(problem.code, f"{subject}: {problem.message}", None, hint)]) from None
    return number


def number_or_text(value: object, unit: str, subject: str) -> float | str:
    """A number, or the text of a quantity; a quantity of pint, or a signal of one value, as its text. UsageError that begins
    with `subject` for any other type, such as a list or an array of several values."""
    if isinstance(value, str):
        return value
    units = getattr(value, "units", None) if hasattr(value, "magnitude") else None
    if units is not None:
        return f"{float(getattr(value, 'magnitude'))!r} {units:~C}".rstrip()  # noqa: B009
    text = getattr(value, "unit", None)
    try:
        if type(value).__name__ in ("bool", "bool_"):
            raise TypeError
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise UsageError([Problem("not-a-quantity", f"{subject}: a {type(value).__name__} is not one value", None,
                                  f'Write one number, in SI, or a text with its unit, such as "1 {unit}".'.replace(
                                      " 1\"", "\""))]) from None
    return number if text is None else f"{number!r} {text}"


def ranges(texts: Mapping[str, Range | str], units: Mapping[str, str] | None = None) -> dict[str, Range]:
    """Ranges by name: `{"controller.K_p": "0 .. 10 1/m"}`; UsageError that names a malformed one and suggests its unit, if
    `units` has it."""
    return {name: si_range(one, name, (units or {}).get(name)) for name, one in texts.items()}


def si_range(text: Range | str, subject: str, wanted: str | None = None) -> Range:
    """A range (`"30 .. 70 kN/m"`, `"42 kN/m +- 20 %"`); UsageError that begins with `subject` for another text, and suggests
    the unit `wanted`."""
    if isinstance(text, Range):
        return text
    try:
        return parse_range(text, wanted)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"{subject}: {problem.message}", None, problem.hint)]) from None
