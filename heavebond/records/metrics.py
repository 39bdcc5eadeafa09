"""How far a model is from a record: pure functions of the measured `y` (n,) and the model's `ym` (n,)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
MIN_SAMPLES = 10
MAX_ORDER = 8
_CLIP = 2.5


def rms_error(y: Array, ym: Array) -> float:
    """sqrt(mean((y - ym)**2)), in the unit of y."""
    return _rms(y - ym)


def normalised_rms(y: Array, ym: Array) -> float:
    """rms error / rms of y about its mean: 0 is perfect, 1 as good as the mean; NaN where y is constant."""
    return _ratio(_rms(y - ym), float(np.std(y)) if np.ptp(y) else 0.0)  # of equal numbers the mean is not quite the number


def fit_percent(y: Array, ym: Array) -> float:
    """100 * (1 - normalised rms error): 100 is perfect, 0 as good as the mean of y, below 0 worse."""
    return 100.0 * (1.0 - normalised_rms(y, ym))


def relative_rms(y: Array, ym: Array) -> float:
    """The rms error over the rms of y itself; NaN where y is zero throughout."""
    return _ratio(_rms(y - ym), _rms(y))


def bias(y: Array, ym: Array) -> float:
    """mean(y - ym): positive where the model is too low on average."""
    return float(np.mean(y - ym))


def chi2_per_sample(y: Array, ym: Array, noise: float) -> float:
    """mean(((y - ym) / noise)**2), 1 where nothing but noise of that standard deviation is left.

    Infinite where an error is left without any noise.
    """
    error = _rms(y - ym)
    if noise == 0:
        return math.inf if error else 0.0
    return (error / noise) ** 2


def autocorrelation(e: Array, lags: int) -> Array:
    """r_k = sum_i e_i e_(i+k) / sum_i e_i**2 about the mean of e, k = 0 .. lags: (lags + 1,).

    NaN for a constant. White noise of n samples has r_k within 2/sqrt(n) for 19 of 20 lags k > 0.
    """
    e = np.asarray(e, dtype=np.float64) - np.mean(e)
    total = float(e @ e)
    return np.array([_ratio(float(e[:len(e) - k] @ e[k:]), total) for k in range(lags + 1)])


def whiteness(e: Array, lags: int | None = None) -> float:
    """p value of the Ljung-Box test: small where e is not white noise about its mean.

    Q = n (n + 2) sum_k r_k**2 / (n - k) is compared with chi-square of `lags` (min(20, n/5)) degrees of
    freedom. An offset is no part of it: see `bias`. NaN for a constant and for no more than `lags` samples.

    G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297-303, doi 10.1093/biomet/65.2.297.
    """
    from scipy.special import chdtrc

    n = len(e)
    lags = max(1, min(20, n // 5)) if lags is None else lags
    if n <= lags:
        return math.nan
    r = autocorrelation(e, lags)[1:]
    q = n * (n + 2) * float(np.sum(r**2 / (n - np.arange(1, lags + 1))))
    return float(chdtrc(lags, q))


def estimate_noise(y: ArrayLike, time: ArrayLike) -> float:
    """Standard deviation of the white noise in a record, from the record alone, in the unit of y.

    Within k + 1 neighbouring samples a smooth signal is nearly a polynomial of degree k - 1, which the
    divided difference of order k removes; with weights of unit norm what is left has the variance of the
    noise:
        d_i = sum_j w_ij y_(i+j),  w_ij ~ 1 / prod_(m != j) (t_(i+j) - t_(i+m)),  sum_j w_ij**2 = 1
    for any spacing of the times (n,), which must increase. k = 2 is the pseudo-residual of Gasser et al.
    The spread of d is taken robustly (median, then the rms within 2.5 deviations), so that a few knocks
    do not count. What is left of a signal of angular frequency w sampled each h falls as (w h)**k, so the
    estimate is the first of the orders 2 .. 8 that no higher order lowers beyond chance.

    It is too high where the signal itself moves much from one sample to the next: a sine of s samples a
    period leaves 1.6 sin(pi/s)**8 of its amplitude (10 % at 4, 0.6 % at 6, 0.01 % at 10). Only what is
    white counts as noise: of noise that is correlated over several samples little is seen. A sensor that
    counts steps is given nearly step/sqrt(12); stretches in which it stands still or is clipped are left
    out. NaN for fewer than 10 samples or a constant record.

    T. Gasser, L. Sroka, C. Jennen-Steinmetz, Biometrika 73 (1986) 625-633, doi 10.1093/biomet/73.3.625;
    higher orders: P. Hall, J. W. Kay, D. M. Titterington, Biometrika 77 (1990) 521-528,
    doi 10.1093/biomet/77.3.521.
    """
    y, time = np.asarray(y, dtype=np.float64), np.asarray(time, dtype=np.float64)
    if len(y) < MIN_SAMPLES or not np.ptp(y):
        return math.nan
    spreads = [_spread(d) for d in _pseudo_residuals(y - np.mean(y), time, MAX_ORDER)]
    chance = 1.0 + max(0.02, 2.0 / math.sqrt(len(y)))
    return next(s for k, s in enumerate(spreads) if s <= chance * min(spreads[k:]))


def _pseudo_residuals(y: Array, time: Array, orders: int) -> Iterator[Array]:
    """The normalised divided differences of order 2 .. `orders`."""
    steps = np.diff(time)
    t = (time - time[0]) / np.median(steps)
    weights = np.ones((len(y), 1))
    for k in range(1, orders + 1):
        # f[i .. i+k] = (f[i+1 .. i+k] - f[i .. i+k-1]) / (t_(i+k) - t_i), kept as weights on the samples
        wider = np.zeros((len(weights) - 1, k + 1))
        wider[:, 1:] += weights[1:]
        wider[:, :-1] -= weights[:-1]
        weights = wider / (t[k:] - t[:-k])[:, None]
        if k < 2:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(y, k + 1)
        yield np.sum(weights * windows, axis=1) / np.sqrt(np.sum(weights**2, axis=1))


def _spread(d: Array) -> float:
    """Standard deviation of d (mean 0) despite outliers: the median, then three passes of a clipped rms."""
    # zero to rounding: a sensor that stands still or counts steps tells nothing about noise there
    d = d[np.abs(d) > 1e-9 * _rms(d)]
    if not len(d):
        return 0.0
    spread = float(np.median(np.abs(d))) / 0.6744897501960817  # the median of |normal|
    density = math.exp(-_CLIP**2 / 2) / math.sqrt(2 * math.pi)
    inside = 1 - 2 * _CLIP * density / math.erf(_CLIP / math.sqrt(2))  # variance of a normal cut at +-2.5
    for _ in range(3):
        kept = d[np.abs(d) <= _CLIP * spread]
        spread = _rms(kept) / math.sqrt(inside)
    return spread


def _rms(e: Array) -> float:
    return math.sqrt(float(np.mean(np.square(e))))


def _ratio(over: float, under: float) -> float:
    return over / under if under else math.nan
