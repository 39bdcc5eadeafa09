"""Work done side by side, in processes of this machine or on any executor of `concurrent.futures`."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

from heavebond.basis.threads import single

T = TypeVar("T")
K = TypeVar("K")
Lost = tuple[tuple[K, tuple[Any, ...]], BaseException]  # a job, its key and what is given, and how it ended
ALONE = 2  # a job may never have begun when others took its process away: only so many deaths alone are its own
LISTEN = 5.0  # seconds without a result after which it is asked whether any worker is left
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


class Workers(Executor):
    """An executor some of whose workers may die: `died` are the errors by which that is told, `together` says whether all
    that runs is lost with one of them, and `renew` puts new ones in their place."""

    died: tuple[type[BaseException], ...] = (BrokenExecutor,)
    together = True

    def renew(self) -> None:
        """New workers, where those that died are not replaced by themselves."""

    def listen(self) -> None:
        """Called where nothing was done for a while; raises where no worker is left that could do it."""


class Processes(Workers):
    """So many processes, each begun by `begin(*given)`; on leaving, what still runs and tells its progress to `heed` ends.

    (A process that is killed while it hands over a result would leave the pool waiting for the rest of it for ever.)
    """

    def __init__(self, number: int, begin: Callable[..., None] | None = None, given: tuple[Any, ...] = ()):
        self.number, self.context = number, multiprocessing.get_context("fork" if forks() else "spawn")
        self.stop = self.context.Event()
        self.begin = (self.stop, begin, given)
        self.pool = self._pool()

    def _pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.number, self.context, _begun, self.begin)

    def renew(self) -> None:
        self.pool.shutdown(wait=True, cancel_futures=True)
        self.pool = self._pool()

    def submit(self, function: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        return self.pool.submit(function, *given, **named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self.pool.shutdown(wait=wait, cancel_futures=cancel_futures)

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        self.shutdown(cancel_futures=True)


def _begun(stop: Event, begin: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    global _stop
    _stop = stop
    single()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that collects
    if begin is not None:
        begin(*given)


def as_done(executor: Executor, function: Callable[..., T], jobs: Iterable[tuple[K, tuple[Any, ...]]], ahead: int,
            until: float = float("inf"), instead: Callable[[K, BaseException], T] | None = None) -> Iterator[tuple[K, T]]:
    """The key of each job and function(*arguments), in the order in which they are done; `ahead` jobs are handed over at a
    time, none after `until` (of `time.perf_counter`), and taken from `jobs` only then. What a job raises is raised here.

    Where a worker dies, the jobs that were lost with it are tried again, each alone, so that the one to blame is known;
    `instead(key, error)` stands for what comes of that one. Without it the error is raised.
    """
    coming, refused = iter(jobs), list[tuple[K, tuple[Any, ...]]]()
    running: dict[Future[T], tuple[K, tuple[Any, ...]]] = {}
    workers = executor if isinstance(executor, Workers) and instead is not None else None
    while True:
        while len(running) < ahead and clock.perf_counter() <= until:
            job = refused.pop() if refused else next(coming, None)
            if job is None:
                break
            try:
                running[executor.submit(function, *job[1])] = job
            except BrokenExecutor:
                if workers is None:
                    raise
                refused.append(job)
                if running:
                    break
                workers.renew()
        if not running:
            return
        lost: list[Lost[K]] = []
        ended = wait(running, LISTEN, FIRST_COMPLETED).done
        if not ended and isinstance(executor, Workers):
            executor.listen()
        for done in ended:
            job = running.pop(done)
            if workers is not None and isinstance(error := done.exception(), workers.died):
                lost.append((job, error))
            else:
                yield job[0], done.result()
        if lost and workers is not None and instead is not None:
            while workers.together and running:  # lost too, though not all of it says so yet
                done, job = running.popitem()
                if isinstance(error := done.exception(), workers.died):
                    lost.append((job, error))
                else:
                    yield job[0], done.result()
            yield from _again(workers, function, lost, instead)


def _again(workers: Workers, function: Callable[..., T], lost: Sequence[Lost[K]],
           instead: Callable[[K, BaseException], T]) -> Iterator[tuple[K, T]]:
    """Jobs that were lost with a worker, each tried alone where it need not be the one to blame."""
    workers.renew()
    for (key, given), error in lost:
        for _ in range(ALONE if workers.together else 0):
            again = workers.submit(function, *given)
            if not isinstance(found := again.exception(), workers.died):
                yield key, again.result()
                break
            error = found
            workers.renew()
        else:
            yield key, instead(key, error)
