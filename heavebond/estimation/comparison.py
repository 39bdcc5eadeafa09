"""Comparison of a model with measured records: residuals and error measures per channel, with the noise level."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from heavebond.core import facade
from heavebond.core.errors import (
    NAMES_LISTED,
    DataError,
    HeavebondError,
    ModelError,
    Place,
    Problems,
    SimulationError,
    StartError,
    UsageError,
    listing,
    suggest,
)
from heavebond.core.presentation import brief, count, in_unit, number, readable, readable_time
from heavebond.core.reporting import place, reporting
from heavebond.core.units import Unit, check_turns, counts_from_origin, interval_unit, other_unit, read_unit
from heavebond.equations.parameters import check_range
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.constant_bias import all_advice
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, Output, Record, load_experiment
from heavebond.estimation.faulty_columns import frozen_notes, prescribing_inputs, swapped_notes
from heavebond.estimation.feedback import closed_loops
from heavebond.estimation.input_noise import noise_notes
from heavebond.estimation.input_smoothing import smoothing_notes
from heavebond.estimation.records import Mask, Measured, Samples, measure, moments
from heavebond.estimation.unit_and_sign_checks import (
    seems_from_another_zero,
    seems_in_another_unit,
    seems_of_another_sign,
    seems_turned,
)
from heavebond.language import reading
from heavebond.language.definition import FileInput, Value
from heavebond.language.edits import quoted
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.quick_simulation import FitSimulator
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.run_verdict import report_verdict
from heavebond.numerics.simulation import changes_of, run_by_auto
from heavebond.numerics.simulator import Simulator, Tolerances
from heavebond.records import metrics
from heavebond.records.outliers import outliers
from heavebond.records.time_delay import TimeDelay, lateness
from heavebond.text.dimensions import check_origins
from heavebond.text.expression import ExpressionProblem, names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Smallest lead of all channels, as a share of a sample interval, that indicates a held input.
_SOONER = 0.15
# Integration errors far below the noise of a record; tighter tolerances only cost time.
TOLERANCES = Tolerances(1e-7, 1e-9)
MANY = 5_000  # samples from which on the compiled integrator is used
# Deviations of the noise by which the first sample of a state must differ from the start of the model: by chance once in a
# million records.
ELSEWHERE = 5.0


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One measured channel with n samples and the model at these times, both in the unit of the channel.

    statistics: the error measures by name (see `metrics.STATISTICS`), of the samples selected by `counts` (n,), which
    excludes dropped outliers and the other part of a record that is held out in part; step: resolution of a quantised
    sensor, else 0; outlier (n,): samples far from their neighbours; astray (n,): other samples whose residual is far from
    the residuals of their neighbours; late: estimated delay of the channel relative to the model; separable: True if the
    noise is given, or its estimate separable from the signal.
    """

    name: str
    unit: str
    time: Array
    measured: Array
    model: Array
    noise: float
    noise_given: bool
    statistics: Mapping[str, float]
    counts: Mask
    outlier: Mask
    astray: Mask
    step: float
    late: TimeDelay | None
    separable: bool = True

    @property
    def error(self) -> float:
        """The rms of model - measured, in the unit of the channel."""
        return self.statistics["error"]

    @property
    def normalised(self) -> float:
        """The rms error over the rms of the measured values about their mean."""
        return self.statistics["normalised"]

    @property
    def relative(self) -> float:
        """The rms error over the rms of the measured values."""
        return self.statistics["relative"]

    @property
    def fit(self) -> float:
        """100 (1 - normalised) in percent."""
        return self.statistics["fit_percent"]

    @property
    def bias(self) -> float:
        """The mean of measured - model, in the unit of the channel."""
        return self.statistics["bias"]

    @property
    def chi2(self) -> float:
        """The mean of (error/noise)**2, 1 if the model is right."""
        return self.statistics["chi2_per_sample"]

    @property
    def white(self) -> float:
        """The p value of the Ljung-Box test for uncorrelated residuals."""
        return self.statistics["white_p"]

    def figures(self) -> dict[str, object]:
        """The error measures without the samples, for tables and JSON."""
        late = self.late and {"seconds": self.late.seconds, "deviation": self.late.deviation, "share": self.late.share,
                              "noticeable": self.late.noticeable, "explains": self.late.explains(self.noise)}
        return {"unit": self.unit, **self.statistics, "noise": self.noise, "noise_given": self.noise_given,
                "noise_separable": self.separable, "samples": int(self.counts.sum()),
                "outliers": self.time[self.outlier].tolist(),
                "astray": self.time[self.astray].tolist(), "step": self.step, "late": late}


