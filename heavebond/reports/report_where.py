"""Charts of the localisation: the misfit over time and state, and the estimated input at a place with the identified law."""

from __future__ import annotations

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import number, readable_unit, unit_label
from heavebond.core.units import read_unit
from heavebond.diagnosis.state import AddedEffect
from heavebond.equations.places import nodes_of
from heavebond.localise.error_states import State
from heavebond.localise.misfit import Localization, PlaceEstimate, best_of_each_group, noun, summary
from heavebond.numerics.dae import Array
from heavebond.numerics.result import Result
from heavebond.pictures.markup import Html, element, joined
from heavebond.reports.report_charts import BLUE, MOST_POINTS, ORANGE, Cloud, Line, over, steps, swatch

PANELS = 3
LAW, CURVE = "#000000", "#009e73"


def failing(localization: Localization, finding: AddedEffect | None) -> Html:
    """The section on the misfit of the model: over time, by state of motion and by place.

    The law of a finding is drawn over the estimated input at its place.
    """
    parts = [element("p", line) for line in summary(localization)]
    best: dict[str, State] = {}
    for state in localization.states:
        best.setdefault(state.channel, state)
    over_states = []
    for state in best.values():
        output_unit = read_unit(localization.experiment.outputs[state.channel].shown.unit)
        error, per_y = _display_unit(output_unit.text, state.y)
        across, per_x = _display_unit(state.unit, state.x)
        x, y = state.x * per_x, state.y * per_y
        zero = Line(np.array([x.min(), x.max()]), np.zeros(2), "#7d8894", 1.0)
        over_states.append(element("figure", over(
            [Cloud(x, y, BLUE, 5.0)], [Line(x, y, BLUE), zero], title=f"error of {state.channel}, R² {state.r2:.2f}",
            across=f"{state.variable} [{unit_label(across)}]", up=f"error [{unit_label(error)}]",
            label=f"Mean error of {state.channel} over {state.variable}")))
    over_time = []
    for record in dict.fromkeys(s.record for s in localization.stretches):
        stretches = [s for s in localization.stretches if s.record == record]
        edges = np.array([*(s.begin for s in stretches), stretches[-1].end])
        series = [(name, edges, np.array([s.chi2[name] for s in stretches])) for name in stretches[0].chi2]
        over_time.append(element("figure",
                                 steps(series, title=f"record {record}", across="time [s]", up="reduced χ²",
                                       label=f"Misfit over time in record {record}; 1 = noise level")))
    parts += [element("div", *figures, class_="panels") for figures in (over_time, over_states) if figures]
    parts += [element("p", line) for line in localization.words]
    # the best place, and the place of the finding if it is different
    places = list(best_of_each_group(localization))[:1]
    if finding is not None:
        at_finding = _of(localization, finding)
        if at_finding is not None and places and at_finding is not places[0]:
            # both places have the same effect on the records, so one chart is sufficient
            places = [at_finding] if at_finding.place.name in places[0].alike else [places[0], at_finding]
    parts += [_place(suspect, finding) for suspect in places]
    if localization.unseen:
        parts.append(element("p", f"Places whose input these records do not determine: {', '.join(localization.unseen)}.",
                             class_="quiet small"))
    return joined(parts)


# -- when and in what state --------------------------------------------------------------------------------------------
def _display_unit(unit: str, values: Array) -> tuple[str, float]:
    """A unit suited to the size of the values, and the factor from `unit` to it."""
    if not unit:
        return unit, 1.0
    display_unit = readable_unit(unit, float(np.max(np.abs(values), initial=0.0)))
    return display_unit, read_unit(unit).scale / read_unit(display_unit).scale


# -- at a place --------------------------------------------------------------------------------------------------------
def _of(localization: Localization, finding: AddedEffect) -> PlaceEstimate | None:
    """The estimated input at the place of a finding; None if the records do not determine it."""
    wanted = set(finding.candidate.where)
    return next((s for s in localization.suspects if {n.name for n in s.place.nodes} == wanted), None)


