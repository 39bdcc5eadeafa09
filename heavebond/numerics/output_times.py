"""The output times of a run."""

from __future__ import annotations

import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.core.limits import OUTPUT_POINTS
from heavebond.core.quantities import si_value
from heavebond.language.definition import Value
from heavebond.language.model import Model
from heavebond.numerics.dae import Array
from heavebond.text.expression import constant

Time = float | str
POINTS = 1000  # output points where nothing is said


def grid(model: Model, until: Time | None, every: Time | None) -> Array:
    """Output times from 0 to the end, the end included; UsageError where they make no sense."""
    end = seconds(until, "until") if until is not None else _from_model(model.until)
    if end is None:
        raise UsageError([Problem("until-missing", "it is not said how long to simulate", None,
                                  "Give `--until '60 s'`, or `simulate: {until: 60 s}` in the diagram.")])
    step = seconds(every, "every") if every is not None else _from_model(model.every)
    step = end / POINTS if step is None else step
    if not end > 0 or not step > 0:
        raise UsageError([Problem("time-not-positive", f"until ({end:g} s) and every ({step:g} s) must be above 0")])
    if step > end * (1 + 1e-9):
        raise UsageError([Problem(
            "every-too-long", f"every ({step:g} s) is longer than until ({end:g} s): there would be no output point between "
            "the start and the end", None,
            f"Make `every` shorter, or `until` longer; `every` of {end:g} s gives the two ends alone.")])
    wanted = end / step * (1 + 1e-12)
    if not wanted <= OUTPUT_POINTS:
        raise UsageError([Problem("too-many-points", f"every {step:g} s until {end:g} s makes {wanted:.3g} output points; "
                                  f"the most is {OUTPUT_POINTS}", None, f"Make `every` {end / OUTPUT_POINTS:.3g} s or "
                                  "longer, or `until` shorter.")])
    number = int(np.floor(wanted))
    times = np.arange(number + 1) * step
    return np.asarray(times if end - times[-1] < 1e-9 * end else np.append(times, end))


def seconds(given: Time, what: str) -> float:
    """A time in s from a number or a text such as `2 min`; UsageError that begins with `what` for anything else."""
    return si_value(given, "s", what)


def _from_model(value: Value | None) -> float | None:
    return None if value is None else constant(value.expr)
