"""Worker processes of the studio: the page's server never computes, and ends workers that hang."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from heavebond.core.errors import HeavebondError, Problem
from heavebond.core.native_permission import fmu_allowed, fmu_code, native_allowed, native_code

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, ForkServerProcess, SpawnContext, SpawnProcess

# Processes of all tabs: a tab has three. If more tabs move sliders at the same time than there are processes, each run waits
# for a process that is prepared anew: ten tabs had a median latency of 2 s with 9 processes, of 28 ms with 16 (600 MB).
MOST = 16
Answer = tuple[str, Any, Any]  # kind, content, array
SUPERSEDED: Answer = ("superseded", {}, None)
ENDED = Problem("worker-ended", "the computation ended before it was done", None,
                "If nobody stopped it, the memory of this machine did not suffice, or a program of the diagram (an FMU or "
                "an external function) crashed.")


LOST: Answer = ("problems", [ENDED], None)


def process_context() -> ForkServerContext | SpawnContext:
    """The start method of the studio's processes. On Linux a separate process imports the modules and reads the library
    once, and its copies start within milliseconds; new interpreters take two seconds of a processor each."""
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["heavebond.studio.preloaded"])
    return context


def start_imports() -> None:
    """Start the process of which workers are copies, before the first worker is needed."""
    if process_context().get_start_method() == "forkserver":
        from multiprocessing.forkserver import ensure_running

        ensure_running()


def reasons(error: Exception) -> list[Problem]:
    """Problems that the page shows for an exception."""
    if isinstance(error, HeavebondError):
        return list(error.problems)
    if isinstance(error, OSError):
        return [Problem("file", f"{error.filename or 'a file'}: {error.strerror or error}")]
    if isinstance(error, MemoryError):
        return [Problem("memory", "the memory of this machine does not suffice", None,
                        "Ask for fewer output points (a longer `every`) or a shorter run.")]
    message = (str(error).strip().splitlines() or [""])[0]
    return [Problem("internal", f"a fault of heavebond itself, not of your files: {type(error).__name__}: {message}", None,
                    "The same command on the command line writes a file with its trace.")]


class Pool:
    """The processes of all tabs, at most `most`. A worker that needs a further one takes the process of the worker that
    has been idle longest; if none is idle, it waits."""

    def __init__(self, most: int = MOST) -> None:
        self.most = most
        self.workers: list[Worker] = []  # workers with a process, the latest active one at the end
        self._idle = asyncio.Condition()

    async def admit(self, worker: Worker) -> None:
        """Wait until `worker` may have a process."""
        async with self._idle:
            while worker not in self.workers and len(self.workers) >= self.most:
                idle = next((candidate for candidate in self.workers if not candidate.busy), None)
                if idle is None:
                    await self._idle.wait()
                else:
                    self.workers.remove(idle)
                    async with idle.turn:  # requests wait meanwhile
                        await asyncio.to_thread(idle.end)
            self.used(worker)

    def used(self, worker: Worker) -> None:
        """Move a worker to the end of the queue."""
        self.remove(worker)
        self.workers.append(worker)

    def remove(self, worker: Worker) -> None:
        """Forget a worker, whose process has ended."""
        if worker in self.workers:
            self.workers.remove(worker)

    async def tell_idle(self) -> None:
        """Let workers that wait for a process check again."""
        async with self._idle:
            self._idle.notify_all()


class Worker:
    """One process that performs one task after the other; it is started at its first use and after it was ended."""

    def __init__(self, pool: Pool | None = None) -> None:
        self.pool = pool or Pool()
        self._process: ForkServerProcess | SpawnProcess | None = None
        self._pipe: Connection | None = None
        self.turn, self._asked = asyncio.Lock(), 0
        self._newest: object = None
        self._since = 0.0  # begin of the running task; 0 if there is none
        self.stopped = self._killed = False

    async def ask(self, task: str, *arguments: Any) -> Answer:
        """The answer to a task, after earlier tasks."""
        async with self._at_work():
            return await self._do(task, arguments)

    async def ask_again(self, task: str, *arguments: Any) -> Answer:
        """The answer to a short task, after earlier tasks. If its process was ended from outside, a new process repeats
        it."""
        answer = await self.ask(task, *arguments)
        return await self.ask(task, *arguments) if answer == LOST else answer

    async def ask_newest(self, task: str, *arguments: Any, patience: float = float("inf")) -> Answer:
        """The answer to a task, unless a newer one arrives: then it is dropped if it still waits, and ended if it has
        run for longer than `patience` (s)."""
        ticket = self._newest = object()
        if self.turn.locked() and self._since and time.monotonic() - self._since > patience:
            self.stop()
        async with self._at_work():
            return SUPERSEDED if self._newest is not ticket else await self._do(task, arguments)

    async def begin(self) -> None:
        """Start the process before it is needed, because that takes some time."""
        async with self._at_work():
            await self._ready()

    @property
    def busy(self) -> bool:
        """True if the worker performs a task, or if a task waits for the worker."""
        return self._asked > 0

    @asynccontextmanager
    async def _at_work(self) -> AsyncIterator[None]:
        """Exclusive use of the process by one task. Afterwards, workers that wait for a process check whether one is
        free."""
        self._asked += 1
        try:
            async with self.turn:
                yield
        finally:
            self._asked -= 1
            await self.pool.tell_idle()

    async def _ready(self) -> None:
        """Provide a process: a new one if the last one was ended."""
        if self._process is not None and (self._killed or not self._process.is_alive()):
            self.end()
        await self.pool.admit(self)
        if self._process is None:
            await asyncio.to_thread(self._start)

    async def _do(self, task: str, arguments: tuple[Any, ...]) -> Answer:
        self.stopped, self._since = False, time.monotonic()
        try:
            await self._ready()
            if self.stopped:
                return "stopped", {}, None
            assert self._pipe is not None
            self._pipe.send((task, arguments))
            answer: Answer = await asyncio.to_thread(self._pipe.recv)
            return answer
        except (EOFError, OSError):
            self.end()
            return ("stopped", {}, None) if self.stopped else LOST
        finally:
            self._since = 0.0
            self.pool.used(self) if self._process is not None else self.pool.remove(self)

    def _start(self) -> None:
        context = process_context()
        pipe, theirs = context.Pipe()
        process = context.Process(target=work, args=(theirs, native_allowed(), fmu_allowed()), daemon=True)
        process.start()  # the first one waits for the imports
        theirs.close()
        self._pipe, self._process = pipe, process

    def stop(self) -> None:
        """End the process and its task; without effect if there is no task."""
        if not self._since:
            return
        self.stopped = self._killed = True
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """End the process for good."""
        self.stop()
        self.end()
        self.pool.remove(self)

    def end(self) -> None:
        """End the process; the next task starts a new one."""
        if self._process is not None:
            self._process.kill()
            self._process.join(5)
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None
        self._killed = False


def work(pipe: Connection, allow_native: bool = False, allow_fmu: bool = False) -> None:
    """The worker's loop, until the server ends; diagrams may run the programs of external functions with `allow_native`, and
    those of FMUs with `allow_fmu`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server handles Ctrl-C and ends its workers
    with native_code(allow_native), fmu_code(allow_fmu):
        from heavebond.studio.bench import tasks

        known = tasks()
        while True:
            try:
                task, arguments = pipe.recv()
            except (EOFError, OSError):
                return
            answer: Answer
            try:
                entry, values = known[task](*arguments)
                answer = ("done", entry, values)
            except Exception as error:
                # the integrator of searches gives no reason
                failed = task in ("preview", "prepare") and isinstance(error, RuntimeError)
                answer = ("failed", {}, None) if failed else ("problems", reasons(error), None)
            try:
                pipe.send(answer)
            except OSError:
                return
