"""One step of the diagnosis: the search for one missing effect.

The free parameters are fitted. If more than noise is left, every candidate of the catalogue is scored, and the candidates
that can matter are refitted. The step chooses the candidate that leaves least on held-out data, if it improves the
prediction there materially.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from heavebond.core.cancellation import clear_signal
from heavebond.core.errors import SimulationError
from heavebond.core.progress import Progress
from heavebond.diagnosis.candidates.catalogue import UNKNOWN, Candidate, at_values, single_candidates, site_of
from heavebond.diagnosis.candidates.fixed_values import fixed_values, is_calibration_error
from heavebond.diagnosis.candidates.places import Places, between_all_nodes, candidates
from heavebond.diagnosis.candidates.varying import varying_parameters
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.comparison import (
    ALL,
    STRONG,
    Identity,
    best_predicting,
    compared,
    dispensable_variations,
    equivalent_values,
    leaves_noise,
    likelihood,
)
from heavebond.diagnosis.evidence.prediction import (
    FITTED,
    SELECTION,
    TEST,
    PredictiveErrors,
    predictive_errors,
    share_taken,
)
from heavebond.diagnosis.evidence.residual_tests import ResidualTests, is_above_noise, is_noise, leftover
from heavebond.diagnosis.search.base_model import TIMES, Base, finer, searched
from heavebond.diagnosis.search.onset import onsets
from heavebond.diagnosis.search.prescore import select
from heavebond.diagnosis.search.refit import Refit, bic, refitted_from
from heavebond.diagnosis.search.schedule import RefitSchedule, beyond_their_members, planned, unexplained
from heavebond.diagnosis.search.scoring import Score
from heavebond.diagnosis.search.workers import Workers
from heavebond.equations.places import nodes_of
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.residuals import Residuals
from heavebond.language.library import same_class
from heavebond.numerics.dae import Array

CLOSELY = 6  # trials at most are followed to the very end before they are compared,
CLOSE = 0.05  # those within this share of the logarithm of chi-square of the best
AS_ONE = 1e-6  # nodes move as one that differ by less than this share of the largest value
CALIBRATED = 3  # calibration errors that are refitted beside a law, those with the largest scores
STEADY = 0.01  # what varies by less than this share of its size is steady
SECONDS = 600.0  # of refits, after which none is begun
# A candidate earns its place where chi-square on held-out data falls by this, in units of what is left: normal
# deviations of some 3 squared would come by chance once in a thousand tries.
EARNED = 12.0


@dataclass(frozen=True)
class Stage:
    """One step: the experiment that was diagnosed, its best fit of what was free (chi-square per sample on what was and was
    not fitted), the tests on what that leaves, all scores and refits, best first, what was chosen, and those that the
    records cannot tell from it (the chosen one first). `partial`: not all that was planned was refitted; `lost` are the
    candidates whose process died, `broken` the labels of those with which the diagram cannot be simulated; `acts_as` are the
    numbers of the diagram of which candidates are another value, by their labels. `errors` are the predictive errors without
    any candidate, `identity` the comparison of the candidates with the chosen one. `planned` is the number of candidates
    that were to be scored, `as_one` are the nodes that move as one in the base model, each with the first of them; `failed`
    are the labels of candidates that were scored, but with which no refit could be simulated. `prescored` is the number of
    candidates between nodes that no component joins; `excluded` are the labels of effects that were not tried, got no exact
    score (see `search.prescore`) or were not kept, each with the reason. `joint` are the leading candidates, each refitted
    with one further effect (see `stepwise.best_pairs`); none if no further step was made."""

    experiment: Experiment
    values: dict[str, float]
    cost: float
    samples: int
    chi2_fit: float
    chi2_held_out: float
    samples_held_out: int
    at_end: tuple[str, ...]
    left: ResidualTests
    scores: tuple[Score, ...]
    trials: tuple[Refit, ...]
    chosen: Refit | None
    cluster: tuple[Refit, ...]
    twins: dict[str, tuple[str, ...]]
    unseen: tuple[Candidate, ...]
    partial: bool
    seconds: float
    lost: tuple[str, ...] = ()
    errors: PredictiveErrors | None = None
    identity: Identity | None = None
    acts_as: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    broken: tuple[str, ...] = ()
    planned: int = 0
    as_one: Mapping[str, str] = field(default_factory=dict)
    failed: tuple[str, ...] = ()
    prescored: int = 0
    excluded: Mapping[str, str] = field(default_factory=dict)
    joint: tuple[Refit, ...] = ()

    @property
    def bic(self) -> float:
        """The information criterion of the model without any of the candidates."""
        return bic(self.cost, self.samples, len(self.values))

    @cached_property
    def places(self) -> Places:
        """The places of its diagram."""
        return Places.of(self.experiment, self.as_one)

    @property
    def shown_held_out(self) -> bool:
        """Whether the model without any of the candidates leaves more than noise on what was not fitted: otherwise nothing
        can leave less there, and only the cross-validated errors of what was fitted tell."""
        return is_above_noise(self.chi2_held_out, self.samples_held_out)

    @property
    def merit(self) -> float:
        """That of the model without any of the candidates; see `merit`."""
        return _merit(self.cost, self.samples, len(self.values), self.errors)


def make_stage(experiment: Experiment, *, beside: Sequence[Candidate] = (), number: int | None = None,
               seconds: float = SECONDS, classes: Sequence[str] = (), progress: Progress | None = None,
               thorough: bool = True) -> Stage:
    """Score the candidates of the catalogue, and refit those that can matter. `beside` are the effects that were added to
    the diagram before: candidates that act on these instead of the machine are left out. `classes` restricts the catalogue
    to candidates of these classes. A `thorough` search refits all other candidates, too, if no refit of the candidates with
    the largest scores leaves nearly noise."""
    def chosen(candidate: Candidate) -> bool:
        return candidate.kind != UNKNOWN and (not classes or candidate.kind in classes) and not candidate.acts_on(beside)

    excluded: dict[str, str] = {}
    site = site_of(experiment)
    found = [c for c in candidates(experiment, excluded, site) if chosen(c)]
    distant = [c for c in between_all_nodes(experiment, site) if chosen(c)]
    made = _step(experiment, found, number, seconds, progress or (lambda text: None), thorough=thorough, distant=distant,
                 varying=chosen, later=bool(beside))
    return replace(made, excluded={**excluded, **made.excluded})


def make_curve_stage(experiment: Experiment, *, beside: Sequence[Candidate] = (),
                     among: Callable[[Candidate], bool] | None = None, number: int | None = None,
                     seconds: float = SECONDS, progress: Progress | None = None) -> Stage:
    """A step with identified curves only: effects without a name, at single places; at several places at once and between
    nodes that no component joins, only at the places of the effects `beside`. With `among`, the curves for which it holds
    are refitted whatever their scores are."""
    places, site = {frozenset(c.where) for c in beside}, site_of(experiment)
    curves = [c for c in candidates(experiment, site=site)
              if c.kind == UNKNOWN and (not c.members or frozenset(c.where) in places)]
    if places or among is not None:
        curves += [c for c in between_all_nodes(experiment, site) if c.kind == UNKNOWN
                   and (among is not None or frozenset(c.where) in places)]
    if among is not None:
        curves = [c for c in curves if among(c)]
    return _step(experiment, curves, number, seconds, progress or (lambda text: None), always=among is not None)


def make_calibration_stage(experiment: Experiment, *, number: int | None = None, seconds: float = SECONDS,
                           classes: Sequence[str] = (), progress: Progress | None = None) -> Stage:
    """A rung with calibration errors only: offsets and gains of inputs and channels. Only what the best of them leaves is
    wanted, so that it alone is followed to the end of its valley."""
    found = [c for c in single_candidates(experiment) if is_calibration_error(c, experiment)
             and (not classes or c.kind in classes)]
    return _step(experiment, found, number, seconds, progress or (lambda text: None), most=CALIBRATED)


def make_value_stage(experiment: Experiment, *, beside: Refit | None = None, number: int | None = None,
                     seconds: float = SECONDS,
                     progress: Progress | None = None) -> Stage:
    """A rung with other values of what the diagram holds fixed, in place of effects; `beside` what was found with these,
    which it ranks among them: a value that soon is seen to leave more is not followed."""
    return _step(experiment, fixed_values(experiment), number, seconds, progress or (lambda text: None), beside=beside)


def single(experiment: Experiment, candidate: Candidate, progress: Progress) -> Stage:
    """A rung with one candidate, chosen by hand: it is refitted whatever its score."""
    return _step(experiment, [candidate], 1, SECONDS, progress, always=True)


def _step(experiment: Experiment, found: Sequence[Candidate], number: int | None, seconds: float, say: Progress,
          always: bool = False, thorough: bool = False, beside: Refit | None = None, most: int | None = None,
          distant: Sequence[Candidate] = (), varying: Callable[[Candidate], bool] | None = None, later: bool = False
          ) -> Stage:
    """`distant` are candidates of which those get an exact score whose prescore promises it; `varying` chooses among the
    variations of parameters, which are scored if no other candidate comes near the noise. In a `later` step, and if a law
    explains most of the misfit, those are refitted whose scores promise most of the residual, as only those count that
    leave far less than the law."""
    began = clock.perf_counter()
    say("fitting what is free")
    base = fitted_base(experiment)
    errors = predictive_errors(base.problem, base.inner, base.exact, base.r)
    courses = _courses(base)
    as_one = _as_one(courses)
    first = base.problem.runs[0]
    fitted = base.problem.values_of(base.inner, first.record.name)
    excluded = {} if always else {c.label: reason for c in (*found, *distant)
                                  if (reason := _meaningless(c, base, courses))}
    found = [at_values(c, first.assembly, fitted) for c in found if c.label not in excluded]
    if distant:
        say("scoring effects between all nodes to first order")
    prescored = select(base, found, [c for c in distant if c.label not in excluded], as_one)
    found += prescored.selected
    scores: list[Score] = []
    acts_as: dict[str, tuple[str, ...]] = {}
    partial, scored_all, twins, known = False, False, dict[str, tuple[str, ...]](), set[str]()
    with Workers(base, number) as workers:
        def explains(trial: Refit) -> bool:
            return thorough and trial.errors is not None and \
                share_taken(errors, trial.errors, *ALL) >= 1 - DECISION.further

        refits = RefitSchedule(workers, say, explains, {beside.candidate.label: beside} if beside is not None else {})
        try:
            _score(workers, found, scores, say)
            scored_all = True
            known = {s.candidate.label for s in scores}
            scores = beyond_their_members(scores)
            left = leftover(base, scores, prescored.scores)
            if left.significant or always:
                until = clock.perf_counter() + seconds
                acts_as = {} if beside is not None or most is not None else equivalent_values(base, scores)
                leading, rest, twins = planned(scores, as_one)
                leading = leading[:most]
                partial = not refits.make(leading, rest if thorough else [], until)
                if varying is not None and not partial and unexplained(refits.trials.values()):
                    more, of_variations, weak = _variations(base, scores, varying, workers, say)
                    found, scores, excluded = [*found, *more], [*scores, *of_variations], excluded | weak
                    known |= {s.candidate.label for s in of_variations}
                    jobs, _, twins = planned(scores, as_one)
                    promised = DECISION.mainly * float(base.r @ base.r) if later or refits.explained else 0.0
                    leading_variations = [job for job in jobs if job[0].label in {c.label for c in more}
                                          and max((score.gain for score in job[1]), default=0.0) >= promised]
                    partial = not refits.make(leading_variations, [], until)
                    leading = [*leading, *leading_variations]
                say("comparing the best closely")
                refits.trials |= _polished(workers, list(refits.trials.values()), {c.label: g for c, g in (*leading, *rest)},
                                           CLOSELY if most is None else 1)
                if most is None:
                    apart = _told_apart_held_out(workers, list(refits.trials.values()), twins, scores)
                    refits.trials |= apart
                    same = {label: tuple(other for other in group if other not in apart) for label, group in twins.items()}
                    twins = {label: group for label, group in same.items() if group}
        except KeyboardInterrupt:
            clear_signal()
            partial, left, twins = True, leftover(base, scores, prescored.scores), {}
    if not always:
        excluded |= {label: "it never acts in the fitted records" for label, t in refits.trials.items() if not t.acts}
    trials = [t for label, t in refits.trials.items() if label not in excluded]
    why = "it leaves more than noise, and effects were added before" if later else \
        "laws with constant parameters leave hardly more"
    excluded |= {t.candidate.label: why for t in dispensable_variations(trials, later)}
    trials = [t for t in trials if t.candidate.label not in excluded]
    made = _judged(base, errors, left, scores, trials, twins, partial, clock.perf_counter() - began, as_one)
    broken = tuple(c.label for c in found if c.label not in known and c.label not in workers.lost) if scored_all else ()
    return replace(made, lost=tuple(dict.fromkeys(workers.lost)), acts_as=acts_as, planned=len(found), broken=broken,
                   failed=tuple(refits.failed), prescored=len(distant),
                   excluded={**excluded, **prescored.left_out})


def _variations(base: Base, before: Sequence[Score], chosen: Callable[[Candidate], bool], workers: Workers, say: Progress
                ) -> tuple[list[Candidate], list[Score], dict[str, str]]:
    """Variations of parameters, and effects that lead the scores `before` with a time at which they begin; the scores of
    these candidates; and the variations that are not tried, each with the reason. They are tried if no other candidate
    comes near the noise."""
    say("looking for parameters that may vary")
    varying = varying_parameters(base.problem, base.inner)
    added = [c for c in varying.candidates if chosen(c)]
    left_out = {f"variation of {name}" if not name.startswith("of ") else f"variation {name}": reason
                for name, reason in varying.left_out.items()}

    of_variations, of_onsets = list[Score](), list[Score]()
    _score(workers, added, of_variations, say)
    beginning = onsets(base, [*before, *of_variations])
    _score(workers, beginning, of_onsets, say)
    return [*added, *beginning], [*of_variations, *of_onsets], left_out


def _score(workers: Workers, found: Sequence[Candidate], scores: list[Score], say: Progress) -> None:
    """Add the scores of candidates to an empty list as they are made, so that an early end keeps them; at the end in the
    order of the candidates, whichever process was done first."""
    for k, (candidate, got) in enumerate(workers.score(found), 1):
        say(f"scoring {k} of {len(found)}: {candidate.label}")
        scores += got
    place = {c.label: k for k, c in enumerate(found)}
    scores.sort(key=lambda s: place[s.candidate.label])


def _polished(workers: Workers, trials: Sequence[Refit], guesses: Mapping[str, Sequence[Score]], most: int
              ) -> dict[str, Refit]:
    """The trials of candidates that were scored here and are near the best, at most so many, followed to the end of their
    valleys: near on all samples or on those that were fitted, as one that has not arrived may miss the others by much."""
    order = sorted(trials, key=merit)
    if not order:
        return {}
    margin = STRONG + CLOSE * (order[0].samples + order[0].samples_held_out)
    lowest = min(t.bic for t in order)
    near = [t for t in order if t.candidate.label in guesses
            and (merit(t) - merit(order[0]) < margin or t.bic - lowest < margin)][:most]
    better = {c.label: t for c, t in workers.polish([(t, guesses[t.candidate.label], None) for t in near])}
    lent = [(t, guesses[t.candidate.label], lender) for t in better.values() if (lender := _lender(t, better.values()))]
    return better | {c.label: t for c, t in workers.polish(lent)}


def _told_apart_held_out(workers: Workers, trials: Sequence[Refit], twins: Mapping[str, tuple[str, ...]],
                         scores: Sequence[Score]) -> dict[str, Refit]:
    """Refits of candidates that count as the same as one near the best, where data that were not fitted tell them apart: the
    tangents compare on the fitted samples alone, where dry friction of what turns one way is a constant torque."""
    lowest = min((t.bic for t in trials), default=0.0)
    best = [t for t in trials if t.bic - lowest < STRONG + CLOSE * t.samples]
    near = {label: t for t in best for label in twins.get(t.candidate.label, ())}
    guesses: dict[str, list[Score]] = {}
    for score in scores:
        if score.told_apart and score.candidate.label in near:
            guesses.setdefault(score.candidate.label, []).append(score)
    first = [t for _, t in workers.begin([(group[0].candidate, group) for group in guesses.values()]) if t is not None]
    found = [t for _, t in workers.follow([(t, guesses[t.candidate.label]) for t in first])
             if _differ_held_out(t, near[t.candidate.label])]
    return {c.label: t for c, t in workers.polish([(t, guesses[t.candidate.label], None) for t in found])}


def _differ_held_out(one: Refit, other: Refit) -> bool:
    """Whether two refits leave more than by chance one beside the other on what was not fitted."""
    a, b, samples = one.chi2_held_out, other.chi2_held_out, one.samples_held_out
    return samples > 0 and max(fallen(a, b, samples), fallen(b, a, samples)) > EARNED


def _lender(trial: Refit, others: Iterable[Refit]) -> Refit | None:
    """The best fitting law at the same place that fits better: what it found may do for this one too, as a law that holds
    it as a special case should never leave less by ending in another valley."""
    there = [t for t in others if set(t.candidate.where) == set(trial.candidate.where) and t.cost < trial.cost]
    return min(there, key=lambda t: t.cost, default=None)


def refitted_beside(made: Stage, known: Sequence[Refit], exact: Refit) -> Stage:
    """The step with candidates refitted once more from what is `known` of them in a diagram without the other effects: a law
    has several valleys, and the one that was found there is the best to begin from. `exact` is the refit of a candidate in
    this very diagram. Each takes the place of one that leaves more."""
    there = {s.candidate.label: s for s in made.scores}
    twins = {label for group in made.twins.values() for label in group}  # the same machine as one that was refitted
    lent = [(there[t.candidate.label], t) for t in known if t.candidate.label in {*there} - twins]
    found = [exact]
    if lent:
        base = fitted_base(made.experiment)
        refits = [(score, refitted_from(base, score.candidate, lender)) for score, lender in lent]
        found += [replace(trial, score=score.gain) for score, trial in refits if trial is not None]
    trials = {t.candidate.label: t for t in made.trials}
    for trial in found:
        if trial.candidate.label not in trials or trial.cost < trials[trial.candidate.label].cost:
            trials[trial.candidate.label] = trial
    made = replace(made, trials=tuple(sorted(trials.values(), key=merit)), chosen=None, cluster=(), identity=None)
    earned = _earned(made)
    return choosing(made, _leader(made, earned)) if earned else made


def fitted_base(experiment: Experiment) -> Base:
    """The experiment with what is free fitted, from the diagram's values, with runs that err by little beside the noise."""
    problem = searched(experiment)
    base = _fitted(problem, problem.start)
    for _ in range(TIMES):
        if not base.rough:
            break
        try:
            base = _fitted(finer(base.problem), base.inner)
        except SimulationError:
            break  # finer than the integrator can: beside a record far above its noise that is fine enough
    return base


