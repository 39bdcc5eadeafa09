"""Motion of a vessel by its response tables, and parts that part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from benchmarks import ship_response
from heavebond.language.symbols import uniform

SEA = "H_s: 3 m, T_p: 9 s, gamma: 3.3, t_r: 6 s, n: 12, seed: 3"
TABLE = "omega: [0.3 rad/s, 0.6 rad/s, 1.2 rad/s], beta: [0 deg, 90 deg]"
DIAGRAM = f"""
model: vessel
components:
  sea:  {{is: IrregularSea, {SEA}}}
  same: {{is: SeaResponse, {SEA}, heading: 30 deg, {TABLE}, amplitude: [[1, 1], [1, 1], [1, 1]],
         phase: [[0 rad, 0 rad], [0 rad, 0 rad], [0 rad, 0 rad]]}}
  ship: {{is: SeaResponse, {SEA}, heading: 30 deg, {TABLE}, amplitude: [[1, 0.9], [0.5, 1.2], [0.1, 0.3]],
         phase: [[0 rad, 0 rad], [3 rad, -0.5 rad], [-3 rad, -2 rad]]}}
nodes: {{sea: [sea.z], same: [same.y], ship: [ship.y]}}
show: {{sea: {{is: sea.z, unit: m}}, same: {{is: same.y, unit: m}}, ship: {{is: ship.y, unit: m}}}}
simulate: {{until: 60 s, every: 0.5 s}}
"""


@pytest.fixture(scope="module")
def motion() -> hb.Result:
    return hb.simulate(hb.loads(DIAGRAM))


def test_a_table_of_ones_is_the_sea(motion: hb.Result) -> None:
    assert abs(motion.display["sea"]).max() > 1
    assert motion.display["same"] == pytest.approx(motion.display["sea"], abs=1e-12)


def test_the_motion_is_the_sum_of_the_responses(motion: hb.Result) -> None:
    """By NumPy from the table: bilinear in the complex response, so that phases of 3 and -3 rad are near each other."""
    t, n, seed, gamma = motion.time, 12, 3, 3.3
    number = np.arange(1, n + 1)
    share = (number - 0.75 + 0.5 * np.array([uniform(seed, int(i)) for i in number])) / n
    ratio = (1.25 / -np.log(share)) ** 0.25
    omega, start = 2 * np.pi / 9 * ratio, 2 * np.pi * np.array([uniform(seed, n + int(i)) for i in number])
    waves = 3 / 4 * np.sqrt(2 / n * (1 - 0.287 * np.log(gamma))) * gamma ** (0.5 * np.exp(-0.5 * ((ratio - 1) / 0.08) ** 2))
    table = np.array([[1, 0.9], [0.5, 1.2], [0.1, 0.3]]) * np.exp(1j * np.array([[0, 0], [3, -0.5], [-3, -2]]))
    row = table[:, 0] + (table[:, 1] - table[:, 0]) * 30 / 90
    response = np.interp(omega, [0.3, 0.6, 1.2], row.real) + 1j * np.interp(omega, [0.3, 0.6, 1.2], row.imag)
    moving = np.exp(1j * (np.multiply.outer(t, omega) + start)) @ (waves * response)
    expected = (1 - np.exp(-((t / 6) ** 3))) * moving.imag
    assert motion.display["ship"] == pytest.approx(expected, abs=1e-9)


def test_long_waves_carry_the_ship() -> None:
    """Heave follows the surface, roll and pitch its slope; from the sides the ship heaves more than from ahead."""
    heave, roll, pitch = ship_response.responses(0.05, np.radians(135))
    k = 0.05**2 / 9.81
    assert heave == pytest.approx(1, abs=0.01)
    assert abs(roll) == pytest.approx(k * np.sin(np.pi / 4), rel=0.03)
    assert pitch == pytest.approx(-1j * k * np.cos(np.pi / 4), rel=0.03)
    assert abs(ship_response.responses(0.5, np.pi / 2)[0]) > 2 * abs(ship_response.responses(0.5, np.pi)[0])


def test_the_tables_of_the_drill_ship_are_those_of_the_formulas() -> None:
    text = (Path(__file__).parents[1] / "models" / "cmc_ahc" / "drill_ship.yaml").read_text(encoding="utf-8")
    assert "\n".join(ship_response.lines()) in text


def test_the_lower_end_of_a_riser_is_released_at_an_instant() -> None:
    """The steady start holds its tension; without it the gas lifts the ring."""
    run = hb.simulate(hb.load("cmc_ahc/riser_tensioner"), "2 s", parameters={"disconnect": 1.0, "wave.a": 0.0})
    before, after = run.time < 1, run.time > 1
    assert run.display["overpull"][before] == pytest.approx(300, abs=1)
    assert not run.display["overpull"][after].any()
    assert abs(run.display["ring_speed"][before]).max() < 0.01 < 0.5 < run.display["ring_speed"][after].max()
