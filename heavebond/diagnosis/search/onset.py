"""Effects that begin at some time: a scan over the onset times of all scored candidates, with one time for each record.

Suppose that an effect acts in record k after the time t_k. To first order, it moves the channels of this record by the
direction s of the effect for t > t_k, and not at all before. This holds if the free response of the machine decays
quickly. The gain of the masked direction over a grid of times needs no simulation. With J (n, m) the derivatives with
respect to the free parameters and P the derivatives of the priors, each record contributes only

    b_k = s_k'r_k,   g_k = J_k's_k,   q_k = s_k's_k        over the samples after t_k.

The sums over the records give s_o'r and |s_o| of the score (see `scoring`). The times are optimised by coordinate ascent:
one record after the other, until no time changes. With one amplitude for all records, the best time of one record depends on
the others through the free parameters only. The grid includes both ends: the effect acts in the whole record, or not at all.
A candidate whose gain from onset times exceeds its gain in whole records is scored exactly and refitted; the times are then
among its numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.varying import with_onset
from heavebond.diagnosis.search.base_model import Base
from heavebond.diagnosis.search.scoring import SAME, Score
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class OnsetConstants:
    """Constants of the scan. `Origin` gives the reason of a value, `Doubled` the consequence of twice the value.

    families: number of combinations of class and place that are tried, those with the largest gains. Origin: the
        leaders of a step; each law costs a score and a refit. Doubled: twice as many.
    laws: number of laws of one class at one place. Origin: a simple law and its refinements. Doubled: more refinements.
    times: number of intervals between onset times on the grid of a record. Origin: at half this interval a refit is
        sensitive to the transition (`VARYING.width`). Doubled: finer.
    more: minimum increase of the gain for each record, in units of the residual per sample. Origin: the increase that
        justifies an effect (12), for one additional parameter that is chosen from a grid. Doubled: weaker onsets are not
        tried.
    share: minimum relative increase of the gain, in addition to `more`. Origin: a masked direction is exact for static
        laws only. Doubled: later onsets only.
    rounds: maximum number of passes over the records. Origin: two are enough, the third confirms that nothing changes.
        Doubled: the same.
    """

    families: int = 3
    laws: int = 3
    times: int = 200
    more: float = 12.0
    share: float = 0.1
    rounds: int = 6


ONSET = OnsetConstants()


def onsets(base: Base, scores: Sequence[Score], needed: float = 0.0) -> list[Candidate]:
    """The candidates with the largest gains from onset times, with one time for each record. Candidates for which onset
    times do not increase the gain materially, or not to half of the gain `needed`, are left out."""
    runs, experiment = base.problem.runs, base.problem.experiment
    unit = max(1.0, float(base.r @ base.r) / len(base.r))
    best: dict[str, tuple[float, Score, dict[str, float]]] = {}
    in_whole_records: dict[str, float] = {}
    scan = _Scan(base)
    for score in scores:
        if not (score.size > 0 and score.candidate.vanishing) or score.candidate.change.each:
            continue
        gain, whole, begins = scan.best(score)
        label = score.candidate.label
        in_whole_records[label] = max(whole, in_whole_records.get(label, 0.0))
        if gain > best.get(label, (0.0,))[0]:
            best[label] = gain, score, begins
    best = {label: entry for label, entry in best.items()
            if entry[0] > (1 + ONSET.share) * in_whole_records[label] + ONSET.more * unit * len(runs)
            and entry[0] >= needed / 2}
    spans = {name: (float(run.found.grid[0]), float(run.found.grid[-1])) for name, run in base.exact.items()}
    families: dict[object, list[Candidate]] = {}
    for _, score, begins in sorted(best.values(), key=lambda entry: -entry[0]):
        # the onset time in a held-out record is not known yet; it is estimated there later
        whole_records = {name: low for name, (low, _) in spans.items()}
        delayed = with_onset(score.candidate, experiment.model.library, spans, {**whole_records, **begins})
        if delayed is not None:
            families.setdefault((delayed.kind, frozenset(delayed.where)), []).append(delayed)
    return [delayed for family in list(families.values())[:ONSET.families] for delayed in family[:ONSET.laws]]


class _Scan:
    """Sums over the samples after each grid time of each record, and the gains that follow from them, for the directions
    of scores."""

    def __init__(self, base: Base):
        self.base = base
        self.J, priors = base.J[:, base.moving], base.priors[:, base.moving]
        self.normal = self.J.T @ self.J
        whole = self.normal + priors.T @ priors
        scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
        self.inverse = np.linalg.pinv(whole / scale[:, None] / scale, rcond=1e-12) / scale[:, None] / scale
        self.slope = self.J.T @ base.r
        ends = np.cumsum([0, *(int(run.counts.sum()) for run in base.problem.runs)])
        self.records: list[tuple[str, slice, Array, Array]] = []
        for run, begin, end in zip(base.problem.runs, ends[:-1], ends[1:], strict=True):
            times = run.found.grid[np.nonzero(run.counts)[1]]
            low, high = float(run.found.grid[0]), float(run.found.grid[-1])
            grid = np.linspace(low, high, ONSET.times + 1)
            self.records.append((run.record.name, slice(begin, end), times, grid))

    def best(self, score: Score) -> tuple[float, float, dict[str, float]]:
        """The largest gain of a direction that acts from an onset time on in each record, the gain in whole records, and
        the onset times by record name."""
        s = score.direction
        if score.told_apart and score.z != 0:
            # the derivative with respect to the amplitude, including the part that the free parameters can explain
            length = score.size * score.share
            s = length * score.direction - self.base.J @ score.step / (score.z / length)
        sums = [self._sums(s, part, times, grid) for _, part, times, grid in self.records]
        last, count = ONSET.times, len(sums)
        whole = self._gains(score, [b[:1] for b in sums])[0]
        ascents: list[tuple[float, list[int]]] = []
        # starts: the effect acts in all records, or in one record only
        for start in [[0] * count, *([last if j != k else 0 for j in range(count)] for k in range(count))]:
            at, gain = list(start), 0.0  # coordinate ascent over the records
            for _ in range(ONSET.rounds):
                before = list(at)
                for k in range(count):
                    gains = self._gains(score, [part if j == k else part[at[j]:at[j] + 1] for j, part in enumerate(sums)])
                    at[k], gain = int(np.argmax(gains)), float(gains.max())
                if at == before:
                    break
            ascents.append((gain, at))
        gain, at = max(ascents, key=lambda ascent: ascent[0])
        return gain, float(whole), {name: float(grid[k]) for (name, _, _, grid), k in zip(self.records, at, strict=True)}

    def _gains(self, score: Score, parts: Sequence[Array]) -> Array:
        """The gains (times,) after the sums of all records are added."""
        total = sum(parts[1:], start=parts[0])
        b, q, g = total[:, 0], total[:, 1], total[:, 2:]
        step = g @ self.inverse
        lengths = q - 2 * np.sum(g * step, axis=1) + np.sum((step @ self.normal) * step, axis=1)
        visible = lengths > SAME**2 * np.maximum(q, 1e-300)
        z = np.where(visible, -(b - step @ self.slope) / np.sqrt(np.where(visible, lengths, 1.0)), 0.0)
        return np.asarray(z**2 if score.signed else np.maximum(z, 0.0)**2)

    def _sums(self, s: Array, part: slice, times: Array, grid: Array) -> Array:
        """The sums b, q and g as columns (times, 2 + m), over the samples after each grid time."""
        direction = s[part]
        columns = np.column_stack([direction * self.base.r[part], direction**2, direction[:, None] * self.J[part]])
        place = np.searchsorted(grid, times, side="left")  # a sample counts for all earlier grid times
        binned = np.zeros((len(grid) + 1, columns.shape[1]))
        np.add.at(binned, place, columns)
        sums = np.cumsum(binned[::-1], axis=0)[::-1]
        sums_after = sums[1:]  # samples after grid[k]
        sums_after[0] = columns.sum(axis=0)
        sums_after[-1] = 0.0
        return np.asarray(sums_after)
