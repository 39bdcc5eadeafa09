"""`heavebond compare`: compare a model with measured records; errors per channel and a picture."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    blamed_on_settings,
    check_picture,
    json_option,
    picture_option,
    set_option,
    with_settings,
)

if TYPE_CHECKING:
    from heavebond.estimation.comparison import Channel, Comparison
    from heavebond.estimation.experiment import Experiment

HEAD = ("record", "channel", "rms error", "fit", "bias", "noise", "error/noise")


@click.command(short_help="Compare a model with its measured records.")
@click.argument("experiment")
@set_option
@picture_option("Draw records, model and residual")
@json_option
def compare(experiment: str, settings: tuple[str, ...], output: Path | None) -> dict[str, object]:
    """Simulate EXPERIMENT with its measured inputs and show the error on each record.

    EXPERIMENT is a YAML file or a bundled one (passive_rig/friction).
    """
    from heavebond.commands import terminal
    from heavebond.core.presentation import number
    from heavebond.estimation.comparison import compare as compared
    from heavebond.estimation.experiment import load_experiment

    check_picture(output)
    with blamed_on_settings(settings), terminal.working("simulating the records") as progress:
        comparison = compared(_with_settings(load_experiment(experiment), settings), progress=progress)
    console = terminal.output()
    console.print(_table(comparison))
    for part in comparison.parts:
        console.print(f"{part.name} ({part.use}): normalised error {_percent(100 * part.normalised)}, "
                      f"reduced chi-square {number(part.chi2, 3)}", soft_wrap=True)
    for line in noticed(comparison, console.width):
        console.print(line)
    for line in comparison.advice:
        console.print(line, soft_wrap=True)
    files = []
    if output is not None:
        from heavebond.pictures.plot import plot_comparison, save

        files.append(save(plot_comparison(comparison), output))
        console.print(f"wrote {output}", soft_wrap=True)
    return {"experiment": comparison.experiment.name, "records": comparison.as_dict(), "advice": list(comparison.advice),
            "files": list(map(str, files))}


def noticed(comparison: Comparison, width: int) -> list[str]:
    """The notes on all records, formatted for a terminal of `width` characters."""
    from heavebond.core.presentation import columns

    rows = [(name if k == 0 else "", note) for name, record in comparison.records.items()
            for k, note in enumerate(record.notes)]
    return ["noticed", *columns(rows, width)] if rows else []


def _with_settings(experiment: Experiment, settings: tuple[str, ...]) -> Experiment:
    """The experiment with `--set` values, which override those set for a single record."""
    changed = with_settings(experiment.model, settings)
    given = {path: value for path, value in changed.settings.items() if experiment.model.settings.get(path) != value}
    return replace(experiment, model=changed, records={
        name: replace(record, settings={**record.settings, **given}) for name, record in experiment.records.items()})


def _table(comparison: Comparison) -> object:
    from heavebond.commands import terminal

    largest: dict[str, float] = {}
    for part in comparison.parts:
        for name, channel in part.channels.items():
            largest[name] = max(largest.get(name, 0.0), channel.error, channel.noise)
    rows = [(part.name if k == 0 else "", *_row(channel, largest[name])) for part in comparison.parts
            for k, (name, channel) in enumerate(part.channels.items())]
    return terminal.table(comparison.experiment.name, HEAD, rows, text=2)


def _row(channel: Channel, largest: float) -> tuple[str, ...]:
    """A row of the table; all values in the unit that suits the `largest`, so that they can be compared."""
    from heavebond.core.presentation import number, readable

    error, bias, noise = (readable(v, channel.unit, 3, beside=largest) for v in (channel.error, channel.bias, channel.noise))
    return (channel.name, error, _percent(channel.fit), bias, noise,
            number(channel.error / channel.noise, 3) if channel.noise else "-")


def _percent(value: float) -> str:
    from heavebond.core.presentation import number

    return f"{number(value, 3)} %" if math.isfinite(value) else "-"
