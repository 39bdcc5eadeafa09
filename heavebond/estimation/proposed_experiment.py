"""An experiment proposed from a record: columns are classified as time, inputs and outputs of the diagram.

Columns are compared with the inputs and signals of a diagram by the words of their names and by their units. A record
contains no more information, so the user must check a proposal.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from heavebond.core.errors import DataError, HeavebondError, Problem, UsageError, listing
from heavebond.core.presentation import number
from heavebond.core.units import (
    Unit,
    UnitProblem,
    as_meant,
    check_unit,
    dimension_text,
    parse_quantity,
    read_unit,
    unknown_unit,
)
from heavebond.equations.parameters import declared
from heavebond.language.definition import Value
from heavebond.language.edits import block, extended_from, quoted
from heavebond.language.model import Model
from heavebond.numerics.dae import Assembly, assemble
from heavebond.records.measurements import BRIDGED, Table, check_time, gaps, increases, read_table, timed
from heavebond.records.time_axis import FIXED_RATE, TimeAxis
from heavebond.text.expression import Number

# words and letters for a quantity, without information on the place of the sensor
QUANTITIES = frozenset({"pressure", "p", "flow", "q", "force", "f", "torque", "moment", "m", "speed", "velocity", "v", "w",
                        "n", "position", "displacement", "x", "angle", "phi", "temperature", "t", "voltage", "u", "current",
                        "i", "tau"})
TIMES = frozenset({"t", "time", "times", "zeit", "tid", "temps", "seconds", "sec", "timestamp", "clock", "date", "datetime"})
SKETCHED = 160  # points of a column in its sketch
# share of samples that differ from the one before, and size of a typical step relative to the range
STEPPING, STEP = 0.2, 0.05
LETTER = 0.1  # score of a single letter that two names share
TOLERANCE = 20.0  # %, for a parameter without other information
SHORT = 3  # least letters of an abbreviated word: `pos` for `position`
_RANGE = re.compile(r"[\w.][\w.+\-*/ %]*")  # values without quotes
SMOOTH = frozenset({"m", "rad"})  # measured positions, whose derivatives are used: they are smooth between samples


@dataclass(frozen=True)
class Column:
    """A column of a record: its unit in the file, if there is one, its proposed role (`time`, `input`, `output` or none)
    and signal; least and largest value, the number of values, and a sketch of its values."""

    name: str
    unit: str
    unit_known: bool
    role: str
    target: str
    interpolation: str
    low: float
    high: float
    count: int
    sketch: tuple[float, ...]


@dataclass(frozen=True)
class Proposal:
    """The proposal for a record: its columns, and the possible inputs, outputs and signals of the diagram, by name with
    units and descriptions."""

    columns: tuple[Column, ...]
    inputs: Mapping[str, tuple[str, str]]
    outputs: Mapping[str, tuple[str, str]]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Target:
    """An input or an output of the diagram with words for it; `driving` if it moves the diagram."""

    name: str
    unit: Unit
    doc: str
    words: frozenset[str]
    role: str
    driving: bool = False


@dataclass(frozen=True)
class Instructions:
    """How to add what was not recognised in a record: a column that drives the diagram, the column or value of an input
    without a value, an output, the time between rows without times."""

    drive: str
    open_input: str
    output: str
    fixed_rate: str


IN_THE_FILE = Instructions("give under `inputs:` the column of a measured input",
                           "give its column under `inputs:`, or a value in the diagram",
                           "give the measured quantities under `outputs:`", FIXED_RATE)
IN_THE_FORM = Instructions("choose the role 'input' for the column of a measured input",
                           "choose the role 'input' for its column, or give it a value in the diagram",
                           "choose the role 'output' for the measured columns, with their variables",
                           "Rows of a fixed rate: use no column as time and give the time between two rows.")


def propose(table: Table, assembly: Assembly, open_inputs: Sequence[str] = (), every: str = "", *,
            instructions: Instructions = IN_THE_FILE) -> Proposal:
    """The probable role of the columns of a record for a diagram, in which the `open_inputs` have no value. If the rows have
    equal steps of `every` (`10 ms`), no column is a time. Its remarks give the `instructions` for a file or a form."""
    time = None if every else _time_column(table)
    if time is not None:
        table = timed(table, TimeAxis(time))
    inputs, outputs, signals = _inputs(assembly, open_inputs), _outputs(assembly), _signals(assembly)
    units = {name: table.unit_of(name) for name in table.header}
    # a diagram without outputs can be compared by the variables of its parts and nodes
    likely = outputs or [t for t in signals if t.name.count(".") == 1]
    able = [n for n in table.header if n in table.columns and n != time]
    chosen = _as_inputs(assembly, inputs, _matched(able, units, [*inputs, *likely], [*outputs, *signals]))
    columns, remarks = [], []
    for name in table.header:
        if name not in table.columns:
            remarks.append(f"'{name}' is left out: " + (table.defects[name][0].message if name in table.defects else
                                                        "it holds no numbers"))
            continue
        role, target = ("time", None) if name == time else \
            (chosen[name].role, chosen[name]) if name in chosen else ("", None)
        columns.append(_column(table, name, units[name], role, target))
        if units[name] is None and (unread := table.unit_text(name)):
            remarks.append(f"'{unread}', the unit of '{name}', is not known. {unknown_unit(unread)}")
    if time is None and not every:
        remarks.append(f"no column is a time, none increases from row to row. {instructions.fixed_rate}")
    elif time is not None and _counts_rows(table, time):
        remarks.append(f"'{time}' counts the rows. {instructions.fixed_rate}")
    if not inputs:
        remarks.append("no input of this diagram can be driven by a record: that needs a signal input that is given a value "
                       "and has no wire")
    elif not any(c.role == "input" for c in columns):
        able_inputs = listing([t.name for t in inputs], 3)
        remarks.append(f"no column was recognised that drives the diagram: {instructions.drive} ({able_inputs})")
    if undriven := [name for name in open_inputs if name not in [c.target for c in columns if c.role == "input"]]:
        remarks.append(f"{listing(undriven, 3)} {'has' if len(undriven) == 1 else 'have'} no value, and no column was "
                       "recognised as one: " + instructions.open_input)
    if not any(c.role == "output" for c in columns):
        remarks.append("no column was recognised as an output: " + instructions.output)
    return Proposal(tuple(columns), {t.name: (t.unit.text, t.doc) for t in inputs},
                    {t.name: (t.unit.text, t.doc) for t in (*outputs, *signals)}, tuple(remarks))


def _column(table: Table, name: str, unit: tuple[str, Unit, bool] | None, role: str, target: _Target | None) -> Column:
    """The proposal for a column, with some points of its time series: the least and the largest value of each interval."""
    values = table.columns[name]
    finite = values[np.isfinite(values)]
    usual = "s" if role == "time" else target.unit.text if target is not None else "1"
    between = ""
    if target is not None and role == "input":
        # a held command stays at values and steps from one to the next: most samples repeat the one before, and a typical
        # step is larger than a rounding of a slow signal
        steps = np.abs(np.diff(finite))
        jumps = steps[steps > 0]
        held = 0 < len(jumps) < STEPPING * len(steps) and float(np.median(jumps)) > STEP * float(np.ptp(finite))
        between = "hold" if held else "spline" if dimension_text(target.unit.dimension) in SMOOTH else "linear"
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    text = usual if unit is None else unit[1].text if target is None else as_meant(unit[1], target.unit).text
    sketch = tuple(finite.tolist())
    if len(finite) > SKETCHED:
        ends = np.linspace(0, len(finite), SKETCHED // 2 + 1).astype(int)
        sketch = tuple(v for a, b in pairwise(ends) for v in (float(finite[a:b].min()), float(finite[a:b].max())))
    return Column(name, text, unit is not None, role, target.name if target is not None else "", between, low, high,
                  len(finite), sketch)


# -- roles of columns -------------------------------------------------------------------------------------------------
def _time_column(table: Table) -> str | None:
    """The column of times: the first with such a name, else the first of clock times, else the first numeric one, with
    increasing values; None without one. DataError for a column with such a name that has other cells too."""
    for name, problems in table.defects.items():
        if _words(name) & TIMES:
            raise DataError(list(problems))
    able = [name for name in table.header if name in table.columns or name in table.words or name in table.clocks]
    rising = [name for name in able if name in table.columns and increases(table.columns[name])]
    called = [name for name in able if _words(name) & TIMES and (name not in table.columns or name in rising)]
    return next(iter(called), None) or next((name for name in able if _is_clock(table, name)), None) or \
        next(iter(rising), None)


def _counts_rows(table: Table, name: str) -> bool:
    """True for a column 0, 1, 2, ... or 1, 2, 3, ... that is neither called a time nor has a unit."""
    values = table.columns[name]
    return not _words(name) & TIMES and table.unit_of(name) is None and values[0] in (0, 1) and bool(
        np.all(np.diff(values) == 1))


def _is_clock(table: Table, name: str) -> bool:
    """True if a column contains dates or times of day that increase, in any language of the header."""
    if name in table.columns:
        return False
    try:
        return increases(timed(table, TimeAxis(name)).columns[name])
    except DataError:
        return False


def _inputs(assembly: Assembly, open_inputs: Sequence[str]) -> list[_Target]:
    """Signal inputs that a record can drive; first those that move the diagram now, or have no value in it."""
    expanded, possible_inputs = assembly.flat.expanded, list[_Target]()
    for leaf in expanded.leaves.values():
        nodes = [path for path, junction in expanded.junctions.items() if any(e.leaf == leaf.path for e in junction.ends)]
        for name, bound in leaf.inputs.items():
            port = leaf.component.signals[name]
            words = frozenset({*_words(leaf.path), *(w for node in nodes for w in _words(node))})
            path = f"{leaf.path}.{name}"
            unit = assembly.flat.unknowns[assembly.flat.names[path]].unit  # that of the port may be generic ($U)
            possible_inputs.append(_Target(path, unit, port.doc, words, "input", bound.varies or path in open_inputs))
    return sorted(possible_inputs, key=lambda t: not t.driving)


def _open_inputs(model: Model) -> list[str]:
    """The inputs of the diagram's parts that have neither a value nor a wire."""
    joined = {end.path for wire in model.body.wires.values() for end in wire.ends}
    return [path for part, instance in model.body.instances.items() if instance.kind in model.library.files
            for signal in model.library.component(instance.kind).signals.values()
            if signal.direction == "in" and signal.count is None and signal.name not in instance.settings
            and (path := f"{part}.{signal.name}") not in joined and path not in model.settings]


