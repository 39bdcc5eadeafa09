"""The signals of a diagram that depend on a part without a law (`placeholder:`).

The unknowns at the ports of a placeholder depend on it. The states and algebraic unknowns in the expressions of these
unknowns depend on it, too, because the missing law would determine a flow into them. The dependence then propagates through
the equations: from the right-hand side to its state, within an algebraic equation, from an event to the variables that it
sets, and from the source to its delayed variable.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import casadi as ca

from heavebond.language.symbols import split
from heavebond.numerics.dae import Assembly


def lawless_parts(assembly: Assembly) -> tuple[str, ...]:
    """The paths of the parts without a law."""
    return tuple(path for path, leaf in assembly.flat.expanded.leaves.items() if leaf.component.placeholder)


def depends_on_placeholder(assembly: Assembly, signals: Iterable[ca.SX]) -> tuple[bool, ...]:
    """For each signal in the arguments of an assembly: True if it depends on a part without a law."""
    if not lawless_parts(assembly):
        return tuple(False for _ in signals)
    affected = assembly.once("dependent on placeholders", lambda: _affected(assembly))
    return tuple(not affected.isdisjoint(_symbols(signal)) for signal in signals)


def _symbols(expression: ca.SX) -> set[int]:
    return {symbol.element_hash() for symbol in ca.symvar(expression)}


def _affected(assembly: Assembly) -> set[int]:
    """The hashes of the arguments of an assembly that depend on parts without a law."""
    flat, (time, x, z, p, u, rate) = assembly.flat, assembly.arguments
    never = {time.element_hash(), rate.element_hash()}
    affected: set[int] = set()
    for path in lawless_parts(assembly):
        component = flat.expanded.leaves[path].component
        ports = {*component.ports, *(name for name, s in component.signals.items() if s.direction == "out")}
        for name, number in flat.names.items():
            if name.startswith(f"{path}.") and re.split(r"[.\[]", name.removeprefix(f"{path}."))[0] in ports:
                affected |= _symbols(assembly.express(flat.levels[0][number])) - never
    # the cause of each argument: the symbols on its right-hand side
    causes: list[tuple[set[int], set[int]]] = []  # symbols, and the arguments that depend on each of them
    causes += [(_symbols(right), {state.element_hash()}) for state, right in
               zip(split(x), split(assembly.ode), strict=True)]
    unknowns = _symbols(z)
    causes += [(symbols, symbols & unknowns) for symbols in map(_symbols, split(assembly.alg))]
    states = {column: k for k, column in enumerate(assembly.reduced.states)}
    for event in flat.events:
        condition = set().union(*(_symbols(assembly.express(e)) for e in (event.indicator, event.first, event.period)
                                  if e is not None))
        for reset in event.resets:
            state = states.get((reset.unknown, 0)) if reset.unknown is not None else None
            target = p[reset.held] if reset.held is not None else x[state] if state is not None else None
            if target is not None:
                causes.append((condition | _symbols(assembly.express(reset.value)), _symbols(target)))
    causes += [(_symbols(assembly.express(delay.source)), _symbols(u)) for delay in flat.delays]
    while True:
        before = len(affected)
        for symbols, targets in causes:
            if not affected.isdisjoint(symbols):
                affected |= targets - never
        if len(affected) == before:
            return affected
