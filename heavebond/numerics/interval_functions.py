"""Interval bounds of functions of time, as CasADi functions of both ends of an interval.

Each instruction of a function is replaced by its natural interval extension (R. E. Moore, R. B. Kearfott, M. J. Cloud,
Introduction to Interval Analysis, SIAM, 2009, chapter 5), so that the bounds of many intervals are computed in one call.
Rounding is not directed outwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import casadi as ca

from heavebond.language.symbols import split, stack

RISING = {ca.OP_EXP, ca.OP_ATAN, ca.OP_TANH, ca.OP_SINH, ca.OP_ASINH, ca.OP_ERF, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_SIGN,
          ca.OP_LOG1P, ca.OP_EXPM1, ca.OP_TWICE, ca.OP_ASSIGN}
LARGE = {ca.OP_DIV, ca.OP_INV, ca.OP_LOG, ca.OP_TAN, ca.OP_EXP, ca.OP_SINH, ca.OP_COSH, ca.OP_POW, ca.OP_CONSTPOW}
UNBOUNDED = (ca.SX(-ca.inf), ca.SX(ca.inf))


@dataclass(frozen=True)
class _Range:
    """Bounds of an intermediate result; a point if it does not depend on time. It is `finite` if it cannot
    overflow."""

    low: ca.SX
    high: ca.SX
    moves: bool = True
    finite: bool = True

    @property
    def ends(self) -> tuple[ca.SX, ...]:
        """Both bounds, or the one point."""
        return (self.low, self.high) if self.moves else (self.low,)


def bounds_function(function: ca.Function) -> ca.Function:
    """(begin, end, p) to the lower and upper bounds (m, 1) of a function f(t, p) of m rows on [begin, end]."""
    begin, end, p = ca.SX.sym("begin"), ca.SX.sym("end"), ca.SX.sym("p", function.size1_in(1))
    work: dict[int, _Range] = {}
    low, high = ([ca.SX(0)] * function.size1_out(0) for _ in range(2))
    constants = split(p)
    for k in range(function.n_instructions()):
        op, inputs, outputs = (function.instruction_id(k), function.instruction_input(k), function.instruction_output(k))
        if op == ca.OP_OUTPUT:
            low[outputs[1]], high[outputs[1]] = work[inputs[0]].low, work[inputs[0]].high
        elif op == ca.OP_INPUT:
            work[outputs[0]] = _Range(begin, end) if inputs[0] == 0 else _point(constants[inputs[1]])
        elif op == ca.OP_CONST:
            work[outputs[0]] = _point(ca.SX(function.instruction_constant(k)))
        elif op == ca.OP_CALL:
            work.update(dict.fromkeys(outputs, _Range(*UNBOUNDED, finite=False)))
        else:
            work[outputs[0]] = _bounded(op, [work[i] for i in inputs], len(inputs) == 2 and inputs[0] == inputs[1])
    return ca.Function("bounds", [begin, end, p], [stack(low), stack(high)])


def _point(value: ca.SX) -> _Range:
    return _Range(value, value, False)


def operation(op: int, args: list[ca.SX]) -> ca.SX:
    """One operation of CasADi on scalar expressions; by its number it takes an eighth of the time of Python's operators."""
    return ca.SX.binary(op, *args) if len(args) == 2 else ca.SX.unary(op, args[0])


def _bounded(op: int, args: list[_Range], same: bool) -> _Range:
    a, b = args[0], args[-1]
    if not a.moves and not b.moves:
        value = operation(op, [r.low for r in args])
        return _Range(value, value, False, a.finite and b.finite and op not in LARGE)
    finite = a.finite and b.finite and op not in LARGE
    low, high = _ends(op, a, b, same)
    return _Range(low, high, True, finite and low is not UNBOUNDED[0])


def _ends(op: int, a: _Range, b: _Range, same: bool) -> tuple[ca.SX, ca.SX]:
    al, ah, bl, bh = a.low, a.high, b.low, b.high
    if op in RISING:
        return ca.SX.unary(op, al), ca.SX.unary(op, ah)
    if op == ca.OP_ADD:
        return operation(op, [al, bl]), operation(op, [ah, bh])
    if op == ca.OP_SUB:
        return (ca.SX(0), ca.SX(0)) if same else (operation(op, [al, bh]), operation(op, [ah, bl]))
    if op == ca.OP_NEG:
        return operation(op, [ah]), operation(op, [al])
    if op == ca.OP_SQ or (op == ca.OP_MUL and same):
        return _even(a, lambda x: operation(ca.OP_MUL, [x, x]))
    if op == ca.OP_MUL:
        return _product(a, b)
    if op in (ca.OP_DIV, ca.OP_INV):
        one = _point(ca.SX(1))
        numerator, divisor = (one, a) if op == ca.OP_INV else (a, b)
        one_sign = ca.logic_or(divisor.low > 0, divisor.high < 0)
        low, high = (ca.if_else(one_sign, 1 / end, bound) for end, bound in ((divisor.high, -ca.inf), (divisor.low, ca.inf)))
        return _product(numerator, _Range(low, high, True, False))
    if op in (ca.OP_FMIN, ca.OP_FMAX):
        return ca.SX.binary(op, al, bl), ca.SX.binary(op, ah, bh)
    if op == ca.OP_FABS:
        return _even(a, ca.fabs)
    if op == ca.OP_COSH:
        return _even(a, ca.cosh)
    if op == ca.OP_SQRT:
        return ca.sqrt(ca.fmax(al, 0)), ca.sqrt(ca.fmax(ah, 0))
    if op == ca.OP_LOG:
        return ca.if_else(al > 0, ca.log(ca.fmax(al, 1e-300)), -ca.inf), ca.log(ca.fmax(ah, 1e-300))
    if op in (ca.OP_SIN, ca.OP_COS):
        return _sine(al, ah, ca.pi / 2 if op == ca.OP_SIN else 0.0, ca.sin if op == ca.OP_SIN else ca.cos)
    if op in (ca.OP_POW, ca.OP_CONSTPOW):
        return _power(a, b)
    if op == ca.OP_ASIN:
        return ca.asin(ca.fmax(al, -1)), ca.asin(ca.fmin(ah, 1))
    if op == ca.OP_ACOS:
        return ca.acos(ca.fmin(ah, 1)), ca.acos(ca.fmax(al, -1))
    if op == ca.OP_ATAN2:
        return _angle(a, b)
    if op == ca.OP_TAN:
        same_branch = ca.floor(al / ca.pi + 0.5) == ca.floor(ah / ca.pi + 0.5)
        return ca.if_else(same_branch, ca.tan(al), -ca.inf), ca.if_else(same_branch, ca.tan(ah), ca.inf)
    return _truth(op, a, b)


