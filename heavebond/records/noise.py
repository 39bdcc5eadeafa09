"""Standard deviation of the white noise of a channel, estimated from its records.

A filter of unit norm passes white noise with its variance, whatever its pass band. Filters that stop the signal therefore
estimate the noise, and the filter with the smallest output is nearest to it. Two families are used:

* divided differences of order k = 2 .. 8, which remove a polynomial of degree k - 1 within k + 1 neighbouring samples, for
any spacing of the times:

    d_i = sum_j w_ij y_(i+j),  w_ij ~ 1 / prod_(m != j) (t_(i+j) - t_(i+m)),  sum_j w_ij**2 = 1

  k = 2 is the pseudo-residual of Gasser et al. The output for a signal of angular frequency w sampled at intervals h falls
  as (w h)**k: they suit signals that are slow compared with the sampling;
* band passes of evenly sampled intervals, which cover the frequencies up to half of the sampling frequency: the discrete
prolate spheroidal sequence with the time-bandwidth product 4, with less than 1e-9 of a variance outside its band, times a
cosine. They measure the floor of the spectrum if a signal is fast and leaves bands free (a resonance that is sampled nine
times per period).

T. Gasser, L. Sroka, C. Jennen-Steinmetz, Biometrika 73 (1986) 625-633, doi 10.1093/biomet/73.3.625; higher orders: P.
Hall, J. W. Kay, D. M. Titterington, Biometrika 77 (1990) 521-528, doi 10.1093/biomet/77.3.521; band passes: D. J.
Thomson, Proceedings of the IEEE 70 (1982) 1055-1096, doi 10.1109/PROC.1982.12433.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
MIN_SAMPLES = 10
ORDERS = range(2, 9)
BANDS = (8, 4)  # number of bands, limited by the length of the longest record
PER_BAND = 16  # coefficients of a filter, times the number of bands
PRODUCT = 4.0
UNEVEN = 0.01  # permitted deviation from even sampling, in sample intervals, on average over the length of a filter
STILL = 0.1  # share of the samples of a filter that may equal the sample before
CHANCE = 4.0  # standard errors
LEVEL = 1.25  # ratio of deviations (2 dB) up to which two bands have the same level
FLAT = 0.5  # share of the frequencies that must exceed this with the same level, for it to be the noise level
_CLIP = 2.5


@dataclass(frozen=True)
class NoiseEstimate:
    """White noise of a channel: `deviation`, in its unit (NaN: not known), its relative standard error, and the share of
    the frequencies in which the spectrum has this level (NaN if the records are too short for a spectrum)."""

    deviation: float
    error: float
    flat: float

    @property
    def words(self) -> str:
        """Explanation if noise and signal cannot be separated."""
        return "its noise cannot be separated from its signal, as the spectrum is nowhere level: the estimated noise, and " \
               "chi-square with it, may be far from right; give `noise:`"

    @property
    def separable(self) -> bool:
        """True if the spectrum has a flat part, as white noise has, so that noise and signal can be separated. Otherwise
        the signal may cover all frequencies (the estimate is too large), or the noise is not white."""
        return not self.flat <= FLAT


@dataclass(frozen=True)
class _Level:
    """The standard deviation of a filter's output and its relative standard error."""

    deviation: float
    error: float


def estimate_noise(records: Sequence[tuple[ArrayLike, ArrayLike]]) -> NoiseEstimate:
    """Estimate the white noise of a channel from its records, readings y (n,) at increasing times (n,) each.

    The standard deviation of a filter's output is estimated from all records together, robustly (median, then the rms
    within 2.5 deviations), so that a few outliers have no influence. The estimate is the lowest order of the differences
    that no higher order reduces significantly, or the median of the bands of lowest level if it is significantly lower.

    Noise that is correlated over several samples is underestimated. For a quantised sensor the result is about
    step/sqrt(12); intervals in which it does not change or is clipped are excluded. NaN if no record has 10 samples or
    all are constant.
    """
    arrays = [(np.asarray(y, dtype=np.float64), np.asarray(t, dtype=np.float64)) for y, t in records]
    usable = [(y - np.mean(y), t) for y, t in arrays if len(y) >= MIN_SAMPLES and np.ptp(y)]
    if not usable:
        return NoiseEstimate(math.nan, math.nan, math.nan)
    # levels of the divided differences, order by order
    differences: list[_Level] = []
    passed = [list(_pseudo_residuals(y, t)) for y, t in usable]
    for k, order in enumerate(ORDERS):
        h = np.array([(-1.0) ** j * math.comb(order, j) for j in range(order + 1)])
        differences.append(_level(np.concatenate([p[k] for p in passed]), h))
    chance = 1.0 + max(0.02, 2.0 / math.sqrt(sum(len(y) for y, _ in usable)))
    estimate = next(s for k, s in enumerate(differences) if s.deviation <= chance
                    * min(x.deviation for x in differences[k:]))
    bands = list(_bands(usable))
    if not bands:
        return NoiseEstimate(estimate.deviation, estimate.error, math.nan)
    lowest = min(bands, key=lambda b: b.deviation)
    # the bands of the same level as the lowest one
    level = [b.deviation for b in bands
             if (b.deviation <= lowest.deviation * max(LEVEL, 1 + CHANCE * math.hypot(b.error, lowest.error)))]
    # the median of several has the standard error of their mean times sqrt(pi/2)
    error = lowest.error * min(1.0, math.sqrt(math.pi / 2 / len(level)))
    floor = _Level(float(np.median(level)), error)
    if floor.deviation * (1 + CHANCE * lowest.error) < estimate.deviation:
        estimate = floor
    return NoiseEstimate(estimate.deviation, estimate.error, len(level) / len(bands))


