"""Throughput, false alarms and delay of `heavebond monitor` on a local cluster: `python -m benchmarks.monitoring`.

The records are of the cylinder rig: white noise as the experiment states it, 24 motions of the valve, each record with its
own noise. In a few records a leak past the piston begins at a random time, with a random conductance.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import heavebond as hb
from heavebond.core.cluster import Cluster

Array = NDArray[np.float64]
STEP, MOTIONS, RATE = 0.02, 24, 0.05
RISE = 0.05 * np.arctanh(0.8)  # s, half of the time from 10 to 90 % of a leak
LEAKS = (1e-11, 1e-10)  # m^3/(s Pa): range of the conductance
EXPERIMENT = "experiment: service\nextends: cylinder_rig/leakage.yaml\nrecords:\n  {name}: {{file: {file}, use: test}}\n"


@dataclass(frozen=True)
class Rig:
    """The cylinder rig with a leak whose conductance changes from 0 at a time, and the noise of its channels."""

    folder: Path
    duration: float

    def run(self, command: Array, begin: float, conductance: float) -> Array:
        """The time, command, position and pressures (N, 5) of a motion, without noise."""
        times = np.arange(0, self.duration + STEP / 2, STEP)
        file = self.folder / "command.csv"
        np.savetxt(file, np.column_stack([times, command]), delimiter=",", header="time,u", comments="")
        rig = hb.Diagram.read("cylinder_rig")
        rig.add("LaminarLeakage", "leak", C=f"{conductance!r} m**3/(s*Pa)")
        rig.connect("leak.a", node="chamber_a")
        rig.connect("leak.b", node="chamber_b")
        rig.update(vary={"leak.C": f"=(1 + tanh((time - {begin!r} s)/(0.05 s)))/2"},
                   set={"valve.u": {"file": str(file), "column": "u", "unit": "1", "interpolation": "spline"}})
        result = hb.simulate(rig, self.duration, every=STEP)
        return np.column_stack([times, command, *(result.si[n] for n in ("load.x", "chamber_a.p", "chamber_b.p"))])


def command(seed: int, duration: float) -> Array:
    """A motion of the valve: six sines of random frequency and phase, between -0.15 and 0.15 or so."""
    random, times = np.random.default_rng([seed, 1]), np.arange(0, duration + STEP / 2, STEP)
    frequencies, phases = random.uniform(0.05, 0.6, 6), random.uniform(0, 2 * np.pi, 6)
    return np.asarray(0.06 * np.sin(2 * np.pi * np.outer(times, frequencies) + phases).sum(axis=1))


def write_record(path: Path, motion: Array, seed: int) -> None:
    """A motion with the noise of the sensors, 0.3 mm and 0.6 bar, as CSV."""
    noise = np.random.default_rng([seed, 2]).standard_normal((len(motion), 3)) * [3e-4, 6e4, 6e4]
    table = motion.copy()
    table[:, 2:] += noise
    np.savetxt(path, table, fmt="%.8g", delimiter=",", header="time_s,command,position_m,pA_Pa,pB_Pa", comments="")


def write_fleet(folder: Path, records: int, leaking: int, duration: float) -> dict[str, float]:
    """Records in a folder, the last ones with a leak; the times at which their leaks begin, by name."""
    folder.mkdir(parents=True, exist_ok=True)
    rig, begins = Rig(folder.parent, duration), {}
    sound = [rig.run(command(k, duration), 10 * duration, 0.0) for k in range(min(MOTIONS, records - leaking))]
    for k in range(records - leaking):
        write_record(folder / f"r{k:04}.csv", sound[k % MOTIONS], k)
    random = np.random.default_rng(3)
    for k in range(records - leaking, records):
        begins[f"r{k:04}"] = begin = float(random.uniform(0.3, 0.7) * duration)
        conductance = float(np.exp(random.uniform(*np.log(LEAKS))))
        write_record(folder / f"r{k:04}.csv", rig.run(command(k % MOTIONS, duration), begin, conductance), k)
    return begins


def main() -> None:
    """Write the records, monitor them on a local cluster, and print the figures."""
    import distributed

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=1000)
    parser.add_argument("--leaking", type=int, default=50)
    parser.add_argument("--duration", type=float, default=20.0, help="s of each record")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "records"
        begins = write_fleet(folder, given.records, given.leaking, given.duration)
        experiment = Path(name) / "service.yaml"
        experiment.write_text(EXPERIMENT.format(name="reference", file=folder / "r0000.csv"), encoding="utf-8")
        make: Any = distributed.LocalCluster
        with make(n_workers=given.workers, threads_per_worker=1, dashboard_address=None) as local, \
                Cluster(local.scheduler_address) as cluster:
            began, before = time.perf_counter(), cpu(local)
            found = hb.monitor(experiment, folder, record="reference", rate=RATE, executor=cluster)
            wall, used = time.perf_counter() - began, cpu(local) - before
    alarmed = {r.name: r for r in found.changed}
    false = [n for n in alarmed if n not in begins or alarmed[n].alarm < begins[n]]
    errors = np.array([abs(alarmed[n].change - begin) / given.duration for n, begin in begins.items()
                       if n in alarmed and n not in false])
    sound = given.records - given.leaking
    samples = round(given.duration / STEP) + 1
    print(f"{len(found.records)} records of {samples} samples of 3 channels, {given.workers} workers, "
          f"load {os.getloadavg()[0]:.1f}")
    print(f"wall clock {wall:.0f} s: {given.records / wall:.1f} records/s; processor time of the workers {used:.0f} s: "
          f"{given.records / used:.1f} records per processor second")
    of_sound = len([n for n in false if n not in begins])
    print(f"false alarms: {of_sound} of {sound} sound records ({100 * of_sound / sound:.2f} %), stated at most "
          f"{100 * RATE:.0f} %")
    print(f"leaks found: {len(errors)} of {given.leaking}; error of the time: median {100 * np.median(errors):.2f} %, "
          f"95 % below {100 * np.quantile(errors, 0.95):.2f} %, largest {100 * errors.max():.2f} % of the record")
    # from 10 to 90 % of the rise of the leak
    inside = sum(alarmed[n].earliest <= begin + RISE and begin - RISE <= alarmed[n].latest for n, begin in begins.items()
                 if n in alarmed and n not in false)
    print(f"errors below 2 % of the record: {(errors < 0.02).sum()} of {len(errors)}; intervals that contain a part of the "
          f"rise: {inside}")


def cpu(local: Any) -> float:
    """Processor time in s of the workers of a local cluster."""
    import psutil

    total = 0.0
    for worker in local.workers.values():
        times = psutil.Process(worker.pid).cpu_times()
        total += times.user + times.system
    return total


if __name__ == "__main__":
    main()
