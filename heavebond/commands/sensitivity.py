"""`heavebond sensitivity`: influence of parameters on signals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Whole,
    assembled,
    blamed_on_settings,
    check_picture,
    json_option,
    listed,
    of_option,
    parameter_option,
    picture_option,
    read_signals,
    set_option,
    with_settings,
)

if TYPE_CHECKING:
    from heavebond.optimise.influence import Influence, Ranking, Rankings

HEAD = ("parameter", "value", "influence", "1 % more moves it by", "at")


@click.command(short_help="Rank parameters by their influence on signals.")
@click.argument("model")
@of_option(required=True)
@parameter_option("By default all that are not zero.")
@set_option
@click.option("--until", metavar="TIME", help="End time of the simulation, e.g. --until '2 min'.")
@click.option("--every", metavar="TIME", help="Time between output points, e.g. --every '10 ms'.")
@click.option("--most", metavar="N", type=Whole(1), default=60, show_default=True,
              help="Number of parameters that are examined if none are named.")
@click.option("--rows", metavar="N", type=Whole(1), default=15, show_default=True,
              help="Parameters to list for each signal.")
@picture_option("Draw the influences as bars, and the strongest over time")
@json_option
def sensitivity(model: str, of: tuple[str, ...], parameters: tuple[str, ...], settings: tuple[str, ...], until: str | None,
                every: str | None, most: int, rows: int, output: Path | None) -> dict[str, object]:
    """Rank the parameters of the diagram MODEL by their influence on a signal, with exact sensitivities.

    The influence of a parameter is the first-order change of the signal if the parameter were doubled: its RMS over time,
    relative to the RMS of the signal about its mean. `initial.X` and `scale.X` (of a measured input) are parameters as
    well.
    """
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.optimise.influence import rank

    check_picture(output)
    with blamed_on_settings(settings):
        loaded = with_settings(load(model), settings)
        formulas = read_signals("--of", of, loaded)
        with terminal.working("assembling"):
            assembly = assembled(loaded, "--of", formulas)
        with terminal.working("sensitivities") as progress:
            rankings = rank(assembly, list(formulas), listed(parameters), until, every=every, most=most, progress=progress)
    console = terminal.output()
    for ranking in rankings.rankings:
        console.print(_table(ranking, rows))
        console.print()
    if rankings.left_out:
        console.print(f"{len(rankings.left_out)} more parameters were not tried; add --most "
                      f"{most + len(rankings.left_out)}: {', '.join(rankings.left_out)}", soft_wrap=True)
    if rankings.filled:
        console.print(f"Run {rankings.filled}", style="yellow", soft_wrap=True)
    if output is not None:
        from heavebond.pictures.plot import plot_influence, save

        save(plot_influence(rankings, title=f"{assembly.model.name}: influence of parameters"), output)
        console.print(f"wrote {output}", soft_wrap=True)
    return {"model": assembly.model.name, "until": float(rankings.time[-1]), **_figures(rankings),
            "files": [str(output)] if output else []}


def _table(ranking: Ranking, rows: int) -> object:
    from heavebond.commands import terminal
    from heavebond.core.presentation import number, readable

    size = f"rms {readable(ranking.size, ranking.unit, 3)} " + ("(it stands still)" if ranking.still else "about its mean")
    return terminal.table(f"{ranking.signal}: {size}", HEAD, [
        (i.parameter, readable(i.value, i.unit.text, 4), number(i.relative, 3),
         readable(i.peak / 100, ranking.unit, 3) if i.peak else "-", f"{number(i.time, 4)} s" if i.peak else "-")
        for i in ranking.influences[:rows]])


def _figures(rankings: Rankings) -> dict[str, object]:
    def one(influence: Influence) -> dict[str, object]:
        return {"parameter": influence.parameter, "value": influence.value, "unit": influence.unit.text,
                "influence": influence.relative, "peak": influence.peak, "time": influence.time}

    return {"signals": {r.signal: {"unit": r.unit, "rms": r.size, "still": r.still,
                                   "influences": [one(i) for i in r.influences]} for r in rankings.rankings},
            "left_out": list(rankings.left_out), "filled": rankings.filled or None}