@dataclass(frozen=True)
class RecordComparison:
    """All channels of one record.

    `validate` is the held-out part of the record if the experiment has no validation record, else None. `notes` are
    remarks on the interpretation of the values; `doubtful` are channels whose unit, sign or time seems to differ from the
    experiment. Parts of the notes are listed separately: `starts` (states with another start value in the record, of the
    channels `elsewhere`), `feedback` (inputs that depend on outputs) and `slips` (units, signs and zeros of channels)."""

    name: str
    use: str
    file: Path
    channels: dict[str, Channel]
    result: Result
    validate: RecordComparison | None = None
    notes: tuple[str, ...] = ()
    doubtful: frozenset[str] = frozenset()
    starts: tuple[str, ...] = ()
    feedback: tuple[str, ...] = ()
    elsewhere: tuple[str, ...] = ()
    slips: tuple[str, ...] = ()

    @property
    def normalised(self) -> float:
        """Root mean square of the channels' normalised errors. Constant channels have no normalised error and are
        omitted; NaN if all channels are constant."""
        errors = [c.normalised for c in self.channels.values() if math.isfinite(c.normalised)]
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan

    @property
    def chi2(self) -> float:
        """Mean of the channels' chi-square per sample."""
        return float(np.mean([c.chi2 for c in self.channels.values()]))

    def as_dict(self) -> dict[str, object]:
        """Errors of the channels of this record as a dictionary of plain values, in the unit of each channel."""
        held_out = {"validate": self.validate.as_dict()} if self.validate else {}
        return {"use": self.use, "normalised": self.normalised, "chi2_per_sample": self.chi2, "notes": list(self.notes),
                "channels": {c.name: c.figures() for c in self.channels.values()}, **held_out}


@dataclass(frozen=True)
class Comparison(facade.Displayed):
    """An experiment with its model simulated on every record: `records` by name, each with its channels.

    Arrays of a channel have shape (n,), its samples, in `channel.unit`; `as_dict()` holds the values for machines.
    """

    experiment: Experiment
    records: dict[str, RecordComparison]

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, *(
            f"{name} ({r.use}): normalised error {100 * r.normalised:.3g} %, chi-square {r.chi2:.4g} per sample"
            for name, r in list(self.records.items())[:12]), "..." if len(self.records) > 12 else "")


    def plot(self) -> Figure:
        """A matplotlib figure: a column per record, a row per channel, the residual beneath each."""
        figure: Figure = facade.call("Comparison.plot", self)
        return figure

    @property
    def parts(self) -> list[RecordComparison]:
        """Every record, each followed by its held-out part where it has one."""
        return [part for r in self.records.values() for part in (r, r.validate) if part is not None]

    @property
    def advice(self) -> tuple[str, ...]:
        """A line for each free parameter with a value outside its range, and for each channel whose bias is equal on all
        records."""
        names = [name for name in self.experiment.outputs if not any(name in r.doubtful for r in self.records.values())]
        residuals = {name: [(c.measured - c.model)[~c.outlier] for c in (r.channels[name] for r in self.records.values())]
                     for name in names}
        noise = {name: max(r.channels[name].noise for r in self.records.values()) for name in names}
        first = next(iter(self.records.values())).result
        values = dict(zip(first.assembly.parameter_names, first.start.p.tolist(), strict=True))
        return (*outside_ranges(self.experiment, values), *all_advice(self.experiment, residuals, noise))

    def as_dict(self) -> dict[str, object]:
        """Errors of all records and channels as a dictionary of plain values, in the unit of each channel."""
        return {name: r.as_dict() for name, r in self.records.items()}


def outside_ranges(experiment: Experiment, values: Mapping[str, float]) -> list[str]:
    """A line for each free parameter whose value (SI) in the diagram is outside its permitted range."""
    lines = []
    for name, free in experiment.free.items():
        value, unit = values.get(name), free.range.unit
        slack = 1e-9 * (free.range.high - free.range.low)
        if value is not None and not free.range.low - slack <= value <= free.range.high + slack:
            value_text, low, high = (in_unit(v, unit, 6) for v in (value, free.range.low, free.range.high))
            of = "" if unit.text == "1" else f" {unit.text}"
            lines.append(f"{name} is {value_text}{of} in the diagram, outside its range {low} .. {high}{of} under "
                         "`free:`: a fit "
                         "begins inside the range. Set the value or the range right")
    return lines


