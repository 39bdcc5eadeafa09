"""The compensator diagnosed from records of an independent program, and the page that tells of it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.independent import CASES, STUDY, made
from heavebond.diagnosis.diagnose import diagnose
from heavebond.estimation.fitting import fit

pytestmark = pytest.mark.long

PAGE = Path(__file__).parents[1] / "docs" / "compensator.md"
RESULTS = keeping.read(STUDY)


@pytest.mark.slow
def test_without_a_hidden_effect_the_machine_is_identified(tmp_path: Path) -> None:
    """Noise is left, and the values of the machine lie within their intervals: nothing in the diagram differs from equations
    that were set up by hand."""
    experiment, values = made(CASES["nothing"], tmp_path)
    found = fit(experiment)
    for part in found.after.records.values():     # 9606 samples each: 1 +- 0.014
        assert part.chi2 == pytest.approx(1, abs=0.045)
    for parameter in found.parameters:
        low, high = parameter.interval     # 95 %, of eight parameters
        assert low - (high - low) / 2 < values[parameter.name] < high + (high - low) / 2


def test_overlap_is_named_in_records_of_an_independent_program(tmp_path: Path) -> None:
    experiment, _ = made(replace(CASES["overlap"], seconds=30, rate=10), tmp_path)
    found = diagnose(experiment, classes=("internal leakage", "valve overlap"), number=1)
    assert found.verdict == "effect"
    assert [(f.candidate.kind, tuple(f.candidate.where)) for f in found.findings] == [("valve overlap", ("ahc.valve",))]
    size, = found.findings[0].parameters
    assert size.interval[0] - 2e-4 < 0.03 < size.interval[1] + 2e-4
    assert found.findings[0].rung.chi2_held_out < 1.1 < 20 < found.ladder[1].chi2_held_out     # 1806 samples: 1 +- 0.03


@pytest.mark.slow
@pytest.mark.parametrize("case", ["overlap"])
def test_the_whole_catalogue(tmp_path: Path, case: str) -> None:
    experiment, _ = made(CASES[case], tmp_path)
    found = diagnose(experiment, number=1, seconds=float("inf"))
    assert found.verdict == RESULTS[case]["verdict"]
    assert [f.candidate.kind for f in found.findings] == [n["kind"] for n in RESULTS[case]["named"]]
    assert found.ladder[-1].chi2_held_out == pytest.approx(RESULTS[case]["ladder"][-1][2], abs=0.01)


def test_the_page_has_the_recorded_results() -> None:
    """Reduced chi-square on the held-out record as designed, with the parameters fitted and with the effects; seconds."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    for case, row in RESULTS.items():
        line, = (line for line in lines if line.startswith(f"| {case} |") and " to " in line)
        ladder = [float(word) for word in re.findall(r"[\d.]+", line.split("|")[-3])]
        rungs = row["ladder"]
        assert ladder == pytest.approx([rungs[k][2] for k in (0, 1, *range(2, len(rungs)))], rel=0.01)
        assert float(line.split("|")[-2]) == pytest.approx(row["processor"], abs=1)
