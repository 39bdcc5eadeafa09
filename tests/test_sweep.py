"""Sweeps: how points are drawn, what is told of them, the worst case, workers that die, `heavebond sweep`."""

from __future__ import annotations

import json
import math
import os
import pickle
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path

import distributed
import numpy as np
import pandas as pd
import pytest
from diagrams import ISOLATOR
from test_compiled_cvodes import compile_to_the_end

import heavebond as hb
from heavebond.cli import main
from heavebond.core.units import parse_range
from heavebond.numerics.compiled_cvodes import program
from heavebond.pictures.plot_study import plot_study
from heavebond.studies import campaign, run_case, shared_runs
from heavebond.studies.run_case import Outcome, worked
from heavebond.studies.sampling import Sampling, points
from heavebond.studies.study import Procedure
from heavebond.studies.tables import mean_rows, table, to_pandas, write_files
from heavebond.studies.uncertainty import indices, slopes, spreads, swings

SAMPLE = """study: sample
model: isolator.yaml
cases:
  uncertain:
    sample: {latin_hypercube: 6, seed: 3}
    over: {spring.c: 40 kN/m +- 20 %, damper.d: 0.5 .. 2 kN*s/m}
evaluate: {from: 4 s, to: 5 s}
measure: {swing: {is: rms(motion), unit: mm}}
"""
# a number that is linear in the parameters, whatever the machine does
LINEAR = "measure: {y: spring.c/1 kN/m + 8*damper.d/1 kN*s/m}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "isolator.yaml").write_text(ISOLATOR, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _study(text: str = SAMPLE) -> hb.Study:
    Path("study.yaml").write_text(text, encoding="utf-8")
    return hb.load_study("study.yaml")


def _linear(sample: str) -> hb.Study:
    text = SAMPLE.replace("{latin_hypercube: 6, seed: 3}", sample).replace("{from: 4 s, to: 5 s}", "{to: 20 ms}")
    return _study(text[:text.index("measure:")] + LINEAR)


def _called(*arguments: str) -> tuple[int, dict[str, object]]:
    with pytest.raises(SystemExit) as caught:
        main([*arguments, "--json", "told.json"])
    assert isinstance(caught.value.code, int)
    told: dict[str, object] = json.loads(Path("told.json").read_text(encoding="utf-8"))
    return caught.value.code, told


def _swing(f: float, c: float, d: float, m: float = 100.0) -> float:
    """rms of the machine's motion (mm) over a floor that moves by 10 mm."""
    w = 2 * math.pi * f
    return 10 / math.sqrt(2) * abs(complex(c, d * w) / complex(c - m * w**2, d * w))


# -- points ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", ["sobol", "latin_hypercube", "random"])
def test_points_are_spread_as_declared(kind: str) -> None:
    over = {"a": parse_range("20 .. 60 kN/m"), "b": parse_range("10 mm +- 2 mm")}
    found = points(Sampling(kind, over, 1024, 5))
    assert found.shape == (1024, 2)
    assert np.array_equal(found, points(Sampling(kind, over, 1024, 5)))
    assert not np.array_equal(found, points(Sampling(kind, over, 1024, 6)))
    assert (found.min(axis=0) >= [20e3, 8e-3]).all() and (found.max(axis=0) <= [60e3, 12e-3]).all()
    # four standard errors of 1024 independent points; the other kinds scatter less
    near = 4 / math.sqrt(1024)
    assert found[:, 0].mean() == pytest.approx(40e3, abs=near * 11.5e3)
    assert found[:, 0].std() == pytest.approx(40e3 / math.sqrt(12), rel=near)
    # normal with s = 1 mm cut at 2 s: variance s**2 (1 - 4 phi(2)/(2 Phi(2) - 1))
    cut = 1 - 4 * math.exp(-2) / math.sqrt(2 * math.pi) / math.erf(math.sqrt(2))
    assert found[:, 1].std() == pytest.approx(1e-3 * math.sqrt(cut), rel=near)


