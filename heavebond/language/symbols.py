"""Conversion of expression trees to CasADi SX; defines the functions of the language."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Set
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from math import isqrt
from typing import cast

import casadi as ca

from heavebond.core.limits import TERMS
from heavebond.language.external_functions import called, called_as_operation
from heavebond.text.expression import (
    Binary,
    Call,
    Compare,
    Elements,
    Expr,
    ExpressionProblem,
    Function,
    FunctionCall,
    Logic,
    Name,
    Negative,
    Not,
    Number,
    Slice,
    SumOver,
    children,
    names,
    too_long,
)
from heavebond.text.shapes import declared

NONSMOOTH = {"min", "max", "abs", "sign", "floor", "if_else"}
# relative to the largest element of a matrix: rounding error of a computed symmetric or singular matrix
MATRIX_ROUNDING, TINY = 1e-9, 1e-300
# steps of least_distance; relative to the norm of the violations: the slack at the start, the least complementarity, and the
# least softness, squared, which bounds the condition number of its linear systems
DISTANCE_STEPS, DISTANCE_SLACK, DISTANCE_LEAST, DISTANCE_SOFT = 30, 1e-2, 1e-13, 1e-14
# operations of CasADi with a jump or kink whose second derivative is zero elsewhere
CORNERS = {ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_COPYSIGN, ca.OP_SIGN, ca.OP_FLOOR,
           ca.OP_CEIL, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_IF_ELSE_ZERO}

OPPOSITE = {"<": ">=", ">": "<=", "<=": ">", ">=": "<"}
# Building an operation by its number takes a tenth of the time of Python's operators and CasADi's functions by name, which
# try every type of their arguments.
_OPERATORS = {"+": ca.OP_ADD, "-": ca.OP_SUB, "*": ca.OP_MUL, "/": ca.OP_DIV, "**": ca.OP_POW, "<": ca.OP_LT, "<=": ca.OP_LE,
              "==": ca.OP_EQ, "!=": ca.OP_NE, "and": ca.OP_AND, "or": ca.OP_OR}
_ONE_ARGUMENT = {
    "sqrt": ca.OP_SQRT, "exp": ca.OP_EXP, "log": ca.OP_LOG, "sin": ca.OP_SIN, "cos": ca.OP_COS, "tan": ca.OP_TAN,
    "tanh": ca.OP_TANH, "asin": ca.OP_ASIN, "acos": ca.OP_ACOS, "atan": ca.OP_ATAN, "abs": ca.OP_FABS, "sign": ca.OP_SIGN,
    "floor": ca.OP_FLOOR,
}
_TWO_ARGUMENTS = {"min": ca.OP_FMIN, "max": ca.OP_FMAX, "atan2": ca.OP_ATAN2}
# by function and hashes of the arguments: the arguments, which keep the hashes valid, and the value of each local name
Called = dict[tuple[str, tuple[int, ...]], tuple[list[ca.SX], dict[str, ca.SX]]]
Derivative = Callable[[ca.SX], ca.SX]
Lookup = Callable[[str, Name], ca.SX]


@dataclass(frozen=True)
class Context:
    """Environment of an evaluation: SX of names (columns for lists), d/dt of an SX, whole numbers, the number of terms of
    the enclosing sums, and results of functions for earlier arguments."""

    lookup: Lookup
    der: Derivative
    integers: Mapping[str, int] = field(default_factory=dict)
    terms: int = 1
    called: Called = field(default_factory=dict)


def stack(items: Iterable[ca.SX]) -> ca.SX:
    """The items as one column; an empty one is 0x1 SX (CasADi would give a DM)."""
    items = list(items)
    return ca.vertcat(*items) if items else ca.SX(0, 1)


def split(column: ca.SX) -> list[ca.SX]:
    """The elements of a column, none for an empty one."""
    # ten times faster than vertsplit; CasADi's stubs call the elements SXElem, they are scalar SX
    return cast(list[ca.SX], column.elements())


def places(column: ca.SX) -> dict[int, int]:
    """Index of each symbol in a column, by its hash."""
    return {s.element_hash(): k for k, s in enumerate(split(column))}


def evaluate(expr: Expr, context: Context) -> ca.SX:
    """Evaluate an expression as SX; ExpressionProblem for a name that the context does not contain."""
    if isinstance(expr, Number):
        return ca.SX(expr.value)
    if isinstance(expr, Name):
        return _name(expr, context)
    if isinstance(expr, Negative):
        return -evaluate(expr.operand, context)
    if isinstance(expr, Binary):
        left, right = evaluate(expr.left, context), evaluate(expr.right, context)
        if expr.op == "*" and not left.is_scalar() and not right.is_scalar():
            return ca.mtimes(left, right)  # shapes have been checked: a matrix times a vector or a matrix
        return operated(expr.op, left, right)
    if isinstance(expr, Call):
        return _call(expr, context)
    if isinstance(expr, FunctionCall):
        # the output of a function, expanded, so that it can be differentiated; outputs of one call share its steps
        args = [evaluate(arg, context) for arg in expr.args]
        key = (str(expr.function.path) + expr.function.name,
               tuple(e.element_hash() for arg in args for e in split(ca.vec(ca.densify(arg)))))
        if key not in context.called:
            context.called[key] = args, stepwise(expr.function, args)
        return context.called[key][1][expr.output]
    if isinstance(expr, SumOver):
        total, low, high = ca.SX(0), _integer(expr.low, context), _integer(expr.high, context)
        terms = context.terms * max(1, high - low + 1)
        if terms > TERMS:  # bounds may be parameters, or the index of a sum around this one
            raise too_long(expr.column)
        for k in range(low, high + 1):
            inner = Context(context.lookup, context.der, {**context.integers, expr.index: k}, terms,
                            context.called)
            total = operated("+", total, evaluate(expr.body, inner))
        return total
    if isinstance(expr, Elements):
        rows = [evaluate(item, context) for item in expr.items]  # numbers, or columns that are rows of a matrix
        return ca.densify(ca.vertcat(*(row.T for row in rows)))
    if isinstance(expr, Compare | Logic):
        return operated(expr.op, evaluate(expr.left, context), evaluate(expr.right, context))
    assert isinstance(expr, Not)
    return ca.logic_not(evaluate(expr.operand, context))


def indicator(expr: Expr, context: Context, still: Set[int] = frozenset()) -> ca.SX:
    """A condition as a number: above zero if it is true, below if it is false, and zero at the change.

    The indicator of `a > b` is a - b; of `and` the smaller, of `or` the larger one. The unit is the unit of the compared
    sides. Values that are constant between events (the hashes of their symbols are in `still`) can stay equal to a bound:
    `n >= 2` gives 1 or -1.
    """
    if isinstance(expr, Compare):
        left, right = evaluate(expr.left, context), evaluate(expr.right, context)
        if expr.op in OPPOSITE and {s.element_hash() for s in ca.symvar(left - right)} <= still:
            return ca.if_else(operated(expr.op, left, right), ca.SX(1), ca.SX(-1))
        if expr.op in ("<", "<="):
            return right - left
        if expr.op in (">", ">="):
            return left - right
        equal = ca.if_else(left == right, ca.SX(1), ca.SX(-1))
        return equal if expr.op == "==" else -equal
    if isinstance(expr, Logic):
        both = indicator(expr.left, context, still), indicator(expr.right, context, still)
        return ca.fmin(*both) if expr.op == "and" else ca.fmax(*both)
    if isinstance(expr, Not):
        return _opposite(expr.operand, context, still)
    return 2 * evaluate(expr, context) - 1  # a property of a matrix


def _opposite(expr: Expr, context: Context, still: Set[int]) -> ca.SX:
    """The indicator of `not ...`: for `not n < 2` the indicator of `n >= 2`."""
    if isinstance(expr, Compare) and expr.op in OPPOSITE:
        return indicator(replace(expr, op=OPPOSITE[expr.op]), context, still)
    if isinstance(expr, Logic):
        both = _opposite(expr.left, context, still), _opposite(expr.right, context, still)
        return ca.fmax(*both) if expr.op == "and" else ca.fmin(*both)
    return -indicator(expr, context, still)


def _name(expr: Name, context: Context) -> ca.SX:
    words: list[str] = []
    for k, part in enumerate(expr.parts):
        if isinstance(part, str):
            words.append(part)
        elif isinstance(part, Slice):
            low, high = _integer(part.low, context), _integer(part.high, context)
            if high < low:
                raise ExpressionProblem("list-length", f"no element lies from {low} to {high}", part.column,
                                        hint="Write the lower index first, as in `x[1..3]`.")
            each = [Name((*expr.parts[:k], Number(i, None, 0), *expr.parts[k + 1:]), expr.column, expr.length)
                    for i in range(low, high + 1)]
            elements = [_name(element, context) for element in each]
            # a second slice gives each row as a column
            return ca.vertcat(*(row.T for row in elements)) if any(isinstance(p, Slice) for p in expr.parts[k + 1:]) else \
                stack(elements)
        else:
            words[-1] += f"[{_integer(part, context)}]"
    text = ".".join(words)
    if text == "pi":
        return ca.SX(ca.pi)
    if text in context.integers:
        return ca.SX(context.integers[text])
    return context.lookup(text, expr)


def _integer(expr: Expr, context: Context) -> int:
    number_read = evaluate(expr, context)
    if not number_read.is_constant() or float(number_read) != int(float(number_read)):
        raise ExpressionProblem("not-an-integer", "a whole number is needed here", getattr(expr, "column", 0),
                                hint="Write a number such as 3, or the name of an integer parameter.")
    return int(float(number_read))


def operated(op: str, left: ca.SX, right: ca.SX) -> ca.SX:
    """Apply an operator of the language to two operands, element by element."""
    if op in (">", ">="):
        op, left, right = "<" + op[1:], right, left
    return ca.SX.binary(_OPERATORS[op], left, right)


def _call(expr: Call, context: Context) -> ca.SX:
    name = expr.function
    if name == "der":
        return context.der(evaluate(expr.args[0], context))
    if name == "uniform":
        return ca.SX(uniform(_integer(expr.args[0], context), _integer(expr.args[1], context)))
    if name == "sum":
        return ca.sum1(ca.vec(evaluate(expr.args[0], context)))
    args = [evaluate(arg, context) for arg in expr.args]
    if name in _ONE_ARGUMENT:
        return ca.SX.unary(_ONE_ARGUMENT[name], args[0])
    if name == "dot":
        return ca.dot(args[0], args[1])
    if name == "cross":
        return ca.cross(args[0], args[1])
    if name == "transpose":
        return args[0].T
    if name in ("symmetric", "definite", "semidefinite"):
        return _matrix_property(name, args[0], expr)
    if name == "least_distance":
        return _least_distance(*map(ca.densify, args))
    if name in _TWO_ARGUMENTS:  # or more
        return reduce(partial(ca.SX.binary, _TWO_ARGUMENTS[name]), args)
    if name == "if_else":
        return ca.if_else(args[0], args[1], args[2])
    if name == "smooth_sign":
        return ca.tanh(args[0] / args[1])
    assert name == "signed_sqrt"
    return args[0] / ca.sqrt(ca.sqrt(args[0] ** 2 + args[1] ** 2))


def _matrix_property(name: str, argument: ca.SX, expr: Call) -> ca.SX:
    """True if a square matrix (n, n), or its rows in one column (n*n,), is symmetric, or its symmetric part positive
    (semi-)definite: the pivots of its elimination are above zero, for a semi-definite one after MATRIX_ROUNDING times
    its largest element is added to its diagonal."""
    rows = ca.vec(argument.T)
    n = isqrt(rows.numel())
    if n * n != rows.numel():
        raise ExpressionProblem("list-length", f"{name} takes a square matrix; {rows.numel()} elements are not a square "
                                "matrix",
                                expr.column, hint="Declare it with `count: [n, n]`.")
    matrix = ca.reshape(rows, n, n).T
    largest = ca.mmax(ca.fabs(rows))
    if name == "symmetric":
        return ca.mmax(ca.fabs(matrix - matrix.T)) <= MATRIX_ROUNDING * largest
    symmetric_part = (matrix + matrix.T) / 2
    if name == "semidefinite":
        symmetric_part += (MATRIX_ROUNDING * largest + TINY) * ca.SX.eye(n)
    truth = ca.SX(1)
    for k in range(n):
        truth = ca.logic_and(truth, symmetric_part[k, k] > 0)
        symmetric_part -= ca.mtimes(symmetric_part[:, k], symmetric_part[k, :]) / symmetric_part[k, k]
    return truth


def _least_distance(matrix: ca.SX, c: ca.SX, low: ca.SX, high: ca.SX, soft: ca.SX) -> ca.SX:
    """The v (n,) of least |v|^2 + |e|^2 with low <= c + W v + S e <= high, for W (p, n), lists (p,) and the diagonal matrix
    S of `soft` (p,), 0 for a limit that holds exactly; v = 0 if it satisfies the limits.

    The arguments are numbers or formulas of any names. A primal-dual interior-point method with DISTANCE_STEPS steps of a
    predictor and a corrector, called as one operation, with rows of length 1. S. Mehrotra, SIAM J. Optim. 2 (1992) 575-601;
    S. J. Wright, Primal-Dual Interior-Point Methods, SIAM 1997, chapter 10; C. L. Lawson, R. J. Hanson, Solving Least
    Squares Problems, Prentice-Hall 1974, chapter 23 (least distance programming).
    """
    p, n = matrix.shape
    rows, room, softness = ca.SX.sym("W", p, n), ca.SX.sym("room", 2 * p), ca.SX.sym("S", p)
    squares = ca.sum2(rows**2) + softness**2
    length = ca.sqrt(ca.if_else(squares > 0, squares, 1))
    # relative to the norm of the violations of the limits
    scaled = room / ca.vertcat(length, length)
    outside = ca.sum1(ca.fmax(-scaled, 0) ** 2)
    size = ca.sqrt(ca.if_else(outside > 0, outside, 1))
    slack = ca.fmax(scaled / size, DISTANCE_SLACK)
    point = [ca.SX.zeros(n), slack, 1 / slack]
    step = _distance_step(p, n)
    soft_squares = ca.fmax((softness / length) ** 2, DISTANCE_SOFT)
    for _ in range(DISTANCE_STEPS):
        point = step.call([rows / ca.repmat(length, 1, n), scaled / size, soft_squares, *point], False, True)
    correction = ca.if_else(outside > 0, size * point[0], ca.SX.zeros(n))
    solver = ca.Function(f"hb_least_distance_{p}_{n}", [rows, room, softness], [correction])
    return called_as_operation(solver, [matrix, ca.vertcat(high - c, c - low), soft])


def _distance_step(p: int, n: int) -> ca.Function:
    """A step of `_least_distance` from v (n,), slacks and multipliers (2 p,) of the limits W v + slack = room + S^2
    multiplier (2 p,), where the lower half is for -W v and e = -S times the multiplier. The predictor has the target 0 for
    the complementarity; its success determines the target of the corrector. The length of a step is limited by a norm of
    high order of the relative decreases of slacks and multipliers, which approximates the largest decrease smoothly."""
    matrix, room, squares, v, slack, multiplier = symbols = [
        ca.SX.sym("W", p, n), ca.SX.sym("room", 2 * p), ca.SX.sym("S2", p), ca.SX.sym("v", n), ca.SX.sym("s", 2 * p),
        ca.SX.sym("l", 2 * p)]
    soft = ca.vertcat(squares, squares)

    def both(upper: ca.SX) -> ca.SX:
        return ca.vertcat(upper, -upper)

    residual = both(ca.mtimes(matrix, v)) + slack - room - soft * multiplier
    weight = multiplier / (slack + soft * multiplier)
    # the upper triangle of the positive definite matrix I + W' D W, by elimination without pivots
    weighed = ca.repmat(weight[:p] + weight[p:], 1, n) * matrix
    rows = [ca.mtimes(weighed[:, i].T, matrix[:, i:]) for i in range(n)]
    for k in range(n):
        rows[k][0] += 1
    for k in range(n):
        for i in range(k + 1, n):
            rows[i] -= rows[k][i - k] / rows[k][0] * rows[k][i - k:]

    def changes(target: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The changes of v, slacks and multipliers that a Newton step gives for a target of slack times multiplier."""
        pulled = weight * (residual + target / multiplier - slack)
        sides = multiplier + pulled
        right = -v - ca.mtimes(matrix.T, sides[:p] - sides[p:])
        for k in range(n - 1):
            right[k + 1:] -= right[k] / rows[k][0] * rows[k][1:].T
        change = ca.SX.zeros(n)
        for k in reversed(range(n)):
            known = ca.dot(rows[k][1:], change[k + 1:, 0].T) if k + 1 < n else 0
            change[k] = (right[k] - known) / rows[k][0]
        moved = both(ca.mtimes(matrix, change))
        of_multiplier = pulled + weight * moved
        return change, soft * of_multiplier - residual - moved, of_multiplier

    def length(of_slack: ca.SX, of_multiplier: ca.SX) -> ca.SX:
        decreases = ca.vertcat(-of_slack / slack, -of_multiplier / multiplier)
        return (1 + ca.sum1((ca.fmax(decreases, 0) / 0.98) ** 16)) ** (-1 / 16)

    _, of_slack, of_multiplier = changes(ca.SX.zeros(2 * p))
    share, centre = length(of_slack, of_multiplier), ca.dot(multiplier, slack) / (2 * p)
    left = ca.dot(slack + share * of_slack, multiplier + share * of_multiplier) / (2 * p) / centre
    corrected = changes(ca.fmax(left**3 * centre, DISTANCE_LEAST) - of_slack * of_multiplier)
    share = length(*corrected[1:])
    return ca.Function(f"hb_distance_step_{p}_{n}", symbols, [
        value + share * each for value, each in zip((v, slack, multiplier), corrected, strict=True)])


