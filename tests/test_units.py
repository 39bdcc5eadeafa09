"""Quantities, ranges and units: what is read, what is refused, and what a refusal says."""

from __future__ import annotations

from fractions import Fraction
from math import inf, isfinite, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

import heavebond as hb
from heavebond.core.units import (
    DIMENSIONLESS,
    ONE,
    UnitProblem,
    check_unit,
    declared_unit,
    dimension_text,
    generic_unit,
    is_generic,
    parse_quantity,
    parse_range,
    read_unit,
    solved,
    times,
)

COMMON = ["m", "mm", "kg", "t", "s", "min", "h", "N", "kN", "kN/m", "kN*s/m", "N*m", "Pa", "bar", "MPa", "L", "L/min",
          "m**3/s", "m**3/(s*Pa)", "Hz", "rad/s", "rpm", "deg", "degC", "K", "%", "1", "1/s", "kg/m**3", "J/(kg*K)", "V/m"]


@pytest.mark.parametrize(("text", "value"), [
    ("42 kN/m", 42e3), ("35 bar", 35e5), ("460 L/min", 460e-3 / 60), ("1e6 Pa", 1e6), ("010 m", 10.0), ("-3 mm", -3e-3),
    (".5 t", 500.0), ("20 degC", 293.15), ("68 degF", 293.15), ("5 %", 0.05), ("7", 7.0), ("+2.5e-3 1", 2.5e-3),
    ("30 rpm", pi), ("90 deg", pi / 2), ("2 m**3/(s*Pa)", 2.0), ("3 N/mm²", 3e6), ("4 °C", 277.15), ("1 rev/min", pi / 30),
    ("5 psi", 5 * 6894.757293168361), ("3 kN/(m/s)", 3e3), ("1e+10 Pa*s/(m**3/s)", 1e10), ("2 1/(V*s)", 2.0)])
def test_quantity_in_si(text: str, value: float) -> None:
    assert parse_quantity(text)[0] == pytest.approx(value, rel=1e-14)


def test_quantity_without_unit() -> None:
    assert parse_quantity(" 1e6 ") == (1e6, None)


@pytest.mark.parametrize(("text", "code", "advice"), [
    ("1,5 m", "decimal-comma", "Write '1.5 m'."),
    ("2.5kg", "quantity-no-space", "Write '2.5 kg'."),
    ("1.2 kN / m", "unit-space", "Write '1.2 kN/m'."),
    ("10 N s/m", "unit-space", "Write '10 N*s/m'."),
    ("0.2 m^3", "unit-power", "Write '0.2 m**3'."),
    ("5 Nm", "unit-unknown", "Did you mean 'N*m'?"),
    ("2.5 Kg", "unit-unknown", "Did you mean 'kg'?"),
    ("3 m3/s", "unit-unknown", "Did you mean 'm**3/s'?"),
    ("50 mNm", "unit-unknown", "Did you mean 'mN*m'?"),
    ("1.8 kgm2", "unit-unknown", "Did you mean 'kg*m**2'?"),
    ("1.8 kg*m2", "unit-unknown", "Did you mean 'kg*m**2'?"),
    ("2 Nms/rad", "unit-unknown", "Did you mean 'N*m*s/rad'?"),
    ("2 xyz", "unit-unknown", "Units are written as"),
    ("2 dollar", "unit-unknown", "Units are written as"),
    ("1e999 m", "number-too-large", "The largest"),
    ("1e308 km", "number-too-large", "The largest"),
    ("1e-999 kg", "number-too-small", "The smallest"),
    ("-1e-320", "number-too-small", "The smallest"),
    ("1e-95 pm", "number-too-small", "The smallest"),
    ("3 m**99999999999", "not-a-quantity", "Write for example"),
    ("on", "not-a-quantity", "Write for example"),
    ("", "not-a-quantity", "Write for example"),
    ("12:30", "not-a-quantity", "Write for example"),
    ("0x10", "quantity-no-space", "Write"),
    ("9" * 300, "not-a-quantity", "Write for example")])
def test_refused_quantity(text: str, code: str, advice: str) -> None:
    with pytest.raises(UnitProblem) as caught:
        parse_quantity(text)
    assert (caught.value.code, caught.value.hint[:len(advice)]) == (code, advice)