SEA = """model: sea
components: {sea: {is: IrregularSea, H_s: 2 m, T_p: 8 s, t_r: 2 s}, buoy: {is: PositionSource}}
nodes: {surface: [sea.z, buoy.u], buoy: [buoy.a]}
show: {heave: {is: buoy.x, unit: m}}
simulate: {until: 120 s, every: 0.1 s}
"""


@pytest.mark.long
def test_realisations_of_a_sea_and_the_interval_of_their_mean(folder: Path) -> None:
    Path("sea.yaml").write_text(SEA, encoding="utf-8")
    study = _study("""study: sea
model: sea.yaml
cases:
  sea.H_s: [1 m, 2 m]
  realisation: {sample: seeds, over: {sea.seed: 3 .. 8}}
evaluate: {from: 20 s, to: 120 s}
measure: {height: 4*rms(heave), cycles: "equivalent_range(heave, 3)"}
pictures: {height: {curves: [height]}, spread: {histogram: [cycles]}}
""")
    result = hb.study(study, processes=1)
    found = {(s.quantity, s.others): s for s in spreads(result)}
    high, low = found["height", "sea.H_s 2 m"], found["height", "sea.H_s 1 m"]
    values = [result.value(o, "height") for o in result.outcomes[6:]]
    assert len({*values}) == 6     # another sea each
    assert (high.number, high.mean) == (6, pytest.approx(2 * low.mean, rel=1e-6))
    # Student's t for 5 degrees of freedom
    assert high.interval[1] - high.mean == pytest.approx(2.5706 * np.std(values, ddof=1) / math.sqrt(6), rel=1e-4)
    assert high.interval[0] < 2 < high.interval[1]
    for picture in study.pictures:
        assert plot_study(result, picture).axes
    line, = plot_study(result, study.pictures[0]).axes[0].containers     # a curve of two means with bars
    assert np.asarray(line[0].get_xydata()) == pytest.approx(np.array([[1, low.mean], [2, high.mean]]))
    head, rows, words = mean_rows(result)     # one row for each height of the sea
    assert (head, [row[0] for row in rows], words) == (["H_s\n[m]", "height\n[m]", "cycles\n[m]"], ["1", "2"], 0)
    assert [float(part) for part in rows[1][1].split(" ± ")] == pytest.approx(
        [high.mean, high.interval[1] - high.mean], abs=0.005)
    plain = hb.study(_study(), processes=1)
    assert all(math.isnan(s.interval[0]) for s in spreads(plain)) and mean_rows(plain)[1] == []     # no independent points
    # the quantiles of each level are told in the legend; at their lines they would cover each other
    drawn = [plot_study(result, study.pictures[1]), plot_study(plain, replace(study.pictures[1], names=("swing",)))]
    assert [(len(figure.axes[0].lines), len(figure.axes[0].texts)) for figure in drawn] == [(6, 0), (3, 0)]
    told = [[text.get_text() for text in figure.axes[0].get_legend().get_texts()] for figure in drawn]
    assert [len(texts) for texts in told] == [2, 1]
    assert all("5, 50 and 95 %: " in text for texts in told for text in texts)


@pytest.mark.parametrize("over", ["{f: 1 .. 3 Hz, machine.m: 1 .. 2 kg}", "{f: 0.5 .. 3 Hz}", "{f: 2 Hz +- 1 Hz}"])
def test_seeds_are_whole_numbers(folder: Path, over: str) -> None:
    text = SAMPLE.replace("{latin_hypercube: 6, seed: 3}", "seeds")
    with pytest.raises(hb.ModelError) as caught:
        _study(text.replace("{spring.c: 40 kN/m +- 20 %, damper.d: 0.5 .. 2 kN*s/m}", over))
    assert [p.code for p in caught.value.problems] == ["seeds-wrong"]


def test_points_for_indices_mix_two_samples() -> None:
    over = {"a": parse_range("0 .. 1"), "b": parse_range("0 .. 1")}
    first, second, a_mixed, b_mixed = points(Sampling("sobol_indices", over, 8)).reshape(4, 8, 2)
    assert np.array_equal(a_mixed, np.column_stack([second[:, 0], first[:, 1]]))
    assert np.array_equal(b_mixed, np.column_stack([first[:, 0], second[:, 1]]))
    assert not (first == second).any()


