"""Real-time programs in C: their difference from `simulate`, their bounds, and their runner on the loopback interface."""

from __future__ import annotations

import ctypes
import shutil
import socket
import struct
import subprocess
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from test_export import COMPILER, compiled
from test_fmu_events import BALL, SWITCHED

import heavebond as hb
from heavebond.cli import main
from heavebond.exchange.c_code import METHODS, c_name
from heavebond.exchange.portable import Portable
from heavebond.language.library import bundled

pytestmark = compiled
FLAGS = ("-O0", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
LAG = """
model: lag
components:
  push: {is: Constant, k: 0}
  lag:  {is: FirstOrderLag, T_1: 0.2 s, u: =push.y}
  read: {is: SampleHold, T_s: 20 ms, u: =lag.y}
initial: {lag.y: 0}
show: {lag: {is: lag.y, unit: "1"}, read: {is: read.y, unit: "1"}}
simulate: {until: 1 s, every: 10 ms}
"""
DELAYED = """
model: delayed
components:
  x: {is: Integrator, k: -1 1/s, u: =d.y}
  d: {is: Delay, T: 0.3 s, u: =x.y}
  e: {is: Delay, T: 0.0502 s, u: =s.y}
  s: {is: SampleHold, T_s: 0.1 s, u: =time/(1 s)}
  w: {is: Integrator, k: 1 1/s, u: =e.y}
initial: {x.y: 1, d.y: 1, w.y: 0}
show: {x: {is: x.y, unit: "1"}, e: {is: e.y, unit: "1"}, w: {is: w.y, unit: "1"}}
simulate: {until: 1.2 s, every: 10 ms}
"""


class Program:
    """A run of a real-time program, called through ctypes."""

    def __init__(self, model: hb.Model, folder: Path, solver: str | None = None, step: str = "1 ms",
                 inputs: tuple[str, ...] = ()):
        path = folder / f"{model.name}.c"
        made = hb.export(model, path, inputs=inputs, solver=solver, step=step)
        assert isinstance(made, Portable) and COMPILER
        library = path.with_suffix(".so")
        subprocess.run([COMPILER, *FLAGS, "-shared", "-fPIC", str(path), "-o", str(library), "-lm"], check=True)
        self.outputs, self.parameters, self._prefix = made.outputs, made.parameters, c_name(path.stem)
        self._library = ctypes.CDLL(str(library))
        self.run = ctypes.create_string_buffer(self.function("size", ctypes.c_size_t)())
        self.begin()

    def function(self, name: str, result: Any = ctypes.c_int) -> Callable[..., Any]:
        """A function of the program."""
        function: Any = getattr(self._library, f"{self._prefix}_{name}")
        function.restype = result
        return function  # type: ignore[no-any-return]

    def begin(self, **changed: float) -> None:
        p = np.array([changed.get(q.name.replace(".", "_"), q.start) for q in self.parameters])
        assert self.function("init")(self.run, ctypes.c_void_p(p.ctypes.data)) == 0, self.message

    @property
    def message(self) -> str:
        return str(self.function("message", ctypes.c_char_p)(self.run).decode())

    def read(self) -> np.ndarray:
        get = self.function("get_output", ctypes.c_double)
        return np.array([get(self.run, k) for k in range(len(self.outputs))])

    def steps(self, number: int) -> np.ndarray:
        """The outputs after so many steps."""
        step = self.function("step")
        for _ in range(number):
            assert step(self.run) == 0, self.message
        return self.read()

    def differences(self, run: hb.Result, steps: int) -> dict[str, float]:
        """The largest difference of each output from a run, as a share of its range; so many steps in an output interval.
        The last point counts only if its interval is as long as the others."""
        number = len(run.time) - (not np.isclose(run.time[-1] - run.time[-2], run.time[1] - run.time[0]))
        found = np.array([self.read(), *(self.steps(steps) for _ in range(number - 1))])
        return {q.name: float(np.abs(found[:, k] - run.display[q.name][:number]).max() / max(
            np.ptp(run.display[q.name]), 1e-12)) for k, q in enumerate(self.outputs)}


def test_a_program_repeats_a_run_with_the_same_fixed_step(tmp_path: Path) -> None:
    """Runge-Kutta and Euler: the same operations, to rounding."""
    warnings.simplefilter("ignore", hb.RunWarning)  # of a run without error control
    model = hb.load("quarter_car")
    for method in ("rk4", "euler"):
        (tmp_path / method).mkdir()
        run = hb.simulate(model, solver=method, step="1 ms")
        assert max(Program(model, tmp_path / method, method).differences(run, 2).values()) < 1e-11, method


@pytest.mark.parametrize(("solver", "step", "largest"), [("rosenbrock", 1, 1e-7), ("backward-euler", 1, 0.02)])
def test_implicit_methods_agree_with_a_run(solver: str, step: int, largest: float, tmp_path: Path) -> None:
    model = hb.load("quarter_car")
    run = hb.simulate(model, rtol=1e-9)
    differences = Program(model, tmp_path, solver, f"{step} ms").differences(run, 2 // step)
    assert max(differences.values()) < largest, differences


def test_the_compensator_agrees_with_a_run(tmp_path: Path) -> None:
    """Steps of 2 ms against a run at 1e-9, over one wave."""
    model = hb.load("cmc_ahc")
    program, run = Program(model, tmp_path, step="2 ms"), hb.simulate(model, "12 s", rtol=1e-9, every="0.1 s")
    assert max(program.differences(run, 50).values()) < 1e-6


def test_relays_comparators_and_samples_agree_with_a_run(tmp_path: Path) -> None:
    """The relay and the comparator switch within steps of 2.5 ms."""
    model = hb.loads(SWITCHED.replace("u: 0}", "u: =4*sin(5 rad/s*time)}"))
    run, program = hb.simulate(model, rtol=1e-10), Program(model, tmp_path, "rk4", "2.5 ms")
    assert max(program.differences(run, 4).values()) < 1e-7
    assert program.function("late", ctypes.c_longlong)(program.run) == 0


@pytest.mark.slow
def test_every_example_with_events_or_delays_agrees_with_a_run(tmp_path: Path) -> None:
    """Four steps in each output interval, by the default method. The check valve of one example closes within 1 ms, a kink
    in its law that no fixed step meets."""
    kinked = {"unloading_valve": (40, 0.1)}
    names = []
    for path in sorted((bundled("models") / "examples").glob("*.yaml")):
        flat = hb.assemble(model := hb.load(path)).flat
        if not flat.inputs and (flat.events or flat.delays):
            names.append(path.stem)
            (tmp_path / path.stem).mkdir()
            run = hb.simulate(model, rtol=1e-9)
            steps, largest = kinked.get(path.stem, (4, 2e-5))
            program = Program(model, tmp_path / path.stem, step=f"{float(run.time[1] - run.time[0]) / steps!r} s")
            differences = program.differences(run, steps)
            assert max(differences.values()) < largest, (path.stem, differences)
    assert len(names) > 50


def test_impacts_are_located_within_steps(tmp_path: Path) -> None:
    """A ball that falls 0.8 m at 10 m/s2 and rebounds with half of its speed; at last it rests near the floor."""
    program = Program(hb.loads(BALL), tmp_path, step="3 ms")
    speeds = {0.399: -3.99, 0.402: 2 - 0.02, 0.804: 1 - 0.04, 1.002: 0.5 - 0.02}
    for time, speed in speeds.items():
        steps = round((time - program.function("time", ctypes.c_double)(program.run)) / 0.003)
        assert program.steps(steps)[1] == pytest.approx(speed, abs=2e-6)
    height, speed, rest = program.steps(200)
    assert abs(height) < 1e-3 and abs(speed) < 1e-9 and rest == 1


def test_delays_are_exact_across_jumps(tmp_path: Path) -> None:
    """x' = -x(t - T): a polynomial in each interval T. A delayed sample jumps at instants within the steps."""
    program = Program(hb.loads(DELAYED), tmp_path, "rk4", "1 ms")
    x, e, w = program.steps(1200)
    T, t, exact, factor = 0.3, 1.2, 1.0, 1.0
    for n in range(1, 5):
        factor *= -1 / n
        exact += factor * (t - (n - 1) * T) ** n
    assert x == pytest.approx(exact, abs=1e-10)
    assert e == pytest.approx(1.1)
    assert w == pytest.approx(0.1 * sum(0.1 * k for k in range(11)) + 1.1 * (1.2 - 1.1502), abs=1e-10)
    with pytest.raises(AssertionError, match="a delay is shorter than the step"):
        program.begin(e_T=0.0001)


def test_inputs_snapshots_and_wrong_values(tmp_path: Path) -> None:
    program = Program(hb.loads(LAG), tmp_path, "rk4", "5 ms", ("lag.u",))
    header = (tmp_path / "lag.h").read_text()
    assert "lag_par_lag_T_1 = " in header and "/* lag.u [1], 0 */" in header and "initial" not in header.split("extern")[1]
    assert program.function("parameter_index")(b"initial.lag.y") == program.function("parameter_index")(b"") == -1
    index, set_input = program.function("input_index"), program.function("set_input")
    assert index(b"lag.u") == 0 and index(b"lag") == -1 and program.function("output_index")(b"read") == 1
    assert set_input(program.run, 0, ctypes.c_double(2.0)) == 0
    assert program.steps(30) == pytest.approx([2 * (1 - np.exp(-0.15 / 0.2)), 2 * (1 - np.exp(-0.14 / 0.2))], abs=1e-7)
    snapshot = program.run.raw
    first = program.steps(20)
    program.run.raw = snapshot
    assert np.array_equal(program.steps(20), first)
    set_input(program.run, 0, ctypes.c_double(0.0))
    assert program.steps(14000)[0] == 0  # exp(-350): a motion that has ended makes no step slower
    for k, value in ((0, np.nan), (0, np.inf), (1, 0.0), (-1, 0.0)):
        assert set_input(program.run, k, ctypes.c_double(value)) == 1
    assert np.isnan(program.function("get_output", ctypes.c_double)(program.run, 2))
    program.begin(lag_T_1=0.1)
    set_input(program.run, 0, ctypes.c_double(1.0))
    assert program.steps(20)[0] == pytest.approx(1 - np.exp(-1), abs=1e-6)


def test_a_step_calls_nothing_that_allocates(tmp_path: Path) -> None:
    """Only the start, which `init` calls, allocates memory."""
    hb.export(hb.loads(DELAYED), tmp_path / "m.c", step="1 ms")
    text = (tmp_path / "m.c").read_text()
    start, end = text.index("static const char *solve_start"), text.index("/* Rates, outputs and algebraic unknowns of")
    assert "alloc(" in text[start:end] and "alloc(" not in text[:start] + text[end:]
    assert "if (!now->starting || now->own) return NULL;" in text[start:end] and "end_start" in text[end:]


@pytest.mark.parametrize(("words", "expected"), [
    (("--solver", "rk5"), "not a method with a fixed step"),
    (("--solver", "rk4"), "needs a step above 0 s"),
    (("--step", "30 ms"), "the period of read.sample, 0.02 s, is shorter than the step of 0.03 s"),
    (("--step", "3 ms"), "read.sample: the period is not a multiple of the step; its instants divide steps"),
    (("--step", "10 ms", "--solver", "rk4", "--set", "lag.T_1=2 ms"), "unstable with this step at the start of the run; its "
     "longest stable step is 0.0056 s")])
def test_the_command_says_what_to_type(words: tuple[str, ...], expected: str, tmp_path: Path) -> None:
    (tmp_path / "lag.yaml").write_text(LAG)
    found = CliRunner().invoke(main, ["export", str(tmp_path / "lag.yaml"), "-o", str(tmp_path / "l.c"), *words])
    assert expected in " ".join(found.output.split()), found.output
    assert (found.exit_code == 0) == (words[-1] in ("3 ms", "lag.T_1=2 ms")) == (tmp_path / "l_runner.c").exists()


def test_unsuitable_diagrams_are_refused_with_what_to_type(tmp_path: Path) -> None:
    for text, options, expected in (
            (BALL, {"solver": "rk4"}, "rk4 cannot solve for the algebraic unknowns stop.b.f without iteration"),
            (DELAYED, {"step": "0.06 s"}, "the delay of e.d, 0.0502 s, is shorter than the step"),
            (LAG.replace("every: 10 ms", "every: 10 ms, largest_step: 0.5 ms"), {}, "longer than `largest_step`")):
        with pytest.raises(hb.UsageError, match="Type `--s") as caught:
            hb.export(hb.loads(text), tmp_path / "m.c", **{"step": "1 ms", **options})  # type: ignore[arg-type]
        assert expected in str(caught.value)
    with pytest.raises(hb.UsageError, match=r"Write m\.c"):
        hb.export(hb.loads(LAG), tmp_path / "m.mo", step="1 ms")
    for unused in ({"fmi": 2}, {"cross": True}, {"locals": ["lag.y"]}):
        with pytest.raises(hb.UsageError, match="is for FMUs"):
            hb.export(hb.loads(LAG), tmp_path / "m.mo", **unused)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
    assert set(METHODS) == {"euler", "rk4", "backward-euler", "rosenbrock"}


def test_other_files_of_the_same_name_are_kept(tmp_path: Path) -> None:
    model = hb.loads(LAG)
    for _ in range(2):  # its own files are written anew
        hb.export(model, tmp_path / "lag.c", step="1 ms")
    (tmp_path / "lag.h").write_text("/* mine */")
    with pytest.raises(hb.UsageError, match="was not written by heavebond"):
        hb.export(model, tmp_path / "lag.c", step="1 ms")
    assert (tmp_path / "lag.h").read_text() == "/* mine */"


# -- the runner --------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def runner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program of LAG with its runner."""
    folder = tmp_path_factory.mktemp("runner")
    hb.export(hb.loads(LAG), folder / "lag.c", inputs=["lag.u"], solver="rk4", step="5 ms")
    assert COMPILER
    subprocess.run([COMPILER, *FLAGS, "lag.c", "lag_runner.c", "-o", "lag", "-lm"], cwd=folder, check=True)
    return folder / "lag"


def ports() -> tuple[socket.socket, int, int]:
    """A socket on the loopback interface, its port and another free port."""
    udp, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for one in (udp, other):
        one.bind(("127.0.0.1", 0))
        one.settimeout(20)
    port = other.getsockname()[1]
    other.close()
    return udp, udp.getsockname()[1], port


def test_the_runner_measures_its_steps(runner: Path) -> None:
    found = subprocess.run([runner, "--no-wait", "--until", "100", "--histogram"], capture_output=True, text=True,
                           check=True).stdout
    assert "steps       20000 of 0.005 s, to 100 s" in found and "99.9 % below" in found
    counts = [int(line.split()[-1]) for line in found.splitlines() if line.startswith(" ")]
    assert sum(counts) == 20000
    timed = subprocess.run([runner, "--until", "0.1"], capture_output=True, text=True, check=True).stdout
    assert "steps       20 of" in timed and 0.09 < float(timed.split(" in ")[1].split()[0]) < 5


@pytest.mark.parametrize(("words", "expected"), [
    (("--port", "0"), "not a number in its range"), (("--lock-step",), "needs --port and --to"),
    (("--set", "lag.T=1"), "no parameter of this name"), (("--outputs", "lag,x"), "'x' is not an output"),
    (("--until", "0"), "not after the start"), (("--wrong",), "there is no option '--wrong'")])
def test_wrong_options_of_the_runner(words: tuple[str, ...], expected: str, runner: Path) -> None:
    found = subprocess.run([runner, *words], capture_output=True, text=True, check=False)
    assert found.returncode == 2 and expected in found.stderr


def test_the_runner_exchanges_datagrams_in_lock_step(runner: Path) -> None:
    """u = 2 - lag in each step, and datagrams that are not valid."""
    udp, to, port = ports()
    with udp, subprocess.Popen([runner, "--port", str(port), "--to", str(to), "--lock-step", "--until", "0.5", "--set",
                                "lag.T_1=0.1", "--outputs", "lag"], stdout=subprocess.PIPE, text=True) as process:
        exact, lag, t = 0.0, 0.0, -1.0
        while t < 0.4975:
            before = t
            t, lag = struct.unpack("<2d", udp.recv(100))
            if t == before:
                continue
            assert lag == pytest.approx(exact, abs=1e-7)
            u = 2 - lag
            exact = u + (exact - u) * np.exp(-0.005 / 0.1)
            for wrong in (b"", struct.pack("<d", t), struct.pack("<2d", t, np.nan), struct.pack("<3d", t, 9, 9)):
                udp.sendto(wrong, ("127.0.0.1", port))
            udp.sendto(struct.pack("<2d", t, u), ("127.0.0.1", port))
        assert process.stdout is not None
        found = process.stdout.read()
    assert process.returncode == 0 and "100 received" in found


def test_the_runner_listens_on_the_loopback_interface_only(runner: Path) -> None:
    if not Path("/proc/net/udp").exists():
        pytest.skip("no /proc/net/udp")
    udp, to, port = ports()
    with udp, subprocess.Popen([runner, "--port", str(port), "--to", str(to), "--until", "30"], stdout=subprocess.DEVNULL
                               ) as process:
        udp.recv(100)  # the runner is ready
        addresses = [line.split()[1] for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
        process.terminate()
    assert f"0100007F:{port:04X}" in addresses and f"00000000:{port:04X}" not in addresses
    assert process.returncode == 0 and shutil.which(str(runner))
