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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Union

from heavebond.core.errors import suggest
from heavebond.core.limits import BRACKETS, FORMULA, OPERATIONS, TERMS
from heavebond.core.limits import NUMBER as LARGEST
from heavebond.core.units import TOO_LARGE, Unit, UnitProblem, read_unit
from heavebond.text.tokens import KEYWORDS as KEYWORDS
from heavebond.text.tokens import ExpressionProblem as ExpressionProblem
from heavebond.text.tokens import Token, tokens

# function: number of arguments
FUNCTIONS = {
    "der": 1, "sqrt": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tan": 1, "tanh": 1, "asin": 1, "acos": 1, "atan": 1,
    "abs": 1, "sign": 1, "floor": 1, "min": 2, "max": 2, "smooth_sign": 2, "signed_sqrt": 2, "if_else": 3, "uniform": 2,
    "sum": 1,
}
# arguments as they are written in messages
USAGE = {"min": "min(a, b)", "max": "max(a, b)", "smooth_sign": "smooth_sign(v, v_t)", "uniform": "uniform(seed, i)",
         "signed_sqrt": "signed_sqrt(dp, dp_t)", "if_else": "if_else(a > b, x, y)"}
SUM_FORM = "A sum is written `sum(... for i in 1..n)`."
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


def parse_equation(text: str) -> Equation:
    """Parse `left = right` of a component (no units after numbers); raises ExpressionProblem."""
    parser = _Parser(text, units=False)
    left = parser.sum()
    if parser.peek().text != "=":
        raise parser.broken("an equation needs one `=`", "An equation is written `left = right`.")
    parser.take()
    right = parser.sum()
    if parser.peek().text == "=":
        raise ExpressionProblem("formula-equals", "a second `=` in one equation", parser.peek().column, 1,
                                "Write two equations, one a line.")
    parser.end()
    _check_depth(left, right)
    return Equation(left, right)


def parse_formula(text: str, *, units: bool = True, functions: Mapping[str, int] | None = None) -> Expr:
    """Parse a formula (without a leading `=`); `functions` may be called beside the usual ones, each with so many
    arguments. Raises ExpressionProblem."""
    parser = _Parser(text, units=units, functions={**FUNCTIONS, **(functions or {})})
    formula = parser.formula()
    if parser.peek().text == "=":
        raise ExpressionProblem("formula-equals", "an `=` inside a formula", parser.peek().column, 1,
                                "A comparison is written `==`.")
    parser.end()
    _check_depth(formula)
    return formula


def _check_depth(*trees: Expr) -> None:
    """Everything that walks a tree does so recursively; a longer sum or product is split by the author."""
    level = list(trees)
    for _ in range(OPERATIONS):
        level = [child for expr in level for child in children(expr)]
        if not level:
            return
    raise ExpressionProblem("formula-too-long", f"more than {OPERATIONS} operations in a row", 0, 1,
                            "Split it: give a part of it a name of its own.")


