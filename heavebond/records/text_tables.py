"""Text files of data loggers and spreadsheets as columns of numbers, with the line and cell of every mistake.

Accepted are the usual output formats of programs: UTF-8, UTF-16 with byte order mark, or Windows-1252; commas, semicolons
or tabs between the columns, or the separator of a first line `sep=;`; decimal points, or decimal commas throughout; a row
of units below the names. The settings of a data logger above the names are skipped.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import DataError, Place, Problem, Problems, listing
from heavebond.core.limits import COLUMNS
from heavebond.core.numerals import number, plain
from heavebond.core.units import Unit, UnitProblem, read_unit

Array = NDArray[np.float64]
Cells = list[tuple[int, list[str]]]
SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas"}
SHOWN = 5
LAST = 20  # rows at the end of a table by which its columns of numbers are recognised
MOST_KEPT = 50_000_000  # characters of a file that is cached
# The last column of a saved run: the number of rows that follow. A truncated file does not end with 0.
ROWS_LEFT = "rows left [1]"
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "?"}
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?")
_DECIMAL_POINT = re.compile(r"[+-]?[0-9]*\.[0-9]+([eE][+-]?[0-9]+)?")
# ambiguous: 1,234 may be one and a quarter, or more than a thousand
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(([.' ][0-9]{3})+,[0-9]+|([,' ][0-9]{3})+\.[0-9]+|(,[0-9]{3}){2,}|(\.[0-9]{3}){2,})")
_LONGEST_UNIT = 12
# Spellings in the files of programs, and in this program.
_SPELT = (("°C", "degC"), ("°F", "degF"), ("°", "deg"), ("µ", "u"), ("μ", "u"), ("²", "**2"), ("³", "**3"), ("^", "**"),
          ("·", "*"))
_WORDS = {"-": "1", "–": "1", "sec": "s", "Sek": "s", "l/min": "L/min", "l": "L", "U/min": "rpm",
          "min-1": "1/min", "RPM": "rpm", "C": "degC", "Grad": "deg", "Min": "min", "Nm": "N*m", "kNm": "kN*m",
          "mNm": "mN*m", "Ncm": "N*cm", "Nmm": "N*mm", "N.m": "N*m", "kN.m": "kN*m",
          **{text: f"lbf*{length}" for length in ("ft", "in") for sign in "-_*. " for text in
             (f"lb{sign}{length}", f"lbf{sign}{length}", f"{length}{sign}lb", f"{length}{sign}lbf")}}


@dataclass(frozen=True, eq=False)
class TextColumns:
    """A text file as columns: `header` names all; `columns` contains the numeric ones (n,); `lines` (n,) is the line of
    each row; `units` the row of units below the names; `words` the cells (n,) of columns of text. `aside` gives for a name
    of several columns the reason why it is none, and advice, `defects` the cells of a column that are not numbers between
    others that are."""

    header: tuple[str, ...]
    lines: NDArray[np.int64]
    columns: dict[str, Array]
    text: str
    separator: str
    units: dict[str, str] = field(default_factory=dict)
    words: dict[str, list[str]] = field(default_factory=dict)
    aside: dict[str, tuple[str, str]] = field(default_factory=dict)
    defects: dict[str, tuple[Problem, ...]] = field(default_factory=dict)


def read_text_columns(path: Path) -> TextColumns:
    """Read a text file; DataError with all mistakes in its rows. Mistakes in the cells of a column are returned with it:
    they matter only if it is used.

    The last few files are cached by their text: a comparison reads a record for its inputs and for its outputs, and a
    diagnosis compares many times."""
    text = _decode(path)
    return _cached_columns(path, text) if len(text) <= MOST_KEPT else _columns(path, text)


@lru_cache(maxsize=4)
def _cached_columns(path: Path, text: str) -> TextColumns:
    columns = _columns(path, text)
    for values in (columns.lines, *columns.columns.values()):
        values.flags.writeable = False  # the cached arrays are shared
    return columns


def _columns(path: Path, text: str) -> TextColumns:
    sheet = _cut(str(path), text)
    problems = Problems()
    line, header = sheet.header
    if len(header) > COLUMNS:
        raise DataError([Problem("record-columns", f"the row of names has {len(header)} columns; up to {COLUMNS} are read",
                                 Place(sheet.file, line),
                                 "Keep the columns that are needed; is the table turned on its side?")])
    if header and all(_is_number(name) for name in header):
        above = line > 1 and sheet.lines[line - 2].lstrip().startswith("#")
        hint = "Remove the # in front of the names." if above else "Write for example `time_s,heave_m`."
        problems.add("record-header", "the first row must name the columns; these are numbers",
                     sheet.place(line, 0), hint=hint)
    elif len(header) == 1 and (separator := _other_separator(sheet)):
        problems.add("record-separator", f"the columns seem to be separated by {separator}", sheet.place(line, 0),
                     hint="Separate them by commas, semicolons or tabs.")
    width = len(sheet.header[1])
    rows, units = _without_units_row(sheet, problems)
    rows = _full_rows(sheet, rows, problems)
    # convert decimal commas to points, if all fractions of the file have them and no comma can separate thousands; else
    # return the rows unchanged, and the reason
    cells = [cell for _, row in rows for cell in row if "," in cell or "." in cell]
    commas = [cell for cell in cells if _DECIMAL_COMMA.fullmatch(cell)]
    if sheet.separator == "," or any(map(_DECIMAL_POINT.fullmatch, cells)):
        written, why = rows, "other numbers here may have decimal points"
    elif all(map(_THOUSANDS.fullmatch, commas)):
        written, why = rows, "or is it a comma between thousands?"
    else:
        written, why = [(line, [c.replace(",", ".") if _DECIMAL_COMMA.fullmatch(c) else c for c in row])
                        for line, row in rows], ""
    columns = [_numbers([cells[k] for _, cells in written]) for k in range(width)]
    if not sheet.rows:
        problems.add("record-empty", f"'{path.name}' has names but no rows", sheet.place(sheet.header[0], 0),
                     hint="Below the names, a record has one row for each instant.")
    problems.raise_as(DataError)
    names = tuple(sheet.header[1])
    if names[-1] == ROWS_LEFT:
        check_rows_left(path, columns[-1][0] if columns[-1][0] is not None else np.zeros(0))
    aside = _without_own_name(names)
    defects = {name: _wrong_cells(sheet, rows, k, bad, why) for k, (name, (_, bad)) in enumerate(
        zip(names, columns, strict=True)) if bad and name not in aside}
    numbers = {name: values for name, (values, _) in zip(names, columns, strict=True)
               if values is not None and name not in aside and name not in defects}
    words = {name: [cells[k] for _, cells in rows] for k, name in enumerate(names)
             if name not in numbers and name not in aside and name not in defects}
    lines = np.array([line for line, _ in rows], dtype=np.int64)
    return TextColumns(names, lines, numbers, text, sheet.separator, dict(zip(names, units, strict=False)), words, aside,
                       defects)


def check_rows_left(path: Path, counts: Array) -> None:
    """Raise DataError unless the counts of remaining rows, the last column of a saved run, decrease to 0: the file was
    truncated while it was written or copied, or rows were removed."""
    expected = np.arange(len(counts) - 1, -1, -1)
    if len(counts) and np.array_equal(counts, expected):
        return
    steady = counts[:-1] == counts[:1] - np.arange(len(counts))[:-1]  # the last line may be truncated itself
    line = len(counts) + 1 if steady.all() else int(np.argmin(steady)) + 2
    defect = "ends before its last row" if steady.all() else f"lacks rows before line {line}"
    raise DataError([Problem("record-cut-off", f"'{path}' is not whole: it {defect}", Place(str(path), line),
                             "It was cut off by a full disk, a killed process or a broken copy: make it again. Where rows "
                             f"were removed on purpose, remove the column '{ROWS_LEFT}', and use the file as a record.",
                             (f"its column '{ROWS_LEFT}' counts the rows that are still to come",))])


def unit_in_file(text: str) -> Unit | None:
    """A unit in the notation of other programs (`°C`, `l/min`, `[kN]`, `m/s²`); None if it is not a unit."""
    text = text.strip().strip("[]()").strip()
    text = _WORDS.get(text, text)
    for spelt, read in _SPELT:
        text = text.replace(spelt, read)
    if not text or len(text) > _LONGEST_UNIT:
        return None
    try:
        return read_unit(text)
    except UnitProblem:
        return None


def text_lines(text: str) -> list[str]:
    """The lines in the count of an editor: not splitlines(), which also splits at form feeds."""
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def cell_place(file: str, line: int, text: str, separator: str, cell: int) -> Place:
    """Place of cell `cell` (from 0) of a line; the end of the line if it has fewer cells."""
    start, count, quoted = 0, 0, False
    for k, letter in enumerate(text + separator):
        quoted ^= letter == '"'
        if letter != separator or quoted:
            continue
        if count == cell:
            inner = text[start:k]
            blank = len(inner) - len(inner.lstrip())
            return Place(file, line, start + blank + 1, text, max(1, len(inner.strip())))
        start, count = k + 1, count + 1
    return Place(file, line, len(text) + 1, text)


@dataclass(frozen=True)
class _Sheet:
    """The text of a record, split into cells: `rows` are (line, cells), without comments and blank lines."""

    file: str
    lines: list[str]
    separator: str
    header: tuple[int, list[str]]
    rows: Cells

    def place(self, line: int, cell: int) -> Place:
        return cell_place(self.file, line, self.lines[line - 1], self.separator, cell)


def _decode(path: Path) -> str:
    raw = path.read_bytes()
    if raw.startswith(b"PK\x03\x04"):
        raise DataError([Problem("record-encoding", f"'{path.name}' is a workbook or an archive, not text",
                                 Place(str(path), 1), "Open it in the program that wrote it and save it as CSV.")])
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        place = Place(str(path), raw[:error.start].count(b"\n") + 1)
    try:
        # usual encoding of spreadsheets on Windows in the west; names may be read wrongly, numbers not
        return raw.decode("cp1252")
    except UnicodeDecodeError as error:
        raise DataError([Problem("record-encoding", f"'{path.name}' is not text", place,
                                 "Save it again as CSV in UTF-8.")]) from error


def _cut(file: str, text: str) -> _Sheet:
    lines = text_lines(text)
    content = [(k, line) for k, line in enumerate(lines, 1)
               if line.strip() and not line.lstrip().startswith("#")]
    declared = re.fullmatch(r'"?sep=(.)"?[;,\t]*', content[0][1].strip("\r ")) if content else None
    content = content[1:] if declared else content
    if not content:
        raise DataError([Problem("record-empty", f"'{Path(file).name}' has no rows", Place(file, 1),
                                 "A record begins with a row that names the columns.")])
    separator = declared.group(1) if declared else _separator([line for _, line in content])
    if '"' in text:
        cells = [next(csv.reader([line], delimiter=separator)) for _, line in content]
    else:
        cells = [line.split(separator) for _, line in content]
    rows = [(k, [cell.strip() for cell in row]) for (k, _), row in zip(content, cells, strict=True)]
    if all(row and row[-1] == "" for _, row in rows) and len(rows[0][1]) > 1:
        rows = [(k, row[:-1]) for k, row in rows]  # every line ends with a separator
    rows = rows[_settings(rows):]
    return _Sheet(file, lines, separator, rows[0], rows[1:])


def _separator(lines: Sequence[str]) -> str:
    """The separator of the columns: the most frequent one of the first line. If the last line does not have as many, the
    first one may be a title; then it is the one that the last lines have in common."""
    first = max(SEPARATORS, key=lines[0].count)
    if lines[0].count(first) == lines[-1].count(first) > 0:
        return first
    last = [{line.count(sign) for line in lines[1:][-3:]} for sign in SEPARATORS]
    return next((sign for sign, counts in zip(SEPARATORS, last, strict=True) if len(counts) == 1 and 0 not in counts), first)


def _settings(rows: Cells) -> int:
    """Number of rows above the names that are a title or the settings of a data logger.

    The numbers begin with the first row that has a number in a column of numbers, and no text in any of these. The names
    are the row above them with a text in each of these columns; or the first of several such rows, since the second may
    be the units. A row above them cannot be the names: it is padded with empty cells, has fewer cells, or has a number.
    """
    width = len(rows[-1][1])
    last = [cells for _, cells in rows[-max(1, min(LAST, len(rows) // 4)):] if len(cells) == width]
    numeric = [k for k in range(width) if any(_is_written_number(cells[k]) for cells in last)
               and all(_is_written_number(cells[k]) or cells[k].lower() in _MISSING for cells in last)]

    def names(k: int) -> bool:
        cells = rows[k][1]
        return len(cells) == width and all(cells[n] for n in numeric) and not any(map(_is_written_number, cells))

    def numbers(cells: list[str]) -> bool:
        return len(cells) == width and any(_is_written_number(cells[k]) for k in numeric) and all(
            _is_written_number(cells[k]) or cells[k].lower() in _MISSING for k in numeric)

    first = next((k for k, (_, cells) in enumerate(rows) if numbers(cells)), 0)
    named = next((k for k in reversed(range(first)) if names(k)), 0)
    while named and names(named - 1):
        named -= 1
    return named


def _other_separator(sheet: _Sheet) -> str:
    """The separator of a table that seems to have only one column; empty if there is none."""
    for sign, name in ((None, "spaces"), ("|", "`|`"), (":", "`:`"), ("/", "`/`")):
        columns = {len(cells[0].split(sign)) for _, cells in (sheet.header, *sheet.rows) if cells}
        if sheet.rows and len(columns) == 1 and columns != {1} and all(
                _is_number(cell.strip()) for cell in sheet.rows[0][1][0].split(sign)):
            return name
    return ""


def _without_own_name(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """The reason why a name does not denote one column, and advice, by name."""
    columns: dict[str, list[int]] = {}
    for k, name in enumerate(names, 1):
        columns.setdefault(name, []).append(k)
    return {name: (f"is the name of {len(at)} columns ({listing([str(k) for k in at], SHOWN)})" if name else
                   f"is no name: column {at[0]} has none", "Give each column a different name in the file.")
            for name, at in columns.items() if len(at) > 1 or not name}


def _without_units_row(sheet: _Sheet, problems: Problems) -> tuple[Cells, list[str]]:
    """The rows of numbers, and the cells of a row of units between them and the names; [] without one."""
    if len(sheet.rows) < 2:
        return sheet.rows, []
    (line, first), (_, second) = sheet.rows[:2]
    if not any(first) or any(map(_is_written_number, first)) or not any(map(_is_written_number, second)):
        return sheet.rows, []
    if any(unit_in_file(cell) for cell in first):
        return sheet.rows[1:], first
    problems.add("record-units-row", f"line {sheet.header[0]} seems to name the columns, and the row below it has neither "
                 "numbers nor units", sheet.place(line, 0),
                 hint="One row of names is permitted above the numbers, and a row of units below it. Put a # in front of "
                 f"line {line}, or in front of line {sheet.header[0]} if the names are in line {line}.")
    return sheet.rows[1:], []


def _full_rows(sheet: _Sheet, rows: Cells, problems: Problems) -> Cells:
    width = len(sheet.header[1])
    ragged = [row for row in rows if len(row[1]) != width]
    hint = f"The columns are taken to be separated by {SEPARATORS.get(sheet.separator, sheet.separator)}, as in the row " \
        "of names; lines above that row begin with #."
    if ragged and sheet.separator == "," and all(len(cells) == 2 * width for _, cells in rows):
        line, cells = ragged[0]
        problems.add("decimal-comma", f"each row has {2 * width} cells for {width} names: the numbers seem "
                     f"to have decimal commas ('{cells[0]},{cells[1]}')", sheet.place(line, 0),
                     hint="Export the table with semicolons between the columns, or with decimal points.")
        return []
    if ragged and sheet.separator == "," and all(len(cells) > width for _, cells in ragged) and all(
            cell.lstrip("+-").isdigit() for _, cells in ragged[:SHOWN] for cell in cells):
        hint = "If the numbers have decimal commas, export the table with semicolons between the columns, or with decimal " \
            f"points. {hint}"
    issues = [(f"this row has {len(cells)} cell{'s' * (len(cells) > 1)}, the row of names has {width}",
               sheet.place(line, min(width, len(cells)))) for line, cells in ragged[:SHOWN]]
    add_few(problems, "record-ragged", issues, len(ragged), "rows", hint)
    return [row for row in rows if len(row[1]) == width]


def _is_number(cell: str) -> bool:
    try:
        number(cell)
    except ValueError:
        return False
    return True


def _is_written_number(cell: str) -> bool:
    return _is_number(cell) or _DECIMAL_COMMA.fullmatch(cell) is not None


def _numbers(cells: list[str]) -> tuple[Array | None, list[int]]:
    """The numbers of a column, NaN for an empty cell (None if all is text), and the rows with text."""
    if plain(cells):
        try:
            return np.array(cells, dtype=np.float64), []
        except ValueError:
            pass
    values = np.full(len(cells), np.nan)
    bad = []
    for row, cell in enumerate(cells):
        if _is_number(cell):
            values[row] = number(cell)
        elif cell.lower() not in _MISSING:
            bad.append(row)
    if bad and np.isnan(values).all() and not any(_DECIMAL_COMMA.fullmatch(cells[row]) for row in bad):
        return None, []
    return values, bad


def _wrong_cells(sheet: _Sheet, rows: Cells, k: int, bad: list[int], why: str) -> tuple[Problem, ...]:
    """The cells of column k in the rows `bad`, which are not numbers; `why` is the reason why decimal commas could not be
    read."""
    problems = Problems()
    commas = [row for row in bad if _DECIMAL_COMMA.fullmatch(rows[row][1][k])]
    grouped = [row for row in bad if row not in commas and _GROUPED.fullmatch(rows[row][1][k])]
    words = [row for row in bad if row not in commas and row not in grouped]
    for rows_wrong, code, defect, hint in (
            (commas, "decimal-comma", f"has a decimal comma; {why}",
             "Export the table with decimal points, without separators of thousands."),
            (grouped, "record-thousands", "has separators of thousands", "Export the table without them."),
            (words, "record-text", "is not a number",
             "Write a number, or empty the cell: a sample that was not taken.")):
        few = [(f"'{rows[row][1][k]}' in column '{sheet.header[1][k]}' {defect}", sheet.place(rows[row][0], k))
               for row in rows_wrong[:SHOWN]]
        add_few(problems, code, few, len(rows_wrong), "cells", hint)
    return tuple(problems.found)


def add_few(problems: Problems, code: str, issues: Sequence[tuple[str, Place]], total: int, noun: str,
            hint: str) -> None:
    """Report `issues`, which are the first of `total`; the last report states the number of the others."""
    for k, (message, place) in enumerate(issues):
        left_out = total - len(issues) if k == len(issues) - 1 else 0
        problems.add(code, message, place, hint=hint,
                     notes=[f"and {left_out} more such {noun} in this file"] if left_out else [])
