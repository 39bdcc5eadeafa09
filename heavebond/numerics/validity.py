"""Checks of the values of a run, from which its verdict follows.

The checks, at the output points and points between them (see `Result.dense`), find values that are not finite; values
above a million typical sizes; components whose power does not balance; values outside the range declared by a component or a
domain, or larger than in any machine; states that grow exponentially to the end. The first three make the numbers worthless.
The others are reported only: a diagram under construction may leave a range, and a short time outside may not matter.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.equations.flatten import Flat
from heavebond.equations.resolver import Unknown
from heavebond.language.symbols import stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.pointwise import evaluated, missing, undetermined
from heavebond.numerics.power_balance import balance
from heavebond.numerics.run_verdict import RUNAWAY, Finding, Verdict, verdict
from heavebond.numerics.start_equations import Point
from heavebond.text.expression import ExpressionProblem, Name


@dataclass(frozen=True)
class ValidityConstants:
    """The constants of the verdict of a run: declared limits, values without meaning, exponential growth.

    grace: share of a limit, or of the usual size of a variable, by which it may pass the limit. Origin: errors of the
        integration at an end stop. Doubled: smaller excesses are silent.
    rounding: share of the usual size of a variable by which it may always pass a physical limit. Origin: ten times the
        absolute tolerance of the integration. Doubled: a tank that is empty may be emptied a little further.
    worthless: magnitude that no unit explains. Origin: its square is infinite. Doubled: nothing.
    fast: multiple of the typical speed of its domain at which a position may move for the whole run. Origin: a shaft that
        turns for hours. Doubled: a position that runs away is named later.
    samples: points of a run at which everything is evaluated. Origin: all points would cost a tenth of the run. Doubled:
        twice that time, short excesses of algebraic variables are found.
    watched: points at which variables with a declared range are evaluated in any case. Origin: as above. Doubled: as above.
    near: multiple of their moves from one of these points to the next by which they must keep away from their limits; else
        they are evaluated at all points between. Origin: a curve exceeds its points by less than the change between them.
        Doubled: more evaluations.
    excursion: share of its range along the run by which a state that leaves its values at two of these points has all points
        between evaluated. Origin: half of what is drawn as one line. Doubled: smaller excursions are passed over.
    growth_parts: equal parts of the second half of a run that are compared for growth. Origin: it separates an exponential
        from a power of time. Doubled: slow growth is less often named.
    growth: factor by which each part goes further than the one before. Origin: t**6 does not. Doubled: only fast growth is
        named.
    grown: typical sizes below which growth does not matter. Origin: machines exceed their typical sizes by less. Doubled:
        named later.
    grown_unknown: the same in the unit of a variable without a typical size. Origin: no better measure. Doubled: named
        later.
    front: segments of a line in a front (its height over the largest rate and the travel time of a segment) below which it
        is reported. Origin: the overshoot of a lumped line at a ramp of x segments is up to 0.45/x; 12 % at this front.
        Doubled: reported from 6 % on.
    front_window: travel times of a segment before and after the largest rate in which the height of a front is measured.
        Origin: a ripple and the front before it. Doubled: two fronts may count as one.
    front_size: share of its largest value by which a variable of a line changes for its front to matter. Origin: the error
        is a hundredth of the value then. Doubled: errors of two hundredths are silent.
    resolved: segments in a front that are recommended. Origin: 5 % of overshoot. Doubled: 2.5 %.
    own_front: segments a and factor b of the front sqrt(a**2 + (b*x)**2) that a ramp of x segments becomes in a lumped line.
        Origin: ramps of the flow at the end of a line, x from 0.01 to 9, within 5 %. Doubled: other numbers are recommended.
    """

    grace: float = 1e-3
    rounding: float = 1e-9
    worthless: float = 1e150
    fast: float = 100.0
    samples: int = 100
    watched: int = 1000
    near: float = 2.0
    excursion: float = 5e-3
    growth_parts: int = 8
    growth: float = 1.5
    grown: float = 10.0
    grown_unknown: float = 1e3
    front: float = 2.5
    front_window: float = 4.0
    front_size: float = 0.02
    resolved: float = 9.0
    own_front: tuple[float, float] = (0.73, 0.69)


VALIDITY = ValidityConstants()
CAUSES = "an instability, a wrong sign, a stop that does not hold, or a source that nothing bounds"
LARGER = f"larger than in any machine. Look for {CAUSES}"
RAN_AWAY = f"Look for {CAUSES}"
GROWING = f"Look for {CAUSES}; `heavebond modes` shows which components oscillate or run away"
FRONT = ("behind a front of so few segments the lumped line oscillates, and its peaks are up to 45 % too high. Take about "
         "{} segments in place of {}, or a longer time for the change that causes the front. A hydraulic line as a "
         "TransmissionLine has no segments, and fronts keep their shape")
_NUMBER = re.compile(r"_[0-9]+$")
UNDETERMINED = "It is 0/0 there. No motion depends on it, so the run continues without its values"
NO_VALUE = ("{} has no value there: a root, a power or a logarithm of a negative number, or a division by 0. Bound its "
            "argument (max(x, 0)), or look at what drives it there")
OPEN = ("Its equations contradict its `stores` and `dissipates`: check their signs. "
        "`heavebond energy` shows all components")
MAKES = "Its `dissipates` is below zero there, so it creates energy: check the signs of its law"


Points = NDArray[np.intp]


@dataclass(frozen=True)
class RunSection:
    """A run or a part of it in the states of one assembly: times (N,), states (n, N), and the arguments of the
    assembly's functions at points by their numbers."""

    assembly: Assembly
    time: Array
    x: Array
    columns: Callable[[Points], tuple[Array, ...]]


