"""Attacks on the server of the studio, with their counts: paths, links, requests and simultaneous saves.

`python -m benchmarks.studio_attack` starts `heavebond studio` in a temporary folder, sends what no page sends, and counts
the faults of each kind: a file outside the folder that was read or written, a request without an answer, a save that was
accepted and lost, a traceback on the terminal of the server.
"""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

PATIENCE = 60.0  # s for one answer; the first one of a kind may import what it needs
SAVES = 20  # rounds of simultaneous saves
SECRET = "kept away from pages"
CAR = "model: car\n"
VIOLENT = ("..", ".", "", "/", "/etc/passwd", "../secret.yaml", "sub/../../secret.yaml", "..\\secret.yaml", ".hidden.yaml",
           ".git/config.yaml", "a\0.yaml", "\ud800.yaml", "\udcff.yaml", "link.yaml", "linked/secret.yaml", "loop.yaml",
           "pipe.yaml", "x" * 5000 + ".yaml", "a/" * 1500 + "b.yaml", "~/.bashrc", "file:///etc/passwd",
           "//host/share/a.yaml", "C:\\a.yaml", "secret.yaml\n", "%2e%2e/secret.yaml", "folder.yaml", "/proc/self/environ",
           "/dev/zero", "bundled:../../setup.yaml")
KINDS = ("open", "save", "new", "copy", "derive", "view", "run", "edit", "palette", "component", "propose", "experiment",
         "join", "jobs", "begin", "end", "array", "add", "write", "compare", "channel", "against", "stop", "signals",
         "spectrum", "picture", "forms",
         "nonsense")


@dataclass
class Count:
    """How many attacks of a kind were made, and which of them succeeded."""

    made: int = 0
    faults: list[str] = field(default_factory=list)

    def note(self, what: str, fault: str = "") -> None:
        """One attack with its fault, if there was one."""
        self.made += 1
        if fault:
            self.faults.append(f"{what}: {fault}")


class Server:
    """A studio in another process; `errors` is the file of its standard error."""

    def __init__(self, folder: Path):
        self.opened = ExitStack()
        self.errors = folder.parent / f"errors_{id(self)}"
        command = [sys.executable, "-c", "from heavebond.cli import main; main()", "studio", str(folder), "--no-browser"]
        with open(self.errors, "w", encoding="utf-8") as errors:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
        assert self.process.stdout is not None
        address = re.search(r"http://127\.0\.0\.1:(\d+)/([^/]+)/", self.process.stdout.readline())
        assert address is not None
        self.port, self.token = int(address.group(1)), address.group(2)

    def socket(self) -> ClientConnection:
        """The socket of a page."""
        return self.opened.enter_context(connect(
            f"ws://127.0.0.1:{self.port}/{self.token}/socket", origin=Origin(f"http://127.0.0.1:{self.port}"), max_size=None,
            open_timeout=60))

    def raw(self, request: bytes, *, broken_off: bool = False) -> bytes:
        """The answer to a request as it is; empty if there was none."""
        with socket.create_connection(("127.0.0.1", self.port), PATIENCE) as line:
            line.sendall(request)
            if broken_off:
                time.sleep(0.05)
                return b""
            parts = []
            with suppress(TimeoutError, ConnectionError):
                while part := line.recv(65536):
                    parts.append(part)
            return b"".join(parts)

    def http(self, method: str, path: str, body: bytes = b"", headers: str = "", host: str = "") -> bytes:
        """The answer to a request with a head."""
        host = host or f"127.0.0.1:{self.port}"
        head = f"{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n" \
               f"Content-Length: {len(body)}\r\n{headers}\r\n"
        return self.raw(head.encode("latin-1", "replace") + body)

    def end(self) -> str:
        """End it as by Ctrl-C; what it has printed on its standard error."""
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(PATIENCE)
        finally:
            self.process.kill()
        self.opened.close()
        return self.errors.read_text(encoding="utf-8")


