"""The studio in a headless browser: diagrams opened, run and changed, and what happens on disk beside the page."""

from __future__ import annotations

import json
import math
import shutil
import time
from pathlib import Path

import browser
import numpy as np
import pytest
from studio_pages import Server, server, tab

import heavebond as hb
from heavebond.pictures.animation import packed

CAR = (Path(__file__).parents[1] / "models" / "quarter_car" / "quarter_car.yaml").read_text(encoding="utf-8")
__all__ = ["server", "tab"]


def _open(tab: browser.Tab, server: Server, name: str = "car.yaml", text: str = CAR) -> None:
    (server.folder / name).write_text(text, encoding="utf-8")
    tab.wait("!window.studio?.runs.storing")  # the charts of the diagram before
    tab.go("about:blank")
    tab.go(f"{server.address}#{name}")
    tab.wait(f"window.studio?.document?.name === {json.dumps(name)} && studio.view?.parts && "
             "!document.querySelector('#model').hidden")
    tab.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")  # it has its place


def _typed(tab: browser.Tab, old: str, new: str) -> None:
    """Change the text as a user does: by the keyboard, where `old` stands."""
    tab.run(f"""(() => {{ const at = studio.editor.text.indexOf({json.dumps(old)}); studio.editor.view.focus();
        studio.editor.view.dispatch({{selection: {{anchor: at, head: at + {len(old)}}}}}); }})()""")
    tab.write(new)


@pytest.mark.long
def test_a_diagram_is_run_and_its_signals_are_found_by_clicking(tab: browser.Tab, server: Server) -> None:
    (server.folder / "car.yaml").write_text(CAR, encoding="utf-8")
    tab.go(server.address)
    assert "cmc_ahc" in tab.wait("document.querySelector('#home .cards') && document.querySelector('#home').innerText")
    tab.click("[data-open='car.yaml']")
    tab.wait("studio.view?.svg")
    tab.key("Enter", ctrl=True, code=13)
    tab.wait("studio.runs.live && !studio.runs.busy && studio.runs.plots.charts.length > 0")
    result = hb.simulate(hb.load(server.folder / "car.yaml"))
    comfort = result.figures(["comfort"])["comfort"]
    assert tab.run("studio.runs.live.told.outputs.comfort.max") == comfort.most  # to the last digit
    tab.click("g.part[data-part='damper'] .frame")
    tab.wait("document.querySelector('#panel').innerText.includes('Viscous damper')")
    assert tab.run("document.getElementById('p-damper.d').value") == "1.5 kN*s/m"
    tab.click("[id='y-damper.F']")
    tab.wait("studio.runs.live.series.has('damper.F')")
    assert tab.run("Math.max(...studio.runs.live.series.get('damper.F'))") == result.si["damper.F"].max()
    assert tab.run("studio.runs.plots.charts.some(c => c.series.some(s => s.label === 'damper.F'))")
    _shown_on_the_drawing(tab)
    _swept(tab, server.folder / "car.yaml")
    assert tab.complaints == []
    hosts = {address.split("/")[2] for address in tab.requested() if address.startswith("http")}
    assert hosts == {f"127.0.0.1:{server.port}"}


