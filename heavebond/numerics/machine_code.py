"""Equations as machine code, if a C compiler is present and they are evaluated often enough.

CasADi evaluates a function from its list of operations. Once the calls of an integrator have taken as long as compiling
takes, its right-hand side, Jacobian and directional derivatives are translated to C, compiled in a private folder that is
deleted when the library is loaded, and called instead; nothing compiled is read back from disk. The operations, their order
and their arithmetic are the same, and so are the results, to the last bit.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Thread, current_thread, main_thread
from typing import Any

import casadi as ca

from heavebond.equations.buffered import Array, Buffered

COMPILERS = ("gcc", "clang", "cc")
# Of the equations of a model: -O2 gains a few percent for a quarter more time; functions call each other directly, as
# no other library takes their place; with the arithmetic as it is written, results
# are the same to the last bit.
FLAGS = ("-O1", "-ffp-contract=off", "-fno-semantic-interposition")
CLONE_FS = 0x200  # of Linux: what a thread no longer shares with the others, its current folder among it
MACHINE_CODE, LISTED = "machine code", "list of operations"  # how equations are evaluated, in the statistics of a run
# Time between two looks at a thread that compiles (s), and as a share of the time waited so far: on a busy computer, a
# compiler may take a minute
AGAIN, LATER = 0.002, 0.05
Made = Callable[[Mapping[str, Any]], ca.Function]  # an integrator with these options besides its own


@dataclass(frozen=True)
class CompilingConstants:
    """The constants of the compilation of equations that many or long runs evaluate.

    seconds: time to compile a small function. Origin: measured, gcc 12. Doubled: searches of half a second to one second
        stay with the list of operations.
    seconds_per_operation: time to compile an operation. Origin: measured, at -O1. Doubled: as above, for large models.
    seconds_saved: time that an evaluation saves for each operation of a list. Origin: measured, 1.1 to 1.4 ns over functions
        of 28 to 561 operations. Doubled: searches are compiled after half as many runs, which pays for few.
    max_operations: operations up to which functions are compiled. Origin: measured up to 63 000 (10 s, 350 MB); a compiler
        takes more than proportional time and memory for longer functions. Doubled: compilations of a minute.
    saved: share of the time of a run that machine code saves. Origin: measured, 15 to 30 % of plain runs. Doubled: single
        runs are compiled, and take longer by the time of the compilation.
    timeout: seconds after which a compiler that this program started is ended. Origin: a bound. Doubled: nothing.
    """

    seconds: float = 0.1
    seconds_per_operation: float = 1.5e-4
    seconds_saved: float = 1.2e-9
    max_operations: int = 100_000
    saved: float = 0.2
    timeout: float = 120.0


COMPILING = CompilingConstants()


def compiler() -> str | None:
    """The C compiler of this computer, if there is one."""
    return next((name for name in COMPILERS if shutil.which(name)), None)


def loaded(source: Path, flags: Sequence[str]) -> ctypes.CDLL | None:
    """A program in C of this package, compiled into a private folder that is deleted as soon as it is loaded; None if this
    computer has no suitable compiler."""
    command = compiler()
    if command is None or sys.platform != "linux":
        return None
    try:
        with _folder() as folder:
            target = Path(folder) / f"{source.stem}.so"
            subprocess.run([command, *flags, "-shared", "-fPIC", "-o", str(target), str(source), "-lm"], check=True,
                           capture_output=True, timeout=60)
            return ctypes.CDLL(str(target))
    except (OSError, subprocess.SubprocessError):
        return None


def worthwhile(seconds: float, operations: int) -> bool:
    """True if functions with this number of operations should be compiled after calls that took this time (s): once the
    calls have taken as long as the compilation. At worst the total time is twice that of the better choice, for any number
    of further calls. A call that is known in advance counts with the time that it saves, `COMPILING.saved` of its
    duration."""
    return seconds >= COMPILING.seconds + COMPILING.seconds_per_operation * operations \
        and operations <= COMPILING.max_operations


def compiled(make: Made, flags: Sequence[str] = FLAGS) -> ca.Function:
    """The function that `make` builds, as machine code; RuntimeError if the compiler fails. (For methods that CasADi
    translates completely.)"""
    return _in_thread(lambda folder: make(_options(folder, flags)))


def with_compiled_equations(make: Made) -> ca.Function:
    """The integrator that `make` builds, with its equations as machine code. Raises RuntimeError if the compiler fails, or
    if the system does not permit a separate current folder of a thread, into which CasADi writes the C program of the
    equations."""
    def build(folder: str) -> ca.Function:
        if sys.platform != "linux" or ctypes.CDLL(None).unshare(CLONE_FS) != 0:
            raise RuntimeError("a thread cannot have a separate current folder")
        os.chdir(folder)  # of this thread alone
        return make(_options(folder, FLAGS))

    return _in_thread(build)


def _in_thread(build: Callable[[str], ca.Function]) -> ca.Function:
    """The result of `build`, which gets a folder for its files, in a thread; RuntimeError if it fails. CasADi calls the
    compiler by system(3), during which the whole process ignores interrupts. So that Ctrl-C is not lost, the main thread
    blocks the signal, since a blocked signal is not ignored, waits for it, and passes it to the handler."""
    results: list[ca.Function | Exception] = []

    def run() -> None:
        try:
            with _folder() as folder:
                results.append(build(folder))
        except Exception as error:
            results.append(error)

    # not a daemon: at the end of the process CasADi would abort in a thread that Python no longer lets run
    thread, handler = Thread(target=run), signal.getsignal(signal.SIGINT)
    if current_thread() is not main_thread() or handler is None:
        thread.start()
        thread.join()
    elif sys.platform != "linux":  # without sigtimedwait: an interrupt within AGAIN after the begin of the compiler is lost
        thread.start()
        while thread.is_alive():
            thread.join(AGAIN)
            signal.signal(signal.SIGINT, handler)
    else:
        mask, interrupted = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}), False
        began = clock.monotonic()
        try:
            thread.start()
            while thread.is_alive() and not interrupted:
                received = signal.sigtimedwait({signal.SIGINT}, max(AGAIN, LATER * (clock.monotonic() - began)))
                # Python 3.11 returns an arbitrary structure where another event ended the call just before its timeout
                interrupted = received is not None and received.si_signo == signal.SIGINT
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if interrupted:
            signal.signal(signal.SIGINT, handler)  # ignored while the compiler runs
            signal.raise_signal(signal.SIGINT)
            thread.join()  # if the handler returns
    if isinstance(result := results[0], Exception):
        raise RuntimeError(str(result)) from result
    return result


def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="heavebond_", ignore_cleanup_errors=True)


def _options(folder: str, flags: Sequence[str]) -> dict[str, Any]:
    # the library is in memory once it is loaded: CasADi need not look after the files, the folder goes
    return {"jit": True, "compiler": "shell", "jit_cleanup": False,
            "jit_options": {"compiler": compiler(), "linker": compiler(), "flags": list(flags), "directory": f"{folder}/",
                            "cleanup": False}}


class Evaluated:
    """An integrator of CasADi called on arrays, whose functions are compiled once its calls have taken long enough."""

    def __init__(self, make: Made, outputs: Sequence[str] | None = None):
        """`make` builds the integrator; `outputs` are those that are wanted, by default all."""
        self._make, self._outputs, function = make, outputs, make({})
        self._function = Buffered(function, outputs)
        self._operations = sum(_operations(function.get_function(name)) for name in function.get_function())
        self._seconds, self._tried, self.how = 0.0, False, LISTED

    def __call__(self, **arguments: Any) -> dict[str, Array]:
        """One integration; RuntimeError if it fails."""
        if not self._tried and worthwhile(self._seconds, self._operations):
            self._compile()
        began = clock.thread_time()
        try:
            return self._function(**arguments)
        finally:
            self._seconds += clock.thread_time() - began

    def expect(self, seconds: float) -> None:
        """Compile at once where a call of so many seconds (s) saves as much as compiling takes."""
        if not self._tried and worthwhile(COMPILING.saved * seconds, self._operations):
            self._compile()

    def _compile(self) -> None:
        self._tried = True  # also where it fails
        if compiler() is None:
            return
        try:
            self._function, self.how = Buffered(with_compiled_equations(self._make), self._outputs), MACHINE_CODE
        except RuntimeError:
            return

    def size1_in(self, name: str) -> int:
        """The number of elements of an input, as in `ca.Function`."""
        return self._function.size1_in(name)

    def stats(self) -> dict[str, Any]:
        """Counts of steps and evaluations of the last call, and how its equations were evaluated."""
        return {**self._function.stats(), "equations": self.how}


def _operations(function: ca.Function) -> int:
    """How many operations a function has; too many to compile where that is not known, or if it calls Python."""
    try:
        if any(inner.class_name() == "CallbackInternal" for inner in function.find_functions()):
            return COMPILING.max_operations + 1
        return int(function.n_instructions())
    except RuntimeError:
        return COMPILING.max_operations
