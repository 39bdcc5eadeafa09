"""What the studio shows of a run on the drawing: courses of the wires and of the parts, and modes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import heavebond as hb
from heavebond.energy_audit.audit import port_powers
from heavebond.numerics.dae import assemble
from heavebond.numerics.result import Result
from heavebond.studio.animation import FRAMES, animation, modes

CAR = Path(__file__).parents[1] / "models" / "quarter_car" / "quarter_car.yaml"
UNITS = {"": 1.0, "N": 1.0, "kN": 1e3, "W": 1.0, "kW": 1e3, "J": 1.0, "kJ": 1e3, "m/s": 1.0, "mm/s": 1e-3}


@pytest.fixture(scope="module")
def run() -> Result:
    return hb.simulate(hb.load(CAR))


def _course(told: Any, values: np.ndarray, kind: str, path: str, quantity: str) -> np.ndarray:
    row, unit = told[kind][path][quantity]
    return np.asarray(values[row] * UNITS[unit])


def test_wires_and_parts_have_the_courses_of_the_run(run: Result) -> None:
    told, values = animation(run)
    time = values[0]
    assert len(time) <= FRAMES and time[0] == run.time[0] and time[-1] == run.time[-1]
    at = np.searchsorted(run.time, time)
    assert _course(told, values, "nodes", "wheel", "flow") == pytest.approx(run.si["wheel.v"][at], rel=1e-12)
    forces = [run.si[f"{port}.f"][at] for port in ("wheel.a", "spring.a", "damper.a", "tyre.b", "wheel_weight.a")]
    assert _course(told, values, "nodes", "wheel", "effort") == pytest.approx(np.max(np.abs(forces), axis=0), rel=1e-12)
    powers = port_powers(run)
    through = 0.5 * sum(np.abs(powers[port][at]) for port in ("wheel.a", "spring.a", "damper.a", "tyre.b", "wheel_weight.a"))
    assert _course(told, values, "nodes", "wheel", "power") == pytest.approx(through, rel=1e-9, abs=1e-9)
    speed = run.si["body.v"] - run.si["wheel.v"]
    assert _course(told, values, "parts", "damper", "loss") == pytest.approx(1500 * speed[at] ** 2, rel=1e-9, abs=1e-9)
    assert _course(told, values, "parts", "body", "energy") == pytest.approx(160 * run.si["body.v"][at] ** 2, rel=1e-9)
    assert "loss" not in told["parts"]["spring"] and "energy" not in told["parts"]["damper"]


def test_the_shares_of_a_mode_are_those_of_the_parts(run: Result) -> None:
    found = modes(run.assembly, {})["modes"]
    assert isinstance(found, list)
    body, wheel = found
    assert sum(body["energy"].values()) == pytest.approx(1) and max(body["energy"], key=body["energy"].get) == "body"
    assert max(wheel["energy"], key=wheel["energy"].get) == "wheel"
    # both masses move together in the first mode, against each other in the second
    ratios = [complex(*mode["shape"]["wheel"]) / complex(*mode["shape"]["body"]) for mode in (body, wheel)]
    assert ratios[0].real > 0 and ratios[1].real < 0 and "road" not in body["shape"]
    # undamped: the ratio of the amplitudes is 1 - m_body*w**2/c
    free = modes(run.assembly, {"damper.d": "0 N*s/m", "tyre.d": "0 N*s/m"})["modes"]
    for mode in free:
        ratio = complex(*mode["shape"]["wheel"]) / complex(*mode["shape"]["body"])
        assert ratio == pytest.approx(1 - 320 * (2 * np.pi * mode["frequency"])**2 / 22e3, rel=1e-6)
    softer = modes(run.assembly, {"spring.c": "5 kN/m"})["modes"]
    assert isinstance(softer, list) and softer[0]["frequency"] < 0.6 * body["frequency"]


def test_a_block_has_what_is_in_it() -> None:
    assembly = assemble(hb.load("cmc_ahc"))
    for mode in modes(assembly, {})["modes"]:
        inside = sum(share for path, share in mode["energy"].items() if path.startswith("drilling."))
        assert mode["energy"].get("drilling", 0.0) == pytest.approx(inside)
