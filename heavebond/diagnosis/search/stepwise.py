"""Stepwise selection of several effects.

If two effects are missing, the first step sees both: a flexible law at a wrong place may take more of the misfit than
either of them alone, and every further effect then compensates its errors. Therefore:

* While more than the given noise is left, the search follows not only the best first effect but the best of a few classes
  and places, and of all selections so begun the best few, until one reaches the noise.
* The laws that lead the first step are each refitted beside calibration errors (offsets and gains of inputs and
  channels), and followed in the order of their residuals then.
* These laws are compared with each other as pairs: each with the further effect that completes it best (see
  `best_pairs`). Of a law alone the residual holds all other effects, and a law that imitates these leaves less.
* Beside all others, each effect is removed and sought again among all candidates: one that is not needed stays out, one
  that another improves on is replaced, and its alternatives are determined anew.
* A further effect that is absent at the end of its refit, but lowers the residual, has led the values out of a wrong
  local minimum of the diagram without it: this diagram is refitted from there, and the effect is left out.

This is forward selection with backward steps after P. Pudil, J. Novovicova and J. Kittler (1994, doi
10.1016/0167-8655(94)90127-9), by `merit` in place of their criterion.

A further effect that does not reach the noise is certain only if its strength is the same at small and at large motion,
and if no flexible law at the place of an earlier effect explains as much (see `doubts`). A law of the wrong form may
imitate the missing one at one amplitude, with numbers that another amplitude would not confirm: damping that grows with
the square of the distance looks like damping that grows with the speed. The strength may vary with the amplitude A(t) of
its influence on the channels (its envelope over two periods),

    strength(t) = 1 + b_1 g(t) + b_2 g(t)**2,      g = the rank of A(t) among all samples, from -1 to 1,

and b is estimated from the residuals together with all free parameters, to first order at the fit: the test of parameter
constancy (G. C. Chow, 1960, doi:10.2307/1910133; J. Nyblom, 1989, doi:10.1080/01621459.1989.10478759) along the amplitude
in place of time. Its covariance comes from blocks of time, as the residuals of an inexact model are correlated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import HeavebondError
from heavebond.core.presentation import number
from heavebond.core.progress import Progress
from heavebond.diagnosis.candidates.catalogue import Candidate, EffectNumber, called
from heavebond.diagnosis.candidates.places import Places, between_all_nodes, candidates
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.evidence.comparison import ALL, compared, leaves_noise, loss
from heavebond.diagnosis.evidence.prediction import share_taken
from heavebond.diagnosis.evidence.residual_tests import is_noise
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.refit import Refit, refitted_from
from heavebond.diagnosis.search.step import (
    Stage,
    at_values_of,
    choosing,
    fitted_base,
    following,
    leaders,
    merit,
    refitted_beside,
    simpler_law,
    single,
    worth_it,
)
from heavebond.estimation.experiment import Experiment
from heavebond.localise.error_states import envelope
from heavebond.numerics.dae import Array

BLOCKS = 30  # of time, over all records: the clusters of the covariance
AT = (0.1, 0.3, 0.5, 0.7, 0.9)  # quantiles of the amplitude at which the strength is looked at


@dataclass(frozen=True)
class Constancy:
    """The strength of an effect at five amplitudes, the smallest first (1 is that of the fit), and the probability of such
    differences where it is constant."""

    strength: tuple[float, ...]
    chance: float

    @property
    def differs(self) -> bool:
        """Whether the strength differs by more than chance, and noticeably."""
        return self.chance < DECISION.level and max(abs(s - 1) for s in self.strength) > DECISION.constant


def constancy(base: Base, numbers: Sequence[EffectNumber]) -> Constancy | None:
    """The strength over the amplitude of the effect with these numbers, which is in the diagram of a fitted model; None
    where it has no amplitude that vanishes, or does nothing."""
    own = _own_response(base, numbers)
    if own is None or not own.any():
        return None
    amplitude, cluster = _amplitudes(base, own)
    g = np.empty(len(own))
    g[np.argsort(amplitude, kind="stable")] = np.linspace(-1.0, 1.0, len(own))
    moving = np.flatnonzero(~base.problem.at_end(base.inner))
    J, priors = base.J[:, moving], base.priors[:, moving]
    X = np.column_stack([J, own * g, own * g**2])
    scale = np.sqrt(np.maximum((X**2).sum(axis=0), 1e-300))
    X = X / scale
    P = np.pad(priors / scale[:len(moving)], ((0, 0), (0, 2)))
    normal = X.T @ X + P.T @ P
    inverse = np.linalg.pinv(normal, rcond=1e-12)
    step = -inverse @ (X.T @ base.r + P.T @ base.problem.priors(base.inner)[0])
    left = base.r + X @ step
    scores = np.stack([np.bincount(cluster, X[:, k] * left, int(cluster.max()) + 1) for k in range(X.shape[1])], axis=1)
    blocks = len(scores)
    covariance = inverse @ (scores.T @ scores) @ inverse * blocks / max(blocks - 1, 1)
    b = (step / scale)[-2:]
    spread = covariance[-2:, -2:] / scale[-2:, None] / scale[-2:]
    # the effect's own numbers move as well: what they do is a part of the strength
    names = {n.name for n in numbers}
    inside = [k for k, column in enumerate(moving) if base.problem.columns[column].free.name in names]
    common = float(own @ (X[:, inside] @ step[inside])) / float(own @ own)
    strength = tuple(float(1 + common + b[0] * v + b[1] * v**2) for v in np.quantile(g, AT))
    return Constancy(strength, _chance(b, spread, blocks))


def _chance(b: Array, spread: Array, blocks: int) -> float:
    """The p value of b = 0: Hotelling's T**2 with the covariance of so many blocks."""
    from scipy.special import fdtrc

    t = float(b @ np.linalg.pinv(spread) @ b)
    free = max(blocks - 1, 3)
    return float(fdtrc(2, free - 1, t * (free - 1) / (2 * free)))


