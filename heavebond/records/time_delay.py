"""The constant delay between a model and a measured channel."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

Array = NDArray[np.float64]
BLOCKS = 16  # intervals that are omitted one after the other for the standard error
STEPS = 30
SURE = 4.0  # standard errors
WORTH = 0.1  # share of a sample interval
EXPLAINS = 0.02  # share of the squared error


@dataclass(frozen=True)
class TimeDelay:
    """seconds: delay of the channel after the model; deviation: its standard error; share: relative decrease of the
    squared error if the model is delayed by it, with free gain and offset; before, rest: the rms error without and
    with the delay, with the given gain and offset, in the channel's unit; interval: the channel's median sample
    interval, s."""

    seconds: float
    deviation: float
    share: float
    before: float
    rest: float
    interval: float

    @property
    def noticeable(self) -> bool:
        """True if it is significant, longer than a tenth of a sample interval, and reduces the error."""
        return abs(self.seconds) > max(SURE * self.deviation, WORTH * self.interval) and self.share > EXPLAINS

    def explains(self, noise: float, *, fitted: bool = True) -> bool:
        """True if a delay explains nearly the whole error: the remainder is near the noise, or a twentieth of the
        squares. Before the parameters are `fitted`, whose errors shift phases too, a residual near the noise shows
        nothing."""
        return self.noticeable and ((fitted and self.rest < 1.5 * noise) or self.rest**2 < 0.05 * self.before**2)


def lateness(time: Array, measured: Array, grid: Array, model: Array) -> TimeDelay | None:
    """The delay s for which the model m, known at the times `grid` (N,), fits `measured` (n,) at `time` (n,) best:

        measured(t) = a + b m(t - s) + residual,   by Gauss-Newton steps of the regression on 1, m(t - s), -m'(t - s)

    with m a cubic spline. Offset a and gain b are free so that their errors are not taken for a delay. The standard error
    is a jackknife over 16 intervals, because the residual of a wrong model is not white noise. None if the model is
    constant, is not similar to the channel, or if no delay is found within half the time scale of the model. Missing
    physics shifts phases too: a delay is a similarity, not a proof.

    J. Shao, D. Tu, The Jackknife and Bootstrap, Springer, 1995, section 9.1 (blocks of dependent data).
    """
    from scipy.interpolate import CubicSpline

    size, span = float(np.std(model)), float(grid[-1] - grid[0])
    if len(time) < 3 * BLOCKS or size <= 1e-9 * float(np.max(np.abs(model))):
        return None
    curve = CubicSpline(grid, model)
    slope = curve.derivative()
    scale = size / max(float(np.sqrt(np.mean(slope(grid) ** 2))), 1e-300)  # 1/omega of the model's motion
    delay = 0.0
    for _ in range(STEPS):
        correction = _regression(time, measured, curve, slope, delay)
        if correction is None:
            return None
        step = float(np.clip(correction[0], -scale / 2, scale / 2))
        delay += step
        if abs(delay) > min(2 * scale, span / 4):
            return None
        if abs(step) < 1e-3 * correction[1] + 1e-9 * scale:
            (before, fitted), (delayed_error, delayed_fitted) = (_rms_errors(time, measured, curve, at, delay)
                                                                 for at in (0.0, delay))
            return TimeDelay(delay, correction[1], 1 - (delayed_fitted / fitted) ** 2 if fitted else 0.0, before,
                             delayed_error,
                             float(np.median(np.diff(time))))
    return None


def _inside(time: Array, curve: PPoly, *delays: float) -> NDArray[np.bool_]:
    first, last = curve.x[0], curve.x[-1]
    inside = np.ones(len(time), dtype=bool)
    for delay in delays:
        inside &= (time - delay >= first) & (time - delay <= last)
    return inside


def _regression(time: Array, measured: Array, curve: PPoly, slope: PPoly, delay: float) -> tuple[float, float] | None:
    """Correction of the delay, and its standard error."""
    inside = _inside(time, curve, delay)
    t, y = time[inside] - delay, measured[inside]
    if len(t) < 3 * BLOCKS:
        return None
    columns = np.column_stack([np.ones(len(t)), curve(t), -slope(t)])
    sizes = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    columns = columns / sizes
    edges = np.linspace(0, len(t), BLOCKS + 1).astype(int)
    squares = [columns[a:b].T @ columns[a:b] for a, b in pairwise(edges)]
    products = [columns[a:b].T @ y[a:b] for a, b in pairwise(edges)]
    whole, right = np.sum(squares, axis=0), np.sum(products, axis=0)
    if np.linalg.cond(whole) > 1e12:
        return None

    def seconds(square: Array, product: Array) -> float:
        _, gain, late = np.linalg.lstsq(square, product, rcond=None)[0] / sizes
        return float(late / gain) if gain > 0.1 else np.nan

    correction = seconds(whole, right)
    parts = np.array([seconds(whole - s, right - p) for s, p in zip(squares, products, strict=True)])
    if not np.isfinite(correction) or not np.all(np.isfinite(parts)):
        return None
    return correction, float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((parts - np.mean(parts)) ** 2)))


def _rms_errors(time: Array, measured: Array, curve: PPoly, delay: float, other_delay: float) -> tuple[float, float]:
    """The rms error at a delay, over the samples within the range of both delays: with the given offset and gain, and
    with fitted ones.
    """
    inside = _inside(time, curve, delay, other_delay)
    y, model = measured[inside], curve(time[inside] - delay)
    columns = np.column_stack([np.ones(len(model)), model])
    residual = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(np.sqrt(np.mean((y - model) ** 2))), float(np.sqrt(np.mean(residual**2)))
