"""Long computations of the studio: each in a separate process, which continues if its tab is closed."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import re
import threading
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.native_permission import fmu_allowed, native_allowed
from heavebond.studio.contents import Entry
from heavebond.studio.job_process import QUIT, STOP, WRITE, serve
from heavebond.studio.workers import process_context

KINDS = ("fit", "where", "diagnose", "try", "tune", "study", "command")  # of computations
RUNNING = 4  # simultaneous computations: each one uses all processors
KEPT = 3  # processes of finished computations that are kept with their results until these are written
GRACE = 2.0  # s for a process to end when the studio does
COUNTED = re.compile(r"\b([0-9]+) of ([0-9]+)\b")
BEST = re.compile(r", best so far (.+) with chi-square (\S+)$")
FINISHING = "completing the result; a second Ctrl-C discards it"
LOST = Problem("worker-ended", "the computation ended before it was done", None,
               "If nobody stopped it, this machine's memory did not suffice.")

Push = Callable[["LongJob"], None]


class LongJob:
    """A computation on a document: its `state` is running, done, failed or stopped; `result` is the entry of the page."""

    numbers = itertools.count(1)

    def __init__(self, kind: str, name: str, path: Path, version: str, settings: Mapping[str, Any], push: Push):
        self.number, self.kind, self.name, self.version, self.push = next(self.numbers), kind, name, version, push
        self.state, self.text, self.stopping = "running", "starting", False
        self.began, self.seconds = time.monotonic(), 0.0
        self.ladder: list[Entry] = []
        self.result: Entry = {}
        self.arrays: dict[str, Any] = {}
        self.problems: list[Problem] = []
        self._writing: asyncio.Future[list[str]] | None = None
        self._loop = asyncio.get_running_loop()
        context = process_context()
        self._pipe, theirs = context.Pipe()
        # the permissions of the server, not of the page
        options = {**settings, "allow_native": native_allowed(), "allow_fmu": fmu_allowed()}
        self._process = context.Process(target=serve, args=(theirs, kind, str(path), options))
        self._process.start()
        theirs.close()
        threading.Thread(target=_listen, args=(self._pipe, self._loop, self._hear), daemon=True).start()

    def entry(self) -> Entry:
        """Its state, for the page."""
        counts = list(COUNTED.finditer(self.text))
        best = BEST.search(self.text)
        steps_done, of = (int(counts[-1].group(1)), int(counts[-1].group(2))) if counts else (0, 0)
        seconds = self.seconds or time.monotonic() - self.began
        problems = [{**p.as_dict(), "text": str(p)} for p in self.problems]
        return {"number": self.number, "kind": self.kind, "name": self.name, "version": self.version, "state": self.state,
                "text": BEST.sub("", self.text), "stopping": self.stopping, "seconds": seconds, "done": steps_done, "of": of,
                "best": {"name": best.group(1), "chi2": best.group(2)} if best else None, "ladder": self.ladder,
                "result": self.result or None, "problems": problems,
                "can_write": self._process.is_alive() and self.state == "done"}

    def stop(self) -> None:
        """End it with its best result so far; a second call ends it at once without a result."""
        if self.state != "running":
            return
        if self.stopping:
            self._end("stopped")
            self._process.kill()
        else:
            self.stopping = True
            self._send(STOP, None)
        self.push(self)

    async def write(self, options: Mapping[str, Any]) -> list[str]:
        """Write the result; returns the files. HeavebondError if that is not possible."""
        if self.state != "done" or not self._process.is_alive():
            raise UsageError([Problem("job-gone", "this result is no longer at hand", None, "Compute it again.")])
        if self._writing is not None:
            raise UsageError([Problem("job-busy", "it is being written already")])
        self._writing = self._loop.create_future()
        self._send(WRITE, dict(options))
        try:
            return await self._writing
        finally:
            self._writing = None

    def close(self) -> None:
        """End the process without its result."""
        self._send(QUIT, None)
        self._process.join(GRACE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(GRACE)
        self._pipe.close()

    def _send(self, request: str, content: Any) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._pipe.send((request, content))

    def _end(self, state: str) -> None:
        if self.state == "running":
            self.state, self.seconds = state, time.monotonic() - self.began

    def _hear(self, message: tuple[Any, ...]) -> None:
        """Handle a message of the process, on the server's thread."""
        kind, *content = message
        if kind == "progress" and self.state == "running":
            self.text = content[0].replace(FINISHING, "completing the result; a second Stop discards it")
        elif kind == "ladder":
            self.ladder = _plain(content[0])
        elif kind == "done":
            result: dict[str, Any] = _plain(content[0])
            self.result, self.arrays = result, content[1]
            self.ladder = result.get("ladder") or self.ladder
            self._end("done")
        elif kind == "problems":
            self.problems = content[0]
            self._end("failed")
        elif kind == "stopped":
            self._end("stopped")
        elif kind in ("written", "unwritten", "gone"):
            if kind == "gone" and self.state == "running":
                self.problems = [LOST]
                self._end("stopped" if self.stopping else "failed")
            if not (self._writing is None or self._writing.done()):
                if kind == "written":
                    self._writing.set_result(content[0])
                else:
                    self._writing.set_exception(HeavebondError(content[0] if content else [LOST]))
        self.push(self)


