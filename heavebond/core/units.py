"""Quantities as `NUMBER SPACE UNIT`, ranges and tolerances; dimensions as exponents (the only importer of pint).

Inside heavebond every number is in SI base units. A dimension is a sorted tuple of (base unit, exponent) pairs without
zeros; in addition to m, kg, s, A, K, mol, cd a base may be an unknown unit such as `$U`. An angle in radians is
dimensionless, as in the SI, but `Hz` and `rad/s` are distinguished when a value is read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from math import isfinite, pi
from typing import TYPE_CHECKING, Any, TypeVar

from heavebond.core.errors import Place, Problems, suggest
from heavebond.core.limits import NUMBER as LARGEST
from heavebond.core.limits import QUANTITY
from heavebond.core.numerals import NUMBER

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from pint import Quantity, UnitRegistry

Dimension = tuple[tuple[str, Fraction], ...]
PINT_BASE = {"[length]": "m", "[mass]": "kg", "[time]": "s", "[current]": "A", "[temperature]": "K",
             "[substance]": "mol", "[luminosity]": "cd"}
ONE: Dimension = ()
FREQUENCY: Dimension = (("s", Fraction(-1)),)
ACCELERATION: Dimension = (("m", Fraction(1)), ("s", Fraction(-2)))
Values = TypeVar("Values", float, "NDArray[np.float64]")

_LETTERS = "A-Za-zµΩ°"
_UNDER = r"/\([A-Za-z]\w*(?:\*\*[0-9]+|[*/][A-Za-z]\w*)*\)"                         # /(s*Pa)
UNIT = (rf"(?:1/)?[{_LETTERS}%][\w°%µΩ]*"                                        # kN
        rf"(?:\*\*-?[0-9]{{1,2}}(?![0-9])|\^-?[0-9]+|[*/·](?=[{_LETTERS}])[\w°%µΩ]+)*"   # *s, /m, **2
        rf"(?:{_UNDER})?|1(?:{_UNDER})?")
_QUANTITY = re.compile(rf"\s*({NUMBER})(?:\s+({UNIT}))?\s*$")
_RANGE = re.compile(rf"\s*({NUMBER})(?:\s+({UNIT}))?\s*\.\.\s*({NUMBER})(?:\s+({UNIT}))?\s*$")
_BAND = re.compile(rf"\s*({NUMBER})(?:\s+({UNIT}))?\s*\+-\s*({NUMBER})(?:\s+({UNIT}))?\s*$")
_DECIMAL_COMMA = re.compile(r"[0-9],[0-9]")


LEAST = 1 / LARGEST  # of numbers other than 0: products of smaller ones become 0
TOO_LARGE = f"The largest number is {LARGEST:g} in SI units."
TOO_SMALL = f"The smallest number other than 0 is {LEAST:g} in SI units. Write 0 if nothing is meant."

SPELLINGS = {
    "Nm": "N*m", "Ns": "N*s", "kNs": "kN*s", "kNm": "kN*m", "Nms": "N*m*s", "lpm": "L/min", "gpm": "gal/min",
    "sec": "s", "Sec": "s", "KN": "kN", "Kg": "kg", "KG": "kg", "hz": "Hz", "kHZ": "kHz", "mpa": "MPa", "Mpa": "MPa",
    "gpa": "GPa", "Gpa": "GPa", "kpa": "kPa", "PA": "Pa", "Bar": "bar", "BAR": "bar", "cc": "cm**3", "m3": "m**3",
    "m2": "m**2", "s2": "s**2", "mm2": "mm**2", "cm2": "cm**2", "cm3": "cm**3", "mm3": "mm**3",
    "Grad": "deg", "Min": "min", "RPM": "rpm", "Rpm": "rpm", "U/min": "rpm", "Mm": "mm",
    "Ohm": "ohm", "Ohms": "ohm", "ohms": "ohm", "mOhm": "mohm", "kOhm": "kohm", "MOhm": "Mohm"}
COMMON = [
    "N", "kN", "MN", "kg", "t", "g", "m", "mm", "cm", "km", "s", "ms", "min", "h", "Pa", "kPa", "MPa", "GPa", "bar",
    "L", "L/min", "Hz", "kHz", "rad", "rad/s", "deg", "rpm", "degC", "K", "J", "kJ", "W", "kW", "V", "A", "mA", "%"]
# the units library also knows constants (`c`, `e`, `k`), currencies and decibels, which would misread names here
KNOWN = {
    "meter", "gram", "metric_ton", "second", "minute", "hour", "day", "newton", "pascal", "bar", "liter", "hertz",
    "radian", "degree", "revolution", "turn", "revolutions_per_minute", "revolutions_per_second", "degree_Celsius",
    "delta_degree_Celsius", "kelvin", "joule", "watt", "watt_hour", "volt", "ampere", "ohm", "farad", "henry",
    "tesla", "weber", "coulomb", "siemens", "mole", "candela", "percent", "degree_Fahrenheit",
    "delta_degree_Fahrenheit", "degree_Rankine", "inch", "foot", "yard", "mile", "nautical_mile", "knot", "pound",
    "ounce", "slug", "force_pound", "pound_force_per_square_inch", "kip", "kip_per_square_inch", "gallon", "quart",
    "pint", "barrel", "horsepower", "metric_horsepower", "kilogram_force", "force_kilogram", "atmosphere",
    "standard_atmosphere", "torr", "millimeter_Hg", "centimeter_H2O", "poise", "stokes", "hectare", "are", "dyne",
    "erg", "standard_gravity", "british_thermal_unit", "calorie", "technical_atmosphere"}
# units that may have a prefix above kilo; the units library permits one before any: `Min` (minutes) would be a million
# inches, `Grad` (degrees) 1e9 radians
PREFIXED = {"gram", "newton", "pascal", "bar", "hertz", "joule", "watt", "watt_hour", "volt", "ampere", "ohm", "liter",
            "calorie"}
LARGE = {"mega", "giga", "tera", "peta", "exa", "zetta", "yotta", "ronna", "quetta"}
ANGLES = {"radian", "degree", "turn", "revolution", "revolutions_per_minute", "revolutions_per_second"}
_GAUGE = re.compile(r"(bar|mbar|psi|[kM]?Pa)_?(?:g|a|gauge|abs|rel)")
_MISSPELT = re.compile(rf"(?<![\w*])(?:{'|'.join(SPELLINGS)})(?![A-Za-z0-9])")
_PREFIXES = {
    "": Fraction(1), "p": Fraction(1, 10**12), "n": Fraction(1, 10**9), "u": Fraction(1, 10**6), "m": Fraction(1, 1000),
    "c": Fraction(1, 100), "k": Fraction(10**3), "M": Fraction(10**6), "G": Fraction(10**9)}
# symbol: size in base units, powers of m, kg, s, A, K, permitted prefixes, counted quantity
_SYMBOLS: dict[str, tuple[Fraction, tuple[int, ...], str, str]] = {
    "m": (Fraction(1), (1,), "nucmk", ""), "kg": (Fraction(1), (0, 1), "", ""), "s": (Fraction(1), (0, 0, 1), "num", ""),
    "A": (Fraction(1), (0, 0, 0, 1), "num", ""), "K": (Fraction(1), (0, 0, 0, 0, 1), "", ""),
    "g": (Fraction(1, 1000), (0, 1), "m", ""), "t": (Fraction(1000), (0, 1), "", ""),
    "min": (Fraction(60), (0, 0, 1), "", ""), "h": (Fraction(3600), (0, 0, 1), "", ""),
    "N": (Fraction(1), (1, 1, -2), "mkMG", ""), "Pa": (Fraction(1), (-1, 1, -2), "kMG", ""),
    "bar": (Fraction(10**5), (-1, 1, -2), "m", ""), "L": (Fraction(1, 1000), (3,), "m", ""),
    "J": (Fraction(1), (2, 1, -2), "kM", ""), "W": (Fraction(1), (2, 1, -3), "mkM", ""),
    "V": (Fraction(1), (2, 1, -3, -1), "umk", ""), "ohm": (Fraction(1), (2, 1, -3, -2), "mk", ""),
    "F": (Fraction(1), (-2, -1, 4, 2), "pnum", ""), "H": (Fraction(1), (2, 1, -2, -2), "um", ""),
    "Hz": (Fraction(1), (0, 0, -1), "k", "cycles"),
    "rad": (Fraction(1), (), "m", "angle"), "deg": (Fraction(pi) / 180, (), "", "angle"),
    "rpm": (Fraction(pi) / 30, (0, 0, -1), "", "angle"),
}
_BASE = ("m", "kg", "s", "A", "K")
_UNITS = {prefix + symbol: (_PREFIXES[prefix] * size, powers, counts)
          for symbol, (size, powers, prefixes, counts) in _SYMBOLS.items() for prefix in ["", *prefixes]}
_FACTOR = re.compile(r"([*/])([A-Za-z]+)(?:\*\*(-?[0-9]{1,2}))?(?![^*/])")


class UnitProblem(ValueError):
    """A quantity that cannot be read; `code` is the stable code, `hint` states what to type."""

    def __init__(self, code: str, message: str, hint: str = ""):
        super().__init__(message)
        self.code, self.message, self.hint = code, message, hint


@dataclass(frozen=True)
class Unit:
    """A unit: value_SI = value * scale + offset, its dimension, and the counted quantity (`angle`, `cycles` or nothing)."""

    text: str
    scale: float
    offset: float
    dimension: Dimension
    counts: str = ""

    def to_si(self, value: Values) -> Values:
        """SI value of `value` given in this unit (also element by element for arrays)."""
        return value * self.scale + self.offset

    def from_si(self, value: Values) -> Values:
        """Value in this unit of an SI value (also element by element for arrays)."""
        return (value - self.offset) / self.scale

    def written(self, value: float) -> str:
        """`46.998 kN/m`: an SI value in this unit, to six digits."""
        number = f"{self.from_si(value):.6g}"
        return number if self.text in ("1", "") else f"{number} {self.text}"


    @property
    def of_intervals(self) -> Unit:
        """The unit of differences of values in this one: for degC K, for degF delta_degF."""
        if not self.offset:
            return self
        return Unit("K", 1.0, 0.0, self.dimension) if self.scale == 1 else \
            Unit(f"delta_{self.text}", self.scale, 0.0, self.dimension)


DIMENSIONLESS = Unit("1", 1.0, 0.0, ONE)
CELSIUS = Unit("degC", 1.0, 273.15, (("K", Fraction(1)),))


def dimension_of(exponents: Mapping[str, Fraction]) -> Dimension:
    """The dimension with these exponents."""
    return tuple(sorted((base, Fraction(power)) for base, power in exponents.items() if power))


@lru_cache(maxsize=4096)
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
def _registry() -> UnitRegistry[Any]:
    import pint

    registry: UnitRegistry[Any] = pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
    registry.define("percent = 0.01 = %")
    registry.define("@alias revolution = rev")
    return registry


def pint_quantity(values: NDArray[np.float64], unit: str) -> Quantity[Any]:
    """A quantity of pint in its application registry, where a user's own quantities are."""
    import pint

    registry: Any = pint.application_registry
    quantity: Quantity[Any] = registry.Quantity(values, _without_brackets(unit).replace("%", "percent"))
    return quantity


