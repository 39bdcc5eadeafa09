"""`heavebond modes`: the modes of a diagram, linearised at its start, in its steady state or at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    Whole,
    at_options,
    blamed_on_settings,
    json_option,
    operating_time,
    set_option,
    with_settings,
)

if TYPE_CHECKING:
    from heavebond.linear.held_variables import HeldVariable
    from heavebond.linear.linearisation import Linear, Mode
    from heavebond.linear.modal_energy import ModalShares
    from heavebond.linear.slow_modes import SlowModes
    from heavebond.numerics.dae import Assembly
    from heavebond.numerics.start_equations import Point

LEAST = 0.05  # what takes part by less is not named
MOST = 4


@click.command(short_help="Frequencies and damping of the modes, and the components that take part.")
@click.argument("model")
@at_options
@click.option("--slowest", metavar="COUNT", type=Whole(1),
              help="Compute so many modes, the slowest; of more than 300 states 30 by default.")
@set_option
@json_option
def modes(model: str, at: str | None, steady: bool, slowest: int | None, settings: tuple[str, ...]) -> dict[str, object]:
    """Linearise MODEL at its initial conditions and list its modes: frequency, damping, the components that take part (their
    share of the energy), and those that damp it. A mode in which no component stores energy is described by its states.

    Of a diagram with more than 300 states the slowest modes are listed, and growing ones that a search finds beyond them.

    A friction law is linearised at rest, where it locks its parts: --set its forces to 0 for the modes in motion, or
    linearise at an instant of the motion with --at. Loops with samples at regular times are discretised exactly; their modes
    have a pole z, and are described by their states. Quantisers and encoders count
    with a gain of 1. Variables that other events change (relays, friction that sticks) are held constant and listed; with a
    sampled relay in a loop there is no verdict on stability.
    """
    from heavebond.commands import terminal
    from heavebond.core.presentation import count
    from heavebond.language.model import load
    from heavebond.linear.held_variables import clock_lines, held_lines, sampled_lines
    from heavebond.linear.modal_energy import energy_shares
    from heavebond.linear.operating_point import OperatingPoints, stuck
    from heavebond.linear.sampled import sampled_words

    with blamed_on_settings(settings), terminal.working("linearising"):
        operating = OperatingPoints(with_settings(load(model), settings), operating_time(at, steady))
        assembly, point = operating.assembly, operating.at()
        found, judged, words, held, linear = _modes(assembly, point, slowest, operating.words)
        shares = energy_shares(assembly, point, found)
    console = terminal.output()
    period, sampled = (linear.period, linear.sampled) if linear is not None else (None, ())
    first = [(_frequency(mode), *((f"{mode.damping:.4g}", f"{-mode.value.real:.4g} 1/s") if mode.value else ("", "")))
             for mode in found]
    states = found[0].states if period is not None and found else assembly.state_names
    title = f"{assembly.model.name} {operating.words}, {count(len(states), 'state')}"
    if period is None:
        rows = [(*begin, _named(share.energy or mode.participation), _named(share.damping))
                for begin, mode, share in zip(first, found, shares, strict=True)]
        console.print(terminal.table(title, ("frequency", "damping", "decay", "energy in", "damping contribution"), rows,
                                     text=5))
    else:
        rows = [(*begin, _pole(mode), _named(mode.participation)) for begin, mode in zip(first, found, strict=True)]
        title = f"{title}, {sampled_words(period)}"
        console.print(terminal.table(title, ("frequency", "damping", "decay", "z", "states"), rows, text=5))
    for line in (*words, *sampled_lines(sampled), *clock_lines(assembly.model.clocks.values() if sampled else ())):
        console.print(line, soft_wrap=True)
    notes = stuck(assembly, point)
    for note in filter(None, (*held_lines(held), *notes, operating.filled)):
        console.print(note, style="yellow", soft_wrap=True)
    if shares and shares[0].left_out:
        console.print(f"not counted (described by mass and temperature): {', '.join(shares[0].left_out)}", soft_wrap=True)
    return {"model": assembly.model.name, "at": operating.words, "operating_point": _point_told(assembly, point),
            "stability": judged, "T": period, "sampled": [h.as_dict() for h in sampled],
            "held": [h.as_dict() for h in held], "stuck": notes, "filled": operating.filled or None,
            "modes": [_told(mode, share) for mode, share in zip(found, shares, strict=True)]}


def _modes(assembly: Assembly, point: Point, slowest: int | None, at: str
           ) -> tuple[list[Mode], str | None, list[str], tuple[HeldVariable, ...], Linear | None]:
    """The modes to list, the verdict on stability (None if it is not decided), the sentences on it, the variables that are
    held constant, and the linear system if all modes are listed."""
    from heavebond.linear.held_variables import undecided_reasons
    from heavebond.linear.linearisation import Linearisation
    from heavebond.linear.slow_modes import SLOW_MODES, slow_modes
    from heavebond.linear.stability import UNDECIDED, UNSTABLE
    from heavebond.numerics.output_times import grid

    linearisation, model = Linearisation(assembly), assembly.model
    if slowest is None and len(assembly.state_names) <= SLOW_MODES.max_all:
        linear = linearisation.at(point)
        judged = linear.stability()
        if judged.undecided:
            return linear.modes(), None, [f"{UNDECIDED} {at}: {'; '.join(judged.reasons)}"], linear.held, linear
        told = [] if judged.growing or judged.stable else [f"{judged.verdict} {at}: {'; '.join(judged.reasons)}"]
        told += [f"stable {at}"] if judged.stable and linear.period is not None else []
        return linear.modes(), judged.verdict, _growth(len(judged.growing), at) + told, linear.held, linear
    times = grid(model, None, None) if model.until is not None else [0.0, 1.0]
    found = slow_modes(linearisation, point, float(times[-1] - times[0]), slowest or SLOW_MODES.count)
    held = linearisation.held(point)
    if reasons := undecided_reasons(held):
        return found.modes, None, [f"{UNDECIDED} {at}: {'; '.join(reasons)}", *_not_computed(found)], held, None
    return found.modes, UNSTABLE if found.unstable else None, _growth(found.unstable, at) + _not_computed(found), held, None


def _growth(growing: int, at: str) -> list[str]:
    return [f"{growing} modes grow {at}: it is not stable there" if growing > 1 else
            f"1 mode grows {at}: it is not stable there"] if growing else []


def _not_computed(found: SlowModes) -> list[str]:
    """Which modes were computed, and what is therefore not known."""
    from heavebond.core.presentation import number

    low, high = (number(rate, 3) for rate in found.searched)
    result = f", and {len(found.growing)} found" if found.growing else ", and none was found"
    return [f"Computed: the {found.computed} slowest eigenvalues of {found.states} (a line is a pair, where it oscillates), "
            f"those with |s| up to {number(found.reach, 4)} 1/s. Of hundreds that are nearly equal, as of equal pieces "
            "damped alike, only some are listed.",
            f"Growing modes beyond these were looked for at rates from {low} to {high} 1/s{result}. This is no proof that "
            "there is no other: one that grows by a small share of its frequency, beside many undamped ones, can be missed."]


def _told(mode: Mode, share: ModalShares) -> dict[str, object]:
    pole = {} if mode.z is None else {"z": [mode.z.real, mode.z.imag]}
    return {"real": mode.value.real, "imaginary": mode.value.imag, **pole, "frequency": mode.frequency,
            "damping": mode.damping if mode.value else None, "participation": mode.participation, "energy": share.energy,
            "damped_by": share.damping}


def _point_told(assembly: Assembly, point: Point) -> dict[str, object]:
    return {"time": point.t, **{name: {"value": float(value), "unit": assembly.flat.unknowns[j].unit.text + "/s" * order}
                                for name, value, (j, order) in zip(assembly.state_names, point.x, assembly.reduced.states,
                                                                   strict=True)}}


def _frequency(mode: Mode) -> str:
    if not mode.value:
        return "free"
    return f"{mode.frequency:.4g} Hz" if mode.swings else "non-oscillatory"


def _pole(mode: Mode) -> str:
    """`0.9973 ± 0.06718j`."""
    z = mode.z or 0j
    return f"{z.real:.4g} ± {z.imag:.4g}j" if z.imag else f"{z.real:.4g}"


def _named(shares: dict[str, float]) -> str:
    """The largest shares; where each is small, those of the blocks of the diagram."""
    named = _large(shares)
    if not named and shares:
        blocks: dict[str, float] = {}
        for name, share in shares.items():
            blocks[name.partition(".")[0]] = blocks.get(name.partition(".")[0], 0.0) + share
        named = _large(dict(sorted(blocks.items(), key=lambda item: -abs(item[1]))))
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in named)


def _large(shares: dict[str, float]) -> list[tuple[str, float]]:
    return [(name, share) for name, share in shares.items() if abs(share) >= LEAST][:MOST]
