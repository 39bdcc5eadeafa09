"""The constants of the decision of a diagnosis, in one place.

The page on the diagnosis lists them with what changes where each is halved or doubled.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """The constants of the decision, all without unit.

    level: significance level of the confidence set and of every comparison of two predictive errors. material: share of
    the misfit (chi-square of the model without the effect, above the noise) by which the predictive errors of two
    candidates must differ to be told apart where none of them reaches the noise. times: multiple of what the better one
    leaves above the noise, at least of `near` - 1, that differs materially too: beside a large misfit the share alone
    calls much alike. further: share of the misfit at hand that an effect must take away to be added. mainly: share of
    the misfit that an effect must explain to be named although more than noise is left, and share of what the best one
    explains that a rival must explain. covered: share of the held-out
    motion that must lie inside the fitted range for an identified curve to be a yardstick. constant: share by which the
    strength of an effect may differ between small and large motion. blocks: number of independent
    blocks below which a record is too short to tell candidates apart. near: chi-square per sample up to which a residual
    is near the noise. folds: number of blocks of the cross-validation within the fitted records. draws: resamples of the
    bootstrap.
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
