"""When the time events of a run happen, from their first instants and periods."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, SimulationError
from heavebond.equations.events import FlatEvent
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.event_constants import EVENTS


def same_instant(begin: float, end: float) -> float:
    """How near to each other two instants of a run are one."""
    return float(max(EVENTS.same_instant * (end - begin), EVENTS.same_roundings * np.spacing(max(abs(begin), abs(end)))))


def clocks_at(assembly: Assembly, t: float, p: Array) -> Array:
    """The parameters with what conditions of the time (see `equations.time_conditions`) hold at a time."""
    clocks = {held: e for e in reversed(assembly.flat.events) if e.by_clock and (held := e.resets[0].held) is not None}
    if not clocks:
        return p
    time, _, _, symbols, *_ = assembly.arguments
    truth = assembly.once("clocks", lambda: ca.Function("clocks", [time, symbols], [assembly.express(stack(
        e.first <= time if e.indicator is None else e.indicator > 0 for e in clocks.values()))]))
    changed = p.copy()
    changed[list(clocks)] = np.array(truth(t, p)).ravel()
    return changed


def timetable(events: Sequence[FlatEvent], instants: tuple[Array, Array, Array, Array], begin: float, end: float
              ) -> Iterator[tuple[float, list[int], list[Array]]]:
    """Each instant of a run with the events at it and how it moves with m directions for each of them (m,).

    `instants` are the first instant and the period (n,) of every event with their derivatives (n, m). What happens once, and
    was to happen before the run begins, happens as it begins; of what is repeated the instants before are passed over.
    The instants of an irregular clock are late or left out (see `Clock`). SimulationError for a period that is none.
    """
    first, period, by_first, by_period = instants
    same = same_instant(begin, end)
    coming: dict[int, tuple[float, Array]] = {}

    def put(i: int, k: int) -> None:
        clock = events[i].clock
        while clock is not None and clock.loses(k):
            k += 1
        late = clock.late(k) if clock is not None else 0.0
        count[i] = k
        coming[i] = float(first[i] + k * period[i]) + late, by_first[i] + k * by_period[i]

    clocks: dict[str, tuple[FlatEvent, float, float]] = {}
    count = dict.fromkeys((i for i, event in enumerate(events) if event.period is not None), 0)
    for i, event in enumerate(events):
        if i in count:
            _check(event, float(period[i]), end - begin)
            _check_clock(event, float(period[i]), float(first[i]), clocks)
            passed = int(np.ceil((begin - same - first[i]) / period[i]))
            # without `from:` it is repeated from the start of the run
            count[i] = passed if event.first.is_zero() else max(0, passed)
            put(i, count[i])
        elif event.indicator is None:
            coming[i] = (float(first[i]), by_first[i]) if first[i] >= begin - same else (begin, np.zeros_like(by_first[i]))
    while coming and (time := min(at for at, _ in coming.values())) <= end + same:
        now = sorted(i for i, (at, _) in coming.items() if at <= time + same)
        yield time, now, [coming[i][1] for i in now]
        for i in now:
            del coming[i]
            if i in count:
                count[i] += 1
                put(i, count[i])


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
    other, other_period, other_first = clocks.setdefault(clock.name, (event, period, first))
    if (period, first) != (other_period, other_first):
        raise SimulationError([Problem(
            "clock-periods", f"'{event.name}' and '{other.name}' have the clock '{clock.name}', and different periods "
            f"({period:g} s, {other_period:g} s) or first instants", clock.place, "Give each rate a clock of its own.")])
    if clock.jitter >= period:
        raise SimulationError([Problem(
            "clock-jitter", f"the jitter of clock '{clock.name}', {clock.jitter:g} s, is not below the period of "
            f"'{event.name}', {period:g} s", clock.place, "Write a jitter below one period.")])
