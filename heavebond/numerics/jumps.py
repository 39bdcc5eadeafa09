"""Events as equations: their conditions, the values that they set, and the derivatives of both by parameters.

Between events x' = f(t, x, z, p, h), 0 = g(t, x, z, p, h); the held variables h are elements of the parameter vector. At
an instant T an event sets some of x and h to r(t, x, z, p, h), taken before it. Along a direction in the parameters, with X
= dx/dp, H = dh/dp and a condition c(t, x, z, p, h) = 0 that is met at T,

    dT = -(c_x X + c_z Z + c_p + c_h H) / (c_t + c_x x' + c_z z'),
    dr = r_x (X + x' dT) + r_z (Z + z' dT) + r_p + r_h H + r_t dT       (all before T),
    X after = dr - x' dT for what is set, X + (x' before - x' after) dT for the rest;   H after = dr.

With `at: t_s` dT is the derivative of that parameter, with `every: T_s` it is k dT_s at the k-th instant. Integrals are
states that nothing sets. Hiskens and Pai, Trajectory sensitivity analysis of hybrid systems, 2000, doi:10.1109/81.828574.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, SimulationError, listing
from heavebond.core.presentation import readable
from heavebond.equations.buffered import Buffered
from heavebond.equations.events import Breakaway
from heavebond.equations.flatten import EquationRole
from heavebond.equations.lost_rank import losses
from heavebond.equations.structural_messages import undecided
from heavebond.language.symbols import stack
from heavebond.numerics.co_simulation import Partners
from heavebond.numerics.dae import Array, Assembly, solved_loops
from heavebond.numerics.event_constants import EVENTS
from heavebond.numerics.pointwise import evaluated
from heavebond.numerics.start_equations import Point
from heavebond.numerics.update_order import Updates


@dataclass(frozen=True)
class PointSensitivity:
    """The derivatives of a point along m directions: states (n_x, m), integrals (n_q, m), parameters and held variables
    (n_p, m), and the pieces of delayed variables (n_u, m)."""

    x: Array
    q: Array
    p: Array
    u: Array


class EventEquations:
    """The conditions, instants and resets of an assembly, compiled once; `quadratures` are the integrands of the integrals,
    in the arguments of the assembly and `factors`."""

    def __init__(self, assembly: Assembly, quadratures: ca.SX, factors: ca.SX):
        self.assembly, self.events = assembly, assembly.flat.events
        t, x, z, p, u, _ = arguments = list(assembly.arguments)
        self.conditions = [i for i, event in enumerate(self.events) if event.indicator is not None]
        indicators = assembly.express(stack(e.indicator for e in self.events if e.indicator is not None))
        resets = [reset for event in self.events for reset in event.resets]
        self.order = assembly.update_order
        self._updates: dict[bytes, _CompiledUpdates] = {}
        ends = np.cumsum([len(event.resets) for event in self.events]).tolist()
        self.rows = [range(end - len(event.resets), end) for end, event in zip(ends, self.events, strict=True)]
        states = {column: k for k, column in enumerate(assembly.reduced.states)}
        self.states = [None if r.unknown is None else states[(r.unknown, 0)] for r in resets]
        self.held = [r.held for r in resets]
        self.has_loops = bool(z.numel())
        self.partners = Partners(assembly, self.rows)
        self._indicators = ca.Function("indicators", arguments, [indicators])
        self._looked = assembly.once("indicators and their rates", lambda: _looked(assembly, indicators))
        self._rates = ca.Function("rates", [*arguments, factors], [assembly.ode, quadratures])
        self._alg = ca.Function("alg", arguments, [assembly.alg])
        self._by_z = ca.Function("by_z", arguments, [ca.densify(ca.jacobian(assembly.alg, z))])
        directions = [ca.SX.sym("d", a.numel()) for a in (t, x, z, p, u)]
        moving = 5 if assembly.flat.delays else 4
        derivatives = ca.jtimes(stack([assembly.alg, indicators]), stack([t, x, z, p, u][:moving]),
                                stack(directions[:moving]))
        parts = ca.vertsplit(derivatives, np.cumsum([0, z.numel(), indicators.numel()]).tolist())
        self._along = ca.Function("along", [*arguments, *directions], parts)
        first, period = (assembly.express(stack(e.first for e in self.events)),
                         assembly.express(stack(ca.SX(0) if e.period is None else e.period for e in self.events)))
        direction = ca.SX.sym("d", p.numel())
        impulses = [event.impulse for event in self.events]
        self._impulses = ca.Function("impulses", arguments, [assembly.express(stack(
            ca.SX(0) if i is None or i.size is None else i.size for i in impulses))])
        self._forces = [None if i is None else i.force for i in impulses]
        self.breakaways = [(i, event.breakaway) for i, event in enumerate(self.events) if event.breakaway]
        self._limits = {breakaway.limit for _, breakaway in self.breakaways}
        self._accelerations = ca.Function("accelerations", arguments, [assembly.express(stack(
            assembly.flat.levels[1][breakaway.speed] for _, breakaway in self.breakaways))])
        self._instants = ca.Function("instants", [p, direction], [
            first, period, ca.jtimes(first, p, direction), ca.jtimes(period, p, direction)])
        self._differentiated = differentiated(assembly)
        followed = stack([assembly.flat.levels[0][j] for j in self._differentiated])
        self._followed = ca.Function("followed", arguments, [assembly.express(followed)])
        self._loops = solved_loops(z, stack([a for a in arguments if a is not z]), assembly.alg, EVENTS.jump_iterations) \
            if self.has_loops else None

    # -- instants --------------------------------------------------------------------------------------------------
    def instants(self, p: Array, dp: Array) -> tuple[Array, Array, Array, Array]:
        """First instant and period (n_e,) of every event, and their derivatives (n_e, m) along dp (n_p, m)."""
        n, m = len(self.events), dp.shape[1]
        first, period = (np.array(v).ravel() for v in self._instants(p, np.zeros(len(p)))[:2])
        if not m:
            return first, period, np.zeros((n, 0)), np.zeros((n, 0))
        derivatives = self._instants(np.tile(p[:, None], (1, m)), dp)[2:]
        return first, period, np.array(derivatives[0]).reshape(n, m), np.array(derivatives[1]).reshape(n, m)

    def indicators(self, t: Array, x: Array, z: Array, p: Array, u: Array) -> tuple[Array, Array]:
        """The indicators (n_c, N) of the conditions and their rates along the motion, at N points given by columns; p
        (n_p,) is the same at all of them."""
        n = len(t)
        columns = (t[None, :], x, z, np.tile(p[:, None], (1, n)), u, np.ones((1, n)))
        values, rising = evaluated(self.assembly, self._looked, columns)
        if not self.has_loops or np.isfinite(rising).all():
            return values, rising
        rates = np.array(self.assembly.rates(*columns)[0]).reshape(len(x), n)
        return values, self._directed(columns, np.ones((1, n)), rates, np.zeros((len(p), n)), np.zeros_like(u))[0]

    def _directed(self, columns: Sequence[Array], dt: Array, dx: Array, dp: Array, du: Array) -> tuple[Array, Array]:
        """The derivatives of indicators (n_c, N) and algebraic unknowns (n_z, N) along directions (., N), each at its own
        point."""
        n = dx.shape[1]
        n_z = len(columns[2])
        dz: Array = np.zeros((n_z, n))
        if self.has_loops:
            along_z = np.array(self._along(*columns, dt, dx, dz, dp, du)[0]).reshape(n_z, n)
            by_z = np.array(self._by_z(*columns)).reshape(n_z, n, n_z).transpose(1, 0, 2)
            try:
                dz = np.asarray(-np.linalg.solve(by_z, along_z.T[:, :, None])[:, :, 0].T, float)
            except np.linalg.LinAlgError:
                raise self._undecided(columns, by_z) from None
        return np.array(self._along(*columns, dt, dx, dz, dp, du)[1]).reshape(-1, n), dz

    def _undecided(self, columns: Sequence[Array], by_z: Array, when: str = "at") -> SimulationError:
        """The message on undetermined unknowns if d(algebraic equations)/dz (N, n_z, n_z) is singular at the first of N
        points."""
        k = int(np.argmin(np.abs(np.linalg.slogdet(by_z)[0])))
        t, x, z, p, u, _ = (column[:, k] for column in columns)
        rank_losses = losses(self.assembly.reduced.system, self.assembly.point(float(t[0]), x, z, p, u))
        return undecided(self.assembly.flat, rank_losses, self.assembly.algebraic_names, f"{when} t = {t[0]:.6g} s")

    def _updates_at(self, p: Array) -> _CompiledUpdates:
        """The updates with parameters p (n_p,)."""
        key = (p[self.order.zeros] == 0).tobytes()
        if key not in self._updates:
            self._updates[key] = _CompiledUpdates(self.assembly, self.order.at(p))
        return self._updates[key]

    def _new_values(self, point: Point, fired: Sequence[int]) -> Array:
        """The new values (n_r,) of all resets where the events `fired` happen at one instant."""
        updates = self._updates_at(point.p)
        happening = np.zeros(len(self.events))
        happening[list(fired)] = 1.0
        # an FMU computes its outputs from the inputs of its last step: they are known before the other updates
        outputs = self.partners.outputs(point, fired) if self.partners.parts else {}
        for row, value in outputs.items():
            if (held := self.held[row]) is not None:
                point = replace(point, p=np.where(np.arange(len(point.p)) == held, value, point.p))
        for pair in updates.apart:
            if happening[list(pair)].all():
                rows = [row for event in pair for row in self.rows[event]]
                raise SimulationError([self.order.problem(rows)])
        values = np.asarray(updates.values(*point.values(), happening)["o0"]).ravel()
        values[list(outputs)] = list(outputs.values())
        return values

    def _new_along(self, point: Point, after: Array, sensitivity: PointSensitivity, x_rate: Array, fired: Sequence[int],
                   delays: Sequence[Array]) -> Array:
        """The derivatives (n_r, m) of the new values of the events `fired` along directions, one rank after the other: an
        update reads what others assign with its derivative. `after` are the parameters p after the instant."""
        updates, m = self._updates_at(point.p), sensitivity.x.shape[1]
        new, d_after, columns = np.zeros((len(self.held), m)), sensitivity.p.copy(), point.columns(m)
        after = np.tile(after[:, None], (1, m))
        for rank in updates.ranks:
            for event, delay in zip(fired, delays, strict=True):
                rows = [row for row in self.rows[event] if row in rank]
                if not rows:
                    continue
                dx = sensitivity.x + np.outer(x_rate, delay)
                dz = self._directed(columns, delay[None, :], dx, sensitivity.p, sensitivity.u)[1]
                derivatives = np.array(updates.along(
                    *columns, after, delay[None, :], dx, dz, sensitivity.p, sensitivity.u, d_after)).reshape(-1, m)
                new[rows] = derivatives[rows]
            for event in fired:
                for row in self.rows[event]:
                    if row in rank and (held := self.held[row]) is not None:
                        d_after[held] = new[row]
        return new

    def delays(self, point: Point, sensitivity: PointSensitivity, condition: int, slope: float) -> Array:
        """dT (m,) of the condition-th condition, met at a point where its indicator rises with `slope`."""
        m = sensitivity.x.shape[1]
        if not m or not slope:
            return np.zeros(m)
        indicators, _ = self._directed(point.columns(sensitivity.x.shape[1]), np.zeros(m)[None, :], sensitivity.x,
                                       sensitivity.p, sensitivity.u)
        return np.asarray(-indicators[condition] / slope)

    def check_continuous(self, before: Point, after: Point, happened: Sequence[int]) -> None:
        """Raise SimulationError if events cause a jump of a variable that the equations differentiate, such as a prescribed
        position or speed of a mass: its rate is infinite, and dependent values would be wrong without a warning. If an event
        sets states, the law of the impact is specified by the event."""
        if not self._differentiated or any(self.states[row] is not None for i in happened for row in self.rows[i]):
            return
        first, then = (np.array(self._followed(*point.values())).ravel() for point in (before, after))
        unknowns = [self.assembly.flat.unknowns[j] for j in self._differentiated]
        jumped = [k for k, u in enumerate(unknowns) if not abs(then[k] - first[k]) <= EVENTS.continuous * u.nominal]
        if jumped:
            event_names = " and ".join(f"'{self.events[i].name}'" for i in happened)
            names = listing((unknowns[k].name for k in jumped), 4)
            raise SimulationError([Problem(
                "event-impulse", f"at t = {after.t:.6g} s {event_names} makes {names} jump, whose rate other equations need",
                unknowns[jumped[0]].place, "That takes an infinite force, flow, voltage or current. Let it change in a "
                "finite time: a Ramp, a PolynomialMotion, or a SecondOrderLag behind what jumps.", tuple(
                    f"{unknowns[k].name}: {readable(first[k], unknowns[k].unit.text)} before, "
                    f"{readable(then[k], unknowns[k].unit.text)} after" for k in jumped[:4]))])

    # -- resets ----------------------------------------------------------------------------------------------------
    def settled(self, point: Point, fired: Sequence[int]) -> Point:
        """The point after events with its algebraic unknowns consistent; SimulationError if there are none."""
        if self._loops is None:
            return point
        arguments = np.concatenate([[point.t], point.x, point.p, point.u, [point.rate]])
        solved = replace(point, z=np.array(self._loops(point.z, arguments)).ravel())
        cause = " and ".join(f"'{self.events[i].name}'" for i in fired) or "the jump of a delayed variable"
        if not np.isfinite(solved.z).all():
            # raise SimulationError with the undetermined unknowns if the equations lose their rank at a point
            by_z = np.array(self._by_z(*point.values()))
            if np.linalg.slogdet(by_z)[0] == 0:
                raise self._undecided(point.columns(), by_z[None], (f"after {cause} at"))
        residual = np.abs(np.array(self._alg(*solved.values())).ravel())
        gradient = np.abs(np.array(self._by_z(*solved.values()))).max(axis=1) * self.assembly.z_nominal.max()
        if not np.all(residual <= 1e-6 * gradient):
            raise SimulationError([Problem(
                "event-inconsistent", f"after {cause} at t = {point.t:.6g} s no {listing(self.assembly.algebraic_names, 4)} "
                "satisfies the equations", self.events[fired[0]].place if fired else None, "A valve that shuts a "
                "volume-free line does this, or a state that was set to a value that a constraint forbids.")])
        return solved

    def rates(self, point: Point, factors: Array) -> tuple[Array, Array]:
        """x' (n_x,) and the rates of the integrals (n_q,)."""
        x, q = self._rates(*point.values(), factors)
        return np.array(x).ravel(), np.array(q).ravel()

    def along_z(self, point: Point, sensitivity: PointSensitivity) -> Array:
        """dz/dp (n_z, m) at a consistent point."""
        m = sensitivity.x.shape[1]
        if not self.has_loops or not m:
            return np.zeros((len(point.z), m))
        still = np.zeros((1, m)), np.zeros((len(point.z), m))
        residual = np.array(self._along(*point.columns(m), still[0], sensitivity.x, still[1], sensitivity.p,
                                        sensitivity.u)[0])
        return np.asarray(-np.linalg.solve(np.array(self._by_z(*point.values())), residual.reshape(-1, m)))

    def yielding(self, point: Point, fired: Sequence[int], touch: float) -> tuple[Point, list[int]]:
        """The point after contacts have yielded to the impulses of the events `fired`, and the events of these contacts:
        sticking friction transmits a finite force, and a body that rests on another cannot pull it. Their conditions are
        evaluated under the force whose impulse within `touch` (s) is that of the event."""
        yielded: list[int] = []
        for event in (e for e in fired if self._forces[e] is not None):
            for _ in range(EVENTS.max_cascades):
                impulse = float(np.array(self._impulses(*point.values())).ravel()[event])
                if not impulse or not np.isfinite(impulse):
                    break
                p = point.p.copy()
                p[self._forces[event]] = impulse/touch
                loaded = self.settled(replace(point, p=p), fired)
                before, under = (np.array(self._indicators(*at.values())).ravel() for at in (point, loaded))
                turned = (under > 0) & (before <= 0)
                more = [i for c, i in enumerate(self.conditions) if turned[c] and i not in (*fired, *yielded)]
                if not more:
                    break
                values = self._new_values(loaded, more)
                for i in more:
                    held = self._set(point, values, i).p
                    point = replace(point, p=held)
                point, yielded = self.settled(point, more), yielded + more
        return point, yielded

    def breaking(self, point: Point, fired: Sequence[int]) -> tuple[Point, list[int]]:
        """The point with the contacts at their limits, and the events that happen: the events `fired` and the breakaways of
        other contacts.

        A contact breaks away only if the bodies then move. With all contacts at their limits reduced to `EVENTS.reduced` of
        their forces, a contact moves if its speed changes by more than `EVENTS.held` of its change in the case that no other
        contact sticks. A contact that does not move remains at its limit, and the others carry the rest of the load. If
        one moves against its force, and one of them was at its limit before, the load has turned since: all of them stick
        again and share the load anew. This is the plastic limit analysis of W. Prager, P. G. Hodge, Theory of Perfectly
        Plastic Solids, 1951. If all of them have just reached their limits, only some of them break away (see `_loose`).
        Of several transitions of a state, the first in its list remains.
        """
        names = {self.events[i].name for i in fired}
        fired = [i for i in fired if names.isdisjoint(self.events[i].yields_to)]
        if len(self._limits) <= 1:
            return point, list(fired)
        p = point.p.copy()
        tried = {b.limit: (k, i, b) for k, (i, b) in enumerate(self.breakaways) if i in fired or p[b.limit] == b.direction}
        ordinary = [i for i in fired if all(i != event for event, _ in self.breakaways)]
        limits = self._limits
        if not tried:
            return point, list(fired)

        def change(loose: bool) -> Array:
            """The change of the accelerations (n_b,) if the contacts at their limits give way."""
            changes = []
            for share in (1.0, EVENTS.reduced):
                values = p.copy()
                values[[limit for limit in limits if loose]] = EVENTS.reduced
                for _, _, b in tried.values():
                    values[b.limit] = b.direction * share
                at = self.settled(replace(point, p=values), fired)
                changes.append(np.array(self._accelerations(*at.values())).ravel())
            return np.asarray(changes[1] - changes[0])

        held, free = change(False), change(True)
        moving = {limit: abs(held[k]) >= EVENTS.held * abs(free[k]) for limit, (k, _, _) in tried.items()}
        if any(moving[limit] and b.direction * held[k] < 0 for limit, (k, _, b) in tried.items()):
            if p[list(tried)].any():
                p[list(tried)] = 0.0
                return self.settled(replace(point, p=p), fired), ordinary
            tried = self._loose(point, tried, EVENTS.held * np.abs(free))
            held = change(False)
            moving = {limit: abs(held[k]) >= EVENTS.held * abs(free[k]) for limit, (k, _, _) in tried.items()}
        for limit, (_, _, b) in tried.items():
            p[limit] = b.direction
        return (self.settled(replace(point, p=p), fired),
                [*ordinary, *(i for limit, (_, i, _) in tried.items() if moving[limit])])

    def _loose(self, point: Point, tried: dict[int, tuple[int, int, Breakaway]], small: Array
               ) -> dict[int, tuple[int, int, Breakaway]]:
        """The contacts among those that exceed their limits that break away: each of them then moves with its force, and
        no other exceeds its limit. Accelerations (n_b,) below `small` are zero.

        The accelerations are linear in the forces, with a positive definite matrix. This is therefore a linear
        complementarity problem with one solution, if stiction and friction are equal. It is solved by least-index pivoting:
        K. G. Murty, Note on a Bard-type scheme for solving the complementarity problem, Opsearch 11 (1974) 123-130.
        """
        loose: list[int] = []
        exceeds = {condition: c for c, condition in enumerate(self.conditions)}
        for _ in range(EVENTS.max_cascades):
            broken = [tried[limit][1] for limit in tried if limit in loose]
            at = self.settled(self._set(point, self._new_values(point, broken), *broken), broken)
            accelerations = np.array(self._accelerations(*at.values())).ravel()
            excess = np.array(self._indicators(*at.values())).ravel()
            wrong = [limit for limit, (k, i, b) in tried.items() if (
                b.direction * accelerations[k] < -small[k] if limit in loose else excess[exceeds[i]] > 0)]
            if not wrong:
                break
            loose = [limit for limit in tried if (limit in loose) != (limit == wrong[0])]
        return {limit: tried[limit] for limit in tried if limit in loose}

    def fire(self, point: Point, sensitivity: PointSensitivity, fired: Sequence[int], delays: Sequence[Array],
             factors: Array,
             touch: float) -> tuple[Point, PointSensitivity, list[int]]:
        """The point and its derivatives after the events `fired` at one instant, with the delays dT (m,) of each, and the
        events that their impulses, within `touch` (s), set off (see `yielding`).

        The new values are computed in the order of `update_order`. If coincident events have different derivatives by a
        parameter, the derivative assumes the order of declaration.
        """
        begun = point
        point, yielded = self.yielding(point, fired, touch)
        values, final = self._new_values(point, fired), point
        if not sensitivity.x.shape[1]:
            final = self.settled(self._set(final, values, *fired), fired)
            self.partners.give_inputs(final, fired)
            return final, sensitivity, yielded
        x, q, p = sensitivity.x.copy(), sensitivity.q.copy(), sensitivity.p.copy()
        x_rate, _ = before = self.rates(begun, factors)
        new = self._new_along(point, self._set(point, values, *fired).p, sensitivity, x_rate, fired, delays)
        for event, delay in zip(fired, delays, strict=True):
            final = self.settled(self._set(final, values, event), fired)
            after = self.rates(final, factors)
            x += np.outer(before[0] - after[0], delay)
            q += np.outer(before[1] - after[1], delay)
            for row in self.rows[event]:
                state, held = self.states[row], self.held[row]
                if state is not None:
                    x[state] = new[row] - after[0][state] * delay
                if held is not None:
                    p[held] = new[row]
            before = after
        return final, PointSensitivity(x, q, p, sensitivity.u), yielded

    def would_change(self, point: Point, event: int) -> bool:
        """True if the event would change a value at a point."""
        values = self._new_values(point, [event])
        after, sizes = self._set(point, values, event), self.assembly.x_nominal
        states_change = np.any(np.abs(after.x - point.x) > EVENTS.continuous * sizes)
        return bool(states_change or not np.allclose(after.p, point.p, EVENTS.continuous, 0.0))

    def _set(self, point: Point, values: Array, *events: int) -> Point:
        x, p = point.x.copy(), point.p.copy()
        for row in (row for event in events for row in self.rows[event]):
            state, held = self.states[row], self.held[row]
            if state is not None:
                x[state] = values[row]
            if held is not None:
                p[held] = values[row]
        return replace(point, x=x, p=p)


