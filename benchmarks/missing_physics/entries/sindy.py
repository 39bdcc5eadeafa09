"""Sparse regression of the missing input (SINDy; pysindy) on an engineer's library of terms, then a fit in simulation.

S. L. Brunton, J. L. Proctor, J. N. Kutz, PNAS 113 (2016), doi:10.1073/pnas.1517384113. The states, the place and the values
of the missing input come from `estimates`. At each of the likeliest places a sequence of thresholds gives formulas with one
to four terms; those with the smallest residual are fitted in simulation with the free parameters, and BIC decides.
"""

from __future__ import annotations

import time as clock
import warnings
from typing import Any

import numpy as np
import pysindy as ps

from benchmarks.missing_physics.entries.refitting import answer_of
from benchmarks.missing_physics.entries.terms import Term, pitches, terms
from benchmarks.missing_physics.estimates import Estimated, localised
from benchmarks.missing_physics.reading import Case
from benchmarks.missing_physics.simulation import AtPlace, Fitted, Simulation

NAME, NEEDS = "sparse regression (SINDy)", ("pysindy", "scipy")
THRESHOLDS = np.geomspace(0.01, 3.0, 24)  # of a term's rms in that of the input
MOST, REFITTED, SECONDS = 4, 3, 15.0  # terms of a formula, formulas that are fitted, processor time of all fits (s)


def sparse(estimate: Estimated) -> list[tuple[list[Term], list[float], float]]:
    """Formulas at a place: terms, coefficients (SI) and the share of the variance that is left, shortest first."""
    v_size, x_size, w_size = (max(float(np.abs(one).max()), 1e-30) for one in (
        estimate.across, estimate.position, estimate.value))
    v, x, w = estimate.across / v_size, estimate.position / x_size, estimate.value / w_size
    known = terms(bool(estimate.place["position"]), pitches(x, w) if np.ptp(x) else [])
    columns = np.column_stack([np.broadcast_to(term.value(v, x), v.shape) for term in known])
    rms = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-12)
    found: dict[tuple[int, ...], tuple[list[Term], list[float], float]] = {}
    for threshold in THRESHOLDS:
        optimizer = ps.STLSQ(threshold=float(threshold * np.sqrt(np.mean(w**2))), alpha=1e-6, max_iter=40)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # all terms are below the largest thresholds
            optimizer.fit(columns / rms, w[:, None])
        chosen = tuple(np.flatnonzero(optimizer.coef_[0]).tolist())
        if not chosen or len(chosen) > MOST or chosen in found:
            continue
        a = np.linalg.lstsq(columns[:, chosen], w, rcond=None)[0]
        left = float(np.mean((w - columns[:, chosen] @ a)**2) / np.mean(w**2))
        found[chosen] = [known[k] for k in chosen], (a * w_size).tolist(), left
    return sorted(found.values(), key=lambda formula: (len(formula[0]), formula[2]))


def law_of(estimate: Estimated, formula: list[Term], numbers: list[float]) -> AtPlace:
    """A sum of terms as a law."""
    v_size, x_size = (max(float(np.abs(one).max()), 1e-30) for one in (estimate.across, estimate.position))

    def value(v: float, x: float, a: Any) -> float:
        return float(sum(k * term.value(v / v_size, x / x_size) for k, term in zip(a, formula, strict=True)))

    return AtPlace(estimate.place, value, tuple(numbers))


def answer(case: Case) -> dict[str, Any]:
    """The answer by sparse regression."""
    simulation, known = Simulation(case), localised(case)
    base = simulation.fitted()
    trials: list[tuple[Fitted, str]] = []
    simulation.ends = clock.process_time() + SECONDS
    for estimate in known.places:
        for formula, numbers, _ in sorted(sparse(estimate), key=lambda f: f[2])[:REFITTED]:
            words = " + ".join(f"{a:.4g}*({term.name})" for a, term in zip(numbers, formula, strict=True))
            trials.append((simulation.fitted(law_of(estimate, formula, numbers), base.parameters), words))
    simulation.ends = clock.process_time() + SECONDS
    return answer_of(case, simulation, base, trials)
