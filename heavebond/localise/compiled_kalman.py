"""The recursions of the Kalman filter and smoother in compiled code (`heavebond/c/kalman.c`).

A filter forms a few dozen small products between two samples, for each of which NumPy needs a hundred times the time of
the arithmetic. If no C compiler is present, NumPy is used.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path

import numpy as np

from heavebond.numerics.dae import Array
from heavebond.numerics.machine_code import loaded

SOURCE = Path(__file__).parents[1] / "c" / "kalman.c"
FLAGS = ("-O2", "-ffp-contract=off")
MOST_STATES = 60  # C has their matrices on its stack; beyond that the products of NumPy are as fast
SIZES = ("count", "places", "n", "m", "k", "keeps")
# what C reads and writes, in its order
ARRAYS = ("phi", "c", "gamma", "d", "moved", "error", "growth", "x", "p", "constant", "squares", "all_x", "all_p", "rows",
          "gains", "wrong", "weight", "states", "variance")


class _System(ctypes.Structure):
    _fields_ = [*((name, ctypes.c_long) for name in SIZES), *((name, ctypes.c_void_p) for name in ARRAYS)]


@lru_cache(maxsize=1)
def program() -> ctypes.CDLL | None:
    """The program, compiled at its first use; None if this is impossible."""
    library = loaded(SOURCE, FLAGS)
    for name in ("filter", "smooth") if library is not None else ():
        function = getattr(library, name)
        function.argtypes, function.restype = [ctypes.c_void_p], None
    if library is not None:
        library.respond.argtypes, library.respond.restype = [ctypes.c_long] * 4 + [ctypes.c_void_p] * 5, None
    return library


def serves(states: int) -> bool:
    """True if the program supports this number of states."""
    return states <= MOST_STATES and program() is not None


def run(name: str, **arrays: Array) -> None:
    """Call `filter` or `smooth` on arrays in the layout of C (see `System` there); the results are written to the arrays."""
    library = program()
    assert library is not None
    count, places, n = arrays["gamma"].shape[0] + 1, *arrays["gamma"].shape[1:]
    m, columns = arrays["error"].shape[1:]
    size = n + 1
    shapes = {
        "phi": (count - 1, n, n + columns - 1), "c": (count, m, n + columns - 1), "gamma": (count - 1, places, n),
        "d": (count, places, m), "moved": (count - 1, n, columns), "error": (count, m, columns),
        "growth": (count - 1, places), "x": (places, size, columns), "p": (places, size, size), "constant": (places,),
        "squares": (places, columns, columns), "all_x": (count, places, size, columns), "all_p": (count, places, size, size),
        "rows": (count, m, places, size), "gains": (count, m, places, size), "wrong": (count, m, places, columns),
        "weight": (count, m, places), "states": (count, places, size, columns), "variance": (count, places)}
    for key, array in arrays.items():  # C reads and writes so many numbers
        assert array.shape == shapes[key] and array.dtype == np.float64 and array.flags.c_contiguous, key
    system = _System(count, places, n, m, columns - 1, "all_x" in arrays, *(
        arrays[key].ctypes.data if key in arrays else None for key in ARRAYS))
    getattr(library, name)(ctypes.byref(system))


def responses(maps: Array, inputs: Array, means: Array, channels: int) -> Array:
    """v (N, m, K) of inputs (N, K) and their means (N-1, K) over the steps (see `whitening.Whitening.responses`)."""
    library = program()
    assert library is not None
    (count, rows, columns), width = maps.shape, inputs.shape[1]
    arrays = [np.ascontiguousarray(array, float) for array in (maps, inputs, means)]
    response, work = np.empty((count, channels, width)), np.empty((2, columns - 2, width))
    assert arrays[1].shape == (count, width) and arrays[2].shape == (count - 1, width) and rows == channels + columns - 2
    library.respond(count, channels, columns - 2, width, *(array.ctypes.data for array in (*arrays, response, work)))
    return response
