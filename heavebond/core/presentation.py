"""Formatting of numbers, units and tables: digits, prefixes, names of quantities, plain columns."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from heavebond.core.units import Unit, UnitProblem, dimension_text, read_unit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Base unit -> (from this size in SI on, unit to show), largest first.
READABLE: dict[str, tuple[tuple[float, str], ...]] = {
    "N": ((1e7, "MN"), (1e3, "kN"), (0.0, "N")),
    "N*m": ((1e7, "MN*m"), (1e3, "kN*m"), (0.0, "N*m")),
    "N/m": ((1e7, "MN/m"), (1e3, "kN/m"), (0.0, "N/m")),
    "N*s/m": ((1e7, "MN*s/m"), (1e3, "kN*s/m"), (0.0, "N*s/m")),
    "Pa": ((1e4, "bar"), (0.0, "Pa")),
    "m": ((0.2, "m"), (1e-4, "mm"), (0.0, "um")),
    "m/s": ((0.1, "m/s"), (0.0, "mm/s")),
    "m**3/s": ((0.0, "L/min"),),
    "m**3": ((1.0, "m**3"), (0.0, "L")),
    "W": ((1e6, "MW"), (1e3, "kW"), (0.0, "W")),
    "J": ((1e6, "MJ"), (1e3, "kJ"), (0.0, "J")),
    "kg": ((1e3, "t"), (1.0, "kg"), (0.0, "g")),
    "kg/s": ((0.1, "kg/s"), (0.0, "g/s")),
    "s": ((0.1, "s"), (1e-4, "ms"), (0.0, "us")),
    "A": ((0.1, "A"), (0.0, "mA")),
    "V": ((0.1, "V"), (0.0, "mV")),
}
QUANTITIES = {
    "m": "position", "m/s": "velocity", "m/s**2": "acceleration", "N": "force", "N*m": "torque", "Pa": "pressure",
    "m**3/s": "volume flow", "m**3": "volume", "kg": "mass", "kg/s": "mass flow", "K": "temperature", "W": "power",
    "J": "energy", "s": "time", "N/m": "stiffness", "N*s/m": "damping", "V": "voltage", "A": "current", "1/s": "rate",
}
_POWERS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def quantity(unit: str) -> str:
    """The quantity of a unit, in a word (`force`); empty if there is no common word for it."""
    try:
        read = read_unit(unit)
    except UnitProblem:
        return ""
    if read.counts == "angle":
        return "angular velocity" if read.dimension else "angle"
    # kg/s equals N*s/m by its dimension, but is written for a flow
    return QUANTITIES.get(unit) or QUANTITIES.get(dimension_text(read.dimension), "")


def readable_unit(unit: str, size: float) -> str:
    """The unit in which values of about `size` (given in `unit`) are readable; any unit except a base unit was chosen by
    somebody and stays."""
    if unit not in READABLE or not math.isfinite(size) or size == 0:
        return unit
    return next(display_unit for least, display_unit in READABLE[unit] if abs(size) >= least)


def readable_units(unit: str) -> list[tuple[float, str, float]]:
    """Display units for values in a base unit: least size for the unit, unit, and size of that unit, largest first; empty
    for a unit that stays."""
    return [(least, display_unit, read_unit(display_unit).scale) for least, display_unit in READABLE.get(unit, ())]


def converted(values: NDArray[np.float64], unit: str, target_unit: str) -> NDArray[np.float64]:
    """Convert values from one unit to another."""
    if unit == target_unit:
        return values
    source, target = read_unit(unit), read_unit(target_unit)
    return (values * source.scale + source.offset - target.offset) / target.scale


def readable(value: float, unit: str, digits: int = 5, *, beside: float | None = None) -> str:
    """A value with its unit: 17250000 Pa as `172.5 bar`; in the display unit of another value if `beside` is given."""
    display_unit = readable_unit(unit, value if beside is None else beside)
    if display_unit != unit:
        value = read_unit(display_unit).from_si(value)
    return f"{number(value, digits)} {display_unit}" if display_unit != "1" else number(value, digits)


def difference_unit(unit: str) -> tuple[float, str]:
    """The unit of differences of values in a unit, and its size in it: for temperatures, whose scales have an offset, the
    kelvin (for 1 degF 5/9 K)."""
    read = read_unit(unit) if unit else None
    return (read.scale, "K") if read is not None and read.offset else (1.0, unit)


def readable_difference(value: float, unit: str, digits: int = 5, *, beside: float | None = None) -> str:
    """A difference of values, an error or a noise, with its unit: for degC in K."""
    scale, display_unit = difference_unit(unit)
    return readable(scale * value, display_unit, digits, beside=None if beside is None else scale * beside)


def written(value: float, unit: str, digits: int) -> str:
    """A value with its unit as on paper: `0.017 m²`."""
    first, *unit_words = readable(value, unit, digits).split(" ", 1)
    return " ".join([first, *map(unit_label, unit_words)])


def readable_time(seconds: float, *further: float) -> list[str]:
    """A duration and others in the unit that suits it, to three digits: `21.3 ms`."""
    unit, scale = next(((u, k) for u, k in (("s", 1.0), ("ms", 1e-3)) if abs(seconds) >= k), ("us", 1e-6))
    return [f"{number(value / scale, 3)} {unit}" for value in (seconds, *further)]


def number(value: float, digits: int = 5) -> str:
    """A number to `digits` significant digits, without an exponent where that is short."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf" if value > 0 else "-inf"
    if value == 0:
        return "0"
    size = abs(value)
    if 1e-4 <= size < 1e6:
        decimals = max(0, digits - 1 - math.floor(math.log10(size)))
        text = f"{value:.{decimals}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.{max(0, digits - 2)}e}"


