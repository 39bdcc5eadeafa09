"""`heavebond modes`: the modes of a diagram, linearised at its start, in its steady state or at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    at_options,
    blamed_on_settings,
    json_option,
    operating_time,
    set_option,
    with_settings,
)

if TYPE_CHECKING:
    from heavebond.linear.linearisation import Mode
    from heavebond.linear.modal_energy import ModalShares
    from heavebond.numerics.dae import Assembly
    from heavebond.numerics.start_equations import Point

LEAST = 0.05  # what takes part by less is not named
MOST = 4


@click.command(short_help="Frequencies and damping of the modes, and the components that take part.")
@click.argument("model")
@at_options
@set_option
@json_option
def modes(model: str, at: str | None, steady: bool, settings: tuple[str, ...]) -> dict[str, object]:
    """Linearise MODEL at its initial conditions and list its modes: frequency, damping, the components that take part (their
    share of the energy), and those that damp it. A mode in which no component stores energy is described by its states.

    A friction law is linearised at rest, where it locks its parts: --set its forces to 0 for the modes in motion, or
    linearise at an instant of the motion with --at.
    """
    from heavebond.commands import terminal
    from heavebond.core.presentation import count
    from heavebond.language.model import load
    from heavebond.linear.linearisation import Linearisation
    from heavebond.linear.modal_energy import energy_shares
    from heavebond.linear.operating_point import OperatingPoints, stuck

    with blamed_on_settings(settings), terminal.working("linearising"):
        operating = OperatingPoints(with_settings(load(model), settings), operating_time(at, steady))
        assembly, point = operating.assembly, operating.at()
        linear = Linearisation(assembly).at(point)
        found, judged = linear.modes(), linear.stability()
        shares = energy_shares(assembly, point, found)
    console = terminal.output()
    rows = [(_frequency(mode), *((f"{mode.damping:.4g}", f"{-mode.value.real:.4g} 1/s") if mode.value else ("", "")),
             _named(share.energy or mode.participation), _named(share.damping))
            for mode, share in zip(found, shares, strict=True)]
    console.print(terminal.table(f"{assembly.model.name} {operating.words}, {count(len(assembly.state_names), 'state')}",
                                 ("frequency", "damping", "decay", "energy in", "damping contribution"), rows, text=5))
    growing = len(judged.growing)
    if growing:
        console.print(f"{growing} modes grow" if growing > 1 else "1 mode grows",
                      f"{operating.words}: it is not stable there")
    elif not judged.stable:
        console.print(f"{judged.verdict} {operating.words}: {'; '.join(judged.reasons)}", soft_wrap=True)
    notes = stuck(assembly, point)
    for note in notes:
        console.print(note, style="yellow", soft_wrap=True)
    if shares and shares[0].left_out:
        console.print(f"not counted (described by mass and temperature): {', '.join(shares[0].left_out)}", soft_wrap=True)
    return {"model": assembly.model.name, "at": operating.words, "operating_point": _point_told(assembly, point),
            "stability": judged.verdict, "stuck": notes,
            "modes": [_told(mode, share) for mode, share in zip(found, shares, strict=True)]}


def _told(mode: Mode, share: ModalShares) -> dict[str, object]:
    return {"real": mode.value.real, "imaginary": mode.value.imag, "frequency": mode.frequency, "damping": mode.damping,
            "participation": mode.participation, "energy": share.energy, "damped_by": share.damping}


def _point_told(assembly: Assembly, point: Point) -> dict[str, object]:
    return {"time": point.t, **{name: {"value": float(value), "unit": assembly.flat.unknowns[j].unit.text + "/s" * order}
                                for name, value, (j, order) in zip(assembly.state_names, point.x, assembly.reduced.states,
                                                                   strict=True)}}


def _frequency(mode: Mode) -> str:
    if not mode.value:
        return "free"
    return f"{mode.frequency:.4g} Hz" if mode.swings else "non-oscillatory"


def _named(shares: dict[str, float]) -> str:
    named = [(name, share) for name, share in shares.items() if abs(share) >= LEAST][:MOST]
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in named)
