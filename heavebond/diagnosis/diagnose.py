"""From a misfit to the physical effect that is missing: the ladder of findings, and how sure they are.

Each rung (see `search.step`) adds an effect that leaves little on records that were not fitted. A finding is called by
name only where, after it, what is left there is near the noise or nearly all of the error is gone; else it is a shape: a
place and a curve. Where the records cannot tell candidates apart, all are named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan

from heavebond.core import facade
from heavebond.core.cancellation import Budget
from heavebond.core.cluster import Cluster
from heavebond.core.errors import HeavebondError, SimulationError, StartError, listing
from heavebond.core.presentation import brief
from heavebond.core.progress import Progress
from heavebond.core.quantities import si_value
from heavebond.core.reporting import reporting
from heavebond.core.threads import single_threaded
from heavebond.diagnosis.answer.confirm import Confirming, at_fit, compared, first_entries, loaded
from heavebond.diagnosis.answer.ranking import as_dicts, entries
from heavebond.diagnosis.answer.sentences import (
    CALIBRATION,
    CURVES,
    EFFECTS,
    FURTHER,
    VALUES,
    acting_as_values,
    before_search,
    broken_candidates,
    closed_loops,
    equivalent_value_words,
    lost_candidates,
    residual_notes,
    search_limits,
    sentences,
    so_far,
    was_ended,
    wrong_channels,
    wrong_starts,
)
from heavebond.diagnosis.answer.verdict import is_adequate, near_noise, sheet_p_value, unexplained, verdict
from heavebond.diagnosis.candidates.catalogue import called
from heavebond.diagnosis.candidates.fixed_values import VALUE
from heavebond.diagnosis.evidence.flexible_laws import Adequacy, Remainder, better, curve_alone, judged, remainder
from heavebond.diagnosis.evidence.probability import (
    Event,
    Evidence,
    evidence,
    more_probable_alone,
    probabilities,
    resemblance,
    stated,
)
from heavebond.diagnosis.search.record_starts import own_start_words, own_starts, started_entry
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.step import (
    SECONDS,
    Stage,
    choosing,
    make_calibration_stage,
    make_curve_stage,
    make_stage,
    make_value_stage,
    merit,
    worth_it,
)
from heavebond.diagnosis.search.stepwise import (
    DECISIVE,
    MOST,
    SelectedEffect,
    Selection,
    looked_back,
    select_stepwise,
    supported,
    within_the_error,
)
from heavebond.diagnosis.search.workers import working_on
from heavebond.diagnosis.state import AddedEffect, LadderEntry
from heavebond.estimation.comparison import Comparison
from heavebond.estimation.excerpts import as_long_as, cut, excerpt
from heavebond.estimation.experiment import Experiment, ExperimentOrFile
from heavebond.estimation.fitting import Fit, fit
from heavebond.experiment_design.separation import Alternative, Separation, separate

# Share of the time after which the first fit of all samples is ended with its best so far, and shares that are kept for the
# end: the fit of what was found to all samples (as long as so many of its runs take), and what is written.
FITTING, KEPT, MOST_KEPT, LAST_RUNS = 0.4, 0.1, 0.4, 6.0


# An effect confirmed by a fit to all samples, given the comparison without it; None where the time is over.
Confirm = Callable[[SelectedEffect, Comparison], AddedEffect | None]


@dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis: `verdict` (see `diagnosis.answer.verdict`), the same in `words`, and the evidence.

    `ladder` begins with the diagram unchanged and the same with its free parameters fitted. `findings` and `steps`
    correspond, but for a last step that found nothing; a fixed value that explains what no effect does is the only finding,
    after a step of effects and one of values. `shape` is the identified curve that lowers the error most where no effect
    can be named; `separation` the experiment that would distinguish the alternatives; `noise` the noise of each channel
    with its unit; `adequacy` that of the first finding where more than noise is left after it, `remainder` the law that
    explains most of what is left then, or where nothing was found; `seconds` the duration in s; `searched` is the
    experiment on the samples that the search used; `untried` what was not tried, as the search was ended early (candidates
    of a step that was cut short are in that step). One that was ended before its first candidate was scored has no steps,
    one that was ended before all records were simulated no ladder. `evidence` is what the probabilities of `events` are
    computed from, `restricted` whether only classes of effects were tried.
    """

    experiment: Experiment
    verdict: str
    words: tuple[str, ...]
    ladder: tuple[LadderEntry, ...]
    findings: tuple[AddedEffect, ...]
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

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, self.verdict, *self.words)

    def _repr_html_(self) -> str:
        """The verdict, the ladder and the parameters of the findings, for notebooks."""
        return str(facade.call("Diagnosis._repr_html_", self))

    @property
    def partial(self) -> bool:
        """Whether the search was ended early."""
        return bool(self.untried) or any(stage.partial for stage in self.steps)

    @property
    def events(self) -> tuple[Event, ...]:
        """What the records may be explained by, with the calibrated probability of each (see `evidence.probability`);
        none after a search that was ended early or restricted to classes, for which the calibration does not hold."""
        if self.evidence is None or self.partial or self.restricted:
            return ()
        return stated(probabilities(self.evidence), self.named_first)

    @property
    def named_first(self) -> tuple[str, ...]:
        """The labels of what the answer names for the first step."""
        return tuple(t.candidate.label for f in self.findings[:1] for t in f.alternatives)

    @property
    def started(self) -> bool:
        """Whether each record has a start of its own that was not free in the experiment."""
        return self.fitted is not None and bool({*self.fitted.experiment.free} - {*self.experiment.free})

    @property
    def last(self) -> Experiment:
        """The experiment on the last diagram of the ladder."""
        found = [*self.findings, *([self.shape] if self.shape is not None else [])]
        return found[-1].fit.experiment if found else self.experiment

    def as_dict(self) -> dict[str, object]:
        """Everything for machines."""
        return {
            "verdict": self.verdict, "words": list(self.words), "probabilities": [e.as_dict() for e in self.events],
            "partial": self.partial, "not_tried": list(self.untried),
            "lost": sorted({label for stage in self.steps for label in stage.lost}),
            "steps": [f.as_dict() for f in self.findings],
            "shape": self.shape and self.shape.as_dict(), "ladder": [r.as_dict() for r in self.ladder],
            "ranking": [as_dicts(entries(s)) for s in self.steps],
            "noise": {name: {"value": value, "unit": unit, "given": given}
                      for name, (value, unit, given) in self.noise.items()},
            "adequacy": self.adequacy and self.adequacy.as_dict(),
            "remainder": self.remainder and self.remainder.as_dict(),
            "separation": self.separation and self.separation.as_dict(), "seconds": self.seconds}


