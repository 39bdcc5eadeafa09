"""Dimensions of expressions: check the units of the equations of components and of the formulas in diagrams."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction

from heavebond.core.units import ONE, Dimension, dimension_text, interval_text, is_generic, times
from heavebond.text.expression import (
    Binary,
    Call,
    Compare,
    Elements,
    Equation,
    Expr,
    ExpressionProblem,
    FunctionCall,
    Logic,
    Name,
    Negative,
    Not,
    Number,
    Slice,
    SumOver,
    children,
    constant,
)

ANY = None  # dimension of a bare 0, which is compatible with any unit
TRUTH: Dimension = (("truth", Fraction(1)),)
SECOND: Dimension = (("s", Fraction(1)),)
Lookup = Callable[[Name], Dimension | None]
LARGEST_EXPONENT = 100

_DIMENSIONLESS = {"exp", "log", "sin", "cos", "tan", "tanh", "asin", "acos", "atan", "floor"}


def check_equation(equation: Equation, lookup: Lookup) -> None:
    """Check that both sides of an equation have the same unit; raises ExpressionProblem with the two units."""
    left, right = number_dimension(equation.left, lookup), number_dimension(equation.right, lookup)
    if left is not ANY and right is not ANY and left != right:
        raise ExpressionProblem("units-differ", f"the left side is {_in(left)}, the right side is {_in(right)}",
                                _start(equation.right), hint="Both sides of an equation have the same unit"
                                + _factor(left, right))


def dimension(expr: Expr, lookup: Lookup) -> Dimension | None:
    """The dimension of `expr`; ANY for a bare 0. `lookup` returns the dimension of a name. Raises ExpressionProblem."""
    if isinstance(expr, Number):
        if expr.unit is not None:
            return expr.unit.dimension
        return ANY if expr.value == 0 else ONE
    if isinstance(expr, Name):
        for part in expr.parts:
            if not isinstance(part, str):
                for bound in (part.low, part.high) if isinstance(part, Slice) else (part,):
                    _need(ONE, bound, lookup, "an index")
        return lookup(expr)
    if isinstance(expr, Negative):
        return number_dimension(expr.operand, lookup)
    if isinstance(expr, Binary):
        if expr.op == "**":
            base = number_dimension(expr.left, lookup)
            exponent = constant(expr.right)
            if exponent is None:
                _need(ONE, expr.right, lookup, "an exponent")
                if base not in (ONE, ANY):
                    raise ExpressionProblem("units-power", f"a base {_in(base)} needs a plain number as exponent",
                                            expr.column, 2, "Divide the base by a reference value, as in (p/p_0)**n.")
                return base
            if base in (ONE, ANY):
                return base
            if not abs(exponent) <= LARGEST_EXPONENT:  # true for NaN too
                raise ExpressionProblem("units-power", f"an exponent of {exponent:g} gives no unit", _start(expr.right), 1,
                                        f"Use an exponent up to {LARGEST_EXPONENT}.")
            return times(ONE, base, Fraction(exponent).limit_denominator(1000))
        left, right = number_dimension(expr.left, lookup), number_dimension(expr.right, lookup)
        if expr.op in "+-":
            return _same((expr.left, left), (expr.right, right), f"'{expr.op}'", expr.column)
        if left is ANY or right is ANY:
            return ANY
        return times(left, right, 1 if expr.op == "*" else -1)
    if isinstance(expr, Call):
        return _call(expr, lookup)
    if isinstance(expr, FunctionCall):
        return _function_call(expr, lookup)
    if isinstance(expr, SumOver):
        return number_dimension(expr.body, lambda name: ONE if name.text == expr.index else lookup(name))
    if isinstance(expr, Elements):
        common, first = ANY, expr.items[0]
        for item in expr.items:
            common = _same((first, common), (item, number_dimension(item, lookup)), "the list", _start(item))
        return common
    assert not isinstance(expr, Slice)  # a slice occurs only as an index of a name
    if isinstance(expr, Compare):
        _same((expr.left, number_dimension(expr.left, lookup)), (expr.right, number_dimension(expr.right, lookup)),
              f"'{expr.op}'", expr.column)
        return TRUTH
    for operand in (expr.operand,) if isinstance(expr, Not) else (expr.left, expr.right):
        _need(TRUTH, operand, lookup, "and, or, not")
    return TRUTH


def number_dimension(expr: Expr, lookup: Lookup) -> Dimension | None:
    """The dimension of a numeric expression; raises ExpressionProblem for a comparison."""
    result = dimension(expr, lookup)
    if result == TRUTH:
        raise ExpressionProblem("units-truth", "a comparison is no number", _start(expr),
                                hint="Write `if_else(a > b, x, y)`.")
    return result


def counted(expr: Expr, counts: Callable[[Name], str]) -> str:
    """The counted quantity of an expression: `angle`, `cycles`, or an empty text if it is unknown.

    `counts` returns the counted quantity of a name. The absolute value, the negative, sums and differences inherit it.
    The counted quantity of a product is unknown, because a product may convert between them: w/(2*pi).
    """
    if isinstance(expr, Name):
        return counts(expr)
    if isinstance(expr, Negative):
        return counted(expr.operand, counts)
    if isinstance(expr, Call) and expr.function == "abs":
        return counted(expr.args[0], counts)
    if isinstance(expr, Binary) and expr.op in "+-":
        return counted(expr.left, counts) or counted(expr.right, counts)
    return ""


def _call(expr: Call, lookup: Lookup) -> Dimension | None:
    name, args = expr.function, expr.args
    if name in _DIMENSIONLESS:
        _need(ONE, args[0], lookup, f"the argument of {name}")
        return ONE
    if name == "uniform":
        for arg in args:
            _need(ONE, arg, lookup, "the argument of uniform")
        return ONE
    if name == "if_else":
        _need(TRUTH, args[0], lookup, "the first argument of if_else")
        return _same((args[1], number_dimension(args[1], lookup)), (args[2], number_dimension(args[2], lookup)),
                     "if_else", expr.column)
    first = number_dimension(args[0], lookup)
    if name == "der":
        return ANY if first is ANY else times(first, SECOND, -1)
    if name == "sqrt":
        return ANY if first is ANY else times(ONE, first, Fraction(1, 2))
    if name in ("abs", "sum", "transpose"):
        return first
    if name in ("symmetric", "definite", "semidefinite"):
        return TRUTH
    if name == "sign":
        return ONE
    if name in ("dot", "cross"):
        second = number_dimension(args[1], lookup)
        return ANY if first is ANY or second is ANY else times(first, second)
    if name == "least_distance":
        limited = number_dimension(args[1], lookup)
        _same((args[0], first), (args[4], number_dimension(args[4], lookup)), name, expr.column)
        for arg in args[2:4]:
            limited = _same((args[1], limited), (arg, number_dimension(arg, lookup)), name, expr.column)
        return ANY if first is ANY or limited is ANY else times(limited, first, -1)
    common: Dimension | None = first
    for arg in args[1:]:
        common = _same((args[0], common), (arg, number_dimension(arg, lookup)), name, expr.column)
    if name in ("smooth_sign", "atan2"):
        return ONE
    if name == "signed_sqrt":
        return ANY if common is ANY else times(ONE, common, Fraction(1, 2))
    return common


def _function_call(expr: FunctionCall, lookup: Lookup) -> Dimension | None:
    """The dimension of the output of a function call; each argument must have the unit of its input.

    The first argument with a generic unit (`$U`) determines this unit for the call. Generic units of the caller are
    independent of the generic units of the function.
    """
    units: dict[str, Dimension] = {}
    for arg, wanted in zip(expr.args, expr.function.inputs.values(), strict=True):
        argument_dimension = number_dimension(arg, lookup)
        known, unsolved = _put_in(wanted.unit.dimension, units)
        if argument_dimension is ANY:
            continue
        if len(unsolved) == 1:
            (base, power), = unsolved
            units[base] = times(ONE, times(argument_dimension, known, -1), 1 / power)
        elif not unsolved and argument_dimension != known:
            raise ExpressionProblem("units-argument",
                                    f"argument {wanted.name} of {expr.function.name} must be "
                                    f"{_in(known)}; this is {_in(argument_dimension)}", _start(arg),
                                    hint=f"{wanted.name} is "
                                    f"{wanted.doc or f'an input of {expr.function.name}'}" + _factor(known,
                                                                                                     argument_dimension))
    known, unsolved = _put_in(expr.function.outputs[expr.output].unit.dimension, units)
    return ANY if unsolved else known


def _put_in(declared: Dimension, units: Mapping[str, Dimension]) -> tuple[Dimension, list[tuple[str, Fraction]]]:
    """Substitute known generic units in a declared dimension; return the result and the unknown units with their powers."""
    if not is_generic(declared):
        return declared, []
    known, unsolved = ONE, []
    for base, power in declared:
        if base.startswith("$") and base not in units:
            unsolved.append((base, power))
        else:
            known = times(known, units.get(base, ((base, Fraction(1)),)), power)
    return known, unsolved


def _same(left: tuple[Expr, Dimension | None], right: tuple[Expr, Dimension | None], where: str,
          column: int) -> Dimension | None:
    (_, a), (_, b) = left, right
    if a is ANY:
        return b
    if b is not ANY and a != b:
        raise ExpressionProblem("units-differ", f"{where} joins {_text(a)} and {_text(b)}", column,
                                max(1, len(where.strip("'"))), "Both must have the same unit" + _factor(a, b))
    return a


def _need(wanted: Dimension, expr: Expr, lookup: Lookup, subject: str) -> None:
    actual = dimension(expr, lookup)
    if actual is not ANY and actual != wanted:
        hint = "Write a comparison, as in `a > b`." if wanted == TRUTH else "Write a comparison where one is needed." \
            if actual == TRUTH else f"Divide it by a quantity in {dimension_text(actual)}."
        raise ExpressionProblem("units-argument", f"{subject} must be {_in(wanted)}; this is {_in(actual)}", _start(expr),
                                hint=hint)


def _text(actual: Dimension | None) -> str:
    if actual == TRUTH:
        return "a comparison"
    return "a number without unit" if actual in (ONE, ANY) else dimension_text(actual or ONE)


def _in(actual: Dimension | None) -> str:
    return _text(actual) if actual in (ONE, ANY, TRUTH) else f"in {_text(actual)}"


def _factor(a: Dimension | None, b: Dimension | None) -> str:
    """The end of a message, `; they differ by a factor in s.`: it suggests a missing time, area or g."""
    if TRUTH in (a, b):
        return "."
    ratio = times(a or ONE, b or ONE, -1)
    return f"; they differ by a factor in {dimension_text(ratio if _simple(ratio) else times(ONE, ratio, -1))}."


def _simple(ratio: Dimension) -> bool:
    return sum(power > 0 for _, power in ratio) >= sum(power < 0 for _, power in ratio)


def _start(expr: Expr) -> int:
    if isinstance(expr, (Binary, Compare, Logic)):
        return _start(expr.left)
    return expr.column


# -- origins of temperatures ---------------------------------------------------------------------------------------
KELVIN: Dimension = (("K", Fraction(1)),)
INTERVALS = 200.0  # K; a larger number in K that is subtracted from a temperature may be a temperature itself
_WIDTHS = {"deviation", "equivalent_range"}  # functions of a time series whose value does not depend on the origin


def origins(expr: Expr, lookup: Callable[[Name], float | None]) -> float | None:
    """The weight of the temperature origin in `expr`: the increase of its value in K if the origin is lowered by 1 K.

    The weight is 1 for a temperature, 0 for a difference, 2 for a sum of two temperatures, and None if it is unknown.
    `lookup` returns the weight of a name. The weight of a number in K is unknown: it may be a temperature or a difference.
    """
    if isinstance(expr, Number):
        if expr.unit is None or expr.unit.dimension != KELVIN:
            return 0.0
        return 1.0 if expr.unit.offset else None
    if isinstance(expr, Name):
        return lookup(expr)
    if isinstance(expr, Negative):
        inner = origins(expr.operand, lookup)
        return None if inner is None else -inner
    if isinstance(expr, Binary):
        left, right = origins(expr.left, lookup), origins(expr.right, lookup)
        if expr.op in "+-":
            # a number in K that is added to a temperature or a difference is an interval
            left, right = (0.0 if w is None and opposite is not None and _in_kelvin(e) else w
                           for e, w, opposite in ((expr.left, left, right), (expr.right, right, left)))
            return None if left is None or right is None else left + right if expr.op == "+" else left - right
        if left == 0 and right == 0:
            return 0.0
        factor = constant(expr.right) if right == 0 else None
        if expr.op in "*/" and left is not None and factor:
            return left * factor if expr.op == "*" else left / factor
        factor = constant(expr.left) if left == 0 else None
        return right * factor if expr.op == "*" and right is not None and factor is not None else None
    weights = [origins(child, lookup) for child in children(expr)]
    if isinstance(expr, Call):
        if expr.function in ("der", "sign", *_WIDTHS):
            return 0.0
        parts = children(expr)
        if expr.function == "if_else":
            parts, weights = parts[1:], weights[1:]
        # a number in K beside temperatures or differences is one of these
        decided = [w for w, child in zip(weights, parts, strict=True) if w is not None or not _in_kelvin(child)]
        weights = decided or weights
        same = bool(weights) and len(set(weights)) == 1
        if same and (weights[0] == 0 or expr.function in _SAME_ORIGIN):
            return weights[0]
        return None
    return 0.0 if isinstance(expr, FunctionCall) and all(weight == 0 for weight in weights) else None


_SAME_ORIGIN = {"min", "max", "if_else", "abs", "smooth_abs", "mean", "rms", "peak", "final", "highest", "lowest", "largest",
                "ref", "last"}
_LINEAR = {"mean", "final", "last", "ref", "der", "sum", "if_else"}


def as_interval(expr: Expr) -> Expr:
    """Convert temperatures in an expression to intervals: 0.3 degC becomes 0.3 K."""
    if isinstance(expr, Number) and expr.unit is not None and expr.unit.offset:
        return Number(expr.value - expr.unit.offset, expr.unit.of_intervals, expr.column)
    if isinstance(expr, Binary):
        return Binary(expr.op, as_interval(expr.left), as_interval(expr.right), expr.column)
    return Negative(as_interval(expr.operand), expr.column) if isinstance(expr, Negative) else expr


def has_origin(expr: Expr) -> bool:
    """True if an expression contains a quantity in a unit with an offset, such as 20 degC."""
    if isinstance(expr, Number):
        return expr.unit is not None and expr.unit.offset != 0
    return not isinstance(expr, Name) and any(has_origin(child) for child in children(expr))


def check_origins(expr: Expr, lookup: Callable[[Name], float | None], *, shown: bool = False) -> float | None:
    """Compute `origins` of an expression and check its use of temperatures.

    Raises ExpressionProblem for a sum of temperatures in degC, for a product of a temperature in degC and a variable, and
    for a comparison of a temperature with a difference. Expressions without a quantity in degC may add absolute
    temperatures, unless they are `shown` in degC.
    """
    weight = origins(expr, lookup)
    if not (shown or has_origin(expr)):
        return weight
    if weight is not None and weight not in (0.0, 1.0):
        raise ExpressionProblem("unit-offset", "temperatures are added, each with a separate origin", _start(expr), 1,
                                "Write an interval in K, as in `20 degC + 5 K`; the mean of two is `(a.T + b.T)/2`.")
    for part in _parts(expr):
        for operand in _own_origins(part) if has_origin(part) else ():
            if isinstance(operand, (Binary, Negative)) and (of := origins(operand, lookup)) is not None and of not in (0, 1):
                raise ExpressionProblem("unit-offset", "a temperature is subtracted from a difference" if of == -1 else
                                        "temperatures are added, each with a separate origin", _start(operand), 1,
                                        "Write an interval in K, as in `a.T - b.T - 30 K`.")
        if isinstance(part, Binary) and part.op == "*":
            for number, factor in ((part.left, part.right), (part.right, part.left)):
                if isinstance(number, Number) and has_origin(number) and constant(factor) is None:
                    raise ExpressionProblem("unit-offset", "a factor of a temperature counts from absolute zero",
                                            number.column, 1, f"Write an interval: {_interval(number)}.")
        if isinstance(part, Binary) and part.op == "/" and isinstance(part.right, Number) and has_origin(part.right) and \
                origins(part.left, lookup) == 0:
            raise ExpressionProblem("unit-offset", "a divisor of something else than a temperature counts from absolute "
                                    "zero", part.right.column, 1, f"Write an interval: {_interval(part.right)}.")
        if shown and isinstance(part, Binary) and part.op == "-" and isinstance(part.right, Number) and \
                _in_kelvin(part.right) and part.right.value > INTERVALS and origins(part.left, lookup) == 1:
            text = f"{part.right.value:g} K"
            raise ExpressionProblem("unit-offset", f"{text} may be a temperature or an interval, so that the result is a "
                                    "difference or a temperature", part.right.column, 1,
                                    f"Write `{part.right.value - 273.15:g} degC` if it is a temperature, else `unit: K`.")
        if isinstance(part, Compare) and has_origin(part):
            left, right = origins(part.left, lookup), origins(part.right, lookup)
            if left is not None and right is not None and left != right:
                side = part.left if isinstance(part.left, Number) else part.right
                raise ExpressionProblem("unit-offset", "a difference of temperatures is compared with a temperature",
                                        part.column, len(part.op), f"Write {_interval(side)}."
                                        if isinstance(side, Number) else "Write an interval in K.")
    return weight


def _own_origins(expr: Expr) -> tuple[Expr, ...]:
    """The operands of an expression that is not linear in them, so that each must be a temperature or a difference."""
    if isinstance(expr, Binary):
        plain = [constant(e) is not None and all(n.unit is None for n in _parts(e) if isinstance(n, Number))
                 for e in (expr.left, expr.right)]
        linear = expr.op in ("+", "-") or (expr.op == "/" and plain[1]) or (expr.op == "*" and any(plain))
        return () if linear else (expr.left, expr.right)
    return children(expr) if isinstance(expr, Compare) or (isinstance(expr, Call) and expr.function not in _LINEAR) else ()


def _parts(expr: Expr) -> list[Expr]:
    return [expr, *(part for child in children(expr) for part in _parts(child))]


def _interval(number: Number) -> str:
    return f"`{interval_text(number.value, number.unit)}`"


def _in_kelvin(expr: Expr) -> bool:
    if isinstance(expr, Negative):
        return _in_kelvin(expr.operand)
    return isinstance(expr, Number) and expr.unit is not None and not expr.unit.offset