def ask(page: ClientConnection, **message: Any) -> str:
    """The answer to a request of a page; empty if there was none."""
    return _answer(page, json.dumps({"id": 7, **message}))


def _answer(page: ClientConnection, text: str | bytes) -> str:
    try:
        page.send(text)
        while True:
            answer = page.recv(PATIENCE)
            if isinstance(answer, bytes) or '"push"' not in answer[:20]:
                return answer if isinstance(answer, str) else "bytes"
    except Exception as error:
        return "" if isinstance(error, TimeoutError) else f"closed {type(error).__name__}"


def prepare(top: Path) -> Path:
    """A folder with links and pipes in it, beside what pages must not see."""
    folder = top / "opened"
    (folder / "data").mkdir(parents=True)
    (folder / "folder.yaml").mkdir()
    (top / "outside").mkdir()
    (top / "secret.yaml").write_text(f"model: {SECRET}\n")
    (top / "outside" / "secret.html").write_text(SECRET)
    (folder / "car.yaml").write_text(CAR)
    (folder / ".hidden.yaml").write_text(f"model: {SECRET}\n")
    for name, target in (("link.yaml", top / "secret.yaml"), ("linked", top), ("loop.yaml", folder / "loop.yaml"),
                         ("new.yaml", top / "outside" / "new.yaml"), ("mine", top / "outside"),
                         ("page.html", top / "outside" / "secret.html"), ("data/log.csv", top / "outside" / "log.csv")):
        (folder / name).symlink_to(target)
    for k in range(1, 6):
        (folder / "data" / f"run{f'_{k}' if k > 1 else ''}.csv").symlink_to(top / "outside" / f"run{k}.csv")
    os.mkfifo(folder / "pipe.yaml")
    return folder


def _seen(top: Path) -> dict[str, bytes]:
    """The files outside the opened folder with their contents."""
    outside = [path for part in sorted(top.iterdir()) if part.name != "opened" for path in (part, *sorted(part.rglob("*")))]
    return {str(path): path.read_bytes() for path in outside if path.is_file() and not path.name.startswith("errors_")}


def _violations(answer: str, before: dict[str, bytes], top: Path) -> str:
    if not answer:
        return "no answer"
    if SECRET in answer or "root:x:" in answer:
        return "read outside the folder"
    return "" if _seen(top) == before else "wrote outside the folder"


def paths(server: Server, top: Path, count: Count) -> None:
    """Names that lead out of the folder, in every request that has one."""
    page, before = server.socket(), _seen(top)
    for name in VIOLENT:
        for kind in ("open", "save", "new", "copy", "derive", "view", "propose", "join", "begin", "experiment"):
            answer = ask(page, do=kind, name=name, text=CAR, base="", origin="car.yaml", values={}, file=name, files=[name],
                         kind="fit", model=name, columns=[])
            count.note(f"{kind} {name[:40]!r}", _violations(answer, before, top))
            if answer.startswith("closed"):
                page = server.socket()
        quoted = "".join(f"%{byte:02x}" for byte in name.encode("utf-8", "surrogatepass"))
        for path in (f"/{server.token}/{quoted}", f"/{server.token}/reports/{quoted}"):
            if len(path) < 60_000:
                answer = server.http("GET", path).decode("utf-8", "replace")
                count.note(f"GET {name[:40]!r}", _violations(answer, before, top))
        stored = server.http("POST", f"/{server.token}/records?beside={quoted}&name={quoted}.csv", b"t,x\n0,1\n")
        count.note(f"upload {name[:40]!r}", _violations(stored.decode("utf-8", "replace"), before, top))


