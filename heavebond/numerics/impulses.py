"""Impacts: the changes of all states by the impulse of a force at an instant.

A force J that is a held variable in the equations changes the rates of the states, x' = f(t, x, z, p, J) with 0 = g(t, x,
z, p, J). Over an instant all other forces are negligible, so that an impulse P of it changes the states by B P,

    B = f_J - f_z g_z^-1 g_J,        P = (new speed - speed) / (c B),      speed = c(x, z): c B = c_x B - c_z g_z^-1 g_x B.

Momentum is conserved with all inertias that the force reaches, through levers, gears and closed loops. An event with
`impulse: J` is written here as one that sets every state with B != 0. F. Pfeiffer, C. Glocker, Multibody Dynamics with
Unilateral Contacts, Wiley 1996, chapter 8.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from heavebond.core.errors import ModelError, Problems
from heavebond.equations.events import FlatEvent, FlatReset, Impulse
from heavebond.equations.matching import maximum_matching
from heavebond.equations.reduce import Reduced
from heavebond.language.symbols import split, stack


def with_impulses(reduced: Reduced) -> Reduced:
    """The same equations, the events with an impulse written as events that set states; ModelError if an impulse changes
    no state, or where the speed that it is to change follows from forces."""
    flat = reduced.flat
    if not any(event.impulse for event in flat.events):
        return reduced
    loops, problems = _Loops.of(reduced), Problems()
    events = tuple(event if event.impulse is None else _written_out(event, event.impulse, reduced, loops, problems)
                   for event in flat.events)
    problems.raise_as(ModelError)
    return replace(reduced, flat=replace(flat, events=events))


def _written_out(event: FlatEvent, impulse: Impulse, reduced: Reduced, loops: _Loops, problems: Problems) -> FlatEvent:
    force, part = reduced.flat.p[impulse.force], event.name.rpartition(".")[0]
    at = reduced.flat.expanded.leaves[part].place
    speed = reduced.express(reduced.flat.levels[0][impulse.unknown])
    reached = loops.reached_by(force)
    along_z = loops.response(reached, ca.jacobian(reduced.alg, force))
    along = ca.sparsify(ca.jacobian(reduced.ode, force) + ca.jacobian(reduced.ode, reduced.z) @ along_z)
    # the unknowns from which the speed follows
    inside = {s.element_hash() for s in ca.symvar(speed)}
    needed = {j for j, s in enumerate(split(loops.reduced.z)) if s.element_hash() in inside}
    while more := set().union(*(loops.needs[j] for j in needed)) - needed:
        needed |= more
    if needed & reached or ca.which_depends(speed, force, 1, False)[0]:
        problems.add("impulse-on-massless", f"an impact of '{part}' changes {impulse.name} by an impulse, and no body with "
                     "a mass keeps that speed", at, hint="Give each body that meets another a mass (Mass, Inertia ...).")
        return event
    z_along_x = loops.response(needed, ca.jacobian(reduced.alg, reduced.x) @ along)
    change = ca.sparsify(ca.jacobian(speed, reduced.x) @ along + ca.jacobian(speed, reduced.z) @ z_along_x)
    if not change.nnz():
        problems.add("impulse-without-effect", f"an impact of '{part}' changes {impulse.name} by an impulse, and nothing "
                     "gives way to it", at, hint="One of its two sides has to be a body that moves freely; here both stand "
                     "still, follow a prescribed motion, or are one rigid body.")
        return event
    size = (reduced.express(impulse.value) - speed) / change
    place, resets = event.place, [reset for reset in event.resets if reset.held is not None]
    for (unknown, order), symbol, share in zip(reduced.states, split(reduced.x), split(ca.densify(along)), strict=True):
        if order == 0 and not share.is_zero():
            resets.append(FlatReset(reduced.name((unknown, 0)), unknown, None, symbol + share * size, place))
    return replace(event, resets=tuple(resets), impulse=replace(impulse, size=size))


def yielding(reduced: Reduced) -> list[str]:
    """The events of other parts whose conditions an impulse may make true: sticking friction, bodies at rest."""
    loops, names = _Loops.of(reduced), []
    conditions = [(e, reduced.express(e.indicator)) for e in reduced.flat.events if e.indicator is not None]
    for event in (e for e in reduced.flat.events if e.impulse is not None):
        force = reduced.flat.p[event.impulse.force] if event.impulse else ca.SX(0)
        affected = stack([force, *(reduced.z[j] for j in loops.reached_by(force))])
        part = event.name.rpartition(".")[0]
        names += [e.name for e, condition in conditions if e.name.rpartition(".")[0] != part
                  and any(ca.which_depends(condition, affected, 1, False))]
    return list(dict.fromkeys(names))


@dataclass(frozen=True)
class _Loops:
    """The algebraic equations 0 = alg, one for each unknown of z, with the dependencies between the unknowns."""

    reduced: Reduced
    row: tuple[int, ...]
    needs: tuple[frozenset[int], ...]

    @classmethod
    def of(cls, reduced: Reduced) -> _Loops:
        n = reduced.z.numel()
        number = {s.element_hash(): k for k, s in enumerate(split(reduced.z))}
        used = [[number[h] for s in ca.symvar(row) if (h := s.element_hash()) in number] for row in split(reduced.alg)]
        row = [0] * n
        for k, column in enumerate(maximum_matching(used, n)):
            row[column] = k
        return cls(reduced, tuple(row), tuple(frozenset(used[row[j]]) for j in range(n)))

    def reached_by(self, symbol: ca.SX) -> set[int]:
        """The unknowns that change with a symbol."""
        touched = ca.which_depends(self.reduced.alg, symbol, 1, True) if self.row else []
        reached = {j for j, row in enumerate(self.row) if touched[row]}
        while more := {j for j, needs in enumerate(self.needs) if needs & reached} - reached:
            reached |= more
        return reached

    def response(self, unknowns: set[int], changes: ca.SX) -> ca.SX:
        """The change of z (n_z, 1) for a change of the residuals (n_z, 1): -g_z^-1 moved, restricted to some unknowns."""
        response = ca.SX(len(self.row), 1)
        if not unknowns:
            return response
        columns = sorted(unknowns)
        rows = [self.row[j] for j in columns]
        matrix = ca.jacobian(self.reduced.alg[rows], self.reduced.z[columns])
        response[columns] = -ca.solve(matrix, ca.densify(changes[rows]))
        return ca.sparsify(response)
