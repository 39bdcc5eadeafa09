"""Cancellation by Ctrl-C and termination signals: never lost, deferred while a result is being finished.

A signal handler raises an exception wherever the program is. CasADi occasionally discards it (its conversion of arguments
and its calls clear pending exceptions), so that the handler also stores the signal: `check`, called between the steps of
long computations, raises again until `clear_signal` is called.
"""

from __future__ import annotations

import signal
import sys
import threading
import time as clock
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from traceback import walk_stack
from types import FrameType
from typing import TypeVar

from heavebond.core.progress import Progress

# Ctrl-C, the request to end, the end of the terminal
SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "terminated: the terminal was closed"}
# pending signal of the process that has not been obeyed yet, and the last one
_heard: list[int] = []
_last: list[int] = []
_deferring = False  # True if the main thread is in a `deferred` block
_deferred: list[int] = []  # signals received in it


class Interrupted(KeyboardInterrupt):
    """A signal that requests the end, `number`; a KeyboardInterrupt, so that every command ends as after Ctrl-C.
    `figures` are the best results so far, which a command prints nevertheless."""

    def __init__(self, number: int = signal.SIGINT, figures: Mapping[str, object] | None = None):
        super().__init__()
        self.number, self.figures = int(number), dict(figures or {})


DEPTH = 4  # functions of CasADi's Python code that are called within each other, and the handler of another signal
SOON = 1e-3  # the shortest limit (s): a timer of 0 never fires
T = TypeVar("T")
ENDED_EARLY = "interrupted"  # reason of the end of a search that returns its best result so far


@contextmanager
def listening(numbers: Sequence[int] = SIGNALS) -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the computation inside like Ctrl-C, and lose none of them. Nothing changes outside the
    main thread, which receives no signals, nor for signals that are ignored, as in jobs behind `nohup`, or that have a
    handler already."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in numbers}
    handled = [number for number, handler in before.items() if handler in (signal.SIG_DFL, signal.default_int_handler)]
    reported = sys.unraisablehook

    def report(dropped: sys.UnraisableHookArgs) -> None:
        if not isinstance(dropped.exc_value, Interrupted):  # (of a destructor or a callback: `check` raises it again)
            reported(dropped)

    for number in handled:
        signal.signal(number, _hear)
    sys.unraisablehook = report
    try:
        yield
    finally:
        sys.unraisablehook = reported
        for number in handled:
            signal.signal(number, before[number])
        if handled:
            _heard.clear()
            _last.clear()


def _hear(number: int, frame: FrameType | None) -> None:
    _heard[:] = _last[:] = [number]
    _raise(number, frame)


def _raise(number: int, frame: FrameType | None) -> None:
    """Raise the signal, or store it if signals are deferred. NumPy calls the conversion of a CasADi matrix from C, where an
    exception becomes a SystemError that no search expects: inside CasADi's Python code nothing is raised, and the next
    `check` raises the signal."""
    if _deferring:
        _deferred.append(number)
    elif not any(inner.f_code.co_filename.endswith("casadi.py") for inner, _ in islice(walk_stack(frame), DEPTH)):
        raise Interrupted(number)


@contextmanager
def deferred() -> Iterator[None]:
    """Only store signals inside; raise them at the end of the block. For short operations that an exception would leave
    in an inconsistent state, for example of an executor, whose locks would stay held. Outside the main thread nothing
    changes."""
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
    """Raise an exception again that a library has discarded."""
    if _heard:
        raise Interrupted(_heard[0])


def clear_signal() -> int | None:
    """Forget the received signal after it has been obeyed; returns its number."""
    return _heard.pop() if _heard else None


def last_heard() -> int:
    """The number of the last received signal, obeyed or not; SIGINT if signals were not handled."""
    return _last[-1] if _last else signal.SIGINT


@contextmanager
def finishing(say: Progress) -> Iterator[None]:
    """Ignore the first Ctrl-C inside the context except for a message by `say`; the second one ends the computation.

    The result of a long search is then not lost while it is completed. SIGTERM is treated alike if it is handled. Nothing
    changes outside the main thread, which receives no signals, or if the signals are ignored, as in background jobs of a
    shell."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    handled = [number for number, handler in before.items() if callable(handler)]
    if threading.current_thread() is not threading.main_thread() or not handled:
        yield
        return

    def restore() -> None:
        for number in handled:
            signal.signal(number, before[number])

    def once(number: int, frame: FrameType | None) -> None:
        restore()
        say("completing the result; a second Ctrl-C discards it")

    for number in handled:
        signal.signal(number, once)
    try:
        yield
    finally:
        restore()


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """End the computation inside after so many seconds (s) as by Ctrl-C: a KeyboardInterrupt, after which searches return
    their best result so far. An outer limit holds inside as well, and is raised again outside. Outside the main
    thread, and if the system has no timer (Windows), nothing changes; functions that read the time themselves end by
    that."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer") \
            or not 0 <= seconds < float("inf"):
        yield
        return
    within = True

    def late(number: int, frame: FrameType | None) -> None:
        if within:
            _heard[:] = [number]
            _raise(number, frame)

    outer, began = set_timer(0), now()  # time left to the outer limit, 0 for none
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
    """The clock of time limits (s)."""
    return clock.perf_counter()


def set_timer(seconds: float) -> float:
    """Send SIGALRM after so many seconds, 0 for never; returns the time that was left to the former one."""
    return signal.setitimer(signal.ITIMER_REAL, seconds)[0]


@dataclass(frozen=True)
class Budget:
    """Time budget of a whole computation: `seconds` (s) from `began` on."""

    seconds: float
    began: float = field(default_factory=lambda: now())

    @property
    def spent(self) -> float:
        return now() - self.began

    def left(self, reserve: float = 0.0) -> float:
        """Time left, minus a reserve for later (s)."""
        return max(0.0, self.seconds - reserve - self.spent)

    def made(self, make: Callable[[], T], reserve: float = 0.0) -> T | None:
        """Result of `make`; None if it was interrupted by Ctrl-C, or by the time limit less the reserve `kept`."""
        if self.left(reserve) <= 0:
            return None
        try:
            with time_limit(self.left(reserve)):
                return make()
        except KeyboardInterrupt:
            clear_signal()
            return None


def is_interrupt(error: BaseException | None) -> bool:
    """True if an exception is Ctrl-C, or results from it in a library: CasADi's conversion of matrices ends as a
    SystemError that was caused by it, and other calls in errors that follow after it was discarded."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None or bool(_heard)
