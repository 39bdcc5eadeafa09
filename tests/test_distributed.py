"""Refits of a diagnosis and starts of a fit on the workers of a scheduler: the answers are those of this computer."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import time as clock
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import distributed
import numpy as np
import pytest
from distributed.comm.core import CommClosedError

import heavebond as hb
from heavebond.cli import main
from heavebond.core.cluster import Cluster
from heavebond.core.kept_lines import KeptLines
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.scoring import Score
from heavebond.diagnosis.search.step import fitted_base
from heavebond.diagnosis.search.workers import Workers, working_on
from heavebond.estimation.experiment import load_experiment

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="processes are killed otherwise here")
RIG = "receiver_rig/choked"
CHOSEN = ("PneumaticValve in inlet (b_cr)", "SensorGain in the channel receiver.p")


@pytest.fixture(scope="module")
def local() -> Iterator[Any]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as found:
        yield found


def kill_a_worker(local: Any) -> None:
    os.kill(next(iter(local.workers.values())).pid, signal.SIGKILL)


def numbers(refit: Refit) -> tuple[Any, ...]:
    return refit.cost, refit.chi2_held_out, refit.values, refit.inner.tolist(), refit.evaluations


@pytest.mark.long
def test_a_cluster_refits_as_this_computer_does_though_a_worker_is_killed(local: Any) -> None:
    """To the last bit: scores and refits of candidates, as the base model is made anew from the same numbers."""
    base = fitted_base(load_experiment(RIG))
    chosen = [c for c in single_candidates(base.problem.experiment) if c.label in CHOSEN]

    def refitted(killing: Callable[[], None] = lambda: None) -> tuple[dict[str, list[Score]], list[dict[str, Refit]]]:
        with Workers(base, 1) as workers:
            scores = {c.label: found for c, found in workers.score(chosen)}
            begun = {}
            for k, (c, refit) in enumerate(workers.begin([(c, scores[c.label]) for c in chosen])):
                assert refit is not None
                begun[c.label] = refit
                if k == 0:
                    killing()
            followed = {c.label: t for c, t in workers.follow([(t, scores[label]) for label, t in begun.items()])}
            assert not workers.lost
        return scores, [begun, followed]

    here, stages = refitted()
    with Cluster(local.scheduler_address) as cluster, working_on(cluster):
        there, others = refitted(lambda: kill_a_worker(local))
    assert set(here) == set(there) == set(CHOSEN)
    for label in CHOSEN:
        assert [(s.z, s.amplitude, s.shapes, s.along) for s in here[label]] == \
            [(s.z, s.amplitude, s.shapes, s.along) for s in there[label]]
        for stage, other in zip(stages, others, strict=True):
            assert numbers(stage[label]) == numbers(other[label])


@pytest.mark.long
def test_a_cluster_fits_from_the_same_starts_and_what_was_done_is_kept(local: Any, tmp_path: Path) -> None:
    here = hb.fit(RIG, starts=4)
    path, killed = tmp_path / "starts.jsonl", list[str]()

    def tell(text: str) -> None:
        if text.startswith("1 of 4 starts") and not killed:
            killed.append(text)
            kill_a_worker(local)

    with Cluster(local.scheduler_address) as cluster:
        there = hb.fit(RIG, starts=4, executor=cluster, kept=KeptLines(path), progress=tell)
    assert killed and len(KeptLines.read(path).known) == 4
    kept = KeptLines.read(path)
    again = hb.fit(RIG, starts=4, kept=kept)
    assert kept.taken == 4
    for other in (there, again):
        assert other.cost == here.cost and other.history == here.history
        assert [(p.value, p.interval) for p in other.parameters] == [(p.value, p.interval) for p in here.parameters]
    robust = KeptLines.read(path)
    assert np.isfinite(hb.fit(RIG, starts=2, robust=True, kept=robust).cost).all()  # another loss is another search
    assert robust.taken == 0 and len(robust.known) == 6


@contextmanager
def scheduler() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address and the process of a scheduler with two workers, each a process of its own."""
    def dask(*given: str) -> subprocess.Popen[str]:
        return subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_" + given[0], *given[1:], "--no-dashboard"],
                                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

    made = [dask("scheduler", "--host", "127.0.0.1", "--port", "0")]
    try:
        assert made[0].stderr is not None
        address = next(found.group() for line in made[0].stderr if (found := re.search(r"tcp://[0-9.:]+", line)))
        made += [dask("worker", address, "--nthreads", "1", "--no-nanny") for _ in range(2)]
        with distributed.Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, made[0]
    finally:
        for process in made:
            process.kill()
            process.communicate()


@pytest.mark.long
def test_a_search_that_loses_its_scheduler_goes_on_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    command = ["diagnose", RIG, "--only", "choked flow", "--only", "lag", "--json", "told.json"]
    kept = Path("choked_refits.jsonl")
    with scheduler() as (address, process):
        begun = subprocess.Popen([sys.executable, "-c", "from heavebond.cli import main; main()", *command, "--scheduler",
                                  address], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        end = clock.monotonic() + 120
        while clock.monotonic() < end and begun.poll() is None and not (kept.exists() and '"inner"' in kept.read_text()):
            clock.sleep(0.02)
        process.kill()
        assert begun.communicate(timeout=120)[1].count("does not answer any more") == 1
    assert begun.returncode == 2 and json.loads(Path("told.json").read_text())["problems"][0]["code"] == "scheduler-lost"

    def told(*more: str) -> dict[str, Any]:
        with pytest.raises(SystemExit) as ended:
            main([*command, *more])
        assert not ended.value.code
        return {k: v for k, v in json.loads(Path("told.json").read_text()).items() if k not in ("seconds", "files")}

    lines = len(KeptLines.read(kept).known)
    resumed = told("--resume")
    assert lines and not kept.exists()
    assert resumed == told()


@pytest.mark.parametrize(("lost", "outcome"), [(True, "cancelled"), (False, "answered")])
def test_a_connection_that_closes_within_an_answer_is_no_error_of_a_file(lost: bool, outcome: str) -> None:
    """`CommClosedError` is an OSError. With the scheduler lost the answer is cancelled, which `listen` explains; while it is
    there the answer is asked for again."""
    class Client:
        status, asked = "running", 0

        async def gather(self, task: Any, asynchronous: bool) -> int:
            self.asked += 1
            if lost:
                self.status = "closed"
            if lost or self.asked < 3:
                raise CommClosedError("in <TCP (closed)>: Stream is closed")
            return 7

    cluster = Cluster.__new__(Cluster)
    cluster.client = Client()
    answer: Future[int] = Future()
    asyncio.run(cluster._handed_over(None, answer))
    assert answer.cancelled() if outcome == "cancelled" else answer.result() == 7
