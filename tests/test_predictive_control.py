"""Nonlinear predictive control: beside the linear design and a quadratic programme, beside runs, and as a sampled block."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import heavebond as hb
from heavebond.linear.optimal_design import lqg

CART = """
model: cart
components: {force: {is: ForceSource, u: 0 N}, cart: {is: Mass, m: 2 kg}}
nodes: {cart: [force.a, cart.a]}
initial: {cart.x: 1 m, cart.v: 0 m/s}
simulate: {until: 0.5 s, every: 10 ms}
"""
PENDULUM = """
model: pendulum
components:
  motor: {is: TorqueSource, u: 0 N*m}
  arm:   {is: ArmWeight, m: 1 kg, l: 0.5 m, g: 9.81 m/s**2}
  rotor: {is: Inertia, J: 0.25 kg*m**2}
  damp:  {is: RotationalDamper, d: 0.02 N*m*s/rad}
  frame: {is: FixedShaft}
nodes: {shaft: [motor.a, arm.a, rotor.a, damp.b], frame: [damp.a, frame.a]}
initial: {shaft.phi: 0 rad, shaft.w: 0 rad/s}
simulate: {until: 3 s, every: 10 ms}
"""
PERIOD, POSITION, FORCE = 0.05, 0.01, 0.5  # s, m, N: the sizes that count as 1


def sampled() -> tuple[np.ndarray, ...]:
    """The matrices A, B of the cart (v, x) for a period, and of its cost x'Qx + u'Ru + 2 x'Nu over it. C. F. Van Loan, IEEE
    Trans. Automatic Control 23 (1978) 395-404."""
    a, b = np.array([[0, 0, 0.5], [1, 0, 0], [0, 0, 0]]), 2
    weight = np.diag([0, POSITION**-2, FORCE**-2])
    whole = expm(np.block([[-a.T, weight], [np.zeros((3, 3)), a]]) * PERIOD)
    phi = whole[3:, 3:]
    cost = phi.T @ whole[:3, 3:]
    return phi[:b, :b], phi[:b, b:], cost[:b, :b], cost[b:, b:], cost[:b, b:]


def control(**options: object) -> hb.PredictiveControl:
    return hb.PredictiveControl(hb.loads(CART), {"force.u": "-5 .. 4 N"}, {"cart.x": "10 mm"}, {"force.u": f"{FORCE} N"},
                                **{"period": "50 ms", "horizon": 40, **options})


def test_without_active_limits_the_command_of_a_linear_machine_is_that_of_the_regulator() -> None:
    a, b, q, r, n = sampled()
    gain = lqg((a, b, np.eye(2)), (q, r, n), (np.eye(2), np.eye(2)), period=PERIOD).gain
    free = control()
    for v, x in ((-0.3, 0.1), (0.2, 0.0)):
        # after 40 samples the poles of 0.84 leave 1e-3 of the state, and 1e-6 of the cost of the commands after the horizon
        assert free.command({"cart.v": v, "cart.x": x})["force.u"] == pytest.approx(-(gain @ [v, x]).item(), rel=1e-4)


def test_limits_of_a_linear_machine_give_the_solution_of_the_quadratic_programme() -> None:
    """Commands, rates and a limit of the speed are active in the plan."""
    horizon, start = 30, np.array([0.0, 0.4])
    limited = control(horizon=horizon, limits={"cart.v": "-0.35 .. 1 m/s"}, rates={"force.u": "30 N/s"})
    plan = limited.plan({"cart.v": start[0], "cart.x": start[1]})
    a, b, q, r, n = sampled()
    u, x, cost, rows, low, high = ca.SX.sym("u", horizon), ca.SX(start), ca.SX(0), [], [], []
    for k in range(horizon):
        cost += x.T @ q @ x + r.item() * u[k]**2 + 2 * (x.T @ n) * u[k]
        x = a @ x + b @ u[k]
        rows, low, high = [*rows, x[0]], [*low, -0.35], [*high, np.inf]
        if k:
            rows, low, high = [*rows, u[k] - u[k - 1]], [*low, -1.5], [*high, 1.5]
    solver = ca.qpsol("qp", "qpoases", {"x": u, "f": cost, "g": ca.vertcat(*rows)}, {"printLevel": "none"})
    expected = np.array(solver(lbx=-5, ubx=4, lbg=low, ubg=high)["x"]).ravel()
    assert plan.commands["force.u"] == pytest.approx(expected, abs=1e-4)  # the barrier of IPOPT at active limits
    assert plan.states["cart.v"].min() == pytest.approx(-0.35, abs=1e-6) and plan.excess < 1e-7
    assert np.abs(np.diff(plan.commands["force.u"])).max() == pytest.approx(1.5, abs=1e-6)
    assert plan.commands["force.u"].min() == pytest.approx(-5, abs=1e-6)


def test_a_plan_of_a_nonlinear_machine_is_what_a_run_makes_of_its_commands(tmp_path: Path) -> None:
    swing = hb.PredictiveControl(hb.loads(PENDULUM), {"motor.u": "-2 .. 2 N*m"}, {"shaft.phi": "0.5 rad"},
                                 {"motor.u": "2 N*m"}, targets={"shaft.phi": "3.14159 rad"}, period="0.1 s", horizon=30,
                                 steps=4)
    plan = swing.plan({"shaft.phi": 0.0, "shaft.w": 0.0})
    table = np.column_stack([plan.time, np.append(plan.commands["motor.u"], 0)])
    np.savetxt(tmp_path / "u.csv", table, delimiter=",", header="time,u", comments="", fmt="%.17g")
    (tmp_path / "m.yaml").write_text(PENDULUM.replace(
        "u: 0 N*m", "u: {file: u.csv, column: u, unit: N*m, interpolation: hold, time: {column: time, unit: s}}"))
    run = hb.simulate(tmp_path / "m.yaml", every="0.1 s")
    assert np.ptp(plan.states["shaft.phi"]) > np.pi  # far beyond any linearisation
    # four steps of order 5 in a sample
    assert run.si["shaft.phi"] == pytest.approx(plan.states["shaft.phi"], abs=1e-4)


def test_the_controller_acts_as_a_sampled_block_by_an_external_function(tmp_path: Path) -> None:
    """A run with the block beside one sample after the other by hand."""
    (tmp_path / "components").mkdir()
    (tmp_path / "cart.yaml").write_text(CART)
    (tmp_path / "components" / "predicted.yaml").write_text("""
