"""Held variables in linear analysis: they are constants. Those in a loop may make the stability undecided.

A linear system has no events. For sufficiently small motions this is exact if the conditions of all events are away from
zero: a friction that sticks, a relay between its thresholds. It is not exact if an event happens for every motion, such as
the samples of a digital controller, or if a condition is at zero. If such a variable lies in a loop, the eigenvalues belong
to another machine, and stability is not decided.

Loops are found by structure. The graph is directed: its vertices are the states, algebraic unknowns, held variables and
resets of states, and an edge leads from each symbol of an equation to the unknown that the equation determines. Algebraic
equations are matched to their unknowns, and a held variable follows the values and conditions of the events that set it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Place, Problem, UsageError, listing
from heavebond.core.presentation import readable
from heavebond.equations.events import FlatEvent, FlatReset
from heavebond.equations.matching import maximum_matching
from heavebond.language.sections import Clock
from heavebond.language.smoothing import without_rounding
from heavebond.language.symbols import places, split, stack
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.event_constants import EVENTS
from heavebond.numerics.jumps import EventEquations, PointSensitivity
from heavebond.numerics.output_times import grid
from heavebond.numerics.start_equations import Point
from heavebond.numerics.time_events import same_instant


@dataclass(frozen=True)
class HeldVariableConstants:
    """The constants of the treatment of held variables.

    threshold: change of all states, over their nominal sizes, by which a condition at zero would turn. Origin: errors of a
        start. Doubled: nothing.
    jump: change of a sampled value with such a change of the states, over that by its slopes, from which on it jumps.
        Origin: a kink changes slopes by less. Doubled: nothing.
    instants: times at which a condition of the time is evaluated over a run. Origin: a period has some. Doubled: shorter
        openings of a condition are seen.
    grows: eigenvalue of samples that follow each other without a state between, above which they grow. Origin: rounding of
        a counter, which has 1. Doubled (in its excess over 1): nothing.
    first_samples: samples after which variables that count the first ones have their final values. Origin: the length of
        a moving average. Doubled: time, for counters without an end.
    steady: share by which the effect of a held variable between samples may change with the time during a run. Origin:
        rounding. Doubled: nothing.
    distances: sizes of random motions, over nominal sizes, at which a value is compared with that at the point. Origin:
        thresholds near and far. Doubled: nothing.
    draws: random motions of each size. Origin: half of them do not pass the threshold of a relay; 2**-20 is a millionth.
        Doubled: nothing measurable.
    """

    threshold: float = 1e-9
    jump: float = 1e4
    instants: int = 400
    grows: float = 1.0 + 1e-9
    first_samples: int = 1000
    steady: float = 1e-9
    distances: tuple[float, ...] = (1e-3, 1.0, 1e3)
    draws: int = 20


HELD = HeldVariableConstants()
# operations whose value is constant but for jumps: those of a quantiser
STEPPED = (ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD, ca.OP_REMAINDER)


@dataclass(frozen=True)
class HeldVariable:
    """A variable that only events change, or a state that samples set, at an operating point, in SI.

    `part` is the path of its component, `place` the line of the part. `sampled` is set if the events that change it happen
    for every motion, `in_loop` if its value acts on itself through the machine, `at_threshold` if the smallest motion would
    change it, `acts` if an equation contains it (not conditions of events alone), `varying` if it is sampled and the linear
    system depends on its value. `inputs` of the linear system act on it, and it acts on `outputs`. It is `exact` if a
    sampled system contains its samples (see `sampled`), of the `period` in s; it is not constant there. If the samples are
    `rounded` to steps, as in a quantiser or an encoder, the rounding has the gain 1.
    """

    name: str
    part: str
    component: str
    place: Place
    value: float
    unit: str
    doc: str
    sampled: bool
    in_loop: bool
    at_threshold: bool
    acts: bool
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    state: bool = False
    varying: bool = False
    exact: bool = False
    period: float | None = None
    rounded: bool = False

    @property
    def undecided(self) -> bool:
        """True if it makes the stability undecided."""
        return self.varying or (self.in_loop and (self.sampled or self.at_threshold))

    @property
    def between(self) -> bool:
        """Whether it lies on a path from an input to an output."""
        return bool(self.inputs and self.outputs)

    @property
    def label(self) -> str:
        """`h.last (SampleHold, machine.yaml:7)`."""
        kind = f"{self.component}, " if self.component else ""
        return f"{self.name} ({kind}{self.place.file}:{self.place.line})"

    @property
    def why(self) -> str:
        """The effect that the linear system leaves out."""
        if self.state:
            return "the samples that set this state are left out"
        if self.sampled:
            return "set at given times, but irregularly, in steps, or by a law that is constant here, as at a limit"
        return "at its threshold, where the smallest motion may change it" if self.at_threshold else \
            "does not switch in the linear system; for another state take a moment by --at"

    @property
    def treatment(self) -> str:
        """How the linear system treats it."""
        if self.period is not None:
            return f"sampled every {readable(self.period, 's')}, as in a run{', rounded with a gain of 1' * self.rounded}"
        doc = f" ({self.doc})" if self.doc else ""
        return f"held constant at {readable(self.value, self.unit)}{doc}: {self.why}"

    @property
    def text(self) -> str:
        """A sentence for people."""
        return held_lines([self])[0]

    def as_dict(self) -> dict[str, object]:
        """The same for machines."""
        return {"part": self.part, "variable": self.name, "component": self.component, "file": self.place.file,
                "line": self.place.line, "value": self.value, "unit": self.unit, "sampled": self.sampled,
                "in_loop": self.in_loop, "at_threshold": self.at_threshold, "rounded": self.rounded,
                "treatment": self.treatment}


def held_lines(held: Sequence[HeldVariable]) -> list[str]:
    """A line for each part with held variables: their values, and how the linear system treats them. Variables that only
    conditions of events contain are omitted if the same part has others."""
    groups: dict[tuple[object, ...], list[HeldVariable]] = {}
    acting = {h.part for h in held if h.acts}
    for h in (h for h in held if h.acts or h.undecided or h.part not in acting):
        groups.setdefault((h.part, h.place.file, h.place.line, h.why, h.in_loop), []).append(h)
    lines = []
    for group in groups.values():
        h = group[0]
        values = ", ".join(f"{g.name} = {readable(g.value, g.unit)}{f' ({g.doc})' if g.doc else ''}" for g in group)
        lines.append(f"held constant: {values}; {f'{h.component}, ' if h.component else ''}{h.place.file}:{h.place.line}, "
                     f"{'in a loop' if h.in_loop else 'outside of every loop'}: {h.why}")
    return lines


def sampled_lines(sampled: Sequence[HeldVariable]) -> list[str]:
    """A line that names the variables that samples set in a sampled system, with their parts and periods, and one on those
    that are rounded."""
    parts: dict[tuple[str, float | None], list[HeldVariable]] = {}
    for h in sampled:
        parts.setdefault((h.part, h.period), []).append(h)
    named = [f"{', '.join(h.name for h in group)} ({group[0].component}, {group[0].place.file}:{group[0].place.line}, "
             f"every {readable(period or 0.0, 's')})" for (_, period), group in parts.items()]
    steps = listing((h.label for h in sampled if h.rounded), 8)
    return [f"sampled: {listing(named, 8)}"] * bool(named) + [
        f"rounded to steps: {steps}; the linear system takes a gain of 1, for motions of many steps. A stable loop may keep "
        "a limit cycle of a few steps, which a run shows"] * bool(steps)


def clock_lines(clocks: Iterable[Clock]) -> list[str]:
    """A line for each irregular clock, which the linear system takes as a regular one."""
    return [f"{clock.text}; the linear system takes its instants as regular, with no sample lost" for clock in clocks]


def with_held(title: str, held: Iterable[HeldVariable]) -> str:
    """The title of a figure, with the held variables that act on the plotted quantities."""
    names = [h.name for h in held if h.in_loop or h.between]
    return f"{title}{'; ' if title else ''}held constant: {listing(names, 6)}" if names else title


def undecided_reasons(held: Iterable[HeldVariable]) -> tuple[str, ...]:
    """The reasons for undecided stability, a phrase for each held variable that causes it."""
    return tuple(f"{h.label} {'lies in a loop' if h.in_loop else 'changes the linear system'} and is "
                 f"{'set at given times' if h.sampled else 'at its threshold'}; the linear system holds it constant"
                 for h in held if h.undecided)


def check_decided(held: Iterable[HeldVariable], wanted: str, hint: str) -> None:
    """Raise UsageError if held variables make the requested verdict undecided."""
    first = next((h for h in held if h.undecided), None)
    if first is not None:
        reasons = undecided_reasons(h for h in held if h.undecided)
        raise UsageError([Problem("held-undecided", f"{wanted} cannot be computed: {reasons[0]}", first.place, hint,
                                  reasons[1:])])


class HeldStructure:
    """The held variables of an assembly between inputs and outputs, by structure; `at` gives them at a point.

    `parameters` are the entries in p of inputs by name, `driven` the entries in u; `outputs` are expressions (k,).
    """

    def __init__(self, assembly: Assembly, parameters: Mapping[str, int], driven: Mapping[str, Sequence[int]],
                 outputs: Sequence[str], expressions: ca.SX):
        flat = assembly.flat
        self.assembly, self.inputs, self.outputs = assembly, (*parameters, *driven), tuple(outputs)
        self.events, self._measured = flat.events, len(flat.inputs) > len(driven)
        states = {column: k for k, column in enumerate(assembly.reduced.states)}
        # a state that samples set has a node of its own, before the state
        self.resets = [(i, reset) for i, event in enumerate(self.events) for reset in event.resets
                       if reset.unknown is not None]
        n_x, n_z, n_h = (len(assembly.x_nominal), len(assembly.z_nominal), len(flat.held))
        self.first_held, self.first_reset = n_x + n_z, n_x + n_z + n_h
        self.first_input = self.first_reset + len(self.resets)
        self.first_output = self.first_input + len(self.inputs)
        self.clock = self.first_output + len(outputs)
        self.n_x = n_x
        values = [reset.value for event in self.events for reset in event.resets]
        indicators = [ca.SX(0) if e.indicator is None else e.indicator for e in self.events]
        impulses = [ca.SX(0) if e.impulse is None else e.impulse.value for e in self.events]
        parts = [assembly.ode, assembly.alg, expressions, assembly.express(stack(values)),
                 assembly.express(stack(indicators)), assembly.express(stack(impulses))]
        self._held_index = [h.index for h in flat.held]
        contents = self._contents(stack(parts), parameters, driven)
        ends = np.cumsum([0, *(part.numel() for part in parts)]).tolist()
        self._ode, alg, out, value, indicator, impulse = (contents[a:b] for a, b in pairwise(ends))
        edges = [(source, k) for k, row in enumerate(self._ode) for source in row]
        edges += [(source, self.first_output + k) for k, row in enumerate(out) for source in row]
        edges += self._loops(alg, n_x, n_z)
        row = 0
        held_node = {index: self.first_held + k for k, index in enumerate(self._held_index)}
        self._setters: dict[int, list[int]] = {}
        reset_node = self.first_reset
        for i, event in enumerate(self.events):
            for reset in event.resets:
                if reset.held is not None:
                    node = held_node[reset.held]
                elif reset.unknown is not None:
                    node, reset_node = reset_node, reset_node + 1
                    edges.append((node, states[(reset.unknown, 0)]))
                self._setters.setdefault(node, []).append(i)
                edges += [(source, node) for source in {*value[row], *indicator[i]}]
                row += 1
            if event.impulse is not None:
                node = held_node[event.impulse.force]
                self._setters.setdefault(node, []).append(i)
                edges += [(source, node) for source in {*impulse[i], *indicator[i]}]
        self.edges, self._indicator = edges, indicator
        self._slopes: tuple[list[bool], ca.Function, ca.Function] | None = None
        self._parameters, self._driven = list(parameters.values()), [k for many in driven.values() for k in many]
        self._values = ca.Function("values", list(assembly.arguments),
                                   [parts[4], ca.jacobian(parts[4], assembly.arguments[1])])

    def _contents(self, column: ca.SX, parameters: Mapping[str, int], driven: Mapping[str, Sequence[int]]) -> list[set[int]]:
        """The nodes that each element of a column contains."""
        function = ca.Function("structure", list(self.assembly.arguments), [column])
        n_x = self.n_x
        entries: list[dict[int, int]] = [{0: self.clock}, {k: k for k in range(n_x)},
                                         {k: n_x + k for k in range(self.first_held - n_x)}]
        entries.append({index: self.first_held + k for k, index in enumerate(self._held_index)})
        entries[3] |= {index: self.first_input + k for k, index in enumerate(parameters.values())}
        added = {at: self.first_input + len(parameters) + k for k, many in enumerate(driven.values()) for at in many}
        entries.append(dict.fromkeys(range(self.assembly.arguments[4].numel()), self.clock) | added)
        contents: list[set[int]] = [set() for _ in range(column.numel())]
        for argument, nodes in enumerate(entries):
            if not self.assembly.arguments[argument].numel():
                continue
            for i, j in zip(*function.jac_sparsity(0, argument).get_triplet(), strict=True):
                if (node := nodes.get(j)) is not None:
                    contents[i].add(node)
        return contents

    def _loops(self, alg: Sequence[set[int]], n_x: int, n_z: int) -> list[tuple[int, int]]:
        """Edges to the algebraic unknowns, each determined by the equation that is matched to it."""
        rows = [sorted(node - n_x for node in row if n_x <= node < n_x + n_z) for row in alg]
        edges = []
        for k, column in enumerate(maximum_matching(rows, n_z) if n_z else ()):
            targets = [column] if column >= 0 else rows[k]
            edges += [(source, n_x + c) for c in targets for source in alg[k] if source != n_x + c]
        return edges

    @cached_property
    def _graph(self) -> tuple[NDArray[np.int32], dict[int, set[int]], dict[int, set[int]]]:
        """The strongly connected group of each node, and the nodes that each input reaches and each output follows from."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import breadth_first_order, connected_components

        n = self.clock + 1
        sources, targets = np.array(self.edges, dtype=int).reshape(-1, 2).T
        graph = csr_array((np.ones(len(sources)), (sources, targets)), (n, n))
        back = csr_array(graph.T)
        groups = connected_components(graph, connection="strong")[1]
        reached = {k: set(breadth_first_order(graph, self.first_input + k, return_predecessors=False).tolist())
                   for k in range(len(self.inputs))}
        shown_by = {k: set(breadth_first_order(back, self.first_output + k, return_predecessors=False).tolist())
                    for k in range(len(self.outputs))}
        return groups, reached, shown_by

    @cached_property
    def _direct(self) -> list[set[int]]:
        """The symbols that the condition of each event contains, through algebraic unknowns but not through states."""
        by_target: dict[int, set[int]] = {}  # the symbols in the equation of each algebraic unknown
        for source, target in self.edges:
            if self.n_x <= target < self.first_held:
                by_target.setdefault(target, set()).add(source)
        symbols_by_event = []
        for row in self._indicator:
            visited, waiting = set[int](), list(row)
            while waiting:
                node = waiting.pop()
                if node not in visited:
                    visited.add(node)
                    waiting += by_target.get(node, ())
            symbols_by_event.append(visited)
        return symbols_by_event

    def _recurring(self, point: Point) -> list[bool]:
        """True for events that recur for every motion: by a period, or by a condition of the time and of variables that such
        events set, without states."""
        clocked = [e.indicator is not None and not any(node < self.n_x for node in self._direct[i])
                   for i, e in enumerate(self.events)]
        recurring = [e.period is not None or (clocked[i] and self.clock in self._direct[i] and self._opens(point, i))
                     for i, e in enumerate(self.events)]
        while True:
            moving = {node for node, setters in self._setters.items() if any(recurring[i] for i in setters)}
            more = [r or (clocked[i] and bool(self._direct[i] & moving)) for i, r in enumerate(recurring)]
            if more == recurring:
                return recurring
            recurring = more

    def _opens(self, point: Point, event: int) -> bool:
        """True if a condition becomes true during a run with all states constant; with measured inputs it is assumed."""
        if self._measured:
            return True
        end = _span(self.assembly)
        times = point.t + np.concatenate([np.geomspace(1e-6, 1, 60), np.linspace(0, 1, HELD.instants)[1:]]) * end
        return any(float(self._values(*replace(point, t=float(t)).values())[0][event]) > 0 for t in times)

    def at(self, point: Point) -> tuple[HeldVariable, ...]:
        """The held variables at a point: first those that make the stability undecided, then those in loops."""
        assembly, flat = self.assembly, self.assembly.flat
        groups, reached, shown_by = self._graph
        indicators, slopes = (np.array(v.full()) for v in self._values(*point.values()))
        margin = HELD.threshold * (np.abs(slopes) @ assembly.x_nominal)
        threshold = [e.indicator is not None and abs(v) <= m
                     for e, v, m in zip(self.events, indicators.ravel().tolist(), margin.tolist(), strict=True)]
        recurring = self._recurring(point)
        acting = {source for source, target in self.edges
                  if target < self.first_held or self.first_output <= target < self.clock}
        looped = set(groups[:self.n_x].tolist()) | self._growing(point, recurring)
        timed = self._timed(point)
        smooth = {row: even and self.updates[row][1].name not in timed for row, even in self._smooth(point).items()}
        variables = list[HeldVariable]()
        for k, held in enumerate(flat.held):
            node = self.first_held + k
            setters = self._setters.get(node, [])
            if all(self.events[i].by_clock for i in setters) and not self._changes(held.index):
                continue
            path = held.name.rpartition(".")[0]
            leaf, sampled = flat.expanded.leaves.get(path), any(recurring[i] for i in setters)
            variables.append(HeldVariable(
                held.name, path, leaf.component.name if leaf else "", leaf.place if leaf else held.place,
                float(point.p[held.index]), held.unit.text, held.doc, sampled,
                groups[node] in looped, any(threshold[i] for i in setters),
                node in acting, *self._paths(node, reached, shown_by), varying=sampled and self._changes(held.index)))
            variables[-1] = self._with_exact(variables[-1], setters, recurring, smooth)
        numbers = {column: k for k, column in enumerate(assembly.reduced.states)}
        for k, (i, reset) in enumerate(self.resets):
            if not recurring[i] or reset.unknown is None:
                continue
            node, state = self.first_reset + k, numbers[(reset.unknown, 0)]
            path = reset.name.rpartition(".")[0]
            leaf = flat.expanded.leaves.get(path)
            variables.append(HeldVariable(
                reset.name, path, leaf.component.name if leaf else "", leaf.place if leaf else reset.place,
                float(point.x[state]), flat.unknowns[reset.unknown].unit.text, "", True,
                groups[state] in looped, False, True, *self._paths(state, reached, shown_by), state=True))
            variables[-1] = self._with_exact(variables[-1], self._setters[node], recurring, smooth)
        return tuple(sorted(variables, key=lambda h: (not h.undecided, not h.in_loop)))

    def _with_exact(self, held: HeldVariable, setters: Sequence[int], recurring: Sequence[bool], smooth: Mapping[int, bool]
                    ) -> HeldVariable:
        """The variable; `exact` if all recurring events that set it are samples at regular times with smooth values."""
        rows = [row for row, (i, reset) in enumerate(self.updates) if recurring[i] and reset.name == held.name
                and self.events[i].period is not None]
        exact = held.sampled and not held.at_threshold and bool(rows) \
            and (held.in_loop or held.between) and all(smooth[row] for row in rows) \
            and all(self.events[i].period is not None for i in setters if recurring[i])
        return replace(held, exact=exact, rounded=exact and any(row in self.means for row in rows))

    @cached_property
    def _effects(self) -> ca.Function | None:
        """The derivatives of the equations by the held variables, and their rates of change with the time alone; None if
        they do not depend on the time."""
        assembly = self.assembly
        t, p = assembly.arguments[0], assembly.arguments[3]
        columns = ca.jacobian(stack([assembly.ode, assembly.alg]), stack([p[h.index] for h in assembly.flat.held]))
        rates = ca.reshape(ca.jtimes(ca.vec(columns), t, ca.SX(1)), columns.shape)
        return ca.Function("effects", list(assembly.arguments), [columns, rates]) if rates.nnz() else None

    def _timed(self, point: Point) -> set[str]:
        """The held variables whose effect between samples changes with the time, such as the slope of a hold of first
        order. At times at which a factor of time is constant, such as a change-over before or after it, it is none."""
        if self._effects is None:
            return set()
        effects, rates = (np.abs(np.array(part)).max(axis=0, initial=0.0) for part in self._effects(*point.values()))
        changing = rates * _span(self.assembly) > HELD.steady * effects
        return {h.name for h, changes in zip(self.assembly.flat.held, changing, strict=True) if changes}

    def _smooth(self, point: Point) -> dict[int, bool]:
        """True for updates at regular times whose value (of a quantiser its mean) is not rounded to steps, does not jump
        near the point, and either depends on states, held variables or inputs at the point or is constant everywhere (a
        derivative part with a gain of zero)."""
        rows = [row for row, (i, _) in enumerate(self.updates) if self.events[i].period is not None]
        if not rows:
            return {}
        stepped, values, slopes = self._update_slopes(rows)
        by = np.abs(np.array(slopes(*point.values()).full()))
        sign = np.where(np.arange(self.n_x) % 2, -1.0, 1.0)
        jumps = np.zeros(len(stepped), dtype=bool)
        for direction in (np.ones(self.n_x), sign):
            step = HELD.threshold * self.assembly.x_nominal * direction
            ends = [np.array(values(*replace(point, x=point.x + end).values())).ravel() for end in (-step, step)]
            jumps |= np.abs(ends[1] - ends[0]) > HELD.jump * (by[:, :self.n_x] @ np.abs(step)) + \
                HELD.threshold * np.abs(ends).max(axis=0)
        moves = by.any(axis=1)
        if not moves.all():
            # whether the values of updates are the same at a point and at others far from it, drawn at random
            random, reference = np.random.default_rng(0), np.array(values(*point.values())).ravel()
            same = np.ones(len(reference), dtype=bool)
            n_h, n_x, n_z, n_u = len(self._held_index), self.n_x, len(point.z), len(point.u)
            for size in HELD.distances * HELD.draws:
                p, splits = point.p.copy(), np.cumsum([n_x, n_z, n_u])
                x, z, u, held = np.split(size * random.uniform(-1, 1, n_x + n_z + n_u + n_h), splits)
                p[self._held_index] += held * (1 + np.abs(p[self._held_index]))
                random_point = replace(point, x=point.x + x * self.assembly.x_nominal,
                                       z=point.z + z * self.assembly.z_nominal, u=point.u + u, p=p)
                same &= np.array(values(*random_point.values())).ravel() == reference
            moves |= same
        return {row: bool(moving) and not steps and not jump
                for row, moving, steps, jump in zip(rows, moves.tolist(), stepped, jumps.tolist(), strict=True)}

    @cached_property
    def updates(self) -> list[tuple[int, FlatReset]]:
        """Each event with each of its assignments."""
        return [(i, reset) for i, event in enumerate(self.events) for reset in event.resets]

    @cached_property
    def means(self) -> dict[int, ca.SX]:
        """The new values of quantisers by the number of the update, with a gain of 1 in place of the rounding. A quantiser
        rounds signals of other parts. The generator of a pseudorandom number, which rounds its state, is not a quantiser."""
        held, mean_values = {h.name: self.assembly.arguments[3][h.index] for h in self.assembly.flat.held}, dict[int,
                                                                                                                 ca.SX]()
        for row, (i, reset) in enumerate(self.updates):
            if self.events[i].period is None:
                continue
            arguments = without_rounding(self.assembly.update_order.direct[row])[1]
            part = self.events[i].name.rpartition(".")[0]
            held_symbols = stack(symbol for name, symbol in held.items() if name.rpartition(".")[0] == part)
            if arguments and not any(ca.depends_on(argument, held_symbols) for argument in arguments):
                mean_values[row] = without_rounding(self.assembly.express(reset.value))[0]
        return mean_values

    @cached_property
    def values(self) -> list[ca.SX]:
        """The new value of each update, of a quantiser without its rounding."""
        return [self.means.get(row, value) for row, value in
                enumerate(split(self.assembly.express(stack(reset.value for _, reset in self.updates))))]

    def _update_slopes(self, rows: Sequence[int]) -> tuple[list[bool], ca.Function, ca.Function]:
        """Whether the new value of each of these updates is rounded to steps, the new values, and their derivatives by
        states, algebraic unknowns, held variables and inputs."""
        if self._slopes is not None:
            return self._slopes
        arguments = self.assembly.arguments
        values = stack([self.values[row] for row in rows])
        stepped = []
        for value in split(values):
            function = ca.Function("value", [stack(ca.symvar(value))], [value])
            stepped.append(any(function.instruction_id(k) in STEPPED for k in range(function.n_instructions())))
        by = stack([arguments[1], arguments[2], *(arguments[3][k] for k in (*self._held_index, *self._parameters)),
                    *(arguments[4][k] for k in self._driven)])
        self._slopes = (stepped, ca.Function("values", list(arguments), [values]),
                        ca.Function("slopes", list(arguments), [ca.densify(ca.jacobian(values, by))]))
        return self._slopes

    def _paths(self, node: int, reached: Mapping[int, set[int]], shown_by: Mapping[int, set[int]]
               ) -> tuple[tuple[str, ...], tuple[str, ...]]:
        return (tuple(name for k, name in enumerate(self.inputs) if node in reached[k]),
                tuple(name for k, name in enumerate(self.outputs) if node in shown_by[k]))

    def _growing(self, point: Point, recurring: Sequence[bool]) -> set[int]:
        """The groups of held variables that grow by samples alone, without a state between."""
        nodes = [node for node, setters in self._setters.items() if self.first_held <= node < self.first_reset
                 and any(recurring[i] for i in setters)]
        if not nodes:
            return set()
        groups, (values, targets) = self._graph[0], self._recursion
        slopes = np.array(values(*point.values()).full())
        matrix = np.zeros((len(self._held_index), len(self._held_index)))
        for row, (event, target) in enumerate(targets):
            if recurring[event]:
                matrix[target] = slopes[row]
        growing = set()
        for group in {int(groups[node]) for node in nodes}:
            members = [k for k in range(len(matrix)) if groups[self.first_held + k] == group]
            part = matrix[np.ix_(members, members)]
            if np.isfinite(part).all() and np.abs(np.linalg.eigvals(part)).max(initial=0.0) > HELD.grows:
                growing.add(group)
        return growing

    @cached_property
    def _recursion(self) -> tuple[ca.Function, list[tuple[int, int]]]:
        """The derivatives of new values by the held variables, and the event and the held variable of each row."""
        position = {index: k for k, index in enumerate(self._held_index)}
        kept_rows = [row for row, (_, reset) in enumerate(self.updates) if reset.held is not None]
        rows, values = [self.updates[row] for row in kept_rows], stack([self.values[row] for row in kept_rows])
        held = stack([self.assembly.arguments[3][index] for index in self._held_index])
        return (ca.Function("recursion", list(self.assembly.arguments), [ca.densify(ca.jacobian(values, held))]),
                [(i, position[reset.held]) for i, reset in rows if reset.held is not None])

    def _changes(self, index: int) -> bool:
        """True if the linear system depends on an entry of p."""
        assembly = self.assembly

        def changing() -> set[int]:
            x, z, p = assembly.arguments[1:4]
            slopes = ca.jacobian(stack([assembly.ode, assembly.alg]), stack([x, z]))
            known = places(p)
            return {known[s.element_hash()] for s in ca.symvar(ca.SX(slopes.nz[:])) if s.element_hash() in known} \
                if slopes.nnz() else set()

        return index in assembly.once("held-changing", changing)


