"""The output times of a run."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Place, Problem, UsageError
from heavebond.core.limits import OUTPUT_POINTS
from heavebond.core.quantities import si_value
from heavebond.core.units import read_unit
from heavebond.language.definition import Value
from heavebond.language.model import Model
from heavebond.text.expression import Number, constant

Array = NDArray[np.float64]
Time = float | str
POINTS = 1000  # output points where nothing is said


@dataclass(frozen=True)
class DensePointConstants:
    """The constants of the points between the output points, from which extremes, mean squares and the verdict are taken.

    intervals: intervals of a run, at least. Origin: 0.3 us and the states of a point each, while most runs take less than
        five steps in an interval. Doubled: faster oscillations are resolved, some ms a run.
    numbers: states at all points, at most. Origin: 32 MB. Doubled: twice the memory of large diagrams.
    first: share of the run up to which the first output interval is not divided in the integration. Origin: the first step
        depends on its length, and runs are not to depend on these points. Doubled: nothing but for coarse output.
    moved: share of its range along the run from which on a state that moves in the first interval has it integrated again,
        with points between. Origin: a smaller excursion does not affect extremes. Doubled: smaller transients are passed
        over.
    shares: the points in it, as shares. Origin: transients of any length down to rounding. Doubled: some us.
    """

    intervals: int = 8_000
    numbers: int = 4_000_000
    first: float = 0.01
    moved: float = 1e-3
    shares: Array = field(default_factory=lambda: np.union1d(np.linspace(0, 1, 65), 1.25 ** -np.arange(1.0, 80)))


DENSE_POINTS = DensePointConstants()


def begin_of(model: Model) -> float:
    """The time (s) at which the runs of a diagram begin."""
    return _from_model(model.begin) or 0.0


def largest_step_of(model: Model) -> float:
    """The longest step (s) that the diagram allows an integrator; 0 for no limit."""
    return _from_model(model.largest_step) or 0.0


def step_of(model: Model, step: Time | None) -> float:
    """The step (s) of a solver with a fixed step; UsageError if there is none."""
    length = seconds(step, "step") if step is not None else _from_model(model.step)
    if length is None or not length > 0:
        raise UsageError([Problem("step-missing" if length is None else "time-not-positive",
                                  "a solver with a fixed step needs a step above 0 s", None,
                                  "Type for example `--step '1 ms'` (in Python `step='1 ms'`, in the diagram `simulate: "
                                  "{step: 1 ms}`).")])
    return length


def with_begin(model: Model, begin: Time) -> Model:
    """The diagram with runs that begin at another time."""
    value = seconds(begin, "begin")
    place = model.begin.place if model.begin is not None else Place("begin", 1, 1, "")
    return replace(model, begin=Value(Number(value, read_unit("s"), 0), f"{value!r} s", place))


def grid(model: Model, until: Time | None, every: Time | None) -> Array:
    """Output times from the begin to the end, both included; UsageError if they make no sense."""
    begin = begin_of(model)
    end = seconds(until, "until") if until is not None else _from_model(model.until)
    if end is None:
        raise UsageError([Problem("until-missing", "the duration of the simulation is not specified", None,
                                  "Give `--until '60 s'`, or `simulate: {until: 60 s}` in the diagram.")])
    step = seconds(every, "every") if every is not None else _from_model(model.every)
    span = end - begin
    step = span / POINTS if step is None else step
    if not (np.isfinite(end) and np.isfinite(step)):
        raise UsageError([Problem("value-not-finite", f"until ({end:g} s) or every ({step:g} s) has no finite value", None,
                                  "Give a finite number.")])
    if begin and not span > 0:
        raise UsageError([Problem("time-not-positive", f"the run would end at {end:.10g} s, before it begins: from "
                                  f"{begin:.10g} s", None, "`until` is a time, not a duration: give one after `from`.")])
    if not span > 0 or not step > 0:
        raise UsageError([Problem("time-not-positive", f"until ({end:g} s) and every ({step:g} s) must be above 0")])
    if begin and step < 4 * np.spacing(max(abs(begin), abs(end))):
        raise UsageError([Problem("every-too-short", f"every ({step:g} s) is shorter than the rounding of times of "
                                  f"{end:.10g} s", None, "Shift the time axis: begin at 0 s.")])
    length = f"until ({end:g} s)" if not begin else f"the run from {begin:.10g} s until {end:.10g} s"
    if step > span * (1 + 1e-9):
        raise UsageError([Problem(
            "every-too-long", f"every ({step:g} s) is longer than {length}: there would be no output point between "
            "the start and the end", None,
            f"Make `every` shorter, or `until` longer; `every` of {span:g} s gives the two ends alone.")])
    wanted = span / step * (1 + 1e-12)
    if not wanted <= OUTPUT_POINTS:
        raise UsageError([Problem("too-many-points", f"every {step:g} s until {end:g} s makes {wanted:.3g} output points; "
                                  f"the most is {OUTPUT_POINTS}", None, f"Make `every` {span / OUTPUT_POINTS:.3g} s or "
                                  "longer, or `until` shorter.")])
    number = int(np.floor(wanted))
    times = np.arange(number + 1) * step
    times = times if span - times[-1] < 1e-9 * span else np.append(times, span)
    return np.asarray(times if not begin else np.append(begin + times[:-1], end))


def refined(stops: Array, unknowns: int, intervals: int = DENSE_POINTS.intervals) -> Array:
    """Stops (N,) with points between, for so many unknowns (see DensePointConstants), of about so many intervals."""
    span = float(stops[-1] - stops[0])
    intervals = min(intervals, DENSE_POINTS.numbers // max(unknowns, 1))
    if len(stops) < 2 or len(stops) > intervals:
        return stops
    lengths = np.diff(stops)
    parts = np.maximum(np.ceil(lengths / span * intervals * (1 - 1e-9)), 1).astype(int)
    if lengths[0] <= DENSE_POINTS.first * span:
        parts[0] = 1
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(np.repeat(stops[:-1], parts) + np.repeat(lengths / parts, parts) * number, stops[-1])


def seconds(time: Time, subject: str) -> float:
    """A time in s from a number or a text such as `2 min`; UsageError that begins with `subject` for anything else."""
    return si_value(time, "s", subject)


def _from_model(value: Value | None) -> float | None:
    return None if value is None else constant(value.expr)
