"""Predictive errors of fitted models, and the model confidence set.

Predictive errors are squared whitened residuals of samples that the parameters were not fitted to. On held-out records the
fitted model is used unchanged. On fitted records the errors are cross-validated by blocks of time: block B is predicted by
the parameters fitted to the samples outside B and outside a gap on either side of B, so that correlated residuals do not
carry information into B. No refit is needed. With the residuals r (n,) and their derivatives J (n, m) at the optimum, the
derivatives P of the priors, and B' the block with its gaps, the parameters without B' are to first order

    d = (J'J + P'P)^-1 J_B' 'r_B',      r_B(-B') = r_B + J_B d

(the infinitesimal jackknife: R. Giordano et al., A Swiss Army Infinitesimal Jackknife, AISTATS 2019, arXiv:1806.00550; for
blocks of dependent data P. Burman, E. Chow, D. Nolan, 1994, doi:10.1093/biomet/81.2.351). The normal matrix includes the
block. So a parameter that only one block determines (for example at the single contact with a stop) does not diverge when
this block is left out.

The model confidence set is computed from the losses of several models on the same samples. Models whose mean loss is
significantly larger than the loss of another model are removed one by one, until the hypothesis that all remaining models
predict equally well is no longer rejected at the level alpha. The set then contains the best model with probability 1 -
alpha. The statistic is the largest t value of all pairs. Its distribution and the standard errors are computed by a
stationary bootstrap with blocks of random length, which preserves the correlation of the losses along time. They are
corrected for the share of the variance that blocks miss. Blocks do not cross the borders of stretches.

P. R. Hansen, A. Lunde, J. M. Nason, The model confidence set, Econometrica 79, 2011, doi:10.3982/ECTA5771; D. N. Politis, J.
P. Romano, The stationary bootstrap, 1994, doi:10.1080/01621459.1994.10476870; block length after D. N. Politis, H. White,
2004, doi:10.1081/ETC-120028836, with the correction of A. Patton, D. N. Politis, H. White, 2009,
doi:10.1080/07474930802459016.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, SimulationError, StartError
from heavebond.diagnosis.decision import DECISION
from heavebond.estimation.fitting import own_start
from heavebond.estimation.residuals import BROKEN, Residuals, Run
from heavebond.numerics.dae import Array

MISSING = 0.5  # largest share of the variance that the correction may add
LARGEST = 3  # the mean length of a stretch is at least this many blocks


@dataclass(frozen=True)
class ConfidenceSet:
    """A model confidence set of m models.

    * p: p value of each model (m,); the set contains the models with p >= the significance level.
    * best: share of the resamples in which each model has the smallest mean loss (m,).
    * blocks: number of independent blocks in the samples.
    """

    p: Array
    best: Array
    blocks: float

    def __contains__(self, k: object) -> bool:
        return isinstance(k, int) and bool(self.p[k] >= DECISION.level)


def confidence_set(losses: Array, counts: Array, stretch: NDArray[np.int64], draws: int = DECISION.draws,
                   seed: int = 0) -> ConfidenceSet:
    """Compute the model confidence set of m models.

    `losses` (m, k) are sums over k bins, `counts` (k,) the numbers of samples per bin. `stretch` (k,) is the number of the
    uninterrupted stretch of each bin; bins of one stretch are neighbours.
    """
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
    p, remaining, largest = np.ones(m), list(range(m)), 0.0
    while len(remaining) > 1:
        inside = np.ix_(remaining, remaining)
        worst = t[inside].max(axis=1)
        k = remaining[int(np.argmax(worst))]
        largest = max(largest, float(np.mean(chance[:, inside[0], inside[1]].max(axis=(1, 2)) >= worst.max())))
        p[k] = largest
        remaining.remove(k)
    return ConfidenceSet(p, best, len(stretch) / length)


def resampled(stretch: NDArray[np.int64], length: float, draws: int, random: np.random.Generator) -> Array:
    """Count how often each bin is drawn in each resample of a stationary bootstrap (draws, k).

    The lengths of the blocks are geometric with mean `length`. A block that reaches the end of its stretch continues at the
    beginning of this stretch.
    """
    frequency = np.zeros((draws, len(stretch)))
    for begin, end in stretches(stretch):
        n = end - begin
        fresh = random.random((draws, n)) < 1 / max(1.0, min(length, n))
        fresh[:, 0] = True
        last = np.maximum.accumulate(np.where(fresh, np.arange(n), 0), axis=1)
        start = random.integers(0, n, (draws, n))
        index = (np.take_along_axis(start, last, axis=1) + np.arange(n) - last) % n
        flat = (np.arange(draws)[:, None] * n + index).ravel()
        frequency[:, begin:end] = np.bincount(flat, minlength=draws * n).reshape(draws, n)
    return frequency


def stretches(stretch: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First index and end index of each stretch."""
    edges = [0, *(np.flatnonzero(np.diff(stretch)) + 1).tolist(), len(stretch)]
    return list(pairwise(edges))


