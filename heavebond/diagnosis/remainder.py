"""What is left after the effects that were found, if any: the law of one or two variables that explains most of it.

The yardstick of the whole ladder, beside the identified curves of one variable that stand in place of an effect (see
`adequacy`): the unknown input at each place of the last diagram, with everything at its fitted values, and the law that it
follows (see `localise`): a curve, a loop with a branch for each direction of motion (memory), or a curve that a second
variable changes. It is regularised by cross-validation within the fitted records, and counts on held-out data alone, as far
as these move within what was fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import number
from heavebond.core.progress import Progress
from heavebond.diagnosis.decision import DECISION
from heavebond.estimation.experiment import Experiment
from heavebond.localise.constants import INPUT_ESTIMATION
from heavebond.localise.misfit import PlaceEstimate, localize, noun, shape_words

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
            return "What is left acts as no force or flow at any place of the diagram."
        curve, percent = place.curve, number(100 * self.share, 2)
        if not self.decided:
            why = f"{number(100 * curve.covered, 2)} % of the held-out motion lies within that of the fitted records" \
                if curve.covered < DECISION.covered else "none predicts held-out data better than the model without it"
            return f"Whether a law of one or two variables at some place would explain what is left is not decided: {why}."
        said = f"a {noun(place)} {place.place.words} over the {curve.variable.phrase}, {shape_words(curve)}"
        if curve.r2 < INPUT_ESTIMATION.explains:
            return "No law of one or two variables at any place explains most of what is left: the best is " \
                   f"{said}, with {percent} % of it on held-out data."
        return f"Most of what is left is {said} ({percent} % of it on held-out data)."

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
