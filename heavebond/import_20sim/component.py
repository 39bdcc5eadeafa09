"""Intermediate form of a submodel in the import: a component or block as values, before it is written as text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from heavebond.import_20sim.choices import at_event
from heavebond.import_20sim.sidops_tree import Expr
from heavebond.import_20sim.tables import Grid, Table


@dataclass
class Item:
    """A port, parameter or variable of a component."""

    name: str
    kind: str  # bond, in, out, parameter, variable, held
    unit: str = ""
    doc: str = ""
    value: float | None = None
    out: bool = False  # for a bond: its flow is positive out of the submodel in 20-sim
    before: str = ""  # lines of comments before it


def without_unit(item: Item) -> None:
    """Write the unit into the description."""
    item.doc, item.unit = " ".join(filter(None, (item.doc, f"[{item.unit}]" if item.unit else ""))), ""


@dataclass
class Event:
    """An entry under `when:`: its instant ({"condition": ...}, {"at": ...} or {"every": ..., "from": ...}), and its
    assignments.
    """

    when: dict[str, str]
    then: dict[str, Expr]


Ends = list[tuple[list[str], bool]]  # the elements of each bond of a knot, and True if it points away


@dataclass
class Component:
    """A component made of equations. `initial` are conditions by variable, `first` the first values of held variables,
    `shared` the global quantities that it needs by their local name, `gives` the global quantities that it computes,
    `untranslated` lines with reasons, for which the whole component is a placeholder, `omitted` are omitted or
    ambiguous elements."""

    name: str
    summary: str
    line: int = 0
    items: dict[str, Item] = field(default_factory=dict)
    equations: list[tuple[Expr, Expr, str]] = field(default_factory=list)
    events: dict[str, Event] = field(default_factory=dict)
    initial: dict[str, Expr] = field(default_factory=dict)
    first: dict[str, Expr] = field(default_factory=dict)
    shared: dict[str, str] = field(default_factory=dict)
    gives: dict[str, str] = field(default_factory=dict)
    untranslated: list[tuple[int, str]] = field(default_factory=list)
    omitted: list[tuple[int, str]] = field(default_factory=list)
    elements: dict[str, list[str]] = field(default_factory=dict)  # names for each port of the submodel
    requires: list[Expr] = field(default_factory=list)  # conditions on parameters
    junction: tuple[Ends, tuple[str, ...]] | None = None  # for a 1-junction: its bonds, and the outputs that are its flow
    sampled_values: dict[str, str] = field(default_factory=dict)  # of plotted discrete variables, at the last sample
    delay: tuple[Expr, str, str] | None = None  # the last rounding of a quantity by another: its result and both names
    samples: bool = False  # it calls `sample`: a part of the discrete system, also if its value is that of its input
    tables: dict[str, Table | Grid] = field(default_factory=dict)  # lists by the beginnings of their names

    def of_kind(self, *kinds: str) -> list[Item]:
        return [item for item in self.items.values() if item.kind in kinds]

    def fresh(self, base: str) -> str:
        """A name that no item and no event has."""
        k, candidate = 1, base
        while candidate in self.items or candidate in self.events:
            k, candidate = k + 1, f"{base}_{k + 1}"
        return candidate

    def on(self, name: str, when: dict[str, str], then: Mapping[str, Expr]) -> str:
        """Set values at an instant by an event, whose name is returned: an existing event at the same instant, unless
        both set the same variable."""
        then = {name: at_event(value, None) for name, value in then.items()}
        for event_name, event in self.events.items():
            if event.when == when and not set(event.then) & set(then):
                event.then.update(then)
                return event_name
        event_name = self.fresh(name)
        self.events[event_name] = Event(when, dict(then))
        return event_name

    def hold(self, base: str, unit: str, doc: str, first: Expr) -> str:
        """A new held variable with its first value."""
        name = self.fresh(base)
        self.items[name] = Item(name, "held", unit, doc, 0.0)
        self.first[name] = first
        return name
