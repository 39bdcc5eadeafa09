"""Delayed variables: exact in runs, with sensitivities, in frequency responses; the line by characteristics."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.errors import HeavebondError

LOOP = """
model: delayed_loop
components:
  i: {{is: Integrator, k: {k} 1/s, u: "=-d.y"}}
  d: {{is: Delay, T: {T} s, u: "=i.y"}}
initial: {{i.y: 1}}
simulate: {{until: {until} s, every: 20 ms}}
"""
STEP = """
model: delayed_step
components:
  s: {is: Step, t_s: 0.1 s, before: 0, after: 1}
  d: {is: Delay, T: 0.1 s}
nodes: {u: [s.y, d.u], y: [d.y]}
simulate: {until: 0.4 s, every: 1 ms}
"""


def by_steps(t, T):
    """x' = -x(t - T) with x = 1 before 0: sum((-1)**k (t - (k - 1) T)**k / k!) over the terms with t > (k - 1) T."""
    return sum((-1)**k * np.clip(t - (k - 1) * T, 0, None)**k / factorial(k) for k in range(int(t.max() / T) + 2))


@pytest.mark.parametrize(("T", "until"), [(1.0, 4.0), (0.05, 0.5)])
def test_scalar_delay_equation_is_its_polynomials(T, until):
    run = hb.simulate(hb.loads(LOOP.format(T=T, until=until, k=1)))
    # rtol is 1e-8 a step; some hundred steps add up
    assert np.abs(run["i.y"] - by_steps(run.time, T)).max() < 1e-6


def test_step_is_zero_until_the_delay_is_over():
    run = hb.simulate(hb.loads(STEP))
    assert np.all(np.abs(run["d.y"] - (run.time > 0.2 - 1e-9)) < 1e-9)
    assert run.verdict.findings == ()


def test_delay_of_zero_passes_its_input_through():
    run = hb.simulate(hb.loads(LOOP.format(T=0, until=1, k=1)))
    np.testing.assert_array_equal(run["d.y"], run["i.y"])
    # exp(-t) to the accumulated error of the steps
    assert np.abs(run["i.y"] - np.exp(-run.time)).max() < 1e-6


def test_sensitivities_of_a_delayed_loop_are_its_difference_quotients():
    whole = hb.simulate(hb.loads(LOOP.format(T=0.5, until=2, k=1)), sensitivities=["d.T", "i.k"])
    # d/dT and d/dk of the polynomials: x depends on k t and k T only, x(t) = X(k t, k T)
    h = 1e-5
    t = whole.time
    by_T = (by_steps(t, 0.5 + h) - by_steps(t, 0.5 - h)) / (2 * h)
    by_k = (by_steps(t * (1 + h), 0.5 * (1 + h)) - by_steps(t * (1 - h), 0.5 * (1 - h))) / (2 * h)
    # sensitivities are accurate to about 1e-4 of their largest value (Tolerances.along)
    assert np.abs(whole.sensitivity("i.y", "d.T") - by_T).max() < 1e-4
    assert np.abs(whole.sensitivity("i.y", "i.k") - by_k).max() < 1e-4


