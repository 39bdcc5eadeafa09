"""Scores and refits kept in a file as they are made, so that a search that was ended goes on from them.

Each line of the file holds the scores of one candidate, or one refit (where it ended, its ranges), and a digest of all that
it depends on: the residuals and derivatives of the base model at its optimum (to the last bit), the samples of all records,
the candidate with the file of its component, and what the search knew when the refit was made. A line whose digest is asked
for again gives the same scores, or the same refit without its descents; the figures of a refit are computed anew by one run
of each record. A line whose figures are not those of the run, or of the directions and the residuals, is left out.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from heavebond.core.errors import HeavebondError
from heavebond.core.kept_lines import Kept, KeptLines
from heavebond.core.version import VERSION
from heavebond.diagnosis.base_model import Base
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.finite_amplitudes import ranged
from heavebond.diagnosis.refit import Refit, at_end_of
from heavebond.diagnosis.scoring import Score, holding
from heavebond.estimation.residuals import Descent

SAME = 1e-6  # share by which the sum of squares may differ from the kept one: that of the tolerances of the runs
ROUNDING = 1e-9  # of the length of the residuals, by which a kept score may differ from that of its direction

_here: ContextVar[KeptLines | None] = ContextVar("kept refits", default=None)


@contextmanager
def keeping(kept: KeptLines) -> Iterator[None]:
    """Within it searches take refits from those that are kept, and keep those that they make."""
    before = _here.set(kept)
    try:
        yield
    finally:
        _here.reset(before)


def kept_here() -> KeptLines | None:
    """What is kept in the `keeping` block around; None outside of any."""
    return _here.get()


def entry(candidate: Candidate, refit: Refit | None) -> dict[str, Any]:
    """What is kept of a refit (None: it cannot be simulated)."""
    if refit is None:
        return {"candidate": candidate.label}
    own = {n.name for n in refit.candidate.numbers}
    return {"candidate": candidate.label, "inner": refit.inner.tolist(), "cost": refit.cost, "falls": refit.falls,
            "slack": refit.slack, "evaluations": refit.evaluations,
            "ranges": {name: [free.range.low, free.range.high] for name, free in refit.experiment.free.items()
                       if name in own},
            "finer": refit.finer, "begun": [d.as_dict() for d in refit.begun]}


def is_broken(kept: Kept) -> bool:
    """Whether the diagram with the candidate could not be simulated."""
    return "inner" not in kept


def restored(base: Base, candidate: Candidate, guesses: Sequence[Score], kept: Kept) -> Refit | None:
    """The refit that was kept; None where the model gives another one there."""
    try:
        found = at_end_of(base, candidate, guesses, {n: (low, high) for n, (low, high) in kept["ranges"].items()},
                          np.array(kept["inner"], float), int(kept["finer"]))
        begun = tuple(map(Descent.from_dict, kept["begun"]))
        if not abs(found.cost - kept["cost"]) <= SAME * abs(kept["cost"]):
            return None
        return replace(found, begun=begun, falls=bool(kept["falls"]), slack=float(kept["slack"]),
                       evaluations=int(kept["evaluations"]))
    except (HeavebondError, LookupError, TypeError, ValueError, AttributeError):
        return None


def scores_entry(candidate: Candidate, scores: Sequence[Score]) -> dict[str, Any]:
    """What is kept of the scores of a candidate, of its numbers that these hold at what the motion says, and of the ranges
    in which they seek amplitudes that cannot be zero."""
    own = {n.name: n for n in scores[0].candidate.numbers} if scores else {}
    held = {n.name: scores[0].candidate.change.value(n.name) for n in candidate.numbers if own and n.name not in own}
    ranges = {n.name: [span.range.low, span.range.high] for n in candidate.vanishing
              if n.name in own and (span := own[n.name].sought) is not None and span.range is not None}
    return {"candidate": candidate.label, "held": held, "ranges": ranges, "scores": [
        {"shapes": dict(s.shapes), "z": float(s.z), "amplitude": float(s.amplitude), "step": s.step.tolist(),
         "size": float(s.size), "share": float(s.share), "along": list(s.along), "side": s.side,
         "direction": base64.b64encode(s.direction.astype("<f8").tobytes()).decode()} for s in scores]}


def restored_scores(base: Base, candidate: Candidate, kept: Kept) -> list[Score] | None:
    """The scores that were kept; None where they are not those of their directions."""
    try:
        candidate = holding(candidate, {str(name): str(text) for name, text in kept["held"].items()})
        candidate = ranged(candidate, {str(n): (float(low), float(high)) for n, (low, high) in kept["ranges"].items()})
        found = [Score(candidate, s["shapes"], s["z"], s["amplitude"], np.array(s["step"], float), s["size"], s["share"],
                       np.frombuffer(base64.b64decode(s["direction"]), "<f8").astype(float), tuple(s["along"]), s["side"])
                 for s in kept["scores"]]
        room = ROUNDING * float(np.linalg.norm(base.r))
        right = all(len(s.step) == len(base.inner) and (not s.told_apart or abs(s.direction @ base.r + s.z) <= room)
                    for s in found)
    except (LookupError, TypeError, ValueError, AttributeError):
        return None
    return found if right else None


def digest_of(base: Base) -> str:
    """A digest of the base model at its optimum and of all records."""
    made = hashlib.sha256()
    problem = base.problem
    for part in (VERSION, problem.runs[0].simulator.tolerances, problem.columns,
                 sorted(problem.runs[0].assembly.parameter_values.items()), sorted(problem.experiment.outputs)):
        made.update(repr(part).encode())
    for array in (base.r, base.inner, base.J, base.priors):
        made.update(np.ascontiguousarray(array).tobytes())
    for name, run in base.exact.items():
        made.update(f"{name} {run.record.use}".encode())
        for samples in (run.found.grid, run.measured, run.counts, run.checking, run.noise):
            made.update(np.ascontiguousarray(samples).tobytes())
    return made.hexdigest()


def digest(base: str, what: str, candidate: Candidate, component: Path | None, known: Sequence[object]) -> str:
    """The digest of a score or a refit: of the base model (see `digest_of`), what is done, the candidate, the file of its
    component, and what is known when it is done: sums of squares, scores, other refits."""
    made = hashlib.sha256(f"{base} {what} {candidate!r} {_plain(known)!r}".encode())
    if component is not None and component.is_file():
        made.update(component.read_bytes())
    return made.hexdigest()


def _plain(known: object) -> object:
    """What a refit or a score says of itself, as its digits."""
    if isinstance(known, Refit):
        return known.candidate.label, known.cost, known.inner.tolist(), [d.x.tolist() for d in known.begun]
    if isinstance(known, Score):
        return known.z, known.amplitude, dict(known.shapes), known.along, known.side
    if isinstance(known, Sequence) and not isinstance(known, str):
        return [_plain(one) for one in known]
    return known
