"""Expressions of SIDOPS evaluated to matrices of scalar expressions: vectors, functions, calculus, events."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from itertools import product as product_of
from typing import Protocol

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.choices import renamed
from heavebond.import_20sim.expressions_parser import Unreadable
from heavebond.import_20sim.matrices import MATRICES, Matrix, extreme, multiplied, power, product, total
from heavebond.import_20sim.sidops_tree import Expr

SAME = {"sin": "sin", "cos": "cos", "tan": "tan", "tanh": "tanh", "exp": "exp", "ln": "log", "log": "log", "sqrt": "sqrt",
        "abs": "abs", "sign": "sign", "arcsin": "asin", "asin": "asin", "arccos": "acos", "acos": "acos", "arctan": "atan",
        "atan": "atan"}
MEMBERS = {"power": ("e", "f"), "hydraulic": ("p", "phi"), "translation": ("F", "v"), "rotation": ("T", "omega"),
           "electric": ("u", "i"), "thermal": ("T", "dS"), "pseudothermal": ("T", "dQ"), "pneumatic": ("p", "phi"),
           "mechanical": ("F", "v"), "acoustic": ("p", "phi"), "magnetic": ("um", "phi"), "diffusion": ("mu", "dN"),
           "petrinet": ("e", "f"), "pseudohydraulic": ("p", "dm"), "pseudopneumatic": ("p", "dm"),
           "pseudothermalh": ("T", "dH"), "electrical": ("u", "i")}
MOST_ELEMENTS = 2000
MOST_TIMES = 16  # largest exponent of a matrix
OUTSIDE = "if an index that depends on the run lies outside its vector, the first or the last element is used"


class Calculus(Protocol):
    """Operations of the component under construction that an expression needs."""

    def state(self, rate: Expr, first: Expr | None, line: int) -> Expr: ...
    def begins(self, state: Expr, first: Expr) -> None: ...
    def resettable(self, args: list[Expr], line: int) -> Expr: ...
    def limited(self, args: list[Expr], line: int) -> Expr: ...
    def discrete(self, kind: str, args: list[Expr], final: Expr | None, line: int) -> Expr: ...
    def sample_time(self) -> Expr: ...
    def event(self, kind: str, args: list[Expr], line: int) -> Expr: ...
    def floor(self, value: Expr) -> Expr: ...
    def truncated(self, ratio: Expr) -> Expr: ...
    def delayed(self, args: list[Expr], line: int) -> Expr: ...
    def noise(self, line: int) -> Expr: ...
    def require(self, index: Expr, size: int) -> bool: ...
    def note(self, line: int, text: str) -> None: ...


@dataclass
class Evaluator:
    """Names to elements, and the numbers that are known (constants, loop variables)."""

    names: Mapping[str, Matrix]
    numbers: dict[str, float]
    make: Calculus
    values: dict[str, Expr] = field(default_factory=dict)  # elements that have been assigned before
    table: Callable[[Expr, Expr], Expr] = lambda name, _: _no_table(name)
    external: Callable[[Expr, Evaluator], Matrix] = lambda call, _: _unknown(call)  # a function of a compiled library
    defined: dict[str, Expr] = field(default_factory=dict)  # values of variables that are used by name
    indexed: bool = False  # True after an index that is determined during the run has been listed
    final: Callable[[Expr], Matrix | None] = lambda _: None  # the variables of a name, independent of former assignments
    knots: Callable[[Expr], Matrix | None] = lambda _: None  # the value of `sum (direct (p.f))` or `first (p.e)` at a knot

    def scalar(self, expr: Expr) -> Expr:
        matrix = self(expr)
        if len(matrix) != 1 or len(matrix[0]) != 1:
            raise Unreadable(expr.line, "a vector is given instead of a number")
        return matrix[0][0]

    def whole(self, expr: Expr) -> int:
        """A whole number that is known: a size or an index."""
        value = fold(self.scalar(expr), self.numbers)
        if value is None or abs(value) > MOST_ELEMENTS:
            raise Unreadable(expr.line, "a size or an index is not a known whole number")
        return round(value)

    def __call__(self, expr: Expr) -> Matrix:
        """The elements of an expression by rows, at least one."""
        matrix = self._elements(expr)
        if not matrix or not matrix[0]:
            raise Unreadable(expr.line, "a matrix without elements is not possible")
        return matrix

    def _elements(self, expr: Expr) -> Matrix:
        op = expr.op
        if op == "number":
            return [[f.number(expr.value)]]
        if op == "name":
            return self._name(expr)
        if op == "matrix":
            blocks = [self(e) for e in expr.args]
            rows: Matrix = []
            for k in range(0, len(blocks), expr.columns):
                row = blocks[k:k + expr.columns]
                if len({len(b) for b in row}) != 1:
                    raise Unreadable(expr.line, "the parts of a matrix have different heights")
                rows += [[e for b in row for e in b[i]] for i in range(len(row[0]))]
            return rows
        if op == "index":
            return self._index(expr)
        if op == "call":
            return self._call(expr)
        if op == "if":
            condition, then, otherwise = self.scalar(expr.args[0]), self(expr.args[1]), self(expr.args[2])
            return each(lambda a, b: Expr("if", (condition, a, b)), then, otherwise, expr.line)
        if op == "*":
            return _product(self(expr.args[0]), self(expr.args[1]), expr.line)
        if op == "^" and _is_square(base := self(expr.args[0])):
            # a square matrix to a power, `expr` being `A ^ n`; of its inverse for a negative one
            exponent = fold(self.scalar(expr.args[1]), self.numbers)
            if exponent is None or exponent != round(exponent) or abs(exponent) > MOST_TIMES:
                raise Unreadable(expr.line, "the exponent of a matrix is not a known whole number "
                                            f"from -{MOST_TIMES} to {MOST_TIMES}")
            if exponent < 0:
                base = self._call(Expr("call", (expr.args[0],), "inverse", line=expr.line))
            return power(base, abs(round(exponent)))
        if op == "/" and _is_square(self(expr.args[1])):  # A / B is A * inverse (B)
            inverse = self._call(Expr("call", (expr.args[1],), "inverse", line=expr.line))
            return _product(self(expr.args[0]), inverse, expr.line)
        if op in ("negative", "not"):
            return [[f.negative(e) if op == "negative" else Expr("not", (e,)) for e in row] for row in self(expr.args[0])]
        if op in ("text", "range"):
            raise Unreadable(expr.line, "a text is given instead of a number")
        return each(lambda a, b: self._pair(op, a, b, expr.line), self(expr.args[0]), self(expr.args[1]), expr.line)

    def _pair(self, op: str, a: Expr, b: Expr, line: int) -> Expr:
        if op in (".*", "./", ".^"):
            op = op[1]
        if op in ("mod", "div"):
            count = self.make.truncated(Expr("/", (a, b)))
            return count if op == "div" else Expr("-", (a, f.multiply(b, count)))
        if op == "==" and f.name("time") in (a, b):  # an instant
            instant = b if a == f.name("time") else a
            return Expr("event", (instant,), "time")
        if op == "xor":
            return Expr("!=", (_number(a), _number(b)))
        if op == "+":
            return f.add(a, b)
        if op == "-" and b.op == "negative":
            return f.add(a, b.args[0])
        if op == "-" and b.op == "-" and b.args[0] == a:  # x - x mod y
            return b.args[1]
        return Expr(op, (a, b))

    def _name(self, expr: Expr) -> Matrix:
        if expr.name in self.numbers:
            return [[f.number(self.numbers[expr.name])]]
        if expr.name in self.names:
            return [[self.values.get(f.text(e), e) if e.op == "name" else e for e in row] for row in self.names[expr.name]]
        known = {"pi": f.name("pi"), "time": f.name("time"), "starttime": f.number(0), "true": f.number(1),
                 "false": f.number(0), "major": f.number(1), "twopi": f.multiply(f.number(2), f.name("pi")),
                 "g_n": f.number(9.80665)}  # standard acceleration of free fall
        if expr.name.lower() in known:
            return [[known[expr.name.lower()]]]
        if expr.name.lower() == "sampletime":
            return [[self.make.sample_time()]]
        raise Unreadable(expr.line, f"'{expr.name}' is not declared")

    def _index(self, expr: Expr) -> Matrix:
        base = self(expr.args[0])
        if len(expr.args) == 2 and len(base) > 1 and len(base[0]) > 1:
            base = [[e] for row in base for e in row]
        if len(expr.args) == 2 and len(base) == 1:
            base = [[e] for e in base[0]]
        columns = self._range(expr.args[2], len(base[0])) if len(expr.args) > 2 else [0]
        if expr.args[1].op != "range" and fold(index := self.scalar(expr.args[1]), self.numbers) is None:
            self._note_index(index, len(base), expr.line)
            return [[_chosen(index, [row[k] for row in base]) for k in columns]]
        rows = self._range(expr.args[1], len(base))
        return [[base[i][k] for k in columns] for i in rows]

    def places(self, left: Expr, value: Expr) -> list[tuple[Expr, Expr, Expr]]:
        """The elements that `x[i] = value` may set if i is determined during the run, with the condition and the value
        for each, in which i is known; empty if it is known anyway."""
        indices = left.args[1:] if left.op == "index" else ()
        if all(e.op == "range" or fold(self.scalar(e), self.numbers) is not None for e in indices):
            return []
        rows = self.names.get(left.args[0].name, [])
        if len(indices) == 1:
            rows = [[e] for row in rows for e in row]
        sizes = (len(rows), len(rows[0]) if rows else 0)
        positions = [self._possible_positions(e, n) for e, n in zip(indices, sizes, strict=False)]
        whole, known = self.scalar(value), [self.scalar(e) if e.op == "name" else None for e in indices]
        choices = []
        for place in product_of(*positions):
            conditions = [c for _, c in place if c is not None]
            element_value = whole
            for index, (k, condition) in zip(known, place, strict=True):
                if index is not None and index.op == "name" and condition is not None:
                    element_value = renamed(element_value, index.name, f.number(k + 1.0))
            element = rows[place[0][0]][place[1][0] if len(place) > 1 else 0]
            choices.append((element, reduce(lambda a, b: Expr("and", (a, b)), conditions), element_value))
        return choices

    def _possible_positions(self, index: Expr, size: int) -> list[tuple[int, Expr | None]]:
        """The positions that an index may name, with the condition for each if the run determines it."""
        if index.op == "range" or fold(value := self.scalar(index), self.numbers) is not None:
            return [(k, None) for k in self._range(index, size)]
        self._note_index(value, size, index.line)
        positions_with_conditions: list[tuple[int, Expr | None]] = []
        for k in range(size):
            above, below = Expr(">", (value, f.number(k + 0.5))), Expr("<", (value, f.number(k + 1.5)))
            positions_with_conditions.append((k, below if k == 0 else above if k == size - 1
                                              else Expr("and", (above, below))))
        return positions_with_conditions

    def _note_index(self, index: Expr, size: int, line: int) -> None:
        """List once that an index may lie outside 1 to `size`."""
        least, most = self._between(index)
        if not self.indexed and not (least > 0.5 and most < size + 0.5) and not self.make.require(index, size):
            self.make.note(line, OUTSIDE)
            self.indexed = True

    def _between(self, expr: Expr) -> tuple[float, float]:
        """Bounds of a choice among numbers, or of a sum of such; infinite if they are not known."""
        if (value := fold(expr, self.numbers)) is not None:
            return value, value
        if expr.op == "name" and expr.name in self.defined:
            return self._between(self.defined[expr.name])
        if expr.op in ("if", "+", "-") and expr.size < MOST_ELEMENTS:
            (a, b), (c, d) = (self._between(e) for e in expr.args[-2:])
            return (min(a, c), max(b, d)) if expr.op == "if" else (a + c, b + d) if expr.op == "+" else (a - d, b - c)
        return -math.inf, math.inf

    def _range(self, expr: Expr, size: int) -> list[int]:
        first, last = expr.args if expr.op == "range" else (expr, expr)
        indices = list(range(self.whole(first) - 1, self.whole(last)))
        if not indices or indices[0] < 0 or indices[-1] >= size:
            raise Unreadable(expr.line, "an index lies outside its vector")
        return indices

    def _call(self, expr: Expr) -> Matrix:
        name = expr.name.lower()
        if name in ("sum", "mul", "first", "collect") and (at_knot := self.knots(expr)) is not None:
            return at_knot
        if name == "table" and len(expr.args) == 2:
            return [[self.table(expr.args[0], self.scalar(expr.args[1]))]]
        if name == "dll":
            return self.external(expr, self)
        if name in EXTERNAL:
            return _unknown(expr)
        if name in ("int", "ddt"):
            inner = self(expr.args[0])
            first = self(expr.args[1]) if len(expr.args) > 1 else None
            if name == "ddt":
                for e, value in (pair for row in _pairs(inner, first, expr.line) for pair in row) if first else ():
                    self.make.begins(e, value)
                return [[f.call("der", e) for e in row] for row in inner]
            spread = first if first is None or (len(first), len(first[0])) == (len(inner), len(inner[0])) else \
                [[first[0][0] for _ in row] for row in inner]
            return [[self.make.state(e, spread[i][k] if spread else None, expr.line) for k, e in enumerate(row)]
                    for i, row in enumerate(inner)]
        if name in MATRICES:
            try:
                return MATRICES[name](*[self(a) for a in expr.args])
            except (TypeError, ValueError, IndexError):
                raise Unreadable(expr.line, f"the sizes of the arguments of `{expr.name}` do not match") from None
        if name in ("eye", "identity"):
            n = self.whole(expr.args[0]) if expr.args else 0
            if not 1 <= n * n <= MOST_ELEMENTS:
                raise Unreadable(expr.line, f"`{expr.name}` cannot have {n} rows")
            return [[f.number(float(i == k)) for k in range(n)] for i in range(n)]
        if name in ("sum", "msum", "mul", "min", "max"):
            flat = [e for arg in expr.args for row in self(arg) for e in row]
            return [[multiplied(flat) if name == "mul" else total(flat) if name in ("sum", "msum") else extreme(name, flat)]]
        if name in SAME and len(expr.args) == 1:
            return [[f.call(SAME[name], e) for e in row] for row in self(expr.args[0])]
        args = [self(a) for a in expr.args if a.op != "text"]
        whole = next((a for a in args if (len(a), len(a[0])) != (1, 1)), [[f.number(0)]])
        sides = [[[e for e, _ in row] for row in _pairs(a, whole, expr.line)] for a in args]
        final = self.final(expr.args[0]) if expr.args else None
        return [[self._function(name, [side[i][k] for side in sides], final[i][k] if final else None, expr)
                 for k in range(len(row))] for i, row in enumerate(whole)]

    def _function(self, name: str, args: list[Expr], final: Expr | None, expr: Expr) -> Expr:
        if name in ("event", "eventup", "eventdown", "timeevent", "frequencyevent"):
            return self.make.event(name, args, expr.line)
        if name in ("sample", "hold", "previous", "dint", "ddif"):
            return self.make.discrete(name, args, final, expr.line)
        if name in ("resint", "limint"):
            return (self.make.resettable if name == "resint" else self.make.limited)(args, expr.line)
        if name == "tdelay":
            return self.make.delayed(args, expr.line)
        if name in ("floor", "round", "ceil", "trunc", "truncate") and len(args) == 1:
            # a whole number computed from a value, followed by events
            value = args[0]
            if (known := fold(value, self.numbers)) is not None:
                whole = {"floor": math.floor, "ceil": math.ceil,
                         "round": lambda x: math.copysign(math.floor(abs(x) + 0.5), x)}
                return f.number(float(whole.get(name, math.trunc)(known)))
            if name == "floor":
                return self.make.floor(value)
            if name == "ceil":
                return f.negative(self.make.floor(f.negative(value)))
            if name == "round":
                return self.make.floor(f.add(value, f.number(0.5)))
            return self.make.truncated(value)
        if name in ("gauss", "ran"):
            return self.make.noise(expr.line)
        if name == "dly" and args:
            self.make.note(expr.line, "`dly` delays by a step of the integration; it is left out")
            return args[0]
        if name in BITS:
            # a function of the bits of known whole numbers
            values = [fold(a, self.numbers) for a in args]
            try:
                return f.number(float(BITS[name](*(int(v) for v in values if v is not None))))
            except (TypeError, ValueError):
                raise Unreadable(expr.line, f"`{expr.name}` is translated for known whole numbers only") from None
        try:
            return FUNCTIONS[name](*args)
        except (KeyError, TypeError):
            raise Unreadable(expr.line, f"the function `{expr.name}` is not translated") from None


def _no_table(name: Expr) -> Expr:
    raise Unreadable(name.line, "the folder of the model contains no files")


def _unknown(call: Expr) -> Matrix:
    raise Unreadable(call.line, f"`{call.name}`: {EXTERNAL[call.name.lower()]}")


EXTERNAL = {"dll": "a function of a compiled library (DLL), whose law the model does not hold, is not translated",
            "data": "values from a file are not translated",
            "realtime": "the clock of the computer is not translated",
            "table": "a table needs the name of a file and an input"}
FUNCTIONS: dict[str, Callable[..., Expr]] = {
    "algebraic": lambda x, *_: x,
    "exp10": lambda x: Expr("^", (f.number(10), x)),
    "arcsinh": lambda x: f.call("log", f.add(x, f.call("sqrt", f.add(Expr("^", (x, f.number(2))), f.number(1))))),
    "arccosh": lambda x: f.call("log", f.add(x, f.call("sqrt", Expr("-", (Expr("^", (x, f.number(2))), f.number(1)))))),
    "arctanh": lambda x: Expr("/", (f.call("log", Expr("/", (f.add(f.number(1), x), Expr("-", (f.number(1), x))))),
                                    f.number(2))),
    "sqr": lambda x: Expr("^", (x, f.number(2))),
    "exp2": lambda x: Expr("^", (f.number(2), x)),
    "log10": lambda x: Expr("/", (f.call("log", x), f.call("log", f.number(10)))),
    "log2": lambda x: Expr("/", (f.call("log", x), f.call("log", f.number(2)))),
    "limit": lambda x, low, high: f.call("min", f.call("max", x, low), high),
    "step": lambda t: Expr("if", (Expr("<", (f.name("time"), t)), f.number(0), f.number(1))),
    "ramp": lambda t: f.call("max", Expr("-", (f.name("time"), t)), f.number(0)),
    "impulse": lambda t, w: Expr("if", (Expr("and", (Expr(">=", (f.name("time"), t)),
                                                     Expr("<", (f.name("time"), f.add(t, w))))),
                                        Expr("/", (f.number(1), w)), f.number(0))),
    "sinh": lambda x: Expr("/", (Expr("-", (f.call("exp", x), f.call("exp", f.negative(x)))), f.number(2))),
    "cosh": lambda x: Expr("/", (f.add(f.call("exp", x), f.call("exp", f.negative(x))), f.number(2))),
    **dict.fromkeys(("atan2", "arctan2"), lambda y, x: f.call("atan2", y, x)),
}


BITS: dict[str, Callable[..., int]] = {
    "bitand": operator.and_, "bitor": operator.or_, "bitxor": operator.xor, "bitinv": operator.invert,
    "bitget": lambda a, k: a >> (k - 1) & 1, "bitset": lambda a, k: a | 1 << (k - 1),
    "bitclear": lambda a, k: a & ~(1 << (k - 1)), "bitcmp": lambda a, n: ~a & ((1 << n) - 1),
    "bitshift": lambda a, k: a << k if k > 0 else a >> -k, "bitshiftright": lambda a, k: a >> k if k > 0 else a << -k,
}


def _chosen(index: Expr, elements: list[Expr]) -> Expr:
    """The element of an index that is computed during the run."""
    choice = elements[-1]
    for k in range(len(elements) - 1, 0, -1):
        choice = Expr("if", (Expr("<", (index, f.number(k + 0.5))), elements[k - 1], choice))
    return choice


def _number(expr: Expr) -> Expr:
    return Expr("if", (expr, f.number(1), f.number(0)))


def _is_square(matrix: Matrix) -> bool:
    return len(matrix) == len(matrix[0]) > 1


def spread(values: Matrix, count: int, line: int) -> list[Expr]:
    """The elements of a matrix; a single one is repeated."""
    flat = [e for row in values for e in row]
    if len(flat) not in (1, count):
        raise Unreadable(line, f"{len(flat)} elements are given where {count} are needed")
    return flat if len(flat) == count else flat * count


def each(pair: Callable[[Expr, Expr], Expr], a: Matrix, b: Matrix, line: int) -> Matrix:
    """Combine the elements of two matrices; a number is combined with all elements of the other one."""
    return [[pair(x, y) for x, y in row] for row in _pairs(a, b, line)]


def _pairs(a: Matrix, b: Matrix, line: int) -> list[list[tuple[Expr, Expr]]]:
    """Pairs of elements of two matrices of the same size; a number is combined with all elements."""
    if len(a) == 1 and len(a[0]) == 1:
        a = [[a[0][0] for _ in row] for row in b]
    if len(b) == 1 and len(b[0]) == 1:
        b = [[b[0][0] for _ in row] for row in a]
    if (len(a), len(a[0])) != (len(b), len(b[0])):
        raise Unreadable(line, "two vectors have different sizes")
    return [list(zip(row, row_of_b, strict=True)) for row, row_of_b in zip(a, b, strict=True)]


def _product(a: Matrix, b: Matrix, line: int) -> Matrix:
    if (len(a) == 1 and len(a[0]) == 1) or (len(b) == 1 and len(b[0]) == 1):
        return each(f.multiply, a, b, line)
    if len(a[0]) != len(b):
        raise Unreadable(line, "the sizes of a matrix product do not match")
    return product(a, b)


def fold(expr: Expr, numbers: Mapping[str, float]) -> float | None:
    """The value of an expression of known numbers; None if it is not known, or not finite."""
    value = _fold(expr, numbers)
    return value if value is not None and math.isfinite(value) else None


def _fold(expr: Expr, numbers: Mapping[str, float]) -> float | None:
    if expr.op == "number":
        return expr.value
    if expr.op == "name":
        return math.pi if expr.name == "pi" else numbers.get(expr.name)
    if expr.op == "if":
        condition = fold(expr.args[0], numbers)
        return None if condition is None else fold(expr.args[1 if condition else 2], numbers)
    values = [fold(e, numbers) for e in expr.args]
    if expr.op in ("and", "or") and any(v is not None and bool(v) == (expr.op == "or") for v in values):
        return float(expr.op == "or")  # one side determines the result
    if None in values:
        return None
    if expr.op == "call":
        try:
            return float(CALLS[expr.name](*values))
        except (KeyError, TypeError, ValueError, OverflowError):
            return None
    if expr.op not in FOLDED:
        return None
    a, b = (*values, 0.0)[:2]
    assert a is not None and b is not None
    try:
        return float(FOLDED[expr.op](a, b))
    except (ZeroDivisionError, OverflowError, ValueError):
        return None


FOLDED: dict[str, Callable[[float, float], float]] = {
    "negative": lambda a, _: -a, "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "^": math.pow, "<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge, "==": operator.eq,
    "!=": operator.ne, "and": lambda a, b: bool(a) and bool(b), "or": lambda a, b: bool(a) or bool(b),
    "not": lambda a, _: not a,
}
CALLS: dict[str, Callable[..., float]] = {
    **{n: getattr(math, n) for n in ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "asin", "acos", "atan", "atan2",
                                     "floor")},
    "abs": abs, "min": min, "max": max, "sign": lambda x: (x > 0) - (x < 0),
}
