"""Experiments: a diagram with measured records, read from a file."""

from __future__ import annotations

import math
from collections.abc import Mapping as Dictionary
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from filecmp import cmp
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, Place, Problem, Problems, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.core.units import Range, UnitProblem, counts_from_origin, interval_unit, parse_quantity, parse_range, unit
from heavebond.language import reading
from heavebond.language.definition import FileInput
from heavebond.language.edits import Change
from heavebond.language.model import Model, beside, beside_hint, find, load_beside
from heavebond.language.sections import Condition, NamedOutput, Setting, read_conditions, read_settings, shown_as
from heavebond.records.measurements import SUFFIXES
from heavebond.records.noise import NoiseEstimate
from heavebond.records.time_axis import TimeAxis
from heavebond.text.dimensions import KELVIN, as_interval, origins
from heavebond.text.expression import Name, calling, constant, parse_formula
from heavebond.text.yaml_source import Mapping, Node, Scalar, Source, read

EXPERIMENT_KEYS = ("experiment", "summary", "extends", "model", "records", "time", "inputs", "outputs", "free", "notes")
RECORD_KEYS = ("file", "use", "from", "to", "set", "initial", "inputs", "outputs")
USES = ("fit", "validate", "test")
EXAMPLES = {"records": "Write for example `records: {monday: {file: monday.csv, use: fit}}`.",
            "outputs": "Write for example `outputs: {crown.x: {column: crown_m, unit: m, noise: 1 mm}}`.",
            "time": f"Write {reading.TIME_EXAMPLE}."}
FARTHEST = 6.0  # standard deviations below the mean at which the logarithm of a value that is not above zero is taken
ROUNDING = 1e-9  # share of a residual or derivative below which the rest without the carried errors is rounding
FIXED = "fixed"  # `free: {gas.c: fixed}` removes a parameter from the inherited list


@dataclass(frozen=True)
class Origin:
    """File and times of a channel if they differ from the record's."""

    file: Path | None = None
    time: TimeAxis | None = None


@dataclass(frozen=True)
class Record:
    """One measured file: its use, its time range, and its settings."""

    name: str
    file: Path
    use: str
    place: Place
    begin: float | None = None
    end: float | None = None
    settings: dict[str, Setting] = field(default_factory=dict)
    conditions: dict[str, Condition] = field(default_factory=dict)
    inputs: dict[str, FileInput] = field(default_factory=dict)
    origins: dict[str, Origin] = field(default_factory=dict)


@dataclass(frozen=True)
class Output:
    """A measured channel: the formula that it should equal, its column, and the noise (standard deviation, in the channel's
    unit) if it is given.

    shift: delay of the channel in seconds, measured(t) = formula(t - shift); drop_outliers: True if outliers are excluded
    from all figures.
    """

    shown: NamedOutput
    column: str
    noise: float | None
    place: Place
    origin: Origin = Origin()
    shift: float = 0.0
    drop_outliers: bool = False


@dataclass(frozen=True)
class Prior:
    """Knowledge of a parameter before its fit: its value (SI), or its natural logarithm, is normally distributed."""

    mean: float
    deviation: float
    logarithmic: bool = False

    def at(self, value: float) -> tuple[float, float]:
        """The distance of a value from the mean in standard deviations, and its derivative. The logarithm of a value that
        is not above zero is limited to `FARTHEST` standard deviations below the mean."""
        if not self.logarithmic:
            return (value - self.mean) / self.deviation, 1 / self.deviation
        least = math.exp(self.mean - FARTHEST * self.deviation)
        if value <= least:
            return -FARTHEST, 0.0
        return (math.log(value) - self.mean) / self.deviation, 1 / (value * self.deviation)