def _outputs(assembly: Assembly) -> list[_Target]:
    """The outputs under `show:`, by their formulas."""
    output_targets = []
    for name, output in assembly.model.show.items():
        try:
            unit = read_unit(output.unit)
        except UnitProblem:
            continue
        output_targets.append(_Target(output.text, unit, name, frozenset(_words(name) | _words(output.text)), "output"))
    return output_targets


def _signals(assembly: Assembly) -> list[_Target]:
    """All variables of the diagram that are not shown already."""
    shown_formulas = {output.text for output in assembly.model.show.values()}
    return [_Target(name, assembly.flat.unknowns[j].unit, assembly.flat.unknowns[j].doc, frozenset(_words(name)), "output")
            for name, j in assembly.flat.names.items() if name not in shown_formulas]


def _matched(columns: Sequence[str], units: Mapping[str, tuple[str, Unit, bool] | None], targets: Sequence[_Target],
             variables: Sequence[_Target]) -> dict[str, _Target]:
    """The target of each column: pairs by the number of shared words; inputs that drive the diagram before all outputs,
    because a record without them could not be simulated; then the variable at a place that a column names; then
    remaining columns for which the unit leaves one choice."""
    def fits(column: str, target: _Target) -> bool:
        unit = units[column]
        return unit is None or as_meant(unit[1], target.unit).dimension == target.unit.dimension

    pairs = [(target.driving, score, -k, column, target) for column in columns for k, target in enumerate(targets)
             if fits(column, target) and (score := _likeness(column, units[column], target)) > 0]
    matches: dict[str, _Target] = {}
    for _, _, _, column, target in sorted(pairs, key=lambda p: p[:3], reverse=True):
        if column not in matches and target not in matches.values():
            matches[column] = target
    matches |= _by_place([c for c in columns if c not in matches], units,
                         [v for v in variables if v not in matches.values()])
    not_driving = [t for t in targets if not t.driving]
    for driving, group in ((True, [t for t in targets if t.driving]),
                           (False, [t for t in not_driving if t.role == "output"]),
                           (False, [t for t in not_driving if t.role == "input"])):
        for target in group:
            unmatched = [c for c in columns if c not in matches and (driving or units[c] is not None) and fits(c, target)]
            rivals = [t for t in group if t not in matches.values() and t.unit.dimension == target.unit.dimension]
            if len(unmatched) == 1 and rivals == [target]:
                matches[unmatched[0]] = target
    return matches


