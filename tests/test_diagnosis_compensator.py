"""Effects hidden in the crown-mounted compensator, found from records of its weight on bit, stroke, pressures and spool."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.diagnosis.compensator import CASES, LEAKAGE, made
from heavebond.catalogue import candidates
from heavebond.diagnosis import Diagnosis, attempt, diagnose
from heavebond.rung import fitted_base, step
from heavebond.scoring import scored

CYLINDER = ("ahc.cylinder",)


def named(found: Diagnosis) -> set[tuple[str, tuple[str, ...]]]:
    """What was found by name: class and place."""
    return {(f.candidate.kind, tuple(sorted(f.candidate.where))) for f in found.findings}


def test_leakage_inside_a_block_is_found_beside_the_other_effects_of_its_block(tmp_path: Path) -> None:
    # a short record at half the rate, and three times the leakage: the loop hides most of it
    leakage = 3 * LEAKAGE.numbers["ahc.cylinder.leakage"]
    more = replace(LEAKAGE, numbers={"ahc.cylinder.leakage": leakage})
    case = replace(CASES["leakage"], seconds=30, rate=10, hidden=(more,))
    experiment, _ = made(case, tmp_path)
    found = diagnose(experiment, classes=("internal leakage", "valve overlap"), number=1)
    assert found.verdict == "effect"
    assert named(found) == {("internal leakage", CYLINDER)}
    (size,) = found.findings[0].parameters
    assert size.interval[0] < leakage < size.interval[1]
    assert found.findings[0].rung.chi2_held_out < 1.1 < 1.2 < found.ladder[1].chi2_held_out  # 1806 samples: 1 +- 0.03


def test_effects_are_tried_on_nodes_inside_blocks(tmp_path: Path) -> None:
    experiment, _ = made(replace(CASES["friction passive"], seconds=2), tmp_path)
    there = {(c.component, frozenset(c.where)) for c in candidates(experiment)}
    assert ("LaminarLeakage", frozenset({"ahc.chamber_a", "ahc.chamber_b"})) in there
    assert ("CoulombFriction", frozenset({"drilling.hook", "drilling.bit"})) in there
    assert ("SeriesCompliance", frozenset({"falls", "drilling"})) in there
    assert ("ProportionalValve43", frozenset({"ahc.valve"})) in there


def test_nodes_that_a_rope_joins_are_one_place(tmp_path: Path) -> None:
    """The falls move as the crown block does; friction against the platform is refitted at one of them only."""
    experiment, _ = made(replace(CASES["friction passive"], seconds=12, rate=10), tmp_path)
    found = step(experiment, classes=("dry friction",), number=1, seconds=1e-3)  # scores only: no refit is begun
    for law in ("CoulombFriction", "StribeckFriction"):
        assert f"{law} between platform and falls" in found.twins[f"{law} between platform and crown"]
    assert not any("and drilling" in twin for label, twins in found.twins.items() if "platform" in label for twin in twins)


def test_what_the_integrator_errs_by_is_no_effect(tmp_path: Path) -> None:
    """No force goes through the encoder, so that a compliance before it changes nothing but the steps of a run."""
    experiment, _ = made(replace(CASES["friction"], seconds=12, rate=10), tmp_path)
    base = fitted_base(experiment)
    candidate = next(c for c in candidates(experiment) if c.label == "SeriesCompliance between crown and encoder.a")
    found = scored(base, candidate)
    assert found
    assert not any(s.told_apart for s in found)


@pytest.mark.slow
def test_leakage_is_named_among_the_whole_catalogue(tmp_path: Path) -> None:
    experiment, _ = made(CASES["leakage"], tmp_path)
    found = diagnose(experiment)
    assert found.verdict == "effect"
    assert named(found) == {("internal leakage", CYLINDER)}
    assert found.ladder[-1].chi2_held_out <= 1.05 < found.ladder[1].chi2_held_out  # 9606 samples: 1 +- 0.014


@pytest.mark.slow
def test_seal_friction_of_the_passive_machine_earns_its_place(tmp_path: Path) -> None:
    # stick-slip with the bit lifting off; what is left held out comes from slams that the fitted sea did not have
    experiment, values = made(CASES["friction passive"], tmp_path)
    tried = attempt(experiment, "StribeckFriction", ("platform", "crown"))
    assert tried.earned
    assert tried.finding.rung.chi2_fit < 1.1
    assert tried.finding.rung.chi2_held_out < 0.01 * tried.ladder[1].chi2_held_out
    fitted = tried.finding.fit.values
    assert {name: fitted[name] for name in values} == pytest.approx(values, rel=0.05)
