"""Spectra, waves and rainflow cycles beside closed forms, and `heavebond signal` on runs, saved runs and records."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.cli import main
from heavebond.records.spectra import EvenSignal, SignalAnalysis, evenly, rainflow_cycles, read_courses

TIME = np.arange(0, 200, 0.05)


def _swinging(values: np.ndarray) -> SignalAnalysis:
    return SignalAnalysis(EvenSignal("x", "m", TIME, values))


def _called(*arguments: str) -> tuple[int, dict[str, dict[str, dict[str, float]]]]:
    with pytest.raises(SystemExit) as caught:
        main(["signal", *arguments, "--json", "told.json"])
    assert isinstance(caught.value.code, int)
    told: dict[str, dict[str, dict[str, float]]] = json.loads(Path("told.json").read_text(encoding="utf-8"))
    return caught.value.code, told


def test_a_sine_has_its_height_and_period() -> None:
    found = _swinging(3 + 2 * np.sin(2 * math.pi * TIME / 8))
    assert found.mean == pytest.approx(3, abs=1e-3)
    # Hann windows over whole and part periods: the variance of a line is kept within a percent
    assert found.spectrum.significant == pytest.approx(4 * 2 / math.sqrt(2), rel=0.01)
    for period in (found.spectrum.peak_period, found.spectrum.mean_period, found.spectrum.crossing_period):
        assert period == pytest.approx(8, rel=0.02)  # half a line of the spectrum
    assert len(found.waves.heights) == 23  # between the upward crossings at 8 s and 192 s
    assert found.waves.significant == (pytest.approx(4, rel=1e-4), pytest.approx(8, rel=1e-6))
    assert found.cycles.ranges.max() == pytest.approx(4, rel=1e-4)
    # all ranges are 4 but for the first and last quarter: 25 cycles in 200 s
    assert found.cycles.equivalent(3, 25) == pytest.approx(4, rel=0.01)


def test_two_sines_have_their_moments() -> None:
    a, f, b, g = 1.0, 0.1, 0.5, 0.45
    found = _swinging(a * np.sin(2 * math.pi * f * TIME) + b * np.sin(2 * math.pi * g * TIME + 1))
    known = found.spectrum
    assert known.moment(0) == pytest.approx((a**2 + b**2) / 2, rel=0.01)
    assert known.mean_period == pytest.approx((a**2 + b**2) / (a**2 * f + b**2 * g), rel=0.01)
    assert known.crossing_period == pytest.approx(math.sqrt((a**2 + b**2) / (a**2 * f**2 + b**2 * g**2)), rel=0.01)
    apart = known.frequency < 0.25
    width = known.frequency[1]
    # each line keeps its own energy
    assert known.density[apart].sum() * width == pytest.approx(a**2 / 2, rel=0.02)
    assert known.density[~apart].sum() * width == pytest.approx(b**2 / 2, rel=0.02)


def test_a_sea_has_the_height_and_the_periods_of_its_spectrum() -> None:
    sea = hb.loads("""model: sea
components:
  sea: {is: IrregularSea, H_s: 3 m, T_p: 10 s, gamma: 3.3, t_r: 1 s, n: 200}
  hull: {is: PositionSource}
