"""Takes the pictures of the studio in a headless browser: `python docs/pictures/studio/draw.py [FOLDER]`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[2] / "tests"))

import browser  # noqa: E402 - found in the folder of the line above

SETTLED = 0.5  # s until the charts are drawn
PATIENCE = 300.0  # s for a diagnosis
STUDY = """\
study: dampers
summary: The rig with dampers from 50 to 800 N*s/m and two springs.
model: rig.yaml
cases:
  damper.d: [50 N*s/m, 100 N*s/m, 200 N*s/m, 400 N*s/m, 800 N*s/m]
  spring.c: [4 kN/m, 8 kN/m]
evaluate: {from: 0.5 s, to: 6 s}
measure:
  largest swing: {is: largest(load.x), unit: mm}
  rms speed: {is: rms(load.v), unit: mm/s}
pictures:
  swings: {curves: [largest swing], title: Swing over the damping}
"""


def pictures(tab: browser.Tab, address: str, opened: Path, folder: Path) -> None:
    """The first page; the compensator after a run; a gain moved; the run on the drawing; a block opened, and its inside; a
    study; a mistake."""
    def take(name: str) -> None:
        time.sleep(SETTLED)
        (folder / f"{name}.png").write_bytes(tab.screenshot())
        print(f"wrote {folder / name}.png")

    tab.go(address)
    tab.wait("document.querySelectorAll('.cards li').length > 3")
    take("first_page")
    tab.click("[data-open='bundled:cmc_ahc']")
    tab.wait("studio.view?.parts")
    tab.click("#run")
    tab.wait("studio.runs.live && !studio.runs.busy")
    tab.click("#keep")
    tab.click("g.part[data-part='controller'] .frame")
    x, y = tab.middle("[id='s-controller.K_p']")
    tab.mouse("Pressed", x, y, button="left", clickCount=1)
    tab.mouse("Moved", x - 60, y, button="left")
    tab.mouse("Released", x - 60, y, button="left", clickCount=1)
    tab.wait("studio.runs.live.values['controller.K_p'] && !studio.runs.live.preview && !studio.runs.busy")
    take("slider")
    tab.click("#toggle-text")
    tab.click("#toggle-machine")
    tab.wait("Boolean(studio.machine.film)", PATIENCE)
    tab.run("studio.animation.choose('effort').then(() => studio.animation.at(22.5))")
    tab.wait("Boolean(studio.animation.data)", PATIENCE)
    tab.click("[data-zoom='fit']")
    take("animation")
    tab.click("#toggle-machine")
    tab.click("#toggle-text")
    tab.run("studio.animation.choose('')")
    tab.click("g.part[data-part='ahc'] .frame", 2)
    tab.wait("studio.view.opened.length === 1")
    tab.click("#toggle-text")
    tab.click("[data-zoom='fit']")
    take("block")
    from heavebond.estimation.starter_folder import new as start_folder

    start_folder(opened / "machine", "cmc_ahc")
    tab.run("studio.open('machine/components/active_compensator.yaml')")
    tab.wait("studio.document.name.endsWith('active_compensator.yaml') && studio.view?.parts")
    tab.click("#toggle-text")
    tab.click("g.part[data-part='valve'] .frame")
    take("inside")
    tab.run("studio.open('dampers.yaml')")
    tab.wait("studio.document.name === 'dampers.yaml' && studio.view?.parts")
    tab.click("#begin-study")
    tab.wait("studio.evidence.jobs.state('study')?.state === 'done'", PATIENCE)
    tab.wait("document.querySelector('.picture img')?.naturalWidth > 100")
    tab.run("document.documentElement.style.setProperty('--drawing', '240px')")
    tab.run("document.getElementById('middle').classList.add('resized')")
    take("study")
    tab.run("document.getElementById('middle').classList.remove('resized')")
    tab.run("studio.open('rig.yaml')")
    tab.wait("studio.document.name === 'rig.yaml' && studio.view?.parts")
    tab.run("studio.editor.replace(studio.editor.text.replace('N*s/m', 'N/m'))")
    tab.wait("document.querySelector('g.part.faulty') !== null")
    tab.click("[data-zoom='fit']")
    take("mistake")


def editing(tab: browser.Tab, folder: Path) -> None:
    """A part placed from the library, and a wire on its way to a port."""
    tab.run("studio.document.text = studio.editor.text; studio.open('rig.yaml')")
    tab.wait("studio.document.name === 'rig.yaml' && Boolean(studio.view?.parts) && !studio.unsaved")
    tab.click("#toggle-palette")
    tab.wait("document.querySelector('#palette-search') !== null", PATIENCE)
    tab.run("studio.edits.act({act: 'place', kind: 'EndStop', column: 1, row: -1}).then(() => studio.diagram.fit())")
    tab.wait("Boolean(studio.view.parts.end_stop)")
    tab.run("document.getElementById('palette-search').focus()")
    tab.write("stop")
    time.sleep(SETTLED)
    (x, y), (x1, y1) = tab.middle("[data-port='end_stop.b']"), tab.middle("[data-port='load.a']")
    tab.mouse("Moved", x, y)
    tab.mouse("Pressed", x, y, button="left", clickCount=1)
    for share in (0.3, 0.6, 1.0):
        tab.mouse("Moved", x + share * (x1 - x), y + share * (y1 - y), button="left")
    time.sleep(SETTLED)
    (folder / "editing.png").write_bytes(tab.screenshot())
    print(f"wrote {folder / 'editing.png'}")
    tab.mouse("Released", x1, y1, button="left", clickCount=1)
    tab.wait("studio.editor.text.includes('end_stop.b')")
    tab.run("studio.document.text = studio.editor.text; studio.file.keepDraft()")


def records(tab: browser.Tab, opened: Path, folder: Path) -> None:
    """The records of a rig dropped on its diagram, compared, located and diagnosed."""
    def take(name: str) -> None:
        time.sleep(SETTLED)
        (folder / f"{name}.png").write_bytes(tab.screenshot())
        print(f"wrote {folder / name}.png")

    days = [opened / "shaker" / "data" / f"{day}.csv" for day in ("monday", "tuesday")]
    texts = {day.name: day.read_text(encoding="utf-8") for day in days}
    tab.run("studio.open('shaker/shaker.yaml')")
    tab.wait("studio.document.name === 'shaker/shaker.yaml' && Boolean(studio.view?.parts)")
    tab.drop("#sheet", texts)
    tab.wait("document.querySelector('#record-form').open")
    for name in ("spring.c", "damper.d"):
        tab.click(f"[id='free-{name}']")
    take("record_form")
    tab.click("#make-experiment")
    tab.wait("Boolean(studio.evidence.told) && studio.evidence.charts.length > 0")
    tab.click("#toggle-text")
    tab.click("[data-zoom='fit']")
    take("records")
    tab.click("#tab-where")
    tab.click("#begin-where")
    tab.wait("studio.evidence.jobs.state('where')?.state === 'done'", PATIENCE)
    tab.click("g.part[data-part='damper'] .frame")
    take("locate")
    tab.click("#tab-diagnose")
    tab.click("#begin-diagnose")
    tab.wait("studio.evidence.jobs.state('diagnose')?.state === 'done'", PATIENCE)
    take("diagnosis")


def main(folder: Path) -> None:
    """Start the studio on an empty folder, and a browser."""
    with tempfile.TemporaryDirectory() as place:
        opened = Path(place) / "machines"
        opened.mkdir()
        command = [sys.executable, "-c", "from heavebond.cli import main; main()", "studio", ".", "--no-browser"]
        server = subprocess.Popen(command, cwd=opened, stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            address = server.stdout.readline().split(": ")[1].strip()
            from heavebond.estimation.starter_folder import new as start_folder
            from heavebond.studio.folder import Folder

            Folder(opened).create("rig")
            (opened / "dampers.yaml").write_text(STUDY, encoding="utf-8")
            start_folder(opened / "shaker")
            tab = browser.Tab(Path(place) / "profile", 1440, 960)
            try:
                pictures(tab, address, opened, folder)
                editing(tab, folder)
                records(tab, opened, folder)
            finally:
                tab.close()
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
