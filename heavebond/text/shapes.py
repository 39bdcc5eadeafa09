"""Shapes of expressions: numbers, vectors and matrices.

The name of a list without an index is a vector of all elements, and `x[2..n]` is a vector of some of them. `K[i, 1..m]` is
a row of a matrix as a vector. Expressions of equal shape can be added, and multiplied and divided by numbers. A matrix can
be multiplied by a vector or a matrix. `dot`, `cross` and `sum` take vectors. The operator `*` is not defined for two
vectors: write `dot`, `cross`, or an equation for each element with `each`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import reduce
from math import isfinite

from heavebond.text.expression import (
    Binary,
    Call,
    Compare,
    Elements,
    Equation,
    Expr,
    ExpressionProblem,
    Function,
    FunctionCall,
    Logic,
    Name,
    Negative,
    Not,
    Number,
    Quantity,
    Slice,
    SumOver,
    children,
    constant,
)

Shape = int | tuple[int, int] | None  # number of elements of a vector, rows and columns of a matrix, None for a number
Length = Callable[[Name], Shape]
ELEMENTS = "Write an index, as in `x[1]`, or `each i in 1..n:` for an equation of every element."
SQUARE = ("symmetric", "definite", "semidefinite")


def whole_number(expr: Expr, known: Mapping[str, int]) -> int | None:
    """The value of an expression of whole numbers and known names, or None."""
    if isinstance(expr, Name):
        return known.get(expr.text)
    number = constant(expr)
    if number is not None:
        return int(number) if isfinite(number) and number == int(number) else None
    if not isinstance(expr, Binary):
        return None
    a, b = whole_number(expr.left, known), whole_number(expr.right, known)
    if a is None or b is None:
        return None
    return {"+": a + b, "-": a - b, "*": a * b}.get(expr.op)


def elements(shape: Shape) -> int:
    """The number of elements of a shape."""
    return 1 if shape is None else shape if isinstance(shape, int) else shape[0] * shape[1]


def indexed(shape: Shape, name: Name, size: Callable[[Slice], int]) -> Shape:
    """The shape of a name with indices; `shape` is the shape of the whole list or matrix, `size` the length of a slice."""
    listed = [part for part in name.parts if not isinstance(part, str)]
    if not listed:
        return shape
    if (len(listed) == 2) != isinstance(shape, tuple) and shape is not None:
        raise ExpressionProblem("list-index", f"'{name.parts[0]}' is {shape_text(shape, exact=False)}; "
                                f"{'two indices are' if isinstance(shape, tuple) else 'one index is'} needed", name.column,
                                name.length, "Write `K[i, j]`, `K[i, 1..m]` for a row, or `K[1..n, j]` for a column."
                                if isinstance(shape, tuple) else "Write for example `x[1]`.")
    slice_sizes = [size(part) for part in listed if isinstance(part, Slice)]
    return None if not slice_sizes else slice_sizes[0] if len(slice_sizes) == 1 else (slice_sizes[0], slice_sizes[1])


class Lengths:
    """Computes shapes of expressions from the shapes of names; `exact` is False if the whole numbers are not known yet."""

    def __init__(self, length: Length, *, exact: bool):
        self.length, self.exact = length, exact

    def equation(self, equation: Equation) -> Shape:
        """The shape of an equation; raises ExpressionProblem if its sides differ. A plain 0 is compatible with any shape."""
        left, right = self.of(equation.left), self.of(equation.right)
        if _zero(equation.left) or _zero(equation.right):
            return left if left is not None else right
        return self._same(left, right, "the sides of the equation are", _start(equation.right))

    def assigned(self, target: Name, value: Expr) -> None:
        """Raise ExpressionProblem if a value does not have the shape of the variable that an event sets to it."""
        shape = self.of(target)
        if shape is None:
            self.number(value, "a new value")
        elif not _zero(value):
            self._same(shape, self.of(value), "the target and its new value are", _start(value))

    def number(self, expr: Expr, subject: str) -> None:
        """Raise ExpressionProblem if the expression is a list or a matrix."""
        if (shape := self.of(expr)) is not None:
            raise ExpressionProblem("list-number", f"{subject} is a number; this is {shape_text(shape, self.exact)}",
                                    _start(expr), hint="Write an index, as in `x[1]`, or `sum(x)`, `dot(x, y)`.")

    def of(self, expr: Expr) -> Shape:
        """The shape of an expression, None for a number; raises ExpressionProblem for operands with incompatible shapes."""
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
            return self._function(expr)
        if isinstance(expr, SumOver):
            return self.of(expr.body)
        if isinstance(expr, Elements):
            # the shape of a list of numbers, or of a matrix of rows of equal length
            rows = [self.of(item) for item in expr.items]
            for item, row in zip(expr.items, rows, strict=True):
                if isinstance(row, tuple):
                    raise ExpressionProblem("list-number",
                                            f"a list has numbers or rows; this is {shape_text(row, self.exact)}",
                                            _start(item), hint="A matrix has two indices at most.")
                if (row is None) != (rows[0] is None) or (self.exact and row != rows[0]):
                    first = "a number" if rows[0] is None else shape_text(rows[0], self.exact)
                    raise ExpressionProblem("list-length", f"the first of a list is {first}, this is "
                                            f"{'a number' if row is None else shape_text(row, self.exact)}", _start(item),
                                            hint="Write numbers, `[a, b]`, or rows of one length, `[[a, b], [c, d]]`.")
            first_row = rows[0]
            return len(rows) if not isinstance(first_row, int) else (len(rows), first_row)
        if isinstance(expr, (Compare, Logic)):
            self.number(expr.left, "each side of a comparison")
            self.number(expr.right, "each side of a comparison")
        elif isinstance(expr, Not):
            self.number(expr.operand, "a condition")
        else:
            assert isinstance(expr, Number)
        return None

    def _binary(self, expr: Binary) -> Shape:
        left, right = self.of(expr.left), self.of(expr.right)
        if expr.op in "+-":
            if _zero(expr.left) or _zero(expr.right):
                return left if left is not None else right
            return self._same(left, right, f"'{expr.op}' joins", expr.column)
        if expr.op == "*" and isinstance(left, tuple) and right is not None:
            # the shape of the product of a matrix with a vector or a matrix
            inner = right if isinstance(right, int) else right[0]
            if self.exact and left[1] != inner:
                raise ExpressionProblem("list-length", f"a product of {shape_text(left)} and {shape_text(right)}",
                                        expr.column, 1,
                                        "The matrix on the left has as many columns as what it multiplies has rows.")
            return left[0] if isinstance(right, int) else (left[0], right[1])
        if (right is not None and (left is not None or expr.op != "*")) or (left is not None and expr.op == "**"):
            if expr.op == "*" and isinstance(right, tuple):
                raise ExpressionProblem("list-product", "a vector stands on the left of a matrix", expr.column, 1,
                                        "Write the matrix first, `K*x`, or `transpose(K)*x`.")
            operation = "a product of two lists" if expr.op == "*" else "a quotient by a list" if expr.op == "/" else \
                "a power of a list"
            raise ExpressionProblem("list-product", f"{operation} has more than one meaning", expr.column, len(expr.op),
                                    "Write `dot(a, b)` or `cross(a, b)`, or `each i in 1..n:` for an equation of every "
                                    "element.")
        return left if left is not None else right

    def _call(self, expr: Call) -> Shape:
        lengths = [self.of(arg) for arg in expr.args]
        name = expr.function
        if name == "der":
            return lengths[0]
        if name == "sum":
            if lengths[0] is None:
                raise ExpressionProblem("sum-form", "sum is written `sum(... for i in 1..n)`, or over a list or an array of "
                                        "ports", _start(expr.args[0]))
            return None
        if name == "transpose":
            if not isinstance(matrix := lengths[0], tuple):
                raise ExpressionProblem("list-number", f"transpose takes a matrix; this is {shape_text(matrix, self.exact)}",
                                        _start(expr.args[0]), hint="Declare it with `count: [n, m]`.")
            return matrix[1], matrix[0]
        if name in SQUARE:
            # check that an argument is a square matrix, or a list of the elements of a matrix row by row
            shape = lengths[0]
            if shape is None or (self.exact and isinstance(shape, tuple) and shape[0] != shape[1]):
                raise ExpressionProblem("list-number", f"{expr.function} takes a square matrix; this is "
                                        f"{shape_text(shape, self.exact)}", _start(expr.args[0]),
                                        hint="Declare it with `count: [n, n]`.")
            return None
        if name in ("dot", "cross"):
            return self._vectors(expr, lengths)
        if name == "least_distance":
            matrix = lengths[0]
            if not isinstance(matrix, tuple):
                raise ExpressionProblem("list-number", f"least_distance takes a matrix first; this is "
                                        f"{shape_text(matrix, self.exact)}", _start(expr.args[0]),
                                        hint="Declare it with `count: [n, m]`.")
            for arg, shape in zip(expr.args[1:], lengths[1:], strict=True):
                if not isinstance(shape, int) or (self.exact and shape != matrix[0]):
                    raise ExpressionProblem("list-length", f"least_distance takes a list for the rows of "
                                            f"{shape_text(matrix, self.exact)}; this is {shape_text(shape, self.exact)}",
                                            _start(arg), hint="The lists have an element for each row of the matrix.")
            return matrix[1]
        if name == "if_else":
            self.number(expr.args[0], "the condition of if_else")
            if _zero(expr.args[1]) or _zero(expr.args[2]):
                return lengths[1] if lengths[1] is not None else lengths[2]
            return self._same(lengths[1], lengths[2], "if_else joins", expr.column)
        if name in ("min", "max"):
            return reduce(lambda left, right: self._same(left, right, f"{name} joins", expr.column), lengths)
        for arg in expr.args:
            self.number(arg, f"the argument of {name}")
        return None

    def _function(self, expr: FunctionCall) -> Shape:
        """The shape of the output of a function; check the shapes of the arguments first."""
        function, shapes = expr.function, [self.of(arg) for arg in expr.args]
        sizes: dict[str, int] = {}
        for arg, shape, wanted in zip(expr.args, shapes, function.inputs.values(), strict=True):
            subject = f"{wanted.name} of {function.name}"
            if not wanted.sizes:
                self.number(arg, subject)
            elif len(wanted.sizes) != (0 if shape is None else 1 if isinstance(shape, int) else 2):
                raise ExpressionProblem("list-number",
                                        f"{subject} is a {'list' if len(wanted.sizes) == 1 else 'matrix'}; this "
                                        f"is {shape_text(shape, self.exact)}", _start(arg), hint=wanted.doc)
            else:
                self._add_sizes(subject, shape, wanted.sizes, sizes, _start(arg))
        if self.exact:
            check_steps(function, sizes, expr.column, exact=True)
        return declared(function.outputs[expr.output], sizes)

    def _add_sizes(self, subject: str, shape: Shape, wanted: tuple[Expr, ...], sizes: dict[str, int], column: int) -> None:
        """Add the lengths of an argument to `sizes`; raise ExpressionProblem if another argument has different lengths."""
        for size, expr in zip((shape,) if isinstance(shape, int) else shape or (), wanted, strict=True):
            known = whole_number(expr, sizes)
            if known is None and isinstance(expr, Name):
                sizes[expr.text] = size
            elif known != size and self.exact:
                length = f"{expr.text} = {known}" if isinstance(expr, Name) else f"{known}"
                raise ExpressionProblem("list-length", f"{subject} has the length {length}; this is {shape_text(shape)}",
                                        column, hint="Lists of one length are needed; `x[1..3]` is a part of one.")

    def _vectors(self, expr: Call, shapes: list[Shape]) -> Shape:
        """The shape of `dot` or `cross`."""
        name = expr.function
        for arg, shape in zip(expr.args, shapes, strict=True):
            if not isinstance(shape, int) or (name == "cross" and self.exact and shape != 3):
                raise ExpressionProblem("list-number", f"{name} takes two lists{' of 3' if name == 'cross' else ''}; "
                                        f"this is {shape_text(shape, self.exact)}", _start(arg),
                                        hint="Declare it with `count: 3`." if name == "cross" else ELEMENTS)
        common = self._same(shapes[0], shapes[1], f"{name} joins", expr.column)
        return common if name == "cross" else None

    def _same(self, left: Shape, right: Shape, subject: str, column: int) -> Shape:
        if left == right:
            return left
        if not self.exact and isinstance(left, int) and isinstance(right, int):
            return max(left, right)
        if not self.exact and isinstance(left, tuple) and isinstance(right, tuple):
            return max(left[0], right[0]), max(left[1], right[1])
        raise ExpressionProblem("list-length",
                                f"{subject} {shape_text(left, self.exact)} and {shape_text(right, self.exact)}",
                                column, hint=ELEMENTS if left is None or right is None else
                                "Lists of one length are joined; `x[1..3]` is a part of one.")


def _zero(expr: Expr) -> bool:
    return isinstance(expr, Number) and expr.value == 0


def shape_text(shape: Shape, exact: bool = True) -> str:
    """A shape in words."""
    if shape is None:
        return "a number"
    if isinstance(shape, int):
        return f"a list of {shape}" if exact else "a list"
    return f"a matrix of {shape[0]} x {shape[1]}" if exact else "a matrix"


def _start(expr: Expr) -> int:
    return _start(expr.left) if isinstance(expr, (Binary, Compare, Logic)) else expr.column


def gives_lists(expr: Expr) -> bool:
    """True if an expression whose names are numbers contains a list: in brackets, or as an output of a function."""
    if isinstance(expr, Elements) or (isinstance(expr, FunctionCall) and expr.function.outputs[expr.output].sizes):
        return True
    return any(map(gives_lists, children(expr)))


def declared(quantity: Quantity, sizes: Mapping[str, int]) -> Shape:
    """The declared shape of a quantity of a function; an unknown length is taken as 1."""
    sizes_found = [whole_number(size, sizes) or 1 for size in quantity.sizes]
    return None if not sizes_found else sizes_found[0] if len(sizes_found) == 1 else (sizes_found[0], sizes_found[1])


def check_steps(function: Function, sizes: Mapping[str, int], column: int, *, exact: bool) -> dict[str, Shape]:
    """The shape of every name in a function with known lengths `sizes`.

    Raises ExpressionProblem at the `column` of the call if the shapes in a step are incompatible, or if the shape of an
    output differs from its declaration.
    """
    shapes: dict[str, Shape] = {q.name: declared(q, sizes) for q in function.inputs.values()}

    def number(expr: Expr) -> int:
        return whole_number(expr, sizes) or 1

    def length(name: Name) -> Shape:
        return indexed(shapes.get(name.base), name, lambda part: max(number(part.high) - number(part.low) + 1, 1))

    if function.external is not None:
        return shapes | {q.name: declared(q, sizes) for q in function.outputs.values()}
    for step in function.steps:
        try:
            shapes[step.name] = step_shape = Lengths(length, exact=exact).of(step.expr)
        except ExpressionProblem as problem:
            raise ExpressionProblem(problem.code, f"in {function.name}, `{step.text.strip()}`: {problem.message}", column,
                                    len(function.name), problem.hint) from None
        output = function.outputs.get(step.name)
        wanted = declared(output, sizes) if output is not None else step_shape
        if output is not None and (step_shape != wanted if exact else type(step_shape) is not type(wanted)):
            raise ExpressionProblem("list-number",
                                    f"in {function.name}, the output {output.name} is declared as "
                                    f"{shape_text(wanted, exact)}; `{step.text.strip()}` gives "
                                    f"{shape_text(step_shape, exact)}",
                                    column, len(function.name), "Declare its length, `count: n`." if wanted is None else "")
    return shapes
