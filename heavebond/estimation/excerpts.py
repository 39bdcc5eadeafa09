"""Excerpts from the beginning of long records, for a search that simulates them thousands of times.

A few thousand samples suffice to select an effect; more make every refit slower. The excerpt starts with the record,
because the state of the machine is known only there. It is longer if a record begins with little motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from heavebond.core.presentation import number
from heavebond.estimation.comparison import Comparison, RecordComparison
from heavebond.estimation.experiment import Experiment


@dataclass(frozen=True)
class ExcerptConstants:
    """The constants of the choice of an excerpt of long records for a search.

    evaluations: evaluations of the equations between two samples, in a run of the diagram, up to which a sample counts once;
    if there are more, as with few samples in a cycle of an oscillation, a sample counts in proportion, rounded. Origin:
    three to thirteen in the rigs from which `long` was derived. Doubled: such records are searched on twice as many samples.
    clear: chi-square per sample above which the weights apply: a smaller misfit shows on all samples only. Origin: as for
    refits that reduce a large misfit by nothing. Doubled: more records are searched completely.
    long: samples of all fitted records together from which a search uses an excerpt. Origin: the time of a search. Doubled:
    whole records are searched twice as often.
    long_clear: the same for a misfit that is `clear`. Origin: twice the excerpt, so that it saves at least half of the time.
    Doubled: as above.
    excerpt: samples of an excerpt, at least. Origin: the time of a run. Doubled: twice the time, narrower intervals in a
    search.
    least: samples of an excerpt if each counts several times. Origin: on fewer, another law of the class led in an
    oscillator with cubic stiffness (70 Hz, sampled at 610 Hz). Doubled: twice the time if samples take long.
    max_extension: largest factor on its length if the record begins with little motion. Origin: as above. Doubled: as above.
    checking: factor for validation records, which are run less often. Origin: as above. Doubled: as above.
    exciting: share of the mean square misfit of a record that its excerpt must have. Origin: below, the excerpt misses
    the error of the model. Doubled: longer excerpts.
    """

    evaluations: float = 10.0
    clear: float = 10.0
    long: int = 30_000
    long_clear: int = 10_000
    excerpt: int = 5_000
    least: int = 2_500
    max_extension: int = 4
    checking: int = 2
    exciting: float = 0.3


EXCERPTS = ExcerptConstants()


def excerpt(experiment: Experiment, compared: Comparison, samples: int | None = None) -> Experiment:
    """The experiment on the beginnings of its records, with `samples` points in time of all fitted records together; the
    experiment itself if it has no more. Without `samples` the excerpt has `excerpt` points if there are more than
    `long`; with a misfit that is `clear`, if there are more than `long_clear`, and a sample counts by its evaluations.
    `compared` is the comparison with its model, which shows the times of the misfit."""
    fitted = [r for r in compared.records.values() if r.use == "fit"]
    clear = not samples and not min(r.chi2 for r in fitted) < EXCERPTS.clear
    cost = 1
    if clear:
        for r in fitted:  # weight of a sample by the number of evaluations of a run between two samples
            taken = r.result.statistics.get("nfevals")
            between = float(taken) / len(r.result.time) if isinstance(taken, (int, float)) else 0.0
            cost = max(cost, round(between / EXCERPTS.evaluations))
    number_of_points = sum(len(r.result.time) for r in fitted)
    if cost * number_of_points <= (samples or EXCERPTS.long) and not (clear and number_of_points > EXCERPTS.long_clear):
        return experiment
    most = max(1, (samples or max(EXCERPTS.excerpt // cost, EXCERPTS.least)) // len(fitted))
    records = dict(experiment.records)
    for record_comparison in compared.records.values():
        end = _end(record_comparison, most if record_comparison.use == "fit" else EXCERPTS.checking * most)
        if end is not None:
            records[record_comparison.name] = replace(records[record_comparison.name], end=end)
    return replace(experiment, records=records) if records != experiment.records else experiment


def as_long_as(reference: Experiment, experiment: Experiment) -> Experiment:
    """A variant of another experiment with its records ending at the same times."""
    records = {name: replace(r, end=reference.records[name].end) for name, r in experiment.records.items()}
    return replace(experiment, records=records)


def cut(part: Experiment, experiment: Experiment) -> str:
    """Records of an excerpt that are shortened, with their ends: `train up to 16.38 s`; empty without any."""
    ends = {name: r.end for name, r in part.records.items() if r.end != experiment.records[name].end}
    return ", ".join(f"{name} up to {number(end, 5)} s" for name, end in ends.items() if end is not None)


def _end(record: RecordComparison, most: int) -> float | None:
    """End of the excerpt of a record; None for the whole record."""
    grid = record.result.time
    if len(grid) <= most:
        return None
    channels = record.channels.values()
    time = np.concatenate([c.time for c in channels])
    order = np.argsort(time)
    wrong = np.concatenate([np.where(c.outlier, 0.0, (c.measured - c.model) / c.noise)**2 for c in channels])[order]
    time, mean = time[order], np.cumsum(wrong) / np.arange(1, len(wrong) + 1)
    enough = (time >= grid[most - 1]) & (mean >= EXCERPTS.exciting * mean[-1])
    last = float(time[np.argmax(enough)]) if enough.any() else float(grid[-1])
    end = min(last, float(grid[min(EXCERPTS.max_extension * most, len(grid)) - 1]))
    return end if end < grid[-1] else None
