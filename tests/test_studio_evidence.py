"""Records in the studio without a browser: files stored, columns proposed, comparisons and long computations with the
figures of the command line."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import UsageError
from heavebond.estimation.comparison import compare
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.proposed_experiment import IN_THE_FORM, Chosen, Records, experiment_text, propose
from heavebond.numerics.dae import assemble
from heavebond.records.measurements import read_table
from heavebond.studio import record_upload
from heavebond.studio.bench import view
from heavebond.studio.diagram_edits import with_records
from heavebond.studio.evidence import Evidence, written_experiment
from heavebond.studio.folder import Folder
from heavebond.studio.job import Job
from heavebond.studio.job_process import JobProcess
from heavebond.studio.long_jobs import KINDS, LongJob, LongJobs
from heavebond.studio.long_tasks import TASKS
from heavebond.studio.record_upload import plain_name, store

RIG = """\
model: rig
summary: A load on a spring and a damper below a deck that is moved.
components:
  shaker: {is: PositionSource, u: "=40 mm*sin(2*pi*time/2 s)"}
  spring: {is: Spring, c: 4 kN/m}
  damper: {is: Damper, d: 150 N*s/m}
  load:   {is: Mass, m: 100 kg}
nodes:
  deck: [shaker.a, spring.a, damper.a]
  load: [spring.b, damper.b, load.a]
initial: {load.x: 0 m, load.v: 0 m/s}
show:
  load:  {is: load.x, unit: mm}
  force: {is: shaker.a.f, unit: N}
simulate: {until: 5 s, every: 20 ms}
"""
HIDDEN = """\
model: hidden
extends: rig.yaml
components: {guide: {is: CoulombFriction, F_c: 25 N}}
nodes: {deck: [+guide.a], load: [+guide.b]}
"""
EXPERIMENT = """\
experiment: rig, measured
model: rig.yaml
records:
  monday:  {file: data/monday.csv, use: fit}
  tuesday: {file: data/tuesday.csv, use: validate}
time: {column: time_s, unit: s}
inputs:
  shaker.u: {column: deck_m, unit: m, interpolation: spline}
outputs:
  load.x:     {column: load_m, unit: m, noise: 0.2 mm}
  shaker.a.f: {column: force_N, unit: N, noise: 2 N}
free:
  damper.d: 150 N*s/m +- 20 %
"""
MOTIONS = {"monday": "35 mm*sin(2*pi*time/1.7 s) + 10 mm*sin(2*pi*time/0.9 s)",
           "tuesday": "30 mm*sin(2*pi*time/1.9 s) + 12 mm*sin(2*pi*time/1.1 s)"}


def records(folder: Path) -> dict[str, str]:
    """Runs of the rig with a hidden friction and noise, as texts of CSV files."""
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    (folder / "hidden.yaml").write_text(HIDDEN, encoding="utf-8")
    model, noise, found = hb.load(folder / "hidden.yaml"), np.random.default_rng(3), {}
    for day, motion in MOTIONS.items():
        run = hb.simulate(model.with_parameters({"shaker.u": f"=(1 - exp(-(time/0.5 s)**2))*({motion})"}))
        columns = [run.time, run.si["deck.x"], run.si["load.x"] + 2e-4 * noise.standard_normal(len(run.time)),
                   run.si["shaker.a.f"] + 2.0 * noise.standard_normal(len(run.time))]
        rows = [",".join(f"{v:.7g}" for v in row) for row in zip(*columns, strict=True)]
        found[f"{day}.csv"] = "\n".join(["time_s,deck_m,load_m,force_N", *rows]) + "\n"
    (folder / "hidden.yaml").unlink()
    return found


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the rig, two records, and the experiment."""
    folder = tmp_path_factory.mktemp("rig")
    (folder / "data").mkdir()
    for name, text in records(folder).items():
        (folder / "data" / name).write_text(text, encoding="utf-8")
    (folder / "measured.yaml").write_text(EXPERIMENT, encoding="utf-8")
    return folder


def _job(folder: Path, **values: str) -> Job:
    path, given = folder / "measured.yaml", {k.replace("__", "."): v for k, v in values.items()}
    return Job(path.read_text(encoding="utf-8"), str(path), "measured.yaml", given)


def _code(work: Callable[[], Any]) -> str:
    with pytest.raises(UsageError) as caught:
        work()
    return caught.value.problems[0].code


# -- files -----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("given", "stored"), [
    ("monday.csv", "monday.csv"), ("../../etc/x.csv", "x.csv"), ("C:\\logs\\Run 1 (ok).CSV", "Run_1_ok.csv"),
    (".hidden.csv", "hidden.csv"), ("..csv", "record.csv"), ("a\0b\n.csv", "a_b.csv"),
    ("x" * 300 + ".csv", "x" * 80 + ".csv")])
