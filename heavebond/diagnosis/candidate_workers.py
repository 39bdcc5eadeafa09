"""Candidates scored and refitted side by side: each worker process assembles the base model once and then takes one
candidate after the other."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from heavebond.core.parallel import Processes, as_done, check_cancelled, forks, processors
from heavebond.core.progress import Progress
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.kept_refits import Kept, digest, digest_of, is_broken, kept_here, restored
from heavebond.diagnosis.refit import Refit, begun, followed, polished
from heavebond.diagnosis.scoring import Base, Score, scored, searched
from heavebond.estimation.experiment import Experiment
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

T = TypeVar("T")
R = TypeVar("R", bound="Refit | None")
_base: Base | None = None  # of this worker process


class Workers:
    """The base model at a point, in `number` processes (in this one where it is 1)."""

    def __init__(self, base: Base, number: int | None = None):
        self.base, self.kept = base, kept_here()
        self.digest = digest_of(base) if self.kept is not None else ""
        self.number = number or processors()
        self.processes: Processes | None = None
        self.lost: list[str] = []  # candidates whose process died

    def __enter__(self) -> Workers:
        if self.number > 1:
            # forked workers have the base model already; where there is no fork they make it
            self.processes = Processes(self.number, _kept, (self.base,)) if forks() else \
                Processes(self.number, _made, (self.base.problem.experiment, self.base.inner,
                                              self.base.problem.runs[0].simulator.tolerances))
        return self

    def __exit__(self, *_: object) -> None:
        if self.processes is not None:
            self.processes.__exit__()

    def score(self, candidates: Sequence[Candidate], until: float = float("inf")) -> Iterator[tuple[Candidate, list[Score]]]:
        """The scores of each candidate, in the order in which they are done; those not begun at `until` are left out."""
        return self._each(_score, scored, [(c,) for c in candidates], candidates, until, [[] for _ in candidates])

    def begin(self, jobs: Sequence[tuple[Candidate, Sequence[Score]]], least: float = 0.0, until: float = float("inf")
              ) -> Iterator[tuple[Candidate, Refit | None]]:
        """The first steps of each refit, in the order in which they are done; those not begun at `until` are left out.
        `least` as in `begun`."""
        return self._refits(_begin, _begun, [(c, guesses, least) for c, guesses in jobs], [c for c, _ in jobs], until,
                            [None] * len(jobs))

    def follow(self, jobs: Sequence[tuple[Refit, Sequence[Score]]], until: float = float("inf")
               ) -> Iterator[tuple[Candidate, Refit]]:
        """Each refit that was begun followed, in the same way."""
        return self._refits(_follow, _followed, jobs, [t.candidate for t, _ in jobs], until, [t for t, _ in jobs])

    def polish(self, jobs: Sequence[tuple[Refit, Sequence[Score], Refit | None]]) -> Iterator[tuple[Candidate, Refit]]:
        """Each trial followed to the end of its valley, or of that to which another one leads."""
        return self._refits(_polish, _polished, jobs, [job[0].candidate for job in jobs], float("inf"),
                            [trial for trial, _, _ in jobs])

    def _refits(self, remote: Callable[..., R], here: Callable[..., R], jobs: Sequence[tuple[Any, ...]],
                candidates: Sequence[Candidate], until: float, instead: Sequence[R]) -> Iterator[tuple[Candidate, R]]:
        """As `_each`, each job with what is kept of it."""
        kept = self.kept
        if kept is None:
            yield from self._each(remote, here, [(*job, None) for job in jobs], candidates, until, instead)
            return
        files = self.base.problem.experiment.model.library.files
        digests = {c.label: digest(self.digest, remote.__name__, c, files.get(c.component), job)
                   for c, job in zip(candidates, jobs, strict=True)}
        given = [(*job, kept.get(digests[c.label])) for c, job in zip(candidates, jobs, strict=True)]
        for candidate, found in self._each(remote, here, given, candidates, until, instead):
            if candidate.label not in self.lost:
                kept.add(digests[candidate.label], candidate, found)
            yield candidate, found

    def _each(self, remote: Callable[..., T], here: Callable[..., T], jobs: Sequence[tuple[Any, ...]],
              keys: Sequence[Candidate], until: float, instead: Sequence[T]) -> Iterator[tuple[Candidate, T]]:
        """What comes of each job, by its candidate; of one whose process dies (killed, out of memory), also when it is tried
        again alone, the value of `instead`, and its candidate is noted in `lost`."""
        if self.processes is None:
            for key, job in zip(keys, jobs, strict=True):
                if clock.perf_counter() > until:
                    return
                yield key, here(self.base, *job)
            return

        def died(number: int, _: BaseException) -> T:
            self.lost.append(keys[number].label)
            return instead[number]

        for number, found in as_done(self.processes, remote, list(enumerate(jobs)), self.number + 1, until, died):
            yield keys[number], found


def _kept(base: Base) -> None:
    global _base
    _base = base


def _made(experiment: Experiment, inner: Array, tolerances: Tolerances) -> None:
    _kept(Base.at(searched(experiment, tolerances), inner))


def _score(candidate: Candidate) -> list[Score]:
    assert _base is not None
    return scored(_base, candidate)


def _begin(candidate: Candidate, guesses: Sequence[Score], least: float, kept: Kept | None) -> Refit | None:
    assert _base is not None
    return _begun(_base, candidate, guesses, least, kept, check_cancelled)


def _follow(trial: Refit, guesses: Sequence[Score], kept: Kept | None) -> Refit:
    assert _base is not None
    return _followed(_base, trial, guesses, kept, check_cancelled)


def _polish(trial: Refit, guesses: Sequence[Score], lender: Refit | None, kept: Kept | None) -> Refit:
    assert _base is not None
    return _polished(_base, trial, guesses, lender, kept, check_cancelled)


def _begun(base: Base, candidate: Candidate, guesses: Sequence[Score], least: float, kept: Kept | None,
           progress: Progress | None = None) -> Refit | None:
    if kept is not None and is_broken(kept):
        return None
    return (kept and restored(base, candidate, guesses, kept)) or begun(base, candidate, guesses, least, progress)


def _followed(base: Base, trial: Refit, guesses: Sequence[Score], kept: Kept | None, progress: Progress | None = None
              ) -> Refit:
    return (kept and restored(base, trial.candidate, guesses, kept)) or followed(base, trial, guesses, progress)


def _polished(base: Base, trial: Refit, guesses: Sequence[Score], lender: Refit | None, kept: Kept | None,
              progress: Progress | None = None) -> Refit:
    return (kept and restored(base, trial.candidate, guesses, kept)) or polished(base, trial, guesses, lender, progress)
