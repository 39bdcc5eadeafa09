"""The calibration study: cluttered machines, and the calibration error of the stated probabilities."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.diagnosis import cluttered, keeping, reliability
from benchmarks.diagnosis.calibration import Entry, belonging, listed
from benchmarks.diagnosis.machines import MACHINES
from heavebond.diagnosis.evidence.probability import OUTSIDE, Calibration

CONSTANTS = Calibration(0, 4.0, 0.25, math.log(2) / 0.75, 5.0, 0.02)  # odds outside: 0.25 at noise level
SIX = len(reliability.GRID)
# Two laws of one class, another class at another place, and laws outside the catalogue at both places.
CASE = {"machine": "a", "number": 0, "hidden": "inside", "nothing": 0, "left": 1.0, "missing": 0.0, "sheet": 0.0,
        "flexible": None, "values": [0.05] * SIX, "partial": False, "seconds": 1.0,
        "laws": [[[0, 1, 2, 3, 4], "11111", "11111", 0, [0.6] * SIX], [[0, 1, 2, 3, 5], "11110", "11110", 0, [0.2] * SIX],
                 [[0, 6, 7, 8, 9], "10000", "10000", 0, [0.15] * SIX], [[0, 1, 2, 10], "1110", "1110", 1, [0.7] * SIX],
                 [[0, 6, 7, 11], "1000", "1000", 1, [0.3] * SIX]]}


@pytest.mark.long
def test_a_cluttered_case_is_the_same_each_time_and_one_effect_dominates(tmp_path: Path) -> None:
    one, two = (cluttered.drawn(MACHINES["motor"], 0, folder) for folder in (tmp_path / "a", tmp_path / "b")
                if not folder.mkdir())
    assert one.hidden == two.hidden and one.effect == two.effect and one.minor == two.minor
    assert (tmp_path / "a/case/record_0.csv").read_text() == (tmp_path / "b/case/record_0.csv").read_text()
    assert one.effect is not None and 0.5 <= one.share <= 0.95 and 1.5 <= one.misfit <= 800
    differences = [what for what, *_ in one.minor if what not in ("input noise", "late")]
    assert 2 <= len(differences) <= 4 and {*differences} <= {*cluttered.MINOR}


def test_two_differences_of_one_number_are_not_joined() -> None:
    one = cluttered.Alteration(values={"motor.R": 1.0})
    assert one.joined(cluttered.Alteration(values={"motor.k": 2.0}, noise=0.1)).noise == 0.1
    with pytest.raises(cluttered._Unfit):
        one.joined(cluttered.Alteration(values={"motor.R": 2.0}))


def test_probabilities_of_all_levels_follow_from_a_row_of_the_study() -> None:
    """By hand: 0.98 (1 - 0.2) for the catalogue, of which 5 % are values; 0.98 0.2 outside; 0.02 not considered."""
    found = reliability.levels(json.loads(json.dumps(CASE)), CONSTANTS)
    assert found["system"].p == pytest.approx([0.784 * 0.05, 0.784 * 0.95 + 0.196, 0.02])  # none, machine, another
    assert found["place"].p == pytest.approx([0.784 * 0.8 + 0.196 * 0.7, 0.784 * 0.15 + 0.196 * 0.3, 0.0], abs=1e-9)
    assert sorted(found["class"].p[:-1]) == pytest.approx(sorted([0.784 * 0.8, 0.196 * 0.7, 0.784 * 0.15, 0.196 * 0.3]))
    for level, p in {"system": 0.9408, "kind": 0.7644, "class": 0.6272, "law": 0.4704}.items():
        assert reliability.probability_of_truth(CASE, CONSTANTS, level) == pytest.approx(p)
    assert reliability.deepest(CASE, CONSTANTS) == ("class", True)  # the law has less than one half


def test_the_dominant_effect_counts_in_the_tree_in_which_it_is_most_probable() -> None:
    """The first tree of the answer names a minor difference, and the second one the dominant effect."""
    minor = {**CASE, "laws": [[numbers, truths, "0" * len(truths), *more] for numbers, truths, _, *more in CASE["laws"]]}
    assert reliability.probability_of_truth(minor, CONSTANTS, "class") == pytest.approx(0.6272)
    assert reliability.probability_of_dominant([minor], [CONSTANTS], "class") == 0
    assert reliability.probability_of_dominant([minor, CASE], [CONSTANTS] * 2, "class") == pytest.approx(0.6272)
    assert [len(trees) for trees, _ in reliability.by_case([minor, CASE], [CONSTANTS] * 2)] == [2]


def test_a_branch_is_true_if_it_belongs_to_one_of_the_hidden_differences() -> None:
    friction, drift = ("machine", "a", "rate", "friction", "Coulomb"), ("machine", "b", "variation", "varying parameter")
    assert belonging(friction, [(drift, False), (friction, False)]) == "11111"
    assert belonging((*drift, "LinearVariation"), [(friction, False), (drift, False)]) == "11110"
    assert belonging(("machine", "c", "rate", "friction", "Coulomb"), [(friction, False), (drift, False)]) == "10000"
    assert belonging((*friction[:3], OUTSIDE), [(friction, False)]) == "1110"
    assert belonging((*friction[:3], OUTSIDE), [(friction, True)]) == "1111"  # its component is struck from the catalogue
    assert belonging(("machine", "c", "rate", "leakage", "X"), [(friction, False)], matches=True) == "11110"


def test_small_laws_of_a_row_count_at_the_level_of_the_system() -> None:
    weights = np.ones(SIX)
    entries = [Entry(("machine", "a", "rate", "friction", "Coulomb"), "11111", "11111", 0.9 * weights, False),
               Entry(("machine", "b", "rate", OUTSIDE), "1000", "1000", 1.0 * weights, True),
               *(Entry(("machine", f"c{k}", "rate", "friction", "Drag"), "10000", "10000", 0.001 * weights, False)
                 for k in range(40))]
    rows = listed(entries)
    assert rows[0][:4] == [[0, 1, 2, 3, 4], "11111", "11111", 0] and rows[1][:4] == [[0, 5, 6, 7], "1000", "1000", 1]
    assert rows[2] == [[0], "1", "1", 0, [pytest.approx(0.04)] * SIX] and len(rows) == 3
    found = reliability.levels({**CASE, "laws": rows, "values": [0.0] * SIX}, CONSTANTS)
    assert found["system"].p == pytest.approx([0, 0.784 * 0.94 + 0.196, 0.02 + 0.784 * 0.06])
    assert found["place"].p[-1] == pytest.approx(0.784 * 0.04)  # another


def test_losses_are_those_of_the_probabilities() -> None:
    """The table of the fit against the branches, which have at least 1 %; a law that is not listed has the rest."""
    laws = [[numbers, "0" * len(numbers), *more] for numbers, _, *more in CASE["laws"]]  # type: ignore[attr-defined]
    unlisted, nothing = {**CASE, "laws": laws}, {**CASE, "laws": laws, "nothing": 1}
    found = reliability.Table.of([CASE, unlisted, nothing]).losses(CONSTANTS)
    true = [reliability.probability_of_truth(CASE, CONSTANTS, level) for level in reliability.TRAINED]
    assert found == pytest.approx([-np.mean(np.log(true)), -math.log(0.02), -math.log(0.784 * 0.05)])


def test_exact_probabilities_have_an_error_below_its_chance_value_and_overconfident_ones_above() -> None:
    """600 events: chance errors are some 0.03; probabilities half as far from certainty as stated, 0.1 or more."""
    random = np.random.default_rng(1)
    p = random.uniform(0.2, 0.98, 600)
    true = random.random(600) < p
    bold = 1 - (1 - p) / 2
    for stated, right in ((p, True), (bold, False)):
        mean, most = reliability.by_chance([np.array([x]) for x in stated])
        assert 0 < mean < most < 0.06
        assert (reliability.expected_error(stated, true) < most) is right


@pytest.mark.long
def test_constants_are_fitted_to_the_share_of_laws_outside_and_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path
                                                                        ) -> None:
    """In 60 of 100 cases the law outside is true: its stated probability, 0.2 before, comes near 0.6."""
    laws = {what: [[[0, 1, 2, 3, 4], "10000" if what == "outside" else "11111", "00000", 0, [1.0] * SIX],
                   [[0, 5, 6, 7], "1111" if what == "outside" else "1000", "0000", 1, [1.0] * SIX]]
            for what in ("inside", "outside")}
    shared = {name: value for name, value in CASE.items() if name not in ("machine", "number", "hidden", "laws")}
    rows = [{"machine": "ab"[k % 2], "number": k, "key": str(k), "hidden": what, "partial": False, "seconds": 1.0,
             **shared, "values": [0.0] * SIX, "laws": laws[what]}
            for k in range(100) for what in ["outside" if k % 5 < 3 else "inside"]]
    found = reliability.fitted(rows)
    assert found.outside / (1 + found.outside) == pytest.approx(0.6, abs=0.05)  # the prior of 0.17 takes 0.02
    monkeypatch.setattr(keeping, "RESULTS", tmp_path)
    for row in rows:
        keeping.add("some", {**row, "trees": [{"laws": row["laws"]}]})
    text = reliability.report(reliability.known_rows("some"), tmp_path)
    assert "100 cases of 2 machines" in text and "fitted to all other machines" in text
    assert {path.name for path in tmp_path.glob("*.png")} >= {"present_constants.png"}