def judged(stretches: Sequence[RunSection], also: Sequence[Finding] = (), dense: Sequence[RunSection] = ()) -> Verdict:
    """The verdict on a run in one or several stretches; `also` are findings made during the run, `dense` is the run with
    points between its output points, if there are any."""
    duration = max((float(s.time[-1]) for s in stretches), default=0.0) - min((float(s.time[0]) for s in stretches),
                                                                              default=0.0)
    with np.errstate(over="ignore", invalid="ignore"):  # what has run away may overflow
        longest = max((len(s.time) for s in stretches), default=0)
        findings = [f for s in dense for f in _between(s, duration)]
        findings += [f for s in stretches for f in _of_stretch(s, duration, len(s.time) == longest, not dense)]
        if len(stretches) == 1:
            findings += _growing(stretches[0])
    return verdict([*findings, *also])


def at_point(assembly: Assembly, point: Point) -> Verdict:
    """The findings on variables outside their range at one point, such as a start."""
    values = np.array(assembly.values(*point.values())).reshape(-1, 1)
    columns = [np.reshape(v, (-1, 1)) for v in point.values()]
    lost = missing(assembly, range(len(values)), columns, values)
    return verdict(list(_outside(assembly.flat.unknowns, values, np.array([point.t]), 0.0, lost)))


def _between(s: RunSection, duration: float) -> Iterator[Finding]:
    """The findings on variables outside their range in one part of a run, at all points: states, and variables with a
    declared range if these come near to it or the states change much (see `near`)."""
    flat, states = s.assembly.flat, {j: k for k, (j, order) in enumerate(s.assembly.reduced.states) if order == 0}
    yield from _outside([flat.unknowns[j] for j in states], s.x[list(states.values())], s.time, duration)
    looked_at = [j for j, u in enumerate(flat.unknowns) if j not in states and _ranged(u)]
    if not looked_at:
        return
    at = _spread(len(s.time), VALIDITY.watched)
    values = _values_of(s, looked_at, at)
    unknowns = [flat.unknowns[j] for j in looked_at]
    if len(at) == len(s.time):
        yield from _outside(unknowns, values, s.time, duration, missing(s.assembly, looked_at, s.columns(at), values))
        return
    bounds = np.array([_bounds(u, duration) for u in unknowns])
    margin = np.minimum(values - bounds[:, :1], bounds[:, 1:] - values)
    near = ~(np.minimum(margin[:, :-1], margin[:, 1:]) > VALIDITY.near * _moves(values)).all(axis=0) | _excursions(s.x, at)
    inner = np.concatenate([at, *(np.arange(at[k] + 1, at[k + 1]) for k in np.flatnonzero(near))])
    inner.sort()
    values = _values_of(s, looked_at, inner)
    yield from _outside(unknowns, values, s.time[inner], duration, missing(s.assembly, looked_at, s.columns(inner), values))


