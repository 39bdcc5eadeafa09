"""The studio without a browser: the folder and its limits, who is let in, what the workers answer."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.errors import HeavebondError, UsageError
from heavebond.language.edits import with_values
from heavebond.studio.bench import Bench, Thumbnails, view
from heavebond.studio.difference import differences
from heavebond.studio.folder import BUNDLED, EMPTY, TEMPLATES, Folder, bundled_machines, version
from heavebond.studio.job import Job
from heavebond.studio.page_safety import Guard, policy
from heavebond.studio.workers import Worker

ROOT = Path(__file__).parents[1]
CAR = (ROOT / "models" / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    inside = tmp_path / "opened"
    inside.mkdir()
    (inside / "car.yaml").write_text(CAR, encoding="utf-8")
    (tmp_path / "secret.yaml").write_text(CAR, encoding="utf-8")
    return Folder(inside)


def _code(work: Callable[[], Any]) -> str:
    with pytest.raises(HeavebondError) as caught:
        work()
    return caught.value.problems[0].code


# -- files -----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["../secret.yaml", "/etc/passwd", "sub/../../secret.yaml", "..", "", ".", ".hidden.yaml",
                                  ".git/config.yaml", "car.txt", "a\0.yaml", "link.yaml", "linked/secret.yaml", "x" * 5000,
                                  f"{BUNDLED}../../etc/passwd", f"{BUNDLED}cmc_ahc/../cmc_ahc"])
def test_no_name_leads_out_of_the_folder(folder: Folder, name: str) -> None:
    (folder.root / ".hidden.yaml").write_text(CAR, encoding="utf-8")
    (folder.root / "link.yaml").symlink_to(folder.root.parent / "secret.yaml")
    (folder.root / "linked").symlink_to(folder.root.parent)
    before = sorted(folder.root.parent.rglob("*"))
    assert _code(lambda: folder.read(name)) in ("file-outside", "file-missing", "file-unreadable")
    assert _code(lambda: folder.save(name, "model: x\n", version(b""))) in ("file-outside", "file-missing", "file-bundled",
                                                                         "file-unwritable")
    assert sorted(folder.root.parent.rglob("*")) == before
    assert (folder.root.parent / "secret.yaml").read_text(encoding="utf-8") == CAR
    assert [entry["name"] for entry in folder.diagrams()] == ["car.yaml"]


@pytest.mark.parametrize("raw", [b"model: a\r\n# b\r\n", b"\xef\xbb\xbfmodel: a\n", b"model: a\n# mixed\r\n", b"model: a",
                                 "model: a  # \u00fc\u2028\n".encode()])
def test_a_file_is_saved_to_the_byte(folder: Folder, raw: bytes) -> None:
    """Its line ends, its mark and its missing last line end are kept; what is typed is all that changes."""
    path = folder.root / "other.yaml"
    path.write_bytes(raw)
    read = folder.read("other.yaml")
    assert folder.save("other.yaml", read.text, read.version).version == read.version
    assert path.read_bytes() == raw
    folder.save("other.yaml", read.text.replace("a", "b", 1), read.version)
    assert path.read_bytes() == raw.replace(b"a", b"b", 1)


def test_a_changed_file_is_never_overwritten(folder: Folder) -> None:
    read = folder.read("car.yaml")
    (folder.root / "car.yaml").write_text("model: theirs\n", encoding="utf-8")
    assert _code(lambda: folder.save("car.yaml", "model: mine\n", read.version)) == "file-changed"
    assert (folder.root / "car.yaml").read_text(encoding="utf-8") == "model: theirs\n"
    (folder.root / "car.yaml").unlink()  # nothing is overwritten then
    assert folder.save("car.yaml", "model: mine\n", read.version).text == "model: mine\n"
    assert _code(lambda: folder.save(f"{BUNDLED}cmc_ahc", "", "")) == "file-bundled"


def test_new_diagrams_run_at_once(folder: Folder) -> None:
    assert folder.create("rig") == "rig.yaml"
    assert hb.simulate(hb.load(folder.root / "rig.yaml")).si["place"][0] == pytest.approx(0.02)
    assert _code(lambda: folder.create("rig")) == "file-exists"
    for bad in ("", "a b", "../x", "1a", "a" * 80, "a.yaml"):
        assert _code(lambda bad=bad: folder.create(bad)) == "name-bad"
    folder.derive("mine", f"{BUNDLED}cmc_ahc", {"controller.K_p": "1.278 1/m"})
    assert hb.load(folder.root / "mine.yaml").settings["controller.K_p"].value.text == "1.278 1/m"
    folder.derive("stiffer", "car.yaml", {"spring.c": "30 kN/m"})
    assert "tyre" in hb.load(folder.root / "stiffer.yaml").body.instances
    with pytest.raises(UsageError):
        folder.derive("bad", "car.yaml", {"a: b\nremove": "1"})
    with pytest.raises(UsageError):
        folder.derive("bad", "car.yaml", {"spring.c": "1\nremove: [tyre]"})


def test_the_first_page_lists_the_machines() -> None:
    names = [entry["name"] for entry in bundled_machines()]
    assert {f"{BUNDLED}cmc_ahc", f"{BUNDLED}cmc_ahc/passive", f"{BUNDLED}circuits/crane"} <= set(names)
    assert f"{BUNDLED}cmc_ahc/quality_index" not in names  # a study
    assert next(entry["studies"] for entry in bundled_machines() if entry["name"] == f"{BUNDLED}cmc_ahc") > 10
    assert all(entry["summary"] and not entry["summary"].startswith(">") for entry in bundled_machines())


@pytest.mark.parametrize(("text", "path", "wanted"), [
    (CAR, "damper.d", CAR.replace("d: 1.5 kN*s/m", "d: 2 m")),
    (CAR, "speed", CAR.replace("speed:  5 m/s", "speed:  2 m")),
    (CAR, "a.b.c", CAR + "set:\n  a.b.c: 2 m\n"),
    ("model: a\nextends: b.yaml\ncomponents:\n  s: {is: Spring}\n", "s.c",
     "model: a\nextends: b.yaml\ncomponents:\n  s: {is: Spring}\nset:\n  s.c: 2 m\n"),
    (CAR + "set: {damper.d: 1 N*s/m}  # tuned\n", "damper.d", CAR + "set: {damper.d: 2 m}  # tuned\n")])
def test_a_value_is_written_where_it_decides(text: str, path: str, wanted: str) -> None:
    changed = with_values(text, {path: "2 m"})
    assert changed.rstrip("\n") == wanted.rstrip("\n")


def test_differences_of_two_diagrams(folder: Folder) -> None:
    """Parts, values, wires and outputs that differ; the same value in another unit does not, nor does a renamed node with
    the same ports differ twice."""
    changed = CAR
    for old, new in (("m: 320 kg", "m: 0.32 t"), ("c: 22 kN/m", "c: 25 kN/m"), ("damper:      ", "dashpot:      "),
                     (", damper.", ", dashpot."), ("unit: mm}", "unit: m}"), ("until: 4 s", "until: 6 s"),
                     ("  road:  [", "  street:  ["), ("road.x", "street.x")):
        changed = changed.replace(old, new)
    found = differences(hb.loads(CAR), hb.loads(changed))
    assert [(d["about"], d["mark"], d["path"], d["before"], d["after"]) for d in found] == [
        ("part", "removed", "damper", "Damper", ""), ("part", "added", "dashpot", "", "Damper"),
        ("value", "changed", "spring.c", "22 kN/m", "25 kN/m"),
        ("wire", "changed", "body", "body.a, body_weight.a, damper.b, spring.b",
         "body.a, body_weight.a, dashpot.b, spring.b"),
        ("wire", "changed", "wheel", "damper.a, spring.a, tyre.b, wheel.a, wheel_weight.a",
         "dashpot.a, spring.a, tyre.b, wheel.a, wheel_weight.a"),
        ("output", "changed", "suspension", "body.x - wheel.x [mm]", "body.x - wheel.x [m]"),
        ("run", "changed", "until", "4 s", "6 s")]
    assert differences(hb.loads(CAR), hb.loads(CAR)) == []


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_has_no_problems(folder: Folder, template: str) -> None:
    name = folder.create_from("own", template)
    document = folder.read(name)
    assert document.text.startswith("model: own\n")
    entry = view(Job(document.text, str(document.path), name))
    assert entry["runs"] and entry["problems"] == []


def test_a_thumbnail_is_drawn_again_when_its_file_changes(folder: Folder) -> None:
    """A diagram that extends another one has its drawing, without names, as long as neither changes."""
    thumbnails, text = Thumbnails(), "model: more\nextends: car.yaml\n"
    job = Job(text, str(folder.root / "more.yaml"), "more.yaml")
    first = thumbnails.thumbnail(job)[0]["svg"]
    assert "<text" not in first and 'data-part="damper"' in first
    assert thumbnails.thumbnail(job)[0]["svg"] is first
    other = EMPTY + "components: {dashpot: {is: Fixed}}\nnodes: {a: [dashpot.a]}\n"
    (folder.root / "car.yaml").write_text(other, encoding="utf-8")
    assert 'data-part="dashpot"' in thumbnails.thumbnail(job)[0]["svg"]
    assert _code(lambda: thumbnails.thumbnail(replace(job, text="model: [")))


# -- who is let in ---------------------------------------------------------------------------------------------------------
HOST, ORIGIN = b"127.0.0.1:9000", b"http://127.0.0.1:9000"


@pytest.mark.parametrize(("kind", "path", "headers", "admitted"), [
    ("http", "/TOKEN/", {b"host": HOST}, True),
    ("http", "/TOKEN/main.js", {b"host": b"localhost:9000", b"origin": b"http://localhost:9000"}, True),
    ("http", "/", {b"host": HOST}, False),
    ("http", "/TOKENS/", {b"host": HOST}, False),
    ("http", "/TOKE/", {b"host": HOST}, False),
    ("http", "/TOKEN/", {}, False),
    ("http", "/TOKEN/", {b"host": b"evil.example:9000"}, False),       # a name that leads here
    ("http", "/TOKEN/", {b"host": b"127.0.0.1:9001"}, False),
    ("http", "/TOKEN/", {b"host": HOST, b"origin": b"http://evil.example"}, False),
    ("http", "/TOKEN/", {b"host": HOST, b"origin": b"null"}, False),
    ("websocket", "/TOKEN/socket", {b"host": HOST, b"origin": ORIGIN}, True),
    ("websocket", "/TOKEN/socket", {b"host": HOST}, False),
    ("websocket", "/TOKEN/socket", {b"host": HOST, b"origin": b"http://evil.example"}, False),
    ("websocket", "/TOKEN/socket", {b"host": HOST, b"origin": b"http://127.0.0.1:9001"}, False),
    ("websocket", "/socket", {b"host": HOST, b"origin": ORIGIN}, False)])
def test_the_guard(kind: str, path: str, headers: dict[bytes, bytes], admitted: bool) -> None:
    reached, sent = [], []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        reached.append(scope["path"])

    async def receive() -> Any:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(Guard(app, "TOKEN", 9000)({"type": kind, "path": path, "headers": list(headers.items())}, receive, send))
    assert bool(reached) == admitted
    if not admitted:
        assert sent[0].get("status", 403) == 403 and sent[0]["type"] in ("http.response.start", "websocket.close")


def test_the_policy_lets_nothing_in_from_elsewhere() -> None:
    said = policy("abc", 9000).decode()
    assert "unsafe" not in said and "*" not in said and "https:" not in said
    assert said.startswith("default-src 'none'; script-src 'self';")


# -- what the workers answer -----------------------------------------------------------------------------------------------
def test_the_contents_of_the_compensator() -> None:
    path = ROOT / "models" / "cmc_ahc" / "cmc_ahc.yaml"
    found = view(Job(path.read_text(encoding="utf-8"), str(path), "cmc"), ["ahc"])
    assert found["problems"] == []
    parts: Any = found["parts"]
    gain = next(p for p in parts["controller"]["parameters"] if p["name"] == "K_p")
    assert gain["slider"] == {"value": 3.02, "unit": "1/m", "from": 0.302, "to": pytest.approx(30.2), "low": None,
                              "high": None, "log": True}
    opening = next(p for p in parts["ahc"]["parameters"] if p["name"] == "open")
    assert opening["text"] == "=bypass_open" and "slider" not in opening  # it follows from another one
    assert "cmc.friction.F" in [s["name"] for s in parts["cmc.friction"]["signals"]]
    assert found["nodes"]["crown"]["domain"] == "translational"
    assert 'data-part="ahc.valve"' in str(found["svg"]) and 'data-node="crown"' in str(found["svg"])
    assert any(Path(f).parent.name == "components" for f in found["files"])


@pytest.mark.parametrize(("old", "new", "code", "line", "part"), [
    ("d: 1.5 kN*s/m", "d: 1.5 kN/m", "unit-wrong", 12, "damper"),
    ("is: Damper", "is: Dampr", "component-unknown", 12, "damper"),
    ("road:  [tyre.a, road.a]", "road:  [tyre.a, road.q]", "", 20, ""),
    ("start: steady", "start: [", "not-yaml", 21, "")])
def test_problems_stand_at_their_lines_and_parts(tmp_path: Path, old: str, new: str, code: str, line: int, part: str
                                                 ) -> None:
    problems: Any = view(Job(CAR.replace(old, new, 1), str(tmp_path / "car.yaml"), "car.yaml"))["problems"]
    assert problems[0]["line"] == line and problems[0]["part"] == part
    assert not code or problems[0]["code"] == code


def test_a_run_has_the_figures_of_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "car.yaml").write_text(CAR, encoding="utf-8")
    job = Job(CAR, str(tmp_path / "car.yaml"), "car.yaml", {"damper.d": "2.5 kN*s/m"})
    told, series = Bench().run(job, ["damper.F", "suspension"])
    run = CliRunner().invoke(main, ["run", job.path, "--set", "damper.d=2.5 kN*s/m", "--json", str(tmp_path / "out.json")])
    assert run.exit_code == 0
    outputs = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["outputs"]
    assert {k: v for k, v in told["outputs"].items() if k in outputs} == outputs
    result = hb.simulate(hb.load(job.path).with_parameters(job.values))
    assert np.array_equal(series, np.vstack([result.time, result.si["damper.F"], result.display["suspension"]]))


BALL = """\
model: ball
components:
  floor: {is: Fixed}
  ball: {is: Mass, m: 1 kg}
  weight: {is: Weight, m: =ball.m}
  stop: {is: RigidStop, e: 0.7}
