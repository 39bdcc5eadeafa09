"""Short motions of prescribed functions of time: no solver passes over what the output points show."""

from __future__ import annotations

import numpy as np
import pytest

import heavebond as hb
from heavebond.numerics.forcing import FORCING, Forcing, _longest
from heavebond.numerics.machine_code import compiler
from heavebond.numerics.quick_simulation import FitSimulator, QuickSimulator
from heavebond.numerics.simulator import Simulator

# a wheel at rest meets a bump of 30 mm after 40 s; the car has passed it in 0.3 s
LATE = """
model: late_bump
parameters: {speed: 5 m/s, length: 0.4 m}
components:
  wheel: {is: Mass, m: 40 kg}
  tyre:  {is: SpringDamper, c: 190 kN/m, d: 1.5 kN*s/m}
  road:  {is: PositionSource, u: "=30 mm*exp(-((speed*(time - 40 s))/length)**2)"}
nodes: {wheel: [wheel.a, tyre.b], road: [tyre.a, road.a]}
show: {place: {is: wheel.x, unit: mm}}
simulate: {until: 50 s, every: 10 ms}
"""


@pytest.fixture(scope="module")
def late() -> hb.Assembly:
    return hb.assemble(hb.loads(LATE))


@pytest.mark.parametrize("solver", ["idas", "cvodes", "rosenbrock", "quick", "fit"])
def test_a_bump_after_a_long_rest_is_not_passed_over(late: hb.Assembly, solver: str) -> None:
    if solver == "rosenbrock" and compiler() is None:
        pytest.skip("no C compiler")
    kinds = {"quick": QuickSimulator, "fit": FitSimulator}
    simulator = kinds[solver](late) if solver in kinds else Simulator(late, solver=solver)
    reference = Simulator(late, times=np.linspace(39.0, 42.0, 301)).run().si["place"]  # begins just before it
    found = simulator.run().si["place"][3900:4201]
    assert np.abs(reference).max() > 0.02
    assert found == pytest.approx(reference, abs=1e-5)  # the tolerance of the solvers times the steps over the bump


@pytest.mark.parametrize("sampled", ["45 s", "7 s"])
def test_a_bump_between_events_is_not_passed_over(late: hb.Assembly, sampled: str) -> None:
    """A run with events is integrated in stretches, each in a time of its own."""
    text = LATE.replace("nodes:", f"  late: {{is: SampleHold, T_s: {sampled}, u: =wheel.x/1 m}}\nnodes:")
    found, reference = hb.simulate(hb.loads(text)).si["place"], Simulator(late).run().si["place"]
    assert np.abs(reference).max() > 0.02
    assert found == pytest.approx(reference, abs=1e-5)


def test_a_shorter_bump_of_other_parameters_is_seen_by_the_same_simulator(late: hb.Assembly) -> None:
    simulator = Simulator(late)
    before = simulator.longest
    fast = simulator.run({"speed": "20 m/s"})
    assert 0 < simulator.longest < before
    assert fast.si["place"].max() > 0.02


def test_a_wave_limits_no_step_that_a_solver_would_take(late: hb.Assembly) -> None:
    """An excursion of 5 % of a sine's range is reached in a seventh of its period; with windows in powers of two, at worst
    half of that."""
    time = np.linspace(0.0, 100.0, 2001)
    wave = np.sin(2 * np.pi * time / 10)[None, :]
    assert 10 / 14 <= _longest(wave, 0.05) * 1.001 <= 10 / 7 + 0.1
    steps = np.vstack([np.tanh(time - 50), time, np.ones_like(time)])  # what stays changed is always noticed
    assert _longest(steps, 0.05) == 0.0
    assert FORCING.share == 0.05


def test_what_is_at_rest_or_driven_by_states_has_no_limit() -> None:
    free = hb.assemble(hb.loads("""
model: free
components: {wall: {is: Fixed}, spring: {is: Spring, c: 1 kN/m}, load: {is: Mass, m: 1 kg}}
nodes: {wall: [wall.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 1 mm}
simulate: {until: 1 s}
"""))
    assert Forcing(free).longest_step(np.linspace(0, 1, 101), free.p) == 0.0
