"""The cases of a study: every combination of the levels of its axes.

An axis is a parameter with a list of values, names of variants (values set, another diagram), or points that are sampled
from the declared ranges of uncertain parameters:

    cases:
      ahc.valve.f_n: [0.25 Hz, 0.5 Hz, 1 Hz]                              # a parameter
      amplitude: {set: [wave.a], from: 0.5 m, to: 1.75 m, number: 6}      # one or several parameters, evenly spaced values
      friction: {with: {}, without: {model: frictionless.yaml}}           # variants
      uncertain: {sample: {sobol: 64}, over: {gas.c: 42 kN/m +- 20 %}}    # points
      realisation: {sample: seeds, over: {wave.seed: 1 .. 12}}            # whole numbers
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import isfinite

import numpy as np

from heavebond.core.errors import Place, Problems
from heavebond.core.units import Unit, UnitProblem, parse_quantity, read_unit
from heavebond.language import reading
from heavebond.language.definition import Value
from heavebond.language.model import Model, load_beside
from heavebond.language.sections import Condition, Setting, read_settings
from heavebond.studies.sampling import SEEDS, Sampling, names, points, read_sampling
from heavebond.text.expression import Number, constant
from heavebond.text.yaml_source import Mapping, Node, Scalar, Source
from heavebond.text.yaml_source import Sequence as Items

MOST_LEVELS = 10_000
SPACED = ("from", "to", "number")
INITIAL = "initial."


@dataclass(frozen=True)
class Level:
    """One value on an axis: its name, its settings, its diagram if it is another one, the number (SI) of a numeric axis;
    for a point of a sample its numbers (SI), and the parameters for which slopes are computed."""

    name: str
    settings: dict[str, Setting]
    model: Model | None = None
    value: float = float("nan")
    values: dict[str, float] = field(default_factory=dict)
    along: tuple[str, ...] = ()


@dataclass(frozen=True)
class Axis:
    """A varied quantity; `unit` is the unit of a parameter's values, None if the levels are variants or points of a
    sample.
    """

    name: str
    levels: tuple[Level, ...]
    place: Place
    unit: Unit | None = None
    sampling: Sampling | None = None


@dataclass(frozen=True)
class StudyCase:
    """One combination: the level of each axis, and the changed diagram."""

    index: tuple[int, ...]
    levels: tuple[Level, ...]
    model: Model

    @property
    def name(self) -> str:
        """`without, 0.25 Hz`; for a study without axes the name of the diagram."""
        return ", ".join(level.name for level in self.levels) or self.model.name


def indices(axes: Sequence[Axis]) -> list[tuple[int, ...]]:
    """Every combination of the levels, the last axis varying fastest."""
    return list(product(*(range(len(axis.levels)) for axis in axes)))


def case_at(axes: Sequence[Axis], model: Model, index: tuple[int, ...]) -> StudyCase:
    """One combination of the levels."""
    levels = tuple(axis.levels[k] for axis, k in zip(axes, index, strict=True))
    diagram = next((level.model for level in levels if level.model is not None), model)
    return StudyCase(index, levels, changed(diagram, [level.settings for level in levels]))


def changed(model: Model, settings: Sequence[dict[str, Setting]]) -> Model:
    """The diagram with settings of a study file, each with its place there; `initial.x` is a value at the start."""
    together = {path: setting for level in settings for path, setting in level.items()}
    plain = {path: setting for path, setting in together.items() if not path.startswith(INITIAL)}
    conditions = dict(model.initial.conditions)
    for path, setting in together.items():
        if path.startswith(INITIAL) and isinstance(setting.value, Value):
            name = path.removeprefix(INITIAL)
            conditions[name] = Condition(name, setting.value, False, setting.place)
    return replace(model, settings={**model.settings, **plain}, initial=replace(model.initial, conditions=conditions))


def read_axes(node: Node | None, source: Source, problems: Problems) -> tuple[Axis, ...]:
    """The axes under `cases:`."""
    entries = reading.mapping(node, "cases", problems, "Write one axis a line: `valve.f_n: [0.5 Hz, 1 Hz]`.")
    axes = []
    for name, item in (entries.items if entries else {}).items():
        place = entries.keys[name].place if entries else item.place
        if isinstance(item, Items):
            axis = _numeric(name, [name], item, place, problems)
        else:
            entry = reading.mapping(item, f"'{name}'", problems,
                                    "Write values, `[0.5 Hz, 1 Hz]`, or variants, `{on: {}, off: {...}}`.")
            if entry is None:
                axis = None
            elif "sample" in entry.items:
                axis = _sampled(name, entry, place, problems)
            elif "set" in entry.items:
                reading.known_keys(entry, ("set", "values", *SPACED), f"'{name}'", problems)
                paths = [word.text for word in reading.words(entry.items["set"], "set", problems)]
                axis = _numeric(name, paths, entry, place, problems)
            elif set(entry.items) & set(SPACED):
                reading.known_keys(entry, SPACED, f"'{name}'", problems)
                axis = _numeric(name, [name], entry, place, problems)
            else:
                levels = (_variant(key, level, source, problems) for key, level in entry.items.items())
                axis = Axis(name, tuple(level for level in levels if level is not None), place)
        if axis is not None and axis.levels:
            axes.append(axis)
    # refuse two axes that both name diagrams
    naming = [axis for axis in axes if any(level.model is not None for level in axis.levels)]
    for axis in naming[1:]:
        problems.add("axes-diagrams", f"'{axis.name}' and '{naming[0].name}' both name diagrams; a case has one", axis.place,
                     hint="Write the values that differ instead of `model:` in one of them, or make one axis of both.")
    for axis in [axis for axis in axes if axis.sampling is not None][1:]:
        problems.add("axes-samples", f"'{axis.name}' is a second sample; a study has one", axis.place,
                     hint="Write all uncertain parameters below one `over:`.")
    return tuple(axes)


def _sampled(name: str, entry: Mapping, place: Place, problems: Problems) -> Axis | None:
    """Points as levels, each setting its parameters."""
    sampling = read_sampling(entry, name, problems)
    over = entry.items.get("over")
    if sampling is None or not isinstance(over, Mapping):
        return None
    levels = []
    for point, row in zip(names(sampling), points(sampling).tolist(), strict=True):
        values = {path: value for path, value in zip(sampling.over, row, strict=True) if isfinite(value)}
        settings = {}
        for path, value in values.items():
            unit, at = sampling.over[path].unit, over.items[path].place
            sample_unit = None if sampling.kind == SEEDS else unit  # a whole number has no unit
            settings[path] = Setting(path, Value(Number(value, sample_unit, 0), unit.written(value), at), at)
        levels.append(Level(point, settings, values=values, along=tuple(sampling.over) if sampling.kind == "local" else ()))
    return Axis(name, tuple(levels), place, sampling=sampling)


def _variant(name: str, node: Node, source: Source, problems: Problems) -> Level | None:
    entry = reading.mapping(node, f"'{name}'", problems,
                            "Write the new values: `{gas.c: 40 kN/m}`, or `{}` for the diagram itself.")
    if entry is None:
        return None
    diagram = entry.items.get("model")
    variant_settings = {k: v for k, v in entry.items.items() if k != "model"}
    settings = read_settings(Mapping(variant_settings, {k: entry.keys[k] for k in variant_settings}, entry.place), source,
                             problems)
    return Level(name, settings, load_beside(source, diagram, problems) if diagram is not None else None)


def _numeric(name: str, paths: list[str], node: Mapping | Items, place: Place, problems: Problems) -> Axis | None:
    numbers = read_numbers(node, name, problems)
    if numbers is None:
        return None
    texts, unit = numbers
    levels = tuple(Level(s.text, {path: Setting(path, value, s.place) for path in paths}, None, number)
                   for s, value, number in texts)
    return Axis(name, levels, place, unit)


Numbers = tuple[list[tuple[Scalar, Value, float]], Unit]


def read_numbers(node: Node, name: str, problems: Problems) -> Numbers | None:
    """A list of quantities of one kind, or `{from: 0 Hz, to: 1 Hz, number: 11}`: each as written, as a value and in SI, and
    the unit of the first."""
    items = node.items.get("values", node) if isinstance(node, Mapping) else node
    if isinstance(items, Mapping):
        spaced = _spaced(items, name, problems)
        if spaced is None:
            return None
        scalars = spaced
    else:
        scalars = reading.words(items, name, problems)
    values, unit = [], None
    for scalar in scalars:
        value = reading.value(scalar, name, problems)
        number = constant(value.expr) if value is not None and not value.formula else None
        if value is None or number is None:
            if value is not None:
                problems.add("not-a-quantity", f"{name}: '{value.text}' is not a plain quantity", value.place)
            continue
        value_unit = getattr(value.expr, "unit", None) or read_unit("1")
        unit = unit or value_unit
        if value_unit.dimension != unit.dimension:
            problems.add("unit-wrong", f"{name}: '{scalar.text}' is not in {unit.text} as the first value is", scalar.place,
                         hint=f"Write it in {unit.text} or in a multiple of it.")
        values.append((scalar, value, number))
    if not scalars:
        problems.add("axis-empty", f"'{name}' has no values", node.place, hint="Write for example `[0.5 Hz, 1 Hz]`.")
    return (values, unit) if values and unit is not None else None


def _spaced(node: Mapping, name: str, problems: Problems) -> list[Scalar] | None:
    """`{from:, to:, number:}` as a list, in the unit of `from`."""
    reading.known_keys(node, ("set", *SPACED), f"'{name}'", problems, required=SPACED)
    ends = [_quantity(node.items.get(key), f"{name}, {key}", problems) for key in ("from", "to")]
    count = _quantity(node.items.get("number"), f"{name}, number", problems)
    if count is None or any(end is None for end in ends):
        return None
    (low, unit), (high, high_unit) = (end for end in ends if end is not None)
    if unit.dimension != high_unit.dimension:
        problems.add("unit-wrong", f"{name}: the two ends are in different units", node.items["to"].place)
        return None
    number = int(count[0])
    if count[1].dimension or number != count[0] or not 2 <= number <= MOST_LEVELS:
        problems.add("number-wrong", f"{name}: `number` is the number of values, including both ends",
                     node.items["number"].place, hint="Write for example `number: 11`.")
        return None
    return [Scalar(unit.written(value), node.items["from"].place) for value in np.linspace(low, high, number).tolist()]


def _quantity(node: Node | None, subject: str, problems: Problems) -> tuple[float, Unit] | None:
    if node is None:
        return None
    try:
        number, unit = parse_quantity(reading.text(node, subject, problems))
    except UnitProblem as problem:
        problems.add(problem.code, f"{subject}: {problem.message}", node.place, hint=problem.hint)
        return None
    return number, unit or read_unit("1")
