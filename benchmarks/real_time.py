"""Real-time programs: the time of their steps over a million steps, and their difference from runs with error control.

`python -m benchmarks.real_time` prints the table and writes it into docs/real_time.md. It needs a C compiler.
"""

from __future__ import annotations

import ctypes
import re
import socket
import struct
import subprocess
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import heavebond as hb
from benchmarks.measuring import Figure, write_page
from heavebond.exchange.fmu_export import find_compiler
from heavebond.exchange.real_time import export_real_time

PAGE = Path(__file__).parents[1] / "docs" / "real_time.md"
STEPS = 1_000_000
FLAGS = ("-std=c99", "-O2")
TIMES = re.compile(r"median ([\d.e+]+) us, 99.9 % below ([\d.e+]+) us, maximum ([\d.e+]+) us")
OVERRUNS = re.compile(r"overruns\s+(\d+)")


@dataclass(frozen=True)
class Case:
    """A bundled diagram, the method and the step (s) of its program, the time between compared points (s), and the largest
    difference that is accepted, as a share of the range of an output."""

    name: str
    solver: str
    step: float
    every: float
    largest: float


CASES = (Case("cmc_ahc", "rosenbrock", 2e-3, 0.02, 1e-6), Case("cmc_ahc", "rosenbrock", 1e-3, 0.02, 1e-6),
         Case("cmc_ahc", "rk4", 5e-4, 0.02, 1e-6), Case("cmc_ahc", "backward-euler", 1e-3, 0.02, 0.05),
         Case("quarter_car", "rk4", 1e-3, 2e-3, 1e-6), Case("quarter_car", "rosenbrock", 1e-3, 2e-3, 1e-6),
         Case("servo_drive", "rosenbrock", 125e-6, 5e-4, 1e-5),
         Case("circuits/tank_level", "rosenbrock", 50e-3, 0.5, 1e-6),
         Case("examples/transmission_line", "rosenbrock", 5e-4, 2e-3, 1e-2))


def difference(case: Case, folder: Path) -> float:
    """The largest difference of an output of the program from the run, as a share of the range of the output."""
    model = hb.load(case.name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hb.RunWarning)
        run = hb.simulate(model, every=case.every, rtol=1e-9)
    subprocess.run([find_compiler(), *FLAGS, "-shared", "-fPIC", "m.c", "-o", "m.so", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "m.so"))
    library.m_size.restype, library.m_get_output.restype = ctypes.c_size_t, ctypes.c_double
    memory = ctypes.create_string_buffer(library.m_size())
    assert library.m_init(memory, None) == 0
    rows, names = [], list(model.show)
    for k in range(len(run.time)):
        for _ in range(round(case.every / case.step) if k else 0):
            assert library.m_step(memory) == 0
        rows.append([library.m_get_output(memory, j) for j in range(len(names))])
    found = np.array(rows)
    return max(float(np.abs(found[:, j] - run.display[name]).max() / max(np.ptp(run.display[name]), 1e-9))
               for j, name in enumerate(names))


def spoken(text: str) -> str:
    """A time in microseconds as `2.9 µs` or `44.1 ms`."""
    time = float(text)
    return f"{time:.3g} µs" if time < 1000 else f"{time / 1000:.3g} ms"


