"""What becomes of one mutant: check and run, and for some all else that the Python interface does with a diagram."""

from __future__ import annotations

import json
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import heavebond as hb
from benchmarks.fuzz.campaign import renew_limit
from benchmarks.fuzz.judging import WRONG, violation
from benchmarks.fuzz.mutants import Mutant, kind_of, mutant
from heavebond.core.errors import HeavebondError
from heavebond.energy_audit.audit import table
from heavebond.language.model import Model
from heavebond.linear.linearisation import Linearisation, start_point
from heavebond.linear.modal_values import energy_shares
from heavebond.linear.operating_point import OperatingPoints, stuck
from heavebond.numerics.dae import Array, Assembly, assemble
from heavebond.numerics.initialise import Start, start
from heavebond.numerics.inputs import pieced
from heavebond.numerics.output_times import grid
from heavebond.numerics.result import Result
from heavebond.numerics.simulator import Simulator
from heavebond.numerics.validity import at_point
from heavebond.pictures.bond_picture import draw_bond_graph
from heavebond.reports.summary import summary

POINTS = 200
EVERY = 10  # one mutant in so many goes through all
RELATED = 2  # so many relations are tried on each of these that ends well
OPENED = 50  # and in so many blocks are opened for the drawing, which takes long
WIDTH = 100
FAULTS = ("traceback", "hang", "no advice", "equation", "not finite", "different")


@dataclass(frozen=True)
class Tried:
    """What became of a mutant: for each step that was tried its outcome, `ran`, `refused` with the codes, or a fault; the
    worst of them is the mutant's `outcome`, and `what` tells of it."""

    seed: int
    root: str
    changed: str
    mutations: tuple[str, ...]
    outcome: str
    what: str
    steps: dict[str, str]
    seconds: float

    def as_dict(self) -> dict[str, object]:
        """For a line of JSON."""
        return asdict(self)


def unfinished(task: tuple[int, ...], outcome: str, what: str, seconds: float) -> Tried:
    """The verdict on a mutant whose process was ended."""
    given = mutant(task[0])
    return Tried(task[0], f"{given.folder.name}/{given.root}", given.changed, given.mutations, outcome, what, {}, seconds)


def tried(seed: int, share: float = 1.0) -> Tried:
    """Write the mutant of a seed into a folder of its own, and put it through what a user would, over a share of the time
    that is run otherwise."""
    given, began = mutant(seed), time.process_time()
    with sandbox(given) as path:
        attempts = _Attempts(path, everything=seed % EVERY == 0, opened=seed % OPENED == 0, share=share)
        attempts.go()
        if attempts.everything and attempts.ended_well and share == 1.0:
            attempts.written_differently(seed)
    steps = attempts.steps
    worst = min(steps.values(), key=lambda s: _rank(s[0]), default=("refused", ""))
    return Tried(seed, f"{given.folder.name}/{given.root}", given.changed, given.mutations, *worst,
                 {name: outcome for name, (outcome, _) in steps.items()}, time.process_time() - began)


def _rank(outcome: str) -> int:
    return FAULTS.index(outcome) if outcome in FAULTS else len(FAULTS) + (outcome != "refused")


@contextmanager
def sandbox(given: Mutant) -> Iterator[Path]:
    """A folder with the files of a mutant, copies of the components beside them, to which relations add others, and links to
    the records; its root file."""
    with tempfile.TemporaryDirectory(prefix="mutant_") as name:
        folder = Path(name) / given.folder.name
        for path, text in given.files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
        for beside in given.folder.iterdir():
            if beside.name == "components":
                for component in beside.rglob("*.yaml"):
                    copy = folder / component.relative_to(given.folder)
                    if not copy.exists():
                        copy.parent.mkdir(parents=True, exist_ok=True)
                        copy.write_bytes(component.read_bytes())
            elif beside.suffix != ".yaml" and not (folder / beside.name).exists():
                (folder / beside.name).symlink_to(beside.resolve())
        yield folder / given.root


