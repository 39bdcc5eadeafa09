"""Comparisons of the time with values known in advance, `time < t_open`, as events at that instant.

A condition g(t, p) > 0 whose g = c(p) + s(p) t is a straight line in time changes once, at T = -c/s. In an equation it is
replaced by a held variable that is 0 before T and 1 after it, so that no step of the integrator crosses T, and the
derivatives by T are known (see `numerics.jumps`). At T itself the state after the event holds, for `<` as for `<=`. A
condition of another function of time, and a sign, is held from one change of its sign to the next. What holds at the start
of a run follows from its time (see `numerics.time_events.clocks_at`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from heavebond.core.errors import Place, Problems
from heavebond.core.units import DIMENSIONLESS
from heavebond.equations.events import FlatEvent, FlatReset, Held
from heavebond.equations.parameters import FlatParameter, Parameters
from heavebond.language.external_functions import opened
from heavebond.language.symbols import CORNERS, places, split, stack

FLOOR_MOVES = "Write it in `then:` of a `when:`, which sets a held variable at every sample or crossing."
STAIRCASE = "\nA staircase in time is a SampleHold of a Ramp, a sawtooth their difference."
NEVER = 1e300  # an instant that no run reaches
BESIDE = 1e-9  # s, or share of an instant, by which a derivative is looked at before and after it
CONTINUOUS = 1e-6  # share of its size by which a continuous derivative changes over so short a time, at most
TWO = {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE,
       ca.OP_AND, ca.OP_OR, ca.OP_FMOD, ca.OP_COPYSIGN, ca.OP_IF_ELSE_ZERO, ca.OP_FMIN, ca.OP_FMAX, ca.OP_ATAN2, ca.OP_HYPOT,
       ca.OP_REMAINDER}


@dataclass(frozen=True)
class TimeSwitch:
    """A condition of the time; `symbol` stands for a held variable that is 1 from an `instant` on, or else while the
    function
    of time `above` is above zero."""

    symbol: ca.SX
    instant: ca.SX | None
    above: ca.SX


def clocked(residual: ca.SX, time: ca.SX, constants: set[int], corners: bool = False
            ) -> tuple[ca.SX, list[TimeSwitch], bool]:
    """Remove comparisons of the time with `constants` (hashes of symbols) from a scalar residual that depends on the time.

    Returns the residual without them, the instants at which they change, and True if it still has a kink in a variable. With
    `corners`, the choice of `max`, `min` and `abs` by the time is such a comparison, too."""
    walk, whole = _Walk(time, constants, corners), opened([residual])
    parts = []
    for part in (*whole.columns, *split(whole.args)):
        symbols = ca.symvar(part)
        parts.append(walk.rebuilt(ca.Function("residual", [stack(symbols)], [part]), symbols))
    rebuilt, = whole.closed(parts[:1], stack(parts[1:]))
    return (rebuilt, walk.found, walk.kinked) if walk.found else (residual, [], True)


def _differentiable(residual: ca.SX, switches: Iterable[TimeSwitch], time: ca.SX, values: Mapping[int, float], order: int
                    ) -> bool:
    """Whether a residual has continuous derivatives in time up to `order` at the instants of its switches, with the
    parameters at `values` (by the hashes of their symbols)."""
    instants = [switch.instant for switch in switches if switch.instant is not None]
    if len(instants) < len([*switches]):
        return False  # it changes at zeros of a curve

    def at(expressions: list[ca.SX]) -> ca.Function:
        symbols = [s for s in ca.symvar(stack(expressions)) if s.element_hash() != time.element_hash()]
        known = [values.get(s.element_hash(), 1.0) for s in symbols]  # a switch is on, an unknown anywhere
        return ca.Function("at", [time], [ca.substitute(stack(expressions), stack(symbols), ca.DM(known))])

    passed = np.array(at(instants)(0.0)).ravel()
    passed = np.sort(passed[np.abs(passed) < NEVER / 2])
    beside = BESIDE * np.maximum(np.abs(passed), 1.0)
    derivatives = [residual]
    for _ in range(order):
        derivatives.append(ca.jacobian(derivatives[-1], time))
    course = at(derivatives[1:])
    before, after = (np.array([np.array(course(t)).ravel() for t in passed + side * beside]) for side in (-1, 1))
    between = [passed[:1] - 1.0, (passed[1:] + passed[:-1]) / 2, passed[-1:] + 1.0]
    size = np.abs([np.array(course(t)).ravel() for t in np.concatenate(between)]).max(axis=0, initial=0.0)
    return bool((np.abs(after - before) <= CONTINUOUS * size).all())


def check_steps(residuals: ca.SX, provenance: Iterable[tuple[str, str, Place]], time: ca.SX, parameters: Parameters,
                problems: Problems) -> None:
    """Note `floor-moves` for each equation with `floor` of an argument that depends on more than parameters and held
    variables: it would jump without an event that stops the integrator."""
    floored = [(residuals[k], text, place) for k, (_, text, place) in enumerate(provenance) if "floor" in text]
    constants = places(parameters.p).keys() if floored else set[int]()
    for residual, text, place in floored:
        moving = [a for a in _floored(residual) if not {s.element_hash() for s in ca.symvar(a)} <= constants]
        if moving:
            problems.add("floor-moves", f"floor(...) of something that moves jumps within '{text}'", place,
                         hint=_stairs(moving[0], text, time, parameters) or FLOOR_MOVES + STAIRCASE * ("time" in text))


def _stairs(argument: ca.SX, text: str, time: ca.SX, parameters: Parameters) -> str:
    """The block that makes `floor` of a time over a period; empty for another argument."""
    numbers = ca.DM(parameters.numbers)
    if not {s.element_hash() for s in ca.symvar(argument)} <= {time.element_hash(), *places(parameters.p)}:
        return ""
    course = ca.Function("course", [time], [ca.substitute(argument, parameters.p, numbers)])
    begin, slope, later = float(course(0)), float(course(1)) - float(course(0)), float(course(2)) - float(course(1))
    if begin != 0 or not slope > 0 or abs(later - slope) > CONTINUOUS * slope:
        return ""
    inside = text[text.index("floor(") + len("floor("):]
    depth = [1 + inside[:k + 1].count("(") - inside[:k + 1].count(")") for k in range(len(inside))]
    inside = inside[:depth.index(0)] if 0 in depth else inside
    return f"Add `stairs: {{is: SampleHold, T_s: {1 / slope:.12g} s, u: \"={inside}\"}}` and write stairs.y in place of " \
        f"floor({inside}). A sawtooth is the difference of the time and such a staircase."


def _floored(expression: ca.SX) -> Iterator[ca.SX]:
    """The arguments of `floor` in a scalar expression."""
    waiting, visited = [expression], set[int]()
    while waiting:
        node = waiting.pop()
        if node.element_hash() in visited or node.is_constant() or node.is_symbolic():
            continue
        visited.add(node.element_hash())
        parts = [node.dep(k) for k in range(node.n_dep())]
        if node.op() == ca.OP_FLOOR:
            yield parts[0]
        waiting += parts


@dataclass(frozen=True)
class TimeConditions:
    """Residuals with held variables in place of their conditions of time, the parameters with the initial values of these
    variables, and the instants of their changes; `smooth` are the numbers of residuals without a kink between these
    instants."""

    residuals: ca.SX
    smooth: frozenset[int]
    parameters: Parameters
    held: tuple[Held, ...]
    events: tuple[FlatEvent, ...]


def timed(residuals: ca.SX, sources: Iterable[tuple[str, str, Place]], time: ca.SX, parameters: Parameters,
          held: tuple[Held, ...], corners: Mapping[int, int]) -> TimeConditions:
    """All residuals clocked; `sources` are owner, text and location of their equations, `held` the existing held variables.
    `corners` gives the number of differentiations of residuals: their corners are clocked if they are smooth enough for
    it."""
    by_time = ca.which_depends(residuals, time, 1, True)
    if not any(by_time):  # as in nearly every diagram
        return TimeConditions(residuals, frozenset(), parameters, held, ())
    moving = {h.index for h in held}
    constants = {s for s, k in parameters.places.items() if k not in moving}
    numbers_of = [q.value for q in parameters.independent]
    values = {s: numbers_of[k] for s, k in parameters.places.items()}
    held_variables, events, symbols, residuals_done = list[Held](), list[FlatEvent](), list[ca.SX](), ca.SX(residuals)
    numbers, begin, smooth = Counter[str](), parameters.p.numel(), set[int]()
    for k, (owner, text, place) in enumerate(sources):
        if not by_time[k]:
            continue
        residuals_done[k], passings, kinked = clocked(residuals[k], time, constants, corners=k in corners)
        if k in corners and not _differentiable(residuals[k], passings, time, values, corners[k] - 1):
            residuals_done[k], passings, kinked = clocked(residuals[k], time, constants)
        smooth |= set() if kinked else {k}
        for passing in passings:
            numbers[owner] += 1
            name, index = f"{owner}.clock_{numbers[owner]}", begin + len(held_variables)
            held_variables.append(Held(name, index, DIMENSIONLESS, place, "1 once the time has passed an instant"))
            symbols.append(passing.symbol)
            rises, falls = (FlatReset(name, None, index, ca.SX(value), place) for value in (1, 0))
            if passing.instant is not None:
                events.append(FlatEvent(name, text, place, None, passing.instant, None, (rises,), by_clock=True))
            else:
                events += [FlatEvent(name + end, text, place, above, ca.SX(0), None, (reset,), by_clock=True)
                           for end, above, reset in (("", passing.above, rises), ("_end", -passing.above, falls))]
    if not held_variables:
        return TimeConditions(residuals, frozenset(), parameters, held, ())
    joined = parameters.joined(FlatParameter(f"initial.{h.name}", 0.0, h.unit, h.place) for h in held_variables)
    places = split(joined.p)[begin:]
    joined = replace(joined, expressions={**joined.expressions, **{h.name: p for h, p in zip(held_variables, places,
                                                                                             strict=True)}},
                     units={**joined.units, **{h.name: h.unit for h in held_variables}})
    residuals_done = ca.substitute(residuals_done, stack(symbols), stack(places))
    return TimeConditions(residuals_done, frozenset(smooth), joined, (*held, *held_variables), tuple(events))


class _Walk:
    def __init__(self, time: ca.SX, constants: set[int], corners: bool):
        self.time, self.constants, self.corners, self.kinked = time, {*constants}, corners, False
        self.found: list[TimeSwitch] = []

    def rebuilt(self, function: ca.Function, symbols: list[ca.SX]) -> ca.SX:
        """The expression of a function again, comparisons replaced on the way."""
        work: dict[int, ca.SX] = {}
        result = ca.SX(0)
        for k in range(function.n_instructions()):
            op, inputs, outputs = (function.instruction_id(k), function.instruction_input(k),
                                   function.instruction_output(k))
            if op == ca.OP_OUTPUT:
                result = work[inputs[0]]
            elif op == ca.OP_INPUT:
                work[outputs[0]] = symbols[inputs[1]]
            elif op == ca.OP_CONST:
                work[outputs[0]] = ca.SX(function.instruction_constant(k))
            else:
                work[outputs[0]] = self._operated(op, *(work[i] for i in inputs))
        return result

    def _operated(self, op: int, a: ca.SX, b: ca.SX | None = None) -> ca.SX:
        if b is not None and op in (ca.OP_LT, ca.OP_LE) and (replaced := self._held(b - a)) is not None:
            return replaced
        if op == ca.OP_SIGN and (replaced := self._held(a)) is not None:
            return 2 * replaced - 1
        if self.corners and op in (ca.OP_FMAX, ca.OP_FMIN, ca.OP_FABS):
            argument = -a if b is None else b
            if (replaced := self._held(a - argument)) is not None:
                return ca.if_else(replaced, argument, a) if op == ca.OP_FMIN else ca.if_else(replaced, a, argument)
        # what `if_else` puts out is smooth where its condition does not change
        deciding = a if op == ca.OP_IF_ELSE_ZERO or b is None else ca.vertcat(a, b)
        if op in CORNERS and not {s.element_hash() for s in ca.symvar(deciding)} <= self.constants:
            self.kinked = True
        return ca.SX.binary(op, a, b) if op in TWO and b is not None else ca.SX.unary(op, a)

    def _held(self, above: ca.SX) -> ca.SX | None:
        """The condition `above` > 0 in terms of held variables; None if it contains anything else than the time, constants
        and held variables, or if it is nonlinear in these."""
        slope = ca.jacobian(above, self.time)
        names = {s.element_hash() for s in ca.symvar(above)} - {self.time.element_hash()}
        if not ca.depends_on(above, self.time) or not names <= self.constants:
            return None
        symbol = ca.SX.sym("passed")
        if ca.depends_on(slope, self.time) or slope.nnz() == 0:
            if names & {s.symbol.element_hash() for s in self.found}:
                return None
            self.constants.add(symbol.element_hash())
            self.found.append(TimeSwitch(symbol, None, above))
            return symbol
        first = ca.substitute(above, self.time, ca.SX(0))
        instant = ca.if_else(slope == 0, NEVER, -first / slope)
        before = [switch for switch in self.found if switch.symbol.element_hash() in names]
        if before and self.corners:  # min(max(time - t_1, 0), T): the instant follows from the line before or after t_1
            if len(before) > 1 or before[0].instant is None:
                return None
            bend = before[0].instant
            earlier, later = (ca.substitute(instant, before[0].symbol, ca.SX(passed)) for passed in (0, 1))
            instant = ca.if_else(earlier < bend, earlier, ca.if_else(later >= bend, later, NEVER))
        self.constants.add(symbol.element_hash())
        self.found.append(TimeSwitch(symbol, instant, above))
        return ca.if_else(slope > 0, symbol, ca.if_else(slope < 0, ca.logic_not(symbol), first > 0))

