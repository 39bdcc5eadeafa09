"""What a diagnosis reports, from runs over the whole of the records: the first entries of the ladder, and an added effect
fitted with everything else that is free."""

from __future__ import annotations

from dataclasses import replace
from math import inf

from heavebond.core.cancellation import ENDED_EARLY
from heavebond.core.errors import Problem, UsageError
from heavebond.core.progress import Progress
from heavebond.diagnosis.ladder import AddedEffect, LadderEntry, ladder_entry, with_limits
from heavebond.diagnosis.stage import following
from heavebond.diagnosis.stepwise_selection import SelectedEffect
from heavebond.estimation.channel_noise import with_noise
from heavebond.estimation.comparison import Comparison, compare, compare_record
from heavebond.estimation.excerpts import as_long_as
from heavebond.estimation.experiment import Experiment, ExperimentOrFile, load_experiment
from heavebond.estimation.fitting import Fit, fit


def loaded(experiment: ExperimentOrFile) -> Experiment:
    """An experiment, read where it is a file, with what the noise of its inputs does; UsageError where no record of it is
    fitted."""
    found = load_experiment(experiment)
    if not any(r.use == "fit" for r in found.records.values()):
        raise UsageError([Problem("fit-no-record", "no record is to be fitted", None,
                                  "Mark at least one record with `use: fit`.")])
    return with_noise(found)


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
    before = {p.name: p.before for p in fitted.parameters if not p.record}  # a record keeps its own value
    free = {name: replace(f, given=before.get(name)) if f.given is None else f for name, f in experiment.free.items()}
    return replace(experiment, model=experiment.model.with_parameters(fitted.values), free=free)


def confirmed(added: SelectedEffect, given: Experiment, seconds: float = inf, before: Comparison | None = None,
              progress: Progress | None = None) -> AddedEffect:
    """The chosen effect with intervals and figures from full runs on the whole of the records; the fit begins from the
    values of the search and ends after `seconds` with the best so far. `before` is the comparison without the effect."""
    found = with_limits(added.candidate, fit(as_long_as(given, following(added.step)), partial=seconds < inf,
                                             seconds=seconds, before=before, progress=progress))
    own = {n.name for n in added.candidate.numbers}
    return AddedEffect(added.candidate, tuple(p for p in found.parameters if p.name in own),
                   ladder_entry(f"+ {added.candidate.label}", found.after), found, added.alternatives)
