"""Tables and lines of a study for the terminal and the studio, and the output files of a study."""

from __future__ import annotations

from pathlib import Path

from heavebond.core.quoting import file_stem
from heavebond.core.writable import write_text
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
    items = _calibration(result)
    head, rows, words = shown(result)
    left_out = max(0, len(rows) - LISTED) if result.study.sample is not None else 0
    if head:
        title = result.study.name if result.calibrated is None else ""
        items.append(ResultTable(title, tuple(head), [tuple(row) for row in rows[:len(rows) - left_out]], words))
    if left_out:
        items.append(Line(f"and {left_out} more rows, in table.csv"))
    items += _sample(result)
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


def _sample(result: StudyResult) -> list[Item]:
    """Statistics of a sample: means, distributions, Sobol indices and slopes."""
    items: list[Item] = []
    titles, means, left = mean_rows(result)
    if means:
        items += [ResultTable("over the sample: mean with its 95 % interval", tuple(titles), [tuple(m) for m in means],
                              left),
                  Line("deviations, quantiles and extremes are in study.json (`spreads`)")]
    for title, head, rows, words in (
            ("over the sample",
             ("number", "", "mean", "95 % of mean", "deviation", "least", "5 %", "50 %", "95 %", "most", "cases"),
             [] if means else spread_rows(result), 2),
            ("Sobol indices: the share of the variance that a parameter makes alone, and with the others",
             ("number", "", "parameter", "alone", "95 %", "with others", "95 %"), index_rows(result), 3),
            ("at the diagram's own values, exact: what 1 % more does, what the half width does, share of the variance",
             ("number", "", "parameter", "1 % more", "half width", "share"), slope_rows(result), 3)):
        if rows:
            kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
            words -= len([k for k in range(words) if k not in kept])
            items.append(ResultTable(title, tuple(head[k] for k in kept), [tuple(row[k] for k in kept) for row in rows],
                                     words))
    return items


def _calibration(result: StudyResult) -> list[Item]:
    found = result.calibrated
    if found is None:
        return []
    return [ResultTable(result.study.name, ("parameter", "before", "calibrated", "range", ""),
                        list(calibration_rows(result)), 1),
            ResultTable("", ("quantity", "case", "ours", "target", "off", "in widths"), list(residual_rows(result)), 2),
            Line(f"sum of squares {found.history[0]:.4g} before, {min(found.history):.4g} after {len(found.history)} steps "
                 f"and {found.simulations:.0f} simulations: {found.message}")]


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
