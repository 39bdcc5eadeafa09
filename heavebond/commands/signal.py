"""`heavebond signal`: spectrum, significant values, waves and rainflow cycles of a signal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Number,
    assembled,
    blamed_on_settings,
    check_picture,
    json_option,
    picture_option,
    read_signals,
    set_option,
    with_settings,
)

if TYPE_CHECKING:
    from heavebond.records.spectra import EvenSignal

DIAGRAMS = (".yaml", ".yml", "")


@click.command(short_help="Spectrum, significant values, waves and load cycles of a signal.")
@click.argument("file", metavar="RUN")
@click.option("--signal", "signals", metavar="SIGNAL", multiple=True, required=True,
              help="A signal of the run, or a column of the record. May be repeated.")
@click.option("--from", "begin", metavar="TIME", help="Start of the evaluated time, e.g. --from '60 s'.")
@click.option("--until", metavar="TIME", help="End of the evaluated time; of a diagram, of the simulation.")
@click.option("--segment", metavar="TIME", help="Length of the segments over which the spectrum is averaged (Welch).")
@click.option("--slope", metavar="NUMBER", type=Number(1, 20), default=3.0, show_default=True,
              help="Exponent of the S-N curve, for the equivalent range.")
@click.option("--time", metavar="COLUMN", help="Of a record: the column of the times in s [default: the first].")
@set_option
@click.option("--every", metavar="TIME", help="Of a diagram: time between output points.")
@picture_option("Draw the signal, its spectrum and its cycles")
@json_option
def signal(file: str, signals: tuple[str, ...], begin: str | None, until: str | None, segment: str | None,
           slope: float, time: str | None, settings: tuple[str, ...], every: str | None, output: Path | None
           ) -> dict[str, object]:
    """Analyse an oscillating signal of a saved RUN (`heavebond run --save`), of a record, or of a simulation.

    The significant height is 4 sqrt(m_0) of the spectrum. A wave lasts from one upward crossing of the mean to the next.
    Cycles are counted by the rainflow method (ASTM E1049-85); the equivalent range is the range of one cycle per second
    with the same damage.
    """
    from heavebond.commands import terminal
    from heavebond.numerics.output_times import seconds
    from heavebond.records.spectra import SignalAnalysis, read_courses
    from heavebond.reports.analysis_tables import signal_items

    check_picture(output)
    window = seconds(begin or 0.0, "--from"), seconds(until or float("inf"), "--until")
    length = None if segment is None else seconds(segment, "--segment")
    if Path(file).suffix.lower() in DIAGRAMS:
        courses = _run(file, signals, settings, until, every, window)
    else:
        courses = read_courses(Path(file), signals, time=time, begin=window[0], end=window[1])
    analyses = [SignalAnalysis(course, length, slope) for course in courses]
    console = terminal.output()
    for one in analyses:
        terminal.show(signal_items(one))
        console.print()
    if output is not None:
        from heavebond.pictures.plot import save
        from heavebond.pictures.plot_spectra import plot_spectra

        console.print(f"wrote {save(plot_spectra(analyses), output)}", soft_wrap=True)
    return {"signals": {one.course.name: one.as_dict() for one in analyses}}


def _run(file: str, signals: tuple[str, ...], settings: tuple[str, ...], until: str | None, every: str | None,
         window: tuple[float, float]) -> list[EvenSignal]:
    """Simulate a diagram and take the signals of the run."""
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.numerics.simulation import simulate
    from heavebond.records.spectra import evenly

    with blamed_on_settings(settings):
        loaded = with_settings(load(file), settings)
        formulas = read_signals("--signal", signals, loaded)
        with terminal.working("assembling"):
            assembly = assembled(loaded, "--signal", formulas)
        with terminal.working("integrating"):
            result = simulate(assembly, until, every=every)
    inside = (result.time >= window[0]) & (result.time <= window[1])
    return [evenly(name, result.unit(name), result.time[inside], values[inside])
            for name, values in result.signals(signals).items()]
