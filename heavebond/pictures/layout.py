"""Layout of a sheet: coordinates of its parts, their names, the wires between them; open blocks inside it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from heavebond.pictures.pictograms import GRID, SIDES, STRAIGHT, Anchor, Matrix, Shape, box, symbol
from heavebond.pictures.placement import PITCH_X, PITCH_Y, Cell, Piece, Placement, place
from heavebond.pictures.routing import Point, Wire, route
from heavebond.pictures.sheets import NODE, Net, Part, Sheet, marks_on
from heavebond.pictures.text_metrics import (
    KIND,
    NAME,
    NODE_NAME,
    NOTE,
    TAG,
    VALUE,
    Box,
    Lettering,
    Line,
    bounds,
    lettering,
    size,
)

GAP_X, GAP_Y, MARGIN, STUB, CLEAR = 60, 40, 30, 20, 4
WIDER = (1.0, 1.4, 1.9, 2.5)  # gaps that are tried in turn until every wire and name has a place
FACING = {0: (1, 0), 90: (0, 1), 180: (-1, 0), 270: (0, -1)}  # by the clockwise rotation of a part in degrees
OPPOSITE = {"left": "right", "right": "left", "top": "bottom", "bottom": "top"}
NEXT = 4  # px between a picture and its name
MOUTH = 3 * GRID  # px that stay free before an anchor


@dataclass(frozen=True)
class Options:
    """Options of a drawing: values below the names, labels on marked components, nodes and ports, and results at
    components (`value_texts`) by their paths."""

    values: bool
    marks: Mapping[str, str]
    value_texts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Item:
    """A part at its place: its picture around (x, y), its names, the labels of its marked ports, its contents if it is
    open, and its rotation, which for a box is the order of its ports."""

    part: Part
    shape: Shape
    x: int
    y: int
    caption: Lettering | None
    marks: dict[str, str]
    inside: Drawn | None
    turn: Matrix = STRAIGHT

    @property
    def extent(self) -> Box:
        """The picture's box on the sheet."""
        return Box(self.shape.left, self.shape.top, self.shape.right, self.shape.bottom).moved(self.x, self.y)

    def anchors(self, port: str) -> list[Anchor]:
        """The anchors of a port on the sheet."""
        return [Anchor(port, a.x + self.x, a.y + self.y, a.side) for a in self.shape.of(port)]


@dataclass(frozen=True)
class Strand:
    """A node on the sheet: its wire, its name and its free ends."""

    net: Net
    wire: Wire
    caption: Lettering | None
    free: tuple[int, int] | None


@dataclass(frozen=True)
class Drawn:
    """A sheet with coordinates: `frame` is its outline, `anchors` are the anchors of the block's ports on it; `faults`
    counts wires and names without a free place; `xs` and `ys` are the centres of the columns and rows of its cells."""

    sheet: Sheet
    items: tuple[Item, ...]
    lines: tuple[Strand, ...]
    frame: Box
    anchors: tuple[Anchor, ...]
    title: Lettering | None
    faults: int
    xs: tuple[int, ...]
    ys: tuple[int, ...]
    notes: Mapping[str, Lettering] = field(default_factory=dict)


def lay_out(sheet: Sheet, sides: Mapping[str, str], options: Options) -> Drawn:
    """Lay a sheet out; `sides` gives the edge of each of its ports."""
    placement = placed(sheet, sides)
    joined = {(name or f"/{port}", port) for net in sheet.nets for name, port in net.ends}
    items = [_item(part, placement, joined, options) for part in sheet.parts.values()]
    tried = []
    # exact places do not move apart
    for wider in WIDER[:1] if all(part.exact for part in sheet.parts.values()) else WIDER:
        drawn = _Drafter(sheet, sides, options, placement, items, wider).drawn()
        if not drawn.faults:
            return drawn
        tried.append(drawn)
    return min(tried, key=lambda drawn: drawn.faults)


