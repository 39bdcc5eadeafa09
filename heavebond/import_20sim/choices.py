"""Nested choices, `if c then a else b` as values: simplification, removal of events, separation into conditions and
values.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.sidops_tree import Expr

TRUE, FALSE = f.number(1), f.number(0)
SHORTLY = 1e-9  # s after the start
OPPOSITE = {"<": ">=", ">=": "<", ">": "<=", "<=": ">", "==": "!=", "!=": "=="}


def rebuilt(expr: Expr, change: Callable[[Expr], Expr]) -> Expr:
    """The expression with `change` applied to its arguments."""
    return Expr(expr.op, tuple(change(e) for e in expr.args), expr.name, expr.value, expr.line, expr.columns)


@lru_cache(maxsize=100_000)
def simplified(expr: Expr) -> Expr:
    """Simplify choices and conditions that known numbers decide."""
    if not expr.args:
        return expr
    expr = rebuilt(expr, simplified)
    if expr.op == "if":
        condition, then, otherwise = _condition(expr.args[0]), *expr.args[1:]
        if condition.op == "number":
            return then if condition.value else otherwise
        then, otherwise = decided(then, condition, True), decided(otherwise, condition, False)
        return then if then == otherwise else Expr("if", (condition, then, otherwise), line=expr.line)
    if expr.op == "+" and f.number(0) in expr.args:
        return expr.args[1] if expr.args[0] == f.number(0) else expr.args[0]
    if expr.op in ("and", "or"):
        expr = rebuilt(expr, _condition)
        left, right = expr.args
        ends = expr.op == "or"  # the value of a side that determines the whole
        for side, opposite in ((left, right), (right, left)):
            if side.op == "number":
                return (TRUE if ends else FALSE) if bool(side.value) == ends else opposite
        if left == right:
            return left
        return expr if ends else _and(expr)
    if expr.op == "not":
        expr = rebuilt(expr, _condition)
        inner = expr.args[0]
        if inner.op == "number":
            return FALSE if inner.value else TRUE
        if inner.op == "not":
            return inner.args[0]
        return Expr(OPPOSITE[inner.op], inner.args) if inner.op in OPPOSITE else expr
    if expr.op in OPPOSITE:
        return _compared(expr)
    return expr


def _condition(expr: Expr) -> Expr:
    """A flag that is 1 if a condition is true, converted to that condition."""
    if expr.op == "if" and expr.args[1:] == (TRUE, FALSE):
        return expr.args[0]
    return simplified(Expr("not", (expr.args[0],))) if expr.op == "if" and expr.args[1:] == (FALSE, TRUE) else expr


def decided(expr: Expr, condition: Expr, value: bool) -> Expr:
    """An expression under a true or false condition: choices by that condition, or by a part of it, are replaced by their
    branch.
    """
    if condition.op == ("and" if value else "or"):
        return decided(decided(expr, condition.args[0], value), condition.args[1], value)
    while expr.op == "if":
        same = expr.args[0] == condition
        if not same and expr.args[0] != (Expr(OPPOSITE[condition.op], condition.args) if condition.op in OPPOSITE else
                                         Expr("not", (condition,))):
            break
        expr = expr.args[1 if same == value else 2]
    return expr


def _and(expr: Expr) -> Expr:
    """`a and b` without redundant parts: `x >= 1 and x > 1` is `x > 1`."""
    parts = _parts(expr)
    independent = [p for p in parts if not any(_follows(p, q) for q in parts)]
    conjunction = independent[0]
    for part in independent[1:]:
        conjunction = Expr("and", (conjunction, part))
    return conjunction


def _parts(expr: Expr) -> list[Expr]:
    conjuncts = [p for side in expr.args for p in _parts(side)] if expr.op == "and" else [expr]
    return list(dict.fromkeys(conjuncts))


SHARPER = {">=": (">", "=="), "<=": ("<", "=="), "!=": (">", "<")}


def _follows(a: Expr, b: Expr) -> bool:
    """Whether a comparison follows from a sharper one of the same two values, or from equality with another number."""
    if a.op == "!=" and b.op == "==" and a.args[0] == b.args[0] and a.args[1].op == b.args[1].op == "number":
        return a.args[1].value != b.args[1].value
    return a.args == b.args and b.op in SHARPER.get(a.op, ())


def _compared(expr: Expr) -> Expr:
    """A comparison of two numbers, or of a choice between numbers with a number."""
    left, right = expr.args
    if left.op == "number" and right.op == "number":
        a, b = left.value, right.value
        return TRUE if {"<": a < b, ">": a > b, "<=": a <= b, ">=": a >= b, "==": a == b, "!=": a != b}[expr.op] else FALSE
    if left.op == "if" and right.op == "number" and all(e.op == "number" for e in left.args[1:]):
        sides = [_compared(Expr(expr.op, (e, right))) == TRUE for e in left.args[1:]]
        if sides[0] == sides[1]:
            return TRUE if sides[0] else FALSE
        return f.truth(left.args[0]) if sides[0] else simplified(Expr("not", (f.truth(left.args[0]),)))
    return expr


@lru_cache(maxsize=100_000)
def triggers(expr: Expr) -> tuple[Expr, ...]:
    """The events in an expression, each once."""
    events = [expr] if expr.op == "event" else []
    return tuple(dict.fromkeys([*events, *(e for arg in expr.args for e in triggers(arg))]))


@lru_cache(maxsize=100_000)
def at_event(expr: Expr, event: Expr | None) -> Expr:
    """The expression at the instant of an event, or between events: the others are false."""
    return simplified(_replaced(expr, event)) if triggers(expr) else simplified(expr)


@lru_cache(maxsize=100_000)
def _replaced(expr: Expr, event: Expr | None) -> Expr:
    if expr.op == "event":
        return TRUE if expr == event else FALSE
    return rebuilt(expr, lambda e: _replaced(e, event)) if expr.args else expr


@lru_cache(maxsize=100_000)
def between_events(expr: Expr) -> Expr:
    """The value of an equation between events. If a choice by `time == 0` or `time > 0` prevents a division by a time of
    0, its divisors are evaluated at a short time."""
    @cache
    def later(e: Expr) -> Expr:
        return f.call("max", e, f.number(SHORTLY)) if e == f.name("time") else rebuilt(e, later) if e.args else e

    @cache
    def kept_from_zero(e: Expr) -> Expr:
        if e.op == "/" and "time" in names(e.args[1]):
            return Expr("/", (kept_from_zero(e.args[0]), later(e.args[1])))
        return rebuilt(e, kept_from_zero) if e.args else e

    @cache
    def change(e: Expr) -> Expr:
        if e.op != "if":
            return rebuilt(e, change) if e.args else e
        simplify = kept_from_zero if _asks_for_start(e.args[0]) else change
        return Expr("if", (e.args[0], *map(simplify, e.args[1:])), line=e.line)

    return at_event(change(expr), None)


@lru_cache(maxsize=100_000)
def _asks_for_start(condition: Expr) -> bool:
    """True if a condition compares the time with 0."""
    compared = condition.op in OPPOSITE and f.name("time") in condition.args
    if compared or (condition.op == "event" and condition.name == "time"):
        return any(e.op == "number" and e.value <= 0 for e in condition.args)
    return any(_asks_for_start(e) for e in condition.args)


@lru_cache(maxsize=100_000)
def at_start(expr: Expr) -> Expr:
    """The expression at the initial time, with passed instants counted as events."""
    @cache
    def change(e: Expr) -> Expr:
        if e.op == "event":
            return Expr(">=", (f.name("time"), e.args[0])) if e.name == "time" else FALSE
        return rebuilt(e, change)

    return simplified(change(expr))


@lru_cache(maxsize=100_000)
def names(expr: Expr) -> tuple[str, ...]:
    """The names in an expression, each once."""
    return (expr.name,) if expr.op in ("name", "prev") else tuple(dict.fromkeys(n for e in expr.args for n in names(e)))


@lru_cache(maxsize=100_000)
def keeps(expr: Expr, name: str) -> bool:
    """True if a value depends on the former value of the variable."""
    return (expr.op in ("prev", "name") and expr.name == name) or any(keeps(e, name) for e in expr.args)


@lru_cache(maxsize=100_000)
def renamed(expr: Expr, old: str, new: Expr) -> Expr:
    """An expression with `new` in place of a variable or its former value."""
    if expr.op in ("name", "prev") and expr.name == old:
        return new
    return rebuilt(expr, lambda e: renamed(e, old, new)) if expr.args else expr


@lru_cache(maxsize=100_000)
def begun(expr: Expr) -> Expr:
    """An expression at the very start, with former values of 0."""
    return FALSE if expr.op == "prev" else rebuilt(expr, begun) if expr.args else expr


@lru_cache(maxsize=100_000)
def former(expr: Expr) -> tuple[str, ...]:
    """The variables whose former value is in an expression, each once."""
    return (expr.name,) if expr.op == "prev" else tuple(dict.fromkeys(n for e in expr.args for n in former(e)))


@lru_cache(maxsize=100_000)
def renamed_former(expr: Expr, old: str, new: Expr) -> Expr:
    """An expression with `new` in place of the former value of a variable."""
    if expr.op == "prev" and expr.name == old:
        return new
    return rebuilt(expr, lambda e: renamed_former(e, old, new)) if expr.args else expr


@lru_cache(maxsize=100_000)
def leaves(expr: Expr, held: Expr) -> tuple[tuple[Expr, Expr], ...]:
    """The conditions and values of a nested choice, without the branches that keep the value."""
    if expr.op != "if":
        return ()
    condition, then, otherwise = expr.args
    condition = f.truth(condition)
    cases = []
    for guard, branch in ((condition, then), (Expr("not", (condition,)), otherwise)):
        if branch == held:
            continue
        inner = leaves(branch, held)
        cases += [(Expr("and", (guard, c)), v) for c, v in inner] if branch.op == "if" else [(guard, branch)]
    return tuple((simplified(c), v) for c, v in cases)