def _shown_on_the_drawing(tab: browser.Tab) -> None:
    """The run is played on the drawing: wires have colours and values, and the charts point at the same instant."""
    wire = "getComputedStyle(document.querySelector('path.wire[data-node=body]'))"
    plain = tab.run(f"{wire}.stroke")
    tab.click("#play")
    tab.wait("studio.animation.data && studio.animation.time > 0.5")
    tab.click("#play")
    assert tab.run(f"{wire}.stroke") != plain and "m/s" in tab.run("document.querySelector('text.node').textContent")
    tab.run("studio.animation.at(1); 1")
    assert tab.run("studio.runs.plots.charts.every(c => Math.abs(c.data[0][c.cursor.idx] - 1) < 0.01)")
    x, y = tab.run("(() => { const b = document.querySelector('.u-over').getBoundingClientRect(); "
                   "return [b.x + b.width / 2, b.y + b.height / 2]; })()")
    tab.mouse("Moved", x, y)
    tab.wait("Math.abs(studio.animation.time - 2) < 0.05")  # the middle of 4 s
    tab.click("#toggle-machine")  # the shapes under `view:` move with it
    tab.wait("Boolean(studio.machine.film)")
    tab.run("studio.animation.at(0); 1")
    shape = "studio.machine.shapes.find(s => s.shape.name === 'tyre').paths[0].getAttribute('d')"
    before = tab.run(shape)
    tab.run("studio.animation.at(1); 1")
    assert tab.run(shape) != before
    _shown_in_space(tab)
    tab.click("#toggle-machine")
    assert tab.run("document.querySelector('#machine').hidden")
    tab.run("studio.animation.choose('modes')")
    tab.wait("document.querySelectorAll('#mode option').length === 2")
    assert "%" in tab.run("document.querySelector('g[data-part=body] > text.part').textContent")
    tab.run("studio.animation.choose('')")
    assert tab.run(f"{wire}.stroke") == plain and tab.run("document.querySelector('text.node').textContent") == "body"


def _shown_in_space(tab: browser.Tab) -> None:
    """The film of a machine in space in the place of the film of a machine in a plane."""
    film = packed(hb.animate(hb.loads("""model: mast
components:
  foot: {is: SpatialPositionSource, x: [0 m, 0 m, 0 m], phi: [0 rad, "=time*1 rad/s", 0 rad]}
  mast: {is: SpatialLink, l_z: 2 m}
nodes: {foot: [foot.a, mast.a], top: [mast.b]}
simulate: {until: 4 s, every: 0.1 s}
""")))
    tab.run(f"studio.machine.film = {json.dumps(film)}; studio.machine.buildInSpace()")
    tab.wait("Boolean(studio.machine.scene)")
    tab.run("studio.animation.at(2); 1")
    tilt = tab.run("studio.machine.scene.solids.find(found => found.solid.kind === 'beam').group.quaternion.toArray()")
    assert tilt == pytest.approx([0, math.sin(1), 0, math.cos(1)], abs=1e-3)
    assert "arrow keys" in tab.run("document.querySelector('#machine canvas').getAttribute('aria-label')")


MAST = """model: mast
components:
  foot: {is: SpatialFixed}
  pin:  {is: SpatialRevoluteJoint, n: [0, 1, 0]}
  rod:  {is: SpatialLink, l_z: 2 m}
  bob:  {is: SpatialPointMass, m: 2 kg}
  drag: {is: RotationalDamper, d: 1 N*m*s/rad}
  rest: {is: FixedShaft}
nodes: {foot: [foot.a, pin.a], rod: [pin.b, rod.a], bob: [rod.b, bob.a], shaft: [pin.d, drag.a], rest: [drag.b, rest.a]}
initial: {pin.phi: 1 rad, pin.w: 0 rad/s}
simulate: {until: 2 s, every: 20 ms}
"""


@pytest.mark.long
def test_kept_runs_are_overlaid_in_space(tab: browser.Tab, server: Server) -> None:
    """A run that is kept is drawn over the next ones, translucent, until it is hidden or forgotten."""
    _open(tab, server, "mast.yaml", MAST)
    done = "studio.runs.live && !studio.runs.busy"
    tab.key("Enter", ctrl=True, code=13)
    tab.wait(done)
    tab.click("#play")
    tab.wait("studio.animation.data && studio.animation.time > 0")
    tab.click("#toggle-machine")
    tab.wait("Boolean(studio.machine.scene)")
    tab.click("#keep")
    _typed(tab, "m: 2 kg", "m: 50 kg")
    tab.key("Enter", ctrl=True, code=13)
    tab.wait(f"{done} && studio.machine.scene.solids.some(found => found.run === 1)")
    place = "studio.machine.scene.solids.find(found => found.solid.kind === 'beam' && found.run === {}).group.quaternion.y"
    tab.run("studio.animation.at(1); 1")
    assert tab.run(place.format(0)) != pytest.approx(tab.run(place.format(1)), abs=1e-3)
    tab.click("#runs .kept input[type=checkbox]")
    tab.wait("studio.machine.scene.solids.every(found => found.run === 0)")
    assert tab.complaints == []


