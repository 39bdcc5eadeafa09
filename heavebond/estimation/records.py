"""Sampled channels of a record: their times, and the masks of fitted and held-out samples.

Each channel has separate samples; the model is run once on the union of their times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import DataError, HeavebondError, Place, Problem, Problems, listing
from heavebond.core.presentation import count, number, readable
from heavebond.core.units import Unit, read_unit
from heavebond.estimation.experiment import Experiment, Output, Record
from heavebond.estimation.unit_and_sign_checks import declared_otherwise, length_seems_in, time_seems_in
from heavebond.language.definition import FileInput
from heavebond.numerics.inputs import input_samples
from heavebond.records import outliers
from heavebond.records.measurements import (
    BRIDGED,
    Table,
    check_gaps,
    check_time,
    column,
    gaps,
    read_table,
    samples,
    timed,
)
from heavebond.records.metrics import autocorrelation
from heavebond.records.noise import MIN_SAMPLES, NoiseEstimate, estimate_noise
from heavebond.records.time_axis import TimeAxis
from heavebond.text.expression import constant

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# In a single record the last third is validation data, after a gap of one correlation time, because correlated data cannot
# validate. There are at least LEAST samples of each channel on both sides.
KEPT, LEAST = 1 / 3, 10
SMOOTHED = 10  # samples on either side in the average of the variance that inputs cause
TIME = "\0time"  # key of a record's times among the names of its outputs


@dataclass(frozen=True, eq=False)
class Samples:
    """One channel of a record, n samples.

    time: sample times, s; measured: in the channel's unit; index: position of the model time, time - shift, in the run's
    grid; outlier, held_out: masks; between: samples in the gap between the fitted and the held-out part; dropped: samples in
    no figure.

    `noise` is the standard deviation in the channel's unit (if inputs have noise, of both together, rms over time),
    `own_noise` the part of the channel alone, `deviation` (n,) the value of both at each sample; `input_errors`
    (realisations, n) are realisations of the effect of the noise of the inputs; `step` is the resolution of a quantised
    sensor, 0 for others; `estimate` is the estimate of a noise that is not given.
    """

    output: Output
    time: Array
    measured: Array
    index: NDArray[np.int64]
    outlier: Mask
    held_out: Mask
    noise: float
    noise_given: bool
    step: float
    own_noise: float = 0.0
    deviation: Array = field(default_factory=lambda: np.zeros(0))
    input_errors: Array = field(default_factory=lambda: np.zeros((0, 0)))
    estimate: NoiseEstimate | None = None
    between: Mask | None = None

    @property
    def dropped(self) -> Mask:
        """The gap before the held-out part, and outliers if the experiment drops them."""
        gap = np.zeros(len(self.time), dtype=bool) if self.between is None else self.between
        return gap | self.outlier if self.output.drop_outliers else gap

    @property
    def fitted(self) -> Mask:
        """The samples that count in a fit."""
        return ~self.dropped & ~self.held_out

    @property
    def checking(self) -> Mask:
        """The validation samples: the last third of a record without a validation record."""
        return ~self.dropped & self.held_out


@dataclass(frozen=True, eq=False)
class Measured:
    """A record: `grid` (N,) are the output times of its model, s; `notes` are remarks for a reader of the figures.
    `time_suspect` is True if its times seem to be in another unit; `declared` are the units of outputs whose file
    gives another one than the experiment. Other deviations follow from these then, and are not reported separately.
    """

    record: Record
    grid: Array
    channels: dict[str, Samples]
    notes: tuple[str, ...] = ()
    time_suspect: bool = False
    declared: Mapping[str, Unit] = field(default_factory=dict)

    @property
    def deviations(self) -> Array:
        """The standard deviation (channels, N) of each channel on the grid, in SI; interpolated if it was not sampled."""
        deviation_rows = []
        for channel in self.channels.values():
            scale = read_unit(channel.output.shown.unit).scale
            deviation_rows.append(np.interp(self.grid, self.grid[channel.index], channel.deviation) * scale)
        return np.array(deviation_rows).reshape(len(self.channels), len(self.grid))

    def on_grid(self) -> tuple[Array, Mask, Mask]:
        """The measured values (channels, N) in SI, NaN if a channel was not sampled, the mask of fitted samples, and the
        mask of validation samples."""
        values = np.full((len(self.channels), len(self.grid)), np.nan)
        counts, checking = np.zeros(values.shape, dtype=bool), np.zeros(values.shape, dtype=bool)
        for k, channel in enumerate(self.channels.values()):
            unit = read_unit(channel.output.shown.unit)
            values[k, channel.index] = channel.measured * unit.scale + unit.offset
            counts[k, channel.index], checking[k, channel.index] = channel.fitted, channel.checking
        return values, counts, checking


def measure(experiment: Experiment, record: Record) -> Measured:
    """Read a record: every channel from its file, between `from` and `to`, for times at which all inputs are known.

    Raises DataError with all mistakes: files, columns, times, channels without or with too few samples, gaps in inputs,
    noise that is not given and cannot be estimated.
    """
    problems, files = Problems(), _Files((record.file, experiment.time))
    window, sampled = _window(experiment, record, files, problems)
    samples_by_name: dict[str, Samples] = {}
    for name in experiment.outputs:
        try:
            samples_by_name[name] = _channel(experiment, record, name, files, window)
        except HeavebondError as error:
            problems.extend(error)
    problems.raise_as(DataError)
    grid, indices = merged([window[:1], *(c.time - c.output.shift for c in samples_by_name.values())], [*sampled, window])
    samples_by_name = {name: replace(c, index=index) for (name, c),
                       index in zip(samples_by_name.items(), indices[1:], strict=True)}
    samples_by_name = {name: _with_input_noise(experiment, record, k, c)
                       for k, (name, c) in enumerate(samples_by_name.items())}
    most = max((len(c.time) for c in samples_by_name.values()), default=0)
    if most < MIN_SAMPLES:
        raise DataError([Problem(
            "record-short", f"no channel of record '{record.name}' has more than {count(most, 'sample')} in the run; "
            f"at least {MIN_SAMPLES} are needed to compare the two", record.place,
            "Check `from:`, `to:` and the unit of the time; so few samples do not show how a machine moves.")])
    slips, declared = _unit_slips(experiment, record, files)
    slow = [] if TIME in declared else _time_slip(experiment, record,
                                                  samples_by_name)  # the statement of the file is more probable
    notes = [*slips, *slow, *_driven(experiment, record, files), *_gap_notes(experiment, record, samples_by_name),
             *(f"{name}: {remark}" for name, c in samples_by_name.items() for remark in _remarks(c))]
    if record is next(iter(experiment.records.values())):
        notes += [f"{name}: {c.estimate.words}" for name, c in samples_by_name.items() if c.estimate
                  and not c.estimate.separable]
    if experiment.holds_out(record):
        samples_by_name, gap = _with_held_out(samples_by_name, (float(grid[0]), float(grid[-1])))
        notes.append(_held_out_note(samples_by_name, gap))
    return Measured(record, grid, samples_by_name, tuple(notes), bool(slow),
                    {n: unit for n, unit in declared.items() if n in samples_by_name})


def _with_input_noise(experiment: Experiment, record: Record, k: int, channel: Samples) -> Samples:
    """The k-th channel of a record with the noise of its inputs added to its noise, if it is known."""
    known = experiment.input_noise.get(record.name)
    channel_noise = np.full(len(channel.time), channel.noise)
    if known is None:
        return replace(channel, own_noise=channel.noise, deviation=channel_noise,
                       input_errors=np.zeros((0, len(channel_noise))))
    errors = known.at(k, channel.time - channel.output.shift)
    # the variance (n,) is drawn from a few realisations: it is averaged over the neighbours at each time
    variance = np.mean(errors**2, axis=0)
    width = min(SMOOTHED, len(variance) // 10)
    total, index = np.cumsum(np.concatenate([np.zeros(1), variance])), np.arange(len(variance))
    low, high = np.maximum(index - width, 0), np.minimum(index + width + 1, len(variance))
    deviation = np.sqrt(channel_noise**2 + (total[high] - total[low]) / (high - low))
    return replace(channel, own_noise=channel.noise, deviation=deviation, input_errors=errors,
                   noise=float(np.sqrt(np.mean(deviation**2))))


class _Files:
    """The files of a record, each read once for every time axis; clock times count from the first row of the record's
    file (`zero`)."""

    def __init__(self, zero: tuple[Path, TimeAxis]) -> None:
        self._tables: dict[tuple[Path, TimeAxis], Table] = {}
        self._zero = zero

    def table(self, file: Path, axis: TimeAxis, place: Place) -> Table:
        """The file at a place of the experiment: its channels and its times."""
        if (file, axis) not in self._tables:
            table = read_table(file, place=place, beside=axis.column)
            self._tables[file, axis] = timed(table, axis, zero=self._zero, place=place)
        return self._tables[file, axis]


def _unit_slips(experiment: Experiment, record: Record, files: _Files) -> tuple[list[str], dict[str, Unit]]:
    """Contradictions between the units of a file and of the experiment, for the times and each channel, once each; and
    these units, by output (TIME for times)."""
    time_and_channels = [(TIME, record.file, experiment.time, experiment.time.column, experiment.time.unit, record.place)]
    for file_input in experiment.inputs_for(record).values():
        assert file_input.time is not None
        time_and_channels.append(("", file_input.file, file_input.time, file_input.column, file_input.unit,
                                  file_input.place))
    for name, output in experiment.outputs.items():
        file, axis = experiment.origin_of(record, name)
        time_and_channels += [(channel_name, file, axis, column, unit, output.place) for channel_name, column, unit in (
            (TIME, axis.column, axis.unit), (name, output.column, output.shown.unit))]
    notes, units = dict[str, None](), dict[str, Unit]()
    for channel_name, file, axis, name, unit, place in time_and_channels:
        table = files.table(file, axis, place)
        remark, declared = declared_otherwise(table, name, unit), table.unit_of(name)
        if remark and declared is not None:
            notes[remark] = None
            units[channel_name] = declared[1]
    return list(notes), units


def _time_slip(experiment: Experiment, record: Record, samples: Mapping[str, Samples]) -> list[str]:
    """A note if the times seem to be in another unit, by the planned duration and output interval of the diagram."""
    begin, until, every = (constant(value.expr) if value is not None else None for value in (
        experiment.model.begin, experiment.model.until, experiment.model.every))
    if not until or not every:
        return []
    densest = max((c.time for c in samples.values()), key=len)
    until -= begin or 0.0
    axis = experiment.time
    better = time_seems_in(densest, until, every, axis.unit)
    if not better:
        return []
    length = float(np.ptp(densest))
    entry = f"`every: {number(axis.every)} {better}` in place of `every: {number(axis.every)} s`" if axis.every is not None \
        else f"`unit: {better}` in place of `unit: {axis.unit}`"
    return [f"record '{record.name}' lasts {number(length)} s, the diagram is run for {number(until)} s: is its time in "
            f"{better}? ({entry})"]


def _driven(experiment: Experiment, record: Record, files: _Files) -> list[str]:
    """Remarks on the inputs: none at all, a constant one, one whose column is a channel too."""
    inputs = experiment.inputs_for(record)
    if not inputs:
        return ["no column of the record drives the model: it runs with the inputs of the diagram (`inputs:` names columns)"]
    origins = {name: experiment.origin_of(record, name) for name in experiment.outputs}
    remarks = []
    for path, file_input in inputs.items():
        assert file_input.time is not None
        values = column(files.table(file_input.file, file_input.time, file_input.place), file_input.column)
        values = values[np.isfinite(values)]
        if not np.ptp(values):
            remarks.append(f"the input {path} reads {number(float(values[0]))} {file_input.unit} throughout: is it the "
                           "right column, and was the sensor connected?")
        same = [name for name, origin in origins.items()
                if (origin[0], experiment.outputs[name].column) == (file_input.file, file_input.column)]
        remarks += [f"the output {name} and the input {path} are the same column '{file_input.column}'" for name in same]
    return remarks


# -- what time is covered ------------------------------------------------------------------------------------------
def _window(experiment: Experiment, record: Record, files: _Files, problems: Problems) -> tuple[Array, list[Array]]:
    """The times (n,) of the record's rows between `from` and `to` at which all inputs are known (the run covers the first
    to the last), and the sample times of each input."""
    table = _cut(experiment, record, files.table(record.file, experiment.time, record.place))
    time = table.columns[experiment.time.column] * experiment.time.scale
    time = time[np.isfinite(time)]
    begin, end = float(time[0]), float(time[-1])
    inputs = []
    unbridged: dict[tuple[Path, TimeAxis], dict[str, FileInput]] = {}  # for each file, by column
    for path, file_input in experiment.inputs_for(record).items():
        try:
            assert file_input.time is not None
            table = files.table(file_input.file, file_input.time, file_input.place)
            sampled, _ = input_samples(replace(file_input, bridge=True), begin, end, table=table)
        except HeavebondError as error:
            problems.extend(error)
            continue
        if not file_input.bridge:
            unbridged.setdefault((file_input.file, file_input.time), {})[file_input.column] = file_input
        inputs.append(sampled)
        usual = float(np.median(np.diff(sampled)))
        first, last = float(sampled[0]), float(sampled[-1]) + (usual if file_input.interpolation == "hold" else 0.0)
        # an input may begin or end a few of its samples later: this part of the record is omitted
        slack = (BRIDGED + 1) * usual
        cut = [f"`{word}: {at:.10g} s`" for word, at, beyond in (
            ("from", first, first - begin > slack), ("to", last, end - last > slack)) if beyond]
        if cut:
            probable_unit = length_seems_in(last - first, end - begin, file_input.time.unit)
            problems.add("record-end", f"the input {path} is known from {first:.10g} s to {last:.10g} s, the record "
                         f"'{record.name}' goes from {begin:.10g} s to {end:.10g} s", file_input.place,
                         hint=f"In {probable_unit} the times of this input would be as long: correct the `unit:` of its "
                              "`time:`, "
                         "or the `unit:` of the record." if probable_unit else f"Write {' and '.join(cut)} at the record.")
            continue
        time = time[(time >= first - 1e-6 * usual) & (time <= last + 1e-6 * usual)]
    for (file, axis), columns in unbridged.items():
        table = files.table(file, axis, next(iter(columns.values())).place)
        try:  # each gap is reported once
            check_gaps(table, axis.column, {name: samples(table, axis.column, name) for name in columns},
                       begin=begin / axis.scale, end=end / axis.scale)
        except HeavebondError as error:
            problems.extend(error)
    return time, inputs


def _cut(experiment: Experiment, record: Record, table: Table) -> Table:
    """The record's file between `from` and `to`."""
    time = column(table, experiment.time.column, record.place) * experiment.time.scale
    low = -np.inf if record.begin is None else record.begin
    high = np.inf if record.end is None else record.end
    inside = ~(time < low) & ~(time > high)
    if np.sum(inside & np.isfinite(time)) < 2 <= np.isfinite(time).sum():
        rows = count(int(inside.sum()), "row")
        raise DataError([Problem("record-short", f"record '{record.name}' has {rows} between `from:` and `to:`; its times "
                                 f"go from {np.nanmin(time):.10g} s to {np.nanmax(time):.10g} s", record.place,
                                 "Correct `from:` or `to:`, or the unit of the time.")])
    table = table.keep(inside)
    check_time(table, experiment.time.column)
    return table


