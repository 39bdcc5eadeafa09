"""Which models predict as well as the best: the model confidence set.

From the losses of several models on the same samples, those are left out one after the other whose mean loss is
significantly larger than that of another one, until the hypothesis that all that remain predict equally well is no longer
rejected at the level alpha: the set then holds the best model with probability 1 - alpha. The statistic is the largest
t value of all pairs; its distribution, and the standard errors, come of a stationary bootstrap of blocks of random length,
which keeps the correlation of the losses along time; they are corrected for the share of the variance that blocks miss.
Blocks do not cross the borders of stretches.

P. R. Hansen, A. Lunde, J. M. Nason, The model confidence set, Econometrica 79, 2011, doi:10.3982/ECTA5771; D. N. Politis,
J. P. Romano, The stationary bootstrap, 1994, doi:10.1080/01621459.1994.10476870; block length after D. N. Politis, H. White,
2004, doi:10.1081/ETC-120028836, with the correction of A. Patton, D. N. Politis, H. White, 2009,
doi:10.1080/07474930802459016.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heavebond.diagnosis.decision import DECISION
from heavebond.numerics.dae import Array

MISSING = 0.5  # share of the variance that a correction may add at most
LARGEST = 3  # a block is no longer than this part of the mean stretch


@dataclass(frozen=True)
class ConfidenceSet:
    """p: the p value of each of m models (m,): those with at least the level are in the set; best: the share of resamples
    in which each has the smallest mean loss (m,); blocks: how many independent blocks the samples are worth."""

    p: Array
    best: Array
    blocks: float

    def __contains__(self, k: object) -> bool:
        return isinstance(k, int) and bool(self.p[k] >= DECISION.level)


def confidence_set(losses: Array, counts: Array, stretch: NDArray[np.int64], draws: int = DECISION.draws,
                   seed: int = 0) -> ConfidenceSet:
    """The set for m models: `losses` (m, k) are sums over bins of `counts` (k,) samples, `stretch` (k,) the number of the
    uninterrupted stretch of each bin (bins of one stretch are neighbours)."""
    m = len(losses)
    samples = float(counts.sum())
    means = losses.sum(axis=1) / samples
    if m == 1:
        return ConfidenceSet(np.ones(1), np.ones(1), np.nan)
    first = int(np.argmin(means))
    differences = [losses[k] - losses[first] for k in range(m) if k != first]
    length, missing = np.max([block_length(d - d.sum() / samples * counts, stretch) for d in differences], axis=0)
    weights = resampled(stretch, length, draws, np.random.default_rng(seed))
    drawn = (weights @ losses.T) / (weights @ counts)[:, None]
    best = np.bincount(np.argmin(drawn, axis=1), minlength=m) / draws
    gap = means[:, None] - means[None, :]
    off = (drawn[:, :, None] - drawn[:, None, :]) - gap
    error = np.sqrt(np.mean(off**2, axis=0))
    scale = np.where(error > 0, error, np.inf)
    t, chance = gap / scale * np.sqrt(1 - missing), np.abs(off) / scale
    t[(error == 0) & (gap > 0)] = np.inf
    p, left, largest = np.ones(m), list(range(m)), 0.0
    while len(left) > 1:
        inside = np.ix_(left, left)
        worst = t[inside].max(axis=1)
        k = left[int(np.argmax(worst))]
        largest = max(largest, float(np.mean(chance[:, inside[0], inside[1]].max(axis=(1, 2)) >= worst.max())))
        p[k] = largest
        left.remove(k)
    return ConfidenceSet(p, best, len(stretch) / length)


def resampled(stretch: NDArray[np.int64], length: float, draws: int, random: np.random.Generator) -> Array:
    """How often each bin is drawn in each resample (draws, k): blocks of geometric lengths of this mean, which go on at the
    beginning of their stretch where they pass its end."""
    found = np.zeros((draws, len(stretch)))
    for begin, end in stretches(stretch):
        n = end - begin
        fresh = random.random((draws, n)) < 1 / max(1.0, min(length, n))
        fresh[:, 0] = True
        last = np.maximum.accumulate(np.where(fresh, np.arange(n), 0), axis=1)
        start = random.integers(0, n, (draws, n))
        index = (np.take_along_axis(start, last, axis=1) + np.arange(n) - last) % n
        flat = (np.arange(draws)[:, None] * n + index).ravel()
        found[:, begin:end] = np.bincount(flat, minlength=draws * n).reshape(draws, n)
    return found


def stretches(stretch: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Where each stretch begins and ends."""
    edges = [0, *(np.flatnonzero(np.diff(stretch)) + 1).tolist(), len(stretch)]
    return list(pairwise(edges))


def block_length(x: Array, stretch: NDArray[np.int64]) -> tuple[float, float]:
    """The mean length b of blocks for a series (k,) of mean zero that is best for the variance of its mean, and the share
    of this variance that the bootstrap then misses to first order, G/(b g) + b/k with g the spectrum at zero and G the sum
    of |lag| times the autocovariance (S. N. Lahiri, 1999, doi:10.1214/aos/1018031117)."""
    parts = [x[begin:end] for begin, end in stretches(stretch)]
    n = len(x)
    most = max(1.0, n / len(parts) / LARGEST)
    limit, enough = int(min(np.ceil(most), n - 1)), max(5, int(np.ceil(np.sqrt(np.log10(n)))))
    R = np.array([sum(float(part[lag:] @ part[:len(part) - lag]) for part in parts if len(part) > lag) / n
                  for lag in range(limit + enough + 1)])
    if R[0] <= 0:
        return 1.0, 0.0
    small = np.abs(R / R[0]) < 2 * np.sqrt(np.log10(n) / n)
    quiet = next((lag for lag in range(1, limit + 1) if small[lag:lag + enough].all()), limit)
    lags = np.arange(1, min(2 * quiet, len(R) - 1) + 1)
    taper = np.clip(2 * (1 - lags / (2 * quiet)), 0, 1)
    G, spectrum = 2 * np.sum(taper * lags * R[lags]), R[0] + 2 * np.sum(taper * R[lags])
    if spectrum == 0:
        return most, MISSING
    length = float(np.clip((G**2 / spectrum**2 * n) ** (1 / 3), 1.0, most))
    return length, float(np.clip(G / spectrum / length, 0.0, MISSING) + min(length / n, MISSING) / 2)
