"""How large an effect must be to be seen and to be named: `python -m benchmarks.diagnosis.detectability`.

With s_o the direction in which an amplitude moves the channels over their noise, as far as no free parameter does (see
`search.scoring`), z is normal with mean a |s_o| and variance 1. An effect is *seen* nine times in ten where a |s_o| is
1.28 above the largest of the scores that chance exceeds once in a hundred tries. It is *named* nine times in ten where the
best rival of another class or place, at the cosine c to its direction, leaves more than `limit` on both records, by
1.28 standard deviations. It is expected to leave D = (a |s_o|)**2 (1 - c**2) (n + n') / n more, and sqrt(D) scatters by 1:

    sqrt(D) = sqrt(10 + 0.003 (n + n') + 0.25 m) + 1.28,

with m what the truth itself misses the noise by on average, sum of sqrt(2 n) E[max(0, N)] over both records, N normal.
As far as the tangent holds; refits of laws with shapes come nearer to each other than their tangents.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.judging import SECONDS, told
from benchmarks.diagnosis.making import Hidden
from benchmarks.diagnosis.rigs import RIGS, Rig
from benchmarks.diagnosis.truths import Truth
from heavebond.diagnosis.candidates.catalogue import UNKNOWN, single_candidates
from heavebond.diagnosis.evidence.comparison import INEXACT, STRONG
from heavebond.diagnosis.evidence.residual_tests import DRAWS, LEVELS
from heavebond.diagnosis.search.scoring import Score, scored
from heavebond.diagnosis.search.step import fitted_base
from heavebond.numerics.dae import Array

STUDY, CHECKS = "detectability", "detectability_checks"
MARGIN = 1.2816  # nine in ten
FACTORS = (0.5, 2.0)  # of the amplitude that is just named, at which it is checked
CHECKED = {"receiver": ("SensorOffset in the channel receiver.p", "SensorGain in the channel receiver.p",
                        "SensorOffset before inlet.u", "PneumaticLine between supply and inlet.a",
                        "PneumaticLine between receiver and outlet.a", "PneumaticOrifice between supply and receiver"),
           "passive": ("CoulombFriction between platform and crown", "Drag between platform and crown",
                       "SensorOffset in the channel string.F"),
           "cylinder": ("Drag between frame and load",)}


def chance(directions: Array, signed: Array, level: float) -> float:
    """What the largest of the scores exceeds by chance at a level."""
    values, vectors = np.linalg.eigh(directions @ directions.T)
    draws = np.random.default_rng(1).standard_normal((DRAWS, len(directions))) @ (vectors * np.sqrt(np.maximum(values, 0))).T
    return float(np.quantile(np.where(signed, np.abs(draws), draws).max(axis=1), 1 - level))


def predicted(rig: Rig) -> list[dict[str, Any]]:
    """One row for each candidate that can stand in the diagram at amplitude zero."""
    with tempfile.TemporaryDirectory() as folder:
        case = Hidden(rig, (), f"{rig.name}/detectability", Path(folder), share=0.0).case()
        base = fitted_base(case.experiment)
        scores = [s for c in single_candidates(case.experiment) if c.kind != UNKNOWN
                  for s in scored(base, c) if s.told_apart]
    directions = np.array([s.direction for s in scores])
    seen = chance(directions, np.array([s.signed for s in scores]), LEVELS["score"]) + MARGIN
    return [_row(rig, s, scores, directions, seen, len(base.r)) for s in scores if s.candidate.vanishes]


def limit(n: int) -> float:
    """By how much the likelihood must differ where the truth is among the candidates and leaves noise, both records having n
    samples (see `diagnosis.evidence.comparison`)."""
    return STRONG + INEXACT * 2 * n


def _row(rig: Rig, score: Score, scores: Sequence[Score], directions: Array, seen: float, n: int) -> dict[str, Any]:
    own = (score.candidate.kind, rig.place(score.candidate.where))
    cosines = directions @ score.direction
    rivals = [(abs(float(c)) if s.signed or c > 0 else 0.0, s.candidate.label)
              for c, s in zip(cosines, scores, strict=True) if (s.candidate.kind, rig.place(s.candidate.where)) != own]
    cosine, rival = max(rivals, default=(0.0, ""))
    length = score.size * score.share
    apart = max(1 - cosine**2, 1e-12)
    named = max(seen, (np.sqrt(limit(n)) + MARGIN) / np.sqrt(2 * apart))
    return {"key": f"{rig.name}/{score.candidate.label}/{sorted(score.shapes.items())}", "rig": rig.name,
            "label": score.candidate.label, "shapes": dict(score.shapes), "seen": seen / length, "named": named / length,
            "misfit_seen": seen**2 / n, "misfit_named": named**2 / n, "rival": rival, "cosine": cosine,
            "numbers": {c.name: c.unit.text for c in score.candidate.numbers if c.amplitude}}


def checked(rig: Rig, row: dict[str, Any], factor: float) -> dict[str, object]:
    """The same effect, so many times as large as is just named, diagnosed."""
    amplitude = float(row["named"]) * factor
    key = f"{row['key']} x {factor:g}"
    keys = [name.rpartition(".")[2] for name in row["numbers"]]
    shapes = {name.rpartition(".")[2]: v for name, v in row["shapes"].items()}
    truth = Truth(str(row["label"]), str(row["label"]), lambda a, drawn: {**dict.fromkeys(keys, a), **shapes})
    with tempfile.TemporaryDirectory() as folder:
        hidden = Hidden(rig, [truth], f"{rig.name}/detectability", Path(folder), share=0.0)
        # driven as the machine was for which the amplitude was predicted
        hidden.inputs = Hidden(rig, (), f"{rig.name}/detectability", Path(folder), share=0.0).inputs
        case = replace(hidden.case([amplitude]), misfit=float(row["misfit_named"]) * factor**2)
        found = hb.diagnose(case.experiment, number=1, seconds=SECONDS)
        return {"key": key, "rig": rig.name, "label": row["label"], "factor": factor, "amplitude": amplitude,
                **told(rig, case, found)}


def main(names: Sequence[str]) -> None:
    """What is not on disk yet."""
    done, checks = keeping.read(STUDY), keeping.read(CHECKS)
    for rig in (r for r in RIGS.values() if not names or r.name in names):
        rows = [r for r in done.values() if r["rig"] == rig.name]
        if not rows:
            rows = predicted(rig)
            for row in rows:
                keeping.add(STUDY, row)
        for label in CHECKED[rig.name]:
            for factor in FACTORS:
                row = next(r for r in rows if r["label"] == label)
                if f"{row['key']} x {factor:g}" in checks:
                    continue
                found = checked(rig, row, factor)
                keeping.add(CHECKS, found)
                print(f"{found['outcome']:10s} {found['key']} {found['verdict']} {found['words']}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
