"""Records as loggers write them: several files and rates, gaps, outliers, clocks that disagree, sensors that count, and
records without a partner. The machine is a mass on a spring and a damper on a moving foot; its records are runs of it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat
from scipy.signal import lfilter

import heavebond as hb
from heavebond.cli import main
from heavebond.estimation.comparison import compare
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.estimation.fitting import fit
from heavebond.estimation.records import correlation_time, measure, merged

Array = np.ndarray[Any, np.dtype[np.float64]]
MODEL = """
model: rig
components:
  foot:   {is: PositionSource, u: "=10 mm*sin(2*pi*time/0.7 s) + 8 mm*sin(2*pi*time/0.31 s)"}
  spring: {is: Spring, c: 1.2 kN/m}
  damper: {is: Damper, d: 12 N*s/m}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  base: [foot.a, spring.a, damper.a]
  load: [spring.b, damper.b, cart.a]
initial: {load.x: 0 m, load.v: 0 m/s}
"""
X_NOISE, F_NOISE = 2e-4, 0.3
EXPERIMENT = """
experiment: rig
model: rig.yaml
records:
  one: {file: one.csv, use: fit%(record)s}
time: {column: t, unit: s}
inputs:
  foot.u: {column: u, unit: m, interpolation: spline%(input)s}
outputs:
  load.x:   {column: x, unit: m%(x)s}
  spring.F: {column: F, unit: N, noise: 0.3 N%(F)s}
free:
  spring.c: 0.8 .. 2 kN/m
  damper.d: 5 .. 20 N*s/m
