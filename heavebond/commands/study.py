"""`heavebond study`: a study file worked out, case by case."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import json_option

if TYPE_CHECKING:
    from heavebond.campaign import StudyResult


@click.command(short_help="Work out a study: cases tuned, measured and laid beside published numbers.")
@click.argument("file", metavar="STUDY")
@click.option("--output", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Where tables and pictures go [default: a folder of the study's name].")
@click.option("--processes", type=click.IntRange(1), help="Cases worked side by side [default: all processors].")
@click.option("--fresh", is_flag=True, help="Work all cases out anew, also those done already.")
@json_option
def study(file: str, output: Path | None, processes: int | None, fresh: bool) -> dict[str, object]:
    """Work out every case of STUDY, a YAML file or a bundled one (cmc_ahc/quality_index).

    Each case is kept in the folder when it is done: the same command goes on where it was stopped by Ctrl-C.
    """
    from heavebond import terminal
    from heavebond.campaign import run_study
    from heavebond.study import load_study
    from heavebond.study_table import as_dict, write_files

    asked = load_study(file)
    folder = output or Path(asked.path.stem)
    with terminal.working("study") as progress:
        result = run_study(asked, folder=folder, processes=processes, fresh=fresh, progress=progress)
    _tell(result)
    files = [*write_files(result, folder), *_diagram(result, folder), *_pictures(result, folder)]
    console = terminal.output()
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    if not result.complete:
        console.print(f"stopped with {len(result.outcomes)} of {result.jobs} done; the same command goes on", soft_wrap=True)
        raise KeyboardInterrupt
    return {**as_dict(result), "files": list(map(str, files))}


def _tell(result: StudyResult) -> None:
    from heavebond import terminal
    from heavebond.study_table import mode_rows, shown

    console = terminal.output()
    _tell_calibration(result)
    head, rows, words = shown(result)
    if head and result.calibrated is None:
        console.print(result.study.name, style="bold", soft_wrap=True)
    if head:
        console.print(terminal.table("", head, rows, text=words))
    modes = list(mode_rows(result))
    if modes:
        console.print(terminal.table("modes that swing", ("case", "frequency", "damping", "components"), modes, text=4))
    for outcome in result.outcomes:
        case = result.case_of(outcome).name
        for text, value in outcome.limits.items():
            if not value <= 1e-4:
                console.print(f"{case}, {outcome.procedure}: limit {text} exceeded by {100 * value:.3g} %", soft_wrap=True)


def _tell_calibration(result: StudyResult) -> None:
    from heavebond import terminal
    from heavebond.study_table import calibration_rows, residual_rows

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
    from heavebond.writing import calibrated_diagram

    if result.calibrated is None:
        return []
    path = folder / "calibrated.yaml"
    path.write_text(calibrated_diagram(result.study, result.calibrated, path), encoding="utf-8")
    return [path]


def _pictures(result: StudyResult, folder: Path) -> list[Path]:
    from heavebond.plot import save
    from heavebond.plot_study import plot_study

    if not result.outcomes:
        return []
    return [save(plot_study(result, picture), folder / f"{picture.name}{suffix}")
            for picture in result.study.pictures for suffix in (".svg", ".png")]
