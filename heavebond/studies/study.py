"""A study as a file: a diagram, its cases, the tuning of each, the measured quantities, and published numbers for them."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Mapping as Dictionary
from collections.abc import Sequence as Many
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import prod
from pathlib import Path

import numpy as np

from heavebond.core.errors import ModelError, Place, Problem, Problems, UsageError, listing, suggest
from heavebond.core.numerals import whole
from heavebond.core.packed import packed, unpacked
from heavebond.core.presentation import brief, count
from heavebond.core.units import Range, UnitProblem, parse_quantity
from heavebond.language import reading
from heavebond.language.definition import FileInput
from heavebond.language.model import Model, find, load_beside
from heavebond.language.sections import read_settings
from heavebond.linear.rest_stability import STABLE
from heavebond.numerics.output_times import begin_of
from heavebond.optimise.objective import Case, TuningProblem
from heavebond.optimise.optimal import INTERPOLATIONS, STARTS, OptimalProblem
from heavebond.optimise.search import METHODS
from heavebond.studies.axes import Axis, StudyCase, case_at, indices, read_axes, read_numbers
from heavebond.studies.occurrence import Occurrence, read_occurrence
from heavebond.studies.published import ReferenceValues, read_beside
from heavebond.studies.sampling import read_ranges
from heavebond.text.expression import constant
from heavebond.text.yaml_source import Mapping, Node, Scalar, Source, read

STUDY_KEYS = ("study", "summary", "model", "cases", "evaluate", "reference", "modes", "tune", "optimal", "measure",
              "compare_with", "occurrence", "calibrate", "pictures", "notes")
TUNE_KEYS = ("free", "cost", "limits", "stable", "over", "uncertain", "by")
OPTIMAL_KEYS = ("free", "cost", "limits", "start", "at_end", "duration", "intervals", "interpolation")
ASKED = {"on": True, "off": False}
GRADIENT_KEYS = ("explore", "starts", "method")
PICTURES = ("signals", "curves", "map", "histogram", "tornado", "indices")
# the kinds of samples that have pictures
SAMPLES_OF = {"histogram": ("sobol", "latin_hypercube", "random", "sobol_indices", "seeds"),
              "tornado": ("one_at_a_time", "local"),
              "indices": ("sobol_indices", "local")}
COST = "cost"
SIMULATIONS = "simulations"


@dataclass(frozen=True)
class Measure:
    """A number of each case: a formula in the syntax of costs, and its display unit (empty: the base unit)."""

    name: str
    text: str
    unit: str
    place: Place


@dataclass(frozen=True)
class Procedure:
    """A method of tuning: a sweep of one parameter after the other (values in SI, from `begin` on), or without these a
    search by gradients."""

    name: str
    begin: Dictionary[str, float | str] = field(default_factory=dict)
    sweeps: tuple[tuple[str, tuple[float, ...]], ...] = ()
    explore: int = 5
    starts: int = 1
    method: str = "trust"


@dataclass(frozen=True)
class Picture:
    """A picture of `names`. `signals`: over time, a line per case; measured numbers as `curves` over the first numeric
    axis, a line per other level, as `map` over the first two, as `histogram` of a sample, as `tornado` of the
    influences, or their sensitivity `indices`."""

    name: str
    title: str
    kind: str
    names: tuple[str, ...]
    begin: float | None
    end: float | None
    place: Place


@dataclass(frozen=True)
class Calibration:
    """Calibration of measured or tuned quantities to the numbers of a source (its index under `compare_with:`):
    parameters and ranges, and the permitted deviation of each quantity, relative to the given number."""

    free: Dictionary[str, Range]
    targets: Dictionary[str, float]
    source: int


@dataclass(frozen=True)
class Study:
    """Content of a study file. `task` is the tuning of each case, by each of the procedures, `optimal` the optimal input
    that is sought in each case; None without them.
    `calibrated` are parameters that are set in addition (SI: before, after), in the cases in which they have the value
    before. `first` is the number of its first case, if others were removed (`PackedCase`), of `in_all` cases."""

    name: str
    summary: str
    path: Path
    model: Model
    axes: tuple[Axis, ...] = ()
    begin: float = 0.0
    end: float | None = None
    reference: Dictionary[str, float | str] = field(default_factory=dict)
    modes: Dictionary[str, float | str] | None = None
    task: TuningProblem | None = None
    procedures: tuple[Procedure, ...] = ()
    measures: Dictionary[str, Measure] = field(default_factory=dict)
    beside: tuple[ReferenceValues, ...] = ()
    pictures: tuple[Picture, ...] = ()
    calibration: Calibration | None = None
    occurrence: Occurrence | None = None
    calibrated: Dictionary[str, tuple[float, float]] = field(default_factory=dict)
    places: Dictionary[str, Place] = field(default_factory=dict)
    optimal: OptimalProblem | None = None
    first: int = 0
    in_all: int = 0

    def __repr__(self) -> str:
        return brief(self, self.name, f"model {self.model.name}, {count(len(self.axes), 'axis', 'axes')}", self.summary)

    @property
    def total(self) -> int:
        """The number of cases, including removed ones."""
        return self.in_all or prod(len(axis.levels) for axis in self.axes)

    @property
    def cases(self) -> tuple[StudyCase, ...]:
        """All cases in order; the last axis varies fastest."""
        return tuple(case_at(self.axes, self.model, index) for index in indices(self.axes))

    @property
    def jobs(self) -> list[tuple[int, Procedure | None]]:
        """The number of each case and the procedure of each run; combinations that never occur are left out."""
        numbers = (k for k, index in enumerate(indices(self.axes))
                   if self.occurrence is None or self.occurrence.share(index) > 0)
        return [(k, procedure) for k in numbers for procedure in self.procedures or (None,)]

    def case(self, number: int) -> StudyCase:
        """The case of that number in `cases`."""
        return case_at(self.axes, self.model, self._index(number))

    def packed(self) -> Callable[[int], PackedCase]:
        """Case `number` in the form that is sent to a worker; common data are serialised once."""
        shared = packed(replace(self, axes=(), in_all=self.total))

        def one(number: int) -> PackedCase:
            levels = zip(self.axes, self._index(number), strict=True)
            return PackedCase(shared, tuple(replace(axis, levels=(axis.levels[k],)) for axis, k in levels), number)

        return one

    def _index(self, number: int) -> tuple[int, ...]:
        """The number of the level on each axis."""
        index = np.unravel_index(number - self.first, tuple(len(axis.levels) for axis in self.axes)) if self.axes else ()
        return tuple(map(int, index))

    @property
    def tuning(self) -> TuningProblem:
        """The tuning problem of the study; UsageError if it has none."""
        if self.task is None:
            raise UsageError([Problem("study-untuned", f"the study '{self.name}' tunes nothing", None,
                                      "`heavebond study` works it out; add `tune:` for this.")])
        return self.task

    @property
    def signals(self) -> tuple[str, ...]:
        """Signals that the pictures of the study show."""
        return tuple(dict.fromkeys(name for picture in self.pictures if picture.kind == "signals" for name in picture.names))

    @property
    def sample(self) -> Axis | None:
        """The axis whose levels are points of a sample."""
        return next((axis for axis in self.axes if axis.sampling is not None), None)


@dataclass(frozen=True)
class PackedCase:
    """One case of a study for a worker; its size is independent of the number of cases."""

    shared: bytes
    axes: tuple[Axis, ...]
    number: int

    @property
    def study(self) -> Study:
        """The study reduced to that case, which keeps its number."""
        return replace(_unpacked(self.shared), axes=self.axes, first=self.number)


@lru_cache(maxsize=4)
def _unpacked(shared: bytes) -> Study:
    study = unpacked(shared)
    assert isinstance(study, Study)
    return study


def load_study(name: str | Path) -> Study:
    """Load a study: the path of a file, or the `name` of a bundled one (`cmc_ahc/quality_index`).

    Raises UsageError if the file does not exist, ModelError with the lines that are wrong.
    """
    return study_from_source(read(find(name, "study")))


def study_from_source(source: Source, model: Model | None = None) -> Study:
    """A study from its source, of a diagram in memory if `model` is given; ModelError with the lines that are wrong."""
    problems = Problems()
    root = source.root
    if "study" not in root.items:
        hint = suggest("study", root.items) or "A study begins with `study: name`."
        if "model" in root.items and "experiment" not in root.items:
            hint = f"This file describes a diagram. {hint} Without a study, `heavebond tune {source.name} --free PARAMETER" \
                " --cost FORMULA` tunes it, and `heavebond sweep` varies its parameters."
        raise ModelError([Problem("not-a-study", f"{source.name} is not a study: it has no `study:`", root.place, hint)])
    # report keys outside `tune:` that belong there
    strayed = [key for key in TUNE_KEYS if key in root.items]
    for key in strayed:
        problems.add("key-strayed", f"'{key}' belongs under `tune:`", root.keys[key].place,
                     hint=f"Write `tune:` on a separate line, and `{key}:` below it, indented.")
    if not strayed:
        reading.known_keys(root, STUDY_KEYS, "a study", problems, required=("model",))
        if not {"tune", "optimal", "measure", "pictures", "modes"} & set(root.items):
            problems.add("study-empty", "this study asks for nothing", root.place,
                         hint="Add `measure:`, `tune:`, `optimal:`, `pictures:` or `modes:`.")
    problems.raise_as(ModelError)
    model = model or load_beside(source, root.items["model"], problems)
    study = _study(source, model, problems)
    problems.raise_as(ModelError)
    return study


def _study(source: Source, model: Model, problems: Problems) -> Study:
    root, items = source.root, source.root.items
    axes = read_axes(items.get("cases"), source, problems)
    begin, end = _window(items.get("evaluate"), "evaluate", problems)
    begin = begin_of(model) if begin is None else begin
    reference = _values(items.get("reference"), source, problems)
    modes = _values(items["modes"], source, problems) if "modes" in items else None
    entries = reading.mapping(items.get("measure"), "measure", problems,
                              "Write one quantity a line: `WOB: {is: largest(bit.F - 30 kN), unit: kN}`.")
    measures = {}
    for name, item in (entries.items if entries else {}).items():
        unit, formula = "", item
        if isinstance(item, Mapping):
            reading.known_keys(item, ("is", "unit"), f"'{name}'", problems, required=("is",))
            unit = reading.text(item.items.get("unit"), "unit", problems)
            formula = item.items.get("is", item)
            if isinstance(unit_node := item.items.get("unit"), Scalar):
                reading.unit_text(unit_node, problems)
        if isinstance(formula, Scalar):
            place = formula.place.moved(1 if formula.quoted else 0, len(formula.text))
            measures[name] = Measure(name, formula.text, unit, place)
        elif not isinstance(formula, Mapping):
            problems.add("not-text", f"'{name}' is {formula.kind}; a formula is expected", formula.place)
    entry = reading.mapping(items.get("tune"), "tune", problems)
    task: TuningProblem | None = None
    procedures: tuple[Procedure, ...] = ()
    if entry is not None:
        reading.known_keys(entry, TUNE_KEYS, "tune", problems, required=("free", "cost"))
        tuning = entry.items
        words = reading.words(tuning.get("limits"), "limits", problems)
        limits = tuple(s.text for s in words if s.text != STABLE)
        stable = _stable(tuning.get("stable"), problems)
        if stable is None and any(word.text == STABLE for word in words):
            stable = True
        for word in words if stable is False else ():
            if word.text == STABLE:
                problems.add("stable-twice", "`stable` is under `limits:` and is off", word.place,
                             hint="Remove one of them.")
        task = TuningProblem(read_ranges(tuning.get("free"), "free", problems),
                             reading.text(tuning.get("cost"), "cost", problems), limits, *(begin, end), reference,
                             _over(tuning.get("over"), source, problems) or (Case("diagram", {}),), modes or {},
                             _widths(tuning.get("uncertain"), problems), stable)
        procedures = _procedures(entry.items.get("by"), source, task, problems)
    tuned = (*task.free, COST, SIMULATIONS) if task is not None else ()
    for name in set(measures) & set(tuned):
        problems.add("name-twice", f"'{name}' is a result of the tuning already", measures[name].place,
                     hint="Take another name.")
    places = {key: item.place for key, item in (entry.items if entry else {}).items()}
    beside = read_beside(items.get("compare_with"), axes, [*measures, *tuned], problems)
    return Study(reading.text(items["study"], "study", problems), reading.text(items.get("summary"), "summary", problems),
                 source.path, model, axes, begin, end, reference, modes, task, procedures, measures,
                 beside, _pictures(items.get("pictures"), axes, [*measures, *tuned], problems),
                 _calibration(items.get("calibrate"), beside, problems),
                 read_occurrence(items.get("occurrence"), axes, [*measures, *tuned], problems),
                 optimal=_optimal(items.get("optimal"), (begin, end), reference, problems),
                 places={**places, "study": root.place, "calibrate": items.get("calibrate", root).place})


def _optimal(node: Node | None, horizon: tuple[float, float | None], reference: Dictionary[str, float | str],
             problems: Problems) -> OptimalProblem | None:
    """The problem under `optimal:`; its horizon is the time under `evaluate:`."""
    entry = reading.mapping(node, "optimal", problems)
    if entry is None:
        return None
    reading.known_keys(entry, OPTIMAL_KEYS, "optimal", problems, required=("free", "cost"))
    items, default = entry.items, OptimalProblem({}, "")
    at_end = reading.mapping(items.get("at_end"), "at_end", problems)
    duration = read_ranges(Mapping({"duration": items["duration"]}, {"duration": entry.keys["duration"]}, entry.place),
                           "optimal", problems).get("duration") if "duration" in items else None
    return OptimalProblem(
        read_ranges(items.get("free"), "free", problems), reading.text(items.get("cost"), "cost", problems),
        tuple(s.text for s in reading.words(items.get("limits"), "limits", problems)), *horizon, duration,
        reading.choice(items.get("start"), "start", STARTS, problems) or default.start,
        {name: reading.text(item, name, problems) for name, item in (at_end.items if at_end else {}).items()},
        _count(items.get("intervals"), "intervals", 2, problems) or default.intervals,
        reading.choice(items.get("interpolation"), "interpolation", INTERPOLATIONS, problems) or default.interpolation,
        reference)


def _stable(node: Node | None, problems: Problems) -> bool | None:
    """True if the tuned machine must be stable at rest, False for `stable: off`; None without the key."""
    if node is None:
        return None
    word = reading.text(node, "stable", problems, "on")
    if word not in ASKED:
        problems.add("stable-unknown", f"`stable: {word}` has no meaning", node.place,
                     hint="Write `stable: off` where the tuned machine need not be stable at rest; without it, it must.")
    return ASKED.get(word, True)


def _window(node: Node | None, subject: str, problems: Problems) -> tuple[float | None, float | None]:
    entries = reading.mapping(node, subject, problems)
    if entries is None:
        return None, None
    reading.known_keys(entries, ("from", "to"), subject, problems)
    times = {name: reading.seconds(item, name, problems) for name, item in entries.items.items()}
    return times.get("from"), times.get("to")


def _widths(node: Node | None, problems: Problems) -> dict[str, str]:
    """Uncertainties as written; they are compared with the parameters later."""
    entries = reading.mapping(node, "uncertain", problems)
    widths: dict[str, str] = {}
    for name, item in (entries.items if entries else {}).items():
        text = reading.text(item, name, problems)
        try:
            width, _ = parse_quantity(text)
        except UnitProblem as problem:
            problems.add(problem.code, f"{name}: {problem.message}", item.place, hint="Write `20 %` or `3 kN`.")
            continue
        if width <= 0:
            problems.add("uncertainty-not-positive", f"{name}: an uncertainty is above 0", item.place,
                         hint="Write `20 %` or `3 kN`.")
        widths[name] = text
    return widths


def _values(node: Node | None, source: Source, problems: Problems) -> dict[str, float | str]:
    """Quantities as written; their units are checked when they are set."""
    values: dict[str, float | str] = {}
    for path, setting in read_settings(node, source, problems).items():
        if isinstance(setting.value, FileInput) or setting.value.formula:
            problems.add("not-a-quantity", f"{path} must be a plain quantity here", setting.place)
        else:
            values[path] = setting.value.text
    return values


def _over(node: Node | None, source: Source, problems: Problems) -> tuple[Case, ...]:
    """The conditions over which the cost is averaged."""
    entries = reading.mapping(node, "over", problems)
    cases = []
    for name, item in (entries.items if entries else {}).items():
        weight = 1.0
        if isinstance(item, Mapping) and "weight" in item.items:
            weight_node = item.items["weight"]
            value = reading.value(weight_node, "weight", problems)
            number = constant(value.expr) if value is not None else None
            weight = number if number is not None and number > 0 else 1.0
            settings = {k: v for k, v in item.items.items() if k != "weight"}
            item = Mapping(settings, {k: item.keys[k] for k in settings}, item.place)
        cases.append(Case(name, _values(item, source, problems), weight))
    return tuple(cases)


# -- procedures --------------------------------------------------------------------------------------------------------
def _procedures(node: Node | None, source: Source, task: TuningProblem, problems: Problems) -> tuple[Procedure, ...]:
    entries = reading.mapping(node, "by", problems, "Write one procedure a line: `gradients: {}`.")
    if entries is None:
        return (Procedure("gradients"),)
    procedures = []
    for name, item in entries.items.items():
        entry = reading.mapping(item, f"'{name}'", problems)
        if entry is not None and reading.identifier(entries.keys[name], "a procedure", problems):
            procedures.append(_procedure(name, entry, source, task, problems))
    return tuple(procedures)


def _procedure(name: str, entry: Mapping, source: Source, task: TuningProblem, problems: Problems) -> Procedure:
    if "sweep" not in entry.items:
        reading.known_keys(entry, ("sweep", "begin", *GRADIENT_KEYS), f"'{name}'", problems)
        counts = {key: _count(entry.items.get(key), key, least, problems) for key, least in (("explore", 0), ("starts", 1))}
        default = Procedure(name)
        method = reading.choice(entry.items.get("method"), "method", METHODS, problems)
        return Procedure(name, explore=default.explore if counts["explore"] is None else counts["explore"],
                         starts=counts["starts"] or default.starts, method=method or default.method)
    reading.known_keys(entry, ("sweep", "begin"), f"'{name}'", problems)
    entries = reading.mapping(entry.items["sweep"], "sweep", problems)
    sweeps = []
    for parameter, item in (entries.items if entries else {}).items():
        place = entries.keys[parameter].place if entries else item.place
        numbers = read_numbers(item, parameter, problems)
        if parameter not in task.free:
            problems.add("sweep-unknown", f"'{parameter}' is not free", place, hint=suggest(parameter, task.free) or
                         f"Free: {listing(task.free)}.")
        elif numbers is not None:
            if numbers[1].dimension != task.free[parameter].unit.dimension:
                problems.add("unit-wrong", f"{parameter} is swept in {numbers[1].text}; {task.free[parameter].unit.text} "
                             "is needed", item.place)
            sweeps.append((parameter, tuple(number for _, _, number in numbers[0])))
    return Procedure(name, _values(entry.items.get("begin"), source, problems), tuple(sweeps))


def _count(node: Node | None, subject: str, least: int, problems: Problems) -> int | None:
    if node is None:
        return None
    text = reading.text(node, subject, problems)
    number = whole(text)
    if number is None or number < least:
        problems.add("count-wrong", f"{subject}: '{text}' is not a whole number from {least} on", node.place,
                     hint=f"Write for example `{subject}: {max(least, 20)}`.")
        return None
    return number


# -- calibration -------------------------------------------------------------------------------------------------------
def _calibration(node: Node | None, beside: Many[ReferenceValues], problems: Problems) -> Calibration | None:
    entry = reading.mapping(node, "calibrate", problems)
    if entry is None:
        return None
    reading.known_keys(entry, ("free", "targets", "to"), "calibrate", problems, required=("free", "targets"))
    sources = [b.source for b in beside]
    wanted = reading.text(entry.items.get("to"), "to", problems, sources[0] if len(sources) == 1 else "")
    if wanted not in sources:
        problems.add("source-unknown", f"'{wanted}' gives no numbers under `compare_with:`" if wanted else
                     "`to:` does not name the source under `compare_with:` with the targets", entry.place,
                     hint=suggest(wanted, sources) or (f"Write `to: {sources[0]}`." if sources else "Add `compare_with:`."))
        return None
    source = sources.index(wanted)
    targets = _widths(entry.items.get("targets"), problems)
    target_widths = {}
    for name, text in targets.items():
        width, unit = parse_quantity(text)
        place = entry.items["targets"].place
        if name not in beside[source].numbers:
            problems.add("target-unknown", f"{wanted} gives no '{name}'", place,
                         hint=suggest(name, beside[source].numbers) or f"It gives {listing(beside[source].numbers)}.")
        elif name in (COST, SIMULATIONS) or (unit is not None and unit.dimension):
            problems.add("target-wrong", f"'{name}: {text}' is not a target: a measured quantity or a gain, and how near it "
                         "should come", place, hint="Write for example `WOB variation: 25 %`.")
        target_widths[name] = width
    return Calibration(read_ranges(entry.items.get("free"), "free", problems), target_widths, source)


# -- measured quantities and pictures ----------------------------------------------------------------------------------
def _pictures(node: Node | None, axes: Many[Axis], quantities: Many[str], problems: Problems) -> tuple[Picture, ...]:
    entries = reading.mapping(node, "pictures", problems, "Write one picture a line: `wob: {signals: [WOB]}`.")
    pictures = []
    for name, item in (entries.items if entries else {}).items():
        key = entries.keys[name] if entries else Scalar(name, item.place)
        entry = reading.mapping(item, f"'{name}'", problems)
        if entry is None or not reading.identifier(key, "a picture", problems):
            continue
        reading.known_keys(entry, ("title", *PICTURES, "from", "to"), f"'{name}'", problems)
        names_by_kind = {kind: tuple(w.text for w in reading.words(entry.items[kind], kind, problems)) for kind in PICTURES
                         if kind in entry.items}
        if len(names_by_kind) != 1:
            problems.add("picture-kind", f"picture '{name}' shows one of {', '.join(PICTURES)}", key.place,
                         hint="Write `signals: [WOB]` or `curves: [WOB variation]`.")
            continue
        (kind, names), = names_by_kind.items()
        _check_picture(name, kind, names, axes, quantities, key.place, problems)
        ends = {k: v for k, v in entry.items.items() if k in ("from", "to")}
        window = Mapping(ends, {k: entry.keys[k] for k in ends}, entry.place)
        pictures.append(Picture(name, reading.text(entry.items.get("title"), "title", problems), kind, names,
                                *_window(window, name, problems), key.place))
    return tuple(pictures)


def _check_picture(name: str, kind: str, names: Many[str], axes: Many[Axis], quantities: Many[str], place: Place,
                   problems: Problems) -> None:
    if kind == "signals":
        return
    needed = {"curves": 1, "map": 2}.get(kind, 0)
    if sum(axis.unit is not None for axis in axes) < needed:
        few = "no axis for its curves: no axis of `cases:` has numbers" if needed == 1 else \
            "no two axes for its map: fewer than two axes of `cases:` have numbers"
        problems.add("picture-axis", f"picture '{name}' has {few}", place,
                     hint="Add a parameter with a list of values to `cases:`.")
    fitting = SAMPLES_OF.get(kind, ())
    if fitting and not any(axis.sampling is not None and axis.sampling.kind in fitting for axis in axes):
        problems.add("picture-sample", f"picture '{name}' has no sample for its {kind}", place,
                     hint=f"Add `uncertain: {{sample: ..., over: {{...}}}}` to `cases:`, sampled by {listing(fitting)}.")
    for quantity in names:
        if quantity not in quantities:
            problems.add("quantity-unknown", f"'{quantity}' is neither measured nor tuned in this study", place,
                         hint=suggest(quantity, quantities) or f"Known: {listing(quantities)}.")
