"""Figures of a localisation: the estimated input at a place over speed, position or pressure, and over time; and the
misfit.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from heavebond.core.errors import UsageError
from heavebond.core.presentation import readable_unit, unit_label
from heavebond.core.units import read_unit
from heavebond.laws.find import Laws
from heavebond.localise.misfit import Localization, PlaceEstimate, noun
from heavebond.numerics.dae import Array
from heavebond.pictures.plot import COLOURS, DPI, RECORD, RECT, WIDTH

PANELS = 3
# Number of samples drawn in a scatter plot.
MOST = 3000
DRAWS, POINTS = 200, 400  # of the parameters for the interval; of a curve
SHARES = (0.05, 0.5, 0.95)  # quantiles of a second variable at which a curve is drawn


def plot_place(localization: Localization, place: str) -> Figure:
    """Estimated input at a place: over the variable that explains it best and two others near it, with the curve through
    it, and over time with twice its standard deviation; UsageError for a place that was not estimated."""
    localization.implied(place)
    suspect = next(s for s in localization.suspects if s.place.name == place)
    figure = Figure(figsize=(WIDTH, 7.2), dpi=DPI, layout=ConstrainedLayoutEngine(rect=RECT, hspace=0.06))
    figure.suptitle(f"{localization.experiment.name}: estimated missing input {suspect.place.words} "
                    f"({100 * suspect.explained:.4g} % of the misfit explained)", x=0.01, ha="left", fontsize=12)
    display_unit = readable_unit(suspect.place.unit.text, suspect.rms)
    # the best variable first, then others in the order of the place
    if suspect.curve is None:
        names = []
    else:
        best = suspect.curve.variable.formula
        names = [best, *(n for n in suspect.curve.scores if n != best)][:PANELS]
    grid = figure.add_gridspec(2, max(len(names), 1), height_ratios=(1.4, 1))
    for k, name in enumerate(names):
        panel = figure.add_subplot(grid[0, k])
        _cloud(panel, suspect, name, display_unit)
        if k == 0:
            panel.set_ylabel(f"{noun(suspect)} [{unit_label(display_unit)}]")
    # the force over time, record after record
    panel = figure.add_subplot(grid[1, :])
    per_y = read_unit(suspect.place.unit.text).scale / read_unit(display_unit).scale
    for k, implied in enumerate(suspect.implied.values()):
        value, band = implied.value * per_y, 2 * implied.deviation * per_y
        panel.fill_between(implied.time, value - band, value + band, color=COLOURS[k % len(COLOURS)], alpha=0.2, linewidth=0)
        panel.plot(implied.time, value, color=COLOURS[k % len(COLOURS)], linewidth=1, label=implied.record)
    limits = np.concatenate([padded_limits(i.value * per_y) for i in suspect.implied.values()])
    panel.set_ylim(float(limits.min()), float(limits.max()))
    panel.legend(loc="upper left", frameon=False, fontsize=9, ncols=len(suspect.implied))
    dress(panel, "time [s]", f"{noun(suspect)} [{unit_label(display_unit)}]")
    if names:
        figure.axes[0].legend(loc="best", frameon=True, framealpha=0.8, edgecolor="none", fontsize=9, markerscale=4)
    return figure


def plot_misfit(localization: Localization) -> Figure:
    """Time of the misfit to the records, and the curve of each channel's error over the variable that explains it best."""
    channels = list(localization.experiment.outputs)
    records = list(dict.fromkeys(s.record for s in localization.stretches))
    first = {s.channel: s for s in reversed(localization.states)}
    best = [first[name] for name in channels if name in first]
    figure = Figure(figsize=(WIDTH, 6.5 if best else 3.6), dpi=DPI, layout=ConstrainedLayoutEngine(rect=RECT, hspace=0.06))
    figure.suptitle(f"{localization.experiment.name}: when and in what state of motion the model misses", x=0.01, ha="left",
                    fontsize=12)
    grid = figure.add_gridspec(2 if best else 1, 1)
    upper = grid[0].subgridspec(1, len(records))
    for k, record in enumerate(records):
        panel = figure.add_subplot(upper[0, k])
        parts = [s for s in localization.stretches if s.record == record]
        for c, name in enumerate(channels):
            panel.step([s.begin for s in parts] + [parts[-1].end], [s.chi2[name] for s in parts] + [parts[-1].chi2[name]],
                       where="post", color=COLOURS[c % len(COLOURS)], label=name, linewidth=1.4)
        panel.set_yscale("log")
        panel.axhline(1.0, color=RECORD, linewidth=1)
        dress(panel, "time [s]", "reduced χ²" if k == 0 else "")
        panel.set_title(record, loc="left", fontsize=10, fontweight="bold")
    if best:
        lower = grid[1].subgridspec(1, len(best))
        for k, state in enumerate(best):
            panel = figure.add_subplot(lower[0, k])
            unit = localization.experiment.outputs[state.channel].shown.unit
            panel.plot(state.x, state.y, "o-", color=COLOURS[channels.index(state.channel) % len(COLOURS)], markersize=3)
            panel.axhline(0.0, color=RECORD, linewidth=0.8)
            dress(panel, f"{state.variable} [{unit_label(state.unit)}]", f"error of {state.channel} [{unit_label(unit)}]")
            panel.set_title(f"R² {state.r2:.2f} on data not used", loc="left", fontsize=9)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=len(labels), frameon=False)
    return figure


