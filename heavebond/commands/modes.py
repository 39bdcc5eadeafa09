"""`heavebond modes`: the modes of a diagram, linearised at its start."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import blamed_on_settings, json_option, set_option, with_settings

if TYPE_CHECKING:
    from heavebond.linearisation import Mode

LEAST = 0.05  # states that take part by less are not named
MOST = 4


@click.command(short_help="Frequencies and damping of a diagram, linearised at its start.")
@click.argument("model")
@set_option
@json_option
def modes(model: str, settings: tuple[str, ...]) -> dict[str, object]:
    """Linearise MODEL at its start, and list its modes: how fast, how damped, and which states take part.

    A friction law is linearised as it is at rest, where it holds everything: --set its forces to 0 for the modes in motion.
    """
    from heavebond import terminal
    from heavebond.dae import assemble
    from heavebond.linearisation import ModesAtStart
    from heavebond.model import load

    with blamed_on_settings(settings), terminal.working("assembling"):
        assembly = assemble(with_settings(load(model), settings))
        _, found = ModesAtStart(assembly).at({})
    console = terminal.output()
    rows = [(_frequency(mode), *((f"{mode.damping:.4g}", f"{-mode.value.real:.4g} 1/s") if mode.value else ("", "")),
             _taking_part(mode)) for mode in found]
    console.print(terminal.table(f"{assembly.model.name}, {len(assembly.state_names)} states",
                                 ("frequency", "damping", "decay", "states"), rows, text=4))
    growing = sum(mode.value.real > 0 for mode in found)
    if growing:
        console.print(f"{growing} modes grow" if growing > 1 else "1 mode grows", "at the start: it is not stable there")
    return {"model": assembly.model.name, "modes": [
        {"real": mode.value.real, "imaginary": mode.value.imag, "frequency": mode.frequency, "damping": mode.damping,
         "participation": mode.participation} for mode in found]}


def _frequency(mode: Mode) -> str:
    if not mode.value:
        return "free"
    return f"{mode.frequency:.4g} Hz" if mode.swings else "does not swing"


def _taking_part(mode: Mode) -> str:
    shares = [(name, share) for name, share in mode.participation.items() if share >= LEAST][:MOST]
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares)
