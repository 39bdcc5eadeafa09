"""Progress and cancellation of long functions when they are called from Python.

In a notebook a function without a progress callback shows a bar if tqdm is installed. Outside notebooks it prints
nothing. Ctrl-C, or the stop button of a notebook, ends each of them with KeyboardInterrupt.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from heavebond.core.cancellation import is_interrupt, listening
from heavebond.core.progress import Progress
from heavebond.core.threads import single

P = ParamSpec("P")
T = TypeVar("T")
# True while a reporting function runs: functions that it calls report through it
_running: ContextVar[bool] = ContextVar("running", default=False)


class Bar:
    """A progress callback that shows its text at a bar of tqdm and counts the calls, unless `place` sets the count."""

    def __init__(self, bar: Any):
        self.bar, self.placed = bar, False

    def __call__(self, text: str) -> None:
        self.bar.set_postfix_str(text)
        if not self.placed:
            self.bar.update(1)

    def place(self, completed: int, of: int) -> None:
        self.placed, self.bar.n, self.bar.total = True, completed, of
        self.bar.refresh()


def place(progress: Progress | None, completed: int, of: int) -> None:
    """Set the number of completed steps and their total, if progress is shown as a bar."""
    if isinstance(progress, Bar):
        progress.place(completed, of)


def in_notebook() -> bool:
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


def make_bar(title: str) -> Bar | None:
    """A bar, in a notebook with tqdm; else None."""
    if not in_notebook():
        return None
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None
    return Bar(tqdm(desc=title, unit="step", leave=False))


@contextmanager
def reported(title: str, progress: Progress | None = None) -> Iterator[Progress | None]:
    """The progress callback of a function that is called with `progress`; cancellation inside is a KeyboardInterrupt. Linear
    algebra inside takes one thread (see `threads`)."""
    if _running.get():
        yield progress
        return
    token, bar = _running.set(True), make_bar(title) if progress is None else None
    try:
        with single(), listening((signal.SIGINT,)):
            try:
                yield bar or progress
            except Exception as error:  # CasADi may convert Ctrl-C to another error
                if is_interrupt(error):
                    raise KeyboardInterrupt from error
                raise
    finally:
        _running.reset(token)
        if bar:
            bar.bar.close()


def reporting(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator: show a progress bar if `progress` is not given, make the call cancellable and take one thread."""

    @wraps(function)
    def wrapped(*args: P.args, **named: P.kwargs) -> T:
        progress: Any = named.pop("progress", None)
        with reported(function.__name__, progress) as say:
            if say is not None:
                named["progress"] = say
            return function(*args, **named)

    return wrapped


def cancellable(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator: make the call cancellable and take one thread."""

    @wraps(function)
    def wrapped(*args: P.args, **named: P.kwargs) -> T:
        with reported(function.__name__, lambda text: None):
            return function(*args, **named)

    return wrapped
