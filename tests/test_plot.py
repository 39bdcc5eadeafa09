"""Figures: what stands on which axes, labels with units, nothing clipped or covered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.transforms import Bbox

import heavebond as hb
from heavebond.diagnosis.state import LadderEntry
from heavebond.estimation.comparison import Comparison
from heavebond.pictures.plot import COLOURS, DENSE, plot_comparison, plot_ladder, plot_runs, plot_signals, save

SLIDER = """
model: slider
summary: A cart on a rail.
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1.2 kN/m}
  damper: {is: Damper, d: 20 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a]
initial: {load.x: 50 mm, load.v: 0 m/s}
show:
  pull:  {is: spring.F, unit: N}
  drag:  {is: damper.F, unit: N}
  place: {is: load.x, unit: mm}
simulate: {until: 1 s, every: 5 ms}
"""


@pytest.fixture(scope="module")
def result() -> hb.Result:
    return hb.simulate(hb.loads(SLIDER))


@pytest.fixture(scope="module")
def comparison() -> hb.Comparison:
    return hb.compare("passive_rig/nothing")


def _labels(figure: Figure) -> list[str]:
    return [axes.get_ylabel() for axes in figure.axes]


def _drawn(figure: Figure) -> FigureCanvasAgg:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return canvas


def _assert_nothing_clipped(figure: Figure) -> None:
    """Every text lies inside the page, and no two texts of an axes' surroundings lie on each other."""
    renderer = _drawn(figure).get_renderer()
    width, height = figure.get_size_inches() * figure.dpi
    boxes = []
    for text in figure.findobj(lambda artist: hasattr(artist, "get_text") and artist.get_visible()):
        if text.get_text().strip():
            box = text.get_window_extent(renderer)
            if text.get_text() in _shown_ticks(figure) and not _inside(box, width, height):
                continue  # a tick label beyond the limits is not drawn
            assert _inside(box, width, height), f"'{text.get_text()}' is cut off"
            if text.get_text().endswith("\n"):  # an empty line below keeps its distance, and may be written over
                box = Bbox([[box.x0, (box.y0 + box.y1) / 2], [box.x1, box.y1]])
            boxes.append((text.get_text(), box))
    titles = [(text, box) for text, box in boxes if len(text) > 12]
    for k, (text, box) in enumerate(titles):
        for other, another in titles[k + 1:]:
            assert not box.overlaps(another) or text == other, f"'{text}' lies on '{other}'"


def _shown_ticks(figure: Figure) -> set[str]:
    return {label.get_text() for axes in figure.axes for label in (*axes.get_xticklabels(), *axes.get_yticklabels())}


def _inside(box: object, width: float, height: float) -> bool:
    return box.x0 >= -1 and box.y0 >= -1 and box.x1 <= width + 1 and box.y1 <= height + 1


def _legend_covers_no_line(axes: Axes) -> bool:
    legend = axes.get_legend()
    return legend is None or legend.get_window_extent().y0 >= axes.get_window_extent().y1 - 1


