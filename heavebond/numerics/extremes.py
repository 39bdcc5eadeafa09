"""Extremes and means of a signal between the points of a run.

A signal is known at times t (n,), in which the time of an event occurs twice, with the values before and after it. Events
divide it into pieces. Within a piece an extreme is taken from the polynomial through five points around the extreme point,
if the curvature of the signal is about equal over these; otherwise, as at a kink, it is the extreme point itself. Integrals
are taken over the cubics through values and slopes at the points, of order 4.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ExtremeConstants:
    """The constants of extremes between points.

    points: points of the polynomial. Origin: at 0.3 rad of an oscillation between two of them the error is 1e-5 of the
        amplitude. Doubled: it oscillates at kinks.
    evenness: least curvature among the five points, as a share of the largest. Origin: a limited signal has no curvature on
        one side of its kink, an oscillation about the same on both. Doubled: extremes of strongly damped motions are taken
        at the points.
    samples: points at which the polynomial is evaluated. Origin: an error of 1e-4 of the excess. Doubled: a quarter of it.
    candidates: local extremes that are refined, at most, the largest of the signal. Origin: time. Doubled: of hundreds of
        equal extremes more are refined.
    """

    points: int = 5
    evenness: float = 0.25
    samples: int = 65
    candidates: int = 20


EXTREMES = ExtremeConstants()


@dataclass(frozen=True)
class SignalFigures:
    """Extremes, mean, root mean square and last value of a signal."""

    least: float
    most: float
    mean: float
    rms: float
    final: float

    def as_dict(self) -> dict[str, float]:
        """The figures of the table of a run."""
        return {"min": self.least, "max": self.most, "rms": self.rms, "final": self.final}


def signal_figures(time: Array, values: Array) -> SignalFigures:
    """The figures of a signal (n,) at times (n,), n > 0, over the times at which it is determined (not NaN); NaN if it
    becomes infinite or is never determined."""
    if (missing := np.isnan(values)).any() and not missing.all():
        # the figures of a signal without its values that are missing (n,)
        edges = np.flatnonzero(np.diff(np.concatenate([[True], missing, [True]]).astype(int)))
        stretches = [slice(begin, end) for begin, end in edges.reshape(-1, 2).tolist()]
        parts = [signal_figures(time[at], values[at]) for at in stretches]
        weights = np.array([time[at][-1] - time[at][0] for at in stretches])
        weights = weights / weights.sum() if weights.any() else np.full(len(parts), 1 / len(parts))
        return SignalFigures(min(p.least for p in parts), max(p.most for p in parts),
                             float(weights @ [p.mean for p in parts]),
                             float(np.sqrt(weights @ [p.rms**2 for p in parts])), float(values[-1]))
    if not np.all(np.isfinite(values)):
        rms = float(np.sqrt(np.mean(values**2)))
        return SignalFigures(float(values.min()), float(values.max()), float(values.mean()), rms, float(values[-1]))
    size = float(np.abs(values).max()) or 1.0  # squares neither overflow nor vanish
    rms = size * max(mean(time, (values / size)**2), 0.0)**0.5
    return SignalFigures(lowest(time, values).of(values), highest(time, values).of(values), mean(time, values), rms,
                         float(values[-1]))


def mean(time: Array, values: Array) -> float:
    """The mean over time of a signal (n,); the mean of its values if all times are equal."""
    length = float(time[-1] - time[0])
    if length == 0:
        return float(values.mean())
    total = 0.0
    for piece in pieces(time):
        t, f = time[piece], values[piece]
        h = np.diff(t)
        total += float(np.sum(h * (f[:-1] + f[1:]))) / 2
        if len(t) > 2:
            total -= float(np.sum(h**2 * np.diff(np.gradient(f, t, edge_order=2)))) / 12
    return total / length


def pieces(time: Array) -> Iterator[slice]:
    """The slices of the pieces between times that occur twice."""
    cuts = np.flatnonzero(np.diff(time) <= 0) + 1
    for begin, end in pairwise([0, *cuts.tolist(), len(time)]):
        yield slice(begin, end)


@dataclass(frozen=True)
class Extreme:
    """An extreme as a sum of weights (k,) times the values at points (k,). Its derivative by a parameter is the same sum of
    derivatives, as the slope over time is zero at the extreme."""

    at: NDArray[np.intp]
    weights: Array

    def of(self, values: Array) -> float:
        """The sum for values (n,)."""
        return float(values[self.at] @ self.weights)

    def along(self, derivatives: Array) -> Array:
        """The sums for values (m, n)."""
        return np.asarray(derivatives[:, self.at] @ self.weights)


def lowest(time: Array, values: Array) -> Extreme:
    """The minimum of a signal (n,)."""
    return highest(time, -values)


def highest(time: Array, values: Array) -> Extreme:
    """The maximum of a signal (n,) at times (n,)."""
    top = int(np.argmax(values))
    best, value = Extreme(np.array([top]), np.ones(1)), float(values[top])
    cuts = np.flatnonzero(np.diff(time) <= 0) + 1
    begins, ends = np.append(0, cuts), np.append(cuts, len(time))
    # local maxima between whose points the signal may exceed the largest value: the excess is at most the difference to the
    # neighbouring values
    before, after = np.append(values[:1], values[:-1]), np.append(values[1:], values[-1:])
    drop = values - np.minimum(before, after)
    candidates = np.flatnonzero((values >= before) & (values >= after) & (values + drop > value) & (drop > 0))
    order = np.argsort(-values[candidates], kind="stable")[:EXTREMES.candidates]
    for k in [int(k) for k in candidates[order]]:
        piece = int(np.searchsorted(cuts, k, side="right"))
        refined = _refined(time, values, k, int(begins[piece]), int(ends[piece]))
        if refined is not None and refined.of(values) > value:
            best, value = refined, refined.of(values)
    return best


def _refined(time: Array, values: Array, k: int, begin: int, end: int) -> Extreme | None:
    """The maximum of the polynomial through the points around a point k of a piece; None if there are too few, or at a
    kink."""
    n = EXTREMES.points
    if end - begin < n:
        return None
    first = min(max(k - n // 2, begin), end - n)
    at = np.arange(first, first + n)
    t = np.linspace(time[max(k - 1, begin)], time[min(k + 1, end - 1)], EXTREMES.samples)
    # the values (n, k) of the Lagrange polynomials of the nodes at these times
    nodes = time[at]
    weights = np.ones((len(nodes), len(t)))
    for j, node in enumerate(nodes):
        other_nodes = np.delete(nodes, j)
        weights[j] = np.prod((t[None, :] - other_nodes[:, None]) / (node - other_nodes)[:, None], axis=0)
    course = (values[at] - values[k]) @ weights
    top = int(np.argmax(course))
    slopes = np.diff(values[at]) / np.diff(time[at])
    bends = np.diff(slopes) / (time[at[2:]] - time[at[:-2]])
    smooth = bends.max() < 0 and bends.max() <= EXTREMES.evenness * bends.min()
    return Extreme(at, weights[:, top]) if course[top] > 0 and smooth else None