def _as_inputs(assembly: Assembly, inputs: Sequence[_Target], chosen: Mapping[str, _Target]) -> dict[str, _Target]:
    """The targets of columns, with the input of a source in place of an output that this source prescribes: the measured
    speed of a pump is not an output if a SpeedSource turns the shaft of the pump."""
    expanded, targets = assembly.flat.expanded, dict(chosen)
    shared = {member for d in expanded.model.library.domains.values() for member in (*d.across, *d.positions)}
    for column, target in chosen.items():
        place, _, member = target.name.rpartition(".")
        ends = next((j.ends for path, j in expanded.junctions.items()
                     if place == path or any(place == f"{e.leaf}.{e.port}" for e in j.ends)), ())
        if target.role != "output" or member not in shared:
            continue
        able = [t for t in inputs if t not in targets.values() and t.unit.dimension == target.unit.dimension
                and any(t.name.rpartition(".")[0] == e.leaf for e in ends)]
        if len(able) == 1:
            targets[column] = able[0]
    return targets


def _by_place(columns: Sequence[str], units: Mapping[str, tuple[str, Unit, bool] | None], signals: Sequence[_Target]
              ) -> dict[str, _Target]:
    """The variable of a node or port for each column that names its place (`p_B [bar]`, `motor speed [rpm]`): it has the
    column's unit, and its path contains every word of the column except words for the quantity, which follow from the
    unit. The shortest such path is chosen; none if several are equally short."""
    places = {t: _words(path) for t in signals for path, _, member in [t.name.rpartition(".")] if member in QUANTITIES}
    by_place: dict[str, _Target] = {}
    for column in columns:
        column_unit = units[column]
        if column_unit is None or not (place := _words(_bare(column, column_unit)) - QUANTITIES):
            continue
        fit = [t for t, words in places.items() if t.unit.dimension == as_meant(column_unit[1], t.unit).dimension
               and place <= words and t not in by_place.values()]
        least = min((len(places[t]) for t in fit), default=0)
        shortest = [t for t in fit if len(places[t]) == least]
        if len(shortest) == 1:
            by_place[column] = shortest[0]
    return by_place


