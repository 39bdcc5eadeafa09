"""A studio and a page of it in a headless browser, as fixtures that the tests of pages share."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import browser
import pytest

import heavebond as hb


class Server:
    """`heavebond studio` as a process of its own."""

    def __init__(self, folder: Path, *options: str):
        self.folder, self.options = folder, options
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-c", "from heavebond.cli import main; main()", "studio", ".", "--no-browser", "--port",
                   str(self.port), *self.options]
        self.process = subprocess.Popen(command, cwd=self.folder, stdout=subprocess.PIPE, text=True,
                                        env={**os.environ, "PYTHONPATH": str(Path(hb.__file__).parents[1])})
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        self.address = line.split(": ")[1].strip()

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def end(self) -> int:
        """As by Ctrl-C; the exit code."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(20)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    if browser.browser() is None:
        pytest.skip("no browser is installed")
    found = Server(tmp_path_factory.mktemp("folder"))
    yield found
    if found.process.poll() is None:
        assert found.end() == 0


@pytest.fixture(scope="module")
def tab(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Tab]:
    found = browser.Tab(tmp_path_factory.mktemp("browser") / "profile", 1500, 1000)
    yield found
    found.close()