def placed(sheet: Sheet, sides: Mapping[str, str]) -> Placement:
    """The cells and turns of the parts of a sheet, without coordinates and wires."""
    pieces = [*(Piece(f"/{port}", (port,), None, None, sides[port]) for port in sheet.ports),
              *(_piece(part) for part in sheet.parts.values())]
    return place(pieces, [[(name or f"/{port}", port) for name, port in net.ends] for net in sheet.nets])


def _piece(part: Part) -> Piece:
    shape = None if part.inside else symbol(part.component)
    if shape is not None and any(not shape.of(port) for port in part.ports):
        shape = None  # a node inside extends outwards, for which a symbol has no port
    at = None if part.at is None else (round(part.at[0] * 8), round(part.at[1] * 8))  # resolution of an eighth of a cell
    if part.exact is not None:
        at = round(8 * GRID * part.exact.x / PITCH_X), round(8 * GRID * part.exact.y / PITCH_Y)
    turn = part.exact.turn if part.exact is not None and part.exact.turn is not None else part.turn
    mirrored = part.exact.mirrored if part.exact is not None and part.exact.turn is not None else None
    power = tuple(p for p, domain in part.ports.items() if domain != "signal")
    leave = shape.leave if shape is not None else ()
    if shape is not None and part.ports and not power and not leave:
        leave = shape.of(next(iter(part.ports)))[0].side,  # signals run from left to right
    return Piece(part.name, tuple(part.ports), shape, at, "", _natural(part), power[:2] if len(power) > 1 else (),
                 None if turn is None else FACING[turn], mirrored, leave)


def facings(part: Part) -> list[int]:
    """The permitted rotations of a part's picture in degrees."""
    turns = {turn[:2] for turn in turns_of(part)}
    return [degrees for degrees, out in FACING.items() if out in turns]


def turns_of(part: Part) -> tuple[Matrix, ...]:
    """The permitted rotations and reflections of a part's picture."""
    return _piece(replace(part, turn=None, exact=None)).turns


def _natural(part: Part) -> dict[str, tuple[str, ...]]:
    """The usual sides of a port of a box: signals from left to right if there are only signals, else power on the left
    and the right and signals above and below."""
    power = [p for p, domain in part.ports.items() if domain != "signal"]
    sides: dict[str, tuple[str, ...]] = {}
    for port, domain in part.ports.items():
        if domain == "signal" and not power:
            sides[port] = ("left",) if port in part.inputs else ("right",)
        elif domain == "signal" or port in power[2:]:
            sides[port] = ("top", "bottom")
        else:
            sides[port] = ("left", "right")
    return sides


def _item(part: Part, placement: Placement, joined: set[tuple[str, str]], options: Options) -> Item:
    """A part with its rotated picture and its names, both around its centre."""
    marks = marks_on(part.path, options.marks, part.ports)
    tags = tuple(Line(label, TAG) for label in marks.values() if label)
    values = tuple(Line(text, VALUE) for text in part.values) if options.values and not part.inside else ()
    if part.path in options.value_texts and not part.inside:
        values = (Line(options.value_texts[part.path], VALUE), *values)
    sides = placement.sides.get(part.name)
    inside = None
    if sides is None:
        piece = _piece(part)
        assert piece.shape is not None
        shape = piece.shape.turned(placement.turns[part.name])
        lines = (Line(part.name, NAME), *values, *tags)
    elif part.inside is not None:
        inside = lay_out(part.inside, {port: side for side, ports in sides.items() for port in ports}, options)
        # an open block as a picture: around the centre of its frame, in line with its first port at the side
        frame = inside.frame
        x = _on_grid((frame.left + frame.right) / 2)
        y = next((a.y for a in inside.anchors if a.side in ("left", "right")), _on_grid((frame.top + frame.bottom) / 2))
        left, top, right, bottom = (round(v) for v in (frame.left - x, frame.top - y, frame.right - x, frame.bottom - y))
        shape = Shape(left, top, right, bottom, tuple(replace(a, x=a.x - x, y=a.y - y) for a in inside.anchors))
        lines = tags
    else:
        shape = box(part.name, part.component.name, sides, part.component.states)
        lines = (*values, *tags)
    anchors: list[Anchor] = []  # at which wires will probably end; all of a port if that is unknown
    for port in part.ports:
        if (part.name, port) in joined:
            port_anchors = shape.of(port)
            likely = [a for a in port_anchors if a.side in placement.leaving[part.name]]
            anchors += likely if len(port_anchors) > 1 and likely else port_anchors
    return Item(part, shape, 0, 0, caption(lines, shape, anchors) if lines else None, marks, inside,
                placement.turns[part.name])


