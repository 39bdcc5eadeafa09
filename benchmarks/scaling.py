"""A campaign of sea states on one process, on several, and on a dask cluster whose workers are killed: what a run costs,
what travels with a task, how many tasks a scheduler gives out. `python -m benchmarks.scaling` writes docs/scaling.md."""

from __future__ import annotations

import json
import os
import pickle
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import psutil
from distributed import Client, LocalCluster

import heavebond as hb
from benchmarks.measuring import Figure, cpu, duration, write_page
from heavebond.core.cluster import Cluster
from heavebond.core.parallel import as_done
from heavebond.language.model import find
from heavebond.studies.run_case import assembled, worked
from heavebond.studies.study import PackedCase, Study, load_study

PAGE = Path(__file__).parents[1] / "docs" / "scaling.md"
CASES, WORKERS, PAIRS = 200, 2, 3
SWEPT = 1000  # cases of the sweep that is shared: 200 are done before a second process has compiled its equations
EMPTY_TASKS = 1000
MANY = 64  # tasks at a time where nobody shall wait for another
STUDY = """study: seas
model: {model}
cases:
  seas: {{sample: {{latin_hypercube: {number}, seed: 1}}, over: {{wave.H_s: 0.5 .. 2 m, wave.T_p: 8 .. 14 s}}}}
evaluate: {{from: 6 s, to: {until} s}}
measure:
  rms of WOB: {{is: rms(WOB - 30 kN), unit: kN}}
  stroke: {{is: peak(extension), unit: m}}
"""


