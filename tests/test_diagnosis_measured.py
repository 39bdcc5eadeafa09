"""The ladder on measured records: what others reached there is reached by the diagnosis, on held-out data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import heavebond as hb
from benchmarks.diagnosis.measured import without_effects
from heavebond.diagnosis.candidates.places import candidates

DRIVE = Path(__file__).parents[2] / "shared" / "data" / "real" / "emps"


@pytest.mark.slow
@pytest.mark.skipif(not DRIVE.is_dir(), reason="the measured drive's records are not bundled: they state no licence")
def test_drive_gets_its_dry_friction() -> None:
    """Viscous damping alone leaves 17.6 % of the force on the pulses, Coulomb friction and a constant force 6.4 %."""
    experiment = hb.load_experiment("emps/drive")
    moved = {n: replace(r, file=DRIVE / r.file.name) for n, r in experiment.records.items()}
    found = hb.diagnose(replace(experiment, records=moved), classes=["dry friction", "viscous damping", "constant force"])
    finding = found.findings[0]
    assert finding.candidate.kind == "dry friction"
    assert set(finding.candidate.where) == {"load", "frame"}
    errors = [r.comparison.records["pulses"].channels["force"].relative for r in found.ladder]
    assert errors[0] == pytest.approx(0.176, abs=0.002)
    assert errors[-1] <= 0.064


@pytest.mark.slow
def test_tanks_get_their_outlets_and_their_rim() -> None:
    """Linear outlets leave 1.05 V of the level that was not fitted, square roots 0.65 V, tanks that run over 0.56 V, and
    what is found then 0.46 V or less. The records hold seven independent blocks: they do not tell which of outlets and rims
    acts first, so that the answer has both, each as an effect of its own or as what an effect may be as well."""
    found = hb.diagnose("cascaded_tanks/tanks", steps=5)
    errors = [r.comparison.records["test"].channels["sensor.y"].error for r in found.ladder]
    kinds = {kind for f in found.findings for kind in f.kinds}
    assert errors[1] == pytest.approx(1.05, abs=0.03)
    assert {"orifice law", "tank overflow"} <= kinds
    assert errors[-1] <= 0.46


def test_a_law_and_a_class_can_be_removed_from_the_catalogue() -> None:
    experiment = hb.load_experiment("passive_rig/friction")
    before = candidates(experiment)
    kept = [c for c in before if c.kind != "dry friction" and c.component != "CubicSpring"]
    after = candidates(without_effects(experiment, ["dry friction", "CubicSpring"]))
    assert [c.label for c in after] == [c.label for c in kept] and len(after) < len(before) - 1
