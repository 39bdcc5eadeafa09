"""Placement of the parts of a sheet: cells of a grid, rotation of each picture, sides of the ports of boxes.

Parts with a place in the diagram stay there. The others begin next to the parts to which they are connected and move from
cell to cell while the wires become shorter and straighter (a descent over single moves and swaps, in a fixed order, so
that the same diagram is always drawn in the same way).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from heavebond.pictures.pictograms import MIRROR, SIDES, STRAIGHT, Matrix, Shape

AROUND = 30
PITCH_X, PITCH_Y = 150, 110  # px from cell to cell in the choice of cells
BEND, BETWEEN, UNNATURAL = 45, 110, 50
# small cost per px from the first cell, and per cell to the left of it or above: reading begins there
FAR, BEFORE = 0.02, 25
TURNED = 2  # earlier rotations in the list are more usual
# the first wire of a part leaves on a side other than the preferred ones, and on the opposite side
ASIDE, INVERTED = 30, 80
SWEEPS, STARTS = 6, 5
OPPOSITE = {"left": "right", "right": "left", "top": "bottom", "bottom": "top"}
MOST_MOVED = 40  # larger sheets are not improved, because each sweep tries every pair; parts stay next to their neighbours
NEIGHBOURS = 6
Cell = tuple[int, int]
Place = tuple[int, int, str]  # x, y, side
Exits = tuple[tuple[Place, float], ...]  # possible ends of a wire relative to a piece, with the cost of an unusual side


@dataclass(frozen=True)
class Piece:
    """A placed element: a part or a port of the sheet's edge. `shape` is None if its ports may be on any side.

    side: the edge of a port of the sheet itself; natural: the usual sides of a port; ends: the two ports of a box on
    its left and right, in either order; facing: the direction of its picture's left to right, if the diagram gives it;
    mirrored: whether the picture is reflected, if the diagram says so; leave: the sides on which the wire of the first
    port preferably leaves.
    """

    name: str
    ports: tuple[str, ...]
    shape: Shape | None
    at: Cell | None = None
    side: str = ""
    natural: dict[str, tuple[str, ...]] = field(default_factory=dict)
    ends: tuple[str, ...] = ()
    facing: tuple[int, int] | None = None
    mirrored: bool | None = None
    leave: tuple[str, ...] = ()

    @property
    def turns(self) -> tuple[Matrix, ...]:
        """Permitted rotations; the ends of a box may be exchanged. If the given direction is impossible for a picture,
        all its rotations are permitted."""
        turns = self.shape.turns if self.shape is not None else (STRAIGHT, MIRROR) if self.ends else (STRAIGHT,)
        facing = tuple(turn for turn in turns if turn[:2] == self.facing)
        exact = tuple(turn for turn in facing if self.mirrored is not None
                      and self.mirrored == (turn[0] * turn[3] < turn[1] * turn[2]))
        return exact or facing or turns

    @cached_property
    def different(self) -> tuple[Matrix, ...]:
        """The first of the rotations that place all ports alike (a spring and its reflection)."""
        first: dict[tuple[Exits, ...], Matrix] = {}
        for turn in self.turns:
            first.setdefault(tuple(self.exits(port, turn) for port in self.ports), turn)
        return tuple(first.values())

    @cached_property
    def turn_costs(self) -> dict[Matrix, float]:
        """Cost of each rotation: by its place in the list, and by the side on which the first wire leaves. A source is on
        the left of its neighbours or above them, a fixed point below them."""
        costs = {STRAIGHT: 0.0}
        for k, turn in enumerate(self.turns):
            side = self.shape.turned(turn).of(self.ports[0])[0].side if self.shape is not None and self.leave else ""
            aside = 0 if not side or side in self.leave else INVERTED if (OPPOSITE[side],) == self.leave else ASIDE
            costs[turn] = TURNED * k + aside
        return costs

    def exits(self, port: str, turn: Matrix) -> Exits:
        """Possible ends of a wire at a port of the rotated piece, relative to the piece."""
        if self.side:
            return (((0, 0, OPPOSITE[self.side]), 0.0),)
        if self.shape is not None:
            return tuple(((a.x, a.y, a.side), 0.0) for a in self.shape.turned(turn).of(port))
        if port in self.ends:
            side = ("left", "right")[(self.ends.index(port) + (turn == MIRROR)) % 2]
            return (((40 * SIDES[side][0], 0, side), 0.0),)
        usual = self.natural.get(port, tuple(SIDES))
        return tuple(((40 * out[0], 25 * out[1], side), 0.0 if side in usual else UNNATURAL) for side, out in SIDES.items())


class Wires:
    """Costs of wires between ports by their exits, which many ports share, and by the distance of the pieces in cells."""

    def __init__(self) -> None:
        self.numbers: dict[Exits, int] = {}
        self.exits: list[Exits] = []
        self.costs: dict[tuple[int, int], dict[Cell, float]] = {}

    def number(self, exits: Exits) -> int:
        """The number of the exits of a port."""
        if exits not in self.numbers:
            self.numbers[exits] = len(self.exits)
            self.exits.append(exits)
        return self.numbers[exits]

    def cost(self, one: int, two: int, across: int, down: int) -> float:
        """Cost of the cheapest wire between exits `one` and exits `two`, which are so many cells to the right and below."""
        costs = self.costs.get((one, two))
        if costs is None:
            costs = self.costs[one, two] = {}
        cost = costs.get((across, down))
        if cost is None:
            cost = costs[across, down] = cheapest(self.exits[one], shifted(self.exits[two], across, down))[0]
            self.costs.setdefault((two, one), {})[-across, -down] = cost
        return cost


def shifted(exits: Exits, across: int, down: int) -> Exits:
    """Exits of a piece so many cells to the right and below."""
    return tuple(((x + across * PITCH_X, y + down * PITCH_Y, side), extra) for (x, y, side), extra in exits)


def cheapest(one: Exits, two: Exits) -> tuple[float, Place, Place]:
    """The cheapest wire between two ports, and its ends."""
    return min(((extra + more + wire_cost(p, q), p, q) for p, extra in one for q, more in two), key=lambda wire: wire[0])


@dataclass(frozen=True)
class Placement:
    """Cell and rotation of each piece; the sides of the ports of pieces without a fixed shape, in order along the side;
    the sides on which wires probably leave each piece (a mass has an anchor on each, and few are used)."""

    cells: dict[str, Cell]
    turns: dict[str, Matrix]
    sides: dict[str, dict[str, list[str]]]
    leaving: dict[str, frozenset[str]]


def place(pieces: Sequence[Piece], nets: Sequence[Sequence[tuple[str, str]]]) -> Placement:
    """Cells, rotations and sides for pieces that are connected by nets of (piece, port)."""
    free = [piece.name for piece in pieces if piece.at is None and not piece.side]
    few = len(free) <= MOST_MOVED
    wires = Wires()
    search = min((_searched(pieces, nets, first, few, wires) for first in (free[:STARTS] if few else free[:1]) or [""]),
                 key=lambda tried: tried.cost())
    cells = _compressed(search.cells, {p.name: p.side for p in pieces})
    return Placement(cells, dict(search.turns), search.sides(), search.leaving())


def _searched(pieces: Sequence[Piece], nets: Sequence[Sequence[tuple[str, str]]], first: str, few: bool, wires: Wires
              ) -> _Search:
    """A descent that begins with the free piece `first`: each start leads to another local minimum. `wires` keeps costs
    of wires from one descent to the next."""
    search = _Search(pieces, nets, wires)
    search.begin(first)
    for _ in range(SWEEPS if few else 0):
        if not search.sweep():
            break
    return search


def _compressed(cells: dict[str, Cell], sides: dict[str, str]) -> dict[str, Cell]:
    """Remove empty columns and rows; pieces of an edge get a separate column or row."""
    inner = [cell for name, cell in cells.items() if not sides[name]] or [(0, 0)]
    columns = {c: k for k, c in enumerate(sorted({c for c, _ in inner}))}
    rows = {r: k for k, r in enumerate(sorted({r for _, r in inner}))}

    def near(value: int, known: dict[int, int]) -> int:
        return known[min(known, key=lambda k: (abs(k - value), k))]

    compressed_cells = {}
    for name, (c, r) in cells.items():
        across, down = near(c, columns), near(r, rows)
        compressed_cells[name] = {"left": (-1, down), "right": (len(columns), down), "top": (across, -1),
                                  "bottom": (across, len(rows))}.get(sides[name], (across, down))
    return compressed_cells


class _Search:
    def __init__(self, pieces: Sequence[Piece], nets: Sequence[Sequence[tuple[str, str]]], wires: Wires):
        self.pieces = {p.name: p for p in pieces}
        self.nets = [list(net) for net in nets]
        self.of: dict[str, list[int]] = {name: [] for name in self.pieces}
        for k, net in enumerate(self.nets):
            for name in dict.fromkeys(n for n, _ in net):
                self.of[name].append(k)
        self.on_edge = [p.name for p in pieces if p.side]
        self.wires = wires
        # for each net its pieces, each with the number of the exits of its port by rotation
        self.ends = [[(name, {turn: wires.number(self.pieces[name].exits(port, turn))
                              for turn in (STRAIGHT, *self.pieces[name].turns)}) for name, port in net] for net in self.nets]
        self.cells: dict[str, Cell] = {}
        self.turns: dict[str, Matrix] = {}
        self.taken: dict[Cell, str] = {}

    def cost(self) -> float:
        """Cost of the whole sheet."""
        return self._cost_around(list(self.pieces))

    # -- moves -----------------------------------------------------------------------------------------------------
    def begin(self, first: str) -> None:
        """Place the given pieces, and `first`; then, in turn, the piece with most connections to placed ones in its best
        free cell.
        """
        for piece in self.pieces.values():
            if piece.at is not None:
                cell = piece.at
                while cell in self.taken:  # two parts may have the same given place
                    cell = (cell[0], cell[1] + 1)
                self._put(piece.name, cell, piece.turns[0])
        edge = max(3, math.isqrt(2 * len(self.pieces)) + 2)
        for side in SIDES:
            for k, piece in enumerate(p for p in self.pieces.values() if p.side == side):
                cell = {"left": (-1, k), "right": (edge, k), "top": (k, -1), "bottom": (k, edge)}[side]
                self._put(piece.name, cell, STRAIGHT)
        waiting = [name for name in self.pieces if name not in self.cells]
        count = len(waiting)
        while waiting:
            # the piece with the most nets to placed pieces
            name = max(waiting, key=lambda n: (sum(any(m in self.cells for m, _ in self.nets[k]) for k in self.of[n]),
                                               self._directions(n), -waiting.index(n)))
            name = first if first in waiting and len(waiting) == count else name
            waiting.remove(name)
            self._put(name, *self._best(name))
        for piece in self.pieces.values():
            self._turn(piece.name)
        for net in self.nets if len(self.pieces) <= MOST_MOVED else ():
            names = list(dict.fromkeys(name for name, _ in net))
            for k, first in enumerate(names):
                for second in names[k + 1:]:
                    # rotate two pieces on one node together, which may lower the cost if single rotations do not: a spring
                    # and a damper in parallel
                    before = self.turns[first], self.turns[second]
                    best, chosen = self._cost_around([first, second]) - 1e-6, before
                    for one in self.pieces[first].different:
                        for two in self.pieces[second].different:
                            self.turns[first], self.turns[second] = one, two
                            cost = self._cost_around([first, second], best)
                            if cost < best:
                                best, chosen = cost, (one, two)
                    self.turns[first], self.turns[second] = chosen

    def _directions(self, name: str) -> int:
        """Number of directions in which a chain may continue from a piece; end pieces, such as a weight, wait until the
        chain is placed.
        """
        shape = self.pieces[name].shape
        return len(self.of[name]) if shape is None else len(shape.anchors)

    def sweep(self) -> bool:
        """Move every piece once to its cheapest cell, then swap pairs; returns True if the cost fell."""
        better = False
        for piece in self.pieces.values():
            before = self._cost_around([piece.name])
            old = self.cells[piece.name], self.turns[piece.name]
            if piece.at is not None:
                self._turn(piece.name)
            else:
                self._lift(piece.name)
                self._put(piece.name, *self._best(piece.name))
            if self._cost_around([piece.name]) < before - 1e-6:
                better = True
            else:
                self._lift(piece.name)
                self._put(piece.name, *old)
        free = [p.name for p in self.pieces.values() if p.at is None]
        for k, first in enumerate(free):
            for second in free[k + 1:]:
                better |= self._swap(first, second)
        return better

    def _swap(self, first: str, second: str) -> bool:
        if self.pieces[first].side != self.pieces[second].side:
            return False
        before = self._cost_around([first, second])
        a, b = self.cells[first], self.cells[second]
        turns = self.turns[first], self.turns[second]
        for one, cell in ((first, b), (second, a)):
            self._lift(one)
            self.cells[one], self.turns[one] = cell, self.pieces[one].turns[0]
        self.taken[a], self.taken[b] = second, first
        self._turn(first)
        self._turn(second)
        if self._cost_around([first, second], before - 1e-6) < before - 1e-6:
            return True
        self.cells[first], self.cells[second] = a, b
        self.turns[first], self.turns[second] = turns
        self.taken[a], self.taken[b] = first, second
        return False

    def _put(self, name: str, cell: Cell, turn: Matrix) -> None:
        self.cells[name], self.turns[name], self.taken[cell] = cell, turn, name

    def _lift(self, name: str) -> None:
        self.taken.pop(self.cells.pop(name), None)

    def _turn(self, name: str) -> None:
        """Rotate a piece to the lowest cost of its wires, the first rotation among equal ones."""
        turns = self.pieces[name].different
        if len(turns) > 1:
            best, chosen = math.inf, turns[0]
            for turn in turns:
                self.turns[name] = turn
                cost = self._cost_around([name], best)
                if cost < best:
                    best, chosen = cost, turn
            self.turns[name] = chosen

    def _best(self, name: str) -> tuple[Cell, Matrix]:
        """The free cell and the rotation with the lowest cost of a removed piece."""
        cells, turns = [cell for cell in self._choices(name) if cell not in self.taken], self.pieces[name].different
        total = sum((self._net_costs(k, name, cells, turns) for k in self.of[name]),
                    np.zeros((len(cells), len(turns))))
        total += np.array([self._place_cost(name, cell) for cell in cells])[:, None]
        total += [self.pieces[name].turn_costs[turn] for turn in turns]
        best: tuple[float, Cell, Matrix] | None = None
        for cell, costs in zip(cells, total.tolist(), strict=True):
            for turn, cost in zip(turns, costs, strict=True):
                if best is None or cost < best[0] - 1e-6:
                    best = cost, cell, turn
        assert best is not None
        return best[1], best[2]

    def _choices(self, name: str) -> Iterable[Cell]:
        side = self.pieces[name].side
        inner = [c for n, c in self.cells.items() if n != name and not self.pieces[n].side] or [(0, 0)]
        left, right = min(c for c, _ in inner), max(c for c, _ in inner)
        top, bottom = min(r for _, r in inner), max(r for _, r in inner)
        if side in ("left", "right"):
            column = left - 2 if side == "left" else right + 2
            return [(column, r) for r in range(top - 1, bottom + 2)]
        if side:
            row = top - 2 if side == "top" else bottom + 2
            return [(c, row) for c in range(left - 1, right + 2)]
        near = [self.cells[n] for k in self.of[name] for n, _ in self.nets[k] if n in self.cells]
        if len(self.pieces) > MOST_MOVED and near:
            around = dict.fromkeys((c + i, r + j) for c, r in near[:NEIGHBOURS] for j in range(-2, 3) for i in range(-2, 3))
            return [cell for cell in around if cell not in self.taken] or [(right + 1, top)]
        return [(c, r) for r in range(top - 1, bottom + 2) for c in range(left - 1, right + 2)]

    # -- cost ------------------------------------------------------------------------------------------------------
    def _cost_around(self, names: list[str], most: float = math.inf) -> float:
        """Cost of the nets of some pieces, of their rotations, of their distance from the rest, and a little of height:
        paper is wide. Costs above `most` need not be exact: all contributions are positive."""
        total = 0.0
        for k in self.of[names[0]] if len(names) == 1 else dict.fromkeys(k for name in names for k in self.of[name]):
            total += self._net_cost(k, most - total)
            if total >= most:
                return total
        for name in names:
            if name in self.cells:
                total += self._place_cost(name, self.cells[name]) + self.pieces[name].turn_costs[self.turns[name]]
        return total

    def _place_cost(self, name: str, cell: Cell) -> float:
        """Cost of a cell for a piece: distance from the first cell and from the edges of the sheet."""
        if self.pieces[name].side:
            return 0.0
        c, r = cell
        return (FAR * (abs(c) * PITCH_X + 2 * abs(r) * PITCH_Y) + BEFORE * (max(0, -c) + max(0, -r))
                + sum(BETWEEN for piece in self.on_edge if self._beyond_edge(piece, cell)))

    def _beyond_edge(self, neighbour: str, cell: Cell) -> bool:
        edge = self.cells.get(neighbour)
        return edge is not None and {"left": cell[0] <= edge[0], "right": cell[0] >= edge[0], "top": cell[1] <= edge[1],
                                     "bottom": cell[1] >= edge[1]}[self.pieces[neighbour].side]

    def _net_cost(self, k: int, most: float = math.inf) -> float:
        """The length of a tree over the placed terminals, with costs of bends and parts in between; costs above `most`
        need not be exact."""
        length = 0.0
        for cost, _, _ in self._tree(k):
            length += cost
            if length >= most:
                break
        return length

    def _net_costs(self, k: int, name: str, cells: Sequence[Cell], turns: Sequence[Matrix]) -> np.ndarray:
        """`_net_cost` with the removed piece `name` in each of some free cells with each of some rotations."""
        ends = [(self.cells.get(end), numbers, end == name) for end, numbers in self.ends[k]]
        fixed = [(cell, numbers[self.turns[end]]) for (cell, numbers, _), (end, _) in zip(ends, self.ends[k], strict=True)
                 if cell is not None]
        own_ends = [numbers for _, numbers, is_own in ends if is_own]
        n = len(fixed) + len(own_ends)
        cost = np.zeros((len(cells), len(turns), n, n))
        for i, ((x, y), one) in enumerate(fixed):
            for j, ((u, v), two) in enumerate(fixed[:i]):
                cost[:, :, i, j] = self.wires.cost(one, two, u - x, v - y) + self._between(x, y, u, v)
                if x == u or y == v:
                    inside = [min(x, u) <= c <= max(x, u) and min(y, v) <= r <= max(y, v) for c, r in cells]
                    cost[inside, :, i, j] += BETWEEN
        for i, numbers in enumerate(own_ends, len(fixed)):
            for j, ((u, v), two) in enumerate(fixed):
                between = [self._between(c, r, u, v) for c, r in cells]
                lengths = {one: [self.wires.cost(one, two, u - c, v - r) for c, r in cells]
                           for one in {numbers[turn] for turn in turns}}
                cost[:, :, i, j] = np.transpose([lengths[numbers[turn]] for turn in turns]) + np.reshape(between, (-1, 1))
            for j, earlier in enumerate(own_ends[:i - len(fixed)], len(fixed)):
                cost[:, :, i, j] = [self.wires.cost(numbers[turn], earlier[turn], 0, 0) for turn in turns]
        cost += np.swapaxes(cost, 2, 3)
        # Prim's tree for all cells and rotations at once
        total, reach, waiting = np.zeros(cost.shape[:2]), cost[:, :, 0].copy(), np.ones(cost.shape[:3], dtype=bool)
        waiting[:, :, 0] = False
        for _ in range(n - 1):
            reach[~waiting] = math.inf
            nearest = reach.argmin(axis=2)[:, :, None]
            total += np.take_along_axis(reach, nearest, 2)[:, :, 0]
            np.put_along_axis(waiting, nearest, False, 2)
            reach = np.minimum(reach, np.take_along_axis(cost, nearest[..., None], 2)[:, :, 0])
        return total

    def _between(self, x: int, y: int, u: int, v: int) -> int:
        """Cost of the pieces between two cells of one row or column."""
        if y == v:
            return BETWEEN * sum((c, y) in self.taken for c in range(min(x, u) + 1, max(x, u)))
        if x == u:
            return BETWEEN * sum((x, r) in self.taken for r in range(min(y, v) + 1, max(y, v)))
        return 0

    def _tree(self, k: int) -> Iterator[tuple[float, int, int]]:
        """The cheapest tree over the placed ends of a net (Prim): cost of each piece and the two ends that it joins."""
        cells, turns, occupied, known = self.cells, self.turns, self.taken, self.wires.costs
        waiting = [(i, *cells[name], numbers[turns[name]])
                   for i, (name, numbers) in enumerate(self.ends[k]) if name in cells]
        if len(waiting) < 2:
            return
        reach, nearest = [(math.inf, 0)] * len(self.ends[k]), waiting.pop(0)
        while waiting:
            j, x, y, one = nearest
            least = math.inf, 0
            for end in waiting:
                i, u, v, two = end
                # the cost depends on the distance of the two only, so most of it has been computed before
                costs = known.get((one, two))
                cost = costs.get((u - x, v - y)) if costs else None
                if cost is None:
                    cost = self.wires.cost(one, two, u - x, v - y)
                if y == v:
                    for c in range(x + 1, u) if x < u else range(u + 1, x):
                        if (c, y) in occupied:
                            cost += BETWEEN
                elif x == u:
                    for r in range(y + 1, v) if y < v else range(v + 1, y):
                        if (x, r) in occupied:
                            cost += BETWEEN
                best_reach = reach[i]
                if (cost, j) < best_reach:
                    best_reach = reach[i] = cost, j
                if best_reach < least:
                    least, nearest = best_reach, end
            waiting.remove(nearest)
            yield (*least, nearest[0])

    def leaving(self) -> dict[str, frozenset[str]]:
        """The sides on which the trees of the nets leave each piece."""
        sides_by_piece: dict[str, set[str]] = {name: set() for name in self.pieces}
        for k in range(len(self.nets)):
            for _, i, j in self._tree(k):
                one, two = self.nets[k][i], self.nets[k][j]
                _, p, q = cheapest(self._places(*one), self._places(*two))
                sides_by_piece[one[0]].add(p[2])
                sides_by_piece[two[0]].add(q[2])
        return {name: frozenset(sides) for name, sides in sides_by_piece.items()}

    def _places(self, name: str, port: str) -> Exits:
        """Possible ends of a wire at a port, with the cost of an unusual side."""
        return shifted(self.pieces[name].exits(port, self.turns[name]), *self.cells[name])

    # -- sides -----------------------------------------------------------------------------------------------------
    def sides(self) -> dict[str, dict[str, list[str]]]:
        """For each piece without a fixed shape its ports by side, in the order of their neighbours."""
        sides_by_piece = {}
        for piece in self.pieces.values():
            if piece.shape is None and not piece.side:
                chosen: dict[str, list[tuple[float, float, int, str]]] = {side: [] for side in SIDES}
                partners = [self._partners(piece.name, port) for port in piece.ports]
                for k, port in enumerate(piece.ports):
                    if partners[k]:
                        side, order = self._side(piece, port, partners[k])
                        chosen[side].append((*order, k, port))
                for k, port in enumerate(piece.ports):
                    if not partners[k]:
                        options = self._places(piece.name, port)
                        (_, _, side), _ = min(options, key=lambda option: (option[1], len(chosen[option[0][2]])))
                        chosen[side].append((0.0, 0.0, k, port))
                sides_by_piece[piece.name] = {side: [port for *_, port in sorted(ports)] for side, ports in chosen.items()}
        return sides_by_piece

    def _partners(self, name: str, port: str) -> list[Place]:
        """Possible places of the neighbours of a port."""
        net = next((net for net in self.nets if (name, port) in net), [])
        return [place for neighbour, p in net if neighbour != name for place, _ in self._places(neighbour, p)]

    def _side(self, piece: Piece, port: str, partners: list[Place]) -> tuple[str, tuple[float, float]]:
        """The side for a port, and its order along it: by the place of its nearest neighbour; of two in one line the
        farther one is first or last, so that the wires need not cross."""
        best = min(((extra + wire_cost(place, neighbour), place[2], neighbour)
                    for place, extra in self._places(piece.name, port)
                    for neighbour in partners), key=lambda item: item[0])
        x, y = (cell * pitch for cell, pitch in zip(self.cells[piece.name], (PITCH_X, PITCH_Y), strict=True))
        dx, dy = best[2][0] - x, best[2][1] - y
        if best[1] in ("left", "right"):
            return best[1], (dy, -abs(dx) if dy > 0 else abs(dx))
        return best[1], (dx, -abs(dy) if dx > 0 else abs(dy))


def wire_cost(one: Place, two: Place) -> float:
    """Length and bends of a wire between two anchors that leave on given sides, without obstacles."""
    dx, dy = two[0] - one[0], two[1] - one[1]
    (ax, ay), (bx, by) = SIDES[one[2]], SIDES[two[2]]
    ahead, back = ax * dx + ay * dy, -(bx * dx + by * dy)
    if (ax, ay) == (-bx, -by):
        aside = abs(ay * dx) + abs(ax * dy)
        bends = (0 if aside == 0 else 2) if ahead > 0 else 4
    elif (ax, ay) == (bx, by):
        aside = abs(ay * dx) + abs(ax * dy)
        bends = 2 if aside > AROUND else 6  # one of the two pictures is in the way of the other
    else:
        bends = 1 if ahead > 0 and back > 0 else 4
    return abs(dx) + abs(dy) + BEND * bends
