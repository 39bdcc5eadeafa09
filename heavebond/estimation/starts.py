"""The descents of a fit from its starting points: in sequence, or in parallel on the workers of a cluster.

A worker receives the experiment with each start and caches the least squares problem that it builds. Completed descents
may be stored in a file, each with a digest of the records, the model (its residuals and derivatives at the first start,
to the last bit), the start and the method.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from heavebond.core.cancellation import ENDED_EARLY, clear_signal
from heavebond.core.cluster import Cluster
from heavebond.core.errors import HeavebondError
from heavebond.core.kept_lines import KeptLines
from heavebond.core.packed import packed, unpacked
from heavebond.core.parallel import as_done
from heavebond.core.progress import Progress, numbered
from heavebond.core.version import VERSION
from heavebond.estimation.excerpts import EXCERPTS
from heavebond.estimation.multiple_shooting import Shooting
from heavebond.estimation.residuals import Descent, Residuals
from heavebond.numerics.dae import Array

AROUND = 16  # points of the ranges at which a fit searches for a smaller sum of squares


@dataclass(frozen=True)
class Starts:
    """The starting points (m,) of a fit, and the settings of their descents."""

    points: Sequence[Array]
    segments: int = 1
    robust: bool = False
    partial: bool = False

    def descents(self, problem: Residuals, say: Progress, cluster: Cluster | None = None, stored: KeptLines | None = None
                 ) -> list[Descent]:
        """Ends of the descents, in the order of the starts. With `partial` an interrupt returns the completed ones, the
        last of them with the message ENDED_EARLY."""
        digests = [self._digest(problem, point) for point in self.points] if stored is not None else []
        completed: dict[int, Descent] = {}
        for k, digest in enumerate(digests):
            with suppress(LookupError, TypeError, ValueError):
                assert stored is not None
                entry = stored.get(digest) or {}
                completed[k] = Descent.from_dict(entry)
                problem.evaluations += int(entry["evaluations"])
        waiting = [k for k in range(len(self.points)) if k not in completed]
        coming = self._in_this_process(problem, waiting, say) if cluster is None else \
            self._on_cluster(problem, waiting, say, cluster)
        try:
            for k, descent, evaluations in coming:
                completed[k] = descent
                if stored is not None and descent.message != ENDED_EARLY:
                    stored.add(digests[k], {**descent.as_dict(), "evaluations": evaluations})
        except KeyboardInterrupt:
            if not self.partial or not completed:
                raise
            clear_signal()
            return self._ended(completed)
        return self._ended(completed) if any(d.message == ENDED_EARLY for d in completed.values()) else _in_order(completed)

    def lower(self, problem: Residuals, runs: Sequence[Descent], seed: int, say: Progress) -> list[Descent]:
        """The descents, and one more from a point of the ranges whose sum of squares is already below the best end: the
        best was in another local minimum (an oscillation that is out of phase with the record has several). A run ends
        as soon as it exceeds the best."""
        least, lowest = min(2 * run.cost for run in runs), None
        try:
            for point in problem.starting_points(AROUND + 1, seed)[1:]:
                if (cost_at_point := problem.cost(point, least)) < least:
                    least, lowest = cost_at_point, point
            return [*runs, self._descended(problem, lowest, say)] if lowest is not None else [*runs]
        except KeyboardInterrupt:
            if not self.partial:
                raise
            clear_signal()
            return self._ended(dict(enumerate(runs)))

    def _ended(self, descents_found: dict[int, Descent]) -> list[Descent]:
        descents = _in_order(descents_found)
        return [*descents[:-1], replace(descents[-1], message=ENDED_EARLY)]

    def _in_this_process(self, problem: Residuals, numbers: Sequence[int], say: Progress
                         ) -> Iterator[tuple[int, Descent, int]]:
        for k in numbers:
            descent, evaluations = self.follow(problem, self.points[k], numbered(say, "start", k + 1, len(self.points)))
            yield k, descent, evaluations
            if descent.message == ENDED_EARLY:
                return

    def _on_cluster(self, problem: Residuals, numbers: Sequence[int], say: Progress, cluster: Cluster
                   ) -> Iterator[tuple[int, Descent, int]]:
        shared = packed(problem.experiment)
        jobs = [(k, (shared, replace(self, points=[self.points[k]], partial=False))) for k in numbers]
        say(f"start 1 of {len(self.points)}")
        for completed_count, (k, (descent, evaluations)) in enumerate(as_done(cluster, _followed, jobs, cluster.ahead), 1):
            problem.evaluations += evaluations
            say(f"{len(self.points) - len(numbers) + completed_count} of {len(self.points)} starts: chi-square per sample "
                f"{2 * descent.cost / problem.samples:.4g}")
            yield k, descent, evaluations

    def follow(self, problem: Residuals, start: Array, say: Progress) -> tuple[Descent, int]:
        """The descent from a point, and the number of evaluations of the problem."""
        before = problem.evaluations
        if self.segments > 1:
            start = Shooting(problem, self.segments).solve(start, say)
        return self._descended(problem, start, say), problem.evaluations - before

    def _descended(self, problem: Residuals, start: Array, say: Progress) -> Descent:
        """Least squares from a start. For long records it begins with their beginnings, and continues from that end, if
        it is better on the whole records (from near the optimum this takes half of the runs), until it has settled."""
        points = sum(len(run.found.grid) for run in problem.runs)
        if points <= EXCERPTS.long:
            return problem.minimise(start, self.robust, say, partial=self.partial)
        each = EXCERPTS.max_extension * EXCERPTS.excerpt // len(problem.runs)
        begun = [replace(run.record, end=float(run.found.grid[min(each, len(run.found.grid)) - 1])) for run in problem.runs]
        try:
            descent_of_beginnings = Residuals(problem.experiment, begun).minimise(
                start, self.robust, lambda text: say(f"beginning of the records: {text}"), tolerance=1e-6,
                partial=self.partial, settle=not self.robust)
        except HeavebondError:  # one of them has no samples of a channel there
            descent_of_beginnings = Descent(start, np.inf, (), "")
        if descent_of_beginnings.message == ENDED_EARLY:
            return descent_of_beginnings
        try:
            if len(descent_of_beginnings.history):
                wrong, prior = problem.evaluate(descent_of_beginnings.x)[0], problem.priors(descent_of_beginnings.x)[0]
                sum_of_squares = float(wrong @ wrong + prior @ prior)
                start = start if problem.cost(start, sum_of_squares) < sum_of_squares else descent_of_beginnings.x
            return problem.minimise(start, self.robust, say, partial=self.partial, settle=not self.robust)
        except KeyboardInterrupt:
            if not (self.partial and len(descent_of_beginnings.history)):
                raise
            clear_signal()
            return replace(descent_of_beginnings, message=ENDED_EARLY)

    def _digest(self, problem: Residuals, point: Array) -> str:
        digest = hashlib.sha256(repr((VERSION, problem.runs[0].simulator.tolerances, problem.columns, self.segments,
                                      self.robust)).encode())
        for array in (*problem.evaluate(problem.start), point):
            digest.update(np.ascontiguousarray(array).tobytes())
        for run in problem.runs:
            digest.update(run.record.name.encode())
            for samples in (run.found.grid, run.measured, run.counts, run.noise):
                digest.update(np.ascontiguousarray(samples).tobytes())
        return digest.hexdigest()


def _in_order(descents_found: dict[int, Descent]) -> list[Descent]:
    return [descents_found[k] for k in sorted(descents_found)]


def _followed(experiment: bytes, starts: Starts) -> tuple[Descent, int]:
    """The descent from one point, in a process that has received all data."""
    return starts.follow(_problem_of(experiment), starts.points[0], lambda text: None)


@lru_cache(maxsize=2)
def _problem_of(experiment: bytes) -> Residuals:
    return Residuals(unpacked(experiment))
