"""The held variables and the events of an expanded diagram, each with its provenance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import casadi as ca

from heavebond.core.errors import Place, Problems, listing, suggest
from heavebond.core.units import Unit
from heavebond.equations.expanded import Expanded, Leaf
from heavebond.equations.parameters import FlatParameter, Parameters
from heavebond.language.definition import ChartState
from heavebond.language.incidence import Interval
from heavebond.language.sections import Clock, Condition
from heavebond.language.state_chart import STATE
from heavebond.language.template import Template, held_interval
from heavebond.text.expression import Name, constant


@dataclass(frozen=True)
class Held:
    """A variable that is constant between events: the entry `index` of the parameters, which events change; at the start
    it is the parameter `initial.NAME`."""

    name: str
    index: int
    unit: Unit
    place: Place
    doc: str = ""


@dataclass(frozen=True)
class FlatReset:
    """An assignment of an event: to an unknown (index), or to a held variable (index in the parameters)."""

    name: str
    unknown: int | None
    held: int | None
    value: ca.SX
    place: Place


@dataclass(frozen=True)
class Impulse:
    """The impulse of an event: of the force with the index `force` in the parameters, of the size that brings the unknown
    `unknown` to `value`. Its `size` is known once the equations are reduced (see `numerics.impulses`)."""

    name: str
    force: int
    unknown: int
    value: ca.SX
    size: ca.SX | None = None


@dataclass(frozen=True)
class Breakaway:
    """The breakaway of a contact: the unknown `speed` that it lets change, and the entry `limit` in the parameters of the
    held variable that is `direction` (1 or -1) while the contact is at its limit and other contacts hold the bodies."""

    speed: int
    limit: int
    direction: float


@dataclass(frozen=True)
class FlatEvent:
    """An event. It happens when `indicator` passes zero upwards; a time event (None) happens at the instant `first`, and
    from then on once a `period` (None: once). `text` is its source: `condition: gap > 0`. An event `by_clock` replaces a
    comparison of the time with parameters in an equation (see `time_conditions`), and has the text of the comparison. With
    `ends` the run ends there. It does not happen together with the events that it `yields_to`, by name. Its `clock` makes
    its instants irregular."""

    name: str
    text: str
    place: Place
    indicator: ca.SX | None
    first: ca.SX
    period: ca.SX | None
    resets: tuple[FlatReset, ...]
    by_clock: bool = False
    impulse: Impulse | None = None
    breakaway: Breakaway | None = None
    ends: bool = False
    yields_to: tuple[str, ...] = ()
    clock: Clock | None = None


def with_held(parameters: Parameters, expanded: Expanded, unit_of: Callable[[Leaf, Unit], Unit], problems: Problems
              ) -> tuple[Parameters, tuple[Held, ...]]:
    """The parameters and the initial values of the held variables: from the diagram, else declared.

    `unit_of` solves the unit of a variable of a leaf. The name of a held variable means the same symbol.
    """
    held_variables: list[Held] = []
    numbers: list[FlatParameter] = []
    for path, leaf in expanded.leaves.items():
        impulses = {event.impulse for event in leaf.component.when}
        for variable in leaf.component.held.values():
            name, number, place = f"{path}.{variable.name}", variable.held, variable.place
            condition = expanded.model.initial.conditions.get(name)
            if condition is not None:
                chart = leaf.component.states if variable.name == STATE else ()
                place, number = condition.value.place, _initial_value(condition, chart, problems)
                below = -inf if variable.low is None else variable.low
                above = inf if variable.high is None else variable.high
                if number is not None and not below <= number <= above:
                    problems.add("held-bound", f"{name} = {condition.value.text} is not allowed; it is between {below:g} "
                                 f"and {above:g}", place, hint="Give a value in that range.")
                if chart and number is not None and number % 1:
                    names = ", ".join(f"{k} {state.name}" for k, state in enumerate(chart, 1))
                    problems.add("held-initial", f"'{name}' is the number or the name of a state", place,
                                 hint=f"States: {names}.")
                if variable.name in impulses:
                    problems.add("held-initial", f"'{name}' is the force of an impact, else it is 0", place,
                                 hint="Leave this line out.")
            unit = unit_of(leaf, variable.unit)
            held_variables.append(Held(name, len(parameters.independent) + len(held_variables), unit, variable.place,
                                       variable.doc))
            numbers.append(FlatParameter(f"initial.{name}", number or 0.0, unit, place))
    joined = parameters.joined(numbers)
    return replace(joined, expressions={**joined.expressions, **{h.name: joined.p[h.index] for h in held_variables}},
                   units={**joined.units, **{h.name: h.unit for h in held_variables}}), tuple(held_variables)


def _initial_value(condition: Condition, chart: Sequence[ChartState], problems: Problems) -> float | None:
    """The value under `initial:` of a held variable; the number of a state of `chart` by its name."""
    number, expr = constant(condition.value.expr), condition.value.expr
    if chart and isinstance(expr, Name) and not condition.guess and not condition.value.formula:
        names = [state.name for state in chart]
        if (word := condition.value.text) in names:
            return names.index(word) + 1.0
        problems.add("held-initial", f"{condition.name.rpartition('.')[0]} has no state '{word}'", condition.value.place,
                     hint=suggest(word, names) or f"States: {listing(names)}.")
        return None
    if number is None or condition.guess:
        problems.add("held-initial", f"'{condition.name}' is held; its initial value is a plain quantity",
                     condition.value.place, hint=f"Write `{condition.name}: 1`, or leave it out.")
    return number


def held_bounds(expanded: Expanded, symbols: Mapping[str, ca.SX]) -> dict[int, Interval]:
    """The interval of each held variable by the hash of its symbol."""
    return {symbols[f"{path}.{name}"].element_hash(): held_interval(variable)
            for path, leaf in expanded.leaves.items() for name, variable in leaf.component.held.items()}


def leaf_events(path: str, template: Template, values: list[ca.SX], names: Mapping[str, int], held: Mapping[str, Held]
                ) -> Iterator[FlatEvent]:
    """The events of one leaf; `values` are the values of the template's `happenings`."""
    remaining = iter(values)
    for line in template.events:
        condition, first, period = next(remaining), next(remaining), next(remaining)
        resets, impulse = [], None
        for target, reset in zip(line.targets, line.when.resets, strict=True):
            name, value = f"{path}.{target}", next(remaining)
            known = held.get(name)
            if line.when.impulse and known is None:
                impulse = Impulse(name, held[f"{path}.{line.when.impulse}"].index, names[name], value)
            else:
                resets.append(FlatReset(name, None if known else names[name], known.index if known else None, value,
                                        reset.target.place))
        breakaway = None
        if line.when.moves:
            limit = line.when.otherwise[0]
            breakaway = Breakaway(names[f"{path}.{line.when.moves}"], held[f"{path}.{limit.target.text}"].index,
                                  float(constant(limit.value.tree) or 0.0))
        text = f"{line.when.key}: {' '.join(line.when.formula.text.split())}"
        yield FlatEvent(f"{path}.{line.when.name}", text, line.when.place,
                        condition if line.when.key == "condition" else None, first,
                        period if line.when.key == "every" else None, tuple(resets), impulse=impulse, breakaway=breakaway,
                        yields_to=tuple(f"{path}.{name}" for name in line.when.yields_to))
