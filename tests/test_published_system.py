"""The published compensator: what the model gives for each published number, and how far that is from it.

What it gives stands once, in the table of docs/published_system.md; here the model is held against that table.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.linear.linearisation import ModesAtStart
from heavebond.optimise.objective import Objective
from heavebond.studies.run_case import assembled, measured, tuned_by
from heavebond.studies.study import load_study

pytestmark = pytest.mark.long

STUDIES = "cmc_ahc/studies/"
PAGE = Path(__file__).parents[1] / "docs" / "published_system.md"
FREQUENCIES = ["0.25 Hz", "0.5 Hz", "0.75 Hz", "1 Hz", "2.5 Hz"]
PUBLISHED = {"with": [15, 6.2, 2.1, 2, 1.9], "without": [15, 7.1, 1.1, 1, 1]}     # kN, Table 3
WITHIN_A_QUARTER = {"with": [True, True, False, True, True], "without": [True, False, False, False, True]}
CELLS = [(friction, f_n) for friction in PUBLISHED for f_n in FREQUENCIES]
# The variation of the weight on bit is not what is minimised: at optima of one index, friction makes it rough to 5 %.
ROUGH = 0.05


@cache
def on_the_page() -> dict[tuple[str, str], dict[str, float]]:
    """The rows of the table on the page."""
    found = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 10 and (cells[0], cells[1]) in CELLS:
            swept, tuned = ([float(word) for word in cells[k].split(",")] for k in (2, 5))
            found[cells[0], cells[1]] = {
                "swept K_p": swept[0], "swept K_v": swept[1], "swept phi": float(cells[3]), "swept WOB": float(cells[4]),
                "K_p": tuned[0], "K_v": tuned[1], "phi": float(cells[6]), "WOB": float(cells[7].split()[0]),
                "published": float(cells[8]), "runs": float(cells[9])}
    return found


def variations(friction: str) -> np.ndarray:
    """kN, over the five valves."""
    return np.array([on_the_page()[friction, f_n]["WOB"] for f_n in FREQUENCIES])


def test_the_page_is_as_near_as_it_says() -> None:
    for friction, published in PUBLISHED.items():
        assert [on_the_page()[friction, f_n]["published"] for f_n in FREQUENCIES] == published
        near = np.abs(variations(friction) / published - 1) <= 0.25
        assert near.tolist() == WITHIN_A_QUARTER[friction]
    assert sum(map(sum, WITHIN_A_QUARTER.values())) == 6
    assert "Six of the ten cells are within 25 %" in PAGE.read_text(encoding="utf-8")


def test_the_trend_is_as_published() -> None:
    """A fast fall up to 0.75 Hz and little beyond; friction matters much for passive, little for active compensation."""
    for friction in PUBLISHED:
        slow, _, enough, _, fast = variations(friction)
        assert (np.diff(variations(friction)) < 0).all()
        assert enough - fast < 0.1 * (slow - enough)
    assert (np.abs(variations("with") - variations("without")) < 1.5).all()     # kN, against 45 in passive operation
    for name in on_the_page().values():
        assert name["phi"] <= name["swept phi"]


def test_eigenfrequency_is_within_five_percent(studies_folder: Path) -> None:
    found = hb.study(STUDIES + "eigenfrequency", processes=1, folder=studies_folder / "eigenfrequency")
    assert abs(found.difference(found.of("with"), "frequency")) < 0.05
    assert found.value(found.of("with"), "frequency") == pytest.approx(0.2392, rel=1e-3)
    slowest = next(mode for mode in found.of("with").modes if mode["swings"])
    assert list(slowest["components"])[:2] == ["drilling.hook", "crown"]


def test_passive_statements(studies_folder: Path) -> None:
    """No slamming at 0.5 m without friction and with the printed equation; with the odd friction the bit lifts off."""
    found = hb.study(STUDIES + "fig6", processes=1, folder=studies_folder / "fig6")
    off = {name: found.value(found.of(name), "off bottom") for name in ("with", "without", "as printed")}
    assert off["without"] == off["as printed"] == 0 < 20 < off["with"]
    with_friction, without = (found.value(found.of(name), "WOB variation") for name in ("with", "without"))
    assert without == pytest.approx(15.86, rel=0.01)
    assert with_friction > 3 * without


def test_gains_and_variation_at_three_quarter_hertz(studies_folder: Path) -> None:
    found = hb.study(STUDIES + "fig8", processes=1, folder=studies_folder / "fig8")
    tuned = found.of("with")
    # published 3.02 1/m and 0.55 s/m: within 10 %
    assert found.value(tuned, "controller.K_p") == pytest.approx(3.02, rel=0.10)
    assert found.value(tuned, "controller.K_v") == pytest.approx(0.55, rel=0.10)
    assert found.value(found.of("without"), "controller.K_v") == pytest.approx(0.55, rel=0.10)
    for friction in PUBLISHED:
        ours = on_the_page()[friction, "0.75 Hz"]
        assert found.value(found.of(friction), "controller.K_p") == pytest.approx(ours["K_p"], rel=0.01)
        assert found.value(found.of(friction), "WOB variation") == pytest.approx(ours["WOB"], rel=ROUGH)
    printed = found.of("as printed")     # the optimum of the table with the printed friction, tuned in the same way
    k_p, _, variation = printed_on_the_page()[2]
    assert found.value(printed, "controller.K_p") == pytest.approx(k_p, rel=0.01)
    assert found.value(printed, "WOB variation") == pytest.approx(variation, rel=ROUGH)
    # friction adds about 1 kN, as published
    assert 0.5 < found.value(tuned, "WOB variation") - found.value(found.of("without"), "WOB variation") < 1.5
    assert found.value(tuned, "crown") < 20


@pytest.mark.parametrize(("friction", "f_n"), [  # the published optimum, and the one at the limit of stability, in every run
    cell if cell in (("with", "0.75 Hz"), ("without", "2.5 Hz")) else pytest.param(*cell, marks=pytest.mark.slow)
    for cell in CELLS])
def test_gradients_in_every_cell(friction: str, f_n: str) -> None:
    """The optimum of the page, not above that of its sweeps, at a tenth of their runs."""
    study, number = load_study(STUDIES + "table3"), CELLS.index((friction, f_n))
    page, assembly = on_the_page()[friction, f_n], assembled(study, study.case(number))
    sweeps, gradients = study.procedures
    assert [len(values) for _, values in sweeps.sweeps] == [121, 801]
    found = tuned_by(Objective(assembly, study.tuning), gradients)
    assert found.cost == pytest.approx(page["phi"], rel=1e-3)
    assert found.simulations <= (121 + 801) / 10
    # on the bottom of a valley the gains move the cost by less than it is known: K_v by 1 %, K_p by less
    assert [*found.values.values()] == pytest.approx([page["K_p"], page["K_v"]], rel=0.01)
    numbers, _, _ = measured(study, assembly.with_parameters(found.values))
    assert numbers["WOB variation"] / 1e3 == pytest.approx(page["WOB"], rel=ROUGH)
    # a point of the sweeps near the best one is not below
    objective = Objective(assembly, study.tuning)
    swept = objective.at({"controller.K_p": page["swept K_p"], "controller.K_v": page["swept K_v"]}).cost
    assert found.cost <= swept * (1 + 1e-5)
    assert swept == pytest.approx(page["swept phi"], rel=1e-3)


def printed_on_the_page() -> np.ndarray:
    """K_p, K_v and the variation of the weight on bit with the printed friction, over the five valves."""
    rows = [[cell.split()[0] for cell in line.strip("|").split("|")[1:4]]
            for line in PAGE.read_text(encoding="utf-8").splitlines() if re.match(r"\| [0-9.]+ Hz \|", line)]
    return np.array(rows, dtype=float)


def test_printed_friction_at_three_quarter_hertz() -> None:
    """The gains of the page are an optimum of the index, and stable once the seal slides."""
    study = load_study(STUDIES + "table3_printed")
    assembly, stated = assembled(study, study.case(2)), printed_on_the_page()[2]
    found = tuned_by(Objective(assembly, study.tuning), study.procedures[0])
    assert [*found.values.values()] == pytest.approx(stated[:2], rel=0.01)
    numbers, _, _ = measured(study, assembly.with_parameters(found.values))
    assert numbers["WOB variation"] / 1e3 == pytest.approx(stated[2], rel=ROUGH)
    at_rest, sliding = found.stability.damping, found.stability.sliding
    assert at_rest is not None and sliding is not None and at_rest < 0 < sliding


@pytest.mark.slow
def test_printed_friction_with_all_valves() -> None:
    found = hb.study(STUDIES + "table3_printed")
    for outcome, (k_p, k_v, variation) in zip(found.outcomes, printed_on_the_page(), strict=True):
        assert found.value(outcome, "controller.K_p") == pytest.approx(k_p, rel=0.01)
        assert found.value(outcome, "controller.K_v") == pytest.approx(k_v, rel=0.01)
        assert found.value(outcome, "WOB variation") == pytest.approx(variation, rel=ROUGH)


def test_a_slip_in_the_name_of_a_study_is_told_with_the_study_that_is_meant() -> None:
    with pytest.raises(hb.UsageError, match=r"Did you mean 'cmc_ahc/studies/table3'"):
        load_study(STUDIES + "table33")


@pytest.mark.slow
def test_table_3_whole() -> None:
    """Both procedures in every cell, as the study's one command works them out."""
    found = hb.study(STUDIES + "table3")
    assert found.complete
    for friction, f_n in CELLS:
        page = on_the_page()[friction, f_n]
        swept, tuned = (found.of(friction, f_n, procedure=name) for name in ("sweeps", "gradients"))
        assert found.value(tuned, "cost") <= found.value(swept, "cost") * (1 + 1e-5)
        assert found.value(tuned, "simulations") <= found.value(swept, "simulations") * 0.1
        assert found.value(swept, "cost") == pytest.approx(page["swept phi"], rel=1e-3)
        # as told to 0.01; beside the best value the cost is as low
        assert found.value(swept, "controller.K_p") == pytest.approx(page["swept K_p"], abs=0.025)
        assert found.value(swept, "controller.K_v") == pytest.approx(page["swept K_v"], abs=0.015)
        assert found.value(tuned, "WOB variation") == pytest.approx(page["WOB"], rel=ROUGH)


