"""The diagram as a networkx graph: parts, ports and nodes, with components, domains and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heavebond.equations.connect import Group, Network, connect
from heavebond.equations.expand import Expanded, expand
from heavebond.equations.medium import with_media
from heavebond.equations.parameters import formula_order
from heavebond.language.model import Model

if TYPE_CHECKING:
    import networkx as nx

PART, PORT, NODE = "part", "port", "node"


def diagram_graph(model: Model, open_blocks: bool = True) -> nx.Graph[tuple[str, str]]:
    """The undirected graph part - port - node of a diagram.

    The vertices are ("part", "spring"), ("port", "spring.a") and ("node", "load"); a part and a node may have one name. An
    edge joins a part with each of its ports, and a port with the node on which it is. Attributes:

    part: `component` (its kind), `block` (whether it is made of others), `file`, `line`;
    port: `domain` ("signal" for a signal), `direction` ("in" or "out" for a signal, else "power");
    node: `domain`, `across`, `through` (names of its variables, empty for a signal), `file`, `line`, `aliases` (nodes inside
    blocks that are the same).

    With `open_blocks` blocks are replaced by their parts, else they are parts themselves. Formulas that read a signal by its
    name are no edges. Raises ModelError for a diagram that cannot be assembled.
    """
    import networkx as nx

    expanded = with_media(expand(model))
    network = connect(expanded, formula_order(expanded))
    parts = [path for path in expanded.leaves if _shown(expanded, path, open_blocks)]
    graph: nx.Graph[tuple[str, str]] = nx.Graph(name=model.name)
    for path in parts:
        leaf = expanded.leaves[path]
        graph.add_node((PART, path), component=leaf.component.name, block=leaf.component.composite, file=leaf.place.file,
                       line=leaf.place.line)
    for group in network.groups:
        ends = [port for port in group.ports if port.rpartition(".")[0] in parts]
        if not ends:
            continue
        for port in ends:
            graph.add_node((PORT, port), domain=group.domain, direction=_direction(expanded, port))
            graph.add_edge((PART, port.rpartition(".")[0]), (PORT, port))
        if group.name not in group.ports:  # an output that nobody reads is on no node
            _add_node(graph, model, group, ends, network)
    return graph


def _shown(expanded: Expanded, path: str, open_blocks: bool) -> bool:
    """Whether a part is in the graph: no block where blocks are opened, else nothing inside a block."""
    if open_blocks:
        return not expanded.leaves[path].component.composite
    outer = path.split(".")
    return not any(".".join(outer[:k]) in expanded.leaves for k in range(1, len(outer)))


def _direction(expanded: Expanded, port: str) -> str:
    part, _, name = port.rpartition(".")
    signal = expanded.leaves[part].component.signals.get(name.partition("[")[0])
    return signal.direction if signal is not None else "power"


def _add_node(graph: nx.Graph[tuple[str, str]], model: Model, group: Group, ends: list[str], network: Network) -> None:
    domain = model.library.domains.get(group.domain)
    graph.add_node((NODE, group.name), domain=group.domain, across=() if domain is None else domain.across,
                   through=() if domain is None else domain.through, file=group.place.file, line=group.place.line,
                   aliases=tuple(a for a in group.aliases if a not in group.ports and a != group.name))
    graph.add_edges_from(((PORT, port), (NODE, group.name)) for port in ends)
