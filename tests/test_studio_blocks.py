"""Blocks in the studio: the inside of a component drawn and edited in its own file."""

from __future__ import annotations

import difflib
import json
from pathlib import Path

import browser
import pytest
from studio_pages import Server, server, tab

from heavebond.core.errors import UsageError
from heavebond.studio.bench import view
from heavebond.studio.edit_actions import edited
from heavebond.studio.job import Job

__all__ = ["server", "tab"]

RIG = """\
model: rig
components:
  wall: {is: Fixed, at: [0, 0]}
  strut: {is: Strut, at: [1, 0]}
  load: {is: Mass, m: 100 kg, at: [2, 0]}
nodes:
  ground: [wall.a, strut.a]
  load: [strut.b, load.a]
initial: {load.x: 20 mm, load.v: 0 m/s}
simulate: {until: 1 s, every: 10 ms}
"""
STRUT = """\
component: Strut
summary: A spring and a damper side by side.
ports: {a: translational, b: translational, gauge: {signal: out, unit: m}}
parameters:
  c: {unit: N/m, doc: stiffness, default: 4 kN/m}   # of the data sheet
components:
  spring: {is: Spring, c: =c, at: [0, 0]}   # steel
  damper: {is: Damper, d: 100 N*s/m, at: [0, 1]}
  sensor: {is: RelativePositionSensor, at: [0, 2]}
nodes:
  left: [a, spring.a, damper.a, sensor.a]
  right: [b, spring.b, damper.b, sensor.b]
  length: [sensor.y, gauge]
"""


def _job(folder: Path, text: str = STRUT) -> Job:
    path = folder / "components" / "strut.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return Job(text, str(path), "components/strut.yaml")


def _changed(before: str, after: str) -> list[str]:
    return [line for line in difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm="")
            if not line.startswith(("---", "+++", "@@"))]


def test_the_inside_is_shown_with_the_ports_of_the_block(tmp_path: Path) -> None:
    found = view(_job(tmp_path))
    assert found["problems"] == [] and set(found["parts"]) == {"spring", "damper", "sensor"} and not found["runs"]
    ports = {port["name"]: port for port in found["component"]["ports"]}
    assert [ports[name]["node"] for name in ("a", "b", "gauge")] == ["left", "right", "length"]
    assert ports["a"]["domain"] == "translational" and ports["gauge"]["direction"] == "out"
    assert [(p["path"], p["text"]) for p in found["parameters"]] == [("c", "4 kN/m")]
    assert 'class="own-port"' in found["svg"]
    # what the file gets wrong is told, not what its use in a diagram will give
    bad = view(_job(tmp_path, STRUT.replace("100 N*s/m", "100 N/m").replace(", default: 4 kN/m", "")))
    assert [p["line"] for p in bad["problems"]] == [8]


def test_a_port_on_a_node_inside_a_block_is_connected(tmp_path: Path) -> None:
    _job(tmp_path)
    text = RIG.replace("nodes:\n", "  lid: {is: Mass, m: 1 kg}\nnodes:\n  strut.right: [+lid.a]\n")
    parts = view(Job(text, str(tmp_path / "rig.yaml"), "rig.yaml"))["parts"]
    assert parts["lid"]["ports"][0]["node"] == "strut.right"


@pytest.mark.parametrize(("action", "changed"), [
    ({"act": "set", "path": "damper.d", "value": "50 N*s/m"},
     ["-  damper: {is: Damper, d: 100 N*s/m, at: [0, 1]}", "+  damper: {is: Damper, d: 50 N*s/m, at: [0, 1]}"]),
    ({"act": "set", "path": "c", "value": "5 kN/m"},
     ["-  c: {unit: N/m, doc: stiffness, default: 4 kN/m}   # of the data sheet",
      "+  c: {unit: N/m, doc: stiffness, default: 5 kN/m}   # of the data sheet"]),
    ({"act": "leave", "port": "a"},
     ["-  left: [a, spring.a, damper.a, sensor.a]", "+  left: [spring.a, damper.a, sensor.a]"]),
    ({"act": "join", "from": "a", "to": "spring.b"},
     ["-  left: [a, spring.a, damper.a, sensor.a]", "-  right: [b, spring.b, damper.b, sensor.b]",
      "+  left: [a, spring.a, damper.a, sensor.a, b, spring.b, damper.b, sensor.b]"]),
])
def test_edits_change_the_lines_meant_in_the_file_of_the_block(tmp_path: Path, action: dict[str, object],
                                                               changed: list[str]) -> None:
    job = _job(tmp_path)
    assert _changed(STRUT, edited(job, {"places": view(job)["places"], **action})["text"]) == changed


