"""Runs for searches give what `Simulator` gives, in fewer evaluations."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from heavebond.core.errors import SimulationError
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.search.base_model import SEARCH
from heavebond.estimation import residuals
from heavebond.estimation.experiment import Experiment, changed_experiment, load_experiment
from heavebond.estimation.residuals import Descent, Exceeded, Residuals, Run
from heavebond.language.library import bundled
from heavebond.numerics import compiled_cvodes, simulator
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator, Unexplained
from heavebond.numerics.simulator import Simulator

RIG = bundled("models") / "cylinder_rig"
FREE = ["load_spring.c", "load_damper.d", "valve.q_r"]


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cylinder rig with the first five seconds of its records."""
    folder = tmp_path_factory.mktemp("rig")
    shutil.copy(RIG / "cylinder_rig.yaml", folder)
    shutil.copytree(RIG / "data", folder / "data")
    text = (RIG / "leakage.yaml").read_text()
    for record in (folder / "data").rglob("*.csv"):
        record.write_text("\n".join(record.read_text().splitlines()[:252]) + "\n")
    (folder / "spline.yaml").write_text(text)
    (folder / "hold.yaml").write_text(text.replace("interpolation: spline", "interpolation: hold"))
    return folder


def run(experiment: Experiment, kind: type[QuickSimulator] | None, names: list[str]) -> Run:
    """The record that is fitted; by IDAS at its usual tolerances for no kind."""
    record = experiment.records["train"]
    return Run(experiment, record, names) if kind is None else Run(experiment, record, names, SEARCH, kind=kind)


def differences(experiment: Experiment) -> tuple[Array, Run]:
    """How far the residuals (rms, in units of the noise) and each of the derivatives (share of its size) of a search are
    from those of IDAS; and the search's run, made twice."""
    own = run(experiment, QuickSimulator, FREE)
    own.residuals({})
    (r, J), (r_0, J_0) = own.residuals({}), run(experiment, None, FREE).residuals({})
    return np.array([np.linalg.norm(r - r_0) / len(r) ** 0.5,
                     *np.linalg.norm(J - J_0, axis=1) / np.linalg.norm(J_0, axis=1)]), own


@pytest.fixture
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where there is no C compiler."""
    monkeypatch.setattr(compiled_cvodes, "program", lambda: None)


@pytest.mark.parametrize("between", ["spline", "hold"])
def test_a_search_runs_as_idas_does(rig: Path, between: str) -> None:
    """Within a twentieth of the noise, which is what a search may err by (`base_model.ERRS`), and 1 % of each derivative."""
    wrong, _ = differences(load_experiment(rig / f"{between}.yaml"))
    assert wrong[0] < 0.05 and wrong[1:].max() < 0.01


@pytest.mark.parametrize("between", ["spline", "hold"])
def test_a_search_without_a_compiler_runs_as_idas_does(rig: Path, between: str, interpreted: None) -> None:
    wrong, own = differences(load_experiment(rig / f"{between}.yaml"))
    assert wrong[0] < 0.05 and wrong[1:].max() < 0.01
    assert isinstance(own.simulator, QuickSimulator)
    assert own.simulator.one_step is (between == "hold")


def with_a_line(rig: Path) -> Experiment:
    """With an algebraic unknown: the pressure between the supply and a line to the pump."""
    experiment = load_experiment(rig / "spline.yaml")
    line = next(c for c in single_candidates(experiment) if c.label == "LineResistance between supply and pump.a")
    return changed_experiment(experiment, line.change.with_values({n.name: "1e8 Pa*s/m**3" for n in line.vanishing[:1]}))


def test_a_search_solves_for_algebraic_unknowns(rig: Path) -> None:
    wrong, own = differences(with_a_line(rig))
    assert own.assembly.algebraic_names
    assert wrong[0] < 0.05 and wrong[1:].max() < 0.01


def test_steps_at_held_inputs_are_one_step_from_the_second_run_on(rig: Path, interpreted: None) -> None:
    """And those of another diagram on the same record from the first: what was found out once holds for it."""
    first = run(load_experiment(rig / "hold.yaml"), QuickSimulator, [])
    assert isinstance(first.simulator, QuickSimulator)
    assert not first.simulator.one_step
    first.residuals({})
    other = first.again(FREE, {}, QuickSimulator)
    assert isinstance(other.simulator, QuickSimulator)
    assert first.simulator.one_step and other.simulator.one_step


@pytest.mark.parametrize("algebraic", [False, True])
def test_what_cannot_be_run_is_given_up_without_a_reason(rig: Path, algebraic: bool,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    """To find it takes further runs, of which one by IDAS may take longer than all others of a candidate."""
    monkeypatch.setattr(Unexplained, "most_steps", 1)
    monkeypatch.setattr(Simulator, "explained", lambda self, error: pytest.fail("looked for the reason"))
    experiment = with_a_line(rig) if algebraic else load_experiment(rig / "spline.yaml")
    given_up = Run(experiment, experiment.records["train"], [], kind=Unexplained)
    with pytest.raises(SimulationError) as raised:
        given_up.residuals({})
    assert raised.value.problems[0].code == "integration-failed" and not raised.value.problems[0].hint


MOTOR = """
model: motor
components:
  supply: {is: VoltageSource, u: 0 V}
  motor:  {is: DCMotor, R: 1.9 ohm, L: 0.1 mH, k: 0.042 N*m/A, J: 2.3e-4 kg*m**2, d: 1e-4 N*m*s/rad}
  ground: {is: ElectricalGround}
