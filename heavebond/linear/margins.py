"""Stability margins of a control loop opened at a signal: closed-loop stability, gain, phase and delay margins.

The signal s = C x + D w includes the disturbance w added to it; without it the signal is s - w. Cutting the loop means
w = r - (s - w), so that the readers of the signal receive r alone: with w = (r - C x) / D,

    x' = (A - B C / D) x + (B / D) r,   L(s) = -(s - w) / r = -(C / D) x / r - (1 - 1 / D),

without an approximation or a change of the diagram. L is counted with negative feedback: the closed loop is 1/(1 + L),
and it is stable if the eigenvalues of A are. Only then are the distances of L from -1 margins.

A loop with a dead time T has no eigenvalues that could be counted. Beginning at T = 0, roots reach the imaginary axis at
T = (angle of -L)/omega + 2 pi k/omega of each omega with |L| = 1, and go to the right where |L| falls there with the
frequency, to the left where it rises (K. L. Cooke, P. van den Driessche, Funkcialaj Ekvacioj 29 (1986) 77-90; K. Walton,
J. E. Marshall, IEE Proc. D 134 (1987) 101-107).

K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., Princeton, 2021, section 10.3 (margins).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.errors import Problem, UsageError
from heavebond.core.presentation import brief, number
from heavebond.language.model import ModelOrFile
from heavebond.linear import loop_crossings as crossing
from heavebond.linear.held_variables import HeldVariable
from heavebond.linear.linear_system import Complex, DelayedSystem, StateSpace, StateSpaces, spread
from heavebond.linear.sampled import Discrete
from heavebond.linear.sampled_margins import (
    NO_LOOP,
    bilinear,
    bilinear_exists,
    crossings_of_several,
    cut_at,
    frequency,
    least_delay,
    opened,
)
from heavebond.linear.stability import MARGINAL, STABLE, UNSTABLE, Stability, stability
from heavebond.numerics.dae import Array
from heavebond.numerics.output_times import Time, seconds


@dataclass(frozen=True)
class MarginConstants:
    """The constants of gain, phase, delay and modulus margins.

    uncut: direct gain of a loop, or distance from 1 of the direct gain of the closed loop, that is rounding. Origin:
        rounding. Doubled: nothing.
    no_gain: gain at any frequency below which a loop is rounding. Origin: rounding. Doubled: nothing.
    real: |Im L|/|L| at a crossing of the real axis; more is a pole or zero on the imaginary axis. Origin: errors of
        crossings. Doubled: nothing.
    on_axis: angle of -L in rad at a frequency of undamped oscillation. Origin: as above. Doubled: nothing.
    around: factor by which the frequencies of a plot go beyond poles, zeros and crossings. Origin: one decade. Doubled:
        wider plots.
    """

    uncut: float = 1e-12
    no_gain: float = 1e-12
    real: float = 1e-6
    on_axis: float = 1e-6
    around: float = 10.0


MARGINS = MarginConstants()
CUT = "behind the cut at "


@dataclass(frozen=True)
class Margin:
    """A crossing: `value` is a factor of the gain, a phase in degrees or a delay in s, at `frequency` in Hz."""

    value: float
    frequency: float


@dataclass(frozen=True)
class Crossings:
    """The crossings of the unit circle and the negative real axis by an open loop L, over all frequencies (0 and inf
    included).

    `gain`: the factors by which its gain may be multiplied until 1 + L is zero; `phase` in degrees (from -1, positive before
    it) and `delay` in s at every crossing of gain 1; `modulus`: the least distance of L from -1, the inverse of the maximum
    sensitivity M_s. `verdict` is the verdict on the closed loop by its eigenvalues, `reasons` why it is not stable, `held`
    are the variables that are constant in it. These are margins if the closed loop is stable or marginally stable; for an
    unstable loop they are distances to stability.
    """

    verdict: str
    reasons: tuple[str, ...]
    gain: tuple[Margin, ...]
    phase: tuple[Margin, ...]
    delay: tuple[Margin, ...]
    modulus: Margin
    held: tuple[HeldVariable, ...] = ()

    def __repr__(self) -> str:
        gains = [f"{number(m.value, 4)} at {number(m.frequency, 4)} Hz" for m in (self.gain_down, self.gain_up) if m]
        phase, delay = self.least_phase, self.least_delay
        return brief(self, self.verdict, f"gain times {' and '.join(gains)}" if gains else "no gain margin",
                     f"phase {number(phase.value, 4)} deg at {number(phase.frequency, 4)} Hz" if phase else "",
                     f"delay {number(delay.value, 4)} s" if delay else "", f"modulus {number(self.modulus.value, 4)}")

    @property
    def stable(self) -> bool:
        """Whether every eigenvalue of the closed loop decays."""
        return self.verdict == STABLE

    @property
    def unstable(self) -> bool:
        """True if an eigenvalue grows: then the crossings are not margins."""
        return self.verdict == UNSTABLE

    @property
    def gain_up(self) -> Margin | None:
        """The nearest factor above 1."""
        return min((m for m in self.gain if m.value >= 1), key=lambda m: m.value, default=None)

    @property
    def gain_down(self) -> Margin | None:
        """The nearest factor below 1, of a loop that needs its gain."""
        return max((m for m in self.gain if m.value < 1), key=lambda m: m.value, default=None)

    @property
    def least_gain(self) -> Margin | None:
        """The factor nearest to 1."""
        return min(self.gain, key=lambda m: abs(np.log(m.value)), default=None)

    @property
    def least_phase(self) -> Margin | None:
        """The phase margin of least size."""
        return min(self.phase, key=lambda m: abs(m.value), default=None)

    @property
    def least_delay(self) -> Margin | None:
        """The shortest further delay that brings the loop to its stability boundary."""
        return min(self.delay, key=lambda m: m.value, default=None)


class Margins(Crossings):
    """The margins of a loop that is stable when closed, except for free modes and integrators outside of it."""


def loops(model: ModelOrFile, signal: str, at: Time | None = None) -> StateSpaces:
    """The closed loop from the disturbance of a signal to the signal itself, in SI whatever `show:` declares for that
    name."""
    return StateSpaces(model, [signal], [f"({signal})"], at)


class OpenedSystem(DelayedSystem):
    """The open loop L = 1/G - 1 of a closed loop G with delays, from the disturbance of a signal to the signal itself."""

    def response(self, points: Complex) -> Complex:
        return np.asarray(1 / super().response(points) - 1)


def open_loop(closed: StateSpace, dead_time: float = 0.0) -> StateSpace:
    """L from the closed loop, whose one input is the disturbance of the signal that is its one output. L of a sampled loop
    contains the dead time in s, others do not.

    UsageError if the signal is in no loop, or follows its own derivative.
    """
    name, d = closed.inputs[0], float(closed.d[0, 0])
    within = [h for h in closed.held if h.between]
    if sampled := [h for h in within if h.sampled or h.at_threshold]:
        raise UsageError([Problem(
            "loop-held", f"the loop through '{name}' contains {sampled[0].label}, which the linear system holds constant: "
            "its margins cannot be computed", sampled[0].place, "If it is a command at its limit, take an operating point "
            "within the limits (initial values, or --at). Otherwise replace it by its continuous law (for a sample and hold "
            "a Delay of half a period), or tune and simulate the sampled loop.", tuple(h.text for h in sampled))])
    if closed.hybrid is not None:
        return opened(closed, cut_at(closed.hybrid, name, MARGINS.uncut), name, f"{CUT}{name}", dead_time)
    if not closed.proper or abs(d) < MARGINS.uncut:
        raise UsageError([Problem("loop-not-cut", f"the loop cannot be cut at '{name}': a signal added there acts on "
                                  "itself without delay", None, "Cut it at another signal, such as a controller's output.")])
    a = closed.a - closed.b @ closed.c / d
    exact = None if closed.exact is None else OpenedSystem(closed.exact.open, closed.exact.delays)
    loop = replace(closed, exact=exact, inputs=(f"{CUT}{name}",), outputs=(name,), a=a, b=closed.b / d, c=-closed.c / d,
                   d=np.array([[-(1 - 1 / d)]]), units=(closed.units[0], closed.units[1], closed.units[1]),
                   shown=closed.units[1])
    if not np.any(np.abs(loop.response(2j * np.pi * spread(loop.poles, loop.poles))) > MARGINS.no_gain):
        cut = "" if not within else f" while {', '.join(h.label for h in within)} does not change"
        raise UsageError([Problem("loop-none", f"'{name}' is in no loop: a signal added to it does not return{cut}",
                                  within[0].place if within else None, NO_LOOP, notes=tuple(h.text for h in within))])
    return loop


def transfer_of(loop: StateSpace, dead_time: float = 0.0) -> crossing.Transfer:
    """The transfer function of an open loop, made ready for its crossings."""
    sizes, exact = loop.sizes, loop.exact
    if loop.delta is not None and loop.period is not None:  # in v, the bilinear transform of z
        return crossing.transfer(*bilinear(loop.delta * sizes / sizes[:, None], loop.b[:, 0] / sizes / loop.period,
                                           loop.c[0] * sizes, float(loop.d[0, 0]), loop.period))
    transfer = crossing.transfer(loop.a * sizes / sizes[:, None], loop.b[:, 0] / sizes, loop.c[0] * sizes,
                                 float(loop.d[0, 0]), dead_time)
    return transfer if exact is None else replace(
        transfer, exact=lambda omega: loop.response(1j * omega)[:, 0, 0], lag=float(exact.delays.sum()))


def loop_frequencies(loop: StateSpace, crossings_of_loop: Crossings) -> Array:
    """Frequencies in Hz (N,) that show a loop: around its poles and zeros and all its crossings."""
    crossed = [m.frequency for m in (*crossings_of_loop.gain, *crossings_of_loop.phase, crossings_of_loop.modulus)
               if 0 < m.frequency < np.inf]
    if loop.period is not None:
        rates = loop.rates
        frequencies = [*crossed, *np.abs(rates[rates != 0]) / (2 * np.pi)]
    else:
        frequencies = [*crossing.critical_frequencies(transfer_of(loop)) / (2 * np.pi), *crossed]
    low, high = min(frequencies) / MARGINS.around, min(max(frequencies) * MARGINS.around, loop.highest)
    low = min(low, high / MARGINS.around)
    near = [spread(np.array([2j * np.pi * low * MARGINS.around, 2j * np.pi * high / MARGINS.around]), loop.rates),
            *(f * np.linspace(0.9, 1.1, 41) for f in crossed)]
    every = np.concatenate(near)
    return np.unique(every[(every >= low) & (every <= high)])


def crossings(loop: StateSpace, closed: Stability, *, dead_time: float = 0.0) -> Crossings:
    """Every crossing of an open loop L, the closed one judged without dead time; `dead_time` in s is added to both (the open
    one of a sampled loop contains it)."""
    if loop.period is not None:
        return _sampled_crossings(loop, closed, dead_time)
    of = transfer_of(loop, dead_time)
    gain = [Margin(1 / abs(value), omega / (2 * np.pi)) for omega in crossing.real_crossings(of)
            if (value := of.one(omega)).real < 0 and abs(value.imag) < MARGINS.real * abs(value)]
    if np.isfinite(of.static) and of.static < 0:
        gain.insert(0, Margin(-1 / of.static, 0.0))
    if of.d < -MARGINS.uncut:
        gain.append(Margin(-1 / of.d, np.inf))
    phase, delay = [], []
    for omega in crossing.magnitude_crossings(of):
        angle = float(np.degrees(np.angle(-of.one(omega))))
        phase.append(Margin(angle, omega / (2 * np.pi)))
        delay.append(Margin((angle % 360.0) / 360.0 * 2 * np.pi / omega, omega / (2 * np.pi)))
    distance, nearest = crossing.least_distance(of)
    verdict, reasons = _delayed(of, closed) if dead_time and not closed.undecided else (closed.verdict, closed.reasons)
    return Crossings(verdict, reasons, tuple(gain), tuple(phase), tuple(delay), Margin(distance, nearest / (2 * np.pi)),
                     loop.held)


def _sampled_crossings(loop: StateSpace, closed: Stability, dead_time: float) -> Crossings:
    """As `crossings`, of a sampled loop. The delay margin of the loop is exact if there are several crossings of gain 1."""
    assert loop.period is not None and loop.delta is not None and loop.cut is not None
    period = loop.period
    discrete = Discrete(period, loop.states, loop.sizes, loop.rigid, loop.delta, loop.b, loop.c, loop.d)
    if len(loop.cut.times) > 1 or not bilinear_exists(discrete):
        gains, phases, modulus = crossings_of_several(discrete)
        gains = [(k, _unaliased(loop, f, -1 / k)) for k, f in gains]
        phases = [(angle, _unaliased(loop, f, -complex(np.exp(1j * np.radians(angle))))) for angle, f in phases]
    else:
        of = transfer_of(loop)
        gains = [(1 / abs(value), frequency(omega, period)) for omega in crossing.real_crossings(of)
                 if (value := of.one(omega)).real < 0 and abs(value.imag) < MARGINS.real * abs(value)]
        ends = ((of.static, 0.0), (of.d, 1 / (2 * period)))
        gains += [(-1 / value, at) for value, at in ends if np.isfinite(value) and value < -MARGINS.uncut]
        phases = [(float(np.degrees(np.angle(-of.one(omega)))), frequency(omega, period))
                  for omega in crossing.magnitude_crossings(of)]
        least, nearest = crossing.least_distance(of)
        modulus = (least, frequency(nearest, period))
    verdict, reasons = closed.verdict, closed.reasons
    if dead_time and not closed.undecided:
        judged = stability(discrete.closed_delta(), loop.sizes, loop.states, loop.rigid, period)
        verdict, reasons = judged.verdict, judged.reasons
    delays = [(angle % 360.0 / 360.0 / at, at) for angle, at in phases if at > 0]
    if verdict != UNSTABLE and (exact := least_delay(loop.cut, phases, dead_time)):
        delays = [exact]
    gain, phase, delay = (tuple(Margin(*m) for m in sorted(margins, key=lambda m: m[1])) for margins in (gains, phases,
                                                                                                         delays))
    return Crossings(verdict, reasons, gain, phase, delay, Margin(*modulus), loop.held)


def _unaliased(loop: StateSpace, frequency: float, value: complex) -> float:
    """The frequency in Hz at which the locus of a loop has a value, from that modulo the frequency of the hyperperiod."""
    rate = 1 / (loop.period or 1.0)
    every = np.array([f for n in range(int(loop.highest / rate) + 2) for f in (n * rate - frequency, n * rate + frequency)
                      if -1e-9 * rate <= f <= loop.highest * (1 + 1e-9)])
    return float(every[np.argmin(np.abs(loop.response(2j * np.pi * every)[:, 0, 0] - value))])


def _delayed(of: crossing.Transfer, closed: Stability) -> tuple[str, tuple[str, ...]]:
    """The verdict on a loop with a dead time, from the verdict on the loop without it, and its reasons."""
    pairs = sum(1.0 if e.value.imag else 0.5 for e in closed.growing)
    undamped = list(closed.undamped)
    for omega in crossing.magnitude_crossings(of):
        angle = float(np.angle(-of.rational(np.array([omega]))[0]))
        first = angle % (2 * np.pi)
        sizes = np.abs(of.rational(omega * np.array([1 - 1e-6, 1 + 1e-6])))
        direction = 1 if sizes[1] < sizes[0] else -1
        if abs(angle) < MARGINS.on_axis:  # a pair that is on the axis without dead time leaves it at once
            pairs += max(direction, 0)
            undamped = [e for e in undamped if abs(e.value.imag - omega) > MARGINS.on_axis * omega]
            first = 2 * np.pi
        pairs += direction * max(int(np.floor((omega * of.dead_time - first) / (2 * np.pi))) + 1, 0)
    if pairs > 0:
        return UNSTABLE, (f"{round(2 * pairs)} roots grow with a dead time of {of.dead_time:g} s",)
    remaining = (*undamped, *closed.free)
    return (MARGINAL, tuple(e.text for e in remaining)) if remaining else (STABLE, ())


def loop_crossings(model: ModelOrFile, signal: str, *, at: Time | None = None,
                   parameters: Mapping[str, float | str] | None = None, dead_time: Time = 0.0) -> Crossings:
    """The crossings of the loop through a signal, also of an unstable one.

    Gains are factors, phases in degrees, delays in s, frequencies in Hz. `model`, `signal`, `at`, `parameters` and
    `dead_time` as in `loop_margins`; raises the errors of `state_space`.
    """
    closed, further = loops(model, signal, at).at(parameters), seconds(dead_time, "dead_time")
    return crossings(open_loop(closed, further), closed.stability(), dead_time=further)


def loop_margins(model: ModelOrFile, signal: str, *, at: Time | None = None,
                 parameters: Mapping[str, float | str] | None = None, dead_time: Time = 0.0) -> Margins:
    """The stability margins of the loop through a signal.

    The loop is cut at `signal`: L is the open loop, and the closed loop has the poles of 1/(1 + L). Gain margins are
    factors, phase margins in degrees, delay margins in s, frequencies in Hz. `at` is the operating point and `parameters`
    are values by name, as for `state_space`, on the diagram `model`; `dead_time` (s, or `"20 ms"`) is added to the loop.
    Raises UsageError if the closed loop is unstable and has no margins (`loop_crossings` gives the distance to stability),
    and the errors of `state_space`.
    """
    return checked(loop_crossings(model, signal, at=at, parameters=parameters, dead_time=dead_time), signal)


def checked(crossings_of_loop: Crossings, signal: str) -> Margins:
    """The crossings as margins; UsageError if the closed loop is unstable."""
    if crossings_of_loop.unstable:
        raise UsageError([Problem("loop-unstable", f"the loop through '{signal}' is unstable when closed, and has no "
                                  f"margins: {'; '.join(crossings_of_loop.reasons)}", None,
                                  "`loop_crossings` shows where it crosses -1, and by how much.")])
    return Margins(crossings_of_loop.verdict, crossings_of_loop.reasons, crossings_of_loop.gain, crossings_of_loop.phase,
                   crossings_of_loop.delay, crossings_of_loop.modulus, crossings_of_loop.held)
