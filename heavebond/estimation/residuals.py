"""The least squares problem of a fit: residuals of all records with exact Jacobians, priors, bounds.

See `heavebond.estimation.fitting` for the sum that is minimised.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import accumulate
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import ENDED_EARLY, clear_signal, is_interrupt
from heavebond.core.errors import ModelError, Problem, SimulationError, StartError, UsageError
from heavebond.core.progress import Progress
from heavebond.core.units import read_unit
from heavebond.estimation.comparison import TOLERANCES, assemble_for
from heavebond.estimation.experiment import Experiment, Free, Record, without_carried
from heavebond.estimation.records import Measured, measure
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.quick_simulation import FitSimulator, Unexplained
from heavebond.numerics.result import Probe
from heavebond.numerics.simulator import Simulator, Tolerances

# Residual at every sample of a failed run in standard deviations, or in ranges of the measured values if that is larger (a
# channel with a range of a thousand times its noise): worse than any useful run.
BROKEN, FAR = 1e4, 100.0
DIVERGED = 1e100  # a run with a residual or a derivative above this has failed too: sums of their squares would overflow
# A parameter within this share of its range from an end of it counts as being at the end.
AT_END = 1e-3
ROUNDED = 1e-13  # share of an end of a range by which a logarithm may miss it
# Number of runs whose results are cached: a descent begins at the end of another one, a few runs ago.
KEPT = 8
ROUNDING = 1e-9  # share by which the sum of squares of the condensed problem may differ
# reason of a descent that was ended from outside
ARRIVED, GIVEN_UP = "The search needs no more.", "The search has given it up."
# A descent is settled if the step to the minimum of its tangent is shorter than this many standard errors.
SETTLED, SHORT = "A further step would be shorter than a hundredth of the standard errors.", 0.01
# A descent on rough runs also ends (UNEVEN) if a step does not lower the sum of squares although it is shorter, by the
# tangent, than this many standard errors: the errors of the runs are then as large as what it promises.
UNEVEN, ROUGHLY = "The errors of the runs are as large as what a further step promises.", 0.3


@dataclass(frozen=True)
class Column:
    """One unknown of the least squares problem: a free parameter, possibly of one record only."""

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
        if not self.logarithmic:
            return value
        exponential = float(np.exp(value))
        # exp(log(9)) exceeds 9 slightly, and with it a bound of 9
        ends = (self.free.range.low, self.free.range.high)
        return next((end for end in ends if abs(exponential - end) <= ROUNDED * end), exponential)

    def slope(self, value: float) -> float:
        """d outer / d inner."""
        return float(np.exp(value)) if self.logarithmic else 1.0


@dataclass(frozen=True)
class Descent:
    """End of a descent: the inner unknowns x, half the sum of squares (for robust losses half of theirs), the smallest
    sum after each run, the reason of the end, and True if it would have continued."""

    x: Array
    cost: float
    history: tuple[float, ...]
    message: str
    unfinished: bool = False

    def as_dict(self) -> dict[str, Any]:
        """The argument of `from_dict`."""
        return {"x": self.x.tolist(), "cost": self.cost, "history": list(self.history), "message": self.message,
                "unfinished": self.unfinished}

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> Descent:
        """The inverse of `as_dict`; LookupError, TypeError or ValueError for other data."""
        return cls(np.array(entry["x"], float), float(entry["cost"]), tuple(entry["history"]), str(entry["message"]),
                   bool(entry["unfinished"]))


class Run:
    """One record, ready to be simulated with many values.

    measured: (channels, N) in SI at the times of the simulator, NaN if a channel was not sampled; counts: (channels, N),
    mask of fitted samples (sampled, not held out, not dropped as outliers), checking: mask of held-out samples; noise:
    (channels, N) in SI.
    """

    def __init__(self, experiment: Experiment, record: Record, names: list[str], tolerances: Tolerances = TOLERANCES, *,
                 kind: type[Simulator] = Simulator, like: Run | None = None, assembly: Assembly | None = None,
                 among: Sequence[str] = ()):
        """`kind` of simulator to use; `like` is a run of the same record with another diagram, so that the record is not
        read again. `assembly` is this diagram, if it exists; `among` as in `quick_simulation.Unexplained`."""
        self.record, self.names, self.among = record, names, among
        self.found: Measured = like.found if like is not None else measure(experiment, record)
        self.assembly: Assembly = assembly or assemble_for(experiment, record)
        texts = tuple(o.shown.text for o in experiment.outputs.values())
        self.probe = self.assembly.once(("probe", texts), lambda: Probe(self.assembly, texts, si=True))
        units = [read_unit(o.shown.unit) for o in experiment.outputs.values()]
        self.scale = np.array([u.scale for u in units])
        self.measured, self.counts, self.checking = self.found.on_grid()
        self.noise = self.found.deviations
        self.horizon = experiment.horizons.get(record.name)
        same = like is not None and like.horizon is self.horizon and len(like.found.grid) == len(self.found.grid)
        self._carried: dict[bytes, list[tuple[NDArray[np.int64], Array]]] = {}
        if like is not None and same:
            self._carried = like._carried
        self._beginnings: dict[float, Run] = {} if like is None else like._beginnings
        self.simulator: Simulator = self._simulator(kind, tolerances, None if like is None else like.simulator)

    def _simulator(self, kind: type[Simulator], tolerances: Tolerances, like: Simulator | None) -> Simulator:
        factory: Callable[..., Simulator] = kind
        if issubclass(kind, Unexplained):
            factory = partial(kind, probe=self.probe, among=self.among)
        return factory(self.assembly, times=self.found.grid, tolerances=tolerances, sensitivities=self.names, like=like)

    def again(self, names: list[str], values: Mapping[str, float], kind: type[Simulator],
              tolerances: Tolerances | None = None) -> Run:
        """The same diagram on the same record with these start values, other sensitivities, another simulator."""
        copied = copy(self)
        copied.names, copied.assembly = names, self.assembly.with_parameters(values)
        copied.simulator = copied._simulator(kind, tolerances or self.simulator.tolerances, self.simulator)
        return copied

    def beginning(self, experiment: Experiment, short: Record, values: Mapping[str, float]) -> Run:
        """The same diagram with these values on the beginning `short` of the record, by the same simulator, with
        sensitivities to all free parameters of the experiment. All runs of the record, with any diagram, read this
        beginning once."""
        assert short.end is not None
        beginning_run = Run(experiment, short, list(experiment.free), self.simulator.tolerances, kind=type(self.simulator),
                            like=self._beginnings.get(short.end), assembly=self.assembly.with_parameters(values))
        self._beginnings.setdefault(short.end, beginning_run)
        return beginning_run

    def residuals(self, values: Mapping[str, float], most: float = np.inf) -> tuple[Array, Array]:
        """(model - measured)/noise (n,) of the n fitted samples, channel after channel, and derivatives (m, n). A run of
        a search ends by `Exceeded` if the sum of squares is above `most`."""
        return self._wrong(values, self.counts, most)

    def held_out(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """The same for the validation samples: a whole record that is not fitted, or the blocks held out of a fitted one."""
        return self._wrong(values, self.counts if self.record.use != "fit" else self.checking)

    def _wrong(self, values: Mapping[str, float], samples: NDArray[np.bool_], most: float = np.inf) -> tuple[Array, Array]:
        total, horizon = 0.0, self.horizon

        def watch(begin: int, signals: Array) -> None:
            nonlocal total
            if not begin:
                total = 0.0
            at = slice(begin, begin + signals.shape[1])
            wrong = ((signals - self.measured[:, at]) / self.noise[:, at])[samples[:, at]]
            total += float(wrong @ wrong)
            if total > most:
                raise Exceeded

        if isinstance(self.simulator, Unexplained):
            signals, sensitivities = self.simulator.measured(
                values, watch if np.isfinite(most) and horizon is None else None)
        else:
            result = self.simulator.run(values)
            signals = self.probe.values(result)
            sensitivities = self.probe.sensitivities(result) if self.names else np.zeros((0, *signals.shape))
        noise = self.noise[samples]
        wrong = (signals - self.measured)[samples] / noise
        slopes = sensitivities[:, samples] / noise if self.names else np.zeros((0, len(wrong)))
        if horizon is not None:
            wrong, slopes = self.without_carried(wrong, samples), self.without_carried(slopes, samples)
            if float(wrong @ wrong) > most:
                raise Exceeded
        return wrong, slopes

    def without_carried(self, rows: Array, samples: NDArray[np.bool_]) -> Array:
        """Rows (..., n) over these samples without the errors that the machine carries from segment to segment (see
        `Horizon`); unchanged for a record without segments."""
        if self.horizon is None:
            return rows
        key = samples.tobytes()
        if key not in self._carried:
            channel, place = np.nonzero(samples)
            self._carried[key] = self.horizon.carried(channel, self.found.grid[place], self.noise[samples])
        return without_carried(self._carried[key], rows)

    def about_means(self) -> Array:
        """(mean - measured)/noise (n,) of the fitted samples, with the mean value of each channel in place of the model."""
        means = np.array([row[on].mean() if on.any() else 0.0 for row, on in zip(self.measured, self.counts, strict=True)])
        wrong = (means[:, None] - self.measured)[self.counts] / self.noise[self.counts]
        return self.without_carried(wrong, self.counts)

    @cached_property
    def broken(self) -> Array:
        """The residuals (n,) of the fitted samples for a failed run."""
        ranges = np.array([np.ptp(row[on]) if on.any() else 0.0 for row, on in zip(self.measured, self.counts, strict=True)])
        level = np.maximum(BROKEN, FAR * ranges[:, None] / self.noise)
        return np.asarray(level[self.counts])

    @property
    def input_errors(self) -> Array:
        """Realisations (M, n) of the effect of input noise on the residuals of the fitted samples; empty if no input has
        noise."""
        drawn = [c.input_errors for c in self.found.channels.values()]
        number = max((len(d) for d in drawn), default=0)
        error_samples = np.zeros((number, *self.counts.shape))
        for k, channel in enumerate(self.found.channels.values() if number else ()):
            error_samples[:, k, channel.index] = channel.input_errors * self.scale[k]
        return error_samples[:, self.counts] / self.noise[self.counts]


def columns_of(experiment: Experiment, assemblies: Mapping[str, Assembly]) -> list[Column]:
    """The unknowns of a fit of some records, given the assembly of each by its name. Separate values of a record begin at
    the value of that record."""
    first = next(iter(assemblies.values()))
    units = {q.name: q.unit.text for q in first.flat.parameters}
    return [Column(free, name, assembly.parameter_values[free.name], units[free.name])
            for free in experiment.free.values() for name, assembly in (assemblies if free.each else {"": first}).items()]


def starts_outside(columns: Sequence[Column]) -> list[Problem]:
    """A problem for each free parameter whose value in the diagram, or at its record, is outside its range."""
    outside = []
    for column in columns:
        free, value, bounds, scale = column.free, column.before, column.free.range, column.free.range.unit
        where = f"record {column.record}" if column.record else "the diagram"
        rounding = 1e-9 * (bounds.high - bounds.low)  # a value that a fit left at the end of its range is inside
        if not bounds.low - rounding <= value <= bounds.high + rounding:
            outside.append(Problem(
                "free-start-outside", f"{free.name} is {scale.from_si(value):.6g} {scale.text} in {where}, outside its "
                f"range {scale.from_si(bounds.low):.6g} .. {scale.from_si(bounds.high):.6g} {scale.text}", free.place,
                f"Widen the range, or change the value in {where}."))
    return outside


class Residuals:
    """The least squares problem of an experiment in its inner unknowns (logarithms where a range is above zero)."""

    def __init__(self, experiment: Experiment, records: list[Record] | None = None, tolerances: Tolerances = TOLERANCES,
                 runs: Sequence[Run] | None = None):
        """`runs` of all records to be fitted, with sensitivities to all free parameters, if they exist."""
        self.experiment = experiment
        chosen = records if records is not None else [r for r in experiment.records.values() if r.use == "fit"]
        if not chosen:
            raise UsageError([Problem("fit-no-record", "no record is fitted", None,
                                      "Mark at least one record with `use: fit`.")])
        names = list(experiment.free)
        self.runs = list(runs) if runs is not None else [Run(experiment, record, names, tolerances, kind=FitSimulator)
                                                         for record in chosen]
        self.columns = columns_of(experiment, {run.record.name: run.assembly for run in self.runs})
        self.low = np.array([c.inner(c.free.range.low) for c in self.columns])
        self.high = np.array([c.inner(c.free.range.high) for c in self.columns])
        # pairs of columns whose first must not be below the second (`requires: [F_s >= F_c]`, both free)
        at = {(c.free.name, c.record): k for k, c in enumerate(self.columns)}
        ordered_pairs = []
        for leaf in self.runs[0].assembly.flat.expanded.leaves.values():
            for ends in leaf.component.orders:
                higher, lower = (f"{leaf.path}.{end}" for end in ends)
                ordered_pairs += [(k, at.get((lower, record), at.get((lower, ""), -1)))
                                  for (name, record), k in at.items() if name == higher]
        self.orders = [(high, low) for high, low in ordered_pairs if low >= 0]
        for high, low in self.orders:  # the lower range ends early enough for the higher value
            most = self.columns[high].free.range.high - 2 * self._hair(high)
            if self.columns[low].free.range.low < most < self.columns[low].free.range.high:
                self.high[low] = self.columns[low].inner(most)
        self.evaluations = 0
        self._known: dict[bytes, tuple[Array, Array]] = {}
        if outside := starts_outside(self.columns):
            raise UsageError(outside)

    def _hair(self, high: int) -> float:
        """The least distance of two ordered values, because some laws divide by it."""
        bounds = self.columns[high].free.range
        return 1e-6 * (bounds.high - bounds.low)

    def allowed(self, inner: Array) -> Array:
        """The point with values raised to the minimum that the order requires."""
        inner = inner.copy()
        for high, low in self.orders:
            least = self.columns[low].outer(inner[low]) + self._hair(high)
            if self.columns[high].outer(inner[high]) < least:
                inner[high] = self.columns[high].inner(least)
        return inner

    def at_end(self, inner: Array) -> NDArray[np.bool_]:
        """Mask of the unknowns at an end of their range."""
        return np.asarray(np.minimum(inner - self.low, self.high - inner) < AT_END * (self.high - self.low))

    @property
    def samples(self) -> int:
        """How many samples are fitted."""
        return sum(int(run.counts.sum()) for run in self.runs)

    @property
    def start(self) -> Array:
        """The values of the diagram, and of each record if they are separate."""
        return np.array([c.inner(c.before) for c in self.columns])

    @property
    def given(self) -> Array:
        """The original values of the diagram, before a fit."""
        return np.array([c.inner(c.before if c.free.given is None else c.free.given) for c in self.columns])

    def starting_points(self, number: int, seed: int) -> list[Array]:
        """The diagram's values, then points of a Latin hypercube within the bounds."""
        points = [self.start]
        if number > 1:
            random, shape = np.random.default_rng(seed), (number - 1, len(self.columns))
            within = random.random(shape)  # each column uses every stratum once
            strata = np.array([random.permutation(shape[0]) for _ in self.columns]).reshape(shape[::-1]).T
            points += list(self.low + (strata + 1 - within) / shape[0] * (self.high - self.low))
        return points

    def values_of(self, inner: Array, record: str) -> dict[str, float]:
        """The parameters of one record in SI, in the order that their component requires."""
        return {c.free.name: c.outer(v) for c, v in zip(self.columns, self.allowed(inner), strict=True)
                if c.record in ("", record)}

    def evaluate(self, inner: Array, most: float = np.inf) -> tuple[Array, Array]:
        """Residuals (n,) of the data and Jacobian (n, columns) in inner unknowns, without priors. If their sum of squares
        is above `most`, they may be the residuals of a failed run."""
        key = inner.tobytes()
        if key in self._known:
            return self._known[key]
        requested, inner = inner, self.allowed(inner)
        parts, blocks, ended = [], [], False
        for run in self.runs:
            try:
                wrong, slopes = self._one(run, inner, most)
            except Exceeded:
                ended, (wrong, slopes) = True, _broken(run)
            most -= float(wrong @ wrong)
            block = np.zeros((len(wrong), len(self.columns)))
            for k, column in enumerate(self.columns):
                if column.record in ("", run.record.name):
                    block[:, k] = slopes[run.names.index(column.free.name)] * column.slope(inner[k])
            parts.append(wrong)
            blocks.append(block)
        self.evaluations += 1
        jacobian = np.vstack(blocks)
        for high, low in self.orders:
            if inner[high] != requested[high]:  # it is limited by the lower one
                ratio = self.columns[low].slope(inner[low]) / self.columns[high].slope(inner[high])
                # its column stays: the value may rise from there
                jacobian[:, low] += jacobian[:, high] * ratio
        result = np.concatenate(parts), jacobian
        if not ended:
            if len(self._known) == KEPT:
                del self._known[next(iter(self._known))]
            self._known[key] = result
        return result

    limit_passed: Problem | None = None  # the limit of the last run that ended at one

    def _one(self, run: Run, inner: Array, most: float) -> tuple[Array, Array]:
        """A record's residuals; a failed run is a large residual, not an error."""
        try:
            wrong, slopes = run.residuals(self.values_of(inner, run.record.name), most)
        except (ModelError, SimulationError, StartError) as error:
            if error.problems[0].code == "run-physical":
                self.limit_passed = error.problems[0]
            return _broken(run)
        largest = max(float(np.abs(wrong).max(initial=0.0)), float(np.abs(slopes).max(initial=0.0)))
        return (wrong, slopes) if largest < DIVERGED else _broken(run)  # false for NaN

    def broken(self, inner: Array) -> float:
        """The share of the fitted samples in records whose runs fail."""
        wrong = self.evaluate(inner)[0]
        whole = np.concatenate([run.broken for run in self.runs])
        return float(np.mean(np.abs(wrong) >= whole))

    def cost(self, inner: Array, most: float = np.inf) -> float:
        """The sum of squares of data and priors, by runs without sensitivities; infinite if it is above `most`."""
        prior, allowed = self.priors(inner)[0], self.allowed(inner)
        total = float(prior @ prior)
        try:
            for run in self._plain:
                wrong = self._one(run, allowed, most - total)[0]
                total += float(wrong @ wrong)
        except Exceeded:
            return np.inf
        return total

    @cached_property
    def _plain(self) -> list[Run]:
        """The runs without sensitivities."""
        return [run.again([], {}, FitSimulator) for run in self.runs]

    def priors(self, inner: Array) -> tuple[Array, Array]:
        """The distances of the parameters with a prior from its mean, in standard deviations, and their Jacobian."""
        rows, gradients = [], []
        for k, column in enumerate(self.columns):
            if (prior := column.free.prior) is not None:
                distance, slope = prior.at(column.outer(inner[k]))
                rows.append(distance)
                gradient = np.zeros(len(self.columns))
                gradient[k] = column.slope(inner[k]) * slope
                gradients.append(gradient)
        return np.array(rows), np.array(gradients).reshape(len(rows), len(self.columns))

    def minimise(self, start: Array, robust: bool, progress: Progress, fixed: tuple[int, ...] = (), *, most: int = 60,
                 tolerance: float = 1e-8, partial: bool = False, settle: bool = False, rough: bool = False) -> Descent:
        """Least squares from `start`; the columns in `fixed` are constant. It ends after `most` runs (twice), or if a step
        changes the sum of squares or the unknowns by less than `tolerance`; with `settle` (for squares, not robust
        losses) also if it is settled (SETTLED), and with `rough` runs, those of a search, within their errors (UNEVEN).

        First SciPy's reflective method, which avoids the ends of ranges and converges from distant starts; then, from its
        end, the dogleg method in boxes, which converges to an optimum at an end or along a narrow valley. With `partial`
        an interrupt ends it with its best result so far (ENDED_EARLY).
        """
        first = self.descend(start, robust, progress, fixed, most=most, tolerance=tolerance, method="trf", partial=partial,
                             settle=settle, rough=rough)
        if first.message == ENDED_EARLY or (first.message in (SETTLED, UNEVEN) and not self.at_end(first.x).any()):
            return first
        last = self.descend(first.x, robust, progress, fixed, most=most, tolerance=tolerance, method="dogbox",
                            partial=partial, settle=settle, rough=rough)
        best = last if last.cost <= first.cost else first
        return replace(best, history=(*first.history, *last.history), message=last.message if partial else best.message)

    def descend(self, start: Array, robust: bool, progress: Progress, fixed: tuple[int, ...] = (), *, most: int,
                tolerance: float, method: Literal["trf", "dogbox"],
                enough: Callable[[Sequence[float], Array], str] = lambda costs, best: "", partial: bool = False,
                settle: bool = False, rough: bool = False, promise: float = 0.0) -> Descent:
        """One of the two methods of `minimise`; it also ends if `enough`, which receives the sum of squares of each run
        so far and the best unknowns, returns ARRIVED or GIVEN_UP, or if the tangent predicts a relative decrease below
        `promise`."""
        from scipy.optimize import least_squares

        moving = [k for k in range(len(self.columns)) if k not in fixed]
        low, span = self.low[moving], (self.high - self.low)[moving]
        near = AT_END if method == "trf" else 0.0  # that method does not reach an end
        costs: list[float] = []
        best = np.zeros(len(moving))
        tangent = np.zeros(0), np.zeros((0, len(moving)))  # residuals and Jacobian at the best unknowns

        def whole(y: Array) -> Array:
            inner = start.copy()
            inner[moving] = low + (y - 1) * span
            return inner

        @lru_cache(maxsize=1)
        def both(y: bytes) -> tuple[Array, Array]:
            inner = whole(np.frombuffer(y))
            prior = self.priors(inner)
            # both methods reject a step that increases the sum of squares, by any amount
            most = np.inf if robust or not costs else (1 + ROUNDING) * min(costs) - float(prior[0] @ prior[0])
            data = self.evaluate(inner, most)
            residuals_and_jacobian = np.concatenate([data[0], prior[0]]), np.vstack([data[1], prior[1]])[:, moving] * span
            return residuals_and_jacobian if robust else condensed(*residuals_and_jacobian)

        def values(y: Array) -> Array:
            nonlocal best, tangent
            residuals, slopes = both(y.tobytes())
            costs.append(float(residuals @ residuals))
            best = y.copy() if costs[-1] == min(costs) else best
            progress(f"chi-square per sample {min(costs) / self.samples:.4g} after {len(costs)} runs")
            if reason := enough(costs, whole(best)):
                raise _Enough(reason)
            if (settle or promise) and costs[-1] == min(costs):
                tangent = residuals, slopes
                fall = promised(residuals, slopes, y, near)
                if settle and fall < SHORT**2 * max(1.0, costs[-1] / self.samples):
                    raise _Enough(SETTLED)
                if fall < promise * costs[-1]:
                    raise _Enough(ARRIVED)
            if settle and rough and costs[-1] > min(costs):
                fall = min(costs) - float(np.sum((tangent[0] + tangent[1] @ (y - best))**2))
                if fall < ROUGHLY**2 * max(1.0, min(costs) / self.samples):
                    raise _Enough(UNEVEN)
            return residuals

        def jacobian(y: Array) -> Array:
            return both(y.tobytes())[1]

        # the minimiser measures steps by the length of its unknowns: each is scaled to 1 .. 2 over its range, because volts
        # and pascals differ in size
        inside = np.clip(1 + (start[moving] - low) / span, 1 + 1e-6, 2 - 1e-6)
        try:
            solution = least_squares(values, inside, jac=jacobian, bounds=(1.0, 2.0), method=method,
                                                   max_nfev=most,
                                     loss="soft_l1" if robust else "linear", xtol=tolerance, ftol=tolerance, gtol=1e-8)
            ended = solution.x, float(solution.cost), str(solution.message), solution.status == 0
        except _Enough as reason:
            ended = best, min(costs) / 2, str(reason), str(reason) == GIVEN_UP
        except BaseException as error:
            if not (partial and costs and is_interrupt(error)):
                raise
            clear_signal()
            ended = best, min(costs) / 2, ENDED_EARLY, True
        return Descent(self.allowed(whole(ended[0])), ended[1], tuple(accumulate(costs, min)), *ended[2:])


