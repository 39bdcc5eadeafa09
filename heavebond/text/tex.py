"""Convert expression trees to TeX for documentation: `F_c * smooth_sign(v, v_t)` becomes F_c tanh(v/v_t).

The output uses only commands that KaTeX, MathJax and GitHub support. Symbols follow the names of the component: `dp` is a
difference (Delta p), a spelled Greek letter (`kappa`) becomes the letter, the text after `_` is an index, and a variable of
a port has the port as its index.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from heavebond.text.expression import (
    Binary,
    Call,
    Compare,
    Elements,
    Equation,
    Expr,
    FunctionCall,
    Logic,
    Name,
    Negative,
    Not,
    Number,
    Slice,
)

GREEK = ("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "rho",
         "sigma", "tau", "phi", "chi", "psi", "omega", "Delta", "Theta", "Lambda", "Sigma", "Phi", "Psi", "Omega")
_SIGNS = {"<=": r"\le", ">=": r"\ge", "==": "=", "!=": r"\ne", "<": "<", ">": ">"}
_WORDS = {"exp": r"\exp", "log": r"\ln", "sin": r"\sin", "cos": r"\cos", "tan": r"\tan", "tanh": r"\tanh",
          "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan", "min": r"\min", "max": r"\max",
          "sign": r"\operatorname{sgn}", "uniform": r"\operatorname{uniform}",
          **{name: rf"\operatorname{{{name}}}" for name in ("atan2", "least_distance", "symmetric", "definite",
                                                                         "semidefinite")}}
# binding strength of an expression; a fraction needs no brackets in a product, but needs them as the base of a power
_SUM, _SIGNED, _PRODUCT, _FRACTION, _POWER, _ATOM = range(6)
_DIFFERENCE = re.compile(r"d([pTxVwm])")
_SPECIAL = re.compile(r"[&%#$_{}]")
_NUMBERED = re.compile(r"([A-Za-z]+?)([0-9]+)")


def equation_tex(equation: Equation, declared: Iterable[str] = ()) -> str:
    """An equation as `left &= right` for alignment; `own` are the names that the component declares."""
    names = _Names(frozenset(declared))
    return f"{names.of(equation.left)} &= {names.of(equation.right)}"


def formula_tex(expr: Expr, declared: Iterable[str] = ()) -> str:
    """An expression as TeX."""
    return _Names(frozenset(declared)).of(expr)


def symbol_tex(name: str) -> str:
    """A name as a letter with an index: `p_up` is p with index up, `l0` l with index 0, `dp_t` Delta p with index t."""
    letter, index = _letter_and_index(name)
    return f"{letter}_{{{index}}}" if index else letter


def text_tex(words: str) -> str:
    """Text inside a formula; special characters of TeX are escaped."""
    literal = _SPECIAL.sub(r"\\\g<0>", words)
    return rf"\text{{{literal}}}"


def _letter(word: str) -> str:
    if word in GREEK:
        return f"\\{word}"
    if difference := _DIFFERENCE.fullmatch(word):
        return rf"\Delta {difference.group(1)}"
    return word if len(word) == 1 else rf"\mathrm{{{word}}}"


class _Names:
    """Converts the formulas of one component."""

    def __init__(self, declared: frozenset[str]):
        self.declared = declared

    def of(self, expr: Expr, least: int = _SUM) -> str:
        """TeX of an expression, in brackets if it binds less strongly than `least`."""
        text, binds = self._written(expr)
        return text if binds >= least else rf"\left({text}\right)"

    def _written(self, expr: Expr) -> tuple[str, int]:
        if isinstance(expr, Number):
            return _number(expr.value)
        if isinstance(expr, Name):
            return self._name(expr), _ATOM
        if isinstance(expr, Negative):
            return f"-{self.of(expr.operand, _PRODUCT)}", _SIGNED
        if isinstance(expr, Binary):
            if expr.op in "+-":
                right, binds = self._written(expr.right)
                if binds == _SIGNED or (binds == _SUM and expr.op == "-"):
                    right = rf"\left({right}\right)"
                return f"{self.of(expr.left)} {expr.op} {right}", _SUM
            if expr.op == "/":
                return rf"\frac{{{self.of(expr.left)}}}{{{self.of(expr.right)}}}", _FRACTION
            if expr.op == "*":
                left, right = self.of(expr.left, _SIGNED), self.of(expr.right, _PRODUCT)
                dot = r" \cdot " if right[0].isdigit() else r" \, "
                return f"{left}{dot}{right}", _SIGNED if left.startswith("-") else _PRODUCT
            exponent = self.of(expr.right) if not isinstance(expr.right, Binary) else self._flat(expr.right)
            return f"{self.of(expr.left, _ATOM)}^{{{exponent}}}", _POWER
        if isinstance(expr, Call):
            return self._call(expr)
        if isinstance(expr, FunctionCall):
            output = rf"_{{{symbol_tex(expr.output)}}}" if len(expr.function.outputs) > 1 else ""
            return rf"{text_tex(expr.function.name)}{output}\left({', '.join(self.of(a) for a in expr.args)}\right)", _POWER
        if isinstance(expr, Compare):
            return f"{self.of(expr.left)} {_SIGNS[expr.op]} {self.of(expr.right)}", _SUM
        if isinstance(expr, Logic):
            return f"{self.of(expr.left)} {text_tex(f' {expr.op} ')} {self.of(expr.right)}", _SUM
        if isinstance(expr, Not):
            return rf"\text{{not }} {self.of(expr.operand, _ATOM)}", _SUM
        if isinstance(expr, Elements):
            rows = [item.items if isinstance(item, Elements) else (item,) for item in expr.items]
            lines = r" \\ ".join(" & ".join(self.of(e) for e in row) for row in rows)
            return rf"\begin{{pmatrix}} {lines} \end{{pmatrix}}", _ATOM
        if isinstance(expr, Slice):
            return rf"{self.of(expr.low)} \ldots {self.of(expr.high)}", _SUM
        return rf"\sum_{{{expr.index}={self.of(expr.low)}}}^{{{self.of(expr.high)}}} {self.of(expr.body, _PRODUCT)}", _SUM

    def _flat(self, expr: Binary) -> str:
        """Write an exponent on one line, a quotient with a slash."""
        if expr.op != "/":
            return self.of(expr)
        return f"{self.of(expr.left, _PRODUCT)}/{self.of(expr.right, _POWER)}"

    def _call(self, expr: Call) -> tuple[str, int]:
        args = [self.of(a) for a in expr.args]
        if expr.function == "der":
            of = expr.args[0]
            if not isinstance(of, Name) or (split := self._split(of)) is None:
                return rf"\frac{{\mathrm{{d}}}}{{\mathrm{{d}}t}}\left({self.of(of)}\right)", _FRACTION
            letter, index = split
            return rf"\dot{{{letter}}}" + (f"_{{{index}}}" if index else ""), _ATOM
        if expr.function == "sqrt":
            return rf"\sqrt{{{args[0]}}}", _ATOM
        if expr.function == "abs":
            return rf"\left\lvert {args[0]} \right\rvert", _ATOM
        if expr.function == "floor":
            return rf"\left\lfloor {args[0]} \right\rfloor", _ATOM
        if expr.function == "if_else":
            return (rf"\begin{{cases}} {args[1]} & \text{{if }} {args[0]} \\ "
                    rf"{args[2]} & \text{{otherwise}} \end{{cases}}", _SUM)
        if expr.function == "smooth_sign":
            return rf"\tanh\left(\frac{{{args[0]}}}{{{args[1]}}}\right)", _POWER
        if expr.function == "signed_sqrt":
            squares = " + ".join(f"{self.of(a, _ATOM)}^2" for a in expr.args)
            return rf"\frac{{{args[0]}}}{{\sqrt[4]{{{squares}}}}}", _FRACTION
        if expr.function in ("dot", "cross"):
            sign = r"\cdot" if expr.function == "dot" else r"\times"
            return f"{self.of(expr.args[0], _POWER)} {sign} {self.of(expr.args[1], _POWER)}", _PRODUCT
        if expr.function == "transpose":
            return rf"{self.of(expr.args[0], _ATOM)}^\mathsf{{T}}", _POWER
        if expr.function == "sum":  # over a list or an array of ports
            whole = isinstance(expr.args[0], Name) and all(isinstance(part, str) for part in expr.args[0].parts)
            return rf"\sum_i {self._name(expr.args[0], '_i')}" if whole and isinstance(expr.args[0], Name) else \
                rf"\sum \left({args[0]}\right)", _SUM
        return _WORDS[expr.function] + rf"\left({', '.join(args)}\right)", _POWER

    def _name(self, name: Name, indexed: str = "") -> str:
        split = self._split(name)
        if split is None:
            return text_tex(name.text)
        letter, index = split
        return f"{letter}_{{{index}{indexed}}}" if index or indexed else letter

    def _split(self, name: Name) -> tuple[str, str] | None:
        """The letter and the index of a name: `a.p` is p with index a, `p[i].q` is q with index p_i.

        None if the component declares another name with the same letter and index; the name is then written as in the file.
        """
        if name.text in ("time", "pi"):
            return ("t", "") if name.text == "time" else (r"\pi", "")
        words: list[str] = []
        for part in name.parts:
            if isinstance(part, str):
                words.append(part)
            elif words[-1].endswith("]"):
                words[-1] = f"{words[-1][:-1]},{self.of(part)}]"
            else:
                words[-1] += f"[{self.of(part)}]"
        if len(words) == 1:
            return _letter_and_index(words[0])
        port, member = words[0], words[-1]
        if f"{member}_{port}" in self.declared or len(words) > 2:
            return None
        letter, index = _letter_and_index(port)
        return _letter(member), f"{letter}_{{{index}}}" if index else letter


def _letter_and_index(word: str) -> tuple[str, str]:
    """Split a name into letter and index: `p_up` into p and up, `p[i]` into p and i."""
    name, bracket, indexed = word.partition("[")
    head, _, index = name.partition("_")
    if numbered := _NUMBERED.fullmatch(head):
        head, index = numbered.group(1), "_".join(part for part in (numbered.group(2), index) if part)
    parts = [(f"\\{part}" if part in GREEK else part if part.isdigit() else rf"\mathrm{{{part}}}")
             for part in index.split("_") if part]
    return _letter(head), ",".join([*parts, indexed[:-1]] if bracket else parts)


def _number(value: float) -> tuple[str, int]:
    mantissa, _, exponent = f"{value:.12g}".partition("e")
    if not exponent:
        return mantissa, _ATOM
    times = "" if mantissa == "1" else rf"{mantissa} \cdot "
    return f"{times}10^{{{int(exponent)}}}", _PRODUCT
