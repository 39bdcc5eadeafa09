"""Branches of `code` that end themselves: `hit = time >= t_hit; if hit then t_hit = time + h; x = y; end`.

Their condition holds at an instant only, because it depends, through other variables, on the assignments of the branch.
The assigned variables are held and set by an event, whose condition must be written with the values before the instant.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, lru_cache

from heavebond.import_20sim.choices import keeps, names, rebuilt, simplified
from heavebond.import_20sim.sidops_tree import Expr


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
