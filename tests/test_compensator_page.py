# Sentences of docs/compensator.md beside what the model, the experiments and the recorded diagnoses give.
"""The page of the compensator: its numbers in prose and in its table of diagnoses."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.compensator import CASES, SHARE, STUDY, made
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.search.scoring import scored
from heavebond.diagnosis.search.step import fitted_base
from heavebond.estimation.fitting import fit
from heavebond.numerics.dae import Assembly

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "compensator.md").read_text(encoding="utf-8")
RESULTS = keeping.read(STUDY)
ROWS = {"friction": "seal friction, active", "friction passive": "seal friction, passive",
        "leakage": "internal leakage, active", "overlap": "overlap, active"}


def stated(pattern: str) -> list[float]:
    """Numbers that a sentence of the page states; its line breaks are spaces."""
    found = re.search(pattern, " ".join(TEXT.split()))
    assert found, f"the page has no sentence like this: {pattern}"
    return [float(number) for number in found.groups()]


@pytest.fixture(scope="module")
def machine() -> Assembly:
    return hb.assemble(hb.load("cmc_ahc"))


def test_every_diagram_has_a_line() -> None:
    for file in sorted((ROOT / "models" / "cmc_ahc").glob("*.yaml")):
        if file.read_text(encoding="utf-8").startswith("model:") and file.stem != "cmc_ahc":
            assert f"`{file.stem}`" in TEXT, file.stem


def test_published_values_of_the_blocks(machine: Assembly) -> None:
    """The table of the blocks, in the units of the page."""
    given = machine.parameter_values
    area = 2 * np.pi / 4 * (0.2**2 - 0.17**2)
    for path, value, text in (
            ("cmc.gas.c", 42e3, "42 kN/m"), ("cmc.gas.d", 52e3, "52 kN·s/m"), ("cmc.friction.F_c", 12e3, "F_c 12 kN"),
            ("cmc.friction.F_s", 22.8e3, "F_s 22.8 kN"), ("cmc.friction.v_s", 0.1, "v_s 100 mm/s"),
            ("cmc.friction.sigma_2", 10e3, "sigma_2 10 kN·s/m"), ("cmc.friction.v_t", 1e-3, "xi 1000 s/m"),
            ("ahc.pump.p_0", 345e5, "345 bar"), ("ahc.valve.q_r", 920 / 60e3, "460 L/min at 35 bar"),
            ("ahc.valve.dp_r", 35e5, "460 L/min at 35 bar"), ("ahc.cylinder.A_A", area, "200 and 170 mm"),
            ("drilling.wires.c", 4e6, "4000, 298 and 1000 kN/m"), ("drilling.string.c", 298e3, "4000, 298 and 1000 kN/m"),
            ("drilling.formation.c", 1e6, "4000, 298 and 1000 kN/m"), ("crown.m", 30e3, "30 t"),
            ("controller.K_p", 3.02, "K_p 3.02 1/m"), ("controller.K_v", 0.55, "K_v 0.55 s/m")):
        assert given[path] == pytest.approx(value, rel=1e-9), path
        assert text in TEXT


def test_the_gas_stiffens() -> None:
    """c = n p A**2/V over the stroke of the last two periods."""
    run = hb.simulate(hb.load("cmc_ahc/detailed"))
    late, area = run.time >= 72, np.pi / 4 * 0.4**2
    stiffness = 1.2 * run.si["p_gas"][late] * area**2 / (5.68 + area * run.si["extension"][late])
    percent, = stated(r"stiffness of the gas changes by only ±([0-9.]+) % over the stroke")
    assert stiffness.max() / 42e3 - 1 == pytest.approx(percent / 100, abs=2e-3)
    assert 1 - stiffness.min() / 42e3 == pytest.approx(percent / 100, abs=2e-3)


@pytest.mark.long
def test_chambers_have_vapour_in_the_storm() -> None:
    run = hb.simulate(hb.load("cmc_ahc/storm"))
    for chamber in ("p_A", "p_B"):
        assert -1 < run.display[chamber].min() < -0.95     # bar above atmosphere


@pytest.mark.long
def test_force_of_softer_stops() -> None:
    """Half the stiffness of the page."""
    run = hb.simulate(hb.load("cmc_ahc/storm"), parameters={"main_stop.c": 100e6, "active_stop.c": 100e6})
    force, = stated(r"with half of the stiffness the largest force is ([0-9.]+) MN in active operation")
    assert abs(run.dense.si["stop"]).max() / 1e6 == pytest.approx(force, rel=0.1)


def test_the_catalogue(tmp_path: Path) -> None:
    number, = stated(r"The whole catalogue is tried, with ([0-9]+) candidates")
    experiment, _ = made(replace(CASES["nothing"], seconds=2), tmp_path)
    # the catalogue grows: each effect of the library adds some candidates
    assert len(single_candidates(experiment)) == pytest.approx(number, rel=0.2)


def test_tolerances_of_the_records() -> None:
    widths = [(f.range.high - f.range.low) / (f.range.high + f.range.low) for f in CASES["nothing"].rig.base.free.values()]
    least, most = stated(r"the data sheet by up to 60 % of its tolerances \(([0-9]+) to ([0-9]+) %\)")
    assert [100 * SHARE * min(widths), 100 * SHARE * max(widths)] == pytest.approx([least, most])


def test_the_table_has_the_recorded_results() -> None:
    """Reduced chi-square on the held-out record, number of refits and seconds."""
    for case, label in ROWS.items():
        line, = (line for line in TEXT.splitlines() if line.startswith(f"| {label} |"))
        cells, row = [cell.strip() for cell in line.strip("|").split("|")], RESULTS[case]
        ladder = [float(word) for word in re.findall(r"[0-9.]+", cells[3])]
        assert ladder == pytest.approx([rung[2] for rung in row["ladder"][1:]], rel=0.005)
        assert [int(word) for word in re.findall(r"[0-9]+", cells[1])] == [row["scored"], row["refitted"]]
        assert float(cells[4]) == pytest.approx(row["processor"], abs=1)
    line, = (line for line in TEXT.splitlines() if line.startswith("| nothing, active and passive |"))
    numbers = [float(word) for word in re.findall(r"[0-9.]+", line)]
    pair = [RESULTS[case] for case in ("nothing", "nothing passive")]
    assert numbers == pytest.approx([*(row["scored"] for row in pair), *(row["ladder"][1][2] for row in pair),
                                     *(row["processor"] for row in pair)], rel=0.02)
    deviations = [100 * (1 - row["fitted"]["cmc.gas.c"] / row["values"]["cmc.gas.c"]) for row in pair]
    low, high = stated(r"stiffness of the gas spring is ([0-9.]+) to ([0-9.]+) % too low")
    assert sorted(deviations) == pytest.approx([low, high], abs=0.06)


def test_two_fits_of_the_friction() -> None:
    """Passive: the refit that was compared with the other candidates, and the one that was reported."""
    row = RESULTS["friction passive"]
    tried, = (one for one in row["trials"] if one["truth"])
    (_, fit_chi2, held) = row["ladder"][-1]
    percent, better, worse = stated(r"same law whose chi-square differs by ([0-9.]+) % on the fitted record give ([0-9.]+) "
                                     r"and ([0-9.]+) on the validation record")
    assert [100 * (tried["fit"] / fit_chi2 - 1), held, tried["held"]] == pytest.approx([percent, better, worse], abs=0.006)


def test_damping_of_the_gas_takes_the_viscous_part() -> None:
    estimate, true, bound = stated(r"near its upper bound: ([0-9.]+) kN·s/m, with ([0-9.]+) in the machine and a bound "
                                   r"of ([0-9]+\.[0-9]+)")
    row = RESULTS["friction"]
    free = next(f for f in CASES["friction"].rig.base.free.values() if f.name == "cmc.gas.d")
    found = [row["fitted"][free.name], row["values"][free.name], free.range.high]
    assert [value / 1e3 for value in found] == pytest.approx([estimate, true, bound], abs=0.06)


def test_estimates_from_records_of_an_independent_program() -> None:
    """Sizes of the effects in the second table, in its units."""
    scale = {"valve.overlap": 1.0, "cylinder.leakage": 1e-11, "friction.F_c": 1e3, "friction.F_s": 1e3, "damper.d": 1e3}
    for case, row in keeping.read("independent").items():
        line, = (line for line in TEXT.splitlines() if line.startswith(f"| {case} |") and " to " in line)
        told = [float(word) for word in re.findall(r"[0-9]+[.]?[0-9]*", line.split("|")[2])]
        for parameter in row["parameters"]:
            unit = next((size for name, size in scale.items() if parameter["name"].endswith(name)), None)
            if unit is not None and parameter["value"] > 1e-3 * unit:
                assert any(one == pytest.approx(parameter["value"] / unit, rel=5e-3) for one in told), (case, parameter)


@pytest.mark.long
def test_what_friction_leaves(tmp_path: Path) -> None:
    """Reduced chi-square of each output, with the parameters fitted to the record of the friction under control."""
    experiment, _ = made(CASES["friction"], tmp_path)
    left = {name: part.chi2 for name, part in fit(experiment).after.records["train"].channels.items()}
    wob, spool, pressures = stated(r"friction leaves chi-square ([0-9.]+) on WOB and extension, ([0-9.]+) on the spool, and "
                                   r"([0-9]+) on the two pressures")
    assert [left["WOB"], left["extension"]] == pytest.approx([wob, wob], rel=0.05)
    assert left["spool"] == pytest.approx(spool, abs=0.05)
    assert (left["p_A"] + left["p_B"]) / 2 == pytest.approx(pressures, rel=0.02)
    assert stated(r"12 kN on ([0-9]+) cm² are ([0-9]+) bar") == pytest.approx(
        [2e4 * np.pi / 4 * (0.2**2 - 0.17**2), 12e3 / (2 * np.pi / 4 * (0.2**2 - 0.17**2)) / 1e5], rel=0.02)


@pytest.mark.long
def test_what_leakage_leaves(tmp_path: Path) -> None:
    experiment, _ = made(CASES["leakage"], tmp_path)
    held, share, z = stated(r"reduced chi-square on the validation record is ([0-9]+\.[0-9]+)\. The free parameters "
                            r"can imitate ([0-9]+) % of the sensitivity to the leakage\. The remaining part has z = "
                            r"([0-9]+\.[0-9]+)")
    base = fitted_base(experiment)
    assert fit(experiment).after.records["validate"].chi2 == pytest.approx(held, abs=2e-3)
    candidate = next(c for c in single_candidates(experiment) if c.label == "Cylinder in ahc.cylinder (leakage)")
    best = max(scored(base, candidate), key=lambda score: score.z)
    assert 100 * (1 - best.share) == pytest.approx(share, abs=1)
    assert best.z == pytest.approx(z, abs=0.1)


def test_sensitivity_to_the_overlap_at_zero() -> None:
    """Of the weight on bit in the regular wave: it is not the limit from either side."""
    def size(overlap: float) -> float:
        run = hb.simulate(hb.load("cmc_ahc/designed"), "20 s", parameters={"ahc.valve.overlap": overlap},
                          sensitivities=["ahc.valve.overlap"])
        return float(np.sqrt((run.sensitivity("WOB", "ahc.valve.overlap") ** 2).mean()))

    factor, = stated(r"the derivative at this point is some ([0-9]+) times the derivative on either side")
    for side in (-1e-4, 1e-4):
        assert size(0.0) / size(side) == pytest.approx(factor, rel=0.3)
