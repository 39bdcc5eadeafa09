"""The catalogue of what may be missing: which places are found in the bundled rigs, and components of the user's own."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from heavebond.diagnosis.answer.tree import MACHINE, MEASURING, levels
from heavebond.diagnosis.candidates.catalogue import Candidate, single_candidates
from heavebond.diagnosis.candidates.places import Places
from heavebond.diagnosis.candidates.varying import BY_RECORD
from heavebond.estimation.comparison import assemble_for
from heavebond.estimation.experiment import Experiment, changed_experiment, load_experiment
from heavebond.language.library import effect_classes, library, same_class
from heavebond.language.model import loads
from heavebond.numerics.simulation import simulate

OWN = """
component: SquareDrag
summary: A drag that nobody else has.
restrictions: None.
source: our own
symbol: damper
ports: {a: translational, b: translational}
parameters:
  k: {unit: N*s**2/m**2, min: 0, doc: force per speed squared}
variables:
  v: {unit: m/s, doc: speed of b against a}
  F: {unit: N, doc: drag}
equations: |
  v   = b.v - a.v
  F   = k * v * abs(v)
  b.f = F
  a.f = -F
dissipates: F * v
effect:
  class: drag of our own
  attaches: across
  amplitude: [k]
  description: what our own drag does
"""


@pytest.fixture(scope="module")
def found() -> dict[str, list[Candidate]]:
    return {name: single_candidates(load_experiment(name)) for name in ("receiver_rig/choked", "passive_rig/friction",
                                                                "cylinder_rig/leakage")}


@pytest.mark.parametrize(("rig", "label", "attaches"), [
    ("cylinder_rig/leakage", "Cylinder in cylinder (leakage)", "in"),
    ("cylinder_rig/leakage", "LaminarLeakage between chamber_a and chamber_b", "across"),
    ("cylinder_rig/leakage", "LineVolume on chamber_a", "at"),
    ("cylinder_rig/leakage", "LineInertance between supply and pump.a", "in series"),
    ("cylinder_rig/leakage", "Saturation before valve.u", "input"),
    ("cylinder_rig/leakage", "SensorOffset in the channel load.x", "channel"),
    ("cylinder_rig/leakage", "BilinearSpring in place of load_spring", "replaces"),
    ("passive_rig/friction", "LuGreFriction between platform and crown", "across"),
    ("receiver_rig/choked", "PneumaticValve in inlet (b_cr)", "in")])
def test_places(found: dict[str, list[Candidate]], rig: str, label: str, attaches: str) -> None:
    assert [c.attaches for c in found[rig] if c.label == label] == [attaches]


def test_nothing_is_offered_twice_and_names_are_free(found: dict[str, list[Candidate]]) -> None:
    for name, catalogue in found.items():
        experiment = load_experiment(name)
        assert len({c.label for c in catalogue}) == len(catalogue)
        for c in catalogue:
            replaced = {c.name} if c.attaches == "replaces" else set()
            assert not (set(c.change.components) - replaced) & set(experiment.model.body.instances)


def test_each_way_of_attaching_makes_a_diagram_that_assembles(found: dict[str, list[Candidate]]) -> None:
    experiment = load_experiment("cylinder_rig/leakage")
    record = experiment.records["train"]
    for way in ("in", "across", "at", "in series", "input", "channel", "replaces"):
        candidate = next(c for c in found["cylinder_rig/leakage"] if c.attaches == way)
        changed = changed_experiment(experiment, candidate.change)
        values = assemble_for(changed, record).parameter_values
        assert all(n.name in values for n in candidate.numbers), candidate.label


def test_a_dormant_parameter_that_is_awake_is_not_offered() -> None:
    experiment = load_experiment("cylinder_rig/leakage")
    labels = {c.label for c in single_candidates(experiment)}
    awake = experiment.model.with_parameters({"cylinder.leakage": 1e-11})
    left = {c.label for c in single_candidates(replace(experiment, model=awake))}
    assert labels - left == {"Cylinder in cylinder (leakage)"}


def test_a_component_beside_the_diagram_takes_part(tmp_path: Path) -> None:
    source = Path(load_experiment("passive_rig/friction").path).parent
    shutil.copytree(source, tmp_path / "rig")
    (tmp_path / "rig" / "square_drag.yaml").write_text(OWN.lstrip(), encoding="utf-8")
    own = [c for c in single_candidates(load_experiment(tmp_path / "rig" / "friction.yaml")) if c.component == "SquareDrag"]
    assert "SquareDrag between platform and crown" in {c.label for c in own}
    assert {(c.kind, c.vanishes) for c in own} == {("drag of our own", True)}


def driven(folder: Path, model: str, given: str, measured: str) -> Experiment:
    """An experiment on a diagram in the folder, with one record of an input and an output."""
    (folder / "run.csv").write_text("t,u,y\n" + "".join(f"{k/10},{k % 3},{k}\n" for k in range(20)), encoding="utf-8")
    (folder / "run.yaml").write_text(f"""