def test_the_values_are_better_than_those_that_a_search_by_gradients_finds() -> None:
    """By the count of the calibration, 51.4 at handbook figures and 23.5 where it ends."""
    study = load_study(STUDIES + "calibration")
    assert study.calibration is not None
    given, total, diagram = study.beside[study.calibration.source].numbers, 0.0, load_study(STUDIES + "table3")
    for number, ((friction, f_n), case) in enumerate(zip(CELLS, study.cases, strict=True)):
        page = on_the_page()[friction, f_n]
        gains = {"controller.K_p": page["K_p"], "controller.K_v": page["K_v"]}
        numbers, _, _ = measured(study, assembled(diagram, diagram.case(number)).with_parameters(gains))
        for quantity, width in study.calibration.targets.items():
            target = given[quantity].get(case.index)
            if target is not None:
                total += (({**numbers, **gains}[quantity] - target.value) / (width * target.value)) ** 2
    assert total == pytest.approx(20.7, rel=0.03)     # the gains of the page are rounded


@pytest.mark.slow
def test_calibration_whole() -> None:
    """From handbook figures, as the page tells it. The way is rough (friction): the sum to 5 %, the values to 10 %."""
    found = hb.study(STUDIES + "calibration")
    assert found.complete and found.calibrated is not None
    first, last, zeta, beta, hook = stated(r"decreases from ([0-9.]+) to ([0-9.]+), with spool damping ([0-9.]+), "
                                           r"bulk modulus ([0-9.]+) GPa, ([0-9.]+) t of string at the hook")
    assert found.calibrated.history[0] == pytest.approx(first, rel=0.02)
    assert min(found.calibrated.history) == pytest.approx(last, rel=0.05)
    after = {name: pair[1] for name, pair in found.calibrated.values.items()}
    assert after["ahc.valve.zeta"] == pytest.approx(zeta, rel=0.1)
    assert after["ahc.cylinder.beta"] == pytest.approx(1e9 * beta, rel=0.05)
    assert after["drilling.hook.m"] == pytest.approx(50e3 + 1e3 * hook, rel=0.1)


