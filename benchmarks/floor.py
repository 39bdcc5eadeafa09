"""Equations integrated by a program in C that calls SUNDIALS itself: the floor under every way through Python.

It needs a C compiler and the headers and libraries of SUNDIALS 6 or newer (Debian: `apt install libsundials-dev`; elsewhere
where CPATH, LIBRARY_PATH and LD_LIBRARY_PATH point).
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.numerics.machine_code import compiler

Array = NDArray[np.float64]
PROGRAM = Path(__file__).with_suffix(".c")
LIBRARIES = [f"-lsundials_{name}" for name in ("cvode", "nvecserial", "sunmatrixdense", "sunlinsoldense")]


class NoFloor(Exception):
    """The program cannot be built here, and why."""


class Floor:
    """x' = f(t, x, p), compiled; NoFloor where it cannot be."""

    def __init__(self, t: ca.SX, x: ca.SX, p: ca.SX, rates: ca.SX):
        functions = [ca.Function("rates", [t, x, p], [rates]),
                     ca.Function("slopes", [t, x, p], [ca.densify(ca.jacobian(rates, x))])]
        generator = ca.CodeGenerator("equations", {"casadi_int": "int"})
        for function in functions:
            generator.add(function)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            (folder / "equations.c").write_text(generator.dump(), encoding="utf-8")
            definitions = [f"-DNUMBER={x.numel()}", f"-DWORK={max(f.sz_w() for f in functions)}"]
            self._integrate = ctypes.CDLL(str(_built(folder, definitions))).integrate
        self._integrate.restype = ctypes.c_long
        self.number = x.numel()

    def run(self, start: Array, p: Array, end: float, points: int, rtol: float, atol: float) -> Array:
        """The states (n_x, points) at evenly spaced times up to the end."""
        found = np.empty((points, self.number))
        as_c = [a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in (start, p, found)]
        steps = self._integrate(as_c[0], as_c[1], ctypes.c_double(end), ctypes.c_int(points), ctypes.c_double(rtol),
                                ctypes.c_double(atol), as_c[2])
        assert steps > 0, "SUNDIALS failed"
        return found.T


def _built(folder: Path, definitions: list[str]) -> Path:
    """The shared library in a folder that holds the equations."""
    command = compiler()
    if command is None:
        raise NoFloor("no C compiler here")
    library = folder / "floor.so"
    for core in (["-lsundials_core"], []):  # newer ones have it apart
        made = subprocess.run([command, "-O2", "-shared", "-fPIC", *definitions, str(PROGRAM), str(folder / "equations.c"),
                               "-o", str(library), *LIBRARIES, *core, "-lm"], capture_output=True, text=True, check=False)
        if made.returncode == 0:
            return library
    if "cvode/cvode.h" in made.stderr:
        raise NoFloor("no SUNDIALS headers here: apt install libsundials-dev")
    raise NoFloor(f"it cannot be compiled: {made.stderr.strip().splitlines()[-1]}")