"""


@cache
def truth() -> dict[str, Array]:
    """Times every 1 ms over 8 s, foot and load in m, spring force in N."""
    run = hb.simulate(hb.loads(MODEL), until=8.0, every=1e-3)
    return {"t": run.time, **{name: np.asarray(run[path]) for name, path in (
        ("u", "base.x"), ("x", "load.x"), ("F", "spring.F"))}}


def record(every: int = 20, seed: int = 1) -> dict[str, Array]:
    """A sample every so many ms, with noise on x and F."""
    found = {name: values[::every].copy() for name, values in truth().items()}
    random = np.random.default_rng(seed)
    found["x"] += X_NOISE * random.standard_normal(len(found["t"]))
    found["F"] += F_NOISE * random.standard_normal(len(found["t"]))
    return found


def write(path: Path, columns: Mapping[str, Array]) -> None:
    """A CSV file with an empty cell where a value is NaN."""
    cells = [[f"{v:.9g}" if np.isfinite(v) else "" for v in values] for values in columns.values()]
    rows = [",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def experiment(folder: Path, columns: Mapping[str, Array] | None = None, **entries: str) -> Experiment:
    """The rig beside `columns`; `record`, `input`, `x` and `F` are further entries of these."""
    if columns is not None:
        write(folder / "one.csv", columns)
    (folder / "rig.yaml").write_text(MODEL, encoding="utf-8")
    given = {key: f", {entries[key]}" if key in entries else "" for key in ("record", "input", "x", "F")}
    if "noise" not in entries.get("x", ""):
        given["x"] += ", noise: 0.2 mm"
    (folder / "rig_beside.yaml").write_text(EXPERIMENT % given, encoding="utf-8")
    return load_experiment(folder / "rig_beside.yaml")


def notes(found: hb.Comparison) -> str:
    return "\n".join(found.records["one"].notes)


# chi-square per sample of n samples scatters by sqrt(2/n): 0.06 for 400, 0.09 for 250; asked is within 4 of these
def near_noise(chi2: float, n: int) -> bool:
    return abs(chi2 - 1) < 4 * np.sqrt(2 / n)


# -- what is held out of a lone record -----------------------------------------------------------------------------------
def later(found: hb.Comparison) -> Array:
    """Which samples of load.x are held out."""
    part = found.records["one"].validate
    assert part is not None
    return part.channels["load.x"].counts


def test_the_last_third_of_a_lone_record_is_held_out_after_a_correlation_time(tmp_path: Path) -> None:
    """8 s, of which the last third begins at 5.33 s; the channels swing at 1 to 2 Hz, so that the gap is a fraction of a
    second."""
    found = compare(experiment(tmp_path, record()))
    part = found.records["one"]
    assert part.validate is not None and part.validate.use == "validate"
    assert [p.name for p in found.parts] == ["one", "one, held out"]
    gap = max(correlation_time(c.time, c.measured) for c in part.channels.values())
    assert 0.04 < gap < 1
    for name, channel in part.channels.items():
        checking, time = part.validate.channels[name], channel.time
        assert time[channel.counts][-1] == pytest.approx(16 / 3, abs=0.02)
        assert time[checking.counts][0] == pytest.approx(16 / 3 + gap, abs=0.02) and checking.counts[-1]
        assert not (channel.counts & checking.counts).any()
        # the model is right and runs through all: each part sees its own noise
        assert near_noise(channel.chi2, int(channel.counts.sum())) and near_noise(checking.chi2, int(checking.counts.sum()))
    assert "one correlation time, are left out of both" in notes(found)
    assert found.as_dict()["one"]["validate"]["channels"]["load.x"]["samples"] == int(checking.counts.sum())


def test_correlation_time_by_hand() -> None:
    """exp(-t/T) falls below 1/e at T: a lag of first order driven by white noise. White noise: one sample."""
    random, t = np.random.default_rng(5), np.arange(20_000) * 0.01
    x = lfilter([1.0], [1.0, -np.exp(-0.01 / 0.5)], random.normal(size=len(t)))
    assert correlation_time(t, x) == pytest.approx(0.5, rel=0.2)
    assert correlation_time(t, random.normal(size=len(t))) == pytest.approx(0.01)
    assert correlation_time(t, np.ones(len(t))) == pytest.approx(0.01)


def test_held_out_samples_are_not_fitted(tmp_path: Path) -> None:
    """Samples held out, and those in the gap, are moved by 5 mm: the fit does not see it, the held-out figures do."""
    columns = record()
    clean = fit(experiment(tmp_path, columns))
    fitted, out = clean.after.records["one"].channels["load.x"].counts, later(clean.after)
    columns["x"][~fitted] += 5e-3
    moved = fit(experiment(tmp_path, columns))
    # the gap follows from the readings, what is fitted does not
    assert moved.values == pytest.approx(clean.values, rel=1e-6)
    assert clean.samples == 2 * int(fitted.sum())
    assert moved.values["spring.c"] == pytest.approx(1200, rel=0.01)
    before, after = (f.after.records["one"].validate for f in (clean, moved))
    assert before is not None and after is not None
    assert near_noise(before.channels["load.x"].chi2, int(out.sum())) and after.channels["load.x"].error > 4e-3


def test_with_a_record_to_validate_nothing_is_held_out(tmp_path: Path) -> None:
    found = experiment(tmp_path, record(), record="to: 4 s}\n  two: {file: one.csv, use: validate, from: 4 s")
    compared = compare(found)
    assert all(part.validate is None for part in compared.records.values())
    assert all(c.counts.all() for part in compared.parts for c in part.channels.values())


def test_a_short_record_is_not_split(tmp_path: Path) -> None:
    found = compare(experiment(tmp_path, record(), record="to: 0.5 s"))
    assert found.records["one"].validate is None
    assert "too short to hold a part of it out" in notes(found)


@pytest.mark.long
def test_multiple_shooting_leaves_out_what_does_not_count(tmp_path: Path) -> None:
    columns = record()
    columns["x"][::2] = np.nan
    columns["x"][columns["t"] >= 16 / 3] += 5e-3
    found = fit(experiment(tmp_path, columns), segments=4)
    assert found.values["spring.c"] == pytest.approx(1200, rel=0.01)


# -- different rates -----------------------------------------------------------------------------------------------
def test_a_channel_counts_where_it_was_sampled(tmp_path: Path) -> None:
    columns = record()
    columns["F"][np.arange(401) % 5 != 0] = np.nan
    columns["u"][np.arange(401) % 2 != 0] = np.nan
    found = measure(experiment(tmp_path, columns), experiment(tmp_path).records["one"])
    assert [len(c.time) for c in found.channels.values()] == [401, 81]
    assert len(found.grid) == 401
    channels = compare(experiment(tmp_path)).records["one"].channels
    assert near_noise(channels["spring.F"].chi2, int(channels["spring.F"].counts.sum()))
    assert np.allclose(channels["spring.F"].time, columns["t"][::5])
    assert "gap" not in notes(compare(experiment(tmp_path)))
    assert fit(experiment(tmp_path)).samples == int(sum(c.counts.sum() for c in channels.values()))


def test_channels_from_other_files_with_their_own_time(tmp_path: Path) -> None:
    """Foot in milliseconds at 125 Hz, force at 10 Hz in a file that begins later, load at 50 Hz in the record itself."""
    fast, slow, columns = record(8), record(100, seed=2), record()
    write(tmp_path / "foot.csv", {"ms": 1000 * fast["t"], "u": fast["u"]})
    write(tmp_path / "force.csv", {"when": slow["t"][5:], "F": slow["F"][5:] / 1000})
    found = experiment(tmp_path, {"t": columns["t"], "x": columns["x"]},
                       input="file: foot.csv, time: {column: ms, unit: ms}", record="outputs: {spring.F: {file: force.csv}}",
                       F="time: {column: when, unit: s}")
    text = (tmp_path / "rig_beside.yaml").read_text(encoding="utf-8")
    (tmp_path / "rig_beside.yaml").write_text(text.replace("unit: N,", "unit: kN,"), encoding="utf-8")
    found = load_experiment(tmp_path / "rig_beside.yaml")
    part = compare(found).records["one"]
    assert part.channels["spring.F"].time[0] == pytest.approx(0.5) and len(part.channels["spring.F"].time) == 76
    assert part.channels["load.x"].counts.sum() == pytest.approx(267, abs=2)
    for channel in part.channels.values():
        assert near_noise(channel.chi2, int(channel.counts.sum()))
    assert fit(found).values["damper.d"] == pytest.approx(12, rel=0.03)


def test_a_record_from_matlab_with_two_rates(tmp_path: Path) -> None:
    columns = record()
    savemat(tmp_path / "one.mat", {"t": columns["t"][:, None], "u": columns["u"], "log": {"x": columns["x"]},
                                   "ms": 1000 * columns["t"][::5], "F": columns["F"][::5], "note": "dry run"})
    experiment(tmp_path, F="time: {column: ms, unit: ms}")
    text = (tmp_path / "rig_beside.yaml").read_text(encoding="utf-8")
    (tmp_path / "rig_beside.yaml").write_text(text.replace("one.csv", "one.mat").replace("column: x", "column: log.x"),
                                              encoding="utf-8")
    part = compare(tmp_path / "rig_beside.yaml").records["one"]
    assert [len(c.time) for c in part.channels.values()] == [401, 81]
    assert all(near_noise(c.chi2, int(c.counts.sum())) for c in part.channels.values())


def test_the_union_of_times_joins_what_differs_by_rounding() -> None:
    known = np.array([0.0, 0.1, 0.2, 0.3])
    other = np.array([0.05, 0.1 + 1e-12, 0.2])
    grid, (first, second) = merged([known[:1], other], [known])
    assert grid.tolist() == [0.0, 0.05, 0.1, 0.2]
    assert first.tolist() == [0] and second.tolist() == [1, 2, 3]


def test_a_record_ends_where_its_input_does(tmp_path: Path) -> None:
    columns = record()
    columns["u"][:3] = np.nan
    columns["u"][-2:] = np.nan
    part = compare(experiment(tmp_path, columns)).records["one"]
    assert part.channels["load.x"].time[[0, -1]] == pytest.approx([0.06, 7.96])
    columns["u"][:30] = np.nan
    with pytest.raises(hb.DataError, match=r"foot.u is known from 0.6 s to 7.96 s(.|\n)*Write `from: 0.6 s` at"):
        compare(experiment(tmp_path, columns))


# -- gaps ----------------------------------------------------------------------------------------------------------
def test_gaps_in_outputs_do_not_count_and_are_told(tmp_path: Path) -> None:
    columns = record()
    columns["x"][100:150] = np.nan
    found = compare(experiment(tmp_path, columns))
    assert len(found.records["one"].channels["load.x"].time) == 351
    assert "one.csv: 1 gap in the samples of 'x', the longest from 1.98 s to 3 s" in notes(found)
    assert near_noise(found.records["one"].channels["load.x"].chi2, 230)


def test_gaps_are_told_once_for_a_file(tmp_path: Path) -> None:
    columns = record()
    columns["x"][100:150] = columns["F"][100:150] = np.nan
    columns["F"][200:220] = np.nan
    told = notes(compare(experiment(tmp_path, columns)))
    assert told.count("gap") == 1
    assert "one.csv: 2 gaps in the samples of 'x', 'F', the longest from 1.98 s to 3 s; nothing is compared there" in told


def test_every_command_works_across_bridged_gaps(tmp_path: Path) -> None:
    """The inputs that `localize` estimates have the times of the samples, whose gaps are joined too."""
    columns = record()
    columns["x"][200:230] = columns["F"][200:230] = columns["u"][100:104] = np.nan
    given = experiment(tmp_path, columns, input="gaps: bridge")
    assert compare(given).records["one"].channels["load.x"].time.size == 371
    found = hb.localize(given)
    assert not found.missing and found.chi2 < 1.5
    tried = hb.attempt(given, "CoulombFriction", ["base", "load"])
    assert near_noise(tried.ladder[-1].chi2_fit, 480)


def test_a_gap_in_several_inputs_of_a_file_is_told_once(tmp_path: Path) -> None:
    columns = record()
    columns["u"][100:108] = np.nan
    columns["d"] = columns["u"].copy()
    experiment(tmp_path, columns)
    text = EXPERIMENT % {"record": "", "input": "", "x": "", "F": ""}
    second = "inputs:\n  damper.d: {column: d, unit: N*s/m, interpolation: linear}\n"
    (tmp_path / "both.yaml").write_text(text.replace("inputs:\n", second))
    with pytest.raises(hb.DataError) as caught:
        measure(given := load_experiment(tmp_path / "both.yaml"), given.records["one"])
    assert [p.code for p in caught.value.problems] == ["record-gap"]
    assert "a gap: 'd', 'u' have no value between the times 1.98 (line 101) and 2.16 (line 110)" in str(caught.value)
    assert "`gaps: bridge` at these inputs" in str(caught.value)


def test_a_gap_in_an_input_must_be_bridged_by_word(tmp_path: Path) -> None:
    columns = record()
    columns["u"][100:108] = np.nan
    with pytest.raises(hb.DataError) as caught:
        compare(experiment(tmp_path, columns))
    assert [p.code for p in caught.value.problems] == ["record-gap"]
    text = str(caught.value)
    assert "'u' has no value between the times 1.98 (line 101) and 2.16 (line 110); elsewhere it has one every 0.02" in text
    assert "gaps: bridge" in text
    part = compare(experiment(tmp_path, columns, input="gaps: bridge")).records["one"]
    # the spline through the hole is off by some mm for a while
    assert part.channels["load.x"].error < 3e-3
    for window in ("from: 3 s", "to: 1.9 s"):  # the gap lies outside
        compare(experiment(tmp_path, columns, record=window))


def test_missing_rows_are_a_gap_of_the_input(tmp_path: Path) -> None:
    columns = {name: np.delete(values, np.s_[200:210]) for name, values in record().items()}
    with pytest.raises(hb.DataError, match=r"no value between the times 3.98 \(line 201\) and 4.2 \(line 202\)"):
        compare(experiment(tmp_path, columns))
    columns = {name: np.delete(values, np.s_[200:203]) for name, values in record().items()}
    compare(experiment(tmp_path, columns))  # three missing samples are not worth a word


@pytest.mark.parametrize(("rows", "noise", "code", "said"), [
    (np.s_[:], "noise: 1 mm", "record-channel-empty", "has no number in any of its 401 rows"),
    (np.s_[1:], "noise: 1 mm", "record-channel-short", "has 1 number, at least 2 are needed"),
    (np.s_[9:], "", "record-channel-short", "has 9 numbers, at least 10 are needed"),
])
def test_channels_without_samples(tmp_path: Path, rows: slice, noise: str, code: str, said: str) -> None:
    columns = record()
    columns["x"][rows] = np.nan
    with pytest.raises(hb.DataError) as caught:
        compare(estimated(tmp_path, columns) if not noise else experiment(tmp_path, columns))
    assert [p.code for p in caught.value.problems] == [code]
    assert said in str(caught.value)
    assert "rig_beside.yaml:" in str(caught.value)


def estimated(folder: Path, columns: Mapping[str, Array], **entries: str) -> Experiment:
    """The same without a given noise of x."""
    experiment(folder, columns, **entries)
    path = folder / "rig_beside.yaml"
    path.write_text(path.read_text(encoding="utf-8").replace(", noise: 0.2 mm", ""), encoding="utf-8")
    return load_experiment(path)


def test_nothing_between_from_and_to(tmp_path: Path) -> None:
    with pytest.raises(hb.DataError, match=r"rig_beside.yaml:5: record .one. has no rows between `from:` and `to:`; its "
                                           r"times go from 0 s to 8 s"):
        compare(experiment(tmp_path, record(), record="from: 90 s"))


def test_all_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    columns = record()
    columns["u"][100:120] = np.nan
    columns["F"][:] = np.nan
    text = EXPERIMENT.replace("column: x", "column: y")
    experiment(tmp_path, columns)
    (tmp_path / "two.yaml").write_text(text % dict.fromkeys(("record", "input", "x", "F"), ""), encoding="utf-8")
    with pytest.raises(hb.DataError) as caught:
        compare(tmp_path / "two.yaml")
    assert {p.code for p in caught.value.problems} == {"record-gap", "record-column-unknown", "record-channel-empty"}


# -- outliers ------------------------------------------------------------------------------------------------------
def test_outliers_are_told_and_dropped_on_request(tmp_path: Path) -> None:
    columns = record()
    spots = [33, 100, 101, 250, 399]
    columns["x"][spots] += [0.05, -0.06, -0.06, 0.03, 0.05]
    kept = compare(experiment(tmp_path, columns))
    channel = kept.records["one"].channels["load.x"]
    assert np.flatnonzero(channel.outlier).tolist() == spots
    assert channel.counts[[33, 250]].all() and channel.chi2 > 10
    assert "load.x: 5 samples are far from their neighbours, at 0.66 s, 2 s, 2.02 s, 5 s, 7.98 s: counted" in notes(kept)
    assert kept.as_dict()["one"]["channels"]["load.x"]["outliers"] == pytest.approx([0.66, 2, 2.02, 5, 7.98])
    assert kept.records["one"].channels["spring.F"].outlier.sum() == 0
    dropped = compare(experiment(tmp_path, columns, x="outliers: drop"))
    assert near_noise(dropped.records["one"].channels["load.x"].chi2, 260)
    assert "left out of all figures" in notes(dropped)
    found = fit(experiment(tmp_path, columns, x="outliers: drop"))
    assert found.samples == fit(experiment(tmp_path, columns)).samples - 4  # the last one is held out


def test_outliers_of_a_fast_channel_show_against_the_model(tmp_path: Path) -> None:
    """4 mm where the channel moves by up to 13 mm from one sample to the next, and 20 times the noise."""
    columns = record()
    columns["x"][[57, 201]] += 4e-3
    found = compare(experiment(tmp_path, columns))
    channel = found.records["one"].channels["load.x"]
    assert not channel.outlier.any()
    assert np.flatnonzero(channel.astray).tolist() == [57, 201]
    assert "load.x: 2 more samples far from the model where those around are not, at 1.14 s, 4.02 s;" in notes(found)
    assert "--robust" in notes(found)


# -- shifts in time ------------------------------------------------------------------------------------------------
def late_record(by: int, every: int = 20) -> dict[str, Array]:
    """x late by so many ms."""
    columns, whole = record(every), truth()["x"]
    index = np.clip(np.arange(0, len(whole), every) - by, 0, None)
    columns["x"] = whole[index] + X_NOISE * np.random.default_rng(5).standard_normal(len(index))
    return columns


@pytest.mark.parametrize("by", [30, 7, -30])
def test_a_late_channel_is_told(tmp_path: Path, by: int) -> None:
    columns = late_record(by) if by > 0 else late_record(0)
    if by < 0:  # the other way round: all else comes later
        columns = {name: values[:-100] for name, values in columns.items()}
        columns["x"] = truth()["x"][-by::20][:301] + X_NOISE * np.random.default_rng(5).standard_normal(301)
    found = compare(experiment(tmp_path, columns))
    late = found.records["one"].channels["load.x"].late
    assert late is not None and late.explains(X_NOISE)
    assert late.seconds == pytest.approx(by / 1000, abs=4 * late.deviation)
    assert late.deviation < 4e-4
    assert f"load.x looks {'late' if by > 0 else 'early'} by" in notes(found) and "spring.F looks" not in notes(found)
    other = found.records["one"].channels["spring.F"].late
    assert other is not None and not other.noticeable


def test_a_late_channel_that_is_offset_too_is_not_late_alone(tmp_path: Path) -> None:
    """An offset as large as what the delay does is not little, although the delay is found beside a free offset."""
    columns = late_record(30)
    columns["x"] = columns["x"] + 50 * X_NOISE
    found = compare(experiment(tmp_path, columns))
    late = found.records["one"].channels["load.x"].late
    assert late is not None and late.seconds == pytest.approx(0.03, abs=4 * late.deviation)
    assert not late.explains(X_NOISE) and "load.x looks late" not in notes(found)
    assert "a shift in time would reduce the error: load.x late by 30" in notes(found)


def test_a_declared_shift_is_applied(tmp_path: Path) -> None:
    columns = late_record(30)
    before = compare(experiment(tmp_path, columns)).records["one"].channels["load.x"]
    found = experiment(tmp_path, columns, x="shift: 30 ms")
    after = compare(found).records["one"]
    assert before.chi2 > 100 and near_noise(after.channels["load.x"].chi2, 266)
    assert after.channels["load.x"].time[0] == pytest.approx(0.04)  # before that it shows what was before the record
    assert "looks late" not in "\n".join(after.notes)
    assert fit(found).values["spring.c"] == pytest.approx(1200, rel=0.01)
    # 30 ms are no multiple of the sample interval: both channels' times are on the grid
    assert len(measure(found, found.records["one"]).grid) == 401 + 399
    shifted = compare(experiment(tmp_path, columns, x="shift: 10 ms"))
    assert "late by 20" in notes(shifted) and "write `shift: 30" in notes(shifted)
    assert "instead of `shift: 10 ms`" in notes(shifted)


def test_a_shift_by_whole_samples_needs_no_further_times(tmp_path: Path) -> None:
    """t - shift differs from the times of the rows by rounding: the run has no two stops that are nearly the same."""
    found = experiment(tmp_path, late_record(40), x="shift: 40 ms")
    assert len(measure(found, found.records["one"]).grid) == 401
    assert near_noise(compare(found).records["one"].channels["load.x"].chi2, 266)


def test_missing_physics_is_not_called_a_shift() -> None:
    """The rig that lacks friction: phases are far off, and it is said that this is no proof of a shift."""
    said = "\n".join(compare("passive_rig/friction").records["train"].notes)
    assert "looks late" not in said and "looks early" not in said
    assert "missing physics shifts phases too" in said
    # with its true parameters the model leaves noise, and nothing is said
    right = compare("passive_rig/nothing", parameters={"gas.c": 47e3, "damper.d": 46e3})
    assert [r.notes for r in right.records.values()] == [(), ()]


def test_the_command_tells_what_was_noticed(tmp_path: Path) -> None:
    columns = late_record(30)
    columns["F"][[33, 200]] += 200
    experiment(tmp_path, columns)
    answer = CliRunner().invoke(main, ["compare", str(tmp_path / "rig_beside.yaml"), "--json", str(tmp_path / "c.json")])
    assert answer.exit_code == 0, answer.output
    said = " ".join(answer.output.split("noticed")[1].split())
    assert "spring.F: 2 samples are far from their neighbours, at 0.66 s, 4 s: counted in all figures" in said
    assert "load.x looks late by 30" in said and "one, held out" in answer.output
    figures = json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))["records"]["one"]
    assert figures["channels"]["load.x"]["late"]["seconds"] == pytest.approx(0.03, abs=1e-3)
    assert figures["channels"]["spring.F"]["outliers"] == pytest.approx([0.66, 4])
    assert figures["validate"]["use"] == "validate" and len(figures["notes"]) == 3
    answer = CliRunner().invoke(main, ["fit", str(tmp_path / "rig_beside.yaml")])
    assert "one, held out (validate)" in answer.output and "noticed" in answer.output


# -- sensors that count --------------------------------------------------------------------------------------------
def test_a_sensor_that_counts(tmp_path: Path) -> None:
    columns = record()
    step = 2e-3  # ten times the noise
    columns["x"] = np.round(columns["x"] / step) * step
    found = compare(estimated(tmp_path, columns))
    channel = found.records["one"].channels["load.x"]
    assert channel.step == pytest.approx(step, rel=1e-6)
    assert channel.noise >= step / np.sqrt(12)
    assert "load.x: its readings go in steps of 2 mm; rounding alone is an error of 0.58 mm, counted in" in notes(found)
    assert 0.3 < channel.chi2 < 1.3
    given = compare(experiment(tmp_path, columns))
    assert "0.58 mm, more than the noise given" in notes(given)
    fine = record()
    fine["x"] = np.round(fine["x"] / 5e-5) * 5e-5  # a quarter of the noise
    assert compare(estimated(tmp_path, fine)).records["one"].channels["load.x"].step == 0


# -- the start -----------------------------------------------------------------------------------------------------
@pytest.mark.long
def test_a_state_that_begins_elsewhere_is_told_with_what_to_write(tmp_path: Path) -> None:
    assert "begins at" not in notes(compare(experiment(tmp_path, record())))
    columns = {name: values[60:] for name, values in record().items()}  # from 1.2 s on, moving
    columns["t"] = columns["t"] - columns["t"][0]
    said = notes(compare(experiment(tmp_path, columns)))
    first = f"{1e3 * columns['x'][0]:.1f}"
    written = float(first) / 1e3
    assert f"load.x begins at {written:g} m in the record, at 0 m in the model: if the machine was in another state" in said
    assert f"write `initial: {{load.x: {written:g} m}}` at this record" in said
    assert "spring.F begins" not in said  # it depends on the input, and on a stiffness that may be wrong
    words = hb.diagnose(tmp_path / "rig_beside.yaml", classes=["dry friction"], steps=1, number=1).words
    assert any(w.startswith("one: load.x begins at") for w in words)
    told = compare(experiment(tmp_path, columns, record=f"initial: {{load.x: {written:g} m, load.v: 0 m/s}}"))
    assert "begins at" not in notes(told)


def test_a_first_sample_that_is_dropped_is_no_start(tmp_path: Path) -> None:
    columns = record()
    columns["x"][0] = 0.05
    assert "load.x begins at 0.05 m in the record" in notes(compare(experiment(tmp_path, columns)))
    dropped = notes(compare(experiment(tmp_path, columns, x="outliers: drop")))
    assert "left out of all figures" in dropped and "begins at" not in dropped


def test_a_steady_start_holds_measured_inputs_still(tmp_path: Path) -> None:
    # the record begins in motion: a damper that felt the slope of its spline would hold the load off its equilibrium
    t = np.arange(0.0, 2.0, 0.02)
    write(tmp_path / "deck.csv", {"t": t, "u": 0.01 * np.sin(3 * t)})
    (tmp_path / "rig.yaml").write_text("""
