"""Arrays in a diagram: vectors given to inputs, matrices given row by row in one list, and parts of arrays on wires."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import replace

from heavebond.language.definition import Component, FileInput, Value
from heavebond.language.sections import NamedOutput
from heavebond.text.expression import Expr, ExpressionProblem, Name, Number, Slice, parse_formula
from heavebond.text.shapes import whole_number


def by_elements(settings: Mapping[str, Value | FileInput], component: Component) -> dict[str, Value | FileInput]:
    """The values given to a part, by elements: a matrix in one list (`[1, 0, 0, 1]`) by rows and columns."""
    matrices = {name: p for name, p in component.parameters.items() if p.columns is not None and f"{name}[1]" in settings}
    expanded = dict(settings)
    for name in matrices:
        flat = [key for key in settings if key.startswith(f"{name}[") and "][" not in key]
        # the number of columns of a matrix given in one list: the specified number, else that of a square matrix
        parameter = component.parameters[name]
        known = {n: whole for n, p in component.parameters.items() if p.integer
                 and isinstance(value := settings.get(n, p.default), Value)
                 and (whole := whole_number(value.expr, {})) is not None}
        assert parameter.columns is not None
        specified = whole_number(parameter.columns, known)
        columns = specified if specified else round(len(flat)**0.5)
        if columns and len(flat) % columns == 0:
            for k, key in enumerate(flat):
                expanded[f"{name}[{k // columns + 1}][{k % columns + 1}]"] = expanded.pop(key)
    return expanded


def array_text(indices_in_array: Mapping[str, str]) -> str:
    """The size of an array in words."""
    last = list(indices_in_array)[-1].strip("[]").split("][")
    return f"an array of {last[0]}" if len(last) == 1 else f"a matrix of {last[0]} x {last[1]}"


def part_of(suffixes: list[str], inside: str, integers: Mapping[str, int]) -> dict[str, str] | None:
    """The elements of an array that `1..3`, of a matrix `2, 1..3` means: their indices from 1, and those in the array. An
    index beyond the array is kept; it is reported when the elements are compared with the array."""
    try:
        name = parse_formula(f"x[{inside.replace('][', ',')}]", units=False)
    except ExpressionProblem:
        return None
    ranges = []
    for part in name.parts[1:] if isinstance(name, Name) else ():
        if isinstance(part, str):
            return None
        low, high = ((part.low, part.high) if isinstance(part, Slice) else (part, part))
        ends = whole_number(low, integers), whole_number(high, integers)
        if ends[0] is None or ends[1] is None:
            return None
        ranges.append((range(ends[0], ends[1] + 1), isinstance(part, Slice)))
    elements: dict[tuple[int, ...], str] = {(): ""}
    for numbers, sliced in ranges:
        elements = {(*new, k) if sliced else new: f"{old}[{n}]" for new, old in elements.items() for k,
                    n in enumerate(numbers, 1)}
    return {"".join(f"[{k}]" for k in new): old for new, old in elements.items()}


def vector_outputs(show: Mapping[str, NamedOutput], part: Callable[[str], Component | None],
                   nodes: Callable[[], Container[str]]) -> dict[str, NamedOutput]:
    """Outputs, in which the name of a vector or matrix (`states: {is: filter.x}`) is replaced by its elements, `states[1]`.
    `part` gives the component at a path, `nodes` the paths of all nodes and of the ports on them."""
    outputs: dict[str, NamedOutput] = {}
    joined = nodes() if any(isinstance(output.expr, Name) for output in show.values()) else ()
    for name, output in show.items():
        elements = _elements_of(output.expr, part, joined)
        if elements is None:
            outputs[name] = output
            continue
        for index, expr in elements.items():
            outputs[name + index] = replace(output, name=name + index, expr=expr, text=expr.text)
    return outputs


def _elements_of(expr: Expr, part: Callable[[str], Component | None], nodes: Container[str]) -> dict[str, Name] | None:
    """The elements of the vector or matrix that a name refers to, by their indices; None for anything else."""
    if not isinstance(expr, Name):
        return None
    if any(isinstance(part, Slice) for part in expr.parts):
        # the elements of a part of a vector or matrix, counted from 1
        parts_by_indices: dict[tuple[int, ...], tuple[str | Expr, ...]] = {(): ()}
        for entry in expr.parts:
            if not isinstance(entry, Slice):
                parts_by_indices = {new: (*parts, entry) for new, parts in parts_by_indices.items()}
                continue
            low, high = whole_number(entry.low, {}), whole_number(entry.high, {})
            if low is None or high is None or high < low:
                return None
            parts_by_indices = {(*new, k): (*parts, Number(float(n), None, entry.column)) for new,
                                parts in parts_by_indices.items()
                                for k, n in enumerate(range(low, high + 1), 1)}
        return {"".join(f"[{k}]" for k in new): replace(expr, parts=parts) for new, parts in parts_by_indices.items()}
    if not all(isinstance(part, str) for part in expr.parts):
        return None
    owner, _, member = expr.text.rpartition(".")
    component = part(owner)
    declarations = {**component.parameters, **component.variables, **component.signals} if component is not None else {}
    indices = [name.removeprefix(member) for name in declarations if name.startswith(f"{member}[")]
    if indices:
        return {index: _with_index(expr, len(expr.parts), index) for index in indices}
    at = len(expr.parts)
    if f"{expr.text}[1]" not in nodes and f"{expr.text}[1][1]" not in nodes:
        at -= 1  # a member of a node of whole arrays: `bonds.e`
    path = ".".join(str(part) for part in expr.parts[:at])
    rows, elements = 0, dict[str, Name]()
    while path and (f"{path}[{rows + 1}]" in nodes or f"{path}[{rows + 1}][1]" in nodes):
        rows, columns = rows + 1, 0
        if f"{path}[{rows}]" in nodes:
            elements[f"[{rows}]"] = _with_index(expr, at, f"[{rows}]")
        while f"{path}[{rows}][{columns + 1}]" in nodes:
            columns += 1
            elements[f"[{rows}][{columns}]"] = _with_index(expr, at, f"[{rows}][{columns}]")
    return elements or None


def _with_index(name: Name, at: int, index: str) -> Name:
    """A name with an index behind its first parts."""
    numbers = [Number(float(k), None, name.column) for k in index.strip("[]").split("][")]
    return replace(name, parts=(*name.parts[:at], *numbers, *name.parts[at:]))


def shared(value: Value, name: str, element: str) -> Value:
    """A vector given to an input by its name (`u: =filter.y`), for one of its elements."""
    expr = value.expr
    if not isinstance(expr, Name) or any(isinstance(part, Slice) for part in expr.parts):
        return value
    numbers = [Number(float(k), None, expr.column) for k in element.removeprefix(name).strip("[]").split("][")]
    return replace(value, expr=replace(expr, parts=(*expr.parts, *numbers)))
