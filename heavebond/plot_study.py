"""Pictures of studies, laid out for print: signals of several cases over time, and measured numbers over an axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from heavebond.plot import COLOURS, DASHES, DPI
from heavebond.presentation import unit_label
from heavebond.study import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from heavebond.campaign import StudyResult
    from heavebond.casework import Outcome

WIDTH = 6.7  # inches: the text of an A4 page
PANEL = 2.3
SMALL: Any = {"font.size": 8, "axes.titlesize": 9, "legend.fontsize": 8, "axes.labelsize": 8}
MARKERS = ("o", "s", "^", "D", "v", "P")


def plot_study(result: StudyResult, picture: Picture) -> Figure:
    """The picture of a study; signals and curves share their axis, one panel each."""
    from matplotlib import rc_context

    with rc_context(SMALL):
        names = picture.signals or picture.curves
        figure = Figure(figsize=(WIDTH, 0.9 + PANEL * len(names)), dpi=2 * DPI, layout="constrained")
        panels: list[Axes] = list(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0])
        for panel, name in zip(panels, names, strict=True):
            (_courses if picture.signals else _curves)(panel, result, picture, name)
            panel.grid(True, color="#e4e4e4", linewidth=0.5)
            panel.spines[["top", "right"]].set_visible(False)
            panel.set_axisbelow(True)
            panel.ticklabel_format(axis="y", useOffset=False)
        if picture.title:
            figure.suptitle(picture.title, x=0.01, ha="left", fontsize=9)
        handles, labels = panels[0].get_legend_handles_labels()
        if len(labels) > 1:
            longest = max(map(len, labels))
            figure.legend(handles, labels, loc="outside lower center", ncols=max(1, min(len(labels), 95 // (longest + 8))),
                          frameon=False)
        figure.align_ylabels(panels)
        return figure


def _labelled(result: StudyResult, outcome: Outcome, without: int = -1) -> str:
    """The levels of a case, and the procedure where there are several; `without` leaves one axis out."""
    levels = [level.name if axis.unit is None else f"{axis.name} {level.name}" for k, (axis, level) in
              enumerate(zip(result.study.axes, result.case_of(outcome).levels, strict=True)) if k != without]
    return ", ".join([*levels, *([outcome.procedure] if len(result.study.procedures) > 1 else [])])


def _courses(panel: Axes, result: StudyResult, picture: Picture, name: str) -> None:
    """A signal over time, a line per case."""
    shown = result.study.model.show.get(name)
    for k, outcome in enumerate(o for o in result.outcomes if o.signals):
        time = np.array(outcome.time)
        inside = (time >= (picture.begin or 0.0)) & (time <= (picture.end or math.inf))
        panel.plot(time[inside], np.array(outcome.signals[name])[inside], color=COLOURS[k % len(COLOURS)], linewidth=1.0,
                   linestyle=DASHES[k % len(DASHES)], label=_labelled(result, outcome))
    panel.set_ylabel(f"{name} [{unit_label(shown.unit)}]" if shown is not None else name)
    panel.margins(x=0)
    if panel.get_subplotspec() is not None and panel.get_subplotspec().is_last_row():  # type: ignore[union-attr]
        panel.set_xlabel("time [s]")


def _curves(panel: Axes, result: StudyResult, picture: Picture, name: str) -> None:
    """A number over the first axis that has numbers: a line per other combination, what others give as open marks."""
    k = next(k for k, axis in enumerate(result.study.axes) if axis.unit is not None)
    axis = result.study.axes[k]
    assert axis.unit is not None
    for n, (label, outcomes) in enumerate(_lines(result, k)):
        x = [axis.unit.from_si(result.case_of(o).levels[k].value) for o in outcomes]
        colour = COLOURS[n % len(COLOURS)]
        panel.plot(x, [result.value(o, name) for o in outcomes], color=colour, marker=MARKERS[n % len(MARKERS)],
                   markersize=4, linewidth=1.0, linestyle=DASHES[n % len(DASHES)], label=label or name)
    _given(panel, result, name, k)
    panel.set_ylabel(f"{name} [{unit_label(result.units[name].text)}]")
    panel.set_xlabel(f"{axis.name} [{unit_label(axis.unit.text)}]")


def _lines(result: StudyResult, without: int) -> Iterator[tuple[str, Sequence[Outcome]]]:
    lines: dict[str, list[Outcome]] = {}
    for outcome in result.outcomes:
        lines.setdefault(_labelled(result, outcome, without), []).append(outcome)
    yield from lines.items()


def _given(panel: Axes, result: StudyResult, name: str, k: int) -> None:
    """What others give: once per case, whatever the procedures."""
    axis = result.study.axes[k]
    assert axis.unit is not None
    for source, beside in enumerate(result.study.beside):
        first: dict[str, list[Outcome]] = {}
        for outcome in result.outcomes:
            if outcome.procedure == result.outcomes[0].procedure:
                levels = result.case_of(outcome).levels
                first.setdefault(", ".join(lv.name for j, lv in enumerate(levels) if j != k), []).append(outcome)
        for n, (label, outcomes) in enumerate(first.items()):
            y = [result.published(o, name, source) for o in outcomes]
            if np.isfinite(y).any():
                x = [axis.unit.from_si(result.case_of(o).levels[k].value) for o in outcomes]
                panel.plot(x, y, linestyle="none", marker=MARKERS[n % len(MARKERS)], markersize=7, markerfacecolor="none",
                           markeredgecolor="#555555", label=f"{beside.source}, {label}" if label else beside.source)
