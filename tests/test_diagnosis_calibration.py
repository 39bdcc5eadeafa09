"""Calibration errors of inputs and channels beside effects: neither is absorbed by the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.candidates.fixed_values import is_calibration_error
from heavebond.diagnosis.diagnose import Diagnosis, diagnose
from heavebond.diagnosis.search import refit_starts
from heavebond.estimation.experiment import load_experiment
from heavebond.language.model import load
from heavebond.numerics.simulation import simulate

RIG = """
model: rig
components:
  foot:   {is: PositionSource, u: 0 m}
  drive:  {is: Spring, c: 60 N/m}
  hold:   {is: Spring, c: 25 N/m}
  damper: {is: Damper, d: 3 N*s/m}
  rail:   {is: Fixed}
  cart:   {is: Mass, m: 2.5 kg}
nodes:
  base: [foot.a, drive.a]
  load: [drive.b, damper.b, hold.b, cart.a]
  rail: [rail.a, damper.a, hold.a]
initial: {load.x: 0 m, load.v: 0 m/s}
"""
MEASURED = """
experiment: a cart between two springs
model: rig.yaml
records:
  monday:  {file: monday.csv, use: fit}
  tuesday: {file: tuesday.csv, use: validate}
time: {column: t, unit: s}
inputs: {foot.u: {column: u, unit: m, interpolation: spline}}
outputs:
  load.x: {column: x, unit: m, noise: 0.5 mm}
  drive.F: {column: F, unit: N, noise: 0.03 N}
free: {drive.c: 60 N/m +- 10 %, hold.c: 25 N/m +- 20 %, damper.d: 3 N*s/m +- 20 %}
"""
CLASSES = ("dry friction", "constant force", "sensor offset", "sensor gain")


def diagnosed(folder: Path, *, offset: str = "0 mm", friction: str = "") -> Diagnosis:
    """Records of a machine whose foot stands beside its record by an `offset`, and with `friction` (N) on its rail."""
    (folder / "rig.yaml").write_text(RIG)
    (folder / "measured.yaml").write_text(MEASURED)
    random = np.random.default_rng(1)
    for name, periods in {"monday": (1.7, 0.9), "tuesday": (1.25, 0.7)}.items():
        motion = "40 mm*sin(2*pi*time/{} s) + 25 mm*sin(2*pi*time/{} s)".format(*periods)
        machine = RIG.replace("u: 0 m", f'u: "={motion} + {offset}"')
        if friction:
            machine = machine.replace("nodes:", f"  seal: {{is: CoulombFriction, F_c: {friction}}}\nnodes:")
            machine = machine.replace("cart.a]", "cart.a, seal.b]").replace("hold.a]", "hold.a, seal.a]")
        (folder / "machine.yaml").write_text(machine)
        run = simulate(load(folder / "machine.yaml"), until=12, every=0.04)
        recorded = run["base.x"] - float(offset.removesuffix(" mm")) / 1e3
        x, F = (run[key] + noise * random.standard_normal(len(run.time))
                for key, noise in (("load.x", 5e-4), ("drive.F", 0.03)))
        np.savetxt(folder / f"{name}.csv", np.column_stack([run.time, recorded, x, F]), "%.7g", ",", header="t,u,x,F",
                   comments="")
    return diagnose(folder / "measured.yaml", classes=CLASSES, number=1)


def test_calibration_errors_are_offsets_and_gains() -> None:
    experiment = load_experiment("receiver_rig/choked")
    found = [c for c in single_candidates(experiment) if is_calibration_error(c, experiment)]
    assert {c.component for c in found} == {"SensorOffset", "SensorGain"}  # no drift, no dead band, no lag
    assert {c.attaches for c in found} == {"input", "channel"}


@pytest.mark.long
def test_friction_does_not_absorb_an_offset(tmp_path: Path) -> None:
    """Friction that differs by direction leaves less than the law of the machine, until the offset stands beside it."""
    found = diagnosed(tmp_path, offset="8 mm", friction="1.5 N")
    assert found.verdict == "effect", found.words
    assert [f.candidate.label for f in found.findings] == ["CoulombFriction between rail and load",
                                                           "SensorOffset before foot.u"]
    alone = {t.candidate.component: t.cost for t in found.steps[0].trials}
    # a refit ends where its tangent promises less than a thousandth
    assert alone["DirectionalFriction"] < (1 + refit_starts.LITTLE) * alone["CoulombFriction"]
    values = [p.value for f in found.findings for p in f.parameters]  # of the diagram with both
    assert values == pytest.approx([1.5, 8e-3], rel=0.02)


@pytest.mark.slow
def test_one_fault_alone_is_named_alone(tmp_path: Path) -> None:
    for folder, faults, label in ((tmp_path / "offset", {"offset": "8 mm"}, "SensorOffset before foot.u"),
                                  (tmp_path / "friction", {"friction": "1.5 N"}, "CoulombFriction between rail and load")):
        folder.mkdir()
        found = diagnosed(folder, **faults)
        assert found.verdict == "effect", found.words
        assert [f.candidate.label for f in found.findings] == [label]
