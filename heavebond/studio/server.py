"""The studio's server: the page and its files, and a socket for each tab."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.limits import FILE_BYTES
from heavebond.studio.folder import BUNDLED, Document, Folder, bundled_machines
from heavebond.studio.job import Job
from heavebond.studio.page_safety import Guard, new_token, policy
from heavebond.studio.values import with_values
from heavebond.studio.workers import Answer, Worker

PORT, PORTS = 8437, 20  # the first port that is tried, and how many; the same one finds the drafts of unsaved texts again
WATCH = 0.4  # s between two looks at the files on disk
HANGS = 10.0  # s of a check after which a newer one ends it
KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}


class Studio:
    """The opened folder with the workers that its tabs share."""

    def __init__(self, folder: Folder, first: str, port: int):
        self.folder, self.first, self.port, self.token = folder, first, port, new_token()
        self.page = _page_files()
        self.tabs: set[Tab] = set()

    @property
    def address(self) -> str:
        """What to open in the browser."""
        return f"http://127.0.0.1:{self.port}/{self.token}/"

    def app(self) -> Guard:
        """The application, behind its guard."""
        routes = [Route(f"/{self.token}/", self._index), Route(f"/{self.token}/{{name:path}}", self._file),
                  WebSocketRoute(f"/{self.token}/socket", self._socket)]
        return Guard(Starlette(routes=routes, lifespan=self._lifespan), self.token, self.port)

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        try:
            yield
        finally:
            for tab in list(self.tabs):
                tab.close()

    async def _index(self, _: Request) -> Response:
        nonce = secrets.token_urlsafe(16)
        text = self.page["index.html"].decode("utf-8").replace("NONCE", nonce)
        return self._answer(text.encode("utf-8"), ".html", nonce)

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in self.page or name == "index.html":
            return Response("There is no such file.\n", 404, self._headers(""), "text/plain")
        return self._answer(self.page[name], Path(name).suffix, "")

    def _answer(self, content: bytes, suffix: str, nonce: str) -> Response:
        return Response(content, 200, self._headers(nonce), KINDS[suffix])

    def _headers(self, nonce: str) -> dict[str, str]:
        return {"Content-Security-Policy": policy(nonce or "none", self.port).decode(), "Cache-Control": "no-store",
                "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
                "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Resource-Policy": "same-origin"}

    async def _socket(self, websocket: WebSocket) -> None:
        await websocket.accept()
        tab = Tab(self, websocket)
        self.tabs.add(tab)
        try:
            await tab.serve()
        finally:
            self.tabs.discard(tab)
            tab.close()


class Tab:
    """One page that is open: the document in it, watched on disk, and the workers that check and run it."""

    def __init__(self, studio: Studio, websocket: WebSocket):
        self.studio, self.websocket = studio, websocket
        self.checker, self.runner = Worker(), Worker()
        self.document: Document | None = None
        self.others: dict[str, float] = {}  # the files that the diagram reads besides its own, with their times
        self.sending = asyncio.Lock()
        self.tasks: set[asyncio.Task[None]] = set()

    async def serve(self) -> None:
        """Answer what the page asks until it goes."""
        self._begin(self._watch())
        try:
            while True:
                message = json.loads(await self.websocket.receive_text())
                if isinstance(message, dict):
                    self._begin(self._handle(message))
        except (WebSocketDisconnect, ValueError, KeyError):
            return

    def close(self) -> None:
        """End what it does and its workers."""
        for task in self.tasks:
            task.cancel()
        self.checker.close()
        self.runner.close()

    def _begin(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    async def _handle(self, message: dict[str, Any]) -> None:
        number, values = message.get("id"), None
        actions: dict[str, Callable[[dict[str, Any]], Awaitable[Answer]]] = {
            "home": self._home, "open": self._open, "new": self._new, "save": self._save, "view": self._view,
            "run": self._run, "prepare": self._run, "preview": self._run, "signals": self._run, "stop": self._stop,
            "copy": self._copy, "derive": self._derive, "write": self._write}
        try:
            kind, told, values = await actions[str(message.get("do"))](message)
            if kind == "problems":
                told = {"problems": [_told(p) for p in told]}
        except HeavebondError as error:
            kind, told = "problems", {"problems": [_told(p) for p in error.problems]}
        except (KeyError, TypeError, ValueError, AttributeError):
            kind, told = "problems", {"problems": [_told(Problem("usage", "the page asked for something unknown"))]}
        await self._send({"id": number, "kind": kind, **told}, values)

    async def _send(self, told: dict[str, Any], values: Any = None) -> None:
        """JSON as text; with an array as bytes: the length of the JSON (4 bytes), the JSON filled up with blanks to a
        multiple of 8, the numbers row by row (float64, little endian)."""
        text = json.dumps(_finite(told), ensure_ascii=False, allow_nan=False)
        async with self.sending:
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the page has gone
                if values is None:
                    await self.websocket.send_text(text)
                    return
                told = {**told, "shape": list(values.shape)}
                head = json.dumps(_finite(told), ensure_ascii=False, allow_nan=False).encode("utf-8")
                head += b" " * (-(4 + len(head)) % 8)
                await self.websocket.send_bytes(len(head).to_bytes(4, "little") + head
                                                + np.ascontiguousarray(values, "<f8").tobytes())

    # -- files ---------------------------------------------------------------------------------------------------------
    async def _home(self, _: dict[str, Any]) -> Answer:
        self.document = None
        found = await asyncio.to_thread(self.studio.folder.diagrams)
        machines = [{k: v for k, v in entry.items() if k != "path"} for entry in bundled_machines()]
        return "done", {"folder": str(self.studio.folder.root), "diagrams": found, "machines": machines,
                        "first": self.studio.first}, None

    async def _open(self, message: dict[str, Any]) -> Answer:
        self.document = await asyncio.to_thread(self.studio.folder.read, str(message["name"]))
        self.others = {}
        return "done", _document(self.document), None

    async def _new(self, message: dict[str, Any]) -> Answer:
        return "done", {"name": await asyncio.to_thread(self.studio.folder.create, str(message["name"]))}, None

    async def _copy(self, message: dict[str, Any]) -> Answer:
        """A bundled machine with all its files as a folder of the opened folder."""
        from heavebond.estimation.starter_folder import start_folder

        name = str(message["name"])
        folder = self.studio.folder.path(f"{name}/{name}.yaml").parent
        if folder.parent != self.studio.folder.root.resolve():
            raise UsageError([Problem("name-bad", f"'{name}' cannot name a folder here")])
        made = await asyncio.to_thread(start_folder, folder, str(message["origin"]).removeprefix(BUNDLED))
        return "done", {"name": made.diagrams[0].relative_to(folder.parent).as_posix()}, None

    async def _derive(self, message: dict[str, Any]) -> Answer:
        values = {str(k): str(v) for k, v in message["values"].items()}
        made = await asyncio.to_thread(self.studio.folder.derive, str(message["name"]), str(message["origin"]), values)
        return "done", {"name": made}, None

    async def _write(self, message: dict[str, Any]) -> Answer:
        values = {str(k): str(v) for k, v in message["values"].items()}
        return "done", {"text": await asyncio.to_thread(with_values, str(message["text"]), values)}, None

    async def _save(self, message: dict[str, Any]) -> Answer:
        name, text, base = (str(message[k]) for k in ("name", "text", "base"))
        saved = await asyncio.to_thread(self.studio.folder.save, name, text, base)
        if self.document is not None and self.document.name == name:
            self.document = saved
        return "done", _document(saved), None

    async def _watch(self) -> None:
        """Tell the page of what changes on disk beside it."""
        while True:
            await asyncio.sleep(WATCH)
            document = self.document
            if document is None:
                continue
            if (now := await asyncio.to_thread(_again, self.studio.folder, document)) is not None \
                    and self.document is document:
                self.document = now
                await self._send({"push": "disk", **_document(now)})
            times = await asyncio.to_thread(_times, list(self.others))
            if times != self.others and self.document is document:
                self.others = times
                await self._send({"push": "others"})

    # -- work ----------------------------------------------------------------------------------------------------------
    def _job(self, message: dict[str, Any]) -> Job:
        name, text = str(message["name"]), str(message["text"])
        if len(text) > FILE_BYTES:
            raise UsageError([Problem("file-too-large", f"the text is larger than {FILE_BYTES // 10**6} MB")])
        values = {str(k): str(v) for k, v in message.get("values", {}).items()}
        return Job(text, str(self.studio.folder.path(name)), name, values)

    async def _view(self, message: dict[str, Any]) -> Answer:
        job = self._job(message)
        opened = [str(name) for name in message.get("opened", ())]
        answer = await self.checker.ask_newest("view", job, opened, patience=HANGS)
        if answer[0] == "done" and self.document is not None and self.document.name == job.name:
            self.others = await asyncio.to_thread(_times, answer[1].get("files", []))
        return answer

    async def _run(self, message: dict[str, Any]) -> Answer:
        job, task = self._job(message), str(message["do"])
        given = () if task == "prepare" else ([str(name) for name in message.get("names", ())],)
        ask = self.runner.ask_newest if task in ("run", "preview") else self.runner.ask
        return await ask(task, job, *given)

    async def _stop(self, _: dict[str, Any]) -> Answer:
        self.runner.stop()
        return "done", {}, None


def _document(document: Document) -> dict[str, Any]:
    return {"name": document.name, "text": document.text, "version": document.version, "writable": document.writable}


def _again(folder: Folder, document: Document) -> Document | None:
    """The document as it stands on disk now, if that is another one that can be read."""
    try:
        now = folder.read(document.name)
    except HeavebondError:
        return None  # deleted or being written; what is on the page can be saved again
    return now if now.version != document.version else None


def _times(files: list[str]) -> dict[str, float]:
    """When files were written last; 0 for one that is gone."""
    found = {}
    for file in files:
        try:
            found[file] = Path(file).stat().st_mtime
        except OSError:
            found[file] = 0.0
    return found


def _told(problem: Problem) -> dict[str, Any]:
    return {**problem.as_dict(), "text": str(problem)}


def _finite(value: Any) -> Any:
    """What JSON has no word for as null."""
    if isinstance(value, dict):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _page_files() -> dict[str, bytes]:
    """The files of the page by their names, read once; nothing else is served."""
    found, folders = {}, [("", resources.files("heavebond").joinpath("studio", "page"))]
    for prefix, folder in folders:
        for entry in folder.iterdir():
            if entry.is_dir():
                folders.append((f"{prefix}{entry.name}/", entry))
            elif Path(entry.name).suffix in KINDS:
                found[prefix + entry.name] = entry.read_bytes()
    return found


def bind(port: int | None) -> socket.socket:
    """A socket on 127.0.0.1: at `port`, else at the first of the usual ones that is free; UsageError where none is."""
    ports = [port] if port is not None else [*range(PORT, PORT + PORTS), 0]
    for number in ports:
        found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            found.bind(("127.0.0.1", number))
            return found
        except OSError as error:
            found.close()
            said = error.strerror or str(error)
    raise UsageError([Problem("port-taken", f"port {port} of this machine cannot be had: {said.lower()}", None,
                              "Give another one, or leave --port out.")])


def serve(studio: Studio, listener: socket.socket, ready: Callable[[], None]) -> None:
    """Serve until Ctrl-C or SIGTERM; `ready` is called as soon as the page can be opened."""
    config = uvicorn.Config(studio.app(), log_level="error", ws_max_size=4 * FILE_BYTES, timeout_graceful_shutdown=2,
                            server_header=False, access_log=False, lifespan="on", ws="websockets-sansio")
    server = uvicorn.Server(config)

    async def run() -> None:
        serving = asyncio.ensure_future(server.serve(sockets=[listener]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.02)
        if server.started:
            ready()
        await serving

    asyncio.run(run())
