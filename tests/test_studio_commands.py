"""The commands of the command line in the studio: forms, arguments that a page may give, runs, and the list of places."""

from __future__ import annotations

import json
import re
import shutil
from base64 import b64encode
from pathlib import Path

import browser
import numpy as np
import pytest
from click.testing import CliRunner
from oscillator import write_experiment, write_record
from studio_pages import Server, server, tab
from test_fmu_import import FMI3, RIG, compiled, make_fmu
from test_import_20sim import OWN

import heavebond as hb
from heavebond.cli import NAMES, main
from heavebond.core.errors import HeavebondError, UsageError
from heavebond.core.native_permission import fmu_code
from heavebond.core.writable import confined
from heavebond.language.library import bundled
from heavebond.studio.bench import Bench, imported, view
from heavebond.studio.command_forms import COMMANDS, EXCLUDED, arguments, forms, run_command
from heavebond.studio.job import Job
from heavebond.studio.palette import palette

__all__ = ["server", "tab"]

CAR = (bundled("models") / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")
LINE = "heavebond.cli:main"
PAGE = Path(__file__).parents[1] / "docs" / "tutorials" / "studio.md"


@pytest.fixture
def car(tmp_path: Path) -> Path:
    path = tmp_path / "folder" / "car.yaml"
    path.parent.mkdir()
    path.write_text(CAR, encoding="utf-8")
    return path


def test_each_command_has_its_place_in_the_studio() -> None:
    """The page lists every command of the command line, and the forms are those that it names."""
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+?) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE))
    assert rows.keys() == set(NAMES)
    with_form = {name for names in COMMANDS.values() for name in names}
    assert {name for name, place in rows.items() if "*Analyses" in place} == with_form


def test_a_form_has_no_option_that_names_a_file_or_permits_execution() -> None:
    found = forms(LINE)
    options = {o["name"] for kind in found.values() for form in kind for o in form["options"]}
    assert {"settings", "inputs", "rtol", "solver"} <= options and not options & set(EXCLUDED)
    assert not [name for name in options if "allow" in name]
    assert {form["name"] for kind in found.values() for form in kind} == {n for names in COMMANDS.values() for n in names}
    for values in ({"output": "/etc/passwd"}, {"allow_fmu": True}, {"allow_native": True}, {"json": "a.json"},
                   {"nonsense": "1"}):
        with pytest.raises(UsageError, match="unknown"):
            arguments(main, "run", values)
    for name in ("studio", "new", "import", "demo", "nonsense"):
        with pytest.raises(UsageError, match="unknown"):
            arguments(main, name, {})
    # a value stays the value of its option
    assert arguments(main, "modes", {"at": "--output=/tmp/x", "steady": True, "settings": ["a=1", "", "b=2"]}) == [
        "--at=--output=/tmp/x", "--steady", "--set=a=1", "--set=b=2"]


def test_a_model_of_another_program_is_imported_into_a_folder_of_its_own(tmp_path: Path) -> None:
    content = b64encode(OWN.encode()).decode()
    told = imported("../My model.emx", content, str(tmp_path))
    assert told["name"].startswith("My_model/") and not told["placeholders"] and not told["untranslated"]
    assert "Mass" in hb.load(tmp_path / told["name"]).body.instances
    before = sorted(tmp_path.rglob("*"))
    for name, text, code in (("My_model.emx", content, "file-exists"), ("other.emx", "bm90aGluZw==", "emx-xml"),
                             ("other.slx", content, "import-suffix")):
        with pytest.raises(HeavebondError) as error:
            imported(name, text, str(tmp_path))
        assert error.value.problems[0].code.startswith(code) and sorted(tmp_path.rglob("*")) == before


