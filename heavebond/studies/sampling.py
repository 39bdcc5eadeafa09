"""Sampling of uncertain parameters from their declared ranges.

A range `20 .. 60 kN/m` is uniform. `42 kN/m +- 20 %` is normal about its middle, with half the tolerance as its standard
deviation, and truncated at the tolerance: no point lies outside the declared range.

Sobol sequence: I. M. Sobol, USSR Comput. Math. Math. Phys. 7 (1967) 86-112, doi:10.1016/0041-5553(67)90144-9, scrambled
as in SciPy. Points for variance-based indices: A. Saltelli et al., Comput. Phys. Commun. 181 (2010) 259-270,
doi:10.1016/j.cpc.2009.09.018.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heavebond.core.errors import Problems, suggest
from heavebond.core.numerals import whole
from heavebond.core.units import Range, UnitProblem, parse_range
from heavebond.language import reading
from heavebond.text.yaml_source import Mapping as Entries
from heavebond.text.yaml_source import Node, Scalar

Array = NDArray[np.float64]
DRAWN = ("sobol", "latin_hypercube", "random", "sobol_indices")  # kinds with a number of points
SEEDS = "seeds"
NAMED = ("one_at_a_time", "local", SEEDS)
KINDS = (*DRAWN, *NAMED)
BALANCED = ("sobol", "sobol_indices")  # kinds that need a power of two
MOST = 100_000
CUT = 2.0  # standard deviations at which a normal distribution is truncated
AS_GIVEN = "as given"


@dataclass(frozen=True)
class Sampling:
    """A sampling of parameters (ranges in SI): `number` points for the kinds in DRAWN; `one_at_a_time` moves each
    parameter to both ends, `local` requests slopes at the diagram's values, `seeds` takes every whole number of the
    ranges, which have equal lengths: independent realisations of random inputs of the diagram."""

    kind: str
    over: Mapping[str, Range]
    number: int = 1
    seed: int = 1


def distribution(wanted: Range) -> Any:
    """The distribution of a declared range, from SciPy."""
    from scipy.stats import truncnorm, uniform

    if wanted.nominal is None:
        return uniform(wanted.low, wanted.high - wanted.low)
    half = (wanted.high - wanted.low) / 2
    return truncnorm(-CUT, CUT, loc=wanted.nominal, scale=half / CUT)


def points(sampling: Sampling) -> Array:
    """The points (n, m) in SI; NaN for a parameter with its value in the diagram.

    `sobol_indices` gives n = number (m + 2) points: the rows of A, of B, then for each parameter the rows of A with its
    column from B. The same sampling gives the same points on every machine.
    """
    m = len(sampling.over)
    if sampling.kind == "local":
        return np.full((1, m), np.nan)
    if sampling.kind == SEEDS:
        return np.column_stack([np.arange(wanted.low, wanted.high + 0.5) for wanted in sampling.over.values()])
    if sampling.kind == "one_at_a_time":
        values = np.full((1 + 2 * m, m), np.nan)
        for k, wanted in enumerate(sampling.over.values()):
            values[1 + 2 * k, k], values[2 + 2 * k, k] = wanted.low, wanted.high
        return values
    from scipy.stats import qmc

    # points (number, dimensions) of the unit cube
    dimensions = 2 * m if sampling.kind == "sobol_indices" else m
    if sampling.kind == "random":
        shares = np.random.default_rng(sampling.seed).random((sampling.number, dimensions))
    elif sampling.kind == "latin_hypercube":
        shares = np.asarray(qmc.LatinHypercube(dimensions, seed=sampling.seed).random(sampling.number))
    else:
        shares = np.asarray(qmc.Sobol(dimensions, seed=sampling.seed).random(sampling.number))
    if sampling.kind == "sobol_indices":
        first, second = shares[:, :m], shares[:, m:]
        mixed = [np.where(np.arange(m) == k, second, first) for k in range(m)]
        shares = np.concatenate([first, second, *mixed])
    return np.column_stack([distribution(wanted).ppf(shares[:, k]) for k, wanted in enumerate(sampling.over.values())])


def names(sampling: Sampling) -> list[str]:
    """A name for each point: its number, or the parameter and its end."""
    if sampling.kind == "local":
        return [AS_GIVEN]
    if sampling.kind == "one_at_a_time":
        return [AS_GIVEN, *(f"{name} {end}" for name in sampling.over for end in ("low", "high"))]
    if sampling.kind == SEEDS:
        return [str(k + 1) for k in range(len(points(sampling)))]
    return [str(k + 1) for k in range(sampling.number * (len(sampling.over) + 2 if sampling.kind == "sobol_indices" else 1))]


# -- reading -----------------------------------------------------------------------------------------------------------
def read_sampling(entry: Entries, name: str, problems: Problems) -> Sampling | None:
    """`{sample: {sobol: 64, seed: 1}, over: {spring.c: 42 kN/m +- 20 %}}`."""
    reading.known_keys(entry, ("sample", "over"), f"'{name}'", problems, required=("sample", "over"))
    over = read_ranges(entry.items.get("over"), "over", problems)
    sample_node = entry.items.get("sample")
    if sample_node is None or not over:
        if "over" in entry.items and not over and not problems.found:
            problems.add("sample-empty", f"'{name}' samples over nothing", entry.place,
                         hint="Write `over: {spring.c: 20 .. 60 kN/m}`.")
        return None
    if isinstance(sample_node, Scalar):
        # seeds: ranges with whole ends that contain equally many numbers
        ends = [(wanted.low, wanted.high) for wanted in over.values()]
        if sample_node.text == SEEDS and not (
                all(low == round(low) and high == round(high) and 0 <= low <= high for low, high in ends)
                and len({high - low for low, high in ends}) == 1
                and all(wanted.nominal is None for wanted in over.values())):
            problems.add("seeds-wrong", "seeds are whole numbers, equally many for each parameter", sample_node.place,
                         hint="Write for example `over: {wave.seed: 1 .. 12}`.")
            return None
        if sample_node.text in NAMED:
            return Sampling(sample_node.text, over)
        hint = f"Write `sample: {{{sample_node.text}: 64}}`." if sample_node.text in DRAWN else \
            suggest(sample_node.text, KINDS) or "Write for example `sample: {sobol: 64}` or `sample: one_at_a_time`."
        problems.add("sample-unknown", f"'{sample_node.text}' is not a sampling method", sample_node.place, hint=hint)
        return None
    chosen = reading.mapping(sample_node, "sample", problems, "Write for example `sample: {sobol: 64}`.")
    return _drawn(chosen, over, problems) if chosen is not None else None


def read_ranges(node: Node | None, subject: str, problems: Problems) -> dict[str, Range]:
    """Parameters and their ranges: `spring.c: 20 .. 60 kN/m`, or `42 kN/m +- 20 %`."""
    entries = reading.mapping(node, subject, problems)
    ranges: dict[str, Range] = {}
    for name, item in (entries.items if entries else {}).items():
        try:
            ranges[name] = parse_range(reading.text(item, name, problems))
        except UnitProblem as problem:
            problems.add(problem.code, f"{name}: {problem.message}", item.place, hint=problem.hint)
    return ranges


def _are_seeds(over: Mapping[str, Range]) -> bool:
    """True if the ranges have whole ends and contain equally many numbers."""
    ends = [(wanted.low, wanted.high) for wanted in over.values()]
    return all(low == round(low) and high == round(high) and 0 <= low <= high for low, high in ends) and \
        len({high - low for low, high in ends}) == 1 and all(wanted.nominal is None for wanted in over.values())


def _drawn(chosen: Entries, over: Mapping[str, Range], problems: Problems) -> Sampling | None:
    kinds = [key for key in chosen.items if key != "seed"]
    if len(kinds) != 1 or kinds[0] not in DRAWN:
        near = suggest(kinds[0], DRAWN) if kinds else ""
        problems.add("sample-unknown", "the sampling method is missing" if len(kinds) != 1 else
                     f"'{kinds[0]}' is not a sampling method", chosen.place,
                     hint=near or f"Write `{{sobol: 64}}`; there are {', '.join(DRAWN)} and the words {', '.join(NAMED)}.")
        return None
    kind = kinds[0]
    number = _whole(chosen.items[kind], kind, 1, problems)
    seed = _whole(chosen.items["seed"], "seed", 0, problems) if "seed" in chosen.items else 1
    if number is None or seed is None:
        return None
    if kind in BALANCED and number & (number - 1):
        below = 2 ** int(math.log2(number))
        problems.add("sample-unbalanced", f"{kind}: {number} points are not a power of two, which Sobol's sequence needs",
                     chosen.items[kind].place, hint=f"Write {below} or {2 * below}.")
        return None
    return Sampling(kind, over, number, seed)


def _whole(node: Node, subject: str, least: int, problems: Problems) -> int | None:
    text = reading.text(node, subject, problems)
    number = whole(text)
    if number is None or not least <= number <= MOST:
        problems.add("count-wrong", f"{subject}: '{text}' is not a whole number from {least} to {MOST}", node.place)
        return None
    return number