nodes: {floor: [floor.a, stop.a], ball: [ball.a, weight.a, stop.b]}
initial: {ball.x: 1 m, ball.v: 0 m/s}
show: {height: {is: ball.x, unit: m}}
simulate: {until: 3 s, every: 5 ms}
"""


def test_the_events_of_a_run_are_listed_with_part_and_changed_values(tmp_path: Path) -> None:
    """A ball falls from 1 m: its first impact is at sqrt(2 h/g) = 0.4515 s, and the speed v becomes -0.7 v."""
    job, bench = Job(BALL, str(tmp_path / "ball.yaml"), "ball.yaml"), Bench()
    told, _ = bench.run(job)
    log, _ = bench.events(job, "")
    assert log["of"] == len(log["events"]) == told["events"] == sum(log["counts"].values())
    first = next(e for e in log["events"] if e["event"] == "impact")
    assert first["part"] == "stop" and "gap < 0" in first["text"] and first["time"] == pytest.approx(0.45152, abs=1e-5)
    (name, before, after, unit), = first["changes"]
    assert (name, unit) == ("ball.v", "m/s") and after == pytest.approx(-0.7*before)
    only, _ = bench.events(job, "stop.impact")
    assert only["events"] == [e for e in log["events"] if e["name"] == "stop.impact"] and only["of"] == len(only["events"])


def test_a_slider_shows_the_run_that_follows_when_it_rests(tmp_path: Path) -> None:
    bench = Bench()
    job = Job(CAR, str(tmp_path / "car.yaml"), "car.yaml", {"damper.d": "2.5 kN*s/m"})
    _, quick = bench.preview(job, ["suspension", "tyre_force"])
    _, exact = bench.run(job, ["suspension", "tyre_force"])
    assert np.array_equal(quick[0], exact[0])
    assert (np.abs(quick - exact).max(axis=1) < 1e-4 * np.ptp(exact, axis=1)).all()  # the line on the page is wider
    _, other = bench.signals(job, ["damper.v"])
    assert other.shape == (2, exact.shape[1])


def test_limits_of_a_parameter_hold_for_runs(tmp_path: Path) -> None:
    job = Job(CAR, str(tmp_path / "car.yaml"), "car.yaml", {"damper.d": "-2 kN*s/m"})
    assert _code(lambda: Bench().run(job)) == "parameter-bound"


def test_waiting_tasks_give_way_to_the_newest_and_a_long_one_is_stopped(tmp_path: Path) -> None:
    path = str(tmp_path / "car.yaml")
    long = Job(CAR.replace("until: 4 s, every: 2 ms", "until: 9000 s, every: 20 ms"), path, "car.yaml")
    short = Job(CAR, path, "car.yaml")

    async def work() -> None:
        worker = Worker()
        try:
            first = asyncio.create_task(worker.ask_newest("run", long, []))
            while not worker._since or worker._pipe is None:
                await asyncio.sleep(0.05)
            await asyncio.sleep(0.5)
            others = [asyncio.create_task(worker.ask_newest("run", short, [])) for _ in range(3)]
            await asyncio.sleep(0.1)
            began = time.monotonic()
            worker.stop()
            assert (await first)[0] == "stopped"
            assert time.monotonic() - began < 5
            kinds = [(await other)[0] for other in others]
            assert kinds == ["superseded", "superseded", "done"]  # a new process does it
        finally:
            worker.close()

    asyncio.run(work())


@pytest.mark.long
def test_a_short_task_is_done_again_where_its_process_was_ended(tmp_path: Path) -> None:
    job = Job(CAR, str(tmp_path / "car.yaml"), "car.yaml")
    move = {"act": "set", "path": "damper.d", "value": "2 kN*s/m"}

    async def work() -> None:
        worker = Worker()
        try:
            await worker.ask("edit", job, move)
            assert worker._process is not None and worker._process.pid is not None
            asked = asyncio.create_task(worker.ask_again("edit", replace(job, text=CAR + "#" * 3_000_000), move))
            await asyncio.sleep(0.05)
            os.kill(worker._process.pid, signal.SIGKILL)  # as the system does where memory is short
            kind, told, _ = await asked
            assert kind == "done" and "d: 2 kN*s/m" in told["text"]
        finally:
            worker.close()

    asyncio.run(work())


def test_without_the_extra_the_command_says_what_to_type(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    run = CliRunner().invoke(main, ["studio"])
    assert run.exit_code == 2
    assert "pip install 'heavebond[studio]'" in run.output


# -- colours ---------------------------------------------------------------------------------------------------------------
TEXTS = (("ink", "paper"), ("ink", "soft"), ("quiet", "paper"), ("quiet", "soft"), ("accent", "paper"), ("accent", "soft"),
         ("on-accent", "accent"), ("warn", "paper"), ("warn", "soft"), ("warn", "warn-soft"), ("quiet", "warn-soft"),
         ("ink", "warn-soft"), ("ink", "pick"), ("quiet", "pick"))


@pytest.mark.parametrize("dark", [False, True])
def test_colours_of_the_page_have_the_contrast_of_wcag_aa(dark: bool) -> None:
    """4.5 to 1 for text, 3 to 1 for the focus (WCAG 2.1, 1.4.3 and 1.4.11), in the light and the dark scheme."""
    style = (ROOT / "heavebond" / "studio" / "page" / "studio.css").read_text(encoding="utf-8")
    light, dark_part = re.findall(r":root \{(.*?)\}", style, re.DOTALL)[:2]
    colours = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", light))
    if dark:
        colours |= dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", dark_part))

    def luminance(name: str) -> float:
        parts = [int(colours[name][k:k + 2], 16) / 255 for k in (1, 3, 5)]
        r, g, b = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * r + 0.7152 * g + 0.0722 * b

    def contrast(one: str, two: str) -> float:
        low, high = sorted((luminance(one), luminance(two)))
        return (high + 0.05) / (low + 0.05)

    wanted = {**dict.fromkeys(TEXTS, 4.5), ("focus", "paper"): 3.0, ("focus", "soft"): 3.0}
    assert {pair: round(contrast(*pair), 2) for pair, least in wanted.items() if contrast(*pair) < least} == {}


@pytest.mark.long
def test_the_scripts_of_the_page_are_typed() -> None:
    """By the compiler of TypeScript, which checks types that stand in comments; vendored files are as they came."""
    compiler = shutil.which("tsc")
    if compiler is None:
        pytest.skip("the compiler of TypeScript is not installed")
    page = Path(hb.__file__).parent / "studio" / "page"
    flags = ["--allowJs", "--checkJs", "--noEmit", "--strict", "--target", "esnext", "--module", "esnext",
             "--noUnusedLocals", "--noUnusedParameters", "--moduleResolution", "bundler",
             "--lib", "esnext,dom,dom.iterable", "--skipLibCheck"]
    found = subprocess.run([compiler, *flags, "main.js"], cwd=page, capture_output=True, text=True, check=False)
    said = [line for line in found.stdout.splitlines() if line and not line.startswith(("vendor/", " "))]
    assert said == []


def test_the_charts_of_a_diagram_are_stored_beside_it_and_not_overwritten_by_another_tab(folder: Folder) -> None:
    name = folder.create("machine")
    assert folder.layout(name) == (None, "")
    first = folder.save_layout(name, {"plotted": ["load.x"]}, "")
    assert folder.layout(name) == ({"plotted": ["load.x"]}, first)
    assert folder.save_layout(name, {"plotted": []}, "") == ""  # another tab wrote meanwhile
    assert folder.layout(name)[0] == {"plotted": ["load.x"]}
    second = folder.save_layout(name, {"plotted": []}, first)
    assert second and folder.layout(name) == ({"plotted": []}, second)
    path = folder.root / ".heavebond" / "machine.yaml.json"
    path.write_text("{broken")
    layout, changed = folder.layout(name)
    assert layout is None and folder.save_layout(name, {"plotted": []}, changed) == second
    assert name in [d["name"] for d in folder.diagrams()] and not any("json" in d["name"] for d in folder.diagrams())
    for case, layout, code in ((f"{BUNDLED}cmc_ahc", {}, "file-bundled"), ("../out.yaml", {}, "file-outside"),
                               (name, {"kept": ["x" * 5_000_000]}, "file-too-large")):
        with pytest.raises(UsageError) as error:
            folder.save_layout(case, layout, second)
        assert error.value.problems[0].code == code
    path.unlink()
    path.symlink_to(folder.root / name)  # no link is followed
    with pytest.raises(UsageError):
        folder.save_layout(name, {}, folder.layout(name)[1])
    assert "components:" in (folder.root / name).read_text()