@lru_cache(maxsize=4096)
def unit(text: str) -> Unit:
    """Read a unit such as `kN/m`, `L/min`, `m**3/s`, `%`, `1`; UnitProblem for an unknown one."""
    text = text.strip()
    if text in ("1", ""):
        return DIMENSIONLESS
    if text == CELSIUS.text:
        return CELSIUS
    if "^" in text:
        raise UnitProblem("unit-power", f"the power in '{text}' is written `**`", f"Write '{text.replace('^', '**')}'.")
    if len(text) > QUANTITY or not re.fullmatch(UNIT, text):
        raise UnitProblem("unit-unknown", f"'{text}' is not a unit", "A unit is written without spaces: kN*s/m, "
                          "m**3/s, 1/s.")
    if _MISSPELT.search(text):  # the units library reads `Nm` as something else
        raise UnitProblem("unit-unknown", f"'{text}' is not a known unit", _unit_hint(text))
    if (common := common_unit(text)) is not None:
        scale, exponents, counts = common
        return Unit(text, scale, 0.0, dimension_of(exponents), counts)
    return _looked_up(text)


def _looked_up(text: str) -> Unit:
    """Read a unit with pint."""
    import pint

    registry = _registry()
    try:
        parsed = registry.parse_units(text.replace("°C", "degC").replace("·", "*"))
        names = {next((n for _, n, _ in registry.parse_unit_name(name) if n in KNOWN), name) for name in parsed._units}
        if not names <= KNOWN or any(_oddly_prefixed(registry, name) for name in parsed._units):
            raise ValueError(text)
        zero = registry.Quantity(0.0, parsed).to_base_units()
        one = registry.Quantity(1.0, parsed).to_base_units()
        many = registry.Quantity(1e6, parsed).to_base_units()  # the difference of two temperatures loses digits
    except (pint.errors.PintError, AttributeError, ValueError, TypeError, KeyError, ArithmeticError,
            AssertionError, SyntaxError, RecursionError) as error:  # exceptions of the units library for some texts
        raise UnitProblem("unit-unknown", f"'{text}' is not a known unit", _unit_hint(text)) from error
    dimension = dimension_of({PINT_BASE[name]: Fraction(float(str(power))).limit_denominator(1000)
                              for name, power in dict(one.dimensionality).items()})
    # to_base_units gives kilogram-metre-second numbers, which are SI numbers
    offset = float(zero.magnitude)
    scale = float(f"{(float(many.magnitude) - offset) / 1e6 if offset else float(one.magnitude):.16g}")
    if not (isfinite(scale) and scale > 0):
        raise UnitProblem("unit-unknown", f"'{text}' cannot be converted to base units", _unit_hint(text))
    counts = "cycles" if "hertz" in names else "angle" if names & ANGLES else ""
    return Unit(text, scale, offset, dimension, counts)


