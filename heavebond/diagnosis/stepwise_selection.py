"""Several effects at once: ladders that are followed side by side, and looked back on.

Where two effects are missing, the first step sees both: a flexible law at a wrong place may take more of the misfit than
either of them alone, and every further effect then mends what it does wrong. So

* as long as more than the given noise is left, not only the best first effect is followed but the best of a few classes and
  places, and of all ladders so begun the best few, until one reaches the noise;
* the laws that lead the first step are each refitted beside calibration errors (offsets and gains of inputs and channels),
  and followed in the order of what they leave then: a law that is right but for its instruments leaves little;
* beside what was found later, each earlier effect is taken out and sought anew among all candidates: one that is not missed
  stays out, one that another does better than gives its place to it, and what is not told from it is named anew.

This is selection forwards with steps back, after P. Pudil, J. Novovicova and J. Kittler (1994, doi
10.1016/0167-8655(94)90127-9), by `merit` in place of their criterion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

from heavebond.core.cancellation import clear_signal
from heavebond.core.progress import Progress
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.like_places import candidates
from heavebond.diagnosis.refit import Refit
from heavebond.diagnosis.residual_tests import is_noise
from heavebond.diagnosis.stage import Stage, choosing, following, leaders, merit, refitted_beside, simpler_law, single
from heavebond.diagnosis.verdict import worth_it
from heavebond.estimation.experiment import Experiment

MOST = 5  # effects
WAYS = 3  # ladders that are followed side by side,
FOLLOWED = 0.5  # those that take this share of what the best takes away
DECISIVE = 10.0  # what another effect must be better by to take the place of one that was found (as in `rung.indistinct`)


@dataclass(frozen=True)
class SelectedEffect:
    """An effect on a ladder: the step at which it was chosen, and what the records cannot tell from it beside all others."""

    step: Stage
    alternatives: tuple[Refit, ...]

    @property
    def chosen(self) -> Refit:
        """The effect refitted."""
        assert self.step.chosen is not None
        return self.step.chosen

    @property
    def candidate(self) -> Candidate:
        """What was added."""
        return self.chosen.candidate

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
    there given, and `calibrating` one of calibration errors alone. A further step begins only where as much time is `left`
    (s) as the step before took, and one that the time cuts short counts only where it reaches the noise."""
    last = stepping(experiment, ())
    base, ways = last.merit, _extended((), last)
    if calibrating is not None and ways and not (last.partial or ways[0][-1].is_noise or most < 2):
        ways = _beside_calibration(last, ways, calibrating, left)
    for _ in range(2 * most):
        if not ways or len(ways[0]) >= most or last.partial or ways[0][-1].is_noise:
            break
        steps = []
        for way in _promising(ways, base):
            if left() < way[-1].step.seconds:
                break
            try:
                steps.append((way, stepping(following(way[-1].step), way)))
            except KeyboardInterrupt:
                clear_signal()
                return ways[0], replace(ways[0][-1].step, partial=True)
            if steps[-1][1].partial or any(longer[-1].is_noise for longer in _extended(*steps[-1])):
                break
        cut = bool(steps) and steps[-1][1].partial and left() <= 0  # by the time, not by the user
        if not steps or (cut and not any(longer[-1].is_noise for longer in _extended(*steps[-1]))):
            last = ways[0][-1].step
            break
        longer = [found for way, made in steps for found in _extended(way, made)
                  if worth_it(found[-1].step) and _merit(found) < min(map(_merit, ways))]
        if not longer:
            ways = sorted(ways, key=_merit)
        if longer:
            ways = _distinct(sorted(longer, key=_merit))
        last = replace(ways[0][-1].step if longer else steps[0][1], partial=steps[-1][1].partial)
        if not longer:
            break
        if not last.partial and left() > 0:
            ways[0], partial = _looked_back(ways[0], stepping, say)
            last = replace(ways[0][-1].step, partial=partial)
    return (ways[0] if ways else ()), last


def _extended(way: Selection, made: Stage) -> list[Selection]:
    """A ladder with each of the effects that lead a step from it."""
    return [(*way, SelectedEffect(step, step.cluster)) for step in leaders(made, WAYS)]


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


def _looked_back(way: Selection, stepping: Stepping, say: Progress) -> tuple[Selection, bool]:
    """The ladder without what is not missed beside the effects found later, and with what is better in its place; and
    whether the search was ended before all of it was looked at."""
    k = 0
    while k < len(way) - 1:
        say(f"is {way[k].candidate.label} still needed?")
        try:
            others = without_effect(way, k, say)
        except KeyboardInterrupt:
            clear_signal()
            return way, True
        if others is None:
            k += 1
            continue
        # this very diagram is known already with the effect, and its rivals begin from what they were without the others
        exact = replace(way[-1].chosen, candidate=way[k].candidate)
        try:
            again = stepping(following(others[-1].step), others)
            again = again if again.partial else refitted_beside(again, way[k].alternatives[1:], exact)
        except KeyboardInterrupt:
            clear_signal()
            return way, True
        if again.partial:
            return way, True
        if again.chosen is None or not worth_it(again):
            way, k = others, 0
        elif merit(again.chosen) < _merit(way) - DECISIVE:
            way, k = (*others, SelectedEffect(again, again.cluster)), 0
        else:
            same = next((t for t in again.trials if t.candidate.label == way[k].candidate.label), None)
            if same is not None and (law := simpler_law(again, same)) is not None:
                step = choosing(again, law)
                way, k = (*others, SelectedEffect(step, step.cluster)), 0
                continue
            alike = choosing(again, same).cluster if same is not None else (way[k].chosen, *again.cluster)
            way, k = (*way[:k], replace(way[k], alternatives=alike), *way[k + 1:]), k + 1
    return way, False


def without_effect(way: Selection, k: int, say: Progress) -> Selection | None:
    """The ladder without its k-th effect, what followed refitted one after the other; None where that stands upon it."""
    found = way[:k]
    for added in way[k + 1:]:
        step = way[0].step if not found else None  # the first has tried nearly everything already
        wanted, gone = added.candidate, way[k].candidate
        if step is None or not any(_is(t.candidate, wanted, gone) for t in step.trials):
            now = following(found[-1].step) if found else way[0].step.experiment
            there = next((c for c in candidates(now) if _is(c, wanted, gone)), None)
            if there is None:
                return None
            step = single(now, there, say)
        if step.partial and found:
            raise KeyboardInterrupt
        trial = next((t for t in step.trials if _is(t.candidate, wanted, gone)), None)
        if trial is None:
            return None
        step = choosing(step, trial)
        found = (*found, SelectedEffect(step, step.cluster))
    return found


def _is(candidate: Candidate, wanted: Candidate, gone: Candidate) -> bool:
    """Whether a candidate is the one that is wanted, in a diagram without the effect that is gone: what stood before that
    effect's input (lag_inlet.u) stands before the input that this one took over (inlet.u)."""
    former = {new: old for old, new in gone.change.moved.items()}
    place = (former.get(wanted.signal, wanted.signal), "") if wanted.signal else ("", wanted.place)
    return (candidate.component, candidate.attaches, candidate.signal, "" if candidate.signal else candidate.place) == \
        (wanted.component, wanted.attaches, *place)
