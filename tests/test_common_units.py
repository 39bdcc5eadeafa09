"""The table of common units says what the units library says."""

from __future__ import annotations

import subprocess
import sys
from itertools import product

import pytest

from heavebond.core import units
from heavebond.core.units import _UNITS, common_unit

PRODUCTS = [
    *_UNITS, "%", *(f"1/{name}" for name in _UNITS), *(f"{a}{sign}{b}" for a, b in product(_UNITS, _UNITS) for sign in "*/"),
    *(f"{name}**{power}" for name in _UNITS for power in (2, 3, -1, -2)), "kN*s/m", "m**3/s/Pa", "kg/m**3", "J/kg/K",
    "N*s**2/m**2", "1/m/s", "L/min/bar"]


@pytest.mark.long
def test_the_units_library_agrees() -> None:
    for text in [*PRODUCTS, "degC"]:
        ours, theirs = units.unit(text), units._looked_up(text)
        assert (ours.text, ours.dimension, ours.counts, ours.offset) == \
            (text, theirs.dimension, theirs.counts, theirs.offset), text
        # the library multiplies and divides in floating point, the table in fractions
        assert ours.scale == pytest.approx(theirs.scale, rel=1e-15), text


@pytest.mark.parametrize("text", ["foot", "degC", "m**3s", "N m", "m**", "m*", "kN/%", "ml", "1", "", "m**3/(s*Pa)", "kkN"])
def test_what_is_not_in_the_table_is_left_to_the_units_library(text: str) -> None:
    assert common_unit(text) is None


def test_the_bundled_files_do_not_import_the_units_library() -> None:
    """Its import takes as long as that of all else that a run needs."""
    program = """
import sys
from heavebond.language.library import library
import heavebond as hb
known = library()
[known.component(name) for name in known.names()]
hb.loads("model: m\\ncomponents: {push: {is: ForceSource, u: =2 kN/s*time}, warm: {is: TemperatureSource, u: 20 degC}}")
print("pint" in sys.modules)
"""
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert told.stdout == "False\n"


def test_fractions_leave_no_rounding() -> None:
    assert units.unit("kg/L").scale == 1000
    assert units.unit("L/min").scale == 1.666666666666667e-05
