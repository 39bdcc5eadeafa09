"""`heavebond localize`: the times, states of motion and places of the diagram at which a model fails."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import check_picture, json_option, native_option, picture_option

if TYPE_CHECKING:
    from heavebond.localise.misfit import Localization


@click.command(short_help="Locate where in its diagram a model fails its records.")
@click.argument("experiment")
@click.option("--fitted", is_flag=True, help="Begin with a fit of the free parameters instead of the diagram's values.")
@picture_option("Draw the estimated input at the best place of each kind, and the misfit over time")
@native_option
@json_option
def localize(experiment: str, fitted: bool, output: Path | None) -> dict[str, object]:
    """Locate the error of the model of EXPERIMENT: when and in which state of motion it occurs, and at which place of the
    diagram a force or a flow is missing.

    With --output name.png the pictures are name.png (the best place), name_2.png and so on, and name_misfit.png.
    """
    from heavebond.commands import terminal
    from heavebond.estimation.excerpts import cut
    from heavebond.estimation.experiment import load_experiment
    from heavebond.estimation.fitting import fit
    from heavebond.localise.misfit import localize
    from heavebond.reports.result_tables import localization_items

    check_picture(output)
    loaded = load_experiment(experiment)
    with terminal.working("localizing model errors") as progress:
        values = fit(loaded, progress=progress) if fitted else None
        localization = localize(loaded, values=values, progress=progress)
    console = terminal.output()
    terminal.show(localization_items(localization))
    if looked := cut(localization.experiment, loaded):
        console.print(f"The records are long: only their beginning was analysed ({looked}); `from:` and `to:` of a record "
                      f"select another part.", soft_wrap=True)
    files = _drawn(localization, output) if output is not None else []
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    return {"experiment": localization.experiment.name, **localization.as_dict(), "files": list(map(str, files))}


def _drawn(localization: Localization, output: Path) -> list[Path]:
    from heavebond.localise.misfit import best_of_each_group
    from heavebond.pictures.plot import save
    from heavebond.pictures.plot_where import plot_misfit, plot_place

    files = [save(plot_place(localization, s.place.name), output if k == 1 else output.with_stem(f"{output.stem}_{k}"))
             for k, s in enumerate(best_of_each_group(localization), 1)]
    return [*files, save(plot_misfit(localization), output.with_stem(output.stem + "_misfit"))]