def _words(text: str) -> set[str]:
    """The words of a name in lower case: `deckPos_mm` gives deck, pos, mm."""
    parted = re.sub(r"([a-z])([A-Z])", r"\1 \2", text)
    return {word for word in re.split(r"[\W_0-9]+", parted.lower()) if word}


def _spelt(text: str) -> str:
    """A name without separators: `p_A` and `pA` are equal."""
    return re.sub(r"[\W_]+", "", text).lower()


def _bare(name: str, unit: tuple[str, Unit, bool] | None) -> str:
    """The name of a column without its unit."""
    return re.sub(rf"[\[(_ ]+{re.escape(unit[0])}[\])]*$", "", name) if unit is not None else name


def _likeness(name: str, unit: tuple[str, Unit, bool] | None, target: _Target) -> float:
    """Number of words that two names share; a word that begins another counts half, the same name one more. Single
    letters, which differ in meaning between files, count nothing by themselves but decide between similar names."""
    column = _words(name)
    same = sum(1.0 if len(word) > 1 else LETTER for word in column & target.words)
    same += _spelt(_bare(name, unit)) in (_spelt(target.name), _spelt(target.doc))
    short = sum(0.5 for a in column for b in target.words if a != b and min(len(a), len(b)) >= SHORT
                and (a.startswith(b) or b.startswith(a)))
    return same + short if same + short >= 0.5 else 0.0


