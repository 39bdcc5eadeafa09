"""Examples of the Modelica Standard Library beside their closed solutions; see `benchmarks/modelica`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb

FOLDER = Path(__file__).parents[1] / "benchmarks" / "modelica"


def run(name: str) -> hb.Result:
    return hb.simulate(hb.load(FOLDER / f"{name}.yaml"), rtol=1e-10)


def test_examples_with_closed_solutions() -> None:
    accelerated, masses, braked = run("accelerate"), run("two_masses"), run("damper")
    t = accelerated.time
    assert accelerated.si["accelerate.s"] == pytest.approx(t**2 / 2, abs=1e-9)
    assert masses.si["mass1.T"] == pytest.approx(323.15 + 50*np.exp(-20/15*t), abs=1e-6)
    assert braked.si["damper1.v_rel"] == pytest.approx(-10*np.exp(-25*t), abs=1e-7)


def test_a_forced_oscillation_near_resonance() -> None:
    """x'' + w0² x = sin(w t) from rest: x = (sin(w t) - w/w0 sin(w0 t))/(w0² - w²), by differences of angles."""
    found, w0, w = run("oscillator"), 100.0, 2*np.pi*15.9155
    t = found.time
    # v = w (cos(w t) - cos(w0 t))/(w0² - w²)
    v = 2*w*np.sin((w0 + w)/2*t)*np.sin((w0 - w)/2*t)/((w0 - w)*(w0 + w))
    assert found.si["mass1.v"] == pytest.approx(v, abs=3e-7)


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.yaml")))
def test_every_example_assembles(name: str) -> None:
    assert hb.assemble(hb.load(FOLDER / f"{name}.yaml")).model.name == name
