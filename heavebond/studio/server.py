"""The studio's server: the page and its files, and a socket for each tab."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from importlib import resources
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.limits import FILE_BYTES
from heavebond.studio.folder import Folder
from heavebond.studio.long_jobs import LongJobs
from heavebond.studio.page_safety import ALONE, Guard, new_token, policy
from heavebond.studio.record_upload import store
from heavebond.studio.requests import HANDLERS
from heavebond.studio.tab import Tab
from heavebond.studio.workers import Pool, reasons, start_imports

PORT, PORTS = 8437, 20  # the first port that is tried, and their number; the browser keeps drafts of unsaved texts by port
KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
REPORTS = {".html": "text/html; charset=utf-8", ".png": "image/png"}


class Studio:
    """The opened folder with the workers of all tabs."""

    def __init__(self, folder: Folder, first: str, port: int, command_line: str = ""):
        self.command_line = command_line  # the table of commands as `module:name`; without it the studio offers none
        self.folder, self.first, self.port, self.token = folder, first, port, new_token()
        # the files of the page by their names, read once; no other files are served
        files = resources.files("heavebond")
        contents, folders = {}, [("", files.joinpath("studio", "page")), ("space/", files.joinpath("web", "space"))]
        for prefix, directory in folders:
            for entry in directory.iterdir():
                if entry.is_dir():
                    folders.append((f"{prefix}{entry.name}/", entry))
                elif Path(entry.name).suffix in KINDS:
                    contents[prefix + entry.name] = entry.read_bytes()
        self.page = contents
        self.tabs: set[Tab] = set()
        self.jobs, self.pool = LongJobs(), Pool()

    @property
    def address(self) -> str:
        """The address for the browser."""
        return f"http://127.0.0.1:{self.port}/{self.token}/"

    def app(self) -> Guard:
        """The application, behind its guard."""
        routes = [Route(f"/{self.token}/", self._index),
                  Route(f"/{self.token}/records", self._record, methods=["POST"]),
                  Route(f"/{self.token}/reports/{{name:path}}", self._report),
                  Route(f"/{self.token}/{{name:path}}", self._file), WebSocketRoute(f"/{self.token}/socket", self._socket)]
        return Guard(Starlette(routes=routes, lifespan=self._lifespan), self.token, self.port)

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        start_imports()
        try:
            yield
        finally:
            for tab in list(self.tabs):
                tab.close()
            self.jobs.close()

    async def _index(self, _: Request) -> Response:
        nonce = secrets.token_urlsafe(16)
        text = self.page["index.html"].decode("utf-8").replace("NONCE", nonce)
        return self._answer(text.encode("utf-8"), ".html", nonce)

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in self.page or name == "index.html":
            return Response("There is no such file.\n", 404, self._headers(""), "text/plain")
        return self._answer(self.page[name], Path(name).suffix, "")

    async def _record(self, request: Request) -> Response:
        """Store a file that was dropped on the page in the opened folder."""
        try:
            name = await store(self.folder, request.query_params.get("beside", ""), request.query_params.get("name", ""),
                               request.stream())
            answer: dict[str, object] = {"file": name}
        except ClientDisconnect:
            raise
        except Exception as error:
            answer = {"problems": [{**p.as_dict(), "text": str(p)} for p in reasons(error)]}
        return Response(json.dumps(answer), 200, self._headers(""), "application/json")

    async def _report(self, request: Request) -> Response:
        """A report in the opened folder, or a picture of it, isolated in its origin: its script reaches neither the studio
        nor the network."""
        name = request.path_params["name"]
        try:
            if Path(name).suffix not in REPORTS:
                raise UsageError([Problem("file-outside", "no report")])
            with self.folder.opened(self.folder.record(name)) as file:
                content = await asyncio.to_thread(file.read, FILE_BYTES + 1)
            if len(content) > FILE_BYTES:
                raise UsageError([Problem("file-too-large", "no report")])
        except (HeavebondError, OSError):
            return Response("There is no such report.\n", 404, self._headers(""), "text/plain")
        return Response(content, 200, {**self._headers(""), "Content-Security-Policy": ALONE}, REPORTS[Path(name).suffix])

    def _answer(self, content: bytes, suffix: str, nonce: str) -> Response:
        return Response(content, 200, self._headers(nonce), KINDS[suffix])

    def _headers(self, nonce: str) -> dict[str, str]:
        return {"Content-Security-Policy": policy(nonce or "none", self.port).decode(), "Cache-Control": "no-store",
                "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
                "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Resource-Policy": "same-origin"}

    async def _socket(self, websocket: WebSocket) -> None:
        await websocket.accept()
        tab = Tab(websocket, self.folder, self.first, HANDLERS, self.jobs, self.pool, self.command_line)
        self.tabs.add(tab)
        try:
            await tab.serve()
        finally:
            self.tabs.discard(tab)
            tab.close()


def bind(port: int | None) -> socket.socket:
    """A socket on 127.0.0.1: at `port`, else at the first of the usual ones that is free; UsageError if there is none."""
    ports = [port] if port is not None else [*range(PORT, PORT + PORTS), 0]
    for number in ports:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(("127.0.0.1", number))
            return listener
        except OSError as error:
            listener.close()
            reason = error.strerror or str(error)
    raise UsageError([Problem("port-taken", f"port {port} of this machine cannot be opened: {reason.lower()}", None,
                              "Give another one, or leave --port out.")])


def serve(studio: Studio, listener: socket.socket, ready: Callable[[], None]) -> None:
    """Serve until Ctrl-C or SIGTERM; `ready` is called as soon as the page can be opened."""
    config = uvicorn.Config(studio.app(), log_level="error", ws_max_size=4 * FILE_BYTES, timeout_graceful_shutdown=2,
                            server_header=False, access_log=False, lifespan="on", ws="websockets-sansio",
                            ws_per_message_deflate=False)  # on one machine compressing takes longer than sending
    server = uvicorn.Server(config)

    async def run() -> None:
        serving = asyncio.ensure_future(server.serve(sockets=[listener]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.02)
        if server.started:
            ready()
        await serving

    asyncio.run(run())
