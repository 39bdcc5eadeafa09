"""Parameter estimation from records: weighted nonlinear least squares with exact sensitivities.

With y_i the samples of all channels of all fitted records (except for blocks held out, see `estimation.records`), s_i their
noise and f_i the model,

    minimise  sum_i ((y_i - f_i(p)) / s_i)**2 + sum_k ((p_k - p0_k) / sigma_k)**2   within the bounds,

where the second sum is over the parameters with a range `value +- tolerance`: the tolerance is two standard deviations of
a normal prior, and also the bounds. A parameter with a positive range is replaced by its logarithm. Two methods of SciPy
are used in sequence: a reflective trust region, which converges from distant starts (M. A. Branch, T. F. Coleman, Y. Li,
1999, doi:10.1137/S1064827595289108), then a dogleg in rectangular trust regions, which converges to optima at the ends of
ranges (C. Voglis, I. E. Lagaris, WSEAS 2004).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from heavebond.core import facade
from heavebond.core.cancellation import ENDED_EARLY, finishing, time_limit
from heavebond.core.cluster import Cluster
from heavebond.core.errors import (
    HeavebondError,
    ModelError,
    Place,
    Problem,
    SimulationError,
    StartError,
    UsageError,
    listing,
    suggest,
)
from heavebond.core.kept_lines import KeptLines
from heavebond.core.presentation import brief
from heavebond.core.progress import Progress
from heavebond.core.quantities import si_range, si_value
from heavebond.core.reporting import reporting
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.comparison import Comparison, RecordComparison, compare_record
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, Free, Record, load_experiment
from heavebond.estimation.records import measure
from heavebond.estimation.residuals import AT_END, Column, Descent, Exceeded, Residuals, Run
from heavebond.estimation.starts import Starts
from heavebond.language.edits import Change, block, extended_from
from heavebond.language.model import Model
from heavebond.numerics.dae import Array
from heavebond.numerics.kinks import jump_notes
from heavebond.numerics.quick_simulation import FitSimulator
from heavebond.numerics.run_verdict import report_verdict as hear
from heavebond.numerics.simulation import unfilled

NORMAL_95 = 1.959963984540054
OWN_STARTS = 6  # number of points, from the best of which the separate values of a held-out record are estimated
# Samples that suffice if these values only determine the start of the record: later ones contain less information, and take
# as long to run.
BEGINNING = 1000
# Points of the grid for an instant, the share of its range at which the search ends, and the chi-square (two standard
# deviations) by which an end of the range may be worse.
INSTANTS, INSTANT, INSTANT_UNSEEN = 25, 1e-4, 4.0


@dataclass(frozen=True)
class Fitted:
    """One parameter: its value, its 95 % interval (Gauss-Newton, limited to the range), its range; all in SI. `at_bound`
    is `low` or `high` if it ended at this end of its range, else empty. `unreached` gives the extent of the fitted
    records for a limit (an end stop, a saturation) that they do not reach: it lies beyond, and no more is known."""

    name: str
    unit: str
    before: float
    value: float
    low: float
    high: float
    interval: tuple[float, float]
    at_bound: str
    record: str = ""
    unreached: float | None = None

    @property
    def told(self) -> tuple[float | None, float | None]:
        """The ends of the interval that the records determine: None for an end that is given by the range only, and for
        both if the value itself is at an end of its range."""
        if self.unreached is not None:
            return (self.unreached, None) if self.value >= self.unreached else (None, self.unreached)
        near = 1e-9 * (self.high - self.low)
        low, high = self.interval
        return (None, None) if self.at_bound else (low if low - self.low > near else None,
                                                   high if self.high - high > near else None)

    @property
    def ended(self) -> str:
        """The end of its range that the fit reached; empty for a limit that the records do not reach."""
        return self.at_bound if self.unreached is None else ""

    def known(self, written: Callable[[float], str], unit: str = "", dots: str = "..") -> str:
        """Text of the interval: `1 .. 2 m`, `above 1 m`, `not seen`; `-` at an end of the range. `written` formats a
        value in SI."""
        low, high = (None if end is None else written(end) for end in self.told)
        interval_text = f"{low} {dots} {high}{unit}" if low is not None and high is not None else \
            f"above {low}{unit}" if low is not None else f"below {high}{unit}" if high is not None else \
            "-" if self.at_bound else "not identifiable"
        return interval_text if self.unreached is None else f"{interval_text}, not reached"

    def as_dict(self) -> dict[str, object]:
        """The figures, for machines."""
        return {"value": self.value, "unit": self.unit, "interval": list(self.told), "range": [self.low, self.high],
                "at_bound": self.ended, "unreached": self.unreached is not None}

    @property
    def digits(self) -> int:
        """Digits that distinguish the ends of the interval."""
        width = abs(self.interval[1] - self.interval[0])
        return 5 if width == 0 or self.value == 0 else min(9, max(4, math.ceil(math.log10(abs(self.value) / width)) + 2))


@dataclass(frozen=True)
class OwnValues:
    """Separate values of a held-out record (`each: record`), in SI, fitted to its first `seconds` with all other values
    given; empty if the model could not be simulated there, so that the values of the diagram hold. `instants` are the
    names that were fitted to the whole record."""

    values: Mapping[str, float]
    seconds: float
    instants: tuple[str, ...] = ()


@dataclass(frozen=True)
class Fit(facade.Displayed):
    """An estimate of parameters: values and intervals in SI, with the comparisons before and after.

    `correlation` is (m, m) for m parameters; `chi2` is the reduced chi-square of the fitted samples (1 = noise level);
    `cost` is the sum of squares per start, `history` the cost after each step of the best start. `before` and `after`
    compare the model with every record; on a record that was not fitted only the values declared `each: record` were
    fitted, to its beginning: `held_out` has them by record, in SI. If there is no validation record, each has the
    held-out blocks as its `validate` part.
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
    held_out: Mapping[str, OwnValues] = field(default_factory=dict)

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, f"chi-square {self.chi2:.4g} per sample, {self.message}",
                     listing([f"{p.name} = {p.value:.5g} {p.unit}" for p in self.parameters], 12))


    @property
    def values(self) -> dict[str, float]:
        """Estimated parameters that are common to all records, by name, in SI."""
        return {p.name: p.value for p in self.parameters if not p.record}

    @property
    def record_values(self) -> dict[str, dict[str, float]]:
        """Estimated values that are separate for each record, by the names of record and parameter, in SI."""
        values_by_record: dict[str, dict[str, float]] = {name: dict(held_out_values.values)
                                                         for name, held_out_values in self.held_out.items()}
        for p in self.parameters:
            if p.record:
                values_by_record.setdefault(p.record, {})[p.name] = p.value
        return values_by_record

    def as_dict(self) -> dict[str, object]:
        """Parameters (each with its unit and interval), correlations and errors as a dictionary of plain values."""
        return {
            "parameters": {p.name + (f" ({p.record})" if p.record else ""): {**p.as_dict(), "before": p.before}
                           for p in self.parameters},
            "held_out": {name: {"values": dict(held_out_values.values), "seconds": held_out_values.seconds}
                         for name, held_out_values in self.held_out.items()},
            "correlation": self.correlation.tolist(), "identifiability": list(self.identifiability.words),
            "chi2_per_sample": self.chi2, "samples": self.samples, "cost_of_each_start": list(self.cost),
            "history": list(self.history), "evaluations": self.evaluations, "message": self.message,
            "before": self.before.as_dict(), "after": self.after.as_dict()}


