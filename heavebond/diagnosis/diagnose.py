"""Identification of the physical effects that a diagram lacks.

`diagnose` runs the phases of `diagnosis.phases` in order. Each phase starts from the state after the previous one, and the
answer is derived from the last state. An effect is named only if the residual with it is near the noise, or if it explains
nearly all of the misfit. Otherwise the answer is a shape: a place and a curve. If the records cannot distinguish candidates,
all are named.
"""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from pathlib import Path

from heavebond.core import facade
from heavebond.core.cancellation import Budget, clear_signal, is_interrupt, time_limit
from heavebond.core.cluster import Cluster
from heavebond.core.errors import DataError, FaultWarning, ModelError, UsageError
from heavebond.core.presentation import brief
from heavebond.core.progress import Progress
from heavebond.core.quantities import si_value
from heavebond.core.reporting import reporting
from heavebond.diagnosis.answer.confirm import loaded
from heavebond.diagnosis.answer.ranking import as_dicts, entries
from heavebond.diagnosis.answer.sentences import (
    CURVES,
    EFFECTS,
    VALUES,
    acting_as_values,
    before_search,
    better_values,
    broken_candidates,
    closed_loops,
    equivalent_value_words,
    left_out_words,
    lost_candidates,
    opposite_signs,
    passed_conditions,
    residual_notes,
    search_limits,
    sentences,
    so_far,
    unusual_values,
    wrong_channels,
    wrong_starts,
)
from heavebond.diagnosis.answer.tree import Tree, answer_tree
from heavebond.diagnosis.answer.variations import variation_words
from heavebond.diagnosis.answer.verdict import sheet_p_value
from heavebond.diagnosis.evidence.flexible_laws import Adequacy, Remainder
from heavebond.diagnosis.evidence.horizons import horizon_words
from heavebond.diagnosis.evidence.probability import (
    Event,
    Evidence,
    evidence,
    probabilities,
    stated,
)
from heavebond.diagnosis.phases import CLOSING, FIRST, PHASES, State, Task, kept_time
from heavebond.diagnosis.search.record_starts import own_start_words
from heavebond.diagnosis.search.step import SECONDS, Stage
from heavebond.diagnosis.search.stepwise import MOST
from heavebond.diagnosis.search.workers import working_on
from heavebond.diagnosis.state import AddedEffect, LadderEntry
from heavebond.estimation.excerpts import cut
from heavebond.estimation.experiment import Experiment, ExperimentOrFile
from heavebond.estimation.fitting import Fit
from heavebond.experiment_design.separation import Separation
from heavebond.localise.misfit import Localization


