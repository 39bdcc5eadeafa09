"""Is the number of a law a constant of the machine? Its strength at small and at large motion.

A law of the wrong form may imitate what is missing at one amplitude, with numbers that another amplitude would not confirm:
a damping that grows with the square of the distance looks like one that grows with the speed. So the strength of an effect
is let vary with the amplitude A(t) of what it does to the channels (its envelope over two periods),

    strength(t) = 1 + b_1 g(t) + b_2 g(t)**2,      g = the rank of A(t) among all samples, from -1 to 1,

and b is estimated from the residuals together with all that is free, to first order at the fit: the test of parameter
constancy (G. C. Chow, 1960, doi:10.2307/1910133; J. Nyblom, 1989, doi:10.1080/01621459.1989.10478759) along the amplitude in
place of time. Its covariance comes of blocks of time, as residuals of a model that is not exact are correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heavebond.diagnosis.base_model import Base
from heavebond.diagnosis.catalogue import EffectNumber
from heavebond.diagnosis.decision import DECISION
from heavebond.localise.error_states import envelope
from heavebond.numerics.dae import Array

BLOCKS = 30  # of time, over all records: the clusters of the covariance
AT = (0.1, 0.3, 0.5, 0.7, 0.9)  # quantiles of the amplitude at which the strength is looked at


@dataclass(frozen=True)
class Constancy:
    """The strength of an effect at five amplitudes, the smallest first (1 is that of the fit), and the probability of such
    differences where it is constant."""

    strength: tuple[float, ...]
    chance: float

    @property
    def differs(self) -> bool:
        """Whether the strength differs by more than chance, and noticeably."""
        return self.chance < DECISION.level and max(abs(s - 1) for s in self.strength) > DECISION.constant


def constancy(base: Base, numbers: Sequence[EffectNumber]) -> Constancy | None:
    """The strength over the amplitude of the effect with these numbers, which is in the diagram of a fitted model; None
    where it has no amplitude that vanishes, or does nothing."""
    own = _own_response(base, numbers)
    if own is None or not own.any():
        return None
    amplitude, cluster = _amplitudes(base, own)
    g = np.empty(len(own))
    g[np.argsort(amplitude, kind="stable")] = np.linspace(-1.0, 1.0, len(own))
    moving = np.flatnonzero(~base.problem.at_end(base.inner))
    J, priors = base.J[:, moving], base.priors[:, moving]
    X = np.column_stack([J, own * g, own * g**2])
    scale = np.sqrt(np.maximum((X**2).sum(axis=0), 1e-300))
    X = X / scale
    P = np.pad(priors / scale[:len(moving)], ((0, 0), (0, 2)))
    normal = X.T @ X + P.T @ P
    inverse = np.linalg.pinv(normal, rcond=1e-12)
    step = -inverse @ (X.T @ base.r + P.T @ base.problem.priors(base.inner)[0])
    left = base.r + X @ step
    scores = np.stack([np.bincount(cluster, X[:, k] * left, int(cluster.max()) + 1) for k in range(X.shape[1])], axis=1)
    blocks = len(scores)
    covariance = inverse @ (scores.T @ scores) @ inverse * blocks / max(blocks - 1, 1)
    b = (step / scale)[-2:]
    spread = covariance[-2:, -2:] / scale[-2:, None] / scale[-2:]
    # the effect's own numbers move as well: what they do is a part of the strength
    names = {n.name for n in numbers}
    inside = [k for k, column in enumerate(moving) if base.problem.columns[column].free.name in names]
    common = float(own @ (X[:, inside] @ step[inside])) / float(own @ own)
    strength = tuple(float(1 + common + b[0] * v + b[1] * v**2) for v in np.quantile(g, AT))
    return Constancy(strength, _chance(b, spread, blocks))


def _chance(b: Array, spread: Array, blocks: int) -> float:
    """The p value of b = 0: Hotelling's T**2 with the covariance of so many blocks."""
    from scipy.special import fdtrc

    t = float(b @ np.linalg.pinv(spread) @ b)
    free = max(blocks - 1, 3)
    return float(fdtrc(2, free - 1, t * (free - 1) / (2 * free)))


def _own_response(base: Base, numbers: Sequence[EffectNumber]) -> Array | None:
    """What the effect does to the residuals (n,) with the strength that it has, to first order."""
    neutral = {n.name: n.neutral for n in numbers if n.amplitude and n.sought is None}
    found = np.zeros(len(base.r))
    for k, (column, inner) in enumerate(zip(base.problem.columns, base.inner, strict=True)):
        if column.free.name in neutral:
            found += base.J[:, k] / column.slope(inner) * (column.outer(inner) - neutral[column.free.name])
    return found if neutral else None


def _amplitudes(base: Base, own: Array) -> tuple[Array, NDArray[np.int64]]:
    """The envelope of a response at every residual (n,), over all channels together, and the block of time of each."""
    runs, before = base.problem.runs, 0
    found, cluster = np.zeros(len(own)), np.zeros(len(own), dtype=np.int64)
    number, total = 0, len(own)
    for run in runs:
        channel, place = np.nonzero(run.counts)
        part = own[before:before + len(place)]
        time = run.found.grid
        square = np.zeros(len(time))
        for c in np.unique(channel):
            there = channel == c
            whole = np.interp(np.arange(len(time)), place[there], part[there])
            square += envelope(whole, time)[0]**2
        found[before:before + len(place)] = np.sqrt(square)[place]
        blocks = max(2, round(BLOCKS * len(place) / total))
        cluster[before:before + len(place)] = number + place * blocks // len(time)
        before, number = before + len(place), number + blocks
    return found, np.unique(cluster, return_inverse=True)[1].astype(np.int64)
