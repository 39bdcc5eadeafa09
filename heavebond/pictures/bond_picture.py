"""A bond graph as a picture (SVG): letters, straight bonds with half arrows, causal strokes.

The vertices are placed so that distances on the paper equal distances along the bonds: the weighted sum of squared
differences (the stress) is minimised by majorisation, from several starts, and the result with the fewest crossings is
chosen. T. Kamada, S. Kawai, Inf. Process. Lett. 31 (1989) 7-15, doi:10.1016/0020-0190(89)90102-6; E. R. Gansner, Y. Koren,
S. North, Graph Drawing 2004, LNCS 3383, 239-250, doi:10.1007/978-3-540-31843-9_25.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from heavebond.core.quoting import xml
from heavebond.language.model import Model
from heavebond.pictures.bond_graph import WORD, Bond, BondGraph, Vertex, bond_graph, notes_of
from heavebond.pictures.drawing import EDGE, QUIET, WARNING, domain_colour
from heavebond.pictures.text_metrics import FONT, KIND, NAME, SUMMARY, TITLE, Box, Style, bounds, text_width, wrapped

BARB, BAR = 9, 7  # px: length of the half arrow, half length of a causal stroke
LETTER, LABEL = Style(17, bold=True), Style(10, quiet=True)
LENGTH, CLEAR = 62.0, 5.0  # px: length of a bond from centre to centre; gap between a letter and its bonds
ROOM = 22.0  # px: free space around a vertex
MORE = 7.0  # px: extra length of all bonds at a vertex for each bond beyond four
BESIDE = 9.0  # px between two bonds of the same vertices
LEAST = 520.0  # px: least width of a page
Array = NDArray[np.float64]
Point = tuple[float, float]
STARTS, SWEEPS = 24, 200  # number of starts; steps of each
INSISTING = 30.0  # weight of vertices that are too close
NEAR = 16.0  # px: a vertex this close to a bond of others is hidden by it
APART = 60.0  # px between components that no bond connects


def draw_bond_graph(model: Model) -> str:
    """The bond graph of a diagram as the text of an SVG file; ModelError for a diagram that cannot be read."""
    graph = bond_graph(model)
    shapes = {}  # the box of a letter or a word about its centre
    for key, vertex in graph.vertices.items():
        if vertex.letter == WORD:
            across, high = text_width(vertex.label, NAME) / 2 + 8, 12.0
        else:  # a bond ends at the same distance from an I as from other letters, in every direction
            across, high = max(text_width(vertex.letter, LETTER) / 2, 4.0), 7.0
        shapes[key] = Box(-across, -high, across, high)
    busy = Counter(key for b in graph.bonds for key in (b.tail, b.head))
    # bonds are longer at a word and at vertices with many bonds
    extra = {key: max(0.0, (shape.right - 10) / 2) + MORE * max(0, busy[key] - 4) for key, shape in shapes.items()}
    lengths = {(b.tail, b.head): LENGTH + sum(extra[key] for key in (b.tail, b.head)) for b in graph.bonds}
    at = places(lengths, {key: ROOM + 0.7 * shape.right for key, shape in shapes.items()})
    boxes = {key: shapes[key].moved(*place) for key, place in at.items()}
    ends = _ends(graph, at, boxes)
    lines = [line for bond, path in zip(graph.bonds, ends, strict=True) for line in _bond(graph, bond, path)]
    covered_boxes = list(boxes.values())
    for key, vertex in graph.vertices.items():
        lines += _vertex(vertex, at[key], boxes[key])
        if vertex.label and vertex.letter != WORD:
            # box for the name of a letter: the place around it that covers least
            letter_box = boxes[key]
            wide, high = text_width(vertex.label, LABEL) / 2, LABEL.size + 3
            x, y = (letter_box.left + letter_box.right) / 2, (letter_box.top + letter_box.bottom) / 2
            tried = [Box(u - wide, v - high / 2, u + wide, v + high / 2)
                     for u, v in ((x, letter_box.bottom + 8), (x, letter_box.top - 8), (letter_box.right + wide + 4, y),
                                  (letter_box.left - wide - 4, y), (letter_box.right + wide, letter_box.bottom + 5),
                                  (letter_box.left - wide, letter_box.bottom + 5),
                                  (letter_box.right + wide, letter_box.top - 5),
                                  (letter_box.left - wide, letter_box.top - 5))]
            covered = [3 * sum(box.meets(neighbour) for neighbour in covered_boxes if neighbour is not letter_box)
                       + sum(_through(box, *bond) for bond in ends) for box in tried]
            box = tried[covered.index(min(covered))]
            covered_boxes.append(box)
            lines.append(_text((box.left + box.right) / 2, box.bottom - 3, vertex.label, LABEL.size, QUIET, False))
    return _page(model, graph, lines, bounds(covered_boxes) if covered_boxes else Box(0, 0, LEAST, 0))


def _page(model: Model, graph: BondGraph, lines: list[str], box: Box) -> str:
    """The picture with its title above and notes below."""
    width = max(box.right - box.left, LEAST)
    written = [line for note in notes_of(graph) for line in wrapped(note, SUMMARY, width)]
    left, top = round(box.left - EDGE), round(box.top - EDGE - 44)
    whole_x = round(width + 2 * EDGE)
    whole_y = round(box.bottom + EDGE + 40 + 15 * len(written)) - top
    y = box.bottom + 36
    x: float = left + EDGE
    entries = []
    for domain in dict.fromkeys(b.domain for b in graph.bonds):
        entries += [f'<path d="M{x:g} {y:g} h20" stroke="{domain_colour(domain)}" stroke-width="1.6"/>',
                    _text(x + 25, y + 3, domain, KIND.size, QUIET, False, "start")]
        x += 43 + text_width(domain, KIND)
    return "\n".join([f'<svg xmlns="http://www.w3.org/2000/svg" width="{whole_x}" height="{whole_y}" '
                      f'viewBox="{left} {top} {whole_x} {whole_y}" font-family="{FONT}" fill="none" '
                      'stroke-linejoin="round">',
                      f"<title>{xml(model.name)}, bond graph</title>",
                      f'<rect x="{left}" y="{top}" width="{whole_x}" height="{whole_y}" fill="#ffffff"/>',
                      _text(left + EDGE, top + EDGE + 4, f"{model.name}: bond graph", TITLE.size, "#000000", True, "start"),
                      *lines, *entries, *(_text(left + EDGE, y + 18 + 15 * k, line.text, SUMMARY.size, QUIET, False, "start")
                                          for k, line in enumerate(written)), "</svg>"]) + "\n"


# -- vertices ----------------------------------------------------------------------------------------------------------
def _vertex(vertex: Vertex, place: Point, box: Box) -> list[str]:
    colour = WARNING if vertex.derivative or vertex.broken else "#000000"
    if vertex.letter != WORD:
        return [_text(place[0], place[1] + 6, vertex.letter, LETTER.size, colour, True)]
    return [f'<rect x="{box.left:.1f}" y="{box.top:.1f}" width="{box.right - box.left:.1f}" '
            f'height="{box.bottom - box.top:.1f}" rx="3" stroke="{QUIET}" fill="#f7f7f5"/>',
            _text(place[0], place[1] + 4, vertex.label, NAME.size, colour, True)]


def _through(box: Box, start: Point, end: Point) -> bool:
    """True if a line crosses a box, tested at forty points."""
    return any(box.left < start[0] + k / 40 * (end[0] - start[0]) < box.right
               and box.top < start[1] + k / 40 * (end[1] - start[1]) < box.bottom for k in range(41))


def _text(x: float, y: float, text: str, size: int, colour: str, bold: bool, align: str = "middle") -> str:
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}"{weight} fill="{colour}" text-anchor="{align}">' \
        f"{xml(text)}</text>"


# -- bonds -------------------------------------------------------------------------------------------------------------
def _ends(graph: BondGraph, at: Mapping[str, Point], boxes: Mapping[str, Box]) -> list[tuple[Point, Point]]:
    """End points of each bond: on the line between the centres, outside the boxes of the vertices."""
    pairs = [frozenset((b.tail, b.head)) for b in graph.bonds]
    end_points = []
    for k, bond in enumerate(graph.bonds):
        (x, y), (u, v) = at[bond.tail], at[bond.head]
        length = ((u - x)**2 + (v - y)**2)**0.5 or 1.0
        along = ((u - x) / length, (v - y) / length)
        aside = BESIDE * (pairs[:k].count(pairs[k]) - (pairs.count(pairs[k]) - 1) / 2)
        aside *= 1 if bond.tail < bond.head else -1  # the same side for both directions
        dx, dy = -along[1] * aside, along[0] * aside
        first, last = _out_of(boxes[bond.tail], along, (dx, dy)), _out_of(boxes[bond.head], (-along[0], -along[1]), (dx, dy))
        end_points.append(((x + dx + first * along[0], y + dy + first * along[1]),
                           (u + dx - last * along[0], v + dy - last * along[1])))
    return end_points


def _out_of(box: Box, along: Point, off: Point) -> float:
    """Distance from a point near the centre of a box at which a line leaves it."""
    half = ((box.right - box.left) / 2 + CLEAR, (box.bottom - box.top) / 2 + CLEAR)
    distances = [(side - o * (1 if a > 0 else -1)) / abs(a) for side, a, o in zip(half, along, off, strict=True)
                 if abs(a) > 1e-9]
    return max(0.0, min(distances))


def _bond(graph: BondGraph, bond: Bond, ends: tuple[Point, Point]) -> list[str]:
    """A line, the half arrow at its head, the causal stroke across the end on which the effort is imposed."""
    (x, y), (u, v) = ends
    length = ((u - x)**2 + (v - y)**2)**0.5 or 1.0
    along = ((u - x) / length, (v - y) / length)
    colour = domain_colour(bond.domain)
    late = any(graph.vertices[key].derivative for key in (bond.tail, bond.head))
    dashed = ' stroke-dasharray="4 3"' if bond.modulated else ""
    tooltip = xml(f"{bond.domain}, power counts from {bond.tail} to {bond.head}")
    tip = (u - BARB * (0.8 * along[0] - 0.6 * along[1]), v - BARB * (0.8 * along[1] + 0.6 * along[0]))
    lines = [f'<path class="bond" d="M{x:.1f} {y:.1f} L{u:.1f} {v:.1f}" stroke="{colour}" stroke-width="1.6"{dashed}>'
             f"<title>{tooltip}</title></path>",
             f'<path class="half-arrow" d="M{u:.1f} {v:.1f} L{tip[0]:.1f} {tip[1]:.1f}" stroke="{colour}" '
             'stroke-width="1.6"/>']
    if bond.stroke:
        at = ends[0] if bond.stroke == bond.tail else ends[1]
        p, q = along[1] * BAR, -along[0] * BAR
        lines.append(f'<path class="stroke{" late" if late else ""}" d="M{at[0] - p:.1f} {at[1] - q:.1f} '
                     f'L{at[0] + p:.1f} {at[1] + q:.1f}" stroke="{WARNING if late else "#000000"}" stroke-width="2.4"/>')
    return lines


# -- places of the vertices --------------------------------------------------------------------------------------------
def places(lengths: Mapping[tuple[str, str], float], room: Mapping[str, float]) -> dict[str, Point]:
    """x to the right and y downwards of each vertex in px, wider than high; `lengths` are the desired lengths of the
    bonds, `room` is the free radius around each vertex."""
    import networkx as nx

    vertices, around = list(room), np.array(list(room.values()))
    number = {name: k for k, name in enumerate(vertices)}
    links = [(number[one], number[two]) for one, two in lengths if one != two]
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(range(len(vertices)))
    graph.add_weighted_edges_from((number[one], number[two], length) for (one, two), length in lengths.items() if one != two)
    wanted = np.asarray(nx.floyd_warshall_numpy(graph))  # the shortest path along bonds
    places_found, top = {}, 0.0
    # connected components, the largest first
    for piece in sorted(map(sorted, nx.connected_components(graph)), key=lambda piece: (-len(piece), piece)):
        inside = {k: n for n, k in enumerate(piece)}
        piece_links = [(inside[one], inside[two]) for one, two in links if one in inside]
        points = _laid(wanted[np.ix_(piece, piece)], around[piece], piece_links)
        points += np.array([0.0, top]) - points.min(axis=0)
        top = float(points[:, 1].max()) + APART
        places_found.update({vertices[k]: (float(x), float(y)) for k, (x, y) in zip(piece, points.tolist(), strict=True)})
    return places_found


def _laid(wanted: Array, around: Array, links: Sequence[tuple[int, int]]) -> Array:
    """The places (n, 2) of one connected component."""
    if len(wanted) == 1:
        return np.zeros((1, 2))
    random = np.random.default_rng(len(wanted))
    tried = []
    for k in range(STARTS):
        start = _scaled(wanted) if k == 0 else random.standard_normal((len(wanted), 2)) * wanted.max() / 4
        points = _settled(start, wanted, around[:, None] + around[None, :])
        # number of vertices that nearly lie on a link of others
        count = 0
        for one, two in links:
            direction = points[two] - points[one]
            share = np.clip((points - points[one]) @ direction / max(float(direction @ direction), 1e-9), 0.0, 1.0)
            off = np.hypot(*(points - points[one] - share[:, None] * direction).T)
            off[[one, two]] = np.inf
            count += int((off < NEAR).sum())
        hidden = crossings(points, links) + 2 * count
        apart = points[:, None, :] - points[None, :, :]
        above = np.triu_indices(len(points), 1)
        stress = float((((np.hypot(apart[..., 0], apart[..., 1]) - wanted)[above] / wanted[above])**2).sum())
        tried.append((hidden, round(stress, 6), k, points))
    # rotate the picture to its smallest height, with the first vertex at the left
    points = min(tried, key=lambda one: one[:3])[3]
    best = None
    for angle in np.linspace(0, np.pi, 37)[:-1]:
        turned = points @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).T
        if best is None or np.ptp(turned[:, 1]) < np.ptp(best[:, 1]):
            best = turned
    assert best is not None
    best = best - best.mean(axis=0)
    return np.asarray(best * np.where(best[0] > 0, -1.0, 1.0))


def _scaled(wanted: Array) -> Array:
    """Classical scaling: the two largest principal axes of the squared distances."""
    centred = wanted**2 - np.mean(wanted**2, axis=0)
    values, vectors = np.linalg.eigh(-0.5 * (centred - np.mean(centred, axis=1)[:, None]))
    coordinates = vectors[:, :-3:-1] * np.sqrt(np.maximum(values[:-3:-1], 1e-9))
    spread = 1e-3 * wanted.max() * np.random.default_rng(0).standard_normal((len(wanted), 2))
    return np.asarray((coordinates if coordinates.shape[1] == 2 else np.column_stack([coordinates, np.zeros(len(wanted))]))
                      + spread)


def _settled(points: Array, wanted: Array, least: Array) -> Array:
    """Stress majorisation; in the last steps vertices nearer than `least` are pushed apart."""
    with np.errstate(divide="ignore"):
        usual = np.where(wanted > 0, 1 / wanted**2, 0.0)
    for sweep in range(SWEEPS):
        apart = points[:, None, :] - points[None, :, :]
        size = np.maximum(np.hypot(apart[..., 0], apart[..., 1]), 1e-9)
        near = (size < least) & (usual > 0) & (sweep > SWEEPS // 2)
        aim, weight = np.where(near, least, wanted), np.where(near, INSISTING / least**2, usual)
        aims = points[None, :, :] + (aim / size)[..., None] * apart
        points = (weight[..., None] * aims).sum(axis=1) / weight.sum(axis=1)[:, None]
    return points


def crossings(points: Array, links: Sequence[tuple[int, int]]) -> int:
    """Number of pairs of straight links that cross."""
    def side(a: int, b: int, c: int) -> bool:
        (x, y), (u, v), (p, q) = points[a], points[b], points[c]
        return bool((u - x) * (q - y) > (v - y) * (p - x))

    return sum(1 for (a, b), (c, d) in combinations(links, 2) if len({a, b, c, d}) == 4
               and side(a, b, c) != side(a, b, d) and side(c, d, a) != side(c, d, b))