def links(server: Server, top: Path, count: Count) -> None:
    """Links in the folder that lead out of it, most of them to files that do not exist."""
    page, before = server.socket(), _seen(top)
    def upload(name: str) -> str:
        return server.http("POST", f"/{server.token}/records?beside=car.yaml&name={name}", b"t,x\n0,1\n").decode()

    attempts: list[tuple[str, Callable[[], str]]] = [
        ("upload", lambda: upload("log.csv")), ("upload beside links", lambda: upload("run.csv")),
        ("new", lambda: ask(page, do="new", name="new")),
        ("save", lambda: ask(page, do="save", name="new.yaml", text=CAR, base="")),
        ("derive", lambda: ask(page, do="derive", name="new", origin="car.yaml", values={})),
        ("copy", lambda: ask(page, do="copy", name="mine", origin="quarter_car")),
        ("report", lambda: server.http("GET", f"/{server.token}/reports/page.html").decode()),
        ("open", lambda: ask(page, do="open", name="link.yaml")), ("first page", lambda: ask(page, do="home"))]
    for what, attempt in attempts:
        count.note(what, _violations(attempt(), before, top))
    # a folder that becomes a link again and again while files are saved in it
    moving = threading.Event()
    real, spare = top / "opened" / "moving", top / "opened" / "spare"
    real.mkdir()
    (real / "a.yaml").write_text(CAR)

    def move() -> None:
        while not moving.is_set():
            with suppress(OSError):
                real.rename(spare)
                real.symlink_to(top / "outside")
                real.unlink()
                spare.rename(real)

    mover = threading.Thread(target=move)
    mover.start()
    try:
        for k in range(50):
            answer = ask(page, do="save", name="moving/a.yaml", text=f"model: a{k}\n", base="")
            answer += ask(page, do="save", name=f"moving/b{k}.yaml", text=CAR, base="")
            count.note("save in a folder that becomes a link", _violations(answer, before, top))
    finally:
        moving.set()
        mover.join()


def requests(server: Server, top: Path, count: Count) -> None:
    """Requests that no page sends: each has an answer, and the server goes on."""
    good = f"/{server.token}/"
    host = f"Host: 127.0.0.1:{server.port}\r\n".encode()
    for what, request in _raw_requests(good, host):
        answer = server.raw(request)
        count.note(what, "" if answer.startswith((b"HTTP/1.1 4", b"HTTP/1.1 5")) else
                   f"answered by {answer[:40]!r}")
    for what, answer in (("another host", server.http("GET", good, host="evil.example")),
                         ("another origin", server.http("GET", good, headers="Origin: http://evil.example\r\n")),
                         ("two hosts", server.http("GET", good, headers=f"Host: 127.0.0.1:{server.port}\r\n")),
                         ("no token", server.http("GET", "/")), ("half of the token", server.http("GET", good[:20] + "/"))):
        count.note(what, "" if b" 403 " in answer[:20] or b" 400 " in answer[:20] else f"answered by {answer[:40]!r}")
    for sent in (0, 1, 4):  # of 100 bytes
        head = f"POST {good}records?name=broken{sent}.csv HTTP/1.1\r\n".encode() + host + b"Content-Length: 100\r\n\r\n"
        server.raw(head + b"1\n"[:sent], broken_off=True)
        count.note("broken-off upload")
    wrong: list[Any] = [None, 7, -1, 1e308, 10**400, True, "", "\0", "\ud800", [], [[]], {}, {"a": {"b": []}}, "x" * 1000]
    page = server.socket()
    for text in ("[" * 100_000, '{"a":' * 50_000, "nonsense", "[]", "7", '"x"', "{}", '{"do": []}', "\0", "1" * 5000):
        page = _noted(server, page, text, count, f"text {text[:20]!r}")
    for kind in KINDS:
        for value in wrong if kind != "stop" else ():
            names = ("name", "text", "base", "values", "file", "files", "kind", "model", "columns", "free", "number", "key",
                     "given", "origin", "record", "channel", "signal", "names", "opened", "action", "empty", "use")
            # no text of a diagram: nothing gets as far as a worker
            message = {"id": 7, "do": kind, **dict.fromkeys(names, value)}
            with suppress(ValueError):
                page = _noted(server, page, json.dumps(message), count, f"{kind} {str(value)[:20]!r}")
    for _ in range(20):
        server.socket().close()
    count.note("the server goes on", "" if ask(server.socket(), do="open", name="car.yaml") else "no answer")


