"""`heavebond sweep`: a parameter sweep or sample from command line options."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import Whole, json_option, native_option, scheduler_option, set_option, settings_of
from heavebond.commands.study import work_out
from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import write_text


@click.command(short_help="Run a diagram many times: grids, samples, worst case, sensitivity indices.")
@click.argument("model")
@click.option("--over", "overs", metavar="PATH=VALUES", multiple=True, required=True,
              help="Parameter and values: 'controller.K_p=1 .. 4 1/m; 9' (nine steps), 'wave.T=8 s, 10 s' (a list), or a "
                   "range that is sampled: '20 .. 60 kN/m' or '42 kN/m +- 20 %'. May be repeated.")
@click.option("--measure", "measures", metavar="FORMULA", multiple=True, required=True,
              help="A number of each run, e.g. 'peak(WOB - 30 kN) in kN' or 'rms(crown)'. May be repeated.")
@click.option("--sample", metavar="KIND", default="",
              help="How ranges are sampled: sobol:64, latin_hypercube:50, random:100, sobol_indices:64 (share of each range "
                   "in the variance), one_at_a_time (both ends of each), local (exact slopes).")
@click.option("--worst", type=click.Choice(["highest", "lowest"]),
              help="Search the worst case within the ranges by exact gradients instead.")
@click.option("--seed", type=Whole(0), default=1, show_default=True, help="Seed of the random numbers.")
@click.option("--from", "begin", metavar="TIME", default="", help="Start of the evaluated time, e.g. --from '72 s'.")
@click.option("--until", "end", metavar="TIME", default="", help="End time of each simulation.")
@click.option("--plot", "plotted", metavar="SIGNAL", multiple=True, help="Draw a signal of all cases. May be repeated.")
@click.option("-o", "--output", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False),
              help="Folder for study, tables and pictures [default: MODEL_sweep].")
@click.option("--processes", type=Whole(1), help="Number of cases that run in parallel [default: all processors].")
@click.option("--fresh", is_flag=True, help="Run all cases again, also those that are complete.")
@scheduler_option
@set_option
@native_option
@json_option
def sweep(model: str, overs: tuple[str, ...], measures: tuple[str, ...], sample: str, worst: str | None, seed: int,
          begin: str, end: str, plotted: tuple[str, ...], output: Path | None, processes: int | None, fresh: bool,
          scheduler: str | None, settings: tuple[str, ...]) -> dict[str, object]:
    """Run the diagram MODEL with every combination of values, or at points sampled within ranges.

    The sweep is written as a study into the folder: `heavebond study FOLDER/study.yaml` runs it again or continues it.
    Each completed case is stored: after Ctrl-C the same command continues.
    """
    from heavebond.language.edits import Change, extended_from
    from heavebond.language.model import find
    from heavebond.studies.study import load_study
    from heavebond.studies.sweep import Sweep, read_measure, read_over, study_text

    path = find(model)
    folder = output or Path(f"{path.stem}_sweep")
    values = settings_of("--set", settings)
    diagram = folder / f"{path.stem}_set.yaml" if values else path
    requested = Sweep(diagram, tuple(map(read_over, overs)), tuple(map(read_measure, measures)), sample, seed, (begin, end),
                      worst or "", plotted, path.stem)
    text = study_text(requested, folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if values:
            words = f"{path.stem} with other values."
            changed = Change(settings=values).diagram(path.stem, words, extended_from(diagram, path))
            write_text(diagram, changed)
        write_text(folder / "study.yaml", text)
    except OSError as error:
        raise UsageError([Problem("file-unwritable", f"'{folder}' cannot be written: {error.strerror or error}")]) from None
    return work_out(load_study(folder / "study.yaml"), folder, processes, fresh, scheduler)
