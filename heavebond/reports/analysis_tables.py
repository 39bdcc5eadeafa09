"""Results of `modes`, `sensitivity`, `energy`, `signal` and `optimal` as tables and lines, for terminal and notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from heavebond.core.errors import listing
from heavebond.core.presentation import count, number, readable
from heavebond.core.units import read_unit
from heavebond.energy_audit.audit import EnergyAudit, table
from heavebond.language.model import Model
from heavebond.linear.design import LoopDesign, ScheduleDesign
from heavebond.linear.held_variables import clock_lines, held_lines, sampled_lines
from heavebond.linear.margins import Crossings, Margin
from heavebond.linear.modes import Modes
from heavebond.linear.optimal_design import ObserverController, StateFeedback
from heavebond.linear.sampled import sampled_words
from heavebond.numerics.dae import Assembly, assemble
from heavebond.optimise.costs import read_cost
from heavebond.optimise.influence import Rankings
from heavebond.optimise.optimal import Optimal, cost_values
from heavebond.records.spectra import SignalAnalysis
from heavebond.reports.result_tables import Item, Line, ResultTable
from heavebond.reports.study_tables import limit_words

LEAST = 0.05  # smaller shares are not listed
MOST = 4
ROWS = 15  # parameters listed for each signal
INFLUENCE = ("parameter", "value", "influence", "1 % more moves it by", "at")


# -- modes -------------------------------------------------------------------------------------------------------------
def modes_items(result: Modes) -> list[Item]:
    """The modes with their frequency, damping and components, and the sentences on stability and held variables."""
    modes = result.modes
    first = [("free" if not mode.value else f"{mode.frequency:.4g} Hz" if mode.swings else "non-oscillatory",
              *((f"{mode.damping:.4g}", f"{-mode.value.real:.4g} 1/s") if mode.value else ("", "")))
             for mode in modes]
    states = modes[0].states if result.period is not None and modes else result.states
    title = f"{result.model} {result.at}, {count(len(states), 'state')}"
    if result.period is None:
        rows = [(*begin, named(share.energy or mode.participation), named(share.damping))
                for begin, mode, share in zip(first, modes, result.shares, strict=True)]
        items: list[Item] = [ResultTable(title, ("frequency", "damping", "decay", "energy in", "damping contribution"), rows,
                                         5)]
    else:
        rows = []
        for begin, mode in zip(first, modes, strict=True):
            z = mode.z or 0j
            rows.append((*begin, f"{z.real:.4g} ± {z.imag:.4g}j" if z.imag else f"{z.real:.4g}", named(mode.participation)))
        items = [ResultTable(f"{title}, {sampled_words(result.period)}", ("frequency", "damping", "decay", "z", "states"),
                             rows, 5)]
    items += map(Line, (*result.words, *sampled_lines(result.sampled),
                        *clock_lines(result.clocks if result.sampled else ())))
    items += (Line(note, highlight=True) for note in (*held_lines(result.held), *result.notes, result.filled) if note)
    if result.shares and result.shares[0].left_out:
        items.append(Line(f"not counted (described by mass and temperature): {', '.join(result.shares[0].left_out)}"))
    return items


def named(shares: dict[str, float]) -> str:
    """The largest shares; if each is small, the shares of the blocks of the diagram."""
    largest = _large(shares)
    if not largest and shares:
        blocks: dict[str, float] = {}
        for name, share in shares.items():
            blocks[name.partition(".")[0]] = blocks.get(name.partition(".")[0], 0.0) + share
        largest = _large(dict(sorted(blocks.items(), key=lambda item: -abs(item[1]))))
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in largest)


def _large(shares: dict[str, float]) -> list[tuple[str, float]]:
    return [(name, share) for name, share in shares.items() if abs(share) >= LEAST][:MOST]


# -- sensitivity -------------------------------------------------------------------------------------------------------
def sensitivity_items(rankings: Rankings, rows: int = ROWS) -> list[Item]:
    """The parameters with the largest influence on each signal."""
    items: list[Item] = []
    for ranking in rankings.rankings:
        size = f"rms {readable(ranking.size, ranking.unit, 3)} " + ("(it stands still)" if ranking.still
                                                                    else "about its mean")
        items.append(ResultTable(f"{ranking.signal}: {size}", INFLUENCE, [
            (i.parameter, readable(i.value, i.unit.text, 4), number(i.relative, 3),
             readable(i.peak / 100, ranking.unit, 3) if i.peak else "-", f"{number(i.time, 4)} s" if i.peak else "-")
            for i in ranking.influences[:rows]]))
    if rankings.left_out:
        items.append(Line(f"{len(rankings.left_out)} more parameters were not tried; add --most "
                          f"{rankings.tried + len(rankings.left_out)}: {', '.join(rankings.left_out)}"))
    return [*items, *([Line(f"Run {rankings.filled}", highlight=True)] if rankings.filled else [])]


# -- energy ------------------------------------------------------------------------------------------------------------
def energy_items(audit: EnergyAudit) -> list[Item]:
    """The energies of the components, and the notes on them."""
    energies = table(audit)
    rows = list(zip(*([str(cell) for cell in column.cells] for column in energies.columns), strict=True))
    energy_table = ResultTable(str(energies.title), [str(column.header) for column in energies.columns], rows)
    return [energy_table, *map(Line, filter(None, str(energies.caption or "").splitlines()))]


# -- signal ------------------------------------------------------------------------------------------------------------
def signal_items(analysis: SignalAnalysis) -> list[Item]:
    """Mean, spectrum, waves and load cycles of a signal."""
    unit, values = analysis.course.unit, analysis.as_dict()
    rows = [("mean", "mean", unit), ("deviation", "standard deviation", unit), ("least", "least", unit),
            ("most", "most", unit), ("significant", "spectrum: significant height, 4 sqrt(m0)", unit),
            ("peak_period", "spectrum: peak period", "s"), ("mean_period", "spectrum: mean period, m0/m1", "s"),
            ("crossing_period", "spectrum: crossing period, sqrt(m0/m2)", "s"), ("waves", "waves", ""),
            ("wave_period", "waves: mean period", "s"), ("highest_third", "waves: mean height of the highest third", unit),
            ("period_of_highest_third", "waves: mean period of these", "s"), ("highest_wave", "waves: the highest", unit),
            ("cycles", "rainflow: cycles", ""), ("largest_range", "rainflow: largest range", unit),
            ("equivalent_range", f"rainflow: equivalent range at 1 Hz, slope {analysis.slope:g}", unit)]
    statistics = [(words, number(float(str(values[key])), 4), of) for key, words, of in rows if values.get(key) is not None]
    title = f"{analysis.course.name}, {analysis.course.time[0]:g} to {analysis.course.time[-1]:g} s"
    return [ResultTable(title, ("", "value", "unit"), statistics),
            *([Line(analysis.course.note)] if analysis.course.note else [])]


# -- optimal inputs ------------------------------------------------------------------------------------------------------
Measures = Mapping[str, tuple[str, str]]  # formulas and units by name


def optimal_items(title: str, results: Mapping[str, tuple[Assembly, Optimal]], measures: Measures) -> list[Item]:
    """Cost and measured numbers of the diagram and of its optimal input, by case; the limits, and the verdict."""
    rows, lines = list[tuple[str, ...]](), list[Item]()
    for case, (diagram_assembly, result) in results.items():
        numbers = {"cost": (result.before, result.cost, result.cost_unit),
                   **({"duration": (float("nan"), result.duration, "s")} if result.task.duration is not None else {}),
                   **_measured(diagram_assembly, result, measures)}
        rows += [(case, name, _number(before, unit), _number(after, unit))
                 for name, (before, after, unit) in numbers.items()]
        subject = f"{case}: " if case else ""
        lines += [Line(subject + limit_words(text, value)) for text, value in result.limits.items()]
        how = f"{count(result.intervals, 'interval')}, {count(result.iterations, 'iteration')}"
        worst = max(result.differences.values(), default=0.0)
        lines.append(Line(f"{subject}verified by a run: its outputs differ from the collocation by {100 * worst:.2g} "
                          f"% of their ranges, root mean square ({how})") if result.verified else
                     Line(f"{subject}NOT VERIFIED: {'; '.join(result.doubts)} ({how})", warning=True))
    table = ResultTable(title, ("case", "", "diagram", "optimal"), rows, 2)
    if not any(row[0] for row in rows):
        table = ResultTable(title, ("", "diagram", "optimal"), [row[1:] for row in rows])
    return [table, *lines]


def _number(value: float, unit: str) -> str:
    return readable(value, unit, 4) if value == value else ""


def _measured(diagram_assembly: Assembly, result: Optimal, measures: Measures) -> dict[str, tuple[float, float, str]]:
    """Measured numbers of the diagram's own run and of the run with the optimal input, in their units."""
    begin, numbers = float(result.inputs.time[0]), {}
    for name, (text, unit) in measures.items():
        values = []
        for assembly, run in ((diagram_assembly, result.diagram_run), (result.run.assembly, result.run)):
            cost = read_cost(assembly, text)
            values.append(cost_values(assembly, run, [cost], [np.zeros(len(cost.functionals))], begin)[0])
        display_unit = unit or cost.unit
        before, after = (float(read_unit(display_unit).from_si(value)) for value in values)
        numbers[name] = (before, after, display_unit)
    return numbers