@dataclass(frozen=True)
class Diagnosis(facade.Displayed):
    """The result of a diagnosis.

    * verdict, words: the verdict (see `diagnosis.answer.verdict`), and the answer in sentences.
    * ladder: table of models, which begins with the unchanged diagram and the diagram with fitted parameters. Empty if the
      search was ended before all records were simulated.
    * findings, steps: the effects and the steps that selected them; a last step without a result has no finding. If a fixed
      value is the finding, it is the only one, after one step of effects and one of values. No steps if the search was ended
      before its first candidate was scored.
    * doubtful: further effects that are not certain.
    * shape: if no effect can be named, the identified curve that reduces the error most.
    * fitted: the fit of the free parameters of the diagram.
    * noise: noise of each channel with its unit, and True if it was specified.
    * seconds: duration (s).
    * separation: experiment that would distinguish the alternatives.
    * searched: experiment on the searched samples.
    * adequacy: adequacy of the first finding if the residual exceeds the noise.
    * untried: parts of the search that were left out because it was ended early. (The candidates of an incomplete step are
      in this step.)
    * remainder: law that explains most of the final residual, if this exceeds the noise.
    * evidence: data from which the probabilities of `events` are computed.
    * restricted: True if only some classes of effects were tried.
    * reviews: for each step, the step in which its effect was compared again in the diagram with all others.
    * localization: unknown input of the first diagram for each place, if it was estimated; evidence for the upper levels of
      the `tree`.
    * faults: sentences on parts of the search that ended by a fault of the program; `words` begins with them.
    """

    experiment: Experiment
    verdict: str
    words: tuple[str, ...]
    ladder: tuple[LadderEntry, ...]
    findings: tuple[AddedEffect, ...]
    doubtful: tuple[AddedEffect, ...]
    steps: tuple[Stage, ...]
    shape: AddedEffect | None
    fitted: Fit | None
    noise: dict[str, tuple[float, str, bool]]
    seconds: float
    separation: Separation | None
    searched: Experiment
    adequacy: Adequacy | None = None
    untried: tuple[str, ...] = ()
    remainder: Remainder | None = None
    evidence: Evidence | None = None
    restricted: bool = False
    reviews: tuple[Stage | None, ...] = ()
    localization: Localization | None = None
    faults: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, self.verdict, *self.words)

    @property
    def partial(self) -> bool:
        """True if the search was ended early."""
        return bool(self.untried) or any(stage.partial for stage in self.steps)

    @property
    def events(self) -> tuple[Event, ...]:
        """Events that can explain the records, with their calibrated probabilities (see `evidence.probability`).

        Empty if the search was restricted to classes. If the search was ended early, the calibration does not hold:
        candidates without a refit count as another effect of the catalogue.
        """
        if self.evidence is None or self.restricted:
            return ()
        # labels of the candidates that the answer names for the first step
        named = tuple(t.candidate.label for f in self.findings[:1] for t in f.alternatives)
        return stated(probabilities(self.evidence), named)

    @cached_property
    def tree(self) -> Tree:
        """The answer as a tree: measuring chain or machine, place, kind, class, law, each with its probability."""
        return answer_tree(self.steps, self.evidence, self.findings, self.ladder, self.localization, self.partial,
                           self.doubtful, self.reviews)

    @property
    def started(self) -> bool:
        """True if separate initial values were fitted for each record, although the experiment does not declare them
        free."""
        return self.fitted is not None and bool({*self.fitted.experiment.free} - {*self.experiment.free})

    @property
    def last(self) -> Experiment:
        """Experiment on the last diagram of the table of models."""
        return self.added[-1].fit.experiment if self.added else self.experiment

    @property
    def added(self) -> tuple[AddedEffect, ...]:
        """The findings, the uncertain effects, and the identified curve."""
        return (*self.findings, *self.doubtful, *([self.shape] if self.shape is not None else []))

    def as_dict(self) -> dict[str, object]:
        """Return the whole result for JSON."""
        return {
            "verdict": self.verdict, "tree": self.tree.as_dict(), "words": list(self.words),
            "probabilities": [e.as_dict() for e in self.events],
            "partial": self.partial, "not_tried": list(self.untried), "faults": list(self.faults),
            "left_out": [[{"candidate": label, "reason": reason} for label, reason in stage.excluded.items()]
                         for stage in self.steps],
            "lost": sorted({label for stage in self.steps for label in stage.lost}),
            "steps": [f.as_dict() for f in self.findings], "uncertain": [f.as_dict() for f in self.doubtful],
            "shape": self.shape and self.shape.as_dict(), "ladder": [r.as_dict() for r in self.ladder],
            "ranking": [as_dicts(entries(s)) for s in self.steps],
            "noise": {name: {"value": value, "unit": unit, "given": specified}
                      for name, (value, unit, specified) in self.noise.items()},
            "adequacy": self.adequacy and self.adequacy.as_dict(),
            "remainder": self.remainder and self.remainder.as_dict(),
            "separation": self.separation and self.separation.as_dict(), "seconds": self.seconds}


@reporting
def diagnose(experiment: ExperimentOrFile, *, steps: int = MOST, number: int | None = None,
             executor: Cluster | None = None, seconds: float | str = SECONDS, classes: Sequence[str] = (),
             samples: int | None = None, progress: Progress | None = None,
             growing: Callable[[list[dict[str, object]]], None] | None = None) -> Diagnosis:
    """Identify the effects that the diagram of an experiment lacks.

    The effects are selected stepwise, at most `steps` of them, as long as the residual exceeds the noise and each effect
    reduces the errors on the selection data significantly and noticeably (see `diagnosis.search.stepwise`).

    * number: number of processes (default: number of processors).
    * executor: cluster whose workers score and refit the candidates.
    * seconds: time limit (s, or text with a unit), after which the search ends with its best result.
    * classes: classes of effects to which the catalogue is restricted.
    * samples: number of samples of long records that the search uses (see `estimation.excerpts`); the final fit uses all.
    * progress: called with a text at each step.
    * growing: called with the table of models after each change (name, errors and chi-square of each model; the errors of an
      effect that is not yet confirmed are NaN).

    Ctrl-C ends the search with the effects found up to then. Raises ModelError and DataError for an invalid experiment,
    UsageError if no record is to be fitted.
    """
    with working_on(executor):
        budget = Budget(si_value(seconds, "s", "seconds"))
        original, smoothed = loaded(experiment)
        task = Task(budget, steps, number, classes, samples, progress or (lambda text: None),
                    growing or (lambda models: None))
        answer = _answer(_run_phases(State(original, original), task), task)
        return replace(answer, words=(*answer.words, *smoothed))


