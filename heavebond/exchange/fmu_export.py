"""Export of a diagram as an FMU: the C of `c_code` with a wrapper, compiled for this host.

An FMU is for model exchange and for co-simulation, by FMI 2.0 or 3.0; the integrator of co-simulation (`rosenbrock.c`) is
inside. CasADi's own exporter (DaeBuilder 3.8) is not used: it writes units without their
definitions, adds variables with names that the standard does not allow, and knows algebraic unknowns only for importers with
an extension of the standard. Modelica Association, Functional Mock-up Interface Specification 2.0.4 and 3.0.1,
https://fmi-standard.org.

modelDescription.xml of an exported diagram, of FMI 2.0 and 3.0, for model exchange and co-simulation.

Modelica Association, Functional Mock-up Interface Specification 2.0.4 and 3.0.1, https://fmi-standard.org.
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
from contextlib import suppress
from dataclasses import replace
from html import escape
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree as Xml

from heavebond.core.errors import Problem, UsageError
from heavebond.core.quoting import xml_text
from heavebond.core.units import Unit
from heavebond.core.version import VERSION
from heavebond.core.writable import new_file
from heavebond.equations.events import FlatEvent
from heavebond.exchange.c_code import SOURCES, c_name, c_text
from heavebond.exchange.portable import Portable, Quantity, derived, portable
from heavebond.language.model import Model
from heavebond.numerics.output_times import grid

COMPILERS = ("cc", "gcc", "clang")
SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
SYSTEMS_2 = {"linux": "linux", "darwin": "darwin", "win32": "win"}
# by target of the cross compiler: the folder in an FMU of FMI 3.0, of FMI 2.0 (which names those of x86-64 only), and the
# suffix; glibc 2.17 and macOS 11 or newer
TARGETS = {"x86_64-linux-gnu.2.17": ("x86_64-linux", "linux64", ".so"),
           "aarch64-linux-gnu.2.17": ("aarch64-linux", "aarch64-linux", ".so"),
           "x86_64-windows-gnu": ("x86_64-windows", "win64", ".dll"),
           "aarch64-windows-gnu": ("aarch64-windows", "aarch64-windows", ".dll"),
           "x86_64-macos.11.0": ("x86_64-darwin", "darwin64", ".dylib"),
           "aarch64-macos.11.0": ("aarch64-darwin", "aarch64-darwin", ".dylib")}
STAMP = (1980, 1, 1, 0, 0, 0)  # time stamp of every file in the archive, so that the same diagram gives the same bytes
VERSIONS = (2, 3)
ICON = 640  # pixels of the width of the picture
STYLE = "body{font:14px sans-serif;margin:2em;max-width:60em}td,th{text-align:left;padding:0 1em 0 0}img{max-width:100%}"
LICENCE = """The solver, the interface to FMI and the equations of the components in this FMU are
parts of heavebond, under the following licence. It does not apply to the model.

MIT License

