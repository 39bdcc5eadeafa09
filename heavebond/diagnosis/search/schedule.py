"""Selection, order and depth of the refits of a step.

A score identifies class and place of an effect rather than its law, and costs about one run; a refit costs about twenty
runs. Candidates with the largest scores are therefore refitted first. Each refit starts with a few steps. Only the refits
that may still come near the best one are then continued. All refits are continued only if none of these comes near the
noise.
"""

from __future__ import annotations

import time as clock
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

import numpy as np

from heavebond.core.progress import Progress
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.search.refit import Refit
from heavebond.diagnosis.search.refit_starts import HOPE
from heavebond.diagnosis.search.scoring import Score
from heavebond.diagnosis.search.workers import Workers

FIRST = 6  # number of candidates that are started first; others are ended early if they are much worse
REFITS = 24  # minimum number of refitted candidates, those with the largest scores
PROMISING = 0.1  # if one law of a class at a place reaches this share of the largest gain, all laws there
AT_LEAST = 0.01  # that reach this share of it are refitted, too
# After the first step, at least FIRST candidates are refitted, and the others only if a law of their class at their place
# has a gain of this share of the misfit: a further effect must explain `DECISION.further` of it
NEEDED = DECISION.further / 4
FAR = DECISION.mainly / 2  # share of what the best refit explains below which a refit is inferior after its first steps
BEGINNING = 2 / 3  # share of the time after which no refit is started, so that promising ones can be continued
TWINS = 1 - 5e-8  # candidates are equivalent if the cosine of their directions exceeds this,
ALIKE = 1e-3  # and their gains and shapes agree to this share,
JOINED = 0.02  # or to this share for the same law at nodes that move together

Job = tuple[Candidate, list[Score]]  # a candidate that will be refitted, with its scores
Key = TypeVar("Key", bound=Hashable)


class Scored(Protocol):
    """A score or a prescore."""

    @property
    def candidate(self) -> Candidate:
        """What is scored."""

    @property
    def gain(self) -> float:
        """The reduction of chi-square to first order."""