@reporting
def fit(experiment: ExperimentOrFile, *, starts: int = 1, segments: int = 1, seed: int = 0, robust: bool = False,
        free: Mapping[str, Free | str] | None = None, executor: Cluster | None = None, kept: KeptLines | None = None,
        progress: Progress | None = None, partial: bool = False, seconds: float | str = math.inf,
        before: Comparison | None = None) -> Fit:
    """Estimate the free parameters of an experiment from its records with `use: fit`.

    Minimises sum ((y - f(p)) / s)**2 + sum ((p - p0) / sigma)**2 within the ranges, with exact sensitivities; see the module
    for both sums. Values of the result are in SI. `starts` is the number of starting points (the diagram's values, then a
    Latin hypercube drawn with `seed`); `segments` above 1 begins with multiple shooting, for records on which one run
    diverges; `robust` replaces squares by soft-L1 losses; `free` replaces the list of the experiment by ranges, also as text
    (`{"gas.c": "30 .. 70 kN/m"}`). With an `executor` the starts run on the workers of that cluster; `kept` stores descents
    of an earlier call. `progress` is called with a text at each step. With `partial` Ctrl-C returns the best result so far
    (`message` is "interrupted"), after the first run (on a cluster, the first start); so does the end of `seconds` (s, or
    text with a unit), after which the result is still completed. `before` is the comparison with the values of the diagram,
    if it is known.

    Raises UsageError if nothing is free, a name is unknown or a range has the wrong unit, ModelError or DataError for a
    wrong experiment, and SimulationError if the model cannot be simulated near the start.
    """
    experiment = with_noise(load_experiment(experiment))
    if free is not None:
        experiment = replace(experiment, free={name: _free(name, range_given) for name, range_given in free.items()})
    if not experiment.free:
        raise UsageError([Problem("free-empty", "nothing is free to be fitted", None,
                                  "List parameters and ranges: `free: {gas.c: 42 kN/m +- 20 %}`.")])
    problem = Residuals(experiment)
    say = progress or (lambda text: None)
    with time_limit(si_value(seconds, "s", "seconds")):
        points = problem.starting_points(starts, seed)
        begun = Starts(points, segments, robust, partial)
        runs = begun.descents(problem, say, executor, kept)
        if not robust and runs[-1].message != ENDED_EARLY:
            runs = begun.lower(problem, runs, seed, say)
    costs = [2 * run.cost for run in runs]
    best = runs[int(np.argmin(costs))]
    if problem.broken(best.x) >= 0.5:
        limit = problem.limit_passed
        raise SimulationError([Problem("fit-broken",
                                       "the model could not be simulated anywhere near the start of the "
                                       "fit", None,
                                       f"{_filled_by_compare(problem)}"
                                       f"`heavebond compare {experiment.path.name}` shows where it stops. What "
                                       "adds up its input (a cylinder without a spring behind a valve) runs away from a "
                                       "record of that input: measure the reference and put the controller into the "
                                       "diagram, or the end stops. Else narrow the ranges under `free:`, or correct it.",
                                       () if limit is None else (f"in a trial {limit.message}: {limit.hint}",))])
    say("comparing")
    with finishing(say):
        fit_result = _finished(problem, replace(best, message=runs[-1].message), costs, before)
    for record in fit_result.after.records.values():
        hear(f"{experiment.name}, {record.name}", record.result.verdict)
    return fit_result