def test_sensitivity_of_a_delayed_step_to_its_delay_is_that_of_a_shifted_ramp():
    text = STEP.replace("nodes:", '  i: {is: Integrator, k: 1 1/s}\nnodes:').replace("y: [d.y]", "y: [d.y, i.u]")
    run = hb.simulate(hb.loads(text), sensitivities=["d.T", "s.t_s"])
    after = run.time > 0.2 + 1e-9
    np.testing.assert_allclose(run["i.y"], np.clip(run.time - 0.2, 0, None), atol=1e-8)
    for name in ("d.T", "s.t_s"):  # i.y = t - t_s - T: the slope is -1 after the step, 0 before
        np.testing.assert_allclose(run.sensitivity("i.y", name)[run.time < 0.2 - 1e-9], 0, atol=1e-6)
        np.testing.assert_allclose(run.sensitivity("i.y", name)[after], -1, atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(("gain", "grows"), [(1.55, False), (1.59, True)])
def test_loop_of_an_integrator_is_stable_up_to_half_pi_over_the_delay(gain, grows):
    run = hb.simulate(hb.loads(LOOP.format(T=1, until=40, k=gain)))
    late, before = (np.abs(run["i.y"][(run.time > a) & (run.time < a + 8)]).max() for a in (32, 12))
    assert (late > before) == grows


def test_delayed_sine_is_shifted():
    text = """
model: sine
components:
  d: {is: Delay, T: 0.13 s, u: "=sin(2*pi*time/(1 s))"}
simulate: {until: 2 s, every: 10 ms}
"""
    run = hb.simulate(hb.loads(text))
    after = run.time > 0.13
    # the interpolation is not to add to the tolerance of the integrator
    assert np.abs(run["d.y"] - np.sin(2 * np.pi * (run.time - 0.13)))[after].max() < 1e-7


def test_margins_of_a_delayed_loop_are_exact():
    # L = k exp(-s T)/s: gain 1 at omega = k, the phase margin is 90 deg - k T; the gain margin is pi/(2 k T)
    margins = hb.loop_margins(hb.loads(LOOP.format(T=0.2, until=1, k=2)), "d.y")
    assert margins.least_phase.value == pytest.approx(90 - np.degrees(0.4), abs=1e-6)
    assert margins.gain_up.value == pytest.approx(np.pi / (2 * 0.4), rel=1e-6)


def test_pade_order_replaces_the_exact_delay():
    run = hb.simulate(hb.loads(STEP.replace("T: 0.1 s", "T: 0.1 s, m: 3")))
    assert run.assembly.state_names and not run.assembly.flat.delays


def test_run_ends_where_its_condition_is_met():
    text = """
model: fall
components:
  i: {is: Integrator, k: 2 1/s, u: "=1"}
simulate: {until: {when: i.y > 0.5, at_most: 10 s}, every: 0.1 s}
"""
    run = hb.simulate(hb.loads(text), sensitivities=["i.k"])
    assert run.time[-1] == pytest.approx(0.25, abs=1e-9)
    assert run["i.y"][-1] == pytest.approx(0.5, abs=1e-9)
    assert run.events == [(pytest.approx(0.25, abs=1e-9), "until")]
    assert run.event_sensitivity("until", 0, "i.k") == pytest.approx(-0.125, abs=1e-6)  # t = 0.5/k
    late = hb.simulate(hb.loads(text.replace("0.5,", "50,")))
    assert late.time[-1] == 10
    with pytest.raises(HeavebondError, match="true at the start"):
        hb.simulate(hb.loads(text.replace("i.y > 0.5", "i.y < 0.5")))


def test_largest_step_bounds_the_steps():
    text = """
model: slow
components:
  i: {is: FirstOrderLag, T_1: 1 s, u: "=1"}
simulate: {until: 10 s, every: 1 s, largest_step: 10 ms}
"""
    assert hb.simulate(hb.loads(text)).statistics["nsteps"] >= 1000


def test_sensitivity_by_the_time_of_a_kink_comes_through_the_delay():
    text = """
model: kink
components:
  p: {is: Ramp, rate: 2 1/s, t_s: 0.3 s, t_e: 0.6 s, start: 0}
  d: {is: Delay, T: 0.25 s}
  i: {is: Integrator, k: 1 1/s}
nodes: {u: [p.y, d.u], y: [d.y, i.u]}
simulate: {until: 1 s, every: 10 ms}
"""
    run = hb.simulate(hb.loads(text), sensitivities=["p.t_s", "d.T"])
    t = run.time
    rise = np.clip(t - 0.55, 0, 0.3)
    exact = rise**2 + 0.6 * np.clip(t - 0.85, 0, None)  # the integral of the delayed ramp
    assert np.abs(run["i.y"] - exact).max() < 1e-7
    # sensitivities are accurate to about 1e-4 of their largest value
    assert np.abs(run.sensitivity("i.y", "d.T") + 2 * rise).max() < 1e-4
    by_start = -2 * rise - 2 * np.clip(t - 0.85, 0, None)
    assert np.abs(run.sensitivity("i.y", "p.t_s") - by_start).max() < 1e-3


def test_modes_have_the_approximation_and_exact_responses():
    system = hb.state_space(hb.loads(LOOP.format(T=0.5, until=1, k=1)), ["i.u"], ["i.y"])
    # 1/(s + exp(-s T)) at s = 2 pi j
    s = 2j * np.pi
    assert abs(system.response(s)[0, 0, 0] - 1 / (s + np.exp(-0.5 * s))) < 1e-9
    assert len(system.states) == 7


def test_jump_behind_a_delay_is_refused_where_its_rate_is_needed():
    text = """
model: jump
components:
  st: {is: Step, t_s: 0.1 s, after: 10 mm}
  d: {is: Delay, T: 0.1 s}
  s: {is: PositionSource, u: =d.y}
  m: {is: Mass, m: 2 kg}
nodes: {u: [st.y, d.u], a: [s.a, m.a]}
simulate: {until: 1 s, every: 10 ms}
"""
    with pytest.raises(HeavebondError, match=r"jumps from 0 to 0\.01"):
        hb.simulate(hb.loads(text))


def test_event_of_a_delayed_signal_moves_with_the_delay():
    text = """
model: relay
components:
  s: {is: Sine, a: 1, T: 1 s, phi: 0}
  d: {is: Delay, T: 0.1 s}
  r: {is: Relay, u_on: 0.5, u_off: -0.5, y_on: 1}
nodes: {u: [s.y, d.u], y: [d.y, r.u]}
simulate: {until: 0.5 s, every: 10 ms}
"""
    run = hb.simulate(hb.loads(text), sensitivities=["d.T"])
    at = next(t for t, name in run.events if name == "r.rise")
    assert at == pytest.approx(0.1 + np.arcsin(0.5) / (2 * np.pi), abs=1e-9)
    assert run.event_sensitivity("r.rise", 0, "d.T") == pytest.approx(1, abs=1e-6)


def test_parameters_may_make_a_delay_zero():
    delayed, direct = hb.loads(LOOP.format(T=0.5, until=1, k=1)), hb.loads(LOOP.format(T=0, until=1, k=1))
    run = hb.simulate(delayed, parameters={"d.T": 0.0})
    assert np.abs(run["i.y"] - np.exp(-run.time)).max() < 1e-6
    run = hb.simulate(direct, parameters={"d.T": 0.5})
    assert np.abs(run["i.y"] - by_steps(run.time, 0.5)).max() < 1e-6
    with pytest.raises(HeavebondError, match="a delay of zero can only grow"):
        hb.simulate(direct, sensitivities=["d.T"])


def test_start_of_a_delayed_loop_leaves_states_where_they_are():
    """The history follows the states: a lag with its own initial value, an integrator without one, and a steady start."""
    text = """
model: starts
components:
  lag: {is: FirstOrderLag, T_1: 0.3 s, u: "=3 - 0.5*d.y"}
  d: {is: Delay, T: 0.5 s, u: "=lag.y"}
  i: {is: Integrator, k: 1 1/s, u: "=1 - e.y"}
  e: {is: Delay, T: 0.2 s, u: "=i.y"}
simulate: {until: 0.1 s, every: 0.1 s}
"""
    run = hb.simulate(hb.loads(text))
    assert run["lag.y"] == pytest.approx([2, 2], abs=1e-9)  # y = 3 - 0.5 y
    assert run["i.y"] == pytest.approx([0, 0.1], abs=1e-8)  # from its default 0
    run = hb.simulate(hb.loads(text + "initial: {start: steady}\n"))
    assert run["i.y"] == pytest.approx([1, 1], abs=1e-8)


# a Gauss pulse of a thousandth of the run behind a delay: no state follows it before the delay is over
PULSE = """
model: delayed_pulse
parameters: {w: 50 ms}
components:
  d: {is: Delay, T: 7 s, u: "=exp(-((time - 18.123 s)/w)**2)"}
  i: {is: Integrator, k: 1 1/s, u: =d.y}
simulate: {until: 40 s}
"""


def test_short_pulse_behind_a_delay_keeps_its_area_and_its_values():
    run = hb.simulate(hb.loads(PULSE), sensitivities=["w"])
    # rtol is 1e-8; before the samples of the delay followed the pulse, its area erred by 5e-4 and its values by 2e-4
    assert run["i.y"][-1] == pytest.approx(0.05 * np.sqrt(np.pi), rel=1e-6)
    assert run.sensitivity("i.y", "w")[-1] == pytest.approx(np.sqrt(np.pi), rel=1e-4)
    np.testing.assert_allclose(run["d.y"], np.exp(-((run.time - 25.123) / 0.05)**2), atol=1e-7)


def test_jumps_of_a_delayed_signal_far_below_its_usual_size_remain_jumps():
    """A sampled torque of 1e-12 N*m arrives 33 ms later, as rectangles: it is far below the share 1e-10 of 10 kN*m."""
    run = hb.simulate(hb.loads("""
model: sampled
components:
  m: {is: Inertia, J: 1e-12 kg*m**2}
  h: {is: SampleHold, T_s: 20 ms, u: "=8e-12 N*m*sin(5*time/(1 s))"}
  d: {is: Delay, T: 33 ms, u: =h.y}
  p: {is: TorqueSource, u: =d.y}
nodes: {b: [m.a, p.a]}
initial: {b.phi: 0 rad, b.w: 0 rad/s}
simulate: {until: 1.5 s, every: 10 ms}
"""))
    samples = 0.02 * np.arange(75)
    passed = np.clip(run.time[:, None] - samples - 0.033, 0, 0.02)
    assert run.si["b.w"] == pytest.approx(passed @ (8 * np.sin(5 * samples)), abs=1e-9)  # pieces between exact instants
    assert run.verdict.status == "clean"


def test_a_delayed_relay_switches_alike_at_the_time_of_a_clock():
    """The history counts from the begin of the run: only instants are rounded, to 2.4e-7 s at 1.4e9 s."""
    text = """
model: late
components:
  l: {is: FirstOrderLag, T_1: 0.1 s, u: =q.y}
  d: {is: Delay, T: 50 ms, u: =l.y}
  k: {is: Relay, u_on: 0.5, u_off: 0.3, y_on: 0, y_off: 1, u: =d.y}
  q: {is: Delay, T: 20 ms, u: =k.y}
simulate: {from: BEGIN s, until: END s, every: 5 ms}
"""
    early, late = (hb.simulate(hb.loads(text.replace("BEGIN", str(t)).replace("END", str(t + 1))))
                   for t in (0, 1_400_000_000))
    times = [[t - run.time[0] for t, _ in run.events] for run in (early, late)]
    assert len(times[0]) == len(times[1]) == 7
    assert times[1] == pytest.approx(times[0], abs=4 * 2.4e-7)  # several instants follow from each other
