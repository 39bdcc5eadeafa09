"""Measured inputs as piecewise polynomials of time for an integrator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heavebond.core.errors import DataError, Problem, UsageError, suggest

Array = NDArray[np.float64]
SMOOTHNESS = {"hold": -1, "linear": 0, "spline": 2}
TERMS = 4
LEAST_TO_SMOOTH = 5  # least number of samples of a smoothing spline


@dataclass(frozen=True, eq=False)
class Pieces:
    """u(t) = sum_k coefficients[i, k] * (t - breaks[i])**k for breaks[i] <= t < breaks[i + 1].

    `breaks` (n + 1,) in s; `coefficients` (n, 4) in the signal's SI unit per s**k. `smoothness` is the
    highest derivative that is continuous: -1 held (the value itself jumps), 0 linear, 2 cubic spline.
    """

    breaks: Array
    coefficients: Array
    smoothness: int


def pieces(time: ArrayLike, values: ArrayLike, interpolation: str = "spline") -> Pieces:
    """The samples `values` (n,) at the increasing times `time` (n,) as a function of time, n >= 2.

    interpolation: `spline` is the cubic spline with not-a-knot ends (a parabola through 3 samples, a line through
    2); `linear` joins the samples; `hold` keeps each sample until the next, the last for one further median
    step.
    Raises DataError for a record that is too short or not in order, UsageError for another word.

    C. de Boor, A Practical Guide to Splines, Springer, 1978, chapter IV (not-a-knot).
    """
    if interpolation not in SMOOTHNESS:
        raise UsageError(f"`interpolation: {interpolation}` is not known",
                         hint=suggest(interpolation, SMOOTHNESS) or "Write spline, linear or hold.")
    t, y = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if len(t) < 2:
        number = "1 sample" if len(t) == 1 else f"{len(t)} samples"
        raise DataError([Problem("record-short", f"a record has {number}, it needs at least 2")])
    steps = np.diff(t)
    if not (np.all(steps > 0) and np.isfinite(y).all()):
        raise DataError([Problem("record-time", "a record needs increasing times and a number in every row")])
    if interpolation == "hold":
        return Pieces(np.append(t, t[-1] + np.median(steps)), _padded(y[:, None]), SMOOTHNESS[interpolation])
    if interpolation == "linear":
        return Pieces(t, _padded(np.stack([y[:-1], np.diff(y) / steps], axis=1)), SMOOTHNESS[interpolation])
    from scipy.interpolate import CubicSpline

    descending = CubicSpline(t, y, bc_type="not-a-knot").c
    return Pieces(t, _padded(descending[::-1].T), SMOOTHNESS[interpolation])


def smoothed_pieces(time: ArrayLike, values: ArrayLike, interpolation: str, bandwidth: float) -> Pieces:
    """Smooth the samples `values` (n,) at the times `time` (n,) in s: `spline` is the smoothing spline itself, `linear`
    joins its values at the samples.

      The smoothing spline f minimises sum (y - f)**2 + lambda integral f''**2. Far from the ends of a long record its gain
      at the frequency w is 1/(1 + (w/w_b)**4) without a phase shift, with lambda = 1/(h w_b**4) and the sample interval h:
      `bandwidth` w_b/(2 pi) in Hz is the frequency at which the gain is 1/2.

      C. H. Reinsch, Numerische Mathematik 10, 1967, 177-183, doi:10.1007/BF02162161; B. W. Silverman, Annals of
      Statistics 12, 1984, 898-916, doi:10.1214/aos/1176346710 (the equivalent filter).
    """
    t, y = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    plain = pieces(t, y, interpolation)  # checks
    interval = float(np.median(np.diff(t)))
    if len(t) < LEAST_TO_SMOOTH or bandwidth * 2 * interval >= 1:  # above the Nyquist frequency of the samples
        return plain
    from scipy.interpolate import PPoly, make_smoothing_spline

    unit = (t - t[0]) / interval
    spline = make_smoothing_spline(unit, y, lam=(2 * math.pi * bandwidth * interval)**-4)
    if interpolation == "linear":
        return pieces(t, spline(unit), interpolation)
    whole = PPoly.from_spline((spline.t, spline.c, spline.k))
    inner = np.flatnonzero(np.diff(whole.x) > 0)
    coefficients = whole.c[::-1, inner].T / interval**np.arange(TERMS)
    return Pieces(t, _padded(coefficients), SMOOTHNESS[interpolation])


def _piece(signal: Pieces, t: Array) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(signal.breaks, t, side="right") - 1, 0, len(signal.coefficients) - 1)


def _padded(coefficients: Array) -> Array:
    padded = np.zeros((len(coefficients), TERMS))
    padded[:, :coefficients.shape[1]] = coefficients
    return padded


def evaluate(signal: Pieces, t: ArrayLike, order: int = 0) -> Array:
    """The `order`-th derivative of a signal at the times `t` (any shape); at a break, the right-hand one.

    Raises DataError for times outside the record.
    """
    at = np.asarray(t, dtype=np.float64)
    if at.size:
        _check_covered(signal, float(at.min()), float(at.max()), "a signal")
    piece = _piece(signal, at)
    s = at - signal.breaks[piece]
    total = np.zeros(at.shape)
    for k in range(TERMS - 1, order - 1, -1):
        total = total * s + math.perm(k, order) * signal.coefficients[piece, k]
    return total


def align(signals: Sequence[Pieces], start: float, end: float, *,
          names: Sequence[str] = ()) -> tuple[Array, Array]:
    """All signals on one set of breaks over [start, end]: breaks (m + 1,), coefficients (m, n_signals, 4).

    The breaks are the union of all; each polynomial is expanded about the new break b' = b + d, without loss:
    c'_j = sum_k binomial(k, j) d**(k - j) c_k. `names` are for messages. Raises DataError if a signal
    does not cover [start, end].
    """
    for k, signal in enumerate(signals):
        _check_covered(signal, start, end, names[k] if names else f"signal {k + 1}")
    # the breaks inside (start, end) in order, with start and end; breaks that differ by rounding only are merged
    all_breaks = [s.breaks for s in signals]
    inner = np.sort(np.concatenate([np.empty(0), *(b[(b > start) & (b < end)] for b in all_breaks)]))
    same = 1e-6 * min((float(np.diff(b).min()) for b in all_breaks), default=0.0)
    inner = inner[(inner - start > same) & (end - inner > same)]
    apart = np.diff(inner, prepend=-np.inf) > same
    breaks = np.concatenate([[start], inner[apart], [end]])
    coefficients = np.zeros((len(breaks) - 1, len(signals), TERMS))
    middles = (breaks[:-1] + breaks[1:]) / 2
    for k, signal in enumerate(signals):
        piece = _piece(signal, middles)
        shift = breaks[:-1] - signal.breaks[piece]
        old = signal.coefficients[piece]
        for j in range(TERMS):
            coefficients[:, k, j] = sum(math.comb(i, j) * shift ** (i - j) * old[:, i]
                                        for i in range(j, TERMS))
    return breaks, coefficients


def _check_covered(signal: Pieces, start: float, end: float, name: str) -> None:
    first, last = float(signal.breaks[0]), float(signal.breaks[-1])
    # times computed as k * step miss the ends by rounding
    slack = 1e-6 * float(np.diff(signal.breaks).min())
    if start >= first - slack and end <= last + slack:
        return
    bounds, say = [], []
    if start < first - slack:
        bounds.append(f"the record begins at {first:.10g} s")
        until = f", until: {first + end - start:.10g} s" if first + end - start <= last + slack else ""
        say.append(f"begin at {first:.10g} s (`simulate: {{from: {first:.10g} s{until}}}`)")
    if end > last + slack:
        bounds.append(f"the record ends at {last:.10g} s")
        say.append(f"write `until: {last:.10g} s`")
    hint = " and ".join(say)
    requirement = f"the simulation needs {name} from {start:.10g} s to {end:.10g} s"
    raise DataError([Problem("record-end", f"{requirement}, {' and '.join(bounds)}",
                             hint=hint[0].upper() + hint[1:] + ".")])
