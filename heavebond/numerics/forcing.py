"""Prescribed functions of time: the longest step that does not pass over a short motion of one of them.

A solver evaluates the equations only at the ends of its steps. Where a machine is at rest the steps grow without limit, and
a road bump, a pulse or a gust that begins and ends within one step is missed: the run ends without an error and without the
motion. The steps are therefore limited by what the output points show of the functions of time in the equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly


@dataclass(frozen=True)
class ForcingConstants:
    """The constants of the limit of the steps.

    share: excursion of a function within a step, over its range along the run, that limits the step. Origin: a step may
        contain a smaller one unnoticed; a sine allows steps of a seventh of its period, longer than any solver takes
        at usual tolerances. Doubled: steps longer by two fifths where they are limited, and smaller motions unseen.
    renewed_below: share of the present limit below which another set of parameters renews it. Origin: an integrator is
        not built again for a change that hardly matters. Doubled (one): it is built again at every smaller limit.
    """

    share: float = 0.05
    renewed_below: float = 0.7


FORCING = ForcingConstants()


class Forcing:
    """The largest subexpressions of the equations that depend on time and parameters alone."""

    def __init__(self, assembly: Assembly):
        time, _, _, p, _, rate = assembly.arguments
        equations = ca.substitute(stack([assembly.ode, assembly.alg]), rate, ca.SX(1))
        found = _parts(equations, time, p)
        self._felt: list[int] = []
        self._functions: ca.Function | None = None
        if not found:
            return
        order = assembly.flat.places
        used = [s for s in ca.symvar(stack(found)) if s.element_hash() in order]
        self._felt = [order[s.element_hash()] for s in used]
        self._functions = ca.Function("forcing", [time, stack(used)], [stack(found)])

    def longest_step(self, times: Array, p: Array) -> float:
        """The longest step (s) over these output times (N,) with these parameters; 0 for no limit."""
        if self._functions is None or len(times) < 3:
            return 0.0
        values = np.asarray(self._functions(times[None, :], np.repeat(p[self._felt][:, None], len(times), axis=1)))
        return _longest(values[np.all(np.isfinite(values), axis=1)], float(np.median(np.diff(times))))

    def felt(self, p: Array) -> Array:
        """The parameters that the functions depend on."""
        return np.asarray(p[self._felt])


def _parts(equations: ca.SX, time: ca.SX, p: ca.SX) -> list[ca.SX]:
    driven = np.flatnonzero(ca.which_depends(equations, time, 1, True)).tolist() if equations.numel() else []
    if not driven:
        return []
    _, _, parts = ca.extract_parametric(equations[driven], stack([time, p]))
    timed = ca.which_depends(stack(parts), time, 1, True) if parts else []
    return [part for part, depends in zip(parts, timed, strict=True) if depends]


def _longest(values: Array, interval: float) -> float:
    """The longest window, in powers of two of the interval, in which no row (m, N) leaves the range between its values at
    both ends by more than the share of its whole range; 0 where the longest window that fits is allowed.

    Extremes over windows of 2^k intervals follow from two windows of half the length."""
    allowed = FORCING.share * np.ptp(values, axis=1, keepdims=True) if len(values) else np.zeros((0, 1))
    highest = lowest = values
    width = 1
    while width < values.shape[1] and len(values):
        half = max(width // 2, 1)
        highest = np.maximum(highest[:, :-half], highest[:, half:])
        lowest = np.minimum(lowest[:, :-half], lowest[:, half:])
        first, last = values[:, :-width], values[:, width:]
        if np.any(highest - np.maximum(first, last) > allowed) or np.any(np.minimum(first, last) - lowest > allowed):
            return width / 2 * interval
        width *= 2
    return 0.0
