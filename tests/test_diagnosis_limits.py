"""What records of real machines do to a search: runs that diverge, channels that move one way, and values that are wrong."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import heavebond as hb
from heavebond.diagnosis.answer.sentences import better_values, opposite_signs
from heavebond.diagnosis.candidates.catalogue import UNKNOWN, Candidate
from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.search.refit import at_end_of, begun, borrowed, refitted_at
from heavebond.diagnosis.search.scoring import scored
from heavebond.diagnosis.search.step import _of_one_time, _step, fitted_base, make_value_stage
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


def test_a_curve_over_a_channel_that_moves_one_way_is_one_over_time(tmp_path: Path) -> None:
    """In a coast-down every speed occurs once, so that a curve of the sensor over the speed could be any curve over time."""
    t = np.linspace(0, 20, 101)
    noise = np.random.default_rng(1).normal(0, 0.02, len(t))
    pd.DataFrame({"t": t, "v": 8 - 0.3 * t + noise}).to_csv(tmp_path / "one.csv", index=False)
    written(tmp_path, "coast.yaml", COAST)
    experiment = load_experiment(written(tmp_path, "coasted.yaml", COASTED))
    base = fitted_base(experiment)
    curve, *others = sorted((c for c in candidates(experiment) if c.kind == UNKNOWN), key=lambda c: not c.curve_of_channel)

    def excluded(candidate: Candidate, held_out: float) -> bool:
        trial: Any = SimpleNamespace(candidate=candidate, chi2_fit=2.0, chi2_held_out=held_out)
        return _of_one_time(trial, base)

    assert excluded(curve, 9.0) and not excluded(curve, 7.0) and not excluded(curve, np.nan)
    assert others and not any(excluded(candidate, 9.0) for candidate in others)


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


SWING = """
model: swing
components:
  rod:    {is: Inertia, J: 7.2e-3 kg*m**2}
  weight: {is: ArmWeight, m: 0.107 kg, l: 0.23 m}
  frame:  {is: FixedShaft}
nodes:
  pivot: [rod.a, weight.a]
  frame: [frame.a]
initial: {pivot.phi: 0.9 rad, pivot.w: 0 rad/s}
simulate: {until: 20 s, every: 50 ms}
"""
SWUNG = """
experiment: swung
model: swing.yaml
records: {one: {file: swing.csv, use: fit}}
time: {column: time, unit: s}
outputs: {pivot.phi: {column: pivot.phi, unit: rad, noise: 2 mrad}}
free: {rod.J: 6.6e-3 .. 7.6e-3 kg*m**2}
"""


def test_a_refit_out_of_phase_begins_again_from_the_free_parameters_of_a_better_law(tmp_path: Path) -> None:
    """Dry friction of a pendulum whose refit ended several swings out of phase, beside damping that is in phase."""
    written(tmp_path, "swing.yaml", SWING)
    truth = SWING.replace("model: swing", "model: truth").replace(
        "  frame:  {is: FixedShaft}", "  frame:  {is: FixedShaft}\n"
        "  dry:    {is: RotationalCoulombFriction, M_c: 2 mN*m}").replace("weight.a]", "weight.a, dry.a]").replace(
        "[frame.a]", "[frame.a, dry.b]")
    run = hb.simulate(written(tmp_path, "truth.yaml", truth))
    noise = np.random.default_rng(1).normal(0, 2e-3, len(run.time))
    pd.DataFrame({"time": run.time, "pivot.phi": run["pivot.phi"] + noise}).to_csv(tmp_path / "swing.csv", index=False)
    base = fitted_base(load_experiment(written(tmp_path, "swung.yaml", SWUNG)))
    found = {c.component: c for c in candidates(base.problem.experiment) if set(c.where) == {"frame", "pivot"}}
    dry, damper = found["RotationalCoulombFriction"], found["RotationalDamper"]
    guesses = scored(base, dry)
    lender = refitted_at(base, damper, {"rotational_damper.d": 2e-4, "rod.J": 7.2e-3}, {})
    first = begun(base, dry, guesses)
    assert lender is not None and first is not None
    away = first.inner.copy()
    away[0] = base.problem.columns[0].inner(6.7e-3)
    wrong = at_end_of(base, dry, guesses, {n.name: (0.0, first.experiment.free[n.name].range.high) for n in dry.numbers
                                           if n.amplitude}, away)
    right = borrowed(base, wrong, guesses, lender)
    assert wrong.chi2_fit > 1000 and right.chi2_fit < 1.2
    assert right.values["rotational_coulomb_friction.M_c"] == pytest.approx(2e-3, rel=0.02)


RIG = """
model: rig
components:
  machine: {is: PositionSource, u: 0 m}
  cell:    {is: ForceSensor}
  piston:  {is: ForceSource, u: 100 N}