def _oddly_prefixed(registry: UnitRegistry[Any], name: str) -> bool:
    """True if a unit has an unusual prefix above kilo."""
    readings = [(prefix, base) for prefix, base, _ in registry.parse_unit_name(name)]
    return all(prefix in LARGE and base not in PREFIXED for prefix, base in readings)


def unknown_unit(text: str) -> str:
    """Suggestion for a unit that cannot be read."""
    try:
        read_unit(text)
    except UnitProblem as problem:
        return problem.hint
    return ""


def _unit_hint(text: str) -> str:
    if (gauge := _GAUGE.fullmatch(text)) is not None:
        return f"Write '{gauge.group(1)}': a unit does not state the zero of a pressure. Hydraulic circuits count " \
            "from atmospheric pressure, pneumatic ones from vacuum; a gauge in one of these shows `node.p - 1.01325 bar`."
    if _MISSPELT.search(text):
        return f"Did you mean '{_MISSPELT.sub(lambda misspelt: SPELLINGS[misspelt.group()], text)}'?"
    if product := _as_product(text):
        return f"Did you mean '{product}'?"
    if near := suggest(text, COMMON):
        return near
    return "Units are written as N, kN/m, kN*s/m, bar, L/min, m**3/s, mm/s, Hz, rad/s, degC, %, 1."


