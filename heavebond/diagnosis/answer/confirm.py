"""Fits of the selected effects to all samples, and the first entries of the table of models.

The search uses excerpts of long records. The reported figures are computed from runs over whole records, if the time
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
    """Load an experiment, and return it with the noise of its channels and inputs, and a sentence for each smoothed input.

    Raises UsageError if no record is to be fitted.
    """
    unsmoothed = load_experiment(experiment)
    if not any(r.use == "fit" for r in unsmoothed.records.values()):
        raise UsageError([Problem("fit-no-record", "no record is marked `use: fit`", None,
                                  "Mark at least one record with `use: fit`.")])
    smoothed, notes = with_smoothed_inputs(unsmoothed, assemble_for(unsmoothed, next(iter(unsmoothed.records.values()))))
    return with_noise(smoothed), notes


def compared(experiment: Experiment) -> Comparison:
    """Compare the unchanged diagram with each record."""
    return Comparison(experiment, {name: compare_record(experiment, r) for name, r in experiment.records.items()})


def first_entries(experiment: Experiment, base: Fit | None, before: Comparison | None = None) -> list[LadderEntry]:
    """Entries of the table of models for the unchanged diagram and for the diagram with fitted parameters. `before` is the
    comparison of the unchanged diagram if it was computed before."""
    name = experiment.model.name
    if base is None:
        return [ladder_entry(name, before or compare(experiment))]
    fitted = f"{name}, parameters fitted" + (" (ended early)" if base.message == ENDED_EARLY else "")
    return [ladder_entry(name, base.before), ladder_entry(fitted, base.after)]


def at_fit(experiment: Experiment, fitted: Fit | None) -> Experiment:
    """Insert the fitted values into the diagram of an experiment. The original value of each free parameter is kept as
    `given`."""
    if fitted is None:
        return experiment
    before = {p.name: p.before for p in fitted.parameters if not p.record}  # each record keeps its separate initial values
    free = {name: replace(f, given=before.get(name)) if f.given is None else f for name, f in experiment.free.items()}
    record_values = {record: {name: value for name, value in fitted_of_record.items() if not name.startswith("initial.")}
                     for record, fitted_of_record in fitted.record_values.items()}
    changed = replace(experiment, model=experiment.model.with_parameters(fitted.values), free=free)
    return changed.with_record_values(record_values)


def confirmed(added: SelectedEffect, whole_records: Experiment, seconds: float = inf, before: Comparison | None = None,
              progress: Progress | None = None) -> AddedEffect:
    """Fit the chosen effect to the whole records, and compute its intervals and figures from full runs.

    The fit begins at the values of the search and ends after `seconds` with the best result. Without time, the values of the
    search are the result. `before` is the comparison without the effect.
    """
    searched = following(added.step)
    experiment = as_long_as(whole_records, searched)
    if before is not None:
        experiment = _with_late_times(experiment, searched, before)
    whole_fit = with_limits(added.candidate, evaluated(experiment, before) if seconds <= 0 else fit(
        experiment, partial=seconds < inf, seconds=seconds, before=before, progress=progress))
    effect_numbers = {n.name for n in added.candidate.numbers}
    return AddedEffect(added.candidate, tuple(p for p in whole_fit.parameters if p.name in effect_numbers),
                   ladder_entry(f"+ {added.candidate.label}", whole_fit.after), whole_fit, added.alternatives)


def _with_late_times(experiment: Experiment, searched: Experiment, before: Comparison) -> Experiment:
    """Extend event times that were fitted to an excerpt to the whole record.

    A time at or after the end of the excerpt means that the event does not occur. It is moved to the same distance after the
    end of the whole record, which is taken from `before`.
    """
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


# SHORTER: share of the time kept for a fit to the excerpt only. COMPARING: a fit leaves this multiple of the time of a
# comparison with all records for the comparison of its result, because an effect may slow down the runs.
SHORTER, COMPARING = 0.03, 2.0


@dataclass
class Confirming:
    """Fits of effects to the whole records within the remaining time.

    * budget: total time.
    * given: experiment on the whole records.
    * part: experiment on the searched samples.
    * base: fit without effects.
    * comparing: duration of a comparison with all records (s).
    * say: report of progress.
    * shorter: set if the time only suffices for fits to `part`.
    * ended: set if it does not suffice for these either; then the values of the search are the result.
    """

    budget: Budget
    given: Experiment
    part: Experiment
    base: Fit | None
    comparing: float
    say: Progress
    shorter: bool = False
    ended: bool = False

    def one(self, added: SelectedEffect, before: Comparison) -> AddedEffect | None:
        """Fit one effect; `before` is the comparison without it.

        Return None if the time is over. If `ended` is set, return the values of the search instead.
        """
        if self.ended:
            return confirmed(added, self.part if self.shorter else self.given, 0.0, before)
        limited = isfinite(self.budget.seconds)
        reserved = SHORTER * self.budget.seconds if limited and not self.shorter and cut(self.part, self.given) else 0.0
        most = self.budget.left(reserved + (0.0 if self.shorter else COMPARING * self.comparing)) if limited else inf
        experiment, label = self.part if self.shorter else self.given, added.candidate.label
        with finishing(self.say):
            return self.budget.made(lambda: confirmed(
                added, experiment, most, before, lambda text: self.say(f"confirming {label}: {text}")), reserved)

    def all(self, selection: Selection, ladder: Sequence[LadderEntry]) -> tuple[list[LadderEntry], list[AddedEffect]]:
        """Fit all effects of a selection; return the table of models with them, and the effects.

        If the time does not suffice, the effects have the values of the search and the figures of the searched samples. If
        the first effect is adequate but all effects together are not, only the first is returned.
        """
        if not selection:
            return list(ladder), []
        effects = self._all(selection, ladder)
        if effects is None and cut(self.part, self.given):
            self.shorter = True
            first = self.budget.made(lambda: self._first(ladder))
            effects = self._all(selection, first) if first is not None else None
            ladder = first if first is not None and effects is not None else ladder
        if effects is None:
            self.shorter, self.ended = cut(self.part, self.given) != "", True
            ladder = self._first(ladder) if self.shorter else ladder
            effects = self._all(selection, ladder)
        assert effects is not None
        if len(effects) > 1 and is_adequate(ladder, effects[:1]) and not is_adequate(ladder, effects):
            effects = [replace(effects[0], alternatives=selection[0].step.cluster)]
        for k, effect in enumerate(effects[:-1]):  # each with the values and intervals of the fit with all effects
            names = {p.name for p in effect.parameters}
            parameters = tuple(p for p in with_limits(effect.candidate, effects[-1].fit).parameters if p.name in names)
            if len(parameters) == len(names):
                effects[k] = replace(effect, parameters=parameters)
        return [*ladder, *(f.rung for f in effects)], effects

    def _all(self, selection: Selection, ladder: Sequence[LadderEntry]) -> list[AddedEffect] | None:
        findings: list[AddedEffect] = []
        for added in selection:
            self.say(f"confirming {added.candidate.label}")
            effect = self.one(added, (findings[-1].rung if findings else ladder[-1]).comparison)
            if effect is None:
                return None
            findings.append(effect)
        return findings

    def _first(self, ladder: Sequence[LadderEntry]) -> list[LadderEntry]:
        """First entries of the table of models, computed on the searched samples."""
        return [ladder_entry(entry.name, compared(at_fit(self.part, fit)))
                for entry, fit in zip(ladder, (None, self.base), strict=False)]