def _fitted(problem: Residuals, inner: Array) -> Base:
    if len(inner):
        inner = problem.minimise(inner, False, lambda text: None, tolerance=1e-6, settle=True).x
    return Base.at(problem, inner)


def _courses(base: Base) -> dict[str, tuple[str, Array]]:
    """Each node of the base model with its domain and the course of its across variable on the fitted records."""
    runs = [base.exact[run.record.name] for run in base.problem.runs]
    results = [run.simulator.run(base.problem.values_of(base.inner, run.record.name)) for run in runs]
    return {node.name: (node.domain.name, np.concatenate([result.si[f"{node.name}.{node.across}"] for result in results]))
            for node in nodes_of(runs[0].assembly.flat).values()}


def _as_one(courses: Mapping[str, tuple[str, Array]]) -> dict[str, str]:
    """Nodes that move as one in the base model (what a lossless rope or lever joins), each with the first of them."""
    found: dict[str, str] = {}
    for name, (domain, course) in courses.items():
        near = AS_ONE * max(float(np.abs(course).max()), 1e-300)
        found[name] = next((first for first in found.values() if courses[first][0] == domain
                            and np.abs(course - courses[first][1]).max() < near), name)
    return found


def _meaningless(candidate: Candidate, base: Base, courses: Mapping[str, tuple[str, Array]]) -> str:
    """Why a candidate cannot act on the fitted records as its class does; empty where it can."""
    if not _says_more(candidate, base, courses):
        return "what presses it is steady, so that it is dry friction"
    if candidate.reverses and not _reverses(candidate, base):
        return "the motion there goes in one direction only"
    if candidate.curve_of_displacement and not retraced(_displacements(candidate, base)):
        return "the motion there passes most positions only once, so that a curve over the position is one over time"
    return ""


