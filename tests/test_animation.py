"""`view:` and `heavebond animate`: the shapes stand where the run says, on a page that needs nothing but itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from PIL import Image

import heavebond as hb
from heavebond.cli import main
from heavebond.language.library import bundled
from heavebond.pictures.animation import animation_page, packed, save_animation
from heavebond.pictures.film import corners, writing
from heavebond.pictures.motion import Motion, Moving, animate

SWING = """
model: swing
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 400 N/m}
  cart:   {is: Mass, m: 4 kg}
nodes:
  wall: [wall.a, spring.a]
  cart: [spring.b, cart.a]
initial: {cart.x: 0.2 m, cart.v: 0 m/s}
show: {place: {is: cart.x, unit: mm}, cart.x: {unit: cm}}
view:
  floor:  {is: ground, at: [0, -0.1 m], width: 2 m}
  water:  {is: level, at: -0.3 m}
  spring: {is: spring, from: [-1 m, 0], to: [cart.x, 0], width: 0.1 m}
  ram:    {is: cylinder, from: [-1 m, 0.3 m], to: [cart.x, 0.3 m], width: 0.1 m, length: 0.7 m}
  wheel:  {is: circle, at: [cart.x, -0.05 m], diameter: 0.1 m, turned: -cart.x/0.05 m}
  cart:   {is: box, at: [cart.x + 0.2 m, 0.1 m], size: [0.4 m, 0.2 m], label: "<cart> & co"}