@pytest.mark.slow
def test_amplitude() -> None:
    found = hb.study(STUDIES + "amplitude")
    amplitudes = ["0.5 m", "0.75 m", "1 m", "1.25 m", "1.5 m", "1.75 m"]
    for active in ("active", "active, 2.5 Hz"):
        of = [found.of(active, a) for a in amplitudes]
        assert all(found.value(outcome, "off bottom") == 0 for outcome in of)
        assert (np.diff([found.value(outcome, "WOB variation") for outcome in of]) > 0).all()
    assert found.value(found.of("passive, no friction", "0.5 m"), "slams") == 0
    for passive in ("passive", "passive, no friction", "passive, as printed"):
        assert found.value(found.of(passive, "1.75 m"), "slams") == 2


def test_the_machine_in_parts_agrees_with_the_lumped_one() -> None:
    lumped, detailed = hb.simulate(hb.load("cmc_ahc"), "36 s"), hb.simulate(hb.load("cmc_ahc/detailed"), "36 s")
    # 0.5 % of the range: the polytropic gas and the oil that the equalisers draw
    for name in ("WOB", "crown", "p_A"):
        assert np.abs(detailed.si[name] - lumped.si[name]).max() < 5e-3 * np.ptp(lumped.si[name])
    assert np.abs(detailed.display["p_main"] - lumped.display["p_main"]).max() < 0.01 * np.ptp(lumped.display["p_main"])


