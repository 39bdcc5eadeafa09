"""The adequacy of the first effect that was found, by identified curves in its place beside all effects found after it.

A curve of nine coefficients takes up more than a law of one: the offset of an input, a second effect. So law and curve are
compared in the diagram that has everything that was found later; and where the search for further effects was cut short,
the curves are no yardstick.
"""

from __future__ import annotations

from dataclasses import replace

from heavebond.core.cancellation import Budget
from heavebond.core.progress import Progress
from heavebond.diagnosis.adequacy import Adequacy, Comparand, adequacy, better
from heavebond.diagnosis.identity import loss
from heavebond.diagnosis.refit import Refit
from heavebond.diagnosis.stage import Stage, following, make_curve_stage
from heavebond.diagnosis.stepwise_selection import Selection, without_effect


def judged(way: Selection, complete: bool, tried: bool, number: int | None, seconds: float, say: Progress
           ) -> tuple[Adequacy, Stage | None]:
    """The adequacy of the first effect of a ladder, and the stage of identified curves by which it was judged; None where
    that was not made to its end in `seconds`, or not `tried` at all. `complete` as in `Adequacy`."""
    first = way[0]
    found = Budget(seconds).made(lambda: _compared(way, number, seconds, say)) if tried else None
    law, curves = found if found is not None else (_alone(way), None)
    made = adequacy(first.chosen, first.step, law, curves, complete)
    return made, curves if curves is not None and not curves.partial else None


def curve_alone(way: Selection, number: int | None, seconds: float, say: Progress) -> tuple[Refit | None, Stage | None]:
    """The identified curve that alone, without the effects of a ladder, leaves significantly less than these do together,
    and the stage of curves; None where there is no such curve, or where not all were tried in `seconds`."""
    made = Budget(seconds).made(lambda: make_curve_stage(
        way[0].step.experiment, beside=way[0].candidate, number=number, seconds=seconds,
        progress=lambda text: say(f"identified curves: {text}")))
    if made is None or made.partial:
        return None, None
    best = min((t for t in made.trials if t.errors is not None), key=loss, default=None)
    return (best if best is not None and better(best, way[-1].chosen) else None), made


def _alone(way: Selection) -> Comparand:
    step = way[0].step
    assert step.errors is not None
    return Comparand(way[0].chosen, step.errors, step.experiment)


def _compared(way: Selection, number: int | None, seconds: float, say: Progress) -> tuple[Comparand, Stage | None]:
    """The first effect as it is beside the others, and the curves in its place; None where the others stand upon it."""
    law = _alone(way)
    if len(way) > 1:
        others = without_effect(way, 0, say)
        if others is None or others[-1].chosen.errors is None:
            return law, None
        exact = replace(way[-1].chosen, candidate=way[0].candidate)
        law = Comparand(exact, others[-1].chosen.errors, following(others[-1].step))
    return law, make_curve_stage(law.experiment, beside=way[0].candidate, number=number, seconds=seconds,
                                 progress=lambda text: say(f"identified curves: {text}"))