nodes:
  jaw: [machine.a, cell.a]
  rod: [cell.b, piston.a]
simulate: {until: 4 s}
"""
PULLED = """
experiment: pulled
model: rig.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
inputs: {machine.u: {column: x, unit: m, interpolation: linear}}
outputs: {cell.y: {column: F, unit: N, noise: 0.1 N}}
"""


def test_friction_of_the_wrong_sign_points_to_the_sign_of_an_input(tmp_path: Path) -> None:
    """The displacement counts the other way, so that the friction of the rod seems to give energy."""
    t = np.linspace(0, 4, 401)
    friction = 5 * np.sign(np.cos(np.pi * t)) + np.random.default_rng(1).normal(0, 0.1, len(t))
    written(tmp_path, "rig.yaml", RIG)
    path = written(tmp_path, "pulled.yaml", PULLED)
    hints = []
    for sign in (1, -1):
        pd.DataFrame({"t": t, "x": -sign * 0.02 * np.sin(np.pi * t), "F": 100 + friction}).to_csv(
            tmp_path / "one.csv", index=False)
        experiment = load_experiment(path)
        laws = [c for c in candidates(experiment) if c.where == ("rod",)
                and c.component in ("CoulombFriction", "Damper", "Spring")]
        stage = _step(experiment, laws, 1, 60.0, lambda text: None)
        hints.append(opposite_signs(stage, experiment))
    assert not hints[0]
    assert hints[1][0].startswith("Dry friction between rod and the surroundings of the opposite sign") \
        and "the measured input machine.u (`factor: -1`)" in hints[1][0]


def test_a_value_that_predicts_better_than_the_first_effect_is_reported(tmp_path: Path) -> None:
    """The moment of inertia is 15 % above the value in the diagram; friction is missing too, so that no value alone is the
    answer."""
    written(tmp_path, "swing.yaml", SWING.replace("0.9 rad", "0.3 rad"))
    t = np.linspace(0, 8, 161)
    swing = 0.3 * np.exp(-0.02 * t) * np.cos(np.sqrt(0.107 * 9.81 * 0.23 / (1.15 * 7.2e-3)) * t)
    noise = np.random.default_rng(1).normal(0, 2e-3, len(t))
    pd.DataFrame({"time": t, "pivot.phi": swing + noise}).to_csv(tmp_path / "swing.csv", index=False)
    experiment = load_experiment(written(tmp_path, "swung.yaml", SWUNG.split("free:")[0]))
    laws = [c for c in candidates(experiment) if set(c.where) == {"frame", "pivot"}
            and c.component in ("RotationalDamper", "TorsionSpring")]
    first = _step(experiment, laws, 1, 60.0, lambda text: None)
    values = make_value_stage(experiment, number=1, seconds=60.0)
    (words,) = better_values(values, first, ())
    named = {name for name in ("rod.J", "weight.m", "weight.l", "weight.g") if name in words}
    assert words.startswith("Without any effect, ") and "rod.J" in named and len(named) == 4, words
    assert better_values(values, first, tuple(named)) == []
