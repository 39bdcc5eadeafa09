"""Monitoring: the rate of false alarms beside simulation, the time of changes, records that cannot be used, clusters."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from oscillator import STEP, write_experiment, write_record
from scipy.stats import binom, multivariate_normal

import heavebond as hb
from heavebond.cli import main
from heavebond.core.cluster import Cluster
from heavebond.core.errors import UsageError
from heavebond.monitoring.change_detection import cusum, find_change, threshold
from heavebond.monitoring.onset import Fault, FilteredWindow, likelihood_ratios


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


def test_the_likelihood_of_an_onset_is_that_of_the_whole_record() -> None:
    """Beside the density of all samples from their dense covariance: a system of two states with process noise, an input of
    each kind that acts on states and channels from sample j on, samples that are missing."""
    random, count, size, channels = np.random.default_rng(8), 7, 2, 2
    time, noise = np.cumsum(random.uniform(0.5, 1.5, count)), np.array([0.3, 0.0])
    phi, h = random.normal(size=(count - 1, size, size)), random.normal(size=(count, channels, size))
    used = np.ones((count, channels))
    used[3, 0] = 0
    h *= used[:, :, None]
    gamma, d = random.normal(size=(count - 1, size)), random.normal(size=(count, channels)) * used
    faults = [Fault("w", "w", gamma, d, False)]
    cases = [(0, 2.0, 1.3), (0, 0.5, np.inf)]
    # all samples as linear functions of independent standard numbers: start, process noise, noise of samples
    start = random.normal(size=(size, size))
    states = [np.hstack([start, np.zeros((size, size * (count - 1)))])]
    for i in range(count - 1):
        states.append(phi[i] @ states[-1])
        states[-1][:, size * (i + 1):size * (i + 2)] += np.diag(np.sqrt(noise * (time[i + 1] - time[i])))
    sound = np.concatenate([h[i] @ states[i] for i in range(count)])
    keep = used.ravel() > 0
    y = random.normal(size=count * channels) * 2 * keep
    # the filter: predictions, covariances, corrections
    s, p, e, k, covariances = np.zeros(size), start @ start.T, [], [], []
    for i in range(count):
        variance = h[i] @ p @ h[i].T + np.eye(channels)
        gain = p @ h[i].T @ np.linalg.inv(variance)
        e.append(y[2 * i:2 * i + 2] - h[i] @ s)
        k.append(gain @ e[-1])
        covariances.append(p)
        s, p = s + k[-1], p - gain @ h[i] @ p
        if i < count - 1:
            s, p = phi[i] @ s, phi[i] @ p @ phi[i].T + np.diag(noise) * (time[i + 1] - time[i])
    window = FilteredWindow(time, np.array(covariances), np.array(e), np.array(k), phi, h, noise)
    ratios = likelihood_ratios(window, faults, cases, 1)
    null = multivariate_normal(cov=(sound @ sound.T + np.eye(len(y)))[keep][:, keep]).logpdf(y[keep])
    for n, (_, sigma, tau) in enumerate(cases):
        for j in range(count):
            covariance = sigma**2 * np.exp(-np.abs(time[j:, None] - time[j:]) / tau)
            response = np.zeros((count * channels, count - j))
            for m in range(j, count):
                moved = np.zeros(size)
                response[2 * m:2 * m + 2, m - j] += d[m]
                for i in range(m, count - 1):
                    moved = phi[i] @ moved + (gamma[i] if i == m else 0)
                    response[2 * i + 2:2 * i + 4, m - j] += h[i + 1] @ moved
            total = sound @ sound.T + np.eye(len(y)) + response @ covariance @ response.T
            expected = multivariate_normal(cov=total[keep][:, keep]).logpdf(y[keep]) - null
            assert ratios[j, n] == pytest.approx(expected, abs=1e-8)  # rounding


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
    assert record.begin is not None
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


@pytest.mark.long
def test_processes_give_the_same_table(fleet: Path) -> None:
    alone, two = (hb.monitor(fleet / "rig.yaml", fleet / "records", processes=n).to_pandas() for n in (1, 2))
    assert alone.equals(two)
    softer, sound = (fleet / "records" / f"{name}.csv" for name in ("softer", "sound_1"))
    one, listed = (hb.monitor(fleet / "rig.yaml", records, processes=1)
                   for records in (str(softer), [softer, sound, softer]))
    assert one.to_pandas().equals(alone[alone.name == "softer"].reset_index(drop=True))
    assert [r.name for r in listed.records] == ["softer", "sound_1"]  # the order of the list, a file named twice once
    assert listed["sound_1"] == next(r for r in hb.monitor(fleet / "rig.yaml", sound, processes=1).records)


def test_wrong_arguments_are_refused(fleet: Path) -> None:
    (fleet / "none").mkdir()
    for records, rate, message in (
            (fleet / "none", 0.01, "has no records"), (fleet / "nowhere", 0.01, "neither a file nor a folder"),
            (fleet / "rig.yaml", 0.01, "is not a record"), (fleet / "records", 0, "between 0 and 1"),
            ([], 0.01, "the list of records is empty"), (3, 0.01, "neither a path nor a list"),
            ([fleet / "records", 3], 0.01, "neither a path nor a list"),
            ([fleet / "records", fleet / "later.csv"], 0.01, "later.csv' is neither a file nor a folder")):
        with pytest.raises(UsageError, match=message):
            hb.monitor(fleet / "rig.yaml", records, rate=rate)
    for share in (50, -0.1, "5000 %"):  # 50 % without its sign
        with pytest.raises(UsageError, match="must be between 0 and 10"):
            hb.monitor(fleet / "rig.yaml", fleet / "records", start_deviation=share)
    shutil.copy(fleet / "records" / "sound_0.csv", fleet / "records" / "sound_0.txt")
    with pytest.raises(UsageError, match="several records have one name"):
        hb.monitor(fleet / "rig.yaml", fleet / "records")

def test_the_command_writes_table_page_pictures_and_estimates(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(fleet)
    run = CliRunner().invoke(main, ["monitor", "rig.yaml", "records", "--diagnose", "0", "--processes", "1", "--estimates",
                                    "--walk", "spring.c=0 N/m", "--json", "told.json"])
    assert run.exit_code == 1
    assert "1 of 7 records left the model, and 3 could not be used" in run.output
    told = json.loads(Path("told.json").read_text())
    assert not told["ok"] and {r["outcome"] for r in told["records"]} == {"in the model", "changed", "unusable"}
    target = fleet / "rig_monitor"
    assert {f.name for f in target.iterdir()} == {
        "monitor.parquet", "monitor.html", "softer.png", *(f"{n}_estimate.parquet" for n in (
            "softer", "sound_0", "sound_1", "sound_2", "frozen"))}
    page = (target / "monitor.html").read_text()
    assert '<a href="softer.png">softer</a>' in page and "stays at exactly" in page
    import pandas as pd

    estimate = pd.read_parquet(target / "sound_0_estimate.parquet")
    assert {"body.x", "body.x std", "spring.c", "body.v innovation"} <= set(estimate.columns)
    (fleet / "good").mkdir()
    shutil.copy(fleet / "records" / "sound_1.csv", fleet / "good")
    run = CliRunner().invoke(main, ["monitor", "rig.yaml", "good", "--output", "out"])
    assert run.exit_code == 0, run.output
    run = CliRunner().invoke(main, ["monitor", "rig.yaml", "good", "--output", "good"])
    assert run.exit_code == 2 and "is the folder of the records" in run.output


@pytest.mark.long
def test_a_cluster_gives_the_same_table(fleet: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as local, \
            Cluster(local.scheduler_address) as cluster:
        found = hb.monitor(fleet / "rig.yaml", fleet / "records", executor=cluster)
    assert found.to_pandas().equals(hb.monitor(fleet / "rig.yaml", fleet / "records", processes=1).to_pandas())
