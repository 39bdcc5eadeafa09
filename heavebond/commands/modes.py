"""`heavebond modes`: the modes of a diagram, linearised at its start, in its steady state or at a time."""

from __future__ import annotations

import click

from heavebond.commands.arguments import (
    Whole,
    at_options,
    blamed_on_settings,
    json_option,
    native_option,
    operating_time,
    set_option,
    with_settings,
)


@click.command(short_help="Frequencies and damping of the modes, and the components that take part.")
@click.argument("model")
@at_options
@click.option("--slowest", metavar="COUNT", type=Whole(1),
              help="Number of the slowest modes to compute; 30 by default above 300 states.")
@set_option
@native_option
@json_option
def modes(model: str, at: str | None, steady: bool, slowest: int | None, settings: tuple[str, ...]) -> dict[str, object]:
    """Linearise MODEL at its initial conditions and list its modes: frequency, damping, the components that take part (their
    share of the energy), and those that damp it. A mode in which no component stores energy is described by its states.
    For a diagram with more than 300 states the slowest modes are listed, and growing modes that a search finds beyond
    them.

    A friction law is linearised at rest, where it locks its parts: --set its forces to 0 for the modes in motion, or
    linearise at an instant of the motion with --at. Loops with samples at regular times are discretised exactly; their
    modes have a pole z, and are described by their states. Quantisers and encoders count with a gain of 1. Variables that
    other events change (relays, friction that sticks) are held constant and listed; with a sampled relay in a loop there is
    no verdict on stability.
    """
    from heavebond.commands import terminal
    from heavebond.language.model import load
    from heavebond.linear import modes as linear_modes
    from heavebond.reports.analysis_tables import modes_items

    with blamed_on_settings(settings), terminal.working("linearising"):
        diagram = with_settings(load(model), settings)
        computed = linear_modes.modes(diagram, at=operating_time(at, steady), slowest=slowest)
    terminal.show(modes_items(computed))
    return computed.as_dict()
