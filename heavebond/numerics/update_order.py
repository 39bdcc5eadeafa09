"""The order of updates at one instant: sampled blocks are evaluated along the flow of their signals.

At an instant several time events may assign held variables, h_i := r_i(t, x, z, p, h). Within its component, an update
reads the held variables as they were before the instant (`n: n + 1`). Along signals it reads the values of other components
after their assignment at the same instant, so that blocks of one rate in series add no sample. Quantities of the physical
network have their values before the instant: a converter samples before the forces of the same instant act. The updates are
sorted by these dependencies and written into each other, with a symbol for each event that is 1 if the event happens at the
instant; a loop of updates that may happen at the same instant is an error. E. A. Lee, D. G. Messerschmitt, Synchronous data
flow, Proc. IEEE 75 (1987) 1235, doi:10.1109/PROC.1987.13876.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import ModelError, Problem, either, listing
from heavebond.core.presentation import readable
from heavebond.equations.flatten import EquationRole
from heavebond.equations.matching import block_lower_triangular
from heavebond.equations.reduce import Reduced
from heavebond.language.symbols import places, split, stack

Array = NDArray[np.float64]
LARGEST_RATIO = 1_000_000  # of two periods that have common multiples
SAME_RATIO = 1e-11  # relative difference of two ratios of periods that counts as rounding
HINT = ("Insert a UnitDelay where a value of the instant before is meant, or let one of them sample later by its parameter "
        "`t_0`.")
ALONE = "Insert a UnitDelay between its output and its input if the value of the instant before is meant."


@dataclass(frozen=True)
class Updates:
    """The new values of all resets, in the order of the events.

    `values` (n_r,) are formulas of the arguments of the assembly and of `fired` (n_e,), 1 for each event that happens.
    `direct` (n_r,) are the same values as formulas of the arguments and of `after` (n_p,), the parameters and held variables
    after the instant; the resets of `ranks[k]` depend on `after` only by resets of lower ranks. `apart` are pairs of events
    that must not happen at the same instant, because their updates read each other. `sequence` are the events in the order
    in which the last of their resets is computed.
    """

    fired: ca.SX
    values: ca.SX
    after: ca.SX
    direct: ca.SX
    ranks: tuple[tuple[int, ...], ...]
    apart: frozenset[tuple[int, int]]
    sequence: tuple[int, ...]


@dataclass(frozen=True)
class RateTransition:
    """The sampled part `reader`, with a period in s, reads the value of the part `source` of another period or other
    instants. It is `regular` if one period is a multiple of the other and the instants of the slower part are instants of
    the faster one: the value then has one age at every sample."""

    reader: str
    source: str
    period: float
    source_period: float
    regular: bool

    @property
    def text(self) -> str:
        """The transition between the two sampling rates, and the block that states it."""
        return f"{self.reader} (every {readable(self.period, 's')}) reads {self.source} (every " \
            f"{readable(self.source_period, 's')}): {self.advice}"

    @property
    def advice(self) -> str:
        """The values of the source that the reader uses, and the block that states this transition."""
        fast, slow = sorted((self.period, self.source_period))
        ratio, period, source_period = slow / fast, readable(self.period, "s"), readable(self.source_period, "s")
        if abs(ratio - round(ratio)) > SAME_RATIO * LARGEST_RATIO * ratio:
            return "neither period is a multiple of the other, so that the age of the value changes from sample to " \
                "sample. Choose multiples, or state the hold by a SampleHold at the period of the reader"
        if not self.regular:
            return "its instants are others, so that the value is late by a part of the period. State it by a SampleHold " \
                "with the T_s and t_0 of the reader, or give both one t_0"
        if self.period < self.source_period:
            return "it holds each value, without a computing time of the slower part. If that takes its period, add a " \
                f"UnitDelay with T_s: {source_period} behind {self.source}"
        return f"it takes one value of {round(ratio)}: frequencies above {readable(0.5 / self.period, 'Hz')} alias. Add " \
            f"a DiscreteLowPass at {source_period} and a SampleHold with T_s: {period} between them"


class UpdateOrder:
    """The updates of an assembly for given parameters. A parameter of 0, such as the direct feedthrough of a discrete
    transfer function, may open a loop of updates. The order therefore depends on which of the parameters `zeros`
    (indices) are 0."""

    def __init__(self, reduced: Reduced, express: Callable[[ca.SX], ca.SX]):
        """`express` puts raw symbols in terms of the arguments of the assembly."""
        self._made: dict[bytes, Updates] = {}
        self._graph = _Graph(reduced, express)
        inside = {s.element_hash() for loop in self._graph.loops(self._graph.needs(())) for row in loop
                  for s in ca.symvar(self._graph.direct[row])}
        held = {h.index for h in reduced.flat.held}
        self.zeros = [k for k, s in enumerate(split(reduced.flat.p)) if s.element_hash() in inside and k not in held]

    def at(self, p: Array) -> Updates:
        """The updates for the values p (n_p,) of the parameters; ModelError with the parts of a loop."""
        zero = p[self.zeros] == 0
        key = zero.tobytes()
        if key not in self._made:
            self._made[key] = self._graph.updates([k for k, none in zip(self.zeros, zero.tolist(), strict=True) if none], p)
        return self._made[key]

    @property
    def direct(self) -> list[ca.SX]:
        """The new value of each reset as a formula of the arguments of the assembly, with held variables of two kinds: those
        that its component reads itself, and those that it reads along signals, which are separate symbols."""
        return self._graph.direct

    def instants(self, p: Array) -> tuple[Array, Array]:
        """First instant and period (n_e,) of every event, 0 for what has none."""
        return self._graph.instants(p)

    def transitions(self, p: Array) -> list[RateTransition]:
        """The transitions between rates that no block states: a hold that takes the value as it is, or a unit delay."""
        return self._graph.transitions(p)

    def problem(self, rows: Sequence[int]) -> Problem:
        """The problem of updates that read each other at one instant."""
        return self._graph.problem(rows)


class _Graph:
    """The resets (rows), and which of them read what others assign."""

    def __init__(self, reduced: Reduced, express: Callable[[ca.SX], ca.SX]):
        self.reduced, self.express, flat = reduced, express, reduced.flat
        self.events = flat.events
        self.owner = [e for e, event in enumerate(flat.events) for _ in event.resets]
        resets = [reset for event in flat.events for reset in event.resets]
        self.held = [reset.held for reset in resets]
        timed = [row for row, e in enumerate(self.owner) if flat.events[e].indicator is None]
        self.setters: dict[int, list[int]] = {}
        for row in timed:
            if (held := self.held[row]) is not None:
                self.setters.setdefault(held, []).append(row)
        self.p, self.after = flat.p, ca.SX.sym("after", flat.p.numel())
        raw = [reset.value for reset in resets]
        if timed:
            for row, value in zip(timed, self._along_signals([raw[row] for row in timed], timed), strict=True):
                raw[row] = value
        column, later = stack(raw), places(self.after)
        known = stack(s for s in ca.symvar(column) if s.element_hash() not in later)
        self.direct = split(ca.substitute(column, known, express(known)))

    def _along_signals(self, values: Sequence[ca.SX], rows: Sequence[int]) -> list[ca.SX]:
        """New values (raw) with their signals traced back to held variables: `after` for held variables of other components,
        p for those of the same component. Physical unknowns remain."""
        reduced, flat = self.reduced, self.reduced.flat
        owners, signals = traced_signals(reduced)
        held, before = stack(flat.p[k] for k in self.setters), stack(ca.SX.sym("before") for _ in self.setters)
        by_component: dict[str, list[int]] = {}
        for n, row in enumerate(rows):
            by_component.setdefault(self._part(row), []).append(n)
        expressions = list(values)
        for path, places_of in by_component.items():
            inner = {h: value for h, value in signals.items() if owners[h] == path}
            column = substituted(stack(values[n] for n in places_of), inner)
            mine = [k for k, setters in enumerate(self.setters.values()) if path and self._part(setters[0]) == path]
            column = ca.substitute(column, held[mine], before[mine]) if mine else column
            for n, value in zip(places_of, split(column), strict=True):
                expressions[n] = value
        column = substituted(stack(expressions), signals)
        column = ca.substitute(column, held, stack(self.after[k] for k in self.setters))
        return split(ca.substitute(column, before, held))

    def _part(self, row: int) -> str:
        """The path of the component whose `when:` has a reset; empty for a comparison of the time in an equation."""
        event = self.events[self.owner[row]]
        return "" if event.by_clock else event.name.rpartition(".")[0]

    def needs(self, zeros: Sequence[int]) -> list[Set[int]]:
        """The rows that each row reads, if the parameters `zeros` are 0."""
        column = stack(self.direct)
        if zeros:
            column = ca.substitute(column, self.p[list(zeros)], ca.SX.zeros(len(zeros)))
        place = places(self.after)
        return [{setter for s in ca.symvar(value) if (k := place.get(s.element_hash())) is not None
                 for setter in self.setters[k]} for value in split(column)]

    @staticmethod
    def loops(needs: Sequence[Set[int]]) -> list[list[int]]:
        """The loops of rows that read each other, or themselves."""
        rows = [[row, *sorted(read)] for row, read in enumerate(needs)]
        return [block for block in block_lower_triangular(rows, list(range(len(rows))))
                if len(block) > 1 or block[0] in needs[block[0]]]

    def updates(self, zeros: Sequence[int], p: Array) -> Updates:
        """The updates with the parameters `zeros` at 0."""
        needs = self.needs(())
        if self.loops(needs):
            needs = self.needs(zeros)
        read, apart = [set(n) for n in needs], set[tuple[int, int]]()
        first, period = self.instants(p)
        for loop in self.loops(needs):
            for row in loop:
                for other_row in needs[row] & set(loop):
                    pair = self.owner[row], self.owner[other_row]
                    once = any(self.events[e].period is None for e in pair)
                    if once or not _meet(*(float(a[e]) for a in (first, period) for e in pair)):
                        read[row].discard(other_row)
                        apart |= set() if once else {pair}
        if remaining_loops := self.loops(read):
            raise ModelError([self.problem(loop) for loop in remaining_loops])
        # the updates in ranks, and each with those that it reads written into it
        fired, direct, place = ca.SX.sym("fired", len(self.events)), list(self.direct), places(self.after)
        for row, setters in enumerate(read):  # a held variable whose new value is not needed is read as it was
            used = [k for s in ca.symvar(direct[row]) if (k := place.get(s.element_hash())) is not None
                    and not setters & {*self.setters[k]}]
            if used:
                direct[row] = ca.substitute(direct[row], self.after[used], self.p[used])
        # the rows by the longest chain of rows that each reads
        depth = [0] * len(read)
        dependences = [[row, *sorted(rows)] for row, rows in enumerate(read)]
        for (row,) in block_lower_triangular(dependences, list(range(len(read)))):
            depth[row] = max((depth[source] + 1 for source in read[row]), default=0)
        ranks = tuple(tuple(row for row, d in enumerate(depth) if d == k) for k in range(max(depth, default=-1) + 1))
        written, values = {k: self.p[k] for k in self.setters}, list(direct)
        for rank in ranks:
            column = stack(direct[row] for row in rank)
            if written:
                column = ca.substitute(column, stack(self.after[k] for k in written), stack(written.values()))
            for row, value in zip(rank, split(column), strict=True):
                values[row] = value
                if (k := self.held[row]) in written:
                    written[k] = ca.if_else(fired[self.owner[row]], value, written[k])
        # remove the assignments of an event that coincides with an event of higher precedence
        number, assigned = {event.name: e for e, event in enumerate(self.events)}, list(values)
        for row, (e, held) in enumerate(zip(self.owner, self.held, strict=True)):
            for name in reversed(self.events[e].yields_to):
                preceding = [r for r, owner in enumerate(self.owner) if owner == number[name] and self.held[r] == held]
                unchanged = assigned[preceding[0]] if preceding else values[row] if held is None else self.p[held]
                values[row] = ca.if_else(fired[number[name]], unchanged, values[row])
        last = {self.owner[row]: k for k, rank in enumerate(ranks) for row in rank}
        sequence = tuple(sorted(last, key=last.__getitem__))
        return Updates(fired, stack(values), self.after, stack(direct), ranks, frozenset(apart), sequence)

    def instants(self, p: Array) -> tuple[Array, Array]:
        function = ca.Function("instants", [self.p], [
            self.express(stack(e.first for e in self.events)),
            self.express(stack(ca.SX(0) if e.period is None else e.period for e in self.events))])(p)
        first, period = (np.array(v).ravel() for v in function)
        return first, period

    def transitions(self, p: Array) -> list[RateTransition]:
        """The transitions between rates that no block states."""
        first, period = self.instants(p)
        transitions: dict[tuple[str, str], RateTransition] = {}
        needs = self.needs(())
        for row, read in enumerate(needs):
            for source_row in sorted(read):
                a, b = self.owner[row], self.owner[source_row]
                if any(self.events[e].period is None for e in (a, b)):
                    continue
                near = SAME_RATIO * LARGEST_RATIO * max(period[a], period[b])
                same = abs(period[a] - period[b]) <= near and abs(first[a] - first[b]) <= near
                # a hold: its new value is a multiple of the value that it reads
                held = self.held[source_row]
                is_hold = held is not None and ca.substitute(self.direct[row], self.after[held], ca.SX(0)).is_zero()
                # a delay: its new value is one that it holds itself
                delayed = self.direct[source_row].is_symbolic() and period[b] > period[a] and not needs[source_row]
                if not (same or is_hold or delayed):
                    parts = self._part(row), self._part(source_row)
                    fast, slow = sorted((float(period[a]), float(period[b])))
                    rests = np.array([slow / fast, (first[a] - first[b]) / fast])
                    regular = bool((np.abs(rests - np.round(rests)) <= SAME_RATIO * LARGEST_RATIO * slow / fast).all())
                    transitions.setdefault(parts, RateTransition(*parts, float(period[a]), float(period[b]), regular))
        return list(transitions.values())

    def problem(self, loop: Sequence[int]) -> Problem:
        """The problem of a loop of updates (rows)."""
        flat = self.reduced.flat
        parts = list(dict.fromkeys(self.events[self.owner[row]].name.rpartition(".")[0] for row in loop))
        names = listing([reset.name for event in flat.events for reset in event.resets
                         if event.name.rpartition(".")[0] in parts], 6)
        words = f"the sampled parts {either(parts)} form an algebraic loop: at one instant each reads the value that " \
            "another assigns" if len(parts) > 1 else f"the sampled part '{parts[0]}' forms an algebraic loop with itself: " \
            "its input depends at once on the value that it assigns"
        return Problem("sampled-loop", words, flat.expanded.leaves[parts[0]].place, HINT if len(parts) > 1 else ALONE,
                       (f"held variables: {names}",))


def traced_signals(reduced: Reduced) -> tuple[dict[int, str], dict[int, tuple[ca.SX, ca.SX]]]:
    """The component whose equation defines each signal (empty for a formula of the diagram), and the symbol of the signal
    with its definition (raw), both by the hash of the symbol. Variables of components that exchange power are left out,
    except for signals that follow from signals and held variables alone."""
    flat = reduced.flat
    leaves, owners, definition_of = flat.expanded.leaves, dict[int, str](), dict[int, tuple[ca.SX, ca.SX]]()
    roles = {s.element_hash(): flat.unknowns[j].role for level in flat.levels for j, s in enumerate(level)}
    symbols, definitions = split(reduced.symbols), split(reduced.definitions)
    for k, column in enumerate(reduced.defined):
        if flat.unknowns[column[0]].role not in ("own", "signal"):
            continue
        lines = [reduced.system.rows[row] for row in reduced.sources[k]]
        equations = [flat.equations[i] for i, order in lines if order == 0]
        if len(equations) < len(lines):
            continue
        if any(e.role not in (EquationRole.GIVEN, EquationRole.LAW) for e in equations):
            continue
        laws = list(dict.fromkeys(e.owner for e in equations if e.role is EquationRole.LAW))
        if any(leaves[path].component.ports for path in laws):
            inside = (roles.get(s.element_hash(), "signal") for s in ca.symvar(definitions[k]))
            if {flat.unknowns[column[0]].role, *inside} != {"signal"}:
                continue
        h = symbols[k].element_hash()
        owners[h] = laws[0] if len(laws) == 1 else ""
        definition_of[h] = symbols[k], definitions[k]
    return owners, definition_of


def substituted(column: ca.SX, known: Mapping[int, tuple[ca.SX, ca.SX]]) -> ca.SX:
    """A column with the known symbols replaced by their definitions, until none is left."""
    while used := [known[h] for s in ca.symvar(column) if (h := s.element_hash()) in known]:
        column = ca.substitute(column, stack(symbol for symbol, _ in used), stack(value for _, value in used))
    return column


def _meet(first: float, other_first: float, period: float, other_period: float) -> bool:
    """True if two periodic events can happen at the same instant: with T_1 = a g and T_2 = b g for whole numbers a and b
    without a common factor, if the difference of their first instants is a multiple of g."""
    ratio = Fraction(period / other_period).limit_denominator(LARGEST_RATIO)
    if ratio == 0 or abs(float(ratio) * other_period / period - 1) > SAME_RATIO:
        return True  # without a common multiple: at one instant at most, which may be any
    shift = (other_first - first) / (period / ratio.numerator)
    return abs(shift - round(shift)) < SAME_RATIO * LARGEST_RATIO
