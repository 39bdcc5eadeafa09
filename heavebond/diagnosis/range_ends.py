"""Numbers of an effect that a refit left at an end of the range in which they were sought, with the minimum beyond it.

The end of a range is either a limit of the parameter itself (a friction is not below 0), where a minimum is as good as any
other, or one of the search. Of the latter the score test of the bound tells whether the search stopped short: with r (n,)
the residuals and priors, and s_o (n,) the derivative outward that the unknowns inside their ranges do not take, the sum of
squares falls beyond the end by (s_o'r)**2 / |s_o|**2 to first order (the Lagrange multiplier of the bound; S. D. Silvey,
1959, doi:10.1214/aoms/1177706259).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from heavebond.diagnosis.catalogue import EffectNumber
from heavebond.estimation.residuals import AT_END, Residuals
from heavebond.numerics.dae import Array

MISSED = 12.0  # the fall beyond an end from which on it counts, in units of what is left: as `stage.EARNED`


def passed_ends(problem: Residuals, numbers: Sequence[EffectNumber], inner: Array, r: Array) -> tuple[str, ...]:
    """The names of those `numbers` that stand at an end of the search, beyond which the sum of squares would fall by more
    than chance, at the optimum `inner` (m,) of a least squares problem with residuals `r` (n,) of the data there."""
    own, ended = {n.name: n for n in numbers}, problem.at_end(inner)
    stopped = [k for k in np.flatnonzero(ended) if problem.columns[k].free.name in own]
    if not stopped:
        return ()
    J, (prior, priors) = problem.evaluate(inner)[1], problem.priors(inner)
    whole, slopes = np.concatenate([r, prior]), np.vstack([J, priors])
    inside = slopes[:, ~ended]
    found = []
    for k in stopped:
        high = bool(inner[k] > (problem.low[k] + problem.high[k]) / 2)
        name, span = problem.columns[k].free.name, problem.columns[k].free.range
        limit, end = own[name].limits[high], span.high if high else span.low
        if limit is not None and abs(end - limit) <= AT_END * (span.high - span.low):
            continue
        outward = slopes[:, k] if high else -slopes[:, k]
        left = outward - inside @ np.linalg.lstsq(inside, outward, rcond=1e-9)[0]
        slope, size = float(left @ whole), float(left @ left)
        if slope < 0 < size and slope**2 / size > MISSED * max(1.0, float(r @ r) / len(r)):
            found.append(name)
    return tuple(found)
