"""Tables and lines of a study for the terminal and the studio, and the output files of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from heavebond.core.quoting import file_stem
from heavebond.core.writable import write_text
from heavebond.linear.rest_stability import STABLE
from heavebond.linear.rest_stability import stability_sentences as stability_words
from heavebond.numerics.dae import Array, Assembly
from heavebond.optimise.robustness import Robustness
from heavebond.optimise.tuning import Tuned
from heavebond.pictures.plot import save
from heavebond.pictures.plot_study import plot_study
from heavebond.reports.result_tables import Item, Line, ResultTable
from heavebond.studies.calibration import calibrated_diagram
from heavebond.studies.campaign import StudyResult
from heavebond.studies.tables import (
    calibration_rows,
    index_rows,
    mean_rows,
    mode_rows,
    occurrence_rows,
    residual_rows,
    shown,
    slope_rows,
    spread_rows,
    stability_rows,
    write_files,
)

LISTED = 12  # maximum number of rows of a sample
TOLD = 3  # maximum number of warnings for cases that exceed a range
EXCEEDED = 1e-4  # share of a limit; a smaller excess is within the accuracy of the search


def study_items(result: StudyResult) -> list[Item]:
    """The results of a study: calibration, cases, samples, modes, stability, ranges and limits."""
    items: list[Item] = []
    if (calibration := result.calibrated) is not None:
        items = [ResultTable(result.study.name, ("parameter", "before", "calibrated", "range", ""),
                             list(calibration_rows(result)), 1),
                 ResultTable("", ("quantity", "case", "ours", "target", "off", "in widths"), list(residual_rows(result)), 2),
                 Line(f"sum of squares {calibration.history[0]:.4g} before, {min(calibration.history):.4g} after "
                      f"{len(calibration.history)} steps and {calibration.simulations:.0f} simulations: "
                      f"{calibration.message}")]
    head, rows, words = shown(result)
    left_out = max(0, len(rows) - LISTED) if result.study.sample is not None else 0
    if head:
        title = result.study.name if result.calibrated is None else ""
        items.append(ResultTable(title, tuple(head), [tuple(row) for row in rows[:len(rows) - left_out]], words))
    if left_out:
        items.append(Line(f"and {left_out} more rows, in table.csv"))
    # statistics of a sample: means, distributions, Sobol indices and slopes
    titles, means, text_columns = mean_rows(result)
    if means:
        items += [ResultTable("over the sample: mean with its 95 % interval", tuple(titles),
                              [tuple(m) for m in means], text_columns),
                  Line("deviations, quantiles and extremes are in study.json (`spreads`)")]
    for title, columns, entries, texts in (
            ("over the sample",
             ("number", "", "mean", "95 % of mean", "deviation", "least", "5 %", "50 %", "95 %", "most", "cases"),
             [] if means else spread_rows(result), 2),
            ("Sobol indices: the share of the variance that a parameter makes alone, and with the others",
             ("number", "", "parameter", "alone", "95 %", "with others", "95 %"), index_rows(result), 3),
            ("at the diagram's own values, exact: what 1 % more does, what the half width does, share of the variance",
             ("number", "", "parameter", "1 % more", "half width", "share"), slope_rows(result), 3)):
        if entries:
            filled = [k for k in range(len(columns)) if any(row[k] for row in entries)]
            texts -= len([k for k in range(texts) if k not in filled])
            items.append(ResultTable(title, tuple(columns[k] for k in filled),
                                     [tuple(row[k] for k in filled) for row in entries], texts))
    titles, weighted = occurrence_rows(result)
    if weighted:
        items.append(ResultTable("by the scatter diagram: share of the time, and means", tuple(titles),
                                 [tuple(row) for row in weighted], 1))
    modes = list(mode_rows(result)) if result.study.sample is None else []  # the modes of a sample are in study.json
    if modes:
        items.append(ResultTable("oscillatory modes", ("case", "frequency", "damping", "components"), modes, 4))
    items += map(Line, dict.fromkeys(text for o in result.outcomes for mode in o.modes for text in mode.get("held", ())))
    outside = [o for o in result.outcomes if o.outside]
    items += [Line(f"warning: {result.case_of(o).name or result.study.name}: {o.outside}", True) for o in outside[:TOLD]]
    if len(outside) > TOLD:
        items.append(Line(f"warning: {len(outside) - TOLD} more cases leave a range (`outside` in study.json)", True))
    if stability := list(stability_rows(result)):
        items.append(ResultTable("stability of what was tuned", ("case", "procedure", ""), stability, 3))
    return [*items, *(Line(f"{result.case_of(o).name}, {o.procedure}: limit {text} exceeded by {100 * value:.3g} %")
                      for o in result.outcomes for text, value in o.limits.items() if not value <= EXCEEDED)]


def write_study(result: StudyResult, folder: Path) -> list[Path]:
    """Write the tables, the calibrated diagram and the pictures of a study to a folder; return the paths."""
    files = list(write_files(result, folder))
    if result.calibrated is not None:
        path = folder / "calibrated.yaml"
        write_text(path, calibrated_diagram(result.study, result.calibrated, path))
        files.append(path)
    pictures = result.study.pictures if result.outcomes else ()
    return files + [save(plot_study(result, picture), folder / f"{file_stem(picture.name)}{suffix}")
                    for picture in pictures for suffix in (".svg", ".png")]


def tuning_items(name: str, assembly: Assembly | None, result: Tuned, robust: Robustness | None = None,
                 swept: tuple[list[Array], Array] | None = None) -> list[Item]:
    """The tuned values (with those before, of the assembly), their cost, the limits, the stability, the robustness, and the
    best cost of a sweep."""
    before = f"before {result.before:.5g}" if math.isfinite(result.before) else "before: beyond the stability boundary"
    values_before = {} if assembly is None else assembly.parameter_values
    tuned_rows = [(parameter, *([wanted.unit.written(values_before[parameter])] if values_before else []),
                   wanted.unit.written(result.values[parameter]),
                   f"{wanted.unit.written(wanted.low)} .. {wanted.unit.written(wanted.high)}")
                  for parameter, wanted in result.task.free.items()]
    items: list[Item] = [
        ResultTable(name, ("parameter", *(["before"] if values_before else []), "tuned", "range"), tuned_rows),
        Line(f"cost {result.cost:.5g} ({before}), {result.runs} runs that cost {result.simulations:.0f} simulations: "
             f"{result.message}")]
    items += [Line(limit_words(text, value)) for text, value in result.limits.items() if text != STABLE]
    if len(result.cost_of_cases) > 1:
        items.append(ResultTable("", ("case", "cost"), [(c, f"{cost:.5g}") for c, cost in result.cost_of_cases.items()]))
    stability = stability_words(result.stability, asked=result.task.stable is not False)
    end_words: list[str] = []
    for name, end in result.at_end.items():
        wanted = result.task.free[name]
        end_words.append(f"{name} ended at the {end} end of its range, {wanted.unit.written(result.values[name])}: what is "
                         "beyond was not looked at")
    # sentences on the distance to the stability boundary along each free parameter
    boundary_words: list[str] = []
    turns = "unstable" if result.stability.stable else "stable"
    for name, pair in (result.stability.boundary or {}).items():
        factors = " and ".join(f"at {factor:.3g}" for factor in pair if factor is not None)
        boundary_words.append(f"{name}: " + (f"{factors} of its value the machine turns {turns}" if factors else
                                             "no boundary of stability within a factor of 100"))
    items += [Line(line, "NOT STABLE" in line) for line in (*end_words, *stability, *boundary_words)]
    items += [Line(f"{note}.", True) for note in result.notes]
    if robust is not None and assembly is not None:
        units = {q.name: q.unit for q in assembly.flat.parameters}
        rows = []
        for change in robust.changes:
            unit = result.task.free[change.name].unit if change.name in result.task.free else units[change.name]
            share = f" ({100 * change.share:+.0f} %)" if math.isfinite(change.share) else ""
            risen = f"{change.cost:.5g}" if math.isfinite(change.cost) else "breaks down"
            times = f"{100 * (change.cost / result.cost - 1):+.3g} %" if math.isfinite(change.cost) and result.cost else ""
            limits = ", ".join(f"{text} exceeded" for text in change.exceeded) or ("kept" if change.limits else "")
            rows.append((f"{change.name} = {unit.written(change.value)}{share}", risen, times, limits))
        robust_words: list[str] = []
        if len(result.cost_of_cases) > 1:
            robust_words.append(f"the worst case is {robust.worst[0]}, cost {robust.worst[1]:.5g}")
        if robust.ellipse is not None:
            widths = ", ".join(f"{name} +-{result.task.free[name].unit.written(width)}"
                               for name, width in robust.ellipse.widths.items())
            robust_words.append(f"the cost rises by less than 1 % within {widths}")
        items += [Line(""), ResultTable("around the best", ("one at a time", "cost", "change", "limits"), rows),
                  *map(Line, robust_words)]
    if swept is not None:
        best = min(cost for cost in swept[1].ravel().tolist() if math.isfinite(cost))
        items.append(Line(f"best of the sweep of {swept[1].size} runs: {best:.5g}"))
    return items


def limit_words(text: str, value: float) -> str:
    """`limit peak(x) < 1 m: kept, 12 % to spare`, from the excess over its right side."""
    return f"limit {text}: " + (f"exceeded by {100 * value:.3g} %" if value > EXCEEDED else
                                f"kept, {100 * -value:.3g} % to spare" if value < -1e-3 else "just kept")


def tuning_figures(name: str, result: Tuned, robust: Robustness | None) -> dict[str, object]:
    """The results as a dictionary for JSON."""
    if robust is None:
        robustness: Mapping[str, object] | None = None
    else:
        robustness = {"changes": [{"parameter": c.name, "value": c.value, "share": c.share, "cost": c.cost,
                                   "limits": dict(c.limits)}
                                  for c in robust.changes],
                      "damping": robust.damping, "margins": {m.name: {"down": m.down, "up": m.up} for m in robust.margins},
                      "worst": {"case": robust.worst[0], "cost": robust.worst[1]},
                      "ellipse": robust.ellipse.widths if robust.ellipse else None}
    return {"study": name, "values": result.values, "cost": result.cost, "before": result.before,
            "stability": asdict(result.stability), "at_end": result.at_end,
            "notes": list(result.notes), "cases": result.cost_of_cases, "limits": result.limits, "runs": result.runs,
            "simulations": result.simulations, "message": result.message,
            "paths": [[{"values": s.values, "cost": s.cost} for s in path] for path in result.paths],
            "robustness": robustness}
