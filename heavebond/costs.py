"""Costs of a run as formulas: `0.5*(rms(crown.x)/ref(rms(crown.x)) + rms(crown.v)/ref(rms(crown.v)))`.

Inside a cost stand, beside the usual functions, with T the length of the time that is evaluated:

    integral(e) = int e dt      mean(e) = integral(e)/T      rms(e) = sqrt(mean(e**2))
    peak(e)     = c s mean((e/s)**PEAK_POWER)**(1/PEAK_POWER), a smooth maximum of |e|, exact for a sine
    final(e)    = e at the end
    ref(cost)   = the value of a cost in the reference run (a constant)
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.dae import Array, Assembly
from heavebond.dimensions import SECOND
from heavebond.errors import Place, Problem, UsageError
from heavebond.expression import (
    Binary,
    Call,
    Compare,
    Expr,
    ExpressionProblem,
    Name,
    Negative,
    children,
    parse_formula,
)
from heavebond.result import Result
from heavebond.symbols import stack
from heavebond.units import ONE, Dimension, dimension_text, times

FUNCTIONALS = {"integral": 1, "mean": 1, "rms": 1, "peak": 1, "final": 1, "ref": 1}
# A high power singles out the largest value; above some dozens the gradient sees one sample only.
PEAK_POWER = 32
# mean of |sin|**m over a period is (m-1)!!/m!!: the factor that makes the peak of a sine exact
PEAK_OF_SINE = float(np.prod([(k - 1) / k for k in range(2, PEAK_POWER + 1, 2)]) ** (-1 / PEAK_POWER))


@dataclass(frozen=True)
class Functional:
    """One number of a run: its kind, and the expression in the model's variables that it is taken of."""

    kind: str
    signal: ca.SX
    unit: Dimension


@dataclass(frozen=True)
class Cost:
    """A formula of functionals: `value` maps (functionals, their reference values, p) to the cost.

    Functionals inside `ref(...)` are taken from the reference run; `references` tells which.
    """

    text: str
    functionals: tuple[Functional, ...]
    references: tuple[bool, ...]
    value: ca.Function
    gradient: ca.Function
    dimension: Dimension

    @property
    def unit(self) -> str:
        """The unit of the cost."""
        return dimension_text(self.dimension)


def read_cost(assembly: Assembly, text: str) -> Cost:
    """A cost from its text; UsageError with a caret for what is wrong in it."""
    return _Reader(assembly, text).cost(parse(text))


def read_limit(assembly: Assembly, text: str) -> Cost:
    """`peak(extension) < 3.8 m` as a cost that is below zero where the limit is kept, relative to its right side."""
    tree = parse(text)
    if not isinstance(tree, Compare) or tree.op not in ("<", "<=", ">", ">="):
        raise _problem(text, ExpressionProblem("limit-form", "a limit is written `peak(extension) < 3.8 m`", 0,
                                               len(text)))
    low, high = (tree.left, tree.right) if tree.op in ("<", "<=") else (tree.right, tree.left)
    return _Reader(assembly, text).cost(Binary("-", low, high, tree.column))


def parse(text: str) -> Expr:
    """The tree of a cost; UsageError with a caret for what is wrong in it."""
    try:
        return parse_formula(text, functions=FUNCTIONALS)
    except ExpressionProblem as problem:
        raise _problem(text, problem) from None


def _problem(text: str, problem: ExpressionProblem) -> UsageError:
    place = Place("cost", 1, 1, text).moved(problem.column, problem.length)
    return UsageError([Problem(problem.code, problem.message, place, problem.hint)])


