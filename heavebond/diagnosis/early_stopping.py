"""When a descent of a search is ended early: where it has arrived, where another one did the same, where it is hopeless.

Each is a function of the sums of squares of its runs so far and of the unknowns of the best (see `Residuals.descend`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate

import numpy as np

from heavebond.estimation.residuals import ARRIVED, GIVEN_UP
from heavebond.numerics.dae import Array

# It has arrived where so many runs in a row have not lowered the sum of squares by this share, as far as the errors of its
# runs let it see, or creeps. What comes near the best is followed to the very end later.
IDLE, LITTLE = 4, 1e-3
# After so many runs it is given up where it stands where another one stood by then: within this share of each range, and of
# the sum of squares.
MIDWAY, MEETS = 4, 0.03
# And where it then leaves more than so many times what the best of other candidates leaves, or as good as all of the misfit
# of which another one takes most, unless its last two steps have brought it to this share.
HOPE, STEEP = 10.0, 0.5

Enough = Callable[[Sequence[float], Array], str]


def stop_stalled(costs: Sequence[float], best: Array) -> str:
    """Ends a descent that hardly falls any more."""
    return ARRIVED if len(costs) > IDLE and min(costs[:-IDLE]) - min(costs) < LITTLE * min(costs) else ""


def made_progress(costs: Sequence[float]) -> bool:
    """Whether the last two steps of a descent have brought it far, given the smallest sum after each."""
    return len(costs) > 2 and costs[-1] < STEEP * costs[-3]


def stop_inferior_starts(spans: Array, least: float, nothing: float = np.inf) -> Enough:
    """Ends the first steps from several starts of one candidate, one start after the other. `spans` (m,) are the ranges of
    the unknowns, `least` is what the best of other candidates leaves; a descent that leaves `nothing` or more by then is
    hopeless, too."""
    midway: list[tuple[float, Array]] = []  # where each stood after a few

    def met(cost: float, inner: Array) -> bool:
        return any(abs(cost - other) < MEETS * other and float(np.max(np.abs(inner - there) / spans)) < MEETS
                   for other, there in midway)

    def enough(costs: Sequence[float], best: Array) -> str:
        history = list(accumulate(costs, min))
        if len(costs) >= MIDWAY and history[-1] > min(HOPE * least, nothing) and not made_progress(history):
            return GIVEN_UP
        if len(costs) == MIDWAY:
            if met(history[-1], best):
                return ARRIVED
            midway.append((history[-1], best))
        return stop_stalled(costs, best)

    return enough