def block_length(x: Array, stretch: NDArray[np.int64]) -> tuple[float, float]:
    """Optimal mean length b of the bootstrap blocks of a series, and the share of the variance that the bootstrap misses.

    `x` (k,) has zero mean. The length b minimises the mean squared error of the estimated variance of the mean. The missing
    share is G/(b g) + b/k to first order, with the spectrum g at frequency zero and the sum G of |lag| times the
    autocovariance (S. N. Lahiri, 1999, doi:10.1214/aos/1018031117).
    """
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


FITTED, SELECTION, TEST = 0, 1, 2  # roles of the samples
BINS = 2000  # largest number of bins; neighbouring samples are summed, which does not change the sums of blocks
GAP = 0.5  # largest gap as a share of a block
GAPS = 10  # median distances of samples without a sample that end a stretch


@dataclass(frozen=True)
class PredictiveErrors:
    """Squared whitened prediction errors in consecutive bins of time.

    * sums (k,): sum of the errors in each bin.
    * counts (k,): number of samples in each bin.
    * stretch (k,): number of the uninterrupted stretch of a record to which the bin belongs.
    * role (k,): FITTED (cross-validated), SELECTION or TEST.
    """

    sums: Array
    counts: Array
    stretch: NDArray[np.int64]
    role: NDArray[np.int64]

    def mean(self, *roles: int) -> float:
        """Mean error over the samples of these roles (chi-square per sample); NaN if there are no samples."""
        of = np.isin(self.role, roles)
        samples = float(self.counts[of].sum())
        return float(self.sums[of].sum()) / samples if samples else float("nan")

    def samples(self, *roles: int) -> int:
        """Number of samples of these roles."""
        return int(self.counts[np.isin(self.role, roles)].sum())


def discrepancy(errors: Sequence[PredictiveErrors]) -> Array:
    """Model discrepancy (k,) of each bin, in noise variances: the mean error in its stretch of the model that predicts the
    stretch best, at least 1.

    The errors are given for several models on the same samples. The discrepancy of a good model of a real machine differs
    between records. Without this scale the record that all models predict worst would dominate the comparison.
    """
    counts, stretch = errors[0].counts, errors[0].stretch
    means = np.array([np.bincount(stretch, e.sums) for e in errors]) / np.maximum(np.bincount(stretch, counts), 1)
    return np.asarray(np.maximum(means.min(axis=0), 1.0)[stretch])


def levelled(errors: Sequence[PredictiveErrors]) -> Array:
    """Sums (m, k) of the errors of m models on the same samples, divided by the discrepancy of each stretch."""
    return np.array([e.sums for e in errors]) / discrepancy(errors)


def share_taken(before: PredictiveErrors, after: PredictiveErrors, *roles: int) -> float:
    """Share of the error above the noise that a model removes, compared with the model `before`.

    The share is computed on samples of these roles, with errors divided by the discrepancy of each stretch.
    """
    chosen, level = np.isin(before.role, roles), discrepancy([before, after])
    first, last, noise = (float((x / level)[chosen].sum()) for x in (before.sums, after.sums, before.counts))
    return (first - last) / max(first - noise, 1e-9 * noise)


@dataclass(frozen=True)
class Series:
    """Errors of one record at its N times: sums (N,) over the channels, counts (N,), and their role."""

    sums: Array
    counts: Array
    role: int


def predictive_errors(problem: Residuals, inner: Array, exact: Mapping[str, Run], r: Array,
                      separate_values: Mapping[str, Mapping[str, float]] | None = None) -> PredictiveErrors:
    """Compute the predictive errors of a fit: cross-validated on the fitted samples of each record, then on all samples that
    were not fitted. If the run of a record fails, its samples get a large error.

    `r` (n,) are the residuals on the fitted samples, `exact` are runs of all records. `separate_values` contains the
    separate values of each held-out record; if None, they are fitted.
    """
    if separate_values is None:
        separate_values = own_starts_of(problem, inner, exact)
    ends = np.cumsum([int(run.counts.sum()) for run in problem.runs])[:-1]
    series = [_series(run.counts, part, FITTED)
              for run, part in zip(problem.runs, np.split(cross_validated(problem, inner, r), ends), strict=True)]
    for record in problem.experiment.records.values():
        run, values = exact[record.name], problem.values_of(inner, record.name)
        samples = run.counts if record.use != "fit" else run.checking
        if not samples.any():
            continue
        try:
            residuals = run.held_out({**values, **separate_values.get(record.name, {})})[0]
        except (ModelError, SimulationError, StartError):
            residuals = np.full(int(samples.sum()), BROKEN)
        series.append(_series(samples, residuals, TEST if record.use == "test" else SELECTION))
    return binned(series)


