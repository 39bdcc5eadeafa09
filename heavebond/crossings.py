"""Where a condition becomes true between two points of a run, from its indicator and its rate at both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heavebond.dae import Array

# Shares of an interval at which the cubic through both ends is looked at: an indicator that is positive there only.
INSIDE = np.arange(1, 8) / 8
SOON = tuple(8.0**-k for k in range(1, 15))  # shares of an interval at which one is looked for that falls at its begin
MOST_TRIALS = 80  # a bracket is halved to rounding in some 50

# indicator and rate at a time of the interval, found by integration
Indicator = Callable[[float], tuple[float, float]]


@dataclass(frozen=True)
class Suspects:
    """Intervals (n_c, n) in which each condition surely or possibly becomes true, and the cubics at INSIDE (n_c, n, 7)."""

    certain: NDArray[np.bool_]
    possible: NDArray[np.bool_]
    inside: Array

    @property
    def intervals(self) -> list[int]:
        """The intervals with a suspect, in order."""
        return np.flatnonzero((self.certain | self.possible).any(axis=0)).tolist()


def suspects(t: Array, indicators: Array, rates: Array, true: NDArray[np.bool_]) -> Suspects:
    """Look at the intervals between times t (n+1,); indicators and rates (n_c, n+1), `true` (n_c,) at the first time.

    Between two points an indicator is taken as the cubic with its values and rates, so that one that is positive in
    between only is suspected too.
    """
    left, right = indicators[:, :-1] > 0, indicators[:, 1:] > 0
    left[:, 0] = true
    h = np.diff(t)[None, :, None]
    s = INSIDE[None, None, :]
    value = (1 + 2 * s) * (1 - s)**2 * indicators[:, :-1, None] + s**2 * (3 - 2 * s) * indicators[:, 1:, None]
    inside = value + h * (s * (1 - s)**2 * rates[:, :-1, None] + s**2 * (s - 1) * rates[:, 1:, None])
    rising, falling = (inside > 0).any(axis=2), (inside < 0).any(axis=2)
    return Suspects(~left & right, (~left & ~right & rising) | (left & right & falling), inside)


def crossing(indicator: Indicator, begin: float, end: float, first: float, inside: Array, certain: bool, precision: float
             ) -> float | None:
    """The time at which an indicator passes zero upwards between two times, None where it turns out not to.

    `first` is its value at the begin (above zero: it falls at once), `inside` the cubic's; `certain` says that it is above
    zero at the end. Newton's method, kept in a bracket that is halved where it does not converge.
    """
    low, high = begin, end
    if first >= 0:
        # it may be below zero for a very short time only, as a body that hardly leaves the ground
        shares = [float(INSIDE[int(np.argmin(inside))]), *SOON] if certain else [float(INSIDE[int(np.argmin(inside))])]
        low = next((t for share in shares if indicator(t := begin + (end - begin) * share)[0] < 0), begin)
        if low == begin:
            return begin if certain else None
    elif not certain:
        high = begin + (end - begin) * float(INSIDE[int(np.argmax(inside))])
        if indicator(high)[0] <= 0:
            return None
    t, precision = (low + high) / 2, max(precision, float(np.spacing(max(abs(begin), abs(end)))))
    for _ in range(MOST_TRIALS):
        value, rate = indicator(t)
        low, high = (low, t) if value > 0 else (t, high)
        step = -value / rate if rate > 0 else np.inf
        if abs(step) <= precision or high - low <= precision:
            return t
        t = t + step if low < t + step < high else (low + high) / 2
    return high
