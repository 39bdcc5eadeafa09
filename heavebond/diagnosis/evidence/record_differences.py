"""Parameters that differ between the fitted and the held-out records.

If the residual is noise on the fitted records but larger on a held-out record, the fitted records do not show the missing
effect. A parameter may have another value in the held-out record. Each influential parameter gets a separate value there,
which is fitted to the beginning of the record and tested on the remaining samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from heavebond.core.errors import HeavebondError, listing
from heavebond.core.presentation import number, readable
from heavebond.diagnosis.candidates.catalogue import Candidate
from heavebond.diagnosis.candidates.varying import differing_parameters
from heavebond.diagnosis.decision import DECISION
from heavebond.diagnosis.search.base_model import exact_runs, searched
from heavebond.diagnosis.search.step import EARNED, fallen
from heavebond.estimation.experiment import Experiment, Record, changed_experiment
from heavebond.estimation.fitting import own_values
from heavebond.estimation.residuals import Residuals, Run
from heavebond.numerics.dae import Array


@dataclass(frozen=True)
class RecordDifference:
    """A parameter that has another value in a held-out record than in the fitted ones.

    candidate: gives the parameter a separate value for each record. chance: p value of the residual in the held-out record
    without the candidate. words: the difference in a sentence.
    """

    candidate: Candidate
    chance: float
    words: str


def record_differences(experiment: Experiment) -> tuple[RecordDifference, ...]:
    """Find one parameter with another value for each held-out record that the fitted model does not predict.

    A parameter is reported if it explains most of the residual of the record. The diagram of `experiment` contains the
    fitted values.
    """
    problem = searched(experiment)
    inner = problem.start
    runs = exact_runs(experiment, problem.runs)
    candidates = differing_parameters(problem, inner)
    differences = [_difference(problem, inner, record, runs[record.name], candidates)
                   for record in experiment.records.values() if record.use != "fit"]
    return tuple(difference for difference in differences if difference is not None)


def _difference(problem: Residuals, inner: Array, record: Record, run: Run, candidates: tuple[Candidate, ...]
                ) -> RecordDifference | None:
    """Difference of one held-out record; None if no single parameter explains its residual."""
    from scipy.special import chdtrc

    experiment, values = problem.experiment, problem.values_of(inner, problem.runs[0].record.name)
    before = run.held_out(values)[0]
    chi2, samples = float(np.mean(before**2)), len(before)
    if chi2 <= DECISION.near:
        return None
    fits: list[tuple[float, str, float, float, Candidate]] = []
    for candidate in candidates:
        (name, _), = candidate.change.each.items()
        try:
            estimate = own_values(changed_experiment(experiment, candidate.change), record, values, run)
            after = run.held_out({**values, name: estimate.values[name]})[0]
        except (HeavebondError, KeyError):
            continue
        fits.append((float(np.mean(after**2)), name, estimate.values[name], estimate.seconds, candidate))
    if not fits:
        return None
    fits.sort(key=itemgetter(0, 1))
    least, name, value, seconds, candidate = fits[0]
    if least > DECISION.near and least - 1 > (chi2 - 1) / 2:
        return None
    usual = values.get(name, problem.runs[0].assembly.parameter_values[name])
    other_names = [other_name for cost, other_name, *_ in fits[1:] if fallen(cost, least, samples) < EARNED]
    unit = next(q.unit.text for q in problem.runs[0].assembly.flat.parameters if q.name == name)
    same = f" The records do not distinguish it from a difference of {listing(other_names, 3)}." if other_names else ""
    fitted = listing([r.record.name for r in problem.runs], 3)
    words = (f"{name} is {number(value / usual, 3)} times as large in record {record.name} as in {fitted} "
             f"({readable(value, unit, 3)} and {readable(usual, unit, 3)}; fitted to the first {number(seconds, 2)} s of "
             f"{record.name}). With it the reduced chi-square of {record.name} falls from {number(chi2, 3)} to "
             f"{number(least, 3)}. To fit a value for each record, write `{name}: {{range: ..., each: record}}` under "
             f"`free:`.{same}")
    return RecordDifference(candidate, float(chdtrc(samples, chi2 * samples)), words)