def _swept(tab: browser.Tab, file: Path) -> None:
    """A run for each of some values, kept with its value as its name; afterwards the value is that of the text."""
    tab.click("[id='sweep-damper.d']")
    tab.wait("document.querySelector('#ask').open")
    tab.write("0.8, 2.5")
    tab.key("Enter", code=13, text="\r")
    tab.wait("studio.runs.kept.length === 2 && !studio.runs.busy && Object.keys(studio.runs.values).length === 0 && "
             "studio.runs.kept.every(run => run.series.has('damper.F'))")
    assert tab.run("studio.runs.kept.map(run => run.label)") == ["d = 0.8 kN*s/m", "d = 2.5 kN*s/m"]
    for k, value in enumerate(("0.8 kN*s/m", "2.5 kN*s/m")):
        result = hb.simulate(hb.load(file).with_parameters({"damper.d": value}))
        assert tab.run(f"Math.max(...studio.runs.kept[{k}].series.get('damper.F'))") == result.si["damper.F"].max()


@pytest.mark.long
def test_a_slider_runs_while_it_moves_and_runs_are_laid_over_each_other(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    shutil.rmtree(server.folder / ".heavebond", ignore_errors=True)  # without the runs that an earlier test kept
    _open(tab, server)
    tab.click("#run")
    tab.wait("studio.runs.live && !studio.runs.busy")
    tab.click("#keep")
    tab.click("g.part[data-part='damper'] .frame")
    x, y = tab.middle("[id='s-damper.d']")
    tab.mouse("Pressed", x, y, button="left", clickCount=1)
    tab.mouse("Moved", x + 30, y, button="left")
    tab.wait("studio.runs.live.preview")
    tab.mouse("Moved", x + 50, y, button="left")
    tab.mouse("Released", x + 50, y, button="left", clickCount=1)
    tab.wait("!studio.runs.live.preview && !studio.runs.busy && studio.runs.live.values['damper.d']")
    value = tab.run("studio.runs.values['damper.d']")
    assert value.endswith(" kN*s/m") and float(value.split()[0]) > 2
    result = hb.simulate(hb.load(server.folder / "car.yaml").with_parameters({"damper.d": value}))
    assert tab.run("studio.runs.live.told.outputs.suspension.max") == result.figures(["suspension"])["suspension"].most
    now = tab.run("studio.runs.plots.charts[0].series.filter(s => s.label?.includes('now')).length")
    assert tab.run("studio.runs.plots.charts[0].series.length") == 1 + 2 * now
    tab.run("document.getElementById('s-damper.d').focus()")
    tab.key("ArrowLeft", code=37)  # the keyboard moves it too
    tab.wait(f"studio.runs.values['damper.d'] !== {json.dumps(value)} && !studio.runs.busy")
    assert (server.folder / "car.yaml").read_text(encoding="utf-8") == CAR
    value = tab.run("studio.runs.values['damper.d']")
    tab.run("document.getElementById('sheet').focus()")
    tab.key("Escape", code=27)  # nothing is selected: the diagram's own panel
    tab.click("#write-values")
    tab.wait("studio.unsaved && Object.keys(studio.runs.values).length === 0")
    assert tab.run("studio.editor.text") == CAR.replace("1.5 kN*s/m", value)
    tab.run("studio.editor.view.focus()")
    tab.key("z", ctrl=True)  # one step of undo
    tab.wait("!studio.unsaved")
    tab.run("window.saved = []; const url = URL.createObjectURL; "
            "URL.createObjectURL = blob => (blob.text().then(t => saved.push(t)), url(blob)); 1")
    tab.click("#csv")
    rows = tab.wait("saved[0]").splitlines()
    assert len(rows) == 2002 and rows[0].startswith("time (run 1) [s],body (run 1) [m]") and "body (now) [m]" in rows[0]
    tab.run("window.picture = null; "
            "URL.createObjectURL = blob => (createImageBitmap(blob).then(p => picture = p), 'data:,')")
    tab.click("#png")
    tab.wait("picture?.width > 300 && picture.height > 150 * studio.runs.plots.charts.length")
    _zoomed(tab)


def _zoomed(tab: browser.Tab) -> None:
    """In time, by the mouse and by keys: all charts together."""
    scales = "studio.runs.plots.charts.map(c => [c.scales.x.min, c.scales.x.max])"
    whole = tab.run(scales)
    assert len(whole) > 1
    x, y, width = tab.run("(() => { const b = document.querySelector('.u-over').getBoundingClientRect(); "
                          "return [b.x, b.y + b.height / 2, b.width]; })()")
    tab.mouse("Pressed", x + 0.25 * width, y, button="left", clickCount=1)
    tab.mouse("Moved", x + 0.4 * width, y, button="left")
    tab.mouse("Moved", x + 0.5 * width, y, button="left")
    tab.mouse("Released", x + 0.5 * width, y, button="left", clickCount=1)
    tab.wait(f"{scales}[0][0] > 0.5")
    seen = tab.run(scales)
    assert seen == [seen[0]] * len(whole) and seen[0] == pytest.approx([1, 2], abs=0.05)
    tab.run("document.querySelector('.chart').focus()")
    tab.key("0", code=48)
    tab.wait(f"JSON.stringify({scales}) === JSON.stringify({json.dumps(whole)})")
    tab.key("+")
    tab.key("ArrowRight", code=39)
    tab.wait(f"{scales}[0][0] > 0")
    seen = tab.run(scales)
    assert seen == [seen[0]] * len(whole) and seen[0][1] - seen[0][0] < 3


@pytest.mark.long
def test_a_mistake_is_shown_at_its_line_and_part_and_saving_changes_what_was_typed(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    _typed(tab, "1.5 kN*s/m", "1.5 kN/m")
    tab.wait("document.querySelector('g.part.faulty')?.dataset.part === 'damper'")
    assert "line 12" in tab.run("document.querySelector('#problems').innerText")
    tab.run("studio.pick('part', 'damper')")
    assert "kN/m" in tab.run("document.querySelector('#panel .verdict').innerText")
    tab.run("studio.editor.view.focus()")
    assert tab.wait("document.querySelectorAll('.cm-lintRange-error').length") == 1
    tab.key("z", ctrl=True)
    tab.wait("!document.querySelector('g.part.faulty') && !studio.unsaved")
    _typed(tab, "1.5 kN*s/m", "1.75 kN*s/m")
    tab.wait("studio.unsaved")
    assert (server.folder / "car.yaml").read_text(encoding="utf-8") == CAR
    tab.key("s", ctrl=True)
    tab.wait("!studio.unsaved")
    assert (server.folder / "car.yaml").read_text(encoding="utf-8") == CAR.replace("1.5 kN*s/m", "1.75 kN*s/m")


@pytest.mark.long
def test_what_changes_on_disk_appears_and_is_never_overwritten(tab: browser.Tab, server: Server) -> None:
    """Also the way in which a second tab learns what the first has saved."""
    _open(tab, server)
    path = server.folder / "car.yaml"
    path.write_text(CAR.replace("40 kg", "45 kg"), encoding="utf-8")
    tab.wait("studio.editor.text.includes('45 kg') && !studio.unsaved")
    _typed(tab, "320 kg", "350 kg")
    path.write_text(CAR.replace("40 kg", "50 kg"), encoding="utf-8")
    tab.wait("document.querySelector('#keep-mine') !== null")
    tab.key("s", ctrl=True)
    time.sleep(0.3)
    assert path.read_text(encoding="utf-8") == CAR.replace("40 kg", "50 kg")
    tab.click("#take-disk")
    tab.wait("studio.editor.text.includes('50 kg') && studio.editor.text.includes('320 kg') && !studio.unsaved")
    tab.run("studio.editor.view.focus()")
    tab.key("z", ctrl=True)
    tab.wait("studio.editor.text.includes('350 kg')")
    tab.key("s", ctrl=True)
    tab.wait("!studio.unsaved")
    assert "350 kg" in path.read_text(encoding="utf-8")


@pytest.mark.long
def test_a_file_that_was_removed_is_told_and_written_anew(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    (server.folder / "car.yaml").unlink()
    assert "has been removed" in tab.wait("!document.querySelector('#banner').hidden && "
                                          "document.querySelector('#banner').innerText")
    assert tab.run("studio.unsaved")
    tab.key("s", ctrl=True)
    tab.wait("!studio.unsaved && document.querySelector('#banner').hidden")
    assert (server.folder / "car.yaml").read_text(encoding="utf-8") == CAR
    (server.folder / "car.yaml").unlink()
    tab.wait("studio.unsaved")
    (server.folder / "car.yaml").write_text(CAR, encoding="utf-8")  # put back by another program
    tab.wait("!studio.unsaved && document.querySelector('#banner').hidden")
    assert tab.complaints == []


@pytest.mark.long
def test_two_tabs_on_one_file_are_reconciled_or_told(tab: browser.Tab, server: Server, tmp_path: Path) -> None:
    """A tab without unsaved text follows the other; one with unsaved text is told, and its user decides."""
    _open(tab, server)
    other = browser.Tab(tmp_path / "profile", 1200, 900)
    try:
        _open(other, server)
        _typed(tab, "320 kg", "330 kg")
        tab.key("s", ctrl=True)
        tab.wait("!studio.unsaved")
        other.wait("studio.editor.text.includes('330 kg') && !studio.unsaved")
        _typed(other, "22 kN/m", "23 kN/m")  # not saved
        _typed(tab, "40 kg", "41 kg")
        tab.key("s", ctrl=True)
        tab.wait("!studio.unsaved")
        assert "Nothing was overwritten" in other.wait("!document.querySelector('#banner').hidden && "
                                                       "document.querySelector('#banner').innerText")
        assert other.run("studio.editor.text.includes('23 kN/m') && !studio.editor.text.includes('41 kg')")
        other.key("s", ctrl=True)  # refused before an answer
        time.sleep(0.3)
        assert "41 kg" in (server.folder / "car.yaml").read_text(encoding="utf-8")
        other.click("#keep-mine")
        other.key("s", ctrl=True)
        other.wait("!studio.unsaved")
        mine = CAR.replace("320 kg", "330 kg").replace("22 kN/m", "23 kN/m")
        assert (server.folder / "car.yaml").read_text(encoding="utf-8") == mine
        tab.wait("studio.editor.text.includes('23 kN/m') && !studio.unsaved")
        assert tab.run("studio.editor.text") == mine and tab.complaints == other.complaints == []
    finally:
        other.close()


@pytest.mark.long
def test_a_killed_server_has_lost_nothing(tab: browser.Tab, server: Server) -> None:
    _open(tab, server)
    _typed(tab, "320 kg", "333 kg")
    tab.wait("localStorage.length === 1")
    server.kill()
    tab.wait("!document.querySelector('#banner').hidden")
    assert (server.folder / "car.yaml").read_text(encoding="utf-8") == CAR
    server.start()
    tab.run("window.onbeforeunload = null; studio.document.text = studio.editor.text; 1")  # or the browser asks
    _open(tab, server)
    tab.click("#draft-take")
    tab.wait("studio.editor.text.includes('333 kg') && studio.unsaved")
    tab.key("s", ctrl=True)
    tab.wait("!studio.unsaved")
    assert (server.folder / "car.yaml").read_text(encoding="utf-8") == CAR.replace("320 kg", "333 kg")


@pytest.mark.long
def test_names_of_others_are_text_and_nothing_else(tab: browser.Tab, server: Server) -> None:
    """What a file or its name says is shown, and never runs."""
    tab.complaints.clear()
    evil = "<img src=x onerror=alert(1)><script>alert(2)</script>"
    name = "a'b <i onclick=1>.yaml"
    (server.folder / name).write_text(CAR.replace("summary: One", f"summary: \"{evil}\" #"), encoding="utf-8")
    tab.go("about:blank")
    tab.go(server.address)
    tab.wait("document.querySelector('#home')?.innerText.includes('onclick=1')")
    tab.run(f"studio.open({json.dumps(name)})")
    tab.wait("document.querySelector('#panel')?.innerText.includes('onerror=alert')")
    assert tab.run("document.querySelectorAll('#panel img, #panel script, #home i, #sheet script, #sheet img').length") == 0
    assert tab.complaints == []
    (server.folder / name).unlink()


@pytest.mark.long
def test_keys_are_listed_and_borders_moved_by_keyboard(tab: browser.Tab, server: Server) -> None:
    _open(tab, server, "keys.yaml")
    tab.run("document.getElementById('sheet').focus()")
    tab.key("?", text="?")
    assert "draw a wire" in tab.wait("document.querySelector('#keys[open]')?.innerText")
    tab.key("Escape", code=27)
    assert tab.run("document.querySelector('dialog[open]') === null")
    for border, pane, key, code in (("split-text", "text", "ArrowLeft", 37), ("split-panel", "panel", "ArrowRight", 39)):
        wide = f"document.getElementById('{pane}').getBoundingClientRect().width"
        before = tab.run(wide)
        tab.run(f"document.getElementById('{border}').focus()")
        tab.key(key, code=code)
        assert tab.run(wide) == pytest.approx(before - 24, abs=1)
        tab.key("Home", code=36)
        assert tab.run(wide) == pytest.approx(before, abs=1)
    assert tab.complaints == []


@pytest.mark.slow
def test_the_compensator_follows_a_slider_ten_times_a_second(tab: browser.Tab, server: Server) -> None:
    """At any moment the run that is shown belongs to where the slider stood at most 0.2 s before. `pytest -s` prints the
    figures, with the charts drawn; they need a machine that does nothing else."""
    tab.go("about:blank")
    tab.go(f"{server.address}#bundled:cmc_ahc")
    tab.wait("Boolean(window.studio?.view?.runs)", 60)
    tab.click("#run")
    tab.wait("Boolean(studio.runs.live && !studio.runs.busy)", 60)
    tab.run("studio.pick('part', 'controller')")
    x, y = tab.middle("[id='s-controller.K_p']")
    tab.run("""(() => {
        const { runs } = studio, made = runs.made.bind(runs), slide = runs.slide.bind(runs), set = {};
        window.shown = [];
        window.frames = [];
        runs.slide = (path, value) => { set[value] = performance.now(); slide(path, value); };
        runs.made = (told, values) => {
            requestAnimationFrame(() => shown.push([set[values["controller.K_p"]], performance.now()]));
            return made(told, values);
        };
        (function next(t) { frames.push(t); requestAnimationFrame(next); })(performance.now());
    })()""")
    tab.mouse("Pressed", x, y, button="left", clickCount=1)
    tab.run("frames.length = 0")
    begun = time.monotonic()
    while (passed := time.monotonic() - begun) < 8:
        tab.mouse("Moved", x + 60 * math.sin(3 * passed), y, button="left")
        time.sleep(0.01)
    shown, frames = np.array(tab.run("shown")), np.array(tab.run("frames"))
    tab.mouse("Released", x, y, button="left", clickCount=1)
    tab.wait("!studio.runs.live.preview && !studio.runs.busy", 60)
    rate, smooth = ((len(times) - 1) / np.ptp(times) * 1e3 for times in (shown[:, 1], frames))
    lag = shown[:, 1] - shown[:, 0]  # ms from where the slider stood to its run
    behind = shown[1:, 1] - shown[:-1, 0]  # the same as the next run takes its place
    print(f"\n{rate:.1f} runs/s, {smooth:.0f} frames/s; runs shown after {np.median(lag):.0f} ms, at worst {lag.max():.0f}; "
          f"behind the slider by {np.median(behind):.0f} ms, at worst {behind.max():.0f}")
    assert rate >= 10
    assert behind.max() <= 200
