"""One law at all like places with one amplitude: which places are alike, and that it is one machine and one candidate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import heavebond as hb
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.search.refit_starts import RefitStarts
from heavebond.diagnosis.search.schedule import beyond_their_members
from heavebond.diagnosis.search.scoring import motion_ranges, scored
from heavebond.diagnosis.search.step import fitted_base, single
from heavebond.estimation.experiment import Experiment, changed_experiment, load_experiment
from heavebond.language.model import load
from heavebond.numerics.simulation import simulate

CHAIN = """
model: chain
components:
  foot: {is: PositionSource, u: "=40 mm*sin(2*pi*time/1.7 s) + 15 mm*sin(2*pi*time/0.6 s)"}
  s1:   {is: Spring, c: 400 N/m}
  s2:   {is: Spring, c: 250 N/m}
  d1:   {is: Damper, d: 2 N*s/m}
  d2:   {is: Damper, d: 2 N*s/m}
  rail: {is: Fixed}
  m1:   {is: Mass, m: 2.5 kg}
  m2:   {is: Mass, m: 1.5 kg}
nodes:
  base: [foot.a, s1.a]
  front: [s1.b, d1.b, m1.a, s2.a]
  rear: [s2.b, d2.b, m2.a]
  ground: [rail.a, d1.a, d2.a]
initial: {front.x: 0 m, front.v: 0 m/s, rear.x: 0 m, rear.v: 0 m/s}
"""
MEASURED = """
experiment: two carts on a rail
model: chain.yaml
records: {monday: {file: monday.csv, use: fit}}
time: {column: "time [s]", unit: s}
inputs: {foot.u: {column: "foot [m]", unit: m, interpolation: spline}}
outputs: {rear.x: {column: "rear [m]", unit: m, noise: 0.5 mm}}
free: {d1.d: 2 N*s/m +- 20 %, d2.d: 2 N*s/m +- 20 %}
"""


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Two carts with friction on the rail, of which only the rear one is measured; the diagram knows of no friction."""
    folder = tmp_path_factory.mktemp("chain")
    (folder / "chain.yaml").write_text(CHAIN)
    law = "{is: CoulombFriction, F_c: 1.2 N}"
    machine = CHAIN.replace("nodes:", f"  f1: {law}\n  f2: {law}\nnodes:").replace("s2.a]", "s2.a, f1.b]")
    machine = machine.replace("rear: [", "rear: [f2.b, ").replace("d1.a, d2.a]", "d1.a, d2.a, f1.a, f2.a]")
    (folder / "machine.yaml").write_text(machine)
    run = simulate(load(folder / "machine.yaml"), until=12, every=0.04)
    rear = run["rear.x"] + 5e-4 * np.random.default_rng(1).standard_normal(len(run.time))
    np.savetxt(folder / "monday.csv", np.column_stack([run.time, run["base.x"], rear]), "%.9g", ",",
               header="time [s],foot [m],rear [m]", comments="")
    (folder / "measured.yaml").write_text(MEASURED)
    return load_experiment(folder / "measured.yaml")


def joint(experiment: Experiment, component: str) -> list[Candidate]:
    return [c for c in candidates(experiment) if c.members and c.component == component]


def test_places_are_alike_where_the_same_kinds_of_parts_meet(chain: Experiment) -> None:
    (friction,) = joint(chain, "CoulombFriction")
    assert friction.where == ("ground", "front", "rear")  # not between the carts, nor from the foot to the first
    assert friction.members == ("CoulombFriction between ground and front", "CoulombFriction between ground and rear")
    assert [n.name for n in friction.numbers] == ["coulomb_friction.F_c"]
    assert {c.label for c in single_candidates(chain)} < {c.label for c in candidates(chain)}
    assert not joint(chain, "SensorOffset")
    # as the command does, from the file
    assert [c.label for c in hb.candidates(chain.path)] == [c.label for c in candidates(chain)]