def evaluated(experiment: Experiment, before: Comparison | None = None) -> Fit:
    """The free parameters at the values of the diagram, with intervals and comparisons as after a fit, but without a step
    of one. Raises SimulationError if the model cannot be simulated there."""
    problem = Residuals(experiment)
    residuals = problem.evaluate(problem.start)[0]
    cost = float(residuals @ residuals)
    return _finished(problem, Descent(problem.start, cost / 2, (cost,), ENDED_EARLY), [cost], before)


def _free(name: str, span: Free | str) -> Free:
    return span if isinstance(span, Free) else Free(name, si_range(span, name), Place("free", 1, 1, f"{name}: {span}"))


def _filled_by_compare(problem: Residuals) -> str:
    """Advice if a plain run succeeds only with filled nodes, which a run with sensitivities does not add."""
    nodes = unfilled(problem.runs[0].assembly)
    if not nodes:
        return ""
    domains = problem.experiment.model.library.domains
    parts = {f"{fills[0]} on {node}" for node, domain in nodes.items() if (fills := domains[domain].fills) is not None}
    return "`run` and `compare` fill nodes that store nothing with a short bore of oil or gas, `fit` does not: add " \
        f"{listing(sorted(parts), 4)}, of the size of the real line. "


def _finished(problem: Residuals, best: Descent, costs: list[float], before: Comparison | None = None) -> Fit:
    """The fit with its intervals, correlations, verdict on identifiability and comparisons."""
    residuals, jacobian = problem.evaluate(best.x)
    _, prior_jacobian = problem.priors(best.x)
    chi2 = float(residuals @ residuals) / len(residuals)
    # a model whose misfit exceeds the noise determines its parameters only within its misfit
    inflation = max(1.0, chi2)
    information = jacobian.T @ jacobian / inflation + prior_jacobian.T @ prior_jacobian
    # in units of each unknown's uncertainty: SI values differ by twenty orders, which a cut-off would treat as rank
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    covariance = np.linalg.pinv(information / size[:, None] / size, rcond=1e-14, hermitian=True) / size[:, None] / size
    # a parameter without effect has no row in the pseudo-inverse: it is unknown rather than exactly known
    deviation = np.where(np.diag(information) > 0, np.sqrt(np.maximum(np.diag(covariance), 0)), np.inf)
    correlation = covariance / np.maximum(np.outer(deviation, deviation), 1e-300)
    parameters = tuple(_fitted(c, x, d) for c, x, d in zip(problem.columns, best.x, deviation, strict=True))
    labels = [c.free.name + (f" ({c.record})" if c.record else "") for c in problem.columns]
    spans = [c.free.range.high - c.free.range.low for c in problem.columns]
    relative = jacobian * np.array([1.0 if c.logarithmic else s for c, s in zip(problem.columns, spans, strict=True)])
    verdict = identifiability(relative / np.sqrt(inflation), labels, [c.logarithmic for c in problem.columns])
    if before is None or any(free.each for free in problem.experiment.free.values()):
        before = _compared(problem, problem.start)[0]
    after, held_out_values = _compared(problem, best.x)
    return Fit(problem.experiment, parameters, correlation, verdict, chi2, len(residuals), tuple(costs),
               best.history, problem.evaluations, best.message, before, after, held_out_values)


