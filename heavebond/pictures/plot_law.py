"""Picture of a formula that was found: over its variable and over time, with the input that the records ask for."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from heavebond.core.errors import UsageError
from heavebond.core.presentation import readable_unit, unit_label
from heavebond.core.units import read_unit
from heavebond.laws.find import FoundLaw, Laws
from heavebond.numerics.dae import Array
from heavebond.pictures.plot import COLOURS, DPI, RECT, WIDTH
from heavebond.pictures.plot_where import MOST, dress, padded_limits

DRAWS, POINTS = 200, 400  # of the parameters for the interval; of a curve
SHARES = (0.05, 0.5, 0.95)  # quantiles of a second variable at which a curve is drawn


def plot_law(found: Laws) -> Figure:
    """The simplest formula over its first variable (at three values of a second one) with its 95 % interval and the input
    that the records ask for, and both over time; UsageError if no formula was found."""
    law = found.simplest
    if law is None or not law.implied:
        raise UsageError("no formula was found: there is nothing to draw",
                         hint="`heavebond localize` draws the estimated input.")
    node = law.formula.node
    noun = node.domain.members[node.through].noun
    size = max(float(np.sqrt(np.mean(i.value**2))) for i in law.implied)
    shown = readable_unit(node.unit.text, size)
    per_y = node.unit.scale / read_unit(shown).scale
    figure = Figure(figsize=(WIDTH, 7.2), dpi=DPI, layout=ConstrainedLayoutEngine(rect=RECT, hspace=0.06))
    figure.suptitle(f"{found.experiment.name}, {law.formula.place.words}: {law.text}", x=0.01, ha="left", fontsize=12)
    grid = figure.add_gridspec(2, 1, height_ratios=(1.4, 1))
    panel = figure.add_subplot(grid[0])
    first, *others = [variable for variable, _ in law.formula.variables.values()]
    x = np.concatenate([i.local[first.formula] for i in law.implied])
    y = np.concatenate([i.value for i in law.implied])
    unit = readable_unit(read_unit(first.unit).text, float(np.abs(x).max()))
    per_x = read_unit(first.unit).scale / read_unit(unit).scale
    thin = slice(None, None, max(1, len(x) // MOST))
    panel.plot(x[thin] * per_x, y[thin] * per_y, ".", color=COLOURS[0], markersize=2.5, alpha=0.4,
               label="input that the records ask for")
    if not law.formula.memories:
        course = np.linspace(x.min(), x.max(), POINTS)
        for k, share in enumerate(SHARES if others else (0.5,)):
            held = {v.formula: np.full(POINTS, np.quantile(np.concatenate([i.local[v.formula] for i in law.implied]), share))
                    for v in others}
            low, middle, high = _interval(law, {first.formula: course, **held})
            label = "formula" + "".join(f", {v.formula} = {held[v.formula][0]:.3g} {v.unit}" for v in others)
            colour = "black" if not others else COLOURS[1 + k]
            panel.fill_between(course * per_x, low * per_y, high * per_y, color=colour, alpha=0.2, linewidth=0)
            panel.plot(course * per_x, middle * per_y, color=colour, linewidth=2, label=label)
    panel.legend(loc="best", frameon=True, framealpha=0.8, edgecolor="none", fontsize=9, markerscale=4)
    panel.set_ylim(*padded_limits(y * per_y))
    dress(panel, f"{first.formula} [{unit_label(unit)}]", f"{noun} [{unit_label(shown)}]")
    record = law.implied[0]
    below = figure.add_subplot(grid[1])
    band = 2 * record.deviation
    below.fill_between(record.time, (record.value - band) * per_y, (record.value + band) * per_y, color=COLOURS[0],
                       alpha=0.25, linewidth=0, label=f"{record.record}, with twice its standard deviation")
    below.plot(record.time, law.value(record.local, record.time) * per_y, color="black", linewidth=1, label="formula")
    below.legend(loc="upper left", frameon=False, fontsize=9, ncols=2)
    dress(below, "time [s]", f"{noun} [{unit_label(shown)}]")
    return figure


def _interval(law: FoundLaw, motion: dict[str, Array]) -> tuple[Array, Array, Array]:
    """The formula (N,) with the ends of its pointwise 95 % interval, by draws of its numbers."""
    time = np.arange(len(next(iter(motion.values()))), dtype=float)
    middle = law.value(motion, time)
    names = list(law.intervals)
    if not names:
        return middle, middle, middle
    draws = np.random.default_rng(0).multivariate_normal([law.numbers[n] for n in names], law.covariance, DRAWS)
    courses = np.array([law.formula.value(motion, time, {**law.numbers, **dict(zip(names, draw, strict=True))})
                        for draw in draws])
    low, high = np.nanquantile(courses, (0.025, 0.975), axis=0)
    return low, middle, high
