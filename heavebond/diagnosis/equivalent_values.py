"""Candidates that act as another value of a number of the diagram does, known before the search.

With s_o (n,) what the free parameters do not take of the derivative of the residuals to a candidate's amplitude, and h_o the
same of a number that the diagram holds fixed, the two cannot be told apart to first order where s_o is in proportion to h_o:
added mass on a body, and the mass of that body. Where s itself is in proportion to the derivative to a free parameter,
nothing of it is left (see `scoring.SAME`), and no record can show the candidate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.base_model import Base, sensitivities
from heavebond.diagnosis.fixed_values import fixed_values
from heavebond.diagnosis.scoring import SAME, Score
from heavebond.estimation.change import Change
from heavebond.numerics.dae import Array


def equivalent_values(base: Base, scores: Sequence[Score]) -> dict[str, tuple[str, ...]]:
    """The numbers of the diagram of which candidates are another value, by the labels of these: at every choice of its
    shapes a candidate is in proportion to the same one."""
    held = _held_directions(base) if scores else {}
    free = _unit({column.free.name: base.J[:, k] for k, column in enumerate(base.problem.columns)})
    found: dict[str, list[set[str]]] = {}
    for score in scores:
        if score.size > 0:
            near = held if score.told_apart else free
            found.setdefault(score.candidate.label, []).append(_in_proportion(score, near))
    together = {label: set.intersection(*names) for label, names in found.items()}
    return {label: tuple(sorted(names)) for label, names in together.items() if names}


def _held_directions(base: Base) -> dict[str, Array]:
    """What the free parameters do not take of the derivative of the residuals to each number that is held fixed, by the
    diagram or by an end of its range, as directions (n,); without those of which nothing is left."""
    names = [c.numbers[0].name for c in fixed_values(base.problem.experiment)]
    stopped = set(range(len(base.problem.columns))) - {int(k) for k in base.moving}
    moved = {base.problem.columns[k].free.name: base.J[:, k] for k in stopped}
    with suppress(HeavebondError):
        moved |= sensitivities(base, base.runs(Change(), names), {}) if names else {}
    left = {name: base.split(s)[0] for name, s in moved.items() if np.all(np.isfinite(s)) and s.any()}
    return _unit({name: s for name, s in left.items() if np.linalg.norm(s) > SAME * np.linalg.norm(moved[name])})


def _unit(columns: Mapping[str, Array]) -> dict[str, Array]:
    return {name: s / length for name, s in columns.items() if (length := float(np.linalg.norm(s))) > 0}


def _in_proportion(score: Score, directions: Mapping[str, Array]) -> set[str]:
    """The names of the directions to which that of a score is parallel: less than the share SAME of it is beside them."""
    return {name for name, s in directions.items()
            if float(np.linalg.norm(score.direction - (score.direction @ s) * s)) < SAME}