class _CompiledUpdates:
    """Functions of updates: `values` (n_r,) of the arguments of an assembly and the events that happen, and `along`, the
    derivatives of the direct values along directions of (t, x, z, p, u) and of the parameters after the instant."""

    def __init__(self, assembly: Assembly, updates: Updates):
        self.ranks, self.apart = updates.ranks, updates.apart
        t, x, z, p, u, _ = arguments = list(assembly.arguments)
        self.values = Buffered(ca.Function("updates", [*arguments, updates.fired], [ca.densify(updates.values)]))
        moving = [t, x, z, p, u, updates.after]
        directions = [ca.SX.sym("d", a.numel()) for a in moving]
        along = list(directions)
        if not assembly.flat.delays:  # other inputs do not depend on parameters
            along[4] = ca.SX(u.numel(), 1)
        self.along = ca.Function("along", [*arguments, updates.after, *directions], [
            ca.densify(ca.jtimes(updates.direct, stack(moving), stack(along)))])


def _looked(assembly: Assembly, indicators: ca.SX) -> ca.Function:
    """Indicators (n_c,) and their rates along the motion at a consistent point, not finite if g_z is singular."""
    t, x, z = assembly.arguments[:3]
    along = ca.jtimes(stack([indicators, assembly.alg]), stack([t, x]), stack([ca.SX(1), assembly.ode]))
    rising, z_rates = along[:indicators.numel()], along[indicators.numel():]
    if not z.numel() or not indicators.numel():
        return ca.Function("looked", list(assembly.arguments), [indicators, rising])
    parts = ca.Function("parts", list(assembly.arguments), [
        indicators, rising, z_rates, ca.jacobian(indicators, z), ca.jacobian(assembly.alg, z)])
    arguments = [ca.MX.sym(f"a{k}", argument.numel()) for k, argument in enumerate(assembly.arguments)]
    values, direct, residuals, by_z, matrix = parts(*arguments)
    return ca.Function("looked", arguments, [values, direct - by_z @ ca.solve(matrix, residuals)])


def differentiated(assembly: Assembly) -> list[int]:
    """The unknowns that are not states, whose rates occur in the equations, and that depend on values set by events. A
    prescribed speed of a node that no other equation uses is excluded: the end of a spring may move abruptly."""
    flat, states, n = assembly.flat, set(assembly.reduced.states), len(assembly.flat.unknowns)
    used = Counter(c % n for row in flat.entries for c, _ in row)
    idle = [equation.role is EquationRole.RATE and any(c < n and used[c] == 1 for c, _ in row)
            for equation, row in zip(flat.equations, flat.entries, strict=True)]
    rated = sorted({c % n for row, inactive in zip(flat.entries, idle, strict=True) if not inactive for c, _ in row
                    if c >= n})
    held = {assembly.arguments[3][h.index].element_hash() for h in flat.held} | {
        s.element_hash() for s in ca.symvar(assembly.arguments[2])}
    return [j for j in rated if (j, 0) not in states
            and held & {s.element_hash() for s in ca.symvar(assembly.express(flat.levels[0][j]))}]
