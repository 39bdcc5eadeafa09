"""Import of an FMU: its description is converted to a component file. None of its code is run.

An FMU for co-simulation has a solver; one for model exchange only is integrated between two communication points.

The component of an FMU has its inputs and outputs as signals and its parameters with their start values. Its outputs are
held variables that are set once in each `step`. Modelica Association, Functional Mock-up Interface Specification 2.0.4
and 3.0.1, https://fmi-standard.org.
"""

from __future__ import annotations

import re
import zipfile
from fractions import Fraction
from itertools import product
from math import prod
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from heavebond.core.errors import ModelError, Problem, listing
from heavebond.core.limits import FMU_VARIABLES
from heavebond.core.limits import NUMBER as LARGEST
from heavebond.core.numerals import number
from heavebond.core.units import UnitProblem, declared_unit, dimension_of, dimension_text, read_unit
from heavebond.language.definition import Foreign, ForeignClock, ForeignVariable
from heavebond.text.expression import KEYWORDS

REAL = ("Real", "Float64", "Float32")
WHOLE = ("Integer", *(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)))
NUMBERS = (*REAL, *WHOLE, "Boolean", "Enumeration")
TAKEN = {*KEYWORDS, "time", "pi", "is", "at", "repeat", "step"}
LONGEST_DOC = 200
MOST_CLOCKS = 6  # clocks that the restrictions name
EXCHANGE = "exchange"  # the event that exchanges the signals
SHORTEST_INTERVAL = 1e-6  # of a clock, s; as for the step of an FMU
LAST = "last_"  # prefix of the held variable of an output


def described(path: Path) -> tuple[str, Foreign]:
    """Convert an FMU to the text of a component file and its names in the FMU; ModelError for unsupported features."""
    description = _read(path)
    if description.fmiVersion[:1] not in "23":
        raise _unusable(path, f"is written in FMI {description.fmiVersion}", "FMI 2.0 and 3.0 are read.")
    clocks, idle_clocks = _clocks(path, description)
    triggered = [v for v in description.modelVariables if v.type == "Clock" and v.causality == "input"
                 and v.name not in {*idle_clocks, *(clock.own for clock in clocks)}]
    output_clocks = tuple(int(v.valueReference) for v in description.modelVariables
                          if v.type == "Clock" and v.causality == "output")
    # an FMU for co-simulation without events may have events, and therefore ticks, in model exchange
    has_solver = description.coSimulation is not None and not (
        (clocks or triggered or output_clocks) and not description.coSimulation.hasEventMode
        and description.modelExchange is not None)
    interface = description.coSimulation if has_solver else description.modelExchange
    if has_solver and not description.coSimulation.hasEventMode:
        idle_clocks = (*(clock.own for clock in clocks), *(v.name for v in triggered), *idle_clocks)
        clocks, triggered, output_clocks = (), [], ()
    if interface is None:
        raise _unusable(path, "is for scheduled execution only", "Export it for co-simulation or model exchange.")
    exchanged = [v for v in description.modelVariables
                 if v.causality in ("input", "output", "parameter") and v.type != "Clock"]
    numbers = [v for v in exchanged if v.type in NUMBERS]
    room = FMU_VARIABLES - sum(not v.dimensions for v in numbers)
    if room < 0:
        raise _unusable(path, f"has {FMU_VARIABLES - room} inputs, outputs and parameters; up to {FMU_VARIABLES} are read",
                        "Export it with fewer of them.")
    variables = []
    for v in numbers:  # without arrays beyond the limit
        if not v.dimensions or prod(v.shape) <= room:
            variables.append(v)
            room -= prod(v.shape) if v.dimensions else 0
    kept_names = [v.name for v in exchanged if not any(v is read for read in variables)]
    reader = _Units({u.name: u.baseUnit for u in description.unitDefinitions})
    names, three = _Names(), description.fmiVersion.startswith("3")
    for v in triggered:
        v.start = "0"
    known = {kind: [entry for v in (*variables, *triggered) if v.causality == kind
                    for entry in _variables(v, names, reader, three)] for kind in ("input", "output", "parameter")}
    inputs, outputs, parameters = (tuple(v for v, _, _ in known[kind]) for kind in ("input", "output", "parameter"))
    foreign = Foreign(path, interface.modelIdentifier, inputs, outputs, parameters, has_solver, clocks, idle_clocks,
                      output_clocks)
    if not foreign.outputs:
        raise _unusable(path, "has no outputs that are numbers", "It has no effect in a diagram.")
    return _text(description, known, kept_names, foreign), foreign


def _unusable(path: Path, defect: str, hint: str) -> ModelError:
    return ModelError([Problem("fmu-unusable", f"{path.name} {defect}", None, hint)])