def measured(case: Case) -> Figure:
    """The figures of one program."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        export_real_time(hb.load(case.name), folder / "m.c", (), case.solver, case.step)
        subprocess.run([find_compiler(), *FLAGS, "m.c", "m_runner.c", "-o", "m", "-lm"], cwd=folder, check=True)
        times = [TIMES.search(subprocess.run([folder / "m", "--no-wait", "--until", repr(STEPS * case.step), *more],
                                             capture_output=True, text=True, check=True).stdout)
                 for more in ((), ("--processor-time",))]
        apart = difference(case, folder)
    wall, processor = ([spoken(text) for text in found.groups()] if found else ["", "", ""] for found in times)
    return Figure(f"{case.name}, {case.solver}, {1e3 * case.step:g} ms",
                  f"median {wall[0]}, 99.9 % below {wall[1]}, maximum {wall[2]} ({processor[2]} of processor "
                  f"time); difference {apart:.1e}", f"difference ≤ {case.largest:g}", apart <= case.largest)


def in_real_time() -> Figure:
    """A million steps of the compensator in real time, by the real-time scheduler if the system permits it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        export_real_time(hb.load("cmc_ahc"), folder / "m.c", (), None, "0.1 ms")
        subprocess.run([find_compiler(), *FLAGS, "m.c", "m_runner.c", "-o", "m", "-lm"], cwd=folder, check=True)
        report = subprocess.run([folder / "m", "--until", repr(STEPS * 1e-4), "--priority", "50"], capture_output=True,
                                text=True, check=True)
    times, late = TIMES.search(report.stdout), OVERRUNS.search(report.stdout)
    assert times and late
    scheduler = "usual scheduler" if "--priority" in report.stderr else "`--priority 50`"
    return Figure(f"cmc_ahc, rosenbrock, 0.1 ms, in real time, {scheduler}",
                  f"median {spoken(times[1])}, 99.9 % below {spoken(times[2])}, maximum {spoken(times[3])}; {late[1]} steps "
                  "ended after their period")


PLANT = """
model: plant
extends: bundled:cmc_ahc/cmc_ahc
components:
  bus: {is: %s, u: =controller.u}
nodes:
  command: [-controller.u, +bus.y]
show:
  command: {is: bus.y, unit: "1"}
  z: {is: encoder.y, unit: m}
  v: {is: mru.v, unit: m/s}
simulate: {until: 48 s, every: 10 ms}
"""


def in_the_loop(lock_step: bool, largest: float) -> Figure:
    """The compensator with its controller in this process: the difference of the weight on bit from a run with a sampled
    controller."""
    run = hb.simulate(hb.loads(PLANT % "SampleHold, T_s: 10 ms"), rtol=1e-9)
    with tempfile.TemporaryDirectory() as name, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        folder = Path(name)
        export_real_time(hb.loads(PLANT % "Gain, k: 1"), folder / "plant.c", ["bus.u"], None, "1 ms")
        subprocess.run([find_compiler(), *FLAGS, "plant.c", "plant_runner.c", "-o", "plant", "-lm"], cwd=folder, check=True)
        udp.bind(("127.0.0.1", 0))
        udp.settimeout(10)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        words = [str(folder / "plant"), "--port", str(port), "--to", str(udp.getsockname()[1]), "--outputs", "z,v,WOB",
                 "--every", "10", "--until", "48", *(["--lock-step"] if lock_step else ["--priority", "50"])]
        rows, time = [], -1.0
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as plant:
            while time < 48 - 0.005:
                time, z, v, force = struct.unpack("<4d", udp.recv(100))
                udp.sendto(struct.pack("<2d", time, min(max(-3.02 * z - 0.55 * v, -1), 1)), ("127.0.0.1", port))
                rows.append((time, force))
            assert plant.stdout is not None
            found, report = np.array(rows), plant.stdout.read()
    exact = run.display["WOB"]
    apart = float(np.abs(found[:, 1] - np.interp(found[:, 0], run.time, exact)).max() / np.ptp(exact))
    late = OVERRUNS.search(report)
    overruns = f", {late[1]} of 48000 steps ended after their period" if late else ""
    return Figure(f"cmc_ahc with its controller in a second process, {'lock step' if lock_step else 'real time'}",
                  f"difference {apart:.1e}{overruns}", f"difference ≤ {largest:g}", apart <= largest)


if __name__ == "__main__":
    write_page([*(measured(case) for case in CASES), in_real_time(), in_the_loop(True, 1e-5), in_the_loop(False, 0.05)],
               PAGE)
