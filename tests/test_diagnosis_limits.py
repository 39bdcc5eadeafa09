"""What records of real machines do to a search: runs that diverge, channels that move one way, and values that are wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.search.step import _courses, _meaningless, fitted_base
from heavebond.estimation.experiment import load_experiment
from heavebond.estimation.residuals import BROKEN, Residuals

COAST = """
model: coast
components:
  car:  {is: Mass, m: 80 kg}
  air:  {is: Drag, d_2: 0.05 N*s**2/m**2}
  road: {is: Fixed}
nodes:
  car:  [car.a, air.b]
  road: [road.a, air.a]
initial: {car.x: 0 m, car.v: 8 m/s}
simulate: {until: 1 s}
"""
COASTED = """
experiment: coasted
model: coast.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
outputs: {car.v: {column: v, unit: m/s, noise: 0.02 m/s}}
free: {air.d_2: 0.02 .. 0.2 N*s**2/m**2}
"""


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text.lstrip(), encoding="utf-8")
    return path


def test_a_curve_over_a_channel_that_moves_one_way_is_no_candidate(tmp_path: Path) -> None:
    """In a coast-down every speed occurs once, so that a curve of the sensor over the speed could be any curve over time."""
    t = np.linspace(0, 20, 101)
    noise = np.random.default_rng(1).normal(0, 0.02, len(t))
    pd.DataFrame({"t": t, "v": 8 - 0.3 * t + noise}).to_csv(tmp_path / "one.csv", index=False)
    written(tmp_path, "coast.yaml", COAST)
    experiment = load_experiment(written(tmp_path, "coasted.yaml", COASTED))
    base = fitted_base(experiment)
    (curve,) = [c for c in candidates(experiment) if c.curve_of_channel]
    assert "most values only once" in _meaningless(curve, base, _courses(base)[0])
    others = [c for c in candidates(experiment) if c.kind == curve.kind and c.attaches == "across"]
    assert others and not any("channel" in _meaningless(c, base, _courses(base)[0]) for c in others)


def test_a_run_whose_derivatives_overflow_when_squared_has_failed(tmp_path: Path) -> None:
    """The derivatives of an unstable or chaotic machine grow without limit; their squares must not reach the algebra."""
    t = np.linspace(0, 1, 11)
    pd.DataFrame({"t": t, "y": np.exp(t)}).to_csv(tmp_path / "grown.csv", index=False)
    written(tmp_path, "growth.yaml", """
        model: growth
        components: {grow: {is: Integrator, k: 1 1/s}}
        nodes: {y: [grow.y, grow.u]}
        initial: {grow.y: 1}
        simulate: {until: 1 s}
        """.replace("\n        ", "\n"))
    experiment = load_experiment(written(tmp_path, "grown.yaml", """
        experiment: grown
        model: growth.yaml
        records: {one: {file: grown.csv, use: fit}}
        time: {column: t, unit: s}
        outputs: {grow.y: {column: y, unit: 1, noise: 0.01}}
        free: {grow.k: 0 .. 600 1/s}
        """.replace("\n        ", "\n")))
    problem = Residuals(experiment)
    r, slopes = problem.evaluate(np.array([problem.columns[0].inner(500.0)]))   # up to exp(500) = 1e217
    assert np.all(r >= BROKEN) and not slopes.any()
    r, slopes = problem.evaluate(np.array([problem.columns[0].inner(1.0)]))
    assert np.abs(r).max() < 1 and slopes.any()