ONE_WAY = 1.02  # path over distance, up to which a motion goes one way
POSITIONS = 50  # at which passes are counted


def _displacements(candidate: Candidate, base: Base) -> list[Array]:
    """The displacement (N,) between the nodes of a candidate since the start of each fitted record; empty without a
    mechanical node."""
    found = []
    for run in (base.exact[run.record.name] for run in base.problem.runs):
        nodes = nodes_of(run.assembly.flat)
        ends = [nodes[name] for name in candidate.where if name in nodes and nodes[name].mechanical]
        result = run.simulator.run(base.problem.values_of(base.inner, run.record.name))
        # of the speeds, as a diagram has positions only if an equation uses them
        speeds = [result.si[f"{node.name}.{node.across}"] for node in ends]
        if speeds:
            speed = speeds[0] - (speeds[1] if len(speeds) > 1 else 0.0)
            found.append(np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(result.time))]))
    return found


def _reverses(candidate: Candidate, base: Base) -> bool:
    """Whether the motion between the nodes of a candidate turns back in one of the fitted records by more than noise and
    vibration: the path is longer than the distance from its start to its end."""
    paths = _displacements(candidate, base)
    return not paths or any(float(np.abs(np.diff(x)).sum()) > ONE_WAY * abs(float(x[-1])) for x in paths)