def known(kind: str) -> str:
    """Check the name of a computation; UsageError for another one."""
    if kind not in KINDS:
        raise UsageError([Problem("usage", "the page asked for something unknown")])
    return kind


def _listen(pipe: Connection, loop: asyncio.AbstractEventLoop, hear: Callable[[tuple[Any, ...]], None]) -> None:
    """Forward the messages of a process until it ends."""
    while True:
        try:
            message = pipe.recv()
        except (EOFError, OSError):
            message = ("gone",)
        with contextlib.suppress(RuntimeError):  # the server has ended
            loop.call_soon_threadsafe(hear, message)
        if message == ("gone",):
            return


def _plain(value: Any) -> Any:
    """Replace numbers that JSON does not have."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and value - value != 0.0 else value


class LongJobs:
    """The computations of the studio, one for each document and kind; tabs receive the messages of theirs."""

    def __init__(self) -> None:
        self.jobs: dict[tuple[str, str], LongJob] = {}
        self.watchers: set[Push] = set()

    def begin(self, kind: str, name: str, path: Path, version: str, options: Mapping[str, Any]) -> LongJob:
        """Begin a computation in place of the former one; UsageError if one runs on this document."""
        if any(job.name == name and job.state == "running" for job in self.jobs.values()):
            raise UsageError([Problem("job-running", f"a computation runs on {name} already", None,
                                      "Stop it, or wait until it is done.")])
        if sum(job.state == "running" for job in self.jobs.values()) >= RUNNING:
            raise UsageError([Problem("job-running", f"{RUNNING} computations are running, and no more do at a time", None,
                                      "Stop one of them, or wait until it is done.")])
        if (before := self.jobs.pop((name, kind), None)) is not None:
            before.close()
        finished = [key for key, job in self.jobs.items() if job.state != "running"]
        for key in finished[:max(0, len(finished) - KEPT + 1)]:
            self.jobs.pop(key).close()
        self.jobs[name, kind] = job = LongJob(kind, name, path, version, options, self._push)
        return job

    def of(self, name: str) -> list[LongJob]:
        """The computations on a document."""
        return [job for job in self.jobs.values() if job.name == name]

    def numbered(self, number: int) -> LongJob:
        """The computation with a number; UsageError if it does not exist any more."""
        for job in self.jobs.values():
            if job.number == number:
                return job
        raise UsageError([Problem("job-gone", "this result is no longer at hand", None, "Compute it again.")])

    def close(self) -> None:
        """End all of them."""
        for job in self.jobs.values():
            job.close()

    def _push(self, job: LongJob) -> None:
        for watcher in list(self.watchers):
            watcher(job)
