"""`heavebond compare`: compare a model with measured records; errors per channel and a picture."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import (
    blamed_on_settings,
    check_picture,
    json_option,
    native_option,
    picture_option,
    set_option,
    settings_of,
)


@click.command(short_help="Compare a model with its measured records.")
@click.argument("experiment")
@set_option
@picture_option("Draw records, model and residual")
@native_option
@json_option
def compare(experiment: str, settings: tuple[str, ...], output: Path | None) -> dict[str, object]:
    """Simulate EXPERIMENT with its measured inputs and show the error on each record.

    EXPERIMENT is a YAML file or a bundled one (passive_rig/friction).
    """
    from heavebond.commands import terminal
    from heavebond.estimation.comparison import compare as compared
    from heavebond.estimation.experiment import load_experiment
    from heavebond.reports.result_tables import comparison_items

    check_picture(output)
    with blamed_on_settings(settings), terminal.working("simulating the records") as progress:
        comparison = compared(load_experiment(experiment).with_parameters(settings_of("--set", settings)), progress=progress)
    terminal.show(comparison_items(comparison))
    files = []
    if output is not None:
        from heavebond.pictures.plot import plot_comparison, save

        files.append(save(plot_comparison(comparison), output))
        terminal.output().print(f"wrote {output}", soft_wrap=True)
    return {"experiment": comparison.experiment.name, "records": comparison.as_dict(), "advice": list(comparison.advice),
            "files": list(map(str, files))}
