"""Scores and refits in parallel processes, and the resume file that keeps refits.

Each worker assembles the base model once and then processes one candidate after the other. Workers are processes of this
computer or of a scheduler. Workers of a scheduler receive the experiment and the point with each task, and cache the
assembled model.

Each line of the file holds one refit and a digest of all its inputs: the residuals and derivatives of the base model at its
optimum (exact bits), the samples of all records, the candidate with the file of its component, and the state of the search
when the refit was made. A search that needs a refit with the same digest uses the line. The figures of a refit are then
recomputed by one run of each record, and a line with different figures is ignored. Scores are not stored, because a score
takes a tenth of the time of a refit and its direction is as long as the records.
"""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from heavebond.core.cluster import Cluster
from heavebond.core.errors import HeavebondError
from heavebond.core.kept_lines import Kept, KeptLines
from heavebond.core.packed import packed, unpacked
from heavebond.core.parallel import Processes, as_done, check_cancelled, forks, processors
from heavebond.core.progress import Progress
from heavebond.core.version import VERSION
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.places import named_apart
from heavebond.diagnosis.search.base_model import Base, SharedDiagram, searched, shared_diagrams
from heavebond.diagnosis.search.refit import Refit, at_end_of, begun, borrowed, followed, polished
from heavebond.diagnosis.search.scoring import Score, scored
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.residuals import Descent
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

SAME = 1e-6  # relative difference of the sum of squares from the stored one, as large as the tolerances of the runs
ROUNDING = 1e-9  # of the norm of the residuals, by which a stored score may differ from the score of its direction

_stored_refits: ContextVar[KeptLines | None] = ContextVar("kept refits", default=None)


@contextmanager
def keeping(stored: KeptLines) -> Iterator[None]:
    """Context manager: searches use the stored refits of `stored` and add the refits that they make."""
    before = _stored_refits.set(stored)
    try:
        yield
    finally:
        _stored_refits.reset(before)


def entry(candidate: Candidate, refit: Refit | None) -> dict[str, Any]:
    """The entry of a refit in the resume file. `refit` is None if the diagram cannot be simulated."""
    if refit is None:
        return {"candidate": candidate.label}
    numbers = {n.name for n in refit.candidate.numbers}
    return {"candidate": candidate.label, "inner": refit.inner.tolist(), "cost": refit.cost, "falls": refit.falls,
            "slack": refit.slack, "evaluations": refit.evaluations,
            "ranges": {name: [free.range.low, free.range.high] for name, free in refit.experiment.free.items()
                       if name in numbers},
            "finer": refit.finer, "begun": [d.as_dict() for d in refit.begun]}


def restored(base: Base, candidate: Candidate, guesses: Sequence[Score], stored: Kept) -> Refit | None:
    """Restore a stored refit; None if the model now gives a different sum of squares at its values."""
    try:
        refit = at_end_of(base, candidate, guesses, {n: (low, high) for n, (low, high) in stored["ranges"].items()},
                          np.array(stored["inner"], float), int(stored["finer"]))
        begun = tuple(map(Descent.from_dict, stored["begun"]))
        if not abs(refit.cost - stored["cost"]) <= SAME * abs(stored["cost"]):
            return None
        return replace(refit, begun=begun, falls=bool(stored["falls"]), slack=float(stored["slack"]),
                       evaluations=int(stored["evaluations"]))
    except (HeavebondError, LookupError, TypeError, ValueError, AttributeError):
        return None


def digest_of(base: Base) -> str:
    """Digest of the base model at its optimum and of all records."""
    hasher = hashlib.sha256()
    problem = base.problem
    for part in (VERSION, problem.runs[0].simulator.tolerances, problem.columns,
                 sorted(problem.runs[0].assembly.parameter_values.items()), sorted(problem.experiment.outputs)):
        hasher.update(repr(part).encode())
    for array in (base.r, base.inner, base.J, base.priors):
        hasher.update(np.ascontiguousarray(array).tobytes())
    for name, run in base.exact.items():
        hasher.update(f"{name} {run.record.use}".encode())
        for samples in (run.found.grid, run.measured, run.counts, run.checking, run.noise):
            hasher.update(np.ascontiguousarray(samples).tobytes())
    return hasher.hexdigest()


