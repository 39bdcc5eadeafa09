"""MAT files as named vectors: variables, and fields of structs as `struct.field`. Nothing in a file is executed."""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import DataError, Place, Problem

Array = NDArray[np.float64]
Aside = tuple[str, str]  # reason why a variable is not a column, and advice
NUMERIC = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
DEEPEST = 6  # depth of nested structs
UNPACK = {"timeseries": "In MATLAB, save plain vectors: `t = x.Time; y = x.Data; save('file.mat', 't', 'y', '-v7')`.",
          "timetable": "In MATLAB, save plain vectors: `t = seconds(x.Time); y = x.y; save('file.mat', 't', 'y', '-v7')`."}


@dataclass
class Vectors:
    """Contents of a MAT file: vectors of numbers by name, and the other variables with the reason why they are not
    columns.
    """

    columns: dict[str, Array] = field(default_factory=dict)
    aside: dict[str, Aside] = field(default_factory=dict)

    def beside(self, name: str | None) -> Vectors:
        """Only the vectors with the length of `name` (without it, of the commonest length)."""
        if not self.columns:
            return self
        lengths = [len(v) for v in self.columns.values()]
        first = name if name in self.columns else next(
            n for n, v in self.columns.items() if len(v) == Counter(lengths).most_common(1)[0][0])
        n = len(self.columns[first])
        other_lengths = {name: (f"has {len(v)} values, '{first}' has {n}",
                                "Give its time column: `time: {column: ..., unit: s}`.")
                         for name, v in self.columns.items() if len(v) != n}
        return Vectors({name: v for name, v in self.columns.items() if len(v) == n}, {**self.aside, **other_lengths})


def read_matlab(path: Path, place: Place | None = None) -> Vectors:
    """The vectors of a MAT file of version 4 to 7, or 7.3 if h5py is installed.

    A matrix of n rows and k columns is read as `name.1` .. `name.k`, an array of structs likewise; vectors of 1 element
    are not columns. Raises DataError if the file cannot be read.
    """
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # names that occur twice cannot be distinguished
            raw = loadmat(path, squeeze_me=True)
    except NotImplementedError:
        return _read_hdf5(path, place)
    except Exception as error:  # damaged files cause many kinds of exceptions in the reader
        reason = (str(error).splitlines() or [""])[0]
        raise DataError([Problem("record-mat", f"'{path.name}' is not a MAT file that can be read", place,
                                 "Save it again in MATLAB: `save('file.mat', 't', 'y', '-v7')`.",
                                 (reason,) if reason else ())]) from error
    vectors = Vectors()
    for name, value in raw.items():
        if not name.startswith("__"):
            _add(vectors, name, value, 0)
    return vectors


def _add(vectors: Vectors, name: str, value: Any, depth: int) -> None:
    value = np.asarray(value)
    names = value.dtype.names
    if names and set(names) >= {"s0", "s1", "s2"}:  # an object; its name and class are inside
        _set_aside(vectors, _text(value.ravel()[0]["s0"]) or name, _text(value.ravel()[0]["s2"]) or "object")
    elif names and depth < DEEPEST:
        for k, one in enumerate(value.ravel(), 1):
            inner = name if value.size == 1 else f"{name}.{k}"
            for member in names:
                _add(vectors, f"{inner}.{member}", one[member], depth + 1)
    elif value.dtype.kind in "fiub":
        _add_numbers(vectors, name, np.squeeze(value))
    else:
        kinds = {"U": "text", "S": "text", "c": "complex numbers", "O": "cells or an object"}
        kind = kinds.get(value.dtype.kind, "a struct")
        vectors.aside[name] = (f"holds {kind}, not numbers", "Save it as a vector of numbers.")


def _add_numbers(vectors: Vectors, name: str, value: NDArray[Any]) -> None:
    value = np.asarray(value, dtype=np.float64)
    if value.ndim == 1 and value.size:
        vectors.columns[name] = value
    elif value.ndim == 2 and value.size:
        for k, one in enumerate(value.T, 1):
            vectors.columns[f"{name}.{k}"] = one
    else:
        shape = "is a single number" if value.ndim == 0 else "is empty" if not value.size else f"has {value.ndim} dimensions"
        vectors.aside[name] = (f"{shape}; a column is a vector", "Save it as a vector with one value for each time.")


def _set_aside(vectors: Vectors, name: str, kind: str) -> None:
    hint = UNPACK.get(kind, "Save its numbers as plain vectors.").replace("x.", f"{name}.")
    vectors.aside[name] = (f"is a MATLAB {kind}, which only MATLAB can open", hint)


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _read_hdf5(path: Path, place: Place | None) -> Vectors:
    """Version 7.3 is HDF5: datasets, transposed, with the class of each variable as an attribute."""
    try:
        import h5py
    except ImportError:
        message = f"'{path.name}' is a MAT file of version 7.3, for which a library is missing"
        raise DataError([Problem("record-mat", message, place, "pip install h5py, or save it in MATLAB with `-v7`: "
                                 f"`save('{path.name}', '-v7')`.")]) from None
    vectors = Vectors()
    try:
        with h5py.File(path, "r") as file:
            _add_group(vectors, file, "", 0)
    except (OSError, RuntimeError, ValueError) as error:
        raise DataError([Problem("record-mat", f"'{path.name}' is not a MAT file that can be read", place,
                                 "Save it again in MATLAB with `-v7`.", (str(error).splitlines()[0],))]) from error
    return vectors


def _add_group(vectors: Vectors, group: Any, prefix: str, depth: int) -> None:
    import h5py

    for member in group:
        # a link may point to another file
        if member.startswith("#") or not isinstance(group.get(member, getlink=True), h5py.HardLink):
            continue
        item, name = group[member], prefix + member
        kind = _text(item.attrs.get("MATLAB_class", b"struct" if isinstance(item, h5py.Group) else b"double"))
        if isinstance(item, h5py.Group) and kind == "struct" and depth < DEEPEST:
            _add_group(vectors, item, name + ".", depth + 1)
        elif isinstance(item, h5py.Dataset) and "MATLAB_empty" in item.attrs:
            _add_numbers(vectors, name, np.zeros((0, 0)))
        elif isinstance(item, h5py.Dataset) and kind in NUMERIC and item.dtype.kind in "fiub":
            _add_numbers(vectors, name, np.squeeze(item[()].T))
        elif kind in ("char", "cell", "struct") or kind in NUMERIC:
            type_text = "text" if kind == "char" else "no plain numbers"
            vectors.aside[name] = (f"holds {type_text}", "Save it as a vector of numbers.")
        else:
            _set_aside(vectors, name, kind)
