"""Phases of a diagnosis.

A phase is a generator: it takes the state of the diagnosis and yields it again after each improvement. `diagnose` runs the
phases in order and keeps the last state. A phase that is ended early (by Ctrl-C, a signal or the time limit) thus loses no
results. The phases that only compute the answer (`CLOSING`) always run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, isfinite, nan

from heavebond.core.cancellation import Budget
from heavebond.core.errors import HeavebondError, SimulationError, StartError, listing
from heavebond.core.progress import Progress
from heavebond.diagnosis.answer.confirm import Confirming, at_fit, compared, first_entries
from heavebond.diagnosis.answer.sentences import CALIBRATION, CURVES, FURTHER, SEGMENTS, VALUES, was_ended
from heavebond.diagnosis.answer.verdict import is_adequate, misfit_reduction, near_noise, unexplained, verdict
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.comparison import leaves_noise
from heavebond.diagnosis.evidence.flexible_laws import (
    Adequacy,
    Remainder,
    adequacy_alone,
    better,
    curve_alone,
    judged,
    remainder,
)
from heavebond.diagnosis.evidence.horizons import with_horizons
from heavebond.diagnosis.evidence.record_differences import record_differences
from heavebond.diagnosis.search.record_starts import own_starts
from heavebond.diagnosis.search.refit import Refit, begun
from heavebond.diagnosis.search.step import (
    Stage,
    choosing,
    fitted_base,
    following,
    make_calibration_stage,
    make_curve_stage,
    make_stage,
    make_value_stage,
    merit,
    worth_it,
)
from heavebond.diagnosis.search.stepwise import (
    DECISIVE,
    SelectedEffect,
    Selection,
    Unsupported,
    doubts,
    near_the_noise,
    select_stepwise,
)
from heavebond.diagnosis.state import AddedEffect, LadderEntry, chi2_sum, ladder_entry
from heavebond.estimation.comparison import Comparison, compare
from heavebond.estimation.excerpts import as_long_as, excerpt
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.fitting import Fit, fit
from heavebond.experiment_design.separation import Alternative, Separation, separate
from heavebond.localise.misfit import Localization, localize

# FITTING: share of the time after which the first fit of all samples is ended with its best result. KEPT, MOST_KEPT:
# smallest and largest share of the time kept for the closing phases. LAST_RUNS: number of runs that the fit of the selected
# effects to all samples takes.
FITTING, KEPT, MOST_KEPT, LAST_RUNS = 0.4, 0.1, 0.4, 6.0
SUPPORTED = 0.5  # as for a step of the selection, an advantage that is no matter of how the segments are cut
SLIGHT = 4.0  # chi-square per sample of a residual of twice the noise: a drift of this size hardly suggests a false effect


@dataclass(frozen=True)
class Task:
    """The options of a diagnosis.

    * budget: time.
    * steps: largest number of effects.
    * number: number of processes.
    * classes: classes of effects to which the catalogue is restricted.
    * samples: number of searched samples of long records.
    * say, grow: report of progress.
    """

    budget: Budget
    steps: int
    number: int | None
    classes: Sequence[str]
    samples: int | None
    say: Progress
    grow: Callable[[list[dict[str, object]]], None]


@dataclass(frozen=True)
class State:
    """The state of a diagnosis.

    * given: the original experiment.
    * experiment: the same with separate initial values for each record, if required.
    * models: the table of models with their errors.
    * base: the fit of the free parameters.
    * comparing: duration of a comparison with all records (s).
    * kept: time (s) that is kept for the closing phases.
    * searched: experiment on the searched samples.
    * selection, last: the selected effects and the last step of the search.
    * doubts: effects that are not certain, with the reasons.
    * steps, findings, doubtful: steps, certain effects and uncertain effects of the answer.
    * reviews: for each step, the step in which its effect was compared again in the diagram with all others.
    * confirming: the fits to all samples.
    * values: fixed values that the records cannot distinguish from the findings.
    * value_step: the step of all fixed values.
    * shape: the identified curve that replaces a named effect.
    * adequacy, remainder: see `evidence.flexible_laws`.
    * localization: see `localise`.
    * differences: sentences on parameters with another value in a held-out record.
    * verdict, separation: see `Diagnosis`.
    * untried: parts of the search that were not completed.
    * ended: phases that were ended early.
    * faults: sentences on phases that ended by a fault of the program.
    """

    given: Experiment
    experiment: Experiment
    models: tuple[LadderEntry, ...] = ()
    base: Fit | None = None
    comparing: float = 0.0
    kept: float = 0.0
    searched: Experiment | None = None
    selection: Selection = ()
    last: Stage | None = None
    doubts: tuple[Unsupported, ...] = ()
    steps: tuple[Stage, ...] = ()
    findings: tuple[AddedEffect, ...] = ()
    doubtful: tuple[AddedEffect, ...] = ()
    reviews: tuple[Stage | None, ...] = ()
    confirming: Confirming | None = None
    values: tuple[Refit, ...] = ()
    value_step: Stage | None = None
    shape: AddedEffect | None = None
    adequacy: Adequacy | None = None
    remainder: Remainder | None = None
    localization: Localization | None = None
    differences: tuple[str, ...] = ()
    verdict: str = "undetermined"
    separation: Separation | None = None
    untried: tuple[str, ...] = ()
    ended: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def partial(self) -> bool:
        """True if the search for effects was ended early."""
        return bool(self.ended) or (self.last is not None and self.last.partial) or any(s.partial for s in self.steps)

    @property
    def unexplained(self) -> bool:
        """True if a residual above the noise remains that no named effect explains."""
        return unexplained(self.models, self.findings, self.steps)

    @property
    def added(self) -> tuple[AddedEffect, ...]:
        """The findings, the uncertain effects, and the identified curve."""
        return (*self.findings, *self.doubtful, *([self.shape] if self.shape is not None else []))

    @property
    def table(self) -> tuple[LadderEntry, ...]:
        """The table of models, including the identified curve."""
        return (*self.models, *([self.shape.rung] if self.shape is not None else []))

    @property
    def before_findings(self) -> tuple[LadderEntry, ...]:
        """The models without effects."""
        return self.models[:len(self.models) - len(self.findings) - len(self.doubtful)]

    def without(self, part: str) -> State:
        """Add a part of the search that was not completed."""
        return replace(self, untried=tuple(dict.fromkeys((*self.untried, part))))

    def at_last_fit(self) -> Experiment:
        """Experiment on the last diagram at its fitted values."""
        last = self.added
        return at_fit(last[-1].fit.experiment, last[-1].fit) if last else at_fit(self.experiment, self.base)


Phase = Callable[[State, Task], Iterator[State]]


def kept_time(state: State, task: Task) -> float:
    """Time (s) to keep for the fit of the selected effects to all samples, which takes several runs even from near its
    optimum."""
    if not isfinite(task.budget.seconds):
        return 0.0
    runs = state.base.evaluations if state.base is not None else 1
    needed = LAST_RUNS * task.budget.spent / max(runs, LAST_RUNS / 2)
    return max(KEPT * task.budget.seconds, min(needed, MOST_KEPT * task.budget.seconds))


def simulate_records(state: State, task: Task) -> Iterator[State]:
    """Compare the unchanged diagram with all records."""
    task.say("simulating all records")
    before: tuple[LadderEntry, ...] = ()
    try:
        before = tuple(first_entries(state.given, None, compared(state.given)))
    except (SimulationError, StartError):
        if not state.given.free:
            raise  # otherwise the fit may find values that can be simulated, or reports a better message
    yield replace(state, models=before, comparing=task.budget.spent)


def fit_parameters(state: State, task: Task) -> Iterator[State]:
    """Fit the free parameters of the diagram."""
    if not state.given.free:
        return
    most, began = min(FITTING * task.budget.seconds, task.budget.left(2 * state.comparing)), task.budget.spent
    base = fit(state.given, progress=lambda text: task.say(f"fitting the free parameters: {text}"), partial=True,
               seconds=most, before=state.models[0].comparison if state.models else None)
    by_user = was_ended(base) and task.budget.spent - began < most
    yield replace(state, base=base, models=tuple(first_entries(state.given, base)),
                  ended=("fit_parameters",) if by_user else ())


def fit_record_starts(state: State, task: Task) -> Iterator[State]:
    """Fit initial values of each record if the records and the model begin at different values."""
    seconds = min(FITTING * task.budget.seconds, task.budget.left())
    started = own_starts(state.experiment, state.models[-1], seconds, task.say)
    if started is not None:
        entry = ladder_entry(f"{started.experiment.model.name}, start of each record fitted", started.after)
        yield replace(state, experiment=started.experiment, base=started, models=(*state.models, entry))


def search(state: State, task: Task) -> Iterator[State]:
    """Select effects step by step.

    If the machine integrates errors that are most of the misfit, the search takes at most half of the time. If its effects
    then leave more than noise, the free parameters are fitted again within segments of the records, and the search is
    repeated there. The result on the whole records is kept if the fitted parameters alone leave only noise within the
    segments, and the effects on the whole records, if any, leave little more than noise (`SLIGHT`). It is also kept if it
    leaves less than the share `SUPPORTED` of the misfit within the segments that the result of the segments leaves: a law
    that is missing reduces the errors on both scales, a law that only bounds the drift does not. If the time ends before an
    effect is refitted within the segments, the result on the whole records is the answer so far.
    """
    last = state.models[-1].comparison
    task.say("examining the drift of the model")
    cut = with_horizons(state.experiment, state.base.values if state.base is not None else {}) \
        if any(r.chi2 > DECISION.near for r in last.records.values()) else state.experiment
    half = task.budget.left(state.kept) / 2 if cut.horizons and isfinite(task.budget.seconds) else 0.0
    whole = state
    for whole in _search(state, task, state.kept + half):
        yield whole
    assert whole.last is not None
    by_user = whole.last.partial and task.budget.left(state.kept + half) > 0
    if not cut.horizons or by_user or not whole.last.left.significant or \
            (whole.selection and leaves_noise(whole.selection[-1].chosen)):
        return
    base = fit(cut, progress=lambda text: task.say(f"fitting the free parameters within segments: {text}"), partial=True,
               seconds=task.budget.left(state.kept) / 2,
               before=Comparison(cut, state.models[0].comparison.records)) if cut.free else None
    models = first_entries(cut, base, None if base is not None else Comparison(cut, last.records))
    chosen = whole.selection[-1].chosen if whole.selection else None
    if near_noise(models[-1]) and (chosen is None or max(chosen.chi2_fit, chosen.chi2_held_out) <= SLIGHT):
        return  # separate starts explain the misfit, so the segments cannot show an effect: the whole records tell more
    whole = whole.without(SEGMENTS)  # until the search within the segments has an answer
    yield whole
    misfit_of_whole = _misfit_within(cut, whole) if chosen is not None else inf

    def supports_whole(within: State) -> bool:
        return misfit_of_whole < inf and misfit_of_whole < SUPPORTED * _misfit_within(cut, within)

    within = replace(state, experiment=cut, base=base, models=tuple(models))
    supported = supports_whole(within)
    for improved in _search(within, task, state.kept):
        if improved.selection is not within.selection:
            supported = supports_whole(improved)
        within = improved
        if within.selection and not supported:  # before, the result on the whole records is the better one
            yield within
    assert within.last is not None
    if supported:
        yield replace(whole, untried=tuple(part for part in whole.untried if part != SEGMENTS))
    elif within.last.trials or not within.last.partial:
        yield within


def _misfit_within(cut: Experiment, state: State) -> float:
    """Chi-square of all samples within the segments of `cut`, for the selected effects at their fitted values, or for the
    base model. Infinite if the diagram with the effects cannot be simulated."""
    comparison = state.models[-1].comparison
    if state.selection:
        model = as_long_as(cut, following(state.selection[-1].step))
        try:
            comparison = compare(replace(model, horizons=cut.horizons))
        except HeavebondError:
            return inf
    return chi2_sum(cut, list(comparison.records.values()))[0]


def _search(state: State, task: Task, reserved: float) -> Iterator[State]:
    """Select effects step by step on the searched samples, until the time `reserved` (s) is left. If these samples show no
    effect, repeat the search on all samples."""
    task.grow([entry.as_dict() for entry in state.models])

    def remaining_time() -> float:
        return task.budget.left(reserved)

    def stepping(experiment: Experiment, selection: Selection, review: bool = False) -> Stage:
        # the effects that are not yet confirmed have the figures on the searched samples
        task.grow([*(entry.as_dict() for entry in state.models),
                   *({"name": f"+ {added.candidate.label}", "error_fit": nan, "error_held_out": nan,
                      "chi2_fit": added.chosen.chi2_fit, "chi2_held_out": added.chosen.chi2_held_out}
                     for added in selection)])
        beside = f" beside {listing(added.candidate.label for added in selection)}" if len(selection) > 1 else ""
        return make_stage(experiment, beside=[added.candidate for added in selection], number=task.number,
                          seconds=remaining_time(), classes=task.classes, thorough=not selection, review=review,
                          earlier=[score for added in selection for score in added.step.scores],
                          progress=lambda text: task.say(f"step {len(selection) + 1}{beside}: {text}"))

    cut_short: set[str] = set()

    def calibrating(experiment: Experiment) -> Stage:
        cut_short.add(CALIBRATION)  # removed after completion
        stage = make_calibration_stage(experiment, number=task.number, seconds=remaining_time(), classes=task.classes,
                                       progress=lambda text: task.say(f"adding calibration errors: {text}"))
        if not stage.partial:
            cut_short.clear()
        return stage

    part = excerpt(state.experiment, state.models[-1].comparison, task.samples)
    last = None
    for searched in [part] if part is state.experiment else [part, state.experiment]:
        if last is not None and (last.left.significant or last.partial):
            break
        for selection, last in select_stepwise(at_fit(searched, state.base), stepping, task.say, task.steps,
                                               remaining_time, calibrating, partial(stepping, review=True)):
            state = replace(state, searched=searched, selection=selection, last=last, untried=tuple(cut_short))
            yield state
    assert last is not None
    selection, last = _noticeable(state.selection, last)
    state = replace(state, selection=selection, last=last)
    yield state
    yield replace(state, doubts=tuple(doubts(selection, task.say, lambda experiment, among: make_curve_stage(
        experiment, among=among, number=task.number, seconds=remaining_time()))))


def confirm(state: State, task: Task) -> Iterator[State]:
    """Fit the selected effects to all samples."""
    selection, last = state.selection, state.last
    if last is None or state.searched is None:
        return
    last = replace(last, partial=last.partial or bool(state.ended))
    # the last step may be the step that selected the last effect
    last_selected = bool(selection) and last.chosen is selection[-1].chosen
    short = last_selected and not last.partial and len(selection) < task.steps \
        and not selection[-1].is_noise and not near_the_noise(selection)
    # the rankings mark the alternatives as compared in the diagram with all other effects
    before = selection[:-1] if last_selected else selection
    steps = [*(replace(added.step, cluster=added.alternatives) for added in before),
             replace(last, cluster=selection[-1].alternatives) if last_selected else replace(last, chosen=None, cluster=())]
    confirming = Confirming(task.budget, state.experiment, state.searched, state.base, state.comparing, task.say)
    models, added = confirming.all(selection, state.models)
    sure = min(len(selection) - len(state.doubts), len(added))
    doubtful = tuple(replace(effect, doubt=doubt.words) for effect, doubt in zip(added[sure:], state.doubts, strict=False))
    if confirming.ended:
        steps[-1] = replace(steps[-1], partial=True)
    yield replace(state, models=tuple(models), findings=tuple(added[:sure]), doubtful=doubtful,
                  steps=tuple(steps), reviews=tuple(effect.review for effect in selection), confirming=confirming,
                  untried=(*state.untried, *([FURTHER] if short else [])))


def try_fixed_values(state: State, task: Task) -> Iterator[State]:
    """Compare the findings with other values of the fixed parameters. A value replaces the findings if it is better, and is
    an alternative if the records cannot distinguish it."""
    if not state.steps or not state.steps[0].left.significant or (task.classes and VALUE not in task.classes):
        return
    assert state.confirming is not None and state.searched is not None
    searched, confirm_one = state.searched, state.confirming.one
    without = state.without(VALUES)
    yield without if state.findings else replace(
        without, steps=(*state.steps[:-1], replace(state.steps[-1], partial=True)))
    chosen = state.selection[len(state.findings) - 1].chosen \
        if state.findings and is_adequate(state.models, state.findings) else None
    stage = make_value_stage(
        as_long_as(searched, at_fit(state.experiment, state.base)), beside=chosen, number=task.number,
        seconds=task.budget.left(state.kept),
        progress=lambda text: task.say(f"trying other values of the fixed parameters: {text}"))
    if (value := _value(stage, confirm_one, state.before_findings)) is not None:
        yield replace(state, models=(*state.before_findings, value.rung), findings=(value,), doubtful=(), reviews=(),
                      value_step=stage,
                      steps=(replace(state.steps[0], chosen=None, cluster=()), stage))
        return
    if stage.partial:
        yield replace(without, value_step=stage, steps=state.steps if state.findings else (
            *state.steps[:-1], replace(state.steps[-1], partial=True)))
        return
    findings, values = _beside(state.findings, chosen, stage) if chosen is not None else (state.findings, ())
    yield replace(state, value_step=stage, findings=findings, values=values)


def fit_flexible_laws(state: State, task: Task) -> Iterator[State]:
    """Compare the first finding with identified curves in its place if the residual exceeds the noise. Without a finding,
    fit identified curves only. A curve that explains most of the residual replaces the finding."""
    if not state.unexplained:
        return
    assert state.confirming is not None
    seconds = task.budget.left(state.kept)
    selection = state.selection
    if selection and state.findings and state.findings[0].candidate is selection[0].candidate:
        for latest in _without_name(state, task, seconds):
            state = latest
            yield state
    if state.shape is None and not (state.adequacy is not None and state.adequacy.stands) and not state.steps[-1].partial \
            and VALUES not in state.untried and state.unexplained:
        assert state.searched is not None and state.confirming is not None
        task.say("learning a curve")
        yield state.without(CURVES)
        seconds = task.budget.left(state.kept)
        experiment = as_long_as(state.searched, replace(state, shape=None).at_last_fit())
        stage = make_curve_stage(experiment, number=task.number, seconds=seconds)
        shape = None
        if stage.chosen is not None and worth_it(stage):
            shape = state.confirming.one(SelectedEffect(stage, stage.cluster), state.models[-1].comparison)
            stage = replace(stage, partial=stage.partial or shape is None)
        yield replace(state.without(CURVES) if stage.partial else state, shape=shape)


def explain_remainder(state: State, task: Task) -> Iterator[State]:
    """Find the law that explains most of the final residual, if it exceeds the noise."""
    if state.steps and not state.steps[-1].partial and state.unexplained:
        assert state.searched is not None
        yield replace(state, remainder=remainder(as_long_as(state.searched, state.at_last_fit()), task.say))


def localise_misfit(state: State, task: Task) -> Iterator[State]:
    """Estimate the unknown input at each place of the fitted diagram, which is evidence for the place and kind of the
    missing effect.

    If the search used all of its time and selected no effect, the time that was kept to confirm one is used for this: the
    answer then has a place.
    """
    if state.searched is None or not state.steps or not state.steps[0].left.significant:
        return
    if state.partial and (state.selection or task.budget.left(state.kept) > 0):
        return
    searched, places = state.searched, [frozenset(effect.candidate.where) for effect in state.added]
    try:
        located = task.budget.made(lambda: localize(
            searched, values=state.base, progress=lambda text: task.say(f"localising the misfit: {text}"),
            besides=places), state.kept / 4 if state.partial else state.kept)
    except HeavebondError:
        return
    if located is not None:
        yield replace(state, localization=located)
    elif not state.partial:
        raise KeyboardInterrupt


def compare_held_out_records(state: State, task: Task) -> Iterator[State]:
    """Find parameters with another value in a held-out record, if the residual is noise on fitted records but not on
    held-out ones."""
    if state.steps and not state.findings and not state.untried and not state.steps[0].left.significant \
            and state.table[-1].chi2_held_out > DECISION.near:
        differences = record_differences(at_fit(replace(state.given, horizons=state.experiment.horizons), state.base))
        state = replace(state, differences=tuple(difference.words for difference in differences))
        yield state
        if len({difference.candidate.label for difference in differences}) != 1:
            return
        # the parameter becomes a finding with a value for each record, if this improves the prediction of the held-out ones
        assert state.confirming is not None and state.searched is not None
        base = fitted_base(at_fit(state.searched, state.base))
        trial = begun(base, differences[0].candidate, progress=task.say)
        if trial is None:
            return
        stage = choosing(replace(state.steps[0], trials=(trial,)), trial)
        before = state.models[-1]
        effect = state.confirming.one(SelectedEffect(stage, stage.cluster), before.comparison)
        if effect is None or misfit_reduction(before.chi2_held_out, effect.rung.chi2_held_out) < DECISION.mainly:
            return
        # the fitted records show no effect; the evidence is the size of the residual of the held-out records
        stage = replace(stage, left=replace(stage.left, size=differences[0].chance))
        yield replace(state, models=(*state.models, effect.rung), findings=(effect,), steps=(stage,))


def decide(state: State, task: Task) -> Iterator[State]:
    """Derive the verdict, and design an experiment that would distinguish the alternatives."""
    if not state.steps:
        return
    if state.adequacy is None and state.unexplained and state.selection and state.findings \
            and state.findings[0].candidate is state.selection[0].candidate:
        complete = not state.steps[0].partial and VALUES not in state.untried
        state = replace(state.without(CURVES), adequacy=adequacy_alone(state.selection[:len(state.findings)], complete))
    conclusion = verdict(state.base, state.table, state.findings, state.steps, state.shape, state.adequacy,
                         not {VALUES, CURVES} & set(state.untried))
    state = replace(state, verdict=conclusion)
    yield state
    if conclusion == "one_of" and not state.ended:
        seconds = task.budget.left(state.kept)
        apart = Budget(seconds).made(lambda: _separation(state.given, state.findings, task.say, seconds))
        yield replace(state, separation=apart)


PHASES: tuple[Phase, ...] = (simulate_records, fit_parameters, fit_record_starts, search, confirm, try_fixed_values,
                             fit_flexible_laws, explain_remainder, localise_misfit, compare_held_out_records,
                             decide)
CLOSING: tuple[Phase, ...] = (confirm, localise_misfit, decide)
FIRST: tuple[Phase, ...] = (simulate_records, fit_parameters, fit_record_starts)


def _without_name(state: State, task: Task, seconds: float) -> Iterator[State]:
    """Compute the adequacy of the first finding, and replace the finding by an identified curve if the curve explains most
    of the residual.

    If there are several findings, the curve alone must have a smaller residual than all of them together. The curve does not
    replace the finding if uncertain effects explain the residual as well.
    """
    assert state.confirming is not None
    task.say("fitting identified curves in place of the effect")
    selection, confirm_one = state.selection[:len(state.findings)], state.confirming.one
    complete = not state.steps[0].partial and VALUES not in state.untried
    tried = not state.steps[-1].partial and not {FURTHER, CALIBRATION} & set(state.untried)
    yield replace(state.without(CURVES), adequacy=adequacy_alone(selection, complete))
    assessment, curves = judged(selection, complete, tried, task.number, seconds, task.say)
    state = replace(state if curves is not None else state.without(CURVES), adequacy=assessment)
    yield state
    if not assessment.beaten or VALUES in state.untried:
        return
    curve = assessment.flexible
    if len(state.findings) > 1:
        task.say("fitting identified curves in place of all effects")
        curve, curves = curve_alone(selection, task.number, seconds, task.say)
    if curve is None or curves is None:
        return
    if state.doubtful and not better(curve, state.selection[-1].chosen):
        yield replace(state, adequacy=replace(assessment, beaten=False))
        return
    without = state.before_findings
    shape = confirm_one(SelectedEffect(choosing(curves, curve), (curve,)), without[-1].comparison)
    if shape is None:
        yield state.without(CURVES)
        return
    step = replace(state.steps[0], chosen=None, cluster=())
    yield replace(state, models=without, findings=(), doubtful=(), reviews=(), steps=(step,), shape=shape)


def _noticeable(selection: Selection, last: Stage) -> tuple[Selection, Stage]:
    """Discard a single effect that removes hardly any misfit. Some law always removes a few percent of an unexplained
    residual (noise of a measured input) significantly, but is not the cause."""
    if len(selection) != 1 or worth_it(selection[0].step):
        return selection, last
    return (), replace(selection[0].step, chosen=None, cluster=(), partial=last.partial)


def _separation(machine: Experiment, findings: Sequence[AddedEffect], say: Progress, seconds: float) -> Separation | None:
    """Design an experiment that distinguishes the alternatives of the first uncertain finding, with the best law of each
    class and place. None if one of the diagrams cannot be simulated."""
    unsure = next(f for f in findings if not f.certain)
    best: dict[object, Refit] = {}
    for trial in unsure.alternatives:
        best.setdefault((trial.candidate.kind, frozenset(trial.candidate.where)), trial)
    try:
        return separate([Alternative(f"{t.candidate.kind} {t.candidate.place}", t.experiment, t.values,
                                     t.samples + t.samples_held_out) for t in best.values()],
                        machine=machine, progress=say)
    except HeavebondError:
        return None


def _value(stage: Stage, confirm_one: Callable[[SelectedEffect, Comparison], AddedEffect | None],
           models: Sequence[LadderEntry]) -> AddedEffect | None:
    """Fixed value with which the residual becomes noise, fitted to all samples.

    None if no value reaches the noise, if the records cannot distinguish the value from an effect, or if not all values were
    tried.
    """
    if stage.partial or stage.chosen is None or not worth_it(stage) or any(t.candidate.kind != VALUE for t in stage.cluster):
        return None
    effect = confirm_one(SelectedEffect(stage, stage.cluster), models[-1].comparison)
    if effect is None or not near_noise(effect.rung) or not is_adequate([*models, effect.rung], [effect]):
        return None
    return effect


def _beside(findings: Sequence[AddedEffect], chosen: Refit, stage: Stage
            ) -> tuple[tuple[AddedEffect, ...], tuple[Refit, ...]]:
    """Findings, and fixed values that the records cannot distinguish from them; `chosen` is the refit of the last finding.

    If there is a single finding, values that explain the misfit better, though not significantly, become its alternatives.
    Otherwise the findings remain unchanged.
    """
    values = () if stage.partial else tuple(t for t in stage.cluster if t.candidate.kind == VALUE)
    better_values = [t for t in values if merit(t) < merit(chosen) - DECISIVE]
    if len(findings) > 1 or not better_values:
        return tuple(findings), values
    return (replace(findings[0], alternatives=(*findings[0].alternatives, *better_values)),), values
