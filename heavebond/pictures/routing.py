"""Routing of wires on a grid: each node as a tree of horizontal and vertical pieces around pictures and names.

A* over the states (point, direction), after the common maze routers: a step costs its length; a bend, a crossing and a
neighbouring wire cost more; running along or bending on another wire has a cost so high that it counts as a fault. Every
net is routed once and then removed and routed again in the presence of the others.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise

from heavebond.pictures.pictograms import GRID, SIDES, Anchor
from heavebond.pictures.text_metrics import Box

STEP, BEND, CROSSING, NEAR, MOUTH, FAULT = 10, 35, 45, 7, 60, 4000
DIRECTIONS = ((1, 0), (0, 1), (-1, 0), (0, -1))
PASSES = 2
Point = tuple[int, int]
Edge = tuple[Point, Point]


@dataclass(frozen=True)
class Wire:
    """A routed node in px: its unit pieces, the lines they form, the points with three or more lines, and its faults."""

    edges: tuple[Edge, ...]
    lines: tuple[tuple[Point, ...], ...]
    dots: tuple[Point, ...]
    faults: int


def route(nets: Sequence[Sequence[Sequence[Anchor]]], blocked: Sequence[Box], area: Box,
          pieces: Mapping[int, Sequence[tuple[int, int, int, int]]] | None = None) -> list[Wire]:
    """Trees that connect the terminals of each net; a terminal is the anchors of one port (absolute px, on the grid).
    `blocked` are pictures and names, `area` is the permitted region of wires. `pieces` are straight lines (steps of the
    grid) that the tree of a net contains, by the index of the net.
    """
    router = _Router(nets, blocked, area, pieces or {})
    order = sorted(range(len(nets)), key=lambda k: (router.span(k), k))
    for _ in range(PASSES):
        for k in order:
            router.lay(k)
    return [router.wire(k) for k in range(len(nets))]


class _Router:
    def __init__(self, nets: Sequence[Sequence[Sequence[Anchor]]], blocked: Sequence[Box], area: Box,
                 pieces: Mapping[int, Sequence[tuple[int, int, int, int]]]):
        self.left, self.top = round(area.left) // GRID, round(area.top) // GRID
        self.width = round(area.right) // GRID - self.left + 1
        self.height = round(area.bottom) // GRID - self.top + 1
        self.nets = [[[((a.y // GRID - self.top) * self.width + a.x // GRID - self.left, DIRECTIONS.index(SIDES[a.side]))
                       for a in terminal] for terminal in net] for net in nets]
        self.steps = (1, self.width, -1, -self.width)
        self.wall = bytearray(self.width * self.height)
        for box in blocked:
            first = max(0, math.ceil(box.left / GRID) - self.left), max(0, math.ceil(box.top / GRID) - self.top)
            last = math.floor(box.right / GRID) - self.left, math.floor(box.bottom / GRID) - self.top
            for row in range(first[1], min(last[1], self.height - 1) + 1):
                for column in range(first[0], min(last[0], self.width - 1) + 1):
                    self.wall[row * self.width + column] = 1
        # the point before an anchor is its only exit: other wires avoid it
        self.mouths: dict[int, int] = {}
        for k, net in enumerate(self.nets):
            for terminal in net:
                for point, direction in terminal:
                    self.mouths[point + self.steps[direction]] = k
        self.pieces = {k: [self._piece(*piece) for piece in net_pieces] for k, net_pieces in pieces.items()}
        self.laid: list[dict[int, int]] = [{} for _ in nets]  # per net: point -> bits of the directions of its wires
        self.faults = [0] * len(nets)

    def _piece(self, x1: int, y1: int, x2: int, y2: int) -> dict[int, int]:
        """The points of a straight line, with the bits of the directions of the wire there."""
        turn = 0 if y1 == y2 else 1
        first = (min(y1, y2) - self.top) * self.width + min(x1, x2) - self.left
        length = abs(x2 - x1) + abs(y2 - y1)
        return {first + j * self.steps[turn]: (j < length) << turn | (j > 0) << (turn + 2) for j in range(length + 1)}

    def span(self, k: int) -> int:
        """Half the perimeter of the box around a net's anchors, in steps."""
        points = [point for terminal in self.nets[k] for point, _ in terminal]
        columns, rows = [p % self.width for p in points], [p // self.width for p in points]
        return max(columns) - min(columns) + max(rows) - min(rows)

    def lay(self, k: int) -> None:
        """Route net k again: from its first terminal, connecting the nearest of the others one by one."""
        self.laid[k], self.faults[k] = {}, 0
        other_nets: dict[int, int] = {}
        for j, laid in enumerate(self.laid):
            if j != k:
                for point, bits in laid.items():
                    other_nets[point] = other_nets.get(point, 0) | bits
        waiting = list(range(1, len(self.nets[k])))
        joined, apart = [0], list(self.pieces.get(k, ()))
        while waiting or apart:
            targets = {anchor: t for t in waiting for anchor in self.nets[k][t]}
            # the given pieces first, because they may be on the way to the other terminals
            path = self._path(k, other_nets, joined, {} if apart else targets, {p for piece in apart for p in piece})
            if path is None:
                self.faults[k] += 1
                break
            laid = self.laid[k]
            for a, b in pairwise(path):
                direction = self.steps.index(b - a)
                laid[a] = laid.get(a, 0) | 1 << direction
                laid[b] = laid.get(b, 0) | 1 << (direction + 2) % 4
            for point in path:
                if point in other_nets and not _crosses(laid[point], other_nets[point]):
                    self.faults[k] += 1
            if apart:
                piece = next(piece for piece in apart if path[-1] in piece)
                apart.remove(piece)
                for point, bits in piece.items():
                    laid[point] = laid.get(point, 0) | bits
                continue
            reached = next(t for (point, _), t in targets.items() if point == path[-1])
            waiting.remove(reached)
            joined.append(reached)

        ends = {point for terminal in self.nets[k] for point, _ in terminal}
        loose = [p for p, bits in self.laid[k].items() if bits.bit_count() == 1 and p not in ends]
        while k in self.pieces and loose:  # a given piece ends at the last wire that joins it
            point = loose.pop()
            bits = self.laid[k].pop(point)
            following = point + self.steps[bits.bit_length() - 1]
            self.laid[k][following] &= ~(1 << (bits.bit_length() + 1) % 4)
            if self.laid[k][following].bit_count() == 1 and following not in ends:
                loose.append(following)

    def _path(self, k: int, other_wires: dict[int, int], joined: list[int],
              targets: dict[tuple[int, int], int], lines: Set[int] = frozenset()) -> list[int] | None:
        """The cheapest path from the connected terminals to an anchor of another one (points, from the tree outwards), or
        to a point of the given `lines`, which may be reached from any side."""
        width, steps, wall = self.width, self.steps, self.wall
        ends = {point: (direction + 2) % 4 for point, direction in targets}  # arrival is opposite to the exit direction
        goals = [(p % width, p // width) for p in (*ends, *lines)]
        best: dict[int, int] = {}
        came: dict[int, int] = {}
        ahead: dict[int, int] = {}  # least cost from a point to the nearest goal
        heap: list[tuple[int, int, int]] = []

        def push(state: int, cost: int, before: int) -> None:
            if cost < best.get(state, 1 << 60):
                best[state], came[state] = cost, before
                point = state >> 2
                if point not in ahead:
                    y, x = divmod(point, width)
                    ahead[point] = STEP * min([abs(x - gx) + abs(y - gy) for gx, gy in goals])
                heapq.heappush(heap, (cost + ahead[point], cost, state))

        for state, cost in self._beginnings(k, joined):
            push(state, cost, -1)
        while heap:
            _, cost, state = heapq.heappop(heap)
            if cost > best[state]:
                continue
            point, direction = state >> 2, state & 3
            if (ends.get(point) == direction and came[state] >= 0) or point in lines:
                path = [state >> 2]
                while came[state] >= 0:
                    state = came[state]
                    path.append(state >> 2)
                return path[::-1]
            start = came[state] < 0
            for turn in (direction,) if start else (direction, (direction + 1) % 4, (direction + 3) % 4):
                bend = turn != direction
                following = point + steps[turn]
                column = point % width + DIRECTIONS[turn][0]
                if not (0 <= following < len(wall) and 0 <= column < width) or (
                        wall[following] and following not in ends and following not in lines):
                    continue
                extra = BEND * bend
                if point in other_wires and (bend or start or other_wires[point] & (1 << turn | 1 << (turn + 2) % 4)):
                    extra += FAULT
                # cost of a point in addition to the step: crossings, neighbours, exits of other ports
                price = MOUTH if self.mouths.get(following, k) != k else 0
                if following in other_wires:
                    price += CROSSING if _crosses(1 << turn | 1 << (turn + 2) % 4, other_wires[following]) else FAULT
                for side in (self.steps[(turn + 1) % 4], self.steps[(turn + 3) % 4]):
                    near = following + side
                    if near in other_wires and other_wires[near] & (1 << turn):
                        price += NEAR
                    elif 0 <= near < len(self.wall) and self.wall[near]:
                        price += NEAR // 3
                push(following << 2 | turn, cost + STEP + extra + price, state)
        return None

    def _beginnings(self, k: int, joined: Iterable[int]) -> Iterator[tuple[int, int]]:
        """Start points of a further branch, with their cost: connected ports, and every point of the tree."""
        laid = self.laid[k]
        for t in joined:
            for point, direction in self.nets[k][t]:
                yield point << 2 | direction, BEND if point in laid else 0
        for point, bits in laid.items():
            for direction in range(4):
                if not self.wall[point] and not bits >> direction & 1:
                    yield point << 2 | direction, BEND // 2

    def wire(self, k: int) -> Wire:
        """Net k in px."""
        laid = self.laid[k]

        def place(point: int) -> Point:
            return (point % self.width + self.left) * GRID, (point // self.width + self.top) * GRID

        edges = tuple((place(p), place(p + self.steps[d])) for p in sorted(laid) for d in (0, 1) if laid[p] >> d & 1)
        dots = tuple(place(p) for p in sorted(laid) if laid[p].bit_count() > 2)
        return Wire(edges, tuple(_lines(edges)), dots, self.faults[k])


def _crosses(directions: int, other_directions: int) -> bool:
    """True if two wires cross at a point straight and at a right angle: bits of their directions."""
    return (directions, other_directions) in ((0b0101, 0b1010), (0b1010, 0b0101))


def _lines(edges: Iterable[Edge]) -> Iterator[tuple[Point, ...]]:
    """Join unit pieces to polylines from end to end or branch to branch, with their corners only."""
    around: dict[Point, list[Point]] = {}
    for a, b in edges:
        around.setdefault(a, []).append(b)
        around.setdefault(b, []).append(a)
    used: set[Edge] = set()
    for begin in sorted(p for p, near in around.items() if len(near) != 2):
        for following in around[begin]:
            if (begin, following) in used:
                continue
            line = [begin, following]
            used |= {(begin, following), (following, begin)}
            while len(around[line[-1]]) == 2:
                ahead = next(p for p in around[line[-1]] if p != line[-2])
                used |= {(line[-1], ahead), (ahead, line[-1])}
                line.append(ahead)
            corners = [line[0]]
            for before, point, after in zip(line, line[1:], line[2:], strict=False):
                if not (before[0] == point[0] == after[0] or before[1] == point[1] == after[1]):
                    corners.append(point)
            yield (*corners, line[-1])
