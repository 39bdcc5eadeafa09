"""Warning of a steady start that is an unstable equilibrium."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from heavebond.numerics.result import Result

# A state that moves by less than this share of its nominal value is at rest: ten times the errors of the integrator over a
# run, and much less than a growing mode needs to become visible.
STILL = 1e-6


def warn_where_it_stands(result: Result) -> list[dict[str, object]]:
    """Warn of growing modes after a run in which a state has kept the value of its steady start. Only then can the
    integrator hide the effect of a small disturbance; a machine that moves in all its states needs no linearisation."""
    import numpy as np

    from heavebond.commands import terminal
    from heavebond.linear.linearisation import start_point
    from heavebond.linear.modes import growing_modes

    assembly = result.assembly
    if assembly.model.initial.mode != "steady" or not len(result.x):
        return []
    if not np.any(np.ptp(result.x, axis=1) <= STILL * np.asarray(assembly.x_nominal)):
        return []
    growing, words = growing_modes(assembly, start_point(result.start, result.u[:, 0]))
    if words:
        terminal.warn(words)
    return growing
