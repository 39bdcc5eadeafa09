"""Optimal inputs by collocation, beside closed solutions of the calculus of variations and of bang-bang control."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main

CART = """
model: cart
components:
  push: {is: ForceSource, u: 0 N}
  cart: {is: Mass, m: 2 kg}
nodes: {cart: [push.a, cart.a]}
initial: {cart.x: 0 m, cart.v: 0 m/s}
show: {x: {is: cart.x, unit: m}, v: {is: cart.v, unit: m/s}}
simulate: {until: 1 s, every: 10 ms}
"""
REST = {"cart.x": "1 m", "cart.v": "0 m/s"}


def cart() -> hb.Model:
    return hb.loads(CART)


def test_the_least_energy_of_a_motion_is_that_of_the_cubic() -> None:
    """x = 3 t^2 - 2 t^3 in 1 s: F = m (6 - 12 t), the integral of F^2 is 12 m^2. The polynomials contain it exactly; the run
    has trapezoids of 200 points, whose error is 12 m^2 h^2 = 1e-3."""
    task = hb.optimal_task({"push.u": "-100 .. 100 N"}, "integral(push.u**2)", at_end=REST, intervals=20)
    result = hb.optimal(cart(), task)
    assert result.verified
    assert result.collocated == pytest.approx(48, rel=1e-8)
    assert result.cost == pytest.approx(48, rel=1e-4)
    assert result.inputs.values["push.u"] == pytest.approx(12 - 24 * result.inputs.time, abs=1e-4)


def test_the_shortest_motion_is_bang_bang_with_a_limit_of_speed() -> None:
    """T = 2 sqrt(m s/F) = 1 s; with a largest speed v it is s/v + v m/F. Switching instants lie on the grid of 40 intervals,
    which costs at most half an interval in each of two."""
    def task(*limits: str) -> hb.OptimalProblem:
        return hb.optimal_task({"push.u": "-8 .. 8 N"}, "integral(1)", limits=limits, at_end=REST, duration="0.5 .. 3 s",
                               intervals=40, interpolation="hold")

    free = hb.optimal(cart(), task())
    assert free.verified and free.duration == pytest.approx(1, rel=1e-6)
    limited = hb.optimal(cart(), task("peak(cart.v) < 0.8 m/s"))
    assert limited.verified and 1.45 <= limited.duration + 1e-6 < 1.46
    assert limited.limits["peak(cart.v) < 0.8 m/s"] == pytest.approx(0, abs=1e-6)


def test_a_known_disturbance_is_cancelled_up_to_the_limit_of_the_force() -> None:
    """The cart stays at rest if the force is opposite to the disturbance; straight lines over 40 intervals approximate the
    sine to (h w)^2/8 = 3e-3 of 5 N."""
    wind = '  wind: {is: ForceSource, u: "=5 N*sin(6.283185307 rad/s*time)"}'
    text = CART.replace("  cart: {is", f"{wind}\n  cart: {{is").replace("[push.a, cart.a]", "[push.a, wind.a, cart.a]")
    task = hb.optimal_task({"push.u": "-6 .. 6 N"}, "rms(cart.v)", start="periodic", intervals=40)
    result = hb.optimal(hb.loads(text), task)
    assert result.cost < 0.01 * result.before
    assert result.inputs.values["push.u"] == pytest.approx(-5 * np.sin(2 * np.pi * result.inputs.time), abs=0.05)


def test_algebraic_unknowns_are_collocated_with_the_states() -> None:
    """The force y of the loop y + y^3 = u has the course of the cubic above. u is a straight line in each of 50 intervals,
    which approximates that course to 1e-3."""
    text = CART.replace("  push: {is: ForceSource, u: 0 N}", """  command: {is: Constant, k: 0}
  loop: {is: Gain, k: 1, u: =command.y - loop.y**3}
  push: {is: ForceSource, u: =loop.y*1 N}""")
    result = hb.optimal(hb.loads(text), hb.optimal_task(
        {"command.y": "-3000 .. 3000"}, "integral(push.u**2)", at_end=REST, intervals=50))
    assert hb.assemble(hb.loads(text)).algebraic_names
    assert result.verified and result.cost == pytest.approx(48, rel=1e-3)


@pytest.mark.parametrize(("free", "options", "said"), [
    ({"cart.m": "1 .. 2 kg"}, {}, "free-parameter"), ({"push.v": "-1 .. 1 N"}, {}, "input-unknown"),
    ({"push.u": "-1 .. 1 m"}, {}, "unit-wrong"), ({}, {}, "free-missing"),
    ({"push.u": "-1 .. 1 N"}, {"cost": "share(cart.x > 0 m)"}, "cost-kind"),
    ({"push.u": "-1 .. 1 N"}, {"start": "rest"}, "option-unknown"),
    ({"push.u": "-1 .. 1 N"}, {"at_end": {"cart.y": "1 m"}}, "signal-unknown"),
    ({"push.u": "-1 .. 1 N"}, {"at_end": {"cart.x": "1 s"}}, "unit-wrong"),
    ({"push.u": "-1 .. 1 N"}, {"at_end": {"cart.x": "=1 m"}}, "is a formula; a number with a unit is needed"),
    ({"push.u": "-1 .. 1 N"}, {"limits": ["peak(cart.v)"]}, "limit:1: a limit is a comparison"),
    ({"push.u": "-1 .. 1 N"}, {"limits": ["peak(cart.v) < 1 m"]}, "limit:1: '<' compares m/s and m"),
    ({"push.u": "-1 .. 1 N"}, {"limits": ["peak(cart.w) < 1 m"]}, "limit:1: "),
    ({"push.u": "-1 .. 1 N"}, {"end": "0 s"}, "evaluate-empty"),
    ({"push.u": "-1 .. 1 N"}, {"duration": "-1 .. 2 s"}, "duration-range"),
    ({"push.u": "-1 .. 1 N"}, {"duration": "1 .. 2 m"}, "unit-wrong"),
])
def test_mistakes_are_named(free: dict[str, str], options: dict[str, object], said: str) -> None:
    with pytest.raises(hb.UsageError, match=said):
        hb.optimal(cart(), hb.optimal_task(free, **{"cost": "rms(cart.x)", **options}))


@pytest.mark.parametrize(("free", "suggested"), [
    ("push.u=8", "`0 .. 8 N`"), ("push.u=-8", "`-8 .. 0 N`"), ("push.u=8 N", "`8 N +- 20 %`"),
    ("push.u=-8 .. 9", "`-8 .. 9 N`"),
    ("push.u=-8 .. 9 m", "`-8 .. 9 N`")])
def test_a_range_without_a_unit_is_suggested_with_the_unit(free: str, suggested: str, tmp_path: Path) -> None:
    (tmp_path / "cart.yaml").write_text(CART, encoding="utf-8")
    run = CliRunner().invoke(main, ["optimal", str(tmp_path / "cart.yaml"), "--free", free, "--cost", "rms(cart.x)"])
    assert run.exit_code == 2 and suggested in run.output


def test_a_motion_beyond_the_force_is_refused() -> None:
    with pytest.raises(hb.SimulationError, match="optimal-infeasible"):
        hb.optimal(cart(), hb.optimal_task({"push.u": "-1 .. 1 N"}, "rms(push.u)", at_end=REST, intervals=10))


def test_a_sampled_block_in_the_equations_is_refused() -> None:
    text = CART.replace("push: {is: ForceSource, u: 0 N}", """push: {is: ForceSource, u: =hold.y}
  hold: {is: SampleHold, T_s: 10 ms, u: =1 N - cart.x*1 N/m}""")
    with pytest.raises(hb.UsageError, match="optimal-events"):
        hb.optimal(hb.loads(text), hb.optimal_task({"hold.u": "-1 .. 1 N"}, "rms(cart.x)"))
    # the cost does not depend on the cart, the value at the end does
    with pytest.raises(hb.UsageError, match="optimal-events"):
        hb.optimal(hb.loads(text), hb.optimal_task({"hold.u": "-20 .. 20 N"}, "integral(hold.u**2)",
                                                   at_end={"cart.x": "1 m"}))
    # in front of the actuator the block has no influence
    assert hb.optimal(hb.loads(text), hb.optimal_task({"push.u": "-20 .. 20 N"}, "integral(push.u**2)", at_end=REST,
                                                      intervals=10)).collocated == pytest.approx(48, rel=1e-6)


def test_a_periodic_motion_with_a_value_at_the_end_begins_there() -> None:
    """A cart that is at 1 m at the end of each period needs no force: it is there all the time. From rest at 0 it would be
    3 m^2 s^2/T^3 = 12 N^2 s."""
    options = {"at_end": {"cart.x": "1 m"}, "intervals": 10}
    assert hb.optimal(cart(), hb.optimal_task({"push.u": "-20 .. 20 N"}, "integral(push.u**2)", **options)).cost == \
        pytest.approx(12, rel=1e-3)
    periodic = hb.optimal(cart(), hb.optimal_task({"push.u": "-20 .. 20 N"}, "integral(push.u**2)", start="periodic",
                                                  **options))
    assert periodic.verified and periodic.cost == pytest.approx(0, abs=1e-6)
    assert periodic.run.si["cart.x"] == pytest.approx(1, abs=1e-6)


def test_the_command_computes_each_case_of_a_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("cart.yaml").write_text(CART, encoding="utf-8")
    Path("best.yaml").write_text("""study: shortest motion
model: cart.yaml
cases: {cart.m: [2 kg, 8 kg]}
optimal: {free: {push.u: -8 .. 8 N}, cost: integral(1), duration: 0.5 .. 4 s, interpolation: hold, intervals: 10,
          at_end: {cart.x: 1 m, cart.v: 0 m/s}}
measure: {highest speed: {is: highest(cart.v), unit: m/s}}
""", encoding="utf-8")
    run = CliRunner().invoke(main, ["optimal", "best.yaml", "--json", "told.json"])
    assert run.exit_code == 0, run.output
    cases = json.loads(Path("told.json").read_text(encoding="utf-8"))["cases"]
    assert [case["duration"] for case in cases.values()] == pytest.approx([1, 2], rel=1e-6)
    assert [case["measures"]["highest speed"]["optimal"] for case in cases.values()] == pytest.approx([2, 1], rel=1e-6)
    assert "verified by a run" in run.output
    run = CliRunner().invoke(main, ["optimal", "cart.yaml"])
    assert run.exit_code != 0
    run = CliRunner().invoke(main, ["optimal", "cart.yaml", "--free", "push.u=-1 .. 1 N"])
    assert "cost-missing" in run.output
