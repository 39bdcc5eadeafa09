"""Search of the values of every structure of `published_structures` for the published numbers.

    python -m benchmarks.published_search                        # all; the tables of docs/published_structures.md
    python -m benchmarks.published_search "first order" --population 128 --repeats 4
    python -m benchmarks.published_search --read                 # tables of the recorded results

The objective counts the numbers that are not met and has a smaller smooth part. It jumps where one of two minima of the
index becomes the lower one, so the search is differential evolution, from Sobol points and the values of the model.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from benchmarks.published_structures import (
    BOX,
    FINE,
    FREE_FLOW,
    OURS,
    PUBLISHED,
    STRUCTURES,
    TOLERANCES,
    Array,
    Structure,
    numbers,
)
from heavebond.core.threads import single

RESULTS = Path(__file__).with_name("published_structures.json")
BOXES = {"data sheet": (*STRUCTURES, *FREE_FLOW), "wide": STRUCTURES}  # boxes of values, and the structures searched in each


class Kept(TypedDict):
    """What the file keeps of a result."""

    values: dict[str, float]
    numbers: list[float]
    ends: list[float]
    left_out: list[float]
    evaluations: int
    most: dict[str, int]


def kept_results(path: Path) -> dict[str, dict[str, Kept]]:
    """Recorded results by box and structure."""
    found: dict[str, dict[str, Kept]] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return found


def place(name: str, value: float, wide: bool) -> float:
    """Coordinate of a value in the unit cube."""
    low, high, logarithmic, least, most = BOX[name]
    low, high = (least, most) if wide else (low, high)
    share = np.log(value / low) / np.log(high / low) if logarithmic else (value - low) / (high - low)
    return float(np.clip(share, 0, 1))


def values_at(structure: Structure, points: Array, wide: bool) -> dict[str, Array]:
    """Values of points (n, d) of the unit cube; those that do not act are ours."""
    found = {name: np.full((len(points), 1), value) for name, value in OURS.items()}
    for name, u in zip(structure.free, points.T, strict=True):
        low, high, logarithmic, least, most = BOX[name]
        low, high = (least, most) if wide else (low, high)
        found[name] = (low * (high / low) ** u if logarithmic else low + (high - low) * u)[:, None]
    return found


def misses(found: Array) -> Array:
    """(n, 15) how far each number is beyond its tolerance, in tolerances; zero where it is met."""
    return np.asarray(np.maximum(np.abs(found / PUBLISHED - 1) / TOLERANCES - 1, 0))


def objective(found: Array, without: int | None = None) -> Array:
    """(n,) how many numbers are not met, and a smaller smooth part that leads there."""
    beyond = misses(found)
    cost = (beyond > 0) + 0.5 * beyond / (beyond + 1)
    if without is not None:
        cost = np.delete(cost, without, axis=1)
    return np.asarray(np.nan_to_num(cost.sum(axis=1), nan=99.0))


CONDITIONS = {  # columns of PUBLISHED that must be met as well
    "cells alone": [], "with 0.23 Hz": [14], "with K_p 6.15": [11], "with K_p 3.02": [10],
    "with all gains": [10, 11, 12, 13], "with all gains and 0.23 Hz": [10, 11, 12, 13, 14]}


def most_cells(rows: Array) -> dict[str, int]:
    """Largest number of cells within 25 % where the other numbers of a condition are met; -1 where they never are."""
    met = misses(rows) == 0
    return {name: int(max(met[met[:, columns].all(axis=1), :10].sum(axis=1), default=-1))
            for name, columns in CONDITIONS.items()}


def searched(structure: Structure, population: int, generations: int, repeats: int, wide: bool = False) -> Kept:
    """Differential evolution from Sobol points and the values of the model, several times; the best points at finer
    frequencies."""
    free = structure.free
    seen_points: list[Array] = []
    seen: list[Array] = []
    ours = np.array([place(name, OURS[name], wide) for name in free])

    def cost(points: Any, /) -> Any:
        points = points.reshape(len(free), -1).T
        rows = numbers(structure, values_at(structure, points, wide))
        seen_points.append(points)
        seen.append(rows)
        return objective(rows)

    ends = []
    for seed in range(repeats):
        start = np.vstack([ours, qmc.Sobol(len(free), seed=seed).random(population)[1:]])
        end = differential_evolution(cost, Bounds(np.zeros(len(free)), np.ones(len(free))), init=start, maxiter=generations,
                                     seed=seed, tol=0, polish=False, vectorized=True, updating="deferred")
        ends.append(float(end.fun))
    pool, rows = np.vstack(seen_points), np.vstack(seen)
    cells = (misses(rows)[:, :10] == 0).sum(axis=1)
    checked = np.unique([*objective(rows).argsort()[:128], *(
        k for columns in CONDITIONS.values()
        for k in np.where((misses(rows)[:, columns] == 0).all(axis=1), -cells, 1).argsort()[:64])])
    pool, checked_rows = pool[checked], np.vstack([numbers(structure, values_at(structure, part, wide), FINE)
                                                   for part in np.array_split(pool[checked], 8)])
    best = int(objective(checked_rows).argmin())
    left_out = np.array([rows[objective(rows, k).argmin(), k] / PUBLISHED[k] - 1 for k in range(10)])
    chosen = values_at(structure, pool[best:best + 1], wide)
    return {"values": {name: float(chosen[name][0, 0]) for name in free}, "numbers": checked_rows[best].tolist(),
            "ends": ends, "left_out": left_out.tolist(), "evaluations": len(rows), "most": most_cells(checked_rows)}


# -- table -------------------------------------------------------------------------------------------------------------
def distances(values: Mapping[str, float]) -> dict[str, float]:
    """Factor by which each value is outside the range of data sheets, for those that are."""
    return {name: max(value / BOX[name][1], BOX[name][0] / max(value, 1e-30)) for name, value in values.items()
            if not BOX[name][0] * 0.999 <= value <= BOX[name][1] * 1.001}


def row(structure: Structure, kept: Kept) -> str:
    """A row of the table of the page."""
    found, most = np.array(kept["numbers"]), kept["most"]
    deviations = np.abs(found / PUBLISHED - 1)
    left_out = np.sqrt((np.array(kept["left_out"]) ** 2).mean())
    outside = ", ".join(f"{name} {factor:.1f}" for name, factor in distances(kept["values"]).items())
    conditions = ", ".join("-" if most[name] < 0 else str(most[name])
                           for name in ("cells alone", "with 0.23 Hz", "with K_p 6.15"))
    counts = (len(structure.free), (misses(found) == 0).sum(), (deviations[:10] <= 0.25).sum(),
              (deviations[:10] <= 0.15).sum(), (deviations[10:14] <= 0.10).sum())
    columns = [structure.name, *map(str, counts), f"{found[10]:.2f}, {found[11]:.2f}",
               f"{found[14]:.3f}", f"{left_out:.0%}", ", ".join(f"{end:.1f}" for end in kept["ends"]), conditions]
    return "| " + " | ".join([*columns, outside or "none"]) + " |"


NAMES = ("structure", "free", "met", "cells 25 %", "cells 15 %", "gains 10 %", "K_p", "Hz", "left out", "optima",
         "most cells", "outside")
HEADER = "| " + " | ".join(NAMES) + " |\n|" + "---|" * len(NAMES)


def main() -> None:
    """As the command line calls it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("only", nargs="*", help="names of structures (default: all)")
    parser.add_argument("--population", type=int, default=64, help="Sobol points of each repeat, a power of 2")
    parser.add_argument("--generations", type=int, default=60)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--read", action="store_true", help="print the tables of the recorded results")
    options = parser.parse_args()
    single()
    kept = kept_results(RESULTS)
    for box, structures in BOXES.items():
        print(f"\n{box}\n{HEADER}")
        for structure in structures:
            if options.only and structure.name not in options.only:
                continue
            if not options.read:
                began = time.perf_counter()
                found = searched(structure, options.population, options.generations, options.repeats, wide=box == "wide")
                kept.setdefault(box, {})[structure.name] = found
                RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
                print(f"{time.perf_counter() - began:.0f} s", file=sys.stderr)
            print(row(structure, kept[box][structure.name]), flush=True)


if __name__ == "__main__":
    main()
