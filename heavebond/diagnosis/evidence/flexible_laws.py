"""Flexible laws as a reference for named laws.

The residual of a named law alone does not speak against the name: another effect may be missing as well. The reference is a
flexible law: the identified curves of the library (nine coefficients of a smooth curve of one variable), each fitted in
place of the effect and judged by the same predictive errors. If the best of them at the same place explains most of the
residual of the named law, the law is not in the catalogue; otherwise the name holds. If a curve at another place does as
well as the name, the place is uncertain; if it explains most of the residual, the missing effect is there. An identified
curve is valid only within the motion that it was fitted to: if too much of the held-out motion lies outside, adequacy is
not decided.

A curve of nine coefficients absorbs more than a law of one: the offset of an input, a second effect. So law and curve are
compared in the diagram that contains all later effects; if the search for these was cut short, the curves are no reference.

The remainder is the law that explains most of the final residual: the unknown input at each place of the last diagram, with
all values at the fit, and the law that it follows (see `localise`): a curve, a loop with a branch for each direction of
motion (memory), or a curve that a second variable changes. It is regularised by cross-validation within the fitted records,
and counts on held-out data alone, as far as these move within the fitted range.
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
    """How far the selected effects explain the misfit.

    explained: share of chi-square above the noise that they take away together, cross-validated and on held-out data;
    flexible: the identified curve at the place of the first effect that predicts best, or one at another place that explains
    most of what the best there leaves; elsewhere: another one at another place that predicts as well as the effect or
    better; beaten: whether the curve `flexible` explains most of what the effect leaves; covered: share of the held-out
    motion that lies inside the motion that this curve was fitted to (NaN without one); complete: whether all candidates of
    the step, and other values of fixed parameters, were tried beside the effect; tried: whether all identified curves were;
    law, curves: the refit of the effect and those of all identified curves in its place, in the same diagram.
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
        """Whether a flexible law was a yardstick: there is one, and it covers the held-out motion."""
        return self.flexible is not None and self.covered >= DECISION.covered  # (NaN: it could not be told)

    @property
    def stands(self) -> bool:
        """Whether the name stands, although more than noise is left: the effect explains most of the misfit (after a search
        that was ended early so much that no other candidate could explain materially more)."""
        least = DECISION.mainly if self.complete else 1 - DECISION.material
        return self.explained >= least and not self.beaten

    def as_dict(self) -> dict[str, object]:
        """The figures, for machines."""
        def named(trial: Refit | None) -> dict[str, object] | None:
            return None if trial is None else {**trial.candidate.as_dict(), "chi2_held_out": trial.chi2_held_out}

        return {"explained": self.explained, "identified_curve": named(self.flexible), "elsewhere": named(self.elsewhere),
                "beaten": self.beaten, "covered": self.covered, "conclusive": self.decided, "complete": self.complete,
                "curves_tried": self.tried}


@dataclass(frozen=True)
class Comparand:
    """What curves in the place of an effect are compared with: the refit with the effect, the predictive errors without it,
    and the experiment without it, which has all effects found after it."""

    law: Refit
    before: PredictiveErrors
    experiment: Experiment


def adequacy(chosen: Refit, made: Stage, beside: Comparand, curves: Stage | None, complete: bool = True) -> Adequacy:
    """That of a selection that begins at the stage `made` and ends with the refit `chosen`; `curves` is the stage of
    identified curves in the place of its first effect, which is compared as it is `beside` the later ones; `complete` as in
    `Adequacy`."""
    assert made.errors is not None
    misfit = made.errors.mean(*ALL) - 1.0
    left = loss(chosen) - 1.0
    explained = (misfit - left) / misfit if misfit > 0 else 0.0
    law = beside.law
    trials = [t for t in curves.trials if t.errors is not None and loss(t) < beside.before.mean(*ALL)] \
        if curves is not None else []
    own = curves.places.place(law.candidate) if curves is not None and trials else None
    at_own = [curves is not None and curves.places.place(t.candidate) == own for t in trials]
    here = min((t for t, at in zip(trials, at_own, strict=True) if at), key=loss, default=None)
    there = min((t for t, at in zip(trials, at_own, strict=True) if not at and _as_good(t, law, misfit)), key=loss,
                default=None)
    covered = coverage(here, beside.experiment) if here is not None else float("nan")
    beaten = here is not None and covered >= DECISION.covered and _explains_most(here, law)
    rival = here if beaten and here is not None else law
    if there is not None and _explains_most(there, rival) \
            and (so_far := coverage(there, beside.experiment)) >= DECISION.covered:  # (which takes runs of all records)
        here, there, beaten, covered = there, None, True, so_far
    return Adequacy(explained, here, there, beaten, covered, complete, curves is not None and not curves.partial, law,
                    tuple(t for t in curves.trials if t.errors is not None) if curves is not None else ())


