"""Instants at which the functions of time in exported equations have kinks or fast transitions, as formulas of the
parameters.

A run of a diagram determines these instants with its parameters (`numerics.forcing`). A program that runs an export has a
separate integrator and may change parameters, so it needs formulas: for each function of time, the zeros of the linear
expressions at which `min`, `max`, `abs`, `sign` and comparisons may switch, and the zeros and the ends of the steep part
of linear expressions in powers and exponentials. If another branch is active, such an instant is superfluous and has no
effect.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from heavebond.equations.events import FlatEvent
from heavebond.equations.time_conditions import NEVER
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Assembly
from heavebond.numerics.forcing import Forcing, switch_arguments
from heavebond.numerics.output_times import grid
from heavebond.numerics.time_search import rounding

MOST_INSTANTS = 500  # limit of instants of an export
LEVELS = (0.0, -1.0, 1.0, -4.0, 4.0)  # values of a linear expression in an exponential or a power


def stop_events(assembly: Assembly) -> list[FlatEvent]:
    """Time events that set nothing, at which the integrator of another program stops."""
    forcing: Forcing = assembly.once("forcing", lambda: Forcing(assembly))
    if not forcing.parts:
        return []
    time, p = assembly.arguments[0], assembly.arguments[3]
    roots = _roots(forcing.parts, time)
    known = np.array(ca.Function("known", [p], [stack(roots)])(assembly.p)).ravel()
    if assembly.model.until is not None:  # instants without a formula, with the parameters of the diagram
        times = forcing.stops(grid(assembly.model, None, None), assembly.p).times
        near = np.abs(times[:, None] - known[None, :]).min(axis=1, initial=np.inf) <= 4 * rounding(times)
        roots += [ca.SX(t) for t in times[~near].tolist()]
    place = next(iter(assembly.flat.expanded.leaves.values())).place
    return [FlatEvent(f"stop_{k}", "stop", place, None, root, None, ()) for k, root in enumerate(roots[:MOST_INSTANTS], 1)]


def _roots(parts: list[ca.SX], time: ca.SX) -> list[ca.SX]:
    """Times at which linear expressions in functions of time are zero, or at the ends of their steep part."""
    roots: dict[str, ca.SX] = {}
    for expressions, levels in zip(switch_arguments(parts, time)[1:], ((0.0,), LEVELS), strict=True):
        for expression in expressions:
            slope = ca.jacobian(expression, time)
            if slope.nnz() and not ca.depends_on(slope, time):
                first = ca.substitute(expression, time, ca.SX(0))
                for level in levels:
                    root = ca.if_else(slope == 0, NEVER, (level - first) / slope)
                    roots.setdefault(str(root), root)
    return list(roots.values())
