"""At home in Python: public names, what an object says of itself, types."""

from __future__ import annotations

import copy
import inspect
import pickle
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from diagrams import CART

import heavebond as hb

LINES, WIDTH = 24, 160  # of a screen


def test_no_public_name_is_that_of_a_module() -> None:
    """Importing the module would put it in the place of the function."""
    modules = {path.stem for path in Path(hb.__file__).parent.glob("*.py")} | {
        path.parent.name for path in Path(hb.__file__).parent.glob("*/__init__.py")}
    assert not modules & set(hb.__all__)


def test_the_public_names_are_listed() -> None:
    assert dir(hb) == sorted([*hb.__all__, "__version__"])
    assert all(getattr(hb, name) is not None for name in hb.__all__)


@pytest.mark.parametrize(("name", "meant"), [("run", "simulate"), ("optimize", "tune"), ("simulat", "simulate"),
                                             ("identify", "fit")])
def test_a_name_that_is_not_there_leads_to_the_one_that_is_meant(name: str, meant: str) -> None:
    with pytest.raises(AttributeError, match=f"did you mean '{meant}'"):
        getattr(hb, name)


def test_objects_say_of_themselves_what_fits_on_a_screen(tmp_path: Path) -> None:
    model = hb.load("quarter_car")
    assembly, run = hb.assemble(model), hb.simulate(model)
    run.save(tmp_path / "run.csv")
    comparison = hb.compare("passive_rig/friction")
    for thing in (model, assembly, run, hb.read_run(tmp_path / "run.csv"), comparison, comparison.experiment,
                  hb.load_study("cmc_ahc/studies/table3"), hb.energy(assembly),
                  hb.state_space(model, ["road.u"], ["body.x"])):
        lines = repr(thing).splitlines()
        assert len(lines) <= LINES and max(map(len, lines)) <= WIDTH, repr(thing)[:2000]
        assert type(thing).__name__ in lines[0]
    assert repr(run).startswith("<Result 'quarter_car': 0 to 4 s, 2001 points")


def test_the_package_says_that_it_has_types() -> None:
    assert (Path(hb.__file__).parent / "py.typed").exists()


def test_a_diagram_may_be_given_by_its_file_or_bundled_name(tmp_path: Path) -> None:
    model = hb.load("passive_rig")
    assert hb.state_space("passive_rig", ["platform.f"], ["crown.x"]).a.tolist() == \
        hb.state_space(model, ["platform.f"], ["crown.x"]).a.tolist()
    assert hb.draw(str(model.path)) == hb.draw(model)
    for call in (hb.assemble, hb.simulate, hb.energy, hb.simplify):
        with pytest.raises(hb.UsageError) as refused:
            call(tmp_path / "none.yaml")
        assert refused.value.problems[0].code == "file-missing"


def test_signals_in_si_and_in_the_units_of_the_diagram() -> None:
    model = hb.loads("""
model: slider
components: {wall: {is: Fixed}, spring: {is: Spring, c: 1.2 kN/m}, cart: {is: Mass, m: 2.5 kg}}
nodes: {ground: [wall.a, spring.a], load: [spring.b, cart.a]}
initial: {load.x: 50 mm}
show: {place: {is: load.x, unit: mm}, warmth: {is: "20 degC + 1 K/m*load.x", unit: degC}}
simulate: {until: 1 s, every: 0.1 s}
""")
    result = hb.simulate(model)
    assert result.si["place"] == pytest.approx(result["load.x"], abs=0) and result.si.unit("place") == "m"
    assert result.display["place"] == pytest.approx(1000 * result["load.x"], rel=1e-14)
    assert (result.display.unit("place"), result.display.unit("load.x"), result.si.unit("load.x")) == ("mm", "m", "m")
    assert result.si["load.x"] == pytest.approx(result["load.x"], abs=0)
    assert result.si["warmth"] == pytest.approx(result.display["warmth"] + 273.15)
    with pytest.raises(hb.UsageError):
        result.si["plaice"]


TRAP = """
model: trap
components:
  spring: {is: Spring, c: 1 kN/m}
  cart:   {is: Mass, m: 10 kg}
  wall:   {is: Fixed}
nodes:
  wall: [wall.a, spring.a]
  cart: [cart.a, spring.b]
initial: {cart.x: 20 mm, cart.v: 0 m/s}
show:
  error: {is: cart.x, unit: mm}
  place: {is: cart.x, unit: m}
simulate: {until: 1 s, every: 0.1 s}
"""