nodes: {z: [sea.z, hull.u], hull: [hull.a]}
""")
    run = hb.simulate(sea, "3600 s", every="0.5 s")
    found = SignalAnalysis(evenly("z", "m", run.time, run["hull.x"]))
    # an hour holds some 400 waves: the variance of such a record scatters by a few percent
    assert found.spectrum.significant == pytest.approx(3, rel=0.04)
    assert found.spectrum.peak_period == pytest.approx(10, rel=0.05)
    # DNV-RP-C205, 3.5.5.5: T_z/T_p of a JONSWAP spectrum; its far tail is not among 200 sines
    ratio = 0.6673 + 0.05037 * 3.3 - 0.006230 * 3.3**2 + 0.0003341 * 3.3**3
    assert found.spectrum.crossing_period == pytest.approx(10 * ratio, rel=0.05)
    # Rayleigh: the highest third of the waves of a narrow spectrum are 4 sigma high, in a JONSWAP sea up to a tenth less
    assert 0.88 * 3 < found.waves.significant[0] < 1.04 * 3


def test_rainflow_counts_the_example_of_the_standard() -> None:
    """ASTM E1049-85, figure 6: a history of nine points."""
    found = rainflow_cycles(np.array([-2.0, 1, -3, 5, -1, 3, -4, 4, -2]))
    counts: dict[float, float] = {}
    for span, count in zip(found.ranges.tolist(), found.counts.tolist(), strict=True):
        counts[span] = counts.get(span, 0.0) + count
    assert counts == {3: 0.5, 4: 1.5, 6: 0.5, 8: 1.0, 9: 0.5}
    edges, classes = found.classes(9)
    assert (edges[-1], classes.sum()) == (9, found.number)


def test_what_an_integrator_leaves_on_a_straight_line_is_no_cycle() -> None:
    ramp = np.interp(np.arange(100), [0, 30, 70, 99], [0, 3, 3, 0]) + 1e-9 * (-1.0)**np.arange(100)
    assert rainflow_cycles(ramp).number == 1


def test_what_stands_still_and_what_is_short(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert _swinging(np.full(len(TIME), 7.0)).still
    Path("still.csv").write_text("t,x\n" + "".join(f"{k},5\n" for k in range(20)), encoding="utf-8")
    code, told = _called("still.csv", "--signal", "x", "--output", "still.png")
    assert (code, told["signals"]["x"]["mean"]) == (0, 5)
    assert "significant" not in told["signals"]["x"]
    Path("short.csv").write_text("t,x\n0,1\n1,2\n2,1\n", encoding="utf-8")
    with pytest.raises(hb.DataError, match="3 samples, 16 are needed"):
        read_courses(Path("short.csv"), ["x"])
    assert _called("still.csv", "--signal", "y")[0] == 1
    assert _called("still.csv", "--signal", "x", "--from", "3 m")[0] == 2
    assert _called("nothing.csv", "--signal", "x")[0] != 0


def test_runs_saved_runs_and_records_say_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = hb.simulate(hb.load("quarter_car"))
    run.save("car.parquet", ["suspension", "tyre_force"])
    drop = np.ones(len(run.time), dtype=bool)
    drop[200::7] = False  # a logger that leaves samples out
    rows = zip(run.time[drop], run.display["suspension"][drop], strict=True)
    Path("car.csv").write_text("time_s;travel (mm)\n" + "".join(f"{t};{x}\n" for t, x in rows), encoding="utf-8")
    options = ("--from", "0.5 s", "--until", "3 s")
    direct = _called("quarter_car", "--signal", "suspension", *options, "--output", "car.png")[1]["signals"]["suspension"]
    saved = _called("car.parquet", "--signal", "suspension", *options)[1]["signals"]["suspension"]
    record = _called("car.csv", "--signal", "travel", *options)[1]["signals"]["travel"]
    assert Path("car.png").stat().st_size > 10_000
    assert saved.keys() == direct.keys()
    for key in direct.keys() - {"spectrum", "ranges", "unit", "note"}:  # rounding of other last steps
        assert saved[key] == pytest.approx(direct[key], rel=1e-9)
    assert record["unit"] == "mm" and "even steps" in str(record["note"])
    for key in ("deviation", "largest_range", "significant"):
        assert record[key] == pytest.approx(direct[key], rel=1e-3)  # straight lines over 2 ms of a swing of a second


def test_a_segment_must_fit() -> None:
    course = EvenSignal("x", "m", TIME, np.sin(TIME))
    assert SignalAnalysis(course, 50.0).spectrum.frequency[1] == pytest.approx(1 / 50)
    with pytest.raises(hb.UsageError, match="does not fit"):
        _ = SignalAnalysis(course, 300.0).spectrum