class _Attempts:
    """Steps and what came of each: (outcome, what)."""

    def __init__(self, path: Path, everything: bool, opened: bool, share: float = 1.0):
        self.path, self.everything, self.opened, self.share = path, everything, opened, share
        self.steps: dict[str, tuple[str, str]] = {}
        self.ended_well = False  # a run of a plain diagram, with a clean verdict

    def go(self) -> None:
        head = kind_of(self.path.read_text(encoding="utf-8")) or "model"
        model = self._try("read", lambda: _read(self.path, head))
        if not isinstance(model, Model):
            return
        assembly = self._try("check", lambda: _checked(model))
        if isinstance(assembly, Assembly):
            result = self._try("run", lambda: _run(assembly, self.share))
            if isinstance(result, Result):
                self._judged(result)
                self.ended_well = head == "model" and not result.verdict.findings
        if not self.everything:
            return
        self._try("draw", lambda: (hb.draw(model, open_all=self.opened, values=True), draw_bond_graph(model)))
        if isinstance(assembly, Assembly):
            self._try("modes", lambda: _modes(model))
            self._try("energy", lambda: table(hb.energy(assembly, **_short(assembly, self.share))))
        if head == "experiment":
            self._try("compare", lambda: hb.compare(self.path).as_dict())
        elif isinstance(assembly, Assembly):
            self._try("compare", lambda: _compared(self.path, assembly, self.share))

    def _try(self, name: str, step: Callable[[], object]) -> object:
        renew_limit()
        try:
            found = step()
        except HeavebondError as error:
            silent = not error.problems or [p for p in error.problems if not p.hint.strip() or not p.message.strip()]
            codes = " ".join(sorted({p.code for p in error.problems}))
            self.steps[name] = ("no advice", str(error)) if silent else ("refused", codes)
            return None
        except Exception:
            self.steps[name] = "traceback", f"{name}: {traceback.format_exc(limit=-8)}"
            return None
        self.steps[name] = "ran", ""
        return found

    def written_differently(self, seed: int) -> None:
        """The same machine in other words, by some relations that the seed chooses; what comes of each is a step."""
        from benchmarks.fuzz.metamorphic import DIFFERENCES, compared
        from benchmarks.fuzz.relations import RELATIONS

        renew_limit()
        for found in compared(self.path, tuple(Random(seed).sample(sorted(RELATIONS), RELATED)), seed):
            outcome = "different" if found.outcome in DIFFERENCES else found.outcome
            self.steps[found.relation] = outcome, f"{found.relation}: {found.what}"

    def _judged(self, result: Result) -> None:
        """A run that ended well must hold numbers, for which the equations hold."""
        values = result.signals(_listed(result.assembly))
        bad = [name for name, v in values.items() if not np.isfinite(v).all()]
        if bad and not result.verdict.failed:
            self.steps["run"] = "not finite", f"{bad[0]} of {len(bad)}"
        elif self.everything:
            wrong = self._try("equations", lambda: violation(result))
            if isinstance(wrong, tuple) and wrong[0] > WRONG:
                self.steps["equations"] = "equation", f"{wrong[1]} is off by {wrong[0]:.2g} of its terms"


def _read(path: Path, head: str) -> Model:
    if head == "experiment":
        return hb.load_experiment(path).model
    return hb.load_study(path).model if head == "study" else hb.load(path)


def _checked(model: Model) -> Assembly:
    """As `heavebond check` does."""
    assembly = assemble(model)
    times = grid(model, None, None) if assembly.flat.inputs else np.zeros(1)
    u = pieced(assembly.flat, 0.0, float(times[-1])).at(np.zeros(1))[:, 0] if assembly.flat.inputs else \
        np.zeros(assembly.arguments[4].numel())
    begun: Start = start(assembly, 0.0, u)
    summary(assembly, begun).text(WIDTH)
    str(at_point(assembly, start_point(begun, u)))
    return assembly


def output_times(assembly: Assembly, share: float = 1.0) -> Array:
    """The first output points of a run, or as many over the whole of it where the diagram does not say how dense; over a
    share of that time."""
    times = share * grid(assembly.model, None, None)
    return times[:POINTS + 1] if assembly.model.every is not None else times[::max(1, (len(times) - 1) // POINTS)]


def _short(assembly: Assembly, share: float) -> dict[str, Any]:
    times = output_times(assembly, share)
    return {"until": float(times[-1]), "every": float(times[1])} if len(times) > 1 else {}


def _run(assembly: Assembly, share: float) -> Result:
    """As `heavebond run` does."""
    solver = assembly.model.solver
    result = Simulator(assembly, times=output_times(assembly, share), solver=solver.text if solver else None).run()
    for values in result.signals(_listed(assembly)).values():
        with np.errstate(over="ignore"):
            values.min(), values.max(), np.mean(values**2)
    str(result.verdict)
    return result


def _listed(assembly: Assembly) -> list[str]:
    return list(assembly.model.show) or assembly.state_names or [u.name for u in assembly.flat.unknowns]


def _modes(model: Model) -> None:
    operating = OperatingPoints(model, None)
    point = operating.at()
    found = Linearisation(operating.assembly).at(point).modes()
    energy_shares(operating.assembly, point, found)
    stuck(operating.assembly, point)


def _compared(path: Path, assembly: Assembly, share: float) -> None:
    """The diagram beside a record of noise: what it is laid over is not what counts here."""
    times = output_times(assembly, share)
    shown = {f"c{k}": name for k, name in enumerate(_listed(assembly)[:3])}
    noise = np.random.default_rng(1).standard_normal((len(times), len(shown)))
    rows = [",".join(f"{v:.17g}" for v in (t, *row)) for t, row in zip(times, noise, strict=True)]
    (path.parent / "noise_record.csv").write_text("\n".join([f"time,{','.join(shown)}", *rows, ""]), encoding="utf-8")
    show, unknowns = assembly.model.show, assembly.flat.unknowns
    formulas = {name: (show[name].text, show[name].unit) if name in show else
                (name, unknowns[assembly.flat.names[name]].unit.text) for name in shown.values()}
    outputs = [f'  {column}: {{is: {json.dumps(formulas[name][0])}, column: {column}, unit: "{formulas[name][1]}"}}'
               for column, name in shown.items()]
    text = "\n".join(["experiment: noise", f"model: {path.name}", "records: {noise: {file: noise_record.csv, use: fit}}",
                      "time: {column: time, unit: s}", "outputs:", *outputs, ""])
    experiment = path.with_name("noise_experiment.yaml")
    experiment.write_text(text, encoding="utf-8")
    hb.compare(experiment).as_dict()