class _Reader:
    """Turns the calls of functionals into symbols; what is left is an ordinary formula of these."""

    def __init__(self, assembly: Assembly, text: str):
        self.assembly, self.text = assembly, text
        self.found: list[tuple[Functional, bool]] = []
        self.symbols: list[ca.SX] = []

    def cost(self, tree: Expr) -> Cost:
        try:
            value, dimension = self._evaluate(tree, False)
        except ExpressionProblem as problem:
            raise _problem(self.text, problem) from None
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
            return self._functional(expr, reference)
        # everything else is a formula whose functionals are stood in for by names of their own
        names: dict[str, tuple[ca.SX, Dimension]] = {}
        plain = self._stood_in(expr, reference, names)
        resolver = self.assembly.resolver()
        inner = {name: symbol for name, (symbol, _) in names.items()}
        return (resolver.evaluate(plain, extra=inner),
                resolver.dimension(plain, extra={n: d for n, (_, d) in names.items()}) or ONE)

    def _functional(self, expr: Call, reference: bool) -> tuple[ca.SX, Dimension]:
        inner = expr.args[0]
        if any(isinstance(c, Call) and c.function in FUNCTIONALS for c in _walk(inner)):
            raise ExpressionProblem("cost-nested", f"{expr.function}(...) is taken of a signal, not of another cost",
                                    expr.column, len(expr.function))
        unit = self.assembly.resolver().dimension(inner) or ONE
        signal = self.assembly.expression(inner)
        unit = times(unit, SECOND) if expr.function == "integral" else unit
        symbol = ca.SX.sym(f"{expr.function}_{len(self.symbols)}")
        self.symbols.append(symbol)
        self.found.append((Functional(expr.function, signal, unit), reference))
        return symbol, unit

    def _stood_in(self, expr: Expr, reference: bool, names: dict[str, tuple[ca.SX, Dimension]]) -> Expr:
        if isinstance(expr, Call) and expr.function in FUNCTIONALS:
            name = f"cost {len(self.symbols)}"
            names[name] = self._evaluate(expr, reference)
            return Name((name,), expr.column, len(expr.function))
        if isinstance(expr, Binary):
            return Binary(expr.op, self._stood_in(expr.left, reference, names),
                          self._stood_in(expr.right, reference, names), expr.column)
        if isinstance(expr, Negative):
            return Negative(self._stood_in(expr.operand, reference, names), expr.column)
        if isinstance(expr, Call):
            return Call(expr.function, tuple(self._stood_in(a, reference, names) for a in expr.args), expr.column)
        if isinstance(expr, Name) and expr.text in self.assembly.flat.names:
            raise ExpressionProblem("cost-signal", f"'{expr.text}' is a signal; a cost is a number", expr.column,
                                    expr.length, f"Write rms({expr.text}), peak({expr.text}) or final({expr.text}).")
        return expr


def _walk(expr: Expr) -> list[Expr]:
    return [expr, *(found for child in children(expr) for found in _walk(child))]


@dataclass(frozen=True)
class CostSlopes:
    """A cost of a run and its derivatives by each functional's integral (n,), by its last value (n,), by p (n_p,)."""

    value: float
    by_integral: Array
    by_final: Array
    by_p: Array


