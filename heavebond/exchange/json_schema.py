"""JSON Schema (draft 7) of the files of the language, for completion and checks in editors.

It contains the keys of every kind of file, and for a folder's library the components, their parameters, inputs and units.
Checks across entries (wires, formulas, dimensions) are left to `heavebond check`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from urllib.parse import quote

from heavebond.core.errors import ModelError
from heavebond.core.units import COMMON, ONE, Unit, is_generic, read_unit, unit
from heavebond.estimation.experiment import USES
from heavebond.language.definition import ATTACHES, Component, Parameter, SignalPort
from heavebond.language.external_functions import SIGNATURES
from heavebond.language.layout import MIRRORED
from heavebond.language.library import Library
from heavebond.language.reading import INTERPOLATIONS
from heavebond.language.sections import SOLVERS, STARTS
from heavebond.language.view import COLOURS, PAIRS, POINTS, SPATIAL_KINDS, TRIPLES, WIDE
from heavebond.language.view import KINDS as SHAPES
from heavebond.language.when import KINDS
from heavebond.optimise.optimal import INTERPOLATIONS as INPUT_INTERPOLATIONS
from heavebond.optimise.optimal import STARTS as OPTIMAL_STARTS
from heavebond.studies.sampling import DRAWN, NAMED
from heavebond.studies.study import PICTURES

DRAFT = "http://json-schema.org/draft-07/schema#"
QUANTITY = {"$ref": "#/definitions/quantity"}
TIME = {"$ref": "#/definitions/time"}
UNIT = {"$ref": "#/definitions/unit"}
BODY = {"components": {"$ref": "#/definitions/components"}, "nodes": {"$ref": "#/definitions/nodes"},
        "layout": {"$ref": "#/definitions/layout"}}
WHOLE = {"type": ["string", "integer"]}
COUNT = {"anyOf": [WHOLE, {"type": "array", "items": WHOLE, "minItems": 1, "maxItems": 2}],
         "description": "length of a list, or rows and columns of a matrix, as whole numbers"}
# in this order: an experiment and a study name a model too
HEADS = ("component", "function", "experiment", "study", "model")
Schema = dict[str, object]
# accepted units for a declaration in base units, in addition to the common units
MORE = ("kN/m", "MN/m", "N/mm", "kN*s/m", "N*s/mm", "mm/s", "m/s", "km/h", "m/s**2", "m**2", "cm**2", "mm**2", "m**3",
        "cm**3", "m**3/s", "m**3/h", "L/s", "1/s", "1/min", "N*m", "kN*m", "N*m/rad", "N*m*s/rad", "kg*m**2", "kg/m**3",
        "kg/s", "kg/h", "g/s", "1/Pa", "1/GPa", "L/min/bar", "m**3/(s*Pa)", "J/K", "W/K", "1/m", "s/m")
# refused: a number that runs into its unit, as in 40kN/m, a decimal comma, a unit with a space, a power written as ^
QUANTITY_TEXT = (r"^\s*(=|(?!~?\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?(?![eE][+-]?\d)[A-Za-zµ°%])"
            r"(?!~?\s*[+-]?\d+,\d+(\s|$))(?!~?\s*[\d.eE+-]+\s+[A-Za-zµ°%][^\s+(]*\s+[A-Za-zµ°%])(?!.*\^))[\s\S]*$")
FORMULA: Schema = {"type": ["string", "number"]}
TEXT: Schema = {"type": ["string", "number", "boolean"]}
WORDS: Schema = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
TIME_AXIS: Schema = {"anyOf": [
    {"type": "object", "additionalProperties": False, "required": ["column", "unit"],
     "properties": {"column": TEXT, "unit": UNIT}, "description": "the column of the times"},
    {"type": "object", "additionalProperties": False, "required": ["every"], "properties": {"every": TIME, "from": TIME},
     "description": "rows at a fixed rate without times: their distance, and the time of the first row"}]}
LISTS: tuple[Schema, ...] = (
    {"type": "array", "items": {"anyOf": [{"$ref": "#/definitions/quantity"},
                                          {"type": "array", "items": {"$ref": "#/definitions/quantity"}}]}},
    {"type": "object", "additionalProperties": False, "required": ["file", "values", "unit"], "properties": {
        "file": {"type": "string"}, "values": {**TEXT, "description": "the column"},
        "unit": {"$ref": "#/definitions/unit"}}})
COMMON_ENTRIES: Mapping[str, Schema] = {
    "is": {}, "at": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 3,
                     "description": "column and row in the drawing, and its rotation in degrees"},
    "repeat": {"anyOf": [{"type": "integer"}, {"type": "string"}], "description": "number of equal parts in series"},
    "data": {**WORDS, "description": "parts that give missing parameters of the same name"}}


def schema(known: Library) -> Schema:
    """The schema of all kinds of files, with the components of a library."""
    kinds = {"model": diagram(), "component": component_file(known), "function": function_file(),
             "experiment": experiment(), "study": study()}
    chosen: Schema = {"$ref": "#/definitions/model_file"}
    for head in reversed(HEADS[:-1]):
        chosen = {"if": {"required": [head]}, "then": {"$ref": f"#/definitions/{head}_file"}, "else": chosen}
    return {
        "$schema": DRAFT, "title": "heavebond", "type": "object", "anyOf": [{"required": [head]} for head in HEADS],
        "properties": {head: {} for head in HEADS}, "allOf": [chosen],
        "definitions": {**{f"{head}_file": kind for head, kind in kinds.items()}, **parts(), **instances(known)}}


def _object(properties: Mapping[str, object], required: Iterable[str] = (), description: str = "") -> Schema:
    return {"type": "object", "additionalProperties": False, "properties": dict(properties),
            **({"required": list(required)} if required else {}), **({"description": description} if description else {})}


def _each(item: object, description: str = "") -> Schema:
    return {"type": "object", "additionalProperties": item, **({"description": description} if description else {})}


def _said(words: str, schema: Mapping[str, object] = TEXT) -> Schema:
    return {**schema, "description": words}


# -- kinds of files --------------------------------------------------------------------------------------------------
def diagram() -> Schema:
    """A diagram."""
    return _object({
        "model": _said("the name of the diagram"), "summary": _said("a sentence"),
        "extends": _said("another diagram of which this one is a variant"),
        "parameters": _each(QUANTITY, "parameters of the diagram, for formulas"), **BODY,
        "set": {"$ref": "#/definitions/settings"}, "remove": _said("removed parts of the extended diagram", WORDS),
        "initial": {"$ref": "#/definitions/initial"},
        "vary": _each(FORMULA, "factors by which parameters of parts vary: `spring.c: =1 + 0.2*spring.s/(1 m)`"),
        "nominal": _each(QUANTITY, "the usual size of a variable, for error control: `coil.i: 1 nA`"),
        "clocks": _each(_object({"parts": WORDS, "jitter": TIME, "lost": QUANTITY, "seed": QUANTITY}, ["parts"]),
                        "jitter and lost samples of the clocks of sampled parts"),
        "show": _each(_object({"is": _said("a formula; without it the name itself", FORMULA), "unit": UNIT}, ["unit"]),
                      "named outputs"),
        "simulate": _object({"from": TIME, "every": TIME, "until": {"anyOf": [TIME, _object(
                                 {"when": FORMULA, "at_most": TIME}, ["when", "at_most"],
                                 "the condition for the end of a run, and its latest end")]},
                             "largest_step": _said("longest step of the integrator", TIME),
                             "step": _said("step of the solvers with a fixed step", TIME),
                             "solver": _said("the integrator of a run [default: auto]", {"enum": list(SOLVERS)})},
                            description="begin and end of a run, the time between output points, and the integrator"),
        "view": _each({"anyOf": [*(view_shape(kind) for kind in SHAPES), *(spatial_shape(kind) for kind in SPATIAL_KINDS)]},
                      "shapes that `heavebond animate` moves"),
        "source": _said("its source"), "notes": _said("text for readers", {})}, ["model"])


def view_shape(kind: str) -> Schema:
    """A shape of a kind under `view:`."""
    needed, more, colour = SHAPES[kind]
    pair = {"type": "array", "items": FORMULA, "minItems": 2, "maxItems": 2}
    sizes = {key: pair if key in PAIRS and kind not in WIDE else FORMULA for key in (*needed, *more)}
    return _object({"is": {"enum": [kind]}, **sizes, "colour": _said(f"{colour} without it", {"enum": list(COLOURS)}),
                    "label": _said("its label")}, ["is", *needed])


def spatial_shape(kind: str) -> Schema:
    """A shape of a kind in space under `view:`."""
    needed, more, colour = SPATIAL_KINDS[kind]
    triple: Schema = {"type": "array", "items": FORMULA, "minItems": 3, "maxItems": 3}
    point: Schema = {"anyOf": [TEXT, triple, {"type": "array", "items": FORMULA, "minItems": 4, "maxItems": 4}]}
    return _object({"is": {"enum": [kind]}, **{
        key: TEXT if key == "file" else point if key in POINTS and kind != "level" else
        {"anyOf": [FORMULA, triple]} if key in TRIPLES else FORMULA for key in (*needed, *more)},
        "colour": _said(f"{colour} without it", {"enum": list(COLOURS)}), "label": _said("its label")}, ["is", *needed])


def experiment() -> Schema:
    """A diagram with records."""
    record_schema = _object({"file": TEXT, "time": TIME_AXIS})
    record = _object({
        "file": _said("CSV, Parquet or MAT file"), "use": {"enum": list(USES)}, "from": TIME, "to": TIME,
        "set": {"$ref": "#/definitions/settings"}, "initial": _each(QUANTITY), "inputs": {"$ref": "#/definitions/inputs"},
        "outputs": _each(record_schema)})
    record["anyOf"] = [{"required": ["file", "use"]}, {"propertyNames": {"enum": ["set", "initial"]}}]
    output = _object({
        "is": _said("a formula; without it the name itself", FORMULA), "column": _said("its name in the file"), "unit": UNIT,
        "noise": _said("standard deviation", QUANTITY), "file": TEXT, "time": TIME_AXIS,
        "shift": _said("its delay", TIME), "outliers": {"enum": ["drop", "keep"]}})
    free = {"anyOf": [_said("a range `30 .. 70 kN*s/m`, `42 kN/m +- 20 %`, or `fixed`"),
                      _object({"range": TEXT, "each": {"enum": ["record"]}}, ["range"])]}
    return _object({
        "experiment": _said("a name"), "summary": _said("a sentence"), "extends": _said("an experiment to begin with"),
        "model": _said("the diagram"), "records": _each(record, "the measured files"), "time": TIME_AXIS,
        "inputs": {"$ref": "#/definitions/inputs"}, "outputs": _each(output, "measured channels"),
        "free": _each(free, "free parameters of a fit"), "notes": _said("text for readers", {})}, ["experiment"])


def study() -> Schema:
    """Many cases, tuning, or both."""
    values, ranges = _each(QUANTITY), _each(TEXT, "parameters and their ranges: `0 .. 8 1/m`")
    window = _object({"from": TIME, "to": TIME}, description="the evaluated time")
    tune = _object({
        "free": ranges, "cost": _said("a formula of numbers of a run"), "limits": _said("comparisons that must hold", WORDS),
        "stable": _said("whether the tuned machine must be stable at rest", {"enum": ["on", "off"]}),
        "over": _each(values, "sets of values, each with its weight"),
        "uncertain": _each(TEXT, "uncertainties of parameters: `20 %`"),
        "by": _each({"type": ["object", "null"]}, "procedures")}, ["free", "cost"])
    steps = _object({"from": QUANTITY, "to": QUANTITY, "number": {"type": ["integer", "string"]}}, ["from", "to", "number"])
    whole: Schema = {"type": ["integer", "string"]}
    drawn = _object(dict.fromkeys((*DRAWN, "seed"), whole), description="sampling method of the points")
    sample = _object({"sample": {"anyOf": [{"enum": list(NAMED)}, drawn]}, "over": ranges}, ["sample", "over"])
    cases = {"anyOf": [{"type": "array"}, steps, sample, _each({"anyOf": [values, {"type": "null"}]})]}
    return _object({
        "study": _said("a name"), "summary": _said("a sentence"), "model": _said("the diagram"),
        "cases": _each(cases, "varied parameters: `f: [1 Hz, 2 Hz]`, or named sets of values"), "evaluate": window,
        "reference": _said("values of the reference run", values),
        "modes": _said("values for the computation of modes", values), "tune": tune,
        "optimal": _object({
            "free": ranges, "cost": _said("what is minimised", {"type": "string"}), "limits": WORDS,
            "start": {"enum": list(OPTIMAL_STARTS)}, "at_end": _said("values of signals at the end", values),
            "duration": _said("a range of the duration", {"type": "string"}), "intervals": WHOLE,
            "interpolation": {"enum": list(INPUT_INTERPOLATIONS)}}, ["free", "cost"],
            "the best functions of time for signals"),
        "measure": _each({"anyOf": [TEXT, _object({"is": {}, "unit": UNIT}, ["is"])]}, "measured numbers of each case"),
        "compare_with": _said("published numbers for comparison", {"type": "object"}), "calibrate": _object(
            {"free": ranges, "targets": {}, "to": {}}, ["free", "targets"]),
        "occurrence": _object({"of": WORDS, "share": _said("a number for each combination of their levels", {}),
                               "required": _each(TEXT, "comparisons of measured numbers: `<= 2 kN`")}, ["of", "share"],
                              "how often the levels of axes occur together"),
        "pictures": _each(_object({"title": TEXT, **dict.fromkeys(PICTURES, WORDS), "from": TIME, "to": TIME})),
        "notes": _said("text for readers", {})}, ["study", "model"])


def component_file(known: Library) -> Schema:
    """A component."""
    domain: Schema = {"anyOf": [{"enum": list(known.domains)}, {"type": "string", "pattern": r"^\$"}]}
    signal = _object({"signal": {"enum": ["in", "out"]}, "unit": UNIT, "doc": TEXT, "count": COUNT,
                      "default": QUANTITY}, ["signal", "unit"])
    port = _object({"domain": domain, "doc": TEXT, "count": WHOLE}, ["domain"])
    parameter = _object({
        "unit": UNIT, "doc": TEXT, "min": QUANTITY, "max": QUANTITY, "default": QUANTITY, "neutral": QUANTITY,
        "integer": _said("a whole number; written without a value", {}), "class": TEXT, "search_range": TEXT,
        "wakes_with": WORDS, "count": COUNT,
        "medium": _said("the property of the medium in its circuit that gives its value"),
        "typical": _object({"range": TEXT, "source": TEXT}, ["source"], "its usual range"),
        "instant": _said("a time at which something begins or changes, independent of the beginning of a record; "
                         "written without a value", {}),
        "interval": _said("a difference or an amplitude, which is in K if the unit is degC; written without a value", {}),
        "width": _said("the width of a transition that makes a law smooth; written without a value", {}),
        "meaning": _said("a sentence on the effect of another value, with fields, `Leakage of {C} in {part}.`")})
    variable = _object({"unit": UNIT, "doc": TEXT, "min": QUANTITY, "max": QUANTITY, "start": QUANTITY, "held": QUANTITY,
                        "nominal": QUANTITY, "count": COUNT,
                        "delayed": _object({"of": TEXT, "by": FORMULA}, ["of", "by"],
                                           "source and delay, if it is another variable at an earlier time"),
                        "physical": _said("the limit below which a run ends with an error", QUANTITY),
                        "beyond": _said("the state below `physical`, and the component that models it")}, ["unit"])
    event = _object({**dict.fromkeys((*KINDS, "from", "impulse", "moves"), FORMULA), "then": _each(FORMULA),
                     "otherwise": _each(FORMULA)}, ["then"])
    transition = {"anyOf": [FORMULA, _object({"when": FORMULA, "after": FORMULA})]}
    state = _object({"doc": TEXT, "entry": _each(FORMULA), "to": _each(transition)})
    return _object({
        "component": _said("its name, in CamelCase", {"type": "string"}), "summary": _said("a sentence"),
        "restrictions": _said("neglected effects"), "source": _said("source of the law"), "domain": TEXT,
        "symbol": _said("its picture in drawings"),
        "extends": _said("another component, whose laws it has"),
        "set": _each({"anyOf": [QUANTITY, *LISTS]}, "values of the parameters of the component that it extends"),
        "ports": _each({"anyOf": [domain, signal, port]}, "`a: translational`, `u: {signal: in, unit: V}`"),
        "parameters": _each(parameter), "variables": _each(variable, "own unknowns"),
        "travel_time": _said("travel time of a wave through the component, a segment of a line"),
        "opens": _said("pressure by which a valve is open, positive while it passes, `a.p - b.p - dp_0`"),
        "initial": _each(FORMULA, "states at the start that the diagram does not give, `{z: u}` or `{x: steady}`"),
        "frames": _each(_object(dict.fromkeys(("turn", "spin", "shift", "speed"), FORMULA)),
                        "the frame of a port, from the frame of another port: `a to b: {turn: \"turn(n, phi)\"}`"),
        "equations": _said("one equation per line, its name after #", {"type": "string"}),
        "when": _each(event, "events of the component"),
        "states": _each(state, "a state machine by its named states, the first one active at the start"),
        **BODY, "stores": _said("energy stored", FORMULA),
        "dissipates": _said("power lost", FORMULA), "unbalanced": _object({"power": FORMULA, "why": TEXT}, ["power", "why"]),
        "power": _said("`source`, or `controlled,` and the reason"), "requires": _said("relations between "
                                                                                       "parameters", WORDS),
        "effect": _effect(domain), "sliding": _each(QUANTITY, "values for linearisation while its dry friction slides"),
        "view": _each({"anyOf": [spatial_shape(kind) for kind in SPATIAL_KINDS]},
                      "its shapes in an animation of a diagram without `view:`"),
        "placeholder": _said("reason for a missing law"),
        "approximation": _object({"is": TEXT, "order": TEXT}, ["is", "order"],
                                 "the component without history that can replace it, and the whole number of its order"),
        "circuit": _object({"port": TEXT, "shares": TEXT, "excludes": WORDS, "advice": TEXT},
                           ["port", "shares", "excludes", "advice"],
                           "the port whose circuit excludes kinds of parts, the port that all its parts have on one node"),
        "units": {"enum": ["unchecked"], "description": "its equations are between plain numbers in SI"}},
        ["component", "summary"])


def function_file() -> Schema:
    """A function."""
    quantity = _object({"unit": UNIT, "doc": TEXT, "count": COUNT, "nominal": QUANTITY}, ["unit"])
    return _object({
        "function": _said("its name, in small letters with `_`", {"type": "string"}), "summary": _said("a sentence"),
        "restrictions": _said("neglected effects"), "source": _said("source of the law"),
        "inputs": _each(quantity, "arguments in this order"),
        "outputs": _each(quantity, "results"),
        "constants": _each(_object({"unit": UNIT, "value": QUANTITY, "doc": TEXT}, ["unit", "value"]), "numbers of the law"),
        "equations": _said("one line `name = formula` for each output and step, its name after #", {"type": "string"}),
        "is": {"enum": ["external"], "description": "a function in a program"},
        "file": _said("C source, shared library or Python file", {"type": "string"}),
        "call": _said("name of the function in the file, by default its own", {"type": "string"}),
        "signature": {"enum": list(SIGNATURES), "description": "how the arguments are passed"},
        "derivatives": _said("function of the same file that gives the derivatives", {"type": "string"})},
        ["function", "summary", "inputs", "outputs"])


def _effect(domain: Schema) -> Schema:
    attaches = {"enum": list(ATTACHES)}
    one = _object({
        "class": TEXT, "description": TEXT, "attaches": {"anyOf": [attaches, {"type": "array", "items": attaches}]},
        "amplitude": {"anyOf": [WORDS, _each(TEXT)]}, "search_range": _each(TEXT), "also": _each(domain), "replaces": WORDS,
        "start": _each(FORMULA), "settled": WORDS, "begins": _each(TEXT),
        "requires": _each(WORDS), "acts": FORMULA, "varies_with": WORDS,
        "meaning": _said("the effect in a sentence with fields, `Dry friction of {F_c} {place}.`")},
        ["class", "description"], "use as a candidate for a missing effect")
    return {"anyOf": [one, {"type": "array", "items": one}]}


# -- parts of them ---------------------------------------------------------------------------------------------------
def parts() -> dict[str, Schema]:
    """Definitions that several kinds of files share."""
    any_value = {"anyOf": [QUANTITY, *LISTS, {"$ref": "#/definitions/column"}]}
    return {
        "quantity": quantity(), "time": quantity(unit("s"), "a time"), "unit": units(),
        "column": column(["file", "column", "unit", "interpolation"]),
        "inputs": _each({"anyOf": [_said("the input whose record it replaces", {"type": "string"}),
                                   column(["column", "unit", "interpolation"],
                                          {"noise": _said("standard deviation of its noise", QUANTITY),
                                    "smooth": _said("bandwidth of a smoothing spline: `5 Hz`", QUANTITY)})]},
                        "signal inputs that records drive"),
        "settings": _each(any_value, "values on dotted paths: `gas.c: 40 kN/m`"),
        "nodes": _each({"anyOf": [{"type": "array", "items": {"type": "string"}}, {"type": "string"}]},
                       "the wires: a name each, and the list of ports: `load: [spring.b, load.a]`"),
        "layout": _object({
            "parts": _each({"type": "array", "items": {"anyOf": [WHOLE, {"enum": [MIRRORED]}]}, "minItems": 2,
                            "maxItems": 4},
                           "exact places in steps of the grid, rotation and reflection: `spring: [12, 4, 90]`"),
            "wires": _each({"type": "array", "items": {"type": "array", "items": WHOLE, "minItems": 4, "maxItems": 4}},
                           "pieces that the wire of a node contains: `load: [[12, 4, 20, 4]]`"),
            "notes": _each(_object({"text": TEXT, "at": {"type": "array", "items": WHOLE, "minItems": 2, "maxItems": 2}},
                                   ["text", "at"]), "texts on the drawing")}, description="the drawing"),
        "initial": {"type": "object", "description": "the start", "additionalProperties": QUANTITY, "properties": {
            "start": {"enum": list(STARTS)}, "solve": _said("parameters that the start determines", WORDS)}}}


def instances(known: Library) -> dict[str, Schema]:
    """`components:` of a diagram or block, and the entries of a part of each kind."""
    components: dict[str, Component] = {}
    for name in known.files:
        try:
            components[name] = known.component(name)
        except ModelError:
            continue  # a wrong component is reported at its use; its name may be completed
    kinds = list(dict.fromkeys([*known.names(), *components]))
    summaries = [components[name].summary if name in components else "" for name in kinds]
    by_kind = [{"if": {"required": ["is"], "properties": {"is": {"const": name}}},
                "then": {"$ref": f"#/definitions/is.{quote(name)}"}} for name in components]
    part = {"type": "object", "required": ["is"], "allOf": by_kind, "properties": {
        **COMMON_ENTRIES, "is": {"enum": kinds, "enumDescriptions": summaries, "description": "a component"}}}
    return {"components": _each(part, "the parts: name and component of each"),
            **{f"is.{name}": instance_of(component) for name, component in components.items()}}


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
    """The schema of a quantity: a number with a unit, a formula, or 0 without a unit. If `unit` is None or
    dimensionless, any number without a unit is permitted too."""
    annotation: Schema = {"description": description} if description else {}
    if unit is None or (unit.dimension == ONE and not unit.counts) or is_generic(unit.dimension):
        return {**annotation, "anyOf": [{"type": "number"}, {"type": "string", "pattern": QUANTITY_TEXT}]}
    units = written_units(unit)
    return {**annotation, "anyOf": [{"type": "string", "pattern": QUANTITY_TEXT}, {"const": 0}],
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
        "factor": {"type": "number", "description": "the readings are multiplied by it: -1 for the opposite sign"},
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
