"""Sampled blocks in loops and at their limits, beside difference equations; a servo drive with three rates."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from test_clocks import diagram

import heavebond as hb
from heavebond.numerics.dae import assemble
from heavebond.numerics.simulator import Simulator
from heavebond.reports.summary import summary

COMPONENT = """
component: Chain
summary: A chain of delays.
ports: {u: {signal: in, unit: 1, doc: input}, y: {signal: out, unit: 1, doc: output}}
parameters:
  T_s: {unit: s, min: 1e-9 s, doc: period}
  n: {integer, min: 2, doc: number}
  c: {unit: 1, count: n, doc: weights}
variables: {x: {unit: 1, count: n, held: 0, doc: states}}
equations: |
  y = sum(x)   # output
when:
  sample: {every: T_s, then: {x: VALUE}}
"""


def number(run: hb.Result, period: float) -> NDArray[np.int_]:
    """The number of the last sample at each time."""
    return np.floor(run.time / period + 1e-9).astype(int)


def test_a_unit_delay_and_a_sum_are_a_discrete_integrator() -> None:
    """y[k + 1] = y[k] + T u[k] for u = t: T^2 k (k - 1)/2."""
    for order in (("s", "d"), ("d", "s")):
        run = hb.simulate(hb.loads(diagram({"s": "{is: Gain, k: 1, u: =d.y + 0.1*time/(1 s)}",
                                            "d": "{is: UnitDelay, T_s: 0.1 s, u: =s.y}"}, order)))
        k = number(run, 0.1)
        assert run["d.y"] == pytest.approx(0.01 * k * (k - 1) / 2, abs=1e-12)


def test_a_discrete_loop_without_direct_feedthrough_follows_its_difference_equation() -> None:
    """A proportional controller and a discrete plant 0.2/(z - 0.9), whose first coefficient 0 opens the loop."""
    parts = {"c": "{is: SampleHold, T_s: 0.1 s, u: =2*(1 - p.y)}",
             "p": "{is: DiscreteTransferFunction, b: [0, 0.2], a: [1, -0.9], T_s: 0.1 s, u: =c.y}"}
    y = [0.0]
    for _ in range(12):
        y.append(0.9 * y[-1] + 0.2 * 2 * (1 - y[-1]))
    for order in (("c", "p"), ("p", "c")):
        run = hb.simulate(hb.loads(diagram(parts, order)))
        assert run["p.y"] == pytest.approx(np.array(y)[number(run, 0.1)], abs=1e-12)
    parts["p"] = parts["p"].replace("[0, 0.2]", "[0.1, 0.2]")
    with pytest.raises(hb.ModelError, match="'c' and 'p' form an algebraic loop"):
        hb.simulate(hb.loads(diagram(parts)))


def test_a_block_that_feeds_itself_at_once_is_an_algebraic_loop() -> None:
    """With b[1] = 0 and with a unit delay it is a difference equation."""
    parts = {"p": "{is: DiscreteTransferFunction, b: [0.5, 0.2], a: [1, -0.9], T_s: 0.1 s, u: =1 - p.y}"}
    for own in (parts, {"p": "{is: SampleHold, T_s: 0.1 s, u: =g.y}", "g": "{is: Gain, k: 0.5, u: =1 - p.y}"}):
        with pytest.raises(hb.ModelError, match="'p' forms an algebraic loop with itself") as caught:
            hb.simulate(hb.loads(diagram(own)))
        assert "UnitDelay" in str(caught.value)
    parts["p"] = parts["p"].replace("[0.5, 0.2]", "[0, 0.2]")
    y = [0.0]
    for _ in range(12):
        y.append(0.9 * y[-1] + 0.2 * (1 - y[-1]))
    run = hb.simulate(hb.loads(diagram(parts)))
    assert run["p.y"] == pytest.approx(np.array(y)[number(run, 0.1)], abs=1e-12)
    parts = {"p": "{is: DiscreteTransferFunction, b: [0.5, 0], a: [1, 0], T_s: 0.1 s, u: =1 - d.y}",
             "d": "{is: UnitDelay, T_s: 0.1 s, u: =p.y}"}
    run = hb.simulate(hb.loads(diagram(parts)))
    # y[k] = (1 - y[k - 1])/2 from y[-1] = 0: (1 - (-1/2)^(k + 1))/3
    assert run["p.y"] == pytest.approx((1 - (-0.5) ** (number(run, 0.1) + 1.0)) / 3, abs=1e-12)


def test_a_loop_that_a_new_value_closes_is_refused_in_that_run() -> None:
    parts = {"c": "{is: SampleHold, T_s: 0.1 s, u: =2*(1 - p.y)}",
             "p": "{is: DiscreteTransferFunction, b: [=b_1, 0.2], a: [1, -0.9], T_s: 0.1 s, u: =c.y}"}
    model = hb.loads(diagram(parts, None, "parameters: {b_1: 0}"))
    runs = Simulator(assemble(model))
    runs.run()
    with pytest.raises(hb.ModelError, match="algebraic loop"):
        runs.run({"b_1": 0.1})


def test_a_held_list_is_assigned_as_a_whole(tmp_path: Path) -> None:
    (tmp_path / "components").mkdir()
    (tmp_path / "m.yaml").write_text("model: m\ncomponents: {c: {is: Chain, T_s: 0.1 s, c: [1, 2, 4], u: 3}}\n"
                                     "simulate: {until: 1 s}\n")
    for value, expected in (("c*u", 21.0), ("0", 0.0), ("0.5*x + c", 14.0)):
        (tmp_path / "components" / "chain.yaml").write_text(COMPONENT.replace("VALUE", value))
        # x[k + 1] = x[k]/2 + c from 0 for eleven samples: 2 c (1 - 2^-11)
        expected = expected * (1 - 2.0**-11) if "x" in value else expected
        assert hb.simulate(hb.load(tmp_path / "m.yaml"))["c.y"][-1] == pytest.approx(expected, rel=1e-12)
    for value in ('"c[1..2]"', "u"):
        (tmp_path / "components" / "chain.yaml").write_text(COMPONENT.replace("VALUE", value))
        with pytest.raises(hb.ModelError) as caught:
            hb.simulate(hb.load(tmp_path / "m.yaml"))
        assert caught.value.problems[0].code == "list-length"


def test_the_change_to_automatic_operation_is_without_a_bump_and_the_limit_does_not_wind_up() -> None:
    parts = {"plant": "{is: FirstOrderLag, T_1: 0.5 s, u: =c.y}",
             "c": "{is: DiscreteSwitchablePID, K_p: 4, K_i: 8 1/s, y_min: -1, y_max: 3, T_t: 0.05 s, T_s: 10 ms, r: 1, "
                  "u: =plant.y, m: 0.2, a: '=if_else(time < 0.995 s, 0, 1)'}"}
    run = hb.simulate(hb.loads(diagram(parts, None, "initial: {plant.y: 0}")), until=5.0, every=0.01)
    change = np.searchsorted(run.time, 1.0 - 1e-9)
    # only the proportional part follows what the plant moved within one sample
    moved = run["plant.y"][change] - run["plant.y"][change - 1]
    assert run["c.y"][change] == pytest.approx(0.2 - 4 * moved, abs=1e-7)
    # by less than K_i T_s e in the samples after
    assert np.abs(np.diff(run["c.y"][change - 2:change + 3])).max() < 8 * 0.01 * 1.0
    assert run["c.y"][-1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.long
def test_noise_is_gaussian_white_and_differs_by_its_seed() -> None:
    parts = {name: f"{{is: WhiteNoise, sigma: 2, T_s: 1 ms, seed: {seed}}}" for name, seed in (("a", 1), ("b", 2))}
    run = hb.simulate(hb.loads(diagram(parts)), until=4.0, every=1e-3)
    a, b = run["a.y"], run["b.y"]
    n = len(a)
    # five standard errors of each estimate over 4001 numbers
    assert abs(a.mean()) < 5 * 2 / np.sqrt(n)
    assert a.std() == pytest.approx(2, rel=5 / np.sqrt(2 * n))
    assert np.mean(a**4) / np.mean(a**2) ** 2 == pytest.approx(3, abs=5 * np.sqrt(24 / n))
    for lag in (1, 2, 5):
        assert abs(np.corrcoef(a[:-lag], a[lag:])[0, 1]) < 5 / np.sqrt(n)
    assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(n)


def test_the_servo_drive_follows_its_target_at_three_rates() -> None:
    model = hb.load("servo_drive")
    assert summary(assemble(model), None).sampled == (
        "every 125 us: converter, current_pi, computing", "every 500 us: encoder, change, speed, speed_pi",
        "every 2 ms: position")
    run = hb.simulate(model, until=0.16)
    counts = {name: sum(1 for _, event in run.events if event == f"{name}.sample")
              for name in ("current_pi", "speed_pi", "position")}
    assert counts == {"current_pi": 1281, "speed_pi": 321, "position": 81}
    # every position sample is a sample of the speed loop, and every one of these one of the current loop
    times = [{round(time * 8000) for time, event in run.events if event == f"{name}.sample"}
             for name in ("position", "speed_pi", "current_pi")]
    assert all(slow <= fast for slow, fast in pairwise(times))
    # the target ends at 0.155 s; P control of the position with feed-forward lags by some degrees at most
    assert np.abs(run.display["lag"]).max() < 5
    assert run["load.phi"][-1] == pytest.approx(2 * np.pi, abs=0.03)
    assert np.abs(run.display["current"]).max() < 15