def test_one_axes_per_unit_labelled_with_quantity_and_unit(result: hb.Result) -> None:
    figure = plot_signals(result, ["pull", "place", "drag", "load.v"])
    assert _labels(figure) == ["force [N]", "position [mm]", "velocity [m/s]"]
    assert [len(axes.lines) for axes in figure.axes] == [2, 1, 1]
    assert [line.get_label() for line in figure.axes[0].lines] == ["pull", "drag"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert "slider" in figure.get_suptitle()


def test_time_axes_are_linked(result: hb.Result) -> None:
    figure = plot_signals(result, ["pull", "place"])
    figure.axes[0].set_xlim(0.2, 0.4)
    assert figure.axes[1].get_xlim() == (0.2, 0.4)


def test_a_variable_is_drawn_in_a_prefix_of_its_size(result: hb.Result) -> None:
    figure = plot_signals(result, ["load.x", "spring.F"])
    assert _labels(figure) == ["position [mm]", "force [N]"]
    assert np.ptp(figure.axes[0].lines[0].get_ydata()) > 10
    kilo = plot_signals(hb.simulate(hb.loads(SLIDER).with_parameters({"spring.c": "200 kN/m"})), ["spring.F"])
    assert _labels(kilo) == ["force [kN]"]


def test_signals_that_meet_in_a_unit_share_an_axes(result: hb.Result) -> None:
    """`place` is shown in mm by its author, load.x in mm for its size."""
    figure = plot_signals(result, ["place", "load.x"])
    assert _labels(figure) == ["position [mm]"]
    first, second = (line.get_ydata() for line in figure.axes[0].lines)
    assert first == pytest.approx(second)


def test_nothing_is_clipped_and_legends_cover_nothing(result: hb.Result) -> None:
    figure = plot_signals(result, ["pull", "drag", "place", "load.v", "der(load.v)", "spring.F + damper.F"])
    _assert_nothing_clipped(figure)
    assert all(_legend_covers_no_line(axes) for axes in figure.axes)


def test_what_stands_still_is_no_noise(result: hb.Result) -> None:
    axes = plot_signals(result, ["ground.v"]).axes[0]
    low, high = axes.get_ylim()
    assert high - low > 0.1


def test_no_signal_and_unknown_signal_are_refused(result: hb.Result) -> None:
    with pytest.raises(hb.UsageError, match="no signal"):
        plot_signals(result, [])
    with pytest.raises(hb.UsageError, match="Did you mean"):
        plot_signals(result, ["pul"])


def test_runs_side_by_side(result: hb.Result) -> None:
    stiff = hb.simulate(hb.loads(SLIDER).with_parameters({"spring.c": "2 kN/m"}))
    runs = {"soft": result.saved(), "stiff": stiff.saved()}
    figure = plot_runs(runs, ["place", "pull"], window=(0.25, 1.0), shaded=(0.5, 1.0))
    assert _labels(figure) == ["place [mm]", "pull [N]"]
    assert [line.get_color() for line in figure.axes[0].lines] == list(COLOURS[:2])
    assert figure.axes[0].get_xlim() == (0.25, 1.0)
    assert float(figure.axes[0].lines[0].get_xdata()[0]) == pytest.approx(0.25)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["soft", "stiff", "evaluated"]
    _assert_nothing_clipped(figure)


@pytest.mark.long
def test_comparison_has_a_column_per_record_and_a_residual_under_each_channel(comparison: hb.Comparison) -> None:
    figure = plot_comparison(comparison)
    channels = list(comparison.records["train"].channels)
    assert len(figure.axes) == 2 * len(channels) * len(comparison.records)
    labels = _labels(figure)[: 2 * len(channels)]
    assert labels[0] == "extension [m]"
    assert labels[2] == "string.F [kN]"
    assert all(label.startswith("residual [") for label in labels[1::2])
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    for record in comparison.records.values():
        assert any(record.name in title and f"{100 * record.normalised:.3g} %" in title for title in titles)
    assert "rms error" in figure.axes[0].get_title(loc="right")
    assert figure.axes[0].lines[1].get_zorder() >= figure.axes[0].lines[0].get_zorder()  # the model on top
    _assert_nothing_clipped(figure)


def test_noise_band_is_twice_the_noise_in_the_unit_of_the_panel(comparison: hb.Comparison) -> None:
    figure = plot_comparison(comparison)
    noise = comparison.records["train"].channels["extension"].noise  # m, given as 1 mm
    lower = figure.axes[1]
    assert "mm" in lower.get_ylabel()
    low, high = (edge for edge in sorted(lower.patches[0].get_extents().transformed(
        lower.transData.inverted()).get_points()[:, 1]))
    assert (low, high) == (pytest.approx(-2e3 * noise), pytest.approx(2e3 * noise))
    assert lower.get_ylim()[1] >= 3e3 * noise


def test_few_samples_are_dots_and_many_a_line(comparison: hb.Comparison) -> None:
    record = comparison.records["train"]
    channel = record.channels["extension"]
    few = replace(channel, **{key: getattr(channel, key)[:DENSE] for key in ("time", "measured", "model")})
    short = replace(comparison, records={"train": replace(record, channels={"extension": few})})
    assert plot_comparison(short).axes[0].lines[0].get_marker() == "."
    assert plot_comparison(comparison).axes[0].lines[0].get_linestyle() == "-"


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_save_by_suffix_gives_the_same_file_again(result: hb.Result, suffix: str, tmp_path: Path) -> None:
    files = [save(plot_signals(result, ["pull", "place"]), tmp_path / f"{k}{suffix}") for k in range(2)]
    contents = [file.read_bytes() for file in files]
    assert len(contents[0]) > 5000
    assert contents[0] == contents[1]
    begin = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix]
    assert contents[0].startswith(begin)


def test_a_png_is_not_blank_and_of_the_size_said(result: hb.Result, tmp_path: Path) -> None:
    picture = imread(save(plot_signals(result, ["pull", "place", "load.v"]), tmp_path / "p.png"))
    assert picture.shape[:2] == (800, 1200)
    assert (picture[..., :3].min(axis=2) < 0.5).mean() > 0.002


def test_what_cannot_be_saved_is_said(result: hb.Result, tmp_path: Path) -> None:
    figure = plot_signals(result, ["pull"])
    with pytest.raises(hb.UsageError, match="no suffix of a picture"):
        save(figure, tmp_path / "p.bmp")
    with pytest.raises(hb.UsageError, match="cannot be written"):
        save(figure, tmp_path / "nowhere" / "p.png")


@pytest.mark.parametrize(("least", "scale"), [(0.3, "linear"), (0.004, "log")])
def test_the_ladder_shows_each_error_beside_the_noise_of_its_own_samples(least: float, scale: str) -> None:
    """Errors and noise: an error of `least` at chi-square 4 is twice the noise; one that is not fitted is four times it."""
    comparison = cast(Comparison, None)
    rungs = [LadderEntry("before", 0.5, 0.4, 100.0, 90.0, comparison),
             LadderEntry("after", least, 0.5 * least, 4.0, 16.0, comparison)]
    axes = plot_ladder(rungs).axes[0]
    lines = {str(line.get_label()): np.asarray(line.get_xdata(), dtype=float) for line in axes.lines}
    assert lines["fitted"] == pytest.approx([50, 100 * least]) and lines["held out"] == pytest.approx([40, 50 * least])
    assert lines["noise alone, fitted"] == pytest.approx([50 * least] * 2)
    assert lines["noise alone, held out"] == pytest.approx([12.5 * least] * 2)
    assert axes.get_xscale() == scale
    assert {text.get_text() for text in axes.texts} == {"50 %", "40 %", f"{100 * least:.3g} %", f"{50 * least:.3g} %"}