# -- cases -------------------------------------------------------------------------------------------------------------
def test_each_point_is_run_as_if_it_stood_in_the_diagram(folder: Path) -> None:
    study = _study()
    result = hb.study(study, processes=1)
    assert len(result.outcomes) == 6
    for outcome in result.outcomes:
        point = result.case_of(outcome).levels[0].values
        # the start has died out to exp(-2.5*4) at least
        assert result.value(outcome, "swing") == pytest.approx(_swing(2, point["spring.c"], point["damper.d"]), rel=2e-3)
    spread, = spreads(result)
    values = [result.value(o, "swing") for o in result.outcomes]
    assert (spread.mean, spread.deviation, spread.most) == (
        pytest.approx(np.mean(values)), pytest.approx(np.std(values, ddof=1)), max(values))
    head, rows = table(result)
    assert head == ["uncertain", "spring.c [kN/m]", "damper.d [kN*s/m]", "swing [mm]", "problem"]
    assert rows[0][1] * 1e3 == pytest.approx(result.case_of(result.outcomes[0]).levels[0].values["spring.c"])
    write_files(result, folder)
    pd.testing.assert_frame_equal(pd.read_parquet("table.parquet"), to_pandas(result))
    assert pd.read_csv("table.csv")["swing [mm]"].to_numpy() == pytest.approx(values, rel=1e-8)


def test_a_case_that_cannot_be_is_a_row(folder: Path) -> None:
    """A point outside the bounds of its component is refused as it would be in a diagram; a fault of the program is told."""
    study = _study(SAMPLE.replace("0.5 .. 2", "-1 .. 2").replace("latin_hypercube: 6, seed: 3", "sobol: 4"))
    study = replace(study, axes=(replace(study.axes[0], levels=tuple(reversed(study.axes[0].levels))),)) \
        if study.axes[0].levels[0].values["damper.d"] < 0 else study
    values = [level.values["damper.d"] for level in study.axes[0].levels]
    assert min(values) < 0 < values[0]
    problems = []
    for k, value in enumerate(values):
        found = worked(study, k, None)
        problems.append((value < 0, found.problem[:9]))
    assert set(problems) == {(True, "damper.d "), (False, "")}