# -- a channel -----------------------------------------------------------------------------------------------------
def _channel(experiment: Experiment, record: Record, name: str, files: _Files, window: Array) -> Samples:
    (file, axis), output = experiment.origin_of(record, name), experiment.outputs[name]
    table = files.table(file, axis, output.place)
    column(table, output.column, output.place)
    time = column(table, axis.column, output.place) * axis.scale
    # the model time is time - shift, which must lie within the run
    slack = 1e-6 * float(np.median(np.diff(window)))
    inside = (time - output.shift >= window[0] - slack) & (time - output.shift <= window[-1] + slack)
    inside &= (time >= window[0] - slack) & (time <= window[-1] + slack)
    table = table.keep(inside | np.isnan(time))
    if not inside.any():
        its = f"; its times go from {np.nanmin(time):.10g} s to {np.nanmax(time):.10g} s" if np.isfinite(time).any() else ""
        raise DataError([Problem("record-channel-empty", f"output '{output.shown.name}' has no sample between "
                                 f"{window[0]:.10g} s and {window[-1]:.10g} s, the time of record '{record.name}'{its}",
                                 output.place, "Check `from:` and `to:`, the units of both times, and that they count from "
                                 "one moment.")])
    check_time(table, axis.column)
    estimate = experiment.estimated_noise.get(name)
    least, why = (2, "") if output.noise or estimate else (MIN_SAMPLES, " to estimate its noise")
    rows = samples(table, axis.column, output.column, output.place, least=least, why=why)
    y, t = table.columns[output.column][rows], table.columns[axis.column][rows] * axis.scale
    estimate = estimate or estimate_noise([(y, t)])
    deviation = estimate.deviation if math.isfinite(estimate.deviation) else 0.0
    # the noise of a channel, given or else `estimate` (0: unknown), and the resolution of a quantised sensor if it is not
    # below the noise
    step = outliers.step_of(y)
    step = step if step >= (output.noise or deviation) else 0.0
    noise = output.noise or max(deviation, step / math.sqrt(12))
    if noise <= 0:
        still, give = not np.ptp(y), f"its noise: `noise: 1 {output.shown.unit}`."
        raise DataError([Problem("noise-unknown", f"the noise of column '{output.column}' cannot be estimated from the "
                                 f"record{': all its readings are the same' if still else ''}", output.place,
                                 f"Was the sensor connected? Else leave '{output.shown.name}' out, or give {give}" if still
                                 else f"Give {give}")])
    no = np.zeros(len(t), dtype=bool)
    return Samples(output, t, y, np.zeros(len(t), dtype=np.int64), outliers.outliers(t, y, max(deviation, step)), no,
                   noise, output.noise is not None, step, estimate=None if output.noise else estimate)


