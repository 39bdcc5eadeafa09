"""Expression trees: the node classes, the functions of files, and queries on a tree."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Union

from heavebond.core.errors import Place
from heavebond.core.units import Unit

Expr = Union["Number", "Name", "Call", "FunctionCall", "Binary", "Negative", "Compare", "Logic", "Not", "SumOver", "Slice",
             "Elements"]


@dataclass(frozen=True)
class Number:
    """A number in SI; `unit` is None if it was written without a unit."""

    value: float
    unit: Unit | None
    column: int


@dataclass(frozen=True)
class Name:
    """A dotted name; the index of a part (`p[i]`) is an expression after the name of the part."""

    parts: tuple[str | Expr, ...]
    column: int
    length: int

    @property
    def base(self) -> str:
        """The name without indices and members: `x` for `x[2]`."""
        return self.text.partition("[")[0]

    @property
    def text(self) -> str:
        """The name as text: `a.x`, or `p[2].effort`; an index that is not a number is `[...]`."""
        words: list[str] = []
        for part in self.parts:
            if isinstance(part, str):
                words.append(part)
            elif isinstance(part, Number):
                words[-1] += f"[{int(part.value)}]"
            else:
                words[-1] += "[...]"
        return ".".join(words)


@dataclass(frozen=True)
class Call:
    """function(args)."""

    function: str
    args: tuple[Expr, ...]
    column: int


@dataclass(frozen=True)
class FunctionCall:
    """function(args).output of a function that is defined in a file."""

    function: Function
    args: tuple[Expr, ...]
    output: str
    column: int


@dataclass(frozen=True)
class Binary:
    """left op right, op one of + - * / **."""

    op: str
    left: Expr
    right: Expr
    column: int


@dataclass(frozen=True)
class Negative:
    """-operand."""

    operand: Expr
    column: int


@dataclass(frozen=True)
class Compare:
    """left op right, op one of < <= > >= == !=."""

    op: str
    left: Expr
    right: Expr
    column: int


@dataclass(frozen=True)
class Logic:
    """left and/or right."""

    op: str
    left: Expr
    right: Expr
    column: int


@dataclass(frozen=True)
class Not:
    """not operand."""

    operand: Expr
    column: int


@dataclass(frozen=True)
class SumOver:
    """sum(body for index in low..high)."""

    body: Expr
    index: str
    low: Expr
    high: Expr
    column: int


@dataclass(frozen=True)
class Elements:
    """[a, b]: the elements of a list, or the rows of a matrix."""

    items: tuple[Expr, ...]
    column: int


@dataclass(frozen=True)
class Slice:
    """low..high as an index: the elements of a list from `low` to `high`."""

    low: Expr
    high: Expr
    column: int


@dataclass(frozen=True)
class Equation:
    """left = right."""

    left: Expr
    right: Expr


@dataclass(frozen=True)
class Quantity:
    """An input, an output or a constant of a function.

    The unit may be generic (`$U`); each call determines it. `sizes` is the length of a list, or the rows and columns of a
    matrix. A name in the sizes of an input is a whole number that is determined by the arguments of each call. `value` is
    the value of a constant, or the nominal size of an input of an external function, in SI.
    """

    name: str
    unit: Unit
    place: Place
    doc: str = ""
    value: float | None = None
    sizes: tuple[Expr, ...] = ()

    @property
    def description(self) -> str:
        """The description with the shape, for the documentation."""
        return ("", "list; ", "matrix; ")[len(self.sizes)] + self.doc


@dataclass(frozen=True)
class Step:
    """One step of a function, `name = expr`, with its label; the columns of `expr` count from `place`."""

    name: str
    expr: Expr
    text: str
    label: str
    place: Place


@dataclass(frozen=True)
class External:
    """The program of an external function: its file, the name of the function in it, how its arguments are passed, the name
    of the function of its derivatives (empty: differences), and whether the program may be executed."""

    path: Path
    call: str
    signature: str = "values"
    derivatives: str = ""
    allowed: bool = False

    @property
    def entries(self) -> tuple[str, ...]:
        """The names of its functions in the file: of the values, and of the derivatives if it gives them."""
        return (self.call, self.derivatives) if self.derivatives else (self.call,)


@dataclass(frozen=True, eq=False)
class Function:
    """A function of a file: steps compute the outputs from the inputs; each step defines a name for the later steps. An
    external function has no steps but a program."""

    name: str
    summary: str
    place: Place
    path: Path
    inputs: dict[str, Quantity]
    outputs: dict[str, Quantity]
    constants: dict[str, Quantity]
    steps: tuple[Step, ...]
    restrictions: str = ""
    source: str = ""
    external: External | None = None

    @property
    def usage(self) -> str:
        """An example of a call."""
        output = f".{next(iter(self.outputs))}" if len(self.outputs) > 1 else ""
        return f"{self.name}({', '.join(self.inputs)}){output}"

    @property
    def lengths(self) -> list[str]:
        """The names of the whole numbers that the lengths of the arguments of a call determine."""
        return list(dict.fromkeys(size.text for q in self.inputs.values() for size in q.sizes if isinstance(size, Name)))

    def needed(self, output: str) -> tuple[Step, ...]:
        """The steps on which an output depends, in the order of the file."""
        wanted, steps = {output}, list[Step]()
        for step in reversed(self.steps):
            if step.name in wanted:
                steps.append(step)
                wanted |= {name.base for name in names(step.expr)}
        return tuple(reversed(steps))


def functions_in(expr: Expr) -> Iterator[Function]:
    """Every function of a file that an expression calls directly."""
    if isinstance(expr, FunctionCall):
        yield expr.function
    for child in children(expr):
        yield from functions_in(child)


def inside(call: FunctionCall) -> Iterator[Expr]:
    """The steps on which the output of a call depends, with the arguments substituted for the inputs.

    Use it to search an equation including the functions that it calls. The names of steps get the prefix `function()`, so
    that they differ from the names of the caller.
    """
    function = call.function
    values: dict[str, Expr] = {step.name: Name((f"{function.name}()", step.name), call.column, 1) for step in function.steps}
    values.update(zip(function.inputs, call.args, strict=True))
    for step in function.needed(call.output):
        yield put_in(step.expr, values)


def put_in(expr: Expr, values: Mapping[str, Expr]) -> Expr:
    """Substitute expressions for names."""
    if isinstance(expr, Name):
        return values.get(expr.text, values.get(expr.base, expr))
    if isinstance(expr, (Call, FunctionCall)):
        return replace(expr, args=tuple(put_in(arg, values) for arg in expr.args))
    if isinstance(expr, (Binary, Compare, Logic)):
        return replace(expr, left=put_in(expr.left, values), right=put_in(expr.right, values))
    if isinstance(expr, (Negative, Not)):
        return replace(expr, operand=put_in(expr.operand, values))
    if isinstance(expr, Elements):
        return replace(expr, items=tuple(put_in(item, values) for item in expr.items))
    if isinstance(expr, SumOver):
        inner = {name: value for name, value in values.items() if name != expr.index}
        return replace(expr, low=put_in(expr.low, values), high=put_in(expr.high, values), body=put_in(expr.body, inner))
    return expr


def names(expr: Expr) -> Iterator[Name]:
    """Every name in an expression, in the order of the text, without the index of a sum."""
    if isinstance(expr, Name):
        yield expr
        for part in expr.parts:
            if not isinstance(part, str):
                yield from names(part)
    elif isinstance(expr, SumOver):
        for inner in (expr.low, expr.high, expr.body):
            yield from (n for n in names(inner) if n.text != expr.index)
    else:
        for child in children(expr):
            yield from names(child)


def children(expr: Expr) -> tuple[Expr, ...]:
    """The operands of an expression."""
    if isinstance(expr, (Call, FunctionCall)):
        return expr.args
    if isinstance(expr, (Binary, Compare, Logic)):
        return (expr.left, expr.right)
    if isinstance(expr, (Negative, Not)):
        return (expr.operand,)
    if isinstance(expr, SumOver):
        return (expr.low, expr.high, expr.body)
    if isinstance(expr, Slice):
        return (expr.low, expr.high)
    if isinstance(expr, Elements):
        return expr.items
    return ()


def constant(expr: Expr) -> float | None:
    """The value of an expression that contains numbers only, otherwise None."""
    if isinstance(expr, Number):
        return expr.value
    if isinstance(expr, Negative):
        inner = constant(expr.operand)
        return None if inner is None else -inner
    if isinstance(expr, Binary):
        left, right = constant(expr.left), constant(expr.right)
        if left is None or right is None:
            return None
        try:
            value = _ARITHMETIC[expr.op](left, right)
        except (OverflowError, ZeroDivisionError):
            return None
        return value if isinstance(value, float) else None  # a root of a negative number is complex
    return None


_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "**": operator.pow}
