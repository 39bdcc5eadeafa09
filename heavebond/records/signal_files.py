"""Signals from files: a saved run, or a record of a data logger."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from heavebond.core.errors import DataError, UsageError
from heavebond.core.units import UnitProblem, read_unit
from heavebond.records.measurements import check_time, column, read_table, samples, timed
from heavebond.records.saved_runs import read_run
from heavebond.records.spectra import EvenSignal, evenly

_HEAD = re.compile(r"(?P<name>.+?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*")


def read_courses(path: Path, names: Sequence[str], *, time: str | None = None, begin: float = 0.0,
                 end: float = float("inf")) -> list[EvenSignal]:
    """Signals of a file between two times (s).

    A saved run has units; in a record `time` is the column of the times in s (the first by default), and a unit is read
    from brackets in the header. DataError and UsageError as for these files.
    """
    try:
        run = read_run(path)
    except DataError as error:
        if time is None and error.problems[0].code != "run-unreadable":
            raise
    except UsageError as error:
        if error.problems[0].code != "file-suffix":
            raise
    else:
        inside = (run.time >= begin) & (run.time <= end)
        return [evenly(name, run.unit(name), run.time[inside], run.display[name][inside]) for name in names]
    return _of_record(path, names, time, begin, end)


def _of_record(path: Path, names: Sequence[str], time: str | None, begin: float, end: float) -> list[EvenSignal]:
    table = read_table(path, beside=time)
    time = time or table.header[0]
    table = timed(table, time)
    check_time(table, time)
    signals = []
    for name in names:
        head = next((h for h in table.header if (m := _HEAD.fullmatch(h)) and m["name"] == name), name)
        rows = samples(table, time, head)
        t = column(table, time)[rows]
        inside = (t >= begin) & (t <= end)
        signals.append(evenly(name, _unit(head), t[inside], column(table, head)[rows][inside]))
    return signals


def _unit(head: str) -> str:
    known = _HEAD.fullmatch(head)
    try:
        return read_unit(known["unit"]).text if known else ""
    except UnitProblem:
        return ""
