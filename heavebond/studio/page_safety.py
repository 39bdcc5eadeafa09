"""Access to the studio: a token in the address, the studio's own Host and Origin, and a strict policy for the page."""

from __future__ import annotations

import contextlib
import hmac
import secrets
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from starlette.requests import ClientDisconnect

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOSTS = ("127.0.0.1", "localhost")
# policy of a page in the opened folder: it contains all its data, and its script has no access to anything
ALONE = ("sandbox allow-scripts; default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; "
         "base-uri 'none'; form-action 'none'; frame-ancestors 'none'")


def new_token() -> str:
    """A random token of 256 bits."""
    return secrets.token_urlsafe(32)


def policy(nonce: str, port: int) -> bytes:
    """The content security policy: scripts and styles of the studio only (and the styles that the editor creates, by
    their nonce), connections to it only, no frames, no forms."""
    return (f"default-src 'none'; script-src 'self'; style-src 'self' 'nonce-{nonce}'; img-src 'self' data: blob:; "
            f"connect-src 'self' ws://127.0.0.1:{port} ws://localhost:{port}; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'").encode()


class Guard:
    """The middleware in front of the application: it refuses other hosts, other origins and other addresses, and answers
    for requests that fail, with no trace of the fault in the answer or on the terminal."""

    def __init__(self, app: ASGIApp, token: str, port: int):
        self.app, self.token = app, token
        self.hosts = {f"{host}:{port}".encode() for host in HOSTS}
        self.origins = {b"http://" + host for host in self.hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif self._admits(scope):
            await self._answered(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await _plain(send, 403, REFUSED)

    async def _answered(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The answer of the application; status 500, or the end of the socket, if it raises an exception."""
        begun, socket = False, scope["type"] == "websocket"

        async def noted(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        try:
            await self.app(scope, receive, noted)
        except Exception as error:
            disconnected = isinstance(error, ClientDisconnect)
            if not disconnected:
                print(f"the studio could not answer a request: {type(error).__name__}: {error}", file=sys.stderr)
            with contextlib.suppress(Exception):  # the page may have closed meanwhile
                if socket:
                    await send({"type": "websocket.close", "code": 1011})
                elif not begun and not disconnected:
                    await _plain(send, 500, FAILED)

    def _admits(self, scope: Scope) -> bool:
        """False for requests of pages of other sites: they have another Origin, or another Host if the name of the site
        resolves to this machine (DNS rebinding). A socket needs an Origin; browsers always send it."""
        headers = list(scope["headers"])
        host, origin = _values(headers, b"host"), _values(headers, b"origin")
        if len(host) != 1 or host[0] not in self.hosts or len(origin) > 1:
            return False
        if (origin and origin[0] not in self.origins) or (scope["type"] == "websocket" and not origin):
            return False
        first = str(scope["path"]).split("/")[1:2]  # the path of `OPTIONS *` and of CONNECT has none
        return bool(first) and hmac.compare_digest(first[0].encode("utf-8", "replace"), self.token.encode())


def _values(headers: Iterable[tuple[bytes, bytes]], name: bytes) -> list[bytes]:
    return [value.lower() for key, value in headers if key.lower() == name]


REFUSED = b"This address is not that of the studio. Open the one that `heavebond studio` printed.\n"
FAILED = b"The studio could not answer this request.\n"


async def _plain(send: Send, status: int, text: bytes) -> None:
    start: Message = {"type": "http.response.start", "status": status, "headers": [
        (b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(text)).encode()),
        (b"x-content-type-options", b"nosniff")]}
    await send(start)
    await send({"type": "http.response.body", "body": text})