def _own_response(base: Base, numbers: Sequence[EffectNumber]) -> Array | None:
    """What the effect does to the residuals (n,) with the strength that it has, to first order."""
    neutral = {n.name: n.neutral for n in numbers if n.amplitude and n.sought is None}
    found = np.zeros(len(base.r))
    for k, (column, inner) in enumerate(zip(base.problem.columns, base.inner, strict=True)):
        if column.free.name in neutral:
            found += base.J[:, k] / column.slope(inner) * (column.outer(inner) - neutral[column.free.name])
    return found if neutral else None


def _amplitudes(base: Base, own: Array) -> tuple[Array, NDArray[np.int64]]:
    """The envelope of a response at every residual (n,), over all channels together, and the block of time of each."""
    runs, before = base.problem.runs, 0
    found, cluster = np.zeros(len(own)), np.zeros(len(own), dtype=np.int64)
    number, total = 0, len(own)
    for run in runs:
        channel, place = np.nonzero(run.counts)
        part = own[before:before + len(place)]
        time = run.found.grid
        square = np.zeros(len(time))
        for c in np.unique(channel):
            there = channel == c
            whole = np.interp(np.arange(len(time)), place[there], part[there])
            square += envelope(whole, time)[0]**2
        found[before:before + len(place)] = np.sqrt(square)[place]
        blocks = max(2, round(BLOCKS * len(place) / total))
        cluster[before:before + len(place)] = number + place * blocks // len(time)
        before, number = before + len(place), number + blocks
    return found, np.unique(cluster, return_inverse=True)[1].astype(np.int64)


MOST = 5  # effects
RIVALS = 8  # laws of the first step at most that are compared in pairs
WAYS = 3  # ladders that are followed side by side,
FOLLOWED = 0.5  # those that take this share of what the best takes away
BEGUN = 0.5  # share of the time of a step that must be left for the next, which begins near its end and may reach the noise
DECISIVE = 10.0  # what another effect must be better by to take the place of one that was found (as in `rung.indistinct`)


