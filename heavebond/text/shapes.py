"""Lengths of lists in expressions: which equation is one of numbers, and which of vectors.

A list without an index is a vector of its elements, `x[2..n]` one of some of them. Vectors of one length are added, and
multiplied and divided by numbers; `dot`, `cross` and `sum` take vectors. A product of two vectors is written out by what is
meant: `dot`, `cross`, or element by element with `each`.
"""

from __future__ import annotations

from collections.abc import Callable

from heavebond.text.expression import (
    Binary,
    Call,
    Compare,
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
)

Length = Callable[[Name], int | None]  # of a name: its number of elements, None for a number
ELEMENTS = "Write an index, as in `x[1]`, or `each i in 1..n:` for an equation of every element."


class Lengths:
    """Lengths of expressions, with those of names; `exact` is False where whole numbers are not known yet."""

    def __init__(self, length: Length, *, exact: bool):
        self.length, self.exact = length, exact

    def equation(self, equation: Equation) -> int | None:
        """The length of an equation; ExpressionProblem where its sides differ. A plain 0 is a list of zeros."""
        left, right = self.of(equation.left), self.of(equation.right)
        if _zero(equation.left) or _zero(equation.right):
            return left if left is not None else right
        return self._same(left, right, "the sides of the equation are", _start(equation.right))

    def number(self, expr: Expr, what: str) -> None:
        """ExpressionProblem where a list stands for a number."""
        if (found := self.of(expr)) is not None:
            raise ExpressionProblem("list-number", f"{what} is a number; this is {_text(found, self.exact)}", _start(expr),
                                    hint="Write an index, as in `x[1]`, or `sum(x)`, `dot(x, y)`.")

    def of(self, expr: Expr) -> int | None:
        """The length of an expression, None for a number; ExpressionProblem where lists are joined that do not fit."""
        if isinstance(expr, Name):
            for part in expr.parts:
                if not isinstance(part, str):
                    for bound in (part.low, part.high) if isinstance(part, Slice) else (part,):
                        self.number(bound, "an index")
            return self.length(expr)
        if isinstance(expr, Negative):
            return self.of(expr.operand)
        if isinstance(expr, Binary):
            return self._binary(expr)
        if isinstance(expr, Call):
            return self._call(expr)
        if isinstance(expr, FunctionCall):
            for arg, name in zip(expr.args, expr.function.inputs, strict=True):
                self.number(arg, f"{name} of {expr.function.name}")
            return None
        if isinstance(expr, SumOver):
            return self.of(expr.body)
        if isinstance(expr, (Compare, Logic)):
            self.number(expr.left, "each side of a comparison")
            self.number(expr.right, "each side of a comparison")
        elif isinstance(expr, Not):
            self.number(expr.operand, "a condition")
        else:
            assert isinstance(expr, Number)
        return None

    def _binary(self, expr: Binary) -> int | None:
        left, right = self.of(expr.left), self.of(expr.right)
        if expr.op in "+-":
            if _zero(expr.left) or _zero(expr.right):
                return left if left is not None else right
            return self._same(left, right, f"'{expr.op}' joins", expr.column)
        if (right is not None and (left is not None or expr.op != "*")) or (left is not None and expr.op == "**"):
            what = "a product of two lists" if expr.op == "*" else "a quotient by a list" if expr.op == "/" else \
                "a power of a list"
            raise ExpressionProblem("list-product", f"{what} has more than one meaning", expr.column, len(expr.op),
                                    "Write `dot(a, b)` or `cross(a, b)`, or `each i in 1..n:` for an equation of every "
                                    "element.")
        return left if left is not None else right

    def _call(self, expr: Call) -> int | None:
        lengths = [self.of(arg) for arg in expr.args]
        name = expr.function
        if name == "der":
            return lengths[0]
        if name == "sum":
            if lengths[0] is None:
                raise ExpressionProblem("sum-form", "sum is written `sum(... for i in 1..n)`, or over a list or an array of "
                                        "ports", _start(expr.args[0]))
            return None
        if name in ("symmetric", "definite", "semidefinite"):
            if lengths[0] is None:
                raise ExpressionProblem("list-number", f"{name} takes a square matrix, its rows one after the other in a "
                                        "list", _start(expr.args[0]), hint="Declare it with `count: n*n`.")
            return None
        if name in ("dot", "cross"):
            for arg, length in zip(expr.args, lengths, strict=True):
                if length is None or (name == "cross" and self.exact and length != 3):
                    raise ExpressionProblem("list-number", f"{name} takes two lists{' of 3' if name == 'cross' else ''}; "
                                            f"this is {_text(length, self.exact)}", _start(arg),
                                            hint="Declare it with `count: 3`." if name == "cross" else ELEMENTS)
            found = self._same(lengths[0], lengths[1], f"{name} joins", expr.column)
            return found if name == "cross" else None
        if name == "if_else":
            self.number(expr.args[0], "the condition of if_else")
            if _zero(expr.args[1]) or _zero(expr.args[2]):
                return lengths[1] if lengths[1] is not None else lengths[2]
            return self._same(lengths[1], lengths[2], "if_else joins", expr.column)
        for arg in expr.args:
            self.number(arg, f"the argument of {name}")
        return None

    def _same(self, left: int | None, right: int | None, what: str, column: int) -> int | None:
        if left == right or (not self.exact and left is not None and right is not None):
            return left if left is None or right is None else max(left, right)
        raise ExpressionProblem("list-length", f"{what} {_text(left, self.exact)} and {_text(right, self.exact)}", column,
                                hint=ELEMENTS if left is None or right is None else "Lists of one length are joined; "
                                "`x[1..3]` is a part of one.")


def _zero(expr: Expr) -> bool:
    return isinstance(expr, Number) and expr.value == 0


def _text(length: int | None, exact: bool) -> str:
    return "a number" if length is None else f"a list of {length}" if exact else "a list"


def _start(expr: Expr) -> int:
    return _start(expr.left) if isinstance(expr, (Binary, Compare, Logic)) else expr.column