def _moves(values: Array) -> Array:
    """The largest difference of values (k, n) between neighbouring points, in each interval (k, n - 1) and the adjacent
    ones."""
    changes = np.pad(np.abs(np.diff(values, axis=1)), ((0, 0), (1, 1)))
    return np.asarray(np.maximum(changes[:, 1:-1], np.maximum(changes[:, :-2], changes[:, 2:])))


def _excursions(x: Array, at: Points) -> NDArray[np.bool_]:
    """The intervals between points `at` (k,) in which states (n, N) leave the range of their values at both ends by more
    than neighbouring values suggest."""
    if not len(x):
        return np.zeros(len(at) - 1, bool)
    first, last = x[:, at[:-1]], x[:, at[1:]]
    high, low = np.maximum.reduceat(x, at[:-1], axis=1), np.minimum.reduceat(x, at[:-1], axis=1)
    beyond = np.maximum(high - np.maximum(first, last), np.minimum(first, last) - low)
    least = np.maximum(VALIDITY.excursion * np.ptp(x, axis=1, keepdims=True), VALIDITY.near * _moves(x[:, at]))
    return np.asarray((beyond > least).any(axis=0))


def _values_of(s: RunSection, unknowns: Sequence[int], at: Points) -> Array:
    """Some of the unknowns (k, n) at points of a run."""
    arguments = list(s.assembly.arguments)
    function = s.assembly.once(("some", *unknowns), lambda: ca.Function("some", arguments, [
        ca.densify(s.assembly.values(*arguments)[list(unknowns)])]))
    return evaluated(s.assembly, function, s.columns(at))[0]


def _of_stretch(s: RunSection, duration: float, balanced: bool, ranged: bool) -> Iterator[Finding]:
    """The findings in one section of a run. The power balance is checked on request, as its laws hold for the whole run.
    With `ranged`, variables with a declared range are checked at more points."""
    flat, reduced, n = s.assembly.flat, s.assembly.reduced, len(s.time)
    states = {j: k for k, (j, order) in enumerate(reduced.states) if order == 0}
    yield from _outside([flat.unknowns[j] for j in states], s.x[list(states.values())], s.time, duration)
    chosen = _spread(n, VALIDITY.samples)
    columns = s.columns(chosen)
    values, = evaluated(s.assembly, s.assembly.values, columns)
    undecided = missing(s.assembly, range(len(flat.unknowns)), columns, values)
    for j in np.flatnonzero(undecided.any(axis=1)).tolist():
        yield finding_of("undetermined", flat.unknowns[j], float(s.time[chosen][np.argmax(undecided[j])]), math.nan, None,
                         UNDETERMINED)
    wrong = {f.name for f in _outside(flat.unknowns, values, s.time[chosen], duration, undecided)}
    looked_at = [j for j, u in enumerate(flat.unknowns) if u.name in wrong or (ranged and j not in states and _ranged(u))]
    if looked_at:
        yield from _closely(s, looked_at, _spread(n, n if wrong else VALIDITY.watched), duration)
    if not balanced or not (np.isfinite(values) | undecided).all():
        return
    formulas = s.assembly.once("formulas", lambda: _formulas(s.assembly))
    imbalance, outputs = balance(s.assembly, columns, values, list(formulas.values()))
    for part in imbalance:
        advice = MAKES if part.made else OPEN
        yield Finding("energy", part.owner, part.owner, part.time, part.missing, part.limit, "W", advice)
    yield from without_value(dict(zip(formulas, outputs, strict=False)), s.time[chosen], lambda name, course: undetermined(
        s.assembly, s.assembly.express(formulas[name]), columns, course)).findings
    if len(s.time) > 1:
        yield from _fronts(s)


