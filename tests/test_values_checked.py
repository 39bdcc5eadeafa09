"""A value outside its declared range is refused wherever it enters a model: runs, linear analysis, audits, tuning, fits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb

OSCILLATOR = """model: oscillator
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 100 N/m}
  damper: {is: Damper, d: 2 N*s/m}
  body:   {is: Mass, m: 1 kg}
nodes: {wall: [wall.a, spring.a, damper.a], body: [spring.b, damper.b, body.a]}
initial: {body.x: 0.1 m, body.v: 0 m/s}
show: {x: {is: body.x, unit: m}}
simulate: {until: 1 s}
"""
LOOP = """model: loop
components:
  set:   {is: Constant, k: 1 V}
  pid:   {is: PID, K_p: 2, K_i: 1 1/s, y_min: -1 V, y_max: 1 V}
  plant: {is: FirstOrderLag, T_1: 1 s}
nodes: {set: [set.y, pid.r], command: [pid.y, plant.u], value: [plant.y, pid.u]}
initial: {value: 0 V}
simulate: {until: 1 s}
"""
FORMULA = OSCILLATOR.replace("components:", "parameters: {k: 100 N/m}\ncomponents:").replace("c: 100 N/m", "c: =k - 50 N/m")


def tuned(model: hb.Model, free: dict[str, str]) -> object:
    from heavebond.core.quantities import ranges

    return hb.tune(model, hb.TuningProblem(ranges(free), "rms(body.x)"), explore=0)


ENTRIES: dict[str, Callable[[hb.Model, dict[str, float]], object]] = {
    "simulate": lambda m, v: hb.simulate(m, parameters=v),
    "Simulator": lambda m, v: hb.Simulator(hb.assemble(m)).run(v),
    "Assembly": lambda m, v: hb.assemble(m).with_parameters(v),
    "audit": lambda m, v: hb.energy(m, parameters=v),
    "state_space": lambda m, v: hb.state_space(m, ["body.f"], ["body.x"], parameters=v),
}


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize(("name", "value"), [("spring.c", -5.0), ("body.m", -1.0), ("damper.d", np.nan)])
def test_a_value_below_its_minimum_is_refused_at_every_entry(entry: str, name: str, value: float) -> None:
    with pytest.raises(hb.HeavebondError) as error:
        ENTRIES[entry](hb.loads(OSCILLATOR), {name: value})
    problem = error.value.problems[0]
    assert problem.code == ("parameter-bound" if np.isfinite(value) else "value-not-finite")
    assert name in problem.message


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("value", [True, np.True_, [100.0]])
def test_a_truth_value_or_a_list_is_no_number_at_every_entry(entry: str, value: object) -> None:
    with pytest.raises(hb.HeavebondError, match=r"spring\.c: a .* is not one value"):
        ENTRIES[entry](hb.loads(OSCILLATOR), {"spring.c": value})  # type: ignore[dict-item]


@pytest.mark.parametrize("entry", ["simulate", "Simulator", "Assembly", "audit"])
def test_limits_in_the_wrong_order_are_refused_at_every_entry(entry: str) -> None:
    with pytest.raises(hb.HeavebondError, match="requires y_max > y_min"):
        ENTRIES[entry](hb.loads(LOOP), {"pid.y_min": 2.0})


def test_a_parameter_that_follows_from_another_by_a_formula_is_checked_too() -> None:
    model = hb.loads(FORMULA)
    assert hb.simulate(model, parameters={"k": 60.0})["body.x"].size
    with pytest.raises(hb.HeavebondError, match=r"spring\.c"):
        hb.simulate(model, parameters={"k": 40.0})


def test_a_range_that_reaches_beyond_what_is_allowed_is_refused() -> None:
    with pytest.raises(hb.HeavebondError, match=r"damper\.d"):
        tuned(hb.loads(OSCILLATOR), {"damper.d": "-1 .. 10 N*s/m"})
    with pytest.raises(hb.HeavebondError, match=r"spring\.c"):
        hb.root_locus(hb.loads(OSCILLATOR), "spring.c", "-10 .. 10 N/m")


def test_a_free_range_of_a_fit_that_reaches_beyond_what_is_allowed_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(OSCILLATOR)
    t = np.linspace(0, 1, 21)
    np.savetxt(tmp_path / "r.csv", np.column_stack([t, 0.1 * np.cos(10 * t)]), delimiter=",", header="t,x", comments="")
    (tmp_path / "e.yaml").write_text(
        "experiment: e\nmodel: m.yaml\nrecords: {r: {file: r.csv, use: fit}}\ntime: {column: t, unit: s}\n"
        "outputs: {body.x: {column: x, unit: m, noise: 1 mm}}\nfree: {spring.c: -50 .. 200 N/m}\n")
    with pytest.raises(hb.HeavebondError, match=r"spring\.c") as error:
        hb.fit(tmp_path / "e.yaml")
    place = error.value.problems[0].place
    assert place is not None and place.line == 6


def test_allowed_values_are_used_at_every_entry() -> None:
    """Stiffness 25 N/m: frequency sqrt(25 - 1) rad/s by the closed form."""
    model, value = hb.loads(OSCILLATOR), {"spring.c": 25.0}
    w = np.sqrt(24.0)
    found = hb.simulate(model, parameters=value)
    expected = 0.1 * np.exp(-found.time) * (np.cos(w * found.time) + np.sin(w * found.time) / w)
    # the tolerances of a run are 1e-8 of 1 m at most
    assert found["body.x"] == pytest.approx(expected, abs=1e-7)
    poles = hb.state_space(model, ["body.f"], ["body.x"], parameters=value).poles
    assert sorted(np.abs(poles.imag)) == pytest.approx([w, w], rel=1e-9)


DESCRIPTION = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="heater" guid="1">
  <CoSimulation modelIdentifier="heater"/>
  <UnitDefinitions><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit></UnitDefinitions>
  <TypeDefinitions><SimpleType name="Difference"><Real unit="degC" relativeQuantity="true"/></SimpleType></TypeDefinitions>
  <ModelVariables>
    <ScalarVariable name="T" valueReference="1" causality="parameter" variability="fixed">
      <Real unit="degC" start="20" min="-20" max="90"/></ScalarVariable>
    <ScalarVariable name="band" valueReference="2" causality="parameter" variability="fixed">
      <Real declaredType="Difference" start="2"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="3" causality="output"><Real/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="3"/></Outputs></ModelStructure>
</fmiModelDescription>
"""


