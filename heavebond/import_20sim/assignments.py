"""Called and assigned quantities of a submodel's statements, and the placeholder for a submodel that is not translated."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import names
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.sidops_tree import Assign, Expr, For, If, Statement, While

EVENTS = {"event", "eventup", "eventdown", "timeevent", "frequencyevent"}


def calls(expr: Expr) -> list[str]:
    """The names of the functions in an expression."""
    return [*([expr.name] if expr.op == "call" else []), *(n for e in expr.args for n in calls(e))]


def derivatives(expr: Expr) -> list[Expr]:
    """The derivatives `der (x)` in an expression of the translation."""
    return [*([expr] if expr.op == "call" and expr.name == "der" else []), *(d for e in expr.args for d in derivatives(e))]


def has_event(expr: Expr) -> bool:
    return any(n.lower() in EVENTS for n in calls(expr))


def make_placeholder(component: Component, assigned_names: Collection[str] = ()) -> None:
    """Constants in place of equations that are not translated: for each output, and for the effort of each port that the
    submodel determines (`given` are the quantities of ports that it assigns); the flow of other ports is 0."""
    component.equations, component.events, component.initial = [], {}, {}
    component.first, component.gives, component.tables, component.requires = {}, {}, {}, []
    component.items = {n: item for n, item in component.items.items() if item.kind not in ("variable", "held")}
    for item in list(component.items.values()):
        if item.kind == "out":
            value, doc = component.fresh(f"{item.name}_value"), f"value of the output {item.name}, which is not computed"
            component.items[value] = Item(value, "parameter", "", doc, 0.0)
            component.equations.append((f.name(item.name), f.name(value), "not translated"))
        elif item.kind == "bond" and f"{item.name}.e" in assigned_names and f"{item.name}.f" not in assigned_names:
            value, doc = component.fresh(f"{item.name}_effort"), f"effort of the port {item.name}, which is not computed"
            component.items[value] = Item(value, "parameter", "W", doc, 0.0)
            component.equations.append((f.name(f"{item.name}.e"), f.name(value), "not translated"))
        elif item.kind == "bond":
            component.equations.append((f.name(f"{item.name}.f"), f.number(0), "not translated"))


def assigned(statement: Statement) -> list[str]:
    """The names of the quantities that a statement assigns."""
    if isinstance(statement, Assign):
        left = statement.left
        return [left.args[0].name if left.op == "index" else left.name] if left.op in ("name", "index") else []
    if isinstance(statement, If):
        return [n for s in (*statement.then, *statement.otherwise) for n in assigned(s)]
    return [n for s in statement.body for n in assigned(s)] if isinstance(statement, (For, While)) else []


def mentioned(statement: Statement) -> set[str]:
    """The names of all quantities in a statement."""
    if isinstance(statement, Assign):
        return {*names(statement.left), *names(statement.right)}
    if isinstance(statement, If):
        return set(names(statement.condition)).union(*map(mentioned, (*statement.then, *statement.otherwise)))
    if isinstance(statement, While):
        return set(names(statement.condition)).union(*map(mentioned, statement.body))
    return set().union(*map(mentioned, statement.body)) if isinstance(statement, For) else set()


def counts(statement: Statement) -> set[str]:
    """The names on which the number of iterations of the loops in a statement depends."""
    if isinstance(statement, If):
        return set().union(*map(counts, (*statement.then, *statement.otherwise)))
    if isinstance(statement, For):
        bounds = (statement.first, statement.last, *([statement.step] if statement.step is not None else []))
        return {n for e in bounds for n in names(e)}.union(*map(counts, statement.body))
    return set().union(*map(counts, statement.body)) if isinstance(statement, While) else set()


def assigned_again(statements: Iterable[Statement]) -> set[str]:
    """The quantities that several statements assign, at least one of them completely or in a branch."""
    assigned_before: set[str] = set()
    again: set[str] = set()
    for statement in statements:
        if isinstance(statement, Assign) and statement.left.op == "index":
            key = {repr(plain(statement.left))}
        else:
            key = set(assigned(statement))
        again |= {k.partition("[")[0] for k in assigned_before & key}
        assigned_before |= key
    return again


def plain(expr: Expr) -> object:
    """An expression without its lines, for comparisons."""
    return (expr.op, expr.name, expr.value, tuple(plain(e) for e in expr.args))
