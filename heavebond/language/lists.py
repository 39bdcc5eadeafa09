"""Arrays: a parameter or variable with `count: n` is expanded to `x[1]` ... `x[n]` once the integer parameters are known."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import lru_cache
from math import isfinite
from typing import TypeVar

from heavebond.language.definition import Component, Parameter, Variable
from heavebond.text.expression import Binary, Expr, Name, constant

Item = TypeVar("Item", Parameter, Variable)


def whole_number(expr: Expr, known: Mapping[str, int]) -> int | None:
    """The value of an expression of whole numbers and known names, or None."""
    if isinstance(expr, Name):
        return known.get(expr.text)
    number = constant(expr)
    if number is not None:
        return int(number) if isfinite(number) and number == int(number) else None
    if not isinstance(expr, Binary):
        return None
    a, b = whole_number(expr.left, known), whole_number(expr.right, known)
    if a is None or b is None:
        return None
    return {"+": a + b, "-": a - b, "*": a * b}.get(expr.op)


def has_lists(component: Component) -> bool:
    """Whether any of its parameters or variables is a list."""
    return any(item.count is not None for group in (component.parameters, component.variables) for item in group.values())


def written_out(component: Component, integers: Mapping[str, int]) -> Component:
    """The component with every list as single parameters and variables; the same object for the same numbers."""
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
                   variables=_spread(key.component.variables, known))


def _spread(items: Mapping[str, Item], known: Mapping[str, int]) -> dict[str, Item]:
    found: dict[str, Item] = {}
    for name, item in items.items():
        if item.count is None:
            found[name] = item
        else:
            found.update({f"{name}[{k}]": replace(item, name=f"{name}[{k}]", count=None)
                          for k in range(1, (whole_number(item.count, known) or 0) + 1)})
    return found


def lengths(component: Component, given: Callable[[str], bool]) -> dict[str, int]:
    """Whole numbers that the lists which were given tell: the length of the longest that is counted by each."""
    found: dict[str, int] = {}
    for name, parameter in component.parameters.items():
        if isinstance(parameter.count, Name):
            k = 0
            while given(f"{name}[{k + 1}]"):
                k += 1
            if k:
                found[parameter.count.text] = max(k, found.get(parameter.count.text, 0))
    return found


def short(names: Collection[str]) -> list[str]:
    """Names for a message, elements by their list: `x[2]` and `x[3]` are `x`."""
    return list(dict.fromkeys(name.partition("[")[0] for name in names))
