"""Filters start at their input: a constant input gives a constant output, and no derivative kick."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_co_simulation_fmu import fmpy
from test_export import compiled

import heavebond as hb
from heavebond.exchange.fmu_export import export_fmu
from heavebond.numerics.result import Result

SMALL = 1e-7  # errors of the integrator at rtol 1e-8
RUN = "simulate: {until: 0.5 s, every: 1 ms}\n"
BLOCKS = {
    "FirstOrderLag": "T_1: 20 ms", "SecondOrderLag": "f_n: 5 Hz, zeta: 0.4", "LeadLag": "T_1: 0.1 s, T_2: 10 ms",
    "NotchFilter": "f_n: 5 Hz", "Delay": "T: 0.1 s", "DelayChain": "T: 0.1 s", "RateLimit": "r_max: 3 1/s"}


def run(text: str, **options: object) -> Result:
    return hb.simulate(hb.loads(text + RUN), **options)  # type: ignore[arg-type]


def test_a_controller_has_no_derivative_kick_from_a_constant_error() -> None:
    found = run("""
model: pid_kick
components:
  p: {is: PID, K_p: 1, K_d: 1 s, K_i: 0.1 1/s, T_f: 10 ms, y_min: -1000, y_max: 1000, r: 3, u: 2}
  s: {is: SwitchablePID, K_p: 1, K_d: 1 s, K_i: 0.1 1/s, T_f: 10 ms, y_min: -1000, y_max: 1000, r: 3, u: 2, m: 0, a: 1}
""", sensitivities=["p.K_d"])
    for controller in "ps":
        assert found[f"{controller}.y"] == pytest.approx(1 + 0.1 * found.time, abs=SMALL)
    assert np.abs(found.sensitivity("p.y", "p.K_d")).max() < SMALL  # the derivative part is 0


def test_a_derivative_begins_at_zero_and_approaches_the_slope() -> None:
    found = run("""
model: slope
components:
  c: {is: FilteredDerivative, T_f: 10 ms, u: 5}
  r: {is: FilteredDerivative, T_f: 10 ms, u: "=3 + 2 1/s*time"}
""")
    assert np.abs(found["c.y"]).max() < SMALL
    assert found["r.y"] == pytest.approx(2 * (1 - np.exp(-found.time / 0.01)), abs=100 * SMALL)  # 1/T_f


@pytest.mark.parametrize("block", BLOCKS)
def test_a_constant_passes_a_filter_unchanged(block: str) -> None:
    found = run(f"model: constant\ncomponents:\n  f: {{is: {block}, {BLOCKS[block]}, u: 5}}\n")
    assert found["f.y"] == pytest.approx(5, abs=SMALL)


SYSTEMS = {
    "StateSpace": "n: 2, A: [0 1/s, 1 1/s, -4 1/s, -1 1/s], B: [0 1/s, 1 1/s], C: [4, 0], u: 5",
    "LinearSystem": "n: 2, m: 1, r: 1, A: [[0 1/s, 1 1/s], [-4 1/s, -1 1/s]], B: [[0 1/s], [1 1/s]], C: [[4, 0]], u: [5]",
    "StateSpace22": "n: 2, A: [0 1/s, 1 1/s, -4 1/s, -1 1/s], B_1: [0 1/s, 1 1/s], B_2: [0 1/s, 1 1/s], C_1: [4, 0], "
                    "C_2: [4, 0], u_1: 2, u_2: 3"}


@pytest.mark.parametrize("block", SYSTEMS)
def test_a_linear_system_starts_as_the_transfer_function_of_the_same_law(block: str) -> None:
    output = {"StateSpace": "y", "LinearSystem": "y[1]", "StateSpace22": "y_2"}[block]
    text = f"""
model: same_law
components:
  t: {{is: TransferFunction, n: 3, a: [1, 1, 4], b: [0, 0, 4], u: 5}}
  s: {{is: {block}, {SYSTEMS[block]}}}
"""
    steady = run(text)
    assert steady[f"s.{output}"] == pytest.approx(steady["t.y"], abs=SMALL)
    moved = run(text + 'initial: {"t.z[1]": 0.2, "s.x[1]": 0.2}\n')
    assert np.ptp(moved["t.y"]) > 0.1
    assert moved[f"s.{output}"] == pytest.approx(moved["t.y"], abs=SMALL)


def test_a_linear_system_with_an_integrator_starts_at_zero_and_leaves_other_filters_steady() -> None:
    found = run("""
model: integrator
components:
  i: {is: LinearSystem, n: 2, m: 1, r: 1, A: [[0 1/s, 1 1/s], [0 1/s, -1 1/s]], B: [[0 1/s], [1 1/s]], C: [[1, 0]], u: [3]}
  f: {is: FirstOrderLag, T_1: 20 ms, u: 4}
""")
    t = found.time
    assert found["i.y[1]"] == pytest.approx(3 * (t - 1 + np.exp(-t)), abs=SMALL)
    assert found["f.y"] == pytest.approx(4, abs=SMALL)


def test_a_motion_sensor_starts_at_its_position() -> None:
    found = run("""
model: heave
components:
  d: {is: PositionSource, u: "=4 m"}
  s: {is: MotionReferenceUnit, T_1: 0.1 s}
nodes: {a: [d.a, s.a]}
""")
    assert found["s.z"] == pytest.approx(4, abs=SMALL)
    assert np.abs(found["s.v"]).max() < SMALL


def test_filters_in_a_chain_and_in_a_loop_start_in_balance() -> None:
    """y = 4*(r - y) through two lags and a gain of 4: y = 0.8*r, which moves with r."""
    found = run("""
