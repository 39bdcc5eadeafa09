"""Checks of an experiment for wrong units and signs, by comparing its records with the model.

The functions return remarks and change nothing: the unit stated in a file may be wrong, and so may a model by a factor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heavebond.core.presentation import number
from heavebond.core.units import Unit, as_meant, read_unit
from heavebond.records.measurements import Table

Array = NDArray[np.float64]
# Common units of measurements; units of the same dimension are compared.
USUAL = ("m", "mm", "cm", "um", "km", "Pa", "kPa", "MPa", "bar", "mbar", "psi", "N", "kN", "MN", "m/s", "mm/s", "km/h",
         "m**3/s", "L/min", "L/s", "m**3/h", "kg", "g", "t", "kg/s", "g/s", "kg/h", "s", "ms", "min", "rad", "deg", "rad/s",
         "rpm", "deg/s", "N*m", "kN*m", "W", "kW", "A", "mA", "V", "mV", "1", "%")


@dataclass(frozen=True)
class UnitCheckConstants:
    """The constants of the checks of units, signs and times of records. Origin of all: distances between common units and
    between correct and mistaken records; none depends on a machine.

    unit_ratio: least ratio of spreads that may be due to a unit. Doubled: km/h read as m/s (3.6) is no longer named.
    unit_left: largest ratio that may remain after the change of unit. Doubled: neighbouring units are confused.
    alike: least correlation with the model at which a ratio of spreads is meaningful. Doubled: no unit is ever named.
    zero: share of the maximum of a record up to which negative values are noise. Doubled: noisier magnitudes are recognised.
    negative_share: least negative excursion of a model, over its largest magnitude, for a record without one. Doubled: fewer
    magnitudes are recognised.
    magnitude_gain: least gain in correlation by the absolute value of the model. Doubled: as above.
    duration_left: relative difference of two durations that are equal in the right unit. Doubled: looser.
    time_ratio: ratio of both length and step of a record to those of a run above which the unit of time is wrong. Doubled:
    minutes for seconds are not named.
    sign_gain: gain in correlation by which the opposite sign must explain a record better. Doubled: no effect except for
    weak signals.
    opposite: correlation below which the sign is wrong; a mistuned model hardly reaches it. Doubled: no sign is ever named.
    opposite_left: ratio of the residuals with the opposite and with the own sign of the model, without their means, below
    which the sign is wrong: the model has about the right size, and an effect may be missing. Doubled: mistuned resonances
    are named.
    zero_left: relative difference between a mean residual and the distance of two zeros of a scale (an atmosphere, which the
    weather and 1000 m of height change by as much; 273.15 K). Doubled: other offsets are taken for it.
    zero_share: least share of the mean in the mean square of the residual. Doubled: no zero is ever named.
    """

    unit_ratio: float = 3.0
    unit_left: float = 1.6
    alike: float = 0.7
    zero: float = 0.05
    negative_share: float = 0.2
    magnitude_gain: float = 0.2
    duration_left: float = 0.1
    time_ratio: float = 40.0
    sign_gain: float = 0.01
    opposite: float = -0.9
    opposite_left: float = 1 / 3
    zero_left: float = 0.15
    zero_share: float = 0.9


UNIT_CHECKS = UnitCheckConstants()
ATMOSPHERE = 101325.0  # Pa, the standard atmosphere
ZERO_CELSIUS = 273.15  # K
TIMES = ("us", "ms", "s", "min", "h")


def declared_otherwise(table: Table, column: str, unit: str) -> str | None:
    """A remark if a file states another unit for a column than the `unit` of the experiment; None if they agree or the
    file states none. A suffix after an underscore counts only if it is a unit of the same dimension."""
    unit_of_file = table.unit_of(column)
    if unit_of_file is None:
        return None
    text, unit_read, sure = unit_of_file
    unit_of_experiment = read_unit(unit)
    unit_read = as_meant(unit_read, unit_of_experiment)
    same_kind = unit_read.dimension == unit_of_experiment.dimension
    if same_kind and math.isclose(unit_read.scale, unit_of_experiment.scale,
                                  rel_tol=1e-6) and unit_read.offset == unit_of_experiment.offset:
        return None
    if not same_kind and not sure:
        return None
    return f"'{table.path.name}' gives '{column}' in {text}, the experiment has `unit: {unit}`: one of them is wrong"


def time_seems_in(time: Array, until: float, every: float, unit: str) -> str:
    """The probable unit of times (n,), given in s after conversion from `unit`, of a record for a run to `until` (s) with
    output interval `every` (s); empty if `unit` is plausible. Both the length and the step of the record must differ
    by a factor above `UNIT_CHECKS.time_ratio` in the same direction, and by less than its square root in the other
    unit (ms and s differ by 1000, s and min by 60)."""
    ratios = float(np.ptp(time)) / until, float(np.median(np.diff(time))) / every
    if not (min(ratios) > UNIT_CHECKS.time_ratio or max(ratios) < 1 / UNIT_CHECKS.time_ratio):
        return ""
    near = math.sqrt(UNIT_CHECKS.time_ratio)
    for candidate in TIMES:
        factor = read_unit(candidate).scale / read_unit(unit).scale
        if all(1 / near < ratio * factor < near for ratio in ratios):
            return candidate
    return ""


def length_seems_in(length: float, whole: float, unit: str) -> str:
    """The unit in which a duration, read in `unit`, would nearly equal `whole` (both in s); empty without one."""
    for candidate in TIMES:
        factor = read_unit(candidate).scale / read_unit(unit).scale
        if candidate != unit and length > 0 and abs(length * factor / whole - 1) < UNIT_CHECKS.duration_left:
            return candidate
    return ""


def seems_in_another_unit(measured: Array, model: Array, unit: str, declared: Unit | None = None) -> str | None:
    """A remark if the record (n,) is correlated with the model (n,), both in `unit`, but the ratio of their standard
    deviations is close to the ratio of two common units; None otherwise. Offsets are ignored. If the file gives the
    unit `declared`, only a remark that agrees with it is returned."""
    factor, alike = _likeness(measured, model)
    if alike < UNIT_CHECKS.alike or max(factor, 1 / factor) < UNIT_CHECKS.unit_ratio:
        return None
    stated_unit = read_unit(unit)
    off = {text: abs(math.log(factor * candidate.scale / stated_unit.scale)) for text in USUAL if text != unit
           for candidate in [read_unit(text)]
           if stated_unit.dimension == candidate.dimension and stated_unit.offset == candidate.offset == 0}
    best = min(off, key=lambda text: off[text], default=unit)
    if best == unit or off[best] > math.log(UNIT_CHECKS.unit_left):
        return None
    if declared is not None and not math.isclose(read_unit(best).scale, declared.scale, rel_tol=1e-6):
        return None
    size = f"{number(factor, 2)} times as large" if factor > 1 else f"{number(1 / factor, 2)} times smaller"
    return f"moves as the model does, but is {size}: with `unit: {best}` in place of `unit: {unit}` they would be near"


def seems_of_another_sign(measured: Array, model: Array, formula: str) -> str | None:
    """A remark on the sign of a record. If the model is hardly ever above zero, a sensor with the opposite sign and one
    that measures magnitudes show nearly the same: both are named, unless one explains clearly more."""
    turned, unsigned = seems_turned(measured, model, formula), seems_without_sign(measured, model, formula)
    alike, sized = _likeness(measured, model)[1], _likeness(measured, np.abs(model))[1]
    if unsigned and abs(sized + alike) <= UNIT_CHECKS.sign_gain:
        return f"is never below 0 although the model is, and moves against it (correlation {number(alike, 3)}): if the " \
            f"sensor counts the other way, write `is: {_negated(formula)}`; if it measures magnitudes, `is: abs({formula})`"
    if turned and unsigned:
        return unsigned if sized > -alike else turned
    return turned or unsigned


def _negated(formula: str) -> str:
    """The negative of a formula, `-(a + b)`; that of `-a` is `a`."""
    name = formula.removeprefix("-").strip()
    return name if formula.startswith("-") and name.replace(".", "_").isidentifier() else f"-({formula})"


def seems_turned(measured: Array, model: Array, formula: str) -> str | None:
    """A remark if the record (n,) is close to the negative of the model (n,); `formula` is the output's."""
    _, alike = _likeness(measured, model)
    if alike > UNIT_CHECKS.opposite and not np.std(measured + model) < UNIT_CHECKS.opposite_left * np.std(measured - model):
        return None
    return f"moves against the model (correlation {number(alike, 3)}): if the sensor has the opposite sign, write " \
        f"`is: {_negated(formula)}`"


