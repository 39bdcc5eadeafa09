"""Loops of frames that constrain motions more than once: which constraints are redundant, and the equations without them.

A loop gives three equations for the rotation and three for the translation (see `frames`), g(c) = 0 for the coordinates c of
its joints. If the rank r of G = dg/dc is less than the number of equations at all positions of the machine, as with four
parallel hinges, the others are redundant: each motion satisfies them, and the reactions lambda in G'lambda are not
determined. r equations are kept. Each omitted equation is replaced by the condition that its reaction, a component of the
force or of the moment at the part that closes the loop, is zero. The power does not change, because the relative motion is
zero.

The rank is determined at the configuration nearest to the initial values, and at configurations to which the machine moves
from there. The equations are written in the axes of the part that closes the loop, because the redundant directions of
parallel or concurrent hinges are constant in these axes. Of all selections of r equations, the one with the best condition
at the worst of these configurations is kept.

J. Garcia de Jalon, E. Bayo: Kinematic and Dynamic Simulation of Multibody Systems, Springer 1994, section 3.4 (redundant
constraints); J. Wittenburg: Dynamics of Multibody Systems, Springer 2008, doi:10.1007/978-3-540-73914-2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import comb

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, Problem, listing
from heavebond.core.presentation import readable
from heavebond.equations.flatten import Flat
from heavebond.equations.frames import FrameTree, Key, RedundantLoop
from heavebond.equations.matching import components_of
from heavebond.equations.state_selection import InitialGuess, pivot_columns
from heavebond.equations.variation import incidence
from heavebond.language.external_functions import jacobian, substituted_in_turn
from heavebond.language.symbols import stack, uniform
from heavebond.language.template import FrameForm, conjugate, quaternion_product, rotated

Array = NDArray[np.float64]
# CLOSED: largest residual (rad, and sizes of the loop) of a satisfied constraint. LOST: singular value, relative to the
# largest, below which constraints are dependent. Dimensions are given to six digits or more.
CLOSED, LOST = 1e-6, 1e-5
ASKED = 1e-3  # weight of a coordinate with an initial value, so that the search changes it least
STEPS = 60  # of the search for a configuration
TRIALS = 6  # start configurations of the search
MOVED, WAY = 3, 0.25  # configurations in each direction of motion, and the distance of two (rad, sizes of the loop)
MOST_CHOICES = 100  # sets of equations, up to which all are compared
MOST_ROWS = 300  # equations of loops, above which redundancy is not examined
REDUNDANT = ", and it has more constraints than motions"
PARALLEL = 1e-5  # angle of axes that counts as zero, rad


@dataclass(frozen=True)
class _Closure:
    """A relation that closes a loop: its equations, its residuals in the axes of its port (rad, m), the reactions of the
    equations with their names, and the orientation of the port."""

    key: Key
    port: str
    rows: tuple[int, ...]
    residuals: ca.SX
    reactions: ca.SX
    names: tuple[str, ...]
    orientation: ca.SX


def without_redundancies(flat: Flat) -> Flat:
    """The flat model without redundant constraints of loops. Raises ModelError for a loop with redundant constraints that
    does not close in any position."""
    for loops in _loops(flat):
        flat = loops.reduced(flat)
    return flat


def open_loop(flat: Flat) -> Problem | None:
    """The error for a loop without redundant constraints that closed in none of the trials; None if all loops close."""
    for loops in _loops(flat):
        c, closed = loops.start()
        if not closed:
            return loops.open(c, "")
    return None


def _loops(flat: Flat) -> list[_Loops]:
    """The loops of a flat model in groups with common coordinates; empty if redundant constraints were omitted before, or if
    a part has both ports on one node (another error)."""
    if flat.frames is None or not flat.frames.loops or flat.redundancies:
        return []
    tree, frame_rows = flat.frames, flat.frame_rows
    closures = [_closure(flat, key, tree, frame_rows) for key in tree.loops]
    if sum(len(c.rows) for c in closures) > MOST_ROWS or any(len(parts) == 1 for parts in tree.loops.values()):
        return []
    # the orientations and positions along the trees in terms of the coordinates of joints
    symbols, definitions = list[ca.SX](), list[ca.SX]()
    for quantity, keys in (("rotation", tree.rotations), ("translation", tree.translations)):
        for key in keys:
            path, number = key
            relation, forms = flat.expanded.leaves[path].component.frames[number], tree.forms[key]
            forward = (forms.rotation if quantity == "rotation" else forms.translation) is FrameForm.FORWARD
            port = relation.b if forward else relation.a
            domain = flat.domains[f"{path}.{port}"]
            members = domain.orientation if quantity == "rotation" else domain.positions
            for row, member in zip(frame_rows[(key, quantity)], members, strict=False):
                symbol = flat.levels[0][flat.names[f"{path}.{port}.{member}"]]
                symbols.append(symbol)
                # r_b - (r_a + shift) for r_b and for r_a, q - ... for each orientation
                sign = 1 if quantity == "translation" and not forward else -1
                definitions.append(sign * ca.substitute(flat.residuals[row], symbol, 0))
    stacked = ca.vertcat(*(c.residuals for c in closures))
    axes = ca.vertcat(*(c.orientation for c in closures))
    _, (stacked, axes) = substituted_in_turn(stack(symbols), stack(definitions), [stacked, axes])
    rows = [k for k, c in enumerate(closures) for _ in c.rows]
    unknown = {s.element_hash(): j for j, s in enumerate(flat.levels[0])}
    occurring = [[unknown[s.element_hash()] for s in ca.symvar(stacked[[i for i, k in enumerate(rows) if k == n]])
                  if s.element_hash() in unknown] for n in range(len(closures))]
    coordinates = [[j for j in inside if flat.unknowns[j].role != "signal"] for inside in occurring]
    return [_Loops(flat, tree, tuple(closures[k] for k in group), stacked[[i for i, k in enumerate(rows) if k in group]],
                   ca.vertcat(*(axes[4*k:4*k + 4] for k in group)), members)
            for group, members in components_of(coordinates, len(flat.unknowns)) if group]


def _closure(flat: Flat, key: Key, tree: FrameTree, frame_rows: Mapping[tuple[Key, str], range]) -> _Closure:
    path, number = key
    port = flat.expanded.leaves[path].component.frames[number].b
    domain = flat.domains[f"{path}.{port}"]
    effort_of = {flow: effort for effort, flow in domain.pairs}

    def vector(members: Sequence[str]) -> ca.SX:
        return stack(flat.levels[0][flat.names[f"{path}.{port}.{member}"]] for member in members)

    q = vector(domain.orientation)
    rows, residuals, reactions, names = list[int](), ca.SX(0, 1), ca.SX(0, 1), list[str]()
    forms = tree.forms[key]
    for quantity, form, flows in (("rotation", forms.rotation, domain.vectors[domain.turning]),
                                  ("translation", forms.translation, [domain.rate(m) for m in domain.positions])):
        if form is FrameForm.CLOSING:
            rows += frame_rows[(key, quantity)]
            residual = flat.residual_column[list(frame_rows[(key, quantity)])]
            # the closing rotation is already in the axes of the port, as half the angles
            residuals = stack([residuals, 2*residual if quantity == "rotation" else rotated(conjugate(q), residual)])
            efforts = [effort_of[flow] for flow in flows]
            reactions = stack([reactions, rotated(conjugate(q), vector(efforts))])
            names += efforts
    return _Closure(key, f"{path}.{port}", tuple(rows), residuals, reactions, tuple(names), q)


class _Loops:
    """The closures of loops that share coordinates. Their residuals h (m,) are a function of the coordinates (n,) of joints.
    Angles are in rad, lengths in sizes of the loop."""

    def __init__(self, flat: Flat, tree: FrameTree, closures: Sequence[_Closure], residuals: ca.SX, turns: ca.SX,
                 members: Sequence[int]):
        self.flat, self.tree, self.closures, self.members, self.turns = flat, tree, closures, list(members), turns
        self.expressions = residuals
        known = stack(k.symbols for k in flat.driving)
        self.arguments = [flat.columns[0], flat.p, flat.time, flat.rate, known]
        self.coordinates = flat.columns[0][self.members]
        self.function = ca.Function("loops", self.arguments, [residuals, jacobian(residuals, self.coordinates)])
        self.guess, self.stated = self._guess()
        self.unit = np.ones(residuals.numel())  # 1 for an angle, the size of the loop for a length
        self.sizes = np.ones(len(self.members))
        lengths = np.array([name in _lengths(flat, c) for c in closures for name in c.names], dtype=bool)
        sliding = np.array([flat.unknowns[j].unit.text == "m" for j in self.members], dtype=bool)
        arms = self.at(np.array(self.guess)[self.members])[1][np.ix_(lengths, ~sliding)]
        size = float(np.abs(arms).max(initial=0.0)) or 1.0
        self.unit[lengths], self.sizes[sliding] = size, size
        self.turning = np.array([flat.unknowns[j].unit.text == "rad" for j in self.members], dtype=bool)

    def at(self, c: Array) -> tuple[Array, Array]:
        """Residuals (m,) and Jacobian (m, n) at coordinates (n,) in their sizes."""
        y = self.guess.copy()
        y[self.members] = c * self.sizes
        h, jacobian_of_h = self.function(y, self._p, 0.0, 1.0, np.zeros(self.arguments[4].numel()))
        return np.array(h).ravel() / self.unit, np.array(jacobian_of_h) * self.sizes / self.unit[:, None]

    @cached_property
    def _p(self) -> Array:
        return np.array([q.value for q in self.flat.parameters])

    def _guess(self) -> tuple[Array, set[int]]:
        """The initial guess of all unknowns, and the unknowns whose values the diagram states: initial values, given inputs,
        and unknowns that follow from these by equations such as phi = d.phi."""
        flat, guess = self.flat, InitialGuess(self.flat)(self._p)
        conditions = {flat.names[name]: c for name, c in flat.expanded.model.initial.conditions.items()
                      if name in flat.names}
        stated = {j for j, c in conditions.items() if not c.guess}
        given = {i: flat.names[e.subject] for i, e in enumerate(flat.equations)
                 if e.role.value == "given" and e.subject in flat.names}
        self._set(guess, given)
        stated |= set(given.values())
        for targets in self._following(stated):
            self._set(guess, targets)
            stated |= set(targets.values())
        for targets in self._following(stated | set(conditions)):
            self._set(guess, targets)
        return guess, stated

    def _following(self, known: set[int]) -> list[dict[int, int]]:
        """The unknowns that follow from known ones by equations of two unknowns, in successive passes; each pass is a
        mapping from the equation to its unknown."""
        flat, reached, waves = self.flat, set(known), list[dict[int, int]]()
        rows = {i: [packed for packed, _ in entries] for i, entries in enumerate(flat.entries)
                if len(entries) == 2 and max(packed for packed, _ in entries) < len(flat.unknowns)}
        while True:
            new = {next(j for j in row if j not in reached): i for i, row in rows.items()
                   if sum(j in reached for j in row) == 1}
            if not new:
                return waves
            waves.append({i: j for j, i in new.items()})
            reached |= set(new)

    def _set(self, values: Array, targets: Mapping[int, int]) -> None:
        """Solve the equations of `targets` for their unknowns by a Newton step, in `values`."""
        if not targets:
            return
        symbols = stack(self.flat.levels[0][j] for j in targets.values())
        rows = self.flat.residual_column[list(targets)]
        slopes = stack(jacobian(rows[k], symbols[k]) for k in range(len(targets)))
        function = ca.Function("set", self.arguments, [rows, slopes], {"allow_free": True})
        if function.has_free():
            return
        residual, slope = (np.array(v).ravel() for v in function(values, self._p, 0.0, 1.0,
                                                                 np.zeros(self.arguments[4].numel())))
        for k, j in enumerate(targets.values()):
            if slope[k] and np.isfinite(residual[k] / slope[k]):
                values[j] -= residual[k] / slope[k]

    def closed(self, c: Array, weight: Array | float = 1.0) -> Array:
        """The coordinates at the least sum of squares of the constraints near c, by the method of Levenberg and Marquardt.
        Its parameter is the square of the residual, so that it converges quadratically also if the solutions are a set (N.
        Yamashita, M. Fukushima, Computing Supplement 15 (2001) 239-249, doi:10.1007/978-3-7091-6217-0_18). Coordinates with
        a small `weight` move less."""
        (h, slopes), damping = self.at(c), 1.0
        for _ in range(STEPS):
            if not (np.isfinite(h).all() and np.isfinite(slopes).all()):
                return c
            if np.abs(h).max(initial=0.0) < 1e-14:
                break
            shift = damping * min(float(h @ h), 1.0)
            step = weight * np.linalg.lstsq(np.vstack([slopes * weight, np.sqrt(shift)*np.eye(len(c))]),
                                            np.concatenate([-h, np.zeros(len(c))]), rcond=1e-12)[0]
            step *= min(1.0, 0.5/max(float(np.abs(step).max(initial=0.0)), 1e-300))
            trial = self.at(c + step)
            if trial[0] @ trial[0] < h @ h:
                c, (h, slopes), damping = c + step, trial, max(damping/4, 1e-3)
            elif damping > 1e12 or np.abs(step).max(initial=0.0) < 1e-15:
                break
            else:
                damping *= 8
        return c

    def start(self) -> tuple[Array, bool]:
        """The closed configuration nearest to the guess and True; else the best configuration of searches from turned
        joints, and whether it is closed. Coordinates with a stated value keep it if possible."""
        begin = self.guess[self.members] / self.sizes
        weight = np.array([ASKED if j in self.stated else 1.0 for j in self.members])
        best, least = begin, np.inf
        for trial in range(2*TRIALS):
            held = weight if trial < TRIALS else np.ones(len(begin))
            turned = [2*np.pi*(uniform(trial, k) - 0.5)*(trial % TRIALS > 0) for k in range(len(begin))]
            c = self.closed(begin + turned * self.turning * (held == 1.0), held)
            error = float(np.abs(self.at(c)[0]).max(initial=0.0))
            if error < least:
                best, least = c, error
            if least < CLOSED:
                break
        return best, least < CLOSED

    def configurations(self, c: Array) -> list[Array]:
        """The closed configuration c, and configurations to which the machine moves from c in both directions."""
        reached = [c]
        for direction in (1.0, -1.0):
            at, way = c, np.zeros(len(c))
            for _ in range(MOVED):
                _, values, right = np.linalg.svd(self.at(at)[1])
                motions = right[int((values > LOST*max(values.max(initial=0.0), 1e-300)).sum()):]
                if not len(motions):
                    return reached
                # continue in the same direction; the first direction is a combination of all motions
                along = motions.T @ (motions @ way) if way.any() else \
                    direction * motions.T @ np.array([1 + uniform(3, k) for k in range(len(motions))])
                moved = self.closed(at + WAY * along / max(float(np.abs(along).max()), 1e-300))
                if np.abs(self.at(moved)[0]).max(initial=0.0) > CLOSED:
                    break
                way, at = moved - at, moved
                reached.append(at)
        return reached

    def reduced(self, flat: Flat) -> Flat:
        """The flat model without the redundant constraints of these loops."""
        m = len(self.unit)
        c, closed = self.start()
        if not closed:
            # more constraints than motions, at this configuration and at others
            if all(_rank(self.at(c + 0.3*np.array([uniform(9 + trial, k) - 0.5 for k in range(len(c))]))[1]) < m
                   for trial in range(3)):
                raise ModelError([self.open(c, REDUNDANT)])
            return flat
        slopes = [self.at(at)[1] for at in self.configurations(c)]
        rank = max(_rank(s) for s in slopes)
        if rank == m:
            return flat
        if rank == len(c) and any(self._odd(k, c) for k in range(len(self.closures))):
            raise ModelError([self.open(c, REDUNDANT)])
        kept = _independent([s for s in slopes if _rank(s) == rank], rank)
        entries, residuals, redundancies = list(flat.entries), ca.SX(flat.residual_column), list(flat.redundancies)
        changed, equations, first = list[int](), list(flat.equations), 0
        for closure in self.closures:
            numbers = range(first, first + len(closure.rows))
            first += len(closure.rows)
            if out := [k - numbers[0] for k in numbers if k not in kept]:
                for k, row in enumerate(closure.rows):
                    residuals[row] = closure.reactions[k] if k in out else closure.residuals[k]
                    if k in out:
                        equations[row] = replace(equations[row], label=f"redundant: {closure.names[k]} is zero",
                                                 text=f"{closure.port}.{closure.names[k]} = 0 in the axes of {closure.port}")
                changed += closure.rows
                sized = closure.residuals / ca.DM(self.unit[list(numbers)])
                redundancies.append(RedundantLoop(
                    self._joints(self.tree.loops[closure.key]), closure.key[0], closure.port,
                    tuple(closure.names[k] for k in out), sized[out], self._configuration(c)))
        n, unknown = len(flat.unknowns), {s.element_hash(): j for j, s in enumerate(flat.levels[0])}
        occurring = sorted({unknown[h] for s in ca.symvar(residuals[changed]) if (h := s.element_hash()) in unknown})
        rows = incidence(residuals[changed], flat.columns, occurring, flat.constant_hashes, flat.bounds)
        for row, entries_of_row in zip(changed, rows, strict=True):
            entries[row] = [(packed, kind) for packed, kind in entries_of_row if packed < n]
        return replace(flat, equations=tuple(equations), residual_column=residuals, entries=tuple(entries),
                       redundancies=tuple(redundancies))

    def _configuration(self, c: Array) -> dict[int, float]:
        """The values of the coordinates of a configuration, and of the unknowns that the coordinates determine."""
        values = self.guess.copy()
        values[self.members] = c * self.sizes
        waves = self._following(set(self.members))
        for targets in waves:
            self._set(values, targets)
        known = [*self.members, *(j for targets in waves for j in targets.values())]
        return {j: float(values[j]) for j in known if j not in self.stated}

    def _joints(self, parts: Sequence[str]) -> tuple[str, ...]:
        """The joints of a loop, which are its parts with a free motion; all parts if none has one."""
        owners = {self.flat.unknowns[j].name.rpartition(".")[0] for j in self.members}
        owners |= {owner.rpartition(".")[0] for owner in owners}  # roll.phi of a CardanJoint
        owners |= {part for part in parts if any(frame.a and (frame.turn is None or frame.shift is None)
                                                 for frame in self.flat.expanded.leaves[part].component.frames)}
        return tuple(part for part in parts if part in owners) or tuple(parts)

    def open(self, c: Array, redundant: str) -> Problem:
        """The error for loops that do not close in any position: the loop with the largest gap, and its cause: a joint with
        a different axis, or links that leave the plane of the loop."""
        h, first, gaps = self.at(c)[0], 0, list[tuple[float, int, float, float]]()
        for k, closure in enumerate(self.closures):
            part = h[first:first + len(closure.rows)]
            lengths = np.array([name in _lengths(self.flat, closure) for name in closure.names], dtype=bool)
            size = float(self.unit[first:first + len(closure.rows)].max(initial=1.0))
            turn, gap = (float(np.linalg.norm(part[chosen])) for chosen in (~lengths, lengths))
            gaps.append((max(turn, gap), k, turn, gap*size))
            first += len(closure.rows)
        _, k, turn, gap = max(gaps)
        closure = self.closures[k]
        joints = self._joints(self.tree.loops[closure.key])
        if gap < CLOSED*self.unit.max() and turn < CLOSED:
            k = next(k for k in range(len(self.closures)) if self._odd(k, c))
            closure, said = self.closures[k], "closes in isolated positions only and cannot move"
            joints = self._joints(self.tree.loops[closure.key])
        else:
            apart = listing([f"{readable(gap, 'm', 3)}"] * (gap > 1e-6) + [f"{np.degrees(turn):.3g} deg"] * (turn > 1e-6))
            said = f"does not close: in the closest position found, its ends at {closure.key[0]} are {apart} apart"
        axes = self._axes(k, c)
        axis = next(iter(axes.values()), np.zeros(3))
        fixed = [part for part in self.tree.loops[closure.key]
                 if any(not frame.a and frame.turn is not None and frame.shift is not None
                        for frame in self.flat.expanded.leaves[part].component.frames)]
        ends = " and ".join(fixed)
        if len(fixed) > 1 and not axes:
            advice = f"{ends} are fixed: remove one of them, or change their places and angles such that the loop closes."
        elif len(fixed) > 1:
            advice = f"Check the lengths of its links, the axes of its joints and the places of {ends}, which are fixed."
        else:
            advice = "Check the lengths of its links and the axes of its joints."
        if odd := self._odd(k, c):
            others = [a for a in axes if a != odd]
            angle = np.degrees(np.arcsin(min(1.0, float(np.linalg.norm(np.cross(axes[odd], axes[others[0]]))))))
            advice = f"The axes of {listing(others)} are parallel; the axis of {odd} deviates by {angle:.3g} deg: make it " \
                "parallel."
        elif len(axes) > 2 and all(np.linalg.norm(np.cross(axis, other)) < PARALLEL for other in axes.values()):
            apart_along = abs(float(axis @ self._gap(k, c)))
            advice = f"All axes of its joints are parallel. Along the axes, its ends are {readable(apart_along, 'm', 3)} " \
                "apart: the lengths along the axes must add up to zero." if apart_along > 0.5*gap else \
                "All axes of its joints are parallel. Across the axes, the lengths of its links do not allow a closed loop."
        leaf = self.flat.expanded.leaves[odd or closure.key[0]]
        if redundant and axes:
            advice += "\nOr replace a joint by a SphericalJoint or a CylindricalJoint, so that each motion is " \
                "constrained once."
        return Problem("loop-open", f"the loop {listing(joints, 12)} {said}{redundant}", leaf.place, advice)

    def _odd(self, k: int, c: Array) -> str:
        """The joint of a loop whose axis is not parallel to the other axes, if the other axes are parallel; else empty."""
        axes = self._axes(k, c)
        odd = [a for a in axes if len(axes) > 3 and all(
            np.linalg.norm(np.cross(axes[b], axes[d])) < PARALLEL for b in axes for d in axes if a not in (b, d))]
        return odd[0] if len(odd) == 1 else ""

    def _gap(self, k: int, c: Array) -> Array:
        """The distance (m) between the ends of a loop, in the axes of the fixed frame."""
        first = sum(len(other.rows) for other in self.closures[:k]) + len(self.closures[k].rows) - 3
        q = ca.Function("q", self.arguments, [self.turns[4*k:4*k + 4]])
        y = self.guess.copy()
        y[self.members] = c * self.sizes
        q_at = np.array(q(y, self._p, 0.0, 1.0, np.zeros(self.arguments[4].numel()))).ravel()
        h = (self.at(c)[0] * self.unit)[first:first + 3]
        return np.asarray(h + 2*np.cross(q_at[1:], np.cross(q_at[1:], h) + q_at[0]*h))

    def _axes(self, k: int, c: Array) -> dict[str, Array]:
        """The axes of the joints with one angle in a loop, in the fixed frame: the angular velocity of an end of the loop
        per rate of each coordinate."""
        closure = self.closures[k]
        if len(closure.rows) < 6:  # a rotation or a translation alone
            return {}
        first = sum(len(other.rows) for other in self.closures[:k])
        q, v = self.turns[4*k:4*k + 4], self.expressions[first:first + 3]/2
        ends = [q, quaternion_product(q, ca.vertcat(ca.sqrt(1 - ca.dot(v, v)), v))]
        found = ca.Function("ends", self.arguments, [e for end in ends for e in (end, jacobian(end, self.coordinates))])
        y = self.guess.copy()
        y[self.members] = c * self.sizes
        values = [np.array(v) for v in found(y, self._p, 0.0, 1.0, np.zeros(self.arguments[4].numel()))]
        axes: dict[str, Array] = {}
        for column, j in enumerate(self.members):
            if not self.turning[column]:
                continue
            for q_end, slope in (values[:2], values[2:]):
                rate, q_at = slope[:, column], q_end.ravel()
                w = 2*(q_at[0]*rate[1:] - rate[0]*q_at[1:] - np.cross(rate[1:], q_at[1:]))
                if np.linalg.norm(w) > 1e-9:
                    axes.setdefault(self.flat.unknowns[j].name.rpartition(".")[0], w/np.linalg.norm(w))
        return axes


def _lengths(flat: Flat, closure: _Closure) -> set[str]:
    """The names of the reactions of the length constraints of a closure."""
    domain = flat.domains[closure.port]
    flows = {domain.rate(member) for member in domain.positions}
    return {effort for effort, flow in domain.pairs if flow in flows}


def _rank(slopes: Array) -> int:
    values = np.linalg.svd(slopes, compute_uv=False) if slopes.size else np.zeros(0)
    return int((values > LOST*max(values.max(initial=0.0), 1e-300)).sum())


def _independent(slopes: Sequence[Array], rank: int) -> set[int]:
    """The `rank` rows of the Jacobians (m, n) with the best condition at the worst Jacobian."""
    m = len(slopes[0])
    if comb(m, rank) <= MOST_CHOICES:
        choices: list[Sequence[int]] = list(combinations(range(m), rank))
    else:
        choices = list(dict.fromkeys(tuple(sorted(pivot_columns(s.T)[:rank])) for s in slopes))

    def worst(choice: Sequence[int]) -> float:
        if not choice:
            return 1.0
        return min(float(np.linalg.svd(s[list(choice)], compute_uv=False)[rank - 1]
                         / np.linalg.svd(s, compute_uv=False)[rank - 1]) for s in slopes)

    return set(max(choices, key=lambda choice: round(worst(tuple(choice)), 6)))
