"""Wrong values of what a diagram holds fixed, also where the model runs away from its record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.diagnosis.candidates.fixed_values import fixed_values
from heavebond.estimation.experiment import load_experiment

LIFT = """\
model: lift
parameters: {m_load: LOAD, spare: 3 kg}
components:
  rope:   {is: ForceSource, u: "=HOLD + 300 N*sin(2*pi*time/SLOW)"}
  load:   {is: Mass, m: =m_load}
  weight: {is: Weight, m: =m_load}
  guide:  {is: Damper, d: 40 N*s/m}
  shaft:  {is: Fixed}
nodes:
  hook:  [rope.a, load.a, weight.a, guide.b]
  shaft: [shaft.a, guide.a]
initial: {hook.x: 0 m, hook.v: 0 m/s}
show: {pull: {is: rope.u, unit: N}, hook: {is: hook.x, unit: mm}}
simulate: {until: 10 s, every: 20 ms}
"""
MEASURED = """\
experiment: lift measured
model: lift.yaml
records:
  one: {file: one.csv, use: fit}
  two: {file: two.csv, use: validate}
time: {column: t, unit: s}
inputs:
  rope.u: {column: pull, unit: N, interpolation: spline}
outputs:
  hook.x: {column: hook, unit: mm, noise: 0.5 mm}
free:
  guide.d: 40 N*s/m +- 20 %
"""


def lift(slow: str, load: str = "460 kg") -> str:
    """The lift, held by the force that 460 kg need."""
    return LIFT.replace("LOAD", load).replace("HOLD", "460 kg*9.81 m/s**2").replace("SLOW", f"({slow})")


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    """Records of a lift with 460 kg, and a diagram that holds 400 kg under `parameters:`, for its mass and its weight."""
    rng = np.random.default_rng(3)
    for name, slow in (("one", "3.1 s"), ("two", "2.3 s")):
        run = hb.simulate(hb.loads(lift(slow)))
        columns = [run.time, run.display["pull"], run.display["hook"] + 0.5 * rng.standard_normal(len(run.time))]
        np.savetxt(tmp_path / f"{name}.csv", np.array(columns).T, delimiter=",", comments="", header="t,pull,hook")
    (tmp_path / "lift.yaml").write_text(lift("3 s", "400 kg"), encoding="utf-8")
    (tmp_path / "measured.yaml").write_text(MEASURED, encoding="utf-8")
    return tmp_path / "measured.yaml"


def test_parameters_of_the_diagram_are_tried(experiment: Path) -> None:
    """Those that a part uses, in place of the numbers that follow from them."""
    found = {c.name: c for c in fixed_values(load_experiment(experiment))}
    assert {"m_load", "weight.g"} <= set(found) and not {"spare", "load.m", "weight.m", "guide.d"} & set(found)
    assert found["m_load"].where == ("load", "weight") and found["m_load"].numbers[0].neutral == 400


@pytest.mark.long
def test_a_model_that_runs_away_is_fitted_and_diagnosed(experiment: Path) -> None:
    """60 kg too little lift it by tens of metres: more than ten thousand standard deviations, and a run for all that."""
    fitted = hb.fit(experiment)
    assert fitted.before.records["one"].chi2 > 1e8 and fitted.chi2 > 5e7
    found = hb.diagnose(experiment, classes=["value of a parameter"], number=1)
    assert found.verdict == "parameters"
    assert found.words[0].startswith("Parameters, not physics: with m_load at 460 kg (in the diagram 400 kg)")
    assert found.ladder[-1].chi2_held_out < 1.2
