"""Tables of 20-sim in files in the folder of a model: of two columns, `table (filename, x)`, and of two inputs,
`Table2D.dll`.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path, PureWindowsPath

from heavebond.core.limits import FILE_BYTES
from heavebond.core.numerals import NUMBER
from heavebond.import_20sim.expressions_parser import Unreadable

MOST_POINTS = 5000
MOST_OF_GRID = 10_000  # limit of values of a table of two inputs, which the equations list
Table = tuple[tuple[float, ...], tuple[float, ...]]  # inputs, in increasing order, and values
Grid = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]  # inputs of rows and of columns, values row by row


def read_table(folder: Path, name: str, line: int) -> Table:
    """The points of a table in a file of the folder; raises Unreadable."""
    file, rows = _rows(folder, name, line)
    points: list[tuple[float, float]] = []
    for words in rows:
        if len(words) >= 2 and all(re.fullmatch(NUMBER, w) for w in words[:2]):
            points.append((float(words[0]), float(words[1])))
        elif points:
            raise Unreadable(line, f"the table '{file}' has a row that is not a pair of numbers: {' '.join(words)[:40]}")
    if not 2 <= len(points) <= MOST_POINTS:
        raise Unreadable(line, f"the table '{file}' has {len(points)} points; 2 to {MOST_POINTS} are possible")
    if any(a[0] >= b[0] for a, b in pairwise(points)):
        raise Unreadable(line, f"the inputs of the table '{file}' do not increase")
    return tuple(p[0] for p in points), tuple(p[1] for p in points)


def read_grid(folder: Path, name: str, line: int) -> Grid:
    """A table of two inputs in a file of the folder: a number that is not used and the inputs of the columns in the first
    row, the input of the row and its values in the others. Raises Unreadable."""
    file, rows = _rows(folder, name, line)
    wrong = next((words for words in rows if not all(re.fullmatch(NUMBER, w) for w in words)), None)
    if wrong is not None:
        raise Unreadable(line, f"the table '{file}' has a row that is not of numbers: {' '.join(wrong)[:40]}")
    numbers = [tuple(map(float, words)) for words in rows]
    if len(numbers) < 3 or len(numbers[0]) < 3 or len({len(row) for row in numbers}) != 1:
        raise Unreadable(line, f"the table '{file}' is not a matrix of two inputs, with at least three rows and columns")
    if (size := (len(numbers) - 1) * (len(numbers[0]) - 1)) > MOST_OF_GRID:
        raise Unreadable(line, f"the table '{file}' has {size} values; {MOST_OF_GRID} are possible: leave out "
                         "rows and columns that matter little")
    of_rows, of_columns = tuple(row[0] for row in numbers[1:]), numbers[0][1:]
    if any(a >= b for inputs in (of_rows, of_columns) for a, b in pairwise(inputs)):
        raise Unreadable(line, f"the inputs of the table '{file}' do not increase")
    return of_rows, of_columns, tuple(v for row in numbers[1:] for v in row[1:])


def _rows(folder: Path, name: str, line: int) -> tuple[str, list[list[str]]]:
    """The name of a file, and its nonempty rows as words. Folders in the name are ignored, so that only files in the
    folder of the model are read."""
    file = PureWindowsPath(name).name
    path = folder / file
    if not file or not path.is_file():
        raise Unreadable(line, f"the table '{file or name}' is not in the folder of the model")
    if path.stat().st_size > FILE_BYTES:
        raise Unreadable(line, f"the table '{file}' has more than {FILE_BYTES // 1_000_000} MB")
    rows = [[w for w in re.split(r"[\s,;]+", row.partition("//")[0].partition("%")[0]) if w]
            for row in path.read_text(encoding="utf-8", errors="replace").splitlines()]
    return file, [words for words in rows if words]
