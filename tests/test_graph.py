"""`model.graph()`: the diagram as a networkx graph, beside what the assembler makes of the same diagram."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import networkx as nx
import pytest

import heavebond as hb
from heavebond.equations.connect import connect
from heavebond.equations.expand import expand
from heavebond.equations.medium import with_media
from heavebond.equations.parameters import formula_order

MODELS = Path(hb.__file__).parent.parent / "models"
NAMES = ["cmc_ahc", "passive_rig", "hydrostatic_drive", "excavator_boom", "quarter_car", "circuits/crane", "circuits/press",
         "circuits/gripper", "examples/switch"]


def test_parts_ports_and_nodes_have_their_components_and_domains() -> None:
    graph = hb.load("quarter_car").graph()
    kinds = {kind for kind, _ in graph}
    assert kinds == {"part", "port", "node"}
    for (kind, name), told in graph.nodes(data=True):
        if kind == "port":
            part = name.rpartition(".")[0]
            assert ("part", part) in graph[kind, name]
            assert told["direction"] in ("in", "out", "power")
        elif kind == "node" and told["domain"] == "translational":
            assert "v" in told["across"] and told["through"] == ("f",)
            assert told["line"] > 0


@pytest.mark.parametrize("name", NAMES)
def test_nodes_join_the_ports_that_the_assembler_joins(name: str) -> None:
    """The assembler keeps flat lists; both must say the same of every node."""
    model = hb.load(name)
    graph, expanded = model.graph(), with_media(expand(model))
    network = connect(expanded, formula_order(expanded))
    for group in network.groups:
        ends = {p for p in group.ports if not expanded.leaves[p.rpartition(".")[0]].component.composite}
        if ends and group.name not in group.ports:
            assert {port for _, port in graph["node", group.name]} == ends
            assert graph.nodes["node", group.name]["domain"] == group.domain


def test_closed_blocks_are_parts_and_opened_ones_their_parts() -> None:
    model = hb.load("cmc_ahc")
    closed, opened = model.graph(open_blocks=False), model.graph()
    blocks = {name for (kind, name), told in closed.nodes(data=True) if kind == "part" and told["block"]}
    assert {"cmc", "ahc"} <= blocks
    assert not any(told["block"] for (kind, _), told in opened.nodes(data=True) if kind == "part")
    assert len(opened) > len(closed)
    assert nx.shortest_path(closed, ("part", "cmc"), ("part", "crown"))


def test_islands_are_connected_components() -> None:
    text = """
model: two
components:
  wall: {is: Fixed}
  one: {is: Spring, c: 1 kN/m}
  load: {is: Mass, m: 1 kg}
  other: {is: Mass, m: 1 kg}
nodes: {ground: [wall.a, one.a], load: [one.b, load.a], far: [other.a]}
"""
    islands = [{name for kind, name in found if kind == "part"} for found in nx.connected_components(hb.loads(text).graph())]
    assert sorted(map(sorted, islands)) == [["load", "one", "wall"], ["other"]]


def test_a_run_loads_no_networkx() -> None:
    """It costs a tenth of a second to import."""
    code = "import sys; import heavebond as hb; hb.simulate(hb.load('quarter_car'), 0.1); print('networkx' in sys.modules)"
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_public_objects_plot_and_draw_themselves() -> None:
    model = hb.load("quarter_car")
    result = hb.simulate(model, 0.5)
    assert len(result.plot().axes) >= 1
    assert [line.get_label() for line in result.plot(*list(model.show)[:1]).axes[0].lines] or result.plot().axes
    drawing = model._repr_svg_()
    assert drawing is not None and drawing.startswith("<svg")
    assert hb.compare("passive_rig/friction").plot().axes
