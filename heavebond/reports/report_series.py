"""Records and models over time, with a reduced number of samples, packed for the script of the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heavebond.core.presentation import number, readable_difference, readable_unit, unit_label
from heavebond.core.units import read_unit
from heavebond.diagnosis.state import LadderEntry
from heavebond.estimation.comparison import RecordComparison
from heavebond.numerics.dae import Array
from heavebond.pictures.markup import Html, element, joined
from heavebond.records.measurements import gaps

# maximum number of samples in a page, of one channel and of all channels with their models: about 2 MB
MOST, IN_ALL = 8000, 250_000
BAND = 2.0  # half width of the band in multiples of the noise; it contains 95 % of the samples of white noise
BEFORE, LAST = 0, 9  # the styles of the first and the last model
QUANTA = 30.0  # values are rounded to the noise divided by this number


@dataclass(frozen=True)
class ModelStyle:
    """The curve of one model: its name, its style (see report.css), and whether it is visible initially."""

    label: str
    style: int
    at_first: bool
    rung: LadderEntry


def shown_rungs(ladder: Sequence[LadderEntry]) -> list[ModelStyle]:
    """Assign styles to the models; only the fitted diagram without effects and the last model are visible initially."""
    before = 1 if len(ladder) > 2 else 0
    rungs = []
    for k, rung in enumerate(ladder):
        style = LAST if k == len(ladder) - 1 else BEFORE if k == before else 1 + k % 2
        rungs.append(ModelStyle(rung.name, style, k in (before, len(ladder) - 1), rung))
    return rungs


def packed(ladder: Sequence[ModelStyle]) -> list[dict[str, object]]:
    """The data for the script of the page: an entry for each record."""
    records = list(ladder[-1].rung.comparison.records.values()) if ladder else []
    count = sum(len(r.channels) for r in records) * (1 + len(ladder))
    most = min(MOST, max(500, IN_ALL // max(1, count)))
    entries: list[dict[str, object]] = []
    for k, record in enumerate(records):
        begin = min(float(c.time[0]) for c in record.channels.values())
        end = max(float(c.time[-1]) for c in record.channels.values())
        entries.append({"span": [begin, end if end > begin else begin + 1.0],
                        "shown": [s.label for s in ladder if s.at_first],
                        "charts": [_chart(f"{k}-{c}", record, name, ladder, most)
                                   for c, name in enumerate(record.channels)]})
    return entries


def _chart(identity: str, record: RecordComparison, name: str, ladder: Sequence[ModelStyle], most: int) -> dict[str, object]:
    channel = record.channels[name]
    finite = np.abs(channel.measured[np.isfinite(channel.measured)])
    unit = readable_unit(channel.unit, float(finite.max()) if finite.size else 0.0)
    source, target = read_unit(channel.unit), read_unit(unit)
    scale, offset = source.scale / target.scale, (source.offset - target.offset) / target.scale
    models = [s.rung.comparison.records[record.name].channels[name].model for s in ladder]
    samples = thinned(channel.measured, [models[0], models[-1]], channel.outlier, most)
    values = channel.measured * scale
    size = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0)) or 1.0
    quantum = float(10.0 ** math.floor(math.log10(max(channel.noise * scale / QUANTA, 1e-9 * size))))
    position = np.searchsorted(samples, gaps(channel.time), side="right") - 1
    step = float(np.median(np.diff(channel.time))) if len(channel.time) > 1 else 1.0
    return {"id": identity, "channel": name, "unit": unit_label(unit), "band": BAND * channel.noise * scale,
            "label": f"{name} over time in record {record.name}: record and models, and below what the models miss",
            "time": pack(channel.time[samples], 10.0 ** math.floor(math.log10(step / 50))),
            "measured": pack(channel.measured[samples] * scale + offset, quantum),
            "models": [{"label": s.label, "style": s.style, "values": pack(m[samples] * scale + offset, quantum)}
                       for s, m in zip(ladder, models, strict=True)], "breaks": sorted({int(k) for k in position if k >= 0}),
            "held": held_out(record, name), "outliers": np.flatnonzero(channel.outlier[samples]).tolist()}


def held_out(record: RecordComparison, name: str) -> list[list[float]]:
    """The intervals (s) of a channel that were held out of the fit, if they are parts of the record."""
    if record.validate is None or name not in record.validate.channels:
        return []
    part = record.validate.channels[name]
    ends = np.flatnonzero(np.diff(part.counts.astype(int), prepend=0, append=0)).reshape(-1, 2)
    return [[float(part.time[a]), float(part.time[b - 1])] for a, b in ends]


def thinned(measured: Array, models: Sequence[Array], always: NDArray[np.bool_], most: int) -> NDArray[np.int64]:
    """Select at most about `most` of n samples for a chart and return their indices.

    All samples are selected if n <= `most`. Otherwise the record is divided into intervals of equal length, and the minima
    and maxima of the record and of the residual of each model in each interval are selected, so that all peaks remain
    visible. The samples marked `always` are selected too.
    """
    n = len(measured)
    if n <= most:
        return np.arange(n)
    courses = [measured, *(measured - model for model in models)]
    edges = np.linspace(0, n, max(2, most // (2 * len(courses))) + 1).astype(int)
    indices = {0, n - 1, *np.flatnonzero(always).tolist()}
    for course in courses:
        for a, b in pairwise(edges):
            indices |= {a + int(np.argmin(course[a:b])), a + int(np.argmax(course[a:b]))}
    return np.array(sorted(indices))


def pack(values: Array, quantum: float) -> dict[str, object]:
    """Encode values as the first value and the differences of successive values in multiples of `quantum`."""
    sound = np.isfinite(values)
    finite = np.where(sound, values, values[np.argmax(sound)] if sound.any() else 0.0)
    whole = np.round((finite - finite[0]) / quantum).astype(np.int64)
    return {"o": float(finite[0]), "q": quantum, "d": np.diff(whole, prepend=0).tolist()}


# -- the page around the charts ----------------------------------------------------------------------------------------
def record_section(index: int, record: RecordComparison, ladder: Sequence[ModelStyle]) -> Html:
    """The section of a record: buttons, and empty charts that the script fills."""
    use = "fitted" if record.use == "fit" else "held out of the fit"
    more = "; the shaded stretches were held out" if record.validate is not None else ""
    # the figure of a channel with its errors for each model, in the order of the models
    charts = []
    for k, name in enumerate(record.channels):
        channels = [s.rung.comparison.records[record.name].channels[name] for s in ladder]
        last = channels[-1]
        errors = " → ".join(readable_difference(c.error, c.unit, 3) for c in channels)
        chi2 = " → ".join(number(c.chi2, 3) for c in channels)
        figure_text = element("span", element("b", last.name),
                              f"  rms error {errors}, chi-square per sample {chi2}, fit "
                              f"{number(last.fit, 4)} %, {len(last.time)} samples")
        charts.append(element("figure", element("figcaption", figure_text, element("output")),
                              element("div",
                                      element("p", "The curves are drawn by the script of this page.",
                                              class_="unless quiet small"), class_="canvas"), data_chart=k))
    notes = [element("p", note, class_="small quiet") for note in record.notes]
    moves = [("in", "+", "zoom in"), ("out", "−", "zoom out"), ("back", "◂", "earlier"), ("on", "▸", "later"),
             ("whole", "whole record", "show the whole record")]
    models = [element("button", element("svg", element("path", d="M1 6H25", class_=f"model m{s.style}"), width="26",
                                        height="12", aria_hidden="true"), s.label, type="button", data_model=s.label,
                      aria_pressed="true" if s.at_first else "false") for s in ladder]
    return element("section", element("h3", f"Record {record.name} ", element("span", use, class_="tag")),
                   element("p", f"{record.file.name}{more}.", class_="quiet small"),
                   element("div", *models, element("span", class_="between"),
                           *(element("button", face, type="button", data_do=action, aria_label=words, title=words)
                             for action, face, words in moves), class_="toolbar", role="toolbar",
                           aria_label="models and stretch of time"), *charts, *notes, data_record=index)


def key() -> Html:
    """Instructions for reading the charts and for zooming."""
    read = element("p", element("b", "How to read them. "), "Above: the record (grey) and the models. Below: the "
                   f"residual of each model, with a band of ±{BAND:g} noise levels that contains 95 % of white noise. The "
                   "line of a channel lists its errors, model by model in the order of the buttons. Crosses are samples far "
                   "from their neighbours. Gaps in the records are not bridged.", class_="small")
    move = element("p", element("b", "How to zoom and move. "), "Drag over a part of the chart to enlarge it, drag "
                   "with Shift to move it, and double-click to show the whole record. After a click into a chart, the wheel "
                   "and the keys + and − zoom, the arrow keys move, and 0 shows the whole record. On a touch screen, pinch "
                   "and drag. All channels of a record move together.", class_="small screen")
    return joined([read, move])
