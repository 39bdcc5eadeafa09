"""Forces and gains that are narrow in a state are not stepped over.

A body that passes a force F(x) gains its work: v**2 = v_0**2 + 2/m * integral of F. A lag y = 1 - exp(-t/T) passes a value
y_0 at the rate (1 - y_0)/T, so that the integral of a narrow f(y) over time is T/(1 - y_0) times its integral over y.
"""

from __future__ import annotations

import numpy as np
import pytest

import heavebond as hb

TRACK = """
model: track
components:
  m: {{is: Mass, m: 1 kg}}
  f: {{is: ForceSource, u: "{force}"}}
nodes: {{x: [m.a, f.a]}}
initial: {{x.x: 0 m, x.v: 10 m/s}}
simulate: {{until: 200 s{more}}}
"""
LAG = """
model: lag
components:
  l: {{is: FirstOrderLag, T_1: 1000 s, u: 1}}
  {delay}
  i: {{is: Integrator, k: 1 1/s, u: "=exp(-(({y} - 0.5)/{width})**2)"}}
initial: {{l.y: 0, i.y: 0}}
simulate: {{until: 4000 s}}
"""
ROOT_PI = float(np.sqrt(np.pi))
BELL = "1e4 N*exp(-((x.x - {} m)/1 mm)**2)"


@pytest.mark.parametrize(("force", "work"), [
    ("=1e4 N*max(0, 1 - abs(x.x - 1000 m)/1 mm)", 10.0),
    ("=if_else(x.x > 1000 m and x.x < 1000.001 m, 1e4 N, 0 N)", 10.0),
    ("=1e4 N/(1 + ((x.x - 1000 m)/1 mm)**2)", 10 * np.pi),
    ("=1e4 N*(tanh((x.x - 1000 m)/1 mm) - tanh((x.x - 1000.01 m)/1 mm))", 200.0),
    (f"={BELL.format(1000)}", 10 * ROOT_PI),
    (f"={' + '.join(BELL.format(at) for at in (300, 700, 1100))}", 30 * ROOT_PI)])
def test_a_force_over_a_millimetre_of_a_path_of_two_kilometres_acts(force: str, work: float) -> None:
    run = hb.simulate(hb.loads(TRACK.format(force=force, more="")))
    # of a discontinuous force the integrator finds the edges to a thousandth of its work
    assert run["x.v"][-1]**2 - 100 == pytest.approx(2 * work, rel=2e-3 if "if_else" in force else 1e-4)
    assert run.verdict.status == "clean"


@pytest.mark.parametrize("every", ["0.2 s", "1/7 s", "20 s"])
def test_a_narrow_force_does_not_depend_on_the_output_points(every: str) -> None:
    step = every if "/" not in every else f"{1 / 7!r} s"
    run = hb.simulate(hb.loads(TRACK.format(force=f"={BELL.format(1000)}", more=f", every: {step}")))
    assert run["x.v"][-1]**2 - 100 == pytest.approx(20 * ROOT_PI, rel=1e-4)


@pytest.mark.parametrize("solver", ["idas", "cvodes"])
def test_every_solver_meets_a_narrow_force(solver: str) -> None:
    run = hb.simulate(hb.loads(TRACK.format(force=f"={BELL.format(1000)}", more="")), solver=solver)
    assert run["x.v"][-1]**2 - 100 == pytest.approx(20 * ROOT_PI, rel=1e-4)


@pytest.mark.parametrize(("y", "delay"), [("l.y", ""), ("d.y", 'd: {is: Delay, T: 100 s, u: "=l.y"}')])
@pytest.mark.parametrize("width", [1e-3, 1e-6])
def test_a_narrow_function_of_a_lagging_or_delayed_state_is_integrated(y: str, delay: str, width: float) -> None:
    run = hb.simulate(hb.loads(LAG.format(y=y, delay=delay, width=width)))
    assert run["i.y"][-1] == pytest.approx(2000 * ROOT_PI * width, rel=1e-4)


def test_a_smooth_machine_is_run_once() -> None:
    run = hb.simulate(hb.loads(TRACK.format(force="=-1e-3 N*abs(x.v)*x.v/1 m**2*1 s**2 - 0.1 N/m*x.x", more="")))
    assert "stepped_over" not in run.statistics and run.events == []


def test_sensitivities_of_a_narrow_force_are_those_of_its_work() -> None:
    text = TRACK.format(force="=F*exp(-((x.x - 1000 m)/1 mm)**2)", more="").replace(
        "components:", "parameters: {F: 1e4 N}\ncomponents:")
    run = hb.simulate(hb.loads(text), sensitivities=["F"])
    speed = np.sqrt(100 + 20 * ROOT_PI)
    assert run.sensitivity("x.v", "F")[-1] == pytest.approx(ROOT_PI * 1e-3 / speed, rel=1e-3)
