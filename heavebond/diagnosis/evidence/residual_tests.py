"""Tests whether the residual of a fitted model is noise.

If no effect is missing, the three tests together give a false alarm in 2 % of the cases.

* score: the largest z of all candidates (see `search.scoring`), compared with the distribution of the largest of as many
  chance scores with the same correlation. Candidates that were selected by their prescores (see `search.prescore`) count as
  all prescored ones: the probabilities of the two sets, each with its own correlation, are added (Boole's inequality);
* size: chi-square of all samples, compared with its distribution, if the noise is specified (an estimated noise is not a
  valid reference);
* memory: the Ljung-Box test of each channel, the smallest p value times the number of channels (Bonferroni).

If inputs have noise, the residual r of a correct model is not white. Its covariance is R = D + E'E/M, with E (M, n) the
realisations of the error that the input noise causes in the residual (see `estimation.input_noise`), and D diagonal such
that the diagonal of R is 1. Then z is divided by its standard deviation sqrt(d'R d), with the direction d of the score.
Chi-square is compared with a chi-square distribution that is scaled to the mean n and the variance 2 tr R**2 (F. E.
Satterthwaite, 1946, doi:10.2307/3002019). The test for memory is omitted.
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

# Significance levels of the tests; their sum is 2 %.
LEVELS = {"score": 0.01, "size": 0.005, "memory": 0.005}
DRAWS = 20_000  # number of draws of the largest chance score; resolves p values down to a few in ten thousand
DISTINCT = 0.99  # two prescored directions with a larger cosine count as one
LAGS = 20
SIGMAS = 3.0  # largest excess of held-out chi-square that still counts as noise, in standard deviations


@dataclass(frozen=True)
class ResidualTests:
    """p values of the three tests (1 if a test is not applicable), and the largest score z."""

    score: float
    size: float
    memory: float
    z: float

    @property
    def significant(self) -> bool:
        """True if the residual exceeds noise by at least one test."""
        return any(getattr(self, name) < level for name, level in LEVELS.items())

    @property
    def by_score_alone(self) -> bool:
        """True if only the score test is significant. Then the refits of the candidates decide whether an effect is
        missing."""
        return self.significant and not any(getattr(self, name) < LEVELS[name] for name in ("size", "memory"))


def leftover(base: Base, scores: Sequence[Score], prescored: Sequence[Prescore] = ()) -> ResidualTests:
    """Apply the three tests to the residual of the base model on the fitted samples.

    Scores of candidates in `prescored` were selected for their large prescores, which the score test takes into account.
    """
    from scipy.special import chdtrc

    errors = np.hstack([run.input_errors for run in base.problem.runs])  # realisations (M, n) of the noise of inputs
    score, z = _largest([s for s in scores if s.told_apart], errors, prescored)
    size = memory = 1.0
    if base.problem.experiment.noise_given:
        freedom, scale = float(max(1, len(base.r) - len(base.inner))), 1.0
        if len(errors) > 1:
            # tr R**2 from pairs of different realisations: the square of a single one would add a bias
            noise_share, gram = _noise_share(errors), errors @ errors.T
            pairs = (float(np.sum(gram**2)) - float(np.sum(np.diag(gram) ** 2))) / (len(errors) * (len(errors) - 1))
            trace = float(np.sum(noise_share**2) + 2 * noise_share @ np.mean(errors**2, axis=0)) + max(pairs, 0.0)
            scale = max(1.0, trace / len(base.r))
        size = float(chdtrc(freedom / scale, float(base.r @ base.r) / scale))
    if not (len(errors) > 0 and float(np.mean(errors**2)) > NOTICEABLE):
        p_values = [metrics.whiteness(part, LAGS) for part in channels(base.problem.runs, base.r) if len(part) > 5 * LAGS]
        finite = [p for p in p_values if np.isfinite(p)]
        memory = min(1.0, min(finite) * len(finite)) if finite else 1.0
    return ResidualTests(score, size, memory, z)


def is_noise(fitted: float, held_out: float, samples: int) -> bool:
    """True if the held-out chi-square per sample is not significantly above 1, and the fitted chi-square per sample is near
    1."""
    return fitted <= DECISION.near and samples > 0 and not is_above_noise(held_out, samples)


def is_above_noise(chi2: float, samples: int) -> bool:
    """True if a chi-square per sample is significantly larger than the chi-square of noise; False without samples."""
    return samples > 0 and chi2 > 1 + SIGMAS * (2 / samples) ** 0.5


def _largest(scores: Sequence[Score], errors: Array, prescored: Sequence[Prescore] = ()) -> tuple[float, float]:
    """p value of the largest score, and this score.

    The correlation of the scores follows from their directions and from the covariance of the residual. Scores of
    `prescored` candidates count as all prescored ones.
    """
    if not scores:
        return 1.0, 0.0
    signed, directions = np.array([s.signed for s in scores]), np.array([s.direction for s in scores])
    # covariance of the projections of the residual of a correct model on the directions (k, n)
    covariance = directions @ directions.T
    if len(errors):
        drawn = directions @ errors.T
        covariance = (directions * _noise_share(errors)) @ directions.T + drawn @ drawn.T / len(errors)
    deviation = np.sqrt(np.diag(covariance))
    z = np.array([s.z for s in scores]) / deviation
    observed = float(np.max(np.where(signed, np.abs(z), z)))
    distant = {p.candidate.label for p in prescored}
    near = [k for k, s in enumerate(scores) if s.candidate.label not in distant]
    correlation = covariance / deviation[:, None] / deviation
    chance = _chance(correlation[np.ix_(near, near)], signed[near], observed) if near else 0.0
    if prescored:
        sketches = np.array([p.sketch / np.linalg.norm(p.sketch) for p in prescored])
        # The largest of thousands of projections is drawn with directions that differ by more than the cosine `DISTINCT`
        # only. The projection of an omitted direction exceeds theirs by less than sqrt(1 - DISTINCT**2) standard deviations.
        # Opposite directions both count: a candidate may be allowed in one direction only.
        apart: list[int] = []
        for k, sketch in enumerate(sketches):
            if not apart or float(np.max(sketches[apart] @ sketch)) < DISTINCT:
                apart.append(k)
        chance += _chance(sketches[apart] @ sketches[apart].T, np.array([prescored[k].signed for k in apart]), observed)
    return min(chance, 1.0), observed


def _chance(correlation: Array, signed: NDArray[np.bool_], observed: float) -> float:
    """Probability that the largest of correlated standard normal numbers is at least `observed`; `signed` numbers count by
    magnitude."""
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0))
    draws = np.random.default_rng(0).standard_normal((DRAWS, len(signed))) @ root.T
    largest = np.max(np.where(signed, np.abs(draws), draws), axis=1)
    return float((np.sum(largest >= observed) + 1) / (DRAWS + 1))


def _noise_share(errors: Array) -> Array:
    """Share (n,) of the variance of each residual that is noise of the channel."""
    return np.asarray(np.clip(1 - np.mean(errors**2, axis=0), 0.0, 1.0))


def channels(runs: Sequence[Run], r: Array) -> list[Array]:
    """Split the residuals (n,) of all runs into one array per channel and run."""
    sizes = [int(k) for run in runs for k in run.counts.sum(axis=1)]
    return np.split(r, np.cumsum(sizes)[:-1])