@reporting
def compare(experiment: ExperimentOrFile, *, parameters: Mapping[str, float | str] | None = None,
            progress: Callable[[str], None] | None = None) -> Comparison:
    """Simulate the diagram of an experiment with the measured inputs and compare it with the records.

    For each channel the residual is measurement minus model; `error` is its rms in the unit of the channel, chi2 the mean
    of (residual / noise)**2, which is 1 at the noise level. `parameters` overrides values by name, in SI or as text with
    a unit; `progress` is called with the name of each record. Raises UsageError, ModelError, DataError, StartError or
    SimulationError.
    """
    experiment = with_noise(load_experiment(experiment))
    problems, kinds = Problems(), set[type[HeavebondError]]()
    records = {}
    for k, record in enumerate(experiment.records.values()):
        if progress:
            place(progress, k, len(experiment.records))
            progress(record.name)
        try:
            records[record.name] = compare_record(experiment, record, parameters)
        except (ModelError, DataError) as error:
            problems.extend(error)
            kinds.add(type(error))
        except (StartError, SimulationError) as error:
            raise type(error)([replace(p, notes=(*p.notes, f"in record {record.name}")) for p in error.problems]) from error
    problems.raise_as(DataError if kinds == {DataError} else ModelError)
    for record_comparison in records.values():
        report_verdict(f"{experiment.name}, {record_comparison.name}", record_comparison.result.verdict)
    return Comparison(experiment, records)


def simulate_over(assembly: Assembly, grid: Array) -> Result:
    """Run over the samples of a record. IDAS stops at every sample of an input; for many samples the compiled integrator,
    which interpolates inputs, is ten times as fast. If it fails, IDAS determines the reason."""
    if len(grid) > MANY and (program := FitSimulator(assembly, times=grid, tolerances=TOLERANCES)).compiled:
        with suppress(SimulationError, StartError):
            return program.run()
    return run_by_auto(Simulator(assembly, times=grid, tolerances=TOLERANCES))


def compare_record(experiment: Experiment, record: Record,
                   parameters: Mapping[str, float | str] | None = None) -> RecordComparison:
    """Compare the diagram with one record; see `compare`."""
    measured = measure(experiment, record)
    assembly = assemble_for(experiment, record)
    if parameters:
        assembly = assembly.with_parameters(parameters)
    result = simulate_over(assembly, measured.grid)
    texts = [o.shown.text for o in experiment.outputs.values()]
    simulated = dict(zip(texts, Probe(result.assembly, texts, si=True).values(result), strict=True))
    fitted, checking = {}, {}
    for name, samples in measured.channels.items():
        unit = read_unit(samples.output.shown.unit)
        model = np.asarray((simulated[samples.output.shown.text] - unit.offset) / unit.scale)
        sound = ~samples.outlier
        late = lateness(samples.time[sound] - samples.output.shift, samples.measured[sound], measured.grid, model)
        astray = outliers(samples.time, samples.measured - model[samples.index], max(samples.noise, samples.step)) & sound
        fitted[name] = _channel(name, samples, model[samples.index], samples.fitted, astray, late)
        if samples.checking.any():
            checking[name] = _channel(name, samples, model[samples.index], samples.checking, astray, late)
    held_out = RecordComparison(f"{record.name}, held out", "validate", record.file, checking, result) if checking else None
    held_inputs = [name for name, file_input in experiment.inputs_for(record).items() if file_input.interpolation == "hold"]
    slips = {} if measured.time_suspect else {
        c.name: _slips(c, measured.channels[c.name].output, measured.declared.get(c.name)) for c in fitted.values()}
    steady = result.assembly.model.initial.mode == "steady"
    # outputs that are states of the model, or formulas of states alone
    t, x, z, p, u, _ = result.assembly.arguments
    formulas = {name: result.assembly.expression(output.shown.expr) for name, output in experiment.outputs.items()}
    states = [fitted[name] for name, formula in formulas.items() if ca.depends_on(formula, x)
              and not ca.depends_on(formula, ca.veccat(t, z, p, u)) and not slips.get(name)]
    # the channels whose value at the first instant of the record differs from the model
    elsewhere = [c for c in states
                 if not measured.time_suspect and c.time[0] <= measured.grid[0] and c.name not in measured.declared
                 and not (c.outlier[0] and measured.channels[c.name].output.drop_outliers)
                 and not (c.late is not None and c.late.noticeable and c.late.explains(c.noise))
                 and abs(c.measured[0] - c.model[0]) > ELSEWHERE * max(c.noise, c.step)]
    starts = tuple(_start_note(c, measured.channels[c.name].output, steady, result) for c in elsewhere)
    closed = closed_loops(experiment, record, {c.name: (c.time, c.measured, c.model) for c in fitted.values()},
                          prescribing_inputs(result.assembly))
    adjusted = bool(parameters) or not experiment.free
    slipped = (*(f"{name} {remark}" for name, remarks in slips.items() for remark in remarks),
               *([] if measured.time_suspect else _turned_inputs(experiment.inputs_for(record), fitted)))
    notes = (*measured.notes, *slipped, *_notes(measured, fitted, slips, held_inputs, adjusted), *starts,
             *frozen_notes(experiment, record, fitted), *swapped_notes(experiment, record, result.assembly, fitted),
             *noise_notes(experiment, measured), *smoothing_notes(experiment, record, result.assembly), *closed,
             *changes_of(result, states=False))
    doubtful = frozenset(fitted) - {name for name, remarks in slips.items() if not remarks and name not in measured.declared}
    return RecordComparison(record.name, record.use, record.file, fitted, result, held_out, notes, doubtful, starts,
                            closed, tuple(c.name for c in elsewhere), slipped)


