"""Random diagrams from the library end in a run whose equations hold and whose energy closes, or in advice.

A few hundred here; `make fuzz` judges a hundred thousand, each within a time limit, and goes on where it was stopped.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from time import process_time

import pytest

from benchmarks.fuzz import __main__ as command
from benchmarks.fuzz.campaign import Judge, patiently, renew_limit, smallest
from benchmarks.fuzz.diagrams import Diagram, Part, diagram
from benchmarks.fuzz.judging import FAULTS, Verdict, judge

FOUND = Path(__file__).parent / "found_by_fuzz"  # the smallest diagrams of faults that are mended


@pytest.mark.long
@pytest.mark.parametrize("first", range(0, 120, 20))
def test_random_diagrams_end_well(first: int) -> None:
    verdicts = [judge(seed, diagram(seed).text()) for seed in range(first, first + 20)]
    assert not [(v.seed, v.outcome, v.what) for v in verdicts if v.outcome in FAULTS]


@pytest.mark.long
@pytest.mark.parametrize("file", sorted(FOUND.glob("*.yaml")), ids=lambda file: file.stem)
def test_what_random_diagrams_have_found_ends_as_it_should(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    ends = re.search(r"# ends: (.*)", text)
    found = judge(0, text)
    assert ends is not None
    assert ends[1] == ("ran" if found.outcome == "ran" else f"{found.outcome} {found.what}")


def test_a_good_share_of_the_diagrams_runs() -> None:
    """At least two of twenty; the check ends with the second. Diagrams that are refused at once would try nothing."""
    ran = 0
    for seed in range(1000, 1020):
        ran += judge(seed, diagram(seed).text()).outcome == "ran"
        if ran == 2:
            return
    pytest.fail(f"{ran} of 20 random diagrams run")


def test_a_seed_gives_the_same_text() -> None:
    assert diagram(12).text() == diagram(12).text() != diagram(13).text()


@pytest.fixture
def rig() -> Diagram:
    return Diagram(7, (Part("a", "Mass", {"m": "1 kg"}), Part("b", "Mass", {"m": "2 kg"}), Part("c", "Fixed")),
                   {"t0": ("a.a",), "t1": ("b.a",), "t2": ("c.a",)}, {}, 1.0)


def test_a_fault_is_shown_with_the_parts_that_it_needs(rig: Diagram) -> None:
    def judged(seed: int, text: str) -> Verdict:
        return Verdict(seed, "energy" if "b:" in text else "ran", "", 0.0)

    fewer = smallest(judged, rig, "energy")
    assert [part.name for part in fewer.parts] == ["b"]
    assert fewer.nodes == {"t1": ("b.a",)}


def test_a_wrong_answer_is_a_fault(rig: Diagram, monkeypatch: pytest.MonkeyPatch) -> None:
    assert judge(7, rig.text()).outcome == "ran"
    monkeypatch.setattr("benchmarks.fuzz.judging.violation", lambda result: (1e-3, "a.f = 0"))
    found = judge(7, rig.text())
    assert (found.outcome, found.what) == ("equation", "a.f = 0 is off by 0.001 of its terms")
    monkeypatch.setattr("benchmarks.fuzz.judging.violation", lambda result: 1 / 0)
    assert judge(7, rig.text()).outcome == "traceback"


@pytest.mark.slow
def test_a_diagram_that_takes_too_long_is_a_hang_and_the_next_is_judged(
        rig: Diagram, monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(seed: int, text: str) -> Verdict:
        while "until: 1 s" in text:
            pass
        return judge(seed, text)

    monkeypatch.setattr("benchmarks.fuzz.campaign.judge", slow)
    judged = Judge(limit=0.0)
    assert judged(7, rig.text()).outcome == "hang"
    assert judged(7, rig.shortened(0.5).text()).outcome == "ran"
    assert (found := patiently(judged, rig)).outcome == "long"
    assert found.what == "ran"
    judged.close()


@pytest.mark.slow
def test_each_step_that_renews_the_limit_has_all_of_it() -> None:
    def steps(number: int, renewed: bool) -> str:
        for _ in range(number):
            began = process_time()
            while process_time() - began < 0.8:
                pass
            if renewed:
                renew_limit()
        return "done"

    judged = Judge(1.0, steps, lambda task, outcome, what, seconds: outcome)  # s; the kernel counts whole ones
    assert judged(4, True) == "done"
    assert judged(4, False) == "hang"
    judged.close()


@pytest.mark.slow
def test_the_campaign_goes_on_where_it_was_stopped(tmp_path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    results = tmp_path / "results.jsonl"
    for seeds in ("3", "5"):
        monkeypatch.setattr(sys, "argv", ["fuzz", "--seeds", seeds, "--results", str(results)])
        command.main()
    assert [json.loads(line)["seed"] for line in results.read_text().splitlines()] == [0, 1, 2, 3, 4]
    assert "5 diagrams: " in capsys.readouterr().out
    counts = command.summary(results)
    assert counts["diagrams"] == 5
    assert counts["code"] == {command.code(): 5}