@pytest.mark.long
def test_a_model_is_imported_on_the_first_page(tab: browser.Tab, server: Server) -> None:
    tab.go("about:blank")
    tab.go(server.address)
    tab.wait("Boolean(document.querySelector('#import-file'))")
    tab.run(f"""(() => {{ const data = new DataTransfer(), chooser = document.querySelector("#import-file");
        data.items.add(new File([{json.dumps(OWN)}], "pull.emx")); chooser.files = data.files;
        chooser.dispatchEvent(new Event("change")); return 1; }})()""")
    tab.wait("studio.document?.name.startsWith('pull/') && studio.view?.svg && studio.document.writable", 60)
    assert tab.complaints == []


@compiled
def test_an_fmu_runs_in_the_studio_with_the_permission_of_its_start_only(tmp_path: Path) -> None:
    make_fmu(tmp_path / "controller.fmu", FMI3)
    job = Job(RIG, str(tmp_path / "rig.yaml"), "rig.yaml")
    with pytest.raises(UsageError, match="studio --allow-fmu"):
        Bench().run(job)
    with fmu_code():
        force = Bench().run(job, ["force"])[1][1]
    assert np.array_equal(force, hb.simulate(hb.loads(RIG, tmp_path), allow_fmu=True).si["force"])
    (own, *_), (part, *_) = palette(tmp_path)["groups"], view(job, [])["parts"]["controller"]["ports"]
    assert [c["name"] for c in own["components"]] == ["controller.fmu"] and part["name"] == "position" and not part["value"]


@compiled
@pytest.mark.long
def test_an_fmu_is_dropped_on_the_drawing_and_connected(tab: browser.Tab, server: Server, tmp_path: Path) -> None:
    """It is stored next to the diagram and placed; its input with a start value takes a wire; its program does not run."""
    (server.folder / "driven.yaml").write_text(re.sub(r"  (controller|gauge|force): .*\n", "", RIG, count=3).replace(
        "{is: ForceSource}", "{is: ForceSource, u: 0 N}"), encoding="utf-8")
    tab.go("about:blank")
    tab.go(f"{server.address}#driven.yaml")
    tab.wait("Boolean(window.studio?.view?.svg && studio.view.parts.where)", 60)
    content = b64encode(make_fmu(tmp_path / "controller.fmu", FMI3).read_bytes()).decode()
    tab.run(f"""(() => {{ const data = new DataTransfer();
        for (const bytes of [atob({json.dumps(content)}), "no archive"])
            data.items.add(new File([Uint8Array.from(bytes, c => c.charCodeAt(0))], "controller.fmu"));
        document.getElementById("sheet").dispatchEvent(new DragEvent("drop", {{bubbles: true, cancelable: true,
            dataTransfer: data}})); }})()""")
    tab.wait("document.querySelector('#banner').innerText.includes('is not an FMU that can be read')", 60)
    assert tab.run("studio.view.parts.controller.kind") == "controller.fmu"
    assert sorted(p.name for p in server.folder.glob("*.fmu")) == ["controller.fmu"]
    tab.run("void studio.edits.act({act: 'join', from: 'where.y', to: 'controller.position'})")
    tab.wait("studio.editor.text.includes('[where.y, controller.position]')", 60)
    tab.key("Enter", ctrl=True, code=13)
    tab.wait("document.querySelector('#plots').innerText.includes('heavebond studio --allow-fmu')", 60)
    tab.run("studio.document.text = studio.editor.text; studio.file.keepDraft()")
    assert tab.complaints == []


