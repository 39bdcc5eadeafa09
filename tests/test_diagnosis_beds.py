"""The test beds of the diagnosis: they simulate, and each declared effect shows in the records."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import heavebond as hb
from benchmarks.diagnosis import beyond, integrating, several
from benchmarks.diagnosis.beds import Bed, Effect, judged, level, misfits, write

BEDS = {**several.BEDS, **beyond.BEDS, **integrating.BEDS}
LONG = {"vessels", "clamp", "tank_chain"}  # of these, so that every run has two
QUICK = {"feed_line", "vessels", "board", "clamp", "tank_chain"}  # about a second each; the others up to four


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=[pytest.mark.long]*(n in LONG) + [pytest.mark.slow]*(n not in QUICK)) for n in BEDS])
def test_the_declared_effects_of_a_bed_show_in_its_records(name: str, tmp_path: Path) -> None:
    bed = BEDS[name]
    misfit, shares = misfits(bed)
    # the shares are stated with two digits, the misfit with three; friction adds some percent between machines
    assert misfit == pytest.approx(bed.misfit, rel=0.05)
    assert shares == pytest.approx(bed.shares, rel=0.1, abs=0.002)
    # in the smallest record, 400 samples, chi-square of 1 per sample is 14 times the standard deviation that noise causes
    assert all(share * misfit > 1 for share in shares[:len(bed.effects)])
    experiment = hb.load_experiment(write(bed, tmp_path))
    before = hb.compare(experiment)
    assert {r.use for r in experiment.records.values()} >= {"fit", "validate"}
    # with the values of the data sheet, which leave at least what the fitted ones do, and the noise; 2: the fit was linear
    assert np.mean([part.chi2 for part in before.records.values()]) > 1 + bed.misfit / 2


def test_a_bed_is_the_same_each_time_it_is_written(tmp_path: Path) -> None:
    first, second = (write(BEDS["oven"], tmp_path / name) for name in ("a", "b"))
    assert [f.name for f in first.parent.iterdir()] and all(
        f.read_bytes() == (second.parent / f.name).read_bytes() for f in first.parent.iterdir())


def test_an_answer_is_judged_by_class_and_place() -> None:
    leak = Effect("Leakage.", "leakage: a b | internal leakage: cylinder")
    offset = Effect("Offset.", "sensor offset: p")

    def candidate(kind: str, *where: str, one_of: Any = ()) -> dict[str, Any]:
        return {"candidate": f"{kind} {where}", "class": kind, "where": list(where), "place": "", "component": "",
                "one_of": list(one_of)}

    def answer(*steps: Any) -> dict[str, Any]:
        return {"steps": steps, "verdict": "effect", "words": [], "partial": False, "probabilities": [], "ladder": []}

    first = candidate("leakage", "b", "a")
    assert level(leak, answer(first)) == "first"
    assert level(leak, answer(candidate("line resistance", "x", one_of=[first]))) == "plausible"
    assert level(leak, answer(candidate("hose compliance", "a", "b"))) == "place"
    assert level(leak, answer(candidate("leakage", "a", "c"))) == "class"
    bed = Bed("bed", "", "", {}, {}, "", (leak, offset), 1.0, 1.0, 1.0, (1.0, 1.0))
    assert judged(bed, answer(first, candidate("sensor offset", "p")))["right"]
    assert not judged(bed, answer(first))["right"]
    wrong = judged(bed, answer(first, candidate("sensor offset", "p"), candidate("end stop", "a", "b")))
    assert not wrong["right"] and wrong["extra"] == ["end stop ('a', 'b')"]
