"""From a misfit to the physical effect that is missing: the ladder of findings, and how sure they are.

Each rung (see `diagnosis.stage`) adds an effect that leaves little on records that were not fitted. A finding is called by
name only where, after it, what is left there is near the noise or nearly all of the error is gone; else it is a shape: a
place and a curve. Where the records cannot tell candidates apart, all are named.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from pathlib import Path

from heavebond.core import facade
from heavebond.core.cancellation import clear_signal, finishing, time_limit
from heavebond.core.cluster import Cluster
from heavebond.core.errors import HeavebondError, Problem, UsageError, listing
from heavebond.core.presentation import brief
from heavebond.core.presentation import number as written
from heavebond.core.progress import Progress
from heavebond.core.quantities import si_value
from heavebond.core.reporting import reporting
from heavebond.core.threads import single_threaded
from heavebond.diagnosis.adequacy import Adequacy, adequacy
from heavebond.diagnosis.alternatives import Alternative
from heavebond.diagnosis.candidate_workers import working_on
from heavebond.diagnosis.experiment_design import Separation, separate
from heavebond.diagnosis.fixed_values import VALUE
from heavebond.diagnosis.full_runs import at_fit, confirmed, first_entries, loaded
from heavebond.diagnosis.ladder import AddedEffect, LadderEntry, with_limits
from heavebond.diagnosis.ranking import as_dicts, entries
from heavebond.diagnosis.refit import Refit
from heavebond.diagnosis.stage import (
    SECONDS,
    Stage,
    choosing,
    make_calibration_stage,
    make_curve_stage,
    make_stage,
    make_value_stage,
    merit,
)
from heavebond.diagnosis.stepwise_selection import DECISIVE, MOST, SelectedEffect, Selection, select_stepwise
from heavebond.diagnosis.verdict import (
    acting_as_values,
    equivalent_value_words,
    is_adequate,
    near_noise,
    sentences,
    unexplained,
    verdict,
    worth_it,
)
from heavebond.estimation.comparison import Comparison
from heavebond.estimation.excerpts import as_long_as, cut, excerpt
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.fitting import Fit, fit

SHORT = "More than the noise is left, and the time did not suffice for a further step: `--seconds` gives it more."
# Share of the time that is kept for the end: the fit of what was found to all samples, and what is written.
KEPT, MOST_KEPT = 0.1, 0.4
AGAIN = 2.0  # and between these as often the time of the first fit of all samples


@dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis: `verdict` (see `heavebond.diagnosis.verdict`), the same in `words`, and the evidence.

    `ladder` begins with the diagram unchanged and the same with its free parameters fitted. `findings` and `steps`
    correspond, but for a last step that found nothing; a fixed value that explains what no effect does is the only
    finding, after a step of effects and one of values. `shape` is the identified curve that lowers the error most where
    no effect can be named; `separation` the experiment that would distinguish the alternatives; `noise` the noise of
    each channel with its unit; `adequacy` that of the first finding where more than noise is left after it; `seconds` the
    duration in s; `searched` is the experiment on the samples that the search used.
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

    def __repr__(self) -> str:
        return brief(self, self.experiment.name, self.verdict, *self.words)

    def _repr_html_(self) -> str:
        """The verdict, the ladder and the parameters of the findings, for notebooks."""
        return str(facade.call("Diagnosis._repr_html_", self))

    @property
    def last(self) -> Experiment:
        """The experiment on the last diagram of the ladder."""
        found = [*self.findings, *([self.shape] if self.shape is not None else [])]
        return found[-1].fit.experiment if found else self.experiment

    def as_dict(self) -> dict[str, object]:
        """Everything for machines."""
        return {
            "verdict": self.verdict, "words": list(self.words),
            "partial": any(stage.partial for stage in self.steps),
            "lost": sorted({label for stage in self.steps for label in stage.lost}),
            "steps": [f.as_dict() for f in self.findings],
            "shape": self.shape and self.shape.as_dict(), "ladder": [r.as_dict() for r in self.ladder],
            "ranking": [as_dicts(entries(s)) for s in self.steps],
            "noise": {name: {"value": value, "unit": unit, "given": given}
                      for name, (value, unit, given) in self.noise.items()},
            "adequacy": self.adequacy and self.adequacy.as_dict(),
            "separation": self.separation and self.separation.as_dict(), "seconds": self.seconds}


@reporting
@single_threaded
def diagnose(experiment: Experiment | str | Path, *, steps: int = MOST, number: int | None = None,
             executor: Cluster | None = None, seconds: float | str = SECONDS, classes: Sequence[str] = (),
             samples: int | None = None, progress: Progress | None = None,
             growing: Callable[[list[dict[str, object]]], None] | None = None) -> Diagnosis:
    """Identify the effect that the diagram of an experiment lacks.

    Stepwise selection of at most `steps` effects, as long as more than the noise is left and each lowers the errors on the
    selection data beyond chance and noticeably (see `diagnosis.stepwise_selection`). `number` is the number of processes,
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


