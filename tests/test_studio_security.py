"""The studio against pages, links and requests that try to harm: nothing outside the folder is written, nothing is lost,
and every request has an answer."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from heavebond.core.errors import HeavebondError, Problem, UsageError
from heavebond.core.writable import confined, free_path, make_folder, new_file, write_text
from heavebond.studio import tab as tabs
from heavebond.studio.folder import MARKER, STALE, Folder, _mark, version
from heavebond.studio.page_safety import Guard
from heavebond.studio.record_upload import store
from heavebond.studio.tab import Tab
from heavebond.studio.workers import Pool, Worker, reasons

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="links and pipes are made by POSIX means")
TEXT = "model: car\n"


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    inside = tmp_path / "opened"
    (inside / "data").mkdir(parents=True)
    (tmp_path / "outside").mkdir()
    (inside / "car.yaml").write_text(TEXT)
    return Folder(inside)


def _outside(folder: Folder) -> list[str]:
    return sorted(os.listdir(folder.root.parent / "outside"))


async def _parts(*parts: bytes) -> AsyncIterator[bytes]:
    for part in parts:
        yield part


def _code(work: Callable[[], Any]) -> str:
    with pytest.raises(HeavebondError) as caught:
        work()
    return caught.value.problems[0].code


# -- links ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("taken", [["log.csv"], ["log.csv", "log_2.csv"], ["log.csv", "log_2.csv", "log_3.csv"]])
def test_an_upload_does_not_write_through_a_dangling_link(folder: Folder, taken: list[str]) -> None:
    for name in taken[:-1]:
        (folder.root / "data" / name).write_text("a,b\n")
    (folder.root / "data" / taken[-1]).symlink_to(folder.root.parent / "outside" / "new.csv")
    if len(taken) == 1:  # the name itself
        assert _code(lambda: asyncio.run(store(folder, "car.yaml", "log.csv", _parts(b"t,x\n")))) == "file-outside"
    else:
        name = asyncio.run(store(folder, "car.yaml", "log.csv", _parts(b"t,x\n", b"0,1\n")))
        assert name == f"data/log_{len(taken) + 1}.csv" and (folder.root / name).read_bytes() == b"t,x\n0,1\n"
    assert _outside(folder) == []


def test_an_upload_does_not_follow_a_folder_that_is_a_link(folder: Folder) -> None:
    (folder.root / "data").rmdir()
    for place in (folder.root.parent / "outside", folder.root.parent / "outside" / "not there yet"):
        (folder.root / "data").symlink_to(place)
        assert _code(lambda: asyncio.run(store(folder, "", "log.csv", _parts(b"1\n")))) == "file-outside"
        (folder.root / "data").unlink()
        assert _outside(folder) == []


def test_an_upload_beside_a_document_that_does_not_exist_makes_no_folders(folder: Folder) -> None:
    assert _code(lambda: asyncio.run(store(folder, "a/" * 900 + "b.yaml", "log.csv", _parts(b"1\n")))) == "file-missing"
    assert sorted(os.listdir(folder.root)) == ["car.yaml", "data"]


def test_results_of_long_computations_do_not_take_a_dangling_link_for_a_free_name(folder: Folder) -> None:
    """`fit`, `tune`, `try` and `diagnose` count a name up until it is free."""
    link = folder.root / "car_fitted.yaml"
    link.symlink_to(folder.root.parent / "outside" / "car.yaml")
    assert free_path(link).name == "car_fitted_2.yaml"
    with pytest.raises(FileExistsError):
        write_text(link, "model: a\n", exclusive=True)
    assert _outside(folder) == []


def test_nothing_is_written_outside_the_folder_whatever_path_is_asked_for(folder: Folder) -> None:
    """As the process of a long computation writes: reports, tables of a study, in the place of files that exist."""
    outside, root = folder.root.parent / "outside", folder.root
    (outside / "old.html").write_text("old")
    (root / "report.html").symlink_to(outside / "old.html")
    (root / "study").symlink_to(outside)
    os.mkfifo(root / "pipe.csv")
    paths = [root / "report.html", root / "study" / "table.csv", outside / "new.csv", root / ".." / "outside" / "a.csv",
             root / "pipe.csv"]
    with confined(root):
        for path in paths:
            with pytest.raises(OSError, match=path.name):
                write_text(path, "new")
        assert _code(lambda: make_folder(root / "study" / "cases")) == "file-unwritable"
        write_text(root / "data" / "table.csv", "new")
        make_folder(root / "a" / "b")
        with new_file(root / "a" / "b" / "x.csv", exclusive=True) as fresh:
            assert fresh.suffix == ".csv"
            fresh.write_text("1")
    assert (root / "data" / "table.csv").read_text() == "new" and (root / "a" / "b" / "x.csv").read_text() == "1"
    assert _outside(folder) == ["old.html"] and (outside / "old.html").read_text() == "old"


def test_a_folder_that_becomes_a_link_while_a_file_is_written_does_not_lead_outside(folder: Folder) -> None:
    data = folder.root / "data"
    with confined(folder.root), new_file(data / "x.csv") as fresh:
        data.rename(folder.root / "moved")
        data.symlink_to(folder.root.parent / "outside")
        fresh.write_text("1")
    assert _outside(folder) == [] and os.listdir(folder.root / "moved") == ["x.csv"]
    data.unlink()
    (folder.root / "moved").rename(data)
    path = folder.record("data/x.csv")
    data.rename(folder.root / "moved")
    data.symlink_to(folder.root.parent / "outside")
    (folder.root.parent / "outside" / "x.csv").write_text("secret")
    with pytest.raises(OSError, match="data"), folder.opened(path) as file:
        file.read()


def test_a_copied_machine_stays_in_the_folder(folder: Folder) -> None:
    from heavebond.estimation.starter_folder import new as start_folder

    (folder.root / "mine").symlink_to(folder.root.parent / "outside")
    with confined(folder.root):
        assert _code(lambda: start_folder(folder.root / "mine", "quarter_car")) == "file-unwritable"
    assert _outside(folder) == []


# -- pipes ---------------------------------------------------------------------------------------------------------------
def test_a_pipe_that_is_named_like_a_diagram_does_not_block_the_first_page(folder: Folder) -> None:
    """Each of these would wait for ever for somebody who writes into the pipe."""
    from heavebond.language.library import library

    os.mkfifo(folder.root / "x.yaml")
    os.mkfifo(folder.root / "data" / "log.csv")
    done = threading.Event()

    def look() -> None:
        assert [entry["name"] for entry in folder.diagrams()] == ["car.yaml"]
        assert _code(lambda: folder.read("x.yaml")) == "file-unreadable"
        assert _code(lambda: folder.save("x.yaml", "model: x\n", version(b""))) == "file-unwritable"
        assert asyncio.run(store(folder, "", "log.csv", _parts(b"1\n"))) == "data/log_2.csv"
        library([folder.root])
        done.set()

    threading.Thread(target=look, daemon=True).start()
    assert done.wait(20)


# -- simultaneous saves --------------------------------------------------------------------------------------------------
def test_of_two_tabs_that_save_at_the_same_moment_one_is_refused(folder: Folder) -> None:
    for number in range(20):
        base, accepted, gate = folder.read("car.yaml").version, [], threading.Barrier(2)

        def save(who: str, base: str = base, accepted: list[str] = accepted, gate: threading.Barrier = gate) -> None:
            gate.wait()
            with suppress(HeavebondError):
                folder.save("car.yaml", f"model: {who}\n", base)
                accepted.append(who)

        both = [threading.Thread(target=save, args=(f"{side}_{number}",)) for side in ("left", "right")]
        for thread in both:
            thread.start()
        for thread in both:
            thread.join()
        assert len(accepted) == 1 and folder.read("car.yaml").text == f"model: {accepted[0]}\n"


SAVER = """
import sys
from heavebond.core.errors import HeavebondError
from heavebond.studio.folder import Folder
from pathlib import Path
folder = Folder(Path(sys.argv[1]))
for line in sys.stdin:
    base = line.strip()
    try:
        print(len(folder.save("car.yaml", f"model: {sys.argv[2]}_{base}\\n", base).text) and "saved", flush=True)
    except HeavebondError as error:
        print(error.problems[0].code, flush=True)
