"""Ctrl-C: put off while what was found is finished, and known again where a library has wrapped it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from heavebond.basis.progress import Progress


@contextmanager
def finishing(say: Progress) -> Iterator[None]:
    """Within it the first Ctrl-C is only answered (by `say`) and not obeyed, so that a search that took minutes is not lost
    in the seconds in which its result is worked out; the second one is obeyed. Outside the main thread nothing changes, as
    signals do not come there, nor where they are ignored, as in jobs that a shell has put into the background."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        yield
        return

    def once(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)
        say("finishing what was found; Ctrl-C once more ends without it")

    before = signal.signal(signal.SIGINT, once)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def is_interrupt(error: BaseException | None) -> bool:
    """Whether an exception is Ctrl-C, or is a library's answer to it: CasADi's conversion of matrices ends as a SystemError
    that was caused by it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None