def _cloud(panel: Axes, suspect: PlaceEstimate, name: str, display_unit: str) -> None:
    """The force over one variable, rising and falling in different colours, and the curve through it."""
    assert suspect.curve is not None
    x = np.concatenate([i.local[name] for i in suspect.implied.values()])
    y = np.concatenate([i.value for i in suspect.implied.values()])
    up = np.concatenate([np.gradient(i.local[name]) > 0 for i in suspect.implied.values()])
    thin = slice(None, None, max(1, len(x) // MOST))
    unit = suspect.curve.units.get(name, "")
    across = readable_unit(unit, float(np.max(np.abs(x)))) if unit else unit
    per_x = read_unit(unit).scale / read_unit(across).scale if unit else 1.0
    per_y = read_unit(suspect.place.unit.text).scale / read_unit(display_unit).scale
    for mask, colour, label in ((up, COLOURS[0], "while it rises"), (~up, COLOURS[1], "while it falls")):
        panel.plot(x[thin][mask[thin]] * per_x, y[thin][mask[thin]] * per_y, ".", color=colour, markersize=2.5, alpha=0.5,
                   label=label)
    curve = suspect.curve
    if name == curve.variable.formula and not curve.times:
        panel.plot(curve.x * per_x, curve.y * per_y, color="black", linewidth=2, label="curve")
        if curve.y_down.size:
            panel.plot(curve.x * per_x, curve.y_down * per_y, color="black", linewidth=2, linestyle="--")
    dress(panel, f"{name} [{unit_label(across)}]" if across else name, "")
    r2 = curve.r2 if name == curve.variable.formula else curve.scores[name]
    panel.set_title(f"R² {max(r2, 0.0):.2f} on data not used", loc="left", fontsize=10)


def padded_limits(values: Array) -> Array:
    """The range of values with some room."""
    low, high = float(values.min()), float(values.max())
    room = 0.15 * (high - low) or 1.0
    return np.array([low - room, high + room])


def dress(panel: Axes, x: str, y: str) -> None:
    """The labels and the grid of a panel."""
    panel.set_xlabel(x)
    if y:
        panel.set_ylabel(y)
    panel.grid(True, color="#e4e4e4", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)
    panel.set_axisbelow(True)


def plot_law(laws: Laws) -> Figure:
    """The simplest formula over its first variable (at three values of a second one) with its 95 % interval and the input
    that the records ask for, and both over time; UsageError if no formula was found."""
    law = laws.simplest
    if law is None or not law.implied:
        raise UsageError("no formula was found: there is nothing to draw",
                         hint="`heavebond localize` draws the estimated input.")
    node = law.formula.node
    noun = node.domain.members[node.through].noun
    size = max(float(np.sqrt(np.mean(i.value**2))) for i in law.implied)
    display_unit = readable_unit(node.unit.text, size)
    per_y = node.unit.scale / read_unit(display_unit).scale
    figure = Figure(figsize=(WIDTH, 7.2), dpi=DPI, layout=ConstrainedLayoutEngine(rect=RECT, hspace=0.06))
    figure.suptitle(f"{laws.experiment.name}, {law.formula.place.words}: {law.text}", x=0.01, ha="left", fontsize=12)
    grid = figure.add_gridspec(2, 1, height_ratios=(1.4, 1))
    panel = figure.add_subplot(grid[0])
    first, *further_variables = [variable for variable, _ in law.formula.variables.values()]
    x = np.concatenate([i.local[first.formula] for i in law.implied])
    y = np.concatenate([i.value for i in law.implied])
    unit = readable_unit(read_unit(first.unit).text, float(np.abs(x).max()))
    per_x = read_unit(first.unit).scale / read_unit(unit).scale
    thin = slice(None, None, max(1, len(x) // MOST))
    panel.plot(x[thin] * per_x, y[thin] * per_y, ".", color=COLOURS[0], markersize=2.5, alpha=0.4,
               label="input that the records ask for")
    if not law.formula.memories:
        course = np.linspace(x.min(), x.max(), POINTS)
        for k, share in enumerate(SHARES if further_variables else (0.5,)):
            held = {v.formula: np.full(POINTS, np.quantile(np.concatenate([i.local[v.formula] for i in law.implied]), share))
                    for v in further_variables}
            # the formula (N,) with the ends of its pointwise 95 % interval, by draws of its numbers
            motion = {first.formula: course, **held}
            time = np.arange(len(next(iter(motion.values()))), dtype=float)
            low = middle = high = law.value(motion, time)
            names = list(law.intervals)
            if names:
                draws = np.random.default_rng(0).multivariate_normal([law.numbers[n] for n in names], law.covariance, DRAWS)
                courses = np.array([law.formula.value(motion, time, {**law.numbers, **dict(zip(names, draw, strict=True))})
                                    for draw in draws])
                low, high = np.nanquantile(courses, (0.025, 0.975), axis=0)
            label = "formula" + "".join(f", {v.formula} = {held[v.formula][0]:.3g} {v.unit}" for v in further_variables)
            colour = "black" if not further_variables else COLOURS[1 + k]
            panel.fill_between(course * per_x, low * per_y, high * per_y, color=colour, alpha=0.2, linewidth=0)
            panel.plot(course * per_x, middle * per_y, color=colour, linewidth=2, label=label)
    panel.legend(loc="best", frameon=True, framealpha=0.8, edgecolor="none", fontsize=9, markerscale=4)
    panel.set_ylim(*padded_limits(y * per_y))
    dress(panel, f"{first.formula} [{unit_label(unit)}]", f"{noun} [{unit_label(display_unit)}]")
    record = law.implied[0]
    below = figure.add_subplot(grid[1])
    band = 2 * record.deviation
    below.fill_between(record.time, (record.value - band) * per_y, (record.value + band) * per_y, color=COLOURS[0],
                       alpha=0.25, linewidth=0, label=f"{record.record}, with twice its standard deviation")
    below.plot(record.time, law.value(record.local, record.time) * per_y, color="black", linewidth=1, label="formula")
    below.legend(loc="upper left", frameon=False, fontsize=9, ncols=2)
    dress(below, "time [s]", f"{noun} [{unit_label(display_unit)}]")
    return figure
