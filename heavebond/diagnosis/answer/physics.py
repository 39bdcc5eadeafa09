"""Sentences on the physics of an effect with its values, from `meaning:` in the component files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import casadi as ca

from heavebond.core.errors import listing
from heavebond.core.presentation import number, readable_unit, unit_label
from heavebond.core.units import Dimension, dimension_text, is_generic, read_unit
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.estimation.fitting import Fitted
from heavebond.language.definition import Component, Value
from heavebond.language.library import Library
from heavebond.language.symbols import Context, evaluate
from heavebond.text.dimensions import dimension
from heavebond.text.expression import Expr, Name, constant, names, parse_formula

SURROUNDINGS = "the surroundings"
DIGITS = 3  # of a value without an interval
FEWEST, MOST_DIGITS = 2, 6  # of a value with an interval, whose width sets the number of digits
PERCENT = " %"  # follows a field; the sign is printed before the interval
NAMED_UNITS = ("ohm", "J/K")  # units of quotients, in addition to those of `dimension_text`


def physics(candidate: Candidate, library: Library, values: Mapping[str, float], fitted: Sequence[Fitted] = ()) -> str:
    """Sentence on the physics of a candidate with its `values` (full names, SI) and the intervals of the `fitted` ones.

    The text is `meaning:` of the component file. If there is none, it is the description with the parameters.
    """
    component = library.component(candidate.component)
    if candidate.differs:
        return f"{listing(candidate.change.each)} has another value in some records."
    fitted_by_name = {p.name: p for p in fitted}
    effect = component.effect_of(candidate.attaches, candidate.old)
    meaning = component.parameters[candidate.name.rpartition(".")[2]].meaning if candidate.attaches == "in" else \
        effect.meaning if effect is not None else None
    if meaning is None:
        return _described(candidate, values, fitted_by_name)
    places = _places(candidate)
    text, single = meaning.texts[0], False
    for field, following in zip(meaning.fields, meaning.texts[1:], strict=True):
        if isinstance(field, str) and field in places:
            single = single or field not in ("part", "place")
            again = field == "part" and text.endswith(f" {places[field]} ")  # avoids 'the damper damper'
            text = text[:-1] + following if again else text + places[field] + following
            continue
        percent = following.startswith(PERCENT)
        figure = _value(field, candidate, component, values, fitted_by_name, PERCENT if percent else "")
        if figure is None:
            return _described(candidate, values, fitted_by_name)
        text += figure + (following.removeprefix(PERCENT) if percent else following)
    text = text if meaning.texts[0] or not meaning.fields else text[:1].upper() + text[1:]
    other_places = [label.removeprefix(candidate.component).strip() for label in candidate.members[1:]] if single else []
    return f"{text} The same law acts {listing(other_places, 3)}." if other_places else text


def _described(candidate: Candidate, values: Mapping[str, float], fitted: Mapping[str, Fitted]) -> str:
    """Description of an effect with its place and values."""
    ends = {name: p.told for name, p in fitted.items()}
    figures = [f"{n.name.rpartition('.')[2]} = {_figure(values[n.name], n.unit.text, ends.get(n.name))}"
               for n in candidate.numbers if n.name in values]
    if candidate.change.vary and candidate.attaches == "parameter":
        parameter, _, variable = candidate.place.removeprefix("of ").partition(" with ")
        return f"{parameter} varies with {variable}" + (f" ({listing(figures, 4)})." if figures else ".")
    description = candidate.description or candidate.kind
    return f"{description[:1].upper()}{description[1:]} {candidate.place}" \
        + (f": {listing(figures, 4)}." if figures else ".")


def _places(candidate: Candidate) -> dict[str, str]:
    """Texts for the fields `part`, `place` and the ports of a new part (their nodes)."""
    parts = [candidate.name.rpartition(".")[0]] if candidate.attaches == "in" else [candidate.name]
    if candidate.attaches == "in":
        parts += [p for n in candidate.numbers[:1] for p in n.parts]
    texts = {"part": listing(parts, 4), "place": candidate.place}
    for node, ends in candidate.change.nodes.items():
        for end in ends:
            owner, _, port = end.lstrip("+-").rpartition(".")
            if owner == candidate.name and not end.startswith("-"):
                beyond = [other_end for other_end in ends if other_end is not end] if node not in candidate.where else []
                texts.setdefault(port, SURROUNDINGS if node == f"{candidate.name}_end" else
                                 beyond[0].lstrip("+-") if candidate.attaches == "in series" and beyond else node)
    return texts


def _value(field: str | Expr, candidate: Candidate, component: Component, values: Mapping[str, float],
           fitted: Mapping[str, Fitted], label: str) -> str | None:
    """Format a field as a number with its unit, and with an interval if one of its parameters was fitted. None if a value is
    missing."""
    expr = parse_formula(field) if isinstance(field, str) else field
    part = candidate.name.rpartition(".")[0] if candidate.attaches == "in" else candidate.name
    keys = list(dict.fromkeys(name.text for name in names(expr)))
    units = {n.name.rpartition(".")[2]: n.unit for n in candidate.numbers}
    inserted = candidate.change.components.get(candidate.name)
    for key in keys:  # a held parameter of a generic unit has its unit in the change to the diagram
        if key not in units and is_generic(component.parameters[key].unit.dimension) and inserted is not None:
            units[key] = read_unit(inserted.values[key].partition(" ")[2])
    parameter_values: dict[str, float] = {}
    for key in keys:  # the fitted value, the value in the change to the diagram, or the default
        value = values.get(f"{part}.{key}")
        if value is None and inserted is not None and key in inserted.values:
            value = constant(parse_formula(inserted.values[key].lstrip("= ")))
        elif value is None and isinstance(default := component.parameters[key].default, Value):
            value = constant(default.expr)
        if value is None:
            return None
        parameter_values[key] = value

    def unit_of(name: Name) -> Dimension:
        return units.get(name.text, component.parameters[name.text].unit).dimension

    if isinstance(field, str):
        unit = units.get(field, component.parameters[field].unit).text
    else:
        base = dimension(expr, unit_of) or ()
        unit = next((name for name in NAMED_UNITS if read_unit(name).dimension == base), dimension_text(base))
    moving = [key for key in keys if f"{part}.{key}" in fitted]
    ends: tuple[float | None, float | None] | None = None
    unreached = False
    if len(moving) == 1:
        p = fitted[f"{part}.{moving[0]}"]
        low, high = (None if end is None else _evaluated(expr, {**parameter_values, moving[0]: end}) for end in p.told)
        lowest, highest = (_evaluated(expr, {**parameter_values, moving[0]: end}) for end in (p.low, p.high))
        rises = highest >= lowest
        ends, unreached = ((low, high) if rises else (high, low)), p.unreached is not None
    return _figure(_evaluated(expr, parameter_values), unit, ends, label, unreached)


def _evaluated(expr: Expr, values: Mapping[str, float]) -> float:
    context = Context(lambda _, name: ca.SX(values[name.text]), lambda symbol: symbol)
    with_values = evaluate(expr, context)
    return float(ca.evalf(with_values))


def _figure(value: float, unit: str, ends: tuple[float | None, float | None] | None, label: str = "",
            unreached: bool = False) -> str:
    """Format a value as `8.2 kN (8.1 to 8.3)`, with the number of digits that the interval determines. `label` replaces the
    unit."""
    display_unit = readable_unit(unit, value)
    scale = 1.0 if display_unit == unit else 1 / read_unit(display_unit).scale
    value, label = value * scale, label or ("" if unit == "1" else f" {unit_label(display_unit)}")
    low, high = (None if end is None or not math.isfinite(end) else end * scale for end in ends or (None, None))
    digits = DIGITS
    if low is not None and high is not None and high > low and value and math.isfinite(value):
        digits = min(MOST_DIGITS, max(FEWEST, math.ceil(math.log10(abs(value) / (high - low)))))
        while digits < MOST_DIGITS and number(low, digits) == number(high, digits):
            digits += 1
    figure = number(value, digits) + label
    if ends is None:
        return figure
    if unreached:
        return f"{figure} (not reached)"
    inside = f"{number(low, digits)} to {number(high, digits)}" if low is not None and high is not None else \
        f"above {number(low, digits)}" if low is not None else f"below {number(high, digits)}" if high is not None else \
        "not determined by the records"
    return f"{figure} ({inside})"
