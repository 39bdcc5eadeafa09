"""The studies for drilling engineers: each table of the page is what the command prints, and its sentences hold."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.studies.run_case import assembled, checked, measured
from heavebond.studies.study import load_study
from heavebond.studies.uncertainty import spreads

pytestmark = pytest.mark.long

PAGE = Path(__file__).parents[1] / "docs" / "drilling.md"
NEAR = 0.03     # of a value: the solvers' steps at reversals of friction, on other computers
# the case of each study that is run here; the others in the slow tests
SHORT = {"changeover": 6, "accumulator": 12, "energy": 1, "modern": 4, "wire": 4, "landing": 5,
         "riser_tensioner": 0, "recoil": 3, "modern_depth": 0, "modern_energy": 0}


@cache
def block(study: str) -> list[str]:
    """The lines of the output on the page, below the command."""
    text = PAGE.read_text(encoding="utf-8")
    found = re.search(rf"```text\n\$ heavebond study cmc_ahc/studies/{study} [^\n]*\n(.*?)```", text, re.DOTALL)
    assert found, study
    return found[1].splitlines()


def rows(study: str) -> np.ndarray:
    """The measured values (cases, measures) of the table on the page, in the units of the study."""
    lines = block(study)
    rule = next(k for k, line in enumerate(lines) if line.startswith("───"))
    number = len(load_study(f"cmc_ahc/studies/{study}").measures)
    return np.array([[float(word) for word in line.split()[-number:]] for line in lines[rule + 1:]])


@pytest.mark.parametrize("study", SHORT)
def test_one_row_of_each_table(study: str) -> None:
    loaded, number = load_study(f"cmc_ahc/studies/{study}"), SHORT[study]
    units = checked(loaded)
    found, _, _ = measured(loaded, assembled(loaded, loaded.case(number)))
    assert [units[name].from_si(value) for name, value in found.items()] == pytest.approx(rows(study)[number], rel=NEAR)


@pytest.mark.slow
@pytest.mark.parametrize("study", [*SHORT, "depth"])
def test_whole_tables(study: str) -> None:
    result = hb.study(f"cmc_ahc/studies/{study}")
    assert result.complete
    found = [[result.value(outcome, name) for name in result.study.measures] for outcome in result.outcomes]
    assert np.array(found) == pytest.approx(rows(study), rel=NEAR)


@pytest.mark.slow
def test_the_sample_of_machines() -> None:
    """Means and least values; unstable runs are sensitive to rounding, so that the published gain is compared by signs."""
    result = hb.study("cmc_ahc/studies/robustness")
    assert result.complete
    lines = [line for line in block("robustness") if re.match(r"(WOB|damping)", line)]
    for line, spread in zip(lines, spreads(result), strict=True):
        words = line.split()
        mean, least = float(words[-8]), float(words[-6])
        if "3.02" not in spread.others:
            assert (spread.mean, spread.least) == (pytest.approx(mean, rel=NEAR), pytest.approx(least, rel=0.1))
        elif spread.quantity == "damping":
            assert spread.least < spread.quantiles[1] < 0 < spread.most
        else:
            assert spread.most > 10 * spread.least


def test_sentences_on_the_tables() -> None:
    passive = 60.76     # kN, Fig. 6
    closing = rows("changeover")[:, 2].reshape(2, 8)
    assert (closing[:, :5] > 2.9 * passive).all() and (closing[:, :5] < 4.3 * passive).all()     # within 1 s
    assert (closing[:, 6:] < passive).all()                                                     # 5 s or more
    at_speed, at_turn = closing[:, 5]
    assert f"{at_speed:.0f} kN if the valve begins to close at the greatest speed, {at_turn:.0f} kN at the" in \
        " ".join(PAGE.read_text(encoding="utf-8").split())
    gas = rows("accumulator")[:, 0].reshape(2, 2, 5)
    assert np.ptp(gas[0]) < 0.02
    assert gas[1, 0].argmin() == 2 and (np.diff(gas[1, 1]) < 0).all()
    assert gas[1, 1, 4] == pytest.approx(gas[1, 0, 2], rel=0.01)
    gains = [[float(word) for word in line.split()[2:4]] for line in block("depth") if re.match(r" +\d+ +\d000 ", line)]
    assert 1 - gains[3][0] / gains[0][0] == pytest.approx(0.11, abs=0.005)
    assert np.ptp([k_v for _, k_v in gains]) < 0.002
    assert (np.diff(rows("depth")[:, 1].reshape(2, 4)) < 0).all()
    energy = rows("energy")
    assert energy[1, 3] / energy[1, 0] == pytest.approx(0.04, abs=0.005)
    drift = 0.55 * 2 * np.pi / 12 * 0.5 / 3.02     # m, K_v v/K_p
    assert f"= {1e3 * drift:.0f} mm" in " ".join(PAGE.read_text(encoding="utf-8").split())


def test_a_sea_state() -> None:
    """The last realisation that the page lists: Pierson-Moskowitz, active, 2 m, seed 4."""
    study = load_study("cmc_ahc/studies/sea_states")
    units = checked(study)
    line, = (line for line in block("sea_states") if re.match(r"PM +active +2 +4 +4 ", line))
    found, _, _ = measured(study, assembled(study, study.case(11)))
    told = [float(word) for word in line.split()[-6:]]
    # the seal sticks at other instants on other computers: a few percent of the deviation in 25 minutes
    assert [units[name].from_si(value) for name, value in found.items()] == pytest.approx(told, rel=NEAR)


def test_peak_periods_of_the_sea_states() -> None:
    """T_1 of the two spectra by gamma, as DNV-RP-C205 relates them, and the table of T_p."""
    study = load_study("cmc_ahc/studies/sea_states")
    text = PAGE.read_text(encoding="utf-8")
    for name, case, gamma in (("PM", 0, 1.0), ("JONSWAP", 96, 3.3)):
        known = assembled(study, study.case(case)).parameter_values
        assert known["gamma"] == gamma
        one = (5.75 - np.log(gamma))/1.15       # s, in a sea of 1 m
        assert known["T_1"] == pytest.approx(one, abs=0.005)
        told = re.search(rf"^\| T_p, {name} \|(.*)\|$", text, re.MULTILINE)
        assert told is not None
        periods = [float(cell.split()[0]) for cell in told[1].split("|")]
        assert periods == pytest.approx(one*np.sqrt(np.arange(1, 7)), abs=0.051)


def test_sentences_on_the_sea_states() -> None:
    means = [[float(part.split("±")[0]) for part in re.findall(r"[\d.]+(?: ± [\d.]+)?", line)] for line in
             block("sea_states") if re.match(r"(PM|JONSWAP) .*±", line)]
    waves, deviation, _, off, stop, _ = np.array(means)[:, 1:].T.reshape(6, 2, 2, 6)     # spectrum, operation, H_s
    assert (8 * waves > 1350).all()
    active, passive = deviation.swapaxes(0, 1)
    assert (active[:, 1:4] < 8.2).all() and (active[:, 1:4] < passive[:, 1:4] / 4).all()
    assert (off[:, 0, 1:4] < 0.1).all() and (off[:, 1, 1] > 30).all()
    assert (off[:, 0, 4:] > 0.6).all() and not stop[..., :5].any() and stop[..., 5].any()
