"""One open page: its requests are answered by a table of handlers, and it is informed of changes on disk."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable
from collections.abc import Mapping as Dictionary
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.limits import FILE_BYTES
from heavebond.studio.folder import Document, Folder
from heavebond.studio.job import Job
from heavebond.studio.long_jobs import LongJob, LongJobs
from heavebond.studio.workers import Answer, Pool, Worker, reasons

WATCH = 0.4  # s between two checks of the files on disk
# exceptions that result from values in a request that no page sends
MALFORMED = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
UNKNOWN = Problem("usage", "the page asked for something unknown")
PENDING = 64  # simultaneous requests of a page; further ones are read when one of these is finished
WRITES = ("save", "layout")  # requests that are completed after the page has closed
GONE = "gone"  # the version of a document whose file was removed
Handler = Callable[["Tab", dict[str, Any]], Awaitable[Answer]]


class Tab:
    """One open page: its document, watched on disk, and the workers that check and run it."""

    def __init__(self, websocket: WebSocket, folder: Folder, first: str, handlers: Dictionary[str, Handler], jobs: LongJobs,
                 pool: Pool, command_line: str = ""):
        self.command_line = command_line
        self.websocket, self.folder, self.first, self.handlers, self.jobs = websocket, folder, first, handlers, jobs
        self.checker, self.runner, self.librarian = Worker(pool), Worker(pool), Worker(pool)
        self.document: Document | None = None
        self.checked = ""  # the latest checked document
        self.other_files: dict[str, float] = {}  # the other files of the diagram, with their times
        self.sending, self.pending = asyncio.Lock(), asyncio.Semaphore(PENDING)
        self.tasks: set[asyncio.Task[None]] = set()
        self.writes: set[asyncio.Task[None]] = set()  # of these, those that write a file

    async def serve(self) -> None:
        """Answer the requests of the page until it closes."""
        self._begin(self._watch())
        self.jobs.watchers.add(self._push_job)
        try:
            while True:
                text = await self.websocket.receive_text()
                try:
                    message = json.loads(text)
                except (ValueError, RecursionError):
                    message = {}
                await self.pending.acquire()
                message = message if isinstance(message, dict) else {}
                self._begin(self._handle(message), self.pending.release, completed=message.get("do") in WRITES)
        except (WebSocketDisconnect, KeyError):  # KeyError: bytes instead of a text
            return

    def close(self) -> None:
        """End its requests, except those that write a file, and its workers; long computations continue."""
        self.jobs.watchers.discard(self._push_job)
        for task in self.tasks - self.writes:
            task.cancel()
        for worker in (self.checker, self.runner, self.librarian):
            worker.close()

    def expect_runs(self) -> None:
        """Start the worker of runs, so that the first run need not wait for it."""
        self._begin(self.runner.begin())

    def _push_job(self, job: LongJob) -> None:
        if self.document is not None and self.document.name == job.name:
            self._begin(self.send({"push": "job", "job": job.entry()}))

    def _begin(self, work: Any, finished: Callable[[], None] | None = None, *, completed: bool = False) -> None:
        """Start a task; with `completed` it does not end when the page closes."""
        task = asyncio.get_running_loop().create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)
        if completed:
            self.writes.add(task)
            task.add_done_callback(self.writes.discard)
        if finished is not None:
            task.add_done_callback(lambda _: finished())

    async def _handle(self, message: dict[str, Any]) -> None:
        number = message.get("id") if isinstance(message.get("id"), (int, str)) else None
        try:
            kind, answer, values = await self.handlers[str(message.get("do"))](self, message)
            if kind == "problems":
                answer = {"problems": [_problem(p) for p in answer]}
            await self.send({"id": number, "kind": kind, **answer}, values)
        except Exception as error:  # the page would wait for ever for a request without an answer
            problems = [_problem(p) for p in ([UNKNOWN] if isinstance(error, MALFORMED) else reasons(error))]
            await self.send({"id": number, "kind": "problems", "problems": problems})

    async def send(self, entry: dict[str, Any], values: Any = None) -> None:
        """Send JSON as text; with an array as bytes: the length of the JSON (4 bytes), the JSON padded with blanks to a
        multiple of 8, the numbers row by row (float64, little endian)."""
        text = json.dumps(_finite(entry), allow_nan=False)  # in ASCII, because file names may contain lone surrogates
        async with self.sending:
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the page has closed
                if values is None:
                    await self.websocket.send_text(text)
                    return
                entry = {**entry, "shape": list(values.shape)}
                head = json.dumps(_finite(entry), allow_nan=False).encode("ascii")
                head += b" " * (-(4 + len(head)) % 8)
                await self.websocket.send_bytes(len(head).to_bytes(4, "little") + head
                                                + np.ascontiguousarray(values, "<f8").tobytes())

    async def _watch(self) -> None:
        """Inform the page of changes on disk by other programs."""
        while True:
            await asyncio.sleep(WATCH)
            document = self.document
            if document is None:
                continue
            if (changed := await asyncio.to_thread(_again, self.folder, document)) is not None \
                    and self.document is document:
                self.document = changed
                await self.send({"push": "disk", **document_entry(changed)})
            elif await asyncio.to_thread(_missing, self.folder, document) and document.version != GONE:
                await asyncio.sleep(WATCH)  # some programs remove a file before they write it again
                if await asyncio.to_thread(_missing, self.folder, document) and self.document is document:
                    self.document = replace(document, version=GONE)
                    await self.send({"push": "gone", "name": document.name})
            now_times = await asyncio.to_thread(times, list(self.other_files))
            if now_times != self.other_files and self.document is document:
                self.other_files = now_times
                await self.send({"push": "others"})

    def job(self, message: dict[str, Any]) -> Job:
        """The diagram in the state of the page: its `name`, its `text`, and the `values` of its sliders."""
        name, text = str(message["name"]), str(message["text"])
        if len(text) > FILE_BYTES:
            raise UsageError([Problem("file-too-large", f"the text is larger than {FILE_BYTES // 10**6} MB")])
        values = {str(k): str(v) for k, v in message.get("values", {}).items()}
        return Job(text, str(self.folder.path(name)), name, values)


def document_entry(document: Document) -> dict[str, Any]:
    """A document in the form for the page."""
    return {"name": document.name, "text": document.text, "version": document.version, "writable": document.writable}


def _again(folder: Folder, document: Document) -> Document | None:
    """The document as it is on disk, if it has changed and can be read."""
    try:
        current = folder.read(document.name)
    except (HeavebondError, OSError):
        return None  # deleted or being written; the text of the page can be saved again
    return current if current.version != document.version else None


def _missing(folder: Folder, document: Document) -> bool:
    """True if the file of the document does not exist any more."""
    try:
        return not folder.path(document.name).exists()
    except (HeavebondError, OSError):
        return True


def times(files: list[str]) -> dict[str, float]:
    """Times of the last change of files; 0 for a missing one."""
    times_of = {}
    for file in files:
        try:
            times_of[file] = Path(file).stat().st_mtime
        except OSError:
            times_of[file] = 0.0
    return times_of


def _problem(problem: Problem) -> dict[str, Any]:
    return {**problem.as_dict(), "text": str(problem)}


def _finite(value: Any) -> Any:
    """Replace values that JSON does not have by null."""
    if isinstance(value, dict):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
