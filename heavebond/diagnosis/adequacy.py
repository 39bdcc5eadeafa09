"""Is that all? How much of the misfit an effect explains, and whether any law at its place could explain more.

What a named law leaves above the noise says nothing about the name: another effect may be missing besides. The yardstick
is a flexible law: the identified curves of the library (nine coefficients of a smooth curve of one variable), each fitted in
place of the effect and judged by the same predictive errors. Where the best of them at the same place explains most of what
the named law leaves, the law is none of the catalogue; where it does not, the name stands, whatever is left. Where one at
another place does as well as the name, the place is uncertain, and where it explains most of what the name leaves, what is
missing is there. An identified curve tells nothing outside the motion that it was fitted to: where too much of the held-out
motion lies outside of that, adequacy is not decided.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.confidence_set import confidence_set
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.identity import ALL, loss
from heavebond.diagnosis.like_places import candidates
from heavebond.diagnosis.predictive_errors import PredictiveErrors
from heavebond.diagnosis.refit import Refit
from heavebond.diagnosis.stage import Stage
from heavebond.estimation.comparison import compare_record
from heavebond.estimation.experiment import Experiment
from heavebond.numerics.dae import Array
from heavebond.numerics.result import Probe


@dataclass(frozen=True)
class Adequacy:
    """How far an effect explains the misfit.

    explained: share of chi-square above the noise that it takes away, cross-validated and on held-out data; flexible:
    the identified curve at its place that predicts best, or one at another place that explains most of what the best there
    leaves; elsewhere: another one at another place that predicts as well as the effect or better; beaten: whether the curve
    `flexible` explains most of what the effect leaves; covered: share of the held-out motion that lies inside the motion
    that this curve was fitted to (NaN without one); complete: whether all
    candidates of its step, and other values of what is held fixed, were tried beside the effect; tried: whether all
    identified curves were.
    """

    explained: float
    flexible: Refit | None = None
    elsewhere: Refit | None = None
    beaten: bool = False
    covered: float = float("nan")
    complete: bool = True
    tried: bool = True

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
    """That of the effect `chosen` at a stage; `curves` is the stage of identified curves in the place of the effect, which
    is judged as it is `beside` what was found later; `complete` as in `Adequacy`."""
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
    return Adequacy(explained, here, there, beaten, covered, complete, curves is not None and not curves.partial)


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
    """Whether a curve at another place predicts as well as the named effect: it leaves less, or more by no material share of
    the misfit, or not significantly more and explains at least half of what that explains, as any candidate of the set."""
    explained, other = misfit + 1.0 - loss(named), misfit + 1.0 - loss(curve)
    return loss(curve) - loss(named) <= DECISION.material * misfit \
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