def own_starts_of(problem: Residuals, inner: Array, exact: Mapping[str, Run]) -> dict[str, dict[str, float]]:
    """Fit the separate values (`each: record`) of each held-out record; a record that cannot be simulated is left out."""
    separate_values = {}
    for record in problem.experiment.records.values():
        if record.use != "fit" and exact[record.name].counts.any():
            with suppress(ModelError, SimulationError, StartError):
                values = problem.values_of(inner, record.name)
                separate_values[record.name] = own_start(problem.experiment, record, values, exact[record.name])
    return separate_values


def binned(series: Sequence[Series]) -> PredictiveErrors:
    """Collect several series in bins. A stretch ends where samples are missing for more than `GAPS` median distances
    (held-out blocks, a gap in the record)."""
    total = sum(int((s.counts > 0).sum()) for s in series)
    width = max(1, -(-total // BINS))
    sums, counts, stretches, roles = [], [], [], []
    number = 0
    for s in series:
        sampled = np.flatnonzero(s.counts > 0)
        distances = np.diff(sampled)
        breaks = np.flatnonzero(distances > GAPS * np.median(distances)) + 1 if len(distances) else np.zeros(0, np.int64)
        for part in np.split(sampled, breaks) if len(sampled) else []:
            edges = np.arange(0, len(part), width)
            sums.append(np.add.reduceat(s.sums[part], edges))
            counts.append(np.add.reduceat(s.counts[part], edges))
            stretches.append(np.full(len(edges), number))
            roles.append(np.full(len(edges), s.role))
            number += 1
    if not sums:
        return PredictiveErrors(np.zeros(0), np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64))
    return PredictiveErrors(*(np.concatenate(arrays) for arrays in (sums, counts, stretches, roles)))


def _series(samples: NDArray[np.bool_], r: Array, role: int) -> Series:
    """Sum squared residuals over the channels at each time. `samples` (channels, N) marks the samples; `r` is ordered
    channel by channel."""
    place = np.nonzero(samples)[1]
    with np.errstate(over="ignore", invalid="ignore"):
        squared = np.nan_to_num(np.minimum(r**2, BROKEN**2), nan=BROKEN**2)
    sums = np.bincount(place, squared, samples.shape[1]).astype(float)
    return Series(sums, np.bincount(place, minlength=len(sums)).astype(float), role)


def cross_validated(problem: Residuals, inner: Array, r: Array) -> Array:
    """Residuals (n,) of all fitted samples, each predicted by parameters fitted without its block of time.

    The number of blocks of a record is proportional to its number of samples.
    """
    moving = np.flatnonzero(~problem.at_end(inner))
    if not len(moving):
        return r
    J, priors = problem.evaluate(inner)[1][:, moving], problem.priors(inner)[1][:, moving]
    normal = J.T @ J + priors.T @ priors
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    low, high = (problem.low - inner)[moving], (problem.high - inner)[moving]
    normal, low, high = normal / scale[:, None] / scale, low * scale, high * scale
    predicted = r.copy()
    total, before = problem.samples, 0
    for run in problem.runs:
        place = np.nonzero(run.counts)[1]
        number = max(2, round(DECISION.folds * len(place) / max(total, 1)))
        first, last = int(place.min(initial=0)), int(place.max(initial=0)) + 1
        gap = GAP * (last - first) / number
        for begin, end in pairwise(np.linspace(first, last, number + 1)):
            block = before + np.flatnonzero((place >= begin) & (place < end))
            wide = before + np.flatnonzero((place >= begin - gap) & (place < end + gap))  # the block with its gaps
            if len(block):
                step = _bounded_step(normal, J[wide].T @ r[wide] / scale, low, high) / scale
                predicted[block] = r[block] + J[block] @ step
        before += len(place)
    return predicted


def _bounded_step(normal: Array, gradient: Array, low: Array, high: Array) -> Array:
    """Minimise d'N d/2 - g'd for low <= d <= high (m,), with zero inside.

    Parameters that act alike move together. If one of them reaches an end of its range, the others are determined again,
    because without their counterpart their steps would change the residuals much more than the block did. The residuals
    change by at most twice their size: d'N d <= 4 g'(1/N)g <= 4 |r|**2.
    """
    from scipy.optimize import lsq_linear

    sizes, axes = np.linalg.eigh(normal)
    kept = sizes > 1e-12 * sizes[-1]
    roots, axes = np.sqrt(sizes[kept]), axes[:, kept].T
    return np.asarray(lsq_linear(roots[:, None] * axes, axes @ gradient / roots, (low, high), method="bvls").x)
