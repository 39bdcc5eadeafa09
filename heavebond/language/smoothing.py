"""Smoothed expressions: the homotopy for laws with zero gradient on one side, such as an open contact.

    max(a, b) -> (a + b + sqrt((a - b)**2 + w**2)) / 2,   min and abs likewise,
    a < b     -> (1 + tanh((b - a) / w)) / 2,             sign(a) -> tanh(a / w).

Each corner has a separate width w, in the unit of a - b; as w tends to zero the expressions tend to the original ones. C.
Chen, O. L. Mangasarian, A class of smoothing functions for nonlinear and mixed complementarity problems, Computational
Optimization and Applications 5 (1996) 97-138, doi:10.1007/BF00249052.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from heavebond.language.symbols import stack

TURNS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS}  # continuous, with a kink
STEPS = {ca.OP_LT, ca.OP_LE, ca.OP_SIGN}  # jump
LOGIC = {ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO}
TWO = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE}


@dataclass(frozen=True)
class SmoothedColumn:
    """A column of expressions with rounded corners, the widths of these (n,) as symbols, and for each corner the
    expression (n,) that is zero at it."""

    column: ca.SX
    widths: ca.SX
    at: ca.SX


def rounded(column: ca.SX, symbols: Sequence[ca.SX]) -> SmoothedColumn:
    """Round every corner of the column (m,) of its symbols."""
    function = ca.Function("column", list(symbols), [column])
    symbol_elements = [ca.vec(s).nz for s in symbols]
    work: dict[int, ca.SX] = {}
    replaced = [ca.SX(0)] * column.numel()
    widths: list[ca.SX] = []
    at: list[ca.SX] = []
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            replaced[outputs[1]] = work[inputs[0]]
        elif op == ca.OP_INPUT:
            work[outputs[0]] = ca.SX(symbol_elements[inputs[0]][inputs[1]])
        elif op == ca.OP_CONST:
            work[outputs[0]] = ca.SX(function.instruction_constant(k))
        else:
            args = [work[i] for i in inputs]
            if op in TURNS | STEPS and not all(a.is_constant() for a in args):
                at.append(args[0] - args[1] if op in TWO else args[0])
                widths.append(ca.SX.sym(f"w{len(widths)}"))
                work[outputs[0]] = _turned(op, args, at[-1], widths[-1])
            else:
                work[outputs[0]] = _operated(op, args)
    return SmoothedColumn(stack(replaced), stack(widths), stack(at))


def _turned(op: int, args: Sequence[ca.SX], off: ca.SX, width: ca.SX) -> ca.SX:
    if op == ca.OP_SIGN:
        return ca.tanh(off / width)
    if op in STEPS:
        return (1 - ca.tanh(off / width)) / 2
    size = ca.sqrt(off**2 + width**2)
    if op == ca.OP_FABS:
        return size
    return (args[0] + args[1] + (size if op == ca.OP_FMAX else -size)) / 2


def _operated(op: int, args: Sequence[ca.SX]) -> ca.SX:
    """The same operation; truth values become shares between 0 and 1."""
    a, b = args[0], args[-1]
    if op in LOGIC:
        return 1 - a if op == ca.OP_NOT else a + b - a * b if op == ca.OP_OR else a * b
    return ca.SX.unary(op, a) if len(args) == 1 else ca.SX.binary(op, a, b)
