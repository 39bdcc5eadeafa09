"""Quantities as `NUMBER SPACE UNIT`, ranges and tolerances; dimensions as exponents (the only importer of pint).

Inside heavebond every number is in SI base units. A dimension is a sorted tuple of (base unit, exponent) pairs without
zeros; beside m, kg, s, A, K, mol, cd a base may be a unit still to be solved, such as `$U`. An angle in radians is
dimensionless, as in the SI, but `Hz` and `rad/s` are told apart where a value is read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pint import UnitRegistry

Dimension = tuple[tuple[str, Fraction], ...]
PINT_BASE = {"[length]": "m", "[mass]": "kg", "[time]": "s", "[current]": "A", "[temperature]": "K",
             "[substance]": "mol", "[luminosity]": "cd"}
ONE: Dimension = ()

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
UNIT = r"(?:1/)?[A-Za-zµΩ°%][\w°%µΩ]*(?:(?:\*\*-?\d+|\^-?\d+)|[*/·](?=[A-Za-zµΩ°])[\w°%µΩ]+)*(?:/\([A-Za-z][\w*]*\))?|1"
_QUANTITY = re.compile(rf"\s*({NUMBER})(?:\s+({UNIT}))?\s*$")
_RANGE = re.compile(rf"\s*({NUMBER})(?:\s+({UNIT}))?\s*\.\.\s*({NUMBER})(?:\s+({UNIT}))?\s*$")
_BAND = re.compile(rf"\s*({NUMBER})(?:\s+({UNIT}))?\s*\+-\s*({NUMBER})(?:\s+({UNIT}))?\s*$")
_DECIMAL_COMMA = re.compile(r"\d,\d")


SPELLINGS = {"Nm": "N*m", "Ns": "N*s", "kNs": "kN*s", "kNm": "kN*m", "Nms": "N*m*s", "lpm": "L/min", "sec": "s",
             "m3": "m**3", "m2": "m**2", "s2": "s**2", "mm2": "mm**2", "cm2": "cm**2", "Bar": "bar", "BAR": "bar"}
_MISSPELT = re.compile(rf"(?<![\w*])(?:{'|'.join(SPELLINGS)})(?![A-Za-z0-9])")


class UnitProblem(ValueError):
    """A quantity that cannot be read; `code` is the stable code, `hint` says what to type."""

    def __init__(self, code: str, message: str, hint: str = ""):
        super().__init__(message)
        self.code, self.message, self.hint = code, message, hint


@dataclass(frozen=True)
class Unit:
    """A unit: value_SI = value * scale + offset, its dimension, and what it counts (`angle`, `cycles` or nothing)."""

    text: str
    scale: float
    offset: float
    dimension: Dimension
    counts: str = ""

    def to_si(self, value: float) -> float:
        """SI value of `value` given in this unit."""
        return value * self.scale + self.offset

    def from_si(self, value: float) -> float:
        """Value in this unit of an SI value (also element by element for arrays)."""
        return (value - self.offset) / self.scale


DIMENSIONLESS = Unit("1", 1.0, 0.0, ONE)


def dimension_of(exponents: Mapping[str, Fraction]) -> Dimension:
    """The dimension with these exponents."""
    return tuple(sorted((base, Fraction(power)) for base, power in exponents.items() if power))


def times(a: Dimension, b: Dimension, power: Fraction | int = 1) -> Dimension:
    """The dimension of a * b**power."""
    exponents = dict(a)
    for base, exponent in b:
        exponents[base] = exponents.get(base, Fraction(0)) + exponent * power
    return dimension_of(exponents)


@dataclass(frozen=True)
class Range:
    """`low .. high` in SI; `nominal` is the value of `v +- tolerance`, else None."""

    low: float
    high: float
    unit: Unit
    nominal: float | None = None


@lru_cache(maxsize=1)
def _registry() -> UnitRegistry:
    import pint

    registry: UnitRegistry = pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
    registry.define("percent = 0.01 = %")
    return registry


@lru_cache(maxsize=4096)
def unit(text: str) -> Unit:
    """Read a unit such as `kN/m`, `L/min`, `m**3/s`, `%`, `1`; raises UnitProblem where it is unknown."""
    text = text.strip()
    if text in ("1", ""):
        return DIMENSIONLESS
    if "^" in text:
        raise UnitProblem("unit-power", f"the power is written `**`: {text.replace('^', '**')}")
    if not re.fullmatch(UNIT, text):
        raise UnitProblem("unit-unknown", f"'{text}' is not a unit", "A unit has no spaces: kN*s/m, m**3/s, 1/s.")
    if _MISSPELT.search(text):  # the units library reads `Nm` as something else
        raise UnitProblem("unit-unknown", f"'{text}' is not a known unit", _unit_hint(text))
    import pint

    registry = _registry()
    try:
        parsed = registry.parse_units(text.replace("°C", "degC").replace("·", "*"))
        zero = registry.Quantity(0.0, parsed).to_base_units()
        one = registry.Quantity(1.0, parsed).to_base_units()
    except (pint.errors.PintError, AttributeError, ValueError, TypeError, KeyError) as error:
        raise UnitProblem("unit-unknown", f"'{text}' is not a known unit", _unit_hint(text)) from error
    powers = dict(one.dimensionality)
    extra = [name for name in powers if name not in PINT_BASE]
    if extra:
        raise UnitProblem("unit-unknown", f"'{text}' measures {', '.join(extra)}, which no machine here has")
    dimension = dimension_of({PINT_BASE[name]: Fraction(power).limit_denominator(1000)
                              for name, power in powers.items()})
    offset = float(zero.magnitude)
    # to_base_units gives kilogram-metre-second numbers, which are the SI's own
    return Unit(text, float(one.magnitude) - offset, offset, dimension, _counts(str(parsed)))


def _counts(parsed: str) -> str:
    names = set(re.findall(r"[a-z_]+", parsed))
    if names & {"hertz", "kilohertz", "megahertz", "millihertz"}:
        return "cycles"
    if names & {"radian", "degree", "revolution", "revolutions_per_minute", "turn", "milliradian"}:
        return "angle"
    return ""


def _unit_hint(text: str) -> str:
    if _MISSPELT.search(text):
        return f"Did you mean '{_MISSPELT.sub(lambda found: SPELLINGS[found.group()], text)}'?"
    return "Units are written as N, kN/m, kN*s/m, bar, L/min, m**3/s, mm/s, Hz, rad/s, degC, %, 1."


def dimension_text(dimension: Dimension) -> str:
    """A dimension in the units an engineer would write, e.g. `N/m`, else in base units."""
    for name in ("1", "m", "m/s", "m/s**2", "kg", "s", "N", "N/m", "N*s/m", "N*m", "Pa", "Pa/s", "m**2", "m**3",
                 "m**3/s", "m**3/(s*Pa)", "W", "J", "kg/s", "kg/m**3", "K", "1/s", "A", "V", "1/m", "s/m"):
        if _common(name) == dimension:
            return name
    over = [_power(b, e) for b, e in dimension if e > 0]
    under = [_power(b, -e) for b, e in dimension if e < 0]
    text = "*".join(over) or "1"
    if not under:
        return text
    return f"{text}/{under[0]}" if len(under) == 1 else f"{text}/({'*'.join(under)})"


@lru_cache(maxsize=64)
def _common(name: str) -> Dimension:
    return declared_unit(name).dimension


def _power(base: str, exponent: Fraction) -> str:
    return base if exponent == 1 else f"{base}**{exponent}"


@lru_cache(maxsize=4096)
def declared_unit(text: str) -> Unit:
    """Read the unit of a declaration, where brackets are allowed (`m**3/(s*Pa)`) and the scale must be 1."""
    flat = _without_brackets(text.strip())
    read = unit(flat)
    if abs(read.scale - 1.0) > 1e-12 or read.offset:
        raise UnitProblem("unit-not-base", f"a declaration uses base units, '{text}' is not one",
                          f"Write `unit: {dimension_text(read.dimension)}`; values may be given in {text}.")
    return Unit(text, read.scale, read.offset, read.dimension, read.counts)


def _without_brackets(text: str) -> str:
    """`a/(b*c)` as `a/b/c`: the one use of brackets that units need."""
    found = re.fullmatch(r"(.*)/\(([^()]*)\)", text)
    if not found:
        return text
    return found.group(1) + "".join("/" + part for part in _factors(found.group(2)))


def _factors(text: str) -> list[str]:
    return [part for part in re.split(r"(?<!\*)\*(?!\*)", text) if part]


def read_unit(text: str) -> Unit:
    """Read a unit at the edge (any scale, brackets allowed)."""
    return unit(_without_brackets(text.strip()))


def parse_number(text: str) -> float:
    """A plain number (`1e6`, `010` is ten); raises UnitProblem otherwise."""
    if _DECIMAL_COMMA.search(text):
        raise UnitProblem("decimal-comma", f"'{text}' has a decimal comma", f"Write {text.replace(',', '.')}.")
    if not re.fullmatch(NUMBER, text.strip()):
        raise UnitProblem("not-a-number", f"'{text}' is not a number")
    return float(text)


def parse_quantity(text: str) -> tuple[float, Unit | None]:
    """`42 kN/m` to (42000.0, unit); the unit is None where none is written. Raises UnitProblem."""
    found = _QUANTITY.match(text)
    if not found:
        raise UnitProblem(*_why_not(text))
    number = float(found.group(1))
    if found.group(2) is None:
        return number, None
    read = read_unit(found.group(2))
    return read.to_si(number), read


def _why_not(text: str) -> tuple[str, str, str]:
    if _DECIMAL_COMMA.search(text):
        return "decimal-comma", f"'{text}' has a decimal comma", f"Write '{text.replace(',', '.')}'."
    glued = re.fullmatch(rf"\s*({NUMBER})([A-Za-z%°µ].*)", text)
    if glued:
        return "quantity-no-space", f"'{text}' has no space between number and unit", \
            f"Write '{glued.group(1)} {glued.group(2).strip()}'."
    spaced = re.fullmatch(rf"\s*({NUMBER})\s+(\S+(?:\s+\S+)+)", text)
    if spaced:
        joined = re.sub(r"\s*([*/])\s*", r"\1", spaced.group(2)).replace(" ", "*")
        return "unit-space", f"'{text}' has a space inside its unit", f"Write '{spaced.group(1)} {joined}'."
    return "not-a-quantity", f"'{text}' is not a number with a unit", \
        "Write for example `42 kN/m`, or a formula that begins with `=`."


def parse_range(text: str) -> Range:
    """`30 .. 70 kN*s/m` or `42 kN/m +- 20 %` or `42 +- 3 kN/m`; raises UnitProblem."""
    found = _RANGE.match(text)
    if found:
        low, low_unit, high, high_unit = found.groups()
        last = read_unit(high_unit or low_unit or "1")
        first = read_unit(low_unit) if low_unit else last
        if first.dimension != last.dimension:
            raise UnitProblem("range-units", f"the two ends of '{text}' have different units")
        bounds = (first.to_si(float(low)), last.to_si(float(high)))
        if bounds[0] >= bounds[1]:
            raise UnitProblem("range-empty", f"the range '{text}' is empty", "Write the smaller value first.")
        return Range(*bounds, last)
    found = _BAND.match(text)
    if not found:
        raise UnitProblem("not-a-range", f"'{text}' is not a range",
                          "Write `30 .. 70 kN*s/m` or `42 kN/m +- 20 %`.")
    number, number_unit, width, width_unit = found.groups()
    own = read_unit(number_unit or ("1" if width_unit in (None, "%") else width_unit))
    value = own.to_si(float(number))
    if width_unit == "%":
        half = abs(value) * float(width) / 100
    else:
        half = abs(float(width)) * read_unit(width_unit or own.text).scale
    if half <= 0:
        raise UnitProblem("range-empty", f"the range '{text}' has no width")
    return Range(value - half, value + half, own, value)


def check_unit(given: Unit | None, wanted: Unit, value: float, text: str) -> None:
    """Raise UnitProblem unless a value read as (`value`, `given`) may stand where `wanted` is declared."""
    if given is None:
        if wanted.dimension == ONE and wanted.counts == "":
            return
        if value == 0 and "e" not in text.lower() and wanted.offset == 0:
            return  # a bare zero fits any unit
        raise UnitProblem("unit-missing", f"'{text}' has no unit", f"Write '{text.strip()} {wanted.text}'.")
    if given.dimension != wanted.dimension:
        raise UnitProblem("unit-wrong", f"'{text}' is in {given.text} ({dimension_text(given.dimension)}); "
                          f"{wanted.text} is needed")
    if given.counts and wanted.counts and given.counts != wanted.counts:
        factor = "2*pi" if wanted.counts == "angle" else "1/(2*pi)"
        raise UnitProblem("unit-cycles", f"'{text}' is in {given.text}; {wanted.text} is needed "
                          "(1 Hz is 2*pi rad/s)", f"Multiply by {factor}.")
    if wanted.counts == "cycles" and not given.counts and given.text not in ("Hz",) or \
            wanted.counts == "angle" and wanted.dimension != ONE and not given.counts:
        raise UnitProblem("unit-cycles", f"'{text}' does not say whether it counts cycles or radians",
                          f"Write it in {wanted.text}.")


@lru_cache(maxsize=4096)
def generic_unit(text: str) -> Unit:
    """A declared unit in which `$U` (solved for each instance) may take part: `$U/s`, `$Y/$U`, `$D.effort`."""
    if "$" not in text:
        return declared_unit(text)
    dimension = ONE
    for sign, factor in re.findall(r"(^|(?<!\*)[*/](?!\*))\s*((?:[^*/]|\*\*)+)", _without_brackets(text.strip())):
        base, _, power = factor.strip().partition("**")
        part: Dimension = ((base, Fraction(1)),) if base.startswith("$") else declared_unit(base).dimension
        dimension = times(dimension, part, Fraction(power or 1) * (-1 if sign == "/" else 1))
    return Unit(text, 1.0, 0.0, dimension)


def is_generic(dimension: Dimension) -> bool:
    """Whether a unit still to be solved takes part."""
    return any(base.startswith("$") for base, _ in dimension)


def solved(dimension: Dimension, values: Mapping[str, Dimension]) -> Dimension:
    """The dimension with the units that `values` knows put in."""
    result = ONE
    for base, power in dimension:
        result = times(result, values.get(base, ((base, Fraction(1)),)), power)
    return result
