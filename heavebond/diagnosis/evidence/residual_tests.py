"""Is what a fitted model leaves noise, or is something missing? Three tests, together wrong 2 times in 100 where nothing is.

* score: the largest z of all candidates (see `search.scoring`) against what the largest of as many, correlated as
  these are, would be by chance. Candidates that were chosen by their prescores (see `search.prescore`) count as all that
  were prescored: the chances of the two sets, each by its own correlation, are added (Boole's inequality);
* size: chi-square of all samples against its distribution, where the noise is given (an estimate is no yardstick for it);
* memory: the Ljung-Box test of each channel, the smallest p value times the number of channels (Bonferroni).

Where inputs have noise, the residual r of a right model is no longer white: it has the covariance R = D + E'E/M, with
E (M, n) realisations of what this noise does to it (see `estimation.input_noise`), and D diagonal what is left of 1. Then
z is divided by its standard deviation sqrt(d'R d), d its direction; chi-square is compared with a chi-square distribution
scaled to its mean n and variance 2 tr R**2 (F. E. Satterthwaite, 1946, doi:10.2307/3002019); and the test for memory is left
out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.prescore import Prescore
from heavebond.diagnosis.search.scoring import Score
from heavebond.estimation.input_noise import NOTICEABLE
from heavebond.estimation.residuals import Run
from heavebond.numerics.dae import Array
from heavebond.records import metrics

# Shares of the 2 % of false alarms; they add up to it.
LEVELS = {"score": 0.01, "size": 0.005, "memory": 0.005}
DRAWS = 20_000  # of the largest chance score: p values down to a few in ten thousand
DISTINCT = 0.99  # cosine above which two prescored directions count as one
LAGS = 20
SIGMAS = 3.0  # standard deviations of that figure on held-out data, up to which what is left is noise


@dataclass(frozen=True)
class ResidualTests:
    """p values of the three tests (1 where one cannot be made), and the largest score."""

    score: float
    size: float
    memory: float
    z: float

    @property
    def significant(self) -> bool:
        """Whether more than noise is left."""
        return any(getattr(self, name) < level for name, level in LEVELS.items())

    @property
    def by_score_alone(self) -> bool:
        """Whether only the largest of the scores is more than chance, and what is left has neither more size nor memory than
        noise: what candidates do when they are refitted decides then."""
        return self.significant and not any(getattr(self, name) < LEVELS[name] for name in ("size", "memory"))


def leftover(base: Base, scores: Sequence[Score], prescored: Sequence[Prescore] = ()) -> ResidualTests:
    """The tests on what the base model leaves of the fitted samples. Of the `scores` those of candidates that are among the
    `prescored` were chosen for what they promise."""
    told = [s for s in scores if s.told_apart]
    errors = np.hstack([run.input_errors for run in base.problem.runs])
    p_score, z = _largest(told, errors, prescored)
    memory = 1.0 if _noticeable(errors) else _memory(base)
    return ResidualTests(p_score, _size(base, errors) if base.problem.experiment.noise_given else 1.0, memory, z)


def _noticeable(errors: Array) -> bool:
    """Whether the noise of inputs, by its realisations (M, n), is a noticeable part of the variance of a residual."""
    return len(errors) > 0 and float(np.mean(errors**2)) > NOTICEABLE


def is_noise(fitted: float, held_out: float, samples: int) -> bool:
    """Whether these chi-squares a sample are no more than given noise can be: on `samples` that were not fitted by chance
    alone, and near it on those that were fitted."""
    return fitted <= DECISION.near and samples > 0 and not is_above_noise(held_out, samples)


def is_above_noise(chi2: float, samples: int) -> bool:
    """Whether chi-square a sample is more than that of noise by chance; on no samples it is not."""
    return samples > 0 and chi2 > 1 + SIGMAS * (2 / samples) ** 0.5


def _largest(scores: Sequence[Score], errors: Array, prescored: Sequence[Prescore] = ()) -> tuple[float, float]:
    """The chance that the largest of the scores, correlated as their directions and the residual are, is as large, where
    those that are `prescored` count as all prescored ones; and the largest."""
    if not scores:
        return 1.0, 0.0
    signed = np.array([s.signed for s in scores])
    covariance = _covariance(np.array([s.direction for s in scores]), errors)
    deviation = np.sqrt(np.diag(covariance))
    z = np.array([s.z for s in scores]) / deviation
    observed = float(np.max(np.where(signed, np.abs(z), z)))
    distant = {p.candidate.label for p in prescored}
    own = [k for k, s in enumerate(scores) if s.candidate.label not in distant]
    correlation = covariance / deviation[:, None] / deviation
    chance = _chance(correlation[np.ix_(own, own)], signed[own], observed) if own else 0.0
    if prescored:
        sketches = np.array([p.sketch / np.linalg.norm(p.sketch) for p in prescored])
        apart = _distinct(sketches)  # of opposite directions both count, as one may be allowed in one of them only
        chance += _chance(sketches[apart] @ sketches[apart].T, np.array([prescored[k].signed for k in apart]), observed)
    return min(chance, 1.0), observed


def _distinct(directions: Array) -> list[int]:
    """The first of all directions (k, n) that differ by no more than a cosine of `DISTINCT`: the largest of thousands is
    drawn by those alone. One that is left out exceeds them in its projections by less than sqrt(1 - DISTINCT**2) normal
    deviations."""
    found: list[int] = []
    for k, direction in enumerate(directions):
        if not found or float(np.max(directions[found] @ direction)) < DISTINCT:
            found.append(k)
    return found


def _chance(correlation: Array, signed: NDArray[np.bool_], observed: float) -> float:
    """The chance that the largest of normal numbers with this correlation, of the signed ones the largest magnitude, is as
    large."""
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0))
    draws = np.random.default_rng(0).standard_normal((DRAWS, len(signed))) @ root.T
    largest = np.max(np.where(signed, np.abs(draws), draws), axis=1)
    return float((np.sum(largest >= observed) + 1) / (DRAWS + 1))


def _covariance(directions: Array, errors: Array) -> Array:
    """The covariance (k, k) of the projections of a right model's residual on directions (k, n)."""
    if not len(errors):
        return np.asarray(directions @ directions.T)
    drawn = directions @ errors.T
    return np.asarray((directions * _own(errors)) @ directions.T + drawn @ drawn.T / len(errors))