"""


WITHOUT_LOCKS = """
import heavebond.studio.folder as own
own.fcntl = None
"""


@pytest.mark.parametrize("locks", [True, False])
def test_of_two_studios_that_save_at_the_same_moment_one_is_refused(folder: Folder, locks: bool) -> None:
    """Also on a system without locks of folders, by a lock file, which is then removed."""
    program = ("" if locks else WITHOUT_LOCKS) + SAVER
    studios = [subprocess.Popen([sys.executable, "-c", program, str(folder.root), side], stdin=subprocess.PIPE,
                                stdout=subprocess.PIPE, text=True) for side in ("left", "right")]
    for _ in range(20):
        base = folder.read("car.yaml").version
        for studio in studios:
            assert studio.stdin is not None
            studio.stdin.write(f"{base}\n")
            studio.stdin.flush()
        assert sorted(studio.stdout.readline().strip() for studio in studios if studio.stdout) == ["file-changed", "saved"]
    for studio in studios:
        studio.communicate(timeout=20)
    assert not (folder.root / MARKER).exists()


def test_a_lock_file_of_a_studio_that_ended_is_removed_and_that_of_another_one_respected(
        folder: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heavebond.studio.folder.fcntl", None)
    monkeypatch.setattr("heavebond.studio.folder.LOCKED", 0.1)
    marker, base = folder.root / MARKER, folder.read("car.yaml").version
    marker.touch()
    with pytest.raises(UsageError, match="another studio is saving"):
        folder.save("car.yaml", "model: late\n", base)
    assert marker.exists() and folder.read("car.yaml").version == base
    os.utime(marker, (time.time() - 2*STALE, time.time() - 2*STALE))
    folder.save("car.yaml", "model: later\n", base)
    assert folder.read("car.yaml").text == "model: later\n" and not marker.exists()


def test_of_two_studios_that_wait_for_a_lock_file_left_behind_one_removes_it(folder: Folder, monkeypatch: pytest.MonkeyPatch
                                                                             ) -> None:
    """The other one comes between the look at the old file and its removal, and has its own file then."""
    monkeypatch.setattr("heavebond.studio.folder.LOCKED", 0.1)
    marker, other_came, stat = folder.root / MARKER, [], os.stat
    marker.touch()
    os.utime(marker, (time.time() - 2*STALE, time.time() - 2*STALE))

    def looked(path: object, **named: object) -> os.stat_result:
        found = stat(path, **named)  # type: ignore[arg-type]
        if not other_came and str(path) == str(marker):
            other_came.append(True)
            _mark(-1, folder.root / "car.yaml")
        return found

    monkeypatch.setattr("heavebond.studio.folder.os.stat", looked)
    with pytest.raises(UsageError, match="another studio is saving"):
        _mark(-1, folder.root / "car.yaml")
    assert other_came and time.time() - stat(marker).st_mtime < STALE
    assert [file.name for file in folder.root.iterdir() if file.name.startswith(MARKER)] == [MARKER]


# -- requests ------------------------------------------------------------------------------------------------------------
class Socket:
    """The socket of a page that sends some texts and goes."""

    def __init__(self, *texts: str):
        self.texts, self.answers = list(texts), []

    async def receive_text(self) -> str:
        if not self.texts:
            await asyncio.sleep(0.1)
            raise tabs.WebSocketDisconnect
        return self.texts.pop(0)

    async def send_text(self, text: str) -> None:
        text.encode()
        self.answers.append(text)


@pytest.mark.parametrize("error", [
    OSError(28, "No space left on device", "x.yaml"), OverflowError("int too large"), RecursionError("too deep"),
    KeyError("name"), RuntimeError("wrong"), MemoryError(), UnicodeEncodeError("utf-8", "\ud800", 0, 1, "surrogate"),
    HeavebondError([Problem("usage", "wrong name \udcff")])], ids=lambda error: type(error).__name__)
def test_a_request_that_ends_in_an_exception_has_an_answer(folder: Folder, error: Exception) -> None:
    async def fail(*_: Any) -> Any:
        raise error

    socket = Socket('{"id": 1, "do": "fail"}')
    asyncio.run(Tab(socket, folder, "", {"fail": fail}, tabs.LongJobs(), Pool()).serve())  # type: ignore[arg-type]
    assert len(socket.answers) == 1 and '"id": 1' in socket.answers[0] and '"problems"' in socket.answers[0]


@pytest.mark.parametrize("text", ["[" * 100_000, "nonsense", "[1]", '{"id": 1e999, "do": []}', '{"id": [[]], "do": "home"}',
                                  '{"id": 1, "do": "home", "name": "\\ud800"}', "9" * 5000])
def test_a_request_that_no_page_sends_has_an_answer(folder: Folder, text: str) -> None:
    async def answer(tab: Tab, message: dict[str, Any]) -> Any:
        return "done", {"name": message.get("name")}, None

    socket = Socket(text, '{"id": 2, "do": "home"}')
    asyncio.run(Tab(socket, folder, "", {"home": answer}, tabs.LongJobs(), Pool()).serve())  # type: ignore[arg-type]
    assert len(socket.answers) == 2 and '"id": 2, "kind": "done"' in socket.answers[1]


def _through_guard(app: Callable[..., Any], path: str, method: str = "GET") -> list[dict[str, Any]]:
    sent: list[dict[str, Any]] = []

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    async def receive() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    scope = {"type": "http", "method": method, "path": path, "headers": [(b"host", b"127.0.0.1:9000")]}
    asyncio.run(Guard(app, "TOKEN", 9000)(scope, receive, send))  # type: ignore[arg-type]
    return sent


@pytest.mark.parametrize(("method", "path"), [("OPTIONS", "*"), ("CONNECT", "127.0.0.1:80"), ("GET", ""), ("GET", "//")])
def test_a_request_without_a_path_is_refused(method: str, path: str) -> None:
    assert _through_guard(lambda *_: pytest.fail("it was let in"), path, method)[0]["status"] == 403


def test_an_exception_behind_the_guard_is_answered_without_its_trace(capfd: pytest.CaptureFixture[str]) -> None:
    async def fail(*_: Any) -> None:
        raise OverflowError("too large")

    assert _through_guard(fail, "/TOKEN/")[0]["status"] == 500
    assert capfd.readouterr().err == "the studio could not answer a request: OverflowError: too large\n"


def test_an_upload_that_is_broken_off_leaves_no_trace_and_no_file(folder: Folder, capfd: pytest.CaptureFixture[str]) -> None:
    from heavebond.studio.server import Studio

    studio = Studio(folder, "", 9000)
    app = studio.app()
    sent = []

    async def send(message: Any) -> None:
        sent.append(message)

    messages = iter([{"type": "http.request", "body": b"1\n" * 9, "more_body": True}, {"type": "http.disconnect"}])

    async def receive() -> Any:
        return next(messages)

    scope = {"type": "http", "method": "POST", "path": f"/{studio.token}/records", "query_string": b"name=log.csv",
             "headers": [(b"host", b"127.0.0.1:9000")], "http_version": "1.1", "scheme": "http", "root_path": ""}
    asyncio.run(app(scope, receive, send))  # type: ignore[arg-type]
    assert capfd.readouterr().err == "" and os.listdir(folder.root / "data") == []


def test_a_file_whose_name_is_no_utf_8_is_listed(folder: Folder) -> None:
    path = os.fsencode(folder.root) + b"/\xff.yaml"
    with open(path, "w") as file:
        file.write(TEXT)

    async def answer(tab: Tab, _: dict[str, Any]) -> Any:
        return "done", {"diagrams": folder.diagrams()}, None

    socket = Socket('{"id": 1, "do": "home"}')
    asyncio.run(Tab(socket, folder, "", {"home": answer}, tabs.LongJobs(), Pool()).serve())  # type: ignore[arg-type]
    assert '"\\udcff.yaml"' in socket.answers[0]


@pytest.mark.slow
def test_no_attack_on_the_studio_succeeds() -> None:
    """`python -m benchmarks.studio_attack` lists them."""
    from benchmarks.studio_attack import attack

    counts = attack()
    assert [f"{name}: {fault}" for name, count in counts.items() for fault in count.faults] == []
    assert counts["paths"].made > 300 and counts["links"].made > 50 and counts["requests"].made > 300
    assert counts["simultaneous saves"].made == 40


# -- workers -------------------------------------------------------------------------------------------------------------
@pytest.fixture
def echoing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers that answer with the name of the task, and start at once as they import nothing."""
    fork = multiprocessing.get_context("fork")
    monkeypatch.setattr("heavebond.studio.workers.multiprocessing.get_context", lambda _: fork)
    monkeypatch.setattr("heavebond.studio.workers.work", _echo)