def _diagnosed(experiment: Experiment | str | Path, steps: int, number: int | None, seconds: float | str,
               classes: Sequence[str], samples: int | None, progress: Progress | None,
               growing: Callable[[list[dict[str, object]]], None] | None) -> Diagnosis:
    began, seconds = clock.perf_counter(), si_value(seconds, "s", "seconds")
    experiment = loaded(experiment)
    say = progress or (lambda text: None)
    base = fit(experiment, progress=lambda text: say(f"fitting what is free: {text}")) if experiment.free else None
    ladder = first_entries(experiment, base)
    grow = growing or (lambda rungs: None)
    grow([entry.as_dict() for entry in ladder])
    first = clock.perf_counter() - began
    until = began + seconds - (max(KEPT * seconds, min(AGAIN * first, MOST_KEPT * seconds)) if isfinite(seconds) else 0.0)

    def left() -> float:
        return max(0.0, until - clock.perf_counter())

    def stepping(experiment: Experiment, way: Selection) -> Stage:
        grow([*(entry.as_dict() for entry in ladder), *map(_unconfirmed, way)])
        beside = f" beside {listing(added.candidate.label for added in way)}" if len(way) > 1 else ""
        return make_stage(experiment, number=number, seconds=left(), classes=classes, thorough=not way,
                    progress=lambda text: say(f"step {len(way) + 1}{beside}: {text}"))

    def calibrating(experiment: Experiment) -> Stage:
        return make_calibration_stage(experiment, number=number, seconds=left(), classes=classes,
                                      progress=lambda text: say(f"beside calibration errors: {text}"))

    try:
        with time_limit(left()):
            part, way, last = _climbed(
                experiment, excerpt(experiment, ladder[-1].comparison, samples),
                lambda now: select_stepwise(at_fit(now, base), stepping, say, steps, left, calibrating))
    except KeyboardInterrupt:
        if left() > 0:
            raise
        clear_signal()
        raise UsageError([_too_short(seconds, first)]) from None
    # the last step made may be that of the last effect itself
    short = bool(way) and last.chosen is way[-1].chosen and not last.partial and len(way) < steps and not way[-1].is_noise
    ended = bool(way) and last.chosen is way[-1].chosen
    made = [*(_answered(added.step, added) for added in (way[:-1] if ended else way)),
            _answered(last, way[-1]) if ended else replace(last, chosen=None, cluster=())]
    with finishing(say):
        findings = _all_confirmed(way, ladder, experiment, say)
    ladder += [f.rung for f in findings]
    now = at_fit(findings[-1].fit.experiment, findings[-1].fit) if findings else at_fit(experiment, base)
    come = _SearchState(ladder, findings, made)
    if made[0].left.significant and not made[-1].partial and (not classes or VALUE in classes):
        come = _weighed(come, way, experiment, lambda beside: _within(left(), lambda: make_value_stage(
            as_long_as(part, at_fit(experiment, base)), beside=beside, number=number, seconds=left(),
            progress=lambda text: say(f"trying other values of what is held fixed: {text}"))))
    shape, judged = None, None
    if unexplained(come.ladder, come.findings, come.steps):
        come, shape, judged = _without_name(come, way, experiment, number, left(), say)
    if shape is None and not (judged is not None and judged.stands) and not come.steps[-1].partial \
            and unexplained(come.ladder, come.findings, come.steps):
        say("learning a curve")
        shape = _shape(as_long_as(part, now), experiment, number, left())
    rungs = (*come.ladder, *([shape.rung] if shape is not None else []))
    said = verdict(base, rungs, come.findings, come.steps, shape, judged)
    apart = _separation(come.findings, say, left()) if said == "one_of" else None
    told = (*sentences(said, rungs, come.findings, come.steps, shape, judged), *map(equivalent_value_words, come.values),
            *acting_as_values(come.findings, come.steps, [t.candidate.name for t in come.values]),
            *(apart.words if apart is not None else ()),
            *_lost(come.steps),
            *(f"{name}: {said}." for name, record in rungs[-1].comparison.records.items() for said in record.starts),
            *([SHORT] if short else []),
            *_limits(classes, cut(part, experiment)))
    return Diagnosis(experiment, said, told, rungs, tuple(come.findings), tuple(come.steps), shape, base,
                     _noise(ladder[0].comparison), clock.perf_counter() - began, apart, part, judged)