def _gap_notes(experiment: Experiment, record: Record, samples: Mapping[str, Samples]) -> list[str]:
    """A note for each file whose output columns have gaps."""
    columns: dict[Path, list[str]] = {}
    apart: dict[Path, set[tuple[float, float]]] = {}
    for name, channel in samples.items():
        file, t = experiment.origin_of(record, name)[0], channel.time
        where = gaps(t)
        if len(where):
            columns.setdefault(file, []).append(f"'{channel.output.column}'")
            apart.setdefault(file, set()).update(zip(t[where].tolist(), t[where + 1].tolist(), strict=True))
    notes = []
    for file, ends in apart.items():
        begin, end = max(sorted(ends), key=lambda pair: pair[1] - pair[0])
        notes.append(f"{file.name}: {count(len(ends), 'gap')} in the samples of {listing(dict.fromkeys(columns[file]), 8)}, "
                     f"the longest from {number(begin)} s to {number(end)} s; nothing is compared there")
    return notes


def _remarks(channel: Samples) -> list[str]:
    """Remarks on a channel: resolution, outliers."""
    remarks, t, unit = [], channel.time, channel.output.shown.unit
    if not np.ptp(channel.measured):
        remarks.append(f"all its {count(len(t), 'sample')} read {readable(float(channel.measured[0]), unit, 3)}: is it the "
                       "right column, and was the sensor connected?")
    if channel.step:
        rounding = channel.step / math.sqrt(12)
        comparison_text = "more than the noise given" if channel.noise_given and rounding > channel.noise else \
            "within the noise given" if channel.noise_given else "counted in the noise"
        remarks.append(f"its readings go in steps of {readable(channel.step, unit, 3)}; rounding alone is an error of "
                       f"{readable(rounding, unit, 2)}, {comparison_text}")
    if channel.outlier.any():
        far = count(int(channel.outlier.sum()), "sample is far from its", "samples are far from their")
        remarks.append(f"{far} neighbours, at {moments(t[channel.outlier])}: " + (
            "left out of all figures" if channel.output.drop_outliers else
            "counted in all figures (`outliers: drop` leaves them out)"))
    return remarks


