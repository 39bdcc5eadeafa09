"""Export of a diagram as an FMU: FMI 3.0 for model exchange, by the C of `c_code` and a wrapper, compiled for this host.

CasADi's own exporter (DaeBuilder 3.8) is not used: it writes units without their definitions, adds variables with names that
the standard does not allow, and knows algebraic unknowns only for importers with an extension of the standard.
Modelica Association, Functional Mock-up Interface Specification 3.0.1, https://fmi-standard.org.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree as Xml

from heavebond import __version__
from heavebond.core.errors import Problem, UsageError
from heavebond.core.quoting import xml_text
from heavebond.core.units import Unit
from heavebond.core.writable import new_file
from heavebond.exchange.c_code import SOURCES, c_name, c_text
from heavebond.exchange.portable import Portable, Quantity, derived, portable
from heavebond.language.model import Model
from heavebond.numerics.simulator import grid

COMPILERS = ("cc", "gcc", "clang")
SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
STAMP = (1980, 1, 1, 0, 0, 0)  # of every file in the archive, so that the same diagram gives the same bytes
STRUCTURED = re.compile(r"(der\()*[A-Za-z_]\w*(\[[0-9]+\])?(\.[A-Za-z_]\w*(\[[0-9]+\])?)*\)*")


def export_fmu(model: Model, path: str | Path, inputs: Iterable[str] = ()) -> Portable:
    """Write an FMU; UsageError where there is no C compiler, ModelError for a diagram with events."""
    compiler = find_compiler()
    made = portable(model, inputs, "model_")
    source = c_text(made, "model", directions=True)
    identifier = c_name(made.name)
    token = "{" + hashlib.sha256(f"{source}{_wrapper()}".encode()).hexdigest()[:32] + "}"
    source += f'\nstatic const char model_token[] = "{token}";\n'
    files = {"modelDescription.xml": description(made, identifier, token), "sources/model.c": source.encode(),
             "sources/fmi3.c": _wrapper().encode(), "sources/buildDescription.xml": _build_description(identifier)}
    folder, suffix = platform_of()
    files[f"binaries/{folder}/{identifier}{suffix}"] = _compiled(compiler, source)
    with new_file(path) as fresh, zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, STAMP), content, zipfile.ZIP_DEFLATED)
    return made


def find_compiler() -> str:
    """The C compiler: that of the environment variable CC, else the first that is there; UsageError where none is."""
    named = os.environ.get("CC")
    for name in (named,) if named else COMPILERS:
        found = shutil.which(name)
        if found:
            return found
    said = f"CC names '{named}', which is not there" if named else "there is no C compiler here"
    raise UsageError([Problem("compiler-missing", f"an FMU holds compiled C, and {said}", None,
                              "Install gcc or clang (on Debian: apt install gcc), or set CC to a compiler. "
                              "`-o model.c` writes the equations as C and needs none.")])


def platform_of() -> tuple[str, str]:
    """The folder of this machine's binaries in an FMU, and their suffix."""
    system, suffix = SYSTEMS.get(sys.platform, ("linux", ".so"))
    machine = platform.machine().lower()
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{processor}-{system}", suffix


def _wrapper() -> str:
    return (SOURCES / "fmi3.c").read_text(encoding="utf-8")


def _compiled(compiler: str, source: str) -> bytes:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "model.c").write_text(source, encoding="utf-8")
        (folder / "fmi3.c").write_text(_wrapper(), encoding="utf-8")
        # without contraction products and sums round as they are written
        command = [compiler, "-O2", "-std=c99", "-ffp-contract=off", "-shared", "-fPIC", "-fvisibility=hidden", "fmi3.c",
                   "-o", "model.bin", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line][:3] or done.stderr.splitlines()[:3]
            raise UsageError([Problem("compiler-failed", f"{compiler} could not compile the FMU", None,
                                      "Set CC to another C compiler (gcc or clang).", tuple(lines))])
        return (folder / "model.bin").read_bytes()


# -- modelDescription.xml --------------------------------------------------------------------------------------------
def description(made: Portable, identifier: str, token: str) -> bytes:
    """The XML that tells what the FMU holds."""
    shown = [q for group in (made.states, made.inputs, made.outputs) for q in group]
    structured = all(STRUCTURED.fullmatch(q.name) for q in shown)
    root = Xml.Element("fmiModelDescription", {
        "fmiVersion": "3.0", "modelName": made.name, "instantiationToken": token,
        "generationTool": f"heavebond {__version__}",
        "variableNamingConvention": "structured" if structured else "flat",
        **({"description": summary} if (summary := made.assembly.model.summary) else {})})
    Xml.SubElement(root, "ModelExchange", {"modelIdentifier": identifier, "canGetAndSetFMUState": "true",
                                           "providesDirectionalDerivatives": "true"})
    quantities = [q for group in (made.states, made.parameters, made.inputs, made.outputs) for q in group]
    rates = [_rate(q) for q in made.states]
    _units(root, [*(q.unit for q in quantities), *(unit for _, unit in rates)])
    _experiment(root, made)
    _variables(root, made, rates)
    return _text(root)


