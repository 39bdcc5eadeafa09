"""Modal quantities (damping ratio, decay rate, frequency) for costs and limits, with their derivatives.

Distribution of energy and damping of a mode over the components, from the powers at their ports.

In a mode all efforts and flows vary as e exp(s t), f exp(s t) with s = sigma + j omega. Over the ports of a component

    S = sum conj(e) f = 2 s V + 2 conj(s) T + D

with V, T the energies of its springs and masses and D its dissipation, in one measure. |Im S| / omega is therefore the
energy of a component that holds one kind, and Re S - sigma |Im S| / omega its dissipation; below zero it feeds the mode.
As no power is lost at the nodes, the sum of S over all components is 0. In a non-oscillatory mode |S / s| is taken as the
energy.

A port whose power is an enthalpy flow has no effort and flow from which the energy of a small motion follows: components
with such ports are left out, and named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import SimulationError, StartError
from heavebond.equations.buffered import Buffered
from heavebond.language.symbols import stack
from heavebond.linear.held_variables import check_decided
from heavebond.linear.linearisation import Mode, ModesAtStart
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.matrices import solved
from heavebond.numerics.sparse_jacobian import jacobian
from heavebond.numerics.start_equations import Point

NUMBERS = ("damping", "decay", "frequency")
WHICH = ("least", "slowest")
ROUNDING = 1e-9


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


def modal_slope(number: str, mode: Mode, derivative: NDArray[np.complex128]) -> Array:
    """The derivatives (m,) of the number from the `derivative` (m,) of the eigenvalue."""
    s = mode.value
    if number == "decay":
        return np.asarray(-derivative.real)
    size = abs(s)
    if number == "frequency":
        return np.asarray((s.real * derivative.real + s.imag * derivative.imag) / size / (2 * np.pi))
    return np.asarray(-derivative.real / size + s.real * (s.real * derivative.real + s.imag * derivative.imag) / size**3)


class ModalNumbers:
    """Numbers of the modes of an assembly, with changed settings if needed, and their derivatives by the named parameters;
    the results for the last parameters are cached."""

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


@dataclass(frozen=True)
class ModalShares:
    """The shares of components in the energy of a mode and in its dissipation (below zero for components that feed the
    mode), the largest first. `left_out` names components that cannot be counted. Empty if a mode moves no store, and in a
    sampled system, whose efforts and flows do not vary as exp(s t)."""

    energy: dict[str, float] = field(default_factory=dict)
    damping: dict[str, float] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


class ModalEnergies:
    """How the efforts and flows of all ports move with the states of an assembly, differentiated once."""

    def __init__(self, assembly: Assembly):
        _, x, z, _, _, _ = assembly.arguments
        flat = assembly.flat
        self.assembly = assembly
        self.left_out = tuple(dict.fromkeys(b.owner for b in flat.bonds.values() if not b.efforts))
        named = {name: b for name, b in flat.bonds.items() if b.owner not in self.left_out}
        bonds = list(named.values())
        self.ports = [name for name, b in named.items() for _ in b.efforts]
        self.owners = list(dict.fromkeys(b.owner for b in bonds))
        number = {owner: k for k, owner in enumerate(self.owners)}
        self._owner = np.array([number[b.owner] for b in bonds for _ in b.efforts], dtype=int)
        self.stores = {e.owner for e in flat.energetics if not e.energy.is_zero()}
        ports = assembly.express(stack([flat.levels[0][j] for j in (
            *(j for b in bonds for j in b.efforts), *(j for b in bonds for j in b.flows))]))
        self._slopes = Buffered(ca.Function("slopes", list(assembly.arguments), [
            jacobian(stack([ports, assembly.alg]), stack([x, z]))]), sparse=True)

    def shares(self, point: Point, modes: Sequence[Mode]) -> list[ModalShares]:
        """The shares of the components in each of the modes near a point."""
        if not modes or not self.owners or any(mode.z is not None for mode in modes):
            return [ModalShares(left_out=self.left_out) for _ in modes]
        efforts, flows = self.motions(point, modes)
        products = np.conj(efforts) * flows
        power, sizes = (np.zeros((len(self.owners), len(modes)), kind) for kind in (complex, float))
        np.add.at(power, self._owner, products)
        np.add.at(sizes, self._owner, np.abs(products))
        return [self._of_mode(mode, dict(zip(self.owners, power[:, k].tolist(), strict=True)), float(sizes[:, k].sum()))
                for k, mode in enumerate(modes)]

    def motions(self, point: Point, modes: Sequence[Mode]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """The complex amplitudes of the efforts and of the flows at `ports` (ports, modes), in SI, for the vectors of the
        modes near a point."""
        slopes, = self._slopes(*point.values()).values()
        n_x, n_b = len(point.x), len(self._owner)
        v = np.column_stack([mode.right for mode in modes]) * self.assembly.x_nominal[:, None]
        at_ports, loops = slopes[:2 * n_b], slopes[2 * n_b:]
        changes = at_ports[:, :n_x] @ v
        if len(point.z):
            changes = changes - at_ports[:, n_x:] @ solved(loops[:, n_x:], loops[:, :n_x] @ v)
        return changes[:n_b], changes[n_b:]

    def _of_mode(self, mode: Mode, power: Mapping[str, complex], size: float) -> ModalShares:
        if not mode.value:
            return ModalShares(left_out=self.left_out)
        s = mode.value
        energy = {name: abs(p.imag) / s.imag if mode.swings else abs(p / s) for name, p in power.items()
                  if name in self.stores}
        # if positions move without a store, the sum of cancelling forces is a rounding error, not an energy
        if sum(energy.values()) <= ROUNDING * size / abs(s):
            return ModalShares(left_out=self.left_out)
        lost = {name: p.real - s.real * energy.get(name, 0.0) for name, p in power.items()} if mode.swings else {}
        return ModalShares(_shares(energy), _shares(lost), self.left_out)


def energy_shares(assembly: Assembly, point: Point, modes: Sequence[Mode]) -> list[ModalShares]:
    """The shares of the components in each of the modes."""
    return ModalEnergies(assembly).shares(point, modes)


def _shares(sizes: Mapping[str, float]) -> dict[str, float]:
    """Values over the sum of the positive ones, the largest first, without values at rounding level."""
    total = sum(size for size in sizes.values() if size > 0)
    relevant = [(name, size) for name, size in sizes.items() if abs(size) > ROUNDING * total]
    return {name: size / total for name, size in sorted(relevant, key=lambda item: -abs(item[1]))} if total > 0 else {}
