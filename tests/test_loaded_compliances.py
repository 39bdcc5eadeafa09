# A compliance that a diagnosis puts in series carries its load already when a record begins, as far as the diagram leaves
# its elongation open.
from __future__ import annotations

from pathlib import Path

import pytest

import heavebond as hb
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.estimation.experiment import changed_experiment

WINCH = """\
model: winch
components:
  motor: {is: TorqueSource, u: 500 N*m}
  drum: {is: Inertia, J: 1.8 kg*m**2}
  bearing: {is: RotationalDamper, d: 6 N*m*s/rad}
  frame: {is: FixedShaft}
  rope: {is: Rack, r: 0.2 m}
  load: {is: Mass, m: 300 kg}
  weight: {is: Weight, m: 300 kg}
nodes:
  shaft: [motor.a, drum.a, bearing.b, rope.a]
  frame: [frame.a, bearing.a]
  load: [rope.b, load.a, weight.a]
initial: {shaft.phi: 0 deg, shaft.w: 0 rad/s}
show: {load.v: {unit: m/s}}
simulate: {until: 0.5 s, every: 1 ms}
"""
EXPERIMENT = """\
experiment: winch
model: winch.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
outputs: {load.v: {column: v, unit: m/s, noise: 1 mm/s}}
free: {bearing.d: 6 N*m*s/rad +- 20 %}
"""


def with_candidate(folder: Path, label: str, settings: dict[str, float], diagram: str = WINCH) -> hb.Result:
    """A run of the diagram with a candidate of the catalogue in it."""
    (folder / "winch.yaml").write_text(diagram)
    (folder / "winched.yaml").write_text(EXPERIMENT)
    (folder / "one.csv").write_text("t,v\n" + "".join(f"{0.1*k},0\n" for k in range(6)))
    experiment = hb.load_experiment(folder / "winched.yaml")
    candidate = next(c for c in single_candidates(experiment) if c.label == label)
    changed = changed_experiment(experiment, candidate.change).model
    return hb.simulate(changed.with_parameters({f"{candidate.name}.{k}": v for k, v in settings.items()}))


def test_a_rope_between_two_masses_begins_with_the_force_that_the_rigid_one_transmits(tmp_path: Path) -> None:
    """Rigid: a = (M - m g r) r/(J + m r**2) of the load, and m (g + a) in the rope. At the start both ends have this
    acceleration, or the load would fall into its rope."""
    found = with_candidate(tmp_path, "SeriesCompliance between load and rope.b", {"c": 2e5, "T_d": 4e-3})
    acceleration = (500 - 300*9.81*0.2)*0.2/(1.8 + 300*0.04)
    force = 300*(9.81 + acceleration)
    assert found["series_compliance.F"][0] == pytest.approx(force, rel=1e-9)
    assert [found["load.v"][0], found["rope_b.v"][0]] == pytest.approx([0, 0], abs=1e-12)
    # the ends then move together: no oscillation but that of the bearing's torque, 0.2 %; from an unloaded rope it is 60 %
    assert found["load.v"] == pytest.approx(found["rope_b.v"], abs=5e-3*abs(found["load.v"]).max())


def test_a_joint_without_mass_begins_at_rest_with_its_load(tmp_path: Path) -> None:
    """Between the load and a damper the elongation follows the damper's force by (F/c - s)/T_d: its rate decides, and the
    rate of that is no condition."""
    diagram = WINCH.replace("  weight:", "  brake: {is: Damper, d: 2 kN*s/m}\n  ground: {is: Fixed}\n  weight:").replace(
        "weight.a]", "weight.a, brake.b]\n  ground: [ground.a, brake.a]").replace("shaft.w: 0 rad/s", "shaft.w: 2 rad/s")
    found = with_candidate(tmp_path, "SeriesCompliance between load and brake.b", {"c": 1e5, "T_d": 4e-3}, diagram)
    assert found["series_compliance.v"][0] == pytest.approx(0, abs=1e-9)
    assert abs(found["series_compliance.s"][0]) == pytest.approx(2e3*0.4/1e5, rel=1e-6)