@dataclass(frozen=True)
class SelectedEffect:
    """A selected effect: the step at which it was chosen, and its alternatives, which the records cannot distinguish from it
    beside the effects `beside` (their labels; None: not known yet). `former` are its alternatives beside others, as far as
    these are known; `review` is the step in which it was sought again beside all other effects, if that was made."""

    step: Stage
    alternatives: tuple[Refit, ...]
    beside: frozenset[str] | None = frozenset()
    former: Mapping[frozenset[str], tuple[Refit, ...]] = field(default_factory=dict, repr=False, compare=False)
    review: Stage | None = field(default=None, repr=False, compare=False)

    @property
    def chosen(self) -> Refit:
        """The effect refitted."""
        assert self.step.chosen is not None
        return self.step.chosen

    @property
    def candidate(self) -> Candidate:
        """What was added."""
        return self.chosen.candidate

    def judged(self, alternatives: tuple[Refit, ...], beside: frozenset[str], review: Stage | None = None) -> SelectedEffect:
        """The same with what the records cannot tell from it beside other effects."""
        known = {} if self.beside is None else {self.beside: self.alternatives}
        return replace(self, alternatives=alternatives, beside=beside, former={**self.former, **known}, review=review)

    def among(self, others: frozenset[str]) -> SelectedEffect:
        """The same with its alternatives beside these effects, where they are known."""
        known = self.former.get(others)
        return self if known is None or self.beside == others else self.judged((self.chosen, *known[1:]), others)

    @property
    def is_noise(self) -> bool:
        """Whether no more than the noise is left after it: the given one, or less than an estimated one, which may hold what
        a channel moves from one sample to the next."""
        trial = self.chosen
        if trial.experiment.noise_given:
            return is_noise(trial.chi2_fit, trial.chi2_held_out, trial.samples_held_out)
        return trial.chi2_fit <= 1 and not trial.chi2_held_out > 1  # (NaN where nothing is held out)


Selection = tuple[SelectedEffect, ...]
Stepping = Callable[[Experiment, Selection], Stage]
Calibrating = Callable[[Experiment], Stage]


def select_stepwise(experiment: Experiment, stepping: Stepping, say: Progress, most: int = MOST,
                    left: Callable[[], float] = lambda: inf, calibrating: Calibrating | None = None
                    ) -> Iterator[tuple[Selection, Stage]]:
    """Yield the selection of at most `most` effects that leaves least so far, and the last step that was made (with the
    chosen effect in it, or with none that is worth it); the last pair is the result.

    `stepping` makes a step on an experiment, given the selection that leads there, and `calibrating` one of calibration
    errors alone. A further step begins only if `BEGUN` of the time of the step before is `left` (s), and one that the time
    ends counts only if it reaches the noise. A pair that is yielded before more work has a partial step: it is the result
    if this work is ended early.
    """
    last = stepping(experiment, ())
    yield (), replace(last, chosen=None, cluster=(), partial=True)
    if last.chosen is not None and last.chosen.absent and not last.partial:  # a wrong local minimum of the free parameters
        last = stepping(at_values_of(last.chosen, experiment), ())
    base, ways = last.merit, _extended((), last)
    yield (ways[0] if ways else ()), last
    pairs, joint = list[Selection](), tuple[Refit, ...]()
    if calibrating is not None and ways and not (last.partial or ways[0][-1].is_noise or most < 2):
        ways, pairs = _beside_calibration(last, ways, calibrating, left)
    for turn in range(2 * most):
        if not ways or len(ways[0]) >= most or last.partial or ways[0][-1].is_noise or near_the_noise(ways[0]):
            break
        yield ways[0], replace(ways[0][-1].step, partial=True)
        steps: list[tuple[Stage, list[Selection]]] = []
        for way in _promising(ways, base):
            if left() < BEGUN * way[-1].step.seconds:
                break
            made = stepping(following(way[-1].step), way)
            steps.append((made, _extended(way, made)))
            pair = _completed(way, made) if turn == 0 else ()
            pairs += [pair] if pair else []
            if made.partial or any(found[-1].is_noise for found in steps[-1][1]):
                break
            if pair and len(steps) == 1:
                yield (steps[0][1] or ways)[0], replace(made, partial=True)
                joint = joint_refits(pair, say, left)
        if turn == 0 and pairs:
            joint = best_pairs(pairs, joint)
            ways = [_with_joint(way, joint) for way in ways]
            steps = [(made, [_with_joint(way, joint) for way in extended]) for made, extended in steps]
        cut = bool(steps) and steps[-1][0].partial and left() <= 0  # by the time, not by the user
        if not steps or (cut and not any(found[-1].is_noise for found in steps[-1][1])):
            last = ways[0][-1].step
            break
        longer = [found for _, extended in steps for found in extended
                  if worth_it(found[-1].step) and _merit(found) < min(map(_merit, ways))]
        longer = [_without_absent(found) for found in longer]
        ways = _distinct(sorted(longer, key=_merit)) if longer else sorted(ways, key=_merit)
        last = replace(ways[0][-1].step if longer else steps[0][0], partial=steps[-1][0].partial)
        if not longer:
            break
        if not last.partial and left() > 0:
            for way, partial in looked_back(ways[0], stepping, say):
                last = replace(way[-1].step, partial=partial)
                yield way, last
            ways[0] = way
    yield (ways[0] if ways else ()), last


