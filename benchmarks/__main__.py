"""Measure everything, print the table, and put it into docs/performance.md."""

from __future__ import annotations

import time
from pathlib import Path

from benchmarks import chain, compensator, diagnosing, heave, hundred_thousand, large, sampled, scaling, solvers, verdict
from benchmarks.measuring import Figure, write_page

PAGE = Path(__file__).parents[1] / "docs" / "performance.md"


def measured() -> list[Figure]:
    """Every figure, in the order of the page."""
    return [*heave.figures(), *compensator.figures(), *chain.figures(), *large.figures(),
            *hundred_thousand.figures(), *solvers.figures(), *sampled.figures(),
            *diagnosing.figures(), *scaling.figures(), *verdict.figures()]


def main() -> None:
    """As the command line calls it."""
    began = time.perf_counter()
    figures = measured()
    write_page(figures, PAGE)
    print(f"{time.perf_counter() - began:.0f} s; wrote {PAGE.name}")


main()
