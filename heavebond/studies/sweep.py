"""Sweeps from command line options, written as a study file that can be run again."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path

from heavebond.core.errors import HeavebondError, Problem, UsageError, listing, suggest
from heavebond.core.numerals import whole
from heavebond.core.progress import Progress
from heavebond.core.reporting import reporting
from heavebond.core.units import Range, UnitProblem, parse_range
from heavebond.language.model import Model, ModelOrFile, loaded
from heavebond.numerics.dae import assemble
from heavebond.studies.campaign import StudyResult, study
from heavebond.studies.sampling import BALANCED, DRAWN, KINDS, NAMED
from heavebond.studies.study import SAMPLES_OF, study_from_source
from heavebond.text.python_source import PythonCall, calling_place
from heavebond.text.yaml_source import parse

SWEEP = "sweep"  # name of the text of a sweep in messages
EXAMPLE = "Write for example --over controller.K_p='1 .. 4 1/m; 9', or a list: --over wave.T='8 s, 10 s'."


@dataclass(frozen=True)
class SweepAxis:
    """A varied parameter: a list of values, or a range with a number of steps, or a range that is sampled."""

    path: str
    values: tuple[str, ...] = ()
    range: str = ""
    wanted: Range | None = None
    number: int = 0


@dataclass(frozen=True)
class Sweep:
    """A sweep of a diagram: the axes, the sampling of ranges (`sobol:64`, `one_at_a_time`; empty: on a grid), the
    measured formulas, each with its unit or an empty text, the window (times as text), and the extreme that is sought
    instead. `name` replaces a sweep in the file."""

    model: Path
    overs: tuple[SweepAxis, ...]
    measures: tuple[tuple[str, str], ...]
    sample: str = ""
    seed: int = 1
    window: tuple[str, str] = ("", "")
    worst: str = ""
    signals: tuple[str, ...] = field(default=())
    name: str = ""


@reporting
def sweep(model: ModelOrFile, over: Mapping[str, str | Sequence[float | str]], measure: str | Sequence[str], *,
          sample: str = "", worst: str = "", seed: int = 1, begin: str = "", until: str = "", signals: Sequence[str] = (),
          parameters: Mapping[str, float | str] | None = None, folder: Path | None = None, processes: int | None = None,
          executor: Executor | None = None, fresh: bool = False, progress: Progress | None = None) -> StudyResult:
    """Run a diagram with every combination of values, or at points sampled within ranges, and measure numbers of each run.

    `model` is a diagram, or the path or bundled name of one, with `parameters` by name. `over` maps parameters to their
    values: a list (`["8 s", "10 s"]`, plain numbers in SI), a range with a number of steps (`"1 .. 4 1/m; 9"`), or a range
    that is sampled (`"20 .. 60 kN/m"`, `"42 kN/m +- 20 %"`) by `sample`: sobol:64, latin_hypercube:50, random:100,
    sobol_indices:64, one_at_a_time or local, with `seed`. `worst` ("highest" or "lowest") searches the extreme within the
    ranges by gradients instead. `measure` are formulas with their units, `"peak(WOB - 30 kN) in kN"`, evaluated from `begin`
    to `until`, the end of each run. `signals` are kept over time. `folder`, `processes`, `executor`, `fresh` and `progress`
    are as in `study`. `result.to_xarray()` is a dataset with a dimension for each parameter. Raises UsageError for malformed
    values, ModelError for unknown names or units.
    """
    call, diagram = calling_place(), loaded(model)
    values_of: Mapping[str, object] = over if isinstance(over, Mapping) else {"over": 0}
    for path, values in values_of.items():
        if not isinstance(values, Iterable):
            kind = type(values if isinstance(over, Mapping) else over).__name__
            raise UsageError([Problem("over-form", f"{path}: a {kind} does not give the values of a sweep",
                                      call.place(path, path), _for_python(Problem("over-form", "")).hint)])
    diagram = diagram.with_parameters(parameters) if parameters else diagram
    try:
        axes = tuple(_python_axis(diagram, path, values) for path, values in over.items())
        measures = (measure,) if isinstance(measure, str) else tuple(measure)
        requested = Sweep(diagram.path, axes, tuple(map(read_measure, measures)), sample, seed, (begin, until), worst,
                          tuple(signals), diagram.name)
        text = study_text(requested, diagram.path.parent)
    except UsageError as error:
        raise UsageError([_for_python(problem) for problem in error.problems]) from None
    source = parse(text, diagram.path.with_name("sweep.yaml"), SWEEP)
    try:
        return study(study_from_source(source, diagram), folder=folder, processes=processes, executor=executor, fresh=fresh,
                     progress=progress)
    except HeavebondError as error:
        raise type(error)([_in_call(problem, call) for problem in error.problems]) from None


def _python_axis(diagram: Model, path: str, values: str | Sequence[float | str]) -> SweepAxis:
    """The axis of values in Python; plain numbers are in the base unit of the parameter."""
    if isinstance(values, str):
        return read_over(f"{path}={values}")
    numbers = [value for value in values if not isinstance(value, str)]
    unit = next((q.unit.text for q in assemble(diagram).flat.parameters if q.name == path), "1") if numbers else "1"
    return SweepAxis(path, tuple(value if isinstance(value, str) else f"{float(value)!r} {unit}".removesuffix(" 1")
                                 for value in values))


def _in_call(problem: Problem, call: PythonCall) -> Problem:
    """A problem in the text of the sweep with the place in the program of the name that it mentions."""
    if problem.place is None or problem.place.file != SWEEP:
        return problem
    name = next((name for name in re.findall(r"'([^']+)'", problem.message) if any(name in line for line in call.lines)), "")
    return replace(problem, place=call.place(name, problem.place.text.strip()))


def _for_python(problem: Problem) -> Problem:
    """A problem of an option of the command line in the form of an argument."""
    message = re.sub(r"--(over|sample) ", r"\1: ", problem.message)
    hint = {"over-form": 'Write for example over={"controller.K_p": "1 .. 4 1/m; 9", "wave.T": ["8 s", "10 s"]}.',
            "sample-nothing": 'Write over={"spring.c": "20 .. 60 kN/m"} without a number of steps.',
            "worst-many": "Give one formula to `measure`."}.get(problem.code)
    return replace(problem, message=message, hint=hint or re.sub(
        r"--over (\S+)=(['\"]?)([^';]+)(; 9)?'?", r'over={"\1": "\3\4"}', problem.hint).replace("--sample ", "sample="))


def read_over(text: str) -> SweepAxis:
    """`controller.K_p=1 .. 4 1/m; 9`, `wave.T=8 s, 10 s`, `gas.c=42 kN/m +- 20 %`; UsageError for another form."""
    path, sign, values_text = (part.strip() for part in text.partition("="))
    if not sign or not path or not values_text:
        raise UsageError([Problem("over-form", f"--over {text}: this is not PATH=VALUES", None, EXAMPLE)])
    words, _, steps = (part.strip() for part in values_text.partition(";"))
    if ".." not in words and "+-" not in words:
        return SweepAxis(path, tuple(value.strip() for value in words.split(",")))
    try:
        wanted = parse_range(words)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"--over {text}: {problem.message}", None, problem.hint)]) from None
    if steps and (whole(steps) or 0) < 2:
        raise UsageError([Problem("number-wrong", f"--over {text}: '{steps}' is not how many values there are, both ends "
                                  "among them", None, "Write for example `; 9`.")])
    return SweepAxis(path, (), words, wanted, whole(steps) or 0)


def read_measure(text: str) -> tuple[str, str]:
    """`peak(WOB - 30 kN) in kN` as formula and unit; the unit may be empty."""
    formula, word, unit = text.rpartition(" in ")
    return (formula.strip(), unit.strip()) if word else (text.strip(), "")


def study_text(sweep: Sweep, folder: Path) -> str:
    """The study of a sweep, for a folder; UsageError if a range has no steps and no sampling."""
    sampled = [over for over in sweep.overs if over.range and not over.number]
    if sampled and not (sweep.sample or sweep.worst):
        first = f"{sampled[0].path}='{sampled[0].range}"
        raise UsageError([Problem("over-open", f"--over {first}': the number of values or the sampling is missing", None,
                                  f"Write --over {first}; 9' for nine of them, or add --sample sobol:64.")])
    if (sweep.sample or sweep.worst) and not sampled:
        raise UsageError([Problem("sample-nothing", "no range is given for the sample", None,
                                  "Write --over spring.c='20 .. 60 kN/m' without a number of steps.")])
    if sweep.worst and len(sweep.measures) != 1:
        raise UsageError([Problem("worst-many", "the worst is sought of one number", None, "Give --measure once.")])
    lines = [f"study: {_quoted(f'sweep of {sweep.name or sweep.model.stem}')}",
             f"model: {_quoted(os.path.relpath(sweep.model.resolve(), folder.resolve()))}"]
    axes = [f"  {_quoted(over.path)}: {_axis(over)}" for over in sweep.overs if over not in sampled]
    if sampled and not sweep.worst:
        kind, _, number = (part.strip() for part in sweep.sample.partition(":"))
        if kind in NAMED and not number:
            sample = kind
        else:
            points = whole(number)
            if kind not in DRAWN or points is None:
                suggestion_text = f"{kind}:64" if kind in DRAWN else ""
                raise UsageError([Problem("sample-unknown", f"--sample {sweep.sample}: this is not a sampling method", None,
                                          f"Write --sample {suggestion_text}." if suggestion_text
                                          else suggest(kind, KINDS)
                                          or f"Write {listing([f'{k}:64' for k in DRAWN] + list(NAMED), 9)}.")])
            if kind in BALANCED and points & (points - 1):
                raise UsageError([Problem("sample-unbalanced", f"--sample {sweep.sample}: {number} is not a power of two",
                                          None,
                                          f"Write --sample {kind}:{1 << points.bit_length() - 1} or "
                                          f"{kind}:{1 << points.bit_length()}.")])
            sample = f"{{{kind}: {number}, seed: {sweep.seed}}}"
        axes += ["  sample:", f"    sample: {sample}", "    over:", *_ranges(sampled, "      ")]
    lines += ["cases:", *axes] if axes else []
    begin, end = sweep.window
    window = ", ".join(f"{key}: {_quoted(value)}" for key, value in (("from", begin), ("to", end)) if value)
    lines += [f"evaluate: {{{window}}}"] if window else []
    lines += ["measure:", *(f"  {_quoted(text)}: {{is: {_quoted(text)}, unit: {_quoted(unit)}}}" if unit else
                            f"  {_quoted(text)}: {_quoted(text)}" for text, unit in sweep.measures)]
    if sweep.worst:
        sought = sweep.measures[0][0]
        cost = f"-({sought})" if sweep.worst == "highest" else sought
        lines += ["tune:", "  free:", *_ranges(sampled, "    "), f"  cost: {_quoted(cost)}"]
    return "\n".join([*lines, *_pictures(sweep), ""])


def _quoted(text: str) -> str:
    """A text as a YAML scalar, for any content."""
    return json.dumps(text, ensure_ascii=False)


def _axis(over: SweepAxis) -> str:
    if over.wanted is None:
        return f"[{', '.join(map(_quoted, over.values))}]"
    written = over.wanted.unit.written
    return f"{{from: {_quoted(written(over.wanted.low))}, to: {_quoted(written(over.wanted.high))}, number: {over.number}}}"


def _ranges(overs: Sequence[SweepAxis], indent: str) -> list[str]:
    return [f"{indent}{_quoted(over.path)}: {_quoted(over.range)}" for over in overs]


def _pictures(sweep: Sweep) -> list[str]:
    """The pictures that suit the axes."""
    measure_list = f"[{', '.join(_quoted(text) for text, _ in sweep.measures)}]"
    number = sum(1 for over in sweep.overs if over.number or over.values)
    kind = sweep.sample.partition(":")[0].strip()
    kinds = {**{name: kind in fitting for name, fitting in SAMPLES_OF.items()},
             "curves": number > 0 and not sweep.sample and not sweep.worst, "map": number > 1 and not sweep.sample}
    lines = [f"  {name}: {{{name}: {measure_list}}}" for name, wanted in kinds.items() if wanted]
    lines += [f"  signals: {{signals: [{', '.join(map(_quoted, sweep.signals))}]}}"] if sweep.signals else []
    return ["pictures:", *lines] if lines else []
