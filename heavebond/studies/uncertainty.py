"""Statistics of a sample and over a scatter diagram, and sensitivity analysis: Sobol indices, derivatives at one point.

With y = f(x) and independent x, the index of first order is S_i = Var(E(y | x_i))/Var(y), the index of total order 1 -
Var(E(y | all but x_i))/Var(y): the share of x_i alone, and with all interactions. Both are estimated by
`scipy.stats.sobol_indices` (A. Saltelli et al., Comput. Phys. Commun. 181 (2010) 259-270, doi:10.1016/j.cpc.2009.09.018),
with bootstrapped intervals. To first order at one point the share is (dy/dx_i s_i)**2 / sum_j (dy/dx_j s_j)**2, s the
standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.numerics.dae import Array
from heavebond.studies.campaign import StudyResult
from heavebond.studies.occurrence import Occurrence, Requirement
from heavebond.studies.run_case import Outcome
from heavebond.studies.sampling import AS_GIVEN, DRAWN, SEEDS, Sampling, distribution
from heavebond.studies.study import SIMULATIONS

QUANTILES = (0.05, 0.5, 0.95)
RESAMPLED = 500  # bootstrap samples for an interval
CONFIDENCE = 0.95
INDEPENDENT = ("random", SEEDS)  # kinds of samples with independent points, so that their mean has an interval
LEAST = 8  # smallest number of points for indices


@dataclass(frozen=True)
class Spread:
    """Statistics of a quantity over the sample, in its display unit, at levels `others` of the other axes; `failed` is
    the number of cases without a value. In a sample for Sobol indices only the independently drawn points count.
    `interval` is the 95 % interval of the mean, mean +- t s/sqrt(n) with Student's t; NaN if the points are not
    independent."""

    quantity: str
    others: str
    mean: float
    interval: tuple[float, float]
    deviation: float
    quantiles: tuple[float, float, float]
    least: float
    most: float
    number: int
    failed: int


@dataclass(frozen=True)
class OccurrenceMeans:
    """Results at levels `others` of the other axes: the availability; the share of the time in which each required
    comparison holds; the mean of each quantity in its display unit, over the cases that have it (NaN without one); the
    share of the time of the cases without a result, which count as not available."""

    others: str
    available: float
    fulfilled: Mapping[str, float]
    means: Mapping[str, float]
    failed: float


@dataclass(frozen=True)
class Indices:
    """Sobol indices (m,) of a quantity and their 95 % intervals, from `number` points of each of the m + 2 samples."""

    quantity: str
    others: str
    parameters: tuple[str, ...]
    first: tuple[float, ...]
    total: tuple[float, ...]
    first_interval: tuple[tuple[float, float], ...]
    total_interval: tuple[tuple[float, float], ...]
    number: int


@dataclass(frozen=True)
class Slopes:
    """First-order changes of a quantity at the diagram's values (m,): `percent` for 1 % more of a parameter, `swing` for
    half the width of its range, both in the display unit; `share` of the variance to first order."""

    quantity: str
    others: str
    parameters: tuple[str, ...]
    value: float
    percent: tuple[float, ...]
    swing: tuple[float, ...]
    share: tuple[float, ...]


@dataclass(frozen=True)
class TornadoBar:
    """A quantity at the diagram's values (`value`), and with one parameter at the ends of its range."""

    parameter: str
    value: float
    low: float
    high: float


def groups(result: StudyResult) -> Iterator[tuple[str, dict[int, Outcome]]]:
    """Yield the levels of the other axes (and the procedure) as text, and the outcomes by the number of their point."""
    axis = result.study.sample
    if axis is None:
        return
    at = result.study.axes.index(axis)
    outcomes_by_level: dict[tuple[tuple[int, ...], str], dict[int, Outcome]] = {}
    for outcome in result.outcomes:
        index = result.case_of(outcome).index
        outcomes_by_level.setdefault((index[:at] + index[at + 1:], outcome.procedure), {})[index[at]] = outcome
    for (_, procedure), outcomes in outcomes_by_level.items():
        case = result.case_of(next(iter(outcomes.values())))
        levels = [level.name if other_axis.unit is None else f"{other_axis.name} {level.name}"
                  for k, (other_axis, level) in enumerate(zip(result.study.axes, case.levels, strict=True)) if k != at]
        yield ", ".join([*levels, *([procedure] if len(result.study.procedures) > 1 else [])]), outcomes


def quantities(result: StudyResult) -> list[str]:
    """The quantities of a study, without the number of simulations."""
    return [name for name in result.units if name != SIMULATIONS]


