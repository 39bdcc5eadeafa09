"""A diagram as plain data, read with all that it extends and written again, with names and formulas that can be changed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from heavebond.core.units import UnitProblem, parse_quantity
from heavebond.language.model import beside
from heavebond.text.expression import Expr, ExpressionProblem, Name, Number, children, parse_formula
from heavebond.text.yaml_source import Mapping, Node, Scalar, read

Entry = dict[str, Any]
HEAD = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class Sheet:
    """The sections of a diagram, each value as text; `parts` by name with `is` and settings, `nodes` with their ends;
    `files` are component files that it needs beside those of its folder."""

    folder: Path
    parameters: dict[str, Any] = field(default_factory=dict)
    parts: dict[str, Entry] = field(default_factory=dict)
    nodes: dict[str, list[str]] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    initial: dict[str, Any] = field(default_factory=dict)
    show: dict[str, Entry] = field(default_factory=dict)
    simulate: dict[str, str] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """The YAML file; flow style, every text in quotes."""
        sections: dict[str, str | dict[str, Any]] = {
            "model": "sheet", "parameters": self.parameters, "components": self.parts, "nodes": self.nodes,
            "set": self.settings, "initial": self.initial, "show": self.show, "simulate": self.simulate}
        lines = []
        for name, section in sections.items():
            if isinstance(section, str):
                lines.append(f"{name}: {section}")
            elif section:
                lines += [f"{name}:", *(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in section.items())]
        return "\n".join([*lines, ""])


def sheet(path: Path) -> Sheet:
    """A diagram that can be read as a sheet; what it extends is written out. What is only seen (`view`) is left out."""
    root = _plain(read(path).root)
    base = sheet(beside(path.parent, root["extends"])) if "extends" in root else Sheet(path.parent)
    parts = {**base.parts, **root.get("components", {})}
    nodes = {name: list(ends) for name, ends in base.nodes.items()}
    for name, ends in root.get("nodes", {}).items():
        for end in [ends] if isinstance(ends, str) else ends:
            now = nodes.setdefault(name, [])
            if end.startswith("-"):
                now.remove(end[1:])
            else:
                now.append(end.removeprefix("+") if "." not in name else end)
    gone = root.get("remove", [])
    for name in [gone] if isinstance(gone, str) else gone:
        del parts[name]
        nodes = {n: [e for e in ends if e.split(".")[0] != name] for n, ends in nodes.items()}
    solve = root.get("initial", {}).get("solve", base.initial.get("solve"))
    initial = {**base.initial, **root.get("initial", {}), **({"solve": solve} if solve else {})}
    return replace(
        base, folder=path.parent, parameters={**base.parameters, **root.get("parameters", {})}, parts=parts,
        nodes={n: ends for n, ends in nodes.items() if ends}, initial=initial,
        settings={**base.settings, **root.get("set", {})}, show={**base.show, **root.get("show", {})},
        simulate={**base.simulate, **root.get("simulate", {})})


def _plain(node: Node) -> Any:
    if isinstance(node, Scalar):
        return node.text
    if isinstance(node, Mapping):
        return {key: _plain(item) for key, item in node.items.items()}
    return [_plain(item) for item in node.items]


# -- formulas ----------------------------------------------------------------------------------------------------------
def walk(expr: Expr) -> Iterator[Expr]:
    """An expression and all in it."""
    yield expr
    for child in children(expr):
        yield from walk(child)


def renamed(formula: str, new: Callable[[str], str]) -> str:
    """A formula with each name in it (`spring.F`) replaced; without a change where it cannot be read."""
    lead = len(formula) - len(formula.lstrip("=~ "))
    try:
        tree = parse_formula(formula[lead:])
    except ExpressionProblem:
        return formula
    found = sorted({(n.column, n.length) for n in walk(tree) if isinstance(n, Name)}, reverse=True)
    for column, length in found:
        k = lead + column
        formula = formula[:k] + new(formula[k:k + length]) + formula[k + length:]
    return formula


def names_in(formula: str) -> list[str]:
    """The names that a formula holds, as they are written."""
    found: list[str] = []

    def keep(name: str) -> str:
        found.append(name)
        return name

    renamed(formula, keep)
    return found


def quantities(formula: str, new: Callable[[float, str], str]) -> str:
    """A formula or a quantity with each number that has a unit written anew, of its SI value and its unit."""
    lead = len(formula) - len(formula.lstrip("=~ "))
    try:
        if "=" not in formula[:lead]:  # a quantity may have a sign of its own, as -5 degC
            value, unit = parse_quantity(formula[lead:])
            return formula if unit is None else formula[:lead] + new(value, unit.text)
    except UnitProblem:
        pass
    try:
        tree = parse_formula(formula[lead:])
    except ExpressionProblem:
        return formula
    numbers = [(n.column, n.value, n.unit.text) for n in walk(tree) if isinstance(n, Number) and n.unit is not None]
    for column, number, unit_text in sorted(numbers, reverse=True):
        k = lead + column
        written = re.match(r"[0-9.]+(?:[eE][+-]?[0-9]+)? *" + re.escape(unit_text), formula[k:])
        if written:
            formula = formula[:k] + new(number, unit_text) + formula[k + written.end():]
    return formula


def over_values(given: Sheet, name: Callable[[str], str], value: Callable[[str], str]) -> Sheet:
    """A sheet with `name` applied to all that names something (formulas as keys, ends, paths), `value` to all values."""
    def deep(item: Any) -> Any:
        if isinstance(item, dict):
            return item if "file" in item else {k: deep(v) for k, v in item.items()}
        return [deep(v) for v in item] if isinstance(item, list) else value(item)

    def part(entry: Entry) -> Entry:
        return {k: v if k in ("is", "at") else deep(v) for k, v in entry.items()}

    def shown(key: str, entry: Entry) -> Entry:
        return {**entry, "is": value(entry.get("is", key))}

    initial = {key: [name(n) for n in ([item] if isinstance(item, str) else item)] if key == "solve" else
               item if key == "start" else deep(item) for key, item in given.initial.items()}
    return replace(
        given, parameters={name(k): deep(v) for k, v in given.parameters.items()},
        parts={name(k): part(v) for k, v in given.parts.items()},
        nodes={name(k): [name(e) for e in ends] for k, ends in given.nodes.items()},
        settings={name(k): deep(v) for k, v in given.settings.items()},
        initial={k if k in ("start", "solve") else name(k): v for k, v in initial.items()},
        show={k: shown(k, v) for k, v in given.show.items()})
