"""Stability margins of sampled loops, cut where the signal is sampled or held.

With w = (r - C z)/D at a signal s = C z + D w (see `margins`) the readers of the signal receive r alone. A signal that
only sampled blocks read is taken at their instants; one that only sampled blocks set is taken at theirs, and is constant
between. With one instant in a period T the loop is L(z), and

    v = 2/T (z - 1)/(z + 1)

maps the unit circle to the imaginary axis exactly: at z = exp(j w T) v = 2j/T tan(w T/2). Crossings of L are crossings of
a transfer function of v, and the Nyquist frequency is at infinity. With n instants L(z) is an n by n matrix. With the factor
k at all of them the closed loop has the monodromy matrix A - B (1 + k D)^-1 k C; margins are real k, or k = exp(j phi), that
put an eigenvalue on the unit circle, and 1/Ms is the least singular value of 1 + L.

A further delay is not a power of z between whole periods: it changes the instants at which the signal acts. The delay
margin is the shortest delay with an eigenvalue of that system on the unit circle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problem, UsageError, listing
from heavebond.linear.sampled import Discrete, Hybrid, SampledLoop
from heavebond.numerics.dae import Array

if TYPE_CHECKING:
    from heavebond.linear.linear_system import StateSpace

NO_LOOP = "Name a signal of the loop, such as the output of its controller; a gain of 0 in the loop opens it."


@dataclass(frozen=True)
class SampledMarginConstants:
    """The constants of the margins of sampled loops.

    direct: share of its usual size below which a coefficient is rounding. Origin: rounding. Doubled: nothing.
    grows: excess of an eigenvalue over 1 that counts as growth. Origin: double eigenvalues at 1 are split by the root of
        rounding. Doubled: margins larger by some 1e-7.
    max_gain: factor on a gain up to which a margin is looked for. Origin: six decades. Doubled: margins farther away are
        found.
    gain_steps: steps for each decade of this search. Origin: 2 % in gain. Doubled: closer crossings are distinguished.
    phase_steps: steps of the search for a phase margin up to 180 degrees. Origin: half a degree. Doubled: as above.
    delay_steps: steps of the search up to the delay that the phase margin suggests. Origin: 4 %. Doubled: as above.
    max_delay_steps: steps of this search up to its end, twice that delay and two periods. Origin: time. Doubled: as above.
    max_turns: periods in a delay from which the phase margin over its frequency is exact enough. Origin: within 0.1 %.
        Doubled: time.
    frequencies: frequencies up to Nyquist's of the search for the modulus margin. Origin: a decade has hundreds. Doubled:
        time.
    halvings: halvings of a bracket. Origin: nine digits. Doubled: nothing.
    secants: secants to the unit circle from there. Origin: rounding is reached by three. Doubled: nothing.
    still: change of the size of an eigenvalue that is none. Origin: rounding of eigenvalues. Doubled: nothing.
    """

    direct: float = 1e-12
    grows: float = 1e-7
    max_gain: float = 1e6
    gain_steps: int = 120
    phase_steps: int = 360
    delay_steps: int = 24
    max_delay_steps: int = 400
    max_turns: float = 20.0
    frequencies: int = 2000
    halvings: int = 30
    secants: int = 6
    still: float = 1e-12


SAMPLED_MARGINS = SampledMarginConstants()


def cut_at(closed: Hybrid, name: str, direct: float) -> SampledLoop:
    """A loop from the hybrid system between the disturbance of a signal and the signal itself; UsageError if it cannot be
    cut there."""
    c, d = closed.c, float(closed.d[0, 0])
    if abs(d) < direct:
        raise UsageError([Problem("loop-not-cut", f"the loop cannot be cut at '{name}': a signal added there acts on "
                                  "itself without delay", None, "Cut it at another signal, such as a controller's output.")])
    read = closed.s @ c / d  # by updates, through the signal
    new = closed.after != 0
    system = replace(closed, g=_clear(closed.g - closed.f @ c / d, closed.g, closed.f @ c / d), f=closed.f / d, c=-c / d,
                     d=np.array([[1 / d - 1]]), r=_clear(closed.r - np.where(new, 0.0, read), closed.r, read),
                     after=_clear(closed.after - np.where(new, read, 0.0), closed.after, read), s=closed.s / d)
    parts = listing(list(dict.fromkeys(closed.part)), 6)
    follows = np.abs(system.c[0]) * system.sizes
    by = follows > SAMPLED_MARGINS.direct * max(float(follows.max(initial=0.0)), 1e-300)
    sampled = not system.f.any()
    if not sampled and (by & ~closed.constant).any():
        raise UsageError([Problem(
            "loop-continuous", f"the loop has samples, and '{name}' is neither read by sampled blocks alone nor set by them "
            "alone: cut there, it has no transfer function", None,
            f"Cut it at the input or the output of a sampled block ({parts}).")])
    rows = np.flatnonzero(system.s[:, 0]) if sampled else np.flatnonzero(by[list(system.target)])
    events = {system.event[row] for row in rows.tolist()}
    times = tuple(time for time, firing in system.schedule.instants if events & set(firing))
    if not times:
        raise _no_loop(name)
    return SampledLoop(system, times, sampled)


def _no_loop(name: str) -> UsageError:
    return UsageError([Problem("loop-none", f"'{name}' is in no loop: a signal added to it does not return", None, NO_LOOP)])


def _clear(difference: Array, *parts: Array) -> Array:
    """A difference with exact zeros where its parts cancel."""
    sizes = sum((np.abs(part) for part in parts), np.zeros_like(difference))
    return np.where(np.abs(difference) > SAMPLED_MARGINS.direct * sizes, difference, 0.0)


def opened(closed: StateSpace, loop: SampledLoop, name: str, inside: str, delay: float = 0.0) -> StateSpace:
    """The open loop as a system; UsageError if the signal is in no loop."""
    open_loop = loop.open(delay)
    units = dict(zip(closed.states, closed.units[0], strict=True))
    signal = closed.units[1]
    states = tuple(units.get(n, signal[0] if n.startswith("input[") else "") for n in open_loop.names)
    system = replace(closed, states=open_loop.names, inputs=(inside,), outputs=(name,), a=open_loop.a, b=open_loop.b,
                     c=open_loop.c,
                     d=open_loop.d, higher=np.zeros((2, 1, 1)), sizes=open_loop.sizes, rigid=open_loop.rigid,
                     units=(states, signal, signal), shown=signal, period=open_loop.period, delta=open_loop.delta, cut=loop,
                     hybrid=None)
    frequencies = np.linspace(0, system.highest, 200)[1:]
    if not np.any(np.abs(system.lifted(np.asarray(2j * np.pi * frequencies, dtype=complex))) > SAMPLED_MARGINS.direct):
        raise _no_loop(name)
    return system


def bilinear(a: Array, b: Array, c: Array, d: float, period: float) -> tuple[Array, Array, Array, float]:
    """The matrices in v of a loop with delta a (n, n), b/T (n,), c (n,) and d."""
    half = np.linalg.inv(np.eye(len(a)) + a * period / 2)
    # gamma = v/(1 - v T/2):  c (gamma - a)^-1 b = c half (v - a half)^-1 half b - T/2 c half b
    return a @ half, half @ b, c @ half, float(d - period / 2 * c @ half @ b)


def frequency(omega: float, period: float) -> float:
    """The frequency in Hz of v = j omega, omega in rad/s or infinite."""
    return float(np.arctan(omega * period / 2) / (np.pi * period))


def bilinear_exists(loop: Discrete) -> bool:
    """Whether a loop has no pole at z = -1, where v is infinite."""
    half = np.eye(len(loop.delta)) + loop.period * loop.delta * loop.sizes / loop.sizes[:, None] / 2
    return not len(half) or bool(np.linalg.svd(half, compute_uv=False)[-1] > SAMPLED_MARGINS.direct * np.abs(half).max())


def crossings_of_several(loop: Discrete) -> tuple[list[tuple[float, float]], list[tuple[float, float]], tuple[float, float]]:
    """Gains and phases in degrees at which the loop is at its stability boundary, each with its frequency in Hz; the least
    singular value of 1 + L, and its frequency."""
    gains = np.geomspace(1.0, SAMPLED_MARGINS.max_gain, int(np.log10(SAMPLED_MARGINS.max_gain)) * SAMPLED_MARGINS.gain_steps)
    angles = np.linspace(0, np.pi, SAMPLED_MARGINS.phase_steps)

    def turned(angle: float) -> complex:
        return complex(np.exp(-1j * angle))

    gain = [crossing for values in (1 / gains, gains) for crossing in _boundaries(loop, values, complex)]
    phase = [(float(np.degrees(angle)), f) for values in (angles, -angles) for angle, f in _boundaries(loop, values, turned)]
    scaled = replace(loop, delta=loop.delta * loop.sizes / loop.sizes[:, None], b=loop.b / loop.sizes[:, None],
                     c=loop.c * loop.sizes)
    period = loop.period

    def distance(omega: float) -> float:
        gamma = np.expm1(1j * omega * period) / period
        response = scaled.c @ np.linalg.solve(gamma * np.eye(len(scaled.delta)) - scaled.delta, scaled.b / period) + scaled.d
        return float(np.linalg.svd(np.eye(len(response)) + response, compute_uv=False)[-1])

    from scipy.optimize import minimize_scalar

    omegas = np.unique(np.concatenate([np.geomspace(1e-5, 1, SAMPLED_MARGINS.frequencies // 2),
                                       np.linspace(0, 1, SAMPLED_MARGINS.frequencies // 2)[1:]])) * np.pi / period
    sizes = [distance(omega) for omega in omegas.tolist()]
    k = int(np.argmin(sizes))
    near = minimize_scalar(distance, bounds=(omegas[max(k - 1, 0)], omegas[min(k + 1, len(omegas) - 1)]), method="bounded",
                           options={"xatol": 1e-10 / period})
    least = min((float(near.fun), float(near.x)), (sizes[k], float(omegas[k])))
    return gain, phase, (least[0], least[1] / (2 * np.pi))


def _boundaries(loop: Discrete, values: Array, factor: Callable[[float], complex]) -> list[tuple[float, float]]:
    """The values of a factor in the loop at which the number of growing modes changes, and the frequency in Hz of the
    mode."""
    def eigenvalues(value: float) -> NDArray[np.complex128]:
        return np.linalg.eigvals(loop.closed(factor(value))).astype(complex)

    counts = [_growing(eigenvalues(value)) for value in values.tolist()]
    return [_boundary(eigenvalues, (float(values[k]), float(values[k + 1])), loop.period)
            for k in np.flatnonzero(np.diff(counts)).tolist()]


def _growing(eigenvalues: NDArray[np.complex128]) -> int:
    return int(np.count_nonzero(np.abs(eigenvalues) > 1 + SAMPLED_MARGINS.grows))


def _boundary(eigenvalues: Callable[[float], NDArray[np.complex128]], span: tuple[float, float], period: float
              ) -> tuple[float, float]:
    """The value in a span at which an eigenvalue passes the unit circle, and its frequency in Hz: the span is halved where
    the number of growing ones changes, and the eigenvalue there is followed to the circle by secants inside the span. Those
    end where the eigenvalue does not move: it may jump (a delay before a sample acts in whole periods)."""
    (low, high), number = span, _growing(eigenvalues(span[0]))
    for _ in range(SAMPLED_MARGINS.halvings):
        middle = (low + high) / 2
        low, high = (middle, high) if _growing(eigenvalues(middle)) == number else (low, middle)
    at = eigenvalues(high)
    z = complex(at[np.argmin(np.abs(np.abs(at) - 1 - SAMPLED_MARGINS.grows))])
    value, before = high, high - 1e-4 * (span[1] - span[0])
    for _ in range(SAMPLED_MARGINS.secants):
        eigenvalues_there = eigenvalues(before)
        nearest = complex(eigenvalues_there[np.argmin(np.abs(eigenvalues_there - z))])
        if value == before or abs(abs(nearest) - abs(z)) < SAMPLED_MARGINS.still:
            break
        before, value = value, float(np.clip(value - (abs(z) - 1) * (value - before) / (abs(z) - abs(nearest)), *span))
        eigenvalues_there = eigenvalues(value)
        z = complex(eigenvalues_there[np.argmin(np.abs(eigenvalues_there - z))])
    return value, float(abs(np.angle(z)) / (2 * np.pi * period))


def least_delay(loop: SampledLoop, phases: Sequence[tuple[float, float]], dead_time: float = 0.0
                ) -> tuple[float, float] | None:
    """The shortest delay in s, in addition to the dead time, that brings a stable loop to its stability boundary, and the
    frequency in Hz at the boundary; `phases` are its phase margins in degrees with their frequencies."""
    suggested = [(angle % 360.0 / 360.0 / f, f) for angle, f in phases if f > 0]
    if not suggested:
        return None
    first, at = min(suggested)
    if first > SAMPLED_MARGINS.max_turns * loop.system.schedule.period:
        return first, at

    def eigenvalues(delay: float) -> NDArray[np.complex128]:
        return np.linalg.eigvals(loop.open(dead_time + delay).closed(1.0)).astype(complex)

    period = loop.system.schedule.period
    low, end = 0.0, 2 * first + 2 * period
    step = max(first / SAMPLED_MARGINS.delay_steps, end / SAMPLED_MARGINS.max_delay_steps)
    while not _growing(eigenvalues(low + step)):
        low += step
        if low > end:
            return first, at
    return _boundary(eigenvalues, (low, low + step), period)
