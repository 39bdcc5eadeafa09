"""Ctrl-C while a result is finished, and as a library hands it on."""

import os
import signal
import threading
from collections.abc import Iterator

import pytest

from heavebond.basis.interrupts import finishing, is_interrupt


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)
    signal.sigtimedwait((), 0.01)  # the handler runs before the next statement


@pytest.fixture(autouse=True)
def heard() -> Iterator[None]:
    """Ctrl-C as Python hears it; a shell has it ignored by what it begins in the background, these tests perhaps too."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_where_it_is_ignored_it_stays_so() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    said: list[str] = []
    with finishing(said.append):
        interrupt()
    assert not said and signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_the_first_is_answered_and_the_second_obeyed() -> None:
    said: list[str] = []
    done = []

    def work() -> None:
        with finishing(said.append):
            interrupt()
            done.append("finished")
            interrupt()

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["finished"] and len(said) == 1 and "Ctrl-C once more" in said[0]
    with pytest.raises(KeyboardInterrupt):  # and as it was behind it
        interrupt()


def test_elsewhere_than_in_the_main_thread_nothing_is_changed() -> None:
    before, seen = signal.getsignal(signal.SIGINT), []

    def work() -> None:
        with finishing(lambda text: None):
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]


def test_what_a_library_makes_of_it_is_known_again() -> None:
    wrapped = SystemError("returned a result with an exception set")
    wrapped.__cause__ = KeyboardInterrupt()
    assert is_interrupt(wrapped) and is_interrupt(KeyboardInterrupt())
    assert not is_interrupt(ValueError()) and not is_interrupt(None)