@reporting
@single_threaded
def diagnose(experiment: ExperimentOrFile, *, steps: int = MOST, number: int | None = None,
             executor: Cluster | None = None, seconds: float | str = SECONDS, classes: Sequence[str] = (),
             samples: int | None = None, progress: Progress | None = None,
             growing: Callable[[list[dict[str, object]]], None] | None = None) -> Diagnosis:
    """Identify the effect that the diagram of an experiment lacks.

    Stepwise selection of at most `steps` effects, as long as more than the noise is left and each lowers the errors on the
    selection data beyond chance and noticeably (see `diagnosis.search.stepwise`). `number` is the number of processes,
    by default that of the processors; with an `executor` candidates are scored and refitted on the workers of that cluster.
    After `seconds` (s, or text with a unit) in all the search ends with its best result so far; `classes` restricts the
    catalogue to classes of effects. The search uses `samples` samples of long records (see `estimation.excerpts`), the
    final fit uses all. `progress` is called with a text at each step, `growing` with the ladder as far as it has come
    (name, errors and chi-square of each model; of an effect that is not confirmed yet the errors are NaN). Ctrl-C ends the
    search with the effects found so far.
    Raises ModelError and DataError where `experiment` is wrong, UsageError where
    no record is to be fitted.
    """
    with working_on(executor):
        return _diagnosed(experiment, steps, number, seconds, classes, samples, progress, growing)


