"""Export of a diagram as an FMU: the C of `c_code` with a wrapper, compiled for this host.

An FMU is for model exchange and for co-simulation, by FMI 2.0 or 3.0; the integrator of co-simulation (`rosenbrock.c`) is
inside. CasADi's own exporter (DaeBuilder 3.8) is not used: it writes units without their
definitions, adds variables with names that the standard does not allow, and knows algebraic unknowns only for importers with
an extension of the standard. Modelica Association, Functional Mock-up Interface Specification 2.0.4 and 3.0.1,
https://fmi-standard.org.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree as Xml

from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import new_file
from heavebond.exchange.c_code import SOURCES, c_name, c_text
from heavebond.exchange.model_description import description, xml_bytes
from heavebond.exchange.portable import Portable, portable
from heavebond.language.model import Model

COMPILERS = ("cc", "gcc", "clang")
SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
SYSTEMS_2 = {"linux": "linux", "darwin": "darwin", "win32": "win"}
STAMP = (1980, 1, 1, 0, 0, 0)  # time stamp of every file in the archive, so that the same diagram gives the same bytes
VERSIONS = (2, 3)


def export_fmu(model: Model, path: str | Path, inputs: Iterable[str] = (), version: int = 3) -> Portable:
    """Write an FMU of FMI 2.0 or 3.0; UsageError without a C compiler, ModelError for a diagram with FMUs."""
    if version not in VERSIONS:
        raise UsageError([Problem("fmi-version", f"FMI {version}.0 is not supported", None, "Choose 2 or 3.")])
    compiler = find_compiler()
    exported = portable(model, inputs, "model_", events=True)
    source = c_text(exported, "model", whole=True)
    identifier, wrappers = c_name(exported.name), _wrappers(version)
    hashed = hashlib.sha256("".join([source, *wrappers.values()]).encode())
    token = "{" + hashed.hexdigest()[:32] + "}"
    source += f'\nstatic const char model_token[] = "{token}";\n'
    files = {"modelDescription.xml": description(exported, identifier, token, version), "sources/model.c": source.encode(),
             **{f"sources/{name}": text.encode() for name, text in wrappers.items()}}
    if version == 3:
        files["sources/buildDescription.xml"] = _build_description(identifier)
    folder, suffix = platform_of(version)
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


def platform_of(version: int = 3) -> tuple[str, str]:
    """The folder of this machine's binaries in an FMU, and their suffix."""
    system, suffix = SYSTEMS.get(sys.platform, ("linux", ".so"))
    if version == 2:
        return f"{SYSTEMS_2.get(sys.platform, 'linux')}{'64' if sys.maxsize > 2**32 else '32'}", suffix
    machine = platform.machine().lower()
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{processor}-{system}", suffix


def _wrappers(version: int) -> dict[str, str]:
    """The sources in addition to model.c; the first includes the others."""
    names = (f"fmi{version}.c", "fmu_core.c", "run.c", "fmu_start.c", "fmu_events.c", "history.c", "rosenbrock.c")
    return {name: (SOURCES / name).read_text(encoding="utf-8") for name in names}


def _compiled(compiler: str, source: str, wrappers: dict[str, str], version: int) -> bytes:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in {"model.c": source, **wrappers}.items():
            (folder / file).write_text(text, encoding="utf-8")
        # without contraction, so that products and sums are rounded as written
        command = [compiler, "-O2", "-std=c99", "-ffp-contract=off", "-shared", "-fPIC", "-fvisibility=hidden",
                   f"fmi{version}.c", "-o", "model.bin", "-lm"]
        completed = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if completed.returncode:
            lines = [line for line in completed.stderr.splitlines()
                     if "error" in line][:3] or completed.stderr.splitlines()[:3]
            raise UsageError([Problem("compiler-failed", f"{compiler} could not compile the FMU", None,
                                      "Set CC to another C compiler (gcc or clang).", tuple(lines))])
        return (folder / "model.bin").read_bytes()


def _build_description(identifier: str) -> bytes:
    """How the sources are compiled for another machine."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = Xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = Xml.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    Xml.SubElement(files, "SourceFile", {"name": "fmi3.c"})  # which includes the others
    return xml_bytes(root)
