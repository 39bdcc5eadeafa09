"""From a misfit to the physical effect that is missing: the ladder of findings, and how sure they are.

Each rung (see `diagnosis.stage`) adds an effect that leaves little on records that were not fitted. A finding is called by
name only where, after it, what is left there is near the noise or nearly all of the error is gone; else it is a shape: a
place and a curve. Where the records cannot tell candidates apart, all are named.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

from heavebond.core import facade
from heavebond.core.cancellation import clear_signal, finishing, time_limit
from heavebond.core.errors import HeavebondError, Problem, UsageError, listing, suggest
from heavebond.core.presentation import brief
from heavebond.core.presentation import number as written
from heavebond.core.progress import Progress
from heavebond.core.quantities import si_value
from heavebond.core.reporting import reporting
from heavebond.core.threads import single_threaded
from heavebond.diagnosis.adequacy import Adequacy, adequacy
from heavebond.diagnosis.alternatives import Alternative
from heavebond.diagnosis.catalogue import Candidate, candidates
from heavebond.diagnosis.experiment_design import Separation, separate
from heavebond.diagnosis.fixed_values import VALUE, fixed_values
from heavebond.diagnosis.ladder import AddedEffect, LadderEntry, ladder_entry, with_limits
from heavebond.diagnosis.ranking import as_dicts, entries
from heavebond.diagnosis.refit import Refit
from heavebond.diagnosis.stage import (
    SECONDS,
    Stage,
    choosing,
    following,
    make_curve_stage,
    make_stage,
    make_value_stage,
    merit,
    single,
)
from heavebond.diagnosis.stepwise_selection import DECISIVE, MOST, SelectedEffect, Selection, select_stepwise
from heavebond.diagnosis.verdict import (
    equivalent_value_words,
    is_adequate,
    near_noise,
    sentences,
    unexplained,
    verdict,
    worth_it,
)
from heavebond.estimation.comparison import Comparison, compare
from heavebond.estimation.excerpts import as_long_as, cut, excerpt
from heavebond.estimation.experiment import Experiment, load_experiment
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
             seconds: float | str = SECONDS, classes: Sequence[str] = (), samples: int | None = None,
             progress: Progress | None = None) -> Diagnosis:
    """Identify the effect that the diagram of an experiment lacks.

    Stepwise selection of at most `steps` effects, as long as more than the noise is left and each lowers the errors on the
    selection data beyond chance and noticeably (see `diagnosis.stepwise_selection`). `number` is the number of processes,
    by default that of the processors; after `seconds` (s, or text with a unit) in all the search ends with its best result
    so far; `classes` restricts the catalogue to classes of effects. The search uses `samples` samples of long records (see
    `estimation.excerpts`), the final fit uses all. `progress` is called with a text at each step. Ctrl-C ends the
    search with the effects found so far. Raises ModelError and DataError where `experiment` is wrong, UsageError where
    no record is to be fitted.
    """
    began, seconds = clock.perf_counter(), si_value(seconds, "s", "seconds")
    experiment = _loaded(experiment)
    say = progress or (lambda text: None)
    base = fit(experiment, progress=lambda text: say(f"fitting what is free: {text}")) if experiment.free else None
    ladder = _first_rungs(experiment, base)
    first = clock.perf_counter() - began
    until = began + seconds - (max(KEPT * seconds, min(AGAIN * first, MOST_KEPT * seconds)) if isfinite(seconds) else 0.0)

    def left() -> float:
        return max(0.0, until - clock.perf_counter())

    def stepping(experiment: Experiment, way: Selection) -> Stage:
        beside = f" beside {listing(added.candidate.label for added in way)}" if len(way) > 1 else ""
        return make_stage(experiment, number=number, seconds=left(), classes=classes, thorough=not way,
                    progress=lambda text: say(f"step {len(way) + 1}{beside}: {text}"))

    try:
        with time_limit(left()):
            part, way, last = _climbed(experiment, excerpt(experiment, ladder[-1].comparison, samples),
                                       lambda now: select_stepwise(_at(now, base), stepping, say, steps, left))
    except KeyboardInterrupt:
        if left() > 0:
            raise
        clear_signal()
        raise UsageError([_too_short(seconds, first)]) from None
    # the last step made may be that of the last effect itself
    short = bool(way) and last.chosen is way[-1].chosen and not last.partial and len(way) < steps and not way[-1].is_noise
    made = [*(added.step for added in (way[:-1] if way and last.chosen is way[-1].chosen else way)), last]
    with finishing(say):
        findings = _confirmed(way, ladder, experiment, say)
    ladder += [f.rung for f in findings]
    now = _at(findings[-1].fit.experiment, findings[-1].fit) if findings else _at(experiment, base)
    come = _SearchState(ladder, findings, made)
    if made[0].left.significant and not made[-1].partial and (not classes or VALUE in classes):
        come = _weighed(come, way, experiment, lambda beside: _within(left(), lambda: make_value_stage(
            as_long_as(part, _at(experiment, base)), beside=beside, number=number, seconds=left(),
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
            *(apart.words if apart is not None else ()),
            *_lost(come.steps),
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
    """The adequacy of the first finding, after which more than noise is left, by learnt curves in its place. Where one of
    these explains most of what is left, it takes the place of the name."""
    if not way or not come.findings or come.findings[0].candidate is not way[0].candidate:
        return come, None, None
    say("fitting learnt curves in place of the effect")
    curves = None if come.steps[-1].partial else _within(seconds, lambda: make_curve_stage(
        way[0].step.experiment, number=number, seconds=seconds, progress=lambda text: say(f"learnt curves: {text}")))
    judged = adequacy(way[0].chosen, way[0].step, curves, not come.steps[-1].partial)
    if not judged.beaten or judged.flexible is None or curves is None:
        return come, None, judged
    with finishing(say):
        shape = _finding(SelectedEffect(choosing(curves, judged.flexible), (judged.flexible,)), given)
    without = come.ladder[:len(come.ladder) - len(come.findings)]
    return _SearchState(without, (), [*come.steps[:1]], come.values), shape, judged


def _climbed(experiment: Experiment, part: Experiment, climbing: Callable[[Experiment], tuple[Selection, Stage]]
             ) -> tuple[Experiment, Selection, Stage]:
    """The ladder that is found on a part of the records; on the whole where the part shows nothing, as what is missing may
    show later. With what it was found on."""
    way, last = climbing(part)
    if part is experiment or last.left.significant or last.partial:
        return part, *_noticeable(way, last)
    return experiment, *_noticeable(*climbing(experiment))


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


def _confirmed(way: Selection, ladder: Sequence[LadderEntry], given: Experiment, say: Progress) -> list[AddedEffect]:
    """The effects of a ladder with intervals and figures from full runs on the whole of the `given` records. What the first
    one explains by itself is not taken back because several together do not reach the noise: then it stands alone."""
    findings: list[AddedEffect] = []
    for added in way:
        say(f"confirming {added.candidate.label}")
        findings.append(_finding(added, given))
    if len(findings) > 1 and is_adequate(ladder, findings[:1]) and not is_adequate(ladder, findings):
        return [replace(findings[0], alternatives=way[0].step.cluster)]
    return findings


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


@dataclass(frozen=True)
class Attempt:
    """One effect tried by hand: the ladder without and with it, the finding, how far BIC falls, and whether it earns its
    place on held-out data."""

    ladder: tuple[LadderEntry, ...]
    finding: AddedEffect
    bic_difference: float
    earned: bool

    def as_dict(self) -> dict[str, object]:
        """The figures, for machines."""
        return {"ladder": [r.as_dict() for r in self.ladder], "step": self.finding.as_dict(),
                "bic_difference": self.bic_difference, "earned": self.earned}


@reporting
@single_threaded
def attempt(experiment: Experiment | str | Path, component: str, places: Sequence[str] = (), *,
            progress: Progress | None = None) -> Attempt:
    """Insert one effect into the diagram of an experiment and fit it.

    `attempt("rig.yaml", "CoulombFriction", ["platform", "crown"])`. `component` is the name of a component with an
    `effect:`, of a dormant parameter (`cylinder.leakage`) or of a fixed one (`crown.m`); `places` name nodes, parts or
    outputs until one place is left. Values of the result are in SI. `progress` is called with a text at each step.
    Raises UsageError where no place or several fit, and whatever `fit` raises.
    """
    experiment = _loaded(experiment)
    say = progress or (lambda text: None)
    values = [c for c in fixed_values(experiment) if c.name == component]
    chosen = _named([*candidates(experiment), *values], component, places)
    base = fit(experiment, progress=say) if experiment.free else None
    rungs = _first_rungs(experiment, base)
    made = single(_at(experiment, base), chosen, say)
    if made.chosen is None and not made.trials:
        raise UsageError([Problem("try-broken", f"the diagram with {chosen.label} cannot be simulated", None,
                                  "Try another place, or attach it in a diagram of your own and run that.")])
    trial = made.trials[0]
    found = _finding(SelectedEffect(replace(made, chosen=trial), (trial,)), experiment)
    return Attempt((*rungs, found.rung), found, trial.bic - made.bic, made.chosen is not None)


def _named(found: Sequence[Candidate], component: str, places: Sequence[str]) -> Candidate:
    """The one candidate that is meant; UsageError with those that could be."""
    kinds = [c for c in found if component in (c.component, c.name)]
    if not kinds and any(c.kind == component for c in found):
        alike = [c for c in found if c.kind == component]
        laws = dict.fromkeys(c.component for c in alike if _at_all(places, {*c.where, *c.change.nodes}))
        raise UsageError([Problem("try-class", f"'{component}' is a class of effects, not one of them", None,
                                  f"Try {listing(laws, 8)}." if laws else "`heavebond candidates` lists where it fits.")])
    if len(set(places)) < len(places):
        raise UsageError([Problem("try-place", f"'{places[0]}' is named twice; an effect between two nodes needs two", None,
                                  "Write --between and the names of two different nodes.")])
    if not kinds:
        names = dict.fromkeys([*(c.component for c in found), *(c.name for c in found if c.attaches == "in")])
        raise UsageError([Problem("try-unknown", f"no effect '{component}' fits anywhere in this diagram", None,
                                  suggest(component, names) or "`heavebond candidates` lists what does.")])
    here = [c for c in kinds if _at_all(places, {*c.where, *c.change.nodes})]
    exact = [c for c in here if _at_all(places, set(c.where)) and len(places) == len(c.where)]
    if len(here) == 1 or len(exact) == 1:
        return (exact or here)[0]
    listed = listing((c.place for c in here or kinds), 8)
    if not here:
        raise UsageError([Problem("try-place", f"{component} does not fit at {listing(places)}", None,
                                  f"It fits {listed}.")])
    raise UsageError([Problem("try-places", f"{component} fits at several places", None,
                              f"Say which, with --between NODE NODE or --at NAME: {listed}.")])


def _at_all(places: Sequence[str], known: set[str]) -> bool:
    """Whether each place is among the names of nodes, parts and outputs, or a port of a part among them (`inlet.a`)."""
    return all(place in known or place.rpartition(".")[0] in known for place in places)


def _loaded(experiment: Experiment | str | Path) -> Experiment:
    found = experiment if isinstance(experiment, Experiment) else load_experiment(experiment)
    if not any(r.use == "fit" for r in found.records.values()):
        raise UsageError([Problem("fit-no-record", "no record is to be fitted", None,
                                  "Mark at least one record with `use: fit`.")])
    return found


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


def _first_rungs(experiment: Experiment, base: Fit | None) -> list[LadderEntry]:
    """The diagram as it stands, and with its free parameters fitted."""
    name = experiment.model.name
    if base is None:
        return [ladder_entry(name, compare(experiment))]
    return [ladder_entry(name, base.before), ladder_entry(f"{name}, parameters fitted", base.after)]


def _at(experiment: Experiment, fitted: Fit | None) -> Experiment:
    """The experiment with the fitted values in its diagram."""
    if fitted is None:
        return experiment
    return replace(experiment, model=experiment.model.with_parameters(fitted.values))


def _finding(added: SelectedEffect, given: Experiment) -> AddedEffect:
    """The chosen effect with intervals and figures from full runs on the whole of the records."""
    found = with_limits(added.candidate, fit(as_long_as(given, following(added.step))))
    own = {n.name for n in added.candidate.numbers}
    return AddedEffect(added.candidate, tuple(p for p in found.parameters if p.name in own),
                   ladder_entry(f"+ {added.candidate.label}", found.after), found, added.alternatives)


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
        found = _finding(SelectedEffect(made, made.cluster), given)
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
    """The learnt curve that leaves least, where one earns its place, fitted to the whole of the records."""
    made = _within(seconds, lambda: make_curve_stage(experiment, number=number, seconds=seconds))
    if made is None or made.chosen is None or not worth_it(made):
        return None
    with finishing(lambda text: None):
        return _finding(SelectedEffect(made, made.cluster), given)


def _noise(comparison: Comparison) -> dict[str, tuple[float, str, bool]]:
    first = next(iter(comparison.records.values()))
    return {c.name: (c.noise, c.unit, c.noise_given) for c in first.channels.values()}
