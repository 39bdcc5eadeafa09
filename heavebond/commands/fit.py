"""`heavebond fit`: estimate parameters of a diagram from its records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import Whole, check_new, check_picture, json_option, picture_option
from heavebond.core.cancellation import ENDED_EARLY, Interrupted, last_heard

if TYPE_CHECKING:
    from heavebond.estimation.experiment import Experiment
    from heavebond.estimation.fitting import Fit

HEAD = ("parameter", "before", "fitted", "95 % interval", "range")


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
@picture_option("Draw records, fitted model and residual")
@json_option
def fit(experiment: str, starts: int, segments: int, robust: bool, profiled: tuple[str, ...], written: Path | None,
        output: Path | None) -> dict[str, object]:
    """Estimate the parameters under `free:` of EXPERIMENT by least squares.

    Records with `use: fit` are fitted; the others are held out as validation data. Without other records every third section
    of the records is held out.
    """
    from heavebond.commands import terminal
    from heavebond.commands.compare import noticed
    from heavebond.estimation.diagram_files import fitted_diagram, quantity, write
    from heavebond.estimation.experiment import load_experiment
    from heavebond.estimation.fitting import fit as fitted
    from heavebond.estimation.fitting import profile

    check_picture(output)
    if written is not None:
        check_new(written, (".yaml",))
    with terminal.working("fitting") as progress:
        given = load_experiment(experiment)
        _check_free(given, profiled)
        found = fitted(given, starts=starts, segments=segments, robust=robust, progress=progress, partial=True)
        early = found.message == ENDED_EARLY
        profiles = {} if early else {name: profile(found, name, progress=progress) for name in profiled}
    console = terminal.output()
    console.print(parameters(found))
    for line in own_words(found):
        console.print(line, soft_wrap=True)
    console.print(_records(found))
    for line in noticed(found.after, console.width):
        console.print(line)
    for words in found.identifiability.words:
        console.print(words, soft_wrap=True)
    told = {name: replace(next(p for p in found.parameters if p.name == name), interval=ends, at_bound="")
            for name, ends in profiles.items()}
    for name, p in told.items():
        said = p.known(partial(quantity, unit=found.experiment.free[name].range.unit))
        console.print(f"{name}: {said} by profile likelihood", soft_wrap=True)
    # the end of a range says nothing of what the records cannot see
    unseen = found.identifiability.unseen_names
    at_bounds = [p.name for p in found.parameters
                 if p.at_bound and p.name + (f" ({p.record})" if p.record else "") not in unseen]
    if at_bounds:
        console.print(f"{', '.join(at_bounds)} ended at the end of the range: often a sign that an effect is missing.",
                      soft_wrap=True)
    files = []
    if written is not None:
        write(written, fitted_diagram(found, written))
        files.append(written)
    if output is not None:
        from heavebond.pictures.plot import plot_comparison, save

        files.append(save(plot_comparison(found.after), output))
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    figures = {"experiment": found.experiment.name, **found.as_dict(),
               "profiles": {name: list(p.told) for name, p in told.items()}, "files": list(map(str, files))}
    if early:
        console.print("ended early: these are the best values so far", soft_wrap=True)
        raise Interrupted(last_heard(), figures)
    return figures


def _check_free(given: Experiment, names: Sequence[str]) -> None:
    """UsageError for a name that is not free: found before the fit and not after it."""
    from heavebond.core.errors import Problem, UsageError, listing, suggest

    for name in names:
        if name not in given.free:
            raise UsageError([Problem("free-unknown", f"--profile {name}: that is not free", None,
                                      suggest(name, given.free) or f"Free are {listing(given.free, 40)}.")])


def parameters(found: Fit) -> object:
    """The fitted parameters with their intervals, as a table."""
    from heavebond.commands import terminal
    from heavebond.core.presentation import in_unit

    rows = []
    for p in found.parameters:
        name = p.name + (f" ({p.record})" if p.record else "")
        unit = found.experiment.free[p.name].range.unit
        before, value, least, most = (in_unit(v, unit, digits) for v, digits in (
            (p.before, 6), (p.value, p.digits), (p.low, 6), (p.high, 6)))
        of = "" if unit.text in ("1", "") else f" {unit.text}"
        rows.append((name, f"{before}{of}", f"{value}{of}", p.known(partial(in_unit, unit=unit, digits=p.digits), of),
                     f"{least} .. {most}{of}" + (f", at its {p.at_bound} end" if p.at_bound else "")))
    rows += [_own_row(found, record, p.name) for record, own in found.held_out.items()
             for p in {p.name: p for p in found.parameters if p.name in own.values}.values()]
    return terminal.table(f"{found.experiment.name}: {found.samples} samples, reduced chi-square {found.chi2:.4g}",
                          HEAD, rows)


def _own_row(found: Fit, record: str, name: str) -> tuple[str, str, str, str, str]:
    """A value that a held-out record has for itself, in the columns of the parameters."""
    from heavebond.core.presentation import in_unit

    p = next(p for p in found.parameters if p.name == name)
    unit = found.experiment.free[name].range.unit
    of = "" if unit.text in ("1", "") else f" {unit.text}"
    value, least, most = (in_unit(v, unit, 6) for v in (found.held_out[record].values[name], p.low, p.high))
    return f"{name} ({record}, held out)", "-", f"{value}{of}", "-", f"{least} .. {most}{of}"


def own_words(found: Fit) -> list[str]:
    """What is done with values `each: record` on records that are held out."""
    from heavebond.core.errors import listing
    from heavebond.core.presentation import number

    names = listing([name for name, free in found.experiment.free.items() if free.each], 4)
    fitted = [f"the first {number(own.seconds, 3)} s of {record}" for record, own in found.held_out.items() if own.values]
    failed = [record for record, own in found.held_out.items() if not own.values]
    said = []
    if fitted:
        said.append(f"{names} (each: record): on held-out records fitted too, to {listing(fitted, 4)}, with all other "
                    "values given; the held-out errors contain these samples.")
    if failed:
        said.append(f"{names} (each: record): could not be fitted on {listing(failed, 4)}, where the model cannot be "
                    "simulated; the values of the diagram are used there.")
    return said


def _records(found: Fit) -> object:
    from heavebond.commands import terminal
    from heavebond.core.presentation import number, readable

    rows = []
    for before_fit, part in zip(found.before.parts, found.after.parts, strict=True):
        for k, channel in enumerate(part.channels.values()):
            before = before_fit.channels[channel.name]
            rows.append((f"{part.name} ({part.use})" if k == 0 else "", channel.name,
                         readable(before.error, channel.unit, 3), readable(channel.error, channel.unit, 3),
                         readable(channel.noise, channel.unit, 3), number(channel.chi2, 3)))
    return terminal.table("", ("record", "channel", "error before", "after", "noise", "reduced chi-square"), rows,
                          text=2)