def test_the_storm_ends_at_the_stops(studies_folder: Path) -> None:
    """The run is complete, the stroke stays within the stops and their deflection, and both ends are struck when active.

    The numbers are those of the page of the compensator: 10 %, and one impact, as each impact depends on the ones before.
    """
    found = hb.study(STUDIES + "storm", processes=1, folder=studies_folder / "storm")
    assert found.complete
    page = PAGE.with_name("compensator.md").read_text(encoding="utf-8")
    for operation in ("active", "passive"):
        of = found.of(operation)
        line, = re.findall(rf"^{operation} ([0-9. ]+)$", page, re.MULTILINE)
        # every measure of the study in its order, the largest force in MN, the share of time in %
        told = dict(zip(found.study.measures, map(float, line.split()), strict=True))
        for name, number in told.items():
            assert found.value(of, name) == pytest.approx(number, rel=0.1, abs=1 if "impacts" in name else 0), name
        deflection = found.value(of, "largest force") / 400     # MN over two stops of 200 MN/m
        assert 3.825 < found.value(of, "stroke") <= 3.825 + deflection + 1e-3
        assert 1 < found.value(of, "largest force") < 10     # MN
    active = found.of("active")
    assert found.value(active, "upper impacts") > 5 and found.value(active, "lower impacts") > 3


# -- numbers in sentences ----------------------------------------------------------------------------------------------
def stated(pattern: str) -> list[float]:
    """Numbers that a sentence of the page states; its line breaks are spaces."""
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    found = re.search(pattern, text)
    assert found, f"the page has no sentence like this: {pattern}"
    return [float(number) for number in found.groups()]


def late(signal: str, model: str, **parameters: float) -> np.ndarray:
    """A signal over the last two periods, in the unit of the diagram."""
    given = {name.replace("__", "."): value for name, value in parameters.items()}
    return hb.simulate(hb.load(model), parameters=given).display[signal][3600:-1]


def wob(model: str, **parameters: float) -> np.ndarray:
    """kN around 30, over the last two periods."""
    return late("WOB", model, **parameters) - 30


def test_sentences_on_forces() -> None:
    speed, high = (2 * np.pi / 12 * a for a in (0.5, 1.75))
    assert stated(r"the platform moves at ([\d.]+) m/s; gas damping") == pytest.approx([speed], rel=0.01)
    assert stated(r"viscous and Coulomb friction are ([\d.]+) \+ ([\d.]+) \+ 12 = ([\d.]+) kN") == pytest.approx(
        [52 * speed, 10 * speed, 62 * speed + 12], rel=0.01)
    assert stated(r"mass amplifies this force by (\d+) %") == pytest.approx(
        [100 / (1 - (1 / 12 / 0.2392) ** 2) - 100], abs=0.5)
    assert stated(r"causes (\d+) kN at the platform's ([\d.]+) m/s") == pytest.approx([52 * high, high], rel=0.01)
    assert stated(r"\((\d+) kN from stiction to stiction\)") == pytest.approx([2 * 22.8], rel=0.02)
    static = 1 / (1 / 4000 + 1 / 298 + 1 / 1000)
    assert stated(r"stiffness of (\d+) kN/m, so a slow motion of 2 cm corresponds to ([\d.]+) kN") == pytest.approx(
        [static, 0.02 * static], rel=0.01)