def digest(base: str, task: str, candidate: Candidate, component: Path | None, known: Sequence[object]) -> str:
    """Digest of a refit. It depends on the digest `base` of the base model (see `digest_of`), on the task `task`, the
    candidate, the file of its component, and the inputs `known`: sums of squares, scores and other refits."""
    hasher = hashlib.sha256(f"{base} {task} {candidate!r} {_plain(known)!r}".encode())
    if component is not None and component.is_file():
        hasher.update(component.read_bytes())
    return hasher.hexdigest()


def _plain(known: object) -> object:
    """The content of an input of a refit for its digest. Refits are compared with all digits. Scores are rounded to six
    digits, because a resumed search recomputes them, and the last digits depend on the number of processes and the order
    of their work."""
    if isinstance(known, Refit):
        return known.candidate.label, known.cost, known.inner.tolist(), [d.x.tolist() for d in known.begun]
    if isinstance(known, Score):
        shapes = {name: f"{value:.6g}" for name, value in known.shapes.items()}
        return f"{known.z:.6g} {known.amplitude:.6g}", shapes, known.along, known.side
    if isinstance(known, Sequence) and not isinstance(known, str):
        return [_plain(one) for one in known]
    return known


T = TypeVar("T")
R = TypeVar("R", bound="Refit | None")
BaseData = tuple[Experiment, Array, Tolerances]  # the data from which a worker builds the base model
_base: Base | None = None  # base model of this worker process
_cluster: ContextVar[Cluster | None] = ContextVar("cluster of searches", default=None)


@contextmanager
def working_on(cluster: Cluster | None) -> Iterator[None]:
    """Context manager: searches use the workers of a cluster instead of processes of this computer, unless `cluster` is
    None."""
    before = _cluster.set(cluster)
    try:
        yield
    finally:
        _cluster.reset(before)


class Workers:
    """Scores and refits with one base model, in `number` processes (in the present process if `number` is 1), or on the
    cluster of the surrounding `working_on` block."""

    def __init__(self, base: Base, number: int | None = None):
        self.base, self.kept = base, _stored_refits.get()
        self.digest = digest_of(base) if self.kept is not None else ""
        self.cluster = _cluster.get()
        self.number = number or processors()
        self.processes: Processes | None = None
        self.lost: list[str] = []  # labels of the candidates whose process died

    @property
    def _base_data(self) -> BaseData:
        return self.base.problem.experiment, self.base.inner, self.base.problem.runs[0].simulator.tolerances

    @cached_property
    def _packed(self) -> bytes:
        return packed(self._base_data)

    def __enter__(self) -> Workers:
        if self.cluster is None and self.number > 1:
            # forked workers already have the base model; without fork, each worker builds it
            self.processes = Processes(self.number, _keep, (self.base,)) if forks() else \
                Processes(self.number, _make, self._base_data)
        return self

    def __exit__(self, *_: object) -> None:
        if self.processes is not None:
            self.processes.__exit__()

    def score(self, candidates: Sequence[Candidate], until: float = float("inf")) -> Iterator[tuple[Candidate, list[Score]]]:
        """Yield the scores of each candidate in the order of completion. Candidates that are not started at the time
        `until` are left out. The classes take turns, so that the scores of an early end are not those of a few classes."""
        # candidates of the catalogue get distinct part names, so that several fit into one diagram
        experiment = self.base.problem.experiment
        adding = any(c.change.components for c in candidates)
        labels = {c.label for c in candidates if c.attaches == "across"}
        apart = {c.label: c for c in named_apart(experiment, labels)} if adding else {}
        shared = shared_diagrams(experiment.model.library, [apart.get(c.label, c) for c in candidates])
        classes: dict[str, list[Candidate]] = {}
        for candidate in candidates:
            classes.setdefault(candidate.kind, []).append(candidate)
        in_turn = [c for row in zip_longest(*classes.values()) for c in row if c is not None]
        none: list[list[Score]] = [[] for _ in in_turn]
        yield from self._each(_scored, [(c, shared.get(c.label)) for c in in_turn], in_turn, until, none)

    def begin(self, jobs: Sequence[tuple[Candidate, Sequence[Score]]], least: float = 0.0, until: float = float("inf"),
              most: float = float("inf")) -> Iterator[tuple[Candidate, Refit | None]]:
        """Make the first steps of each refit, and yield them in the order of completion. Refits that are not started at
        the time `until` are left out. `least` and `most`: see the function `begun`."""
        return self._refits("begin", begun, [(c, guesses, least, most) for c, guesses in jobs], [c for c, _ in jobs], until,
                            [None] * len(jobs))

    def follow(self, jobs: Sequence[tuple[Refit, Sequence[Score]]], until: float = float("inf")
               ) -> Iterator[tuple[Candidate, Refit]]:
        """Continue each refit after its first steps, and yield the refits in the order of completion."""
        return self._refits("follow", followed, jobs, [t.candidate for t, _ in jobs], until, [t for t, _ in jobs])

    def polish(self, jobs: Sequence[tuple[Refit, Sequence[Score], Refit | None]]) -> Iterator[tuple[Candidate, Refit]]:
        """Continue each refit to full convergence, or refit it from the values of another law; see the function
        `polished`."""
        return self._refits("polish", polished, jobs, [job[0].candidate for job in jobs], float("inf"),
                            [trial for trial, _, _ in jobs])

    def borrow(self, jobs: Sequence[tuple[Refit, Sequence[Score], Refit]], until: float = float("inf")
               ) -> Iterator[tuple[Candidate, Refit]]:
        """Refit each candidate from the free parameters of another law; see the function `borrowed`."""
        return self._refits("borrow", borrowed, jobs, [job[0].candidate for job in jobs], until, [job[0] for job in jobs])

    def _refits(self, task: str, work: Callable[..., R], jobs: Sequence[tuple[Any, ...]], candidates: Sequence[Candidate],
                until: float, instead: Sequence[R]) -> Iterator[tuple[Candidate, R]]:
        """Run `_each` for refits, with the stored refits as results if their digests agree."""
        stored = self.kept
        if stored is None:
            yield from self._each(_refitted, [(work, job, None) for job in jobs], candidates, until, instead)
            return
        files = self.base.problem.experiment.model.library.files
        digests = {c.label: digest(self.digest, task, c, files.get(c.component), job)
                   for c, job in zip(candidates, jobs, strict=True)}
        extended_jobs = [(work, job, stored.get(digests[c.label])) for c, job in zip(candidates, jobs, strict=True)]
        for candidate, refit in self._each(_refitted, extended_jobs, candidates, until, instead):
            if candidate.label not in self.lost:
                stored.add(digests[candidate.label], entry(candidate, refit))
            yield candidate, refit

    def _each(self, function: Callable[..., T], jobs: Sequence[tuple[Any, ...]], keys: Sequence[Candidate], until: float,
              instead: Sequence[T]) -> Iterator[tuple[Candidate, T]]:
        """Yield the result of each job with its candidate. If the process of a job dies (killed, out of memory), the job
        is tried once more alone. If it dies again, the result is taken from `instead`, and the candidate's label is added
        to `lost`."""
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
        for number, result in coming:
            yield keys[number], result


