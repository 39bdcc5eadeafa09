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


def test_the_delay_margin_of_a_loop_with_a_unit_delay() -> None:
    """x' = u held over T, u_k+1 = -K x_k, K T = 0.9: z**2 - z + K T = 0. With a further delay d < T behind the hold,
    z**3 - z**2 + K (T - d) z + K d = 0. In front of the sample any delay costs a whole period, z**3 - z**2 + K T = 0, and
    the loop is unstable."""
    model = hb.loads("""
model: delayed
components:
  plant:   {is: Integrator, k: 1 1/s, u: =delay.y}
  control: {is: SampleHold, T_s: 0.1 s, u: =9*(1 - plant.y)}
  delay:   {is: UnitDelay, T_s: 0.1 s, u: =control.y}
initial: {plant.y: 0}
simulate: {until: 1 s}
""")

    def unstable(d: float) -> bool:
        return bool(np.abs(np.roots([1, -1, 9*(0.1 - d), 9*d])).max() > 1)

    low, high = 0.0, 0.1
    for _ in range(40):
        middle = (low + high)/2
        low, high = (low, middle) if unstable(middle) else (middle, high)
    behind = hb.loop_margins(model, "delay.y")
    assert behind.gain[0].value == pytest.approx(1/0.9, rel=1e-9)
    # the search ends at nine digits of its step
    assert behind.delay[0].value == pytest.approx(low, rel=1e-6)
    assert hb.loop_margins(model, "control.y").delay[0].value < 1e-5


def test_a_part_of_a_controller_with_a_gain_of_zero_takes_no_verdict() -> None:
    """The derivative part of this PI controller is always zero, and a converter adds no pole."""
    text = """
model: heated
components:
  plant:   {is: FirstOrderLag, T_1: 1 s, u: =control.y}
  control: {is: DiscretePID, K_p: 2, K_i: 1 1/s, y_min: -10, y_max: 10, T_s: 0.1 s, r: 1, u: READ}
initial: {plant.y: 0}
simulate: {until: 1 s}
"""
    at_start = ModesAtStart(assemble(hb.loads(text.replace("READ", "=plant.y"))))
    found = at_start.linearisation.at(at_start.point(at_start.start({})))
    assert not any(h.undecided for h in found.held)
    rounded = text.replace("READ", "=converter.y").replace("initial:", """  converter: {is: AnalogDigitalConverter, bits: 8,
    u_min: -2, u_max: 2, T_s: 0.1 s, u: =plant.y}\ninitial:""")
    at_start = ModesAtStart(assemble(hb.loads(rounded)))
    other = at_start.linearisation.at(at_start.point(at_start.start({})))
    assert not any(h.undecided for h in other.held) and [h.name for h in other.sampled if h.rounded] == ["converter.k"]
    poles, expected = (np.sort_complex(np.linalg.eigvals(a))[-2:] for a in (other.a, found.a))
    assert poles == pytest.approx(expected)
