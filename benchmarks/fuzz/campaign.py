"""Diagrams judged by a process of their own, which is ended where one takes too long; faults made smaller."""

from __future__ import annotations

import multiprocessing as mp
import resource
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from benchmarks.fuzz.diagrams import Diagram
from benchmarks.fuzz.judging import Verdict, judge

RENEW = 500  # diagrams after which a worker is renewed: CasADi keeps what it compiled
# a worker that sleeps is ended after so many times the limit by the clock; a busy machine may give it a small share
ASLEEP = 30
BRIEF = 1e-3
_limits: list[float] = []  # of the process that judges


def renew_limit() -> None:
    """Begin the time anew in which the process that judges must be done; nothing in any other process."""
    for limit in _limits:
        # the kernel ends the process, wherever it computes
        spent = resource.getrusage(resource.RUSAGE_SELF)
        resource.setrlimit(resource.RLIMIT_CPU, (int(spent.ru_utime + spent.ru_stime + limit) + 1, resource.RLIM_INFINITY))


def _serve(pipe: Connection, limit: float, judged: Callable[..., Any] | None) -> None:
    _limits[:] = [limit]
    while (task := pipe.recv()) is not None:
        renew_limit()
        pipe.send((judged or judge)(*task))


def _unfinished(task: tuple[int, str], outcome: str, what: str, seconds: float) -> Verdict:
    return Verdict(task[0], outcome, what, seconds)


class Judge:
    """A process that judges one diagram after the other, each within `limit` seconds of processor time, or each step of what
    is tried with it where these renew the limit.

    It is a copy of this one, with everything imported and the library read, so that a new one costs nothing. The function
    that judges may be another one; `fault` makes the verdict on a task that was not finished (task, outcome, what, seconds).
    """

    def __init__(self, limit: float, judged: Callable[..., Any] | None = None, fault: Callable[..., Any] | None = None):
        self.limit, self.done = limit, 0
        self.judged, self.fault = judged, fault or _unfinished
        self._begin()

    def _begin(self) -> None:
        context = mp.get_context("fork")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other, self.limit, self.judged), daemon=True)
        self.process.start()
        other.close()
        self.done = 0

    def __call__(self, *task: Any) -> Any:
        """The verdict; a process that dies is a traceback, one that is late a hang."""
        if self.done >= RENEW:
            self.close()
            self._begin()
        self.done += 1
        self.pipe.send(task)
        fault, what = "hang", f"more than {self.limit:g} s"
        try:
            if self.pipe.poll(ASLEEP * (self.limit + 1)):
                return self.pipe.recv()
        except EOFError:
            self.process.join()
            if self.process.exitcode != -signal.SIGXCPU:
                fault, what = "traceback", f"the process died ({self.process.exitcode})"
        self.process.kill()
        self.process.join()
        self._begin()
        return self.fault(task, fault, what, self.limit)

    def close(self) -> None:
        """End the process."""
        self.pipe.send(None)
        self.process.join(10)


def patiently(judged: Callable[[int, str], Verdict], given: Diagram) -> Verdict:
    """The verdict on a diagram. One that takes too long is run again for a thousandth of its time: so fast may a machine be
    that its time has millions of steps, which is no fault. Then it is `long`, unless it ends badly in this time too."""
    found = judged(given.seed, given.text())
    if found.outcome != "hang":
        return found
    brief = judged(given.seed, given.shortened(BRIEF).text())
    return Verdict(given.seed, "long", brief.outcome, found.seconds) if brief.outcome in ("ran", "refused") else brief


def smallest(judged: Callable[[int, str], Verdict], given: Diagram, outcome: str) -> Diagram:
    """The diagram without the parts that the fault does not need, taken out one after the other."""
    again = True
    while again:
        again = False
        for part in given.parts:
            fewer = given.without_part(part.name)
            if fewer.parts and judged(given.seed, fewer.text()).outcome == outcome:
                given, again = fewer, True
                break
    return given
