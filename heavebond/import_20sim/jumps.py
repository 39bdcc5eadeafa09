"""Values that a branch keeps when its assignment jumps at the instant at which the branch ends: the values before the
jump.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from heavebond.import_20sim import formula_text as f
from heavebond.import_20sim.branch_values import defined_everywhere
from heavebond.import_20sim.choices import names, rebuilt
from heavebond.import_20sim.component import Component, Event, Item
from heavebond.import_20sim.sidops_tree import Expr

AT_START = {"at": "0"}
WORDS = {"and", "or", "not", "abs"}
SHORT = 40  # characters of a value that is written out in each event


@dataclass(frozen=True)
class Kept:
    """A branch that assigns `value` while `condition` holds: the held variable with its last value, the variable that is
    1 while the branch assigns it, and the event that ends it."""

    name: str
    flag: str
    event: str
    condition: Expr
    value: Expr


def keep_values_before_jumps(component: Component, branches: list[Kept]) -> None:
    """If an event that may end a branch also changes the assigned value, let the branch keep the value before: the first
    event of an instant stores it, and the end of the branch at the same instant does not change it."""
    formulas = {left.name: right for left, right, _ in component.equations if left.op == "name"}
    held = {item.name for item in component.of_kind("held")}
    branch_names = {label for branch in branches for label in (branch.name, branch.flag)}
    for branch in branches:
        changed = (_reached(names(branch.value), formulas) & held) - branch_names
        ending = _setting(component, (_reached(names(branch.condition), formulas) & held) - branch_names,
                          formulas) if changed else []
        inputs = {n for event in ending for n in _reached(_words(event), formulas)} - held - set(formulas) - WORDS
        jumps = [e for e in component.events.values() if set(e.then) & changed and e.when != AT_START
                 and (any(e is end_event for end_event in ending) or inputs & _reached(_words(e), formulas))]
        if jumps:
            # let the first of several events at an instant store the value of a branch
            value = branch.value
            if len(f.text(value)) > SHORT and defined_everywhere(value,
                                                                 {item.name for item in component.of_kind("parameter")}):
                name = component.fresh(f"{branch.name.removesuffix('_kept')}_value")
                component.items[name] = Item(name, "variable", "", f"the value of the branch that {branch.name} keeps")
                component.equations = [(left, _replaced(right, value, f.name(name)), comment)
                                       for left, right, comment in component.equations]
                component.equations.append((f.name(name), value, ""))
                value = f.name(name)
            instant = f"{branch.name}_at"
            if instant not in component.items:
                # nothing is stored at the start
                component.hold(instant, "", f"when an event stored {branch.name}", f.number(0))
            later = Expr(">", (f.name("time"), f.name(instant)))
            end = component.events[branch.event].then
            end[branch.name] = Expr("if", (later, value, f.name(branch.name)))
            for event in jumps:
                assigned = Expr("and", (later, Expr("==", (f.name(branch.flag), f.number(1)))))
                event.then[branch.name] = Expr("if", (assigned, value, event.then.get(branch.name, f.name(branch.name))))
                event.then[instant] = f.name("time")


def _replaced(expr: Expr, old: Expr, new: Expr) -> Expr:
    return new if expr == old else rebuilt(expr, lambda e: _replaced(e, old, new)) if expr.args else expr


def _words(event: Event) -> list[str]:
    """The names in the condition of an event."""
    return [n for text in event.when.values() for n in re.findall(r"[A-Za-z_][A-Za-z0-9_]*", text)]


def _setting(component: Component, wanted: set[str], formulas: dict[str, Expr]) -> list[Event]:
    """The events that set some of these variables, or variables on which the conditions of these events depend."""
    events: list[Event] = []
    more = True
    while more:
        more = False
        for event in component.events.values():
            if set(event.then) & wanted and event.when != AT_START and not any(event is e for e in events):
                events.append(event)
                wanted, more = wanted | _reached(_words(event), formulas), True
    return events


def _reached(labels: Iterable[str], formulas: dict[str, Expr]) -> set[str]:
    """These names, and those in the equations of these variables."""
    waiting, visited = list(labels), set[str]()
    while waiting:
        name = waiting.pop()
        if name not in visited:
            visited.add(name)
            waiting += names(formulas[name]) if name in formulas else ()
    return visited
