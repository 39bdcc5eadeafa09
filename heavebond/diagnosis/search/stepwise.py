"""Stepwise selection of several effects.

If two effects are missing, the first step sees the misfit of both. A flexible law at a wrong place may then explain more of
the misfit than either effect alone, and each further effect compensates the errors of this law. Therefore:

* While the residual is more than the given noise, the search continues several selections: the best few classes and
  places of the first step, and later the best few selections, until one of them reaches the noise.
* The leading laws of the first step are each refitted together with calibration errors (offsets and gains of inputs and
  channels). Their residuals then determine the order in which the search continues.
* These laws are also compared in pairs, each with the further effect that complements it best (see `best_pairs`). The
  residual of one law alone contains all other missing effects, and a law that imitates these has a smaller residual.
* Each effect is removed and searched again among all candidates, with all other effects in the diagram. An effect that is
  not needed is left out, an effect for which there is a better one is replaced, and its alternatives are determined
  again.
* A further effect may be absent at the end of its refit and still lower the residual. It has then led the parameters out
  of a wrong local minimum of the diagram without it. This diagram is refitted from the new values, and the effect is left
  out.

This is forward selection with backward steps after P. Pudil, J. Novovicova and J. Kittler (1994, doi
10.1016/0167-8655(94)90127-9), with `merit` as the criterion.

A further effect that does not reach the noise is certain only under two conditions: its strength is the same at small and at
large motion, and no flexible law at the place of an earlier effect explains as much (see `doubts`). A law of the wrong form
may imitate the missing law at one amplitude, with numbers that do not hold at another amplitude. For example, damping that
grows with the square of the distance looks like damping that grows with the speed. The strength may vary with the amplitude
A(t) of the effect's influence on the channels (its envelope over two periods),

    strength(t) = 1 + b_1 g(t) + b_2 g(t)**2,      g = the rank of A(t) among all samples, from -1 to 1.

b is estimated from the residuals together with all free parameters, to first order at the fit. This is the test of parameter
constancy (G. C. Chow, 1960, doi:10.2307/1910133; J. Nyblom, 1989, doi:10.1080/01621459.1989.10478759), along the amplitude
instead of time. The covariance of b is computed from blocks of time, because the residuals of an inexact model are
correlated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
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
    EARNED,
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

BLOCKS = 30  # number of blocks of time over all records, for the covariance
ACTING = 1e-3  # share of the largest amplitude below which an effect does not act and its strength cannot be estimated
AT = (0.1, 0.3, 0.5, 0.7, 0.9)  # quantiles of the amplitude at which the strength is evaluated


@dataclass(frozen=True)
class Constancy:
    """The strength of an effect at five amplitudes, the smallest first, relative to the fitted strength. `chance` is the
    probability of such differences if the strength is constant."""

    strength: tuple[float, ...]
    chance: float

    @property
    def differs(self) -> bool:
        """True if the strength differs significantly and by a noticeable share."""
        return self.chance < DECISION.level and max(abs(s - 1) for s in self.strength) > DECISION.constant


def constancy(base: Base, numbers: Sequence[EffectNumber]) -> Constancy | None:
    """Estimate the strength of an effect as a function of its amplitude. `base` is the fitted model with the effect,
    `numbers` are the numbers of the effect. None if no amplitude of the effect has a neutral value, or if it has no
    influence."""
    from scipy.special import fdtrc

    neutral = {n.name: n.neutral for n in numbers if n.amplitude and n.sought is None}
    response = np.zeros(len(base.r))  # influence of the effect on the residuals (n,) at its fitted strength, to first order
    for k, (column, inner) in enumerate(zip(base.problem.columns, base.inner, strict=True)):
        if column.free.name in neutral:
            response += base.J[:, k] / column.slope(inner) * (column.outer(inner) - neutral[column.free.name])
    if not response @ response > 0:
        return None
    amplitude, size, cluster = _amplitudes(base, response)
    acting = np.flatnonzero(size > ACTING * size.max())
    g = np.full(len(response), -1.0)
    g[acting[np.argsort(amplitude[acting], kind="stable")]] = np.linspace(-1.0, 1.0, len(acting))
    moving = np.flatnonzero(~base.problem.at_end(base.inner))
    J, priors = base.J[:, moving], base.priors[:, moving]
    X = np.column_stack([J, response * g, response * g**2])
    scale = np.sqrt(np.maximum((X**2).sum(axis=0), 1e-300))
    X = X / scale
    P = np.pad(priors / scale[:len(moving)], ((0, 0), (0, 2)))
    normal = X.T @ X + P.T @ P
    inverse = np.linalg.pinv(normal, rcond=1e-12)
    step = -inverse @ (X.T @ base.r + P.T @ base.problem.priors(base.inner)[0])
    residual = base.r + X @ step
    scores = np.stack([np.bincount(cluster, X[:, k] * residual, int(cluster.max()) + 1) for k in range(X.shape[1])], axis=1)
    blocks = len(scores)
    covariance = inverse @ (scores.T @ scores) @ inverse * blocks / max(blocks - 1, 1)
    b = (step / scale)[-2:]
    spread = covariance[-2:, -2:] / scale[-2:, None] / scale[-2:]
    # the numbers of the effect move as well; their contribution is part of the strength
    names = {n.name for n in numbers}
    inside = [k for k, column in enumerate(moving) if base.problem.columns[column].free.name in names]
    common = float(response @ (X[:, inside] @ step[inside])) / float(response @ response)
    strength = tuple(float(1 + common + b[0] * v + b[1] * v**2) for v in np.quantile(g[acting], AT))
    # p value of the hypothesis b = 0 by Hotelling's T**2
    t = float(b @ np.linalg.pinv(spread) @ b)
    free = max(blocks - 1, 3)
    return Constancy(strength, float(fdtrc(2, free - 1, t * (free - 1) / (2 * free))))


def _amplitudes(base: Base, response: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """The envelopes (n,) of a response at each residual, about its mean and about zero, combined over all channels, and the
    index (n,) of the block of time."""
    runs, before = base.problem.runs, 0
    amplitude, cluster = np.zeros((2, len(response))), np.zeros(len(response), dtype=np.int64)
    number, total = 0, len(response)
    for run in runs:
        channel, place = np.nonzero(run.counts)
        part = response[before:before + len(place)]
        time = run.found.grid
        square = np.zeros((2, len(time)))
        for c in np.unique(channel):
            of_channel = channel == c
            whole = np.interp(np.arange(len(time)), place[of_channel], part[of_channel])
            square += [envelope(whole, time)[0]**2, envelope(whole, time, about=0.0)[0]**2]
        amplitude[:, before:before + len(place)] = np.sqrt(square)[:, place]
        blocks = max(2, round(BLOCKS * len(place) / total))
        cluster[before:before + len(place)] = number + place * blocks // len(time)
        before, number = before + len(place), number + blocks
    return *amplitude, np.unique(cluster, return_inverse=True)[1].astype(np.int64)


MOST = 5  # maximum number of effects
RIVALS = 8  # maximum number of laws of the first step that are compared in pairs
WAYS = 3  # maximum number of selections that are continued in parallel,
LITTLE = 0.05  # first amplitude of a law that is refitted beside another one, as a share of its amplitude alone
FOLLOWED = 0.5  # those that explain at least this share of the misfit that the best one explains
BEGUN = 0.5  # remaining time required for a further step, as a share of the time of the previous step
DECISIVE = 10.0  # difference of `merit` that is required to replace a selected effect (strong evidence in BIC)


@dataclass(frozen=True)
class SelectedEffect:
    """An effect of a selection.

    `step` is the step at which it was chosen. `alternatives` are the candidates that the records cannot distinguish from it
    if the effects with the labels `beside` are in the diagram (None: not determined yet). `former` holds known alternatives
    for other sets of effects. `review` is the step in which the effect was searched again with all other effects in the
    diagram, if this step was made.
    """

    step: Stage
    alternatives: tuple[Refit, ...]
    beside: frozenset[str] | None = frozenset()
    former: Mapping[frozenset[str], tuple[Refit, ...]] = field(default_factory=dict, repr=False, compare=False)
    review: Stage | None = field(default=None, repr=False, compare=False)

    @property
    def chosen(self) -> Refit:
        """The refit of the effect."""
        assert self.step.chosen is not None
        return self.step.chosen

    @property
    def candidate(self) -> Candidate:
        """The candidate that was added."""
        return self.chosen.candidate

    def judged(self, alternatives: tuple[Refit, ...], beside: frozenset[str], review: Stage | None = None) -> SelectedEffect:
        """The effect with new `alternatives`, which hold if the effects `beside` are in the diagram."""
        known = {} if self.beside is None else {self.beside: self.alternatives}
        return replace(self, alternatives=alternatives, beside=beside, former={**self.former, **known}, review=review)

    def among(self, labels: frozenset[str]) -> SelectedEffect:
        """The effect with its alternatives if the effects `labels` are in the diagram; unchanged if they are not known."""
        known = self.former.get(labels)
        return self if known is None or self.beside == labels else self.judged((self.chosen, *known[1:]), labels)

    @property
    def is_noise(self) -> bool:
        """True if the residual with this effect is noise. If the noise is estimated, chi-square per sample must be at
        most 1, because the estimate may include true changes of a channel from one sample to the next."""
        trial = self.chosen
        if trial.experiment.noise_given:
            return is_noise(trial.chi2_fit, trial.chi2_held_out, trial.samples_held_out)
        return trial.chi2_fit <= 1 and not trial.chi2_held_out > 1  # (NaN without held-out data)


Selection = tuple[SelectedEffect, ...]
Stepping = Callable[[Experiment, Selection], Stage]
Calibrating = Callable[[Experiment], Stage]


def select_stepwise(experiment: Experiment, stepping: Stepping, say: Progress, most: int = MOST,
                    remaining_time: Callable[[], float] = lambda: inf, calibrating: Calibrating | None = None,
                    reviewing: Stepping | None = None) -> Iterator[tuple[Selection, Stage]]:
    """Yield the best selection so far of at most `most` effects, and the last step (with its chosen effect, or without one
    if no effect is justified). The last pair is the result.

    `stepping` makes a step on an experiment, given the selection so far, and `reviewing` (default: `stepping`) a step that
    searches an effect of the selection again. `calibrating` makes a step with calibration errors
    only. `remaining_time` returns the remaining time (s). A further step starts only if the remaining time is at least the
    share `BEGUN` of the time of the previous step. A step that runs out of time counts only if it reaches the noise. Pairs
    that are yielded before the end have a partial step. They are the result if the search is stopped early.
    """
    last = stepping(experiment, ())
    yield (), replace(last, chosen=None, cluster=(), partial=True)
    if last.chosen is not None and last.chosen.absent and not last.partial:
        # the step began at a wrong local minimum of the free parameters, unless the effect seems absent because another of
        # its numbers and a free parameter act alike
        moved = at_values_of(last.chosen, experiment)
        if fitted_base(moved).cost < last.cost - EARNED * max(1.0, last.cost / last.samples):
            last = stepping(moved, ())
    base, selections = last.merit, _extended((), last)
    yield (selections[0] if selections else ()), last
    pairs, joint = list[Selection](), tuple[Refit, ...]()
    if calibrating is not None and selections and not (last.partial or selections[0][-1].is_noise or most < 2):
        selections, pairs = _beside_calibration(last, selections, calibrating, remaining_time)
    for turn in range(2 * most):
        if not selections or len(selections[0]) >= most or last.partial \
                or selections[0][-1].is_noise or near_the_noise(selections[0]):
            break
        yield selections[0], replace(selections[0][-1].step, partial=True)
        steps: list[tuple[Stage, list[Selection]]] = []
        # Continue those that may still become the best. With an estimated noise this is the best one only, because an
        # estimated noise does not show whether the best selection is incomplete.
        noise_given, best = selections[0][-1].step.experiment.noise_given, min(map(_merit, selections))
        followed = set[str]()
        others = [s for s in selections[1:WAYS] if noise_given and base - _merit(s) > FOLLOWED * (base - best)]
        for selection in [selections[0], *others]:
            if remaining_time() < BEGUN * selection[-1].step.seconds:
                break
            stage = stepping(following(selection[-1].step), selection)
            steps.append((stage, _extended(selection, stage)))
            followed.add(selection[0].candidate.label)
            pair = _completed(selection, stage) if turn == 0 else ()
            pairs += [pair] if pair else []
            if stage.partial or any(extension[-1].is_noise for extension in steps[-1][1]):
                break
            if pair and len(steps) == 1:
                yield (_longer(steps, selections) or selections)[0], replace(stage, partial=True)
                joint = (*joint_refits(pair, say, remaining_time),
                         *parallel_refits(selection[0].step, say, remaining_time))
                # the other selections with this second effect leave more than noise, and this one does not
                if any(map(near_the_noise, steps[0][1])) and not any(map(_is_near_noise, joint)) and \
                        {s[0].candidate.label for s in others} <= {t.candidate.label for t in joint}:
                    break
        if turn == 0 and pairs:
            joint = best_pairs(pairs, joint)
            better = _of_better_pair(selections[0][0].step, joint, followed)
            if better and not steps[-1][0].partial and remaining_time() >= BEGUN * better[-1].step.seconds:
                stage = stepping(following(better[-1].step), better)
                steps.append((stage, _extended(better, stage)))
            selections = [_with_joint(selection, joint) for selection in selections]
            steps = [(stage, [_with_joint(selection, joint) for selection in extended]) for stage, extended in steps]
        cut = bool(steps) and steps[-1][0].partial and remaining_time() <= 0  # ended by the time limit, not by the user
        if cut and not any(extension[-1].is_noise for extension in steps[-1][1]):
            last = replace(steps.pop()[0], chosen=None, cluster=())  # its scores and refits are reported without a result
            if not steps:
                break
        elif not steps:
            last = selections[0][-1].step
            break
        longer = [_without_absent(extension) for extension in _longer(steps, selections)]
        selections = _distinct(sorted(longer, key=_merit)) if longer else sorted(selections, key=_merit)
        last = replace(selections[0][-1].step if longer else steps[0][0], partial=cut or steps[-1][0].partial)
        if not longer:
            break
        if not last.partial and remaining_time() > 0:
            for selection, partial in looked_back(selections[0], reviewing or stepping, say):
                last = replace(selection[-1].step, partial=partial)
                yield selection, last
            selections[0] = selection
    yield (selections[0] if selections else ()), last


def _longer(steps: Iterable[tuple[Stage, Sequence[Selection]]], selections: Sequence[Selection]) -> list[Selection]:
    """The extensions of `selections` by these steps whose last effect explains a noticeable part of the residual before it,
    and that are better than all of the selections."""
    return [extension for _, extended in steps for extension in extended
            if worth_it(extension[-1].step) and _merit(extension) < min(map(_merit, selections))]


def near_the_noise(selection: Selection) -> bool:
    """True if a selection of several effects has a residual near the noise; a further effect would be within the error of
    the noise. (A first effect alone is not sufficient, as a second one may show that the first is wrong.)"""
    return len(selection) > 1 and _is_near_noise(selection[-1].chosen)


def _is_near_noise(trial: Refit) -> bool:
    """True if the residual of a refit is near the noise."""
    return trial.chi2_fit <= DECISION.near and not trial.chi2_held_out > DECISION.near


def _extended(selection: Selection, stage: Stage) -> list[Selection]:
    """Selections that extend `selection` by one of the leading effects of the step `stage`."""
    return [(*selection, SelectedEffect(step, step.cluster, _labels(selection))) for step in leaders(stage, WAYS)]


def _without_absent(selection: Selection) -> Selection:
    """Remove the last effect of a selection if it is absent from the fitted model and the shorter selection is as good.

    The shorter selection is refitted from the values with the effect. It is as good if its `merit` is, or if its fit of the
    fitted records is as good and its residual is near the noise. (If a motion is sensitive to its initial state, two fits
    that the fitted records cannot distinguish may differ on other records by more than the merit allows.)
    """
    chosen = selection[-1].chosen
    if len(selection) < 2 or not chosen.absent:
        return selection
    before = selection[-2]
    refit = refitted_from(fitted_base(before.step.experiment), before.candidate, replace(chosen, candidate=before.candidate))
    shorter = selection[:-1] if refit is None else _with_last(selection[:-1], refit)
    trial = shorter[-1].chosen
    as_good = trial.bic < chosen.bic + DECISIVE and not max(trial.chi2_fit, trial.chi2_held_out) > DECISION.near
    return shorter if as_good or _merit(shorter) < _merit(selection) + DECISIVE else selection


def _beside_calibration(stage: Stage, selections: Sequence[Selection], calibrating: Calibrating,
                        remaining_time: Callable[[], float]) -> tuple[list[Selection], list[Selection]]:
    """Sort the selections of one effect by their merit after a calibration error was added.

    If the calibration error does not explain a noticeable part of the residual, the merit without it is used. The simplest
    law of a class and place is included if a calibration error explains a noticeable part of its residual. The second result
    lists pairs: each law with the calibration error that complements it best.
    """
    ranked = {selection[-1].candidate.label: (_merit(selection), selection) for selection in selections}
    pairs = []
    for step in leaders(stage, WAYS, simplest=True):
        if remaining_time() <= 0:
            break
        selection = (SelectedEffect(step, step.cluster),)
        beside = calibrating(following(step))
        pairs += [pair] if (pair := _completed(selection, beside)) else []
        if beside.chosen is not None and worth_it(beside):
            ranked[selection[-1].candidate.label] = merit(beside.chosen), selection
    return [selection for _, selection in sorted(ranked.values(), key=lambda pair: pair[0])], pairs


def _completed(selection: Selection, stage: Stage) -> Selection:
    """A selection extended by the effect of the step `stage` that predicts best, whether or not it is justified; empty if
    no further effect was refitted."""
    trials = [t for t in stage.trials if t.errors is not None]
    if not trials:
        return ()
    step = choosing(stage, min(trials, key=loss))
    return (*selection, SelectedEffect(step, step.cluster, _labels(selection)))


def joint_refits(pair: Selection, say: Progress, remaining_time: Callable[[], float]) -> tuple[Refit, ...]:
    """Refit the other leading laws of the first step, each together with the second effect of a `pair`. Each refit starts
    from the values of the law alone. Pairs in which the law is absent are left out, because they contain only the second
    effect."""
    law, second = (added.candidate for added in pair)
    first = pair[0].step
    laws = [t for t in leading_laws(first) if t.candidate.label not in (law.label, second.label)]
    without_law = without_effect(pair, 0, say) if laws and remaining_time() > 0 else None
    if without_law is None:
        return ()
    experiment = following(without_law[-1].step)
    try:
        base = fitted_base(experiment)
    except HeavebondError:
        return ()
    by_label = {c.label: c for rule in (candidates, between_all_nodes) for c in rule(experiment) if not c.acts_on([second])}
    refits = []
    for trial in (t for t in laws if t.candidate.label in by_label):
        if remaining_time() <= 0:
            break
        say(f"comparing the leading effects in pairs: {trial.candidate.label} and {second.label}")
        joint = refitted_from(base, by_label[trial.candidate.label], trial)
        refits += [replace(joint, lent=second.label)] if joint is not None and not joint.absent else []
    return tuple(refits)


def parallel_refits(first: Stage, say: Progress, remaining_time: Callable[[], float]) -> tuple[Refit, ...]:
    """Refit laws of other classes at the place of the chosen law of the first step in pairs without the chosen law.

    Two effects in parallel (dry friction and drag) may be imitated by one law between them (viscous damping), which leaves
    less than either of them alone. Such laws store energy only if the chosen law does.
    """
    assert first.chosen is not None
    chosen, library = first.chosen.candidate, first.experiment.model.library

    def energy(candidate: Candidate) -> tuple[bool, bool]:
        component = library.component(candidate.component)
        return component.stores is not None, component.dissipates is not None

    by_class: dict[str, Refit] = {}
    for trial in explaining_laws(first):
        if trial.candidate.kind != chosen.kind and set(trial.candidate.where) == set(chosen.where) \
                and energy(trial.candidate) == energy(chosen):
            by_class.setdefault(trial.candidate.kind, trial)
    laws, refits = [*by_class.values()][:WAYS], list[Refit]()
    for number_of_law, law in enumerate(laws[:-1], 1):
        experiment = following(choosing(first, law))
        by_label = {c.label: c for c in candidates(experiment) if not c.acts_on([law.candidate])}
        try:
            base = fitted_base(experiment)
        except HeavebondError:
            continue
        for second in (t for t in laws[number_of_law:] if t.candidate.label in by_label):
            if remaining_time() <= 0:
                return tuple(refits)
            say(f"comparing the leading effects in pairs: {law.candidate.label} and {second.candidate.label}")
            # the second law begins with a small amplitude, as the first one has nearly all of the effect
            neutral = {n.name: n.neutral for n in second.candidate.vanishing}
            values = {n.name: neutral[n.name] + LITTLE * (second.values[n.name] - neutral[n.name]) if n.name in neutral
                      else second.values[n.name] for n in second.candidate.numbers if n.name in second.values}
            pair = refitted_from(base, by_label[second.candidate.label], replace(second, values=values, own={}))
            if pair is not None and not pair.absent:
                refits.append(replace(pair, candidate=law.candidate, beyond=law.beyond, unshown=law.unshown,
                                      lent=second.candidate.label))
    return tuple(refits)


def _of_better_pair(first: Stage, joint: Sequence[Refit], followed: Iterable[str]) -> Selection:
    """The law of the pair that predicts best, as a selection of one effect, if its pair leaves materially less than those
    of the laws in `followed`; otherwise an empty selection."""
    least = min((loss(t) for t in joint if t.candidate.label in followed), default=inf)
    best = joint[0]
    if best.candidate.label in followed or not best.lent or loss(best) >= (1 - DECISION.material) * least:
        return ()
    step = choosing(first, next(t for t in first.trials if t.candidate.label == best.candidate.label))
    return (SelectedEffect(step, step.cluster),)


def explaining_laws(first: Stage) -> list[Refit]:
    """The refits of a step that explain much of the misfit, at least the share `FOLLOWED` of the misfit that the best
    refit explains; the best first."""
    assert first.errors is not None
    shares = [(share_taken(first.errors, t.errors, *ALL), t) for t in first.trials if t.errors is not None]
    least = FOLLOWED * max((share for share, _ in shares), default=0.0)
    return sorted((t for share, t in shares if share >= least), key=loss)


def leading_laws(first: Stage) -> list[Refit]:
    """The first `RIVALS` of the laws that explain much of the misfit."""
    return explaining_laws(first)[:RIVALS]


def best_pairs(pairs: Sequence[Selection], joint: Sequence[Refit]) -> tuple[Refit, ...]:
    """The leading laws of the first step, each in the pair with the further effect that predicts best, the best first.

    `pairs` are selections of two effects that begin with a law of this step, and `joint` other pairs (see `joint_refits`).
    If several effects are missing, the misfit of one law contains all others, and a law of a wrong class that imitates them
    has a smaller residual. In pairs, each law can be complemented in the same way. A law is complemented only by effects
    that have a larger residual than this law if each is refitted alone. The more important effect of a pair is therefore the
    first.
    """
    first = pairs[0][0].step
    best = {t.candidate.label: t for t in leading_laws(first)}
    alone = {t.candidate.label: loss(t) for t in first.trials if t.errors is not None}
    selected_pairs = [(replace(second.chosen, candidate=law.candidate, beyond=law.chosen.beyond, unshown=law.chosen.unshown),
                       second.candidate.label) for law, second in pairs]
    for pair, second in (*selected_pairs, *((t, t.lent) for t in joint)):
        label = pair.candidate.label
        before = best.get(label)
        if alone.get(second, inf) >= alone.get(label, inf) and (before is None or loss(pair) < loss(before)):
            best[label] = pair
    return tuple(sorted(best.values(), key=loss))


def _with_joint(selection: Selection, joint: tuple[Refit, ...]) -> Selection:
    """The selection with the pairs of the leading laws in its first step. Alternatives of its first effect that the pairs
    exclude are removed."""
    first, known = selection[0], {t.candidate.label: t for t in joint}
    alternatives, pair = first.alternatives, known.get(first.candidate.label)
    if pair is not None and first.step.errors is not None:
        other_pairs = [known[t.candidate.label] for t in alternatives[1:] if t.candidate.label in known]
        members = {t.candidate.label for t in compared(pair, other_pairs, first.step.errors).members}
        alternatives = tuple(t for t in alternatives if t.candidate.label not in known or t.candidate.label in members)
    return replace(first, step=replace(first.step, joint=joint), alternatives=alternatives), *selection[1:]


def _merit(selection: Selection) -> float:
    return merit(selection[-1].chosen)


def _distinct(selections: Sequence[Selection]) -> list[Selection]:
    """The selections without duplicates: the order of the effects does not matter."""
    distinct: dict[frozenset[str], Selection] = {}
    for selection in selections:
        distinct.setdefault(frozenset(added.candidate.label for added in selection), selection)
    return list(distinct.values())


def looked_back(selection: Selection, stepping: Stepping, say: Progress) -> Iterator[tuple[Selection, bool]]:
    """Review each effect of a selection. Yield the selection after each review, and whether some effects have not been
    reviewed yet.

    The review of an effect removes it if it is not needed together with the others, replaces it if another candidate is
    better, or determines its alternatives with all other effects in the diagram.
    """
    selection = _among(selection)
    while (k := next((k for k, added in enumerate(selection)
                      if added.beside != _labels_without(selection, k)), None)) is not None:
        yield selection, True
        say(f"is {selection[k].candidate.label} still needed?")
        changed = _asked_again(selection, k, stepping, say)
        if changed is None:
            return
        selection = _among(_in_order(changed, say))
    yield selection, False


def _asked_again(selection: Selection, k: int, stepping: Stepping, say: Progress) -> Selection | None:
    """The selection after its k-th effect was searched again with all others in the diagram; None if the search was
    stopped early."""
    remaining = without_effect(selection, k, say)
    if remaining is None:
        return _with(selection, k, selection[k].judged(selection[k].alternatives, _labels_without(selection, k)))
    # the refit of this diagram with the effect is known; the alternatives start from their refits without the others
    exact = replace(selection[-1].chosen, candidate=selection[k].candidate)
    again = stepping(following(remaining[-1].step) if remaining else selection[k].step.experiment, remaining)
    if again.partial:
        return None
    again = refitted_beside(again, selection[k].alternatives[1:], exact)
    if again.chosen is None or not worth_it(again):
        return remaining
    same = next((t for t in again.trials if t.candidate.label == selection[k].candidate.label), None)
    if same is not None and merit(same) < _merit(selection) - DECISIVE:  # a better local minimum of the known diagram
        selection = _with_last(selection, same)
    assert again.identity is not None
    excluded = not any(t is same for t in again.identity.members)  # an indistinguishable candidate does not replace it
    if excluded and merit(again.chosen) < _merit(selection) - DECISIVE:
        return _instead(selection, k, again, remaining, say)
    if same is not None and (law := simpler_law(again, same)) is not None:
        return _instead(selection, k, choosing(again, law), remaining, say)
    alike = choosing(again, same).cluster if same is not None else (selection[k].chosen, *again.cluster)
    return _with(selection, k, selection[k].judged(alike, _labels_without(selection, k), again))


def _instead(selection: Selection, k: int, again: Stage, remaining: Selection, say: Progress) -> Selection:
    """Replace the k-th effect by the effect chosen in the step `again`, which was made with all `remaining` in the diagram.
    If the new effect does not explain a noticeable part of the residual at the k-th position, it is appended to the
    others."""
    assert again.chosen is not None
    last = (*remaining, SelectedEffect(again, again.cluster, _labels(remaining)))
    if k == len(selection) - 1:
        return last
    label = again.chosen.candidate.label
    stage = _with_refit(selection[k].step, lambda candidate: candidate.label == label, say)
    refit = next((t for t in stage.trials if t.candidate.label == label), None)
    if refit is None:
        return last
    step = choosing(stage, refit)
    if not worth_it(step):
        return last
    continued = _continued((*selection[:k], SelectedEffect(step, step.cluster, _labels(selection[:k]))), selection, k, say)
    if continued is None:
        return last
    continued = _with_last(continued, again.chosen)
    alternatives = (continued[k].chosen, *again.cluster[1:])
    return _with(continued, k, continued[k].judged(alternatives, _labels_without(continued, k), again))


def _candidate(experiment: Experiment, wanted: Callable[[Candidate], bool]) -> Candidate | None:
    """The candidate of a diagram for which `wanted` is true."""
    return next((c for rule in (candidates, between_all_nodes) for c in rule(experiment) if wanted(c)), None)


def _with_refit(step: Stage, wanted: Callable[[Candidate], bool], say: Progress) -> Stage:
    """The step with a refit of the wanted candidate, which it may have left to the next step."""
    if any(wanted(t.candidate) for t in step.trials):
        return step
    candidate = _candidate(step.experiment, wanted)
    trials = single(step.experiment, candidate, say).trials if candidate is not None else ()
    return replace(step, trials=tuple(sorted((*step.trials, *trials), key=merit)))


def _in_order(selection: Selection, say: Progress) -> Selection:
    """Sort a selection: an effect that does not explain a noticeable part of the residual at its position is moved behind
    an effect with which it does."""
    original = selection
    for _ in selection[1:]:
        k = next((k for k, added in enumerate(selection[:-1]) if not worth_it(added.step)), None)
        if k is None:
            return selection
        reordered = _continued(selection[:k], (*selection, selection[k]), k, say)
        if reordered is None:
            break
        selection = _with_last(reordered, original[-1].chosen)
    return selection if worth_it(selection[0].step) else original


def _with(selection: Selection, k: int, added: SelectedEffect) -> Selection:
    return *selection[:k], added, *selection[k + 1:]


def _with_last(selection: Selection, better: Refit) -> Selection:
    """The selection with the values of the refit `better` of its last diagram, if their sum of squares is smaller."""
    last = selection[-1]
    trial = replace(better, candidate=last.candidate)
    if trial.cost >= last.chosen.cost or any(n.name not in trial.values for n in last.candidate.numbers
                                             if n.name in last.chosen.values):
        return selection
    trials = [trial, *(t for t in last.step.trials if t.candidate.label != last.candidate.label)]
    step = choosing(replace(last.step, trials=tuple(sorted(trials, key=merit))), trial)
    alternatives = step.cluster if last.beside is not None else (trial, *last.alternatives[1:])
    return _with(selection, len(selection) - 1, replace(last, step=step, alternatives=alternatives))


def _labels(selection: Selection) -> frozenset[str]:
    return frozenset(added.candidate.label for added in selection)


def _labels_without(selection: Selection, k: int) -> frozenset[str]:
    return _labels((*selection[:k], *selection[k + 1:]))


def _among(selection: Selection) -> Selection:
    """The selection in which each effect has its alternatives with all other effects in the diagram, if these are known."""
    return tuple(added.among(_labels_without(selection, k)) for k, added in enumerate(selection))


def without_effect(selection: Selection, k: int, say: Progress) -> Selection | None:
    """The selection without its k-th effect. The effects after it are refitted one after the other. None if one of them
    depends on the removed effect."""
    return _continued(selection[:k], selection, k, say)


def _continued(extended: Selection, original: Selection, k: int, say: Progress) -> Selection | None:
    """Extend the selection `extended` by the effects of `original` after the k-th one, refitted one after the other. None
    if one of them depends on the k-th effect."""
    for added in original[k + 1:]:
        wanted = partial(_is, wanted=added.candidate, removed=original[k].candidate)
        beside: frozenset[str] | None = frozenset()
        if not extended:  # the first step has already refitted most candidates
            step = _with_refit(original[0].step, wanted, say)
        else:
            experiment = following(extended[-1].step)
            candidate = _candidate(experiment, wanted)
            if candidate is None:
                return None
            step, beside = single(experiment, candidate, say), None
        if step.partial and extended:
            raise KeyboardInterrupt
        trial = next((t for t in step.trials if wanted(t.candidate)), None)
        if trial is None:
            return None
        step = choosing(step, trial)
        alternatives = step.cluster if beside is not None else (trial, *added.alternatives[1:])
        known = {} if added.beside is None else {added.beside: added.alternatives}
        extended = (*extended, SelectedEffect(step, alternatives, beside, {**added.former, **known}))
    return extended


def _is(candidate: Candidate, wanted: Candidate, removed: Candidate) -> bool:
    """True if `candidate` is the same effect as `wanted`, after the effect `removed` was removed from the diagram. An effect
    before the input of the removed effect (lag_inlet.u) is then before the input that this effect had replaced (inlet.u)."""
    former = {new: old for old, new in removed.change.moved.items()}
    place = (former.get(wanted.signal, wanted.signal), "") if wanted.signal else ("", wanted.place)
    return (candidate.component, candidate.attaches, candidate.signal, "" if candidate.signal else candidate.place) == \
        (wanted.component, wanted.attaches, *place)


@dataclass(frozen=True)
class Unsupported:
    """A further effect that is not certain, and the reason: its strength is not constant over the amplitude
    (`constancy`), or an identified `curve` in addition to an earlier effect explains most of the same part of the
    residual."""

    added: SelectedEffect
    constancy: Constancy | None = None
    curve: Refit | None = None

    @property
    def words(self) -> str:
        """The reason in a sentence."""
        step, chosen = self.added.step, self.added.chosen
        held = step.chi2_held_out == step.chi2_held_out  # (NaN without held-out data)
        before, after = (step.chi2_held_out, chosen.chi2_held_out) if held else (step.chi2_fit, chosen.chi2_fit)
        refused = f"{called(self.added.candidate)} lowers the reduced chi-square from {number(before, 3)} to " \
                  f"{number(after, 3)}, but is not certain: "
        if self.curve is not None:
            chi2_curve = self.curve.chi2_held_out if held else self.curve.chi2_fit
            return refused + f"another law {self.curve.candidate.place}, as an identified curve, explains most of that " \
                             f"as well ({number(chi2_curve, 3)})."
        assert self.constancy is not None
        low, high = min(self.constancy.strength), max(self.constancy.strength)
        return refused + "its strength is not the same at small and large motion " \
                         f"({number(low, 2)} to {number(high, 2)} times the fitted one where it may vary)."


def doubts(selection: Selection, say: Progress,
           curves: Callable[[Experiment, Callable[[Candidate], bool]], Stage] | None = None) -> list[Unsupported]:
    """The effects at the end of a selection that are not certain, in their order, with the reason for each.

    A further effect is compared with the residual before it, of which it must explain a noticeable share (`worth_it`). No
    law is exact. The residual may therefore be the error of an earlier law, and another law may imitate this error on all
    records of one kind. So a further effect that does not reach the noise is named only under two conditions:

    * Its strength is the same at small and at large motion.
    * No identified curve at the place of an earlier effect explains most of the same part of the residual.

    `curves` makes a step with the identified curves that satisfy a predicate. A further effect at the place of an earlier
    one is considered part of the law there. An effect that is not certain remains in the model, because the earlier effects
    were determined with it.
    """
    doubtful: list[Unsupported] = []
    while len(selection) > 1:
        last = selection[-1]
        step, chosen = last.step, last.chosen
        before = step.chi2_held_out if step.samples_held_out else step.chi2_fit
        # the residual with the effect is the given noise, and the residual without it is clearly larger
        if chosen.experiment.noise_given and leaves_noise(chosen) and before > DECISION.near:
            break
        at_earlier = _at_earlier_place(selection)
        if at_earlier(last.candidate):
            break
        say(f"is {last.candidate.label} the same at all amplitudes?")
        strength = _constancy(last)
        reason = Unsupported(last, constancy=strength) if strength is not None and strength.differs else None
        if reason is None and curves is not None:
            say(f"would another law of the earlier effects explain as much as {last.candidate.label}?")
            trials = curves(step.experiment, at_earlier).trials
            best = min((t for t in trials if t.errors is not None), key=loss, default=None)
            misfit = step.errors.mean(*ALL) if step.errors is not None else 0.0
            if best is not None and misfit - loss(best) > DECISION.mainly * (misfit - loss(chosen)):
                reason = Unsupported(last, curve=best)
        if reason is None:
            break
        doubtful.insert(0, reason)
        selection = selection[:-1]
    return doubtful


def _constancy(added: SelectedEffect) -> Constancy | None:
    """Constancy of an added effect in the model fitted with it; None if this model cannot be simulated."""
    try:
        return constancy(fitted_base(following(added.step)), added.candidate.numbers)
    except HeavebondError:
        return None


def _at_earlier_place(selection: Selection) -> Callable[[Candidate], bool]:
    """A predicate: true if a candidate of the last step is at the place of an effect before the last one."""
    step = selection[-1].step
    earlier = {Places.of(added.step.experiment, step.as_one).place(added.candidate) for added in selection[:-1]}
    return lambda candidate: step.places.place(candidate) in earlier
