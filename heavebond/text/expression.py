"""Parser of equations and formulas: text to an expression tree. The grammar is restricted; Python evaluates no text.

    equation   = sum '=' sum
    formula    = or-expression
    sum        = product (('+'|'-') product)*
    product    = unary (('*'|'/') unary)*
    unary      = '-' unary | power
    power      = atom ('**' unary)?
    atom       = number [unit] | name ('.' name | '[' index (',' index)* ']')* | function '(' ... ')' ['.' name]
               | '(' formula ')'
    index      = sum ['..' sum]

Units after a number (`2 * 460 L/min`) are allowed in diagrams only. Component equations contain declared names and numbers
without unit.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass

from heavebond.core.errors import suggest
from heavebond.core.limits import BRACKETS, FORMULA, OPERATIONS, TERMS
from heavebond.core.limits import NUMBER as LARGEST
from heavebond.core.numerals import whole
from heavebond.core.units import LEAST, TOO_LARGE, TOO_SMALL, UNIT, UnitProblem, is_lost, read_unit
from heavebond.text.syntax import Binary as Binary
from heavebond.text.syntax import Call as Call
from heavebond.text.syntax import Compare as Compare
from heavebond.text.syntax import Elements as Elements
from heavebond.text.syntax import Equation as Equation
from heavebond.text.syntax import Expr as Expr
from heavebond.text.syntax import External as External
from heavebond.text.syntax import Function as Function
from heavebond.text.syntax import FunctionCall as FunctionCall
from heavebond.text.syntax import Logic as Logic
from heavebond.text.syntax import Name as Name
from heavebond.text.syntax import Negative as Negative
from heavebond.text.syntax import Not as Not
from heavebond.text.syntax import Number as Number
from heavebond.text.syntax import Quantity as Quantity
from heavebond.text.syntax import Slice as Slice
from heavebond.text.syntax import Step as Step
from heavebond.text.syntax import SumOver as SumOver
from heavebond.text.syntax import children as children
from heavebond.text.syntax import constant as constant
from heavebond.text.syntax import functions_in as functions_in
from heavebond.text.syntax import inside as inside
from heavebond.text.syntax import names as names
from heavebond.text.syntax import put_in as put_in

# number of arguments by function
FUNCTIONS = {
    "der": 1, "sqrt": 1, "exp": 1, "log": 1, "sin": 1, "cos": 1, "tan": 1, "tanh": 1, "asin": 1, "acos": 1, "atan": 1,
    "atan2": 2, "abs": 1, "sign": 1, "floor": 1, "min": 2, "max": 2, "smooth_sign": 2, "signed_sqrt": 2, "if_else": 3,
    "uniform": 2, "sum": 1, "dot": 2, "cross": 2, "transpose": 1, "symmetric": 1, "definite": 1, "semidefinite": 1,
    "least_distance": 5,
}
# functions of several values, and those of one signal over a run
OVER_TIME = {"max": "highest", "min": "lowest"}
# usage of functions in messages
USAGE = {"min": "min(a, b)", "max": "max(a, b)", "atan2": "atan2(y, x)", "smooth_sign": "smooth_sign(v, v_t)",
         "uniform": "uniform(seed, i)", "signed_sqrt": "signed_sqrt(dp, dp_t)", "if_else": "if_else(a > b, x, y)",
         "dot": "dot(a, b)", "cross": "cross(a, b)", "least_distance": "least_distance(W, c, low, high, soft)"}
# replacements for functions of other programs
INSTEAD = {**dict.fromkeys(("if", "iif", "ifelse", "where", "ternary"), f"Write `{USAGE['if_else']}`."),
           "ln": "Write `log(a)`, the natural logarithm.", "log10": "Write `log(a)/log(10)`.", "pow": "Write `a**b`.",
           "sqr": "Write `a**2`.", "step": "Write `if_else(time > 1 s, 1, 0)`, or use the component Step.",
           "ramp": "Write `min(max(time - 1 s, 0 s)/2 s, 1)`, or use the component Ramp.",
           "mod": "Write `a - b*floor(a/b)`.", "rem": "Write `a - b*floor(a/b)`.", "ceil": "Write `-floor(-a)`.",
           **dict.fromkeys(("trunc", "fix"), "Write `sign(a)*floor(abs(a))`."),
           "round": "Write `floor(a + 0.5)`.", "sinh": "Write `(exp(a) - exp(-a))/2`.",
           "cosh": "Write `(exp(a) + exp(-a))/2`.", **dict.fromkeys(("rand", "random"), "Write `uniform(seed, i)`."),
           **dict.fromkeys(("limit", "clip", "sat", "saturate"), "Write `min(max(a, low), high)`."),
           "ddt": "Write `der(a)`.", "derivative": "Write `der(a)`."}
SUM_FORM = "A sum is written `sum(... for i in 1..n)`."
COMPARISONS = ("<=", ">=", "==", "!=", "<", ">")
Functions = Mapping[str, Function]  # functions of files, by name; each is read at its first use
_defined: ContextVar[Functions] = ContextVar("defined", default={})  # noqa: B039 - a mapping that is never changed
KEYWORDS = {"and", "or", "not", "for", "in"}
_SKIP = re.compile(r"[ \t]+")
_NUMBER = re.compile(r"(?:[0-9]+(?:\.(?!\.)[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_UNIT_AFTER = re.compile(rf"[ \t]+({UNIT})(?![\w(])")
_NAME = re.compile(r"[A-Za-z_]\w*")
_OPERATOR = re.compile(r"\*\*|\.\.|<=|>=|==|!=|[-+*/(),=<>.\[\]]")


@contextmanager
def calling(defined: Functions) -> Iterator[None]:
    """Context in which parsed formulas may call the functions of files, in addition to the functions of the language."""
    before = _defined.set(defined)
    try:
        yield
    finally:
        _defined.reset(before)


def parse_equation(text: str) -> Equation:
    """Parse `left = right` of a component (no units after numbers); raises ExpressionProblem."""
    parser = _Parser(text, units=False)
    left = parser.sum()
    if parser.peek().text != "=":
        raise parser.broken("an equation needs one `=`", "An equation is written `left = right`.")
    parser.take()
    right = parser.sum()
    if parser.peek().text == "=":
        raise ExpressionProblem("formula-equals", "a second `=` in one equation", parser.peek().column, 1,
                                "Write two equations, one a line.")
    parser.end()
    _check_depth(left, right)
    return Equation(left, right)


def parse_formula(text: str, *, units: bool = True, functions: Mapping[str, int] | None = None) -> Expr:
    """Parse a formula (without a leading `=`); `functions` are additional functions with their numbers of arguments.

    Raises ExpressionProblem.
    """
    parser = _Parser(text, units=units, functions={**FUNCTIONS, **(functions or {})})
    formula = parser.formula()
    if parser.peek().text == "=":
        raise ExpressionProblem("formula-equals", "an `=` inside a formula", parser.peek().column, 1,
                                "A comparison is written `==`.")
    parser.end()
    _check_depth(formula)
    return formula


def _check_depth(*trees: Expr) -> None:
    """Limit the depth of trees, because they are traversed recursively; the author must split a longer sum or product."""
    level = list(trees)
    for _ in range(OPERATIONS):
        level = [child for expr in level for child in children(expr)]
        if not level:
            return
    raise ExpressionProblem("formula-too-long", f"more than {OPERATIONS} operations in a row", 0, 1,
                            "Split it: give a part of it a name of its own.")


class _Parser:
    def __init__(self, text: str, *, units: bool, functions: Mapping[str, int] = FUNCTIONS):
        self.text, self.functions, self.defined = text, functions, _defined.get()
        if len(text) > FORMULA:
            raise ExpressionProblem("formula-too-long", f"a formula of more than {FORMULA} signs", 0, 1,
                                    "Split it: give a part of it a name of its own.")
        self.tokens = list(tokens(text, units=units))
        self.position = 0
        self.depth = 0

    def peek(self) -> Token:
        return self.tokens[self.position]

    def take(self) -> Token:
        token = self.tokens[self.position]
        self.position += 1
        return token

    def expect(self, text: str, why: str, hint: str) -> None:
        if self.peek().text != text:
            raise self.broken(why, hint)
        self.take()

    def broken(self, why: str, hint: str) -> ExpressionProblem:
        """The syntax problem at the next token."""
        token = self.peek()
        if token.kind == "end":
            return ExpressionProblem("formula-incomplete", f"the formula ends too early: {why}",
                                    max(0, len(self.text.rstrip()) - 1), 1, hint)
        return ExpressionProblem("formula-broken", f"'{token.text}' cannot stand here: {why}", token.column,
                                len(token.text), hint)

    def end(self) -> None:
        token = self.peek()
        if token.text == ")":
            raise self.broken("no bracket is open", "Remove it, or add the `(` that is missing.")
        if token.text == "if":
            raise self.broken("there is no such word", f"Write `{USAGE['if_else']}`.")
        if token.kind in ("name", "number", "unit") or token.text == "(":
            raise self.broken("an operator is missing before it", "A product is written with `*`.")
        if token.kind != "end":
            raise self.broken("the formula is complete before it", "Remove it.")

    @contextmanager
    def _deeper(self) -> Iterator[None]:
        """Count the nested brackets, functions and signs; their limit bounds the recursion of the parser."""
        self.depth += 1
        if self.depth > BRACKETS:
            raise ExpressionProblem("formula-too-deep", f"more than {BRACKETS} brackets or signs within each other",
                                    self.peek().column, 1, "Split it: give a part of it a name of its own.")
        yield
        self.depth -= 1

    def _chain(self, operand: Callable[[], Expr], ops: tuple[str, ...], build: type) -> Expr:
        left = operand()
        while (token := self.peek()).text in ops and token.kind in ("operator", "keyword"):
            self.take()
            left = build(token.text, left, operand(), token.column)
        return left

    def formula(self) -> Expr:
        return self._chain(self._conjunction, ("or",), Logic)

    def _conjunction(self) -> Expr:
        return self._chain(self._negation, ("and",), Logic)

    def _negation(self) -> Expr:
        if self.peek().text == "not":
            token = self.take()
            with self._deeper():
                return Not(self._negation(), token.column)
        left = self.sum()
        if self.peek().text in COMPARISONS:
            token = self.take()
            right = self.sum()
            if self.peek().text in COMPARISONS:
                raise self.broken("comparisons do not follow each other", "Write `a < b and b < c`.")
            return Compare(token.text, left, right, token.column)
        return left

    def sum(self) -> Expr:
        return self._chain(self._product, ("+", "-"), Binary)

    def _product(self) -> Expr:
        return self._chain(self._unary, ("*", "/"), Binary)

    def _unary(self) -> Expr:
        token = self.peek()
        if token.text not in ("-", "+"):
            return self._power()
        self.take()
        with self._deeper():
            operand = self._unary()
        return Negative(operand, token.column) if token.text == "-" else operand

    def _power(self) -> Expr:
        base = self._atom()
        if self.peek().text == "**":
            token = self.take()
            with self._deeper():
                return Binary("**", base, self._unary(), token.column)
        return base

    def _atom(self) -> Expr:
        token = self.take()
        if token.kind == "number":
            return self._number(token)
        if token.kind == "name":
            with self._deeper():
                return self._call(token) if self.peek().text == "(" else self._name(token)
        if token.text == "(":
            with self._deeper():
                inner = self.formula()
            self.expect(")", "a `)` is missing", "Each `(` needs a `)`.")
            return inner
        if token.text == "[":
            with self._deeper():
                # parse the elements of a list, or the rows of a matrix, up to the closing bracket
                items = [self.formula()]
                while self.peek().text == ",":
                    self.take()
                    items.append(self.formula())
                self.expect("]", "a `]` is missing", "Each `[` needs a `]`, as in `[a, b]` or `[[a, b], [c, d]]`.")
                return Elements(tuple(items), token.column)
        self.position -= 1
        raise self.broken("a number or a name is missing", "Complete the formula, as in `2*a + b`.")

    def _number(self, token: Token) -> Number:
        value = float(token.text)
        if not value <= LARGEST:
            raise ExpressionProblem("number-too-large", "too large a number", token.column, len(token.text), TOO_LARGE)
        if is_lost(token.text, value):
            raise ExpressionProblem("number-too-small", "too small a number", token.column, len(token.text), TOO_SMALL)
        if self.peek().kind != "unit":
            return Number(value, None, token.column)
        unit_token = self.take()
        try:
            read = read_unit(unit_token.text)
        except UnitProblem as problem:
            raise ExpressionProblem(problem.code, problem.message, unit_token.column, len(unit_token.text),
                                    problem.hint) from problem
        if not abs(read.to_si(value)) <= LARGEST:
            raise ExpressionProblem("number-too-large", "too large a number", token.column, len(token.text), TOO_LARGE)
        if value and not read.offset and abs(read.to_si(value)) < LEAST:
            raise ExpressionProblem("number-too-small", "too small a number", token.column, len(token.text), TOO_SMALL)
        return Number(read.to_si(value), read, token.column)

    def _name(self, token: Token) -> Name:
        parts: list[str | Expr] = [token.text]
        while self.peek().text in (".", "["):
            if self.take().text == "[":
                parts.append(self._index())
                while self.peek().text == ",":  # second index of a matrix
                    self.take()
                    parts.append(self._index())
                self.expect("]", "a `]` is missing", "Each `[` needs a `]`.")
            else:
                follower = self.take()
                if follower.kind not in ("name", "keyword"):
                    self.position -= 1
                    raise self.broken("a name is missing behind the dot", "Write for example `load.x`.")
                parts.append(follower.text)
        last = self.tokens[self.position - 1]
        name = Name(tuple(parts), token.column, last.column + len(last.text) - token.column)
        if self.peek().text == "(":
            known = parts[-1] if isinstance(parts[-1], str) and parts[-1] in self.functions else ""
            raise ExpressionProblem("function-unknown", f"there is no function '{name.text}'", name.column, name.length,
                                    f"Write `{known}`." if known else self._known_functions())
        return name

    def _index(self) -> Expr:
        """Parse an index, or `low..high` for several elements."""
        low = self.sum()
        if self.peek().text != "..":
            return low
        column = self.take().column
        return Slice(low, self.sum(), column)

    def _known_functions(self) -> str:
        known = list(self.functions)
        return f"Functions: {', '.join(known[:14])},\n{', '.join(known[14:])}." \
            + (" `heavebond library` lists those of files." if self.defined else "")

    def _call(self, token: Token) -> Expr:
        name = token.text
        if name not in self.functions and name in self.defined:
            return self._function_call(self._definition(token), token)
        if name not in self.functions:
            raise ExpressionProblem("function-unknown", f"there is no function '{name}'", token.column, len(name),
                                    INSTEAD.get(name.lower(), "") or suggest(name, [*self.functions, *self.defined])
                                    or self._known_functions())
        self.take()
        args = [self.formula()]
        if name == "sum" and self.peek().text == "for":
            self.take()
            index = self.take()
            if index.kind != "name":
                self.position -= 1
                raise self.broken("the name of the index is missing", SUM_FORM)
            self.expect("in", "`in` is missing", SUM_FORM)
            low = self.sum()
            self.expect("..", "`..` is missing", SUM_FORM)
            high = self.sum()
            self.expect(")", "a `)` is missing behind sum(", SUM_FORM)
            result = SumOver(args[0], index.text, low, high, token.column)
            if _terms(result) > TERMS:
                raise too_long(token.column)
            return result
        usage = USAGE.get(name, f"{name}(a)")
        self._arguments(args, name, usage)
        needed = self.functions[name]
        if len(args) != needed and not (name in ("min", "max") and len(args) > 1):
            many = "s" if needed > 1 else ""
            over_time = OVER_TIME.get(name, "") if len(args) == 1 else ""
            hint = f"Write `{over_time}(...)` for the value over the run." if over_time in self.functions else \
                f"Write `{usage}`."
            raise ExpressionProblem("function-arguments", f"{name} takes {needed} argument{many}, not "
                                    f"{len(args)}", token.column, len(name), hint)
        return Call(name, tuple(args), token.column)

    def _arguments(self, args: list[Expr], name: str, usage: str) -> None:
        """Parse the arguments after the first one, up to the closing parenthesis."""
        while self.peek().text == ",":
            self.take()
            args.append(self.formula())
        self.expect(")", f"a `)` is missing behind {name}(", f"Write `{usage}`.")

    def _definition(self, token: Token) -> Function:
        """The function of a file; raises ExpressionProblem if it cannot be called, for example because it calls itself."""
        try:
            return self.defined[token.text]
        except ExpressionProblem as problem:
            raise ExpressionProblem(problem.code, problem.message, token.column, len(token.text), problem.hint) from None

    def _function_call(self, function: Function, token: Token) -> FunctionCall:
        self.take()
        args = [self.formula()]
        self._arguments(args, function.name, function.usage)
        if len(args) != len(function.inputs):
            many = "s" if len(function.inputs) > 1 else ""
            raise ExpressionProblem("function-arguments", f"{function.name} takes {len(function.inputs)} argument{many}, "
                                    f"not {len(args)}", token.column, len(function.name), f"Write `{function.usage}`.")
        outputs = list(function.outputs)
        if self.peek().text != ".":
            if len(outputs) > 1:
                further_outputs = " or ".join(f"`.{name}`" for name in outputs[1:])
                raise ExpressionProblem("function-output", f"{function.name} has {len(outputs)} outputs; the one that is "
                                        "meant is missing", token.column, len(function.name),
                                        f"Write `{function.usage}`, or {further_outputs} behind the parenthesis.")
            return FunctionCall(function, tuple(args), outputs[0], token.column)
        self.take()
        output = self.take()
        if output.text not in function.outputs:
            raise ExpressionProblem("function-output", f"{function.name} has no output '{output.text}'", output.column,
                                    max(1, len(output.text)), suggest(output.text, outputs)
                                    or f"Its outputs: {', '.join(outputs)}.")
        return FunctionCall(function, tuple(args), output.text, token.column)


def too_long(column: int) -> ExpressionProblem:
    """The problem of a sum with too many terms for the memory."""
    return ExpressionProblem("sum-too-long", f"a sum of more than {TERMS} terms", column, 3, "Use fewer terms.")


def _terms(expr: Expr) -> float:
    """The number of terms of an expression with expanded sums; sums with limits that are not constant are not counted."""
    inner = max((_terms(child) for child in children(expr)), default=1.0)
    if not isinstance(expr, SumOver):
        return inner
    first, last = constant(expr.low), constant(expr.high)
    return inner if first is None or last is None else inner * max(1.0, last - first + 1)


class ExpressionProblem(ValueError):
    """Error in the text of an expression; `column` counts from 0 in the parsed text."""

    def __init__(self, code: str, message: str, column: int, length: int = 1, hint: str = ""):
        super().__init__(message)
        self.code, self.message, self.column, self.length, self.hint = code, message, column, length, hint


@dataclass(frozen=True)
class Token:
    """A token of a formula: number, unit, name, keyword, operator or end."""

    kind: str
    text: str
    column: int


def tokens(text: str, *, units: bool) -> Iterator[Token]:
    """Split a formula into tokens, with units after numbers if `units` is true.

    Raises ExpressionProblem for a character that is not allowed in a formula.
    """
    at = 0
    while at < len(text):
        if skip := _SKIP.match(text, at):
            at = skip.end()
            continue
        if token_match := _NUMBER.match(text, at):
            yield Token("number", token_match.group(), at)
            at = token_match.end()
            number = token_match.group()
            after = text[at:at + 2]
            if after[:1] == "," and whole(after[1:]) is not None and not (text.count("(", 0, at) > text.count(")", 0, at)):
                raise ExpressionProblem("decimal-comma", f"a decimal comma in '{number}{after}'", at - len(number),
                                        len(number) + 2, f"Write '{number}.{after[1:]}'.")
            if glued := _NAME.match(text, at):
                raise ExpressionProblem(
                    "quantity-no-space", f"'{number}{glued.group()}' is neither a number nor a name", at - len(number),
                    len(number) + len(glued.group()), f"A product is written `{number}*{glued.group()}`"
                    + (f", a quantity `{number} {glued.group()}`." if units else "."))
            if not units and (name := _UNIT_AFTER.match(text, at)) and name.group(1) not in KEYWORDS:
                raise ExpressionProblem(
                    "unit-in-equation", f"'{token_match.group()} {name.group(1)}': a component's equations hold no units",
                    token_match.start(), name.end() - token_match.start(),
                    "Declare a parameter with its unit; a product is written with `*`.")
            if units and (unit := _UNIT_AFTER.match(text, at)) and unit.group(1) not in KEYWORDS:
                word = _longest_unit(unit.group(1), text[unit.end(1):])
                yield Token("unit", word, unit.start(1))
                at = unit.start(1) + len(word)
        elif token_match := _NAME.match(text, at):
            kind = "keyword" if token_match.group() in KEYWORDS else "name"
            yield Token(kind, token_match.group(), at)
            at = token_match.end()
        elif token_match := _OPERATOR.match(text, at):
            yield Token("operator", token_match.group(), at)
            at = token_match.end()
        else:
            sign = text[at]
            if sign == "^":
                raise ExpressionProblem("formula-power", "the power is not written `^`", at, 1, "Write `**`.")
            sign_text = {"'": "a quote (')", '"': 'a quote (")'}.get(sign, f"'{sign}'")
            raise ExpressionProblem("sign-unknown", f"{sign_text} has no meaning in a formula", at, 1,
                                    "A formula holds numbers, names, + - * / ** and functions.")
    yield Token("end", "", len(text))


def _longest_unit(word: str, remainder: str) -> str:
    """The longest prefix of `word` that is a unit, `N*s/m` in `3 N*s/m*load.v`.

    If no prefix is a unit, the whole word, which the caller reports as an unknown unit.
    """
    part = word
    if remainder.startswith("."):  # the last factor is the first part of a dotted name
        part = _without_last_factor(part)
    while part:
        with suppress(UnitProblem):
            if not part.endswith("*time"):  # which is no unit: the units library, slow to import, need not be asked
                read_unit(part)
                return part
        part = _without_last_factor(part)
    return word


def _without_last_factor(unit: str) -> str:
    cut = max(unit.rfind("/"), re.sub(r"\*\*", "  ", unit).rfind("*"))
    return unit[:cut] if cut > 0 else ""
