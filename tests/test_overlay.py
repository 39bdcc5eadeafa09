"""`heavebond plot`: saved runs and records over each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.pictures.overlay import Overlay, read_column, read_overlay
from heavebond.pictures.plot import RECORD, plot_runs, save
from heavebond.records.saved_runs import SavedRun, write_run

TIME = np.linspace(0.0, 2.0, 41)


def _wave(scale: float, unit: str) -> SavedRun:
    values = {"crown.x": scale * np.sin(TIME), "pull": np.cos(TIME)}
    return SavedRun("machine", TIME, values, {"crown.x": unit, "pull": "kN"})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_run(_wave(1.0, "m"), tmp_path / "a.csv")
    write_run(_wave(1000.0, "mm"), tmp_path / "b.parquet")
    rows = [f"{1000 * t},{2 * np.sin(t)}" for t in TIME]
    (tmp_path / "record.csv").write_text("\n".join(["clock_ms,crown_m", *rows]), encoding="utf-8")
    return tmp_path


def _overlay(folder: Path, *files: str, columns: tuple[str, ...] = ()) -> Overlay:
    return read_overlay([str(folder / file) for file in files], [read_column(text) for text in columns])


def test_runs_in_different_units_lie_on_each_other(folder: Path) -> None:
    overlay = _overlay(folder, "a.csv", "b.parquet")
    figure = plot_runs(overlay.runs, ["crown.x", "pull"])
    first, second = figure.axes[0].lines
    assert list(overlay.runs) == ["a", "b"] and not overlay.measured
    assert figure.axes[0].get_ylabel() == "crown.x [m]" and figure.axes[1].get_ylabel() == "pull [kN]"
    np.testing.assert_allclose(second.get_ydata(), first.get_ydata(), rtol=1e-12)  # a factor of 1000 and back
    figure.axes[0].set_xlim(0.5, 1.0)
    assert figure.axes[1].get_xlim() == (0.5, 1.0)  # linked


def test_a_record_lies_beneath_the_runs_as_grey_dots(folder: Path) -> None:
    columns = ("crown.x=crown_m m", "time=clock_ms ms")
    overlay = _overlay(folder, "a.csv", "record.csv", columns=columns)
    panel = plot_runs(overlay.runs, ["crown.x"], measured=overlay.measured).axes[0]
    model, record = panel.lines
    assert overlay.measured == ("record",)
    assert record.get_color() == RECORD and record.get_linestyle() == "None" and record.get_zorder() < model.get_zorder()
    np.testing.assert_allclose(record.get_xdata(), TIME, atol=1e-12)  # ms became s
    np.testing.assert_allclose(record.get_ydata(), 2 * np.sin(TIME), rtol=1e-12)


def test_an_experiment_brings_its_record_by_names_and_formulas() -> None:
    overlay = read_overlay(["passive_rig/friction"], record="validate")
    (label, run), = overlay.runs.items()
    assert overlay.measured == (label,) == ("friction (validate)",)
    assert run.unit("extension") == "m"
    np.testing.assert_array_equal(run["extension"], run["crown.x - platform.x"])


def test_what_cannot_be_laid_over_each_other_is_said(folder: Path) -> None:
    with pytest.raises(hb.UsageError, match=r"record-undescribed[\s\S]*--column"):
        _overlay(folder, "record.csv")
    with pytest.raises(hb.UsageError, match="column-form"):
        read_column("crown.x crown_m")
    with pytest.raises(hb.UsageError, match="unit"):
        read_column("crown.x=crown_m metrs")
    with pytest.raises(hb.UsageError, match=r"name-unknown[\s\S]*crown\.x"):
        plot_runs(_overlay(folder, "a.csv").runs, ["crow.x"])
    with pytest.raises(hb.UsageError, match="record-unknown"):
        read_overlay(["passive_rig/friction"], record="tain")
    force = SavedRun("other", TIME, {"crown.x": TIME}, {"crown.x": "kN"})
    with pytest.raises(hb.UsageError, match=r"\[kN\] in b \[unit-kind"):
        plot_runs({"a": _wave(1.0, "m"), "b": force}, ["crown.x"])


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_command_draws_in_each_format(folder: Path, suffix: str) -> None:
    picture = folder / f"both{suffix}"
    said = CliRunner().invoke(main, ["plot", str(folder / "a.csv"), str(folder / "b.parquet"), "--signal", "crown.x",
                                     "--from", "500 ms", "--until", "1 s", "-o", str(picture)])
    assert said.exit_code == 0, said.output
    assert picture.stat().st_size > 1000


def test_without_signals_the_common_ones_are_drawn_and_an_empty_window_is_refused(folder: Path) -> None:
    given = ["plot", str(folder / "a.csv"), str(folder / "b.parquet"), "-o", str(folder / "x.png")]
    said = CliRunner().invoke(main, given)
    assert said.exit_code == 0 and "crown.x, pull of a, b" in said.output
    assert CliRunner().invoke(main, [*given, "--from", "2 s", "--until", "1 s"]).exit_code == 2


def test_the_same_files_give_the_same_picture(folder: Path) -> None:
    runs = _overlay(folder, "a.csv", "b.parquet").runs
    one, two = (save(plot_runs(runs, ["crown.x"]), folder / f"{k}.svg").read_bytes() for k in range(2))
    assert one == two
