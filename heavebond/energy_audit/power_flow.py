"""Energy flow of a run as a graph: components and nodes as boxes, net energies as links.

The net energy through a port is a link between its component and its node. A node with one incoming or one outgoing link
is omitted, and its neighbours are linked directly. A link that would close a cycle is kept and drawn backwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from heavebond.energy_audit.audit import EnergyAudit

LEAST = 0.005  # share of the largest link; smaller links are omitted, their lines would be invisible
SWEEPS = 6  # number of sweeps of the ordering; further sweeps make no visible difference


class BoxKey(NamedTuple):
    """A component or a node by its path."""

    path: str
    node: bool = False


@dataclass(frozen=True)
class Box:
    """A component or a node: the energy supplied, dissipated and stored over the run, in J; the `column` from the left and
    the position `row` in the column."""

    key: BoxKey
    supplied: float = 0.0
    dissipated: float = 0.0
    stored: float = 0.0
    column: int = 0
    row: int = 0


@dataclass(frozen=True)
class Link:
    """Net energy in J from one box to another, in a domain; `back` is true if it points against the order of the columns."""

    source: BoxKey
    target: BoxKey
    energy: float
    domain: str
    back: bool = False


@dataclass(frozen=True)
class EnergyFlow:
    """Boxes, and the links between them. `left_out` is the energy of the largest omitted link, in J."""

    boxes: dict[BoxKey, Box]
    links: tuple[Link, ...]
    left_out: float


def energy_flow(audit: EnergyAudit) -> EnergyFlow:
    """Build the energy flow of a run; links smaller than `LEAST` times the largest link are omitted."""
    flat = audit.result.assembly.flat
    lines, bonds = {line.component: line for line in audit.lines}, {**flat.bonds, **flat.block_bonds}
    nets = {port: float(np.trapezoid(power, audit.result.time)) for port, power in audit.ports.items()
            if bonds[port].owner in lines}
    links = []
    for port, energy in nets.items():
        # the node and the domain of a port
        domains = sorted(flat.expanded.model.library.domains.values(), key=lambda d: -len(d.across))
        domain = next(d for d in domains if all(f"{port}.{m}" in flat.names for m in (*d.across, *d.through)))
        node = flat.unknowns[flat.names[f"{port}.{domain.across[0]}"]].name.rpartition(".")[0]
        ends = (BoxKey(node, node=True), BoxKey(bonds[port].owner))
        links.append(Link(*(ends if energy > 0 else ends[::-1]), abs(energy), domain.name))
    largest = max((link.energy for link in links), default=0.0)
    small = [link.energy for link in links if link.energy < LEAST * largest]
    links_kept = _contracted([link for link in links if link.energy >= LEAST * largest and link.energy > 0])
    keys = dict.fromkeys(key for link in links_kept for key in (link.source, link.target))
    boxes = {}
    for key in keys:
        if key.node:
            boxes[key] = Box(key)
        else:
            line = lines[key.path]
            boxes[key] = Box(key, line.supplied, line.dissipated + line.unbalanced, line.stored - line.events)
    directed = _with_directions(links_kept)
    # assign columns: each box is one column after the last of its sources; a box without a source is just before its first
    # target
    column = dict.fromkeys(boxes, 0)
    for _ in boxes:  # the longest path has fewer links than there are boxes
        for link in directed:
            if not link.back:
                column[link.target] = max(column[link.target], column[link.source] + 1)
    fed = {link.target for link in directed if not link.back}
    for name in boxes:
        ahead = [column[link.target] for link in directed if link.source == name and not link.back]
        if name not in fed and ahead:
            column[name] = min(ahead) - 1
    return EnergyFlow(_ordered({name: replace(box, column=column[name]) for name, box in boxes.items()}, directed),
                      directed, max(small, default=0.0))


def _contracted(links: Sequence[Link]) -> list[Link]:
    """Remove each node with one incoming or one outgoing link, and link its neighbours directly."""
    remaining = list(links)
    for node in dict.fromkeys(key for link in links for key in (link.source, link.target) if key.node):
        inner, outer = [k for k in remaining if k.target == node], [k for k in remaining if k.source == node]
        other_links = [k for k in remaining if node not in (k.source, k.target)]
        if len(inner) == 1 and outer:
            remaining = [*other_links, *(replace(k, source=inner[0].source) for k in outer)]
        elif len(outer) == 1 and inner:
            remaining = [*other_links, *(replace(k, target=outer[0].target) for k in inner)]
    together: dict[tuple[BoxKey, BoxKey, str], float] = {}
    for link in remaining:
        key = (link.source, link.target, link.domain)
        together[key] = together.get(key, 0.0) + link.energy
    return [Link(source, target, energy, domain) for (source, target, domain), energy in together.items()]


def _with_directions(links: Sequence[Link]) -> tuple[Link, ...]:
    """Set the directions of the links, the largest first; a link that would close a cycle points back."""
    after: dict[BoxKey, set[BoxKey]] = {}

    def reaches(start: BoxKey, end: BoxKey) -> bool:
        visited, waiting = set(), [start]
        while waiting:
            name = waiting.pop()
            if name == end:
                return True
            if name not in visited:
                visited.add(name)
                waiting += after.get(name, ())
        return False

    directed = []
    for link in sorted(links, key=lambda link: -link.energy):
        back = reaches(link.target, link.source)
        if not back:
            after.setdefault(link.source, set()).add(link.target)
        directed.append(replace(link, back=back))
    return tuple(directed)


def _ordered(boxes: Mapping[BoxKey, Box], links: Sequence[Link]) -> dict[BoxKey, Box]:
    """Order the rows to reduce crossings of links: sweep over the columns and sort each by the mean rows of linked boxes."""
    columns: dict[int, list[BoxKey]] = {}
    for name, box in boxes.items():
        columns.setdefault(box.column, []).append(name)
    row = {name: float(k) for names in columns.values() for k, name in enumerate(names)}
    for sweep in range(SWEEPS):
        for column in sorted(columns, reverse=bool(sweep % 2)):
            centre: dict[BoxKey, float] = {}
            for name in columns[column]:
                beside = [(row[link.source if link.target == name else link.target], link.energy) for link in links
                          if name in (link.source, link.target)]
                weight = sum(energy for _, energy in beside)
                centre[name] = sum(place * energy for place, energy in beside) / weight if weight else row[name]
            columns[column].sort(key=centre.__getitem__)
            row.update({name: k - (len(columns[column]) - 1) / 2 for k, name in enumerate(columns[column])})
    return {name: replace(boxes[name], row=k) for names in columns.values() for k, name in enumerate(names)}
