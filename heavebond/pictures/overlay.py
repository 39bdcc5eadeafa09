"""Files for a common plot: saved runs, experiments with their records, and plain records."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from heavebond.core.errors import DataError, Problem, UsageError, listing, suggest
from heavebond.core.units import UnitProblem, read_unit
from heavebond.records.saved_runs import SUFFIXES, SavedRun, read_run

EXPERIMENT = (".yaml", ".yml", "")  # the last: the name of a bundled one
SECONDS = ("time", "s")
MOST_SIGNALS = 6  # signals drawn by default


@dataclass(frozen=True)
class Column:
    """The column of a signal in a record: `crown.x=crown_m m` is column `crown_m` in m."""

    signal: str
    name: str
    unit: str


@dataclass(frozen=True)
class Overlay:
    """The runs and records of a common plot, by label; the labels in `measured` are records."""

    runs: dict[str, SavedRun]
    measured: tuple[str, ...]


def read_column(text: str) -> Column:
    """`SIGNAL=COLUMN UNIT`; UsageError for a text of another form or an unknown unit."""
    signal, sign, column_text = (part.strip() for part in text.partition("="))
    name, _, unit = column_text.rpartition(" ")
    if not (sign and signal and name.strip()):
        raise UsageError([Problem("column-form", f"--column {text}: this is not SIGNAL=COLUMN UNIT", None,
                                  "Write for example --column 'crown.x=crown_m m'.")])
    try:
        read_unit(unit)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"--column {text}: {problem.message}", None, problem.hint)]) from None
    return Column(signal, name.strip(), unit)


def read_overlay(files: Iterable[str], columns: Iterable[Column] = (), record: str = "") -> Overlay:
    """Read all files: saved runs by their suffix, experiments by `.yaml` or their bundled name, any other table as a
    record whose columns `columns` assigns. `record` selects a record of an experiment, by default the first. Raises
    UsageError and DataError for files that cannot be read.
    """
    wanted, paths = list(columns), [Path(file) for file in files]
    runs: dict[str, SavedRun] = {}
    measured = []
    for path in paths:
        run, real = _read(path, wanted, record)
        label = _label(path, paths) + (f" ({run.model})" if path.suffix in EXPERIMENT else "")
        runs[label] = run
        measured += [label] if real else []
    return Overlay(runs, tuple(measured))


def _label(path: Path, paths: list[Path]) -> str:
    """The file's name, with its folder and suffix if another file has the same name."""
    if sum(sibling.stem == path.stem for sibling in paths) == 1:
        return path.stem
    return path.name if sum(sibling.name == path.name for sibling in paths) == 1 else str(path)


def _read(path: Path, columns: list[Column], record: str) -> tuple[SavedRun, bool]:
    """The file as signals, and True if they were measured."""
    if path.suffix in EXPERIMENT:
        from heavebond.estimation.experiment import load_experiment
        from heavebond.estimation.records import measure

        # the channels of one record, by their names and by their formulas
        experiment = load_experiment(path)
        if record and record not in experiment.records:
            raise UsageError([Problem("record-unknown", f"the experiment has no record '{record}'", None, suggest(
                record, experiment.records) or f"Records: {listing(experiment.records)}.")])
        chosen = experiment.records[record or next(iter(experiment.records))]
        measured = measure(experiment, chosen)
        values: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}
        for name, channel in measured.channels.items():
            course = np.full(len(measured.grid), np.nan)
            course[channel.index] = channel.measured
            for called in (name, channel.output.shown.text.strip()):
                values[called], units[called] = course, channel.output.shown.unit
        return SavedRun(chosen.name, measured.grid, values, units), True
    try:
        return read_run(path), False
    except (DataError, UsageError) as error:
        if {problem.code for problem in error.problems} - {"run-unreadable", "file-suffix"}:
            raise
        if not columns:
            raise UsageError([Problem(
                "record-undescribed", f"'{path.name}' is not a saved run, and a record needs --column for its columns", None,
                "Write --column SIGNAL='COLUMN UNIT', for example --column crown.x='crown_m m', or give the experiment that "
                "describes it.", (f"saved runs end in {', '.join(SUFFIXES)}; `heavebond run MODEL --save FILE` writes them",
                                  ))]) from None
    from heavebond.records.measurements import check_time, column, read_table, timed
    from heavebond.records.time_axis import TimeAxis

    # the named columns of a record; its first column is the time in s, or a column called `time` in --column
    table = read_table(path)
    axis = next((TimeAxis(c.name, c.unit) for c in columns if c.signal == SECONDS[0]), TimeAxis(table.header[0]))
    table = timed(table, axis)
    check_time(table, axis.column)
    time = column(table, axis.column) * axis.scale
    timed_rows = np.isfinite(time)
    named = [c for c in columns if c.signal != SECONDS[0]]
    return SavedRun(path.stem, time[timed_rows], {c.signal: column(table, c.name)[timed_rows] for c in named},
                    {c.signal: c.unit for c in named}), True


def common_signals(overlay: Overlay) -> list[str]:
    """Default signals: the first that all files hold. UsageError if there is none."""
    first, *further_runs = overlay.runs.values()
    common = [name for name in first.names() if all(name in run.values for run in further_runs)]
    if not common:
        raise UsageError([Problem("nothing-to-plot", "the files have no signal in common", None,
                                  "Name what to draw: --signal crown.x.", tuple(f"{label}: {listing(run.names(), 8)}"
                                                                                for label, run in overlay.runs.items()))])
    return common[:MOST_SIGNALS]
