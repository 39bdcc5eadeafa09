"""Arrays: declarations with `count: n` are expanded to `x[1]` ... `x[n]` once the integer parameters are known, and with
`count: [n, m]` to `x[1][1]`, `x[1][2]` ... `x[n][m]`, row by row."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import TypeVar

from heavebond.language.definition import Component, Parameter, SignalPort, Variable
from heavebond.text.expression import Expr, Name
from heavebond.text.shapes import whole_number

Item = TypeVar("Item", Parameter, Variable, SignalPort)


def has_lists(component: Component) -> bool:
    """True if any of its parameters, variables or signals is a list."""
    return any(item.count is not None for group in (component.parameters, component.variables, component.signals)
               for item in group.values())


def written_out(component: Component, integers: Mapping[str, int]) -> Component:
    """Expand every list to single parameters, variables and signals; the same object for the same numbers."""
    return _written_out(Same(component), tuple(sorted(integers.items()))) if has_lists(component) else component


class Same:
    """A component by identity, as the key of a cache: the loader returns the same object for the same file."""

    def __init__(self, component: Component):
        self.component = component

    def __hash__(self) -> int:
        return id(self.component)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other.component is self.component


@lru_cache(maxsize=1024)
def _written_out(key: Same, integers: tuple[tuple[str, int], ...]) -> Component:
    known = dict(integers)
    return replace(key.component, parameters=_spread(key.component.parameters, known),
                   variables=_spread(key.component.variables, known), signals=_spread(key.component.signals, known))


def written_size(component: Component, integers: Mapping[str, int]) -> int:
    """Number of ports, parameters, variables and signals of a component with expanded lists."""
    def number(expr: Expr | None) -> int:
        return 1 if expr is None else max(0, whole_number(expr, integers) or 0)

    listed: list[Parameter | Variable | SignalPort] = [
        *component.parameters.values(), *component.variables.values(), *component.signals.values()]
    return sum(number(item.count) * number(item.columns) for item in listed) + \
        sum(number(port.count) for port in component.ports.values())


def _spread(items: Mapping[str, Item], known: Mapping[str, int]) -> dict[str, Item]:
    items_by_name: dict[str, Item] = {}
    for name, item in items.items():
        if item.count is None:
            items_by_name[name] = item
        else:
            items_by_name.update({f"{name}{index}": replace(item, name=f"{name}{index}", count=None, columns=None)
                          for index in indices(item.count, item.columns, lambda expr: whole_number(expr, known) or 0)})
    return items_by_name


def indices(count: Expr, columns: Expr | None, number: Callable[[Expr], int]) -> list[str]:
    """The indices of all elements of a list (`[1]`, `[2]`) or, row by row, of a matrix (`[1][1]`, `[1][2]`)."""
    rows = [f"[{i}]" for i in range(1, number(count) + 1)]
    return rows if columns is None else [f"{row}[{j}]" for row in rows for j in range(1, number(columns) + 1)]


def lengths(component: Component, is_given: Callable[[str], bool]) -> dict[str, int]:
    """Whole numbers that follow from the given lists: the length of the longest list that each of them counts."""
    counted: dict[str, int] = {}

    def tell(expr: Expr | None, before: str, behind: str) -> None:
        if not isinstance(expr, Name):
            return
        k = 0
        while is_given(f"{before}{k + 1}{behind}"):
            k += 1
        if k:
            counted[expr.text] = max(k, counted.get(expr.text, 0))

    items: list[Parameter | SignalPort] = [
        *component.parameters.values(), *(s for s in component.signals.values() if s.direction == "in")]
    for item in items:
        if item.columns is None:
            tell(item.count, f"{item.name}[", "]")
        else:
            tell(item.count, f"{item.name}[", "][1]")
            tell(item.columns, f"{item.name}[1][", "]")
    return counted


def short(names: Collection[str]) -> list[str]:
    """Names for a message, elements by their list: `x[2]` and `x[3]` are `x`."""
    return list(dict.fromkeys(name.partition("[")[0] for name in names))
