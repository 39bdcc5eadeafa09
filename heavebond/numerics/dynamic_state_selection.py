"""Dynamic state selection: several choices of states for one diagram, and the change between them during a run.

If constraints relate unknowns, some of these are states and the others depend on them (`state_selection`). A choice of
states is valid in a part of the motion only: the height of a pendulum follows from its horizontal position until the rod is
horizontal. A choice of states with its dependent unknowns is a chart in the sense of geometry. All charts of a diagram are
reductions of the same equations in the same symbols, so that in each of them the states of another are expressions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from heavebond.core.errors import listing
from heavebond.equations.matching import block_lower_triangular, maximum_matching
from heavebond.equations.state_selection import Part, chosen_states, parts_of, strain
from heavebond.language.symbols import stack
from heavebond.numerics.co_simulation import foreign_parts
from heavebond.numerics.dae import Array, Assembly, build
from heavebond.numerics.start_equations import Point


@dataclass(frozen=True)
class StateSelectionConstants:
    """The constants of the dynamic state selection. Strain: ratio of the changes of the dependent unknowns to the changes of
    the states.

    max_strain: strain above which other states are chosen. Origin: with 3 a pendulum turns 18 degrees before; errors of
        its states are three times as large in the others. Doubled: fewer changes of states, larger errors between them.
    enough_strain: strain that suffices where the integrator fails or the end lies before the next point. Origin: half
        of `max_strain`. Doubled: such changes happen only at `max_strain`.
    folded: least singular value of constraints, over the largest, below which they depend on each other soon. Origin:
        three degrees before a dead centre. Doubled: the message names a dead centre sooner.
    improvement: factor by which another choice must be less strained. Origin: without it choices alternate on a
        diagonal. Doubled (in its excess over 1): fewer changes.
    """

    max_strain: float = 3.0
    enough_strain: float = 1.5
    folded: float = 0.05
    improvement: float = 1.2


STATE_SELECTION = StateSelectionConstants()


@dataclass(frozen=True)
class ChoiceCondition:
    """The strain of a chart at points (N,), and the signs (n_parts, N) that change where the chart ends."""

    worst: Array
    signs: Array


class StateChoice:
    """One choice of states: an assembly, the parts of its constraints that may become singular in a run, and their entries
    (equation, unknown) that vary."""

    def __init__(self, assembly: Assembly):
        self.assembly = assembly
        self.constraints = assembly.reduced.choices.constraints
        self.moving = _moving(assembly)
        parts = parts_of(self.constraints, assembly.reduced.states) if self.moving else []
        self.parts = [part for part in parts if len(part.columns) > len(part.rows) and not self._follows_for_ever(part)]
        inside = {j for part in self.parts for j, _ in part.columns}
        # what the user asked for counts at the start, and where one choice is as good as it was all the way
        self._asked = self.constraints.settable | (self.constraints.preferred - inside)
        self._passages: dict[int, _StateTransform] = {}

    def _follows_for_ever(self, part: Part) -> bool:
        """True if the dependent unknowns of a part follow from its states in every position: they are solved block by block
        with constant coefficients. Example: the points of a link follow from its angle."""
        place = {j: k for k, (j, _) in enumerate(part.dummies)}
        pattern = [[place[j] for j in self.constraints.rows.get(i, []) if j in place] for i in part.rows]
        matching = maximum_matching(pattern, len(place))
        if -1 in matching:
            return False
        unknown = [part.dummies[k][0] for k in matching]
        return not any((part.rows[r], unknown[s]) in self.moving
                       for block in block_lower_triangular(pattern, matching) for r in block for s in block)

    @cached_property
    def _values(self) -> ca.Function:
        return ca.Function("H", list(self.assembly.arguments), [self.assembly.express(self.constraints.values)])

    def numbers(self, columns: Sequence[Array]) -> Array:
        """The values of the constraints (n, N) at points given by columns (t, x, z, p, u, rate)."""
        return np.array(self._values(*columns)).reshape(len(self.constraints.entries), columns[0].shape[1])

    def strain(self, columns: Sequence[Array]) -> ChoiceCondition:
        """The strain of this chart at points given by columns; zero for a chart without parts."""
        numbers = self.numbers(columns)
        strains = [strain(part, numbers) for part in self.parts]
        worst = np.array([worst for worst, _ in strains]).reshape(len(strains), numbers.shape[1])
        return ChoiceCondition(worst.max(axis=0, initial=0.0), np.array([sign for _, sign in strains]).reshape(worst.shape))

    def folded(self, point: Point) -> bool:
        """True if the constraints are nearly dependent at a point, for every choice of states."""
        numbers = self.numbers(point.columns())
        values = [np.linalg.svd(part.matrices(numbers, part.columns)[0], compute_uv=False) for part in self.parts]
        return any(v[-1] < STATE_SELECTION.folded * v[0] for v in values if np.all(np.isfinite(v)))

    def better(self, point: Point) -> list[tuple[int, int]] | None:
        """A choice of states with less strain at a point; None if there is none."""
        numbers = self.numbers(point.columns())[:, 0]
        states = chosen_states(self.constraints, np.where(np.isfinite(numbers), numbers, 0.0), self._asked)
        free = {j for j, order in states if order == 0}
        mine = {j for j, order in self.assembly.reduced.states if order == 0}
        if set(states) == set(self.assembly.reduced.states) or (self.constraints.settable & mine) - free:
            return None
        worst = _worst(parts_of(self.constraints, states), numbers)
        return states if worst * STATE_SELECTION.improvement < _worst(self.parts, numbers) else None

    def values_in(self, target: StateChoice, columns: Sequence[Array]) -> Array:
        """The other chart's states and algebraic unknowns (n_x + n_z, N) at points of this one given by columns."""
        return self._to(target).values(columns)

    def along_in(self, target: StateChoice, columns: Sequence[Array], dx: Array, dz: Array, dp: Array) -> Array:
        """The derivatives of `values_in` (n_x + n_z, N) along directions dx (n_x, N), dz (n_z, N) and dp (n_p, N) of this
        chart's states, algebraic unknowns and parameters."""
        return self._to(target).along(columns, dx, dz, dp)

    def _to(self, target: StateChoice) -> _StateTransform:
        if id(target) not in self._passages:
            self._passages[id(target)] = _StateTransform(self.assembly, target.assembly)
        return self._passages[id(target)]

    def why(self, alternative: StateChoice, point: Point) -> str:
        """The reason why another chart has less strain at a point, in words."""
        before, after = self.assembly.reduced.states, alternative.assembly.reduced.states
        worst, name = self.strain(point.columns()).worst[0], self.assembly.reduced.name
        removed, new = (listing(name(c) for c in states if c not in common) for states, common in (
            (before, after), (after, before)))
        grade = f"{worst:.3g} times" if np.isfinite(worst) else "infinitely"
        return f"{new} moves {grade} as much as {removed}, from which it would follow"


