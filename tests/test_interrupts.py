"""Ctrl-C and SIGTERM: while a result is finished, as a library hands them on or drops them, and what they leave."""

import json
import os
import signal
import subprocess
import sys
import threading
import time as clock
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from click.testing import CliRunner

import heavebond as hb
from heavebond.cli import main
from heavebond.core.cancellation import check, clear_signal, deferred, finishing, is_interrupt, listening, time_limit
from heavebond.core.parallel import Processes, as_done
from heavebond.diagnosis.answer import files
from heavebond.estimation.residuals import Residuals
from heavebond.optimise.objective import Objective

MODEL = """
model: pair
components: {wall: {is: Fixed}, spring: {is: SpringDamper, c: 2 kN/m, d: 20 N*s/m}, cart: {is: Mass, m: 3 kg}}
nodes: {wall: [wall.a, spring.a], cart: [spring.b, cart.a]}
initial: {cart.x: 10 mm, cart.v: 0 m/s}
simulate: {until: 0.5 s, every: 10 ms}
"""


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
    assert done == ["finished"] and len(said) == 1 and "second Ctrl-C" in said[0]
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


def terminate() -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    signal.sigtimedwait((), 0.01)


def test_sigterm_is_heard_as_ctrl_c_and_only_within() -> None:
    def work() -> None:
        with listening():
            terminate()

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        work()
    assert signal.getsignal(signal.SIGTERM) == before
    check()  # what was heard within is forgotten behind it


def test_sigterm_is_put_off_while_a_result_is_finished() -> None:
    said: list[str] = []
    with listening():
        with finishing(said.append):
            terminate()
        assert len(said) == 1


def test_a_signal_waits_for_the_end_of_a_step() -> None:
    """And another one behind it does not; one that was heard before is no reason to end the step's own exit."""
    done = []

    def work() -> None:
        with deferred():
            terminate()
            with deferred():
                done.append("step")
        done.append("not reached")

    with listening():
        with pytest.raises(KeyboardInterrupt):
            work()
        assert done == ["step"]
        with deferred():
            done.append("exit")
        with pytest.raises(KeyboardInterrupt):
            terminate()
        clear_signal()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals are sent by POSIX means")
