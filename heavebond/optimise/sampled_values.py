"""Functionals of the points of a run: extremes, standard deviation, load cycles, duration and frequency of a condition.

Most are not differentiable everywhere in the parameters: they can be measured and fitted, but not tuned."""

from __future__ import annotations

import numpy as np

from heavebond.numerics.dae import Array
from heavebond.numerics.extremes import highest, lowest, mean
from heavebond.records.spectra import rainflow_ranges

EXTREMES = ("highest", "lowest", "largest")
CONDITIONS = ("share", "times")
CYCLES, DEVIATION = "equivalent_range", "deviation"
SAMPLED = (*EXTREMES, *CONDITIONS, CYCLES, DEVIATION)


def sampled_value(kind: str, time: Array, signal: Array, sensitivities: Array, exponent: float = 1.0) -> tuple[float, Array]:
    """The value of a functional of a signal (n,) at times (n,) and its slopes (m,), with the `sensitivities` (m, n) of the
    signal. A time may occur twice, with the values before and after an event.

    highest(e), lowest(e): the extremes; largest(e): the largest |e|; for a condition (1 if it holds, 0 otherwise) share(c):
    the share of the time in which it holds; times(c): how often it becomes true. Counts have no slope.
    deviation(e): the standard deviation over time.
    equivalent_range(e, m), with the ranges r and counts n of the rainflow cycles of a signal of duration T, is (sum n
    r**m/(T 1 Hz))**(1/m): the range that causes the same damage once a second if damage is proportional to r**m.
    """
    still = np.zeros(len(sensitivities))
    if kind == DEVIATION:
        around = signal - mean(time, signal)
        size = max(mean(time, around**2), 0.0)**0.5
        return size, np.array([mean(time, around * slope) / size for slope in sensitivities]) if size else still
    if kind == CYCLES:
        # the range and its slopes (m,): each range changes with the samples at its two ends
        ranges, counts, ends = rainflow_ranges(signal)
        damage = counts * ranges**exponent / (time[-1] - time[0])
        if not damage.sum() > 0:
            return 0.0, np.zeros(len(sensitivities))
        value = float(damage.sum() ** (1 / exponent))
        first, last = ends
        grown = np.sign(signal[last] - signal[first]) * (sensitivities[:, last] - sensitivities[:, first])
        return value, np.asarray(value / damage.sum() * (grown @ (damage / ranges)))
    if kind == "times":
        return float(np.count_nonzero(np.diff(signal > 0.5) & (signal[1:] > 0.5))), still
    if kind == "share":
        return float(np.trapezoid(signal, time) / (time[-1] - time[0])), still
    sought = {"highest": [(1.0, highest)], "lowest": [(1.0, lowest)], "largest": [(1.0, highest), (-1.0, lowest)]}[kind]
    value, sign, extreme = max(((sign * extreme.of(signal), sign, extreme) for sign, extreme in
                                ((sign, of(time, signal)) for sign, of in sought)),
                               key=lambda extreme_value: extreme_value[0])
    return value, sign * extreme.along(sensitivities)