experiment: {model}
model: {model}.yaml
records: {{run: {{file: run.csv, use: fit}}}}
time: {{column: t, unit: s}}
inputs: {{{given}}}
outputs: {{{measured}}}
""", encoding="utf-8")
    return load_experiment(folder / "run.yaml")


def test_a_shaft_without_a_frame_may_rub_at_the_surroundings(tmp_path: Path) -> None:
    """A motor whose housing does not turn needs no frame in the diagram; its friction may still follow another law."""
    (tmp_path / "motor.yaml").write_text("""
model: motor
components:
  supply: {is: VoltageSource, u: 0 V}
  motor:  {is: DCMotor, R: 2 ohm, L: 1 mH, k: 0.04 N*m/A, J: 2e-4 kg*m**2}
  ground: {is: ElectricalGround}
nodes: {plus: [supply.a, motor.a], minus: [supply.b, motor.b, ground.a], shaft: [motor.s]}
initial: {shaft.phi: 0 rad, shaft.w: 0 rad/s, motor.i: 0 A}
simulate: {until: 1 s}
""", encoding="utf-8")
    experiment = driven(tmp_path, "motor", "supply.u: {column: u, unit: V, interpolation: hold}",
                        "shaft.w: {column: y, unit: rad/s, noise: 1 rad/s}")
    found = next(c for c in single_candidates(experiment)
                 if c.label == "RotationalStribeckFriction between shaft and the surroundings")
    values = assemble_for(changed_experiment(experiment, found.change), experiment.records["run"]).parameter_values
    assert {n.name for n in found.numbers} <= set(values)


def test_an_input_that_a_record_takes_from_its_source_may_have_effects_before_it(tmp_path: Path) -> None:
    """The input leaves the node with the source; the source stays."""
    (tmp_path / "rig.yaml").write_text("""
model: rig
components:
  wave:   {is: Sine, a: 1 m, T: 8 s}
  deck:   {is: PositionSource}
  spring: {is: Spring, c: 1 kN/m}
  load:   {is: Mass, m: 10 kg}
nodes: {heave: [wave.y, deck.u], deck: [deck.a, spring.a], load: [spring.b, load.a]}
initial: {load.x: 0 m, load.v: 0 m/s}
simulate: {until: 1 s}
""", encoding="utf-8")
    experiment = driven(tmp_path, "rig", "deck.u: {column: u, unit: m, interpolation: spline}",
                        "load.x: {column: y, unit: m, noise: 1 mm}")
    for label in ("SensorGain before deck.u", "FirstOrderLag before deck.u", "Delay before deck.u"):
        found = next(c for c in single_candidates(experiment) if c.label == label)
        changed = changed_experiment(experiment, found.change)
        assembly = assemble_for(changed, experiment.records["run"])
        assert {n.name for n in found.numbers} <= set(assembly.parameter_values)
        assert [known.name for known in assembly.flat.inputs] == [f"{found.name}.u"]


RUNNING = """
model: circuit
components:
  pump: {is: FlowSource, u: 30 L/min}
  block: {is: Volume, V: 0.4 L, beta: 1.2 GPa}
  line: {is: LaminarLeakage, C: 2.5e-10 m**3/(s*Pa)}
  throttle: {is: LaminarLeakage, C: 5e-11 m**3/(s*Pa)}
  tank: {is: Tank}
  wall: {is: Fixed}
  spring: {is: Spring, c: 40 kN/m}
  load: {is: Mass, m: 50 kg}
  pull: {is: ConstantForce, F: 400 N}
nodes:
  delivery: [pump.a, block.a, line.a]
  far: [line.b, throttle.a]
  low: [throttle.b, tank.a]
  wall: [wall.a, spring.a]
  load: [spring.b, load.a, pull.a]
