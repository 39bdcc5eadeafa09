"""Colours of a run in a drawing: the power that components and nodes transmit, or any variable of them.

Of the powers P_k = effort * flow at the ports of a component, the positive ones enter and the negative ones leave; the
transmitted power is the larger of the two sums: the power that enters a damper, that leaves a source, or that passes
through a lever. At a node both sums are equal. If only differences of an effort have a meaning, as of voltages, two ports
with opposite flows, i_a = -i_b, count as one: P = (v_a - v_b) i_a, whatever the ground is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.presentation import readable_unit, unit_label, written
from heavebond.core.units import read_unit
from heavebond.energy_audit.audit import port_powers
from heavebond.equations.expanded import Expanded
from heavebond.language.model import Model
from heavebond.numerics.dae import Array, assemble
from heavebond.numerics.output_times import Time, seconds
from heavebond.numerics.result import Result
from heavebond.numerics.simulation import simulate

POWER, MEAN, PEAK = "power", "mean", "peak"
SCALE = ("#9fb4c7", "#e0b13c", "#d9601f", "#a30d12", "#4d0012")  # from low to high
BOTH_WAYS = ("#08407e", "#2f7fc1", "#a7adb3", "#d9601f", "#8c0d12")  # from negative to positive
SPREAD, DECADES = 30.0, 4  # ratio of the largest to the median value from which on colours are logarithmic
FADED = "#c9ced3"
OPPOSITE = 1e-6  # share of the largest flow by which two flows that are opposite by their equations may differ in a run
Quantities = dict[str, list[str]]


@dataclass(frozen=True)
class Paint:
    """Values by the paths of components and of nodes, in `unit` (`base` in SI); colours run from `low` to `high`."""

    title: str
    unit: str
    parts: dict[str, float]
    nets: dict[str, float]
    low: float
    high: float
    logarithmic: bool = False
    base: str = "1"

    def colour(self, value: float) -> str:
        """The colour of a value, `#rrggbb`."""
        stops = BOTH_WAYS if self.low < 0 else SCALE
        low, high, value = (math.log10(max(v, 1e-300)) for v in (self.low, self.high, value)) if self.logarithmic else \
            (self.low, self.high, value)
        place = min(1.0, max(0.0, (value - low) / (high - low))) * (len(stops) - 1)
        k = min(int(place), len(stops) - 2)
        pairs = zip(_rgb(stops[k]), _rgb(stops[k + 1]), strict=True)
        return "#" + "".join(f"{round(a + (place - k) * (b - a)):02x}" for a, b in pairs)

    def at(self, share: float) -> float:
        """The value at a share of the colour scale from low to high."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)

    def text(self, value: float) -> str:
        """`12.3 kW`, in the prefix that suits this value."""
        return written(read_unit(self.unit).to_si(value), self.base, 3)


def _rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[k:k + 2], 16) for k in (1, 3, 5))


def paint(model: Model, variable: str, *, at: Time | None = None, over: str = MEAN, until: Time | None = None) -> Paint:
    """Run a diagram and colour it by `power` or by a variable: `p` at all nodes that have a pressure, `F` in all components
    that have such a variable, `q` at their ports, `crown.v` at one place.

      The values are taken `at` a time, else their `mean` or `peak` (the largest size) `over` the run. Raises UsageError
      for a variable that does not exist, or that is not the same quantity everywhere.
    """
    assembly = assemble(model, [variable] if "." in variable else ())
    result = simulate(assembly, until)
    moment = None if at is None else seconds(at, "--at")
    if moment is not None and not result.time[0] <= moment <= result.time[-1]:
        raise UsageError([Problem("time-outside", f"--at {at}: the run goes from {result.time[0]:g} to "
                                  f"{result.time[-1]:g} s", None, "Give a time within the run.")])
    when = f"at {moment:g} s" if moment is not None else f"{over} over {result.time[0]:g} to {result.time[-1]:g} s"
    expanded = assembly.flat.expanded
    if variable == POWER:
        # transmitted power of components and nodes (N,), in W
        powers = port_powers(result)
        ports: Quantities = {}
        for end in powers:
            ports.setdefault(end.rpartition(".")[0], []).append(end)
        ends = {path: [e.name for e in junction.ends if e.name in powers] for path, junction in expanded.junctions.items()}
        known = result.assembly.flat.names
        names = [f"{end}.{domain.flow}" for domain in expanded.model.library.domains.values() if domain.relative
                 for end in powers if f"{end}.{domain.flow}" in known and f"{end}.{domain.effort}" in known]
        flows = {name.rpartition(".")[0]: course for name, course in result.signals(names).items()}
        parts = {}
        for path, port_names in ports.items():
            # the powers of one component; two ports of opposite flows are combined
            single_ports, relative_ports = [powers[p] for p in port_names if p not in flows], [p for p in port_names
                                                                                               if p in flows]
            while relative_ports:
                port = relative_ports.pop(0)
                size = OPPOSITE * np.abs(flows[port]).max()
                opposite = next((p for p in relative_ports if np.abs(flows[port] + flows[p]).max() <= size), None)
                if opposite:
                    relative_ports.remove(opposite)
                single_ports.append(powers[port] + powers[opposite] if opposite else powers[port])
            inwards = sum((np.maximum(p, 0.0) for p in single_ports), np.zeros_like(single_ports[0]))
            outwards = sum((np.maximum(-p, 0.0) for p in single_ports), np.zeros_like(single_ports[0]))
            parts[path] = np.asarray(np.maximum(inwards, outwards))
        nets = {path: np.sum([np.abs(powers[e]) for e in port_names], axis=0) / 2
                for path, port_names in ends.items() if port_names}
        unit = "W"
    else:
        parts, nets, unit = _variables(result, expanded, variable)
    time = result.time
    numbers_by_path: list[dict[str, float]] = []
    for series in (parts, nets):
        numbers_by_path.append({})
        for path, course in series.items():
            if moment is not None:
                value = np.interp(moment, time, course)
            elif over == PEAK:
                value = course[np.argmax(np.abs(course))]
            else:
                value = np.trapezoid(course, time) / (time[-1] - time[0])
            numbers_by_path[-1][path] = float(value)
    return _scaled(f"{variable}, {when}", unit, *numbers_by_path)


