"""Examples of the Modelica Standard Library, rebuilt from components of heavebond, against the reference results.

    python -m benchmarks.modelica FOLDER

FOLDER is a checkout of https://github.com/modelica/MAP-LIB_ReferenceResults, with the results of version 4.0.0 of the
library. The diagrams beside this file have the parameters of the examples; their outputs have the names of the columns. The
positions of bodies with a length are those of their centres: the lengths are in the free lengths of the springs. The table
shows for each example the lines of YAML, the largest difference of an output from the reference, relative to the range of
the reference, and the output with this difference. The references have a tolerance of their own.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import heavebond as hb

Array = NDArray[np.float64]

MECHANICS = "Mechanics/Translational/Examples"
EXAMPLES = {
    "accelerate": f"{MECHANICS}/Accelerate", "damper": f"{MECHANICS}/Damper",
    "initial_conditions": f"{MECHANICS}/InitialConditions", "oscillator": f"{MECHANICS}/Oscillator",
    "sign_convention": f"{MECHANICS}/SignConvention", "why_arrows": f"{MECHANICS}/WhyArrows",
    "backlash": "Mechanics/Rotational/Examples/Backlash", "rolling_wheel": "Mechanics/Rotational/Examples/RollingWheel",
    "first": "Mechanics/Rotational/Examples/First", "two_masses": "Thermal/HeatTransfer/Examples/TwoMasses",
    "controlled_temperature": "Thermal/HeatTransfer/Examples/ControlledTemperature",
    "cauer_low_pass": "Electrical/Analog/Examples/CauerLowPassAnalog"}
HERE = Path(__file__).parent
SAME, MOST_MISSING = 1e-6, 0.9  # share of the duration within which two times are one; share of the times in both


def reference(path: Path) -> dict[str, Array]:
    """The columns of a file of reference results."""
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows if row])
    return dict(zip((name.strip('"') for name in head.split(",")), table.T, strict=True))


def largest_difference(name: str, columns: dict[str, Array]) -> tuple[float, str]:
    """The largest difference of an output of an example from the reference, relative to the range of the reference, and the
    output; at the times that both have. At a time that the reference has twice, its value after the event counts."""
    run = hb.simulate(hb.load(HERE / f"{name}.yaml"), rtol=1e-10)
    at = np.searchsorted(columns["time"], run.time + SAME * run.time[-1], side="right") - 1
    both = np.abs(columns["time"][at] - run.time) <= SAME * run.time[-1]
    if both.sum() < MOST_MISSING * len(run.time):
        raise SystemExit(f"{name}: the reference has {both.sum()} of {len(run.time)} times of the run")
    worst = (0.0, "")
    for output in run.assembly.model.show:
        values = columns[output][at[both]]
        span = float(np.ptp(values)) or max(1.0, float(np.abs(values).max()))
        worst = max(worst, (float(np.abs(run.display[output][both] - values).max()) / span, output))
    return worst


def main(folder: Path) -> None:
    """Print the table."""
    print("| example | lines of YAML | largest difference | output |\n|---|---|---|---|")
    for name, example in EXAMPLES.items():
        path = folder / "Modelica" / example / f"{example.rpartition('/')[2]}.csv"
        difference, output = largest_difference(name, reference(path))
        lines = len((HERE / f"{name}.yaml").read_text(encoding="utf-8").splitlines())
        print(f"| {example.replace('/', '.')} | {lines} | {difference:.1e} | {output} |")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]))