def _diagnosed(experiment: ExperimentOrFile, steps: int, number: int | None, seconds: float | str,
               classes: Sequence[str], samples: int | None, progress: Progress | None,
               growing: Callable[[list[dict[str, object]]], None] | None) -> Diagnosis:
    budget, experiment = Budget(si_value(seconds, "s", "seconds")), loaded(experiment)
    say = progress or (lambda text: None)
    grow = growing or (lambda rungs: None)
    ladder, base, comparing, by_user = _first_entries(experiment, budget, say)
    if not ladder and budget.left() > 0:
        raise KeyboardInterrupt
    if by_user or not ladder or (experiment.free and base is None):
        return _without_search(experiment, ladder, base, budget)
    asked = experiment
    started = budget.made(lambda: own_starts(asked, ladder[-1], min(FITTING * budget.seconds, budget.left()), say))
    if started is not None:
        experiment, base, ladder = started.experiment, started, [*ladder, started_entry(started)]
    grow([entry.as_dict() for entry in ladder])
    kept = _for_the_end(budget, base)

    def left() -> float:
        return budget.left(kept)

    def stepping(experiment: Experiment, way: Selection) -> Stage:
        grow([*(entry.as_dict() for entry in ladder), *map(_unconfirmed, way)])
        beside = f" beside {listing(added.candidate.label for added in way)}" if len(way) > 1 else ""
        return make_stage(experiment, number=number, seconds=left(), classes=classes, thorough=not way,
                    progress=lambda text: say(f"step {len(way) + 1}{beside}: {text}"))

    cut_short: set[str] = set()

    def calibrating(experiment: Experiment) -> Stage:
        cut_short.add(CALIBRATION)  # until it has come to its end
        made = make_calibration_stage(experiment, number=number, seconds=left(), classes=classes,
                                      progress=lambda text: say(f"beside calibration errors: {text}"))
        if not made.partial:
            cut_short.clear()
        return made

    def trying_values(beside: Refit | None) -> Stage | None:
        return Budget(left()).made(lambda: make_value_stage(
            as_long_as(part, at_fit(experiment, base)), beside=beside, number=number, seconds=left(),
            progress=lambda text: say(f"trying other values of what is held fixed: {text}")))

    climbed = budget.made(lambda: _climbed(
        experiment, excerpt(experiment, ladder[-1].comparison, samples),
        lambda now: select_stepwise(at_fit(now, base), stepping, say, steps, left, calibrating)), kept)
    if climbed is None:
        return _without_search(experiment, ladder, base, budget)
    part, whole, last = climbed
    way, unsupported = supported(whole, say, lambda way: looked_back(way, stepping, say)[0] if left() > 0 else way)
    if unsupported:
        last = replace(unsupported[-1].added.step, partial=last.partial)
    # the last step made may be that of the last effect itself
    ended = bool(way) and last.chosen is way[-1].chosen
    short = ended and not last.partial and len(way) < steps and not way[-1].is_noise and not within_the_error(way)
    made = [*(_answered(added.step, added) for added in (way[:-1] if ended else way)),
            _answered(last, way[-1]) if ended else replace(last, chosen=None, cluster=())]
    confirming = Confirming(budget, experiment, part, base, comparing, say)
    ladder, findings = confirming.all(way, ladder)
    if way and not findings:
        made[-1] = replace(made[-1], partial=True)
    now = at_fit(findings[-1].fit.experiment, findings[-1].fit) if findings else at_fit(experiment, base)
    come = _SearchState(ladder, findings, made, untried=(*cut_short, *([FURTHER] if short else [])))
    if made[0].left.significant and (not classes or VALUE in classes):
        come = come.without(VALUES) if made[-1].partial else _weighed(come, way, confirming.one, trying_values)
    shape, adequate = None, None
    if unexplained(come.ladder, come.findings, come.steps):
        come, shape, adequate = _without_name(come, way, whole, confirming.one, number, left(), say)
    if shape is None and not (adequate is not None and adequate.stands) and not come.steps[-1].partial \
            and VALUES not in come.untried and unexplained(come.ladder, come.findings, come.steps):
        say("learning a curve")
        come, shape = _shape(come, as_long_as(part, now), confirming.one, number, left())
    found = [*come.findings, *([shape] if shape is not None else [])]
    last_fit = at_fit(found[-1].fit.experiment, found[-1].fit) if found else at_fit(experiment, base)
    rest = Budget(left()).made(lambda: remainder(as_long_as(part, last_fit), say)) \
        if not come.steps[-1].partial and unexplained(come.ladder, come.findings, come.steps) else None
    rungs = (*come.ladder, *([shape.rung] if shape is not None else []))
    said = verdict(base, rungs, come.findings, come.steps, shape, adequate, not {VALUES, CURVES} & set(come.untried))
    apart = _separation(asked, come.findings, say, left()) if said == "one_of" else None
    told = (*sentences(said, rungs, come.findings, come.steps, shape, adequate), *map(equivalent_value_words, come.values),
            *acting_as_values(come.findings, come.steps, [t.candidate.name for t in come.values]),
            *(apart.words if apart is not None else ()),
            *(u.words for u in reversed(unsupported) if come.findings and said not in ("effect", "one_of", "parameters")),
            *residual_notes(said, rest, come.steps),
            *lost_candidates(come.steps), *broken_candidates(said, come.steps), *closed_loops(ladder[0].comparison),
            *own_start_words(asked, base, found[-1].fit if found else base), *wrong_starts(said, rungs[-1].comparison),
            *so_far(come.steps, come.untried),
            *search_limits(classes, cut(part, experiment), confirming.shorter))
    answer = Diagnosis(asked, said, told, rungs, tuple(come.findings), tuple(come.steps), shape, base,
                       _noise(ladder[0].comparison), budget.spent, apart, part, adequate, come.untried, rest,
                       evidence(come.steps, come.fixed, sheet_p_value(base)), bool(classes))
    if said in ("effect", "one_of", "mainly"):
        alone = more_probable_alone(answer.events, answer.named_first, [called(f.candidate) for f in come.findings[1:]])
        answer = replace(answer, words=(*told[:1], *resemblance(answer.events), *alone, *told[1:]))
    return replace(answer, words=(*wrong_channels(rungs[-1].comparison), *answer.words))


