"""`heavebond sensitivity`: influence of parameters on signals; comparison of sensitivities with finite differences."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Number,
    Whole,
    assembled,
    blamed_on_settings,
    check_picture,
    json_option,
    listed,
    native_option,
    of_option,
    parameter_option,
    picture_option,
    read_signals,
    set_option,
    with_settings,
)
from heavebond.core.errors import Problem, UsageError

if TYPE_CHECKING:
    from heavebond.optimise.gradient_check import Subject, Verdict

CHECKED = ("of", "parameter", "error", "at tight rtol", "step", "verdict")
WORDS = {"agrees": "agrees", "tolerance": "tolerance too loose", "kink": "kink", "disagrees": "DISAGREES",
         "unsettled": "unsettled"}


@click.command(short_help="Rank parameters by their influence on signals.")
@click.argument("model")
@of_option(required=False)
@parameter_option("By default all that are not zero; with --check the free parameters of a study.")
@set_option
@click.option("--until", metavar="TIME", help="End time of the simulation, e.g. --until '2 min'.")
@click.option("--every", metavar="TIME", help="Time between output points, e.g. --every '10 ms'.")
@click.option("--most", metavar="N", type=Whole(1), default=60, show_default=True,
              help="Number of parameters that are examined if none are named.")
@click.option("--rows", metavar="N", type=Whole(1), default=15, show_default=True,
              help="Parameters to list for each signal.")
@picture_option("Draw the influences as bars, and the strongest over time")
@click.option("--check", "checked", is_flag=True,
              help="Compare the sensitivities with differences of runs. MODEL may then be a tuning study.")
@click.option("--rtol", metavar="NUMBER", type=Number(0, 0.1, min_open=True),
              help="With --check: relative tolerance of the sensitivities [default: as they are computed].")
@click.option("--backwards", is_flag=True, help="With --check: check the gradients of a study by runs backwards.")
@native_option
@json_option
def sensitivity(model: str, of: tuple[str, ...], parameters: tuple[str, ...], settings: tuple[str, ...], until: str | None,
                every: str | None, most: int, rows: int, output: Path | None, checked: bool, rtol: float | None,
                backwards: bool) -> dict[str, object]:
    """Rank the parameters of the diagram MODEL by their influence on a signal, with exact sensitivities.

    The influence of a parameter is the first-order change of the signal if the parameter were doubled: its RMS over time,
    relative to the RMS of the signal about its mean. `initial.X` and `scale.X` (of a measured input) are parameters as
    well.

    With --check, compare sensitivities with differences of runs at steps of 1e-2 to 1e-5 of each parameter. Of a tuning
    study the cost and the limits are checked unless signals are named. If they differ, the reason is printed: tolerances
    that are too loose, a law with a kink between the runs, or a mistake.
    """
    if checked:
        return _check(model, of, parameters, settings, until, rtol, backwards)
    if not of:
        raise UsageError([Problem("signal-missing", "no signal is named", None, "Add --of crown.x.")])
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.optimise.influence import rank
    from heavebond.reports.analysis_tables import sensitivity_items

    check_picture(output)
    with blamed_on_settings(settings):
        loaded = with_settings(load(model), settings)
        formulas = read_signals("--of", of, loaded)
        with terminal.working("assembling"):
            assembly = assembled(loaded, "--of", formulas)
        with terminal.working("sensitivities") as progress:
            rankings = rank(assembly, list(formulas), listed(parameters), until, every=every, most=most, progress=progress)
    terminal.show(sensitivity_items(rankings, rows))
    if output is not None:
        from heavebond.pictures.plot import plot_influence, save

        save(plot_influence(rankings, title=f"{assembly.model.name}: influence of parameters"), output)
        terminal.output().print(f"wrote {output}", soft_wrap=True)
    return {**rankings.as_dict(), "files": [str(output)] if output else []}


# -- check -------------------------------------------------------------------------------------------------------------
def _check(file: str, of: tuple[str, ...], parameters: tuple[str, ...], settings: tuple[str, ...], until: str | None,
           rtol: float | None, backwards: bool) -> dict[str, object]:
    from heavebond.commands import terminal
    from heavebond.language.model import find, load
    from heavebond.numerics.simulator import Tolerances
    from heavebond.optimise.gradient_check import check_gradients, costs_of, signals_of
    from heavebond.studies.study import load_study
    from heavebond.text.yaml_source import read

    study = load_study(file) if "study" in read(find(file, "diagram or study")).root.items else None
    tolerances = Tolerances(rtol, rtol / 100) if rtol else None
    sought = listed(parameters) or (list(study.tuning.free) if study else [])
    if not sought:
        raise UsageError([Problem("nothing-to-check", "no parameter is named", None,
                                  "Add --parameter crown.m,controller.K_p.")])
    with blamed_on_settings(settings), terminal.working("running") as progress:
        if not of and study is None:
            raise UsageError([Problem("nothing-to-check", "no signal is named", None, "Add --of crown.x.")])
        if backwards and (of or study is None):
            raise UsageError([Problem("backwards-signal", "only the costs of a study have gradients by runs backwards", None,
                                      "Leave --backwards out, or name a study without --of.")])
        loaded = with_settings(study.model if study else load(file), settings)
        assembly = assembled(loaded, "--of", formulas := read_signals("--of", of, loaded))
        if study and not of:
            subject = costs_of(assembly, study.tuning, tolerances=tolerances, backwards=backwards)
        else:
            subject = signals_of(assembly, list(formulas), until, tolerances=tolerances)
        verdicts = check_gradients(subject, sought, progress=progress)
    console = terminal.output()
    console.print(_check_table(subject, verdicts))
    for verdict in verdicts:
        if verdict.why:
            console.print(f"{verdict.quantity} to {verdict.parameter}: {verdict.why}", soft_wrap=True)
    return {"model": subject.assembly.model.name, "rtol": subject.tolerances.rtol,
            "verdicts": [_check_figures(verdict) for verdict in verdicts]}


def _check_table(subject: Subject, verdicts: list[Verdict]) -> object:
    from heavebond.commands import terminal

    rows = []
    for verdict in verdicts:
        step = min(verdict.steps, key=lambda h: verdict.steps[h], default=None)
        rows.append((verdict.quantity, verdict.parameter, f"{verdict.given:.1e}", f"{verdict.best:.1e}",
                     f"{step:g}" if step else "-", WORDS[verdict.word]))
    return terminal.table(f"{subject.assembly.model.name}, sensitivities at rtol {subject.tolerances.rtol:g}", CHECKED, rows,
                          text=2)


def _check_figures(verdict: Verdict) -> dict[str, object]:
    return {"of": verdict.quantity, "to": verdict.parameter, "verdict": verdict.word, "why": verdict.why,
            "error": verdict.given, "steps": {f"{h:g}": e for h, e in verdict.steps.items()}, "best": verdict.best,
            "one_sided": verdict.apart, "largest": verdict.largest}
