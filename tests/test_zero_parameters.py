"""Parameters of value 0 that take a derivative out of the equations: fewer states or another index, no error."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import heavebond as hb
from heavebond.core.errors import StartError, UsageError
from heavebond.core.quantities import ranges
from heavebond.linear.operating_point import OperatingPoints
from heavebond.numerics.dae import assemble, at_zero
from heavebond.numerics.simulator import Simulator

BODY = """
model: body
components:
  wall: {is: Fixed}
  spring: {is: Spring, c: 100 N/m}
  damper: {is: Damper, d: 10 N*s/m}
  mass: {is: Mass, m: 0 kg}
  push: {is: ForceSource, u: 1 N}
nodes: {wall: [wall.a, spring.a, damper.a], body: [spring.b, damper.b, mass.a, push.a]}
initial: {body.x: 0 m}
simulate: {until: 0.5 s, every: 10 ms}
"""
LAG = """
model: lag
components: {f: {is: FirstOrderLag, T_1: 0 s, u: "=sin(10*time/(1 s))"}}
simulate: {until: 1 s, every: 10 ms}
"""
CHARGED = """
model: charged
components:
  supply: {is: VoltageSource, u: "=5 V*sin(10*time/(1 s))"}
  wire: {is: Resistor, R: 0 ohm}
  store: {is: Capacitor, C: 2 mF}
  ground: {is: ElectricalGround}
nodes: {plus: [supply.a, wire.a], top: [wire.b, store.a], minus: [supply.b, store.b, ground.a]}
simulate: {until: 1 s, every: 10 ms}
"""
DIVIDED = """
model: divided
components:
  pump: {is: PressureSource, p_0: 100 bar}
  first: {is: LaminarLeakage, C: 1e-10 m**3/(s*Pa)}
  between: {is: Volume, V: 0 L, beta: 1 GPa}
  second: {is: LaminarLeakage, C: 3e-10 m**3/(s*Pa)}
  tank: {is: Tank}
nodes: {supply: [pump.a, first.a], middle: [first.b, between.a, second.a], tank: [second.b, tank.a]}
simulate: {until: 1 s, every: 10 ms}
"""
SMALL = 1e-7  # errors of the integrator at rtol 1e-8


def test_a_body_without_mass_follows_its_spring_and_damper() -> None:
    """A lag of d/c = 0.1 s: x = F/c (1 - exp(-t c/d))."""
    found = hb.simulate(hb.loads(BODY))
    assert found.assembly.state_names == ["body.x"] and found.verdict.status == "clean"
    assert found["body.x"] == pytest.approx(0.01 * (1 - np.exp(-10 * found.time)), abs=SMALL)
    light = hb.simulate(hb.loads(BODY), parameters={"mass.m": 1e-6})
    assert found["body.x"] == pytest.approx(light["body.x"], abs=1e-6)  # the motion of 1 mg differs for m/d = 0.1 us


COMPLIANT = """
model: compliant
components:
  pump: {is: FlowSource, u: 6 L/min}
  gas: {is: GasCompliance, C: 0 L/bar, kappa: 0.1 1/bar}
  oil: {is: Volume, V: 1 L, beta: 1 GPa}