nodes: {plus: [supply.a, motor.a], minus: [supply.b, motor.b, ground.a], shaft: [motor.s]}
initial: {shaft.phi: 0 rad, shaft.w: 0 rad/s, motor.i: 0 A}
simulate: {until: 1 s}
"""
TACHOMETER = """
experiment: motor
model: motor.yaml
records: {train: {file: train.csv, use: fit}}
time: {column: t, unit: s}
inputs: {supply.u: {column: u, unit: V, interpolation: hold}}
outputs: {shaft.w: {column: w, unit: rad/s, noise: 1 rad/s}}
"""


def test_a_start_follows_what_it_depends_on(tmp_path: Path) -> None:
    """One simulator with one set of values after the other gives what a new one gives for each."""
    t = np.arange(0, 1, 0.01)
    rows = "".join(f"{a:.3f},{np.sin(9 * a):.6f},1\n" for a in t)
    for name, text in (("motor.yaml", MOTOR), ("motor_run.yaml", TACHOMETER), ("train.csv", "t,u,w\n" + rows)):
        (tmp_path / name).write_text(text)
    experiment = load_experiment(tmp_path / "motor_run.yaml")
    names = ["initial.shaft.w", "motor.J"]
    kept = run(experiment, QuickSimulator, names)
    heavier, turning = {"motor.J": 3e-4}, {"initial.shaft.w": 5.0}
    for values in ({}, heavier, turning, {**heavier, **turning}, {}):
        for own, new in zip(kept.residuals(values), run(experiment, QuickSimulator, names).residuals(values), strict=True):
            assert np.array_equal(own, new) and own.any()


def test_a_quick_part_behind_a_held_input_is_no_end_of_the_search(tmp_path: Path) -> None:
    """The current of the motor settles within a hundredth of a sample: behind some jump CVODES gives up."""
    t = np.arange(0, 4, 0.005)
    u = np.round((3*np.sin(2*np.pi*0.7*t) + 2*np.sin(2*np.pi*1.9*t + 1))/0.047)*0.047
    rows = "".join(f"{a:.3f},{b:.3f},{k % 3}\n" for k, (a, b) in enumerate(zip(t, u, strict=True)))
    for name, text in (("motor.yaml", MOTOR), ("motor_run.yaml", TACHOMETER), ("train.csv", "t,u,w\n" + rows)):
        (tmp_path / name).write_text(text)
    experiment = load_experiment(tmp_path / "motor_run.yaml")
    quickly, exactly = (run(experiment, kind, []).residuals({})[0] for kind in (QuickSimulator, None))
    # the speed is some 100 rad/s; both err by their tolerances of 1e-5 and 1e-7 of that, summed over the samples
    assert np.abs(quickly - exactly).max() < 0.05


@pytest.mark.skipif(compiled_cvodes.program() is None, reason="needs the compiled program")
def test_a_run_whose_sum_of_squares_is_too_large_is_ended(rig: Path) -> None:
    """And one whose sum is smaller is not changed."""
    own = run(load_experiment(rig / "spline.yaml"), QuickSimulator, FREE)
    r, J = own.residuals({})
    with pytest.raises(Exceeded):
        own.residuals({}, 0.2 * float(r @ r))
    again, moved = own.residuals({}, 1.001 * float(r @ r))
    assert np.array_equal(again, r) and np.array_equal(moved, J)


@pytest.mark.skipif(compiled_cvodes.program() is None, reason="needs the compiled program")
@pytest.mark.parametrize("method", ["trf", "dogbox"])
def test_a_descent_is_the_same_where_rejected_runs_are_ended(rig: Path, method: Literal["trf", "dogbox"],
                                                           monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = load_experiment(rig / "spline.yaml")
    ended = []

    def made() -> Descent:
        problem = Residuals(experiment, runs=[run(experiment, QuickSimulator, list(experiment.free))])
        inner = 0.95 * problem.high + 0.05 * problem.low
        return problem.descend(inner, False, lambda text: None, most=12, tolerance=1e-8, method=method)

    broken = residuals._broken
    monkeypatch.setattr(residuals, "_broken", lambda run: ended.append(run) or broken(run))
    short = made()
    assert ended
    monkeypatch.setattr(residuals, "ROUNDING", np.inf)
    whole = made()
    assert short.history == whole.history and np.array_equal(short.x, whole.x) and short.message == whole.message


DRAIN = """
model: drain
components:
  tank:  {is: OpenTank, A: 100 cm**2}
  hole:  {is: Orifice, q_r: 20 L/min, dp_r: 0.1 bar}
  pipe:  {is: Orifice, q_r: 30 L/min, dp_r: 0.1 bar}
  floor: {is: Tank}