def test_sentences_on_the_optimum_at_three_quarter_hertz() -> None:
    ours = [on_the_page()[friction, "0.75 Hz"] for friction in PUBLISHED]
    numbers = stated(r"K_p \(([\d.]+) 1/m\) is (\d+) % above the published 3.02 and K_v \(([\d.]+) s/m\) is (\d+) %")
    assert numbers == pytest.approx([ours[0]["K_p"], 100 * (ours[0]["K_p"] / 3.02 - 1), ours[0]["K_v"],
                                     100 * (1 - ours[0]["K_v"] / 0.55)], abs=0.5)
    gains = [{"controller__K_p": one["K_p"], "controller__K_v": one["K_v"]} for one in ours]
    dry, smooth = wob("cmc_ahc", **gains[0]), wob("cmc_ahc/active_frictionless", **gains[1])
    added = abs(dry).max() - abs(smooth).max()
    assert stated(r"Friction increases the WOB variation by ([\d.]+) kN; in the paper") == pytest.approx([added], abs=0.06)
    spectrum = 2 * abs(np.fft.rfft(dry)) / len(dry)     # kN at multiples of 1/24 s, two periods of the wave
    assert stated(r"The slow motion at the wave period causes ([\d.]+) of the ([\d.]+) kN in this model") == pytest.approx(
        [spectrum[2], abs(dry).max()], rel=0.03)
    first, second, size = stated(r"mainly at ([\d.]+) and ([\d.]+) Hz \(([\d.]+) kN each\)")
    largest = np.sort(np.argsort(spectrum)[-3:])
    assert (largest / 24).tolist() == pytest.approx([1 / 12, first, second], abs=0.005)
    assert spectrum[largest[1:]] == pytest.approx([size, size], abs=0.05)
    long, short = (np.ptp(late("crown", name, **gain)) for name, gain in
                   zip(("cmc_ahc", "cmc_ahc/active_frictionless"), gains, strict=True))
    assert stated(r"moves ([\d.]+) mm from its lowest to its highest point with friction \((\d+) % more\) and ([\d.]+) mm "
                  r"without \((\d+) % less\)") == pytest.approx(
        [long, 100 * (long / 20 - 1), short, 100 * (1 - short / 20)], abs=0.5)


def test_sentences_on_the_stability_boundary() -> None:
    """Without friction: K_p at which a mode ceases to decay, and its frequency."""
    bounds = stated(r"boundary is K_p ([\d.]+) 1/m at 0.75 Hz and ([\d.]+) 1/m at 1 Hz: .* wires at ([\d.]+) Hz")
    fast = stated(r"above ([\d.]+) 1/m a mode at ([\d.]+) Hz is unstable")
    for f_n, k_p, frequency in ((0.75, bounds[0], None), (1.0, bounds[1], bounds[2]), (2.5, *fast)):
        machine = hb.assemble(hb.load("cmc_ahc/active_frictionless")).with_parameters({"ahc.valve.f_n": f_n})
        for share, grows in ((0.99, False), (1.01, True)):
            found = ModesAtStart(machine.with_parameters({"controller.K_p": share * k_p})).at({})[1]
            least = max((mode for mode in found if mode.swings), key=lambda mode: mode.value.real)
            assert (least.value.real > 0) is grows
            assert frequency is None or least.frequency == pytest.approx(frequency, abs=0.05)


