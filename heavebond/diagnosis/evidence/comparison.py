"""Comparison of refits: the candidates that the records cannot distinguish from the best one.

If the residual of the best candidate is noise, the noise is the reference: another candidate is excluded if strong evidence
shows that its likelihood is smaller. Otherwise no law is exact, and predictive errors are compared. A candidate is then
excluded in two cases. First, it is outside the model confidence set, and its residual exceeds the residual of the best by a
material share of the misfit or by a large factor. Second, it explains less than half of the misfit that the best one
explains. All comparisons use all samples, each predicted by parameters that were not fitted to it.

Some candidates are equivalent to another value of a number of the diagram. Let s_o (n,) be the part of the derivative of the
residuals with respect to the candidate's amplitude that the free parameters cannot absorb, and h_o the same part for a
number that the diagram holds fixed. The candidate and the number cannot be distinguished to first order if s_o is
proportional to h_o. Example: an added mass on a body, and the mass of that body. If the whole derivative s is proportional
to the derivative with respect to a free parameter, s_o vanishes (see `scoring.SAME`), and no record can show the candidate.
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
# A BIC difference of 10 is strong evidence (R. E. Kass, A. E. Raftery, 1995, doi:10.1080/01621459.1995.10476572). As no law
# is exact, 0.3 % of chi-square is added.
STRONG, INEXACT = 10.0, 0.003
HOPELESS = 10.0  # a candidate with this multiple of the best loss is excluded without a bootstrap


@dataclass(frozen=True)
class Identity:
    """Result of a comparison of refits.

    members: refits that the records cannot distinguish, best first. blocks: number of independent blocks in the samples (NaN
    if the noise was the reference).
    """

    members: tuple[Refit, ...]
    blocks: float

    @property
    def too_short(self) -> bool:
        """True if several candidates remain because the records are too short to distinguish them."""
        return len(self.members) > 1 and self.blocks < DECISION.blocks


def likelihood(trial: Refit, joint: bool = False) -> float:
    """Information criterion of a refit over all samples; smaller is better.

    It is BIC of the fitted samples plus n ln(chi-square) of the n other samples. If `joint`, chi-square of the other samples
    is reduced by `Refit.slack`, which estimates a fit to all records. Parameters that the fitted records do not determine
    can change the errors on other records by more than the difference between two laws.
    """
    held = trial.chi2_held_out - joint * trial.slack / max(trial.samples_held_out, 1)
    held_out_term = trial.samples_held_out * float(np.log(max(held, 1e-300))) if trial.samples_held_out else 0.0
    return bic(trial.cost, trial.samples, trial.unknowns) + held_out_term


def leaves_noise(trial: Refit) -> bool:
    """True if the residual of a refit is noise: not above the specified noise, or near an estimated noise."""
    if trial.experiment.noise_given:
        held = (trial.chi2_held_out, trial.samples_held_out) if trial.samples_held_out else (trial.chi2_fit, trial.samples)
        return is_noise(trial.chi2_fit, *held)
    return trial.chi2_fit <= DECISION.near and not trial.chi2_held_out > DECISION.near


def compared(best: Refit, trials: Sequence[Refit], before: PredictiveErrors) -> Identity:
    """Select the `trials` that the records cannot distinguish from `best`, one of them; `before` are the predictive errors
    without any candidate."""
    competitors = [t for t in trials if t is not best]
    if leaves_noise(best):
        margin = STRONG + INEXACT * (best.samples + best.samples_held_out)
        near = [t for t in competitors if min(likelihood(t, j) - likelihood(best, j) for j in (False, True)) < margin]
        return Identity((best, *near), float("nan"))
    # Confidence set of the best (index 0) and the others. Candidates with a much larger loss get the p value 0 without a
    # bootstrap.
    confidence = None
    errors = [t.errors for t in (best, *competitors)]
    available = [e for e in errors if e is not None]
    if len(available) == len(errors) > 1 and len(available[0].sums):
        losses = levelled(available)
        means = losses.sum(axis=1)
        close = np.flatnonzero(means <= HOPELESS * max(means[0], available[0].counts.sum()))
        part = confidence_set(losses[close], available[0].counts, available[0].stretch)
        p, frequency = np.zeros(len(available)), np.zeros(len(available))
        p[close], frequency[close] = part.p, part.best
        confidence = ConfidenceSet(p, frequency, part.blocks)
    misfit = max(before.mean(*ALL) - 1.0, 0.0)
    near = []
    for k, trial in enumerate(competitors, 1):
        # a candidate that removes hardly any misfit is excluded even if the records contain few independent blocks
        least = min(_excess(trial, joint) for joint in (False, True))
        if misfit - least >= DECISION.mainly * (misfit - _excess(best, False)) \
                and (confidence is None or k in confidence or not differs_materially(best, trial, misfit)):
            near.append(trial)
    return Identity((best, *near), confidence.blocks if confidence is not None else float("nan"))


def best_predicting(trials: Sequence[Refit], *roles: int) -> Refit:
    """Trial with the smallest mean predictive error, in units of the discrepancy of each record, on samples of these roles
    (default: all). Return the first trial if the trials have no common samples."""
    errors = [t.errors for t in trials if t.errors is not None]
    if len(errors) < len(trials) or len({len(e.sums) for e in errors}) != 1 or not len(errors[0].sums):
        return trials[0]
    chosen = np.isin(errors[0].role, roles or ALL)
    return trials[int(np.argmin(levelled(errors)[:, chosen].sum(axis=1)))]


def loss(trial: Refit) -> float:
    """Chi-square per sample of all samples, each predicted by parameters that were not fitted to it."""
    assert trial.errors is not None
    return trial.errors.mean(*ALL)


def _excess(trial: Refit, joint: bool) -> float:
    """Residual chi-square per sample above the noise; if `joint`, without the part due to undetermined numbers
    (`Refit.slack`)."""
    assert trial.errors is not None
    return loss(trial) - 1.0 - joint * trial.slack / max(trial.errors.samples(*ALL), 1)


def differs_materially(best: Refit, trial: Refit, misfit: float) -> bool:
    """True if the residual of a candidate is materially larger than the residual of the best.

    The criterion is a difference of a material share of the misfit, or a multiple of the residual of the best above the
    noise. It must be satisfied with and without the part of the residuals that is due to undetermined parameters.
    """
    pairs = [(_excess(best, joint), _excess(trial, joint)) for joint in (False, True)]
    return all(more - least > DECISION.material * misfit or more > DECISION.times * max(least, DECISION.near - 1.0)
               for least, more in pairs)


def dispensable_variations(trials: Sequence[Refit], later: bool = False) -> list[Refit]:
    """Select the trials that vary a parameter and whose residual is not noise, if a law with constant parameters is not
    materially worse, or if this is a `later` step than the first.

    A parameter that varies with a variable, with time or between records describes a difference without a cause, and such
    candidates are numerous. So the residual of a variation above the noise must be several times (`DECISION.times`) smaller
    than the residual of each law. After the first step the residual may be the error of the law selected before, and
    variations can imitate this error.
    """
    laws = [_excess(t, False) for t in trials if not t.candidate.varies and t.errors is not None]
    least = 0.0 if later else min(laws, default=inf)
    return [t for t in trials if t.candidate.varies and t.errors is not None and not leaves_noise(t)
            and least <= DECISION.times * max(_excess(t, False), DECISION.near - 1.0)]


# The tangents of the search have errors of some percent (see `scoring.SIZED`). Two tangents are nearly proportional if the
# sine of the angle between them is below NEARLY. They are computed again with the tolerances times FINELY, which reduces the
# error in proportion.
NEARLY, FINELY = 0.05, 0.01


def equivalent_values(base: Base, scores: Sequence[Score]) -> dict[str, tuple[str, ...]]:
    """Find the numbers of the diagram that are equivalent to candidates. The keys of the result are the labels of the
    candidates.

    A candidate is equivalent to another value of a number if its tangents at all shapes are proportional to the tangent of
    this number. Tangents that are nearly proportional are computed again with smaller tolerances, because the errors of the
    tangents of the search exceed the threshold.
    """
    held = _held_directions(base) if scores else {}
    free = _unit({column.free.name: base.J[:, k] for k, column in enumerate(base.problem.columns)})
    of: dict[str, list[Score]] = {}
    for score in scores:
        if score.size > 0:
            of.setdefault(score.candidate.label, []).append(score)
    equivalents = {}
    for label, label_scores in of.items():
        beside = [_beside(score.direction, held if score.told_apart else free) for score in label_scores]
        nearly = set.intersection(*({name for name, share in shares.items() if share < NEARLY} for shares in beside))
        if names := {name for name in nearly if all(shares[name] < SAME or (
                score.told_apart and score.side == 0 and _beside_finely(base, score, name) < SAME)
                for score, shares in zip(label_scores, beside, strict=True))}:
            equivalents[label] = tuple(sorted(names))
    return equivalents


def _held_directions(base: Base) -> dict[str, Array]:
    """Unit vectors (n,) along the derivatives of the residuals with respect to the fixed numbers, projected orthogonal to
    the free parameters.

    A number is fixed by the diagram or by an end of its range. A number is left out if its projection vanishes.
    """
    names = [c.numbers[0].name for c in fixed_values(base.problem.experiment)]
    stopped = set(range(len(base.problem.columns))) - {int(k) for k in base.moving}
    derivatives = {base.problem.columns[k].free.name: base.J[:, k] for k in stopped}
    with suppress(HeavebondError):
        derivatives |= sensitivities(base, base.runs(Change(), names), {}) if names else {}
    projected = {name: base.split(s)[0] for name, s in derivatives.items() if np.all(np.isfinite(s)) and s.any()}
    return _unit({name: s for name, s in projected.items() if np.linalg.norm(s) > SAME * np.linalg.norm(derivatives[name])})


def _beside_finely(base: Base, score: Score, name: str) -> float:
    """Sine of the angle between the direction of a score and the direction of a number, both from runs with smaller
    tolerances.

    Return 1 if these runs fail, or if the score is not a tangent. The projections of two proportional vectors are also
    proportional, so an approximate J is sufficient.
    """
    along = list(score.along)
    if not along:  # a difference at a finite value, of an effect without a tangent
        return 1.0
    size = SIZED * float(np.linalg.norm(base.r)) / score.size
    point = {**{n.name: n.neutral for n in score.candidate.vanishing}, **score.shapes}
    try:
        runs = _finely(base.runs(score.candidate.change, along), dict.fromkeys(along, size))
        amplitude_slopes = sensitivities(base, runs, point)
        number_slope = sensitivities(base, _finely(base.runs(Change(), [name]), {}), {})[name]
    except HeavebondError:
        return 1.0
    directions = _unit({"effect": base.split(np.sum([amplitude_slopes[a] for a in along], axis=0))[0],
                        "number": base.split(number_slope)[0]})
    return _beside(directions["effect"], directions)["number"] if len(directions) == 2 else 1.0


def _finely(runs: Sequence[Run], sizes: Mapping[str, float]) -> list[Run]:
    """Repeat runs with FINELY times their tolerances; `sizes` scale the amplitudes in the error control."""
    return [run.again(run.names, sizes, QuickSimulator, run.simulator.tolerances.scaled(FINELY)) for run in runs]


def _unit(columns: Mapping[str, Array]) -> dict[str, Array]:
    return {name: s / length for name, s in columns.items() if (length := float(np.linalg.norm(s))) > 0}


def _beside(direction: Array, unit_vectors: Mapping[str, Array]) -> dict[str, float]:
    """Sine of the angle between a unit vector (n,) and each of the other unit vectors."""
    return {name: float(np.linalg.norm(direction - (direction @ s) * s)) for name, s in unit_vectors.items()}