model: loop
components:
  r: {is: Constant, k: 5}
  e: {is: Sum, k_1: 1, k_2: -1}
  g: {is: Gain, k: 4}
  a: {is: FirstOrderLag, T_1: 10 ms}
  b: {is: LeadLag, T_1: 30 ms, T_2: 10 ms}
nodes: {r: [r.y, e.u_1], e: [e.y, g.u], g: [g.y, a.u], a: [a.y, b.u], b: [b.y, e.u_2]}
""", sensitivities=["r.k"])
    assert found["b.y"] == pytest.approx(4, abs=SMALL)
    assert found.sensitivity("b.y", "r.k") == pytest.approx(0.8, abs=SMALL)


def test_an_initial_value_of_the_diagram_comes_first() -> None:
    found = run("""
model: asked
components:
  lag: {is: FirstOrderLag, T_1: 0.1 s, u: 5}
  f: {is: FilteredDerivative, T_f: 0.1 s, u: 5}
  p: {is: PID, K_p: 1, K_d: 1 s, T_f: 0.1 s, y_min: -1000, y_max: 1000, r: 3, u: 2}
initial: {lag.y: 0, f.y: 2 1/s, p.z: 0}
""")
    decay = np.exp(-found.time / 0.1)
    assert found["lag.y"] == pytest.approx(5 * (1 - decay), abs=SMALL)
    assert found["f.y"] == pytest.approx(2 * decay, abs=SMALL)
    assert found["p.y"] == pytest.approx(1 + 10 * decay, abs=100 * SMALL)


def test_a_lag_in_a_loop_without_a_steady_start_keeps_its_declared_start() -> None:
    """The lag of 1 + its own output: y' = 1/T, the positive feedback of an integral part."""
    found = run("""
model: positive
components:
  one: {is: Constant, k: 1}
  s: {is: Sum}
  lag: {is: FirstOrderLag, T_1: 0.1 s}
nodes: {one: [one.y, s.u_1], s: [s.y, lag.u], lag: [lag.y, s.u_2]}
""")
    assert found["lag.y"] == pytest.approx(found.time / 0.1, abs=SMALL)


def test_a_transfer_function_starts_in_the_steady_state_of_its_input() -> None:
    """A washout at 0, a filter at its DC gain as the FirstOrderLag of the same law, an integrator at 0, in a loop too."""
    found = run("""
model: transfer_functions
components:
  washout: {is: TransferFunction, a: [1, 1], b: [1, 0], u: 5}
  second: {is: TransferFunction, a: [2, 6, 4], b: [0, 1, 3], u: 2}
  integrator: {is: TransferFunction, a: [1, 0], b: [0, 1], u: 2}
  lag: {is: TransferFunction, a: [0.2, 1], b: [0, 1], u: "=3 + time*(1 1/s)"}
  same: {is: FirstOrderLag, T_1: 0.2 s, u: "=3 + time*(1 1/s)"}
  error: {is: Sum, k_1: 1, k_2: -1, u_1: 5}
  plant: {is: TransferFunction, a: [1, 0.4, 1], b: [0, 0, 4]}
nodes: {e: [error.y, plant.u], y: [plant.y, error.u_2]}
""", sensitivities=["second.a[3]"])
    assert np.abs(found["washout.y"]).max() < SMALL
    assert found["second.y"] == pytest.approx(1.5, abs=SMALL)
    assert found.sensitivity("second.y", "second.a[3]") == pytest.approx(-1.5 / 4, abs=SMALL)
    assert found["integrator.y"] == pytest.approx(2 * found.time, abs=SMALL)
    assert found["lag.y"] == pytest.approx(found["same.y"], abs=SMALL)
    assert found["plant.y"] == pytest.approx(4, abs=SMALL)  # 5*4/(1 + 4)


def test_an_initial_value_of_the_diagram_comes_before_the_steady_state_of_a_transfer_function() -> None:
    found = run("""
model: first
components:
  lag: {is: TransferFunction, a: [0.2, 1], b: [0, 1], u: 3}
initial: {"lag.z[1]": 1}
""")
    assert found["lag.y"] == pytest.approx(3 - 2 * np.exp(-found.time / 0.2), abs=SMALL)


@pytest.mark.long
@compiled
@pytest.mark.parametrize(("block", "output", "start", "expected"), [
    ("FilteredDerivative, T_f: 10 ms", "1/s", {"a": 5.0}, 0.0), ("FirstOrderLag, T_1: 0.1 s", "1", {"a": 5.0}, 5.0),
    ("PID, K_p: 1, K_d: 10 s, T_f: 10 ms, y_min: -1000, y_max: 1000, r: 7", "1", {"a": 5.0}, 2.0),
])
def test_a_filter_of_an_fmu_starts_at_the_input_that_was_set(block: str, output: str, start: dict[str, float],
                                                             expected: float, tmp_path: Path) -> None:
    export_fmu(hb.loads(f"""
model: filter
parameters: {{a: 3}}
components:
  f: {{is: {block}, u: =a}}
show: {{y: {{is: f.y, unit: "{output}"}}}}
simulate: {{until: 1 s}}
"""), tmp_path / "f.fmu")
    found = fmpy.simulate_fmu(str(tmp_path / "f.fmu"), stop_time=0.5, output_interval=0.1, start_values=start)
    assert found["y"] == pytest.approx(np.full(6, expected), abs=1e-9)
