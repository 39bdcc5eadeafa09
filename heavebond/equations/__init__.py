"""From a diagram to a reduced system of equations: expansion, node balances, structural analysis, index reduction."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heavebond.core.facade import provides

if TYPE_CHECKING:
    import networkx as nx

    from heavebond.language.model import Model


@provides("Model.graph")
def _graph(model: Model, open_blocks: bool) -> nx.Graph[tuple[str, str]]:
    from heavebond.equations.diagram_graph import diagram_graph

    return diagram_graph(model, open_blocks)
