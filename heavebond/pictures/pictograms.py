"""The symbols of components: SVG fragments with named anchors, rotated and mirrored; boxes for components without one.

A symbol is a file `symbols/NAME.svg` in the folder of the component's file or in the library. It is treated as data: only
the few elements and attributes listed here are used, with plain values, so that it cannot contain active content. A
circle with `data-port` is an anchor, at which the wire of that port ends; it lies on the edge of the view box, on the
grid of 10 px, and its edge is the side on which the wire leaves. A port may have several anchors: the block of a mass is
one body.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree

from heavebond.core.errors import ModelError, Place, Problem, listing, suggest
from heavebond.core.limits import SYMBOL_BYTES
from heavebond.language.definition import ChartState, Component
from heavebond.language.library import bundled, shown_path
from heavebond.pictures.text_metrics import KIND, NAME, PORT, Line, size, text_width

GRID = 10
SIDES = {"left": (-1, 0), "right": (1, 0), "top": (0, -1), "bottom": (0, 1)}
Matrix = tuple[int, int, int, int]  # x' = a*x + c*y, y' = b*x + d*y, in the order of SVG
STRAIGHT: Matrix = (1, 0, 0, 1)
MIRROR: Matrix = (-1, 0, 0, 1)
FLIPPED: Matrix = (1, 0, 0, -1)
HALF: Matrix = (-1, 0, 0, -1)
# permitted rotations: some symbols are upright only (a tank), some keep their direction of writing (a signal block)
TURNS: dict[str, tuple[Matrix, ...]] = {
    "none": (STRAIGHT,), "mirror": (STRAIGHT, MIRROR), "flip": (STRAIGHT, MIRROR, FLIPPED, HALF),
    "any": (STRAIGHT, MIRROR, FLIPPED, HALF, (0, 1, -1, 0), (0, -1, 1, 0), (0, 1, 1, 0), (0, -1, -1, 0))}
_ELEMENTS = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon", "text", "title"}
_ATTRIBUTES = {"d", "x", "y", "width", "height", "rx", "ry", "cx", "cy", "r", "x1", "y1", "x2", "y2", "points", "fill",
               "stroke", "stroke-width", "stroke-dasharray", "font-size", "font-style", "text-anchor", "data-domain",
               "data-port"}
_PLAIN = re.compile(r"[-\w\s.,#%+]*")  # no brackets: neither url() nor other references
_SVG = "{http://www.w3.org/2000/svg}"


@dataclass(frozen=True)
class Anchor:
    """End of the wire of a port, relative to the centre of the picture, and the side on which it leaves."""

    port: str
    x: int
    y: int
    side: str


@dataclass(frozen=True)
class Mark:
    """One element of a picture with its attributes; `text` for writing, which stays upright when the picture is rotated."""

    tag: str
    attributes: tuple[tuple[str, str], ...]
    text: str = ""


@dataclass(frozen=True)
class Shape:
    """A picture around its centre: extent, anchors, marks, present rotation (`turn`) and permitted rotations (`turns`);
    `leave`: the sides on which the wire of the first port preferably leaves (a fixed point: at the top, so that the
    fixed point is below the parts that it carries)."""

    left: int
    top: int
    right: int
    bottom: int
    anchors: tuple[Anchor, ...]
    marks: tuple[Mark, ...] = ()
    domain: str = ""
    turns: tuple[Matrix, ...] = (STRAIGHT,)
    turn: Matrix = STRAIGHT
    leave: tuple[str, ...] = ()

    def turned(self, turn: Matrix) -> Shape:
        """The rotated picture; `turn` is relative to the picture in its file."""
        xs, ys = zip(*(_applied(turn, x, y) for x in (self.left, self.right) for y in (self.top, self.bottom)), strict=True)
        sides = {vector: side for side, vector in SIDES.items()}
        anchors = tuple(Anchor(a.port, *_applied(turn, a.x, a.y), sides[_applied(turn, *SIDES[a.side])])
                        for a in self.anchors)
        return replace(self, left=min(xs), top=min(ys), right=max(xs), bottom=max(ys), anchors=anchors, turn=turn)

    def of(self, port: str) -> tuple[Anchor, ...]:
        """The anchors of a port; the anchors of `p` also serve `p[2]`."""
        return tuple(a for a in self.anchors if a.port == port) or \
            tuple(a for a in self.anchors if a.port == port.partition("[")[0])


def _applied(turn: Matrix, x: int, y: int) -> tuple[int, int]:
    a, b, c, d = turn
    return a * x + c * y, b * x + d * y


def symbol(component: Component) -> Shape | None:
    """The picture that a component names, None if it names none; ModelError if it cannot be used."""
    if not component.symbol:
        return None
    beside = component.path.parent / "symbols"
    folders = [beside, bundled("components") / "symbols"]
    path = next((p for folder in folders if (p := folder / f"{component.symbol}.svg").is_file()), None)
    if path is None or not re.fullmatch(r"\w+", component.symbol):
        known = [p.stem for folder in folders for p in sorted(folder.glob("*.svg"))]
        raise _wrong("symbol-unknown", f"there is no symbol '{component.symbol}' for {component.name}", component.place,
                     suggest(component.symbol, known) or f"A symbol is a file: {beside / 'NAME.svg'}. In the library: "
                     f"{listing(known, 60)}.")
    shape = _read(path, path.stat().st_mtime_ns)
    missing = [p for p in (*component.ports, *component.signal_names) if not shape.of(p)]
    if missing:
        raise _wrong("symbol-port", f"the symbol '{component.symbol}' has no place for {listing(missing)} of "
                     f"{component.name}", component.place, "Its places: " + listing(dict.fromkeys(
                         a.port for a in shape.anchors)) + ". Take another one, or leave `symbol:` out for a box.")
    return shape


def _wrong(code: str, message: str, place: Place | None, hint: str) -> ModelError:
    return ModelError([Problem(code, message, place, hint)])


@lru_cache(maxsize=256)
def _read(path: Path, stamp: int) -> Shape:
    place = Place(shown_path(path), 1)
    try:
        with open(path, "rb") as file:
            content = file.read(SYMBOL_BYTES + 1)
        if len(content) > SYMBOL_BYTES:
            raise _wrong("symbol-bad", f"a symbol has at most {SYMBOL_BYTES // 1000} kB", place, "Draw it with fewer marks.")
        text = content.decode("utf-8")
        if "<!" in text.replace("<!--", ""):  # entities could expand to any size
            raise _wrong("symbol-bad", "a symbol has no document type and no entities", place, "Remove what begins `<!`.")
        root = ElementTree.fromstring(text)
        box = [int(number) for number in root.get("viewBox", "").split()]
        left, top, width, height = box
    except (ElementTree.ParseError, ValueError, OSError) as error:
        raise _wrong("symbol-bad", f"this is not a symbol: {error}", place, "It is an SVG file whose viewBox has four whole "
                     "numbers.") from None
    turns = TURNS.get(root.get("data-turn", "none"))
    if turns is None:
        raise _wrong("symbol-bad", f"data-turn is none of {listing(TURNS)}", place, "Correct it.")
    leave = tuple(root.get("data-leave", "").split())
    if any(side not in SIDES for side in leave):
        raise _wrong("symbol-bad", f"data-leave is none of {listing(SIDES)}", place, "Correct it.")
    right, bottom = left + width, top + height
    anchors, marks = [], []
    for element in root.iter():
        if element is root:
            continue
        tag = element.tag.removeprefix(_SVG) if isinstance(element.tag, str) else "?"
        odd = [name for name, value in element.items() if name not in _ATTRIBUTES or
               (name != "data-port" and not _PLAIN.fullmatch(value))]
        if tag not in _ELEMENTS or odd:
            raise _wrong("symbol-bad", f"a symbol has no <{tag}>" if tag not in _ELEMENTS else
                         f"<{tag}> has {listing(odd)}, which a symbol cannot have", place,
                         f"Elements: {listing(sorted(_ELEMENTS))}; attributes: {listing(sorted(_ATTRIBUTES), 30)}.")
        mark = Mark(tag, tuple(element.items()), (element.text or "").strip())
        if element.get("data-port"):
            anchors.append(_anchor(element, (left, top, right, bottom), place))
        elif mark.tag != "title":
            marks.append(mark)
    return Shape(left, top, right, bottom, tuple(anchors), tuple(marks), root.get("data-domain", ""), turns,
                 leave=leave)


def _anchor(element: ElementTree.Element, box: tuple[int, int, int, int], place: Place) -> Anchor:
    port = element.get("data-port", "")
    left, top, right, bottom = box
    try:
        x, y = int(element.get("cx", "")), int(element.get("cy", ""))
    except ValueError:
        x, y = 1, 1
    edges = {"left": x == left, "right": x == right, "top": y == top, "bottom": y == bottom}
    side = next((name for name, on_edge in edges.items() if on_edge), "")
    if not side or x % GRID or y % GRID:
        raise _wrong("symbol-bad", f"the place of port '{port}' is not on the edge of the viewBox, on a multiple of {GRID}",
                     place, "Move it there: that edge is the side on which the wire leaves.")
    return Anchor(port, x, y, side)


def rounded_up(length: float) -> int:
    """Round up to a multiple of two grid steps, so that the half lies on the grid."""
    return 2 * GRID * math.ceil(length / (2 * GRID) - 1e-9)


def box(name: str, kind: str, sides: Mapping[str, Sequence[str]], states: Sequence[ChartState] = ()) -> Shape:
    """A box with a name, the kind of the component and its ports on the sides (in order from top or left), and below
    the name its state machine."""
    words = (Line(name, NAME), *([Line(kind, KIND)] if kind else []))
    chart_width, chart_height = state_chart(states)[0]
    labels = {side: max((text_width(_port_label(p), PORT) for p in ports), default=0.0) for side, ports in sides.items()}
    width, height = size(words)
    width, height = max(width, chart_width), height + chart_height
    upper, lower = (14 if sides.get(side) else 4 for side in ("top", "bottom"))
    across = max(len(sides.get(side, ())) * max(4 * GRID, -(-(labels.get(side, 0) + 10) // (2 * GRID)) * 2 * GRID)
                 for side in ("top", "bottom"))  # in the order of `_spread`
    whole_x = rounded_up(max(60.0, width + 16 + 2 * max(labels.get("left", 0), labels.get("right", 0)), across))
    rows = max(len(sides.get("left", ())), len(sides.get("right", ())))
    # the names of ports at the top and the bottom are above and below the names at the sides
    beside = rows * 2 * GRID + 2 * max(upper, lower) - 8 if rows else 0
    whole_y = rounded_up(max(40.0, height + 2 * max(upper, lower) + 4, beside))
    half_x, half_y = whole_x // 2, whole_y // 2
    anchors: list[Anchor] = []
    marks = [Mark("rect", (("x", str(-half_x)), ("y", str(-half_y)), ("width", str(whole_x)), ("height", str(whole_y)),
                           ("rx", "3"), ("fill", "#ffffff")))]
    for side, ports in sides.items():
        along, edge = (half_y, half_x) if side in ("left", "right") else (half_x, half_y)
        # `count` places on the grid, evenly over an edge from -half to half; a single one in the middle
        count = len(ports)
        pitch = max(2 * GRID, 2 * along // max(count, 1) // (2 * GRID) * 2 * GRID)
        if count % 2 == 0:
            spread = [(2 * k - count + 1) * pitch // 2 for k in range(count)]
        else:
            spread = [(k - count // 2) * pitch for k in range(count)]
        for port, offset in zip(ports, spread, strict=True):
            out = SIDES[side]
            x, y = (out[0] * edge, offset) if out[0] else (offset, out[1] * edge)
            anchors.append(Anchor(port, x, y, side))
            dx, dy, align = {"left": (4, 3, "start"), "right": (-4, 3, "end"), "top": (0, 10, "middle"),
                             "bottom": (0, -4, "middle")}[side]
            port_label = Mark("text",
                              (("x", str(x + dx)), ("y", str(y + dy)), ("font-size", str(PORT.size)), ("text-anchor", align),
                               ("data-style", "quiet")), _port_label(port))
            marks.append(port_label)
    base = -height / 2
    for line in words:
        base += line.height
        marks.append(Mark("text", (("x", "0"), ("y", f"{base - 3:g}"), ("font-size", str(line.style.size)),
                                   ("data-style", "name" if line.style.bold else "quiet")), line.text))
    marks += state_chart(states, -chart_width / 2, base)[1]
    return Shape(-half_x, -half_y, half_x, half_y, tuple(anchors), tuple(marks))


def _port_label(port: str) -> str:
    return port.removeprefix(":")


ROW, INDENT, HEAD, LANE = 12, 8, 3, 8  # px: a line of text, its indent, half the head of an arrow, between two lines
WIDER = 1.13  # width of DejaVu Sans, the substitute for Helvetica and Arial, relative to the measured width


def state_chart(states: Sequence[ChartState], left: float = 0.0, top: float = 0.0) -> tuple[tuple[float, float], list[Mark]]:
    """The size and the marks of a state machine from its upper left corner: the states below each other, each with its
    entry values and its transitions; a line leads from each transition to the state that it enters."""
    if not states:
        return (0.0, 0.0), []
    rows = [[*(f"{reset.target.text} = {reset.value.text}" for reset in state.entry),
             *(f"{t.target}: {t.text}" for t in state.transitions)] for state in states]
    width = max(60.0, *(text_width(state.name, NAME) + 20 for state in states),
                *(WIDER * text_width(row, PORT) + 2 * INDENT for texts in rows for row in texts))
    tops, y = dict[str, float](), top + 2 * ROW
    for state, texts in zip(states, rows, strict=True):
        tops[state.name] = y
        y += ROW * (len(texts) + 2)
    lane = right = left + width
    middle = left + width / 2
    marks = [_drawn("circle", cx=middle, cy=top + 5, r=3, fill="currentColor"),
             _drawn("path", d=f"M{middle:g} {top + 8:g} V{top + 2 * ROW - 6:g}"), _head(middle, top + 2 * ROW, 0, 1)]
    for state, texts in zip(states, rows, strict=True):
        upper = tops[state.name]
        marks += [_drawn("rect", x=left, y=upper, width=width, height=ROW * (len(texts) + 1) + 4, rx=6, fill="#ffffff"),
                  _written(state.name, middle, upper + ROW - 1, NAME.size, "middle", "name")]
        marks += [_written(row, left + INDENT, upper + ROW * (k + 2) - 1, PORT.size, "start", "quiet")
                  for k, row in enumerate(texts)]
        for k, t in enumerate(state.transitions, len(state.entry) + 2):
            lane += LANE
            leaves, enters = upper + ROW * k - 4, tops[t.target] + ROW / 2
            marks += [_drawn("path", d=f"M{right:g} {leaves:g} H{lane:g} V{enters:g} H{right + 6:g}"),
                      _head(right, enters, -1, 0)]
    return (lane - left + 4, y - top), marks


def _drawn(tag: str, **attributes: str | float) -> Mark:
    return Mark(tag, (*((name, value if isinstance(value, str) else f"{value:g}") for name, value in attributes.items()),
                      ("stroke-width", "1")))


def _head(x: float, y: float, dx: int, dy: int) -> Mark:
    """An arrow's head whose tip is at a point."""
    back, side = (x - 6 * dx, y - 6 * dy), (HEAD * dy, HEAD * dx)
    return _drawn("path", d=f"M{x:g} {y:g} L{back[0] + side[0]:g} {back[1] + side[1]:g} "
                  f"L{back[0] - side[0]:g} {back[1] - side[1]:g} z", fill="currentColor")


def _written(text: str, x: float, y: float, height: int, align: str, style: str) -> Mark:
    return Mark("text", (("x", f"{x:g}"), ("y", f"{y:g}"), ("font-size", str(height)), ("text-anchor", align),
                         ("data-style", style)), text)