def _sampling(result: StudyResult, *kinds: str) -> Sampling | None:
    axis = result.study.sample
    return axis.sampling if axis is not None and axis.sampling is not None and axis.sampling.kind in kinds else None


def drawn(result: StudyResult, quantity: str, outcomes: dict[int, Outcome]) -> Array:
    """A quantity at the independently drawn points (n,), NaN if a case failed."""
    sampling = _sampling(result, *DRAWN, SEEDS)
    assert sampling is not None
    if sampling.kind == SEEDS:
        return np.array([result.value(o, quantity) for o in outcomes.values()])
    until = 2 * sampling.number if sampling.kind == "sobol_indices" else sampling.number
    return np.array([result.value(o, quantity) for k, o in outcomes.items() if k < until])


def spreads(result: StudyResult) -> list[Spread]:
    """The statistics of every quantity over a random or quasi-random sample."""
    statistics, sampling = [], _sampling(result, *DRAWN, SEEDS)
    for level_text, outcomes in groups(result) if sampling is not None else ():
        for quantity in quantities(result):
            values = drawn(result, quantity, outcomes)
            known = values[np.isfinite(values)]
            if len(known):
                low, middle, high = np.quantile(known, QUANTILES).tolist()
                deviation = float(known.std(ddof=1)) if len(known) > 1 else math.nan
                assert sampling is not None
                interval = interval_of_mean(known) if sampling.kind in INDEPENDENT else (math.nan, math.nan)
                statistics.append(Spread(quantity, level_text, float(known.mean()), interval, deviation, (low, middle, high),
                                         float(known.min()), float(known.max()), len(known), len(values) - len(known)))
    return statistics


def interval_of_mean(values: Array) -> tuple[float, float]:
    """The 95 % interval of the mean of independent values (n,)."""
    from scipy.stats import t

    if len(values) < 2:
        return math.nan, math.nan
    half = float(t.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values)))
    return float(values.mean()) - half, float(values.mean()) + half


def indices(result: StudyResult) -> list[Indices]:
    """Sobol indices of every quantity, for a sample of kind `sobol_indices` with at least LEAST complete rows."""
    sampling = _sampling(result, "sobol_indices")
    results = []
    for level_text, outcomes in groups(result) if sampling is not None else ():
        for quantity in quantities(result):
            assert sampling is not None
            values = np.full((len(sampling.over) + 2) * sampling.number, np.nan)
            for k, outcome in outcomes.items():
                values[k] = result.value(outcome, quantity)
            # rows in which A, B and all mixtures have a value, reduced to a power of two
            table = values.reshape(len(sampling.over) + 2, sampling.number)
            table = table[:, np.isfinite(table).all(axis=0)]
            if table.shape[1] >= LEAST:
                table = table[:, :2 ** int(math.log2(table.shape[1]))]
                # indices from a quantity at the points of A, B and the mixtures, `table` (m + 2, n). The intervals are
                # percentiles of a bootstrap of its columns with a fixed seed.
                first, total = _estimated(table)
                rows = np.random.default_rng(1).integers(table.shape[1], size=(RESAMPLED, table.shape[1]))
                drawn_anew = np.array([_estimated(table[:, chosen]) for chosen in rows])
                low, high = np.quantile(drawn_anew, ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2), axis=0)
                ends = [tuple(map(tuple, np.column_stack([low[k], high[k]]).tolist())) for k in range(2)]
                results.append(Indices(quantity, level_text, tuple(sampling.over), tuple(first.tolist()),
                                       tuple(total.tolist()), ends[0], ends[1],
                                       table.shape[1]))
    return results


def _estimated(table: Array) -> tuple[Array, Array]:
    """Indices of first and total order (m,)."""
    from scipy.stats import sobol_indices

    # duplicated, because SciPy drops the axes of one quantity of one parameter
    both = np.stack([table, table], axis=1)
    estimate: Any = sobol_indices(func={"f_A": both[0], "f_B": both[1], "f_AB": both[2:]}, n=table.shape[1])
    first, total = (np.reshape(values, (2, len(table) - 2))[0] for values in (estimate.first_order, estimate.total_order))
    return first, total