def _as_product(text: str) -> str:
    """A unit of common factors without signs between them, as `mNm` or `kgm2`, with the signs; empty if it is not one.
    The reading with the fewest factors is chosen, the longer factor first."""
    factors = [part if part in "*/" else _with_signs(part) for part in re.split(r"((?<!\*)[*/](?!\*))", text)]
    product = "".join(factors) if all(factors) else ""
    return product if product != text and common_unit(product) is not None else ""


def _with_signs(text: str) -> str:
    unit_match = re.fullmatch(r"([A-Za-z]{1,6})(?:\*\*)?(-?[1-9]?)", text)
    if unit_match is None:
        return ""
    word, power = unit_match.group(1), f"**{unit_match.group(2)}" if unit_match.group(2) else ""
    ends = range(len(word), 0, -1)
    splits = [[p for p in (word[:i], word[i:j], word[j:]) if p] for j in ends for i in ends if i <= j]
    known = [pieces for pieces in splits if all(common_unit(p) is not None for p in pieces)]
    fewest: list[str] = min(known, key=len, default=[])
    return "*".join(fewest) + power if fewest else ""


def dimension_text(dimension: Dimension) -> str:
    """A dimension in common units, e.g. `N/m`, else in base units."""
    for name in ("1", "m", "m/s", "m/s**2", "kg", "s", "N", "N/m", "N*s/m", "N*m", "Pa", "Pa/s", "m**2", "m**3",
                 "m**3/s", "m**3/(s*Pa)", "W", "J", "kg/s", "kg/m**3", "K", "1/s", "A", "V", "1/m", "s/m",
                 "N/s", "N*s", "N/m**2", "m/s**3", "kg*m**2", "kg*m", "Pa*s", "Pa*s/m**3", "Pa/m", "W/K", "J/kg",
                 "J/(kg*K)", "ohm", "H", "F", "N*m*s", "V*s", "V/s", "V*s/m", "V/m", "A/V", "A/s", "1/V", "1/(V*s)",
                 "m/V", "m/(V*s)"):
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
        raise UnitProblem("unit-not-base", f"a declaration is in base units, and '{text}' is not a base unit",
                          f"Write `unit: {dimension_text(read.dimension)}`; values may be given in {text}.")
    return Unit(text, read.scale, read.offset, read.dimension, read.counts)


