"""Comparisons of the time with what is known beforehand, `time < t_open`, as events at that instant.

A condition g(t, p) > 0 whose g = c(p) + s(p) t is a straight line in time changes once, at T = -c/s. In an equation it is
replaced by a held variable that is 0 before T and 1 after it, so that no step of the integrator reaches across T, and what
T does to the motion is known (see `numerics.jumps`). At T itself what comes after it holds, be it `<` or `<=`. A condition
of
another function of time, and a sign, is held from one change of its sign to the next. What holds at the start of a run
follows
from its time (see `numerics.time_events.clocks_at`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import casadi as ca

from heavebond.core.errors import Place, Problems
from heavebond.core.units import DIMENSIONLESS
from heavebond.equations.events import FlatEvent, FlatReset, Held
from heavebond.equations.parameters import FlatParameter, Parameters
from heavebond.language.symbols import CORNERS, places, split, stack

FLOOR_MOVES = "Write it in `then:` of a `when:`, which sets a held variable at every sample or crossing."
STAIRCASE = "\nA staircase in time is a SampleHold of a Ramp, a sawtooth their difference."
NEVER = 1e300  # an instant that no run reaches
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


def clocked(residual: ca.SX, time: ca.SX, constants: set[int]) -> tuple[ca.SX, list[TimeSwitch], bool]:
    """A scalar residual that depends on the time, without comparisons of the time with constants (the hashes of their
    symbols), the instants at which these change, and whether it still has a kink in something that moves."""
    symbols = ca.symvar(residual)
    walk = _Walk(time, constants)
    rebuilt = walk.rebuilt(ca.Function("residual", [stack(symbols)], [residual]), symbols)
    return (rebuilt, walk.found, walk.kinked) if walk.found else (residual, [], True)


def check_steps(residuals: ca.SX, told: Iterable[tuple[str, str, Place]], numbers: ca.SX,
                problems: Problems) -> None:
    """`floor` of what moves between events jumps where no event stops the integrator: `floor-moves` for each equation in
    which the argument depends on more than the `numbers` (parameters and held variables)."""
    floored = [(residuals[k], text, place) for k, (_, text, place) in enumerate(told) if "floor" in text]
    constants = places(numbers).keys() if floored else set[int]()
    for residual, text, place in floored:
        if any(not {s.element_hash() for s in ca.symvar(a)} <= constants for a in _floored(residual)):
            problems.add("floor-moves", f"floor(...) of something that moves jumps within '{text}'", place,
                         hint=FLOOR_MOVES + STAIRCASE * ("time" in text))


def _floored(expression: ca.SX) -> Iterator[ca.SX]:
    """The arguments of `floor` in a scalar expression."""
    waiting, seen = [expression], set[int]()
    while waiting:
        node = waiting.pop()
        if node.element_hash() in seen or node.is_constant() or node.is_symbolic():
            continue
        seen.add(node.element_hash())
        parts = [node.dep(k) for k in range(node.n_dep())]
        if node.op() == ca.OP_FLOOR:
            yield parts[0]
        waiting += parts


@dataclass(frozen=True)
class TimeConditions:
    """Residuals with what they took from the time held, the parameters with the begins of that, and when it changes;
    `smooth` are the numbers of residuals that have no kink between these instants."""

    residuals: ca.SX
    smooth: frozenset[int]
    parameters: Parameters
    held: tuple[Held, ...]
    events: tuple[FlatEvent, ...]


def timed(residuals: ca.SX, told: Iterable[tuple[str, str, Place]], time: ca.SX, parameters: Parameters,
          held: tuple[Held, ...]) -> TimeConditions:
    """All residuals clocked; `told` are owner, text and place of their equations, `held` what is held already."""
    by_time = ca.which_depends(residuals, time, 1, True)
    if not any(by_time):  # as in nearly every diagram
        return TimeConditions(residuals, frozenset(), parameters, held, ())
    moving = {h.index for h in held}
    constants = {s for s, k in parameters.places.items() if k not in moving}
    own, events, symbols, done = list[Held](), list[FlatEvent](), list[ca.SX](), ca.SX(residuals)
    numbers, begin, smooth = Counter[str](), parameters.p.numel(), set[int]()
    for k, (owner, text, place) in enumerate(told):
        if not by_time[k]:
            continue
        done[k], passings, kinked = clocked(residuals[k], time, constants)
        smooth |= set() if kinked else {k}
        for passing in passings:
            numbers[owner] += 1
            name, index = f"{owner}.clock_{numbers[owner]}", begin + len(own)
            own.append(Held(name, index, DIMENSIONLESS, place, "1 once the time has passed an instant"))
            symbols.append(passing.symbol)
            rises, falls = (FlatReset(name, None, index, ca.SX(value), place) for value in (1, 0))
            if passing.instant is not None:
                events.append(FlatEvent(name, text, place, None, passing.instant, None, (rises,), by_clock=True))
            else:
                events += [FlatEvent(name + end, text, place, above, ca.SX(0), None, (reset,), by_clock=True)
                           for end, above, reset in (("", passing.above, rises), ("_end", -passing.above, falls))]
    if not own:
        return TimeConditions(residuals, frozenset(), parameters, held, ())
    joined = parameters.joined(FlatParameter(f"initial.{h.name}", 0.0, h.unit, h.place) for h in own)
    places = split(joined.p)[begin:]
    joined = replace(joined, expressions={**joined.expressions, **{h.name: p for h, p in zip(own, places, strict=True)}},
                     units={**joined.units, **{h.name: h.unit for h in own}})
    done = ca.substitute(done, stack(symbols), stack(places))
    return TimeConditions(done, frozenset(smooth), joined, (*held, *own), tuple(events))


class _Walk:
    def __init__(self, time: ca.SX, constants: set[int]):
        self.time, self.constants, self.kinked = time, {*constants}, False
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
        if b is not None and op in (ca.OP_LT, ca.OP_LE) and (found := self._held(b - a)) is not None:
            return found
        if op == ca.OP_SIGN and (found := self._held(a)) is not None:
            return 2 * found - 1
        # what `if_else` puts out is smooth where its condition does not change
        deciding = a if op == ca.OP_IF_ELSE_ZERO or b is None else ca.vertcat(a, b)
        if op in CORNERS and not {s.element_hash() for s in ca.symvar(deciding)} <= self.constants:
            self.kinked = True
        return ca.SX.binary(op, a, b) if op in TWO and b is not None else ca.SX.unary(op, a)

    def _held(self, above: ca.SX) -> ca.SX | None:
        """The condition `above` > 0 in terms of held variables; None where more than the time and constants is in it, or
        held variables in another way than in a straight line."""
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
        self.constants.add(symbol.element_hash())
        self.found.append(TimeSwitch(symbol, instant, above))
        return ca.if_else(slope > 0, symbol, ca.if_else(slope < 0, ca.logic_not(symbol), first > 0))

