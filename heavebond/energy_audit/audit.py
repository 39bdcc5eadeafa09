"""Energy audit: simulate a model and integrate the power of every component together with the states.

Over a run, each component satisfies

    energy in over its ports + supplied by a source + set by events
        = change of the stored energy + dissipated + unbalanced

The formula of the stored energy is evaluated at the start, at the end, and before and after every event. The other terms
are integrals. An integration error therefore appears as missing energy, and a component with a wrong law is identified by
its name. At the nodes no power is lost (Tellegen's theorem): the powers of all ports sum to zero at every instant.

The activity of a component is the integral of the absolute value of its net power, summed over all its ports: an element
with low activity has little influence. L. S. Louca, J. L. Stein, G. M. Hulbert, J. Sprague,
Proper model generation: an energy-based methodology, Proc. ICBGM'97, 1997; L. S. Louca, J. L. Stein, Energy-based model
reduction of linear systems, Proc. ICBGM'99, 1999.

B. D. H. Tellegen, A general network theorem, with applications, Philips Res. Rep. 7 (1952) 259-269.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from heavebond.core import facade
from heavebond.core.errors import Problem, SimulationError, UsageError, listing, suggest
from heavebond.core.presentation import brief, count, number, readable
from heavebond.core.reporting import cancellable
from heavebond.core.units import read_unit
from heavebond.equations.flatten import Energetics
from heavebond.language.model import ModelOrFile
from heavebond.language.symbols import split, stack
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import Result
from heavebond.numerics.run_verdict import report_verdict, verdict
from heavebond.numerics.simulation import run_by_auto, with_equations_at_zero
from heavebond.numerics.simulator import Simulator, Tolerances

if TYPE_CHECKING:
    from rich.table import Table

# The integrator controls the error of states and integrals to 1e-8 per step; the errors of thousands of steps add up.
TOLERANCE = 1e-6
ROUNDING = 1e-9  # share of the largest energy; a table shows no smaller value
IN_KILOJOULES = 1e4  # J; tables of runs with a larger energy are in kJ
SHOWN = 6  # decimal places of a table, relative to the largest energy
LITTLE = 1e-4  # a smaller share of activity is shown as `< 0.01 %`
BLOCK = "block"
QUADRATURES = 3  # energy in, dissipated, unbalanced


@dataclass(frozen=True)
class EnergyLine:
    """The energies of one component over a run, in J.

    `supplied` is the energy from a source or a controlled law, `events` the stored energy that is added when events set
    states, `imbalance` the missing energy, and `why` the reason of the unbalanced power. `kind` is the entry `power:` of the
    component, or `block`. `start` and `end` are the stored energies at both ends of the run. `delivered` is the integral of
    the outgoing power, and `activity` the integral of the absolute power, both by the trapezoidal rule over the output
    points.
    """

    component: str
    energy_in: float
    stored: float
    dissipated: float
    unbalanced: float
    supplied: float
    events: float
    imbalance: float
    kind: str = ""
    why: str = ""
    start: float = 0.0
    delivered: float = 0.0
    activity: float = 0.0

    @property
    def end(self) -> float:
        """The stored energy at the end of the run, in J."""
        return self.start + self.stored


@dataclass(frozen=True)
class EnergyAudit(facade.Displayed):
    """The energies of a run: a line for each component with power ports or storage, and the error of power at the nodes.

    `largest` is the maximum over time and components of the energy taken in, dissipated, unbalanced or stored, in J. All
    errors are relative to it, like the errors of the states. `nodes` is the maximum over time of the sum of all port powers,
    divided by the maximum of the sum of their absolute values, or by `largest` over the duration of the run if that is
    larger: in a machine at rest the powers contain only rounding errors. `ports` is the power in W into a component or a
    block through each port, (N,) at the times of the result.
    """

    lines: tuple[EnergyLine, ...]
    largest: float
    nodes: float
    result: Result
    ports: Mapping[str, Array] = field(default_factory=dict)

    @property
    def ranking(self) -> list[tuple[EnergyLine, float]]:
        """The components with their share of the total activity, the most active first."""
        total = sum(line.activity for line in self.lines)
        order = sorted(self.lines, key=lambda line: -line.activity)
        return [(line, line.activity / total if total else 0.0) for line in order]

    def as_dict(self) -> dict[str, object]:
        """The audit as a dictionary for JSON, in J."""
        shares = {line.component: share for line, share in self.ranking}
        return {"until": float(self.result.time[-1]), "supplied": self.supplied, "taken": self.taken, "stored": self.stored,
                "dissipated": self.dissipated, "unbalanced": self.unbalanced, "events": self.events,
                "largest": self.largest, "missing": self.imbalance, "missing_at_nodes": self.nodes,
                "closes": self.closes(),
                "components": [{**asdict(line), "end": line.end, "activity_share": shares[line.component]}
                               for line in self.lines]}

    @property
    def supplied(self) -> float:
        """The energy supplied by sources, in J."""
        return sum(line.supplied for line in self.lines if line.supplied > 0)

    def __repr__(self) -> str:
        return brief(self, self.result.assembly.model.name, f"largest energy {readable(self.largest, 'J', 4)}, "
                     f"{self.imbalance:.1e} of it missing", f"{count(len(self.lines), 'component')}")

    @property
    def taken(self) -> float:
        """The energy that sources absorb, in J (negative)."""
        return sum(line.supplied for line in self.lines if line.supplied < 0)

    @property
    def stored(self) -> float:
        """The change of the stored energy over the run, in J."""
        return sum(line.stored for line in self.lines)

    @property
    def dissipated(self) -> float:
        """The dissipated energy, in J."""
        return sum(line.dissipated for line in self.lines)

    @property
    def events(self) -> float:
        """The stored energy added at events, in J (negative for an impact)."""
        return sum(line.events for line in self.lines)

    @property
    def unbalanced(self) -> float:
        """The unbalanced energy of laws that do not conserve energy exactly, in J."""
        return sum(line.unbalanced for line in self.lines)

    @property
    def imbalance(self) -> float:
        """The largest missing energy, of one component or of the whole model, relative to `largest`."""
        if not self.largest:
            return 0.0
        whole = self.supplied + self.taken + self.events - self.stored - self.dissipated - self.unbalanced
        return max(abs(whole), *(abs(line.imbalance) for line in self.lines)) / self.largest

    def closes(self, tolerance: float = TOLERANCE) -> bool:
        """True if the relative errors of the energy and of the power at the nodes are at most `tolerance`."""
        return self.imbalance <= tolerance and self.nodes <= tolerance

    def raise_if_open(self, tolerance: float = TOLERANCE) -> EnergyAudit:
        """Return the audit; raise SimulationError with the components that lose energy if the audit does not close."""
        if self.closes(tolerance):
            return self
        losing = sorted((line for line in self.lines if abs(line.imbalance) > tolerance * self.largest),
                        key=lambda line: -abs(line.imbalance))
        notes = [f"{line.component}: {line.imbalance:+.4g} J" for line in losing[:8]]
        if self.nodes > tolerance:
            notes.append(f"at the nodes {self.nodes:.2g} of the power")
        raise SimulationError([Problem(
            "energy-open", f"the energy of the run does not close: {max(self.imbalance, self.nodes):.2g} of "
            f"{self.largest:.4g} J is missing", None,
            "Run with a smaller rtol; if the gap stays, the law of a component above does not conserve energy.",
            tuple(notes))])


@cancellable
def energy(model: ModelOrFile | Assembly, until: Time | None = None, *, every: Time | None = None,
          parameters: Mapping[str, float | str] | None = None, rtol: float = 1e-9, atol: float = 1e-11) -> EnergyAudit:
    """Simulate a diagram and compute the energy that each component stores, dissipates and supplies, in J.

    The balance is the integral of the power (W) over all ports of a component. The arguments `model`, `until`, `every`,
    `parameters`, `rtol` and `atol` are the same as in `simulate`. Raises the errors of `simulate`, and SimulationError if
    the verdict of the run fails. The default tolerances are a tenth of the usual ones, because the errors of all steps add
    up in an energy.
    """
    assembly, parameters = with_equations_at_zero(assemble(model), parameters)
    tolerances = Tolerances(rtol, atol)
    before = run_by_auto(Simulator(assembly, until, every=every, tolerances=tolerances, solver="auto"), parameters)
    worthless = [f for f in before.verdict.findings if f.failed and f.kind != "energy"]  # the audit itself checks the energy
    verdict(worthless).raise_if_failed()
    if before.assembly.flat is not assembly.flat:  # with filled nodes; this assembly already contains the parameters
        assembly, parameters = before.assembly, None
    integrated = _integrated(before, assembly, parameters, tolerances)
    if integrated.result.assembly.flat is not assembly.flat:  # with the integrals the model needed filled nodes
        before, assembly = integrated.result, integrated.result.assembly
        integrated = _integrated(before, assembly, None, tolerances)
    parts, integrals, result = integrated.parts, integrated.integrals, integrated.result
    if "fills" in before.statistics:
        result = replace(result, statistics={**result.statistics, "fills": before.statistics["fills"]})
    energies = result.evaluate(integrated.energy)
    stored, jumps = energies - energies[:, :1], _jumps(result, integrated.energy)
    duration, ports, through = result.time[-1] - result.time[0], integrated.rates[::QUADRATURES], port_powers(result)
    report_verdict(assembly.model.name, before.verdict)
    largest = max(float(np.abs(values).max(initial=0.0)) for values in (integrals, stored, energies))
    total = max(float(np.sum([np.abs(through[port]) for port in assembly.flat.bonds], axis=0).max(initial=0.0)),
                largest / duration if duration else 0.0)
    lines = []
    for k, part in enumerate(parts):
        energy_in, dissipated, unbalanced = integrals[QUADRATURES * k:QUADRATURES * (k + 1), -1].tolist()
        stored_at_end, events = float(stored[k, -1]), float(jumps[k])
        remainder = energy_in + events - stored_at_end - dissipated - unbalanced
        exempt = bool(part.kind)  # a source: it supplies what is missing
        lines.append(EnergyLine(
            part.owner, energy_in, stored_at_end, dissipated, unbalanced, -remainder if exempt else 0.0, events,
            0.0 if exempt else remainder, part.kind, part.why, start=float(energies[k, 0]),
            delivered=float(np.trapezoid(np.maximum(-ports[k], 0.0), result.time)),
            activity=float(np.trapezoid(np.abs(ports[k]), result.time))))
    return EnergyAudit(tuple(lines), largest, float(np.abs(ports.sum(axis=0)).max(initial=0.0) / total) if total else 0.0,
                       result, through)


@dataclass(frozen=True)
class _Integrated:
    """The result of a run with integrated powers.

    `parts` are the n components of the balance, `energy` their stored energies (n, 1). `integrals` are the integrals of the
    power, the dissipated power and the unbalanced power of each component (3 n, N) in J, `rates` the integrands in W. The
    integrals are zero if the run needed filled nodes.
    """

    parts: list[Energetics]
    energy: ca.SX
    rates: Array
    integrals: Array
    result: Result


def _integrated(before: Result, assembly: Assembly, parameters: Mapping[str, float | str] | None, tolerances: Tolerances
                ) -> _Integrated:
    """Repeat the run `before` with the integrals of the powers under error control."""
    leaves = assembly.flat.expanded.leaves
    parts = [e for e in assembly.flat.energetics if leaves[e.owner].component.ports or leaves[e.owner].component.stores]
    raw, energy = stack([stack([e.power, e.dissipated, e.unbalanced]) for e in parts]), stack([e.energy for e in parts])
    rates, held, powers = before.evaluate(raw), before.evaluate(energy), assembly.express(raw)
    # scale the integrals to a common size, because the error control has one absolute tolerance for all of them; exclude
    # integrands that are always zero, because they would only dilute the error norm
    duration = before.time[-1] - before.time[0]
    size = max(float(np.abs(held).max(initial=0.0)), float(np.abs(rates).max(initial=0.0) * duration)) or 1.0
    chosen = [k for k, power in enumerate(split(powers)) if not power.is_zero()]
    beside = Simulator(assembly, times=before.time, tolerances=tolerances,
                       quadratures=powers[chosen] / size if chosen else None, solver="auto")
    result = run_by_auto(beside, parameters)
    integrals = np.zeros(rates.shape)
    if chosen and result.assembly.flat is assembly.flat:
        integrals[chosen] = size * result.quadratures
    return _Integrated(parts, energy, rates, integrals, result)


def port_powers(result: Result) -> dict[str, Array]:
    """The power in W into a component or a block through each port during a run, (N,)."""
    flat = result.assembly.flat
    bonds = {**flat.bonds, **flat.block_bonds}
    return dict(zip(bonds, result.evaluate(stack([b.power(flat.levels[0]) for b in bonds.values()])), strict=True))


def with_blocks(audit: EnergyAudit, blocks: Iterable[str]) -> EnergyAudit:
    """Replace the components of each block in `blocks` by one line with the sums of their energies.

    The activity of a block is the integral of the absolute power through its ports. Raises UsageError for an unknown block.
    """
    known = audit.result.assembly.flat.expanded.blocks
    closed = list(dict.fromkeys(blocks))
    for name in closed:
        if name not in known:
            hint = suggest(name, known) or (f"Blocks: {listing(known)}." if known else "This diagram has no blocks.")
            raise UsageError([Problem("block-unknown", f"there is no block '{name}' to close", None, hint)])
    groups: dict[str, list[EnergyLine]] = {}
    for line in audit.lines:
        around = [name for name in closed if line.component.startswith(f"{name}.")]
        groups.setdefault(min(around, key=len, default=line.component), []).append(line)
    return replace(audit, lines=tuple(_block_line(name, block_lines, audit) if name in closed else block_lines[0]
                                      for name, block_lines in groups.items()))


def _block_line(block: str, block_lines: list[EnergyLine], audit: EnergyAudit) -> EnergyLine:
    ports = [audit.ports[port] for port, b in audit.result.assembly.flat.block_bonds.items() if b.owner == block]
    power, time = np.sum([np.zeros_like(audit.result.time), *ports], axis=0), audit.result.time

    def total(energy: str) -> float:
        return float(sum(getattr(line, energy) for line in block_lines))

    why = "; ".join(dict.fromkeys(line.why for line in block_lines if line.why))
    return EnergyLine(block, total("energy_in"), total("stored"), total("dissipated"), total("unbalanced"),
                      total("supplied"), total("events"), total("imbalance"), BLOCK, why, total("start"),
                      float(np.trapezoid(np.maximum(-power, 0.0), time)), float(np.trapezoid(np.abs(power), time)))


def _jumps(result: Result, energy: ca.SX) -> Array:
    """The sum of the jumps of each stored energy (m,) at all events after the start of a run."""
    total = np.zeros(energy.numel())
    for instant in result.instants:
        if instant.time > result.time[0]:
            function = ca.Function("energy", list(instant.assembly.arguments), [instant.assembly.express(energy)])
            before, after = (np.array(function(*point.values())).ravel() for point in (instant.before, instant.after))
            total += after - before
    return total


def table(audit: EnergyAudit) -> Table:
    """The audit as a table in J or kJ: sources first, then the other components by decreasing activity.

    Notes below the table list the components without energy, the missing energy, and the reasons of unbalanced power.
    """
    from rich import box
    from rich.table import Table

    sources_first = sorted(audit.ranking, key=lambda item: item[0].kind in ("", BLOCK))
    busy = [(line, share) for line, share in sources_first if any(abs(value) > ROUNDING * audit.largest for value in (
        line.supplied, line.energy_in, line.events, line.start, line.end, line.dissipated, line.delivered, line.unbalanced,
        line.imbalance))]
    why = {line.component: line.why for line, _ in busy if line.why}
    unit = "J" if audit.largest < IN_KILOJOULES else "kJ"
    energies = Table("", title=f"energy over {audit.result.time[-1] - audit.result.time[0]:.6g} s in {unit}",
                     title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False,
                     caption_justify="left", caption_style="", caption="\n".join(_notes(audit, busy, why)))
    energies.columns[0].header, energies.columns[0].overflow = "component", "fold"
    events = ("at events",) if audit.result.assembly.flat.events else ()
    losing = () if audit.closes() else ("missing",)
    for name in ("supplied", "in", *events, "start", "end", "dissipated", "delivered", *(("unbalanced",) if why else ()),
                 *losing, "activity"):
        energies.add_column(name, justify="right", no_wrap=True)

    def row(name: str, *values: float, share: str = "") -> None:
        supplied, energy_in, at_events, start, end, dissipated, delivered, unbalanced, missing = (
            _rounded(value, audit.largest, unit) for value in values)
        energies.add_row(name, supplied, energy_in, *((at_events,) if events else ()), start, end, dissipated, delivered,
                         *((unbalanced,) if why else ()), *((missing,) if losing else ()), share)

    for line, share in busy:
        share_text = "" if share < ROUNDING else f"< {100 * LITTLE:g} %" if share < LITTLE else f"{number(100 * share, 3)} %"
        row(f"{line.component} *" if line.why else line.component, line.supplied, line.energy_in, line.events, line.start,
            line.end, line.dissipated, line.delivered, line.unbalanced, line.imbalance, share=share_text)
    energies.add_section()
    row("all", audit.supplied + audit.taken, sum(line.energy_in for line in audit.lines), audit.events,
        sum(line.start for line in audit.lines), sum(line.end for line in audit.lines), audit.dissipated, 0.0,
        audit.unbalanced, sum(line.imbalance for line in audit.lines))
    return energies


def _rounded(value: float, largest: float, unit: str) -> str:
    """A value with at most four digits; digits that are negligible relative to the largest energy are omitted."""
    if abs(value) <= ROUNDING * largest:
        return ""
    size = read_unit(unit).scale
    digits = SHOWN - math.ceil(math.log10(max(largest, abs(value))) - math.log10(size))
    return number(round(value / size, digits), 4)


def _notes(audit: EnergyAudit, busy: Sequence[tuple[EnergyLine, float]], why: Mapping[str, str]) -> list[str]:
    """The notes below the table."""
    listed = {line.component for line, _ in busy}
    idle = [line.component for line in audit.lines if line.component not in listed]
    return [*([f"nothing kept, lost or given: {', '.join(idle)}"] if idle else []),
            f"missing: {audit.imbalance:.1e} of {readable(audit.largest, 'J', 4)}; at the nodes {audit.nodes:.1e}",
            *(f"* {reason}: {', '.join(name for name, line_reason in why.items() if line_reason == reason)}"
              for reason in dict.fromkeys(why.values()))]
