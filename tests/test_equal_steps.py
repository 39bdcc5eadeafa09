"""Files of a fixed rate without times: `time: {every: 10 ms}` counts their rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import DataError, HeavebondError, ModelError
from heavebond.estimation.records import measure
from heavebond.studio.evidence import written_experiment

MODEL = """model: low_pass
components: {lag: {is: FirstOrderLag, T_1: 0.2 s, u: 0}}
nodes: {y: [lag.y]}
show: {reading: {is: lag.y, unit: "1"}}
simulate: {until: 2 s, every: 20 ms}
"""
EXPERIMENT = """experiment: e
model: low_pass.yaml
records: {r: {file: r.csv, use: fit}}
time: TIME
inputs: {lag.u: {column: u, unit: "1", interpolation: linear}}
outputs: {lag.y: {column: y, unit: "1", noise: 0.001}}
"""
TIME = np.arange(201) * 0.02
INPUT = np.sin(3 * TIME)
LINEAR = (3 * 0.02)**2 / 8  # largest error of the linear interpolation of the input; that of the output is smaller


def reading(time: np.ndarray) -> np.ndarray:
    """The steady and the transient part of the low-pass of sin(3 t), which begins at 0."""
    w, lag = 3.0, 0.2
    return (np.sin(w * time) - w * lag * np.cos(w * time) + w * lag * np.exp(-time / lag)) / (1 + (w * lag)**2)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "low_pass.yaml").write_text(MODEL)
    rows = [f"{u:.6f},{y:.6f}" for u, y in zip(INPUT, reading(TIME), strict=True)]
    (tmp_path / "r.csv").write_text("u,y\n# a comment is no row\n" + "\n".join(rows) + "\n\n")
    return tmp_path


def experiment(folder: Path, time: str, more: str = "") -> Path:
    path = folder / "e.yaml"
    path.write_text(EXPERIMENT.replace("TIME", time) + more)
    return path


def test_rows_at_a_fixed_rate_are_compared(folder: Path) -> None:
    channel = hb.compare(experiment(folder, "{every: 20 ms}")).records["r"].channels["lag.y"]
    assert channel.error < LINEAR
    wrong = hb.compare(experiment(folder, "{every: 30 ms}")).records["r"].channels["lag.y"]
    assert wrong.error > 0.1


def test_the_first_row_may_be_later_and_the_record_is_cut_by_time(folder: Path) -> None:
    path = experiment(folder, "{every: 20 ms, from: 2 s}")
    path.write_text(path.read_text().replace("use: fit", "use: fit, from: 2.5 s, to: 3.01 s"))
    loaded = hb.load_experiment(path)
    measured = measure(loaded, loaded.records["r"])
    assert measured.grid[[0, -1]] == pytest.approx([2.5, 3.0]) and len(measured.grid) == 26
    assert measured.channels["lag.y"].measured[0] == pytest.approx(reading(TIME)[25], abs=1e-6)


def test_a_channel_and_an_input_of_another_file_have_their_own_rate(folder: Path) -> None:
    """The input every 10 ms without times, the channel every 20 ms with times."""
    time = np.arange(401) * 0.01
    (folder / "u.csv").write_text("u\n" + "\n".join(f"{u:.6f}" for u in np.sin(3 * time)) + "\n")
    (folder / "r.csv").write_text("t,y\n" + "".join(f"{t:g},{y:.6f}\n" for t, y in zip(TIME, reading(TIME), strict=True)))
    path = experiment(folder, "{column: t, unit: s}")
    path.write_text(path.read_text().replace("{column: u,", "{file: u.csv, time: {every: 10 ms}, column: u,"))
    assert hb.compare(path).records["r"].channels["lag.y"].error < LINEAR
    path.write_text(path.read_text().replace("column: t, unit: s", "every: 20 ms").replace("every: 10 ms", "column: no"
                                                                                        ", unit: s"))
    with pytest.raises(DataError, match=r"\[record-no-time\]") as caught:
        hb.compare(path)
    assert "time: {every: 10 ms}" in str(caught.value)


def test_an_input_of_a_diagram(folder: Path) -> None:
    text = MODEL.replace("u: 0", 'u: {file: r.csv, column: u, unit: "1", interpolation: linear, time: {every: 20 ms}}')
    (folder / "low_pass.yaml").write_text(text)
    result = hb.simulate(hb.load(folder / "low_pass.yaml"))
    assert result["lag.y"][-1] == pytest.approx(reading(np.array([2.0]))[0], abs=LINEAR)


def test_an_experiment_that_extends_keeps_or_replaces_the_times(folder: Path) -> None:
    experiment(folder, "{every: 20 ms}")
    for more, every in (("", 0.02), ("time: {every: 5 ms}\n", 0.005), ("time: {column: t, unit: ms}\n", None)):
        (folder / "f.yaml").write_text(f"experiment: f\nextends: e.yaml\n{more}")
        assert hb.load_experiment(folder / "f.yaml").time.every == every


@pytest.mark.parametrize(("time", "code", "said"), [
    ("{every: 0 s}", "step-not-positive", "every: 10 ms"), ("{every: 100 Hz}", "unit-wrong", "s is needed"),
    ("{every: 10 ms, column: t}", "key-unknown", "no entry 'column'"), ("{unit: s}", "key-missing", "every: 10 ms"),
    ("20 ms", "not-a-mapping", "every: 10 ms"), ("{every: 10}", "unit-missing", "'10 s'")])
def test_mistakes(folder: Path, time: str, code: str, said: str) -> None:
    with pytest.raises(ModelError) as caught:
        hb.load_experiment(experiment(folder, time))
    assert code in [p.code for p in caught.value.problems] and said in str(caught.value)


def test_a_file_without_times_is_told_what_to_write(folder: Path) -> None:
    """No column increases; the name of the time is not in the file, or is that of a column which is none."""
    for time, code in (("{column: t, unit: s}", "record-no-time"), ("{column: u, unit: s}", "record-time-decreasing")):
        with pytest.raises(DataError) as caught:
            hb.compare(experiment(folder, time))
        assert [p.code for p in caught.value.problems] == [code] and "`time: {every: 10 ms}`" in str(caught.value)


def test_times_of_a_clock_do_not_fit_rows_without_times(folder: Path) -> None:
    (folder / "u.csv").write_text("when,u\n2024-05-01 12:00:00,0\n2024-05-01 12:00:10,1\n")
    path = experiment(folder, "{every: 20 ms}")
    path.write_text(path.read_text().replace("{column: u,", "{file: u.csv, time: {column: when, unit: s}, column: u,"))
    with pytest.raises(DataError, match=r"'when' of 'u.csv' holds dates, 'r.csv' has none") as caught:
        hb.compare(path)
    assert "\0" not in str(caught.value)


def test_a_rate_in_the_wrong_unit_is_noticed(folder: Path) -> None:
    loaded = hb.load_experiment(experiment(folder, "{every: 20 s}"))
    assert any("`every: 20 ms` in place of `every: 20 s`" in note for note in measure(loaded, loaded.records["r"]).notes)


# -- proposals -----------------------------------------------------------------------------------------------------------
@pytest.fixture
def named(folder: Path) -> Path:
    """The record with the names of the diagram."""
    (folder / "r.csv").write_text((folder / "r.csv").read_text().replace("u,y\n", "lag_u,reading\n"))
    return folder


def new(*words: str) -> object:
    return CliRunner().invoke(main, ["new", "new.yaml", "--from", "low_pass.yaml", *words])


def test_new_proposes_a_fixed_rate(named: Path) -> None:
    answer = new("r.csv")
    assert answer.exit_code != 0 and "[record-no-time]" in answer.stderr and "--every '10 ms'" in answer.stderr
    for every, code in (("20 kHz", "unit-wrong"), ("0 s", "step-not-positive"), ("soon", "not-a-quantity")):
        assert f"[{code}]" in new("r.csv", "--every", every).stderr
    assert not (named / "new.yaml").exists()
    answer = new("r.csv", "--every", "20 ms")
    assert answer.exit_code == 0, answer.output
    assert "time: {every: 20 ms}" in (named / "new.yaml").read_text()
    assert hb.compare("new.yaml").records["r"].channels["lag.y"].error < LINEAR


def test_new_lists_columns_that_it_does_not_recognise(folder: Path) -> None:
    """Neither the names nor the units say what they are: the text is written, with the columns as comments."""
    answer = new("r.csv", "--every", "20 ms")
    assert answer.exit_code == 0, answer.output
    text = (folder / "new.yaml").read_text()
    assert "#   VARIABLE: {column: u, unit: UNIT}\n#   VARIABLE: {column: y, unit: UNIT}\n" in text and "lag.y [1]" in text
    assert "give under `inputs:` the column of a measured input (lag.u)" in answer.stdout


def test_new_states_where_times_do_not_increase(folder: Path) -> None:
    rows = [f"{int(k * 0.02)},{k}" for k in range(100)]
    (folder / "r.csv").write_text("Time [s],y\n" + "\n".join(rows) + "\n")
    answer = new("r.csv")
    assert "r.csv:3: the time 0 in 'Time [s]'" in answer.stderr and "[record-time-repeated]" in answer.stderr


def test_a_gap_at_a_fixed_rate_cuts_the_proposed_record(named: Path) -> None:
    lines = (named / "r.csv").read_text().split("\n")
    lines[12:22] = ["," + line.split(",")[1] for line in lines[12:22]]
    (named / "r.csv").write_text("\n".join(lines))
    new("r.csv", "--every", "20 ms")
    assert "from: 0.4 s, to: 4 s" in (named / "new.yaml").read_text()


def test_a_count_of_rows_is_no_time_without_a_word(named: Path) -> None:
    lines = (named / "r.csv").read_text().replace("# a comment is no row\n", "").split("\n")
    (named / "r.csv").write_text("\n".join(["n," + lines[0], *(f"{k},{line}" for k, line in enumerate(lines[1:-2]))]))
    assert "'n' counts the rows" in new("r.csv").stdout
    (named / "new.yaml").unlink()
    assert "counts the rows" not in new("r.csv", "--every", "20 ms").stdout


def test_the_form_of_the_studio(folder: Path) -> None:
    columns = [{"column": "u", "role": "input", "target": "lag.u", "unit": "1", "interpolation": "linear"},
               {"column": "y", "role": "output", "target": "lag.y", "unit": "1"}]

    def written(every: str) -> str:
        return written_experiment(str(folder / "n.yaml"), "n.yaml", "n", str(folder / "low_pass.yaml"),
                                  {str(folder / "r.csv"): "fit"}, columns, {}, every)[0]["text"]

    assert "time: {every: 20 ms}" in written("20 ms")
    for every, code in (("", "record-no-time"), ("2 m", "unit-wrong")):
        with pytest.raises(HeavebondError) as caught:
            written(every)
        assert caught.value.problems[0].code == code
