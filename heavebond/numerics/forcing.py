"""Prescribed functions of time: the stops and the longest step with which the integrator misses none of their motions.

A solver evaluates the equations only at the ends of its steps. If a machine is at rest, the steps grow without limit, and
a road bump, a pulse or a gust that begins and ends within one step is missed: the run ends without an error and without the
motion. Before a run the functions of time in the equations are therefore searched. The integrator stops at their kinks and
jumps (where an argument of `min`, `max`, `abs`, `sign`, `atan2` or a comparison changes its sign) and at points within
motions that are shorter than the output intervals. The longest step follows from the values at the output points. A state
that is a polynomial of the time, as the position of a vehicle at constant speed, counts as a function of time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from heavebond.language.external_functions import opened
from heavebond.language.incidence import STEPS
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.interval_functions import operation
from heavebond.numerics.time_search import (
    Course,
    constant_rows,
    rounding,
    short_motions,
    sign_changes,
    straight_sign_changes,
)

MOST_BRANCHES = 16  # expressions that one value of a function of time may be, by the branches of its conditions
STEEP = {ca.OP_SQ, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_EXP, ca.OP_TANH, ca.OP_ATAN, ca.OP_COSH, ca.OP_SINH, ca.OP_ERF,
         ca.OP_INV}
STRAIGHT = {ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS, ca.OP_ASSIGN}
POINTS = 1000  # output intervals below which the functions are looked at in so many intervals
MOST_POWER = 3  # of the time in the course of a state: that of a vehicle under constant jerk
MOST_TURNS = 100_000  # of a periodic function in a run: a run with more is limited by its events
SAME_DEPTH = 20  # operations of two expressions that are compared
TERMS = 8  # terms of a sum that are searched each by itself, so that a small motion beside a large one is met


@dataclass(frozen=True)
class ForcingConstants:
    """The constants of the limit of the steps.

    share: excursion of a function within a step, over its range along the run, that limits the step. Origin: a step may
        contain a smaller one unnoticed; a sine allows steps of a seventh of its period, longer than any solver takes
        at usual tolerances. Doubled: steps longer by two fifths if they are limited, and smaller motions unseen.
    renewed_below: share of the present limit below which another set of parameters renews it. Origin: an integrator is
        not built again for a change that hardly matters. Doubled (one): it is built again at every smaller limit.
    """

    share: float = 0.05
    renewed_below: float = 0.7


FORCING = ForcingConstants()


@dataclass(frozen=True)
class Stops:
    """The stops (n,) of the integrator at motions of the functions of time, its longest step (s; 0: no limit), and as texts
    the functions for which neither could be determined: they may have shorter motions."""

    times: Array
    longest: float
    unknown: tuple[str, ...] = ()


class Forcing:
    """The largest subexpressions of the equations that depend on time and parameters alone."""

    def __init__(self, assembly: Assembly):
        time, _, _, p, _, rate = assembly.arguments
        flat = assembly.flat
        conditions = [assembly.express(e.indicator) for e in flat.events if e.indicator is not None]
        sources = [assembly.express(d.source) for d in flat.delays]
        equations = ca.substitute(stack([assembly.ode, assembly.alg, *sources, *conditions]), rate, ca.SX(1))
        held = {h.index for h in flat.held}
        constants = stack(s for k, s in enumerate(split(p)) if k not in held)
        self._begin, self._begins = ca.SX.sym("begin"), dict[int, ca.SX]()
        self._follow_polynomials(assembly, constants)
        if self._begins:
            equations = ca.substitute(equations, stack(assembly.arguments[1][k] for k in self._courses),
                                      stack(self._courses.values()))
            constants = stack([constants, self._begin, *self._begins.values()])
        self.parts = parts = _parts(equations, time, constants)
        self._felt: list[int] = []
        self._functions: ca.Function | None = None
        self._lines: ca.Function | None = None
        self._switches: dict[bool, Course | None] = {False: None, True: None}  # by whether they are curved between kinks
        self._smooth: Course | None = None
        self._turns: ca.Function | None = None
        if not parts:
            return
        order = flat.places
        used = [s for s in ca.symvar(stack(parts)) if s.element_hash() in order]
        self._felt = [order[s.element_hash()] for s in used]
        used += [self._begin, *self._begins.values()] if self._begins else []
        felt = stack(used)
        laws = _parts(equations[:equations.numel() - len(conditions)], time, constants) if conditions else parts
        self._functions = ca.Function("forcing", [time, felt], [stack(laws)])
        timed_conditions = [c for c in split(equations[equations.numel() - len(conditions):])
                            if {s.element_hash() for s in ca.symvar(c)} <= {s.element_hash() for s in (*used, time)}]
        switches, phases = [*switch_arguments(parts, time)[0], *timed_conditions], list[ca.SX]()
        for y, x in _angles(parts, time):
            if (phase := _phase(y, x, time)) is None:
                switches.append(y)
            else:
                phases.append(phase)
        if phases:
            first = ca.substitute(stack(phases), time, ca.SX(0))
            self._turns = ca.Function("turns", [felt], [first, ca.jtimes(stack(phases), time, ca.SX(1))])
        if switches:
            slopes = ca.jtimes(stack(switches), time, ca.SX(1))
            bent = ca.which_depends(slopes, time, 1, True)
            lines = [k for k, curved in enumerate(bent) if not curved]
            first = ca.substitute(stack(switches[k] for k in lines), time, ca.SX(0))
            self._lines = ca.Function("lines", [felt], [first, slopes[lines]])
            kinked = [s for s, more in zip(switches, bent, strict=True) if more]
            kinds = _curved(kinked, time) if kinked else []
            for kind in (False, True):
                rows = [s for s, bends in zip(kinked, kinds, strict=True) if bends is kind]
                self._switches[kind] = Course(time, felt, rows) if rows else None
        terms = [term for part in parts for term in _terms(part, time)]
        if curved := [term for term, bent in zip(terms, _curved(terms, time), strict=True) if bent]:
            self._smooth = Course(time, felt, curved)

    def _follow_polynomials(self, assembly: Assembly, constants: ca.SX) -> None:
        """Find the states that are polynomials of the time, by their rates. Their `_courses` by the rows of the states
        contain their values at the begin of the run, `_begins`."""
        time, x, rate = assembly.arguments[0], assembly.arguments[1], assembly.arguments[5]
        reset = {r.unknown for event in assembly.flat.events for r in event.resets}
        set_by_impulses = any(event.impulse or event.breakaway for event in assembly.flat.events)
        known = {s.element_hash() for s in (time, self._begin, *split(constants))}
        self._courses: dict[int, ca.SX] = {}
        waiting = [k for k, (j, order) in enumerate(assembly.reduced.states) if not (order or j in reset or set_by_impulses)]
        progress = True
        while progress and waiting:
            progress = False
            rates = ca.substitute(stack(assembly.ode[k] for k in waiting), rate, ca.SX(1))
            if self._courses:
                rates = ca.substitute(rates, stack(x[k] for k in self._courses), stack(self._courses.values()))
            for row, k in enumerate(list(waiting)):
                if {s.element_hash() for s in ca.symvar(rates[row])} <= known and \
                        (rise := _integral(rates[row], time, self._begin)) is not None:
                    self._begins[k] = ca.SX.sym(assembly.state_names[k])
                    known.add(self._begins[k].element_hash())
                    self._courses[k] = self._begins[k] + rise
                    waiting.remove(k)
                    progress = True

    @property
    def follows_states(self) -> bool:
        """Whether the functions depend on states that are polynomials of the time."""
        return bool(self.parts and self._begins)

    def parts_from(self, begin: float, x: Array | None) -> list[ca.SX]:
        """The functions of time and parameters of a run that begins at a time with the state `x` (n_x,)."""
        if not self.follows_states:
            return self.parts
        values = self.felt(np.zeros(0), begin, x)
        whole = ca.substitute(stack(self.parts), stack([self._begin, *self._begins.values()]), ca.DM(values))
        return [whole[k] for k in range(len(self.parts))]

    def longest_step(self, times: Array, p: Array, x: Array | None = None) -> float:
        """The longest step (s) over these output times (N,) with these parameters; 0 for no limit. `x` (n_x,) is the state
        at the first time, without it 0."""
        if self._functions is None or len(times) < 3:
            return 0.0
        felt = self.felt(p, times[0], x)
        values = np.asarray(self._functions(times[None, :], np.repeat(felt[:, None], len(times), axis=1)))
        finite, interval = np.all(np.isfinite(values), axis=1), float(np.median(np.diff(times)))
        limit = _longest(values[finite], interval)
        if limit:  # rounding does not count
            limit = _longest(values[finite & ~constant_rows(self._functions, felt, times[0], times[-1])], interval)
        return limit

    def stops(self, times: Array, p: Array, x: Array | None = None) -> Stops:
        """The stops and the longest step that the functions of time require between these output times (N,) with these
        parameters, from the state `x` (n_x,) at the first time (default 0). If there are few output times, POINTS intervals
        replace them, so that longer motions between them are included."""
        if self._functions is None or len(times) < 2:
            return Stops(np.zeros(0), 0.0)
        felt, ends, unknown = self.felt(p, times[0], x), times[[0, -1]], list[str]()
        times = times if len(times) > POINTS else np.linspace(ends[0], ends[1], POINTS + 1)
        kinks, longest = np.zeros(0), self.longest_step(times, p, x)
        if self._lines is not None:
            first, slope = (np.array(v).ravel() for v in self._lines(felt))
            with np.errstate(divide="ignore", invalid="ignore"):
                kinks = -first / slope
        if self._turns is not None:
            first, slope = (np.array(v).ravel() for v in self._turns(felt))
            kinks = np.concatenate([kinks, *(_whole_turns(f, s, ends) for f, s in zip(first, slope, strict=True))])
        if (straight := self._switches[False]) is not None:
            kinks = straight_sign_changes(straight, felt, _within(kinks, ends, True))
        if (curved := self._switches[True]) is not None:
            changes = sign_changes(curved, felt, _within(kinks, ends, True))
            kinks = np.append(kinks, changes.times)
            unknown += curved.texts(changes.unknown)
        motions = np.zeros(0)
        if self._smooth is not None:
            with np.errstate(invalid="ignore"):  # a function may be infinite, and the interval between two of its bounds too
                short = short_motions(self._smooth, felt, times, _within(kinks, ends, True))
            motions = short.times
            unknown += self._smooth.texts(short.unknown)
            longest = min(longest or short.longest, short.longest or longest)
        return Stops(_within(np.append(kinks, motions), ends), longest, tuple(dict.fromkeys(unknown)))

    def felt(self, p: Array, begin: float, x: Array | None = None) -> Array:
        """The values on which the functions of time depend: parameters, the start time, and states at the start."""
        values = p[self._felt] if len(p) else p
        if not self.follows_states:
            return np.asarray(values)
        return np.array([*values, begin, *(0.0 if x is None else x[k] for k in self._begins)])


def _integral(rate: ca.SX, time: ca.SX, begin: ca.SX) -> ca.SX | None:
    """The integral of a polynomial of the time of a low degree from the begin; None of another function."""
    span, power, total = time - begin, 1, ca.SX(0)
    while power <= MOST_POWER:
        total += ca.substitute(rate, time, begin) * span**power / math.factorial(power)
        if not ca.depends_on(rate, time):
            return total
        rate, power = ca.jtimes(rate, time, ca.SX(1)), power + 1
    return None


def _within(times: Array, ends: Array, closed: bool = False) -> Array:
    """Times in order between two ends, without those that differ by rounding; with the ends if `closed`."""
    same = rounding(np.abs(ends).max())
    inner = np.sort(times[(times > ends[0] + same) & (times < ends[1] - same)])
    inner = inner[np.diff(inner, prepend=-np.inf) > same]
    return np.concatenate([ends[:1], inner, ends[1:]]) if closed else inner


def _parts(equations: ca.SX, time: ca.SX, p: ca.SX) -> list[ca.SX]:
    driven = np.flatnonzero(ca.which_depends(equations, time, 1, True)).tolist() if equations.numel() else []
    if not driven:
        return []
    _, _, parts = ca.extract_parametric(equations[driven], stack([time, p]))
    timed = ca.which_depends(stack(parts), time, 1, True) if parts else []
    return [part for part, depends in zip(parts, timed, strict=True) if depends]


def switch_arguments(parts: list[ca.SX], time: ca.SX) -> tuple[list[ca.SX], list[ca.SX], list[ca.SX]]:
    """The expressions whose sign changes at kinks and jumps of functions of time: as they are written; with each condition
    inside taken both ways, up to MOST_BRANCHES expressions, most of which are straight lines in time (a sign change in an
    inactive branch has no effect); and the arguments of powers and exponentials in the same way."""
    whole_parts = opened(parts)
    together = ca.cse(stack([*whole_parts.columns, whole_parts.args]))
    symbols = ca.symvar(together)
    function = ca.Function("f", [stack(symbols)], [together])
    moves = {time.element_hash()}
    work: dict[int, tuple[bool, list[ca.SX]]] = {}
    written: dict[int, ca.SX] = {}  # the expressions with their conditions
    whole_switches, switches, steep = list[ca.SX](), list[ca.SX](), list[ca.SX]()
    for k in range(function.n_instructions()):
        op, inputs, outputs = (function.instruction_id(k), function.instruction_input(k), function.instruction_output(k))
        if op == ca.OP_OUTPUT:
            continue
        if op == ca.OP_INPUT:
            symbol = symbols[inputs[1]]
            work[outputs[0]], written[outputs[0]] = (symbol.element_hash() in moves, [symbol]), symbol
            continue
        if op == ca.OP_CONST:
            written[outputs[0]] = ca.SX(function.instruction_constant(k))
            work[outputs[0]] = False, [written[outputs[0]]]
            continue
        args = [work[i][1] for i in inputs]
        moving = any(work[i][0] for i in inputs)
        whole = operation(op, [written[i] for i in inputs])
        pairs = list(product(*args))
        branches = [operation(op, list(pair)) for pair in pairs] if len(pairs) > 1 else [whole]
        if moving and op in (ca.OP_FMIN, ca.OP_FMAX, ca.OP_LT, ca.OP_LE):
            whole_switches.append(written[inputs[0]] - written[inputs[1]])
            switches += [a - b for a, b in pairs]
            branches = [*args[0], *args[1]] if op in (ca.OP_FMIN, ca.OP_FMAX) else [ca.SX(0), ca.SX(1)]
        elif moving and op in (ca.OP_FABS, ca.OP_SIGN):
            whole_switches.append(written[inputs[0]])
            switches += args[0]
            branches = [*args[0], *(-a for a in args[0])] if op == ca.OP_FABS else [ca.SX(-1), ca.SX(1)]
        elif moving and op == ca.OP_IF_ELSE_ZERO:
            branches = [ca.SX(0), *args[1]]
        elif moving and (op in STEEP or op == ca.OP_DIV):
            steep += args[-1] if op == ca.OP_DIV else args[0]
        written[outputs[0]] = whole
        work[outputs[0]] = moving, branches if moving and len(branches) <= MOST_BRANCHES else [whole]
    first, second, third = ([s for s in group if ca.depends_on(s, time)] for group in (whole_switches, switches, steep))
    return first, second, third


def _angles(parts: list[ca.SX], time: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    """The arguments (y, x) of each atan2 that depends on the time: it jumps where y changes its sign at negative x."""
    together = ca.cse(stack(parts))
    function = ca.Function("f", [stack(ca.symvar(together))], [together])
    if not any(function.instruction_id(k) == ca.OP_ATAN2 for k in range(function.n_instructions())):
        return []
    waiting, visited, pairs = split(together), set[int](), list[tuple[ca.SX, ca.SX]]()
    while waiting:
        node = waiting.pop()
        if node.element_hash() in visited or node.is_constant() or node.is_symbolic():
            continue
        visited.add(node.element_hash())
        if node.op() == ca.OP_ATAN2 and ca.depends_on(node.dep(0), time):
            pairs.append((node.dep(0), node.dep(1)))
        waiting += [node.dep(k) for k in range(node.n_dep())]
    return pairs


def _phase(y: ca.SX, x: ca.SX, time: ca.SX) -> ca.SX | None:
    """A straight line in time whose whole turns are the jumps of atan2(y, x), which is a straight line between them: of
    y = -sin(phase) and x = -cos(phase), as in the function `periodic`; None for other arguments."""
    if y.op() != ca.OP_NEG or x.op() != ca.OP_NEG:
        return None
    sine, cosine = y.dep(0), x.dep(0)
    if sine.op() != ca.OP_SIN or cosine.op() != ca.OP_COS or not ca.is_equal(sine.dep(0), cosine.dep(0), SAME_DEPTH) or \
            ca.depends_on(ca.jacobian(sine.dep(0), time), time):
        return None
    return sine.dep(0)


def _whole_turns(first: float, slope: float, ends: Array) -> Array:
    """The times between two ends at which the phase first + slope*t is a multiple of 2 pi, at most MOST_TURNS."""
    if not (np.isfinite(first) and np.isfinite(slope)) or slope == 0:
        return np.zeros(0)
    turns = np.sort((first + slope * ends) / (2 * np.pi))
    whole = np.arange(np.ceil(turns[0]), min(np.floor(turns[1]), np.ceil(turns[0]) + MOST_TURNS) + 1)
    return np.asarray((2 * np.pi * whole - first) / slope)


def _curved(terms: list[ca.SX], time: ca.SX) -> list[bool]:
    """Whether functions of time are more than straight lines between their kinks and jumps."""
    together = ca.cse(stack(terms))
    symbols = ca.symvar(together)
    function = ca.Function("f", [stack(symbols)], [together])
    degrees: dict[int, int] = {}  # 2 stands for all above 1
    results: dict[int, int] = {}  # the instruction whose result a place of the work vector holds
    waves: dict[int, tuple[int, int]] = {}  # -sin and -cos: the operation, and the instruction of their phase
    curved = [False] * len(terms)
    for k in range(function.n_instructions()):
        op, inputs, outputs = (function.instruction_id(k), function.instruction_input(k), function.instruction_output(k))
        if op == ca.OP_OUTPUT:
            curved[outputs[1]] = degrees[inputs[0]] > 1
            continue
        if op in (ca.OP_INPUT, ca.OP_CONST):
            degrees[outputs[0]] = int(op == ca.OP_INPUT and symbols[inputs[1]].element_hash() == time.element_hash())
            waves.pop(outputs[0], None)
            results[outputs[0]] = k
            continue
        wave = (op, results[inputs[0]]) if op in (ca.OP_SIN, ca.OP_COS) and degrees[inputs[0]] <= 1 else \
            waves.get(inputs[0]) if op == ca.OP_NEG else None
        y, x = (waves.get(i, (0, 0)) for i in inputs) if op == ca.OP_ATAN2 else ((0, 0), (0, 0))
        if op in STEPS:
            degrees[outputs[0]] = 0
        elif y == (ca.OP_SIN, x[1]) and x[0] == ca.OP_COS:
            degrees[outputs[0]] = 1  # the phase, from turn to turn
        else:
            each = [degrees[i] for i in inputs]
            degrees[outputs[0]] = max(each) if op in STRAIGHT or not any(each) else \
                each[1] if op == ca.OP_IF_ELSE_ZERO else each[0] if op == ca.OP_DIV and not each[1] else \
                min(sum(each), 2) if op == ca.OP_MUL else 2
        if op == ca.OP_CALL:
            degrees.update(dict.fromkeys(outputs, 2 * int(any(each))))
        waves.pop(outputs[0], None)
        results[outputs[0]] = k
        if wave is not None:
            waves[outputs[0]] = wave
    return curved


def _terms(part: ca.SX, time: ca.SX) -> list[ca.SX]:
    """The terms of a sum that depend on the time; the sum itself if they are many."""
    waiting, terms = [part], list[ca.SX]()
    while waiting:
        node = waiting.pop()
        if not ca.depends_on(node, time):
            continue
        if node.op() in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE):
            waiting += [node.dep(k) for k in range(node.n_dep())]
        elif node.op() == ca.OP_MUL and (fixed := [k for k in (0, 1) if not ca.depends_on(node.dep(k), time)]):
            waiting.append(node.dep(1 - fixed[0]))
        else:
            terms.append(node)
        if len(terms) + len(waiting) > TERMS:
            return [part]
    return terms


def _longest(values: Array, interval: float) -> float:
    """The longest window, in powers of two of the interval, in which no row (m, N) leaves the range between its values at
    both ends by more than the share of its whole range; 0 where the longest window that fits is allowed.

    Extremes over windows of 2^k intervals follow from two windows of half the length."""
    allowed = FORCING.share * np.ptp(values, axis=1, keepdims=True) if len(values) else np.zeros((0, 1))
    highest = lowest = values
    width = 1
    while width < values.shape[1] and len(values):
        half = max(width // 2, 1)
        highest = np.maximum(highest[:, :-half], highest[:, half:])
        lowest = np.minimum(lowest[:, :-half], lowest[:, half:])
        first, last = values[:, :-width], values[:, width:]
        if np.any(highest - np.maximum(first, last) > allowed) or np.any(np.minimum(first, last) - lowest > allowed):
            return width / 2 * interval
        width *= 2
    return 0.0
