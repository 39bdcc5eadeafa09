"""Quantities as arguments of Python functions: a number in SI, or text with a unit (`"300 kg"`, `"30 .. 70 kN/m"`)."""

from __future__ import annotations

from collections.abc import Mapping

from heavebond.core.errors import Problem, UsageError
from heavebond.core.units import Range, UnitProblem, check_unit, parse_quantity, parse_range, read_unit


def si_value(given: float | str, unit: str, subject: str) -> float:
    """A quantity in SI; the text must have the dimension of `unit`.

    Raises UsageError that begins with `subject` for a text without its unit, with a unit of another dimension, or that is
    not a quantity.
    """
    if not isinstance(given, str):
        return float(given)
    try:
        number, read = parse_quantity(given)
        check_unit(read, read_unit(unit), number, given)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"{subject}: {problem.message}", None, problem.hint)]) from None
    return number


def ranges(given: Mapping[str, Range | str]) -> dict[str, Range]:
    """Ranges by name: `{"controller.K_p": "0 .. 10 1/m"}`; UsageError that names a malformed one."""
    return {name: si_range(one, name) for name, one in given.items()}


def si_range(given: Range | str, subject: str) -> Range:
    """A range (`"30 .. 70 kN/m"`, `"42 kN/m +- 20 %"`); UsageError that begins with `subject` for another text."""
    if isinstance(given, Range):
        return given
    try:
        return parse_range(given)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"{subject}: {problem.message}", None, problem.hint)]) from None
