"""A diagram as a picture (SVG): symbols, wires in the colours of their domains, names, values, marks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from heavebond.core.presentation import number, unit_label
from heavebond.core.quoting import xml
from heavebond.equations.connect import Network, connect
from heavebond.equations.expand import expand
from heavebond.equations.expanded import Expanded
from heavebond.language.definition import Component
from heavebond.language.library import domains
from heavebond.language.model import Model, ModelOrFile, loaded
from heavebond.pictures.colour_map import FADED, Paint
from heavebond.pictures.layout import Drawn, Item, Options, Strand, lay_out
from heavebond.pictures.pictograms import SIDES, STRAIGHT, WIDER, Anchor, Mark, Shape, box, symbol
from heavebond.pictures.sheets import NODE, Sheet, marked_places, opened_blocks, sheet
from heavebond.pictures.text_metrics import (
    FONT,
    KIND,
    NAME,
    SUMMARY,
    TITLE,
    VALUE,
    Box,
    Lettering,
    Line,
    Style,
    bounds,
    lettering,
    text_width,
    wrapped,
)

EDGE = 20  # px around the drawing
NARROWEST = 420  # px: least width, for the title
SIGNAL = "#00734f"  # distinct from the colours of the domains for every kind of colour vision (after Okabe and Ito)
OTHER, QUIET, WARNING, HALO, NOTE_COLOUR = "#444444", "#5f6368", "#c2410c", "#ffe3d1", "#3b3f45"
WIDTHS = {"signal": 1.1}
ARRAY = 2.2  # line width of a wire with several elements, as a factor


def draw(model: ModelOrFile, *, open: Iterable[str] = (), open_all: bool = False, values: bool = False,
         highlight: Mapping[str, str] | Iterable[str] = (), colour: Paint | None = None) -> str:
    """The diagram as the text of an SVG file; the same diagram gives the same text.

    `open` names blocks (`cmc`, `ahc`) that are drawn with their contents, `open_all` opens them all; others are boxes.
    `values` writes the settings of each component below its name. `highlight` marks components, nodes or ports in a
    warning colour, each with a short label if a mapping is given: by path, as `cmc.gas`, `platform`, `ahc.cylinder.A`, and
    `node crown` if a component has the node's name. Blocks around them are opened. `colour` (see
    `pictures.painting.paint`) colours components and wires by results of a run, and writes the values at the components.

    Raises ModelError for a diagram or a symbol that cannot be read, UsageError for names that the diagram does not
    have.
    """
    expanded = expand(loaded(model))
    return draw_expanded(expanded, connect(expanded), open=open, open_all=open_all, values=values, highlight=highlight,
                         colour=colour)[0]


def draw_expanded(expanded: Expanded, network: Network, *, open: Iterable[str] = (), open_all: bool = False,
                  values: bool = False, highlight: Mapping[str, str] | Iterable[str] = (), colour: Paint | None = None
                  ) -> tuple[str, Drawn]:
    """Draw an expanded diagram, which may be unfinished; returns also the coordinates."""
    marks = marked_places(expanded, dict(highlight) if isinstance(highlight, Mapping) else dict.fromkeys(highlight, ""))
    blocks = opened_blocks(expanded, [open] if isinstance(open, str) else open, open_all, marks)
    value_texts = {path: colour.text(value) for path, value in colour.parts.items()} if colour else {}
    outermost = sheet(expanded, network, blocks)
    drawn = lay_out(outermost, own_sides(expanded, outermost), Options(values, marks, value_texts))
    return _page(expanded.model, drawn, Look(marks, colour)), drawn


def own_sides(expanded: Expanded, outermost: Sheet) -> dict[str, str]:
    """The edges of the ports of a block that is drawn by itself; empty for a diagram, which has no ports."""
    if not outermost.ports:
        return {}
    sides = {port: side for side, ports in _sides(expanded.leaves[""].component).items() for port in ports}
    return {port: sides.get(port.partition("[")[0], "left") for port in outermost.ports}


@dataclass(frozen=True)
class Look:
    """Colours besides those of the domains: marks, and values of a run."""

    marks: Mapping[str, str]
    paint: Paint | None

    def part(self, item: Item, domain: str) -> str:
        """The colour of a component."""
        if "" in item.marks:
            return WARNING
        if self.paint is None:
            return domain_colour(domain)
        value = self.paint.parts.get(item.part.path)
        return FADED if value is None else self.paint.colour(value)

    def net(self, line: Strand) -> str:
        """The colour of a wire."""
        if NODE + line.net.path in self.marks:
            return WARNING
        if self.paint is None:
            return domain_colour(line.net.domain)
        value = self.paint.nets.get(line.net.path)
        return FADED if value is None else self.paint.colour(value)


def symbol_picture(component: Component) -> str:
    """The symbol of a component with its ports named, as the text of an SVG file; a box with its ports if it has no
    symbol.
    """
    shape = symbol(component)
    ports = {**{p.name: p.domain for p in component.ports.values()}, **dict.fromkeys(component.signal_names, "signal")}
    if shape is None:
        shape = box("", component.name, _sides(component), component.states)
        labels: list[Lettering] = []
    else:
        labels = [_port_name(anchor) for anchor in {a.port: a for a in reversed(shape.anchors)}.values()
                  if anchor.port in ports and anchor.port not in {mark.text for mark in shape.marks}]
    main = shape.domain or next((d for d in ports.values() if d != "signal"), "signal")
    extent = bounds([Box(shape.left, shape.top, shape.right, shape.bottom), *(label.box for label in labels)])
    left, top = round(extent.left) - 4, round(extent.top) - 4
    width, height = round(extent.right) + 4 - left, round(extent.bottom) + 4 - top
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{round(1.5 * width)}" height="{round(1.5 * height)}" '
             f'viewBox="{left} {top} {width} {height}" font-family="{FONT}" fill="none" stroke-linejoin="round">',
             f"<title>{xml(component.name)}</title>",
             f'<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="#ffffff"/>',
             *_picture(shape, domain_colour(main), main, marked=False)]
    for anchor in shape.anchors:
        if anchor.port in ports:
            lines.append(f'<circle cx="{anchor.x}" cy="{anchor.y}" r="2" fill="{domain_colour(ports[anchor.port])}"/>')
    for label in labels:
        lines += _lettered(label, QUIET, "port")
    return "\n".join([*lines, "</svg>"]) + "\n"


def _sides(component: Component) -> dict[str, list[str]]:
    """The ports of a box outside a diagram: inputs on the left, outputs on the right."""
    powers = list(component.ports)
    half = (len(powers) + 1) // 2
    signals = {direction: [s.name for s in component.signals.values() if s.direction == direction]
               for direction in ("in", "out")}
    return {"left": [*powers[:half], *signals["in"]], "right": [*powers[half:], *signals["out"]]}


def _port_name(anchor: Anchor, style: Style = KIND) -> Lettering:
    """The name of a port outside the picture, at the end of its wire."""
    dx, dy = SIDES[anchor.side]
    line = (Line(anchor.port, style),)
    align = {-1: "end", 0: "middle", 1: "start"}[dx]
    return lettering(line, anchor.x + 5 * dx, anchor.y - 6 + (10 * dy if dy > 0 else 9 * dy), align)


def _page(model: Model, drawn: Drawn, look: Look) -> str:
    # the box around the outermost sheet with all its names
    boxes = [item.extent for item in drawn.items]
    if drawn.sheet.ports:
        boxes += [drawn.frame, *(_port_name(anchor, NAME).box for anchor in drawn.anchors)]
    boxes += [item.caption.box for item in drawn.items if item.caption]
    for line in drawn.lines:
        boxes += [line.caption.box] if line.caption else []
        boxes += [Box(x - 3, y - 3, x + 3, y + 3) for path in line.wire.lines for x, y in path]
    boxes += [note.box for note in drawn.notes.values()]
    extent = bounds(boxes)
    width = max(extent.right - extent.left, NARROWEST)
    heading = lettering((Line(model.name, TITLE), *wrapped(model.summary, SUMMARY, width)), extent.left, 0, "start")
    shift = heading.box.bottom - heading.box.top + 14
    legend = _legend(drawn, extent.left, extent.bottom + 24) if look.paint is None else \
        _bar(look.paint, extent.left, extent.bottom + 24)
    words = heading.box.moved(0, extent.top - shift)
    words = replace(words, right=words.left + WIDER * (words.right - words.left))
    box = bounds([extent, words, legend[1]])
    left, top = round(box.left - EDGE), round(box.top - EDGE)
    whole_x, whole_y = round(box.right + EDGE) - left, round(box.bottom + EDGE) - top
    outline, ports = [], []  # of a block that is drawn by itself; the names of its ports stand outside the outline
    if drawn.sheet.ports:
        frame = drawn.frame
        outline = [f'<rect x="{frame.left:g}" y="{frame.top:g}" width="{frame.right - frame.left:g}" '
                   f'height="{frame.bottom - frame.top:g}" rx="4" stroke="{QUIET}" stroke-width="1" '
                   'stroke-dasharray="12 3 2 3"/>']
        for anchor in drawn.anchors:
            colour = domain_colour(drawn.sheet.ports[anchor.port])
            ports.append(f'<circle cx="{anchor.x}" cy="{anchor.y}" r="3.5" fill="#ffffff" stroke="{colour}" '
                         'stroke-width="1.6"/>')
            ports += _lettered(_port_name(anchor, NAME), colour, "own-port")
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{whole_x}" height="{whole_y}" '
        f'viewBox="{left} {top} {whole_x} {whole_y}" font-family="{FONT}" fill="none" stroke-linejoin="round">',
        f"<title>{xml(model.name)}</title>",
        f'<rect x="{left}" y="{top}" width="{whole_x}" height="{whole_y}" fill="#ffffff"/>',
        *_lettered(heading.moved(0, extent.top - shift), "#000000", "heading"),
        *outline, *_sheet(drawn, look), *ports, *legend[0], "</svg>"]
    return "\n".join(lines) + "\n"


# -- one sheet ---------------------------------------------------------------------------------------------------------
def _sheet(drawn: Drawn, look: Look) -> list[str]:
    lines: list[str] = []
    for item in drawn.items:
        box = item.extent
        if look.paint is not None and "" not in item.marks and item.inside is None and item.part.path in look.paint.parts:
            lines.append(f'<rect x="{box.left - 3:g}" y="{box.top - 3:g}" width="{box.right - box.left + 6:g}" '
                         f'height="{box.bottom - box.top + 6:g}" rx="4" fill="{look.part(item, "")}" fill-opacity="0.28"/>')
        elif "" in item.marks:
            lines.append(f'<rect x="{box.left - 6:g}" y="{box.top - 6:g}" width="{box.right - box.left + 12:g}" '
                         f'height="{box.bottom - box.top + 12:g}" rx="8" fill="{HALO}"/>')
    for line in drawn.lines:
        stroke, marked = look.net(line), NODE + line.net.path in look.marks
        value = look.paint.nets.get(line.net.path) if look.paint else None
        width = WIDTHS.get(line.net.domain, 1.6) * (ARRAY if line.net.size > 1 else 1) if value is None else 3.2
        paths = " ".join("M" + " L".join(f"{x} {y}" for x, y in path) for path in line.wire.lines)
        if marked:
            lines.append(f'<path d="{paths}" stroke="{HALO}" stroke-width="10" stroke-linecap="round"/>')
        tooltip = f"<title>{xml(line.net.path)}: {look.paint.text(value)}</title>" if look.paint and value is not None \
            else ""
        place = f' data-node="{xml(line.net.path)}"' if not line.net.in_place else ""
        head = f'<path class="wire"{place} d="{paths}" stroke="{stroke}" stroke-width="{width:.3g}"'
        lines.append(f"{head}>{tooltip}</path>" if tooltip else f"{head}/>")
        lines += [f'<circle class="dot" cx="{x}" cy="{y}" r="3" fill="{stroke}"/>' for x, y in line.wire.dots]
        if line.free is not None:
            lines.append(f'<circle cx="{line.free[0]}" cy="{line.free[1]}" r="3" fill="#ffffff" stroke="{stroke}"/>')
    # arrow heads where signals enter
    items = {item.part.name: item for item in drawn.items}
    for line in drawn.lines:
        ends = line.net.ends if line.net.domain == "signal" else ()
        for end in [a for name, port in ends if name and port in items[name].part.inputs for a in items[name].anchors(port)]:
            dx, dy = SIDES[end.side]
            x, y = end.x + 8 * dx, end.y + 8 * dy
            lines.append(f'<path d="M{end.x} {end.y} L{x + 3 * dy} {y + 3 * dx} L{x - 3 * dy} {y - 3 * dx} Z" '
                         f'fill="{look.net(line)}"/>')
    reached = frozenset(point for line in drawn.lines for path in line.wire.lines for point in (path[0], path[-1]))
    for item in drawn.items:
        lines += _item(item, look, reached)
    for line in drawn.lines:
        if line.caption is not None:
            colour = domain_colour(line.net.domain) if look.paint is None else QUIET
            lines += _lettered(line.caption, colour, "formula" if line.net.in_place else "node")
    for name, note in drawn.notes.items():
        place = f'<g class="remark" data-note="{xml(name)}">' if not drawn.sheet.path else "<g>"
        lines += [place, *_lettered(note, NOTE_COLOUR, "note"), "</g>"]
    return lines


def _item(item: Item, look: Look, reached: frozenset[tuple[int, int]]) -> list[str]:
    """A part; `reached` are the end points of wires, to mark the used anchor of a port."""
    kind = item.part.component
    lines = [f'<g class="part" data-part="{xml(item.part.path)}" transform="translate({item.x} {item.y})">',
             f"<title>{xml(f'{item.part.path}: {kind.name}. {kind.summary}')}</title>"]
    main = item.shape.domain or next((d for d in item.part.ports.values() if d != "signal"), "signal")
    colour = look.part(item, main)
    if item.inside is not None:
        # an open block: a chain-dotted frame, as around an assembly, with its sheet inside
        drawn = item.inside
        shape, frame = item.shape, drawn.frame
        lines += [f'<rect x="{shape.left}" y="{shape.top}" width="{shape.right - shape.left}" '
                  f'height="{shape.bottom - shape.top}" rx="4" fill="#fbfbfa" '
                  f'stroke="{QUIET if colour != WARNING else colour}" stroke-width="1" stroke-dasharray="12 3 2 3"/>',
                  f'<g transform="translate({shape.left - frame.left:g} {shape.top - frame.top:g})">']
        if drawn.title is not None:
            lines += _lettered(drawn.title, colour if colour == WARNING else "#000000", "part")
        lines += _sheet(drawn, look)
        lines.append("</g>")
        lines += [f'<circle cx="{a.x}" cy="{a.y}" r="2.5" fill="#ffffff" '
                  f'stroke="{domain_colour(item.part.ports[a.port])}"/>' for a in shape.anchors]
    else:
        lines += _picture(item.shape, colour, main, "" in item.marks or look.paint is not None)
    for port in item.marks:
        ends = sorted(item.shape.of(port), key=lambda a: (a.x + item.x, a.y + item.y) not in reached)
        lines += [f'<circle cx="{a.x}" cy="{a.y}" r="6" stroke="{WARNING}" stroke-width="2.5"/>' for a in ends[:1]]
    lines.append("</g>")
    if item.caption is not None:
        lines += [f'<g data-part="{xml(item.part.path)}">',
                  *_lettered(item.caption, WARNING if "" in item.marks else "#000000", "part"), "</g>"]
    return lines


def _picture(shape: Shape, colour: str, main: str, marked: bool) -> list[str]:
    """The marks of a symbol, turned; writing in it upright."""
    turn = shape.turn
    head = f'<g color="{colour}" stroke="currentColor" stroke-width="1.6"'
    lines = [head + (">" if turn == STRAIGHT else ' transform="matrix({} {} {} {} 0 0)">'.format(*turn))]
    lines += [_element(mark, marked) for mark in shape.marks if mark.tag != "text"]
    lines.append("</g>")
    for mark in shape.marks:
        if mark.tag == "text":
            lines.append(_writing(mark, turn, colour if marked else domain_colour(main)))
    return lines


def _element(mark: Mark, marked: bool) -> str:
    attributes = dict(mark.attributes)
    domain = attributes.pop("data-domain", "")
    if domain and not marked:
        attributes["color"] = domain_colour(domain)
        attributes.setdefault("stroke", "currentColor")
    return f"<{mark.tag} " + " ".join(f'{name}="{xml(value)}"' for name, value in attributes.items()) + "/>"


def _writing(mark: Mark, turn: tuple[int, int, int, int], colour: str) -> str:
    """Text of a symbol: its place is turned with the picture, the text itself stays upright."""
    attributes = dict(mark.attributes)
    size = float(attributes.get("font-size", "10"))
    style = attributes.get("data-style", "")
    x, y = float(attributes.get("x", "0")), float(attributes.get("y", "0")) - 0.35 * size
    a, b, c, d = turn
    x, y = a * x + c * y, b * x + d * y + 0.35 * size
    weight = ' font-weight="bold"' if style == "name" else ""
    slant = ' font-style="italic"' if attributes.get("font-style") == "italic" else ""
    fill = {"name": "#000000" if colour != WARNING else WARNING, "quiet": QUIET}.get(style, colour)
    name = ' class="part"' if style == "name" else ""
    return (f'<text{name} x="{x:g}" y="{y:g}" font-size="{size:g}"{weight}{slant} fill="{fill}" '
            f'text-anchor="{attributes.get("text-anchor", "middle")}">{xml(mark.text)}</text>')


# -- words -------------------------------------------------------------------------------------------------------------
def _lettered(text: Lettering, colour: str, css_class: str) -> list[str]:
    """Lines of writing; the first is the name of a part or node and carries `css_class` as its class."""
    x = {"start": text.box.left, "middle": (text.box.left + text.box.right) / 2, "end": text.box.right}[text.align]
    y, lines = text.box.top, []
    for k, line in enumerate(text.lines):
        style = line.style
        base = y + style.size - 1 + (2 if style.tag else 0)
        if style.tag:
            left = {"start": x, "middle": x - line.width / 2, "end": x - line.width}[text.align]
            lines += [f'<rect x="{left:g}" y="{y + 1:g}" width="{line.width:g}" height="{line.height - 1}" rx="3" '
                      f'fill="{WARNING}"/>',
                      f'<text class="tag" x="{left + line.width / 2:g}" y="{y + style.size:g}" font-size="{style.size}" '
                      # in a viewer with a wider font, the text is compressed to the width of its background
                      f'font-weight="bold" fill="#ffffff" text-anchor="middle" textLength="{line.width - 8:g}" '
                      f'lengthAdjust="spacingAndGlyphs">{xml(line.text)}</text>']
        else:
            fill = QUIET if style.quiet else colour
            name = f' class="{css_class}"' if k == 0 else ""
            face = (' font-weight="bold"' if style.bold else "") + (' font-style="italic"' if style.italic else "")
            lines.append(f'<text{name} x="{x:g}" y="{base:g}" font-size="{style.size}"{face} fill="{fill}" '
                         f'text-anchor="{text.align}">{xml(line.text)}</text>')
        y += line.height
    return lines


def domain_colour(name: str) -> str:
    """The colour in which lines of a domain, or of signals, are drawn."""
    domain = domains().get(name)
    return SIGNAL if name == "signal" else domain.colour or OTHER if domain is not None else OTHER


def _legend(drawn: Drawn, x: float, y: float) -> tuple[list[str], Box]:
    """Legend of the colours in use."""
    used = _domains(drawn)
    lines, right = [], x
    for domain in [d for d in (*domains(), "signal") if d in used]:
        width = WIDTHS.get(domain, 1.6)
        lines += [f'<path d="M{right:g} {y:g} h20" stroke="{domain_colour(domain)}" stroke-width="{width}"/>',
                  f'<text x="{right + 25:g}" y="{y + 3:g}" font-size="{KIND.size}" fill="{QUIET}">{xml(domain)}</text>']
        right += 25 + text_width(domain, KIND) + 18
    return lines, Box(x, y - 6, max(right, x + 1), y + 6)


def _bar(paint: Paint, x: float, y: float) -> tuple[list[str], Box]:
    """The colour bar with its numbers."""
    length, height, steps, ticks = 240, 10, 60, (0.0, 0.25, 0.5, 0.75, 1.0)
    lines = [f'<text class="bar" x="{x:g}" y="{y:g}" font-size="{VALUE.size}" fill="#000000">{xml(paint.title)} '
             f"[{xml(unit_label(paint.unit))}]</text>"]
    for k in range(steps):
        lines.append(f'<rect x="{x + length * k / steps:g}" y="{y + 7:g}" width="{length / steps + 0.5:g}" '
                     f'height="{height}" fill="{paint.colour(paint.at((k + 0.5) / steps))}"/>')
    for share in ticks:
        lines.append(f'<text x="{x + share * length:g}" y="{y + 29:g}" font-size="{KIND.size}" fill="{QUIET}" '
                     f'text-anchor="middle">{number(paint.at(share), 3)}</text>')
    lines += [f'<path d="M{x + length + 40:g} {y + 12:g} h20" stroke="{FADED}" stroke-width="3.2"/>',
              f'<text x="{x + length + 66:g}" y="{y + 15:g}" font-size="{KIND.size}" fill="{QUIET}">none</text>']
    return lines, Box(x - 16, y - 10, x + length + 100, y + 34)


def _domains(drawn: Drawn) -> set[str]:
    domains_used = {line.net.domain for line in drawn.lines}
    for item in drawn.items:
        if item.inside is not None:
            domains_used |= _domains(item.inside)
    return domains_used
