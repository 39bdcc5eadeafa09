"""Placement of names: next to pictures on sides without wires, names of nodes along their wires."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from heavebond.pictures.pictograms import GRID, SIDES, Anchor, Shape
from heavebond.pictures.routing import Point, Wire
from heavebond.pictures.text_metrics import Box, Lettering, Line, lettering, size

CLEAR = 4  # px between a picture and its name
MOUTH = 3 * GRID  # px that stay free before an anchor


def ray(anchor: Anchor) -> Box:
    """The strip of the wire that leaves an anchor."""
    dx, dy = SIDES[anchor.side]
    xs, ys = sorted((anchor.x, anchor.x + dx * MOUTH)), sorted((anchor.y, anchor.y + dy * MOUTH))
    return Box(xs[0] - 4, ys[0] - 4, xs[1] + 4, ys[1] + 4)


def caption(lines: tuple[Line, ...], shape: Shape, anchors: Sequence[Anchor]) -> Lettering:
    """Place lines next to a picture on a side without wires at `anchors`: below, above, right, left, else at a corner."""
    _, height = size(lines)
    below, above, middle = shape.bottom + CLEAR, shape.top - CLEAR - height, (shape.top + shape.bottom - height) / 2
    places = [lettering(lines, 0, below), lettering(lines, 0, above),
              lettering(lines, shape.right + CLEAR + 2, middle, "start"),
              lettering(lines, shape.left - CLEAR - 2, middle, "end")]
    for y in (below, above):
        right = max((a.x for a in anchors if a.side in ("top", "bottom")), default=0)
        leftmost = min((a.x for a in anchors if a.side in ("top", "bottom")), default=0)
        places += [lettering(lines, right + 7, y, "start"), lettering(lines, leftmost - 7, y, "end")]
    for y in (shape.bottom - height, shape.top):
        places += [lettering(lines, shape.right + CLEAR + 2, y, "start"), lettering(lines, shape.left - CLEAR - 2, y, "end")]
    rays = [ray(a) for a in anchors]
    return next((p for p in places if not any(p.box.meets(r) for r in rays)), places[-1])


def name_of_node(lines: tuple[Line, ...], wire: Wire, covered: Sequence[Box], wires: Sequence[Box], area: Box
                 ) -> tuple[Lettering, int]:
    """Place the name of a node at its wire; returns also 1 if it covers something or is far from the wire, else 0."""
    best: tuple[int, Lettering] | None = None
    for place, far in _places(lines, wire):
        box = place.box
        outside = box.left < area.left or box.top < area.top or box.right > area.right or box.bottom > area.bottom
        hits = sum(box.meets(b, 1.0) for b in covered) + sum(box.meets(b) for b in wires) + 5 * outside
        if not hits:
            return place, int(far)
        if best is None or hits < best[0]:
            best = hits, place
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
