"""Outliers in the samples of one channel, and the resolution of a quantised sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
HALF = 4  # regular samples used on each side of suspects
BEYOND = 6.0  # standard deviations
WIDE = 51  # samples over which the scale is taken
LONGEST = 8  # consecutive suspects: four outliers and the neighbours that they affect
SPARSE = 8
LEAST = 20
PASSES = 4
NORMAL = 1.4826022185056018  # standard deviation over median absolute deviation of a normal distribution


def outliers(time: Array, y: Array, scatter: float) -> NDArray[np.bool_]:
    """Outliers among the samples (n,) at increasing times (n,), by prediction from their neighbours.

    1. A cubic through the two neighbours on each side predicts a sample; the difference, divided by its standard deviation
    for white noise of 1, is e_i. A sample is suspect if |e_i| > 6 s_i with s_i the larger of `scatter` (noise or
    resolution of the sensor, in the unit of y) and 1.48 median |e| of the 51 samples around.
    2. One outlier makes its neighbours suspect too. Among up to 8 consecutive suspects, a sample is an outlier if it
    differs from a cubic through the samples on both sides by more than 6 s, more than half of the largest difference, and
    more than three times any step between the four regular samples on each side, which excludes bends. Edges, at which
    suspects lead steadily from one side to the other, are excluded as well.
    3. Repeat without the outliers, up to four times.

    A longer burst is an event, not an outlier; a true peak of 1 to 4 samples from rest is flagged. Samples next to a
    gap, and channels of fewer than 20 samples, are not tested. The scale is from F. R. Hampel, J. Amer. Statist. Assoc.
    69 (1974) 383-393, doi 10.1080/01621459.1974.10482962.
    """
    mask = np.zeros(len(y), dtype=bool)
    for _ in range(PASSES):
        remaining = np.flatnonzero(~mask)
        if len(remaining) < LEAST:
            break
        new = _one_pass(time[remaining], y[remaining], scatter)
        if not len(new):
            break
        mask[remaining[new]] = True
    return mask


def _one_pass(t: Array, y: Array, scatter: float) -> NDArray[np.int64]:
    # difference of each sample from the cubic through its four neighbours, in standard deviations of white noise of 1; 0
    # next to gaps
    n = len(y)
    first = np.clip(np.arange(n) - 2, 0, n - 5)
    neighbours = first[:, None] + np.arange(5)
    # the four neighbours without the sample
    neighbours = np.sort(np.where(neighbours == np.arange(n)[:, None], n, neighbours), axis=1)[:, :4]
    weights = _cubic(t[neighbours], t)
    e = (y - np.sum(weights * y[neighbours], axis=1)) / np.sqrt(1 + np.sum(weights**2, axis=1))
    span = t[neighbours[:, -1]] - t[neighbours[:, 0]]
    e = np.asarray(np.where(span > 2.5 * np.median(span), 0.0, e))
    width = min(WIDE, len(e))
    # every eighth window is enough, and a long record fits into memory
    some = np.median(np.lib.stride_tricks.sliding_window_view(np.abs(e), width)[::SPARSE], axis=1)
    nearest = np.round((np.arange(len(e)) - width // 2) / SPARSE).astype(int)
    spread = NORMAL * some[np.clip(nearest, 0, len(some) - 1)]
    # the residual of a cubic for a nearly constant channel is rounding
    scale = np.maximum(spread, max(scatter, 1e-9 * float(np.ptp(y)), 1e-14 * float(np.abs(y).max())))
    suspects = np.flatnonzero(np.abs(e) > BEYOND * scale)
    runs = np.split(suspects, np.flatnonzero(np.diff(suspects) > 2) + 1) if len(suspects) else []
    worst = [_worst(t, y, np.arange(run[0], run[-1] + 1), float(scale[run].max())) for run in runs
             if run[-1] - run[0] < LONGEST]
    return np.concatenate([np.zeros(0, dtype=np.int64), *worst])


def _cubic(nodes: Array, at: Array) -> Array:
    """Lagrange's weights (m, 4) of the cubics through four nodes (m, 4), at one time each (m,)."""
    weights = np.ones_like(nodes)
    for k in range(4):
        for j in range(4):
            if j != k:
                weights[:, k] *= (at - nodes[:, j]) / (nodes[:, k] - nodes[:, j])
    return weights


def _worst(t: Array, y: Array, run: NDArray[np.int64], scale: float) -> NDArray[np.int64]:
    """The outliers among consecutive suspects, judged by the regular samples on both sides."""
    before, after = np.arange(max(0, run[0] - HALF), run[0]), np.arange(run[-1] + 1, min(len(y), run[-1] + 1 + HALF))
    if len(before) + len(after) < HALF:
        return run[:0]
    # two on each side; at the ends of a record all from one
    before_count = min(len(before), max(2, 4 - len(after)))
    nodes = np.concatenate([before[len(before) - before_count:], after[:4 - before_count]])
    tiled = np.tile(t[nodes], (len(run), 1))
    apart = np.abs(y[run] - _cubic(tiled, t[run]) @ y[nodes])
    steps = np.abs(np.concatenate([np.diff(y[before]), np.diff(y[after])]))
    across = np.diff(y[np.concatenate([before[-1:], run, after[:1]])])
    if np.all(across > -BEYOND * scale) or np.all(across < BEYOND * scale):
        return run[:0]
    far = max(BEYOND * scale, 3 * float(steps.max()), float(apart.max()) / 2)
    return np.asarray(run[apart > far], dtype=np.int64)


def step_of(y: Array) -> float:
    """The resolution of a sensor whose readings y (n,) are all multiples of one step, in the unit of y; 0 otherwise.

    Conditions: at least three different readings, each occurring three times on average, whose distances up to ten
    steps are integers within 5 %.
    """
    readings = np.unique(y)
    if not 3 <= len(readings) <= len(y) / 3:
        return 0.0
    apart = np.diff(readings)
    apart = apart[apart > 1e-6 * (readings[-1] - readings[0])]  # closer ones differ by rounding
    least = float(apart.min())
    step = float(np.mean(apart[apart < 1.5 * least]))
    near = apart[apart < 10.5 * step] / step
    return step if np.all(np.abs(near - np.round(near)) < 0.05) else 0.0