@pytest.mark.parametrize("text", ["c", "m*c", "e", "k", "R", "dB", "bit", "USD", "m_e", "N*k"])
def test_constants_decibels_and_money_are_no_units(text: str) -> None:
    with pytest.raises(UnitProblem, match="is not a known unit"):
        read_unit(text)


@pytest.mark.parametrize(("text", "advice"), [
    ("Grad", "Did you mean 'deg'?"), ("Min", "Did you mean 'min'?"), ("Mm", "Did you mean 'mm'?"),
    ("kN/Mm", "Did you mean 'kN/mm'?"), ("U/min", "Did you mean 'rpm'?"), ("Gs", ""), ("PS", ""), ("Mrad/s", ""),
    ("Mpsi", ""), ("barg", "Write 'bar':"), ("psig", "Write 'psi':"), ("kPa_abs", "Write 'kPa':")])
def test_units_that_the_library_would_misread(text: str, advice: str) -> None:
    with pytest.raises(UnitProblem) as caught:
        read_unit(text)
    assert caught.value.hint.startswith(advice)


@pytest.mark.parametrize(("text", "scale"), [("MN", 1e6), ("GPa", 1e9), ("MPa/s", 1e6), ("TJ", 1e12), ("Mg", 1e3),
                                             ("Mohm", 1e6), ("MHz", 1e6), ("mrad", 1e-3), ("uin", 2.54e-8), ("daN", 10.0)])
def test_prefixes_in_use(text: str, scale: float) -> None:
    assert read_unit(text).scale == pytest.approx(scale, rel=1e-14)  # a product of two doubles


@pytest.mark.parametrize("text", ["N m", "(N)", "N/", "/m", "N//m", "__import__", "N;m", "N\nm", "1/", "m**", "m**x", "^2"])
def test_refused_unit(text: str) -> None:
    with pytest.raises(UnitProblem):
        read_unit(text)


def test_hertz_and_radians_do_not_mix() -> None:
    hertz, radians = declared_unit("Hz"), declared_unit("rad/s")
    with pytest.raises(UnitProblem) as caught:
        check_unit(radians, hertz, 250.0, "250 rad/s")
    assert caught.value.code == "unit-cycles"
    assert "write '39.7887 Hz'" in caught.value.hint
    with pytest.raises(UnitProblem) as caught:
        check_unit(hertz, radians, 1.0, "1 Hz")
    assert "write '6.28319 rad/s'" in caught.value.hint
    with pytest.raises(UnitProblem, match="does not distinguish"):
        check_unit(read_unit("1/s"), hertz, 1.0, "1 1/s")
    with pytest.raises(UnitProblem) as caught:  # of a pump, whose data sheet leaves "per revolution" out
        check_unit(read_unit("cm**3"), declared_unit("m**3/rad"), 28e-6, "28 cm**3")
    assert caught.value.hint == "Write `cm**3/rev` for a value per revolution, `cm**3/rad` for one per radian."
    check_unit(read_unit("rpm"), radians, 1.0, "10 rpm")
    check_unit(read_unit("kHz"), hertz, 1e3, "1 kHz")


def test_what_needs_a_unit() -> None:
    newton, ratio = declared_unit("N"), declared_unit("1")
    check_unit(None, newton, 0.0, "0")
    check_unit(None, ratio, 3.0, "3")
    for text, value in (("5", 5.0), ("0e3", 0.0)):
        with pytest.raises(UnitProblem, match="has no unit"):
            check_unit(None, newton, value, text)
    with pytest.raises(UnitProblem, match="'25 kg' is in kg; N is needed"):
        check_unit(read_unit("kg"), newton, 25.0, "25 kg")
    with pytest.raises(UnitProblem, match="a number without unit is needed"):
        check_unit(newton, ratio, 3.0, "3 N")
    with pytest.raises(UnitProblem, match="has no unit"):
        check_unit(None, read_unit("degC"), 0.0, "0")  # with an offset a bare 0 is no zero


def test_declared_units_are_base_units() -> None:
    assert declared_unit("m**3/(s*Pa)").scale == 1
    with pytest.raises(UnitProblem) as caught:
        declared_unit("mm")
    assert caught.value.hint == "Write `unit: m`; values may be given in mm."
    with pytest.raises(UnitProblem):
        declared_unit("degC")