def _pseudo_residuals(y: Array, time: Array) -> Iterator[Array]:
    """The normalised divided differences of a record."""
    steps = np.diff(time)
    t = (time - time[0]) / np.median(steps)
    weights = np.ones((len(y), 1))
    for k in range(1, ORDERS[-1] + 1):
        # f[i .. i+k] = (f[i+1 .. i+k] - f[i .. i+k-1]) / (t_(i+k) - t_i), kept as weights on the samples
        wider = np.zeros((len(weights) - 1, k + 1))
        wider[:, 1:] += weights[1:]
        wider[:, :-1] -= weights[:-1]
        weights = wider / (t[k:] - t[:-k])[:, None]
        if k in ORDERS:
            windows = np.lib.stride_tricks.sliding_window_view(y, k + 1)
            yield np.sum(weights * windows, axis=1) / np.sqrt(np.sum(weights**2, axis=1))


def _bands(records: Sequence[tuple[Array, Array]]) -> Iterator[_Level]:
    """Levels of the band passes in evenly sampled intervals, from the lowest band to the highest; none for short records."""
    longest = max(len(y) for y, _ in records)
    number = next((n for n in BANDS if longest >= 2 * PER_BAND * n), 0)
    if not number:
        return
    length = PER_BAND * number
    window, k = _prolate(length), np.arange(length)
    even = []
    for y, t in records:
        if len(y) >= length:
            # windows of this length that are evenly spaced, without an interval in which the sensor does not change
            steps = np.diff(t)
            uneven = _sums(np.abs(steps / np.median(steps) - 1), length - 1)
            still = _sums((np.diff(y) == 0).astype(float), length - 1)
            even.append((_Filtered(y), np.asarray((uneven < UNEVEN * (length - 1)) & (still < STILL * (length - 1)))))
    even = [(y, inside) for y, inside in even if inside.any()]
    for band in range(number if even else 0):
        h = window * np.cos(np.pi * (band + 0.5) / number * (k - (length - 1) / 2))
        h /= np.linalg.norm(h)
        yield _level(np.concatenate([y.by(h)[inside] for y, inside in even]), h)


@lru_cache(maxsize=len(BANDS))
def _prolate(length: int) -> Array:
    """The discrete prolate spheroidal sequence of order 0 with the time-bandwidth product: the eigenvector to the largest
    eigenvalue of a tridiagonal matrix (D. Slepian, 1978, doi:10.1002/j.1538-7305.1978.tb02104.x)."""
    from scipy.linalg import eigh_tridiagonal

    k = np.arange(length, dtype=float)
    diagonal = ((length - 1 - 2 * k) / 2)**2 * math.cos(2 * math.pi * PRODUCT / length)
    return np.asarray(eigh_tridiagonal(diagonal, k[1:] * (length - k[1:]) / 2, select="i",
                                       select_range=(length - 1, length - 1))[1][:, 0])


class _Filtered:
    """A signal (n,), transformed once for many filters."""

    def __init__(self, y: Array):
        self.length, self.size = len(y), 1 << (len(y) - 1).bit_length()
        self.spectrum = np.fft.rfft(y, self.size)

    def by(self, h: Array) -> Array:
        """Output of a filter with the coefficients h (m,) within the signal (n - m + 1,)."""
        # wrap-around of the transform affects only samples before the first of these
        return np.asarray(np.fft.irfft(self.spectrum * np.fft.rfft(h, self.size), self.size)[len(h) - 1:self.length])


def _sums(x: Array, length: int) -> Array:
    """Moving sums of so many samples."""
    total = np.cumsum(np.concatenate([[0.0], x]))
    return np.asarray(total[length:] - total[:-length])


def _level(d: Array, h: Array) -> _Level:
    """The standard deviation of a filter's output, with the coefficients h, and its standard error for white noise."""
    h = h / np.linalg.norm(h)
    correlation = np.correlate(h, h, "full")
    return _Level(spread(d), math.sqrt(float(correlation @ correlation) / (2 * len(d))))


def spread(d: Array) -> float:
    """Standard deviation of d (mean 0) despite outliers: the median, then three passes of a clipped rms."""
    # zero up to rounding: a constant or quantised reading has no information on the noise there
    d = d[np.abs(d) > 1e-9 * _rms(d)]
    if not len(d):
        return 0.0
    deviation = float(np.median(np.abs(d))) / 0.6744897501960817  # the median of |normal|
    density = math.exp(-_CLIP**2 / 2) / math.sqrt(2 * math.pi)
    inside = 1 - 2 * _CLIP * density / math.erf(_CLIP / math.sqrt(2))  # variance of a normal cut at +-2.5
    for _ in range(3):
        clipped = d[np.abs(d) <= _CLIP * deviation]
        deviation = _rms(clipped) / math.sqrt(inside)
    return deviation


def _rms(e: Array) -> float:
    return math.sqrt(float(np.mean(np.square(e))))
