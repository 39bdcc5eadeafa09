"""Expressions as text of Modelica: the operations of CasADi in infix notation.

A condition within an equation is written in `noEvent`, because the integration of a run does not stop there either; the
conditions of events are written in `when`. Equal terms of consecutive elements of arrays, such as the intervals of a table,
are written as one sum over an index. Modelica Association, Modelica Language Specification 3.6, https://modelica.org.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite

import casadi as ca

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.language.external_functions import functions_called
from heavebond.language.symbols import stack

# precedence of an operation, weakest first
CONDITIONAL, OR, AND, NOT, RELATION, SUM, PRODUCT, POWER, ATOM = range(9)
LONG = 60  # characters from which on an expression that occurs twice becomes a variable
LONG_PARTIAL = 1000  # the same for an expression without a value at some arguments, which a condition may guard
LARGEST = 1e300  # infinity has no literal in Modelica
SUMMED = 3  # terms from which on equal terms of consecutive elements are written as one sum
ELEMENT = re.compile(r"\[(\d+)\]")
FUNCTIONS = {ca.OP_SQRT: "sqrt", ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan",
             ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh",
             ca.OP_TANH: "tanh", ca.OP_FABS: "abs", ca.OP_SIGN: "sign", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil",
             ca.OP_FMIN: "min", ca.OP_FMAX: "max", ca.OP_ATAN2: "atan2", ca.OP_FMOD: "rem"}
PARTIAL = {ca.OP_SQRT, ca.OP_LOG, ca.OP_ASIN, ca.OP_ACOS, ca.OP_POW, ca.OP_CONSTPOW}
RELATIONS = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "<>"}
INFIX = {ca.OP_MUL: ("*", PRODUCT), ca.OP_DIV: ("/", PRODUCT), ca.OP_POW: ("^", POWER), ca.OP_CONSTPOW: ("^", POWER)}


@dataclass(frozen=True)
class Term:
    """An expression: its text and precedence, whether it is a condition, whether it changes between events, and whether it
    has no value at some arguments (`partial`).

    `terms` are the signs and texts of a sum, which has its text from them; `choice` is (condition, value) of a value that is
    0 unless the condition is true, `negated` the condition of which a condition is the opposite; `sides` are the operands
    of a difference, a minimum or a maximum with its operation."""

    written: str
    level: int = ATOM
    truth: bool = False
    moves: bool = False
    partial: bool = False
    terms: tuple[tuple[int, str], ...] = ()
    choice: tuple[Term, Term] | None = None
    negated: Term | None = None
    sides: tuple[int, Term, Term] | None = None

    @cached_property
    def text(self) -> str:
        """The text of the expression."""
        return added(self.terms) if self.terms else self.written

    def within(self, level: int) -> str:
        """The text as an operand of an operation of this precedence."""
        return f"({self.text})" if self.level < level else self.text


@dataclass(frozen=True)
class Written:
    """Expressions as terms, and the variables `common` (name and term, in order) for expressions that occur repeatedly."""

    terms: list[Term]
    common: list[tuple[str, Term]]


def literal(number: float) -> str:
    """A number as a literal."""
    if not isfinite(number):
        number = LARGEST if number > 0 else -LARGEST
    return str(int(number)) if number == int(number) and abs(number) < 1e9 else repr(float(number))


def written(expressions: Iterable[ca.SX], names: Mapping[int, Term], fresh: Callable[[str], str] | None = None) -> Written:
    """Write scalar expressions as Modelica; `names` are the texts of the symbols, by their hash. With `fresh`, which
    gives unused names, a long expression that occurs repeatedly becomes a variable; without, it is repeated."""
    column = stack(expressions)
    symbols = ca.symvar(column)
    function = ca.Function("f", [stack(symbols)], [ca.cse(ca.densify(column))])
    results = [Term("0")] * column.numel()
    register: dict[int, int] = {}  # the instruction whose value it holds
    uses, reads = dict[int, int](), list[list[int]]()
    for k in range(function.n_instructions()):
        op, inputs, outputs = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_CALL:
            called = functions_called(function)
            texts = listing([f"{f.name} ({f.external.path.name})" for f in called if f.external is not None])
            subject = "least_distance" if not called else f"the external function {texts}" if len(called) == 1 else \
                f"the external functions {texts}"
            raise UsageError([Problem(
                "export-function", f"{subject} cannot be written in Modelica", called[0].place if called else None,
                "Export the diagram as an FMU or as C" + (", which contain its source." if called else "."))])
        read = [] if op in (ca.OP_INPUT, ca.OP_CONST) else [register[i] for i in inputs]
        reads.append(read)
        for source in read:
            uses[source] = uses.get(source, 0) + 1
        if op != ca.OP_OUTPUT:
            register[outputs[0]] = k
    values: dict[int, Term] = {}
    common: list[tuple[str, Term]] = []
    for k, read in enumerate(reads):
        op = function.instruction_id(k)
        if op == ca.OP_INPUT:
            values[k] = names[symbols[function.instruction_input(k)[1]].element_hash()]
        elif op == ca.OP_CONST:
            number = function.instruction_constant(k)
            values[k] = Term(literal(number), SUM if number < 0 else ATOM)
        elif op == ca.OP_OUTPUT:
            results[function.instruction_output(k)[1]] = values[read[0]]
        else:
            args = [values[source] for source in read]
            term = _operated(op, args)
            # a divisor or the argument of a root may be valid only while the condition around it is true
            partial = any(a.partial for a in args) or op in PARTIAL or (op in (ca.OP_DIV, ca.OP_INV) and args[-1].moves)
            term = replace(term, partial=partial)
            if fresh is not None and uses.get(k, 0) > 1 and not term.truth and term.choice is None \
                    and len(term.text) > (LONG_PARTIAL if partial else LONG):
                name = fresh("common")
                common.append((name, term))
                term = Term(name, moves=term.moves)
            values[k] = term
    return Written(results, common)


def _operated(op: int, args: Sequence[Term]) -> Term:
    moves = any(a.moves for a in args)
    if op in (ca.OP_ADD, ca.OP_SUB):
        return _sum(op, _number(args[0]), _number(args[1]), moves)
    if op in RELATIONS:
        return _relation(op, _number(args[0]), _number(args[1]), moves)
    if op == ca.OP_NOT:
        given = _condition(args[0])
        return Term(f"not {given.within(RELATION)}", NOT, True, moves, negated=given)
    if op in (ca.OP_AND, ca.OP_OR):
        word, level = ("and", AND) if op == ca.OP_AND else ("or", OR)
        return Term(f" {word} ".join(_condition(a).within(level) for a in args), level, True, moves)
    if op == ca.OP_IF_ELSE_ZERO:
        condition, value = _condition(args[0]), _number(args[1])
        return Term(_choice(condition, value.within(OR), "0"), CONDITIONAL, False, moves, choice=(condition, value))
    args = [_number(a) for a in args]
    if op in INFIX:
        sign, level = INFIX[op]
        right = level + 1
        left = level + (op not in (ca.OP_MUL, ca.OP_DIV))  # a power of a power needs brackets
        return Term(f"{args[0].within(left)}{sign}{args[1].within(right)}", level, False, moves)
    if op == ca.OP_NEG:
        terms = tuple((-sign, text) for sign, text in args[0].terms) or ((-1, args[0].within(PRODUCT)),)
        return Term("", SUM, False, moves, terms=terms)
    if op == ca.OP_SQ:
        return Term(f"{args[0].within(ATOM)}^2", POWER, False, moves)
    if op == ca.OP_TWICE:
        return Term(f"2*{args[0].within(POWER)}", PRODUCT, False, moves)
    if op == ca.OP_INV:
        return Term(f"1/{args[0].within(POWER)}", PRODUCT, False, moves)
    if op == ca.OP_LOG1P:
        return Term(f"log(1 + {args[0].within(SUM)})", ATOM, False, moves)
    if op == ca.OP_EXPM1:
        return Term(f"exp({args[0].text}) - 1", SUM, False, moves)
    if op == ca.OP_HYPOT:
        return Term(f"sqrt({args[0].within(ATOM)}^2 + {args[1].within(ATOM)}^2)", ATOM, False, moves)
    if op not in FUNCTIONS:
        names = {number: name.removeprefix("OP_").lower() for name, number in vars(ca).items() if name.startswith("OP_")}
        raise UsageError([Problem("export-function", f"Modelica has no function '{names.get(op, op)}'", None,
                                  "Export the diagram as an FMU.")])
    sides = (op, args[0], args[1]) if op in (ca.OP_FMIN, ca.OP_FMAX) else None
    return Term(f"{FUNCTIONS[op]}({', '.join(a.text for a in args)})", ATOM, False, moves, sides=sides)


def _sum(op: int, a: Term, b: Term, moves: bool) -> Term:
    first, second = a.choice, b.choice
    if op == ca.OP_ADD and first and second:
        for (condition, value), (negation, otherwise) in ((first, second), (second, first)):
            if negation.negated is not None and negation.negated.text == condition.text:
                return Term(_choice(condition, value.within(OR), otherwise.within(OR)), CONDITIONAL, False, moves)
    sign = 1 if op == ca.OP_ADD else -1
    terms = tuple((s * k, text) for k, side in ((1, a), (sign, b))
                  for s, text in side.terms or ((1, side.within(PRODUCT)),))
    return Term("", SUM, False, moves, terms=terms, sides=(op, a, b) if op == ca.OP_SUB else None)


def _choice(condition: Term, value: str, otherwise: str) -> str:
    test = f"noEvent({condition.text})" if condition.moves else condition.text
    return f"if {test} then {value} else {otherwise}"


def _relation(op: int, a: Term, b: Term, moves: bool) -> Term:
    """A comparison; Modelica has no equality of real numbers."""
    left, right = a.within(SUM), b.within(SUM)
    if op == ca.OP_EQ:
        return Term(f"{left} <= {right} and {left} >= {right}", AND, True, moves)
    if op == ca.OP_NE:
        return Term(f"{left} < {right} or {left} > {right}", OR, True, moves)
    return Term(f"{left} {RELATIONS[op]} {right}", RELATION, True, moves)


def _condition(term: Term) -> Term:
    """A term as a condition: a number is true unless it is 0."""
    return term if term.truth else _relation(ca.OP_NE, term, Term("0"), term.moves)


def _number(term: Term) -> Term:
    """A term as a number: a condition is 1 if it is true."""
    return Term(_choice(term, "1", "0"), CONDITIONAL, False, term.moves) if term.truth else term


def positive(term: Term) -> str:
    """The condition `term > 0`: that the smaller of two numbers is positive becomes `and`, the larger `or`."""
    choice = re.fullmatch(r"if (?:noEvent\((.*)\)|(.*)) then 1 else -1", term.text)
    if choice and term.level == CONDITIONAL:
        return str(choice[1] or choice[2])
    if term.sides is not None:
        op, a, b = term.sides
        if op == ca.OP_SUB:
            return f"{a.within(SUM)} > {b.within(SUM)}"
        word = " and " if op == ca.OP_FMIN else " or "
        return word.join(f"({positive(side)})" for side in (a, b))
    return f"{term.within(SUM)} > 0"


def added(terms: Sequence[tuple[int, str]]) -> str:
    """A sum of signed terms; equal ones of consecutive elements are one sum over an index."""
    merged, k = list[tuple[int, str]](), 0
    while k < len(terms):
        count = _alike(terms, k)
        sign, text = terms[k]
        if count >= SUMMED:
            merged.append((sign, _over_index(text, terms[k + 1][1], count)))
        else:
            count = 1
            merged.append((sign, text))
        k += count
    parts = [f"{'-' if sign < 0 else '+'} {text}" for sign, text in merged]
    first = parts[0].removeprefix("+ ") if merged[0][0] > 0 else "-" + merged[0][1]
    return " ".join([first, *parts[1:]])


def _alike(terms: Sequence[tuple[int, str]], begin: int) -> int:
    """The number of terms from `begin` on that differ by indices only, which all rise by 1 or are equal."""
    sign, text = terms[begin]
    form, first = ELEMENT.sub("[]", text), [int(n) for n in ELEMENT.findall(text)]
    moves: list[int] | None = None
    count = 1
    for other, later in terms[begin + 1:]:
        if other != sign or not first or ELEMENT.sub("[]", later) != form:
            break
        rises = [int(n) - m for n, m in zip(ELEMENT.findall(later), first, strict=True)]
        if moves is None:
            moves = rises
            if not set(rises) <= {0, 1} or not any(rises):
                break
        elif rises != [count * m for m in moves]:
            break
        count += 1
    return count


def _over_index(first: str, second: str, count: int) -> str:
    """The sum of `count` terms, of which the first two are given."""
    steps = [int(b) - int(a) for a, b in zip(ELEMENT.findall(first), ELEMENT.findall(second), strict=True)]
    moving = [int(n) for n, step in zip(ELEMENT.findall(first), steps, strict=True) if step]
    base, numbers = min(moving), iter(steps)

    def indexed(match: re.Match[str]) -> str:
        offset = int(match[1]) - base
        return (f"[i + {offset}]" if offset else "[i]") if next(numbers) else match[0]

    return f"sum({ELEMENT.sub(indexed, first)} for i in {base}:{base + count - 1})"
