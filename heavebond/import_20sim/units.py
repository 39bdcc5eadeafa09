"""Units of 20-sim as units of the language."""

from __future__ import annotations

import re
from dataclasses import dataclass

from heavebond.core.units import Dimension, UnitProblem, declared_unit, dimension_text, read_unit

SPELLINGS = {"sec": "s", "Nm": "N*m", "Nms": "N*m*s", "Ns": "N*s", "Ohm": "ohm", "kOhm": "kohm", "MOhm": "Mohm", "Ah": "A*h",
             "mAh": "mA*h", "Ws": "W*s", "Wh": "W*h", "cc": "cm**3", "kmh": "km/h", "mph": "mile/h"}
# base units of single tokens
NAMED = ("m", "s", "kg", "K", "A", "mol", "N", "Pa", "W", "V", "ohm", "F", "H", "C", "T", "Wb")
TURNS = {"deg": "rad", "rev": "rad", "rad": "rad", "rpm": "rad/s"}


@dataclass(frozen=True)
class ReadUnit:
    """A unit with the base unit for a declaration; a value x of it is `factor * x + offset` in the base. `doc` is the
    text of an unknown unit, whose values are unchanged."""

    base: str = ""
    factor: float = 1.0
    offset: float = 0.0
    doc: str = ""

    def si(self, value: float) -> float:
        if self.factor == 1 and not self.offset:
            return value
        return float(f"{self.factor * value + self.offset:.15g}")  # 5 uF as 5e-06 F, not as 4.9999999999999996e-06 F


def unit_of(text: str) -> ReadUnit:
    """A unit in the notation of 20-sim: `kg.m2`, `N.s/m`, `m.s-1`, `length, mm`; both programs compute in SI units."""
    text = text.rpartition(",")[2].strip()
    spelt = re.sub(r"[A-Za-z]+", lambda m: SPELLINGS.get(m.group(), m.group()), text)
    plain = re.sub(r"(?<=[A-Za-z])(-?[0-9]+)", r"**\1", spelt.replace(".", "*").replace("^", "**").replace(" ", "*"))
    plain = plain.replace("****", "**")
    if plain in ("", "1", "none", "-"):
        return ReadUnit()
    try:
        unit_read = read_unit(plain)
        base = plain if unit_read.scale == 1 and not unit_read.offset else _base(plain, unit_read.dimension)
        declared_unit(base)
    except (UnitProblem, ValueError, OverflowError):
        return ReadUnit(doc=f"[{text}]")
    return ReadUnit("" if base == "1" else base, unit_read.scale, unit_read.offset)


def _base(plain: str, dimension: Dimension) -> str:
    """The unit of scale 1 for `mm`, `km/h`, `uF` ...: each token in its base unit if that is the same quantity."""
    def token(match: re.Match[str]) -> str:
        word = match.group()
        if word in TURNS:
            return f"({TURNS[word]})" if "/" in TURNS[word] else TURNS[word]
        measured = read_unit(word).dimension
        return next((name for name in NAMED if read_unit(name).dimension == measured),
                    f"({dimension_text(measured)})")

    try:
        base = re.sub(r"[A-Za-z]+", token, plain)
        base = base[1:-1] if base.startswith("(") and base.endswith(")") and base.count("(") == 1 else base
        read = read_unit(base)
        if read.scale == 1 and not read.offset and read.dimension == dimension:
            return base
    except (UnitProblem, ValueError, OverflowError):
        pass
    return dimension_text(dimension)


def unit_factor(text: str) -> float:
    """The factor of a number with a unit in an equation, such as `1 {hr}`."""
    return unit_of(text).factor