initial: {delivery.p: 120 bar, load.x: 10 mm, load.v: 0 m/s}
show: {delivery.p: {unit: Pa}, far.p: {unit: Pa}, load.x: {unit: m}}
simulate: {until: 0.2 s, every: 1 ms}
"""


@pytest.mark.parametrize(("label", "shown", "tolerance"), [
    ("LineInertance between far and line.b", "delivery.p", 1e-5), ("LineVolume on far", "far.p", 1e-5),
    # the load hangs where it did, so that the spring is shorter by what the joint gives way
    ("SeriesCompliance between load and spring.b", "spring.F", 0.05)])
def test_what_is_added_to_a_machine_that_runs_has_run_before(tmp_path: Path, label: str, shown: str, tolerance: float
                                                               ) -> None:
    """Flow, pressure and tension in it are those that it would have, so that a machine that stands still goes on to."""
    (tmp_path / "circuit.yaml").write_text(RUNNING)
    (tmp_path / "monday.csv").write_text("t,p\n0,120\n0.1,120\n0.2,120\n")
    (tmp_path / "measured.yaml").write_text("""
experiment: measured
model: circuit.yaml
records: {monday: {file: monday.csv, use: fit}}
time: {column: t, unit: s}
outputs: {delivery.p: {column: p, unit: bar, noise: 0.1 bar}}
""")
    experiment = load_experiment(tmp_path / "measured.yaml")
    added = next(c for c in single_candidates(experiment) if c.label == label)
    added = changed_experiment(experiment, added.change).model
    steady = simulate(loads(RUNNING))[shown]
    assert np.ptp(steady) < 1e-6 * steady[0]  # what the integrator leaves
    assert simulate(added)[shown] == pytest.approx(steady, rel=tolerance)


def test_classes_that_are_special_cases() -> None:
    """By the data of the library and not by the words of their names."""
    assert same_class("leakage", "internal leakage") and same_class("internal leakage", "leakage")
    assert not same_class("internal leakage", "external leakage") and not same_class("dry friction", "friction")
    components = [library().component(name) for name in library().names()]
    known = {c.effect.kind for c in components if c.effect} | {p.kind for c in components for p in c.parameters.values()}
    # parameters that differ between records are no component
    assert known | {BY_RECORD} >= {*effect_classes(), *effect_classes().values()}


def test_only_files_with_an_effect_are_parsed_for_it() -> None:
    """Which these are is seen in the text; no component that has an effect is passed over."""
    every = library()
    assert [c.name for c in every.effects()] == [n for n in every.names() if every.component(n).effect is not None]


TANK = """
model: tank
components:
  well:  {is: FlowSource, u: 0 m**3/s}
  tank:  {is: OpenTank, A: 120 cm**2}
  hole:  {is: LaminarLeakage, C: 1e-8 m**3/(s*Pa)}
  floor: {is: Tank}
nodes:
  top:    [well.a, tank.a]
  bottom: [tank.b, hole.a]
  out:    [hole.b, floor.a]
initial: {tank.h: 200 mm}
simulate: {until: 60 s}
"""
TANK_RUN = """
experiment: tank
model: tank.yaml
records: {train: {file: train.csv, use: fit}}
time: {column: t, unit: s}
outputs: {tank.h: {column: h, unit: m, noise: 1 mm}}
free: {hole.C: 1e-9 .. 1e-7 m**3/(s*Pa)}
"""


def test_a_constant_input_has_another_value_in_the_machine_and_no_sensor(tmp_path: Path) -> None:
    """No record drives the flow of the well: an offset of it belongs to the machine. A lag or a saturation of a constant has
    no effect. If a column drives it, the offset belongs to the measuring chain."""
    def levels_of_the_well(more: str) -> dict[str, tuple[object, ...]]:
        (tmp_path / "tank.yaml").write_text(TANK)
        (tmp_path / "train.csv").write_text("t,h,q\n" + "".join(f"{t},{0.2 - 1e-3 * t},{1e-6 * t}\n" for t in range(60)))
        (tmp_path / "run.yaml").write_text(TANK_RUN + more)
        experiment = load_experiment(tmp_path / "run.yaml")
        step: Any = SimpleNamespace(places=Places.of(experiment))
        return {c.component: levels(step, c, c.kind, experiment.model.library)[0] for c in single_candidates(experiment)
                if c.place == "before well.u"}

    constant = levels_of_the_well("")
    assert set(constant) == {"SensorOffset", "SensorGain"} and constant["SensorOffset"][0] == MACHINE
    measured = levels_of_the_well("inputs: {well.u: {column: q, unit: m**3/s, interpolation: linear}}\n")
    assert measured["SensorOffset"][0] == MEASURING and measured["FirstOrderLag"][0] == MACHINE
