"""A full diagnosis of a bundled rig, and where its time goes; what a run of its search costs.

The processor time of the whole command `heavebond diagnose`, with all that it starts, for each rig of a table or some:

    python -m benchmarks.diagnosing
    python -m benchmarks.diagnosing cylinder compensator
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import heavebond as hb
from benchmarks.diagnosis.independent import write_case
from benchmarks.diagnosis.long_drive import write_drive
from benchmarks.diagnosis.rigs import RIGS
from benchmarks.measuring import Figure, cpu, duration, paired, process, spoken
from heavebond.diagnosis.candidates.catalogue import single_candidates
from heavebond.diagnosis.diagnose import Diagnosis, diagnose
from heavebond.diagnosis.search.base_model import SEARCH, Base, searched
from heavebond.estimation.residuals import Run
from heavebond.estimation.starter_folder import new as start_folder
from heavebond.numerics.quick_simulation import QuickSimulator
from heavebond.numerics.simulator import Simulator

RIG, MISSING = "passive", "dry friction"
HELD = "cylinder"
LIMIT = 60.0
# s; of the compensator the valve's overlap is sought, with the whole catalogue, in records of an independent program
GOALS = {"first": 5.0, "passive": 8.0, "cylinder": 25.0, "compensator": 60.0, "drive": 120.0}
MODULES = ("heavebond.commands.diagnose", "heavebond.diagnosis.diagnose", "heavebond.localise.misfit",
           "heavebond.reports.report", "scipy.optimize")
# what a diagnosis says it is doing, by how its words begin; these two are said when they are done, the others before
PHASES = {"simulating": "comparing with all records",
          "fitting the free parameters": "fitting the free parameters", "scoring": "scoring candidates",
          "refitting": "refitting candidates", "comparing": "following the best closely",
          "confirming": "confirming the one chosen", "trying": "trying fixed values",
          "learning": "learning a curve", "is ": "looking back",
          "": "telling alternatives apart"}
DONE = ("scoring candidates", "refitting candidates")


class Watch:
    """Processor time by phase, from what a diagnosis says on its way."""

    def __init__(self) -> None:
        self.phase, self.since = PHASES["fitting the free parameters"], time.process_time()
        self.spent: dict[str, float] = {}

    def __call__(self, text: str) -> None:
        words = text.removeprefix("step 1: ")
        phase = next(name for begin, name in PHASES.items() if words.startswith(begin))
        now = time.process_time()
        # the first to be scored or refitted comes after another phase: the fit, and what is left by it
        of = phase if phase in DONE and self.phase in DONE else self.phase
        self.spent[of] = self.spent.get(of, 0.0) + now - self.since
        self.phase, self.since = phase, now


def watched() -> tuple[Diagnosis, Watch]:
    """The diagnosis in this process alone, so that all of its processor time is seen."""
    watch = Watch()
    found = diagnose(hb.load_experiment(RIGS[RIG].experiment), number=1, progress=watch)
    watch("")
    return found, watch


def figures() -> list[Figure]:
    """Processor time of one diagnosis in one process; several share it out."""
    began = time.process_time()
    found, watch = watched()
    took = time.process_time() - began
    assert found.verdict == "effect" and MISSING in found.findings[0].kinds, found.words
    step = found.steps[0]
    what = f"{RIG} rig: diagnosis, {len(step.scores)} candidates scored, {len(step.trials)} refitted, one process"
    shares = sorted(watch.spent.items(), key=lambda pair: -pair[1])
    return [*searches(), *commands(), Figure(what, duration(took), f"≤ {LIMIT:g} s", took <= LIMIT),
            *(Figure(f"{RIG} rig: {phase}", f"{100 * spent / took:.0f} %") for phase, spent in shares if spent > 0)]


def commands() -> list[Figure]:
    """Processor time of the whole command for each rig."""
    return [command(name) for name in GOALS]


def command(name: str) -> Figure:
    """Processor time of the whole command `heavebond diagnose`, in one process."""
    with tempfile.TemporaryDirectory() as folder:
        experiment = written(name, Path(folder))
        process("-c", f"import {', '.join(MODULES)}")  # as bytecode, as in an installation
        before = cpu()
        process("-c", "from heavebond.cli import main; main()", "diagnose", str(experiment), "--processes", "1", "--folder",
                folder)
        took = cpu() - before
    return Figure(f"{name} rig: the command `diagnose`", duration(took), f"≤ {GOALS[name]:g} s", took <= GOALS[name])


def written(name: str, folder: Path) -> Path:
    """The experiment of a rig, written to the folder where it is not bundled."""
    match name:
        case "first":
            start_folder(folder / "rig", None)
            return folder / "rig" / "measured.yaml"
        case "compensator":
            return write_case("overlap", folder)
        case "drive":
            return write_drive(folder / "drive")
        case _:
            return RIGS[name].experiment


def searches() -> list[Figure]:
    """Runs with sensitivities to all that is free: as a search makes them, by IDAS at the same tolerances, and with the
    input held at each sample; and a diagram with a candidate, from its change to the equations of its runs."""
    search, idas, held = run(QuickSimulator), run(Simulator), run(QuickSimulator, "hold")
    return [Figure(f"{HELD} rig: run of a search / by IDAS", spoken(paired(search, idas))),
            Figure(f"{HELD} rig: run of a search with its input held / joined", spoken(paired(held, search))),
            Figure(f"{HELD} rig: assembly of a candidate / run of a search", spoken(paired(assembly(), search)))]


def assembly() -> Callable[[], object]:
    """The diagram with one candidate of the catalogue assembled, and its runs prepared."""
    problem = searched(hb.load_experiment(RIGS[HELD].experiment))
    base = Base.at(problem, problem.start)
    candidate = next(c for c in single_candidates(problem.experiment) if c.vanishes)

    def assembled() -> object:
        base.diagrams.clear()
        return base.runs(candidate.change, [n.name for n in candidate.vanishing])

    return assembled


def run(kind: type[Simulator], between: str = "spline") -> Callable[[], object]:
    """One run of the record that is fitted."""
    experiment = hb.load_experiment(RIGS[HELD].experiment)
    inputs = {name: replace(given, interpolation=between) for name, given in experiment.inputs.items()}
    record = next(r for r in experiment.records.values() if r.use == "fit")
    ready = Run(replace(experiment, inputs=inputs), record, list(experiment.free), SEARCH, kind=kind)
    return lambda: ready.residuals({})


def main() -> None:
    """Print the processor time of the rigs that are named, or of all."""
    reading = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reading.add_argument("rigs", nargs="*", metavar="RIG", help=f"which of {', '.join(GOALS)} (default: all)")
    asked = reading.parse_args().rigs
    if unknown := [name for name in asked if name not in GOALS]:
        reading.error(f"no such rig: {', '.join(unknown)}; there are {', '.join(GOALS)}")
    for name in asked or GOALS:
        found = command(name)
        print(f"{found.what}: {found.measured} ({found.target})", flush=True)


if __name__ == "__main__":
    main()
