"""What the points of a sample say together: spread, Sobol indices, slopes at one point.

With y = f(x) and independent x, the index of first order is S_i = Var(E(y | x_i))/Var(y), that of total order
1 - Var(E(y | all but x_i))/Var(y): what x_i makes alone, and with the others. Both are estimated as A. Saltelli et al. do,
Comput. Phys. Commun. 181 (2010) 259-270, doi:10.1016/j.cpc.2009.09.018 (`scipy.stats.sobol_indices`), with bootstrapped
intervals. To first order at one point the share is (dy/dx_i s_i)**2 / sum_j (dy/dx_j s_j)**2, s the standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from heavebond.numerics.dae import Array
from heavebond.studies.campaign import StudyResult
from heavebond.studies.run_case import Outcome
from heavebond.studies.sampling import AS_GIVEN, DRAWN, Sampling, distribution
from heavebond.studies.study import SIMULATIONS

QUANTILES = (0.05, 0.5, 0.95)
RESAMPLED = 500  # bootstraps of an interval
CONFIDENCE = 0.95
LEAST = 8  # points below which no indices are told


@dataclass(frozen=True)
class Spread:
    """A number over the sample, in the unit in which it is told, at levels `others` of the other axes; `failed` cases have
    no number. Of a sample for Sobol indices only the points drawn independently count."""

    quantity: str
    others: str
    mean: float
    deviation: float
    quantiles: tuple[float, float, float]
    least: float
    most: float
    number: int
    failed: int


@dataclass(frozen=True)
class Indices:
    """Sobol indices of a number (m,) and their 95 % intervals, from `number` points of each of the m + 2 samples."""

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
    """How a number moves at the diagram's own values (m,): `percent` by 1 % more of a parameter, `swing` by the half width
    of its range, both in the unit in which it is told; `share` of the variance to first order."""

    quantity: str
    others: str
    parameters: tuple[str, ...]
    value: float
    percent: tuple[float, ...]
    swing: tuple[float, ...]
    share: tuple[float, ...]


@dataclass(frozen=True)
class TornadoBar:
    """A number at the diagram's own values (`value`), and with one parameter at the low and the high end of its range."""

    parameter: str
    value: float
    low: float
    high: float


def groups(result: StudyResult) -> Iterator[tuple[str, dict[int, Outcome]]]:
    """The levels of the other axes (and the procedure) in words, and the outcomes there by the number of their point."""
    axis = result.study.sample
    if axis is None:
        return
    at = result.study.axes.index(axis)
    found: dict[tuple[tuple[int, ...], str], dict[int, Outcome]] = {}
    for outcome in result.outcomes:
        index = result.case_of(outcome).index
        found.setdefault((index[:at] + index[at + 1:], outcome.procedure), {})[index[at]] = outcome
    for (_, procedure), outcomes in found.items():
        case = result.case_of(next(iter(outcomes.values())))
        levels = [level.name if other.unit is None else f"{other.name} {level.name}"
                  for k, (other, level) in enumerate(zip(result.study.axes, case.levels, strict=True)) if k != at]
        yield ", ".join([*levels, *([procedure] if len(result.study.procedures) > 1 else [])]), outcomes


def quantities(result: StudyResult) -> list[str]:
    """The numbers of a study, without how much was computed."""
    return [name for name in result.units if name != SIMULATIONS]


def _sampling(result: StudyResult, *kinds: str) -> Sampling | None:
    axis = result.study.sample
    return axis.sampling if axis is not None and axis.sampling is not None and axis.sampling.kind in kinds else None


def drawn(result: StudyResult, quantity: str, outcomes: dict[int, Outcome]) -> Array:
    """A number at the points that were drawn independently, NaN where a case failed."""
    sampling = _sampling(result, *DRAWN)
    assert sampling is not None
    until = 2 * sampling.number if sampling.kind == "sobol_indices" else sampling.number
    return np.array([result.value(o, quantity) for k, o in outcomes.items() if k < until])


def spreads(result: StudyResult) -> list[Spread]:
    """The spread of every number over a sample that was drawn."""
    found = []
    for others, outcomes in groups(result) if _sampling(result, *DRAWN) is not None else ():
        for quantity in quantities(result):
            values = drawn(result, quantity, outcomes)
            known = values[np.isfinite(values)]
            if len(known):
                low, middle, high = np.quantile(known, QUANTILES).tolist()
                deviation = float(known.std(ddof=1)) if len(known) > 1 else math.nan
                found.append(Spread(quantity, others, float(known.mean()), deviation, (low, middle, high),
                                    float(known.min()), float(known.max()), len(known), len(values) - len(known)))
    return found