@pytest.mark.parametrize("name", ["_work_ids", "_pending_work_items"])
def test_a_signal_does_not_leave_an_executor_half_way(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that arrives while a job is handed over, where the executor holds its locks: the job is handed over all the same,
    and the threads and processes of the executor end without an error."""
    failed: list[object] = []
    monkeypatch.setattr(threading, "excepthook", failed.append)
    made = []

    def hit(_: object) -> None:
        if not made:
            made.append(name)
            terminate()

    def work(workers: Processes) -> None:
        kept = getattr(workers.pool, name)
        if name == "_work_ids":
            monkeypatch.setattr(kept, "_put", lambda item, put=kept._put: (hit(item), put(item)))
        else:
            class Items(dict[int, object]):
                def __setitem__(self, key: int, item: object) -> None:
                    super().__setitem__(key, item)
                    hit(item)

            workers.pool._pending_work_items = Items()
        with workers:
            list(as_done(workers, _slow, [(k, (1,)) for k in range(3)], 2))

    with listening():
        workers = Processes(1)
        with pytest.raises(KeyboardInterrupt):
            work(workers)
        assert clear_signal() == signal.SIGTERM and made
        assert workers.pool._queue_count == 1  # the step was done to its end, and no further one was begun
    for thread in threading.enumerate():
        if thread is not threading.main_thread() and not thread.daemon:
            thread.join(20)
            assert not thread.is_alive()
    assert not failed


def test_a_signal_that_a_library_drops_is_raised_again() -> None:
    """An object that CasADi asks for its value while the handler raises: the exception is cleared inside of it."""
    class Number:
        def __SX__(self) -> ca.SX:
            terminate()
            return ca.SX(1)

    seen = []
    with listening():
        try:
            ca.sin(Number())
        except Exception as error:  # whatever CasADi makes of it
            seen.append(error)
        assert not any(isinstance(error, KeyboardInterrupt) for error in seen)
        with pytest.raises(KeyboardInterrupt):
            check()
        with pytest.raises(KeyboardInterrupt):  # until somebody has done what was asked for
            check()
        assert clear_signal() == signal.SIGTERM
        check()


def test_a_signal_in_a_destructor_is_raised_again_without_a_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    """Python drops an exception there and prints it; `check` raises it again, so that the print would be wrong."""
    class Dropped:
        def __del__(self) -> None:
            terminate()

    class Broken:
        def __del__(self) -> None:
            raise ValueError("a fault")

    before = sys.unraisablehook
    sys.unraisablehook = sys.__unraisablehook__  # pytest has its own
    try:
        with listening():
            Dropped()
            Broken()
            with pytest.raises(KeyboardInterrupt):
                check()
    finally:
        sys.unraisablehook = before
    said = capfd.readouterr().err
    assert "Interrupted" not in said and "a fault" in said


def test_no_signal_is_lost_in_formulas_and_runs() -> None:
    """Alarms at many moments of assembling and integrating, each heard as a signal to end: none is without effect."""
    model = hb.loads(MODEL)
    assembly = hb.assemble(model)
    simulator = hb.Simulator(assembly, "1 s")
    simulator.run()
    heard = ended = 0
    with listening():
        handler = signal.getsignal(signal.SIGTERM)
        assert callable(handler)
        before = signal.signal(signal.SIGALRM, handler)
        try:
            for k in range(160):
                try:
                    signal.setitimer(signal.ITIMER_REAL, 2e-4 * (1 + k // 2))
                    (lambda: hb.assemble(model) if k % 2 else simulator.run())()
                    signal.setitimer(signal.ITIMER_REAL, 0)
                except KeyboardInterrupt:
                    ended += 1
                except Exception as error:
                    ended += is_interrupt(error)
                signal.setitimer(signal.ITIMER_REAL, 0)
                heard += clear_signal() is not None
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)
    assert heard == ended > 20


RUNNER = """
import os, signal, sys, time
from heavebond.core.parallel import Processes, as_done
def work(number):
    os.write(1, b"%d\\n" % os.getpid())
    time.sleep(1000 if number else 2)
    return number
if __name__ == "__main__":
    with Processes(2) as workers:
        for _ in as_done(workers, work, [(k, (k,)) for k in range(3)], 3):
            {end}
"""


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are listed by POSIX means")
@pytest.mark.parametrize("end", [
    "os.kill(os.getpid(), signal.SIGKILL)", "os.kill(os.getpid(), signal.SIGTERM)", "os._exit(3)", "sys.exit(3)"])
def test_workers_end_with_the_process_that_made_them(end: str) -> None:
    begun = subprocess.Popen([sys.executable, "-c", RUNNER.format(end=end)], stdout=subprocess.PIPE, text=True)
    said, _ = begun.communicate(timeout=120)  # the end of the output: no process is left that holds it
    pids = [int(word) for word in said.split()]
    assert len(set(pids)) == 2 and begun.returncode != 0


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals are sent by POSIX means")
def test_a_study_that_is_terminated_writes_what_was_done(tmp_path: Path) -> None:
    """As with Ctrl-C: the table of the cases that were done, the JSON file, the exit code, and no process left."""
    (tmp_path / "m.yaml").write_text(MODEL)
    begun = subprocess.Popen(
        [sys.executable, "-c", "from heavebond.cli import main; main()", "sweep", "m.yaml",
         "--over", "spring.c=1 .. 3 kN/m; 3000", "--measure", "peak(cart.x) in mm", "--processes", "2", "--output", "out",
         "--json", "told.json"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    done = tmp_path / "out" / "done"
    for _ in range(1200):
        if begun.poll() is not None or (done.is_dir() and len(list(done.glob("*.json"))) > 3):
            break
        clock.sleep(0.1)
    begun.send_signal(signal.SIGTERM)
    said, _ = begun.communicate(timeout=120)
    assert begun.returncode == 128 + signal.SIGTERM, said
    rows = (tmp_path / "out" / "table.csv").read_text().splitlines()
    assert 3 < len(rows) < 3000 and "terminated" in said
    told = json.loads((tmp_path / "told.json").read_text())
    assert not told["ok"] and told["problems"][0]["message"] == "terminated"


def _slow(number: int) -> int:
    clock.sleep(0.5 if number else 30)
    return number


@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals are sent by POSIX means")
def test_a_worker_ends_later_than_the_process_that_collects() -> None:
    """Where all processes of a job receive SIGTERM, workers perhaps first, none of them counts as lost."""
    with Processes(1) as workers:
        begun = workers.submit(_slow, 0)
        while not begun.running():
            clock.sleep(0.01)
        clock.sleep(0.2)
        for pid in list(workers.pool._processes or {}):
            os.kill(pid, signal.SIGTERM)
        clock.sleep(0.3)
        assert not begun.done()
        assert isinstance(begun.exception(timeout=20), BrokenExecutor)  # and it ends all the same


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals are sent by POSIX means")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_diagnosis_that_is_ended_shows_and_writes_its_answer(tmp_path: Path, number: signal.Signals) -> None:
    """All its processes receive the signal, workers too, as from a batch system that ends a job."""
    begun = subprocess.Popen(
        [sys.executable, "-c", "from heavebond.cli import main; main()", "diagnose", "receiver_rig/choked", "--only",
         "choked flow", "--only", "lag", "--only", "delay", "--processes", "2", "--json", "told.json"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "HEAVEBOND_PROGRESS": "0.1"})
    assert begun.stderr is not None
    for line in begun.stderr:
        if "refitting" in line:
            os.killpg(begun.pid, number)
            break
    said, errors = begun.communicate(timeout=300)
    assert begun.returncode == (0 if number == signal.SIGINT else 128 + number), errors
    at = errors.find("Traceback")
    assert at < 0, errors[max(0, at - 300):at + 3000]
    assert "Not tried to the end" not in said
    assert "the search was ended early" in said and "choked flow" in said
    assert "; heavebond diagnose" not in said  # two ways to go on: the same command is the likelier
    told = json.loads((tmp_path / "told.json").read_text())
    assert told["partial"] and not told["lost"] and told["ladder"]
    assert (tmp_path / "choked_report.html").stat().st_size > 10_000


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals are sent by POSIX means")
def test_a_signal_while_a_diagnosis_writes_loses_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = files.write_findings

    def interrupted(*args: Any) -> list[Path]:
        terminate()
        return written(*args)

    monkeypatch.setattr(files, "write_findings", interrupted)
    Path("damped.yaml").write_text(CHIRP.replace("chirp\n", "damped\n").replace("spring.d: 5 .. 80 N*s/m", ""))
    answer = CliRunner().invoke(main, ["diagnose", "damped.yaml", "--only", "value of a parameter", "--processes", "1"])
    assert answer.exit_code == 0, answer.output
    assert Path("damped_report.html").exists() and "second Ctrl-C" in answer.stderr


def test_a_diagnosis_that_is_terminated_early_does_not_end_as_a_complete_one(
        folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("damped.yaml").write_text(CHIRP.replace("chirp\n", "damped\n"))
    ended_after(4, Residuals, "evaluate", monkeypatch)
    code, told = called("diagnose", "damped.yaml", "--only", "value of a parameter", "--processes", "1")
    assert code == 128 + signal.SIGTERM and told["partial"] and not told["ok"]
    assert told["message"] == "interrupted" if "message" in told else told["problems"]
    assert Path("damped_report.html").exists()


CHIRP = """
experiment: chirp
model: pair.yaml
records: {one: {file: one.csv, use: fit}}
time: {column: t, unit: s}
outputs: {cart.x: {column: x, unit: mm, noise: 0.01 mm}}
free: {spring.c: 1.5 .. 4 kN/m, spring.d: 5 .. 80 N*s/m}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("pair.yaml").write_text(MODEL)
    Path("chirp.yaml").write_text(CHIRP)
    run = hb.simulate(hb.loads(MODEL.replace("2 kN/m", "3 kN/m").replace("20 N", "40 N")))
    Path("one.csv").write_text("t,x\n" + "".join(f"{t:.3f},{1e3 * x:.6f}\n" for t, x in zip(run.time, run["cart.x"],
                                                                                           strict=True)))
    return tmp_path


def ended_after(calls: int, kind: type, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """SIGTERM comes in the call of so many."""
    made, plain = [], getattr(kind, name)

    def counted(*args: object) -> object:
        made.append(None)
        if len(made) == calls:
            os.kill(os.getpid(), signal.SIGTERM)
        return plain(*args)

    monkeypatch.setattr(kind, name, counted)


def called(*words: str) -> tuple[int, dict[str, object]]:
    code = CliRunner().invoke(main, [*words, "--json", "told.json"]).exit_code
    return code, json.loads(Path("told.json").read_text())


def test_a_fit_that_is_terminated_gives_its_best_so_far(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended_after(4, Residuals, "evaluate", monkeypatch)
    code, told = called("fit", "chirp.yaml", "--write", "fitted.yaml")
    assert code == 128 + signal.SIGTERM and told["message"] == "interrupted" and not told["ok"]
    assert told["problems"][0]["code"] == "interrupted"
    history = told["history"]
    assert len(history) == 3 and history[-1] < history[0]
    best = {name: figures["value"] for name, figures in told["parameters"].items()}
    assert hb.load("fitted.yaml").body.instances or hb.load("fitted.yaml").settings
    assert abs(best["spring.c"] - 3000) < 1000 and best["spring.c"] != 2000


def test_a_fit_that_ends_before_its_first_run_has_nothing_to_give(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended_after(1, Residuals, "evaluate", monkeypatch)
    code, told = called("fit", "chirp.yaml")
    assert code == 128 + signal.SIGTERM and "parameters" not in told


def test_a_tuning_that_is_terminated_gives_its_best_so_far(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended_after(3, Objective, "evaluate", monkeypatch)
    code, told = called("tune", "pair.yaml", "--free", "spring.d=5 .. 200 N*s/m", "--cost", "mean(cart.x**2)/(1 mm**2)",
                        "--write", "tuned.yaml")
    assert code == 128 + signal.SIGTERM and told["message"] == "interrupted"
    assert told["cost"] < told["before"] and told["robustness"] is None
    assert Path("tuned.yaml").exists()


def test_in_python_an_interrupt_stays_one_unless_a_part_is_asked_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended_after(4, Residuals, "evaluate", monkeypatch)
    with listening(), pytest.raises(KeyboardInterrupt):
        hb.fit("chirp.yaml")
    ended_after(4, Residuals, "evaluate", monkeypatch)
    with listening():
        assert hb.fit("chirp.yaml", partial=True).message == "interrupted"


def test_a_signal_in_the_conversion_of_a_matrix_is_an_interrupt_and_no_system_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy calls `DM.__array__` from C; an exception in it was a SystemError, which ended a search without its answer."""
    elements = ca.DM.elements

    def late(matrix: ca.DM) -> object:
        signal.raise_signal(signal.SIGALRM)
        return elements(matrix)

    monkeypatch.setattr(ca.DM, "elements", late)
    with time_limit(1000.0):
        assert np.array(ca.DM([1.0, 2.0])).ravel().tolist() == [1.0, 2.0]  # the conversion is completed
        with pytest.raises(KeyboardInterrupt):
            check()
