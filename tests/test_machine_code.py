"""Equations that are compiled once their runs have taken long enough give the results of the list of operations."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time as clock
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import heavebond as hb
from heavebond.numerics import machine_code
from heavebond.numerics.machine_code import COMPILING, worthwhile
from heavebond.optimise.adjoint import Adjoint
from heavebond.optimise.cost_evaluation import Evaluator
from heavebond.optimise.costs import read_cost

needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None or sys.platform != "linux", reason="no gcc on Linux here")


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """As if compiling took no time; the current folder, in which temporary files are made too."""
    monkeypatch.setattr(machine_code, "COMPILING", replace(COMPILING, seconds=1e-9, seconds_per_operation=0.0))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@needs_compiler
@pytest.mark.parametrize(("name", "solver", "moved"), [
    ("cmc_ahc", "idas", ("controller.K_p", "cmc.gas.c")), ("quarter_car", "cvodes", ()), ("examples/mi_field", "idas", ())])
def test_machine_code_gives_the_same_bits(eager: Path, name: str, solver: str, moved: tuple[str, ...]) -> None:
    """States and sensitivities, with algebraic unknowns too (`mi_field`), after as many steps; no file is left."""
    simulator = hb.Simulator(hb.assemble(hb.load(name)), solver=solver, sensitivities=moved)
    first, second = simulator.run(), simulator.run()
    assert (first.statistics["equations"], second.statistics["equations"]) == ("list of operations", "machine code")
    assert first.statistics["nsteps"] == second.statistics["nsteps"]
    assert np.array_equal(first.x, second.x) and np.array_equal(first.z, second.z)
    for parameter in moved:
        assert np.array_equal(first.sensitivity("WOB", parameter), second.sensitivity("WOB", parameter))
    assert list(eager.iterdir()) == []


@needs_compiler
@pytest.mark.parametrize("name", ["cmc_ahc", "examples/mi_field"])
def test_a_single_run_that_is_long_enough_is_compiled_before_it(eager: Path, name: str) -> None:
    """The first points tell how long it will take; what is short stays with the list of operations."""
    assembly = hb.assemble(hb.load(name))
    long, short = (hb.simulate(assembly, 10.0, every=every) for every in (1e-3, 1e-2))
    assert (long.statistics["equations"], short.statistics["equations"]) == ("machine code", "list of operations")
    usual = hb.Simulator(assembly, 10.0, every=1e-3, solver="auto").run()
    assert usual.statistics["equations"] == "list of operations"
    assert np.array_equal(long.x, usual.x) and np.array_equal(long.z, usual.z)
    assert long.statistics["nsteps"] == usual.statistics["nsteps"]


@needs_compiler
def test_gradients_backwards_by_machine_code_are_the_same(eager: Path) -> None:
    assembly = hb.assemble(hb.load("quarter_car"))
    cost = Evaluator(assembly, [read_cost(assembly, "rms(comfort)")], 0.0, 3.0)
    simulator = hb.Simulator(assembly, 3.0, quadratures=cost.quadratures, factors=cost.factors)
    adjoint = Adjoint(simulator, cost, ("spring.c", "damper.d"))
    run = simulator.run()
    (value, gradient), (again, other) = (adjoint.costs(run, np.zeros(1))[0] for _ in range(2))
    made, = adjoint._made.values()
    assert made.integrator.stats()["equations"] == "machine code"
    assert value == again and gradient.all() and np.array_equal(gradient, other)
    assert list(eager.iterdir()) == [] and Path.cwd() == eager  # no file is left, and the current folder is what it was


def test_without_a_compiler_runs_go_on_as_before(eager: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    simulator = hb.Simulator(hb.assemble(hb.load("quarter_car")), 1.0)
    first, second = simulator.run(), simulator.run()
    assert second.statistics["equations"] == "list of operations" and np.array_equal(first.x, second.x)


@needs_compiler
def test_a_compiler_that_fails_is_asked_once(eager: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(machine_code, "compiler", lambda: asked.append("") or "false")
    simulator = hb.Simulator(hb.assemble(hb.load("quarter_car")), 1.0)
    runs = [simulator.run() for _ in range(4)]
    assert len(asked) == 3  # once whether there is one, once to compile and to link
    assert all(run.statistics["equations"] == "list of operations" for run in runs)
    assert np.array_equal(runs[0].x, runs[-1].x) and list(eager.iterdir()) == []


def test_a_single_short_run_is_not_compiled() -> None:
    """The rule costs at most twice the time of the better choice."""
    assert hb.simulate(hb.load("quarter_car")).statistics["equations"] == "list of operations"
    assert not worthwhile(0.2, 1000) and worthwhile(0.3, 1000)
    assert not worthwhile(1e9, COMPILING.max_operations + 1)


@needs_compiler
def test_an_interrupt_while_the_compiler_runs_is_not_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = tmp_path / "slow-compiler"
    slow.write_text('#!/bin/sh\ntouch "$0.runs"\nsleep 5\nexec gcc "$@"\n', encoding="utf-8")
    slow.chmod(0o755)
    monkeypatch.setattr(machine_code, "compiler", lambda: str(slow))

    def interrupt() -> None:
        while not Path(f"{slow}.runs").exists():
            clock.sleep(0.01)
        clock.sleep(0.2)  # many times as long as between two looks
        os.kill(os.getpid(), signal.SIGINT)

    x, began = ca.SX.sym("x"), clock.perf_counter()
    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt):
        machine_code.with_compiled_equations(lambda options: ca.integrator("i", "idas", {"x": x, "ode": -x}, 0, 1, options))
    assert clock.perf_counter() - began < 4


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no sigtimedwait")
def test_no_interrupt_is_lost_when_a_program_begins_that_ignores_it() -> None:
    """system(3) ignores the signal in the whole process until its program has ended."""
    libc = ctypes.CDLL(None)
    for k in range(8):
        timer = threading.Timer(0.001 + 0.003*k, os.kill, (os.getpid(), signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012
            timer.start()
            machine_code._in_thread(lambda _: libc.system(b"sleep 0.05"))
            clock.sleep(0.05)
        timer.join()
        clock.sleep(0.06)  # the program of the thread that goes on


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no sigtimedwait")
def test_the_end_of_a_wait_by_another_event_is_no_interrupt(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python 3.11 returns an arbitrary structure where an event other than the signal ends the call just before its
    timeout: no run may end by it."""
    monkeypatch.setattr(signal, "sigtimedwait", lambda *_: signal.struct_siginfo((5, 0, 0, 0, 0, 0, 0)))
    built = ca.Function("built", [], [])

    def build(_: str) -> ca.Function:
        clock.sleep(0.02)  # many waits long
        return built

    assert machine_code._in_thread(build) is built


@needs_compiler
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no sigtimedwait")
def test_a_script_that_is_interrupted_while_the_compiler_runs_ends_without_abort() -> None:
    """The process waits for the thread that compiles: CasADi cannot end within a process that is about to end."""
    script = ("import os, signal, threading, casadi as ca; from heavebond.numerics import machine_code; x = ca.SX.sym('x');"
              "threading.Timer({0}, os.kill, (os.getpid(), signal.SIGINT)).start();"
              "machine_code.with_compiled_equations(lambda o: ca.integrator('i', 'idas', {{'x': x, 'ode': -x}}, 0, 1, o))")
    begun = [subprocess.Popen([sys.executable, "-c", script.format(0.01 * k)], stderr=subprocess.PIPE, text=True)
             for k in range(1, 5)]
    for process in begun:
        _, errors = process.communicate()
        assert process.returncode == -signal.SIGINT and errors.endswith("KeyboardInterrupt\n"), errors
