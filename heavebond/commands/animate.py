"""`heavebond animate`: an animation of a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from heavebond.commands.arguments import (
    Number,
    Whole,
    blamed_on_settings,
    check_writable,
    json_option,
    native_option,
    set_option,
    settings_of,
    with_settings,
)
from heavebond.core.errors import Problem, UsageError, listing


def check_mode_options(mode: int | None, steady: bool, of_runs: Mapping[str, object]) -> None:
    """UsageError for options of a run with --mode, or for --steady without it."""
    used = [name for name, value in of_runs.items() if value]
    if mode is not None and used:
        raise UsageError([Problem("mode-options", f"{listing(used)} {'acts' if len(used) == 1 else 'act'} on a run; "
                                  "--mode animates no run", None, "Leave out one of them.")])
    if mode is None and steady:
        raise UsageError([Problem("mode-options", "--steady acts on --mode only", None, "Add --mode NUMBER.")])


@click.command(short_help="Animate a run or a mode.")
@click.argument("model")
@click.option("-o", "--output", metavar="FILE", type=click.Path(path_type=Path),
              help="A page (.html), a film (.gif, .mp4) or a picture (.png); without it MODEL.html in the current folder.")
@click.option("--signal", "signals", metavar="SIGNAL", multiple=True,
              help="Draw a variable or an output over time below. May be repeated; without it the first outputs.")
@click.option("--until", metavar="TIME", help="End time of the simulation, e.g. --until '2 min'.")
@click.option("--every", metavar="TIME", help="Time between output points, e.g. --every '10 ms'.")
@click.option("--speed", metavar="NUMBER", type=Number(0, min_open=True),
              help="Playback speed; 1, the default, is real time. A mode has a period of 2 s by default.")
@click.option("--mode", "mode", metavar="NUMBER", type=Whole(1),
              help="Animate a mode instead of a run: its number in `heavebond modes MODEL`, from 1.")
@click.option("--steady", is_flag=True, help="Linearise in the steady state for --mode; without it at the start.")
@click.option("--at", metavar="TIME", help="Instant of a picture (.png), e.g. --at '2 s'; without it the start.")
@click.option("--also", "overlaid", metavar="PATH=VALUE", multiple=True,
              help="Overlay a run with another value on a machine in space; `;` separates several values. May be repeated.")
@set_option
@native_option
@json_option
def animate(model: str, output: Path | None, signals: tuple[str, ...], until: str | None, every: str | None,
            speed: float | None, mode: int | None, steady: bool, at: str | None, overlaid: tuple[str, ...],
            settings: tuple[str, ...]) -> dict[str, object]:
    """Simulate the diagram MODEL and write an animation, or one of its modes.

    The shapes are declared under `view:` in the diagram; a machine in space without it shows its parts. A page plays
    without a network, at any speed and from any instant.
    """
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.pictures import motion
    from heavebond.pictures.animation import SUFFIXES, save_animation

    check_mode_options(mode, steady, {"--signal": signals, "--until": until, "--every": every, "--also": overlaid})
    path = output or Path(f"{Path(model).stem}.html")
    check_writable(path, SUFFIXES)
    changes = [settings_of("--also", text.split(";"), "'gas.c=40 kN/m; load.m=2 t'") for text in overlaid]
    with blamed_on_settings((*settings, *(part for text in overlaid for part in text.split(";")))):
        diagram = with_settings(load(model), settings)
        if mode is not None:
            moving = motion.animate_mode(diagram, mode, at="steady" if steady else None)
            speed = speed or float(moving.time[-1] - moving.time[0]) / motion.CYCLES / 2
        else:
            moving = motion.animate(diagram, until, every=every, signals=signals)
        if changes:
            others = [motion.animate(diagram, until, every=every, signals=signals, parameters=change) for change in changes]
            moving = moving.with_runs(dict(zip(overlaid, others, strict=True)))
    save_animation(moving, path, speed=speed or 1.0, at=at)
    terminal.output().print(f"wrote {path}", soft_wrap=True)
    return {"files": [str(path)], "frames": len(moving.time)}
