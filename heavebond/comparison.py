"""The model laid over the measurements: what it misses, per channel, with the noise level beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from heavebond import metrics, reading
from heavebond.dae import Array, Assembly, assemble
from heavebond.errors import DataError, HeavebondError, ModelError, Place, Problem, Problems, suggest
from heavebond.experiment import Experiment, Output, Record, load_experiment
from heavebond.expression import ExpressionProblem, names
from heavebond.measurements import Table, check_time, check_values, column, read_table
from heavebond.result import Result
from heavebond.simulation import Simulator, Tolerances
from heavebond.units import dimension_text, read_unit

# A record is simulated to far less than its noise; tighter only costs time.
TOLERANCES = Tolerances(1e-7, 1e-9)


@dataclass(frozen=True)
class Channel:
    """One measured channel beside the model, both (N,) in the channel's unit.

    error: rms of model - measured, same unit; normalised: error / rms of measured about its mean;
    relative: error / rms of measured; fit: 100 (1 - normalised) %; chi2: mean of (error/noise)**2, 1 where the model
    is right; white: p value of the Ljung-Box test that what is left has no memory.
    """

    name: str
    unit: str
    time: Array
    measured: Array
    model: Array
    noise: float
    noise_given: bool
    error: float
    normalised: float
    relative: float
    fit: float
    bias: float
    chi2: float
    white: float

    def figures(self) -> dict[str, float | str | bool]:
        """The figures alone, for tables and machines."""
        return {"unit": self.unit, "error": self.error, "normalised": self.normalised, "relative": self.relative,
                "fit_percent": self.fit, "bias": self.bias, "noise": self.noise, "noise_given": self.noise_given,
                "chi2_per_sample": self.chi2, "white_p": self.white}


@dataclass(frozen=True)
class RecordComparison:
    """All channels of one record."""

    name: str
    use: str
    file: Path
    channels: dict[str, Channel]
    result: Result

    @property
    def normalised(self) -> float:
        """Root mean square of the channels' normalised errors: one number for the record."""
        return float(np.sqrt(np.mean([c.normalised**2 for c in self.channels.values()])))

    @property
    def chi2(self) -> float:
        """Mean of the channels' chi-square per sample."""
        return float(np.mean([c.chi2 for c in self.channels.values()]))


@dataclass(frozen=True)
class Comparison:
    """An experiment with its model simulated on every record."""

    experiment: Experiment
    records: dict[str, RecordComparison]

    def as_dict(self) -> dict[str, object]:
        """All figures, for machines."""
        return {name: {"use": r.use, "normalised": r.normalised, "chi2_per_sample": r.chi2,
                       "channels": {c.name: c.figures() for c in r.channels.values()}}
                for name, r in self.records.items()}


def compare(experiment: Experiment | str | Path, *, parameters: Mapping[str, float | str] | None = None,
            progress: Callable[[str], None] | None = None) -> Comparison:
    """Simulate with the measured inputs and lay the records over the model.

    `parameters` overrides values by name; `progress` is told the name of each record. Raises ModelError, DataError,
    StartError or SimulationError with what is wrong.
    """
    experiment = experiment if isinstance(experiment, Experiment) else load_experiment(experiment)
    problems = Problems()
    records = {}
    for record in experiment.records.values():
        if progress:
            progress(record.name)
        try:
            records[record.name] = compare_record(experiment, record, parameters)
        except (ModelError, DataError) as error:
            problems.extend(error)
    problems.raise_as(DataError if all(p.code.startswith("record") for p in problems.found) else ModelError)
    return Comparison(experiment, records)


def compare_record(experiment: Experiment, record: Record,
                   parameters: Mapping[str, float | str] | None = None) -> RecordComparison:
    """One record; see `compare`."""
    table = record_table(experiment, record)
    assembly = assemble_for(experiment, record)
    if parameters:
        assembly = assembly.with_parameters(parameters)
    time = record_time(experiment, record, table)
    result = Simulator(assembly, times=time, tolerances=TOLERANCES).run()
    simulated = result.signals([o.shown.text for o in experiment.outputs.values()])
    channels = {name: _channel(name, output, table, time, simulated[output.shown.text])
                for name, output in experiment.outputs.items()}
    return RecordComparison(record.name, record.use, record.file, channels, result)


