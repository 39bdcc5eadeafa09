"""Charts of the proposed experiment: the input, and the response predicted by each alternative."""

from __future__ import annotations

import numpy as np

from heavebond.core.presentation import number, readable_unit, unit_label
from heavebond.core.units import read_unit
from heavebond.experiment_design.separation import Predicted, Separation, SimulatedInput
from heavebond.numerics.dae import Array
from heavebond.pictures.markup import Html, element, joined, table
from heavebond.reports.report_charts import BLUE, GREEN, INK, MOST_POINTS, ORANGE, PURPLE, Line, over, swatch

COLOURS = (BLUE, ORANGE, GREEN, PURPLE, INK)
DASHES = (None, "7 3", "2 2", "9 3 2 3", None)
SHOWN = 8  # number of simulated inputs in the table
SIZE = (518.0, 230.0)


def separating(found: Separation) -> Html:
    """The section on the next experiment: the most discriminating input, the predicted channels, the distinguished pairs."""
    parts = [element("p", line) for line in found.words]
    if found.best is None:
        return joined(parts)
    kinds = ["line" if dash is None else "dash" for dash in DASHES]
    legend = swatch(*((kinds[k], COLOURS[k], name) for k, name in enumerate(found.alternatives[:len(COLOURS)])))
    figures = [figure for name, channel in found.channels.items() for figure in _channel(found, name, channel)]
    parts += [element("figure", _input(found, found.best)), element("p", legend, class_="small"),
              element("div", *(element("figure", figure) for figure in figures), class_="panels"), _pairs(found.best),
              _tried(found)]
    return joined(parts)


def _thin(values: Array) -> Array:
    return values[::max(1, -(-len(values) // MOST_POINTS))]


def _input(found: Separation, best: SimulatedInput) -> Html:
    name, unit = best.proposal.input, found.limits[best.proposal.input][1]
    shown = readable_unit(unit, float(np.max(np.abs(best.proposal.values), initial=0.0)))
    values = best.proposal.values * (read_unit(unit).scale / read_unit(shown).scale)
    return over([], [Line(_thin(found.time), _thin(values), INK, 1.4)], title=f"input {name}", across="time [s]",
                up=f"[{unit_label(shown)}]" if shown != "1" else "dimensionless",
                label=f"Proposed course of the input {name}", size=SIZE)


def _channel(found: Separation, name: str, channel: Predicted) -> list[Html]:
    """A channel under each alternative, and the differences from the first alternative in multiples of the noise."""
    shown = readable_unit(channel.unit, float(np.max(np.abs(channel.values), initial=0.0)))
    source, target = read_unit(channel.unit), read_unit(shown)
    values = (channel.values * source.scale + source.offset - target.offset) / target.scale
    apart = (channel.values - channel.values[:1]) / channel.noise
    pictures = ((values, f"{name} as each foresees it", f"[{unit_label(shown)}]"),
                (apart, f"{name}: each less the first", "[noise levels]"))
    return [over([], [Line(_thin(found.time), _thin(course), COLOURS[k % len(COLOURS)], 1.4, DASHES[k % len(DASHES)])
                      for k, course in enumerate(courses)], title=title, across="time [s]", up=up, size=SIZE,
                 label=f"{title}, under each alternative") for courses, title, up in pictures]


def _pairs(best: SimulatedInput) -> Html:
    rows = [(p.one, p.other, p.channel, f"{number(p.at, 3)} s", number(p.size, 3), number(p.chi2, 4),
             f"{100 * p.sure:.4g} %") for p in best.pairs]
    head = ("one", "other", "differ most in", "near", "by noise levels", "χ² of the wrong one higher by", "decides in")
    return table(head, rows, numbers=(3, 4, 5, 6), caption="What the proposed record would decide")


def _tried(found: Separation) -> Html:
    rows = [(t.proposal.input, t.proposal.shape, f"{number(t.proposal.frequency, 3)} Hz" if t.proposal.frequency else "–",
             str(t.decided), number(t.smallest, 4)) for t in found.tried[:SHOWN]]
    head = ("input", "shape", "frequency", "pairs distinguished", "smallest rise of χ²")
    caption = f"Inputs that were simulated, {len(found.tried)} in all, the best first"
    return table(head, rows, numbers=(2, 3, 4), caption=caption)
