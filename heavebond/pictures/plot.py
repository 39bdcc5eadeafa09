"""Figures of runs and of comparisons with records, drawn without pyplot so that nothing global is touched."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullLocator

from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.presentation import converted, difference_unit, number, quantity, readable_unit, unit_label, written
from heavebond.core.units import read_unit
from heavebond.core.writable import new_file
from heavebond.records.saved_runs import MARK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from heavebond.diagnosis.state import LadderEntry
    from heavebond.estimation.comparison import Channel, Comparison
    from heavebond.numerics.dae import Array
    from heavebond.numerics.result import Result
    from heavebond.optimise.influence import Influence, Ranking, Rankings
    from heavebond.optimise.objective import TuningProblem
    from heavebond.optimise.robustness import Ellipse
    from heavebond.optimise.tuning import Tuned
    from heavebond.records.saved_runs import SavedRun

SUFFIXES = (".png", ".svg", ".pdf")
DPI = 100
WIDTH = 12.0  # inches
TITLE_LINE = 125  # characters in the width
RECT = (0.0, 0.004, 0.99, 0.99)  # margin for the title and the last tick label
DENSE = 500  # number of samples from which on a record is drawn as a line, since its dots would merge
# Okabe and Ito, Color universal design, 2008: distinguishable for every kind of colour vision; their yellow is too pale here
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (5, 1.5, 1, 1.5)))
RECORD, MODEL, BAND = "#8c8c8c", COLOURS[1], "#bcd9ea"
WIDE = 30  # ratio of the largest to the least error from which on the axis is logarithmic
MISSED = 0.005  # share of its range by which a curve may miss an extreme: half a line width in a usual figure
STILL = 1e-9  # a span below this is rounding, not motion
BAND_WIDTH = 2  # the band holds 95 % of white noise


class NotebookFigure(Figure):
    """A figure that a notebook shows as PNG, independent of pyplot and its display settings."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


def drawn_run(result: Result, names: Sequence[str]) -> Result:
    """The run, or its dense run if its output points visibly miss an extreme of a signal."""
    values, dense = result.signals(names), result.dense.signals(names)
    missed = any(np.ptp(dense[name]) > (1 + MISSED) * np.ptp(values[name]) for name in names)
    return result.dense if missed else result


