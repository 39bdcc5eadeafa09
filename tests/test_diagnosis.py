"""Each word of a verdict on a short record with something hidden in it, and the bundled records with a hidden effect."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.diagnosis.making import Hidden
from benchmarks.diagnosis.rigs import RIGS
from benchmarks.diagnosis.truths import TRUTHS
from heavebond.evidence import leftover, refits, rung, verdict
from heavebond.evidence.comparison import compare
from heavebond.evidence.diagnosis import Diagnosis, diagnose
from heavebond.evidence.finding import rung as rung_of
from heavebond.evidence.fitting import fit

KEYS = {"verdict", "words", "steps", "ladder", "ranking", "noise", "seconds"}
KNOWN = {(rig, truth.name): truth for rig, truths in TRUTHS.items() for truth in truths}


def found(folder: Path, rig: str, hidden: Sequence[tuple[str, float]], classes: Sequence[str], *, scale: float = 1.0,
          share: float = 0.0, seconds: float = 60.0) -> Diagnosis:
    """What is said of a record in which the effects stand with these amplitudes; the same noise each time."""
    short = replace(RIGS[rig], seconds=seconds)
    machine = Hidden(short, [KNOWN[rig, name] for name, _ in hidden], "test", folder, scale, share)
    return diagnose(machine.case([size for _, size in hidden]).experiment, classes=classes, number=1)


def test_noise_alone_is_nothing(tmp_path: Path) -> None:
    said = found(tmp_path, "receiver", [], ["leakage", "choked flow"])
    assert said.verdict == "nothing"
    assert not said.findings
    assert said.ladder[-1].chi2_held_out == pytest.approx(1, abs=0.15)   # 601 samples: 1 +- 0.06


def test_wrong_values_are_parameters(tmp_path: Path) -> None:
    said = found(tmp_path, "receiver", [], ["leakage", "choked flow"], share=0.9)
    assert said.verdict == "parameters"
    assert said.ladder[0].chi2_held_out > 10 > 1.2 > said.ladder[1].chi2_held_out


def test_an_effect_is_named_with_its_place_and_size(tmp_path: Path) -> None:
    said = found(tmp_path, "receiver", [("leak in", 4e-10)], ["leakage", "line resistance"])
    assert said.verdict == "effect"
    (finding,) = said.findings
    assert (finding.candidate.kind, finding.candidate.where) == ("leakage", ("supply", "receiver"))
    (size,) = finding.parameters
    assert size.interval[0] < 4e-10 < size.interval[1]
    assert finding.rung.chi2_held_out < 1.2 < 2 < said.ladder[1].chi2_held_out


def test_what_acts_alike_is_named_together(tmp_path: Path) -> None:
    # a leak past the valve, and a valve that is open by more than was asked for: the same flow
    said = found(tmp_path, "receiver", [("leak in", 4e-10)], ["leakage", "sensor offset"])
    assert said.verdict == "one_of"
    assert {"leakage", "sensor offset"} <= set(said.findings[0].kinds)


def test_a_law_that_could_bend_further_but_does_not_is_no_rival(tmp_path: Path) -> None:
    # play whose gap closes in the fit is a compliance too; the two ends of the string are alike
    machine = Hidden(replace(RIGS["passive"], seconds=20), [KNOWN["passive", "string compliance"]], "test", tmp_path)
    made = rung.step(machine.case([4.0]).experiment, number=1, classes=["series compliance", "backlash"])
    assert {t.candidate.kind for t in made.trials} == {"series compliance", "backlash"}
    assert {t.candidate.kind for t in made.cluster} == {"series compliance"}
    # another end that leaves more elsewhere, yet no more than noise, stays; one that leaves more does not
    best, other = made.cluster
    noise = 1 + leftover.SIGMAS * (2 / best.samples_held_out) ** 0.5
    for left, alike in ((noise - 1e-3, True), (noise + 0.1, False)):
        again = rung.choosing(replace(made, trials=(best, replace(other, chi2_held_out=left, slack=0.0))), best)
        assert (len(again.cluster) == 2) is alike
    stiffness = fit(rung.following(made)).parameters[-1]  # 1e6 N/m, sought from 1e4 to 1e10: near neither end
    assert stiffness.name == "series_compliance.c" and not stiffness.at_bound


def test_a_channel_of_noise_alone_is_no_error(tmp_path: Path) -> None:
    # a record in which one channel hardly moves: no model leaves less than all of what was measured there
    case = Hidden(replace(RIGS["receiver"], seconds=30), [KNOWN["receiver", "leak in"]], "test", tmp_path).case([4e-10])
    still = {name: replace(output, noise=1e9) for name, output in case.experiment.outputs.items()}
    bad, good = rung_of("", compare(case.experiment)), rung_of("", compare(replace(case.experiment, outputs=still)))
    assert bad.error_held_out == good.error_held_out
    assert verdict._above_noise(bad) == pytest.approx(bad.error_held_out, rel=0.1)
    assert verdict._above_noise(good) == 0


def test_what_the_catalogue_lacks_is_a_shape(tmp_path: Path) -> None:
    # a gauge that reads 5 % too much, among classes that do not hold it: a bent channel is as near as a curve comes to it
    said = found(tmp_path, "receiver", [("SensorGain in the channel receiver.p", 0.05)], ["line resistance"])
    assert said.verdict == "shape"
    assert said.shape is not None and said.shape.candidate.where == ("receiver.p",)
    assert said.shape.rung.chi2_held_out < 0.1 * said.ladder[1].chi2_held_out


def test_where_the_largest_scores_mislead_everything_is_refitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # no score is trusted at all: what is refitted first is nothing
    monkeypatch.setattr(refits, "REFITS", 0)
    monkeypatch.setattr(refits, "PROMISING", 2.0)
    said = found(tmp_path, "receiver", [("leak in", 4e-10)], ["leakage", "line resistance"])
    assert said.verdict == "effect"
    assert len(said.steps[0].trials) > 1
    experiment = said.steps[0].experiment
    assert not rung.step(experiment, number=1, classes=["leakage"], thorough=False).trials


def test_too_little_motion_tells_nothing(tmp_path: Path) -> None:
    said = found(tmp_path, "passive", [], ["dry friction"], scale=0.002, seconds=20)
    assert said.verdict == "undetermined"


def test_a_search_that_is_ended_early_does_not_blame_the_catalogue() -> None:
    def say(text: str) -> None:
        if "refitting 2 " in text:
            raise KeyboardInterrupt  # as Ctrl-C does; in the background a process may ignore the signal itself

    said = diagnose("receiver_rig/choked", classes=["sensor gain", "line resistance"], number=1, progress=say)
    assert said.verdict == "undetermined"
    assert said.words[0].startswith("Not told yet: the search was ended before every candidate was refitted. Best so far: ")
    assert len(said.findings) == 1


def test_every_verdict_has_the_same_keys(tmp_path: Path) -> None:
    for name, hidden in (("still", []), ("leaking", [("leak in", 4e-10)])):
        folder = tmp_path / name
        folder.mkdir()
        told = found(folder, "receiver", hidden, ["leakage"]).as_dict()
        assert told.keys() >= KEYS
        assert json.loads(json.dumps(told))["verdict"] == told["verdict"]


@pytest.mark.slow
@pytest.mark.parametrize(("experiment", "kinds", "places"), [
    ("passive_rig/friction", {"dry friction"}, {("platform", "crown")}),
    ("cylinder_rig/leakage", {"internal leakage", "leakage"}, {("cylinder",), ("chamber_a", "chamber_b")}),
    ("receiver_rig/choked", {"choked flow"}, {("inlet",), ("inlet", "outlet")}),
])
def test_the_bundled_records_are_named(experiment: str, kinds: set[str], places: set[tuple[str, ...]]) -> None:
    said = diagnose(experiment)
    assert said.verdict in ("effect", "one_of")
    (finding,) = said.findings
    assert finding.candidate.kind in kinds
    assert finding.candidate.where in places
    assert finding.rung.chi2_held_out <= 1.5


@pytest.mark.slow
def test_the_bundled_record_without_an_effect_is_parameters() -> None:
    assert diagnose("passive_rig/nothing").verdict == "parameters"
