"""The diagram as a networkx graph: parts, ports and nodes, with components, domains and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heavebond.equations.connect import connect, signal_unit
from heavebond.equations.expand import expand
from heavebond.equations.medium import with_media
from heavebond.equations.parameters import formula_order
from heavebond.language.model import Model

if TYPE_CHECKING:
    import networkx as nx

PART, PORT, NODE = "part", "port", "node"


def diagram_graph(model: Model, open_blocks: bool = True) -> nx.Graph[tuple[str, str]]:
    """The undirected graph part - port - node of a diagram.

    The vertices are ("part", "spring"), ("port", "spring.a") and ("node", "load"); a part and a node may have one name. An
    edge joins a part with each of its ports, and a port with the node to which it is connected. Attributes:

    part: `kind` ("part"), `component`, `block` (whether it is made of others), `file`, `line`;
    port: `kind` ("port"), `domain` ("signal" for a signal), `direction` ("in" or "out" for a signal, else "power"), `file`,
    `line` (of the connection; of the part for a port without one);
    node: `kind` ("node"), `domain`, `across`, `through` (names of its variables), `effort`, `flow` (the two whose product is
    the power; empty if the domain has none), `units` (unit by variable, SI; of a signal under the node's name), `file`,
    `line`, `aliases` (nodes inside blocks that are the same);
    edge: `domain`, and for a signal `source` and `target`, the vertices in the direction of the signal.

    With `open_blocks` blocks are replaced by their parts, else they are parts themselves. Formulas that read a signal by its
    name give no edges. Raises ModelError for a diagram that cannot be assembled.
    """
    import networkx as nx

    expanded = with_media(expand(model))
    network = connect(expanded, formula_order(expanded))
    graph: nx.Graph[tuple[str, str]] = nx.Graph(name=model.name)
    for path, leaf in expanded.leaves.items():
        # with opened blocks all parts except blocks are in the graph, otherwise all outside blocks
        outer = path.split(".")
        if not leaf.component.composite if open_blocks else \
                not any(".".join(outer[:k]) in expanded.leaves for k in range(1, len(outer))):
            graph.add_node((PART, path), kind=PART, component=leaf.component.name, block=leaf.component.composite,
                           file=leaf.place.file, line=leaf.place.line)
    connections = {end.name: end.place for junction in expanded.junctions.values() for end in junction.ends if end.sign > 0}
    for group in network.groups:
        ends = [port for port in group.ports if (PART, port.rpartition(".")[0]) in graph]
        joined = group.name not in group.ports  # a port without a connection is on no node
        if ends and joined:
            domain = expanded.model.library.domains.get(group.domain)
            if domain is None:
                unit = signal_unit(expanded, group.ports[0], network.units)
                variables: dict[str, object] = {"across": (), "through": (), "effort": "", "flow": "",
                                                "units": {group.name: unit.text}}
            else:
                units = {name: member.unit.text for name, member in domain.members.items()}
                variables = {"across": domain.across, "through": domain.through, "effort": domain.effort or "",
                             "flow": domain.flow or "", "units": units}
            aliases = tuple(a for a in group.aliases if a not in group.ports and a != group.name)
            graph.add_node((NODE, group.name), kind=NODE, domain=group.domain, file=group.place.file, line=group.place.line,
                           aliases=aliases, **variables)
        for port in ends:
            part = port.rpartition(".")[0]
            place = connections.get(port, expanded.leaves[part].place)
            signal = expanded.leaves[part].component.signal(port.rpartition(".")[2])
            direction = "power" if signal is None else signal.direction
            graph.add_node((PORT, port), kind=PORT, domain=group.domain, direction=direction, file=place.file,
                           line=place.line)
            _add_edge(graph, (PART, part), (PORT, port), group.domain, direction)
            if joined:
                _add_edge(graph, (PORT, port), (NODE, group.name), group.domain, direction)
    return graph


def _add_edge(graph: nx.Graph[tuple[str, str]], inner: tuple[str, str], outer: tuple[str, str], domain: str,
              direction: str) -> None:
    """An edge of the chain part - port - node, `inner` nearer to the part; a signal runs outwards at an output."""
    if direction == "power":
        graph.add_edge(inner, outer, domain=domain)
    else:
        source, target = (inner, outer) if direction == "out" else (outer, inner)
        graph.add_edge(inner, outer, domain=domain, source=source, target=target)