def optimal_figures(title: str, results: Mapping[str, tuple[Assembly, Optimal]], measures: Measures) -> dict[str, object]:
    """The results as a dictionary for JSON."""
    return {"name": title, "cases": {case: {
        "cost": result.cost, "collocated": result.collocated, "before": result.before, "unit": result.cost_unit,
        "duration": result.duration, "limits": dict(result.limits), "verified": result.verified,
        "doubts": list(result.doubts), "differences": dict(result.differences), "intervals": result.intervals,
        "iterations": result.iterations, "error": result.error, "solver": result.message,
        "measures": {name: {"diagram": before, "optimal": after, "unit": unit}
                     for name, (before, after, unit) in _measured(diagram_assembly, result, measures).items()}}
        for case, (diagram_assembly, result) in results.items()}}


# -- designs ---------------------------------------------------------------------------------------------------------------
def design_items(model: Model, result: LoopDesign) -> list[Item]:
    """The designed gains with the former ones, and the margins at each operating point."""
    assembly = assemble(model)
    units = {q.name: q.unit for q in assembly.flat.parameters}
    gains = [(name, *(model.written(name, each, units[name]) for each in (assembly.parameter_values[name], value)))
             for name, value in result.values.items()]
    band = f", bandwidth {number(result.bandwidth, 4)} Hz" if result.bandwidth == result.bandwidth else ""
    return [ResultTable(f"{model.name}: loop through {result.signal}", ("parameter", "before", "designed"), gains),
            Line(f"crossover {number(result.crossover, 4)} Hz, phase margin {number(result.phase_margin, 4)} deg{band}"),
            *_margin_items({"design": result.crossings, **result.points})]


