"""Multiple shooting: parameters from records on which one long run would diverge.

Each record is divided into segments, and each segment starts from separate states x_k, which are unknowns in addition to the
parameters p. With r the weighted residuals of the data and c_k = x(end of segment k; x_k, p) - x_{k+1} the gaps between
segments,

    minimise |r|**2 + w |c|**2,   w rising from stage to stage until the gaps are closed.

An unstable or wrong model is corrected by the data at every joint before it diverges, and the cost has fewer local
minima. H. G. Bock, K. J. Plitt (1984), doi:10.1016/S1474-6670(17)61205-9.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from heavebond.core.errors import ModelError, SimulationError, StartError
from heavebond.core.progress import Progress
from heavebond.estimation.comparison import TOLERANCES
from heavebond.estimation.residuals import BROKEN, Residuals, Run
from heavebond.numerics.dae import Array
from heavebond.numerics.simulator import Simulator

# The gaps, in nominal sizes of the states, are weighted like data with this noise; one stage for each.
LOOSE_TO_TIGHT = (1e-1, 1e-2, 1e-3, 1e-4)
STEPS = 12  # evaluations of the least squares solver in each stage


@dataclass(frozen=True)
class _Segment:
    """An interval of a record with the indices of its first and last sample (the last one is the first of the next
    segment).
    """

    run: Run
    simulator: Simulator
    begin: int
    end: int
    first: bool


class Shooting:
    """The least squares problem of a fit with states at the joints as further unknowns."""

    def __init__(self, problem: Residuals, segments: int):
        self.problem = problem
        self.n = len(problem.columns)
        self.segments: list[_Segment] = []
        for run in problem.runs:
            ends = np.linspace(0, len(run.simulator.time) - 1, segments + 1).astype(int)
            for k, (begin, end) in enumerate(pairwise(ends.tolist())):
                simulator = Simulator(run.assembly, times=run.simulator.time[begin:end + 1], tolerances=TOLERANCES,
                                      sensitivities=run.names, free_start=k > 0)
                self.segments.append(_Segment(run, simulator, begin, end, k == 0))
        sizes = [0 if s.first else len(s.run.assembly.x_nominal) for s in self.segments]
        self.offsets = self.n + np.concatenate([[0], np.cumsum(sizes)]).astype(int)

    def start(self, inner: Array, states: Array | None = None) -> Array:
        """First values: the parameters, and at each joint the state of the run, while it is finite.

        Each segment is run from the end of the one before; if one breaks down, the diagram's start is used.
        """
        y, last = [inner], np.zeros(0)
        for segment in self.segments:
            values, nominal = self.problem.values_of(inner, segment.run.record.name), segment.run.assembly.x_nominal
            try:
                simulator = segment.simulator
                result = simulator.run(values) if segment.first else simulator.run_from(last, values)
                begin, last = result.x[:, 0], result.x[:, -1]
            except (ModelError, SimulationError, StartError):
                begin = last = last if last.size else np.zeros(len(nominal))
            if not segment.first:
                y.append(begin / nominal)
        return np.concatenate(y)

    def residuals(self, y: Array, tightness: float) -> tuple[Array, Array]:
        """Data residuals, then gaps divided by `tightness`, and their Jacobian in y."""
        parts, blocks = [], []
        for k in range(len(self.segments)):
            data, gap, data_slopes, gap_slopes = self._segment(k, y)
            parts += [data, gap / tightness]
            blocks += [data_slopes, gap_slopes / tightness]
        return np.concatenate(parts), np.vstack(blocks)

    def _segment(self, k: int, y: Array) -> tuple[Array, Array, Array, Array]:
        segment, inner = self.segments[k], y[: self.n]
        run, nominal = segment.run, segment.run.assembly.x_nominal
        own_states = slice(self.offsets[k], self.offsets[k + 1])
        joined = k + 1 < len(self.segments) and not self.segments[k + 1].first
        # the last sample belongs to the next segment, except for the record's last
        samples = slice(segment.begin, segment.end if joined else segment.end + 1)
        counts = run.counts[:, samples]
        n_data, n_gap = int(counts.sum()), len(nominal) if joined else 0
        slopes, gap_slopes = np.zeros((n_data, len(y))), np.zeros((n_gap, len(y)))
        values = self.problem.values_of(inner, run.record.name)
        try:
            result = segment.simulator.run(values) if segment.first else segment.simulator.run_from(y[own_states] * nominal,
                                                                                                    values)
        except (ModelError, SimulationError, StartError):
            return np.full(n_data, BROKEN), np.full(n_gap, BROKEN), slopes, gap_slopes
        count = samples.stop - samples.start
        wrong = (run.probe.values(result)[:, :count] - run.measured[:, samples]) / run.noise[:, samples]
        sensitivities = run.probe.sensitivities(result)[:, :, :count] / run.noise[None, :, samples]
        assert result.along is not None
        ends = result.along.x[:, :, -1] / nominal
        for k_inner, column in enumerate(self.problem.columns):
            if column.record in ("", run.record.name):
                position, slope = run.names.index(column.free.name), column.slope(inner[k_inner])
                slopes[:, k_inner] = sensitivities[position][counts] * slope
                gap_slopes[:, k_inner] = (ends[position] * slope)[:n_gap]
        m = len(run.names)
        if not segment.first:
            slopes[:, own_states] = (sensitivities[m:][:, counts] * nominal[:, None]).T
            gap_slopes[:, own_states] = (ends[m:] * nominal[:, None]).T[:n_gap]
        gap = np.zeros(0)
        if joined:
            following = slice(self.offsets[k + 1], self.offsets[k + 2])
            gap = result.x[:, -1] / nominal - y[following]
            gap_slopes[:, following] = -np.eye(n_gap)
        return wrong[counts], gap, slopes, gap_slopes

    def solve(self, inner: Array, progress: Progress) -> Array:
        """Parameters (inner unknowns) with closed gaps: the start of an ordinary fit."""
        from scipy.optimize import least_squares

        y = self.start(inner)
        unbounded = np.full(len(y) - self.n, np.inf)
        low, high = np.append(self.problem.low, -unbounded), np.append(self.problem.high, unbounded)
        span = np.append(self.problem.high - self.problem.low, np.ones(len(y) - self.n))
        y[: self.n] = np.clip(y[: self.n], low[: self.n] + 1e-6 * span[: self.n], high[: self.n] - 1e-6 * span[: self.n])
        for tightness in LOOSE_TO_TIGHT:
            stage = _Stage(self, tightness, progress)
            y = least_squares(stage.residuals, y, jac=stage.jacobian, bounds=(low, high), x_scale=span, max_nfev=STEPS).x
        return np.asarray(y[: self.n])


class _Stage:
    """One weight of the gaps; residuals and Jacobian come from the same runs."""

    def __init__(self, shooting: Shooting, tightness: float, progress: Progress):
        self.shooting, self.tightness, self.progress = shooting, tightness, progress
        self.at, self.found = b"", (np.zeros(0), np.zeros((0, 0)))

    def residuals(self, y: Array) -> Array:
        """Data, gaps and priors (n,)."""
        return self._both(y)[0]

    def jacobian(self, y: Array) -> Array:
        """Their derivatives (n, len(y))."""
        return self._both(y)[1]

    def _both(self, y: Array) -> tuple[Array, Array]:
        if y.tobytes() != self.at:
            data, slopes = self.shooting.residuals(y, self.tightness)
            prior, prior_slopes = self.shooting.problem.priors(y[: self.shooting.n])
            wide = np.pad(prior_slopes, ((0, 0), (0, len(y) - self.shooting.n)))
            self.at, self.found = y.tobytes(), (np.append(data, prior), np.vstack([slopes, wide]))
            self.progress(f"multiple shooting, gaps to {self.tightness:g}: sum of squares {float(data @ data):.5g}")
        return self.found
