"""Runs as files: written with their units as CSV, Parquet, MAT or NetCDF, and read back.

A truncated file is refused in every format: Parquet ends with an index, NetCDF begins with the number of values, MAT ends
with the names of the variables, and in CSV the last column counts the remaining rows.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heavebond.core import facade
from heavebond.core.errors import DataError, Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.core.units import dimension_text, read_unit
from heavebond.core.writable import new_file
from heavebond.records.signal_array import Signal, xarray_module
from heavebond.records.text_tables import ROWS_LEFT, check_rows_left

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
MARK = " (placeholder)"  # behind the name or unit of a signal that depends on a part without a law
_HEAD = re.compile(rf"(?P<name>.+) \[(?P<unit>[^\[\]]*)\](?P<mark>{re.escape(MARK)})?")
LONGEST_NAME = 63  # largest length of the name of a MATLAB variable
NEEDED = ("time", "model", "signals", "variables", "units")  # names of the description in a MAT file
TAKEN = (*NEEDED, "solver", "placeholders")


@dataclass(frozen=True, repr=False)
class Signals(Mapping[str, Array]):
    """Signals (N,) by name, all in SI or all in their declared units; `unit(name)` is the unit of `signals[name]`."""

    _names: Callable[[], list[str]]
    _values: Callable[[str], Array]
    unit: Callable[[str], str]

    def __getitem__(self, name: str) -> Array:
        return self._values(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names())

    def __len__(self) -> int:
        return len(self._names())

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def _ipython_key_completions_(self) -> list[str]:
        return self._names()

    def __repr__(self) -> str:
        return f"<Signals: {listing([f'{name} [{self.unit(name)}]' for name in self._names()[:8]])}>"


@dataclass(frozen=True)
class SavedRun(facade.Displayed):
    """A run without its diagram: `time` (N,) in s and `values`, signals (N,) by name in `units[name]`.

    `run[name]` is a Signal with its unit; `run.si[name]` are its numbers in SI, `run.display[name]` those in
    `run.unit(name)`. `solver` is the integrator and the reason for it (not stored in CSV). `without_law` are the signals
    that depend on a part without a law (`placeholder:`).
    """

    model: str
    time: Array
    values: dict[str, Array] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    solver: str = ""
    without_law: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return brief(self, self.model, count(len(self.time), "point"), f"signals {listing(list(self.values), 8)}")

    def names(self) -> list[str]:
        """The signals in the order of the file."""
        return list(self.values)

    def unit(self, name: str) -> str:
        """The unit in which the signal was saved, as for `run.display[name]`."""
        self._saved(name)
        return self.units[name]

    @property
    def display(self) -> Signals:
        """The signals in the units in which they were saved."""
        return Signals(self.names, self._saved, self.unit)

    @property
    def si(self) -> Signals:
        """The signals in SI."""
        return Signals(self.names, self._in_si, lambda name: dimension_text(read_unit(self.unit(name)).dimension))

    def __getitem__(self, name: str) -> Signal:
        return Signal(self._saved(name), self.unit(name), name, self.time)

    def __iter__(self) -> Iterator[str]:
        return iter(self.values)

    def __contains__(self, name: object) -> bool:
        return name in self.values

    def _ipython_key_completions_(self) -> list[str]:
        return self.names()

    def plot(self, *names: str) -> Figure:
        """A matplotlib figure of signals over time, of all if none is named: one axes per unit; UsageError for an unknown
        name."""
        for name in names:
            self._saved(name)
        figure: Figure = facade.call("SavedRun.plot", self, names or tuple(self.values))
        return figure


    def _in_si(self, name: str) -> Array:
        unit = read_unit(self.unit(name))
        return np.asarray(self._saved(name) * unit.scale + unit.offset)

    def _saved(self, name: str) -> Array:
        if name not in self.values:
            raise UsageError([Problem("name-unknown", f"this run holds no '{name}'", None,
                                      suggest(name, self.values) or f"It holds {listing(self.values)}.")])
        return self.values[name]

    def to_pandas(self) -> pd.DataFrame:
        """A table with time as index, columns `name [unit]`, with ` (placeholder)` behind signals that depend on a part
        without a law; `table.attrs["units"]` maps columns to units."""
        import pandas as pd

        heads = {name: f"{name} [{self.units[name]}]{MARK if name in self.without_law else ''}" for name in self.values}
        table = pd.DataFrame({heads[name]: values for name, values in self.values.items()},
                             index=pd.Index(self.time, name="time [s]"))
        table.attrs["units"] = {heads[name]: self.units[name] for name in self.values}
        return table

    def to_xarray(self) -> xr.Dataset:
        """A dataset over `time`, each variable with its unit as `attrs["units"]`; UsageError if xarray is missing."""
        dataset: xr.Dataset = xarray_module().Dataset(
            {name: ("time", values, {"units": self.units[name], **({"placeholder": 1} if name in self.without_law else {})})
             for name, values in self.values.items()},
            {"time": ("time", self.time, {"units": "s"})}, {"model": self.model, "solver": self.solver})
        return dataset


def write_run(run: SavedRun, path: str | Path) -> None:
    """Write a run in the format of its file's suffix (see SUFFIXES); UsageError for another one, or a missing package."""
    write = _form(Path(path), "written")[0]
    with new_file(path) as fresh:
        write(run, fresh)


