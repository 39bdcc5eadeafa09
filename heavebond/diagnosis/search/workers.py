"""Scores and refits in parallel processes, and the file that keeps refits.

Each worker assembles the base model once and then processes one candidate after the other. Workers are processes of this
computer, or those of a scheduler, which receive the experiment and the point with each task and keep what they assembled.

Each line of the file holds one refit, and a digest of everything that it depends on: the residuals and derivatives of the
base model at its optimum (to the last bit), the samples of all records, the candidate with the file of its component, and
the state of the search when the refit was made. A search that asks for the same digest again takes the line. The figures of
a refit are computed anew by one run of each record; a line whose figures differ is ignored. Scores are computed again: each
takes a tenth of the time of a refit, and its direction is as long as the records.
"""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import cached_property, lru_cache
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
from heavebond.diagnosis.search.refit import Refit, at_end_of, begun, followed, polished
from heavebond.diagnosis.search.scoring import Score, scored
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.residuals import Descent
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Tolerances

SAME = 1e-6  # share by which the sum of squares may differ from the kept one: that of the tolerances of the runs
ROUNDING = 1e-9  # of the length of the residuals, by which a kept score may differ from that of its direction

_here: ContextVar[KeptLines | None] = ContextVar("kept refits", default=None)


@contextmanager
def keeping(kept: KeptLines) -> Iterator[None]:
    """Within it searches take refits from those that are kept, and keep those that they make."""
    before = _here.set(kept)
    try:
        yield
    finally:
        _here.reset(before)


def kept_here() -> KeptLines | None:
    """What is kept in the `keeping` block around; None outside of any."""
    return _here.get()


def entry(candidate: Candidate, refit: Refit | None) -> dict[str, Any]:
    """What is kept of a refit (None: it cannot be simulated)."""
    if refit is None:
        return {"candidate": candidate.label}
    own = {n.name for n in refit.candidate.numbers}
    return {"candidate": candidate.label, "inner": refit.inner.tolist(), "cost": refit.cost, "falls": refit.falls,
            "slack": refit.slack, "evaluations": refit.evaluations,
            "ranges": {name: [free.range.low, free.range.high] for name, free in refit.experiment.free.items()
                       if name in own},
            "finer": refit.finer, "begun": [d.as_dict() for d in refit.begun]}


def is_broken(kept: Kept) -> bool:
    """Whether the diagram with the candidate could not be simulated."""
    return "inner" not in kept


def restored(base: Base, candidate: Candidate, guesses: Sequence[Score], kept: Kept) -> Refit | None:
    """The refit that was kept; None where the model gives another one there."""
    try:
        found = at_end_of(base, candidate, guesses, {n: (low, high) for n, (low, high) in kept["ranges"].items()},
                          np.array(kept["inner"], float), int(kept["finer"]))
        begun = tuple(map(Descent.from_dict, kept["begun"]))
        if not abs(found.cost - kept["cost"]) <= SAME * abs(kept["cost"]):
            return None
        return replace(found, begun=begun, falls=bool(kept["falls"]), slack=float(kept["slack"]),
                       evaluations=int(kept["evaluations"]))
    except (HeavebondError, LookupError, TypeError, ValueError, AttributeError):
        return None


def digest_of(base: Base) -> str:
    """A digest of the base model at its optimum and of all records."""
    made = hashlib.sha256()
    problem = base.problem
    for part in (VERSION, problem.runs[0].simulator.tolerances, problem.columns,
                 sorted(problem.runs[0].assembly.parameter_values.items()), sorted(problem.experiment.outputs)):
        made.update(repr(part).encode())
    for array in (base.r, base.inner, base.J, base.priors):
        made.update(np.ascontiguousarray(array).tobytes())
    for name, run in base.exact.items():
        made.update(f"{name} {run.record.use}".encode())
        for samples in (run.found.grid, run.measured, run.counts, run.checking, run.noise):
            made.update(np.ascontiguousarray(samples).tobytes())
    return made.hexdigest()


def digest(base: str, what: str, candidate: Candidate, component: Path | None, known: Sequence[object]) -> str:
    """The digest of a refit: of the base model (see `digest_of`), what is done, the candidate, the file of its component,
    and what is known when it is done: sums of squares, scores, other refits."""
    made = hashlib.sha256(f"{base} {what} {candidate!r} {_plain(known)!r}".encode())
    if component is not None and component.is_file():
        made.update(component.read_bytes())
    return made.hexdigest()


def _plain(known: object) -> object:
    """A refit by its digits; a score by six, as it is computed again when a search is resumed, and the number of processes
    and the order of their work change its last digits."""
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
        """The scores of each candidate, in the order in which they are done; those not begun at `until` are left out."""
        shared = self._shared(candidates)
        none: list[list[Score]] = [[] for _ in candidates]
        yield from self._each(_scored, [(c, shared.get(c.label)) for c in candidates], candidates, until, none)

    def _shared(self, candidates: Sequence[Candidate]) -> dict[str, SharedDiagram]:
        """The diagrams that candidates share, those of the catalogue with names of their own for their parts."""
        experiment = self.base.problem.experiment
        adding = any(c.change.components for c in candidates)
        labels = {c.label for c in candidates if c.attaches == "across"}
        apart = {c.label: c for c in named_apart(experiment, labels)} if adding else {}
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