def _fitted(column: Column, inner: float, deviation: float) -> Fitted:
    bounds = column.free.range
    value = column.outer(float(inner))
    low, high = column.inner(bounds.low), column.inner(bounds.high)  # in logarithms if it is sought over decades
    half = NORMAL_95 * float(deviation)
    # a range may span many decades of a parameter that is sought linearly: a value well above its end is not at its end
    near = min(AT_END * (high - low), half)
    at = "low" if inner - low <= near else "high" if high - inner <= near else ""
    ends = [column.outer(float(np.clip(inner + sign * half, low, high))) for sign in (-1, 1)]  # inside the range
    return Fitted(column.free.name, column.unit, column.before, value, bounds.low, bounds.high,
                  (ends[0], ends[1]), at, column.record)


def _compared(problem: Residuals, inner: Array) -> tuple[Comparison, dict[str, OwnValues]]:
    """Compare every record with the fitted values; on records that were not fitted, separate values are fitted first."""
    records: dict[str, RecordComparison] = {}
    held_out_values: dict[str, OwnValues] = {}
    has_own = any(free.each for free in problem.experiment.free.values())
    fitted = {run.record.name for run in problem.runs}
    for record in problem.experiment.records.values():
        values = problem.values_of(inner, record.name)
        if record.name not in fitted and has_own:
            held_out_values[record.name] = own_values(problem.experiment, record, values)
            values = {**values, **held_out_values[record.name].values}
        compared = compare_record(problem.experiment, record, values)
        notes = jump_notes(compared.result, "fit") if record.name in fitted else []
        records[record.name] = replace(compared, notes=(*compared.notes, *notes))
    return Comparison(problem.experiment, records), held_out_values