def _closely(s: RunSection, looked_at: Sequence[int], at: Points, duration: float) -> Iterator[Finding]:
    """The findings on some of the unknowns at further points of a run."""
    flat = s.assembly.flat
    values = _values_of(s, looked_at, at)
    for finding in _outside([flat.unknowns[j] for j in looked_at], values, s.time[at], duration,
                                missing(s.assembly, looked_at, s.columns(at), values)):
        if finding.kind == "not-finite":
            k = int(np.argmin(np.abs(s.time - finding.time)))
            point_values = evaluated(s.assembly, s.assembly.values, s.columns(np.array([k])))[0][:, 0]
            finding = replace(finding, advice=_culprit(flat, point_values))
        yield finding


def _fronts(s: RunSection) -> Iterator[Finding]:
    """Lines in series of segments (components with a `travel_time`) through which fronts pass that are shorter than
    `VALIDITY.front` segments: the change of the effort or speed at a segment, near its largest rate, over this rate and the
    travel time."""
    flat, chosen = s.assembly.flat, _spread(len(s.time), VALIDITY.watched)
    states, leaves = {j: k for k, (j, order) in enumerate(s.assembly.reduced.states) if order == 0}, flat.expanded.leaves
    lines: dict[str, list[str]] = {}
    for path, leaf in leaves.items():
        if leaf.component.travel_time is not None:
            lines.setdefault(_NUMBER.sub("", path), []).append(path)
    for series, segments in lines.items():
        block = series.rpartition(".")[0]
        name = block if block in leaves else series
        if len(segments) == 1 and name != block:
            continue  # a lumped line
        path_of = {j: path for path in segments for port in leaves[path].component.ports
                           for member in flat.domains[f"{path}.{port}"].across
                           if (j := flat.names[f"{path}.{port}.{member}"]) in states}
        if not path_of:
            continue
        rows = [states[j] for j in path_of]
        function = s.assembly.once(("fronts", series), partial(_rates_and_travel, s.assembly, rows, list(path_of.values())))
        values, = evaluated(s.assembly, function, s.columns(chosen))
        rates, times = values[:len(rows)], values[len(rows):]
        x = s.x[rows]
        steepest = np.maximum(np.abs(rates).max(axis=1), np.abs(np.diff(x) / np.diff(s.time)).max(axis=1, initial=0.0))
        travel, steep = times.min(axis=1), s.time[chosen][np.abs(rates).argmax(axis=1)]
        near = np.abs(s.time - steep[:, None]) <= VALIDITY.front_window * travel[:, None]
        reach = np.where(near, x, -np.inf).max(axis=1) - np.where(near, x, np.inf).min(axis=1)
        # where a wave is reflected to nothing, only its ripples remain: the larger half of the changes counts
        least = np.maximum(reach.max() / 2, VALIDITY.front_size * np.maximum(
            np.abs(x).max(initial=0.0), [flat.unknowns[j].nominal * VALIDITY.grace for j in path_of]))
        with np.errstate(divide="ignore", invalid="ignore"):
            inside = np.where(reach >= least, reach / (steepest * travel), np.inf)
        k = int(np.argmin(inside))
        if inside[k] < VALIDITY.front:
            floor, slope = VALIDITY.own_front
            ramp = max(np.sqrt(max(inside[k]**2 - floor**2, 0.0)) / slope, 0.5)
            number = math.ceil(len(segments) * VALIDITY.resolved / ramp)
            yield Finding("front", name, name, float(steep[k]),
                          float(inside[k] * travel[k]), float(travel[k]), "s", FRONT.format(number, len(segments)))


def _rates_and_travel(assembly: Assembly, rows: Sequence[int], paths: Sequence[str]) -> ca.Function:
    """The rates of some states, then the travel times of some segments."""
    components = [assembly.flat.expanded.leaves[path].component for path in paths]
    travel = [assembly.expression(assembly.model.library.formula(component.in_diagram(component.travel_time, path)))
              for component, path in zip(components, paths, strict=True) if component.travel_time is not None]
    return ca.Function("fronts", list(assembly.arguments), [ca.densify(stack([*(assembly.ode[k] for k in rows), *travel]))])


