"""Candidates scored and refitted side by side: each worker assembles the base model once and then takes one candidate after
the other. Workers are processes of this computer, or those of a scheduler, which are sent the experiment and the point with
each task and keep what they have made of it."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property, lru_cache
from typing import Any, TypeVar

from heavebond.core.cluster import Cluster
from heavebond.core.kept_lines import Kept
from heavebond.core.packed import packed, unpacked
from heavebond.core.parallel import Processes, as_done, check_cancelled, forks, processors
from heavebond.core.progress import Progress
from heavebond.diagnosis.base_model import Base, searched
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.kept_refits import (
    digest,
    digest_of,
    entry,
    is_broken,
    kept_here,
    restored,
    restored_scores,
    scores_entry,
)
from heavebond.diagnosis.like_places import named_apart
from heavebond.diagnosis.refit import Refit, begun, followed, polished
from heavebond.diagnosis.scoring import Score, scored
from heavebond.diagnosis.shared_diagrams import SharedDiagram, shared_diagrams
from heavebond.estimation.experiment import Experiment
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

T = TypeVar("T")
R = TypeVar("R", bound="Refit | None")
Given = tuple[Experiment, Array, Tolerances]  # what the base model is made of
_base: Base | None = None  # of this worker process
_cluster: ContextVar[Cluster | None] = ContextVar("cluster of searches", default=None)


@contextmanager
def working_on(cluster: Cluster | None) -> Iterator[None]:
    """Within it searches work on the workers of a cluster, where there is one, instead of processes of this computer."""
    before = _cluster.set(cluster)
    try:
        yield
    finally:
        _cluster.reset(before)


class Workers:
    """The base model at a point, in `number` processes (in this one where it is 1), or on the workers of the cluster of the
    `working_on` block around."""

    def __init__(self, base: Base, number: int | None = None):
        self.base, self.kept = base, kept_here()
        self.digest = digest_of(base) if self.kept is not None else ""
        self.cluster = _cluster.get()
        self.number = number or processors()
        self.processes: Processes | None = None
        self.lost: list[str] = []  # candidates whose process died

    @property
    def _given(self) -> Given:
        return self.base.problem.experiment, self.base.inner, self.base.problem.runs[0].simulator.tolerances

    @cached_property
    def _packed(self) -> bytes:
        return packed(self._given)

    def __enter__(self) -> Workers:
        if self.cluster is None and self.number > 1:
            # forked workers have the base model already; where there is no fork they make it
            self.processes = Processes(self.number, _keep, (self.base,)) if forks() else \
                Processes(self.number, _make, self._given)
        return self

    def __exit__(self, *_: object) -> None:
        if self.processes is not None:
            self.processes.__exit__()

    def score(self, candidates: Sequence[Candidate], until: float = float("inf")) -> Iterator[tuple[Candidate, list[Score]]]:
        """The scores of each candidate, those that are kept first, the others in the order in which they are done; those
        not begun at `until` are left out."""
        digests = self._digests("score", candidates, [()] * len(candidates))
        open_ = []
        for c in candidates:
            line = self.kept.get(digests[c.label]) if self.kept is not None else None
            known = restored_scores(self.base, c, line) if line is not None else None
            if known is not None:
                yield c, known
            else:
                open_.append(c)
        instead: list[list[Score]] = [[] for _ in open_]
        shared = self._shared(candidates) if open_ else {}
        for c, found in self._each(_scored, [(c, shared.get(c.label)) for c in open_], open_, until, instead):
            if self.kept is not None and c.label not in self.lost:
                self.kept.add(digests[c.label], scores_entry(c, found))
            yield c, found

    def _shared(self, candidates: Sequence[Candidate]) -> dict[str, SharedDiagram]:
        """The diagrams that candidates share, those of the catalogue with names of their own for their parts."""
        experiment = self.base.problem.experiment
        adding = any(c.change.components for c in candidates)
        apart = {c.label: c for c in named_apart(experiment)} if adding else {}
        return shared_diagrams(experiment.model.library, [apart.get(c.label, c) for c in candidates])

    def begin(self, jobs: Sequence[tuple[Candidate, Sequence[Score]]], least: float = 0.0, until: float = float("inf")
              ) -> Iterator[tuple[Candidate, Refit | None]]:
        """The first steps of each refit, in the order in which they are done; those not begun at `until` are left out.
        `least` as in `begun`."""
        return self._refits("begin", begun, [(c, guesses, least) for c, guesses in jobs], [c for c, _ in jobs], until,
                            [None] * len(jobs))

    def follow(self, jobs: Sequence[tuple[Refit, Sequence[Score]]], until: float = float("inf")
               ) -> Iterator[tuple[Candidate, Refit]]:
        """Each refit that was begun followed, in the same way."""
        return self._refits("follow", followed, jobs, [t.candidate for t, _ in jobs], until, [t for t, _ in jobs])

    def polish(self, jobs: Sequence[tuple[Refit, Sequence[Score], Refit | None]]) -> Iterator[tuple[Candidate, Refit]]:
        """Each trial followed to the end of its valley, or of that to which another one leads."""
        return self._refits("polish", polished, jobs, [job[0].candidate for job in jobs], float("inf"),
                            [trial for trial, _, _ in jobs])

    def _refits(self, what: str, work: Callable[..., R], jobs: Sequence[tuple[Any, ...]], candidates: Sequence[Candidate],
                until: float, instead: Sequence[R]) -> Iterator[tuple[Candidate, R]]:
        """As `_each`, each job with what is kept of it."""
        kept = self.kept
        if kept is None:
            yield from self._each(_refitted, [(work, job, None) for job in jobs], candidates, until, instead)
            return
        digests = self._digests(what, candidates, jobs)
        given = [(work, job, kept.get(digests[c.label])) for c, job in zip(candidates, jobs, strict=True)]
        for candidate, found in self._each(_refitted, given, candidates, until, instead):
            if candidate.label not in self.lost:
                kept.add(digests[candidate.label], entry(candidate, found))
            yield candidate, found

    def _digests(self, what: str, candidates: Sequence[Candidate], known: Sequence[Sequence[object]]) -> dict[str, str]:
        """The digest of what is done for each candidate, by their labels; none where nothing is kept."""
        files = self.base.problem.experiment.model.library.files
        return {c.label: digest(self.digest, what, c, files.get(c.component), job)
                for c, job in zip(candidates, known, strict=True)} if self.kept is not None else {}

    def _each(self, function: Callable[..., T], jobs: Sequence[tuple[Any, ...]], keys: Sequence[Candidate], until: float,
              instead: Sequence[T]) -> Iterator[tuple[Candidate, T]]:
        """What comes of each job, by its candidate; of one whose process dies (killed, out of memory), also when it is tried
        again alone, the value of `instead`, and its candidate is noted in `lost`."""
        if self.cluster is None and self.processes is None:
            for key, job in zip(keys, jobs, strict=True):
                if clock.perf_counter() > until:
                    return
                yield key, function(self.base, *job)
            return

        def died(number: int, _: BaseException) -> T:
            self.lost.append(keys[number].label)
            return instead[number]

        coming: Iterator[tuple[int, T]]
        if self.processes is not None:
            coming = as_done(self.processes, _beside, [(k, (function, *job)) for k, job in enumerate(jobs)], self.number + 1,
                             until, died)
        else:
            assert self.cluster is not None
            coming = as_done(self.cluster, _elsewhere, [(k, (self._packed, function, *job)) for k, job in enumerate(jobs)],
                             self.cluster.ahead, until, died)
        for number, found in coming:
            yield keys[number], found


def _keep(base: Base) -> None:
    global _base
    _base = base


def _make(*given: Any) -> None:
    _keep(_made(given))


def _made(given: Given) -> Base:
    experiment, inner, tolerances = given
    return Base.at(searched(experiment, tolerances), inner)


@lru_cache(maxsize=2)
def _base_of(given: bytes) -> Base:
    return _made(unpacked(given))


def _beside(function: Callable[..., T], *job: Any) -> T:
    """A job in a worker process of this computer."""
    assert _base is not None
    return function(_base, *job, check_cancelled)


def _elsewhere(given: bytes, function: Callable[..., T], *job: Any) -> T:
    """A job in a process that another one has sent everything."""
    return function(_base_of(given), *job)


def _scored(base: Base, candidate: Candidate, shared: SharedDiagram | None, progress: Progress | None = None) -> list[Score]:
    return scored(base, candidate, shared)


def _refitted(base: Base, work: Callable[..., Refit | None], job: Sequence[Any], kept: Kept | None,
              progress: Progress | None = None) -> Any:
    """A refit that is kept, or else what `work` makes of the job: a candidate or its refit so far, guesses, and more."""
    if kept is not None:
        if is_broken(kept):
            return None
        candidate = job[0].candidate if isinstance(job[0], Refit) else job[0]
        if (found := restored(base, candidate, job[1], kept)) is not None:
            return found
    return work(base, *job, progress)