def _scaled(title: str, unit: str, parts: dict[str, float], nets: dict[str, float]) -> Paint:
    """The values in a readable unit, and the limits of the colour scale."""
    sizes = sorted(abs(v) for v in (*parts.values(), *nets.values()))
    display_unit = readable_unit(unit, sizes[-1])
    target = read_unit(display_unit)
    parts, nets = ({k: target.from_si(v) for k, v in numbers_by_path.items()} for numbers_by_path in (parts, nets))
    values = [*parts.values(), *nets.values()]
    low, high = min(values), max(values)
    middle = target.from_si(sizes[len(sizes) // 2])
    logarithmic = low >= 0 and high > SPREAD * abs(middle)
    if logarithmic:
        low = 10.0**-DECADES * high
    elif low < 0:  # zero is grey, whatever the sign of the others
        high = max(high, -low)
        low = -high
    elif title.startswith(POWER):
        low = 0.0
    if high - low <= 1e-12 * max(abs(high), 1.0):
        low, high = low - 0.5, high + 0.5
    return Paint(title, display_unit, parts, nets, low, high, logarithmic, unit)


# -- power -------------------------------------------------------------------------------------------------------------
def _halves(powers: list[Array]) -> Array:
    return np.asarray(sum((np.abs(p) for p in powers), np.zeros_like(powers[0])) / 2)


# -- variables ---------------------------------------------------------------------------------------------------------
def _variables(result: Result, expanded: Expanded, variable: str) -> tuple[dict[str, Array], dict[str, Array], str]:
    """A variable at nodes, in components and at their ports, and its base unit."""
    known = result.assembly.flat.names
    owner, _, last = variable.rpartition(".")
    at_nodes = {path: [f"{path}.{last}"] for path in expanded.junctions
                if f"{path}.{last}" in known and owner in ("", path)}
    ends = dict.fromkeys(e.name for junction in expanded.junctions.values() for e in junction.ends
                         if e.name.partition("[")[0] in expanded.ports or e.name in expanded.ports)
    in_parts: dict[str, list[str]] = {}
    for path in expanded.leaves:
        own_name = [n for n in (f"{path}.{last}",) if n in known and path not in expanded.junctions]
        ports = [f"{e}.{last}" for e in ends if e.rpartition(".")[0] == path and f"{e}.{last}" in known]
        if owner in ("", path) and (own_name or ports) and not (ports and _across(expanded, last) and not own_name):
            in_parts[path] = own_name or ports
    # a signal: the node of that name, or the nodes to which it is connected
    if not at_nodes and not in_parts and variable in known:
        at_nodes = {p: [p] for p, j in expanded.junctions.items() if variable in (p, *(e.name for e in j.ends))}
    names = list(dict.fromkeys(name for names_at_place in (*at_nodes.values(), *in_parts.values())
                               for name in names_at_place))
    if not names:
        raise UsageError([Problem("name-unknown", f"nothing in this diagram has a variable '{variable}'", None, suggest(
            variable, [POWER, *known]) or "Write `power`, a variable of nodes such as `p` or `v`, or one with its path.")])
    units: dict[str, str] = {}
    for name in names:
        units.setdefault(result.unit(name), name)
    if len(units) > 1:
        unit_list = listing(f"{name} in {unit_label(unit)}" for unit, name in units.items())
        raise UsageError([Problem("unit-kind", f"'{variable}' is not the same quantity everywhere: {unit_list}", None,
                                  "Write one with its path, or another variable.")])
    unit = next(iter(units))
    values = result.signals(names)
    # the largest of several time series at each time
    parts, nodes = ({place: max([values[name] for name in names_at_place], key=lambda c: float(np.max(np.abs(c))))
                     for place, names_at_place in places.items()}
                    for places in (in_parts, at_nodes))
    return parts, nodes, unit


def _across(expanded: Expanded, member: str) -> bool:
    """True if the variable is shared at nodes, so that nodes show it."""
    return any(member in domain.across or member in domain.positions for domain in expanded.model.library.domains.values())