def _on_grid(value: float) -> int:
    return GRID * math.floor(value / GRID + 0.5)


class _Drafter:
    """One attempt: coordinates with gaps multiplied by a factor, wires, names."""

    def __init__(self, sheet: Sheet, sides: Mapping[str, str], options: Options, placement: Placement,
                 items: Sequence[Item], wider: float):
        self.sheet, self.sides, self.options, self.placement = sheet, sides, options, placement
        self.wider = wider
        self.shapes = {item.part.name: item.shape for item in items}
        # the centre of every column: distances follow from the widths of the parts and the lengths of the names between them
        cells = self.placement.cells
        before = dict.fromkeys((cell[0] for cell in cells.values()), 0.0)
        after = dict(before)
        for item in items:
            column, extent = cells[item.part.name][0], _whole(item)
            before[column], after[column] = max(before[column], -extent.left), max(after[column], extent.right)
        centres: dict[int, int] = {}
        edge = gap = 0.0
        for column in sorted(before):
            centres[column] = GRID * math.ceil((edge + before[column]) / GRID)
            gap = self.wider * max(GAP_X, *(width for k, width in self._names_between() if k == column), 0.0)
            edge = centres[column] + after[column] + gap
        self.xs = centres
        self.ys = self._rows(items)
        self.items = {item.part.name: self._at(item) for item in items}
        if any(item.part.exact for item in items):
            self._put_exactly()
        self.notes = {name: lettering(tuple(Line(text, NOTE) for text in note.text.split("\n")), GRID * note.x,
                                      GRID * note.y, "start") for name, note in sheet.notes.items()}
        # places of the sheet's ports on its edge, side by side if they share a cell
        self.edges: dict[str, Anchor] = {}
        used: dict[Cell, int] = {}
        for port in self.sheet.ports:
            cell = self.placement.cells[f"/{port}"]
            k = used[cell] = used.get(cell, -1) + 1
            aside = 2 * GRID * ((k + 1) // 2) * (1 if k % 2 else -1)
            side = self.sides[port]
            x, y = self.xs[cell[0]], self.ys[cell[1]]
            upright = side in ("left", "right")
            self.edges[port] = Anchor(port, x if upright else x + aside, y + aside if upright else y, side)
        # the name of an open block, in the upper left corner of its frame
        if not self.sheet.path:
            title = None
        else:
            tag = self.options.marks.get(self.sheet.path)
            name = Line(self.sheet.path.rpartition(".")[2], NAME)
            lines = (name, Line(self.sheet.kind, KIND), *([Line(tag, TAG)] if tag else []))
            title = lettering(lines, 0, 0, "start")
        inner = self._inner()
        above = max(MARGIN, title.box.bottom + 2 * GRID) if title else MARGIN
        edges = {"left": inner.left - MARGIN, "right": inner.right + MARGIN, "top": inner.top - above,
                 "bottom": inner.bottom + MARGIN}
        for anchor in self.edges.values():
            edges[anchor.side] = anchor.x if anchor.side in ("left", "right") else anchor.y
        self.frame = Box(*(GRID * (math.floor if k in ("left", "top") else math.ceil)(edges[k] / GRID)
                           for k in ("left", "top", "right", "bottom")))
        self.title = title.moved(self.frame.left + 8, self.frame.top + 5) if title else None

    # -- coordinates -----------------------------------------------------------------------------------------------
    def _names_between(self) -> list[tuple[int, float]]:
        """Nodes that run straight from one column to the next: the column, and the width of their name."""
        neighbours = set(pairwise(sorted({cell[0] for cell in self.placement.cells.values()})))
        widths_by_column = []
        for net in self.sheet.nets:
            cells = sorted(self.placement.cells[name or f"/{port}"] for name, port in net.ends)
            if len(cells) == 2 and cells[0][1] == cells[1][1] and (cells[0][0], cells[1][0]) in neighbours:
                widths_by_column.append((cells[0][0], size(self._net_text(net))[0] + 14))
        return widths_by_column

    def _rows(self, items: Sequence[Item]) -> dict[int, int]:
        """The line of every row. Parts in one column must not touch; rows without a common column may overlap, because
        the columns separate them."""
        cells = self.placement.cells
        gap = GAP_Y * self.wider
        lowest: dict[int, float] = {}  # lower end of the parts placed so far, by column
        lines_by_row: dict[int, int] = {}
        line = 0.0
        for row in sorted({cell[1] for cell in cells.values()}):
            row_boxes = [(cells[item.part.name][0], _whole(item)) for item in items if cells[item.part.name][1] == row]
            line = max([line, *(lowest[column] + gap - extent.top for column, extent in row_boxes if column in lowest)])
            lines_by_row[row] = GRID * math.ceil(line / GRID)
            for column, extent in row_boxes:
                lowest[column] = lines_by_row[row] + extent.bottom
            line = lines_by_row[row] + gap
        for row in [r for r in lines_by_row if all(cells[item.part.name][1] != r for item in items)]:
            # the upper or lower edge of an open block with ports there
            extents = [_whole(item).moved(0, lines_by_row[self.placement.cells[item.part.name][1]]) for item in items]
            if row < 0:
                lines_by_row[row] = GRID * math.floor((min(box.top for box in extents) - GAP_Y * self.wider) / GRID)
            else:
                lines_by_row[row] = GRID * math.ceil((max(box.bottom for box in extents) + GAP_Y * self.wider) / GRID)
        return lines_by_row

    def _at(self, item: Item) -> Item:
        column, row = self.placement.cells[item.part.name]
        x, y = self.xs[column], self.ys[row]
        return replace(item, x=x, y=y, caption=item.caption.moved(x, y) if item.caption else None)

    def _put_exactly(self) -> None:
        """Move parts to their exact places, and the others to a free place near the parts to which they are connected."""
        placed = {name: _at_place(item, GRID * item.part.exact.x, GRID * item.part.exact.y)
                  for name, item in self.items.items() if item.part.exact is not None}
        for name, item in self.items.items():
            if name not in placed:
                near = next((placed[neighbour] for net in self.sheet.nets if name in {n for n, _ in net.ends}
                             for neighbour, _ in net.ends if neighbour in placed), next(iter(placed.values())))
                occupied = [_whole(neighbour) for neighbour in placed.values()]
                steps = range(-40 * GRID, 41 * GRID, 4 * GRID)
                around = sorted((math.hypot(dx, dy), near.x + dx, near.y + dy) for dx in steps for dy in steps)
                free = (_at_place(item, x, y) for _, x, y in around)
                below = GRID * math.ceil(max(box.bottom for box in occupied) / GRID) + 2 * GAP_Y
                placed[name] = next((place for place in free if not any(_whole(place).meets(box, CLEAR * GRID)
                                                                        for box in occupied)),
                                    _at_place(item, near.x, below))
        self.items = {name: placed[name] for name in self.items}
        # the columns and rows on which ports of the sheet's edge lie
        inner = self._inner()
        cells = self.placement.cells
        columns = {cells[name][0]: item.x for name, item in reversed(self.items.items())}
        rows = {cells[name][1]: item.y for name, item in reversed(self.items.items())}
        beyond = (inner.left - GAP_X, inner.right + GAP_X), (inner.top - GAP_Y, inner.bottom + GAP_Y)
        self.xs = {k: columns.get(k, GRID * round(beyond[0][k >= 0] / GRID)) for k in self.xs}
        self.ys = {k: rows.get(k, GRID * round(beyond[1][k >= 0] / GRID)) for k in self.ys}

    def _inner(self) -> Box:
        pieces = [Box(GRID * min(x1, x2), GRID * min(y1, y2), GRID * max(x1, x2), GRID * max(y1, y2))
                  for net in self.sheet.nets for x1, y1, x2, y2 in net.pieces]
        return bounds([*(b for item in self.items.values()
                         for b in (item.extent, *([item.caption.box] if item.caption else []))), *pieces])

    # -- wires -----------------------------------------------------------------------------------------------------
    def drawn(self) -> Drawn:
        """Wires and names in the gaps."""
        nets = [self._terminals(net) for net in self.sheet.nets]
        solid = [item.extent for item in self.items.values()]
        written = [item.caption.box for item in self.items.values() if item.caption]
        if self.title:
            written.append(self.title.box)
        # names may extend beyond everything else, but not beyond a block
        inset = GRID // 2 if self.sheet.path else -2 * GRID
        area = Box(self.frame.left + inset, self.frame.top + inset, self.frame.right - inset, self.frame.bottom - inset)
        reach = Box(self.frame.left, self.frame.top, self.frame.right, self.frame.bottom)
        avoided = [*solid, *(Box(b.left - CLEAR, b.top, b.right + CLEAR, b.bottom) for b in written)]
        fixed = {k: net.pieces for k, net in enumerate(self.sheet.nets) if net.pieces}
        if self.sheet.path:  # the frame of an open block is an obstacle too
            a, b, c, d = reach.left, reach.top, reach.right, reach.bottom
            avoided += [Box(a, b, c, b), Box(a, d, c, d), Box(a, b, a, d), Box(c, b, c, d)]
        wires = route(nets, avoided, reach, fixed)
        obstacles = [*solid, *written]
        lines, faults = [], sum(wire.faults for wire in wires)
        pieces = [Box(min(a[0], b[0]) - 2, min(a[1], b[1]) - 2, max(a[0], b[0]) + 2, max(a[1], b[1]) + 2)
                  for wire in wires for a, b in wire.edges]
        for net, wire, terminals in zip(self.sheet.nets, wires, nets, strict=True):
            text = self._net_text(net)
            named = name_of_node(text, wire, obstacles, pieces, area) if text else None
            if named is not None and named[1] and net.name in {f"{part}_{port}" for part, port in net.ends}:
                named = None  # the name is composed of the names of its part and port, and would cover something
            if named is not None:
                obstacles.append(named[0].box)
                faults += named[1]
            free = (terminals[-1][0].x, terminals[-1][0].y) if len(net.ends) == 1 and len(terminals) > 1 else None
            lines.append(Strand(net, wire, named[0] if named else None, free))
        return Drawn(self.sheet, tuple(self.items.values()), tuple(lines), self.frame, tuple(self.edges.values()),
                     self.title, faults, tuple(x for _, x in sorted(self.xs.items())),
                     tuple(y for _, y in sorted(self.ys.items())), self.notes)

    def _net_text(self, net: Net) -> tuple[Line, ...]:
        if not net.name:
            return ()
        tag = self.options.marks.get(NODE + net.path)
        shared = [text for (name, port), text in net.chosen.items()
                  if not any(anchor.port == port for anchor in self.shapes[name].anchors)]
        elements = [Line(", ".join(shared), KIND)] if shared else []  # several wires end at the same point there
        return (Line(net.name, NODE_NAME), *elements, *([Line(tag, TAG)] if tag else []))

    def _terminals(self, net: Net) -> list[list[Anchor]]:
        terminal_list = []
        for name, port in net.ends:
            if name:
                terminal_list.append(self.items[name].anchors(port))
            else:
                edge = self.edges[port]
                terminal_list.append([replace(edge, side=OPPOSITE[edge.side])])
        if len(terminal_list) == 1:
            end = terminal_list[0][0]
            out = SIDES[end.side]
            terminal_list = [[end], [Anchor(end.port, end.x + STUB * out[0], end.y + STUB * out[1], OPPOSITE[end.side])]]
        return terminal_list


def _at_place(item: Item, x: int, y: int) -> Item:
    caption = item.caption.moved(x - item.x, y - item.y) if item.caption else None
    return replace(item, x=x, y=y, caption=caption)


def _whole(item: Item) -> Box:
    """The picture and its names."""
    return bounds([item.extent, *([item.caption.box] if item.caption else [])])


def ray(anchor: Anchor) -> Box:
    """The strip of the wire that leaves an anchor."""
    dx, dy = SIDES[anchor.side]
    xs, ys = sorted((anchor.x, anchor.x + dx * MOUTH)), sorted((anchor.y, anchor.y + dy * MOUTH))
    return Box(xs[0] - 4, ys[0] - 4, xs[1] + 4, ys[1] + 4)


def caption(lines: tuple[Line, ...], shape: Shape, anchors: Sequence[Anchor]) -> Lettering:
    """Place lines next to a picture on a side without wires at `anchors`: below, above, right, left, else at a corner."""
    _, height = size(lines)
    below, above, middle = shape.bottom + NEXT, shape.top - NEXT - height, (shape.top + shape.bottom - height) / 2
    places = [lettering(lines, 0, below), lettering(lines, 0, above),
              lettering(lines, shape.right + NEXT + 2, middle, "start"),
              lettering(lines, shape.left - NEXT - 2, middle, "end")]
    for y in (below, above):
        right = max((a.x for a in anchors if a.side in ("top", "bottom")), default=0)
        leftmost = min((a.x for a in anchors if a.side in ("top", "bottom")), default=0)
        places += [lettering(lines, right + 7, y, "start"), lettering(lines, leftmost - 7, y, "end")]
    for y in (shape.bottom - height, shape.top):
        places += [lettering(lines, shape.right + NEXT + 2, y, "start"), lettering(lines, shape.left - NEXT - 2, y, "end")]
    rays = [ray(a) for a in anchors]
    return next((p for p in places if not any(p.box.meets(r) for r in rays)), places[-1])


def name_of_node(lines: tuple[Line, ...], wire: Wire, covered: Sequence[Box], wires: Sequence[Box], area: Box
                 ) -> tuple[Lettering, int]:
    """Place the name of a node at its wire; returns also 1 if it covers something or is far from the wire, else 0."""
    best: tuple[int, Lettering] | None = None
    for candidate, far in _places(lines, wire):
        box = candidate.box
        outside = box.left < area.left or box.top < area.top or box.right > area.right or box.bottom > area.bottom
        hits = sum(box.meets(b, 1.0) for b in covered) + sum(box.meets(b) for b in wires) + 5 * outside
        if not hits:
            return candidate, int(far)
        if best is None or hits < best[0]:
            best = hits, candidate
    assert best is not None
    return best[1], 1


def _places(lines: tuple[Line, ...], wire: Wire) -> Iterator[tuple[Lettering, bool]]:
    """Candidate places along the pieces of a wire, the longest first, above before below; then around its corners, and
    whether they are far away.
    """
    width, height = size(lines)
    pieces = [(a, b) for line in wire.lines for a, b in pairwise(line)] or [((0, 0), (0, 0))]
    pieces.sort(key=lambda p: (-min(abs(p[1][0] - p[0][0]) + abs(p[1][1] - p[0][1]), 2 * width), p[0][0] == p[1][0], p))
    for a, b in pieces:
        for share in (0.5, 0.25, 0.75, 0.0, 1.0):
            x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            if a[1] == b[1]:
                yield lettering(lines, x, y - height - 3), False
                yield lettering(lines, x, y + 4), False
            else:
                yield lettering(lines, x + 5, y - height / 2, "start"), False
                yield lettering(lines, x - 5, y - height / 2, "end"), False
    corners: list[Point] = sorted({point for line in wire.lines for point in line})
    for distance in (6, 12, 20, 30, 45):
        for x, y in corners:
            for dy in (-height - distance, distance):
                yield lettering(lines, x + distance, y + dy, "start"), distance > 12
                yield lettering(lines, x - distance, y + dy, "end"), distance > 12