def test_a_record_is_stored_under_a_plain_name(given: str, stored: str) -> None:
    assert plain_name(given) == stored


@pytest.mark.parametrize("given", ["run.yaml", "run.py", "run", "run.csv.exe", "", "csv"])
def test_other_files_are_no_records(given: str) -> None:
    assert _code(lambda: plain_name(given)) == "record-suffix"


def _stored(folder: Folder, beside: str, name: str, content: bytes) -> str:
    async def parts() -> AsyncIterator[bytes]:
        for k in range(0, len(content), 7):
            yield content[k:k + 7]

    return asyncio.run(store(folder, beside, name, parts()))


def test_stored_records_never_replace_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Folder(tmp_path)
    (tmp_path / "car.yaml").write_text("model: car\n", encoding="utf-8")
    assert _stored(folder, "car.yaml", "run.csv", b"t,x\n0,1\n") == "data/run.csv"
    assert _stored(folder, "car.yaml", "run.csv", b"t,x\n0,1\n") == "data/run.csv"      # the same record again
    assert _stored(folder, "car.yaml", "run.csv", b"t,x\n0,2\n") == "data/run_2.csv"
    assert _stored(folder, "car.yaml", "run.csv", b"t,x\n0,2\n") == "data/run_2.csv"
    assert (tmp_path / "data" / "run.csv").read_bytes() == b"t,x\n0,1\n"
    monkeypatch.setattr(record_upload, "RECORD_BYTES", 20)
    assert _code(lambda: _stored(folder, "car.yaml", "large.csv", b"1\n" * 50)) == "record-too-large"
    assert _code(lambda: _stored(folder, "../outside.yaml", "run.csv", b"")) == "file-outside"
    assert sorted(p.name for p in (tmp_path / "data").iterdir()) == ["run.csv", "run_2.csv"]
    (tmp_path / "data" / "link.csv").symlink_to("/etc/passwd")
    for name in ("data/link.csv", "../x.csv", "data/none.csv", ".git/x.csv", "a\0.csv"):
        assert _code(partial(folder.record, name)) == "file-outside"


# -- proposals -------------------------------------------------------------------------------------------------------------
def test_a_motion_that_drives_the_diagram_is_an_input_though_it_is_shown_too(rig: Path) -> None:
    """And where no outputs are named, the variables of the diagram are proposed."""
    table = read_table(rig / "data" / "monday.csv")
    for text in (RIG.replace("show:\n", "show:\n  deck:  {is: deck.x, unit: mm}\n"), RIG[:RIG.index("show:")]):
        found = propose(table, assemble(hb.loads(text)))
        assert [(c.role, c.target) for c in found.columns][:3] == [("time", ""), ("input", "shaker.u"), ("output", "load.x")]


def test_columns_are_recognised_by_words_and_units(rig: Path) -> None:
    found = propose(read_table(rig / "data" / "monday.csv"), assemble(hb.load(rig / "rig.yaml")))
    assert [(c.role, c.target, c.unit, c.unit_known, c.interpolation) for c in found.columns] == [
        ("time", "", "s", True, ""), ("input", "shaker.u", "m", True, "spline"), ("output", "load.x", "m", True, ""),
        ("output", "shaker.a.f", "N", True, "")]


def test_the_columns_of_the_bundled_records_are_recognised() -> None:
    """As the experiments on them say."""
    for name in ("passive_rig/friction", "cylinder_rig/leakage", "receiver_rig/choked", "cascaded_tanks/tanks"):
        experiment = load_experiment(name)
        record = next(iter(experiment.records.values()))
        found = propose(read_table(record.file), assemble(experiment.model))
        wanted = {experiment.time.column: ("time", ""), **{g.column: ("input", n) for n, g in experiment.inputs.items()},
                  **{o.column: ("output", o.shown.text) for o in experiment.outputs.values()}}
        assert {c.name: (c.role, c.target) for c in found.columns if c.role} == wanted, name