def retraced(displacements: Sequence[Array]) -> bool:
    """Whether at least half of the positions that motions (N,) reach are passed more than once, by all of them together."""
    low, high = (min((float(x.min()) for x in displacements), default=0.0),
                 max((float(x.max()) for x in displacements), default=0.0))
    positions = low + (high - low) * (np.arange(POSITIONS) + 0.5) / POSITIONS
    passes = sum((np.count_nonzero(np.diff(x[:, None] > positions, axis=0), axis=0) for x in displacements),
                 np.zeros(POSITIONS, dtype=np.int64))
    return not passes.any() or 2 * np.count_nonzero(passes > 1) >= np.count_nonzero(passes)


def _says_more(candidate: Candidate, base: Base, courses: Mapping[str, tuple[str, Array]]) -> bool:
    """Whether what a law depends on besides its own motion changes at all: a seal that is pressed by a steady pressure has
    dry friction, which the catalogue has without the pressure."""
    effect = base.problem.experiment.model.library.component(candidate.component).effect
    if effect is None or not effect.also:
        return True
    others = [courses[node][1] for node in candidate.change.nodes if node not in candidate.where and node in courses]
    return all(float(np.ptp(course)) > STEADY * float(np.abs(course).max()) for course in others)


def _judged(base: Base, errors: PredictiveErrors, left: ResidualTests, scores: Sequence[Score], trials: Sequence[Refit],
            twins: dict[str, tuple[str, ...]], partial: bool, seconds: float, as_one: Mapping[str, str]) -> Stage:
    problem = base.problem
    ended = tuple(c.free.name for c, end in zip(problem.columns, problem.at_end(base.inner), strict=True) if end)
    made = Stage(
        problem.experiment, problem.values_of(base.inner, problem.runs[0].record.name), base.cost, len(base.r),
        float(base.r @ base.r) / len(base.r), errors.mean(SELECTION, TEST), errors.samples(SELECTION, TEST), ended, left,
        tuple(_best_of_each(scores)), tuple(sorted(trials, key=merit)), None, (), twins, tuple(_unseen(scores)), partial,
        seconds, errors=errors, as_one=as_one)
    earned = _earned(made)
    return choosing(made, _leader(made, earned)) if earned else made