# -- the experiment ------------------------------------------------------------------------------------------------------
def proposed_text(path: Path, model: Model, files: Sequence[Path], every: str = "") -> tuple[str, Proposal]:
    """The text of an experiment at `path` for a diagram and its records, proposed from the first of them, and the proposal.

    That record is fitted, the others validate. Numbers of the diagram that may be free are written as comments, and so
    are unrecognised columns, with the possible signals by their units. A record in which an input has a gap is cut to its
    longest part without one. `every` is the time between two rows of records without times (`10 ms`). HeavebondError if
    no column is a time, or none can be an output.
    """
    steps = _equal_steps(every) if every else None
    open_inputs = _open_inputs(model)
    assembly = assemble(model.with_parameters(dict.fromkeys(open_inputs, 0.0)))
    tables = {file: read_table(file) for file in files}
    proposal = propose(tables[files[0]], assembly, open_inputs, every)
    if not every:
        _check_named_times(tables[files[0]], proposal)
    chosen = [Chosen(c.name, c.role, c.unit, c.target, c.interpolation or "linear") for c in proposal.columns if c.role]
    uses = {file: "validate" if k else "fit" for k, file in enumerate(files)}
    parts = {file: part for file, table in tables.items() if (part := _without_gaps(table, chosen, steps)) is not None}
    proposal = replace(proposal, remarks=(*proposal.remarks, *(part.words(file.name) for file, part in parts.items())))
    text = experiment_text(path.stem, path, Records(model.path, uses, chosen, parts=parts, every=every),
                           _unrecognised(proposal))
    able = [f"#   {name}: {range_around(bound.value.text, TOLERANCE)}" for name, bound, _ in declared(assembly.flat.expanded)
            if name in assembly.parameter_values and bound.place.file == str(model.path) and isinstance(bound.value, Value)
            and isinstance(bound.value.expr, Number) and not bound.value.formula and bound.value.expr.value]
    if able:
        text += "\n".join(["# free:      # remove the # of uncertain parameters, and give their ranges", *able]) + "\n"
    return text, proposal


def _check_named_times(table: Table, proposal: Proposal) -> None:
    """Raise DataError with the rows if a column is called a time, but is not the proposed one because it repeats values. If
    no column is proposed as the time, also if it decreases."""
    times = [c.name for c in proposal.columns if c.role == "time"]
    if any(_words(name) & TIMES for name in times):
        return
    for name, values in table.columns.items():
        if _words(name) & TIMES and (not times or (np.all(np.diff(values) >= 0) and values[-1] > values[0])):
            check_time(table, name)


@dataclass(frozen=True)
class Part:
    """A part of a record, with the times and their unit as in the file, that ends at gaps of inputs (`columns`)."""

    first: str
    last: str
    columns: tuple[str, ...]

    def words(self, file: str) -> str:
        """Description of the omitted part, and the entry to use it instead."""
        inputs = listing([f"'{name}'" for name in self.columns])
        have = "has" if len(self.columns) == 1 else "have"
        return f"{inputs} of '{file}' {have} a gap: the record is cut to its longest part without one, " \
            f"`from: {self.first}` to `to: {self.last}`; `gaps: bridge` at an input goes across"


