"""Sampled blocks, logic with memory and noise beside the difference equations and timing diagrams of their sources."""

from __future__ import annotations

import numpy as np
from library_check import Array, agree, checks, part, run
from scipy.signal import dlsim, lfilter
from test_examples_signals import gaussian, wichmann_hill

T, T_0 = 0.1, 0.03      # sampling period and first sample
SAMPLED = """\
model: sampled
components:
  late:   {is: UnitDelay, T_s: 0.1 s, t_0: 30 ms, u: "=2 V*sin(2*pi*time/1.7 s + 0.4)"}
  line:   {is: FirstOrderHold, T_s: 0.1 s, t_0: 30 ms, u: "=2 V*sin(2*pi*time/1.7 s + 0.4)"}
  lag:    {is: DiscreteLowPass, T_1: 0.3 s, T_s: 0.1 s, t_0: 30 ms, u: "=2 V*sin(2*pi*time/1.7 s + 0.4)"}
  mean:   {is: MovingAverage, n: 4, T_s: 0.1 s, t_0: 30 ms, u: "=2 V*sin(2*pi*time/1.7 s + 0.4)"}
  filter: {is: DiscreteTransferFunction, b: [0.5, 1, -0.3, 0.2], a: [2, -1, 0.6, -0.1], T_s: 0.1 s, t_0: 30 ms,
           u: "=2 V*sin(2*pi*time/1.7 s + 0.4)"}
  system: {is: DiscreteStateSpace, A: [[0.8, 0.2], [-0.3, 0.7]], B: [[1, 0.5], [0, 2]], C: [[1, -1]], D: [[0.3, 0]],
           T_s: 0.1 s, t_0: 30 ms, u: ["=2*sin(2*pi*time/1.7 s + 0.4)", "=time/1 s"]}
  adc:    {is: AnalogDigitalConverter, bits: 3, u_min: -1 V, u_max: 1.5 V, T_s: 0.1 s, t_0: 30 ms,
           u: "=2 V*sin(2*pi*time/1.7 s + 0.4)"}
  gated:  {is: EnabledSampleHold, T_s: 0.1 s, t_0: 30 ms, u: "=2 V*sin(2*pi*time/1.7 s + 0.4)",
           e: "=cos(2*pi*time/1.1 s)"}
  hand:   {is: AngleSource, u: "=5 rad*sin(2*pi*time/1.7 s + 0.4)"}
  counts: {is: Encoder, N: 40, T_s: 0.1 s, t_0: 30 ms}
nodes: {shaft: [hand.a, counts.a], read: [counts.y], out: [system.y]}
simulate: {until: 3 s, every: 13.7 ms}
"""


def held(values: Array, t: Array) -> Array:
    """Values at the samples as the output has them at the times t; zero before the first sample."""
    return np.concatenate(([0.0], values))[np.floor((t - T_0)/T + 1e-9).astype(int) + 1]


@checks("UnitDelay", "FirstOrderHold", "DiscreteLowPass", "MovingAverage", "DiscreteTransferFunction", "DiscreteStateSpace",
        "AnalogDigitalConverter", "EnabledSampleHold", "Encoder")