@pytest.mark.long
def test_a_command_follows_the_sliders_and_takes_values_with_semicolons(tab: browser.Tab, server: Server) -> None:
    (server.folder / "swept.yaml").write_text(CAR, encoding="utf-8")
    tab.go("about:blank")
    tab.go(server.address + "#swept.yaml")
    tab.wait("Boolean(studio.view?.svg)", 60)
    tab.click("#analyse")

    def choose(name: str, **values: str) -> None:
        tab.wait("Boolean(document.querySelector('#command'))")
        tab.run(f"""(() => {{ const box = document.getElementById("command"); box.value = "{name}";
            box.dispatchEvent(new Event("change")); return 1; }})()""")
        tab.wait(f"document.querySelector('#command')?.value === '{name}'")
        tab.wait("document.querySelector('.command-options').open")
        for option, value in values.items():
            tab.run(f"""(() => {{ const box = document.getElementById("option-{option}"); box.value = {json.dumps(value)};
                box.dispatchEvent(new Event("input")); return 1; }})()""")

    done = "studio.evidence.jobs.state('command')?.state === 'done' && Boolean(document.querySelector('#printed'))"
    choose("modes")
    tab.click("#begin-command")
    tab.wait(done, 60)
    assert not tab.run("document.querySelector('.command-options').open")  # the result is seen without scrolling
    first = tab.run("document.querySelector('#printed').textContent")
    tab.run("studio.runs.setValue('damper.d', '3 kN*s/m'), 1")
    tab.wait(f"{done} && document.querySelector('#printed').textContent !== {json.dumps(first)}", 60)
    printed = CliRunner().invoke(main, ["modes", str(server.folder / "swept.yaml"), "--set", "damper.d=3 kN*s/m"]).output
    assert tab.run("document.querySelector('#printed').textContent").split() == printed.split()
    tab.run("studio.runs.setValues({}), 1")
    tab.wait(f"{done} && document.querySelector('#printed').textContent === {json.dumps(first)}", 60)
    choose("sweep", overs="damper.d=0.5 .. 3 kN*s/m; 3\nbody.m=300 kg, 320 kg", measures="rms(body.x) in mm")
    tab.click("#begin-command")
    tab.wait("studio.evidence.jobs.state('command')?.result?.command?.includes('sweep')", 60)
    assert tab.run("document.querySelector('#printed').textContent").count("wrote") >= 3
    assert tab.run("document.querySelectorAll('#evidence img').length") == 2  # the curves and the map of the sweep
    choose("linear")  # fields that take names offer those of the diagram
    assert tab.run("[...document.querySelectorAll('#names-inputs option')].map(option => option.value)") == ["road.u"]
    assert tab.run("""(() => { const add = document.querySelector("[aria-label='add a name to from']"); add.value = "road.u";
        add.dispatchEvent(new Event("change")); return document.getElementById("option-inputs").value; })()""") == "road.u"
    tab.click("#begin-command")  # without an output: the options stay open
    tab.wait("studio.evidence.jobs.state('command')?.state === 'failed' && document.querySelector('.command-options').open",
             60)
    tab.wait("document.querySelector('#evidence .task .verdict') !== null")  # what is missing is said above the options
    said, options = (tab.run(f"document.querySelector('#evidence {what}').getBoundingClientRect().y")
                     for what in (".verdict", ".command-options"))
    assert said < options
    assert tab.complaints == []


def test_a_command_prints_what_it_prints_on_the_command_line(car: Path) -> None:
    with confined(car.parent):
        told = run_command(car, {"command_line": LINE, "command": "modes", "values": {"settings": ["damper.d=2 kN*s/m"]}},
                           car.parent)
    printed = CliRunner().invoke(main, ["modes", str(car), "--set", "damper.d=2 kN*s/m"]).output
    assert told["text"].split() == printed.split() and told["files"] == [] and "Hz" in printed
    assert told["command"] == "heavebond modes car.yaml '--set=damper.d=2 kN*s/m'"
    with pytest.raises(UsageError, match=r"nothing\.d"):
        run_command(car, {"command_line": LINE, "command": "modes", "values": {"settings": ["nothing.d=2 kN*s/m"]}},
                    car.parent)