nodes: {top: [tank.a], bottom: [tank.b, hole.a], middle: [hole.b, pipe.a], out: [pipe.b, floor.a]}
initial: {tank.h: 0.5 m}
simulate: {until: 10 s}
"""


def test_idas_makes_a_run_that_the_compiled_program_cannot_make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pressure between both losses is an algebraic unknown, and a level cannot be negative: IDAS integrates, and no
    motions between the samples are looked for, as a search compares only samples."""
    (tmp_path / "drain.yaml").write_text(DRAIN)
    (tmp_path / "train.csv").write_text("t,h\n" + "".join(f"{t / 10},{0.5 - t / 1000}\n" for t in range(100)))
    (tmp_path / "run.yaml").write_text(
        "experiment: drain\nmodel: drain.yaml\nrecords: {train: {file: train.csv, use: fit}}\n"
        "time: {column: t, unit: s}\noutputs: {tank.h: {column: h, unit: m, noise: 1 mm}}\n")
    experiment = load_experiment(tmp_path / "run.yaml")
    own = run(experiment, QuickSimulator, [])
    assert own.assembly.algebraic_names and own.simulator.compiled
    compiled = own.residuals({})[0]
    monkeypatch.setattr(QuickSimulator, "_signals", lambda *given: None)
    monkeypatch.setattr(simulator, "HiddenMotions", lambda *given: pytest.fail("looked for motions between samples"))
    assert run(experiment, QuickSimulator, []).residuals({})[0] == pytest.approx(compiled, abs=0.05)
