"""A diagnosis answers by what it knows whenever its time ends, and ends by then. Time is counted in looks for a signal (see
`benchmarks.diagnosis.ended`)."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from click.testing import CliRunner
from collected import partly

from benchmarks.diagnosis import ended
from benchmarks.diagnosis.ended import Looks, counted_looks
from heavebond.cli import main
from heavebond.core.cancellation import Budget
from heavebond.core.errors import FaultWarning
from heavebond.diagnosis import diagnose as driver
from heavebond.diagnosis import phases
from heavebond.diagnosis.answer.sentences import CURVES, VALUES
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.diagnose import Diagnosis, diagnose
from heavebond.diagnosis.evidence import flexible_laws
from heavebond.estimation.experiment import Experiment, load_experiment
from heavebond.estimation.starter_folder import new as start_folder
from heavebond.reports.report import report
from heavebond.reports.result_tables import diagnosis_items

CLASSES = ["dry friction", "leakage"]


@pytest.fixture
def looks() -> Iterator[Looks]:
    with counted_looks() as counting:
        yield counting


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    folder = tmp_path_factory.mktemp("budget") / "rig"
    start_folder(folder, None)
    return load_experiment(folder / "measured.yaml")


def ended_after(looks: Looks, experiment: Experiment, seconds: float) -> tuple[Diagnosis, int]:
    """The answer, and after how many looks it was there."""
    before = looks.spent
    found = diagnose(experiment, number=1, seconds=seconds, classes=CLASSES)
    return found, looks.spent - before


@pytest.mark.long
def test_whenever_the_time_ends_the_answer_is_what_is_known(rig: Experiment, looks: Looks) -> None:
    whole, needed = ended_after(looks, rig, float("inf"))
    assert whole.verdict == "effect" and not whole.partial and whole.untried == ()
    assert needed > 5000
    come = set()
    for seconds in (10.0, 48.0, 128.0, 600.0, 2000.0, 5000.0, 0.95 * needed):
        found, took = ended_after(looks, rig, seconds)
        assert took <= 1.1 * seconds, seconds
        assert_true(found, whole)
        step = found.steps[0] if found.steps else None
        come.add((len(found.ladder), bool(step and step.scores), bool(step and step.trials), len(found.findings)))
    # before all records were simulated, in the fit, in scoring and in refits, and with an effect
    assert {(0, False, False, 0), (1, False, False, 0), (2, True, False, 0)} < come and max(k for *_, k in come) == 1


def assert_true(found: Diagnosis, whole: Diagnosis) -> None:
    """What is said is so: of the ladder as far as it goes, of what leads, and of what was not tried."""
    words = " ".join(found.words)
    assert report(found) and diagnosis_items(found) and found.as_dict()["partial"] is found.partial
    for entry, other in zip(found.ladder[:2], whole.ladder, strict=False):
        early = entry.name.endswith(" (ended early)")
        assert early or (entry.name, entry.chi2_fit) == (other.name, pytest.approx(other.chi2_fit, rel=1e-3))
    assert len(found.ladder) <= 2 or found.findings[0].kinds == whole.findings[0].kinds
    if found.verdict == "effect":
        assert found.partial is ("Not tried" in words or "were scored" in words)
        return
    assert found.verdict in ("undetermined", "mainly") and found.partial
    assert found.verdict == "mainly" or words.startswith(("No conclusion yet: the search was ended", "The search was ended"))
    for step in found.steps:
        scored = {s.candidate.label for s in step.scores}
        assert not step.partial or f"{len(scored)} of {step.planned - len(step.broken)} candidates" in words


@pytest.mark.long
def test_a_step_that_is_complete_names_its_effect_although_more_was_not_tried(
        rig: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """A damper in place of the friction that is missing explains most, and leaves more than noise; then the time is over."""
    def over(*given: Any, **named: Any) -> None:
        raise KeyboardInterrupt

    for module, name in ((phases, "make_value_stage"), (phases, "make_curve_stage"),
                         (flexible_laws, "make_curve_stage")):
        monkeypatch.setattr(module, name, over)
    found = diagnose(rig, number=1, classes=["viscous damping"], steps=1)
    assert (found.verdict, found.untried) == ("mainly", (CURVES,))
    assert found.adequacy is not None and found.adequacy.complete
    assert "Whether another law at this place would explain more was not tried to the end." in found.words
    # another value of what is held fixed may explain as much, which was not tried: the leader is the answer so far
    found = diagnose(rig, number=1, classes=["viscous damping", VALUE], steps=1)
    assert (found.verdict, found.partial, found.untried) == ("mainly", True, (VALUES, CURVES))
    assert found.adequacy is not None and not found.adequacy.complete and found.adequacy.explained < 0.95
    assert f"Not tried, as the search was ended early: {VALUES}, {CURVES}." in found.words


@pytest.mark.parametrize(("selection", "left", "located"), [((), 0.0, True), (("effect",), 0.0, False), ((), 50.0, False)])
def test_the_time_kept_for_the_confirmation_of_an_effect_gives_a_place_if_there_is_none(
        monkeypatch: pytest.MonkeyPatch, selection: tuple[str, ...], left: float, located: bool) -> None:
    """The search used all of its time, or was ended by the user with 50 s left."""
    monkeypatch.setattr(phases, "localize", lambda experiment, **options: "located")
    step: Any = SimpleNamespace(left=SimpleNamespace(significant=True), partial=True)
    given: Any = SimpleNamespace()
    state = phases.State(given, given, kept=10.0, searched=given, selection=cast(Any, selection), steps=(step,), last=step)
    task: Any = SimpleNamespace(budget=Budget(10.0 + left), say=lambda text: None)
    assert [s.localization for s in phases.localise_misfit(state, task)] == (["located"] if located else [])


def test_files_are_written_and_the_exit_code_is_0_when_the_time_is_over(rig: Experiment, looks: Looks,
                                                                        monkeypatch: pytest.MonkeyPatch) -> None:
    for seconds in ("1", "200"):
        folder = rig.path.parent / f"after_{seconds}"
        answer = CliRunner().invoke(main, ["diagnose", str(rig.path), "--seconds", seconds, "--processes", "1", "--folder",
                                           str(folder), "--only", "dry friction"])
        assert answer.exit_code == 0, answer.output
        assert "So far" in answer.output and "the search was ended early: the same command" in answer.output
        assert (folder / "measured_report.html").stat().st_size > 1000


@pytest.mark.long
def test_the_answer_has_the_same_form_in_whatever_phase_the_time_ends() -> None:
    results = ended.run("receiver", 1, ("simulate_records", "confirm"))
    assert len({result.phase for result in results}) == len(phases.PHASES)
    assert [result for result in results if result.faults] == []
    # once a candidate is refitted there is a conclusion
    assert all(result.answer and result.answer.verdict == "effect" for result in results if result.phase == "confirm")


@pytest.mark.parametrize("position", partly(["before", "after"], 2))
def test_a_fault_in_a_phase_loses_nothing_that_was_known(
        position: str, rig: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search ends by an exception before its first state, or after its last."""
    def broken(state: phases.State, task: phases.Task) -> Iterator[phases.State]:
        if position == "after":
            yield from phases.search(state, task)
        raise ValueError("no numbers\nat all")

    broken.__name__ = "search"
    monkeypatch.setattr(driver, "PHASES", tuple(broken if phase is phases.search else phase for phase in phases.PHASES))
    with pytest.warns(FaultWarning, match=r"`search` ended by a fault of heavebond, ValueError in test_budget.py, line \d"):
        diagnosis = diagnose(rig, number=1, classes=CLASSES)
    assert diagnosis.words[0].startswith("The phase `search` ended by a fault") and diagnosis.partial
    assert diagnosis.ladder[-1].chi2_fit > 1
    assert [f.candidate.kind for f in diagnosis.findings] == (["dry friction"] if position == "after" else [])
    if position == "before":  # a batch system sees it too
        with pytest.warns(FaultWarning, match="`search` ended by a fault"):
            answer = CliRunner().invoke(main, ["diagnose", str(rig.path), "--only", CLASSES[0], "--folder", str(tmp_path),
                                               "--json", str(tmp_path / "out.json")])
        written = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
        assert (tmp_path / "measured_report.html").exists()
        assert answer.exit_code == 70 and "ended by a fault of heavebond itself" in answer.stderr
        assert written["faults"] == written["words"][:1] and written["problems"][0]["code"] == "internal"
    with pytest.raises(FaultWarning):  # in the tests of the program it is an error
        diagnose(rig, number=1, classes=CLASSES)