def read_run(path: str | Path) -> SavedRun:
    """Read a run that `result.save` wrote, in the format of the suffix of `path` (see SUFFIXES).

    The signals (N,) have the units in which they were saved. Raises UsageError for another suffix or a missing file,
    DataError if the file has another content or is incomplete.
    """
    path = Path(path)
    read = _form(path, "read")[1]
    if not path.is_file():
        near = [p.name for p in sorted(path.parent.glob("*")) if p.suffix in SUFFIXES] if path.parent.is_dir() else []
        raise UsageError([Problem("file-missing", f"there is no file '{path}'", None,
                                  suggest(path.name, near) or "Check the path; it counts from the current folder.")])
    try:
        return read(path)
    except (DataError, UsageError):
        raise
    except Exception as error:  # damaged files cause different exceptions in the reader of each format
        reason = (str(error).splitlines() or [""])[0]
        raise _not_a_run(path, reason) from error


def _not_a_run(path: Path, *notes: str) -> DataError:
    return DataError([Problem("run-unreadable", f"'{path}' does not hold a saved run", None,
                              "Write one with `heavebond run MODEL --save " + path.name + "`.",
                              tuple(note for note in notes if note))])


def _form(path: Path, verb: str) -> tuple[Callable[[SavedRun, Path], None], Callable[[Path], SavedRun]]:
    form = _FORMS.get(path.suffix.lower())
    if form is None:
        raise UsageError([Problem("file-suffix", f"'{path.name}' has no suffix by which a run could be {verb}", None,
                                  f"Write {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}.")])
    return form


# -- tables ----------------------------------------------------------------------------------------------------------
def _from_table(table: pd.DataFrame, path: Path, model: str, solver: str = "") -> SavedRun:
    """A table whose first column (or index) is the time; every column needs its unit."""
    heads = [_HEAD.fullmatch(str(column)) for column in table.columns]
    if not heads or heads[0] is None or heads[0]["name"] != "time":
        raise _not_a_run(path, "its first column is not 'time [s]'")
    without = [str(c) for c, head in zip(table.columns, heads, strict=True) if head is None]
    if without:
        raise _not_a_run(path, f"column '{without[0]}' has no unit in brackets")
    wordy = [str(c) for k, c in enumerate(table.columns) if table.dtypes.iloc[k].kind not in "fiu"]
    if wordy:
        raise _not_a_run(path, f"column '{wordy[0]}' holds something that is not a number")
    known = [(head["name"], head["unit"], table.iloc[:, k].to_numpy(float)) for k, head in enumerate(heads) if head]
    return SavedRun(model, known[0][2], {name: values for name, _, values in known[1:]},
                    {name: unit for name, unit, _ in known[1:]}, solver,
                    tuple(head["name"] for head in heads if head and head["mark"]))


def _write_csv(run: SavedRun, path: Path) -> None:
    run.to_pandas().assign(**{ROWS_LEFT: range(len(run.time) - 1, -1, -1)}).to_csv(path)


@cache
def exact_numbers() -> Mapping[str, Any]:
    """The option with which `pandas.read_csv` reads each number to its last bit: none from pandas 3.1 on, which reads so in
    any case and deprecates the option."""
    import pandas as pd

    texts = ("-21237.246935977935", "0.0012267216933965948", "4.337085021863684e-14")  # older versions miss the last bit
    exact = pd.read_csv(StringIO("x\n" + "\n".join(texts)))["x"].to_list() == [float(text) for text in texts]
    return {} if exact else {"float_precision": "round_trip"}


def _read_csv(path: Path) -> SavedRun:
    import pandas as pd

    head = list(pd.read_csv(path, nrows=0).columns)
    if "time [s]" in head[:1] and ROWS_LEFT not in head[-1:]:
        raise _not_a_run(path, f"its last column is not '{ROWS_LEFT}', which shows that no row is missing")
    table = pd.read_csv(path, **exact_numbers())
    if head[-1:] == [ROWS_LEFT]:
        check_rows_left(path, table.pop(ROWS_LEFT).to_numpy(float))
    return _from_table(table, path, path.stem)


