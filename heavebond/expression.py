"""One equation or formula: text to a tree. A whitelist grammar of our own; nothing is ever evaluated by Python.

    equation   = sum '=' sum
    formula    = or-expression
    sum        = product (('+'|'-') product)*
    product    = unary (('*'|'/') unary)*
    unary      = '-' unary | power
    power      = atom ('**' unary)?
    atom       = number [unit] | name ('.' name | '[' sum ']')* | function '(' ... ')' | '(' formula ')'

Units after a number (`2 * 460 L/min`) are understood in diagrams only; component equations know declared names, plain
numbers and a bare 0.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NoReturn, Union

from heavebond.errors import suggest
from heavebond.units import UNIT, Unit, UnitProblem, read_unit

# function: number of arguments
FUNCTIONS = {
    "der": 1, "sqrt": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tan": 1, "tanh": 1, "asin": 1, "acos": 1, "atan": 1,
    "abs": 1, "sign": 1, "min": 2, "max": 2, "smooth_sign": 2, "signed_sqrt": 2, "if_else": 3, "uniform": 2, "sum": 1,
}
KEYWORDS = {"and", "or", "not", "for", "in"}
COMPARISONS = ("<=", ">=", "==", "!=", "<", ">")

Expr = Union["Number", "Name", "Call", "Binary", "Negative", "Compare", "Logic", "Not", "SumOver"]


@dataclass(frozen=True)
class Number:
    """A number in SI, `unit` None where none was written."""

    value: float
    unit: Unit | None
    column: int


@dataclass(frozen=True)
class Name:
    """A dotted name; a part in brackets (`p[i]`) is kept as an expression after its name."""

    parts: tuple[str | Expr, ...]
    column: int
    length: int

    @property
    def text(self) -> str:
        """`a.x`, or `p[2].effort` where every index is a number."""
        words: list[str] = []
        for part in self.parts:
            if isinstance(part, str):
                words.append(part)
            elif isinstance(part, Number):
                words[-1] += f"[{int(part.value)}]"
            else:
                words[-1] += "[...]"
        return ".".join(words)


@dataclass(frozen=True)
class Call:
    """function(args)."""

    function: str
    args: tuple[Expr, ...]
    column: int


@dataclass(frozen=True)
class Binary:
    """left op right, op one of + - * / **."""

    op: str
    left: Expr
    right: Expr
    column: int


@dataclass(frozen=True)
class Negative:
    """-operand."""

    operand: Expr
    column: int


@dataclass(frozen=True)
class Compare:
    """left op right, op one of < <= > >= == !=."""

    op: str
    left: Expr
    right: Expr
    column: int


@dataclass(frozen=True)
class Logic:
    """left and/or right."""

    op: str
    left: Expr
    right: Expr
    column: int


@dataclass(frozen=True)
class Not:
    """not operand."""

    operand: Expr
    column: int


@dataclass(frozen=True)
class SumOver:
    """sum(body for index in low..high)."""

    body: Expr
    index: str
    low: Expr
    high: Expr
    column: int


@dataclass(frozen=True)
class Equation:
    """left = right."""

    left: Expr
    right: Expr


class ExpressionProblem(ValueError):
    """A text that is no expression; `column` counts from 0 in the text that was parsed."""

    def __init__(self, code: str, message: str, column: int, length: int = 1, hint: str = ""):
        super().__init__(message)
        self.code, self.message, self.column, self.length, self.hint = code, message, column, length, hint


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    column: int


_SKIP = re.compile(r"[ \t]+")
_NUMBER = re.compile(r"(?:\d+(?:\.(?!\.)\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_UNIT_AFTER = re.compile(rf"[ \t]+({UNIT})(?![\w(])")
_NAME = re.compile(r"[A-Za-z_]\w*")
_OPERATOR = re.compile(r"\*\*|\.\.|<=|>=|==|!=|[-+*/(),=<>.\[\]]")


def parse_equation(text: str) -> Equation:
    """Parse `left = right` of a component (no units after numbers); raises ExpressionProblem."""
    parser = _Parser(text, units=False)
    left = parser.sum()
    if parser.peek().text != "=":
        parser.refuse_rest("an equation is written `left = right`")
    parser.take()
    equation = Equation(left, parser.sum())
    parser.end()
    return equation


def parse_formula(text: str, *, units: bool = True) -> Expr:
    """Parse a formula (without a leading `=`); raises ExpressionProblem."""
    parser = _Parser(text, units=units)
    formula = parser.formula()
    parser.end()
    return formula


class _Parser:
    def __init__(self, text: str, *, units: bool):
        self.text, self.units = text, units
        self.tokens = list(self._tokens())
        self.position = 0

    def _tokens(self) -> Iterator[_Token]:
        at = 0
        while at < len(self.text):
            if skip := _SKIP.match(self.text, at):
                at = skip.end()
                continue
            if found := _NUMBER.match(self.text, at):
                yield _Token("number", found.group(), at)
                at = found.end()
                after = self.text[at:at + 1]
                if after == "," and self.text[at + 1:at + 2].isdigit() and not self._in_call(at):
                    raise ExpressionProblem("decimal-comma", "a decimal comma", at, 1, "Write a decimal point.")
                if self.units and (unit := _UNIT_AFTER.match(self.text, at)) and unit.group(1) not in KEYWORDS:
                    yield _Token("unit", unit.group(1), unit.start(1))
                    at = unit.end()
            elif found := _NAME.match(self.text, at):
                kind = "keyword" if found.group() in KEYWORDS else "name"
                yield _Token(kind, found.group(), at)
                at = found.end()
            elif found := _OPERATOR.match(self.text, at):
                yield _Token("operator", found.group(), at)
                at = found.end()
            else:
                sign = self.text[at]
                hint = "The power is written `**`." if sign == "^" else ""
                raise ExpressionProblem("sign-unknown", f"'{sign}' has no meaning in a formula", at, 1, hint)
        yield _Token("end", "", len(self.text))

    def _in_call(self, at: int) -> bool:
        return self.text.count("(", 0, at) > self.text.count(")", 0, at)

    def peek(self) -> _Token:
        return self.tokens[self.position]

    def take(self) -> _Token:
        token = self.tokens[self.position]
        self.position += 1
        return token

    def expect(self, text: str, why: str) -> None:
        if self.peek().text != text:
            self.refuse_rest(why)
        self.take()

    def refuse_rest(self, why: str) -> NoReturn:
        token = self.peek()
        if token.kind == "end":
            raise ExpressionProblem("formula-incomplete", f"the formula ends too early: {why}",
                                    max(0, token.column - 1))
        if token.text == "=":
            raise ExpressionProblem("formula-equals", "a second `=`; a comparison is written `==`", token.column)
        raise ExpressionProblem("formula-broken", f"'{token.text}' cannot stand here: {why}", token.column,
                                len(token.text))

    def end(self) -> None:
        if self.peek().kind != "end":
            self.refuse_rest("an operator is missing before it")

    def _chain(self, operand: Callable[[], Expr], ops: tuple[str, ...], build: type) -> Expr:
        left = operand()
        while (token := self.peek()).text in ops and token.kind in ("operator", "keyword"):
            self.take()
            left = build(token.text, left, operand(), token.column)
        return left

    def formula(self) -> Expr:
        return self._chain(self._conjunction, ("or",), Logic)

    def _conjunction(self) -> Expr:
        return self._chain(self._negation, ("and",), Logic)

    def _negation(self) -> Expr:
        if self.peek().text == "not":
            token = self.take()
            return Not(self._negation(), token.column)
        return self._comparison()

    def _comparison(self) -> Expr:
        left = self.sum()
        if self.peek().text in COMPARISONS:
            token = self.take()
            return Compare(token.text, left, self.sum(), token.column)
        return left

    def sum(self) -> Expr:
        return self._chain(self._product, ("+", "-"), Binary)

    def _product(self) -> Expr:
        return self._chain(self._unary, ("*", "/"), Binary)

    def _unary(self) -> Expr:
        token = self.peek()
        if token.text == "-":
            self.take()
            return Negative(self._unary(), token.column)
        if token.text == "+":
            self.take()
            return self._unary()
        return self._power()

    def _power(self) -> Expr:
        base = self._atom()
        if self.peek().text == "**":
            token = self.take()
            return Binary("**", base, self._unary(), token.column)
        return base

    def _atom(self) -> Expr:
        token = self.take()
        if token.kind == "number":
            return self._number(token)
        if token.kind == "name":
            return self._call(token) if self.peek().text == "(" else self._name(token)
        if token.text == "(":
            inner = self.formula()
            self.expect(")", "a `)` is missing")
            return inner
        self.position -= 1
        self.refuse_rest("a number or a name is expected")

    def _number(self, token: _Token) -> Number:
        value = float(token.text)
        if self.peek().kind != "unit":
            return Number(value, None, token.column)
        unit_token = self.take()
        try:
            read = read_unit(unit_token.text)
        except UnitProblem as problem:
            raise ExpressionProblem(problem.code, problem.message, unit_token.column, len(unit_token.text),
                                    problem.hint) from problem
        return Number(read.to_si(value), read, token.column)

    def _name(self, token: _Token) -> Name:
        parts: list[str | Expr] = [token.text]
        while self.peek().text in (".", "["):
            if self.take().text == "[":
                parts.append(self.sum())
                self.expect("]", "a `]` is missing")
            else:
                follower = self.take()
                if follower.kind not in ("name", "keyword"):
                    self.position -= 1
                    self.refuse_rest("a name follows a dot")
                parts.append(follower.text)
        last = self.tokens[self.position - 1]
        return Name(tuple(parts), token.column, last.column + len(last.text) - token.column)

    def _call(self, token: _Token) -> Expr:
        name = token.text
        if name not in FUNCTIONS:
            raise ExpressionProblem("function-unknown", f"there is no function '{name}'", token.column, len(name),
                                    suggest(name, FUNCTIONS) or "Known: " + ", ".join(FUNCTIONS) + ".")
        self.take()
        args = [self.formula()]
        if name == "sum" and self.peek().text == "for":
            return self._sum_over(args[0], token)
        while self.peek().text == ",":
            self.take()
            args.append(self.formula())
        self.expect(")", f"a `)` closes {name}(")
        if len(args) != FUNCTIONS[name] and not (name in ("min", "max") and len(args) > 1):
            raise ExpressionProblem("function-arguments", f"{name} takes {FUNCTIONS[name]} argument"
                                    f"{'s' if FUNCTIONS[name] > 1 else ''}, not {len(args)}", token.column, len(name))
        return Call(name, tuple(args), token.column)

    def _sum_over(self, body: Expr, token: _Token) -> SumOver:
        self.take()
        index = self.take()
        if index.kind != "name":
            self.position -= 1
            self.refuse_rest("a sum is written `sum(... for i in 1..n)`")
        self.expect("in", "a sum is written `sum(... for i in 1..n)`")
        low = self.sum()
        self.expect("..", "a sum is written `sum(... for i in 1..n)`")
        high = self.sum()
        self.expect(")", "a `)` closes sum(")
        return SumOver(body, index.text, low, high, token.column)


def names(expr: Expr) -> Iterator[Name]:
    """Every name in an expression, in the order of the text (the index of a sum is left out)."""
    if isinstance(expr, Name):
        yield expr
        for part in expr.parts:
            if not isinstance(part, str):
                yield from names(part)
    elif isinstance(expr, SumOver):
        for inner in (expr.low, expr.high, expr.body):
            yield from (n for n in names(inner) if n.text != expr.index)
    else:
        for child in children(expr):
            yield from names(child)


def children(expr: Expr) -> tuple[Expr, ...]:
    """The operands of an expression."""
    if isinstance(expr, Call):
        return expr.args
    if isinstance(expr, (Binary, Compare, Logic)):
        return (expr.left, expr.right)
    if isinstance(expr, (Negative, Not)):
        return (expr.operand,)
    if isinstance(expr, SumOver):
        return (expr.low, expr.high, expr.body)
    return ()


def constant(expr: Expr) -> float | None:
    """The value of an expression of plain numbers only, else None."""
    if isinstance(expr, Number):
        return expr.value
    if isinstance(expr, Negative):
        inner = constant(expr.operand)
        return None if inner is None else -inner
    if isinstance(expr, Binary):
        left, right = constant(expr.left), constant(expr.right)
        if left is None or right is None:
            return None
        try:
            value = _ARITHMETIC[expr.op](left, right)
        except (OverflowError, ZeroDivisionError):
            return None
        return value if isinstance(value, float) else None  # a root of a negative number is complex
    return None


_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": operator.pow}