def without_inner_bracket(text: str) -> str | None:
    """A quantity `1 a/(b/c)/d` as `1 a/b*c/d`; None if it is not one."""
    bracket_match = re.fullmatch(rf"\s*({NUMBER})\s+([^()\s]+/\([^()]*\))((?:[*/][^()*/\s]+(?:\*\*-?[0-9]+)?)+)\s*", text)
    if bracket_match is None:
        return None
    flat = _without_brackets(bracket_match.group(2)) + bracket_match.group(3)
    try:
        unit(flat)
    except UnitProblem:
        return None
    return f"{bracket_match.group(1)} {flat}"


def _without_brackets(text: str) -> str:
    """`a/(b*c)` as `a/b/c`, `a/(b/c)` as `a/b*c`: the only brackets that units need."""
    quotient_match = re.fullmatch(r"(.*)/\(([^()]*)\)", text)
    if not quotient_match:
        return text
    factors = re.findall(r"(^|/|(?<!\*)\*(?!\*))((?:[^*/]|\*\*)+)", quotient_match.group(2))
    return quotient_match.group(1) + "".join(("*" if sign == "/" else "/") + part for sign, part in factors)


def read_unit(text: str) -> Unit:
    """Read a unit of input or output (any scale, brackets allowed)."""
    return replace(unit(_without_brackets(text.strip())), text=text.strip())


def interval_unit(text: str) -> str:
    """The text of a unit for differences: `K` for `degC`, `delta_degF` for `degF`, any other unit as it is."""
    read = read_unit(text)
    return read.of_intervals.text if read.offset else text


def counts_from_origin(text: str) -> bool:
    """True if a unit has an offset, as degC and degF; False for a unit that cannot be read."""
    try:
        return read_unit(text).offset != 0
    except UnitProblem:
        return False


def interval_text(value: float, unit_read: Unit | None) -> str:
    """Text of an interval that was read as the SI `value` of a unit with an offset: `0.3 K` for `0.3 degC`."""
    assert unit_read is not None
    return f"{unit_read.from_si(value) * unit_read.scale:.6g} K"


def _number(text: str, whole: str, read: Unit | None = None) -> float:
    """The number of a text, in SI if it has a unit; UnitProblem if it is too large, or so small that products with it
    become 0."""
    number = float(text)
    si = number if read is None else read.to_si(number)
    if not max(abs(number), abs(si)) <= LARGEST:
        raise UnitProblem("number-too-large", f"'{whole}' is too large a number", TOO_LARGE)
    if is_lost(text, number) or (number and read is not None and not read.offset and abs(si) < LEAST):
        raise UnitProblem("number-too-small", f"'{whole}' is too small a number", TOO_SMALL)
    return si


def is_lost(text: str, number: float) -> bool:
    """True if the value of a number is below the smallest one, although its text is not that of zero."""
    return abs(number) < LEAST and any(digit in text.lower().partition("e")[0] for digit in "123456789")


def parse_quantity(text: str) -> tuple[float, Unit | None]:
    """`42 kN/m` to (42000.0, unit); the unit is None if none is written. Raises UnitProblem."""
    if text.lstrip().startswith("="):
        raise UnitProblem("not-a-quantity", f"'{text.strip()}' is a formula; a number with a unit is needed here",
                          AS_QUANTITY)
    if len(text) > QUANTITY:
        raise UnitProblem("not-a-quantity", f"'{text[:30]} ...' is too long for a number with a unit", AS_QUANTITY)
    quantity_match = _QUANTITY.match(text)
    if not quantity_match or "^" in text:
        raise UnitProblem(*_why_not(text))
    read = None if quantity_match.group(2) is None else read_unit(quantity_match.group(2))
    return _number(quantity_match.group(1), text, read), read


