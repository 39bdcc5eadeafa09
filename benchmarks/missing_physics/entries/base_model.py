"""The base model with fitted parameters and no law: what a search must improve on."""

from __future__ import annotations

from typing import Any

from benchmarks.missing_physics.entries.refitting import answer_of
from benchmarks.missing_physics.reading import Case
from benchmarks.missing_physics.simulation import Simulation

NAME, NEEDS = "base model, fitted", ("scipy",)


def answer(case: Case) -> dict[str, Any]:
    """The fitted base model."""
    simulation = Simulation(case)
    return answer_of(case, simulation, simulation.fitted(), [])
