"""Effects that begin at a time: a scan over the time of onset of the leading candidates.

To first order, an effect that acts from t_0 on moves the channels by the direction s of the effect for t > t_0 only, as
far as the machine forgets quickly. The gain of the masked direction over a grid of t_0 costs no simulation. A candidate
that gains more from a time on than on the whole records is scored exactly and refitted with t_0 among its numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.varying import with_onset
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.scoring import Score
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class OnsetConstants:
    """Constants of the scan.

    candidates: candidates with the largest gains that are scanned. Origin: the leaders of a step; each scan that succeeds
        costs a score and a refit. Doubled: twice as many.
    times: times of onset on the grid. Origin: the refit moves the onset by several distances of the grid. Doubled: finer.
    more: how much the gain must grow, in units of the residual per sample. Origin: as much as justifies an effect (12),
        for one more parameter that is chosen from a grid. Doubled: weaker onsets are not tried.
    share: share of the gain by which it must grow besides. Origin: a masked direction is exact for static laws only.
        Doubled: later onsets only.
    """

    candidates: int = 6
    times: int = 30
    more: float = 12.0
    share: float = 0.1


ONSET = OnsetConstants()


def onsets(base: Base, scores: Sequence[Score]) -> list[Candidate]:
    """The leading candidates with an onset, if they gain more from a time on."""
    times = sample_times(base)
    low, high = float(times.min()), float(times.max())
    grid = np.linspace(low, high, ONSET.times + 2)[1:-1]
    unit = max(1.0, float(base.r @ base.r) / len(base.r))
    best: dict[str, Score] = {}
    for score in sorted(scores, key=lambda s: -s.gain):
        if score.told_apart and score.gain > 0:
            best.setdefault(score.candidate.label, score)
    found = []
    for score in list(best.values())[:ONSET.candidates]:
        gains = [_gain(base, score, times > begin) for begin in grid]
        k = int(np.argmax(gains))
        if gains[k] > (1 + ONSET.share) * score.gain + ONSET.more * unit:
            library = base.problem.experiment.model.library
            if (made := with_onset(score.candidate, library, (low, high), float(grid[k]))) is not None:
                found.append(made)
    return found


def sample_times(base: Base) -> Array:
    """The time of each residual (n,)."""
    return np.concatenate([run.found.grid[np.nonzero(run.counts)[1]] for run in base.problem.runs])


def _gain(base: Base, score: Score, acting: Array) -> float:
    """The gain of a direction on the samples on which the effect acts; 0 if its sign is not allowed."""
    left = base.split(score.direction * acting)[0]
    length = float(np.linalg.norm(left))
    if length <= 1e-6:
        return 0.0
    z = -float(left @ base.r) / length
    return z**2 if z > 0 or score.signed else 0.0
