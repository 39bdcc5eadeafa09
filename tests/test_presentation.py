"""Digits, prefixes, units on paper and plain columns."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from heavebond.core.presentation import (
    columns,
    count,
    number,
    path_text,
    quantity,
    readable,
    readable_difference,
    readable_unit,
    unit_label,
)


@pytest.mark.parametrize(("value", "digits", "text"), [
    (0.0, 5, "0"), (-0.0, 5, "0"), (17249999.99, 5, "1.725e+07"), (0.5, 5, "0.5"), (-26.10807, 5, "-26.108"),
    (123456.7, 5, "123457"), (1e-9, 5, "1.000e-09"), (0.00038449, 5, "0.00038449"), (math.nan, 5, "-"),
    (math.inf, 5, "inf"), (99.9996, 4, "100"),
])
def test_number(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


@pytest.mark.parametrize(("value", "unit", "text"), [
    (17.25e6, "Pa", "172.5 bar"), (30000.0, "N", "30 kN"), (-0.0123, "m", "-12.3 mm"), (0.5, "m", "0.5 m"),
    (7.667e-3, "m**3/s", "460.02 L/min"), (0.0, "N", "0 N"), (0.25, "1", "0.25"), (30.0, "kN", "30 kN"),
    (0.004174, "s", "4.174 ms"), (2e-5, "s", "20 us"), (14.0, "s", "14 s"), (0.02, "A", "20 mA"), (3e-3, "V", "3 mV"),
])
def test_readable(value: float, unit: str, text: str) -> None:
    assert readable(value, unit) == text


def test_a_unit_that_somebody_chose_stays() -> None:
    assert readable_unit("kN", 1e-6) == "kN"
    assert readable_unit("N", 1e6) == "kN"
    assert readable_unit("furlong", 1.0) == "furlong"


@pytest.mark.parametrize(("unit", "label"), [
    ("m**3/s", "m³/s"), ("kN*s/m", "kN·s/m"), ("1", "–"), ("degC", "°C"), ("m**3/(s*Pa)", "m³/(s·Pa)"),
])
def test_unit_label(unit: str, label: str) -> None:
    assert unit_label(unit) == label


@pytest.mark.parametrize(("unit", "word"), [
    ("kN", "force"), ("bar", "pressure"), ("mm", "position"), ("L/min", "volume flow"), ("rad/s", "angular velocity"),
    ("deg", "angle"), ("kg/s", "mass flow"), ("N*s/m", "damping"), ("1", ""), ("nonsense", ""),
])
def test_quantity(unit: str, word: str) -> None:
    assert quantity(unit) == word


def test_columns_wrap_the_last_and_cut_none() -> None:
    lines = columns([("a", "short"), ("longer", "many words " * 8)], 40)
    assert lines[0] == "  a       short"
    assert all(len(line) <= 40 for line in lines)
    assert all(line.startswith(" " * 10) for line in lines[2:])
    assert columns([], 40) == []


def test_columns_beside_a_wide_first_one_begin_on_a_line_of_their_own() -> None:
    lines = columns([("x" * 50, "a text of some words that does not fit beside it")], 60)
    assert lines[0].strip() == "x" * 50
    assert all(len(line) <= 60 for line in lines)


def test_count() -> None:
    assert [count(n, "loop") for n in (0, 1, 2)] == ["no loops", "1 loop", "2 loops"]


def test_path_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert path_text(tmp_path / "a" / "b.yaml") == str(Path("a") / "b.yaml")
    assert path_text(Path("/elsewhere/b.yaml")) == "/elsewhere/b.yaml"


def test_an_error_of_a_temperature_is_told_in_kelvin() -> None:
    assert readable_difference(0.5, "degC", 3) == "0.5 K"
    assert readable_difference(9, "degF", 3) == "5 K"
    assert readable_difference(30000, "Pa", 3) == "0.3 bar"
