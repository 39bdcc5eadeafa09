"""Motions between the points of a run: intervals in which a state changes by more than the rates at both ends explain.

The points between the output points are placed evenly or follow the steps on the average. An impact, a pressure peak or a
spool stroke within one interval leaves no value at any point, but a change of a state: a body flies on at another speed, and
its acceleration is zero at both ends of the interval. Such an interval is integrated once more, from the point at its
begin, with points inside, and these are searched in the same way. A motion is not noticed if every state and rate has the
same value before and after it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly, Integrand
from heavebond.numerics.idas import Tolerances, caught_errors
from heavebond.numerics.solvers import Choice, Integrator, integrator
from heavebond.numerics.trace import Points, Trace


@dataclass(frozen=True)
class HiddenMotionConstants:
    """The constants of the search.

    share: change of a state, over its range along the run, from which on an interval is searched. Origin: that of the
        other searches of short motions (`time_search.TIME_SEARCH`). Doubled: smaller motions stay hidden.
    explained: multiple of the interval times the larger rate at its ends that explains a change. Origin: a sine changes by
        less between any two points that are closer than half of its period. Doubled: fewer oscillations with few points
        a period are searched.
    fine: error of the trapezoidal rule in an interval within such a motion, over the range of the state, from which on it is
        searched further. Origin: the peak of a half sine is then met to a hundredth. Doubled: to a fiftieth.
    parts: parts of an interval. Origin: two levels then resolve a thousandth. Doubled: fewer levels of twice the work.
    levels: levels of the search. Origin: 32**4 parts of an interval of a ten-thousandth of the run are the shortest step.
        Doubled: nothing.
    most: intervals that are integrated again, those with the largest changes first. Origin: a second of processor time for
        a small machine. Doubled: twice that in a run with many impacts.
    """

    share: float = 0.05
    explained: float = 2.0
    fine: float = 0.01
    parts: int = 32
    levels: int = 4
    most: int = 200


HIDDEN = HiddenMotionConstants()
CHUNK = 2000  # points at which rates are evaluated in one call


@dataclass(frozen=True)
class Stretch:
    """An interval of a run at its points: times (n,), scaled states and unknowns (., n), and the parameters and inputs that
    hold inside."""

    t: Array
    x: Array
    z: Array
    p: Array
    u: Array
    after: int  # the number of the point before it


class HiddenMotions:
    """The search in the runs of one assembly; `inputs` gives what drives the integrator at times between its stops."""

    def __init__(self, assembly: Assembly, integrand: Integrand, inputs: Callable[[Array], Array], solver: Choice,
                 tolerances: Tolerances, begin: float):
        self.assembly, self.integrand, self.inputs, self.begin = assembly, integrand, inputs, begin
        self.solver, self.tolerances = solver, solver.controlled(tolerances)
        self._integrator: Integrator | None = None

    def found_in(self, points: Points, p: Array) -> Points:
        """The points of a run without sensitivities, with those of its hidden motions; `p` are the parameters at its
        start."""
        times, trace, settle = points
        if len(times) < 3 or trace.stays or trace.driven is not None or not len(self.assembly.x_nominal):
            return points
        held = [h.index for h in self.assembly.flat.held]
        ranges = np.ptp(trace.x, axis=1)

        def parameters(k: int) -> Array:
            values = p.copy()
            values[held] = trace.held[:, k]
            return values

        excess = self._excess(times, trace.x, trace.z, p, trace.held, held, ranges)
        waiting = [(float(excess[k]), Stretch(times[k:k + 2], trace.x[:, k:k + 2], trace.z[:, k:k + 2], parameters(k),
                                               self.inputs(times[k:k + 2].mean(keepdims=True))[:, 0], k), 1)
                   for k in np.flatnonzero(excess > 1).tolist()]
        inner, number = list[Stretch](), 0
        while waiting and number < HIDDEN.most:
            waiting.sort(key=lambda entry: entry[0])
            _, stretch, level = waiting.pop()
            number += 1
            check()
            if (finer := self._integrated(stretch)) is None:
                continue
            inner.append(replace(finer, t=finer.t[1:-1], x=finer.x[:, 1:-1], z=finer.z[:, 1:-1]))
            if level < HIDDEN.levels:
                parts = self._excess(finer.t, finer.x, finer.z, finer.p, np.zeros((0, len(finer.t))), [], ranges,
                                     fine=True)
                waiting += [(float(parts[k]), replace(finer, t=finer.t[k:k + 2], x=finer.x[:, k:k + 2],
                                                      z=finer.z[:, k:k + 2]), level + 1)
                            for k in np.flatnonzero(parts > 1).tolist()]
        return _joined(points, inner, settle) if inner else points

    def passes(self, before: Stretch, after: Stretch) -> Array | None:
        """The states at the end of two intervals that are integrated again, with a stop between; None if the integration
        fails."""
        first = self._integrated(before)
        if first is None:
            return None
        then = self._integrated(replace(after, x=first.x[:, -1:], z=first.z[:, -1:]))
        return None if then is None else then.x[:, -1]

    def _excess(self, times: Array, x: Array, z: Array, p: Array, held: Array, places: list[int], ranges: Array,
                fine: bool = False) -> Array:
        """How much more each interval (n - 1,) between points changes a state than its rates explain, as a multiple of the
        change that is passed over. Within a motion (`fine`) that is the error of the trapezoidal rule."""
        spans, changes = np.diff(times), np.diff(x, axis=1)
        moving = np.ones(len(spans), bool) if fine else (np.abs(changes) > HIDDEN.share * ranges[:, None]).any(axis=0)
        looked_at = np.flatnonzero(moving & (spans > 0))
        rates = [np.zeros((len(x), len(spans))) for _ in range(2)]
        for begin in range(0, len(looked_at), CHUNK):
            part = looked_at[begin:begin + CHUNK]
            values = np.tile(p[:, None], (1, len(part)))
            values[places] = held[:, part]
            u = self.inputs((times[part] + times[part + 1]) / 2)[:self.assembly.arguments[4].numel()]
            for side, at in zip(rates, (part, part + 1), strict=True):
                side[:, part] = np.array(self.assembly.rates(times[None, at], x[:, at], z[:, at], values, u,
                                                             np.ones((1, len(part))))[0]).reshape(len(x), len(part))
        if fine:
            unexplained, share = np.abs(changes - spans * (rates[0] + rates[1]) / 2), HIDDEN.fine
        else:
            steepest = np.maximum(np.abs(rates[0]), np.abs(rates[1]))
            unexplained, share = np.abs(changes) - HIDDEN.explained * spans * steepest, HIDDEN.share
        with np.errstate(divide="ignore", invalid="ignore"):
            excess = unexplained / (share * ranges[:, None])
        largest = np.where(np.isfinite(excess), excess, 0.0).max(axis=0, initial=0.0)
        return np.where(np.isin(np.arange(len(spans)), looked_at), largest, 0.0)

    def _integrated(self, stretch: Stretch) -> Stretch | None:
        """An interval with points inside; None where the integration fails."""
        assembly, dae = self.assembly, self.integrand.dae
        if self._integrator is None:
            part, place = ca.SX.sym("part"), ca.SX.sym("place", 2)  # the begin and the length of the interval
            ode, alg = ca.substitute([dae["ode"], dae.get("alg", ca.SX(0, 1))], [dae["t"]], [place[0] + place[1] * part])
            shifted = {**dae, "t": part, "p": stack([dae["p"], place]), "ode": place[1] * ode}
            if "alg" in dae:
                shifted["alg"] = alg
            self._integrator = integrator(self.solver.name, replace(self.integrand, dae=shifted, longest=0.0),
                                          np.linspace(0.0, 1.0, HIDDEN.parts + 1), self.tolerances)
        t_0, length = float(stretch.t[0]), float(stretch.t[1] - stretch.t[0])
        shares = np.linspace(0.0, 1.0, HIDDEN.parts + 1)
        times = t_0 + length * shares
        if np.any(np.diff(times) <= 0):
            return None
        n_x, size = len(stretch.x), self._integrator.size1_in("x0")
        x0 = np.append(assembly.scaled_x(stretch.x[:, 0]), np.zeros(size - n_x))
        z0 = stretch.z[:, 0] / assembly.z_nominal
        hoisted = np.asarray(self.integrand.hoist(stretch.p, np.zeros((len(stretch.p), 0)))).ravel()
        u = np.tile(stretch.u[:, None], (1, HIDDEN.parts))
        with caught_errors():
            try:
                results = self._integrator(x0=x0, z0=z0, p=np.concatenate([hoisted, [t_0 - self.begin, length]]), u=u)
            except RuntimeError:
                check()
                return None
        x = np.column_stack([x0, np.asarray(results["xf"]).reshape(size, HIDDEN.parts)])[:n_x]
        z = np.column_stack([z0, np.asarray(results["zf"]).reshape(len(z0), HIDDEN.parts)])
        if not (np.isfinite(x).all() and np.isfinite(z).all()):
            return None
        return replace(stretch, t=times, x=assembly.unscaled_x(x), z=z * assembly.z_nominal[:, None])


def _joined(points: Points, inner: list[Stretch], settle: Callable[[NDArray[np.intp]], Array] | None) -> Points:
    """The points of a run with further ones; integrals between are interpolated."""
    times, trace, _ = points
    after = np.concatenate([np.full(len(s.t), s.after) for s in inner])
    added = np.concatenate([s.t for s in inner])
    order = np.lexsort((added, after))
    after, added = after[order] + 1, added[order]
    x, z = (np.concatenate([getattr(s, name) for s in inner], axis=1)[:, order] for name in ("x", "z"))
    quadratures = np.array([np.interp(added, times, row) for row in trace.quadratures]).reshape(-1, len(added))
    joined: Trace = replace(
        trace, x=np.insert(trace.x, after, x, axis=1), z=np.insert(trace.z, after, z, axis=1),
        quadratures=np.insert(trace.quadratures, after, quadratures, axis=1),
        held=np.insert(trace.held, after, trace.held[:, after - 1], axis=1),
        held_along=np.insert(trace.held_along, after, trace.held_along[..., after - 1], axis=2))
    origin = np.insert(np.arange(len(times)), after, -1)

    def settled(at: NDArray[np.intp]) -> Array:
        assert settle is not None
        values, before = joined.z[:, at].copy(), origin[at] >= 0
        values[:, before] = settle(origin[at][before])
        return values

    return np.insert(times, after, added), joined, settled if settle is not None else None