def test_sentence_on_the_passive_machine_with_perfect_equalisers() -> None:
    """In proportion to the wave, as the machine is linear while the bit is on bottom."""
    area = hb.assemble(hb.load("cmc_ahc")).parameter_values["cmc.equaliser.A"] / 1.027
    half = abs(wob("cmc_ahc/passive_frictionless", cmc__equaliser__A=area)).max()
    assert half < 30
    assert stated(r"perfect equalisers the WOB varies by (\d+) kN") == pytest.approx([3.5 * half], abs=1)


def test_sentences_on_the_unstable_optimum() -> None:
    """Without friction at 2.5 Hz, where stability is the active limit."""
    machine = hb.assemble(hb.load("cmc_ahc/active_frictionless")).with_parameters({"ahc.valve.f_n": 2.5})
    task = replace(load_study("cmc_ahc/quality_index").tuning, stable=False)
    found = hb.tune(machine, task, explore=8)
    k_p, low = stated(r"would lead to K_p ([\d.]+) 1/m, with ([\d.]+) kN")
    assert found.values["controller.K_p"] == pytest.approx(k_p, rel=0.01)
    runs = [hb.simulate(machine, parameters={**found.values, "wave.a": a}).display["WOB"][3600:] - 30 for a in (0.5, 0.25)]
    assert abs(runs[0]).max() == pytest.approx(low, rel=0.02)
    assert stated(r"in a wave of 0.25 m the WOB oscillates by (\d+) kN") == pytest.approx([abs(runs[1]).max()], rel=0.05)


def test_sentence_on_the_high_wave() -> None:
    assert stated(r"of 2.5 Hz the 1.75 m wave gives ([\d.]+) kN") == pytest.approx(
        [abs(wob("cmc_ahc/fast_valve", wave__a=1.75)).max()], rel=0.01)


def test_sentences_on_assumed_values() -> None:
    critical = [2 * np.sqrt(c * m) for c, m in ((4e6, 68e3), (298e3, 65e3), (1e6, 65e3))]
    assert stated(r"([\d.]+) and ([\d.]+) % of critical, with the masses below") == pytest.approx(
        [100 * 50e3 / critical[0], 100 * 15e3 / critical[1]], rel=0.02)
    assert stated(r"\| (\d+) %; rock radiates waves") == pytest.approx([100 * 220e3 / critical[2]], rel=0.02)
    flow = 2e-11 * 100e5 * 60e3
    assert stated(r"(\d+) L/min at 100 bar over both pistons, ([\d.]+) % of the rated flow") == pytest.approx(
        [flow, 100 * flow / 920], rel=0.02)
    area = np.pi / 4 * 0.4**2
    pressure = (163 * 9.81 - 30) / area / 100
    assert stated(r"400 mm\) \| 100 to 200 bar under the load \| (\d+) bar") == pytest.approx([pressure], rel=0.01)
    assert stated(r"mid stroke, which is their purpose \(to (\d+) %\)") == pytest.approx(
        [100 * 2 * 69e-4 * pressure * 1e5 / 4 / 42e3], rel=0.01)


def test_sentences_on_a_third_of_the_string_at_the_hook() -> None:
    frequency, k_p = stated(r"the eigenfrequency \(([\d.]+) Hz\) and K_p \(([\d.]+) 1/m\) agree with the published")
    passive = ModesAtStart(hb.assemble(hb.load("cmc_ahc/passive_frictionless")).with_parameters({"drilling.hook.m": 76.7e3}))
    slowest = min((mode for mode in passive.at({})[1] if mode.swings), key=lambda mode: mode.frequency)
    assert slowest.frequency == pytest.approx(frequency, rel=0.01)
    machine = hb.assemble(hb.load("cmc_ahc")).with_parameters({"drilling.hook.m": 76.7e3})
    assert hb.tune(machine, load_study("cmc_ahc/quality_index").tuning, explore=8).values["controller.K_p"] == pytest.approx(
        k_p, rel=0.03)


