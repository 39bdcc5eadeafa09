"""Which candidates are refitted, in what order, and how far each refit is followed.

A score names class and place rather than the law, and costs a run; a refit costs some twenty. So those with the largest
scores go first. Every refit is begun by a few steps, and at first only those that may still come near the best are followed
further: all of them only where none of these comes near the noise.
"""

from __future__ import annotations

import time as clock
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from heavebond.core.progress import Progress
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.refit_starts import HOPE
from heavebond.diagnosis.search.scoring import Score
from heavebond.diagnosis.search.workers import Workers

FIRST = 6  # candidates are begun before the others, which are given up early beside the best of them
REFITS = 24  # at least so many candidates are refitted, those with the largest scores
PROMISING = 0.1  # and where one of a class at a place has a gain of this share of the largest, all there
AT_LEAST = 0.01  # that have this share of it
BEGINNING = 2 / 3  # share of the time after which no refit is begun, so that the promising ones can be followed
TWINS = 1 - 5e-8  # candidates whose directions agree to this are the same machine,
ALIKE = 1e-3  # their gains and shapes to this share,
JOINED = 0.02  # and to this one where they are the same law at nodes that move as one

Job = tuple[Candidate, list[Score]]  # to be refitted


@dataclass
class RefitSchedule:
    """The refits of a step as far as they have come, by the labels of their candidates; `failed` are the labels of those
    that could not be simulated. `explains`: whether a refit takes away so much of the misfit that a further step is made
    before more candidates are refitted."""

    workers: Workers
    say: Progress
    explains: Callable[[Refit], bool] = lambda trial: False
    trials: dict[str, Refit] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)

    def make(self, leading: Sequence[Job], rest: Sequence[Job], until: float) -> bool:
        """Refit the leading candidates, and the rest if none of these comes near the noise, `until` a time of
        `time.perf_counter`. Return whether all that concerns the leading candidates was done.

        Candidates with the largest scores are first: compared with the best of them, the others are soon seen to leave
        more. If one of the first `REFITS` explains the misfit, but more than noise is left, other effects are missing as
        well. The remaining candidates are then not refitted: the next step scores them on the residual, and each effect is
        sought again among all candidates in the presence of the others.
        """
        guesses = {c.label: g for c, g in (*leading, *rest)}
        now = clock.perf_counter()
        last, whole = now + BEGINNING * (until - now), True
        for begin, end in ((0, FIRST), (FIRST, REFITS), (REFITS, len(leading))):
            if begin == REFITS and self.explained:
                break
            jobs = leading[begin:end]
            whole &= self._begin(jobs, "", last)
            self._follow(_hopeful(self.trials.values()), guesses, until)
        if unexplained(self.trials.values()) and not self.explained:
            self._begin(rest, " others", last)
            self._follow(_hopeful(self.trials.values()), guesses, until)
        if unexplained(self.trials.values()) and not self.explained:
            self._follow(self.trials.values(), guesses, until)
            whole &= not any(self.trials[c.label].begun for c, _ in leading if c.label in self.trials)
        return whole

    @property
    def explained(self) -> bool:
        """Whether more than noise is left, and one of the refits takes away most of the misfit."""
        return unexplained(self.trials.values()) and any(map(self.explains, self.trials.values()))

    def _begin(self, jobs: Sequence[Job], others: str, until: float) -> bool:
        """Whether all of them were begun."""
        done = 0
        least = min((trial.cost for trial in self.trials.values()), default=0.0)
        for done, (candidate, trial) in enumerate(self.workers.begin(jobs, least, until), 1):
            if trial is not None:
                self.trials[candidate.label] = trial
            elif candidate.label not in self.workers.lost:
                self.failed.append(candidate.label)
            self.say(f"refitting {done} of {len(jobs)}{others}: {candidate.label}"
                     + (f" leaves {trial.chi2_held_out:.4g}" if trial else " cannot be simulated") + self._best())
        return done == len(jobs)

    def _follow(self, trials: Iterable[Refit], guesses: Mapping[str, Sequence[Score]], until: float) -> None:
        """Follow those that were only begun, best first."""
        open_ = sorted((t for t in trials if t.begun), key=lambda t: t.cost)
        jobs = [(t, guesses[t.candidate.label]) for t in open_]
        for done, (candidate, trial) in enumerate(self.workers.follow(jobs, until), 1):
            self.trials[candidate.label] = trial
            self.say(f"refitting {done} of {len(jobs)} further: {candidate.label} leaves {trial.chi2_held_out:.4g}"
                     f"{self._best()}")

    def _best(self) -> str:
        """The best refit so far, for the progress text."""
        best = min(self.trials.values(), key=lambda t: t.cost, default=None)
        return f", best so far {best.candidate.label} with chi-square {best.chi2_held_out:.4g}" if best is not None else ""


def _hopeful(trials: Iterable[Refit]) -> list[Refit]:
    """Those that may still come near the best."""
    found = list(trials)
    least = min((t.cost for t in found), default=0.0)
    return [t for t in found if t.cost <= HOPE * least or t.falls]


