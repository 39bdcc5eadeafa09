"""Motion of a vessel by its response tables, and parts that part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from benchmarks import ship_response


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
