"""Constants of the decision of a diagnosis.

The documentation page on the diagnosis lists them with the consequences of halving or doubling each.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """Constants of the decision, all dimensionless.

    * level: significance level of the confidence set and of each comparison of two predictive errors.
    * material: smallest difference of the predictive errors of two candidates that distinguishes them if neither reaches the
      noise, as a share of the misfit (chi-square of the model without the effect, above the noise).
    * times: a difference is also material if the larger residual above the noise exceeds this multiple of the smaller one
      (which counts as at least `near` - 1). With a large misfit, the share alone would not distinguish very different
      residuals.
    * further: smallest share of the present misfit that a further effect must remove.
    * mainly: smallest share of the misfit that an effect must explain to be named although the residual exceeds the noise;
      and smallest share of the misfit explained by the best candidate that an alternative must explain.
    * covered: smallest share of the held-out motion that must be inside the fitted range for an identified curve to be a
      valid reference.
    * constant: largest relative difference of the strength of an effect between small and large motion.
    * blocks: number of independent blocks below which a record is too short to distinguish candidates.
    * near: largest chi-square per sample of a residual that is near the noise.
    * folds: number of blocks of the cross-validation within the fitted records.
    * draws: number of resamples of the bootstrap.
    """

    level: float = 0.05
    material: float = 0.05
    times: float = 4.0
    further: float = 0.2
    mainly: float = 0.5
    covered: float = 0.8
    constant: float = 0.1
    blocks: float = 20.0
    near: float = 1.5
    folds: int = 10
    draws: int = 1000


DECISION = Decision()
