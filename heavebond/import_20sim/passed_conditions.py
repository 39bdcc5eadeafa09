"""Conditions of SIDOPS as conditions of events, which pass from false to true."""

from __future__ import annotations

from collections.abc import Mapping

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import rebuilt
from heavebond.import_20sim.component import Component
from heavebond.import_20sim.sidops_tree import Expr

WHOLE = 0.5  # apart, whole numbers are not equal
CLOSE = 1e-9  # of values that change continuously and count as equal


def moves(made: Component, expr: Expr) -> bool:
    """Whether a value changes between events."""
    if expr.op == "name" and expr.name != "pi":
        item = made.items.get(expr.name)
        return item is None or item.kind not in ("parameter", "held")
    return any(moves(made, e) for e in expr.args)


def passed(made: Component, assigned: Mapping[str, Expr], expr: Expr) -> Expr:
    """A condition of an event, where equality of what moves is nearness: of whole numbers within a half, of what changes
    continuously within what counts as equal, such as a limit that it has reached. `assigned` are values by variable that are
    not yet among the equations."""
    if expr.op in ("==", "!=") and any(moves(made, e) for e in expr.args):
        left, right = expr.args
        within = CLOSE if any(_continuous(made, assigned, e, ()) for e in expr.args) else WHOLE
        near = Expr("<", (f.call("abs", f.add(left, f.negative(right))), f.number(within)))
        return near if expr.op == "==" else Expr("not", (near,))
    return rebuilt(expr, lambda e: passed(made, assigned, e))


def _continuous(made: Component, assigned: Mapping[str, Expr], expr: Expr, seen: tuple[str, ...]) -> bool:
    """Whether a value follows the time, a state or a port other than through conditions; inputs are taken for whole."""
    if expr.op in f.TRUTHS:
        return False
    if expr.op in ("name", "prev"):
        item = made.items.get(expr.name)
        if item is None:
            return expr.name != "pi"  # the time, or a quantity of a port
        if item.kind not in ("variable", "out") or expr.name in seen:
            return False
        formulas = [right for left, right, _ in made.equations if left == f.name(expr.name)]
        formulas += [assigned[expr.name]] if expr.name in assigned else []
        return expr.name in made.initial or any(_continuous(made, assigned, e, (*seen, expr.name)) for e in formulas)
    return any(_continuous(made, assigned, e, seen) for e in (expr.args[1:] if expr.op == "if" else expr.args))