def _start_note(channel: Channel, output: Output, steady: bool, result: Result) -> str:
    unit, formula = "" if channel.unit == "1" else f" {channel.unit}", output.shown.text
    places = -math.floor(math.log10(max(channel.noise, channel.step)))
    first, start = (f"{number(round(float(values[0]), places), 12)}{unit}" for values in (channel.measured, channel.model))
    begins = f"{channel.name} begins at {first} in the record, at {start} in the model"
    if steady:
        return (f"{begins}, which starts in equilibrium: if the machine was at rest then too, a value of the diagram that "
                "decides the equilibrium is wrong (a load, a preload or its sign, a supply); if it was not, begin"
                " without `start: steady`")
    begins = f"{begins}: if the machine was in another state then, "
    if formula in result.assembly.state_names:
        return f"{begins}write `initial: {{{quoted(formula)}: {first}}}` at this record"
    return begins + _state_advice(channel, output, result)


def _state_advice(channel: Channel, output: Output, result: Result) -> str:
    """The initial value of one state for which the formula of an output equals the first measurement; the other states
    keep their values. The formula itself cannot be prescribed in addition to its states."""
    assembly, start = result.assembly, result.start
    unit, x = read_unit(output.shown.unit), assembly.arguments[1]
    slopes = np.array(ca.Function("slopes", [x], [ca.jacobian(assembly.expression(output.shown.expr), x)])(start.x)).ravel()
    states = [k for k in np.flatnonzero(slopes).tolist() if assembly.reduced.states[k][1] == 0]
    missing = unit.scale * float(channel.measured[0] - channel.model[0])
    if not states:
        return "give the initial values of its states at this record"
    k = max(states, key=lambda k: abs(slopes[k]) * float(assembly.x_nominal[k]))
    unknown = assembly.flat.unknowns[assembly.reduced.states[k][0]]
    value = readable(float(start.x[k]) + missing / float(slopes[k]), unknown.unit.text, 6)
    other_states = [assembly.state_names[j] for j in states if j != k]
    return f"write `initial: {{{unknown.name}: {value}}}` at this record" + (
        f" (or another value of {listing(other_states, 3)})" if other_states else "")


