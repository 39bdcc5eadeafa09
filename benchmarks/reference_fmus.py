"""The Reference FMUs of the Modelica Association in diagrams, beside their published results: `python -m
benchmarks.reference_fmus FOLDER`, a checkout of https://github.com/modelica/Reference-FMUs.

Each FMU is compiled from its source for co-simulation, and runs in a diagram with the interval of its published results. The
published results follow from the fixed step of the FMU itself, so that they agree to rounding.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import zipfile
from pathlib import Path

import numpy as np

import heavebond as hb

MODELS = ("BouncingBall", "Dahlquist", "Feedthrough", "Resource", "Stair", "StateSpace", "VanDerPol")
ROUNDING = 1e-9  # of the range of an output


def build(checkout: Path, model: str, version: int, folder: Path) -> Path:
    """Compile a Reference FMU."""
    source, library = checkout / model, folder / f"{model}.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", f"-DFMI_VERSION={version}", "-DDISABLE_PREFIX",
                    f"-I{checkout / 'include'}", f"-I{source}", *(str(checkout / "src" / name) for name in (
                        f"fmi{version}Functions.c", "cosimulation.c")), str(source / "model.c"), "-o", str(library), "-lm"],
                   check=True)
    place = "binaries/linux64" if version == 2 else "binaries/x86_64-linux"
    path = folder / f"{model}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(source / f"FMI{version}.xml", "modelDescription.xml")
        archive.write(library, f"{place}/{model}.so")
        for extra in source.glob("*.txt"):
            archive.write(extra, f"resources/{extra.name}")
    return path


def published(file: Path) -> dict[str, np.ndarray]:
    """The columns of numbers of a CSV file; the elements of an array `y` are the columns `y_1`, `y_2`, ..."""
    head, *rows = (line.split(",") for line in file.read_text().splitlines())
    columns: dict[str, np.ndarray] = {}
    for name, *texts in zip(head, *rows, strict=True):
        try:
            table = np.array([[float({"true": "1", "false": "0"}.get(part, part)) for part in text.split()]
                              for text in texts])
        except ValueError:  # texts and binary values
            continue
        columns |= {name: table[:, 0]} if table.shape[1] == 1 else {
            f"{name}_{k}": values for k, values in enumerate(table.T, 1)}
    return columns


def difference(checkout: Path, model: str, version: int, folder: Path) -> tuple[float, int]:
    """The largest difference of an output from the published results, over its range, and the number of outputs."""
    build(checkout, model, version, folder)
    results = published(checkout / model / f"{model}_out.csv")
    time = results.pop("time")
    step = float(time[1] - time[0])
    run = hb.simulate(hb.loads(f"""
model: reference
components: {{part: {{is: {model}.fmu, step: {step!r} s}}}}
simulate: {{until: {float(time[-1]) + step / 2!r} s, every: {step!r} s}}
""", folder), allow_fmu=True)
    worst, compared = 0.0, 0
    for name, values in results.items():
        if f"part.{name}" not in run:
            continue
        found = np.asarray(run[f"part.{name}"])[:len(values)]
        size = float(np.ptp(values)) or float(np.abs(values).max()) or 1.0
        # an FMU that ends the run itself has fewer points
        worst = max(worst, float(np.abs(found - values[:len(found)]).max()) / size)
        compared += 1
    assert compared, f"{model} has none of the published outputs"
    return worst, compared


def main() -> None:
    """Print the largest difference of each FMU."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkout", type=Path)
    checkout = parser.parse_args().checkout
    for model in MODELS:
        for version in (2, 3):
            if not (checkout / model / f"FMI{version}.xml").exists():
                continue
            with tempfile.TemporaryDirectory() as name:
                worst, outputs = difference(checkout, model, version, Path(name))
            print(f"{model}, FMI {version}: {outputs} outputs, largest difference {worst:.1e} of the range"
                  + ("" if worst < ROUNDING else ", NOT EQUAL"))


if __name__ == "__main__":
    main()
