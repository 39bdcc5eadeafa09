"""Detection of the sample from which on innovations are no longer white with unit variance.

A bank of cumulative sums (CUSUM) monitors the normalised innovations v of a record, each N(0, 1) if the model is right.
The sum for the size of all innovations adds the log likelihood ratio of the standard deviation s against 1,

    S := max(0, S + (v^2 (1 - 1/s^2) - ln s^2)/2).

Two sums for the mean of each channel add the log likelihood ratio of a mean of +d or -d against 0,
S := max(0, S +- d v - d^2/2). An alarm is raised when one of the sums exceeds its threshold. The thresholds follow from
the rate of false alarms: each sum is a Markov chain on [0, threshold), and the probability that it stays there for all
samples of a record follows from powers of its transition matrix. Every sum has an equal share of the rate (Bonferroni),
so that the rate of the bank is at most the stated one.

The first estimate of the time of the change maximises the generalised likelihood ratio; `onset` improves it. From sample j
on until the alarm the innovations have another standard deviation s_j,

    l_j = (sum v^2 - n - n ln(sum v^2 / n))/2   of the n innovations from j to the alarm, if sum v^2 > n.

With equal prior probability of all samples, exp(l_j) over its sum is the probability of each, which gives the interval.

E. S. Page, Continuous inspection schemes, Biometrika 41 (1954) 100-115, doi:10.1093/biomet/41.1-2.100; D. Brook, D. A.
Evans, An approach to the probability distribution of CUSUM run length, Biometrika 59 (1972) 539-549,
doi:10.1093/biomet/59.3.539; M. Basseville, I. V. Nikiforov, Detection of Abrupt Changes, Prentice Hall 1993, sections 2.2
and 2.4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from heavebond.numerics.dae import Array

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class DetectionConstants:
    """The constants of the detection of changes. They determine which changes are detected soonest, not the rate of
    false alarms.

    scale: standard deviation of innovations for which the sum of their size is optimal. Origin: a doubled mean square.
        Doubled: small increases are found later, large ones sooner.
    shift: mean of an innovation, in standard deviations, for which the sums of the means are optimal. Origin: half of the
        noise. Doubled: as above.
    cells: cells into which the range of a sum is divided for its distribution. Origin: the rate is exact to some percent.
        Doubled: four times the time.
    """

    scale: float = 2.0**0.5
    shift: float = 0.5
    cells: int = 100


DETECTION = DetectionConstants()


@dataclass(frozen=True)
class Change:
    """The change of a record: the time of the alarm, the sum that raised it, and the estimated time of the change with the
    interval that contains it with 95 % probability (all in s); `ratio` is the log likelihood ratio of the change."""

    alarm: float
    statistic: str
    time: float
    low: float
    high: float
    ratio: float


def find_change(time: Array, innovations: Mapping[str, Array], rate: float) -> Change | None:
    """The change in a record of innovations (N,) by channel, nan where not sampled; None if no sum exceeds its threshold.
    `rate` is the probability of an alarm in a record without a change."""
    alarms = []
    for name, (rows, values) in watched_sums(innovations, rate).items():
        if (over := np.flatnonzero(values > 1)).size:
            alarms.append((int(rows[over[0]]), name))
    if not alarms:
        return None
    alarm, statistic = min(alarms)
    matrix = np.column_stack(list(innovations.values()))
    ratios = np.full(alarm + 1, -np.inf)
    squares = np.nansum(matrix[:alarm + 1] ** 2, axis=1)
    counts = np.isfinite(matrix[:alarm + 1]).sum(axis=1)
    total, n = np.cumsum(squares[::-1])[::-1], np.cumsum(counts[::-1])[::-1]
    larger = total > n
    ratios[larger] = (total[larger] - n[larger] - n[larger] * np.log(total[larger] / n[larger])) / 2
    best = int(np.argmax(ratios)) if larger.any() else alarm
    probability = np.exp(ratios - ratios[best]) if larger.any() else np.eye(alarm + 1)[alarm]
    cumulated = np.cumsum(probability) / probability.sum()
    low, high = (int(np.searchsorted(cumulated, share)) for share in (0.025, 0.975))
    return Change(float(time[alarm]), statistic, float(time[best]), float(time[min(low, best)]),
                  float(time[min(max(high, best), alarm)]), float(ratios[best]) if larger.any() else 0.0)


def watched_sums(innovations: Mapping[str, Array], rate: float) -> dict[str, tuple[Rows, Array]]:
    """Each sum over its threshold for innovations (N,) by channel, by its name: the samples (n,) at which it changes, and
    its values (n,) there. A value above 1 raises an alarm."""
    matrix = np.column_stack(list(innovations.values()))
    share = rate / (1 + 2 * matrix.shape[1])
    # samples of all channels in the order of time, for the sum of their size
    rows, _ = np.nonzero(np.isfinite(matrix))
    flat = matrix[np.isfinite(matrix)]
    increments = {"size": (rows, (flat**2 * (1 - DETECTION.scale**-2) - np.log(DETECTION.scale**2)) / 2, "size")}
    for name, v in innovations.items():
        on = np.flatnonzero(np.isfinite(v))
        for sign, words in ((1, "above"), (-1, "below")):
            increments[f"{name} {words} its prediction"] = (
                on, sign * DETECTION.shift * v[on] - DETECTION.shift**2 / 2, "mean")
    return {name: (at, cusum(values) / threshold(kind, len(at), share))
            for name, (at, values, kind) in increments.items() if len(at)}


def cusum(increments: Array) -> Array:
    """S_i = max(0, S_(i-1) + increment_i) of increments (n,): the cumulated sum above its lowest value so far."""
    total = np.cumsum(increments)
    return np.asarray(total - np.minimum(np.minimum.accumulate(total), 0.0))


def threshold(kind: str, samples: int, rate: float) -> float:
    """The threshold that a sum of the `size` or of the `mean` exceeds within so many samples with the probability `rate`, or
    with a little less: it is computed for a number of samples that is rounded up to two digits, so that records of similar
    length share it."""
    digit = 10 ** max(0, len(str(samples)) - 2)
    rounded = -(-samples // digit) * digit
    return _threshold(kind, rounded, rate)


@lru_cache(maxsize=256)
def _threshold(kind: str, samples: int, rate: float) -> float:
    low, high = 0.0, 1.0
    while alarm_rate(kind, samples, high) > rate:
        low, high = high, 2 * high
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if alarm_rate(kind, samples, middle) > rate else (low, middle)
        if high - low < 1e-3 * high:
            break
    return high


def alarm_rate(kind: str, samples: int, limit: float) -> float:
    """The probability that a sum exceeds a limit within so many samples without a change, by the Markov chain of Brook and
    Evans."""
    distribution = _distribution(kind)
    m = DETECTION.cells
    width = float(2 * limit / (2 * m - 1))  # of a cell; the first one, of half the width, holds the sum zero
    places: Array = np.arange(m, dtype=np.float64) * width
    between = distribution(places[None, :] - places[:, None] + width / 2) - \
        distribution(places[None, :] - places[:, None] - width / 2)
    between[:, 0] = distribution(np.asarray(width / 2 - places, float))
    staying = np.eye(m)[0]
    power, exponent = between, samples
    while exponent:
        if exponent & 1:
            staying = staying @ power
        exponent >>= 1
        power = power @ power if exponent else power
    return float(1 - staying.sum())


def _distribution(kind: str) -> Callable[[Array], Array]:
    """The distribution function of an increment without a change."""
    from scipy.special import chdtr, ndtr

    if kind == "mean":
        return lambda x: np.asarray(ndtr((x + DETECTION.shift**2 / 2) / DETECTION.shift), float)
    slope, step = (1 - DETECTION.scale**-2) / 2, float(np.log(DETECTION.scale))
    return lambda x: np.asarray(chdtr(1, np.maximum((x + step) / slope, 0.0).astype(np.float64)), float)
