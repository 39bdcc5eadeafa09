"""Progress of long commands as plain lines on standard error if it is not a terminal: in log files and batch jobs.

A line is printed every five seconds, the first after five seconds of the command. A separate thread prints it, because a
computation may take longer than five seconds between two calls of its progress callback. (CasADi holds the interpreter
during an integration: a single longer integration delays the line.)
"""

from __future__ import annotations

import contextlib
import os
import re
import sys
import threading
import time as clock
from collections.abc import Callable, Iterator
from typing import TextIO

from heavebond.core.progress import duration

EVERY = 5.0  # seconds between two lines
VARIABLE = "HEAVEBOND_PROGRESS"  # environment variable: number of seconds between lines, 0 for no lines
COUNTED = re.compile(r"\b([0-9]+) of ([0-9]+)\b")  # the progress of a stage in its text: `refitting 3 of 24: ...`
TELLING = 1.0  # seconds that a stage must take before its remaining time is estimated

_running: list[ProgressLines] = []  # of the running command


class ProgressLines:
    """The lines about the running stage (`words`) and its latest progress text. Times are in s."""

    def __init__(self, words: str, now: float):
        self.words, self.text, self.began = words, "", now
        self._stage: tuple[str, int] = ("", 0)
        self._first = self._last = (now, 0)

    def tell(self, text: str, now: float) -> None:
        """Set the progress text; a count `3 of 24` in it is followed to estimate the remaining time."""
        self.text = text
        counts = list(COUNTED.finditer(text))
        if not counts:
            return
        last_count = counts[-1]
        steps_done, of = int(last_count.group(1)), int(last_count.group(2))
        stage = (text[:last_count.start()], of)
        if stage != self._stage or steps_done < self._last[1]:
            self._stage, self._first = stage, (now, steps_done)
        self._last = (now, steps_done)

    def left(self, now: float) -> float | None:
        """Seconds to the end of the stage at its mean rate so far; None if the rate is not known."""
        progressed, took = self._last[1] - self._first[1], self._last[0] - self._first[0]
        counted = COUNTED.search(self.text) is not None and self.text.startswith(self._stage[0])
        if not counted or progressed <= 0 or took < TELLING or " left" in self.text:  # a study estimates it itself
            return None
        return max(0.0, took / progressed * (self._stage[1] - self._last[1]) - (now - self._last[0]))

    def line(self, now: float) -> str:
        """`diagnosing, 1 min 05 s: step 1: refitting 3 of 24: ...; about 40 s left for these 24`."""
        seconds_left = self.left(now)
        return f"{self.words}, {duration(now - self.began)}" + (f": {self.text}" if self.text else "") \
            + (f"; about {duration(seconds_left)} left for these {self._stage[1]}" if seconds_left and round(seconds_left)
               else "")


@contextlib.contextmanager
def progress_lines(words: str) -> Iterator[None]:
    """Print lines inside if standard error is not a terminal; inside another such context, or without words, nothing
    changes."""
    every = interval()
    if _running or not every or not words or sys.stderr.isatty():
        yield
        return
    lines, ended = ProgressLines(words, clock.monotonic()), threading.Event()
    with _errors() as write:
        thread = threading.Thread(target=_print, args=(lines, write, every, ended), daemon=True)
        try:
            thread.start()
        except RuntimeError:  # a system without threads
            yield
            return
        _running.append(lines)
        try:
            yield
        finally:
            _running.clear()
            ended.set()
            thread.join()


@contextlib.contextmanager
def told(words: str) -> Iterator[Callable[[str], None]]:
    """Set the words for the current stage inside; yields the progress callback."""
    if not _running:
        yield lambda text: None
        return
    lines = _running[0]
    before, lines.words, lines.text = lines.words, words, ""
    try:
        yield lambda text: lines.tell(text, clock.monotonic())
    finally:
        lines.words, lines.text = before, ""


def interval() -> float:
    """Seconds between two lines, 0 for none."""
    try:
        return max(0.0, float(os.environ.get(VARIABLE, EVERY)))
    except ValueError:
        return EVERY


def _print(lines: ProgressLines, write: Callable[[str], None], every: float, ended: threading.Event) -> None:
    while not ended.wait(every):
        try:
            write(lines.line(clock.monotonic()) + "\n")
        except (OSError, ValueError):  # the reader of standard error has closed it
            return


@contextlib.contextmanager
def _errors() -> Iterator[Callable[[str], None]]:
    """A function that writes to the present standard error without buffers. During an integration the solver's output is
    captured from file descriptor 2, and a lock that is held while a worker process is forked stays locked in it."""
    stream: TextIO = sys.stderr
    try:
        copy = os.dup(stream.fileno())
    except (OSError, ValueError):  # standard error has no file descriptor
        yield lambda text: print(text, end="", file=stream, flush=True)
        return
    try:
        yield lambda text: _whole(copy, text.encode(stream.encoding or "utf-8", "replace"))
    finally:
        os.close(copy)


def _whole(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data):]
