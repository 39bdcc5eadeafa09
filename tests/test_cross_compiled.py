"""FMUs with binaries for all platforms: their headers are read, and the one for this platform runs."""

from __future__ import annotations

import inspect
import re
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from binary_headers import read_header
from test_export import compiled

import heavebond as hb
from heavebond.exchange.fmu_export import TARGETS, export_fmu, platform_of

RIG = """
model: rig
components: {wall: {is: Fixed}, spring: {is: SpringDamper, c: 80 N/m, d: 1 N*s/m}, load: {is: Mass, m: 2 kg}}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 50 mm, load.v: 0 m/s}
show: {place: {is: load.x, unit: mm}}
simulate: {until: 1 s, every: 10 ms}
"""
# the C library of each system; that of Windows has several files and calls the kernel
C_LIBRARY = {"ELF": r"lib[cm]\.so\.6|ld-linux.*", "Mach-O": r"/usr/lib/libSystem\.B\.dylib",
             "PE": r"(?i)(kernel32|ntdll|msvcrt|ucrtbase|api-ms-win-crt-[-a-z0-9]*)\.dll"}


@compiled
def test_the_header_of_the_binary_for_this_platform_has_all_functions_of_the_standard(tmp_path: Path) -> None:
    for version in (2, 3):
        export_fmu(hb.loads(RIG), tmp_path / "m.fmu", version=version)
        with zipfile.ZipFile(tmp_path / "m.fmu") as archive:
            binary = next(name for name in archive.namelist() if name.startswith("binaries/"))
            library = read_header(archive.read(binary))
        assert functions(version) <= library.exports
        assert all(re.fullmatch(C_LIBRARY[library.kind], name) for name in library.needs), library.needs


def functions(version: int) -> set[str]:
    """The functions of the standard, by the program that loads FMUs."""
    module = pytest.importorskip(f"fmpy.fmi{version}")
    names = set(re.findall(rf'"(fmi{version}[A-Z]\w+)"', inspect.getsource(module)))
    assert len(names) > 30
    return names


@pytest.mark.slow  # each platform's own C library is compiled once: some minutes
@pytest.mark.parametrize("version", [2, 3])
def test_binaries_for_windows_macos_and_linux_are_in_one_file(version: int, tmp_path: Path) -> None:
    pytest.importorskip("ziglang")
    fmpy = pytest.importorskip("fmpy")
    path = tmp_path / "m.fmu"
    export_fmu(hb.loads(RIG), path, version=version, cross=True)
    with zipfile.ZipFile(path) as archive:
        binaries = {name: read_header(archive.read(name)) for name in archive.namelist() if name.startswith("binaries/")}
    assert {name.split("/")[1] for name in binaries} == {folders[version == 2] for folders in TARGETS.values()}
    for name, library in binaries.items():
        folder = name.split("/")[1]
        assert library.kind == ("ELF" if "linux" in folder else "PE" if "win" in folder.replace("darwin", "") else "Mach-O")
        assert library.machine == ("aarch64" if folder.startswith("aarch64") else "x86_64")
        assert functions(version) <= library.exports, name
        assert all(re.fullmatch(C_LIBRARY[library.kind], needed) for needed in library.needs), (name, library.needs)
    if any(platform_of(version)[0] == name.split("/")[1] for name in binaries) and sys.platform == "linux":
        found = fmpy.simulate_fmu(str(path), stop_time=1.0, output_interval=0.01)
        exact = hb.simulate(hb.loads(RIG), rtol=1e-11).display["place"]
        assert np.abs(found["place"] - exact).max() < 1e-6  # the tolerance of the FMU is 1e-9 of 50 mm a step
