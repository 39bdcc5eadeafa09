"""Equations of knots: `sum (direct (p.f)) = 0`, `equal (collect (p.e))`, `first (p.e)` over the ends of a port."""

from __future__ import annotations

from collections.abc import Iterator

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.component import Ends
from heavebond.import_20sim.declarations import Symbols
from heavebond.import_20sim.evaluate import each
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.matrices import Matrix
from heavebond.import_20sim.sidops_tree import Assign, Do, Expr


def collected(symbols: Symbols, call: Expr) -> list[tuple[bool, Matrix]]:
    """The elements of `collect (p.e)` or `direct (p.e)`, each with True if it points out."""
    inner = call.args[0].name
    port, _, member = inner.partition(".")
    if port not in symbols.many:
        return [(False, symbols.evaluate(call.args[0]))]
    labels = [(out, f"{name}.{member}" if member else name) for name, out in symbols.many[port]]
    if any(label not in symbols.names for _, label in labels):
        raise Unreadable(call.line, f"'{inner}' is not declared")  # or its declaration cannot be read
    return [(out, symbols.names[label]) for out, label in labels]


def knot_value(symbols: Symbols, expr: Expr) -> Matrix | None:
    """`sum (direct (p.f))`, `first (p.e)` and sums of these, for knots; None for other expressions."""
    name = expr.name.lower() if expr.op == "call" else ""
    if name == "sum" and expr.args and expr.args[0].op == "call" and expr.args[0].name.lower() in ("direct", "collect"):
        directed = expr.args[0].name.lower() == "direct"
        total: Matrix | None = None
        for out, values in collected(symbols, expr.args[0]):
            signed = [[f.negative(e) if out and directed else e for e in row] for row in values]
            total = signed if total is None else each(f.add, total, signed, expr.line)
        return total or [[f.number(0)]]
    if name == "mul" and expr.args and expr.args[0].op == "call" and expr.args[0].name.lower() == "collect":
        factor: Matrix | None = None
        for matrix in [matrix for _, matrix in collected(symbols, expr.args[0])]:
            factor = matrix if factor is None else each(f.multiply, factor, matrix, expr.line)
        return factor or [[f.number(1)]]
    if name == "collect" and expr.args and expr.args[0].name.partition(".")[0] in symbols.many:
        return [row for _, matrix in collected(symbols, expr) for row in matrix] or None
    if name == "first" and expr.args and expr.args[0].name.partition(".")[0] in symbols.many:
        ends_of_port = collected(symbols, expr)
        return ends_of_port[0][1] if ends_of_port else [[f.number(0)]]
    if expr.op in ("+", "-") and (left := knot_value(symbols, expr.args[0])) is not None:
        right = knot_value(symbols, expr.args[1])
        if right is not None:
            return each(lambda a, b: f.add(a, f.negative(b) if expr.op == "-" else b), left, right, expr.line)
    return None


def knot_equations(symbols: Symbols, statement: Assign) -> Iterator[tuple[Matrix, Matrix]]:
    """Both sides of each equation of a statement for a knot; empty for other statements."""
    left, right = statement.left, statement.right
    if left.op == "call" and left.name.lower() == "collect":
        for _, matrix in collected(symbols, left):
            yield matrix, symbols.evaluate(right)
        return
    sides = knot_value(symbols, left) or (knot_value(symbols, right) and symbols.evaluate(left))
    if sides and ((second_value := knot_value(symbols, right)) or right.op == "number"):
        yield sides, second_value or symbols.evaluate(right)


def one_junction(symbols: Symbols) -> tuple[Ends, tuple[str, ...]] | None:
    """The bonds of a knot with the equations of a 1-junction, and its outputs that are the flow; None for others."""
    if not symbols.submodel.knot or list(symbols.many) != ["p"] or symbols.source.code:
        return None
    flows, written = [], []
    for s in symbols.source.equations:
        if isinstance(s, Do) and s.call.name.lower() == "equal":
            written.append(s.call.args[0].args[0].name if s.call.args and s.call.args[0].args else "")
        elif isinstance(s, Assign) and s.left.op == "call" and s.left.name.lower() == "sum" and s.right == f.number(0):
            written.append(s.left.args[0].args[0].name if s.left.args and s.left.args[0].args else "")
        elif isinstance(s, Assign) and s.right.op == "call" and s.right.name.lower() == "first" and \
                s.right.args[0].name == "p.f" and s.left.op == "name":
            flows.append(s.left.name)
        else:
            return None
    ends = [(symbols.component.elements[name], out) for name, out in symbols.many["p"]]
    return (ends, tuple(flows)) if sorted(written) == ["p.e", "p.f"] and len({out for _, out in ends}) == 2 else None
