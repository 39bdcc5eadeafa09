"""The unknown input at the likeliest places of a case, for entries that do not estimate it: by `heavebond.localize`.

Methods that regress a law on states need the state of the machine and the force at the place; the records have neither.
An entry that takes them from here is judged by its formula, and its processor time contains that of the localisation.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import heavebond as hb
from benchmarks.missing_physics.reading import Array, Case

PLACES = 3  # at most
LIKELY = 6.0  # log likelihood behind the best place up to which a place is tried


@dataclass(frozen=True)
class Estimated:
    """The estimate at a place: the place of the case, and for all records one after another the across variable, the
    position (zero if it has none), and the input with its standard deviation (N,), in SI."""

    place: Mapping[str, Any]
    across: Array
    position: Array
    value: Array
    deviation: Array


@dataclass(frozen=True)
class Localised:
    """Whether an effect is missing, the estimates at the likeliest places, and the processor time (s)."""

    missing: bool
    places: Sequence[Estimated]
    processor: float


def localised(case: Case) -> Localised:
    """The likeliest places of a case."""
    began = clock.process_time()
    found = hb.localize(case.folder / "experiment.yaml")
    estimates = list[Estimated]()
    for suspect in found.suspects if found.missing else ():
        names = [node.name for node in suspect.place.nodes]
        place = next((p for p in case.places if p["nodes"] == names), None)
        if place is None or suspect.behind > LIKELY or len(estimates) == PLACES:
            continue
        across, position, value, deviation = list[Array](), list[Array](), list[Array](), list[Array]()
        for implied in suspect.implied.values():
            signals = list(implied.local.values())  # first the across variable, then the position if the domain has one
            still = np.zeros(len(implied.value))
            across.append(signals[0] if signals else still)
            position.append(signals[1] if place["position"] and len(signals) > 1 else still)
            value.append(implied.value)
            deviation.append(implied.deviation)
        estimates.append(Estimated(place, *(np.concatenate(part) for part in (across, position, value, deviation))))
    return Localised(bool(found.missing), estimates, clock.process_time() - began)
