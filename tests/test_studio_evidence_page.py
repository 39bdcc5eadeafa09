"""Records in the studio's page, in a headless browser: dropped, compared, diagnosed; the effect added and the error seen to
fall; stopped, in two tabs, and with the server killed."""

from __future__ import annotations

import difflib
import json
import time
from pathlib import Path

import browser
import pytest
from studio_pages import Server, server, tab
from test_studio_evidence import EXPERIMENT, RIG, records

from heavebond.diagnosis.state import errors as ladder
from heavebond.estimation.experiment import load_experiment

__all__ = ["server", "tab"]


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return records(tmp_path_factory.mktemp("made"))


def _opened(tab: browser.Tab, server: Server, name: str) -> None:
    tab.go("about:blank")
    tab.go(f"{server.address}#{name}")
    tab.wait(f"window.studio?.document?.name === {json.dumps(name)} && Boolean(studio.view?.parts)")


def _experiment(folder: Path, texts: dict[str, str]) -> None:
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    (folder / "data").mkdir(exist_ok=True)
    for name, text in texts.items():
        (folder / "data" / name).write_text(text, encoding="utf-8")
    (folder / "measured.yaml").write_text(EXPERIMENT, encoding="utf-8")


def _contents(folder: Path) -> dict[str, str]:
    return {p.relative_to(folder).as_posix(): p.read_text(encoding="utf-8") for p in folder.rglob("*") if p.is_file()}


@pytest.mark.long
def test_records_are_dropped_and_diagnosed_and_the_error_falls(tab: browser.Tab, server: Server, texts: dict[str, str]
                                                              ) -> None:
    folder = server.folder
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    _opened(tab, server, "rig.yaml")
    tab.drop("#sheet", texts)
    tab.wait("document.querySelector('#record-form').open")
    chosen = tab.run("[...document.querySelectorAll('#record-form tbody tr')].map(row => [...row.querySelectorAll("
                     "'select, input')].filter(field => !field.hidden).map(field => field.value).join(' '))")
    assert chosen == ["time s", "input shaker.u m  spline", "output load.x m ", "output shaker.a.f N "]  # noise: estimated
    tab.run("document.getElementById('free-damper.d').focus()")
    tab.key(" ", code=32, text=" ")
    tab.run("document.querySelector('[aria-label=\"noise of load_m\"]').focus()")
    tab.write("0.2 kg")
    tab.run("document.querySelector('#experiment-name').select()")
    tab.write("measured")
    tab.key("Enter", code=13, text="\r")
    tab.wait("document.querySelector('#record-wrong').innerText.includes('0.2 kg')")
    tab.run("document.querySelector('[aria-label=\"noise of load_m\"]').value = '0.2 mm', 1")
    tab.key("Enter", code=13, text="\r")
    tab.wait("studio.document.name === 'measured.yaml' && studio.evidence.told !== null", 60)
    experiment = load_experiment(folder / "measured.yaml")
    assert {r.name: (r.file.name, r.use) for r in experiment.records.values()} == {
        "monday": ("monday.csv", "fit"), "tuesday": ("tuesday.csv", "validate")}
    assert experiment.outputs["load.x"].noise == pytest.approx(0.2e-3)
    assert list(experiment.free) == ["damper.d"] and (folder / "data" / "monday.csv").read_text() == texts["monday.csv"]
    tab.wait("studio.evidence.charts.length === 4")  # two channels, each with its residual
    before = _contents(folder)
    tab.click("#tab-diagnose")
    tab.wait("document.querySelector('#only') !== null")
    tab.click("#only")
    tab.wait("document.querySelector('.class-list input') !== null")
    names = tab.run("[...document.querySelectorAll('.class-list input')].map(box => box.value)")
    assert "dry friction" in names and "value of a parameter" in names and "leakage" not in names  # that fit in this diagram
    tab.click(".class-list input[value='dry friction']")
    assert tab.run("document.querySelector('#only').textContent") == "only dry friction"
    tab.click("#begin-diagnose")
    tab.wait("document.querySelector('#ladder li') !== null", 60)
    tab.wait("studio.evidence.jobs.state('diagnose').state !== 'running'", 120)
    assert _contents(folder) == before  # nothing is written unasked
    tab.wait("document.querySelector('#evidence figure img')?.naturalWidth > 100")  # the law over its variable
    assert "CoulombFriction between deck and load" in tab.run("document.querySelector('#evidence figcaption').textContent")
    # the levels of the answer are indented as a tree: each name begins right of the one above it
    begins = tab.run("""(() => {
        const tree = [...document.querySelectorAll("#evidence table")].find(t => /by levels/.test(t.caption?.textContent));
        return [...tree.querySelectorAll("tbody th")].slice(0, 3).map(th => {
            const range = document.createRange(), text = th.firstChild;
            range.setStart(text, text.data.search(/\\S/));
            range.setEnd(text, text.length);
            return range.getBoundingClientRect().x; }); })()""")
    assert begins[0] < begins[1] < begins[2]
    rungs = tab.run("studio.evidence.jobs.state('diagnose').ladder")
    assert [r["name"] for r in rungs] == ["rig", "rig, parameters fitted", "+ CoulombFriction between deck and load"]
    tab.click("#add-0")
    tab.wait("studio.document.name === 'measured_2.yaml' && studio.evidence.told !== null")
    assert "the error fell from" in tab.wait("document.querySelector('#note')?.innerText")
    found = ladder([folder / "measured.yaml", folder / "measured_2.yaml"])
    # `errors` integrates by itself, a diagnosis with the runs of its fit: they differ by their tolerances
    assert found[0].chi2_held_out == pytest.approx(rungs[0]["chi2_held_out"], rel=1e-4)
    assert rungs[0]["chi2_held_out"] > 50
    assert found[1].chi2_held_out < 1.2
    shown = tab.run("studio.evidence.told.records.tuesday.chi2_per_sample")
    assert shown == pytest.approx(found[1].chi2_held_out, rel=0.05)
    after = _contents(folder)
    assert set(after) - set(before) == {"measured_2.yaml", "rig_2.yaml"} and before.items() <= after.items()
    added = [line[1:] for line in difflib.ndiff(RIG.splitlines(), after["rig_2.yaml"].splitlines()) if line[0] == "+"]
    assert any("coulomb_friction: {is: CoulombFriction" in line for line in added) and len(added) < 12
    assert tab.complaints == []


