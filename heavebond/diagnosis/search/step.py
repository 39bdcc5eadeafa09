"""One step of the diagnosis: the search for one missing effect.

The free parameters are fitted. If the residual is more than noise, every candidate of the catalogue is scored, and the
candidates that can matter are refitted. The step chooses the candidate with the smallest residual on held-out data, if it
improves the prediction there materially.
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
from heavebond.diagnosis.search.natural_sizes import with_natural_ranges
from heavebond.diagnosis.search.onset import onsets
from heavebond.diagnosis.search.prescore import SMALL, select, select_variations
from heavebond.diagnosis.search.refit import ANOTHER, Refit, bic, refitted_from
from heavebond.diagnosis.search.schedule import NEEDED, Job, RefitSchedule, beyond_their_members, planned, unexplained
from heavebond.diagnosis.search.scoring import Score
from heavebond.diagnosis.search.workers import Workers
from heavebond.equations.places import nodes_of
from heavebond.estimation.experiment import Experiment
from heavebond.estimation.residuals import Residuals
from heavebond.language.library import same_class
from heavebond.localise.regressors import integral
from heavebond.numerics.dae import Array
from heavebond.numerics.result import Probe

CLOSELY = 6  # maximum number of candidates that are refitted to full convergence for the comparison,
CLOSE = 0.05  # those whose ln(chi-square) is within this of the best one
AS_ONE = 1e-6  # nodes move together if they differ by less than this share of the largest value
CALIBRATED = 3  # number of calibration errors that are refitted together with a law, those with the largest scores
STEADY = 0.01  # a variable is constant if it varies by less than this share of its size
SECONDS = 600.0  # duration of a step after which no refit is started,
SCORING = 0.5  # and the share of it after which no candidate is scored, so that an early end has refits too
# A candidate is justified if chi-square on held-out data falls by this, in units of the residual per sample. The square of a
# standard normal number exceeds it by chance less than once in a thousand cases.
EARNED = 12.0
ACTS_ALWAYS = "it never acts in the fitted records, or always, as a law without a limit does"
ENDS_NO_MOTION = "in the fitted records no free motion ends at it, or it yields further than that motion, as a spring does"


@dataclass(frozen=True)
class Stage:
    """Result of one step.

    The model without candidates: `experiment` is the diagnosed experiment, `values` its fitted free parameters (SI), `cost`
    the sum of squares, `chi2_fit` and `chi2_held_out` chi-square per sample on the fitted and the held-out records, `errors`
    the predictive errors, `left` the tests on the residual. `at_end` are the free parameters at an end of their range.

    The candidates: `planned` is the number of candidates for an exact score, `prescored` the number of candidates between
    nodes that no component connects. `scores` and `trials` are all scores and refits, the best first. `unseen` are
    candidates that the records do not distinguish from the free parameters. `twins` maps labels of refitted candidates to
    labels of equivalent ones. `acts_as` maps labels of candidates to the numbers of the diagram of which they are another
    value. `as_one` maps each node to the first of the nodes that move together with it in the base model. `excluded` gives
    the reason for each effect that was not tried, got no exact score (see `search.prescore`) or was not kept.

    `still` is chi-square per sample on the fitted records of the mean values of the channels in place of a model.

    The choice: `chosen` is the chosen refit, `cluster` the candidates that the records cannot distinguish from it (the
    chosen one first), `identity` the comparison of the candidates with it. `joint` are the leading candidates, each refitted
    with one further effect (see `stepwise.best_pairs`); it is empty if no further step was made.

    Failures: `partial` is true if some planned refits were not made. `lost` are the candidates whose process died, `broken`
    the labels of candidates with which the diagram cannot be simulated, and `failed` the labels of candidates that have a
    score but no refit that could be simulated.
    """

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
    still: float = np.inf

    @property
    def bic(self) -> float:
        """Bayesian information criterion of the model without candidates."""
        return bic(self.cost, self.samples, len(self.values))

    @cached_property
    def places(self) -> Places:
        """The places of the diagram."""
        return Places.of(self.experiment, self.as_one)

    @property
    def shown_held_out(self) -> bool:
        """True if the model without candidates has more than noise as its residual on held-out data. If not, no candidate
        can improve the prediction there, and the cross-validated errors of the fitted data decide."""
        return is_above_noise(self.chi2_held_out, self.samples_held_out)

    @property
    def merit(self) -> float:
        """Ranking value of the model without candidates, see the function `merit`."""
        return _merit(self.cost, self.samples, len(self.values), self.errors)


def make_stage(experiment: Experiment, *, beside: Sequence[Candidate] = (), number: int | None = None,
               seconds: float = SECONDS, classes: Sequence[str] = (), progress: Progress | None = None,
               thorough: bool = True, review: bool = False, earlier: Sequence[Score] = ()) -> Stage:
    """Score the candidates of the catalogue, and refit those that can matter.

    `beside` are the effects that earlier steps added to the diagram. Candidates that act on these effects instead of the
    machine are left out. `classes` restricts the catalogue to candidates of these classes. `seconds` limits the time of
    scores and refits, `number` is the number of processes. A `thorough` search also refits all other candidates if no refit
    of the candidates with the largest scores comes near the noise. In the `review` of an effect that was selected before, no
    variations of parameters are tried. `earlier` are the scores of the steps that added the effects `beside`, the last ones
    last.
    """
    def chosen(candidate: Candidate) -> bool:
        return candidate.kind != UNKNOWN and (not classes or candidate.kind in classes) and not candidate.acts_on(beside)

    excluded: dict[str, str] = {}
    site = site_of(experiment)
    near = [c for c in candidates(experiment, excluded, site) if chosen(c)]
    distant = [c for c in between_all_nodes(experiment, site) if chosen(c)]
    stage = _step(experiment, near, number, seconds, progress or (lambda text: None), thorough=thorough, distant=distant,
                  varying=None if review else chosen, later=bool(beside), earlier=earlier)
    return replace(stage, excluded={**excluded, **stage.excluded})


def make_curve_stage(experiment: Experiment, *, beside: Sequence[Candidate] = (),
                     among: Callable[[Candidate], bool] | None = None, number: int | None = None,
                     seconds: float = SECONDS, progress: Progress | None = None) -> Stage:
    """Make a step with identified curves only: effects without a specific law, at single places.

    Curves at several places at once are tried only at the places of the effects `beside`. Curves between nodes that no
    component connects are tried only at these places, or if `among` is given. `among` is a predicate; the curves that
    satisfy it are refitted whatever their scores are, and no others are tried.
    """
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
    """Make a step with calibration errors only: offsets and gains of inputs and channels. Only the best of them is
    refitted to full convergence, because only its residual is needed."""
    calibration_errors = [c for c in single_candidates(experiment) if is_calibration_error(c, experiment)
                          and (not classes or c.kind in classes)]
    return _step(experiment, calibration_errors, number, seconds, progress or (lambda text: None), most=CALIBRATED)


def make_value_stage(experiment: Experiment, *, beside: Refit | None = None, number: int | None = None,
                     seconds: float = SECONDS,
                     progress: Progress | None = None) -> Stage:
    """Make a step with other values of the fixed parameters of the diagram instead of effects. `beside` is the refit of
    an effect that is ranked together with these values, so that a value that fits much worse is given up early."""
    return _step(experiment, fixed_values(experiment), number, seconds, progress or (lambda text: None), beside=beside)


def single(experiment: Experiment, candidate: Candidate, progress: Progress) -> Stage:
    """Make a step with one given candidate, which is refitted whatever its score is."""
    return _step(experiment, [candidate], 1, SECONDS, progress, always=True)


def _step(experiment: Experiment, proposed: Sequence[Candidate], number: int | None, seconds: float, say: Progress,
          always: bool = False, thorough: bool = False, beside: Refit | None = None, most: int | None = None,
          distant: Sequence[Candidate] = (), varying: Callable[[Candidate], bool] | None = None, later: bool = False,
          earlier: Sequence[Score] = ()) -> Stage:
    """Make a step with these candidates.

    `distant` are further candidates, which get an exact score only if their prescore is large enough. `varying` is a
    predicate that selects variations of parameters; these are scored if no other candidate comes near the noise. `later` is
    true after the first step. In a later step, or if a law explains most of the misfit, variations are refitted only if
    their scores predict most of the residual, because only variations with a far smaller residual than the law are kept.
    In a later step, candidates with a small score and inferior refits are left out (see `schedule.NEEDED` and
    `schedule.FAR`), because their effect would not be worth adding.
    """
    began = clock.perf_counter()
    say("fitting the free parameters")
    base = fitted_base(experiment)
    errors = predictive_errors(base.problem, base.inner, base.exact, base.r)
    courses, as_one = _courses(base)
    first = base.problem.runs[0]
    fitted = base.problem.values_of(base.inner, first.record.name)
    excluded = {} if always else {c.label: reason for c in (*proposed, *distant)
                                  if (reason := _meaningless(c, base, courses))}
    near = [at_values(c, first.assembly, fitted) for c in proposed if c.label not in excluded]
    ranged = with_natural_ranges(base, [*near, *(c for c in distant if c.label not in excluded)])
    if distant:
        say("scoring effects between all nodes to first order")
    # the gain without which a candidate is hardly refitted in a later step
    needed = NEEDED * max(float(base.r @ base.r) - len(base.r), 0.0) if later else 0.0
    prescored = select(base, ranged[:len(near)], ranged[len(near):], as_one, needed, {s.candidate.label: s for s in earlier})
    proposed, scores, remaining = list(prescored.selected), list[Score](), list[Job]()
    acts_as: dict[str, tuple[str, ...]] = {}
    partial, scored_all, twins, known = False, False, dict[str, tuple[str, ...]](), set[str]()
    with Workers(base, number) as workers:
        def explains(trial: Refit) -> bool:
            return thorough and trial.errors is not None and \
                share_taken(errors, trial.errors, *ALL) >= 1 - DECISION.further

        refits = RefitSchedule(workers, say, explains, {beside.candidate.label: beside} if beside is not None else {},
                               whole=base.cost if later else 0.0)

        def others() -> list[Job]:
            # the candidates that are refitted if no leading one explains the residual: those postponed get a score first
            nonlocal proposed, scores, remaining, twins
            if prescored.postponed:
                of_postponed: list[Score] = []
                _score(workers, prescored.postponed, of_postponed, say, until)
                known.update(s.candidate.label for s in of_postponed)
                proposed, scores = [*proposed, *prescored.postponed], [*scores, *of_postponed]
                begun = {c.label for c, _ in leading}
                first, rest, twins = planned(scores, as_one)
                remaining = [job for job in (*first, *rest) if job[0].label not in begun]
            return remaining

        until = began + seconds
        try:
            scored_all = _score(workers, proposed, scores, say, began + SCORING * seconds)
            known = {s.candidate.label for s in scores}
            scores = beyond_their_members(scores, prescored.gains)
            tests = leftover(base, scores, prescored.scores)
            if tests.significant or always:
                acts_as = {} if beside is not None or most is not None else equivalent_values(base, scores)
                leading, remaining, twins = planned(scores, as_one, needed)
                leading = leading[:most]
                partial = not refits.make(leading, others if thorough else list, until) or not scored_all
                if varying is not None and not partial and unexplained(refits.trials.values()):
                    promised = DECISION.mainly * float(base.r @ base.r) if later or refits.explained else 0.0
                    more, of_variations, weak = _variations(base, scores, varying, promised, workers, say, until)
                    proposed, scores, excluded = [*proposed, *more], [*scores, *of_variations], excluded | weak
                    known |= {s.candidate.label for s in of_variations}
                    jobs, _, twins = planned(scores, as_one)
                    leading_variations = [job for job in jobs if job[0].label in {c.label for c in more}
                                          and max((score.gain for score in job[1]), default=0.0) >= promised]
                    partial = not refits.make(leading_variations, list, until)
                    leading = [*leading, *leading_variations]
                say("comparing the best closely")
                guesses = {c.label: g for c, g in (*leading, *remaining)}
                refits.trials |= _borrowed(workers, base, list(refits.trials.values()), guesses, until)
                refits.trials |= _polished(workers, list(refits.trials.values()), guesses, CLOSELY if most is None else 1)
                if most is None:
                    apart = _told_apart_held_out(workers, list(refits.trials.values()), twins, scores)
                    refits.trials |= apart
                    same = {label: tuple(twin for twin in group if twin not in apart) for label, group in twins.items()}
                    twins = {label: group for label, group in same.items() if group}
        except KeyboardInterrupt:
            clear_signal()
            partial, tests = True, leftover(base, scores, prescored.scores)
            twins = twins or planned(scores, as_one)[2]
    if not always:
        excluded |= {label: ENDS_NO_MOTION if t.candidate.reverses else ACTS_ALWAYS if t.candidate.partly
                     else "it never acts in the fitted records" for label, t in refits.trials.items() if not t.acts}
    if not always or len(proposed) > 1:
        excluded |= {label: "the channel passes most values only once, so that the curve is one over time, and it does not "
                     "hold for other records" for label, t in refits.trials.items() if _of_one_time(t, base)}
    excluded |= dict.fromkeys(refits.postponed, "another effect explains most of the misfit of this step")
    trials = [t for label, t in refits.trials.items() if label not in excluded]
    why = "it leaves more than noise, and effects were added before" if later else \
        f"a law with constant parameters leaves less than {DECISION.times:g} times as much above the noise"
    excluded |= {t.candidate.label: why for t in dispensable_variations(trials, later)}
    trials = [t for t in trials if t.candidate.label not in excluded]
    stage = _judged(base, errors, tests, scores, trials, twins, partial, clock.perf_counter() - began, as_one)
    broken = tuple(c.label for c in proposed if c.label not in known and c.label not in workers.lost) if scored_all else ()
    return replace(stage, lost=tuple(dict.fromkeys(workers.lost)), acts_as=acts_as, planned=len(proposed), broken=broken,
                   failed=tuple(refits.failed), prescored=len(distant),
                   excluded={**excluded, **prescored.left_out,
                             **{c.label: SMALL for c in prescored.postponed if c.label not in known}})


def _variations(base: Base, before: Sequence[Score], chosen: Callable[[Candidate], bool], promised: float, workers: Workers,
                say: Progress, until: float) -> tuple[list[Candidate], list[Score], dict[str, str]]:
    """Make and score the candidates that are tried if no other candidate comes near the noise. These are variations of
    parameters, and the candidates with the best scores in `before`, extended by an onset time. `promised` is the gain
    without which they are not refitted. The third result maps variations that are not tried to the reason."""
    say("looking for parameters that may vary")
    varying = varying_parameters(base.problem, base.inner)
    added = [c for c in varying.candidates if chosen(c)]
    left_out = {f"variation of {name}" if not name.startswith("of ") else f"variation {name}": reason
                for name, reason in varying.left_out.items()}

    prescored = select_variations(base, added, promised)
    added, left_out = list(prescored.selected), {**left_out, **prescored.left_out}
    of_variations, of_onsets = list[Score](), list[Score]()
    _score(workers, added, of_variations, say, until)
    beginning = onsets(base, [*before, *of_variations], promised)
    _score(workers, beginning, of_onsets, say, until)
    return [*added, *beginning], [*of_variations, *of_onsets], left_out


def _score(workers: Workers, proposed: Sequence[Candidate], scores: list[Score], say: Progress, until: float) -> bool:
    """Append the scores of candidates to the empty list `scores` as they are computed, so that an early end keeps them.
    At the end, sort them in the order of the candidates, so that the result does not depend on the order of the
    processes. The result is false if candidates were not started at the time `until`."""
    k = 0
    for k, (candidate, got) in enumerate(workers.score(proposed, until), 1):
        say(f"scoring {k} of {len(proposed)}: {candidate.label}")
        scores += got
    place = {c.label: k for k, c in enumerate(proposed)}
    scores.sort(key=lambda s: place[s.candidate.label])
    return k == len(proposed)


def _borrowed(workers: Workers, base: Base, trials: Sequence[Refit], guesses: Mapping[str, Sequence[Score]], until: float
              ) -> dict[str, Refit]:
    """Refit the other laws at the place of the best law from its free parameters, if it explains most of the misfit and
    leaves more than noise. Their refits began at the base model, and may have ended in another local minimum."""
    known = [t for t in trials if t.candidate.label in guesses]
    best = min(known, key=lambda t: t.cost, default=None)
    if best is None or best.chi2_fit <= DECISION.near or best.cost > (1 - DECISION.mainly) * base.cost:
        return {}
    others = [t for t in known if t.cost > ANOTHER[0] * best.cost and set(t.candidate.where) == set(best.candidate.where)]
    return {c.label: t for c, t in workers.borrow([(t, guesses[t.candidate.label], best) for t in others], until)}


def _polished(workers: Workers, trials: Sequence[Refit], guesses: Mapping[str, Sequence[Score]], most: int
              ) -> dict[str, Refit]:
    """Refit up to `most` of the best candidates to full convergence. A candidate is included if it is near the best one
    on all samples or on the fitted samples, because an incomplete refit may have large errors on the other samples."""
    order = sorted(trials, key=merit)
    if not order:
        return {}
    margin = STRONG + CLOSE * (order[0].samples + order[0].samples_held_out)
    lowest = min(t.bic for t in order)
    near = [t for t in order if t.candidate.label in guesses
            and (merit(t) - merit(order[0]) < margin or t.bic - lowest < margin)][:most]
    better = {c.label: t for c, t in workers.polish([(t, guesses[t.candidate.label], None) for t in near])}
    # A law that contains another law as a special case cannot have a larger residual, unless it ended in another local
    # minimum. So a candidate is refitted from the values of the best other law at its place if this has a smaller sum.
    lent = []
    for t in better.values():
        smaller = [law for law in better.values()
                   if set(law.candidate.where) == set(t.candidate.where) and law.cost < t.cost]
        if smaller:
            lent.append((t, guesses[t.candidate.label], min(smaller, key=lambda law: law.cost)))
    return better | {c.label: t for c, t in workers.polish(lent)}


def _told_apart_held_out(workers: Workers, trials: Sequence[Refit], twins: Mapping[str, tuple[str, ...]],
                         scores: Sequence[Score]) -> dict[str, Refit]:
    """Refit candidates that are equivalent to one of the best on the fitted records, and return those that differ on the
    held-out data. Equivalence is judged on the fitted samples only. For example, dry friction of a shaft that turns in
    one direction is a constant torque."""
    lowest = min((t.bic for t in trials), default=0.0)
    best = [t for t in trials if t.bic - lowest < STRONG + CLOSE * t.samples]
    near = {label: t for t in best for label in twins.get(t.candidate.label, ())}
    guesses: dict[str, list[Score]] = {}
    for score in scores:
        if score.told_apart and score.candidate.label in near:
            guesses.setdefault(score.candidate.label, []).append(score)
    first = [t for _, t in workers.begin([(group[0].candidate, group) for group in guesses.values()]) if t is not None]
    different = []
    for _, trial in workers.follow([(t, guesses[t.candidate.label]) for t in first]):
        chi2, samples = trial.chi2_held_out, trial.samples_held_out
        chi2_best = near[trial.candidate.label].chi2_held_out
        if samples > 0 and max(fallen(chi2, chi2_best, samples), fallen(chi2_best, chi2, samples)) > EARNED:
            different.append(trial)
    return {c.label: t for c, t in workers.polish([(t, guesses[t.candidate.label], None) for t in different])}


def refitted_beside(stage: Stage, known: Sequence[Refit], exact: Refit) -> Stage:
    """The step with some candidates refitted again from other starting values. `known` are refits of these candidates in
    a diagram without the other effects. A law may have several local minima, and the minimum in that diagram is a good
    starting point. `exact` is a refit of one candidate in the present diagram. A refit replaces an earlier one if its sum
    of squares is smaller."""
    scores_by_label = {s.candidate.label: s for s in stage.scores}
    twins = {label for group in stage.twins.values() for label in group}  # equivalent to a candidate that was refitted
    lent = [(scores_by_label[t.candidate.label], t) for t in known if t.candidate.label in {*scores_by_label} - twins]
    improved = [exact]
    if lent:
        base = fitted_base(stage.experiment)
        refits = [(score, refitted_from(base, score.candidate, lender)) for score, lender in lent]
        improved += [replace(trial, score=score.gain) for score, trial in refits if trial is not None]
    trials = {t.candidate.label: t for t in stage.trials}
    for trial in improved:
        if trial.candidate.label not in trials or trial.cost < trials[trial.candidate.label].cost:
            trials[trial.candidate.label] = trial
    stage = replace(stage, trials=tuple(sorted(trials.values(), key=merit)), chosen=None, cluster=(), identity=None)
    earned = _earned(stage)
    return choosing(stage, _leader(stage, earned)) if earned else stage


def fitted_base(experiment: Experiment) -> Base:
    """Fit the free parameters of an experiment from the diagram's values. The tolerances of the runs are reduced until
    their errors are small compared with the noise."""
    problem = searched(experiment)
    base = _fitted(problem, problem.start)
    for _ in range(TIMES):
        if not base.rough:
            break
        try:
            base = _fitted(finer(base.problem), base.inner)
        except SimulationError:
            break  # below the limit of the integrator; sufficient, as the record is far above its noise
    return base


def _fitted(problem: Residuals, inner: Array) -> Base:
    if len(inner):
        inner = problem.minimise(inner, False, lambda text: None, tolerance=1e-6, settle=True, rough=True).x
    return Base.at(problem, inner)


def _courses(base: Base) -> tuple[dict[str, tuple[str, Array]], dict[str, str]]:
    """The domain of each node of the base model and the time course of its across variable on all fitted records; and for
    each node, the first of the nodes that move together with it, for example because a lossless rope or lever connects
    them."""
    courses = {node.name: (node.domain.name, np.concatenate([r.si[f"{node.name}.{node.across}"] for r in base.results]))
               for node in nodes_of(base.results[0].assembly.flat).values()}
    as_one: dict[str, str] = {}
    for name, (domain, course) in courses.items():
        near = AS_ONE * max(float(np.abs(course).max()), 1e-300)
        as_one[name] = next((first for first in as_one.values() if courses[first][0] == domain
                             and np.abs(course - courses[first][1]).max() < near), name)
    return courses, as_one


def _meaningless(candidate: Candidate, base: Base, courses: Mapping[str, tuple[str, Array]]) -> str:
    """The reason why a candidate cannot act on the fitted records as its class does; empty if it can."""
    effect = base.problem.experiment.model.library.component(candidate.component).effect
    # if the additional variables of a law are constant, the catalogue contains a simpler law with the same influence: a seal
    # under constant pressure has dry friction
    others = [courses[node][1] for node in candidate.change.nodes if node not in candidate.where and node in courses] \
        if effect is not None and effect.also else []
    if any(not float(np.ptp(course)) > STEADY * float(np.abs(course).max()) for course in others):
        return "the pressure that it depends on is steady, so that it is dry friction"
    if candidate.reverses and not _reverses(candidate, base):
        return "the motion there goes in one direction only"
    if candidate.curve_of_displacement and not retraced(_displacements(candidate, base)):
        return "the motion there passes most positions only once, so that a curve over the position is one over time"
    if candidate.attaches in ("input", "channel") and any(n.sought is not None and n.sought.held == "peak"
                                                          for n in candidate.numbers):
        sizes = np.abs(np.concatenate(_signals(candidate, base)))
        if sizes.min() > FAR_FROM_ZERO * sizes.max():
            return "the signal stays far from zero, where this law is a gain and an offset"
    return ""


ONE_WAY = 1.02  # ratio of path and distance up to which a motion has one direction
BACK = 10.0  # standard deviations of noise: the largest difference of two of a million samples is less by chance
# A signal above this share of its largest size sees a bent characteristic within 5 % of the range as a straight line.
FAR_FROM_ZERO = 0.8
POSITIONS = 50  # number of positions at which passes are counted


def _displacements(candidate: Candidate, base: Base) -> list[Array]:
    """The displacement (N,) between the nodes of a candidate since the start of each fitted record; empty without a
    mechanical node."""
    displacements, nodes = [], nodes_of(base.results[0].assembly.flat)
    ends = [nodes[name] for name in candidate.where if name in nodes and nodes[name].mechanical]
    for result in base.results:
        # integrated from speeds: a diagram has positions only if an equation uses them
        speeds = [result.si[f"{node.name}.{node.across}"] for node in ends]
        if speeds:
            speed = speeds[0] - (speeds[1] if len(speeds) > 1 else 0.0)
            displacements.append(integral(speed, result.time))
    return displacements


def _reverses(candidate: Candidate, base: Base) -> bool:
    """True if the motion between the nodes of a candidate reverses in one of the fitted records by more than noise and
    vibration: the path of the base model is longer than the distance from start to end, or a measured position or speed of a
    node goes back by as much. (The base model lacks the stop that throws a body back.)"""
    paths = _displacements(candidate, base)
    return not paths or any(float(np.abs(np.diff(x)).sum()) > ONE_WAY * abs(float(x[-1])) for x in paths) \
        or any(min(np.max(np.maximum.accumulate(x) - x), np.max(x - np.minimum.accumulate(x))) > max(
            (ONE_WAY - 1) * float(np.ptp(x)), BACK * noise) for x, noise in _measured_motions(candidate, base))


def _measured_motions(candidate: Candidate, base: Base) -> list[tuple[Array, float]]:
    """Measured displacements (N,) of the nodes of a candidate in the fitted records, from channels that are their position
    or speed, with the standard deviation of their noise."""
    motions = []
    for run in (base.exact[run.record.name] for run in base.problem.runs):
        nodes = {name: node for name, node in nodes_of(run.assembly.flat).items() if name in candidate.where}
        for k, output in enumerate(base.problem.experiment.outputs.values()):
            node = nodes.get(output.shown.text.rpartition(".")[0])
            used = run.counts[k]
            if node is None or not node.mechanical or np.count_nonzero(used) < 3:
                continue
            time, course, noise = run.found.grid[used], run.measured[k, used], float(np.mean(run.noise[k, used]))
            if output.shown.text.rpartition(".")[2] == node.across:
                motions.append((integral(course, time), noise * float(np.sqrt(np.sum(np.diff(time)**2)))))
            elif output.shown.text.rpartition(".")[2] == node.domain.position:
                motions.append((course, noise))
    return motions


def _of_one_time(trial: Refit, base: Base) -> bool:
    """True for an identified curve over the value of a channel that is a curve over time: the channel passes most values
    only once in the fitted records, and the curve leaves far more on held-out data."""
    return trial.candidate.curve_of_channel and trial.chi2_held_out > DECISION.times * max(1.0, trial.chi2_fit) \
        and not retraced(_signals(trial.candidate, base))


def _signals(candidate: Candidate, base: Base) -> list[Array]:
    """The simulated course (N,) of the signal of a candidate, a channel or an input, in each fitted record."""
    outputs = base.problem.experiment.outputs
    signal = outputs[candidate.where[0]].shown.text if candidate.attaches == "channel" else candidate.signal
    return [Probe(result.assembly, [signal], si=True).values(result)[0] for result in base.results]


def retraced(displacements: Sequence[Array]) -> bool:
    """True if at least half of the positions that the motions (N,) reach are passed more than once, by all motions
    together. The positions may be values of any signal."""
    low, high = (min((float(x.min()) for x in displacements), default=0.0),
                 max((float(x.max()) for x in displacements), default=0.0))
    positions = low + (high - low) * (np.arange(POSITIONS) + 0.5) / POSITIONS
    passes = sum((np.count_nonzero(np.diff(x[:, None] > positions, axis=0), axis=0) for x in displacements),
                 np.zeros(POSITIONS, dtype=np.int64))
    return not passes.any() or bool(2 * np.count_nonzero(passes > 1) >= np.count_nonzero(passes))


def _judged(base: Base, errors: PredictiveErrors, tests: ResidualTests, scores: Sequence[Score], trials: Sequence[Refit],
            twins: dict[str, tuple[str, ...]], partial: bool, seconds: float, as_one: Mapping[str, str]) -> Stage:
    problem = base.problem
    ended = tuple(c.free.name for c, end in zip(problem.columns, problem.at_end(base.inner), strict=True) if end)
    best_of_candidate: dict[str, Score] = {}
    for score in sorted(scores, key=lambda s: -s.gain):
        best_of_candidate.setdefault(score.candidate.label, score)
    best_scores = tuple(best_of_candidate.values())
    distinguished = {s.candidate.label for s in scores if s.told_apart}  # from the free parameters at some choice of shapes
    unseen = tuple(s.candidate for s in best_scores if s.candidate.label not in distinguished)
    stage = Stage(
        problem.experiment, problem.values_of(base.inner, problem.runs[0].record.name), base.cost, len(base.r),
        float(base.r @ base.r) / len(base.r), errors.mean(SELECTION, TEST), errors.samples(SELECTION, TEST), ended, tests,
        best_scores, tuple(sorted(trials, key=merit)), None, (), twins, unseen, partial, seconds, errors=errors,
        as_one=as_one, still=float(sum(r @ r for r in (run.about_means() for run in problem.runs))) / len(base.r))
    earned = _earned(stage)
    return choosing(stage, _leader(stage, earned)) if earned else stage


def _leader(stage: Stage, earned: Sequence[Refit]) -> Refit:
    """The refit that is named first.

    Candidates are plausible if the records cannot distinguish them from the best one on all records. If some of them explain
    a noticeable part of the residual, the others are dropped. The leader is the plausible candidate with the best prediction
    of the fitted data (cross-validated) and the selection data. If the leader only refines a simpler law with an equal
    residual, the simpler law is named.

    If the plausible candidates reach the noise, the best prediction is a matter of chance. Then `merit` ranks them, a
    simpler law is preferred to a law that only refines it, and a dormant parameter of a part to an additional part.
    """
    plausible = _plausible(stage, earned)
    first = min(plausible, key=merit)
    if leaves_noise(first):
        # the forms of a variation do not contain each other
        simpler = [t for t in plausible if leaves_noise(t) and _needless(first, t) and not first.candidate.varies]
        first = min(simpler, key=merit, default=first)
        dormant = [t for t in plausible if t.candidate.attaches == "in" and t.unknowns <= first.unknowns and leaves_noise(t)]
        return min(dormant, key=merit, default=first)
    first = best_predicting(plausible, FITTED, SELECTION)
    return simpler_law(stage, first) or first


def _plausible(stage: Stage, earned: Sequence[Refit]) -> list[Refit]:
    assert stage.errors is not None
    best = min(earned, key=likelihood)
    members = compared(best if leaves_noise(best) else best_predicting(earned), earned, stage.errors).members
    return [t for t in members if is_noticeable(stage, t)] or list(members)


def is_noticeable(stage: Stage, trial: Refit) -> bool:
    """True if a refit explains a noticeable part of the residual above the noise.

    Held-out data are used if their residual is more than noise. Otherwise all samples are used, each predicted by parameters
    that were not fitted to it. The errors are in units of the discrepancy of each record.
    """
    assert stage.errors is not None and trial.errors is not None
    return share_taken(stage.errors, trial.errors, *((SELECTION, TEST) if stage.shown_held_out else ALL)) > DECISION.further


def explains(stage: Stage, trial: Refit) -> bool:
    """True if a refit explains a noticeable part of the residual, and also of the one that the mean values of the channels
    leave. A law may only make a wrong model stand still: a sensor gain of -100 %, a brake."""
    assert trial.errors is not None
    left = trial.errors.mean(FITTED)
    return is_noticeable(stage, trial) and \
        left <= (1 - DECISION.further) * stage.still + DECISION.further * min(stage.still, 1.0)


def choosing(stage: Stage, trial: Refit) -> Stage:
    """The step with one of its refits chosen, and the candidates that the records cannot distinguish from it."""
    assert stage.errors is not None
    earned = _earned(stage)
    identity = compared(trial, [trial, *(t for t in earned if t is not trial)], stage.errors)
    # If the same law at another place fits as well and its residual is also noise, its larger residual on other records is
    # due to numbers that the fit does not determine (play on either side of a cylinder).
    near = [t for t in earned if any(t is m for m in identity.members) or (
        t.candidate.component == trial.candidate.component and t.experiment.noise_given
        and t.cost - trial.cost < EARNED and is_noise(t.chi2_fit, t.chi2_held_out, t.samples_held_out))]
    laws = (trial, *near)
    laws = (*laws, *twins_of(laws, stage))
    close = [t for t in near if t is not trial and not refines(t, laws)]
    return replace(stage, chosen=trial, identity=identity,
                   cluster=(trial, *close, *twins_of([trial, *close], stage)))


def refines(trial: Refit, laws: Iterable[Refit]) -> bool:
    """True if a law refines one of `laws` at the same place without a significant improvement."""
    return any(_needless(trial, simpler) for simpler in laws)


def _needless(trial: Refit, simpler: Refit) -> bool:
    """True if a law refines a simpler law at the same place without a significantly smaller residual.

    A law refines another one if it has more numbers, and if both are of one class or it generalises the other. It also
    refines the other one if one of its amplitudes is not supported by the records. For example, play whose gap is closed in
    the fit is the compliance that acts together with it, even with more shape parameters. A law of another class with
    supported amplitudes is a different explanation, even with more numbers, and a law with supported amplitudes refines none
    with an unsupported one. The threshold is not raised for inexact laws, because a more flexible law always fits an inexact
    law better.
    """
    more = trial.unknowns > simpler.unknowns
    related = same_class(trial.candidate.kind, simpler.candidate.kind)
    if more and not related:
        # an entry `replaces` of its effects declares that a law contains another one (Bouc-Wen hysteresis contains dry
        # friction with presliding)
        effects = trial.experiment.model.library.component(trial.candidate.component).effects
        related = any(simpler.candidate.component in effect.replaces for effect in effects)
    refines = (more and bool(trial.unshown)) or (not simpler.unshown and (bool(trial.unshown) or (more and related)))
    return refines and set(trial.candidate.where) == set(simpler.candidate.where) and _leaves_no_more(simpler, trial)


def _leaves_no_more(trial: Refit, reference: Refit) -> bool:
    """True if the residual of a refit is not significantly larger than the residual of another one, on fitted and on
    held-out data."""
    return (trial.cost - reference.cost) / max(1.0, reference.chi2_fit) < EARNED \
        and not fallen(trial.chi2_held_out, reference.chi2_held_out,  # (NaN without held-out data)
                       reference.samples_held_out) > EARNED


def leaders(stage: Stage, most: int, simplest: bool = False) -> list[Stage]:
    """Copies of the step, each with another choice: the best justified refit of each class and place, at most `most`, the
    leader first. Refits that the test data exclude in comparison with the leader are left out. With `simplest`, the law
    with the fewest numbers of each of these classes and places is added."""
    earned = _earned(stage)
    if not earned:
        return []
    first = _leader(stage, earned)
    plausible = _plausible(stage, earned)
    families: dict[object, list[Refit]] = {}
    for trial in [first, *(t for t in earned if t is not first and (t in plausible or merit(t) > merit(first)))]:
        families.setdefault((trial.candidate.kind, frozenset(trial.candidate.where)), []).append(trial)
    leading = list(families.values())[:most]
    chosen = [family[0] for family in leading]
    if simplest:
        least = [min(family, key=lambda t: (t.unknowns, merit(t))) for family in leading]
        chosen += [t for t in least if not any(t is refit for refit in chosen)]
    return [choosing(stage, trial) for trial in chosen]


def simpler_law(stage: Stage, trial: Refit) -> Refit | None:
    """A justified refit that is preferred to `trial` because its law is simpler; None if there is none.

    It has a smaller `merit` and no significantly larger residual. It also has fewer numbers, or `trial` refines it (a law of
    the same class at the same place, see `_needless`).
    """
    simpler = [t for t in _earned(stage) if merit(t) < merit(trial) and (
        (t.unknowns < trial.unknowns and _leaves_no_more(t, trial))
        or (t.candidate.kind == trial.candidate.kind and _needless(trial, t)))]
    return min(simpler, key=merit, default=None)


def twins_of(close: Sequence[Refit], stage: Stage) -> list[Refit]:
    """Candidates that are equivalent to the refits `close` but have another class or another place. Examples: `leakage`
    between the chambers is the `internal leakage` of the piston; delays of an input and of the only channel may have the
    same influence."""
    by_label = {s.candidate.label: s.candidate for s in stage.scores}
    pairs = [(trial, by_label[label]) for trial in close for label in stage.twins.get(trial.candidate.label, ())]
    return [replace(trial, candidate=twin) for trial, twin in pairs if not same_class(trial.candidate.kind, twin.kind)
            or stage.places.place(trial.candidate) != stage.places.place(twin)]


def merit(trial: Refit) -> float:
    """Ranking value of a refit: BIC of the fitted samples plus n ln(chi-square) of the selection data; smaller is better.
    The test data are not used."""
    return _merit(trial.cost, trial.samples, trial.unknowns, trial.errors)


def _merit(cost: float, samples: int, unknowns: int, errors: PredictiveErrors | None) -> float:
    selection_samples = errors.samples(SELECTION) if errors is not None else 0
    chi2 = errors.mean(SELECTION) if errors is not None and selection_samples else 1.0
    return bic(cost, samples, unknowns) + selection_samples * float(np.log(max(chi2, 1e-300)))


def _earned(stage: Stage) -> list[Refit]:
    """The justified refits, the best first. `merit` must fall by more than chance allows. If the residual on the
    selection data was more than noise, chi-square there must also fall by more than chance allows. The residual on all
    held-out data must not be larger than the residual of the model without the refit; if the latter is noise, it must be
    noise."""
    assert stage.errors is not None
    before, samples = stage.errors.mean(SELECTION), stage.errors.samples(SELECTION)
    return [t for t in stage.trials if merit(t) < stage.merit - EARNED and t.errors is not None
            and (not is_above_noise(before, samples) or fallen(before, t.errors.mean(SELECTION), samples) > EARNED)
            and (t.chi2_held_out < stage.chi2_held_out if stage.shown_held_out else
                 not is_above_noise(t.chi2_held_out, t.samples_held_out))]


def fallen(before: float, after: float, samples: int) -> float:
    """The decrease of chi-square of `samples` samples from `before` to `after` (per sample), in units of the residual
    chi-square per sample."""
    return (before - after) * samples / max(1.0, after)


def following(before: Stage) -> Experiment:
    """The experiment with the chosen effect in its diagram, at the fitted values; the numbers of the effect are free in
    their search ranges."""
    assert before.chosen is not None
    return at_values_of(before.chosen, before.chosen.experiment)


def at_values_of(trial: Refit, experiment: Experiment) -> Experiment:
    """The experiment with its free parameters at the values of a refit, which may be of this diagram or of one with an
    additional effect."""
    values = {n: v for n, v in trial.values.items() if n in experiment.free}
    record_values = {record: {n: v for n, v in values_of_record.items()
                              if n in experiment.free and not n.startswith("initial.")}
                     for record, values_of_record in trial.own.items()}
    return replace(experiment, model=experiment.model.with_parameters(values)).with_record_values(record_values)


def worth_it(step: Stage) -> bool:
    """True if the chosen effect of a step explains a noticeable part of the residual."""
    assert step.chosen is not None
    return is_noticeable(step, step.chosen)