def _spread(n: int, most: int) -> Points:
    """Numbers of points spread evenly over n, the first and the last among them."""
    return np.linspace(0, n - 1, min(n, most)).astype(int)


def _formulas(assembly: Assembly) -> dict[str, ca.SX]:
    """The outputs that are more than a name, in raw symbols."""
    formulas, resolver = {}, assembly.resolver()
    for name, output in assembly.model.show.items():
        if not isinstance(output.expr, Name):
            with suppress(ExpressionProblem):  # said when it is asked for
                formulas[name] = resolver.evaluate(output.expr)
    return formulas


def without_value(signals: Mapping[str, Array], time: Array, lost: Callable[[str, Array], NDArray[np.bool_]]) -> Verdict:
    """The verdict on signals by name or formula (N,) at times: that each has a value, whatever the variables have. `lost`
    gives the points at which a signal with these values is undetermined."""
    findings = []
    for name, course in signals.items():
        undecided = lost(name, course)
        if undecided.any():
            first = float(time[np.argmax(undecided)])
            findings.append(Finding("undetermined", name, "", first, math.nan, None, "1", UNDETERMINED))
        if not (np.isfinite(course) | undecided).all():
            at = int(np.argmin(np.isfinite(course) | undecided))
            findings.append(Finding("not-finite", name, "", float(time[at]), float(course[at]), None, "1",
                                          NO_VALUE.format(f"the formula of {name}")))
    return verdict(findings)


def _culprit(flat: Flat, values: Array) -> str:
    """The hint for values (n,) that are not finite: the equation without a value although all its other terms have one."""
    bad = set(np.flatnonzero(~np.isfinite(values)).tolist())
    for equation, entries in zip(flat.equations, flat.entries, strict=True):
        if len({column % len(flat.unknowns) for column, _ in entries} & bad) == 1:
            return NO_VALUE.format(f"'{equation.text}' of {equation.owner} ({equation.place.file}:{equation.place.line})")
    return NO_VALUE.format("an equation with it")


