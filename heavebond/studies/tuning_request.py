"""Tuning of a study, or of a diagram with free parameters and a cost, from command line options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from heavebond.core.errors import ModelError, Problem, UsageError
from heavebond.core.quantities import ranges
from heavebond.core.units import Range, UnitProblem, parse_range, unit
from heavebond.language.model import Model, load
from heavebond.linear.rest_stability import STABLE
from heavebond.numerics.dae import Assembly
from heavebond.optimise.objective import TuningProblem
from heavebond.studies.study import load_study

TIMES = 3  # upper limit of a free parameter without a range, as a multiple of its value


@dataclass(frozen=True)
class TuningRequest:
    """The tuning task, its diagram, and its name."""

    name: str
    model: Model
    task: TuningProblem


def tuning_request(name: str, cost: str | None, limits: Sequence[str], evaluate: str | None,
                   reference: Mapping[str, str]) -> TuningRequest:
    """The task of the study `name`, with options in place of its entries; for a diagram the options only."""
    try:
        study = load_study(name)
        model, task, name = study.model, study.tuning, study.name
    except ModelError as error:
        if cost is None or error.problems[0].code != "not-a-study":
            raise
        model = load(name)
        task, name = TuningProblem({}, cost), model.name
    task = replace(task, cost=cost or task.cost, limits=(*task.limits, *(text for text in limits if text != STABLE)),
                   stable=True if STABLE in limits else task.stable)
    if reference:
        task = replace(task, reference=dict(reference))
    if evaluate is not None:
        begin, end = horizon(evaluate)
        task = replace(task, begin=begin, end=end)
    return TuningRequest(name, model, task)


def horizon(text: str) -> tuple[float, float]:
    """The times in s of `72 .. 96 s`, the value of --evaluate."""
    try:
        time_range = parse_range(text)
        if time_range.unit.dimension != unit("s").dimension:
            raise UnitProblem("unit-wrong", f"'{text}' is not a time", "Write for example --evaluate '72 .. 96 s'.")
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"--evaluate: {problem.message}", None, problem.hint)]) from None
    return time_range.low, time_range.high


def with_free(assembly: Assembly, task: TuningProblem, texts: Sequence[str]) -> TuningProblem:
    """The task with further free parameters, `NAME` or `NAME=RANGE`; one without a range may vary from 0 to three times
    its value."""
    free_ranges: dict[str, Range] = {}
    units = {q.name: q.unit for q in assembly.flat.parameters}
    for part in (part.strip() for text in texts for part in text.split(",") if part.strip()):
        name, sign, text = (piece.strip() for piece in part.partition("="))
        if sign:
            free_ranges |= ranges({name: text}, {n: u.text for n, u in units.items()})
            continue
        assembly.parameter_indices([name])  # UsageError for a name that cannot be set
        value = assembly.parameter_values[name]
        if not value:
            raise UsageError([Problem("range-missing", f"{name} is 0, so it has no default range", None,
                                      f"Write for example --free {name}='0 .. 10 {units[name].text}'.")])
        free_ranges[name] = Range(min(0.0, TIMES * value), max(0.0, TIMES * value), units[name])
    return replace(task, free={**task.free, **free_ranges}) if free_ranges else task
