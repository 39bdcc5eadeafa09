"""Modal quantities (damping ratio, decay rate, frequency) for costs and limits, with their derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import SimulationError, StartError
from heavebond.linear.held_variables import check_decided
from heavebond.linear.linearisation import Mode, ModesAtStart
from heavebond.numerics.dae import Array, Assembly

NUMBERS = ("damping", "decay", "frequency")
WHICH = ("least", "slowest")


def part_of(states: Sequence[str], component: str) -> list[str]:
    """The states that belong to a component or a block."""
    return [name for name in states if name.startswith(component + ".")]


def chosen_mode(modes: Sequence[Mode], number: str, selection: str) -> Mode | None:
    """The mode with the least damping ratio or the slowest decay; or the slowest oscillatory mode; or the oscillatory mode
    with the largest participation of a component (of all modes, if none oscillates). None if there are no modes."""
    moving = [mode for mode in modes if mode.value]
    if selection not in WHICH:
        return max([m for m in moving if m.swings] or moving, default=None, key=lambda mode: sum(
            mode.participation[name] for name in part_of(mode.states, selection)))
    if selection == "slowest":
        return next((mode for mode in moving if mode.swings), next(iter(moving), None))
    by = (lambda m: -m.value.real) if number == "decay" else (lambda m: m.damping)
    return min(moving, key=by, default=None)


def modal_number(number: str, mode: Mode | None) -> float:
    """The damping ratio, -Re(s) in 1/s or |s|/2 pi in Hz of a mode; a machine without such a mode does not oscillate."""
    if mode is None:
        return 1.0 if number == "damping" else 0.0
    return {"damping": mode.damping, "decay": -mode.value.real, "frequency": mode.frequency}[number]


def modal_slope(number: str, mode: Mode, moved: NDArray[np.complex128]) -> Array:
    """The derivatives (m,) of the number for derivatives `moved` (m,) of the eigenvalue."""
    s = mode.value
    if number == "decay":
        return np.asarray(-moved.real)
    size = abs(s)
    if number == "frequency":
        return np.asarray((s.real * moved.real + s.imag * moved.imag) / size / (2 * np.pi))
    return np.asarray(-moved.real / size + s.real * (s.real * moved.real + s.imag * moved.imag) / size**3)


class ModalNumbers:
    """Numbers of the modes of an assembly, with changed settings if needed, and their derivatives by the named parameters;
    those of the last parameters are cached."""

    def __init__(self, assembly: Assembly, settings: Mapping[str, float | str], named: Sequence[str]):
        self.names, self.settings = assembly.parameter_names, settings
        self.named = [name for name in named if name not in settings]
        self.modes = ModesAtStart(assembly.with_parameters(settings))
        with suppress(StartError, SimulationError):  # the runs say so
            check_decided(self.modes.constant(self.modes.start({})), "a number of the modes",
                          "Take a number of the run instead.")
        self._known: tuple[bytes, dict[tuple[str, str], tuple[float, Array]]] = b"", {}

    def at(self, number: str, selection: str, p: Array) -> tuple[float, Array]:
        """The number and its derivatives by all parameters (n_p,), zero for those that are not named."""
        if self._known[0] != p.tobytes():
            self._known = p.tobytes(), {}
        if (number, selection) not in self._known[1]:
            first, modes = self.modes.at({**dict(zip(self.names, p.tolist(), strict=True)), **self.settings})
            mode, slope = chosen_mode(modes, number, selection), np.zeros(len(p))
            if mode is not None:
                slopes = modal_slope(number, mode, self.modes.slope(first, mode, self.named))
                slope[[self.names.index(name) for name in self.named]] = slopes
            self._known[1][number, selection] = modal_number(number, mode), slope
        return self._known[1][number, selection]