def test_sampled_blocks_follow_their_difference_equations() -> None:
    """Astrom, Wittenmark: z**-1, the first-order hold, zero-order-hold sampling of a lag, filters, rounding to levels."""
    found = run(SAMPLED)
    t = found.time
    at = T_0 + T*np.arange(31)
    wave = np.sin(2*np.pi*at/1.7 + 0.4)
    u = 2*wave
    slope = np.concatenate(([0.0], np.diff(u)/T))
    pole = np.exp(-T/0.3)
    levels = np.linspace(-1, 1.5, 8)
    edges = 2*np.pi/40*np.arange(-40, 41)
    open_ = np.cos(2*np.pi*at/1.1) > 0.5
    kept = np.maximum.accumulate(np.where(open_, np.arange(31), -1))
    _, out, _ = dlsim(([[0.8, 0.2], [-0.3, 0.7]], [[1, 0.5], [0, 2]], [[1, -1]], [[0.3, 0]], T), np.column_stack((u, at)))
    expected = {
        "late.y": held(np.concatenate(([0.0], u[:-1])), t),
        "line.y": held(u, t) + held(slope, t)*(t - held(at, t)),
        # from the first sample on at rest there
        "lag.y": held(lfilter([1 - pole], [1, -pole], u, zi=[pole*u[0]])[0], t),
        "mean.y": held(np.convolve(u, np.ones(4))[:31]/np.minimum(np.arange(31) + 1, 4), t),
        "filter.y": held(lfilter([0.5, 1, -0.3, 0.2], [2, -1, 0.6, -0.1], u), t),
        "out[1]": held(out[:, 0], t),
        # the first level before the first sample
        "adc.y": np.where(t < T_0, -1, held(levels[np.abs(levels - u[:, None]).argmin(axis=1)], t)),
        "gated.y": held(np.where(kept < 0, 0, u[kept]), t),
        "counts.y": held(edges[np.searchsorted(edges, 5*wave, side="right") - 1], t)}
    for name, values in expected.items():
        agree(found[name], values, size=1.0)
    agree(part("Encoder", N=40, T_s="0.1 s")({"k": 7.0})["a.tau"], 0, size=1.0)


def controller(r: Array, u: Array, b: float, c: float, manual: Array) -> Array:
    """K_p 2, K_i 8, K_d 0.4, T_f 0.1 s, T_t 0.5 s, limits -1.5 and 3; where `manual` is a number, it is the command and the
    integral is what makes the automatic command equal to it (Astrom, Wittenmark, listing 8.1)."""
    command, integral, derivative, before = [], 0.0, 0.0, c*r[0] - u[0]
    for r_k, u_k, m in zip(r, u, manual, strict=True):
        proportional = 2*(b*r_k - u_k)
        derivative = 0.5*derivative + 0.4/0.2*(c*r_k - u_k - before)
        before = c*r_k - u_k
        wanted = proportional + integral + derivative if np.isnan(m) else m
        command.append(min(max(wanted, -1.5), 3.0))
        if np.isnan(m):
            integral += 8*T*(r_k - u_k) + T/0.5*(command[-1] - wanted)
        else:
            integral = command[-1] - proportional - derivative
    return np.array(command)


@checks("DiscretePID", "DiscreteSwitchablePID")
def test_sampled_controllers_follow_their_program() -> None:
    given = "K_p: 2, K_i: 8 1/s, K_d: 0.4 s, T_f: 0.1 s, b: 0.7, c: 0.2, y_min: -1.5 V, y_max: 3 V, T_t: 0.5 s, " \
        'T_s: 0.1 s, t_0: 30 ms, r: "=1 V*cos(2*pi*time/2.3 s)", u: "=0.8 V*sin(2*pi*time/1.7 s + 0.4)"'
    found = run(f"""\
model: controllers
components:
  plain: {{is: DiscretePID, {given}}}
  switchable: {{is: DiscreteSwitchablePID, {given}, m: "=4 V*sin(2*pi*time/3 s)", a: "=cos(2*pi*time/1.9 s)"}}
simulate: {{until: 3 s, every: 13.7 ms}}
""")
    at = T_0 + T*np.arange(31)
    r, u = np.cos(2*np.pi*at/2.3), 0.8*np.sin(2*np.pi*at/1.7 + 0.4)
    plain = controller(r, u, 0.7, 0.2, np.full(31, np.nan))
    assert plain.min() == -1.5 and plain.max() == 3
    agree(found["plain.y"], held(plain, found.time), size=1.0)
    manual = np.where(np.cos(2*np.pi*at/1.9) > 0.5, np.nan, 4*np.sin(2*np.pi*at/3))
    agree(found["switchable.y"], held(controller(r, u, 0.7, 0.2, manual), found.time), size=1.0)