def slopes(result: StudyResult) -> list[Slopes]:
    """Derivatives of every measured quantity at the diagram's values by sensitivities, the largest share first."""
    sampling = _sampling(result, "local")
    results = []
    for level_text, outcomes in groups(result) if sampling is not None else ():
        for outcome in outcomes.values():
            for quantity, by in outcome.slopes.items():
                assert sampling is not None
                scale = result.units[quantity].scale
                scaled_slopes = np.array([by[name] * distribution(wanted).std() for name, wanted in sampling.over.items()])
                total = float((scaled_slopes**2).sum())
                rows = [(name, 0.01 * by[name] * outcome.at[name] / scale, by[name] * (wanted.high - wanted.low) / 2 / scale,
                         float(part**2 / total) if total else 0.0)
                        for (name, wanted), part in zip(sampling.over.items(), scaled_slopes, strict=True)]
                names, percent, swing, share = zip(*sorted(rows, key=lambda row: -row[3]), strict=True)
                results.append(Slopes(quantity, level_text, names, result.value(outcome, quantity), percent, swing, share))
    return results


def swings(result: StudyResult, quantity: str) -> list[tuple[str, list[TornadoBar]]]:
    """Tornado bars of a quantity, the largest first, for all levels of the other axes: from runs (`one_at_a_time`), or from
    derivatives times half the width of the ranges (`local`)."""
    if _sampling(result, "local") is not None:
        return [(s.others, [TornadoBar(name, s.value, s.value - swing, s.value + swing) for name, swing in sorted(
            zip(s.parameters, s.swing, strict=True), key=lambda pair: -abs(pair[1]))])
            for s in slopes(result) if s.quantity == quantity]
    sampling = _sampling(result, "one_at_a_time")
    tornado_rows = []
    for level_text, outcomes in groups(result) if sampling is not None else ():
        assert sampling is not None and result.study.sample is not None
        place = result.study.axes.index(result.study.sample)
        values = {result.case_of(o).levels[place].name: result.value(o, quantity) for o in outcomes.values()}
        rows = [TornadoBar(name, values.get(AS_GIVEN, math.nan), values.get(f"{name} low", math.nan),
                           values.get(f"{name} high", math.nan)) for name in sampling.over]
        tornado_rows.append((level_text, sorted(rows, key=lambda row: -np.nan_to_num(abs(row.high - row.low)))))
    return tornado_rows


# -- scatter diagrams --------------------------------------------------------------------------------------------------
def occurrence_means(result: StudyResult) -> list[OccurrenceMeans]:
    """Availability and means for each combination of levels of the other axes and each procedure, in order. UsageError
    if the study has no `occurrence:`."""
    study = result.study
    occurrence = study.occurrence
    if occurrence is None:
        raise UsageError([Problem("occurrence-missing", f"the study '{study.name}' has no scatter diagram", None,
                                  "Add `occurrence:` with `of:` and `share:`.")])
    groups: dict[tuple[str, str], dict[tuple[int, ...], list[Outcome]]] = {}
    for outcome in result.outcomes:
        case = result.case_of(outcome)
        combination = ", ".join(level.name if axis.unit is None else f"{axis.name} {level.name}"
                                for k, (axis, level) in enumerate(zip(study.axes, case.levels, strict=True))
                                if k not in occurrence.axes and axis.sampling is None)
        cell = tuple(case.index[k] for k in occurrence.axes)
        groups.setdefault((combination, outcome.procedure), {}).setdefault(cell, []).append(outcome)
    several = len(study.procedures) > 1
    return [_means(result, occurrence, ", ".join(filter(None, (combination, procedure if several else ""))), cells)
            for (combination, procedure), cells in groups.items()]


def _means(result: StudyResult, occurrence: Occurrence, combination: str, cells: Mapping[tuple[int, ...], list[Outcome]]
           ) -> OccurrenceMeans:
    shares = np.array([occurrence.shares[cell] for cell in cells])

    def mean(numbers: Iterator[float]) -> float:
        values = np.array(list(numbers))
        known = np.isfinite(values)
        return float(shares[known] @ values[known] / shares[known].sum()) if shares[known].sum() > 0 else math.nan

    def share_where(wanted: Sequence[Requirement]) -> float:
        return mean(sum(all(r.holds(o.values.get(r.quantity, math.nan)) for r in wanted) and not o.problem
                            for o in outcomes) / len(outcomes) for outcomes in cells.values())

    def mean_of(quantity: str) -> float:
        known = ([v for o in outcomes if math.isfinite(v := result.value(o, quantity))] for outcomes in cells.values())
        return mean(sum(values) / len(values) if values else math.nan for values in known)

    return OccurrenceMeans(combination, share_where(occurrence.required),
                           {r.text: share_where([r]) for r in occurrence.required},
                           {name: mean_of(name) for name in result.units},
                           mean(sum(bool(o.problem) for o in outcomes) / len(outcomes) for outcomes in cells.values()))
