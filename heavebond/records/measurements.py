"""Measured records: tables with named columns from CSV text, Parquet or MAT, and their checks.

A table stores the line of each row in the file, so that every message names the line.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import DataError, Place, Problem, Problems, UsageError, listing, suggest
from heavebond.core.limits import NUMBER as LARGEST
from heavebond.core.units import Unit
from heavebond.records.clock_times import Clock, ClockProblem, read_clock
from heavebond.records.matlab import read_matlab
from heavebond.records.text_tables import SHOWN, add_few, cell_place, read_text_columns, text_lines, unit_in_file
from heavebond.records.time_axis import FIXED_RATE, TimeAxis

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
TEXT_SUFFIXES = (".csv", ".tsv", ".txt", ".dat")
PARQUET_SUFFIXES = (".parquet", ".pq")
MATLAB_SUFFIXES = (".mat",)
SUFFIXES = (*TEXT_SUFFIXES, *PARQUET_SUFFIXES, *MATLAB_SUFFIXES)  # suffixes of records
GAP_FACTOR = 1.5
BRIDGED = 3  # number of consecutive missing samples of an input that are interpolated without an entry in the file
_NAMED_UNIT = re.compile(r".*\S\s*([\[(][^\[\]()]+[\])])")  # pull [kN], p (bar)
_TAGGED_UNIT = re.compile(r".+?_(lbf?_(?:ft|in)|(?:ft|in)_lbf?|[A-Za-z]{1,4})")  # pressure_Pa, torque_lbf_ft


@dataclass(frozen=True, eq=False)
class Table:
    """A record as in its file: n rows, units not yet applied.

    `header` names all columns; `columns` contains the numeric ones, (n,) each, NaN for an empty cell. `lines` (n,) is
    the line of each row in the file, or its row number if the file has no lines (Parquet, MAT; `text` is None then).
    `aside` gives for other names the reason why they are not columns, and advice; `defects` the mistakes in the cells of
    columns, which are reported when these are used; `units` is a row of units below the
    names; `words` contains the cells (n,) of text columns, `clocks` those that are times (see `timed`).
    """

    path: Path
    header: tuple[str, ...]
    lines: NDArray[np.int64]
    columns: dict[str, Array]
    text: str | None = None
    separator: str = ","
    aside: dict[str, tuple[str, str]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    words: dict[str, list[str]] = field(default_factory=dict)
    clocks: dict[str, Clock] = field(default_factory=dict)
    defects: dict[str, tuple[Problem, ...]] = field(default_factory=dict)

    def place(self, row: int, name: str) -> Place:
        """Place of the cell of column `name` in `row` (from 0)."""
        line = int(self.lines[row])
        if self.text is None:
            return Place(str(self.path), line)
        text = text_lines(self.text)[line - 1]
        return cell_place(str(self.path), line, text, self.separator, self.header.index(name))

    def lines_of(self, rows: Sequence[int]) -> str:
        """`lines 4, 9 and 17 more` for rows counted from 0."""
        word = ("row" if self.text is None else "line") + ("s" if len(rows) > 1 else "")
        return f"{word} {listing([str(self.lines[r]) for r in rows], SHOWN)}"

    def unit_of(self, name: str) -> tuple[str, Unit, bool] | None:
        """The unit of a column in the file, as written and read, and True if it is certain: in a row of units or in
        brackets after the name; after the last underscore of the name it may be another word. None without one."""
        bracket, tag = _NAMED_UNIT.fullmatch(name), _TAGGED_UNIT.fullmatch(name)
        for text, sure in ((self.units.get(name, ""), True), (bracket.group(1) if bracket else "", True),
                           (tag.group(1) if tag else "", False)):
            read = unit_in_file(text)
            if read is not None:
                return text.strip("[]()"), read, sure
        return None

    def unit_text(self, name: str) -> str:
        """The unit of a column in a row of units or in brackets after the name, known or unknown."""
        bracket = _NAMED_UNIT.fullmatch(name)
        return (self.units.get(name, "") or (bracket.group(1) if bracket else "")).strip("[]() ")

    def keep(self, mask: NDArray[np.bool_]) -> Table:
        """The same record with only the rows where `mask` (n,) is true."""
        columns = {name: values[mask] for name, values in self.columns.items()}
        return replace(self, lines=self.lines[mask], columns=columns, words={}, clocks={})


def read_table(path: Path | str, *, place: Place | None = None, beside: str | None = None) -> Table:
    """Read a record in the format of its suffix (.csv, .tsv, .txt, .dat: text; .parquet, .pq; .mat).

    Text has one row of names, optionally a row of units below it, and comments after `#` (see `text_tables`). For a MAT
    file the table contains the vectors with the length of the variable `beside`. `place` is the entry that refers to
    the file. Raises DataError with all mistakes in the rows of the file (those in a column are reported when it is used),
    UsageError for another suffix.
    """
    path = Path(path)
    _must_exist(path, place)
    suffix = path.suffix.lower()
    if suffix in TEXT_SUFFIXES:
        text = read_text_columns(path)
        return Table(path, text.header, text.lines, dict(text.columns), text.text, text.separator, units=dict(text.units),
                     words=dict(text.words), aside=dict(text.aside), defects=dict(text.defects))
    if suffix in PARQUET_SUFFIXES:
        return _read_parquet(path)
    if suffix in MATLAB_SUFFIXES:
        vectors = read_matlab(path, place).beside(beside)
        if not vectors.columns:
            notes = [f"{name} {why}" for name, (why, _) in list(vectors.aside.items())[:SHOWN]]
            hint = next((hint for _, hint in vectors.aside.values()), "Save the time and the channels as vectors.")
            raise DataError([Problem("record-empty", f"'{path.name}' has no vector of numbers", place, hint, tuple(notes))])
        n = len(next(iter(vectors.columns.values())))
        return Table(path, (*vectors.columns, *vectors.aside), np.arange(1, n + 1), vectors.columns, aside=vectors.aside)
    raise UsageError([Problem(
        "record-suffix", f"'{path.name}' is not a supported format of records", place,
        "Export it as CSV (comma, semicolon or tab).",
        (f"read are {', '.join(TEXT_SUFFIXES)} (text), {', '.join(PARQUET_SUFFIXES)} (Parquet) and .mat (MATLAB)",))])


def column(table: Table, name: str, place: Place | None = None) -> Array:
    """The numbers (n,) of a column; `place` is the entry that refers to it. Raises DataError without any."""
    if name in table.columns:
        return table.columns[name]
    file = table.path.name
    if name not in table.header:
        raise DataError([Problem("record-column-unknown", f"'{file}' has no column '{name}'", place,
                                 suggest(name, table.header) or "Name one of its columns.",
                                 (f"its columns are {listing(table.header)}",))])
    if name in table.defects:
        raise DataError(list(table.defects[name]))
    if name in table.aside:
        why, hint = table.aside[name]
        raise DataError([Problem("record-column-kind", f"'{name}' of '{file}' {why}", place, hint)])
    notes = () if table.text is None else (f"for example {table.path}:{table.lines[0]}",)
    raise DataError([Problem(
        "record-column-text", f"column '{name}' of '{file}' holds text or dates, not numbers", place,
        "Name another column; dates are read as the times of a record only.", notes)])


def timed(table: Table, axis: TimeAxis, *, zero: tuple[Path, TimeAxis] | None = None, place: Place | None = None) -> Table:
    """The table with its times in the column `axis.column`: numbers unchanged, clock times (see `clock_times`) as seconds
    since its first row, or since the first row of another file (`zero`), equal steps counted by rows. DataError if a clock
    time cannot be read, if the unit is not s, or if the file has no such column and none that could be the time."""
    name = axis.column
    if axis.every is not None:
        steps = np.arange(len(table.lines), dtype=np.float64)
        return replace(table, columns={**table.columns, name: axis.start + axis.every * steps})
    if name not in table.header and not _has_times(table):
        raise DataError([Problem("record-no-time", f"'{table.path.name}' has no column '{name}', and none that increases "
                                 "from row to row", place, FIXED_RATE, (f"its columns are {listing(table.header)}",))])
    clock = _clock(table, name)
    if clock is None:
        return table
    if axis.unit != "s":
        raise DataError([Problem("record-clock-unit", f"'{name}' of '{table.path.name}' holds times of a clock, which are "
                                 f"counted in s, not in {axis.unit}", place, "Write `unit: s`.")])
    since = clock.first
    if zero is not None and zero != (table.path, axis):
        file, zero_axis = zero
        begin = _clock(read_table(file, beside=zero_axis.column), zero_axis.column)
        if begin is None or begin.dated != clock.dated:
            clock_text = "dates" if clock.dated else "times of day"
            other_clock = f"'{file.name}' has none" if zero_axis.every is not None else \
                f"'{zero_axis.column}' of '{file.name}' does not"
            raise DataError([Problem("record-clocks",
                                     f"'{name}' of '{table.path.name}' holds {clock_text}, {other_clock}: they "
                                     "cannot be put on one clock", place,
                                     "Export both in the same form, or as seconds from the same moment.")])
        since = begin.first
    return replace(table, columns={**table.columns, name: clock.seconds(since)})


def _clock(table: Table, name: str) -> Clock | None:
    """The times of a column; None if it is not a text column."""
    if name not in table.words:
        return table.clocks.get(name)
    try:
        return read_clock(table.words[name])
    except ClockProblem as problem:
        raise DataError([Problem("record-clock", f"the times in '{name}' cannot be read: {problem.message}",
                                 table.place(problem.row, name), problem.hint)]) from problem


def increases(values: Array) -> bool:
    """True if the numbers (n,) of a column increase from row to row; empty cells are ignored."""
    finite = values[np.isfinite(values)]
    return len(finite) > 1 and bool(np.all(np.diff(finite) > 0))


def _has_times(table: Table) -> bool:
    """True if a column could be the time: its numbers increase, or it has text or dates."""
    return bool(table.words or table.clocks) or any(increases(values) for values in table.columns.values())


def check_time(table: Table, name: str) -> None:
    """Raise DataError unless column `name` has at least two times and they increase; rows without a time are ignored here
    (see `samples`)."""
    time = column(table, name)
    finite = np.flatnonzero(np.isfinite(time))
    if len(finite) < 2:
        number = "1 sample" if len(finite) == 1 else f"{len(finite)} samples"
        raise DataError([Problem(
            "record-short", f"the record '{table.path.name}' has {number}, it needs at least 2",
            Place(str(table.path), int(table.lines[0])) if len(time) else None,
            "Check `from:` and `to:`, and the unit of the time." if not len(finite) else "")])
    problems = Problems()
    _report_infinite(table, name, problems)
    steps = np.diff(time[finite])
    where = finite[1:]
    for wrong, code, saying, hint in (
            (steps == 0, "record-time-repeated", "occurs twice",
             "A record has one row per instant: delete one of them, or write the times with more digits."),
            (steps < 0, "record-time-decreasing", "is less than the one before it",
             "Sort the rows by their time. If a second run begins here, make it a separate record, or delete the rows above "
             "it if they remain from an earlier one.")):
        rows = where[wrong].tolist()
        if rows:
            problems.add(code, f"the time {time[rows[0]]:.7g} in '{name}' ({table.lines_of(rows)}) {saying}",
                         table.place(rows[0], name),
                         hint=hint if _has_times(table) else f"{hint} {FIXED_RATE}")
    problems.raise_as(DataError)


def samples(table: Table, time_name: str, name: str, place: Place | None = None, *, least: int = 1, why: str = "") -> Rows:
    """The rows (n,) in which column `name` was sampled; empty and NaN cells are not samples.

    Raises DataError for a column with fewer than `least` numbers (`why` gives the purpose), an infinite one, or one
    without a time.
    """
    time, values = column(table, time_name, place), column(table, name, place)
    problems = Problems()
    _report_infinite(table, name, problems)
    rows = np.flatnonzero(np.isfinite(values))
    timeless = rows[np.isnan(time[rows])].tolist()
    if timeless:
        problems.add("record-time-missing", f"'{name}' has a value where '{time_name}' has none "
                     f"({table.lines_of(timeless)})", table.place(timeless[0], time_name),
                     hint="Write the time, or delete the row.")
    problems.raise_as(DataError)
    if not len(rows):
        raise DataError([Problem(
            "record-channel-empty", f"column '{name}' of '{table.path.name}' has no number in any of its {len(time)} rows",
            place, "Check the column's name, and `from:` and `to:`.")])
    if len(rows) < least:
        raise DataError([Problem(
            "record-channel-short", f"column '{name}' of '{table.path.name}' has {_count(rows)}, at least {least} are "
            f"needed{why}", place, "Give its `noise:`, or check `from:` and `to:`." if why else
            "Check `from:` and `to:`; a channel that was hardly measured is left out of the experiment.")])
    return rows


def gaps(time: Array, missing: int = 0) -> Rows:
    """Gaps of more than `missing` consecutive samples in increasing times (n,): the k for which the step from k to k + 1
    is longer than missing + 1.5 median steps."""
    steps = np.diff(time)
    # the margin keeps times that were rounded when written
    return np.flatnonzero(steps > (missing + GAP_FACTOR) * float(np.median(steps)) * (1 + 1e-6)) if len(steps) else \
        np.zeros(0, dtype=np.int64)


def check_gaps(table: Table, time_name: str, sampled: Mapping[str, Rows], *, begin: float = -np.inf, end: float = np.inf
               ) -> None:
    """Raise DataError if more than 3 samples are missing between the times `begin` and `end` (in the unit of the time
    column), each gap once with its columns. `sampled` are the rows (n,) of each column's samples."""
    time = table.columns[time_name]
    columns_of_gap: dict[tuple[int, int], list[str]] = {}
    usual = {}
    for name, rows in sampled.items():
        column_times = time[rows]
        usual[name] = float(np.median(np.diff(column_times))) if len(column_times) > 1 else 0.0
        for k in gaps(column_times, BRIDGED).tolist():
            if column_times[k + 1] > begin and column_times[k] < end:
                columns_of_gap.setdefault((int(rows[k]), int(rows[k + 1])), []).append(name)
    problems = Problems()
    texts = []
    for (first, last), names in sorted(columns_of_gap.items())[:SHOWN]:
        quoted = listing([f"'{name}'" for name in names], 8)
        have, they = ("have", "they have") if len(names) > 1 else ("has", "it has")
        texts.append((f"a gap: {quoted} {have} no value between the times "
                      f"{time[first]:.7g} ({table.lines_of([first])}) and {time[last]:.7g} ({table.lines_of([last])}); "
                      f"elsewhere {they} one every {usual[names[0]]:.4g}", table.place(last, names[0])))
    these = "these inputs" if any(len(names) > 1 for names in columns_of_gap.values()) else "this input"
    add_few(problems, "record-gap", texts, len(columns_of_gap), "gaps",
            f"Keep one side with `from:` or `to:`, or write `gaps: bridge` at {these} to go across.")
    problems.raise_as(DataError)


