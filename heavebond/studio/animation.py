"""Animated quantities on the drawing of a run: effort, flow and power of the wires, energy and losses of the parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from heavebond.core.presentation import converted, readable_unit
from heavebond.equations.flatten import Flat
from heavebond.language.symbols import stack
from heavebond.linear.linearisation import Mode, ModesAtStart
from heavebond.linear.modal_values import ModalEnergies
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.result import Result
from heavebond.numerics.start_equations import Point
from heavebond.studio.contents import Entry

FRAMES = 400  # largest number of instants that the page shows in sequence
SIGNAL = "signal"
SMALLEST = 1e-6  # amplitude at a node, relative to the largest of its domain, below which it is rounding


def animation(result: Result) -> tuple[Entry, Array]:
    """The quantities of a run on its drawing: `effort`, `flow` and `power` of each node, `energy` and `loss` of each part.
    For each quantity: the row of its time series, its unit and its largest magnitude. The time series are (1 + rows, F); the
    first row is the time in s.

    The across variable of a node has its sign. Its through variable is the largest magnitude at its ports. The power through
    a node is half the sum of the magnitudes at its ports. `loss` is the power that a part dissipates.
    """
    flat = result.assembly.flat
    wanted = [*_of_nodes(flat), *_of_parts(flat)]
    # indices of output points that are about evenly spread over the time
    times = result.time
    if len(times) <= FRAMES:
        chosen: NDArray[np.intp] = np.arange(len(times))
    else:
        chosen = np.unique(np.searchsorted(times, np.linspace(times[0], times[-1], FRAMES)))
    values = result.evaluate(stack([expr for *_, expr in wanted]))[:, chosen] if wanted else np.zeros((0, len(chosen)))
    entries: dict[str, dict[str, Entry]] = {"nodes": {}, "parts": {}}
    rows = [result.time[chosen]]
    for (kind, path, quantity, unit, domain, _), row in zip(wanted, values, strict=True):
        size = float(np.abs(row).max(initial=0.0))
        if not np.isfinite(size) or (size == 0.0 and kind == "parts"):
            continue
        display_unit = readable_unit(unit, size)
        entries[kind].setdefault(path, {"domain": domain})[quantity] = [len(rows), "" if display_unit == "1"
                                                                        else display_unit]
        rows.append(converted(row, unit, display_unit))
    return dict(entries), np.vstack(rows)


Wanted = tuple[str, str, str, str, str, ca.SX]  # nodes or parts, path, quantity, unit, domain, expression


def _of_nodes(flat: Flat) -> Iterable[Wanted]:
    values, bonds = flat.levels[0], {**flat.bonds, **flat.block_bonds}
    for path, junction in flat.expanded.junctions.items():
        domain = flat.domains.get(path)
        ends = [f"{end.leaf}.{end.port}" for end in junction.ends if end.sign > 0]
        if domain is None:
            if (k := next((flat.names[end] for end in ends if end in flat.names), None)) is not None:
                for quantity in ("effort", "flow"):
                    yield "nodes", path, quantity, flat.unknowns[k].unit.text, SIGNAL, values[k]
            continue
        bonds_at_node = [bonds[end] for end in ends if end in bonds]
        if not bonds_at_node:
            continue
        yield "nodes", path, "power", "W", domain.name, 0.5 * sum((ca.fabs(bond.power(values)) for bond in bonds_at_node),
                                                                  ca.SX(0))
        if domain.effort is None or domain.flow is None:  # several pairs, or one power
            continue
        for quantity, name, numbers in (("effort", domain.effort, [bond.efforts[0] for bond in bonds_at_node]),
                                        ("flow", domain.flow, [bond.flows[0] for bond in bonds_at_node])):
            value = values[numbers[0]]
            if name in domain.through:
                value = ca.fabs(value)
                for k in numbers[1:]:
                    value = ca.fmax(value, ca.fabs(values[k]))
            yield "nodes", path, quantity, flat.unknowns[numbers[0]].unit.text, domain.name, value


def _of_parts(flat: Flat) -> Iterable[Wanted]:
    """The energy stored in each part and its loss, summed over the parts of a block."""
    for path in flat.expanded.leaves:
        part_energetics = [e for e in flat.energetics if e.owner == path or e.owner.startswith(f"{path}.")]
        for quantity, unit, terms in (("energy", "J", [e.energy for e in part_energetics]),
                                      ("loss", "W", [e.dissipated for e in part_energetics])):
            total = sum(terms, ca.SX(0))
            if not total.is_zero():
                yield "parts", path, quantity, unit, "", total


def modes(assembly: Assembly, settings: Mapping[str, float | str]) -> Entry:
    """The modes at the start with the shares of the parts in their energy, as `heavebond modes` lists them, and the shape of
    each mode at the nodes."""
    at_start = ModesAtStart(assembly)
    first, modes_at_start = at_start.at(settings)
    point = at_start.point(first)
    energies = ModalEnergies(assembly)
    shares, shapes = energies.shares(point, modes_at_start), _shapes(energies, point, modes_at_start)
    held = [h.name for h in at_start.constant(first) if h.acts]
    entries = []
    for mode, share, shape in zip(modes_at_start, shares, shapes, strict=True):
        # the share of a block is the sum over its parts
        sums = {path: sum(energy for owner, energy in share.energy.items() if owner == path or owner.startswith(f"{path}."))
                for path in assembly.flat.expanded.leaves}
        entries.append({"frequency": mode.frequency, "damping": mode.damping if mode.value else None,
                        "swings": mode.swings, "held": held, "shape": shape,
                        "energy": {path: energy for path, energy in sums.items() if energy > 0}})
    return {"modes": entries}


def _shapes(energies: ModalEnergies, point: Point, modes_at_start: Sequence[Mode]) -> list[dict[str, tuple[float, float]]]:
    """For each mode the complex amplitude (real and imaginary part) of the across variable of each node. The largest
    amplitude of each domain is 1."""
    if not modes_at_start or any(mode.z is not None for mode in modes_at_start):
        return [{} for _ in modes_at_start]
    flat = energies.assembly.flat
    efforts, flows = energies.motions(point, modes_at_start)
    row = {name: k for k, name in reversed(list(enumerate(energies.ports)))}
    across: dict[str, tuple[str, NDArray[np.complex128]]] = {}
    for path, junction in flat.expanded.junctions.items():
        domain = flat.domains.get(path)
        port = next((name for end in junction.ends if (name := f"{end.leaf}.{end.port}") in row), None)
        if domain is not None and port is not None and domain.effort is not None and domain.flow is not None:
            across[path] = domain.name, (flows if domain.effort in domain.through else efforts)[row[port]]
    shapes = []
    for k in range(len(modes_at_start)):
        largest: dict[str, complex] = {}
        for domain_name, values in across.values():
            largest[domain_name] = max(largest.get(domain_name, 0j), complex(values[k]), key=abs)
        scaled = {path: complex(values[k]) / largest[domain_name]
                  for path, (domain_name, values) in across.items() if largest[domain_name]}
        shapes.append({path: (value.real, value.imag) for path, value in scaled.items() if abs(value) > SMALLEST})
    return shapes
