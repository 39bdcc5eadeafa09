"""Compare the run of a diagram with that of the same machine in other words."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random

import numpy as np

import heavebond as hb
from benchmarks.fuzz.relations import RELATIONS, Same
from benchmarks.fuzz.sheets import Sheet, sheet
from benchmarks.fuzz.trying import output_times
from heavebond.core.errors import HeavebondError, SimulationError
from heavebond.numerics.dae import Array, Assembly
from heavebond.numerics.idas import Tolerances
from heavebond.numerics.result import Probe, Result
from heavebond.numerics.simulator import Simulator

RTOL, ATOL = 1e-8, 1e-10
TIGHTER = 100.0
SENSITIVE = 1e-3  # a run that tighter tolerances move by more is compared up to there
# a run of other words has errors of its own, which may be some times the estimate; and what rounding leaves of differences
TIMES, ROUNDING = 30.0, 1e-6
MOST_NAMES = 400


@dataclass(frozen=True)
class Compared:
    """What came of a relation on a diagram: same, sensitive (same up to where the run itself is), not applicable, or
    different, refused, traceback; `signals` were compared."""

    relation: str
    outcome: str
    what: str
    signals: int = 0

    def as_dict(self) -> dict[str, object]:
        """For a line of JSON."""
        return asdict(self)


DIFFERENCES = ("different", "refused", "traceback")


class Reference:
    """A diagram's own two runs, the second with tighter tolerances, in numbers of the size of each signal."""

    def __init__(self, path: Path):
        self.sheet: Sheet = sheet(path)
        self.assembly: Assembly = hb.assemble(hb.load(path))
        self.times = output_times(self.assembly)
        coarse, self.fine = (run(self.assembly, self.times, t) for t in (1.0, TIGHTER))
        self.names = [n for n in self.assembly.flat.names if "." in n][:MOST_NAMES]
        rough, self.values = (signals(r, {n: n for n in self.names}) for r in (coarse, self.fine))
        nominal = {u.name: u.nominal for u in self.assembly.flat.unknowns}
        sizes = np.array([max(float(np.abs(self.values[n]).max()), 1e-3 * nominal.get(n, 1.0)) for n in self.names])
        self.sizes = dict(zip(self.names, sizes, strict=True))
        off = np.array([np.abs(rough[n] - self.values[n]) / self.sizes[n] for n in self.names])
        self.error = np.maximum.accumulate(np.where(self.near_events(self.fine, coarse), 0.0, off), axis=1) \
            if len(self.names) else np.zeros((0, len(self.times)))
        beyond = np.flatnonzero(self.error.max(axis=0, initial=0.0) > SENSITIVE)
        self.until = int(beyond[0]) if len(beyond) else len(self.times)

    def near_events(self, *results: Result) -> Array:
        """Points so near to an event of a run that they may be before it in one and after it in another."""
        instants = np.array([t for r in results for t, _ in r.events])
        width = 1e-6 * self.times[-1]
        return np.asarray(np.any(np.abs(self.times[:, None] - instants[None, :]) < width, axis=1))


def signals(result: Result, names: Mapping[str, str]) -> dict[str, Array]:
    """Values in SI by the name that each has in the first diagram; what the other does not know is left out."""
    known = {n: other for n, other in names.items() if other.removeprefix("-") in result.assembly.flat.names}
    probe = Probe(result.assembly, [other.removeprefix("-") for other in known.values()], si=True)
    signs = [-1 if other.startswith("-") else 1 for other in known.values()]
    values = {n: sign * v for n, sign, v in zip(known, signs, probe.values(result), strict=True)}
    return {n: v for n, v in values.items() if np.isfinite(v).all()}


def run(assembly: Assembly, times: Array, tighter: float) -> Result:
    """A run with the usual tolerances, or tighter ones."""
    return Simulator(assembly, times=times, tolerances=Tolerances(RTOL / tighter, ATOL / tighter)).run()


def compared(path: Path, names: tuple[str, ...], seed: int) -> list[Compared]:
    """What comes of relations on the diagram at `path`, which runs; files are written beside it."""
    try:
        reference = Reference(path)
    except HeavebondError as error:
        return [Compared("reference", "not applicable", error.problems[0].code)]
    return [compared_to(reference, path, name, seed) for name in names]


def compared_to(reference: Reference, path: Path, relation: str, seed: int) -> Compared:
    """Try one relation, given the runs of the diagram."""
    try:
        same = RELATIONS[relation](reference.sheet, reference.assembly, Random(seed))
        if same is None:
            return Compared(relation, "not applicable", "")
        return _beside(reference, same, path, relation)
    except HeavebondError as error:
        return Compared(relation, "refused", str(error))
    except Exception:
        return Compared(relation, "traceback", traceback.format_exc(limit=-8))


def write(same: Same, path: Path) -> Path:
    """The files of a sheet beside the first one's."""
    for name, text in same.sheet.files.items():
        target = path.parent / name
        target.parent.mkdir(exist_ok=True)
        target.write_text(text, encoding="utf-8")
    other = path.with_name("same.yaml")
    other.write_text(same.sheet.text(), encoding="utf-8")
    return other


def _beside(reference: Reference, same: Same, path: Path, relation: str) -> Compared:
    assembly = hb.assemble(hb.load(write(same, path)))
    names = {n: other for n in reference.names if (other := same.name(n)) is not None}
    try:
        result = run(assembly, reference.times, TIGHTER)
    except SimulationError:  # at so tight a tolerance, rounding decides whether a stiff machine runs
        result = run(assembly, reference.times, TIGHTER / 2)
    return difference(reference, signals(result, names), relation, result)


def difference(reference: Reference, values: Mapping[str, Array], relation: str, *results: Result, least: float = ROUNDING
               ) -> Compared:
    """Compare signals, by their names in the first diagram, with the run of that diagram, except near events of either run.
    The estimated error of that run is allowed, and the share `least` of the size of each signal."""
    chosen = [k for k, n in enumerate(reference.names) if n in values]
    if not chosen:
        return Compared(relation, "not applicable", "nothing to compare")
    off = np.array([np.abs(values[n] - reference.values[n]) / reference.sizes[n]
                    for n in (reference.names[k] for k in chosen)])
    off[:, reference.near_events(reference.fine, *results)] = 0.0
    off = off[:, :reference.until]
    # the estimate of a single signal may be small by chance: that of all of them counts
    allowed = TIMES * reference.error[:, :reference.until].max(axis=0, initial=0.0) + least
    over = off / allowed
    outcome = "sensitive" if reference.until < len(reference.times) else "same"
    if over.size and over.max() > 1:
        k, j = np.unravel_index(int(over.argmax()), over.shape)
        return Compared(relation, "different", f"{reference.names[chosen[k]]} at {reference.times[j]:.6g} s: off by "
                        f"{off[k, j]:.2g} of its size, {allowed[j]:.2g} are allowed", len(chosen))
    return Compared(relation, outcome, f"{off.max(initial=0.0):.1e}", len(chosen))