def _run_phases(state: State, task: Task) -> State:
    """Run all phases and return the last state.

    If a phase is ended early, by Ctrl-C or the time limit, its last state is kept and only the closing phases follow. Time
    for the closing phases is reserved. The same holds for a phase after the first fit that ends by an exception, a fault of
    this program: the answer states it, with a FaultWarning.
    """
    for phase in PHASES:
        if phase not in CLOSING and (state.partial or not (state.models or phase in FIRST)):
            continue
        limit = inf if phase in CLOSING else task.budget.left(state.kept)
        try:
            if limit <= 0:
                raise KeyboardInterrupt
            with time_limit(limit):
                for latest in phase(state, task):
                    state = latest
        except (KeyboardInterrupt, Exception) as error:
            interrupted = is_interrupt(error)
            if not interrupted and (phase in FIRST or isinstance(error, ModelError | DataError | UsageError)):
                raise
            clear_signal()
            state = replace(state, ended=(*state.ended, phase.__name__))
            if not interrupted:
                last = traceback.extract_tb(error.__traceback__)[-1]
                fault = f"The phase `{phase.__name__}` ended by a fault of heavebond, {type(error).__name__} in " \
                    f"{Path(last.filename).name}, line {last.lineno}: {str(error).partition(chr(10))[0]}. The answer " \
                    "holds what was known before. Report it to who maintains heavebond for you."
                warnings.warn(fault, FaultWarning, stacklevel=2)
                state = replace(state, faults=(*state.faults, fault))
        if phase in FIRST[1:]:
            state = replace(state, kept=kept_time(state, task))
    return state


def _answer(state: State, task: Task) -> Diagnosis:
    """Create the result of a diagnosis from its last state."""
    records = state.models[0].comparison.records if state.models else {}
    noise = {c.name: (c.noise, c.unit, c.noise_given) for record in [*records.values()][:1]
             for c in record.channels.values()}
    budget = task.budget
    if not state.steps or state.searched is None:
        words = (*state.faults, *before_search(state.models, state.base))
        return Diagnosis(state.given, "undetermined", words, state.models, (), (), (), None, state.base, noise,
                         budget.spent, None, state.given, None, (EFFECTS, VALUES, CURVES), faults=state.faults)
    verdict, steps, findings, models = state.verdict, state.steps, state.findings, state.table
    first = models[0].comparison
    answer = Diagnosis(state.given, verdict, (), models, findings, state.doubtful, steps, state.shape, state.base, noise,
                       budget.spent, state.separation, state.searched, state.adequacy, state.untried, state.remainder,
                       evidence(steps, state.value_step, sheet_p_value(state.base), state.adequacy,
                                next(iter(state.reviews), None)), bool(task.classes), state.reviews,
                       state.localization, state.faults)
    words = (*sentences(verdict, models, findings, steps, state.shape, state.adequacy,
                         not findings or answer.tree.states(findings[0].candidate)), *variation_words(findings),
             *map(equivalent_value_words, state.values),
             *(better_values(state.value_step, steps[0], [t.candidate.name for t in state.values])
               if state.unexplained else ()),
             *(opposite_signs(steps[0], state.experiment) if verdict in ("shape", "undetermined") else ()),
             *acting_as_values(findings, steps, [t.candidate.name for t in state.values]),
             *(state.separation.words if state.separation is not None else ()),
             *(effect.doubt for effect in state.doubtful),
             *unusual_values(findings), *residual_notes(verdict, state.remainder, steps),
             *lost_candidates(steps), *broken_candidates(verdict, steps), *closed_loops(first),
             *passed_conditions(models[-1].comparison),
             *own_start_words(state.given, state.base, state.added[-1].fit if state.added else state.base),
             *wrong_starts(verdict, models[-1].comparison), *so_far(steps, state.untried),
             *left_out_words(steps), *search_limits(task.classes, cut(state.searched, state.experiment),
                            state.confirming is not None and state.confirming.shorter),
             *horizon_words(state.experiment), *state.differences)
    return replace(answer, words=(*wrong_channels(models[-1].comparison, state.added, state.given), *state.faults, *words))
