"""Parameters from records: weighted nonlinear least squares with exact sensitivities.

With y_i the samples of all channels of all records used for fitting, s_i their noise and f_i the model,

    minimise  sum_i ((y_i - f_i(p)) / s_i)**2 + sum_k ((p_k - p0_k) / sigma_k)**2   within the bounds,

where the second sum holds the parameters whose range is given as `value +- tolerance`: the tolerance is two standard
deviations of a normal prior, and the bounds of the range besides. A parameter whose range is above zero is sought as its
logarithm. The minimiser is SciPy's trust region reflective method (Branch, Coleman, Li 1999, doi:10.1137/S1064827595289108).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from heavebond.comparison import (
    TOLERANCES,
    Comparison,
    RecordComparison,
    assemble_for,
    channel_noise,
    compare_record,
    record_table,
    record_time,
)
from heavebond.dae import Array
from heavebond.errors import HeavebondError, Problem, SimulationError, StartError, UsageError, suggest
from heavebond.experiment import Experiment, Free, Record, load_experiment
from heavebond.identifiability import Identifiability, identifiability
from heavebond.result import Probe
from heavebond.simulation import Simulator
from heavebond.units import read_unit

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

Progress = Callable[[str], None]
# A run that breaks down counts as this many standard deviations at every sample: far worse than any run that ends.
BROKEN = 1e4
NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Fitted:
    """One parameter: its value, its 95 % interval (Gauss-Newton, cut at the range), its range; all in SI. `at_bound`
    tells whether it ended at the `low` or `high` end of its range, else it is empty."""

    name: str
    unit: str
    before: float
    value: float
    low: float
    high: float
    interval: tuple[float, float]
    at_bound: str
    record: str = ""


@dataclass(frozen=True)
class Fit:
    """What a fit found. `cost` is the sum of squares per start; `history` the cost after each step of the best start.

    `before` and `after` compare the model with every record; on a record that was not fitted only the initial values
    declared `each: record` were refitted.
    """

    experiment: Experiment
    parameters: tuple[Fitted, ...]
    correlation: Array
    identifiability: Identifiability
    chi2: float
    samples: int
    cost: tuple[float, ...]
    history: tuple[float, ...]
    evaluations: int
    message: str
    before: Comparison
    after: Comparison

    @property
    def values(self) -> dict[str, float]:
        """The fitted values that hold for all records, in SI."""
        return {p.name: p.value for p in self.parameters if not p.record}

    def as_dict(self) -> dict[str, object]:
        """Everything for machines."""
        return {
            "parameters": {p.name + (f" ({p.record})" if p.record else ""): {
                "value": p.value, "unit": p.unit, "interval": list(p.interval), "range": [p.low, p.high],
                "at_bound": p.at_bound, "before": p.before} for p in self.parameters},
            "correlation": self.correlation.tolist(), "identifiability": list(self.identifiability.words),
            "chi2_per_sample": self.chi2, "samples": self.samples, "cost_of_each_start": list(self.cost),
            "history": list(self.history), "evaluations": self.evaluations, "message": self.message,
            "before": self.before.as_dict(), "after": self.after.as_dict()}


def fit(experiment: Experiment | str | Path, *, starts: int = 1, seed: int = 0, robust: bool = False,
        free: Mapping[str, Free] | None = None, progress: Progress | None = None) -> Fit:
    """Fit the free parameters of an experiment to its records with `use: fit`.

    `starts` tries that many starting points (the diagram's own, then a Latin hypercube within the ranges); `robust`
    replaces squares by soft-L1 losses, which outliers pull less; `free` replaces the experiment's own list. Raises
    UsageError where there is nothing to fit and ModelError or DataError where the experiment is wrong.
    """
    experiment = experiment if isinstance(experiment, Experiment) else load_experiment(experiment)
    if free is not None:
        experiment = replace(experiment, free=dict(free))
    problem = Residuals(experiment)
    say = progress or (lambda text: None)
    runs, costs = [], []
    for number, start in enumerate(problem.starting_points(starts, seed), 1):
        run = problem.minimise(start, robust, _numbered(say, number, starts))
        runs.append(run)
        costs.append(float(2 * run.cost))
    best = runs[int(np.argmin(costs))]
    if 2 * best.cost / len(best.fun) >= 0.5 * BROKEN**2:
        raise SimulationError([Problem("fit-broken", "the model could not be simulated anywhere near the start of the "
                                       "fit", None, "Narrow the ranges under `free:`, or correct the diagram.")])
    say("comparing")
    return problem.finished(best, costs)


def _numbered(say: Progress, number: int, starts: int) -> Progress:
    return lambda text: say(f"start {number} of {starts}: {text}" if starts > 1 else text)


@dataclass(frozen=True)
class _Column:
    """One unknown of the least squares problem: a free parameter, perhaps of one record only."""

    free: Free
    record: str
    before: float
    unit: str

    @property
    def logarithmic(self) -> bool:
        return self.free.range.low > 0

    def inner(self, value: float) -> float:
        return float(np.log(value)) if self.logarithmic else value

    def outer(self, value: float) -> float:
        return float(np.exp(value)) if self.logarithmic else value

    def slope(self, value: float) -> float:
        """d outer / d inner."""
        return float(np.exp(value)) if self.logarithmic else 1.0


class _Run:
    """One record, ready to be simulated with many values."""

    def __init__(self, experiment: Experiment, record: Record, names: list[str]):
        self.record, self.names = record, names
        table = record_table(experiment, record)
        self.assembly = assemble_for(experiment, record)
        time = record_time(experiment, record, table)
        self.probe = Probe(self.assembly, [o.shown.text for o in experiment.outputs.values()])
        units = [read_unit(o.shown.unit) for o in experiment.outputs.values()]
        self.scale = np.array([u.scale for u in units])
        measured = np.array([table.columns[o.column] * u.scale + u.offset
                             for u, o in zip(units, experiment.outputs.values(), strict=True)])
        noise = np.array([channel_noise(o, table, time)[0] for o in experiment.outputs.values()]) * self.scale
        self.measured, self.noise = measured, noise
        self.simulator = Simulator(self.assembly, times=time, tolerances=TOLERANCES, sensitivities=names)

    def residuals(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """(model - measured)/noise (channels * N,) and its derivatives (m, channels * N)."""
        result = self.simulator.run(values)
        wrong = (self.probe.values(result) - self.measured) / self.noise[:, None]
        moved = self.probe.sensitivities(result) / self.noise[None, :, None]
        return wrong.ravel(), moved.reshape(len(self.names), -1)


class Residuals:
    """The least squares problem of an experiment in its inner unknowns (logarithms where a range is above zero)."""

    def __init__(self, experiment: Experiment, records: list[Record] | None = None):
        self.experiment = experiment
        if not experiment.free:
            raise UsageError([Problem("free-empty", "nothing is free to be fitted", None,
                                      "List parameters and ranges: `free: {gas.c: 42 kN/m +- 20 %}`.")])
        chosen = records if records is not None else [r for r in experiment.records.values() if r.use == "fit"]
        if not chosen:
            raise UsageError([Problem("fit-no-record", "no record is to be fitted", None,
                                      "Mark at least one record with `use: fit`.")])
        names = list(experiment.free)
        self.runs = [_Run(experiment, record, names) for record in chosen]
        first = self.runs[0].assembly
        units = {q.name: q.unit.text for q in first.flat.parameters}
        self.columns: list[_Column] = []
        for free in experiment.free.values():
            for record in ([r.record.name for r in self.runs] if free.each else [""]):
                self.columns.append(_Column(free, record, first.parameter_values[free.name], units[free.name]))
        self.low = np.array([c.inner(c.free.range.low) for c in self.columns])
        self.high = np.array([c.inner(c.free.range.high) for c in self.columns])
        self.evaluations = 0
        self._last: tuple[bytes, Array, Array] | None = None
        self._check_start()

    def _check_start(self) -> None:
        for column in self.columns:
            bounds = column.free.range
            if not bounds.low <= column.before <= bounds.high:
                scale = bounds.unit
                raise UsageError([Problem(
                    "free-start-outside", f"{column.free.name} is {scale.from_si(column.before):.6g} {scale.text} in the "
                    f"diagram, outside its range {scale.from_si(bounds.low):.6g} .. {scale.from_si(bounds.high):.6g} "
                    f"{scale.text}", column.free.place, "Widen the range, or change the value in the diagram.")])

    @property
    def start(self) -> Array:
        """The values of the diagram."""
        return np.array([c.inner(c.before) for c in self.columns])

    def starting_points(self, number: int, seed: int) -> list[Array]:
        """The diagram's values, then points of a Latin hypercube within the bounds."""
        from scipy.stats import qmc

        points = [self.start]
        if number > 1:
            cube = qmc.LatinHypercube(len(self.columns), seed=seed).random(number - 1)
            points += list(self.low + cube * (self.high - self.low))
        return points

    def values_of(self, inner: Array, record: str) -> dict[str, float]:
        """The parameters of one record in SI."""
        return {c.free.name: c.outer(v) for c, v in zip(self.columns, inner, strict=True) if c.record in ("", record)}

    def evaluate(self, inner: Array) -> tuple[Array, Array]:
        """Residuals (n,) of the data and Jacobian (n, columns) in inner unknowns, without priors."""
        key = inner.tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1], self._last[2]
        parts, blocks = [], []
        for run in self.runs:
            wrong, moved = self._one(run, inner)
            block = np.zeros((len(wrong), len(self.columns)))
            for k, column in enumerate(self.columns):
                if column.record in ("", run.record.name):
                    block[:, k] = moved[run.names.index(column.free.name)] * column.slope(inner[k])
            parts.append(wrong)
            blocks.append(block)
        self.evaluations += 1
        self._last = (key, np.concatenate(parts), np.vstack(blocks))
        return self._last[1], self._last[2]

    def _one(self, run: _Run, inner: Array) -> tuple[Array, Array]:
        """A record's residuals; a run that breaks down is a large residual, not an end."""
        size = run.measured.size
        try:
            wrong, moved = run.residuals(self.values_of(inner, run.record.name))
        except (SimulationError, StartError):
            return np.full(size, BROKEN), np.zeros((len(run.names), size))
        if not (np.all(np.isfinite(wrong)) and np.all(np.isfinite(moved))):
            return np.full(size, BROKEN), np.zeros((len(run.names), size))
        return wrong, moved

    def priors(self, inner: Array) -> tuple[Array, Array]:
        """(p - p0)/sigma of the parameters given as `value +- tolerance`, and its Jacobian."""
        rows, gradients = [], []
        for k, column in enumerate(self.columns):
            nominal = column.free.range.nominal
            if nominal is not None:
                sigma = (column.free.range.high - nominal) / 2
                rows.append((column.outer(inner[k]) - nominal) / sigma)
                gradient = np.zeros(len(self.columns))
                gradient[k] = column.slope(inner[k]) / sigma
                gradients.append(gradient)
        return np.array(rows), np.array(gradients).reshape(len(rows), len(self.columns))

    def minimise(self, start: Array, robust: bool, progress: Progress, fixed: tuple[int, ...] = ()) -> OptimizeResult:
        """Trust region least squares from `start`; the columns in `fixed` stay where they are."""
        from scipy.optimize import least_squares

        moving = [k for k in range(len(self.columns)) if k not in fixed]
        span = self.high - self.low
        history: list[float] = []

        def whole(y: Array) -> Array:
            inner = start.copy()
            inner[moving] = y
            return inner

        def values(y: Array) -> Array:
            inner = whole(y)
            residuals = np.concatenate([self.evaluate(inner)[0], self.priors(inner)[0]])
            history.append(min([float(residuals @ residuals), *history[-1:]]))
            samples = len(residuals)
            progress(f"chi-square per sample {history[-1] / samples:.4g} after {len(history)} runs")
            return residuals

        def jacobian(y: Array) -> Array:
            inner = whole(y)
            return np.vstack([self.evaluate(inner)[1], self.priors(inner)[1]])[:, moving]

        inside = np.clip(start, self.low + 1e-6 * span, self.high - 1e-6 * span)[moving]
        found = least_squares(values, inside, jac=jacobian, bounds=(self.low[moving], self.high[moving]),
                              x_scale=span[moving], loss="soft_l1" if robust else "linear", xtol=1e-8, ftol=1e-8,
                              gtol=1e-8, max_nfev=60)
        found.x = whole(found.x)
        found["history"] = history
        return found

    def finished(self, best: OptimizeResult, costs: list[float]) -> Fit:
        """The fit with its intervals, correlations, verdict on identifiability and comparisons."""
        residuals, jacobian = self.evaluate(best.x)
        _, prior_jacobian = self.priors(best.x)
        chi2 = float(residuals @ residuals) / len(residuals)
        # a model that misses the data by more than the noise is no surer of its parameters than its misfit allows
        inflation = max(1.0, chi2)
        information = jacobian.T @ jacobian / inflation + prior_jacobian.T @ prior_jacobian
        covariance = np.linalg.pinv(information, rcond=1e-14, hermitian=True)
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0))
        correlation = covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
        parameters = tuple(self._fitted(c, x, d) for c, x, d in zip(self.columns, best.x, deviation, strict=True))
        labels = [c.free.name + (f" ({c.record})" if c.record else "") for c in self.columns]
        spans = [c.free.range.high - c.free.range.low for c in self.columns]
        relative = jacobian * np.array([1.0 if c.logarithmic else s for c, s in zip(self.columns, spans, strict=True)])
        verdict = identifiability(relative / np.sqrt(inflation), labels, [c.logarithmic for c in self.columns])
        return Fit(self.experiment, parameters, correlation, verdict, chi2, len(residuals), tuple(costs),
                   tuple(best["history"]), self.evaluations, str(best.message), self._compared(self.start),
                   self._compared(best.x))

    def _fitted(self, column: _Column, inner: float, deviation: float) -> Fitted:
        bounds = column.free.range
        value = column.outer(float(inner))
        near = 1e-3 * (bounds.high - bounds.low)
        at = "low" if value - bounds.low < near else "high" if bounds.high - value < near else ""
        half = NORMAL_95 * float(deviation)
        ends = [self._within(column, inner + sign * half) for sign in (-1, 1)]
        return Fitted(column.free.name, column.unit, column.before, value, bounds.low, bounds.high,
                      (ends[0], ends[1]), at, column.record)

    @staticmethod
    def _within(column: _Column, inner: float) -> float:
        """The value, or the end of its range: beyond it nothing was asked of the data."""
        bounds = column.free.range
        low, high = column.inner(bounds.low), column.inner(bounds.high)
        return column.outer(float(np.clip(inner, low, high)))

    def _compared(self, inner: Array) -> Comparison:
        """Every record with the fitted values; on the others, initial values of their own are refitted first."""
        records: dict[str, RecordComparison] = {}
        fitted = {run.record.name for run in self.runs}
        own = {n: f for n, f in self.experiment.free.items() if f.each}
        for record in self.experiment.records.values():
            values = self.values_of(inner, record.name)
            if record.name not in fitted and own:
                values = {**values, **_own_start(self.experiment, record, own, values)}
            records[record.name] = compare_record(self.experiment, record, values)
        return Comparison(self.experiment, records)


