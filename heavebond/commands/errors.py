"""`heavebond errors`: the errors of a sequence of experiments, each with one more effect."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import check_picture, json_option, picture_option

if TYPE_CHECKING:
    from heavebond.diagnosis.ladder import LadderEntry

HEAD = ("error, fitted", "held out", "chi-square, fitted", "held out")


@click.command(short_help="Show the errors of a sequence of experiments.")
@click.argument("experiments", nargs=-1, required=True)
@picture_option("Draw the errors on fitted and held-out data, and the noise level")
@json_option
def errors(experiments: tuple[str, ...], output: Path | None) -> dict[str, object]:
    """Compare several EXPERIMENTS on the same records, each model with the values of its diagram.

    The error is relative to the size of the measured signals; the reduced chi-square is 1 at the noise level.
    `heavebond ladder` is the same command.
    """
    from heavebond.commands import terminal
    from heavebond.diagnosis.ladder import ladder

    check_picture(output)
    with terminal.working("comparing") as progress:
        rungs = ladder(experiments, progress=progress)
    console = terminal.output()
    console.print(table(rungs, "experiment"))
    files = []
    if output is not None:
        from heavebond.pictures.plot import plot_ladder, save

        files.append(save(plot_ladder(rungs), output))
        console.print(f"wrote {output}", soft_wrap=True)
    return {"ladder": [r.as_dict() for r in rungs], "files": list(map(str, files))}


def table(rungs: Sequence[LadderEntry], first: str) -> object:
    """The ladder as a table; `first` says what stands in its rows."""
    from heavebond.commands import terminal
    from heavebond.core.presentation import number

    rows = [(r.name, *(f"{number(100 * e, 3)} %" for e in (r.error_fit, r.error_held_out)),
             *(number(c, 3) for c in (r.chi2_fit, r.chi2_held_out))) for r in rungs]
    return terminal.table("Error in % of what was measured; reduced chi-square (1 = noise level)",
                          (first, *HEAD), rows)
