"""Power ports without a connection: determination whether their flow or their effort is 0.

A bond of 20-sim without a partner has the causality of its submodel: a port that receives an effort, such as a mass, has
effort 0, one that receives a flow has flow 0. The causality follows from a maximum matching of equations and unknowns, in
which states are known and one equation of each free port determines its flow, or else its effort.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from heavebond.import_20sim.block import Block
from heavebond.import_20sim.choices import names
from heavebond.import_20sim.component import Component
from heavebond.import_20sim.sidops_tree import Expr

Rows = list[set[str]]  # the unknowns of each equation


def with_free_effort(components: list[tuple[str, Component]], blocks: list[tuple[str, Block]]) -> list[tuple[Block, str]]:
    """The nodes with one end whose effort must be 0, with their blocks: with flow 0, no equation would determine it."""
    free = [(path, block, name, ends[0]) for path, block in blocks for name, ends in block.nodes.items()
            if len(ends) == 1 and block.is_bond(ends[0])]
    if not free:
        return []
    rows: Rows = []
    for path, component in components:
        rows += _of_component(f"{path}." if path else "", component)
    for path, block in blocks:
        rows += _of_block(f"{path}." if path else "", block)
    ports = [f"{path}.{end}" if path else end for path, _, _, end in free]
    ends = [{f"{port}.f"} for port in ports]
    loose = [{f"{port}.e", f"{port}.f"} for port in ports]
    most = _matched([*rows, *loose])
    for k, (_, block, _, end) in enumerate(free):
        first, second = ("e", "f") if _gives_flow(block, end) else ("f", "e")
        ends[k] = {f"{ports[k]}.{first}"}
        if _matched([*rows, *ends[:k + 1], *loose[k + 1:]]) < most:
            ends[k] = {f"{ports[k]}.{second}"}
    return [(block, name) for (_, block, name, _), row in zip(free, ends, strict=True) if next(iter(row)).endswith(".e")]


def _gives_flow(block: Block, end: str) -> bool:
    """True if the equations of a port state its flow: they may contain its effort too without determining it."""
    name, _, port = end.partition(".")
    what = next(p.what for p in block.parts.values() if p.name == name)
    if isinstance(what, Component):
        stated = {left.args[0].name if left.op == "negative" else left.name for left, *_ in what.equations}
        return f"{port}.f" in stated and f"{port}.e" not in stated
    inner = [e for ends in what.nodes.values() if port in ends for e in ends if e != port and what.is_bond(e)]
    return len(inner) == 1 and "." in inner[0] and _gives_flow(what, inner[0])


def _rates(expr: Expr) -> Iterator[str]:
    """The names whose rates occur in an expression."""
    if expr.op == "call" and expr.name == "der":
        yield from names(expr)
    for e in expr.args:
        yield from _rates(e)


def _of_component(prefix: str, made: Component) -> Rows:
    sides = [(left, right) for left, right, _ in made.equations]
    rates = [{*_rates(left), *_rates(right)} for left, right in sides]
    states = set().union(*rates) if rates else set()
    kinds = {name: item.kind for name, item in made.items.items()}

    def unknown(name: str) -> bool:
        base = name.partition(".")[0]
        return name not in states and kinds.get(base) in ("variable", "out", "in", "bond") and base not in made.shared

    return [{prefix + n for e in pair for n in names(e) if unknown(n)} | {f"{prefix}der {n}" for n in base}
            for pair, base in zip(sides, rates, strict=True)]


def _of_block(prefix: str, block: Block) -> Rows:
    rows: Rows = []
    for ends in block.nodes.values():
        own_ends = [prefix + end for end in ends]
        if len(own_ends) > 1 and block.is_bond(ends[0]):
            rows += [{f"{own_ends[0]}.e", f"{end}.e"} for end in own_ends[1:]]
            rows.append({f"{end}.f" for end in own_ends})
        elif not block.is_bond(ends[0]):
            rows += [{own_ends[0], end} for end in own_ends[1:]]
    for sides in block.equations:
        rows.append({prefix + n for side in sides for n in re.findall(r"[A-Za-z_][\w.]*", side)})
    return rows + [{f"{prefix}{part.name}.{name}"} for part in block.parts.values() for name in part.inputs]


def _matched(rows: Rows) -> int:
    """Number of matched equations."""
    numbers: dict[str, int] = {}
    pairs = [(i, numbers.setdefault(n, len(numbers))) for i, row in enumerate(rows) for n in sorted(row)]
    if not pairs:
        return 0
    i, k = np.array(pairs).T
    graph = csr_array((np.ones(len(pairs), dtype=np.int8), (i, k)), shape=(len(rows), len(numbers)))
    return int(np.count_nonzero(maximum_bipartite_matching(graph, perm_type="column") >= 0))
