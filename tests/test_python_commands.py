"""Every command has its function in Python, with the same results."""

from __future__ import annotations

import json
import pickle
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import NAMES, main

PAGE = Path(__file__).parent.parent / "docs" / "python.md"
CART = """
model: cart
summary: A cart on a spring.
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 20 N*s/m}
  cart:   {is: Mass, m: 10 kg}
  push:   {is: ForceSource, u: "=10 N*sin(3 rad/s*time)"}
nodes: {wall: [wall.a, spring.a, damper.a], load: [spring.b, damper.b, cart.a, push.a]}
initial: {load.x: 20 mm, load.v: 0 m/s}
show: {place: {is: load.x, unit: mm}, speed: {is: load.v, unit: m/s}}
view: {body: {is: box, at: [load.x, 0.5 m], size: [0.2 m, 0.1 m]}}
simulate: {until: 4 s, every: 10 ms}
"""


@pytest.fixture
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "cart.yaml"
    path.write_text(CART, encoding="utf-8")
    return path


def told(*words: str) -> dict[str, object]:
    """The JSON of a command, without what only the command line has."""
    run = CliRunner().invoke(main, [*words, "--json", "told.json"])
    assert run.exit_code == 0, run.output
    figures = json.loads(Path("told.json").read_text(encoding="utf-8"))
    return {key: value for key, value in figures.items() if key not in ("command", "ok", "problems", "validity")
            and (key, value) != ("files", [])}  # written pictures


def as_json(figures: object) -> object:
    """As JSON has it: without NaN, tuples as lists."""
    text = json.dumps(figures, default=lambda value: value.item() if hasattr(value, "item") else str(value))
    return json.loads(re.sub(r"\b(NaN|-?Infinity)\b", "null", text))


def test_the_page_has_every_command() -> None:
    table = PAGE.read_text(encoding="utf-8").split("## Commands and functions")[1]
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", table, re.MULTILINE))
    assert sorted(rows) == sorted(NAMES)
    for command, functions in rows.items():
        named = re.findall(r"`([A-Za-z_]\w*)[`(]", functions)
        assert named or "command only" in functions, command
        assert set(named) <= set(hb.__all__), named
    others = {"run", "plot", "design", "try", "laws", "linear", "import", "demo", "studio"}
    assert set(NAMES) - others <= set(hb.__all__)


@pytest.mark.parametrize(("words", "call"), [
    (("check", "cart.yaml"), lambda: hb.check("cart.yaml")),
    (("check", "cart.yaml", "--set", "cart.m=20 kg"), lambda: hb.check("cart.yaml", parameters={"cart.m": "20 kg"})),
    (("modes", "cart.yaml"), lambda: hb.modes("cart.yaml")),
    (("modes", "cart.yaml", "--at", "1 s"), lambda: hb.modes("cart.yaml", at="1 s")),
    (("sensitivity", "cart.yaml", "--of", "place"), lambda: hb.sensitivity("cart.yaml", "place")),
    (("library", "Spring"), lambda: hb.library("Spring")),
    (("library", "check", "valve"), lambda: hb.library("check valve")),
    (("library", "stop_force"), lambda: hb.library("stop_force")),
])
def test_the_function_gives_what_the_command_writes(words: tuple[str, ...], call: Callable[[], hb.Modes], cart: Path
                                                    ) -> None:
    result = call()
    assert as_json(result.as_dict()) == told(*words)
    assert type(result).__name__ in repr(result) and len(repr(result).splitlines()) <= 24


def test_energy_and_signal_are_those_of_the_commands(cart: Path) -> None:
    audit = hb.energy("cart.yaml")
    figures = told("energy", "cart.yaml")
    assert audit.supplied == pytest.approx(figures["supplied"]) and audit.dissipated == pytest.approx(figures["dissipated"])
    run = hb.simulate("cart.yaml")
    one = hb.signal(run, "place", begin="1 s")
    same = told("signal", "cart.yaml", "--signal", "place", "--from", "1 s")["signals"]["place"]
    assert as_json(one.as_dict()) == same
    assert as_json(hb.signal(run["place"], begin=1).as_dict()) == same
    run.save("run.csv")
    assert hb.signal("run.csv", "place", begin="1 s").mean == pytest.approx(one.mean)
    assert hb.signal(hb.read_run("run.csv"), "place", begin="1 s").cycles.number == one.cycles.number
    with pytest.raises(hb.UsageError, match="time-missing"):
        hb.signal(hb.Signal([1.0, 2.0], "m", "x"))
    with pytest.raises(hb.UsageError, match="signal-source"):
        hb.signal(hb.Diagram("rig"), "place")  # type: ignore[arg-type]
    with pytest.raises(hb.UsageError, match="unit-wrong"):
        hb.signal(run, "place", begin="1 m")


