"""The constraints of a mechanism, and the projection of a guess on them: a configuration in which it can be assembled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.equations.flatten import Flat
from heavebond.language.symbols import split, stack

Array = NDArray[np.float64]
# largest constraint, in usual sizes, that counts as kept, and Newton steps after which a guess is given up
KEPT, STEPS = 1e-9, 50
# usual sizes by which an unknown gives way, relative to those without a value: with an initial value, with a guess
ASKED, GUESSED = 1e-4, 0.1
# more equations than these make the dense least-squares problem slower than the assembly
LARGE = 1000


@dataclass(frozen=True)
class ConstraintEquations:
    """The differentiated equations without a derivative in them: constraints between positions, and between velocities.

    rows, columns: the equations and the unknowns in them; nominal: the usual sizes of these
    function:      residuals (m,) and Jacobian (m, n) of the unknowns (n,), parameters, time and rate
    """

    flat: Flat
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    nominal: Array
    function: ca.Function

    def at(self, y: Array, p: Array) -> tuple[Array, Array]:
        """Residuals (m,) and Jacobian (m, n) in usual sizes of the unknowns, each row divided by its largest entry."""
        residual, jacobian = self.function(y, p, 0.0, 1.0)
        scaled = np.array(jacobian) * self.nominal
        size = np.maximum(np.abs(scaled).max(axis=1, initial=0.0), 1e-300)
        with np.errstate(over="ignore", invalid="ignore"):  # rows without a value are left out
            return np.array(residual).ravel() / size, scaled / size[:, None]

    def fixed(self) -> dict[int, bool]:
        """The unknowns with an initial condition, and whether this is more than a guess."""
        conditions, names = self.flat.expanded.model.initial.conditions, self.flat.names
        return {names[name]: not c.guess for name, c in conditions.items() if names.get(name) in self.columns}

    def projected(self, guess: Array, p: Array) -> Array | None:
        """The guess of all unknowns, changed by as little as the constraints allow; None if no solution is found.

        Gauss-Newton steps of least norm in usual sizes, dy = W (J W)^+ (-r); an unknown with an initial value has a small
        weight in W and so keeps it."""
        fixed = self.fixed()
        weight = np.array([1.0 if j not in fixed else ASKED if fixed[j] else GUESSED for j in self.columns])
        whole, y = guess.copy(), guess[list(self.columns)]
        for _ in range(STEPS):
            residual, jacobian = self.at(y, p)
            # the distance of two points has no derivative where they coincide: it follows once they have moved
            usable = np.isfinite(residual) & np.isfinite(jacobian).all(axis=1)
            satisfied = bool(np.abs(residual[usable]).max(initial=0.0) < KEPT)
            if satisfied and not usable.all():
                return None
            if satisfied:
                whole[list(self.columns)] = y
                unknowns = ((self.flat.unknowns[j], whole[j]) for j in self.columns)
                return whole if all(u.low <= value <= u.high for u, value in unknowns) else None
            y = y + self.nominal * weight * np.linalg.lstsq(
                jacobian[usable] * weight, -residual[usable], rcond=1e-10)[0]
        return None


def constraint_equations(flat: Flat, order: Sequence[int]) -> ConstraintEquations | None:
    """The constraints of a diagram from the number of differentiations of each equation; None if there are none, if they are
    too many for a dense Jacobian, or if they depend on a measured input."""
    n = len(flat.unknowns)
    rows = tuple(i for i, k in enumerate(order) if k and all(packed < n for packed, _ in flat.entries[i]))
    if not rows or len(rows) > LARGE:
        return None
    residuals = flat.residual_column[list(rows)]
    if {s.element_hash() for s in ca.symvar(residuals)} & {s.element_hash() for k in flat.driving for s in split(k.symbols)}:
        return None
    columns = tuple(sorted({packed for i in rows for packed, _ in flat.entries[i]}))
    y = stack(flat.levels[0][j] for j in columns)
    function = ca.Function("constraints", [y, flat.p, flat.time, flat.rate], [residuals, ca.jacobian(residuals, y)])
    return ConstraintEquations(flat, rows, columns, np.array([flat.unknowns[j].nominal for j in columns]), function)