def seems_without_sign(measured: Array, model: Array, formula: str) -> str | None:
    """A remark if the record (n,) is never negative, the model (n,) is, and the absolute value of the model is better
    correlated with the record."""
    top = float(np.max(measured))
    if top <= 0 or float(np.min(measured)) < -UNIT_CHECKS.zero * top or \
            np.min(model) > -UNIT_CHECKS.negative_share * float(np.max(np.abs(model))):
        return None
    alike, sized = _likeness(measured, model)[1], _likeness(measured, np.abs(model))[1]
    if sized < UNIT_CHECKS.alike or sized < alike + UNIT_CHECKS.magnitude_gain:
        return None
    return f"is never below 0 although the model is, and follows its magnitude (correlation {number(sized, 3)}, with the " \
        f"sign {number(alike, 3)}): if the sensor measures magnitudes, write `is: abs({formula})`"


def seems_from_another_zero(measured: Array, model: Array, unit: str, formula: str) -> str | None:
    """A remark if record (n,) and model (n,), both in `unit`, differ by the distance of the two usual zeros of a pressure
    (vacuum and atmosphere) or a temperature (0 K and 0 degC), and by little else."""
    declared = read_unit(unit)
    residual = declared.scale * (measured - model)
    mean = float(np.mean(residual))
    between = {read_unit("Pa").dimension: ATMOSPHERE, read_unit("K").dimension: ZERO_CELSIUS}.get(declared.dimension)
    if between is None or abs(abs(mean) / between - 1) > UNIT_CHECKS.zero_left or \
            mean**2 < UNIT_CHECKS.zero_share * float(np.mean(residual**2)):
        return None
    side = "below" if mean < 0 else "above"
    if between == ZERO_CELSIUS:
        probable_unit = "K" if mean > 0 else "degC"
        return f"lies {number(abs(mean), 3)} K {side} the model: write `unit: {probable_unit}` in place of `unit: {unit}`"
    sensor, wanted = ("above the atmosphere (gauge)", "absolute") if mean < 0 else ("absolute", "above the atmosphere")
    return f"lies {number(abs(mean) / declared.scale, 3)} {unit} {side} the model throughout, about the pressure of the " \
        f"atmosphere: if the sensor shows pressure {sensor} and the model's is {wanted}, write " \
        f"`is: {formula} {'-' if mean < 0 else '+'} {number(ATMOSPHERE / declared.scale, 6)} {unit}`"


def _likeness(measured: Array, model: Array) -> tuple[float, float]:
    """Ratio of the standard deviations of record and model, and their correlation; (1, 0) if one of them is constant."""
    y, m = measured - np.mean(measured), model - np.mean(model)
    size, model_size = float(np.sqrt(y @ y)), float(np.sqrt(m @ m))
    if min(size, model_size) <= 1e-12 * max(size, model_size, float(np.abs(model).max()) * math.sqrt(len(model))):
        return 1.0, 0.0
    return size / model_size, float(y @ m) / (size * model_size)
