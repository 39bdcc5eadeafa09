"""Tokens of a formula: numbers, units, names and operators, each with its column."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn

from heavebond.core.numerals import whole
from heavebond.core.units import UNIT, UnitProblem, read_unit

KEYWORDS = {"and", "or", "not", "for", "in"}


class ExpressionProblem(ValueError):
    """Error in the text of an expression; `column` counts from 0 in the parsed text."""

    def __init__(self, code: str, message: str, column: int, length: int = 1, hint: str = ""):
        super().__init__(message)
        self.code, self.message, self.column, self.length, self.hint = code, message, column, length, hint


@dataclass(frozen=True)
class Token:
    """A token of a formula: number, unit, name, keyword, operator or end."""

    kind: str
    text: str
    column: int


_SKIP = re.compile(r"[ \t]+")
_NUMBER = re.compile(r"(?:[0-9]+(?:\.(?!\.)[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_UNIT_AFTER = re.compile(rf"[ \t]+({UNIT})(?![\w(])")
_NAME = re.compile(r"[A-Za-z_]\w*")
_OPERATOR = re.compile(r"\*\*|\.\.|<=|>=|==|!=|[-+*/(),=<>.\[\]]")


def tokens(text: str, *, units: bool) -> Iterator[Token]:
    """Split a formula into tokens, with units after numbers if `units` is true.

    Raises ExpressionProblem for a character that is not allowed in a formula.
    """
    at = 0
    while at < len(text):
        if skip := _SKIP.match(text, at):
            at = skip.end()
            continue
        if found := _NUMBER.match(text, at):
            yield Token("number", found.group(), at)
            at = found.end()
            _refuse_after_number(text, found.group(), at, units)
            if not units and (name := _UNIT_AFTER.match(text, at)) and name.group(1) not in KEYWORDS:
                raise ExpressionProblem(
                    "unit-in-equation", f"'{found.group()} {name.group(1)}': a component's equations hold no units",
                    found.start(), name.end() - found.start(),
                    "Declare a parameter with its unit; a product is written with `*`.")
            if units and (unit := _UNIT_AFTER.match(text, at)) and unit.group(1) not in KEYWORDS:
                word = _longest_unit(unit.group(1), text[unit.end(1):])
                yield Token("unit", word, unit.start(1))
                at = unit.start(1) + len(word)
        elif found := _NAME.match(text, at):
            kind = "keyword" if found.group() in KEYWORDS else "name"
            yield Token(kind, found.group(), at)
            at = found.end()
        elif found := _OPERATOR.match(text, at):
            yield Token("operator", found.group(), at)
            at = found.end()
        else:
            _refuse_sign(text, at)
    yield Token("end", "", len(text))


def _longest_unit(word: str, rest: str) -> str:
    """The longest prefix of `word` that is a unit, `N*s/m` in `3 N*s/m*load.v`.

    If no prefix is a unit, the whole word, which the caller reports as an unknown unit.
    """
    part = word
    if rest.startswith("."):  # the last factor is the first part of a dotted name
        part = _without_last_factor(part)
    while part:
        try:
            read_unit(part)
            return part
        except UnitProblem:
            part = _without_last_factor(part)
    return word


def _without_last_factor(unit: str) -> str:
    cut = max(unit.rfind("/"), re.sub(r"\*\*", "  ", unit).rfind("*"))
    return unit[:cut] if cut > 0 else ""


def _refuse_after_number(text: str, number: str, at: int, units: bool) -> None:
    after = text[at:at + 2]
    if after[:1] == "," and whole(after[1:]) is not None and not _in_call(text, at):
        raise ExpressionProblem("decimal-comma", f"a decimal comma in '{number}{after}'", at - len(number),
                                len(number) + 2, f"Write '{number}.{after[1:]}'.")
    if glued := _NAME.match(text, at):
        raise ExpressionProblem(
            "quantity-no-space", f"'{number}{glued.group()}' is neither a number nor a name", at - len(number),
            len(number) + len(glued.group()), f"A product is written `{number}*{glued.group()}`"
            + (f", a quantity `{number} {glued.group()}`." if units else "."))


def _refuse_sign(text: str, at: int) -> NoReturn:
    sign = text[at]
    if sign == "^":
        raise ExpressionProblem("formula-power", "the power is not written `^`", at, 1, "Write `**`.")
    what = {"'": "a quote (')", '"': 'a quote (")'}.get(sign, f"'{sign}'")
    raise ExpressionProblem("sign-unknown", f"{what} has no meaning in a formula", at, 1,
                            "A formula holds numbers, names, + - * / ** and functions.")


def _in_call(text: str, at: int) -> bool:
    return text.count("(", 0, at) > text.count(")", 0, at)
