"""Times at which the conditions of events are checked; their distances follow the steps of the integrator.

SUNDIALS interpolates within its steps, so that further points cost little. A condition that rises and falls between two
points is detected if the cubic through values and rates shows it. A call of the integrator that takes more than
`EVENTS.steps_per_check` steps between two points fails and is repeated with half of the interval, so that a short fast
motion is not missed. The mean number of steps between two points adjusts the interval of the next call. The first interval
of a call is divided geometrically, as are the first steps of the integrator.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from heavebond.numerics.dae import Array
from heavebond.numerics.event_constants import EVENTS
from heavebond.numerics.idas import MOST_STEPS

FIRST = 4.0 ** np.arange(-EVENTS.first_parts, 0)  # of the first interval of a call


@dataclass(frozen=True)
class Looks:
    """Points of one call of the integrator: times (n,), the last `even` of them equally far apart. With `limited`, the
    integrator fails after `EVENTS.steps_per_check` steps between two of them."""

    times: Array
    even: int
    limited: bool

    @classmethod
    def at(cls, times: Array) -> Looks:
        """Points at equally spaced times, without a limit."""
        return cls(times, len(times), False)

    @classmethod
    def dense(cls, begin: float, end: float, even: int, shortest: float) -> Looks:
        """So many equal intervals from a time to another, the first of them divided; none of them limited that are below
        the shortest."""
        first = (end - begin) / even
        limited = first > shortest
        times = np.append(begin + first * FIRST[:len(FIRST) * limited], begin + first * np.arange(1, even + 1))
        times[-1] = end
        return cls(times, even, limited)

    @property
    def grid(self) -> Array:
        """The begin and the points in units of the equal intervals."""
        points = np.arange(1, self.even + 1.0)
        return np.concatenate([[0.0], points if len(self.times) == self.even else np.append(FIRST, points)])


class LookAhead:
    """The next points of a run: stops; a grid of `EVENTS.min_checks` points if conditions or choices of states need it; with
    `dense`, intervals that follow the steps of the integrator."""

    def __init__(self, stops: Array, same: float, needed: bool, dense: bool, mean_steps: float = EVENTS.mean_steps):
        """`mean_steps` is the mean number of steps of the integrator between two points."""
        self.same, self.dense, self.needed, self.mean_steps = same, dense, needed, mean_steps
        span = float(stops[-1] - stops[0]) or 1.0
        self.base, self.shortest = stops, max(span * EVENTS.shortest_interval, same / FIRST[0])
        if needed:
            times = [stops[:1]]
            for begin, end in pairwise(stops.tolist()):
                parts = max(int(np.ceil((end - begin) / span * EVENTS.min_checks * (1 - 1e-9))), 1)
                times.append(np.append(begin + (end - begin) / parts * np.arange(1, parts), end))
            self.base = np.concatenate(times)
        self.longest = np.inf  # interval between two points in any case
        self.interval, self.widest = np.inf, float(np.diff(self.base).max(initial=0.0))  # between two points
        self.points = self.spent = 0  # steps since the last point of the base
        self.restart(False)

    @property
    def crawling(self) -> bool:
        """Whether the integrator has taken more steps between two points of the grid than it may take between outputs."""
        return self.spent > MOST_STEPS

    def restart(self, cut: bool) -> None:
        """Begin a stretch, with few points where the last was `cut` short or may be."""
        first = EVENTS.first_checks if self.dense else EVENTS.first_stretch
        self.points = first if self.needed or cut else EVENTS.max_stretch
        self.spent = 0

    def coming(self, begin: float, limit: float, halvings: int) -> Looks:
        """The next points, evenly spaced, up to a limit; one nearer point after halvings."""
        first = int(np.searchsorted(self.base, begin + self.same, side="right"))
        times = self.base[first:first + self.points]
        if len(times) < self.points or times[-1] >= limit - self.same:
            times = np.append(times[times < limit - self.same], limit)
        gap = float(times[0]) - begin
        parts = 2 ** int(np.ceil(np.log2(max(gap / min(self.interval, self.longest) * (1 - 1e-9), 1.0))))
        if halvings:
            return Looks.at(np.array([begin + gap / max(parts // self.points, 1) / 2**halvings]))
        if not self.dense:
            return Looks.at(_even(begin, times, self.same))
        if parts > self.points:
            return Looks.dense(begin, begin + gap / parts * self.points, self.points, self.shortest)
        times = _even(begin, times[:self.points // parts], self.same)
        times = times[:2 ** (len(times).bit_length() - 1)]  # few different numbers: each has an integrator of its own
        return Looks.dense(begin, float(times[-1]), len(times) * parts, self.shortest)

    def refine(self, begin: float, looks: Looks, reached: float) -> None:
        """After a call that took too many steps in one of its intervals, the first after `reached` of them: integrate up to
        that point, or with shorter intervals if it is near."""
        if reached >= EVENTS.first_checks / 2:
            self.points = 2 ** (int(reached).bit_length() - 1)
        else:
            self.points = min(self.points, EVENTS.first_checks)
            self.interval = max((float(looks.times[-1]) - begin) / looks.even / EVENTS.growth, self.same)

    def accept(self, begin: float, looks: Looks, steps: int) -> None:
        """Adjust the intervals of the next call to the steps of one that went through, or else double their number."""
        interval = (float(looks.times[-1]) - begin) / looks.even
        passed = np.searchsorted(self.base, looks.times[-1] + self.same) > np.searchsorted(self.base, begin + self.same)
        self.spent = 0 if passed else self.spent + steps
        mean = max(steps - EVENTS.steps_at_begin, 0) / looks.even
        grown = min(self.mean_steps / max(2 * mean, 1e-9), EVENTS.growth)
        if self.dense and mean > self.mean_steps:
            self.interval = max(interval / 2, self.same)  # shorter ones are rounded to none
        elif self.dense and self.interval < np.inf and grown >= 2:
            self.interval = grown * interval if grown * interval < self.widest else np.inf
        else:
            self.points = min(2 * self.points, EVENTS.max_stretch)


def _even(begin: float, times: Array, same: float) -> Array:
    """The leading times with equal distances: all intervals of one call of the integrator have one length, because restarts
    at jumps of inputs are inaccurate otherwise."""
    t = np.append(begin, times)
    odd = np.flatnonzero(np.abs(t - (t[0] + (t[1] - t[0]) * np.arange(len(t)))) > same)
    return times[: odd[0] - 1] if len(odd) else times