def _first_entries(experiment: Experiment, budget: Budget, say: Progress
                   ) -> tuple[list[LadderEntry], Fit | None, float, bool]:
    """The ladder as far as it comes in the time: the diagram compared with all records, and with what is free fitted; the
    fit; how long the comparison took (s); and whether it was ended by Ctrl-C."""
    before = None
    say("simulating all records")
    try:
        before = budget.made(lambda: compared(experiment))
        if before is None:
            return [], None, 0.0, False
    except (SimulationError, StartError):
        if not experiment.free:
            raise  # else the fit may find values at which it can be simulated, and says more where it does not
    took = budget.spent
    first = first_entries(experiment, None, before) if before is not None else []
    if not experiment.free:
        return first, None, took, False
    most, began = min(FITTING * budget.seconds, budget.left(2 * took)), budget.spent
    base = budget.made(lambda: fit(experiment, progress=lambda text: say(f"fitting what is free: {text}"), partial=True,
                                   seconds=most, before=before))
    if base is None:
        return first, None, took, budget.left() > 0
    return first_entries(experiment, base), base, took, was_ended(base) and budget.spent - began < most


def _for_the_end(budget: Budget, base: Fit | None) -> float:
    """How much time (s) is kept for the fit of what is found to all samples, which takes some runs from near its optimum."""
    if not isfinite(budget.seconds):
        return 0.0
    needed = LAST_RUNS * budget.spent / max(base.evaluations if base is not None else 1, LAST_RUNS / 2)
    return max(KEPT * budget.seconds, min(needed, MOST_KEPT * budget.seconds))


def _without_search(experiment: Experiment, ladder: Sequence[LadderEntry], base: Fit | None, budget: Budget) -> Diagnosis:
    """The answer where the search was ended before its first candidate was scored."""
    noise = _noise(ladder[0].comparison) if ladder else {}
    return Diagnosis(experiment, "undetermined", before_search(ladder, base), tuple(ladder), (), (), None, base, noise,
                     budget.spent, None, experiment, None, (EFFECTS, VALUES, CURVES))