def near_the_noise(way: Selection) -> bool:
    """Whether several effects leave a residual near the noise: a further one would be within the error of the noise. (After
    the first effect, a second may show that the first is wrong.)"""
    last = way[-1].chosen
    return len(way) > 1 and last.chi2_fit <= DECISION.near and not last.chi2_held_out > DECISION.near


def _extended(way: Selection, made: Stage) -> list[Selection]:
    """A ladder with each of the effects that lead a step from it."""
    return [(*way, SelectedEffect(step, step.cluster, _labels(way))) for step in leaders(made, WAYS)]


def _without_absent(way: Selection) -> Selection:
    """The ladder without its last effect, if that effect is absent from the fitted model and the shorter ladder, refitted
    from the values found with the effect, is as good: by its merit, or on the fitted records if it leaves nearly noise. (If
    a motion is sensitive to its start, two fits that the fitted records cannot distinguish may differ on other records by
    more than the merits allow.)"""
    chosen = way[-1].chosen
    if len(way) < 2 or not chosen.absent:
        return way
    before = way[-2]
    found = refitted_from(fitted_base(before.step.experiment), before.candidate, replace(chosen, candidate=before.candidate))
    shorter = way[:-1] if found is None else _with_last(way[:-1], found)
    trial = shorter[-1].chosen
    as_good = trial.bic < chosen.bic + DECISIVE and not max(trial.chi2_fit, trial.chi2_held_out) > DECISION.near
    return shorter if as_good or _merit(shorter) < _merit(way) + DECISIVE else way


def _beside_calibration(made: Stage, ways: Sequence[Selection], calibrating: Calibrating, left: Callable[[], float]
                        ) -> tuple[list[Selection], list[Selection]]:
    """The ladders of one effect in the order of what is left beside a calibration error, where that takes a noticeable part
    of it; those of the simplest law of a class and place stand among them where it leads beside one. And each of these laws
    with the calibration error that completes it best."""
    found = {_label(way): (_merit(way), way) for way in ways}
    pairs = []
    for step in leaders(made, WAYS, simplest=True):
        if left() <= 0:
            break
        way = (SelectedEffect(step, step.cluster),)
        beside = calibrating(following(step))
        pairs += [pair] if (pair := _completed(way, beside)) else []
        if beside.chosen is not None and worth_it(beside):
            found[_label(way)] = merit(beside.chosen), way
    return [way for _, way in sorted(found.values(), key=lambda pair: pair[0])], pairs


