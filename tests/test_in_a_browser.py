"""Pictures as a browser shows them: writing lies inside and not on other writing, and there is something to be seen."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from PIL import Image

import heavebond as hb
from heavebond.pictures.animation import save_animation
from heavebond.pictures.bond_picture import draw_bond_graph
from heavebond.pictures.colour_map import paint
from heavebond.pictures.motion import animate

WRITING = """(() => { const page = document.documentElement.getBoundingClientRect();
  return [page.left, page.top, page.right, page.bottom, [...document.querySelectorAll("text")].map(text => {
    const box = text.getBoundingClientRect();
    return [text.textContent, box.left, box.top, box.right, box.bottom]; })]; })()"""


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Tab]:
    if browser.browser() is None:
        pytest.skip("no browser is installed")
    found = browser.Tab(tmp_path_factory.mktemp("browser") / "profile", 1400, 1000)
    yield found
    found.close()


def _seen(tab: browser.Tab) -> float:
    """The share of a screenshot that is not white."""
    picture = np.asarray(Image.open(io.BytesIO(tab.screenshot())).convert("L"))
    assert picture.shape[0] > 500 and picture.shape[1] > 1000
    return float((picture < 250).mean())


def _drawn(kind: str, name: str) -> str:
    model = hb.load(name)
    if kind == "bonds":
        return draw_bond_graph(model)
    return hb.draw(model, open_all=kind == "open", values=kind == "open", colour=paint(model, "power", until="5 s")
                   if kind == "power" else None)


@pytest.mark.parametrize(("kind", "name"), [
    ("closed", "cmc_ahc"), ("open", "cmc_ahc"), ("power", "cmc_ahc"), ("bonds", "cmc_ahc"),
    *(pytest.param(*case, marks=pytest.mark.long) for case in (
        ("closed", "hydrostatic_drive"), ("open", "hydrostatic_drive"), ("power", "hydrostatic_drive"),
        ("bonds", "hydrostatic_drive"), ("bonds", "excavator_boom")))])
def test_no_writing_covers_other_writing(tab: browser.Tab, tmp_path: Path, kind: str, name: str) -> None:
    """With the browser's own fonts, not the widths that the drawing reckons with."""
    path = tmp_path / "picture.svg"
    path.write_text(_drawn(kind, name), encoding="utf-8")
    tab.open(path)
    left, top, right, bottom, words = tab.run(WRITING)
    assert len(words) > 10
    outside = [word for word, a, b, c, d in words if a < left or b < top or c > right or d > bottom]
    assert not outside
    boxes = np.array([box for _, *box in words])
    shared = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:]) - np.maximum(boxes[:, None, :2], boxes[None, :, :2])
    # line boxes are higher than letters: two lines of one name touch by 3 px
    covered = [(words[i][0], words[j][0]) for i, j in np.argwhere((shared > 3.5).all(axis=2)) if i < j]
    assert not covered
    assert 0.002 < _seen(tab) < 0.5
    assert tab.complaints == []


def test_an_animation_shows_the_machine(tab: browser.Tab, tmp_path: Path) -> None:
    tab.open(save_animation(animate(hb.load("hydrostatic_drive"), "6 s"), tmp_path / "drive.html"))
    before = tab.screenshot()
    tab.run("""(() => { const slider = document.getElementById("when"); slider.value = slider.max;
        slider.dispatchEvent(new Event("input")); })()""")
    assert tab.screenshot() != before
    assert 0.02 < _seen(tab) < 0.6
