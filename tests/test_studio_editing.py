"""The studio in a headless browser: a diagram built, changed and undone by mouse and by keyboard."""

from __future__ import annotations

import difflib
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import browser
import numpy as np
import pytest
from studio_pages import Server, server, tab
from test_studio_page import CAR, _open

import heavebond as hb

__all__ = ["server", "tab"]


@pytest.fixture(autouse=True)
def _left(tab: browser.Tab, server: Server) -> Iterator[None]:
    """The page may be left without a question, without a draft and without charts for the next test."""
    yield
    tab.run("(() => { if (window.studio?.document) { studio.document.text = studio.editor.text; studio.file.keepDraft(); } "
            "localStorage.clear(); })()")
    shutil.rmtree(server.folder / ".heavebond", ignore_errors=True)


def _true(tab: browser.Tab, script: str, patience: float = browser.PATIENCE) -> None:
    tab.wait(f"Boolean({script})", patience)


def _drag(tab: browser.Tab, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Press, move in steps and release, as a hand does."""
    tab.mouse("Moved", *start)
    tab.mouse("Pressed", *start, button="left", clickCount=1)
    for k in range(1, 5):
        tab.mouse("Moved", *(a + (b - a) * k / 4 for a, b in zip(start, end, strict=True)), button="left")
    tab.mouse("Released", *end, button="left", clickCount=1)


def _spot(tab: browser.Tab, x: float, y: float) -> tuple[float, float]:
    """The point on the screen of a place of the drawing, in steps of the grid."""
    x, y = tab.run(f"""(() => {{ const d = studio.diagram, box = d.sheet.getBoundingClientRect(),
        view = d.svg.viewBox.baseVal;
        return [box.x + d.x + (10 * {x} - view.x) * d.scale, box.y + d.y + (10 * {y} - view.y) * d.scale]; }})()""")
    return x, y


def _settled(tab: browser.Tab, script: str) -> None:
    """Once the edit has come back, the drawing is that of the text, and its transform is set."""
    _true(tab, script)
    tab.run("studio.edits.turn.then(() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => "
            "done(1)))))")


def _bring(tab: browser.Tab, kind: str, x: float, y: float, name: str) -> None:
    """A component from the library by mouse."""
    tab.run("document.getElementById('palette-search').select()")
    tab.run("document.getElementById('palette-search').focus()")
    tab.write(kind)
    selector = f"[data-component='{kind}']"
    _true(tab, f"document.querySelector({selector!r})")
    _drag(tab, tab.middle(selector), _spot(tab, x, y))
    _settled(tab, f"studio.view.parts.{name}")


def _wire(tab: browser.Tab, one: str, two: str) -> None:
    _drag(tab, tab.middle(f"[data-port='{one}']"), tab.middle(f"[data-port='{two}']"))
    _settled(tab, f"!studio.wiring.from && studio.view.parts['{one.split('.')[0]}'].ports.some("
                  f"p => p.path === '{one}' && p.node)")


def _fill(tab: browser.Tab, path: str, value: str) -> None:
    """A value typed into the panel."""
    field = f"document.getElementById('p-{path}')"
    _true(tab, field)
    tab.run(f"{field}.focus(), {field}.select(), 1")
    tab.write(value)
    tab.key("Enter", code=13, text="\r")
    _settled(tab, f"studio.editor.text.includes({value!r})")


def _new(tab: browser.Tab, server: Server, name: str) -> None:
    tab.go("about:blank")
    tab.go(server.address)
    tab.click("#new-empty")
    tab.run("document.getElementById('ask-name').select()")
    tab.write(name)
    tab.key("Enter", code=13, text="\r")
    _true(tab, f"studio.document?.name === '{name}.yaml' && studio.view?.parts")


BUILT = """\
model: built
components:
  mass: {is: Mass, m: 320 kg}
  spring: {is: Spring, c: 22 kN/m}
  damper: {is: Damper, d: 1.5 kN*s/m}
  wheel:  {is: Mass, m: 40 kg}
  tyre: {is: SpringDamper, c: 190 kN/m, d: 150 N*s/m}
  road: {is: PositionSource, u: =30 mm*exp(-((time - 1 s)/0.1 s)**2)}
nodes:
  mass: [mass.a, spring.b, damper.b]
  wheel: [wheel.a, spring.a, damper.a, tyre.b]
  road: [tyre.a, road.a]
simulate: {until: 5 s, every: 5 ms}
layout:
  parts:
    mass: [0, 0]
    spring: [0, 10]
    damper: [13, 10]
    wheel:  [0, 20]
    tyre: [0, 30]
    road: [0, 40]
"""


HIDDEN = """\
model: real
extends: built.yaml
components: {friction: {is: CoulombFriction, F_c: 120 N}}
nodes: {mass: [+friction.b], wheel: [+friction.a]}
"""


def _measured(folder: Path) -> dict[str, str]:
    """Two records of the car that was built, with a dry friction that it does not have and noise, as texts of CSV files."""
    (folder / "real.yaml").write_text(HIDDEN, encoding="utf-8")
    model, noise, found = hb.load(folder / "real.yaml"), np.random.default_rng(5), {}
    (folder / "real.yaml").unlink()
    for day, motion in (("monday", "25 mm*sin(2*pi*time/1.1 s) + 8 mm*sin(2*pi*time/0.37 s)"),
                        ("tuesday", "15 mm*sin(2*pi*time/0.8 s) + 12 mm*sin(2*pi*time/2.3 s)")):
        driven = model.with_parameters({"road.u": f"=(1 - exp(-(time/0.5 s)**2))*({motion})"})
        run = hb.simulate(driven, "6 s", every="20 ms")
        columns = [run.time, run.si["road.x"], *(run.si[name] + 1e-4 * noise.standard_normal(len(run.time))
                                                 for name in ("mass.x", "wheel.x"))]
        rows = [",".join(f"{v:.7g}" for v in row) for row in zip(*columns, strict=True)]
        found[f"{day}.csv"] = "\n".join(["time_s,road_m,mass_m,wheel_m", *rows]) + "\n"
    return found


def _diagnosed(tab: browser.Tab, folder: Path) -> None:
    """The records dropped on the car, the missing effect identified and added, and the files as they are then."""
    tab.drop("#sheet", _measured(folder))
    _true(tab, "document.querySelector('#record-form').open")
    chosen = tab.run("[...document.querySelectorAll('#record-form tbody tr')].map(row => [...row.querySelectorAll("
                     "'select, input')].filter(field => !field.hidden).map(field => field.value).join(' '))")
    assert chosen == ["time s", "input road.u m  spline", "output mass.x m ", "output wheel.x m "]
    tab.run("document.getElementById('free-damper.d').focus()")
    tab.key(" ", code=32, text=" ")
    tab.click("#make-experiment")
    _true(tab, "studio.view?.evidence && studio.evidence.told")
    name = tab.run("studio.document.name")
    written = {p: p.read_text(encoding="utf-8") for p in folder.rglob("*.yaml")}
    tab.click("#tab-diagnose")
    _true(tab, "document.querySelector('#only')")
    tab.click("#only")
    _true(tab, "document.querySelector('.class-list input')")
    tab.click(".class-list input[value='dry friction']")
    tab.click("#begin-diagnose")
    _true(tab, "studio.evidence.jobs.state('diagnose')?.state === 'done'", 180)
    rungs = tab.run("studio.evidence.jobs.state('diagnose').ladder")
    assert rungs[-1]["name"] == "+ CoulombFriction between wheel and mass"
    assert rungs[0]["chi2_held_out"] > 20 and rungs[-1]["chi2_held_out"] < 1.3
    tab.click("#add-0")
    _true(tab, f"studio.document.name !== {name!r} && studio.evidence.told")
    _true(tab, "document.querySelector('#note')?.innerText.includes('the error fell from')")
    assert tab.run("studio.evidence.told.records.tuesday.chi2_per_sample") < 1.3
    assert all(p.read_text(encoding="utf-8") == text for p, text in written.items())
    added = [line[1:] for line in difflib.ndiff(BUILT.splitlines(), (folder / "built_2.yaml").read_text().splitlines())
             if line[0] == "+"]
    assert any("coulomb_friction: {is: CoulombFriction" in line for line in added) and len(added) < 12
    assert any("[+coulomb_friction." in line for line in added)


@pytest.mark.long
def test_a_quarter_car_is_built_from_nothing_run_and_diagnosed(tab: browser.Tab, server: Server) -> None:
    """Parts from the library, values, names, wires; then it is run and saved, and its text is what a person would write.
    A slider is moved, records are dropped, the effect that they show is identified and added, and the error falls."""
    _new(tab, server, "built")
    tab.click("#open-library")
    _true(tab, "document.getElementById('palette-search')", 60)
    tab.write("mass")
    _true(tab, "studio.palette.components", 60)
    tab.key("Enter", code=13, text="\r")  # the first one by the keyboard
    _settled(tab, "studio.view.parts.mass && studio.view.places?.mass")
    _fill(tab, "mass.m", "320 kg")
    tab.run("studio.diagram.zoom(0.45); studio.diagram.move(0, -180)")  # room for the other parts
    for kind, name, column, row, new, values in (
            ("Spring", "spring", 0, 10, "", {"c": "22 kN/m"}), ("Damper", "damper", 13, 10, "", {"d": "1.5 kN*s/m"}),
            ("Mass", "mass2", 0, 20, "wheel", {"m": "40 kg"}),
            ("SpringDamper", "spring_damper", 0, 30, "tyre", {"c": "190 kN/m", "d": "150 N*s/m"}),
            ("PositionSource", "position_source", 0, 40, "road", {"u": "=30 mm*exp(-((time - 1 s)/0.1 s)**2)"})):
        _bring(tab, kind, column, row, name)
        for key, value in values.items():
            _fill(tab, f"{name}.{key}", value)
        if new:
            tab.run("document.getElementById('sheet').focus()")
            tab.key("F2", code=113)
            tab.write(new)
            tab.key("Enter", code=13, text="\r")
            _settled(tab, f"studio.view.parts.{new}")
    for one, two in (("mass.a", "spring.b"), ("damper.b", "mass.a"), ("wheel.a", "spring.a"), ("damper.a", "wheel.a"),
                     ("tyre.b", "wheel.a"), ("tyre.a", "road.a")):
        _wire(tab, one, two)
    assert tab.run("studio.editor.text") == BUILT
    assert tab.run("document.querySelector('#problems').innerText") == "No problems found."
    tab.key("s", ctrl=True)
    _true(tab, "!studio.unsaved")
    assert (server.folder / "built.yaml").read_text(encoding="utf-8") == BUILT
    tab.key("Enter", ctrl=True, code=13)
    _true(tab, "studio.runs.live && !studio.runs.busy")
    result = hb.simulate(hb.load(server.folder / "built.yaml"))
    name = next(iter(result.assembly.state_names))
    assert tab.run(f"studio.runs.live.told.outputs[{name!r}].max") == result.figures([name])[name].most
    tab.click("g.part[data-part='damper'] .frame")
    x, y = tab.middle("[id='s-damper.d']")
    _drag(tab, (x, y), (x + 40, y))
    _true(tab, "studio.runs.live?.values['damper.d'] && !studio.runs.live.preview && !studio.runs.busy")
    value = tab.run("studio.runs.values['damper.d']")
    result = hb.simulate(hb.load(server.folder / "built.yaml").with_parameters({"damper.d": value}))
    assert tab.run(f"studio.runs.live.told.outputs[{name!r}].max") == result.figures([name])[name].most
    tab.click("[id='p-damper.d-reset']")
    _true(tab, "Object.keys(studio.runs.values).length === 0 && !studio.runs.busy")
    _diagnosed(tab, server.folder)
    assert tab.complaints == []


@pytest.mark.long
def test_the_drawing_is_changed_and_undone_by_the_keyboard(tab: browser.Tab, server: Server) -> None:
    """Select, move, turn, rename, copy, wire, delete without a mouse; undo goes back over drawing and text alike."""
    _open(tab, server)
    texts = [CAR]

    def key(name: str, wanted: str, **more: int | str | bool) -> None:
        tab.key(name, **more)
        _settled(tab, wanted)
        texts.append(tab.run("studio.editor.text"))

    tab.run("studio.diagram.group('damper').focus()")
    tab.key("Enter", code=13)
    _true(tab, "studio.picked?.path === 'damper'")
    tab.run("studio.diagram.group('damper').focus()")
    places = tab.run("studio.view.places.damper")
    tab.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight", windowsVirtualKeyCode=39, modifiers=8)
    _settled(tab, "/damper: .[0-9]/.test(studio.editor.text)")
    assert tab.run("studio.view.places.damper[0]") == places[0] + 2
    texts.append(tab.run("studio.editor.text"))
    key("r", f"studio.view.places.damper[2] !== {places[2]!r}")
    key("m", f"studio.editor.text !== {texts[-1]!r}".replace("\\n", "\\n"))
    key("d", "studio.view.parts.damper2", ctrl=True)
    assert tab.run("studio.picked.path") == "damper2"
    tab.run("document.getElementById('sheet').focus()")
    tab.key("w")
    _true(tab, "document.activeElement.dataset?.port === 'damper2.a'")
    tab.key("Enter", code=13)
    _true(tab, "studio.wiring.from?.path === 'damper2.a' && document.activeElement.classList.contains('fits')")
    tab.run("studio.wiring.ports.get('wheel.a').marks[0].focus()")
    key("Enter", "studio.editor.text.includes('tyre.b, damper2.a]')", code=13)
    went, came = ([line[2:] for line in difflib.ndiff(CAR.splitlines(), texts[-1].splitlines()) if line[0] == sign]
                  for sign in "-+")
    assert [line.split(":")[0].strip() for line in went] == ["wheel"]
    assert [line.split(":")[0].strip() for line in came][:4] == ["damper2", "wheel", "layout", "parts"]
    tab.run("studio.pick('part', 'damper'); document.getElementById('sheet').focus()")
    key("Delete", "!studio.view.parts.damper", code=46)
    for text in reversed(texts[:-1]):
        tab.run("document.getElementById('sheet').focus()")
        tab.key("z", ctrl=True)
        _true(tab, f"studio.editor.text === {text!r}".replace("\\n", "\\n"))
    _true(tab, "!studio.unsaved && studio.view.parts.damper && !studio.view.parts.damper2")
    tab.call("Input.dispatchKeyEvent", type="keyDown", key="Z", windowsVirtualKeyCode=90, modifiers=10)
    _true(tab, f"studio.editor.text === {texts[1]!r}")
    assert tab.complaints == []


@pytest.mark.long
def test_a_part_is_dragged_and_what_does_not_fit_is_told(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    seen = "[studio.diagram.scale, studio.diagram.point({clientX: 500, clientY: 400})]"
    before, still = tab.run("studio.view.places"), tab.run(seen)
    x, y = _spot(tab, *before["damper"][:2])
    scale = tab.run("10*studio.diagram.scale")
    _drag(tab, (x, y), (x + 6.2 * scale, y + 9.7 * scale))  # 6 and 10 steps, on the grid
    _settled(tab, "studio.editor.text.includes('layout:')")
    assert tab.run("studio.view.places") == {**before, "damper": [before["damper"][0] + 6, before["damper"][1] + 10,
                                                                  *before["damper"][2:]]}
    assert tab.run(seen) == still  # nothing is refitted
    assert tab.run("studio.editor.text").startswith(CAR)
    tab.click("#undo")
    _true(tab, "!studio.unsaved")
    tab.run("studio.edits.act({act: 'place', kind: 'Tank', x: 60, y: 0}).then(() => 1)")
    _settled(tab, "studio.view.parts.tank")
    before = tab.run("studio.editor.text")
    _drag(tab, tab.middle("[data-port='tank.a']"), tab.middle("[data-port='body.a']"))
    _true(tab, "!document.getElementById('reason').hidden")
    assert "a hydraulic port" in tab.run("document.getElementById('reason').innerText")
    assert tab.run("studio.editor.text") == before
    assert tab.complaints == []


@pytest.mark.long
def test_wires_notes_and_the_clipboard_by_mouse_and_keyboard(tab: browser.Tab, server: Server) -> None:
    """A piece of a wire is dragged and stays there, a note is written and dragged, parts go to another diagram by the
    clipboard, and the drawing is saved as a picture."""
    _open(tab, server)
    x1, y1, x2, y2 = tab.run("""(() => { const d = document.querySelector("path.wire[data-node=body]").getAttribute("d");
        const lines = d.split("M").filter(Boolean).map(l => l.split("L").map(p => p.trim().split(" ").map(Number)));
        let best = [0, 0, 0, 0]; for (const l of lines) for (let k = 1; k < l.length; k++)
            if (l[k][1] === l[k-1][1] && Math.abs(l[k][0] - l[k-1][0]) > Math.abs(best[2] - best[0]))
                best = [...l[k-1], ...l[k]];
        return best.map(v => v / 10); })()""")
    assert y1 == y2
    _drag(tab, _spot(tab, (x1 + x2) / 2, y1), _spot(tab, (x1 + x2) / 2, y1 - 1))
    _settled(tab, "studio.view.routed.includes('body')")
    piece = tab.run("JSON.parse(studio.editor.text.match(/body: (\\[\\[.*?\\]\\])/)[1])")
    assert piece == [[x1, y1 - 1, x2, y1 - 1]]
    tab.click("#item-unroute")
    _settled(tab, "!studio.view.routed.length")
    tab.click("#add-note")
    _true(tab, "document.activeElement.id === 'note-text'")
    assert tab.run("""(() => {
        const a = document.querySelector("[data-note=note]").getBoundingClientRect();
        const inside = (x, y) => x > a.x && x < a.right && y > a.y && y < a.bottom;
        const parts = [...document.querySelectorAll("g.part")].map(part => part.getBoundingClientRect());
        const wires = [...document.querySelectorAll("path.wire")].flatMap(wire => [...Array(500).keys()].map(k =>
            wire.getPointAtLength(k / 500 * wire.getTotalLength()).matrixTransform(wire.getScreenCTM())));
        return parts.some(b => a.x < b.right && b.x < a.right && a.y < b.bottom && b.y < a.bottom)
            || wires.some(p => inside(p.x, p.y)); })()""") is False  # a new note lies on no part and no wire
    tab.write("not measured")
    tab.run("document.activeElement.blur()")
    _settled(tab, "studio.view.notes.note?.text === 'not measured'")
    x, y = tab.run("studio.view.notes.note.at")
    _drag(tab, _spot(tab, x + 2, y + 0.7), _spot(tab, x - 3, y + 4.7))
    _settled(tab, f"studio.view.notes.note.at[0] === {x - 5} && studio.view.notes.note.at[1] === {y + 4}")
    tab.run("navigator.clipboard.writeText = async text => { window.clip = text; }; studio.chooseParts(['wheel', 'tyre']); "
            "document.getElementById('sheet').focus()")
    tab.key("c", ctrl=True)
    clip = tab.wait("window.clip")
    assert "wheel: {is: Mass, m: 40 kg}" in clip and "[wheel.a, tyre.b]" in clip
    saved = "new Promise(done => { URL.createObjectURL = blob => (blob.arrayBuffer().then(b => done([...new Uint8Array(b)." \
            "slice(0, 4)])), 'data:,'); const s = document.getElementById('picture'); s.value = '%s'; s.onchange(); })"
    assert bytes(tab.run(saved % "svg")) == b"<svg" and bytes(tab.run(saved % "png")) == b"\x89PNG"
    assert tab.complaints == []
    tab.run("studio.document.text = studio.editor.text; studio.file.keepDraft()")
    _new(tab, server, "other")
    tab.run(f"""(() => {{ const data = new DataTransfer(); data.setData("text/plain", {json.dumps(clip)});
        document.getElementById("sheet").dispatchEvent(new ClipboardEvent("paste", {{clipboardData: data, bubbles: true,
        cancelable: true}})); }})()""")
    _settled(tab, "studio.view?.parts?.tyre && studio.view.parts.wheel.ports[0].node === 'wheel'")
    assert tab.run("studio.chosen") == ["wheel", "tyre"]
    assert tab.complaints == []


@pytest.mark.long
def test_parts_are_selected_together_and_moved_copied_and_deleted(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    left, top, right, bottom = tab.run("""(() => { const box = p => document.querySelector(`g.part[data-part=${p}] .frame`)
        .getBoundingClientRect(), [a, b, c] = ["wheel_weight", "wheel", "tyre"].map(box);
        return [a.left, b.top, b.right, c.bottom]; })()""")
    start, end = (left - 5, top - 5), (right + 5, bottom + 5)  # a rectangle by Shift and the mouse
    tab.mouse("Pressed", *start, button="left", clickCount=1, modifiers=8)
    tab.mouse("Moved", *end, button="left", modifiers=8)
    tab.mouse("Released", *end, button="left", clickCount=1, modifiers=8)
    assert sorted(tab.run("studio.chosen")) == ["tyre", "wheel", "wheel_weight"]
    x, y = tab.middle("g.part[data-part='wheel_weight'] .frame")
    tab.mouse("Pressed", x, y, button="left", clickCount=1, modifiers=8)  # Shift and a click takes one away
    tab.mouse("Released", x, y, button="left", clickCount=1, modifiers=8)
    assert sorted(tab.run("studio.chosen")) == ["tyre", "wheel"]
    for chosen in (["tyre", "wheel", "wheel_weight"], ["tyre", "wheel"]):  # the same by the keyboard
        tab.run("document.querySelector('g.part[data-part=wheel_weight]').focus()")
        tab.key("Enter", shift=True, code=13)
        assert sorted(tab.run("studio.chosen")) == chosen
    tab.run("document.getElementById('sheet').focus()")
    tab.key("d", ctrl=True)
    _settled(tab, "studio.chosen.includes('tyre2') && studio.chosen.includes('wheel2')")
    assert "wheel2: [wheel2.a, tyre2.b]" in tab.run("studio.editor.text")
    where = "JSON.stringify(['wheel2', 'tyre2'].map(p => studio.view.places[p].slice(0, 2)))"
    before = tab.run(where)
    (a, b), (c, d) = json.loads(before)
    _drag(tab, _spot(tab, c, d), _spot(tab, c + 8, d - 3))
    _settled(tab, f"studio.chosen.length === 2 && {where} !== {before!r}")
    assert json.loads(tab.run(where)) == [[a + 8, b - 3], [c + 8, d - 3]]
    tab.run("document.getElementById('sheet').focus()")
    tab.key("Delete", code=46)
    _settled(tab, "!studio.view.parts.wheel2 && !studio.view.parts.tyre2")
    assert tab.run("studio.editor.text").startswith(CAR)
    tab.key("z", ctrl=True)
    _settled(tab, "Boolean(studio.view.parts.wheel2)")
    assert tab.complaints == []


@pytest.mark.long
def test_the_text_is_completed_from_the_library_and_the_diagram(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)

    def offered(before: str, typed: str) -> list[str]:
        """What is offered behind a text, once the cursor stands there and something is typed."""
        tab.run(f"""(() => {{ const v = studio.editor.view, at = v.state.doc.toString().indexOf({before!r}) + {len(before)};
            v.focus(); v.dispatch({{selection: {{anchor: at}}}}); }})()""")
        tab.write(typed)
        _true(tab, "document.querySelector('.cm-tooltip-autocomplete li')", 60)
        found: list[str] = tab.run("[...document.querySelectorAll('.cm-tooltip-autocomplete .cm-completionLabel')]"
                                   ".map(e => e.textContent)")
        tab.run("studio.editor.undo()")
        tab.key("Escape", code=27)
        return found

    assert "Spring" in offered("spring:      {is: ", "Spr")
    assert "g" in offered("{is: Weight, m: =body.m, ", "g")
    assert "tyre.a" in offered("road:  [", "ty")
    assert "wheel.x" in offered("body:       {is: ", "whe")
    assert tab.complaints == []


def _chain(parts: int, columns: int = 25) -> str:
    """Masses with springs and dampers between them, in rows to and fro."""
    lines, nodes, before = ["model: many", "components:", "  wall: {is: Fixed, at: [0, 0]}"], ["nodes:"], "wall.a"
    for k in range(parts - 1):
        row, column = divmod(k, columns)
        at = f"[{column + 1 if row % 2 == 0 else columns - column}, {row}]"
        kind = "Mass, m: 1 kg" if k % 2 else "SpringDamper, c: 1 kN/m, d: 10 N*s/m"
        lines.append(f"  p{k}: {{is: {kind}, at: {at}}}")
        if k % 2 == 0:
            after = f"p{k}.b, p{k + 1}.a" if k + 2 < parts else f"p{k}.b"
            nodes.append(f"  n{k}: [{before}, p{k}.a]" if before == "wall.a" else f"  n{k}: [{before}p{k}.a]")
            before = f"{after}, "
    return "\n".join([*lines, *nodes, f"  last: [{before.removesuffix(', ')}]", "initial: {start: rest}",
                      "simulate: {until: 1 s}"]) + "\n"


@pytest.mark.slow
def test_500_parts_are_moved_at_30_frames_a_second(tab: browser.Tab, server: Server) -> None:
    """The sheet follows the mouse, and what is typed is not held up by the layout, which is made by a worker."""
    (server.folder / "many.yaml").write_text(_chain(500), encoding="utf-8")
    tab.go("about:blank")
    tab.go(f"{server.address}#many.yaml")
    _true(tab, "window.studio?.view?.svg && studio.document?.name === 'many.yaml'", 120)
    assert tab.run("document.querySelectorAll('g.part').length") == 500
    tab.run("window.frames = []; (function next(t) { window.frames.push(t); requestAnimationFrame(next); })(0)")
    tab.mouse("Pressed", 900, 300, button="middle", clickCount=1)
    tab.run("window.frames.length = 0")
    for k in range(100):
        tab.mouse("Moved", 900 + k % 60, 300 + k % 40, button="middle")
    frames = tab.run("window.frames")
    tab.mouse("Released", 900, 300, button="middle", clickCount=1)
    assert (len(frames) - 1) / (frames[-1] - frames[0]) * 1000 >= 30
    tab.run("window.held = []; new PerformanceObserver(list => window.held.push(...list.getEntries().map(e => e.duration)))"
            ".observe({entryTypes: ['longtask']}); (() => { const v = studio.editor.view; v.focus(); "
            "v.dispatch({selection: {anchor: v.state.doc.length}}); })()")
    for letter in "# as fast as one types":
        tab.write(letter)
    _settled(tab, "studio.editor.text.endsWith('types')")
    assert max(tab.run("window.held") or [0]) < 500  # ms; the layout takes seconds
