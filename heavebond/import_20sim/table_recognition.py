"""Recognition of tables in imported submodels: from a file, or from a matrix of points that their statements search."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from heavebond.import_20sim.component import Component
from heavebond.import_20sim.evaluate import fold
from heavebond.import_20sim.match import Match
from heavebond.import_20sim.tables import Table

BETWEEN = (0.0, 0.25, 0.7)  # shares of an interval at which both must agree
SAME = 1e-9  # relative to the range of the values


def table_match(component: Component) -> Match | None:
    """A component that is only a table of its inputs or of the time."""
    if component.events or component.untranslated or component.gives or len(component.of_kind("out")) != 1 \
            or component.of_kind("bond", "held") or component.initial:
        return None
    if [len(table) for table in component.tables.values()] == [3]:
        return _of_grid(component)
    if len(component.of_kind("in")) > 1:
        return None
    if not component.tables:
        return _of_matrix(component)
    if len(component.equations) != 1 or len(component.items) > 2:
        return None
    left, right, _ = component.equations[0]
    if right.op != "table" or left.op != "name" or component.items[left.name].kind != "out" or right.args[0].op != "name":
        return None
    input_name = right.args[0].name
    if input_name == "time" and len(component.items) == 1:
        return _match(component, "time")
    return _match(component,
                  input_name) if input_name in component.items and component.items[input_name].kind == "in" else None


def _of_grid(component: Component) -> Match | None:
    """A component whose output is a table of its two inputs."""
    formulas = {left.name: right for left, right, _ in component.equations if left.op == "name"}
    inputs, output = [item.name for item in component.of_kind("in")], component.of_kind("out")[0].name
    value, input_names = formulas.get(output), []
    if value is None or value.op != "table2" or component.shared:
        return None
    for e in value.args:
        while e.op == "name" and e.name in formulas:
            e = formulas[e.name]
        input_names.append(e.name if e.op == "name" else "")
    if sorted(input_names) != sorted(inputs) or len(set(input_names)) != 2:
        return None
    return Match("Lookup2", {output: "y", input_names[0]: "u_1", input_names[1]: "u_2"}, {}, {}, {},
                 lists={"x": "x_1", "y": "x_2", "v": "v"})


def _match(component: Component, given: str) -> Match:
    output = component.of_kind("out")[0].name
    if given == "time":
        return Match("TableSource", {output: "y"}, {}, {}, {}, lists={"x": "t", "v": "v"})
    steps = any(a == b for table in component.tables.values() for a, b in pairwise(table[0]))
    return Match("StepLookup" if steps else "Lookup", {output: "y", given: "u"}, {}, {}, {}, lists={"x": "x", "v": "v"})


def _of_matrix(made: Component) -> Match | None:
    """A component whose only parameters are a matrix of points (x, y) in rows, with an output that is linear between them
    and constant outside; these points become its table."""
    values = {item.name: item.value for item in made.of_kind("parameter")}
    entries = {(m[1], int(m[2]), int(m[3])): v for n, v in values.items() if (m := re.fullmatch(r"(.*)_([0-9]+)_([12])", n))
               and v is not None}
    rows, bases = len(entries) // 2, {base for base, *_ in entries}
    if len(bases) != 1 or rows < 2 or len(entries) != len(values):
        return None
    (base,) = bases
    points = [[entries.get((base, i + 1, k), np.nan) for i in range(rows)] for k in (1, 2)]
    x, y = np.array(points)
    if not np.all(np.diff(x) > 0) or not np.all(np.isfinite(y)):
        return None
    known = {name: value for name, value in values.items() if value is not None}
    input_name = made.of_kind("in")[0].name if made.of_kind("in") else "time"
    steps = np.diff(x, append=2 * x[-1] - x[-2])
    tried = [x[0] - steps[0], *(x[i] + share * steps[i] for i in range(rows) for share in BETWEEN)]
    near = SAME * (np.ptp(y) or 1.0)
    if any(not _agrees(made, {**known, input_name: float(u)}, float(np.interp(u, x, y)), near) for u in tried):
        return None
    table: Table = (tuple(points[0]), tuple(points[1]))
    made.tables = {base: table}
    return _match(made, input_name)


def _agrees(component: Component, known: Mapping[str, float], expected: float, tolerance: float) -> bool:
    """True if the output has the expected value, computed from the known quantities."""
    at, output = dict(known), component.of_kind("out")[0].name
    known_values = [(a.name, b) for a, b, _ in component.equations if a.op == "name"]
    while output not in at:
        new = {name: value for name, formula in known_values if name not in at and (value := fold(formula, at)) is not None}
        if not new:
            return False
        at |= new
    return abs(at[output] - expected) <= tolerance
