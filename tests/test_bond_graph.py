"""Bond graphs of diagrams: junctions, letters and causal strokes as one draws them by hand."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.bond_graph import Bond, BondGraph, Vertex, bond_graph, causal, told
from heavebond.bond_picture import draw_bond_graph
from heavebond.cli import main

MOUNT = """
model: mount
components:
  ground: {is: Fixed}
  spring: {is: Spring, c: 30 kN/m}
  damper: {is: Damper, d: 2 kN*s/m}
  motor:  {is: Mass, m: 80 kg}
  push:   {is: ForceSource, u: 10 N}
nodes:
  floor: [ground.a, spring.a, damper.a]
  motor: [spring.b, damper.b, motor.a, push.a]
"""
# two flywheels on one shaft cannot both be integrated
SHAFT = """
model: shaft
components:
  first:  {is: Inertia, J: 1 kg*m**2}
  second: {is: Inertia, J: 2 kg*m**2}
  drive:  {is: TorqueSource, u: 1 N*m}
nodes: {shaft: [first.a, second.a, drive.a]}
"""


def _letters(graph: BondGraph) -> dict[str, str]:
    return {v.label: v.letter for v in graph.vertices.values() if v.letter not in "01"}


def _stroke(graph: BondGraph, key: str) -> str:
    """At which end of the only bond of an element effort is imposed."""
    bond, = (b for b in graph.bonds if key in (b.tail, b.head))
    return "own" if bond.stroke == key else "other"


def test_a_mount_on_the_ground_is_one_junction() -> None:
    """The floor does not move, so its junction and those between it and the mass go."""
    graph = bond_graph(hb.loads(MOUNT))
    assert _letters(graph) == {"spring": "C", "damper": "R", "motor": "I", "push": "Se"}
    assert [v.letter for v in graph.vertices.values() if v.letter in "01"] == ["1"]
    assert len(graph.bonds) == 4
    assert {key: _stroke(graph, key) for key in ("spring", "damper", "motor", "push")} == {
        "spring": "other", "damper": "other", "motor": "own", "push": "other"}  # the mass takes the sum of all efforts
    assert not graph.derivative and not graph.choices and told(graph) == []


def test_power_counts_into_elements_and_out_of_sources() -> None:
    graph = bond_graph(hb.loads(MOUNT))
    heads = {b.head for b in graph.bonds}
    assert {"spring", "damper", "motor"} <= heads and "push" not in heads


def test_a_second_rigid_inertia_is_in_derivative_causality() -> None:
    graph = bond_graph(hb.loads(SHAFT))
    assert graph.derivative == ["second"]
    assert _stroke(graph, "first") == "own" and _stroke(graph, "second") == "other"
    assert 'class="stroke late"' in draw_bond_graph(hb.loads(SHAFT))
    assert "derivative causality: second" in draw_bond_graph(hb.loads(SHAFT))


def test_stores_in_integral_form_are_the_states_of_the_assembled_machine() -> None:
    """In the quarter car two masses by their speeds and two springs by their lengths."""
    model = hb.load("quarter_car")
    stores = [v for v in bond_graph(model).vertices.values() if v.letter in ("C", "I") and not v.derivative]
    assert len(stores) == len(hb.assemble(model).reduced.states) == 4


def test_hydraulics_have_junctions_of_the_other_kind() -> None:
    graph = bond_graph(hb.load("hydrostatic_drive"))
    by_label = {v.label: v.letter for v in graph.vertices.values()}
    assert by_label["pump_A"] == "0" and by_label["road"] == "1"
    assert by_label["check_A"] == "R" and by_label["wheel"] == "TF"
    assert graph.vertices["check_A on"].letter == "1"
    assert graph.derivative == ["vehicle"]  # rigid with the gears through the wheel
    assert "motor" in graph.words


@pytest.mark.parametrize("letter", ["TF", "GY"])
def test_transformers_keep_and_gyrators_turn_causality(letter: str) -> None:
    """Se -> two-port -> 1-junction with I and R: an effort comes out of a transformer, a flow of a gyrator."""
    vertices = {k: Vertex(k, kind, k, "bond") for k, kind in
                {"s": "Se", "x": letter, "b": "1", "i": "I", "r": "R"}.items()}
    bonds = tuple(Bond(*ends, "bond") for ends in (("s", "x"), ("x", "b"), ("b", "i"), ("b", "r")))
    graph = causal(BondGraph(vertices, bonds))
    assert graph.bonds[0].stroke == "x"
    assert graph.bonds[1].stroke == ("b" if letter == "TF" else "x")
    assert graph.derivative == ([] if letter == "TF" else ["i"])  # the gyrator imposes the flow
    assert not any(v.broken for v in graph.vertices.values())


def test_a_sensor_takes_no_power() -> None:
    graph = bond_graph(hb.load("dc_stage"))
    assert graph.vertices["scale"].letter == "Df"  # of a position
    assert [b.modulated for b in graph.bonds if "scale" in (b.tail, b.head)] == [True]


def test_two_flow_sources_on_one_junction_are_told() -> None:
    vertices = {k: Vertex(k, kind, k, "bond") for k, kind in {"a": "Sf", "b": "Sf", "j": "1"}.items()}
    graph = causal(BondGraph(vertices, (Bond("a", "j", "bond"), Bond("b", "j", "bond"))))
    assert graph.vertices["b"].broken and not graph.vertices["a"].broken
    assert any("no causality satisfies: b" in note for note in told(graph))


def test_a_free_choice_is_an_algebraic_loop() -> None:
    """Two resistances in a row at a source of effort: which of them gives the flow is open."""
    vertices = {k: Vertex(k, kind, k, "bond") for k, kind in {"s": "Se", "j": "1", "q": "R", "r": "R"}.items()}
    graph = causal(BondGraph(vertices, (Bond("s", "j", "bond"), Bond("j", "q", "bond"), Bond("j", "r", "bond"))))
    assert graph.choices == 1 and not any(v.broken for v in graph.vertices.values())


@pytest.mark.parametrize("name", ["cmc_ahc", "dc_stage", "hydrostatic_drive", "quarter_car", "cylinder_rig"])
def test_every_machine_has_a_picture_with_an_arrow_for_each_bond(name: str) -> None:
    model = hb.load(name)
    graph, svg = bond_graph(model), draw_bond_graph(model)
    root = ET.fromstring(svg)
    kinds = [e.get("class", "") for e in root.iter()]
    assert kinds.count("bond") == kinds.count("half-arrow") == len(graph.bonds)
    assert sum(k.startswith("stroke") for k in kinds) == sum(not b.modulated for b in graph.bonds)
    assert all(b.stroke in (b.tail, b.head) for b in graph.bonds if not b.modulated)
    assert svg == draw_bond_graph(model)


def test_the_command_draws_it(tmp_path: Path) -> None:
    said = CliRunner().invoke(main, ["draw", "quarter_car", "--bond-graph", "-o", str(tmp_path / "b.svg")])
    assert said.exit_code == 0, said.output
    assert ">Sf<" in (tmp_path / "b.svg").read_text()
