"""Ratios of processor time: both sides in one run of the program, in turns, so that a busy machine slows both alike."""

from __future__ import annotations

import gc
import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

PAIRS = 5
# a measurement shorter than this is repeated until it is as long: the clock and the caches are no longer seen
SHORTEST = 0.1


@dataclass(frozen=True)
class Paired:
    """Median processor time of each side in s, and the median of the ratios of the pairs."""

    ours: float
    theirs: float
    ratio: float


@dataclass(frozen=True)
class Figure:
    """A line of the table; `met` is None where there is no target."""

    what: str
    measured: str
    target: str = ""
    met: bool | None = None


def cpu() -> float:
    """Processor time in s of this process and of the children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def seconds(run: Callable[[], object], repeat: int = 1) -> float:
    """Processor time of one call, from `repeat` calls."""
    gc.collect()
    began = cpu()
    for _ in range(repeat):
        run()
    return (cpu() - began) / repeat


def paired(ours: Callable[[], object], theirs: Callable[[], object], pairs: int = PAIRS) -> Paired:
    """Both sides in turns after one call of each that is not counted; the second side goes first in every other pair."""
    repeats = [max(1, round(SHORTEST / max(seconds(side), 1e-4))) for side in (ours, theirs)]
    times: tuple[list[float], list[float]] = ([], [])
    for k in range(pairs):
        for side in ((0, 1), (1, 0))[k % 2]:
            times[side].append(seconds((ours, theirs)[side], repeats[side]))
    return Paired(statistics.median(times[0]), statistics.median(times[1]),
                  statistics.median(a / b for a, b in zip(*times, strict=True)))


def at_most(what: str, found: Paired, limit: float) -> Figure:
    """The line of a ratio that should not exceed `limit`."""
    return Figure(what, spoken(found), f"≤ {limit:g}", found.ratio <= limit)


def spoken(found: Paired) -> str:
    """`2.79 (86.1 ms / 30.9 ms)`."""
    return f"{found.ratio:.2f} ({duration(found.ours)} / {duration(found.theirs)})"


def duration(time_s: float) -> str:
    """`86.1 ms`, `1.62 s`."""
    return f"{time_s:.2f} s" if abs(time_s) >= 0.9995 else f"{1e3 * time_s:.3g} ms"
