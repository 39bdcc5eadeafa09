"""Costs and their gradients, and gains found with them."""

from __future__ import annotations

import numpy as np
import pytest

import heavebond as hb
from heavebond.costs import read_cost
from heavebond.dae import Assembly
from heavebond.study import load_study
from heavebond.tuning import Case, Objective, Task, ranges, sweep, tune

ABSORBER = """
model: absorber
summary: A mass shaken by a force, on a damper to be tuned.
components:
  wall:   {is: Fixed}
  spring: {is: Spring, c: 1 kN/m}
  damper: {is: Damper, d: 5 N*s/m}
  cart:   {is: Mass, m: 10 kg}
  shaker: {is: ForceSource, u: "=20 N*sin(10 rad/s*time)"}
nodes:
  ground: [wall.a, spring.a, damper.a]
  load:   [spring.b, damper.b, cart.a, shaker.a]
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 20 s, every: 0.1 s}
"""


@pytest.fixture(scope="module")
def absorber() -> Assembly:
    return hb.assemble(hb.loads(ABSORBER.replace("10 rad/s*time", "10 rad/s * time")))


def _task(cost: str, **more: object) -> Task:
    return Task(ranges({"damper.d": "1 .. 200 N*s/m", "spring.c": "0.5 .. 2 kN/m"}), cost, begin=10.0, end=20.0,
                **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("cost", [
    "rms(load.x)", "integral(load.x**2)", "mean(load.v**2)", "peak(load.x)", "final(load.x)",
    "rms(load.x)/ref(rms(load.x)) + damper.d/10 kN*1 m/1 s", "0.5*(rms(load.x)/1 mm + peak(load.v)/1 m*1 s)"])
def test_gradients_agree_with_differences(absorber: Assembly, cost: str) -> None:
    objective = Objective(absorber, _task(cost, reference={"damper.d": "50 N*s/m"}))
    at = np.array([0.3, 0.4])
    exact = objective.evaluate(at).gradient
    for k in range(2):
        step = np.zeros(2)
        step[k] = 1e-3
        costs = [objective.cost(at + n * step) for n in (-2, -1, 1, 2)]
        difference = (8 * (costs[2] - costs[1]) - (costs[3] - costs[0])) / 12e-3
        # runs at 1e-6, differenced over 1e-3 of the range
        assert exact[k] == pytest.approx(difference, rel=2e-3, abs=2e-3 * np.abs(exact).max())


def test_functionals_have_their_closed_form_values() -> None:
    """A prescribed motion x = 0.3 m sin(2 pi t/T): rms 0.3/sqrt(2), peak 0.3, integral of x**2 over whole periods."""
    text = ABSORBER.replace('{is: ForceSource, u: "=20 N*sin(10 rad/s*time)"}',
                            '{is: PositionSource, u: "=0.3 m*sin(2*pi*time/1 s)"}')
    assembly = hb.assemble(hb.loads(text.replace("initial: {load.x: 0 m, load.v: 0 m/s}", "")))
    for cost, value in (("rms(load.x)", 0.3 / np.sqrt(2)), ("peak(load.x)", 0.3), ("integral(load.x**2)", 0.45),
                        ("mean(load.x)", 0.0), ("final(load.v)", 0.3 * 2 * np.pi)):
        found = Objective(assembly, Task(ranges({"cart.m": "1 .. 20 kg"}), cost, begin=10.0, end=20.0))
        assert found.cost(found.start) == pytest.approx(value, rel=1e-4, abs=1e-4)


def test_the_optimum_of_a_known_problem_is_found(absorber: Assembly) -> None:
    """Shaken at 10 rad/s, the amplitude F/sqrt((c - m w**2)**2 + (d w)**2) is least at the softest spring that the
    range allows (c = 500 N/m, below resonance), and falls with d: both end at their bounds."""
    result = tune(absorber, _task("rms(load.x)"))
    assert result.values["damper.d"] == pytest.approx(200, rel=1e-3)
    amplitude = 20 / np.hypot(result.values["spring.c"] - 1000, 200 * 10)
    assert result.cost == pytest.approx(amplitude / np.sqrt(2), rel=2e-3)


def test_a_limit_is_kept(absorber: Assembly) -> None:
    """Little damping wanted, but the peak must stay below 30 mm: at resonance x = F/(d w), so d = 66.7 N s/m."""
    task = Task(ranges({"damper.d": "10 .. 200 N*s/m"}), "damper.d/100 N*1 m/1 s", ("peak(load.x) < 30 mm",), 10.0,
                20.0)
    result = tune(absorber.with_parameters({"damper.d": 150.0}), task)
    assert result.values["damper.d"] == pytest.approx(20 / (0.03 * 10), rel=5e-3)
    assert max(result.limits.values()) < 1e-3


def test_cases_are_averaged_with_their_weights(absorber: Assembly) -> None:
    cases = (Case("light", {"cart.m": "8 kg"}), Case("heavy", {"cart.m": "14 kg"}, 3.0))
    both = Objective(absorber, _task("rms(load.x)", cases=cases))
    alone = [Objective(absorber.with_parameters(dict(c.settings)), _task("rms(load.x)")).evaluate(both.start).cost
             for c in cases]
    assert both.evaluate(both.start).cost == pytest.approx((alone[0] + 3 * alone[1]) / 4, rel=1e-5)


def test_compensator_optimum_from_bad_starts() -> None:
    """Ten random starts, most of them beyond the limit of stability, end at one optimum. Without friction: with it, the
    cost has a second minimum at the edge of stability. The effort (a run with two sensitivities counts as three
    simulations) is some 60 to 80 here, where the valley ends at a cliff, and 30 to 50 with friction."""
    study = load_study("cmc_ahc/quality_index")
    assembly = hb.assemble(hb.load("cmc_ahc/active_frictionless"))
    rng = np.random.default_rng(7)
    found = []
    for seed in range(10):
        start = {"controller.K_p": rng.uniform(0, 8), "controller.K_v": rng.uniform(0, 1.2)}
        found.append(tune(assembly.with_parameters(start), study.task, seed=seed))
    best = min(found, key=lambda r: r.cost)
    for result in found:
        assert result.cost == pytest.approx(best.cost, rel=1e-3)
        assert result.values["controller.K_p"] == pytest.approx(best.values["controller.K_p"], rel=0.01)
        assert result.values["controller.K_v"] == pytest.approx(best.values["controller.K_v"], rel=0.01)
        assert result.simulations <= 100


def test_a_sweep_is_never_below_the_optimum(absorber: Assembly) -> None:
    task = _task("rms(load.x)")
    axes, costs = sweep(Objective(absorber, task), [5, 5])
    assert costs.shape == (5, 5)
    assert axes[0][0] == 1.0
    assert tune(absorber, task).cost <= np.nanmin(costs) * (1 + 1e-5)


@pytest.mark.parametrize(("cost", "code"), [
    ("rms(load.y)", "name-unknown"), ("load.x", "cost-signal"), ("rms(rms(load.x))", "cost-nested"),
    ("rms(load.x) + rms(load.v)", "units-differ"), ("power(load.x)", "function-unknown")])
def test_wrong_costs_are_refused_with_a_caret(absorber: Assembly, cost: str, code: str) -> None:
    with pytest.raises(hb.UsageError) as caught:
        read_cost(absorber, cost)
    assert caught.value.problems[0].code == code
    assert "^" in str(caught.value)


def test_wrong_tasks_are_refused(absorber: Assembly) -> None:
    with pytest.raises(hb.UsageError, match="outside its range"):
        tune(absorber, Task(ranges({"damper.d": "10 .. 20 N*s/m"}), "rms(load.x)"))
    with pytest.raises(hb.UsageError, match="nothing is free"):
        tune(absorber, Task({}, "rms(load.x)"))
    with pytest.raises(hb.UsageError, match=r"Did you mean 'damper.d'"):
        tune(absorber, Task(ranges({"dampr.d": "10 .. 20 N*s/m"}), "rms(load.x)"))