def _notes(measured: Measured, channels: Mapping[str, Channel], slips: Mapping[str, Sequence[str]],
           held_inputs: Sequence[str], adjusted: bool) -> tuple[str, ...]:
    """Remarks on a record in addition to its values and `slips`. Of two hints that exclude each other only the more
    probable is given: a wrong unit of time explains all deviations of channels, a wrong unit or sign of a channel its
    shift in time, a held input the shifts of all channels."""
    if measured.time_suspect:
        return ()
    # the note for an input with `hold` although it changed between samples
    held: list[str] = []
    lags = [c.late for c in channels.values() if c.late is not None]
    if held_inputs and lags and all(lag.noticeable and _SOONER < -lag.seconds / lag.interval < 1 for lag in lags):
        held = [f"all channels are early by a part of a sample: so they would look where {listing(held_inputs, 3)} did not "
                "stay from sample to sample (`interpolation: hold`) but moved on; if it was measured and not commanded, "
                "try `interpolation: linear`"]
    late = [c for c in channels.values() if c.late is not None and c.late.noticeable and not held
            and not slips.get(c.name) and c.name not in measured.declared]
    sure = {c.name: c for c in late if c.late is not None and c.late.explains(c.noise, fitted=adjusted)}
    notes = [f"{c.name}: {count(int(c.astray.sum()), 'more sample')} far from the model where those around are not, at "
             f"{moments(c.time[c.astray])}; `heavebond fit --robust` reduces their weight"
             for c in channels.values() if c.astray.any()]
    for c in sure.values():
        assert c.late is not None
        declared = measured.channels[c.name].output.shift
        instead = f" instead of `shift: {readable_time(declared)[0]}`" if declared else ""
        notes.append(f"{c.name} looks {_late_by(c)} ({number(abs(c.late.seconds) / c.late.interval, 2)} of its sample "
                     "intervals), and little else is wrong with it; unless the model lacks something that acts like a "
                     f"delay, write `shift: {readable_time(declared + c.late.seconds)[0]}`{instead} at this output")
    # if several errors are present, a delay is only one possible explanation
    others_text = ", ".join(f"{c.name} {_late_by(c)}" for c in late if c.name not in sure)
    if others_text:
        more = any(c.late is not None and not c.late.explains(c.noise) for c in late)
        why = "it does not explain all of the error, and missing physics shifts" if more else \
            "the free parameters are not fitted yet, and their errors shift"
        notes.append(f"a shift in time would reduce the error: {others_text}; but {why} phases too: fit first")
    return (*notes, *held)


def _slips(channel: Channel, output: Output, declared: Unit | None) -> list[str]:
    measured, model = channel.measured[channel.counts], channel.model[channel.counts]
    formula = output.shown.text
    remarks = (seems_in_another_unit(measured, model, channel.unit, declared),
               seems_of_another_sign(measured, model, formula),
               seems_from_another_zero(measured, model, channel.unit, formula))
    return [remark for remark in remarks if remark]


def _turned_inputs(inputs: Mapping[str, FileInput], channels: Mapping[str, Channel]) -> list[str]:
    """A note if all channels move against the model: an input of the opposite sign turns all of them."""
    turned = [seems_turned(c.measured[c.counts], c.model[c.counts], "") for c in channels.values()]
    if not inputs or not turned or None in turned:
        return []
    entries = listing([f"`factor: {number(-source.factor)}` at {name}" for name, source in inputs.items()], 3)
    subject = f"{next(iter(channels))} moves" if len(turned) == 1 else "all channels move"
    cause = "if an input has" if len(inputs) > 1 else f"if the input {next(iter(inputs))} has"
    return [f"{subject} against the model: {cause} the opposite sign, write {entries} instead"]


def _late_by(channel: Channel) -> str:
    late = channel.late
    assert late is not None
    size, deviation = readable_time(abs(late.seconds), late.deviation)
    return f"{'late' if late.seconds > 0 else 'early'} by {size} +- {deviation}"