def stepwise(function: Function, args: Iterable[ca.SX]) -> dict[str, ca.SX]:
    """The value of every name in a function: its inputs, its constants and its steps."""
    values = dict(zip(function.inputs, args, strict=True))
    if function.external is not None:
        sizes = _sizes(function, values)
        return values | called(function, list(values.values()),
                               {q.name: declared(q, sizes) for q in function.outputs.values()})
    values.update({name: ca.SX(constant.value or 0.0) for name, constant in function.constants.items()})
    # checked when its file was read: it calls no der, and knows every name
    context = Context(lambda text, name: _element(values, text, name), lambda expression: expression,
                      _sizes(function, values))
    for step in function.steps:
        values[step.name] = evaluate(step.expr, context)
    return values


def _sizes(function: Function, values: Mapping[str, ca.SX]) -> dict[str, int]:
    """The whole numbers that follow from the lengths of the arguments."""
    sizes: dict[str, int] = {}
    for name, quantity in function.inputs.items():
        shape = (values[name].numel(),) if len(quantity.sizes) == 1 else values[name].shape
        sizes.update({size.text: n for size, n in zip(quantity.sizes, shape, strict=False) if isinstance(size, Name)})
    return sizes


def _element(values: Mapping[str, ca.SX], text: str, name: Name) -> ca.SX:
    """A name inside a function, or an element of it: `x`, `x[2]`, `K[1][2]`."""
    base, bracket, indices = text.partition("[")
    if not bracket:
        return values[base]
    column, places = values[base], [int(k) - 1 for k in indices[:-1].split("][")]
    if any(not 0 <= k < n for k, n in zip(places, column.shape, strict=False)):
        raise ExpressionProblem("list-index", f"'{text}' is not an element of {base}, which has {column.shape[0]}"
                                + f" x {column.shape[1]}" * (len(places) > 1), name.column, name.length,
                                "An index counts from 1.")
    return column[places[0]] if len(places) == 1 else column[places[0], places[1]]


