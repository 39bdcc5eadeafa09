"""Formulas: the whitelist grammar, its units, and that nothing outside it is ever followed."""

from __future__ import annotations

import ast
import operator
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import heavebond
from heavebond.core.units import Dimension, dimension_text, read_unit
from heavebond.language.symbols import Context, evaluate, uniform
from heavebond.text.dimensions import dimension
from heavebond.text.expression import (
    INSTEAD,
    Binary,
    Call,
    Compare,
    Equation,
    ExpressionProblem,
    Name,
    Negative,
    Number,
    SumOver,
    constant,
    names,
    parse_equation,
    parse_formula,
)


def shape(expr: object) -> str:
    """A tree as text with every bracket."""
    if isinstance(expr, Number):
        return f"{expr.value:g}"
    if isinstance(expr, Name):
        return expr.text
    if isinstance(expr, Negative):
        return f"(-{shape(expr.operand)})"
    if isinstance(expr, (Binary, Compare)):
        return f"({shape(expr.left)}{expr.op}{shape(expr.right)})"
    if isinstance(expr, Call):
        return f"{expr.function}({','.join(map(shape, expr.args))})"
    assert isinstance(expr, SumOver)
    return f"sum({shape(expr.body)} for {expr.index} in {shape(expr.low)}..{shape(expr.high)})"


@pytest.mark.parametrize(("text", "tree"), [
    ("a - b - c", "((a-b)-c)"), ("a/b*c", "((a/b)*c)"), ("-a**2", "(-(a**2))"), ("a**-b", "(a**(-b))"),
    ("a**b**c", "(a**(b**c))"), ("2*-a", "(2*(-a))"), ("+a", "a"), ("a + b*c", "(a+(b*c))"), ("(a + b)*c", "((a+b)*c)"),
    ("min(a, max(b, c))", "min(a,max(b,c))"), ("min(1,5)", "min(1,5)"), ("max(a, b, c)", "max(a,b,c)"),
    ("sum(x*i for i in 1..n)", "sum((x*i) for i in 1..n)"), ("der(a.x)", "der(a.x)"), ("p[2].effort", "p[2].effort"),
    ("1e3*a.b.c", "(1000*a.b.c)"), ("if_else(a > b, 1, 0)", "if_else((a>b),1,0)"), (".5*x", "(0.5*x)")])
def test_tree(text: str, tree: str) -> None:
    assert shape(parse_formula(text, units=False)) == tree


@pytest.mark.parametrize(("text", "value"), [
    ("2 * 460 L/min", 2 * 460e-3 / 60), ("42 kN/m", 42e3), ("3 mm + 2 m", 2.003), ("1/2", 0.5), ("-2**2", -4.0),
    ("7 m/2 s", 3.5), ("3 kN/m*2", 6e3), ("5 m**2*2", 10.0)])
def test_quantities_in_formulas(text: str, value: float) -> None:
    assert constant(parse_formula(text)) == pytest.approx(value)


def test_a_name_behind_a_unit_is_no_part_of_it() -> None:
    assert shape(parse_formula("10 N*s/m*cart.v + 3 N*k")) == "((10*cart.v)+(3*k))"


@pytest.mark.parametrize(("text", "column", "code", "words"), [
    ("2*", 1, "formula-incomplete", "ends too early"),
    ("(a + b", 5, "formula-incomplete", "a `)` is missing"),
    ("a + b)", 5, "formula-broken", "no bracket is open"),
    ("a b", 2, "formula-broken", "an operator is missing"),
    ("a = b", 2, "formula-equals", "an `=` inside a formula"),
    ("a^2", 1, "formula-power", "not written `^`"),
    ("1,5*a", 0, "decimal-comma", "a decimal comma in '1,5'"),
    ("2a", 0, "quantity-no-space", "neither a number nor a name"),
    ("sinn(a)", 0, "function-unknown", "there is no function 'sinn'"),
    ("max(a)", 0, "function-arguments", "max takes 2 arguments, not 1"),
    ("a < b < c", 6, "formula-broken", "comparisons do not follow each other"),
    ("sum(a for i of 1..3)", 12, "formula-broken", "`in` is missing"),
    ("a.", 1, "formula-incomplete", "a name is missing behind the dot"),
    ("2 mtr", 2, "unit-unknown", "is not a known unit"),
    ("3 mtr/x", 2, "unit-unknown", "is not a known unit"),
    ("3 m^2", 2, "unit-power", "is written `**`"),
    ("1e999", 0, "number-too-large", "too large"),
    ("2*1e-999", 2, "number-too-small", "too small"),
    ("", 0, "formula-incomplete", "ends too early"),
    ("a if b else c", 2, "formula-broken", "there is no such word"),
    ("sum(1 for i in 1..1000000)", 0, "sum-too-long", "more than"),
    ("((((((((((" * 1000, 31, "formula-too-deep", "within each other"),
    ("-" * 9000, 31, "formula-too-deep", "within each other"),
    ("+".join("a" * 5000), 0, "formula-too-long", "in a row"),
    ("a" * 60000, 0, "formula-too-long", "more than")])