def _own_start(experiment: Experiment, record: Record, own: dict[str, Free], values: dict[str, float]
               ) -> dict[str, float]:
    """Initial values of a held-out record, from the first tenth of its samples, all other values given."""
    table = record_table(experiment, record)
    time = record_time(experiment, record, table)
    short = replace(record, end=float(time[max(10, len(time) // 10)]))
    pinned = experiment.model.with_parameters({k: v for k, v in values.items() if not k.startswith("initial.")})
    problem = Residuals(replace(experiment, model=pinned, free=own), [short])
    try:
        found = problem.minimise(problem.start, False, lambda text: None)
    except HeavebondError:
        return {}
    return problem.values_of(found.x, record.name)


def profile(result: Fit, name: str, *, progress: Progress | None = None) -> tuple[float, float]:
    """The 95 % interval of one parameter by profile likelihood: the values at which the sum of squares, minimised over
    all other parameters, has risen by 3.84 chi-square per sample (an end that is not reached is the range's end).

    A. Raue et al. (2009), doi:10.1093/bioinformatics/btp358. UsageError for a name that was not fitted.
    """
    from scipy.optimize import brentq

    names = [p.name for p in result.parameters]
    if name not in names:
        raise UsageError([Problem("free-unknown", f"'{name}' was not fitted", None, suggest(name, names))])
    problem = Residuals(result.experiment)
    k = names.index(name)
    best = np.array([c.inner(p.value) for c, p in zip(problem.columns, result.parameters, strict=True)])
    limit = 3.841458820694124 * max(1.0, result.chi2)
    bottom = 2 * problem.minimise(best, False, lambda text: None, (k,)).cost

    def risen(value: float) -> float:
        start = best.copy()
        start[k] = value
        if progress:
            progress(f"{name} at {problem.columns[k].outer(value):.5g}")
        return float(2 * problem.minimise(start, False, lambda text: None, (k,)).cost - bottom - limit)

    ends = []
    for end in (problem.low[k], problem.high[k]):
        # the Gauss-Newton interval tells where to look first
        near = problem.columns[k].inner(result.parameters[k].interval[0 if end < best[k] else 1])
        far = float(np.clip(best[k] + 2 * (near - best[k]), problem.low[k], problem.high[k]))
        far = far if risen(far) > 0 else float(end)
        ends.append(problem.columns[k].outer(float(brentq(risen, best[k], far, xtol=1e-3 * abs(far - best[k])))
                                             if risen(far) > 0 else float(end)))
    return ends[0], ends[1]
