"""Effects that a diagram cannot hold at amplitude zero: a pressure loss between two volumes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from heavebond.diagnosis.answer.sentences import broken_candidates
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.scoring import HIGHEST, LOWEST, from_finite_amplitudes
from heavebond.diagnosis.search.step import fitted_base, make_stage
from heavebond.estimation.experiment import Experiment, load_experiment

DIAGRAM = """
model: block with a bottle
components:
  pump: {is: FlowSource, u: 0}
  tank: {is: Tank}
  block: {is: Volume, V: 2 L, beta: 8000 bar}
  bottle: {is: Volume, V: 5 L, beta: 8000 bar}
  outlet: {is: LineResistance, R: 3e10 Pa*s/m**3}
nodes:
  line: [pump.a, block.a, bottle.a, outlet.a]
  return: [tank.a, outlet.b]
initial: {line.p: 60 bar}
"""
EXPERIMENT = """
experiment: bottle
model: rig.yaml
records: {a: {file: a.csv, use: fit}, b: {file: b.csv, use: validate}}
time: {column: t, unit: s}
inputs: {pump.u: {column: q, unit: L/min, interpolation: linear}}
outputs: {line.p: {column: p, unit: bar, noise: 0.3 bar}}
free: {outlet.R: 3e10 Pa*s/m**3 +- 30 %}
"""
LOSS = 8e9  # Pa*s/m**3, in the neck of the bottle
LABEL = "LineResistance between line and bottle.a"


@pytest.fixture(scope="module")
def bottle(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Records of V p' = beta (sum of flows) for the block and the bottle, by SciPy."""
    folder = tmp_path_factory.mktemp("bottle")
    (folder / "rig.yaml").write_text(DIAGRAM)
    (folder / "measured.yaml").write_text(EXPERIMENT)
    t, knots = np.linspace(0.0, 4.0, 201), np.linspace(0.0, 4.0, 21)
    for name, seed in (("a", 1), ("b", 2)):
        random = np.random.default_rng(seed)
        q = np.interp(t, knots, random.uniform(4.0, 20.0, len(knots)))

        def rates(now: float, p: np.ndarray, q: np.ndarray = q) -> list[float]:
            through = (p[0] - p[1]) / LOSS
            return [(np.interp(now, t, q) / 6e4 - p[0] / 3.3e10 - through) * 8e8 / 2e-3, through * 8e8 / 5e-3]

        p = solve_ivp(rates, (0.0, 4.0), [60e5, 60e5], t_eval=t, rtol=1e-8, atol=1.0, max_step=0.02).y[0] / 1e5
        rows = np.column_stack([t, q, p + random.normal(0.0, 0.3, len(t))])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="t,q,p", comments="")
    return load_experiment(folder / "measured.yaml")


@pytest.fixture(scope="module")
def base(bottle: Experiment) -> Base:
    return fitted_base(bottle)


def candidate(base: Base, label: str = LABEL) -> Candidate:
    return next(c for c in single_candidates(base.problem.experiment) if c.label == label)


@pytest.mark.long
def test_a_pressure_loss_between_two_volumes_is_found(bottle: Experiment) -> None:
    step = make_stage(bottle, number=1, classes=("line resistance", "line inertance"))
    assert step.chosen is not None and step.chosen.candidate.label == LABEL
    assert LABEL not in step.broken
    assert step.chi2_fit > 10 > 1.25 > step.chosen.chi2_fit  # 201 samples: 1 +- 0.1
    assert step.chosen.values["line_resistance.R"] == pytest.approx(LOSS, rel=0.1)
    assert step.chosen.values["outlet.R"] == pytest.approx(3.3e10, rel=0.02)


def test_its_range_is_that_of_the_place(base: Base) -> None:
    """X/Y and X/Y**2 of the pressures of the node and the flows into the bottle."""
    found = from_finite_amplitudes(base, candidate(base))
    assert found is not None and not found.vanishes
    spans = {n.unit.text: n.sought.range for n in found.numbers if n.sought is not None and n.sought.range is not None}
    laminar, turbulent = spans["Pa*s/m**3"], spans["Pa*s**2/m**6"]
    assert laminar.high / laminar.low == pytest.approx(HIGHEST / LOWEST) == turbulent.high / turbulent.low
    assert 0 < laminar.low < LOSS < laminar.high
    flow = laminar.high / turbulent.high  # the largest into the bottle, below that of the pump
    assert 1e-5 < flow < 20 / 6e4


def test_what_is_no_loss_in_series_keeps_its_zero(base: Base) -> None:
    leak = next(c for c in single_candidates(base.problem.experiment) if c.kind == "leakage")
    assert from_finite_amplitudes(base, leak) is None


def test_what_cannot_be_simulated_is_told_where_the_answer_leaves_something_open() -> None:
    left: Any = SimpleNamespace(significant=True)
    step: Any = SimpleNamespace(broken=(LABEL,), left=left)
    (line,) = broken_candidates("mainly", [step])
    assert line.startswith(f"Not tried, as the diagram with it cannot be simulated: {LABEL}.")
    assert broken_candidates("effect", [step]) == [] == broken_candidates("mainly", [SimpleNamespace(broken=(), left=left)])