def _completed(way: Selection, made: Stage) -> Selection:
    """A selection of one effect with the further effect of a step on it that predicts best, whether or not that is
    justified; none if no further effect was refitted."""
    trials = [t for t in made.trials if t.errors is not None]
    if not trials:
        return ()
    step = choosing(made, min(trials, key=loss))
    return (*way, SelectedEffect(step, step.cluster, _labels(way)))


def joint_refits(pair: Selection, say: Progress, left: Callable[[], float]) -> tuple[Refit, ...]:
    """The other leading laws of the first step, each refitted with the second effect of a `pair`, from the values of the law
    alone; of a pair in which the law is absent nothing is kept, as it is the pair of the other effect alone."""
    law, second = (added.candidate for added in pair)
    first = pair[0].step
    laws = [t for t in leading_laws(first) if t.candidate.label not in (law.label, second.label)]
    others = without_effect(pair, 0, say) if laws and left() > 0 else None
    if others is None:
        return ()
    experiment = following(others[-1].step)
    try:
        base = fitted_base(experiment)
    except HeavebondError:
        return ()
    there = {c.label: c for rule in (candidates, between_all_nodes) for c in rule(experiment) if not c.acts_on([second])}
    found = []
    for trial in (t for t in laws if t.candidate.label in there):
        if left() <= 0:
            break
        say(f"comparing the leading effects in pairs: {trial.candidate.label} and {second.label}")
        joint = refitted_from(base, there[trial.candidate.label], trial)
        found += [replace(joint, lent=second.label)] if joint is not None and not joint.absent else []
    return tuple(found)


def leading_laws(first: Stage) -> list[Refit]:
    """The refits of a step that take away at least `FOLLOWED` of the misfit that the best of them takes away, at most
    `RIVALS`, the best first."""
    assert first.errors is not None
    shares = [(share_taken(first.errors, t.errors, *ALL), t) for t in first.trials if t.errors is not None]
    least = FOLLOWED * max((share for share, _ in shares), default=0.0)
    return sorted((t for share, t in shares if share >= least), key=loss)[:RIVALS]


def best_pairs(pairs: Sequence[Selection], joint: Sequence[Refit]) -> tuple[Refit, ...]:
    """The leading laws of the first step, each in the pair with a further effect that predicts best, the best first.

    `pairs` are selections of two effects that begin with a law of this step, and `joint` other pairs (see `joint_refits`).
    If a machine lacks several effects, the misfit of one law holds all others, and a law of a wrong class that imitates them
    leaves less; in pairs each law has the same means to explain the rest. A law is completed only by effects that leave more
    alone than it does: of two effects the larger one is the first.
    """
    first = pairs[0][0].step
    found = {t.candidate.label: t for t in leading_laws(first)}
    alone = {t.candidate.label: loss(t) for t in first.trials if t.errors is not None}
    own = [(replace(second.chosen, candidate=law.candidate, beyond=law.chosen.beyond, unshown=law.chosen.unshown),
            second.candidate.label) for law, second in pairs]
    for pair, second in (*own, *((t, t.lent) for t in joint)):
        label = pair.candidate.label
        before = found.get(label)
        if alone.get(second, inf) >= alone.get(label, inf) and (before is None or loss(pair) < loss(before)):
            found[label] = pair
    return tuple(sorted(found.values(), key=loss))


def _with_joint(way: Selection, joint: tuple[Refit, ...]) -> Selection:
    """A selection with the pairs of the leading laws in its first step, and without those alternatives of its first effect
    that the pairs exclude."""
    first, known = way[0], {t.candidate.label: t for t in joint}
    alternatives, own = first.alternatives, known.get(first.candidate.label)
    if own is not None and first.step.errors is not None:
        others = [known[t.candidate.label] for t in alternatives[1:] if t.candidate.label in known]
        kept = {t.candidate.label for t in compared(own, others, first.step.errors).members}
        alternatives = tuple(t for t in alternatives if t.candidate.label not in known or t.candidate.label in kept)
    return replace(first, step=replace(first.step, joint=joint), alternatives=alternatives), *way[1:]


