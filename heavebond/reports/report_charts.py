"""Small SVG charts: errors of successive models, parameters in their ranges, points and curves over one variable."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.core.presentation import number
from heavebond.numerics.dae import Array
from heavebond.pictures.markup import Html, element

# Okabe and Ito, Color universal design, 2008: distinguishable for all kinds of colour vision
BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#aa4a86"
INK, QUIET, GRID, AXIS = "#1d2733", "#55606c", "#e4e8ec", "#7d8894"
LETTER = 6.4  # average width in px of a character of 12 px
MOST_POINTS = 1500


def text(x: float, y: float, words: str, *, anchor: str = "start", fill: str = QUIET, size: float = 12, bold: bool = False,
         turned: bool = False, halo: bool = False) -> Html:
    """A text with its base line at (x, y); `turned` rotates it to read upwards, a halo covers lines behind it."""
    return element("text", words, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor if anchor != "start" else None, fill=fill,
                   font_size=f"{size:g}", font_weight="bold" if bold else None, paint_order="stroke" if halo else None,
                   stroke="#ffffff" if halo else None, stroke_width="4" if halo else None,
                   transform=f"rotate(-90 {x:.1f} {y:.1f})" if turned else None)


def line(x1: float, y1: float, x2: float, y2: float, stroke: str, width: float = 1, dash: str | None = None) -> Html:
    """A straight line."""
    return element("path", d=f"M{x1:.1f} {y1:.1f}L{x2:.1f} {y2:.1f}", stroke=stroke, stroke_width=f"{width:g}",
                   stroke_dasharray=dash, fill="none")


def svg(width: float, height: float, label: str, *parts: Html) -> Html:
    """A picture with an alternative text `label`."""
    return element("svg", *parts, class_="chart", viewBox=f"0 0 {width:g} {height:g}", width=f"{width:g}",
                   height=f"{height:g}", role="img", aria_label=label)


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers between two ends with a spacing of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / max(1, most)
    power = 10.0 ** math.floor(math.log10(rough))
    step = power * next(k for k in (1, 2, 5, 10) if k * power >= rough * 0.999)
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


# -- the falling error -------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Fall:
    """The errors of one model; each bar is (set of records, error in per cent or NaN, error due to noise alone)."""

    name: str
    bars: tuple[tuple[str, float, float], ...]


def ladder(falls: Sequence[Fall], colours: Sequence[str], label: str) -> Html:
    """Bar chart of errors: a group of bars for each model; a mark on each bar is the error due to noise alone."""
    width, left, right, bar, head, gap = 640.0, 66.0, 70.0, 18.0, 22.0, 12.0
    most = max([v for f in falls for _, v, _ in f.bars if math.isfinite(v)], default=1.0) or 1.0
    scale = (width - left - right) / most
    parts, y = [], 8.0
    groups, names = [], []
    for fall in falls:
        names.append(text(0, y + 13, fall.name, fill=INK, size=13, bold=True, halo=True))
        y += head
        for k, (kind, value, noise) in enumerate(fall.bars):
            if not math.isfinite(value):
                continue
            long, alone = max(1.0, value * scale), noise * scale if noise < most else 0.0
            groups += [text(left - 8, y + 12.5, kind, anchor="end"),
                       element("rect", x=f"{left:g}", y=f"{y:.1f}", width=f"{long:.1f}", height=f"{bar - 3:g}",
                               fill=colours[k]),
                       text(left + max(long, alone) + 8, y + 12, f"{number(value, 3)} %", fill=INK)]
            groups += [line(left + alone, y - 2, left + alone, y + bar - 1, "#000000", 2)] if alone else []
            y += bar
        y += gap
    base = y
    for value in ticks(0, most, 7):
        x = left + value * scale
        parts += [line(x, 4, x, base, GRID), text(x, base + 15, f"{number(value, 4)} %", anchor="middle")]
    return svg(width, base + 22, label, *parts, line(left, 4, left, base, AXIS), *groups, *names)


def interval(low: float, high: float, inner: tuple[float, float], value: float, before: float | None, logarithmic: bool,
             label: str) -> Html:
    """A parameter in its range: a pale bar for the range, a dark bar for the confidence interval, a dot for the value, and a
    tick for the value of the data sheet."""
    def place(v: float) -> float:
        a, b, c = (math.log(k) for k in (low, high, v)) if logarithmic else (low, high, v)
        return 8 + 164 * min(1.0, max(0.0, (c - a) / (b - a))) if b > a else 90.0

    first, last, x = place(inner[0]), place(inner[1]), place(value)
    tick = [line(place(before), 3, place(before), 17, AXIS, 2)] if before is not None else []
    return svg(180, 20, label,
               element("rect", x="8", y="8", width="164", height="4", fill="#dfe4e9"), *tick,
               element("rect", x=f"{first:.1f}", y="7", width=f"{max(1.5, last - first):.1f}", height="6", fill="#7fb8d8"),
               element("circle", cx=f"{x:.1f}", cy="10", r="4", fill=BLUE))


# -- over one variable -------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Cloud:
    """Points of one colour."""

    x: Array
    y: Array
    colour: str
    size: float = 2.6


@dataclass(frozen=True)
class Line:
    """A line through points, interrupted after the points `ends`."""

    x: Array
    y: Array
    colour: str
    width: float = 2.0
    dash: str | None = None
    ends: tuple[int, ...] = ()
    opacity: float = 1.0


@dataclass(frozen=True)
class Frame:
    """A linear or logarithmic map from values to px."""

    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    left: float = 60.0
    right: float = 12.0
    top: float = 26.0
    bottom: float = 40.0
    logarithmic: bool = False

    def px(self, x: Array) -> Array:
        """The distance in px from the left."""
        return np.asarray(self.left + (x - self.x[0]) / (self.x[1] - self.x[0]) * (self.width - self.left - self.right))

    def py(self, y: Array) -> Array:
        """The distance in px from the top."""
        low, high = (math.log10(v) for v in self.y) if self.logarithmic else self.y
        v = np.log10(np.maximum(y, 1e-300)) if self.logarithmic else y
        return np.asarray(self.height - self.bottom - (v - low) / (high - low) * (self.height - self.top - self.bottom))

    def path(self, x: Array, y: Array, ends: Sequence[int] = ()) -> str:
        """The SVG path of a line through points."""
        px, py = self.px(x), np.clip(self.py(y), self.top - 400, self.height + 400)
        starts = {0, *(e + 1 for e in ends)}
        return "".join(f"{'M' if k in starts else 'L'}{a:.1f} {b:.1f}" for k, (a, b) in enumerate(zip(px, py, strict=True)))

    def axes(self, title: str, across: str, up: str) -> list[Html]:
        """The grid, the numbers and the names of the axes."""
        base, parts = self.height - self.bottom, []
        for v in ticks(*self.x, 5):
            x = float(self.px(np.array(v)))
            parts += [line(x, self.top, x, base, GRID), text(x, base + 15, _short(v), anchor="middle", size=11)]
        if not self.logarithmic:
            levels = ticks(*self.y, 5)
        else:
            low, high = (math.log10(v) for v in self.y)
            levels = [10.0 ** k for k in range(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1)]
        for v in levels:
            y = float(self.py(np.array(v)))
            parts += [line(self.left, y, self.width - self.right, y, GRID),
                      text(self.left - 6, y + 4, _short(v), anchor="end", size=11)]
        right = self.width - self.right
        return [*parts, line(self.left, base, right, base, AXIS), line(self.left, self.top, self.left, base, AXIS),
                text(self.left, 15, title, fill=INK, size=12.5, bold=True),
                text((self.left + right) / 2, self.height - 7, across, anchor="middle"),
                text(13, (self.top + base) / 2, up, anchor="middle", turned=True)]


def over(clouds: Sequence[Cloud], lines: Sequence[Line], *, title: str, across: str, up: str, label: str,
         size: tuple[float, float] = (338.0, 280.0), limits: Array | None = None) -> Html:
    """Points and lines over one variable; the points or `limits` set the vertical range, and lines are clipped to it."""
    xs = np.concatenate([*(c.x for c in clouds), *(part.x for part in lines)])
    ys = limits if limits is not None else np.concatenate([c.y for c in clouds] or [part.y for part in lines])
    frame = Frame(*size, _ends(xs, 0.03), _ends(ys, 0.08))
    digest = hashlib.sha256(label.encode("utf-8", "replace"))  # the same on every machine
    for array in (xs, ys):
        digest.update(np.ascontiguousarray(array, dtype=np.float64).tobytes())
    name = f"clip{int.from_bytes(digest.digest()[:6], 'big'):x}"
    inside = []
    for c in clouds:
        thin = slice(None, None, max(1, -(-len(c.x) // MOST_POINTS)))
        inside.append(element("path", d="".join(f"M{a:.1f} {b:.1f}h0"
                                                for a, b in zip(frame.px(c.x[thin]), frame.py(c.y[thin]), strict=True)),
                              stroke=c.colour, stroke_width=f"{c.size:g}", stroke_linecap="round",
                              stroke_opacity="0.5", fill="none"))
    inside += [element("path", d=frame.path(part.x, part.y, part.ends), stroke=part.colour, stroke_width=f"{part.width:g}",
                       stroke_dasharray=part.dash, stroke_linejoin="round", fill="none",
                       stroke_opacity=f"{part.opacity:g}" if part.opacity < 1 else None) for part in lines]
    clip = element("clipPath", element("rect", x=f"{frame.left:g}", y=f"{frame.top:g}",
                                       width=f"{size[0] - frame.left - frame.right:g}",
                                       height=f"{size[1] - frame.top - frame.bottom:g}"), id=name)
    return svg(*size, label, clip, *frame.axes(title, across, up), element("g", *inside, clip_path=f"url(#{name})"))


def steps(series: Sequence[tuple[str, Array, Array]], *, title: str, across: str, up: str, label: str) -> Html:
    """Step charts by name: levels (K,) between edges (K+1,) on a logarithmic vertical axis, with a line at 1."""
    size = 518.0, 230.0
    values = np.concatenate([np.maximum(level, 1e-2) for _, _, level in series])
    low, high = 10.0 ** math.floor(math.log10(min(values.min(), 0.9))), 10.0 ** math.ceil(math.log10(max(values.max(), 1.1)))
    frame = Frame(*size, _ends(np.concatenate([edges for _, edges, _ in series]), 0.0), (low, high), logarithmic=True)
    colours = (BLUE, ORANGE, GREEN, PURPLE)
    right, one = size[0] - frame.right, float(frame.py(np.array(1.0)))
    parts = [line(frame.left, one, right, one, "#000000", 1.2, "5 3")]
    for k, (name, edges, level) in reversed(list(enumerate(series))):
        x, y = np.repeat(edges, 2)[1:-1], np.repeat(np.maximum(level, low), 2)
        parts.append(element("path", d=frame.path(x, y), stroke=colours[k % 4], stroke_width="1.8", fill="none"))
        if len(series) > 1:
            parts.append(text(right, 15, name, anchor="end", fill=colours[k % 4], bold=True))
            right -= LETTER * len(name) + 14
    return svg(*size, label, *frame.axes(title, across, up), *parts)


def swatch(*parts: tuple[str, str, str]) -> Html:
    """A legend: (kind, colour, words); kinds are dot, line, dash, area and mark (upright)."""
    items = []
    for kind, colour, words in parts:
        mark = {"dot": element("circle", cx="11", cy="7", r="3.5", fill=colour),
                "area": element("rect", x="1", y="2", width="20", height="10", fill=colour),
                "mark": line(11, 0, 11, 14, colour, 2)}.get(kind) or \
            line(1, 7, 21, 7, colour, 2.2, "5 2.5" if kind == "dash" else None)
        items.append(element("span", element("svg", mark, width="22", height="14", aria_hidden="true"), f" {words}"))
    return element("span", *items, class_="swatches")


def _short(value: float) -> str:
    """The label of a number at an axis: 5e7 for 50000000."""
    mantissa, exponent, power = f"{value:.6g}".partition("e")
    return f"{mantissa}e{int(power)}" if exponent else mantissa


def _ends(values: Array, room: float) -> tuple[float, float]:
    """The range of the finite values with a margin; its ends are never equal."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    span = high - low
    if span <= 1e-12 * max(abs(low), abs(high)):
        span = max(abs(high), 1.0)
        return low - 0.1 * span, high + 0.1 * span
    return low - room * span, high + room * span