model: rig
components:
  deck:   {is: PositionSource, u: {file: deck.csv, column: u, unit: m, interpolation: spline, time: {column: t, unit: s}}}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 200 N*s/m}
  load:   {is: Mass, m: 10 kg}
  weight: {is: Weight, m: =load.m}
nodes: {deck: [deck.a, spring.a, damper.a], load: [spring.b, damper.b, load.a, weight.a]}
initial: {start: steady}
simulate: {until: 1 s, every: 20 ms}
""", encoding="utf-8")
    run = hb.simulate(hb.load(tmp_path / "rig.yaml"), sensitivities=["spring.c"])
    assert run["deck.v"][0] == pytest.approx(0.03, rel=1e-3)
    assert run["load.x"][0] == pytest.approx(-10 * 9.81 / 1e3, rel=1e-8)
    assert run.sensitivity("load.x", "spring.c")[0] == pytest.approx(10 * 9.81 / 1e3**2, rel=1e-6)
    assert run["damper.F"][0] == pytest.approx(-200 * 0.03, rel=1e-3)  # the run itself begins with the inputs moving


def test_a_record_without_a_steady_start_is_named_with_its_inputs(tmp_path: Path) -> None:
    """A command that is not zero as the record begins keeps a body in motion: not to be seen in the diagram itself."""
    t = np.arange(0.0, 2.0, 0.02)
    write(tmp_path / "still.csv", {"t": t, "u": 2 * np.sin(3 * t), "x": 0 * t})
    write(tmp_path / "pushed.csv", {"t": t, "u": 2 + np.sin(3 * t), "x": 0 * t})
    (tmp_path / "rig.yaml").write_text("""
model: rig
components: {push: {is: ForceSource, u: 0 N}, load: {is: Mass, m: 10 kg}}
nodes: {load: [push.a, load.a]}
initial: {start: steady, load.x: 0 m}
""", encoding="utf-8")
    (tmp_path / "measured.yaml").write_text("""
experiment: measured
model: rig.yaml
records: {still: {file: still.csv, use: fit}, pushed: {file: pushed.csv, use: validate}}
time: {column: t, unit: s}
inputs: {push.u: {column: u, unit: N, interpolation: linear}}
outputs: {load.x: {column: x, unit: m, noise: 1 mm}}
""", encoding="utf-8")
    with pytest.raises(hb.StartError) as refused:
        hb.compare(tmp_path / "measured.yaml")
    assert "push.u is held at 2 N, its value at the start\n" in str(refused.value)
    assert "in record pushed\n" in str(refused.value)