def _noted(server: Server, page: ClientConnection, text: str, count: Count, what: str) -> ClientConnection:
    answer = _answer(page, text)
    count.note(what, "" if answer and not answer.startswith("closed") else answer or "no answer")
    return page if answer and not answer.startswith("closed") else server.socket()


def _raw_requests(good: str, host: bytes) -> Iterator[tuple[str, bytes]]:
    end = b"Connection: close\r\n\r\n"
    yield "OPTIONS *", b"OPTIONS * HTTP/1.1\r\n" + host + end
    yield "CONNECT", b"CONNECT 127.0.0.1:80 HTTP/1.1\r\n" + host + end
    yield "no method", b" / HTTP/1.1\r\n" + host + end
    yield "no HTTP", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n"
    yield "absolute address", b"GET http://evil.example/ HTTP/1.1\r\n" + host + end
    yield "long path", b"GET /" + b"a" * 50_000 + b" HTTP/1.1\r\n" + host + end
    yield "bytes in the path", b"GET /\xff\xfe%ff%00 HTTP/1.1\r\n" + host + end
    yield "wrong length", f"POST {good}records?name=a.csv HTTP/1.1\r\n".encode() + host + b"Content-Length: -5\r\n" + end
    yield "put", f"PUT {good}car.yaml HTTP/1.1\r\n".encode() + host + b"Content-Length: 1\r\n" + end + b"x"
    yield "delete", f"DELETE {good}car.yaml HTTP/1.1\r\n".encode() + host + end


def saves(servers: list[Server], folder: Path, count: Count) -> None:
    """Two pages that save at the same moment, of one studio and of two studios of the same folder."""
    for what, one, other in (("two tabs", servers[0], servers[0]), ("two studios", servers[0], servers[1])):
        pages = one.socket(), other.socket()
        for number in range(SAVES):
            base = json.loads(ask(pages[0], do="open", name="car.yaml"))["version"]
            answers, gate = ["", ""], threading.Barrier(2)

            def save(k: int, base: str = base, number: int = number, answers: list[str] = answers,
                     gate: threading.Barrier = gate, what: str = what, pages: tuple[ClientConnection, ...] = pages) -> None:
                gate.wait()
                answers[k] = ask(pages[k], do="save", name="car.yaml", text=f"model: {what} {number} of {k}\n", base=base)

            both = [threading.Thread(target=save, args=(k,)) for k in (0, 1)]
            for thread in both:
                thread.start()
            for thread in both:
                thread.join()
            accepted = [k for k in (0, 1) if '"kind": "done"' in answers[k]]
            kept = (folder / "car.yaml").read_text()
            count.note(what, "" if len(accepted) == 1 and kept == f"model: {what} {number} of {accepted[0]}\n" else
                       f"{len(accepted)} accepted")


def attack() -> dict[str, Count]:
    """All attacks, by kind; `terminal` counts the servers and those that printed a traceback."""
    counts = {name: Count() for name in ("paths", "links", "requests", "simultaneous saves", "terminal")}
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        top = Path(name)
        folder = prepare(top)
        servers = [Server(folder), Server(folder)]
        saves(servers, folder, counts["simultaneous saves"])
        for kind, work in (("paths", paths), ("links", links), ("requests", requests)):
            try:
                work(servers[0], top, counts[kind])
            except Exception as error:
                counts[kind].note(kind, f"the server does not answer any more: {type(error).__name__}: {error}")
        for server in servers:
            said = server.end()
            counts["terminal"].note("studio", f"{said.count('Traceback')} tracebacks" if "Traceback" in said else "")
    return counts


def main() -> None:
    """As the command line calls it."""
    counts = attack()
    for name, count in counts.items():
        print(f"{name}: {count.made} attacks, {len(count.faults)} faults")
        for fault in count.faults[:20]:
            print(f"  {fault}")
    sys.exit(any(count.faults for count in counts.values()))


if __name__ == "__main__":
    main()
