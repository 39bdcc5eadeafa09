"""Which effects found after the first one are named where more than noise is left.

No law is exact, and a residual of a few per cent of the misfit may be the error of the laws that were found, which another
law may imitate well on all records of one kind. So a further effect is named only where the model with all effects leaves
the noise that is given, and left more than `near` before it (what is near it already is within the error of that noise,
too), or where it

* takes away a material share of the misfit of the model without any effect, and
* is a constant of the machine: its strength is the same at small and at large motion (see `constancy`).

(An estimated noise is no yardstick for that: it is too large where a channel moves far between two samples.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import number
from heavebond.core.progress import Progress
from heavebond.diagnosis.constancy import Constancy, constancy
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.identity import leaves_noise
from heavebond.diagnosis.stage import fitted_base, following
from heavebond.diagnosis.stepwise_selection import SelectedEffect, Selection
from heavebond.diagnosis.verdict_words import called


@dataclass(frozen=True)
class Unsupported:
    """A further effect that is not named: the share of the first misfit (chi-square above the noise) that it takes away, and
    its strength over the amplitude, where that was asked for; `fitted`: whether the share is small on fitted data only."""

    added: SelectedEffect
    share: float
    constancy: Constancy | None
    fitted: bool = False

    @property
    def words(self) -> str:
        """Why, in a sentence."""
        step, chosen = self.added.step, self.added.chosen
        held = step.chi2_held_out == step.chi2_held_out  # (NaN: nothing is held out)
        before, after = (step.chi2_held_out, chosen.chi2_held_out) if held else (step.chi2_fit, chosen.chi2_fit)
        said = f"{called(self.added.candidate)} would lower the reduced chi-square from {number(before, 3)} to " \
               f"{number(after, 3)}, but is not named: "
        if self.constancy is None:
            share = number(100 * DECISION.material, 2)
            there = f" of the fitted data ({number(step.chi2_fit, 3)} to {number(chosen.chi2_fit, 3)})"
            where = there if self.fitted else ""
            return said + f"it takes away less than {share} % of the misfit{where}, within the error of the laws that " \
                "were found."
        low, high = min(self.constancy.strength), max(self.constancy.strength)
        return said + "its strength is not the same at small and large motion " \
                      f"({number(low, 2)} to {number(high, 2)} times the fitted one where it may vary)."


def supported(way: Selection, say: Progress, looked_back: Callable[[Selection], Selection] = lambda way: way
              ) -> tuple[Selection, list[Unsupported]]:
    """The effects of a ladder that are named, and those at its end that are not, the last one first. What remains without
    one is `looked_back` on: what it may be was judged beside what is not named."""
    dropped: list[Unsupported] = []
    while len(way) > 1 and not _reaches_the_noise(way[-1]):
        share, found = material_share(way), None
        if share >= DECISION.material:
            say(f"is {way[-1].candidate.label} the same at all amplitudes?")
            found = _constancy(way[-1])
            if found is None or not found.differs:
                break
        dropped.append(Unsupported(way[-1], share, found, _shares(way)[1] >= DECISION.material))
        way = looked_back(way[:-1])
    return way, dropped


def _reaches_the_noise(added: SelectedEffect) -> bool:
    """Whether the given noise is left with an effect, and clearly more than that without it."""
    before = added.step.chi2_held_out if added.step.samples_held_out else added.step.chi2_fit
    return added.chosen.experiment.noise_given and leaves_noise(added.chosen) and before > DECISION.near


def material_share(way: Selection) -> float:
    """The share of the first misfit (chi-square above the noise) that the last effect of a ladder takes away: the smaller of
    that on fitted and that on held-out data; that on held-out data where the fitted data are near their noise without it,
    as they are where free parameters take its part in them. (Errors predicted without a block of time are no measure of it:
    where a block alone determines a number of the effect, as a rim that is met once, they are too large.)"""
    fitted, held = _shares(way)
    if held != held:  # (NaN: nothing is held out)
        return fitted
    return held if way[-1].step.chi2_fit <= DECISION.near else min(fitted, held)


def _shares(way: Selection) -> tuple[float, float]:
    """The shares of the first misfit that the last effect takes away, on fitted and on held-out data (NaN without these)."""
    first, last = way[0].step, way[-1]
    return ((last.step.chi2_fit - last.chosen.chi2_fit) / max(first.chi2_fit - 1.0, 1e-9),
            (last.step.chi2_held_out - last.chosen.chi2_held_out) / max(first.chi2_held_out - 1.0, 1e-9))


def _constancy(added: SelectedEffect) -> Constancy | None:
    try:
        return constancy(fitted_base(following(added.step)), added.candidate.numbers)
    except HeavebondError:
        return None
