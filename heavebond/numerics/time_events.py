"""When the time events of a run happen, from their first instants and periods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, SimulationError
from heavebond.equations.events import FlatEvent
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.event_constants import EVENTS


def same_instant(begin: float, end: float) -> float:
    """The time difference (s) below which two instants of a run are identical."""
    return float(max(EVENTS.same_instant * (end - begin), EVENTS.same_roundings * np.spacing(max(abs(begin), abs(end)))))


def clocks_at(assembly: Assembly, t: float, p: Array) -> Array:
    """The parameters with the values of conditions of the time (see `equations.time_conditions`) at a time."""
    clocks = {held: e for e in reversed(assembly.flat.events) if e.by_clock and (held := e.resets[0].held) is not None}
    if not clocks:
        return p
    time, _, _, symbols, *_ = assembly.arguments
    truth = assembly.once("clocks", lambda: ca.Function("clocks", [time, symbols], [assembly.express(stack(
        e.first <= time if e.indicator is None else e.indicator > 0 for e in clocks.values()))]))
    changed = p.copy()
    changed[list(clocks)] = np.array(truth(t, p)).ravel()
    return changed


@dataclass(frozen=True)
class Timetable:
    """The instants (n,) of a run in order. The events at instant k are `owners[ends[k]:ends[k + 1]]`, and they
    move with m directions by `moved` (., m)."""

    times: Array
    ends: NDArray[np.int64]
    owners: NDArray[np.int32]
    moved: Array

    def at(self, k: int) -> tuple[float, list[int], list[Array]]:
        """The k-th instant with its events, and how it moves for each of them (m,)."""
        chosen = slice(self.ends[k], self.ends[k + 1])
        return float(self.times[k]), self.owners[chosen].tolist(), [*self.moved[chosen]]


def timetable(events: Sequence[FlatEvent], instants: tuple[Array, Array, Array, Array], begin: float, end: float
              ) -> Timetable:
    """The instants of a run.

    `instants` are the first instant and the period (n,) of every event with their derivatives (n, m). A single event whose
    instant lies before the begin of the run happens at the begin; instants of a repeated event before the begin are omitted.
    The instants of an irregular clock are late or left out (see `Clock`). SimulationError for a period that is not positive.
    """
    first, period, by_first, by_period = instants
    same = same_instant(begin, end)
    times, owners, derivatives = [np.zeros(0)], [np.zeros(0, np.int32)], [np.zeros((0, by_first.shape[1]))]
    clocks: dict[str, tuple[FlatEvent, float, float]] = {}
    for i, event in enumerate(events):
        if event.period is not None:
            _check(event, float(period[i]), end - begin)
            _check_clock(event, float(period[i]), float(first[i]), clocks)
            passed = int(np.ceil((begin - same - first[i]) / period[i]))
            # without `from:` it is repeated from the start of the run
            k = np.arange(passed if event.first.is_zero() else max(0, passed), int((end + same - first[i]) / period[i]) + 2)
            if event.clock is not None and event.clock.lost:
                k = np.array([j for j in k if not event.clock.loses(int(j))], dtype=k.dtype)
            at = first[i] + k * period[i]
            if event.clock is not None and event.clock.jitter:
                at = at + np.array([event.clock.late(int(j)) for j in k])
            times.append(at[at <= end + same])
            derivatives.append((by_first[i] + k[:, None] * by_period[i])[at <= end + same])
        elif event.indicator is None and max(first[i], begin) <= end + same:
            late = first[i] >= begin - same
            times.append(np.array([first[i] if late else begin]))
            derivatives.append(by_first[i:i + 1] if late else np.zeros_like(by_first[i:i + 1]))
        else:
            continue
        owners.append(np.full(len(times[-1]), i, np.int32))
    at, owner, along = np.concatenate(times), np.concatenate(owners), np.concatenate(derivatives)
    order = np.lexsort((owner, at))
    groups = np.cumsum(np.diff(at[order], prepend=at[order][:1]) > same)
    order = order[np.lexsort((owner[order], groups))]
    ends = np.append(np.searchsorted(groups, np.arange(groups[-1] + 1)), len(groups)) if len(groups) else np.zeros(1, int)
    starts = np.minimum.reduceat(at[order], ends[:-1]) if len(groups) else np.zeros(0)
    return Timetable(starts, ends, owner[order], along[order])


def _check(event: FlatEvent, period: float, span: float) -> None:
    if not period > 0:
        raise SimulationError([Problem("every-not-positive", f"'{event.name}' would happen every {period:g} s", event.place,
                                       "Give a time above 0.")])
    if span / period > EVENTS.max_time_events:
        raise SimulationError([Problem("too-many-events", f"'{event.name}' would happen {span / period:.3g} times",
                                       event.place, "Give a longer time, or run for a shorter one.")])


def _check_clock(event: FlatEvent, period: float, first: float, clocks: dict[str, tuple[FlatEvent, float, float]]) -> None:
    """SimulationError if the parts of a clock have different instants, or if its jitter reaches the next instant; `clocks`
    are those that are known."""
    if (clock := event.clock) is None:
        return
    earlier, other_period, other_first = clocks.setdefault(clock.name, (event, period, first))
    if (period, first) != (other_period, other_first):
        raise SimulationError([Problem(
            "clock-periods", f"'{event.name}' and '{earlier.name}' have the clock '{clock.name}', and different periods "
            f"({period:g} s, {other_period:g} s) or first instants", clock.place, "Give each rate a separate clock.")])
    if clock.jitter >= period:
        raise SimulationError([Problem(
            "clock-jitter", f"the jitter of clock '{clock.name}', {clock.jitter:g} s, is not below the period of "
            f"'{event.name}', {period:g} s", clock.place, "Write a jitter below one period.")])
