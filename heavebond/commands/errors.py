"""`heavebond errors`: the errors of a sequence of experiments, each with one more effect."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import check_picture, json_option, native_option, picture_option


@click.command(short_help="Show the errors of a sequence of experiments.")
@click.argument("experiments", nargs=-1, required=True)
@picture_option("Draw the errors on fitted and held-out data, and the noise level")
@native_option
@json_option
def errors(experiments: tuple[str, ...], output: Path | None) -> dict[str, object]:
    """Compare several EXPERIMENTS on the same records, each model with the values of its diagram.

    The error is relative to the size of the measured signals; the reduced chi-square is 1 at the noise level.
    """
    from heavebond.commands import terminal
    from heavebond.diagnosis.state import errors as errors_of
    from heavebond.reports.result_tables import ladder_table

    check_picture(output)
    with terminal.working("comparing") as progress:
        rungs = errors_of(experiments, progress=progress)
    console = terminal.output()
    terminal.show([ladder_table(rungs, "experiment")])
    files = []
    if output is not None:
        from heavebond.pictures.plot import plot_ladder, save

        files.append(save(plot_ladder(rungs), output))
        console.print(f"wrote {output}", soft_wrap=True)
    return {"ladder": [r.as_dict() for r in rungs], "files": list(map(str, files))}
