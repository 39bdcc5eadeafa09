"""Expressions that are longer or nested more deeply than the formula language accepts, with variables for their parts."""

from __future__ import annotations

from functools import lru_cache

from heavebond.core.limits import BRACKETS, OPERATIONS
from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import rebuilt
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.sidops_tree import Expr

LARGEST, PART = 1500, 40  # nodes of an expression, and of a part of a larger one; products of many matrices repeat parts


def split_deep(made: Component) -> None:
    """Give the inner parts of too large expressions of a component variables of their own."""
    given, made.equations = made.equations, []
    whole = [(left, _shallow(made, left.name if left.op == "name" else "sum", right), comment)
             for left, right, comment in given]
    made.equations += whole
    for event in made.events.values():
        event.then = {name: _shallow(made, name, value) for name, value in event.then.items()}


def _shallow(made: Component, target: str, expr: Expr) -> Expr:
    large = expr.size > LARGEST
    if not large and _depth(expr) < OPERATIONS // 2 and _brackets(expr) < BRACKETS - 2:
        return expr
    inner = _small if large else _shallow
    return rebuilt(expr, lambda e: _part(made, target, inner(made, target, e), large))


def _small(made: Component, target: str, expr: Expr) -> Expr:
    """An expression whose parts of some size are variables."""
    return rebuilt(expr, lambda e: _part(made, target, _small(made, target, e), True)) if expr.size > PART else expr


def _part(made: Component, target: str, expr: Expr, large: bool) -> Expr:
    """A variable for an expression that is large, or half as deep as is possible."""
    if expr.op in f.TRUTHS or (expr.size <= PART if large else _brackets(expr) < BRACKETS // 2 and
                               _depth(expr) < OPERATIONS // 4):
        return expr
    known = next((left for left, right, _ in made.equations if right == expr and left.op == "name"), None)
    if known is not None:
        return known
    name = made.fresh(f"{target.replace('.', '_')}_part")
    made.items[name] = Item(name, "variable", "", f"part of {target}")
    made.equations.append((f.name(name), expr, ""))
    return f.name(name)


def _brackets(expr: Expr) -> int:
    """How deep the brackets of a text are nested."""
    depth = most = 0
    for c in f.text(expr):
        depth += (c == "(") - (c == ")")
        most = max(most, depth)
    return most


@lru_cache(maxsize=20_000)
def _depth(expr: Expr) -> int:
    return 1 + max((_depth(e) for e in expr.args), default=0)
