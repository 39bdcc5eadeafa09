"""Some 330 relations between runs of bundled machines, and between two descriptions of one law.

`python -m benchmarks.fuzz.relations` tries all bundled machines and random circuits.
"""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest

import heavebond as hb
from benchmarks.fuzz.laws import compared, laws
from benchmarks.fuzz.metamorphic import DIFFERENCES
from benchmarks.fuzz.run_relations import Check, checks_of, placed, tried
from heavebond.language.model import loads
from heavebond.linear.linear_system import state_space
from heavebond.numerics.dae import Array

MECHANICAL = ("spring", "damper", "coulomb_friction", "end_stop", "torsion_spring", "lever", "weight", "gas_spring",
              "backlash", "cubic_spring", "clutch")
ELECTRICAL = ("conductance", "dc_motor", "resistor", "capacitor", "inductor", "transformer")
OTHERS = ("receiver", "convection", "orifice", "pid", "first_order_lag", "ramp", "step", "sample_hold")
PAIRS = {law.name: law for law in laws() if "contacts" not in law.name or law.name.endswith(("021", "201"))}
@cache
def checks(machine: str) -> dict[tuple[str, str, str], Check]:
    return {(machine, c.relation, c.variant): c for c in tried(f"examples/{machine}.yaml")}


def agree(*machines: str) -> int:
    """The number of relations that hold."""
    all_checks = {key: check for machine in machines for key, check in checks(machine).items()}
    assert not {key: (c.outcome, c.what) for key, c in all_checks.items() if c.outcome in DIFFERENCES}
    return sum(c.outcome == "same" for c in all_checks.values())


@pytest.mark.long
def test_relations_of_mechanical_machines() -> None:
    assert agree(*MECHANICAL) >= 160


@pytest.mark.long
def test_relations_of_electrical_machines() -> None:
    assert agree(*ELECTRICAL) >= 80


@pytest.mark.long
def test_relations_of_hydraulic_thermal_and_signal_machines() -> None:
    assert agree(*OTHERS) >= 95


@pytest.mark.long
def test_relations_of_machines_whose_loops_have_gradients_of_many_powers_of_ten() -> None:
    """In other units of time residuals of these loops have gradients of 1e-18 to 1e21 per size of an unknown."""
    assert agree("mi_field", "dry_friction", "rotational_dry_friction", "rigid_link", "oil_leakage") >= 30


@pytest.mark.long
def test_one_law_in_two_descriptions_gives_the_same_run() -> None:
    found = [compared(law) for law in PAIRS.values()]
    assert not [(c.relation, c.outcome, c.what) for c in found if c.outcome != "same"]
    assert len(found) >= 40


LOOP = """
model: loop
components:
  gain: {is: Gain, k: K, u: "=0.1*if_else(time < 0.1 s, 0, 1) - third.y"}
  first: {is: FirstOrderLag, T_1: 0.1 s}
  second: {is: FirstOrderLag, T_1: 0.1 s}
  third: {is: FirstOrderLag, T_1: 0.1 s}
nodes: {a: [gain.y, first.u], b: [first.y, second.u], c: [second.y, third.u]}
simulate: {until: 20 s, every: 5 ms}
"""


