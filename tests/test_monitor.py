"""Monitoring: the rate of false alarms beside simulation, the time of changes, records that cannot be used, clusters."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from oscillator import STEP, write_experiment, write_record
from scipy.stats import binom

import heavebond as hb
from heavebond.core.errors import UsageError
from heavebond.monitoring.change_detection import cusum, find_change, threshold


@pytest.mark.parametrize("kind", ["mean", "size"])
@pytest.mark.parametrize("rate", [0.2, 0.02])
def test_a_sum_exceeds_its_threshold_as_often_as_stated(kind: str, rate: float) -> None:
    count, records = 250, 4000
    v = np.random.default_rng(5).standard_normal((records, count))
    increments = v / 2 - 1 / 8 if kind == "mean" else (v**2 / 2 - np.log(2)) / 2
    limit = threshold(kind, count, rate)
    alarms = sum(cusum(row).max() > limit for row in increments)
    # the chain has cells of finite width: its rate is exact to a tenth
    assert binom.ppf(1e-4, records, 0.9 * rate) <= alarms <= binom.ppf(1 - 1e-4, records, 1.1 * rate)


def test_the_rate_of_the_bank_is_at_most_the_stated_one() -> None:
    random, time = np.random.default_rng(6), np.arange(200.0)
    alarms = sum(find_change(time, {n: random.standard_normal(200) for n in "ab"}, 0.1) is not None for _ in range(1000))
    assert binom.ppf(1e-4, 1000, 0.05) <= alarms <= binom.ppf(1 - 1e-4, 1000, 0.1)


@pytest.mark.parametrize(("scale", "shift"), [(2.0, 0.0), (1.0, 1.0)])
def test_the_change_is_found_near_its_time(scale: float, shift: float) -> None:
    """The interval contains the change of innovations with another size about as often as stated; a shift is dated well."""
    random, time, errors, inside = np.random.default_rng(7), np.arange(1000.0), [], 0
    for _ in range(60):
        v = {n: random.standard_normal(1000) for n in "ab"}
        for values in v.values():
            values[600:] = values[600:] * scale + shift
        change = find_change(time, v, 0.01)
        assert change is not None
        if change.alarm >= 600:
            errors.append(abs(change.time - 600))
            inside += change.low <= 600 <= change.high
    assert len(errors) >= 58  # at most one false alarm of 60 is probable
    assert np.median(errors) < 20  # 2 % of the record
    assert inside > 0.8 * len(errors) or shift


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """An experiment and a folder with sound, changed and faulty records."""
    write_experiment(tmp_path)
    folder = tmp_path / "records"
    folder.mkdir()
    for seed in range(3):
        write_record(folder / f"sound_{seed}.csv", seed)
    write_record(folder / "softer.csv", 3, count=400, stiffness={250: 42.0})
    sound = (folder / "sound_0.csv").read_text().splitlines()
    (folder / "empty.csv").write_text("")
    (folder / "without_v.csv").write_text("\n".join(",".join(line.split(",")[:3]) for line in sound))
    frozen = [line if k < 80 else ",".join([*line.split(",")[:2], *sound[80].split(",")[2:3], line.split(",")[3]])
              for k, line in enumerate(sound)]
    (folder / "frozen.csv").write_text("\n".join(frozen))
    (folder / "notes.md").write_text("no record")
    return tmp_path


def test_each_record_of_a_folder_has_its_outcome(fleet: Path) -> None:
    found = hb.monitor(fleet / "rig.yaml", fleet / "records", processes=1)
    assert {r.name: r.outcome for r in found.records} == {
        "empty": "unusable", "frozen": "unusable", "softer": "changed", "sound_0": "in the model", "sound_1": "in the model",
        "sound_2": "in the model", "without_v": "unusable"}
    assert "no rows" in found["empty"].reason and "no column 'v'" in found["without_v"].reason
    assert "stays at exactly" in found["frozen"].reason
    change = found["softer"]
    assert change.earliest <= change.change <= change.latest <= change.alarm
    assert abs(change.change - 250 * STEP) < 0.02 * 400 * STEP
    table = found.to_pandas()
    assert table.loc[table.name == "sound_0", "nis"].item() == pytest.approx(1, abs=0.2)  # 400 samples: 3 deviations
    found.save(fleet / "table.parquet")
    found.save(fleet / "table.csv")
    import pandas as pd

    for file in (pd.read_parquet(fleet / "table.parquet"), pd.read_csv(fleet / "table.csv")):
        assert file.name.tolist() == [r.name for r in found.records]
        assert file.change.tolist() == pytest.approx([r.change for r in found.records], nan_ok=True)


def test_the_window_of_a_change_begins_at_the_estimated_state_with_the_parameters_from_before(fleet: Path) -> None:
    found = hb.monitor(fleet / "rig.yaml", fleet / "records", processes=1)
    window = found.window("softer")
    record = window.records["softer"]
    assert record.begin == pytest.approx(found["softer"].earliest)
    stiffness = window.free["spring.c"].range
    assert stiffness.nominal is not None and stiffness.high - stiffness.low < 20  # it was 40 .. 60 N/m
    assert stiffness.low - 1 < 50 < stiffness.high + 1
    truth = write_record(fleet / "again.csv", 3, count=400, stiffness={250: 42.0})
    start = hb.compare(window).records["softer"].result
    at = round(record.begin / STEP)
    assert start["body.x"][0] == pytest.approx(truth[at, 0], abs=2e-3)  # the noise of one sample
    # the model fits the time after the change with another stiffness only
    fit = hb.fit(window, free={"spring.c": "30 .. 60 N/m"})
    assert fit.values["spring.c"] == pytest.approx(42, rel=0.03)
    with pytest.raises(UsageError, match="does not leave the model"):
        found.window("sound_0")


def test_processes_give_the_same_table(fleet: Path) -> None:
    alone, two = (hb.monitor(fleet / "rig.yaml", fleet / "records", processes=n).to_pandas() for n in (1, 2))
    assert alone.equals(two)


def test_wrong_arguments_are_refused(fleet: Path) -> None:
    (fleet / "none").mkdir()
    for folder, rate, message in ((fleet / "none", 0.01, "has no records"), (fleet / "nowhere", 0.01, "is not a folder"),
                                  (fleet / "rig.yaml", 0.01, "is not a folder"), (fleet / "records", 0, "between 0 and 1")):
        with pytest.raises(UsageError, match=message):
            hb.monitor(fleet / "rig.yaml", folder, rate=rate)
    shutil.copy(fleet / "records" / "sound_0.csv", fleet / "records" / "sound_0.txt")
    with pytest.raises(UsageError, match="several records have one name"):
        hb.monitor(fleet / "rig.yaml", fleet / "records")
