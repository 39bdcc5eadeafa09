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
    native_option,
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
              help="A signal, a force or flow into a node (crown.f), or a parameter. May be repeated.")
@click.option("--to", "outputs", metavar="OUTPUT[,...]", multiple=True,
              help="A variable, an output or a formula of these. May be repeated.")
@click.option("--loop", metavar="SIGNAL", help="Cut the loop at this signal and show its stability margins.")
@click.option("--over", metavar="PARAMETER='LOW .. HIGH'", help="Draw the root locus over a range of a parameter.")
@click.option("--picture", type=click.Choice(PICTURES), default="bode", show_default=True, help="What to draw.")
@at_options
@click.option("--frequencies", metavar="'LOW .. HIGH'", help="Range of the pictures, e.g. --frequencies '0.01 .. 10 Hz'.")
@click.option("--until", metavar="TIME", help="End time of the step response.")
@set_option
@picture_option("Where to draw")
@click.option("--save", "saved", metavar="FILE", type=click.Path(path_type=Path),
              help="Write the matrices with names and units (.npz or .mat).")
@native_option
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
    chosen, wanted = _channel_ends(listed(inputs), listed(outputs), loop, over)
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

        state_spaces = StateSpaces(diagram, chosen, wanted, when) if loop is None else loops(diagram, loop, when)
        system = state_spaces.at()
    judged = system.stability()
    decided = not judged.undecided
    figures: dict[str, object] = {"model": diagram.name, "at": state_spaces.points.words, "stable": judged.stable if decided
                                  else None,
                                  "stability": judged.verdict if decided else None, "reasons": list(judged.reasons)}
    console = terminal.output()
    every = f", {sampled_words(system.period)}" if system.period is not None else ""
    console.print(f"{diagram.name} {state_spaces.points.words}: {count(len(system.states), 'state')}{every}, "
                  f"{judged.verdict}"
                  f"{': ' if judged.reasons else ''}{'; '.join(judged.reasons)}", soft_wrap=True)
    figures["stuck"] = notes = stuck(state_spaces.points.assembly, state_spaces.points.at())
    figures["filled"] = state_spaces.filled or None
    for line in (*sampled_lines(system.sampled), *clock_lines(diagram.clocks.values() if system.sampled else ())):
        console.print(line, soft_wrap=True)
    for note in filter(None, (*held_lines(system.held), *notes, state_spaces.filled)):
        console.print(note, style="yellow", soft_wrap=True)
    if loop is not None:
        channels, span, crossings_found = _cut(system, frequencies)
        figures |= _crossings_told(crossings_found)
        _print_crossings(crossings_found)
    else:
        channels, crossings_found = [system.channel(o, i) for i in system.inputs for o in system.outputs], None
        span = _span(channels, frequencies)
        figures["channels"] = _print_channels(channels, span, within=frequencies is not None)
    files = _draw(diagram.name, state_spaces.points.words, channels, span, crossings_found, picture, until, output)
    if saved is not None:
        _save_matrices(channels[0] if loop else system, saved)
        files.append(saved)
    for path in files:
        console.print(f"wrote {path}", soft_wrap=True)
    return {**figures, **(channels[0] if loop else system).as_dict(), "files": [str(path) for path in files]}


def _channel_ends(inputs: list[str], outputs: list[str], loop: str | None, over: str | None) -> tuple[list[str], list[str]]:
    """The inputs and outputs that the options name; UsageError if the options exclude each other."""
    if (loop is not None and (inputs or outputs or over)) or (over is not None and (inputs or outputs)):
        raise UsageError([Problem("linear-asked", "--loop, --over and --from with --to exclude each other", None,
                                  "Give one of them.")])
    if loop is not None:
        return [loop], [loop]
    if over is None and not (inputs and outputs):
        raise UsageError([Problem("linear-asked", "no input and output are given", None,
                                  "Give --from INPUT --to OUTPUT, or --loop SIGNAL, or --over PARAMETER='LOW .. HIGH'.")])
    return inputs, outputs