def test_an_output_in_millimetres_is_not_taken_for_metres(tmp_path: Path) -> None:
    run = hb.simulate(hb.loads(TRAP))
    run.save(tmp_path / "run.csv")
    for one in (run, hb.read_run(tmp_path / "run.csv")):
        signal = one["error"]
        assert (signal.unit, signal.name) == ("mm", "error") and (signal.time == one.time).all()
        for wrong in (lambda s: s - 0.02, lambda s: s > 0.02, lambda s: 2 * s, np.sin, lambda s: np.maximum(s, 1.0),
                      lambda s: s + np.ones(len(s)), lambda s: s[0] - 0.02, lambda s: s.max() * 2):
            with pytest.raises(hb.UsageError, match="signal-unit") as caught:
                wrong(signal)
            assert 'r.si["error"]' in str(caught.value) and 'r.display["error"]' in str(caught.value)
        assert one.si["error"][0] == pytest.approx(0.02) and one.si.unit("error") == "m"
        assert one.display["error"][0] == pytest.approx(20.0) and one.display.unit("error") == one.unit("error") == "mm"
        assert (one["place"] == one.si["place"]).all() and (one["cart.x"] == one.display["cart.x"]).all()
        assert "error" in one and "nowhere" not in one.display and len(one.si) == len(one.names()) == len(list(one))
        assert one._ipython_key_completions_() == one.si._ipython_key_completions_() == one.names()
    assert (run.si["error"] == run["cart.x"]).all()


def test_arithmetic_with_units() -> None:
    run = hb.simulate(hb.loads(TRAP))
    error, x, v, force = run["error"], run["cart.x"], run["cart.v"], run["spring.F"]
    assert (error - x).unit == "mm" and np.abs((error - x).magnitude).max() < 1e-9
    assert (x - error).unit == "m" and (x - error).time is not None and (x + 1.0).unit == "m"
    assert (force * v).unit == "W" and (force * error).unit == "N*m" and (v**2).unit == "J/kg"
    assert (force * error).magnitude == pytest.approx((force * x).magnitude)
    assert np.sqrt(v**2).unit == "m/s" and (error / x).unit == "1" and (error / "20 mm")[0] == pytest.approx(1.0)
    assert (error - "20 mm")[0].magnitude == 0 and ("0.02 m" - error)[0].magnitude == pytest.approx(0, abs=1e-12)
    assert ("30 N/m" * x).unit == "N" and (error > "1 cm").tolist() == (x > 0.01).tolist()
    assert isinstance(1000 * x, np.ndarray) and isinstance(np.sin(x), np.ndarray)  # the number may have a unit
    assert (-error).unit == abs(error).unit == np.maximum(error, x).unit == "mm" and (error - 0).unit == "mm"
    with pytest.raises(hb.UsageError, match="unit-wrong"):
        force + x
    with pytest.raises(hb.UsageError, match="unit-wrong"):
        error - "3 N"
    with pytest.raises(hb.UsageError, match="unit-wrong"):
        error.to("N")
    assert error.to("m").magnitude == pytest.approx(x.magnitude) and error.si.unit == "m" and x.si is x