def _leader(made: Stage, earned: Sequence[Refit]) -> Refit:
    """The trial that is named first: among the plausible ones, which the records cannot distinguish from the best one on all
    records and which take away a noticeable part if any of these does, the one that predicts the fitted data,
    cross-validated, and the selection data best; of its refinements the simplest law that leaves no more.

    If the plausible ones reach the noise, chance decides which predicts best: then `merit` orders them, and a dormant
    parameter of a part goes before an additional part.
    """
    plausible = _plausible(made, earned)
    first = min(plausible, key=merit)
    if leaves_noise(first):
        own = [t for t in plausible if t.candidate.attaches == "in" and t.unknowns <= first.unknowns and leaves_noise(t)]
        return min(own, key=merit, default=first)
    first = best_predicting(plausible, FITTED, SELECTION)
    return simpler_law(made, first) or first


def _plausible(made: Stage, earned: Sequence[Refit]) -> list[Refit]:
    assert made.errors is not None
    best = min(earned, key=likelihood)
    members = compared(best if leaves_noise(best) else best_predicting(earned), earned, made.errors).members
    return [t for t in members if is_noticeable(made, t)] or list(members)


def is_noticeable(made: Stage, trial: Refit) -> bool:
    """Whether a trial takes away a noticeable part of what is left above the noise: on held-out data if these hold more than
    noise, otherwise on all samples, each predicted by parameters that were not fitted to it; in units of the discrepancy of
    each record."""
    assert made.errors is not None and trial.errors is not None
    return share_taken(made.errors, trial.errors, *((SELECTION, TEST) if made.shown_held_out else ALL)) > DECISION.further


