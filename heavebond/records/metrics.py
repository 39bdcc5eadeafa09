"""Error metrics between a record and a model: pure functions of the measured `y` (n,) and the model's `ym` (n,)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# The distribution of Q (see `whiteness`) is sampled for records of fewer samples than LONG, above which chi-square is
# accurate to a tenth at p values of a few in a thousand; and only if chi-square is inconclusive: far outside of DOUBTFUL no
# level of significance is near for any tail.
LONG, DOUBTFUL = 1000, (1e-6, 0.2)
# number of sequences: in all, in a batch, and with a larger Q after which sampling ends
DRAWS, AT_ONCE, ENOUGH = 20_000, 1000, 100


def rms_error(y: Array, ym: Array) -> float:
    """sqrt(mean((y - ym)**2)), in the unit of y."""
    return _rms(y - ym)


def normalised_rms(y: Array, ym: Array) -> float:
    """rms error / rms of y about its mean: 0 is perfect, 1 as good as the mean; NaN where y is constant."""
    # rounding: the mean of equal numbers may differ from them
    return _ratio(_rms(y - ym), float(np.std(y)) if np.ptp(y) else 0.0)


def fit_percent(y: Array, ym: Array) -> float:
    """100 * (1 - normalised rms error): 100 is perfect, 0 as good as the mean of y, below 0 worse."""
    return 100.0 * (1.0 - normalised_rms(y, ym))


def relative_rms(y: Array, ym: Array) -> float:
    """The rms error divided by the rms of y; NaN if y is zero throughout."""
    return _ratio(_rms(y - ym), _rms(y))


def bias(y: Array, ym: Array) -> float:
    """mean(y - ym): positive if the model is too low on average."""
    return float(np.mean(y - ym))


def chi2_per_sample(y: Array, ym: Array, noise: float) -> float:
    """mean(((y - ym) / noise)**2), 1 if the error is noise of that standard deviation only.

    Infinite if there is an error without any noise.
    """
    error = _rms(y - ym)
    if noise == 0:
        return math.inf if error else 0.0
    return (error / noise) ** 2


def autocorrelation(e: Array, lags: int) -> Array:
    """r_k = sum_i e_i e_(i+k) / sum_i e_i**2 about the mean of e, k = 0 .. lags: (lags + 1,).

    NaN for a constant. White noise of n samples has r_k within 2/sqrt(n) for 19 of 20 lags k > 0.
    """
    if not np.ptp(e):  # rounding: the mean of equal numbers may differ from them
        return np.full(lags + 1, np.nan)
    covariance = _autocovariance(e, lags, len(e) + lags + 1)
    return np.asarray(covariance / covariance[0])


def _autocovariance(e: Array, lags: int, padded: int) -> Array:
    """sum_i e_i e_(i+k) about the mean of e (..., n), k = 0 .. lags: (..., lags + 1), by transforms of `padded` >= n + lags
    points."""
    spectrum = np.fft.rfft(e - e.mean(axis=-1, keepdims=True), padded)
    return np.asarray(np.fft.irfft(np.abs(spectrum)**2, padded)[..., :lags + 1])


def whiteness(e: Array, lags: int | None = None) -> float:
    """p value of the Ljung-Box test: small if e is not white noise about its mean.

    Q = n (n + 2) sum_k r_k**2 / (n - k), k = 1 .. `lags` (min(20, n/5)), follows chi-square of `lags` degrees of freedom
    for large n. Its tail is heavier in short records: of 240 samples 0.6 % have a p value below 0.25 %. There the p value
    is the share of white-noise sequences of the same length whose Q is at least as large, of at most 20 000; sampling ends
    after 100 larger ones, which gives the p value a relative standard deviation of 0.1. An offset has no influence: see
    `bias`. NaN for a constant and for `lags` samples or fewer.

    G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297-303, doi 10.1093/biomet/65.2.297; J. Besag, P. Clifford,
    Sequential Monte Carlo p-values, Biometrika 78 (1991) 301-304, doi 10.1093/biomet/78.2.301.
    """
    from scipy.special import chdtrc

    n = len(e)
    lags = max(1, min(20, n // 5)) if lags is None else lags
    if n <= lags:
        return math.nan
    q = float(portmanteau(autocorrelation(e, lags)[1:], n))
    p = float(chdtrc(lags, q))
    if n >= LONG or not DOUBTFUL[0] < p < DOUBTFUL[1]:
        return p
    larger = 0
    for batch in range(DRAWS // AT_ONCE):
        larger += int(np.sum(_drawn(n, lags, batch) >= q))
        if larger >= ENOUGH:
            return larger / (AT_ONCE * (batch + 1))
    return (larger + 1) / (DRAWS + 1)


def portmanteau(r: Array, n: int) -> Array:
    """Q of the autocorrelations r (..., lags) of n samples from lag 1 on (see `whiteness`)."""
    return np.asarray(n * (n + 2) * np.sum(r**2 / (n - np.arange(1, r.shape[-1] + 1)), axis=-1))


@lru_cache(maxsize=8 * DRAWS // AT_ONCE)
def _drawn(n: int, lags: int, batch: int) -> Array:
    """Q (AT_ONCE,) of sequences of white noise of n samples."""
    from scipy.fft import next_fast_len

    e = np.random.default_rng([n, batch]).standard_normal((AT_ONCE, n))
    covariance = _autocovariance(e, lags, next_fast_len(n + lags, real=True))
    return portmanteau(covariance[:, 1:] / covariance[:, :1], n)


def _rms(e: Array) -> float:
    return math.sqrt(float(np.mean(np.square(e))))


def _ratio(over: float, under: float) -> float:
    return over / under if under else math.nan


@dataclass(frozen=True)
class Statistic:
    """An error measure of a channel, as `compare` computes, prints and stores it.

    name: key in `Channel.statistics` and in JSON; value: function of measured y (n,), model ym (n,), weights (n,) of the
    samples (usual noise over the noise of each sample) and the noise; column: heading in the table of `compare`, empty for
    a measure that is not shown there; form: `unit` for a value in the unit of the channel, `%`, or `1` for a plain number.
    """

    name: str
    value: Callable[[Array, Array, Array, float], float]
    column: str = ""
    form: str = "1"


STATISTICS = (
    Statistic("error", lambda y, ym, weight, noise: rms_error(y, ym), "rms error", "unit"),
    Statistic("normalised", lambda y, ym, weight, noise: normalised_rms(y, ym)),
    Statistic("relative", lambda y, ym, weight, noise: relative_rms(y, ym)),
    Statistic("fit_percent", lambda y, ym, weight, noise: fit_percent(y, ym), "fit", "%"),
    Statistic("bias", lambda y, ym, weight, noise: bias(y, ym), "bias", "unit"),
    Statistic("chi2_per_sample", lambda y, ym, weight, noise: chi2_per_sample(weight * y, weight * ym, noise)),
    Statistic("white_p", lambda y, ym, weight, noise: whiteness(y - ym)))


def statistics(y: Array, ym: Array, weight: Array, noise: float) -> dict[str, float]:
    """All statistics of a channel by name (see `Statistic`)."""
    return {s.name: s.value(y, ym, weight, noise) for s in STATISTICS}
