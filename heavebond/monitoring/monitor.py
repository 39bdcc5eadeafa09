"""Monitoring of machines in service: every record is filtered, and the records that leave the model are reported.

Each record runs through the Kalman filter of its machine. Sums of the normalised innovations decide if the record leaves the
model (see `change_detection`); the faults that are possible in its diagram date the change (see `onset`).
`Monitoring.window` is the experiment on the time before and after a change, for `diagnose`. Records are handled in groups,
each in one task of a process or of a cluster, so that a task assembles the equations once. A record that cannot be read or
filtered is reported with the reason, and the others continue.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from heavebond.core import facade
from heavebond.core.cancellation import clear_signal
from heavebond.core.cluster import Cluster
from heavebond.core.errors import DataError, HeavebondError, Problem, UsageError, listing
from heavebond.core.parallel import Processes, as_done, processors
from heavebond.core.presentation import brief, count, number
from heavebond.core.progress import Progress
from heavebond.core.quantities import si_value
from heavebond.core.reporting import reporting
from heavebond.core.units import read_unit
from heavebond.core.writable import new_file
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, Origin, Record, load_experiment
from heavebond.estimation.faulty_columns import frozen_notes
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.monitoring.change_detection import find_change
from heavebond.monitoring.estimates import StateEstimate
from heavebond.monitoring.kalman_filter import Estimator, Reference
from heavebond.monitoring.onset import FaultOnset
from heavebond.numerics.dae import Array
from heavebond.records.measurements import SUFFIXES as RECORD_SUFFIXES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

FALSE_ALARMS = 0.01  # probability of an alarm in a record of a sound machine
IN_MODEL, CHANGED, UNUSABLE = "in the model", "changed", "unusable"
GROUPS = 4  # groups of records for each worker, so that all of them end at about the same time
LARGEST_GROUP = 50  # records


@dataclass(frozen=True)
class MonitoredRecord:
    """One record of a folder: its `outcome` ("in the model", "changed", "unusable") and the `reason` of the last.

    samples: number of innovations; nis: their mean square, 1 if model and noise are right, with the bounds `low` and `high`
    that contain it with 95 % probability; alarm: time of the alarm; change: estimated time of the change (the median),
    between `earliest` and `latest` with 95 % probability; statistic: the sum that raised the alarm. Times in s; nan without
    a change.
    """

    name: str
    file: str
    outcome: str
    reason: str = ""
    samples: int = 0
    nis: float = math.nan
    low: float = math.nan
    high: float = math.nan
    alarm: float = math.nan
    change: float = math.nan
    earliest: float = math.nan
    latest: float = math.nan
    statistic: str = ""


@dataclass(frozen=True)
class Monitoring(facade.Displayed):
    """The records of a folder, each with its outcome, in the order of their names.

    `rate` is the stated probability of a false alarm in a record; `walks` and `start_deviation` are the settings of the
    filter; `estimates` are the estimates by record, for changed records only, or for all records if they were requested;
    `partial` is true if Ctrl-C ended the work before all records were filtered."""

    experiment: Experiment
    records: tuple[MonitoredRecord, ...]
    rate: float
    estimates: Mapping[str, StateEstimate]
    walks: Mapping[str, float | str]
    start_deviation: float
    partial: bool = False

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, self.words)

    @property
    def changed(self) -> tuple[MonitoredRecord, ...]:
        """The records that leave the model."""
        return tuple(r for r in self.records if r.outcome == CHANGED)

    @property
    def unusable(self) -> tuple[MonitoredRecord, ...]:
        """The records that could not be filtered, or have a faulty channel."""
        return tuple(r for r in self.records if r.outcome == UNUSABLE)

    @property
    def words(self) -> str:
        """The numbers of records by outcome, with the expected number of false alarms."""
        usable = len(self.records) - len(self.unusable)
        return f"{count(len(self.records), 'record')}: {len(self.changed)} left the model, {len(self.unusable)} could not " \
            f"be used; at most {number(self.rate * usable, 2)} false alarms are expected in {count(usable, 'record')} " \
            f"({number(100 * self.rate, 3)} % of the records of a sound machine)"

    def __getitem__(self, name: str) -> MonitoredRecord:
        """A record by its name, the name of its file without suffix."""
        for record in self.records:
            if record.name == name:
                return record
        raise UsageError([Problem("record-unknown", f"no record is called '{name}'", None,
                                  f"Records: {listing([r.name for r in self.records], 12)}.")])

    def estimate(self, name: str) -> StateEstimate:
        """The estimate of a record; UsageError if it is not kept."""
        if name not in self.estimates:
            record = self[name]
            raise UsageError([Problem("estimate-missing", f"there is no estimate of the record '{name}'"
                                      + (f": {record.reason}" if record.outcome == UNUSABLE else ""), None,
                                      "Monitor the folder with `estimates=True`, which keeps all estimates.")])
        return self.estimates[name]

    def window(self, name: str) -> Experiment:
        """The experiment on the time after the change of a record, for `diagnose`, with the knowledge from before it: the
        record begins at the state that is estimated there, and the free parameters have the values that the time before the
        change determines, with an interval of two standard deviations as their range. Without enough samples before the
        change the whole record is used. Raises UsageError for a record that does not leave the model."""
        record = self[name]
        if record.outcome != CHANGED:
            raise UsageError([Problem("record-unchanged", f"the record '{name}' does not leave the model", None,
                                      f"Changed records: {listing([r.name for r in self.changed] or ['none'], 12)}.")])
        template = next(iter(self.experiment.records.values()))
        whole = replace(_of_file(template, Path(record.file)), use="fit")
        experiment = replace(self.experiment, name=f"{self.experiment.name}, {name}", records={name: whole})
        free = [parameter for parameter in experiment.free if not parameter.startswith("initial.")]
        estimator = Estimator(self.experiment, walks={**dict.fromkeys(free, 0.0), **self.walks}, record=template.name,
                              start_deviation=self.start_deviation)
        try:
            before = estimator.run(replace(whole, end=record.earliest))
        except DataError:
            return experiment
        at = {variable: float(values[-1]) for variable, values in before.values.items()}
        widths = {parameter: 2 * float(before.deviations[parameter][-1]) for parameter in free}
        ranges = {parameter: replace(experiment.free[parameter], range=replace(
            experiment.free[parameter].range, low=at[parameter] - widths[parameter], high=at[parameter] + widths[parameter],
            nominal=at[parameter])) for parameter in free}
        model = experiment.model.with_parameters({parameter: at[parameter] for parameter in free})
        model = replace(model, initial=replace(model.initial, mode=""))  # the machine moves at the begin of the window
        experiment = replace(experiment, model=model, free={**experiment.free, **ranges},
                             records={name: replace(whole, begin=float(before.time[-1]))})
        return experiment.with_record_values({name: {f"initial.{state}": at[state]
                                                     for state in estimator.assembly.state_names}})

    def to_pandas(self) -> pd.DataFrame:
        """A row for each record, with the fields of `MonitoredRecord`."""
        import pandas as pd

        return pd.DataFrame([asdict(record) for record in self.records], columns=[f.name for f in fields(MonitoredRecord)])

    def save(self, path: str | Path) -> None:
        """Write the table as .parquet or .csv."""
        path = Path(path)
        if path.suffix not in (".parquet", ".csv"):
            raise UsageError([Problem("file-suffix", f"'{path}' does not end in .parquet or .csv", None,
                                      f"Write for example {path.stem or 'monitor'}.parquet.")])
        with new_file(path) as fresh:
            if path.suffix == ".csv":
                self.to_pandas().to_csv(fresh, index=False)
                return
            try:
                self.to_pandas().to_parquet(fresh, engine="pyarrow", index=False)
            except ImportError:
                raise UsageError([Problem("pyarrow-missing", "writing Parquet needs pyarrow", None,
                                          "pip install 'heavebond[parquet]'")]) from None

    def plot(self, name: str) -> Figure:
        """The innovations of a record over time, their sums with thresholds, and the change, as a matplotlib figure; for a
        record of `estimates`."""
        figure: Figure = facade.call("Monitoring.plot", self, name)
        return figure

    def as_dict(self) -> dict[str, object]:
        """The table as plain values."""
        return {"rate": self.rate, "partial": self.partial, "records": [asdict(r) for r in self.records]}


@dataclass(frozen=True)
class _Task:
    """The settings that are common to all groups of records."""

    experiment: Experiment
    walks: Mapping[str, float | str]
    record: str
    start_deviation: float
    rate: float
    keep: bool
    reference: Reference


@reporting
def monitor(experiment: ExperimentOrFile, records: str | Path | Sequence[str | Path], *,
            walks: Mapping[str, float | str] | None = None, rate: float | str = FALSE_ALARMS, record: str | None = None,
            start_deviation: float | str = INPUT_ESTIMATION.start_deviation, estimates: bool = False,
            processes: int | None = None, executor: Executor | None = None, progress: Progress | None = None) -> Monitoring:
    """Filter records by the model of an experiment, and report those that leave it.

    `records` is a folder, a file, or a list of files and folders; in a folder, all files with a format of records are read.
    The files have the columns that the experiment names. `walks` and `start_deviation` are as in `Estimator`; `record` is
    the record of the experiment with the settings of the monitored machine (by default the first). `rate` is the probability
    of a false alarm in a record of a sound machine (0.01, or "1 %"). With `estimates` the estimated states of all records
    are kept in `Monitoring.estimates`. `processes` work in parallel, or the workers of an `executor` (a `Cluster`).
    `progress` is called with the number of finished records. Ctrl-C returns these. Raises UsageError for a file that does
    not exist and a folder without records; a record that cannot be used is reported in the table.
    """
    experiment = with_noise(load_experiment(experiment))
    alarm_rate = si_value(rate, "1", "rate")
    if not 0 < alarm_rate < 1:
        raise UsageError([Problem("rate-wrong", f"the rate of false alarms is {alarm_rate:g}: it must be between 0 and 1",
                                  None, "Give the probability of a false alarm in a record, for example 0.01.")])
    files = _files(records)
    share = si_value(start_deviation, "1", "start_deviation")
    # raises for mistakes in the experiment and in the options, which concern all records
    estimator = Estimator(experiment, walks=walks, record=record, start_deviation=share)
    template = estimator.record
    # UsageError if channels of the experiment are in other files than the record
    inputs = {**experiment.inputs, **template.inputs}
    separate = [name for name, source in inputs.items() if source.file != Path()]
    separate += [name for name in experiment.outputs if (template.origins.get(name, Origin()).file
                                                         or experiment.outputs[name].origin.file) is not None]
    if separate:
        raise UsageError([Problem("monitor-files", f"{listing(separate)} of the experiment are in separate files, and each "
                                  "record of a folder is one file", None, "Put all columns of a record into one file.")])
    dating = FaultOnset(estimator)
    task = _Task(replace(experiment, records={template.name: template}), dict(walks or {}), template.name, share, alarm_rate,
                 estimates, estimator.reference)
    say = progress or (lambda text: None)
    filtered: dict[Path, tuple[MonitoredRecord, StateEstimate | None]] = {}
    partial = False
    with ExitStack() as stack:
        workers = executor.number if isinstance(executor, Cluster) else min(processes or processors(), len(files))
        if executor is None and workers > 1:
            executor = stack.enter_context(Processes(workers))
        size = max(1, min(LARGEST_GROUP, math.ceil(len(files) / (GROUPS * workers)))) if executor is not None else 1
        groups = [files[k:k + size] for k in range(0, len(files), size)]
        try:
            if executor is None:
                for file in files:
                    filtered[file] = _filtered(dating, task, file)
                    say(f"{len(filtered)} of {len(files)} records")
            else:
                ahead = executor.ahead if isinstance(executor, Cluster) else workers + 1
                for _, results in as_done(executor, _filter_group, ((k, (task, group)) for k, group in enumerate(groups)),
                                          ahead, instead=lambda k, _: _lost(groups[k])):
                    filtered |= results
                    say(f"{len(filtered)} of {len(files)} records")
        except KeyboardInterrupt:
            clear_signal()
            partial = True
    finished = [filtered[file] for file in files if file in filtered]
    return Monitoring(task.experiment, tuple(r for r, _ in finished), alarm_rate,
                      {r.name: e for r, e in finished if e is not None}, task.walks, share, partial)


def _files(records: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files of the records: the files of a folder sorted by name, other files in their order. UsageError if there are
    none, or if several have the same name."""
    files: list[Path] = []
    try:
        paths = [Path(records)] if isinstance(records, (str, Path)) else [Path(path) for path in records]
    except TypeError:
        raise UsageError([Problem("records-missing", "records are neither a path nor a list of paths", None,
                                  'Write for example "records" or ["monday.csv", "tuesday.csv"].')]) from None
    for path in paths:
        if path.is_dir():
            of_folder = sorted(f for f in path.iterdir() if f.suffix.lower() in RECORD_SUFFIXES and f.is_file())
            if not of_folder:
                raise UsageError([Problem("folder-empty", f"the folder '{path}' has no records", None,
                                          f"Records are files that end in {', '.join(RECORD_SUFFIXES)}.")])
            files += of_folder
        elif not path.is_file():
            raise UsageError([Problem("records-missing", f"'{path}' is neither a file nor a folder", None,
                                      "Give files of records, or a folder with them.")])
        elif path.suffix.lower() not in RECORD_SUFFIXES:
            raise UsageError([Problem("record-suffix", f"'{path}' is not a record", None,
                                      f"Records are files that end in {', '.join(RECORD_SUFFIXES)}.")])
        else:
            files.append(path)
    if not files:
        raise UsageError([Problem("records-missing", "the list of records is empty", None,
                                  "Give files of records, or a folder with them.")])
    files = list({file.resolve(): file for file in files}.values())
    stems = [f.stem for f in files]
    if twice := [str(f) for f in files if stems.count(f.stem) > 1]:
        raise UsageError([Problem("records-same", f"several records have one name: {listing(twice)}", None,
                                  "Give them different names, apart from folder and suffix.")])
    return files