@dataclass(frozen=True)
class Free:
    """A parameter, or `initial.NAME`, with its range in a fit; with `each` every record has a separate value. `given` is
    its original value in the diagram (SI), if the diagram contains a fitted one; `typical` the knowledge of such parameters
    in general."""

    name: str
    range: Range
    place: Place
    each: bool = False
    given: float | None = None
    typical: Prior | None = None

    @property
    def prior(self) -> Prior | None:
        """What is known before the fit: the tolerance of the data sheet, which is two standard deviations, or else what is
        typical; None if nothing is."""
        nominal = self.range.nominal
        return Prior(nominal, (self.range.high - nominal) / 2) if nominal is not None else self.typical


@dataclass(frozen=True, eq=False)
class InputNoise:
    """Effect of noise realisations of the inputs on the channels of a record: `errors` (realisations, channels, N) at its
    `time` (N,) in s, in the unit of each channel."""

    time: NDArray[np.float64]
    errors: NDArray[np.float64]

    def at(self, k: int, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """The errors (realisations, n) of channel k at times (n,)."""
        return np.array([np.interp(time, self.time, errors[k]) for errors in self.errors])


@dataclass(frozen=True, eq=False)
class Horizon:
    """The segments of a record within which a model is compared, and the errors that it carries from one to the next.

    A machine that integrates keeps an error of its state. `responses` (channels, N, d) are the changes of the channels (SI)
    by d such errors of the state at the beginning of each segment, at the times (N,); `segment` (N,) is the number of the
    segment. The part of a residual along these responses is no evidence. It is removed, as d free initial values in each
    segment would do (see `diagnosis.evidence.horizons`).
    """

    time: NDArray[np.float64]
    segment: NDArray[np.int64]
    responses: NDArray[np.float64]

    def carried(self, channel: NDArray[np.int64], time: NDArray[np.float64], noise: NDArray[np.float64]
                ) -> list[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """The samples (k,) of each segment and an orthonormal basis (k, d) of the carried errors, in units of the noise, for
        residuals (n,) of these channels at these times (n,)."""
        place = np.clip(np.searchsorted(self.time, time - 1e-9 * (self.time[-1] - self.time[0])), 0, len(self.time) - 1)
        parts = []
        for number in np.unique(self.segment[place]):
            samples = np.flatnonzero(self.segment[place] == number)
            columns = self.responses[channel[samples], place[samples]] / noise[samples, None]
            basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
            parts.append((samples, basis[:, sizes > 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300)]))
        return parts


def without_carried(parts: Sequence[tuple[NDArray[np.int64], NDArray[np.float64]]], rows: NDArray[np.float64]
                    ) -> NDArray[np.float64]:
    """Residuals, or rows of their derivatives (..., n), without the errors that `Horizon.carried` gives. A row that is such
    an error except for rounding becomes zero: the offset of a sensor has no effect within segments."""
    cleaned = rows.copy()
    for samples, basis in parts:
        cleaned[..., samples] -= (cleaned[..., samples] @ basis) @ basis.T
    rounded = np.linalg.norm(cleaned, axis=-1) <= ROUNDING * np.linalg.norm(rows, axis=-1)
    return np.where(rounded[..., None], 0.0, cleaned)


@dataclass(frozen=True)
class Experiment:
    """A diagram with its records: the columns that are inputs and outputs, and the free parameters with their ranges.

    `estimated_noise` is the noise of channels without a given one, over all records (see `estimation.channel_noise`),
    `input_noise` the effect of the noise of its inputs on the channels of each record (see `estimation.input_noise`),
    `horizons` the segments within which a model is compared, for records over which it integrates errors."""

    name: str
    path: Path
    model: Model
    records: dict[str, Record] = field(default_factory=dict)
    time: TimeAxis = field(default_factory=TimeAxis)
    inputs: dict[str, FileInput] = field(default_factory=dict)
    outputs: dict[str, Output] = field(default_factory=dict)
    free: dict[str, Free] = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    estimated_noise: Dictionary[str, NoiseEstimate] = field(default_factory=dict, repr=False, compare=False)
    input_noise: Dictionary[str, InputNoise] = field(default_factory=dict, repr=False, compare=False)
    horizons: Dictionary[str, Horizon] = field(default_factory=dict, repr=False, compare=False)

    def __repr__(self) -> str:
        return brief(self, self.name, f"model {self.model.name}, {count(len(self.records), 'record')}",
                     f"outputs {listing(list(self.outputs), 8)}", f"free {listing(list(self.free), 8)}" if self.free else "")

    @property
    def noise_given(self) -> bool:
        """True if the experiment specifies the noise of every output (else it is estimated from the records)."""
        return all(output.noise is not None for output in self.outputs.values())

    def with_parameters(self, values: Dictionary[str, str]) -> Experiment:
        """The experiment with values of parameters as text, which override those set for a single record."""
        model = self.model.with_parameters(values)
        settings = {path: value for path, value in model.settings.items() if self.model.settings.get(path) != value}
        return replace(self, model=model, records={
            name: replace(record, settings={**record.settings, **settings}) for name, record in self.records.items()})

    def with_record_values(self, values: Dictionary[str, Dictionary[str, float | str]]) -> Experiment:
        """The experiment with values of parameters and initial values (`initial.crown.x`) for single records, by their
        names; in SI, or as text."""
        records = dict(self.records)
        for name, record_values in values.items():
            model, record = self.model.with_parameters(record_values), records[name]
            settings = {path: model.settings[path] for path in record_values if path in model.settings}
            conditions = {state: model.initial.conditions[state] for path in record_values
                          if (state := path.removeprefix("initial.")) != path}
            records[name] = replace(record, settings={**record.settings, **settings},
                                    conditions={**record.conditions, **conditions})
        return replace(self, records=records)

    def model_for(self, record: Record) -> Model:
        """The model of one record: the diagram with its measured inputs, settings and initial values; a run continues to
        its end."""
        settings = {**self.model.settings, **record.settings}
        for path, file_input in self.inputs_for(record).items():
            settings[path] = Setting(path, file_input, file_input.place)
        initial = replace(self.model.initial, conditions={**self.model.initial.conditions, **record.conditions})
        return replace(self.model, settings=settings, initial=initial, ends=None)

    def inputs_for(self, record: Record) -> dict[str, FileInput]:
        """The measured inputs of a record by name, with file and times."""
        inputs = {}
        for path, file_input in {**self.inputs, **record.inputs}.items():
            inputs[path] = file_input if file_input.file != Path() else replace(file_input, file=record.file)
            inputs[path] = replace(inputs[path], time=file_input.time or self.time, zero=(record.file, self.time))
        return inputs

    def origin_of(self, record: Record, name: str) -> tuple[Path, TimeAxis]:
        """File and times of an output in a record."""
        common, origin = self.outputs[name].origin, record.origins.get(name, Origin())
        return origin.file or common.file or record.file, origin.time or common.time or self.time

    def holds_out(self, record: Record) -> bool:
        """True if sections of a record are held out of the fit as validation data, because no other record is."""
        return record.use == "fit" and all(r.use == "fit" for r in self.records.values())


def _is_quantity(text: str) -> bool:
    """True for a number with or without a unit."""
    try:
        parse_quantity(text)
    except UnitProblem:
        return False
    return True


def with_inputs_moved(experiment: Experiment, to: Dictionary[str, str]) -> Experiment:
    """The experiment with measured inputs redirected to other inputs, by the names of both."""
    def redirected(inputs: Dictionary[str, FileInput]) -> dict[str, FileInput]:
        return {to.get(name, name): file_input for name, file_input in inputs.items()}

    records = {n: replace(r, inputs=redirected(r.inputs)) for n, r in experiment.records.items()}
    return replace(experiment, inputs=redirected(experiment.inputs), records=records)


def changed_experiment(experiment: Experiment, change: Change) -> Experiment:
    """The experiment with the changed diagram, and with its outputs and inputs moved by the change.

    A free parameter of a part that is replaced is free no longer if the new part has no parameter of this name.
    """
    model = change.on_model(experiment.model)
    outputs = dict(experiment.outputs)
    for channel, formula in change.channels.items():
        output_shown = replace(outputs[channel].shown, expr=parse_formula(formula), text=formula)
        outputs[channel] = replace(outputs[channel], shown=output_shown)

    def lost(name: str) -> bool:
        owner, _, parameter = name.partition("[")[0].rpartition(".")
        return (owner in change.components
                and parameter not in model.library.component(change.components[owner].kind).parameters)

    free = {name: f for name, f in experiment.free.items() if not lost(name)}
    place = next(iter(experiment.records.values())).place
    free |= {name: Free(name, span, free[name].place if name in free else place, True) for name, span in change.each.items()}
    changed = replace(experiment, model=model, outputs=outputs, free=free).with_record_values(change.of_records)
    return with_inputs_moved(changed, change.moved)


ExperimentOrFile: TypeAlias = Experiment | str | Path


def load_experiment(experiment: ExperimentOrFile) -> Experiment:
    """Load an experiment.

    `experiment` is the path of a file or the name of a bundled one (`passive_rig/friction`); an Experiment is returned
    unchanged. Raises UsageError if the file does not exist, ModelError with the lines that are wrong.
    """
    return experiment if isinstance(experiment, Experiment) else _load(find(experiment, "experiment", SUFFIXES), ())


def _load(path: Path, chain: tuple[Path, ...]) -> Experiment:
    return experiment_from_source(read(path), chain)


def experiment_from_source(source: Source, chain: tuple[Path, ...] = ()) -> Experiment:
    """The experiment of a YAML text; `chain` are the files that extend it. ModelError with the lines that are wrong."""
    root = source.root
    if "experiment" not in root.items:
        kind = next((k for k in ("model", "component", "function", "study") if k in root.items), None)
        hint = "This file describes a diagram; `heavebond run` runs it. An experiment compares it with records: " \
            f"`heavebond new NAME.yaml --from {source.name} RECORD.csv` proposes one." if kind == "model" else \
            f"This file describes a {kind}." if kind else \
            suggest("experiment", root.items) or "An experiment begins with `experiment: name`."
        raise ModelError([Problem("not-an-experiment", f"{source.name} is not an experiment: it has no `experiment:`",
                                  root.place, hint)])
    problems = Problems()
    reading.known_keys(root, EXPERIMENT_KEYS, "an experiment", problems)
    base = _base(source, chain, problems)
    node = source.root.items.get("model")
    if node is None:
        if base is None:
            raise ModelError([Problem("key-missing", "an experiment needs the entry 'model'", source.root.place,
                                      "Add `model: diagram.yaml`.")])
        model = base.model
    else:
        model = load_beside(source, node, problems)
    problems.raise_as(ModelError)
    with calling(model.library.functions):
        experiment = _Reader(source, problems, model).changed(base)
    problems.raise_as(ModelError)
    return experiment


def _base(source: Source, chain: tuple[Path, ...], problems: Problems) -> Experiment | None:
    node = source.root.items.get("extends")
    if node is None:
        return None
    target = beside(source.path.parent, reading.text(node, "extends", problems))
    if target.resolve() in (*chain, source.path.resolve()):
        raise ModelError([Problem("extends-circle", f"{source.name} extends itself", node.place,
                                  "One of them must be a complete experiment, without `extends:`.")])
    if not target.is_file():
        near = [p.name for p in sorted(source.path.parent.glob("*.yaml"))]
        raise ModelError([Problem("file-missing", f"there is no file {target.name}", node.place,
                                  suggest(target.name, near) or beside_hint(source.path, near))])
    return _load(target, (*chain, source.path.resolve()))


@dataclass
class _Reader:
    source: Source
    problems: Problems
    model: Model

    def changed(self, base: Experiment | None) -> Experiment:
        root, problems, model = self.source.root, self.problems, self.model
        name = reading.text(root.items["experiment"], "experiment", problems)
        experiment_read = replace(base, name=name, path=self.source.path, model=model) if base else \
            Experiment(name, self.source.path, model)
        time = root.items.get("time")
        axis = reading.time_axis(time, problems) if time is not None else base.time if base else None
        experiment = replace(
            experiment_read, time=axis or TimeAxis(),
            records={**experiment_read.records, **self._records(root.items.get("records"), experiment_read.records)},
            inputs={**experiment_read.inputs, **self._inputs(root.items.get("inputs"))},
            outputs={**experiment_read.outputs, **self._outputs(root.items.get("outputs"), experiment_read.outputs)},
            free=self._free(root.items.get("free"), experiment_read.free), files=(*experiment_read.files, self.source.path))
        experiment = with_inputs_moved(experiment, self._moves(root.items.get("inputs"), experiment))
        for key, section in (("records", experiment.records), ("outputs", experiment.outputs), ("time", time or base)):
            if not section:
                problems.add("key-missing", f"an experiment needs the entry '{key}'", root.place, hint=EXAMPLES[key])
        for record in experiment.records.values():
            for unknown in [n for n in record.origins if n not in experiment.outputs]:
                problems.add("output-unknown", f"record '{record.name}' names the output '{unknown}', which is not there",
                             record.place, hint=suggest(unknown, experiment.outputs) or "Write it under `outputs:`.")
        # check that a validation record is not also fitted under another name
        records = list(experiment.records.values())
        for checking in (r for r in records if r.use != "fit"):
            for fitted in (r for r in records if r.use == "fit" and r.origins == checking.origins):
                if _together(fitted, checking) and _same_file(fitted.file, checking.file):
                    problems.add("records-same",
                                 f"record '{checking.name}' validates the fit, but its data are fitted as "
                                 f"'{fitted.name}'", checking.place,
                                 hint="Give another record, or another part of the file by "
                                 f"`from:` and `to:`; or leave '{checking.name}' out: then the last third is held out.")
        return experiment

    def _entries(self, node: Node | None, subject: str) -> list[tuple[str, Scalar, Node]]:
        entries = reading.mapping(node, subject, self.problems)
        return [(name, entries.keys[name], item) for name, item in entries.items.items()] if entries else []

    def _records(self, node: Node | None, before: Dictionary[str, Record]) -> dict[str, Record]:
        """Read the records; one of the extended experiment without a `file` gets further values under `set` and
        `initial`.
        """
        records = {}
        for name, key, item in self._entries(node, "records"):
            entry = reading.mapping(item, f"record '{name}'", self.problems)
            if entry is not None and name in before and entry.items and set(entry.items) <= {"set", "initial"}:
                settings = read_settings(entry.items.get("set"), self.source, self.problems)
                conditions = read_conditions(entry.items.get("initial"), self.problems)
                records[name] = replace(before[name], settings={**before[name].settings, **settings},
                                        conditions={**before[name].conditions, **conditions})
            elif entry is not None:
                records[name] = self._record(name, key, entry)
        return records

    def _record(self, name: str, key: Scalar, entry: Mapping) -> Record:
        problems = self.problems
        reading.known_keys(entry, RECORD_KEYS, f"record '{name}'", problems, required=("file", "use"))
        use = reading.text(entry.items.get("use"), "use", problems)
        if use and use not in USES:
            problems.add("use-unknown", f"'{use}' is not a `use:` of a record", entry.items["use"].place,
                         hint=suggest(use, USES) or "Write `use: fit`, `use: validate` or `use: test`.")
        file = entry.items.get("file")
        return Record(
            name, self.source.path.parent / reading.text(file, "file", problems), use,
            file.place if file is not None else key.place, self._time(entry.items.get("from"), "from"),
            self._time(entry.items.get("to"), "to"), read_settings(entry.items.get("set"), self.source, problems),
            read_conditions(entry.items.get("initial"), problems), self._inputs(entry.items.get("inputs")),
            self._origins(entry.items.get("outputs")))

    def _time(self, node: Node | None, subject: str) -> float | None:
        return reading.seconds(node, subject, self.problems)

    def _moves(self, node: Node | None, experiment: Experiment) -> dict[str, str]:
        """Read `lag.u: valve.u`: the column that was the input `valve.u` of the extended experiment now drives `lag.u`."""
        known = [*experiment.inputs, *(n for r in experiment.records.values() for n in r.inputs)]
        moves = {}
        for name, _, item in self._entries(node, "inputs"):
            if isinstance(item, Scalar) and item.text in known:
                moves[item.text] = name
            elif isinstance(item, Scalar) and _is_quantity(item.text):
                part, _, signal = name.rpartition(".")
                self.problems.add(
                    "input-constant", f"input '{name}' has a value ({item.text}) instead of a column", item.place,
                    hint=f"Write a constant value in the diagram (`{signal}: {item.text}` at {part}), or for one record "
                    f"`set: {{{name}: {item.text}}}` there. A measured input is `{name}: {{column: ..., unit: ...}}`.")
            elif isinstance(item, Scalar):
                self.problems.add("input-unknown", f"there is no input '{item.text}' that '{name}' could replace",
                                  item.place, hint=suggest(item.text, known)
                                  or f"Write `{name}: {{column: ..., unit: ...}}`.")
        return moves

    def _inputs(self, node: Node | None) -> dict[str, FileInput]:
        inputs = {}
        for name, key, item in self._entries(node, "inputs"):
            if isinstance(item, Scalar):
                continue  # it replaces another input of the record
            entry = reading.mapping(item, f"input '{name}'", self.problems)
            file_input = reading.file_input(entry, self.source, self.problems, name,
                                            file=False) if entry is not None else None
            if file_input is not None and entry is not None:
                noise = self._noise(entry.items.get("noise"), file_input.unit)
                inputs[name] = replace(file_input, place=key.place, noise=noise or 0.0)
        return inputs

    def _outputs(self, node: Node | None, before: Dictionary[str, Output]) -> dict[str, Output]:
        outputs = {}
        for name, key, item in self._entries(node, "outputs"):
            if name in before and isinstance(item, Mapping) and "column" not in item.items:
                # an inherited output with another formula, a delay, or dropped outliers
                output = before[name]
                reading.known_keys(item, ("is", "shift", "outliers"), f"output '{output.shown.name}'", self.problems)
                formula = item.items.get("is")
                if isinstance(formula, Scalar):
                    tree = reading.parsed(parse_formula, formula.text.lstrip("= "), formula.place, self.problems)
                    output = output if tree is None else replace(output, shown=replace(
                        output.shown, expr=tree, text=formula.text.lstrip("= "), place=formula.place))
                if "shift" in item.items:
                    output = replace(output, shift=self._time(item.items["shift"], "shift") or 0.0)
                if "outliers" in item.items:
                    choice = reading.choice(item.items["outliers"], "outliers", ("drop", "keep"), self.problems)
                    output = replace(output, drop_outliers=choice == "drop")
                outputs[name] = output
                continue
            shown_output = shown_as(name, item, key, self.problems,
                                    extra=("column", "noise", "file", "time", "shift", "outliers"))
            if shown_output is None or not isinstance(item, Mapping):
                continue
            column = item.items.get("column")
            if column is None:
                self.problems.add("key-missing", f"output '{name}' needs the entry 'column'", key.place,
                                  hint="Add `column: name_in_the_file`.")
                continue
            if counts_from_origin(shown_output.unit) and origins(shown_output.expr, self._node_origin) == 0:
                shown_output = replace(shown_output, unit=interval_unit(shown_output.unit))  # a difference of temperatures
            noise = self._noise(item.items.get("noise"), shown_output.unit)
            outliers = reading.choice(item.items.get("outliers"), "outliers", ("drop", "keep"), self.problems)
            outputs[name] = Output(shown_output, reading.text(column, "column", self.problems), noise, column.place,
                                   self._origin(item), self._time(item.items.get("shift"), "shift") or 0.0,
                                   outliers == "drop")
        return outputs

    def _node_origin(self, name: Name) -> float | None:
        """1 for a temperature of a node, which has the name in its domain; None for other names.

        The formula of an entry of `show` names variables of the machine, also the variable with the name of the entry.
        """
        show = self.model.show.get(name.text)
        return self._variable_origin(name) if show is None else origins(show.expr, self._variable_origin)

    def _variable_origin(self, name: Name) -> float | None:
        """1 for a temperature of a node; None for other variables."""
        member = name.text.rpartition(".")[2]
        temperatures = (d.members[m] for d in self.model.library.domains.values() for m in d.across if m == member)
        return 1.0 if any(m.unit.dimension == KELVIN for m in temperatures) else None

    def _origins(self, node: Node | None) -> dict[str, Origin]:
        origins = {}
        for name, _, item in self._entries(node, "outputs"):
            entry = reading.mapping(item, f"output '{name}'", self.problems)
            if entry is not None:
                reading.known_keys(entry, ("file", "time"), f"output '{name}' of a record", self.problems)
                origins[name] = self._origin(entry)
        return origins

    def _origin(self, entry: Mapping) -> Origin:
        file, time = entry.items.get("file"), entry.items.get("time")
        path = self.source.path.parent / reading.text(file, "file", self.problems) if file is not None else None
        return Origin(path, reading.time_axis(time, self.problems) if time is not None else None)

    def _noise(self, node: Node | None, unit_text: str) -> float | None:
        """The `noise:` of a column in its unit."""
        if node is None:
            return None
        value = reading.value(node, "noise", self.problems)
        number = constant(as_interval(value.expr)) if value is not None else None
        if value is None or number is None:
            return None
        try:
            channel = unit(unit_text)
        except UnitProblem:
            return None  # the error in the channel's unit has been reported
        unit_given = getattr(value.expr, "unit", None)
        if (unit_given.dimension if unit_given is not None else ()) != channel.dimension:
            bare = unit_given is None and channel.dimension
            hint = f"Write `noise: {value.text} {unit_text}`, if that is meant." if bare else \
                f"Write for example `noise: {f'1 {unit_text}' if channel.dimension else '0.01'}`."
            self.problems.add("unit-wrong", f"the noise '{value.text}' is not in {unit_text}", value.place, hint=hint)
            return None
        if number <= 0:
            self.problems.add("noise-not-positive", "the noise must be above 0", value.place,
                              hint="Omit it if it is not known: for an output it is then estimated.")
            return None
        return number / channel.scale

    def _free(self, node: Node | None, before: Dictionary[str, Free]) -> dict[str, Free]:
        free = dict(before)
        for name, key, item in self._entries(node, "free"):
            each = False
            if isinstance(item, Scalar) and item.text == FIXED:
                if name not in free:
                    self.problems.add("free-unknown", f"'{name}' is not free in the experiment that this one extends",
                                      item.place, hint=suggest(name, free) or (f"Free there: {listing(free)}."
                                                                               if free else "Leave this line out."))
                free.pop(name, None)
                continue
            if isinstance(item, Mapping):
                reading.known_keys(item, ("range", "each"), f"'{name}'", self.problems, required=("range",))
                each = reading.text(item.items.get("each"), "each", self.problems) == "record"
                item = item.items.get("range", key)
            try:
                content = reading.text(item, name, self.problems)
                free[name] = Free(name, parse_range(content), item.place, each)
            except UnitProblem as problem:
                self.problems.add(problem.code, f"{name}: {problem.message}", item.place, hint=problem.hint)
        return free


def _together(first: Record, second: Record) -> bool:
    """True if the times between `from:` and `to:` overlap."""
    begin, end = (max(r.begin if r.begin is not None else -math.inf for r in (first, second)),
                  min(r.end if r.end is not None else math.inf for r in (first, second)))
    return begin < end


def _same_file(first: Path, second: Path) -> bool:
    """True if two files are one, or copies of each other; missing files are reported when they are read."""
    return first.is_file() and second.is_file() \
        and (first.resolve() == second.resolve() or cmp(first, second, shallow=False))