def _read(path: Path) -> Any:
    try:
        from fmpy import read_model_description
    except ImportError:
        raise ModelError([Problem("fmpy-missing", f"{path.name} is an FMU; FMPy is needed to read it", None,
                                  "pip install 'heavebond[fmu]'")]) from None
    try:
        return read_model_description(str(path), validate=False)
    except Exception as error:  # FMPy reports broken archives and descriptions by many kinds of exceptions
        reason = (str(error).splitlines() or [""])[0]
        raise ModelError([Problem("fmu-unreadable", f"{path.name} is not an FMU that can be read", None,
                                  "Export it again; it is a ZIP file with a modelDescription.xml.",
                                  (reason,) if reason else ())]) from error


def _clocks(path: Path, description: Any) -> tuple[tuple[ForeignClock, ...], tuple[str, ...]]:
    """The input clocks of an FMU that tick by themselves, and the names of those whose interval is not valid. FMPy does not
    read the intervals."""
    names = {v.name for v in description.modelVariables if v.type == "Clock" and v.causality == "input"}
    if not names:
        return (), ()
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    clocks: list[ForeignClock] = []
    idle: list[str] = []
    for element in root.iter("Clock"):
        values, name = element.attrib, element.attrib.get("name", "")
        kind = values.get("intervalVariability", "")
        if name not in names or kind == "triggered":
            continue
        try:
            resolution = float(values.get("resolution", 1))
            interval = float(values["intervalDecimal"]) if "intervalDecimal" in values \
                else float(values["intervalCounter"]) / resolution if "intervalCounter" in values else 0.0
            shift = float(values.get("shiftDecimal", float(values.get("shiftCounter", 0)) / resolution))
        except (ValueError, ZeroDivisionError):
            interval, shift = 0.0, -1.0
        calculated = kind in ("tunable", "changing", "countdown")
        valid = calculated or (kind in ("constant", "fixed") and SHORTEST_INTERVAL <= interval < LARGEST)
        if valid and 0 <= shift < LARGEST:
            clocks.append(ForeignClock(name, int(values["valueReference"]), interval, shift, calculated,
                                       kind == "countdown"))
        else:
            idle.append(name)
    return tuple(clocks), tuple(idle)


class _Names:
    """Unique names for the variables of an FMU, in the form of the language."""

    def __init__(self) -> None:
        self.given: set[str] = set()

    def __call__(self, fmu_name: str) -> str:
        plain = re.sub(r"\W+", "_", fmu_name, flags=re.ASCII).strip("_") or "v"
        plain = plain if plain[0].isalpha() else f"v_{plain}"
        name, number = plain, 2
        while name in self.given or name in TAKEN or name.startswith(LAST):
            name, number = f"{plain}_{number}", number + 1
        self.given.add(name)
        return name


class _Units:
    """The units of an FMU as base units of the language with factor and offset; `$name` without a unit."""

    def __init__(self, definitions: dict[str, Any]):
        self.definitions = definitions

    def __call__(self, text: str | None) -> tuple[str | None, float, float]:
        base = self.definitions.get(text) if text else None
        if base is not None:
            dimension = dimension_of({k: Fraction(getattr(base, k)) for k in ("kg", "m", "s", "A", "K", "mol", "cd")})
            written = dimension_text(dimension)
            if base.rad == 1 and written in ("1", "1/s", "1/s**2"):
                written = written.replace("1", "rad", 1)
            return written, float(base.factor), float(base.offset)
        if not text:
            return None, 1.0, 0.0
        try:  # `N.m/s2` for `N*m/s**2`
            unit = read_unit(re.sub(r"(?<=[A-Za-z])(-?[0-9])", r"**\1", text.replace(".", "*").replace("^", "")))
        except UnitProblem:
            return None, 1.0, 0.0
        base_text = dimension_text(unit.dimension)
        return (f"rad{base_text[1:]}" if unit.counts == "angle" else base_text), unit.scale, unit.offset


def _variables(v: Any, names: _Names, units: _Units, three: bool) -> list[tuple[ForeignVariable, str | None, Any]]:
    """A variable of an FMU, or the elements of an array in the order of their values, the last index first."""
    unit, scale, offset = units(v.unit or (v.declaredType.unit if v.declaredType is not None else None)) \
        if v.type in REAL else ("1", 1.0, 0.0)
    if v.relativeQuantity or getattr(v.declaredType, "relativeQuantity", False):
        offset = 0.0  # a difference of temperatures
    # values of an enumeration are whole numbers
    kind = v.type if v.type != "Enumeration" else "Int64" if three else "Integer"
    indices = list(product(*(range(1, n + 1) for n in v.shape or ())))
    elements = [f"{v.name}[{','.join(map(str, index))}]" if index else v.name for index in indices]
    return [(ForeignVariable(names(element), element, kind, int(v.valueReference), scale, offset, k, len(elements),
                             tuple(int(clock.valueReference) for clock in getattr(v, "clocks", None) or ())), unit, v)
            for k, element in enumerate(elements)]


