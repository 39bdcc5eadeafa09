"""What a diagnosis says where its time was over, or it was ended by Ctrl-C, before all was tried."""

from __future__ import annotations

import math
from collections.abc import Sequence

from heavebond.core.cancellation import ENDED_EARLY
from heavebond.core.errors import listing
from heavebond.core.presentation import count as counted
from heavebond.core.presentation import number
from heavebond.diagnosis.ladder import LadderEntry
from heavebond.diagnosis.stage import Stage
from heavebond.estimation.fitting import Fit

# What a search may leave out, in its order.
EFFECTS = "effects of the catalogue"
CALIBRATION = "offsets and gains of inputs and channels beside the leading effects"
FURTHER, VALUES = "further effects", "other values of what the diagram holds fixed"
CURVES = "identified curves in place of an effect"
MORE_TIME = "More time: `--seconds`. Less to do: `--samples`, `--only CLASS`, or `from:` and `to:` at a record."


def before_search(ladder: Sequence[LadderEntry], base: Fit | None) -> tuple[str, ...]:
    """The answer of a search that was ended before its first candidate was scored."""
    if not ladder:
        return "No conclusion yet: the search was ended before the model was simulated on all records. Nothing is known.", \
            MORE_TIME
    lines = ["No conclusion yet: the search was ended before the first candidate was scored. Known is how far the diagram "
             "is from the records" + ("." if base is None else ", before and after the fit of the free parameters.")]
    if base is not None and was_ended(base):
        lines.append(f"The fit was ended too, after {counted(len(base.history), 'run')}: its values are the best so far.")
    return *lines, MORE_TIME


def was_ended(fit: Fit) -> bool:
    """Whether a fit was ended before it came to its end."""
    return fit.message == ENDED_EARLY


def so_far(steps: Sequence[Stage], untried: Sequence[str]) -> list[str]:
    """How far a search came that was ended early: candidates scored and refitted in the step that was cut short, what leads
    there, and what was not tried at all."""
    cut = next((k for k, step in enumerate(steps, 1) if step.partial), 0)
    lines = [_cut_short(steps[cut - 1], f"In step {cut}" if len(steps) > 1 else "So far")] if cut else []
    return [*lines, *([f"Not tried, as the search was ended early: {listing(untried, len(untried))}."] if untried else [])]


def _cut_short(step: Stage, where: str) -> str:
    scored, refitted = {s.candidate.label for s in step.scores}, {t.candidate.label for t in step.trials}
    planned = max(step.planned, len(scored | refitted))
    begun = f"{where} {len(scored)} of {counted(planned, 'candidate')} {'was' if len(scored) == 1 else 'were'} scored and " \
        f"{len(refitted)} refitted; the others may explain the residual as well."
    if not step.trials:
        largest = max(step.scores, key=lambda s: s.gain, default=None)
        return begun + (f" Largest score: {largest.candidate.label}." if largest is not None and largest.gain > 0 else "")
    best, held = step.trials[0], math.isfinite(step.chi2_held_out)
    before, after = (step.chi2_held_out, best.chi2_held_out) if held else (step.chi2_fit, best.chi2_fit)
    return f"{begun} Leading: {best.candidate.label}, with which chi-square per sample goes from {number(before, 3)} to " \
        f"{number(after, 3)} on {'held-out' if held else 'fitted'} data."
