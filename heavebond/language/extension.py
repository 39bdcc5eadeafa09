"""Component files that extend another component: the same laws with other values, for example from a data sheet.

    component: Nitrogen
    extends: Gas
    summary: Nitrogen.
    set: {R: 296.8 J/(kg*K), kappa: 1.4}
"""

from __future__ import annotations

from collections.abc import Mapping as Dictionary
from dataclasses import replace

from heavebond.core.errors import Problems, listing, suggest
from heavebond.core.units import ONE, is_generic
from heavebond.language import reading
from heavebond.language.definition import Component, Parameter, Value
from heavebond.language.values import add_formula_problem, check_bounds, check_dimension
from heavebond.text.dimensions import number_dimension
from heavebond.text.expression import ExpressionProblem, Name, Number
from heavebond.text.yaml_source import Mapping, Scalar, Sequence, Source

EXTENDING_KEYS = ("component", "extends", "summary", "restrictions", "source", "symbol", "set")


def extension(source: Source, base: Component, problems: Problems) -> Component:
    """Read a component file that extends `base`; mistakes are added to the problems."""
    root = source.root
    head = root.items["component"]
    name, place = reading.text(head, "component", problems), head.place
    if isinstance(head, Scalar):
        reading.identifier(head, "a component", problems)
    reading.known_keys(root, EXTENDING_KEYS, f"'{name}', which extends {base.name},", problems, ("component", "summary"))
    # the values under `set:` for parameters, with elements of lists by their names
    entries = reading.mapping(root.items.get("set"), "set", problems, "Write `set: {R: 296.8 J/(kg*K)}`.")
    values: dict[str, Value] = {}
    for key, item in (entries.items if entries else {}).items():
        parameter = base.parameters.get(key)
        if parameter is None:
            assert entries is not None
            problems.add("parameter-unknown", f"{base.name} has no parameter '{key}'", entries.keys[key].place,
                         hint=suggest(key, base.parameters) or f"It has: {listing(base.parameters)}.")
        elif parameter.count is None:
            if (value := reading.value(item, key, problems)) is not None:
                values[key] = value
                # unit and bounds of a value; in a formula also the names, which must be parameters of the component
                if parameter.integer or is_generic(parameter.unit.dimension):
                    continue
                before = len(problems.found)
                try:
                    dimension = None if isinstance(value.expr, Number) else number_dimension(
                        value.expr, lambda n: ONE if n.text == "pi" else _parameter(n, base.parameters).unit.dimension)
                except ExpressionProblem as problem:
                    add_formula_problem(problem, value, problems)
                    continue
                check_dimension(key, value, dimension, parameter.unit, problems)
                if len(problems.found) == before and isinstance(value.expr, Number):
                    check_bounds(key, parameter, value.expr.value, value, problems)
        elif isinstance(item, Sequence):
            values.update(reading.elements(item, key, key, problems))
        elif isinstance(item, Mapping):
            values.update(reading.column_values(item, key, source, problems))
        else:
            problems.add("list-number", f"'{key}' of {base.name} is a list", item.place,
                         hint=f"Write `{key}: [..., ...]`, each value with its unit.")
    texts = {key: reading.text(root.items.get(key), key, problems) for key in EXTENDING_KEYS if key != "set"}
    parameters = {key: replace(p, default=values.get(key, p.default)) for key, p in base.parameters.items()}
    # a variation is not a separate law: a diagnosis tries the extended component
    return replace(base, name=name, place=place, path=source.path, parameters=parameters, effects=(),
                   extends=(base.name, *base.extends),
                   values={**base.values, **{key: value for key, value in values.items() if "[" in key}},
                   summary=texts["summary"], restrictions=texts["restrictions"] or base.restrictions,
                   source=texts["source"] or base.source, symbol=texts["symbol"] or base.symbol)


def _parameter(name: Name, known: Dictionary[str, Parameter]) -> Parameter:
    word = name.text.partition("[")[0]
    if word not in known:
        raise ExpressionProblem("name-unknown", f"there is no parameter '{name.text}'", name.column, name.length,
                                suggest(name.text, known) or f"Parameters here: {listing(known)}.")
    return known[word]
