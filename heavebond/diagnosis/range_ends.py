"""Numbers of an effect that a refit left at an end of the range in which they were sought, with the minimum beyond it.

The end of a range is either a limit of the parameter itself (a friction is not below 0), where a minimum is as good as any
other, or one of the search. Of the latter the score test of the bound tells whether the search stopped short: with r (n,)
the residuals and priors, and s_o (n,) the derivative outward that the unknowns inside their ranges do not take, the sum of
squares falls beyond the end by (s_o'r)**2 / |s_o|**2 to first order (the Lagrange multiplier of the bound; S. D. Silvey,
1959, doi:10.1214/aoms/1177706259).

An amplitude may as well stand so near the value at which it makes no effect that the records do not show it: with d the way
there, the sum of squares rises on it by d**2 |s_o|**2 + 2 d s_o'r to first order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from heavebond.diagnosis.catalogue import EffectNumber
from heavebond.estimation.residuals import AT_END, Residuals
from heavebond.numerics.dae import Array

# The fall beyond an end, or the rise towards it, from which on it counts, in units of what is left: as `stage.EARNED`.
MISSED = 12.0


def passed_ends(problem: Residuals, numbers: Sequence[EffectNumber], inner: Array, r: Array) -> tuple[str, ...]:
    """The names of those `numbers` that stand at an end of the search, beyond which the sum of squares would fall by more
    than chance, at the optimum `inner` (m,) of a least squares problem with residuals `r` (n,) of the data there."""
    own, ended = {n.name: n for n in numbers}, problem.at_end(inner)
    stopped = [int(k) for k in np.flatnonzero(ended) if problem.columns[k].free.name in own]
    found = []
    for k in stopped:
        high = bool(inner[k] > (problem.low[k] + problem.high[k]) / 2)
        name, span = problem.columns[k].free.name, problem.columns[k].free.range
        limit, end = own[name].limits[high], span.high if high else span.low
        if limit is not None and abs(end - limit) <= AT_END * (span.high - span.low):
            continue
        slope, size = _alone(problem, k, inner, r)
        slope *= 1.0 if high else -1.0
        if slope < 0 < size and slope**2 / size > MISSED * _unit(r):
            found.append(name)
    return tuple(found)


def unshown_amplitudes(problem: Residuals, numbers: Sequence[EffectNumber], inner: Array, r: Array) -> tuple[str, ...]:
    """The names of those amplitudes that the records do not tell from the value at which they make no effect: the neutral
    one, or an end of the range of one that has no neutral value (the smallest gap of a play); `inner` (m,) and `r` (n,) as
    for `passed_ends`."""
    amplitudes = {n.name: n for n in numbers if n.amplitude}
    found = []
    for k, column in enumerate(problem.columns):
        number, span = amplitudes.get(column.free.name), column.free.range
        if number is None:
            continue
        if number.sought is not None:
            ends = [float(problem.low[k]), float(problem.high[k])]
        else:
            ends = [column.inner(number.neutral)] if span.low <= number.neutral <= span.high else []
        slope, size = _alone(problem, k, inner, r)
        ways = [end - float(inner[k]) for end in ends]
        if any(d**2 * size + 2 * d * slope < MISSED * _unit(r) for d in ways):
            found.append(number.name)
    return tuple(dict.fromkeys(found))


def _alone(problem: Residuals, k: int, inner: Array, r: Array) -> tuple[float, float]:
    """(s_o'r, |s_o|**2) of the k-th unknown, s_o (n,) the derivative that the unknowns inside their ranges do not take."""
    J, (prior, priors) = problem.evaluate(inner)[1], problem.priors(inner)
    whole, slopes = np.concatenate([r, prior]), np.vstack([J, priors])
    inside = ~problem.at_end(inner)
    inside[k] = False
    left = slopes[:, k] - slopes[:, inside] @ np.linalg.lstsq(slopes[:, inside], slopes[:, k], rcond=1e-9)[0]
    return float(left @ whole), float(left @ left)


def _unit(r: Array) -> float:
    """What is left per sample, at least the noise."""
    return max(1.0, float(r @ r) / len(r))