@pytest.mark.long
def test_two_tabs_see_one_computation_and_either_stops_it(tab: browser.Tab, server: Server, texts: dict[str, str],
                                                          tmp_path: Path) -> None:
    _experiment(server.folder, texts)
    _opened(tab, server, "measured.yaml")
    tab.wait("studio.evidence.told !== null")
    other = browser.Tab(tmp_path / "profile", 1200, 900)
    try:
        _opened(other, server, "measured.yaml")     # before the computation, which takes some seconds only
        tab.click("#tab-diagnose")
        tab.click("#begin-diagnose")
        other.wait("studio.evidence.jobs.state('diagnose')?.text.includes('scoring')", 60)
        other.run("document.querySelector('#tab-diagnose').click()")
        # by its element: words that come below the button may move it between finding and pressing its place
        other.wait("document.querySelector('#progress-text')?.textContent.includes('scoring') && "
                   "(document.querySelector('#end').click(), true)")
        tab.wait("studio.evidence.jobs.state('diagnose').state === 'done'", 30)
        assert tab.run("studio.evidence.jobs.state('diagnose').result.partial")
        assert "ended early" in tab.wait("document.querySelector('#evidence').innerText.includes('ended early') && "
                                         "document.querySelector('#evidence').innerText")
    finally:
        other.close()
    tab.run("studio.editor.replace(studio.editor.text + '# typed')")
    tab.click("#begin-diagnose")
    assert "not saved" in tab.wait("document.querySelector('#evidence .verdict')?.innerText.includes('not saved') && "
                                   "document.querySelector('#evidence').innerText")
    tab.run("studio.editor.replace(studio.document.text)")


@pytest.mark.long
def test_a_record_that_cannot_be_read_is_refused_in_words(tab: browser.Tab, server: Server) -> None:
    (server.folder / "other.yaml").write_text(RIG, encoding="utf-8")
    _opened(tab, server, "other.yaml")
    cases = (("run.exe", "MZ", "not a supported format of records"),
             ("<img src=x>.exe", "MZ", "not a supported format of records"))
    for name, text, said in cases:
        tab.run("studio.banner([])")
        tab.drop("#sheet", {name: text})
        assert said in tab.wait("!document.querySelector('#banner').hidden && document.querySelector('#banner').innerText")
    assert not any("<" in p.name for p in server.folder.rglob("*"))
    assert tab.run("document.querySelectorAll('#banner img').length") == 0


@pytest.mark.long
def test_an_experiment_that_estimates_nothing_tells_what_to_write(tab: browser.Tab, server: Server, texts: dict[str, str]
                                                                  ) -> None:
    _experiment(server.folder, texts)
    kept = EXPERIMENT.partition("free:")[0]
    (server.folder / "as_drawn.yaml").write_text(kept, encoding="utf-8")
    _opened(tab, server, "as_drawn.yaml")
    tab.click("#tab-fit")
    said = tab.wait("document.querySelector('#how-to-free code')?.textContent")
    assert tab.run("document.querySelector('#begin-fit').disabled")
    (server.folder / "as_told.yaml").write_text(f"{kept}{said}\n", encoding="utf-8")
    assert len(load_experiment(server.folder / "as_told.yaml").free) == 1
    assert tab.complaints == []


@pytest.mark.long
def test_a_diagnosis_whose_server_is_killed_writes_what_it_has_found(tab: browser.Tab, server: Server, texts: dict[str, str]
                                                                    ) -> None:
    _experiment(server.folder, texts)
    for name in ("measured_2.yaml", "rig_2.yaml"):
        (server.folder / name).unlink(missing_ok=True)
    _opened(tab, server, "measured.yaml")
    tab.click("#tab-diagnose")
    tab.run("studio.evidence.jobs.begin('diagnose', {classes: ['dry friction']})")
    tab.wait("Boolean(studio.evidence.jobs.state('diagnose')?.best)", 60)
    before = _contents(server.folder)
    server.kill()
    end = time.monotonic() + 60
    while not (server.folder / "measured_2.yaml").is_file():
        assert time.monotonic() < end
        time.sleep(0.1)
    assert before.items() <= _contents(server.folder).items()
    assert ladder([server.folder / "measured.yaml", server.folder / "measured_2.yaml"])[1].chi2_held_out < 10
    server.start()
