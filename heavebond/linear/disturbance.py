"""Disturbance inputs for linear analysis: added to a signal or entering a node, with their time derivatives.

The signal s of a component or a formula becomes s = (its law) + w; all readers of the signal receive s. The balance of a
node receives a further through variable: a force, torque or flow w that enters the node. Index reduction differentiates w
like a measured input, so that a position source passes w' and w'' on exactly. In runs w is zero.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np

from heavebond.core.errors import Problems, UsageError, listing, suggest
from heavebond.core.units import Unit
from heavebond.equations.flatten import EquationRole, Flat, KnownInput
from heavebond.equations.places import nodes_of
from heavebond.language.definition import FileInput
from heavebond.language.symbols import stack
from heavebond.numerics.inputs import Pieced, pieced


@dataclass(frozen=True)
class _Source:
    """The location of a disturbance: an unknown with the equations that set it, or a node."""

    unit: Unit
    rows: tuple[int, ...]
    unknown: int | None = None


def inner_name(name: str) -> str:
    """The name of the measured input that represents the disturbance of a signal or node."""
    return f"added to {name}"


def disturbed(flat: Flat, names: Iterable[str]) -> Flat:
    """The flat model with an input `inner_name(name)` for each name; UsageError for a name that is neither a signal nor the
    through variable of a node (`crown.f`)."""
    problems, nodes = Problems(), nodes_of(flat)
    residuals, inputs = list(flat.residuals), list(flat.inputs)
    for name in names:
        # the location of the disturbance of a name; a problem if nothing can be added there
        owner, _, member = name.rpartition(".")
        node, source_unknown = nodes.get(owner), flat.names.get(name)
        if node is not None and member == node.through:
            source = _Source(node.unit,
                             tuple(k for k, e in enumerate(flat.equations)
                                   if e.role is EquationRole.BALANCE and e.subject == name))
        elif source_unknown is None or flat.unknowns[source_unknown].role != "signal":
            signals = [n for n, k in flat.names.items() if flat.unknowns[k].role == "signal"]
            forces = [f"{n.name}.{n.through}" for n in nodes.values()]
            problem = "nothing here is called" if source_unknown is None else "nothing can be added to"
            problems.add("input-unknown", f"{problem} '{name}'", hint=suggest(name, [*signals, *forces]) or
                         f"Signals: {listing(signals or ['none'], 12)}. Through variables of nodes: "
                         f"{listing(forces or ['none'], 6)}.")
            source = None
        else:
            aliases = {n for n, k in flat.names.items() if k == source_unknown}
            rows = tuple(k for k, e in enumerate(flat.equations)
                         if e.role in (EquationRole.GIVEN, EquationRole.MEASURED) and e.subject in aliases)
            source = _Source(flat.unknowns[source_unknown].unit, rows or _driving_rows(flat, name, source_unknown, problems),
                             source_unknown)
        if source is None:
            continue
        inner = inner_name(name)
        symbols = ca.vertcat(*(ca.SX.sym("d" * k + inner) for k in range(4)))
        place = flat.equations[source.rows[0]].place
        inputs.append(KnownInput(inner, FileInput(Path(), name, source.unit.text, "spline", place), source.unit, symbols))
        for row in source.rows:
            residual = residuals[row]
            unknown = source.unknown
            if unknown is None:  # what flows into the components sums to what enters
                residuals[row] = residual - symbols[0]
            else:
                whole = stack([level[unknown] for level in flat.levels])
                residuals[row] = ca.substitute(residual, whole, whole - symbols[:whole.numel()])
    problems.raise_as(UsageError)
    return replace(flat, residual_column=stack(residuals), inputs=tuple(inputs), options=None)


def freed(flat: Flat, names: Iterable[str], interpolation: str) -> Flat:
    """The flat model in which the law of each named signal is replaced by an input of that name, the last of its inputs.
    UsageError for a name that is not a signal with a separate law."""
    problems, residuals, inputs = Problems(), list(flat.residuals), list(flat.inputs)
    signals = {n: k for n, k in flat.names.items() if flat.unknowns[k].role == "signal"}
    for name in names:
        if name not in signals:
            problems.add("input-unknown", f"'{name}' is not a signal of this diagram", hint=suggest(name, signals) or
                         f"Signals: {listing(list(signals) or ['none'], 12)}.")
            continue
        unknown = signals[name]
        aliases = {n for n, k in flat.names.items() if k == unknown}
        rows = [k for k, e in enumerate(flat.equations)
                if e.role in (EquationRole.GIVEN, EquationRole.MEASURED) and e.subject in aliases]
        if not rows:  # the law of a component: its equation with the signal on the left side
            ports = [n for n in aliases if n in flat.expanded.signals and flat.expanded.signals[n].direction == "out"]
            rows = [k for k, e in enumerate(flat.equations) for owner, _, port in (n.rpartition(".") for n in ports)
                    if e.owner == owner and e.text.partition("=")[0].strip() == port]
        if len(rows) != 1:
            problems.add("signal-not-free", f"'{name}' is not determined by a single equation that a free input could "
                         "replace", hint="Put a Gain of 1 into that wire, and name its output.")
            continue
        unit, symbols = flat.unknowns[unknown].unit, ca.vertcat(*(ca.SX.sym("d" * k + name) for k in range(4)))
        inputs.append(KnownInput(name, FileInput(Path(), name, unit.text, interpolation, flat.equations[rows[0]].place),
                                 unit, symbols))
        residuals[rows[0]] = flat.levels[0][unknown] - symbols[0]
    problems.raise_as(UsageError)
    return replace(flat, residual_column=stack(residuals), inputs=tuple(inputs), options=None)


def quiet(flat: Flat, added: int, begin: float, end: float) -> Pieced:
    """The measured inputs of a disturbed model on [begin, end]: the inputs of its records, and the last `added` inputs at
    zero."""
    records = pieced(replace(flat, inputs=flat.inputs[:len(flat.inputs) - added]), begin, end)
    if not records.columns.size:
        return Pieced(np.array([begin, end]), np.zeros((1 + 4 * added if added else 0, 1 if added else 0)))
    return Pieced(records.breaks, np.vstack([records.columns, np.zeros((4 * added, records.columns.shape[1]))]))


def _driving_rows(flat: Flat, name: str, unknown: int, problems: Problems) -> tuple[int, ...]:
    """The equations of the component whose output a signal is."""
    signals = flat.expanded.signals
    ports = [n for n, k in flat.names.items() if k == unknown and n in signals]
    owners = {n.rpartition(".")[0] for n in ports if signals[n].direction == "out"}
    read = {n.rpartition(".")[0] for n in ports if signals[n].direction == "in"}
    symbols = {level[unknown].element_hash() for level in flat.levels}
    rows = tuple(k for k, e in enumerate(flat.equations) if e.owner in owners and any(
        s.element_hash() in symbols for s in ca.symvar(flat.residuals[k])))
    acting = {flat.equations[k].owner for k in rows}
    if acting & read:
        problems.add("signal-own", f"'{name}' is read by the component that sets it, so that nothing can be added between",
                     hint="Put a Gain of 1 into that wire, and name its output.")
    return rows
