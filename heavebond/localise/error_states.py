"""Dependence of a model error on time, channel and state of motion.

The error of each channel is predicted by curves of one variable at a time: the speeds, positions, pressures and signals
of the run, the amplitude and the frequency of the channel. A curve is learnt on the fitted samples and tested on the
held-out ones. It explains the error beyond chance if its prediction is correlated with the error of the held-out samples
more than N independent samples would be by chance; since neighbouring samples are correlated, 1/N' = (1 + 2 sum_k r_k s_k) /
N with the autocorrelations r, s of the two (M. S. Bartlett, 1935, doi:10.2307/2342284), and the chance is multiplied by the
number of variables (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.curves import Mask
from heavebond.localise.law_forms import hats, knots_of, solved
from heavebond.numerics.dae import Array
from heavebond.records.metrics import autocorrelation


@dataclass(frozen=True)
class RecordSection:
    """A part of a record (s) and the chi-square per sample of each channel in it."""

    record: str
    begin: float
    end: float
    chi2: dict[str, float]


@dataclass(frozen=True)
class State:
    """The prediction of a channel's error by one variable: R2 on the samples not learnt from, its p value, and the curve of
    the error (in the channel's unit) over the variable (in SI)."""

    channel: str
    variable: str
    unit: str
    r2: float
    chance: float
    x: Array
    y: Array


def stretches(record: str, time: Array, errors: Mapping[str, Array], used: Mapping[str, Mask]) -> list[RecordSection]:
    """Twelve parts of a record; `errors` (N,) by channel in its noise, of which those `used` (N,) were sampled."""
    ends = np.linspace(0, len(time), INPUT_ESTIMATION.sections + 1).astype(int)
    return [RecordSection(record, float(time[a]), float(time[b - 1]),
                          {n: float(np.sum(e[a:b]**2) / max(1, used[n][a:b].sum())) for n, e in errors.items()})
            for a, b in pairwise(ends) if b > a]


def states(channel: str, error: Array, variables: Mapping[str, tuple[str, Array]], learn: Mask) -> list[State]:
    """The variables (name to unit and values (N,)) that predict the error (N,) of a channel beyond chance, best first."""
    states_of_error = []
    for name, (unit, values) in variables.items():
        if not np.ptp(values[learn]):
            continue
        knots = knots_of(values[learn])
        basis = hats(values, knots)
        a = solved(basis[learn], error[learn], np.ones(int(learn.sum())))
        inside = ~learn & (values >= knots[0]) & (values <= knots[-1])
        if inside.sum() < 20:
            continue
        predicted, wrong = basis[inside] @ a, error[inside]
        total = float(np.sum((wrong - wrong.mean())**2))
        r2 = 1 - float(np.sum((wrong - predicted)**2)) / total if total > 0 else 0.0
        chance = min(1.0, len(variables) * _chance(predicted - predicted.mean(), wrong - wrong.mean()))
        states_of_error.append(State(channel, name, unit, r2, chance, knots, a))
    good = [s for s in states_of_error if s.r2 > INPUT_ESTIMATION.least_r2 and s.chance < 0.01]
    return sorted(good, key=lambda s: -s.r2)


def _chance(a: Array, b: Array) -> float:
    """The p value of a correlation as positive as between a and b (N,), which are autocorrelated."""
    from scipy.special import stdtr

    size = float(np.sqrt((a @ a) * (b @ b)))
    if size == 0 or len(a) < 10:
        return 1.0
    r = float(np.clip(a @ b / size, -0.999999, 0.999999))
    lags = max(1, len(a) // 4)
    together = float(autocorrelation(a, lags)[1:] @ autocorrelation(b, lags)[1:])
    independent = max(3.0, len(a) / max(1.0, 1 + 2 * together))
    return float(stdtr(independent - 2, -r * np.sqrt((independent - 2) / (1 - r * r))))


def envelope(values: Array, time: Array, about: float | None = None) -> tuple[Array, Array]:
    """Amplitude (of a sine with the same mean square) and frequency (Hz) of a signal about a value, by default its mean,
    over a window of about two periods."""
    centred = values - (values.mean() if about is None else about)
    rate = np.gradient(centred, time)
    omega = float(np.sqrt(np.mean(rate**2) / max(float(np.mean(centred**2)), 1e-300)))
    step = float(np.median(np.diff(time)))
    width = int(np.clip(4 * np.pi / max(omega, 1e-12) / step, 3, len(time) // 2))

    def mean(x: Array) -> Array:
        kernel = np.ones(width)
        return np.asarray(np.convolve(x, kernel, "same") / np.convolve(np.ones(len(x)), kernel, "same"))

    square = np.maximum(mean(centred**2), 1e-300)
    return np.sqrt(2 * square), np.sqrt(np.maximum(mean(rate**2), 0) / square) / (2 * np.pi)


def worst(parts: Sequence[RecordSection]) -> RecordSection:
    """The part with the largest misfit."""
    return max(parts, key=lambda s: sum(s.chi2.values()))
