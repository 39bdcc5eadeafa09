"""The result of a diagnosis as one of seven verdicts.

nothing: the residual is noise. parameters: their values were wrong, no physics is missing; of what is free, or of a value
that the diagram holds fixed. effect: this effect, at this place. one_of: one of these, which the records cannot distinguish.
mainly: this effect (or one of these) explains most of the misfit, and more is missing. shape: an effect that the catalogue
lacks; a place and a curve. undetermined: not decided by these records.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile

from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.flexible_laws import Adequacy
from heavebond.diagnosis.evidence.residual_tests import is_noise
from heavebond.diagnosis.search.step import EARNED, Stage
from heavebond.diagnosis.state import AddedEffect, LadderEntry
from heavebond.estimation.fitting import Fit

CHANCE = 0.005  # p value below which fitted parameters are better than those of the data sheet
STILL = 3.0  # channels whose own motion is below this many times their noise tell nothing



def is_adequate(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect]) -> bool:
    """Whether the model with all findings leaves no more than noise: the given one, or near it after one effect that took
    most of the misfit away (several, each of which corrects what another does wrong, come near it with wrong names as well),
    or near an estimated one. Not with a number at an end of the range in which it was sought, beyond which the error would
    fall: then what was fitted is not the minimum."""
    if any(f.beyond for f in findings):
        return False
    last = findings[-1].rung if findings else ladder[-1]
    if not findings or not last.comparison.experiment.noise_given:
        return held_out_or_fitted(last) <= DECISION.near
    if is_noise(last.chi2_fit, last.chi2_held_out, last.samples_held_out):
        return True
    first = min(held_out_or_fitted(r) for r in takewhile(lambda r: r is not findings[0].rung, ladder))
    return len(findings) == 1 and near_noise(last) and gone(first, held_out_or_fitted(last)) >= DECISION.mainly


def without_effects(ladder: Sequence[LadderEntry], added: Sequence[AddedEffect]) -> LadderEntry:
    """The model that the added effects are compared with: the last one without any, its free parameters fitted."""
    before = list(takewhile(lambda entry: not any(entry is effect.rung for effect in added), ladder))
    return before[-1] if before else ladder[0]


def gone(first: float, last: float) -> float:
    """The share of what is above the noise that is taken away."""
    return (first - last) / (first - 1) if first > 1 else 0.0


def held_out_or_fitted(rung: LadderEntry) -> float:
    """Chi-square per sample of what was not fitted; where that is nothing, of what was."""
    return rung.chi2_held_out if rung.chi2_held_out == rung.chi2_held_out else rung.chi2_fit


def near_noise(rung: LadderEntry) -> bool:
    """Whether what a model leaves, on what was and was not fitted, is near the noise."""
    return max(held_out_or_fitted(rung), rung.chi2_fit) <= DECISION.near


def unexplained(ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage]) -> bool:
    """Whether more than noise is left that no name explains."""
    return bool(steps) and steps[0].left.significant and not is_adequate(ladder, findings)


def verdict(base: Fit | None, ladder: Sequence[LadderEntry], findings: Sequence[AddedEffect], steps: Sequence[Stage],
            shape: AddedEffect | None, adequacy: Adequacy | None = None, complete: bool = True) -> str:
    """One of the seven; `complete`: all that could name what is left was tried."""
    if findings and _astray([without_effects(ladder, findings)]) and all(f.candidate.differs for f in findings):
        return "effect"  # a held-out record differs in a parameter
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
    if findings and adequacy is not None and (adequacy.stands or (so_far and not adequacy.beaten)):
        return "mainly"
    if steps[-1].partial or not (complete or shape is not None):
        return "undetermined"
    return "shape" if shape is not None or findings else "undetermined"


def _refuted(steps: Sequence[Stage]) -> bool:
    """Whether a score was larger than by chance, but not by so little chance as the fall that justifies an effect, no refit
    justifies one, and all else says noise."""
    from scipy.special import chdtrc

    first = steps[0]
    return first.left.by_score_alone and first.left.score > float(chdtrc(1, EARNED)) and not steps[-1].partial \
        and is_noise(first.chi2_fit, first.chi2_held_out, first.samples_held_out)


def is_still(rung: LadderEntry) -> bool:
    """Whether no channel moves by more than a few times its noise."""
    return all(float(c.measured.std()) < STILL * c.noise for r in rung.comparison.records.values()
               for c in r.channels.values())


def _astray(ladder: Sequence[LadderEntry]) -> bool:
    """Whether what was fitted shows no more than noise, but what was not does: too little was fitted to see more."""
    best = min(ladder, key=held_out_or_fitted)
    return held_out_or_fitted(best) > DECISION.near * max(1.0, best.chi2_fit)


def sheet_p_value(base: Fit | None) -> float:
    """The p value of the hypothesis that the values of the data sheet are right, by the likelihood ratio of the fitted
    parameters; 1 where nothing is free."""
    from scipy.special import chdtrc

    if base is None:
        return 1.0
    before = sum(float(c.chi2 * c.counts.sum()) for r in base.before.records.values() if r.use == "fit"
                 for c in r.channels.values())
    return float(chdtrc(len(base.parameters), max(0.0, before - base.chi2 * base.samples)))