def _growing(s: RunSection) -> Iterator[Finding]:
    """States that grow exponentially over the second half of a run, to its end."""
    if len(s.time) < 4 * VALIDITY.growth_parts or not len(s.x):
        return
    later = np.abs(s.x - s.x[:, :1])[:, len(s.time) - len(s.time) // (2 * VALIDITY.growth_parts) * VALIDITY.growth_parts:]
    reach = later.reshape(len(s.x), VALIDITY.growth_parts, -1).max(axis=2)
    grows = (reach[:, 1:] > VALIDITY.growth * reach[:, :-1]).all(axis=1)
    for k in np.flatnonzero(grows).tolist():
        j, order = s.assembly.reduced.states[k]
        u = s.assembly.flat.unknowns[j]
        known = np.isfinite(u.plausible.typical)
        if order == 0 and \
                reach[k, -1] > (VALIDITY.grown * u.plausible.typical if known else VALIDITY.grown_unknown * u.nominal):
            yield finding_of("growth", u, float(s.time[len(s.time) // 2]), float(s.x[k, -1]), None, GROWING)


def _ranged(unknown: Unknown) -> bool:
    limits = (unknown.plausible.least, *((unknown.low, unknown.high) if unknown.role == "own" else ()))
    return any(math.isfinite(limit) for limit in limits)


def _outside(unknowns: Sequence[Unknown], values: Array, time: Array, duration: float,
             lost: NDArray[np.bool_] | None = None) -> Iterator[Finding]:
    """The findings on values (k, N) of unknowns at times of a run, except for undetermined ones (`lost`)."""
    if not len(unknowns):
        return
    low, high = values.min(axis=1), values.max(axis=1)  # NaN where one is
    bounds = np.array([_bounds(u, duration) for u in unknowns])
    with np.errstate(invalid="ignore"):
        fine = (low >= bounds[:, 0]) & (high <= bounds[:, 1])
    for k in np.flatnonzero(~fine).tolist():
        determined = slice(None) if lost is None else ~lost[k]
        if values[k, determined].size:
            yield from _wrong(unknowns[k], values[k, determined], time[determined], duration)


def _bounds(u: Unknown, duration: float) -> tuple[float, float]:
    """The range of a variable without a finding."""
    most = min(RUNAWAY * typical_size(u, duration), VALIDITY.worthless, _largest(u, duration))
    internal = u.role == "own"
    least = max(u.plausible.least - physical_grace(u), u.low - _grace(u, u.low) if internal else -np.inf)
    return max(-most, least), min(most, u.high + _grace(u, u.high) if internal else np.inf)


def _grace(u: Unknown, limit: float) -> float:
    return VALIDITY.grace * max(abs(limit), u.nominal * VALIDITY.grace) if math.isfinite(limit) else 0.0


def physical_grace(u: Unknown, reach: float = 0.0) -> float:
    """The tolerance below the physical limit of a variable, in a run in which it was up to `reach` above the limit."""
    limit = u.plausible.least
    share = VALIDITY.grace * max(abs(limit), VALIDITY.grace * min(u.nominal, reach)) if math.isfinite(limit) else 0.0
    return max(share, VALIDITY.rounding * u.nominal)


def _largest(u: Unknown, duration: float) -> float:
    return max(u.plausible.largest, VALIDITY.fast * u.plausible.per_second * duration)


def _wrong(u: Unknown, values: Array, time: Array, duration: float) -> Iterator[Finding]:
    """The findings on one variable, the worst first."""
    finite = np.isfinite(values)
    if not finite.all():
        at = int(np.argmin(finite))
        yield finding_of("not-finite", u, float(time[at]), float(values[at]), None, "")
        return
    typical, largest = RUNAWAY * typical_size(u, duration), _largest(u, duration)
    for kind, most, advice in (("runaway", min(typical, VALIDITY.worthless), RAN_AWAY), ("larger", largest, LARGER)):
        if np.abs(values).max() > most:
            yield _passed(kind, u, values, time, np.abs(values) > most, most, advice)
    below = values < u.plausible.least - physical_grace(u)
    if below.any():
        yield _passed("physical", u, values, time, below, u.plausible.least, u.plausible.beyond)
    owner, _, name = u.name.rpartition(".")
    advice = u.plausible.beyond if u.plausible.beyond and not math.isfinite(u.plausible.least) else \
        f"beyond what {owner} allows for its {name}. Look at its start, and at what drives it"
    ends = [(u.low, -1), (u.high, 1)] if u.role == "own" else []
    for limit, side in ends:
        over = side * (values - limit) > _grace(u, limit)
        if math.isfinite(limit) and over.any():
            yield _passed("range", u, values, time, over, limit, advice)


def typical_size(unknown: Unknown, duration: float) -> float:
    """The typical size of a variable in a run of so many seconds; inf if none is known."""
    return max(unknown.plausible.typical, unknown.plausible.per_second * duration)


def _passed(kind: str, u: Unknown, values: Array, time: Array, over: NDArray[np.bool_], limit: float, advice: str
            ) -> Finding:
    """A limit that is passed, first at the time at which the straight line between two points meets it."""
    worst = float(values[int(np.argmax(np.abs(values - limit) * over))])
    edge, k = limit if kind in ("range", "physical") else float(np.copysign(limit, worst)), int(np.argmax(over))
    return finding_of(kind, u, crossing_time(time, values, k, edge), worst, edge, advice)


def crossing_time(time: Array, values: Array, k: int, level: float) -> float:
    """When a course (N,) passes a level before its k-th point, on a straight line; its time if it was beyond already."""
    if k == 0 or not np.isfinite(values[k]) or values[k] == values[k - 1]:
        return float(time[k])
    share = float(np.clip((level - values[k - 1]) / (values[k] - values[k - 1]), 0, 1))
    return float(time[k - 1] + share * (time[k] - time[k - 1]))


def finding_of(kind: str, u: Unknown, time: float, value: float, limit: float | None, advice: str) -> Finding:
    """The finding on a variable, with its part and its unit."""
    return Finding(kind, u.name, u.name.rpartition(".")[0], time, value, limit, u.unit.text, advice)