nodes: {line: [pump.a, gas.a, oil.a]}
simulate: {until: 10 ms, every: 1 ms}
"""


def test_a_variable_that_follows_from_a_parameter_of_zero_is_zero_in_all_equations() -> None:
    """The compliance c = C y**(-1 - 1/n) of the gas is 0: the pressure is that of the oil, q beta/V t."""
    found = hb.simulate(hb.loads(COMPLIANT))
    assert found["line.p"] == pytest.approx(1e-4 * 1e12 * found.time, rel=1e-9, abs=1e-3)


@pytest.mark.parametrize("solver", ["auto", "idas", "cvodes"])
def test_a_lag_of_zero_passes_its_input(solver: str) -> None:
    found = hb.simulate(hb.loads(LAG), solver=solver)
    assert found["f.y"] == pytest.approx(np.sin(10 * found.time), abs=1e-12)


def test_a_resistor_of_zero_before_a_capacitor_passes_its_voltage_and_current() -> None:
    """The index is 2: i = C du/dt."""
    found = hb.simulate(hb.loads(CHARGED))
    assert found["top.v"] == pytest.approx(5 * np.sin(10 * found.time), abs=1e-9)
    assert found["store.i"] == pytest.approx(2e-3 * 50 * np.cos(10 * found.time), abs=1e-9)


def test_a_volume_of_zero_passes_the_flow() -> None:
    found = hb.simulate(hb.loads(DIVIDED))
    assert found["middle.p"] == pytest.approx(25e5, rel=1e-9)  # 1 : 3
    assert found["second.q"] == pytest.approx(7.5e-4, rel=1e-9)


def test_the_energy_of_a_machine_with_a_massless_body_balances() -> None:
    found = hb.energy(hb.loads(BODY))
    work = 0.01 * (1 - np.exp(-5))  # F x at the end
    assert found.supplied == pytest.approx(work, rel=1e-6)
    assert found.closes() and {line.component: line for line in found.lines}["mass"].end == 0


def test_the_pole_of_a_machine_with_a_massless_body() -> None:
    assert hb.state_space(hb.loads(BODY), ["push.u"], ["body.x"]).poles == pytest.approx(-10, rel=1e-9)


def test_a_value_of_zero_from_python_gives_the_same_as_in_the_file() -> None:
    heavy = BODY.replace("m: 0 kg", "m: 3 kg")
    expected = hb.simulate(hb.loads(BODY))["body.x"]
    assert np.array_equal(hb.simulate(hb.loads(heavy), parameters={"mass.m": 0.0})["body.x"], expected)
    assert np.array_equal(hb.simulate(hb.loads(heavy).with_parameters({"mass.m": 0.0}))["body.x"], expected)
    assert np.array_equal(hb.simulate(assemble(hb.loads(heavy)).with_parameters({"mass.m": "0 g"}))["body.x"], expected)


def test_another_value_than_zero_brings_the_state_back() -> None:
    zeroed = at_zero(assemble(hb.loads(BODY)))
    assert zeroed.flat.zeros == ("mass.m",) and len(zeroed.state_names) == 1
    heavy = zeroed.with_parameters({"mass.m": 3.0})
    assert not heavy.flat.zeros and len(heavy.state_names) == 2
    expected = hb.simulate(hb.loads(BODY.replace("m: 0 kg", "m: 3 kg")))["body.x"]
    assert Simulator(zeroed).run({"mass.m": 3.0})["body.x"] == pytest.approx(expected, abs=SMALL)
    assert hb.simulate(zeroed, parameters={"spring.c": 50.0})["body.x"][-1] == pytest.approx(
        0.02 * (1 - np.exp(-2.5)), abs=SMALL)


def test_sensitivities_of_a_massless_body_are_those_by_its_other_parameters() -> None:
    found = hb.simulate(hb.loads(BODY), sensitivities=["spring.c"])
    c, d, t = 100, 10, found.time
    exact = -(1 - np.exp(-c * t / d)) / c**2 + t / (c * d) * np.exp(-c * t / d)
    assert found.sensitivity("body.x", "spring.c") == pytest.approx(exact, abs=SMALL * 1e-2)
    with pytest.raises(StartError, match=r"mass\.m is 0"):  # it would have another state
        hb.simulate(hb.loads(BODY), sensitivities=["mass.m"])


def test_an_initial_speed_of_a_massless_body_contradicts_its_forces() -> None:
    with pytest.raises(StartError, match="start-contradiction"):
        hb.simulate(hb.loads(BODY.replace("body.x: 0 m}", "body.x: 0 m, body.v: 1 m/s}")))


def test_a_zero_without_which_nothing_is_determined_is_named() -> None:
    alone = BODY.replace("  spring: {is: Spring, c: 100 N/m}\n  damper: {is: Damper, d: 10 N*s/m}\n", "").replace(
        "wall: [wall.a, spring.a, damper.a], body: [spring.b, damper.b, mass.a, push.a]",
        "wall: [wall.a], body: [mass.a, push.a]")
    with pytest.raises(StartError, match=r"mass\.m is 0"):
        hb.simulate(hb.loads(alone))


def test_a_run_at_zero_is_pickled_with_its_equations() -> None:
    found = hb.simulate(hb.loads(BODY))
    again = pickle.loads(pickle.dumps(found))
    assert again.assembly.flat.zeros == ("mass.m",) and np.array_equal(again["damper.F"], found["damper.F"])


def test_an_operating_point_at_zero_refuses_another_value() -> None:
    points = OperatingPoints(hb.loads(BODY))
    assert len(points.at({"spring.c": 50.0}).x) == 1
    with pytest.raises(UsageError, match=r"mass\.m = 0 in the diagram"):
        points.at({"mass.m": 1.0})


def test_tuning_beside_a_parameter_of_zero() -> None:
    """The speed of a massless body after t = 50 ms is F/d exp(-t c/d): least at the largest d of the range."""
    task = hb.TuningProblem(ranges({"damper.d": "8 .. 20 N*s/m"}), "final(body.v)", end=0.05)
    found = hb.tune(hb.loads(BODY), task, explore=0)
    assert found.values["damper.d"] == pytest.approx(20, rel=1e-6)
    assert found.cost == pytest.approx(1 / 20 * np.exp(-0.05 * 100 / 20), rel=1e-5)