def test_an_identified_curve_at_like_places_is_sought_where_all_of_them_move(chain: Experiment) -> None:
    (curve,) = (c for c in joint(chain, "ForceCurveOfSpeed") if c.where == ("ground", "front", "rear"))
    held = [n for n in curve.numbers if n.follows]
    assert {n.motions for n in held} == {("force_curve_of_speed.v", "force_curve_of_speed_2.v")}
    base = fitted_base(chain)
    ends = motion_ranges(held, base.runs(curve.change, []), base)
    single = {c.place: c for c in single_candidates(chain) if c.component == "ForceCurveOfSpeed"}
    own = [motion_ranges(c.numbers, base.runs(c.change, []), base)
           for c in (single[place] for place in ("between ground and front", "between ground and rear"))]
    spans = [next(iter(found.values())) for found in (ends, *own)]
    assert spans[1] != pytest.approx(spans[2], rel=0.1)
    assert spans[0] == pytest.approx((min(low for low, _ in spans[1:]), max(high for _, high in spans[1:])), rel=1e-6)


def test_it_is_the_machine_with_the_law_at_each_place(chain: Experiment, tmp_path: Path) -> None:
    (friction,) = joint(chain, "CoulombFriction")
    changed = friction.change.with_values({"coulomb_friction.F_c": "1.2 N"}).on_model(chain.model)
    there = load(chain.model.path.with_name("machine.yaml"))
    one, other = (simulate(model, until=12, every=0.04)["rear.x"] for model in (changed, there))
    assert np.abs(one - other).max() < 1e-6 * np.abs(other).max()  # two runs of one machine, its parts in another order


@pytest.mark.parametrize(("rig", "parameter"), [("cylinder_rig/leakage", "leakage")])
def test_single_places_have_no_like_ones(rig: str, parameter: str) -> None:
    """One cylinder has one leakage."""
    assert not [c for c in candidates(load_experiment(rig)) if c.members and c.name.endswith(f".{parameter}")]


@pytest.mark.long
def test_one_amplitude_at_both_places_explains_what_neither_does_alone(chain: Experiment) -> None:
    every = {c.label: c for c in candidates(chain) if c.component == "CoulombFriction"}
    (both,) = (c for c in every.values() if c.members)
    left = {label: single(chain, every[label], lambda text: None).trials[0] for label in (both.label, *both.members)}
    assert left[both.label].chi2_fit < 1.2 and left[both.label].chi2_held_out < 1.4
    assert min(left[label].chi2_fit for label in both.members) > 5
    assert left[both.label].values["coulomb_friction.F_c"] == pytest.approx(1.2, rel=0.02)
    base = fitted_base(chain)
    scores = [s for label in (both.label, *both.members) for s in scored(base, every[label])]
    assert beyond_their_members(scores, {}) == scores
    lesser = [replace(s, z=0.0) if s.candidate is both else s for s in scores]
    assert {s.candidate.label for s in beyond_their_members(lesser, {})} == set(both.members)


def test_a_law_takes_the_place_of_all_parts_of_a_kind_with_common_new_parameters(chain: Experiment) -> None:
    (damper,) = joint(chain, "NonlinearDamper")
    assert damper.place == "in place of d1 and in place of d2"
    assert {n.name: n.parts for n in damper.numbers} == {f"d1.{key}": ("d2",) for key in ("k", "r", "v_k")}
    changed = changed_experiment(chain, damper.change).model.body.instances
    assert changed["d2"].kind == "NonlinearDamper"
    # its two conductances are values of each damper, so that nothing would be in common
    assert not joint(chain, "ShockAbsorber")
    # the diagram with both can be simulated, and explains a part of what friction on both carts does
    assert max(score.gain for score in scored(fitted_base(chain), damper)) > 0


def test_an_amplitude_that_no_score_moves_has_a_range_around_a_neutral_value_of_zero(chain: Experiment) -> None:
    damper = next(c for c in single_candidates(chain) if c.label == "NonlinearDamper in place of d1")
    base = fitted_base(chain)
    guesses = [score for score in scored(base, damper) if "d1.r" not in score.along]
    ranges = RefitStarts(base, damper, guesses, base.runs(damper.change, [])).ranges
    # the limits of the parameter itself
    assert guesses and ranges["d1.r"] == (-20.0, 1.0)
