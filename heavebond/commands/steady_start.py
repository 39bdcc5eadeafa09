"""Warning of a steady start that is an unstable equilibrium."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from heavebond.numerics.dae import Assembly
    from heavebond.numerics.result import Result
    from heavebond.numerics.start_equations import Point

# A state that moves by less than this share of its nominal value is at rest: ten times the errors of the integrator over a
# run, and much less than a growing mode needs to become visible.
STILL = 1e-6


def warn_of_growing(assembly: Assembly, point: Point) -> list[dict[str, object]]:
    """Warn of growing modes at a steady start: the machine leaves such an equilibrium after any disturbance. They are not
    computed for large diagrams."""
    from heavebond.commands import terminal
    from heavebond.core.errors import SimulationError
    from heavebond.linear.held_variables import StartEvents
    from heavebond.linear.linearisation import Linearisation
    from heavebond.linear.slow_modes import SLOW_MODES

    if len(assembly.state_names) > SLOW_MODES.max_all:
        return []
    with suppress(SimulationError):  # the run reports it
        point = StartEvents(assembly).after(point)
    judged = Linearisation(assembly).at(point).stability()
    growing_modes = sorted(() if judged.undecided else judged.growing, key=lambda e: -e.value.real)
    if growing_modes:
        terminal.warn(f"The steady start is not stable, so that the machine leaves it: "
                      f"{'; '.join(e.text for e in growing_modes)}. "
                      "`heavebond modes` shows its modes; guesses (`~`) may lead to another steady state.")
    return [{"real": e.value.real, "imaginary": e.value.imag, "states": list(e.states)} for e in growing_modes]


def warn_where_it_stands(result: Result) -> list[dict[str, object]]:
    """The same after a run in which a state has kept the value of its steady start. Only then can the integrator hide the
    effect of a small disturbance; a machine that moves in all its states needs no linearisation."""
    import numpy as np

    from heavebond.linear.linearisation import start_point

    assembly = result.assembly
    if assembly.model.initial.mode != "steady" or not len(result.x):
        return []
    if not np.any(np.ptp(result.x, axis=1) <= STILL * np.asarray(assembly.x_nominal)):
        return []
    return warn_of_growing(assembly, start_point(result.start, result.u[:, 0]))
