"""Pictures of samples, laid out for print: histograms, tornados, indices of sensitivity; numbers over two axes as maps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from heavebond.core.presentation import number, unit_label
from heavebond.pictures.plot import COLOURS, DPI, WIDE
from heavebond.studies.uncertainty import QUANTILES, Indices, Slopes, drawn, groups, indices, slopes, swings

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from heavebond.studies.campaign import StudyResult
    from heavebond.studies.run_case import Outcome
    from heavebond.studies.study import Picture

WIDTH = 6.7  # inches: the text of an A4 page
PANEL = 2.3
SMALL: Any = {"font.size": 8, "axes.titlesize": 9, "legend.fontsize": 8, "axes.labelsize": 8}
MOST_PANELS = 6
BARS = 12  # parameters of a tornado
NO_NUMBER = "#d9d9d9"  # colour of a case without a number, on a map
SHARES = f"{', '.join(f'{100 * q:g}' for q in QUANTILES[:-1])} and {100 * QUANTILES[-1]:g} %"
NUMBERED = 60  # number of cells of a map up to which numbers are written


def quiet(panel: Axes, axis: Any = "both") -> None:
    """A pale grid in the background, no frame at the top and at the right."""
    panel.grid(True, axis=axis, color="#e4e4e4", linewidth=0.5)
    panel.spines[["top", "right"]].set_visible(False)
    panel.set_axisbelow(True)


def headed(figure: Figure, picture: Picture) -> None:
    """Write the title of a picture above it, if it has one."""
    if picture.title:
        figure.suptitle(picture.title, x=0.01, ha="left", fontsize=9)


def _column(picture: Picture, titles: list[str], height: float) -> tuple[Figure, list[Axes]]:
    """Panels below each other, each with its title."""
    figure = Figure(figsize=(WIDTH, 0.6 + height * len(titles)), dpi=2 * DPI, layout="constrained")
    panels: list[Axes] = list(figure.subplots(len(titles), 1, squeeze=False)[:, 0])
    for panel, title in zip(panels, titles, strict=True):
        panel.set_title(title, loc="left")
    headed(figure, picture)
    return figure, panels


def _label(result: StudyResult, name: str) -> str:
    return f"{name} [{unit_label(result.units[name].text)}]"


def histograms(result: StudyResult, picture: Picture) -> Figure:
    """Histogram of a number, a colour per level of the other axes; dashed lines at the 5, 50 and 95 % quantiles."""
    figure, panels = _column(picture, [""] * len(picture.names), PANEL)
    for panel, name in zip(panels, picture.names, strict=True):
        samples_by_level = [(level_text, values[np.isfinite(values)]) for level_text, outcomes in groups(result)
                            if len(values := drawn(result, name, outcomes))]
        together = np.concatenate([values for _, values in samples_by_level])
        bins: Any = np.histogram_bin_edges(together, "auto") if len(together) and np.ptp(together) else 10
        for k, (level_text, values) in enumerate(samples_by_level):
            colour = COLOURS[k % len(COLOURS)]
            below = [float(np.quantile(values, share)) for share in QUANTILES] if len(values) else []
            quantile_text = f"{SHARES}: {', '.join(number(value, 3) for value in below)}" if below else "no case"
            panel.hist(values, bins, color=colour, alpha=0.55 if len(samples_by_level) > 1 else 0.8,
                       label=f"{level_text}   {quantile_text}" if len(samples_by_level) > 1 else quantile_text)
            for value in below:
                panel.axvline(value, color=colour, linestyle=(0, (4, 2)), linewidth=1.0)
        panel.set_xlabel(_label(result, name))
        panel.set_ylabel("cases")
        quiet(panel, "y")
        # one below the other: labels of close quantiles would overlap
        panel.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    return figure


def tornados(result: StudyResult, picture: Picture) -> Figure:
    """Change of a number for each parameter alone between both ends of its range: the widest bar on top."""
    tornado_rows = [(name, level_text, rows[:BARS]) for name in picture.names for level_text, rows in swings(result, name)]
    longest = max((len(rows) for *_, rows in tornado_rows), default=1)
    figure, panels = _column(picture, [level_text for _, level_text, _ in tornado_rows], 0.8 + 0.24 * longest)
    for panel, (name, _, rows) in zip(panels, tornado_rows, strict=True):
        places = np.arange(len(rows))
        middle = rows[0].value if rows else 0.0
        for end, colour in (("low", COLOURS[0]), ("high", COLOURS[1])):
            values = np.array([getattr(row, end) for row in rows])
            panel.barh(places, values - middle, left=middle, color=colour, height=0.7)
            for place, value in zip(places, values, strict=True):
                if np.isfinite(value):
                    opposite = rows[int(place)].high if end == "low" else rows[int(place)].low
                    within = (value - middle) * (opposite - value) > 0  # inside the bar of the other end
                    right = (value > middle) != within
                    panel.annotate(number(value, 3), (middle if within else value, place), (3 if right else -3, 0),
                                   textcoords="offset points", va="center", ha="left" if right else "right", fontsize=7)
        panel.axvline(middle, color="black", linewidth=0.8)
        panel.set_yticks(places, [row.parameter for row in rows])
        panel.invert_yaxis()
        panel.margins(x=0.12)
        panel.set_xlabel(_label(result, name))
        quiet(panel, "x")
    ends = zip(COLOURS, ("at the low end", "at the high end"), strict=False)
    figure.legend(handles=[Patch(color=colour, label=label) for colour, label in ends], loc="outside lower center", ncols=2,
                  frameon=False)
    return figure


def shares(result: StudyResult, picture: Picture) -> Figure:
    """Sensitivity indices: bars for a parameter alone and with the others, with their 95 % intervals; to first order from
    slopes if the sample is `local`."""
    estimates: list[Indices | Slopes] = [*indices(result), *slopes(result)]
    drawn_estimates = [estimate for estimate in estimates if estimate.quantity in picture.names]
    longest = max((len(i.parameters) for i in drawn_estimates), default=1)
    figure, panels = _column(picture, [", ".join(filter(None, (i.quantity, i.others))) for i in drawn_estimates], 0.8 + 0.3
                             * longest)
    for panel, estimate in zip(panels, drawn_estimates, strict=True):
        order = np.argsort([-v for v in (estimate.total if isinstance(estimate, Indices) else estimate.share)])
        places = np.arange(len(order))
        rows = [(estimate.first, estimate.first_interval, "alone"),
                (estimate.total, estimate.total_interval, "with the others")] \
            if isinstance(estimate, Indices) else [(estimate.share, None, "to first order")]
        for k, (values, intervals, label) in enumerate(rows):
            centre = np.array(values)[order]
            spread = None if intervals is None else np.abs(np.array(intervals)[order].T - centre)
            panel.barh(places + (k - (len(rows) - 1) / 2) * 0.38, centre, 0.36 if len(rows) > 1 else 0.7, xerr=spread,
                       color=COLOURS[k], label=label, error_kw={"linewidth": 0.8, "capsize": 2})
        panel.set_yticks(places, [estimate.parameters[k] for k in order])
        panel.invert_yaxis()
        panel.set_xlim(left=min(0.0, panel.get_xlim()[0]))
        panel.set_xlabel("share of the variance")
        quiet(panel, "x")
    if panels:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure


# -- maps --------------------------------------------------------------------------------------------------------------
def maps(result: StudyResult, picture: Picture) -> Figure:
    """A number over the first two axes of numbers as colours, a panel per level of the other axes."""
    across, down = [k for k, axis in enumerate(result.study.axes) if axis.unit is not None][:2]
    sheet_list = [(name, *pair) for name in picture.names for pair in _sheets(result, across, down)][:MOST_PANELS]
    figure, panels = _column(picture, [", ".join(filter(None, (name, level_text))) for name, level_text, _ in sheet_list],
                             1.25 * PANEL)
    for panel, (name, _, outcomes) in zip(panels, sheet_list, strict=True):
        at = (across, down)
        axes = [result.study.axes[k] for k in at]
        table = np.full((len(axes[1].levels), len(axes[0].levels)), np.nan)
        for outcome in outcomes:
            index = result.case_of(outcome).index
            table[index[at[1]], index[at[0]]] = result.value(outcome, name)
        known = table[np.isfinite(table)]
        # one extreme case must not make all others one colour
        scale = LogNorm() if len(known) and known.min() > 0 and known.max() > WIDE * known.min() else Normalize()
        drawn_map = panel.pcolormesh(np.ma.masked_invalid(table), cmap="cividis", norm=scale, edgecolors="white",
                                     linewidth=0.4)
        panel.set_facecolor(NO_NUMBER)
        for axis, ticks, label in ((axes[0], panel.set_xticks, panel.set_xlabel), (axes[1], panel.set_yticks,
                                                                                   panel.set_ylabel)):
            assert axis.unit is not None
            ticks(np.arange(len(axis.levels)) + 0.5, [number(axis.unit.from_si(level.value), 3) for level in axis.levels])
            label(f"{axis.name} [{unit_label(axis.unit.text)}]")
        if table.size <= NUMBERED:
            for (row, column), value in np.ndenumerate(table):
                panel.text(column + 0.5, row + 0.5, number(value, 3), ha="center", va="center", fontsize=7,
                           color="white" if np.isfinite(value) and scale(value) < 0.5 else "black")
        figure.colorbar(drawn_map, ax=panel, label=_label(result, name))
    return figure


def _sheets(result: StudyResult, *without: int) -> Iterator[tuple[str, list[Outcome]]]:
    """Outcomes with the same levels of all axes but two."""
    outcomes_by_level: dict[str, list[Outcome]] = {}
    for outcome in result.outcomes:
        words = [level.name if axis.unit is None else f"{axis.name} {level.name}" for k, (axis, level) in
                 enumerate(zip(result.study.axes, result.case_of(outcome).levels, strict=True)) if k not in without]
        outcomes_by_level.setdefault(", ".join([*words, *([outcome.procedure] if len(result.study.procedures) > 1 else [])]),
                                     []).append(outcome)
    yield from outcomes_by_level.items()
