"""Recognition of linear systems in imported submodels, `ddt (x) = A * x + B * u; y = C * x + D * u`, in the form of the
editor.
"""

from __future__ import annotations

import re
from collections.abc import Collection

import numpy as np

from heavebond.import_20sim.component import Component
from heavebond.import_20sim.evaluate import fold
from heavebond.import_20sim.match import Match

MATRIX = re.compile(r"[ABCD](_[0-9]+){0,2}")
SAME = 1e-9  # tolerance relative to the largest value, with which the coefficients must reproduce another point


def linear_match(component: Component, joined: Collection[str]) -> Match | None:
    """The `LinearSystem` of the library for a component whose parameters are matrices A, B, C, D and whose rates and outputs
    are linear in its states and inputs, with its matrices. All inputs must be connected."""
    values = {item.name: item.value for item in component.of_kind("parameter")}
    inputs, outputs = [i.name for i in component.of_kind("in")], [i.name for i in component.of_kind("out")]
    states = [i.name for i in component.of_kind("variable")]
    rates = {left.args[0].name: right for left, right, _ in component.equations if left.op == "call" and left.name == "der"}
    others = {left.name: right for left, right, _ in component.equations if left.op == "name"}
    if component.events or component.untranslated or component.shared or component.gives \
            or component.tables or component.of_kind("bond", "held"):
        return None
    if not all(map(MATRIX.fullmatch, values)) or None in values.values() or not (states and inputs and outputs):
        return None
    if set(rates) != set(states) or set(others) != set(outputs) or not set(inputs) <= set(joined):
        return None
    rows, columns = [*(rates[x] for x in states), *(others[y] for y in outputs)], [*states, *inputs]
    known = {name: value for name, value in values.items() if value is not None}

    def at(point: np.ndarray) -> np.ndarray | None:
        folded = [fold(e, {**known, **dict(zip(columns, map(float, point), strict=True))}) for e in rows]
        return None if None in folded else np.array(folded, dtype=float)

    offset, units = at(np.zeros(len(columns))), [at(p) for p in np.eye(len(columns))]
    second_point = np.random.default_rng(0).uniform(-1, 1, len(columns))
    value_there = at(second_point)
    if offset is None or offset.any() or value_there is None or any(c is None for c in units):
        return None
    whole = np.array(units).T
    if not np.allclose(whole @ second_point, value_there, rtol=SAME, atol=SAME * np.abs(whole).max(initial=0.0)):
        return None
    first = {name: fold(value, known) for name, value in component.initial.items()}
    if None in first.values():
        return None
    n = len(states)
    parts = {"A": whole[:n, :n], "B": whole[:n, n:], "C": whole[n:, :n], "D": whole[n:, n:]}
    matrices = {name: m.tolist() for name, m in parts.items() if name != "D" or m.any()}
    ports = {name: f"{kind}[{k + 1}]" for kind, group in (("u", inputs), ("y", outputs)) for k, name in enumerate(group)}
    begins = {f"x[{k + 1}]": first.get(x) or 0.0 for k, x in enumerate(states)}
    return Match("LinearSystem", ports, {}, {}, {"A": "1/s", "B": "1/s", "C": "", "D": "", **dict.fromkeys(begins, "")},
                 begins, matrices=matrices)