def schedule_items(model: Model, result: ScheduleDesign, block: str, free: Sequence[str]) -> list[Item]:
    """The table of gains, and the margins at its operating points and between them."""
    units = {q.name: q.unit for q in assemble(model).flat.parameters}
    names = [f"{block}.x", *free]
    rows = [tuple(units[f"{name}[{k}]"].written(result.values[f"{name}[{k}]"]) for name in names)
            for k in range(1, len(result.inputs) + 1)]
    return [ResultTable(f"{model.name}: table of {block}, loop through {result.signal}", tuple(names), rows),
            *_margin_items(result.checks)]


def observer_items(title: str, result: ObserverController | StateFeedback) -> list[Item]:
    """The poles of a regulator and of its observer, and the margins of the loop through each output of the block."""
    poles = result.poles if isinstance(result, ObserverController) else (result.poles,)
    period = result.period if isinstance(result, ObserverController) else None
    rows = [tuple(f"{pole:.5g}" for pole in row) for row in zip(*poles, strict=True)]
    return [ResultTable(f"{title}, {count(len(result.states), 'state')}",
                        ("poles of the regulator", "poles of the observer")[:len(poles)], rows),
            Line("in z, sampled every " + f"{period:g} s" if period is not None else "in 1/s"),
            *(_margin_items(result.points) if result.points else [Line("no output of the block is in a loop")])]


def _margin_items(points: Mapping[str, Crossings]) -> list[Item]:
    """The verdict and the margins at operating points."""

    def margin(entry: Margin | None, unit: str, digits: int = 4) -> str:
        return "" if entry is None else f"{number(entry.value, digits)}{unit}"

    rows = [(name, crossings.verdict, margin(crossings.gain_up, ""), margin(crossings.gain_down, ""),
             margin(crossings.least_phase, " deg"),
             "" if crossings.least_phase is None else f"{number(crossings.least_phase.frequency, 4)} Hz",
             "" if crossings.least_delay is None else readable(crossings.least_delay.value, "s", 4))
            for name, crossings in points.items()]
    return [ResultTable("", ("operating point", "closed loop", "gain margin, up", "down", "phase margin", "at",
                             "delay margin"), rows, 2),
            *(Line(f"{name}: {at_point.verdict}: {listing(at_point.reasons)}") for name, at_point in points.items()
              if at_point.reasons)]