def promised(residuals: Array, jacobian: Array, y: Array, near: float) -> float:
    """Predicted decrease of the sum of squares to the minimum of its tangent: (the step there in standard errors)**2
    times the variance of a residual. An unknown at an end of its range (y is 1 or 2, or `near` it) that would move
    beyond stays."""
    slope = jacobian.T @ residuals
    moving = ~(((y - 1 <= near) & (slope > 0)) | ((2 - y <= near) & (slope < 0)))
    step = np.linalg.lstsq(jacobian[:, moving], residuals, rcond=1e-12)[0]
    return float(residuals @ residuals) - float(np.sum((residuals - jacobian[:, moving] @ step)**2))


class Exceeded(Exception):
    """The sum of squares of a run exceeds its limit."""


def _broken(run: Run) -> tuple[Array, Array]:
    """Residuals and derivatives of a failed run."""
    return run.broken, np.zeros((len(run.names), len(run.broken)))


class _Enough(Exception):
    """Signal to end a descent."""


def condensed(residuals: Array, jacobian: Array) -> tuple[Array, Array]:
    """A linear least squares problem with one row more than unknowns that has the same sum of squares, gradient and normal
    matrix: with J = Q R, the residuals Q'r and the norm of the remainder of r, and R over a row of zeros. (The minimiser
    decomposes the Jacobian at every step; for thousands of rows that takes as long as a run.)

    An unknown without effect on any residual (the place of a stop that is not reached) gets a separate row, of residual
    0, that fixes it: in the direction of a singular value of 0 the minimiser would fill its trust region with rounding
    errors."""
    felt = np.any(jacobian != 0, axis=0)
    if not felt.all() and felt.any():
        projected, part = condensed(residuals, jacobian[:, felt])
        kept_columns = np.append(felt, True)  # the row of the remainder is last
        whole, over = np.zeros(len(kept_columns)), np.zeros((len(kept_columns), len(felt)))
        whole[kept_columns], over[np.ix_(kept_columns, felt)] = projected, part
        over[~kept_columns, ~felt] = np.abs(part).max()
        return whole, over
    Q, R = np.linalg.qr(jacobian)
    projected = Q.T @ residuals
    remainder = np.sqrt(max(float(residuals @ residuals - projected @ projected), 0.0))
    return np.append(projected, remainder), np.vstack([R, np.zeros((1, R.shape[1]))])
