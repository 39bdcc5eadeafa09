"""Cancellation by Ctrl-C and termination signals: never lost, deferred while a result is being finished.

A signal handler raises an exception wherever the program is. CasADi occasionally discards it (its conversion of arguments
and its calls clear pending exceptions), so that the handler also stores the signal: `check`, called between the steps of
long computations, raises again until `obeyed` is called.
"""

from __future__ import annotations

import signal
import sys
import threading
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import TypeVar

from heavebond.core.progress import Progress

# Ctrl-C, the request to end, the end of the terminal
SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "terminated: the terminal was closed"}
# of the process, as signals are: that which is not obeyed yet, and the last one
_heard: list[int] = []
_last: list[int] = []
_deferring = False  # whether the main thread is in a `deferred` block
_deferred: list[int] = []  # what was heard there


class Interrupted(KeyboardInterrupt):
    """A signal that asks to end, `number`; a KeyboardInterrupt, so that every command ends by it as by Ctrl-C. `figures` are
    what a command has to tell all the same: its best so far."""

    def __init__(self, number: int = signal.SIGINT, figures: Mapping[str, object] | None = None):
        super().__init__()
        self.number, self.figures = int(number), dict(figures or {})


SOON = 1e-3  # the shortest limit (s): a timer of 0 never comes
T = TypeVar("T")
ENDED_EARLY = "interrupted"  # why a search ended that gives its best so far


@contextmanager
def listening(numbers: Sequence[int] = SIGNALS) -> Iterator[None]:
    """Within it SIGTERM and SIGHUP end what runs as Ctrl-C does, and none of them is lost. Outside the main thread nothing
    changes, as signals do not come there, nor for those that are ignored, as in jobs behind `nohup`, or that have a
    handler already."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in numbers}
    taken = [number for number, handler in before.items() if handler in (signal.SIG_DFL, signal.default_int_handler)]
    reported = sys.unraisablehook

    def report(dropped: sys.UnraisableHookArgs) -> None:
        if not isinstance(dropped.exc_value, Interrupted):  # (of a destructor or a callback: `check` raises it again)
            reported(dropped)

    for number in taken:
        signal.signal(number, _hear)
    sys.unraisablehook = report
    try:
        yield
    finally:
        sys.unraisablehook = reported
        for number in taken:
            signal.signal(number, before[number])
        if taken:
            _heard.clear()
            _last.clear()


def _hear(number: int, frame: FrameType | None) -> None:
    _heard[:] = _last[:] = [number]
    _raise(number)


def _raise(number: int) -> None:
    if not _deferring:
        raise Interrupted(number)
    _deferred.append(number)


@contextmanager
def deferred() -> Iterator[None]:
    """Within it a signal is only stored; it is raised at the end of the block. For short steps that an exception in their
    midst would leave half done, such as those of an executor, whose locks it would keep. Elsewhere than in the main thread
    nothing changes."""
    global _deferring
    if threading.current_thread() is not threading.main_thread() or _deferring:
        yield
        return
    _deferring = True
    try:
        yield
    finally:
        _deferring, came = False, _deferred[-1:]
        _deferred.clear()
    for number in came:
        raise Interrupted(number)


def check() -> None:
    """Raise again what a library has dropped."""
    if _heard:
        raise Interrupted(_heard[0])


def clear_signal() -> int | None:
    """Forget the signal that was heard, as what it asked for is done; its number."""
    return _heard.pop() if _heard else None


def last_heard() -> int:
    """The number of the last signal that was heard, obeyed or not; that of Ctrl-C where none was listened to."""
    return _last[-1] if _last else signal.SIGINT


@contextmanager
def finishing(say: Progress) -> Iterator[None]:
    """Within it the first Ctrl-C is only answered (by `say`) and not obeyed, so that a search that took minutes is not lost
    in the seconds in which its result is worked out; the second one is obeyed. The same for SIGTERM where it is listened to.

    Outside the main thread nothing changes, as signals do not come there, nor where they are ignored, as in jobs that a
    shell has put into the background."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    taken = [number for number, handler in before.items() if callable(handler)]
    if threading.current_thread() is not threading.main_thread() or not taken:
        yield
        return

    def restore() -> None:
        for number in taken:
            signal.signal(number, before[number])

    def once(number: int, frame: FrameType | None) -> None:
        restore()
        say("finishing what was found; Ctrl-C once more ends without it")

    for number in taken:
        signal.signal(number, once)
    try:
        yield
    finally:
        restore()


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Within it what runs ends after so many seconds (s) as by Ctrl-C: a KeyboardInterrupt, for searches that then give
    their best so far. A limit around another one holds within that too, and is told again behind it. Outside the main
    thread, and where the system has no timer (Windows), nothing changes: those that look at the time themselves end by
    that."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer") \
            or not 0 <= seconds < float("inf"):
        yield
        return
    within = True

    def late(number: int, frame: FrameType | None) -> None:
        if within:
            _heard[:] = [number]
            _raise(number)

    outer, began = set_timer(0), now()  # what is left to the limit around, 0 for none
    before = signal.signal(signal.SIGALRM, late)
    set_timer(min(max(seconds, SOON), outer or float("inf")))
    try:
        yield
    finally:
        within = False
        set_timer(0)
        signal.signal(signal.SIGALRM, before)
        if _heard == [int(signal.SIGALRM)]:
            _heard.clear()
        if outer:
            set_timer(max(outer - (now() - began), SOON))


def now() -> float:
    """The time that limits are kept by (s)."""
    return clock.perf_counter()


def set_timer(seconds: float) -> float:
    """Have SIGALRM come after so many seconds, 0 for never; after how many it would have come."""
    return signal.setitimer(signal.ITIMER_REAL, seconds)[0]


@dataclass(frozen=True)
class Budget:
    """The time of a whole computation: `seconds` (s) from `began` on."""

    seconds: float
    began: float = field(default_factory=lambda: now())

    @property
    def spent(self) -> float:
        """What has gone of it (s)."""
        return now() - self.began

    def left(self, kept: float = 0.0) -> float:
        """What is left of it, less what is kept for later (s)."""
        return max(0.0, self.seconds - kept - self.spent)

    def made(self, make: Callable[[], T], kept: float = 0.0) -> T | None:
        """What `make` gives; None where it was ended before, by Ctrl-C or as the time was over but for what is `kept`."""
        if self.left(kept) <= 0:
            return None
        try:
            with time_limit(self.left(kept)):
                return make()
        except KeyboardInterrupt:
            clear_signal()
            return None


def is_interrupt(error: BaseException | None) -> bool:
    """Whether an exception is Ctrl-C, or is a library's answer to it: CasADi's conversion of matrices ends as a SystemError
    that was caused by it, and other calls in errors that come of its having been dropped."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None or bool(_heard)