@pytest.mark.long
@pytest.mark.skipif(program() is None, reason="no C compiler, or a CasADi with another SUNDIALS")
def test_cases_that_share_their_equations(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A study of many cases gives what each case gives by itself, to the tolerance of the solvers, with the same problems;
    to the last bit whatever was run before, in another process, and after its equations have been compiled."""
    text = SAMPLE.replace("latin_hypercube: 6", "latin_hypercube: 24").replace("0.5 .. 2", "-0.2 .. 2")
    study = _study(text.replace("{swing:", "{largest: {is: highest(motion), unit: mm}, peak: {is: peak(motion)}, swing:"))
    found = [worked(study, k, None) for k in range(24)]
    shared = shared_runs._KNOWN.shared[-1]
    assert shared.runs is not None and shared.runs.simulator.equations is not None
    compile_to_the_end(shared.runs.simulator.equations)
    again = {k: worked(study, k, None) for k in reversed(range(24))}
    sent = worked(study.packed()(17), 17, None)
    assert sent.values == found[17].values and shared_runs._KNOWN.shared[-1] is not shared
    assert shared.runs.simulator.driver is not None
    assert shared.runs.simulator.driver.stats()["equations"] == "machine code"
    monkeypatch.setattr(run_case, "measured_together", lambda *given: None)
    alone = [worked(study, k, None) for k in range(24)]
    assert {outcome.problem[:9] for outcome in alone} == {"", "damper.d "}
    for k in range(24):
        assert found[k].problem == again[k].problem == alone[k].problem
        assert found[k].values == again[k].values
        assert found[k].values == pytest.approx(alone[k].values, rel=1e-5)


# -- what is told of them ----------------------------------------------------------------------------------------------
def _shares() -> dict[str, float]:
    """Of the variance of c + 8 d, c normal about 40 with s = 4 cut at 2 s, d uniform from 0.5 to 2."""
    cut = 1 - 4 * math.exp(-2) / math.sqrt(2 * math.pi) / math.erf(math.sqrt(2))
    parts = {"spring.c": 16 * cut, "damper.d": 64 * 1.5**2 / 12}
    return {name: part / sum(parts.values()) for name, part in parts.items()}


@pytest.mark.long
def test_indices_of_a_linear_number(folder: Path) -> None:
    found, = indices(hb.study(_linear("{sobol_indices: 64}"), processes=1))
    wanted = _shares()
    assert (found.parameters, found.number) == (tuple(wanted), 64)
    for k, name in enumerate(found.parameters):
        # the estimator of first order scatters by some var/sqrt(64)
        assert found.first[k] == pytest.approx(wanted[name], abs=0.15)
        assert found.total[k] == pytest.approx(wanted[name], abs=0.05)
        assert found.total_interval[k][0] < wanted[name] < found.total_interval[k][1]


def test_slopes_are_exact(folder: Path) -> None:
    linear, = slopes(hb.study(_linear("local"), processes=1))
    assert dict(zip(linear.parameters, linear.share, strict=True)) == pytest.approx(_shares(), rel=1e-9)
    assert linear.value == pytest.approx(48)
    assert dict(zip(linear.parameters, linear.percent, strict=True)) == pytest.approx({"spring.c": 0.4, "damper.d": 0.08})
    result = hb.study(_study(SAMPLE.replace("{latin_hypercube: 6, seed: 3}", "local")), processes=1)
    found, = slopes(result)
    swing = dict(zip(found.parameters, found.percent, strict=True))
    assert swing["spring.c"] == pytest.approx((_swing(2, 40.2e3, 1e3) - _swing(2, 39.8e3, 1e3)), rel=0.02)
    assert swing["damper.d"] == pytest.approx((_swing(2, 40e3, 1005) - _swing(2, 40e3, 995)), rel=0.02)


def test_one_at_a_time_moves_to_both_ends(folder: Path) -> None:
    result = hb.study(_study(SAMPLE.replace("{latin_hypercube: 6, seed: 3}", "one_at_a_time")), processes=1)
    (_, rows), = swings(result, "swing")
    told = {row.parameter: (row.low, row.high) for row in rows}
    assert told["damper.d"] == pytest.approx((_swing(2, 40e3, 500), _swing(2, 40e3, 2e3)), rel=2e-3)
    assert told["spring.c"] == pytest.approx((_swing(2, 32e3, 1e3), _swing(2, 48e3, 1e3)), rel=2e-3)
    assert [row.value for row in rows] == pytest.approx([_swing(2, 40e3, 1e3)] * 2, rel=2e-3)


# -- the command -------------------------------------------------------------------------------------------------------
def test_the_worst_case_is_found_by_gradients(folder: Path) -> None:
    """At 3 Hz the worst spring is the one that resonates, the worst damper the weakest."""
    code, told = _called("sweep", "isolator.yaml", "--over", "spring.c=30 .. 50 kN/m", "--over", "damper.d=0.6 .. 2 kN*s/m",
                         "--over", "f=3 Hz", "--measure", "rms(motion) in mm", "--from", "4 s", "--worst", "highest")
    row, = told["rows"]
    grid = {(c, d): _swing(3, c, d) for c in np.linspace(30e3, 50e3, 201) for d in (600, 1000, 2000)}
    worst = max(grid, key=grid.__getitem__)
    assert code == 0
    assert row["rms(motion) [mm]"] == pytest.approx(grid[worst], rel=0.01)
    assert row["damper.d [kN*s/m]"] == pytest.approx(0.6, rel=1e-3)
    assert row["spring.c [kN/m]"] == pytest.approx(worst[0] / 1e3, rel=0.03)  # a flat top


@pytest.mark.long
def test_a_grid_is_drawn_and_can_be_gone_on_with(folder: Path) -> None:
    code, told = _called("sweep", "isolator.yaml", "--over", "f=1 .. 3 Hz; 3", "--over", "damper.d=0.5 kN*s/m, 1 kN*s/m",
                         "--measure", "rms(motion) in mm", "--from", "4 s", "--processes", "1", "--plot", "motion")
    assert code == 0
    assert {Path(str(path)).name for path in told["files"]} == {
        "table.csv", "table.parquet", "study.json", "signals.csv",
        *(f"{name}{suffix}" for name in ("curves", "map", "signals") for suffix in (".svg", ".png"))}
    rows = told["rows"]
    assert [row["rms(motion) [mm]"] for row in rows] == pytest.approx(
        [_swing(f, 40e3, d) for f in (1, 2, 3) for d in (500, 1000)], rel=0.02)
    before = {path.name: path.stat().st_mtime_ns for path in (folder / "isolator_sweep" / "done").iterdir()}
    assert _called("study", "isolator_sweep/study.yaml", "--output", "isolator_sweep")[1]["rows"] == rows
    assert before == {path.name: path.stat().st_mtime_ns for path in (folder / "isolator_sweep" / "done").iterdir()}


def test_other_values_of_a_sweep_stand_in_a_diagram_of_its_own(folder: Path) -> None:
    words = ("sweep", "isolator.yaml", "--set", "damper.d=0.5 kN*s/m", "--over", "f=1 Hz, 2 Hz", "--measure",
             "rms(motion) in mm", "--from", "4 s", "--processes", "1")
    code, told = _called(*words)
    assert (code, told["study"]) == (0, "sweep of isolator")
    assert [row["rms(motion) [mm]"] for row in told["rows"]] == pytest.approx(
        [_swing(f, 40e3, 500) for f in (1, 2)], rel=0.02)
    assert hb.load(folder / "isolator_sweep" / "isolator_set.yaml").settings["damper.d"].value.text == "0.5 kN*s/m"
    code, told = _called(*words[:2], "--set", "damper.e=1 N", *words[4:])
    assert (code, told["problems"][0]["code"]) == (1, "setting-unknown")


@pytest.mark.long
def test_many_lines_are_told_by_colours_and_what_breaks_out_does_not_hide_the_rest(folder: Path) -> None:
    _called("sweep", "isolator.yaml", "--over", "f=1 .. 6 Hz; 3", "--over", "damper.d=0.05 .. 20 kN*s/m; 11", "--measure",
            "rms(motion) in mm", "--until", "1 s", "--processes", "1", "--plot", "motion")
    result = hb.study(folder / "isolator_sweep" / "study.yaml", processes=1)
    for picture in result.study.pictures:
        if picture.kind != "map":
            figure = plot_study(result, picture)
            bars = [axes.get_ylabel() for axes in figure.axes[1:]]
            assert (bars, figure.legends) == (["damper.d [kN·s/m]" if picture.kind == "curves" else "f [Hz]"], [])
    few = replace(result, outcomes=tuple(o for o in result.outcomes if result.case_of(o).levels[1].value < 1e3))
    assert len(plot_study(few, next(p for p in result.study.pictures if p.kind == "curves")).axes) == 1
    first, *rest = result.outcomes
    wide = replace(result, outcomes=(replace(first, values={"rms(motion)": 1e3 * first.values["rms(motion)"]}), *rest))
    curves = next(p for p in result.study.pictures if p.kind == "curves")
    assert plot_study(wide, curves).axes[0].get_yscale() == "log"


@pytest.mark.parametrize(("kind", "pictures"), [
    pytest.param("sobol_indices:8", {"histogram", "indices"}, marks=pytest.mark.long), ("local", {"indices", "tornado"}),
    pytest.param("one_at_a_time", {"tornado"}, marks=pytest.mark.long)])
def test_pictures_of_samples(folder: Path, kind: str, pictures: set[str]) -> None:
    code, told = _called("sweep", "isolator.yaml", "--over", "spring.c=40 kN/m +- 20 %", "--over", "f=1 Hz, 2 Hz",
                         "--measure", "rms(motion)", "--sample", kind, "--until", "1 s", "--processes", "1")
    assert code == 0
    files = [Path(str(path)) for path in told["files"]]
    assert {path.stem for path in files if path.suffix == ".png"} == pictures
    assert all(path.stat().st_size > 5_000 for path in files if path.suffix == ".png")


@pytest.mark.parametrize(("options", "code"), [
    (("--over", "spring.c=20 .. 60 kN/m"), "over-open"), (("--over", "spring.c"), "over-form"),
    (("--over", "f=1 .. 3 Hz; many"), "number-wrong"), (("--over", "f=1 .. 3 Nm"), "unit-unknown"),
    (("--over", "f=1 .. 3 Hz", "--sample", "sobol:60"), "sample-unbalanced"),
    (("--over", "f=1 .. 3 Hz", "--sample", "sobol"), "sample-unknown"),
    (("--over", "f=1 .. 3 Hz", "--sample", "dice:6"), "sample-unknown"),
    (("--over", "f=1 Hz, 3 Hz", "--sample", "sobol:8"), "sample-nothing"),
    (("--over", "g=1 .. 3 Hz", "--sample", "local"), "parameter-unknown"),
    (("--over", "f=1 .. 3 Hz", "--worst", "lowest", "--measure", "rms(motion)"), "worst-many"),
    (("--over", "f=1 Hz", "--scheduler", "tcp://127.0.0.1:9"), "scheduler-silent")])
def test_wrong_sweeps_are_refused(folder: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], code: str
                                  ) -> None:
    monkeypatch.setattr("heavebond.core.cluster.PATIENCE", 0.5)
    exit_code, told = _called("sweep", "isolator.yaml", "--measure", "largest(motion)", *options)
    assert (exit_code != 0, code in [p["code"] for p in told["problems"]]) == (True, True)


@pytest.mark.parametrize(("old", "new", "code"), [
    ("{latin_hypercube: 6, seed: 3}", "sobol", "sample-unknown"),
    ("{latin_hypercube: 6, seed: 3}", "{sobol: 6}", "sample-unbalanced"),
    ("latin_hypercube: 6", "latin_hypercube: some", "count-wrong"), ("latin_hypercube", "latin_hypercub", "sample-unknown"),
    ("40 kN/m +- 20 %", "40 kN/m", "not-a-range"), ("40 kN/m +- 20 %", "40 mm +- 20 %", "unit-wrong"),
    ("spring.c: 40", "spring.d: 40", "setting-unknown"),
    ("evaluate:", "pictures: {t: {tornado: [swing]}}\nevaluate:", "picture-sample"),
    ("evaluate:", "pictures: {t: {map: [swing]}}\nevaluate:", "picture-axis"),
    ("  uncertain:", "  other: {sample: local, over: {f: 1 .. 2 Hz}}\n  uncertain:", "axes-samples")])
def test_wrong_samples_are_refused_with_a_place(folder: Path, old: str, new: str, code: str) -> None:
    assert old in SAMPLE
    with pytest.raises(hb.ModelError) as caught:
        hb.study(_study(SAMPLE.replace(old, new)), processes=1)
    assert [p.place.file for p in caught.value.problems if p.place] == ["study.yaml"] * len(caught.value.problems)
    assert code in [p.code for p in caught.value.problems]


def test_a_task_carries_its_own_case_only(folder: Path) -> None:
    """However many points a sample has; each case is the same as in the whole study."""
    few, many = (_study(SAMPLE.replace("latin_hypercube: 6", f"latin_hypercube: {n}")) for n in (6, 600))
    packed = many.packed()
    assert len(pickle.dumps(packed(599))) < 1.02 * len(pickle.dumps(few.packed()(5)))
    alone = pickle.loads(pickle.dumps(packed(577))).study
    assert len(alone.cases) == 1
    assert alone.case(577).levels[0].settings == many.case(577).levels[0].settings
    assert worked(packed(577), 577, None).values == worked(many, 577, None).values
    # what all cases share is unpacked once
    assert packed(3).study.model is packed(4).study.model


# -- workers that die --------------------------------------------------------------------------------------------------
def _dies(study: hb.Study, number: int, procedure: Procedure | None) -> Outcome:
    """Case 2 kills its process, for ever; case 4 once."""
    if number == 2 or (number == 4 and not Path("died").exists()):
        Path("died" if number == 4 else "dead").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return worked(study, number, procedure)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed otherwise here")
def test_a_process_that_dies_costs_its_case_only(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "worked", _dies)
    result = hb.study(_study(), folder=folder / "out", processes=2)
    assert Path("died").exists() and Path("dead").exists()
    assert [o.case for o in result.outcomes] == list(range(6))
    assert [o.case for o in result.outcomes if o.problem] == [2]
    assert result.outcomes[2].problem == campaign.DIED
    assert spreads(result)[0].failed == 1
    monkeypatch.setattr(campaign, "worked", worked)
    again = hb.study(_study(), folder=folder / "out", processes=1)  # what failed is tried again, the others are kept
    assert not any(o.problem for o in again.outcomes)
    assert [o.values for o in again.outcomes if o.case != 2] == [o.values for o in result.outcomes if o.case != 2]


@pytest.mark.long
def test_a_worker_of_a_cluster_that_is_killed_costs_its_task_only(folder: Path) -> None:
    from heavebond.core.cluster import Cluster

    study = _study(SAMPLE.replace("latin_hypercube: 6", "latin_hypercube: 24"))
    here = hb.study(study, processes=1)
    killed: list[int] = []
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        def tell(text: str) -> None:
            if text.startswith("12 of 24") and not killed:
                killed.append(next(iter(local.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        with Cluster(local.scheduler_address) as cluster:
            assert cluster.number == 2
            result = hb.study(study, executor=cluster, progress=tell)
    assert killed
    assert [o.values for o in result.outcomes] == [o.values for o in here.outcomes]


_BEGUN, _END = threading.Event(), threading.Event()  # of the work of a worker that is a thread of this process


def _until_the_end() -> None:
    _BEGUN.set()
    _END.wait(60)


def test_a_cluster_whose_workers_are_busy_is_told_from_one_without_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    from heavebond.core.cluster import Cluster

    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as local, \
            distributed.Client(local.scheduler_address, set_as_default=False) as other:
        _BEGUN.clear()
        _END.clear()
        busy = other.submit(_until_the_end, pure=False)  # a future that is let go of would be given up
        assert _BEGUN.wait(60)
        try:
            monkeypatch.setattr("heavebond.core.cluster.PATIENCE", 1.0)
            with pytest.raises(hb.UsageError, match="answers within 1 s"):
                Cluster(local.scheduler_address)
        finally:
            _END.set()
        busy.result(60)


@pytest.mark.long
def test_a_cluster_that_loses_all_of_its_workers_is_not_waited_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from heavebond.core.cluster import Cluster

    monkeypatch.setattr("heavebond.core.parallel.LISTEN", 0.2)
    study = _study(SAMPLE.replace("latin_hypercube: 6", "latin_hypercube: 24"))
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as local:
        def tell(text: str) -> None:
            if text.startswith("4 of 24"):
                local.scale(0)  # returns before the worker is gone, which may do all of the cases meanwhile
                until = time.monotonic() + 60
                while cluster.client.nthreads() and time.monotonic() < until:
                    time.sleep(0.05)

        with Cluster(local.scheduler_address) as cluster:
            # not before: the first answer of a worker, which imports the package, may take longer on a busy computer
            monkeypatch.setattr("heavebond.core.cluster.PATIENCE", 2.0)
            with pytest.raises(hb.UsageError, match="has lost all of its workers"):
                hb.study(study, folder=folder / "out", executor=cluster, progress=tell)
    again = hb.study(study, folder=folder / "out", processes=1)  # what was done is kept
    assert len(again.outcomes) == 24 and not any(o.problem for o in again.outcomes)
