"""Runs of 20-sim that do not start at 0: `time` in equations becomes the time since the start plus the start."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import OPPOSITE, rebuilt
from heavebond.import_20sim.evaluate import fold
from heavebond.import_20sim.sidops_tree import Assign, Do, Equations, Expr, For, If, Statement, Submodel, While

INSTANT = {"timeevent": 0, "step": 0, "ramp": 0, "impulse": 0, "frequencyevent": 1}  # index of the argument that is a time


def shift_time(submodel: Submodel, start: float) -> None:
    """Rewrite the equations of a submodel and of those within it in the time since the start, which is given in s.
    Instants that are compared with the time are reduced by the start; elsewhere, `time` is replaced by that time plus
    the start."""
    for section in (submodel.equations, submodel.relations):
        if section is not None:
            _shift(section, start)
    for part in submodel.submodels:
        shift_time(part, start)


def _shift(equations: Equations, start: float) -> None:
    declared = {d.name.lower() for d in (*equations.constants, *equations.parameters, *equations.variables)}
    if "time" not in declared:
        for section in (equations.initial, equations.equations, equations.code):
            section[:] = _statements(section, start)


def _statements(statements: Iterable[Statement], start: float) -> tuple[Statement, ...]:
    shifted_statements: list[Statement] = []
    for s in statements:
        if isinstance(s, Assign):
            shifted_statements.append(replace(s, left=_shifted(s.left, start), right=_shifted(s.right, start)))
        elif isinstance(s, If):
            shifted_statements.append(replace(s, condition=_shifted(s.condition, start), then=_statements(s.then, start),
                                              otherwise=_statements(s.otherwise, start)))
        elif isinstance(s, Do):
            shifted_statements.append(replace(s, call=_shifted(s.call, start)))
        elif isinstance(s, While):
            shifted_statements.append(replace(s, condition=_shifted(s.condition, start), body=_statements(s.body, start)))
        elif isinstance(s, For):
            shifted_statements.append(replace(s, body=_statements(s.body, start)))
    return tuple(shifted_statements)


def _shifted(expr: Expr, start: float) -> Expr:
    if _is_time(expr):
        return Expr("+" if start > 0 else "-", (expr, f.number(abs(start))), line=expr.line)
    if expr.op == "name" and expr.name.lower() == "starttime":
        return f.number(start)
    if expr.op in OPPOSITE and any(map(_is_time, expr.args)):
        return rebuilt(expr, lambda e: e if _is_time(e) else _earlier(_shifted(e, start), start))
    shifted = rebuilt(expr, lambda e: _shifted(e, start))
    at = INSTANT.get(expr.name.lower()) if expr.op == "call" else None
    if at is None or len(shifted.args) <= at:
        return shifted
    args = (*shifted.args[:at], _earlier(shifted.args[at], start), *shifted.args[at + 1:])
    return Expr(shifted.op, args, shifted.name, line=shifted.line)


def _is_time(expr: Expr) -> bool:
    return expr.op == "name" and expr.name.lower() == "time"


def _earlier(instant: Expr, start: float) -> Expr:
    known = fold(instant, {})
    return Expr("-", (instant, f.number(start)), line=instant.line) if known is None else f.number(known - start)
