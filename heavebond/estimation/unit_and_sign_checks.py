"""Slips of an experiment that show in its records: a unit or a sign taken for another one.

They are told and not mended: a file may be wrong about itself, and a model may be wrong by a factor.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from heavebond.core.presentation import number
from heavebond.core.units import Unit, read_unit
from heavebond.records.measurements import Table

Array = NDArray[np.float64]
# Units in which machines are measured, by kind; one of a kind is easily taken for another.
USUAL = ("m", "mm", "cm", "um", "km", "Pa", "kPa", "MPa", "bar", "mbar", "psi", "N", "kN", "MN", "m/s", "mm/s", "km/h",
         "m**3/s", "L/min", "L/s", "m**3/h", "kg", "g", "t", "kg/s", "g/s", "kg/h", "s", "ms", "min", "rad", "deg", "rad/s",
         "rpm", "deg/s", "N*m", "kN*m", "W", "kW", "A", "mA", "V", "mV", "1", "%")
FAR = 3.0  # times, from where on a factor may be that of a unit
NEAR = 1.6  # times, up to which a unit explains a factor
ALIKE = 0.7  # correlation with the model, from where on a factor means anything
ZERO = 0.05  # share of a record's largest value that noise may take it below zero
BELOW = 0.2  # share of its size to which a model goes below zero, from where on it clearly does
CLEARLY = 0.2  # by how much the size alone must correlate better
TIMES = ("us", "ms", "s", "min", "h")
ALIKE_LONG = 0.1  # share by which two lengths of time may differ that are the same in the right unit
SCARCE = 40.0  # times, by which both the length and the step of a record differ from a run's where the unit of time is wrong
BETTER = 0.01  # by how much where the opposite sign explains the record too
OPPOSITE = -0.9  # below it the sign does; a model out of tune is hardly so much against the record


def declared_otherwise(table: Table, column: str, unit: str) -> str | None:
    """What the file says of the unit of a column where that is not the `unit` of the experiment; None where they agree, or
    where the file says nothing. A word behind an underscore counts only where it is a unit of the same kind."""
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
    """The unit in which times (n,) in s, read in `unit`, would be those of a run to `until` s with a point `every` so often;
    empty where they may well be right. ms and s are 1000 apart, s and min 60: both the length and the step of the record
    must be off by more than SCARCE one way, and within the square root of that in the other unit."""
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
    """A remark where the record (n,) moves as the model (n,) does, both read in `unit`, but is larger or smaller by what one
    usual unit is to another. The spreads about the means are compared: an offset is another matter. Where the file itself
    gives a unit, `declared`, only a remark that agrees with it."""
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
    """A remark where the record (n,) is nearly the model (n,) with its sign changed; `formula` is what is compared."""
    _, alike = _likeness(measured, model)
    if alike > OPPOSITE:
        return None
    return f"moves against the model (correlation {number(alike, 3)}): if the sensor counts the other way, write " \
        f"`is: -({formula})`"


def seems_without_sign(measured: Array, model: Array, formula: str) -> str | None:
    """A remark where the record (n,) never goes below zero, the model (n,) does, and its size is much nearer to the record
    than itself."""
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
    """How much more the record moves than the model, and their correlation; (1, 0) where one of them does not move."""
    y, m = measured - np.mean(measured), model - np.mean(model)
    size, other = float(np.sqrt(y @ y)), float(np.sqrt(m @ m))
    if min(size, other) <= 1e-12 * max(size, other, float(np.abs(model).max()) * math.sqrt(len(model))):
        return 1.0, 0.0
    return size / other, float(y @ m) / (size * other)
