"""Comparison of refits: the candidates that the records cannot distinguish from the best one.

If the best one leaves no more than noise, the noise is the reference: another one is excluded if its likelihood is smaller
by strong evidence. Otherwise no law is exact, and predictive errors are compared: a candidate is excluded if it is outside
the model confidence set and also leaves more by a material share of the misfit or by a multiple of the residual of the
best; and if it explains less than half of what the best one explains. All comparisons use all samples, each predicted by
parameters that were not fitted to it.

Some candidates act as another value of a number of the diagram. With s_o (n,) the part of the derivative of the residuals
to the candidate's amplitude that the free parameters cannot absorb, and h_o the same of a number that the diagram holds
fixed, the two cannot be distinguished to first order if s_o is proportional to h_o: added mass on a body, and the mass of
that body. If s itself is proportional to the derivative to a free parameter, nothing of it remains (see `scoring.SAME`),
and no record can show the candidate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.candidates.fixed_values import fixed_values
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.prediction import (
    FITTED,
    SELECTION,
    TEST,
    ConfidenceSet,
    PredictiveErrors,
    confidence_set,
    levelled,
)
from heavebond.diagnosis.evidence.residual_tests import is_noise
from heavebond.diagnosis.search.base_model import Base, sensitivities
from heavebond.diagnosis.search.refit import Refit, bic
from heavebond.diagnosis.search.scoring import SAME, SIZED, Score
from heavebond.estimation.residuals import Run
from heavebond.language.edits import Change
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator

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
            and (found is None or k in found or not differs_materially(best, t, misfit))]
    return Identity((best, *near), found.blocks if found is not None else float("nan"))


def best_predicting(trials: Sequence[Refit], *roles: int) -> Refit:
    """The trial with the smallest mean predictive error in units of the discrepancy of each record, on samples of these
    roles (default: all); the first one if the trials have no common samples."""
    errors = [t.errors for t in trials if t.errors is not None]
    if len(errors) < len(trials) or len({len(e.sums) for e in errors}) != 1 or not len(errors[0].sums):
        return trials[0]
    chosen = np.isin(errors[0].role, roles or ALL)
    return trials[int(np.argmin(levelled(errors)[:, chosen].sum(axis=1)))]


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


def differs_materially(best: Refit, other: Refit, misfit: float) -> bool:
    """Whether another candidate leaves more by a material share of the misfit, or several times what the best leaves above
    the noise; also where what it leaves because its own numbers are uncertain is not counted."""
    def differ(least: float, more: float) -> bool:
        return more - least > DECISION.material * misfit or more > DECISION.times * max(least, DECISION.near - 1.0)

    return all(differ(_left(best, joint), _left(other, joint)) for joint in (False, True))


def dispensable_variations(trials: Sequence[Refit], later: bool = False) -> list[Refit]:
    """The trials that vary a parameter of the diagram and that do not reach the noise, if a law with constant parameters is
    not materially worse, or if this is a `later` step than the first.

    A parameter that varies over a variable, over time or between records describes a difference without a cause, and there
    are many of them. So a variation that does not reach the noise must leave several times less above the noise (`times`)
    than each law. After the first step the residual may be the error of the law before it, which variations imitate.
    """
    laws = [_left(t, False) for t in trials if not t.candidate.varies and t.errors is not None]
    least = 0.0 if later else min(laws, default=inf)
    return [t for t in trials if t.candidate.varies and t.errors is not None and not leaves_noise(t)
            and least <= DECISION.times * max(_left(t, False), DECISION.near - 1.0)]


def _set(best: Refit, others: Sequence[Refit]) -> ConfidenceSet | None:
    """The confidence set of the best (its first) and the others; those that leave many times more come out without a share
    in it."""
    errors = [t.errors for t in (best, *others)]
    found = [e for e in errors if e is not None]
    if len(found) < len(errors) or len(found) < 2 or not len(found[0].sums):
        return None
    losses = levelled(found)
    means = losses.sum(axis=1)
    close = np.flatnonzero(means <= HOPELESS * max(means[0], found[0].counts.sum()))
    part = confidence_set(losses[close], found[0].counts, found[0].stretch)
    p, frequency = np.zeros(len(found)), np.zeros(len(found))
    p[close], frequency[close] = part.p, part.best
    return ConfidenceSet(p, frequency, part.blocks)


# Tangents of the search err by some percent (see `scoring.SIZED`): two that are nearly in proportion, less than this share
# of one beside the other, are computed anew, at this share of the tolerances, where the error falls with them.
NEARLY, FINELY = 0.05, 0.01


def equivalent_values(base: Base, scores: Sequence[Score]) -> dict[str, tuple[str, ...]]:
    """The numbers of the diagram of which candidates are another value, by the labels of these: at every choice of its
    shapes a candidate is in proportion to the same one. Where the tangents are so nearly, they are computed anew by finer
    runs: those of the search err by more than what decides."""
    held = _held_directions(base) if scores else {}
    free = _unit({column.free.name: base.J[:, k] for k, column in enumerate(base.problem.columns)})
    of: dict[str, list[Score]] = {}
    for score in scores:
        if score.size > 0:
            of.setdefault(score.candidate.label, []).append(score)
    found = {}
    for label, own in of.items():
        beside = [_beside(score.direction, held if score.told_apart else free) for score in own]
        nearly = set.intersection(*({name for name, share in shares.items() if share < NEARLY} for shares in beside))
        if names := {name for name in nearly if all(shares[name] < SAME or (
                score.told_apart and score.side == 0 and _beside_finely(base, score, name) < SAME)
                for score, shares in zip(own, beside, strict=True))}:
            found[label] = tuple(sorted(names))
    return found


def _held_directions(base: Base) -> dict[str, Array]:
    """What the free parameters do not take of the derivative of the residuals to each number that is held fixed, by the
    diagram or by an end of its range, as directions (n,); without those of which nothing is left."""
    names = [c.numbers[0].name for c in fixed_values(base.problem.experiment)]
    stopped = set(range(len(base.problem.columns))) - {int(k) for k in base.moving}
    moved = {base.problem.columns[k].free.name: base.J[:, k] for k in stopped}
    with suppress(HeavebondError):
        moved |= sensitivities(base, base.runs(Change(), names), {}) if names else {}
    left = {name: base.split(s)[0] for name, s in moved.items() if np.all(np.isfinite(s)) and s.any()}
    return _unit({name: s for name, s in left.items() if np.linalg.norm(s) > SAME * np.linalg.norm(moved[name])})


def _beside_finely(base: Base, score: Score, name: str) -> float:
    """The share of a score's direction that is beside that of a number, both from finer runs; 1 where they fail, or where
    the score is no tangent. What the free parameters take of two vectors in proportion is in proportion as well, however
    exact J is."""
    along = list(score.along)
    if not along:  # the difference at a finite value, of an effect that has no tangent
        return 1.0
    size = SIZED * float(np.linalg.norm(base.r)) / score.size
    there = {**{n.name: n.neutral for n in score.candidate.vanishing}, **score.shapes}
    try:
        own = sensitivities(base, _finely(base.runs(score.candidate.change, along), dict.fromkeys(along, size)), there)
        other = sensitivities(base, _finely(base.runs(Change(), [name]), {}), {})[name]
    except HeavebondError:
        return 1.0
    directions = _unit({"own": base.split(np.sum([own[a] for a in along], axis=0))[0], "other": base.split(other)[0]})
    return _beside(directions["own"], directions)["other"] if len(directions) == 2 else 1.0


def _finely(runs: Sequence[Run], sizes: Mapping[str, float]) -> list[Run]:
    """The runs with a hundredth of their tolerances, whose error control knows how large amplitudes are."""
    return [run.again(run.names, sizes, QuickSimulator, run.simulator.tolerances.scaled(FINELY)) for run in runs]


def _unit(columns: Mapping[str, Array]) -> dict[str, Array]:
    return {name: s / length for name, s in columns.items() if (length := float(np.linalg.norm(s))) > 0}


def _beside(direction: Array, others: Mapping[str, Array]) -> dict[str, float]:
    """The share of a unit vector (n,) that is beside each of others, the sine of the angle between them."""
    return {name: float(np.linalg.norm(direction - (direction @ s) * s)) for name, s in others.items()}