def _count(rows: Rows) -> str:
    return "1 number" if len(rows) == 1 else f"{len(rows)} numbers"


def _report_infinite(table: Table, name: str, problems: Problems) -> None:
    values = table.columns[name]
    rows = np.flatnonzero(np.abs(values) > LARGEST).tolist()
    if rows:
        problems.add("record-value", f"'{name}' has an infinite value, or one beyond {LARGEST:g}, in {len(rows)} of "
                     f"{len(values)} rows ({table.lines_of(rows)})", table.place(rows[0], name),
                     hint="Empty these cells: an empty cell is a sample that was not taken.")


def _must_exist(path: Path, place: Place | None) -> None:
    if path.is_file():
        return
    if path.is_dir():
        raise DataError([Problem("record-missing", f"'{path}' is a folder, not a record", place,
                                 "Give a file in it.")])
    if not path.parent.is_dir():
        raise DataError([Problem("record-missing", f"there is no folder '{path.parent}' for '{path.name}'", place,
                                 "Check the path; it counts from the folder of the file that names it.")])
    files = sorted(f.name for f in path.parent.iterdir() if f.is_file())
    notes = (f"files there: {listing(files)}",) if files else ("the folder has no files",)
    near = suggest(path.name, files)
    if place is None and any(" " in name and f"'{name}'" in near for name in files):
        near += " A name with spaces needs quotes on the command line."
    raise DataError([Problem("record-missing", f"there is no file '{path.name}' in '{path.parent}'", place,
                             near or "Put the record there, or give the path of another one; it "
                             "counts from the folder of the file that names it.", notes)])


