"""The base model of a case from its JSON, as functions of numbers or arrays; needs numpy only.

Expressions are read as text in a small grammar (numbers, names with dots, + - * / **, comparisons, the functions of
FUNCTIONS) and evaluated step by step; nothing in a file is executed. With `functions` of another library (JAX) the same
equations can be traced and differentiated.
"""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = dict[str, Any]
Evaluated = Callable[[Values], Any]
# A number alone is evaluated by `math`, which is several times as fast as numpy.
FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "min": min, "max": max, "abs": abs, "where": lambda c, a, b: a if c else b, "both": lambda a, b: bool(a) and bool(b),
    "either": lambda a, b: bool(a) or bool(b), "sign": lambda v: float((v > 0) - (v < 0)),
    **{name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh",
                                              "cosh", "tanh", "log1p", "expm1", "floor", "atan2", "hypot", "copysign")}}
OPERATORS: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b, ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a ** b, ast.Lt: lambda a, b: a < b, ast.LtE: lambda a, b: a <= b, ast.Eq: lambda a, b: a == b,
    ast.NotEq: lambda a, b: a != b}


def parsed(text: str, functions: Mapping[str, Callable[..., Any]] = FUNCTIONS) -> Evaluated:
    """An expression as a function of the values of its names; ValueError for anything outside of the grammar."""
    def of(node: ast.expr) -> Evaluated:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            value = float(node.value) if abs(node.value) > 64 or node.value != int(node.value) else node.value
            return lambda _: value
        if isinstance(node, ast.Name | ast.Attribute | ast.Subscript) or (
                isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "der"):
            name = ast.unparse(node)
            return lambda values: values[name]
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            inner = of(node.operand)
            return lambda values: -inner(values)
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            act, left, right = OPERATORS[type(node.op)], of(node.left), of(node.right)
            return lambda values: act(left(values), right(values))
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in OPERATORS:
            act, left, right = OPERATORS[type(node.ops[0])], of(node.left), of(node.comparators[0])
            return lambda values: act(left(values), right(values))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in functions:
            function, inner_values = functions[node.func.id], [of(argument) for argument in node.args]
            return lambda values: function(*(inner_value(values) for inner_value in inner_values))
        raise ValueError(f"'{ast.unparse(node)}' is no expression of the format")

    return of(ast.parse(text, mode="eval").body)


@dataclass(frozen=True)
class Record:
    """A record in SI: its times (N,) in s, inputs and measured outputs (N,) by name (none of a scored record)."""

    name: str
    use: str
    time: Array
    inputs: Mapping[str, Array]
    outputs: Mapping[str, Array]


@dataclass(frozen=True)
class Case:
    """A case: its folder, and the content of `case.json` (see README.md)."""

    folder: Path
    content: Mapping[str, Any]

    @property
    def name(self) -> str:
        """The name of the case."""
        return self.folder.name

    @property
    def outputs(self) -> Mapping[str, Mapping[str, Any]]:
        """The channels by name, with unit, scale to SI and noise (SI)."""
        channels: Mapping[str, Mapping[str, Any]] = self.content["outputs"]
        return channels

    @cached_property
    def records(self) -> dict[str, Record]:
        """The records by name, in SI."""
        found = {}
        for name, entry in self.content["records"].items():
            table = pd.read_csv(self.folder / entry["file"])

            def in_si(channels: Mapping[str, Mapping[str, Any]], table: pd.DataFrame = table) -> dict[str, Array]:
                return {key: table[c["column"]].to_numpy(float) * c["scale"] + c["offset"] for key, c in channels.items()
                        if c["column"] in table}

            found[name] = Record(name, entry["use"], table[self.content["time"]].to_numpy(float),
                                 in_si(self.content["inputs"]), in_si(self.outputs))
        return found

    @property
    def places(self) -> Sequence[Mapping[str, Any]]:
        """The places of the diagram at which a law may be missing."""
        found: Sequence[Mapping[str, Any]] = self.content["model"]["places"]
        return found


def case_at(folder: Path) -> Case:
    """The case in a folder."""
    return Case(folder, json.loads((folder / "case.json").read_text(encoding="utf-8")))


class System:
    """The base model of a case: `derivatives`, `outputs` and `signals` of values by name (states, parameters, inputs, and
    `w.NODE` for what enters a node, in SI)."""

    def __init__(self, case: Case, functions: Mapping[str, Callable[..., Any]] = FUNCTIONS):
        model = case.content["model"]
        equations = model["equations"]
        if equations["residual"]:
            raise ValueError(f"{case.name}: the model has algebraic variables that are not solved for")
        self.states = [state["name"] for state in model["states"]]
        self.start = np.array([state["start"] for state in model["states"]])
        self.parameters = {name: entry["value"] for name, entry in model["parameters"].items()}
        self.free = {name: (entry["low"], entry["high"]) for name, entry in model["parameters"].items() if "low" in entry}
        self.nodes = sorted({node for place in model["places"] for node in place["enters"]})
        self.intermediate = [(name, parsed(text, functions)) for name, text in equations["intermediate"].items()]
        self._der = [parsed(equations["der"][name], functions) for name in self.states]
        self._outputs = {name: parsed(text, functions) for name, text in equations["outputs"].items()}
        self._signals = {name: parsed(text, functions) for name, text in equations["signals"].items()}

    def known(self, values: Values) -> Values:
        """The values with all intermediate ones; what enters a node is zero if it is not among them."""
        whole = {**dict.fromkeys(self.nodes, 0.0), **values}
        for name, evaluate in self.intermediate:
            whole[name] = evaluate(whole)
        return whole

    def derivatives(self, values: Values) -> list[Any]:
        """The rates of the states."""
        whole = self.known(values)
        return [evaluate(whole) for evaluate in self._der]

    def outputs(self, values: Values) -> dict[str, Any]:
        """The channels."""
        whole = self.known(values)
        return {name: evaluate(whole) for name, evaluate in self._outputs.items()}

    def signals(self, values: Values) -> dict[str, Any]:
        """Across variables and positions of the nodes."""
        whole = self.known(values)
        return {name: evaluate(whole) for name, evaluate in self._signals.items()}
