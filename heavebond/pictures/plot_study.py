"""Pictures of studies, laid out for print: signals of several cases over time, and measured numbers over an axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from heavebond.core.presentation import converted, readable_unit, unit_label
from heavebond.pictures.plot import COLOURS, DASHES, DPI, WIDE
from heavebond.pictures.plot_sample import PANEL, SMALL, WIDTH, headed, histograms, maps, quiet, shares, tornados
from heavebond.studies.study import Picture
from heavebond.studies.uncertainty import INDEPENDENT, interval_of_mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from heavebond.studies.campaign import StudyResult
    from heavebond.studies.run_case import Outcome

MARKERS = ("o", "s", "^", "D", "v", "P")
MOST_LABELS = 10  # lines that a legend names; more are coloured by a numeric axis


def plot_study(result: StudyResult, picture: Picture) -> Figure:
    """The picture of a study; signals and curves share their axis, one panel each."""
    from matplotlib import rc_context

    drawing = {"map": maps, "histogram": histograms, "tornado": tornados, "indices": shares}.get(picture.kind)
    with rc_context(SMALL):
        if drawing is not None:
            return drawing(result, picture)
        names = picture.names
        figure = Figure(figsize=(WIDTH, 0.9 + PANEL * len(names)), dpi=2 * DPI, layout="constrained")
        panels: list[Axes] = list(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0])
        for panel, name in zip(panels, names, strict=True):
            (_courses if picture.kind == "signals" else _curves)(panel, result, picture, name)
            panel.label_outer()
            quiet(panel)
            if panel.get_yscale() == "linear":
                panel.ticklabel_format(axis="y", useOffset=False)
        headed(figure, picture)
        # below all panels, with a readable number of lines
        handles, labels = panels[0].get_legend_handles_labels()
        if len(labels) > MOST_LABELS:
            more = f"and {len(labels) - MOST_LABELS} more"
            handles, labels = [*handles[:MOST_LABELS], Line2D([], [], linestyle="none")], [*labels[:MOST_LABELS], more]
        if len(labels) > 1:
            longest = max(map(len, labels))
            variants = [axis.name for axis in result.study.axes if axis.unit is None and axis.sampling is None]
            figure.legend(handles, labels, loc="outside lower center", ncols=max(1, min(len(labels), 95 // (longest + 8))),
                          frameon=False, title=", ".join(variants) or None, title_fontsize="medium")
        figure.align_ylabels(panels)
        return figure


def _shades(result: StudyResult, lines: int, without: int = -1) -> tuple[int, ScalarMappable] | None:
    """The index of the numeric axis by which lines are coloured, and its colours; None if a legend can name all lines."""
    for k, axis in enumerate(result.study.axes):
        if lines > MOST_LABELS and axis.unit is not None and k != without:
            values = [axis.unit.from_si(level.value) for level in axis.levels]
            return k, ScalarMappable(Normalize(min(values), max(values)), "viridis")
    return None


def _shade(result: StudyResult, shades: tuple[int, ScalarMappable], outcome: Outcome) -> Any:
    """The colour of a case."""
    k, colours = shades
    unit = result.study.axes[k].unit
    assert unit is not None
    return colours.to_rgba(np.array(unit.from_si(result.case_of(outcome).levels[k].value)))


def _colour_bar(panel: Axes, result: StudyResult, shades: tuple[int, ScalarMappable]) -> None:
    axis = result.study.axes[shades[0]]
    assert axis.unit is not None
    panel.figure.colorbar(shades[1], ax=panel, label=f"{axis.name} [{unit_label(axis.unit.text)}]")


def _labelled(result: StudyResult, outcome: Outcome, without: int = -1) -> str:
    """The levels of a case, except for one axis, and the procedure if there are several."""
    procedure = [outcome.procedure] if len(result.study.procedures) > 1 else []
    return ", ".join([*_levels(result, outcome, without), *procedure]) or result.study.model.name


def _levels(result: StudyResult, outcome: Outcome, without: int = -1) -> list[str]:
    """The labels of the levels of a case, except for the axis `without`; a number follows the name of its axis."""
    return [level.name if axis.unit is None else f"{axis.name} {level.name}" for k, (axis, level) in
            enumerate(zip(result.study.axes, result.case_of(outcome).levels, strict=True)) if k != without]


def _courses(panel: Axes, result: StudyResult, picture: Picture, name: str) -> None:
    """Draw a signal over time with one line for each case; the points of a sample are thin lines of the same colour."""
    drawn = [o for o in result.outcomes if o.signals]
    sample = result.study.sample
    at = result.study.axes.index(sample) if sample is not None else -1
    labels = list(dict.fromkeys(_labelled(result, o, at) for o in drawn))
    unit = drawn[0].signal_units[name] if drawn else "1"
    display_unit = readable_unit(unit, max((float(np.abs(o.signals[name]).max()) for o in drawn), default=0.0))
    labelled: set[str] = set()
    shades = _shades(result, len(labels), at)
    for outcome in drawn:
        label = _labelled(result, outcome, at)
        k = labels.index(label)
        colour = _shade(result, shades, outcome) if shades else COLOURS[k % len(COLOURS)]
        time, values = np.array(outcome.time), converted(np.array(outcome.signals[name]), unit, display_unit)
        inside = (time >= (picture.begin or 0.0)) & (time <= (picture.end or math.inf))
        panel.plot(time[inside], values[inside], color=colour, linewidth=1.0 if sample is None and not shades else 0.4,
                   linestyle=DASHES[k % len(DASHES)] if sample is None and not shades else "-",
                   label=None if label in labelled or shades else label)
        labelled.add(label)
    if shades:
        _colour_bar(panel, result, shades)
    panel.set_ylabel(f"{name} [{unit_label(display_unit)}]")
    panel.margins(x=0)
    panel.set_xlabel("time [s]")


def _curves(panel: Axes, result: StudyResult, picture: Picture, name: str) -> None:
    """A number over the first numeric axis: a colour per combination of the others, a line style per procedure, open
    marks in the same colour for published values."""
    k = next(k for k, axis in enumerate(result.study.axes) if axis.unit is not None)
    axis, sample = result.study.axes[k], result.study.sample
    assert axis.unit is not None
    if sample is not None and sample.sampling is not None and sample.sampling.kind in INDEPENDENT:
        # the mean of a number over the realisations along axis k, with the 95 % interval of the mean as a bar
        at = result.study.axes.index(sample)
        numbers: dict[str, dict[float, list[float]]] = {}  # by the other levels and x
        for outcome in result.outcomes:
            levels = result.case_of(outcome).levels
            label = ", ".join(level.name if further_axis.unit is None else f"{further_axis.name} {level.name}"
                              for n, (further_axis, level) in enumerate(zip(result.study.axes, levels, strict=True))
                              if n not in (k, at))
            by_x = numbers.setdefault(label, {})
            by_x.setdefault(axis.unit.from_si(levels[k].value), []).append(result.value(outcome, name))
        for n, (label, by_x) in enumerate(numbers.items()):
            finite = {at_x: np.array([y for y in values if np.isfinite(y)]) for at_x, values in by_x.items()}
            known = {at_x: values for at_x, values in finite.items() if len(values)}
            means = np.array([values.mean() for values in known.values()])
            bars = np.nan_to_num([interval_of_mean(values)[1] for values in known.values()] - means)
            panel.errorbar(list(known), means, bars, color=COLOURS[n % len(COLOURS)], marker=MARKERS[0], markersize=4,
                           linewidth=1.0, capsize=2, linestyle=DASHES[n % len(DASHES)], label=label or name)
        panel.set_ylabel(f"{name} [{unit_label(result.units[name].text)}]")
        panel.set_xlabel(f"{axis.name} [{unit_label(axis.unit.text)}]")
        return
    procedures = list(dict.fromkeys(o.procedure for o in result.outcomes))
    lines = list(_lines(result, k))
    shades = _shades(result, len(lines) * len(procedures), k)
    for n, (label, outcomes) in enumerate(lines):
        colour = _shade(result, shades, outcomes[0]) if shades else COLOURS[n % len(COLOURS)]
        for m, procedure in enumerate(procedures):
            chosen = [o for o in outcomes if o.procedure == procedure]
            x = [axis.unit.from_si(result.case_of(o).levels[k].value) for o in chosen]
            words = ", ".join(filter(None, (label, procedure if len(procedures) > 1 else "")))
            dash = DASHES[(m if len(procedures) > 1 else n) % len(DASHES)]
            panel.plot(x, [result.value(o, name) for o in chosen], color=colour, marker=MARKERS[m % len(MARKERS)],
                       markersize=4, linewidth=1.0, linestyle="-" if shades else dash,
                       label=None if shades else words or name)
        _published(panel, result, name, label, colour, [o for o in outcomes if o.procedure == procedures[0]], k)
    if shades:
        _colour_bar(panel, result, shades)
    sizes = [y for line in panel.get_lines() for y in np.asarray(line.get_ydata(), float) if np.isfinite(y)]
    if sizes and 0 < WIDE * min(sizes) < max(sizes):  # one extreme case must not flatten all others
        panel.set_yscale("log")
    panel.set_ylabel(f"{name} [{unit_label(result.units[name].text)}]")
    panel.set_xlabel(f"{axis.name} [{unit_label(axis.unit.text)}]")


def _lines(result: StudyResult, without: int) -> Iterator[tuple[str, Sequence[Outcome]]]:
    """Outcomes that differ along one axis (and by procedure), with the levels of the other axes in words."""
    lines: dict[str, list[Outcome]] = {}
    for outcome in result.outcomes:
        lines.setdefault(", ".join(_levels(result, outcome, without)), []).append(outcome)
    yield from lines.items()


def _published(panel: Axes, result: StudyResult, name: str, label: str, colour: str, outcomes: Sequence[Outcome], k: int
               ) -> None:
    """Published values for these cases."""
    unit = result.study.axes[k].unit
    assert unit is not None
    for source, beside in enumerate(result.study.beside):
        y = [result.published(o, name, source) for o in outcomes]
        if np.isfinite(y).any():
            x = [unit.from_si(result.case_of(o).levels[k].value) for o in outcomes]
            panel.plot(x, y, linestyle="none", marker=MARKERS[(3 + source) % len(MARKERS)], markersize=8, color=colour,
                       markerfacecolor="none", label=", ".join(filter(None, (label, beside.source))))
