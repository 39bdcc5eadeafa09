"""Effects hidden in oscillators whose records are made here by SciPy from the equations: each is refitted to the noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import heavebond as hb
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.diagnose import diagnose
from heavebond.diagnosis.search.base_model import Base, searched
from heavebond.diagnosis.search.refit import Refit, begun, followed
from heavebond.diagnosis.search.schedule import planned
from heavebond.diagnosis.search.scoring import scored
from heavebond.diagnosis.search.step import _reverses, fitted_base, retraced
from heavebond.estimation.comparison import compare
from heavebond.estimation.experiment import load_experiment
from heavebond.language.edits import Change
from heavebond.numerics.dae import Array

STEP, SAMPLES = 0.02, 800
Equations = Callable[[float, Array, float], list[float]]  # time, states, input: derivatives

OSCILLATOR = """model: rig
components:
  force:  {is: ForceSource, u: "=30 N*sin(6 rad/s*time)"}
  mass:   {is: Mass, m: 3 kg}
  spring: {is: Spring, c: 600 N/m}
  damper: {is: Damper, d: 22 N*s/m}
  wall:   {is: Fixed}
nodes:
  load: [force.a, mass.a, spring.b, damper.b]
  wall: [wall.a, spring.a, damper.a]
initial: {load.x: 0 m, load.v: 0 m/s}
show: {load.x: {unit: mm}}
simulate: {until: 16 s, every: 20 ms}
"""
PULLED = """experiment: pulled
model: rig.yaml
records:
  train: {file: train.csv, use: fit}
  check: {file: check.csv, use: validate}
time: {column: t, unit: s}
inputs: {force.u: {column: u, unit: N, interpolation: spline}}
outputs: {load.x: {column: y, unit: mm, noise: 0.2 mm}}
free: {spring.c: 600 N/m +- 10 %, damper.d: 22 N*s/m +- 20 %}
"""


def drawn(seed: int, largest: float) -> tuple[Array, Array]:
    """Times (N,) and an input of twelve sines (N,) from 0.1 to 2 Hz that begins softly."""
    rng, t = np.random.default_rng(seed), STEP * np.arange(SAMPLES)
    u = np.sin(2 * np.pi * np.linspace(0.1, 2.0, 12)[:, None] * t + rng.uniform(0, 2 * np.pi, (12, 1))).sum(axis=0)
    u *= 1 - np.exp(-t**3)
    return t, largest * u / np.abs(u).max()


def recorded(folder: Path, rig: str, experiment: str, truth: Equations, states: int, sizes: Mapping[str, float],
             noise: float, scale: float) -> Path:
    """The experiment on records of a machine: the first state, times `scale`, with noise."""
    from scipy.interpolate import CubicSpline

    (folder / "rig.yaml").write_text(rig)
    (folder / "pulled.yaml").write_text(experiment)
    for seed, (name, size) in enumerate(sizes.items()):
        t, u = drawn(seed, size)
        force = CubicSpline(t, u)
        run = solve_ivp(lambda s, x, force=force: truth(s, x, float(force(s))), (0, t[-1]), np.zeros(states), t_eval=t,
                        method="LSODA", rtol=1e-8, atol=1e-10, max_step=STEP)
        y = scale * run.y[0] + noise * np.random.default_rng(100 + seed).standard_normal(len(t))
        np.savetxt(folder / f"{name}.csv", np.stack([t, u, y], 1), delimiter=",", header="t,u,y", comments="")
    return folder / "pulled.yaml"


def refitted(path: Path, label: str) -> Refit:
    """One candidate after its refit."""
    base = fitted_base(load_experiment(path))
    candidate = next(c for c in single_candidates(base.problem.experiment) if c.label == label)
    guesses = scored(base, candidate)
    first = begun(base, candidate, guesses)
    assert first is not None
    return followed(base, first, guesses)


def test_a_stop_that_no_record_of_the_fit_reaches_stands_nowhere_else(tmp_path: Path) -> None:
    """A buffer at -60 mm only. The other end of the stroke moves further in the record that checks than in the one that is
    fitted: no stop may be left standing there."""
    def truth(_: float, x: Array, force: float) -> list[float]:
        return [x[1], (force - 600 * x[0] - 22 * x[1] - 2e4 * min(x[0] + 0.06, 0.0)) / 3]

    path = recorded(tmp_path, OSCILLATOR, PULLED, truth, 2, {"train": 55.0, "check": 75.0}, 0.2, 1e3)
    found = refitted(path, "EndStop between wall and load")
    # 800 samples: reduced chi-square is 1 +- 0.05
    assert found.chi2_fit < 1.2 and found.chi2_held_out < 1.2
    assert np.isclose(found.values["end_stop.x_min"], -0.06, atol=1e-3)


def test_a_channel_is_in_its_own_unit_however_the_diagram_shows_it(tmp_path: Path) -> None:
    """An output that the diagram shows under the name of a variable, in another unit, is no other variable."""
    path = recorded(tmp_path, OSCILLATOR, PULLED, lambda _, x, force: [x[1], (force - 600 * x[0] - 22 * x[1]) / 3], 2,
                    {"train": 50.0, "check": 30.0}, 0.2, 1e3)
    assert "show: {load.x: {unit: mm}}" in OSCILLATOR
    found = compare(load_experiment(path)).records["check"].channels["load.x"]
    assert 0.8 < found.chi2 < 1.2  # 800 samples: 1 +- 0.05
    assert fitted_base(load_experiment(path)).cost < 1.2 * SAMPLES


DRUM = """model: rig
components:
  torque:  {is: TorqueSource, u: "=5 N*m*sin(1 rad/s*time)"}
  drum:    {is: Inertia, J: 0.9 kg*m**2}
  bearing: {is: RotationalDamper, d: 1.1 N*m*s/rad}
  frame:   {is: FixedShaft}
