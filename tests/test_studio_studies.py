"""Studies in the studio's page: a sweep run, its table and picture; and the report of a diagnosis, alone in its origin."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from pathlib import Path

import browser
import pytest
from click.testing import CliRunner
from studio_pages import Server, server, tab
from test_studio_blocks import RIG, STRUT

from heavebond.cli import main
from heavebond.studio.bench import view
from heavebond.studio.folder import Folder
from heavebond.studio.job import Job

__all__ = ["server", "tab"]

STUDY = """\
study: masses on the strut
summary: The rig with two masses.
model: rig.yaml
cases:
  load.m: [50 kg, 100 kg]
measure:
  peak speed: {is: largest(load.v), unit: mm/s}
pictures:
  speeds: {curves: [peak speed], title: Speed over the mass}
"""


def _written(folder: Path) -> None:
    (folder / "components").mkdir(exist_ok=True)
    (folder / "components" / "strut.yaml").write_text(STRUT, encoding="utf-8")
    (folder / "rig.yaml").write_text(RIG, encoding="utf-8")
    (folder / "masses.yaml").write_text(STUDY, encoding="utf-8")


def test_a_study_is_shown_with_its_diagram_and_its_problems(tmp_path: Path) -> None:
    _written(tmp_path)
    found = view(Job(STUDY, str(tmp_path / "masses.yaml"), "masses.yaml"))
    assert found["study"] == {"name": "masses on the strut", "summary": "The rig with two masses.", "cases": 2}
    assert found["problems"] == [] and "strut" in found["parts"]
    wrong = view(Job(STUDY.replace("largest(", "biggest("), str(tmp_path / "masses.yaml"), "masses.yaml"))
    assert wrong["study"] and [p["line"] for p in wrong["problems"]] == [7]
    listed = {entry["name"]: entry for entry in Folder(tmp_path).diagrams()}
    assert {name: entry["kind"] for name, entry in listed.items()} == {
        "components/strut.yaml": "component", "masses.yaml": "study", "rig.yaml": "model"}
    assert listed["masses.yaml"]["summary"] == "The rig with two masses." and listed["rig.yaml"]["summary"] == ""


@pytest.mark.long
def test_a_study_is_run_in_the_page_with_the_figures_of_the_command(tab: browser.Tab, server: Server) -> None:
    _written(server.folder)
    tab.go(server.address)
    tab.wait("document.querySelector(\"[data-open='masses.yaml']\") !== null")
    tab.run("document.getElementById('filter').focus()")
    tab.write("masses strut")
    assert tab.run("[...document.querySelectorAll('.cards > li')].filter(card => card.offsetParent).length") == 0
    tab.run("document.getElementById('filter').select()")
    tab.write("two masses")
    assert tab.run("[...document.querySelectorAll('.cards > li')].filter(card => card.offsetParent)"
                   ".map(card => card.querySelector('button').innerText)") == ["masses.yaml"]
    tab.click("[data-open='masses.yaml']")
    tab.click("#begin-study")
    tab.wait("studio.evidence.jobs.state('study')?.state === 'done'", 120)
    tab.wait("document.querySelector('.picture img')?.naturalWidth > 100")
    rows = tab.run("[...document.querySelectorAll('#evidence tbody tr')].map(row => row.innerText.split('\\t'))")
    run = CliRunner().invoke(main, ["study", str(server.folder / "masses.yaml"), "--output", str(server.folder / "again"),
                                    "--processes", "1"])
    assert run.exit_code == 0, run.output
    printed = " ".join(run.output.split())
    assert len(rows) == 2 and all(" ".join(cell for cell in row if cell) in printed for row in rows)
    figures = [json.loads((server.folder / name / "study.json").read_text(encoding="utf-8")) for name in ("masses", "again")]
    assert figures[0]["rows"] == figures[1]["rows"] and figures[0]["complete"]
    assert tab.complaints == []


@pytest.mark.long
def test_a_report_is_served_alone_in_its_origin(server: Server) -> None:
    (server.folder / "rig_report.html").write_text("<!DOCTYPE html><title>report</title>", encoding="utf-8")
    with urllib.request.urlopen(f"{server.address}reports/rig_report.html") as answer:
        assert answer.read().startswith(b"<!DOCTYPE html>")
        policy = answer.headers["Content-Security-Policy"]
    assert "sandbox allow-scripts;" in policy and "default-src 'none'" in policy and "allow-same-origin" not in policy
    for name in ("rig.yaml", "../rig_report.html", "..%2F..%2Fetc%2Fpasswd.html", "missing.html"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"{server.address}reports/{name}")
        assert refused.value.code in (403, 404)
