"""Work done side by side, in processes of this machine or on any executor of `concurrent.futures`."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time as clock
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

from heavebond.threads import single

T = TypeVar("T")
K = TypeVar("K")
_stop: Event | None = None  # of a process that works for another one: set where what it does is not wanted any more


class Stopped(Exception):
    """What this process was doing is not wanted any more."""


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def forks() -> bool:
    """Whether a new process can have what this one has already."""
    return "fork" in multiprocessing.get_all_start_methods()


def heed(text: str) -> None:
    """The progress of something long in a process that works for another one; raises Stopped where that has left."""
    if _stop is not None and _stop.is_set():
        raise Stopped(text)


class Processes:
    """So many processes, each begun by `begin(*given)`; on leaving, what still runs and tells its progress to `heed` ends.

    (A process that is killed while it hands over a result would leave the pool waiting for the rest of it for ever.)
    """

    def __init__(self, number: int, begin: Callable[..., None] | None = None, given: tuple[Any, ...] = ()):
        context = multiprocessing.get_context("fork" if forks() else "spawn")
        self.stop = context.Event()
        self.pool = ProcessPoolExecutor(number, context, _begun, (self.stop, begin, given))

    def __enter__(self) -> ProcessPoolExecutor:
        return self.pool

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        self.pool.shutdown(wait=True, cancel_futures=True)


def _begun(stop: Event, begin: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    global _stop
    _stop = stop
    single()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that collects
    if begin is not None:
        begin(*given)


def as_done(executor: Executor, function: Callable[..., T], jobs: Sequence[tuple[K, tuple[Any, ...]]], ahead: int,
            until: float = float("inf")) -> Iterator[tuple[K, T]]:
    """The key of each job and function(*arguments), in the order in which they are done; `ahead` jobs are handed over at a
    time, none after `until` (of `time.perf_counter`). What a job raises is raised here."""
    waiting = list(jobs)[::-1]
    running: dict[Future[T], K] = {}
    while waiting or running:
        while waiting and len(running) < ahead and clock.perf_counter() <= until:
            key, given = waiting.pop()
            running[executor.submit(function, *given)] = key
        if not running:
            return
        for done in wait(running, return_when=FIRST_COMPLETED).done:
            yield running.pop(done), done.result()