class StartEvents:
    """The events at the instant of a start, which act before the machine is linearised."""

    def __init__(self, assembly: Assembly):
        self.assembly = assembly
        self._equations = EventEquations(assembly, ca.SX(0, 1), ca.SX(0, 1)) if assembly.flat.events else None

    def after(self, point: Point) -> Point:
        """The point after the events of its instant; SimulationError if they leave no solution."""
        equations = self._equations
        if equations is None:
            return point
        first, period = equations.instants(point.p, np.zeros((len(point.p), 0)))[:2]
        same = same_instant(point.t, point.t + _span(self.assembly))
        events = [i for i, event in enumerate(equations.events) if event.indicator is None
                  and _happens(event, float(first[i]), float(period[i]), point.t, same)]
        true = self._indicators(point) > 0
        sensitivity = PointSensitivity(np.zeros((len(point.x), 0)), np.zeros((0, 0)), np.zeros((len(point.p), 0)),
                                       np.zeros((len(point.u), 0)))
        for _ in range(EVENTS.max_cascades if events else 0):
            point, events = equations.breaking(point, events)
            point, sensitivity, yielded = equations.fire(point, sensitivity, events, [np.zeros(0)] * len(events),
                                                         np.zeros(0),
                                                    EVENTS.impact_time)
            fired = np.array([i in (*events, *yielded) for i in equations.conditions], dtype=bool)
            holding = self._indicators(point) > 0
            events = [equations.conditions[c] for c in np.flatnonzero(holding & ~true & ~fired)]
            true = holding
            if not events:
                break
        return self._counted(point)

    @cached_property
    def _counters(self) -> tuple[list[int], ca.Function] | None:
        """The held variables that samples set to values of each other alone, as entries of p, and a function that gives
        their next values; None if there are none."""
        assembly = self.assembly
        t, x, z, p, u, _ = assembly.arguments
        resets = [(event, reset.held, reset.value) for event in assembly.flat.events for reset in event.resets
                  if reset.held is not None]
        irregular = {held for event, held, _ in resets if event.period is None and event.indicator is not None}
        following = {held: assembly.express(value) for event, held, value in resets
                     if event.period is not None and held not in irregular}
        others = {h.index for h in assembly.flat.held} - set(following)
        while True:
            moving = stack([t, x, z, u, *(p[k] for k in sorted(others))])
            dependent = {k for k, value in following.items() if ca.depends_on(value, moving)}
            if not dependent:
                break
            following = {k: value for k, value in following.items() if k not in dependent}
            others |= dependent
        return (list(following), ca.Function("next", [p], [stack(list(following.values()))])) if following else None

    def _counted(self, point: Point) -> Point:
        """The point with the final values of variables that count the first samples, such as those of a moving average."""
        if self._counters is None:
            return point
        indices, following = self._counters
        p = point.p.copy()
        for _ in range(HELD.first_samples):
            values = np.array(following(p)).ravel()
            changed = values != p[indices]
            p[indices] = values
            if not changed.any():
                break
        final = np.array(indices)[~changed]
        if np.array_equal(p[final], point.p[final]):
            return point
        settled = point.p.copy()
        settled[final] = p[final]
        return replace(point, p=settled)

    def _indicators(self, point: Point) -> Array:
        equations = self._equations
        if equations is None or not equations.conditions:
            return np.zeros(0)
        return equations.indicators(np.array([point.t]), point.x[:, None], point.z[:, None], point.p, point.u[:, None]
                                    )[0][:, 0]


def _span(assembly: Assembly) -> float:
    """The time of a run in s."""
    return float(grid(assembly.model, None, None)[-1]) if assembly.model.until is not None else 1.0


def _happens(event: FlatEvent, first: float, period: float, time: float, same: float) -> bool:
    """Whether a time event happens at a time, or once before it."""
    if event.period is None:
        return first <= time + same
    number = round((time - first) / period) if period > 0 else -1
    return number >= 0 and abs(first + number * period - time) <= same
