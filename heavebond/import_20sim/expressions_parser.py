"""Expressions, statements and declarations of SIDOPS by recursive descent."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from heavebond.core.errors import ModelError, Place, Problem
from heavebond.core.units import Dimension, UnitProblem, declared_unit, dimension_text, read_unit
from heavebond.import_20sim.sidops_lexer import Lexed, Token
from heavebond.import_20sim.sidops_tree import Assign, Declared, Do, Expr, For, If, Statement, While

DEEPEST = 60
LARGEST = 1e100
SECTIONS = {"constants", "parameters", "variables", "externals", "initialequations", "equations", "code", "dynamic",
            "function", "implementation_end", "specification_end", "finalequations"}
KINDS = {"real", "integer", "boolean", "string"}
WORDS = {"global", "hidden", "interesting", "favorite", "import", "export", "observable", "shared", "static"}
LEVELS = (("or", "xor"), ("and",), ("==", "<>", "!=", "<", ">", "<=", ">=", "="), ("+", "-"),
          ("*", "/", ".*", "./", "mod", "div"))
COMPARE = 2
SPELLINGS = {"sec": "s", "Nm": "N*m", "Nms": "N*m*s", "Ns": "N*s", "Ohm": "ohm", "kOhm": "kohm", "MOhm": "Mohm", "Ah": "A*h",
             "mAh": "mA*h", "Ws": "W*s", "Wh": "W*h", "cc": "cm**3", "kmh": "km/h", "mph": "mile/h"}
# base units of single tokens
NAMED = ("m", "s", "kg", "K", "A", "mol", "N", "Pa", "W", "V", "ohm", "F", "H", "C", "T", "Wb")
TURNS = {"deg": "rad", "rev": "rad", "rad": "rad", "rpm": "rad/s"}


class Unreadable(Exception):
    """A construct that the parser does not know, with the line and the reason."""

    def __init__(self, line: int, reason: str):
        super().__init__(reason)
        self.line, self.reason = line, reason


class Reader:
    """A position in the tokens of a text."""

    def __init__(self, lexed: Lexed, file: str):
        self.tokens, self.comments, self.file = lexed.tokens, lexed.comments, file
        self.at, self.depth = 0, 0
        self.declaring = False

    @property
    def current(self) -> Token:
        return self.tokens[self.at]

    def take(self) -> Token:
        token = self.current
        if token.kind != "end":
            self.at += 1
        return token

    def skip(self, *texts: str) -> bool:
        """Skip the next token if it is one of these."""
        if self.current.text.lower() in texts and self.current.kind in ("name", "sign"):
            self.at += 1
            return True
        return False

    def need(self, text: str) -> Token:
        if self.current.text.lower() != text:
            raise Unreadable(self.current.line, f"'{text}' is missing before '{self.current.text[:30]}'")
        return self.take()

    def to_semicolon(self) -> None:
        while self.current.kind != "end" and self.current.text != ";" and self.current.word not in SECTIONS:
            self.at += 1
        self.skip(";")

    def deeper(self) -> None:
        self.depth += 1
        if self.depth > DEEPEST:
            raise ModelError([Problem("emx-nesting", f"more than {DEEPEST} constructs lie within each other",
                                      Place(self.file, self.current.line))])

    # -- expressions -------------------------------------------------------------------------------------------------
    def expression(self, level: int = 0, *, equals: bool = True) -> Expr:
        """An expression; without `equals` a single `=` ends it."""
        self.deeper()
        try:
            if level == len(LEVELS):
                return self._sign()
            if level == COMPARE and self.current.word == "not":
                line = self.take().line
                return Expr("not", (self.expression(level, equals=equals),), line=line)
            left = self.expression(level + 1, equals=equals)
            while self.current.text.lower() in LEVELS[level] and (equals or self.current.text != "="):
                sign = self.take()
                op = {"=": "==", "<>": "!=", ".*": ".*"}.get(sign.text, sign.text.lower())
                left = Expr(op, (left, self.expression(level + 1, equals=equals)), line=sign.line)
            return left
        finally:
            self.depth -= 1

    def _sign(self) -> Expr:
        self.deeper()
        try:
            if self.current.text in ("-", "+"):
                sign = self.take()
                inner = self._sign()
                return Expr("negative", (inner,), line=sign.line) if sign.text == "-" else inner
            base = self._primary()
            while self.current.text == "[":
                line = self.take().line
                base = Expr("index", (base, *self._list("]", ranges=True)), line=line)
            if self.current.text in ("^", ".^"):
                sign = self.take()
                return Expr(sign.text, (base, self._sign()), line=sign.line)
            return base
        finally:
            self.depth -= 1

    def _list(self, end: str, *, ranges: bool = False) -> list[Expr]:
        items: list[Expr] = []
        while self.current.text != end:
            first = self.expression()
            if ranges and self.skip(":"):
                first = Expr("range", (first, self.expression()), line=first.line)
            items.append(first)
            if not self.skip(","):
                break
        self.need(end)
        return items

    def _primary(self) -> Expr:
        token = self.take()
        if token.kind == "number" and float(token.text) > LARGEST:
            raise Unreadable(token.line, f"the number {token.text[:30]} is too large")
        if token.kind == "number" and self.current.kind == "unit" and not (
                self.declaring and self.tokens[self.at + 1].text in (";", ",")):  # this is the unit of the declaration
            return Expr("number", value=float(token.text) * unit_of(self.take().text[1:-1]).factor, line=token.line)
        if token.kind == "number":
            return Expr("number", value=float(token.text), line=token.line)
        if token.kind == "string":
            return Expr("text", name=token.text[1:-1], line=token.line)
        if token.text == "(":
            inner = self.expression()
            self.need(")")
            return inner
        if token.text == "[":
            rows: list[list[Expr]] = [[]]
            while self.current.text != "]":
                rows[-1].append(self.expression())
                if self.skip(";"):
                    rows.append([])
                elif not self.skip(","):
                    break
            self.need("]")
            if len({len(row) for row in rows}) != 1 or not rows[0]:
                raise Unreadable(token.line, "the rows of a matrix have different lengths")
            return Expr("matrix", tuple(e for row in rows for e in row), line=token.line, columns=len(rows[0]))
        if token.word == "if":
            return self._conditional(token)
        if token.kind == "name" and token.word not in ("then", "else", "end", *SECTIONS):
            if self.skip("("):
                return Expr("call", tuple(self._list(")")), name=token.text, line=token.line)
            return Expr("name", name=token.text, line=token.line)
        raise Unreadable(token.line, f"'{token.text[:30]}' is not an expression")

    def _conditional(self, token: Token) -> Expr:
        condition = self.expression()
        self.need("then")
        then = self.expression()
        if self.current.word in ("elsif", "elseif"):
            return Expr("if", (condition, then, self._conditional(self.take())), line=token.line)
        self.need("else")
        otherwise = self.expression()
        self.need("end")
        return Expr("if", (condition, then, otherwise), line=token.line)

    # -- statements --------------------------------------------------------------------------------------------------
    def statements(self, *ends: str) -> list[Statement]:
        """Statements up to a keyword of `ends` or the next section; one that cannot be read is kept as an error."""
        statement_list: list[Statement] = []
        while self.current.kind != "end" and self.current.word not in SECTIONS and self.current.word not in ends:
            if self.skip(";"):
                continue
            if self.current.kind == "string":  # a description in the text
                self.take()
                continue
            start = self.at
            try:
                statement_list.append(self._statement())
            except Unreadable as problem:
                statement_list.append(Do(Expr("text"), problem.line, problem.reason))
                self.at = max(self.at, start + 1)
                self.to_semicolon()
        return statement_list

    def _statement(self) -> Statement:
        self.deeper()
        try:
            token = self.current
            if token.word == "if":
                self.take()
                return self._if(token)
            if token.word == "for":
                return self._for()
            if token.word in ("while", "repeat"):
                return self._while()
            if token.word == "switch":
                self.take()
                return self._switch(token.line)
            left = self.expression(equals=False)
            if left.op == "call" and self.current.text != "=":
                self.skip(";")
                return Do(left, token.line)
            self.need("=")
            right = self.expression()
            if self.current.text != ";" and self.current.word not in (*SECTIONS, "end", "else"):
                raise Unreadable(self.current.line, f"';' is missing before '{self.current.text[:30]}'")
            self.skip(";")
            return Assign(left, right, token.line)
        finally:
            self.depth -= 1

    def _if(self, token: Token) -> If:
        condition = self.expression()
        self.need("then")
        then = self.statements("else", "end", "elsif", "elseif")
        otherwise: list[Statement] = []
        if self.current.word in ("elsif", "elseif"):
            otherwise = [self._if(self.take())]
            return If(condition, tuple(then), tuple(otherwise), token.line)
        if self.skip("else"):
            otherwise = self.statements("end")
        self.need("end")
        self.skip(";")
        return If(condition, tuple(then), tuple(otherwise), token.line)

    def _for(self) -> For:
        line, name = self.take().line, self.take().text
        self.need("=")
        first = self.expression()
        self.need("to")
        last = self.expression()
        step = self.expression() if self.skip("by") else None
        self.need("do")
        body = self.statements("end")
        self.need("end")
        self.skip(";")
        return For(name, first, last, tuple(body), line, step)

    def _while(self) -> While:
        token = self.take()
        if token.word == "while":
            condition = self.expression()
            self.need("do")
            body = self.statements("end")
            self.need("end")
        else:
            body = self.statements("until")
            self.need("until")
            condition = self.expression()
        self.skip(";")
        return While(condition, tuple(body), token.word == "repeat", token.line)

    def _switch(self, line: int) -> Statement:
        """`switch x case 1 do ... default do ... end` as nested choices; each case may have a separate `end`."""
        value, closed = self.expression(), False
        branches: list[tuple[Expr, list[Statement]]] = []
        otherwise: list[Statement] = []
        while self.current.word in ("case", "default"):
            case = self.take().word == "case"
            tests = [Expr("==", (value, self.expression()), line=line)] if case else []
            while case and self.skip(","):
                tests.append(Expr("==", (value, self.expression()), line=line))
            self.need("do")
            body = self.statements("end", "case", "default")
            if self.skip("end"):
                self.skip(";")
                closed = closed or self.current.word in ("case", "default")
            if case:
                test = tests[0]
                for further_test in tests[1:]:
                    test = Expr("or", (test, further_test), line=line)
                branches.append((test, body))
            else:
                otherwise = body
        if closed:  # the last `end` belonged to the last case
            self.need("end")
            self.skip(";")
        if not branches:
            raise Unreadable(line, "a `switch` has no `case`")
        for test, body in reversed(branches):
            otherwise = [If(test, tuple(body), tuple(otherwise), line)]
        return otherwise[0]

    # -- declarations ------------------------------------------------------------------------------------------------
    def declarations(self, problems: list[tuple[int, str]]) -> list[Declared]:
        """Declarations up to the next section or `end`."""
        declared_list: list[Declared] = []
        ends = {*SECTIONS, "end", "restrictions", "ports", "description"}
        while self.current.kind != "end" and self.current.word not in ends:
            if self.skip(";"):
                continue
            if self.current.kind == "string":  # a description of the declaration before it
                comment = self.take().text[1:-1]
                declared_list[-1:] = [replace(item, doc=item.doc or comment) for item in declared_list[-1:]]
                continue
            try:
                if self.current.word not in KINDS:
                    raise Unreadable(self.current.line, f"'{self.current.text[:30]}' is not a declaration")
                declared_list += self._declared()
            except Unreadable as problem:
                problems.append((problem.line, problem.reason))
                if self.current.word not in SECTIONS:
                    self.take()
                self.to_semicolon()
        return declared_list

    def _stated(self) -> Expr:
        """The value of a declaration; a unit after it belongs to the declaration."""
        self.declaring = True
        try:
            return self.expression()
        finally:
            self.declaring = False

    def _declared(self) -> list[Declared]:
        kind, words = self.take().word, []
        declared_list: list[Declared] = []
        while self.current.word in WORDS:
            words.append(self.take().word)
        while True:
            while declared_list and self.current.word in WORDS and self.tokens[self.at + 1].kind == "name":
                self.take()
            token = self.take()
            if token.kind != "name":
                raise Unreadable(token.line, f"'{token.text[:30]}' is not a name")
            size: list[Expr] = []
            value: Expr | None = None
            unit = ""
            while True:
                if self.skip("("):
                    depth = 1
                    while depth and self.current.kind != "end" and self.current.text != ";":
                        depth += {"(": 1, ")": -1}.get(self.take().text, 0)
                elif self.skip("["):
                    size = self._list("]")
                elif self.skip("="):
                    value = self._stated()
                elif self.current.kind == "unit":
                    unit = self.take().text[1:-1].strip()
                elif self.current.kind == "string":
                    self.take()
                else:
                    break
            *before, beside = self.comments.get(token.line, "").split("\n")
            declared_list.append(Declared(token.text, kind, token.line, tuple(words), tuple(size), value, unit, beside,
                                          "" if declared_list else "\n".join(before)))
            if not self.skip(","):
                break
        self.skip(";")
        return declared_list


@dataclass(frozen=True)
class ReadUnit:
    """A unit with the base unit for a declaration; a value x of it is `factor * x + offset` in the base. `doc` is the
    text of an unknown unit, whose values are unchanged."""

    base: str = ""
    factor: float = 1.0
    offset: float = 0.0
    doc: str = ""

    def si(self, value: float) -> float:
        if self.factor == 1 and not self.offset:
            return value
        return float(f"{self.factor * value + self.offset:.15g}")  # 5 uF as 5e-06 F, not as 4.9999999999999996e-06 F


def unit_of(text: str) -> ReadUnit:
    """A unit in the notation of 20-sim: `kg.m2`, `N.s/m`, `m.s-1`, `length, mm`; both programs compute in SI units."""
    text = text.rpartition(",")[2].strip()
    spelt = re.sub(r"[A-Za-z]+", lambda m: SPELLINGS.get(m.group(), m.group()), text)
    plain = re.sub(r"(?<=[A-Za-z])(-?[0-9]+)", r"**\1", spelt.replace(".", "*").replace("^", "**").replace(" ", "*"))
    plain = plain.replace("****", "**")
    if plain in ("", "1", "none", "-"):
        return ReadUnit()
    try:
        unit_read = read_unit(plain)
        base = plain if unit_read.scale == 1 and not unit_read.offset else _base(plain, unit_read.dimension)
        declared_unit(base)
    except (UnitProblem, ValueError, OverflowError):
        return ReadUnit(doc=f"[{text}]")
    return ReadUnit("" if base == "1" else base, unit_read.scale, unit_read.offset)


def _base(plain: str, dimension: Dimension) -> str:
    """The unit of scale 1 for `mm`, `km/h`, `uF` ...: each token in its base unit if that is the same quantity."""
    def token(match: re.Match[str]) -> str:
        word = match.group()
        if word in TURNS:
            return f"({TURNS[word]})" if "/" in TURNS[word] else TURNS[word]
        measured = read_unit(word).dimension
        return next((name for name in NAMED if read_unit(name).dimension == measured),
                    f"({dimension_text(measured)})")

    try:
        base = re.sub(r"[A-Za-z]+", token, plain)
        base = base[1:-1] if base.startswith("(") and base.endswith(")") and base.count("(") == 1 else base
        read = read_unit(base)
        if read.scale == 1 and not read.offset and read.dimension == dimension:
            return base
    except (UnitProblem, ValueError, OverflowError):
        pass
    return dimension_text(dimension)