def _why_not(text: str) -> tuple[str, str, str]:
    if re.fullmatch(rf"\s*{NUMBER}\s+\S*\^\S*\s*", text):
        return "unit-power", f"the power in '{text}' is written `**`", f"Write '{text.strip().replace('^', '**')}'."
    grouped = re.fullmatch(r"\s*([+-]?[0-9]{1,3}(?:([' _\u2019\u00a0\u202f])[0-9]{3})(?:\2[0-9]{3})*(?:\.[0-9]+)?)"
                           r"(\s+\S+)?\s*", text)
    if grouped:
        return "not-a-quantity", f"'{text}' has separators of thousands", \
            f"Write '{grouped.group(1).replace(grouped.group(2), '')}{grouped.group(3) or ''}'."
    if _DECIMAL_COMMA.search(text):
        return "decimal-comma", f"'{text}' has a decimal comma", f"Write '{text.replace(',', '.')}'."
    glued = re.fullmatch(rf"\s*((?>{NUMBER}))([A-Za-z%°µ].*)", text)
    if glued:
        return "quantity-no-space", f"'{text}' has no space between number and unit", \
            f"Write '{glued.group(1)} {glued.group(2).strip()}'."
    spaced = re.fullmatch(rf"\s*({NUMBER})\s+(\S+(?:\s+\S+)+)", text)
    if spaced:
        joined = re.sub(r"\s+", "*", re.sub(r"\s*([*/])\s*", r"\1", spaced.group(2)))
        try:
            read_unit(joined)
        except UnitProblem:
            return "not-a-quantity", f"'{text}' is not a number with a unit", AS_QUANTITY
        return "unit-space", f"'{text}' has a space inside its unit", f"Write '{spaced.group(1)} {joined}'."
    return "not-a-quantity", f"'{text}' is not a number with a unit", AS_QUANTITY


AS_QUANTITY = "Write for example `42 kN/m`."


def parse_range(text: str, wanted: str | None = None) -> Range:
    """`30 .. 70 kN*s/m` or `42 kN/m +- 20 %` or `42 +- 3 kN/m`; raises UnitProblem, which suggests the unit `wanted` for a
    plain number."""
    range_match = _RANGE.match(text) if len(text) <= QUANTITY else None
    if range_match:
        low, low_unit, high, high_unit = range_match.groups()
        last = read_unit(high_unit or low_unit or "1")
        first = read_unit(low_unit) if low_unit else last
        if first.dimension != last.dimension:
            raise UnitProblem("range-units", f"the two ends of '{text}' are in different units",
                              "Write both in the same unit.")
        bounds = (_number(low, text, first), _number(high, text, last))
        if bounds[0] >= bounds[1]:
            raise UnitProblem("range-empty", f"the range '{text}' is empty", "Write the smaller value first: "
                              f"`{' '.join(filter(None, [high, high_unit if low_unit else None]))} .. {low} "
                              f"{low_unit or high_unit or ''}".rstrip() + "`.")
        return Range(*bounds, last)
    range_match = _BAND.match(text) if len(text) <= QUANTITY else None
    if not range_match:
        raise UnitProblem("not-a-range", f"'{text}' is not a range", _range_hint(text, wanted))
    number, number_unit, width, width_unit = range_match.groups()
    range_unit = read_unit(number_unit or ("1" if width_unit in (None, "%") else width_unit))
    value = range_unit.to_si(_number(number, text))
    if width_unit == "%" and range_unit.offset:
        raise UnitProblem("range-relative", f"a percentage of '{number} {range_unit.text}' depends on the zero of the scale",
                          f"Write a width: `{number} {range_unit.text} +- 5 K`.")
    if width_unit == "%":
        half = abs(value) * _number(width, text) / 100
    else:
        half = abs(_number(width, text)) * read_unit(width_unit or range_unit.text).scale
    if half <= 0:
        raise UnitProblem("range-empty", f"the range '{text}' has no width", "Write a tolerance above 0.")
    return Range(value - half, value + half, range_unit, value)