class Evaluator:
    """Quadratures that give the functionals of several costs, from a run whose grid is begin, from, to."""

    def __init__(self, assembly: Assembly, costs: list[Cost], sizes: Array, length: float):
        """`sizes` are the largest values of each functional's signal in some run: what `peak` is scaled by."""
        self.costs, self.length = costs, length
        self.functionals = [f for cost in costs for f in cost.functionals]
        self.sizes = np.where(sizes > 0, sizes, 1.0)
        self.quadratures = stack([_integrand(f, s) for f, s in zip(self.functionals, self.sizes, strict=True)])
        t, x, z, p, u, rate = assembly.arguments
        finals = stack([f.signal for f in self.functionals])
        dx, dz, dp = (ca.SX.sym("d", a.numel()) for a in (x, z, p))
        moved = ca.SX(len(self.functionals), 1)
        for argument, direction in ((x, dx), (z, dz), (p, dp)):
            if argument.numel() and finals.numel():
                moved += ca.jtimes(finals, argument, direction)
        self._finals = ca.Function("finals", [t, x, z, p, u, rate, dx, dz, dp], [finals, moved])

    def functional_values(self, result: Result) -> tuple[Array, Array]:
        """The functionals (n,) of a run and their derivatives (m, n) along its sensitivities."""
        integrals = result.quadratures[:, -1] - result.quadratures[:, -2]
        m = 0 if result.along is None else len(result.along.names)
        moved = np.zeros((m, len(self.functionals))) if result.along is None else \
            result.along.quadratures[:, :, -1] - result.along.quadratures[:, :, -2]
        values, slopes = np.zeros(len(self.functionals)), np.zeros((m, len(self.functionals)))
        u = result.u[:, -1] if result.u.size else np.zeros(0)
        last = (result.time[-1], result.x[:, -1], result.z[:, -1], result.p, u, 1.0)
        for k, f in enumerate(self.functionals):
            values[k], slope = _from_integral(f.kind, integrals[k], self.length, self.sizes[k])
            slopes[:, k] = slope * moved[:, k]
        zero = (np.zeros(result.x.shape[0]), np.zeros(result.z.shape[0]), np.zeros(len(result.p)))
        final = [k for k, f in enumerate(self.functionals) if f.kind == "final"]
        if final:
            values[final] = np.array(self._finals(*last, *zero)[0]).ravel()[final]
            for row in range(m):
                assert result.along is not None
                along = (result.along.x[row, :, -1], result.along.z[row, :, -1], result.along.p[row])
                slopes[row, final] = np.array(self._finals(*last, *along)[1]).ravel()[final]
        return values, slopes

    def cost_slopes(self, result: Result, references: Array) -> list[CostSlopes]:
        """Each cost of a run and what it depends on, directly; `references` are the functionals of the reference run."""
        values, _ = self.functional_values(result)
        integrals = result.quadratures[:, -1] - result.quadratures[:, -2]
        slopes = np.array([_from_integral(f.kind, q, self.length, size)[1]
                           for f, q, size in zip(self.functionals, integrals, self.sizes, strict=True)])
        final = np.array([f.kind == "final" for f in self.functionals], dtype=bool)
        found, first = [], 0
        for cost in self.costs:
            chosen = slice(first, first + len(cost.functionals))
            first = chosen.stop
            value, by_value, by_p = self._at(cost, values[chosen], references[chosen], result.p)
            by_functional = np.zeros(len(values))
            by_functional[chosen] = by_value
            found.append(CostSlopes(value, by_functional * slopes, np.where(final, by_functional, 0.0), by_p))
        return found

    @staticmethod
    def _at(cost: Cost, values: Array, references: Array, p: Array) -> tuple[float, Array, Array]:
        """A cost and its derivatives by its functionals (those of the reference run stand still) and by p."""
        is_reference = np.array(cost.references, dtype=bool)
        inner = np.where(is_reference, references, values)
        by_value, by_p = (np.array(g).ravel() for g in cost.gradient(inner, p))
        return float(cost.value(inner, p)), np.where(is_reference, 0.0, by_value), by_p

    def cost_values(self, values: Array, slopes: Array, references: Array, p: Array, dp: Array) -> list[tuple[float, Array]]:
        """Each cost and its gradient (m,), from the functionals of the run and those of the reference run."""
        found = []
        first = 0
        for cost in self.costs:
            chosen = slice(first, first + len(cost.functionals))
            first = chosen.stop
            value, by_value, by_p = self._at(cost, values[chosen], references[chosen], p)
            found.append((value, slopes[:, chosen] @ by_value + dp @ by_p))
        return found


def _integrand(functional: Functional, size: float) -> ca.SX:
    if functional.kind == "rms":
        return functional.signal**2
    if functional.kind == "peak":
        return (functional.signal / size) ** PEAK_POWER
    return functional.signal


def _from_integral(kind: str, integral: float, length: float, size: float) -> tuple[float, float]:
    """The functional and its derivative with respect to the integral."""
    mean = integral / length
    if kind == "integral":
        return integral, 1.0
    if kind == "mean":
        return mean, 1 / length
    if kind == "final":
        return 0.0, 0.0
    if mean <= 0:
        return 0.0, 0.0
    if kind == "rms":
        return float(np.sqrt(mean)), float(0.5 / np.sqrt(mean) / length)
    value = PEAK_OF_SINE * size * mean ** (1 / PEAK_POWER)
    return float(value), float(value / PEAK_POWER / mean / length)

