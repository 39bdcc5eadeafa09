"""Parallel work on a dask.distributed scheduler, whose workers have this package and the same files."""

from __future__ import annotations

import asyncio
import logging
import time as clock
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from threading import Lock
from typing import Any, TypeVar

from heavebond.core.errors import Problem, UsageError
from heavebond.core.parallel import Workers
from heavebond.core.version import VERSION

T = TypeVar("T")
AHEAD = 2  # tasks of a worker at a time, so that it need not wait for the next one
PATIENCE = 20.0  # seconds to wait for a scheduler, for the first answer of a worker, and for the return of lost workers
AGAIN = "give the same command again, or without `--scheduler`: completed results are stored (`diagnose`: with `--resume`)."
ANSWERS, PAUSE = 20, 0.1  # number of attempts, and seconds between them, to fetch a result whose connection has closed
_one = Lock()


class Cluster(Workers):
    """The workers of a scheduler (`tcp://host:8786`) as an executor. The scheduler repeats a lost task on another worker,
    and gives a task up after several workers died with it.

      UsageError if dask is not installed, if nothing answers, or if the workers have another version of this program;
      later if the scheduler is lost, or all workers are and none returns.
    """

    together = False

    def __init__(self, address: str):
        try:
            import distributed
            from distributed.scheduler import KilledWorker
        except ImportError:
            raise UsageError([Problem("dask-missing", "a scheduler needs dask.distributed", None,
                                      "pip install 'heavebond[cluster]'")]) from None
        self.died = (KilledWorker,)
        # `listen` reports a lost scheduler instead of dask's log
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            connect: Any = distributed.Client
            self.client = connect(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise UsageError([Problem("scheduler-silent", f"no scheduler answers at '{address}'", None,
                                      "Start one with `dask scheduler`, and workers with `dask worker tcp://HOST:8786 "
                                      "--nthreads 1`; it prints its address.", (str(error),))]) from None
        self.address = address
        self._missed: float | None = None  # time since the last worker was seen
        try:
            self.number = self._checked(address)
        except BaseException:
            self.shutdown()
            raise

    @property
    def ahead(self) -> int:
        return AHEAD * self.number

    def _checked(self, address: str) -> int:
        threads = self.client.nthreads()
        if not threads:
            raise UsageError([Problem("scheduler-alone", f"the scheduler at '{address}' has no workers", None,
                                      f"Start some: `dask worker {address} --nthreads 1`.")])
        try:
            theirs = self.client.submit(_version, pure=False).result(timeout=PATIENCE)
        except TimeoutError as error:
            raise UsageError([Problem("workers-busy", f"no worker of the scheduler at '{address}' answers within "
                                      f"{PATIENCE:g} s", None, "They may be at work for another command: wait for that, or "
                                      f"start more: `dask worker {address} --nthreads 1`.")]) from error
        except (ImportError, AttributeError) as error:
            raise UsageError([Problem("worker-unfit", "the workers do not have this program", None,
                                      "Install heavebond where the workers run.", (f"{error}",))]) from None
        if theirs != VERSION:
            raise UsageError([Problem("worker-unfit", f"the workers have heavebond {theirs}, here it is {VERSION}", None,
                                      "Install the same version where the workers run.")])
        return sum(threads.values())

    def submit(self, function: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        self._missed = None
        answer: Future[T] = Future()
        self.client.loop.add_callback(self._handed_over,
                                      self.client.submit(_alone, function, *arguments, pure=False, **named),
                                      answer)
        return answer

    async def _handed_over(self, task: Any, answer: Future[Any]) -> None:
        """Result of a task. If a result is lost with its worker before it is fetched, this waits again, because the
        scheduler recomputes it; dask's executor raises a TypeError in this case. The same if the connection closes
        during the answer, unless the scheduler is lost."""
        from distributed.comm.core import CommClosedError

        for attempts_left in reversed(range(ANSWERS)):
            try:
                answers = await self.client.gather(task, asynchronous=True)
            except (asyncio.CancelledError, CancelledError):
                _cancel(answer)
            except CommClosedError as error:
                if self.client.status == "running" and attempts_left:
                    await asyncio.sleep(PAUSE)
                    continue
                if self.client.status == "running":
                    answer.set_exception(error)
                else:
                    _cancel(answer)
            except BaseException as error:
                answer.set_exception(error)
            else:
                answer.set_result(answers)
            return

    def listen(self) -> None:
        if self.client.status != "running":
            raise UsageError([Problem("scheduler-lost", f"the scheduler at '{self.address}' does not answer any more", None,
                                      f"Start one again, and {AGAIN}")])
        if self.client.nthreads():
            self._missed = None
        elif self._missed is None:
            self._missed = clock.monotonic()
        elif clock.monotonic() - self._missed > PATIENCE:
            raise UsageError([Problem("workers-lost", f"the scheduler at '{self.address}' has lost all of its workers", None,
                                      f"Start some (`dask worker {self.address} --nthreads 1`), and {AGAIN}")])

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self.client.close()


@contextmanager
def connected(address: str | None) -> Iterator[Cluster | None]:
    """The cluster at an address, if one is given."""
    if address is None:
        yield None
        return
    with Cluster(address) as cluster:
        yield cluster


def _cancel(answer: Future[Any]) -> None:
    answer.cancel()
    answer.set_running_or_notify_cancel()


def _version() -> str:
    return VERSION


def _alone(function: Callable[..., T], *arguments: Any, **named: Any) -> T:
    """One task at a time in a process: the solver's output is captured from a file descriptor, which threads share."""
    with _one:
        return function(*arguments, **named)