def test_what_the_names_leave_open_follows_from_units_or_stays_open(rig: Path, tmp_path: Path) -> None:
    """A logger's own names: only the pull is the one force there is; of three lengths none can be told, and units that the
    file does not give are marked."""
    table = tmp_path / "log.csv"
    rows = "\n".join(f"{0.1 * k:.1f};{k};{k % 3};{k % 5};abc;{k % 7}" for k in range(20))
    table.write_text(f"t;S1 [mm];S2 [mm];pull [kN];remark;S3\n{rows}\n", encoding="utf-8")
    found = propose(read_table(table), assemble(hb.load(rig / "rig.yaml")))
    roles = {c.name: (c.role, c.target, c.unit, c.unit_known) for c in found.columns}
    assert roles == {"t": ("time", "", "s", False), "S1 [mm]": ("", "", "mm", True), "S2 [mm]": ("", "", "mm", True),
                     "pull [kN]": ("output", "shaker.a.f", "kN", True), "S3": ("", "", "1", False)}
    assert any("remark" in remark for remark in found.remarks) and any("drives" in remark for remark in found.remarks)
    shown = propose(read_table(table), assemble(hb.load(rig / "rig.yaml")), instructions=IN_THE_FORM).remarks
    assert len(shown) == len(found.remarks) and not any("`inputs:`" in remark for remark in shown)
    assert any("choose the role 'input'" in remark for remark in shown)


def test_a_column_that_names_its_place_is_compared_there(rig: Path, tmp_path: Path) -> None:
    """Whatever the diagram shows: its unit tells the quantity. Where two places could be meant, none is."""
    rows = "".join(f"{t / 10:g};{t};{t};{t};{t};{t}\n" for t in range(20))
    (tmp_path / "log.csv").write_text("time [s];shaker [mm];load [mm];load speed [m/s];v_deck [m/s];spring position [mm]\n"
                                      + rows, encoding="utf-8")
    found = propose(read_table(tmp_path / "log.csv"), assemble(hb.load(rig / "rig.yaml")))
    assert [c.target for c in found.columns] == ["", "shaker.u", "load.x", "load.v", "deck.v", ""]


def test_an_input_that_steps_is_held_between_its_samples(rig: Path, tmp_path: Path) -> None:
    def between(course: Callable[[float], float]) -> str:
        rows = "".join(f"{t / 50:g},{course(t / 50):.2f},{t}\n" for t in range(500))
        (tmp_path / "record.csv").write_text(f"time,shaker_mm,load_mm\n{rows}", encoding="utf-8")
        found = propose(read_table(tmp_path / "record.csv"), assemble(hb.load(rig / "rig.yaml")))
        return next(c.interpolation for c in found.columns if c.target == "shaker.u")

    assert between(lambda t: 20.0 * (int(t) % 3)) == "hold"
    assert between(lambda t: 20.0 * np.sin(t)) == "spline"
    assert between(lambda t: 0.01 * int(40 * np.sin(t / 3))) == "spline"  # rounded, and slow


def test_the_experiment_that_a_form_describes_is_read_before_it_is_written(rig: Path) -> None:
    columns = [{"column": "time_s", "role": "time", "unit": "s"},
               {"column": "deck_m", "role": "input", "target": "shaker.u", "unit": "m", "interpolation": "spline"},
               {"column": "load_m", "role": "output", "target": "load.x - deck.x", "unit": "m"}]
    files = {str(rig / "data" / "monday.csv"): "fit"}

    def made(columns: list[dict[str, str]], free: dict[str, str] | None = None) -> Any:
        return written_experiment(str(rig / "new.yaml"), "new.yaml", "new", str(rig / "rig.yaml"), files, columns,
                                  free or {})

    told, _ = made(columns, {"spring.c": "4 kN/m +- 20 %"})
    (rig / "new.yaml").write_text(told["text"], encoding="utf-8")
    experiment = load_experiment(rig / "new.yaml")
    (rig / "new.yaml").unlink()
    assert experiment.outputs["load_m"].shown.text == "load.x - deck.x"
    assert experiment.free["spring.c"].range.low == pytest.approx(3200)
    for changed, code in ((columns[:2], "record-roles"), ([*columns, {**columns[2], "column": "force_N"}], "record-roles"),
                          ([*columns[:2], {**columns[2], "unit": "bar"}], "unit-wrong"),
                          ([*columns[:2], {**columns[2], "target": ""}], "record-roles"),
                          ([columns[0], {**columns[1], "column": "none"}, columns[2]], "record-column-unknown")):
        with pytest.raises(hb.HeavebondError) as caught:
            made(changed)
        assert caught.value.problems[0].code == code
    given = Records(rig / "rig.yaml", {rig / "a b.csv": "fit", rig / "a_b.csv": "test"}, [
        Chosen("t", "time", "s"), Chosen("x: #1", "output", "m", "load.x")])
    text = experiment_text("two", rig / "two.yaml", given)
    assert 'a_b: {file: a b.csv, use: fit}' in text and "a_b_2: {file: a_b.csv, use: test}" in text
    assert '{column: "x: #1", unit: m}' in text