def test_values_of_a_signal() -> None:
    run = hb.simulate(hb.loads(TRAP))
    error, x = run["error"], run["cart.x"]
    assert str(error.max()) == f"{error.magnitude.max()} mm" and f"{error.max():.1f}" == "20.0"
    assert isinstance(x.max(), float)
    assert error.std().unit == error.mean().unit == error.rms().unit == np.max(error).unit == np.mean(error).unit == "mm"
    late = error.between("0.5 s", "1 s")
    assert late.time is not None and late.time.tolist() == pytest.approx([0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    assert error.at("50 ms").magnitude == pytest.approx(error.magnitude[:2].mean())
    assert error[2:4].time.tolist() == pytest.approx([0.2, 0.3])
    for wrong in (lambda: error.between("2 s", "3 s"), lambda: error.at("-1 s"), lambda: error.max().between(0, 1)):
        with pytest.raises(hb.UsageError):
            wrong()
    assert pickle.loads(pickle.dumps(error)).unit == "mm" and copy.deepcopy(error).name == "error"
    assert repr(error).startswith("<Signal 'error' in mm: 11 values from 0 to 1 s, -19.8 to 20>")


def test_values_of_a_signal_are_set() -> None:
    run = hb.simulate(hb.loads(TRAP))
    error, x = run["error"], run["cart.x"]
    x[0], error[0], error[1:3] = 0.5, "3 cm", x[0:2]
    assert x.magnitude[0] == 0.5 and error.magnitude[:3].tolist() == pytest.approx([30.0, 500.0, 1000 * x.magnitude[1]])
    with pytest.raises(hb.UsageError, match="signal-unit"):
        error[0] = 0.5
    assert run["cart.x"].magnitude[0] == pytest.approx(0.02)  # the run is as it was
    assert str(round(error.max(), 1)) == "500.0 mm" and int(error[0]) == 30 and [float(v) for v in error[:1]] == [30.0]


def test_temperatures_are_differences_in_kelvin() -> None:
    warm = hb.Signal([20.0, 30.0], "degC", "warm")
    assert (warm - hb.Signal([10.0, 10.0], "degC")).unit == "K" and (warm - "15 degC").tolist() == pytest.approx([5, 15])
    assert warm.max().unit == "degC" and isinstance(warm.std(), float) and (warm > "25 degC").tolist() == [False, True]
    assert warm.si.tolist() == pytest.approx([293.15, 303.15])
    with pytest.raises(hb.UsageError, match="signal-unit"):
        warm.rms()


def test_other_packages_understand_a_signal(tmp_path: Path) -> None:
    import matplotlib.pyplot as plt
    import pandas as pd
    import pint
    import xarray as xr
    from matplotlib import units

    from heavebond.records.signal_array import _register_units

    run = hb.simulate(hb.loads(TRAP))
    error, x = run["error"], run["cart.x"]
    series = error.to_series()
    assert series.index.name == "time [s]" and series.name == "error [mm]" and series.attrs["units"] == "mm"
    assert pd.Series(error).std() == pytest.approx(series.std()) and pd.DataFrame({"e": error}).shape == (11, 1)
    data = error.to_xarray()
    assert data.attrs["units"] == "mm" and data.sel(time=0.5).item() == pytest.approx(error.at(0.5).magnitude)
    assert isinstance(xr.DataArray(error, dims="time").data, np.ndarray)
    metres = error.to_pint().to("m").magnitude
    assert metres == pytest.approx(x.magnitude)
    registry = pint.get_application_registry()
    assert (error - registry.Quantity(0.02, "m"))[0].magnitude == pytest.approx(0, abs=1e-9)
    units.registry.pop(hb.Signal, None)
    _register_units.cache_clear()  # as if matplotlib had been imported after the run
    figure, axes = plt.subplots()
    axes.plot(run.time, error)
    axes.plot(run.time, hb.Signal(x.to("cm").magnitude, "cm"))  # in centimetres, on an axis of millimetres
    with pytest.raises(hb.UsageError, match="axis-unit"):
        axes.plot(run.time, run["cart.x"])
    axes.fill_between(run.time, run["error"], 0)
    figure.savefig(tmp_path / "a.png")
    assert axes.get_ylabel() == "[mm]" and axes.lines[1].get_ydata(orig=False) == pytest.approx(error.magnitude)
    plt.close(figure)
    assert error.plot().axes[0].get_ylabel().endswith("[mm]") or "mm" in error.plot().axes[0].get_ylabel()


def test_tables_carry_units(monkeypatch: pytest.MonkeyPatch) -> None:
    run = hb.simulate(hb.loads(TRAP))
    table = run.to_pandas(["error", "cart.v"])
    assert table.attrs["units"] == {"error [mm]": "mm", "cart.v [m/s]": "m/s"} and list(table) == list(table.attrs["units"])
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(hb.UsageError, match=r"pip install .heavebond.xarray"):
        run.to_xarray()


def test_a_dataset_carries_units() -> None:
    data = hb.simulate(hb.loads(TRAP)).to_xarray(["error"])
    assert data["error"].attrs["units"] == "mm" and data["time"].attrs["units"] == "s" and data["error"].dims == ("time",)


@pytest.mark.parametrize(("call", "code", "named"), [
    (lambda m: hb.simulate(m, "20 kg"), "unit-wrong", "until"),
    (lambda m: hb.simulate(m, every="10"), "unit-missing", "every"),
    (lambda m: hb.simulate(m, parameters={"cart.m": "300 N"}), "unit-wrong", "cart.m"),
    (lambda m: m.with_parameters({"cart.m": "300kg"}), "quantity-no-space", "cart.m"),
    (lambda m: hb.simulate(m.with_parameters({"cart.m": "3 s"})), "unit-wrong", "'3 s'"),
    (lambda m: hb.simulate(m, parameters={"cart.m": "heavy"}), "not-a-quantity", "cart.m"),
    (lambda m: hb.Simulator(hb.assemble(m)).run({"cart.m": "3 mm"}), "unit-wrong", "cart.m"),
    (lambda m: hb.energy(m, "3 mm"), "unit-wrong", "until"),
    (lambda m: hb.simplify(m, "3 mm"), "unit-wrong", "share"),
    (lambda m: hb.simplify(m, 0.99, limit="much"), "not-a-quantity", "limit"),
    (lambda m: hb.root_locus(m, "damper.d", "1 .. 20 N"), "unit-wrong", "damper.d"),
    (lambda m: hb.root_locus(m, "damper.d", "many"), "not-a-range", "damper.d"),
    (lambda m: hb.state_space(m, ["wall.u"], ["load.x"], at="3 mm"), "unit-wrong", "at"),
    (lambda m: hb.tuning_task({"damper.d": "1 N*s/m"}, "rms(load.x)/1 m"), "not-a-range", "damper.d"),
    (lambda m: hb.tuning_task({"damper.d": "1 .. 2 N*s/m"}, "rms(load.x)/1 m", begin="1 m"), "unit-wrong", "begin"),
    (lambda m: hb.tune(m, hb.tuning_task({"damper.d": "1 .. 2 N"}, "rms(load.x)/1 m")), "unit-wrong", "damper.d"),
    (lambda m: hb.compare("passive_rig/friction", parameters={"gas.c": "3 N"}), "unit-wrong", "gas.c"),
    (lambda m: hb.fit("passive_rig/friction", free={"gas.c": "30 kN/m"}), "not-a-range", "gas.c"),
    (lambda m: hb.fit("passive_rig/friction", free={"gas.c": "30 .. 70 kN"}), "unit-wrong", "gas.c"),
    (lambda m: hb.fit("passive_rig/friction", free={"gas.k": "30 .. 70 kN"}), "free-unknown", "gas.k"),
    (lambda m: hb.localize("passive_rig/friction", values={"gas.c": "3 kN"}), "unit-wrong", "gas.c"),
    (lambda m: hb.diagnose("passive_rig/friction", seconds="3 m"), "unit-wrong", "seconds"),
])
def test_a_quantity_that_does_not_fit_is_named(call: Callable[[hb.Model], object], code: str, named: str) -> None:
    with pytest.raises(hb.HeavebondError, match=re.escape(code)) as caught:
        call(hb.loads(CART))
    assert named in str(caught.value)


def test_text_and_numbers_of_any_type_give_the_same_numbers() -> None:
    model = hb.loads(CART)
    plain = hb.simulate(model, 2.0, every=0.1, parameters={"cart.m": 300.0})
    for other in (hb.simulate(model, "2 s", every="100 ms", parameters={"cart.m": "300 kg"}),
                  hb.simulate(model, np.int64(2), every=np.float32(0.1), parameters={"cart.m": np.int64(300)}),
                  hb.simulate(model.with_parameters({"cart.m": "0.3 t"}), "2000 ms", every="0.1 s"),
                  hb.simulate(model.with_parameters({"cart.m": np.float32(300)}), 2, every="0.1 s")):
        assert other["load.x"] == pytest.approx(plain["load.x"], rel=1e-6, abs=1e-9)
    task = hb.tuning_task({"damper.d": "10 .. 200 N*s/m"}, "rms(load.x)/1 mm", begin="0.2 s", end="1000 ms")
    assert task.free["damper.d"].high == 200 and (task.begin, task.end) == (0.2, 1.0)
    tuned = hb.tune(model, task, explore=0)
    assert 10 <= tuned.values["damper.d"] <= 200 and tuned.cost < tuned.before
    assert hb.root_locus(model, "damper.d", "1 .. 20 N*s/m", points=3).values.tolist() == [1, 10.5, 20]


def test_a_fit_frees_what_is_given_as_text() -> None:
    found = hb.fit("passive_rig/friction", free={"gas.c": "30 .. 70 kN/m"})
    assert list(found.values) == ["gas.c"] and 30e3 <= found.values["gas.c"] <= 70e3


@pytest.mark.parametrize("name", [n for n in hb.__all__ if not isinstance(getattr(hb, n), type)])
def test_the_docstring_of_a_function_names_its_parameters_and_errors(name: str) -> None:
    function = getattr(hb, name)
    text = inspect.getdoc(function) or ""
    assert text.partition("\n")[0].endswith((".", "`)."))
    missing = [p for p in inspect.signature(function).parameters if not re.search(rf"\b{p}\b", text)]
    excused = {"experiment", "model", "free", "highlight", "colour", "name"}
    assert not set(missing) - excused and re.search("[Rr]aises", text), missing
