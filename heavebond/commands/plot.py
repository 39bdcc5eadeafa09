"""`heavebond plot`: saved runs and records in common axes."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import check_picture, json_option
from heavebond.core.errors import Problem, UsageError


@click.command(short_help="Plot saved runs and records in the same axes.")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--signal", "signals", metavar="SIGNAL", multiple=True,
              help="A signal to draw, e.g. --signal crown.x. May be repeated [default: the first that all files hold].")
@click.option("--column", "columns", metavar="SIGNAL='COLUMN UNIT'", multiple=True,
              help="Column and unit of a signal in a record, e.g. --column crown.x='crown_m m'. May be repeated.")
@click.option("--record", metavar="NAME", default="", help="A record of an experiment [default: the first].")
@click.option("--from", "begin", metavar="TIME", help="Start of the time axis, e.g. --from '72 s'.")
@click.option("--until", "end", metavar="TIME", help="End of the time axis.")
@click.option("--title", metavar="TEXT", default="", help="Title of the plot.")
@click.option("-o", "--output", metavar="PICTURE", type=click.Path(path_type=Path), default=Path("plot.png"),
              show_default=True, help="Picture file (.png, .svg or .pdf).")
@json_option
def plot(files: tuple[str, ...], signals: tuple[str, ...], columns: tuple[str, ...], record: str, begin: str | None,
         end: str | None, title: str, output: Path) -> dict[str, object]:
    """Draw the same signals of several FILEs over one time axis.

    A FILE is a saved run (`heavebond run MODEL --save run.parquet`), an experiment (.yaml, or a bundled one) whose record
    is drawn as dots, or a record whose columns are assigned by --column.
    """
    from heavebond.commands import terminal
    from heavebond.numerics.output_times import seconds
    from heavebond.pictures.overlay import common_signals, read_column, read_overlay

    check_picture(output)
    overlay = read_overlay(files, [read_column(text) for text in columns], record)
    chosen = list(dict.fromkeys(signals)) or common_signals(overlay)
    window = (seconds(begin, "--from") if begin else float(min(run.time[0] for run in overlay.runs.values())),
              seconds(end, "--until") if end else float(max(run.time[-1] for run in overlay.runs.values())))
    if window[0] >= window[1]:
        raise UsageError([Problem("window-empty", f"no samples lie between {window[0]:g} s and {window[1]:g} s", None,
                                  "Give a --from that is before --until.")])
    from heavebond.pictures.plot import plot_runs, save

    path = save(plot_runs(overlay.runs, chosen, title=title, window=window, measured=overlay.measured), output)
    terminal.output().print(f"wrote {path}: {', '.join(chosen)} of {', '.join(overlay.runs)}", soft_wrap=True)
    return {"files": [str(path)], "signals": chosen, "runs": list(overlay.runs), "measured": list(overlay.measured)}
