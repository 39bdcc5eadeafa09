"""Which effect is it? The candidates that predict as well as the best one, and so cannot be told from it.

Where the best one leaves no more than noise, the noise is the yardstick: another one is excluded where its likelihood is
smaller by strong evidence. Elsewhere no law is exact, and their predictive errors are compared with each other: a candidate
is excluded where it is outside the model confidence set, and besides leaves more by a material share of the misfit or by a
multiple of what the best leaves; and where it explains less than half of what the best one explains. All on all samples,
each predicted by parameters that were not fitted to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.diagnosis.confidence_set import ConfidenceSet, confidence_set
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.predictive_errors import FITTED, SELECTION, TEST, PredictiveErrors
from heavebond.diagnosis.refit import Refit, bic
from heavebond.diagnosis.residual_tests import is_noise

ALL = (FITTED, SELECTION, TEST)
# Strong evidence in BIC is 10 (R. E. Kass, A. E. Raftery, 1995, doi:10.1080/01621459.1995.10476572); as no law is exact,
# 0.3 % of chi-square besides.
STRONG, INEXACT = 10.0, 0.003
HOPELESS = 10.0  # times what the best leaves, from which on a candidate is outside the set without a bootstrap


@dataclass(frozen=True)
class Identity:
    """Refits compared with each other: those in the answer, best first; how many independent blocks the samples are worth
    (NaN where the noise decided)."""

    members: tuple[Refit, ...]
    blocks: float

    @property
    def too_short(self) -> bool:
        """Whether several candidates are left because the records are too short to tell them apart."""
        return len(self.members) > 1 and self.blocks < DECISION.blocks


def likelihood(trial: Refit, joint: bool = False) -> float:
    """BIC of the fitted samples and n ln(chi-square) of all others, smaller is better; `joint` with what the others would
    leave if all records were fitted: numbers that the fit leaves open may miss other records by more than one law does more
    than another."""
    held = trial.chi2_held_out - joint * trial.slack / max(trial.samples_held_out, 1)
    others = trial.samples_held_out * float(np.log(max(held, 1e-300))) if trial.samples_held_out else 0.0
    return bic(trial.cost, trial.samples, trial.unknowns) + others


def leaves_noise(trial: Refit) -> bool:
    """Whether a refit leaves no more than noise: the given one, or near an estimated one."""
    if trial.experiment.noise_given:
        held = (trial.chi2_held_out, trial.samples_held_out) if trial.samples_held_out else (trial.chi2_fit, trial.samples)
        return is_noise(trial.chi2_fit, *held)
    return trial.chi2_fit <= DECISION.near and not trial.chi2_held_out > DECISION.near


def compared(best: Refit, trials: Sequence[Refit], before: PredictiveErrors) -> Identity:
    """The `trials` that cannot be told from the best of them, which is one of them; `before` are the predictive errors of
    the model without any."""
    others = [t for t in trials if t is not best]
    if leaves_noise(best):
        margin = STRONG + INEXACT * (best.samples + best.samples_held_out)
        near = [t for t in others if min(likelihood(t, j) - likelihood(best, j) for j in (False, True)) < margin]
        return Identity((best, *near), float("nan"))
    found = _set(best, others)
    misfit = max(before.mean(*ALL) - 1.0, 0.0)
    near = [t for k, t in enumerate(others, 1) if _explains(best, t, misfit)
            and (found is None or k in found or not _material(best, t, misfit))]
    return Identity((best, *near), found.blocks if found is not None else float("nan"))


def loss(trial: Refit) -> float:
    """Chi-square per sample of all samples, each predicted by parameters that were not fitted to it."""
    assert trial.errors is not None
    return trial.errors.mean(*ALL)


def _left(trial: Refit, joint: bool) -> float:
    """What a refit leaves above the noise; `joint`: without what it leaves because its own numbers are uncertain."""
    assert trial.errors is not None
    return loss(trial) - 1.0 - joint * trial.slack / max(trial.errors.samples(*ALL), 1)


def _explains(best: Refit, other: Refit, misfit: float) -> bool:
    """Whether another candidate takes away a good part of the misfit that the best one takes away: what leaves nearly all of
    it explains nothing, however few independent blocks the records hold."""
    return misfit - min(_left(other, joint) for joint in (False, True)) >= DECISION.mainly * (misfit - _left(best, False))


def _material(best: Refit, other: Refit, misfit: float) -> bool:
    """Whether another candidate leaves more by a material share of the misfit, or several times what the best leaves above
    the noise; also where what it leaves because its own numbers are uncertain is not counted."""
    def differ(least: float, more: float) -> bool:
        return more - least > DECISION.material * misfit or more > DECISION.times * max(least, DECISION.near - 1.0)

    return all(differ(_left(best, joint), _left(other, joint)) for joint in (False, True))


def _set(best: Refit, others: Sequence[Refit]) -> ConfidenceSet | None:
    """The confidence set of the best (its first) and the others; those that leave many times more come out without a share
    in it."""
    errors = [t.errors for t in (best, *others)]
    found = [e for e in errors if e is not None]
    if len(found) < len(errors) or len(found) < 2 or not len(found[0].sums):
        return None
    losses = np.array([e.sums for e in found])
    means = losses.sum(axis=1)
    close = np.flatnonzero(means <= HOPELESS * max(means[0], found[0].counts.sum()))
    part = confidence_set(losses[close], found[0].counts, found[0].stretch)
    p, frequency = np.zeros(len(found)), np.zeros(len(found))
    p[close], frequency[close] = part.p, part.best
    return ConfidenceSet(p, frequency, part.blocks)
