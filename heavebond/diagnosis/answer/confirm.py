"""Fits of the selected effects to all samples, and the first models of the table.

The search uses excerpts of long records; the reported figures come from runs over whole records, as far as the time
permits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite

from heavebond.core.cancellation import ENDED_EARLY, Budget, finishing
from heavebond.core.errors import Problem, UsageError
from heavebond.core.progress import Progress
from heavebond.diagnosis.answer.verdict import is_adequate
from heavebond.diagnosis.search.step import following
from heavebond.diagnosis.search.stepwise import SelectedEffect, Selection
from heavebond.diagnosis.state import AddedEffect, LadderEntry, ladder_entry, with_limits
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.comparison import Comparison, assemble_for, compare, compare_record
from heavebond.estimation.excerpts import as_long_as, cut
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, load_experiment
from heavebond.estimation.fitting import Fit, evaluated, fit, is_instant
from heavebond.estimation.input_smoothing import with_smoothed_inputs
from heavebond.language.definition import Value
from heavebond.text.expression import constant


def loaded(experiment: ExperimentOrFile) -> tuple[Experiment, tuple[str, ...]]:
    """An experiment, read where it is a file, with what the noise of its inputs does; and a sentence for each of its inputs
    that is smoothed. UsageError where no record of it is fitted."""
    found = load_experiment(experiment)
    if not any(r.use == "fit" for r in found.records.values()):
        raise UsageError([Problem("fit-no-record", "no record is marked `use: fit`", None,
                                  "Mark at least one record with `use: fit`.")])
    smoothed, said = with_smoothed_inputs(found, assemble_for(found, next(iter(found.records.values()))))
    return with_noise(smoothed), said


def compared(experiment: Experiment) -> Comparison:
    """The diagram as it stands, compared with each record."""
    return Comparison(experiment, {name: compare_record(experiment, r) for name, r in experiment.records.items()})


def first_entries(experiment: Experiment, base: Fit | None, before: Comparison | None = None) -> list[LadderEntry]:
    """The diagram as it stands, compared as `before` where that is known, and with its free parameters fitted."""
    name = experiment.model.name
    if base is None:
        return [ladder_entry(name, before or compare(experiment))]
    fitted = f"{name}, parameters fitted" + (" (ended early)" if base.message == ENDED_EARLY else "")
    return [ladder_entry(name, base.before), ladder_entry(fitted, base.after)]


def at_fit(experiment: Experiment, fitted: Fit | None) -> Experiment:
    """The experiment with the fitted values in its diagram; what is free keeps the value that was written there."""
    if fitted is None:
        return experiment
    before = {p.name: p.before for p in fitted.parameters if not p.record}  # a record keeps its own start
    free = {name: replace(f, given=before.get(name)) if f.given is None else f for name, f in experiment.free.items()}
    own = {record: {name: value for name, value in there.items() if not name.startswith("initial.")}
           for record, there in fitted.record_values.items()}
    changed = replace(experiment, model=experiment.model.with_parameters(fitted.values), free=free)
    return changed.with_record_values(own)


def confirmed(added: SelectedEffect, given: Experiment, seconds: float = inf, before: Comparison | None = None,
              progress: Progress | None = None) -> AddedEffect:
    """The chosen effect with intervals and figures from full runs on the whole of the records; the fit begins from the
    values of the search and ends after `seconds` with the best so far; without time, the values of the search are the
    result. `before` is the comparison without the effect."""
    searched = following(added.step)
    experiment = as_long_as(given, searched)
    if before is not None:
        experiment = _with_late_times(experiment, searched, before)
    found = with_limits(added.candidate, evaluated(experiment, before) if seconds <= 0 else fit(
        experiment, partial=seconds < inf, seconds=seconds, before=before, progress=progress))
    own = {n.name for n in added.candidate.numbers}
    return AddedEffect(added.candidate, tuple(p for p in found.parameters if p.name in own),
                   ladder_entry(f"+ {added.candidate.label}", found.after), found, added.alternatives)


def _with_late_times(experiment: Experiment, searched: Experiment, before: Comparison) -> Experiment:
    """The experiment in which a time that was found at or after the end of an excerpt, so that something does not begin in
    it, is as far after the end of the whole record, which `before` has."""
    ends = {name: (searched.records[name].end, float(record.result.time[-1])) for name, record in before.records.items()
            if record.use == "fit" and name in searched.records}
    for name, free in experiment.free.items():
        if not free.each or not is_instant(experiment.model, name):
            continue
        later = {}
        for record, (cut_at, end) in ends.items():
            setting = experiment.records[record].settings.get(name)
            value = constant(setting.value.expr) if setting is not None and isinstance(setting.value, Value) else None
            if cut_at is not None and value is not None and value >= cut_at and end > cut_at:
                later[record] = {name: end + value - cut_at}
        if later:
            high = max(free.range.high, *(values[name] for values in later.values()))
            experiment = replace(experiment.with_record_values(later),
                                 free={**experiment.free, name: replace(free, range=replace(free.range, high=high))})
    return experiment


# Share of the time that is kept for a fit to the excerpt alone, and as often the time of a comparison with all records is
# kept from a fit for the comparison with what it finds: with an effect a run may take longer.
SHORTER, COMPARING = 0.03, 2.0


@dataclass
class Confirming:
    """Fits of effects to the whole of the `given` records, in the time that is left of the `budget`; where it does not
    suffice for those of a selection, to the `part` that was searched: then `shorter` is set; if not for that either, `ended`
    is set, and an effect keeps the values of the search. `comparing` is how long a comparison with all records takes (s),
    `base` the fit without effects."""

    budget: Budget
    given: Experiment
    part: Experiment
    base: Fit | None
    comparing: float
    say: Progress
    shorter: bool = False
    ended: bool = False

    def one(self, added: SelectedEffect, before: Comparison) -> AddedEffect | None:
        """An effect with its intervals and figures, `before` the comparison without it; None if the time is over, unless the
        fits have `ended`: then the values of the search are the result."""
        if self.ended:
            return confirmed(added, self.part if self.shorter else self.given, 0.0, before)
        limited = isfinite(self.budget.seconds)
        kept = SHORTER * self.budget.seconds if limited and not self.shorter and cut(self.part, self.given) else 0.0
        most = self.budget.left(kept + (0.0 if self.shorter else COMPARING * self.comparing)) if limited else inf
        given, label = self.part if self.shorter else self.given, added.candidate.label
        with finishing(self.say):
            return self.budget.made(lambda: confirmed(
                added, given, most, before, lambda text: self.say(f"confirming {label}: {text}")), kept)

    def all(self, way: Selection, ladder: Sequence[LadderEntry]) -> tuple[list[LadderEntry], list[AddedEffect]]:
        """The models with the effects of a selection, and these effects. If the time does not suffice, they have the values
        of the search, and the figures of the part that was searched. What the first one explains by itself is not taken
        back because several together do not reach the noise: then it is the only one."""
        if not way:
            return list(ladder), []
        found = self._all(way, ladder)
        if found is None and cut(self.part, self.given):
            self.shorter = True
            first = self.budget.made(lambda: self._first(ladder))
            found = self._all(way, first) if first is not None else None
            ladder = first if first is not None and found is not None else ladder
        if found is None:
            self.shorter, self.ended = cut(self.part, self.given) != "", True
            ladder = self._first(ladder) if self.shorter else ladder
            found = self._all(way, ladder)
        assert found is not None
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