def unexplained(trials: Iterable[Refit]) -> bool:
    """Whether none of them comes near the noise: then the score, which is local, may have misled. A free parameter that the
    missing effect has moved far away turns the sign of the tangent."""
    return all(max(t.chi2_fit, t.chi2_held_out if t.samples_held_out else 0.0) > DECISION.near for t in trials)


def planned(scores: Sequence[Score], as_one: Mapping[str, str]
            ) -> tuple[list[Job], list[Job], dict[str, tuple[str, ...]]]:
    """What is refitted first, what after that, and which candidates are the same as one of them. After a strong misfit a
    score names class and place rather than the law: all laws of one class at one place come together, the largest gain of
    any of them first."""
    families: dict[object, float] = {}
    for score in scores:
        families[_family(score)] = max(score.gain, families.get(_family(score), 0.0))
    by_label: dict[str, list[Score]] = {}
    for score in sorted(scores, key=lambda s: (-families[_family(s)], -s.gain)):
        if score.told_apart:
            by_label.setdefault(score.candidate.label, []).append(score)
    place = {label: k for k, label in enumerate(dict.fromkeys(s.candidate.label for s in scores))}
    kept: list[list[Score]] = []
    twins: dict[str, tuple[str, ...]] = {}
    for label, group in by_label.items():
        k = next((k for k, other in enumerate(kept) if _same(other, group, as_one)), None)
        if k is None:
            kept.append(group)
            continue
        # of the same machine twice the one stands that comes first in the catalogue: a part's own dormant effect
        other = kept[k][0].candidate.label
        first, second = sorted((other, label), key=place.__getitem__)
        kept[k] = group if first == label else kept[k]
        twins[first] = (*twins.pop(other, ()), second)
    largest = kept[0][0].gain if kept else 0.0
    leading: list[Job] = []
    rest: list[Job] = []
    for k, group in enumerate(kept):
        promising = families[_family(group[0])] >= PROMISING * largest and group[0].gain >= AT_LEAST * largest
        (leading if k < REFITS or promising else rest).append((group[0].candidate, group))
    return _in_turn(leading), _in_turn(rest), twins


def _in_turn(jobs: Sequence[Job]) -> list[Job]:
    """The first of each class, then the second, ...: where time is short every class has had its turn, however many laws
    and places another one has that promise a little more."""
    before: Counter[str] = Counter()
    turns = []
    for candidate, _ in jobs:
        turns.append(before[candidate.kind])
        before[candidate.kind] += 1
    return [job for _, job in sorted(zip(turns, jobs, strict=True), key=lambda pair: pair[0])]


def _family(score: Score) -> tuple[str, frozenset[str]]:
    """Class and place."""
    return score.candidate.kind, frozenset(score.candidate.where)


def _same(one: Sequence[Score], other: Sequence[Score], as_one: Mapping[str, str]) -> bool:
    """Whether two candidates move all channels in the same proportion at all shapes: one law at places that act alike.
    Where its nodes move as one it is the same machine, and only what a channel measures inside of what joins them could tell
    them apart; steps over kinks make some directions rough, so that there the clearest decides. (A lag of an input and of a
    channel stand at no node, and differ by their initial states.)"""
    a, b = one[0].candidate, other[0].candidate
    if a.vanishes != b.vanishes or len(one) != len(other) or len(a.numbers) != len(b.numbers):
        return False
    pairs = list(zip(sorted(one, key=_shapes), sorted(other, key=_shapes), strict=True))
    if a.component == b.component and _nodes(a, as_one) == _nodes(b, as_one) != []:
        return _alike(*max(pairs, key=lambda pair: min(s.gain for s in pair)), JOINED, 1 - JOINED)
    return all(_alike(s, t, ALIKE, TWINS) for s, t in pairs)


def _alike(one: Score, other: Score, share: float, cosine: float) -> bool:
    """Whether two scores are the same to this share, and their directions to this cosine."""
    shapes, others = _shapes(one)[0], _shapes(other)[0]
    # one of them may be allowed in the other direction only
    return len(shapes) == len(others) and np.allclose(shapes, others, rtol=share) and \
        abs(one.gain - other.gain) <= share * max(one.gain, other.gain) and \
        abs(float(one.direction @ other.direction)) > cosine


def _nodes(candidate: Candidate, as_one: Mapping[str, str]) -> list[str]:
    """The nodes that a candidate is put on, those that move as one by one name."""
    return [as_one.get(node, node) for node in candidate.change.nodes]


def _shapes(score: Score) -> tuple[list[float], int, int]:
    """The choice of shapes and amplitudes and the side at which it was taken."""
    return list(score.shapes.values()), len(score.along), score.side


def beyond_their_members(scores: Sequence[Score]) -> list[Score]:
    """The scores without those of laws at several places that promise less than the law does at one of these on average.

    With the effect at all of them the residual is along the sum of the members' directions, whose score is then the largest
    of all as far as the tangent holds; with the effect at one of two unlike directions it is the average.
    """
    best: dict[str, float] = {}
    for score in scores:
        best[score.candidate.label] = max(score.gain, best.get(score.candidate.label, 0.0))
    return [s for s in scores if not s.candidate.members or best[s.candidate.label] >=
            sum(best.get(member, 0.0) for member in s.candidate.members) / len(s.candidate.members)]