def _equal_steps(every: str) -> TimeAxis:
    """The times of rows with the distance `every`; UsageError unless this is a time above 0."""
    try:
        step, unit = parse_quantity(every)
        check_unit(unit, read_unit("s"), step, every)
        if not 0 < step < np.inf:
            raise UnitProblem("step-not-positive", f"a step of {every} is not above 0", "")
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"the time between two rows: {problem.message}", None,
                                  problem.hint or "Write for example '10 ms'.")]) from None
    return TimeAxis(every=step)


def _without_gaps(table: Table, chosen: Sequence[Chosen], steps: TimeAxis | None) -> Part | None:
    """The longest part of a record in which no input has a gap that exceeds the limit of silent interpolation; None
    without a gap, or if the record has other columns. `steps` are the times of rows without a column of times."""
    time = next((c for c in chosen if c.role == "time"), None)
    inputs = [c.column for c in chosen if c.role == "input" and c.column in table.columns]
    if steps is None and (time is None or time.column not in table.header):
        return None
    axis = steps or TimeAxis(time.column if time is not None else "")
    unit = time.unit if time is not None else axis.unit
    try:
        times = timed(table, axis).columns[axis.column]
    except (DataError, KeyError):
        return None  # `check` gives the reason
    holes: dict[tuple[float, float], None] = {}
    columns = []
    for name in inputs:
        input_times = times[np.isfinite(table.columns[name]) & np.isfinite(times)]
        for k in gaps(input_times, BRIDGED).tolist():
            holes[float(input_times[k]), float(input_times[k + 1])] = None
            columns.append(name)
    if not holes:
        return None
    finite = times[np.isfinite(times)]
    begins = [float(finite[0]), *(end for _, end in sorted(holes))]
    ends = [*(begin for begin, _ in sorted(holes)), float(finite[-1])]
    first, last = max(zip(begins, ends, strict=True), key=lambda part: part[1] - part[0])
    return Part(f"{first:.9g} {unit}", f"{last:.9g} {unit}", tuple(dict.fromkeys(columns)))


def _unrecognised(proposal: Proposal) -> list[str]:
    """A line for each unrecognised column with the unit of some outputs, with the first of these that no other column has
    and the others after it; and for columns without a unit, with some variables of the diagram."""
    used = {c.target for c in proposal.columns}
    unknown = [c for c in proposal.columns if not c.role and not c.unit_known]
    lines = [f"#   VARIABLE: {{column: {quoted(c.name)}, unit: UNIT}}" for c in unknown]
    if unknown:
        variables = [f"{name} [{text}]" for name, (text, _) in proposal.outputs.items() if name.count(".") <= 1]
        lines.append(f"#   # VARIABLE is for example {listing(variables, 8)}")
    for column in proposal.columns:
        if column.role or not column.unit_known:
            continue
        unit = read_unit(column.unit)
        able = [name for name, (text, _) in proposal.outputs.items() if name not in used and name.count(".") <= 1
                and as_meant(unit, read_unit(text)).dimension == read_unit(text).dimension]
        if able:
            name, line = _output(Chosen(column.name, "output", as_meant(unit, read_unit(proposal.outputs[able[0]][0])).text,
                                        able[0]))
            used.add(able[0])
            more = f"   # or {listing(able[1:], 4)}" if able[1:] else ""
            lines.append(f"#   {name}: {line}{more}")
    return lines


