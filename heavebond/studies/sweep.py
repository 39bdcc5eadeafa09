"""Sweeps from command line options, written as a study file that can be run again."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.numerals import whole
from heavebond.core.units import Range, UnitProblem, parse_range
from heavebond.studies.sampling import BALANCED, DRAWN, KINDS, NAMED
from heavebond.studies.study import SAMPLES_OF

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
             f"model: {_quoted(_model(sweep.model, folder))}"]
    axes = [f"  {_quoted(over.path)}: {_axis(over)}" for over in sweep.overs if over not in sampled]
    if sampled and not sweep.worst:
        axes += ["  sample:", f"    sample: {_sample(sweep)}", "    over:", *_ranges(sampled, "      ")]
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


def _model(model: Path, folder: Path) -> str:
    return os.path.relpath(model.resolve(), folder.resolve())


def _axis(over: SweepAxis) -> str:
    if over.wanted is None:
        return f"[{', '.join(map(_quoted, over.values))}]"
    written = over.wanted.unit.written
    return f"{{from: {_quoted(written(over.wanted.low))}, to: {_quoted(written(over.wanted.high))}, number: {over.number}}}"


def _ranges(overs: Sequence[SweepAxis], indent: str) -> list[str]:
    return [f"{indent}{_quoted(over.path)}: {_quoted(over.range)}" for over in overs]


def _sample(sweep: Sweep) -> str:
    kind, _, number = (part.strip() for part in sweep.sample.partition(":"))
    if kind in NAMED and not number:
        return kind
    points = whole(number)
    if kind not in DRAWN or points is None:
        suggestion_text = f"{kind}:64" if kind in DRAWN else ""
        raise UsageError([Problem("sample-unknown", f"--sample {sweep.sample}: this is not a sampling method", None,
                                  f"Write --sample {suggestion_text}." if suggestion_text else suggest(kind, KINDS) or
                                  f"Write {listing([f'{k}:64' for k in DRAWN] + list(NAMED), 9)}.")])
    if kind in BALANCED and points & (points - 1):
        raise UsageError([Problem("sample-unbalanced", f"--sample {sweep.sample}: {number} is not a power of two", None,
                                  f"Write --sample {kind}:{1 << points.bit_length() - 1} or "
                                  f"{kind}:{1 << points.bit_length()}.")])
    return f"{{{kind}: {number}, seed: {sweep.seed}}}"


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