def _parquet_missing(verb: str) -> UsageError:
    return UsageError([Problem("pyarrow-missing", f"{verb} Parquet needs pyarrow", None,
                               "pip install 'heavebond[parquet]'")])


def _write_parquet(run: SavedRun, path: Path) -> None:
    table = run.to_pandas()
    table.attrs = {"model": run.model, "solver": run.solver}
    try:
        table.to_parquet(path, engine="pyarrow")
    except ImportError:
        raise _parquet_missing("writing") from None


def _read_parquet(path: Path) -> SavedRun:
    import pandas as pd

    try:
        table = pd.read_parquet(path, engine="pyarrow")
    except ImportError:
        raise _parquet_missing("reading") from None
    return _from_table(table.reset_index(), path, str(table.attrs.get("model", path.stem)),
                       str(table.attrs.get("solver", "")))


# -- MAT and NetCDF --------------------------------------------------------------------------------------------------
def identifiers(names: list[str]) -> list[str]:
    """A MATLAB variable for each name (`crown.x`: `crown_x`), all different from each other and from the file's names."""
    variables: list[str] = []
    for name in names:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        plain = (plain if plain[:1].isalpha() else f"s_{plain}")[:LONGEST_NAME]
        again, number = plain, 2
        while again in variables or again in TAKEN:
            again, number = f"{plain[:LONGEST_NAME - 5]}_{number}", number + 1
        variables.append(again)
    return variables


def _write_mat(run: SavedRun, path: Path) -> None:
    from scipy.io import savemat

    names = run.names()
    variables = identifiers(names)

    def cells(texts: list[str]) -> NDArray[np.object_]:
        return np.array(texts, dtype=object).reshape(-1, 1)

    columns = {variable: run.values[name][:, None] for variable, name in zip(variables, names, strict=True)}
    # required data are last, so that a truncated file lacks them
    marks = {"placeholders": cells(list(run.without_law))} if run.without_law else {}
    savemat(str(path), {"time": run.time[:, None], **columns, **marks, "solver": run.solver, "model": run.model,
                        "variables": cells(variables), "units": cells([run.units[name] for name in names]),
                        "signals": cells(names)}, appendmat=False)


def _read_mat(path: Path) -> SavedRun:
    from scipy.io import loadmat

    raw = loadmat(path)
    missing = [key for key in NEEDED if key not in raw]
    if missing:
        raise _not_a_run(path, f"it has no variable '{missing[0]}'")

    def texts(key: str) -> list[str]:
        return [str(cell.item()) if cell.size else "" for cell in raw[key].ravel()]

    names, variables = texts("signals"), texts("variables")
    values = {name: np.asarray(raw[variable], float).ravel() for name, variable in zip(names, variables, strict=True)}
    return SavedRun("".join(raw["model"].ravel()), np.asarray(raw["time"], float).ravel(), values,
                    dict(zip(names, texts("units"), strict=True)), "".join(raw.get("solver", np.array([])).ravel()),
                    tuple(texts("placeholders")) if "placeholders" in raw else ())


def _write_netcdf(run: SavedRun, path: Path) -> None:
    from scipy.io import netcdf_file

    file: Any
    with netcdf_file(str(path), "w", version=2) as file:
        file.title, file.solver = run.model, run.solver
        file.createDimension("time", len(run.time))
        # `/` separates groups in NetCDF; the original name is in `long_name`
        for name, unit, values in [("time", "s", run.time), *((n, run.units[n], v) for n, v in run.values.items())]:
            variable = file.createVariable(name.replace("/", "|"), "f8", ("time",))
            variable[:] = values
            variable.units, variable.long_name = unit.encode(), name.encode()
            if name in run.without_law:
                variable.placeholder = 1


def _read_netcdf(path: Path) -> SavedRun:
    from scipy.io import netcdf_file

    file: Any
    with netcdf_file(str(path), "r", mmap=False) as file:
        variables = dict(file.variables)
        if "time" not in variables:
            raise _not_a_run(path, "it has no variable 'time'")
        time = np.array(variables.pop("time")[:], float)
        named = {v.long_name.decode(): (v.units.decode(), np.array(v[:], float)) for v in variables.values()}
        return SavedRun(file.title.decode(), time, {n: values for n, (_, values) in named.items()},
                        {n: unit for n, (unit, _) in named.items()}, getattr(file, "solver", b"").decode(),
                        tuple(v.long_name.decode() for v in variables.values() if hasattr(v, "placeholder")))


_FORMS: dict[str, tuple[Callable[[SavedRun, Path], None], Callable[[Path], SavedRun]]] = {
    ".csv": (_write_csv, _read_csv), ".parquet": (_write_parquet, _read_parquet), ".mat": (_write_mat, _read_mat),
    ".nc": (_write_netcdf, _read_netcdf)}
SUFFIXES = tuple(_FORMS)
