"""Ends of connections that form one node, and submodels that are only such nodes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.component import Component


class Nets:
    """Ends of connections that form one node."""

    def __init__(self) -> None:
        self.parent: dict[str, str] = {}

    def find(self, end: str) -> str:
        self.parent.setdefault(end, end)
        while self.parent[end] != end:
            self.parent[end] = self.parent[self.parent[end]]
            end = self.parent[end]
        return end

    def join(self, a: str, b: str) -> None:
        self.parent[self.find(b)] = self.find(a)

    def groups(self) -> list[list[str]]:
        groups: dict[str, list[str]] = {}
        for end in self.parent:
            groups.setdefault(self.find(end), []).append(end)
        return list(groups.values())


def passing(made: Component, equations: Iterable[tuple[str, str]], nets: Nets) -> None:
    """Give a component the equations of a submodel without parts, whose ports are connected to each other: signals are
    equal, and bonds have one effort and flows whose sum is 0. `equations` are the known equations between its signals."""
    made.equations = [(f.name(left), f.number(0) if right == "0" else f.name(right), "") for left, right in equations]
    given = {left.name for left, *_ in made.equations}
    for group in nets.groups():
        for own in zip(*(made.elements[e] for e in group if e in made.elements), strict=False):
            inputs, outputs, bonds = ([e for e in own if made.items[e].kind == kind] for kind in ("in", "out", "bond"))
            made.equations += [(f.name(e), f.name(inputs[0]), "") for e in outputs if inputs and e not in given]
            made.equations += [(f.name(f"{e}.e"), f.name(f"{bonds[0]}.e"), "") for e in bonds[1:]]
            if bonds:
                made.equations.append((reduce(f.add, (f.name(f"{e}.f") for e in bonds)), f.number(0), ""))