@checks("EdgeDetector", "OnDelay", "Timer", "FlipFlop", "Counter", "TriggeredSampleHold")
def test_logic_with_memory_by_its_timing_diagram() -> None:
    """A sine of period P is above 0.5 from P/12 to 5 P/12 (IEC 61131-3: R_TRIG, TON, RS, CTU)."""
    found = run("""\
model: logic
components:
  edge:    {is: EdgeDetector, T: 0.4 s, u: "=sin(2*pi*time/1 s)"}
  delay:   {is: OnDelay, T: 0.2 s, u: "=sin(2*pi*time/1 s)"}
  timer:   {is: Timer, u: "=sin(2*pi*time/1 s)"}
  latch:   {is: FlipFlop, s: "=sin(2*pi*time/1 s)", r: "=sin(2*pi*time/0.73 s)"}
  counter: {is: Counter, u: "=sin(2*pi*time/0.3 s)", r: "=sin(2*pi*time/2.3 s)"}
  hold:    {is: TriggeredSampleHold, u: "=3 V/s*time", e: "=sin(2*pi*time/1 s)"}
simulate: {until: 4 s, every: 13.7 ms}
""")
    t = found.time
    since = np.where(t > 1/12, np.mod(t - 1/12, 1), np.inf)     # time since the last rise
    on = since < 1/3
    stop = np.sin(2*np.pi*t/0.73) > 0.5
    latched = [0.0]
    for k in range(1, len(t)):
        latched.append(0.0 if stop[k] else 1.0 if on[k] else latched[-1])
    rises = 0.3*(1/12 + np.arange(14))
    resets = np.array([-1.0, 2.3/12, 2.3*13/12])
    last = resets[np.searchsorted(resets, t) - 1]
    expected = {
        "edge.y": since < 0.4, "delay.y": on & (since > 0.2), "timer.y": np.where(on, since, 0.0), "latch.y": latched,
        "counter.y": np.searchsorted(rises, t) - np.searchsorted(rises, last),
        "hold.y": np.where(np.isfinite(since), 3*(t - np.where(np.isfinite(since), since, t)), 0.0)}
    for name, values in expected.items():
        # the instants of events are exact to 1e-9 s
        agree(found[name], np.asarray(values, float), rtol=1e-7, size=1.0)
    assert 0 < np.mean(latched) < 1 and found["counter.y"].max() > 5


@checks("WhiteNoise", "RandomWalk", "LossySampleHold")
def test_noise_walks_and_losses_are_those_of_the_generator() -> None:
    """Wichmann and Hill's numbers; Box and Muller's transformation; a walk is the sum of its steps."""
    found = run("""\
model: noise
components:
  white: {is: WhiteNoise, sigma: 2 V, T_s: 0.1 s, t_0: 30 ms, seed: 5}
  walk:  {is: RandomWalk, sigma: 2 V, T: 0.4 s, T_s: 0.1 s, t_0: 30 ms, seed: 5}
  lossy: {is: LossySampleHold, p: 0.3, T_s: 0.1 s, t_0: 30 ms, seed: 5, u: "=3 V/s*time"}
simulate: {until: 5 s, every: 13.7 ms}
""")
    t, n = found.time, 51
    steps = 2*gaussian(5, n)
    agree(found["white.y"], held(steps, t), size=1.0)
    agree(found["walk.y"], held(np.cumsum(steps)*np.sqrt(0.1/0.4), t), size=1.0)
    lost = wichmann_hill(5, n)[0] < 0.3
    assert 5 < lost.sum() < 25
    kept = np.maximum.accumulate(np.where(lost, -1, np.arange(n)))
    agree(found["lossy.y"], held(np.where(kept < 0, 0, 3*(T_0 + T*kept)), t), size=1.0)