@pytest.mark.parametrize(("text", "low", "high", "nominal"), [
    ("30 .. 70 kN*s/m", 30e3, 70e3, None), ("1 mm .. 2 m", 1e-3, 2.0, None), ("42 kN/m +- 20 %", 33.6e3, 50.4e3, 42e3),
    ("42 +- 3 kN/m", 39e3, 45e3, 42e3), ("-10 .. 10 mm", -0.01, 0.01, None), ("20 degC +- 5 K", 288.15, 298.15, 293.15)])
def test_range(text: str, low: float, high: float, nominal: float | None) -> None:
    found = parse_range(text)
    assert (found.low, found.high, found.nominal) == pytest.approx((low, high, nominal))


@pytest.mark.parametrize(("text", "code"), [
    ("70 .. 30 N", "range-empty"), ("1 m .. 2 kg", "range-units"), ("5 N +- 0 N", "range-empty"), ("5 N", "not-a-range"),
    ("1 .. 1e999 N", "number-too-large"),
    ("1e-999 .. 1 N", "number-too-small"), ("1..2.. 3", "not-a-range"), ("1" * 300 + " .. 2", "not-a-range"),
    ("22 degC +- 20 %", "range-relative")])
def test_refused_range(text: str, code: str) -> None:
    with pytest.raises(UnitProblem) as caught:
        parse_range(text)
    assert caught.value.code == code
    assert caught.value.hint


def test_a_range_of_unknown_unit_is_suggested_with_a_place_for_the_unit() -> None:
    with pytest.raises(UnitProblem) as caught:
        parse_range("30")
    assert "`0 .. 30`, and after them the unit" in caught.value.hint and "kN*s/m" in caught.value.hint


def test_dimensions_are_written_as_an_engineer_would() -> None:
    assert [dimension_text(read_unit(t).dimension) for t in ("kN/mm", "L/min", "bar", "1", "mm/h", "kg/s**3")] == \
        ["N/m", "m**3/s", "Pa", "1", "m/s", "kg/s**3"]
    assert dimension_text(times(ONE, read_unit("m").dimension, Fraction(1, 2))) == "m**1/2"


def test_units_still_to_be_solved() -> None:
    rate = generic_unit("$U/s")
    assert is_generic(rate.dimension)
    assert solved(rate.dimension, {"$U": read_unit("m").dimension}) == read_unit("m/s").dimension
    assert not is_generic(generic_unit("N/m").dimension)
    for text in ("$U**x", "$U $V", "$", "$U.power", "$U**999", "$U/mm"):
        with pytest.raises(UnitProblem):
            generic_unit(text)


@given(st.sampled_from(COMMON), st.floats(-1e9, 1e9))
def test_there_and_back(text: str, value: float) -> None:
    unit = read_unit(text)
    assert unit.from_si(unit.to_si(value)) == pytest.approx(value, rel=1e-12, abs=1e-9)


@given(st.sampled_from(COMMON), st.sampled_from(COMMON))
def test_the_product_of_units_has_the_product_of_their_dimensions(a: str, b: str) -> None:
    if "/(" in a + b or "degC" in (a, b) or "%" in (a, b) or "1" in (a[0], b[0]):
        return
    product = read_unit(f"{a}*{b}")
    assert product.dimension == times(read_unit(a).dimension, read_unit(b).dimension)
    assert product.scale == pytest.approx(read_unit(a).scale * read_unit(b).scale)


@given(st.text(max_size=40) | st.text("0123456789.,eE+-*/^ ()[]mkgNsPaHz%°$_'\"", max_size=40))
def test_any_text_is_a_quantity_or_a_problem_of_units(text: str) -> None:
    for read in (parse_quantity, parse_range, read_unit, declared_unit, generic_unit):
        refused: UnitProblem | None = None
        try:
            found = read(text)
        except UnitProblem as problem:
            refused = problem
        else:
            assert read is not parse_quantity or isfinite(found[0])
        assert refused is None or (refused.code and refused.message and refused.hint)


def test_dimensionless() -> None:
    assert read_unit("1") == DIMENSIONLESS
    assert DIMENSIONLESS.to_si(inf) == inf


def test_a_bracket_inside_a_unit_is_written_without_it() -> None:
    with pytest.raises(hb.ModelError) as caught:
        hb.simulate(hb.loads("model: a\ncomponents: {r: {is: ThermalResistance, R: 1 MW/(m**3/s)/K}}\n"
                             "nodes: {x: [r.a], y: [r.b]}\nsimulate: {until: 1 s}\n"))
    assert caught.value.problems[0].hint == "Write '1 MW/m**3*s/K'."