def _read_parquet(path: Path) -> Table:
    import pandas as pd

    try:
        frame = pd.read_parquet(path)
    except ImportError as error:
        raise DataError([Problem("record-parquet", f"'{path.name}' needs a library that is not installed",
                                 None, "pip install pyarrow")]) from error
    except (ValueError, OSError) as error:
        raise DataError([Problem("record-parquet", f"'{path}' is not a Parquet file that can be read", None,
                                 "", (str(error).splitlines()[0],))]) from error
    if frame.index.name is not None or isinstance(frame.index, (pd.DatetimeIndex, pd.TimedeltaIndex)):
        frame = frame.reset_index()
    if not len(frame):
        raise DataError([Problem("record-empty", f"'{path}' has no rows")])
    numbers = {str(name): frame[name].to_numpy(dtype=np.float64, na_value=np.nan) for name in frame.columns
               if pd.api.types.is_numeric_dtype(frame[name])}
    clocks: dict[str, Clock] = {}
    for name in frame.columns:
        if frame[name].dtype.kind in "mM":
            # dates or durations in ns, for any zone and resolution
            values = frame[name]
            if getattr(values.dt, "tz", None) is not None:
                values = values.dt.tz_convert(None)
            clocks[str(name)] = Clock(np.asarray(values.to_numpy().astype(f"{values.dtype.kind}8[ns]").astype(np.int64)),
                                      frame[name].dtype.kind == "M")
    words = {str(name): [str(cell) for cell in frame[name].fillna("")] for name in frame.columns
             if pd.api.types.is_string_dtype(frame[name]) and str(name) not in numbers}
    return Table(path, tuple(map(str, frame.columns)), np.arange(1, len(frame) + 1), numbers, words=words, clocks=clocks)
