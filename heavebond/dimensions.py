"""The dimension of every expression: the first law of a component, and the check of every formula in a diagram."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from heavebond.expression import (
    Binary,
    Call,
    Compare,
    Equation,
    Expr,
    ExpressionProblem,
    Logic,
    Name,
    Negative,
    Not,
    Number,
    SumOver,
    constant,
)
from heavebond.units import ONE, Dimension, dimension_text, times

ANY = None  # a bare 0 fits any unit
TRUTH: Dimension = (("truth", Fraction(1)),)
SECOND: Dimension = (("s", Fraction(1)),)
Lookup = Callable[[Name], Dimension]

_DIMENSIONLESS = {"exp", "log", "sin", "cos", "tan", "tanh", "asin", "acos", "atan"}


def check_equation(equation: Equation, lookup: Lookup) -> None:
    """Both sides agree; raises ExpressionProblem that names the two units."""
    left, right = dimension(equation.left, lookup), dimension(equation.right, lookup)
    if left is not ANY and right is not ANY and left != right:
        raise ExpressionProblem("units-differ", f"the left side is in {_text(left)}, the right side in {_text(right)}",
                                _start(equation.right))


def dimension(expr: Expr, lookup: Lookup) -> Dimension | None:
    """The dimension of `expr`; ANY for a bare 0. `lookup` gives that of a name; raises ExpressionProblem."""
    if isinstance(expr, Number):
        if expr.unit is not None:
            return expr.unit.dimension
        return ANY if expr.value == 0 else ONE
    if isinstance(expr, Name):
        for part in expr.parts:
            if not isinstance(part, str):
                _need(ONE, part, lookup, "an index")
        return lookup(expr)
    if isinstance(expr, Negative):
        return dimension(expr.operand, lookup)
    if isinstance(expr, Binary):
        return _binary(expr, lookup)
    if isinstance(expr, Call):
        return _call(expr, lookup)
    if isinstance(expr, SumOver):
        return dimension(expr.body, lambda name: ONE if name.text == expr.index else lookup(name))
    return _truth(expr, lookup)


def _binary(expr: Binary, lookup: Lookup) -> Dimension | None:
    if expr.op == "**":
        return _power(expr, lookup)
    left, right = dimension(expr.left, lookup), dimension(expr.right, lookup)
    for side, found in ((expr.left, left), (expr.right, right)):
        if found == TRUTH:
            raise ExpressionProblem("units-truth", "a comparison is no number", _start(side),
                                    hint="Use if_else(condition, a, b).")
    if expr.op in "+-":
        return _same((expr.left, left), (expr.right, right), f"'{expr.op}'", expr.column)
    if left is ANY or right is ANY:
        return ANY
    return times(left, right, 1 if expr.op == "*" else -1)


def _power(expr: Binary, lookup: Lookup) -> Dimension | None:
    base = dimension(expr.left, lookup)
    exponent = constant(expr.right)
    if exponent is None:
        _need(ONE, expr.right, lookup, "an exponent")
        if base not in (ONE, ANY):
            raise ExpressionProblem("units-power", f"a base in {_text(base)} needs a plain number as exponent",
                                    expr.column, 2, "Divide the base by a reference value, as in (p/p_0)**n.")
        return base
    if base is ANY:
        return ANY
    return times(ONE, base, Fraction(exponent).limit_denominator(1000))


def _call(expr: Call, lookup: Lookup) -> Dimension | None:
    name, args = expr.function, expr.args
    if name in _DIMENSIONLESS:
        _need(ONE, args[0], lookup, f"the argument of {name}")
        return ONE
    if name == "uniform":
        for arg in args:
            _need(ONE, arg, lookup, "the argument of uniform")
        return ONE
    first = dimension(args[0], lookup)
    if name == "der":
        return ANY if first is ANY else times(first, SECOND, -1)
    if name == "sqrt":
        return ANY if first is ANY else times(ONE, first, Fraction(1, 2))
    if name in ("abs", "sum"):
        return first
    if name == "sign":
        return ONE
    if name == "if_else":
        _need(TRUTH, args[0], lookup, "the first argument of if_else")
        return _same((args[1], dimension(args[1], lookup)), (args[2], dimension(args[2], lookup)), "if_else",
                     expr.column)
    common: Dimension | None = first
    for arg in args[1:]:
        common = _same((args[0], common), (arg, dimension(arg, lookup)), name, expr.column)
    if name == "smooth_sign":
        return ONE
    if name == "signed_sqrt":
        return ANY if common is ANY else times(ONE, common, Fraction(1, 2))
    return common


def _truth(expr: Compare | Logic | Not, lookup: Lookup) -> Dimension:
    if isinstance(expr, Compare):
        _same((expr.left, dimension(expr.left, lookup)), (expr.right, dimension(expr.right, lookup)),
              f"'{expr.op}'", expr.column)
        return TRUTH
    for operand in (expr.operand,) if isinstance(expr, Not) else (expr.left, expr.right):
        _need(TRUTH, operand, lookup, "and, or, not")
    return TRUTH


def _same(left: tuple[Expr, Dimension | None], right: tuple[Expr, Dimension | None], where: str,
          column: int) -> Dimension | None:
    (_, a), (_, b) = left, right
    if a is ANY:
        return b
    if b is not ANY and a != b:
        raise ExpressionProblem("units-differ", f"{where} joins {_text(a)} and {_text(b)}", column, len(where) - 2)
    return a


def _need(wanted: Dimension, expr: Expr, lookup: Lookup, what: str) -> None:
    found = dimension(expr, lookup)
    if found is not ANY and found != wanted:
        raise ExpressionProblem("units-argument", f"{what} must be {_text(wanted)}, this is {_text(found)}",
                                _start(expr))


def _text(found: Dimension | None) -> str:
    if found == TRUTH:
        return "a comparison"
    return "a number without unit" if found in (ONE, ANY) else dimension_text(found or ONE)


def _start(expr: Expr) -> int:
    if isinstance(expr, (Binary, Compare, Logic)):
        return _start(expr.left)
    return expr.column
