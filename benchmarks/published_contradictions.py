"""Published numbers that structures of `published_structures` cannot meet together, within the ranges of data sheets.

For each set the smallest common deviation is sought over all values of a structure: the largest deviation of its numbers, in
tolerances, minimised by differential evolution. At 1 or less all numbers of the set are met; at 1.5 one of them is off by at
least 1.5 times its tolerance, whatever the values are.

    python -m benchmarks.published_contradictions             # five minutes of processor time
    python -m benchmarks.published_contradictions --read      # table of the recorded results
    python -m benchmarks.published_contradictions --gain      # largest stable K_p of every structure, two minutes
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from scipy.optimize import Bounds, differential_evolution
from scipy.stats import qmc

from benchmarks.published_search import BOXES, place, values_at
from benchmarks.published_structures import (
    CELLS,
    FINE,
    FREE_FLOW,
    OURS,
    PUBLISHED,
    STRUCTURES,
    TABLE,
    TOLERANCES,
    Array,
    Structure,
    Values,
    arrays,
    cells,
    eigenfrequency,
    limit_of_gain,
    open_loops,
)
from heavebond.core.threads import single

RESULTS = Path(__file__).with_name("published_contradictions.json")
SETS: dict[str, tuple[int, ...]] = {     # columns of PUBLISHED
    "K_p 6.15": (11,),
    "K_p 6.15 and 1.1 kN": (7, 11),
    "K_p 3.02, 6.15, 2.1 and 1.1 kN": (2, 7, 10, 11),
    "7.1 and 1.1 kN without friction": (6, 7),
    "7.1 kN and K_p 6.15": (6, 11),
    "five cells with friction": (0, 1, 2, 3, 4),
    "five cells without friction": (5, 6, 7, 8, 9),
    "nine cells, without 7.1 kN": (0, 1, 2, 3, 4, 5, 7, 8, 9),
    "fourteen numbers, without 7.1 kN": (0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14),
    "all fifteen numbers": tuple(range(15))}
SHOWN = ("second order, natural frequency", "second order, -3 dB bandwidth", "first order",
         "crown block and hook as one mass", "crown block and hook as one mass, -3 dB",
         "backward Euler, crown block and hook as one mass",
         "crown block and hook as one mass, -3 dB; flow gain free")


class Nearest(TypedDict):
    """The set as near as a structure comes to it."""

    factor: float
    values: dict[str, float]
    numbers: list[float]


def some_numbers(structure: Structure, v: Values, columns: Sequence[int]) -> Array:
    """(n, k) those columns of `numbers`, without the cells that they do not need."""
    wanted = {friction: [f_n for (one, f_n), column in zip(CELLS, range(10), strict=True) if one is friction and (
        column in columns or (f_n == 0.75 and {10, 12} & {c - (not friction) for c in columns if 10 <= c < 14}))]
        for friction in TABLE}
    found = {(friction, f_n): cell for friction, valves in wanted.items()
             for f_n, cell in zip(valves, cells(structure, v, friction, valves, w=FINE) if valves else [], strict=True)}
    columns_found = []
    for column in columns:
        if column < 10:
            columns_found.append(found[CELLS[column]].WOB)
        elif column < 14:
            cell = found[column % 2 == 0, 0.75]
            k_p = cell.K_p / cell.K_v if structure.cascade else cell.K_p
            columns_found.append(k_p if column < 12 else cell.K_v)
        else:
            columns_found.append(eigenfrequency(structure, v))
    return np.column_stack(columns_found)


def factors(found: Array, columns: Sequence[int]) -> Array:
    """(n,) largest deviation of the numbers of a set, in tolerances."""
    picked = list(columns)
    return np.asarray(np.nan_to_num((np.abs(found / PUBLISHED[picked] - 1) / TOLERANCES[picked]).max(axis=1), nan=99.0))


def least(structure: Structure, wide: bool, cost_of: Callable[[Values], Array], population: int,
          generations: int) -> tuple[float, dict[str, float]]:
    """Smallest cost and its values, by differential evolution from Sobol points and the values of the model."""
    free = structure.free

    def cost(points: Any, /) -> Any:
        return cost_of(values_at(structure, points.reshape(len(free), -1).T, wide))

    ours = [place(name, OURS[name], wide) for name in free]
    start = np.vstack([ours, qmc.Sobol(len(free), seed=0).random(population)[1:]])
    end = differential_evolution(cost, Bounds(np.zeros(len(free)), np.ones(len(free))), init=start, maxiter=generations,
                                 seed=0, tol=0, polish=False, vectorized=True, updating="deferred")
    values = values_at(structure, np.asarray(end.x)[None, :], wide)
    return float(end.fun), {name: float(values[name][0, 0]) for name in free}


def nearest(structure: Structure, columns: Sequence[int], wide: bool, population: int, generations: int) -> Nearest:
    """The values of a structure that come nearest to a set."""
    factor, values = least(structure, wide, lambda v: factors(some_numbers(structure, v, columns), columns), population,
                           generations)
    return {"factor": factor, "values": values, "numbers": some_numbers(structure, arrays(values), columns)[0].tolist()}


# -- the largest stable gain -------------------------------------------------------------------------------------------
def stable_gain(structure: Structure, v: Values) -> Array:
    """(n,) K_p at the stability boundary without friction at 0.75 Hz; of a cascade K_p/K_v, with the ideal feed-forward."""
    limit = limit_of_gain(structure, v, 0.75, open_loops(structure, v, friction=False, w=FINE))
    return limit * v["K_q"][:, 0] if structure.cascade else limit


def most_stable(structure: Structure, wide: bool, population: int = 64,
                generations: int = 60) -> tuple[float, dict[str, float]]:
    """Largest stable K_p of a structure, and its values."""
    found, values = least(structure, wide, lambda v: -stable_gain(structure, v), population, generations)
    return -found, values


def distinct(**alike: Any) -> list[Structure]:
    """The first of all structures that differ in other attributes than these."""
    found: dict[Structure, Structure] = {}
    for structure in STRUCTURES:
        found.setdefault(replace(structure, name="", **alike), structure)
    return list(found.values())


# -- tables ------------------------------------------------------------------------------------------------------------
def row(name: str, found: Mapping[str, Nearest]) -> str:
    """A row of the table of the page: the smallest common deviation of a set, for each structure."""
    return f"| {name} | " + " | ".join(f"{found[structure]['factor']:.2f}" for structure in SHOWN) + " |"


def gain_row(structure: Structure) -> str:
    """A row of the table of the largest stable gains: with the values of the model, within the ranges, in the wide box."""
    limits = stable_gain(structure, arrays({})).item(), *(most_stable(structure, box == "wide")[0] for box in BOXES)
    return f"| {structure.name} | " + " | ".join("no limit" if one > 1e3 else f"{one:.2f}" for one in limits) + " |"


def main() -> None:
    """As the command line calls it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--population", type=int, default=32, help="Sobol points, a power of 2")
    parser.add_argument("--generations", type=int, default=60)
    parser.add_argument("--read", action="store_true", help="print the table of the recorded results")
    parser.add_argument("--gain", action="store_true", help="print the largest stable K_p of every structure")
    options = parser.parse_args()
    single()
    if options.gain:
        for structure in distinct(friction="odd", resolution=0.0, stable=True):
            print(gain_row(structure), flush=True)
        return
    kept: dict[str, dict[str, Nearest]] = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    for name, columns in SETS.items():
        if not options.read:
            kept[name] = {structure.name: nearest(structure, columns, False, options.population, options.generations)
                          for structure in (*STRUCTURES, *FREE_FLOW) if structure.name in SHOWN}
            RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        print(row(name, kept[name]), flush=True)


if __name__ == "__main__":
    main()