simulate: {until: 1 s, every: 5 ms}
"""


@pytest.fixture(scope="module")
def motion() -> Motion:
    return animate(hb.loads(SWING))


@pytest.fixture(scope="module")
def compensator() -> Motion:
    return animate(hb.load("cmc_ahc"), "48 s", every="50 ms")


def _shape(motion: Motion, name: str) -> Moving:
    return next(moving for moving in motion.shapes if moving.name == name)


def test_shapes_stand_where_the_run_is(motion: Motion) -> None:
    x = 0.2 * np.cos(10.0 * motion.time)  # sqrt(400 N/m / 4 kg)
    box, ram = _shape(motion, "cart"), _shape(motion, "ram")
    # interpolated between output points 5 ms apart: (w h)^2 / 8 of the amplitude
    np.testing.assert_allclose(box.courses[0], x, atol=0.2 * 0.05**2 / 8 + 1e-7)
    np.testing.assert_allclose(box.courses[2] - box.courses[0], 0.4, atol=1e-9)
    piston = corners(ram, ram.outlines[3], 0)
    np.testing.assert_allclose(piston, [[0.2 - 0.7, 0.25], [0.2 - 0.7, 0.35]], atol=1e-9)  # a barrel behind the rod's end
    left, bottom, right, top = motion.edges
    assert left < -1.0 and right > 0.6 and bottom < -0.3 and top > 0.3
    assert _shape(motion, "water").courses[0, 0] == left and _shape(motion, "water").courses[2, 0] == right


def test_a_wheel_turns_by_its_formula(motion: Motion) -> None:
    wheel = _shape(motion, "wheel")
    spoke = corners(wheel, wheel.outlines[1], 0)
    way = spoke[1] - spoke[0]
    assert np.arctan2(way[1], way[0]) == pytest.approx(-0.2 / 0.05 + 2 * np.pi)
    assert np.hypot(*way) == pytest.approx(0.05)


def test_signals_are_told_in_their_own_unit_and_formulas_in_metres(motion: Motion) -> None:
    unit, values = motion.signals["cart.x"]  # an output of that name, in cm; in `view:` it is the variable
    assert unit == "cm" and values[0] == pytest.approx(20.0)


def test_the_page_keeps_a_course_once(motion: Motion) -> None:
    data = packed(motion)
    tracks = data["tracks"]
    assert isinstance(tracks, list)
    assert len(tracks) == 5  # the cart's x, and the two coordinates of each end of the wheel's spoke
    text = animation_page(motion)
    assert "\\u003ccart\\u003e \\u0026 co" in text  # what a label holds cannot end the script
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)


@pytest.mark.parametrize(("old", "new", "code", "said"), [
    ("is: box", "is: bx", "is-unknown", "box"), ("cart.x + 0.2 m", "cart.y + 0.2 m", "name-unknown", "cart.y"),
    ("cart.x + 0.2 m", "cart.v", "view-unit", "a length"),
    ("size: [0.4 m, 0.2 m]", "size: 0.4 m", "view-pair", "two lengths"),
    ("width: 2 m", "width: [2 m, 1 m]", "view-one", "one value"),
    ("is: level", "is: level, size: 3 m", "key-unknown", "size"),
    ("cart.x + 0.2 m", "cart.x +", "formula", ""), ("is: spring, from: [-1 m, 0],", "is: spring,", "key-missing", "from"),
])
def test_what_is_wrong_with_a_view_is_said_with_its_place(old: str, new: str, code: str, said: str) -> None:
    with pytest.raises(hb.ModelError) as error:
        animate(hb.loads(SWING.replace(old, new, 1)))
    problem = error.value.problems[0]
    assert problem.code.startswith(code) and said in str(problem)
    assert problem.place is not None and problem.place.line > 10


def test_a_diagram_without_a_view_says_what_to_add() -> None:
    with pytest.raises(hb.ModelError, match=r"view-missing[\s\S]*view: \{"):
        animate(hb.load("receiver_rig"))


def test_a_variant_takes_the_view_over_and_replaces_by_name(tmp_path: Path) -> None:
    (tmp_path / "swing.yaml").write_text(SWING)
    (tmp_path / "other.yaml").write_text("model: other\nextends: swing.yaml\nview:\n  water: {is: level, at: -0.5 m}\n")
    view = hb.load(tmp_path / "other.yaml").view
    assert list(view) == ["floor", "water", "spring", "ram", "wheel", "cart"]
    assert view["water"].formulas["at"][0].text == "-0.5 m"


def test_gif_holds_the_run(motion: Motion, tmp_path: Path) -> None:
    path = save_animation(motion, tmp_path / "swing.gif", speed=0.5)
    with Image.open(path) as film:
        assert film.n_frames == 24  # 2 s at 12 a second
        film.seek(0)
        first = np.asarray(film.convert("RGB"), float)
        film.seek(4)  # 1/6 s at half the speed
        later = np.asarray(film.convert("RGB"), float)
    assert np.abs(first - later).max() > 100


def test_the_command_writes_a_page_and_refuses_another_suffix(tmp_path: Path) -> None:
    page = tmp_path / "car.html"
    said = CliRunner().invoke(main, ["animate", "quarter_car", "-o", str(page), "--signal", "tyre_force", "--speed", "0.5"])
    assert said.exit_code == 0, said.output
    assert "tyre_force" in page.read_text()
    assert CliRunner().invoke(main, ["animate", "quarter_car", "-o", str(tmp_path / "car.avi")]).exit_code == 2


SEEN = [path for path in sorted(bundled("models").glob("*/*.yaml"))
        if "\nview:" in path.read_text(encoding="utf-8") and path.parent.name != "spatial"]


@pytest.mark.parametrize("path", partly(SEEN, 3), ids=lambda path: path.stem)
def test_every_bundled_view_moves(path: Path) -> None:
    """Something moves, all shapes stay in the picture, and what they are told to be has room."""
    model = hb.load(path)
    longer = {"cascaded_tanks": "1000 s", "passive_rig": "15 s", "cmc_ahc": "12 s", "cylinder_rig": "6 s"}
    found = animate(model, longer.get(model.name, "2 s"))
    left, bottom, right, top = found.edges
    places = np.array([moving.courses[:4] for moving in found.shapes])
    assert np.isfinite(places).all()
    assert np.ptp(places, axis=2).max() > 0.01 * (top - bottom)
    assert (places[:, [0, 2]] >= left - 1e-9).all() and (places[:, [0, 2]] <= right + 1e-9).all()
    assert (places[:, [1, 3]] >= bottom - 1e-9).all() and (places[:, [1, 3]] <= top + 1e-9).all()


def test_words_in_a_film_stand_inside_where_they_fit(compensator: Motion) -> None:
    """A wide box holds its name in its middle, a slim one has it beside, a level at the right edge."""
    right, letter = compensator.edges[2], (compensator.edges[3] - compensator.edges[1]) / 34
    crown, gas, sea = (_shape(compensator, name) for name in ("crown", "gas_r", "sea"))
    assert writing(crown, 0, right, letter) == (pytest.approx(0.0), pytest.approx(12.9, abs=1e-6), "center")
    assert writing(gas, 0, right, letter)[0] > 2.4 + 0.3 and writing(gas, 0, right, letter)[2] == "left"
    assert writing(sea, 0, right, letter) == (pytest.approx(right - letter / 2), pytest.approx(-3 + letter / 2), "right")


# -- in a browser ------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def tab(compensator: Motion, tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Tab]:
    if browser.browser() is None:
        pytest.skip("no browser is installed")
    folder = tmp_path_factory.mktemp("animation")
    path = save_animation(compensator, folder / "compensator.html")
    found = browser.Tab(folder / "profile")
    found.open(path)
    yield found
    found.close()


MIDDLE = """(() => {
  const slider = document.getElementById("when");
  slider.value = slider.max * %s / 48;
  slider.dispatchEvent(new Event("input"));
  return ["crown", "deck_l"].map(name => {
    const box = document.querySelector(`#shape-${name} path`).getBBox();
    return -(box.y + box.height / 2);
  });
})()"""


def test_the_crown_block_stays_while_the_platform_moves(tab: browser.Tab, compensator: Motion) -> None:
    """At the crest and in the trough of the fourth wave (12 s, 0.5 m)."""
    run = _shape(compensator, "deck_l").courses[1]
    late = compensator.time >= 36.0
    crest, trough = (float(compensator.time[late][k]) for k in (np.argmax(run[late]), np.argmin(run[late])))
    (crown_up, deck_up), (crown_down, deck_down) = (tab.run(MIDDLE % t) for t in (crest, trough))
    assert deck_up - deck_down == pytest.approx(np.ptp(run[late]), abs=2e-3)  # corners are rounded to 1e-5 of the height
    assert deck_up - deck_down > 0.95
    assert abs(crown_up - crown_down) < 0.04
    assert tab.run("document.getElementById('clock').textContent") == f"{trough:.1f} s"


def test_it_plays_pauses_and_asks_for_nothing(tab: browser.Tab) -> None:
    tab.run("document.getElementById('speed').value = '10'")
    tab.run("document.getElementById('play').click()")
    before = tab.run("document.getElementById('play').textContent")
    moved = tab.run("""new Promise(done => { const slider = document.getElementById("when"), from = slider.value;
        setTimeout(() => done(Math.abs(slider.value - from)), 300); })""")
    tab.run("document.getElementById('play').click()")
    assert before == "Pause" and moved > 0
    assert tab.run("document.getElementById('play').textContent") == "Play"
    assert tab.complaints == []
    assert [address for address in tab.requested() if not address.startswith(("file:", "about:"))] == []


def test_writing_lies_in_the_picture(tab: browser.Tab) -> None:
    outside = tab.run("""(() => { const stage = document.querySelector("#stage svg").getBoundingClientRect();
        return [...document.querySelectorAll("#stage text")].filter(text => { const box = text.getBoundingClientRect();
            return box.left < stage.left || box.right > stage.right || box.top < stage.top || box.bottom > stage.bottom;
        }).map(text => text.textContent); })()""")
    assert outside == []


DRIVE = """
model: drive
components:
  wall: {is: Fixed}
  d:    {is: Damper, d: 4 N*s/m}
  push: {is: ForceSource, u: "=8 N + 2 N*sin(2*pi*time/1 s)"}
  cart: {is: Mass, m: 2 kg}