def _truth(op: int, a: _Range, b: _Range) -> tuple[ca.SX, ca.SX]:
    """Comparisons, logic and conditional values; no bound for anything else."""
    al, ah, bl, bh = a.low, a.high, b.low, b.high
    if op == ca.OP_LT:
        return ah < bl, al < bh
    if op == ca.OP_LE:
        return ah <= bl, al <= bh
    if op in (ca.OP_EQ, ca.OP_NE):
        all_equal, some_equal = ca.logic_and(al == bh, ah == bl), ca.logic_and(al <= bh, bl <= ah)
        return (all_equal, some_equal) if op == ca.OP_EQ else (1 - some_equal, 1 - all_equal)
    if op == ca.OP_NOT:
        return 1 - ah, 1 - al
    if op == ca.OP_AND:
        return ca.fmin(al, bl), ca.fmin(ah, bh)
    if op == ca.OP_OR:
        return ca.fmax(al, bl), ca.fmax(ah, bh)
    if op == ca.OP_IF_ELSE_ZERO:
        certain, never = al != 0, ca.logic_and(al == 0, ah == 0)
        return (ca.if_else(certain, bl, ca.if_else(never, 0, ca.fmin(bl, 0))),
                ca.if_else(certain, bh, ca.if_else(never, 0, ca.fmax(bh, 0))))
    return UNBOUNDED


def _even(a: _Range, of: Callable[[ca.SX], ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Bounds of an even function that rises above zero."""
    under, over = operation(ca.OP_NEG, [a.high]), operation(ca.OP_NEG, [a.low])
    least = operation(ca.OP_FMAX, [operation(ca.OP_FMAX, [a.low, under]), ca.SX(0)])
    return of(least), of(operation(ca.OP_FMAX, [over, a.high]))


def _product(a: _Range, b: _Range) -> tuple[ca.SX, ca.SX]:
    def times(x: ca.SX, y: ca.SX) -> ca.SX:
        # 0 * inf is 0: an infinite bound belongs to a value that is finite
        product = operation(ca.OP_MUL, [x, y])
        for factor, other in ((x, b), (y, a)):
            if not other.finite:
                product = operation(ca.OP_IF_ELSE_ZERO, [operation(ca.OP_NE, [factor, ca.SX(0)]), product])
        return product

    corners = [times(x, y) for x in a.ends for y in b.ends]
    return (reduce(lambda x, y: operation(ca.OP_FMIN, [x, y]), corners),
            reduce(lambda x, y: operation(ca.OP_FMAX, [x, y]), corners))


def _sine(low: ca.SX, high: ca.SX, peak: float, of: Callable[[ca.SX], ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Bounds of a sine of period 2 pi that is highest at `peak`."""
    at = of(low), of(high)

    def reaches(phase: float) -> ca.SX:
        return ca.ceil((low - phase) / (2 * ca.pi)) <= ca.floor((high - phase) / (2 * ca.pi))

    return ca.if_else(reaches(peak + ca.pi), -1, ca.fmin(*at)), ca.if_else(reaches(peak), 1, ca.fmax(*at))


def _angle(y: _Range, x: _Range) -> tuple[ca.SX, ca.SX]:
    """Bounds of atan2(y, x): the angles of the corners, unless the range contains the origin or the jump at negative x."""
    corners = [ca.atan2(v, u) for v in y.ends for u in x.ends]
    jumps = ca.logic_and(x.low <= 0, ca.logic_and(y.low <= 0, y.high >= 0))
    return ca.if_else(jumps, -ca.pi, reduce(ca.fmin, corners)), ca.if_else(jumps, ca.pi, reduce(ca.fmax, corners))


def _power(a: _Range, b: _Range) -> tuple[ca.SX, ca.SX]:
    exponent = float(b.low) if b.low.is_constant() and not b.moves else None
    if exponent is not None and exponent == int(exponent) and exponent > 0:
        if int(exponent) % 2 == 0:
            return _even(a, lambda x: x ** exponent)
        return a.low ** exponent, a.high ** exponent
    # of a base above zero a power is monotone in the base and in the exponent
    corners = [ca.fmax(x, 1e-300) ** y for x in (a.low, a.high) for y in b.ends]
    low, high = reduce(ca.fmin, corners), reduce(ca.fmax, corners)
    return ca.if_else(a.low > 0, low, -ca.inf), ca.if_else(a.low > 0, high, ca.inf)
