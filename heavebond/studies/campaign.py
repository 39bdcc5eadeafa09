"""All cases of a study in parallel on any executor. Completed cases are stored in a folder, so that the same call
continues after an interruption."""

from __future__ import annotations

import hashlib
import json
import math
import time as clock
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heavebond.core import facade
from heavebond.core.cancellation import clear_signal
from heavebond.core.cluster import Cluster
from heavebond.core.errors import Problem, UsageError
from heavebond.core.parallel import Processes, as_done, processors
from heavebond.core.presentation import brief
from heavebond.core.progress import Progress, duration
from heavebond.core.quoting import file_stem
from heavebond.core.reporting import place, reporting
from heavebond.core.units import Unit
from heavebond.core.version import VERSION
from heavebond.core.writable import make_folder, write_text
from heavebond.language.definition import FileInput
from heavebond.studies.axes import StudyCase
from heavebond.studies.calibration import Calibrated, calibrate
from heavebond.studies.run_case import Outcome, checked, worked
from heavebond.studies.study import Study, load_study

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

KEPT = "done"
CALIBRATION = "calibration"
DIED = "the process that worked on this case died, also when it was tried again (killed, or out of memory)"


@dataclass(frozen=True)
class StudyResult(facade.Displayed):
    """The result of a study: the outcome of every case by every procedure, in order; fewer than `jobs` if interrupted.
    `units` are the display units.
    """

    study: Study
    outcomes: tuple[Outcome, ...]
    units: Mapping[str, Unit]
    jobs: int
    calibrated: Calibrated | None = None

    def __repr__(self) -> str:
        return brief(self, self.study.name, f"{len(self.outcomes)} of {self.jobs} cases")

    @property
    def complete(self) -> bool:
        """True if every case has an outcome."""
        return len(self.outcomes) == self.jobs

    def case_of(self, outcome: Outcome) -> StudyCase:
        """The case of an outcome."""
        return self.cases[outcome.case]

    @cached_property
    def cases(self) -> tuple[StudyCase, ...]:
        """Every case of the study."""
        return self.study.cases

    def to_pandas(self) -> pd.DataFrame:
        """The table of the study: a row per case and procedure, a column `name [unit]` for each axis and number."""
        table: pd.DataFrame = facade.call("StudyResult.to_pandas", self)
        return table

    def to_xarray(self) -> xr.Dataset:
        """A dataset with a dimension for each axis, and `procedure` if the study has several; the points of a sample are
        coordinates of the dimension `sample`. Each number has its unit as `attrs["units"]`, NaN without a result; the
        signals of the study over `time` are included if all cases have the same times. UsageError if xarray is missing."""
        dataset: xr.Dataset = facade.call("StudyResult.to_xarray", self)
        return dataset

    def spreads(self) -> list[Any]:
        """The distribution of each number over a sample, for each other case: `mean`, `deviation` and `quantiles`."""
        spreads: list[Any] = facade.call("StudyResult.spreads", self)
        return spreads

    def occurrence_means(self) -> list[Any]:
        """The availability and the mean of each number by the scatter diagram of the study, for each combination of
        levels of the other axes: `available`, `fulfilled`, `means` and `failed`. UsageError without `occurrence:`."""
        means: list[Any] = facade.call("StudyResult.occurrence_means", self)
        return means

    def plot(self) -> list[Figure]:
        """The pictures of the study as matplotlib figures."""
        figures: list[Figure] = facade.call("StudyResult.plot", self)
        return figures

    def value(self, outcome: Outcome, quantity: str) -> float:
        """A number in its display unit; NaN without one."""
        value = outcome.values.get(quantity, math.nan)
        return float(self.units[quantity].from_si(value))

    def published(self, outcome: Outcome, quantity: str, source: int = 0) -> float:
        """The number of a source for this case, in the same unit; NaN without one."""
        published_value = self.study.beside[source].at(quantity, self.case_of(outcome).index) if self.study.beside else None
        return float(self.units[quantity].from_si(published_value)) if published_value is not None else math.nan

    def difference(self, outcome: Outcome, quantity: str, source: int = 0) -> float:
        """(ours - theirs) / |theirs|, NaN if one is missing or theirs is zero, and for unstable gains of ours: a number
        of an unstable machine agrees with none."""
        ours, theirs = self.value(outcome, quantity), self.published(outcome, quantity, source)
        if outcome.unstable:
            return math.nan
        return (ours - theirs) / abs(theirs) if theirs else math.nan

    def of(self, *levels: str, procedure: str = "") -> Outcome:
        """The outcome of the case with these levels (`"without", "0.75 Hz"`), by default for the first procedure."""
        for outcome in self.outcomes:
            names = {level.name for level in self.case_of(outcome).levels}
            if set(levels) <= names and procedure in ("", outcome.procedure):
                return outcome
        raise UsageError([Problem("case-unknown", f"there is no case with {', '.join(levels)} {procedure}".rstrip())])


@reporting
def study(study: Study | str | Path, *, folder: Path | None = None, processes: int | None = None,
              executor: Executor | None = None, fresh: bool = False, progress: Progress | None = None) -> StudyResult:
    """Run every case of a study, each by every procedure of its tuning.

    `study` is a Study, a path or a bundled name. With `folder` each finished case is stored there as JSON, and a later
    call with the same files reads it (unless `fresh`). `processes` cases run in parallel, by default the number of
    processors, or of the places of `executor`. A case whose process dies is repeated once and then reported as failed.
    `progress` is called with a text after each case. Ctrl-C returns the cases finished so far. Raises ModelError for
    mistakes in the study.
    """
    study = study if isinstance(study, Study) else load_study(study)
    units = checked(study)
    say = progress or (lambda text: None)
    jobs = len(study.jobs)
    outcomes: dict[int, Outcome] = {}
    calibrated: Calibrated | None = None
    with ExitStack() as stack:
        number = executor.number if isinstance(executor, Cluster) else min(processes or processors(), jobs)
        if executor is None and number > 1:
            executor = stack.enter_context(Processes(number))
        try:
            study, calibrated = _calibrated(study, folder, fresh, executor, number, say)
            for k, outcome in _outcomes(study, CaseStore.at(folder, study), fresh, executor, number, say):
                outcomes[k] = outcome
        except KeyboardInterrupt:
            clear_signal()
            say("interrupted")
    return StudyResult(study, tuple(outcomes[k] for k in sorted(outcomes)), units, jobs, calibrated)


