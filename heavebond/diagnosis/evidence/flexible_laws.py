"""Flexible laws as a reference for named laws.

A residual above the noise does not show that a named law is wrong, because another effect may be missing as well. The
reference is a flexible law: each identified curve of the library (nine coefficients of a smooth curve of one variable) is
fitted in place of the effect and compared by the same predictive errors. If the best curve at the same place explains most
of the residual of the named law, the law is not in the catalogue; otherwise the name holds. If a curve at another place
predicts as well as the named law, the place is uncertain. If it explains most of the residual, the missing effect is there.
An identified curve is valid only within the motion that it was fitted to: if too much of the held-out motion lies outside,
adequacy is not decided.

A curve with nine coefficients absorbs more than a law with one: the offset of an input, or a second effect. So law and curve
are compared in the diagram that contains all later effects. If the search for these was cut short, the curves are not used
as a reference.

The remainder is the law that explains most of the final residual. The unknown input is estimated at each place of the last
diagram, with all values at the fit, together with the law that it follows (see `localise`): a curve, a loop with a branch
for each direction of motion (memory), or a curve that a second variable changes. The law is regularised by cross-validation
within the fitted records. Its share of the residual is computed on held-out data only, where these lie within the fitted
range.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import number
from heavebond.core.progress import Progress
from heavebond.diagnosis.candidates.places import candidates
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.comparison import ALL, differs_materially, loss
from heavebond.diagnosis.evidence.prediction import PredictiveErrors, confidence_set
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.step import Stage, following, make_curve_stage
from heavebond.diagnosis.search.stepwise import Selection, without_effect
from heavebond.estimation.comparison import compare_record
from heavebond.estimation.experiment import Experiment
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.misfit import PlaceEstimate, localize, noun, shape_words
from heavebond.numerics.dae import Array
from heavebond.numerics.result import Probe


@dataclass(frozen=True)
class Adequacy:
    """Share of the misfit that the selected effects explain, and its comparison with identified curves.

    * explained: share of chi-square above the noise that the effects remove together, cross-validated and on held-out data.
    * flexible: the best-predicting identified curve at the place of the first effect, or one at another place that explains
      most of the residual of that curve.
    * elsewhere: another curve, at another place, that predicts as well as the effect or better.
    * beaten: True if the curve `flexible` explains most of the residual of the effect.
    * covered: share of the held-out motion inside the motion that this curve was fitted to (NaN without a curve).
    * complete: True if all candidates of the step and other values of fixed parameters were tried.
    * tried: True if all identified curves were tried.
    * law, curves: the refits of the effect and of all identified curves in its place, in the same diagram.
    """

    explained: float
    flexible: Refit | None = None
    elsewhere: Refit | None = None
    beaten: bool = False
    covered: float = float("nan")
    complete: bool = True
    tried: bool = True
    law: Refit | None = None
    curves: tuple[Refit, ...] = ()

    @property
    def decided(self) -> bool:
        """True if an identified curve is a valid reference: one exists, and it covers the held-out motion."""
        return self.flexible is not None and self.covered >= DECISION.covered  # False if `covered` is NaN

    @property
    def stands(self) -> bool:
        """True if the named effect holds although the residual exceeds the noise: it explains most of the misfit. After a
        search that was ended early, it must explain so much that no other candidate could explain materially more."""
        least = DECISION.mainly if self.complete else 1 - DECISION.material
        return self.explained >= least and not self.beaten

    def as_dict(self) -> dict[str, object]:
        """Return the figures for JSON."""
        def named(trial: Refit | None) -> dict[str, object] | None:
            return None if trial is None else {**trial.candidate.as_dict(), "chi2_held_out": trial.chi2_held_out}

        return {"explained": self.explained, "identified_curve": named(self.flexible), "elsewhere": named(self.elsewhere),
                "beaten": self.beaten, "covered": self.covered, "conclusive": self.decided, "complete": self.complete,
                "curves_tried": self.tried}


@dataclass(frozen=True)
class Comparand:
    """Data for the comparison with curves: the refit `law` with the effect, the predictive errors `before` without it, and
    the experiment without it but with all later effects."""

    law: Refit
    before: PredictiveErrors
    experiment: Experiment


def adequacy(chosen: Refit, stage: Stage, beside: Comparand, curves: Stage | None, complete: bool = True) -> Adequacy:
    """Compute the adequacy of a selection that begins with the stage `stage` and ends with the refit `chosen`.

    `curves` is the stage of identified curves in place of the first effect. `beside` contains the first effect, compared in
    the diagram with the later ones. `complete` as in `Adequacy`.
    """
    assert stage.errors is not None
    misfit = stage.errors.mean(*ALL) - 1.0
    excess = loss(chosen) - 1.0
    explained = (misfit - excess) / misfit if misfit > 0 else 0.0
    law = beside.law
    trials = [t for t in curves.trials if t.errors is not None and loss(t) < beside.before.mean(*ALL)] \
        if curves is not None else []
    law_place = curves.places.place(law.candidate) if curves is not None and trials else None
    at_own = [curves is not None and curves.places.place(t.candidate) == law_place for t in trials]
    at_place = min((t for t, at in zip(trials, at_own, strict=True) if at), key=loss, default=None)
    at_other_place = min((t for t, at in zip(trials, at_own, strict=True) if not at and _as_good(t, law, misfit)), key=loss,
                         default=None)
    covered = coverage(at_place, beside.experiment) if at_place is not None else float("nan")
    beaten = at_place is not None and covered >= DECISION.covered and _explains_most(at_place, law)
    rival = at_place if beaten and at_place is not None else law
    if at_other_place is not None and _explains_most(at_other_place, rival) \
            and (so_far := coverage(at_other_place, beside.experiment)) >= DECISION.covered:  # simulates all records
        at_place, at_other_place, beaten, covered = at_other_place, None, True, so_far
    return Adequacy(explained, at_place, at_other_place, beaten, covered, complete,
                    curves is not None and not curves.partial, law,
                    tuple(t for t in curves.trials if t.errors is not None) if curves is not None else ())


def _explains_most(curve: Refit, law: Refit) -> bool:
    """True if an identified curve explains most of the residual of a law above the noise."""
    return better(curve, law) and loss(law) - loss(curve) > DECISION.mainly * max(loss(law) - 1.0, 0.0) > 0


def better(refit: Refit, reference: Refit) -> bool:
    """True if the predictive errors of one refit are significantly smaller than the errors of another."""
    assert refit.errors is not None and reference.errors is not None
    if loss(refit) >= loss(reference):
        return False
    return 1 not in confidence_set(np.array([refit.errors.sums, reference.errors.sums]), refit.errors.counts,
                                   refit.errors.stretch)


def _as_good(curve: Refit, named: Refit, misfit: float) -> bool:
    """True if a curve at another place predicts as well as the named effect.

    This is the case if its residual is not materially larger. It is also the case if the residual is not significantly
    larger and the curve explains at least the share `DECISION.mainly` of the misfit that the effect explains.
    """
    explained, explained_by_curve = misfit + 1.0 - loss(named), misfit + 1.0 - loss(curve)
    return loss(curve) <= loss(named) or not differs_materially(named, curve, misfit) \
        or (not better(named, curve) and explained_by_curve >= DECISION.mainly * explained)


def coverage(curve: Refit, before: Experiment) -> float:
    """Share of the held-out times at which the variable of an identified curve lies inside its range on the fitted records.

    `before` is the experiment without the curve. NaN if the share cannot be computed.
    """
    candidate = next((c for c in candidates(before) if c.label == curve.candidate.label), None)
    variables = list(dict.fromkeys(name for n in (candidate.numbers if candidate is not None else ()) for name in n.motions))
    if not variables:
        return float("nan")
    experiment = curve.experiment
    courses: dict[bool, list[Array]] = {True: [], False: []}
    try:
        for record in experiment.records.values():
            known = {n: v for n, v in curve.values.items() if not n.startswith("initial.")}
            compared = compare_record(experiment, record, known)
            values = Probe(compared.result.assembly, variables, si=True).values(compared.result)
            part = compared.validate  # held-out last part of a single record
            begin = np.inf if part is None else min(float(c.time[c.counts][0]) for c in part.channels.values())
            later = (compared.result.time >= begin) | (record.use != "fit")
            for fitted, samples in ((True, ~later), (False, later)):
                courses[fitted].append(values[:, samples].ravel())
    except HeavebondError:
        return float("nan")
    fitted_values, held = np.concatenate(courses[True]), np.concatenate(courses[False])
    return float(np.mean((held >= fitted_values.min()) & (held <= fitted_values.max()))) if len(held) else 1.0


def judged(selection: Selection, complete: bool, tried: bool, number: int | None, seconds: float, say: Progress
           ) -> tuple[Adequacy, Stage | None]:
    """Compute the adequacy of the first effect of a selection, and the stage of identified curves used as reference.

    The stage is None if it was not completed within `seconds`, or if `tried` is False: then no curves are fitted. `complete`
    as in `Adequacy`.
    """
    law, curves = _alone(selection), None
    if tried:
        # the law is compared in the diagram with the other effects; without them if they cannot be fitted without it
        remaining = without_effect(selection, 0, say) if len(selection) > 1 else None
        if remaining is not None and remaining[-1].chosen.errors is not None:
            exact = replace(selection[-1].chosen, candidate=selection[0].candidate)
            law = Comparand(exact, remaining[-1].chosen.errors, following(remaining[-1].step))
        curves = make_curve_stage(law.experiment, beside=[t.candidate for t in selection[0].alternatives], number=number,
                                  seconds=seconds, progress=lambda text: say(f"identified curves: {text}"))
    assessment = adequacy(selection[-1].chosen, selection[0].step, law, curves, complete)
    return assessment, curves if curves is not None and not curves.partial else None


def adequacy_alone(selection: Selection, complete: bool) -> Adequacy:
    """Adequacy of the first effect of a selection, without identified curves."""
    return adequacy(selection[-1].chosen, selection[0].step, _alone(selection), None, complete)


def curve_alone(selection: Selection, number: int | None, seconds: float, say: Progress
                ) -> tuple[Refit | None, Stage | None]:
    """Find the identified curve that, without any effect of the selection, predicts significantly better than all effects
    together.

    Return the curve and the stage of curves. The curve is None if none is better; both are None if not all curves were tried
    within `seconds`.
    """
    curves = make_curve_stage(selection[0].step.experiment, beside=[t.candidate for t in selection[0].alternatives],
                              number=number, seconds=seconds, progress=lambda text: say(f"identified curves: {text}"))
    if curves.partial:
        return None, None
    best = min((t for t in curves.trials if t.errors is not None), key=loss, default=None)
    return (best if best is not None and better(best, selection[-1].chosen) else None), curves


def _alone(selection: Selection) -> Comparand:
    step = selection[0].step
    assert step.errors is not None
    return Comparand(selection[0].chosen, step.errors, step.experiment)


OTHER_CAUSES = "Noise of a measured input (give its `noise:`), the dynamics of a sensor, or parameters that change with " \
    "time or temperature leave such a residual."


@dataclass(frozen=True)
class Remainder:
    """The law that acts in the final residual.

    * missing: True if parameters and noise do not explain the residual.
    * place: the most likely place with its law; None if no place has a law.
    """

    missing: bool
    place: PlaceEstimate | None

    @property
    def share(self) -> float:
        """Share of the residual above the noise that the law removes on held-out data."""
        return max(0.0, self.place.curve.r2) if self.place is not None and self.place.curve is not None else 0.0

    @property
    def covered(self) -> float:
        """Share of the held-out motion inside the motion of the fitted records (NaN without a law)."""
        return self.place.curve.covered if self.place is not None and self.place.curve is not None else float("nan")

    @property
    def decided(self) -> bool:
        """True if the law is a valid reference: it predicts significantly better than the model without it, within the
        fitted motion."""
        curve = self.place.curve if self.place is not None else None
        return curve is not None and curve.chance < DECISION.level and curve.covered >= DECISION.covered

    @property
    def words(self) -> str:
        """The remainder in a sentence."""
        place = self.place
        if place is None or place.curve is None:
            return "The residual acts as no force or flow at any place of the diagram."
        curve, percent = place.curve, number(100 * self.share, 2)
        if not self.decided:
            why = f"{number(100 * curve.covered, 2)} % of the held-out motion is inside the range of the fitted records" \
                if curve.covered < DECISION.covered else "none predicts held-out data better than the model without it"
            return f"Whether a law of one or two variables at some place would explain the residual is not decided: {why}."
        law = f"a {noun(place)} {place.place.words} that follows the {curve.variable.phrase}, {shape_words(curve)}"
        if curve.r2 < INPUT_ESTIMATION.explains:
            return "No law of one or two variables at any place explains most of the residual: the best is " \
                   f"{law}, with {percent} % of it on held-out data."
        return f"With the parameters at their values, {law}, would explain most of the residual ({percent} % of it on " \
            "held-out data)."

    def as_dict(self) -> dict[str, object]:
        """Return the figures for JSON."""
        curve = self.place.curve if self.place is not None else None
        return {"explained": self.share, "covered": self.covered, "conclusive": self.decided,
                "law": None if self.place is None or curve is None else
                {"where": [n.name for n in self.place.place.nodes], "over": curve.variable.formula,
                 "second": curve.times or (curve.second.formula if curve.second is not None else None),
                 "follows": curve.shape}}


def remainder(experiment: Experiment, say: Progress) -> Remainder | None:
    """Compute the remainder of an experiment whose diagram contains all selected effects at their fitted values. None if the
    records cannot be simulated with this diagram."""
    try:
        localization = localize(experiment, progress=lambda text: say(f"residual: {text}"), besides=())
    except HeavebondError:
        return None
    likely = [s for s in localization.suspects if s.behind < INPUT_ESTIMATION.distinct and s.curve is not None]
    best = max(likely, key=lambda s: s.curve.r2 if s.curve is not None else 0.0, default=None)
    return Remainder(localization.missing, best)
