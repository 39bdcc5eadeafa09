"""Incidence of unknowns in equations: the coefficient of each, and whether it may be divided by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple, cast

import casadi as ca

from heavebond.language.external_functions import jacobian
from heavebond.language.symbols import split, stack

# Kinds of occurrence. Equations can be solved explicitly for unknowns of kinds up to DEFINITE.
UNIT, NUMBER, PARAMETER, DEFINITE, INDEFINITE, NONLINEAR = range(6)
Interval = tuple[float, float]
EVERYTHING: Interval = (-inf, inf)


class Entry(NamedTuple):
    """Unknown `column` in an equation: its kind and, if it occurs linearly, the coefficient d(residual)/d(unknown)."""

    column: int
    kind: int
    coefficient: ca.SX


def classify(residuals: ca.SX, unknowns: ca.SX, constants: set[int], bounds: Mapping[int, Interval]
             ) -> list[list[Entry]]:
    """Incidence entries of each residual (m,) with respect to the unknowns (n,).

    `constants` contains the hashes of symbols that are constant during a run; `bounds` the interval of a symbol, by its
    hash. A coefficient is

    UNIT +-1 | NUMBER another number | PARAMETER of constants only | DEFINITE never of both signs within the bounds |
    INDEFINITE linear, but the coefficient may pass through zero | NONLINEAR (also if a sign or a comparison depends on
    the unknown, whose derivative is zero).
    """
    slopes = jacobian(residuals, unknowns)
    rows: list[list[Entry]] = [[] for _ in range(residuals.numel())]
    row_of, column_of = slopes.sparsity().get_triplet()
    occurring = sorted(set(column_of))  # the equations may depend on few of many unknowns
    hashes = {column: s.element_hash() for column, s in zip(occurring, split(unknowns[occurring]), strict=True)}
    stepped = _stepped(residuals, {s: column for column, s in hashes.items()})
    # CasADi's stubs call the entries SXElem; they are scalar SX
    coefficients = cast(list[ca.SX], slopes.nonzeros())
    kinds = [NONLINEAR if (row, column) in stepped else _kind(entry, hashes[column], constants)
             for entry, row, column in zip(coefficients, row_of, column_of, strict=True)]
    signs = iter(intervals([e for e, kind in zip(coefficients, kinds, strict=True) if kind is None], bounds))
    for entry, kind, row, column in zip(coefficients, kinds, row_of, column_of, strict=True):
        rows[row].append(Entry(column, _sign(next(signs)) if kind is None else kind, entry))
    return rows


# Operations of CasADi whose derivative is zero wherever it exists.
STEPS = frozenset((ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_SIGN, ca.OP_FLOOR,
                   ca.OP_CEIL))


def _stepped(residuals: ca.SX, column_of: Mapping[int, int]) -> set[tuple[int, int]]:
    """The (row, column) for which a comparison, a sign or a whole number depends on the unknown, whose column is given by
    its hash. The residual is not linear in it, whatever the derivative is (`v - if_else(v > 0, a, b)` has the constant
    derivative 1)."""
    symbols = ca.symvar(residuals)
    function = ca.Function("f", [stack(symbols)], [residuals])
    ids = [function.instruction_id(k) for k in range(function.n_instructions())]
    if STEPS.isdisjoint(ids):
        return set()
    # for each place of the work vector: the unknowns in it, and the unknowns on which it depends by a step
    nothing: frozenset[int] = frozenset()
    work: dict[int, tuple[frozenset[int], frozenset[int]]] = {}
    stepped_entries: set[tuple[int, int]] = set()
    columns = [column_of.get(s.element_hash()) for s in symbols]
    for k, op in enumerate(ids):
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            stepped_entries.update((outputs[1], column) for column in work[inputs[0]][1])
        elif op == ca.OP_INPUT:
            column = columns[inputs[1]]
            work[outputs[0]] = (nothing if column is None else frozenset((column,)), nothing)
        elif op == ca.OP_CONST:
            work[outputs[0]] = (nothing, nothing)
        else:
            held = [work[i] for i in inputs]
            inside, steps = (nothing.union(*(h[side] for h in held)) for side in (0, 1))
            for output in outputs:  # of a call: several
                work[output] = (inside, inside if op in STEPS else steps)
    return stepped_entries


def _kind(coefficient: ca.SX, unknown: int, constants: set[int]) -> int | None:
    """The kind of a coefficient; None if its interval decides."""
    if coefficient.is_constant():
        size = abs(float(coefficient))
        return NONLINEAR if size == 0 else UNIT if size == 1 else NUMBER
    hashes = {s.element_hash() for s in ca.symvar(coefficient)}
    if hashes <= constants:
        return PARAMETER
    return NONLINEAR if unknown in hashes else None


def _sign(interval: Interval) -> int:
    low, high = interval
    return DEFINITE if low >= 0 or high <= 0 else INDEFINITE


# An end at zero is approached only. A truth value, and the inactive branch of a condition, is zero: beyond by this much.
REACHED = 1e-200


def interval(expression: ca.SX, bounds: Mapping[int, Interval]) -> Interval:
    """An interval that contains the scalar `expression` for all values of its symbols within `bounds`."""
    return intervals([expression], bounds)[0]


def intervals(expressions: Sequence[ca.SX], bounds: Mapping[int, Interval]) -> list[Interval]:
    """The interval of each scalar expression; shared subexpressions are visited once."""
    if not expressions:
        return []
    together = stack(expressions)
    symbols = ca.symvar(together)
    function = ca.Function("f", [stack(symbols)], [together])
    results = [(0.0, 0.0)] * len(expressions)  # a structural zero has no instruction
    work: dict[int, Interval] = {}
    factors: dict[int, _Factors] = {}  # for each place of the work vector
    for k in range(function.n_instructions()):
        op, product = function.instruction_id(k), None
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            results[outputs[1]] = work[inputs[0]]
            continue
        if op == ca.OP_INPUT:
            work[outputs[0]] = bounds.get(symbols[inputs[1]].element_hash(), EVERYTHING)
        elif op == ca.OP_CONST:
            value = function.instruction_constant(k)
            work[outputs[0]] = (value, value)
        elif op == ca.OP_CALL:
            for output in outputs:
                work[output], factors[output] = EVERYTHING, _Factors(1.0, {(k, output): (EVERYTHING, 1)})
            continue
        else:
            interval_found = _operate(op, [work[i] for i in inputs], len(set(inputs)) < len(inputs))
            product = _multiplied(op, [factors[i] for i in inputs])
            if product is not None:
                interval_found = product.narrowed(interval_found)
            work[outputs[0]] = interval_found
        factors[outputs[0]] = product if product is not None else _Factors(1.0, {k: (work[outputs[0]], 1)})
    return results


# products of more different factors are not searched for squares
MOST_FACTORS = 12


@dataclass(frozen=True)
class _Factors:
    """A product: its sign, and each factor by its instruction, with its interval and its exponent."""

    sign: float
    powers: dict[object, tuple[Interval, int]]

    def narrowed(self, known: Interval) -> Interval:
        """The interval of the product, with a repeated factor, as in x*(m*x), treated as a square."""
        if all(power == 1 for _, power in self.powers.values()):
            return known
        sign_interval = (self.sign, self.sign)
        for a, power in self.powers.values():
            for _ in range(power // 2):
                sign_interval = _product(sign_interval, _square(a))
            sign_interval = _product(sign_interval, a) if power % 2 else sign_interval
        return max(known[0], sign_interval[0]), min(known[1], sign_interval[1])


def _multiplied(op: int, args: Sequence[_Factors]) -> _Factors | None:
    """The factors of a product or of a negated one; None for other operations."""
    if op == ca.OP_NEG:
        return _Factors(-args[0].sign, args[0].powers)
    if op not in (ca.OP_MUL, ca.OP_SQ):
        return None
    a, b = args[0], args[-1]
    powers = dict(a.powers)
    for k, (factor_interval, power) in b.powers.items():
        powers[k] = (factor_interval, power + (powers[k][1] if k in powers else 0))
    return _Factors(a.sign * b.sign, powers) if len(powers) <= MOST_FACTORS else None


def _operate(op: int, args: Sequence[Interval], same: bool) -> Interval:
    a = args[0]
    b = args[1] if len(args) > 1 else EVERYTHING
    if op == ca.OP_ADD:
        return a[0] + b[0], a[1] + b[1]
    if op == ca.OP_SUB:
        return a[0] - b[1], a[1] - b[0]
    if op == ca.OP_NEG:
        return -a[1], -a[0]
    if op == ca.OP_MUL:
        return _square(a) if same else _product(a, b)
    if op == ca.OP_SQ:
        return _square(a)
    if op == ca.OP_TWICE:
        return 2 * a[0], 2 * a[1]
    if op in (ca.OP_DIV, ca.OP_INV):
        numerator, denominator = ((1.0, 1.0), a) if op == ca.OP_INV else (a, b)
        return _product(numerator, _inverse(denominator))
    if op in (ca.OP_SQRT, ca.OP_EXP, ca.OP_FABS):
        return 0.0, inf
    if op in (ca.OP_TANH, ca.OP_SIGN):
        return (-1.0 if a[0] < 0 else 0.0), (1.0 if a[1] > 0 else 0.0)
    if op == ca.OP_FLOOR:
        return a[0] - 1, a[1]
    if op in (ca.OP_SIN, ca.OP_COS):
        return -1.0, 1.0
    if op in (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_NOT):
        return -REACHED, 1.0
    if op == ca.OP_FMIN:
        return min(a[0], b[0]), min(a[1], b[1])
    if op == ca.OP_FMAX:
        return max(a[0], b[0]), max(a[1], b[1])
    if op == ca.OP_IF_ELSE_ZERO:
        return min(-REACHED, b[0]), max(REACHED, b[1])
    if op in (ca.OP_POW, ca.OP_CONSTPOW) and a[0] >= 0:
        return 0.0, inf
    return EVERYTHING


def _square(a: Interval) -> Interval:
    low = 0.0 if a[0] <= 0 <= a[1] else min(a[0] ** 2, a[1] ** 2)
    return low, max(a[0] ** 2, a[1] ** 2)


def _product(a: Interval, b: Interval) -> Interval:
    # 0 * inf is 0 here: the bound belongs to a quantity that is finite whenever it is evaluated
    corners = [0.0 if 0 in (x, y) else x * y for x in a for y in b]
    return min(corners), max(corners)


def _inverse(a: Interval) -> Interval:
    """1/a; an end at zero is approached, not reached (the coefficient is checked again with numerical values)."""
    if a[0] >= 0:
        return (0.0 if a[1] == inf else 1 / a[1] if a[1] else inf), (inf if a[0] == 0 else 1 / a[0])
    if a[1] <= 0:
        return (-inf if a[1] == 0 else 1 / a[1]), (0.0 if a[0] == -inf else 1 / a[0])
    return EVERYTHING
