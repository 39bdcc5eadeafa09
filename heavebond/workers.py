"""Candidates scored and refitted side by side: each worker process assembles the base model once and then takes one
candidate after the other."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time as clock
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

from heavebond.catalogue import Candidate
from heavebond.dae import Array
from heavebond.experiment import Experiment
from heavebond.scoring import Base, Score, scored, searched
from heavebond.threads import single
from heavebond.trial import Trial, polished, tried

T = TypeVar("T")
_base: Base | None = None  # of this worker process
_stop: Event | None = None  # set where what it does is not wanted any more


class _Stopped(Exception):
    """What a worker was doing is not wanted any more."""


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers:
    """The base model at a point, in `number` processes (in this one where it is 1)."""

    def __init__(self, base: Base, number: int | None = None):
        self.base = base
        self.number = number or processors()
        self.pool: ProcessPoolExecutor | None = None
        self.stop: Event | None = None

    def __enter__(self) -> Workers:
        if self.number > 1:
            # forked workers have the base model already; where there is no fork they make it
            fork = "fork" in multiprocessing.get_all_start_methods()
            context = multiprocessing.get_context("fork" if fork else "spawn")
            self.stop = context.Event()
            start, given = (_forked, (self.base,)) if fork else (_spawned, (self.base.problem.experiment, self.base.inner))
            self.pool = ProcessPoolExecutor(self.number, context, start, (self.stop, *given))
        return self

    def __exit__(self, *_: object) -> None:
        if self.pool is not None and self.stop is not None:
            # a process that is killed while it hands over a result leaves the pool waiting for the rest of it for ever
            self.stop.set()
            self.pool.shutdown(wait=True, cancel_futures=True)

    def score(self, candidates: Sequence[Candidate], until: float = float("inf")) -> Iterator[tuple[Candidate, list[Score]]]:
        """The scores of each candidate, in the order in which they are done; those not begun at `until` are left out."""
        return self._each(_score, scored, [(c,) for c in candidates], candidates, until)

    def refit(self, jobs: Sequence[tuple[Candidate, Sequence[Score]]], until: float = float("inf")
              ) -> Iterator[tuple[Candidate, Trial | None]]:
        """The refit of each candidate, in the order in which they are done; those not begun at `until` are left out."""
        return self._each(_refit, tried, jobs, [c for c, _ in jobs], until)

    def polish(self, jobs: Sequence[tuple[Trial, Sequence[Score]]]) -> Iterator[tuple[Candidate, Trial]]:
        """Each trial followed to the end of its valley."""
        return self._each(_polish, polished, jobs, [t.candidate for t, _ in jobs], float("inf"))

    def _each(self, remote: Callable[..., T], here: Callable[..., T], jobs: Sequence[tuple[Any, ...]],
              keys: Sequence[Candidate], until: float) -> Iterator[tuple[Candidate, T]]:
        if self.pool is None:
            for key, job in zip(keys, jobs, strict=True):
                if clock.perf_counter() > until:
                    return
                yield key, here(self.base, *job)
            return
        waiting = list(zip(keys, jobs, strict=True))[::-1]
        running: dict[Future[T], Candidate] = {}
        while waiting or running:
            while waiting and len(running) <= self.number and clock.perf_counter() <= until:
                key, job = waiting.pop()
                running[self.pool.submit(remote, *job)] = key
            if not running:
                return
            for done in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(done), done.result()


def _forked(stop: Event, base: Base) -> None:
    global _base, _stop
    single()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that collects
    _base, _stop = base, stop


def _spawned(stop: Event, experiment: Experiment, inner: Array) -> None:
    _forked(stop, Base.at(searched(experiment), inner))


def _heed(text: str) -> None:
    """Between two runs: whether to go on."""
    if _stop is not None and _stop.is_set():
        raise _Stopped(text)


def _score(candidate: Candidate) -> list[Score]:
    assert _base is not None
    return scored(_base, candidate)


def _refit(candidate: Candidate, guesses: Sequence[Score]) -> Trial | None:
    assert _base is not None
    return tried(_base, candidate, guesses, _heed)


def _polish(trial: Trial, guesses: Sequence[Score]) -> Trial:
    assert _base is not None
    return polished(_base, trial, guesses, _heed)