def _label(way: Selection) -> str:
    return way[-1].candidate.label


def _merit(way: Selection) -> float:
    return merit(way[-1].chosen)


def _promising(ways: Sequence[Selection], base: float) -> list[Selection]:
    """The ladders that may still win. An estimated noise is no yardstick by which the best could be found wanting: with it
    the best alone is followed."""
    given, best = ways[0][-1].step.experiment.noise_given, min(map(_merit, ways))
    return [ways[0], *(way for way in ways[1:WAYS] if given and base - _merit(way) > FOLLOWED * (base - best))]


def _distinct(ways: Sequence[Selection]) -> list[Selection]:
    """The same effects in another order are one ladder."""
    found: dict[frozenset[str], Selection] = {}
    for way in ways:
        found.setdefault(frozenset(added.candidate.label for added in way), way)
    return list(found.values())


def looked_back(way: Selection, stepping: Stepping, say: Progress) -> Iterator[tuple[Selection, bool]]:
    """Yield the selection without effects that are not needed beside the others, with better ones in their place, and each
    effect with its alternatives beside all others, as far as that is known; and whether some effect was not examined
    yet."""
    way = _among(way)
    while (k := next((k for k, added in enumerate(way) if added.beside != _others(way, k)), None)) is not None:
        yield way, True
        say(f"is {way[k].candidate.label} still needed?")
        changed = _asked_again(way, k, stepping, say)
        if changed is None:
            return
        way = _among(_in_order(changed, say))
    yield way, False


def _asked_again(way: Selection, k: int, stepping: Stepping, say: Progress) -> Selection | None:
    """The ladder after its k-th effect was sought anew beside all others; None where the search for it was ended early."""
    others = without_effect(way, k, say)
    if others is None:
        return _with(way, k, way[k].judged(way[k].alternatives, _others(way, k)))
    # this very diagram is known already with the effect, and its rivals begin from what they were without the others
    exact = replace(way[-1].chosen, candidate=way[k].candidate)
    again = stepping(following(others[-1].step) if others else way[k].step.experiment, others)
    if again.partial:
        return None
    again = refitted_beside(again, way[k].alternatives[1:], exact)
    if again.chosen is None or not worth_it(again):
        return others
    same = next((t for t in again.trials if t.candidate.label == way[k].candidate.label), None)
    if same is not None and merit(same) < _merit(way) - DECISIVE:  # the diagram that is known has another valley
        way = _with_last(way, same)
    assert again.identity is not None
    excluded = not any(t is same for t in again.identity.members)  # what the records cannot tell from it takes no place
    if excluded and merit(again.chosen) < _merit(way) - DECISIVE:
        return _instead(way, k, again, others, say)
    if same is not None and (law := simpler_law(again, same)) is not None:
        return _instead(way, k, choosing(again, law), others, say)
    alike = choosing(again, same).cluster if same is not None else (way[k].chosen, *again.cluster)
    return _with(way, k, way[k].judged(alike, _others(way, k), again))


def _instead(way: Selection, k: int, again: Stage, others: Selection, say: Progress) -> Selection:
    """The ladder with what was chosen beside all `others` in the place of its k-th effect, or behind them where it does
    nothing noticeable at that place yet."""
    assert again.chosen is not None
    last = (*others, SelectedEffect(again, again.cluster, _labels(others)))
    there = next((t for t in way[k].step.trials if t.candidate.label == again.chosen.candidate.label), None)
    if there is None or k == len(way) - 1:
        return last
    step = choosing(way[k].step, there)
    if not worth_it(step):
        return last
    found = _continued((*way[:k], SelectedEffect(step, step.cluster, _labels(way[:k]))), way, k, say)
    if found is None:
        return last
    found = _with_last(found, again.chosen)
    return _with(found, k, found[k].judged((found[k].chosen, *again.cluster[1:]), _others(found, k), again))