def own_start(experiment: Experiment, record: Record, values: Mapping[str, float], like: Run | None = None
              ) -> dict[str, float]:
    """Separate values of a held-out record (`each: record`); see `own_values`."""
    separate = any(f.each for f in experiment.free.values())
    return dict(own_values(experiment, record, values, like).values) if separate else {}


def own_values(experiment: Experiment, record: Record, values: Mapping[str, float], like: Run | None = None) -> OwnValues:
    """Separate values of a held-out record, from its first tenth (from ten samples of each channel if that is longer),
    with all other values given; for initial values alone, from a thousand samples at most. `like` is an existing run
    of this record with this diagram, which avoids reading and assembling them again. Times at which something begins
    are not visible in the beginning of a record: they are sought on the whole record."""
    separate_free = {n: f for n, f in experiment.free.items() if f.each}
    if instants := [name for name in separate_free if is_instant(experiment.model, name)]:
        return _with_instants(experiment, record, values, instants, like)
    measured = like.found if like is not None else measure(experiment, record)
    tenth = len(measured.grid) // 10
    last = min(tenth, BEGINNING) if all(n.startswith("initial.") for n in separate_free) else tenth
    ends = [measured.grid[last], *(c.time[:11][-1] for c in measured.channels.values())]
    short = replace(record, end=float(max(ends)))
    pinned = {k: v for k, v in values.items() if not k.startswith("initial.")}
    try:
        if like is None:
            problem = Residuals(replace(experiment, model=experiment.model.with_parameters(pinned), free=separate_free),
                                [short])
        else:
            run = like.beginning(replace(experiment, free=separate_free), short, pinned)
            problem = Residuals(replace(experiment, free=separate_free), runs=[run])
        # the diagram may contain the start of another record, from which friction may keep a search in another local minimum
        start, least = problem.start, np.inf
        for point in problem.starting_points(OWN_STARTS, 0):
            if (cost := problem.cost(point, least)) < least:
                start, least = point, cost
        best = problem.minimise(start, False, lambda text: None, tolerance=1e-6, settle=True)
    except HeavebondError:
        return OwnValues({}, max(ends) - measured.grid[0])
    return OwnValues(problem.values_of(best.x, record.name), max(ends) - measured.grid[0])


def is_instant(model: Model, name: str) -> bool:
    """True if a parameter of the diagram is a time at which something begins (`instant`)."""
    owner, _, key = name.rpartition(".")
    instance = model.body.instances.get(owner)
    parameter = model.library.component(instance.kind).parameters.get(key) if instance is not None else None
    return parameter is not None and parameter.instant


def _with_instants(experiment: Experiment, record: Record, values: Mapping[str, float], instants: Sequence[str],
                   like: Run | None) -> OwnValues:
    """Separate values of a held-out record that include times at which something begins. These are sought one after the
    other on the whole record: on a grid between the ends of their ranges, then around the best. At an end something
    acts in the whole record, or not at all."""
    without_instants = replace(experiment, free={n: f for n, f in experiment.free.items() if f.each and n not in instants})
    pinned = {k: v for k, v in values.items() if not k.startswith("initial.")}
    separate_values, seconds = dict[str, float](), 0.0
    try:
        whole = like.again([], pinned, type(like.simulator)) if like is not None else Run(
            replace(experiment, model=experiment.model.with_parameters(pinned)), record, [], kind=FitSimulator)
        separate_values = {name: whole.assembly.parameter_values[name] for name in instants}
        rounds = 2 if without_instants.free or len(instants) > 1 else 1
        for _ in range(rounds):
            if without_instants.free:
                fitted = own_values(without_instants, record, {**values, **separate_values}, like)
                separate_values |= fitted.values
                seconds = fitted.seconds
            for name in instants:
                span = experiment.free[name].range
                separate_values[name] = _best_instant(whole, {**values, **separate_values}, name, span.low, span.high)
    except HeavebondError:
        return OwnValues({}, seconds)
    return OwnValues(separate_values, seconds, tuple(instants))


