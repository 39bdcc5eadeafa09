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
Lost = tuple[tuple[K, tuple[Any, ...]], BaseException]  # a job, its key and arguments, and its outcome
# a job may be lost before it began, when others ended its process: only so many deaths in a separate process are due to it
ALONE = 2
LISTEN = 5.0  # seconds without a result after which the existence of workers is checked
ANSWER = 0.2  # seconds within which a signal is obeyed while waiting for results
WATCH = 1.0  # seconds between two checks for the parent process
GRACE = 2.0  # seconds for processes to end by themselves
LATER = 1.0  # delay in seconds of SIGTERM in a worker, after the collecting process
PR_SET_PDEATHSIG = 1  # constant of Linux's prctl
_stop: Event | None = None  # in a process that works for another one: set if its work is not needed any more


class Stopped(Exception):
    """The work of this process is not needed any more."""


def processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def forks() -> bool:
    """True if a new process inherits the memory of this one."""
    return "fork" in multiprocessing.get_all_start_methods()


def check_cancelled(text: str) -> None:
    """Progress callback of a long computation in a worker process; raises Stopped if the collecting process has left."""
    if _stop is not None and _stop.is_set():
        raise Stopped(text)


class Workers(Executor):
    """An executor whose workers may die: `died` are the errors that report this, `together` is True if all running jobs
    are lost with one worker, and `renew` starts new ones."""

    died: tuple[type[BaseException], ...] = (BrokenExecutor,)
    together = True

    def renew(self) -> None:
        """Start new workers if dead ones are not replaced automatically."""

    def listen(self) -> None:
        """Called after a while without results, and after a job was given up; raises if no worker is left."""


class Processes(Workers):
    """A number of processes, each started by `begin(*arguments)`. On leaving, running jobs that report progress to `heed`
    end, after a while also the others. All of them end with the process that made them, however that ends.

      (If a process ended while it hands over a result, the pool would wait for the rest of it for ever: after all of them
      have ended, their pipe is closed here too, so that the pool ends.)
    """

    def __init__(self, number: int, begin: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()):
        self.number, self.context = number, multiprocessing.get_context("fork" if forks() else "spawn")
        self.stop = self.context.Event()
        self.begin = (os.getpid(), self.stop, begin, arguments)
        self.pool = self._pool()

    def _pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.number, self.context, _begun, self.begin)

    def renew(self) -> None:
        self.pool.shutdown(wait=True, cancel_futures=True)
        self.pool = self._pool()

    def submit(self, function: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        return self.pool.submit(function, *arguments, **named)

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
            if process.is_alive():  # in an integration that is not needed any more
                process.kill()
                process.join()
        if results is not None:  # the pool has not released it before
            results._writer.close()  # type: ignore[attr-defined]  # no public way to close a pool's pipe


def _begun(parent: int, stop: Event, begin: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the collecting process
    for number in set(SIGNALS) - {signal.SIGINT}:
        signal.signal(number, _end_later)
    _die_with(parent)
    single()
    warnings.simplefilter("ignore", FutureWarning)  # the parent process has read the same files
    if begin is not None:
        begin(*arguments)


def _end_later(number: int, _: FrameType | None) -> None:
    """End this process by a signal that the whole process group may have received: slightly later, so that the collecting
    process has obeyed it first and does not count this one as lost. A result in transfer is completed."""
    ending = threading.Timer(LATER, os._exit, (128 + number,))
    ending.daemon = True
    ending.start()


def _die_with(parent: int) -> None:
    """End this process when its parent is gone, however that ended: nobody would collect its results.

    Linux sends a signal then. Elsewhere a thread checks once a second (between two integrations, because CasADi holds
    the interpreter during one).
    """
    if sys.platform == "linux":
        prctl = ctypes.CDLL(None, use_errno=True).prctl
        if prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) == 0:
            if os.getppid() != parent:  # the parent ended before the call
                os._exit(1)
            return
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    begun_by = multiprocessing.parent_process()
    if sys.platform == "win32" and begun_by is not None:  # the number of an ended parent does not change
        begun_by.join()
    else:
        while os.getppid() == parent:
            clock.sleep(WATCH)
    os._exit(1)


def as_done(executor: Executor, function: Callable[..., T], jobs: Iterable[tuple[K, tuple[Any, ...]]], ahead: int,
            until: float = float("inf"), instead: Callable[[K, BaseException], T] | None = None) -> Iterator[tuple[K, T]]:
    """Key and result of function(*arguments) for each job, in the order of completion. `ahead` jobs are submitted at a
    time, none after `until` (of `time.perf_counter`), and taken from `jobs` only then. Exceptions of a job are raised
    here. If a worker dies, the jobs that were lost with it are repeated, each alone, to identify the cause;
    `instead(key, error)` gives the result of this job. Without it the error is raised.
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
        for ended_job in ended:
            job = running.pop(ended_job)
            if isinstance(executor, Workers) and ended_job.cancelled():
                executor.listen()
            if workers is not None and isinstance(error := ended_job.exception(), workers.died):
                lost.append((job, error))
            else:
                yield job[0], ended_job.result()
        if lost and workers is not None and instead is not None:
            while workers.together and running:  # lost too, but not all of them report it yet
                ended_job, job = running.popitem()
                if isinstance(error := ended_job.exception(), workers.died):
                    lost.append((job, error))
                else:
                    yield job[0], ended_job.result()
            yield from _again(workers, function, lost, instead)


def _again(workers: Workers, function: Callable[..., T], lost: Sequence[Lost[K]],
           instead: Callable[[K, BaseException], T]) -> Iterator[tuple[K, T]]:
    """Repeat jobs that were lost with a worker, each alone unless it was the only one."""
    workers.renew()
    for (key, arguments), error in lost:
        for _ in range(ALONE if workers.together else 0):
            again = workers.submit(function, *arguments)
            if not isinstance(outcome := again.exception(), workers.died):
                yield key, again.result()
                break
            error = outcome
            workers.renew()
        else:
            yield key, instead(key, error)
