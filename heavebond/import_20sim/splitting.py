"""Variables for parts of expressions: parts that exceed the length or nesting of the formula language, and repeated
choices."""

from __future__ import annotations

import re
from functools import lru_cache

from heavebond.core.limits import BRACKETS, OPERATIONS
from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import former, rebuilt, renamed, triggers
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.sidops_tree import Expr

LARGEST, PART = 1500, 40  # nodes of an expression, and of a part of a larger one; products of many matrices repeat parts


REPEATED = 12  # nodes of a repeated expression from which on a variable is worthwhile


def share_repeated(component: Component) -> None:
    """Introduce variables for repeated choices and calls, the largest first."""
    while (expr := _repeated(component)) is not None:
        at = next(k for k, (_, right, _) in enumerate(component.equations) if _holds(right, expr))
        target = component.equations[at][0]
        name = component.fresh(f"{f.text(target.args[0] if target.args else target).replace('.', '_')}_part")
        component.items[name] = Item(name, "variable", "", f"part of {f.text(target)}")
        long, short = f.text(expr), f.name(name)
        component.equations = [(left, _exchanged(right, expr, short), comment)
                               for left, right, comment in component.equations]
        component.equations.insert(at, (short, expr, ""))
        for event in component.events.values():
            event.then = {target_name: _exchanged(value, expr, short) for target_name, value in event.then.items()}
            event.when = {key: text.replace(long, name) for key, text in event.when.items()}  # a call, in its brackets


def read_held(component: Component) -> None:
    """Let equations and events read a held variable directly and not by the output that shows it, which counts as moving."""
    for output, right, _ in list(component.equations):
        if output.op != "name" or right.op != "name" or right.name not in component.items \
                or component.items[right.name].kind != "held":
            continue
        component.equations = [(left, value if left == output else renamed(value, output.name, right), comment)
                               for left, value, comment in component.equations]
        word = re.compile(rf"(?<![\w.]){re.escape(output.name)}(?![\w.])")
        for event in component.events.values():
            event.then = {target: renamed(value, output.name, right) for target, value in event.then.items()}
            event.when = {key: word.sub(right.name, text) for key, text in event.when.items()}


def _repeated(component: Component) -> Expr | None:
    """The largest choice or call in the equations that occurs twice in the component."""
    occurring: set[Expr] = set()
    twice: list[Expr] = []

    def visit(expr: Expr) -> None:
        if expr.op in ("if", "call") and expr.size >= REPEATED and expr.name != "der":
            if expr in occurring:
                twice.append(expr)
                return
            occurring.add(expr)
        for e in expr.args:
            visit(e)

    for _, right, _ in component.equations:
        visit(right)
    repeated = [e for e in dict.fromkeys(twice) if not former(e) and not triggers(e)]
    return max(repeated, key=lambda e: e.size, default=None)


def _holds(expr: Expr, part: Expr) -> bool:
    return expr == part or any(_holds(e, part) for e in expr.args)


def _exchanged(expr: Expr, old: Expr, new: Expr) -> Expr:
    if expr == old:
        return new
    return rebuilt(expr, lambda e: _exchanged(e, old, new)) if expr.size > old.size else expr


def split_deep(component: Component) -> None:
    """Introduce variables for the inner parts of too large expressions of a component."""
    former_equations, component.equations = component.equations, []
    whole = [(left, _shallow(component, left.name if left.op == "name" else "sum", right), comment)
             for left, right, comment in former_equations]
    component.equations += whole
    for event in component.events.values():
        event.then = {name: _shallow(component, name, value) for name, value in event.then.items()}


def _shallow(component: Component, target: str, expr: Expr) -> Expr:
    large = expr.size > LARGEST
    if not large and _depth(expr) < OPERATIONS // 2 and _brackets(expr) < BRACKETS - 2:
        return expr
    inner = _small if large else _shallow
    return rebuilt(expr, lambda e: _part(component, target, inner(component, target, e), large))


def _small(component: Component, target: str, expr: Expr) -> Expr:
    """An expression whose parts of some size are variables."""
    return rebuilt(expr,
                   lambda e: _part(component, target, _small(component, target, e), True)) if expr.size > PART else expr


def _part(component: Component, target: str, expr: Expr, large: bool) -> Expr:
    """A variable for an expression that is large, or half as deep as permitted."""
    if expr.op in f.TRUTHS or (expr.size <= PART if large else _brackets(expr) < BRACKETS // 2 and
                               _depth(expr) < OPERATIONS // 4):
        return expr
    known = next((left for left, right, _ in component.equations if right == expr and left.op == "name"), None)
    if known is not None:
        return known
    name = component.fresh(f"{target.replace('.', '_')}_part")
    component.items[name] = Item(name, "variable", "", f"part of {target}")
    component.equations.append((f.name(name), expr, ""))
    return f.name(name)


def _brackets(expr: Expr) -> int:
    """Nesting depth of the brackets in a text."""
    depth = most = 0
    for c in f.text(expr):
        depth += (c == "(") - (c == ")")
        most = max(most, depth)
    return most


@lru_cache(maxsize=20_000)
def _depth(expr: Expr) -> int:
    return 1 + max((_depth(e) for e in expr.args), default=0)