@dataclass
class RefitSchedule:
    """The refits of a step so far, by the labels of their candidates. `failed` lists the labels of candidates with which
    the diagram could not be simulated, and `postponed` those of promising candidates that are left to a further step.
    `explains` is a predicate: true if a refit explains so much of the misfit that a
    further step is made before more candidates are refitted. If `whole`, the sum of squares without candidates, is given,
    inferior refits are not continued."""

    workers: Workers
    say: Progress
    explains: Callable[[Refit], bool] = lambda trial: False
    trials: dict[str, Refit] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    postponed: list[str] = field(default_factory=list)
    whole: float = 0.0

    def make(self, leading: Sequence[Job], remaining: Callable[[], Sequence[Job]], until: float) -> bool:
        """Refit the leading candidates. If none of them comes near the noise, refit the `remaining` ones as well, which are
        determined then.

        Candidates with the largest scores are refitted first: compared with the best of them, inferior candidates are
        recognised after a few steps. If one of the first `REFITS` candidates explains most of the misfit, but its residual
        is more than noise, other effects are missing as well. The remaining candidates are then not refitted, because the
        next step scores them on the residual, and each effect is searched again with the others in the diagram. `until` is a
        time of `time.perf_counter`. The result is true if all planned refits of the leading candidates were completed.
        """
        guesses = {c.label: g for c, g in leading}
        start = clock.perf_counter()
        last, whole = start + BEGINNING * (until - start), True
        for begin, end in ((0, FIRST), (FIRST, REFITS), (REFITS, len(leading))):
            if begin == REFITS and self.explained:
                self.postponed += [candidate.label for candidate, _ in leading[begin:]]
                break
            jobs = leading[begin:end]
            whole &= self._begin(jobs, "", last)
            self._follow(self._hopeful(), guesses, until)
        if unexplained(self.trials.values()) and not self.explained:
            others = remaining()
            guesses |= {c.label: g for c, g in others}
            self._begin(others, " others", last)
            self._follow(self._hopeful(), guesses, until)
        if unexplained(self.trials.values()) and not self.explained:
            self._follow([t for t in self.trials.values() if not self._is_inferior(t)], guesses, until)
            whole &= not any(self.trials[c.label].begun and not self._is_inferior(self.trials[c.label])
                             for c, _ in leading if c.label in self.trials)
        return whole

    def _hopeful(self) -> list[Refit]:
        """The refits that may still come near the best one."""
        least = min((t.cost for t in self.trials.values()), default=0.0)
        return [t for t in self.trials.values() if (t.cost <= HOPE * least or t.falls) and not self._is_inferior(t)]

    @property
    def _most(self) -> float:
        """The sum of squares of a refit that explains the share `FAR` of what the best refit explains; infinite if the best
        one explains too little for a further effect."""
        best = self.whole - min((t.cost for t in self.trials.values()), default=np.inf)
        return self.whole - FAR * best if best >= DECISION.further * self.whole > 0 else np.inf

    def _is_inferior(self, trial: Refit) -> bool:
        """True if a refit explains much less than the best one, and its first steps did not fall steeply."""
        return not trial.falls and trial.cost > self._most

    @property
    def explained(self) -> bool:
        """True if no refit comes near the noise, but one of them explains most of the misfit."""
        return unexplained(self.trials.values()) and any(map(self.explains, self.trials.values()))

    def _begin(self, jobs: Sequence[Job], suffix: str, until: float) -> bool:
        """Make the first steps of these refits; true if all of them were started in time."""
        count = 0
        least = min((trial.cost for trial in self.trials.values()), default=0.0)
        for count, (candidate, trial) in enumerate(self.workers.begin(jobs, least, until, self._most), 1):
            if trial is not None:
                self.trials[candidate.label] = trial
            elif candidate.label not in self.workers.lost:
                self.failed.append(candidate.label)
            self.say(f"refitting {count} of {len(jobs)}{suffix}: {candidate.label}"
                     + (f" leaves chi-square {trial.chi2_held_out:.4g}" if trial else " cannot be simulated") + self._best())
        return count == len(jobs)

    def _follow(self, trials: Iterable[Refit], guesses: Mapping[str, Sequence[Score]], until: float) -> None:
        """Continue the refits that have made only their first steps, the best first."""
        open_ = sorted((t for t in trials if t.begun), key=lambda t: t.cost)
        jobs = [(t, guesses[t.candidate.label]) for t in open_]
        for count, (candidate, trial) in enumerate(self.workers.follow(jobs, until), 1):
            self.trials[candidate.label] = trial
            self.say(f"refitting {count} of {len(jobs)} further: {candidate.label} leaves chi-square "
                     f"{trial.chi2_held_out:.4g}{self._best()}")

    def _best(self) -> str:
        """The best refit so far, for the progress text."""
        best = min(self.trials.values(), key=lambda t: t.cost, default=None)
        return f", best so far {best.candidate.label} with chi-square {best.chi2_held_out:.4g}" if best is not None else ""


def unexplained(trials: Iterable[Refit]) -> bool:
    """True if no refit comes near the noise. In this case the scores may be misleading, as they are local: if the missing
    effect has moved a free parameter far from its true value, the tangent can have the wrong sign."""
    return all(max(t.chi2_fit, t.chi2_held_out if t.samples_held_out else 0.0) > DECISION.near for t in trials)


def planned(scores: Sequence[Score], as_one: Mapping[str, str], needed: float = 0.0
            ) -> tuple[list[Job], list[Job], dict[str, tuple[str, ...]]]:
    """Divide the candidates into those that are refitted first and the rest, and find equivalent candidates. If a gain is
    `needed`, all but the first `FIRST` candidates are only refitted first if their class reaches it at their place.

    After a strong misfit a score identifies class and place rather than the law. All laws of one class at one place are
    therefore sorted by the largest gain of any of them. The third result maps the label of a candidate to the labels of
    candidates that are equivalent to it; these are not refitted.
    """
    families = largest_gains(scores, family)
    by_label: dict[str, list[Score]] = {}
    for score in sorted(scores, key=lambda s: (-families[family(s.candidate)], -s.gain)):
        if score.told_apart:
            by_label.setdefault(score.candidate.label, []).append(score)
    place = {label: k for k, label in enumerate(dict.fromkeys(s.candidate.label for s in scores))}
    distinct: list[list[Score]] = []
    twins: dict[str, tuple[str, ...]] = {}
    for label, group in by_label.items():
        k = next((k for k, earlier in enumerate(distinct) if _same(earlier, group, as_one)), None)
        if k is None:
            distinct.append(group)
            continue
        # of two equivalent candidates keep the first one of the catalogue, where dormant effects of parts come first
        earlier = distinct[k][0].candidate.label
        first, second = sorted((earlier, label), key=place.__getitem__)
        distinct[k] = group if first == label else distinct[k]
        twins[first] = (*twins.pop(earlier, ()), second)
    largest = distinct[0][0].gain if distinct else 0.0
    leading: list[Job] = []
    remaining: list[Job] = []
    for k, group in enumerate(distinct):
        promising = families[family(group[0].candidate)] >= max(PROMISING * largest, needed) \
            and group[0].gain >= AT_LEAST * largest
        (leading if k < (FIRST if needed else REFITS) or promising else remaining).append((group[0].candidate, group))
    return _in_turn(leading), _in_turn(remaining), twins


