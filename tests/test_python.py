"""At home in Python: public names, what an object says of itself, types."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

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
                  hb.load_study("cmc_ahc/studies/table3"), hb.audit(assembly),
                  hb.state_space(model, ["road.u"], ["body.x"])):
        lines = repr(thing).splitlines()
        assert len(lines) <= LINES and max(map(len, lines)) <= WIDTH, repr(thing)[:2000]
        assert type(thing).__name__ in lines[0]
    assert repr(run).startswith("<Result 'quarter_car': 0 to 4 s, 2001 points")


def test_the_package_says_that_it_has_types() -> None:
    assert (Path(hb.__file__).parent / "py.typed").exists()


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
        with pytest.raises(hb.UsageError, match="signal-unit") as caught:
            one["error"]
        assert 'r.si["error"]' in str(caught.value) and 'r.display["error"]' in str(caught.value)
        assert one.si["error"][0] == pytest.approx(0.02) and one.si.unit("error") == "m"
        assert one.display["error"][0] == pytest.approx(20.0) and one.display.unit("error") == one.unit("error") == "mm"
        assert (one["place"] == one.si["place"]).all() and (one["cart.x"] == one.display["cart.x"]).all()
        assert "error" in one.si and "nowhere" not in one.display and len(one.si) == len(one.names())
    assert (run.si["error"] == run["cart.x"]).all()


def test_tables_carry_units(monkeypatch: pytest.MonkeyPatch) -> None:
    run = hb.simulate(hb.loads(TRAP))
    table = run.to_pandas(["error", "cart.v"])
    assert table.attrs["units"] == {"error [mm]": "mm", "cart.v [m/s]": "m/s"} and list(table) == list(table.attrs["units"])
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(hb.UsageError, match="pip install xarray"):
        run.to_xarray()


def test_a_dataset_carries_units() -> None:
    pytest.importorskip("xarray")
    data = hb.simulate(hb.loads(TRAP)).to_xarray(["error"])
    assert data["error"].attrs["units"] == "mm" and data["time"].attrs["units"] == "s" and data["error"].dims == ("time",)
