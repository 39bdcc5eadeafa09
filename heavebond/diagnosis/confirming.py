"""The effects of a search fitted to the whole of the records, as far as the time of the diagnosis goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite

from heavebond.core.cancellation import Budget, finishing
from heavebond.core.progress import Progress
from heavebond.diagnosis.full_runs import at_fit, compared, confirmed
from heavebond.diagnosis.ladder import AddedEffect, LadderEntry, ladder_entry, with_limits
from heavebond.diagnosis.stepwise_selection import SelectedEffect, Selection
from heavebond.diagnosis.verdict import is_adequate
from heavebond.estimation.comparison import Comparison
from heavebond.estimation.excerpts import cut
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.fitting import Fit

# Share of the time that is kept for a fit to the excerpt alone, and as often the time of a comparison with all records is
# kept from a fit for the comparison with what it finds: with an effect a run may take longer.
SHORTER, COMPARING = 0.03, 2.0


@dataclass
class Confirming:
    """Fits of effects to the whole of the `given` records, in the time that is left of the `budget`; where it does not
    suffice for those of a selection, to the `part` that was searched: then `shorter` is set. `comparing` is how long a
    comparison with all records takes (s), `base` the fit without effects."""

    budget: Budget
    given: Experiment
    part: Experiment
    base: Fit | None
    comparing: float
    say: Progress
    shorter: bool = False

    def one(self, added: SelectedEffect, before: Comparison) -> AddedEffect | None:
        """An effect with its intervals and figures, `before` the comparison without it; None where the time is over."""
        limited = isfinite(self.budget.seconds)
        kept = SHORTER * self.budget.seconds if limited and not self.shorter and cut(self.part, self.given) else 0.0
        most = self.budget.left(kept + (0.0 if self.shorter else COMPARING * self.comparing)) if limited else inf
        given, label = self.part if self.shorter else self.given, added.candidate.label
        with finishing(self.say):
            return self.budget.made(lambda: confirmed(
                added, given, most, before, lambda text: self.say(f"confirming {label}: {text}")), kept)

    def all(self, way: Selection, ladder: Sequence[LadderEntry]) -> tuple[list[LadderEntry], list[AddedEffect]]:
        """The ladder with the effects of a selection, and these; none where the time suffices for neither. What the first
        one explains by itself is not taken back because several together do not reach the noise: then it stands alone."""
        found = self._all(way, ladder)
        if found is None and cut(self.part, self.given):
            self.shorter = True
            first = self.budget.made(lambda: self._first(ladder))
            found = self._all(way, first) if first is not None else None
            ladder = first if first is not None and found is not None else ladder
        self.shorter = self.shorter and found is not None
        if not found:
            return list(ladder), []
        if len(found) > 1 and is_adequate(ladder, found[:1]) and not is_adequate(ladder, found):
            found = [replace(found[0], alternatives=way[0].step.cluster)]
        found = [*(_beside_all(finding, found[-1].fit) for finding in found[:-1]), *found[-1:]]
        return [*ladder, *(f.rung for f in found)], found

    def _all(self, way: Selection, ladder: Sequence[LadderEntry]) -> list[AddedEffect] | None:
        findings: list[AddedEffect] = []
        for added in way:
            self.say(f"confirming {added.candidate.label}")
            found = self.one(added, (findings[-1].rung if findings else ladder[-1]).comparison)
            if found is None:
                return None
            findings.append(found)
        return findings

    def _first(self, ladder: Sequence[LadderEntry]) -> list[LadderEntry]:
        """The first entries of the ladder on the part that was searched."""
        return [ladder_entry(entry.name, compared(at_fit(self.part, fit)))
                for entry, fit in zip(ladder, (None, self.base), strict=False)]


def _beside_all(finding: AddedEffect, last: Fit) -> AddedEffect:
    """An effect with the values and intervals of the fit with all effects."""
    own = {p.name for p in finding.parameters}
    parameters = tuple(p for p in with_limits(finding.candidate, last).parameters if p.name in own)
    return replace(finding, parameters=parameters) if len(parameters) == len(own) else finding