def _own(errors: Array) -> Array:
    """The share (n,) of the variance of each residual that is the channel's own noise."""
    return np.asarray(np.clip(1 - np.mean(errors**2, axis=0), 0.0, 1.0))


def _size(base: Base, errors: Array) -> float:
    from scipy.special import chdtrc

    freedom, scale = float(max(1, len(base.r) - len(base.inner))), 1.0
    if len(errors) > 1:
        # tr R**2, of the realisations by pairs of different ones: squares of one alone would count its own length
        own, gram = _own(errors), errors @ errors.T
        pairs = (float(np.sum(gram**2)) - float(np.sum(np.diag(gram) ** 2))) / (len(errors) * (len(errors) - 1))
        trace = float(np.sum(own**2) + 2 * own @ np.mean(errors**2, axis=0)) + max(pairs, 0.0)
        scale = max(1.0, trace / len(base.r))
    return float(chdtrc(freedom / scale, float(base.r @ base.r) / scale))


def _memory(base: Base) -> float:
    found = [metrics.whiteness(part, LAGS) for part in channels(base.problem.runs, base.r) if len(part) > 5 * LAGS]
    finite = [p for p in found if np.isfinite(p)]
    return min(1.0, min(finite) * len(finite)) if finite else 1.0


def channels(runs: Sequence[Run], r: Array) -> list[Array]:
    """The residuals (n,) of all runs as one array for each channel of each."""
    sizes = [int(k) for run in runs for k in run.counts.sum(axis=1)]
    return np.split(r, np.cumsum(sizes)[:-1])
