"""Conversion of conditions of SIDOPS to conditions of events, which change from false to true.

Branches of `code` that end themselves: `hit = time >= t_hit; if hit then t_hit = time + h; x = y; end`.
Their condition holds at an instant only, because it depends, through other variables, on the assignments of the branch.
The assigned variables are held and set by an event, whose condition must be written with the values before the instant.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, lru_cache

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import keeps, names, rebuilt, simplified, triggers
from heavebond.import_20sim.component import Component
from heavebond.import_20sim.sidops_tree import Expr

WHOLE = 0.5  # tolerance for whole numbers
COMPARISONS = {"==", "!=", "<", ">", "<=", ">="}
CLOSE = 1e-9  # tolerance for continuous values


def moves(component: Component, expr: Expr) -> bool:
    """Whether a value changes between events."""
    if expr.op == "name" and expr.name != "pi":
        item = component.items.get(expr.name)
        return item is None or item.kind not in ("parameter", "held")
    return any(moves(component, e) for e in expr.args)


def passed(component: Component, assigned: Mapping[str, Expr], expr: Expr) -> Expr:
    """A condition of an event in which equality of moving values becomes a tolerance: 0.5 for whole numbers, and for
    continuous values the tolerance of equality, for example of a limit that has been reached. `assigned` are values by
    variable that are not yet among the equations. A comparison of a number with a variable that takes one of several
    numbers, such as the number of a region, becomes the conditions for these, which change continuously."""
    if expr.op in COMPARISONS and (chosen := _by_choice(component, assigned, expr)) is not None:
        return passed(component, assigned, chosen)
    if expr.op in ("==", "!=") and any(moves(component, e) for e in expr.args):
        left, right = expr.args
        within = CLOSE if any(_continuous(component, assigned, e, ()) for e in expr.args) else WHOLE
        near = Expr("<", (f.call("abs", f.add(left, f.negative(right))), f.number(within)))
        return near if expr.op == "==" else Expr("not", (near,))
    return rebuilt(expr, lambda e: passed(component, assigned, e))


def _by_choice(component: Component, assigned: Mapping[str, Expr], expr: Expr) -> Expr | None:
    """A comparison of a number with a variable that is chosen among numbers, as a condition of the choice."""
    left, right = expr.args
    variable, number = (left, right) if right.op == "number" else (right, left)
    item = component.items.get(variable.name) if variable.op == "name" else None
    if number.op != "number" or item is None or item.kind not in ("variable", "out"):
        return None
    value = assigned.get(variable.name) or next((b for a, b, _ in component.equations if a == variable), variable)
    if value.op != "if" or not _all_numbers(value) or triggers(value) or variable.name in names(value):
        return None

    def condition(e: Expr) -> Expr:
        if e.op == "number":
            return Expr(expr.op, (e, right) if variable is left else (left, e))
        first, then, otherwise = e.args[0], condition(e.args[1]), condition(e.args[2])
        return Expr("or", (Expr("and", (first, then)), Expr("and", (Expr("not", (first,)), otherwise))))

    choice_condition = simplified(condition(value))
    return None if choice_condition.op == "number" else choice_condition


def _all_numbers(expr: Expr) -> bool:
    return expr.op == "number" or (expr.op == "if" and all(map(_all_numbers, expr.args[1:])))


def _continuous(component: Component, assigned: Mapping[str, Expr], expr: Expr, visited: tuple[str, ...]) -> bool:
    """True if a value follows the time, a state or a port other than through conditions; inputs are assumed to be whole
    numbers.
    """
    if expr.op in f.TRUTHS:
        return False
    if expr.op in ("name", "prev"):
        item = component.items.get(expr.name)
        if item is None:
            return expr.name != "pi"  # the time, or a quantity of a port
        if item.kind not in ("variable", "out") or expr.name in visited:
            return False
        formulas = [right for left, right, _ in component.equations if left == f.name(expr.name)]
        formulas += [assigned[expr.name]] if expr.name in assigned else []
        return expr.name in component.initial or any(_continuous(component, assigned, e, (*visited, expr.name))
                                                     for e in formulas)
    return any(_continuous(component, assigned, e, visited) for e in (expr.args[1:] if expr.op == "if" else expr.args))


# -- branches that end themselves ---------------------------------------------------------------------------------------
def with_conditions_before(values: Mapping[str, Expr]) -> dict[str, Expr]:
    """The values assigned by branches that end themselves, by variable, with their conditions written with the values
    before the instant. If the condition of a variable depends on the variable itself through others, it was read
    before its assignment."""
    flags: dict[str, Expr] = {}
    for name, value in values.items():
        conditions = _conditions(value)
        if conditions and keeps(value, name) and not any(keeps(c, name) for c in conditions):
            read = {n for c in conditions for n in _reached(c, values)}
            flags |= {n: values[n] for n in read if n in values and n != name and name in _reached(values[n], values)}

    @cache
    def written_out(expr: Expr) -> Expr:
        if expr.op == "name" and expr.name in flags:
            return flags[expr.name]
        return rebuilt(expr, written_out) if expr.args else expr

    @cache
    def change(expr: Expr) -> Expr:
        if expr.op != "if":
            return expr
        return Expr("if", (written_out(expr.args[0]), *map(change, expr.args[1:])), line=expr.line)

    rewritten = {name: change(value) for name, value in values.items() if name not in flags} if flags else {}
    return {name: simplified(value) for name, value in rewritten.items() if value != values[name]}


@lru_cache(maxsize=100_000)
def _conditions(value: Expr) -> tuple[Expr, ...]:
    """The conditions of a nested choice, each once: branches share their parts."""
    if value.op != "if":
        return ()
    condition, *branches = value.args
    return tuple(dict.fromkeys([condition, *(c for branch in branches for c in _conditions(branch))]))


def _reached(expr: Expr, values: Mapping[str, Expr]) -> set[str]:
    """The variables on which an expression depends."""
    visited, front = set[str](), [*names(expr)]
    while front:
        name = front.pop()
        if name not in visited:
            visited.add(name)
            front += names(values[name]) if name in values and not keeps(values[name], name) else ()
    return visited