def _calibrated(study: Study, folder: Path | None, fresh: bool, executor: Executor | None, number: int, say: Progress
                ) -> tuple[Study, Calibrated | None]:
    """The study with its calibrated values, if it requires them."""
    if study.calibration is None:
        return study, None
    store = CaseStore.at(folder, study)
    stored = store.read(CALIBRATION) if store is not None and not fresh else None
    calibrated = Calibrated.from_dict(stored) if stored is not None else calibrate(study, executor, number + 1, say)
    if store is not None and stored is None:
        store.write(CALIBRATION, calibrated.as_dict())
    return replace(study, calibrated=calibrated.values), calibrated


def _outcomes(study: Study, store: CaseStore | None, fresh: bool, executor: Executor | None, number: int, say: Progress
              ) -> Iterator[tuple[int, Outcome]]:
    """The number and outcome of each job: first the stored ones, then the others in the order of completion."""
    jobs = study.jobs
    names = [f"{k:04}_{procedure.name}" if procedure is not None else f"{k:04}" for k, procedure in jobs]
    completed = 0
    remaining = []
    for k, (name, job) in enumerate(zip(names, jobs, strict=True)):
        stored = store.read(name) if store is not None and not fresh else None
        if stored is not None:
            completed += 1
            yield k, Outcome(**stored)
        else:
            remaining.append((k, job))
    told_so_far = _StudyProgress(say, len(jobs), completed)

    def died(k: int, _: BaseException) -> Outcome:
        case, procedure = jobs[k]
        return Outcome(case, procedure.name if procedure is not None else "", problem=DIED)

    if executor is None:
        done_now: Iterator[tuple[int, Outcome]] = (
            (k, worked(study, case, procedure, told_so_far.inside(study, case))) for k, (case, procedure) in remaining)
    else:
        packed = study.packed()
        tasks = ((k, (packed(case), case, procedure)) for k, (case, procedure) in remaining)
        ahead = executor.ahead if isinstance(executor, Cluster) else number + 1
        done_now = as_done(executor, worked, tasks, ahead, instead=died)
    for k, outcome in done_now:
        if store is not None and not outcome.problem:
            store.write(names[k], outcome.as_dict())
        told_so_far.one_more()
        yield k, outcome


class _StudyProgress:
    """Progress of a study: completed cases, and the remaining time at their mean rate."""

    def __init__(self, say: Progress, jobs: int, finished: int):
        self.say, self.jobs, self.first, self.done = say, jobs, finished, finished
        self.began = clock.perf_counter()
        self._tell()

    def one_more(self) -> None:
        self.done += 1
        self._tell()

    def _tell(self) -> None:
        place(self.say, self.done, self.jobs)
        self.say(self.words)

    def inside(self, study: Study, number: int) -> Progress:
        """Progress of a case that runs in this process."""
        name = study.case(number).name
        return lambda text: self.say(f"{self.words}; {name}: {text}")

    @property
    def words(self) -> str:
        completed_here, remaining = self.done - self.first, self.jobs - self.done
        begin = f"{self.done} of {self.jobs} done"
        if not completed_here or not remaining:
            return begin
        return f"{begin}, {duration((clock.perf_counter() - self.began) / completed_here * remaining)} left"


# -- stored results ----------------------------------------------------------------------------------------------------
class CaseStore:
    """Results stored as files in a folder, each with the fingerprint of its inputs."""

    def __init__(self, folder: Path, fingerprint: str):
        self.folder, self.fingerprint = folder / KEPT, fingerprint
        make_folder(self.folder)

    @classmethod
    def at(cls, folder: Path | None, study: Study) -> CaseStore | None:
        """The stored results of a study in a folder, None without a folder."""
        return cls(folder, fingerprint(study)) if folder is not None else None

    def read(self, name: str) -> dict[str, Any] | None:
        """The stored result of that name, None without one for the same files."""
        try:
            stored = json.loads((self.folder / f"{file_stem(name)}.json").read_text(encoding="utf-8"))
            result = stored["found"]
            return result if stored["fingerprint"] == self.fingerprint and isinstance(result, dict) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None  # incomplete, or of another program: it is computed again

    def write(self, name: str, result: Mapping[str, Any]) -> None:
        """Store a result by that name."""
        write_text(self.folder / f"{file_stem(name)}.json", json.dumps({"fingerprint": self.fingerprint, "found": result}))


def fingerprint(study: Study) -> str:
    """Digest of all inputs of an outcome: the study's file, its diagrams, their components and records, the program."""
    files = {study.path, *Path(__file__).parents[1].rglob("*.py")}
    for model in {id(case.levels): case.model for case in study.cases}.values():
        files |= {*model.files, *model.library.files.values()}
        files |= {s.value.file for s in model.settings.values() if isinstance(s.value, FileInput)}
    digest = hashlib.sha256(f"{VERSION} {sorted(study.calibrated.items())}".encode())
    for path in sorted(files):
        digest.update(path.name.encode())
        digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.hexdigest()[:16]
