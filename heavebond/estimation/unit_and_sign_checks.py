"""Checks of an experiment for wrong units and signs, by comparing its records with the model.

The functions return remarks and change nothing: the unit stated in a file may be wrong, and so may a model by a factor.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heavebond.core.presentation import number
from heavebond.core.units import Unit, read_unit
from heavebond.records.measurements import Table

Array = NDArray[np.float64]
# Common units of measurements; those of the same dimension are compared.
USUAL = ("m", "mm", "cm", "um", "km", "Pa", "kPa", "MPa", "bar", "mbar", "psi", "N", "kN", "MN", "m/s", "mm/s", "km/h",
         "m**3/s", "L/min", "L/s", "m**3/h", "kg", "g", "t", "kg/s", "g/s", "kg/h", "s", "ms", "min", "rad", "deg", "rad/s",
         "rpm", "deg/s", "N*m", "kN*m", "W", "kW", "A", "mA", "V", "mV", "1", "%")
FAR = 3.0  # smallest ratio of spreads that may be due to a unit
NEAR = 1.6  # largest ratio that may remain after the change of unit
ALIKE = 0.7  # smallest correlation with the model at which a ratio of spreads is meaningful
ZERO = 0.05  # negative values up to this share of a record's maximum count as noise
BELOW = 0.2  # smallest negative excursion of a model, as a share of its largest magnitude
CLEARLY = 0.2  # smallest gain in correlation by taking the absolute value of the model
TIMES = ("us", "ms", "s", "min", "h")
ALIKE_LONG = 0.1  # relative difference of two durations that counts as equal in the right unit
SCARCE = 40.0  # ratio of both length and step of a record to those of a run above which the unit of time is wrong
BETTER = 0.01  # gain in correlation by which the opposite sign must explain the record better
OPPOSITE = -0.9  # correlation below which the sign is wrong; a mistuned model hardly gets so low


def declared_otherwise(table: Table, column: str, unit: str) -> str | None:
    """A remark where a file states another unit for a column than the `unit` of the experiment; None where they agree or
    the file states none. A suffix after an underscore counts only where it is a unit of the same dimension."""
    found = table.unit_of(column)
    if found is None:
        return None
    text, said, sure = found
    given = read_unit(unit)
    same_kind = said.dimension == given.dimension
    if same_kind and math.isclose(said.scale, given.scale, rel_tol=1e-6) and said.offset == given.offset:
        return None
    if not same_kind and not sure:
        return None
    return f"'{table.path.name}' gives '{column}' in {text}, the experiment says `unit: {unit}`: one of them is wrong"


def time_seems_in(time: Array, until: float, every: float, unit: str) -> str:
    """The probable unit of times (n,), given in s after conversion from `unit`, of a record for a run to `until` (s) with
    output interval `every` (s); empty where `unit` is plausible. Both the length and the step of the record must differ by
    a factor above SCARCE in the same direction, and by less than its square root in the other unit (ms and s differ by
    1000, s and min by 60)."""
    ratios = float(np.ptp(time)) / until, float(np.median(np.diff(time))) / every
    if not (min(ratios) > SCARCE or max(ratios) < 1 / SCARCE):
        return ""
    near = math.sqrt(SCARCE)
    for other in TIMES:
        factor = read_unit(other).scale / read_unit(unit).scale
        if all(1 / near < ratio * factor < near for ratio in ratios):
            return other
    return ""


def length_seems_in(length: float, whole: float, unit: str) -> str:
    """The unit in which a length of time, read in `unit`, would be nearly the `whole` (both in s); empty where in none."""
    for other in TIMES:
        factor = read_unit(other).scale / read_unit(unit).scale
        if other != unit and length > 0 and abs(length * factor / whole - 1) < ALIKE_LONG:
            return other
    return ""


def seems_in_another_unit(measured: Array, model: Array, unit: str, declared: Unit | None = None) -> str | None:
    """A remark where the record (n,) is correlated with the model (n,), both in `unit`, but the ratio of their standard
    deviations is close to that of two common units; None otherwise. Offsets are ignored. If the file gives the unit
    `declared`, only a remark that agrees with it is returned."""
    factor, alike = _likeness(measured, model)
    if alike < ALIKE or max(factor, 1 / factor) < FAR:
        return None
    given = read_unit(unit)
    off = {text: abs(math.log(factor * other.scale / given.scale)) for text in USUAL if text != unit
           for other in [read_unit(text)] if _same_kind(given, other)}
    best = min(off, key=lambda text: off[text], default=unit)
    if best == unit or off[best] > math.log(NEAR):
        return None
    if declared is not None and not math.isclose(read_unit(best).scale, declared.scale, rel_tol=1e-6):
        return None
    size = f"{number(factor, 2)} times as large" if factor > 1 else f"{number(1 / factor, 2)} times smaller"
    return f"moves as the model does, but is {size}: with `unit: {best}` in place of `unit: {unit}` they would be near"


def seems_of_another_sign(measured: Array, model: Array, formula: str) -> str | None:
    """The likelier of both remarks below: of a model that is hardly ever above zero, a sensor that counts the other way and
    one that cannot tell the direction show nearly the same."""
    turned, unsigned = seems_turned(measured, model, formula), seems_without_sign(measured, model, formula)
    if turned and unsigned:
        return unsigned if _likeness(measured, np.abs(model))[1] > -_likeness(measured, model)[1] + BETTER else turned
    return turned or unsigned


def seems_turned(measured: Array, model: Array, formula: str) -> str | None:
    """A remark where the record (n,) is close to the negative of the model (n,); `formula` is that of the output."""
    _, alike = _likeness(measured, model)
    if alike > OPPOSITE:
        return None
    return f"moves against the model (correlation {number(alike, 3)}): if the sensor counts the other way, write " \
        f"`is: -({formula})`"


def seems_without_sign(measured: Array, model: Array, formula: str) -> str | None:
    """A remark where the record (n,) is never negative, the model (n,) is, and the absolute value of the model is better
    correlated with the record."""
    top = float(np.max(measured))
    if top <= 0 or float(np.min(measured)) < -ZERO * top or np.min(model) > -BELOW * float(np.max(np.abs(model))):
        return None
    alike, sized = _likeness(measured, model)[1], _likeness(measured, np.abs(model))[1]
    if sized < ALIKE or sized < alike + CLEARLY:
        return None
    return f"is never below 0 where the model is, and moves as its size does (correlation {number(sized, 3)}, with the " \
        f"sign {number(alike, 3)}): if the sensor cannot tell the direction, write `is: abs({formula})`"


def _same_kind(one: Unit, other: Unit) -> bool:
    return one.dimension == other.dimension and one.offset == other.offset == 0


def _likeness(measured: Array, model: Array) -> tuple[float, float]:
    """Ratio of the standard deviations of record and model, and their correlation; (1, 0) where one of them is constant."""
    y, m = measured - np.mean(measured), model - np.mean(model)
    size, other = float(np.sqrt(y @ y)), float(np.sqrt(m @ m))
    if min(size, other) <= 1e-12 * max(size, other, float(np.abs(model).max()) * math.sqrt(len(model))):
        return 1.0, 0.0
    return size / other, float(y @ m) / (size * other)
