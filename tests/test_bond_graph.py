"""Bond graphs of diagrams: junctions, letters and causal strokes as one draws them by hand."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from collected import partly

import heavebond as hb
from heavebond.cli import main
from heavebond.pictures.bond_graph import Bond, BondGraph, Vertex, bond_graph, causal, notes_of
from heavebond.pictures.bond_picture import crossings, draw_bond_graph, places

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
    assert not graph.derivative and not graph.choices and notes_of(graph) == []


def test_a_component_with_both_ports_on_one_node_can_be_drawn() -> None:
    """Two bonds join its junction and that of the node; a bond from a junction to itself has no direction."""
    model = hb.loads("""
model: short_circuit
components:
  oil:  {is: Volume, V: 10 L, beta: 1.4 GPa}
  gap:  {is: LaminarLeakage, C: 2e-11 m**3/(s*Pa)}
  tank: {is: Tank}
nodes:
  vessel: [gap.b, gap.a]
  return: [oil.a, tank.a]
""")
    graph = bond_graph(model)
    assert graph.bonds
    assert all(bond.tail != bond.head for bond in graph.bonds)
    assert draw_bond_graph(model).startswith("<svg")


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
    assert any("no causality satisfies: b" in note for note in notes_of(graph))


def test_a_free_choice_is_an_algebraic_loop() -> None:
    """Two resistances in a row at a source of effort: which of them gives the flow is open."""
    vertices = {k: Vertex(k, kind, k, "bond") for k, kind in {"s": "Se", "j": "1", "q": "R", "r": "R"}.items()}
    graph = causal(BondGraph(vertices, (Bond("s", "j", "bond"), Bond("j", "q", "bond"), Bond("j", "r", "bond"))))
    assert graph.choices == 1 and not any(v.broken for v in graph.vertices.values())


@pytest.mark.parametrize("name", partly(["dc_stage", "quarter_car", "cylinder_rig", "cmc_ahc", "hydrostatic_drive"], 2))
def test_every_machine_has_a_picture_with_an_arrow_for_each_bond(name: str) -> None:
    model = hb.load(name)
    graph, svg = bond_graph(model), draw_bond_graph(model)
    root = ET.fromstring(svg)
    kinds = [e.get("class", "") for e in root.iter()]
    assert kinds.count("bond") == kinds.count("half-arrow") == len(graph.bonds)
    assert sum(k.startswith("stroke") for k in kinds) == sum(not b.modulated for b in graph.bonds)
    assert all(b.stroke in (b.tail, b.head) for b in graph.bonds if not b.modulated)
    assert svg == draw_bond_graph(model)


@pytest.mark.parametrize("name", partly(["excavator_boom", "cmc_ahc", "dc_stage", "hydrostatic_drive"], 2))
def test_it_is_readable_on_a4(name: str) -> None:
    """Letters stand clear of each other, bonds end clear of them and nearly none cross; in the 277 mm of A4 across, names of
    10 px are above 5 pt (1 pt is 0.353 mm)."""
    svg = draw_bond_graph(hb.load(name))
    root = ET.fromstring(svg)
    assert 10 * 277 / 0.353 / float(root.get("width", "inf")) > 5
    # a letter's place is on its base line, 5 px or so below its middle
    letters = [(float(e.get("x", "")), float(e.get("y", "")) - 5) for e in root.iter() if e.get("font-weight") == "bold"][1:]
    assert min(math.dist(a, b) for a, b in combinations(letters, 2)) > 30
    bonds = [[float(x) for x in re.findall(r"-?[\d.]+", e.get("d", ""))] for e in root.iter() if e.get("class") == "bond"]
    assert len(bonds) == len(bond_graph(hb.load(name)).bonds)
    assert min(math.dist((x, y), letter) for *_, x, y in bonds for letter in letters) > 8
    ends = [end for x, y, u, v in bonds for end in ((x, y), (u, v))]
    assert crossings(np.array(ends), [(2 * k, 2 * k + 1) for k in range(len(bonds))]) <= len(bonds) // 4


def test_straight_bonds_have_their_lengths() -> None:
    """A square comes out square, and a lone vertex stands apart."""
    square = {("a", "b"): 60.0, ("b", "c"): 60.0, ("c", "d"): 60.0, ("d", "a"): 60.0}
    found = places(square, dict.fromkeys("abcde", 10.0))
    # its diagonals are wanted twice as long as its sides, so that the sides give a little
    sides = [math.dist(found[p], found[q]) for p, q in square]
    assert sides == pytest.approx([sides[0]] * 4, rel=1e-3)
    assert 60 < sides[0] < 80
    assert all(math.dist(found["e"], found[k]) > 50 for k in "abcd")


def test_other_options_do_not_go_with_it(tmp_path: Path) -> None:
    said = CliRunner().invoke(main, ["draw", "quarter_car", "--bond-graph", "--colour", "power"])
    assert said.exit_code == 2


def test_the_command_draws_it(tmp_path: Path) -> None:
    said = CliRunner().invoke(main, ["draw", "quarter_car", "--bond-graph", "-o", str(tmp_path / "b.svg")])
    assert said.exit_code == 0, said.output
    assert ">Sf<" in (tmp_path / "b.svg").read_text()
