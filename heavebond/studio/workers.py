"""Worker processes of the studio: the page's server never computes, and what hangs is ended without it."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
import time
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from heavebond.core.errors import HeavebondError, Problem

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

Answer = tuple[str, Any, Any]  # what kind, what is told, an array
SUPERSEDED: Answer = ("superseded", {}, None)
ENDED = Problem("worker-ended", "the computation ended before it was done", None,
                "If nobody stopped it, this machine's memory did not suffice.")


LOST: Answer = ("problems", [ENDED], None)


class Worker:
    """One process that does one task after the other; it is started when it is first needed and after it was ended."""

    def __init__(self) -> None:
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None
        self._turn = asyncio.Lock()
        self._newest: object = None
        self._since = 0.0
        self.stopped = False

    async def ask(self, task: str, *given: Any) -> Answer:
        """The answer to a task, after those that were asked for before."""
        async with self._turn:
            return await self._do(task, given)

    async def ask_again(self, task: str, *given: Any) -> Answer:
        """The same for a short task: where its process was ended from outside, it is done once more by a new one."""
        answer = await self.ask(task, *given)
        return await self.ask(task, *given) if answer == LOST else answer

    async def ask_newest(self, task: str, *given: Any, patience: float = float("inf")) -> Answer:
        """The same, but a task that waits is dropped as soon as a newer one comes, and one that takes longer than `patience`
        (s) is ended for it."""
        ticket = self._newest = object()
        if self._turn.locked() and self._since and time.monotonic() - self._since > patience:
            self.stop()
        async with self._turn:
            return SUPERSEDED if self._newest is not ticket else await self._do(task, given)

    async def begin(self) -> None:
        """Start the process before it is needed, as that takes a while."""
        async with self._turn:
            if self._process is None:
                await asyncio.to_thread(self._start)

    async def _do(self, task: str, given: tuple[Any, ...]) -> Answer:
        self.stopped, self._since = False, time.monotonic()
        try:
            if self._process is None or not self._process.is_alive():
                await asyncio.to_thread(self._start)
            assert self._pipe is not None
            self._pipe.send((task, given))
            answer: Answer = await asyncio.to_thread(self._pipe.recv)
            return answer
        except (EOFError, OSError):
            self._forget()
            return ("stopped", {}, None) if self.stopped else LOST
        finally:
            self._since = 0.0

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def stop(self) -> None:
        """End the process with what it does."""
        self.stopped = True
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """End the process for good."""
        self.stop()
        self._forget()

    def _forget(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join(5)
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None


def work(pipe: Connection) -> None:
    """The worker's loop, until the server is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's, which ends its workers
    from heavebond.studio.bench import fault, tasks

    known = tasks()
    while True:
        try:
            task, given = pipe.recv()
        except (EOFError, OSError):
            return
        answer: Answer
        try:
            told, values = known[task](*given)
            answer = ("done", told, values)
        except HeavebondError as error:
            answer = ("problems", list(error.problems), None)
        except RuntimeError as error:  # the integrator of searches gives no reason
            answer = ("failed", {}, None) if task in ("preview", "prepare") else ("problems", [fault(error)], None)
        except Exception as error:
            answer = ("problems", [fault(error)], None)
        try:
            pipe.send(answer)
        except OSError:
            return
