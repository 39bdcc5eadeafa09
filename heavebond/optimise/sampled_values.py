"""Functionals of the samples of a run: extremes, and the duration and number of times that a condition holds. They are not
differentiable everywhere in the parameters, so that they can be measured and fitted, but not tuned."""

from __future__ import annotations

import numpy as np

from heavebond.numerics.dae import Array

EXTREMES = ("highest", "lowest", "largest")
CONDITIONS = ("share", "times")
SAMPLED = (*EXTREMES, *CONDITIONS)


def sampled_value(kind: str, time: Array, signal: Array, moved: Array) -> tuple[float, Array]:
    """The number of a signal (n,) at times (n,) and its slopes (m,), where the signal moves by `moved` (m, n).

    highest(e), lowest(e): the extremes; largest(e): that of |e|; of a condition (1 where it holds, 0 elsewhere) share(c):
    the part of the time in which it holds; times(c): how often it becomes true. What counts has no slope.
    """
    still = np.zeros(len(moved))
    if kind == "times":
        return float(np.count_nonzero(np.diff(signal > 0.5) & (signal[1:] > 0.5))), still
    if kind == "share":
        return float(np.trapezoid(signal, time) / (time[-1] - time[0])), still
    at = int({"highest": np.argmax, "lowest": np.argmin}.get(kind, lambda s: np.argmax(np.abs(s)))(signal))
    sign = np.sign(signal[at]) if kind == "largest" else 1.0
    return float(sign * signal[at]), np.asarray(sign * moved[:, at])
