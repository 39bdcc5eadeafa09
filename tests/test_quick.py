"""Runs for searches give what `Simulator` gives, in fewer evaluations."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from heavebond.basis.errors import SimulationError
from heavebond.evidence.catalogue import candidates
from heavebond.evidence.experiment import Experiment, load_experiment
from heavebond.evidence.residuals import Run
from heavebond.evidence.scoring import SEARCH
from heavebond.language.library import bundled
from heavebond.numbers import quick
from heavebond.numbers.dae import Array
from heavebond.numbers.quick import QuickSimulator, Unexplained

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
    (folder / "hold.yaml").write_text(text.replace("between: spline", "between: hold"))
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


@pytest.mark.parametrize("between", ["spline", "hold"])
def test_a_search_runs_as_idas_does(rig: Path, between: str) -> None:
    """Within a twentieth of the noise, which is what a search may err by (`scoring.ERRS`), and 1 % of each derivative."""
    wrong, own = differences(load_experiment(rig / f"{between}.yaml"))
    assert wrong[0] < 0.05 and wrong[1:].max() < 0.01
    assert isinstance(own.simulator, QuickSimulator)
    assert own.simulator.one_step is (between == "hold")


def test_a_search_solves_for_algebraic_unknowns(rig: Path) -> None:
    experiment = load_experiment(rig / "spline.yaml")
    line = next(c for c in candidates(experiment) if c.label == "LineResistance between supply and pump.a")
    changed = line.change.with_values({n.name: "1e8 Pa*s/m**3" for n in line.vanishing[:1]}).on_experiment(experiment)
    wrong, own = differences(changed)
    assert own.assembly.algebraic_names
    assert wrong[0] < 0.05 and wrong[1:].max() < 0.01


def test_steps_at_held_inputs_are_one_step_from_the_second_run_on(rig: Path) -> None:
    """And those of another diagram on the same record from the first: what was found out once holds for it."""
    first = run(load_experiment(rig / "hold.yaml"), QuickSimulator, [])
    assert isinstance(first.simulator, QuickSimulator)
    assert not first.simulator.one_step
    first.residuals({})
    other = first.again(FREE, {}, QuickSimulator)
    assert isinstance(other.simulator, QuickSimulator)
    assert first.simulator.one_step and other.simulator.one_step


def test_what_cannot_be_run_is_given_up_without_a_reason(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quick, "MOST_EXACT", 1)
    experiment = load_experiment(rig / "spline.yaml")
    given_up = Run(experiment, experiment.records["train"], [], kind=Unexplained)
    with pytest.raises(SimulationError) as raised:
        given_up.residuals({})
    assert raised.value.problems[0].code == "integration-failed" and not raised.value.problems[0].hint