def test_records_of_the_folder_are_monitored(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    (folder / "records").mkdir(parents=True)
    write_experiment(folder)
    write_record(folder / "records" / "sound.csv", 0)
    write_record(folder / "records" / "softer.csv", 3, count=400, stiffness={250: 42.0})
    form = next(f for f in forms(LINE)["experiment"] if f["name"] == "monitor")
    assert form["options"][0] | {"help": ""} == {"name": "records", "flag": "records", "help": "", "metavar": "NAME",
                                                "kind": "text", "choices": [], "several": True, "required": True}
    asked = {"command_line": LINE, "command": "monitor", "values": {"records": ["records"], "number": "0"}}
    with confined(folder):
        told = run_command(folder / "rig.yaml", asked, folder)
        for outside in ("../other", "/etc", ".hidden"):
            with pytest.raises(UsageError, match="outside"):
                run_command(folder / "rig.yaml", {**asked, "values": {"records": [outside]}}, folder)
        with pytest.raises(UsageError, match="RECORDS"):
            run_command(folder / "rig.yaml", {**asked, "values": {}}, folder)
    assert told["command"] == "heavebond monitor rig.yaml records --diagnose=0"
    assert told["code"] == 1 and told["files"] == ["rig_monitor/monitor.html"] and "softer" in told["text"]
    assert (folder / "rig_monitor" / "softer.png").is_file()


@pytest.mark.long
def test_an_export_is_written_into_the_folder_and_a_picture_is_returned(car: Path) -> None:
    with confined(car.parent):
        told = run_command(car, {"command_line": LINE, "command": "export", "format": "c"}, car.parent)
        drawn = run_command(car, {"command_line": LINE, "command": "linear", "picture": True,
                                  "values": {"inputs": ["road.u"], "outputs": ["body.x"]}}, car.parent)
        with pytest.raises(UsageError, match="unknown"):
            run_command(car, {"command_line": LINE, "command": "export", "format": "../x.c"}, car.parent)
        flow = run_command(car, {"command_line": LINE, "command": "energy", "picture": True}, car.parent)
        swept = run_command(car, {"command_line": LINE, "command": "sweep", "values": {
            "overs": ["damper.d=0.5 .. 3 kN*s/m; 2", "body.m=300 kg, 320 kg"], "measures": ["rms(body.x) in mm"]}},
            car.parent)
    assert told["files"] == ["car.c"] and (car.parent / "car.c").is_file()
    assert len(flow["pictures"]) == 1 and "damper" in flow["pictures"][0]["svg"]
    assert len(swept["pictures"]) == 2 and all("<svg" in p["svg"] for p in swept["pictures"])
    shutil.rmtree(car.parent / "car_sweep")
    assert "<svg" in drawn["pictures"][0]["svg"] and str(car.parent) not in drawn["text"]
    assert sorted(p.name for p in car.parent.iterdir()) == ["car.c", "car.yaml"]
    assert sorted(p.name for p in car.parent.parent.iterdir()) == ["folder"]


@pytest.mark.long
def test_a_design_is_written_as_a_diagram_that_extends_the_open_one(tmp_path: Path) -> None:
    servo = tmp_path / "servo.yaml"
    servo.write_text("""model: servo
components:
  control: {is: DiscretePID, K_p: 1, K_d: 0 s, T_f: 10 ms, y_min: -24, y_max: 24, T_s: 10 ms, r: 0, u: =gear.y}
  motor:   {is: FirstOrderLag, T_1: 0.1 s, u: =control.y}
  gear:    {is: Integrator, k: 1.5 1/s, u: =motor.y}
initial: {gear.y: 0, motor.y: 0}
simulate: {until: 2 s, every: 5 ms}
""", encoding="utf-8")
    values = {"loop": "control.y", "free": ["control.K_p,control.K_d"], "crossover": "2 Hz", "phase_margin": "60 deg"}
    with confined(tmp_path):
        told = [run_command(servo, {"command_line": LINE, "command": "design", "values": values, "format": suffix}, tmp_path)
                for suffix in ("", "yaml", "yaml")]
    assert [done["files"] for done in told] == [[], ["servo_designed.yaml"], ["servo_designed_2.yaml"]]
    crossings = hb.loop_crossings(tmp_path / "servo_designed.yaml", "control.y")
    assert crossings.least_phase is not None and crossings.least_phase.value == pytest.approx(60, rel=1e-3)
