"""Several effects at once: ladders that are followed side by side, and looked back on.

Where two effects are missing, the first step sees both: a flexible law at a wrong place may take more of the misfit than
either of them alone, and every further effect then mends what it does wrong. So

* as long as more than the given noise is left, not only the best first effect is followed but the best of a few classes and
  places, and of all ladders so begun the best few, until one reaches the noise;
* the laws that lead the first step are each refitted beside calibration errors (offsets and gains of inputs and channels),
  and followed in the order of what they leave then: a law that is right but for its instruments leaves little;
* beside all others that were found, each effect is taken out and sought anew among all candidates: one that is not missed
  stays out, one that another does better than gives its place to it, and what is not told from it is named anew. Where
  others are taken out, it has the alternatives again that it has without them;
* a further effect that is absent where its refit ends, but leaves less, has led the values out of a wrong valley of the
  diagram without it: this diagram is refitted from there, and the effect is left out.

This is selection forwards with steps back, after P. Pudil, J. Novovicova and J. Kittler (1994, doi
10.1016/0167-8655(94)90127-9), by `merit` in place of their criterion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf

from heavebond.core.cancellation import clear_signal
from heavebond.core.progress import Progress
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.like_places import candidates
from heavebond.diagnosis.refit import Refit, refitted_from
from heavebond.diagnosis.residual_tests import is_noise
from heavebond.diagnosis.stage import (
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
)
from heavebond.diagnosis.verdict import worth_it
from heavebond.estimation.experiment import Experiment

MOST = 5  # effects
WAYS = 3  # ladders that are followed side by side,
FOLLOWED = 0.5  # those that take this share of what the best takes away
BEGUN = 0.5  # share of the time of a step that must be left for the next, which begins near its end and may reach the noise
DECISIVE = 10.0  # what another effect must be better by to take the place of one that was found (as in `rung.indistinct`)


@dataclass(frozen=True)
class SelectedEffect:
    """An effect on a ladder: the step at which it was chosen, and what the records cannot tell from it beside the effects
    `beside` (their labels; None: it was not asked for yet); `former` are its alternatives beside others, as far as these
    were asked for."""

    step: Stage
    alternatives: tuple[Refit, ...]
    beside: frozenset[str] | None = frozenset()
    former: Mapping[frozenset[str], tuple[Refit, ...]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def chosen(self) -> Refit:
        """The effect refitted."""
        assert self.step.chosen is not None
        return self.step.chosen

    @property
    def candidate(self) -> Candidate:
        """What was added."""
        return self.chosen.candidate

    def judged(self, alternatives: tuple[Refit, ...], beside: frozenset[str]) -> SelectedEffect:
        """The same with what the records cannot tell from it beside other effects."""
        known = {} if self.beside is None else {self.beside: self.alternatives}
        return replace(self, alternatives=alternatives, beside=beside, former={**self.former, **known})

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
                    ) -> tuple[Selection, Stage]:
    """The ladder of at most `most` effects that leaves least, and the last step that was made from its last rung (with the
    chosen effect on it, or with none that is worth it); `stepping` makes a step on an experiment, the ladder that leads
    there given, and `calibrating` one of calibration errors alone. A further step begins only where `BEGUN` of the time that
    the step before took is `left` (s), and one that the time cuts short counts only where it reaches the noise."""
    last = stepping(experiment, ())
    if last.chosen is not None and last.chosen.absent and not last.partial:  # what is free was fitted into a wrong valley
        last = stepping(at_values_of(last.chosen, experiment), ())
    base, ways = last.merit, _extended((), last)
    if calibrating is not None and ways and not (last.partial or ways[0][-1].is_noise or most < 2):
        ways = _beside_calibration(last, ways, calibrating, left)
    for _ in range(2 * most):
        if not ways or len(ways[0]) >= most or last.partial or ways[0][-1].is_noise or within_the_error(ways[0]):
            break
        steps: list[tuple[Stage, list[Selection]]] = []
        for way in _promising(ways, base):
            if left() < BEGUN * way[-1].step.seconds:
                break
            try:
                made = stepping(following(way[-1].step), way)
            except KeyboardInterrupt:
                clear_signal()
                return ways[0], replace(ways[0][-1].step, partial=True)
            steps.append((made, _extended(way, made)))
            if made.partial or any(found[-1].is_noise for found in steps[-1][1]):
                break
        cut = bool(steps) and steps[-1][0].partial and left() <= 0  # by the time, not by the user
        if not steps or (cut and not any(found[-1].is_noise for found in steps[-1][1])):
            last = ways[0][-1].step
            break
        longer = [found for _, extended in steps for found in extended
                  if worth_it(found[-1].step) and _merit(found) < min(map(_merit, ways))]
        longer = [_without_absent(found) for found in longer]
        if not longer:
            ways = sorted(ways, key=_merit)
        if longer:
            ways = _distinct(sorted(longer, key=_merit))
        last = replace(ways[0][-1].step if longer else steps[0][0], partial=steps[-1][0].partial)
        if not longer:
            break
        if not last.partial and left() > 0:
            ways[0], partial = looked_back(ways[0], stepping, say)
            last = replace(ways[0][-1].step, partial=partial)
    return (ways[0] if ways else ()), last


def within_the_error(way: Selection) -> bool:
    """Whether several effects leave less than the share of the first misfit that a further one must take to be named (see
    `further_effects.supported`), and no more than is near the noise where that is given: beyond it, one that reaches it is
    named too. After the first, a second may show that it is wrong."""
    first, last = way[0].step, way[-1].chosen
    if len(way) < 2:
        return False
    fitted = last.chi2_fit < DECISION.material * (first.chi2_fit - 1.0)
    held = last.chi2_held_out < DECISION.material * (first.chi2_held_out - 1.0)  # (NaN where nothing is held out)
    near = last.chi2_fit <= DECISION.near and not last.chi2_held_out > DECISION.near
    if last.experiment.noise_given:
        return near and fitted and (held or not last.samples_held_out)
    return held or (fitted and (last.chi2_fit > DECISION.near or not last.samples_held_out))


def _extended(way: Selection, made: Stage) -> list[Selection]:
    """A ladder with each of the effects that lead a step from it."""
    return [(*way, SelectedEffect(step, step.cluster, _labels(way))) for step in leaders(made, WAYS)]


def _without_absent(way: Selection) -> Selection:
    """The ladder without its last effect where this is absent and the ladder without it does as well from the values found
    beside it."""
    chosen = way[-1].chosen
    if len(way) < 2 or not chosen.absent:
        return way
    before = way[-2]
    found = refitted_from(fitted_base(before.step.experiment), before.candidate, replace(chosen, candidate=before.candidate))
    shorter = way[:-1] if found is None else _with_last(way[:-1], found)
    return shorter if _merit(shorter) < _merit(way) + DECISIVE else way


def _beside_calibration(made: Stage, ways: Sequence[Selection], calibrating: Calibrating, left: Callable[[], float]
                        ) -> list[Selection]:
    """The ladders of one effect in the order of what is left beside a calibration error, where that takes a noticeable part
    of it; those of the simplest law of a class and place stand among them where it leads beside one."""
    found = {_label(way): (_merit(way), way) for way in ways}
    for step in leaders(made, WAYS, simplest=True):
        if left() <= 0:
            break
        way = (SelectedEffect(step, step.cluster),)
        try:
            beside = calibrating(following(step))
        except KeyboardInterrupt:
            clear_signal()
            break
        if beside.chosen is not None and worth_it(beside):
            found[_label(way)] = merit(beside.chosen), way
    return [way for _, way in sorted(found.values(), key=lambda pair: pair[0])]


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


def looked_back(way: Selection, stepping: Stepping, say: Progress) -> tuple[Selection, bool]:
    """The ladder without what is not missed beside the others, with what is better in its place, and each effect with what
    cannot be told from it beside all others; and whether the search was ended before all of it was looked at."""
    way = _among(way)
    while (k := next((k for k, added in enumerate(way) if added.beside != _others(way, k)), None)) is not None:
        say(f"is {way[k].candidate.label} still needed?")
        try:
            changed = _asked_again(way, k, stepping, say)
            if changed is None:
                return way, True
            way = _among(_in_order(changed, say))
        except KeyboardInterrupt:
            clear_signal()
            return way, True
    return way, False


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
    return _with(way, k, way[k].judged(alike, _others(way, k)))


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
    return _with(found, k, found[k].judged((found[k].chosen, *again.cluster[1:]), _others(found, k)))


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
            there = next((c for c in candidates(now) if _is(c, wanted, gone)), None)
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
