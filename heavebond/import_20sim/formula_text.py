"""Scalar expressions as text of the formula language."""

from __future__ import annotations

from functools import lru_cache

from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.sidops_tree import Expr

ADD, MULTIPLY, SIGN, POWER, ATOM = 4, 5, 6, 7, 8
LARGEST = 20_000  # limit of nodes of an expression; larger texts are unreadable and refused by the formula language
LEVEL = {"or": 0, "and": 1, "not": 2, "==": 3, "!=": 3, "<": 3, ">": 3, "<=": 3, ">=": 3, "+": ADD, "-": ADD,
         "*": MULTIPLY, "/": MULTIPLY, "negative": SIGN, "^": POWER}
TRUTHS = {"or", "and", "not", "==", "!=", "<", ">", "<=", ">="}


def number(value: float) -> Expr:
    return Expr("number", value=value)


def name(text: str) -> Expr:
    return Expr("name", name=text)


def call(function: str, *args: Expr) -> Expr:
    return Expr("call", args, name=function)


def negative(inner: Expr) -> Expr:
    """-inner, without a double sign."""
    if inner.op == "negative":
        return inner.args[0]
    return number(0.0 - inner.value) if inner.op == "number" else Expr("negative", (inner,))  # -0.0 would be written as "-0"


def add(left: Expr, right: Expr) -> Expr:
    """left + right, without zeros and double signs."""
    if left == number(0):
        return right
    if right == number(0):
        return left
    if right.op == "negative":
        return Expr("-", (left, right.args[0]))
    return Expr("+", (left, right))


def multiply(left: Expr, right: Expr) -> Expr:
    """left * right, without zeros and ones."""
    if number(0) in (left, right):
        return number(0)
    if left == number(1):
        return right
    if right.op == "negative":
        return negative(multiply(left, right.args[0]))
    return left if right == number(1) else Expr("*", (left, right))


@lru_cache(maxsize=20_000)
def truth(expr: Expr) -> Expr:
    """An expression used as a condition: a number is true if it is not zero."""
    if expr.op in ("or", "and", "not"):
        return Expr(expr.op, tuple(truth(e) for e in expr.args))
    if expr.op in TRUTHS or expr.op == "event":
        return expr
    if expr.op == "if":
        a, b, c = truth(expr.args[0]), truth(expr.args[1]), truth(expr.args[2])
        return Expr("or", (Expr("and", (a, b)), Expr("and", (Expr("not", (a,)), c))))
    if expr.op == "number":
        return Expr(">" if expr.value else "<", (number(1), number(0)))
    return Expr("!=", (expr, number(0)))


def text(expr: Expr) -> str:
    """The text of a scalar expression."""
    return _text(expr)[0]


def value_text(expr: Expr) -> str:
    """The text of an expression used as a number: a comparison becomes 1 or 0."""
    return _value(expr)


def _number(value: float) -> str:
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e6 else f"{value!r}"


@lru_cache(maxsize=20_000)
def _text(expr: Expr) -> tuple[str, int]:
    op = expr.op
    if expr.size > LARGEST:
        raise Unreadable(expr.line, "an expression is too long")
    if op == "number":
        return (_number(expr.value), ATOM) if expr.value >= 0 else (_number(expr.value), SIGN)
    if op in ("name", "prev"):
        return expr.name, ATOM
    if op == "table":  # linear between its points, constant outside
        name, of = expr.name, _within(expr.args[0], ADD + 1)
        place = f"min(max(({of} - {name}_x[i])/({name}_x[i + 1] - {name}_x[i]), 0), 1)"
        return f"{name}_v[1] + sum(({name}_v[i + 1] - {name}_v[i])*{place} for i in 1..{name}_n - 1)", ADD
    if op == "table2":  # bilinear between its points, constant outside, as Lookup2
        n, u, w = expr.name, *(_within(e, ADD + 1) for e in expr.args)
        s = f"min(max(({u} - {n}_x[i])/({n}_x[i + 1] - {n}_x[i]), 0), 1)"
        t = f"min(max(({w} - {n}_y[j])/({n}_y[j + 1] - {n}_y[j]), 0), 1)"
        m, v = f"{n}_m", f"{n}_v"
        cell = f"{v}[i*{m} + j + 1] - {v}[i*{m} + j] - {v}[(i - 1)*{m} + j + 1] + {v}[(i - 1)*{m} + j]"
        return (f"{v}[1] + sum(({v}[i*{m} + 1] - {v}[(i - 1)*{m} + 1])*{s} for i in 1..{n}_n - 1)"
                f" + sum(({v}[j + 1] - {v}[j])*{t} for j in 1..{m} - 1)"
                f" + sum(sum(({cell})*{s}*{t} for j in 1..{m} - 1) for i in 1..{n}_n - 1)"), ADD
    if op == "call":
        name, dot, output = expr.name.partition(".")  # a result of a function with several ones
        return f"{name}({', '.join(_value(e) for e in expr.args)}){dot}{output}", ATOM
    if op == "if":
        return f"if_else({text(truth(expr.args[0]))}, {_value(expr.args[1])}, {_value(expr.args[2])})", ATOM
    if op not in LEVEL:
        raise Unreadable(expr.line, "an event is given instead of a value")
    level = LEVEL[op]
    if op == "negative" and expr.args[0].op in ("*", "/"):  # (-a)*b is the same number as -(a*b)
        return f"-{_within(expr.args[0], MULTIPLY)}", MULTIPLY
    if op in ("negative", "not"):
        inner = _within(expr.args[0] if op == "negative" else truth(expr.args[0]), level + (op == "negative"))
        return f"{'-' if op == 'negative' else 'not '}{inner}", level
    if op in ("and", "or"):
        return f" {op} ".join(_within(truth(e), level if k == 0 else level + 1) for k, e in enumerate(expr.args)), level
    left, right = expr.args
    if op == "^":
        return f"{_within(left, ATOM)}**{_within(right, POWER)}", level
    sign = f" {op} " if level <= ADD else op
    if level == MULTIPLY and (len(text(left)) > 3 and len(text(right)) > 3):
        sign = f" {op} "
    return f"{_within(left, level + (level == 3))}{sign}{_within(right, level + 1)}", level


def _value(expr: Expr) -> str:
    """A number: a comparison becomes 1 or 0."""
    return f"if_else({text(truth(expr))}, 1, 0)" if expr.op in TRUTHS else text(expr)


def _within(expr: Expr, level: int) -> str:
    if expr.op in TRUTHS and level > 3:
        return _value(expr)
    inner_text, inner_level = _text(expr)
    return inner_text if inner_level >= level else f"({inner_text})"