@dataclass(frozen=True)
class _SearchState:
    """What a search has come to: the ladder, its findings and steps, values of what is held fixed that the records cannot
    tell from the findings, and the step of all such values."""

    ladder: Sequence[LadderEntry]
    findings: Sequence[AddedEffect]
    steps: Sequence[Stage]
    values: Sequence[Refit] = ()
    untried: tuple[str, ...] = ()
    fixed: Stage | None = None

    def without(self, what: str) -> _SearchState:
        """The same with one thing more that was not tried to its end."""
        return replace(self, untried=tuple(dict.fromkeys((*self.untried, what))))


def _without_name(come: _SearchState, way: Selection, whole: Selection, confirm: Confirm, number: int | None, seconds: float,
                  say: Progress) -> tuple[_SearchState, AddedEffect | None, Adequacy | None]:
    """The adequacy of the first finding, after which more than noise is left, by identified curves in its place. Where one
    of these explains most of what is left, and nothing was found beside it, or one alone leaves less than all that was
    found, it takes the place of the name. What was found besides but is not named, as in the `whole` ladder, is no name, yet
    what explains more than a curve."""
    if not way or not come.findings or come.findings[0].candidate is not way[0].candidate:
        return come, None, None
    say("fitting identified curves in place of the effect")
    tried = not come.steps[-1].partial and not {FURTHER, CALIBRATION} & set(come.untried)
    found, curves = judged(way[:len(come.findings)], not come.steps[0].partial and VALUES not in come.untried, tried, number,
                           seconds, say)
    come = come if curves is not None else come.without(CURVES)
    if not found.beaten or VALUES in come.untried:
        return come, None, found
    curve = found.flexible
    if len(come.findings) > 1:
        say("fitting identified curves in place of all effects")
        curve, curves = curve_alone(way[:len(come.findings)], number, seconds, say)
    if curve is None or curves is None:
        return come, None, found
    if len(whole) > len(come.findings) and not better(curve, whole[-1].chosen):
        return come, None, replace(found, beaten=False)
    without = come.ladder[:len(come.ladder) - len(come.findings)]
    shape = confirm(SelectedEffect(choosing(curves, curve), (curve,)), without[-1].comparison)
    if shape is None:
        return come.without(CURVES), None, found
    return replace(come, ladder=without, findings=(), steps=[replace(come.steps[0], chosen=None, cluster=())]), shape, found


def _unconfirmed(added: SelectedEffect) -> dict[str, object]:
    """What a search knows of an effect on the samples that it looks at."""
    trial = added.chosen
    return {"name": f"+ {added.candidate.label}", "error_fit": nan, "error_held_out": nan, "chi2_fit": trial.chi2_fit,
            "chi2_held_out": trial.chi2_held_out}


def _climbed(experiment: Experiment, part: Experiment, climbing: Callable[[Experiment], tuple[Selection, Stage]]
             ) -> tuple[Experiment, Selection, Stage]:
    """The ladder that is found on a part of the records; on the whole where the part shows nothing, as what is missing may
    show later. With what it was found on."""
    way, last = climbing(part)
    if part is experiment or last.left.significant or last.partial:
        return part, *_noticeable(way, last)
    return experiment, *_noticeable(*climbing(experiment))


def _answered(step: Stage, added: SelectedEffect) -> Stage:
    """A step whose ranking marks what the answer names: what cannot be told from its effect beside all others."""
    return replace(step, cluster=added.alternatives)


def _noticeable(way: Selection, last: Stage) -> tuple[Selection, Stage]:
    """A ladder without a single effect that hardly takes anything away: beside what no law explains (the noise of a measured
    input) some law always takes a few percent, beyond chance, and would be a name for nothing."""
    if len(way) != 1 or worth_it(way[0].step):
        return way, last
    return (), replace(way[0].step, chosen=None, cluster=(), partial=last.partial)