def test_a_further_record_changes_one_line() -> None:
    text, names = with_records(EXPERIMENT, ["data/monday.csv", "data/wed-1.csv"])
    assert names == ["wed_1"]
    before = "  tuesday: {file: data/tuesday.csv, use: validate}\n"
    assert text == EXPERIMENT.replace(before, before + "  wed_1:   {file: data/wed-1.csv, use: validate}\n")
    flow = with_records("experiment: a\nrecords: {one: {file: 1.csv, use: fit}}  # days\n", ["2.csv"])[0]
    assert flow.startswith("experiment: a\nrecords: {one: {file: 1.csv, use: fit}, ") and flow.endswith("}  # days\n")


# -- figures ---------------------------------------------------------------------------------------------------------------
def test_the_page_has_the_figures_of_compare(rig: Path) -> None:
    evidence, job = Evidence(), _job(rig)
    assert view(job)["problems"] == [] and view(job)["evidence"]
    told, _ = evidence.compare(job)
    run = CliRunner().invoke(main, ["compare", str(rig / "measured.yaml"), "--json", str(rig / "out.json")])
    assert run.exit_code == 0
    assert json.loads((rig / "out.json").read_text(encoding="utf-8"))["records"] == json.loads(json.dumps(told["records"]))
    printed = " ".join(run.output.split())
    for row in told["items"][0]["rows"]:
        assert " ".join(cell for cell in row if cell) in printed
    channel = compare(rig / "measured.yaml").records["tuesday"].channels["load.x"]
    told, rows = evidence.channel(job, "tuesday", "load.x")
    assert told["unit"] == "mm" and np.array_equal(rows[0], channel.time)  # drawn in the unit of the table
    expected = [channel.measured, channel.model, channel.measured - channel.model]
    assert np.allclose(rows[1:4] / 1e3, expected, rtol=1e-14, atol=0)
    told, rows = evidence.against(job, "tuesday", "load.x", "load.v")
    assert np.allclose(rows[1] / 1e3, channel.measured - channel.model, rtol=1e-14, atol=0)
    assert told == {"unit": "mm", "across": "m/s"}
    assert evidence.compare(_job(rig, damper__d="300 N*s/m"))[0]["records"] != told  # as by --set
    told, rows = evidence.against(job, "tuesday", "load.x", "load.v - deck.v")
    assert told["across"] == "m/s" and np.ptp(rows[0]) > 0.05
    assert _code(lambda: evidence.against(job, "tuesday", "load.x", "load.w")) == "signal-unknown"


def test_problems_of_an_experiment_stand_at_their_lines(rig: Path) -> None:
    for old, new, line in (("load.x: ", "load.y: ", 10), ("use: fit", "use: fitt", 4), ("damper.d:", "damper.e:", 13)):
        path = str(rig / "measured.yaml")
        found: Any = view(Job(EXPERIMENT.replace(old, new, 1), path, "measured.yaml"))
        assert found["problems"][0]["line"] == line, found["problems"]


def test_every_computation_that_a_page_may_ask_for_is_there() -> None:
    assert set(KINDS) == set(TASKS)


async def _done(job: LongJob) -> LongJob:
    while job.state == "running":
        await asyncio.sleep(0.02)
    return job


@pytest.mark.long
def test_a_fit_has_the_figures_of_the_command_line_and_is_written(rig: Path) -> None:
    async def work() -> tuple[Any, list[str], list[str]]:
        jobs = LongJobs()
        try:
            texts: list[str] = []
            jobs.watchers.add(lambda job: texts.append(job.text))
            job = jobs.begin("fit", "measured.yaml", rig / "measured.yaml", "v", {})
            assert _code(lambda: jobs.begin("where", "measured.yaml", rig / "measured.yaml", "v", {})) == "job-running"
            await _done(job)
            assert job.state == "done", job.problems
            return job.result, texts, await job.write({})
        finally:
            jobs.close()

    told, texts, files = asyncio.run(work())
    run = CliRunner().invoke(main, ["fit", str(rig / "measured.yaml"), "--json", str(rig / "fit.json")])
    assert run.exit_code == 0
    expected = json.loads((rig / "fit.json").read_text(encoding="utf-8"))
    assert json.loads(json.dumps(told["figures"])) == {k: expected[k] for k in told["figures"]}
    assert any("chi-square" in text for text in texts)
    assert [Path(f).name for f in files] == ["rig_fitted.yaml", "measured_fitted.yaml"]
    fitted = load_experiment(rig / "measured_fitted.yaml")
    value = next(p for p in expected["parameters"].values())["value"]
    assert fitted.model.settings["damper.d"].value.text.startswith(f"{value:.4g}"[:4])