@dataclass(frozen=True)
class _SearchState:
    """What a search has come to: the ladder, its findings and steps, and values of what is held fixed that the records
    cannot tell from the findings."""

    ladder: Sequence[LadderEntry]
    findings: Sequence[AddedEffect]
    steps: Sequence[Stage]
    values: Sequence[Refit] = ()


def _without_name(come: _SearchState, way: Selection, given: Experiment, number: int | None, seconds: float, say: Progress
                  ) -> tuple[_SearchState, AddedEffect | None, Adequacy | None]:
    """The adequacy of the first finding, after which more than noise is left, by identified curves in its place. Where one
    of these explains most of what is left, it takes the place of the name."""
    if not way or not come.findings or come.findings[0].candidate is not way[0].candidate:
        return come, None, None
    say("fitting identified curves in place of the effect")
    curves = None if come.steps[-1].partial else _within(seconds, lambda: make_curve_stage(
        way[0].step.experiment, beside=way[0].candidate, number=number, seconds=seconds,
        progress=lambda text: say(f"identified curves: {text}")))
    judged = adequacy(way[0].chosen, way[0].step, curves, not come.steps[-1].partial)
    if not judged.beaten or judged.flexible is None or curves is None:
        return come, None, judged
    with finishing(say):
        shape = confirmed(SelectedEffect(choosing(curves, judged.flexible), (judged.flexible,)), given)
    without = come.ladder[:len(come.ladder) - len(come.findings)]
    return _SearchState(without, (), [replace(come.steps[0], chosen=None, cluster=())], come.values), shape, judged


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


def _lost(steps: Sequence[Stage]) -> list[str]:
    """What the search is without, as the system ended a process."""
    lost = list(dict.fromkeys(label for step in steps for label in step.lost))
    return [f"Not tried to the end: {listing(lost, 4)}. The processes that worked on this died, also when it was tried "
            "again alone (killed, or out of memory). Fewer `--processes`, or `--samples`, need less memory."] if lost else []


def _limits(classes: Sequence[str], looked: str) -> list[str]:
    """What was left out of the search."""
    only = f"Tried were only effects of {'this class' if len(classes) == 1 else 'these classes'}: {listing(classes)}."
    part = f"The records are long: the search looked at their beginning ({looked}), and what it found was fitted to all " \
        "of them. `--samples` sets how much, `from:` and `to:` at a record which part."
    return [*([only] if classes else []), *([part] if looked else [])]


def _all_confirmed(way: Selection, ladder: Sequence[LadderEntry], given: Experiment, say: Progress) -> list[AddedEffect]:
    """The effects of a ladder with intervals and figures from full runs on the whole of the `given` records. What the first
    one explains by itself is not taken back because several together do not reach the noise: then it stands alone."""
    findings: list[AddedEffect] = []
    for added in way:
        say(f"confirming {added.candidate.label}")
        findings.append(confirmed(added, given))
    if len(findings) > 1 and is_adequate(ladder, findings[:1]) and not is_adequate(ladder, findings):
        return [replace(findings[0], alternatives=way[0].step.cluster)]
    return [*(_beside_all(finding, findings[-1].fit) for finding in findings[:-1]), *findings[-1:]]


def _beside_all(finding: AddedEffect, last: Fit) -> AddedEffect:
    """An effect with the values and intervals of the fit with all effects."""
    own = {p.name for p in finding.parameters}
    parameters = tuple(p for p in with_limits(finding.candidate, last).parameters if p.name in own)
    return replace(finding, parameters=parameters) if len(parameters) == len(own) else finding


