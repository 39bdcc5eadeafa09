"""Parallel work in processes of this machine or on any executor of `concurrent.futures`."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
import time as clock
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from multiprocessing.synchronize import Event
from types import FrameType
from typing import Any, TypeVar

from heavebond.core.cancellation import SIGNALS, check, deferred
from heavebond.core.threads import single

T = TypeVar("T")
K = TypeVar("K")
Lost = tuple[tuple[K, tuple[Any, ...]], BaseException]  # a job, its key and what is given, and how it ended
ALONE = 2  # a job may never have begun when others took its process away: only so many deaths alone are its own
LISTEN = 5.0  # seconds without a result after which it is asked whether any worker is left
ANSWER = 0.2  # seconds within which a signal is obeyed while results are waited for
WATCH = 1.0  # seconds between two looks whether the parent is there
GRACE = 2.0  # seconds that processes have to end by themselves
LATER = 1.0  # seconds by which SIGTERM ends a worker later than the process that collects
PR_SET_PDEATHSIG = 1  # of Linux's prctl
_stop: Event | None = None  # of a process that works for another one: set where what it does is not wanted any more


class Stopped(Exception):
    """What this process was doing is not wanted any more."""


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def forks() -> bool:
    """Whether a new process can have what this one has already."""
    return "fork" in multiprocessing.get_all_start_methods()


def check_cancelled(text: str) -> None:
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
        """Called where nothing was done for a while, and where a job was given up; raises where no worker is left that could
        do it."""


class Processes(Workers):
    """So many processes, each begun by `begin(*given)`; on leaving, what still runs and tells its progress to `heed` ends,
    after a while also what does not. All of them end with the process that made them, however that ends.

    (A process that ends while it hands over a result would leave the pool waiting for the rest of it for ever: once all of
    them are gone, their pipe is closed here too, so that the pool finds its end.)
    """

    def __init__(self, number: int, begin: Callable[..., None] | None = None, given: tuple[Any, ...] = ()):
        self.number, self.context = number, multiprocessing.get_context("fork" if forks() else "spawn")
        self.stop = self.context.Event()
        self.begin = (os.getpid(), self.stop, begin, given)
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
        with deferred():
            self.stop.set()
            working, results = list((self.pool._processes or {}).values()), self.pool._result_queue
            self.shutdown(wait=False, cancel_futures=True)
        until = clock.monotonic() + GRACE
        for process in working:
            process.join(max(0.0, until - clock.monotonic()))
            if process.is_alive():  # in an integration, which nobody wants any more
                process.kill()
                process.join()
        if results is not None:  # the pool has not let go of it before
            results._writer.close()  # type: ignore[attr-defined]  # no public way to close a pool's pipe


def _begun(parent: int, stop: Event, begin: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that collects
    for number in set(SIGNALS) - {signal.SIGINT}:
        signal.signal(number, _end_later)
    _die_with(parent)
    single()
    warnings.simplefilter("ignore", FutureWarning)  # the process that began this one has read the same files
    if begin is not None:
        begin(*given)


def _end_later(number: int, _: FrameType | None) -> None:
    """End this process by a signal that the whole group of processes may have received: a little later, so that the process
    that collects has obeyed it first and does not take this one for lost. What it is about to hand over is handed over."""
    ending = threading.Timer(LATER, os._exit, (128 + number,))
    ending.daemon = True
    ending.start()


def _die_with(parent: int) -> None:
    """End this process when its parent is gone, however that ended: nobody would collect what it finds.

    Linux sends a signal then. Elsewhere a thread looks once a second (as CasADi holds the interpreter during an integration,
    between two of them).
    """
    if sys.platform == "linux":
        prctl = ctypes.CDLL(None, use_errno=True).prctl
        if prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) == 0:
            if os.getppid() != parent:  # it went before the call
                os._exit(1)
            return
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    begun_by = multiprocessing.parent_process()
    if sys.platform == "win32" and begun_by is not None:  # the number of a parent that is gone stays
        begun_by.join()
    else:
        while os.getppid() == parent:
            clock.sleep(WATCH)
    os._exit(1)


def as_done(executor: Executor, function: Callable[..., T], jobs: Iterable[tuple[K, tuple[Any, ...]]], ahead: int,
            until: float = float("inf"), instead: Callable[[K, BaseException], T] | None = None) -> Iterator[tuple[K, T]]:
    """The key of each job and function(*arguments), in the order in which they are done; `ahead` jobs are handed over at a
    time, none after `until` (of `time.perf_counter`), and taken from `jobs` only then. What a job raises is raised here.

    Where a worker dies, the jobs that were lost with it are tried again, each alone, so that the one to blame is known;
    `instead(key, error)` stands for what comes of that one. Without it the error is raised.
    """
    coming, refused, heard = iter(jobs), list[tuple[K, tuple[Any, ...]]](), clock.monotonic()
    running: dict[Future[T], tuple[K, tuple[Any, ...]]] = {}
    workers = executor if isinstance(executor, Workers) and instead is not None else None
    while True:
        while len(running) < ahead and clock.perf_counter() <= until:
            job = refused.pop() if refused else next(coming, None)
            if job is None:
                break
            try:
                with deferred():
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
        check()
        lost: list[Lost[K]] = []
        with deferred():
            ended = wait(running, ANSWER, FIRST_COMPLETED).done
        if ended:
            heard = clock.monotonic()
        elif isinstance(executor, Workers) and clock.monotonic() - heard > LISTEN:
            executor.listen()
            heard = clock.monotonic()
        for done in ended:
            job = running.pop(done)
            if isinstance(executor, Workers) and done.cancelled():
                executor.listen()
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
