"""Diagnosis on a machine of real size: effects hidden in the crown-mounted compensator, sought with the whole catalogue.

Records are made by the detailed machine (plunger cylinder, line, piston accumulator and gas bottles, two active cylinders
and two valves) with an effect switched on, in two irregular seas, with other values of the data sheet within their
tolerances, tight tolerances of the integration, and noise; they are diagnosed from the simplified diagram as designed:

    python -m benchmarks.diagnosis.compensator                  what is not on disk yet
    python -m benchmarks.diagnosis.compensator leakage          these cases anew
    python -m benchmarks.diagnosis.compensator leakage --report leakage.html
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

import heavebond as hb
from benchmarks.diagnosis import keeping
from benchmarks.diagnosis.judging import SECONDS, told
from benchmarks.diagnosis.making import TIGHT, generator
from benchmarks.diagnosis.making import Case as Judged
from benchmarks.diagnosis.rigs import HERE, Rig, sea
from benchmarks.diagnosis.truths import Truth
from heavebond.core.errors import listing
from heavebond.diagnosis.diagnose import Diagnosis
from heavebond.estimation.experiment import Experiment
from heavebond.localise.misfit import localize
from heavebond.reports.report import report as page

STUDY = "compensator"
SEAS = {"train": (11, 11.0), "validate": (29, 9.5)}  # seed, and peak period in s
SHARE = 0.6  # of the data sheet's tolerance, within which the machine's own values are drawn
PLUNGER = np.pi / 4 * 0.4**2  # m**2
GAS = 42e3 * 5.68  # N/m * m**3: stiffness times volume of the gas, of which 0.55 m**3 are in the accumulator


@dataclass(frozen=True)
class Effect:
    """What can be hidden: the numbers (SI) of the machine, by the names that the simplified diagram has for them; the entry
    of the catalogue that it is, and class and place of the answers that are right."""

    numbers: Mapping[str, float]
    label: str
    accepted: frozenset[tuple[str, frozenset[str]]]


def answers(*kinds: str, at: Sequence[str]) -> frozenset[tuple[str, frozenset[str]]]:
    """Each class at one place."""
    return frozenset((kind, frozenset(at)) for kind in kinds)


FRICTION = Effect(
    {"cmc.friction.F_c": 12e3, "cmc.friction.F_s": 22.8e3, "cmc.friction.sigma_2": 10e3, "cmc.friction.k_p": 0.4e-4},
    "Friction between platform and crown, pressed by cmc.main_cylinder",
    answers("dry friction", "pressure-dependent friction", at=("platform", "crown")))
LEAKAGE = Effect({"ahc.cylinder.leakage": 6e-11}, "Cylinder in ahc.cylinder (leakage)",
                 answers("internal leakage", "leakage", at=("ahc.chamber_a", "ahc.chamber_b")))
OVERLAP = Effect({"ahc.valve.overlap": 0.03}, "ProportionalValve43 in ahc.valve (overlap)",
                 answers("valve overlap", at=("ahc.valve",)))


@dataclass(frozen=True)
class Case:
    """What is hidden, whether the active part is bypassed, and the significant height of the seas in m."""

    hidden: tuple[Effect, ...] = ()
    passive: bool = False
    height: float = 1.0
    seconds: float = 80.0
    rate: float = 20.0

    @property
    def rig(self) -> Rig:
        """The simplified diagram with its channels and what is free, and the detailed one beside it."""
        name = f"compensator{'_passive' if self.passive else ''}"
        return Rig(name, HERE / f"{name}.yaml", self.seconds, self.rate, "vessel.u", sea,
                   {"ahc.cylinder": ("ahc.chamber_a", "ahc.chamber_b"), "cmc.gas": ("platform", "crown")})

    @property
    def numbers(self) -> dict[str, float]:
        """All that is switched on (SI)."""
        return {name: value for effect in self.hidden for name, value in effect.numbers.items()}


CASES = {
    "nothing": Case(),
    "nothing passive": Case((), True, 0.5),
    "friction passive": Case((FRICTION,), True, 0.5),
    "friction": Case((FRICTION,)),
    "leakage": Case((LEAKAGE,)),
    "overlap": Case((OVERLAP,)),
    "leakage and overlap": Case((LEAKAGE, OVERLAP)),
}


def made(case: Case, folder: Path, seed: str = "compensator") -> tuple[Experiment, dict[str, float]]:
    """Both records as they come from the machine, in `folder`; the experiment on them, and the values (SI) that the machine
    has where the data sheet leaves a tolerance, by the names of the simplified diagram."""
    base, time = case.rig.base, case.rig.time
    rng = generator(seed, *case.numbers)
    values = {f.name: (f.range.low + f.range.high) / 2 + SHARE * rng.uniform(-1, 1) * (f.range.high - f.range.low) / 2
              for f in base.free.values()}
    records = {}
    for name, record in base.records.items():
        machine = hb.loads(_at_sea(case.rig.truth.path, *SEAS[name], case.height), folder)
        run = hb.Simulator(hb.assemble(machine), times=time, tolerances=TIGHT).run(detailed({**values, **case.numbers}))
        columns = {base.time.column: time, base.inputs["vessel.u"].column: run["platform.x"]}
        for shown, output in base.outputs.items():  # both diagrams show what is measured by the same names
            columns[output.column] = run.display[shown] + (output.noise or 0.0) * rng.standard_normal(len(time))
        records[name] = replace(record, file=folder / f"{name}.csv")
        pd.DataFrame(columns).to_csv(records[name].file, index=False, float_format="%.8g")
    return replace(base, records=records), values


def detailed(values: Mapping[str, float]) -> dict[str, float]:
    """Numbers of the simplified machine (SI) as those of the detailed one: half of each flow goes through each of two valves
    and pistons, the second following the first; c = n p A**2/V of all gas; d = R A**2."""
    found: dict[str, float] = {}
    for name, value in values.items():
        match name:
            case "cmc.gas.c":
                found["cmc.bottles.V"] = GAS / value - 0.55
            case "cmc.gas.d":
                found["cmc.line.R"] = value / PLUNGER**2
            case "ahc.valve.q_r" | "ahc.cylinder.leakage":
                found[name.replace(".valve.", ".valve_1.").replace(".cylinder.", ".cylinder_1.")] = value / 2
            case "ahc.valve.f_n":
                found["ahc.valve_1.f_n"] = value
            case "ahc.valve.overlap":
                found |= {"ahc.valve_1.overlap": value, "ahc.valve_2.overlap": value}
            case "ahc.cylinder.beta":
                found |= {"ahc.cylinder_1.beta": value, "cmc.plunger.beta": value}
            case _:
                found[name] = value
    return found


def _at_sea(diagram: Path, seed: int, period: float, height: float) -> str:
    """The text of the diagram in an irregular sea."""
    waves = f"{{is: IrregularSea, H_s: {height} m, T_p: {period} s, gamma: 3.3, t_r: 6 s, seed: {seed}}}"
    return f"model: machine\nextends: {diagram}\ncomponents: {{wave: {waves}}}\n"


def diagnosed(name: str, folder: Path) -> tuple[dict[str, object], Diagnosis]:
    """One case from making its records, in `folder`, to what was said of them, in one process."""
    case = CASES[name]
    experiment, values = made(case, folder)
    began = clock.process_time()
    found = hb.diagnose(experiment, steps=max(1, len(case.hidden)), number=1, seconds=SECONDS)
    processor = clock.process_time() - began
    truth = {**values, **case.numbers}
    last = found.findings[-1].fit if found.findings else found.fitted
    fitted = {p: v for p, v in last.values.items() if p in truth} if last is not None else {}
    row = {"key": name, "values": truth, "fitted": fitted, "processor": processor, "megabytes": _megabytes(),
           "scored": len(found.steps[0].scores), **told(case.rig, judged(case, experiment, truth, found), found),
           "parameters": [{"name": p.name, "value": p.value, "interval": list(p.interval), "unit": p.unit}
                          for f in found.findings for p in f.parameters]}
    return row, found


def judged(case: Case, experiment: Experiment, values: Mapping[str, float], found: Diagnosis) -> Judged:
    """The case as the benchmarks judge it: the answers that are right, and the misfit of the fitted base model."""
    truths = tuple(Truth(effect.label, effect.label) for effect in case.hidden)
    return Judged(experiment, truths, tuple(e.accepted for e in case.hidden), (), (), values, found.steps[0].chi2_fit - 1)


def _megabytes() -> float:
    """Of this process at its largest."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def command(description: str | None, study: str, cases: Mapping[str, Case],
            diagnose: Callable[[str, Path], tuple[dict[str, object], Diagnosis]]) -> None:
    """The command line of a study: diagnose the cases that are named, or that are not on disk yet, keep and print what was
    found."""
    reading = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    reading.add_argument("cases", nargs="*", metavar="CASE", help="which (default: those that are not on disk yet)")
    reading.add_argument("--report", type=Path, help="where the page about the last of them is written")
    asked = reading.parse_args()
    done = keeping.read(study)
    if unknown := set(asked.cases) - cases.keys():
        reading.error(f"no such case: {listing(sorted(unknown))}; there are {listing(cases)}")
    diagnose_cases(study, asked.cases or [name for name in cases if name not in done], diagnose, asked.report)


def diagnose_cases(study: str, names: Sequence[str], diagnose: Callable[[str, Path], tuple[dict[str, object], Diagnosis]],
                   report: Path | None) -> None:
    """Diagnose these cases, keep and print the results, and write the page about each to `report`."""
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            row, found = diagnose(name, Path(folder))
            keeping.add(study, row)
            print(f"{name}: {row['outcome']}, {row['verdict']}, {row['processor']:.0f} s of processor time")
            print(f"  {row['words']}", flush=True)
            if report is not None:
                report.write_text(page(found, localize(found.experiment, values=found.fitted)), encoding="utf-8")


if __name__ == "__main__":
    command(__doc__, STUDY, CASES, diagnosed)