def test_a_sweep_is_a_dataset(cart: Path) -> None:
    swept = hb.sweep(hb.load("cart.yaml"), {"damper.d": "20 .. 60 N*s/m; 3", "cart.m": [5, "10 kg"]},
                     ["rms(load.x) in mm", "rms(load.v)"], signals=["place"], processes=1)
    data = swept.to_xarray()
    assert dict(data.sizes) == {"damper.d": 3, "cart.m": 2, "time": 401}
    assert data["damper.d"].values.tolist() == [20, 40, 60] and data["cart.m"].attrs["units"] == "kg"
    assert data["rms(load.x)"].attrs["units"] == "mm" and data["place"].attrs["units"] == "mm"
    one = hb.simulate("cart.yaml", parameters={"damper.d": 40, "cart.m": 5})
    there = data.sel({"damper.d": 40, "cart.m": 5})
    assert there["rms(load.x)"].item() == pytest.approx(one["load.x"].to("mm").rms().magnitude, rel=0.01)
    assert there["place"].values == pytest.approx(one.display["place"], rel=1e-4, abs=1e-4)
    assert swept.to_pandas().shape[0] == 6 and "damper.d" in str(list(swept.to_pandas()))
    figures = told("sweep", "cart.yaml", "--over", "damper.d=20 .. 60 N*s/m; 3", "--over", "cart.m=5 kg, 10 kg", "--measure",
                   "peak(load.x) in mm", "--processes", "1")
    assert len(figures["cases"]) == 6


def test_a_sample_is_a_dataset(cart: Path) -> None:
    data = hb.sweep("cart.yaml", {"damper.d": "20 .. 60 N*s/m", "cart.m": "10 kg +- 20 %"}, "rms(load.x) in mm",
                    sample="sobol:4", processes=1).to_xarray()
    assert dict(data.sizes) == {"sample": 4} and data["cart.m"].dims == ("sample",) and data["cart.m"].attrs["units"] == "kg"
    assert ((data["damper.d"] >= 20) & (data["damper.d"] <= 60)).all() and data["rms(load.x)"].notnull().all()


@pytest.mark.parametrize(("over", "more", "code", "hint"), [
    ({"damper.d": "20 .. 60 N*s/m"}, {}, "over-open", 'over={"damper.d"'),
    ({"damper.d": ["20 N*s/m"]}, {"sample": "sobol:4"}, "sample-nothing", "over="),
    ({"damper.d": "20 .. 60 N*s/m"}, {"sample": "sobl:4"}, "sample-unknown", "sobol"),
    ({"damper.d": ""}, {}, "over-form", "over="),
    ({"dampr.d": ["20 N*s/m"]}, {}, "setting-unknown", "damper.d"),
])
def test_a_wrong_sweep_names_the_argument(over: dict[str, str], more: dict[str, str], code: str, hint: str, cart: Path
                                          ) -> None:
    with pytest.raises(hb.HeavebondError, match=code) as caught:
        hb.sweep("cart.yaml", over, "rms(load.x)", processes=1, **more)
    place = caught.value.problems[0].place
    assert place is None or place.file.endswith("test_python_commands.py")
    assert hint in str(caught.value) and "--over" not in str(caught.value) and "--sample" not in str(caught.value)


def test_linear_results_are_drawn_and_short(cart: Path) -> None:
    system = hb.state_space("cart.yaml", ["push.u"], ["load.x"])
    locus = hb.root_locus("cart.yaml", "damper.d", "1 .. 200 N*s/m", points=5)
    for figure in (system.plot(), system.plot("nyquist"), system.plot("poles"), locus.plot()):
        assert (figure.axes and figure.axes[0].lines) or figure.axes[0].collections
    with pytest.raises(hb.UsageError, match="picture-unknown"):
        system.plot("bod")
    assert locus._repr_html_().startswith("<div") and repr(locus).startswith("<RootLocus 'damper.d': 1 N*s/m to 200 N*s/m")
    margins = hb.loop_margins("cmc_ahc", "command")
    simpler = hb.simplify("cart.yaml", 0.9, 0.5)
    for result in (margins, simpler):
        assert type(result).__name__ in repr(result) and len(repr(result)) < 400
    assert "phase 15" in repr(margins) and "states before" in repr(simpler)