def seas(number: int, until: float = 18.0) -> Study:
    """So many sea states, drawn from a range of heights and periods."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.yaml"
        path.write_text(STUDY.format(number=number, until=until, model=find("cmc_ahc/irregular_sea")), encoding="utf-8")
        return load_study(path)


@contextmanager
def workers(number: int = WORKERS) -> Iterator[tuple[LocalCluster, Cluster]]:
    """A scheduler and so many workers of one thread on this machine."""
    local: Any = LocalCluster
    with local(n_workers=number, threads_per_worker=1, dashboard_address=None) as made, \
            Cluster(made.scheduler_address) as cluster:
        yield made, cluster


def values(result: hb.StudyResult) -> list[dict[str, float]]:
    """What was measured in each case."""
    assert result.complete and not any(outcome.problem for outcome in result.outcomes)
    return [dict(outcome.values) for outcome in result.outcomes]


# -- side by side ------------------------------------------------------------------------------------------------------
def timed(run: Callable[[], hb.StudyResult]) -> tuple[float, float, list[dict[str, float]]]:
    """Seconds by the wall clock, processor time here and in children that have ended, and what was measured."""
    began, used = time.perf_counter(), cpu()
    found = values(run())
    return time.perf_counter() - began, cpu() - used, found


def inside(local: LocalCluster) -> float:
    """Processor time of the workers so far."""
    return sum(sum(psutil.Process(worker.pid).cpu_times()[:2]) for worker in local.workers.values())


def side_by_side(cases: int = SWEPT, pairs: int = PAIRS) -> list[Figure]:
    """A sweep in one process against two, by the wall clock, in turns; and how much more processor time two take."""
    study, rows = seas(cases), []
    with workers() as (local, cluster):
        values(hb.study(seas(4 * WORKERS), executor=cluster))  # what workers import is no cost of a sweep
        for _ in range(pairs):
            one = timed(lambda: hb.study(study, processes=1))
            two = timed(lambda: hb.study(study, processes=WORKERS))
            before = inside(local)
            dask = timed(lambda: hb.study(study, executor=cluster))
            assert one[2] == two[2] == dask[2]  # the same numbers, to the last digit
            rows.append((one[0] / two[0], one[0] / dask[0], two[1] / one[1], (inside(local) - before) / one[1]))
    processes, by_dask, more, more_dask = (statistics.median(column) for column in zip(*rows, strict=True))
    what = f"sweep of {cases} on {WORKERS} cores"
    return [Figure(f"{what}: processes, times as fast as one", f"{processes:.2f}", "≥ 1.9", processes >= 1.9),
            Figure(f"{what}: dask local cluster, times as fast as one process", f"{by_dask:.2f}", "≥ 1.7", by_dask >= 1.7),
            Figure(f"{what}: processor time of the cases, processes / one", f"{more:.2f}"),
            Figure(f"{what}: processor time of the cases, dask / one", f"{more_dask:.2f}")]


def together(cases: int = CASES) -> Figure:
    """A sweep in one process whose cases share their equations, against the same cases worked out by themselves."""
    study = seas(cases)
    ours = timed(lambda: hb.study(study, processes=1))
    with mock.patch("heavebond.studies.run_case.measured_together", return_value=None):
        theirs = timed(lambda: hb.study(study, processes=1))
    for one, other in zip(ours[2], theirs[2], strict=True):
        assert all(abs(one[name] - value) < 1e-5 * abs(value) for name, value in other.items())
    ratio = theirs[1] / ours[1]
    return Figure(f"sweep of {cases} sea states, one process: each by itself / sharing their equations",
                  f"{ratio:.2f} ({duration(theirs[1])} / {duration(ours[1])})", "≥ 4", ratio >= 4)


# -- what a run costs, and what travels --------------------------------------------------------------------------------
def cost() -> list[Figure]:
    """One sea state of ten minutes, without and with all that belongs to a case; the bytes of a task and of its result."""
    study = seas(CASES, 600.0)
    worked(study.packed()(0), 0, None)
    began = cpu()
    assembly = assembled(study, study.case(1))
    built = cpu()
    hb.Simulator(assembly).run()
    run = cpu()
    outcome = worked(study.packed()(1), 1, None)
    done = cpu()
    small, large = (len(pickle.dumps(seas(n).packed()(1))) for n in (CASES, 10_000))
    text = json.dumps(outcome.as_dict())
    return [Figure("a sea state of 10 min: assembly", duration(built - began)),
            Figure("a sea state of 10 min: plain run", duration(run - built)),
            Figure("a sea state of 10 min: the whole case", duration(done - run)),
            Figure(f"a task of a study of {CASES} / of 10 000 cases", f"{small / 1e3:.0f} kB / {large / 1e3:.0f} kB"),
            Figure("its result: handed back / kept as a file",
                   f"{len(pickle.dumps(outcome)) / 1e3:.1f} kB / {len(text) / 1e3:.1f} kB")]


def nothing(packed: PackedCase | None, number: int) -> int:
    """A task without work."""
    return number


@contextmanager
def machines(number: int = WORKERS) -> Iterator[tuple[psutil.Process, Cluster]]:
    """A scheduler and workers in processes of their own, begun as on the command line."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        told = Path(folder) / "scheduler.json"

        def begun(module: str, *options: str) -> subprocess.Popen[bytes]:
            line = [sys.executable, "-m", f"distributed.cli.{module}", "--scheduler-file", str(told), "--no-dashboard"]
            made = subprocess.Popen([*line, *options], stderr=subprocess.DEVNULL)
            stack.callback(made.wait)
            stack.callback(made.terminate)
            return made

        scheduler = begun("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
        while not told.exists():
            time.sleep(0.1)
        begun("dask_worker", "--nthreads", "1", "--nworkers", str(number))
        address = json.loads(told.read_text(encoding="utf-8"))["address"]
        with Client(address, set_as_default=False) as client:  # type: ignore[no-untyped-call]
            client.wait_for_workers(number)
        yield psutil.Process(scheduler.pid), stack.enter_context(Cluster(address))


def throughput(tasks: int = EMPTY_TASKS) -> list[Figure]:
    """What tasks that take no time cost the process that asks and the scheduler, handed over as by `heavebond study`: alone
    and with what a case carries."""
    packed, found = seas(CASES).packed(), list[Figure]()
    with machines() as (scheduler, cluster):
        for what, carried in (("nothing", lambda k: None), ("a case", packed)):
            list(as_done(cluster, nothing, [(k, (carried(k), k)) for k in range(50)], cluster.ahead))
            began, there, here = time.perf_counter(), sum(scheduler.cpu_times()[:2]), time.process_time()
            given = ((k, (carried(k % CASES), k)) for k in range(tasks))
            done = [k for k, _ in as_done(cluster, nothing, given, MANY)]
            took = time.perf_counter() - began
            asking, giving = time.process_time() - here, sum(scheduler.cpu_times()[:2]) - there
            assert sorted(done) == list(range(tasks))
            task = f"an empty task that carries {what}"
            found += [Figure(f"{task}: processor time of the process that asks", duration(asking / tasks)),
                      Figure(f"{task}: processor time of the scheduler", duration(giving / tasks)),
                      Figure(f"{task}: tasks per second, {WORKERS} workers", f"{tasks / took:.0f}")]
    return found


# -- workers that are killed -------------------------------------------------------------------------------------------
def killing(cases: int = CASES, kills: int = 4) -> tuple[Figure, bool]:
    """A sweep during which workers are killed again and again: how many, cases worked twice, and whether every case has the
    numbers that it has in one process."""
    study, killed = seas(cases), list[int]()
    seen = [round(cases * (k + 1) / (kills + 1)) for k in range(kills)]
    with workers() as (local, cluster):
        def tell(text: str) -> None:
            if len(killed) < kills and text.startswith(f"{seen[len(killed)]} of"):
                alive = [w.pid for w in local.workers.values() if w.pid and psutil.pid_exists(w.pid) and w.pid not in killed]
                killed.append(alive[len(killed) % len(alive)])
                os.kill(killed[-1], signal.SIGKILL)

        found = values(hb.study(study, executor=cluster, progress=tell))
    same = found == values(hb.study(study, processes=1))
    told = f"{len(killed)} killed, {len(found)} of {cases} cases done, numbers {'the same' if same else 'DIFFER'}"
    return Figure(f"sweep of {cases} on {WORKERS} workers while workers are killed", told, f"{cases} done, the same",
                  same and len(found) == cases), same


def figures() -> list[Figure]:
    """The lines for docs/performance.md."""
    return [together(), *side_by_side()[:2]]


def main() -> None:
    """As the command line calls it; a number as argument stands for the cases of a sweep, five times as many where
    processes share it."""
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else CASES
    write_page([*cost(), *throughput(), together(cases), *side_by_side(SWEPT * cases // CASES), killing(cases)[0]], PAGE)


if __name__ == "__main__":
    main()