Copyright (c) 2026 The heavebond authors

Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all
copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
SOFTWARE.
"""
STRUCTURED = re.compile(r"(der\()*[A-Za-z_]\w*(\[[0-9]+\])?(\.[A-Za-z_]\w*(\[[0-9]+\])?)*\)*")


def export_fmu(model: Model, path: str | Path, inputs: Iterable[str] = (), version: int = 3, *, cross: bool = False,
               locals: Iterable[str] = (), picture: str = "") -> Portable:
    """Write an FMU of FMI 2.0 or 3.0, for this platform or, with `cross`, for all `TARGETS`; `locals` are variables of the
    diagram that are local variables of the FMU, `picture` is the text of an SVG file for its icon and its documentation.
    UsageError without a C compiler, ModelError for a diagram with FMUs."""
    if version not in VERSIONS:
        raise UsageError([Problem("fmi-version", f"FMI {version}.0 is not supported", None, "Choose 2 or 3.")])
    compilers = {platform_of(version): [find_compiler()]} if not cross else {
        (folders[version == 2], folders[2]): [*_cross_compiler(), "-target", target, "-fno-sanitize=all", "-s"]
        for target, folders in TARGETS.items()}
    exported = portable(model, inputs, "model_", events=True, locals=locals)
    source = c_text(exported, "model", whole=True)
    names = (f"fmi{version}.c", "fmu_core.c", "run.c", "rosenbrock.c", "history_memory.c", "values.c", "fmu_start.c",
             "history.c", "fmu_events.c", "variable_step.c")
    identifier, wrappers = c_name(exported.name), {name: (SOURCES / name).read_text(encoding="utf-8") for name in names}
    hashed = hashlib.sha256("".join([source, *wrappers.values()]).encode())
    token = "{" + hashed.hexdigest()[:32] + "}"
    source += f'\nstatic const char model_token[] = "{token}";\n'
    files = {"modelDescription.xml": description(exported, identifier, token, version), "sources/model.c": source.encode(),
             **{f"sources/{name}": text.encode() for name, text in wrappers.items()}}
    if version == 3:
        files["sources/buildDescription.xml"] = _build_description(identifier)
        files["terminalsAndIcons/terminalsAndIcons.xml"] = _terminals(exported, picture)
    files |= _documents(exported, picture, version)
    for (folder, suffix), compiler in compilers.items():
        files[f"binaries/{folder}/{identifier}{suffix}"] = _compiled(compiler, source, wrappers, version)
    with new_file(path) as fresh, zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, STAMP), content, zipfile.ZIP_DEFLATED)
    return exported


def find_compiler() -> str:
    """The C compiler: from the environment variable CC, else the first that is installed; UsageError without one."""
    named = os.environ.get("CC")
    for name in (named,) if named else COMPILERS:
        path = shutil.which(name)
        if path:
            return path
    reason = f"CC names '{named}', which is not there" if named else "no C compiler is installed"
    raise UsageError([Problem("compiler-missing", f"an FMU holds compiled C, and {reason}", None,
                              "Install gcc or clang (on Debian: apt install gcc), or set CC to a compiler. "
                              "`-o model.c` writes the equations as C and needs none.")])


def _cross_compiler() -> list[str]:
    """The command of the compiler for other platforms; UsageError if it is not installed."""
    if find_spec("ziglang") is None:
        raise UsageError([Problem("compiler-missing", "binaries for other platforms need the compiler of ziglang", None,
                                  "pip install 'heavebond[cross]'")])
    return [sys.executable, "-m", "ziglang", "cc"]


def platform_of(version: int = 3) -> tuple[str, str]:
    """The folder of this machine's binaries in an FMU, and their suffix."""
    system, suffix = SYSTEMS.get(sys.platform, ("linux", ".so"))
    if version == 2:
        return f"{SYSTEMS_2.get(sys.platform, 'linux')}{'64' if sys.maxsize > 2**32 else '32'}", suffix
    machine = platform.machine().lower()
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{processor}-{system}", suffix


def _compiled(compiler: Sequence[str], source: str, wrappers: dict[str, str], version: int) -> bytes:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in {"model.c": source, **wrappers}.items():
            (folder / file).write_text(text, encoding="utf-8")
        # without contraction, so that products and sums are rounded as written
        command = [*compiler, "-O2", "-std=c99", "-ffp-contract=off", "-shared", "-fPIC", "-fvisibility=hidden",
                   f"fmi{version}.c", "-o", "model.bin", "-lm"]
        completed = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if completed.returncode:
            lines = [line for line in completed.stderr.splitlines()
                     if "error" in line][:3] or completed.stderr.splitlines()[:3]
            raise UsageError([Problem("compiler-failed", f"{' '.join(compiler)} could not compile the FMU",
                                      None, "Set CC to another C compiler (gcc or clang).", tuple(lines))])
        return (folder / "model.bin").read_bytes()