class StateChoices:
    """The charts of a diagram, the one that it was assembled with first; others are made when they are needed."""

    def __init__(self, assembly: Assembly):
        self.home = StateChoice(assembly)
        self._made = {frozenset(assembly.reduced.states): self.home}

    @property
    def needed(self) -> bool:
        """True if a constraint that determines the states varies in a run; otherwise one chart serves for the whole run.
        Diagrams with an FMU keep their states."""
        return bool(self.home.parts) and not foreign_parts(self.home.assembly.flat)

    def with_states(self, states: list[tuple[int, int]]) -> StateChoice:
        """The chart with these states; ModelError if events set a variable that is not among them."""
        key = frozenset(states)
        if key not in self._made:
            solved, home = self.home.assembly.in_other_states, self.home.assembly
            if key not in solved:
                solved[key] = build(home.reduced.choices.solve(states))
            self._made[key] = StateChoice(solved[key].with_sizes(home.sizes))
        return self._made[key]


class _StateTransform:
    """The states and algebraic unknowns of one assembly as functions of another's arguments."""

    def __init__(self, begin: Assembly, end: Assembly):
        arguments = list(begin.arguments)
        _, x, z, p, _, _ = arguments
        target = begin.express(stack([end.reduced.x, end.reduced.z]))
        self._values = ca.Function("there", arguments, [target])
        directions = [ca.SX.sym("d", a.numel()) for a in (x, z, p)]
        self._along = ca.Function("along", [*arguments, *directions],
                                  [ca.jtimes(target, stack([x, z, p]), stack(directions))])

    def values(self, columns: Sequence[Array]) -> Array:
        return np.array(self._values(*columns)).reshape(-1, columns[0].shape[1])

    def along(self, columns: Sequence[Array], dx: Array, dz: Array, dp: Array) -> Array:
        return np.array(self._along(*columns, dx, dz, dp)).reshape(-1, columns[0].shape[1])


def _moving(assembly: Assembly) -> set[tuple[int, int]]:
    """The entries of the constraints that change in a run."""
    flat, constraints = assembly.flat, assembly.reduced.choices.constraints
    if not constraints.entries:
        return set()
    still = flat.constant_hashes | {flat.rate.element_hash()}
    moving = stack(s for s in ca.symvar(constraints.values) if s.element_hash() not in still)
    if not moving.numel():
        return set()
    depends = ca.which_depends(constraints.values, moving, 1, True)
    return {entry for entry, does in zip(constraints.entries, depends, strict=True) if does}


def _worst(parts: Sequence[Part], numbers: Array) -> float:
    return float(max((strain(part, numbers[:, None])[0][0] for part in parts), default=0.0))
