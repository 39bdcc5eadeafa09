"""`heavebond fit`: estimate parameters of a diagram from its records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Whole,
    check_new,
    check_picture,
    json_option,
    native_option,
    picture_option,
    scheduler_option,
)
from heavebond.core.cancellation import ENDED_EARLY, Interrupted, last_heard

if TYPE_CHECKING:
    from heavebond.estimation.experiment import Experiment


@click.command(short_help="Fit the free parameters of an experiment to its records.")
@click.argument("experiment")
@click.option("--starts", type=Whole(1), default=1, show_default=True,
              help="Number of starting points within the ranges.")
@click.option("--segments", type=Whole(1), default=1, show_default=True,
              help="Number of segments of each record for an initial multiple shooting.")
@click.option("--robust", is_flag=True, help="Reduce the weight of outliers (soft-L1 loss).")
@click.option("--profile", "profiled", metavar="PARAMETER", multiple=True,
              help="Interval of a parameter by profile likelihood. May be repeated.")
@click.option("--write", "written", metavar="DIAGRAM", type=click.Path(path_type=Path),
              help="Write a diagram that extends the model with the fitted values (.yaml, must be new).")
@click.option("--resume", is_flag=True, help="Continue the same fit from its completed starts, if it was ended early.")
@picture_option("Draw records, fitted model and residual")
@scheduler_option
@native_option
@json_option
def fit(experiment: str, starts: int, segments: int, robust: bool, profiled: tuple[str, ...], written: Path | None,
        resume: bool, output: Path | None, scheduler: str | None) -> dict[str, object]:
    """Estimate the parameters under `free:` of EXPERIMENT by least squares.

    Records with `use: fit` are fitted; the others are held out as validation data. Without other records the last third
    of each record is held out. With several starts NAME_starts.jsonl, in the current folder, stores the completed starts
    until the fit ends: --resume continues from them, also after a crash.
    """
    from heavebond.commands import terminal
    from heavebond.core.cluster import connected
    from heavebond.core.kept_lines import KeptLines
    from heavebond.estimation.experiment import load_experiment
    from heavebond.estimation.fitting import fit as fitted
    from heavebond.estimation.fitting import fitted_diagram, profile
    from heavebond.language.edits import write
    from heavebond.reports.result_tables import fit_items

    check_picture(output)
    if written is not None:
        check_new(written, (".yaml",))
    with connected(scheduler) as cluster, terminal.working("fitting") as progress:
        loaded = load_experiment(experiment)
        _check_free(loaded, profiled)
        kept_lines = KeptLines.begin(Path(f"{loaded.path.stem}_starts.jsonl"), resume) if starts > 1 else None
        if resume and (kept_lines is None or not kept_lines.known):
            terminal.warn("no completed start is stored: the fit begins anew")
        fit_result = fitted(loaded, starts=starts, segments=segments, robust=robust, executor=cluster, kept=kept_lines,
                            progress=progress, partial=True)
        early = fit_result.message == ENDED_EARLY
        profiles = {} if early else {name: profile(fit_result, name, progress=progress) for name in profiled}
    terminal.show(fit_items(fit_result))
    console = terminal.output()
    profiled_parameters = {name: replace(next(p for p in fit_result.parameters if p.name == name), interval=ends,
                                         at_bound="")
                           for name, ends in profiles.items()}
    for name, p in profiled_parameters.items():
        interval_text = p.known(fit_result.experiment.free[name].range.unit.written)
        console.print(f"{name}: {interval_text} by profile likelihood", soft_wrap=True)
    files = []
    if written is not None:
        write(written, fitted_diagram(fit_result, written))
        files.append(written)
    if output is not None:
        from heavebond.pictures.plot import plot_comparison, save

        files.append(save(plot_comparison(fit_result.after), output))
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    figures = {"experiment": fit_result.experiment.name, **fit_result.as_dict(),
               "profiles": {name: list(p.told) for name, p in profiled_parameters.items()}, "files": list(map(str, files))}
    if kept_lines is not None and not early:
        kept_lines.remove()
    if early:
        again = "; the same command with --resume continues" if kept_lines is not None and kept_lines.known else ""
        console.print(f"ended early: these are the best values so far{again}", soft_wrap=True)
        raise Interrupted(last_heard(), figures)
    return figures


def _check_free(experiment: Experiment, names: Sequence[str]) -> None:
    """Raise UsageError for a name that is not free, before the fit."""
    from heavebond.core.errors import Problem, UsageError, listing, suggest

    for name in names:
        if name not in experiment.free:
            raise UsageError([Problem("free-unknown", f"--profile {name}: this parameter is not free", None,
                                      suggest(name, experiment.free) or f"Free are {listing(experiment.free, 40)}.")])