def test_bounds_and_relative_quantities_of_an_fmu_are_kept(tmp_path: Path) -> None:
    """T may be -20 to 90 degC; a band of 2 degC with `relativeQuantity` is 2 K."""
    import zipfile

    with zipfile.ZipFile(tmp_path / "heater.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
    model = hb.loads("model: m\ncomponents: {h: {is: heater.fmu, step: 1 s}}\nnodes: {y: [h.y]}\n", tmp_path)
    parameters = model.library.component("heater.fmu").parameters
    assert (parameters["T"].low, parameters["T"].high) == pytest.approx((253.15, 363.15))
    assert parameters["band"].low is None
    values = hb.assemble(model).parameter_values
    assert (values["h.T"], values["h.band"]) == pytest.approx((293.15, 2.0))
    for given in (100.0 + 273.15, "100 degC"):
        with pytest.raises(hb.HeavebondError, match=r"h\.T"):
            hb.assemble(model).with_parameters({"h.T": given})


def test_a_study_tells_which_case_has_a_value_that_is_not_allowed(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(OSCILLATOR)
    (tmp_path / "s.yaml").write_text("study: s\nmodel: m.yaml\nmeasure: {x: rms(body.x)}\n"
                                     "cases: {damper.d: [-1 N*s/m, 2 N*s/m]}\n")
    with pytest.raises(hb.HeavebondError, match=r"damper\.d"):
        hb.study(hb.load_study(tmp_path / "s.yaml"))


@pytest.mark.parametrize("call", [
    lambda m: hb.simulate(m, rtol=-1.0), lambda m: hb.simulate(m, rtol=float("nan")), lambda m: hb.simulate(m, atol=0.0),
    lambda m: hb.simulate(m, float("nan")), lambda m: hb.simulate(m, float("inf")),
    lambda m: hb.simulate(m, every=float("nan")), lambda m: hb.simulate(m, parameters={"s.c": float("nan")}),
    lambda m: hb.sensitivity(m, ["m.x"], parameters={"s.c": -3.0}),
    lambda m: hb.sweep(m, {"s.c": "-5 .. 5 N/m; 3"}, ["final(m.x)"]), lambda m: hb.root_locus(m, "s.c", "-3 .. 3 N/m"),
], ids=["rtol", "rtol nan", "atol", "until nan", "until inf", "every nan", "value nan", "sensitivity", "sweep", "locus"])
def test_tolerances_times_and_values_that_are_none_are_refused(call: Callable[[hb.Model], object]) -> None:
    model = hb.loads("""
model: swing
components:
  m: {is: Mass, m: 1 kg}
  s: {is: Spring, c: 10 N/m}
  w: {is: Fixed}
nodes: {m: [m.a, s.a], w: [w.a, s.b]}
initial: {m.x: 0.1 m, m.v: 0 m/s}
simulate: {until: 3 s, every: 10 ms}
""")
    with pytest.raises((hb.UsageError, hb.ModelError)) as caught:
        call(model)
    assert caught.value.problems[0].hint