def choosing(made: Stage, trial: Refit) -> Stage:
    """The step with one of its trials chosen, and what the records cannot tell from it."""
    assert made.errors is not None
    earned = _earned(made)
    found = compared(trial, [trial, *(t for t in earned if t is not trial)], made.errors)
    near = [t for t in earned if any(t is m for m in found.members) or _as_good(t, trial)]
    others = (trial, *near)
    others = (*others, *twins_of(others, made))
    close = [t for t in near if t is not trial and not refines(t, others)]
    return replace(made, chosen=trial, identity=found,
                   cluster=(trial, *close, *twins_of([trial, *close], made)))


def _as_good(trial: Refit, best: Refit) -> bool:
    """Whether the same law at another place fits as well and leaves noise too: what it then leaves more on other records
    comes of numbers that the fit leaves open (play on the one or the other side of a cylinder)."""
    return trial.candidate.component == best.candidate.component and trial.experiment.noise_given \
        and trial.cost - best.cost < EARNED and is_noise(trial.chi2_fit, trial.chi2_held_out, trial.samples_held_out)


def refines(trial: Refit, laws: Iterable[Refit]) -> bool:
    """Whether a law only refines one of these at the same place, but for chance."""
    return any(_needless(trial, simpler) for simpler in laws)


def _needless(trial: Refit, simpler: Refit) -> bool:
    """Whether this law refines a simpler one at the same place that leaves no more, but for chance: where both are of one
    class, or it generalises the simpler law, and it has more numbers; and where an amplitude of it is not shown (play whose
    gap has closed in the fit is the compliance beside it, however many numbers shape that). Another law of another class
    whose amplitudes are shown is another explanation, however many numbers it has. That no law is exact is no excuse for
    one that could bend further."""
    more = trial.unknowns > simpler.unknowns
    refines = (more and (same_class(trial.candidate.kind, simpler.candidate.kind) or _generalises(trial, simpler))) \
        or (bool(trial.unshown) and (more or not simpler.unshown))
    return refines and set(trial.candidate.where) == set(simpler.candidate.where) and _leaves_no_more(simpler, trial)


