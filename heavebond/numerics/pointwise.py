"""A function of CasADi at many points of a run."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.equations.buffered import Array, Buffered
from heavebond.numerics.dae import Assembly

AT_ONCE = 50  # points a call: a map over thousands takes longer to make than to evaluate


def evaluated(assembly: Assembly, function: ca.Function, columns: Sequence[Array]) -> list[Array]:
    """Each output (m, 1) of a function of an assembly as (m, N), from the values of its inputs, each (k, N)."""
    n = columns[0].shape[1]
    size = min(n, AT_ONCE)
    many = assembly.once((function.__hash__(), size), lambda: Buffered(function.map(size)))
    outputs = [np.empty((function.numel_out(k), n)) for k in range(function.n_out())]
    for begin in range(0, n, size):
        at = slice(begin, begin + size) if begin + size <= n else \
            np.minimum(np.arange(begin, begin + size), n - 1)  # the last call is filled up with the last point
        for output, values in zip(outputs, many(*(c[:, at] for c in columns)).values(), strict=True):
            output[:, begin:begin + size] = values.reshape((-1, size), order="F")[:, :n - begin]
    return outputs


def missing(assembly: Assembly, unknowns: Sequence[int], columns: Sequence[Array], values: Array) -> NDArray[np.bool_]:
    """True for values (k, N) of unknowns that no equation determines and on which no motion depends."""
    undefined = np.zeros(values.shape, bool)
    for k, j in enumerate(unknowns):
        if j in assembly.reduced.choices.derived and np.isnan(values[k]).any():
            expression = assembly.values(*assembly.arguments)[j]
            undefined[k] = undetermined(assembly, expression, columns, values[k])
    return undefined


def undetermined(assembly: Assembly, expression: ca.SX, columns: Sequence[Array], values: Array) -> NDArray[np.bool_]:
    """Where (N,) an expression in the arguments of an assembly, with these values (N,), is undetermined: no number, as 0/0
    or 0*inf occurs in it."""
    no_number = np.isnan(values)
    pairs = _quotients(expression) if no_number.any() else []
    if not pairs:
        return np.zeros(len(values), bool)
    function = ca.Function("quotients", list(assembly.arguments), [ca.densify(ca.vertcat(*(e for p in pairs for e in p)))])
    quotient_values, = evaluated(assembly, function, columns)
    return np.asarray(no_number & ((quotient_values[::2] == 0) & (quotient_values[1::2] == 0)).any(axis=0))


def _quotients(expression: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    """The numerators and denominators in an expression; for a product with infinity the other factor, and for NaN under a
    condition the opposite condition, twice."""
    quotients, waiting, known = [], [expression], {expression.element_hash()}
    while waiting:
        node = waiting.pop()
        inside = [node.dep(k) for k in range(node.n_dep())]
        if node.is_op(ca.OP_DIV):
            quotients.append((inside[0], inside[1]))
        elif node.is_op(ca.OP_MUL) and any(e.is_constant() and np.isinf(float(e)) for e in inside):
            quotients += [(e, e) for e in inside if not e.is_constant()]
        elif node.is_op(ca.OP_IF_ELSE_ZERO) and _no_number(inside[1]):
            quotients.append((1 - inside[0], 1 - inside[0]))
            inside = inside[:1]
        elif _no_number(node):
            quotients.append((ca.SX(0), ca.SX(0)))
        waiting += [e for e in inside if e.element_hash() not in known]
        known.update(e.element_hash() for e in inside)
    return quotients


def _no_number(expression: ca.SX) -> bool:
    return bool(expression.is_constant() and np.isnan(float(expression)))