@pytest.mark.long
def test_a_job_that_is_stopped_gives_its_best_so_far_and_one_that_fails_its_reason(rig: Path) -> None:
    async def work() -> None:
        jobs = LongJobs()
        try:
            job = jobs.begin("diagnose", "measured.yaml", rig / "measured.yaml", "v", {"classes": ["dry friction"]})
            while "scoring" not in job.text and job.state == "running":
                await asyncio.sleep(0.005)
            assert len(job.ladder) == 2  # as it stands, and with its parameters fitted
            job.stop()
            await _done(job)
            assert job.state == "done" and job.result["partial"] and job.result["verdict"] == "undetermined"
            assert job.result["ladder"] == job.ladder
            written = [Path(file) for file in await job.write({"report": True})]
            assert [file.name for file in written] == ["measured_report.html"]
            assert "Diagnosis of rig, measured" in written[0].read_text(encoding="utf-8")
            written[0].unlink()
            (rig / "broken.yaml").write_text(EXPERIMENT.replace("load_m", "lod_m"), encoding="utf-8")
            failed = await _done(jobs.begin("where", "broken.yaml", rig / "broken.yaml", "v", {}))
            (rig / "broken.yaml").unlink()
            assert failed.state == "failed" and failed.problems[0].code == "record-column-unknown"
        finally:
            jobs.close()

    asyncio.run(work())


@pytest.mark.long
def test_a_tuning_has_the_figures_of_the_command_line_and_results_on_bundled_files_go_into_the_folder(rig: Path) -> None:
    given = {"free": ["damper.d=50 .. 900 N*s/m"], "cost": "rms(load)", "folder": str(rig)}
    bundled = hb.load("passive_rig").path

    async def work() -> tuple[Any, list[str], list[str]]:
        jobs = LongJobs()
        try:
            job = await _done(jobs.begin("tune", "rig.yaml", rig / "rig.yaml", "v", given))
            files = await job.write({})
            fit = await _done(jobs.begin("fit", "bundled:passive_rig/friction", bundled.with_name("friction.yaml"), "v",
                                         {"folder": str(rig)}))
            return job.result, files, await fit.write({})
        finally:
            jobs.close()

    told, files, fitted = asyncio.run(work())
    run = CliRunner().invoke(main, ["tune", str(rig / "rig.yaml"), "--free", given["free"][0], "--cost", "rms(load)",
                                    "--json", str(rig / "tune.json")])
    assert run.exit_code == 0
    expected = json.loads((rig / "tune.json").read_text(encoding="utf-8"))
    assert json.loads(json.dumps(told["figures"])) == {k: expected[k] for k in told["figures"]}
    assert Path(files[0]) == rig / "rig_tuned.yaml" and hb.load(files[0]).settings
    assert [Path(f).parent for f in fitted] == [rig, rig] and load_experiment(fitted[-1]).records


@pytest.mark.long
def test_a_diagnosis_has_the_figures_of_the_command_line(rig: Path) -> None:
    async def work() -> Any:
        jobs = LongJobs()
        try:
            job = await _done(jobs.begin("diagnose", "measured.yaml", rig / "measured.yaml", "v",
                                         {"classes": ["dry friction"]}))
            return job.result
        finally:
            jobs.close()

    told = asyncio.run(work())
    out = rig / "out"
    run = CliRunner().invoke(main, ["diagnose", str(rig / "measured.yaml"), "--only", "dry friction", "--folder", str(out),
                                    "--json", str(rig / "diagnosis.json")])
    assert run.exit_code == 0
    expected = json.loads((rig / "diagnosis.json").read_text(encoding="utf-8"))
    found = json.loads(json.dumps(told["figures"]))
    assert {**found, "seconds": 0} == {**{k: expected[k] for k in found}, "seconds": 0}
    assert found["ladder"] == told["ladder"] and found["verdict"] == "effect"


def test_a_studio_that_ends_while_a_computation_begins_leaves_no_trace(monkeypatch: pytest.MonkeyPatch,
                                                                       tmp_path: Path) -> None:
    """The thread that hears the end of the studio interrupts the computation before its start has returned."""
    told = list[str]()

    def interrupted(self: threading.Thread) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    monkeypatch.setattr(JobProcess, "tell", lambda self, kind, *content: told.append(kind))
    JobProcess(None).serve("fit", str(tmp_path / "fit.yaml"), {})  # type: ignore[arg-type]
    assert told == ["stopped"]