def uniform(seed: int, index: int) -> float:
    """A number in [0, 1) that depends on (seed, index) alone, the same on every machine.

    The finaliser of SplitMix64 (Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195) of seed * 2**32 + index.
    """
    mask = (1 << 64) - 1
    z = (seed * (1 << 32) + index + 1) * 0x9E3779B97F4A7C15 & mask
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & mask
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & mask
    return ((z ^ (z >> 31)) >> 11) / (1 << 53)


def varies(expr: Expr, constants: Callable[[str], bool]) -> bool:
    """True if an expression depends on more than constants."""
    return any(not constants(n.text) for n in names(expr))


def nonsmooth(expr: Expr, constants: Callable[[str], bool]) -> str | None:
    """The first function in `expr` with a kink in a varying argument (its der is the author's responsibility)."""
    if isinstance(expr, Call) and expr.function == "der":
        return None
    if isinstance(expr, Call) and expr.function in NONSMOOTH and varies(expr, constants):
        return expr.function
    if isinstance(expr, FunctionCall) and (inside := _kink_inside(expr, constants)):
        return inside
    if isinstance(expr, SumOver):
        index = expr.index
        return nonsmooth(expr.body, lambda text: text == index or constants(text))
    return next((inner for child in children(expr) if (inner := nonsmooth(child, constants))), None)


def _kink_inside(call: FunctionCall, constants: Callable[[str], bool]) -> str | None:
    """The first kink in a varying argument, in the steps on which the output of a call depends."""
    function = call.function
    moving = {name for name, arg in zip(function.inputs, call.args, strict=True) if varies(arg, constants)}

    def still(text: str) -> bool:
        return text.partition("[")[0] not in moving

    for step in function.needed(call.output):
        if inner := nonsmooth(step.expr, still):
            return inner
        if varies(step.expr, still):
            moving.add(step.name)
    return None


def kinked(expr: Expr, among: Container[str]) -> bool:
    """True if one of these names occurs inside a function with a kink."""
    if isinstance(expr, Call) and expr.function in NONSMOOTH and any(n.text in among for n in names(expr)):
        return True
    if isinstance(expr, FunctionCall) and _kink_inside(expr, lambda text: text not in among):
        return True
    return any(kinked(child, among) for child in children(expr))
