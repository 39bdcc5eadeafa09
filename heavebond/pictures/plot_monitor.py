"""Figure of a monitored record: its innovations, the sums that watch them, and the time of the change."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from heavebond.monitoring.change_detection import watched_sums
from heavebond.monitoring.monitor import CHANGED, MonitoredRecord, Monitoring
from heavebond.pictures.plot import COLOURS, stack_of_axes

CLIPPED = 8.0  # standard deviations up to which innovations are drawn


def plot_monitored(monitoring: Monitoring, name: str) -> Figure:
    """The innovations of each channel of a record in standard deviations, and below them the sums over their thresholds: an
    alarm is raised where one of them reaches 1. The change has a line, its interval a band."""
    record, estimate = monitoring[name], monitoring.estimate(name)
    figure, axes = stack_of_axes(len(estimate.innovations) + 1, f"{name}: {describe(record)}")
    for axis, (channel, v) in zip(axes, estimate.innovations.items(), strict=False):
        on = np.isfinite(v)
        axis.axhspan(-2, 2, color="0.93", linewidth=0)
        axis.plot(estimate.time[on], np.clip(v[on], -CLIPPED, CLIPPED), ".", markersize=2.5, color=COLOURS[0])
        axis.set_ylim(-CLIPPED - 0.5, CLIPPED + 0.5)
        axis.set_ylabel(f"{channel}\ninnovation [std]")
    last = axes[-1]
    for k, (words, (rows, values)) in enumerate(watched_sums(estimate.innovations, monitoring.rate).items()):
        last.plot(estimate.time[rows], np.clip(values, 0, 2), linewidth=1, color=COLOURS[k % len(COLOURS)], label=words)
    last.axhline(1, color="0.2", linewidth=1, linestyle="--")
    last.set_ylim(0, 2)
    last.set_ylabel("sum / threshold")
    last.set_xlabel("time [s]")
    last.legend(loc="upper left", frameon=True, framealpha=0.8, edgecolor="none", fontsize=8, ncols=2)
    if record.outcome == CHANGED:
        for axis in axes:
            axis.axvspan(record.earliest, record.latest, color="tab:red", alpha=0.25, linewidth=0)
            axis.axvline(record.change, color="tab:red", linewidth=1)
    return figure


def describe(record: MonitoredRecord) -> str:
    """The outcome of a record in words."""
    if record.outcome == CHANGED:
        return f"leaves the model at {record.change:.6g} s ({record.earliest:.6g} .. {record.latest:.6g} s)"
    return record.reason or record.outcome