nodes:
  wall: [wall.a, d.a]
  cart: [d.b, push.a, cart.a]
initial: {start: steady}
show: {speed: {is: cart.v, unit: m/s}}
view:
  cart:  {is: box, at: [cart.x + 0.1 m, 0], size: [0.2 m, 0.1 m]}
  wheel: {is: circle, at: [cart.x, 0], diameter: 0.1 m, turned: -cart.x/0.05 m}
simulate: {until: 3 s, every: 100 ms}
"""


def test_a_view_adds_no_state_and_leaves_the_start_as_it_is() -> None:
    """The machine starts at its steady 2 m/s, as without a view; where it is follows from its speed."""
    model = hb.loads(DRIVE)
    run = hb.simulate(model)
    assert run.display["speed"][0] == pytest.approx(2.0) and "cart.x" not in run.assembly.flat.names
    found = animate(model)
    # m dv/dt = F - d v from steady: v = 2 + c (exp(-2 t) w - w cos + 2 sin) with w = 2 pi, c = 1/(4 + w^2)
    w, t = 2 * np.pi, found.time
    c = 1 / (4 + w**2)
    x = 2 * t + c * (w * (1 - np.exp(-2 * t)) / 2 - np.sin(w * t) + 2 * (1 - np.cos(w * t)) / w)
    np.testing.assert_allclose(_shape(found, "cart").courses[0], x, atol=1e-6)
    np.testing.assert_allclose(found.signals["speed"][1], run.display["speed"], atol=1e-12)


def test_a_derivative_beside_a_position_that_is_no_state_is_refused() -> None:
    with pytest.raises(hb.ModelError, match="Write the rate by its name: cart"):
        animate(hb.loads(DRIVE.replace("cart.x + 0.1 m, 0]", "cart.x + der(cart.x)*1 s, 0]")))
