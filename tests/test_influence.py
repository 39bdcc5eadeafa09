"""Relative influences against closed forms; the ranking, its table and its picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly
from matplotlib.image import imread
from test_plot import _assert_nothing_clipped
from test_sensitivities import HANGING, MEASURED, PRELOADED, SLIDER, _text

import heavebond as hb
from heavebond import cli
from heavebond.optimise.influence import AT_ONCE, candidates, in_chunks, rank
from heavebond.pictures.plot import COLOURS, plot_influence, save

FREE = SLIDER.replace("d: 4 N*s/m", "d: 0 N*s/m").replace("load.v: 0.1 m/s", "load.v: 0 m/s")

STRETCHED = """
model: stretched
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  cart:   {is: Mass, m: 10 kg}
  push:   {is: ConstantForce, F: 50 N}
nodes:
  ground: [wall.a, spring.a]
  load:   [spring.b, cart.a, push.a]
initial: {start: steady}
simulate: {until: 2 s, every: 20 ms}
"""


@pytest.fixture
def slider(tmp_path: Path) -> hb.Assembly:
    return _text(SLIDER)(tmp_path)


def test_influences_have_their_closed_form(tmp_path: Path) -> None:
    """x = x_0 cos(w t) with w = sqrt(c/m): c dx/dc = -x_0 w t sin(w t)/2 = -m dx/dm, x_0 dx/dx_0 = x."""
    found = rank(_text(FREE)(tmp_path), ["load.x"], every=1e-3)
    ranking, t = found.rankings[0], found.time
    phase = np.sqrt(1200 / 2.5) * t
    x = 0.05 * np.cos(phase)
    course = -0.025 * phase * np.sin(phase)
    by_name = {i.parameter: i for i in ranking.influences}
    assert set(by_name) == {"spring.c", "cart.m", "initial.load.x"}  # the damping and the first velocity are zero
    assert ranking.size == pytest.approx(np.std(x), rel=1e-5)
    for name, sign in (("spring.c", 1), ("cart.m", -1)):
        influence = by_name[name]
        assert influence.relative == pytest.approx(np.sqrt(np.mean(course**2)) / np.std(x), rel=1e-5)
        at = int(np.argmax(np.abs(course)))
        assert influence.peak == pytest.approx(sign * course[at], rel=1e-5)
        assert influence.time == pytest.approx(t[at])
    assert by_name["initial.load.x"].course == pytest.approx(x, abs=1e-7)
    assert [i.parameter for i in ranking.influences][-1] == "initial.load.x"


def test_a_signal_that_stands_still_is_compared_with_itself(tmp_path: Path) -> None:
    still = HANGING.replace("=5 N*(1 - cos(3 1/s * time))", "=0 N*time/1 s")
    ranking = rank(_text(still)(tmp_path), ["spring.F"], ["weight.m", "cart.m"]).rankings[0]
    assert ranking.still
    assert [(i.parameter, pytest.approx(i.relative, abs=1e-9)) for i in ranking.influences] == [
        ("weight.m", 1.0), ("cart.m", 0.0)]


def test_a_steady_stretch_depends_on_force_and_stiffness_alone() -> None:
    """x = F/c: 1 % more force is 1 % more stretch, 1 % more stiffness 1 % less, and the mass does nothing."""
    ranking = rank(hb.assemble(hb.loads(STRETCHED)), ["load.x"], ["spring.c", "cart.m", "push.F"]).rankings[0]
    found = {i.parameter: i for i in ranking.influences}
    assert found["push.F"].peak == pytest.approx(0.05, rel=1e-6)
    assert found["spring.c"].peak == pytest.approx(-0.05, rel=1e-6)
    assert abs(found["cart.m"].peak) < 1e-9
    assert ranking.influences[-1].parameter == "cart.m"


def test_all_parameters_of_the_compensator_are_ranked() -> None:
    found = rank(hb.assemble(hb.load("cmc_ahc")), ["WOB", "crown"], until="12 s", every="50 ms")
    assert not found.left_out
    for ranking in found.rankings:
        sizes = [i.relative for i in ranking.influences]
        assert sizes == sorted(sizes, reverse=True)
        assert {"controller.K_p", "controller.K_v", "wave.a"} <= {i.parameter for i in ranking.influences}


def test_measured_inputs_have_a_scale(tmp_path: Path) -> None:
    """Everything starts at rest and is linear: the signals are in proportion to the record."""
    ranking = rank(_text(MEASURED)(tmp_path), ["load.x"], ["scale.table.u"]).rankings[0]
    assert ranking.influences[0].relative == pytest.approx(1.0, abs=0.05)  # its rms is not about the mean


def test_groups_do_not_matter(slider: hb.Assembly, monkeypatch: pytest.MonkeyPatch) -> None:
    together = rank(slider, ["load.x", "spring.F"])
    monkeypatch.setattr("heavebond.optimise.influence.in_chunks", lambda names: in_chunks(names, 1))
    for one, other in zip(together.rankings, rank(slider, ["load.x", "spring.F"]).rankings, strict=True):
        assert [i.parameter for i in one.influences] == [i.parameter for i in other.influences]
        for a, b in zip(one.influences, other.influences, strict=True):
            assert a.relative == pytest.approx(b.relative, rel=1e-4)


def test_names_are_put_into_groups_of_equal_length() -> None:
    names = [str(k) for k in range(13)]
    groups = in_chunks(names)
    assert [len(g) for g in groups] == [4, 4, 5]
    assert [name for group in groups for name in group] == names
    assert in_chunks(names[:AT_ONCE]) == [names[:AT_ONCE]]


def test_what_is_zero_or_solved_for_is_no_candidate(tmp_path: Path) -> None:
    assembly = _text(PRELOADED)(tmp_path)
    assert "spring.F_0" not in candidates(assembly)
    with pytest.raises(hb.UsageError, match="follow from the start"):
        rank(assembly, ["load.x"], ["spring.F_0"])
    with pytest.raises(hb.UsageError, match="its value is zero"):
        rank(_text(FREE)(tmp_path), ["load.x"], ["damper.d"])
    with pytest.raises(hb.UsageError, match="cannot be set"):
        rank(assembly, ["load.x"], ["spring.k"])


def test_what_is_not_tried_is_told(slider: hb.Assembly) -> None:
    found = rank(slider, ["load.x"], most=2)
    assert [len(r.influences) for r in found.rankings] == [2]
    assert set(found.left_out) == set(candidates(slider)[2:])


# -- picture and command ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("courses", partly([0, 3], 2))
def test_the_picture(slider: hb.Assembly, courses: int, tmp_path: Path) -> None:
    figure = plot_influence(rank(slider, ["load.x", "spring.F"]), courses=courses, title="A cart on a rail")
    _assert_nothing_clipped(figure)
    assert len(figure.axes) == (4 if courses else 2)
    bars = figure.axes[0]
    labels = [label.get_text() for label in bars.get_yticklabels()]
    assert "spring.c = 1.2 kN/m" in labels
    widths = [patch.get_width() for patch in bars.patches]
    assert widths == sorted(widths, reverse=True)
    assert {patch.get_facecolor() for patch in bars.patches} <= {
        (*(int(c[k:k + 2], 16) / 255 for k in (1, 3, 5)), 1.0) for c in COLOURS[:2]}
    assert imread(save(figure, tmp_path / "influence.png")).std() > 0.05


def test_wide_ranges_are_drawn_on_a_logarithmic_axis() -> None:
    figure = plot_influence(rank(hb.assemble(hb.load("cmc_ahc")), ["WOB"], until="12 s"), bars=30, courses=2)
    assert figure.axes[0].get_xscale() == "log"
    _assert_nothing_clipped(figure)


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slider.yaml").write_text(SLIDER)
    answer = CliRunner().invoke(cli.main, [
        "sensitivity", "slider.yaml", "--of", "load.x", "--of", "spring.F - damper.F", "--parameter", "spring.c,cart.m",
        "--parameter", "initial.load.x", "--output", "i.png", "--json", "i.json"])
    assert answer.exit_code == 0, answer.output
    for words in ("load.x: rms", "about its mean", "spring.c", "1.2 kN/m", "1 % more moves it by", "wrote i.png"):
        assert words in answer.output
    found = json.loads((tmp_path / "i.json").read_text())
    influences = found["signals"]["load.x"]["influences"]
    assert {i["parameter"] for i in influences[:2]} == {"cart.m", "spring.c"}
    assert (influences[2]["parameter"], influences[2]["unit"]) == ("initial.load.x", "m")
    assert imread(tmp_path / "i.png").std() > 0.05


@pytest.mark.parametrize(("words", "message"), [
    (["--of", "load.y"], "--of load.y"), (["--of", "load.x", "--parameter", "spring.k"], "'spring.k' cannot be set"),
    ([], "Add --of "), (["--of", "load.x", "--output", "i.gif"], "does not end in .png")])
def test_wrong_usage(words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slider.yaml").write_text(SLIDER)
    answer = CliRunner().invoke(cli.main, ["sensitivity", "slider.yaml", *words])
    assert answer.exit_code == 2
    assert message in answer.output