def _keep(base: Base) -> None:
    global _base
    _base = base


def _make(*base_data: Any) -> None:
    _keep(_built_base(base_data))


def _built_base(base_data: BaseData) -> Base:
    experiment, inner, tolerances = base_data
    return Base.at(searched(experiment, tolerances), inner)


@lru_cache(maxsize=2)
def _base_of(packed_data: bytes) -> Base:
    return _built_base(unpacked(packed_data))


def _beside(function: Callable[..., T], *job: Any) -> T:
    """Run a job in a worker process of this computer."""
    assert _base is not None
    return function(_base, *job, check_cancelled)


def _elsewhere(packed_data: bytes, function: Callable[..., T], *job: Any) -> T:
    """Run a job in a worker process of a cluster, which receives all data with the job."""
    return function(_base_of(packed_data), *job)


def _scored(base: Base, candidate: Candidate, shared: SharedDiagram | None, progress: Progress | None = None) -> list[Score]:
    try:
        return scored(base, candidate, shared)
    except (RuntimeError, np.linalg.LinAlgError):  # one candidate that cannot be evaluated does not end a search
        return []


def _refitted(base: Base, work: Callable[..., Refit | None], job: Sequence[Any], stored: Kept | None,
              progress: Progress | None = None) -> Any:
    """A stored refit if there is a valid one, otherwise the result of `work`. `job` holds a candidate or its refit so
    far, its scores, and further arguments of `work`."""
    if stored is not None:
        if "inner" not in stored:  # the diagram with the candidate cannot be simulated
            return None
        candidate = job[0].candidate if isinstance(job[0], Refit) else job[0]
        if (refit := restored(base, candidate, job[1], stored)) is not None:
            return refit
    try:
        return work(base, *job, progress)
    except (RuntimeError, np.linalg.LinAlgError):  # as in `_scored`; a refit keeps what it had
        return job[0] if isinstance(job[0], Refit) else None
