"""Units of 20-sim as units of the language."""

from __future__ import annotations

import re

from heavebond.core.units import UnitProblem, declared_unit, dimension_text, read_unit


def unit_text(text: str) -> tuple[str, float, str]:
    """The base unit for a declaration, the factor to it, and the text of a unit that is not known (for `doc:`).

    A quantity may stand before the unit: `length, mm`.
    """
    text = text.rpartition(",")[2]
    plain = re.sub(r"(?<=[A-Za-z])([0-9])", r"**\1", text.strip().replace(".", "*").replace("^", "**").replace(" ", "*"))
    if plain in ("", "1", "none"):
        return "", 1.0, ""
    try:
        found = read_unit(plain)
        if found.scale == 1 and not found.offset:
            declared_unit(plain)
            return plain, 1.0, ""
        base = dimension_text(found.dimension)
        declared_unit(base)
    except (UnitProblem, ValueError):
        return "", 1.0, f"[{text.strip()}]"
    return (base, found.scale, "") if not found.offset else ("", 1.0, f"[{text.strip()}]")