def _of_file(template: Record, file: Path) -> Record:
    """A record with the settings of another one."""
    return replace(template, name=file.stem, file=file, begin=None, end=None, use="test")


def _lost(group: Sequence[Path]) -> dict[Path, tuple[MonitoredRecord, StateEstimate | None]]:
    return {file: (MonitoredRecord(file.stem, str(file), UNUSABLE, "the process that filtered its group of records ended "
                                   "unexpectedly: monitor it alone"), None) for file in group}


def _filter_group(task: _Task, group: Sequence[Path]) -> dict[Path, tuple[MonitoredRecord, StateEstimate | None]]:
    """Filter some records with one estimator."""
    estimator = Estimator(task.experiment, walks=task.walks, record=task.record, start_deviation=task.start_deviation,
                          reference=task.reference)
    dating = FaultOnset(estimator)
    return {file: _filtered(dating, task, file) for file in group}


def _filtered(dating: FaultOnset, task: _Task, file: Path) -> tuple[MonitoredRecord, StateEstimate | None]:
    """Filter one record."""
    estimator = dating.estimator
    record = _of_file(estimator.record, file)
    try:
        estimate = estimator.run(record)
    except HeavebondError as error:
        return MonitoredRecord(file.stem, str(file), UNUSABLE, error.problems[0].message), None
    test = estimate.consistency
    requested = estimate if task.keep else None
    row = MonitoredRecord(file.stem, str(file), IN_MODEL, "", test.samples, test.nis / test.samples,
                          test.low / test.samples, test.high / test.samples)
    channels = {}
    for name, output in task.experiment.outputs.items():
        unit, on = read_unit(output.shown.unit), np.isfinite(estimate.measured[name])
        measured, predicted = (np.asarray((v[name][on] - unit.offset) / unit.scale)
                               for v in (estimate.measured, estimate.predicted))
        channels[name] = _Channel(name, output.shown.unit, estimate.time[on], measured, predicted)
    frozen = frozen_notes(task.experiment, record, channels)
    if frozen:
        return replace(row, outcome=UNUSABLE, reason=frozen[0]), requested
    change = find_change(estimate.time, estimate.innovations, task.rate)
    if change is None:
        return row, requested
    with suppress(HeavebondError, np.linalg.LinAlgError):  # otherwise the time follows from the innovations alone
        change = dating.dated(record, change)
    return replace(row, outcome=CHANGED, alarm=change.alarm, change=change.time, earliest=change.low, latest=change.high,
                   statistic=change.statistic), estimate


@dataclass(frozen=True, eq=False)
class _Channel:
    """A channel for the check of frozen sensors: its samples and the prediction in its unit."""

    name: str
    unit: str
    time: Array
    measured: Array
    model: Array