def _generalises(trial: Refit, simpler: Refit) -> bool:
    """Whether the component of a law contains that of a simpler one, by an entry `replaces` of its effects (Bouc-Wen
    hysteresis contains dry friction with presliding)."""
    law = trial.experiment.model.library.component(trial.candidate.component)
    return any(simpler.candidate.component in effect.replaces for effect in law.effects)


def _leaves_no_more(trial: Refit, other: Refit) -> bool:
    """Whether a refit leaves no more than another one, but for chance, where it was fitted and where it was not."""
    return (trial.cost - other.cost) / max(1.0, other.chi2_fit) < EARNED \
        and not fallen(trial.chi2_held_out, other.chi2_held_out, other.samples_held_out) > EARNED  # (NaN: none held out)


def leaders(made: Stage, most: int, simplest: bool = False) -> list[Stage]:
    """The step with each of the best trials chosen that earn their place, one of each class at each place; the leader
    first, without those that the test data exclude beside it. `simplest`: besides, of each of these classes and places, the
    law with the fewest numbers."""
    earned = _earned(made)
    if not earned:
        return []
    first = _leader(made, earned)
    plausible = _plausible(made, earned)
    families: dict[object, list[Refit]] = {}
    for trial in [first, *(t for t in earned if t is not first and (t in plausible or merit(t) > merit(first)))]:
        families.setdefault((trial.candidate.kind, frozenset(trial.candidate.where)), []).append(trial)
    found = list(families.values())[:most]
    chosen = [family[0] for family in found]
    if simplest:
        least = [min(family, key=lambda t: (t.unknowns, merit(t))) for family in found]
        chosen += [t for t in least if not any(t is other for other in chosen)]
    return [choosing(made, trial) for trial in chosen]