def test_pages_import_nothing_below_heavebond() -> None:
    """Except for the constants of the method of the diagnosis, which only its page shows."""
    pages = [*PAGE.parent.rglob("*.md"), *PAGE.parent.rglob("*.ipynb"), PAGE.parent.parent / "README.md"]
    below = {page.name for page in pages if re.search(r"(from|import) heavebond\.", page.read_text(encoding="utf-8"))}
    assert below <= {"diagnosis_method.md"}


def test_the_largest_value_over_a_run_is_named(cart: Path) -> None:
    with pytest.raises(hb.HeavebondError, match="function-arguments") as caught:
        hb.sweep("cart.yaml", {"damper.d": ["20 N*s/m"]}, "max(load.x) in mm", processes=1)
    assert "highest" in caught.value.problems[0].hint
    data = hb.sweep("cart.yaml", {"damper.d": ["20 N*s/m"]}, "highest(load.x) in mm", processes=1).to_xarray()
    largest = hb.simulate("cart.yaml").figures(["place"])["place"].most
    assert data["highest(load.x)"].item() == pytest.approx(largest, rel=1e-6)


def test_an_animation_is_written_and_shown(cart: Path) -> None:
    motion = hb.animate(hb.load("cart.yaml"), "2 s", parameters={"damper.d": "40 N*s/m"})
    assert motion.save("cart.html").stat().st_size > 10_000 and "2 s" in repr(motion)
    frame = motion._repr_html_()
    assert frame.startswith("<iframe") and 'sandbox="allow-scripts"' in frame and "<script" not in frame
    with pytest.raises(hb.UsageError, match="file-suffix"):
        motion.save("cart.txt")


def test_an_export_is_written(cart: Path) -> None:
    exported = hb.export("cart.yaml", "cart.c", parameters={"cart.m": "20 kg"})
    assert Path("cart.c").stat().st_size > 1000 and "2 states" in repr(exported)
    assert next(q.start for q in exported.parameters if q.name == "cart.m") == 20
    with pytest.raises(hb.UsageError, match=r"cart\.fmu"):
        hb.export("cart.yaml", "cart.txt")
    with pytest.raises(hb.UsageError, match=r"\.emx"):
        hb.import_model("cart.yaml")


def test_a_broken_component_does_not_hide_the_library(cart: Path) -> None:
    Path("wrong.yaml").write_text("component: Wrong\nsummary: s\nsumary: t\n", encoding="utf-8")
    page = hb.library()
    assert page.problems and "Spring" in str(page) and page._repr_html_().startswith("<pre>")
    run = CliRunner().invoke(main, ["library"])
    assert run.exit_code == 1 and "Spring" in run.output


def test_check_raises_what_the_command_prints(cart: Path) -> None:
    cart.write_text(CART.replace("load.v: 0 m/s", "load.v: 0 m/s, spring.F: 5 N"), encoding="utf-8")
    with pytest.raises(hb.StartError):
        hb.check("cart.yaml")
    cart.write_text(CART.replace("1 kN/m", "1 kN"), encoding="utf-8")
    with pytest.raises(hb.ModelError, match="unit-wrong"):
        hb.check("cart.yaml")


def test_results_have_html_and_can_be_pickled(cart: Path) -> None:
    task = hb.tuning_task({"damper.d": "10 .. 200 N*s/m"}, "rms(load.x)/1 mm")
    study = hb.sweep("cart.yaml", {"damper.d": ["20 N*s/m", "40 N*s/m"]}, "rms(load.x) in mm", processes=1)
    run = hb.simulate("cart.yaml")
    results = [run, run.saved(), hb.modes("cart.yaml"), hb.sensitivity("cart.yaml", ["place"]), hb.energy("cart.yaml"),
               study, hb.signal(run, "place"), hb.tune("cart.yaml", task, explore=0), hb.check("cart.yaml"),
               hb.library("Spring"), hb.animate("cart.yaml", "1 s")]
    for result in results:
        html = result._repr_html_()
        assert html.startswith("<") and type(result).__name__ in repr(result).splitlines()[0], type(result)
        again = pickle.loads(pickle.dumps(result))
        assert type(again) is type(result) and repr(again) == repr(result)
        assert len(repr(result).splitlines()) <= 24 and max(map(len, repr(result).splitlines())) <= 200, repr(result)
