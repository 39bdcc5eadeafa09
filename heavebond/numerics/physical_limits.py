"""Physical limits of a run: the first time at which a variable falls below an impossible value, such as a negative
volume."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.cancellation import check
from heavebond.core.errors import Problem, SimulationError, listing
from heavebond.core.presentation import readable
from heavebond.equations.resolver import Unknown
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.pointwise import evaluated
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.run_verdict import Verdict
from heavebond.numerics.validity import crossing_time, finding_of, physical_grace

WATCHED = 200  # intervals of a run, at least, at whose ends its limits are tested
POINTS = 200  # output points with which the interval of a violation is resolved
EXACT = 1e-6  # of the time of a run: to so much the time of a violation is found


class LimitPassed(SimulationError):
    """A run passed a physical limit between the times `bracket`; `result` is the run at the output times before, if it is
    known."""

    def __init__(self, problems: Iterable[Problem] | str, *, hint: str = "", result: Result | None = None,
                 bracket: tuple[float, float] = (0.0, 0.0)):
        super().__init__(problems, hint=hint)
        self.result, self.bracket = result, bracket

    def __reduce__(self) -> tuple[type[SimulationError], tuple[object, ...]]:
        """Pickle the error without its run, for another process."""
        return SimulationError, (self.problems,)


@dataclass(frozen=True)
class Limited:
    """The variables of an assembly with a physical limit (k,): `limits`, the distances from these as expressions, `margins`,
    and the rows of the states among them; `probe` evaluates those that are not states, in the same order."""

    unknowns: tuple[Unknown, ...]
    limits: Array
    margins: ca.SX
    states: dict[int, int]
    probe: Probe

    @property
    def graces(self) -> Array:
        """How far each variable may be below its limit in any run (k,)."""
        return np.array([physical_grace(u, np.inf) for u in self.unknowns])

    def values(self, result: Result) -> Array:
        """Their values along a run (k, N)."""
        values = np.empty((len(self.unknowns), len(result.time)))
        algebraic = [k for k in range(len(self.unknowns)) if k not in self.states]
        values[list(self.states)] = result.x[list(self.states.values())]
        if algebraic:
            values[algebraic] = self.probe.values(result)
        for at, stay in result.stays:
            values[:, at] = limited(stay.assembly).values(stay)
        return values


def limited(assembly: Assembly) -> Limited:
    """The variables of an assembly with a physical limit."""
    def compiled() -> Limited:
        flat = assembly.flat
        chosen = [j for j, u in enumerate(flat.unknowns) if np.isfinite(u.plausible.least)]
        row = {j: k for k, (j, order) in enumerate(assembly.reduced.states) if order == 0}
        unknowns = tuple(flat.unknowns[j] for j in chosen)
        limits = np.array([u.plausible.least for u in unknowns])
        return Limited(unknowns, limits, assembly.express(stack(flat.levels[0][j] for j in chosen)) - ca.SX(ca.DM(limits)),
                       {k: row[j] for k, j in enumerate(chosen) if j in row},
                       Probe(assembly, [flat.unknowns[j].name for j in chosen if j not in row], si=True))

    return assembly.once("physical limits", compiled)


def is_outside(assembly: Assembly, columns: Sequence[Array]) -> bool:
    """Whether a variable is below its physical limit by more than its grace in any run, at one of N points; `columns` are
    the arguments of the equations there (., N)."""
    of = limited(assembly)
    if not of.unknowns:
        return False
    function = assembly.once("margins", lambda: ca.Function("margins", list(assembly.arguments), [ca.densify(of.margins)]))
    margins, = evaluated(assembly, function, columns)
    return bool((margins < -of.graces[:, None]).any())


def check_limits(result: Result, whole: Result | None = None) -> None:
    """LimitPassed where a variable falls below its physical limit at a point of a run: an output time, a point between them
    (see `Result.dense`), or one of the `whole` run."""
    of = limited(result.assembly)
    if not of.unknowns:
        return
    candidates = [whole or result]
    if whole is None and result.between is not None and _below(of, result.unsettled).any():
        candidates = [result.dense, result]
    for points in candidates:
        below = _below(of, points)
        if below.any():
            break
    else:
        return
    above = _above(of, points)
    n = int(np.argmax(below.any(axis=0)))
    # a variable passes its limit before it is below it by more than the grace
    first = {int(k): n - int(np.argmax(above[k, n - 1::-1] >= 0)) if n else 0 for k in np.flatnonzero(below[:, n])}
    times = {k: crossing_time(points.time, above[k], m, 0.0) for k, m in first.items()}
    k = min(times, key=lambda k: times[k])
    u, value = of.unknowns[k], float(above[k, n] + of.limits[k])
    violation = finding_of("physical", u, times[k], value, float(of.limits[k]),
                           f"{u.plausible.beyond}{_drawing_part(points, n, u)}")
    before = int(np.searchsorted(result.time, points.time[n]))
    raise LimitPassed([Verdict((violation,)).problem], result=replace(result.first(max(before, 1)), ended=violation),
                      bracket=(float(points.time[max(n - 1, 0)]), float(points.time[n])))


def check_margins(of: Limited, margins: Array, begin: float) -> None:
    """LimitPassed where a variable fell below its physical limit between the points of a run: `margins` are the least
    distances from the limits, their times after `begin`, and the largest distances (3, k)."""
    for u, limit, (least, time, most) in zip(of.unknowns, of.limits.tolist(), margins.T.tolist(), strict=True):
        if least < -physical_grace(u, most):
            raise LimitPassed([Verdict((finding_of("physical", u, begin + time, least + limit, limit,
                                                   u.plausible.beyond),)).problem])


def _drawing_part(points: Result, n: int, u: Unknown) -> str:
    """A sentence on the part that draws most from the node of `u` at point n of a run; empty if none draws half of it."""
    flat = points.assembly.flat
    node = u.name.rpartition(".")[0]
    domain, junction = flat.domains.get(node), flat.expanded.junctions.get(node)
    if domain is None or junction is None or not domain.fills:
        return ""
    ends = {name: end for end in junction.ends
            if (name := f"{end.name}.{domain.through[0]}") in flat.names and end.sign > 0}
    values = Probe(points.assembly, list(ends), si=True).values(points)[:, n].tolist() if ends else []
    flows = dict(zip(ends, values, strict=True))
    most = max(flows, key=lambda name: flows[name], default="")
    if not most or not flows[most] > sum(max(q, 0.0) for q in flows.values()) / 2:
        return ""
    part, unit = ends[most].leaf, flat.unknowns[flat.names[most]].unit.text
    junctions = [connected for path, connected in flat.expanded.junctions.items() if flat.domains.get(path) != domain
                       and any(end.leaf == part for end in connected.ends)]
    drives = listing(dict.fromkeys(end.leaf for connected in junctions for end in connected.ends if end.leaf != part), 3)
    return f". {part} draws {readable(flows[most], unit)} from node '{node}' at that time: if it should deliver there, " \
        f"exchange its ports{f' or reverse its drive ({drives})' if drives else ''}"


def _above(of: Limited, points: Result) -> Array:
    """How far each variable is above its limit (k, N); one without a value is at it."""
    return np.nan_to_num(of.values(points) - of.limits[:, None], nan=0.0, posinf=0.0, neginf=-np.inf)


def _below(of: Limited, points: Result) -> NDArray[np.bool_]:
    """Which variables are below their limits (k, N)."""
    above = _above(of, points)
    grace = [[physical_grace(u, r)] for u, r in zip(of.unknowns, above.max(axis=1).tolist(), strict=True)]
    return np.asarray(above < -np.array(grace))


def resolved(error: LimitPassed, whole: Array, run: Callable[[Array, bool], Result]) -> Result:
    """The run up to its physical limit, which is its last point.

    `whole` are the output times of the run (N,). `run` repeats it with more output times where the violation lies, then up
    to the violation; its second argument asks for points between the output points.
    """
    result = error.result
    assert result is not None and result.ended is not None
    for _ in range(2):
        begin, end = error.bracket
        if not end - begin > EXACT * (whole[-1] - whole[0]):
            break
        try:
            run(np.concatenate([whole[whole < begin], np.linspace(begin, end, POINTS)]), False)
        except LimitPassed as finer:
            error = finer
        except SimulationError:
            check()
            break
        else:
            break
    violation = error.result.ended if error.result is not None and error.result.ended is not None else result.ended
    before = whole[whole < violation.time]
    if len(before) and violation.time > before[-1]:
        try:
            return replace(run(np.append(before, violation.time), True), ended=violation)
        except SimulationError:
            check()
    return replace(result, ended=violation)