def test_the_inside_of_a_block_keeps_its_layout_in_the_file_of_the_block(tmp_path: Path) -> None:
    job = _job(tmp_path)
    places = view(job)["places"]
    moved = edited(job, {"act": "move", "to": {"sensor": [21, 17]}, "places": places})["text"]
    assert _changed(STRUT, moved)[:2] == ["+layout:", "+  parts:"]
    after = view(_job(tmp_path, moved))
    assert after["problems"] == [] and after["places"] == {**places, "sensor": [21, 17, *places["sensor"][2:]]}


def test_what_a_block_cannot_have_is_refused_with_the_reason(tmp_path: Path) -> None:
    job = _job(tmp_path)
    for action, said in (({"act": "join", "from": "gauge", "to": "a"}, "signal port"),
                         ({"act": "rename", "part": "spring", "name": "gauge"}, "already a part"),
                         ({"act": "setting", "key": "until", "value": "5 s"}, "is a component")):
        with pytest.raises(UsageError, match=said):
            edited(job, dict(action))


@pytest.mark.long
def test_a_block_is_edited_in_the_page_and_its_diagram_runs_with_it(tab: browser.Tab, server: Server) -> None:
    _job(server.folder)
    (server.folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    tab.go(f"{server.address}#rig.yaml")
    tab.wait("Boolean(window.studio?.view?.parts?.strut)")
    tab.run("studio.editor.replace(studio.editor.text.replace('100 kg', '90 kg'))")  # not saved
    tab.click("g.part[data-part='strut'] .frame")
    tab.click("#edit-block")
    tab.wait("studio.document.name === 'components/strut.yaml' && Boolean(studio.view?.parts?.damper)")
    tab.click("g.part[data-part='damper'] .frame")
    tab.wait("document.getElementById('p-damper.d') !== null")
    tab.run("document.getElementById('p-damper.d').focus(); document.getElementById('p-damper.d').select()")
    tab.write("10 N*s/m")
    tab.key("Enter", code=13, text="\r")
    tab.wait("studio.editor.text.includes('10 N*s/m')")
    assert tab.run("getComputedStyle(document.getElementById('run')).display") == "none"
    tab.key("s", ctrl=True)
    tab.wait("!studio.unsaved")
    saved = (server.folder / "components" / "strut.yaml").read_text(encoding="utf-8")
    assert _changed(STRUT, saved) == ["-  damper: {is: Damper, d: 100 N*s/m, at: [0, 1]}",
                                      "+  damper: {is: Damper, d: 10 N*s/m, at: [0, 1]}"]
    tab.click("#go-back")
    tab.wait("studio.document.name === 'rig.yaml' && Boolean(studio.view?.parts?.strut)")
    tab.wait("studio.editor.text.includes('90 kg')")  # as it was left
    assert tab.run("studio.view.parts.strut.file") == "components/strut.yaml" and not tab.run("studio.view.parts.load.file")
    asked = json.dumps({"name": "rig.yaml", "text": RIG, "values": {}, "names": ["load.x"]})
    told = tab.run(f"studio.link.ask('run', {asked}).then(told => told.outputs['load.x'].final)")
    assert told > 0.017  # m; with the damper of before 0.012
    tab.run("studio.editor.replace(studio.document.text); studio.file.keepDraft()")
    assert tab.complaints == []