def _in_order(way: Selection, say: Progress) -> Selection:
    """The ladder with each effect that does nothing noticeable at its place yet behind one beside which it does."""
    given = way
    for _ in way[1:]:
        k = next((k for k, added in enumerate(way[:-1]) if not worth_it(added.step)), None)
        if k is None:
            return way
        moved = _continued(way[:k], (*way, way[k]), k, say)
        if moved is None:
            break
        way = _with_last(moved, given[-1].chosen)
    return way if worth_it(way[0].step) else given


def _with(way: Selection, k: int, added: SelectedEffect) -> Selection:
    return *way[:k], added, *way[k + 1:]


def _with_last(way: Selection, better: Refit) -> Selection:
    """The ladder whose last diagram, that of `better` too, has the values found there, where these leave less."""
    last = way[-1]
    trial = replace(better, candidate=last.candidate)
    if trial.cost >= last.chosen.cost or any(n.name not in trial.values for n in last.candidate.numbers
                                             if n.name in last.chosen.values):
        return way
    trials = [trial, *(t for t in last.step.trials if t.candidate.label != last.candidate.label)]
    step = choosing(replace(last.step, trials=tuple(sorted(trials, key=merit))), trial)
    alternatives = step.cluster if last.beside is not None else (trial, *last.alternatives[1:])
    return _with(way, len(way) - 1, replace(last, step=step, alternatives=alternatives))


def _labels(way: Selection) -> frozenset[str]:
    return frozenset(added.candidate.label for added in way)


def _others(way: Selection, k: int) -> frozenset[str]:
    return _labels((*way[:k], *way[k + 1:]))


def _among(way: Selection) -> Selection:
    """The ladder with the alternatives of each effect beside all others of it, where these are known."""
    return tuple(added.among(_others(way, k)) for k, added in enumerate(way))


def without_effect(way: Selection, k: int, say: Progress) -> Selection | None:
    """The ladder without its k-th effect, what followed refitted one after the other; None where that stands upon it."""
    return _continued(way[:k], way, k, say)


def _continued(found: Selection, way: Selection, k: int, say: Progress) -> Selection | None:
    """A ladder with what follows the k-th effect of another one, refitted one after the other; None where that stands upon
    this effect."""
    for added in way[k + 1:]:
        step = way[0].step if not found else None  # the first has tried nearly everything already
        wanted, gone = added.candidate, way[k].candidate
        beside: frozenset[str] | None = frozenset()
        if step is None or not any(_is(t.candidate, wanted, gone) for t in step.trials):
            now = following(found[-1].step) if found else way[0].step.experiment
            there = next((c for rule in (candidates, between_all_nodes) for c in rule(now) if _is(c, wanted, gone)), None)
            if there is None:
                return None
            step, beside = single(now, there, say), None
        if step.partial and found:
            raise KeyboardInterrupt
        trial = next((t for t in step.trials if _is(t.candidate, wanted, gone)), None)
        if trial is None:
            return None
        step = choosing(step, trial)
        alternatives = step.cluster if beside is not None else (trial, *added.alternatives[1:])
        known = {} if added.beside is None else {added.beside: added.alternatives}
        found = (*found, SelectedEffect(step, alternatives, beside, {**added.former, **known}))
    return found


def _is(candidate: Candidate, wanted: Candidate, gone: Candidate) -> bool:
    """Whether a candidate is the one that is wanted, in a diagram without the effect that is gone: what stood before that
    effect's input (lag_inlet.u) stands before the input that this one took over (inlet.u)."""
    former = {new: old for old, new in gone.change.moved.items()}
    place = (former.get(wanted.signal, wanted.signal), "") if wanted.signal else ("", wanted.place)
    return (candidate.component, candidate.attaches, candidate.signal, "" if candidate.signal else candidate.place) == \
        (wanted.component, wanted.attaches, *place)


