"""Verdict of a diagnosis, one of seven.

* nothing: the residual is noise.
* parameters: no effect is missing, but values of free parameters were wrong, or a value that the diagram holds fixed.
* effect: one effect at one place is missing.
* one_of: one of several effects is missing, which the records cannot distinguish.
* mainly: one effect (or one of several) explains most of the misfit, and more is missing.
* shape: the missing effect is not in the catalogue; the answer is a place and a curve.
* undetermined: the records do not decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.flexible_laws import Adequacy
from heavebond.diagnosis.evidence.residual_tests import is_noise
from heavebond.diagnosis.search.step import EARNED, Stage
from heavebond.diagnosis.state import AddedEffect, LadderEntry, chi2_sum
from heavebond.estimation.fitting import Fit

CHANCE = 0.005  # p value below which the fitted parameters are significantly better than the data sheet
STILL = 3.0  # smallest standard deviation of a channel that moves, in units of its noise
# Share of the variance of the fitted records above which the error of a model shows that it predicts nothing: the mean value
# of each channel, with the share 1, is hardly worse.
UNPREDICTED = 0.9


def is_adequate(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect]) -> bool:
    """True if the residual of the model with all findings is noise.

    If the noise of all channels is specified, chi-square must not be significantly above the noise level. After a single
    effect that removes most of the misfit, a chi-square near the noise level is sufficient. (It is not sufficient for
    several effects, because wrong effects that correct each other also reach it.) If the noise is estimated, chi-square must
    be near the noise level.

    The result is False if a parameter ended at an end of its search range beyond which the error would decrease, because the
    fit is then not a minimum.
    """
    if any(f.beyond for f in findings):
        return False
    last = findings[-1].rung if findings else ladder[-1]
    if not findings or not last.comparison.experiment.noise_given:
        return held_out_or_fitted(last) <= DECISION.near
    if is_noise(last.chi2_fit, last.chi2_held_out, last.samples_held_out):
        return True
    first = min(held_out_or_fitted(r) for r in takewhile(lambda r: r is not findings[0].rung, ladder))
    return len(findings) == 1 and near_noise(last) and misfit_reduction(first, held_out_or_fitted(last)) >= DECISION.mainly


def without_effects(ladder: Sequence[LadderEntry], added: Sequence[AddedEffect]) -> LadderEntry:
    """Reference for the added effects: the last model without effects, with its free parameters fitted."""
    before = list(takewhile(lambda entry: not any(entry is effect.rung for effect in added), ladder))
    return before[-1] if before else ladder[0]


def misfit_reduction(first: float, last: float) -> float:
    """Relative reduction of the chi-square above the noise, from `first` to `last` (chi-square per sample)."""
    return (first - last) / (first - 1) if first > 1 else 0.0


def held_out_or_fitted(rung: LadderEntry) -> float:
    """Chi-square per sample of the held-out samples, or of the fitted samples without held-out ones."""
    return rung.chi2_held_out if rung.chi2_held_out == rung.chi2_held_out else rung.chi2_fit


def near_noise(rung: LadderEntry) -> bool:
    """True if both chi-squares per sample, on held-out and on fitted samples, are near 1."""
    return max(held_out_or_fitted(rung), rung.chi2_fit) <= DECISION.near


def unexplained(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage]) -> bool:
    """True if a residual above the noise remains that the findings do not explain."""
    return bool(steps) and steps[0].left.significant and not is_adequate(ladder, findings)


def verdict(base: Fit | None, ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
            shape: AddedEffect | None, adequacy: Adequacy | None = None, complete: bool = True) -> str:
    """Derive one of the seven verdicts; `complete` is True if fixed values and identified curves were tried."""
    if findings and _astray([without_effects(ladder, findings)]) and all(f.candidate.differs for f in findings):
        return "effect"  # a parameter of a held-out record differs
    if not steps[0].left.significant or (complete and shape is None and not findings and _refuted(steps)):
        if is_still(ladder[0]) or steps[0].partial or _astray(ladder):
            return "undetermined"
        return "parameters" if sheet_p_value(base) < CHANCE else "nothing"
    ended_above = bool(findings) and steps[-1].partial and held_out_or_fitted(findings[-1].rung) > DECISION.near
    if findings and is_adequate(ladder, findings) and not ended_above:
        if any(f.candidate.kind == VALUE for f in findings):
            return "parameters"
        return "effect" if all(f.certain for f in findings) else "one_of"
    so_far = steps[-1].partial or not complete
    if findings and adequacy is not None and (adequacy.stands or (so_far and not adequacy.beaten)) \
            and not predicts_nothing(ladder, findings):
        return "mainly"
    if steps[-1].partial or not (complete or shape is not None):
        return "undetermined"
    return "shape" if shape is not None or findings else "undetermined"


def _refuted(steps: Sequence[Stage]) -> bool:
    """True if a score was significant, but no refit is justified and chi-square is at the noise level. The p value of the
    score must exceed the p value that justifies an effect."""
    from scipy.special import chdtrc

    first = steps[0]
    return first.left.by_score_alone and first.left.score > float(chdtrc(1, EARNED)) and not steps[-1].partial \
        and is_noise(first.chi2_fit, first.chi2_held_out, first.samples_held_out)


def predicts_nothing(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect]) -> bool:
    """True if the model with the effects is hardly better than the mean values of the channels. (Within segments of the
    records it may still be right, if it reduces the error of the uninterrupted simulation.)"""
    last, before = findings[-1].rung, without_effects(ladder, findings)
    improved_segments = bool(last.comparison.experiment.horizons) and last.error_fit < before.error_fit
    return last.error_fit**2 > UNPREDICTED and not improved_segments


def is_still(rung: LadderEntry) -> bool:
    """True if the standard deviation of no channel exceeds a few times its noise."""
    return all(float(c.measured.std()) < STILL * c.noise for r in rung.comparison.records.values()
               for c in r.channels.values())


def _astray(ladder: Sequence[LadderEntry]) -> bool:
    """True if the residual of the best model is larger than noise on held-out samples, but not on fitted samples: then the
    fitted records do not show the missing effect."""
    best = min(ladder, key=held_out_or_fitted)
    return held_out_or_fitted(best) > DECISION.near * max(1.0, best.chi2_fit)


def sheet_p_value(base: Fit | None) -> float:
    """p value of the hypothesis that the values of the data sheet are right, from the likelihood ratio of the fitted
    parameters; 1 if no parameter is free."""
    from scipy.special import chdtrc

    if base is None:
        return 1.0
    before, _ = chi2_sum(base.before.experiment, [r for r in base.before.records.values() if r.use == "fit"])
    return float(chdtrc(len(base.parameters), max(0.0, before - base.chi2 * base.samples)))