def _explains_most(curve: Refit, law: Refit) -> bool:
    """Whether an identified curve explains most of what a law leaves above the noise."""
    return better(curve, law) and loss(law) - loss(curve) > DECISION.mainly * max(loss(law) - 1.0, 0.0) > 0


def better(one: Refit, other: Refit) -> bool:
    """Whether the predictive errors of one are significantly smaller than those of another."""
    assert one.errors is not None and other.errors is not None
    if loss(one) >= loss(other):
        return False
    found = confidence_set(np.array([one.errors.sums, other.errors.sums]), one.errors.counts, one.errors.stretch)
    return 1 not in found


def _as_good(curve: Refit, named: Refit, misfit: float) -> bool:
    """Whether a curve at another place predicts as well as the named effect: it does not leave materially more, or not
    significantly more and explains at least half of what that explains, as any candidate of the set."""
    explained, other = misfit + 1.0 - loss(named), misfit + 1.0 - loss(curve)
    return loss(curve) <= loss(named) or not differs_materially(named, curve, misfit) \
        or (not better(named, curve) and other >= DECISION.mainly * explained)


def coverage(curve: Refit, before: Experiment) -> float:
    """The share of the held-out times at which the variable of an identified curve lies inside its range on the fitted
    records; `before` is the experiment without the curve. NaN where it cannot be told."""
    found = next((c for c in candidates(before) if c.label == curve.candidate.label), None)
    variables = list(dict.fromkeys(name for n in (found.numbers if found is not None else ()) for name in n.motions))
    if not variables:
        return float("nan")
    experiment = curve.experiment
    courses: dict[bool, list[Array]] = {True: [], False: []}
    try:
        for record in experiment.records.values():
            known = {n: v for n, v in curve.values.items() if not n.startswith("initial.")}
            compared = compare_record(experiment, record, known)
            values = Probe(compared.result.assembly, variables, si=True).values(compared.result)
            part = compared.validate  # the last part of a lone record
            begin = np.inf if part is None else min(float(c.time[c.counts][0]) for c in part.channels.values())
            later = (compared.result.time >= begin) | (record.use != "fit")
            for fitted, which in ((True, ~later), (False, later)):
                courses[fitted].append(values[:, which].ravel())
    except HeavebondError:
        return float("nan")
    seen, held = np.concatenate(courses[True]), np.concatenate(courses[False])
    return float(np.mean((held >= seen.min()) & (held <= seen.max()))) if len(held) else 1.0


def judged(way: Selection, complete: bool, tried: bool, number: int | None, seconds: float, say: Progress
           ) -> tuple[Adequacy, Stage | None]:
    """The adequacy of the first effect of a ladder, and the stage of identified curves by which it was judged; None where
    that was not made to its end in `seconds`, or not `tried` at all. `complete` as in `Adequacy`."""
    law, curves = _compared(way, number, seconds, say) if tried else (_alone(way), None)
    made = adequacy(way[-1].chosen, way[0].step, law, curves, complete)
    return made, curves if curves is not None and not curves.partial else None


def adequacy_alone(way: Selection, complete: bool) -> Adequacy:
    """The adequacy of the first effect of a selection without any identified curve."""
    return adequacy(way[-1].chosen, way[0].step, _alone(way), None, complete)


def curve_alone(way: Selection, number: int | None, seconds: float, say: Progress) -> tuple[Refit | None, Stage | None]:
    """The identified curve that alone, without the effects of a ladder, leaves significantly less than these do together,
    and the stage of curves; None where there is no such curve, or where not all were tried in `seconds`."""
    made = make_curve_stage(way[0].step.experiment, beside=[t.candidate for t in way[0].alternatives], number=number,
                            seconds=seconds, progress=lambda text: say(f"identified curves: {text}"))
    if made.partial:
        return None, None
    best = min((t for t in made.trials if t.errors is not None), key=loss, default=None)
    return (best if best is not None and better(best, way[-1].chosen) else None), made