def _range_hint(text: str, wanted: str | None) -> str:
    """Suggestion for a malformed range: a tolerance with another sign, or a quantity without one, in the unit `wanted`
    (None: unknown)."""
    if wanted != "1" and re.fullmatch(rf"\s*{NUMBER}\s*", text) and len(text) <= QUANTITY:
        number = text.strip()
        spans = {True: f"0 .. {number}", False: f"{number} .. 0"}
        span = spans[float(number) > 0] if float(number) else "-1 .. 1"
        if wanted is None:
            return f"Write the lowest and the highest value, `{span}`, and after them the unit of the quantity, " \
                "if it has one: `30 .. 70 kN*s/m`."
        return f"Write the lowest and the highest value with their unit, for example `{span} {wanted}`."
    signed = re.sub(r"\s*(\+/-|±|\+ -)\s*", " +- ", text)
    for candidate in (signed, f"{text.strip()} +- 20 %"):
        if _BAND.match(candidate) and len(candidate) <= QUANTITY:
            return f"Write `{candidate}`."
    return "Write `30 .. 70 kN*s/m` or `42 kN/m +- 20 %`."


def check_unit(unit_read: Unit | None, wanted: Unit, value: float, text: str) -> None:
    """Raise UnitProblem if a value read as (`value`, `unit_read`) does not fit the unit `wanted` of the declaration."""
    text = text.strip()
    if unit_read is None:
        if wanted.dimension == ONE and wanted.counts == "":
            return
        if value == 0 and "e" not in text.lower() and wanted.offset == 0:
            return  # a bare zero fits any unit
        raise UnitProblem("unit-missing", f"'{text}' has no unit", f"Write '{text} {wanted.text}', if that is meant.")
    if unit_read.dimension != wanted.dimension:
        needed = "a number without unit" if wanted.dimension == ONE else wanted.text
        raise UnitProblem("unit-wrong", f"'{text}' is in {unit_read.text}; {needed} is needed",
                          "Write a number without unit, or in %." if wanted.dimension == ONE else
                          other_unit(unit_read, wanted))
    if (instead := counted_otherwise(unit_read, wanted)) is not None:
        if unit_read.counts:
            factor = 2 * pi if wanted.counts == "angle" else 1 / (2 * pi)
            raise UnitProblem("unit-cycles", f"'{text}' is in {unit_read.text}; {wanted.text} is needed",
                              f"1 Hz is 2*pi rad/s: write '{value * factor:.6g} {wanted.text}'.")
        raise UnitProblem("unit-cycles", f"'{text}' does not distinguish cycles and radians", instead)


def counted_otherwise(unit_read: Unit, wanted: Unit) -> str | None:
    """Correction if `unit_read` has the dimension of `wanted` but another count (cycles for radians), or no count: 1/min
    of a speed would be read as radians per minute instead of revolutions. None if they agree."""
    if wanted.counts in ("", unit_read.counts) or (not unit_read.counts and wanted.dimension == ONE):
        return None
    if wanted.counts == "angle" and (turns := as_meant(unit_read, wanted)) is not unit_read:
        return f"Write `{turns.text}` for revolutions, {wanted.text} for radians."
    if wanted.text.endswith("/rad") and not unit_read.counts:
        return f"Write `{unit_read.text}/rev` for a value per revolution, `{unit_read.text}/rad` for one per radian."
    return f"Write it in {wanted.text}."


def as_meant(unit_read: Unit, wanted: Unit) -> Unit:
    """The intended unit in the text of a logger or data sheet if `wanted` is measured: 1/min of a shaft are revolutions,
    g of an acceleration is standard gravity. Otherwise `unit_read` itself."""
    if wanted.dimension == ACCELERATION and unit_read.text == "g":
        return unit("g_n")
    if wanted.dimension == FREQUENCY == unit_read.dimension and wanted.counts == "angle" != unit_read.counts:
        turns = {f"{1 / 60:.12g}": "rpm", "1": "rps"}.get(f"{unit_read.scale:.12g}")
        return unit(turns) if turns is not None else unit_read
    return unit_read