nodes:
  shaft: [torque.a, drum.a, bearing.b]
  frame: [bearing.a, frame.a]
initial: {shaft.phi: 0 rad, shaft.w: 0 rad/s}
show: {shaft.phi: {unit: deg}}
simulate: {until: 16 s, every: 20 ms}
"""
TURNED = """experiment: turned
model: rig.yaml
records:
  train: {file: train.csv, use: fit}
  check: {file: check.csv, use: validate}
time: {column: t, unit: s}
inputs: {torque.u: {column: u, unit: N*m, interpolation: spline}}
outputs: {shaft.phi: {column: y, unit: deg, noise: 0.3 deg}}
free: {drum.J: 0.9 kg*m**2 +- 10 %, bearing.d: 1.1 N*m*s/rad +- 20 %}
"""


def test_a_weight_off_the_axis_is_found_from_afar(tmp_path: Path) -> None:
    """Without it the drum turns on where it should swing to and fro: no tangent tells the size, the sign or the angle."""
    def truth(_: float, x: Array, torque: float) -> list[float]:
        return [x[1], (torque - 1.15 * x[1] - 3.2 * np.sin(x[0] + 0.6)) / 0.92]

    path = recorded(tmp_path, DRUM, TURNED, truth, 2, {"train": 11.0, "check": 9.0}, 0.3, 180 / np.pi)
    found = refitted(path, "Unbalance on shaft")
    assert found.chi2_fit < 1.2 and found.chi2_held_out < 1.2  # 1 +- 0.05
    assert np.isclose(abs(found.values["unbalance.M"]), 3.2, rtol=0.02)


@pytest.mark.long
def test_hysteresis_of_the_published_benchmark_is_fitted_to_the_noise(tmp_path: Path) -> None:
    """J. P. Noel, M. Schoukens (2016): m 2 kg, c 10 N s/m, k 50 kN/m, alpha 50 kN/m, beta 1e3, gamma 0.8, delta -1.1, nu 1;
    here of a machine that is a hundred times as soft, over a way a hundred times as long."""
    def truth(_: float, x: Array, force: float) -> list[float]:
        y, v, z = x
        return [v, (force - 500 * y - 10 * v - z) / 2, 500 * v - 8 * abs(v) * z + 11 * v * abs(z)]

    rig = OSCILLATOR.replace("m: 3 kg", "m: 2 kg").replace("c: 600 N/m", "c: 500 N/m").replace("d: 22", "d: 10")
    asked = PULLED.replace("spring.c: 600 N/m", "spring.c: 500 N/m").replace("damper.d: 22", "damper.d: 10")
    path = recorded(tmp_path, rig, asked, truth, 3, {"train": 60.0, "check": 50.0}, 0.2, 1e3)
    found = refitted(path, "HardeningHysteresis between wall and load")
    assert found.chi2_fit < 1.2 and found.chi2_held_out < 1.2  # 1 +- 0.05
    # gamma and delta over alpha: the loop is open over 1/8 m
    assert np.isclose(found.values["hardening_hysteresis.x_l"], 1 / 8, rtol=0.1)
    assert np.isclose(found.values["hardening_hysteresis.h"], -1.1 / 0.8, rtol=0.1)


@pytest.mark.long
def test_what_the_integrator_errs_by_is_no_missing_effect(tmp_path: Path) -> None:
    """A shaft that turns thirty thousand times its noise: at the tolerances with which a search begins, its angle drifts by
    more than the noise."""
    path = recorded(tmp_path, DRUM, TURNED.replace("0.3 deg", "0.01 deg"), lambda _, x, torque: [
        x[1], (torque - 1.15 * x[1]) / 0.92], 2, {"train": 11.0, "check": 9.0}, 0.01, 180 / np.pi)
    problem = searched(load_experiment(path))
    assert Base.at(problem, problem.start).rough
    base = fitted_base(problem.experiment)
    assert not base.rough
    assert base.cost < 1.2 * SAMPLES  # 800 samples: 1 +- 0.05 each
    scores = [score for c in single_candidates(problem.experiment) for score in scored(base, c)
              if c.label in ("Unbalance on shaft", "CubicTorsionSpring between frame and shaft")]
    assert scores and max(score.gain for score in scores) < 20  # 4.5 standard deviations


def test_a_cubic_spring_is_sought_where_the_spring_moves(tmp_path: Path) -> None:
    def truth(_: float, x: Array, force: float) -> list[float]:
        return [x[1], (force - 600 * x[0] - 22 * x[1] - 6e4 * x[0]**3) / 3]

    path = recorded(tmp_path, OSCILLATOR, PULLED, truth, 2, {"train": 55.0, "check": 45.0}, 0.2, 1e3)
    found = refitted(path, "CubicSpring between wall and load")
    assert found.chi2_fit < 1.2 and found.chi2_held_out < 1.2  # 1 +- 0.05
    assert np.isclose(found.values["cubic_spring.c_3"], 6e4, rtol=0.1)
    sought = found.experiment.free["cubic_spring.l0"].range
    assert -0.5 < sought.low < -0.05 and 0.05 < sought.high < 0.5  # it swings by some 0.1 m


def test_every_class_has_its_turn_before_any_has_a_second_one(tmp_path: Path) -> None:
    """A search may be ended early."""
    path = recorded(tmp_path, OSCILLATOR, PULLED, lambda _, x, force: [x[1], (force - 700 * x[0] - 30 * x[1]) / 3], 2,
                    {"train": 50.0, "check": 30.0}, 0.2, 1e3)
    base = fitted_base(load_experiment(path))
    wanted = ("dry friction", "quadratic damping", "constant force")
    found = [c for c in single_candidates(base.problem.experiment) if c.kind in wanted and c.component != "LuGreFriction"]
    jobs, *_ = planned([score for c in found for score in scored(base, c)], {})
    kinds = [c.kind for c, _ in jobs]
    assert set(kinds[:3]) == set(wanted) and kinds.count("dry friction") > 1


DISC = """model: disc
components:
  motor:   {is: TorqueSource, u: 0 N*m}
  disc:    {is: Inertia, J: 24 kg*cm**2}
  bearing: {is: RotationalDamper, d: 0.01 N*m*s/rad}
  frame:   {is: FixedShaft}
