"""Refits kept in a file as they are made, so that a search that was ended goes on from them.

Each line of the file is one refit as JSON: where it ended, its ranges, and a digest of all that it depends on: the residuals
and derivatives of the base model at its optimum (to the last bit), the samples of all records, the candidate with the file
of its component, and what the search knew when the refit was made. A line whose digest is asked for again gives the same
refit without its descents; the figures are computed anew by one run of each record. A line that was cut short by the end of
the process, or whose figures are not those of the run, is left out.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from heavebond import __version__
from heavebond.core.errors import HeavebondError
from heavebond.diagnosis.catalogue import Candidate
from heavebond.diagnosis.refit import Refit, at_end_of
from heavebond.diagnosis.scoring import Base, Score
from heavebond.estimation.residuals import Descent

Kept = Mapping[str, Any]
SAME = 1e-6  # share by which the sum of squares may differ from the kept one: that of the tolerances of the runs


@dataclass
class KeptRefits:
    """The refits in a file by their digests; `taken` counts those that a search has asked for."""

    path: Path
    known: dict[str, Kept] = field(default_factory=dict)
    taken: int = 0

    @classmethod
    def read(cls, path: Path) -> KeptRefits:
        """What a file holds; nothing where there is none."""
        known: dict[str, Kept] = {}
        with suppress(OSError):
            for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
                with suppress(ValueError):  # one that was cut short
                    entry = json.loads(line)
                    if isinstance(entry, dict) and isinstance(entry.get("digest"), str):
                        known[entry["digest"]] = entry
        return cls(path, known)

    @classmethod
    def begin(cls, path: Path, resume: bool) -> KeptRefits:
        """What a file holds where a search is to `resume`; else an empty one in its place."""
        if resume:
            return cls.read(path)
        kept = cls(path)
        kept.remove()
        return kept

    def remove(self) -> None:
        """Remove the file, as a search has come to its end."""
        with suppress(OSError):
            self.path.unlink()

    def get(self, digest: str) -> Kept | None:
        """The refit with this digest, where it is kept."""
        found = self.known.get(digest)
        self.taken += found is not None
        return found

    def add(self, digest: str, candidate: Candidate, refit: Refit | None) -> None:
        """Keep a refit (None: it cannot be simulated). Where the file cannot be written the search goes on without it."""
        if digest in self.known:
            return
        self.known[digest] = entry = {"digest": digest, "candidate": candidate.label, **(_entry(refit) if refit else {})}
        with suppress(OSError), open(self.path, "a", encoding="utf-8", newline="\n") as file:
            # a line break before, too: the last line may have been cut short
            file.write(f"\n{json.dumps(entry)}\n")


_here: ContextVar[KeptRefits | None] = ContextVar("kept refits", default=None)


@contextmanager
def keeping(kept: KeptRefits) -> Iterator[None]:
    """Within it searches take refits from those that are kept, and keep those that they make."""
    before = _here.set(kept)
    try:
        yield
    finally:
        _here.reset(before)


def kept_here() -> KeptRefits | None:
    """What is kept in the `keeping` block around; None outside of any."""
    return _here.get()


def _entry(refit: Refit) -> dict[str, Any]:
    own = {n.name for n in refit.candidate.numbers}
    return {"inner": refit.inner.tolist(), "cost": refit.cost, "falls": refit.falls, "slack": refit.slack,
            "evaluations": refit.evaluations,
            "ranges": {name: [free.range.low, free.range.high] for name, free in refit.experiment.free.items()
                       if name in own},
            "begun": [{"x": d.x.tolist(), "cost": d.cost, "history": list(d.history), "message": d.message,
                       "unfinished": d.unfinished} for d in refit.begun]}


def is_broken(kept: Kept) -> bool:
    """Whether the diagram with the candidate could not be simulated."""
    return "inner" not in kept


def restored(base: Base, candidate: Candidate, guesses: Sequence[Score], kept: Kept) -> Refit | None:
    """The refit that was kept; None where the model gives another one there."""
    try:
        found = at_end_of(base, candidate, guesses, {n: (low, high) for n, (low, high) in kept["ranges"].items()},
                          np.array(kept["inner"], float))
        begun = tuple(Descent(np.array(d["x"], float), d["cost"], tuple(d["history"]), d["message"], d["unfinished"])
                      for d in kept["begun"])
        if not abs(found.cost - kept["cost"]) <= SAME * abs(kept["cost"]):
            return None
        return replace(found, begun=begun, falls=bool(kept["falls"]), slack=float(kept["slack"]),
                       evaluations=int(kept["evaluations"]))
    except (HeavebondError, LookupError, TypeError, ValueError, AttributeError):
        return None


def digest_of(base: Base) -> str:
    """A digest of the base model at its optimum and of all records."""
    made = hashlib.sha256()
    problem = base.problem
    for part in (__version__, problem.runs[0].simulator.tolerances, problem.columns,
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
    """The digest of one refit: of the base model (see `digest_of`), what is done, the candidate, the file of its component,
    and what is known when it is done: sums of squares, scores, other refits."""
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
