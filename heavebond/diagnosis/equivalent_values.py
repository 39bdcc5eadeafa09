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
from heavebond.diagnosis.scoring import SAME, SIZED, Score
from heavebond.estimation.residuals import Run
from heavebond.language.edits import Change
from heavebond.numerics.dae import Array
from heavebond.numerics.quick_simulation import QuickSimulator

# Tangents of the search err by some percent (see `scoring.SIZED`): two that are nearly in proportion, less than this share
# of one beside the other, are computed anew, at this share of the tolerances, where the error falls with them.
NEARLY, FINELY = 0.05, 0.01


def equivalent_values(base: Base, scores: Sequence[Score]) -> dict[str, tuple[str, ...]]:
    """The numbers of the diagram of which candidates are another value, by the labels of these: at every choice of its
    shapes a candidate is in proportion to the same one. Where the tangents are so nearly, they are computed anew by finer
    runs: those of the search err by more than what decides."""
    held = _held_directions(base) if scores else {}
    free = _unit({column.free.name: base.J[:, k] for k, column in enumerate(base.problem.columns)})
    of: dict[str, list[Score]] = {}
    for score in scores:
        if score.size > 0:
            of.setdefault(score.candidate.label, []).append(score)
    found = {}
    for label, own in of.items():
        beside = [_beside(score.direction, held if score.told_apart else free) for score in own]
        nearly = set.intersection(*({name for name, share in shares.items() if share < NEARLY} for shares in beside))
        if names := {name for name in nearly if all(shares[name] < SAME or (
                score.told_apart and score.side == 0 and _beside_finely(base, score, name) < SAME)
                for score, shares in zip(own, beside, strict=True))}:
            found[label] = tuple(sorted(names))
    return found


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


def _beside_finely(base: Base, score: Score, name: str) -> float:
    """The share of a score's direction that is beside that of a number, both from finer runs; 1 where they fail, or where
    the score is no tangent. What the free parameters take of two vectors in proportion is in proportion as well, however
    exact J is."""
    along = list(score.along)
    if not along:  # the difference at a finite value, of an effect that has no tangent
        return 1.0
    size = SIZED * float(np.linalg.norm(base.r)) / score.size
    there = {**{n.name: n.neutral for n in score.candidate.vanishing}, **score.shapes}
    try:
        own = sensitivities(base, _finely(base.runs(score.candidate.change, along), dict.fromkeys(along, size)), there)
        other = sensitivities(base, _finely(base.runs(Change(), [name]), {}), {})[name]
    except HeavebondError:
        return 1.0
    directions = _unit({"own": base.split(np.sum([own[a] for a in along], axis=0))[0], "other": base.split(other)[0]})
    return _beside(directions["own"], directions)["other"] if len(directions) == 2 else 1.0


def _finely(runs: Sequence[Run], sizes: Mapping[str, float]) -> list[Run]:
    """The runs with a hundredth of their tolerances, whose error control knows how large amplitudes are."""
    return [run.again(run.names, sizes, QuickSimulator, run.simulator.tolerances.scaled(FINELY)) for run in runs]


def _unit(columns: Mapping[str, Array]) -> dict[str, Array]:
    return {name: s / length for name, s in columns.items() if (length := float(np.linalg.norm(s))) > 0}


def _beside(direction: Array, others: Mapping[str, Array]) -> dict[str, float]:
    """The share of a unit vector (n,) that is beside each of others, the sine of the angle between them."""
    return {name: float(np.linalg.norm(direction - (direction @ s) * s)) for name, s in others.items()}