def _separation(findings: Sequence[AddedEffect], say: Progress, seconds: float) -> Separation | None:
    """The experiment that would tell apart what the first finding without one name may be, the best law of each class at
    each place; None where the search for it is ended early or one of the diagrams cannot be run."""
    unsure = next(f for f in findings if not f.certain)
    best: dict[object, Refit] = {}
    for trial in unsure.alternatives:
        best.setdefault((trial.candidate.kind, frozenset(trial.candidate.where)), trial)
    if seconds <= 0:
        return None
    try:
        with time_limit(seconds):
            return separate([Alternative(f"{t.candidate.kind} {t.candidate.place}", t.experiment, t.values,
                                     t.samples + t.samples_held_out) for t in best.values()], progress=say)
    except (KeyboardInterrupt, HeavebondError):
        clear_signal()
        return None


def _within(seconds: float, make: Callable[[], Stage]) -> Stage | None:
    """A step that ends early after `seconds` (s); None where it is ended before its first candidate."""
    if seconds <= 0:
        return None
    try:
        with time_limit(seconds):
            return make()
    except KeyboardInterrupt:
        clear_signal()
        return None


def _too_short(seconds: float, first: float) -> Problem:
    """That the time was over before the first candidate; the fit of what is free took `first` (s)."""
    return Problem("time-short", f"the time of {written(seconds)} s was over before the first candidate was scored: "
                   f"the fit of the free parameters took {written(first, 2)} s, and a part is kept for the result", None,
                   "Give it more time (`--seconds`), or fewer samples (`--samples`, or `from:` and `to:` at a record).")


def _weighed(come: _SearchState, way: Selection, given: Experiment, trying: Callable[[Refit | None], Stage | None]
             ) -> _SearchState:
    """What is found against other values of what the diagram holds fixed, `trying` these beside a trial that explains the
    records: a value takes its place where it is better, and stands beside it where the records cannot tell."""
    without = come.ladder[:len(come.ladder) - len(come.findings)]
    chosen = way[len(come.findings) - 1].chosen if come.findings and is_adequate(come.ladder, come.findings) else None
    made = trying(chosen)
    if made is None:
        return replace(come, steps=[*come.steps[:-1], replace(come.steps[-1], partial=chosen is None)])
    if (value := _value(made, given, without)) is not None:
        return _SearchState([*without, value.rung], [value], [replace(come.steps[0], chosen=None, cluster=()), made])
    if chosen is not None:
        findings, values = _beside(come.findings, chosen, made)
        return replace(come, findings=findings, values=values)
    # ended by the user, or by time: nothing more is begun
    return replace(come, steps=[*come.steps[:-1], replace(come.steps[-1], partial=True)]) if made.partial else come


def _value(made: Stage, given: Experiment, ladder: Sequence[LadderEntry]) -> AddedEffect | None:
    """The fixed value by which what is left becomes noise, fitted to the whole of the records; None where there is none,
    where an effect that stands beside the values is no worse, and where not all values were tried."""
    if made.partial or made.chosen is None or not worth_it(made) or any(t.candidate.kind != VALUE for t in made.cluster):
        return None
    with finishing(lambda text: None):
        found = confirmed(SelectedEffect(made, made.cluster), given)
    return found if near_noise(found.rung) and is_adequate([*ladder, found.rung], [found]) else None


def _beside(findings: Sequence[AddedEffect], chosen: Refit, made: Stage) -> tuple[list[AddedEffect], list[Refit]]:
    """The findings, the last of which came with the trial that was `chosen`, and the values that the records cannot tell
    from them. The only finding has those beside it that are the better explanation, though not by enough to decide: as near
    with fewer numbers. Where they are no better, what is held fixed is taken as right."""
    values = [] if made.partial else [t for t in made.cluster if t.candidate.kind == VALUE]
    better = [t for t in values if merit(t) < merit(chosen) - DECISIVE]
    if len(findings) > 1 or not better:
        return list(findings), values
    return [replace(findings[0], alternatives=(*findings[0].alternatives, *better))], values


def _shape(experiment: Experiment, given: Experiment, number: int | None, seconds: float) -> AddedEffect | None:
    """The identified curve that leaves least, where one earns its place, fitted to the whole of the records."""
    made = _within(seconds, lambda: make_curve_stage(experiment, number=number, seconds=seconds))
    if made is None or made.chosen is None or not worth_it(made):
        return None
    with finishing(lambda text: None):
        return confirmed(SelectedEffect(made, made.cluster), given)


def _noise(comparison: Comparison) -> dict[str, tuple[float, str, bool]]:
    first = next(iter(comparison.records.values()))
    return {c.name: (c.noise, c.unit, c.noise_given) for c in first.channels.values()}
