"""Linear analysis of sampled loops takes the new values of samples in the order of the run."""

from __future__ import annotations

import numpy as np
import pytest

import heavebond as hb
from heavebond.linear.linearisation import ModesAtStart
from heavebond.numerics.dae import assemble


def test_a_unit_delay_that_reads_its_own_output_is_an_accumulator() -> None:
    """x' = y, y_k+1 = y_k - K x_k: [[1, T], [-K, 1]]."""
    model = hb.loads("""
model: accumulator
parameters: {K: 0.2}
components:
  plant: {is: Integrator, k: 1 1/s, u: =delay.y}
  delay: {is: UnitDelay, T_s: 0.1 s, u: =delay.y - K*plant.y}
initial: {plant.y: 1}
simulate: {until: 1 s, every: 100 ms}
""")
    at_start = ModesAtStart(assemble(model))
    found = np.linalg.eigvals(at_start.linearisation.at(at_start.point(at_start.start({}))).a)
    expected = np.linalg.eigvals(np.array([[1, 0.1], [-0.2, 1]]))
    assert sorted(found, key=np.imag) == pytest.approx(sorted(expected, key=np.imag), abs=1e-12)
    run = hb.simulate(model)
    state = np.array([1.0, 0.0])
    for x in run["plant.y"]:
        assert x == pytest.approx(state[0], abs=1e-7)
        state = np.array([[1, 0.1], [-0.2, 1]]) @ state