def record_table(experiment: Experiment, record: Record) -> Table:
    """The record's rows between `from` and `to`, checked: times increase, no gaps, no missing values in use."""
    table = read_table(record.file, place=record.place)
    problems = Problems()
    used = {experiment.time_column: record.place}
    used.update({given.column: given.place for given in {**experiment.inputs, **record.inputs}.values()})
    used.update({output.column: output.place for output in experiment.outputs.values()})
    for name, place in used.items():
        try:
            column(table, name, place)
        except HeavebondError as error:
            problems.extend(error)
    problems.raise_as(DataError)
    time = table.columns[experiment.time_column] * read_unit(experiment.time_unit).scale
    keep = np.ones(len(time), dtype=bool)
    if record.begin is not None:
        keep &= ~(time < record.begin)
    if record.end is not None:
        keep &= ~(time > record.end)
    table = table.keep(keep)
    try:
        check_time(table, experiment.time_column)
    except DataError as error:
        problems.extend(error)
    try:
        check_values(table, list(used))
    except DataError as error:
        problems.extend(error)
    problems.raise_as(DataError)
    return table


def record_time(experiment: Experiment, record: Record, table: Table) -> Array:
    """The times (N,) of a record in seconds."""
    return column(table, experiment.time_column, record.place) * read_unit(experiment.time_unit).scale


def assemble_for(experiment: Experiment, record: Record) -> Assembly:
    """The diagram of a record as equations; ModelError for outputs or free parameters that it does not have."""
    wanted = {n.text for output in experiment.outputs.values() for n in names(output.shown.expr)}
    wanted |= {name.removeprefix("initial.") for name in experiment.free if name.startswith("initial.")}
    assembly = assemble(experiment.model_for(record), wanted)
    problems = Problems()
    for name, output in experiment.outputs.items():
        _check_output(assembly, name, output, problems)
    _check_free(assembly, experiment, problems)
    problems.raise_as(ModelError)
    return assembly


def _check_output(assembly: Assembly, name: str, output: Output, problems: Problems) -> None:
    try:
        found = assembly.resolver().dimension(output.shown.expr)
        assembly.expression(output.shown.expr)
    except ExpressionProblem as problem:
        reading.add_expression_problem(problem, output.shown.place, problems)
        return
    if found is not None and found != read_unit(output.shown.unit).dimension:
        problems.add("unit-wrong", f"output '{name}' is in {dimension_text(found)}, its column in "
                     f"{output.shown.unit}", output.place)


def _check_free(assembly: Assembly, experiment: Experiment, problems: Problems) -> None:
    flat = assembly.flat
    units = {q.name: q.unit for q in flat.parameters}
    for name, free in experiment.free.items():
        place: Place = free.place
        if name not in units:
            inner = name.removeprefix("initial.")
            hint = "It follows from other parameters by a formula." if name in flat.constants else \
                f"Give it a value in the diagram first: `initial: {{{inner}: ...}}`." if inner in flat.names else \
                suggest(name, units)
            problems.add("free-unknown", f"'{name}' is no parameter that may be free", place, hint=hint)
            continue
        unit = units[name]
        if unit.dimension != free.range.unit.dimension:
            problems.add("unit-wrong", f"the range of {name} is in {free.range.unit.text}; {unit.text} is needed", place)


def channel_noise(output: Output, table: Table, time: Array) -> tuple[float, bool]:
    """The noise of a channel in its own unit, and whether it was given (else it is estimated from the record).

    DataError for a channel whose noise is not given and cannot be estimated: constant or too short.
    """
    if output.noise is not None:
        return output.noise, True
    noise = metrics.estimate_noise(table.columns[output.column], time)
    if not np.isfinite(noise) or noise <= 0:
        raise DataError([Problem("noise-unknown", f"the noise of column '{output.column}' cannot be estimated from the "
                                 "record", output.place, f"Give it: `noise: 1 {output.shown.unit}`.")])
    return noise, False


def _channel(name: str, output: Output, table: Table, time: Array, simulated: Array) -> Channel:
    unit = read_unit(output.shown.unit)
    measured = table.columns[output.column]
    model = np.asarray((simulated - unit.offset) / unit.scale)
    noise, given = channel_noise(output, table, time)
    return Channel(
        name, output.shown.unit, time, measured, model, noise, given,
        metrics.rms_error(measured, model), metrics.normalised_rms(measured, model),
        metrics.relative_rms(measured, model), metrics.fit_percent(measured, model), metrics.bias(measured, model),
        metrics.chi2_per_sample(measured, model, noise), metrics.whiteness(measured - model))

