"""The common end of entries with a law at a place: the fit in simulation, and the answer from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.missing_physics.entries.terms import effect
from benchmarks.missing_physics.reading import Case
from benchmarks.missing_physics.scoring import predictions_of
from benchmarks.missing_physics.simulation import Fitted, Simulation

STRONG = 10.0  # fall of BIC from which on a law counts as missing
SHARE = 0.1  # of chi-square that a law must remove at least: a fit of a false law to clutter removes less


def scored_record(case: Case) -> Any:
    """The record whose outputs are to be predicted."""
    return next(r for r in case.records.values() if r.use == "score")


def answer_of(case: Case, simulation: Simulation, base: Fitted, trials: Sequence[tuple[Fitted, str]]) -> dict[str, Any]:
    """The answer from the fit of the base model and those with a law at a place, each with its formula in words: the law
    with the smallest BIC, if BIC falls by STRONG and chi-square by SHARE."""
    best, formula = min(trials, key=lambda trial: trial[0].bic, default=(base, ""))
    scored, first = scored_record(case), next(iter(case.records.values()))
    if best.law is None or best.bic > base.bic - STRONG or best.squares > (1 - SHARE) * base.squares:
        channels = simulation.channels(scored, base.parameters)
        return {"missing": False, "effects": [], "predictions": predictions_of(scored.name, channels or {})}
    across, position, value = simulation.motion(first, best.parameters, best.law)
    told: dict[str, Any] = {"missing": True, "effects": [effect(best.law.place, across, position, value, formula)]}
    if np.all(np.isfinite(value)):
        told["input"] = {"place": best.law.place["nodes"], "values": [float(f"{w:.5g}") for w in value]}
    channels = simulation.channels(scored, best.parameters, best.law)
    return told | {"predictions": predictions_of(scored.name, channels or {}), "chi2": best.chi2, "chi2_base": base.chi2}