# -- channels ----------------------------------------------------------------------------------------------------------
def _span(channels: Sequence[StateSpace], span_text: str | None) -> Array:
    """The frequencies in Hz of a picture: the requested ones, or those of all channels."""
    import numpy as np

    from heavebond.core.units import UnitProblem, parse_range

    if span_text is None:
        every = [channel.frequencies() for channel in channels]
        return np.unique(np.concatenate(every))
    try:
        frequency_range = parse_range(span_text)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"--frequencies: {problem.message}", None, problem.hint)]) from None
    if (frequency_range.unit.text != "Hz"
        and frequency_range.unit.counts != "cycles") or not 0 < frequency_range.low < frequency_range.high:
        raise UsageError([Problem("frequencies", f"--frequencies {span_text}: these are not two frequencies in Hz above 0",
                                  None,
                                  "Write for example --frequencies '0.01 .. 10 Hz'.")])
    from heavebond.linear.linear_system import spread

    high = min(frequency_range.high, channels[0].highest)
    if not frequency_range.low < high:
        raise UsageError([Problem("frequencies", f"--frequencies {span_text}: the response of a sampled system ends at its "
                                  f"Nyquist frequency, {high:g} Hz", None, "Give lower frequencies.")])
    ends = 2 * np.pi * np.array([10 * frequency_range.low, high / 10])
    return spread(-ends.astype(complex), channels[0].rates)


def _print_channels(channels: Sequence[StateSpace], span: Array, *, within: bool) -> list[dict[str, object]]:
    """Print a table of static gain, largest gain and zeros of each channel; return it for JSON. The largest gain is taken
    over all frequencies with 0, or over those of the span (`within`)."""
    import numpy as np

    from heavebond.commands import terminal
    from heavebond.core.presentation import number
    from heavebond.core.units import read_unit
    from heavebond.linear.linear_system import LINEAR_SYSTEM
    from heavebond.pictures.plot_linear import channel_name, ratio

    rows, entries = [], list[dict[str, object]]()
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
        # the zeros of a channel; None if it has too many states for a short computation
        zeros = None
        if len(channel.states) <= LINEAR_SYSTEM.zeros:
            zeros = [] if channel.higher[1].any() else [[z.real, z.imag] for z in channel.zeros()]
        entries.append({"from": channel.inputs[0], "to": channel.outputs[0], "unit": base.units[2][0],
                        "static_gain": None if integrators else static * scale, "integrators": integrators,
                        "peak_gain": gain * scale if np.isfinite(gain) else None, "peak_frequency": at,
                        "proper": channel.proper, "zeros": zeros})
    terminal.output().print(terminal.table("", ("channel", "unit", "DC gain", "largest gain", "at"), rows, text=2))
    return entries


# -- a loop ------------------------------------------------------------------------------------------------------------
def _cut(system: StateSpace, span_text: str | None) -> tuple[list[StateSpace], Array, Crossings]:
    from heavebond.linear.margins import crossings, loop_frequencies, open_loop

    cut = open_loop(system)
    cut_crossings = crossings(cut, system.stability())
    return [cut], loop_frequencies(cut, cut_crossings) if span_text is None else _span([cut], span_text), cut_crossings


def _print_crossings(crossings: Crossings) -> None:
    from heavebond.commands import terminal
    from heavebond.core.presentation import number, readable_time

    def row(name: str, margin: Margin | None, words: str, without: str = "infinite") -> tuple[str, str, str]:
        if margin is None:
            return name, without, ""
        at = "above all frequencies" if margin.frequency == float("inf") else f"{number(margin.frequency, 4)} Hz"
        return name, words, at

    up, down, phase, delay = crossings.gain_up, crossings.gain_down, crossings.least_phase, crossings.least_delay
    console = terminal.output()
    if crossings.unstable:
        console.print(f"The closed loop is unstable and has no margins: {'; '.join(crossings.reasons)}. "
                      "Crossings of -1 by the open loop:", style="yellow", soft_wrap=True)
    console.print(terminal.table("", ("crossing" if crossings.unstable else "margin", "", "at"), [
        row("gain, upwards", up, f"times {number(up.value, 4)}" if up else ""),
        row("gain, downwards", down, f"times {number(down.value, 4)}" if down else "", "to zero"),
        row("phase", phase, f"{number(phase.value, 4)} deg" if phase else ""),
        row("delay", delay, readable_time(delay.value)[0] if delay else ""),
        row("modulus (1/Ms)", crossings.modulus, number(crossings.modulus.value, 4))], text=1))


