"""Cost functions of a run as formulas: `0.5*(rms(crown.x)/ref(rms(crown.x)) + rms(crown.v)/ref(rms(crown.v)))`.

Functions of a cost, in addition to the usual ones, with T the length of the evaluated time:

    integral(e) = int e dt      mean(e) = integral(e)/T      rms(e) = sqrt(mean(e**2))
    peak(e)     = c s mean((e/s)**m)**(1/m) with m = 32, a smooth maximum of |e|, exact for a sine (see `cost_evaluation`)
    final(e)    = e at the end
    highest(e), lowest(e), largest(e), share(c), times(c), deviation(e), equivalent_range(e, m):
                  from the samples, see `heavebond.optimise.sampled_values`
    ref(cost)   = the value of a cost in the reference run (a constant)
    damping(least)     = the damping ratio of the least damped mode of the machine, linearised at its start
    damping(slowest)   = the damping ratio of the slowest oscillating mode
    damping(crown)     = the damping ratio of the oscillating mode with the largest share of the states of `crown`
    decay(...)         = -Re(s) of the mode with eigenvalue s, in 1/s: above 0 the machine is stable
    frequency(...)     = |s| / 2 pi in Hz
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from heavebond.core.errors import Place, Problem, UsageError, suggest
from heavebond.core.units import ONE, Dimension, dimension_text, read_unit, times
from heavebond.language.library import Library
from heavebond.language.symbols import stack
from heavebond.linear.modal_values import NUMBERS, WHICH, part_of
from heavebond.numerics.dae import Assembly
from heavebond.optimise.sampled_values import CONDITIONS, CYCLES, SAMPLED
from heavebond.text.dimensions import KELVIN, SECOND, check_origins, has_origin
from heavebond.text.expression import (
    Binary,
    Call,
    Compare,
    Elements,
    Expr,
    ExpressionProblem,
    FunctionCall,
    Name,
    Negative,
    children,
    constant,
    names,
)

FUNCTIONALS = {"integral": 1, "mean": 1, "rms": 1, "peak": 1, "final": 1, "ref": 1,
               **dict.fromkeys((*NUMBERS, *SAMPLED), 1), CYCLES: 2}
# Depth to which two expressions are compared; deeper differences count as different, which costs a second integral.
DEEPEST = 50
LIMIT = "limit"  # the place of a mistake in a limit


@dataclass(frozen=True)
class Functional:
    """One number of a run: its kind, and an expression in the model's variables; or of the modes: `which`. `exponent` is
    the exponent of the damage by load cycles."""

    kind: str
    signal: ca.SX
    unit: Dimension
    which: str = ""
    exponent: float = 1.0

    def same_integral(self, other: Functional) -> bool:
        """True if one integral serves both."""
        return self.kind == other.kind and ca.is_equal(self.signal, other.signal, DEEPEST)


@dataclass(frozen=True)
class Cost:
    """A formula of functionals: `value` maps (functionals, their reference values, p) to the cost. Functionals inside
    `ref(...)` are evaluated in the reference run; `references` are their indices.
    """

    text: str
    functionals: tuple[Functional, ...]
    references: tuple[bool, ...]
    value: ca.Function
    gradient: ca.Function
    dimension: Dimension
    origin: float | None = None  # 1 for a temperature, 0 for a difference or a quantity without an offset

    @property
    def unit(self) -> str:
        """The unit of the cost."""
        return dimension_text(self.dimension)


def read_cost(assembly: Assembly, text: str, *, shown: bool = False) -> Cost:
    """Read a cost from its text, which may be `shown` in a unit with an origin (degC); UsageError with a caret for mistakes
    in it."""
    tree = parse(text, assembly.model.library)
    cost = _Reader(assembly, text).cost(tree)
    return replace(cost, origin=_origin(assembly, tree, text, shown=shown)) \
        if cost.dimension == KELVIN or has_origin(tree) else cost


def _origin(assembly: Assembly, tree: Expr, text: str, subject: str = "cost", shown: bool = False) -> float | None:
    try:
        return check_origins(tree, assembly.flat.origins.lookup(), shown=shown)
    except ExpressionProblem as problem:
        raise _problem(text, problem, subject) from None


def read_limit(assembly: Assembly, text: str) -> Cost:
    """`peak(extension) < 3.8 m` as a cost that is below zero if the limit is satisfied: relative to its right side, or in
    SI if that is zero or not a plain quantity."""
    tree = parse(text, assembly.model.library, LIMIT)
    if not isinstance(tree, Compare) or tree.op not in ("<", "<=", ">", ">="):
        raise _problem(text, ExpressionProblem("limit-form", "a limit is a comparison, for example `peak(x) < 1 "
                                               "m`", 0, len(text),
                                               "Write for example `peak(extension) < 3.8 m` or `damping(least) > 0.1`."),
                       LIMIT)
    if has_origin(tree):
        _origin(assembly, tree, text, LIMIT)
    low, high = (tree.left, tree.right) if tree.op in ("<", "<=") else (tree.right, tree.left)
    excess: Expr = Binary("-", low, high, tree.column)
    if constant(tree.right):
        excess = Binary("/", excess, Call("abs", (tree.right,), tree.column), tree.column)
    return _Reader(assembly, text, LIMIT, tree).cost(excess)


def parse(text: str, library: Library, subject: str = "cost") -> Expr:
    """The tree of a cost or a limit (`subject`); UsageError with a caret for mistakes in it."""
    try:
        return library.formula(text, FUNCTIONALS)
    except ExpressionProblem as problem:
        raise _problem(text, problem, subject) from None


def _problem(text: str, problem: ExpressionProblem, subject: str = "cost") -> UsageError:
    place = Place(subject, 1, 1, text).moved(problem.column, problem.length)
    return UsageError([Problem(problem.code, problem.message, place, problem.hint)])


class _Reader:
    """Replaces the calls of functionals by symbols, which gives an ordinary formula."""

    def __init__(self, assembly: Assembly, text: str, subject: str = "cost", comparison: Compare | None = None):
        self.assembly, self.text, self.subject, self.comparison = assembly, text, subject, comparison
        self.found: list[tuple[Functional, bool]] = []
        self.symbols: list[ca.SX] = []
        self.outputs = {n: output.expr for n, output in assembly.model.show.items() if n not in assembly.flat.names}

    def cost(self, tree: Expr) -> Cost:
        try:
            value, dimension = self._evaluate(tree, False)
        except ExpressionProblem as problem:
            if problem.code == "name-unknown":
                excerpt = self.text[problem.column:problem.column + problem.length]
                problem.hint = suggest(excerpt, [*self.outputs, *self.assembly.flat.names]) or problem.hint
            if self.comparison is not None and problem.message.startswith("'-' joins ") \
                    and problem.column == self.comparison.column:  # the excess is the difference of the two sides
                problem.message = problem.message.replace("'-' joins", f"'{self.comparison.op}' compares", 1)
            raise _problem(self.text, problem, self.subject) from None
        values = stack(self.symbols)
        p = self.assembly.arguments[3]
        return Cost(self.text, tuple(f for f, _ in self.found), tuple(r for _, r in self.found),
                    ca.Function("cost", [values, p], [value]),
                    ca.Function("gradient", [values, p], [ca.gradient(value, values), ca.gradient(value, p)]),
                    dimension)

    def _evaluate(self, expr: Expr, reference: bool) -> tuple[ca.SX, Dimension]:
        if isinstance(expr, Call) and expr.function == "ref":
            return self._evaluate(expr.args[0], True)
        if isinstance(expr, Call) and expr.function in FUNCTIONALS:
            argument = expr.args[0]
            if expr.function in NUMBERS:
                return self._modal(expr, reference)
            if any(isinstance(c, Call) and c.function in FUNCTIONALS for c in _walk(argument)):
                raise ExpressionProblem("cost-nested", f"{expr.function}(...) is taken of a signal, not of another cost",
                                        expr.column, len(expr.function))
            resolver, used = self.assembly.resolver(), {n.text for n in names(argument)} & set(self.outputs)
            unit = resolver.dimension(argument, extra={n: resolver.dimension(self.outputs[n]) or ONE for n in used}) or ONE
            values = {n: resolver.evaluate(self.outputs[n]) for n in used}
            signal = self.assembly.express(resolver.evaluate(argument, extra=values))
            unit = ONE if expr.function in CONDITIONS else unit
            unit = times(unit, SECOND) if expr.function == "integral" else unit
            exponent = 1.0
            if expr.function == CYCLES:
                value = constant(expr.args[1])
                if value is None or not 1 <= value <= 20:
                    raise ExpressionProblem("exponent-wrong", f"{expr.function}(e, m) needs a plain number m from 1 to 20",
                                            expr.column, len(expr.function),
                                            "Write the exponent of the S-N curve, e.g. `equivalent_range(WOB, 4)`.")
                exponent = value
            return self._symbol(Functional(expr.function, signal, unit, exponent=exponent), reference)
        # other expressions are formulas whose functionals are replaced by new names
        stood: dict[str, tuple[ca.SX, Dimension]] = {}
        plain = self._stood_in(expr, reference, stood)
        resolver = self.assembly.resolver()
        inner = {name: symbol for name, (symbol, _) in stood.items()}
        return (resolver.evaluate(plain, extra=inner),
                resolver.dimension(plain, extra={n: d for n, (_, d) in stood.items()}) or ONE)

    def _modal(self, expr: Call, reference: bool) -> tuple[ca.SX, Dimension]:
        selector = expr.args[0]
        if not isinstance(selector, Name) or not (selector.text in WHICH
                                                  or part_of(self.assembly.state_names, selector.text)):
            raise ExpressionProblem("mode-unknown", f"{expr.function}(...) is taken of a mode, not of a signal", expr.column,
                                    len(expr.function), f"Write {expr.function}({WHICH[0]}) or {expr.function}({WHICH[1]}), "
                                    "or the name of the component that takes part most.")
        unit = ONE if expr.function == "damping" else read_unit("1/s").dimension
        return self._symbol(Functional(expr.function, ca.SX(0), unit, selector.text), reference)

    def _symbol(self, functional: Functional, reference: bool) -> tuple[ca.SX, Dimension]:
        symbol = ca.SX.sym(f"{functional.kind}_{len(self.symbols)}")
        self.symbols.append(symbol)
        self.found.append((functional, reference))
        return symbol, functional.unit

    def _stood_in(self, expr: Expr, reference: bool, stood: dict[str, tuple[ca.SX, Dimension]]) -> Expr:
        if isinstance(expr, Call) and expr.function in FUNCTIONALS:
            name = f"cost {len(self.symbols)}"
            stood[name] = self._evaluate(expr, reference)
            return Name((name,), expr.column, len(expr.function))
        if isinstance(expr, Binary):
            return Binary(expr.op, self._stood_in(expr.left, reference, stood),
                          self._stood_in(expr.right, reference, stood), expr.column)
        if isinstance(expr, Negative):
            return Negative(self._stood_in(expr.operand, reference, stood), expr.column)
        if isinstance(expr, Call):
            return Call(expr.function, tuple(self._stood_in(a, reference, stood) for a in expr.args), expr.column)
        if isinstance(expr, FunctionCall):
            return replace(expr, args=tuple(self._stood_in(a, reference, stood) for a in expr.args))
        if isinstance(expr, Elements):
            return replace(expr, items=tuple(self._stood_in(e, reference, stood) for e in expr.items))
        flat = self.assembly.flat
        if isinstance(expr, Name) and (expr.text in flat.names or expr.text in self.outputs
                                       or any(h.name == expr.text for h in flat.held)):
            raise ExpressionProblem("cost-signal", f"'{expr.text}' is a signal; a cost or limit is of numbers", expr.column,
                                    expr.length, f"Write for example rms({expr.text}), highest({expr.text}), "
                                    f"peak({expr.text}) or final({expr.text}).")
        return expr


def _walk(expr: Expr) -> list[Expr]:
    return [expr, *(part for child in children(expr) for part in _walk(child))]
