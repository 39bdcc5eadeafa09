"""The least squares problem of a fit: residuals of all records with exact Jacobians, priors, bounds.

See `heavebond.fitting` for the sum that is minimised.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from heavebond.comparison import TOLERANCES, assemble_for, channel_noise, record_table, record_time
from heavebond.dae import Array
from heavebond.errors import Problem, SimulationError, StartError, UsageError
from heavebond.experiment import Experiment, Free, Record
from heavebond.result import Probe
from heavebond.simulation import Simulator
from heavebond.units import read_unit

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

Progress = Callable[[str], None]
# A run that breaks down counts as this many standard deviations at every sample: far worse than any run that ends.
BROKEN = 1e4


@dataclass(frozen=True)
class Column:
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


class Run:
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
        self.runs = [Run(experiment, record, names) for record in chosen]
        first = self.runs[0].assembly
        units = {q.name: q.unit.text for q in first.flat.parameters}
        self.columns: list[Column] = []
        for free in experiment.free.values():
            for record in ([r.record.name for r in self.runs] if free.each else [""]):
                self.columns.append(Column(free, record, first.parameter_values[free.name], units[free.name]))
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

    def _one(self, run: Run, inner: Array) -> tuple[Array, Array]:
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
