"""`heavebond check`: read, assemble and start a diagram; say what became of it, or all that is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import blamed_on_settings, json_option, set_option, with_settings

if TYPE_CHECKING:
    from heavebond.numbers.dae import Assembly
    from heavebond.numbers.initialise import Start
    from heavebond.numbers.start_equations import Point


@click.command(short_help="Check a diagram; tell its states, loops, index and start.")
@click.argument("model")
@click.option("--names", "listed", is_flag=True, help="List every variable and parameter by its name.")
@set_option
@json_option
def check(model: str, listed: bool, settings: tuple[str, ...]) -> dict[str, object]:
    """Check the diagram MODEL: what it contains, its states, loops and index, where its start comes from.

    MODEL is a YAML file or the name of a bundled diagram (cmc_ahc, cmc_ahc/passive).
    """
    from heavebond.basis.errors import StartError
    from heavebond.commands.terminal import output, working
    from heavebond.language.model import load
    from heavebond.numbers.dae import assemble
    from heavebond.numbers.findings import tell
    from heavebond.numbers.validity import at_point
    from heavebond.reports.summary import summary

    with blamed_on_settings(settings):
        with working("assembling"):
            assembly = assemble(with_settings(load(model), settings))
        failure, begun, first = None, None, None
        try:
            begun, first = _start(assembly)
        except StartError as error:  # the structure is worth seeing all the same
            failure = error
        found = summary(assembly, begun)
        console = output()
        for line in found.text(console.width).splitlines():
            console.print(line, style="bold" if line[:1].strip() else None, soft_wrap=True)
        if listed:
            console.print()
            console.print(_names(assembly))
        if failure:
            console.print()
            raise failure
        if first is not None:
            tell(assembly.model.name, at_point(assembly, first))
    return found.as_dict()


def _names(assembly: Assembly) -> object:
    """Variables, then parameters with their values: what formulas, --plot and --set understand."""
    from heavebond.basis.presentation import readable
    from heavebond.commands.terminal import table

    flat = assembly.flat
    rows = [(name, flat.unknowns[j].unit.text, "", flat.unknowns[j].doc) for name, j in flat.names.items()]
    rows += [(h.name, h.unit.text, "", h.doc) for h in flat.held]
    rows += [(q.name, q.unit.text, readable(q.value, q.unit.text), "") for q in flat.parameters]
    return table("Names", ("name", "unit", "value", "what"), rows, text=4)


def _start(assembly: Assembly) -> tuple[Start, Point]:
    """The start, and the same as a point with the inputs there."""
    import numpy as np

    from heavebond.numbers.initialise import start
    from heavebond.numbers.inputs import pieced
    from heavebond.numbers.simulation import grid
    from heavebond.studies.linearisation import start_point

    if not assembly.flat.inputs:
        begun = start(assembly)
        return begun, start_point(begun, np.zeros(0))
    # a record must cover the whole run, which is said here and not first by `run`
    times = grid(assembly.model, None, None)
    u = pieced(assembly.flat, 0.0, float(times[-1])).at(np.zeros(1))[:, 0]
    begun = start(assembly, 0.0, u)
    return begun, start_point(begun, u)
