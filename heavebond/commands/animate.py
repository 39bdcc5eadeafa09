"""`heavebond animate`: an animation of a run."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import (
    Number,
    blamed_on_settings,
    check_writable,
    json_option,
    native_option,
    set_option,
    with_settings,
)


@click.command(short_help="Animate a run.")
@click.argument("model")
@click.option("-o", "--output", metavar="FILE", type=click.Path(path_type=Path),
              help="A page (.html), a film (.gif, .mp4) or a picture (.png); without it MODEL.html in the current folder.")
@click.option("--signal", "signals", metavar="SIGNAL", multiple=True,
              help="Draw a variable or an output over time below. May be repeated; without it the first outputs.")
@click.option("--until", metavar="TIME", help="End time of the simulation, e.g. --until '2 min'.")
@click.option("--every", metavar="TIME", help="Time between output points, e.g. --every '10 ms'.")
@click.option("--speed", metavar="NUMBER", type=Number(0, min_open=True), default=1.0, show_default=True,
              help="Playback speed; 1 is real time.")
@click.option("--at", metavar="TIME", help="Instant of a picture (.png), e.g. --at '2 s'; without it the start.")
@set_option
@native_option
@json_option
def animate(model: str, output: Path | None, signals: tuple[str, ...], until: str | None, every: str | None, speed: float,
            at: str | None, settings: tuple[str, ...]) -> dict[str, object]:
    """Simulate the diagram MODEL and write an animation.

    The shapes are declared under `view:` in the diagram; a machine in space without it shows its parts. A page plays
    without a network, at any speed and from any instant.
    """
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.pictures import motion
    from heavebond.pictures.animation import SUFFIXES, save_animation

    path = output or Path(f"{Path(model).stem}.html")
    check_writable(path, SUFFIXES)
    with blamed_on_settings(settings):
        moving = motion.animate(with_settings(load(model), settings), until, every=every, signals=signals)
    save_animation(moving, path, speed=speed, at=at)
    terminal.output().print(f"wrote {path}", soft_wrap=True)
    return {"files": [str(path)], "frames": len(moving.time)}
