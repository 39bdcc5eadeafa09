"""Floquet multipliers of a run that becomes periodic: stability if a machine has no equilibrium.

Small deviations follow dx' = A(t) dx with A along the run. Over a period T they are multiplied by the monodromy matrix,
here the product of exp(A dt) over the steps of the output, A in the middle of each; its eigenvalues are the multipliers. The
run is stable if all have magnitudes below 1. A. H. Nayfeh, B. Balachandran, Applied Nonlinear Dynamics, Wiley 1995, section
3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.linear.linearisation import Linearisation
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.result import columns
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.start_equations import Point


@dataclass(frozen=True)
class FloquetConstants:
    """The constants of the search for a period in a run and of its Floquet multipliers.

    points: points of the run. Origin: some hundred for each period. Doubled: time.
    repeats: share of its range by which a state may differ from itself a period before. Origin: a step of the output.
        Doubled: less settled periods are accepted.
    leaves: share of its range by which a state must have left its beginning first. Origin: noise of a slow start.
        Doubled: shorter periods are missed.
    decided: distance of a multiplier from 1 that decides stability. Origin: accuracy of a multiplier. Doubled:
        undecided more often.
    """

    points: int = 4000
    repeats: float = 0.01
    leaves: float = 0.2
    decided: float = 0.01


FLOQUET = FloquetConstants()


def largest_multiplier(assembly: Assembly, until: float) -> float | None:
    """The magnitude of the largest Floquet multiplier over the last period of a run; None if the run is not periodic at its
    end, has events or delays, or fails."""
    from scipy.linalg import expm

    if assembly.flat.events or assembly.flat.held or assembly.flat.delays:
        return None
    try:
        result = Simulator(assembly, times=np.linspace(0, until, FLOQUET.points)).run()
    except HeavebondError:
        return None
    if result.stays:
        return None
    t, x, z, p, u, _ = columns(result)
    steps = period(x)
    if steps is None:
        return None
    linearisation = Linearisation(assembly)
    sizes = assembly.x_nominal
    at = range(t.shape[1] - 1 - steps, t.shape[1])
    try:
        jacobians = [linearisation.at(Point(float(t[0, k]), x[:, k], z[:, k], p[:, k], u[:, k], 1.0)).a for k in at]
    except HeavebondError:
        return None
    scaled = [a * sizes / sizes[:, None] for a in jacobians]
    step = float(t[0, 1] - t[0, 0])
    whole = np.eye(len(scaled[0]))
    for before, after in pairwise(scaled):
        whole = expm(step * (before + after) / 2) @ whole
    return float(np.abs(np.linalg.eigvals(whole)).max(initial=0.0))


def period(x: Array) -> int | None:
    """The number of steps after which the end of states (n_x, N) repeats; None if it does not."""
    spread = np.ptp(x[:, x.shape[1] // 2:], axis=1)
    moving = x[spread > 1e-9 * np.maximum(np.abs(x).max(axis=1), 1e-300)]
    if not len(moving):
        return None
    moving = moving / np.ptp(moving, axis=1)[:, None]
    moved_away = False
    for steps in range(1, x.shape[1] // 2):
        off = float(np.abs(moving[:, -steps:] - moving[:, -2 * steps:-steps]).max())
        moved_away = moved_away or off > FLOQUET.leaves
        if moved_away and off < FLOQUET.repeats:
            return steps
    return None
