"""Options of the test run."""

from __future__ import annotations

import gc
import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

# the workers of the test run share the processors; commands that a test starts inherit this
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import heavebond.cli

os.environ.pop("COLUMNS", None)  # workers of the test run are told a terminal's width, which would fold all tables

os.environ.setdefault("HEAVEBOND_PROGRESS", "0")  # what a test compares must not depend on how long a command takes

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # behind `nohup`, or as a job of a script; tests press Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--update-golden`: write what the program says now over the stored messages, to be read in the diff."""
    parser.addoption("--update-golden", action="store_true", help="rewrite the stored messages of tests/wrong")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The pages of the documentation first: a page of two minutes that begins last would leave the other processors idle."""
    items.sort(key=lambda item: "::test_every_block_of_a_page_is_so" not in item.nodeid)


def pytest_collection_finish() -> None:
    """The collected tests and the imported libraries live to the end: the collector of cycles need not traverse them, and
    looks more rarely at what is created later."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


@pytest.fixture(scope="session")
def studies_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of this test run, the same for all workers, for the output of bundled studies (each in its subfolder): a case
    that a page or a test has completed is read by the others, as after an interruption."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "studies"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session", autouse=True)
def quick_compiler(tmp_path_factory: pytest.TempPathFactory) -> None:
    """FMUs are compiled with -O1, in half of the time that -O2 takes; `test_export.py` compiles them as users do."""
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is not None and os.name != "nt" and "CC" not in os.environ:
        script = tmp_path_factory.mktemp("compiler") / "cc"
        script.write_text(f'#!/bin/sh\nexec "{compiler}" "$@" -O1\n', encoding="utf-8")
        script.chmod(0o755)
        os.environ["CC"] = str(script)


@pytest.fixture(autouse=True)
def faults_of_the_program(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A command that ends with a fault of the program fails its test, whatever the test looks at; where the fault is what
    is tested, `@pytest.mark.own_fault`."""
    report, met = heavebond.cli.own_fault, []

    def noted(error: Exception, given: list[str]) -> object:
        met.append(error)
        return report(error, given)

    monkeypatch.setattr(heavebond.cli, "own_fault", noted)
    yield
    if met and request.node.get_closest_marker("own_fault") is None:
        raise AssertionError(f"a command ended with a fault of the program: {met[0]!r}") from met[0]