def indices(result: StudyResult) -> list[Indices]:
    """Sobol indices of every number, where the sample is one for these and enough of it is there."""
    sampling = _sampling(result, "sobol_indices")
    found = []
    for others, outcomes in groups(result) if sampling is not None else ():
        for quantity in quantities(result):
            assert sampling is not None
            values = np.full((len(sampling.over) + 2) * sampling.number, np.nan)
            for k, outcome in outcomes.items():
                values[k] = result.value(outcome, quantity)
            # a row counts where A, B and all mixtures have a number; so many of these as are a power of two
            table = values.reshape(len(sampling.over) + 2, sampling.number)
            table = table[:, np.isfinite(table).all(axis=0)]
            if table.shape[1] >= LEAST:
                table = table[:, :2 ** int(math.log2(table.shape[1]))]
                found.append(_indices(quantity, others, tuple(sampling.over), table))
    return found


def _indices(quantity: str, others: str, parameters: tuple[str, ...], table: Array) -> Indices:
    """From a number at the points of A, B and the mixtures (m + 2, n). The intervals are percentiles of rows drawn anew, by
    the same dice every time."""
    first, total = _estimated(table)
    rows = np.random.default_rng(1).integers(table.shape[1], size=(RESAMPLED, table.shape[1]))
    drawn_anew = np.array([_estimated(table[:, chosen]) for chosen in rows])
    low, high = np.quantile(drawn_anew, ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2), axis=0)
    ends = [tuple(map(tuple, np.column_stack([low[k], high[k]]).tolist())) for k in range(2)]
    return Indices(quantity, others, parameters, tuple(first.tolist()), tuple(total.tolist()), ends[0], ends[1],
                   table.shape[1])


def _estimated(table: Array) -> tuple[Array, Array]:
    """Indices of first and total order (m,)."""
    from scipy.stats import sobol_indices

    # twice the same number: of one number by one parameter SciPy makes no table
    both = np.stack([table, table], axis=1)
    found: Any = sobol_indices(func={"f_A": both[0], "f_B": both[1], "f_AB": both[2:]}, n=table.shape[1])
    first, total = (np.reshape(values, (2, len(table) - 2))[0] for values in (found.first_order, found.total_order))
    return first, total


def slopes(result: StudyResult) -> list[Slopes]:
    """Exact slopes of every measured number at the diagram's own values, the largest share first."""
    sampling = _sampling(result, "local")
    found = []
    for others, outcomes in groups(result) if sampling is not None else ():
        for outcome in outcomes.values():
            for quantity, by in outcome.slopes.items():
                assert sampling is not None
                scale = result.units[quantity].scale
                moved = np.array([by[name] * distribution(wanted).std() for name, wanted in sampling.over.items()])
                total = float((moved**2).sum())
                rows = [(name, 0.01 * by[name] * outcome.at[name] / scale, by[name] * (wanted.high - wanted.low) / 2 / scale,
                         float(part**2 / total) if total else 0.0)
                        for (name, wanted), part in zip(sampling.over.items(), moved, strict=True)]
                names, percent, swing, share = zip(*sorted(rows, key=lambda row: -row[3]), strict=True)
                found.append(Slopes(quantity, others, names, result.value(outcome, quantity), percent, swing, share))
    return found


def swings(result: StudyResult, quantity: str) -> list[tuple[str, list[TornadoBar]]]:
    """How far each parameter moves a number, the most first, by the levels of the other axes: as it was run
    (`one_at_a_time`), or by slopes to the ends of the half widths (`local`)."""
    if _sampling(result, "local") is not None:
        return [(s.others, [TornadoBar(name, s.value, s.value - swing, s.value + swing) for name, swing in sorted(
            zip(s.parameters, s.swing, strict=True), key=lambda pair: -abs(pair[1]))])
            for s in slopes(result) if s.quantity == quantity]
    sampling = _sampling(result, "one_at_a_time")
    found = []
    for others, outcomes in groups(result) if sampling is not None else ():
        assert sampling is not None
        told = {result.case_of(o).levels[_at(result)].name: result.value(o, quantity) for o in outcomes.values()}
        rows = [TornadoBar(name, told.get(AS_GIVEN, math.nan), told.get(f"{name} low", math.nan),
                           told.get(f"{name} high", math.nan)) for name in sampling.over]
        found.append((others, sorted(rows, key=lambda row: -np.nan_to_num(abs(row.high - row.low)))))
    return found


def _at(result: StudyResult) -> int:
    axis = result.study.sample
    assert axis is not None
    return result.study.axes.index(axis)
