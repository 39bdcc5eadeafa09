"""Figures of energy: its flow through a machine as ribbons (after Sankey), and the activity of the components as bars.

M. H. P. R. Sankey, The thermal efficiency of steam-engines, Minutes of Proceedings of the ICE 134 (1898) 278-312.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch, Rectangle
from matplotlib.path import Path

from heavebond.core.presentation import number, readable
from heavebond.energy_audit.audit import BLOCK
from heavebond.energy_audit.power_flow import Box, BoxKey, EnergyFlow
from heavebond.language.library import domains
from heavebond.pictures.plot import COLOURS, DPI, WIDTH, figure_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from heavebond.energy_audit.audit import EnergyAudit, EnergyLine

OTHER = "#b0b0b0"
SUPPLY, HEAT, STORE, PASS, NODE = COLOURS[0], COLOURS[1], COLOURS[2], "#444444", "#9a9a9a"
BULGE = 0.35  # overhang of a ribbon that returns, in columns
MOST_BARS = 25  # number of components with a bar, for a page
SEEN = 1e-6  # smaller shares are rounding errors
THICK, GAP = 0.16, 0.35  # width of a box in columns; gap between boxes in a column, relative to the tallest column


def plot_energy_flow(flow: EnergyFlow, *, title: str = "") -> Figure:
    """Boxes from left to right, ribbons with the width of the transferred energy; the labels give the energy that stays
    in a box.
    """
    columns = 1 + max((box.column for box in flow.boxes.values()), default=0)
    rows = 1 + max((box.row for box in flow.boxes.values()), default=0)
    figure = Figure(figsize=(max(WIDTH, 1.9 * columns + 1.5), max(4.5, 0.75 * rows + 2)), dpi=DPI, layout="constrained")
    figure_title(figure, title)
    axes = figure.add_subplot()
    axes.set_axis_off()
    # the height of a box: the larger of the incoming and outgoing energy
    sizes = {name: max(sum(k.energy for k in flow.links if k.target == name),
                       sum(k.energy for k in flow.links if k.source == name)) for name in flow.boxes}
    tops = _tops(flow.boxes, sizes)
    outer, inner = dict(tops), dict(tops)
    low = min((tops[name] - sizes[name] for name in flow.boxes), default=0.0)
    high = max(tops.values(), default=1.0)
    for link in sorted(flow.links, key=lambda link: (link.back, -tops[link.target], -tops[link.source])):
        start, end = outer[link.source], inner[link.target]
        outer[link.source], inner[link.target] = start - link.energy, end - link.energy
        left, right = flow.boxes[link.source].column + THICK, float(flow.boxes[link.target].column)
        if link.back:
            low -= 0.06 * (high - low)
            # ribbon from (left, start) down to a lane below all boxes, backwards along it, and up to (right, end)
            thick, wide, narrow = link.energy, BULGE, 0.4 * BULGE
            outline = [(left, start), (left + wide, start), (left + wide, low - thick), (left, low - thick),
                       (right, low - thick), (right - wide, low - thick), (right - wide, end), (right, end),
                       (right, end - thick), (right - narrow, end - thick), (right - narrow, low), (right, low), (left, low),
                       (left + narrow, low), (left + narrow, start - thick), (left, start - thick), (left, start)]
            steps = [Path.MOVETO, *[Path.CURVE4] * 3, Path.LINETO, *[Path.CURVE4] * 3, Path.LINETO, *[Path.CURVE4] * 3,
                     Path.LINETO, *[Path.CURVE4] * 3, Path.CLOSEPOLY]
            axes.add_patch(PathPatch(Path(outline, steps), facecolor=_pale(link.domain), alpha=0.3, linewidth=0.8,
                                     edgecolor="#777777", linestyle="--", zorder=0))
            low -= link.energy
        else:
            # ribbon from (left, start) to (right, end), as high as its energy
            middle, height = (left + right) / 2, link.energy
            points = [(left, start), (middle, start), (middle, end), (right, end), (right, end - height),
                      (middle, end - height), (middle, start - height), (left, start - height), (left, start)]
            codes = [Path.MOVETO, *[Path.CURVE4] * 3, Path.LINETO, *[Path.CURVE4] * 3, Path.CLOSEPOLY]
            axes.add_patch(PathPatch(Path(points, codes), facecolor=_pale(link.domain), alpha=0.55, linewidth=0,
                                     zorder=1))
    for name, box in flow.boxes.items():
        _box(axes, box, tops[name], sizes[name])
    axes.set_xlim(-0.1 if not any(link.back for link in flow.links) else -BULGE, columns - 1 + THICK + 0.7)
    axes.set_ylim(low - 0.08 * (high - low), high + 0.1 * (high - low))
    colours = ((SUPPLY, "source"), (HEAT, "turns to heat"), (STORE, "stores"), (PASS, "passes on"))
    handles = [*(Patch(color=colour, label=name) for colour, name in colours),
               *(Patch(color=_pale(name), alpha=0.55, label=name) for name in dict.fromkeys(k.domain for k in flow.links))]
    figure.legend(handles=handles, loc="outside lower left", ncols=7, frameon=False, fontsize=9)
    return figure


def plot_activity(energy_audit: EnergyAudit, *, title: str = "") -> Figure:
    """Draw the most active components as bars: the share of each in the activity of all, and the cumulative share."""
    ranked = [(line, share) for line, share in energy_audit.ranking if share > SEEN][:MOST_BARS]
    figure = Figure(figsize=(0.8 * WIDTH, 1.6 + 0.3 * len(ranked)), dpi=DPI, layout="constrained")
    figure_title(figure, title)
    axes = figure.add_subplot()
    places, total = np.arange(len(ranked)), 0.0
    for place, (line, share) in zip(places, ranked, strict=True):
        total += share
        axes.barh(place, 100 * share, color=_main_colour(line), height=0.7)
        axes.annotate(f"{number(100 * share, 3)} %   (together {number(100 * total, 4)} %)", (100 * share, place), (5, 0),
                      textcoords="offset points", va="center", fontsize=8)
    axes.set_yticks(places, [line.component for line, _ in ranked])
    axes.invert_yaxis()
    axes.set_xlim(0, 130 * max((share for _, share in ranked), default=0.01))
    axes.set_xlabel("share of the activity [%]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="x", color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    figure.legend(handles=[Patch(color=SUPPLY, label="supplies"), Patch(color=HEAT, label="dissipates"),
                           Patch(color=STORE, label="stores")], loc="outside upper right", ncols=3, frameon=False)
    return figure


def _main_colour(line: EnergyLine) -> str:
    """Colour of the main role of a component; a block is a source if it supplies more energy than it dissipates."""
    if line.supplied > line.dissipated if line.kind == BLOCK else line.kind:
        return SUPPLY
    return HEAT if line.dissipated > abs(line.stored) + line.delivered else STORE


def _tops(boxes: Mapping[BoxKey, Box], sizes: Mapping[BoxKey, float]) -> dict[BoxKey, float]:
    """The upper edge of each box: its column stacked with gaps and centred."""
    columns: dict[int, list[Box]] = {}
    for box in boxes.values():
        columns.setdefault(box.column, []).append(box)
    tallest = max((sum(sizes[b.key] for b in column) for column in columns.values()), default=1.0)
    gap = GAP * tallest / max(2.0, max((len(c) for c in columns.values()), default=1) / 2)
    tops = {}
    for column in columns.values():
        height = sum(sizes[b.key] for b in column) + gap * (len(column) - 1)
        top = height / 2
        for box in sorted(column, key=lambda b: -b.row):
            tops[box.key] = top
            top -= sizes[box.key] + gap
    return tops


def _pale(domain: str) -> str:
    """The colour of areas of a domain."""
    domain_found = domains().get(domain)
    return domain_found.pale or OTHER if domain_found is not None else OTHER


def _box(axes: Axes, box: Box, top: float, size: float) -> None:
    largest = max((abs(box.supplied), SUPPLY), (box.dissipated, HEAT), (abs(box.stored), STORE), key=lambda item: item[0])
    text_colour = NODE if box.key.node else largest[1] if largest[0] > 0.02 * size else PASS
    axes.add_patch(Rectangle((box.column, top - size), THICK, size, facecolor=text_colour, linewidth=0.5,
                             edgecolor=text_colour, zorder=3))
    texts = [] if box.key.node else [text for value, text in (
        (box.supplied, f"gives {readable(box.supplied, 'J', 3)}" if box.supplied > 0 else
         f"takes {readable(-box.supplied, 'J', 3)}"),
        (box.dissipated, f"heat {readable(box.dissipated, 'J', 3)}"),
        (box.stored, f"stores {readable(box.stored, 'J', 3)}" if box.stored > 0 else
         f"gives up {readable(-box.stored, 'J', 3)}")) if abs(value) > 0.02 * size]
    box_title, text_colour = (f"node {box.key.path}", "#666666") if box.key.node else (box.key.path, "black")
    axes.annotate("\n".join([box_title, *texts]), (box.column + THICK, top - size / 2), (4, 0), textcoords="offset points",
                  fontsize=8, va="center", color=text_colour, zorder=4, bbox={"boxstyle": "round,pad=0.15",
                                                                              "facecolor": "white", "alpha": 0.75,
                                                                              "linewidth": 0})