def law_picture(localization: Localization, finding: AddedEffect) -> str:
    """The SVG picture of the estimated input at the place of a finding over the variable that explains it best, with the law
    of the finding; empty if the input is not determined, or the law has no port at that place."""
    suspect = _of(localization, finding)
    if suspect is None or suspect.curve is None:
        return ""
    unit, per = _display_unit(suspect.place.unit.text, np.concatenate([i.value for i in suspect.implied.values()]))
    panel, drawn = _panel(suspect, suspect.curve.variable.formula, finding, f"{noun(suspect)} [{unit_label(unit)}]", per)
    standalone = '<svg xmlns="http://www.w3.org/2000/svg" font-family="Helvetica, Arial, sans-serif" '
    return panel.replace("<svg ", standalone, 1) if drawn else ""


def _place(suspect: PlaceEstimate, finding: AddedEffect | None) -> Html:
    unit, per = _display_unit(suspect.place.unit.text, np.concatenate([i.value for i in suspect.implied.values()]))
    up = f"{noun(suspect)} [{unit_label(unit)}]"
    # the explanatory variables of the estimated input, the best first
    variables: list[str] = []
    if suspect.curve is not None:
        best = suspect.curve.variable.formula
        variables = [best, *(n for n in suspect.curve.scores if n != best)][:PANELS]
    panels = [_panel(suspect, name, finding, up, per) for name in variables]
    drawn = any(law for _, law in panels)
    marks = [("dot", BLUE, "estimate while the variable rises"), ("dot", ORANGE, "while it falls"),
             ("dash", CURVE, "fitted curve")]
    if drawn and finding is not None:
        marks.append(("line", LAW, f"{finding.candidate.component} with the fitted parameters"))
    caption = element("figcaption", swatch(*marks))
    courses = []
    for record in suspect.implied:
        # the estimated input over time in one record, with a band of twice its standard deviation
        implied = suspect.implied[record]
        thin = slice(None, None, max(1, -(-len(implied.time) // MOST_POINTS)))
        t, value, wide = implied.time[thin], implied.value[thin] * per, 2 * implied.deviation[thin] * per
        lines = [Line(t, value + sign * wide, "#9cc7e2", 1.0) for sign in (-1, 1)]
        courses.append(element("figure", over([], [*lines, Line(t, value, BLUE, 1.2)], title=f"record {record}",
                                              across="time [s]", up=up, limits=value,
                                              label=f"Estimated {noun(suspect)} {suspect.place.words} over time, {record}",
                                              size=(518.0, 215.0))))
    return joined([element("h3", f"The {noun(suspect)} that the records ask for {suspect.place.words}"),
                   element("p", f"It would explain {number(100 * suspect.explained, 4)} % of the misfit. Below: over "
                           "variables of the place, and over time (pale: ± twice its standard deviation).", class_="small"),
                   element("div", *(element("figure", panel) for panel, _ in panels), class_="panels"), caption,
                   element("div", *courses, class_="panels")])


def _panel(suspect: PlaceEstimate, name: str, finding: AddedEffect | None, up: str, per: float) -> tuple[Html, bool]:
    """A scatter plot of the estimated input over one variable, and True if it contains the law of the finding."""
    curve = suspect.curve
    assert curve is not None
    x = np.concatenate([i.local[name] for i in suspect.implied.values()])
    y = np.concatenate([i.value for i in suspect.implied.values()]) * per
    up_ = np.concatenate([np.gradient(i.local[name]) > 0 for i in suspect.implied.values()])
    unit, across = _display_unit(curve.units.get(name, ""), x)
    clouds = [Cloud(x[mask] * across, y[mask], colour) for mask, colour in ((up_, BLUE), (~up_, ORANGE)) if mask.any()]
    lines = []
    is_variable = name == curve.variable.formula
    if is_variable and not curve.times:
        branches = [branch for branch in (curve.y, curve.y_down) if branch.size]
        lines = [Line(curve.x * across, branch * per, CURVE, 2.2, "6 3") for branch in branches]
    law = _law(finding, suspect, name) if finding is not None and is_variable else None
    if law is not None:
        lines.append(Line(law.x * across, law.y * per, LAW, 1.1, None, law.ends, 0.55))
    r2 = max(curve.scores.get(name, 0.0), curve.r2 if is_variable else -1.0)
    drawn = over(clouds, lines, title=f"R² {max(r2, 0.0):.2f}", up=up,
                 across=f"{name} [{unit_label(unit)}]" if unit else name, limits=y,
                 label=f"What acts {suspect.place.words} over {name}")
    return drawn, law is not None


def _law(finding: AddedEffect, suspect: PlaceEstimate, name: str) -> Line | None:
    """The through variable of the component of a finding at a place over a local variable, from the runs with it (SI).

    None if the component has no port at this place.
    """
    xs, ys, ends = [], [], []
    for record in finding.rung.comparison.records.values():
        law = _through(finding, suspect, record.result, name)
        if law is None:
            return None
        thin = slice(None, None, max(1, len(law[0]) // (2 * MOST_POINTS)))
        xs.append(law[0][thin])
        ys.append(law[1][thin])
        ends.append(sum(map(len, xs)) - 1)
    return Line(np.concatenate(xs), np.concatenate(ys), LAW, ends=tuple(ends))


def _through(finding: AddedEffect, suspect: PlaceEstimate, result: Result, name: str) -> tuple[Array, Array] | None:
    nodes = nodes_of(result.assembly.flat)
    for node, weight in suspect.place.weights.items():
        ports = nodes[node].ports if node in nodes else ()
        port = next((p for p in ports if p.rpartition(".")[0] == finding.candidate.name), None)
        if port is None:
            continue
        try:
            # the flow into the node is the negative of the flow into the component
            return result.si[name], -result.si[f"{port}.{nodes[node].through}"] / weight
        except HeavebondError:
            return None
    return None


# -- identified curves -----------------------------------------------------------------------------------------------------
def learnt(finding: AddedEffect) -> Html:
    """The identified curve of a finding without a named law, over the range of its runs; empty if there is none.

    The curve of a component is its last variable over its first variable. The curve of a signal block is output minus input.
    """
    runs = [r.result for r in finding.rung.comparison.records.values()]
    leaf = runs[0].assembly.flat.expanded.leaves.get(finding.candidate.name)
    if leaf is None or len(leaf.component.variables) < 2:
        return Html("")
    variables, signals = list(leaf.component.variables), leaf.component.signals
    out = next((s.name for s in signals.values() if s.direction == "out"), None)
    into = next((s.name for s in signals.values() if s.direction == "in"), None)
    path = finding.candidate.name
    names = f"{path}.{variables[0]}", f"{path}.{out} - {path}.{into}" if out and into else f"{path}.{variables[-1]}"
    x, y = (np.concatenate([run.si[name] for run in runs]) for name in names)
    order = np.argsort(x)
    drawn_points = order[np.unique(np.linspace(0, len(order) - 1, 400).astype(int))]
    units = [runs[0].si.unit(name) for name in names]
    (across, per_x), (up, per_y) = _display_unit(units[0], x), _display_unit(units[1], y)
    axes = [name.replace(f"{finding.candidate.name}.", "") for name in names]  # the heading names the component
    drawn = over([], [Line(x[drawn_points] * per_x, y[drawn_points] * per_y, LAW)], title="identified curve",
                 size=(518.0, 300.0), across=f"{axes[0]} [{unit_label(across)}]", up=f"{axes[1]} [{unit_label(up)}]",
                 label=f"The identified curve of {names[1]} over {names[0]}")
    return element("figure", drawn, element("figcaption", "The identified curve, as far as the records went: "
                                            f"{finding.candidate.description} {finding.candidate.place}."))