def _separation(machine: Experiment, findings: Sequence[AddedEffect], say: Progress, seconds: float) -> Separation | None:
    """The experiment that would tell apart what the first finding without one name may be, the best law of each class at
    each place; None where the search for it is ended early or one of the diagrams cannot be run."""
    unsure = next(f for f in findings if not f.certain)
    best: dict[object, Refit] = {}
    for trial in unsure.alternatives:
        best.setdefault((trial.candidate.kind, frozenset(trial.candidate.where)), trial)
    try:
        return Budget(seconds).made(lambda: separate([Alternative(
            f"{t.candidate.kind} {t.candidate.place}", t.experiment, t.values, t.samples + t.samples_held_out)
            for t in best.values()], machine=machine, progress=say))
    except HeavebondError:
        return None


def _weighed(come: _SearchState, way: Selection, confirm: Confirm, trying: Callable[[Refit | None], Stage | None]
             ) -> _SearchState:
    """What is found against other values of what the diagram holds fixed, `trying` these beside a trial that explains the
    records: a value takes its place where it is better, and stands beside it where the records cannot tell."""
    without = come.ladder[:len(come.ladder) - len(come.findings)]
    chosen = way[len(come.findings) - 1].chosen if come.findings and is_adequate(come.ladder, come.findings) else None
    made = trying(chosen)
    come = replace(come, fixed=made)
    if made is not None and (value := _value(made, confirm, without)) is not None:
        return _SearchState([*without, value.rung], [value], [replace(come.steps[0], chosen=None, cluster=()), made],
                            fixed=made)
    if made is None or made.partial:  # ended by the user, or by time
        come = come.without(VALUES)
        if not come.findings:
            return replace(come, steps=[*come.steps[:-1], replace(come.steps[-1], partial=True)])
    if made is None or chosen is None:
        return come
    findings, values = _beside(come.findings, chosen, made)
    return replace(come, findings=findings, values=values)


def _value(made: Stage, confirm: Confirm, ladder: Sequence[LadderEntry]) -> AddedEffect | None:
    """The fixed value by which what is left becomes noise, fitted to the whole of the records; None where there is none,
    where an effect that stands beside the values is no worse, and where not all values were tried."""
    if made.partial or made.chosen is None or not worth_it(made) or any(t.candidate.kind != VALUE for t in made.cluster):
        return None
    found = confirm(SelectedEffect(made, made.cluster), ladder[-1].comparison)
    return found if found is not None and near_noise(found.rung) and is_adequate([*ladder, found.rung], [found]) else None


def _beside(findings: Sequence[AddedEffect], chosen: Refit, made: Stage) -> tuple[list[AddedEffect], list[Refit]]:
    """The findings, the last of which came with the trial that was `chosen`, and the values that the records cannot tell
    from them. The only finding has those beside it that are the better explanation, though not by enough to decide: as near
    with fewer numbers. Where they are no better, what is held fixed is taken as right."""
    values = [] if made.partial else [t for t in made.cluster if t.candidate.kind == VALUE]
    better = [t for t in values if merit(t) < merit(chosen) - DECISIVE]
    if len(findings) > 1 or not better:
        return list(findings), values
    return [replace(findings[0], alternatives=(*findings[0].alternatives, *better))], values


def _shape(come: _SearchState, experiment: Experiment, confirm: Confirm, number: int | None, seconds: float
           ) -> tuple[_SearchState, AddedEffect | None]:
    """The identified curve that leaves least, where one earns its place, fitted to the whole of the records."""
    made = Budget(seconds).made(lambda: make_curve_stage(experiment, number=number, seconds=seconds))
    come = come if made is not None and not made.partial else come.without(CURVES)
    if made is None or made.chosen is None or not worth_it(made):
        return come, None
    shape = confirm(SelectedEffect(made, made.cluster), come.ladder[-1].comparison)
    return (come if shape is not None else come.without(CURVES)), shape


def _noise(comparison: Comparison) -> dict[str, tuple[float, str, bool]]:
    first = next(iter(comparison.records.values()))
    return {c.name: (c.noise, c.unit, c.noise_given) for c in first.channels.values()}