def test_refused_formula(text: str, column: int, code: str, words: str) -> None:
    with pytest.raises(ExpressionProblem) as caught:
        parse_formula(text)
    found = caught.value
    assert (found.code, found.column) == (code, column)
    assert words in found.message
    assert found.hint


@pytest.mark.parametrize("text", [
    "__import__('os').system('touch pwned')", "open('/etc/passwd')", "eval(a)", "exec(a)", "().__class__.__bases__",
    "a.__class__(1)", "a.__class__.__subclasses__()[0]", "[x for x in y]", "{1: 2}", "lambda: 0", "f'{a}'", "a; b", "a\nb",
    "a := 1", "*a", "**a", "a @ b", "a // b", "a % b", "~a", "a | b", "`a`", "print(a)", "getattr(a, b)", "\\x41", "a!b"])
def test_only_the_grammar_is_followed(text: str) -> None:
    with pytest.raises(ExpressionProblem):
        parse_formula(text)


def test_no_module_evaluates_text() -> None:
    """`eval`, `exec`, `compile` and `__import__` are called nowhere, no YAML is loaded into objects, no program started."""
    words = re.compile(r"\b(eval|exec|compile|__import__|yaml|pickle|marshal|shelve|subprocess)\b")
    for path in Path(heavebond.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if words.search(text) else ():
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("eval", "exec", "compile", "__import__"), path
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "yaml":
                assert not node.attr.endswith(("load", "load_all")), path
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                modules = {alias.name for alias in node.names} | {getattr(node, "module", "") or ""}
                # the one program that is started is the C compiler, for FMUs that are written and not run here, for the
                # equations of a model, for the package's own C, and for the user's C with the permission for it;
                # pickled is what the tasks of workers share, from one process to another, never to a file
                allowed = {"fmu_export.py": {"subprocess"}, "compiled_cvodes.py": {"subprocess"},
                           "machine_code.py": {"subprocess"}, "external_functions.py": {"subprocess"},
                           "packed.py": {"pickle"}}.get(path.name, set())
                assert not modules & ({"pickle", "marshal", "shelve", "subprocess"} - allowed), path


def test_equation() -> None:
    found = parse_equation("m * der(a.v) = a.f")
    assert isinstance(found, Equation)
    assert (shape(found.left), shape(found.right)) == ("(m*der(a.v))", "a.f")
    assert [n.text for n in names(found.left)] == ["m", "a.v"]


@pytest.mark.parametrize(("text", "code"), [
    ("a", "formula-incomplete"), ("a == b", "formula-broken"), ("a = b = c", "formula-equals"),
    ("a = 3 N", "unit-in-equation"), ("= b", "formula-broken"), ("a =", "formula-incomplete"), ("a = b,", "formula-broken")])
def test_refused_equation(text: str, code: str) -> None:
    with pytest.raises(ExpressionProblem) as caught:
        parse_equation(text)
    assert caught.value.code == code
    assert caught.value.hint


UNITS = {"x": "m", "v": "m/s", "m": "kg", "F": "N", "n": "1", "p": "Pa", "t": "s"}


def lookup(name: Name) -> Dimension:
    return read_unit(UNITS[name.text]).dimension


@pytest.mark.parametrize(("text", "unit"), [
    ("F*x", "N*m"), ("m*v**2/2", "N*m"), ("sqrt(x*x)", "m"), ("der(x)", "m/s"), ("x + 0", "m"), ("max(x, 0)", "m"),
    ("sin(x/x)", "1"), ("abs(F)", "N"), ("sign(F)", "1"), ("if_else(x > 0, v, 0)", "m/s"), ("smooth_sign(v, v)", "1"),
    ("signed_sqrt(p, p)**2", "Pa"), ("atan2(x, 0)", "1"), ("n**n", "1"), ("sum(x*i for i in 1..3)", "m"),
    ("x**0.5*x**0.5", "m")])
def test_dimension(text: str, unit: str) -> None:
    found = dimension(parse_formula(text, units=False), lookup)
    assert found is not None
    assert dimension_text(found) == unit


@pytest.mark.parametrize(("text", "column", "words"), [
    ("x + v", 2, "'+' joins m and m/s"), ("x + 1", 2, "'+' joins m and a number without unit"),
    ("sin(x)", 4, "the argument of sin must be a number without unit; this is in m"),
    ("x**n", 1, "a base in m needs a plain number as exponent"), ("max(x, t)", 0, "max joins m and s"),
    ("atan2(x, t)", 0, "atan2 joins m and s"),
    ("x*(x > 0)", 3, "a comparison is no number"), ("-(x > 0)", 2, "a comparison is no number"),
    ("x > v", 2, "'>' joins m and m/s"), ("if_else(x, 1, 2)", 8, "the first argument of if_else must be a comparison"),
    ("x > 0 and v", 10, "and, or, not must be a comparison"), ("x**1000", 3, "an exponent of 1000 gives no unit"),
    ("exp(x > 0)", 4, "must be a number without unit; this is a comparison")])
def test_units_that_disagree(text: str, column: int, words: str) -> None:
    with pytest.raises(ExpressionProblem) as caught:
        dimension(parse_formula(text, units=False), lookup)
    assert caught.value.column == column
    assert words in caught.value.message
    assert caught.value.hint


def test_uniform_is_the_same_on_every_machine() -> None:
    assert [uniform(7, i) for i in range(3)] == pytest.approx([0.7210923611, 0.1596594294, 0.4437104126], abs=1e-9)
    assert all(0 <= uniform(s, i) < 1 for s in range(20) for i in range(20))


OPERATORS = {"+": operator.add, "-": operator.sub, "*": operator.mul}
whole = st.integers(0, 9).map(lambda n: (str(n), float(n)))


def _joined(parts: st.SearchStrategy[tuple[str, float]]) -> st.SearchStrategy[tuple[str, float]]:
    """Two formulas in brackets joined by an operator, with the value that Python's own arithmetic gives."""
    return st.tuples(parts, st.sampled_from(sorted(OPERATORS)), parts).map(
        lambda t: (f"({t[0][0]}) {t[1]} ({t[2][0]})", OPERATORS[t[1]](t[0][1], t[2][1])))


@given(st.recursive(whole, _joined, max_leaves=8))
def test_arithmetic_agrees(pair: tuple[str, float]) -> None:
    assert constant(parse_formula(pair[0])) == pytest.approx(pair[1])


@settings(max_examples=300)
@given(st.text(max_size=60) | st.text("abx01.,()[]+-*/=<>! derminsuforcol^'\"", max_size=60))
def test_any_text_is_a_formula_or_a_problem(text: str) -> None:
    for parse in (parse_formula, parse_equation):
        found: ExpressionProblem | None = None
        try:
            parse(text)
        except ExpressionProblem as problem:
            found = problem
        assert found is None or (found.code and found.hint and 0 <= found.column <= len(text))


@pytest.mark.parametrize("text", ["sum(1 for i in 1..n)", "sum(sum(j for j in 1..i) for i in 1..2000)",
                                  "sum(sum(sum(1 for k in 1..j) for j in 1..i) for i in 1..100)"])
def test_a_sum_whose_bound_depends_on_something_is_limited_where_it_is_written_out(text: str) -> None:
    context = Context(lambda text, name: pytest.fail(text), lambda x: x, {"n": 1_000_000_000})
    law = parse_equation(f"a = {text}").right
    with pytest.raises(ExpressionProblem, match="a sum of more than 100000 terms"):
        evaluate(law, context)


@pytest.mark.parametrize("name", INSTEAD)
def test_functions_of_other_programs_lead_to_what_to_write(name: str) -> None:
    with pytest.raises(ExpressionProblem, match=f"there is no function '{name}'") as caught:
        parse_formula(f"{name}(a)")
    for formula in re.findall("`([^`]*)`", caught.value.hint):
        parse_formula(formula)
