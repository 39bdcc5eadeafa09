"""A control loop cut at a signal: its open loop, and how much gain, phase and delay it bears.

The signal s = C x + D w carries what is added to it, and what sets it gives s - w. Cutting the loop means w = r - (s - w),
so that what reads the signal sees r alone: with w = (r - C x) / D,

    x' = (A - B C / D) x + (B / D) r,   L(s) = -(s - w) / r = -(C / D) x / r - (1 - 1 / D),

exact, and without any change to the diagram. L is counted with negative feedback: the closed loop is 1/(1 + L).

K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., Princeton, 2021, section 10.3 (margins).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from heavebond.analysis.linear_system import StateSpace, spread, state_space
from heavebond.basis.errors import Problem, UsageError
from heavebond.language.model import Model
from heavebond.numbers.dae import Array
from heavebond.numbers.simulation import Time

# A direct share of the loop so large that nothing is left of what is added: it cannot be cut there.
UNCUT = 1e-12
NOTHING = 1e-12  # a loop of no more gain than this at any frequency is rounding
# Crossings are looked for until the gain is so low that nobody would raise it as far, or for so many octaves.
WEAK, DOUBLINGS = 0.01, 16
CUT = "behind the cut at "


@dataclass(frozen=True)
class Margin:
    """A crossing: `value` is a factor of the gain, a phase in degrees or a delay in s, at `frequency` in Hz."""

    value: float
    frequency: float


@dataclass(frozen=True)
class Margins:
    """What a loop bears. `gain`: factors by which its gain may be multiplied, above 1 or (for a loop that needs its gain)
    below; `phase` in degrees and `delay` in s at every crossing of gain 1; `modulus`: the least distance of L from -1,
    with its frequency. `stable` tells whether the closed loop is; the margins of an unstable one are how far it is to go."""

    stable: bool
    gain: tuple[Margin, ...]
    phase: tuple[Margin, ...]
    delay: tuple[Margin, ...]
    modulus: Margin

    @property
    def least_gain(self) -> Margin | None:
        """The gain margin nearest to 1."""
        return min(self.gain, key=lambda m: abs(np.log(m.value)), default=None)

    @property
    def least_phase(self) -> Margin | None:
        """The phase margin of least size."""
        return min(self.phase, key=lambda m: abs(m.value), default=None)

    @property
    def least_delay(self) -> Margin | None:
        """The shortest delay that brings the loop to its limit."""
        return min(self.delay, key=lambda m: m.value, default=None)


def open_loop(closed: StateSpace) -> StateSpace:
    """L from the closed loop, whose one input is what is added to the signal that is its one output.

    UsageError where the signal is in no loop, or follows its own derivative.
    """
    name, d = closed.outputs[0], float(closed.d[0, 0])
    if not closed.proper or abs(d) < UNCUT:
        raise UsageError([Problem("loop-not-cut", f"the loop cannot be cut at '{name}': what is added there acts on itself "
                                  "at once", None, "Cut it at another signal, such as a controller's output.")])
    a = closed.a - closed.b @ closed.c / d
    loop = replace(closed, inputs=(f"{CUT}{name}",), a=a, b=closed.b / d, c=-closed.c / d,
                   d=np.array([[-(1 - 1 / d)]]))
    if not np.any(np.abs(loop.response(2j * np.pi * spread(loop.poles, loop.poles))) > NOTHING):
        raise UsageError([Problem("loop-none", f"'{name}' is in no loop: what is added to it does not come back")])
    return loop


def loop_frequencies(loop: StateSpace) -> Array:
    """Frequencies in Hz (N,) that show a loop: around its poles, and on to where it has no gain any more."""
    found = spread(loop.visible(), loop.poles)
    for _ in range(DOUBLINGS):
        gain = np.abs(loop.response(2j * np.pi * found[-1:])[0, 0, 0])
        if gain < WEAK or loop.d[0, 0]:
            break
        found = np.append(found, found[-1] * np.geomspace(1.02, 2, 35))
    return found


def margins(loop: StateSpace, stable: bool, frequencies: Array | None = None) -> Margins:
    """The margins of an open loop L; crossings are bracketed on the frequencies in Hz and refined by bisection."""
    f = loop_frequencies(loop) if frequencies is None else frequencies

    def at(frequency: float) -> complex:
        return complex(loop.response(np.array([2j * np.pi * frequency]))[0, 0, 0])

    values = loop.response(2j * np.pi * f)[:, 0, 0]
    gain, phase, delay = [], [], []
    for crossing in _crossings(f, values.imag, lambda x: at(x).imag):
        here = at(crossing)
        if here.real < 0:
            gain.append(Margin(1 / abs(here), crossing))
    for crossing in _crossings(f, np.log(np.abs(values)), lambda x: float(np.log(abs(at(x))))):
        angle = float(np.degrees(np.angle(-at(crossing))))  # how far L is from -1, positive before it
        phase.append(Margin(angle, crossing))
        delay.append(Margin((angle % 360.0) / 360.0 / crossing, crossing))
    return Margins(stable, tuple(gain), tuple(phase), tuple(delay), _modulus(f, values, at))


def loop_margins(model: Model, signal: str, *, at: Time | None = None, parameters: Mapping[str, float | str] | None = None
                 ) -> Margins:
    """The margins of the loop that runs through a signal; arguments and errors as those of `state_space`."""
    closed = state_space(model, [signal], [signal], at=at, parameters=parameters)
    return margins(open_loop(closed), closed.stable)


def _modulus(f: Array, values: NDArray[np.complex128], at: Callable[[float], complex]) -> Margin:
    """The least |1 + L|, refined around the nearest point of the grid."""
    from scipy.optimize import minimize_scalar

    k = int(np.argmin(np.abs(1 + values)))
    low, high = f[max(k - 1, 0)], f[min(k + 1, len(f) - 1)]
    found = minimize_scalar(lambda x: abs(1 + at(x)), bounds=(float(low), float(high)), method="bounded",
                            options={"xatol": 1e-10 * float(high)})
    return Margin(float(found.fun), float(found.x)) if found.fun < abs(1 + values[k]) else \
        Margin(float(abs(1 + values[k])), float(f[k]))


def _crossings(f: Array, values: Array, of: Callable[[float], float]) -> list[float]:
    """Where a function of the frequency is zero, by the changes of sign on a grid."""
    from scipy.optimize import brentq

    changes = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)
    return [float(brentq(of, f[k], f[k + 1], xtol=1e-14 * f[k], rtol=1e-13)) for k in changes]
