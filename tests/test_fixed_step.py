"""Solvers with a fixed step beside the recursions that they stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly

import heavebond as hb
from heavebond import cli

# A damper of 1 kg/s brakes a mass of 1 kg: v' = -v.
DECAY = """
model: decay
components:
  brake: {is: Damper, d: 1 N*s/m}
  load: {is: Mass, m: 1 kg}
  wall: {is: Fixed}
nodes: {load: [brake.a, load.a], wall: [brake.b, wall.a]}
initial: {load.x: 0 m, load.v: 1 m/s}
simulate: {until: 2 s, every: 0.1 s}
"""
STEP = 0.1
GROWTH = {"euler": 1 - STEP, "rk4": 1 - STEP + STEP**2 / 2 - STEP**3 / 6 + STEP**4 / 24, "backward-euler": 1 / (1 + STEP)}
ROUNDING = 1e-13  # 20 products, and the last change of Newton's method


def run(text: str = DECAY, **options: object) -> hb.Result:
    """A run whose verdict names the missing error control."""
    with pytest.warns(hb.RunWarning, match="has no error control: its step is"):
        return hb.simulate(hb.loads(text), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("solver", GROWTH)
def test_each_step_of_a_decay_multiplies_by_the_stability_function(solver: str) -> None:
    found = run(solver=solver, step=STEP)
    assert found.statistics["nsteps"] == 20
    assert np.allclose(found["load.v"], GROWTH[solver] ** np.arange(21), rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("solver", GROWTH)
def test_the_output_times_do_not_change_the_steps(solver: str) -> None:
    coarse, fine = run(solver=solver, step=STEP), run(solver=solver, step=STEP, every=0.03, until=1.99)
    at = np.array([0.3, 0.6, 0.9, 1.2])
    assert np.allclose(np.interp(at, fine.time, fine["load.v"]), np.interp(at, coarse.time, coarse["load.v"]), rtol=ROUNDING)
    # the error of linear and of cubic interpolation: h²/8 max|v''|, h⁴/384 max|v''''|; the method adds its own
    between = GROWTH[solver] ** (fine.time / STEP)
    assert np.abs(fine["load.v"] - between).max() < (STEP**4 / 384 * 1.1 + STEP**5 if solver == "rk4" else STEP**2 / 8 * 1.1)


@pytest.mark.parametrize(("solver", "order"), [("euler", 1), ("rk4", 4), ("backward-euler", 1)])
def test_the_error_falls_with_the_order_of_the_method(solver: str, order: int) -> None:
    driven = DECAY.replace("wall: {is: Fixed}", 'wall: {is: PositionSource, u: "=sin(2*time/1 s)*0.2 m"}')
    exact = hb.simulate(hb.loads(driven), rtol=1e-12, atol=1e-13)["load.x"][-1]
    errors = [abs(run(driven, solver=solver, step=h)["load.x"][-1] - exact) for h in (0.1, 0.05)]
    assert abs(np.log2(errors[0] / errors[1]) - order) < 0.15  # the next term of the error, of relative size h


def test_backward_euler_solves_algebraic_unknowns_and_explicit_methods_refuse_them() -> None:
    # two progressive dampers in series: the speed between them is an algebraic unknown
    series = DECAY.replace("brake: {is: Damper, d: 1 N*s/m}",
                           "brake: {is: NonlinearDamper, d: 1 N*s/m, k: -1, v_k: 1 m/s}\n"
                           "  other: {is: NonlinearDamper, d: 2 N*s/m, k: -2, v_k: 1 m/s}").replace(
        "wall: [brake.b, wall.a]", "between: [brake.b, other.a], wall: [other.b, wall.a]")
    assembly = hb.assemble(hb.loads(series))
    assert assembly.algebraic_names
    exact = hb.simulate(assembly)
    errors = []
    for step in (0.02, 0.01):
        with pytest.warns(hb.RunWarning, match="backward-euler has no error control"):
            speeds = hb.simulate(assembly, solver="backward-euler", step=step)["load.v"]
        errors.append(np.abs(speeds - exact["load.v"]).max())
    assert errors[1] < 0.01 and abs(errors[0] / errors[1] - 2) < 0.1  # of order 1; the next term is of relative size h
    for solver in ("euler", "rk4"):
        with pytest.raises(hb.UsageError, match=f"{solver} cannot run this diagram, which has") as caught:
            hb.simulate(assembly, solver=solver, step=0.01)
        assert "--solver idas" in caught.value.problems[0].hint


SWITCHED = """
model: switched
components:
  relay: {is: Relay, u_on: -1, u_off: -3, y_on: 5, y_off: 0}
  lag:   {is: FirstOrderLag, T_1: 0.2 s}
  back:  {is: Gain, k: -1}
  wave:  {is: Sine, a: 1, T: 0.5 s}
  taken: {is: SampleHold, T_s: 70.3 ms}