def _number(v: Any, variable: ForeignVariable) -> float:
    """The start value in SI; one value is that of all elements of an array."""
    texts = str(v.start if v.start is not None else 0).lower().split() or ["0"]
    text = texts[variable.element] if variable.element < len(texts) else texts[0]
    try:
        start = number({"true": "1", "false": "0"}.get(text, text))
    except ValueError:
        raise ModelError([Problem("fmu-unusable", f"the start value of {variable.own}, '{text[:30]}', is not a number", None,
                                  "Export it again, with decimal points.")]) from None
    return start * variable.scale + variable.offset


def _text(description: Any, known: dict[str, list[tuple[ForeignVariable, str | None, Any]]], kept_names: list[str],
          foreign: Foreign) -> str:
    """The component file; `kept_names` are the variables that keep their start values."""
    path = foreign.path
    kept_text = f" {listing(kept_names, 6)} {'keeps its' if len(kept_names) == 1 else 'keep their'} start value" \
        f"{'' if len(kept_names) == 1 else 's'}: signals are numbers, up to {FMU_VARIABLES}." if kept_names else ""
    integrated = "" if foreign.has_solver else \
        " An FMU for model exchange: it is integrated between two communications, with constant inputs."
    ticks = [f"Its clock {clock.own} ticks " + ("at instants that it computes." if clock.calculated else
                                                f"every {clock.interval:g} s.") for clock in foreign.clocks]
    ticks += [f"Its clock {v.own} ticks at a communication if the input {v.name} has risen above 0.5."
              for v in foreign.inputs if v.type == "Clock"]
    ticks += [f"Its clock {name} never ticks." for name in foreign.idle_clocks]
    integrated += "".join(f" {tick}" for tick in ticks[:MOST_CLOCKS])
    tool = f", {description.generationTool}" if description.generationTool else ""
    step = description.defaultExperiment.stepSize if description.defaultExperiment is not None else None
    lines = [f"component: {_Names()(path.stem)}",
             f"summary: {_quoted(description.description or f'The FMU {description.modelName}.')}",
             "restrictions: " + _quoted("Its outputs are held between two communications, and depend on the inputs of the "
                                        f"previous step.{integrated}{kept_text}"),
             f"source: {_quoted(f'{path.name}, FMI {description.fmiVersion}{tool}')}", "ports:"]
    for kind, direction in (("input", "in"), ("output", "out")):
        lines += [f"  {entry.name}: {{signal: {direction}, unit: {unit or f'$U_{entry.name}'}, doc: {_doc(v, entry)}"
                  + (f", default: {_quantity(_number(v, entry), unit)}" if kind == "input" and v.start is not None else "")
                  + "}" for entry, unit, v in known[kind]]
    lines += ["parameters:", "  step: {unit: s, min: 1e-6 s, doc: time between two communications"
              + (f", default: {float(step)!r} s" if step else "") + "}"]
    lines += [f"  {entry.name}: {{unit: {unit or 1}{_bounds(v, entry, unit)}, doc: {_doc(v, entry)}, "
              f"default: {_quantity(_number(v, entry), unit)}}}" for entry, unit, v in known["parameter"]]
    lines.append("variables:")
    lines += [f"  {LAST}{entry.name}: {{unit: {unit or f'$U_{entry.name}'}, held: {_quantity(_number(v, entry), unit)}, "
              f"doc: {_doc(v, entry)}}}" for entry, unit, v in known["output"]]
    lines.append("equations: |")
    lines += [f"  {entry.name} = {LAST}{entry.name}   # held between communications"
              for entry, _, _ in known["output"]]
    set_to = ", ".join(f"{LAST}{entry.name}: {LAST}{entry.name}" for entry, _, _ in known["output"])
    return "\n".join([*lines, "when:", f"  {EXCHANGE}: {{every: step, then: {{{set_to}}}}}", ""])


def _quantity(number: float, unit: str | None) -> str:
    if unit is None or unit == "1":
        return repr(number)
    declared_unit(unit)
    return f"{number!r} {unit}"


def _bounds(v: Any, variable: ForeignVariable, unit: str | None) -> str:
    """The bounds of a parameter for its declaration; non-numeric bounds are omitted."""
    texts = []
    for name in ("min", "max"):
        bound_value = getattr(v, name, None)
        try:
            bound = number(str(bound_value if bound_value is not None
                               else getattr(v.declaredType, name, None)).strip()) * variable.scale
        except ValueError:
            continue
        if abs(bound + variable.offset) <= LARGEST:
            texts.append(f", {name}: {_quantity(bound + variable.offset, unit)}")
    return "".join(texts)


def _doc(v: Any, variable: ForeignVariable) -> str:
    doc_text, name = v.description or "", variable.own
    return _quoted(doc_text if name == doc_text or name.isidentifier() else f"{name}: {doc_text}".rstrip(": "))


def _quoted(text: str) -> str:
    """Quote a text for YAML."""
    plain = " ".join("".join(c if c.isprintable() else " " for c in text).split())[:LONGEST_DOC]
    return "'" + plain.replace("'", "''") + "'"