def assemble_for(experiment: Experiment, record: Record) -> Assembly:
    """Assemble the equations of a record's diagram; ModelError for unknown outputs or free parameters."""
    wanted = {n.text for output in experiment.outputs.values() for n in names(output.shown.expr)}
    wanted |= {name.removeprefix("initial.") for name in experiment.free if name.startswith("initial.")}
    assembly = assemble(experiment.model_for(record), wanted)
    problems = Problems()
    for name, output in experiment.outputs.items():
        _check_output(assembly, name, output, problems)
    flat = assembly.flat
    units = {q.name: q.unit for q in flat.parameters}
    for name, free in experiment.free.items():
        place: Place = free.place
        if name not in units:
            inner = name.removeprefix("initial.")
            hint = "It follows from other parameters by a formula." if name in flat.constants else \
                f"Give it a value in the diagram first: `initial: {{{inner}: ...}}`." if inner in flat.names else \
                suggest(name, units) or NAMES_LISTED
            problems.add("free-unknown", f"'{name}' cannot be estimated: it is not a numeric parameter", place, hint=hint)
            continue
        unit = units[name]
        if unit.dimension != free.range.unit.dimension:
            problems.add("unit-wrong", f"the range of {name} is in {free.range.unit.text}; {unit.text} is needed", place,
                         hint=f"Write it in {unit.text} or in a multiple of it.")
            continue
        check_turns(free.range.unit.text, unit, name, place, problems)
        try:
            check_range(name, free.range, flat.limits, flat.origins.of_name, place)
        except UsageError as error:
            problems.extend(error)
    problems.raise_as(ModelError)
    return assembly


def driven_by(assembly: Assembly, experiment: Experiment, source: Record, driving: Record) -> Assembly | None:
    """The equations of record `source`, driven by the inputs of record `driving`; None if the records differ in more than
    their measured data (settings, conditions, units or interpolation of inputs), apart from numbers that are free for
    `each` record."""
    own_names = {name for name, free in experiment.free.items() if free.each}
    numbers: dict[str, float | str] = {}
    for name in sorted(own_names & {*source.settings, *driving.settings}):
        value = driving.settings[name].value if name in driving.settings else None
        if not isinstance(value, Value) or value.formula:
            return None
        numbers[name] = float(value.text) if value.si else value.text
    common, apart = ({name: s for name, s in record.settings.items() if name not in own_names}
                     for record in (source, driving))
    other_inputs, before = experiment.inputs_for(driving), experiment.inputs_for(source)
    flat = assembly.flat
    alike = common == apart and source.conditions == driving.conditions and \
        other_inputs.keys() == before.keys() == {k.name for k in flat.inputs} and \
        all((g.unit, g.interpolation) == (before[name].unit, before[name].interpolation) for name, g in other_inputs.items())
    if not alike:
        return None
    inputs = tuple(replace(known, source=other_inputs[known.name]) for known in flat.inputs)
    expanded = replace(flat.expanded, model=experiment.model_for(driving))
    driven = replace(assembly, reduced=replace(assembly.reduced, flat=replace(flat, inputs=inputs, expanded=expanded)))
    return driven.with_parameters(numbers)


def _check_output(assembly: Assembly, name: str, output: Output, problems: Problems) -> None:
    try:
        unit = assembly.resolver().unit(output.shown.expr)
        assembly.expression(output.shown.expr)
    except ExpressionProblem as problem:
        reading.add_expression_problem(problem, output.shown.place, problems)
        return
    if unit is None:
        return
    if unit.dimension != read_unit(output.shown.unit).dimension:
        problems.add("unit-wrong", f"output '{name}' is in {unit.text}, its column in {output.shown.unit}", output.place,
                     hint=other_unit(read_unit(output.shown.unit), unit))
        return
    check_turns(output.shown.unit, unit, f"output '{name}'", output.place, problems)
    if counts_from_origin(output.shown.unit):
        try:
            weight = check_origins(output.shown.expr, assembly.flat.origins.lookup(), shown=True)
        except ExpressionProblem as problem:
            reading.add_expression_problem(problem, output.shown.place, problems)
            return
        if weight == 0:
            problems.add("unit-offset", f"output '{name}' is a difference of temperatures; {output.shown.unit} has an "
                         "offset", output.place,
                         hint=f"Write `unit: {interval_unit(output.shown.unit)}`.")


def _channel(name: str, samples: Samples, simulated: Array, counts: Mask, astray: Mask, late: TimeDelay | None) -> Channel:
    measured, model, noise = samples.measured[counts], simulated[counts], samples.noise
    weight = noise / samples.deviation[counts]
    return Channel(
        name=name, unit=samples.output.shown.unit, time=samples.time, measured=samples.measured, model=simulated,
        noise=noise, noise_given=samples.noise_given, statistics=metrics.statistics(measured, model, weight, noise),
        counts=counts, outlier=samples.outlier, astray=astray, step=samples.step, late=late,
        separable=samples.estimate is None or samples.estimate.separable)