def _crossings_told(crossings: Crossings) -> dict[str, object]:
    """The margins for JSON; for an unstable loop its `crossings` instead of `margins`."""
    def one(margin: Margin | None) -> dict[str, float | None] | None:
        at = None if margin is None or margin.frequency == float("inf") else margin.frequency
        return None if margin is None else {"value": margin.value, "frequency": at}

    every = {"gain": [one(m) for m in crossings.gain], "phase_deg": [one(m) for m in crossings.phase],
             "delay_s": [one(m) for m in crossings.delay], "modulus": one(crossings.modulus),
             "gain_up": one(crossings.gain_up),
             "gain_down": one(crossings.gain_down), "least_phase_deg": one(crossings.least_phase),
             "least_delay_s": one(crossings.least_delay)}
    return {"margins": None, "crossings": every} if crossings.unstable else {"margins": every}


# -- a varied parameter ------------------------------------------------------------------------------------------------
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
    locus = root_locus(diagram, parameter, span, at=when)
    console = terminal.output()
    ends = [judged.verdict for judged in (locus.stability[0], locus.stability[-1])]
    console.print(f"{parameter} from {readable(locus.values[0], locus.unit)} ({ends[0]}) to "
                  f"{readable(locus.values[-1], locus.unit)} ({ends[1]})", soft_wrap=True)
    for limit in locus.limits:
        console.print(f"stability boundary at {readable(limit, locus.unit)}", soft_wrap=True)
    free = dict.fromkeys(e.text for judged in locus.stability for e in judged.free)
    if free:
        console.print(f"free, and no boundary: {'; '.join(free)}", soft_wrap=True)
    for note in filter(None, (*held_lines(locus.held), locus.filled)):
        console.print(note, style="yellow", soft_wrap=True)
    files = [output] if output is not None else []
    if output is not None:
        from heavebond.pictures.plot import save
        from heavebond.pictures.plot_linear import plot_root_locus

        save(plot_root_locus(locus, title=f"{diagram.name}: poles over {parameter}"), output)
        console.print(f"wrote {output}", soft_wrap=True)
    return {"model": diagram.name, "parameter": parameter, "unit": locus.unit, "values": locus.values.tolist(),
            "poles": [[[s.real, s.imag] for s in row] for row in locus.poles.tolist()],
            "T": None if locus.periods is None else locus.periods.tolist(), "limits": list(locus.limits),
            "stability": [None if judged.undecided else judged.verdict for judged in locus.stability], "free": list(free),
            "held": [h.as_dict() for h in locus.held],
            "filled": locus.filled or None, "files": [str(path) for path in files]}


# -- files -------------------------------------------------------------------------------------------------------------
def _draw(name: str, words: str, channels: Sequence[StateSpace], span: Array, crossings: Crossings | None, picture: str,
          until: str | None, output: Path | None) -> list[Path]:
    if output is None:
        return []
    from heavebond.linear.held_variables import with_held
    from heavebond.pictures import plot_linear
    from heavebond.pictures.plot import save

    title = f"{name} {words}" + (f", open loop at {channels[0].outputs[0]}" if crossings else "")
    if picture == "bode":
        figure: Figure = plot_linear.plot_bode(channels, span, title=title, margins=crossings)
    elif picture == "nyquist":
        figure = plot_linear.plot_nyquist(channels, span, title=title, margins=crossings)
    elif picture == "poles":
        zeros = {plot_linear.channel_name(c): c.zeros() for c in channels}
        figure = plot_linear.plot_poles(channels[0].poles, zeros, title=with_held(title, channels[0].held),
                                        period=channels[0].period)
    else:
        figure = plot_linear.plot_steps(channels, [_step_times(c, until) for c in channels], title=title)
    return [save(figure, output)]


def _step_times(channel: StateSpace, until: str | None) -> Array:
    """Times (N,) in s until a step has settled, or up to `until`."""
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
                with open(fresh, "wb") as file:  # NumPy would append a suffix in lower case to a path
                    np.savez(file, **held)
            else:
                from scipy.io import savemat

                savemat(str(fresh), held, appendmat=False)
    except OSError as error:
        raise UsageError([Problem("file-unwritable", f"'{path}' cannot be written: {error.strerror or error}")]) from None