def moments(times: Array) -> str:
    """`2 s, 2.02 s and 3 more`."""
    return listing([f"{number(t)} s" for t in times], 5)


# -- times that several channels share -----------------------------------------------------------------------------
def merged(times: list[Array], known: list[Array]) -> tuple[Array, list[NDArray[np.int64]]]:
    """The union of increasing times, and the indices of each in it; times that differ by rounding only are merged into
    the value of the first of `known` that has it (an integrator must not stop twice within a rounding error)."""
    every = np.concatenate([*known, *times])
    order = np.argsort(every, kind="stable")
    ordered = every[order]
    steps = [float(np.diff(t).min()) for t in (*known, *times) if len(t) > 1]
    group = np.concatenate([[0], np.cumsum(np.diff(ordered) > 1e-6 * min(steps, default=1.0))])
    first = np.full(int(group[-1]) + 1, len(every))
    np.minimum.at(first, group, order)
    place = np.empty(len(every), dtype=np.int64)
    place[order] = group
    known_count = sum(map(len, known))
    wanted = np.unique(place[known_count:])
    index = np.searchsorted(wanted, place[known_count:])
    return every[first[wanted]], list(np.split(index, np.cumsum([len(t) for t in times])[:-1]))


# -- held-out part of a single record -----------------------------------------------------------------------------------
def correlation_time(time: Array, y: Array) -> float:
    """The lag (s) at which the autocorrelation of readings y (n,) at times (n,) first falls below 1/e, on an even grid
    with the median step; one sample interval if they are uncorrelated or constant."""
    step = float(np.median(np.diff(time)))
    even = np.interp(np.arange(time[0], time[-1] + step / 2, step), time, y)
    below = np.flatnonzero(autocorrelation(even, len(even) - 1) < 1 / math.e)
    return step * float(max(below[0], 1) if len(below) else 1)