def _alone(way: Selection) -> Comparand:
    step = way[0].step
    assert step.errors is not None
    return Comparand(way[0].chosen, step.errors, step.experiment)


def _compared(way: Selection, number: int | None, seconds: float, say: Progress) -> tuple[Comparand, Stage]:
    """The first effect as it is beside the others, and the curves in its place; alone if the others cannot be fitted without
    it."""
    law = _alone(way)
    if len(way) > 1:
        others = without_effect(way, 0, say)
        if others is not None and others[-1].chosen.errors is not None:
            exact = replace(way[-1].chosen, candidate=way[0].candidate)
            law = Comparand(exact, others[-1].chosen.errors, following(others[-1].step))
    return law, make_curve_stage(law.experiment, beside=[t.candidate for t in way[0].alternatives], number=number,
                                 seconds=seconds, progress=lambda text: say(f"identified curves: {text}"))


OTHER_CAUSES = "Noise of a measured input (give its `noise:`), the dynamics of a sensor, or parameters that change with " \
    "time or temperature leave such a residual."


@dataclass(frozen=True)
class Remainder:
    """What acts in the residual. missing: whether there is more than parameters and noise; place: the likeliest place with
    the law that acts there, None where no place is left or none has a variable."""

    missing: bool
    place: PlaceEstimate | None

    @property
    def share(self) -> float:
        """The share of the residual above the noise that the law removes on held-out data."""
        return max(0.0, self.place.curve.r2) if self.place is not None and self.place.curve is not None else 0.0

    @property
    def covered(self) -> float:
        """The share of the held-out motion inside that of the fitted records (NaN without a law)."""
        return self.place.curve.covered if self.place is not None and self.place.curve is not None else float("nan")

    @property
    def decided(self) -> bool:
        """Whether the law is a yardstick: it predicts better than the model without it, within the motion fitted."""
        curve = self.place.curve if self.place is not None else None
        return curve is not None and curve.chance < DECISION.level and curve.covered >= DECISION.covered

    @property
    def words(self) -> str:
        """It in a sentence."""
        place = self.place
        if place is None or place.curve is None:
            return "The residual acts as no force or flow at any place of the diagram."
        curve, percent = place.curve, number(100 * self.share, 2)
        if not self.decided:
            why = f"{number(100 * curve.covered, 2)} % of the held-out motion is inside the range of the fitted records" \
                if curve.covered < DECISION.covered else "none predicts held-out data better than the model without it"
            return f"Whether a law of one or two variables at some place would explain the residual is not decided: {why}."
        said = f"a {noun(place)} {place.place.words} over the {curve.variable.phrase}, {shape_words(curve)}"
        if curve.r2 < INPUT_ESTIMATION.explains:
            return "No law of one or two variables at any place explains most of the residual: the best is " \
                   f"{said}, with {percent} % of it on held-out data."
        return f"Most of the residual is {said} ({percent} % of it on held-out data)."

    def as_dict(self) -> dict[str, object]:
        """The figures, for machines."""
        curve = self.place.curve if self.place is not None else None
        return {"explained": self.share, "covered": self.covered, "conclusive": self.decided,
                "law": None if self.place is None or curve is None else
                {"where": [n.name for n in self.place.place.nodes], "over": curve.variable.formula,
                 "second": curve.times or (curve.second.formula if curve.second is not None else None),
                 "follows": curve.shape}}


def remainder(experiment: Experiment, say: Progress) -> Remainder | None:
    """That of an experiment whose diagram has all that was found, at its fitted values; None where the records cannot be
    simulated with it."""
    try:
        found = localize(experiment, progress=lambda text: say(f"what is left: {text}"), besides=())
    except HeavebondError:
        return None
    likely = [s for s in found.suspects if s.behind < INPUT_ESTIMATION.distinct and s.curve is not None]
    return Remainder(found.missing, max(likely, key=lambda s: s.curve.r2 if s.curve is not None else 0.0, default=None))