@dataclass(frozen=True)
class Unsupported:
    """A further effect that is not certain, and why: its strength is not constant over the amplitude (`constancy`), or an
    identified `curve` in addition to an earlier effect explains most of what it explains."""

    added: SelectedEffect
    constancy: Constancy | None = None
    curve: Refit | None = None

    @property
    def words(self) -> str:
        """The reason in a sentence."""
        step, chosen = self.added.step, self.added.chosen
        held = step.chi2_held_out == step.chi2_held_out  # (NaN: nothing is held out)
        before, after = (step.chi2_held_out, chosen.chi2_held_out) if held else (step.chi2_fit, chosen.chi2_fit)
        refused = f"{called(self.added.candidate)} lowers the reduced chi-square from {number(before, 3)} to " \
                  f"{number(after, 3)}, but is not certain: "
        if self.curve is not None:
            left = self.curve.chi2_held_out if held else self.curve.chi2_fit
            return refused + f"another law {self.curve.candidate.place}, as an identified curve, explains most of that " \
                             f"as well ({number(left, 3)})."
        assert self.constancy is not None
        low, high = min(self.constancy.strength), max(self.constancy.strength)
        return refused + "its strength is not the same at small and large motion " \
                         f"({number(low, 2)} to {number(high, 2)} times the fitted one where it may vary)."


def doubts(way: Selection, say: Progress, curves: Callable[[Experiment, Callable[[Candidate], bool]], Stage] | None = None
           ) -> list[Unsupported]:
    """Of the effects of a selection those at its end that are not certain, in their order, and why.

    A further effect is judged against the residual before it, of which `worth_it` demands a noticeable share. No law is
    exact, and what remains may be the error of an earlier law, which another law may imitate on all records of one kind. So
    a further effect that does not reach the noise is named only if its strength is the same at small and at large motion,
    and if no identified curve at the place of an earlier effect, added to it, explains most of what the further effect
    explains (`curves` makes a step of those identified curves for which a predicate holds). An effect at the place of an
    earlier one is part of the law there. An effect that is not certain remains in the model: the earlier effects are judged
    beside it.
    """
    doubtful: list[Unsupported] = []
    while len(way) > 1 and not _reaches_the_noise(way[-1]):
        last, at_earlier = way[-1], _at_earlier_place(way)
        if at_earlier(last.candidate):
            break
        say(f"is {last.candidate.label} the same at all amplitudes?")
        strength = _constancy(last)
        reason = Unsupported(last, constancy=strength) if strength is not None and strength.differs else None
        if reason is None and curves is not None:
            say(f"would another law of the earlier effects explain as much as {last.candidate.label}?")
            trials = curves(last.step.experiment, at_earlier).trials
            best = min((t for t in trials if t.errors is not None), key=loss, default=None)
            if best is not None and _explains_most(best, last):
                reason = Unsupported(last, curve=best)
        if reason is None:
            break
        doubtful.insert(0, reason)
        way = way[:-1]
    return doubtful


def _at_earlier_place(way: Selection) -> Callable[[Candidate], bool]:
    """Whether a candidate of the last step is at the place of an effect before the last one."""
    step = way[-1].step
    earlier = {Places.of(added.step.experiment, step.as_one).place(added.candidate) for added in way[:-1]}
    return lambda candidate: step.places.place(candidate) in earlier


def _explains_most(curve: Refit, added: SelectedEffect) -> bool:
    """Whether a curve takes away most of what an added effect takes away from the residual before it."""
    assert added.step.errors is not None
    before = added.step.errors.mean(*ALL)
    return before - loss(curve) > DECISION.mainly * (before - loss(added.chosen))


def _reaches_the_noise(added: SelectedEffect) -> bool:
    """Whether the given noise is left with an effect, and clearly more than that without it."""
    before = added.step.chi2_held_out if added.step.samples_held_out else added.step.chi2_fit
    return added.chosen.experiment.noise_given and leaves_noise(added.chosen) and before > DECISION.near


def _constancy(added: SelectedEffect) -> Constancy | None:
    try:
        return constancy(fitted_base(following(added.step)), added.candidate.numbers)
    except HeavebondError:
        return None
