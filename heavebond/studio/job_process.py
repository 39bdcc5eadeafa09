"""The process of a long computation of the studio: an estimation, a localisation, a diagnosis, a tuning.

It runs the computation of the command of the same name, reports its progress, ends early with its best result on request,
and then keeps the result until the page requests its files. If the studio is killed, it ends the computation and writes
the result like the command line, so that nothing is lost.
"""

from __future__ import annotations

import _thread
import contextlib
import os
import queue
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from heavebond.core.cancellation import check, clear_signal, is_interrupt, listening
from heavebond.core.native_permission import fmu_code, native_code
from heavebond.core.writable import confined
from heavebond.studio.workers import reasons

EVERY = 0.1  # s between two progress reports
Arrays = dict[str, Any]
Writing = Callable[[Mapping[str, Any]], list[Path]]
STOP, QUIT, WRITE, LOST = "stop", "quit", "write", "lost"


class JobProcess:
    """One computation with its result; `pipe` leads to the server, which may be gone."""

    def __init__(self, pipe: Connection):
        self.pipe, self.requests = pipe, queue.Queue[tuple[str, Any]]()
        self.busy, self.lost, self._last = True, False, 0.0

    def listen(self) -> None:
        """Handle requests of the server in a separate thread: a stop at once, others in sequence."""
        while True:
            try:
                request, arguments = self.pipe.recv()
            except (EOFError, OSError):
                request, arguments, self.lost = LOST, None, True
            if request == QUIT:
                os._exit(0)  # the user has ended the studio
            if request in (STOP, LOST) and self.busy:
                _thread.interrupt_main()
            if request != STOP:
                self.requests.put((request, arguments))
            if request == LOST:
                return

    def tell(self, kind: str, *content: Any) -> None:
        """Send a message to the server, if it exists."""
        with contextlib.suppress(OSError, ValueError):
            if not self.lost:
                self.pipe.send((kind, *content))

    def progress(self, text: str) -> None:
        """The progress callback of the computation."""
        check()
        time_now = time.monotonic()
        if time_now - self._last >= EVERY:
            self._last = time_now
            self.tell("progress", text)

    def serve(self, kind: str, path: str, options: Mapping[str, Any]) -> None:
        """Compute, then write the requested files until the server leaves."""
        from heavebond.studio.long_tasks import TASKS

        write: Writing | None = None
        try:
            threading.Thread(target=self.listen, daemon=True).start()  # it may interrupt this thread at once
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                entry, arrays, write = TASKS[kind](Path(path), options, self)
            self.busy = False
            self.tell("done", entry, arrays)
        except KeyboardInterrupt:
            self.tell("stopped")
        except Exception as error:
            self.tell("stopped") if is_interrupt(error) else self.tell("problems", reasons(error))
        self.busy = False
        clear_signal()
        while write is not None:
            try:
                request, arguments = self.requests.get()
                if request == WRITE:
                    self.tell("written", [str(p) for p in write(arguments)])
                elif request == LOST:
                    write({"lost": True})
                    return
            except Exception as error:
                self.tell("unwritten", reasons(error))
            except KeyboardInterrupt:  # a stop that arrived at the end of the computation
                clear_signal()


def serve(pipe: Connection, kind: str, path: str, options: Mapping[str, Any]) -> None:
    """The main function of the process."""
    with contextlib.suppress(OSError, AttributeError):
        os.setsid()  # the server handles Ctrl-C
    with contextlib.suppress(OSError, AttributeError):
        os.nice(5)
    os.environ["HEAVEBOND_PROGRESS"] = "0"  # a command prints no lines about its progress: they would be shown as warnings
    options = dict(options)
    native, fmus = bool(options.pop("allow_native", False)), bool(options.pop("allow_fmu", False))
    # the opened folder; without one, the folder for results
    root = Path(str(options.get("root") or options.get("folder") or Path(path).parent))
    with listening(), confined(root), native_code(native), fmu_code(fmus):
        JobProcess(pipe).serve(kind, path, options)

