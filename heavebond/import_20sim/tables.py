"""Tables of 20-sim: files of two columns beside a model, `table (filename, x)`."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path, PureWindowsPath

from heavebond.core.limits import FILE_BYTES
from heavebond.core.numerals import NUMBER
from heavebond.import_20sim.expressions_parser import Unreadable

MOST_POINTS = 5000
Table = tuple[tuple[float, ...], tuple[float, ...]]  # inputs, which increase, and values


def read_table(folder: Path, name: str, line: int) -> Table:
    """The points of a table in a file of the folder; raises Unreadable. Whatever folders its name has are left out, so that
    nothing but files beside the model is read."""
    file = PureWindowsPath(name).name
    path = folder / file
    if not file or not path.is_file():
        raise Unreadable(line, f"the table '{file or name}' is not beside the model")
    if path.stat().st_size > FILE_BYTES:
        raise Unreadable(line, f"the table '{file}' has more than {FILE_BYTES // 1_000_000} MB")
    points: list[tuple[float, float]] = []
    for row in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = [w for w in re.split(r"[\s,;]+", row.partition("//")[0].partition("%")[0]) if w]
        if len(words) >= 2 and all(re.fullmatch(NUMBER, w) for w in words[:2]):
            points.append((float(words[0]), float(words[1])))
        elif points and words:
            raise Unreadable(line, f"the table '{file}' has a row that is no pair of numbers: {row[:40]}")
    if not 2 <= len(points) <= MOST_POINTS:
        raise Unreadable(line, f"the table '{file}' has {len(points)} points; 2 to {MOST_POINTS} are possible")
    if any(a[0] >= b[0] for a, b in pairwise(points)):
        raise Unreadable(line, f"the inputs of the table '{file}' do not increase")
    return tuple(p[0] for p in points), tuple(p[1] for p in points)

