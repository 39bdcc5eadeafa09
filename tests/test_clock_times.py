"""Dates and times of day as the times of a record: read where they mean one thing, refused where they may mean two."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from heavebond.core.errors import HeavebondError
from heavebond.estimation.comparison import compare
from heavebond.records.clock_times import ClockProblem, read_clock

RIG = """
model: rig
components:
  foot:   {is: PositionSource, u: 0 m}
  spring: {is: Spring, c: 60 N/m}
  damper: {is: Damper, d: 5 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes: {base: [foot.a, spring.a, damper.a], load: [spring.b, damper.b, cart.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
"""
BESIDE = """
experiment: clocks
model: rig.yaml
records: {one: {file: log.csv, use: fit}}
time: {column: when, unit: %s}
inputs: {foot.u: {column: foot, unit: mm, interpolation: spline%s}}
outputs: {load.x: {column: cart, unit: mm, noise: 1 mm%s}}
"""


@pytest.mark.parametrize(("cells", "seconds"), [
    (["2024-05-01 12:00:03.250", "2024-05-01T12:00:03,5", "", "2024-05-02 00:00:00"], [0, 0.25, np.nan, 43196.75]),
    (["2024-05-01T12:00:03.25Z", "2024-05-01T14:00:04.25+02:00"], [0, 1]),
    (["2024/5/1 9:00", "2024/5/1 9:01"], [0, 60]),
    (["2024-02-28", "2024-02-29", "2024-03-01"], [0, 86400, 172800]),
    (["31.12.2023 23:59:59,999", "01.01.2024 00:00:00,001"], [0, 0.002]),
    (["05/01/2024 12:00:03", "05/01/2024 12:00:04"], [0, 1]),            # whichever is the day
    (["12/05/2024 12:00:00", "13/05/2024 12:00:00"], [0, 86400]),        # no month is the 13th
    (["04/30/2024 23:59:59", "05/01/2024 00:00:01"], [0, 2]),
    (["12:00:03", "12:00:03.000001"], [0, 1e-6]),
    (["23:59:59,5", "0:00:00", "0:00:01", "nan"], [0, 0.5, 1.5, np.nan]),  # past midnight
])
def test_moments_are_read(cells: list[str], seconds: list[float]) -> None:
    clock = read_clock(cells)
    # a microsecond of today counts: the difference is taken of whole nanoseconds
    assert clock.seconds(clock.first) == pytest.approx(seconds, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize(("cells", "row", "said"), [
    (["01/02/2024 12:00", "02/02/2024 12:00"], 0, "'01/02/2024 12:00' is ambiguous: day and month could be exchanged"),
    (["12:05", "12:06"], 0, "'12:05' may be hours and minutes, or minutes and seconds"),
    (["", "12:00:03", "12:00:61"], 2, "'12:00:61' is neither a number nor"),
    (["2024-05-01 12:00", "2024-05-32 12:00"], 1, "'2024-05-32 12:00' is neither a number nor"),
    (["2024-05-01 12:00", "noon"], 1, "'noon' is neither a number nor"),
    (["Wed May 1 12:00:03 2024"], 0, "'Wed May 1 12:00:03 2024' is neither a number nor"),
])
def test_what_may_be_two_moments_is_refused(cells: list[str], row: int, said: str) -> None:
    with pytest.raises(ClockProblem) as caught:
        read_clock(cells)
    assert caught.value.row == row and caught.value.message.startswith(said) and caught.value.hint


def written(folder: Path, begin: str | None, *, unit: str = "s", more: tuple[str, str] = ("", "")) -> Path:
    """A record of 6 s in log.csv whose times are dates from `begin` on (None: seconds), and the experiment on it."""
    time = np.arange(0, 6, 0.05)
    foot, cart = 20 * np.sin(2 * time), 21 * np.sin(2 * time - 0.1)
    when = [f"{t:.2f}" for t in time] if begin is None else \
        [f"{t:%Y-%m-%d %H:%M:%S.%f}" for t in pd.Timestamp(begin) + pd.to_timedelta(time, unit="s")]
    (folder / "log.csv").write_text("when,foot,cart\n" + "\n".join(
        f"{w},{f:.6f},{c:.6f}" for w, f, c in zip(when, foot, cart, strict=True)))
    (folder / "rig.yaml").write_text(RIG)
    (folder / "beside.yaml").write_text(BESIDE % (unit, *more))
    return folder / "beside.yaml"


def test_a_record_with_dates_is_the_same_as_one_in_seconds(tmp_path: Path) -> None:
    found = [compare(written(tmp_path, begin)).records["one"].channels["load.x"] for begin in (None, "2024-05-01 23:59:58")]
    assert found[1].time == pytest.approx(found[0].time, abs=1e-9)
    assert found[1].error == pytest.approx(found[0].error, rel=1e-6)


def test_files_of_one_clock_are_laid_over_each_other(tmp_path: Path) -> None:
    """A second file begins half a second later by the same clock; its channel and its input are where they were."""
    path = written(tmp_path, "2024-05-01 23:59:58")
    whole = compare(path).records["one"].channels["load.x"]
    lines = (tmp_path / "log.csv").read_text().splitlines()
    (tmp_path / "late.csv").write_text("\n".join([lines[0], *lines[11:]]))
    part = compare(written(tmp_path, "2024-05-01 23:59:58", more=("", ", file: late.csv"))).records["one"].channels["load.x"]
    assert part.time == pytest.approx(whole.time[10:], abs=1e-9)
    assert part.model == pytest.approx(whole.model[10:], rel=1e-6)
    (tmp_path / "early.csv").write_text("\n".join([lines[0], "2024-05-01 23:59:57.95,-2,0", *lines[1:]]))
    driven = compare(written(tmp_path, "2024-05-01 23:59:58", more=(", file: early.csv", ""))).records["one"]
    # the spline through one sample more differs a little near the begin
    assert driven.channels["load.x"].model == pytest.approx(whole.model, abs=0.05)


def test_dates_in_parquet(tmp_path: Path) -> None:
    path = written(tmp_path, None)
    whole = compare(path).records["one"].channels["load.x"]
    frame = pd.read_csv(tmp_path / "log.csv")
    frame["when"] = pd.Timestamp("2024-05-01 12:00", tz="Europe/Berlin") + pd.to_timedelta(frame["when"], unit="s")
    frame.set_index("when").to_parquet(tmp_path / "log.parquet")
    path.write_text(path.read_text().replace("log.csv", "log.parquet"))
    dated = compare(path).records["one"].channels["load.x"]
    assert dated.time == pytest.approx(whole.time, abs=1e-9) and dated.error == pytest.approx(whole.error, rel=1e-6)


def test_what_is_said_of_clocks_that_cannot_be_used(tmp_path: Path) -> None:
    def refused(path: Path, code: str) -> str:
        with pytest.raises(HeavebondError) as caught:
            compare(path)
        assert caught.value.problems[0].code == code
        return str(caught.value)

    said = refused(written(tmp_path, "2024-05-01", unit="min"), "record-clock-unit")
    assert "'when' of 'log.csv' holds times of a clock, which are counted in s, not in min" in said
    path = written(tmp_path, "2024-05-01", more=("", ", file: other.csv"))
    (tmp_path / "other.csv").write_text("when,cart\n12:00:00,1\n12:00:01,2\n")
    assert "holds times of day, 'when' of 'log.csv' does not" in refused(path, "record-clocks")
    (tmp_path / "log.csv").write_text("when,foot,cart\n01/02/2024 12:00,1,2\n02/02/2024 12:00,2,3\n")
    said = refused(written_only(tmp_path), "record-clock")
    assert "log.csv:2: the times in 'when' cannot be read: '01/02/2024 12:00' is ambiguous" in said
    (tmp_path / "log.csv").write_text("when,foot,cart\n0,1,2024-05-01\n1,2,2024-05-02\n")
    assert isinstance(refused(written_only(tmp_path), "record-column-text"), str)


def written_only(folder: Path) -> Path:
    """The plain experiment on whatever log.csv holds."""
    (folder / "beside.yaml").write_text(BESIDE % ("s", "", ""))
    return folder / "beside.yaml"