def test_a_stop_without_a_run_does_not_end_the_run_that_follows(echoing: None) -> None:

    async def work() -> None:
        worker = Worker()
        try:
            assert (await worker.ask("a"))[0] == "done"
            for _ in range(3):
                worker.stop()
                assert (await worker.ask("b"))[1] == "b"
        finally:
            worker.close()

    asyncio.run(work())


def test_the_processes_of_all_tabs_are_limited(echoing: None) -> None:
    """Twelve workers share three processes: all tasks are done, and never more than three processes live."""

    async def work() -> None:
        pool = Pool(3)
        workers = [Worker(pool) for _ in range(12)]
        most = 0

        async def count() -> None:
            nonlocal most
            while True:
                most = max(most, sum(w._process is not None and w._process.is_alive() for w in workers))
                await asyncio.sleep(0.01)

        counting = asyncio.create_task(count())
        answers = await asyncio.gather(*(worker.ask(str(k)) for k, worker in enumerate(workers)))
        workers[0].close()
        answers += await asyncio.gather(*(worker.ask("again") for worker in workers[:4]))
        counting.cancel()
        for worker in workers:
            worker.close()
        assert [told for _, told, _ in answers] == [*map(str, range(12)), *["again"] * 4] and most == 3

    asyncio.run(work())


def _echo(pipe: Any, *_permissions: bool) -> None:
    """A worker that answers with the name of the task."""
    while True:
        try:
            task, _ = pipe.recv()
        except EOFError:
            return
        pipe.send(("done", task, None))


def test_the_reason_of_an_exception_is_a_fault_of_heavebond_only_where_nothing_else_is() -> None:
    assert [reasons(error)[0].code for error in (OSError(2, "none", "x"), MemoryError(), RuntimeError("x"))] == [
        "file", "memory", "internal"]