def _in_turn(jobs: Sequence[Job]) -> list[Job]:
    """Sort the jobs so that the first candidate of each class comes first, then the second candidate of each class, and
    so on. If time is short, each class is tried, even if another class has many laws and places with slightly larger
    scores."""
    before: Counter[str] = Counter()
    turns = []
    for candidate, _ in jobs:
        turns.append(before[candidate.kind])
        before[candidate.kind] += 1
    return [job for _, job in sorted(zip(turns, jobs, strict=True), key=lambda pair: pair[0])]


def family(candidate: Candidate) -> tuple[str, frozenset[str]]:
    """Class and place of a candidate."""
    return candidate.kind, frozenset(candidate.where)


def largest_gains(scores: Iterable[Scored], key: Callable[[Candidate], Key]) -> dict[Key, float]:
    """The largest gain of all scores, or prescores, of the candidates with the same key."""
    largest: dict[Key, float] = {}
    for score in scores:
        largest[key(score.candidate)] = max(score.gain, largest.get(key(score.candidate), 0.0))
    return largest


def _same(first: Sequence[Score], second: Sequence[Score], as_one: Mapping[str, str]) -> bool:
    """True if two candidates move all channels in the same proportion at all choices of their shapes: one law at places with
    the same influence.

    If the nodes of both candidates move together, they model the same machine, unless a channel measures a quantity inside
    the connection between the nodes. Steps of the integrator across kinks make some directions inaccurate. In this case only
    the scores at the shape choice with the largest gain are compared. (Lags of an input and of a channel have no nodes, and
    differ by their initial states.)
    """
    a, b = first[0].candidate, second[0].candidate
    if a.vanishes != b.vanishes or len(first) != len(second) or len(a.numbers) != len(b.numbers):
        return False
    pairs = list(zip(sorted(first, key=_shapes), sorted(second, key=_shapes), strict=True))
    if a.component == b.component and _nodes(a, as_one) == _nodes(b, as_one) != []:
        return _alike(*max(pairs, key=lambda pair: min(s.gain for s in pair)), JOINED, 1 - JOINED)
    return all(_alike(s, t, ALIKE, TWINS) for s, t in pairs)


def _alike(first: Score, second: Score, share: float, cosine: float) -> bool:
    """True if the shapes and gains of two scores agree to the relative tolerance `share`, and the cosine of their
    directions exceeds `cosine`."""
    shapes, second_shapes = _shapes(first)[0], _shapes(second)[0]
    # opposite directions agree as well: one candidate may have the other sign only
    return len(shapes) == len(second_shapes) and np.allclose(shapes, second_shapes, rtol=share) and \
        abs(first.gain - second.gain) <= share * max(first.gain, second.gain) and \
        abs(float(first.direction @ second.direction)) > cosine


def _nodes(candidate: Candidate, as_one: Mapping[str, str]) -> list[str]:
    """The nodes to which a candidate is attached, with one name for nodes that move together."""
    return [as_one.get(node, node) for node in candidate.change.nodes]


def _shapes(score: Score) -> tuple[list[float], int, int]:
    """Sort key: the shape values, the number of amplitudes and the side of the neutral value."""
    return list(score.shapes.values()), len(score.along), score.side


def beyond_their_members(scores: Sequence[Score], gains: Mapping[str, float]) -> list[Score]:
    """Remove laws at several places at once whose score is smaller than the average score of the same law at one of these
    places. `gains` are the gains of members without a score.

    If the effect acts at all these places, the residual is along the sum of the members' directions. The joint score is then
    the largest, as long as the tangent is accurate. If the effect acts at only one of two places with different directions,
    the joint score equals the average of the members.
    """
    best = {**gains, **largest_gains(scores, lambda candidate: candidate.label)}
    return [s for s in scores if not s.candidate.members or best[s.candidate.label] >=
            sum(best.get(member, 0.0) for member in s.candidate.members) / len(s.candidate.members)]
