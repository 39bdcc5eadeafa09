"""`heavebond draw`: a diagram as a picture."""

from __future__ import annotations

from pathlib import Path

import click

from heavebond.commands.arguments import (
    blamed_on_settings,
    check_writable,
    json_option,
    native_option,
    set_option,
    with_settings,
)
from heavebond.core.errors import Problem, UsageError


@click.command(short_help="Draw a diagram with symbols, wires and names.")
@click.argument("model")
@click.option("-o", "--output", metavar="FILE", type=click.Path(path_type=Path),
              help="Picture file (.svg, .png or .pdf) [default: MODEL.svg in the current folder].")
@click.option("--open", "opened", metavar="BLOCK", multiple=True,
              help="Draw the components inside a block, e.g. --open ahc. May be repeated.")
@click.option("--open-all", is_flag=True, help="Draw the components inside every block.")
@click.option("--values", is_flag=True, help="Write the values set on each component below its name.")
@click.option("--highlight", "marked", metavar="NAME[=LABEL]", multiple=True,
              help="Mark a component, a node or a port, e.g. --highlight cmc.gas='stiffer than given'. May be repeated.")
@click.option("--bond-graph", "bonds", is_flag=True, help="Draw the bond graph, with half arrows and causal strokes.")
@click.option("--colour", metavar="SIGNAL",
              help="Colour by a result of a run: `power`, a variable such as p, v, q or F, or one with its path.")
@click.option("--at", metavar="TIME", help="With --colour: at this time, e.g. --at '12 s'; without it over the whole run.")
@click.option("--over", type=click.Choice(("mean", "peak")), default="mean", show_default=True,
              help="With --colour: the statistic of the variable over time.")
@set_option
@native_option
@json_option
def draw(model: str, output: Path | None, opened: tuple[str, ...], open_all: bool, values: bool, marked: tuple[str, ...],
         bonds: bool, colour: str | None, at: str | None, over: str, settings: tuple[str, ...]) -> dict[str, object]:
    """Draw the diagram MODEL as an SVG, PNG or PDF picture.

    MODEL is a YAML file or the name of a bundled diagram (cmc_ahc, cmc_ahc/passive). Parts are placed by `at: [column,
    row]`, the others near the parts to which they are connected. Blocks are drawn as boxes unless they are opened.
    """
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.pictures import picture

    path = output or Path(f"{Path(model).stem}{'_bonds' if bonds else ''}.svg")
    check_writable(path, picture.SUFFIXES)
    picture.converter(path)  # the library is missing: an error before the run
    highlight = {}
    for text in marked:
        name, _, label = text.partition("=")
        highlight[name.strip()] = label.strip()
    if bonds and (colour or values or marked or opened):
        raise UsageError([Problem("bonds-alone", "a bond graph has no colours, values, marks or closed blocks", None,
                                  "Draw it with --bond-graph alone, and the other options in a second picture.")])
    if at is not None and not colour:
        raise UsageError([Problem("at-alone", "--at sets the time of the colours, but --colour is missing", None,
                                  "Add for example --colour power.")])
    with blamed_on_settings(settings):
        drawn = picture.draw(with_settings(load(model), settings), open=opened, open_all=open_all, values=values,
                             highlight=highlight, colour=colour, at=at, over=over, bond_graph=bonds)
    drawn.save(path)
    terminal.output().print(f"wrote {path}", soft_wrap=True)
    return {"files": [str(path)]}