def other_unit(unit_read: Unit, wanted: Unit) -> str:
    """Correction for a unit of another dimension."""
    if (intended := as_meant(unit_read, wanted)) is not unit_read:
        return f"{unit_read.text} is the gram; write `{intended.text}` for the acceleration of gravity, 9.80665 m/s**2."
    if wanted.dimension == unit("kg").dimension and unit_read.dimension == unit("N").dimension:
        return f"{unit_read.text} is a force: a mass is its weight over 9.80665 m/s**2, in {wanted.text}."
    if unit_read.dimension == unit("kg").dimension and wanted.dimension == unit("N").dimension:
        return f"{unit_read.text} is a mass: its weight is 9.80665 m/s**2 times the mass, in {wanted.text}."
    return f"Write it in {wanted.text} or in a multiple of it."


def check_turns(unit_text: str, wanted: Unit, subject: str, place: Place | None, problems: Problems) -> None:
    """Add a problem if `subject`, a speed of rotation or a frequency, is given in a unit with another count: 1/min or Hz
    of a shaft would be taken for radians, and be wrong by 2*pi. 1/s, the SI unit, is accepted for either."""
    read = read_unit(unit_text)
    if read.dimension != wanted.dimension or wanted.dimension != FREQUENCY or (not read.counts and read.scale == 1):
        return
    if (instead := counted_otherwise(read, wanted)) is not None:
        counted = "radians" if wanted.counts == "angle" else "cycles"
        problems.add("unit-cycles", f"{subject} is in {wanted.text}; {unit_text} does not count {counted}", place,
                     hint=instead)


@lru_cache(maxsize=4096)
def generic_unit(text: str) -> Unit:
    """Read a declared unit that may contain `$U` (solved for each instance): `$U/s`, `$Y/$U`, `$D.effort`."""
    if "$" not in text:
        return declared_unit(text)
    if not re.fullmatch(r"[\w$.*/()-]+", text.strip()):
        raise UnitProblem("unit-unknown", f"'{text}' is not a unit", "Write for example $U, $U/s or $Y/$U.")
    dimension = ONE
    for sign, factor in re.findall(r"(^|(?<!\*)[*/](?!\*))\s*((?:[^*/]|\*\*)+)", _without_brackets(text.strip())):
        base, _, power = factor.strip().partition("**")
        if not re.fullmatch(r"-?[0-9]{1,2}|", power) or not re.fullmatch(r"\$[A-Za-z]\w*(\.(effort|flow))?|[^$]+", base):
            raise UnitProblem("unit-unknown", f"'{text}' is not a unit", "Write for example $U, $U/s or $Y/$U.")
        part: Dimension = ((base, Fraction(1)),) if base.startswith("$") else declared_unit(base).dimension
        dimension = times(dimension, part, Fraction(power or 1) * (-1 if sign == "/" else 1))
    return Unit(text, 1.0, 0.0, dimension)


def is_generic(dimension: Dimension) -> bool:
    """True if the dimension contains an unknown unit."""
    return any(base.startswith("$") for base, _ in dimension)


def solved(dimension: Dimension, values: Mapping[str, Dimension]) -> Dimension:
    """Substitute the known units of `values` in the dimension."""
    result = ONE
    for base, power in dimension:
        result = times(result, values.get(base, ((base, Fraction(1)),)), power)
    return result


def common_unit(text: str) -> tuple[float, Mapping[str, Fraction], str] | None:
    """Size in SI, powers of the base units, and counted quantity of a product such as `kN*s/m` or `1/min`.

    None if a factor is not among the common units, or is written in another form; the units library knows more.
    """
    if text == "%":
        return 0.01, {}, ""
    remainder = text[1:] if text.startswith("1/") else "*" + text
    powers: dict[str, int] = {}  # of each unit in the product
    while remainder:
        factor_match = _FACTOR.match(remainder)
        if factor_match is None or factor_match.group(2) not in _UNITS:
            return None
        sign = 1 if factor_match.group(1) == "*" else -1
        powers[factor_match.group(2)] = powers.get(factor_match.group(2), 0) + sign * int(factor_match.group(3) or 1)
        remainder = remainder[factor_match.end():]
    scale = Fraction(1)
    exponents = dict.fromkeys(_BASE, Fraction(0))
    counted = set()
    for name, power in powers.items():
        size, dimension, counts = _UNITS[name]
        scale *= size**power
        counted.add(counts if power else "")
        for base, exponent in zip(_BASE, dimension, strict=False):
            exponents[base] += exponent * power
    # sixteen digits, as requested from the units library
    return float(f"{float(scale):.16g}"), exponents, "cycles" if "cycles" in counted else max(counted)
