"""Smoothed expressions: the homotopy for laws with zero gradient on one side, such as an open contact.

    max(a, b) -> (a + b + sqrt((a - b)**2 + w**2)) / 2,   min and abs likewise,
    a < b     -> (1 + tanh((b - a) / w)) / 2,             sign(a) -> tanh(a / w).

Each corner has a separate width w, in the unit of a - b; as w tends to zero the expressions tend to the original ones. C.
Chen, O. L. Mangasarian, A class of smoothing functions for nonlinear and mixed complementarity problems, Computational
Optimization and Applications 5 (1996) 97-138, doi:10.1007/BF00249052.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from heavebond.language.external_functions import opened
from heavebond.language.symbols import stack

TURNS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS}  # continuous, with a kink
STEPS = {ca.OP_LT, ca.OP_LE, ca.OP_SIGN}  # jump
LOGIC = {ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO}
ROUNDING = {ca.OP_FLOOR: -0.5, ca.OP_CEIL: 0.5}  # with the mean error
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
    widths: list[ca.SX] = []
    at: list[ca.SX] = []

    def operate(op: int, args: Sequence[ca.SX]) -> ca.SX:
        if op not in TURNS | STEPS or all(a.is_constant() for a in args):
            a, b = args[0], args[-1]
            if op in LOGIC:
                return 1 - a if op == ca.OP_NOT else a + b - a * b if op == ca.OP_OR else a * b
            return ca.SX.unary(op, a) if len(args) == 1 else ca.SX.binary(op, a, b)
        at.append(args[0] - args[1] if op in TWO else args[0])
        widths.append(ca.SX.sym(f"w{len(widths)}"))
        return _turned(op, args, at[-1], widths[-1])

    return SmoothedColumn(_rebuilt(column, symbols, operate), stack(widths), stack(at))


def without_rounding(column: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
    """The column (m,) with a rounding to whole numbers replaced by its mean, floor(a) -> a - 1/2 and ceil(a) -> a + 1/2, and
    the rounded expressions a. That is the describing function of a quantiser for motions of many steps, a gain of 1 (A.
    Gelb, W. E. Vander Velde, Multiple-Input Describing Functions, 1968, section 2.3)."""
    arguments: list[ca.SX] = []

    def operate(op: int, args: Sequence[ca.SX]) -> ca.SX:
        if op in ROUNDING:
            arguments.append(args[0])
            return args[0] + ROUNDING[op]
        return ca.SX.unary(op, args[0]) if len(args) == 1 else ca.SX.binary(op, *args)

    return _rebuilt(column, [stack(ca.symvar(column))], operate), arguments


def _rebuilt(column: ca.SX, symbols: Sequence[ca.SX], operate: Callable[[int, Sequence[ca.SX]], ca.SX]) -> ca.SX:
    """A column (m,) in its symbols with every operation by `operate`; calls of external functions remain."""
    whole = opened([column])
    if whole.calls:
        results = stack(y for _, symbols_of in whole.calls for y in symbols_of.values())
        again = _rebuilt(stack([*whole.columns, whole.args]), [*symbols, results], operate)
        return whole.closed([again[:column.numel()]], again[column.numel():])[0]
    function = ca.Function("column", list(symbols), [column])
    symbol_elements = [ca.vec(s).nz for s in symbols]
    work: dict[int, ca.SX] = {}
    replaced = [ca.SX(0)] * column.numel()
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
            work[outputs[0]] = operate(op, [work[i] for i in inputs])
    return stack(replaced)


def _turned(op: int, args: Sequence[ca.SX], off: ca.SX, width: ca.SX) -> ca.SX:
    if op == ca.OP_SIGN:
        return ca.tanh(off / width)
    if op in STEPS:
        return (1 - ca.tanh(off / width)) / 2
    size = ca.sqrt(off**2 + width**2)
    if op == ca.OP_FABS:
        return size
    return (args[0] + args[1] + (size if op == ca.OP_FMAX else -size)) / 2
