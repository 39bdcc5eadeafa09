"""Signals as arrays with a unit and, over the times of a run, with their time axis.

A `Signal` is an array of numbers in one unit. Sums, differences and comparisons convert other signals and texts (`"30 kN"`)
to this unit, and refuse another dimension. Products, quotients and powers of signals are in SI. A plain number is in SI: it
can be added to a signal in SI, and a product of a signal with it is a plain array in SI, because the number may be a
parameter with a unit of its own. A signal in another unit refuses plain numbers.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from heavebond.core import facade
from heavebond.core.errors import Problem, UsageError
from heavebond.core.presentation import converted, count, number, unit_label
from heavebond.core.quantities import si_value
from heavebond.core.units import (
    ONE,
    Dimension,
    Unit,
    UnitProblem,
    check_unit,
    dimension_text,
    parse_quantity,
    pint_quantity,
    read_unit,
    times,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
SUMS = {np.add, np.subtract, np.maximum, np.minimum, np.fmax, np.fmin, np.hypot, np.fmod, np.remainder}
COMPARISONS = {np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal}
SAME = {np.negative, np.positive, np.absolute, np.fabs, np.conjugate}
COUNTS = {np.isfinite, np.isnan, np.isinf, np.sign, np.signbit}
class Signal(NDArrayOperatorsMixin):
    """A signal of a run: values in `unit`, its `name`, and its `time` (N,) in s (None without an axis of time).

    `signal.to("kN")` converts, `signal.magnitude` is a plain array, which is also what NumPy's functions, pandas, xarray and
    matplotlib read. A single value of a signal in SI is a plain number.
    """

    def __init__(self, values: Any, unit: str = "1", name: str = "", time: Array | None = None) -> None:
        """An array in a unit; UsageError for a unit that is not known."""
        _read(unit, name)
        self.magnitude: Array = np.asarray(values, dtype=float)
        self.unit, self.name = unit, name
        self.time = time if time is not None and np.shape(time) == self.magnitude.shape else None

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        values = self.magnitude if dtype is None else self.magnitude.astype(dtype)
        return values.copy() if copy and dtype is None else values

    def __getattr__(self, name: str) -> Any:
        """Attributes and methods of the plain array (shape, reshape, tolist, ...). matplotlib asks for some before it looks
        for the converter of units, which is registered then, as matplotlib may be imported after the signal was made."""
        if name.startswith("__") or name == "magnitude":
            raise AttributeError(name)
        if "matplotlib.units" in sys.modules:
            _register_units()
        return getattr(self.magnitude, name)

    def __len__(self) -> int:
        return len(self.magnitude)

    def __iter__(self) -> Iterator[Any]:
        return (self._like(value) for value in self.magnitude)

    def __setitem__(self, key: Any, value: Any) -> None:
        """Set values; a signal, a text or a quantity is converted, a plain number is in SI as in a sum."""
        self.magnitude[key] = self._same(value)

    def __float__(self) -> float:
        return float(self.magnitude)

    def __int__(self) -> int:
        return int(self.magnitude)

    def __round__(self, digits: int | None = None) -> Any:
        return self._like(np.round(self.magnitude, digits or 0))

    def __bool__(self) -> bool:
        return bool(self.magnitude)

    # -- values --------------------------------------------------------------------------------------------------------
    def to(self, unit: str) -> Signal:
        """The signal in another unit; UsageError for a unit of another dimension, or that is not known."""
        target, current = _read(unit, self.name), _read(self.unit, self.name)
        try:
            check_unit(target, current, 0.0, unit)
        except UnitProblem as problem:
            raise UsageError([Problem(problem.code, f"{self._words} cannot be converted to {unit}", None,
                                      problem.hint)]) from None
        return Signal(converted(self.magnitude, self.unit, unit), unit, self.name, self.time)

    @property
    def si(self) -> Signal:
        """The signal in SI."""
        return self if self._in_si else Signal(_read(self.unit).to_si(self.magnitude), dimension_text(self._dimension),
                                               self.name, self.time)

    def between(self, begin: float | str, end: float | str) -> Signal:
        """The part from one time to another, both included, `signal.between("72 s", "80 s")`; UsageError if no value lies
        there, or for a signal without an axis of time."""
        time = self._axis()
        inside = (time >= si_value(begin, "s", "begin")) & (time <= si_value(end, "s", "end"))
        if not inside.any():
            raise UsageError([Problem("window-empty", f"{self._words} has no value between {begin} and {end}", None,
                                      f"Its time runs from {number(float(time[0]))} to {number(float(time[-1]))} s.")])
        part: Signal = self[inside]
        return part

    def at(self, time: float | str) -> Any:
        """The value at a time, interpolated linearly; UsageError for a time outside of the run."""
        axis, at = self._axis(), si_value(time, "s", "time")
        if not axis[0] <= at <= axis[-1]:
            raise UsageError([Problem("window-empty", f"{self._words} has no value at {time}", None,
                                      f"Its time runs from {number(float(axis[0]))} to {number(float(axis[-1]))} s.")])
        return self._like(np.interp(at, axis, self.magnitude))

    def _axis(self) -> Array:
        if self.time is None or not len(self.time):
            raise UsageError([Problem("time-missing", f"{self._words} has no axis of time", None,
                                      "Take it from the signal of a run, before a function such as np.sort.")])
        return self.time

    def __getitem__(self, key: Any) -> Any:
        part = self.magnitude[key]
        time = self.time[key] if self.time is not None and np.ndim(part) == 1 else None
        return self._like(part, time)

    def _like(self, values: Any, time: Array | None = None) -> Any:
        """Values in the unit of this signal; a single one in SI is a plain number."""
        if np.ndim(values) == 0 and self._in_si:
            return values
        return Signal(values, self.unit, self.name, time)

    def _reduced(self, function: str, arguments: Any, more: Any, differences: bool = False) -> Any:
        signal = self.si if differences and self._offset else self
        return signal._like(getattr(signal.magnitude, function)(*arguments, **more))

    def mean(self, *arguments: Any, **more: Any) -> Any:
        """The mean over the values, in the unit."""
        return self._reduced("mean", arguments, more)

    def max(self, *arguments: Any, **more: Any) -> Any:
        """The largest value, in the unit."""
        return self._reduced("max", arguments, more)

    def min(self, *arguments: Any, **more: Any) -> Any:
        """The smallest value, in the unit."""
        return self._reduced("min", arguments, more)

    def std(self, *arguments: Any, **more: Any) -> Any:
        """The standard deviation, in the unit; of temperatures in K."""
        return self._reduced("std", arguments, more, True)

    def sum(self, *arguments: Any, **more: Any) -> Any:
        """The sum of the values, in the unit; of temperatures in K."""
        return self._reduced("sum", arguments, more, True)

    def round(self, *arguments: Any, **more: Any) -> Any:
        """The values rounded to decimals, in the unit."""
        return self._reduced("round", arguments, more)

    def copy(self) -> Signal:
        """A copy with values of its own."""
        return Signal(self.magnitude.copy(), self.unit, self.name, self.time)

    def rms(self) -> Any:
        """The root of the mean of the squares, in the unit; UsageError for a temperature in degC or degF."""
        if self._offset:
            raise self._ambiguous("`rms`")
        return self._like(np.sqrt(np.mean(self.magnitude**2)))

    # -- arithmetic ----------------------------------------------------------------------------------------------------
    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **more: Any) -> Any:
        values, unit = self._operands(ufunc, method, inputs)
        if out is not None:
            more["out"] = tuple(o.magnitude if isinstance(o, Signal) else o for o in out)
        result = getattr(ufunc, method)(*values, **more)
        if unit is None or result is NotImplemented:
            return result
        first = next(one for one in inputs if isinstance(one, Signal))
        axis = next((one.time for one in inputs if isinstance(one, Signal) and one.time is not None
                     and np.shape(result) == np.shape(one.time)), None)
        plain_sum = ufunc in SUMS | SAME and unit == first.unit and sum(isinstance(one, Signal) for one in inputs) == 1
        if np.ndim(result) == 0 and _read(unit).scale == 1 and not _read(unit).offset:
            return result
        return Signal(result, unit, first.name if plain_sum else "", axis)

    def _operands(self, ufunc: np.ufunc, method: str, inputs: tuple[Any, ...]) -> tuple[list[Any], str | None]:
        """The operands as plain arrays, and the unit of the result; None for a result without one."""
        first = next(one for one in inputs if isinstance(one, Signal))
        if ufunc in COUNTS:
            return [_plain(one) for one in inputs], None
        if ufunc in SAME or (ufunc in SUMS and method in ("reduce", "accumulate") and not first._offset):
            return [_plain(one) for one in inputs], first.unit
        if (ufunc in SUMS or ufunc in COMPARISONS) and method == "__call__":
            common = first.si if first._offset and ufunc in (np.add, np.subtract) else first
            return [common._same(one) for one in inputs], None if ufunc in COMPARISONS else common.unit
        if method == "__call__" and (dimension := _dimension_of(ufunc, inputs)) is not None:
            whole = all(exponent.denominator == 1 for _, exponent in dimension)  # a unit has no roots of base units
            return [_in_si(one) for one in inputs], dimension_text(dimension) if whole else None
        return [one._numbers(ufunc.__name__) if isinstance(one, Signal) else _in_si(one) for one in inputs], None

    def _same(self, operand: Any) -> Any:
        """An operand of a sum or a comparison in the unit of this signal."""
        if isinstance(operand, str):
            try:
                value, unit = parse_quantity(operand)
                check_unit(unit, _read(self.unit), value, operand)
            except UnitProblem as problem:
                raise UsageError([Problem(problem.code, f"{self._words}: {problem.message}", None, problem.hint)]) from None
            return _read(self.unit).from_si(value)
        if _is_pint(operand):
            operand = _of_pint(operand)
        if isinstance(operand, Signal):
            if operand._dimension != self._dimension:
                raise UsageError([Problem("unit-wrong", f"{self._words} and {operand._words} have different dimensions",
                                          None,
                                          "Signals of one dimension can be added and compared.")])
            return converted(operand.magnitude, operand.unit, self.unit)
        if self._in_si or not np.any(operand):
            return operand
        raise self._ambiguous("a plain number")

    def _numbers(self, subject: str) -> Array:
        """The values for an operation that knows no units: in SI, or of a signal without dimension."""
        if self._in_si:
            return self.magnitude
        if self._dimension == ONE:
            return self.si.magnitude
        raise self._ambiguous(f"`{subject}`")

    def _ambiguous(self, subject: str) -> UsageError:
        base, name = dimension_text(self._dimension), self.name or "signal"
        value = f'"30 {self.unit}"'
        return UsageError([Problem("signal-unit", f"{self._words} and {subject}: it is not clear whether numbers in "
                                   f"{self.unit} or in {base} are meant", None,
                                   f'Write r.si["{name}"] for numbers in {base}, r.display["{name}"] for numbers in '
                                   f"{self.unit}, or a number with its unit, {value}.")])

    # -- presentation --------------------------------------------------------------------------------------------------
    @property
    def _dimension(self) -> Dimension:
        return _read(self.unit).dimension

    @property
    def _in_si(self) -> bool:
        read = _read(self.unit)
        return read.scale == 1.0 and not read.offset

    @property
    def _offset(self) -> bool:
        return bool(_read(self.unit).offset)

    @property
    def _words(self) -> str:
        return f"'{self.name}' in {self.unit}" if self.name else f"a signal in {self.unit}"

    def __repr__(self) -> str:
        name = f" '{self.name}'" if self.name else ""
        if self.ndim == 0:
            return f"<Signal{name}: {self}>"
        finite = self.magnitude[np.isfinite(self.magnitude)]
        span = f", {number(float(finite.min()))} to {number(float(finite.max()))}" if finite.size else ""
        times = f" from {number(float(self.time[0]))} to {number(float(self.time[-1]))} s" \
            if self.time is not None and len(self.time) else ""
        return f"<Signal{name} in {self.unit}: {count(self.size, 'value')}{times}{span}>"

    def __str__(self) -> str:
        return f"{self.magnitude}" if self.unit == "1" else f"{self.magnitude} {self.unit}"

    def __format__(self, spec: str) -> str:
        return format(self.magnitude.item() if self.ndim == 0 else self.magnitude, spec) if spec else str(self)

    def plot(self) -> Figure:
        """A matplotlib figure of the signal over time, with its unit; UsageError without an axis of time."""
        figure: Figure = facade.call("Signal.plot", self, self._axis())
        return figure

    def to_series(self) -> pd.Series[float]:
        """A pandas Series with time as index, named `name [unit]`; UsageError without an axis of time."""
        import pandas as pd

        series = pd.Series(self.magnitude, pd.Index(self._axis(), name="time [s]"), name=f"{self.name} [{self.unit}]")
        series.attrs["units"] = self.unit
        return series

    def to_xarray(self) -> xr.DataArray:
        """An xarray DataArray over `time` with `attrs["units"]`; UsageError without an axis of time, or if xarray is
        missing."""
        axis = {"time": ("time", self._axis(), {"units": "s"})}
        array: xr.DataArray = xarray_module().DataArray(self.magnitude, axis, ("time",), self.name or None,
                                                        {"units": self.unit})
        return array

    def to_pint(self) -> Any:
        """A quantity of pint, in its application registry."""
        return pint_quantity(self.magnitude, self.unit)


def _read(unit: str, name: str = "") -> Unit:
    try:
        return read_unit(unit)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"{name or 'a signal'}: {problem.message}", None, problem.hint)]) from None


def _plain(value: Any) -> Any:
    return value.magnitude if isinstance(value, Signal) else value


def _in_si(value: Any) -> Any:
    """An operand as plain numbers in SI; a text is a quantity."""
    if isinstance(value, str):
        return parse_quantity(value)[0]
    return value.si.magnitude if isinstance(value, Signal) else _of_pint(value).si.magnitude if _is_pint(value) else value


def _is_pint(value: Any) -> bool:
    return hasattr(value, "magnitude") and hasattr(value, "to_base_units")


def _of_pint(value: Any) -> Signal:
    return Signal(value.magnitude, f"{value.units:~C}" or "1")


def _dimension_of(ufunc: np.ufunc, inputs: tuple[Any, ...]) -> Dimension | None:
    """The dimension of a product, a quotient, a power or a root of signals and quantities; None for other functions, and if
    an operand is a plain number, whose dimension is not known."""
    if ufunc is np.power and np.ndim(inputs[1]) == 0 and isinstance(inputs[0], Signal) and not isinstance(inputs[1], Signal):
        return times(ONE, inputs[0]._dimension, Fraction(float(inputs[1])).limit_denominator(1000))
    if ufunc in (np.square, np.sqrt, np.cbrt, np.reciprocal):
        powers = {np.square: Fraction(2), np.sqrt: Fraction(1, 2), np.cbrt: Fraction(1, 3), np.reciprocal: Fraction(-1)}
        return times(ONE, inputs[0]._dimension, powers[ufunc])
    if ufunc not in (np.multiply, np.divide):
        return None
    dimensions = [parse_quantity(one)[1] if isinstance(one, str) else _read(one.unit) if isinstance(one, Signal) else
                  _read(_of_pint(one).unit) if _is_pint(one) else None for one in inputs]
    first, second = dimensions
    if first is None or second is None:
        return None
    return times(first.dimension, second.dimension, 1 if ufunc is np.multiply else -1)


def xarray_module() -> Any:
    """The module xarray; UsageError if it is not installed."""
    try:
        import xarray as xr
    except ImportError:
        raise UsageError([Problem("xarray-missing", "a dataset needs xarray, which is not installed", None,
                                  "pip install 'heavebond[xarray]'")]) from None
    return xr


@lru_cache(maxsize=1)
def _register_units() -> None:
    """Let matplotlib write the unit of a signal at its axis, and convert other signals on the same axis to this unit."""
    from matplotlib import units

    class SignalUnits(units.ConversionInterface):
        """Units of axes."""

        @staticmethod
        def default_units(x: Any, axis: Any) -> str | None:
            """The unit of the first signal is that of the axis. Plain numbers, which include those of a signal in SI, are
            drawn as they are: a signal in SI on an axis in another unit is an error."""
            if not isinstance(x, Signal):
                return None
            if axis.units is not None and x._in_si and x.unit != axis.units:
                raise UsageError([Problem("axis-unit", f"{x._words} is drawn on an axis in {axis.units}", None,
                                          f'Write r["{x.name or "signal"}"].to("{axis.units}").')])
            return x.unit

        @staticmethod
        def convert(value: Any, unit: Any, axis: Any) -> Any:
            return (value.to(unit) if unit else value).magnitude if isinstance(value, Signal) else value

        @staticmethod
        def axisinfo(unit: Any, axis: Any) -> Any:
            return units.AxisInfo(  # type: ignore[no-untyped-call]
                label=f"[{unit_label(unit)}]" if unit else None)

    units.registry[Signal] = SignalUnits()
