"""Figures of oscillating signals: over time, the spectrum, the rainflow cycles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from heavebond.core.presentation import unit_label
from heavebond.pictures.plot import COLOURS, DPI
from heavebond.pictures.plot_sample import SMALL, quiet

if TYPE_CHECKING:
    from heavebond.records.spectra import SignalAnalysis

CLASSES = 20
FEW = 10  # cycles in a class up to which the axis is linear
WIDTH, HEIGHT = 11.0, 2.4  # inches of a row
SHOWN = 0.9995  # share of m_0 below the last drawn frequency, and a factor beyond it


def plot_spectra(analyses: Sequence[SignalAnalysis]) -> Figure:
    """A row per signal: over time, its spectral density, and the number of rainflow cycles by range."""
    with rc_context(SMALL):
        figure = Figure(figsize=(WIDTH, 0.4 + HEIGHT * len(analyses)), dpi=1.5 * DPI, layout="constrained")
        for row, analysis in zip(figure.subplots(len(analyses), 3, squeeze=False, width_ratios=(1.5, 1.2, 1)), analyses,
                                 strict=True):
            time_panel = row[0]
            course = analysis.course
            time_panel.plot(course.time, course.values, color=COLOURS[0], linewidth=0.7)
            time_panel.axhline(analysis.mean, color="black", linewidth=0.6, linestyle=(0, (4, 2)))
            time_panel.margins(x=0)
            time_panel.set_xlabel("time [s]")
            time_panel.set_ylabel(f"{course.name} [{_unit(analysis)}]")
            if not analysis.still:
                density_panel = row[1]
                known = analysis.spectrum
                share = np.cumsum(known.density[1:]) / known.density[1:].sum()
                last = known.frequency[1:][int(np.searchsorted(share, SHOWN))]
                inside = (known.frequency > 0) & (known.frequency <= 1.5 * last)
                density_panel.fill_between(known.frequency[inside], known.density[inside], color=COLOURS[0], alpha=0.25,
                                           linewidth=0)
                density_panel.plot(known.frequency[inside], known.density[inside], color=COLOURS[0], linewidth=1.0)
                density_panel.axvline(1 / known.peak_period, color=COLOURS[1], linewidth=0.8, linestyle=(0, (4, 2)),
                                      label=f"peak at {known.peak_period:.3g} s")
                density_panel.set_xlim(left=0)
                density_panel.set_ylim(bottom=0)
                density_panel.set_xlabel("frequency [Hz]")
                unit = _unit(analysis)
                density_panel.set_ylabel(f"density [{unit}²/Hz]" if unit.isalpha() else f"density [({unit})²/Hz]")
                density_panel.legend(frameon=False)
                cycle_panel = row[2]
                edges, counts = analysis.cycles.classes(CLASSES)
                cycle_panel.barh(edges[:-1], counts, np.diff(edges), align="edge", color=COLOURS[2], edgecolor="white",
                                 linewidth=0.4)
                if counts.max() > FEW:
                    cycle_panel.set_xscale("symlog", linthresh=1.0)
                cycle_panel.set_xlim(left=0)
                cycle_panel.set_xlabel("rainflow cycles")
                cycle_panel.set_ylabel(f"range [{_unit(analysis)}]")
            for panel in row:
                quiet(panel)
        return figure


def _unit(analysis: SignalAnalysis) -> str:
    return unit_label(analysis.course.unit) if analysis.course.unit else "unit of the file"
