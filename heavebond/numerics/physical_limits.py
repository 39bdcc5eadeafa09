"""Physical limits of a run: where a variable first falls below a value that it cannot have, such as a negative volume."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.cancellation import check
from heavebond.core.errors import Problem, SimulationError
from heavebond.equations.resolver import Unknown
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.run_verdict import Verdict
from heavebond.numerics.validity import finding_of, physical_grace

CLOSE = 1e-3  # of the time of a run: longer intervals between output points are resolved to find the time of a violation
POINTS = 200  # output points with which such an interval is resolved


class LimitPassed(SimulationError):
    """A run passed a physical limit; `result` is the run at the output times before, as far as it is known."""

    def __init__(self, problems: Iterable[Problem] | str, *, hint: str = "", result: Result | None = None):
        super().__init__(problems, hint=hint)
        self.result = result

    def __reduce__(self) -> tuple[type[SimulationError], tuple[object, ...]]:
        """For another process, to which a run does not pass."""
        return SimulationError, (self.problems,)


@dataclass(frozen=True)
class Limited:
    """The variables of an assembly with a physical limit (k,): `limits` and the rows of the states among them; `probe`
    gives those that are no states, in the same order."""

    unknowns: tuple[Unknown, ...]
    limits: Array
    states: dict[int, int]
    probe: Probe

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
    def made() -> Limited:
        flat = assembly.flat
        chosen = [j for j, u in enumerate(flat.unknowns) if np.isfinite(u.plausible.least)]
        row = {j: k for k, (j, order) in enumerate(assembly.reduced.states) if order == 0}
        unknowns = tuple(flat.unknowns[j] for j in chosen)
        return Limited(unknowns, np.array([u.plausible.least for u in unknowns]),
                       {k: row[j] for k, j in enumerate(chosen) if j in row},
                       Probe(assembly, [flat.unknowns[j].name for j in chosen if j not in row], si=True))

    return assembly.once("physical limits", made)


def check_limits(result: Result) -> None:
    """LimitPassed where a variable falls below its physical limit at an output time of a run."""
    of = limited(result.assembly)
    if not of.unknowns:
        return
    values = of.values(result)
    above = np.nan_to_num(values - of.limits[:, None], nan=0.0, posinf=0.0, neginf=-np.inf)
    reach = above.max(axis=1)
    below = above < -np.array([[physical_grace(u, r)] for u, r in zip(of.unknowns, reach.tolist(), strict=True)])
    if not below.any():
        return
    n = int(np.argmax(below.any(axis=0)))
    times = {int(k): _crossing(result.time, above[k], n) for k in np.flatnonzero(below[:, n])}
    k = min(times, key=lambda k: times[k])
    u = of.unknowns[k]
    violation = finding_of("physical", u, times[k], float(values[k, n]), float(of.limits[k]), u.plausible.beyond)
    raise LimitPassed([Verdict((violation,)).problem], result=replace(result.first(max(n, 1)), ended=violation))


def _crossing(time: Array, above: Array, n: int) -> float:
    """When a course passes zero before its n-th point, on a straight line."""
    if n == 0 or not above[n - 1] > 0 or not np.isfinite(above[n]):
        return float(time[n])
    return float(time[n - 1] + (time[n] - time[n - 1]) * above[n - 1] / (above[n - 1] - above[n]))


def resolved(error: LimitPassed, whole: Array, run: Callable[[Array], Result]) -> Result:
    """The run up to its physical limit, with the time of the violation.

    `whole` are the output times of the run (N,). If the violation lies in an interval longer than `CLOSE` of the run, `run`
    repeats it with more output times there.
    """
    result = error.result
    assert result is not None and result.ended is not None
    n = int(np.searchsorted(whole, result.time[-1], side="right"))
    if n >= len(whole) or result.ended.time <= result.time[-1] or whole[n] - whole[n - 1] <= CLOSE * (whole[-1] - whole[0]):
        return result
    try:
        run(np.append(whole[:n], np.linspace(whole[n - 1], whole[n], POINTS)[1:]))
    except LimitPassed as finer:
        return result if finer.result is None else replace(result, ended=finer.result.ended)
    except SimulationError:
        check()
    return result