def plot_signals(result: Result, names: Iterable[str], *, title: str = "") -> Figure:
    """Signals of a run over time: one axes per unit, the time axes linked.

    A named output is drawn in its unit, any other variable in a prefix that suits its size. Raises UsageError for an
    unknown name or without names.
    """
    chosen = list(dict.fromkeys(names))
    if not chosen:
        raise UsageError([Problem("nothing-to-plot", "no signal is named that could be drawn", None,
                                  "Name one with --plot, or outputs under `show:` in the diagram.")])
    result = drawn_run(result, chosen)
    values = result.signals(chosen)
    groups: dict[str, list[str]] = {}
    for name in chosen:
        groups.setdefault(result.unit(name), []).append(name)
    sizes = {unit: max(_size(values[name]) for name in group) for unit, group in groups.items()}
    panels: dict[str, list[tuple[str, Array]]] = {}
    for unit, group in groups.items():
        display_unit = readable_unit(unit, sizes[unit])
        panels.setdefault(display_unit, []).extend((name, converted(values[name], unit, display_unit)) for name in group)
    model = result.assembly.model
    heading = f"{model.name}: {model.summary}" if model.summary else model.name
    figure, axes = stack_of_axes(len(panels), title or heading)
    without_law = result.without_law(chosen)
    for panel, (unit, lines) in zip(axes, panels.items(), strict=True):
        for k, (name, line) in enumerate(lines):
            panel.plot(result.time, line, color=COLOURS[k % len(COLOURS)], linewidth=1.3,
                       label=f"{name}{MARK}" if name in without_law else name,
                       linestyle=DASHES[(k // len(COLOURS)) % len(DASHES)])
        _finish(panel, quantity(unit), unit, [line for _, line in lines])
        # A legend above the axes in as many columns as fit
        handles, labels = panel.get_legend_handles_labels()
        longest = max(map(len, labels))
        panel.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, fontsize=9,
                     borderaxespad=0.1, ncols=max(1, min(len(labels), 130 // (longest + 7))))
    axes[-1].set_xlabel("time [s]")
    axes[0].set_xlim(*_ends(result.time))
    return figure


def plot_runs(runs: Mapping[str, SavedRun], names: Iterable[str], *, title: str = "",
              window: tuple[float, float] | None = None, shaded: tuple[float, float] | None = None,
              measured: Collection[str] = ()) -> Figure:
    """The same signals of several runs and records: one axes per signal, one line per run that contains it. `window` is
    the range of time to draw, `shaded` a range to mark (begin, end in s). Names in `measured` are records, drawn as
    grey dots behind the others. Raises UsageError for a signal that no run contains, or with units of different kinds.
    """
    chosen = list(dict.fromkeys(names))
    holders = {}
    for name in chosen:
        # the runs that hold a signal, in units of one kind
        runs_with_signal = [(label, run) for label, run in runs.items() if name in run.values]
        if not runs_with_signal:
            known = list(dict.fromkeys(known for run in runs.values() for known in run.names()))
            raise UsageError([Problem("name-unknown", f"none of the files holds '{name}'", None,
                                      suggest(name, known) or f"They hold: {listing(known)}.")])
        kinds = {read_unit(run.unit(name)).dimension: label for label, run in runs_with_signal}
        if len(kinds) > 1:
            unit_list = " and ".join(f"[{run.unit(name)}] in {label}" for label, run in runs_with_signal
                                     if label in kinds.values())
            raise UsageError([Problem("unit-kind", f"'{name}' is not the same quantity in all files: {unit_list}", None,
                                      "Draw them one after the other, or name another signal.")])
        holders[name] = runs_with_signal
    figure, axes = stack_of_axes(len(chosen), title)
    ends = [_ends(run.time) for run in runs.values()]
    begin, end = window or (min(first for first, _ in ends), max(last for _, last in ends))
    inside = {label: (run.time >= begin) & (run.time <= end) for label, run in runs.items()}
    models = [label for label in runs if label not in measured]
    for panel, name in zip(axes, chosen, strict=True):
        unit = holders[name][0][1].unit(name)
        series_by_label = {label: converted(run.display[name][inside[label]], run.unit(name), unit)
                           for label, run in holders[name]}
        display_unit = readable_unit(unit, max(map(_size, series_by_label.values())))
        drawn = {label: converted(line, unit, display_unit) for label, line in series_by_label.items()}
        for label, line in drawn.items():
            time = runs[label].time[inside[label]]
            if label in measured:
                panel.plot(time, line, color=RECORD, label=label, zorder=1, **_style(len(time) > DENSE, 2.4))
            else:
                k = models.index(label)
                panel.plot(time, line, color=COLOURS[k % len(COLOURS)], linewidth=1.2, label=label,
                           linestyle=DASHES[k // len(COLOURS) % len(DASHES)])
        _finish(panel, name, display_unit, list(drawn.values()))
        if shaded:
            panel.axvspan(*shaded, color="#e9e9e9", zorder=0, linewidth=0, label="evaluated")
    axes[-1].set_xlabel("time [s]")
    axes[0].set_xlim(begin, end)
    entries = {label: handle for panel in axes for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    ordered = [label for label in (*runs, "evaluated") if label in entries]
    figure.legend([entries[label] for label in ordered], ordered, loc="outside upper right",
                  ncols=min(len(ordered), max(1, 110 // (max(map(len, ordered)) + 6))), frameon=False)
    return figure


def plot_comparison(comparison: Comparison) -> Figure:
    """Records (grey dots) and model (line): a column per record, a row per channel, below each the residual with a band
    of twice the noise on either side."""
    records = list(comparison.records.values())
    channels = list(records[0].channels)
    n = len(channels)
    figure = NotebookFigure(figsize=(max(WIDTH, 1.0 + 5.5 * len(records)), max(6.0, 0.8 + 2.4 * n)), dpi=DPI,
                            layout=ConstrainedLayoutEngine(h_pad=0.02, hspace=0.0, w_pad=0.06, rect=RECT))
    grid = figure.add_gridspec(2 * n, len(records), height_ratios=[3, 1.2] * n)
    for k, record in enumerate(records):
        column: list[Axes] = []
        for row, name in enumerate(channels):
            upper = figure.add_subplot(grid[2 * row, k], sharex=column[0] if column else None)
            lower = figure.add_subplot(grid[2 * row + 1, k], sharex=upper)
            _channel(upper, lower, record.channels[name])
            if record.validate is not None:
                # shade the held-out parts of the fit in grey
                time = record.channels[name].time
                ends = np.flatnonzero(np.diff(record.validate.channels[name].counts.astype(int), prepend=0,
                                              append=0)).reshape(-1, 2)
                for part, (first, last) in enumerate(ends):
                    for panel in (upper, lower):
                        panel.axvspan(time[first], time[last - 1], color="#ededed", zorder=0, linewidth=0,
                                      label="held out of the fit" if part == 0 and panel is upper else None)
            column += [upper, lower]
        # the empty line keeps it above the numbers of its first channel, which are on the right
        held_out = f", held out {100 * record.validate.normalised:.3g} %" if record.validate is not None else ""
        column[0].set_title(f"{record.name} ({record.use}): normalised error {100 * record.normalised:.3g} %{held_out}"
                            + "\n", loc="left", fontsize=11, fontweight="bold")
        for axes in column[:-1]:
            axes.tick_params(labelbottom=False)
        column[-1].set_xlabel("time [s]")
        column[0].set_xlim(*_ends(next(iter(record.channels.values())).time))
    handles, labels = figure.axes[0].get_legend_handles_labels()
    more, words = figure.axes[1].get_legend_handles_labels()
    figure.legend(handles + more, labels + words, loc="outside upper right", ncols=6, frameon=False)
    figure_title(figure, comparison.experiment.name)
    figure.align_ylabels()
    return figure


def plot_surface(task: TuningProblem, tuned: Tuned, axes: Sequence[Array], costs: Array,
                 ellipse: Ellipse | None = None) -> Figure:
    """The cost over two free parameters from a sweep, with the paths of the search, the best point, and the region in which
    the cost rises by less than 1 %.

      The colours are logarithmic if the costs span more than a factor of ten, as they do beyond the stability boundary.
    """
    from matplotlib.colors import LogNorm

    (first, second), units = list(task.free), [wanted.unit for wanted in task.free.values()]
    figure = NotebookFigure(figsize=(9.0, 6.5), dpi=DPI, layout="constrained")
    panel = figure.add_subplot()
    x, y = ((axis - unit.offset) / unit.scale for unit, axis in zip(units, axes, strict=True))
    finite = costs[np.isfinite(costs)]
    wide = finite.min() > 0 and finite.max() > 10 * finite.min()
    mesh = panel.pcolormesh(x, y, costs.T, shading="nearest", cmap="cividis", norm=LogNorm() if wide else None)
    figure.colorbar(mesh, ax=panel, label="cost")
    for k, path in enumerate(tuned.paths):
        points = np.array([[unit.from_si(step.values[name]) for name, unit in zip(task.free, units, strict=True)]
                           for step in path])
        panel.plot(points[:, 0], points[:, 1], "o-", color="white", markersize=4, linewidth=1, markeredgecolor="black",
                   label="search" if k == 0 else None)
    best = [unit.from_si(tuned.values[name]) for name, unit in zip(task.free, units, strict=True)]
    if ellipse is not None:
        turn = np.linspace(0, 2 * np.pi, 100)
        around = ellipse.axes @ np.array([np.cos(turn), np.sin(turn)]) / np.array([[unit.scale] for unit in units])
        panel.plot(best[0] + around[0], best[1] + around[1], color=COLOURS[1], linewidth=1.5, label="1 % more")
    panel.plot(*best, "*", color=COLOURS[1], markersize=16, markeredgecolor="black", label=f"best, {tuned.cost:.4g}")
    for name, unit, label in ((first, units[0], panel.set_xlabel), (second, units[1], panel.set_ylabel)):
        label(f"{name} [{unit_label(unit.text)}]")
    panel.set_xlim(x[0], x[-1])
    panel.set_ylim(y[0], y[-1])
    figure.legend(loc="outside upper right", ncols=3, frameon=False)
    return figure


def plot_influence(rankings: Rankings, *, bars: int = 12, courses: int = 4, title: str = "") -> Figure:
    """A row per signal: the strongest parameters as horizontal bars with their values, and at their right, over time, the
    change of the signal for 1 % more of each of the first `courses` (0: none)."""
    rows = rankings.rankings
    longest = max(min(len(row.influences), bars) for row in rows)
    height = 1.0 + len(rows) * max(3.0, 0.9 + 0.24 * longest)
    figure = NotebookFigure(figsize=(WIDTH if courses else 0.7 * WIDTH, height), dpi=DPI,
                            layout=ConstrainedLayoutEngine(rect=RECT, hspace=0.04))
    figure_title(figure, title)
    panels = figure.subplots(len(rows), 2 if courses else 1, squeeze=False, width_ratios=(1, 1.15) if courses else None)
    for row, (panel, *lower_panels) in zip(rows, panels, strict=True):
        # bars from the strongest down; logarithmic if the weakest would be invisible otherwise
        influences = [i for i in row.influences if i.relative > 0][:bars] or row.influences[:bars]
        values = np.array([i.relative for i in influences])
        places = np.arange(len(values))
        panel.barh(places, values, color=[COLOURS[0 if i.peak >= 0 else 1] for i in influences], height=0.7)
        panel.set_yticks(places, [f"{i.parameter} = {written(i.value, i.unit.text, 4)}" for i in influences], fontsize=9)
        panel.invert_yaxis()
        most = float(values.max(initial=0.0))
        least = float(values[values > 0].min(initial=most))
        if most > WIDE * least > 0:
            panel.set_xscale("log")
            panel.set_xlim(max(least / 2, 1e-6 * most), 3 * most)
        else:
            panel.set_xlim(0, 1.18 * most if most > 0 else 1.0)
        for place, value in zip(places, values, strict=True):
            panel.annotate(number(value, 3), (max(value, panel.get_xlim()[0]), place), (4, 0), textcoords="offset points",
                           va="center", fontsize=8)
        size = f"rms {written(row.size, row.unit, 3)} " + ("(it stands still)" if row.still else "about its mean")
        panel.set_title(f"{row.signal}: {size}", loc="left", fontsize=10, fontweight="bold")
        panel.grid(True, axis="x", color="#e4e4e4", linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_axisbelow(True)
        for lower_panel in lower_panels:
            _courses(lower_panel, row, rankings.time, row.influences[:courses])
    panels[-1][0].set_xlabel("influence: rms(p ∂s/∂p) / rms(s − mean)")
    if courses:
        panels[-1][1].set_xlabel("time [s]")
    marks = [Patch(color=COLOURS[0], label="largest change: increase of the signal"),
             Patch(color=COLOURS[1], label="decrease of the signal")]
    figure.legend(handles=marks, loc="outside upper right", ncols=2, frameon=False, fontsize=9)
    return figure


def plot_ladder(rungs: Sequence[LadderEntry]) -> Figure:
    """Error of successive models: root mean square relative to the measured values, on fitted and held-out samples, each
    with the error that noise alone would cause (the last model's error divided by the root of chi-square per sample)."""
    figure = NotebookFigure(figsize=(WIDTH, 2.2 + 0.62 * len(rungs)), dpi=DPI)
    axes = figure.add_subplot()
    figure_title(figure, "The error of the models")
    places, last = np.arange(len(rungs))[::-1], rungs[-1]
    drawn: list[float] = []
    for offset, colour, mark, label, errors, chi2 in (
            (0.15, COLOURS[0], "o", "fitted", [r.error_fit for r in rungs], last.chi2_fit),
            (-0.15, COLOURS[1], "s", "held out", [r.error_held_out for r in rungs], last.chi2_held_out)):
        values = 100 * np.array(errors)
        if not np.isfinite(values).any():
            continue
        axes.plot(values, places + offset, color=colour, marker=mark, linewidth=1.0, label=label)
        for place, value in zip(places + offset, values, strict=True):
            axes.annotate(f"{number(float(value), 3)} %", (value, place), (8, 0), textcoords="offset points", va="center",
                          fontsize=9, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})
        noise = float(values[-1]) / math.sqrt(chi2) if chi2 > 0 else math.nan
        axes.axvline(noise, color=colour, linestyle=DASHES[1], linewidth=1.0, label=f"noise alone, {label}")
        drawn += [v for v in (*values, noise) if np.isfinite(v) and v > 0]
    # axis of shares in %, logarithmic if they differ widely
    least = min(drawn, default=1.0)
    most = max(drawn, default=1.0)
    axes.set_xlabel("error, in % of the measured signal")
    if most <= WIDE * least:
        axes.set_xlim(0, 1.25 * most)
    else:
        axes.set_xscale("log")
        axes.set_xlim(least / 1.5, 3 * most)
        decades = math.log10(most / least)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 4 else (1,)))
        axes.xaxis.set_major_formatter(lambda value, _: number(value, 3))
        axes.xaxis.set_minor_locator(NullLocator())
    axes.set_yticks(places, ["\n".join(textwrap.wrap(r.name, 34)) for r in rungs])
    axes.set_ylim(-0.5, len(rungs) - 0.5)
    axes.grid(axis="x", alpha=0.3)
    axes.legend(loc="lower right", frameon=True)
    figure.tight_layout(rect=RECT)
    return figure


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as .png, .svg or .pdf, the same bytes for the same figure; UsageError if that is impossible."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError([Problem("picture-suffix", f"'{path.name}' has no suffix of a picture", None,
                                  f"Write {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}.")])
    dated = {".png": None, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}[path.suffix.lower()]
    try:
        with rc_context({"svg.hashsalt": "heavebond", "svg.fonttype": "path"}), new_file(path) as fresh:
            figure.savefig(fresh, metadata=dated)
    except OSError as error:
        raise UsageError([Problem("file-unwritable", f"'{path}' cannot be written: {error.strerror or error}")]) \
            from None
    return path


# -- axes ----------------------------------------------------------------------------------------------------------
def stack_of_axes(n: int, title: str) -> tuple[Figure, list[Axes]]:
    """n axes above each other that share their time axis."""
    figure = NotebookFigure(figsize=(WIDTH, max(8.0 if n > 2 else 5.5, 0.9 + 1.75 * n)), dpi=DPI,
                            layout=ConstrainedLayoutEngine(rect=RECT))
    figure_title(figure, title)
    column: list[Axes] = list(figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0])
    figure.align_ylabels(column)
    return figure, column


def figure_title(figure: Figure, title: str) -> None:
    """A title over the whole figure, to the left."""
    if title:
        figure.suptitle(textwrap.fill(title, TITLE_LINE), x=0.01, ha="left", fontsize=12)


def _ends(time: Array) -> tuple[float, float]:
    return float(time[0]), float(time[-1]) if time[-1] > time[0] else float(time[0]) + 1.0


def _finish(axes: Axes, name: str, unit: str, lines: Sequence[Array]) -> None:
    """Label with quantity and unit, a pale grid, limits that do not magnify rounding errors."""
    label = unit_label(unit)
    axes.set_ylabel(f"{name} [{label}]" if name else f"dimensionless [{label}]" if unit == "1" else f"[{label}]")
    axes.grid(True, color="#e4e4e4", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    finite = np.concatenate([line[np.isfinite(line)] for line in lines])
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
        size = max(abs(low), abs(high))
        if high - low < STILL * max(size, 1.0):
            middle, half = (low + high) / 2, 0.1 * size if size > STILL else 1.0
            axes.set_ylim(middle - half, middle + half)
    # an offset (`+1.72e2`) in a corner is easily missed
    axes.ticklabel_format(axis="y", useOffset=False)


def _size(values: Array) -> float:
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if finite.size else math.nan


# -- influences ----------------------------------------------------------------------------------------------------
def _courses(axes: Axes, row: Ranking, time: Array, influences: Sequence[Influence]) -> None:
    """Change of the signal over time for 1 % more of each parameter."""
    display_unit = readable_unit(row.unit, max((_size(i.course) for i in influences), default=0.0) / 100)
    scale = read_unit(row.unit).scale / read_unit(display_unit).scale / 100  # a difference has no offset
    for k, influence in enumerate(influences):
        # also dashes: parameters that occur only as a product have the same time series
        axes.plot(time, influence.course * scale, color=COLOURS[k % len(COLOURS)], linewidth=1.3,
                  linestyle=DASHES[k % len(DASHES)], label=influence.parameter)
    _finish(axes, "by 1 % more", display_unit, [i.course * scale for i in influences])
    axes.set_xlim(*_ends(time))
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, fontsize=8,
                borderaxespad=0.1, ncols=2, columnspacing=1.2)


# -- a channel of a comparison -------------------------------------------------------------------------------------
def _channel(upper: Axes, lower: Axes, channel: Channel) -> None:
    display_unit = readable_unit(channel.unit, _size(channel.measured))
    measured = converted(channel.measured, channel.unit, display_unit)
    model = converted(channel.model, channel.unit, display_unit)
    dense = len(measured) > DENSE
    upper.plot(channel.time, measured, color=RECORD, label="record", **_style(dense, 2.4))
    upper.plot(channel.time, model, color=MODEL, linewidth=1.2, label="model")
    if channel.outlier.any():
        upper.plot(channel.time[channel.outlier], measured[channel.outlier], "x", color=COLOURS[0],
                   label="far from neighbours")
    _finish(upper, channel.name, display_unit, [measured, model])
    scale, unit = difference_unit(channel.unit)
    error = written(scale * channel.error, unit, 3)
    upper.set_title(f"rms error {error}, fit {number(channel.fit, 4)} %, reduced χ² {number(channel.chi2, 3)}", loc="right",
                    fontsize=9, color="#333333")
    residual = channel.measured - channel.model
    difference_scale, of_difference = difference_unit(channel.unit)
    unit = readable_unit(of_difference, max(_size(residual), 1e-300))
    scale = difference_scale * read_unit(of_difference).scale / read_unit(unit).scale
    if channel.noise > 0:
        lower.axhspan(-BAND_WIDTH * channel.noise * scale, BAND_WIDTH * channel.noise * scale, color=BAND, linewidth=0,
                      label=f"± {BAND_WIDTH} × noise")
    lower.plot(channel.time, residual * scale, color="#333333", label="record − model", **_style(dense, 0.7))
    _finish(lower, "residual", unit, [residual * scale])
    reach = max(_size(residual), (BAND_WIDTH + 1) * channel.noise if channel.noise > 0 else 0.0) * scale
    if math.isfinite(reach) and reach > 0:
        lower.set_ylim(-1.08 * reach, 1.08 * reach)


def _style(dense: bool, linewidth: float) -> dict[str, Any]:
    return {"linewidth": linewidth} if dense else {"linestyle": "none", "marker": ".", "markersize": 4}