class _Parser:
    def __init__(self, text: str, *, units: bool, functions: Mapping[str, int] = FUNCTIONS):
        self.text, self.functions = text, functions
        if len(text) > FORMULA:
            raise ExpressionProblem("formula-too-long", f"a formula of more than {FORMULA} signs", 0, 1,
                                    "Split it: give a part of it a name of its own.")
        self.tokens = list(tokens(text, units=units))
        self.position = 0
        self.depth = 0

    def peek(self) -> Token:
        return self.tokens[self.position]

    def take(self) -> Token:
        token = self.tokens[self.position]
        self.position += 1
        return token

    def expect(self, text: str, why: str, hint: str) -> None:
        if self.peek().text != text:
            raise self.broken(why, hint)
        self.take()

    def broken(self, why: str, hint: str) -> ExpressionProblem:
        """The problem at the next token."""
        token = self.peek()
        if token.kind == "end":
            return ExpressionProblem("formula-incomplete", f"the formula ends too early: {why}",
                                    max(0, len(self.text.rstrip()) - 1), 1, hint)
        return ExpressionProblem("formula-broken", f"'{token.text}' cannot stand here: {why}", token.column,
                                len(token.text), hint)

    def end(self) -> None:
        token = self.peek()
        if token.text == ")":
            raise self.broken("no bracket is open", "Remove it, or add the `(` that is missing.")
        if token.text == "if":
            raise self.broken("there is no such word", f"Write `{USAGE['if_else']}`.")
        if token.kind in ("name", "number", "unit") or token.text == "(":
            raise self.broken("an operator is missing before it", "A product is written with `*`.")
        if token.kind != "end":
            raise self.broken("the formula is complete before it", "Remove it.")

    @contextmanager
    def _deeper(self) -> Iterator[None]:
        """Brackets, functions and signs within each other: so many that the parser's own recursion stays bounded."""
        self.depth += 1
        if self.depth > BRACKETS:
            raise ExpressionProblem("formula-too-deep", f"more than {BRACKETS} brackets or signs within each other",
                                    self.peek().column, 1, "Split it: give a part of it a name of its own.")
        yield
        self.depth -= 1

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
            with self._deeper():
                return Not(self._negation(), token.column)
        return self._comparison()

    def _comparison(self) -> Expr:
        left = self.sum()
        if self.peek().text in COMPARISONS:
            token = self.take()
            right = self.sum()
            if self.peek().text in COMPARISONS:
                raise self.broken("comparisons do not follow each other", "Write `a < b and b < c`.")
            return Compare(token.text, left, right, token.column)
        return left

    def sum(self) -> Expr:
        return self._chain(self._product, ("+", "-"), Binary)

    def _product(self) -> Expr:
        return self._chain(self._unary, ("*", "/"), Binary)

    def _unary(self) -> Expr:
        token = self.peek()
        if token.text not in ("-", "+"):
            return self._power()
        self.take()
        with self._deeper():
            operand = self._unary()
        return Negative(operand, token.column) if token.text == "-" else operand

    def _power(self) -> Expr:
        base = self._atom()
        if self.peek().text == "**":
            token = self.take()
            with self._deeper():
                return Binary("**", base, self._unary(), token.column)
        return base

    def _atom(self) -> Expr:
        token = self.take()
        if token.kind == "number":
            return self._number(token)
        if token.kind == "name":
            with self._deeper():
                return self._call(token) if self.peek().text == "(" else self._name(token)
        if token.text == "(":
            with self._deeper():
                inner = self.formula()
            self.expect(")", "a `)` is missing", "Each `(` needs a `)`.")
            return inner
        self.position -= 1
        raise self.broken("a number or a name is missing", "Complete the formula, as in `2*a + b`.")

    def _number(self, token: Token) -> Number:
        value = float(token.text)
        if not value <= LARGEST:
            raise ExpressionProblem("number-too-large", "too large a number", token.column, len(token.text), TOO_LARGE)
        if self.peek().kind != "unit":
            return Number(value, None, token.column)
        unit_token = self.take()
        try:
            read = read_unit(unit_token.text)
        except UnitProblem as problem:
            raise ExpressionProblem(problem.code, problem.message, unit_token.column, len(unit_token.text),
                                    problem.hint) from problem
        if not abs(read.to_si(value)) <= LARGEST:
            raise ExpressionProblem("number-too-large", "too large a number", token.column, len(token.text), TOO_LARGE)
        return Number(read.to_si(value), read, token.column)

    def _name(self, token: Token) -> Name:
        parts: list[str | Expr] = [token.text]
        while self.peek().text in (".", "["):
            if self.take().text == "[":
                parts.append(self.sum())
                self.expect("]", "a `]` is missing", "Each `[` needs a `]`.")
            else:
                follower = self.take()
                if follower.kind not in ("name", "keyword"):
                    self.position -= 1
                    raise self.broken("a name is missing behind the dot", "Write for example `load.x`.")
                parts.append(follower.text)
        last = self.tokens[self.position - 1]
        name = Name(tuple(parts), token.column, last.column + len(last.text) - token.column)
        if self.peek().text == "(":
            raise ExpressionProblem("function-unknown", f"there is no function '{name.text}'", name.column, name.length,
                                    self._known_functions())
        return name

    def _known_functions(self) -> str:
        known = list(self.functions)
        return f"Functions: {', '.join(known[:14])},\n{', '.join(known[14:])}."

    def _call(self, token: Token) -> Expr:
        name = token.text
        if name not in self.functions:
            raise ExpressionProblem("function-unknown", f"there is no function '{name}'", token.column, len(name),
                                    suggest(name, self.functions) or self._known_functions())
        self.take()
        args = [self.formula()]
        if name == "sum" and self.peek().text == "for":
            return self._sum_over(args[0], token)
        while self.peek().text == ",":
            self.take()
            args.append(self.formula())
        usage = USAGE.get(name, f"{name}(a)")
        self.expect(")", f"a `)` is missing behind {name}(", f"Write `{usage}`.")
        needed = self.functions[name]
        if len(args) != needed and not (name in ("min", "max") and len(args) > 1):
            many = "s" if needed > 1 else ""
            raise ExpressionProblem("function-arguments", f"{name} takes {needed} argument{many}, not "
                                    f"{len(args)}", token.column, len(name), f"Write `{usage}`.")
        return Call(name, tuple(args), token.column)

    def _sum_over(self, body: Expr, token: Token) -> SumOver:
        self.take()
        index = self.take()
        if index.kind != "name":
            self.position -= 1
            raise self.broken("the name of the index is missing", SUM_FORM)
        self.expect("in", "`in` is missing", SUM_FORM)
        low = self.sum()
        self.expect("..", "`..` is missing", SUM_FORM)
        high = self.sum()
        self.expect(")", "a `)` is missing behind sum(", SUM_FORM)
        result = SumOver(body, index.text, low, high, token.column)
        if _terms(result) > TERMS:
            raise too_long(token.column)
        return result


def too_long(column: int) -> ExpressionProblem:
    """What is said of a sum that would fill the memory."""
    return ExpressionProblem("sum-too-long", f"a sum of more than {TERMS} terms", column, 3, "Use fewer terms.")


def _terms(expr: Expr) -> float:
    """How many terms the sums of an expression have when written out, as far as plain numbers tell."""
    inner = max((_terms(child) for child in children(expr)), default=1.0)
    if not isinstance(expr, SumOver):
        return inner
    first, last = constant(expr.low), constant(expr.high)
    return inner if first is None or last is None else inner * max(1.0, last - first + 1)


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
