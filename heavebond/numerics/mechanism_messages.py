"""Why a mechanism has no start: its links do not meet, initial conditions contradict, or it begins at a dead centre."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, either, listing
from heavebond.equations.constraint_projection import ConstraintEquations, constraint_equations
from heavebond.equations.redundant_loops import open_loop
from heavebond.equations.state_selection import InitialGuess
from heavebond.language.symbols import uniform
from heavebond.numerics.dae import Array, Assembly

# configurations from which one is sought in which the links meet, the first the guess of the diagram
TRIALS = 6
# largest constraint, in usual sizes, that counts as kept by a least-squares solution
CLOSED = 1e-6
# singular value over the largest below which constraints may depend on each other (the square root of `CLOSED` is left of an
# angle there), and by how many times it grows beside a dead centre; at other places it is the same
LOST, GROWS = 1e-5, 100.0
# share of the largest residual or direction from which a part is named
SHARE = 0.05
MOST_NAMED = 8
# positions besides the start at which a loop must be redundant, and the way to these in usual sizes
MOVED, WAY = 2, 0.2


def unassembled(assembly: Assembly) -> Problem | None:
    """The error for initial conditions of a mechanism that require an impossible configuration; None if the configuration
    exists, or if no constraint of the diagram depends on the configuration."""
    equations = _equations(assembly)
    if equations is None:
        return None
    guess = InitialGuess(assembly.flat)(assembly.p)
    fixed_unknowns = [j for j, fixed in equations.fixed().items() if fixed]
    residual = _closest(equations, guess, assembly.p, fixed_unknowns)[1]
    if not np.abs(residual).max() >= CLOSED:  # kept, or without a value
        return None
    if fixed_unknowns and np.abs(_closest(equations, guess, assembly.p, [])[1]).max() < CLOSED:
        names = [equations.flat.unknowns[j].name for j in fixed_unknowns]
        conditions = equations.flat.expanded.model.initial.conditions
        places = [c.value.place for name, c in conditions.items() if equations.flat.names.get(name) in fixed_unknowns]
        return Problem("start-failed", f"the links of the mechanism do not meet where {listing(names, MOST_NAMED)} "
                       f"{'has the value' if len(names) == 1 else 'have the values'} given under `initial:`",
                       places[-1] if places else None,
                       "Each degree of freedom has one initial position. Make the others guesses: "
                       f"`{names[-1]}: ~ ...`.")
    if problem := open_loop(assembly.flat):
        return problem
    worst = [k for k in np.argsort(-np.abs(residual))[:5] if abs(residual[k]) > SHARE * np.abs(residual).max()]
    notes = [f"{e.owner}: {e.text}" for e in (equations.flat.equations[equations.rows[k]] for k in worst)]
    leaf = equations.flat.expanded.leaves.get(equations.flat.equations[equations.rows[worst[0]]].owner)
    return Problem("start-failed", f"the mechanism cannot be assembled: {_parts(equations, residual)} do not meet in any "
                   "position that was tried", leaf.place if leaf else None, "Check the lengths of the links and the "
                   "positions of the fixed points; these equations are then left over.", tuple(notes))


def dead_centre(assembly: Assembly) -> Problem | None:
    """The error for a dead centre: the constraints of a mechanism depend on each other at its start, but not near it. None
    if this is not so."""
    equations = _equations(assembly)
    if equations is None:
        return None
    guess = InitialGuess(assembly.flat)(assembly.p)
    y, residual = _closest(equations, guess, assembly.p, [j for j, fixed in equations.fixed().items() if fixed])
    return _dead_centre(equations, y, assembly.p) if np.abs(residual).max() < CLOSED else None


def redundant_loop(assembly: Assembly) -> Problem | None:
    """The error for redundant constraints: they depend on each other at the start of a mechanism and at positions to which
    it moves, as with three parallel cranks. None if not, or if at the start only (a dead centre)."""
    equations = _equations(assembly)
    if equations is None:
        return None
    guess, p = InitialGuess(assembly.flat)(assembly.p), assembly.p
    y, residual = _closest(equations, guess, p, [j for j, fixed in equations.fixed().items() if fixed])
    if not np.abs(residual).max() < CLOSED:
        return None

    def dependent(at: Array) -> tuple[Array, Array]:
        left, values, right = np.linalg.svd(equations.at(at, p)[1])
        rank = int((values > LOST * values[0]).sum())
        return left[:, rank:], right[rank:]

    relations, motions = dependent(y)
    if not relations.size or not motions.size:
        return None
    for trial in range(MOVED):
        direction = motions.T @ np.array([uniform(trial, k) - 0.5 for k in range(len(motions))])
        begin = y + WAY * equations.nominal * direction / np.abs(direction).max()
        near = _least(equations, begin, p, range(len(y)))
        if not np.abs(equations.at(near, p)[0]).max() < CLOSED or dependent(near)[0].shape[1] < relations.shape[1]:
            return None
    flat, leaves = equations.flat, equations.flat.expanded.leaves
    share = np.abs(relations).max(axis=1)
    owners = [flat.equations[i].owner for i, s in zip(equations.rows, share, strict=True) if s > SHARE * share.max()]
    # a part with one port holds its end of the loop; links have more constraints than joints
    parts = [part for part in dict.fromkeys(owners) if part in leaves and len(leaves[part].component.ports) > 1]
    number = Counter(flat.equations[i].owner for i in equations.rows)
    parts.sort(key=lambda part: -number[part])
    links = [part for part in parts if number[part] == number[parts[0]]] if parts else []
    domain = next((d for part in links for port in leaves[part].component.ports
                   if (d := flat.domains.get(f"{part}.{port}")) is not None), None)
    elastic = f", or put {domain.compliance} in line with one of them" if domain is not None else ""
    number_of = f"{relations.shape[1]} of their constraints {'is' if relations.shape[1] == 1 else 'are'}"
    return Problem("rank-lost", f"the loops of {listing(parts, MOST_NAMED)} hold the same position more than once: "
                   f"{number_of} redundant in every position, so that no equation determines the forces in them",
                   leaves[links[0]].place if links else None,
                   f"Take one of {either(links[:MOST_NAMED], 'or')} out, with its joints{elastic}.")


def _equations(assembly: Assembly) -> ConstraintEquations | None:
    constraints = assembly.reduced.choices.constraints
    unknown = {s.element_hash() for level in assembly.flat.levels for s in level}
    changing = any(s.element_hash() in unknown for s in ca.symvar(constraints.values))
    return constraint_equations(assembly.flat, constraints.order) if changing else None


def _closest(equations: ConstraintEquations, guess: Array, p: Array, fixed: Sequence[int]) -> tuple[Array, Array]:
    """The unknowns, those given kept, at the least sum of squares of the constraints, and the residuals there; the best of
    several searches from turned links."""
    columns = list(equations.columns)
    begin = guess[columns]
    free = [k for k, j in enumerate(columns) if j not in fixed]
    if not free:
        return begin, equations.at(begin, p)[0]
    turning = np.array([k in free and equations.flat.unknowns[j].unit.text == "rad" for k, j in enumerate(columns)])
    solutions: list[tuple[Array, Array]] = []
    for trial in range(TRIALS):
        turned = turning * [2 * np.pi * (uniform(trial, k) - 0.5) * (trial > 0) for k in range(len(columns))]
        y = _least(equations, begin + turned, p, free)
        solutions.append((y, equations.at(y, p)[0]))
        if np.abs(solutions[-1][1]).max() < CLOSED:
            break
    return min(solutions, key=lambda pair: float(np.nan_to_num(np.abs(pair[1]), nan=np.inf).max()))


def _least(equations: ConstraintEquations, begin: Array, p: Array, free: Sequence[int]) -> Array:
    """The unknowns at the least sum of squares near `begin`, all but those `free` kept."""
    from scipy.optimize import least_squares

    sizes = equations.nominal[free]

    def placed(z: Array) -> Array:
        y = begin.copy()
        y[free] = z * sizes
        return y

    def residuals(z: Array) -> Array:
        return equations.at(placed(z), p)[0]

    def jacobian(z: Array) -> Array:
        return equations.at(placed(z), p)[1][:, free]

    if not np.isfinite(residuals(begin[free] / sizes)).all():
        return begin
    return placed(least_squares(residuals, begin[free] / sizes, jacobian).x)


def _parts(equations: ConstraintEquations, shares: Array) -> str:
    """The parts whose constraints take part in a direction (m,)."""
    owners = dict.fromkeys(equations.flat.equations[i].owner for i, share in zip(equations.rows, np.abs(shares), strict=True)
                           if share > SHARE * np.abs(shares).max())
    return listing(owners, MOST_NAMED)


def _dead_centre(equations: ConstraintEquations, y: Array, p: Array) -> Problem | None:
    def singular(at: Array) -> tuple[float, Array]:
        left, values, _ = np.linalg.svd(equations.at(at, p)[1], full_matrices=False)
        return (float(values[-1] / values[0]), left[:, -1]) if len(values) == len(equations.rows) else (0.0, left[:, -1])

    value, direction = singular(y)
    aside = y + equations.nominal * np.array([2 * uniform(1, k) - 1 for k in range(len(y))])
    if value > LOST or singular(aside)[0] < GROWS * value:
        return None
    return Problem("rank-lost", f"the mechanism begins at a dead centre: the constraints of {_parts(equations, direction)} "
                   "depend on each other at the start", None, "From there it could move in two directions. Begin near "
                   "this position, change a length slightly, or add an element that decides the direction (a spring).")