def simpler_law(made: Stage, trial: Refit) -> Refit | None:
    """Of the trials of a step the best that earns its place, leaves no more than another one but for chance and has the
    smaller merit, with fewer numbers, or as a law of the same class at the same place that this one refines."""
    found = [t for t in _earned(made) if merit(t) < merit(trial) and (
        (t.unknowns < trial.unknowns and _leaves_no_more(t, trial))
        or (t.candidate.kind == trial.candidate.kind and _needless(trial, t)))]
    return min(found, key=merit, default=None)


def twins_of(close: Sequence[Refit], made: Stage) -> list[Refit]:
    """Candidates of another class, or at another place, that are the same machine as one that was refitted. (`leakage`
    between the chambers is `internal leakage` of the piston; a delay of an input and of the only channel may act alike.)"""
    by_label = {s.candidate.label: s.candidate for s in made.scores}
    pairs = [(trial, by_label[label]) for trial in close for label in made.twins.get(trial.candidate.label, ())]
    return [replace(trial, candidate=twin) for trial, twin in pairs if not same_class(trial.candidate.kind, twin.kind)
            or made.places.place(trial.candidate) != made.places.place(twin)]


def _best_of_each(scores: Sequence[Score]) -> list[Score]:
    best: dict[str, Score] = {}
    for score in sorted(scores, key=lambda s: -s.gain):
        best.setdefault(score.candidate.label, score)
    return list(best.values())


def _unseen(scores: Sequence[Score]) -> list[Candidate]:
    """Candidates that the records cannot see apart from what is free already, at no choice of their shapes."""
    told = {s.candidate.label for s in scores if s.told_apart}
    return [s.candidate for s in _best_of_each(scores) if s.candidate.label not in told]


def merit(trial: Refit) -> float:
    """What ranks the refits: BIC of the fitted samples and n ln(chi-square) of the selection data; smaller is better. The
    test data have no part in it."""
    return _merit(trial.cost, trial.samples, trial.unknowns, trial.errors)


def _merit(cost: float, samples: int, unknowns: int, errors: PredictiveErrors | None) -> float:
    others = errors.samples(SELECTION) if errors is not None else 0
    chi2 = errors.mean(SELECTION) if errors is not None and others else 1.0
    return bic(cost, samples, unknowns) + others * float(np.log(max(chi2, 1e-300)))


def _earned(made: Stage) -> list[Refit]:
    """The trials whose merit, and chi-square on the selection data where they hold more than noise, both fall by more than
    chance allows, best first."""
    assert made.errors is not None
    before, samples = made.errors.mean(SELECTION), made.errors.samples(SELECTION)
    return [t for t in made.trials if merit(t) < made.merit - EARNED and t.errors is not None
            and (not is_above_noise(before, samples) or fallen(before, t.errors.mean(SELECTION), samples) > EARNED)
            and not _worse(made, t)]


def _worse(made: Stage, trial: Refit) -> bool:
    """Whether a refit leaves more than the model without it on all that was not fitted; where that leaves no more than
    noise, whether the refit leaves more than noise."""
    if made.shown_held_out:
        return not trial.chi2_held_out < made.chi2_held_out
    return is_above_noise(trial.chi2_held_out, trial.samples_held_out)


def fallen(before: float, after: float, samples: int) -> float:
    """How far chi-square of so many samples has fallen, from `before` to `after` per sample, in units of what is left."""
    return (before - after) * samples / max(1.0, after)


def following(before: Stage) -> Experiment:
    """The experiment with the chosen effect in its diagram, everything at its fitted values and free as it was sought."""
    assert before.chosen is not None
    return at_values_of(before.chosen, before.chosen.experiment)


def at_values_of(trial: Refit, experiment: Experiment) -> Experiment:
    """The experiment with what is free in it at the values of a refit, of this diagram or of one with an effect more."""
    values = {n: v for n, v in trial.values.items() if n in experiment.free}
    own = {record: {n: v for n, v in there.items() if n in experiment.free and not n.startswith("initial.")}
           for record, there in trial.own.items()}
    return replace(experiment, model=experiment.model.with_parameters(values)).with_record_values(own)


def worth_it(step: Stage) -> bool:
    """Whether the effect of a step takes away a noticeable part of what is left."""
    assert step.chosen is not None
    return is_noticeable(step, step.chosen)