nodes: {command: [relay.y, lag.u], level: [lag.y, back.u], down: [back.y, relay.u], wave: [wave.y, taken.u]}
show: {level: {is: lag.y, unit: 1}, taken: {is: taken.y, unit: 1}}
simulate: {until: 2 s, every: 10 ms}
"""
COUNTER = """component: Counter
summary: Count of the crossings of the marks of a rule.
ports: {u: {signal: in, unit: 1}, y: {signal: out, unit: 1}}
variables: {n: {unit: 1, held: 0}}
equations: |
  y = n
when:
  up: {condition: u >= n + 1, then: {n: n + 1}}
"""


@pytest.mark.parametrize("solver", partly(GROWTH, 3))
def test_events_happen_at_the_ends_of_steps(solver: str) -> None:
    """A relay between -1 and 1 of a lag: its events are at multiples of the step, its samples at their instants, and the
    error is of the size of the step."""
    exact, errors = hb.simulate(hb.loads(SWITCHED), rtol=1e-10), []
    switched = [time for time, name in exact.events if name.startswith("relay")]
    assert len(switched) > 5
    for step in (1e-3, 0.5e-3):
        found = run(SWITCHED, solver=solver, step=step)
        times = np.array([time for time, name in found.events if name.startswith("relay")])
        assert np.abs(times / step - np.round(times / step)).max() < 1e-6
        assert len(times) == len(switched)
        assert [time for time, name in found.events if name.startswith("taken")] == pytest.approx(0.0703 * np.arange(29))
        assert np.abs(found.si["taken"] - exact.si["taken"]).max() < 1e-12
        errors.append(np.abs(times - switched).max() / step)
    assert max(errors) < 1.5 * len(switched)


def test_a_count_advances_by_several_at_the_end_of_a_step(tmp_path: Path) -> None:
    """25 marks in each step of 10 ms."""
    (tmp_path / "counter.yaml").write_text(COUNTER)
    text = "model: m\ncomponents:\n  n: {is: Counter, u: \"=2500.5*time/(1 s)\"}\nsimulate: {until: 0.2 s, every: 10 ms}\n"
    with pytest.warns(hb.RunWarning, match="n has .* events per second"):
        found = hb.simulate(hb.loads(text, tmp_path), solver="euler", step="10 ms")
    np.testing.assert_array_equal(found["n.y"], np.floor(2500.5 * found.time + 1e-9))


def test_a_law_that_alternates_from_step_to_step_is_named() -> None:
    """A relay without a band drives a lag back and forth around its switching point."""
    text = SWITCHED.replace("u_on: -1, u_off: -3", "u_on: -1.9999, u_off: -2")
    with pytest.warns(hb.RunWarning, match=r"relay has .* events per second"):
        found = hb.simulate(hb.loads(text), solver="rk4", step=1e-3)
    assert abs(found["lag.y"][-1] - 2) < 0.03


def test_the_step_is_read_from_the_diagram_and_missing_steps_are_named() -> None:
    with pytest.raises(hb.UsageError, match="needs a step above 0 s") as caught:
        hb.simulate(hb.loads(DECAY), solver="rk4")
    assert "--step '1 ms'" in caught.value.problems[0].hint
    with pytest.raises(hb.UsageError, match="cvodes chooses its steps itself"):
        hb.simulate(hb.loads(DECAY), step=0.1)
    written = DECAY.replace("every: 0.1 s", "every: 0.1 s, solver: euler, step: 50 ms")
    assert run(written).statistics["step"] == 0.05
    assert run(written, step="100 ms").statistics["step"] == 0.1


def test_a_step_beyond_the_limit_of_stability_is_named() -> None:
    with pytest.raises(hb.SimulationError, match="euler gave up") as caught:
        hb.simulate(hb.loads(DECAY.replace("d: 1 N", "d: 100 kN")), 60, solver="euler", step=0.1)
    assert "limit of stability at 2e-05 s: type `--step '1e-05 s'` or less" in caught.value.problems[0].hint


@pytest.mark.parametrize(("solver", "limit"), [("euler", 2.0), ("rk4", 2.785)])
def test_a_run_beyond_the_limit_of_stability_states_it(solver: str, limit: float) -> None:
    """v' = -v: |R(-h)| = 1 at h = 2 for Euler and at 2.785 for Runge-Kutta of order 4 (E. Hairer, G. Wanner, II, IV.2). In
    100 steps |R| = 2**(1/100) doubles a motion, which is 0.4 % of the step away."""
    with pytest.warns(hb.RunWarning, match="has no error control: its step is .* s, beyond its limit of stability at"):
        beyond = hb.simulate(hb.loads(DECAY), 100 * limit, every=limit * 1.03, solver=solver, step=limit * 1.03)
    assert abs(beyond["load.v"][-1]) > 1 and beyond.statistics["stable_step"] == pytest.approx(limit, rel=0.005)
    inside = run(solver=solver, step=limit * 0.97, every=limit * 0.97, until=100 * limit)
    assert "stable_step" not in inside.statistics and abs(inside["load.v"][-1]) < 1


def test_an_undamped_oscillation_grows_in_every_step_of_euler() -> None:
    """|1 + i w h|^(T/h) = 2 at h = 2 ln(2)/(w² T) for small steps."""
    text = DECAY.replace("brake: {is: Damper, d: 1 N*s/m}", "brake: {is: Spring, c: 1 N/m}")
    found = run(text, solver="euler", step=0.1, until=100)
    assert found.statistics["stable_step"] == pytest.approx(2 * np.log(2) / 100, rel=0.01)
    assert "stable_step" not in run(text, solver="rk4", step=0.1, until=100).statistics


def test_the_command_takes_a_step(tmp_path: Path) -> None:
    path = tmp_path / "decay.yaml"
    path.write_text(DECAY, encoding="utf-8")
    told = CliRunner().invoke(cli.main, ["run", str(path), "--solver", "euler", "--step", "0.1 s"])
    assert told.exit_code == 0
    for words in ("solver euler (asked for)", "20 steps of 0.1 s"):
        assert words in " ".join(told.output.split())


def test_a_run_that_overflows_by_a_long_step_names_the_stable_one() -> None:
    """An oscillation of 2000 rad/s: Runge-Kutta of order 4 is stable up to 2 sqrt(2)/2000 s."""
    text = """
model: stiff
components:
  g: {is: Fixed}
  s: {is: Spring, c: 4e6 N/m}
  m: {is: Mass, m: 1 kg}
nodes: {g: [g.a, s.a], b: [s.b, m.a]}
initial: {b.x: 10 mm, b.v: 0 m/s}
simulate: {until: 2 s, every: 10 ms}
"""
    with pytest.raises(hb.SimulationError) as caught:
        hb.simulate(hb.loads(text), solver="rk4", step="2 ms")
    hint = caught.value.problems[0].hint
    assert "limit of stability at 0.00141 s" in hint and "`--step '0.001 s'` or less" in hint
    assert hb.simulate(hb.loads(text), solver="rk4", step="1 ms").verdict.failed is False
