"""Width of text on a drawing, and blocks of lines; widths are from Helvetica, which Arial and others share."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

# advance widths in 1/1000 of the size, for the characters from the blank to the tilde (Adobe's font metrics, Helvetica)
_WIDTHS = (
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556, 556,
    556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778,
    667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556, 556, 278, 556,
    556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584)
_OTHER, _WIDE, _FIRST_WIDE = 640, 1050, 0x2E80  # first code point of scripts whose characters are as wide as high
_SPARE = 1.06  # factor for viewers without the named fonts
FONT = "Helvetica, Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"


@dataclass(frozen=True)
class Style:
    """Style of a line: size in px, weight and slant, and whether it has a coloured background."""

    size: int
    bold: bool = False
    italic: bool = False
    tag: bool = False
    quiet: bool = False


TITLE, SUMMARY = Style(16, bold=True), Style(11, quiet=True)
NAME, KIND, VALUE, PORT = Style(11, bold=True), Style(9, quiet=True), Style(10, quiet=True), Style(8, quiet=True)
NODE_NAME, TAG, NOTE = Style(10, italic=True), Style(10, bold=True, tag=True), Style(12)


@dataclass(frozen=True)
class Line:
    """One line of text."""

    text: str
    style: Style

    @property
    def width(self) -> float:
        """px."""
        pad = 8 if self.style.tag else 0
        return text_width(self.text, self.style) + pad

    @property
    def height(self) -> int:
        """px from line to line."""
        return self.style.size + (5 if self.style.tag else 3)


@dataclass(frozen=True)
class Box:
    """A rectangle; y counts downwards."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Box, gap: float = 0.0) -> bool:
        """True if the two overlap or are nearer than `gap`."""
        return (self.left < other.right + gap and other.left < self.right + gap
                and self.top < other.bottom + gap and other.top < self.bottom + gap)

    def moved(self, x: float, y: float) -> Box:
        """The box at another place."""
        return Box(self.left + x, self.top + y, self.right + x, self.bottom + y)


@dataclass(frozen=True)
class Lettering:
    """Lines below each other, `align`ed (start, middle, end) in a box of their size."""

    lines: tuple[Line, ...]
    box: Box
    align: str = "middle"

    def moved(self, x: float, y: float) -> Lettering:
        """The lines at another place."""
        return Lettering(self.lines, self.box.moved(x, y), self.align)


def text_width(text: str, style: Style) -> float:
    """The width of a text in px, rather too wide than too narrow."""
    total = 0
    for character in text:
        code = ord(character) - 32
        total += _WIDTHS[code] if 0 <= code < len(_WIDTHS) else _WIDE if ord(character) >= _FIRST_WIDE else _OTHER
    return total / 1000 * style.size * (1.07 if style.bold else 1.0) * _SPARE


def size(lines: tuple[Line, ...]) -> tuple[float, float]:
    """Width and height of lines below each other, px."""
    return max((line.width for line in lines), default=0.0), sum(line.height for line in lines)


def lettering(lines: tuple[Line, ...], x: float, y: float, align: str = "middle") -> Lettering:
    """Lines whose box has its upper edge at y and its left edge, middle or right edge at x."""
    width, height = size(lines)
    left_edge = {"start": x, "middle": x - width / 2, "end": x - width}[align]
    return Lettering(lines, Box(left_edge, y, left_edge + width, y + height), align)


def bounds(boxes: list[Box]) -> Box:
    """The smallest box around boxes."""
    return Box(min(b.left for b in boxes), min(b.top for b in boxes), max(b.right for b in boxes),
               max(b.bottom for b in boxes))


def wrapped(text: str, style: Style, width: float) -> tuple[Line, ...]:
    """Break a text between words into lines of at most `width` px if the words permit it."""
    words = text.split()
    starts, current = [0] if words else [], ""
    for k, word in enumerate(words):
        longer = f"{current} {word}".strip()
        if current and text_width(longer, style) > width:
            starts.append(k)
            longer = word
        current = longer
    return tuple(Line(" ".join(words[a:b]), style) for a, b in pairwise([*starts, len(words)]))


def shortened(text: str, most: int) -> str:
    """A text of at most `most` characters."""
    return text if len(text) <= most else text[:most - 1].rstrip() + "…"