nodes:
  shaft: [motor.a, disc.a, bearing.b]
  frame: [frame.a, bearing.a]
initial: {shaft.phi: 0 deg, shaft.w: 0 rad/s}
"""
DISC_TURNED = """experiment: turned
model: disc.yaml
records:
  one: {file: one.csv, use: fit}
  two: {file: two.csv, use: validate}
time: {column: t, unit: s}
inputs: {motor.u: {column: torque, unit: mN*m, interpolation: spline}}
outputs: {shaft.phi: {column: angle, unit: deg, noise: 0.1 deg}}
free: {disc.J: 24 kg*cm**2 +- 15 %, bearing.d: 0.001 .. 0.1 N*m*s/rad}
"""


@pytest.mark.long
def test_an_effect_that_is_absent_where_its_refit_ends_is_not_named(tmp_path: Path) -> None:
    """A disc with a weight off its axis that is turned over: the refit with the weight ends in a valley far above the noise,
    and one with a spring beside it finds the way out, with no spring at all."""
    (tmp_path / "disc.yaml").write_text(DISC)
    (tmp_path / "turned.yaml").write_text(DISC_TURNED)
    for name, seed, size in (("one", 1, 0.25), ("two", 2, 0.3)):
        random, t = np.random.default_rng(seed), np.arange(0, 15, 0.004)
        f, start = random.uniform(0.1, 4, 12), random.uniform(0, 2 * np.pi, 12)

        def torque(at: Array | float, f: Array = f, start: Array = start, size: float = size) -> Array:
            return np.asarray(size / np.sqrt(12) * np.sin(2 * np.pi * np.multiply.outer(at, f) + start).sum(axis=-1))

        def rates(at: float, y: Array, torque: Callable[[float], Array] = torque) -> list[float]:
            return [y[1], (float(torque(at)) - 0.012 * y[1] - 0.08 * np.sin(y[0])) / 2.4e-3]

        run = solve_ivp(rates, (0, 15), [0, 0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.004)
        angle = np.degrees(run.y[0]) + 0.1 * np.random.default_rng(seed + 10).standard_normal(len(t))
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([t, 1e3 * torque(t), angle]), delimiter=",",
                   header="t,torque,angle", comments="", fmt="%.8g")
    found = diagnose(load_experiment(tmp_path / "turned.yaml"), number=1, classes=("unbalance", "stiffness"))
    assert [f.kinds for f in found.findings] == [("unbalance",)]
    assert found.ladder[-1].chi2_held_out < 1.1  # 3750 samples: 1 +- 0.023
    assert found.findings[0].fit.values["unbalance.M"] == pytest.approx(0.08, rel=1e-3)


@pytest.mark.parametrize(("torque", "turns"), [("0.2 N*m*sin(3*time/(1 s))", True), ("0.2 N*m", False)])
def test_a_motion_that_turns_back_is_seen_without_a_position(tmp_path: Path, torque: str, turns: bool) -> None:
    """No equation of this diagram uses the angle of the shaft."""
    (tmp_path / "shaft.yaml").write_text("""model: shaft