def test_a_run_beyond_the_gain_margin_grows_and_one_within_it_decays_with_the_mode() -> None:
    """Three lags T = 0.1 s: the critical gain is 8 at sqrt(3)/T; the decay between two extremes is that of the mode."""
    margin = hb.loop_margins(loads(LOOP.replace("K", "4")), "third.y").least_gain
    assert margin is not None and margin.value == pytest.approx(2, rel=1e-9)
    assert 2 * np.pi * margin.frequency == pytest.approx(np.sqrt(3) / 0.1, rel=1e-9)
    for factor in (0.97, 1.03):
        text = LOOP.replace("K", repr(4 * margin.value * factor))
        run, mode = hb.simulate(loads(text)), state_space(loads(text), ["gain.u"], ["third.y"]).poles
        swing = max(mode, key=lambda s: s.real)
        y = run["third.y"][run.time > 5] - 0.1 * 4 * 2 * factor / (1 + 4 * 2 * factor)  # less the final value K/(1 + K)
        halves = [np.abs(part).max() for part in np.split(y[: len(y) // 2 * 2], 2)]
        assert (halves[1] < halves[0]) == (factor < 1)
        # between the maxima of both halves, 7.5 s apart but for a part of a swing of 0.36 s
        assert np.log(halves[1] / halves[0]) / 7.5 == pytest.approx(swing.real, rel=0.06)


def test_a_run_that_breaks_a_relation_is_seen() -> None:
    """The comparison itself: a friction of 12 N differs from two of 6.01 N, and a machine at rest shows nothing."""
    from dataclasses import replace

    law = PAIRS["two halves of CoulombFriction"]
    assert compared(replace(law, second=law.second.replace("6.0 N", "6.01 N"))).outcome == "different"
    still = PAIRS["step and condition"]
    still = replace(still, first=still.first.replace("after: 2", "after: 0"), second=still.second.replace("0, 2)", "0, 0)"))
    assert compared(still).outcome == "different"
    with placed("seed 2") as path:
        assert len(checks_of(path, "seed 2", {"output grid": (7,), "renamed": ()})) in (1, 2)


# diagrams with a gain K and a disturbance, each with a signal in its loop, a gain, the length of a run in s, and the input
# that the disturbance moves with the size of its step in SI
LOOPS = {
    "two lags and an integrator": ("""
  sum: {is: Sum, k_1: -1, k_2: 1, u_2: "=1e-3*if_else(time < 0.1 s, 0, 1)"}
  gain: {is: Gain, k: K}
  a: {is: FirstOrderLag, T_1: 0.1 s}
  b: {is: FirstOrderLag, T_1: 0.2 s}
  c: {is: Integrator, k: 1 1/s}
nodes: {e: [sum.y, gain.u], g: [gain.y, a.u], a: [a.y, b.u], b: [b.y, c.u], y: [c.y, sum.u_1]}
""", "c.y", 5.0, 12.0, "sum.u_2", 1e-3),
    "transfer function with a right zero": ("""
  sum: {is: Sum, k_1: -1, k_2: 1, u_2: "=1e-3*if_else(time < 0.1 s, 0, 1)"}
  gain: {is: Gain, k: K}
  plant: {is: TransferFunction, b: [0, -0.5, 1], a: [1, 1, 2]}
nodes: {e: [sum.y, gain.u], g: [gain.y, plant.u], y: [plant.y, sum.u_1]}
""", "plant.y", 0.5, 40.0, "sum.u_2", 1e-3),
    "body on a spring under integral control": ("""
  frame: {is: Fixed}
  spring: {is: SpringDamper, c: 200 N/m, d: 4 N*s/m}
  load: {is: Mass, m: 2 kg}
  push: {is: ForceSource, u: "=1 N*integral.y - 0.1 N*if_else(time < 0.1 s, 0, 1)"}
  gain: {is: Gain, k: K}
  integral: {is: Integrator, k: 1 1/s}
  error: {is: Gain, k: -1, u: "=load.x/(1 m)"}
nodes: {frame: [frame.a, spring.a], load: [spring.b, load.a, push.a], e: [error.y, gain.u], g: [gain.y, integral.u]}
""", "error.y", 200.0, 40.0, "push.u", -0.1),
    "speed of a drive with a torsion spring": ("""
  drive: {is: TorqueSource, u: "=1 N*m*lag.y + 0.01 N*m*if_else(time < 0.1 s, 0, 1)"}
  rotor: {is: Inertia, J: 0.02 kg*m**2}
  bearing: {is: RotationalDamper, d: 0.05 N*m*s/rad}
  frame: {is: FixedShaft}
  shaft: {is: TorsionSpringDamper, c: 40 N*m/rad, d: 0.02 N*m*s/rad}
  load: {is: Inertia, J: 0.05 kg*m**2}
  lag: {is: FirstOrderLag, T_1: 20 ms}
  gain: {is: Gain, k: K, u: "=-load.w/(1 rad/s)"}
nodes: {motor: [drive.a, rotor.a, bearing.a, shaft.a], frame: [frame.a, bearing.b], load: [shaft.b, load.a],
        g: [gain.y, lag.u]}
""", "gain.y", 0.02, 8.0, "drive.u", 0.01),
    "level of three tanks in a row": ("""
  source: {is: FlowSource, u: "=1 L/min*gain.y + 1 L/min + 0.001 L/min*if_else(time < 1 s, 0, 1)"}
  first: {is: Volume, V: 1 L, beta: 1 MPa}
  one: {is: LaminarLeakage, C: 1e-10 m**3/(s*Pa)}
  second: {is: Volume, V: 2 L, beta: 1 MPa}
  two: {is: LaminarLeakage, C: 1e-10 m**3/(s*Pa)}
  third: {is: Volume, V: 1 L, beta: 1 MPa}
  three: {is: LaminarLeakage, C: 1e-10 m**3/(s*Pa)}
  tank: {is: Tank}
  gain: {is: Gain, k: K, u: "=1 - third.p/(1.666666666666667 bar)"}
nodes: {first: [source.a, first.a, one.a], second: [one.b, second.a, two.a], third: [two.b, third.a, three.a],
        tank: [three.b, tank.a]}
initial: {start: steady}
""", "gain.y", 2.0, 600.0, "source.u", 0.001 / 6e4),
}


def growth(time: Array, y: Array) -> tuple[float, float]:
    """Rate of growth (1/s) and angular frequency (rad/s) of an oscillation about its mean, over the second half of a run: by
    its local extremes, each at the top of the parabola through three points."""
    inner = np.flatnonzero((np.diff(y)[:-1] * np.diff(y)[1:] < 0) & (time[1:-1] > time[-1] / 2)) + 1
    bend, slope = y[inner + 1] - 2 * y[inner] + y[inner - 1], (y[inner + 1] - y[inner - 1]) / 2
    at, top = time[inner] - slope / bend * (time[1] - time[0]), y[inner] - slope**2 / bend / 2
    swings = np.abs(np.diff(top))  # from one extreme to the next, whatever the mean
    middle = (at[1:] + at[:-1]) / 2
    return float(np.polyfit(middle, np.log(swings), 1)[0]), float(np.pi / np.mean(np.diff(at)))


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_decays_below_its_gain_margin_and_grows_above_it_with_its_mode(name: str) -> None:
    parts, signal, gain, until, *_ = LOOPS[name]
    text = f"model: loop\ncomponents:{parts}simulate: {{until: {until!r} s, every: {until / 8000!r} s}}\n"
    margin = hb.loop_margins(loads(text.replace("K", repr(gain))), signal).least_gain
    assert margin is not None
    for factor in (0.98, 1.02):
        model = loads(text.replace("K", repr(gain * margin.value * factor)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hb.RunWarning)  # what grows
            run = hb.simulate(model)
        rate, omega = growth(run.time, run[signal])
        modes = [m for m in state_space(model, [], [signal]).poles if m.imag > 0]
        slowest = max(modes, key=lambda s: s.real)
        assert (rate > 0) == (factor > 1)
        # other modes have decayed; the parabola through three points errs by (omega h)**2/20
        assert (rate, omega) == (pytest.approx(slowest.real, rel=0.02, abs=1e-4 * omega),
                                 pytest.approx(slowest.imag, rel=2e-3))
        assert omega == pytest.approx(2 * np.pi * margin.frequency, rel=0.03)  # of the loop at its limit


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_settles_at_the_gain_at_zero_frequency(name: str) -> None:
    parts, signal, gain, until, moved, step = LOOPS[name]
    margin = hb.loop_margins(loads(f"model: loop\ncomponents:{parts}".replace("K", repr(gain))), signal).least_gain
    assert margin is not None
    text = f"model: loop\ncomponents:{parts}simulate: {{until: {2 * until!r} s}}\n"
    text = text.replace("K", repr(0.3 * gain * margin.value))
    run, system = hb.simulate(loads(text)), state_space(loads(text), [moved], [signal])
    expected = float(system.dc_gain()[0, 0]) * step
    slowest = max(s.real for s in system.poles if abs(s) > 1e-6)  # an angle that nothing feels is an integrator
    # what the slowest mode leaves at the end, and the tolerance of the run
    allowed = 20 * np.exp(2 * until * slowest) * np.ptp(run[signal]) + 1e-5 * np.ptp(run[signal])
    assert run[signal][-1] - run[signal][0] == pytest.approx(expected, abs=allowed) and allowed < 0.01 * np.ptp(run[signal])
