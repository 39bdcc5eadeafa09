"""Common units as a table of scales, since the import of the units library takes as long as to assemble a model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from math import pi

_PREFIXES = {"": Fraction(1), "c": Fraction(1, 100), "m": Fraction(1, 1000), "k": Fraction(10**3), "M": Fraction(10**6),
             "G": Fraction(10**9)}
# symbol: size in base units, powers of m, kg, s, A, K, permitted prefixes, counted quantity
_SYMBOLS: dict[str, tuple[Fraction, tuple[int, ...], str, str]] = {
    "m": (Fraction(1), (1,), "cmk", ""), "kg": (Fraction(1), (0, 1), "", ""), "s": (Fraction(1), (0, 0, 1), "m", ""),
    "A": (Fraction(1), (0, 0, 0, 1), "m", ""), "K": (Fraction(1), (0, 0, 0, 0, 1), "", ""),
    "g": (Fraction(1, 1000), (0, 1), "", ""), "t": (Fraction(1000), (0, 1), "", ""),
    "min": (Fraction(60), (0, 0, 1), "", ""), "h": (Fraction(3600), (0, 0, 1), "", ""),
    "N": (Fraction(1), (1, 1, -2), "mkMG", ""), "Pa": (Fraction(1), (-1, 1, -2), "kMG", ""),
    "bar": (Fraction(10**5), (-1, 1, -2), "m", ""), "L": (Fraction(1, 1000), (3,), "m", ""),
    "J": (Fraction(1), (2, 1, -2), "kM", ""), "W": (Fraction(1), (2, 1, -3), "kM", ""),
    "V": (Fraction(1), (2, 1, -3, -1), "mk", ""), "ohm": (Fraction(1), (2, 1, -3, -2), "mk", ""),
    "F": (Fraction(1), (-2, -1, 4, 2), "m", ""), "H": (Fraction(1), (2, 1, -2, -2), "m", ""),
    "Hz": (Fraction(1), (0, 0, -1), "k", "cycles"),
    "rad": (Fraction(1), (), "m", "angle"), "deg": (Fraction(pi) / 180, (), "", "angle"),
    "rpm": (Fraction(pi) / 30, (0, 0, -1), "", "angle"),
}
_BASE = ("m", "kg", "s", "A", "K")
_UNITS = {prefix + symbol: (_PREFIXES[prefix] * size, powers, counts)
          for symbol, (size, powers, prefixes, counts) in _SYMBOLS.items() for prefix in ["", *prefixes]}
_FACTOR = re.compile(r"([*/])([A-Za-z]+)(?:\*\*(-?[0-9]{1,2}))?(?![^*/])")


def common_unit(text: str) -> tuple[float, Mapping[str, Fraction], str] | None:
    """Size in SI, powers of the base units, and counted quantity of a product such as `kN*s/m` or `1/min`.

    None if a factor is not among the common units, or is written in another form; the units library knows more.
    """
    powers = _factors(text)
    if powers is None:
        return (0.01, {}, "") if text == "%" else None
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


def _factors(text: str) -> dict[str, int] | None:
    """The power of each unit in a product."""
    remainder = text[1:] if text.startswith("1/") else "*" + text
    powers: dict[str, int] = {}
    while remainder:
        factor_match = _FACTOR.match(remainder)
        if factor_match is None or factor_match.group(2) not in _UNITS:
            return None
        sign = 1 if factor_match.group(1) == "*" else -1
        powers[factor_match.group(2)] = powers.get(factor_match.group(2), 0) + sign * int(factor_match.group(3) or 1)
        remainder = remainder[factor_match.end():]
    return powers
