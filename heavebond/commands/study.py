"""`heavebond study`: run a study file, case by case."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import Whole, json_option, scheduler_option
from heavebond.core.cancellation import Interrupted, last_heard
from heavebond.core.quoting import file_stem
from heavebond.core.writable import write_text

if TYPE_CHECKING:
    from heavebond.studies.campaign import StudyResult
    from heavebond.studies.study import Study


LISTED = 12  # rows of a sample that are shown
TOLD = 3  # cases that leave a range that are told one by one


@click.command(short_help="Run a study: many cases tuned, evaluated and compared with published numbers.")
@click.argument("file", metavar="STUDY")
@click.option("--output", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Where tables and pictures go [default: a folder of the study's name].")
@click.option("--processes", type=Whole(1), help="Number of cases that run in parallel [default: all processors].")
@click.option("--fresh", is_flag=True, help="Run all cases again, also those that are complete.")
@scheduler_option
@json_option
def study(file: str, output: Path | None, processes: int | None, fresh: bool, scheduler: str | None) -> dict[str, object]:
    """Run every case of STUDY, a YAML file or a bundled one (cmc_ahc/quality_index).

    Each completed case is kept in the folder: after Ctrl-C the same command continues.
    """
    from heavebond.studies.study import load_study

    asked = load_study(file)
    return work_out(asked, output or Path(asked.path.stem), processes, fresh, scheduler)


def work_out(asked: Study, folder: Path, processes: int | None, fresh: bool, scheduler: str | None) -> dict[str, object]:
    """Work a study out, tell it and write its files; the figures for JSON."""
    from heavebond.commands import terminal
    from heavebond.core.cluster import connected
    from heavebond.studies.campaign import run_study
    from heavebond.studies.tables import as_dict, write_files

    with connected(scheduler) as cluster, terminal.working("study") as progress:
        result = run_study(asked, folder=folder, processes=processes, executor=cluster, fresh=fresh, progress=progress)
    _tell(result)
    files = [*write_files(result, folder), *_diagram(result, folder), *_pictures(result, folder)]
    console = terminal.output()
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    if not result.complete:
        console.print(f"stopped with {len(result.outcomes)} of {result.jobs} done; the same command goes on", soft_wrap=True)
        raise Interrupted(last_heard(), {**as_dict(result), "files": list(map(str, files))})
    return {**as_dict(result), "files": list(map(str, files))}


def _tell(result: StudyResult) -> None:
    from heavebond.commands import terminal
    from heavebond.studies.tables import mode_rows, shown, stability_rows

    console = terminal.output()
    _tell_calibration(result)
    head, rows, words = shown(result)
    left_out = max(0, len(rows) - LISTED) if result.study.sample is not None else 0
    rows = rows[:len(rows) - left_out]
    if head and result.calibrated is None:
        console.print(result.study.name, style="bold", soft_wrap=True)
    if head:
        console.print(terminal.table("", head, rows, text=words))
    if left_out:
        console.print(f"and {left_out} more rows, in table.csv", soft_wrap=True)
    _tell_sample(result)
    modes = list(mode_rows(result)) if result.study.sample is None else []     # of a sample in study.json
    if modes:
        console.print(terminal.table("oscillatory modes", ("case", "frequency", "damping", "components"), modes, text=4))
    outside = [o for o in result.outcomes if o.outside]
    for outcome in outside[:TOLD]:
        terminal.warn(f"warning: {result.case_of(outcome).name or result.study.name}: {outcome.outside}")
    if len(outside) > TOLD:
        terminal.warn(f"warning: {len(outside) - TOLD} more cases leave a range (`outside` in study.json)")
    stability = list(stability_rows(result))
    if stability:
        console.print(terminal.table("stability of what was tuned", ("case", "procedure", ""), stability, text=3))
    for outcome in result.outcomes:
        case = result.case_of(outcome).name
        for text, value in outcome.limits.items():
            if not value <= 1e-4:
                console.print(f"{case}, {outcome.procedure}: limit {text} exceeded by {100 * value:.3g} %", soft_wrap=True)


def _tell_sample(result: StudyResult) -> None:
    """What the points of a sample say together."""
    from heavebond.commands import terminal
    from heavebond.studies.tables import index_rows, mean_rows, slope_rows, spread_rows

    console = terminal.output()
    titles, means, left = mean_rows(result)
    if means:
        console.print("\nover the sample: mean with its 95 % interval", style="bold", soft_wrap=True)
        console.print(terminal.table("", titles, means, text=left))
        console.print("deviations, quantiles and extremes are in study.json (`spreads`)", soft_wrap=True)
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
            console.print(f"\n{title}", style="bold", soft_wrap=True)
            told = [[row[k] for k in kept] for row in rows]
            console.print(terminal.table("", [head[k] for k in kept], told, text=words))


def _tell_calibration(result: StudyResult) -> None:
    from heavebond.commands import terminal
    from heavebond.studies.tables import calibration_rows, residual_rows

    found = result.calibrated
    if found is None:
        return
    console = terminal.output()
    console.print(result.study.name, style="bold", soft_wrap=True)
    console.print(terminal.table("", ("parameter", "before", "calibrated", "range", ""),
                                 list(calibration_rows(result)), text=1))
    console.print(terminal.table("", ("quantity", "case", "ours", "target", "off", "in widths"),
                                 list(residual_rows(result)), text=2))
    console.print(f"sum of squares {found.history[0]:.4g} before, {min(found.history):.4g} after {len(found.history)} steps "
                  f"and {found.simulations:.0f} simulations: {found.message}", soft_wrap=True)


def _diagram(result: StudyResult, folder: Path) -> list[Path]:
    """What was calibrated as a diagram."""
    from heavebond.studies.calibration import calibrated_diagram

    if result.calibrated is None:
        return []
    path = folder / "calibrated.yaml"
    write_text(path, calibrated_diagram(result.study, result.calibrated, path))
    return [path]


def _pictures(result: StudyResult, folder: Path) -> list[Path]:
    from heavebond.pictures.plot import save
    from heavebond.pictures.plot_study import plot_study

    if not result.outcomes:
        return []
    return [save(plot_study(result, picture), folder / f"{file_stem(picture.name)}{suffix}")
            for picture in result.study.pictures for suffix in (".svg", ".png")]
