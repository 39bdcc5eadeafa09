"""Location of the zero crossing of a condition between two points of a run, from its indicator and its rate at both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heavebond.numerics.dae import Array
from heavebond.numerics.event_constants import EVENTS

# Shares of an interval at which the cubic through both ends is looked at, beside its extrema: an indicator that is positive
# there only.
INSIDE = np.arange(1, 8) / 8
SOON = tuple(8.0**-k for k in range(1, 15))  # shares of an interval at which one is looked for that falls at its begin

# indicator and rate at a time of the interval, found by integration
Indicator = Callable[[float], tuple[float, float]]


@dataclass(frozen=True)
class CrossingIntervals:
    """The intervals (n_c, n) in which each condition certainly or possibly becomes true, and the shares of them (n_c, n) at
    which the cubics are highest and lowest."""

    certain: NDArray[np.bool_]
    possible: NDArray[np.bool_]
    highest: Array
    lowest: Array

    @property
    def intervals(self) -> list[int]:
        """The intervals in which some condition may become true, in order."""
        return np.flatnonzero((self.certain | self.possible).any(axis=0)).tolist()


def suspects(t: Array, indicators: Array, rates: Array, true: NDArray[np.bool_]) -> CrossingIntervals:
    """Examine the intervals between times t (n+1,); indicators and rates (n_c, n+1), `true` (n_c,) at the first time.

    Between two points an indicator is interpolated by the cubic with its values and rates. An indicator that is positive
    only between the points is therefore suspected, too.
    """
    true_before, true_after = indicators[:, :-1] > 0, indicators[:, 1:] > 0
    true_before[:, 0] = true
    h = np.diff(t)[None, :]
    a, b, c, d = indicators[:, :-1], indicators[:, 1:], h * rates[:, :-1], h * rates[:, 1:]
    s = np.concatenate([np.broadcast_to(INSIDE, (*a.shape, len(INSIDE))), _extrema(b - a, c, d)], axis=2)
    a, b, c, d = (values[:, :, None] for values in (a, b, c, d))
    inside = (1 + 2 * s) * (1 - s)**2 * a + s**2 * (3 - 2 * s) * b + s * (1 - s)**2 * c + s**2 * (s - 1) * d
    rising, falling = (inside > 0).any(axis=2), (inside < 0).any(axis=2)
    highest, lowest = (np.take_along_axis(s, find(inside, axis=2)[:, :, None], axis=2)[:, :, 0]
                       for find in (np.argmax, np.argmin))
    possible = (~true_before & ~true_after & rising) | (true_before & true_after & falling)
    return CrossingIntervals(~true_before & true_after, possible, highest, lowest)


def _extrema(step: Array, begin: Array, end: Array) -> Array:
    """The shares (n_c, n, 2) at which cubics turn that rise by `step`, with rates `begin` and `end` per interval; 1/2 for
    those that do not turn inside."""
    a, b, c = 3 * (begin + end - 2 * step), 2 * (3 * step - 2 * begin - end), begin
    with np.errstate(all="ignore"):
        # the form that does not cancel
        q = -(b + np.where(b >= 0, 1.0, -1.0) * np.sqrt(b**2 - 4 * a * c)) / 2
        roots = np.stack([q / a, c / q], axis=2)
        return np.where((roots > 0) & (roots < 1), roots, 0.5)


def crossing(indicator: Indicator, begin: float, end: float, first: float, extremes: tuple[float, float], certain: bool,
             precision: float) -> float | None:
    """The time at which an indicator passes zero upwards between two times, None if it does not.

    `first` is its value at the begin (if above zero, it falls below zero first), `extremes` the shares of the interval at
    which the cubic is highest and lowest; `certain` is true if it is above zero at the end. Newton's method, kept in a
    bracket that is halved if it does not converge.
    """
    low, high = begin, end
    if first >= 0:
        # it may be below zero for a very short time only, as a body that hardly leaves the ground
        shares = [extremes[1], *SOON] if certain else [extremes[1]]
        low = next((t for share in shares if indicator(t := begin + (end - begin) * share)[0] < 0), begin)
        if low == begin:
            return begin if certain else None
        if not certain and indicator(end)[0] <= 0:
            # below zero at both ends of what is left: above it between them at most where the cubic is highest
            high = begin + (end - begin) * extremes[0]
            if high <= low or indicator(high)[0] <= 0:
                return None
    elif not certain:
        high = begin + (end - begin) * extremes[0]
        if indicator(high)[0] <= 0:
            return None
    t, precision = (low + high) / 2, max(precision, float(np.spacing(max(abs(begin), abs(end)))))
    for _ in range(EVENTS.crossing_iterations):
        value, rate = indicator(t)
        low, high = (low, t) if value > 0 else (t, high)
        step = -value / rate if rate > 0 else np.inf
        if abs(step) <= precision or high - low <= precision:
            return t
        t = t + step if low < t + step < high else (low + high) / 2
    return high
