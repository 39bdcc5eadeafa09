"""A bond graph as a picture (SVG): letters, bonds with half arrows, causal strokes."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from heavebond.bond_graph import WORD, Bond, BondGraph, Vertex, bond_graph, told
from heavebond.definition import Component
from heavebond.drawing import COLOURS, EDGE, OTHER, QUIET, WARNING, extent_of
from heavebond.errors import Place
from heavebond.layout import Item, Options, Strand, lay_out
from heavebond.lettering import FONT, KIND, NAME, SUMMARY, TITLE, text_width, wrapped
from heavebond.model import Model
from heavebond.sheets import Net, Part, Sheet

BARB, BAR, LETTER = 9, 7, 16  # px: the half arrow's length, half of a causal stroke, an element's letter
Point = tuple[float, float]


def draw_bond_graph(model: Model) -> str:
    """The bond graph of a diagram as the text of an SVG file; ModelError for a diagram that cannot be read."""
    graph = bond_graph(model)
    drawn = lay_out(_sheet(graph), {}, Options(False, {}))
    box = extent_of(drawn)
    lines: list[str] = []
    for item in drawn.items:
        lines += _vertex(graph.vertices[item.part.path], item)
    items = {item.part.name: item for item in drawn.items}
    for bond, strand in zip(graph.bonds, drawn.lines, strict=True):
        lines += _bond(graph, bond, strand, items)
    notes = told(graph)
    width = max(box.right - box.left, 520)
    written = [line for note in notes for line in wrapped(note, SUMMARY, width)]
    left, top = round(box.left - EDGE), round(box.top - EDGE - 44)
    whole_x = round(width + 2 * EDGE)
    whole_y = round(box.bottom + EDGE + 24 + 15 * len(written)) - top
    head = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{whole_x}" height="{whole_y}" '
            f'viewBox="{left} {top} {whole_x} {whole_y}" font-family={quoteattr(FONT)} fill="none" stroke-linejoin="round">',
            f"<title>{escape(model.name)}, bond graph</title>",
            f'<rect x="{left}" y="{top}" width="{whole_x}" height="{whole_y}" fill="#ffffff"/>',
            _text(left + EDGE, top + EDGE + 4, f"{model.name}: bond graph", TITLE.size, "#000000", True, "start")]
    y = box.bottom + 20
    lines += _legend(graph, left + EDGE, y)
    lines += [_text(left + EDGE, y + 18 + 15 * k, line.text, SUMMARY.size, QUIET, False, "start")
              for k, line in enumerate(written)]
    return "\n".join([*head, *lines, "</svg>"]) + "\n"


def _sheet(graph: BondGraph) -> Sheet:
    """Vertices as parts with a port for each bond, bonds as nodes of two ends."""
    place = Place("bond graph", 1)
    ports: dict[str, dict[str, str]] = {key: {} for key in graph.vertices}
    nets = []
    for k, bond in enumerate(graph.bonds):
        for key in (bond.tail, bond.head):
            ports[key][f"b{k}"] = bond.domain
        nets.append(Net(f"bond {k}", "", bond.domain, ((bond.tail, f"b{k}"), (bond.head, f"b{k}"))))
    parts = {key: Part(key, key, Component(_shown(vertex), "", place, Path()), ports[key], (), None, ())
             for key, vertex in graph.vertices.items()}
    return Sheet("", parts, tuple(nets))


def _shown(vertex: Vertex) -> str:
    return "" if vertex.letter == WORD else vertex.letter


def _vertex(vertex: Vertex, item: Item) -> list[str]:
    colour = WARNING if vertex.derivative or vertex.broken else "#000000"
    if vertex.letter == WORD:
        box = item.extent
        return [f'<rect x="{box.left + 6:g}" y="{box.top + 6:g}" width="{box.right - box.left - 12:g}" '
                f'height="{box.bottom - box.top - 12:g}" rx="3" stroke="{QUIET}" fill="#f7f7f5"/>',
                _text(item.x, item.y + 4, vertex.label, NAME.size, colour, True)]
    lines = [_text(item.x, item.y + (2 if vertex.label else 6), vertex.letter, LETTER, colour, True)]
    return [*lines, _text(item.x, item.y + 14, vertex.label, KIND.size, QUIET, False)] if vertex.label else lines


def _text(x: float, y: float, text: str, size: int, colour: str, bold: bool, align: str = "middle") -> str:
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}"{weight} fill="{colour}" text-anchor="{align}">' \
        f"{escape(text)}</text>"


def _bond(graph: BondGraph, bond: Bond, strand: Strand, items: dict[str, Item]) -> list[str]:
    """A line, the half arrow at its head, the causal stroke across the end that effort is imposed on."""
    path = _path(strand, items[bond.tail])
    colour = COLOURS.get(bond.domain, OTHER)
    late = any(graph.vertices[key].derivative for key in (bond.tail, bond.head))
    dashed = ' stroke-dasharray="4 3"' if bond.modulated else ""
    told_of = escape(f"{bond.domain}, power counts from {bond.tail} to {bond.head}")
    lines = ['<path class="bond" d="M' + " L".join(f"{x:g} {y:g}" for x, y in path) +
             f'" stroke="{colour}" stroke-width="1.6"{dashed}><title>{told_of}</title></path>']
    end, along = _end(path, bond.head == bond.tail)
    back, aside = (-along[0], -along[1]), (along[1], -along[0])
    tip = (end[0] + BARB * (0.8 * back[0] + 0.6 * aside[0]), end[1] + BARB * (0.8 * back[1] + 0.6 * aside[1]))
    lines.append(f'<path class="half-arrow" d="M{end[0]:g} {end[1]:g} L{tip[0]:g} {tip[1]:g}" stroke="{colour}" '
                 'stroke-width="1.6"/>')
    if bond.stroke:
        at, way = _end(path, bond.stroke == bond.tail)
        x, y = way[1] * BAR, -way[0] * BAR
        lines.append(f'<path class="stroke{" late" if late else ""}" d="M{at[0] - x:g} {at[1] - y:g} L{at[0] + x:g} '
                     f'{at[1] + y:g}" stroke="{WARNING if late else "#000000"}" stroke-width="2.4"/>')
    return lines


def _path(strand: Strand, tail: Item) -> list[Point]:
    """The wire as one line that begins at the tail."""
    path: list[Point] = [(float(x), float(y)) for x, y in strand.wire.lines[0]]
    own = {(a.x + tail.x, a.y + tail.y) for a in tail.shape.anchors}
    return path if path[0] in own else path[::-1]


def _end(path: list[Point], first: bool) -> tuple[Point, Point]:
    """An end of a line and the direction in which it runs out there."""
    (x, y), (u, v) = (path[0], path[1]) if first else (path[-1], path[-2])
    length = abs(x - u) + abs(y - v) or 1.0
    return (x, y), ((x - u) / length, (y - v) / length)


def _legend(graph: BondGraph, x: float, y: float) -> list[str]:
    lines = []
    for domain in dict.fromkeys(b.domain for b in graph.bonds):
        lines += [f'<path d="M{x:g} {y:g} h20" stroke="{COLOURS.get(domain, OTHER)}" stroke-width="1.6"/>',
                  _text(x + 25, y + 3, domain, KIND.size, QUIET, False, "start")]
        x += 43 + text_width(domain, KIND)
    return lines