def _with_held_out(channels: Mapping[str, Samples], ends: tuple[float, float]) -> tuple[dict[str, Samples], float]:
    """The channels with the last third held out, and the gap before it (s): the longest correlation time of a channel, at
    most half of the held-out part. No part is held out if hardly a sample of a channel would remain on one side (the
    record is short, or a gap of it fills a side)."""
    begin, end = ends[1] - KEPT * (ends[1] - ends[0]), ends[1]
    gap = min(max(correlation_time(c.time, c.measured) for c in channels.values()), (end - begin) / 2)
    with_held_out = {name: replace(c, held_out=c.time - c.output.shift >= begin + gap,
                                   between=(c.time - c.output.shift >= begin) & (c.time - c.output.shift < begin + gap))
                     for name, c in channels.items()}
    enough = min(min(c.held_out.sum(), c.fitted.sum()) for c in with_held_out.values()) >= LEAST
    return (with_held_out, gap) if enough else (dict(channels), 0.0)


def _held_out_note(channels: Mapping[str, Samples], gap: float) -> str:
    out, whole = (sum(int(m.sum()) for m in masks) for masks in
                  ([c.held_out for c in channels.values()], [np.ones(len(c.time), bool) for c in channels.values()]))
    if not out:
        return "no record checks the fit, and this one is too short to hold a part of it out"
    first = min(float(c.time[c.held_out][0]) for c in channels.values())
    return f"no record has `use: validate`, so the last {out} of {whole} samples, from {number(first, 4)} s on, are held " \
           f"out of the fit to check it; the {number(gap, 2)} s before, one correlation time, are left out of both"
