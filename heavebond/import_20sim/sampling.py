"""Classification of the submodels of a 20-sim model as discrete or continuous, and of the signals between them.

Discrete equations act at the samples only. A submodel is discrete if it calls `sample`, `previous`, `next`, `dint` or
`ddif`, or computes from discrete signals only. Between the samples its signals are constant: a continuous submodel reads
their values at the last sample, with or without a `hold`. Discrete submodels that are connected by signals form one
discrete system, with one sample time, which the experiment gives for one of its quantities.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from heavebond.import_20sim.assignments import assigned, calls, mentioned
from heavebond.import_20sim.names import identifier
from heavebond.import_20sim.sidops_tree import Assign, Do, Expr, For, If, Statement, Submodel, While

DISCRETE = {"sample", "previous", "next", "dint", "ddif"}
CONTINUOUS = {"int", "ddt", "resint", "limint", "tdelay", "dly", "event", "eventup", "eventdown", "timeevent",
              "frequencyevent"}
End = tuple[int, str]  # a submodel by its identity, and its port


@dataclass
class Sampling:
    """The discrete submodels by their identity, for continuous ones the inputs that are held between samples, and the
    sample times in s of submodels in a discrete system with a known one. `sampled` are the quantities that change at
    samples only in submodels with continuous parts too, such as the count of an encoder that integrates a speed."""

    discrete: set[int] = field(default_factory=set)
    held: dict[int, list[str]] = field(default_factory=dict)
    times: dict[int, float] = field(default_factory=dict)
    sampled: dict[int, set[str]] = field(default_factory=dict)


def _expressions(statements: Iterable[Statement]) -> Iterator[Expr]:
    for s in statements:
        if isinstance(s, Assign):
            yield from (s.left, s.right)
        elif isinstance(s, Do):
            yield s.call
        elif isinstance(s, If):
            yield s.condition
            yield from _expressions((*s.then, *s.otherwise))
        elif isinstance(s, While):
            yield s.condition
            yield from _expressions(s.body)
        elif isinstance(s, For):
            yield from _expressions(s.body)


class _Graph:
    """Submodels of equations, and the sources of their inputs."""

    def __init__(self, root: Submodel):
        self.leaves: dict[int, Submodel] = {}
        self.paths: dict[str, int] = {}  # `a\\b` to the submodel of equations
        self.feeds: dict[End, list[End]] = {}
        self._enter(root, "")
        self.calls = {k: self._called(leaf) for k, leaf in self.leaves.items()}

    def _enter(self, block: Submodel, path: str) -> None:
        parts = {part.name: part for part in block.submodels}
        if block.equations is not None:
            self.leaves[id(block)] = block
            self.paths[path] = id(block)
        for connection in block.connections:
            if connection.bond:
                continue
            start, stop = ((id(parts.get(name, block)), port) for name, _, port in
                           (end.rpartition("\\") for end in (connection.start, connection.stop)))
            self.feeds.setdefault(stop, []).append(start)
        for part in block.submodels:
            self._enter(part, f"{path}\\{identifier(part.name)}" if path else identifier(part.name))

    @staticmethod
    def _called(leaf: Submodel) -> set[str]:
        assert leaf.equations is not None
        statements = (*leaf.equations.equations, *leaf.equations.code)
        return {name.lower() for e in _expressions(statements) for name in calls(e)}

    def sources(self, end: End, visited: frozenset[End] = frozenset()) -> list[End]:
        """The outputs of submodels of equations that feed an end."""
        if end in visited:
            return []
        sources = []
        for start in self.feeds.get(end, ()):
            sources += [start] if start[0] in self.leaves else self.sources(start, visited | {end})
        return sources

    def inputs(self, leaf: int) -> dict[str, list[End]]:
        """The connected inputs of a submodel of equations, with their sources."""
        named = {p.name: self.sources((leaf, p.name)) for p in self.leaves[leaf].ports
                 if p.domain == "signal" and p.direction != "out"}
        return {name: sources for name, sources in named.items() if sources}

    def continuous(self, leaf: int) -> bool:
        """True if a submodel has states, events or bonds."""
        return bool(self.calls[leaf] & CONTINUOUS) or any(p.domain != "signal" for p in self.leaves[leaf].ports)

    def sampled(self, leaf: int) -> set[str]:
        """The quantities of a submodel with continuous parts that depend on its samples only."""
        equations = self.leaves[leaf].equations
        assert equations is not None
        statements = (*equations.equations, *equations.code)
        known = {d.name for d in (*equations.constants, *equations.parameters, *self.leaves[leaf].parameters)} | {"pi"}
        assignments: dict[str, list[tuple[set[str], set[str]]]] = {}
        for statement in statements:
            called = {name.lower() for e in _expressions([statement]) for name in calls(e)}
            for label in assigned(statement):
                assignments.setdefault(label, []).append((called, mentioned(statement) - set(assigned(statement)) - known))
        sampled_names: set[str] = set()
        size = -1
        while size != len(sampled_names):
            size = len(sampled_names)
            sampled_names |= {label for label, dependencies in assignments.items() if all(
                not called & (CONTINUOUS | {"hold"}) and (called & DISCRETE or (read and read <= sampled_names))
                for called, read in dependencies)}
        return sampled_names

    def holds(self, end: End) -> bool:
        """True if an output is the result of a `hold`."""
        equations = self.leaves[end[0]].equations
        assert equations is not None
        written = [s.right for s in (*equations.equations, *equations.code) if isinstance(s, Assign)
                   and s.left.op == "name" and s.left.name == end[1]]
        return bool(written) and all(e.op == "call" and e.name.lower() == "hold" for e in written)


def sampling(root: Submodel, sample_times: Mapping[str, float]) -> Sampling:
    """The discrete parts of a model, with the sample times in s of its discrete systems, each by the name of a quantity."""
    graph, result = _Graph(root), Sampling()
    inputs = {leaf: graph.inputs(leaf) for leaf in graph.leaves}
    result.discrete = {leaf for leaf, called in graph.calls.items() if called & DISCRETE and not graph.continuous(leaf)}
    result.sampled = {leaf: sampled_names for leaf, called in graph.calls.items()
                      if called & DISCRETE and graph.continuous(leaf) and (sampled_names := graph.sampled(leaf))}
    mixed: set[int] = set()  # algebraic, with discrete and continuous signals

    def discrete(source: End) -> bool:
        leaf, port = source
        return (leaf in result.discrete or leaf in mixed or port in result.sampled.get(leaf, ())) and not graph.holds(source)

    plain = [leaf for leaf, called in graph.calls.items()
             if not graph.continuous(leaf) and not called & (DISCRETE | {"hold"})]
    size = -1
    while size != len(result.discrete) + len(mixed):
        size = len(result.discrete) + len(mixed)
        for leaf in plain:
            source_kinds = [discrete(source) for sources in inputs[leaf].values() for source in sources]
            if source_kinds and all(source_kinds):
                result.discrete.add(leaf)
                mixed.discard(leaf)
            elif any(source_kinds) and leaf not in result.discrete and _ends_in(graph, inputs, leaf, result.discrete):
                mixed.add(leaf)
    for leaf in graph.leaves:
        if leaf not in result.discrete and leaf not in mixed and "hold" not in graph.calls[leaf]:
            held = [name for name, sources in inputs[leaf].items() if any(discrete(s) for s in sources)]
            if held:
                result.held[leaf] = held
    result.times = _times(graph, inputs, result, sample_times)
    return result


def _times(graph: _Graph, inputs: Mapping[int, Mapping[str, list[End]]], result: Sampling, stated: Mapping[str, float]
           ) -> dict[int, float]:
    """The sample times that reach a submodel from a given one through the signals of a discrete system."""
    acts = {leaf for leaf, called in graph.calls.items() if leaf in result.discrete or called & (DISCRETE | {"hold"})}
    beside: dict[int, set[int]] = {leaf: set() for leaf in graph.leaves}
    for leaf, named in inputs.items():
        for sources in named.values():
            for source, _ in sources:
                if leaf in acts and source in acts:
                    beside[leaf].add(source)
                    beside[source].add(leaf)
    times: dict[int, float] = {}
    for name, time in stated.items():
        first = graph.paths.get(name.rpartition("\\")[0])
        front = [] if first is None or first in times else [first]
        while front:
            times[reached := front.pop()] = time
            front += [neighbour for neighbour in beside[reached] if neighbour not in times]
    for leaf, held in result.held.items():  # continuous ones that take its signals
        known_times = [times[source] for name in held for source, _ in inputs[leaf][name] if source in times]
        times.update({leaf: known_times[0]} if known_times and leaf not in times else {})
    return times


def _ends_in(graph: _Graph, inputs: dict[int, dict[str, list[End]]], leaf: int, discrete: set[int]) -> bool:
    """True if the outputs of an algebraic submodel reach a discrete one, or a `hold`, through algebraic ones."""
    visited, front = {leaf}, [leaf]
    while front:
        reached = front.pop()
        for consumer, named in inputs.items():
            if consumer in visited or not any(s[0] == reached for sources in named.values() for s in sources):
                continue
            if consumer in discrete or "hold" in graph.calls[consumer]:
                return True
            if not graph.continuous(consumer):
                visited.add(consumer)
                front.append(consumer)
    return False
