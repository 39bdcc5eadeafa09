"""`model.graph()`: the diagram as a networkx graph, beside what the assembler makes of the same diagram."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import networkx as nx
import pytest
from collected import partly

import heavebond as hb
from heavebond.equations.connect import connect
from heavebond.equations.expand import expand
from heavebond.equations.flatten import flatten
from heavebond.equations.grounding import circuits
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


def test_public_objects_plot_and_draw_themselves() -> None:
    model = hb.load("quarter_car")
    result = hb.simulate(model, 0.5)
    assert len(result.plot().axes) >= 1
    assert [line.get_label() for line in result.plot(*list(model.show)[:1]).axes[0].lines] or result.plot().axes
    drawing = model._repr_svg_()
    assert drawing is not None and drawing.startswith("<svg")
    assert hb.compare("passive_rig/friction").plot().axes


BUNDLED = sorted(f"{path.parent.name}/{path.stem}" for path in MODELS.rglob("*.yaml")
                 if path.parent.parent == MODELS and path.read_text(encoding="utf-8").startswith("model:"))


def _islands(graph: nx.Graph[tuple[str, str]], domain: str, parts: set[str]) -> set[tuple[frozenset[str], frozenset[str]]]:
    """Nodes and parts of each connected component of one domain; what no node joins is left out."""
    own = graph.subgraph([v for v, at in graph.nodes(data=True) if at["kind"] == "part" or at["domain"] == domain])
    found = set()
    for members in nx.connected_components(own):
        nodes = frozenset(name for kind, name in members if kind == "node")
        if nodes:
            found.add((nodes, frozenset(name for kind, name in members if kind == "part") & parts))
    return found


@pytest.mark.long
@pytest.mark.parametrize("start", range(8))
def test_grounding_of_all_bundled_models_has_the_islands_of_the_graph(start: int) -> None:
    """The circuits that `check` looks for a reference are the connected components of the graph, domain by domain; the parts
    that ground a circuit belong to it."""
    assert len(BUNDLED) > 300
    for name in BUNDLED[start::8]:
        model = hb.load(str(MODELS / f"{name}.yaml"))
        graph, flat = model.graph(), flatten(model)
        node_of = {alias: node for kind, node in graph if kind == "node"
                   for alias in (node, *graph.nodes[kind, node]["aliases"])}
        parts = {part for kind, part in graph if kind == "part"}
        found = circuits(flat)
        for domain in model.library.domains:
            islands = _islands(graph, domain, parts)
            own = [circuit for circuit in found if circuit.domain == domain]
            assert {nodes for nodes, _ in islands} == {frozenset(node_of[n] for n in c.nodes) for c in own}, (name, domain)
            members = dict(islands)
            for c in own:
                assert set(c.held) | set(c.carried) <= members[frozenset(node_of[n] for n in c.nodes)], (name, c)


@pytest.mark.parametrize("start", partly(range(8), 4))
def test_connectivity_of_all_bundled_models_is_that_of_the_declared_nodes(start: int) -> None:
    """The reference is made by networkx from the nodes as they are declared, without what the assembler joins."""
    for name in BUNDLED[start::8]:
        model = hb.load(str(MODELS / f"{name}.yaml"))
        graph, expanded = model.graph(), with_media(expand(model))
        declared = nx.Graph((("node", junction.path), ("port", end.name)) for junction in expanded.junctions.values()
                            for end in junction.ends)
        leaves = {path for path, leaf in expanded.leaves.items() if not leaf.component.composite}
        expected = {frozenset(p for kind, p in members if kind == "port" and p.rpartition(".")[0] in leaves)
                    for members in nx.connected_components(declared)} - {frozenset()}
        nodes = [frozenset(port for _, port in graph[vertex]) for vertex in graph if vertex[0] == "node"]
        assert len(nodes) == len(set(nodes)) and set(nodes) == expected, name


def test_a_signal_is_directed_from_its_output_to_its_inputs() -> None:
    graph = hb.load("cmc_ahc").graph()
    directed = nx.DiGraph((at["source"], at["target"]) for _, _, at in graph.edges(data=True) if "source" in at)
    ports = {name: at["direction"] for (kind, name), at in graph.nodes(data=True)
             if kind == "port" and at["domain"] == "signal"}
    assert {"in", "out"} == set(ports.values())
    for port, direction in ports.items():
        part = ("part", port.rpartition(".")[0])
        assert directed.has_edge(part, ("port", port)) == (direction == "out")
        assert directed.has_edge(("port", port), part) == (direction == "in")
    # one output drives a signal, or none where the input has a value in place
    assert {directed.in_degree(v) for v in directed if v[0] == "node"} == {0, 1}


def test_nodes_carry_units_and_the_pair_whose_product_is_power() -> None:
    graph = hb.load("quarter_car").graph()
    node = next(at for at in (graph.nodes[v] for v in graph) if at.get("domain") == "translational" and at["kind"] == "node")
    assert (node["effort"], node["flow"]) == ("f", "v")
    assert (node["units"]["f"], node["units"]["v"]) == ("N", "m/s")
    assert all({"kind", "file", "line"} <= set(at) for _, at in graph.nodes(data=True))


@pytest.mark.parametrize("words", [(), ("--help",), ("check", "quarter_car"), ("run", "quarter_car", "--until", "0.1 s")])
def test_import_help_check_and_run_load_no_networkx(words: tuple[str, ...], tmp_path: Path) -> None:
    """It costs a tenth of a second to import."""
    code = ("import sys\nimport heavebond\nif sys.argv[1:]:\n    from heavebond.cli import main\n    try:\n        main()\n"
            "    except SystemExit as end:\n        assert not end.code, end.code\n"
            "print('networkx loaded:', 'networkx' in sys.modules)")
    environment = {**os.environ, "PYTHONPATH": str(MODELS.parent)}
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code, *words], capture_output=True, text=True, cwd=tmp_path,
                          env=environment, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "networkx loaded: False"
