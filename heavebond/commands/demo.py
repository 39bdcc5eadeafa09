"""`heavebond demo`: the crown-mounted compensator, passive and active, in a regular and in an irregular sea."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import check_writable, json_option
from heavebond.core.writable import make_folder

if TYPE_CHECKING:
    from heavebond.numerics.dae import Array
    from heavebond.numerics.result import Result


@dataclass(frozen=True)
class Sea:
    """A sea: the diagram of each mode, and the time in s from which a run is evaluated and drawn (a function of its end
    and its parameters).
    """

    title: str
    file: str
    modes: dict[str, str]
    evaluated: Callable[[float, dict[str, float]], float]
    drawn: Callable[[float, dict[str, float]], float]


@dataclass(frozen=True)
class Figure:
    """A line of the table: a number from the signals of a run over the evaluated time and their values at rest."""

    name: str
    unit: str
    of: Callable[[dict[str, Array], dict[str, float]], float]


SEAS = (
    Sea("regular sea", "regular_sea", {"passive": "cmc_ahc/passive", "active": "cmc_ahc"},
        lambda end, p: end - 2 * p["wave.T"], lambda end, p: 0.0),
    Sea("irregular sea", "irregular_sea",
        {"passive": "cmc_ahc/irregular_sea_passive", "active": "cmc_ahc/irregular_sea"},
        lambda end, p: end / 2, lambda end, p: end - 15 * p["wave.T_p"]),
)
FIGURES = (
    Figure("platform heave", "m", lambda s, rest: _largest(s["platform"])),
    Figure("WOB variation", "kN", lambda s, rest: _largest(s["WOB"] - rest["WOB"])),
    Figure("WOB, least", "kN", lambda s, rest: float(s["WOB"].min())),
    Figure("WOB, most", "kN", lambda s, rest: float(s["WOB"].max())),
    Figure("bit off bottom", "% of time", lambda s, rest: 100 * float((s["WOB"] <= 0).mean())),
    Figure("crown block motion", "mm", lambda s, rest: _largest(s["crown"])),
    Figure("extension range", "m", lambda s, rest: float(s["extension"].max() - s["extension"].min())),
    Figure("chamber pressure, least", "bar", lambda s, rest: float(min(s["p_A"].min(), s["p_B"].min()))),
    Figure("chamber pressure, most", "bar", lambda s, rest: float(max(s["p_A"].max(), s["p_B"].max()))),
)
SIGNALS = ("platform", "WOB", "crown", "extension", "p_A", "p_B")
DRAWN = SIGNALS[:-1]  # p_B mirrors p_A


def _largest(values: Array) -> float:
    return float(abs(values).max())


@click.command(short_help="Run the crown-mounted compensator in two seas.")
@click.option("-o", "--output", metavar="FOLDER", type=click.Path(path_type=Path), required=True,
              help="Folder for the pictures; created if it does not exist.")
@json_option
def demo(output: Path) -> dict[str, object]:
    """Run the crown-mounted compensator passive and active in two seas; show a table and draw a picture of each sea.

    The last two periods of the regular wave and the last half of the irregular sea are evaluated: the largest deviation
    of the weight on bit (WOB) from its value at rest, the largest motion of the crown block, and further figures.
    """
    from heavebond.commands import terminal

    _make(output)
    runs: dict[str, dict[str, float]] = {}
    pictures = []
    for sea in SEAS:
        results = {}
        for mode, name in sea.modes.items():
            with terminal.working(f"{sea.title}, {mode}"):
                results[mode] = _run(name)
            runs[f"{sea.title}, {mode}"] = evaluated(results[mode], sea)
        pictures.append(_picture(sea, results, output))
    console = terminal.output()
    from heavebond.core.presentation import number

    console.print(terminal.table(
        "Crown-mounted compensator", ("", "unit", *(label.replace(" sea, ", "\n") for label in runs)),
        [(f.name, f.unit, *(number(figures[f.name], 4) for figures in runs.values())) for f in FIGURES], text=2))
    for path in pictures:
        console.print(f"wrote {path}", soft_wrap=True)
    return {"runs": runs, "units": {f.name: f.unit for f in FIGURES}, "files": list(map(str, pictures))}


def _make(folder: Path) -> None:
    make_folder(folder)
    for sea in SEAS:
        check_writable(folder / f"{sea.file}.png")


def _run(name: str) -> Result:
    from heavebond.language.model import load
    from heavebond.numerics.simulation import simulate

    return simulate(load(name))


def evaluated(result: Result, sea: Sea) -> dict[str, float]:
    """The figures of a run in a sea."""
    values = result.signals(SIGNALS)
    rest_values = {name: float(course[0]) for name, course in values.items()}
    late = result.time >= _from(sea.evaluated, result)
    return {f.name: f.of({name: course[late] for name, course in values.items()}, rest_values) for f in FIGURES}


def _from(when: Callable[[float, dict[str, float]], float], result: Result) -> float:
    return when(float(result.time[-1]), result.assembly.parameter_values)


def _picture(sea: Sea, results: dict[str, Result], folder: Path) -> Path:
    from heavebond.pictures.plot import plot_runs, save

    first = next(iter(results.values()))
    end = float(first.time[-1])
    begin, drawn = _from(sea.evaluated, first), _from(sea.drawn, first)
    runs = {label: result.saved(DRAWN) for label, result in results.items()}
    figure = plot_runs(runs, DRAWN, title=f"Crown-mounted compensator, {sea.title}", window=(drawn, end),
                       shaded=(begin, end) if begin > drawn else None)
    return save(figure, folder / f"{sea.file}.png")
