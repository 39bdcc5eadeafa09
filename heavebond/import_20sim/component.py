"""What the importer writes of a submodel: a component or block as values, before it becomes text."""

from __future__ import annotations

from dataclasses import dataclass, field

from heavebond.import_20sim.sidops_tree import Expr


@dataclass
class Item:
    """A port, parameter or variable of a component."""

    name: str
    kind: str  # bond, in, out, parameter, variable, held
    unit: str = ""
    doc: str = ""
    value: float | None = None


@dataclass
class Component:
    """A component made of equations. `initial` are conditions by variable, `events` (key, formula, what is set),
    `shared` the global quantities that it needs by
    their own name, `gives` those that it computes, `untranslated` lines with reasons, for which
    the whole component is a placeholder, `omitted` what is left out while all else is translated."""

    name: str
    summary: str
    line: int = 0
    items: dict[str, Item] = field(default_factory=dict)
    equations: list[tuple[Expr, Expr, str]] = field(default_factory=list)
    events: dict[str, tuple[str, str, dict[str, Expr]]] = field(default_factory=dict)
    initial: dict[str, Expr] = field(default_factory=dict)
    shared: dict[str, str] = field(default_factory=dict)
    gives: dict[str, str] = field(default_factory=dict)
    untranslated: list[tuple[int, str]] = field(default_factory=list)
    omitted: list[tuple[int, str]] = field(default_factory=list)

    def of_kind(self, *kinds: str) -> list[Item]:
        return [item for item in self.items.values() if item.kind in kinds]
