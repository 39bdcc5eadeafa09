"""Diagnosis on a machine of real size: effects hidden in the crown-mounted compensator.

Records are made by the diagram with an effect switched on, in two irregular seas, with other values of the data sheet within
their tolerances, tight tolerances of the integration, and noise; they are diagnosed from the diagram as designed:

    python -m benchmarks.diagnosis.compensator            all cases
    python -m benchmarks.diagnosis.compensator leakage    one of them
"""

from __future__ import annotations

import resource
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

import heavebond as hb
from benchmarks.diagnosis.making import TIGHT, generator
from heavebond.dae import Array
from heavebond.experiment import Experiment

HERE = Path(__file__).parent
FRICTION = {"cmc.friction.F_c": 12e3, "cmc.friction.F_s": 22.8e3, "cmc.friction.sigma_2": 10e3, "cmc.friction.k_p": 0.4e-4}
LEAKAGE = {"ahc.cylinder.leakage": 6e-11}
OVERLAP = {"ahc.valve.overlap": 0.03}
SEAS = {"train": (11, 11.0), "validate": (29, 9.5)}  # seed, and peak period in s
SHARE = 0.6  # of the data sheet's tolerance, within which the machine's own values are drawn
# what the loop's own effects are sought among where the whole catalogue would take minutes more
NARROW = ("internal leakage", "valve overlap", "entrained air")


@dataclass(frozen=True)
class Case:
    """What is hidden (SI), whether the active part is bypassed, the significant height of the seas in m, and the classes
    that are tried (none: all)."""

    hidden: Mapping[str, float]
    passive: bool = False
    height: float = 1.0
    classes: Sequence[str] = ()
    seconds: float = 80.0
    rate: float = 20.0

    @property
    def experiment(self) -> Experiment:
        """The diagram as designed with its channels and what is free; its records are not there yet."""
        return hb.load_experiment(HERE / f"compensator{'_passive' if self.passive else ''}.yaml")

    @property
    def time(self) -> Array:
        """Instants of the samples (N,)."""
        return np.arange(round(self.seconds * self.rate) + 1) / self.rate


CASES = {
    "nothing": Case({}),
    "nothing, passive": Case({}, True, 0.5),
    "friction, passive": Case(FRICTION, True, 0.5, ("dry friction", "viscous damping")),
    "friction": Case(FRICTION, classes=("dry friction", "viscous damping")),
    "leakage": Case(LEAKAGE),
    "overlap": Case(OVERLAP, classes=NARROW),
    "leakage and overlap": Case({**LEAKAGE, **OVERLAP}, classes=NARROW),
}


def made(case: Case, folder: Path, seed: str = "compensator") -> tuple[Experiment, dict[str, float]]:
    """Both records as they come from the machine, in `folder`; the experiment on them, and the values (SI) that the machine
    has where the data sheet leaves a tolerance."""
    base, time = case.experiment, case.time
    rng = generator(seed, *case.hidden)
    values = {f.name: (f.range.low + f.range.high) / 2 + SHARE * rng.uniform(-1, 1) * (f.range.high - f.range.low) / 2
              for f in base.free.values()}
    records = {}
    for name, record in base.records.items():
        machine = hb.loads(_at_sea(base.model.path, *SEAS[name], case.height), folder)
        run = hb.Simulator(hb.assemble(machine), times=time, tolerances=TIGHT).run({**values, **case.hidden})
        columns = {base.time_column: time, base.inputs["vessel.u"].column: run["platform.x"]}
        for output in base.outputs.values():
            columns[output.column] = run[output.shown.name] + (output.noise or 0.0) * rng.standard_normal(len(time))
        records[name] = replace(record, file=folder / f"{name}.csv")
        pd.DataFrame(columns).to_csv(records[name].file, index=False, float_format="%.8g")
    return replace(base, records=records), values


def _at_sea(diagram: Path, seed: int, period: float, height: float) -> str:
    """The text of the diagram in an irregular sea."""
    sea = f"{{is: IrregularSea, H_s: {height} m, T_p: {period} s, gamma: 3.3, t_r: 6 s, seed: {seed}}}"
    return f"model: machine\nextends: {diagram}\ncomponents: {{wave: {sea}}}\n"


def main(names: Sequence[str]) -> None:
    """Diagnose the cases; print what was found, chi-square on what was not fitted, fitted values beside the true ones."""
    for name in names or CASES:
        case = CASES[name]
        with tempfile.TemporaryDirectory() as folder:
            experiment, values = made(case, Path(folder))
            found = hb.diagnose(experiment, auto=len(case.hidden) > 1, classes=case.classes)
        print(f"{name}: {found.verdict}, {found.seconds:.0f} s")
        print(*(f"  {line}" for line in found.words), sep="\n")
        for rung in found.ladder:
            print(f"  {rung.name}: {100 * rung.error_held_out:.3g} %, chi-square {rung.chi2_held_out:.4g}")
        last = found.findings[-1].fit if found.findings else found.fitted
        for path, true in {**values, **case.hidden}.items():
            if last is not None and path in last.values:
                print(f"  {path}: {last.values[path]:.4g}, in truth {true:.4g}")
    own, others = (resource.getrusage(who).ru_maxrss / 1e3 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    print(f"largest process {max(own, others):.0f} MB")


if __name__ == "__main__":
    main(sys.argv[1:])
