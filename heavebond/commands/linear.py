"""`heavebond linear`: the linearised diagram between an input and an output: plots, margins, matrices."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from heavebond.commands.arguments import (
    at_options,
    blamed_on_settings,
    check_picture,
    check_writable,
    json_option,
    listed,
    operating_time,
    picture_option,
    set_option,
    settings_of,
    with_settings,
)
from heavebond.core.errors import Problem, UsageError
from heavebond.core.writable import new_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from heavebond.language.model import Model
    from heavebond.linear.linear_system import StateSpace
    from heavebond.linear.margins import Crossings, Margin
    from heavebond.numerics.dae import Array

PICTURES = ("bode", "nyquist", "poles", "step")
MATRICES = (".npz", ".mat")


@click.command(short_help="Frequency response, poles and zeros, steps, root locus, margins of a loop.")
@click.argument("model")
@click.option("--from", "inputs", metavar="INPUT[,...]", multiple=True,
              help="A signal, what enters a node (crown.f), or a parameter. May be repeated.")
@click.option("--to", "outputs", metavar="OUTPUT[,...]", multiple=True,
              help="A variable, an output or a formula of these. May be repeated.")
@click.option("--loop", metavar="SIGNAL", help="Cut the loop at this signal and show its stability margins.")
@click.option("--over", metavar="PARAMETER='LOW .. HIGH'", help="Draw the root locus over a range of a parameter.")
@click.option("--picture", type=click.Choice(PICTURES), default="bode", show_default=True, help="What to draw.")
@at_options
@click.option("--frequencies", metavar="'LOW .. HIGH'", help="Of the pictures, e.g. --frequencies '0.01 .. 10 Hz'.")
@click.option("--until", metavar="TIME", help="End time of the step response.")
@set_option
@picture_option("Where to draw")
@click.option("--save", "saved", metavar="FILE", type=click.Path(path_type=Path),
              help="Write the matrices with names and units (.npz or .mat).")
@json_option
def linear(model: str, inputs: tuple[str, ...], outputs: tuple[str, ...], loop: str | None, over: str | None, picture: str,
           at: str | None, steady: bool, frequencies: str | None, until: str | None, settings: tuple[str, ...],
           output: Path | None, saved: Path | None) -> dict[str, object]:
    """Linearise the diagram MODEL between an input and an output, with exact derivatives.

    heavebond linear cmc_ahc --from heave --to crown.x --output bode.png

    heavebond linear cmc_ahc --loop command --picture nyquist --output nyquist.png

    heavebond linear cmc_ahc --over controller.K_p='0 .. 5 1/m' --output locus.png

    A friction law is linearised at rest, where it locks its parts: --set its forces to 0 for the machine in motion, or
    linearise at an instant of the motion with --at. With samples at regular times in a loop, or between input and output,
    the machine is discretised exactly, and the period T is stated. Quantisers and encoders count with a
    gain of 1. Variables that other events change (relays, friction that sticks) are held constant and listed; with a sampled
    relay in a loop there is no verdict on stability, and no margin.
    """
    from heavebond.commands import terminal
    from heavebond.language.model import load

    check_picture(output)
    if saved is not None:
        check_writable(saved, MATRICES)
    chosen, wanted = _asked(listed(inputs), listed(outputs), loop, over)
    with blamed_on_settings(settings), terminal.working("linearising"):
        diagram = with_settings(load(model), settings)
        when = operating_time(at, steady)
        if over is not None:
            return _locus(diagram, over, when, output)
        from heavebond.core.presentation import count
        from heavebond.linear.held_variables import clock_lines, held_lines, sampled_lines
        from heavebond.linear.linear_system import StateSpaces
        from heavebond.linear.margins import loops
        from heavebond.linear.operating_point import stuck
        from heavebond.linear.sampled import sampled_words

        made = StateSpaces(diagram, chosen, wanted, when) if loop is None else loops(diagram, loop, when)
        system = made.at()
    judged = system.stability()
    decided = not judged.undecided
    told: dict[str, object] = {"model": diagram.name, "at": made.points.words, "stable": judged.stable if decided else None,
                               "stability": judged.verdict if decided else None, "reasons": list(judged.reasons)}
    console = terminal.output()
    every = f", {sampled_words(system.period)}" if system.period is not None else ""
    console.print(f"{diagram.name} {made.points.words}: {count(len(system.states), 'state')}{every}, {judged.verdict}"
                  f"{': ' if judged.reasons else ''}{'; '.join(judged.reasons)}", soft_wrap=True)
    told["stuck"] = notes = stuck(made.points.assembly, made.points.at())
    told["filled"] = made.filled or None
    for line in (*sampled_lines(system.sampled), *clock_lines(diagram.clocks.values() if system.sampled else ())):
        console.print(line, soft_wrap=True)
    for note in filter(None, (*held_lines(system.held), *notes, made.filled)):
        console.print(note, style="yellow", soft_wrap=True)
    if loop is not None:
        channels, span, found = _cut(system, frequencies)
        told |= _crossings_told(found)
        _print_crossings(found)
    else:
        channels, found = [system.channel(o, i) for i in system.inputs for o in system.outputs], None
        span = _span(channels, frequencies)
        told["channels"] = _print_channels(channels, span, within=frequencies is not None)
    files = _draw(diagram.name, made.points.words, channels, span, found, picture, until, output)
    if saved is not None:
        _save_matrices(channels[0] if loop else system, saved)
        files.append(saved)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    return {**told, **(channels[0] if loop else system).as_dict(), "files": [str(path) for path in files]}


def _asked(inputs: list[str], outputs: list[str], loop: str | None, over: str | None) -> tuple[list[str], list[str]]:
    """The inputs and outputs to take; UsageError where what is asked for does not go together."""
    if (loop is not None and (inputs or outputs or over)) or (over is not None and (inputs or outputs)):
        raise UsageError([Problem("linear-asked", "--loop, --over and --from with --to each ask for something else", None,
                                  "Give one of them.")])
    if loop is not None:
        return [loop], [loop]
    if over is None and not (inputs and outputs):
        raise UsageError([Problem("linear-asked", "it is not said between what to look", None,
                                  "Give --from INPUT --to OUTPUT, or --loop SIGNAL, or --over PARAMETER='LOW .. HIGH'.")])
    return inputs, outputs


# -- channels ----------------------------------------------------------------------------------------------------------
def _span(channels: Sequence[StateSpace], asked: str | None) -> Array:
    """The frequencies in Hz of a picture: as asked for, or those of all channels."""
    import numpy as np

    from heavebond.core.units import UnitProblem, parse_range

    if asked is None:
        every = [channel.frequencies() for channel in channels]
        return np.unique(np.concatenate(every))
    try:
        found = parse_range(asked)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"--frequencies: {problem.message}", None, problem.hint)]) from None
    if (found.unit.text != "Hz" and found.unit.counts != "cycles") or not 0 < found.low < found.high:
        raise UsageError([Problem("frequencies", f"--frequencies {asked}: these are not two frequencies in Hz above 0", None,
                                  "Write for example --frequencies '0.01 .. 10 Hz'.")])
    from heavebond.linear.linear_system import spread

    high = min(found.high, channels[0].highest)
    if not found.low < high:
        raise UsageError([Problem("frequencies", f"--frequencies {asked}: the response of a sampled system ends at its "
                                  f"Nyquist frequency, {high:g} Hz", None, "Give lower frequencies.")])
    ends = 2 * np.pi * np.array([10 * found.low, high / 10])
    return spread(-ends.astype(complex), channels[0].rates)


def _print_channels(channels: Sequence[StateSpace], span: Array, *, within: bool) -> list[dict[str, object]]:
    """A table of static gain, largest gain and zeros of each channel; the same for machines. The largest gain is that of all
    frequencies with 0, or of those of the span (`within`)."""
    import numpy as np

    from heavebond.commands import terminal
    from heavebond.core.presentation import number
    from heavebond.core.units import read_unit
    from heavebond.pictures.plot_linear import channel_name, ratio

    rows, told = [], list[dict[str, object]]()
    for base in channels:
        channel, scale = base.displayed(), read_unit(base.shown[0]).scale
        gains = np.abs(channel.response(2j * np.pi * span)[:, 0, 0])
        static, integrators = float(channel.dc_gain()[0, 0]), channel.poles_at_zero()
        infinite = [f for f in channel.unbounded() if span[0] <= f <= span[-1]]
        gain, at = (np.inf, float(infinite[0])) if infinite else (
            float(gains.max()), float(span[int(np.argmax(gains))]))
        words = "infinite (undamped)" if infinite else number(gain, 4)
        if abs(static) > gain and not within:
            gain, at, words = abs(static), 0.0, "infinite (integrator)" if integrators else number(abs(static), 4)
        rows.append((channel_name(channel), ratio(channel), "infinite" if integrators else number(static, 4), words,
                     f"{number(at, 4)} Hz"))
        told.append({"from": channel.inputs[0], "to": channel.outputs[0], "unit": base.units[2][0],
                     "static_gain": None if integrators else static * scale, "integrators": integrators,
                     "peak_gain": gain * scale if np.isfinite(gain) else None, "peak_frequency": at,
                     "proper": channel.proper, "zeros": _zeros(channel)})
    terminal.output().print(terminal.table("", ("channel", "unit", "DC gain", "largest gain", "at"), rows, text=2))
    return told


def _zeros(channel: StateSpace) -> list[list[float]] | None:
    """The zeros of a channel; None where it has so many states that they would take long."""
    from heavebond.linear.linear_system import LINEAR_SYSTEM

    if len(channel.states) > LINEAR_SYSTEM.zeros:
        return None
    return [] if channel.higher[1].any() else [[z.real, z.imag] for z in channel.zeros()]


# -- a loop ------------------------------------------------------------------------------------------------------------
def _cut(system: StateSpace, asked: str | None) -> tuple[list[StateSpace], Array, Crossings]:
    from heavebond.linear.margins import crossings, loop_frequencies, open_loop

    cut = open_loop(system)
    found = crossings(cut, system.stability())
    return [cut], loop_frequencies(cut, found) if asked is None else _span([cut], asked), found


def _print_crossings(found: Crossings) -> None:
    from heavebond.commands import terminal
    from heavebond.core.presentation import number, readable_time

    def row(name: str, margin: Margin | None, words: str, without: str = "infinite") -> tuple[str, str, str]:
        if margin is None:
            return name, without, ""
        at = "above all frequencies" if margin.frequency == float("inf") else f"{number(margin.frequency, 4)} Hz"
        return name, words, at

    up, down, phase, delay = found.gain_up, found.gain_down, found.least_phase, found.least_delay
    console = terminal.output()
    if found.unstable:
        console.print(f"The closed loop is unstable and has no margins: {'; '.join(found.reasons)}. "
                      "Where the open loop crosses -1:", style="yellow", soft_wrap=True)
    console.print(terminal.table("", ("crossing" if found.unstable else "margin", "", "at"), [
        row("gain, upwards", up, f"times {number(up.value, 4)}" if up else ""),
        row("gain, downwards", down, f"times {number(down.value, 4)}" if down else "", "to zero"),
        row("phase", phase, f"{number(phase.value, 4)} deg" if phase else ""),
        row("delay", delay, readable_time(delay.value)[0] if delay else ""),
        row("modulus (1/Ms)", found.modulus, number(found.modulus.value, 4))], text=1))


def _crossings_told(found: Crossings) -> dict[str, object]:
    """The margins for machines; of an unstable loop as `crossings`, with no `margins`."""
    def one(margin: Margin | None) -> dict[str, float | None] | None:
        at = None if margin is None or margin.frequency == float("inf") else margin.frequency
        return None if margin is None else {"value": margin.value, "frequency": at}

    every = {"gain": [one(m) for m in found.gain], "phase_deg": [one(m) for m in found.phase],
             "delay_s": [one(m) for m in found.delay], "modulus": one(found.modulus), "gain_up": one(found.gain_up),
             "gain_down": one(found.gain_down), "least_phase_deg": one(found.least_phase),
             "least_delay_s": one(found.least_delay)}
    return {"margins": None, "crossings": every} if found.unstable else {"margins": every}


# -- a parameter that moves --------------------------------------------------------------------------------------------
def _locus(diagram: Model, over: str, when: str | None, output: Path | None) -> dict[str, object]:
    from heavebond.commands import terminal
    from heavebond.core.presentation import readable
    from heavebond.core.units import UnitProblem, parse_range
    from heavebond.linear.held_variables import held_lines
    from heavebond.linear.root_locus import root_locus

    (parameter, text), = settings_of("--over", [over]).items()
    try:
        span = parse_range(text)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"--over {over}: {problem.message}", None,
                                  problem.hint or "Write --over controller.K_p='0 .. 5 1/m'.")]) from None
    found = root_locus(diagram, parameter, span, at=when)
    console = terminal.output()
    ends = [judged.verdict for judged in (found.stability[0], found.stability[-1])]
    console.print(f"{parameter} from {readable(found.values[0], found.unit)} ({ends[0]}) to "
                  f"{readable(found.values[-1], found.unit)} ({ends[1]})", soft_wrap=True)
    for limit in found.limits:
        console.print(f"stability boundary at {readable(limit, found.unit)}", soft_wrap=True)
    free = dict.fromkeys(e.text for judged in found.stability for e in judged.free)
    if free:
        console.print(f"free, and no boundary: {'; '.join(free)}", soft_wrap=True)
    for note in filter(None, (*held_lines(found.held), found.filled)):
        console.print(note, style="yellow", soft_wrap=True)
    files = [output] if output is not None else []
    if output is not None:
        from heavebond.pictures.plot import save
        from heavebond.pictures.plot_linear import plot_root_locus

        save(plot_root_locus(found, title=f"{diagram.name}: poles over {parameter}"), output)
        console.print(f"wrote {output}", soft_wrap=True)
    return {"model": diagram.name, "parameter": parameter, "unit": found.unit, "values": found.values.tolist(),
            "poles": [[[s.real, s.imag] for s in row] for row in found.poles.tolist()],
            "T": None if found.periods is None else found.periods.tolist(), "limits": list(found.limits),
            "stability": [None if judged.undecided else judged.verdict for judged in found.stability], "free": list(free),
            "held": [h.as_dict() for h in found.held],
            "filled": found.filled or None, "files": [str(path) for path in files]}


# -- files -------------------------------------------------------------------------------------------------------------
def _draw(name: str, words: str, channels: Sequence[StateSpace], span: Array, found: Crossings | None, picture: str,
          until: str | None, output: Path | None) -> list[Path]:
    if output is None:
        return []
    from heavebond.linear.held_variables import with_held
    from heavebond.pictures import plot_linear
    from heavebond.pictures.plot import save

    title = f"{name} {words}" + (f", open loop at {channels[0].outputs[0]}" if found else "")
    if picture == "bode":
        figure: Figure = plot_linear.plot_bode(channels, span, title=title, margins=found)
    elif picture == "nyquist":
        figure = plot_linear.plot_nyquist(channels, span, title=title, margins=found)
    elif picture == "poles":
        zeros = {plot_linear.channel_name(c): c.zeros() for c in channels}
        figure = plot_linear.plot_poles(channels[0].poles, zeros, title=with_held(title, channels[0].held),
                                        period=channels[0].period)
    else:
        figure = plot_linear.plot_steps(channels, [_step_times(c, until) for c in channels], title=title)
    return [save(figure, output)]


def _step_times(channel: StateSpace, until: str | None) -> Array:
    """Times (N,) in s on which a step has settled, or as long as asked for."""
    import numpy as np

    from heavebond.numerics.output_times import seconds

    if until is not None and channel.period is not None:
        return np.asarray(channel.period * np.arange(int(seconds(until, "--until") / channel.period) + 1), dtype=float)
    if until is not None:
        return np.linspace(0, seconds(until, "--until"), 1001)
    visible = channel.visible()
    if channel.period is not None:
        end = 5 / max(float(np.abs(visible.real).min(initial=np.inf)), 1e-3 / channel.period)
        number = min(max(int(np.ceil(end / channel.period)), 5), 2000)
        return np.asarray(channel.period * np.arange(number + 1), dtype=float)
    slowest = float(np.abs(visible.real).min()) if len(visible) else 1.0
    longest = 40 * 2 * np.pi / float(np.abs(visible).min()) if len(visible) else 5.0
    return np.linspace(0, min(5 / slowest if slowest > 0 else np.inf, longest), 2001)


def _save_matrices(system: StateSpace, path: Path) -> None:
    import numpy as np

    states, inputs, outputs = system.units
    held = {"A": system.a, "B": system.b, "C": system.c, "D": system.d, "D1": system.higher[0], "D2": system.higher[1],
            "T": np.array(system.period or 0.0),  # 0 if continuous, as MATLAB's Ts
            **{name: np.array(list(words)) for name, words in (
                ("states", system.states), ("inputs", system.inputs), ("outputs", system.outputs), ("state_units", states),
                ("input_units", inputs), ("output_units", outputs), ("held", [h.text for h in system.held]))}}
    try:
        with new_file(path) as fresh:
            if path.suffix.lower() == ".npz":
                with open(fresh, "wb") as file:  # to a path NumPy would append a suffix in lower case
                    np.savez(file, **held)
            else:
                from scipy.io import savemat

                savemat(str(fresh), held, appendmat=False)
    except OSError as error:
        raise UsageError([Problem("file-unwritable", f"'{path}' cannot be written: {error.strerror or error}")]) from None
