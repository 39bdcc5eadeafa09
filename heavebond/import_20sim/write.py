"""Diagrams, blocks and components of an imported model as readable YAML."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.block import Block, Part
from heavebond.import_20sim.choices import names
from heavebond.import_20sim.component import Component, Item
from heavebond.import_20sim.sidops_tree import Expr

WIDTH = 125  # characters of a line


def scalar(text: str) -> str:
    """A plain scalar of YAML, in quotes if necessary; control characters become spaces."""
    plain = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    if re.fullmatch(r"[A-Za-z0-9_(=.-][\w ().*/+=-]*", plain, re.ASCII) and not plain.endswith(" ") and " #" not in plain:
        return plain
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'


def quantity(value: float, unit: str) -> str:
    number = f"{value:.0f}" if value == int(value) and abs(value) < 1e6 else f"{value!r}"
    return f"{number} {unit}" if unit else number


def mapping(entries: Iterable[tuple[str, str]]) -> str:
    """`{a: 1, b: 2}` of texts that are scalars already."""
    return "{" + ", ".join(f"{key}: {value}" for key, value in entries) + "}"


def _ports(items: Iterable[Item]) -> list[str]:
    lines = []
    for item in items:
        doc = " ".join(filter(None, (item.doc, f"[{item.unit}]" if item.unit else "")))
        if item.kind == "bond":
            lines.append(f"  {item.name}: " + (mapping([("domain", "bond"), ("doc", scalar(doc))]) if doc else "bond"))
        elif item.kind in ("in", "out"):
            entries = [("signal", item.kind), ("unit", "1"), *([("doc", scalar(doc))] if doc else [])]
            lines.append(f"  {item.name}: {mapping(entries)}")
    return ["ports:", *lines] if lines else []


def _declared(component: Component, defaults: bool) -> list[str]:
    lines = []
    for title, kinds in (("parameters", ("parameter",)), ("variables", ("variable", "held"))):
        items = component.of_kind(*kinds)
        tables = component.tables if title == "parameters" else {}
        if items or tables:
            lines.append(f"{title}:")
        for name, table in tables.items():
            if len(table) == 3:
                lines += [f"  {name}_n: {{integer, min: 2, doc: rows of the table {name}}}",
                          f"  {name}_m: {{integer, min: 2, doc: columns of the table {name}}}",
                          f"  {name}_x: {{unit: 1, count: {name}_n, doc: inputs of the rows}}",
                          f"  {name}_y: {{unit: 1, count: {name}_m, doc: inputs of the columns}}",
                          f"  {name}_v: {{unit: 1, count: {name}_n*{name}_m, doc: values row by row}}"]
                continue
            lines += [f"  {name}_n: {{integer, min: 2, doc: points of the table {name}}}",
                      f"  {name}_x: {{unit: 1, count: {name}_n, doc: inputs of the points}}",
                      f"  {name}_v: {{unit: 1, count: {name}_n, doc: values at the points}}"]
        for item in items:
            lines += [f"  # {remark(text)}" for text in item.before.splitlines()]
            entries = [("unit", item.unit or "1")]
            if item.kind == "held":
                entries.append(("held", quantity(item.value or 0.0, item.unit)))
            if item.kind == "parameter" and item.value is not None and defaults:
                entries.append(("default", quantity(item.value, item.unit)))
            if item.doc:
                entries.append(("doc", scalar(item.doc)))
            lines.append(f"  {item.name}: {mapping(entries)}")
    return lines


def component_text(component: Component, name: str, defaults: bool = True) -> str:
    """The file of a component made of equations; without `defaults`, the common text of all parts of its kind."""
    lines = [f"component: {name}", f"summary: {scalar(component.summary)}"]
    if component.untranslated:
        lines.append(f"placeholder: {scalar('; '.join(f'line {k}: {w}' for k, w in component.untranslated))}")
    if component.omitted:
        lines.append(f"restrictions: {scalar('; '.join(w for _, w in component.omitted))}")
    lines += ["units: unchecked", *_ports(component.items.values()), *_declared(component, defaults)]
    if required := [r for r in component.requires if set(names(r)) <= set(component.items)]:
        lines.append(f"requires: [{', '.join(scalar_formula(f.text(r)) for r in required)}]")
    if component.equations:
        lines.append("equations: |")
        width = max((len(f.text(left)) for left, *_ in component.equations if len(f.text(left)) < 16), default=0)
        for left, right, comment in component.equations:
            *before, beside = comment.split("\n")
            lines += [f"  # {remark(text)}" for text in before]
            comment_text = f"   # {remark(beside)}" if beside else ""
            assert isinstance(right, Expr)
            lines.append(f"  {f.text(left):<{width}} = {f.value_text(right)}{comment_text}")
    if component.events:
        lines.append("when:")
        for name_of, event in component.events.items():
            # an event on one line, or on several if it is long
            instant = [(key, scalar_formula(formula)) for key, formula in event.when.items()]
            values = [(n, scalar_formula(f.value_text(v))) for n, v in event.then.items()]
            line = f"  {name_of}: {mapping([*instant, ('then', mapping(values))])}"
            lines += [line] if len(line) <= WIDTH else [
                f"  {name_of}:", *(f"    {key}: {formula}" for key, formula in instant), "    then:",
                *(f"      {key}: {formula}" for key, formula in values)]
    if any(item.kind == "bond" for item in component.items.values()):
        lines.append('power: "controlled, imported equations whose power balance is not checked"')
    return "\n".join(lines) + "\n"


def remark(text: str) -> str:
    """The text of a comment: printable, on one line."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def numbers(values: Iterable[float], unit: str = "") -> str:
    """A list of numbers with their unit."""
    return f"[{', '.join(quantity(v, unit) for v in values)}]"


def scalar_formula(text: str) -> str:
    return f'"{text}"'


def _place(pixels: float) -> str:
    """A coordinate of the drawing, to a tenth of its unit of 40 pixels."""
    return f"{round(pixels / 40, 1) + 0.0:g}"


def parts_text(block: Block, names: Mapping[int, str], values: Mapping[int, Iterable[tuple[str, str]]], x: float, y: float
               ) -> list[str]:
    """`components:` and `nodes:` of a block or diagram."""
    lines = ["components:"]
    width = max((len(p.name) for p in block.parts.values()), default=0) + 1
    for part in block.parts.values():
        entries = [("is", names[id(part.content)]), *values.get(id(part.content), ()),
                   *((n, v) for n, v in part.inputs.items()),
                   ("at", f"[{_place(part.x - x)}, {_place(y - part.y)}]")]
        lines.append(f"  {part.name + ':':<{width}} {mapping(entries)}")
    if block.nodes:
        lines.append("nodes:")
        lines += [f"  {name}: [{', '.join(scalar(end) for end in ends)}]" for name, ends in block.nodes.items()]
    return lines


def block_text(block: Block, name: str, parts: list[str]) -> str:
    """The file of a block."""
    lines = [f"component: {name}", f"summary: {scalar(block.summary)}", *_ports(block.items.values()), *parts]
    if block.equations:
        lines += ["equations: |", *(f"  {left} = {right}" for left, right in block.equations)]
    return "\n".join(lines) + "\n"


__all__ = ["Part", "block_text", "component_text", "mapping", "parts_text", "quantity", "scalar", "scalar_formula"]