components:
  motor: {is: TorqueSource, u: "=TORQUE"}
  wheel: {is: Inertia, J: 0.01 kg*m**2}
  oil:   {is: RotationalDamper, d: 0.05 N*m*s/rad}
  frame: {is: FixedShaft}
nodes: {shaft: [motor.a, wheel.a, oil.a], frame: [oil.b, frame.a]}
initial: {shaft.w: 0 rad/s}
show: {w: {is: shaft.w, unit: rad/s}, u: {is: motor.u, unit: N*m}}
simulate: {until: 4 s, every: 20 ms}
""".replace("TORQUE", torque))
    run = hb.simulate(hb.load(tmp_path / "shaft.yaml"))
    rows = np.column_stack([run.time, np.asarray(run["u"]), np.asarray(run["w"])])
    np.savetxt(tmp_path / "rec.csv", rows, delimiter=",", header="t,u,w", comments="")
    (tmp_path / "e.yaml").write_text("""experiment: shaft
model: shaft.yaml
records: {a: {file: rec.csv, use: fit}}
time: {column: t, unit: s}
inputs: {motor.u: {column: u, unit: N*m, interpolation: linear}}
outputs: {shaft.w: {column: w, unit: rad/s, noise: 0.01 rad/s}}
free: {oil.d: 0.05 N*m*s/rad +- 20 %}
""")
    base = fitted_base(hb.load_experiment(tmp_path / "e.yaml"))
    candidate = Candidate("n", "C", "", "", "", ("shaft", "frame"), Change(), (), "across")
    assert _reverses(candidate, base) == turns


def test_positions_that_are_passed_once_decide_nothing_about_a_curve_over_the_position() -> None:
    """A shaft that turns one way, and one that is turned the other way in another record, pass each angle once: a curve over
    the angle is one over time."""
    t = np.linspace(0.0, 10.0, 400)
    assert not retraced([100 * t])
    assert not retraced([100 * t, -80 * t])
    assert retraced([np.sin(t)])
    assert retraced([100 * t, 90 * t])  # two records over the same angles
    assert not retraced([np.r_[t, 10 - 0.05 * t]])  # only the last twentieth again
    assert retraced([]) and retraced([np.zeros(5)])