def _best_instant(run: Run, values: Mapping[str, float], name: str, low: float, high: float) -> float:
    """The time between `low` and `high` (s) with the least sum of squares on a record; an end of the range if it is not
    significantly worse."""
    from scipy.optimize import minimize_scalar

    costs = dict[float, float]()

    def cost(time: float, most: float = np.inf) -> float:
        if time not in costs:
            try:
                r = run.residuals({**values, name: time}, most)[0]
                costs[time] = float(r @ r)
            except (ModelError, SimulationError, StartError, Exceeded):
                return np.inf
        return costs[time]

    grid = np.linspace(low, high, INSTANTS)
    for time in (values[name], *grid[[0, -1]], *grid[1:-1]):  # a run ends if its sum of squares exceeds the best
        cost(float(np.clip(time, low, high)), min(costs.values(), default=np.inf))
    if not costs:
        return values[name]
    best = min(costs, key=lambda time: costs[time])
    step = float(grid[1] - grid[0])
    ends = max(low, best - step), min(high, best + step)
    with np.errstate(invalid="ignore"):  # of infinite costs: the minimiser then halves its interval
        minimize_scalar(cost, bounds=ends, method="bounded", options={"xatol": INSTANT * (high - low)})
    best = min(costs, key=lambda time: costs[time])
    near = costs[best] + INSTANT_UNSEEN * max(1.0, costs[best] / max(1, int(run.counts.sum())))
    return float(next((end for end in (low, high) if cost(end, near) <= near), best))


def profile(result: Fit, name: str, *, progress: Progress | None = None) -> tuple[float, float]:
    """The 95 % interval of one parameter by profile likelihood: the values at which the sum of squares, minimised over all
    other parameters, has risen by 3.84 chi-square per sample (an end that is not reached is the range's end).

    A. Raue et al. (2009), doi:10.1093/bioinformatics/btp358. UsageError for a name that was not fitted.
    """
    from scipy.optimize import brentq

    names = [p.name for p in result.parameters]
    if name not in names:
        raise UsageError([Problem("free-unknown", f"'{name}' was not fitted", None,
                                  suggest(name, names) or f"Fitted were: {listing(names)}.")])
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
        return 2 * problem.minimise(start, False, lambda text: None, (k,)).cost - bottom - limit

    ends = []
    for end in (problem.low[k], problem.high[k]):
        # the search begins at the Gauss-Newton interval
        near = problem.columns[k].inner(result.parameters[k].interval[0 if end < best[k] else 1])
        far = float(np.clip(best[k] + 2 * (near - best[k]), problem.low[k], problem.high[k]))
        far = far if risen(far) > 0 else float(end)
        ends.append(problem.columns[k].outer(float(brentq(risen, best[k], far, xtol=1e-3 * abs(far - best[k])))
                                             if risen(far) > 0 else float(end)))
    return ends[0], ends[1]


# -- files -----------------------------------------------------------------------------------------------------------
def fitted_diagram(fit: Fit, path: Path) -> str:
    """The text of a diagram at `path` that extends the fitted one and sets the values that were fitted for all records."""
    experiment = fit.experiment
    records = [r.name for r in experiment.records.values() if r.use == "fit"]
    change, notes = fitted_values(fit)
    head = [f"model: {path.stem}",
            f"summary: {experiment.model.name} with parameters fitted to {', '.join(records)}.",
            f"extends: {extended_from(path, experiment.model.path)}"]
    return "\n".join([*head, *block("set", change.settings, notes), *block("initial", change.initial, notes)]) + "\n"


def fitted_values(fit: Fit) -> tuple[Change, dict[str, str]]:
    """The values that were fitted for all records, as a change of the diagram, and the interval of each as a note."""
    values, notes = {}, {}
    for p in fit.parameters:
        if not p.record:
            unit = fit.experiment.free[p.name].range.unit
            values[p.name] = unit.written(p.value)
            notes[p.name.removeprefix("initial.")] = f"at the {p.at_bound} end of its range" if p.at_bound else \
                p.known(unit.written)
    return Change().with_values(values), notes


