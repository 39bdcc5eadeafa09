"""Design of loops on the linearised diagram: gains, compensators and filters.

Gains. A loop that is cut at a signal is linear in the gains k of its controller, L = sum k_i L_i, where L_i is the loop with
the gain i alone. The crossover w_c and the phase margin are prescribed: L(j w_c) = exp(j (phase margin - pi)). These are two
equations for a proportional gain with an integral or a derivative gain. With all three, the integral part at w_c is a tenth
of the proportional part, T_i = 10/w_c. The loops L_i contain the samples, holds and delays of the diagram. The design
therefore needs no approximation by a continuous controller.

K. J. Astrom, T. Haegglund, Advanced PID Control, ISA 2006, chapter 7 (loop shaping); K. J. Astrom, R. M. Murray, Feedback
Systems, 2nd ed., Princeton 2021, chapter 12 (loop shaping).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from heavebond.core.errors import Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief, count
from heavebond.core.quantities import number_or_text, si_value
from heavebond.core.units import UnitProblem, check_unit, parse_quantity, unit
from heavebond.language.model import Model, ModelOrFile, loaded
from heavebond.linear.linear_system import StateSpace, StateSpaces
from heavebond.linear.margins import Crossings, crossings, loops, open_loop
from heavebond.linear.stability import Stability
from heavebond.numerics.dae import Array
from heavebond.numerics.output_times import Time
from heavebond.numerics.result import signal_expression
from heavebond.numerics.start_equations import Point

HALF_POWER = 0.5**0.5  # of |L/(1 + L)| at the bandwidth
FILTERS = ("butterworth", "bessel", "chebyshev 1", "chebyshev 2")
BANDS = ("lowpass", "highpass", "bandpass", "bandstop")
LEAD, LAG = np.radians(75.0), np.radians(50.0)  # largest changes of the phase by a LeadLag (T_2/T_1 = 1/58 and 10)
ROUNDS = 20  # largest number of corrections of a compensator between samplers


@dataclass(frozen=True)
class DesignConstants:
    """The constants of a design.

    integral: share of the proportional part that the integral part has at the crossover, if all three gains are free.
        Origin: T_i = 10/w_c costs 6 degrees of phase (Astrom, Haegglund, section 7.3). Doubled: faster integral action, 6
        degrees more for the derivative part to make up.
    linear: relative difference between the loop with the designed gains and the sum of the loops of single gains, at the
        crossover, above which the loop is not linear in the gains. Origin: rounding of margins. Doubled: nothing.
    bandwidth: tolerance of the bandwidth, relative. Origin: three digits. Doubled: nothing.
    rounding: difference between the response of a filter by its coefficients and by its poles and zeros, above which the
        coefficients are refused. Origin: the width of a line in a Bode plot. Doubled: nothing; an order more multiplies the
        difference by 10 to 1000.
    """

    integral: float = 0.1
    linear: float = 1e-6
    bandwidth: float = 1e-4
    rounding: float = 1e-3


DESIGN = DesignConstants()


@dataclass(frozen=True)
class LoopDesign:
    """Designed `values` of parameters in SI, with the `crossings` of the loop (margins if it is stable) at the operating
    point of the design, and at further `points` by name. `crossover` and `bandwidth` (|L/(1 + L)| = 1/sqrt(2)) are in Hz,
    `phase_margin` in degrees; the bandwidth is nan if the closed loop does not fall below that level."""

    signal: str
    values: Mapping[str, float]
    crossings: Crossings
    crossover: float
    phase_margin: float
    bandwidth: float
    points: Mapping[str, Crossings]

    def __repr__(self) -> str:
        return brief(self, self.signal, ", ".join(f"{name} {value:.6g}" for name, value in self.values.items()),
                     repr(self.crossings))


def design_gains(model: ModelOrFile, signal: str, free: Sequence[str], *, crossover: float | str | None = None,
                 bandwidth: float | str | None = None, phase_margin: float | str | None = None, at: Time | None = None,
                 points: Mapping[str, Mapping[str, float | str]] | None = None) -> LoopDesign:
    """Gains of a loop from its crossover, or the bandwidth of the closed loop, and its phase margin.

    `signal` is the one at which the loop is cut. `free` are one to three gains in the order proportional, integral or
    derivative; or proportional, integral, derivative.
    The crossover alone determines one gain. Frequencies are in Hz or text (`"2 Hz"`), `phase_margin` is in degrees or
    text. `at` is the operating point of `loop_margins`, with the gains of the diagram. The margins are also computed for
    the `points`, which are values of parameters by name. Raises UsageError if the loop is not linear in the gains, or if no
    gains reach the values.
    """
    return _gains_of(loaded(model), signal, {name: [name] for name in free}, crossover, bandwidth, phase_margin, at, points)


def _gains_of(diagram: Model, signal: str, tied: Mapping[str, Sequence[str]], crossover: float | str | None,
              bandwidth: float | str | None, phase_margin: float | str | None, at: Time | None,
              points: Mapping[str, Mapping[str, float | str]] | None) -> LoopDesign:
    """The design of gains; `tied` maps the name of each gain to the parameters with its value."""
    names = list(tied)
    _check_gains(names, crossover, bandwidth, phase_margin)
    margin = None if phase_margin is None else _margin(phase_margin)
    state_spaces = loops(diagram, signal, at)
    known = state_spaces.points.assembly.parameter_values
    state_spaces.points.assembly.parameter_indices([parameter for each in tied.values() for parameter in each])
    sizes = [known[each[0]] or 1.0 for each in tied.values()]
    point = state_spaces.points.at()
    singles = [_single(state_spaces, point, tied, name, size) for name, size in zip(names, sizes, strict=True)]

    def gains_at(frequency: float) -> Array:
        parts = [loop.response(2j * np.pi * frequency)[0, 0, 0] / size for loop, size in zip(singles, sizes, strict=True)]
        return _gains(parts, margin, names, frequency)

    subject, frequency = _prescribed(crossover, bandwidth, singles[0].highest)
    if subject == "bandwidth":
        band = [loop.response(2j * np.pi * frequency)[0, 0, 0] / size for loop, size in zip(singles, sizes, strict=True)]
        frequency = _crossover_for(frequency, lambda crossover: complex(np.dot(gains_at(crossover), band)))
    gains = gains_at(frequency)
    values = {parameter: gain for each, gain in zip(tied.values(), gains.tolist(), strict=True) for parameter in each}
    closed = state_spaces.at(values, point)
    loop = open_loop(closed)
    expected = sum(gain * single.response(2j * np.pi * frequency)[0, 0, 0] / size
                   for gain, single, size in zip(gains, singles, sizes, strict=True))
    value = loop.response(2j * np.pi * frequency)[0, 0, 0]
    if not abs(value - expected) <= DESIGN.linear * max(abs(value), 1.0):
        raise UsageError([Problem("design-not-linear", f"the loop through '{signal}' is not a linear function of "
                                  f"{listing(names)}", None, "Name the gains of one controller in this loop; other "
                                  "parameters are tuned by `heavebond tune`. If a command is at its limit, take an "
                                  "operating point within the limits (initial values, or --at).")])
    return _designed(diagram, signal, values, loop, closed.stability(), frequency, at, points)


def _single(state_spaces: StateSpaces, point: Point, tied: Mapping[str, Sequence[str]], name: str, size: float
            ) -> StateSpace:
    """The open loop with one of the free gains, the others 0, at the operating point of the diagram."""
    names = list(tied)
    try:
        return open_loop(state_spaces.at({parameter: size if gain == name else 0.0
                                          for gain, each in tied.items() for parameter in each}, point))
    except UsageError as error:
        if error.problems[0].code != "loop-none" or len(names) == 1:
            raise
        zero_gains = listing([gain for gain in names if gain != name])
        raise UsageError([Problem("loop-none", f"with {name} alone, and {zero_gains} = 0, the loop is open: a signal added "
                                  "at the cut does not return", error.problems[0].place, "Free gains that are added to each "
                                  "other, such as control.K_p and control.K_i of one controller in this loop; not gains in "
                                  "series.", error.problems[0].notes)]) from None


def loop_at(model: Model, signal: str, settings: Mapping[str, float | str], at: Time | None = None) -> Crossings:
    """The crossings of the loop through a signal, with values of parameters."""
    closed = loops(model.with_parameters(dict(settings)), signal, at).at()
    return crossings(open_loop(closed), closed.stability())


def _check_gains(names: Sequence[str], crossover: object, bandwidth: object, phase_margin: object) -> None:
    if not 1 <= len(names) <= 3:
        raise UsageError([Problem("design-free", f"{count(len(names), 'gain')} {'is' if len(names) == 1 else 'are'} free; "
                                  "one to three are needed", None, "Name proportional, integral and derivative gain, or one "
                                  "or two of these, e.g. --free control.K_p,control.K_i.")])
    if (crossover is None) == (bandwidth is None):
        raise UsageError([Problem("design-frequency", "a design needs either a crossover or a bandwidth", None,
                                  "Give for example --crossover '0.5 Hz' (in Python crossover='0.5 Hz').")])
    if (phase_margin is None) != (len(names) == 1):
        raise UsageError([Problem("design-margin", "one gain cannot meet a crossover and a phase margin" if len(names) == 1
                                  else "two or three gains need a phase margin", None,
                                  "Free a second gain, or leave out the phase margin." if len(names) == 1 else
                                  "Give for example --phase-margin '60 deg' (in Python phase_margin='60 deg').")])


def _number(value: float | str, base: str, subject: str, *, degrees: bool = False) -> float:
    """A plain number, or text with a unit, in Hz or degrees."""
    read = number_or_text(value, base, subject)
    if not isinstance(read, str):
        return float(read)
    try:
        number, written = parse_quantity(read)
        check_unit(written, unit("deg" if degrees else "Hz"), number, read)
    except UnitProblem as problem:
        raise UsageError([Problem(problem.code, f"{subject}: {problem.message}", None, problem.hint)]) from None
    return float(np.degrees(number)) if degrees else number


def _margin(phase_margin: float | str) -> float:
    """A phase margin in rad; UsageError outside 0 to 180 degrees."""
    margin = float(np.radians(_number(phase_margin, "deg", "phase_margin", degrees=True)))
    if not 0 < margin < np.pi:
        raise UsageError([Problem("design-margin", f"the phase margin is {np.degrees(margin):.4g} deg: it must be above 0 "
                                  "and below 180 deg", None, "Give for example --phase-margin '60 deg'.")])
    return margin


def _prescribed(crossover: float | str | None, bandwidth: float | str | None, highest: float) -> tuple[str, float]:
    """The one of crossover and bandwidth that is given, and its frequency in Hz; UsageError if it is not below `highest`."""
    subject, text = ("crossover", crossover) if crossover is not None else ("bandwidth", bandwidth)
    assert text is not None
    frequency = _number(text, "Hz", subject)
    if not 0 < frequency < highest:
        sampled = f"half the sampling rate of the loop, {highest:.4g} Hz" if highest < np.inf else "infinity"
        raise UsageError([Problem("design-frequency", f"the {subject} is {frequency:.4g} Hz: it must be above 0 and below "
                                  f"{sampled}", None, f"Give another --{subject}, for example '"
                                  f"{min(0.5, highest / 10):.2g} Hz'.")])
    return subject, frequency


def _gains(parts: Sequence[complex], margin: float | None, names: Sequence[str], frequency: float) -> Array:
    """The gains with L(j w) = exp(j (margin - pi)), or |L(j w)| = 1, from the loops of unit gains at a frequency."""
    if min(map(abs, parts)) < 1e-300 or not np.isfinite(parts).all():
        raise UsageError([Problem("design-no-gain", f"a gain among {listing(names)} has no effect on the loop at "
                                  f"{frequency:.4g} Hz", None, "Name gains of the controller in this loop.")])
    if margin is None:
        return np.array([1 / abs(parts[0])])
    target = np.exp(1j * (margin - np.pi))
    if len(parts) == 3:
        share = DESIGN.integral * abs(parts[0]) / abs(parts[1])
        columns = [parts[0] + share * parts[1], parts[2]]
    else:
        share, columns = 0.0, list(parts)
    matrix = np.array([[c.real for c in columns], [c.imag for c in columns]])
    if abs(np.linalg.det(matrix / np.abs(matrix).max(axis=0))) < 1e-9:
        raise UsageError([Problem("design-same-phase", f"{listing(names)} act with the same phase at {frequency:.4g} Hz",
                                  None,
                                  "Free gains of different parts, such as proportional and integral.")])
    first, last = np.linalg.solve(matrix, [target.real, target.imag])
    if first * last < 0 or first < 0:
        reach = float(np.degrees(np.angle(-columns[0])))
        raise UsageError([Problem(
            "design-not-reached", f"no positive gains reach the phase margin at {frequency:.4g} Hz: with the "
            f"proportional part alone it is {reach:.4g} degrees ({names[0]} would be {first:.4g}, {names[-1]} {last:.4g})",
            None,
            "Free a derivative gain for more phase, an integral gain for less, or change the crossover or the margin.")])
    return np.array([first, share * first, last] if len(parts) == 3 else [first, last])


def _closed_gain(loop: complex) -> float:
    return float(abs(loop / (1 + loop)))


def _crossover_for(bandwidth: float, loop_for: Callable[[float], complex]) -> float:
    """The crossover in Hz for which |L/(1 + L)| is 1/sqrt(2) at the bandwidth; `loop_for` is L at the bandwidth as a
    function of the crossover."""
    from scipy.optimize import brentq

    def excess(frequency: float) -> float:
        return _closed_gain(loop_for(frequency)) - HALF_POWER

    grid, values = np.geomspace(bandwidth / 10, bandwidth, 40), []
    for frequency in grid.tolist():
        try:
            values.append(excess(frequency))
        except UsageError:
            values.append(np.nan)
    signs = np.flatnonzero((np.array(values[:-1]) < 0) & (np.array(values[1:]) >= 0))
    if not len(signs):
        raise UsageError([Problem("design-bandwidth", f"no crossover up to {bandwidth:.4g} Hz gives this bandwidth with "
                                  "this phase margin", None, "Give the crossover, another phase margin, or further gains.")])
    k = int(signs[-1])
    return float(brentq(excess, grid[k], grid[k + 1], rtol=DESIGN.bandwidth))


def _bandwidth(loop: StateSpace, crossover: float) -> float:
    """The first frequency in Hz, from the crossover on, at which |L/(1 + L)| falls below 1/sqrt(2)."""
    high = min(loop.highest, 30 * crossover)
    frequencies = np.geomspace(0.3 * crossover, high, 600)
    values = loop.response(2j * np.pi * frequencies)[:, 0, 0]
    closed = np.abs(values / (1 + values))
    below = np.flatnonzero((closed[:-1] >= np.sqrt(0.5)) & (closed[1:] < np.sqrt(0.5)))
    if not len(below):
        return float("nan")
    from scipy.optimize import brentq

    def excess(frequency: float) -> float:
        return _closed_gain(complex(loop.response(2j * np.pi * frequency)[0, 0, 0])) - HALF_POWER

    return float(brentq(excess, frequencies[below[0]], frequencies[below[0] + 1]))


def design_lead(model: ModelOrFile, signal: str, block: str, *, crossover: float | str | None = None,
                bandwidth: float | str | None = None, phase_margin: float | str, at: Time | None = None,
                points: Mapping[str, Mapping[str, float | str]] | None = None) -> LoopDesign:
    """A lead or lag compensator k (T_1 s + 1)/(T_2 s + 1) in a loop, from its crossover or bandwidth, and its phase margin.

    The `block` is a `LeadLag` of the `model` (a diagram or a file) in the loop through `signal`, whose other parts keep
    their gains. `crossover` or `bandwidth` (Hz), `phase_margin` (degrees) and the operating `points` at which the margins
    are computed as well are as for `design_gains`. If phase is missing at the crossover, the block has its largest phase
    there (lead, T_1 > T_2). If there is too much, it is a lag with T_2 = 10 T_1, which has ten times the gain at low
    frequencies. The other arguments are as for `design_gains`. Raises UsageError if the block is not in the loop, or if the
    phase would have to change by more than a block can: 75 degrees or -50.
    """
    diagram = loaded(model)
    names = [f"{block}.{name}" for name in ("k", "T_1", "T_2")]
    _check_gains(names[:2], crossover, bandwidth, phase_margin)
    margin = _margin(phase_margin)
    state_spaces = _loops_through(diagram, signal, block, names, "LeadLag", at)
    point = state_spaces.points.at()
    plain = open_loop(state_spaces.at(dict(zip(names, (1.0, 1.0, 1.0), strict=True)), point))
    subject, frequency = _prescribed(crossover, bandwidth, plain.highest)
    target = np.exp(1j * (margin - np.pi))

    def compensator(at_crossover: float, factor: complex) -> Array:
        """k, T_1 and T_2 with a value of the compensator at the crossover."""
        omega, phase = 2 * np.pi * at_crossover, float(np.angle(factor))
        if not -LAG < phase < LEAD:
            raise UsageError([Problem("design-not-reached", f"the phase at {at_crossover:.4g} Hz would have to change by "
                                      f"{np.degrees(phase):.4g} degrees; a lead gives {np.degrees(LEAD):.0f} at most, a lag "
                                      f"takes {np.degrees(LAG):.0f}", None, "Change the crossover or the margin, or design "
                                      "two blocks in series.")])
        if phase >= 0:
            ratio = (1 - np.sin(phase)) / (1 + np.sin(phase))
            t_1, t_2 = 1 / (omega * np.sqrt(ratio)), np.sqrt(ratio) / omega
        else:  # tan(-phase) = 9 x/(1 + 10 x^2) with x = omega T_1
            tangent = np.tan(-phase)
            t_1 = (9 + np.sqrt(81 - 40 * tangent**2)) / (20 * tangent * omega)
            t_2 = 10 * t_1
        return np.array([abs(factor * (1 + 1j * omega * t_2) / (1 + 1j * omega * t_1)), t_1, t_2])

    def response(values: Array, at_frequency: float) -> complex:
        s = 2j * np.pi * at_frequency
        return complex(values[0] * (1 + s * values[1]) / (1 + s * values[2]))

    def open_response(at_frequency: float) -> complex:
        return complex(plain.response(2j * np.pi * at_frequency)[0, 0, 0])

    if subject == "bandwidth":
        band, at_band = frequency, open_response(frequency)
        frequency = _crossover_for(band, lambda guess: at_band * response(compensator(
            guess, target / open_response(guess)), band))
    factor = target / open_response(frequency)
    for _ in range(ROUNDS):  # between samplers the block is not a factor of the loop
        values = dict(zip(names, compensator(frequency, factor).tolist(), strict=True))
        closed = state_spaces.at(values, point)
        loop = open_loop(closed)
        value = complex(loop.response(2j * np.pi * frequency)[0, 0, 0])
        if abs(value / target - 1) < DESIGN.linear:
            break
        factor *= target / value
    else:
        raise UsageError([Problem("design-not-reached", f"the phase margin is not reached at {frequency:.4g} Hz", None,
                                  "Lower the crossover; near half the sampling rate the block has other phases.")])
    return _designed(diagram, signal, values, loop, closed.stability(), frequency, at, points)


def design_notch(model: ModelOrFile, signal: str, block: str, *, at: Time | None = None,
                 points: Mapping[str, Mapping[str, float | str]] | None = None) -> LoopDesign:
    """A notch at the mode that limits the gain of a loop.

    The `block` is a `NotchFilter` in the loop through `signal`. Without the notch the loop has its gain margin near the mode
    that limits the gain. The notch receives the frequency and the damping ratio of this mode of the open loop, so that its
    zeros cancel the poles of the mode; the width `zeta_p` remains. `at` and `points` are as for `design_gains`. Raises
    UsageError if the block is not in the loop, if no mode with a damping ratio below 0.5 is within a factor of two of
    the gain margin, or if the notch does not increase the gain margin.
    """
    diagram = loaded(model)
    names = [f"{block}.{name}" for name in ("f_n", "zeta_z", "zeta_p")]
    state_spaces = _loops_through(diagram, signal, block, names, "NotchFilter", at)
    width = state_spaces.points.assembly.parameter_values[names[2]]
    point = state_spaces.points.at()
    closed = state_spaces.at({names[1]: width}, point)
    plain = open_loop(closed)
    before = crossings(plain, closed.stability())
    limit = before.least_gain if before.unstable else before.gain_up
    if limit is None:
        raise UsageError([Problem("design-no-limit", f"the gain of the loop through '{signal}' is not limited", None,
                                  "A notch is not needed.")])
    poles = np.linalg.eigvals(plain.a)
    if plain.period is not None:
        poles = np.log(poles[np.abs(poles) > 0].astype(complex)) / plain.period
    filters = 2 * np.pi * state_spaces.points.assembly.parameter_values[names[0]]  # the poles of the block itself
    modes = [(abs(pole) / (2 * np.pi), -pole.real / abs(pole)) for pole in poles.tolist() if pole.imag > 0 and not (
        abs(abs(pole) / filters - 1) < 1e-6 and abs(-pole.real / abs(pole) - width) < 1e-6)]
    near = [(mode, ratio) for mode, ratio in modes if ratio < 0.5 and 0.5 < mode / max(limit.frequency, 1e-300) < 2]
    if not near:
        raise UsageError([Problem("design-no-mode", f"the gain is limited at {limit.frequency:.4g} Hz, and no mode with a "
                                  "damping ratio below 0.5 is within a factor of two of it", None,
                                  "Design a lead (--lead) or the gains (--free) instead.")])
    mode, ratio = min(near, key=lambda entry: abs(np.log(entry[0] / limit.frequency)))
    values = {names[0]: mode, names[1]: max(ratio, 0.0)}
    closed = state_spaces.at(values, point)
    loop, stability = open_loop(closed), closed.stability()
    after = crossings(loop, stability)
    if after.unstable or (after.gain_up is not None and not before.unstable and after.gain_up.value <= limit.value):
        raise UsageError([Problem("design-notch", f"a notch at {mode:.4g} Hz does not increase the gain margin of "
                                  f"{limit.value:.4g} at {limit.frequency:.4g} Hz", None, f"Give another {names[2]} (its "
                                  "width), or lower the gain of the loop first.")])
    crossover = after.least_phase.frequency if after.least_phase is not None else float("nan")
    return _designed(diagram, signal, values, loop, stability, crossover, at, points)


@dataclass(frozen=True)
class ScheduleDesign:
    """A table of gains of a `ScheduledPID`: the scheduling variable `inputs` (n,) in SI at the operating points, and the
    designed `values` of the parameters. `designs` are the designs at the operating points by name, `checks` the crossings
    with the table at these points and between them."""

    signal: str
    inputs: Array
    values: Mapping[str, float]
    designs: Mapping[str, LoopDesign]
    checks: Mapping[str, Crossings]

    def __repr__(self) -> str:
        verdicts = listing(list(dict.fromkeys(check.verdict for check in self.checks.values())))
        return brief(self, self.signal, f"{count(len(self.inputs), 'operating point')}", verdicts)


def design_schedule(model: ModelOrFile, signal: str, block: str, free: Sequence[str],
                    over: Mapping[str, Sequence[float | str]], *, crossover: float | str | None = None,
                    bandwidth: float | str | None = None, phase_margin: float | str | None = None, at: Time | None = None
                    ) -> ScheduleDesign:
    """A table of gains over a measured variable, from one design of gains at each of several operating points.

    The `block` is a `ScheduledPID` in the loop through `signal`, with as many points as there are operating points. `free`
    are its gains without their index, such as `["control.K_p", "control.K_i"]`. `over` is one parameter and its values,
    which are the operating points: `{"load.m": ["1 kg", "4 kg"]}`. At each of them the scheduling variable is read and the
    gains are designed as by `design_gains`, with its `crossover`, `bandwidth`, `phase_margin` and `at`. The loop with the
    table is checked at these points and halfway between neighbours. Raises UsageError as `design_gains`, for a table with
    another number of points, and if the scheduling variable does not differ between the operating points.
    """
    diagram = loaded(model)
    plain = StateSpaces(diagram, [], [], at).points.assembly
    places = [name for name in plain.parameter_names if name.startswith(f"{block}.x[")]
    if not places or f"{block}.s" not in plain.flat.names:
        blocks = sorted(name.removesuffix(".x[1]") for name in plain.parameter_names if name.endswith(".x[1]")
                        and name[:-5] + ".s" in plain.flat.names)
        raise wrong_block(block, "a ScheduledPID", blocks)
    path, settings = next(iter(over.items())) if len(over) == 1 else ("", ())
    if len(settings) != len(places):
        raise UsageError([Problem("design-points", f"the table of {block} has {count(len(places), 'point')}, and there are "
                                  f"{count(len(settings), 'operating point')} of one parameter", None,
                                  f"Give as many values as points, for example --over load.m='1 kg, 4 kg', or change the "
                                  f"lists of {block}.")])
    for name in free:
        if f"{name}[1]" not in plain.parameter_values or not name.startswith(f"{block}."):
            raise UsageError([Problem("parameter-unknown", f"'{name}' is not a list of gains of {block}", None,
                                      f"Write for example --free {block}.K_p,{block}.K_i.")])
    plain.parameter_indices([path])
    of_path = next(q.unit for q in plain.flat.parameters if q.name == path)
    points = [(str(setting), si_value(setting, of_path.text, path)) for setting in settings]

    def at_value(number: float) -> dict[str, float | str]:
        return {path: f"{of_path.from_si(number)!r} {of_path.text}".removesuffix(" 1")}

    inputs, designs = [], {}
    for text, number in points:
        spaces = StateSpaces(diagram.with_parameters(at_value(number)), [], [f"{block}.s"], at)
        designs[f"{path} = {text}"] = design = _gains_of(
            diagram.with_parameters(at_value(number)), signal,
            {name: [f"{name}[{k}]" for k in range(1, len(places) + 1)] for name in free}, crossover, bandwidth,
            phase_margin, at, {})
        assembly = spaces.points.assembly
        reading = ca.Function("s", list(assembly.arguments), [signal_expression(assembly, f"{block}.s", si=True)])
        inputs.append(float(reading(*spaces.points.at(design.values).values())))
    order = np.argsort(inputs)
    if not (np.diff(np.sort(inputs)) > DESIGN.linear * np.abs(inputs).max(initial=1e-300)).all():
        raise UsageError([Problem("design-same-input", f"{block}.s does not differ between the operating points: "
                                  f"{', '.join(f'{value:.6g}' for value in inputs)} (SI)", None,
                                  f"Connect {block}.s with a measured value that depends on {path}.")])
    of_points = list(designs.values())
    values = {f"{block}.x[{k + 1}]": inputs[j] for k, j in enumerate(order)}
    values |= {f"{name}[{k + 1}]": of_points[j].values[f"{name}[1]"] for name in free for k, j in enumerate(order)}
    scheduled, checks = diagram.with_parameters(values), {}
    ranked = sorted(points, key=lambda point: point[1])
    for k, (text, number) in enumerate(ranked):
        checks[f"{path} = {text}"] = loop_at(scheduled, signal, at_value(number), at)
        if k + 1 < len(ranked):
            checks[f"between {text} and {ranked[k + 1][0]}"] = loop_at(
                scheduled, signal, at_value((number + ranked[k + 1][1]) / 2), at)
    return ScheduleDesign(signal, np.array(inputs)[order], values, designs, checks)


def _loops_through(diagram: Model, signal: str, block: str, names: Sequence[str], kind: str, at: Time | None) -> StateSpaces:
    """The loop through a signal as a function of the parameters `names` of a block; UsageError for a block without these."""
    state_spaces = loops(diagram, signal, at)
    known = state_spaces.points.assembly.parameter_values
    if any(name not in known for name in names):
        first = names[0].rpartition(".")[2]
        blocks = sorted(n.rpartition(".")[0] for n in known if n.rpartition(".")[2] == first and all(
            f"{n.rpartition('.')[0]}.{name.rpartition('.')[2]}" in known for name in names))
        raise wrong_block(block, f"a {kind}", blocks)
    return state_spaces


def wrong_block(block: str, kinds: str, blocks: Sequence[str], message: str = "") -> UsageError:
    """The error for a block of another kind; `blocks` are those of the diagram with this kind."""
    possible = f": {listing(list(blocks))}" if blocks else "; this diagram has none"
    return UsageError([Problem("design-block", message or f"'{block}' is not {kinds}", None, f"Name {kinds}{possible}.")])


def _designed(diagram: Model, signal: str, values: Mapping[str, float], loop: StateSpace, stability: Stability,
              crossover: float, at: Time | None, points: Mapping[str, Mapping[str, float | str]] | None) -> LoopDesign:
    """The design with its margins at the operating point and at the further points."""
    has_crossover = crossover == crossover
    phase = float(np.degrees(np.angle(-loop.response(2j * np.pi * crossover)[0, 0, 0]))) if has_crossover else float("nan")
    at_points = {name: loop_at(diagram, signal, {**settings, **{n: v for n, v in values.items() if n not in settings}}, at)
                 for name, settings in (points or {}).items()}
    return LoopDesign(signal, values, crossings(loop, stability), crossover, phase,
                      _bandwidth(loop, crossover) if has_crossover else float("nan"), at_points)


def filter_coefficients(kind: str, order: int, cut_off: Sequence[float], band: str = "lowpass", *, ripple: float = 1.0,
                        attenuation: float = 40.0, period: float | None = None, time_unit: float = 1.0
                        ) -> tuple[Array, Array]:
    """Numerator and denominator (n,) of a filter of a `kind` and `order`, the highest power first.

    The polynomials are in s with the `time_unit` in s, or with a sampling `period` in s in z (bilinear transform with the
    cut-off exact). `band` is "lowpass", "highpass", "bandpass" or "bandstop". `cut_off` are one frequency or two (bands) in
    Hz; `ripple` is the passband ripple of `chebyshev 1` and `attenuation` the stopband attenuation of `chebyshev 2`, in dB.
    A Bessel filter has its -3 dB point at the cut-off. Source: SciPy's `scipy.signal.iirfilter`. Raises UsageError for
    another type, and for frequencies beyond half the sampling rate.
    """
    from scipy.signal import bessel, iirfilter

    for subject, word, words in (("type", kind, FILTERS), ("band", band, BANDS)):
        if word not in words:
            raise UsageError([Problem("filter-unknown", f"unknown filter {subject} '{word}'", None,
                                      suggest(word, words) or f"Write one of {listing(words)}.")])
    if order < 1:
        raise UsageError([Problem("filter-order", f"the order of the filter is {order}", None, "Give 1 or more.")])
    frequencies = np.asarray(cut_off, float).ravel()
    needed = 2 if band.startswith("band") else 1
    if len(frequencies) != needed or not (frequencies > 0).all() or (np.diff(frequencies) <= 0).any():
        amount, example = ("one cut-off frequency", "2 Hz") if needed == 1 else \
            ("two cut-off frequencies, the lower one first, both", "2 Hz, 5 Hz")
        raise UsageError([Problem("filter-cut-off", f"a {band} filter needs {amount} above 0 Hz", None,
                                  f"Give for example --cut-off '{example}'.")])
    if period is not None and frequencies.max() >= 0.5 / period:
        raise UsageError([Problem("filter-nyquist", f"the cut-off {frequencies.max():.4g} Hz is not below half the sampling "
                                  f"rate, {0.5 / period:.4g} Hz", None, "Give a lower frequency, or sample faster.")])
    edge = 2 * np.pi * frequencies * time_unit if period is None else frequencies
    options: dict[str, Any] = {"analog": period is None, "fs": None if period is None else 1 / period, "output": "ba",
                               "btype": band}
    if kind == "bessel":
        options["norm"] = "mag"
    else:
        types = {"butterworth": "butter", "chebyshev 1": "cheby1", "chebyshev 2": "cheby2"}
        options |= {"rp": ripple, "rs": attenuation, "ftype": types[kind]}
    function: Callable[..., tuple[Any, ...]] = bessel if kind == "bessel" else iirfilter

    def coefficients(degree: int) -> tuple[Array, Array, float]:
        """Numerator, denominator, and the largest difference of their response from the response by poles and zeros."""
        b, a = function(degree, edge if needed == 2 else float(edge[0]), **options)
        zeros, poles, gain = function(degree, edge if needed == 2 else float(edge[0]), **{**options, "output": "zpk"})
        highest = 10 * edge.max() if period is None else min(10 * edge.max(), 0.5 / period)
        sweep = np.concatenate([[0.0], np.geomspace(edge.min() / 10, highest, 200)])
        at = 1j * sweep if period is None else np.exp(2j * np.pi * sweep * period)
        factors = [np.prod(at[:, None] - np.asarray(roots)[None, :], axis=1) for roots in (zeros, poles)]
        with np.errstate(all="ignore"):
            difference = float(np.abs(np.polyval(b, at) / np.polyval(a, at) - gain * factors[0] / factors[1]).max())
        return np.pad(np.real(b), (len(a) - len(b), 0)), np.real(a), difference

    b, a, difference = coefficients(order)
    if not difference <= DESIGN.rounding:
        possible = next((n for n in range(order - 1, 0, -1) if coefficients(n)[2] <= DESIGN.rounding), 0)
        sampled = "" if period is None else " Or sample more slowly: the poles are near z = 1."
        raise UsageError([Problem("filter-rounding", f"rounding of the coefficients changes the response of this filter of "
                                  f"order {order} by {difference:.2g}", None, "Connect several filters of lower order in "
                                  "series" + (f"; the coefficients are accurate up to order {possible}." if possible else
                                              ".") + sampled)])
    return b, a