def _rate(state: Quantity) -> tuple[str, Unit]:
    """Name and unit of a state's derivative."""
    return f"der({state.name})", derived(state.unit, 1)


def unit_name(unit: Unit) -> str:
    """A unit as FMI tools write it: `m3/(s.Pa)` for `m**3/(s*Pa)`."""
    return unit.text.replace("**", "").replace("*", ".")


def _units(root: Xml.Element, units: Sequence[Unit]) -> None:
    definitions = Xml.SubElement(root, "UnitDefinitions")
    for name, unit in {unit_name(unit): unit for unit in units}.items():
        entry = Xml.SubElement(definitions, "Unit", {"name": name})
        if any(power.denominator != 1 for _, power in unit.dimension):
            continue  # FMI counts in whole powers
        base = {symbol: str(power.numerator) for symbol, power in unit.dimension}
        if unit.counts == "angle":
            base["rad"] = "1"
        if unit.scale != 1:
            base["factor"] = repr(unit.scale)
        if unit.offset:
            base["offset"] = repr(unit.offset)
        Xml.SubElement(entry, "BaseUnit", base)


def _experiment(root: Xml.Element, made: Portable) -> None:
    model = made.assembly.model
    if model.until is not None:
        times = grid(model, None, None)
        Xml.SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": repr(float(times[-1])), "tolerance": "1e-8",
                                                   "stepSize": repr(float(times[1]))})


def _variables(root: Xml.Element, made: Portable, rates: Sequence[tuple[str, Unit]]) -> None:
    """Value references as `fmi3.c` counts them."""
    variables, structure = Xml.SubElement(root, "ModelVariables"), Xml.SubElement(root, "ModelStructure")

    def add(name: str, reference: int, causality: str, variability: str, **more: str) -> None:
        Xml.SubElement(variables, "Float64", {"name": name, "valueReference": str(reference), "causality": causality,
                                              "variability": variability, **{k: v for k, v in more.items() if v}})

    names = {q.name for group in (made.states, made.parameters, made.inputs) for q in group}
    add("time", 0, "independent", "continuous", description="time in s")
    first, n_x = 1, len(made.states)
    for k, q in enumerate(made.states):
        add(q.name, first + k, "local", "continuous", initial="exact", **_told(q), nominal=repr(q.nominal))
    for k, (name, unit) in enumerate(rates):
        add(name, first + n_x + k, "local", "continuous", initial="calculated", unit=unit_name(unit),
            derivative=str(first + k))
    first += 2 * n_x
    for k, (q, shown) in enumerate(zip(made.parameters, made.tunable, strict=True)):
        if shown:
            add(q.name, first + k, "parameter", "tunable", initial="exact", **_told(q), **_bounds(q))
    first += len(made.parameters)
    for k, q in enumerate(made.inputs):
        add(q.name, first + k, "input", "continuous", **_told(q))
    first += len(made.inputs)
    for k, q in enumerate(made.outputs):
        # an output may have the name of a state or a parameter, which FMI does not allow
        name = f"show.{q.name}" if q.name in names else q.name
        add(name, first + k, "output", "continuous", initial="calculated", unit=unit_name(q.unit), description=q.doc)
        Xml.SubElement(structure, "Output", {"valueReference": str(first + k)})
    for k in range(n_x):
        Xml.SubElement(structure, "ContinuousStateDerivative", {"valueReference": str(1 + n_x + k)})
    for reference in (*range(1 + n_x, 1 + 2 * n_x), *range(first, first + len(made.outputs))):
        Xml.SubElement(structure, "InitialUnknown", {"valueReference": str(reference)})


def _told(q: Quantity) -> dict[str, str]:
    return {"description": q.doc, "unit": unit_name(q.unit), "start": repr(q.start)}


def _bounds(q: Quantity) -> dict[str, str]:
    return {name: repr(float(value)) for name, value in (("min", q.low), ("max", q.high)) if isfinite(value)}


def _build_description(identifier: str) -> bytes:
    """How the sources are compiled for another machine."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = Xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = Xml.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    Xml.SubElement(files, "SourceFile", {"name": "fmi3.c"})  # which includes model.c
    return _text(root)


def _text(root: Xml.Element) -> bytes:
    for element in root.iter():
        element.attrib.update({name: xml_text(value) for name, value in element.attrib.items()})
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Xml.tostring(root, encoding="unicode")}\n'.encode()
