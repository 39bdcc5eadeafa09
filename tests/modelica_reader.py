"""A small reader of flat Modelica models, written for the tests from the language specification: it evaluates both sides of
each equation, and the `when` clauses, at given values."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

Values = Mapping[str, float]
Expression = Callable[["Scope"], float]
TOKEN = re.compile(r'\s+|//[^\n]*|(?P<text>"(?:[^"\\]|\\.)*")|(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)|'
                   r"(?P<name>[A-Za-z_]\w*)|(?P<sign><=|>=|==|<>|:=|[-+*/^(){}\[\],;:=<>.])")
PLAIN = {"sqrt": math.sqrt, "exp": math.exp, "log": math.log, "sin": math.sin, "cos": math.cos, "tan": math.tan,
         "asin": math.asin, "acos": math.acos, "atan": math.atan, "sinh": math.sinh, "cosh": math.cosh, "tanh": math.tanh,
         "abs": abs, "floor": math.floor, "ceil": math.ceil, "min": min, "max": max, "atan2": math.atan2, "rem": math.fmod,
         "sign": lambda x: float((x > 0) - (x < 0))}


@dataclass(frozen=True)
class Scope:
    """Values of variables, their derivatives and their values before an event; `calls` are functions of the model."""

    values: Values
    rates: Values = field(default_factory=dict)
    before: Values = field(default_factory=dict)
    arrays: Mapping[str, object] = field(default_factory=dict)
    edges: Mapping[str, bool] = field(default_factory=dict)
    delayed: Callable[[Expression, float], float] | None = None  # source and length of a delay
    index: int | None = None


@dataclass(frozen=True)
class Sum:
    """A sum of signed terms; the terms of a sum or a choice in brackets count as terms."""

    terms: tuple[tuple[float, Expression], ...]

    def __call__(self, scope: Scope) -> float:
        return sum(sign * term(scope) for sign, term in self.terms)

    def parts(self, scope: Scope) -> list[float]:
        """The values of the terms."""
        return [sign * value for sign, term in self.terms
                for value in _parts(term, scope)]


@dataclass(frozen=True)
class Choice:
    """`if test then first else second`."""

    test: Expression
    first: Expression
    second: Expression

    def __call__(self, scope: Scope) -> float:
        return self.first(scope) if self.test(scope) else self.second(scope)

    def parts(self, scope: Scope) -> list[float]:
        """The values of the terms of the branch."""
        branch = self.first if self.test(scope) else self.second
        return _parts(branch, scope)


@dataclass(frozen=True)
class Product:
    """A product, or a quotient."""

    left: Expression
    right: Expression
    divided: bool

    def __call__(self, scope: Scope) -> float:
        return self.left(scope) / self.right(scope) if self.divided else self.left(scope) * self.right(scope)

    def parts(self, scope: Scope) -> list[float]:
        """The products with each term of the sums in the factors."""
        if self.divided:
            return [value / self.right(scope) for value in _parts(self.left, scope)]
        return [a * b for a in _parts(self.left, scope) for b in _parts(self.right, scope)]


def _parts(expression: Expression, scope: Scope) -> list[float]:
    return expression.parts(scope) if isinstance(expression, Sum | Choice | Product) else [expression(scope)]


@dataclass(frozen=True)
class Equation:
    """An equation: the variable on its left side if that is all of it, both sides, its comment, and all names in it."""

    variable: str
    left: Sum
    right: Sum
    comment: str
    names: frozenset[str]


@dataclass
class When:
    """A `when` clause: its conditions, its assignments (variable, value, whether it is a `reinit`), its comment."""

    conditions: list[Expression]
    assignments: list[tuple[str, Expression, bool]]
    ends: bool = False
    comment: str = ""


@dataclass
class ModelicaModel:
    """A flat model: attributes of each declaration, equations (left, right, comment), and `when` clauses."""

    name: str = ""
    declared: dict[str, dict[str, object]] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    bindings: dict[str, Expression] = field(default_factory=dict)
    arrays: dict[str, object] = field(default_factory=dict)
    equations: list[Equation] = field(default_factory=list)
    flags: dict[str, Expression] = field(default_factory=dict)
    whens: list[When] = field(default_factory=list)
    experiment: dict[str, float] = field(default_factory=dict)


def read(text: str) -> ModelicaModel:
    """Read a model without classes in it but functions, whose bodies are skipped."""
    return _Reader(re.sub(r"\n  function (\w+).*?\n  end \1;", "", text, flags=re.DOTALL)).model()


class _Reader:
    def __init__(self, text: str):
        self.tokens, position = [], 0
        while position < len(text):
            match = TOKEN.match(text, position)
            assert match, f"no token of Modelica: {text[position:position + 40]!r}"
            if match.lastgroup:
                self.tokens.append((match.lastgroup, match[0]))
            position = match.end()
        self.at = 0

    def peek(self) -> str:
        return self.tokens[self.at][1]

    def take(self, *expected: str) -> str:
        token = self.tokens[self.at][1]
        assert not expected or token in expected, f"{expected} expected before {self.tokens[self.at:self.at + 8]}"
        self.at += 1
        return token

    def has(self, token: str) -> bool:
        if self.peek() == token:
            self.at += 1
            return True
        return False

    def string(self) -> str:
        return self.take()[1:-1] if self.tokens[self.at][0] == "text" else ""

    def model(self) -> ModelicaModel:
        result = ModelicaModel()
        self.take("model")
        result.name = self.take()
        self.string()
        while self.peek() != "equation":
            self.declaration(result)
        self.take("equation")
        while self.peek() not in ("annotation", "end"):
            if self.has("when"):
                result.whens.append(self.when())
            else:
                self.equation(result)
        if self.has("annotation"):
            self.take("(")
            self.take("experiment")
            result.experiment = {k: v for k, v in self.attributes().items() if isinstance(v, float)}
            self.take(")")
            self.take(";")
        self.take("end")
        assert self.take() == result.name
        self.take(";")
        assert self.at == len(self.tokens)
        return result

    def declaration(self, result: ModelicaModel) -> None:
        kind = ""
        while self.peek() in ("parameter", "constant", "discrete", "input", "output"):
            kind = self.take()
        type_ = self.take("Real", "Boolean")
        name = self.take()
        assert name not in result.declared, f"{name} is declared twice"
        size = []
        while self.peek() in ("[", ","):
            self.take("[", ",")
            size.append(int(self.take()))
            self.has("]")
        attributes = self.attributes() if self.peek() == "(" else {}
        if self.has("="):
            if size:
                array = self.array()
                assert len(array) == size[0]
                result.arrays[name] = array
            else:
                result.bindings[name] = self.expression()
        attributes["doc"] = self.string()
        self.take(";")
        result.declared[name], result.kinds[name] = attributes, kind or type_

    def attributes(self) -> dict[str, object]:
        found: dict[str, object] = {}
        self.take("(")
        while not self.has(")"):
            self.has(",")
            self.has("each")
            name = self.take()
            self.take("=")
            if self.tokens[self.at][0] == "text":
                found[name] = self.string()
            elif self.peek() in ("true", "false"):
                found[name] = self.take() == "true"
            elif self.has("StateSelect"):
                self.take(".")
                found[name] = self.take()
            else:
                found[name] = self.expression()(Scope({}))
        return found

    def array(self) -> list[object]:
        self.take("{")
        items: list[object] = []
        while True:
            items.append(self.array() if self.peek() == "{" else self.expression()(Scope({})))
            if self.take(",", "}") == "}":
                return items

    def equation(self, result: ModelicaModel) -> None:
        begin = self.at
        left = self.side()
        self.take("=")
        if self.at == begin + 2 and result.kinds.get(self.tokens[begin][1]) == "Boolean":
            result.flags[self.tokens[begin][1]] = self.expression()
            self.take(";")
            return
        name = self.tokens[begin][1] if self.at == begin + 2 else ""
        right = self.side()
        names = frozenset(text for kind, text in self.tokens[begin:self.at] if kind == "name")
        result.equations.append(Equation(name, left, right, self.string(), names))
        self.take(";")

    def when(self) -> When:
        conditions = []
        if self.has("{"):
            while True:
                conditions.append(self.expression())
                if self.take(",", "}") == "}":
                    break
        else:
            conditions.append(self.expression())
        self.take("then")
        clause = When(conditions, [])
        while not self.has("end"):
            if self.has("terminate"):
                self.take("(")
                self.string()
                self.take(")")
                clause.ends = True
            elif self.has("reinit"):
                self.take("(")
                name = self.take()
                self.take(",")
                clause.assignments.append((name, self.expression(), True))
                self.take(")")
            else:
                name = self.take()
                self.take("=")
                clause.assignments.append((name, self.expression(), False))
            self.take(";")
        self.take("when")
        clause.comment = self.string()
        self.take(";")
        return clause

    # -- expressions ---------------------------------------------------------------------------------------------------
    def side(self) -> Sum:
        return Sum(((1.0, self.expression()),)) if self.peek() == "if" else Sum((*self.signed(),))

    def signed(self) -> Iterator[tuple[float, Expression]]:
        sign = -1.0 if self.has("-") else 1.0
        yield sign, self.product()
        while self.peek() in ("+", "-"):
            yield -1.0 if self.take() == "-" else 1.0, self.product()

    def expression(self) -> Expression:
        if self.has("if"):
            test = self.expression()
            self.take("then")
            first = self.expression()
            self.take("else")
            second = self.expression()
            return Choice(test, first, second)
        left = self.conjunction()
        while self.has("or"):
            left = (lambda a, b: lambda s: bool(a(s)) or bool(b(s)))(left, self.conjunction())
        return left

    def conjunction(self) -> Expression:
        left = self.factor()
        while self.has("and"):
            left = (lambda a, b: lambda s: bool(a(s)) and bool(b(s)))(left, self.factor())
        return left

    def factor(self) -> Expression:
        if self.has("not"):
            inner = self.relation()
            return lambda s: not inner(s)
        return self.relation()

    def relation(self) -> Expression:
        left = self.sum()
        if self.peek() in ("<", "<=", ">", ">="):
            op, right = self.take(), self.sum()
            compare = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}[op]
            return lambda s: compare(left(s), right(s))
        return left

    def sum(self) -> Expression:
        terms = (*self.signed(),)
        return terms[0][1] if len(terms) == 1 and terms[0][0] > 0 else Sum(terms)

    def product(self) -> Expression:
        left = self.power()
        while self.peek() in ("*", "/"):
            op, right = self.take(), self.power()
            left = Product(left, right, op == "/")
        return left

    def power(self) -> Expression:
        base = self.atom()
        if self.has("^"):
            exponent = self.atom()
            return lambda s: base(s) ** exponent(s)
        return base

    def atom(self) -> Expression:
        kind, token = self.tokens[self.at]
        self.at += 1
        if kind == "number":
            number = float(token)
            return lambda s: number
        if token == "(":
            inner = self.expression()
            self.take(")")
            return inner
        assert kind == "name", f"unexpected {token!r}"
        if token in ("der", "pre", "edge"):
            self.take("(")
            name = self.take()
            self.take(")")
            return {"der": lambda s: s.rates[name], "pre": lambda s: s.before[name], "edge": lambda s: s.edges[name]}[token]
        if token == "sum":
            return self.summed()
        if token == "delay":
            source, length = self.arguments()
            return lambda s: s.delayed(source, length(s))
        if token in ("noEvent", "sample", "piecewise") or token in PLAIN:
            args = self.arguments()
            if token == "noEvent":
                return args[0]
            if token == "piecewise":
                return lambda s: _piecewise(*(a(s) for a in args))
            if token == "sample":
                return lambda s: (s.values["time"] - args[0](s)) / args[1](s)
            return (lambda f: lambda s: f(*(a(s) for a in args)))(PLAIN[token])
        if self.peek() == "[":
            self.take("[")
            number = self.sum()
            self.take("]")
            return lambda s: s.arrays[token][round(number(s)) - 1]
        return lambda s: s.index if token == "i" and s.index is not None else \
            s.values[token] if token in s.values else s.arrays[token]

    def arguments(self) -> list[Expression]:
        args = []
        self.take("(")
        while True:
            args.append(self.expression())
            if self.take(",", ")") == ")":
                return args

    def summed(self) -> Expression:
        self.take("(")
        inner = self.expression()
        self.take("for")
        self.take("i")
        self.take("in")
        low = int(self.take())
        self.take(":")
        high = int(self.take())
        self.take(")")
        return lambda s: sum(inner(Scope(s.values, s.rates, s.before, s.arrays, s.edges, s.delayed, k))
                             for k in range(low, high + 1))


def _piecewise(u: float, begins: list[float], coefficients: list[list[float]]) -> float:
    k = max((n for n, begin in enumerate(begins) if begin <= u), default=0)
    return sum(c * (u - begins[k]) ** n for n, c in enumerate(coefficients[k]))
