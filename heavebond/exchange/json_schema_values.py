"""JSON Schema of the values of keys: quantities with their units, formulas, records, lists."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

from heavebond.core.units import COMMON, ONE, Unit, is_generic, read_unit
from heavebond.language.definition import Component, Parameter, SignalPort
from heavebond.language.reading import INTERPOLATIONS

Schema = dict[str, object]
# accepted units for a declaration in base units, in addition to the common units
MORE = ("kN/m", "MN/m", "N/mm", "kN*s/m", "N*s/mm", "mm/s", "m/s", "km/h", "m/s**2", "m**2", "cm**2", "mm**2", "m**3",
        "cm**3", "m**3/s", "m**3/h", "L/s", "1/s", "1/min", "N*m", "kN*m", "N*m/rad", "N*m*s/rad", "kg*m**2", "kg/m**3",
        "kg/s", "kg/h", "g/s", "1/Pa", "1/GPa", "L/min/bar", "m**3/(s*Pa)", "J/K", "W/K", "1/m", "s/m")
# refused: a number that runs into its unit, as in 40kN/m, a decimal comma, a unit with a space, a power written as ^
QUANTITY = (r"^\s*(=|(?!~?\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?(?![eE][+-]?\d)[A-Za-zµ°%])"
            r"(?!~?\s*[+-]?\d+,\d+(\s|$))(?!~?\s*[\d.eE+-]+\s+[A-Za-zµ°%][^\s+(]*\s+[A-Za-zµ°%])(?!.*\^))[\s\S]*$")
FORMULA: Schema = {"type": ["string", "number"]}
TEXT: Schema = {"type": ["string", "number", "boolean"]}
WORDS: Schema = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
TIME_AXIS: Schema = {"type": "object", "additionalProperties": False, "required": ["column", "unit"],
                     "properties": {"column": TEXT, "unit": {"$ref": "#/definitions/unit"}}}


@lru_cache(maxsize=256)
def written_units(unit: Unit) -> tuple[str, ...]:
    """Units in which a value may be written if `unit` is declared, the declared one first."""
    units = [unit.text]
    for text in (*COMMON, *MORE):
        read = read_unit(text)
        if read.dimension == unit.dimension and read.counts == unit.counts and text not in units:
            units.append(text)
    return tuple(units)


def quantity(unit: Unit | None = None, description: str = "") -> Schema:
    """A number with a unit, a formula, or a bare 0; without unit a plain number too."""
    annotation: Schema = {"description": description} if description else {}
    if unit is None or (unit.dimension == ONE and not unit.counts) or is_generic(unit.dimension):
        return {**annotation, "anyOf": [{"type": "number"}, {"type": "string", "pattern": QUANTITY}]}
    units = written_units(unit)
    return {**annotation, "anyOf": [{"type": "string", "pattern": QUANTITY}, {"const": 0}],
            "examples": [f"1 {text}" for text in units],
            "defaultSnippets": [{"label": f"... {text}", "body": f"${{1:1}} {text}"} for text in units]}


def parameter(declared: Parameter) -> Schema:
    """The value of a component's parameter."""
    parts = [declared.doc, "whole number" if declared.integer else f"in {declared.unit.text}"]
    parts += [f"default {declared.default.text}"] if declared.default is not None else []
    parts += [f"at least {declared.low:g}"] if declared.low is not None else []
    parts += [f"at most {declared.high:g}"] if declared.high is not None else []
    description = ", ".join(part for part in parts if part)
    if declared.integer:
        return {"anyOf": [{"type": "integer"}, {"type": "string"}], "description": description}
    return quantity(declared.unit, description)


LISTS: tuple[Schema, ...] = (
    {"type": "array", "items": {"anyOf": [{"$ref": "#/definitions/quantity"},
                                          {"type": "array", "items": {"$ref": "#/definitions/quantity"}}]}},
    {"type": "object", "additionalProperties": False, "required": ["file", "values", "unit"], "properties": {
        "file": {"type": "string"}, "values": {**TEXT, "description": "the column"},
        "unit": {"$ref": "#/definitions/unit"}}})


def listed(declared: Parameter) -> Schema:
    """The values of a list parameter: in sequence, or a column of a file."""
    return {"description": parameter(declared)["description"], "anyOf": [parameter(declared), *LISTS]}


def signal(port: SignalPort) -> Schema:
    """The value of a signal input: a quantity, a formula, or a column of a record."""
    description = ", ".join(part for part in (port.doc, f"in {port.unit.text}") if part)
    several = LISTS[:1] if port.count is not None else ()
    return {"description": f"{description}; or a connection by a node",
            "anyOf": [quantity(port.unit), {"$ref": "#/definitions/column"}, *several]}


def column(required: Iterable[str], more: Mapping[str, Schema] | None = None) -> Schema:
    """A column of a record as an input, with optional entries."""
    return {
        "type": "object", "additionalProperties": False, "required": list(required), "properties": {
        "file": {"type": "string", "description": "CSV, Parquet or MAT file, relative to the folder of this one"},
        "column": {**TEXT, "description": "its name in the file"}, "unit": {"$ref": "#/definitions/unit"},
        "interpolation": {"enum": list(INTERPOLATIONS), "description": "interpolation between two samples"},
        "time": TIME_AXIS,
        "gaps": {"enum": ["bridge"], "description": "go across gaps"}, **(more or {})}}


def units() -> Schema:
    """A unit by itself."""
    return {"description": "a unit such as kN/m; 1 for a plain number",
            "anyOf": [{"enum": list(dict.fromkeys((*COMMON, *MORE)))}, {"type": "string"}, {"const": 1}]}


def instance_of(component: Component) -> Schema:
    """The entries of a part of this kind."""
    lists = {name: p for name, p in component.parameters.items() if p.count is not None}
    settings = {name: listed(p) if name in lists else parameter(p) for name, p in component.parameters.items()}
    settings |= {name: signal(s) for name, s in component.signals.items() if s.direction == "in"}
    elements = {rf"^{name}\[\s*\d+\s*((,|\]\[)\s*\d+\s*)?\]$": parameter(p) for name, p in lists.items()}
    return {"description": component.summary, "additionalProperties": False, "properties": {**COMMON_ENTRIES, **settings},
            **({"patternProperties": elements} if elements else {})}


COMMON_ENTRIES: Mapping[str, Schema] = {
    "is": {}, "at": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 3,
                     "description": "column and row in the drawing, and its rotation in degrees"},
    "repeat": {"anyOf": [{"type": "integer"}, {"type": "string"}], "description": "number of equal parts in series"},
    "data": {**WORDS, "description": "parts that give missing parameters of the same name"}}