@dataclass(frozen=True)
class Chosen:
    """Role of a column of the records: `role` time, input or output, `target` the input's name or the output's formula,
    `noise` the standard deviation of its noise (`0.2 mm`), estimated from the records without it."""

    column: str
    role: str
    unit: str
    target: str = ""
    interpolation: str = "linear"
    noise: str = ""

    @property
    def entry(self) -> str:
        """The entries of the column in an experiment."""
        return ", ".join([f"column: {quoted(self.column)}", f"unit: {quoted(self.unit)}",
                          *([f"noise: {quoted(self.noise)}"] if self.noise else [])])


@dataclass(frozen=True)
class Records:
    """Content of an experiment: its diagram, files with their uses, columns and ranges of free parameters, the ranges of
    cut files, and the time between two rows of files without times (`10 ms`)."""

    model: Path
    files: Mapping[Path, str]
    columns: Sequence[Chosen]
    free: Mapping[str, str] = field(default_factory=dict)
    parts: Mapping[Path, Part] = field(default_factory=dict)
    every: str = ""


def experiment_text(name: str, path: Path, recorded: Records, unrecognised: Sequence[str] = ()) -> str:
    """The text of an experiment at `path`, with possible outputs (`unrecognised`) as comments; HeavebondError if no
    column is a time or can be an output."""
    time = next((c for c in recorded.columns if c.role == "time"), None)
    inputs = {c.target: f"{{{c.entry}, interpolation: {c.interpolation}}}" for c in recorded.columns if c.role == "input"}
    outputs = dict(_output(c) for c in recorded.columns if c.role == "output")
    if time is None and not recorded.every:
        raise HeavebondError([Problem("record-no-time", "no column is the time", None,
                                      f"A record has one column of times that increase from row to row. {FIXED_RATE}")])
    if not (outputs or unrecognised):
        raise HeavebondError([Problem("record-roles", "no column is an output", None,
                                      "An experiment needs at least one measured output.")])
    times = f"{{every: {quoted(recorded.every)}}}" if time is None else \
        f"{{column: {quoted(time.column)}, unit: {quoted(time.unit)}}}"
    folder, records = path.resolve().parent, dict[str, str]()
    for file, use in recorded.files.items():
        inside = file.resolve().relative_to(folder) if file.resolve().is_relative_to(folder) else file.resolve()
        part = recorded.parts.get(file)
        cut = f", from: {part.first}, to: {part.last}" if part is not None else ""
        records[_free_name(file.stem, records)] = f"{{file: {quoted(inside.as_posix())}, use: {use}{cut}}}"
    unsure = ["# not recognised: remove the # of measured quantities, and give their formulas", *unrecognised]
    lines = [f"experiment: {quoted(name)}", f"model: {quoted(extended_from(path, recorded.model))}",
             *block("records", records), f"time: {times}",
             *block("inputs", inputs), *(block("outputs", outputs) or ["outputs:"]),
             *(unsure if unrecognised else []),
             *block("free", {k: text if _RANGE.fullmatch(text) else quoted(text) for k, text in recorded.free.items()})]
    return "\n".join(lines) + "\n"


def _output(chosen: Chosen) -> tuple[str, str]:
    """An output by its signal; by a separate name for a formula."""
    if re.fullmatch(r"[\w.\[\]]+", chosen.target):
        return chosen.target, f"{{{chosen.entry}}}"
    return _free_name(chosen.column, {}), f"{{is: {quoted(chosen.target)}, {chosen.entry}}}"


def _free_name(text: str, used_names: Mapping[str, str]) -> str:
    """A name of letters, digits and _ that is not taken."""
    plain = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_") or "record"
    plain = plain if plain[0].isalpha() else f"r_{plain}"
    return next(name for k in range(1, 10_000) if (name := plain if k == 1 else f"{plain}_{k}") not in used_names)


def range_around(text: str, percent: float) -> str:
    """The range of a free parameter around the value in the diagram: `4 kN/m +- 20 %`. A share of a temperature in degC
    has no meaning: `22 degC +- 5 K`."""
    _, unit = parse_quantity(text)
    if unit is not None and unit.offset:
        return f"{text} +- 5 K"
    return f"{text} +- {number(percent)} %"
