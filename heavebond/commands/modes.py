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
    from heavebond.linear.modal_values import ModalShares
    from heavebond.linear.slow_modes import SlowModes
    from heavebond.numerics.dae import Assembly
    from heavebond.numerics.start_equations import Point

LEAST = 0.05  # smaller shares are not listed
MOST = 4


@click.command(short_help="Frequencies and damping of the modes, and the components that take part.")
@click.argument("model")
@at_options
@click.option("--slowest", metavar="COUNT", type=Whole(1),
              help="Number of the slowest modes to compute; 30 by default above 300 states.")
@set_option
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
    from heavebond.core.presentation import count
    from heavebond.language.model import load
    from heavebond.linear.held_variables import clock_lines, held_lines, sampled_lines
    from heavebond.linear.modal_values import energy_shares
    from heavebond.linear.operating_point import OperatingPoints, stuck
    from heavebond.linear.sampled import sampled_words

    with blamed_on_settings(settings), terminal.working("linearising"):
        operating = OperatingPoints(with_settings(load(model), settings), operating_time(at, steady))
        assembly, point = operating.assembly, operating.at()
        listed_modes, judged, words, held, linear = _modes(assembly, point, slowest, operating.words)
        shares = energy_shares(assembly, point, listed_modes)
    console = terminal.output()
    period, sampled = (linear.period, linear.sampled) if linear is not None else (None, ())
    first = [(_frequency(mode), *((f"{mode.damping:.4g}", f"{-mode.value.real:.4g} 1/s") if mode.value else ("", "")))
             for mode in listed_modes]
    states = listed_modes[0].states if period is not None and listed_modes else assembly.state_names
    title = f"{assembly.model.name} {operating.words}, {count(len(states), 'state')}"
    if period is None:
        rows = [(*begin, _named(share.energy or mode.participation), _named(share.damping))
                for begin, mode, share in zip(first, listed_modes, shares, strict=True)]
        console.print(terminal.table(title, ("frequency", "damping", "decay", "energy in", "damping contribution"), rows,
                                     text=5))
    else:
        rows = [(*begin, _pole(mode), _named(mode.participation)) for begin, mode in zip(first, listed_modes, strict=True)]
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
            "modes": [_told(mode, share) for mode, share in zip(listed_modes, shares, strict=True)]}


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
        sentences = [] if judged.growing or judged.stable else [f"{judged.verdict} {at}: {'; '.join(judged.reasons)}"]
        sentences += [f"stable {at}"] if judged.stable and linear.period is not None else []
        return linear.modes(), judged.verdict, _growth(len(judged.growing), at) + sentences, linear.held, linear
    times = grid(model, None, None) if model.until is not None else [0.0, 1.0]
    slow = slow_modes(linearisation, point, float(times[-1] - times[0]), slowest or SLOW_MODES.count)
    held = linearisation.held(point)
    if reasons := undecided_reasons(held):
        return slow.modes, None, [f"{UNDECIDED} {at}: {'; '.join(reasons)}", *_not_computed(slow)], held, None
    return slow.modes, UNSTABLE if slow.unstable else None, _growth(slow.unstable, at) + _not_computed(slow), held, None


def _growth(growing: int, at: str) -> list[str]:
    return [f"{growing} modes grow {at}: it is not stable there" if growing > 1 else
            f"1 mode grows {at}: it is not stable there"] if growing else []


def _not_computed(slow: SlowModes) -> list[str]:
    """State which modes were computed, and the limits of this result."""
    from heavebond.core.presentation import number

    low, high = (number(rate, 3) for rate in slow.searched)
    result = f", and {len(slow.growing)} found" if slow.growing else ", and none was found"
    return [f"Computed: the {slow.computed} slowest eigenvalues of {slow.states} (one line for each pair of complex "
            f"eigenvalues), "
            f"those with |s| up to {number(slow.reach, 4)} 1/s. Of hundreds of nearly equal eigenvalues, for example of "
            f"equal pieces with equal damping, only some are listed.",
            f"Growing modes beyond these were looked for at rates from {low} to {high} 1/s{result}. This does not exclude "
            f"others: the search can miss a mode that grows slowly compared with its frequency among many undamped modes."]


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
    """The largest shares; if each is small, the shares of the blocks of the diagram."""
    named = _large(shares)
    if not named and shares:
        blocks: dict[str, float] = {}
        for name, share in shares.items():
            blocks[name.partition(".")[0]] = blocks.get(name.partition(".")[0], 0.0) + share
        named = _large(dict(sorted(blocks.items(), key=lambda item: -abs(item[1]))))
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in named)


def _large(shares: dict[str, float]) -> list[tuple[str, float]]:
    return [(name, share) for name, share in shares.items() if abs(share) >= LEAST][:MOST]