def test_sentence_on_two_minima() -> None:
    """With friction at 1 Hz."""
    k_p, higher = stated(r"At the second, with K_p ([\d.]+) 1/m, phi is ([\d.]+) % higher")
    machine = hb.assemble(hb.load("cmc_ahc")).with_parameters({"ahc.valve.f_n": 1.0})
    objective = Objective(machine, load_study("cmc_ahc/quality_index").tuning)
    other = objective.at({"controller.K_p": k_p, "controller.K_v": 0.524}).cost
    assert 100 * (other / on_the_page()["with", "1 Hz"]["phi"] - 1) == pytest.approx(higher, abs=0.5)
    here, less = stated(r"lower one, by ([\d.]+) % here and by ([\d.]+) % with 30 and 10 kN")
    assert here == higher
    damped = Objective(machine.with_parameters({"drilling.wires.d": 30e3, "drilling.string.d": 10e3}),
                       load_study("cmc_ahc/quality_index").tuning)
    lower, other = (damped.at({"controller.K_p": one, "controller.K_v": 0.524}).cost for one in (3.346, 2.392))
    assert 100 * (other / lower - 1) == pytest.approx(less, abs=0.25)


def test_the_bit_lifts_off_with_every_assumed_value() -> None:
    """Passive, with friction: each value of the table at either end of its bounds."""
    ends = {"cmc.equaliser.A": (0, 80e-4), "cmc.gas.A": (1569e3 / 200e5, 1569e3 / 100e5), "cmc.friction.k_p": (0, 1e-4),
            "drilling.hook.m": (50e3, 90e3), "drilling.wires.d": (5e3, 100e3), "drilling.string.d": (1.5e3, 28e3),
            "drilling.formation.d": (5e3, 255e3), "wave.t_r": (1, 12)}
    machine = hb.assemble(hb.load("cmc_ahc/passive"))
    off = [100 * (hb.simulate(machine, parameters={path: value}).display["WOB"][3600:] <= 0).mean()
           for path, values in ends.items() for value in values]
    assert stated(r"off bottom for ([0-9]+) to ([0-9]+) % of the time") == pytest.approx([min(off), max(off)], abs=1)


def test_sentence_on_slow_gains_at_half_a_hertz() -> None:
    """Without friction: a K_p of about a half, and one beyond the boundary."""
    half, whole, growing, beyond = stated(r"7.1 kN results from K_p ([0-9.]+) instead of ([0-9.]+) 1/m, .* growing "
                                          r"oscillation \(([0-9.]+) kN with ([0-9.]+) 1/m\)")
    k_v = on_the_page()["without", "0.5 Hz"]["K_v"]
    given = {"ahc__valve__f_n": 0.5, "controller__K_v": k_v}
    assert whole == pytest.approx(on_the_page()["without", "0.5 Hz"]["K_p"], abs=0.05)
    for k_p, kilonewton, near in ((half, 7.1, 0.05), (beyond, growing, 0.1)):
        found = abs(wob("cmc_ahc/active_frictionless", controller__K_p=k_p, **given)).max()
        assert found == pytest.approx(kilonewton, rel=near)


def test_sentence_on_a_misprint() -> None:
    gain, kilonewton = stated(r"not a misprint of 3.15: with ([0-9.]+) 1/m, which is stable in this model, the weight "
                              r"on bit varies by ([0-9.]+) kN")
    found = abs(wob("cmc_ahc/active_frictionless", controller__K_p=gain, controller__K_v=0.55)).max()
    assert found == pytest.approx(kilonewton, rel=0.03)


def test_sentence_on_the_printed_friction_near_rest() -> None:
    """F has the sign of v only where F_s tanh(xi v) is above F_c."""
    speed, = stated(r"drives the piston at speeds below ([0-9.]+) mm/s")
    assert np.arctanh(12 / 22.8) == pytest.approx(speed, abs=0.05)


@pytest.mark.slow
def test_cells_with_a_third_of_the_string_at_the_hook() -> None:
    study, met = load_study(STUDIES + "table3"), 0
    for number, (friction, f_n) in enumerate(CELLS):
        machine = assembled(study, study.case(number)).with_parameters({"drilling.hook.m": 76.7e3})
        found = tuned_by(Objective(machine, study.tuning), study.procedures[1])
        numbers, _, _ = measured(study, machine.with_parameters(found.values))
        met += abs(numbers["WOB variation"] / 1e3 / on_the_page()[friction, f_n]["published"] - 1) <= 0.25
    assert met == 5
    assert "the published values, and five cells are reproduced" in " ".join(PAGE.read_text(encoding="utf-8").split())