function: predicted
is: external
summary: Force of the predictive controller.
file: predicted.py
inputs: {x: {unit: m, nominal: 1 m, doc: position}, v: {unit: m/s, nominal: 1 m/s, doc: speed}}
outputs: {force: {unit: N, doc: force}}
""")
    (tmp_path / "components" / "predicted.py").write_text("""
from pathlib import Path
import heavebond as hb
control = hb.PredictiveControl(Path(__file__).parents[1] / "cart.yaml", {"force.u": "-5 .. 4 N"}, {"cart.x": "10 mm"},
                               {"force.u": "0.5 N"}, period="0.1 s", horizon=15, steps=1)
def predicted(x, v):
    return control.command({"cart.x": x, "cart.v": v})["force.u"]
""")
    (tmp_path / "components" / "planner.yaml").write_text("""
component: Planner
summary: A predictive controller of a cart.
ports:
  x: {signal: in, unit: m, doc: position}
  v: {signal: in, unit: m/s, doc: speed}
  y: {signal: out, unit: N, doc: force}
parameters: {T_s: {unit: s, min: 1e-6 s, default: 0.1 s, doc: sampling period}}
variables: {held: {unit: N, held: 0 N, doc: force of the last sample}}
equations: y = held
when: {sample: {every: T_s, then: {held: "predicted(x, v)"}}}
""")
    (tmp_path / "loop.yaml").write_text("""
model: loop
extends: cart.yaml
components: {planner: {is: Planner, x: =cart.x, v: =cart.v}, force: {is: ForceSource, u: =planner.y}}
""")
    run = hb.simulate(hb.load(tmp_path / "loop.yaml", allow_native=True))
    alone = control(period="0.1 s", horizon=15, steps=1)
    x, v = 1.0, 0.0
    for k in range(5):
        force = alone.command({"cart.x": x, "cart.v": v})["force.u"]
        assert run.si["force.u"][10 * k + 5] == pytest.approx(force, abs=1e-5)  # the tolerance of the run
        x, v = x + 0.1 * v + 0.0025 * force, v + 0.05 * force


@pytest.mark.parametrize(("change", "message"), [
    ({"horizon": 0}, "whole number"), ({"period": 0.0}, "must be above 0"),
    ({"targets": {"cart.v": 1.0}}, "not among cart.x"),
    ({"limits": {"cart.v": "0 .. 1 m"}}, "is in m/s"), ({"rates": {"force": 1.0}}, "not among force.u")])
def test_wrong_arguments_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(hb.UsageError, match=message):
        control(**change)


def test_missing_states_efforts_and_sampled_machines_are_refused() -> None:
    with pytest.raises(hb.UsageError, match=r"the value of cart\.v is missing"):
        control(horizon=2).plan({"cart.x": 1.0})
    with pytest.raises(hb.UsageError, match=r"the effort of 'force\.u' is missing"):
        hb.PredictiveControl(hb.loads(CART), {"force.u": "-5 .. 4 N"}, {"cart.x": "10 mm"}, {}, period="50 ms", horizon=5)
    with pytest.raises(hb.UsageError, match="events"):
        hb.PredictiveControl("circuits/thermostat", {"heater.u": "0 .. 1 kW"}, {"room.a.T": "1 K"}, {"heater.u": "1 kW"},
                             period="1 s", horizon=5)
