"""Examples of the Modelica Standard Library, rebuilt from components of heavebond, against the reference results.

    python -m benchmarks.modelica RESULTS LIBRARY [NAME ...]

RESULTS is a checkout of https://github.com/modelica/MAP-LIB_ReferenceResults, LIBRARY one of
https://github.com/modelica/ModelicaStandardLibrary, both at version 4.0.0. A diagram beside this file names its example
under `source:` and has the parameters of the example; its outputs have the names of the columns. The positions of bodies
with a length are those of their centres: the lengths are in the free lengths of the springs. `notes:` states what the
diagram does not express as the example does. The tables show for each example the lines of YAML and of Modelica (of the
class itself, without annotations and blank lines), and the largest difference of an output from the reference, relative to
the range of the reference. The references have a tolerance of their own, mostly 1e-6.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import heavebond as hb
from heavebond.text.yaml_source import Scalar, read

Array = NDArray[np.float64]

HERE = Path(__file__).parent
SAME, MOST_MISSING = 1e-9, 0.9  # share of the duration within which two times are one; share of the times in both


def examples() -> dict[str, tuple[str, str]]:
    """For each diagram, by name: its examples, joined by `and`, and its notes; in the order of the examples."""
    texts = {}
    for path in HERE.glob("*.yaml"):
        entries = {key: node.text for key, node in read(path).root.items.items() if isinstance(node, Scalar)}
        texts[path.stem] = (entries["source"].strip(), entries.get("notes", "").strip())
    return dict(sorted(texts.items(), key=lambda item: item[1]))


def row(name: str, modelica: int, difference: float) -> str:
    """The row of an example in the table of its package."""
    (first, *others), notes = examples()[name][0].split(" and "), examples()[name][1]
    lines = len((HERE / f"{name}.yaml").read_text(encoding="utf-8").splitlines())
    return (f"| {', '.join([first.partition('.Examples.')[2], *others])} | {lines} | {modelica} | {difference:.1e} |"
            f" {notes} |").replace("  |", " |")


def reference(path: Path) -> dict[str, Array]:
    """The columns of a file of reference results."""
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows if row])
    return dict(zip((name.strip('"') for name in re.split(r',(?=")', head)), table.T, strict=True))


def lines_of_modelica(library: Path, example: str) -> int:
    """The lines of the class of an example, without annotations and blank lines. The class is a file of its own, or part of
    the file `package.mo` of its package."""
    path = library / (example.replace(".", "/") + ".mo")
    name = example.rpartition(".")[2]
    while not path.is_file():
        path = path.with_name("package.mo") if path.name != "package.mo" else path.parent.with_name("package.mo")
    text = path.read_text(encoding="utf-8")
    model = re.search(rf"^ *model {name}\b.*?^ *end {name};", text, re.DOTALL | re.MULTILINE)
    if model is None:
        raise SystemExit(f"{example}: no model of this name in {path}")
    text = _without_annotations(model.group())
    return sum(line.strip() not in ("", ";") for line in text.splitlines())


def _without_annotations(text: str) -> str:
    """Text of Modelica without its annotations, which end with the parenthesis that matches the first one."""
    kept, start = [], 0
    while (begin := text.find("annotation", start)) >= 0:
        kept.append(text[start:begin])
        depth, start = 0, begin
        for token in re.compile(r'"(?:\\.|[^"\\])*"|[()]', re.DOTALL).finditer(text, begin):
            depth += {"(": 1, ")": -1}.get(token.group(), 0)
            if depth == 0 and token.group() == ")":
                start = token.end()
                break
    return "".join([*kept, text[start:]])


def largest_difference(name: str, columns: dict[str, Array]) -> float:
    """The largest difference of an output of an example from the reference, relative to the range of the reference, at the
    times that both have. At a time that the reference has twice, its value after the event counts."""
    run = hb.simulate(hb.load(HERE / f"{name}.yaml"), rtol=1e-10)
    at = np.searchsorted(columns["time"], run.time + SAME * run.time[-1], side="right") - 1
    both = np.abs(columns["time"][at] - run.time) <= SAME * run.time[-1]
    if both.sum() < MOST_MISSING * len(run.time):
        raise SystemExit(f"{name}: the reference has {both.sum()} of {len(run.time)} times of the run")
    worst = 0.0
    for output in run.assembly.model.show:
        values = columns[output][at[both]]
        span = float(np.ptp(values)) or max(1.0, float(np.abs(values).max()))
        worst = max(worst, float(np.abs(run.display[output][both] - values).max()) / span)
    return worst


def main(results: Path, library: Path, names: list[str]) -> None:
    """Print a table for each package."""
    last = ""
    for name in names or examples():
        example = examples()[name][0].partition(" and ")[0]
        if (package := example.removeprefix("Modelica.").partition(".Examples.")[0]) != last:
            print(f"\n### {package}\n\n| example | lines of YAML | lines of Modelica | largest difference |"
                  " not expressed as there |\n|---|---|---|---|---|")
            last = package
        folder = results / example.replace(".", "/")
        difference = largest_difference(name, reference(folder / f"{folder.name}.csv"))
        print(row(name, lines_of_modelica(library, example), difference), flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