def in_unit(value: float, unit: Unit, digits: int) -> str:
    """An SI value as a number in a unit, to `digits` significant digits."""
    return number(unit.from_si(value), digits)


def path_text(path: Path) -> str:
    """A path as a user would type it: from the current folder where it lies below."""
    whole, current = path.resolve(), Path.cwd()
    return str(whole.relative_to(current) if whole.is_relative_to(current) else path)


def count(how_many: int, thing: str, plural: str = "") -> str:
    """`no loop`, `1 loop`, `3 loops`."""
    word = thing if how_many == 1 else plural or thing + "s"
    return f"{how_many or 'no'} {word}"


def brief(thing: object, name: str, *parts: str) -> str:
    """`repr` of an object with a name: a line for each of its parts, instead of all its contents."""
    return f"<{type(thing).__name__} {name!r}: " + "\n ".join(part for part in parts if part) + ">"


def unit_label(unit: str) -> str:
    """A unit as it is printed on paper: `m**3/s` as m³/s, `kN*s/m` as kN·s/m, `1` as a dash."""
    if unit == "1":
        return "–"
    text = re.sub(r"\*\*(-?[0-9]+)", lambda exponent: exponent.group(1).translate(_POWERS), unit)
    return text.replace("*", "·").replace("degC", "°C").replace("um", "µm")


def columns(rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Rows as lines of aligned columns, indented by two and separated by two; the last column takes the remaining width
    and wraps (no column is cut)."""
    if not rows:
        return []
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]) - 1)]
    begin = 2 + sum(widths) + 2 * len(widths)
    lines = []
    for row in rows:
        head = "  " + "".join(cell.ljust(w) + "  " for cell, w in zip(row, widths, strict=False))
        # a wide first column must not squeeze the last one
        narrow = width - begin < 24
        if narrow and len(row[-1]) > width - begin:
            lines.append(head.rstrip())
            head, remaining = " " * 6, 6
        else:
            remaining = begin
        wrapped = textwrap.wrap(row[-1], max(20, width - remaining), break_long_words=False, break_on_hyphens=False)
        lines += [(head + (wrapped[0] if wrapped else "")).rstrip(), *(" " * remaining + line for line in wrapped[1:])]
    return lines