def _build_description(identifier: str) -> bytes:
    """The file `buildDescription.xml`: instructions to compile the sources on another machine."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = Xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = Xml.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    Xml.SubElement(files, "SourceFile", {"name": "fmi3.c"})  # which includes the others
    return xml_bytes(root)


def _terminals(exported: Portable, svg: str) -> bytes:
    """A terminal for each input, with its derivative if there is one, and one for all outputs."""
    root = Xml.Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    if svg:
        picture = Xml.SubElement(root, "GraphicalRepresentation")
        size = re.search(r'viewBox="[-0-9.]+ [-0-9.]+ ([0-9.]+) ([0-9.]+)"', svg)
        height = f"{100 * float(size[2]) / float(size[1]):.4g}" if size and float(size[1]) > 0 else "100"
        corners = {"x1": "-100", "y1": f"-{height}", "x2": "100", "y2": height}
        Xml.SubElement(picture, "CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"})
        Xml.SubElement(picture, "Icon", corners)
    terminals = Xml.SubElement(root, "Terminals")
    groups: dict[str, list[tuple[str, str]]] = {}
    for q in exported.inputs:
        orders, plain = q.name.count("der("), q.name.replace("der(", "").rstrip(")")
        groups.setdefault(plain, []).append((q.name, "value" if not orders else f"derivative_{orders}"))
    if outputs := [(name, q.name) for name, q in shown_outputs(exported)]:
        groups["outputs"] = outputs
    for name, members in groups.items():
        terminal = Xml.SubElement(terminals, "Terminal", {"name": name, "matchingRule": "bus"})
        for variable, member in members:
            Xml.SubElement(terminal, "TerminalMemberVariable", {"variableName": variable, "memberName": member,
                                                                "variableKind": "signal"})
    if not groups:
        root.remove(terminals)
    return xml_bytes(root)


def shown_outputs(exported: Portable) -> list[tuple[str, Quantity]]:
    """The outputs with their names in an FMU: an output may have the name of a state or a parameter, which FMI does not
    allow."""
    exported_names = {q.name for group in (exported.states, exported.parameters, exported.inputs) for q in group}
    exported_names |= {held.name for held in exported.held.values()}
    outputs = exported.outputs[:len(exported.outputs) - exported.locals]
    return [(f"show.{q.name}" if q.name in exported_names else q.name, q) for q in outputs]


def _documents(exported: Portable, picture: str, version: int) -> dict[str, bytes]:
    """The picture, the documentation and the licence by their names in an FMU. A picture as PNG needs CairoSVG; without it,
    an FMU of FMI 2.0 has no icon, and one of FMI 3.0 a picture as SVG only."""
    files = {"documentation/licenses/license.txt": LICENCE.encode()}
    model, rows = exported.assembly.model, list[str]()
    if picture:
        files["documentation/diagram.svg"] = picture.encode()
        if version == 3:
            files["terminalsAndIcons/icon.svg"] = picture.encode()
        with suppress(ImportError, OSError):
            import cairosvg

            png = bytes(cairosvg.svg2png(picture.encode(), output_width=ICON, background_color="white"))
            files["terminalsAndIcons/icon.png" if version == 3 else "model.png"] = png
    tunable = [q for q, is_tunable in zip(exported.parameters, exported.tunable, strict=True) if is_tunable]
    for title, group in (("Inputs", [(q.name, q) for q in exported.inputs]), ("Outputs", shown_outputs(exported)),
                         ("Parameters", [(q.name, q) for q in tunable])):
        if group:
            cells = "\n".join(f"<tr><td>{escape(name)}</td><td>{escape(q.unit.text)}</td><td>{q.start:.6g}</td>"
                              f"<td>{escape(q.doc)}</td></tr>" for name, q in group)
            rows.append(f"<h2>{title}</h2>\n<table>\n<tr><th>name</th><th>unit</th><th>start</th><th></th></tr>\n{cells}\n"
                        "</table>")
    components = {leaf.component.name: leaf.component for leaf in exported.assembly.flat.expanded.leaves.values()}
    limits = "\n".join(f"<li>{escape(name)}: {escape(c.restrictions)}</li>" for name, c in components.items()
                       if c.restrictions)
    if limits:
        rows.append(f"<h2>Restrictions of the components</h2>\n<ul>\n{limits}\n</ul>")
    drawing = '<p><img src="diagram.svg" alt="diagram"></p>\n' if picture else ""
    files["documentation/index.html"] = (
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{escape(model.name)}</title>\n<style>{STYLE}'
        f"</style></head>\n<body>\n<h1>{escape(model.name)}</h1>\n<p>{escape(model.summary)}</p>\n{drawing}"
        + "\n".join(rows) + f"\n<p>Exported by heavebond {VERSION}. <code>licenses/license.txt</code> contains the licence "
        "of the parts of heavebond in this file.</p>\n</body>\n</html>\n").encode()
    return files


def description(exported: Portable, identifier: str, token: str, version: int = 3) -> bytes:
    """The XML that describes the contents of the FMU; `version` of the standard is 2 or 3."""
    shown_quantities = [q for group in (exported.states, exported.inputs, exported.outputs) for q in group]
    structured = all(STRUCTURED.fullmatch(q.name) for q in shown_quantities)
    root = Xml.Element("fmiModelDescription", {
        "fmiVersion": f"{version}.0", "modelName": exported.name, "instantiationToken" if version == 3 else "guid": token,
        "generationTool": f"heavebond {VERSION}",
        "variableNamingConvention": "structured" if structured else "flat",
        **({"numberOfEventIndicators": str(len(_conditions(exported)))} if version == 2 else {}),
        **({"description": summary} if (summary := exported.assembly.model.summary) else {})})
    (_kinds_3 if version == 3 else _kinds_2)(root, identifier, not exported.delays)
    quantities = [q for group in (exported.states, exported.parameters, exported.inputs, exported.outputs) for q in group]
    rates = [(f"der({q.name})", derived(q.unit, 1)) for q in exported.states]
    _units(root, [*(q.unit for q in quantities), *(unit for _, unit in rates)])
    model = exported.assembly.model
    if model.until is not None:
        times = grid(model, None, None)
        Xml.SubElement(root, "DefaultExperiment", {"startTime": repr(float(times[0])) if times[0] else "0",
                                                   "stopTime": repr(float(times[-1])), "tolerance": "1e-9",
                                                   "stepSize": repr(float(times[1] - times[0]))})
    (_Variables3 if version == 3 else _Variables2)(root).write(exported, rates)
    return xml_bytes(root)


def _kinds_3(root: Xml.Element, identifier: str, exchange: bool) -> None:
    """Co-simulation, and model exchange unless an importing integrator would have to keep the history of delays."""
    shared = {"modelIdentifier": identifier, "canGetAndSetFMUState": "true", "providesDirectionalDerivatives": "true"}
    shared["canSerializeFMUState"] = "true"
    if exchange:  # a completed step tests physical limits
        Xml.SubElement(root, "ModelExchange", {**shared, "needsCompletedIntegratorStep": "true"})
    Xml.SubElement(root, "CoSimulation", {**shared, "canHandleVariableCommunicationStepSize": "true",
                                          "hasEventMode": "true"})


def _kinds_2(root: Xml.Element, identifier: str, exchange: bool) -> None:
    shared = {"modelIdentifier": identifier, "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
              "providesDirectionalDerivative": "true"}
    kinds = [("ModelExchange", dict[str, str]())] if exchange else []
    for kind, more in (*kinds, ("CoSimulation", {"canHandleVariableCommunicationStepSize": "true"})):
        element = Xml.SubElement(root, kind, {**shared, **more})
        Xml.SubElement(Xml.SubElement(element, "SourceFiles"), "File", {"name": "fmi2.c"})  # which includes the others


def unit_name(unit: Unit) -> str:
    """A unit in the notation of FMI: `m3/(s.Pa)` for `m**3/(s*Pa)`."""
    return unit.text.replace("**", "").replace("*", ".")


def _units(root: Xml.Element, units: Sequence[Unit]) -> None:
    definitions = Xml.SubElement(root, "UnitDefinitions")
    for name, unit in {unit_name(unit): unit for unit in units}.items():
        entry = Xml.SubElement(definitions, "Unit", {"name": name})
        if any(power.denominator != 1 for _, power in unit.dimension):
            continue  # FMI permits whole powers only
        base = {symbol: str(power.numerator) for symbol, power in unit.dimension}
        if unit.counts == "angle":
            base["rad"] = "1"
        if unit.scale != 1:
            base["factor"] = repr(unit.scale)
        if unit.offset:
            base["offset"] = repr(unit.offset)
        Xml.SubElement(entry, "BaseUnit", base)


def _conditions(exported: Portable) -> list[FlatEvent]:
    """The events with an indicator, in the order of the indicators."""
    return [event for event in exported.events if event.indicator is not None]


class _Variables3:
    """Variables and model structure in the format of FMI 3.0; value references are numbered as in `fmu_core.c`."""

    def __init__(self, root: Xml.Element):
        self.variables, self.structure = Xml.SubElement(root, "ModelVariables"), Xml.SubElement(root, "ModelStructure")

    def add(self, name: str, reference: int, causality: str, variability: str, **more: str) -> None:
        """One variable; `derivative` is the value reference of the state."""
        Xml.SubElement(self.variables, "Float64", {"name": name, "valueReference": str(reference), "causality": causality,
                                                   "variability": variability, **{k: v for k, v in more.items() if v}})

    def write(self, exported: Portable, rates: Sequence[tuple[str, Unit]]) -> None:
        """All variables."""
        self.add("time", 0, "independent", "continuous", description="time in s")
        first, n_x = 1, len(exported.states)
        # values that the initialisation may change
        solved = list(range(first, first + n_x)) if exported.starting.follows else []
        for k, q in enumerate(exported.states):
            self.add(q.name, first + k, "local", "continuous", initial="approx" if solved else "exact", **_attributes(q),
                     nominal=repr(q.nominal))
        for k, (name, unit) in enumerate(rates):
            self.add(name, first + n_x + k, "local", "continuous", initial="calculated", unit=unit_name(unit),
                     derivative=str(first + k))
        first += 2 * n_x
        for k, (q, is_tunable) in enumerate(zip(exported.parameters, exported.tunable, strict=True)):
            if is_tunable:
                self.add(q.name, first + k, "parameter", "tunable", initial="exact", **_attributes(q), **_bounds(q))
            elif held := exported.held.get(k):
                self.add(held.name, first + k, "local", "discrete", initial="exact", **_attributes(replace(q, doc=held.doc)))
        first += len(exported.parameters)
        for k, q in enumerate(exported.inputs):
            self.add(q.name, first + k, "input", "continuous", **_attributes(q))
        first += len(exported.inputs)
        outputs_of_fmu = shown_outputs(exported)
        for k, (name, q) in enumerate(outputs_of_fmu):
            self.add(name, first + k, "output", "continuous", initial="calculated", unit=unit_name(q.unit),
                     description=q.doc)
        for k, q in enumerate(exported.outputs[len(outputs_of_fmu):], len(outputs_of_fmu)):
            self.add(q.name, first + k, "local", "continuous", initial="calculated", unit=unit_name(q.unit))
        outputs = list(range(first, first + len(outputs_of_fmu)))
        self.structured(solved, list(range(1 + n_x, 1 + 2 * n_x)), outputs,
                        self.conditions(exported, first + len(exported.outputs)))

    def conditions(self, exported: Portable, first: int) -> list[int]:
        """The event indicators as variables, and their value references."""
        events = _conditions(exported)
        for k, event in enumerate(events):
            self.add(f"{event.name}.indicator", first + k, "local", "continuous", initial="calculated",
                     description=f"above 0 where this is true: {event.text}")
        return list(range(first, first + len(events)))

    def structured(self, solved: list[int], rates: list[int], outputs: list[int], indicators: list[int]) -> None:
        """Outputs, derivatives of states, initial unknowns (also the states that are solved for), and event indicators,
        by value references."""
        for kind, references in (("Output", outputs), ("ContinuousStateDerivative", rates),
                                 ("InitialUnknown", [*solved, *rates, *outputs]), ("EventIndicator", indicators)):
            for reference in references:
                Xml.SubElement(self.structure, kind, {"valueReference": str(reference)})


class _Variables2(_Variables3):
    """The same in the format of FMI 2.0: variables are numbered from 1 in the order of the file."""

    def __init__(self, root: Xml.Element):
        super().__init__(root)
        self.index: dict[int, int] = {}

    def add(self, name: str, reference: int, causality: str, variability: str, **more: str) -> None:
        self.index[reference] = len(self.index) + 1
        outer = {k: v for k in ("description", "initial") if (v := more.pop(k, ""))}
        element = Xml.SubElement(self.variables, "ScalarVariable", {
            "name": name, "valueReference": str(reference), "causality": causality, "variability": variability, **outer})
        if state := more.pop("derivative", ""):
            more["derivative"] = str(self.index[int(state)])
        Xml.SubElement(element, "Real", {k: v for k, v in more.items() if v})

    def conditions(self, exported: Portable, first: int) -> list[int]:
        return []  # indicators are not variables

    def structured(self, solved: list[int], rates: list[int], outputs: list[int], indicators: list[int]) -> None:
        for kind, references in (("Outputs", outputs), ("Derivatives", rates),
                                 ("InitialUnknowns", sorted([*solved, *rates, *outputs], key=lambda r: self.index[r]))):
            if references:
                group = Xml.SubElement(self.structure, kind)
                for reference in references:
                    Xml.SubElement(group, "Unknown", {"index": str(self.index[reference])})


def _attributes(q: Quantity) -> dict[str, str]:
    return {"description": q.doc, "unit": unit_name(q.unit), "start": repr(q.start)}


def _bounds(q: Quantity) -> dict[str, str]:
    return {name: repr(float(value)) for name, value in (("min", q.low), ("max", q.high)) if isfinite(value)}


def xml_bytes(root: Xml.Element) -> bytes:
    """The bytes of the file, without characters in attributes that XML does not permit."""
    for element in root.iter():
        element.attrib.update({name: xml_text(value) for name, value in element.attrib.items()})
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{Xml.tostring(root, encoding="unicode")}\n'.encode()