@dataclass(frozen=True)
class IdentifiabilityConstants:
    """The constants of the report on identifiability.

    max_deviation: standard deviation, of a logarithm or over the range, above which a combination of parameters is not
    identifiable. Origin: 30 %. Doubled: fewer combinations are named.
    unknown_deviation: standard deviation of a logarithm above which no value is reported. Origin: a factor of a hundred.
    Doubled: useless values are reported.
    min_share: component of a direction, over its largest, below which it is omitted from the text. Origin: readability.
    Doubled: shorter texts.
    """

    max_deviation: float = 0.3
    unknown_deviation: float = 4.6
    min_share: float = 0.15


IDENTIFIABILITY = IdentifiabilityConstants()


@dataclass(frozen=True)
class Identifiability:
    """Combinations of parameters, the best determined first.

    `deviations` (m,) are the standard deviations along the `directions` (m, n_parameters), in logarithms of parameters
    above zero and in shares of the range of the others; `words` has a sentence for each combination that is not
    identifiable.
    """

    names: tuple[str, ...]
    deviations: Array
    directions: Array
    words: tuple[str, ...]

    @property
    def unseen(self) -> Array:
        """The directions that are not identifiable (k, n_parameters)."""
        return self.directions[self.deviations > IDENTIFIABILITY.max_deviation]

    @property
    def unseen_names(self) -> set[str]:
        """The parameters in directions that the data do not determine."""
        shares = [np.abs(direction) for direction in self.unseen]
        return {name for share in shares for name, component in zip(self.names, share, strict=True)
                if component > IDENTIFIABILITY.min_share * share.max()}


def identifiability(jacobian: Array, names: Sequence[str], logarithmic: Sequence[bool]) -> Identifiability:
    """Singular values of the noise-weighted Jacobian (n, m) in relative parameters; see `Identifiability`.

    The standard deviation along a right singular vector is 1 / singular value (the Cramer-Rao bound).
    """
    _, values, directions = np.linalg.svd(jacobian, full_matrices=False)
    deviations = 1 / np.maximum(values, 1e-300)
    words = [_words(direction, deviation, names, logarithmic)
             for direction, deviation in zip(directions, deviations, strict=True)
             if deviation > IDENTIFIABILITY.max_deviation]
    return Identifiability(tuple(names), deviations, directions, tuple(words))


def _words(direction: Array, deviation: float, names: Sequence[str], logarithmic: Sequence[bool]) -> str:
    share = np.abs(direction)
    chosen = [k for k in np.argsort(-share) if share[k] > IDENTIFIABILITY.min_share * share.max()]
    involved = [names[k] for k in sorted(chosen)]
    relative = all(logarithmic[k] for k in chosen)
    certainty = "not identifiable" if deviation > (IDENTIFIABILITY.unknown_deviation if relative else 1e3) else \
        f"determined only to within a factor of {np.exp(deviation):.2g}" if relative else \
        f"determined only to within {100 * deviation:.2g} % of the range"
    if len(chosen) == 1:
        return f"{involved[0]} is {certainty}."
    equal = share[chosen].min() > 0.85 * share.max() and all(logarithmic[k] for k in chosen)
    signs = np.sign(direction[sorted(chosen)])
    if equal and abs(signs.sum()) == len(signs):
        return f"Only the ratios between {listing(involved)} are determined: multiplying all of them by one " \
               f"factor does not change the simulated records (their common factor is {certainty})."
    if equal and len(chosen) == 2:
        return f"Only the product {involved[0]} * {involved[1]} is determined: multiplying one and dividing the " \
               f"other by a factor does not change the simulated records (their ratio is {certainty})."
    parts = ", ".join(f"{names[k]} by {10 * direction[k] / share.max():+.2g} %" for k in sorted(chosen))
    return f"{listing(involved)} are strongly correlated: changing them together ({parts}) hardly changes the simulated " \
           f"records (that combination is {certainty})."
